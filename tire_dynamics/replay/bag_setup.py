"""How a bag is replayed: which parameters count, which topics are the inputs, whether it is a log of the node."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from typing import Any, NamedTuple

from ..bag import BagReader
from ..cdr import messages
from ..files.errors import InputError
from .input_map import MappedTopic, mapped_types, sources, without_absent
from .inputs import first_reasons, hint
from .parameters import CAR, NODE_NAME, complete, read_car, read_config, read_inputs
from .pipeline import LOG_RECORD, TICK, Pipeline, fixed_inputs, output_types

__all__ = [
    "MAP_RECORD", "BagSetup", "bag_setup", "check", "joints_of", "log_record", "log_topic", "pipeline_of", "remaps_of",
]  # fmt: skip

MAP_RECORD = "tire_dynamics.inputs"
"""Name of the metadata record with a bag's own field map, as JSON."""


class BagSetup(NamedTuple):
    """How a bag is replayed: all parameters, full names by the topics' relative ones, and the first log record."""

    values: dict[str, Any]
    names: dict[str, str]
    log: dict[str, Any] | None


def bag_setup(
    reader: BagReader,
    config: str | PathLike[str] | Mapping[str, Any] | None = None,
    remaps: Mapping[str, str] | None = None,
    joints: Mapping[str, str] | None = None,
    inputs: str | PathLike[str] | None = None,
    vehicle: str | PathLike[str] | None = None,
) -> BagSetup:
    """How a bag would be replayed; of its messages only the first log record is read.

    Parameters
    ----------
    reader : BagReader
    config : path or mapping, optional
        As :func:`~tire_dynamics.replay.replay.replay` takes it.
    remaps : mapping, optional
        Topics of the bag by the inputs that they are to be: ``{"front_left/load": "/fl/force_torque"}``.
    joints : mapping, optional
        Names in ``joint_states`` by wheel, instead of those of the parameters: ``{"front_left": "fl_wheel_joint"}``.
    inputs, vehicle : path, optional
        As :func:`~tire_dynamics.replay.replay.replay` takes them.

    Raises
    ------
    InputError
        It cannot be replayed; the reason says what is missing.
    """
    remaps = dict(remaps or {})
    log = _log_of(reader, must=config is None)
    own = config if isinstance(config, Mapping) else {} if config is None else read_config(config)
    given = {**(log["parameters"] if log is not None else {}), **own}
    if log is None and (field_map := _own_map(reader)):
        given = {**field_map, **given}
    given.update(read_inputs(inputs) if inputs is not None else {})
    given.update(read_car(vehicle) if vehicle is not None else {})
    if "wheels" not in given:
        mapped = any(name.startswith("inputs.") and name.endswith(".topic") and given[name] for name in given)
        is_car = mapped or given.get("load_source") == "estimate"
        given = {**given, "wheels": CAR if is_car else _wheels(reader, remaps)}
    try:
        values = complete(given)
        if joints:
            values = complete({**values, "joint_names": _joint_names(values, joints)})
        if log is None:
            values = without_absent(values, lambda topic: topic not in remaps and not _holds(reader, topic))
    except ValueError as error:
        raise InputError(f"{reader.path}: {error}") from None
    return BagSetup(values, _names(reader, values, log, remaps), log)


def _own_map(reader: BagReader) -> dict[str, Any]:
    """The field map that an import has written into a bag."""
    text = reader.metadata.get(MAP_RECORD, {}).get("parameters", "{}")
    try:
        values = json.loads(text)
        if not all(name in ("wheels", "joint_names") or name.startswith("inputs.") for name in values):
            raise ValueError
        return dict(values)
    except (ValueError, TypeError, AttributeError, RecursionError):
        raise InputError(f"{reader.path}: its own field map is damaged") from None


def _holds(reader: BagReader, topic: str) -> bool:
    return any(name == topic or not topic.startswith("/") and name.endswith(f"/{topic}") for name in reader.topics)


def pipeline_of(reader: BagReader, how: BagSetup) -> Pipeline:
    """The pipeline that a bag is replayed through; of mapped topics, the bag says what their messages are.

    Raises
    ------
    InputError
        The parameters cannot be used, or a field is not in the messages of the bag.
    """
    types = {topic: reader.topics[how.names[topic]] for topic in mapped_types(how.values)}
    definitions = {kind: text for kind in set(types.values()) if (text := reader.definition(kind)) is not None}
    try:
        return Pipeline(how.values, definitions, types)
    except ValueError as error:
        raise InputError(f"{reader.path}: {error}") from None


