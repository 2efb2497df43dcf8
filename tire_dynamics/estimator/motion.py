"""The motion of several wheels of one kind, stepped together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..science import kernels, wheel
from ..science.unit import TireWheelUnit
from .belt import BeltMotion, BeltShape, Path
from .schedule import Plan, Stretch

__all__ = ["Motion", "fastest_kernels"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NANO: Final = 1e-9
_FULL_TURN: Final = 2.0 * math.pi
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
    state : ndarray, shape (W, 6) or (W, 10)
        Fixed-frame states as :func:`~tire_dynamics.science.wheel.fixed_frame_matrix` has them.
    turning_at : ndarray, shape (W,)
        The speed [rad/s] that the states' velocities are for.
    phase : ndarray, shape (W,)
        Angle turned since the start, modulo 2 pi [rad].
    """

    def __init__(
        self, unit: TireWheelUnit, model: wheel.Model, n_max: int, wheels: int, kernels: ModuleType | None = None
    ) -> None:
        self.model = model
        self.kernels = kernels or fastest_kernels()
        self.belt = BeltMotion(unit, n_max, model, wheels, self.kernels)
        self.turning_at = np.zeros(wheels)
        self.phase = np.zeros(wheels)
        self.set_unit(unit)
        self.state = np.zeros((wheels, self._stepper.states))

    def set_unit(self, unit: TireWheelUnit) -> None:
        """Change the tire from now on. Positions and velocities go on as they are."""
        self.unit = unit
        self._stepper = wheel.stepper(unit, self.model)
        self._series = self._series_at(self.turning_at)
        self._output_at = self.turning_at.copy()
        self._output = wheel.output_matrices(unit, self._output_at, self.model)
        self.belt.set_unit(unit)

    def _series_at(self, speeds: FloatArray) -> FloatArray:
        return self._stepper.series(speeds, self.kernels)

    def reset(self, index: int) -> None:
        """Be at rest."""
        self.state[index] = 0.0
        self.phase[index] = 0.0
        self._turn(index, 0.0)
        self.belt.reset(index)

    def start(self, index: int, speed: float, load: float, traction: float) -> None:
        """Be in the steady state of a constant speed [rad/s], load and traction [N]."""
        self.state[index] = wheel.equilibrium(self.unit, speed, load, traction, self.model)
        self._turn(index, speed)
        self.phase[index] = 0.0
        self.belt.start(index, speed, load, traction)

    def _turn(self, index: int, speed: float) -> None:
        if speed != self.turning_at[index]:
            self.turning_at[index] = speed
            self._series = self._series.copy()
            self._series[index] = self._series_at(np.array([speed]))[0]

    @np.errstate(over="ignore", invalid="ignore")  # what overflows is given up at the end of it
    def follow(self, plans: Sequence[Plan]) -> None:
        """Take every wheel through its plan."""
        for index, (start, steps) in enumerate(plans):
            if start is not None:
                self.start(index, *start)
            if steps:
                self.belt.hold(index, steps)
        counts = [len(plan.steps) for plan in plans]
        if any(counts):
            steps = [step for plan in plans for step in plan.steps]
            columns = np.array(steps, dtype=np.float64)
            stop: IntArray = np.cumsum(counts)
            self._advance(columns[:, 0], columns[:, 1], columns[:, 2:], stop - np.array(counts), stop[None, :])

    @np.errstate(over="ignore", invalid="ignore")
    def follow_stretches(
        self, stretches: Mapping[int, Stretch], ticks: int, shown: IntArray, shape: BeltShape
    ) -> tuple[FloatArray, FloatArray] | None:
        """Take W of the wheels through many ticks at once.

        Parameters
        ----------
        stretches : mapping of int to Stretch
            By wheel, over the same ticks.
        ticks : int
            Their number T.
        shown : ndarray of int, shape (M,)
            The ticks at which the belt is wanted.
        shape : BeltShape

        Returns
        -------
        forces : ndarray, shape (T, W, 2)
            Axle force [x, z], REP 103 axes [N].
        belts : ndarray, shape (M, W, 2, P)
            Radial and tangential deflection relative to the wheel centre [m].

        None if a wheel diverges on the way: then nothing has changed.
        """
        wheels = list(stretches)
        counts = np.zeros(len(self.state), np.int64)
        counts[wheels] = [stretch.length.size for stretch in stretches.values()]
        begin = np.cumsum(counts) - counts
        stop = np.repeat(begin[None, :], ticks, axis=0)
        for index, stretch in stretches.items():
            stop[:, index] += stretch.done
        if not counts.any():
            columns = [np.empty(0), np.empty(0), np.empty((0, 2))]
        else:
            columns = [np.concatenate(each) for each in zip(*(s[:3] for s in stretches.values()), strict=True)]
        kept = self.state.copy(), self.turning_at.copy(), self.phase.copy(), self._series
        states = self._advance(columns[0].astype(np.float64), columns[1], columns[2], begin, stop)[:, wheels]
        if not (np.abs(states) < _BEYOND_ALL_BOUNDS).all():
            self.state, self.turning_at, self.phase, self._series = kept
            return None
        if not wheels:
            return np.empty((ticks, 0, 2)), np.empty((shown.size, 0, 2, shape.size))
        speeds = np.stack([stretch.speed_at for stretch in stretches.values()], axis=1)
        forces = wheel.axle_forces(wheel.output_matrices(self.unit, speeds, self.model), states)
        paths = {
            index: Path(stretch.length, stretch.speed, -stretch.force, stretch.done[shown])
            for index, stretch in stretches.items()
        }
        first = wheel.belt_amplitudes(states[shown], self.model).swapaxes(0, 1).reshape(-1, 4)
        belts = shape.sums(first, self.belt.follow(paths), self.kernels)
        return forces, belts.reshape(len(wheels), shown.size, *belts.shape[1:]).swapaxes(0, 1)

    def _advance(
        self, length: FloatArray, speed: FloatArray, force: FloatArray, begin: IntArray, stop: IntArray
    ) -> FloatArray:
        """States at the ticks (T, W, n) after steps of given lengths [ns], wheel after wheel."""
        length = length * _NANO
        which, series, jump = self._speeds(speed, begin, stop[-1])
        doublings = self._stepper.doublings(length, np.abs(speed))
        scaled = length / (self._stepper.longest_step * 2.0**doublings)
        arrays = (series, which, scaled, doublings, force, jump, begin, stop)
        states: FloatArray = self.kernels.advance_first(self.state, *map(np.ascontiguousarray, arrays))
        self._turn_on(length, speed, begin, stop[-1])
        return states

    def _speeds(self, speed: FloatArray, begin: IntArray, end: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Which transitions each step needs, those transitions' series, and the changes of the speed."""
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
        series, jump = self._series, np.zeros_like(speed)
        if places.size:
            series = np.concatenate([series, self._series_at(speed[places])])
            self._series = self._series.copy()
            self._series[moving] = series[which[last]]
            self.turning_at[moving] = speed[last]
            if self.model == "complete":
                jump = speed - before
        return which, series, jump

    def _turn_on(self, length: FloatArray, speed: FloatArray, begin: IntArray, end: IntArray) -> None:
        angles = (speed * length).tolist()
        for index, (first, last) in enumerate(zip(begin.tolist(), end.tolist(), strict=True)):
            phase = float(self.phase[index])
            for angle in angles[first:last]:
                phase = math.fmod(phase + angle, _FULL_TURN)
            self.phase[index] = phase

    def bounded(self) -> NDArray[np.bool_]:
        """Whether each wheel's velocities and displacements are below 1e6 m/s and m."""
        within: NDArray[np.bool_] = np.abs(self.state).max(axis=1) < _BEYOND_ALL_BOUNDS  # false for NaN
        return within

    def axle_forces(self, speeds: FloatArray) -> FloatArray:
        """Force on each axle (x, z), REP 103 axes [N], shape (W, 2), at the speeds in force [rad/s], shape (W,)."""
        if (speeds != self._output_at).any():
            self._output_at = speeds.copy()
            self._output = wheel.output_matrices(self.unit, speeds, self.model)
        return wheel.axle_forces(self._output, self.state)

    def deflections(self, indices: Sequence[int], shape: BeltShape) -> FloatArray:
        """Radial and tangential deflection of some belts relative to the wheel centre [m], shape (len, 2, P)."""
        first = wheel.belt_amplitudes(self.state[list(indices)], self.model)
        return shape.sums(first, self.belt.amplitudes(indices), self.kernels)

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
