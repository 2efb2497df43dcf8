"""Options that several commands have."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path

from ..files.errors import InputError
from ..files.outputs import writable

__all__ = [
    "A_BAG",
    "add_clock",
    "add_config",
    "add_inputs",
    "add_joint",
    "add_output",
    "add_picture",
    "add_remap",
    "need_matplotlib",
    "picture_and_numbers",
    "picture_file",
]

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


def add_vehicle(command: argparse.ArgumentParser) -> None:
    """``--vehicle``: a car, whose loads are estimated."""
    command.add_argument("--vehicle", metavar="YAML", help="a car, whose loads are estimated; see config/car.yaml")


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


def add_picture(command: argparse.ArgumentParser) -> None:
    """``--output`` and ``--force`` of a picture with its numbers beside it."""
    command.add_argument("-o", "--output", metavar="PNG", help="the picture to write; needed unless --json is given")
    command.add_argument("--force", action="store_true", help="replace the two files if they exist")


def need_matplotlib(needs: str = "the picture needs", otherwise: str = "") -> None:
    """``InputError`` if matplotlib is not installed: what needs it, and what does without."""
    if find_spec("matplotlib") is None:
        raise InputError(f"{needs} matplotlib: pip install 'tire_dynamics[plot]'{otherwise and '; ' + otherwise}")


def picture_file(value: str, option: str = "--output", needs: str = "the picture needs", otherwise: str = "") -> Path:
    """The file that an option names; ``InputError`` if it is no .png, or matplotlib is missing."""
    if Path(value).suffix.lower() != ".png":
        raise InputError(f"{option} is {value}; its name must end in .png")
    need_matplotlib(needs, otherwise)
    return Path(value)


def picture_and_numbers(
    value: str, suffix: str, *, force: bool, needs: str = "the picture needs", otherwise: str = ""
) -> tuple[Path, Path]:
    """A picture and the file of its numbers beside it; ``InputError`` if one of them cannot be written."""
    picture = picture_file(value, needs=needs, otherwise=otherwise)
    return writable(picture, force=force), writable(picture.with_suffix(suffix), force=force)
