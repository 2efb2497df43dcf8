"""A vehicle with its topics: bytes in, bytes out. The live node and the replay both run this, call for call."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..estimator.belt import ring_angles
from ..estimator.vehicle import Events, Output, Vehicle
from ..science.elementary import cos_sin
from ..science.turning import turning
from ..science.wheel import stepper
from . import messages
from .parameters import complete, unit_of, vehicle_settings

__all__ = ["LOG_RECORD", "TF_STATIC", "TICK", "Produced", "Stretch", "Wiring", "input_types"]

IntArray = NDArray[np.int64]

_AT_ONCE, _AT_LEAST = 4096, 128  # events

TICK = "~/tick"
"""In logs only: the time of each tick, before the outputs of that tick (rosgraph_msgs/Clock)."""

TF_STATIC = "/tf_static"
"""Where the axles' frames are, if the parameters say so (tf2_msgs/TFMessage)."""

LOG_RECORD = "~/log_record"
"""In logs only: what a replay needs beside the inputs, as JSON (std_msgs/String)."""


def input_types(wheels: tuple[str, ...]) -> dict[str, str]:
    """Relative names and types of the inputs of these wheels."""
    types = {"joint_states": messages.JOINT_STATE}
    for wheel in wheels:
        types[f"{wheel}/wheel_speed"] = messages.FLOAT64
        types[f"{wheel}/load"] = messages.WRENCH_STAMPED
        types[f"{wheel}/load_force"] = messages.FLOAT64
    return types


class Stretch(NamedTuple):
    """Input messages and ticks in their order, as columns; message ``i`` is ``data[start[i] : start[i] + size[i]]``.

    ``topics`` are relative names, :data:`TICK` for a tick; ``topic`` is an index into them. Times of receipt and the
    times ``tick`` to advance to are in nanoseconds.
    """

    topics: tuple[str, ...]
    topic: IntArray
    received: IntArray
    tick: IntArray
    data: bytes
    start: IntArray
    size: IntArray

    def part(self, some: slice) -> Stretch:
        """Some of the events."""
        topic, received, tick = self.topic[some], self.received[some], self.tick[some]
        return Stretch(self.topics, topic, received, tick, self.data, self.start[some], self.size[some])


class Produced(NamedTuple):
    """Outputs in their order: the place of the tick that each belongs to, relative topic and serialised message."""

    place: IntArray
    topic: list[str]
    data: list[bytes]


