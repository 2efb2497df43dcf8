"""sensor_msgs/JointState."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .blocks import Range, by_layout, columns_at, stamps_of, unread
from .primitives import (
    BODY,
    LITTLE_ENDIAN,
    TIME,
    MessageError,
    aligned,
    byte_order,
    doubles_at,
    encoded_string,
    header_layout,
    length_at,
    sec_nanosec,
    stamp_of,
    string_at,
)

__all__ = [
    "JointState",
    "JointStateDecoder",
    "JointStateEncoder",
    "joint_names",
]

_MAX_JOINT_STATE = 2**20  # bytes; beyond, what is made of them would take the memory


class JointState(NamedTuple):
    """What the estimator needs of sensor_msgs/JointState; the lengths may differ, as in the message."""

    stamp_ns: int
    names: tuple[str, ...]
    positions: tuple[float, ...]
    velocities: tuple[float, ...]


def joint_names(data: bytes) -> tuple[tuple[str, ...], int]:
    """The names of a sensor_msgs/JointState, and the position behind them; ``MessageError`` if there are none."""
    order = byte_order(data)
    _, position = string_at(data, BODY + 8, order, "header.frame_id")
    count, position = length_at(data, position, order, 4, "name")  # an empty string takes 4 bytes
    names = []
    for _ in range(count):
        name, position = string_at(data, position, order, "name")
        names.append(name)
    return tuple(names), position


class JointStateDecoder:
    """Decodes sensor_msgs/JointState.

    A publisher sends the same names every time, and they are most of the work: the bytes of frame_id and
    names are kept from one message to the next, and parsed only when they differ.
    """

    def __init__(self) -> None:
        self._known: tuple[str, bytes, int, tuple[str, ...]] = ("", b"", 0, ())

    def decode(self, data: bytes) -> JointState:
        """Decode one message; ``MessageError`` if the bytes are not such a message."""
        if len(data) > _MAX_JOINT_STATE:
            raise MessageError(f"{len(data)} bytes are more than the state of joints takes")
        order = byte_order(data)
        if len(data) < BODY + 8:
            raise MessageError("ends before header.stamp")
        sec, nanosec = TIME[order].unpack_from(data, BODY)
        known_order, block, position, names = self._known
        if order != known_order or data[BODY + 8 : position] != block:
            names, position = self._names(data, order)
        positions, end = doubles_at(data, position, order, "position")
        velocities, end = doubles_at(data, end, order, "velocity")
        length_at(data, end, order, 8, "effort")
        return JointState(stamp_of(sec, nanosec), names, positions, velocities)

    def decode_block(
        self, data: bytes, start: NDArray[np.int64], size: NDArray[np.int64]
    ) -> tuple[
        NDArray[np.bool_],
        NDArray[np.int64],
        list[tuple[NDArray[np.int64], tuple[str, ...], NDArray[np.float64], NDArray[np.float64] | None]],
    ]:
        """Decode many messages, as :func:`~tire_dynamics.cdr.wrench.decode_wrenches` does.

        Returns
        -------
        valid, stamp_ns : (N,) ndarray
            As there.
        groups : list of (indices, names, velocities, positions)
            The valid messages with the same names and the same number of velocities K, (n,) and (n, K), in order;
            the groups in the order of their first messages. Positions are (n, K) too, or None where they are not K.
        """
        valid, stamp_ns = unread(len(start))
        found: dict[tuple[tuple[str, ...], int, bool], list[tuple[NDArray[Any], ...]]] = {}
        for some, (order, names, places, count) in by_layout(data, start, size, self._layout):
            valid[some], stamp_ns[some] = stamps_of(data, start[some], order)
            some = some[valid[some]]
            columns = [
                columns_at(data, start[some] + place, count, order + "f8").astype(np.float64) for place in places
            ]
            found.setdefault((names, count, len(places) > 1), []).append((some, *columns))
        groups = []
        for (names, _, _), parts in found.items():
            indices, *numbers = (np.concatenate(column) for column in zip(*parts, strict=True))
            in_order = np.argsort(indices)
            velocities, *positions = (each[in_order] for each in numbers)
            groups.append((indices[in_order], names, velocities, positions[0] if positions else None))
        return valid, stamp_ns, groups

    def _layout(self, message: bytes) -> tuple[tuple[str, tuple[str, ...], tuple[int, ...], int], list[Range]]:
        """Byte order, names, where the velocities are and as many positions, and how many."""
        self.decode(message)  # refuses what is none, and knows the names then
        order, _, position, names = self._known
        fixed = [(BODY + 8, position)]
        sizes, places = [], []
        for what in ("position", "velocity", "effort"):
            count = aligned(position, 4)
            fixed.append((count, count + 4))
            if what != "effort":
                numbers, position = doubles_at(message, position, order, what)
                sizes.append(len(numbers))
                places.append(position - 8 * len(numbers))
        has_positions = sizes[0] == sizes[1]
        return (order, names, (places[1], *places[:1]) if has_positions else (places[1],), sizes[1]), fixed

    def _names(self, data: bytes, order: str) -> tuple[tuple[str, ...], int]:
        names, position = joint_names(data)
        self._known = order, bytes(data[BODY + 8 : position]), position, names
        return names, position


class JointStateEncoder:
    """Encodes sensor_msgs/JointState with velocities only.

    Parameters
    ----------
    names : sequence of str
        The joints; they fix the layout.
    """

    def __init__(self, names: Sequence[str]) -> None:
        header, self._frame, start = header_layout("")
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
