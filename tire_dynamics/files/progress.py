"""How far long work has come, on a terminal; nothing in a pipe.

rich draws the bar. It is imported when work has lasted, not before, and it gets no thread of its own: the bar is
drawn from the loop that it counts, a few times a second, so that it costs the work next to nothing.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import Any, TypeVar

__all__ = ["Progress", "progress"]

T = TypeVar("T")

_AFTER = 0.5  # [s] of work before there is a bar: shorter work is over before it is read
_EVERY = 0.2  # [s] between two pictures of it


def progress(
    items: Iterable[T],
    total: int,
    what: str,
    size: Callable[[T], int] = lambda item: 1,
    *,
    unit: str = "",
    quiet: bool = False,
) -> Iterator[T]:
    """The items, with a bar on standard error that says how many of ``total`` have passed.

    Parameters
    ----------
    items : iterable
    total : int
        What the sizes of all items come to; 0 if it is not known.
    what : str
        What is being done.
    size : callable
        What an item counts; 1 if left out.
    unit : str
        Of what is counted, as in "messages".
    quiet : bool
        Show nothing, as where standard error is no terminal.
    """
    with Progress(total, what, unit=unit, quiet=quiet) as shown:
        for item in items:
            yield item
            shown.advance(size(item))


class Progress:
    """The bar by itself, for work that is no loop; a context manager.

    Arguments as of :func:`progress`; with ``at_once`` it is there from the beginning, for items that take long each.
    """

    def __init__(self, total: int, what: str, *, unit: str = "", quiet: bool = False, at_once: bool = False) -> None:
        self._total, self._what, self._unit = total, what, unit
        self._hidden = quiet or not sys.stderr.isatty()
        self._count = self._messages = 0
        self._begin = time.monotonic()
        self._next = self._begin + (0.0 if at_once else _AFTER)
        self._at_once = at_once
        self._bar: Any = None

    def __enter__(self) -> Progress:
        if self._at_once:
            self.advance(0)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._draw()
            self._bar.stop()

    def advance(self, count: int = 1, messages: int = 0) -> None:
        """Count what has been done; ``messages``, how many there were in all, gives a rate of its own."""
        self._count += count
        self._messages = messages
        if self._hidden or (now := time.monotonic()) < self._next:
            return
        self._next = now + _EVERY
        if self._bar is None:
            self._begin_bar()
        self._draw()

    def _begin_bar(self) -> None:
        try:
            from rich.console import Console
            from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar
        except ImportError:  # a ROS workspace may lack it; the work goes on without
            self._hidden = True
            return
        columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TextColumn("{task.fields[rate]}")
        # What is printed meanwhile on standard error stands above the bar; standard output is left alone.
        self._bar = Bar(
            *columns, TimeRemainingColumn(elapsed_when_finished=True), console=Console(stderr=True),
            auto_refresh=False, redirect_stdout=False,
        )  # fmt: skip
        self._bar.add_task(self._what, total=self._total or None, rate="")
        self._bar.start()

    def _draw(self) -> None:
        if self._bar is None:
            return
        seconds = max(time.monotonic() - self._begin, 1e-3)
        shown = f"{_short(self._count)} {self._unit}".rstrip()
        if self._messages:
            shown += f", {_short(self._messages / seconds)} messages/s"
        elif self._count:
            shown += f", {_short(self._count / seconds)}/s"
        # Items may come to less than was announced, as where topics are left out: the end is then not at 100 %.
        self._bar.update(0, completed=min(self._count, self._total or self._count), rate=shown)
        self._bar.refresh()


def _short(number: float) -> str:
    """Three digits or so: 950, 12.3 k, 4.56 M."""
    for unit in ("", " k", " M", " G"):
        if number < 999.5:
            return f"{number:.3g}{unit}"
        number /= 1000.0
    return f"{number:.3g} T"
