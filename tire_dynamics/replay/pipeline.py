"""A vehicle with its topics: bytes in, bytes out. The live node and the replay both run this, call for call."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bag import definitions as common
from ..cdr import messages
from ..estimator.vehicle import Vehicle
from ..science.rotating_excitation import rotating_excitation
from .input_map import QUANTITIES, MapError, MappedTopic, mapped_topics, mapped_types, sources
from .load_source import LoadSource
from .motion_watch import MotionWatch
from .parameters import car_of, complete, noise_of, unit_of, vehicle_settings
from .stream import IGNORED, TICKS, MessageStream, Sink

__all__ = [
    "LOG_RECORD",
    "TF_STATIC",
    "TICK",
    "Events",
    "Pipeline",
    "Records",
    "fixed_inputs",
    "input_types",
    "output_types",
]

IntArray = NDArray[np.int64]

TICK = "~/tick"
"""In logs only: the time of each tick, before the outputs of that tick (rosgraph_msgs/Clock)."""

TF_STATIC = "/tf_static"
"""Where the axles' frames are, if the parameters say so (tf2_msgs/TFMessage)."""

LOG_RECORD = "~/log_record"
"""In logs only: what a replay needs beside the inputs, as JSON (std_msgs/String)."""


def input_types(wheels: tuple[str, ...], load_source: str = "topic") -> dict[str, str]:
    """Relative names and types of the inputs of these wheels."""
    types = {"joint_states": messages.JOINT_STATE}
    for wheel in wheels:
        types[f"{wheel}/wheel_speed"] = messages.FLOAT64
        if load_source == "road":
            types[f"{wheel}/road_height"] = messages.FLOAT64
        if load_source != "topic":
            continue
        types[f"{wheel}/load"] = messages.WRENCH_STAMPED
        types[f"{wheel}/load_force"] = messages.FLOAT64
    return types


def fixed_inputs(values: Mapping[str, Any]) -> dict[str, str]:
    """Relative names and types of the inputs of a complete set of parameters, without those that the map replaces."""
    mapped = {source.quantity for source in sources(values)}
    replaced = {
        "speed": ("joint_states", "wheel_speed"), "load": ("load", "load_force"), "road_height": ("road_height",)
    }  # fmt: skip
    without = {name for quantity, names in replaced.items() if quantity in mapped for name in names}
    types = input_types(tuple(values["wheels"]), values["load_source"])
    return {topic: kind for topic, kind in types.items() if topic.rpartition("/")[2] not in without}


def output_types(values: Mapping[str, Any]) -> dict[str, str]:
    """Types of each wheel's outputs by the last part of their names, in their order."""
    types = {
        "axle_wrench": messages.WRENCH_STAMPED,
        "ring_deflection": messages.FLOAT64_MULTI_ARRAY,
        "ring_shape": messages.POINT_CLOUD,
    }
    if values["load_source"] == "road":
        types["contact_load"] = messages.WRENCH_STAMPED
    if values["load_source"] == "estimate":
        types["load_estimate"] = messages.WRENCH_STAMPED
        types["load_standard_deviation"] = messages.FLOAT64
        if values["axle_wrench_covariance"]:
            types["axle_wrench_covariance"] = messages.FLOAT64_MULTI_ARRAY
    return types


class Events(NamedTuple):
    """Input messages and ticks in their order, as columns; message ``i`` is ``data[start[i] : start[i] + size[i]]``.

    ``topics`` are relative names, :data:`TICK` for a tick; ``topic`` is an index into them. Times of receipt, of
    publication and the times ``tick`` to advance to are in nanoseconds.
    """

    topics: tuple[str, ...]
    topic: IntArray
    received: IntArray
    published: IntArray
    tick: IntArray
    data: bytes
    start: IntArray
    size: IntArray

    def part(self, some: slice) -> Events:
        """Some of the events."""
        topic, received, published, tick = self.topic[some], self.received[some], self.published[some], self.tick[some]
        return Events(self.topics, topic, received, published, tick, self.data, self.start[some], self.size[some])


class Records(NamedTuple):
    """Events and the outputs of their ticks as message records of an MCAP file, and how many there are by topic."""

    data: memoryview
    starts: IntArray
    received: Counter[str]
    written: Counter[str]


