"""What is done every so often beside the ticks, a piece at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

__all__ = ["PATIENCE", "ROOM", "Call", "Duties", "Duty", "do_all"]

PATIENCE: Final = 50_000_000
"""For so long [ns] a duty gives way to the ticks; what is left of it then is done at once."""

ROOM: Final = 2_000_000
"""So long [ns] before the next tick there is room for another piece."""

Call = Callable[[], "Iterator[None] | None"]
"""Does the whole of a duty, or returns an iterator whose steps are its pieces."""

_END: Any = object()


class Duty:
    """Something to do every ``period``, from ``due`` on; times in ns."""

    def __init__(self, due: int, period: int, call: Call) -> None:
        self._due, self._period, self._call = due, period, call
        self._pieces: Iterator[None] | None = None
        self._since = due

    def is_due(self, now: int) -> bool:
        """Whether there is a piece to do."""
        return self._pieces is not None or now >= self._due

    def rank(self) -> tuple[bool, int]:
        """Least for what is under way, then for what has waited longest."""
        return self._pieces is None, self._due

    def step(self, now: int) -> None:
        """Do a piece."""
        if self._pieces is None:
            self._since, self._due = self._due, max(self._due + self._period, now)
            self._pieces = self._call()
        if self._pieces is not None and next(self._pieces, _END) is _END:
            self._pieces = None

    def is_late(self, now: int) -> bool:
        """Whether what was begun last has given way long enough."""
        return now - self._since > PATIENCE

    def drop(self) -> None:
        """Leave out the rest of what was begun."""
        self._pieces = None


class Duties:
    """Duties that share the time between ticks.

    Between two ticks a piece of one of them is done, and more where the next tick is at least :data:`ROOM` away or the
    duty is late by more than :data:`PATIENCE`: at high rates no tick waits for more than a piece, and at low ones, or
    where the machine is too slow for the ticks, everything is done all the same.

    Parameters
    ----------
    clock : callable
        The time [ns], which never goes back.
    """

    def __init__(self, clock: Callable[[], int]) -> None:
        self._clock = clock
        self._duties: list[Duty] = []

    def add(self, seconds: float, call: Call) -> Duty:
        """Have something done every so often, for the first time when that time is over."""
        period = round(1e9 * seconds)
        self._duties.append(Duty(self._clock() + period, period, call))
        return self._duties[-1]

    def remove(self, duty: Duty) -> None:
        """Have it done no more."""
        self._duties.remove(duty)

    def drop(self) -> None:
        """Leave out the rest of what was begun."""
        for duty in self._duties:
            duty.drop()

    def do(self, next_tick: int) -> None:
        """Do what there is room for before the next tick, whose time is given [ns]."""
        now = self._clock()
        while waiting := [duty for duty in self._duties if duty.is_due(now)]:
            duty = min(waiting, key=Duty.rank)
            duty.step(now)
            now = self._clock()
            if next_tick - now < ROOM and not duty.is_late(now):
                return


def do_all(call: Call) -> None:
    """Do all pieces of a duty at once."""
    for _ in call() or ():
        pass
