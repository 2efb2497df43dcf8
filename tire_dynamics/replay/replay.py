"""A bag through the same logic as the live node, as fast as it goes."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bag import BagReader, BagWriter, Block
from ..bag.writer import keep_apart
from ..cdr import messages
from ..files.errors import InputError
from ..files.progress import progress
from .doubts import InputDoubts
from .input_map import mapped_types, sources, without_absent
from .input_watch import doubts_of, watched
from .inputs import first_reasons, hint, reasons
from .parameters import CAR, NODE_NAME, complete, read_car, read_config, read_inputs
from .pipeline import LOG_RECORD, TF_STATIC, TICK, Events, Pipeline, fixed_inputs, output_types

__all__ = [
    "Plan", "Summary", "check", "joints_of", "log_record", "log_topic", "pipeline_of", "plan", "remaps_of", "replay"
]  # fmt: skip

IntArray = NDArray[np.int64]

_MAY_CHANGE = ("tire.", "ring_shape_scale")  # the parameters that outputs depend on and that may change in a log
_LEAST = 4096  # messages that are taken together; more cost memory and save nothing


class Summary(NamedTuple):
    """What a replay did: messages read and written by topic, the parameters, and what is wrong with the bag.

    ``without`` says of wheels that have no outputs why, ``doubts`` what is odd about the speeds and loads. Of a log of
    the node there are no doubts.
    """

    received: dict[str, int]
    written: dict[str, int]
    parameters: dict[str, Any]
    damage: str
    without: dict[str, str]
    doubts: list[str]


def replay(
    source: str | PathLike[str],
    output: str | PathLike[str],
    *,
    config: str | PathLike[str] | None = None,
    inputs: str | PathLike[str] | None = None,
    vehicle: str | PathLike[str] | None = None,
    force: bool = False,
    quiet: bool = False,
    remaps: Mapping[str, str] | None = None,
    joints: Mapping[str, str] | None = None,
    clock: str | None = None,
) -> Summary:
    """Run a bag through the estimator into a new bag, which is a log like the live node's.

    Parameters
    ----------
    source : path
        A rosbag2 folder, or a .mcap, .db3 or ROS 1 .bag file: a recording of the inputs, or a log of the node.
    output : path
        The rosbag2 folder to write: the inputs as they were, every output, and what a further replay needs.
    config : path, optional
        Parameters, as :func:`~tire_dynamics.replay.parameters.read_config` takes them. What it leaves out is a
        log's own, and for any other bag the default, with the wheels that its topics name.
    inputs : path, optional
        A field map, as :func:`~tire_dynamics.replay.parameters.read_inputs` takes it, over those parameters.
    vehicle : path, optional
        A car, as :func:`~tire_dynamics.read_vehicle` takes it: its loads are estimated (``load_source: estimate``).
    force : bool
        Replace an output that exists.
    quiet : bool
        Show no progress, not even on a terminal.
    remaps, joints : mapping, optional
        As :func:`plan` takes them.
    clock : {"stamp", "log"}, optional
        One clock for stamps and log times, as :class:`~tire_dynamics.bag.BagReader` takes it: ``stamp`` for
        recordings of simulated time. The output has the inputs on that clock.

    Returns
    -------
    Summary

    Raises
    ------
    InputError
        The bag, the parameters or the output cannot be used, or the bag never has a fresh speed and load.

    Notes
    -----
    A log is followed event by event in the order in which the node computed, with its ticks at its times, so
    that its outputs come out again bit for bit; if the parameters ask for another ``rate_hz``, and for every
    other bag, the ticks come at the multiples of the period, each after the messages received until then.
    Memory does not grow with the bag.
    """
    reader = BagReader(source, clock)
    keep_apart(reader.path, reader.paths, Path(output))
    how = plan(reader, config, remaps, joints, inputs, vehicle)
    values, names, log = how
    if log is None:
        check(reader, how)
    pipeline = pipeline_of(reader, how)
    seen = InputDoubts(reader, pipeline.values, names) if log is None else None
    if clock is None and log is not None and log["parameters"].get("rate_hz") == pipeline.values["rate_hz"]:
        blocks = _recorded(reader, names, pipeline, quiet)
    else:
        blocks = _received(reader, names, pipeline, seen, quiet)
    try:
        received, written = _run(pipeline, blocks, names, Path(output), force, own_parameters=config is None)
    except messages.MessageError as error:  # of a tick; inputs that are malformed are counted
        raise InputError(f"{source}: {error}") from None
    except _NothingError as error:
        found = reasons(reader, values, names, pipeline.values["wheels"])
        said = "; ".join(f"{wheel}: {why}" for wheel, why in found.items())
        raise InputError(f"{error}; {said}") from None
    still = [wheel for wheel in pipeline.values["wheels"] if not written[f"{wheel}/axle_wrench"]]
    without = reasons(reader, values, names, still)
    doubts = [] if seen is None else seen.doubts()
    if seen is not None and pipeline.mapped:
        doubts += doubts_of(pipeline.take_sums(), pipeline.values, watched(pipeline.values))
    return Summary(received, written, pipeline.values, reader.damage, without, doubts)


class Plan(NamedTuple):
    """How a bag is replayed: all parameters, full names by the topics' relative ones, and the first log record."""

    values: dict[str, Any]
    names: dict[str, str]
    log: dict[str, Any] | None


