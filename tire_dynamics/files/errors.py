"""The error for input that cannot be used."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["InputError", "first_line", "missing"]


class InputError(Exception):
    """Input that cannot be used: its text is one line that names the input, what is wrong with it and what helps."""


def missing(path: Path) -> InputError:
    """Of a path at which there is nothing, with the name there that comes nearest to it."""
    import difflib

    try:
        names = os.listdir(path.parent)
    except OSError:
        return InputError(f"{path}: does not exist, nor does the folder {path.parent}")
    close = difflib.get_close_matches(path.name, names[:1000], n=1, cutoff=0.75)
    return InputError(f"{path}: does not exist" + (f"; did you mean {path.with_name(close[0])}?" if close else ""))


def first_line(error: BaseException) -> str:
    """The first line of what an error says, or its kind where it says nothing."""
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
