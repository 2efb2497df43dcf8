"""The layouts of the ROS messages of this package as CDR bytes; the one place that knows them, with no ROS.

A serialised message is a 4-byte encapsulation header and a body in which every primitive is aligned to its
own size, counted from the start of the body (OMG CDR, "XCDR1", which every ROS 2 middleware reads and
writes). A string is its length with the closing NUL as uint32, then the characters and the NUL; a sequence
is its length as uint32, then its elements.

Encoders fix everything that stays the same from one message to the next when they are made, write little-
endian and zero the padding, so that equal values are equal bytes. Decoders take either byte order, check
every length against the bytes that are there before they use it, and raise ``MessageError`` where the two
disagree.

Stamps are integer nanoseconds; forces N, torques N m, angular speeds rad/s.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "CLOCK",
    "FLOAT64",
    "FLOAT64_MULTI_ARRAY",
    "JOINT_STATE",
    "POINT_CLOUD",
    "STRING",
    "WRENCH_STAMPED",
    "DeflectionEncoder",
    "JointState",
    "JointStateDecoder",
    "JointStateEncoder",
    "MessageError",
    "RingShapeEncoder",
    "WrenchEncoder",
    "WrenchStamped",
    "decode_clock",
    "decode_float64",
    "decode_multi_array",
    "decode_string",
    "decode_wrench",
    "encode_clock",
    "encode_float64",
    "encode_string",
]

CLOCK = "rosgraph_msgs/msg/Clock"
FLOAT64 = "std_msgs/msg/Float64"
FLOAT64_MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
JOINT_STATE = "sensor_msgs/msg/JointState"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
STRING = "std_msgs/msg/String"
WRENCH_STAMPED = "geometry_msgs/msg/WrenchStamped"

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_BYTE_ORDER = {_LITTLE_ENDIAN[:2]: "<", b"\x00\x00": ">"}
_BODY = 4  # the body, and with it all alignment, starts after the encapsulation header
_SECOND = 1_000_000_000  # ns

# Prebuilt for both byte orders: ``struct.unpack_from`` with a format string is slower by half.
_UINT32 = {order: struct.Struct(order + "I") for order in "<>"}
_TIME = {order: struct.Struct(order + "iI") for order in "<>"}
_DOUBLE = {order: struct.Struct(order + "d") for order in "<>"}
_VECTOR = {order: struct.Struct(order + "3d") for order in "<>"}


class MessageError(ValueError):
    """Bytes that are not the message they are said to be, or a value that the message cannot hold."""


class JointState(NamedTuple):
    """What the estimator needs of sensor_msgs/JointState; the lengths may differ, as in the message."""

    stamp_ns: int
    names: tuple[str, ...]
    positions: tuple[float, ...]
    velocities: tuple[float, ...]


class WrenchStamped(NamedTuple):
    """What the estimator needs of geometry_msgs/WrenchStamped: the force, N."""

    stamp_ns: int
    frame_id: str
    fx: float
    fy: float
    fz: float


def _byte_order(data: bytes) -> str:
    order = _BYTE_ORDER.get(bytes(data[:2]))
    if order is None or len(data) < _BODY:
        raise MessageError(f"not plain CDR: it begins with {bytes(data[:_BODY]).hex(' ') or 'nothing'}")
    return order


def _aligned(position: int, size: int) -> int:
    return position + (_BODY - position) % size


def _stamp(sec: int, nanosec: int) -> int:
    if nanosec >= _SECOND:
        raise MessageError(f"stamp: nanosec is {nanosec}, must be below {_SECOND}")
    return sec * _SECOND + nanosec


def _sec_nanosec(stamp_ns: int) -> tuple[int, int]:
    """The fields of builtin_interfaces/Time; before the epoch sec is negative, nanosec never."""
    sec, nanosec = divmod(stamp_ns, _SECOND)
    if not -0x80000000 <= sec <= 0x7FFFFFFF:
        raise MessageError(f"stamp: {stamp_ns} ns is outside the range of ROS time")
    return sec, nanosec


def _length(data: bytes, position: int, order: str, element: int, what: str) -> tuple[int, int]:
    """Length of the string or sequence at ``position``, known to fit, and where its elements start."""
    position = _aligned(position, 4)
    if position + 4 > len(data):
        raise MessageError(f"ends before {what}")
    (count,) = _UINT32[order].unpack_from(data, position)
    position += 4
    if count * element > len(data) - position:
        raise MessageError(f"{what}: {count} elements do not fit in the {len(data) - position} bytes left")
    return count, position


def _string(data: bytes, position: int, order: str, what: str) -> tuple[str, int]:
    count, position = _length(data, position, order, 1, what)
    end = position + count
    if count and data[end - 1]:
        raise MessageError(f"{what}: a string without its closing NUL")
    try:
        return str(data[position : end - 1] if count else b"", "utf-8"), end
    except UnicodeDecodeError:
        raise MessageError(f"{what}: not UTF-8") from None


def _doubles(data: bytes, position: int, order: str, what: str) -> tuple[tuple[float, ...], int]:
    count, position = _length(data, position, order, 8, what)
    if not count:  # an empty sequence has no first element to align
        return (), position
    position = _aligned(position, 8)
    end = position + 8 * count
    if end > len(data):
        raise MessageError(f"{what}: {count} elements do not fit in the {len(data) - position} bytes left")
    return struct.unpack_from(f"{order}{count}d", data, position), end


def _header(data: bytes, order: str) -> tuple[int, str, int]:
    """std_msgs/Header at the start of the body: stamp, frame_id, and the position behind it."""
    if len(data) < _BODY + 8:
        raise MessageError("ends before header.stamp")
    sec, nanosec = _TIME[order].unpack_from(data, _BODY)
    frame_id, position = _string(data, _BODY + 8, order, "header.frame_id")
    return _stamp(sec, nanosec), frame_id, position


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
    order = _byte_order(data)
    stamp_ns, frame_id, position = _header(data, order)
    position = _aligned(position, 8)
    if position + 48 > len(data):  # force and torque
        raise MessageError("ends before wrench.torque.z")
    return WrenchStamped(stamp_ns, frame_id, *_VECTOR[order].unpack_from(data, position))


class JointStateDecoder:
    """Decodes sensor_msgs/JointState.

    A publisher sends the same names every time, and they are most of the work: the bytes of frame_id and
    names are kept from one message to the next, and parsed only when they differ.
    """

    def __init__(self) -> None:
        self._known: tuple[str, bytes, int, tuple[str, ...]] = ("", b"", 0, ())

    def decode(self, data: bytes) -> JointState:
        """Decode one message.

        Parameters
        ----------
        data : bytes
            The serialised message with its encapsulation header.

        Returns
        -------
        JointState

        Raises
        ------
        MessageError
            If the bytes are not such a message.
        """
        order = _byte_order(data)
        if len(data) < _BODY + 8:
            raise MessageError("ends before header.stamp")
        sec, nanosec = _TIME[order].unpack_from(data, _BODY)
        known_order, block, position, names = self._known
        if order != known_order or data[_BODY + 8 : position] != block:
            names, position = self._names(data, order)
        positions, end = _doubles(data, position, order, "position")
        velocities, end = _doubles(data, end, order, "velocity")
        _length(data, end, order, 8, "effort")
        return JointState(_stamp(sec, nanosec), names, positions, velocities)

    def _names(self, data: bytes, order: str) -> tuple[tuple[str, ...], int]:
        _, position = _string(data, _BODY + 8, order, "header.frame_id")
        count, position = _length(data, position, order, 4, "name")  # an empty string takes 4 bytes
        names = []
        for _ in range(count):
            name, position = _string(data, position, order, "name")
            names.append(name)
        self._known = order, bytes(data[_BODY + 8 : position]), position, tuple(names)
        return tuple(names), position


def decode_float64(data: bytes) -> float:
    """Decode std_msgs/Float64; ``MessageError`` if the bytes are not such a message."""
    order = _byte_order(data)
    if len(data) < _BODY + 8:
        raise MessageError("ends before data")
    value: float = _DOUBLE[order].unpack_from(data, _BODY)[0]
    return value


def decode_clock(data: bytes) -> int:
    """Decode rosgraph_msgs/Clock to its time in ns; ``MessageError`` if the bytes are not such a message."""
    order = _byte_order(data)
    if len(data) < _BODY + 8:
        raise MessageError("ends before clock")
    return _stamp(*_TIME[order].unpack_from(data, _BODY))


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
    order = _byte_order(data)
    count, position = _length(data, _BODY, order, 12, "layout.dim")  # label, size, stride: at least 12 bytes
    dims = []
    for _ in range(count):
        label, position = _string(data, position, order, "layout.dim.label")
        position = _aligned(position, 4)
        if position + 8 > len(data):
            raise MessageError("ends before layout.dim.stride")
        dims.append((label, *struct.unpack_from(order + "2I", data, position)))
        position += 8
    position = _aligned(position, 4) + 4  # data_offset
    values, _ = _doubles(data, position, order, "data")
    return dims, np.array(values)


def _header_layout(frame_id: str) -> tuple[str, tuple[int, bytes], int]:
    """Format of the encapsulation and a header, the values behind the stamp, the body position after."""
    raw = frame_id.encode() + b"\0"
    return f"<4siII{len(raw)}s", (len(raw), raw), 12 + len(raw)


def _encoded_string(text: str, position: int) -> bytes:
    """A string at a body position, with the padding before it."""
    raw = text.encode() + b"\0"
    return bytes(-position % 4) + struct.pack("<I", len(raw)) + raw


class WrenchEncoder:
    """Encodes geometry_msgs/WrenchStamped: a force in the x-z plane, and no torque.

    Parameters
    ----------
    frame_id : str
        Its length fixes the layout.
    """

    def __init__(self, frame_id: str) -> None:
        header, self._frame, position = _header_layout(frame_id)
        self._layout = struct.Struct(f"{header}{-position % 8}x6d")

    def encode(self, stamp_ns: int, fx: float, fz: float) -> bytes:
        """One message with the force (fx, 0, fz) [N]; ``MessageError`` if the stamp is outside ROS time."""
        return self._layout.pack(_LITTLE_ENDIAN, *_sec_nanosec(stamp_ns), *self._frame, fx, 0.0, fz, 0.0, 0.0, 0.0)


class JointStateEncoder:
    """Encodes sensor_msgs/JointState with velocities only.

    Parameters
    ----------
    names : sequence of str
        The joints; they fix the layout.
    """

    def __init__(self, names: Sequence[str]) -> None:
        header, self._frame, start = _header_layout("")
        block = bytes(-start % 4) + struct.pack("<I", len(names))
        for name in names:
            block += _encoded_string(name, start + len(block))
        block += bytes(-(start + len(block)) % 4) + struct.pack("<2I", 0, len(names))  # no position; velocity
        if names:
            block += bytes(-(start + len(block)) % 8)
        self._names = block
        self._layout = struct.Struct(f"{header}{len(block)}s{len(names)}d4x")  # 4x: no effort

    def encode(self, stamp_ns: int, velocities: Sequence[float]) -> bytes:
        """One message with the velocities [rad/s]; ``MessageError`` if the stamp is outside ROS time."""
        return self._layout.pack(_LITTLE_ENDIAN, *_sec_nanosec(stamp_ns), *self._frame, self._names, *velocities)


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
            body += _encoded_string(label, len(body))
            body += bytes(-len(body) % 4) + struct.pack("<2I", size, stride)
        body += struct.pack("<2I", 0, 2 * points)  # data_offset; length of data
        self._head = _LITTLE_ENDIAN + body + bytes(-len(body) % 8)

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
        header, self._frame, start = _header_layout(frame_id)
        float32 = 7  # sensor_msgs/PointField.FLOAT32
        step = 4 * len(self.FIELDS)
        block = bytes(-start % 4) + struct.pack("<3I", 1, points, len(self.FIELDS))  # height, width
        for number, name in enumerate(self.FIELDS):
            block += _encoded_string(name, start + len(block))
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
            _LITTLE_ENDIAN, *_sec_nanosec(stamp_ns), *self._frame, self._block, values.tobytes(), True
        )


def encode_float64(value: float) -> bytes:
    """Encode std_msgs/Float64."""
    return struct.pack("<4sd", _LITTLE_ENDIAN, value)


def encode_clock(stamp_ns: int) -> bytes:
    """Encode rosgraph_msgs/Clock; ``MessageError`` if the time is outside ROS time."""
    return struct.pack("<4siI", _LITTLE_ENDIAN, *_sec_nanosec(stamp_ns))


def encode_string(text: str) -> bytes:
    """Encode std_msgs/String."""
    return _LITTLE_ENDIAN + _encoded_string(text, 0)


def decode_string(data: bytes) -> str:
    """Decode std_msgs/String; ``MessageError`` if the bytes are not such a message."""
    return _string(data, _BODY, _byte_order(data), "data")[0]
