"""The layouts of the ROS messages of this package as CDR bytes; the one place that knows them, with no ROS.

A serialised message is a 4-byte encapsulation header and a body in which every primitive is aligned to its
own size, counted from the start of the body (OMG CDR, "XCDR1", which every ROS 2 middleware reads and
writes). A string is its length with the closing NUL as uint32, then the characters and the NUL; a sequence
is its length as uint32, then its elements.

Encoders fix everything that stays the same from one message to the next when they are made, write little-
endian and zero the padding, so that equal values are equal bytes. Decoders take either byte order, check
every length against the bytes that are there before they use it, and raise ``MessageError`` where the two
disagree.

What goes many at a time (``..._block``, ``decode_clocks`` and the like) gives exactly what one message at a time
gives. Such messages are given as ``data[start[i] : start[i] + size[i]]``; those of one layout, which is nearly
always all of them, are read together as columns of numbers. What is not such a message is marked, not raised.

Stamps are integer nanoseconds; forces N, torques N m, angular speeds rad/s.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "CLOCK",
    "FLOAT64",
    "FLOAT64_MULTI_ARRAY",
    "JOINT_STATE",
    "POINT_CLOUD",
    "STRING",
    "TF",
    "WRENCH_STAMPED",
    "CovarianceEncoder",
    "DeflectionEncoder",
    "JointState",
    "JointStateDecoder",
    "JointStateEncoder",
    "MessageError",
    "RingShapeEncoder",
    "WrenchDecoder",
    "WrenchEncoder",
    "WrenchStamped",
    "check_time",
    "decode_clock",
    "decode_clocks",
    "decode_float64",
    "decode_float64s",
    "decode_multi_array",
    "decode_string",
    "decode_wrench",
    "decode_wrenches",
    "encode_clock",
    "encode_clocks",
    "encode_float64",
    "encode_static_transforms",
    "encode_string",
    "joint_names",
    "ring_points",
]

CLOCK = "rosgraph_msgs/msg/Clock"
FLOAT64 = "std_msgs/msg/Float64"
FLOAT64_MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
JOINT_STATE = "sensor_msgs/msg/JointState"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
STRING = "std_msgs/msg/String"
TF = "tf2_msgs/msg/TFMessage"
WRENCH_STAMPED = "geometry_msgs/msg/WrenchStamped"

LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_BYTE_ORDER = {LITTLE_ENDIAN[:2]: "<", b"\x00\x00": ">"}
BODY = 4  # the body, and with it all alignment, starts after the encapsulation header
_SECOND = 1_000_000_000  # ns
_MAX_JOINT_STATE, _MAX_STRING = 2**20, 2**23  # bytes; beyond, what is made of them would take the memory
_LAYOUTS = 8  # of the messages of one call, before the rest is taken one by one

# Prebuilt for both byte orders: ``struct.unpack_from`` with a format string is slower by half.
_UINT32 = {order: struct.Struct(order + "I") for order in "<>"}
_TIME = {order: struct.Struct(order + "iI") for order in "<>"}
_DOUBLE = {order: struct.Struct(order + "d") for order in "<>"}
_VECTOR = {order: struct.Struct(order + "3d") for order in "<>"}


class MessageError(ValueError):
    """Bytes that are not the message they are said to be, or a value that the message cannot hold."""


_Range = tuple[int, int]
_Layout = TypeVar("_Layout")


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
    if order is None or len(data) < BODY:
        raise MessageError(f"not plain CDR: it begins with {bytes(data[:BODY]).hex(' ') or 'nothing'}")
    return order


def _aligned(position: int, size: int) -> int:
    return position + (BODY - position) % size


def _stamp(sec: int, nanosec: int) -> int:
    if nanosec >= _SECOND:
        raise MessageError(f"stamp: nanosec is {nanosec}, must be below {_SECOND}")
    return sec * _SECOND + nanosec


def check_time(stamp_ns: int) -> None:
    """See that a time [ns] is within ROS time; ``MessageError`` if not."""
    sec_nanosec(stamp_ns)


def joint_names(data: bytes) -> tuple[tuple[str, ...], int]:
    """The names of a sensor_msgs/JointState, and the position behind them; ``MessageError`` if there are none."""
    order = _byte_order(data)
    _, position = _string(data, BODY + 8, order, "header.frame_id")
    count, position = _length(data, position, order, 4, "name")  # an empty string takes 4 bytes
    names = []
    for _ in range(count):
        name, position = _string(data, position, order, "name")
        names.append(name)
    return tuple(names), position


def sec_nanosec(stamp_ns: int) -> tuple[int, int]:
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
    if len(data) < BODY + 8:
        raise MessageError("ends before header.stamp")
    sec, nanosec = _TIME[order].unpack_from(data, BODY)
    frame_id, position = _string(data, BODY + 8, order, "header.frame_id")
    return _stamp(sec, nanosec), frame_id, position


def _by_layout(
    data: bytes,
    start: NDArray[np.int64],
    size: NDArray[np.int64],
    layout_of: Callable[[bytes], tuple[_Layout, list[_Range]]],
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
                octets = _columns(data, start[rest[same]] + first, end - first, "u1")
                same[same] = (octets == np.frombuffer(message[first:end], np.uint8)).all(axis=1)
            yield rest[same], layout
            rest = rest[~same]
        else:
            yield rest[:1], layout
            rest = rest[1:]


def _columns(data: bytes, at: NDArray[np.int64], count: int, dtype: str) -> NDArray[Any]:
    """``count`` numbers at each of some positions, known to fit: (len(at), count)."""
    width = count * np.dtype(dtype).itemsize
    if not width:
        return np.empty((len(at), 0), dtype)
    everywhere = np.ndarray(len(data) - width + 1, f"V{width}", data, strides=(1,))
    return everywhere[at].view(dtype).reshape(len(at), count)


def _unread(count: int) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    return np.zeros(count, np.bool_), np.zeros(count, np.int64)


def _stamps(data: bytes, start: NDArray[np.int64], order: str) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Whether the times at the beginning of messages are valid, and the times, 0 if not."""
    sec = _columns(data, start + BODY, 1, order + "i4")[:, 0].astype(np.int64)
    nanosec = _columns(data, start + BODY + 4, 1, order + "u4")[:, 0].astype(np.int64)
    valid = nanosec < _SECOND
    return valid, np.where(valid, sec * _SECOND + nanosec, 0)


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
        """Decode one message.

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
        known = data[BODY + 8 : self._end] == self._frame and data[:BODY] == self._encapsulation
        if not known or len(data) < self._position + 48:
            return self._decode_anew(data)
        sec, nanosec, fx, fy, fz = self._layout.unpack_from(data)
        return WrenchStamped(_stamp(sec, nanosec), self._frame_id, fx, fy, fz)

    def _decode_anew(self, data: bytes) -> WrenchStamped:
        wrench = decode_wrench(data)
        order = _byte_order(data)
        self._end = _header(data, order)[2]
        self._position = _aligned(self._end, 8)
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

    def layout(message: bytes) -> tuple[tuple[str, int], list[_Range]]:
        decode_wrench(message)
        order = _byte_order(message)
        _, _, position = _header(message, order)
        return (order, _aligned(position, 8)), [(BODY + 8, position)]

    valid, stamp_ns = _unread(len(start))
    for some, (order, position) in _by_layout(data, start, size, layout):
        valid[some], stamp_ns[some] = _stamps(data, start[some], order)
        force[some] = _columns(data, start[some] + position, 3, order + "f8")
    force[~valid] = np.nan
    return valid, stamp_ns, force[:, 0], force[:, 2]


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
        if len(data) > _MAX_JOINT_STATE:
            raise MessageError(f"{len(data)} bytes are more than the state of joints takes")
        order = _byte_order(data)
        if len(data) < BODY + 8:
            raise MessageError("ends before header.stamp")
        sec, nanosec = _TIME[order].unpack_from(data, BODY)
        known_order, block, position, names = self._known
        if order != known_order or data[BODY + 8 : position] != block:
            names, position = self._names(data, order)
        positions, end = _doubles(data, position, order, "position")
        velocities, end = _doubles(data, end, order, "velocity")
        _length(data, end, order, 8, "effort")
        return JointState(_stamp(sec, nanosec), names, positions, velocities)

    def decode_block(
        self, data: bytes, start: NDArray[np.int64], size: NDArray[np.int64]
    ) -> tuple[
        NDArray[np.bool_],
        NDArray[np.int64],
        list[tuple[NDArray[np.int64], tuple[str, ...], NDArray[np.float64], NDArray[np.float64] | None]],
    ]:
        """Decode many messages.

        Parameters
        ----------
        data : bytes
        start, size : (N,) ndarray of int
            Where in ``data`` the messages are.

        Returns
        -------
        valid : (N,) ndarray of bool
            False where ``decode`` raises ``MessageError``.
        stamp_ns : (N,) ndarray of int
            0 where not valid.
        groups : list of (indices, names, velocities, positions)
            The valid messages with the same names and the same number of velocities K, (n,) and (n, K), in order;
            the groups in the order of their first messages. Positions are (n, K) too, or None where they are not K.
        """
        valid, stamp_ns = _unread(len(start))
        found: dict[tuple[tuple[str, ...], int, bool], list[tuple[NDArray[Any], ...]]] = {}
        for some, (order, names, places, count) in _by_layout(data, start, size, self._layout):
            valid[some], stamp_ns[some] = _stamps(data, start[some], order)
            some = some[valid[some]]
            columns = [_columns(data, start[some] + place, count, order + "f8").astype(np.float64) for place in places]
            found.setdefault((names, count, len(places) > 1), []).append((some, *columns))
        groups = []
        for (names, _, _), parts in found.items():
            indices, *numbers = (np.concatenate(column) for column in zip(*parts, strict=True))
            in_order = np.argsort(indices)
            velocities, *positions = (each[in_order] for each in numbers)
            groups.append((indices[in_order], names, velocities, positions[0] if positions else None))
        return valid, stamp_ns, groups

    def _layout(self, message: bytes) -> tuple[tuple[str, tuple[str, ...], tuple[int, ...], int], list[_Range]]:
        """Byte order, names, where the velocities are and as many positions, and how many."""
        self.decode(message)  # refuses what is none, and knows the names then
        order, _, position, names = self._known
        fixed = [(BODY + 8, position)]
        sizes, places = [], []
        for what in ("position", "velocity", "effort"):
            count = _aligned(position, 4)
            fixed.append((count, count + 4))
            if what != "effort":
                numbers, position = _doubles(message, position, order, what)
                sizes.append(len(numbers))
                places.append(position - 8 * len(numbers))
        has_positions = sizes[0] == sizes[1]
        return (order, names, (places[1], *places[:1]) if has_positions else (places[1],), sizes[1]), fixed

    def _names(self, data: bytes, order: str) -> tuple[tuple[str, ...], int]:
        names, position = joint_names(data)
        self._known = order, bytes(data[BODY + 8 : position]), position, names
        return names, position


def decode_float64(data: bytes) -> float:
    """Decode std_msgs/Float64; ``MessageError`` if the bytes are not such a message."""
    order = _byte_order(data)
    if len(data) < BODY + 8:
        raise MessageError("ends before data")
    value: float = _DOUBLE[order].unpack_from(data, BODY)[0]
    return value


def decode_clock(data: bytes) -> int:
    """Decode rosgraph_msgs/Clock to its time in ns; ``MessageError`` if the bytes are not such a message."""
    order = _byte_order(data)
    if len(data) < BODY + 8:
        raise MessageError("ends before clock")
    return _stamp(*_TIME[order].unpack_from(data, BODY))


def decode_float64s(
    data: bytes, start: NDArray[np.int64], size: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Decode many std_msgs/Float64, as ``decode_wrenches`` does: valid, and the values, NaN where not valid."""
    valid, _ = _unread(len(start))
    values = np.full(len(start), np.nan)

    def layout(message: bytes) -> tuple[str, list[_Range]]:
        decode_float64(message)
        return _byte_order(message), []

    for some, order in _by_layout(data, start, size, layout):
        valid[some] = True
        values[some] = _columns(data, start[some] + BODY, 1, order + "f8")[:, 0]
    return valid, values


