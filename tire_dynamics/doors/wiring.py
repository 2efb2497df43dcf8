"""A vehicle with its topics: bytes in, bytes out. The live node and the replay both run this, call for call."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..estimator.belt import ring_angles
from ..estimator.vehicle import Vehicle
from . import messages
from .parameters import complete, unit_of, vehicle_settings

__all__ = ["LOG_RECORD", "TICK", "Wiring", "input_types"]

TICK = "~/tick"
"""In logs only: the time of each tick, before the outputs of that tick (rosgraph_msgs/Clock)."""

LOG_RECORD = "~/log_record"
"""In logs only: what a replay needs beside the inputs, as JSON (std_msgs/String)."""


def input_types(wheels: tuple[str, ...]) -> dict[str, str]:
    """Relative names and types of the inputs of these wheels."""
    types = {"joint_states": messages.JOINT_STATE}
    for wheel in wheels:
        types[f"{wheel}/wheel_speed"] = messages.FLOAT64
        types[f"{wheel}/load"] = messages.WRENCH_STAMPED
    return types


class Wiring:
    """The vehicle that a set of parameters describes, fed and read in serialised messages.

    Parameters
    ----------
    values : mapping
        Parameters, see :data:`~tire_dynamics.doors.parameters.PARAMETERS`; those left out have their defaults.

    Attributes
    ----------
    inputs, outputs : dict
        Message type by the topic's relative name.
    malformed : Counter
        By topic, the messages that were not what their type says; each was left out whole.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self.values = complete(values)
        settings = vehicle_settings(self.values)
        self.vehicle = Vehicle(settings)
        self.inputs = input_types(settings.wheels)
        self.outputs: dict[str, str] = {}
        self.malformed: Counter[str] = Counter()
        self._names: list[tuple[str, str, str]] = []
        self._wrenches = []
        self._shapes = []
        self._deflection = messages.DeflectionEncoder(settings.ring_samples)
        self._receivers: dict[str, Callable[[int, bytes], None]] = {"joint_states": self._joint_states()}
        for index, (wheel, frame) in enumerate(zip(settings.wheels, self.values["frame_ids"], strict=True)):
            self._receivers[f"{wheel}/wheel_speed"] = self._wheel_speed(index)
            self._receivers[f"{wheel}/load"] = self._load(index)
            names = (f"{wheel}/axle_wrench", f"{wheel}/ring_deflection", f"{wheel}/ring_shape")
            self._names.append(names)
            types = (messages.WRENCH_STAMPED, messages.FLOAT64_MULTI_ARRAY, messages.POINT_CLOUD)
            self.outputs.update(zip(names, types, strict=True))
            self._wrenches.append(messages.WrenchEncoder(frame))
            self._shapes.append(messages.RingShapeEncoder(frame, settings.ring_samples))
        angle = ring_angles(settings.ring_samples)
        self._outward = np.stack([-np.cos(angle), np.sin(angle)], axis=1)  # x_ros = -X
        self._along = np.stack([np.sin(angle), np.cos(angle)], axis=1)

    def receive(self, topic: str, received: int, data: bytes) -> None:
        """Take a serialised input message at its time of receipt [ns]."""
        try:
            self._receivers[topic](received, data)
        except messages.MessageError:
            self.malformed[topic] += 1

    def tick(self, stamp: int) -> list[tuple[str, bytes]]:
        """Advance to a time [ns]; the outputs of that moment as (relative topic, serialised message)."""
        produced = []
        for index, force_x, force_z, belt in self.vehicle.tick(stamp):
            wrench, deflection, shape = self._names[index]
            produced.append((wrench, self._wrenches[index].encode(stamp, force_x, force_z)))
            if belt is not None:
                produced.append((deflection, self._deflection.encode(belt)))
                produced.append((shape, self._shapes[index].encode(stamp, self._points(belt))))
        return produced

    def set_values(self, values: Mapping[str, Any]) -> None:
        """Change parameters that may change while the wheels turn, from now on."""
        self.values = complete({**self.values, **values})
        unit = unit_of(self.values)
        if unit != self.vehicle.unit:
            self.vehicle.set_unit(unit)

    def record(self, topics: Mapping[str, str]) -> bytes:
        """The log record that lets a replay continue from here: parameters, state, and the topics' full names."""
        content = {"parameters": self.values, "topics": dict(topics), "vehicle": self.vehicle.snapshot()}
        return messages.encode_string(json.dumps(content))

    def _points(self, belt: NDArray[np.float64]) -> NDArray[np.float64]:
        """Columns x, y, z, radial, tangential of the deformed belt in the axle's frame [m], shape (P, 5)."""
        radial, tangential = belt
        points = np.zeros((belt.shape[1], 5))
        place = (self.vehicle.unit.radius + radial)[:, None] * self._outward
        place += tangential[:, None] * self._along
        points[:, [0, 2]] = place
        points[:, 3], points[:, 4] = radial, tangential
        return points

    # -- inputs ---------------------------------------------------------------------------------------------

    def _joint_states(self) -> Callable[[int, bytes], None]:
        decode, take = messages.JointStateDecoder().decode, self.vehicle.joint_states

        def receive(received: int, data: bytes) -> None:
            state = decode(data)
            take(received, state.stamp_ns, state.names, state.velocities)

        return receive

    def _wheel_speed(self, index: int) -> Callable[[int, bytes], None]:
        decode, take = messages.decode_float64, self.vehicle.wheel_speed

        def receive(received: int, data: bytes) -> None:
            take(index, received, decode(data))

        return receive

    def _load(self, index: int) -> Callable[[int, bytes], None]:
        decode, take = messages.decode_wrench, self.vehicle.load

        def receive(received: int, data: bytes) -> None:
            wrench = decode(data)
            take(index, received, wrench.stamp_ns, wrench.fz, wrench.fx)

        return receive
