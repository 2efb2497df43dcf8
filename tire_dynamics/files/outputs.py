"""Files that a command writes: refused where something is, and never seen half-written."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import InputError

__all__ = ["aside", "writable"]


def writable(path: Path, *, force: bool) -> Path:
    """The path, if a file may be written there; what cannot be is better known before the work.

    Raises
    ------
    InputError
        There is no such folder, or something is there already and ``force`` is not given or it is no file.
    """
    if not path.parent.is_dir():
        raise InputError(f"{path.parent}: no such folder")
    if os.path.lexists(path):
        if not force:
            raise InputError(f"{path}: exists already (--force replaces it)")
        if not path.is_file():
            raise InputError(f"{path}: exists already and is not a file")
    return path


@contextmanager
def aside(path: Path) -> Iterator[Path]:
    """A name beside ``path`` to write to; it becomes ``path`` if all goes well, and else nothing is left of it."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
