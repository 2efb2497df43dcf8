"""Whether a definition that a bag carries has the fields that ROS gives the type, for the types that are known here.

Messages name their type, and a reader takes their bytes for that. Where the bag's own definition of the type says
otherwise, they would be read as numbers that mean something else.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..cdr.definition import SIZES, Field, Types, full_name, parse_definition
from ..cdr.messages import MessageError
from .definitions import HASHES, definition

__all__ = ["OTHER_FIELDS", "has_other_fields"]

OTHER_FIELDS = "cdr of other fields"
"""In place of the encoding of a topic whose messages are plain CDR, but by their definition not of their type."""

_HEADER = "std_msgs/msg/Header"
_MAX_FIELDS, _MAX_DEPTH = 4096, 16  # of a message with those of all types in it; types in types
_SAME = {"byte": "uint8", "char": "uint8"}


def has_other_fields(msgtype: str, text: str) -> bool:
    """Whether a definition differs from the known one in names, types or order of its fields.

    Parameters
    ----------
    msgtype : str
        Such as "geometry_msgs/msg/WrenchStamped".
    text : str
        As ``ros2msg`` has it: fields, and those of other types behind a rule.

    Returns
    -------
    bool
        False where nothing says so: the type is not known here, or the text is empty or not understood.
    """
    known = definition(msgtype) if msgtype in HASHES else ""
    if not known or text == known or not text.strip():
        return False
    try:
        types = parse_definition(text, msgtype)
        if any(field.name in ("seq", "structure_needs_at_least_one_member") for field in _heads(types, msgtype)):
            return False  # of ROS 1, as converted bags have it; a text without fields
        return list(_flat(types, msgtype)) != list(_flat(parse_definition(known, msgtype), msgtype))
    except MessageError:
        return False


def _heads(types: Types, msgtype: str) -> Iterator[Field]:
    yield from types[full_name(msgtype)]
    yield from types[_HEADER]


def _flat(types: Types, msgtype: str) -> Iterator[tuple[str, str]]:
    """The primitive fields of a message in their order: names with dots, and types."""
    left = [_MAX_FIELDS]

    def walk(kind: str, before: str, depth: int) -> Iterator[tuple[str, str]]:
        for field in types[kind]:
            left[0] -= 1
            if left[0] < 0 or depth > _MAX_DEPTH:
                raise MessageError(f"the definition of {msgtype} has no end")
            if field.kind in SIZES or field.is_text:
                yield f"{before}{field}", _SAME.get(field.kind, field.kind)
            else:
                yield from walk(field.kind, f"{before}{field}.", depth + 1)

    return walk(full_name(msgtype), "", 0)