def check(reader: BagReader, how: BagSetup, mapped: Sequence[MappedTopic]) -> dict[str, str]:
    """See that the first messages of a bag's inputs can be used: their encoding, clocks, joints and velocities.

    Parameters
    ----------
    reader : BagReader
    how : BagSetup
    mapped : sequence of MappedTopic
        As of the pipeline.

    Returns
    -------
    dict
        By wheel, why it will have no outputs; those for which nothing says so are not in it.

    Raises
    ------
    InputError
        No wheel can have outputs; the reason says why, and what helps.
    """
    found = first_reasons(reader, how.values, how.names, mapped)
    if len(found) == len(how.values["wheels"]):
        wheels: dict[str, list[str]] = {}
        for wheel, reason in found.items():
            wheels.setdefault(reason, []).append(wheel)
        raise InputError(f"{reader.path}: " + "; ".join(f"{', '.join(names)}: {why}" for why, names in wheels.items()))
    return found


def _joint_names(values: Mapping[str, Any], joints: Mapping[str, str]) -> list[str]:
    """The wheels' joints with those that are given."""
    wheels = values["wheels"]
    for wheel in joints:
        if wheel not in wheels:
            raise InputError(f"--joint: {wheel} is no wheel; the wheels are {', '.join(wheels)}")
    return [joints.get(wheel, name) for wheel, name in zip(wheels, values["joint_names"], strict=True)]


def joints_of(texts: Iterable[str]) -> dict[str, str]:
    """Joint by wheel, of texts such as ``front_left:=fl_wheel_joint``."""
    joints = {}
    for text in texts:
        wheel, sign, name = text.partition(":=")
        if not (wheel and sign and name):
            raise InputError(f"--joint is {text!r}; it must be WHEEL:=NAME, as in front_left:=fl_wheel_joint")
        joints[wheel] = name
    return joints


def remaps_of(texts: Iterable[str]) -> dict[str, str]:
    """Topic of the bag by input, of texts such as ``front_left/load:=/fl/force_torque``."""
    remaps = {}
    for text in texts:
        topic, sign, name = text.partition(":=")
        if not (topic and sign and name):
            raise InputError(f"--remap is {text!r}; it must be INPUT:=TOPIC, as in front_left/load:=/fl/force_torque")
        remaps[topic.strip("/")] = f"/{name.lstrip('/')}"
    return remaps


def _log_of(reader: BagReader, must: bool) -> dict[str, Any] | None:
    """The first log record, if the bag is a log of the node; one that is damaged is none unless it ``must`` be read."""
    topic = log_topic(reader)
    if topic is None:
        return None
    for message in reader.messages([topic]):
        try:
            return log_record(message[4])
        except InputError:
            if must:
                raise
            return None
    return None


def log_topic(reader: BagReader) -> str | None:
    """The topic of the log records, if the bag is a log of the node."""
    ending = LOG_RECORD.removeprefix("~")
    found = [name for name, msgtype in reader.topics.items() if name.endswith(ending) and msgtype == messages.STRING]
    if len(found) > 1:
        raise InputError(
            f"{reader.path}: holds logs of several nodes ({', '.join(found)}); one is read: record each by itself, or "
            "take the topics of one with ros2 bag convert"
        )
    return found[0] if found else None


def log_record(data: bytes) -> dict[str, Any]:
    """What a log record says."""
    try:
        content = json.loads(messages.decode_string(data))
        parameters, topics, vehicle = (content[name] for name in ("parameters", "topics", "vehicle"))
        texts = [*topics, *topics.values()]
        dicts = (parameters, vehicle, content.get("dropped", {}))
        if all(isinstance(each, dict) for each in dicts) and all(isinstance(text, str) for text in texts):
            return dict(content)
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError):
        pass
    raise InputError("the log's record of its parameters is damaged; --config gives them anew")


def _wheels(reader: BagReader, remaps: Mapping[str, str]) -> list[str]:
    """The wheels that the bag's load or road topics name, front_left of /car/front_left/load, or ``remaps`` do."""
    kinds = {"load": messages.WRENCH_STAMPED, "load_force": messages.FLOAT64, "road_height": messages.FLOAT64}
    parts = {name: name.split("/") for name in reader.topics}
    wheels = [part[-2] for name, part in parts.items() if len(part) > 2 and reader.topics[name] == kinds.get(part[-1])]
    wheels += [wheel for wheel, _, name in (topic.rpartition("/") for topic in remaps) if wheel and name in kinds]
    if not wheels:
        wanted = " or ".join(f"<wheel>/{name} of {kind}" for name, kind in kinds.items())
        could_be = [name for kind in kinds.values() for name in reader.topics if reader.topics[name] == kind]
        example = (
            ""
            if not could_be
            else f"; if {could_be[0]} is a wheel's load: --remap wheel/{_load_of(reader, could_be[0])}"
        )
        raise InputError(
            f"{reader.path}: has no topic {wanted}{_encoded(reader)}{example}; its topics: {_listed(reader.topics)}"
        )
    return sorted(set(wheels))


