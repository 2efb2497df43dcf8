"""``tire-dynamics replay``: one bag or many through the logic of the live node."""

from __future__ import annotations

import argparse
import sys

from ..replay import jobs
from .answer import answer, one_line
from .options import A_BAG, add_clock, add_config, add_inputs, add_output, add_remap, add_vehicle
from .usage import UNUSABLE

__all__ = ["add_arguments", "run"]


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Declare the options of ``replay``."""
    command.add_argument("input", metavar="IN", nargs="+", help=f"{A_BAG}: inputs, or a log of the node")
    add_output(command, "the rosbag2 folder to write")
    add_config(command, "parameters of the node, or the fields of one unit")
    command.add_argument("--force", action="store_true", help="replace a bag that is to be written and exists")
    add_inputs(command)
    add_vehicle(command)
    add_remap(command)
    add_clock(command)
    jobs.add_arguments(command, "the bags")


def run(options: argparse.Namespace) -> int:
    """Replay the bags; exit status 0, or 2 where one could not be replayed or a wheel has no output."""
    if len(options.input) > 1 or options.jobs is not None or options.scheduler is not None:
        from . import batch

        _say_if_slow()

        return UNUSABLE if batch.run(options) else 0
    from ..replay.bag_setup import joints_of, remaps_of
    from ..replay.replay import replay

    _say_if_slow()
    [source] = options.input
    summary = replay(
        source,
        options.output,
        config=options.config,
        inputs=options.inputs,
        vehicle=options.vehicle,
        force=options.force,
        quiet=options.quiet,
        remaps=remaps_of(options.remap),
        joints=joints_of(options.joint),
        clock=options.clock,
    )
    if summary.damage:
        print(one_line(f"{source} is damaged: {summary.damage}; what stands before was replayed"), file=sys.stderr)
    for wheel, reason in summary.without.items():
        print(one_line(f"{wheel}: no output; {reason}"), file=sys.stderr)
    for doubt in summary.doubts:
        print(one_line(f"doubtful: {doubt}"), file=sys.stderr)
    total = sum(summary.received.values())
    written = sum(summary.written.values())
    content = {"input": source, "output": options.output, **summary._asdict()}
    answer(options, content, f"{options.output}: {total} messages in, {written} out")
    return UNUSABLE if summary.without else 0


def _say_if_slow() -> None:
    """One line where the core runs interpreted, for what takes much longer then."""
    from ..build_state import how_to_compile, is_compiled

    if not is_compiled():
        print(f"tire-dynamics: {how_to_compile()}", file=sys.stderr)
