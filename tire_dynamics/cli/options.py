"""Options that several commands have."""

from __future__ import annotations

import argparse

__all__ = ["A_BAG", "add_clock", "add_config", "add_inputs", "add_joint", "add_output", "add_remap"]

A_BAG = "a rosbag2 folder, or a .mcap, .db3 or ROS 1 .bag file"  # in help


def add_output(command: argparse.ArgumentParser, help: str) -> None:
    """``--output``, which must be given."""
    command.add_argument("-o", "--output", metavar="OUT", required=True, help=help)


def add_config(command: argparse.ArgumentParser, help: str) -> None:
    """``--config``: parameters of the node, or a unit."""
    command.add_argument("--config", metavar="YAML", help=help)


def add_inputs(command: argparse.ArgumentParser) -> None:
    """``--inputs``: a field map."""
    command.add_argument(
        "--inputs", metavar="YAML", help="a field map: which field of which message is which input; see config/inputs"
    )


def add_remap(command: argparse.ArgumentParser) -> None:
    """``--remap`` and ``--joint``: where a bag has an input under another name."""
    command.add_argument(
        "--remap",
        metavar="INPUT:=TOPIC",
        action="append",
        default=[],
        help="take the input from this topic of the bag, as in front_left/load:=/fl/force_torque; may be repeated",
    )
    add_joint(command)


def add_joint(command: argparse.ArgumentParser) -> None:
    """``--joint``: a wheel's joint under another name."""
    command.add_argument(
        "--joint",
        metavar="WHEEL:=NAME",
        action="append",
        default=[],
        help="take the wheel's speed from this joint of joint_states, as in front_left:=fl_joint; may be repeated",
    )


def add_clock(command: argparse.ArgumentParser) -> None:
    """``--clock``: of two times that a message has, the one that counts."""
    command.add_argument(
        "--clock",
        choices=("stamp", "log"),
        help="one clock where stamps and times of receipt have two: that of the stamps, as of simulated time, or that "
        "of the receipt",
    )
