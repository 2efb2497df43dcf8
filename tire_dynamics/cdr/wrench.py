"""geometry_msgs/WrenchStamped, and the covariance of a wrench as std_msgs/Float64MultiArray."""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .blocks import Range, by_layout, columns_at, encoded, stamps_of, time_columns, unread
from .primitives import (
    BODY,
    LITTLE_ENDIAN,
    VECTOR,
    MessageError,
    aligned,
    byte_order,
    encoded_string,
    header_layout,
    header_of,
    sec_nanosec,
    stamp_of,
)

__all__ = [
    "CovarianceEncoder",
    "WrenchDecoder",
    "WrenchEncoder",
    "WrenchStamped",
    "decode_wrench",
    "decode_wrenches",
]


class WrenchStamped(NamedTuple):
    """What the estimator needs of geometry_msgs/WrenchStamped: the force, N."""

    stamp_ns: int
    frame_id: str
    fx: float
    fy: float
    fz: float


def decode_wrench(data: bytes) -> WrenchStamped:
    """Decode geometry_msgs/WrenchStamped.

    Parameters
    ----------
    data : bytes
        The serialised message with its encapsulation header.

    Returns
    -------
    WrenchStamped

    Raises
    ------
    MessageError
        If the bytes are not such a message.
    """
    order = byte_order(data)
    stamp_ns, frame_id, position = header_of(data, order)
    position = aligned(position, 8)
    if position + 48 > len(data):  # force and torque
        raise MessageError("ends before wrench.torque.z")
    return WrenchStamped(stamp_ns, frame_id, *VECTOR[order].unpack_from(data, position))


class WrenchDecoder:
    """Decodes geometry_msgs/WrenchStamped as :func:`decode_wrench` does.

    A publisher sends the same frame_id every time: its bytes are kept from one message to the next, and parsed only
    when they differ.
    """

    def __init__(self) -> None:
        self._layout = struct.Struct("")
        self._encapsulation, self._frame, self._frame_id = b"", b"", ""
        self._end = self._position = 0  # of frame_id; of the force, behind its padding

    def decode(self, data: bytes) -> WrenchStamped:
        """Decode one message; ``MessageError`` if the bytes are not such a message."""
        known = data[BODY + 8 : self._end] == self._frame and data[:BODY] == self._encapsulation
        if not known or len(data) < self._position + 48:
            return self._decode_anew(data)
        sec, nanosec, fx, fy, fz = self._layout.unpack_from(data)
        return WrenchStamped(stamp_of(sec, nanosec), self._frame_id, fx, fy, fz)

    def _decode_anew(self, data: bytes) -> WrenchStamped:
        wrench = decode_wrench(data)
        order = byte_order(data)
        self._end = header_of(data, order)[2]
        self._position = aligned(self._end, 8)
        self._layout = struct.Struct(f"{order}4xiI{self._position - BODY - 8}x3d")
        self._encapsulation, self._frame, self._frame_id = data[:BODY], data[BODY + 8 : self._end], wrench.frame_id
        return wrench


def decode_wrenches(
    data: bytes, start: NDArray[np.int64], size: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Decode many geometry_msgs/WrenchStamped.

    Parameters
    ----------
    data : bytes
    start, size : (N,) ndarray of int
        Where in ``data`` the messages are.

    Returns
    -------
    valid : (N,) ndarray of bool
        False where ``decode_wrench`` raises ``MessageError``.
    stamp_ns : (N,) ndarray of int
        0 where not valid.
    fx, fz : (N,) ndarray
        Force [N]; NaN where not valid.
    """
    force = np.full((len(start), 3), np.nan)

    def layout(message: bytes) -> tuple[tuple[str, int], list[Range]]:
        decode_wrench(message)
        order = byte_order(message)
        _, _, position = header_of(message, order)
        return (order, aligned(position, 8)), [(BODY + 8, position)]

    valid, stamp_ns = unread(len(start))
    for some, (order, position) in by_layout(data, start, size, layout):
        valid[some], stamp_ns[some] = stamps_of(data, start[some], order)
        force[some] = columns_at(data, start[some] + position, 3, order + "f8")
    force[~valid] = np.nan
    return valid, stamp_ns, force[:, 0], force[:, 2]


class WrenchEncoder:
    """Encodes geometry_msgs/WrenchStamped: a force in the x-z plane, and no torque.

    Parameters
    ----------
    frame_id : str
        Its length fixes the layout.
    """

    def __init__(self, frame_id: str) -> None:
        header, self._frame, position = header_layout(frame_id)
        self._layout = struct.Struct(f"{header}{-position % 8}x6d")

    def encode(self, stamp_ns: int, fx: float, fz: float) -> bytes:
        """One message with the force (fx, 0, fz) [N]; ``MessageError`` if the stamp is outside ROS time."""
        return self._layout.pack(LITTLE_ENDIAN, *sec_nanosec(stamp_ns), *self._frame, fx, 0.0, fz, 0.0, 0.0, 0.0)

    def encode_block(self, stamps: ArrayLike, fx: ArrayLike, fz: ArrayLike) -> list[bytes]:
        """Many messages: stamps [ns] and forces [N], all (N,)."""
        count, force = np.size(stamps), self._layout.size - 48
        x, z = np.broadcast_to(fx, count), np.broadcast_to(fz, count)
        columns = (*time_columns(stamps), (force, "<f8", x), (force + 16, "<f8", z))
        return encoded(self.encode(0, 0.0, 0.0), count, *columns)


class CovarianceEncoder:
    """Encodes the covariance of a wrench as std_msgs/Float64MultiArray, dims ``row`` (6) x ``column`` (6).

    The order is that of ROS's covariances: force x y z, torque x y z.
    """

    def __init__(self) -> None:
        body = struct.pack("<I", 2)
        for label, size, stride in (("row", 6, 36), ("column", 6, 6)):
            body += encoded_string(label, len(body))
            body += bytes(-len(body) % 4) + struct.pack("<2I", size, stride)
        body += struct.pack("<2I", 0, 36)  # data_offset; length of data
        self._head = LITTLE_ENDIAN + body + bytes(-len(body) % 8)

    def encode(self, covariance: ArrayLike) -> bytes:
        """One message, of a covariance (6, 6) [N^2, N^2 m, N^2 m^2]."""
        values = np.asarray(covariance, "<f8")
        if values.shape != (6, 6):
            raise ValueError(f"covariance: shape {values.shape}, must be (6, 6)")
        return self._head + values.tobytes()