def _encoded(reader: BagReader) -> str:
    """Of topics that cannot be read: which, how they are encoded, and what helps."""
    others = [name for name, encoding in reader.encodings.items() if encoding != "cdr"]
    if not others:
        return ""
    encoding = reader.encodings[others[0]]
    more = f" and {len(others) - 1} more" if len(others) > 1 else ""
    return f" that can be read: {others[0]}{more} are encoded as {encoding}, and only cdr is read{hint(encoding)}"


def _load_of(reader: BagReader, name: str) -> str:
    """The remap that makes a topic a load."""
    return f"{'load' if reader.topics[name] == messages.WRENCH_STAMPED else 'load_force'}:={name}"


def _names(
    reader: BagReader, values: Mapping[str, Any], log: Mapping[str, Any] | None, remaps: Mapping[str, str]
) -> dict[str, str]:
    """Full names in the bag by the relative names of all topics."""
    node, wheels, load_source = f"/{NODE_NAME}", values["wheels"], values["load_source"]
    names = {TICK: f"{node}/tick", LOG_RECORD: f"{node}/log_record"}
    types = fixed_inputs(values)
    mapped = {source.quantity for source in sources(values)}
    types.update({topic: kind for topic, kind in mapped_types(values).items() if topic not in types})
    for topic, name in remaps.items():
        if topic not in types:
            raise InputError(f"--remap: {topic} is no input; the inputs are {', '.join(types)}")
        if name not in reader.topics:
            raise InputError(
                f"{reader.path}: has no topic {name}, which --remap names; its topics: {_listed(reader.topics)}"
            )
    for topic, msgtype in types.items():
        known = remaps.get(topic) or (log or {}).get("topics", {}).get(topic)
        if known is None and (topic.startswith("/") or f"/{topic}" in reader.topics):
            known = f"/{topic.lstrip('/')}"
        found = [name for name in reader.topics if (name == known if known else name.endswith(f"/{topic}"))]
        if len(found) > 1:
            several = ", ".join(sorted(found))
            raise InputError(
                f"{reader.path}: several topics could be {topic}: {several}; "
                f"--remap {topic}:={sorted(found)[0]} takes one"
            )
        if not found and topic in mapped_types(values):
            raise InputError(
                f"{reader.path}: has no topic {known or topic}, which the field map names{_encoded(reader)}; "
                f"its topics: {_listed(reader.topics)}"
            )
        names[topic] = found[0] if found else f"/{topic}"
        if found and msgtype and reader.topics[found[0]] != msgtype:
            raise InputError(f"{reader.path}: {found[0]} is {reader.topics[found[0]]}; it must be {msgtype}")
    kinds = {"road": ("road_height",), "topic": ("load", "load_force")}.get(load_source, ())
    for wheel in wheels:
        loads = [topic for kind in kinds if names.get(topic := f"{wheel}/{kind}") in reader.topics]
        if kinds and not loads and not mapped & {"load", "road_height"}:
            known = {"topic": mapped & {"imu", "travel", "hub_acceleration"}}.get(load_source)
            estimated = "; if it has none: replay --vehicle config/car.yaml has them estimated" if known else ""
            raise InputError(
                f"{reader.path}: has no topic {' or '.join(f'{wheel}/{kind}' for kind in kinds)}; if it has another "
                f"name there: --remap {wheel}/{kinds[0]}:=/its/name{estimated}; its topics: {_listed(reader.topics)}"
            )
        ending = loads[0].removeprefix(wheel) if loads else "/"
        beside = names[loads[0]].removesuffix(ending) if loads and names[loads[0]].endswith(ending) else f"/{wheel}"
        for output in output_types(values):
            names[f"{wheel}/{output}"] = f"{beside}/{output}"
    if log is not None:
        names.update({topic: name for topic, name in log["topics"].items() if topic in names and topic not in remaps})
    _see_apart(reader, names, remaps)
    speeds = [names.get(topic) for topic in ("joint_states", *(f"{wheel}/wheel_speed" for wheel in wheels))]
    if "speed" not in mapped and not any(name in reader.topics for name in speeds):
        present = _listed(reader.topics)
        raise InputError(
            f"{reader.path}: has neither joint_states nor <wheel>/wheel_speed; if the speeds have another name there: "
            f"--remap joint_states:=/its/name; its topics: {present}"
        )
    return names


def _see_apart(reader: BagReader, names: Mapping[str, str], remaps: Mapping[str, str]) -> None:
    """See that no topic of the bag is to be two things; ``InputError`` that names both if one is."""
    known: dict[str, str] = {}
    for topic, name in names.items():
        if (other := known.setdefault(name, topic)) != topic:
            how = "--remap makes" if {topic, other} & remaps.keys() else "the bag has"
            raise InputError(f"{reader.path}: {how} {name} both {other} and {topic}; each needs a topic of its own")


def _listed(topics: Iterable[str]) -> str:
    return ", ".join(sorted(topics)) or "none"