def plan(
    reader: BagReader,
    config: str | PathLike[str] | None = None,
    remaps: Mapping[str, str] | None = None,
    joints: Mapping[str, str] | None = None,
    inputs: str | PathLike[str] | None = None,
    vehicle: str | PathLike[str] | None = None,
) -> Plan:
    """How a bag would be replayed; of its messages only the first log record is read.

    Parameters
    ----------
    reader : BagReader
    config : path, optional
        As :func:`replay` takes it.
    remaps : mapping, optional
        Topics of the bag by the inputs that they are to be: ``{"front_left/load": "/fl/force_torque"}``.
    joints : mapping, optional
        Names in ``joint_states`` by wheel, instead of those of the parameters: ``{"front_left": "fl_wheel_joint"}``.
    inputs, vehicle : path, optional
        As :func:`replay` takes them.

    Raises
    ------
    InputError
        It cannot be replayed; the reason says what is missing.
    """
    remaps = dict(remaps or {})
    log = _log_of(reader, must=config is None)
    given = {**(log["parameters"] if log is not None else {}), **(read_config(config) if config is not None else {})}
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
    return Plan(values, _names(reader, values, log, remaps), log)


def _holds(reader: BagReader, topic: str) -> bool:
    return any(name == topic or not topic.startswith("/") and name.endswith(f"/{topic}") for name in reader.topics)


def pipeline_of(reader: BagReader, how: Plan) -> Pipeline:
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


def check(reader: BagReader, how: Plan) -> dict[str, str]:
    """See that the first messages of a bag's inputs can be used: their encoding, clocks, joints and velocities.

    Parameters
    ----------
    reader : BagReader
    how : Plan

    Returns
    -------
    dict
        By wheel, why it will have no outputs; those for which nothing says so are not in it.

    Raises
    ------
    InputError
        No wheel can have outputs; the reason says why, and what helps.
    """
    found = first_reasons(reader, how.values, how.names)
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


def _run(
    pipeline: Pipeline,
    blocks: Iterable[Events],
    names: Mapping[str, str],
    output: Path,
    force: bool,
    own_parameters: bool,
) -> tuple[dict[str, int], dict[str, int]]:
    """Messages read and written, by topic."""
    received: Counter[str] = Counter()
    written: Counter[str] = Counter()
    with (
        BagWriter(output, force=force, aside=True, chunk_size=2**20) as writer,
        ThreadPoolExecutor(1) as pool,  # what is written is compressed beside what is computed next
    ):
        writing: Future[None] | None = None
        handles = {
            topic: writer.add_topic(
                names[topic],
                msgtype,
                qos="sensor_data" if topic in pipeline.inputs else "default",
                definition=pipeline.definitions.get(msgtype),
            )
            for topic, msgtype in (
                *pipeline.inputs.items(), *pipeline.outputs.items(),
                (TICK, messages.CLOCK), (LOG_RECORD, messages.STRING),
            )
        }  # fmt: skip
        if pipeline.values["tf.parent_frame"]:
            handles[TF_STATIC] = writer.add_topic(TF_STATIC, messages.TF, qos="latched")
        begun, dropped = False, dict[str, int]()
        channels = {topic: handles[topic] for topic in (*pipeline.inputs, *pipeline.outputs, TICK)}
        for events in _between_records(blocks):
            first = events.topics[events.topic[0]]
            if first == LOG_RECORD:
                record = log_record(events.data[events.start[0] : events.start[0] + events.size[0]])
                _continue(pipeline, record, first=not begun, own_parameters=own_parameters)
                dropped = record.get("dropped", {})
            if first == LOG_RECORD or not begun:
                if writing is not None:
                    writing.result()
                times = int(events.received[0]), int(events.published[0])
                writer.write(handles[LOG_RECORD], *times, pipeline.record(names, dropped))
                if (transforms := pipeline.transforms(times[0])) is not None:
                    writer.write(handles[TF_STATIC], *times, transforms)
                begun = True
            if first == LOG_RECORD:
                continue
            records = pipeline.run(events, channels)
            every = records.received + records.written
            counts = {channels[topic]: count for topic, count in every.items() if topic in channels}
            span = int(events.received.min()), int(events.received.max())
            data = bytes(records.data)
            if writing is not None:
                writing.result()
            writing = pool.submit(writer.write_records, data, records.starts, counts, span)
            received.update(records.received)
            written.update(records.written)
        if writing is not None:
            writing.result()
        if not written:
            raise _NothingError(_why_nothing(pipeline, received))
    return (
        {topic: received[topic] for topic in pipeline.inputs},
        {topic: written[topic] for topic in pipeline.outputs},
    )


