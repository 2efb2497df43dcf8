"""A belt's deflection as std_msgs/Float64MultiArray, and its shape as sensor_msgs/PointCloud2."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .blocks import encoded, rows_of, time_columns
from .primitives import (
    BODY,
    LITTLE_ENDIAN,
    MessageError,
    aligned,
    byte_order,
    doubles_at,
    encoded_string,
    header_layout,
    length_at,
    sec_nanosec,
    string_at,
)

__all__ = [
    "DeflectionEncoder",
    "RingShapeEncoder",
    "decode_multi_array",
    "ring_points",
]


class DeflectionEncoder:
    """Encodes a ring's deflection as std_msgs/Float64MultiArray, dims ``component`` (2) x ``angle`` (P).

    Parameters
    ----------
    points : int
        P, the number of angles psi_j = 2 pi j / P.
    """

    def __init__(self, points: int) -> None:
        self._shape = (2, points)
        body = struct.pack("<I", 2)
        for label, size, stride in (("component", 2, 2 * points), ("angle", points, points)):
            body += encoded_string(label, len(body))
            body += bytes(-len(body) % 4) + struct.pack("<2I", size, stride)
        body += struct.pack("<2I", 0, 2 * points)  # data_offset; length of data
        self._head = LITTLE_ENDIAN + body + bytes(-len(body) % 8)

    def encode(self, deflection: ArrayLike) -> bytes:
        """One message.

        Parameters
        ----------
        deflection : (2, P) array_like
            Radial (outward) and tangential (along psi) deflection [m].

        Returns
        -------
        bytes
        """
        values = np.asarray(deflection, "<f8")
        if values.shape != self._shape:
            raise ValueError(f"deflection: shape {values.shape}, must be {self._shape}")
        return self._head + values.tobytes()

    def encode_block(self, deflections: ArrayLike) -> list[bytes]:
        """Many messages, of deflections (N, 2, P)."""
        values = np.asarray(deflections, "<f8")
        if values.shape[1:] != self._shape:
            raise ValueError(f"deflections: shape {values.shape}, must be N x {self._shape}")
        return [self._head + row for row in rows_of(values)] if len(values) else []


def decode_multi_array(data: bytes) -> tuple[list[tuple[str, int, int]], NDArray[np.float64]]:
    """Decode std_msgs/Float64MultiArray.

    Parameters
    ----------
    data : bytes
        The serialised message with its encapsulation header.

    Returns
    -------
    dims : list of (label, size, stride)
    values : (N,) ndarray
        All of ``data``, data_offset included; a copy.

    Raises
    ------
    MessageError
        If the bytes are not such a message.
    """
    order = byte_order(data)
    count, position = length_at(data, BODY, order, 12, "layout.dim")  # label, size, stride: at least 12 bytes
    dims = []
    for _ in range(count):
        label, position = string_at(data, position, order, "layout.dim.label")
        position = aligned(position, 4)
        if position + 8 > len(data):
            raise MessageError("ends before layout.dim.stride")
        dims.append((label, *struct.unpack_from(order + "2I", data, position)))
        position += 8
    position = aligned(position, 4) + 4  # data_offset
    values, _ = doubles_at(data, position, order, "data")
    return dims, np.array(values)


class RingShapeEncoder:
    """Encodes the deformed belt as sensor_msgs/PointCloud2: one row of P points, all fields float32.

    Parameters
    ----------
    frame_id : str
        The axle's frame.
    points : int
        P, the number of points along the belt.
    """

    FIELDS = ("x", "y", "z", "radial", "tangential")

    def __init__(self, frame_id: str, points: int) -> None:
        header, self._frame, start = header_layout(frame_id)
        float32 = 7  # sensor_msgs/PointField.FLOAT32
        step = 4 * len(self.FIELDS)
        block = bytes(-start % 4) + struct.pack("<3I", 1, points, len(self.FIELDS))  # height, width
        for number, name in enumerate(self.FIELDS):
            block += encoded_string(name, start + len(block))
            block += bytes(-(start + len(block)) % 4) + struct.pack("<IB3xI", 4 * number, float32, 1)
        # is_bigendian false, then the steps and the length of data
        block += struct.pack("<B3x3I", 0, step, step * points, step * points)
        self._block = block
        self._shape = (points, len(self.FIELDS))
        self._layout = struct.Struct(f"{header}{len(block)}s{step * points}s?")

    def encode(self, stamp_ns: int, shape: ArrayLike) -> bytes:
        """One message.

        Parameters
        ----------
        stamp_ns : int
        shape : (P, 5) array_like
            Columns as in ``FIELDS``: position in the axle's frame, radial and tangential deflection [m].

        Returns
        -------
        bytes

        Raises
        ------
        MessageError
            If the stamp is outside ROS time.
        """
        values = np.asarray(shape, "<f4")
        if values.shape != self._shape:
            raise ValueError(f"shape: shape {values.shape}, must be {self._shape}")
        return self._layout.pack(
            LITTLE_ENDIAN, *sec_nanosec(stamp_ns), *self._frame, self._block, values.tobytes(), True
        )

    def encode_block(self, stamps: ArrayLike, shapes: ArrayLike) -> list[bytes]:
        """Many messages: stamps (N,) [ns] and shapes (N, P, 5)."""
        values = np.asarray(shapes, "<f4")
        if values.shape[1:] != self._shape:
            raise ValueError(f"shapes: shape {values.shape}, must be N x {self._shape}")
        if not len(values):
            return []
        message = self.encode(0, np.zeros(self._shape))
        start, end = len(message) - 1 - values[0].nbytes, message[-1:]
        heads = encoded(message[:start], len(values), *time_columns(stamps))
        return [b"".join((head, row, end)) for head, row in zip(heads, rows_of(values), strict=True)]


def ring_points(data: bytes, points: int) -> NDArray[np.float64]:
    """The columns x, y, z, radial, tangential [m] of a ring_shape that RingShapeEncoder has made, shape (points, 5)."""
    size = 4 * len(RingShapeEncoder.FIELDS)
    values = np.frombuffer(data, "<f4", points * size // 4, len(data) - 1 - points * size)
    return values.reshape(points, -1).astype(np.float64)
