"""Why a wheel has no outputs: what a bag holds of its speed and its load, and what cannot be used of that.

Of what comes by a field map, too: how many numbers it takes, how often, and from where to where they reach.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime, timezone
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bag import BagReader
from ..bag.clock import stamps_of
from ..bag.fields import OTHER_FIELDS
from ..cdr import messages
from ..files.errors import InputError
from .input_map import QUANTITIES, MappedTopic, sources
from .mapped_messages import MappedMessages

__all__ = ["first_reasons", "hint", "mapped_values", "reasons"]

_FIRST = 500  # messages of a topic that are looked at before a replay
_MOST_NAMES = 30  # joints that are listed
_HEIGHT = "what a road height may be"
_JOINTS = "joint_states"
_MAPPED = "by the field map"
_MOVING = {"speed": "speed", "load": "load", "road_height": "load"}  # by quantity of the map, what a wheel needs
_BOUNDS = {"speed": "max_speed_rad_s", "load": "max_load_n", "road_height": _HEIGHT}
_COMPONENTS = {"imu": ("force_x", "force_y", "force_z", "rate_x", "rate_y", "rate_z"), "vehicle_speed": ("vehicle",)}

_OTHER_CLOCK = "stamps and times of receipt are of different clocks"
_TAKEN = "taken"
_NO_NUMBER = "no number"
_TOPICS = {
    "topic": ("wheel_speed", "load", "load_force"),
    "road": ("wheel_speed", "road_height"),
    "estimate": ("wheel_speed",),
}


class _Source:
    """What there is of one quantity of a wheel: how many messages, how many can be used, and why not the others."""

    def __init__(self) -> None:
        self.messages = 0
        self.outcomes: Counter[str] = Counter()
        self.text: dict[str, str] = {}  # more about an outcome

    def add(self, outcome: str, count: int, text: str = "") -> None:
        if count:
            self.outcomes[outcome] += count
            self.text.setdefault(outcome, text)


class _Tally:
    """Speeds and loads of some wheels, counted as the estimator would take them.

    Parameters
    ----------
    values : mapping
        All parameters.
    names : mapping
        Full names by relative topics.
    wheels : iterable of str
    mapped : sequence of MappedTopic
        What comes by the field map.
    with_values : bool
        Whether to look at the values too: of the first messages only, they say nothing of those to come.
    """

    def __init__(
        self,
        values: Mapping[str, Any],
        names: Mapping[str, str],
        wheels: Iterable[str],
        mapped: Sequence[MappedTopic],
        with_values: bool,
    ) -> None:
        self._values, self._with_values = {**values, _HEIGHT: 1e5}, with_values
        on_road = values["load_source"] == "road"
        self._named = {"speed": "speed", "load": "road height" if on_road else "load"}
        self._timeout = round(1e9 * values["input_timeout_s"])
        self._joints = dict(zip(values["wheels"], values["joint_names"], strict=True))
        self.sources = {(wheel, what): _Source() for wheel in wheels for what in ("speed", "load")}
        self.joint_names: dict[str, None] = {}  # in the order of their coming
        self.topics = {names[_JOINTS]: (_JOINTS, "")} if _JOINTS in names else {}
        for wheel in dict.fromkeys(wheel for wheel, _ in self.sources):
            for what in _TOPICS[values["load_source"]]:
                if (topic := f"{wheel}/{what}") in names:
                    self.topics[names[topic]] = what, wheel
        if values["load_source"] == "estimate":  # no wheel waits for its own
            for (_, what), source in self.sources.items():
                if what == "load":
                    source.messages += 1
                    source.add(_TAKEN, 1)
        for each in mapped:
            if {group.quantity for group in each.values} & _MOVING.keys():
                self.topics[names[each.topic]] = _MAPPED, each.topic
        self._groups = {each.topic: each.values for each in mapped}
        self._mapped = MappedMessages(list(mapped), len(values["wheels"]))
        self._where = {(each.topic, each.quantity): each.where for each in sources(values)}
        self._decoder = messages.JointStateDecoder()

    def add(self, topic: str, log_time: NDArray[np.int64], data: bytes, start: Any, size: Any) -> None:
        """Take messages of one topic."""
        what, wheel = self.topics[topic]
        if what == _JOINTS:
            self._joint_states(log_time, data, start, size)
        elif what == _MAPPED:
            self._by_map(wheel, log_time, data, start, size)
        elif what == "load":
            valid, stamp, fx, fz = messages.decode_wrenches(data, start, size)
            self._take((wheel, "load"), log_time, stamp, valid, np.stack([fz, fx], axis=1), "max_load_n")
        else:
            valid, number = messages.decode_float64s(data, start, size)
            key, bound = {
                "wheel_speed": ((wheel, "speed"), "max_speed_rad_s"),
                "load_force": ((wheel, "load"), "max_load_n"),
                "road_height": ((wheel, "load"), _HEIGHT),
            }[what]
            self._take(key, log_time, log_time, valid, number[:, None], bound)

    def _by_map(self, topic: str, log_time: NDArray[np.int64], data: bytes, start: Any, size: Any) -> None:
        samples = self._mapped.read(topic, log_time, data, start, size)
        for group in self._groups[topic]:
            if group.quantity not in _MOVING:
                continue
            for place in group.wheels:
                key = self._values["wheels"][place], _MOVING[group.quantity]
                if key not in self.sources:
                    continue
                column = samples.values[group.quantity][:, place]
                there = ~(samples.valid & np.isnan(column))
                self.sources[key].messages += len(column)
                self.sources[key].add(_NO_NUMBER, int((~there).sum()), self._where[topic, group.quantity])
                taken = log_time[there], samples.stamp[there], samples.valid[there], column[there, None]
                self._take(key, *taken, _BOUNDS[group.quantity], counted=True)

    def _joint_states(self, log_time: NDArray[np.int64], data: bytes, start: Any, size: Any) -> None:
        valid, stamp, groups = self._decoder.decode_block(data, start, size)
        for names in dict.fromkeys(names for _, names, _, _ in groups):
            self.joint_names.update(dict.fromkeys(names))
        for (wheel, what), source in self.sources.items():
            if what != "speed":
                continue
            source.messages += len(log_time)
            source.add("malformed", int((~valid).sum()))
            for some, names, velocities, _ in groups:
                joint = self._joints[wheel]
                if joint not in names:
                    source.add("no joint", len(some))
                elif velocities.shape[1] != len(names):
                    source.add("no velocity", len(some))
                else:
                    good = np.ones(len(some), bool)
                    column = velocities[:, [names.index(joint)]]
                    self._take(
                        (wheel, what), log_time[some], stamp[some], good, column, "max_speed_rad_s", counted=True
                    )

    def _take(
        self,
        key: tuple[str, str],
        log_time: NDArray[np.int64],
        stamp: NDArray[np.int64],
        valid: NDArray[np.bool_],
        values: NDArray[np.float64],
        bound: str,
        counted: bool = False,
    ) -> None:
        source = self.sources[key]
        source.messages += 0 if counted else len(log_time)
        source.add("malformed", int((~valid).sum()))
        apart = np.abs(np.where(stamp == 0, log_time, stamp) - log_time) > self._timeout
        other = valid & apart
        if other.any():
            first = int(np.flatnonzero(other)[0])
            text = f"stamp {_moment(int(stamp[first]))}, received {_moment(int(log_time[first]))}"
            source.add(_OTHER_CLOCK, int(other.sum()), text)
        good = valid & ~apart
        if self._with_values:
            finite = np.isfinite(values).all(axis=1)
            beyond = finite & (np.abs(values) > self._values[bound]).any(axis=1)
            source.add("not finite", int((good & ~finite).sum()))
            source.add(f"beyond {bound} ({self._values[bound]:g})", int((good & beyond).sum()))
            good &= finite & ~beyond
        source.add(_TAKEN, int(good.sum()))

    def reason(self, wheel: str, complete: bool) -> str | None:
        """Why a wheel has nothing to go by; None if nothing that was seen speaks against it."""
        for what in ("speed", "load"):
            source = self.sources[wheel, what]
            if not source.messages:
                return f"there is no message of its {self._named[what]}"
            if not source.outcomes[_TAKEN]:
                return self._why(wheel, what, source)
        return f"its speed and its {self._named['load']} were never fresh at the same time" if complete else None

    def _why(self, wheel: str, what: str, source: _Source) -> str:
        outcome, count = source.outcomes.most_common(1)[0]
        what = self._named[what]
        if outcome == "no joint" and len(source.outcomes) > 1:  # others' joints are nothing wrong
            outcome, count = source.outcomes.most_common(2)[1]
        if outcome == "no joint":
            joints = list(self.joint_names)
            listed = ", ".join(joints[:_MOST_NAMES]) + (" ..." if len(joints) > _MOST_NAMES else "")
            example = joints[0] if joints else "NAME"
            return (
                f"no joint of joint_states is named {self._joints[wheel]}; its joints: {listed or 'none'}; "
                f"--joint {wheel}:={example} takes one, as joint_names of --config does"
            )
        if outcome == "no velocity":
            return "its joint_states have no velocities"
        if outcome == _OTHER_CLOCK:
            return (
                f"{outcome} on its {what} ({source.text[outcome]}); --clock stamp takes the stamps for both, as of "
                "simulated time, --clock log the times of receipt"
            )
        if outcome == _NO_NUMBER:
            return f"{count} messages of its {what} have no number for it where {source.text[outcome]}, says"
        if outcome == "malformed":
            return f"{count} messages of its {what} are not what their type says"
        return f"its {what} was {outcome} {count} times"


def first_reasons(
    reader: BagReader, values: Mapping[str, Any], names: Mapping[str, str], mapped: Sequence[MappedTopic]
) -> dict[str, str]:
    """Why wheels can have no outputs, by the first messages of their inputs.

    Parameters
    ----------
    reader : BagReader
    values, names
        As of a :class:`~tire_dynamics.replay.bag_setup.BagSetup`.
    mapped : sequence of MappedTopic
        As of a :class:`~tire_dynamics.replay.pipeline.Pipeline`.

    Returns
    -------
    dict
        By wheel; those that may have outputs are not in it.
    """
    tally = _Tally(values, names, values["wheels"], mapped, with_values=False)
    for topic, (what, wheel) in tally.topics.items():
        if topic not in reader.topics or reader.counts[topic] == 0:
            continue
        encoding = reader.encodings[topic]
        if encoding == OTHER_FIELDS:
            raise InputError(
                f"{reader.path}: {topic} is said to be {reader.topics[topic]}, but the bag's own definition of that "
                "type has other fields; what its messages hold is not known"
            )
        if encoding != "cdr":
            raise InputError(f"{reader.path}: {topic} is encoded as {encoding}, and only cdr is read{hint(encoding)}")
        first = _first(reader, topic)
        if first is None:  # nothing is known
            for name in [wheel] if wheel in values["wheels"] else values["wheels"]:
                for each in ("speed", "load") if what == _MAPPED else (_kind_of(what),):
                    tally.sources[name, each].messages += 1
                    tally.sources[name, each].add(_TAKEN, 1)
            continue
        log_time, data, start, size = first
        if reader.clock is not None:  # then there is but one
            log_time = stamps_of(data, start) if reader.has_stamp(topic) and (size >= 12).all() else log_time
        tally.add(topic, log_time, data, start, size)
    found = {wheel: tally.reason(wheel, complete=False) for wheel in values["wheels"]}
    return {wheel: reason for wheel, reason in found.items() if reason is not None}


def _kind_of(what: str) -> str:
    return "speed" if what in (_JOINTS, "wheel_speed") else "load"


def _first(
    reader: BagReader, topic: str
) -> tuple[NDArray[np.int64], bytes, NDArray[np.int64], NDArray[np.int64]] | None:
    """The first messages of a topic, as log times, bytes, and where they begin and how long they are."""
    try:
        some = reader.first(topic, _FIRST)
    except InputError:  # it is damaged there: what stands before is replayed
        return None
    if not some:
        return None
    size = np.array([len(data) for _, data in some], np.int64)
    log_time = np.array([time for time, _ in some], np.int64)
    return log_time, b"".join(data for _, data in some), np.cumsum(size) - size, size


def mapped_values(
    reader: BagReader, values: Mapping[str, Any], names: Mapping[str, str], mapped: Sequence[MappedTopic]
) -> Iterator[dict[str, Any]]:
    """What the field map takes of the first messages of its topics.

    Parameters
    ----------
    reader : BagReader
    values, names
        As of a :class:`~tire_dynamics.replay.bag_setup.BagSetup`.
    mapped : sequence of MappedTopic
        As of a :class:`~tire_dynamics.replay.pipeline.Pipeline`.

    Yields
    ------
    dict
        Of each quantity of each topic: ``topic``, ``quantity``, ``unit`` (SI), ``looked_at`` (messages), ``rate_hz`` of
        them, ``malformed``, and ``values``: ``count``, ``low`` and ``high`` by wheel or component.
    """
    every = MappedMessages(list(mapped), len(values["wheels"]))
    for each in mapped:
        first = _first(reader, names[each.topic])
        if first is None:
            continue
        samples = every.read(each.topic, *first)
        times = first[0]
        span = 1e-9 * float(times[-1] - times[0])
        for group in each.values:
            parts = _COMPONENTS.get(group.quantity) or tuple(values["wheels"])
            columns = samples.values[group.quantity].T
            yield {
                "topic": names[each.topic],
                "quantity": group.quantity,
                "unit": next(iter(QUANTITIES[group.quantity].units)),
                "looked_at": len(times),
                "rate_hz": (len(times) - 1) / span if span > 0.0 else None,
                "malformed": int((~samples.valid).sum()),
                "values": {parts[k]: _range(columns[k]) for k in group.wheels or range(len(parts))},
            }


def _range(column: NDArray[np.float64]) -> dict[str, Any]:
    known = column[np.isfinite(column)]
    if not known.size:
        return {"count": 0, "low": None, "high": None}
    return {"count": int(known.size), "low": float(known.min()), "high": float(known.max())}


def reasons(
    reader: BagReader,
    values: Mapping[str, Any],
    names: Mapping[str, str],
    wheels: Iterable[str],
    mapped: Sequence[MappedTopic],
) -> dict[str, str]:
    """Why wheels had no outputs, by all messages of their inputs; the bag is read once more for it.

    Parameters
    ----------
    reader : BagReader
    values, names
        As of a :class:`~tire_dynamics.replay.bag_setup.BagSetup`.
    wheels : iterable of str
        Those that had none.
    mapped : sequence of MappedTopic
        As of a :class:`~tire_dynamics.replay.pipeline.Pipeline`.

    Returns
    -------
    dict
        By wheel.
    """
    wheels = list(wheels)
    if not wheels:
        return {}
    tally = _Tally(values, names, wheels, mapped, with_values=True)
    try:
        for block in reader.blocks(tally.topics.keys() & reader.topics.keys()):
            for number in np.unique(block.topic).tolist():
                some = np.flatnonzero(block.topic == number)
                where = block.start[some], block.size[some]
                tally.add(block.topics[number], block.log_time[some], block.data, *where)
    except InputError:  # damaged from here on, which is said elsewhere
        pass
    return {wheel: tally.reason(wheel, complete=True) or "" for wheel in wheels}


def hint(encoding: str) -> str:
    """What helps where a topic has another encoding than CDR."""
    if encoding == OTHER_FIELDS:
        return "; the bag's own definition of its type has other fields"
    if encoding == "ros1":
        return "; the bag of ROS 1 itself (.bag) is read"
    return "; record it with ros2 bag" if encoding in ("json", "protobuf", "flatbuffer") else ""


def _moment(time: int) -> str:
    """A time [ns] for people: a date if it can be one, else seconds."""
    if time < 10**9 * 10**8:  # before 1973: no recorder's clock
        return f"{time * 1e-9:.3f} s"
    return f"{datetime.fromtimestamp(time // 10**9, timezone.utc):%Y-%m-%d %H:%M:%S}"
