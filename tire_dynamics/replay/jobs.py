"""One function and many items, in processes of this machine or on a Dask cluster.

What the function does is no matter here. It stands at the top of a module, so that other processes find it, and it may
be ended at any moment: what it then leaves half done is for the caller to clear away.
"""

from __future__ import annotations

import argparse
import signal
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import AbstractContextManager, closing, suppress
from functools import partial
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from ..files.errors import InputError
from ..files.progress import progress

if TYPE_CHECKING:
    from concurrent.futures import Future
    from multiprocessing.process import BaseProcess

__all__ = ["Failure", "Workers", "add_arguments", "workers"]

T = TypeVar("T")
R = TypeVar("R")

MOST_JOBS = 512
MOST_TEXT = 2000  # characters of a reason, as of the command line's other errors
PATIENCE = 8.0  # seconds for a scheduler to answer


class Failure(NamedTuple):
    """Why an item has no result, in one line."""

    reason: str


def add_arguments(parser: argparse.ArgumentParser, what: str) -> None:
    """Declare ``--jobs`` and ``--scheduler``; ``what`` is what they spread."""
    parser.add_argument("--jobs", metavar="N", type=int, help=f"spread {what} over N processes of this machine")
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help=f"spread {what} over the Dask cluster whose scheduler is at ADDRESS, such as tcp://host:8786",
    )


def workers(jobs: int | None, scheduler: str | None) -> Workers:
    """Who does the work, as a context manager at whose end nobody works any more.

    Parameters
    ----------
    jobs : int, optional
        Processes on this machine, 1 if left out. They start as they are needed.
    scheduler : str, optional
        The address of a Dask scheduler, whose workers it is then.

    Raises
    ------
    InputError
        Both are given, ``jobs`` is out of its bounds, Dask is not installed or the scheduler does not answer.
    """
    if scheduler is not None and jobs is not None:
        raise InputError("--jobs is for this machine and --scheduler for a cluster's; only one can be given")
    if scheduler is not None:
        return _Cluster(scheduler)
    if jobs is not None and not 1 <= jobs <= MOST_JOBS:
        raise InputError(f"--jobs is {jobs}; it must be from 1 to {MOST_JOBS}")
    return _Processes(jobs or 1)


class Workers(AbstractContextManager["Workers"], ABC):
    """What ``workers`` returns."""

    @abstractmethod
    def each(self, function: Callable[[T], R], items: Iterable[T]) -> Generator[tuple[int, R | Failure], None, None]:
        """Number and result of every item, as they are done.

        Where the function raises, or the process that ran it ended, there is a ``Failure``, and the others go on.
        Closing the iterator ends the work.
        """

    def map(
        self, function: Callable[[Any], Any], items: Iterable[Any], what: str = "", quiet: bool = True
    ) -> list[Any]:
        """The results in order, as of the built-in ``map``; ``InputError`` if there is one failure.

        Unless ``quiet`` a terminal shows how many there are of ``what``.
        """
        results = {}
        items = list(items)
        with closing(self.each(function, items)) as done:
            for number, result in progress(done, len(items), what, quiet=quiet):
                if isinstance(result, Failure):
                    raise InputError(result.reason)
                results[number] = result
        return [results[number] for number in range(len(results))]


def _attempt(function: Callable[[T], R], item: T) -> R | Failure:
    try:
        return function(item)
    except InputError as error:
        reason = str(error)
    except OSError as error:
        reason = f"{error.filename or type(error).__name__}: {error.strerror or error}"
    except Exception as error:  # a fault of ours; the other items are none the worse
        reason = f"{type(error).__name__}: {error}"
    return _failure(reason)


def _failure(reason: str) -> Failure:
    line = " ".join(reason.split())
    return Failure(line if len(line) <= MOST_TEXT else f"{line[:MOST_TEXT]} ...")


# -- on this machine --------------------------------------------------------------------------------------------------


class _Worker:
    """A process that takes one item after the other.

    It is an executor of one process. In an executor of many, the end of one process fails every item that waits or is
    being worked on, and which of them was the cause is not known.
    """

    def __init__(self) -> None:
        from concurrent.futures import ProcessPoolExecutor  # not above: `--help` loads this module
        from multiprocessing import get_context

        # A fork would take over the threads' locks of whatever runs here.
        self._executor = ProcessPoolExecutor(1, get_context("spawn"), _prepare)
        self._process: BaseProcess | None = None

    def submit(self, function: Callable[[T], R], item: T) -> Future[R | Failure]:
        """Begin with an item; the worker has none at the time."""
        if self._process is not None:
            return self._executor.submit(_attempt, function, item)
        from multiprocessing import active_children, resource_tracker

        others = active_children()
        # Ctrl-C in a terminal reaches every process; it is ours to end the others. They inherit what is blocked.
        resource_tracker.ensure_running()  # else it is started there, which may unblock
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            future = self._executor.submit(_attempt, function, item)  # this starts the process
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        self._process = next((process for process in active_children() if process not in others), None)
        return future

    def result(self, future: Future[R | Failure]) -> R | Failure:
        """What the function returned, or a Failure; the future is done."""
        from concurrent.futures.process import BrokenProcessPool

        try:
            return future.result()
        except BrokenProcessPool:
            self.end()
            return Failure(f"the process that worked on it ended {self._how()}")
        except Exception as error:  # the item or the result cannot be sent to another process
            return _failure(f"{type(error).__name__}: {error}")

    def _how(self) -> str:
        code = None if self._process is None else self._process.exitcode
        if code is None or code >= 0:
            return f"with exit status {code}"
        signals = {number.value: number.name for number in signal.Signals}
        return f"by {signals.get(-code, f'signal {-code}')}"

    @property
    def alive(self) -> bool:
        """Whether it can take an item."""
        return self._process is not None and self._process.is_alive()

    def end(self) -> None:
        """End the process, whatever it does, and wait until it has ended."""
        if self.alive and self._process is not None:
            self._process.terminate()
        self._executor.shutdown()