class Pipeline:
    """The vehicle that a set of parameters describes, fed and read in serialised messages.

    Parameters
    ----------
    values : mapping
        Parameters, see :data:`~tire_dynamics.replay.parameters.PARAMETERS`; those left out have their defaults.
    definitions : mapping, optional
        Definitions of messages by type, for the field map; those of the common interfaces are known.
    types : mapping, optional
        Message type by mapped topic, where the parameters leave it out.

    Attributes
    ----------
    vehicle : Vehicle
    inputs, outputs : dict
        Message type by the topic's name: relative, or of a mapped topic as the parameters have it.
    definitions : dict
        Of the types of mapped topics.
    loads : LoadSource or None
        Where the loads are estimated.
    motion : MotionWatch or None
        Where an IMU is mapped, by which all wheel speeds can be doubted.
    """

    def __init__(
        self,
        values: Mapping[str, Any],
        definitions: Mapping[str, str] | None = None,
        types: Mapping[str, str] | None = None,
    ) -> None:
        self.values = complete(values)
        settings = vehicle_settings(self.values)
        self.vehicle = Vehicle(settings)
        self.inputs = fixed_inputs(self.values)
        kinds = {topic: kind or (types or {}).get(topic, "") for topic, kind in mapped_types(self.values).items()}
        self.definitions = dict(definitions or {})
        for kind in set(kinds.values()) - self.definitions.keys():
            if (text := common.known(kind)) is not None:
                self.definitions[kind] = text
        mapped = mapped_topics(self.values, self.definitions, kinds)
        self.definitions = {kind: self.definitions[kind] for kind in kinds.values()}
        self.outputs = {
            f"{wheel}/{name}": kind for wheel in settings.wheels for name, kind in output_types(self.values).items()
        }
        self.loads: LoadSource | None = None
        has_covariance = self.values["axle_wrench_covariance"]
        quantities = {source.quantity for source in sources(self.values)}
        self.motion = MotionWatch(self.values) if "imu" in quantities else None
        if self.values["load_source"] == "estimate":
            car, noise = car_of(self.values), noise_of(self.values)
            self.loads = LoadSource(car, noise, self.vehicle, has_covariance, quantities)
        self._stream = MessageStream(
            self.vehicle.wheels,
            settings.joint_names,
            self.values["frame_ids"],
            settings.ring_samples,
            mapped,
            None if self.loads is None else self.loads.estimate,
            has_covariance,
        )
        self.set_sink(None if self.loads is None else self.loads.take)
        every = list(input_types(settings.wheels, self.values["load_source"]))
        self._numbers = {topic: every.index(topic) for topic in self.inputs}
        for number, topic in enumerate(mapped):
            if topic.topic not in self.inputs:
                self._numbers[topic.topic] = len(every) + number
                self.inputs[topic.topic] = topic.msgtype
            elif self.inputs[topic.topic] == topic.msgtype:  # it is an input already, and has more in it
                self._stream.share(self._numbers[topic.topic], number)
            else:
                raise MapError(f"{topic.topic} is {topic.msgtype}, but as an input it is {self.inputs[topic.topic]}")
        self._names = list(self.outputs)
        self._show()

    def _show(self) -> None:
        self._stream.set_shape(self.vehicle.unit.radius, self.values["ring_shape_scale"])

    @property
    def malformed(self) -> Counter[str]:
        """By topic, the messages that were not what their type says; each was left out whole."""
        counts = {topic: self._stream.malformed_of(number) for topic, number in self._numbers.items()}
        return Counter({topic: count for topic, count in counts.items() if count})

    @property
    def message_counts(self) -> Counter[str]:
        """``no velocity``: JointStates whose velocities are not one per name, which were refused."""
        return Counter({"no velocity": self._stream.no_velocity} if self._stream.no_velocity else {})

    @property
    def mapped(self) -> list[MappedTopic]:
        """The topics of the field map, with their plans."""
        return list(self._stream.mapped)

    def set_sink(self, sink: Sink | None) -> None:
        """Hand the samples of speed, travel, hub acceleration, imu and vehicle speed to something, as they come."""
        watch = None if self.motion is None else self.motion.take

        def both(quantity: str, wheel: int | None, stamp: int, received: int, values: tuple[float, ...]) -> None:
            for take in (sink, watch):
                if take is not None:
                    take(quantity, wheel, stamp, received, values)

        self._stream.set_sink(both if sink is not None and watch is not None else sink or watch)

    def take_sums(self) -> dict[str, NDArray[np.float64]]:
        """By quantity, of each wheel or component: count, sum, sum of sizes and of squares since the last call."""
        sums = self._stream.take_sums()
        return {name: sums[quantity.number] for name, quantity in QUANTITIES.items()}

    @property
    def empty(self) -> Counter[str]:
        """By mapped topic, the messages that had none of the wheels' names."""
        counts = self._stream.empty_counts
        found = {topic.topic: counts[number] for number, topic in enumerate(self._stream.mapped)}
        return Counter({topic: int(count) for topic, count in found.items() if count})

    def receive(self, topic: str, received: int, data: bytes) -> None:
        """Take a serialised input message at its time of receipt [ns]."""
        self._stream.receive(self._numbers[topic], received, data)

    def tick(self, stamp: int) -> list[tuple[str, bytes]]:
        """Advance to a time [ns]; the forces of that moment as (relative topic, serialised message)."""
        names = self._names
        return [(names[number], data) for number, data in self._stream.tick(stamp)]

    def belts(self) -> list[tuple[str, bytes]]:
        """The belts' messages if they are due at the last tick: later than the forces, which are waited for."""
        names = self._names
        return [(names[number], data) for number, data in self._stream.belts()]

    def run(self, events: Events, channels: Mapping[str, int]) -> Records:
        """What :meth:`receive`, and :meth:`tick` with :meth:`belts`, would do one after the other, bit for bit.

        Parameters
        ----------
        events : Events
        channels : mapping
            Channel of each topic, by its relative name, in the file that the records are for; an event whose topic has
            none is not written.

        Returns
        -------
        Records
            Good until the next call.

        Raises
        ------
        MessageError
            The time of a tick is outside ROS time.
        """
        kinds = [TICKS if name == TICK else self._numbers.get(name, IGNORED) for name in events.topics]
        number = np.array(kinds, dtype=np.int64)[events.topic]
        channel = np.array([channels.get(name, -1) for name in events.topics], dtype=np.int64)[events.topic]
        outputs = np.array([channels[name] for name in self._names], dtype=np.int64)
        columns = (number, events.received, events.tick, events.start, events.size, channel, events.published)
        number, received, tick, start, size, channel, published = (np.ascontiguousarray(each) for each in columns)
        data, starts, counts = self._stream.run(
            number, received, tick, events.data, start, size, channel, published, outputs
        )
        seen = np.bincount(events.topic, minlength=len(events.topics)).tolist()
        return Records(
            data,
            starts,
            Counter({name: count for name, count in zip(events.topics, seen, strict=True) if count}),
            Counter({name: count for name, count in zip(self._names, counts.tolist(), strict=True) if count}),
        )

    def prepare(self, values: Mapping[str, Any]) -> None:
        """Have what takes long in :meth:`set_values` with the same values done before, on any thread."""
        unit, model = unit_of(complete({**self.values, **values})), self.vehicle.settings.model
        rotating_excitation(unit, model)  # which is remembered

    def set_values(self, values: Mapping[str, Any]) -> None:
        """Change parameters that may change while the wheels turn, from now on."""
        self.values = complete({**self.values, **values})
        unit = unit_of(self.values)
        if unit != self.vehicle.unit:
            self.vehicle.set_unit(unit)
        self._show()

    def transforms(self, stamp: int) -> bytes | None:
        """Where the axles' frames are, for :data:`TF_STATIC`; None if no parent frame is given."""
        parent, positions = self.values["tf.parent_frame"], self.values["tf.positions"]
        if not parent:
            return None
        places = [positions[first : first + 3] for first in range(0, len(positions), 3)]
        return messages.encode_static_transforms(stamp, parent, self.values["frame_ids"], places)

    def restore(self, record: Mapping[str, Any]) -> None:
        """Take over the state that a log record says."""
        self.vehicle.restore(record["vehicle"])
        last = record.get("last_values", record.get("held"))  # "held" in logs of earlier builds
        if last is not None:
            self._stream.set_last_values(last)
        if self.loads is not None:
            self.loads.restore(record["loads"])

    def record(self, topics: Mapping[str, str], dropped: Mapping[str, int] | None = None) -> bytes:
        """The log record that lets a replay continue from here: parameters, state, and the topics' full names.

        ``dropped`` says how many messages on each topic (full name) are not in the log.
        """
        content: dict[str, Any] = {
            "parameters": self.values,
            "topics": dict(topics),
            "vehicle": self.vehicle.snapshot(),
        }
        if self._stream.mapped:
            content["last_values"] = self._stream.last_values()
        if self.loads is not None:
            content["loads"] = self.loads.snapshot()
        return messages.encode_string(json.dumps({**content, "dropped": dict(dropped or {})}))
