"""Whether a definition that a bag carries has the fields that ROS gives the type, for the types that are known here.

Messages name their type, and a reader takes their bytes for that. Where the bag's own definition of the type says
otherwise, they would be read as numbers that mean something else.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from .definitions import HASHES, definition

__all__ = ["OTHER_FIELDS", "has_other_fields"]

OTHER_FIELDS = "cdr of other fields"
"""In place of the encoding of a topic whose messages are plain CDR, but by their definition not of their type."""

_MAX_TEXT, _MAX_FIELDS, _MAX_DEPTH = 2**18, 4096, 16  # characters; fields of all types in a message; types in types
_RULE = re.compile(r"^=+\s*$", re.MULTILINE)
_FIELD = re.compile(r"([A-Za-z][\w/]*)(<=\d+)?((?:\[(?:<=)?\d*\])?)\s+(\w+)")
_PRIMITIVES = {
    *("bool", "float32", "float64", "string", "wstring"),
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
}
_SPELLINGS = {"byte": "uint8", "char": "uint8", "Header": "std_msgs/Header", "time": "builtin_interfaces/Time"}

_Fields = list[tuple[str, str]]


class _UnknownError(Exception):
    """A text that is not understood, or names a type that is not in it."""


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
    if not known or text == known or len(text) > _MAX_TEXT:
        return False
    try:
        found = _fields(msgtype, text)
    except _UnknownError:
        return False
    return bool(found) and found != _fields(msgtype, known)


def _fields(msgtype: str, text: str) -> _Fields:
    """The primitive fields of a message in their order: names with dots, and types."""
    own, *others = _RULE.split(text)
    parts = {"": _lines(own)}
    for other in others:
        head, _, rest = other.strip().partition("\n")
        parts[_short(head.removeprefix("MSG:").strip())] = _lines(rest)
    return list(_flat("", msgtype.partition("/")[0], "", parts, [_MAX_FIELDS]))


def _lines(text: str) -> _Fields:
    """Types and names of the fields of one type; constants and comments are none."""
    found = []
    for line in text.splitlines():
        plain = line.partition("#")[0].strip()
        field = _FIELD.match(plain)
        if field and not plain[field.end() :].lstrip().startswith("="):
            found.append((field[1] + field[3], field[4]))
        elif plain and not field:
            raise _UnknownError
    return found


def _flat(
    kind: str, package: str, name: str, parts: Mapping[str, _Fields], left: list[int]
) -> Iterator[tuple[str, str]]:
    """The fields of a type that stands under a name."""
    if name.count(".") > _MAX_DEPTH:
        raise _UnknownError
    if kind not in parts:
        if kind != "builtin_interfaces/Time":  # texts of ROS 1's manner do not have it
            raise _UnknownError
        lines = [("int32", "sec"), ("uint32", "nanosec")]
    else:
        lines = parts[kind]
    for typed, field in lines:
        left[0] -= 1
        if left[0] < 0 or (kind == "std_msgs/Header" and field == "seq"):  # converted bags have ROS 1's text
            raise _UnknownError
        base, bracket, size = typed.partition("[")
        base = _SPELLINGS.get(base, base)
        full = f"{name}.{field}{bracket}{size}" if name else f"{field}{bracket}{size}"
        if base in _PRIMITIVES:
            yield full, base
        else:
            inner = _short(base) if "/" in base else f"{package}/{base}"
            yield from _flat(inner, inner.partition("/")[0], full, parts, left)


def _short(kind: str) -> str:
    return kind.replace("/msg/", "/")
