"""Messages of one value: std_msgs/Float64, std_msgs/String, rosgraph_msgs/Clock."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .blocks import Range, by_layout, columns_at, encoded, stamps_of, time_columns, unread
from .primitives import (
    BODY,
    DOUBLE,
    LITTLE_ENDIAN,
    TIME,
    MessageError,
    byte_order,
    encoded_string,
    sec_nanosec,
    stamp_of,
    string_at,
)

__all__ = [
    "decode_clock",
    "decode_clocks",
    "decode_float64",
    "decode_float64s",
    "decode_string",
    "encode_clock",
    "encode_clocks",
    "encode_float64",
    "encode_string",
]

_MAX_STRING = 2**23  # bytes; beyond, what is made of them would take the memory


def encode_float64(value: float) -> bytes:
    """Encode std_msgs/Float64."""
    return struct.pack("<4sd", LITTLE_ENDIAN, value)


def decode_float64(data: bytes) -> float:
    """Decode std_msgs/Float64; ``MessageError`` if the bytes are not such a message."""
    order = byte_order(data)
    if len(data) < BODY + 8:
        raise MessageError("ends before data")
    value: float = DOUBLE[order].unpack_from(data, BODY)[0]
    return value


def decode_float64s(
    data: bytes, start: NDArray[np.int64], size: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Decode many std_msgs/Float64, as ``decode_wrenches`` does: valid, and the values, NaN where not valid."""
    valid, _ = unread(len(start))
    values = np.full(len(start), np.nan)

    def layout(message: bytes) -> tuple[str, list[Range]]:
        decode_float64(message)
        return byte_order(message), []

    for some, order in by_layout(data, start, size, layout):
        valid[some] = True
        values[some] = columns_at(data, start[some] + BODY, 1, order + "f8")[:, 0]
    return valid, values


def encode_clock(stamp_ns: int) -> bytes:
    """Encode rosgraph_msgs/Clock; ``MessageError`` if the time is outside ROS time."""
    return struct.pack("<4siI", LITTLE_ENDIAN, *sec_nanosec(stamp_ns))


def encode_clocks(stamps: ArrayLike) -> list[bytes]:
    """Encode many rosgraph_msgs/Clock, of times (N,) [ns]."""
    return encoded(encode_clock(0), np.size(stamps), *time_columns(stamps))


def decode_clock(data: bytes) -> int:
    """Decode rosgraph_msgs/Clock to its time in ns; ``MessageError`` if the bytes are not such a message."""
    order = byte_order(data)
    if len(data) < BODY + 8:
        raise MessageError("ends before clock")
    return stamp_of(*TIME[order].unpack_from(data, BODY))


def decode_clocks(
    data: bytes, start: NDArray[np.int64], size: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Decode many rosgraph_msgs/Clock, as ``decode_wrenches`` does: valid, and the times in ns, 0 where not valid."""
    valid, stamp_ns = unread(len(start))

    def layout(message: bytes) -> tuple[str, list[Range]]:
        decode_clock(message)
        return byte_order(message), []

    for some, order in by_layout(data, start, size, layout):
        valid[some], stamp_ns[some] = stamps_of(data, start[some], order)
    return valid, stamp_ns


def encode_string(text: str) -> bytes:
    """Encode std_msgs/String."""
    return LITTLE_ENDIAN + encoded_string(text, 0)


def decode_string(data: bytes) -> str:
    """Decode std_msgs/String; ``MessageError`` if the bytes are not such a message."""
    if len(data) > _MAX_STRING:
        raise MessageError(f"{len(data)} bytes are more than any text here takes")
    return string_at(data, BODY, byte_order(data), "data")[0]
