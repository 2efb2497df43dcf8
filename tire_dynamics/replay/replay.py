"""A bag through the same logic as the live node, as fast as it goes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from ..bag import BagReader, BagWriter
from ..bag.writer import keep_apart
from ..cdr import messages
from ..files.errors import InputError
from .bag_setup import bag_setup, check, log_record, pipeline_of
from .doubts import InputDoubts
from .events import between_records, received_events, recorded_events
from .input_watch import doubts_of, watched
from .inputs import reasons
from .pipeline import LOG_RECORD, TF_STATIC, TICK, Events, Pipeline

__all__ = ["Summary", "replay"]

_MAY_CHANGE = ("tire.", "ring_shape_scale")  # the parameters that outputs depend on and that may change in a log


class Summary(NamedTuple):
    """What a replay did: messages read and written by topic, the parameters, and what is wrong with the bag.

    ``without`` says of wheels that have no outputs why, ``doubts`` what is odd: of wheels whose motion diverged, and,
    but of a log of the node, of the speeds and loads.
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
    config: str | PathLike[str] | Mapping[str, Any] | None = None,
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
    config : path or mapping, optional
        Parameters, by name or as :func:`~tire_dynamics.replay.parameters.read_config` takes them. What it leaves out
        is a log's own, and for any other bag the default, with the wheels that its topics name.
    inputs : path, optional
        A field map, as :func:`~tire_dynamics.replay.parameters.read_inputs` takes it, over those parameters.
    vehicle : path, optional
        A car, as :func:`~tire_dynamics.read_vehicle` takes it: its loads are estimated (``load_source: estimate``).
    force : bool
        Replace an output that exists.
    quiet : bool
        Show no progress, not even on a terminal.
    remaps, joints : mapping, optional
        As :func:`~tire_dynamics.replay.bag_setup.bag_setup` takes them.
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
    how = bag_setup(reader, config, remaps, joints, inputs, vehicle)
    values, names, log = how
    pipeline = pipeline_of(reader, how)
    if log is None:
        check(reader, how, pipeline.mapped)
    seen = InputDoubts(reader, pipeline.values, names) if log is None else None
    if clock is None and log is not None and log["parameters"].get("rate_hz") == pipeline.values["rate_hz"]:
        blocks = recorded_events(reader, names, pipeline, quiet)
    else:
        blocks = received_events(reader, names, pipeline, seen, quiet)
    try:
        received, written = _run(pipeline, blocks, names, Path(output), force, own_parameters=config is None)
    except messages.MessageError as error:  # of a tick; inputs that are malformed are counted
        raise InputError(f"{source}: {error}") from None
    except _NothingError as error:
        found = reasons(reader, values, names, pipeline.values["wheels"], pipeline.mapped)
        said = "; ".join(f"{wheel}: {why}" for wheel, why in found.items())
        raise InputError(f"{error}; {said}") from None
    still = [wheel for wheel in pipeline.values["wheels"] if not written[f"{wheel}/axle_wrench"]]
    without = reasons(reader, values, names, still, pipeline.mapped)
    doubts = [] if seen is None else seen.doubts()
    if seen is not None and pipeline.mapped:
        doubts += doubts_of(pipeline.take_sums(), pipeline.values, watched(pipeline.values))
        doubts += pipeline.motion.ever.values() if pipeline.motion is not None else ()
    doubts += [
        f"{wheel}: its motion grew beyond all bounds, and has outputs again only where the tire is not unstable; "
        "tire-dynamics stability says where it is"
        for wheel, inputs in zip(pipeline.values["wheels"], pipeline.vehicle.inputs, strict=True)
        if inputs.divergences
    ]
    return Summary(received, written, pipeline.values, reader.damage, without, doubts)


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
        for events in between_records(blocks):
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
