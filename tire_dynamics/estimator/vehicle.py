"""The wheels of a vehicle: what the live node and the replay both run, call for call."""

from __future__ import annotations

import math
import operator
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..science import nonuniform, wheel
from ..science.unit import TireWheelUnit
from .belt import BeltShape, belt_numbers, ring_angles
from .motion import Motion
from .schedule import Samples, Schedule, Stretch

__all__ = ["Belt", "Events", "Output", "Outputs", "Vehicle", "VehicleSettings", "stability_reply"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


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
    """One wheel after a tick: its index and the axle force [N] (REP 103)."""

    wheel: int
    force_x: float
    force_z: float


class Belt(NamedTuple):
    """The belt of one wheel: radial and tangential deflection relative to the wheel centre [m], shape (2, P)."""

    wheel: int
    deflection: FloatArray


class Events(NamedTuple):
    """What a vehicle receives over a stretch, in columns; ``place`` is the place of each event among all.

    Times are in nanoseconds.

    Attributes
    ----------
    tick_place, ticks : ndarray of int, shape (T,)
    joint_states : list of tuple
        Joint names, place, receipt and stamp (N,), velocities (N, k) [rad/s] and positions (N, k) [rad] or None, of
        messages with the same names.
    wheel_speeds : list of tuple
        For each wheel: place and receipt (N,), speed (N,) [rad/s].
    loads : list of tuple
        For each wheel: place, receipt and stamp (N,), load and traction (N, 2) [N].
    """

    tick_place: IntArray
    ticks: IntArray
    joint_states: list[tuple[tuple[str, ...], IntArray, IntArray, IntArray, FloatArray, FloatArray | None]]
    wheel_speeds: list[tuple[IntArray, IntArray, FloatArray]]
    loads: list[tuple[IntArray, IntArray, IntArray, FloatArray]]


class Outputs(NamedTuple):
    """What a vehicle puts out over a stretch.

    Attributes
    ----------
    wheels : list of int
        The W wheels that are in motion.
    forces : ndarray, shape (T, W, 2)
        Axle forces [x, z], REP 103 [N].
    shown : list of ndarray of int, shape (M,)
        The ticks at which each wheel's belt is due.
    belts : list of ndarray, shape (M, 2, P)
        Each wheel's radial and tangential deflection relative to the wheel centre [m].
    """

    wheels: list[int]
    forces: FloatArray
    shown: list[IntArray]
    belts: list[FloatArray]


class Vehicle:
    """Several wheels of one kind, fed with messages' contents and ticks.

    Everything that decides an output comes in through the arguments: values, stamps and times of receipt, all
    in nanoseconds of one clock. The same calls in the same order give the same outputs, bit for bit; a replay
    repeats the calls of the live node.

    Notes
    -----
    Outcomes beyond those of :class:`~.wheel_estimator.WheelEstimator`, counted by the same counters (``no velocity``,
    which concerns no wheel in particular, in ``message_counts``):

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

    def __init__(self, settings: VehicleSettings, kernels: ModuleType | None = None) -> None:
        self.settings = settings
        self.schedules = [Schedule(settings.input_timeout, self._is_unstable) for _ in settings.wheels]
        self._motion = Motion(settings.unit, settings.model, settings.n_max, len(settings.wheels), kernels)
        self.message_counts: Counter[str] = Counter()
        self.clock_resets = 0
        self.time: int | None = None
        self._shape = BeltShape(ring_angles(settings.ring_samples), belt_numbers(settings.n_max, settings.model))
        # Each wheel's belt has its own part of the period: all at one tick would take longer than the others.
        self._ring_offsets = [k * settings.ring_period // len(settings.wheels) for k in range(len(settings.wheels))]
        self._ring_turns: list[int | None] = [None] * len(settings.wheels)
        self._due: list[int] = []
        self._joints: dict[tuple[str, ...], list[tuple[int, int]]] = {}

    def set_unit(self, unit: TireWheelUnit) -> None:
        """Change the tire of every wheel from now on; positions and velocities go on as they are."""
        self._motion.set_unit(unit)

    @property
    def unit(self) -> TireWheelUnit:
        """The tire of every wheel."""
        return self._motion.unit

    @property
    def angles(self) -> FloatArray:
        """How far every wheel has turned, modulo 2 pi [rad]: as joint_states told it last, or since the start."""
        return self._motion.phase

    @property
    def counts(self) -> list[Counter[str]]:
        """What became of the inputs of each wheel."""
        return [schedule.counts for schedule in self.schedules]

    def _is_unstable(self, speed: float) -> bool:
        return wheel.is_unstable(self.unit, speed, self.settings.model)

    # -- inputs ---------------------------------------------------------------------------------------------

    def joint_states(
        self,
        received: int,
        stamp: int,
        names: Sequence[str],
        velocities: Sequence[float],
        positions: Sequence[float] = (),
    ) -> None:
        """The spin [rad/s] and, where there is one per name, the angle [rad] of every wheel whose joint is named."""
        if len(velocities) != len(names):
            self.message_counts["no velocity"] += 1
            return
        angles = positions if len(positions) == len(names) else [math.nan] * len(names)
        for index, position in self._where(tuple(names)):
            self._speed(index, received, stamp, velocities[position], angles[position])

    def wheel_speed(self, index: int, received: int, speed: float) -> None:
        """The spin of one wheel [rad/s], as of its receipt."""
        self._speed(index, received, received, speed)

    def load(self, index: int, received: int, stamp: int, load: float, traction: float) -> None:
        """The contact force on one tire: vertical, up positive, and along x_ros [N]."""
        counts = self.schedules[index].counts
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
        self.schedules[index].add_load(accepted, load, traction)

    def _speed(self, index: int, received: int, stamp: int, speed: float, angle: float = math.nan) -> None:
        accepted = self._accept(index, received, stamp)
        if accepted is None:
            return
        if abs(speed) > self.settings.max_speed:
            self.schedules[index].counts["speed too high"] += 1
            return
        self.schedules[index].add_speed(accepted, speed, angle)

    def _accept(self, index: int, received: int, stamp: int) -> int | None:
        if stamp == 0:
            self.schedules[index].counts["no stamp"] += 1
            return received
        if stamp > received + self.settings.input_timeout:
            self.schedules[index].counts["in the future"] += 1
            return None
        return stamp

    def _where(self, names: tuple[str, ...], messages: int = 1) -> list[tuple[int, int]]:
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
                self.schedules[index].counts["joint twice"] += messages
        return known

    # -- time -----------------------------------------------------------------------------------------------

    def tick(self, stamp: int) -> list[Output]:
        """Advance every wheel to the given time; one output for each that is in motion.

        A time before the last one means that the clock was set back: everything is forgotten, and the wheels
        start again from equilibrium with the inputs to come.

        Parameters
        ----------
        stamp : int
            [ns]
        """
        if self.time is not None and stamp < self.time:
            self.clock_resets += 1
            for index, schedule in enumerate(self.schedules):
                schedule.reset()
                self._motion.reset(index)
        self.time = stamp
        turns: list[int | None] = [(stamp + offset) // self.settings.ring_period for offset in self._ring_offsets]
        self._due = [index for index, turn in enumerate(turns) if turn != self._ring_turns[index]]
        self._ring_turns = turns
        self._motion.follow([schedule.plan(stamp) for schedule in self.schedules])
        forces, bounded = self._motion.read([schedule.speed for schedule in self.schedules])
        if not bounded.all():
            for index in np.flatnonzero(~bounded).tolist():
                if self.schedules[index].running:
                    self.schedules[index].give_up()
        numbers = forces.tolist()
        return [Output(index, *numbers[index]) for index in self._running()]

    def _running(self) -> list[int]:
        return [index for index, schedule in enumerate(self.schedules) if schedule.running]

    def belts(self) -> list[Belt]:
        """The belts of wheels in motion that are due at the last tick and have not been asked for."""
        due = [index for index in self._due if self.schedules[index].running]
        self._due = []
        if not due:
            return []
        return [Belt(*pair) for pair in zip(due, self._motion.deflections(due, self._shape), strict=True)]

    def drive(self, events: Events) -> Outputs | None:
        """What the same calls one by one would do, :meth:`belts` behind each tick, bit for bit, for many at once.

        Parameters
        ----------
        events : Events

        Returns
        -------
        Outputs or None
            None if a wheel would start, stop or diverge, or the clock is set back: then nothing has changed, and the
            calls have to be made one by one.
        """
        ticks = events.ticks
        if self.time is None or (np.diff(ticks, prepend=self.time) < 0).any() or not ticks.size:
            return None
        kept = [schedule.keep() for schedule in self.schedules]
        message_counts = self.message_counts.copy()
        speeds = self._speed_events(events)
        stretches: dict[int, Stretch] = {}
        for index, schedule in enumerate(self.schedules):
            place, received, stamp, values = events.loads[index]
            loads = self._usable_loads(index, place, received, stamp, values, events.tick_place)
            stretch = schedule.stretch(ticks, speeds[index], loads)
            if stretch is not None:
                stretches[index] = stretch
            elif not schedule.idle(ticks, speeds[index], loads):
                break
        else:
            turns = (ticks + np.array(self._ring_offsets)[:, None]) // self.settings.ring_period
            first = [turn if turn is not None else -1 for turn in self._ring_turns]  # none: before any tick
            due = np.diff(turns, prepend=np.array(first)[:, None]) != 0
            shown = {index: np.flatnonzero(due[index]) for index in stretches}
            result = self._motion.follow_stretches(stretches, ticks.size, shown, self._shape)
            if result is not None:
                self.time, self._ring_turns, self._due = int(ticks[-1]), [*turns[:, -1].tolist()], []
                return Outputs(list(stretches), result[0], list(shown.values()), result[1])
        for schedule, before in zip(self.schedules, kept, strict=True):
            schedule.put_back(before)
        self.message_counts = message_counts
        return None

    def _speed_events(self, events: Events) -> list[Samples]:
        """The samples of speed of each wheel."""
        parts: list[list[tuple[IntArray, IntArray, IntArray, FloatArray, FloatArray]]] = [
            [(place, received, received, speed, np.full_like(speed, math.nan))]
            for place, received, speed in events.wheel_speeds
        ]
        for names, place, received, stamp, velocities, positions in events.joint_states:
            if velocities.shape[1] != len(names):
                self.message_counts["no velocity"] += place.size
                continue
            for index, position in self._where(names, place.size):
                angle = np.full(place.size, math.nan) if positions is None else positions[:, position]
                parts[index].append((place, received, stamp, velocities[:, position], angle))
        samples = []
        for index, pieces in enumerate(parts):
            columns = [np.concatenate(column) for column in zip(*pieces, strict=True)]
            if len(pieces) > 1:
                order = np.argsort(columns[0], kind="stable")
                columns = [column[order] for column in columns]
            place, received, stamp, speed, angle = columns
            stamp, usable = self._usable(index, received, stamp)
            self._refuse(index, "speed too high", usable, np.abs(speed) > self.settings.max_speed)
            self._refuse(index, "not finite", usable, ~np.isfinite(speed))
            after = np.searchsorted(events.tick_place, place[usable])
            values = np.stack([speed, np.where(np.isfinite(angle), angle, math.nan)], axis=1)
            samples.append(Samples(after, stamp[usable], values[usable]))
        return samples

    def _usable_loads(
        self, index: int, place: IntArray, received: IntArray, stamp: IntArray, values: FloatArray, ticks: IntArray
    ) -> Samples:
        stamp, usable = self._usable(index, received, stamp)
        self._refuse(index, "load too high", usable, (np.abs(values) > self.settings.max_load).any(axis=1))
        below = usable & (values[:, 0] < 0.0)
        if below.any():
            self.schedules[index].counts["off the ground"] += int(below.sum())
            values = values.copy()
            values[below, 0] = 0.0
        self._refuse(index, "not finite", usable, ~np.isfinite(values).all(axis=1))
        return Samples(np.searchsorted(ticks, place[usable]), stamp[usable], values[usable])

    def _usable(self, index: int, received: IntArray, stamp: IntArray) -> tuple[IntArray, NDArray[np.bool_]]:
        """Stamps, with the receipt for those of zero, and which are not in the future."""
        counts, missing = self.schedules[index].counts, stamp == 0
        if missing.any():
            counts["no stamp"] += int(missing.sum())
            stamp = np.where(missing, received, stamp)
        usable = np.ones(stamp.size, dtype=bool)
        self._refuse(index, "in the future", usable, ~missing & (stamp > received + self.settings.input_timeout))
        return stamp, usable

    def _refuse(self, index: int, why: str, usable: NDArray[np.bool_], wrong: Any) -> None:
        refused = usable & wrong
        if refused.any():
            self.schedules[index].counts[why] += int(refused.sum())
            usable &= ~refused

    def snapshot(self) -> dict[str, Any]:
        """Everything that later outputs depend on, in JSON's types; :meth:`restore` continues from it bit for bit."""
        return {
            "time": self.time,
            "ring_turns": self._ring_turns,
            "wheels": [
                {**schedule.snapshot(), **self._motion.snapshot(index)} for index, schedule in enumerate(self.schedules)
            ],
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over the state of a :meth:`snapshot` of a vehicle with the same settings."""
        self.time = None if snapshot["time"] is None else operator.index(snapshot["time"])
        self._ring_turns = [None if turn is None else operator.index(turn) for turn in snapshot["ring_turns"]]
        for index, (schedule, state) in enumerate(zip(self.schedules, snapshot["wheels"], strict=True)):
            schedule.restore(state)
            self._motion.restore(index, state)

    def stability(self, index: int, *, quick: bool = False) -> dict[str, Any]:
        """The stability reply for one wheel at its present speed; at standstill before there is a speed.

        Parameters
        ----------
        index : int
            Of the wheel.
        quick : bool
            Of a tire that is not uniform this takes some milliseconds, and longer the slower it turns. Whether to take
            the speed to 1 rad/s, and 20 rad/s for less, and to remember the reply.
        """
        name, speed = self.settings.wheels[index], self.schedules[index].speed
        if not quick or self.unit.is_uniform:
            return stability_reply(name, self.unit, speed, self.settings.model)
        if speed:
            speed = math.copysign(max(float(round(abs(speed))), 20.0), speed)
        return {**_remembered_reply(self.unit, speed, self.settings.model), "wheel": name}


@lru_cache(maxsize=256)
def _remembered_reply(unit: TireWheelUnit, speed: float, model: wheel.Model) -> dict[str, Any]:
    return stability_reply("", unit, speed, model)


def stability_reply(
    name: str, unit: TireWheelUnit, speed: float, model: wheel.Model = "inextensional", n_max: int = 1
) -> dict[str, Any]:
    """The Floquet stability of a unit at a speed [rad/s], of modes up to ``n_max``, as the service's JSON has it."""
    sidewall = nonuniform.Nonuniformity.of(unit)
    result = nonuniform.stability(unit, sidewall, speed, model, n_max)
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
        "periodicity": "genuine" if nonuniform.is_genuine(unit, model, n_max) else "reducible",
        "nearest_tongue_rad_s": nonuniform.nearest_tongue(unit, sidewall, speed, model),
    }