class Wiring:
    """The vehicle that a set of parameters describes, fed and read in serialised messages.

    Parameters
    ----------
    values : mapping
        Parameters, see :data:`~tire_dynamics.doors.parameters.PARAMETERS`; those left out have their defaults.
    kernels : module, optional
        As :class:`~tire_dynamics.estimator.motion.Motion` takes it.

    Attributes
    ----------
    inputs, outputs : dict
        Message type by the topic's relative name.
    malformed : Counter
        By topic, the messages that were not what their type says; each was left out whole.
    forces : list of Output
        The axles' forces at the last :meth:`tick`.
    shapes : dict
        By wheel, what ring_shape had at its last turn in :meth:`belts`, (P, 5).
    """

    def __init__(self, values: Mapping[str, Any], kernels: ModuleType | None = None) -> None:
        self.values = complete(values)
        settings = vehicle_settings(self.values)
        self.vehicle = Vehicle(settings, kernels)
        self.inputs = input_types(settings.wheels)
        self.outputs: dict[str, str] = {}
        self.malformed: Counter[str] = Counter()
        self.forces: list[Output] = []
        self.shapes: dict[int, NDArray[np.float64]] = {}
        self._scale = self.values["ring_shape_scale"]
        self._names: list[tuple[str, str, str]] = []
        self._wrenches = []
        self._shapes = []
        self._deflection = messages.DeflectionEncoder(settings.ring_samples)
        self._joint_decoder = messages.JointStateDecoder()
        self._receivers: dict[str, Callable[[int, bytes], None]] = {"joint_states": self._joint_states()}
        for index, (wheel, frame) in enumerate(zip(settings.wheels, self.values["frame_ids"], strict=True)):
            self._receivers[f"{wheel}/wheel_speed"] = self._wheel_speed(index)
            self._receivers[f"{wheel}/load"] = self._load(index)
            self._receivers[f"{wheel}/load_force"] = self._load_force(index)
            names = (f"{wheel}/axle_wrench", f"{wheel}/ring_deflection", f"{wheel}/ring_shape")
            self._names.append(names)
            types = (messages.WRENCH_STAMPED, messages.FLOAT64_MULTI_ARRAY, messages.POINT_CLOUD)
            self.outputs.update(zip(names, types, strict=True))
            self._wrenches.append(messages.WrenchEncoder(frame))
            self._shapes.append(messages.RingShapeEncoder(frame, settings.ring_samples))
        angle = ring_angles(settings.ring_samples)
        cosine, sine = cos_sin(angle)
        self._outward = np.stack([-cosine, sine], axis=1)  # x_ros = -X
        self._along = np.stack([sine, cosine], axis=1)

    def receive(self, topic: str, received: int, data: bytes) -> None:
        """Take a serialised input message at its time of receipt [ns]."""
        try:
            self._receivers[topic](received, data)
        except messages.MessageError:
            self.malformed[topic] += 1

    def tick(self, stamp: int) -> list[tuple[str, bytes]]:
        """Advance to a time [ns]; the forces of that moment as (relative topic, serialised message)."""
        self.forces = self.vehicle.tick(stamp)
        return [
            (self._names[index][0], self._wrenches[index].encode(stamp, force_x, force_z))
            for index, force_x, force_z in self.forces
        ]

    def belts(self) -> list[tuple[str, bytes]]:
        """The belts' messages if they are due at the last tick: later than the forces, which are waited for."""
        produced = []
        for index, deflection in self.vehicle.belts():
            _, name, shape = self._names[index]
            produced.append((name, self._deflection.encode(deflection)))
            points = self.shapes[index] = self._points(deflection[None])[0]
            produced.append((shape, self._shapes[index].encode(self.vehicle.time or 0, points)))
        return produced

    def run(self, stretch: Stretch) -> Produced:
        """What :meth:`receive`, and :meth:`tick` with :meth:`belts`, would do one after the other, bit for bit.

        Parameters
        ----------
        stretch : Stretch

        Returns
        -------
        Produced

        Raises
        ------
        MessageError
            The time of a tick is outside ROS time.
        """
        parts = []
        first, last = 0, stretch.topic.size
        while first < last:
            part = stretch.part(slice(first, first + _AT_ONCE))
            produced = self._run_at_once(part)
            if produced is None:  # something starts or stops: not all of it one by one
                part = stretch.part(slice(first, first + _AT_LEAST))
                produced = self._run_one_by_one(part)
            parts.append(Produced(produced.place + first, produced.topic, produced.data))
            first += part.topic.size
        return Produced(
            np.concatenate([part.place for part in parts]),
            [topic for part in parts for topic in part.topic],
            [data for part in parts for data in part.data],
        )

    def _run_one_by_one(self, stretch: Stretch) -> Produced:
        places, topics, messages = [], [], []
        columns = (stretch.topic, stretch.received, stretch.tick, stretch.start, stretch.start + stretch.size)
        for place, (number, received, tick, start, end) in enumerate(zip(*(c.tolist() for c in columns), strict=True)):
            name = stretch.topics[number]
            if name == TICK:
                produced = self.tick(tick) + self.belts()
                places += [place] * len(produced)
                topics += [topic for topic, _ in produced]
                messages += [data for _, data in produced]
            else:
                self.receive(name, received, stretch.data[start:end])
        return Produced(np.array(places, np.int64), topics, messages)

    def _run_at_once(self, stretch: Stretch) -> Produced | None:
        malformed: Counter[str] = Counter()
        events = self._events(stretch, malformed)
        outputs = self.vehicle.drive(events)
        if outputs is None:
            return None
        self.malformed += malformed
        parts: list[tuple[IntArray, int, str, list[bytes]]] = []
        for position, index in enumerate(outputs.wheels):
            wrench, deflection, shape = self._names[index]
            force = outputs.forces[:, position]
            data = self._wrenches[index].encode_block(events.ticks, force[:, 0], force[:, 1])
            parts.append((events.tick_place, position, wrench, data))
            belts, shown = outputs.belts[position], outputs.shown[position]
            data = self._deflection.encode_block(belts)
            rank = len(outputs.wheels) + 2 * position
            parts.append((events.tick_place[shown], rank, deflection, data))
            data = self._shapes[index].encode_block(events.ticks[shown], self._points(belts))
            parts.append((events.tick_place[shown], rank + 1, shape, data))
        place = np.concatenate([np.empty(0, np.int64), *(part[0] for part in parts)])
        ranks = np.repeat([part[1] for part in parts], [part[0].size for part in parts])
        order = np.lexsort([ranks, place]).tolist()
        topics = [part[2] for part in parts for _ in range(part[0].size)]
        messages = [message for part in parts for message in part[3]]
        return Produced(place[order], [topics[k] for k in order], [messages[k] for k in order])

    def _events(self, stretch: Stretch, malformed: Counter[str]) -> Events:
        """The messages of a stretch, decoded; those that cannot be are counted."""
        joint_states, wheel_speeds, loads = [], [], []
        numbers = {name: number for number, name in enumerate(stretch.topics)}

        def of(name: str) -> NDArray[np.int64]:
            return np.flatnonzero(stretch.topic == numbers.get(name, -1))

        def usable(name: str, place: NDArray[np.int64], valid: NDArray[np.bool_]) -> NDArray[np.int64]:
            if not valid.all():
                malformed[name] += int((~valid).sum())
            return place[valid]

        place = of("joint_states")
        valid, stamp, groups = self._joint_decoder.decode_block(stretch.data, stretch.start[place], stretch.size[place])
        usable("joint_states", place, valid)
        for some, names, velocities, positions in groups:
            where = place[some], stretch.received[place[some]], stamp[some]
            joint_states.append((names, *where, velocities, positions))
        for wheel in self.vehicle.settings.wheels:
            place = of(name := f"{wheel}/wheel_speed")
            valid, speed = messages.decode_float64s(stretch.data, stretch.start[place], stretch.size[place])
            place = usable(name, place, valid)
            wheel_speeds.append((place, stretch.received[place], speed[valid]))
            place = of(name := f"{wheel}/load")
            valid, stamp, fx, fz = messages.decode_wrenches(stretch.data, stretch.start[place], stretch.size[place])
            parts = [(usable(name, place, valid), stamp[valid], fz[valid], fx[valid])]
            place = of(name := f"{wheel}/load_force")
            valid, fz = messages.decode_float64s(stretch.data, stretch.start[place], stretch.size[place])
            place = usable(name, place, valid)
            if place.size:
                parts.append((place, stretch.received[place], fz[valid], np.zeros(place.size)))
            place, stamp, fz, fx = (np.concatenate(columns) for columns in zip(*parts, strict=True))
            order = np.argsort(place, kind="stable")
            values = np.stack([fz, fx], axis=1)
            loads.append((place[order], stretch.received[place[order]], stamp[order], values[order]))
        ticks = of(TICK)
        return Events(ticks, stretch.tick[ticks], joint_states, wheel_speeds, loads)

    def prepare(self, values: Mapping[str, Any]) -> None:
        """Have what takes long in :meth:`set_values` with the same values done before, on any thread."""
        unit, model = unit_of(complete({**self.values, **values})), self.vehicle.settings.model
        stepper(unit, model)  # both are remembered
        turning(unit, model)

    def set_values(self, values: Mapping[str, Any]) -> None:
        """Change parameters that may change while the wheels turn, from now on."""
        self.values = complete({**self.values, **values})
        self._scale = self.values["ring_shape_scale"]
        unit = unit_of(self.values)
        if unit != self.vehicle.unit:
            self.vehicle.set_unit(unit)

    def transforms(self, stamp: int) -> bytes | None:
        """Where the axles' frames are, for :data:`TF_STATIC`; None if no parent frame is given."""
        parent, positions = self.values["tf.parent_frame"], self.values["tf.positions"]
        if not parent:
            return None
        places = [positions[first : first + 3] for first in range(0, len(positions), 3)]
        return messages.encode_static_transforms(stamp, parent, self.values["frame_ids"], places)

    def record(self, topics: Mapping[str, str], dropped: Mapping[str, int] | None = None) -> bytes:
        """The log record that lets a replay continue from here: parameters, state, and the topics' full names.

        ``dropped`` says how many messages on each topic (full name) are not in the log.
        """
        content = {"parameters": self.values, "topics": dict(topics), "vehicle": self.vehicle.snapshot()}
        return messages.encode_string(json.dumps({**content, "dropped": dict(dropped or {})}))

    def _points(self, belts: NDArray[np.float64]) -> NDArray[np.float64]:
        """Columns x, y, z, radial, tangential of deformed belts (M, 2, P) in the axle's frame [m], shape (M, P, 5)."""
        radial, tangential = belts[:, 0], belts[:, 1]
        points = np.zeros((*radial.shape, 5))
        place = (self.vehicle.unit.radius + self._scale * radial)[..., None] * self._outward
        place += (self._scale * tangential)[..., None] * self._along
        points[..., [0, 2]] = place
        points[..., 3], points[..., 4] = radial, tangential
        return points

    # -- inputs ---------------------------------------------------------------------------------------------

    def _joint_states(self) -> Callable[[int, bytes], None]:
        decode, take = self._joint_decoder.decode, self.vehicle.joint_states

        def receive(received: int, data: bytes) -> None:
            state = decode(data)
            take(received, state.stamp_ns, state.names, state.velocities, state.positions)

        return receive

    def _wheel_speed(self, index: int) -> Callable[[int, bytes], None]:
        decode, take = messages.decode_float64, self.vehicle.wheel_speed

        def receive(received: int, data: bytes) -> None:
            take(index, received, decode(data))

        return receive

    def _load(self, index: int) -> Callable[[int, bytes], None]:
        decode, take = messages.WrenchDecoder().decode, self.vehicle.load

        def receive(received: int, data: bytes) -> None:
            wrench = decode(data)
            take(index, received, wrench.stamp_ns, wrench.fz, wrench.fx)

        return receive

    def _load_force(self, index: int) -> Callable[[int, bytes], None]:
        decode, take = messages.decode_float64, self.vehicle.load

        def receive(received: int, data: bytes) -> None:
            take(index, received, received, decode(data), 0.0)

        return receive
