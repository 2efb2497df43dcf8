"""Where fields stand in the bytes of a message: a plan, made once for a type, that ``field_reader`` follows.

A plan is rows of four integers. Each row goes over some bytes of the message (the numbers of a field that is not
wanted, a text, a sequence) or reads some of them into slots. Numbers that follow one another are gone over in one row.

Paths are those of a person: ``wheels[2].omega``, ``data[3]``. A path that goes through an array without an index means
all its elements; an index that is a name, ``velocity[front_left_joint]``, is looked up in the names beside the field.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as of
from typing import Final, NamedTuple

from .definition import SEQUENCE, SINGLE, SIZES, Field, Types, full_name, listed
from .messages import MessageError

__all__ = ["EVERY", "KINDS", "FieldPlan", "Found", "PlanError", "Step", "find_field", "make_plan"]

KINDS: Final = {
    "bool": 0, "byte": 0, "char": 0, "uint8": 0, "int8": 1, "int16": 2, "uint16": 3, "int32": 4, "uint32": 5,
    "int64": 6, "uint64": 7, "float32": 8, "float64": 9,
}  # fmt: skip
"""Numbers that stand for the types of numbers in a plan."""

EVERY: Final = "*"
"""In a parsed path: all elements of an array."""

SKIP, READ, TEXT, OVER, SEQ, LOOP, NAMES, BY_NAME, TIME, STAMP = range(10)
"""What a row does: go over a run of numbers, texts, a sequence; read a number, elements of a sequence; do rows for each
element; look up names, read the numbers of those; read the stamp, as a Time or a number."""

_NAMES = ("name", "names", "joint_names", "joint_name")
_PART = re.compile(r"([A-Za-z]\w*)(?:\[([^\[\]]*)\])?")
_DEEPEST = 12
_TIME = "builtin_interfaces/msg/Time"
_MOST_STEPS = 4000
_MOST_UNROLLED = 4  # elements of an array of messages that is gone over


class PlanError(MessageError):
    """A field that is not there, or cannot be read; the message names those that are."""


class Step(NamedTuple):
    """A part of a path: a field and, of an array, which element: a number, EVERY or a name; None of a single one."""

    name: str
    element: int | str | None


class Found(NamedTuple):
    """What a path leads to: the path in parts, the field, and how many values: SINGLE, SEQUENCE, or a number."""

    steps: tuple[Step, ...]
    field: Field
    length: int


@dataclass
class FieldPlan:
    """The rows of a plan, what they refer to, and how many slots they fill.

    ``table`` holds pairs: the number of an element, or of a name, and the slot that it goes to; ``names`` are those
    that are looked up. A message without one of the ``required`` elements is not what the plan is for; a name may be
    missing.
    """

    steps: list[tuple[int, int, int, int]] = of(default_factory=list)
    table: list[int] = of(default_factory=list)
    names: list[str] = of(default_factory=list)
    required: int = 0
    slots: int = 0
    stamped: bool = False


def _parts(path: str) -> list[tuple[str, str | None]]:
    parts, at = [], 0
    while at < len(path):
        found = _PART.match(path, at)
        if found is None:
            raise PlanError(f"{path!r} is not a field's path such as wheels[2].omega")
        parts.append((found[1], found[2]))
        at = found.end()
        if at < len(path):
            if path[at] != ".":
                raise PlanError(f"{path!r} is not a field's path such as wheels[2].omega")
            at += 1
            if at == len(path):
                raise PlanError(f"{path!r} ends with a dot")
    if not parts or len(parts) > _DEEPEST:
        raise PlanError(f"{path!r} is not a field's path such as wheels[2].omega")
    return parts


def find_field(types: Types, msgtype: str, path: str) -> Found:
    """What a path leads to.

    Parameters
    ----------
    types : mapping
        As :func:`.definition.parse_definition` gives them.
    msgtype : str
    path : str

    Returns
    -------
    Found
        Its field may be a number, a text or a message.

    Raises
    ------
    PlanError
        There is no such field; the message names those that there are.
    """
    name, count, sequences = full_name(msgtype), SINGLE, 0
    steps: list[Step] = []
    parts = _parts(path)
    for place, (part, index) in enumerate(parts):
        if name not in types or not (fields := [each for each in types[name] if each.name == part]):
            raise PlanError(f"has no field {path!r}; it has {listed(types, msgtype)}")
        found = fields[0]
        steps.append(Step(part, _index(path, found, index)))
        if steps[-1].element == EVERY:
            if count != SINGLE:
                raise PlanError(f"{path!r} goes through two arrays; give one of them an index")
            count = found.length
        elif isinstance(steps[-1].element, str):
            alone = all(step.element is None for step in steps[:-1]) and place + 1 == len(parts)
            if not alone or not any(each.kind == "string" and each.length != SINGLE for each in types[name]):
                raise PlanError(f"{path!r} looks up {index!r}, but beside {part} there are no names to look it up in")
            if found.length != SEQUENCE:
                raise PlanError(f"{path!r} looks up {index!r}, but {part} is no sequence")
        name = found.kind
        sequences += found.length == SEQUENCE
    if sequences > 1:
        raise PlanError(f"{path!r} is within two sequences; what is within one is read")
    return Found(tuple(steps), found, count)


def _index(path: str, found: Field, index: str | None) -> int | str | None:
    if index is None:
        return None if found.length == SINGLE else EVERY
    if found.length == SINGLE:
        raise PlanError(f"{path!r} has an index, but {found.name} is a single one")
    index = index.strip()
    if index in ("", EVERY):
        return EVERY
    if not index.isdecimal():
        return index
    if len(index) > 6 or found.length != SEQUENCE and int(index) >= found.length:
        raise PlanError(f"{path!r} asks for element {index}, but {found.name} has {max(found.length, 0)}")
    return int(index)


# -- the plan ---------------------------------------------------------------------------------------------------------


class _Wanted(NamedTuple):
    """A field that is wanted: the rest of its path, and its slots by element."""

    steps: tuple[Step, ...]
    slots: Mapping[int, int]

    @property
    def name(self) -> str:
        return self.steps[0].name

    @property
    def which(self) -> int | str | None:
        return self.steps[0].element

    def within(self, element: int) -> _Wanted | None:
        """What is wanted of an element of an array whose elements are gone over one by one."""
        if self.which == EVERY:
            return _Wanted(self.steps[1:], {0: self.slots[element]}) if element in self.slots else None
        return _Wanted(self.steps[1:], self.slots) if self.which in (None, element) else None

    def looped(self) -> _Wanted:
        """The same of the elements of a sequence, for which rows are repeated."""
        if self.which == EVERY:
            return _Wanted(self.steps[1:], self.slots)
        assert isinstance(self.which, int)
        return _Wanted(self.steps[1:], {self.which: self.slots[0]})


def make_plan(
    types: Types,
    msgtype: str,
    wanted: Sequence[tuple[str, Sequence[int]]],
    stamp: str = "",
    stamp_unit: int = 0,
) -> FieldPlan:
    """The plan by which some fields of a message are read.

    Parameters
    ----------
    types : mapping
        As :func:`.definition.parse_definition` gives them.
    msgtype : str
    wanted : sequence of (path, slots)
        Fields that are numbers; of a path through a whole array, the slots of its first elements.
    stamp : str
        Path of the time stamp, a builtin_interfaces/Time or a number; empty for none.
    stamp_unit : int
        Nanoseconds in the unit of a stamp that is a number; 0: ns of an integer, s of a floating-point number.

    Returns
    -------
    FieldPlan

    Raises
    ------
    PlanError
        A field is not there, or cannot be read; the message names those that are there.
    """
    plan = FieldPlan()
    needs: list[_Wanted] = []
    for path, slots in wanted:
        found = find_field(types, msgtype, path)
        if not found.field.is_number:
            raise PlanError(f"{path!r} is no number; it has {listed(types, msgtype)}")
        if found.length > SINGLE and len(slots) > found.length:
            raise PlanError(f"{path!r} has {found.length} elements; {len(slots)} are wanted")
        needs.append(_Wanted(found.steps, dict(enumerate(slots))))
        plan.slots = max(plan.slots, *(slot + 1 for slot in slots))
        plan.required += 0 if isinstance(found.steps[-1].element, str) and found.length == SINGLE else len(slots)
    time: tuple[Step, ...] = ()
    unit = 0
    if stamp:
        found = find_field(types, msgtype, stamp)
        if any(step.element is not None for step in found.steps):
            raise PlanError(f"{stamp!r} is within an array, and a time stamp must not be")
        if not found.field.is_number and found.field.kind != _TIME:
            raise PlanError(f"{stamp!r} is no time stamp: neither a builtin_interfaces/Time nor a number")
        time, unit = found.steps, stamp_unit or (10**9 if found.field.kind.startswith("float") else 1)
        plan.stamped = True
    _Writer(types, plan, unit).message(full_name(msgtype), needs, time, outermost=True)
    return plan


class _Writer:
    """Writes the rows of a plan."""

    def __init__(self, types: Types, plan: FieldPlan, unit: int) -> None:
        self._types, self._plan, self._unit = types, plan, unit
        self._depth = 0
        self._edge = 0  # rows before it are not merged with those behind it

    def _row(self, op: int, a: int = 0, b: int = 0, c: int = 0) -> int:
        steps = self._plan.steps
        if op == SKIP and len(steps) > self._edge and steps[-1][0] == SKIP:
            _, align, size, _ = steps[-1]
            if a <= align and size % a == 0 and size > 0 and b > 0:
                steps[-1] = (SKIP, align, size + b, 0)
                return len(steps) - 1
        if len(steps) >= _MOST_STEPS:
            raise PlanError("is too large a message")
        steps.append((op, a, b, c))
        return len(steps) - 1

    def message(
        self, name: str, wanted: Sequence[_Wanted], time: tuple[Step, ...] = (), outermost: bool = False
    ) -> None:
        """Go over a message; of the outermost one, what is behind the last wanted field is left out."""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise PlanError("is nested too deep")
        fields = self._types[name]
        names = _names_beside(fields) if any(_is_named(each) for each in wanted) else ""
        asked = {each.name for each in wanted} | ({time[0].name} if time else set()) | ({names} if names else set())
        last = max((k for k, each in enumerate(fields) if each.name in asked), default=-1)
        for place, each in enumerate(fields):
            if outermost and place > last:
                break
            here = [one for one in wanted if one.name == each.name]
            if time and time[0].name == each.name and len(time) == 1:
                self._stamp(each, here)
            elif each.name == names:
                self._row(NAMES, each.length)
            elif not here and not (time and time[0].name == each.name):
                self._over(each)
            elif each.is_number:
                self._numbers(each, here)
            else:
                self._inner(each, here, time[1:] if time and time[0].name == each.name else ())
        self._depth -= 1

    def _stamp(self, each: Field, here: Sequence[_Wanted]) -> None:
        if each.kind == _TIME:
            self._row(TIME)
            if here:
                raise PlanError(f"{each.name!r} is the stamp, and its parts are not read beside it")
            return
        self._row(STAMP, KINDS[each.kind], self._unit, int(each.kind.startswith("float")))
        if here:
            self._row(SKIP, 1, -SIZES[each.kind])
            self._numbers(each, here)

    def _pairs(self, pairs: Iterable[tuple[int, int]]) -> tuple[int, int]:
        """Where pairs stand in the table, and how many they are."""
        begin = len(self._plan.table)
        for pair in pairs:
            self._plan.table.extend(pair)
        return begin, (len(self._plan.table) - begin) // 2

    def _numbers(self, each: Field, here: Sequence[_Wanted]) -> None:
        size, kind = SIZES[each.kind], KINDS[each.kind]
        if each.length == SEQUENCE and _is_named(here[0]):
            names = self._plan.names
            for one in here:
                if not _is_named(one):
                    raise PlanError(f"{each.name!r} is asked for by name and by number")
                if one.which not in names:
                    names.append(str(one.which))
            self._row(BY_NAME, kind, *self._pairs((names.index(str(one.which)), one.slots[0]) for one in here))
        elif each.length == SEQUENCE:
            pairs: list[tuple[int, int]] = []
            for one in here:
                pairs += one.slots.items() if one.which == EVERY else [(int(one.which or 0), one.slots[0])]
            self._row(SEQ, kind, *self._pairs(pairs))
        else:
            for element in range(max(each.length, 1)):
                inner = [one.within(element) for one in here]
                pairs = [pair for one in inner if one is not None for pair in one.slots.items()]
                if pairs:
                    self._row(READ, kind, *self._pairs(pairs))
                else:
                    self._row(SKIP, size, size)

    def _inner(self, each: Field, here: Sequence[_Wanted], time: tuple[Step, ...]) -> None:
        if each.length == SEQUENCE:
            self._loop(each, [one.looped() for one in here])
        else:
            for element in range(max(each.length, 1)):
                inner = [one.within(element) for one in here]
                self.message(each.kind, [one for one in inner if one is not None], time)

    def _loop(self, each: Field, inner: Sequence[_Wanted]) -> None:
        row = self._row(LOOP, each.length)
        self._edge = row + 1
        self.message(each.kind, inner)
        self._edge = len(self._plan.steps)
        self._plan.steps[row] = (LOOP, each.length, self._edge, 0)

    def _over(self, each: Field) -> None:
        """Go over a field that is not wanted."""
        if each.is_text:
            if each.kind == "wstring":
                raise PlanError(f"{each.name!r}, a wstring, stands before what is wanted, and is not read")
            self._row(TEXT, each.length)
        elif each.is_number and each.length == SEQUENCE:
            self._row(OVER, SIZES[each.kind])
        elif each.is_number:
            self._row(SKIP, SIZES[each.kind], SIZES[each.kind] * max(each.length, 1))
        elif each.length == SEQUENCE or each.length > _MOST_UNROLLED:
            self._loop(each, [])
        else:
            for _ in range(max(each.length, 1)):
                self.message(each.kind, [])


def _is_named(wanted: _Wanted) -> bool:
    return len(wanted.steps) == 1 and isinstance(wanted.which, str) and wanted.which != EVERY


def _names_beside(fields: Sequence[Field]) -> str:
    """The field whose texts are the names of the elements beside it."""
    texts = [each.name for each in fields if each.kind == "string" and each.length != SINGLE]
    return next((name for name in _NAMES if name in texts), texts[0])
