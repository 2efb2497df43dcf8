"""``tire-dynamics completion``: the script with which a shell completes the commands."""

from __future__ import annotations

import argparse

from ..files.errors import InputError
from .usage import Commands

__all__ = ["SHELLS", "add_arguments", "run"]

SHELLS = ("bash", "zsh", "fish")
# what stands for a file or a folder
_FILES = ("BAG", "CSV", "DIR", "FILE", "HTML", "IN", "MEASURED", "MODEL", "OUT", "PNG", "TIR", "YAML")


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Declare the options of ``completion``."""
    command.add_argument("shell", metavar="SHELL", choices=SHELLS, help=", ".join(SHELLS))


def run(commands: Commands, options: argparse.Namespace) -> int:
    """Print the script for these commands; exit status 0."""
    try:
        import shtab
    except ImportError:
        raise InputError("completion needs shtab: pip install 'tire_dynamics[completion]'") from None
    if options.shell not in shtab.SUPPORTED_SHELLS:
        raise InputError(f"this shtab knows no {options.shell}: pip install 'shtab>=1.9'")
    commands.commands.help = "what to do"  # what has no help of its own is not completed
    for name, command in commands.commands.choices.items():
        command.description = commands.help[name]  # a line beside its name
        for action in command._actions:
            if action.metavar in _FILES:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(commands.parser, options.shell))
    return 0
