"""When ticks are due, and which of those that were missed are made up for."""

from __future__ import annotations

from typing import Final, NamedTuple

__all__ = ["MADE_UP", "Deadlines", "Tick"]

MADE_UP: Final = 8
"""Ticks that a stall may cost and that are made up for all the same."""

_EARNED = 1.0 / 16.0  # of one more of them, by each tick that is in time


class Tick(NamedTuple):
    """A tick that is due: its deadline [ns], and how many deadlines before it are left out."""

    deadline: int
    left_out: int


class Deadlines:
    """Instants one period apart on the steady clock, whatever the ticks do; it is told the time and reads no clock.

    After a stall the deadlines that have passed are made up for, one after the other and at once, so that the outputs
    have no gap. That is for stalls: at most :data:`MADE_UP` are, and as many again only after sixteen times as many
    ticks that were in time. Of the others the last is made and those before it are left out: a machine that is too slow
    for the rate has no backlog.

    Parameters
    ----------
    due : int
        The first deadline [ns].
    period : int
        Between two of them [ns].

    Attributes
    ----------
    due : int
        The next deadline [ns].
    """

    def __init__(self, due: int, period: int) -> None:
        self.due = due
        self._period = period
        self._promised = 0  # that have passed and will be made up for
        self._credit = float(MADE_UP)

    def take(self, now: int) -> Tick | None:
        """The tick to make at a time [ns]; None if none is due."""
        missed = (now - self.due) // self._period  # deadlines behind the one that is due which have passed as well
        if missed < 0:
            return None
        left_out = 0
        if self._promised:
            self._promised -= 1
        elif missed:
            self._promised = min(missed, int(self._credit))
            self._credit -= self._promised
            left_out = missed - self._promised
        else:
            self._credit = min(self._credit + _EARNED, MADE_UP)
        deadline = self.due + left_out * self._period
        self.due = deadline + self._period
        return Tick(deadline, left_out)
