"""Values in a form in which equal means equal in every bit, the one that ``read_log.cjs`` writes."""

from __future__ import annotations

import struct
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

__all__ = ["exact"]


def exact(value: Any) -> Any:
    """A message or a part of one: of numbers the hexadecimal digits of the doubles, of uint8 arrays of the bytes."""
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int | float | np.number):
        return struct.pack(">d", float(value)).hex()
    if isinstance(value, np.ndarray):
        return (value if value.dtype == np.uint8 else value.astype(">f8")).tobytes().hex()
    if isinstance(value, list | tuple):
        return [exact(part) for part in value]
    if is_dataclass(value):
        # rosbags has a message's constants, in capitals, and its type among the fields
        names = (field.name for field in fields(value) if field.name[0].islower())
        return {name: exact(getattr(value, name)) for name in names}
    raise TypeError(type(value).__name__)
