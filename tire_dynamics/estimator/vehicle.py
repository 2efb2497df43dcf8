"""The wheels of a vehicle: what the live node and the replay both run, call for call."""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..science import wheel
from ..science.unit import TireWheelUnit
from .belt import BeltShape, belt_numbers, ring_angles
from .wheel_estimator import WheelEstimator

__all__ = ["Output", "Vehicle", "VehicleSettings", "stability_reply"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class VehicleSettings:
    """What a :class:`Vehicle` is made of; times in nanoseconds, the rest SI."""

    unit: TireWheelUnit
    wheels: tuple[str, ...] = ("wheel",)
    joint_names: tuple[str, ...] = ("wheel",)
    period: int = 2_000_000
    ring_period: int = 20_000_000
    ring_samples: int = 72
    n_max: int = 30
    model: wheel.Model = "inextensional"
    input_timeout: int = 200_000_000
    max_speed: float = 1000.0
    max_load: float = 200e3


class Output(NamedTuple):
    """One wheel after a tick: its index, the axle force [N] (REP 103), and the belt's shape when that is due.

    ``belt`` has shape (2, P): radial and tangential deflection relative to the wheel centre [m].
    """

    wheel: int
    force_x: float
    force_z: float
    belt: FloatArray | None


class Vehicle:
    """Several wheels of one kind, fed with messages' contents and ticks.

    Everything that decides an output comes in through the arguments: values, stamps and times of receipt, all
    in nanoseconds of one clock. The same calls in the same order give the same outputs, bit for bit; a replay
    repeats the calls of the live node.

    Notes
    -----
    Outcomes beyond those of :class:`WheelEstimator`, counted by the same counters (``no velocity``, which concerns no
    wheel in particular, in ``message_counts``):

    =====================  ==================================================================================
    ``no stamp``           a stamp of zero: the time of receipt is taken for it
    ``in the future``      the stamp lies more than the input timeout after the receipt: refused
    ``speed too high``     beyond ``max_speed``: refused
    ``load too high``      load or traction beyond ``max_load``: refused
    ``off the ground``     a negative load: taken as zero, the road cannot pull
    ``no velocity``        a JointState whose velocities are not one per name: refused
    ``joint twice``        a joint that one JointState lists twice: the first is taken
    =====================  ==================================================================================
    """

    def __init__(self, settings: VehicleSettings) -> None:
        self.settings = settings
        self.estimators = [
            WheelEstimator(settings.unit, settings.model, settings.n_max, settings.input_timeout)
            for _ in settings.wheels
        ]
        self.counts = [estimator.counts for estimator in self.estimators]
        self.message_counts: Counter[str] = Counter()
        self.clock_resets = 0
        self.time: int | None = None
        self._shape = BeltShape(ring_angles(settings.ring_samples), belt_numbers(settings.n_max, settings.model))
        self.unit = settings.unit
        self._ring_turn: int | None = None
        self._joints: dict[tuple[str, ...], list[tuple[int, int]]] = {}

    def set_unit(self, unit: TireWheelUnit) -> None:
        """Change the tire of every wheel from now on; positions and velocities go on as they are."""
        for estimator in self.estimators:
            estimator.set_unit(unit)
        self.unit = unit

    # -- inputs ---------------------------------------------------------------------------------------------

    def joint_states(self, received: int, stamp: int, names: Sequence[str], velocities: Sequence[float]) -> None:
        """The spin of every wheel whose joint is named [rad/s]; other joints are left alone."""
        if len(velocities) != len(names):
            self.message_counts["no velocity"] += 1
            return
        for index, position in self._where(tuple(names)):
            self._speed(index, received, stamp, velocities[position])

    def wheel_speed(self, index: int, received: int, speed: float) -> None:
        """The spin of one wheel [rad/s], as of its receipt."""
        self._speed(index, received, received, speed)

    def load(self, index: int, received: int, stamp: int, load: float, traction: float) -> None:
        """The contact force on one tire: vertical, up positive, and along x_ros [N]."""
        counts = self.counts[index]
        accepted = self._accept(index, received, stamp)
        if accepted is None:
            return
        limit = self.settings.max_load
        if abs(load) > limit or abs(traction) > limit:
            counts["load too high"] += 1
            return
        if load < 0.0:
            counts["off the ground"] += 1
            load = 0.0
        self.estimators[index].add_load(accepted, load, traction)

    def _speed(self, index: int, received: int, stamp: int, speed: float) -> None:
        accepted = self._accept(index, received, stamp)
        if accepted is None:
            return
        if abs(speed) > self.settings.max_speed:
            self.counts[index]["speed too high"] += 1
            return
        self.estimators[index].add_speed(accepted, speed)

    def _accept(self, index: int, received: int, stamp: int) -> int | None:
        if stamp == 0:
            self.counts[index]["no stamp"] += 1
            return received
        if stamp > received + self.settings.input_timeout:
            self.counts[index]["in the future"] += 1
            return None
        return stamp

    def _where(self, names: tuple[str, ...]) -> list[tuple[int, int]]:
        """(wheel, position) of every wheel joint among these names; publishers repeat their names for ever."""
        known = self._joints.get(names)
        if known is None:
            known = [
                (index, names.index(joint)) for index, joint in enumerate(self.settings.joint_names) if joint in names
            ]
            if len(self._joints) >= 64:
                self._joints.clear()
            self._joints[names] = known
        for index, _ in known:
            if names.count(self.settings.joint_names[index]) > 1:
                self.counts[index]["joint twice"] += 1
        return known

    # -- time -----------------------------------------------------------------------------------------------

    def tick(self, stamp: int) -> list[Output]:
        """Advance every wheel to the given time; one output for each that is in motion.

        A time before the last one means that the clock was set back: everything is forgotten, and the wheels
        start again from equilibrium with the inputs to come.
        """
        if self.time is not None and stamp < self.time:
            self.clock_resets += 1
            for estimator in self.estimators:
                estimator.reset()
        self.time = stamp
        turn = stamp // self.settings.ring_period
        belt_due = turn != self._ring_turn
        self._ring_turn = turn
        outputs = []
        for index, estimator in enumerate(self.estimators):
            if estimator.advance(stamp):
                x, z = estimator.axle_force
                belt = estimator.belt(self._shape) if belt_due else None
                outputs.append(Output(index, x, z, belt))
        return outputs

    def snapshot(self) -> dict[str, Any]:
        """Everything that later outputs depend on, in JSON's types; :meth:`restore` continues from it bit for bit."""
        return {
            "time": self.time,
            "ring_turn": self._ring_turn,
            "wheels": [estimator.snapshot() for estimator in self.estimators],
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over the state of a :meth:`snapshot` of a vehicle with the same settings."""
        self.time, self._ring_turn = (
            None if snapshot[name] is None else operator.index(snapshot[name]) for name in ("time", "ring_turn")
        )
        for estimator, state in zip(self.estimators, snapshot["wheels"], strict=True):
            estimator.restore(state)

    def stability(self, index: int) -> dict[str, Any]:
        """The stability reply for one wheel at its present speed; at standstill before there is a speed."""
        estimator = self.estimators[index]
        return stability_reply(self.settings.wheels[index], self.unit, estimator.speed, self.settings.model)


def stability_reply(
    name: str, unit: TireWheelUnit, speed: float, model: wheel.Model = "inextensional"
) -> dict[str, Any]:
    """The Floquet stability of a unit at a speed [rad/s], in the form of the service's JSON."""
    result = wheel.stability(unit, speed, model)
    multipliers = result.multipliers
    return {
        "wheel": name,
        "speed_rad_s": speed,
        "period_s": result.period,
        "verdict": result.verdict,
        "spectral_radius": result.spectral_radius,
        "multipliers": None if multipliers is None else [[mu.real, mu.imag] for mu in multipliers.tolist()],
        "exponents_1_s": [[value.real, value.imag] for value in result.exponents.tolist()],
        "critical_speed_rad_s": wheel.critical_speed(unit, model),
    }
