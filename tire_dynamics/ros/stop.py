"""What SIGINT, SIGTERM and SIGHUP do to the node, from its first line on."""

from __future__ import annotations

import os
import signal

__all__ = ["Stop"]

_LEFT = 1.5  # [s] for a start that is to stop; then it is cut


class Stop:
    """SIGINT, SIGTERM and SIGHUP, and what each does until the node runs.

    SIGHUP comes when the terminal is closed or the connection to the vehicle is lost; ``nohup`` has it ignored, and so
    it stays then.

    While modules are loaded there is nothing to finish, and the signal ends the process at once, with status 0. While
    the node is made, the signal is noted, and the node leaves the graph when it is there; where that takes longer than
    1.5 s, as on a disk that does not answer, SIGALRM ends the process. From :meth:`runs` on the signal is noted, and
    the node closes its log, however long that takes.
    """

    def __init__(self) -> None:
        self._noted = False
        self._handle = self._end

    def __call__(self) -> bool:
        """Whether to stop."""
        return self._noted

    def listen(self) -> None:
        """Take over the signals."""
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
                signal.signal(number, lambda number, frame: self._handle())

    def loaded(self) -> None:
        """From now on there is something to finish."""
        self._handle = self._hurry

    def runs(self) -> None:
        """The start is over, and with it the haste."""
        self._handle = self._note
        signal.setitimer(signal.ITIMER_REAL, 0.0)

    def _end(self) -> None:
        os._exit(0)

    def _hurry(self) -> None:
        if not self._noted:
            signal.setitimer(signal.ITIMER_REAL, _LEFT)  # the kernel's: it needs no turn of a busy interpreter
        self._note()

    def _note(self) -> None:
        self._noted = True