def _continue(pipeline: Pipeline, record: Mapping[str, Any], *, first: bool, own_parameters: bool) -> None:
    """Go on as the log's record says, with its tire and from its state.

    A record that is not the first stands where the tire was changed, or where messages had been lost before it. With
    other parameters than the log's own, the state is that of another system, and only the first is taken over.
    """
    try:
        if own_parameters:
            pipeline.set_values({k: v for k, v in record["parameters"].items() if k.startswith(_MAY_CHANGE)})
        same = all(record["parameters"][name] == list(pipeline.values[name]) for name in ("wheels", "joint_names"))
        if same and (first or own_parameters):
            pipeline.restore(record)
            if not own_parameters:  # what was found live is of another system, and what is found later not taken over
                pipeline.vehicle.wheels.judged_elsewhere = False
    except (OverflowError, LookupError, TypeError, ValueError) as error:
        raise InputError(f"the log's record of its parameters cannot be used: {error}") from None


class _NothingError(InputError):
    """No wheel had an output."""


def _why_nothing(pipeline: Pipeline, received: Counter[str]) -> str:
    if pipeline.malformed:
        topic, count = pipeline.malformed.most_common(1)[0]
        return f"no wheel ever had a speed and a load: {count} messages on {topic} are not what their type says"
    outcomes_of = [inputs.counts for inputs in pipeline.vehicle.inputs]
    counts = {
        f"{wheel}: {outcome}": count
        for wheel, counter in zip(pipeline.vehicle.settings.wheels, outcomes_of, strict=True)
        for outcome, count in counter.items()
    }
    seen = ", ".join(f"{topic} {received[topic]}" for topic in pipeline.inputs if received[topic]) or "no input"
    outcomes = f" ({', '.join(f'{outcome} {count}' for outcome, count in counts.items())})" if counts else ""
    if any(counter[why] for counter in outcomes_of for why in ("late", "in the future", "no stamp")):
        hint = "the stamps must be of the clock that the messages were received by"
    elif received["joint_states"] and not any(received[topic] for topic in received if topic.endswith("/wheel_speed")):
        hint = "--config can give joint_names as they stand in joint_states"
    else:
        hint = "--config can give a longer input_timeout_s"
    what = "a road height" if pipeline.vehicle.wheels.on_road else "a load"
    if pipeline.loads is not None:
        what = "an estimated load"
    return f"no wheel ever had a speed and {what} that were both fresh; {hint}; the bag has {seen}{outcomes}"


