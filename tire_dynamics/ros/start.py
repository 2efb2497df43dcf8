"""The live node as a process: its first line before everything that takes time, and its end at a signal."""

from __future__ import annotations

from collections.abc import Sequence

from ..build_state import how_to_compile, is_compiled
from ..files.errors import InputError, first_line
from .stop import Stop

__all__ = ["start"]

_NAME = __name__.partition(".")[0]  # of the node too; the table of parameters, which has it, takes long to load


def start(arguments: Sequence[str]) -> None:
    """Run the node until SIGINT, SIGTERM or SIGHUP.

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
