"""What every message is made of: byte order, alignment, numbers, strings, sequences, and std_msgs/Header.

Positions count from the start of the message, and alignment from the start of its body, behind the encapsulation
header. Every length is checked against the bytes that are there before it is used. Functions whose name ends in
``_at`` give a value and the position behind it.
"""

from __future__ import annotations

import struct

__all__ = [
    "BODY",
    "DOUBLE",
    "LITTLE_ENDIAN",
    "SECOND",
    "TIME",
    "UINT32",
    "VECTOR",
    "MessageError",
    "aligned",
    "byte_order",
    "check_time",
    "doubles_at",
    "encoded_string",
    "header_layout",
    "header_of",
    "length_at",
    "sec_nanosec",
    "stamp_of",
    "string_at",
]

LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_BYTE_ORDER = {LITTLE_ENDIAN[:2]: "<", b"\x00\x00": ">"}
BODY = 4  # the body, and with it all alignment, starts after the encapsulation header
SECOND = 1_000_000_000  # ns

# Prebuilt for both byte orders: ``struct.unpack_from`` with a format string is slower by half.
UINT32 = {order: struct.Struct(order + "I") for order in "<>"}
TIME = {order: struct.Struct(order + "iI") for order in "<>"}
DOUBLE = {order: struct.Struct(order + "d") for order in "<>"}
VECTOR = {order: struct.Struct(order + "3d") for order in "<>"}


class MessageError(ValueError):
    """Bytes that are not the message they are said to be, or a value that the message cannot hold."""


def check_time(stamp_ns: int) -> None:
    """See that a time [ns] is within ROS time; ``MessageError`` if not."""
    sec_nanosec(stamp_ns)


def sec_nanosec(stamp_ns: int) -> tuple[int, int]:
    """The fields of builtin_interfaces/Time; before the epoch sec is negative, nanosec never."""
    sec, nanosec = divmod(stamp_ns, SECOND)
    if not -0x80000000 <= sec <= 0x7FFFFFFF:
        raise MessageError(f"stamp: {stamp_ns} ns is outside the range of ROS time")
    return sec, nanosec


def stamp_of(sec: int, nanosec: int) -> int:
    """A builtin_interfaces/Time as nanoseconds; ``MessageError`` if its nanosec is a second or more."""
    if nanosec >= SECOND:
        raise MessageError(f"stamp: nanosec is {nanosec}, must be below {SECOND}")
    return sec * SECOND + nanosec


def byte_order(data: bytes) -> str:
    """Of a message, as ``struct`` names it; ``MessageError`` if it does not begin as plain CDR does."""
    order = _BYTE_ORDER.get(bytes(data[:2]))
    if order is None or len(data) < BODY:
        raise MessageError(f"not plain CDR: it begins with {bytes(data[:BODY]).hex(' ') or 'nothing'}")
    return order


def aligned(position: int, size: int) -> int:
    """The next position at which a primitive of this size may stand."""
    return position + (BODY - position) % size


def length_at(data: bytes, position: int, order: str, element: int, what: str) -> tuple[int, int]:
    """Length of the string or sequence at ``position``, known to fit, and where its elements start."""
    position = aligned(position, 4)
    if position + 4 > len(data):
        raise MessageError(f"ends before {what}")
    (count,) = UINT32[order].unpack_from(data, position)
    position += 4
    if count * element > len(data) - position:
        raise MessageError(f"{what}: {count} elements do not fit in the {len(data) - position} bytes left")
    return count, position


def string_at(data: bytes, position: int, order: str, what: str) -> tuple[str, int]:
    """The string at a position, and the position behind it."""
    count, position = length_at(data, position, order, 1, what)
    end = position + count
    if count and data[end - 1]:
        raise MessageError(f"{what}: a string without its closing NUL")
    try:
        return str(data[position : end - 1] if count else b"", "utf-8"), end
    except UnicodeDecodeError:
        raise MessageError(f"{what}: not UTF-8") from None


def doubles_at(data: bytes, position: int, order: str, what: str) -> tuple[tuple[float, ...], int]:
    """The sequence of float64 at a position, and the position behind it."""
    count, position = length_at(data, position, order, 8, what)
    if not count:  # an empty sequence has no first element to align
        return (), position
    position = aligned(position, 8)
    end = position + 8 * count
    if end > len(data):
        raise MessageError(f"{what}: {count} elements do not fit in the {len(data) - position} bytes left")
    return struct.unpack_from(f"{order}{count}d", data, position), end


def header_of(data: bytes, order: str) -> tuple[int, str, int]:
    """std_msgs/Header at the start of the body: stamp, frame_id, and the position behind it."""
    if len(data) < BODY + 8:
        raise MessageError("ends before header.stamp")
    sec, nanosec = TIME[order].unpack_from(data, BODY)
    frame_id, position = string_at(data, BODY + 8, order, "header.frame_id")
    return stamp_of(sec, nanosec), frame_id, position


def header_layout(frame_id: str) -> tuple[str, tuple[int, bytes], int]:
    """Format of the encapsulation and a header, the values behind the stamp, the body position after."""
    raw = frame_id.encode() + b"\0"
    return f"<4siII{len(raw)}s", (len(raw), raw), 12 + len(raw)


def encoded_string(text: str, position: int) -> bytes:
    """A string at a body position, with the padding before it."""
    raw = text.encode() + b"\0"
    return bytes(-position % 4) + struct.pack("<I", len(raw)) + raw
