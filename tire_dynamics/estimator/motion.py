"""The motion of several wheels of one kind, stepped together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..science import kernels, turning, wheel
from ..science.stepping import Room
from ..science.unit import TireWheelUnit
from .belt import BeltMotion, BeltShape, Path
from .schedule import Plan, Stretch

__all__ = ["Motion", "fastest_kernels"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_BEYOND_ALL_BOUNDS: Final = 1e6  # [m/s] and [m]


def fastest_kernels() -> ModuleType:
    """The compiled kernels where Numba is installed, else those on NumPy; the bits are the same."""
    try:
        from ..science import compiled
    except ImportError:
        return kernels
    return compiled


class Motion:
    """States of W wheels: the first mode of each ring with its wheel, and the other modes of its belt.

    Parameters
    ----------
    unit : TireWheelUnit
    model : {"inextensional", "complete"}
    n_max : int
        Highest wavenumber of the belt, >= 2.
    wheels : int
    kernels : module, optional
        :mod:`~tire_dynamics.science.kernels` or :mod:`~tire_dynamics.science.compiled`; default is the fastest there
        is.

    Attributes
    ----------
    state : ndarray, shape (W, n)
        Fixed-frame states as :func:`~tire_dynamics.science.wheel.fixed_frame_matrix` has them.
    turning_at : ndarray, shape (W,)
        The speed [rad/s] that the states' velocities are for.
    phase : ndarray, shape (W,)
        The wheel's angle, modulo 2 pi [rad]: as it was told last, or turned since the start.
    """

    def __init__(
        self, unit: TireWheelUnit, model: wheel.Model, n_max: int, wheels: int, kernels: ModuleType | None = None
    ) -> None:
        self.model = model
        self.kernels = kernels or fastest_kernels()
        self.belt = BeltMotion(unit, n_max, model, wheels, self.kernels)
        self._room = Room()
        self.turning_at = np.zeros(wheels)
        self.phase = np.zeros(wheels)
        self.state = np.zeros((wheels, wheel.states(unit, model)))
        self.set_unit(unit)

    def set_unit(self, unit: TireWheelUnit) -> None:
        """Change the tire from now on. Positions and velocities go on as they are; a wheel is let go at rest."""
        self.unit = unit
        self.state = wheel.reshaped(self.state, wheel.states(unit, self.model))
        self._stepper = wheel.stepper(unit, self.model)
        self._turning = turning.turning(unit, self.model)
        self._series = self._series_at(self.turning_at).copy()
        self._output_at: list[float] = []
        self.belt.set_unit(unit)

    def _series_at(self, speeds: FloatArray) -> FloatArray:
        return self._stepper.series(speeds, self.kernels, self._room)

    def reset(self, index: int) -> None:
        """Be at rest."""
        self.state[index] = 0.0
        self.phase[index] = 0.0
        self._turn(index, 0.0)
        self.belt.reset(index)

    @np.errstate(all="ignore")  # a unit that is no tire may have no finite one, and is given up
    def start(self, index: int, speed: float, load: float, traction: float, angle: float = math.nan) -> None:
        """Be in the steady state of a speed [rad/s], a load and a traction [N], at the wheel's angle [rad] or 0."""
        angle = 0.0 if math.isnan(angle) else angle
        self.state[index] = turning.steady_state(self.unit, speed, load, traction, angle, self.model)
        self._turn(index, speed)
        self.phase[index] = angle
        self.belt.start(index, speed, load, traction)

    def _turn(self, index: int, speed: float) -> None:
        if speed != self.turning_at[index]:
            self.turning_at[index] = speed
            if self._turning is None:
                self._series = self._series.copy()
                self._series[index] = self._series_at(np.array([speed]))[0]

    def follow(self, plans: Sequence[Plan]) -> None:
        """Take every wheel through its plan."""
        every: list[tuple[int, float, float, float]] = []
        every_angle: list[float] = []
        stop = []
        for index, (start, steps, angles) in enumerate(plans):
            if start is not None:
                self.start(index, *start)
            if steps:
                self.belt.hold(index, steps)
                every += steps
                every_angle += angles
            stop.append(len(every))
        if every:
            ends = np.array([stop])
            with np.errstate(over="ignore", invalid="ignore"):  # what overflows is given up at the end of it
                steps_of_all = np.array(every, dtype=np.float64)
                self._advance(steps_of_all, np.array(every_angle), np.array([0, *stop[:-1]]), ends)

    @np.errstate(over="ignore", invalid="ignore")
    def follow_stretches(
        self, stretches: Mapping[int, Stretch], ticks: int, shown: Mapping[int, IntArray], shape: BeltShape
    ) -> tuple[FloatArray, list[FloatArray]] | None:
        """Take W of the wheels through many ticks at once.

        Parameters
        ----------
        stretches : mapping of int to Stretch
            By wheel, over the same ticks.
        ticks : int
            Their number T.
        shown : mapping of int to ndarray of int, shape (M,)
            By wheel, the ticks at which its belt is wanted.
        shape : BeltShape

        Returns
        -------
        forces : ndarray, shape (T, W, 2)
            Axle force [x, z], REP 103 axes [N].
        belts : list of ndarray, shape (M, 2, P)
            Each wheel's radial and tangential deflection relative to the wheel centre [m].

        None if a wheel diverges on the way: then nothing has changed.
        """
        wheels = list(stretches)
        counts = np.zeros(len(self.state), np.int64)
        counts[wheels] = [stretch.length.size for stretch in stretches.values()]
        begin = np.cumsum(counts) - counts
        stop = np.repeat(begin[None, :], ticks, axis=0)
        for index, stretch in stretches.items():
            stop[:, index] += stretch.done
        steps, angles = np.empty((counts.sum(), 4)), np.empty(counts.sum())
        for index, stretch in stretches.items():
            mine = steps[begin[index] : begin[index] + counts[index]]
            angles[begin[index] : begin[index] + counts[index]] = stretch.angle
            mine[:, 0], mine[:, 1], mine[:, 2:] = stretch.length, stretch.speed, stretch.force
        kept = self.state.copy(), self.turning_at.copy(), self.phase.copy(), self._series
        every_state, phases = self._advance(steps, angles, begin, stop)
        states = every_state[:, wheels]
        if not (np.abs(states) < _BEYOND_ALL_BOUNDS).all():
            self.state, self.turning_at, self.phase, self._series = kept
            return None
        if not wheels:
            return np.empty((ticks, 0, 2)), []
        speeds = np.stack([stretch.speed_at for stretch in stretches.values()], axis=1)
        forces = wheel.axle_forces(wheel.output_matrices(self.unit, speeds, self.model), states)
        self._add_pull(forces, states, phases[:, wheels])
        paths = {
            index: Path(stretch.length, stretch.speed, -stretch.force, stretch.done[shown[index]])
            for index, stretch in stretches.items()
        }
        at_ends = np.concatenate([states[shown[index], position] for position, index in enumerate(wheels)])
        belts = shape.sums(wheel.belt_amplitudes(at_ends, self.model), self.belt.follow(paths), self.kernels)
        return forces, np.split(belts, np.cumsum([shown[index].size for index in wheels[:-1]]))

    def _advance(
        self, steps: FloatArray, angles: FloatArray, begin: IntArray, stop: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """States (T, W, n) and, of a tire that is not uniform, phases (T, W) at the ticks after steps, wheel by wheel.

        Each step has length [ns], speed, load and traction, and an angle where it is told.
        """
        if self._turning is not None:
            return self._advance_turning(self._turning, steps, angles, begin, stop)
        which, series, jump = self._speeds(steps[:, 1], begin, stop[-1])
        stepper = self._stepper
        states: FloatArray = self.kernels.advance_first(
            *(self.state, self.phase, series, stepper.longest_step, stepper.top_speed),
            *(steps, which, jump, angles, begin, stop),
        )
        return states, np.broadcast_to(self.phase, states.shape[:2])

    def _advance_turning(
        self, parts: turning.Turning, steps: FloatArray, angles: FloatArray, begin: IntArray, stop: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        speed, end = steps[:, 1], stop[-1]
        moving = np.flatnonzero(end > begin)
        before = np.empty_like(speed)
        before[1:] = speed[:-1]
        before[begin[moving]] = self.turning_at[moving]
        jump = speed - before if self.model == "complete" else np.zeros_like(speed)
        self.turning_at[moving] = speed[end[moving] - 1]
        seconds = np.concatenate([steps[:, :1] * 1e-9, steps[:, 1:]], axis=1)
        held = np.zeros((len(steps), 2))
        states, phases = self.kernels.advance_turning(
            self.state, self.phase, *parts[:9], seconds, held, jump, angles, begin, stop
        )
        return states, phases

    def _add_pull(self, forces: FloatArray, states: FloatArray, phases: FloatArray) -> None:
        """Add to axle forces (..., 2) what a sidewall that is not uniform does on a wheel that is held fore and aft."""
        parts = self._turning
        if parts is not None and self.unit.is_held:
            rows = np.ascontiguousarray(states).reshape(-1, states.shape[-1])
            pull = self.kernels.axle_pull(rows, phases.reshape(-1), parts.seen, parts.spring, parts.wheel_x)
            forces[..., 0] += pull.reshape(phases.shape)

    def _speeds(self, speed: FloatArray, begin: IntArray, end: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Which transitions each step needs, those transitions' series, and the changes of the speed."""
        owner = np.repeat(np.arange(begin.size), end - begin)
        jump = np.zeros_like(speed)
        if (speed == self.turning_at[owner]).all():
            return owner, self._series, jump
        moving = np.flatnonzero(end > begin)
        first, last = begin[moving], end[moving] - 1
        before = np.empty_like(speed)
        before[1:] = speed[:-1]
        before[first] = self.turning_at[moving]
        places = np.flatnonzero(speed != before)
        which = np.full(speed.size, -1)
        which[first] = moving
        which[places] = len(self._series) + np.arange(places.size)
        which = which[np.maximum.accumulate(np.where(which >= 0, np.arange(speed.size), 0))]
        # once more for the first few: cheaper than to join
        series = self._series_at(np.concatenate([self.turning_at, speed[places]]))
        self._series = self._series.copy()
        self._series[moving] = series[which[last]]
        self.turning_at[moving] = speed[last]
        if self.model == "complete":
            jump = speed - before
        return which, series, jump

    def read(self, speeds: Sequence[float]) -> tuple[FloatArray, NDArray[np.bool_]]:
        """What the wheels do at the speeds in force [rad/s].

        Returns
        -------
        forces : ndarray, shape (W, 2)
            On each axle (x, z), REP 103 axes [N].
        bounded : ndarray of bool, shape (W,)
            Whether its velocities and displacements are below 1e6 m/s and m.
        """
        if speeds != self._output_at:
            self._output_at = list(speeds)
            self._output = wheel.output_matrices(self.unit, np.array(speeds), self.model)
        forces, largest = self.kernels.read(self.state, self._output)
        if self._turning is not None:
            with np.errstate(over="ignore", invalid="ignore"):
                self._add_pull(forces, self.state, self.phase)
        return forces, largest < _BEYOND_ALL_BOUNDS  # false for NaN

    def deflections(self, indices: Sequence[int], shape: BeltShape) -> FloatArray:
        """Radial and tangential deflection of some belts relative to the wheel centre [m], shape (len, 2, P)."""
        first = wheel.belt_amplitudes(self.state[list(indices)], self.model)
        return self.belt.deflections(indices, first, shape)

    def snapshot(self, index: int) -> dict[str, Any]:
        """Everything that later results depend on, in JSON's types."""
        return {
            "state": self.state[index].tolist(),
            "turning_at": float(self.turning_at[index]),
            "phase": float(self.phase[index]),
            "belt": self.belt.snapshot(index),
        }

    def restore(self, index: int, snapshot: Mapping[str, Any]) -> None:
        """Take over a :meth:`snapshot`."""
        self.state[index] = snapshot["state"]
        self._turn(index, float(snapshot["turning_at"]))
        self.phase[index] = snapshot["phase"]
        self.belt.restore(index, snapshot["belt"])
