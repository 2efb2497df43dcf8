"""Definitions of messages as texts (``.msg``, and ``ros2msg`` in bags): which fields a type has, in which order."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final, NamedTuple

from .messages import MessageError

__all__ = ["SEQUENCE", "SINGLE", "SIZES", "Field", "Types", "full_name", "listed", "parse_definition"]

SINGLE: Final = 0
SEQUENCE: Final = -1

SIZES: Final = {
    "bool": 1, "byte": 1, "char": 1, "uint8": 1, "int8": 1, "int16": 2, "uint16": 2, "int32": 4, "uint32": 4,
    "int64": 8, "uint64": 8, "float32": 4, "float64": 8,
}  # fmt: skip
"""Bytes of the numbers that a message may hold."""

_TEXTS = ("string", "wstring")
_LONGEST = 2**20  # characters of a definition
_MOST = 500  # types in one, and fields of one type
_RULE = re.compile(r"^={20,}\s*$", re.MULTILINE)
_LINE = re.compile(r"([A-Za-z][\w/]*)(<=\d{1,9})?(\[(?:(<=)?(\d{1,9}))?\])?\s+([A-Za-z]\w*)\s*(=)?")
_KNOWN = """\
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""
_SHORT = {
    "Header": "std_msgs/msg/Header",
    "time": "builtin_interfaces/msg/Time",
    "duration": "builtin_interfaces/msg/Duration",
}


class Field(NamedTuple):
    """A field: its name, its type, and SINGLE, SEQUENCE or the length of an array."""

    name: str
    kind: str
    length: int

    @property
    def is_number(self) -> bool:
        """Whether it is a number or many."""
        return self.kind in SIZES

    @property
    def is_text(self) -> bool:
        """Whether it is a text or many."""
        return self.kind in _TEXTS

    def __str__(self) -> str:
        many = {SINGLE: "", SEQUENCE: "[]"}.get(self.length, f"[{self.length}]")
        return f"{self.name}{many}"


Types = Mapping[str, tuple[Field, ...]]
"""Fields by the full names of types."""


def full_name(kind: str, package: str = "") -> str:
    """The name of a type as ``package/msg/Type``; of one without a package, that of the message that has it."""
    if kind in _SHORT:
        return _SHORT[kind]
    parts = kind.split("/")
    return f"{package}/msg/{kind}" if len(parts) == 1 else f"{parts[0]}/msg/{parts[-1]}"


def parse_definition(text: str, msgtype: str) -> dict[str, tuple[Field, ...]]:
    """The fields of a type and of all types in it.

    Parameters
    ----------
    text : str
        Its fields; then those of the types of its fields, each behind a rule of ``=`` and a line ``MSG: package/Type``.
    msgtype : str
        Such as "geometry_msgs/msg/WrenchStamped".

    Returns
    -------
    dict of str to tuple of Field
        By full name. A type without fields has the byte that it is serialised as.

    Raises
    ------
    MessageError
        The text is no such definition, or one too large.
    """
    if len(text) > _LONGEST:
        raise MessageError(f"the definition of {msgtype} has {len(text)} characters")
    own = full_name(msgtype)
    types: dict[str, tuple[Field, ...]] = {}
    for number, part in enumerate(_RULE.split(f"{text}\n{_KNOWN}")):
        name, lines = own, part.splitlines()
        if number or part.lstrip().startswith("MSG:"):  # the first may have a head too
            head = next((line for line in lines if line.strip()), "")
            if not head.startswith("MSG:"):
                raise MessageError(f"the definition of {msgtype} has a part that begins with {head[:60]!r}")
            name, lines = full_name(head.removeprefix("MSG:").strip()), lines[lines.index(head) + 1 :]
        if name not in types:
            types[name] = _fields(lines, name)
        if len(types) > _MOST:
            raise MessageError(f"the definition of {msgtype} has more than {_MOST} types")
    missing = {f"{field.kind}" for fields in types.values() for field in fields} - {*types, *SIZES, *_TEXTS}
    if missing:
        raise MessageError(f"the definition of {msgtype} leaves out {', '.join(sorted(missing))}")
    return types


def _fields(lines: list[str], name: str) -> tuple[Field, ...]:
    package = name.split("/")[0]
    fields = []
    for line in lines:
        line = line.strip()
        if not line or line.startswith(("#", "//")):
            continue
        found = _LINE.match(line)
        if found is None:
            raise MessageError(f"{name} has a field that cannot be read: {line[:60]!r}")
        kind, bound, brackets, at_most, length, field, is_constant = found.groups()
        if is_constant:
            continue
        if kind not in SIZES and kind not in _TEXTS:
            kind = full_name(kind, package)
        elif bound and kind in SIZES:
            raise MessageError(f"{name} has a field that cannot be read: {line[:60]!r}")
        count = SINGLE if not brackets else SEQUENCE if at_most or not length else int(length)
        fields.append(Field(field, kind, count))
        if len(fields) > _MOST:
            raise MessageError(f"{name} has more than {_MOST} fields")
    return tuple(fields) or (Field("structure_needs_at_least_one_member", "uint8", SINGLE),)


def listed(types: Types, msgtype: str, most: int = 40) -> str:
    """The numbers of a type as paths, for people."""
    found: list[str] = []

    def walk(name: str, before: str, depth: int) -> None:
        for field in types[name]:
            if len(found) > most or depth > 6:
                return
            if field.is_number:
                found.append(f"{before}{field}")
            elif not field.is_text and field.kind != "builtin_interfaces/msg/Time":
                walk(field.kind, f"{before}{field}.", depth + 1)

    walk(full_name(msgtype), "", 0)
    return ", ".join(found[:most]) + (", ..." if len(found) > most else "")