def decode_clocks(
    data: bytes, start: NDArray[np.int64], size: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Decode many rosgraph_msgs/Clock, as ``decode_wrenches`` does: valid, and the times in ns, 0 where not valid."""
    valid, stamp_ns = _unread(len(start))

    def layout(message: bytes) -> tuple[str, list[_Range]]:
        decode_clock(message)
        return _byte_order(message), []

    for some, order in _by_layout(data, start, size, layout):
        valid[some], stamp_ns[some] = _stamps(data, start[some], order)
    return valid, stamp_ns


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
    count, position = _length(data, BODY, order, 12, "layout.dim")  # label, size, stride: at least 12 bytes
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


def encoded_string(text: str, position: int) -> bytes:
    """A string at a body position, with the padding before it."""
    raw = text.encode() + b"\0"
    return bytes(-position % 4) + struct.pack("<I", len(raw)) + raw


def _encoded(message: bytes, count: int, *columns: tuple[int, str, ArrayLike]) -> list[bytes]:
    """A message ``count`` times, each with its own values in the columns: position, dtype, values (count, ...)."""
    if not count:
        return []
    rows = np.frombuffer(bytearray(message * count), np.uint8).reshape(count, len(message))
    for position, dtype, values in columns:
        octets = np.ascontiguousarray(values, dtype).reshape(count, -1).view(np.uint8)
        rows[:, position : position + octets.shape[1]] = octets
    return _rows(rows)


def _rows(values: NDArray[Any]) -> list[bytes]:
    """The bytes of each of the arrays that an array (N, ...) holds, N > 0."""
    flat = np.ascontiguousarray(values).reshape(len(values), -1)
    rows: list[bytes] = flat.view(f"V{flat[0].nbytes}")[:, 0].tolist()
    return rows


def _time_columns(stamps: ArrayLike) -> list[tuple[int, str, NDArray[np.int64]]]:
    """The columns of a stamp at the beginning of the body."""
    sec, nanosec = np.divmod(np.asarray(stamps, np.int64), _SECOND)
    for wrong in np.flatnonzero((sec < -0x80000000) | (sec > 0x7FFFFFFF))[:1]:
        sec_nanosec(int(np.asarray(stamps)[wrong]))
    return [(BODY, "<i4", sec), (BODY + 4, "<u4", nanosec)]


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
        return self._layout.pack(LITTLE_ENDIAN, *sec_nanosec(stamp_ns), *self._frame, fx, 0.0, fz, 0.0, 0.0, 0.0)

    def encode_block(self, stamps: ArrayLike, fx: ArrayLike, fz: ArrayLike) -> list[bytes]:
        """Many messages: stamps [ns] and forces [N], all (N,)."""
        count, force = np.size(stamps), self._layout.size - 48
        x, z = np.broadcast_to(fx, count), np.broadcast_to(fz, count)
        columns = (*_time_columns(stamps), (force, "<f8", x), (force + 16, "<f8", z))
        return _encoded(self.encode(0, 0.0, 0.0), count, *columns)


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
            block += encoded_string(name, start + len(block))
        block += bytes(-(start + len(block)) % 4) + struct.pack("<2I", 0, len(names))  # no position; velocity
        if names:
            block += bytes(-(start + len(block)) % 8)
        self._names = block
        self._layout = struct.Struct(f"{header}{len(block)}s{len(names)}d4x")  # 4x: no effort

    def encode(self, stamp_ns: int, velocities: Sequence[float]) -> bytes:
        """One message with the velocities [rad/s]; ``MessageError`` if the stamp is outside ROS time."""
        return self._layout.pack(LITTLE_ENDIAN, *sec_nanosec(stamp_ns), *self._frame, self._names, *velocities)


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
        return [self._head + row for row in _rows(values)] if len(values) else []


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
        heads = _encoded(message[:start], len(values), *_time_columns(stamps))
        return [b"".join((head, row, end)) for head, row in zip(heads, _rows(values), strict=True)]


def ring_points(data: bytes, points: int) -> NDArray[np.float64]:
    """The columns x, y, z, radial, tangential [m] of a ring_shape that RingShapeEncoder has made, shape (points, 5)."""
    size = 4 * len(RingShapeEncoder.FIELDS)
    values = np.frombuffer(data, "<f4", points * size // 4, len(data) - 1 - points * size)
    return values.reshape(points, -1).astype(np.float64)


def encode_float64(value: float) -> bytes:
    """Encode std_msgs/Float64."""
    return struct.pack("<4sd", LITTLE_ENDIAN, value)


def encode_clock(stamp_ns: int) -> bytes:
    """Encode rosgraph_msgs/Clock; ``MessageError`` if the time is outside ROS time."""
    return struct.pack("<4siI", LITTLE_ENDIAN, *sec_nanosec(stamp_ns))


def encode_clocks(stamps: ArrayLike) -> list[bytes]:
    """Encode many rosgraph_msgs/Clock, of times (N,) [ns]."""
    return _encoded(encode_clock(0), np.size(stamps), *_time_columns(stamps))


def encode_static_transforms(
    stamp_ns: int, parent: str, children: Sequence[str], positions: Sequence[Sequence[float]]
) -> bytes:
    """Encode tf2_msgs/TFMessage: frames at positions (x, y, z) [m] in a parent, turned like it."""
    body = struct.pack("<I", len(children))
    for child, position in zip(children, positions, strict=True):
        body += bytes(-len(body) % 4) + struct.pack("<iI", *sec_nanosec(stamp_ns))
        for frame in (parent, child):
            body += encoded_string(frame, len(body))
        body += bytes(-len(body) % 8) + struct.pack("<7d", *position, 0.0, 0.0, 0.0, 1.0)
    return LITTLE_ENDIAN + body


def encode_string(text: str) -> bytes:
    """Encode std_msgs/String."""
    return LITTLE_ENDIAN + encoded_string(text, 0)


def decode_string(data: bytes) -> str:
    """Decode std_msgs/String; ``MessageError`` if the bytes are not such a message."""
    if len(data) > _MAX_STRING:
        raise MessageError(f"{len(data)} bytes are more than any text here takes")
    return _string(data, BODY, _byte_order(data), "data")[0]
