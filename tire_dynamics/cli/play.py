"""``tire-dynamics play``: a bag's messages published live."""

from __future__ import annotations

import argparse

from .answer import answer
from .node import need_ros
from .options import A_BAG

__all__ = ["add_arguments", "run"]


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Declare the options of ``play``."""
    command.add_argument("input", metavar="IN", help=A_BAG)
    command.add_argument("--rate", metavar="R", type=float, default=1.0, help="speed of play (default 1)")
    command.add_argument("--loop", action="store_true", help="begin again at the end")
    command.add_argument("--keep-stamps", action="store_true", help="do not move header stamps to the present")
    command.add_argument(
        "--max-gap",
        metavar="S",
        type=float,
        default=3600.0,
        help="skip a gap in the recording that is longer than S seconds, and say so (default 3600)",
    )
    command.add_argument(
        "--wait", metavar="S", type=float, default=0.0, help="wait at most S seconds for a subscriber on every topic"
    )
    command.add_argument(
        "--ros-args",
        metavar="ARG",
        nargs=argparse.REMAINDER,
        default=[],
        help="arguments for ROS, to the end of the line: with a namespace, topics move below it",
    )


def run(options: argparse.Namespace) -> int:
    """Play the bag; exit status 0."""
    need_ros()
    from ..ros.play import play

    count = play(
        options.input,
        rate=options.rate,
        loop=options.loop,
        keep_stamps=options.keep_stamps,
        wait=options.wait,
        max_gap=options.max_gap,
        ros_arguments=options.ros_args,
    )
    answer(options, {"input": options.input, "messages": count}, f"{count} messages published")
    return 0
