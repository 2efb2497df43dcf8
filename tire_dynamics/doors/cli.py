"""The command ``tire-dynamics``."""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import sys
from collections.abc import Sequence

from .errors import InputError

__all__ = ["main", "node"]

_MAX_RPM = 1e7
_MAX_LINE = 2000  # characters of an error: a stranger's file may have a million topics to list
UNUSABLE = 2  # exit status for input that cannot be used


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit status: 0, or 2 with one line on standard error for input it cannot use."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    try:
        if arguments[:1] == ["node"]:
            return _node(arguments[1:])  # everything behind it is for ROS
        options = _parser().parse_args(arguments)
        status = int(options.run(options) or 0)
        sys.stdout.flush()  # here, where a reader that has gone is no error of ours
        return status
    except InputError as error:
        return _refuse(error)
    except BrokenPipeError:  # the reader of our output has gone, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except OSError as error:  # a disk that is full, a folder that may not be written
        return _refuse(InputError(f"{error.filename or _output(arguments)}: {error.strerror or error}"))
    except KeyboardInterrupt:
        return 128 + signal.SIGINT


def _output(arguments: Sequence[str]) -> str:
    """The output that the command line names, for an error that names no file."""
    for option in ("-o", "--output"):
        if option in arguments[:-1]:
            return arguments[arguments.index(option) + 1]
    return "writing"


def node() -> int:
    """Entry point of ``ros2 run tire_dynamics node``."""
    return main(["node", *sys.argv[1:]])


def _refuse(error: InputError) -> int:
    print(f"tire-dynamics: {_one_line(str(error))}", file=sys.stderr)
    return UNUSABLE


def _one_line(text: str) -> str:
    """A text as one line of what a terminal can show, not endless; names in it may be a stranger's."""
    text = " ".join(text.split())
    text = text if len(text) <= _MAX_LINE else f"{text[:_MAX_LINE]} ..."
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> None:  # type: ignore[override]
        raise InputError(f"{message} (see {self.prog} --help)")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="tire-dynamics", description="What the tires do to the axles: replay, stability, figures.")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    command = commands.add_parser("replay", help="run a bag through the same logic as the live node")
    command.description = (
        "Runs a bag through the same logic as the live node. With several bags, and with --jobs or --scheduler also "
        "with one, OUT is a folder with a bag of the same name for each; a bag that cannot be replayed is named, and "
        "the others go on."
    )
    command.add_argument(
        "input", metavar="IN", nargs="+", help="a rosbag2 folder or a .mcap file: inputs, or a log of the node"
    )
    command.add_argument("-o", "--output", metavar="OUT", required=True, help="the rosbag2 folder to write")
    command.add_argument("--config", metavar="YAML", help="parameters of the node, or the fields of one unit")
    command.add_argument("--force", action="store_true", help="replace a bag that is to be written and exists")
    from . import jobs

    jobs.add_arguments(command, "the bags")
    command.set_defaults(run=_replay)

    command = commands.add_parser("recover", help="a whole bag of what a truncated or damaged one still holds")
    command.description = (
        "Makes a whole bag of what a truncated or damaged one still holds, and says what was kept and what was lost. "
        "IN is never changed."
    )
    command.add_argument("input", metavar="IN", help="a .mcap file, or a folder of some, with metadata.yaml or without")
    command.add_argument("-o", "--output", metavar="OUT", required=True, help="the rosbag2 folder to write")
    command.add_argument("--force", action="store_true", help="replace OUT if it exists")
    command.add_argument("--json", action="store_true", help="say it as JSON")
    command.set_defaults(run=_recover)

    command = commands.add_parser("play", help="publish a bag's messages live")
    command.add_argument("input", metavar="IN", help="a rosbag2 folder or a .mcap file")
    command.add_argument("--rate", metavar="R", type=float, default=1.0, help="speed of play (default 1)")
    command.add_argument("--loop", action="store_true", help="begin again at the end")
    command.add_argument("--keep-stamps", action="store_true", help="do not move header stamps to the present")
    command.add_argument(
        "--wait", metavar="S", type=float, default=0.0, help="wait at most S seconds for a subscriber on every topic"
    )
    command.set_defaults(run=_play)

    command = commands.add_parser("node", help="the live node; ROS arguments follow: node --ros-args -p rate_hz:=500.0")

    command = commands.add_parser("import", help="CSV recordings into an input bag")
    from . import csv_import

    csv_import.add_arguments(command)
    command.set_defaults(run=csv_import.run)

    command = commands.add_parser("figures", help="redraw the paper's figures, with their numbers as CSV")
    from . import figures

    figures.add_arguments(command)
    command.set_defaults(run=figures.run)

    command = commands.add_parser("map", help="stability or transmissibility over two fields of the unit or the speed")
    from . import map as map_

    map_.add_arguments(command)
    command.set_defaults(run=map_.run)

    command = commands.add_parser("stability", help="Floquet stability at a speed, as JSON")
    command.add_argument("--speed-rpm", metavar="R", type=float, required=True, help="speed of the wheel [rpm]")
    command.add_argument("--config", metavar="YAML", help="the fields of one unit, or parameters of the node")
    command.set_defaults(run=_stability)
    return parser


