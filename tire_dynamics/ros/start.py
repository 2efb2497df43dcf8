"""The live node as a process: its first line before everything that takes time, and its end at a signal."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence

from ..build_state import how_to_compile, is_compiled
from ..files.errors import InputError, first_line

__all__ = ["Stop", "start"]

_NAME = __name__.partition(".")[0]  # of the node too; the table of parameters, which has it, takes long to load
_LEFT = 1.5  # [s] for a start that was told to stop; then it is cut


class Stop:
    """SIGINT and SIGTERM, and what each does until the node runs.

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
        for number in (signal.SIGINT, signal.SIGTERM):
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


def start(arguments: Sequence[str]) -> None:
    """Run the node until SIGINT or SIGTERM.

    Parameters
    ----------
    arguments : sequence of str
        ROS arguments, as ``--ros-args -p name:=value``.

    Raises
    ------
    InputError
        The arguments or the parameters cannot be used.
    """
    stop = Stop()
    stop.listen()  # before the long imports
    import rclpy
    from rclpy.logging import get_logger
    from rclpy.signals import SignalHandlerOptions

    from .. import __version__

    try:
        rclpy.init(args=[_NAME, *arguments], signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rcl reports bad arguments and files as RuntimeErrors of its own kinds
        raise InputError(first_line(error)) from None
    try:
        leftover = rclpy.utilities.remove_ros_args([_NAME, *arguments])[1:]
        if leftover:
            raise InputError(f"{leftover[0]!r} is not an option; ROS arguments follow --ros-args")
        get_logger(_NAME).info(f"loading version {__version__}")
        if not is_compiled():
            get_logger(_NAME).warning(how_to_compile())
        from .node import run

        run(stop)
    finally:
        rclpy.try_shutdown()