# -- what the bag holds -----------------------------------------------------------------------------------------


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
            present = _listed(reader.topics)
            raise InputError(
                f"{reader.path}: has no topic {' or '.join(f'{wheel}/{kind}' for kind in kinds)}; if it has another "
                f"name there: --remap {wheel}/{kinds[0]}:=/its/name; its topics: {present}"
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


# -- the order of events ----------------------------------------------------------------------------------------


def _between_records(blocks: Iterable[Events]) -> Iterator[Events]:
    """The events, :data:`LOG_RECORD` among them, cut such that each log record is one of its own."""
    for events in blocks:
        record = events.topics.index(LOG_RECORD) if LOG_RECORD in events.topics else -1
        records = np.flatnonzero(events.topic == record)
        edges = np.unique(np.concatenate([[0], records, records + 1, [events.topic.size]]))
        for first, last in itertools.pairwise(edges.tolist()):
            yield events.part(slice(first, last))


def _recorded(reader: BagReader, names: Mapping[str, str], pipeline: Pipeline, quiet: bool) -> Iterator[Events]:
    """A log's own events, in the order in which they were written."""
    relative = {name: topic for topic, name in names.items()}
    wanted = {names[topic] for topic in (TICK, LOG_RECORD, *pipeline.inputs)}
    blocks = reader.blocks(wanted & reader.topics.keys(), in_file_order=True, least=_LEAST)
    for block in progress(blocks, reader.message_count, "replay", size=_size, unit="messages", quiet=quiet):
        topics = tuple(relative.get(name, "") for name in block.topics)
        ticks = np.flatnonzero(block.topic == topics.index(TICK)) if TICK in topics else np.empty(0, np.int64)
        valid, times = messages.decode_clocks(block.data, block.start[ticks], block.size[ticks])
        if not valid.all():
            start = block.start[ticks[~valid][0]]
            messages.decode_clock(block.data[start : start + block.size[ticks[~valid][0]]])  # says why
        tick, published = np.zeros_like(block.log_time), block.publish_time.copy()
        tick[ticks] = published[ticks] = times
        yield Events(topics, block.topic, block.log_time, published, tick, block.data, block.start, block.size)


def _received(
    reader: BagReader, names: Mapping[str, str], pipeline: Pipeline, seen: InputDoubts | None, quiet: bool
) -> Iterator[Events]:
    """The inputs in the order of their receipt, and ticks between them, at the multiples of the period.

    Once nothing has been received for so long that every wheel has stopped, there are no ticks until something
    is: a pause of a year in the bag costs nothing.
    """
    period = pipeline.vehicle.settings.period
    silence = 2 * pipeline.vehicle.settings.input_timeout + period
    relative = {names[topic]: topic for topic in pipeline.inputs}
    due = last = None
    blocks = reader.blocks(relative.keys() & reader.topics.keys(), least=_LEAST)
    for block in progress(blocks, reader.message_count, "replay", size=_size, unit="messages", quiet=quiet):
        if seen is not None:
            seen.take(block)
        times = block.log_time
        if due is None or last is None:
            last = int(times[0])
            due = _up_to_multiple(last, period)
        ticks, due = _ticks_before(times, due, last, period, silence)
        last = int(times[-1])
        yield _with_ticks(block, tuple(relative.get(name, "") for name in block.topics), ticks)
    if due is not None and due == last:
        data = messages.encode_clock(due)
        moment, one = np.array([due]), np.zeros(1, np.int64)
        yield Events((TICK,), one, moment, moment, moment, data, one, one + len(data))


def _ticks_before(times: IntArray, due: int, last: int, period: int, silence: int) -> tuple[IntArray, int]:
    """The ticks before messages at ascending times, the next due and the last message before them given; the next."""
    pieces = []
    before = np.concatenate([[last], times[:-1]])
    pauses = np.flatnonzero(times - before > silence)
    for pause in [*pauses.tolist(), None]:
        end = int(times[-1] if pause is None else before[pause] + silence + 1)
        if end > due:
            piece = np.arange(due, end, period)
            pieces.append(piece)
            due = int(piece[-1]) + period
        if pause is not None:  # go on with the last tick before this message
            due = max(due, _up_to_multiple(int(times[pause]), period) - period)
    return np.concatenate([np.empty(0, np.int64), *pieces]), due


def _with_ticks(block: Block, topics: tuple[str, ...], ticks: IntArray) -> Events:
    """Messages and ticks in order; a tick is before the messages of later times."""
    encoded = messages.encode_clocks(ticks)
    size = len(encoded[0]) if encoded else 0
    place = np.searchsorted(block.log_time, ticks, side="right")
    start = len(block.data) + size * np.arange(ticks.size)
    columns = [
        np.insert(column, place, values)
        for column, values in (
            (block.topic, len(topics)), (block.log_time, ticks), (np.zeros_like(block.log_time), ticks),
            (block.start, start), (block.size, size), (block.publish_time, ticks),
        )
    ]  # fmt: skip
    data = block.data + b"".join(encoded)
    topic, received, tick, starts, sizes, published = columns
    return Events((*topics, TICK), topic, received, published, tick, data, starts, sizes)


def _size(block: Block) -> int:
    return block.topic.size


def _up_to_multiple(moment: int, period: int) -> int:
    return -(-moment // period) * period