def _node(arguments: list[str]) -> int:
    if arguments in (["-h"], ["--help"]):
        print("usage: tire-dynamics node [--ros-args -p NAME:=VALUE --params-file YAML -r FROM:=TO ...]\n")
        print("The live node, until SIGINT. Its parameters:\n")
        from .parameters import PARAMETERS

        for row in PARAMETERS:
            default = list(row.default) if isinstance(row.default, tuple) else row.default
            print(f"  {row.name:30} {row.kind:9} {default!s:12} {row.description}")
        return 0
    _need_ros()
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):  # before the long import, so that both end a start-up as well
        signal.signal(number, lambda caught, frame: stopping.append(caught))
    from .node import run

    run(arguments, lambda: bool(stopping))
    return 0


def _need_ros() -> None:
    from importlib.util import find_spec

    if find_spec("rclpy") is None:
        raise InputError(
            "this needs rclpy: source a ROS 2 installation, or pip install 'tire_dynamics[ros]' (Linux, x86-64)"
        )


def _play(options: argparse.Namespace) -> int:
    _need_ros()
    from .play import play

    count = play(
        options.input, rate=options.rate, loop=options.loop, keep_stamps=options.keep_stamps, wait=options.wait
    )
    print(f"{count} messages published", file=sys.stderr)
    return 0


def _recover(options: argparse.Namespace) -> int:
    from .recover import run

    return run(options)


def _replay(options: argparse.Namespace) -> int:
    if len(options.input) > 1 or options.jobs is not None or options.scheduler is not None:
        from . import batch

        return UNUSABLE if batch.run(options) else 0
    from .replay import replay

    [source] = options.input
    summary = replay(source, options.output, config=options.config, force=options.force)
    if summary.damage:
        print(_one_line(f"{source} is damaged: {summary.damage}; what stands before was replayed"), file=sys.stderr)
    total = sum(summary.received.values())
    written = sum(summary.written.values())
    print(_one_line(f"{options.output}: {total} messages in, {written} out"), file=sys.stderr)
    return 0


def _stability(options: argparse.Namespace) -> int:
    from ..estimator.vehicle import stability_reply
    from .parameters import complete, read_config, unit_of

    if not abs(options.speed_rpm) <= _MAX_RPM:
        raise InputError(f"--speed-rpm is {options.speed_rpm}; it must be between -{_MAX_RPM:g} and {_MAX_RPM:g}")
    values = complete(read_config(options.config) if options.config else {})
    try:
        reply = stability_reply("wheel", unit_of(values), options.speed_rpm * math.pi / 30.0, values["model"])
    except (ArithmeticError, ValueError) as error:
        raise InputError(f"--speed-rpm is {options.speed_rpm}: {error}") from None
    print(json.dumps(reply, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
