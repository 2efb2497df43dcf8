"""The command ``tire-dynamics``: from arguments to an exit status, as ``usage.EXIT_STATUS`` says."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence

from ..files.errors import InputError
from . import node as node_command
from .answer import one_line
from .commands import all_commands
from .usage import UNUSABLE

__all__ = ["main", "node"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit status, as ``EXIT_STATUS`` says."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    try:
        if arguments[:1] == ["node"]:
            return node_command.run(arguments[1:])  # everything behind it is for ROS
        options = all_commands().parse(arguments)
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
    print(f"tire-dynamics: {one_line(str(error))}", file=sys.stderr)
    return UNUSABLE


if __name__ == "__main__":
    sys.exit(main())
