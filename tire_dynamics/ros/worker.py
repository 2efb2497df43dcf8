"""A thread beside the ticks for what takes longer than a tick may."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Hashable
from typing import Any

__all__ = ["Worker"]

Then = Callable[[Any, "Exception | None"], None]


class _Task:
    """Work under a key, and who is to hear of it."""

    def __init__(self, key: Hashable, work: Callable[[], Any], then: Then) -> None:
        self.key = key
        self.work = work
        self.then = deque([then])
        self.result: Any = None
        self.error: Exception | None = None


class Worker:
    """Does one piece of work after the other on a thread of its own; results are fetched.

    All methods are for one thread, that which ticks. It never waits here: it asks, goes on, and takes up what is done
    when it has time for it. Who asks for what is asked for already, or being done, shares it.

    Parameters
    ----------
    most : int
        Askers that may wait at a time.
    """

    def __init__(self, most: int = 256) -> None:
        self._most = most
        self._tasks: dict[Hashable, _Task] = {}  # asked for, and not yet taken up
        self._waiting: deque[_Task] = deque()
        self._done: deque[_Task] = deque()
        self._changed = threading.Condition()  # guards what waits
        self._ending = False
        self._thread: threading.Thread | None = None

    @property
    def waiting(self) -> int:
        """Askers that wait."""
        return sum(len(task.then) for task in self._tasks.values())

    def ask(self, key: Hashable, work: Callable[[], Any], then: Then, *, urgent: bool = False) -> bool:
        """Have work done.

        Parameters
        ----------
        key : hashable
            What the result depends on: of the same key, one is done for all.
        work : callable
            Called on the worker's thread.
        then : callable
            Called by :meth:`deliver` with the result and None, or with None and the exception that work raised.
        urgent : bool
            Before all that waits, however much that is.

        Returns
        -------
        bool
            False if too many wait; then nothing will come.
        """
        if not urgent and self.waiting >= self._most:
            return False
        task = self._tasks.get(key)
        if task is not None:
            task.then.append(then)
            return True
        task = self._tasks[key] = _Task(key, work, then)
        with self._changed:
            if urgent:
                self._waiting.appendleft(task)
            else:
                self._waiting.append(task)
            self._changed.notify()
        if self._thread is None:
            # A daemon: a program that ends does not wait for an analysis that nobody will read.
            self._thread = threading.Thread(target=self._run, name="worker", daemon=True)
            self._thread.start()
        return True

    def deliver(self, most: int) -> None:
        """Tell some of those whose work is done; the others next time."""
        while self._done and most > 0:
            task = self._done[0]
            if self._tasks.get(task.key) is not task:  # forgotten
                self._done.popleft()
                continue
            then = task.then.popleft()
            if not task.then:  # before the last one hears of it, who may ask again
                self._done.popleft()
                del self._tasks[task.key]
            then(task.result, task.error)
            most -= 1

    def forget(self) -> None:
        """Tell nobody of anything that was asked for, and begin none of it."""
        self._tasks.clear()
        with self._changed:
            self._waiting.clear()

    def close(self) -> None:
        """End the thread behind what it is doing; this does not wait for it."""
        self.forget()
        with self._changed:
            self._ending = True
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._waiting and not self._ending:
                    self._changed.wait()
                if self._ending:
                    return
                task = self._waiting.popleft()
            try:
                task.result = task.work()
            except Exception as error:  # the asker is to hear of it, whatever it was
                task.error = error
            self._done.append(task)
