"""The field map: which field of which message is which quantity, as the parameters ``inputs.*`` say.

``sources`` reads the parameters; ``mapped_topics`` makes of them, with the definitions of the messages, a plan of
offsets for each topic and what becomes of each number.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from ..cdr.definition import SINGLE, Types, full_name, parse_definition
from ..cdr.field_plan import EVERY, FieldPlan, PlanError, find_field, make_plan
from ..cdr.messages import MessageError
from ..files.plausibility import GRAVITY

__all__ = [
    "ASPECTS", "MapError", "MappedTopic", "QUANTITIES", "Quantity", "Source", "Values", "mapped_topics", "mapped_types",
    "sources", "without_absent",
]  # fmt: skip


class Quantity(NamedTuple):
    """What may be mapped: its number, its units with what makes SI of each, what it is, and how many values it has.

    ``linear`` are units of a speed of the tire's circumference, for which a rolling radius is needed. ``size`` is 0 of
    what each wheel has one of.
    """

    number: int
    units: Mapping[str, float]
    what: str
    size: int = 0
    linear: Mapping[str, float] = {}


_LINEAR: Final = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704}
_TURNING: Final = {"rad/s": 1.0, "rpm": math.pi / 30.0, "rev/s": 2.0 * math.pi, "deg/s": math.pi / 180.0}
_FORCES: Final = {"N": 1.0, "kN": 1e3, "lbf": 4.4482216152605}
_LENGTHS: Final = {"m": 1.0, "mm": 1e-3, "in": 0.0254}
_ACCELERATIONS: Final = {"m/s^2": 1.0, "g": GRAVITY}
_RATES: Final = {"rad/s": 1.0, "deg/s": math.pi / 180.0}

QUANTITIES: Final[Mapping[str, Quantity]] = {
    "speed": Quantity(0, _TURNING, "spin of each wheel, positive rolling forward", linear=_LINEAR),
    "angle": Quantity(1, {"rad": 1.0, "deg": math.pi / 180.0, "rev": 2.0 * math.pi}, "angle of each wheel"),
    "load": Quantity(2, _FORCES, "vertical load on each tire, up positive"),
    "traction": Quantity(3, _FORCES, "traction on each tire, forward positive"),
    "road_height": Quantity(4, _LENGTHS, "height of the road under each wheel, up positive"),
    "travel": Quantity(5, _LENGTHS, "compression of each spring from its position at rest"),
    "hub_acceleration": Quantity(6, _ACCELERATIONS, "vertical specific force of each hub, up positive"),
    "imu": Quantity(
        7, {f"{a} {w}": 1.0 for a in _ACCELERATIONS for w in _RATES}, "specific force and angular rate, REP 103", 6
    ),
    "vehicle_speed": Quantity(8, _LINEAR, "speed of the vehicle, forward positive, to check the others by", 1),
}
"""By name; SI, and the first unit is the default."""

ASPECTS: Final = ("topic", "type", "field", "unit", "order", "stamp", "sign", "zero")

_TOPIC = re.compile(r"~?/?([A-Za-z_{][A-Za-z0-9_{}]*)(/[A-Za-z_{][A-Za-z0-9_{}]*)*")
_TYPE = re.compile(r"[A-Za-z]\w*(/msg)?/[A-Za-z]\w*")
_STAMP_UNITS: Final = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
_WHEEL: Final = "{wheel}"
_IMU: Final = ("linear_acceleration", "angular_velocity")


class MapError(ValueError):
    """A map that cannot be used; the message names the parameter, the topic, and what there is."""


_NEEDED: Final = ("speed", "load", "road_height")  # what a wheel moves by


class Source(NamedTuple):
    """One topic of a quantity, as the parameters have it.

    ``order`` are the wheels of its values; ``signs`` and ``zeros`` are one for each value, or one for all.
    """

    quantity: str
    topic: str
    msgtype: str
    fields: tuple[str, ...]
    unit: str
    order: tuple[int, ...]
    by_name: bool
    stamp: str
    signs: tuple[float, ...]
    zeros: tuple[float, ...]
    wheel: int | None

    @property
    def where(self) -> str:
        """For people."""
        return f"inputs.{self.quantity}.field, of {self.topic}"


def mapped_types(values: Mapping[str, Any]) -> dict[str, str]:
    """Message type by mapped topic, "" where the parameters do not say; ``MapError`` if two say different ones."""
    types: dict[str, str] = {}
    for source in sources(values):
        known = types.setdefault(source.topic, source.msgtype)
        if source.msgtype and known and source.msgtype != known:
            raise MapError(f"inputs.{source.quantity}.type is {source.msgtype!r}, but {source.topic} is {known} too")
        types[source.topic] = known or source.msgtype
    return types


def sources(values: Mapping[str, Any]) -> list[Source]:
    """The sources that the parameters name.

    Parameters
    ----------
    values : mapping
        All parameters, each checked by its row.

    Raises
    ------
    MapError
        One of them is wrong, or they contradict each other.
    """
    found = []
    for name, quantity in QUANTITIES.items():
        topics = values[f"inputs.{name}.topic"]
        if topics and topics != ("",):
            found += _sources_of(name, quantity, topics, values)
        else:
            for aspect in ("type", "field", "stamp"):
                if any(values[f"inputs.{name}.{aspect}"]):
                    raise MapError(f"inputs.{name}.{aspect} is given, but inputs.{name}.topic is not")
    mapped = {source.quantity for source in found}
    for name, needed in (("angle", "speed"), ("traction", "load")):
        if name in mapped and needed not in mapped:
            raise MapError(f"inputs.{name}.topic is given, but inputs.{needed}.topic is not, which it belongs to")
    return found


def without_absent(values: Mapping[str, Any], absent: Callable[[str], bool]) -> dict[str, Any]:
    """The parameters without those quantities of whose topics a bag has none, if a wheel moves without them."""
    kept = dict(values)
    of: dict[str, list[str]] = {}
    for source in sources(values):
        of.setdefault(source.quantity, []).append(source.topic)
    for quantity, topics in of.items():
        if quantity not in _NEEDED and all(map(absent, topics)):
            kept.update({f"inputs.{quantity}.{aspect}": () for aspect in ("topic", "field")})
            kept.update({f"inputs.{quantity}.{aspect}": "" for aspect in ("type", "stamp")})
    return kept


def _sources_of(name: str, quantity: Quantity, topics: tuple[str, ...], values: Mapping[str, Any]) -> list[Source]:
    prefix, wheels = f"inputs.{name}", tuple(values["wheels"])
    for topic in topics:
        if not _TOPIC.fullmatch(topic) or "//" in topic or len(topic) > 200:
            raise MapError(f"{prefix}.topic has {topic[:120]!r}, which is no topic")
    msgtype = values[f"{prefix}.type"]
    if msgtype and not _TYPE.fullmatch(msgtype):
        raise MapError(f"{prefix}.type is {msgtype[:120]!r}; it must be a type such as sensor_msgs/msg/Imu")
    msgtype = full_name(msgtype) if msgtype else ""
    unit = values[f"{prefix}.unit"] or next(iter(quantity.units))
    radius = values.get(f"{prefix}.radius", 0.0)
    if unit in quantity.linear and name == "speed" and not radius:
        raise MapError(f"{prefix}.unit is {unit!r}, and {prefix}.radius is {radius:g}; give the rolling radius in m")
    fields = tuple(text for text in values[f"{prefix}.field"] if text)
    stamp, signs, zeros = (values[f"{prefix}.{aspect}"] for aspect in ("stamp", "sign", "zero"))
    if any(not 1e-9 <= abs(sign) <= 1e9 for sign in signs):
        raise MapError(f"{prefix}.sign is {list(signs)}; each must be 1.0, -1.0, or another factor")
    if quantity.size:
        if len(topics) > 1 or _WHEEL in topics[0]:
            raise MapError(f"{prefix}.topic is {list(topics)}; it must be one topic")
        _check_count(prefix, "sign", signs, quantity.size)
        _check_count(prefix, "zero", zeros, quantity.size)
        fields = fields or (_IMU if name == "imu" else ())
        if not fields:
            raise MapError(f"{prefix}.field is empty; it must name the field")
        return [Source(name, topics[0], msgtype, fields, unit, (), False, stamp, signs, zeros, None)]
    given = tuple(text for text in values[f"{prefix}.order"] if text)
    order = given or wheels
    for wheel in order:
        if wheel not in wheels:
            raise MapError(f"{prefix}.order has {wheel[:120]!r}, which is no wheel; wheels has {', '.join(wheels)}")
    if len(set(order)) < len(order):
        raise MapError(f"{prefix}.order is {list(order)}; no wheel may stand twice")
    if not fields:
        raise MapError(f"{prefix}.field is empty; it must name the field")
    _check_count(prefix, "sign", signs, len(order))
    _check_count(prefix, "zero", zeros, len(order))
    places = tuple(wheels.index(wheel) for wheel in order)
    if len(topics) == 1 and _WHEEL in topics[0]:
        topics = tuple(topics[0].replace(_WHEEL, wheel) for wheel in order)
    elif len(topics) == 1:
        return [Source(name, topics[0], msgtype, fields, unit, places, not given, stamp, signs, zeros, None)]
    _check_count(prefix, "topic", topics, len(order))
    if len(fields) not in (1, len(order)):
        raise MapError(
            f"{prefix}.field has {len(fields)} entries; it must have one, or {len(order)}, one for each wheel"
        )
    return [
        Source(
            name, topic, msgtype, (fields[k % len(fields)].replace(_WHEEL, wheels[place]),), unit, (place,), False,
            stamp, _one_of(signs, k), _one_of(zeros, k), place,
        )
        for k, (topic, place) in enumerate(zip(topics, places, strict=True))
    ]  # fmt: skip


def _one_of(entries: tuple[float, ...], k: int) -> tuple[float, ...]:
    return entries[k % len(entries) : k % len(entries) + 1] if entries else ()


def _check_count(prefix: str, aspect: str, entries: Sequence[Any], count: int) -> None:
    if len(entries) not in (0, 1, count):
        raise MapError(f"{prefix}.{aspect} has {len(entries)} entries; it must have one, or {count}")


# -- with the definitions of the messages -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Values:
    """What becomes of some slots: of which quantity they are, of which wheels, and what makes SI of them: a factor and
    a shift.

    ``wheel`` is that of a topic that one wheel has for itself.
    """

    quantity: str
    first: int
    wheels: tuple[int, ...]
    scales: tuple[float, ...]
    shifts: tuple[float, ...]
    wheel: int | None


@dataclass(frozen=True)
class MappedTopic:
    """A topic with its plan; its values stand in slots of a row that all topics share."""

    topic: str
    msgtype: str
    plan: FieldPlan
    values: tuple[Values, ...]
    stamp: str


def mapped_topics(
    values: Mapping[str, Any], definitions: Mapping[str, str], types: Mapping[str, str]
) -> list[MappedTopic]:
    """Each mapped topic with its plan.

    Parameters
    ----------
    values : mapping
        All parameters.
    definitions : mapping
        Texts by message type.
    types : mapping
        Message type by topic, of those topics whose type the parameters leave out.

    Raises
    ------
    MapError
        A field is not there, or cannot be what it is to be; the message names those that are.
    """
    by_topic: dict[str, list[Source]] = {}
    for source in sources(values):
        by_topic.setdefault(source.topic, []).append(source)
    kinds, slot, found = mapped_types(values), 0, []
    for topic, some in by_topic.items():
        msgtype = kinds[topic] or types.get(topic, "")
        if not msgtype:
            raise MapError(f"inputs.{some[0].quantity}.type is empty; it must name the type of {topic}")
        if msgtype not in definitions:
            raise MapError(
                f"inputs.{some[0].quantity}.type is {msgtype!r}, whose definition is not there: its package is not "
                "installed, and no bag has it"
            )
        try:
            fields = parse_definition(definitions[msgtype], msgtype)
        except MessageError as error:
            raise MapError(f"{topic}: {error}") from None
        stamps = {source.stamp for source in some}
        if len(stamps) > 1:
            raise MapError(f"{topic} has several stamps, {' and '.join(map(repr, sorted(stamps)))}; it must have one")
        wanted: list[tuple[str, list[int]]] = []
        groups = []
        for source in some:
            paths = _paths(source, fields, msgtype, values)
            count = sum(width for _, width in paths)
            groups.append(_group(source, slot, count, values))
            for path, width in paths:
                wanted.append((path, list(range(slot, slot + width))))
                slot += width
        try:
            stamp, unit = _stamp(some[0].stamp, fields, msgtype)
            plan = make_plan(fields, msgtype, wanted, stamp, unit)
        except PlanError as error:
            raise MapError(f"inputs.{some[0].quantity}, {topic}: {msgtype} {error}") from None
        found.append(MappedTopic(topic, msgtype, plan, tuple(groups), stamp))
    return found


def _stamp(text: str, fields: Types, msgtype: str) -> tuple[str, int]:
    """The path of the stamp, and the nanoseconds in its unit; an empty path for the time of receipt."""
    if text == "receipt":
        return "", 0
    if not text or text == "header":
        own = {field.name: field for field in fields[full_name(msgtype)]}
        if "header" in own and own["header"].kind == "std_msgs/msg/Header" and own["header"].length == SINGLE:
            return "header.stamp", 0
        if text:
            raise PlanError("has no header")
        if "stamp" in own and own["stamp"].kind == "builtin_interfaces/msg/Time" and own["stamp"].length == SINGLE:
            return "stamp", 0
        return "", 0
    path, _, unit = text.partition(" ")
    if unit and unit not in _STAMP_UNITS:
        raise PlanError(f"has no stamp {text!r}: behind the field stands s, ms, us or ns")
    return path, _STAMP_UNITS.get(unit, 0)


def _paths(source: Source, fields: Types, msgtype: str, values: Mapping[str, Any]) -> list[tuple[str, int]]:
    """The paths of a source's values in their order, and how many values each has."""
    wheels, quantity = values["wheels"], QUANTITIES[source.quantity]
    texts: Iterable[str] = source.fields
    count = quantity.size or len(source.order)
    if not quantity.size and len(source.fields) == 1 and _WHEEL in source.fields[0]:
        texts = [source.fields[0].replace(_WHEEL, wheels[place]) for place in source.order]
    found: list[tuple[str, int]] = []
    for text in texts:
        try:
            leaf = find_field(fields, msgtype, text)
        except PlanError as error:
            raise MapError(f"{source.where}: {msgtype} {error}") from None
        if leaf.field.is_number:
            last = leaf.steps[-1]
            if (
                source.by_name
                and last.element == EVERY
                and len(source.fields) == 1
                and _has_names(fields, msgtype, text)
            ):
                joints = values["joint_names"]
                found += [(f"{text}[{joints[place]}]", 1) for place in source.order]
            elif leaf.length == SINGLE:
                found.append((text, 1))
            else:
                if len(source.fields) > 1:
                    raise MapError(f"{source.where}: {text!r} has many elements; give one of them, or it alone")
                if leaf.length > SINGLE and leaf.length < count:
                    raise MapError(f"{source.where}: {text!r} has {leaf.length} elements; {count} are wanted")
                found.append((text, count))
        elif leaf.length == SINGLE and {"x", "y", "z"} <= {each.name for each in fields.get(leaf.field.kind, ())}:
            found += [(f"{text}.{axis}", 1) for axis in "xyz"]
        else:
            raise MapError(f"{source.where}: {text!r} is no number")
    total = sum(width for _, width in found)
    if total != count:
        of = f"for {', '.join(wheels[place] for place in source.order)}" if source.order else "in all"
        raise MapError(f"{source.where}: {', '.join(source.fields)} gives {total} numbers; {count} are wanted, {of}")
    return found


def _has_names(fields: Types, msgtype: str, text: str) -> bool:
    return "." not in text and any(
        each.kind == "string" and each.length != SINGLE for each in fields[full_name(msgtype)]
    )


def _group(source: Source, first: int, count: int, values: Mapping[str, Any]) -> Values:
    quantity, unit = QUANTITIES[source.quantity], source.unit
    if source.quantity == "imu":
        force, rate = unit.split(" ")
        scales = [_ACCELERATIONS[force]] * 3 + [_RATES[rate]] * 3
    elif unit in quantity.linear:
        scales = [quantity.linear[unit] / values["inputs.speed.radius"]] * count
    else:
        scales = [quantity.units[unit]] * count
    signs = source.signs or (1.0,)
    scales = [scale * signs[k % len(signs)] for k, scale in enumerate(scales)]
    zeros = source.zeros or (0.0,)
    shifts = tuple(-zeros[k % len(zeros)] * scale + 0.0 for k, scale in enumerate(scales))
    return Values(source.quantity, first, source.order, tuple(scales), shifts, source.wheel)
