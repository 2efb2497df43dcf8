"""How far long work has come, on a terminal; nothing in a pipe."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

__all__ = ["progress"]

T = TypeVar("T")


def progress(items: Iterable[T], total: int, what: str, size: Callable[[T], int] = lambda item: 1) -> Iterator[T]:
    """The items, with a line on standard error that says how many of ``total`` have passed; ``size`` counts one."""
    if not sys.stderr.isatty():
        yield from items
        return
    started, shown = time.monotonic(), -math.inf
    count = 0
    for item in items:
        yield item
        count += size(item)
        if (now := time.monotonic()) - shown > 0.2:
            shown = now
            share = f"{100.0 * count / total:3.0f} %" if total else f"{count}"
            sys.stderr.write(f"\r{what}: {share}, {count / (now - started):,.0f}/s ")
            sys.stderr.flush()
    seconds = time.monotonic() - started
    sys.stderr.write(f"\r{what}: {count:,} in {seconds:.1f} s\x1b[K\n")