def _prepare() -> None:
    """What a worker does first."""
    from multiprocessing import parent_process
    from os import _exit
    from threading import Thread

    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        parent = parent_process()
        if parent is not None:
            parent.join()
        _exit(1)

    Thread(target=watch, daemon=True).start()  # however the parent ends, nobody is left who wants the result


class _Processes(Workers):
    def __init__(self, count: int) -> None:
        self._count = count
        self._idle: list[_Worker] = []

    def each(self, function: Callable[[T], R], items: Iterable[T]) -> Generator[tuple[int, R | Failure], None, None]:
        from concurrent.futures import FIRST_COMPLETED, wait

        waiting = enumerate(items)
        running: dict[Future[R | Failure], tuple[int, _Worker]] = {}

        def fill() -> None:
            while len(running) < self._count and (following := next(waiting, None)) is not None:
                number, item = following
                worker = self._take()
                running[worker.submit(function, item)] = number, worker

        try:
            fill()
            while running:
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    number, worker = running[future]
                    result = worker.result(future)
                    del running[future]
                    self._idle.append(worker)
                    fill()
                    yield number, result
        finally:
            for _, worker in running.values():
                worker.end()

    def _take(self) -> _Worker:
        while self._idle:
            worker = self._idle.pop()
            if worker.alive:
                return worker
            worker.end()
        return _Worker()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for worker in self._idle:
            worker.end()


# -- on a cluster -----------------------------------------------------------------------------------------------------

LOST = Failure("the worker that worked on it was lost, and so was each that tried again")


class _Cluster(Workers):
    def __init__(self, address: str) -> None:
        import logging

        try:
            import distributed
        except ImportError:
            raise InputError("--scheduler needs Dask: pip install 'tire_dynamics[cluster]'") from None
        for name in ("distributed", "distributed.client", "tornado", "asyncio"):  # one line is ours
            logging.getLogger(name).setLevel(logging.CRITICAL)
        self._address = address
        try:
            _knock(address)
            self._client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
        except Exception as error:  # whatever Dask makes of another server's answer
            reason = str(error) or "it is silent"
            raise InputError(f"--scheduler is {address}, where no Dask scheduler answers: {reason}") from None
        if not self._client.nthreads():
            print(f"{address}: has no worker yet; the work waits for one", file=sys.stderr)

    def each(self, function: Callable[[T], R], items: Iterable[T]) -> Generator[tuple[int, R | Failure], None, None]:
        given = dict(enumerate(items))
        lost = []
        with closing(self._together(function, given)) as results:
            for number, result in results:
                if result is LOST:
                    lost.append(number)
                else:
                    yield number, result
        # An item that ends its workers is lost, but so are others that waited there. Each alone shows which it was.
        for number in lost:
            with closing(self._together(function, {number: given[number]})) as results:
                yield from results

    def _together(
        self, function: Callable[[T], R], items: Mapping[int, T]
    ) -> Generator[tuple[int, R | Failure], None, None]:
        from distributed import as_completed

        # Not pure: Dask would take the result of an earlier call for this one's.
        futures = self._client.map(partial(_attempt, function), list(items.values()), pure=False)
        numbers = {future.key: number for future, number in zip(futures, items, strict=True)}
        try:
            for future in as_completed(futures, loop=self._client.loop):
                yield numbers[future.key], self._result(future)
                future.release()
        finally:
            with suppress(Exception):  # the scheduler may have gone, and the work with it
                self._client.cancel([future for future in futures if not future.done()], force=True)

    def _result(self, future: Any) -> Any:
        from concurrent.futures import CancelledError

        from distributed.scheduler import KilledWorker

        try:
            return future.result()
        except KilledWorker:  # Dask has had others try again
            return LOST
        except CancelledError:
            return Failure(f"the scheduler at {self._address} has gone")
        except Exception as error:  # such as the package missing there
            return _failure(f"the worker cannot: {type(error).__name__}: {error}")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(Exception):
            self._client.close()


def _knock(address: str) -> None:
    """Raise what speaks against a client: one would wait without an end for a server that does not speak."""
    import asyncio

    from distributed import Security
    from distributed.comm import connect

    async def connection() -> None:
        arguments = Security().get_connection_args("client")
        comm = await asyncio.wait_for(connect(address, timeout=PATIENCE, **arguments), PATIENCE + 1.0)
        comm.abort()

    asyncio.run(connection())
