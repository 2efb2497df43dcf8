"""Many messages at a time, as columns of numbers.

They give exactly what one message at a time gives. Messages are ``data[start[i] : start[i] + size[i]]``; those of one
layout, which is nearly always all of them, are read together. What is not such a message is marked, not raised.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .primitives import BODY, SECOND, MessageError, sec_nanosec

__all__ = [
    "Range",
    "by_layout",
    "columns_at",
    "encoded",
    "rows_of",
    "stamps_of",
    "time_columns",
    "unread",
]

_LAYOUTS = 8  # of the messages of one call, before the rest is taken one by one

Range = tuple[int, int]
_Layout = TypeVar("_Layout")


def by_layout(
    data: bytes,
    start: NDArray[np.int64],
    size: NDArray[np.int64],
    layout_of: Callable[[bytes], tuple[_Layout, list[Range]]],
) -> Iterator[tuple[NDArray[np.int64], _Layout]]:
    """The indices of messages of one layout, and the layout; those for which ``layout_of`` raises are left out.

    ``layout_of`` also gives the bytes that fix the layout: messages of equal size and byte order with the same
    bytes there have the same layout.
    """
    rest = np.arange(len(start))
    left = _LAYOUTS
    while len(rest):
        begin, length = int(start[rest[0]]), int(size[rest[0]])
        message = data[begin : begin + length]
        try:
            layout, fixed = layout_of(message)
        except MessageError:
            rest = rest[1:]
            continue
        if left:
            left -= 1
            same = size[rest] == length
            for first, end in ((0, 2), *fixed):
                octets = columns_at(data, start[rest[same]] + first, end - first, "u1")
                same[same] = (octets == np.frombuffer(message[first:end], np.uint8)).all(axis=1)
            yield rest[same], layout
            rest = rest[~same]
        else:
            yield rest[:1], layout
            rest = rest[1:]


def columns_at(data: bytes, at: NDArray[np.int64], count: int, dtype: str) -> NDArray[Any]:
    """``count`` numbers at each of some positions, known to fit: (len(at), count)."""
    width = count * np.dtype(dtype).itemsize
    if not width:
        return np.empty((len(at), 0), dtype)
    everywhere = np.ndarray(len(data) - width + 1, f"V{width}", data, strides=(1,))
    return everywhere[at].view(dtype).reshape(len(at), count)


def unread(count: int) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Of messages of which none is read yet: whether each is valid, and its time."""
    return np.zeros(count, np.bool_), np.zeros(count, np.int64)


def stamps_of(data: bytes, start: NDArray[np.int64], order: str) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Whether the times at the beginning of messages are valid, and the times, 0 if not."""
    sec = columns_at(data, start + BODY, 1, order + "i4")[:, 0].astype(np.int64)
    nanosec = columns_at(data, start + BODY + 4, 1, order + "u4")[:, 0].astype(np.int64)
    valid = nanosec < SECOND
    return valid, np.where(valid, sec * SECOND + nanosec, 0)


def encoded(message: bytes, count: int, *columns: tuple[int, str, ArrayLike]) -> list[bytes]:
    """A message ``count`` times, each with its own values in the columns: position, dtype, values (count, ...)."""
    if not count:
        return []
    rows = np.frombuffer(bytearray(message * count), np.uint8).reshape(count, len(message))
    for position, dtype, values in columns:
        octets = np.ascontiguousarray(values, dtype).reshape(count, -1).view(np.uint8)
        rows[:, position : position + octets.shape[1]] = octets
    return rows_of(rows)


def rows_of(values: NDArray[Any]) -> list[bytes]:
    """The bytes of each of the arrays that an array (N, ...) holds, N > 0."""
    flat = np.ascontiguousarray(values).reshape(len(values), -1)
    rows: list[bytes] = flat.view(f"V{flat[0].nbytes}")[:, 0].tolist()
    return rows


def time_columns(stamps: ArrayLike) -> list[tuple[int, str, NDArray[np.int64]]]:
    """The columns of a stamp at the beginning of the body."""
    sec, nanosec = np.divmod(np.asarray(stamps, np.int64), SECOND)
    for wrong in np.flatnonzero((sec < -0x80000000) | (sec > 0x7FFFFFFF))[:1]:
        sec_nanosec(int(np.asarray(stamps)[wrong]))
    return [(BODY, "<i4", sec), (BODY + 4, "<u4", nanosec)]
