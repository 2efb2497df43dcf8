"""Why a wheel has no outputs: what a bag holds of its speed and its load, and what cannot be used of that."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from datetime import datetime, timezone
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bag import BagReader
from ..bag.clock import stamps_of
from ..bag.fields import OTHER_FIELDS
from ..cdr import messages
from ..files.errors import InputError
from .input_map import sources

__all__ = ["first_reasons", "hint", "reasons"]

_FIRST = 500  # messages of a topic that are looked at before a replay
_MOST_NAMES = 30  # joints that are listed
_HEIGHT = "what a road height may be"
_JOINTS = "joint_states"

_OTHER_CLOCK = "stamps and times of receipt are of different clocks"
_TAKEN = "taken"
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
    with_values : bool
        Whether to look at the values too: of the first messages only, they say nothing of those to come.
    """

    def __init__(
        self, values: Mapping[str, Any], names: Mapping[str, str], wheels: Iterable[str], with_values: bool
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
        mapped = {source.quantity for source in sources(values)}
        for (_, what), source in self.sources.items():  # what comes by the field map is not looked at here
            estimated = values["load_source"] == "estimate" or on_road and "road_height" in mapped
            if what in mapped or what == "load" and estimated:
                source.messages += 1
                source.add(_TAKEN, 1)
        self._decoder = messages.JointStateDecoder()

    def add(self, topic: str, log_time: NDArray[np.int64], data: bytes, start: Any, size: Any) -> None:
        """Take messages of one topic."""
        what, wheel = self.topics[topic]
        if what == _JOINTS:
            self._joint_states(log_time, data, start, size)
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
        if outcome == "malformed":
            return f"{count} messages of its {what} are not what their type says"
        return f"its {what} was {outcome} {count} times"


def first_reasons(reader: BagReader, values: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, str]:
    """Why wheels can have no outputs, by the first messages of their inputs.

    Parameters
    ----------
    reader : BagReader
    values, names
        As of a :class:`~tire_dynamics.replay.replay.Plan`.

    Returns
    -------
    dict
        By wheel; those that may have outputs are not in it.
    """
    tally = _Tally(values, names, values["wheels"], with_values=False)
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
        try:
            some = reader.first(topic, _FIRST)
        except InputError:  # it is damaged there: what stands before is replayed
            some = []
        if not some:  # nothing is known
            for name in [wheel] if wheel else values["wheels"]:
                source = tally.sources[name, "speed" if what in (_JOINTS, "wheel_speed") else "load"]
                source.messages += 1
                source.add(_TAKEN, 1)
            continue
        size = np.array([len(data) for _, data in some], np.int64)
        data = b"".join(data for _, data in some)
        log_time = np.array([time for time, _ in some], np.int64)
        start = np.cumsum(size) - size
        if reader.clock is not None:  # then there is but one
            log_time = stamps_of(data, start) if what in (_JOINTS, "load") and (size >= 12).all() else log_time
        tally.add(topic, log_time, data, start, size)
    found = {wheel: tally.reason(wheel, complete=False) for wheel in values["wheels"]}
    return {wheel: reason for wheel, reason in found.items() if reason is not None}


def reasons(
    reader: BagReader, values: Mapping[str, Any], names: Mapping[str, str], wheels: Iterable[str]
) -> dict[str, str]:
    """Why wheels had no outputs, by all messages of their inputs; the bag is read once more for it.

    Parameters
    ----------
    reader : BagReader
    values, names
        As of a :class:`~tire_dynamics.replay.replay.Plan`.
    wheels : iterable of str
        Those that had none.

    Returns
    -------
    dict
        By wheel.
    """
    wheels = list(wheels)
    if not wheels:
        return {}
    tally = _Tally(values, names, wheels, with_values=True)
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
