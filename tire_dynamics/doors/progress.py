"""How far long work has come, on a terminal; nothing in a pipe."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

__all__ = ["progress"]

T = TypeVar("T")


def progress(items: Iterable[T], total: int, what: str) -> Iterator[T]:
    """The items, with a line on standard error that says how many of ``total`` have passed."""
    if not sys.stderr.isatty():
        yield from items
        return
    started = shown = time.monotonic()
    count = 0
    for count, item in enumerate(items, start=1):
        yield item
        if count % 1024 == 0 and (now := time.monotonic()) - shown > 0.2:
            shown = now
            share = f"{100.0 * count / total:3.0f} %" if total else f"{count}"
            sys.stderr.write(f"\r{what}: {share}, {count / (now - started):,.0f}/s ")
            sys.stderr.flush()
    seconds = time.monotonic() - started
    sys.stderr.write(f"\r{what}: {count:,} in {seconds:.1f} s\x1b[K\n")
