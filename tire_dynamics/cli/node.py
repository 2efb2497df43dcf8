"""``tire-dynamics node``: the live node."""

from __future__ import annotations

import os

from ..files.errors import InputError
from .usage import EXIT_STATUS, examples_text

__all__ = ["NODE_EXAMPLES", "need_ros", "run"]

NODE_EXAMPLES = (
    ("node --ros-args --params-file config/vehicle.yaml", "a car with four wheels"),
    ("node --ros-args -p rate_hz:=1000.0 -r wheel/load:=/sensors/load", "other values and topics"),
    ("node --ros-args -p log.directory:=/tmp/logs", "with a log, which replay gives again bit for bit"),
)


def run(arguments: list[str]) -> int:
    """Run the node with ROS's arguments, until a signal ends it; or print its help."""
    if arguments in (["-h"], ["--help"]):
        print("usage: tire-dynamics node [--ros-args -p NAME:=VALUE --params-file YAML -r FROM:=TO ...]\n")
        print("The live node, until SIGINT or SIGTERM. Its parameters:\n")
        from ..replay.parameters import PARAMETERS

        for row in PARAMETERS:
            default = list(row.default) if isinstance(row.default, tuple) else row.default
            print(f"  {row.name:30} {row.kind:9} {default!s:12} {row.description}")
        print(f"\n{examples_text(NODE_EXAMPLES)}\n\n{EXIT_STATUS}")
        return 0
    need_ros()
    # Matrices here are small: more threads would only take the core from the one that ticks. Before NumPy is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from ..ros.start import start

    start(arguments)
    return 0


def need_ros() -> None:
    """``InputError`` where ROS is not there."""
    from importlib.util import find_spec

    if find_spec("rclpy") is None:
        raise InputError(
            "this needs rclpy: source a ROS 2 installation, or pip install 'tire_dynamics[ros]' (Linux, x86-64)"
        )
