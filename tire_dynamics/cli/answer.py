"""What a command says at its end: lines for a reader, or one JSON object for a program."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping
from typing import Any

__all__ = ["add_arguments", "answer", "one_line", "plain", "printable"]

_MAX_LINE = 2000  # characters of an error: a stranger's file may have a million topics to list


def add_arguments(parser: argparse.ArgumentParser, *, quiet: bool = True) -> None:
    """Declare ``--json``, and ``--quiet`` of a command that shows how far it is or what it made."""
    parser.add_argument("--json", action="store_true", help="say the result as one JSON object on standard output")
    if quiet:
        parser.add_argument("-q", "--quiet", action="store_true", help="no progress and no summary; errors remain")


def answer(options: argparse.Namespace, content: Mapping[str, Any], *lines: str) -> None:
    """Say what was done.

    Parameters
    ----------
    options : argparse.Namespace
        Of a parser that ``add_arguments`` has seen.
    content : mapping
        What ``--json`` prints on standard output, and nothing else is printed there. A number that is not finite is
        null: JSON has none.
    lines : str
        What is printed on standard error without ``--json`` and ``--quiet``.
    """
    if options.json:
        print(json.dumps(plain(content), indent=2, allow_nan=False))
    elif not options.quiet:
        for line in lines:
            print(printable(line), file=sys.stderr)


def printable(text: str) -> str:
    """A text as one line of what a terminal can show; names in it may be a stranger's."""
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def one_line(text: str) -> str:
    """A text of any kind as one such line, not endless."""
    text = " ".join(text.split())
    return printable(text if len(text) <= _MAX_LINE else f"{text[:_MAX_LINE]} ...")


def plain(value: Any) -> Any:
    """A value as JSON has it: lists for tuples, null for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
