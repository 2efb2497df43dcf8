"""tf2_msgs/TFMessage, of frames that do not move."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from .primitives import LITTLE_ENDIAN, encoded_string, sec_nanosec

__all__ = ["encode_static_transforms"]


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
