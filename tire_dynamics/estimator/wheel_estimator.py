"""One wheel through time, fed with stamped samples."""

from __future__ import annotations

import math
import operator
from bisect import bisect_left
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..science import wheel
from ..science.unit import TireWheelUnit
from .belt import BeltMotion, BeltShape

__all__ = ["Outcome", "WheelEstimator"]

Outcome = Literal["taken", "late", "repeated", "out of order", "not finite"]
FloatArray = NDArray[np.float64]

_NANO: Final = 1e-9
_FULL_TURN: Final = 2.0 * math.pi
_FOR_EVER: Final = 2**70
_BEYOND_ALL_BOUNDS: Final = 1e6  # [m/s] and [m]


class _Sample(NamedTuple):
    stamp: int
    values: tuple[float, ...]


class _Input:
    """The samples of one kind: the one in force, and those whose time is yet to come."""

    def __init__(self) -> None:
        self.in_force: _Sample | None = None
        self._waiting: list[_Sample] = []  # ascending stamps, none twice

    def add(self, sample: _Sample, time: int | None) -> Outcome:
        if not all(map(math.isfinite, sample.values)):
            return "not finite"
        if time is None or sample.stamp > time:
            place = bisect_left(self._waiting, sample.stamp, key=_stamp)
            if place < len(self._waiting) and self._waiting[place].stamp == sample.stamp:
                self._waiting[place] = sample
                return "repeated"
            self._waiting.insert(place, sample)
            return "taken"
        if self.in_force is not None and sample.stamp < self.in_force.stamp:
            return "out of order"
        outcome: Outcome = "late"
        if self.in_force is not None and sample.stamp == self.in_force.stamp:
            outcome = "repeated"
        self.in_force = sample
        return outcome

    @property
    def next_stamp(self) -> int | None:
        return self._waiting[0].stamp if self._waiting else None

    def let_in(self, stamp: int) -> None:
        """Put the waiting sample of this stamp, if there is one, in force."""
        if self._waiting and self._waiting[0].stamp == stamp:
            self.in_force = self._waiting.pop(0)

    def snapshot(self) -> list[Any]:
        return [self.in_force, list(self._waiting)]

    def restore(self, snapshot: list[Any]) -> None:
        in_force, waiting = snapshot
        self.in_force = _sample(*in_force) if in_force else None
        self._waiting = [_sample(*sample) for sample in waiting]


def _sample(stamp: int, values: Sequence[float]) -> _Sample:
    # a negative zero becomes a positive one, lest equal inputs differ in their bits
    return _Sample(operator.index(stamp), tuple(float(value) + 0.0 for value in values))


def _stamp(sample: _Sample) -> int:
    return sample.stamp


class WheelEstimator:
    """The motion of one ring, its wheel and its suspension, in real time or faster.

    Speed samples, load samples and calls of :meth:`advance` each bring their own time stamp, in integer
    nanoseconds of one common clock; the estimator reads no clock. It integrates the periodic system exactly
    between samples, and the same calls in the same order give the same bits.

    Parameters
    ----------
    unit : TireWheelUnit
    model : {"inextensional", "complete"}
    n_max : int
        Highest wavenumber of the belt, >= 2.
    timeout : int, optional
        Age [ns] beyond which a speed or a load is no longer believed. None holds the last one for ever.

    Notes
    -----
    What happens to a sample, by its stamp s, the stamp k of the newest sample of its kind in force, and the
    time t that the estimator has been advanced to:

    ==================  ================  ===================================================================
    case                outcome           effect
    ==================  ================  ===================================================================
    s > t               ``taken``         in force from s on, whatever order the samples came in
    k < s <= t          ``late``          in force from t on, the moment it is known; the past is not redone
    s = k, or s waits   ``repeated``      replaces that sample: from t on, or from s on if s > t
    s < k               ``out of order``  none: something newer is in force
    NaN or infinite     ``not finite``    none
    ==================  ================  ===================================================================

    Between samples the newest speed and load whose stamps are not after t are held: nothing is waited for and
    nothing extrapolated.

    The motion starts at equilibrium, in the steady state of the speed and the load, at the first moment at
    which both are known and neither is older than the timeout. When one of them becomes older than the timeout
    the motion stops; it starts again from equilibrium by the same rule. A gap shorter than the timeout is
    bridged with the held values, exactly and in one step.

    A unit that is driven beyond its stability limit grows without bound. Once any velocity or displacement exceeds
    1e6 m/s or m, the motion is given up, counted in ``divergences``, and starts again from equilibrium when the
    unit is no longer unstable at the speed in force.
    """

    def __init__(
        self,
        unit: TireWheelUnit,
        model: wheel.Model = "inextensional",
        n_max: int = 30,
        timeout: int | None = None,
    ) -> None:
        self.model = model
        self.timeout = timeout if timeout is not None else _FOR_EVER
        self.counts: Counter[str] = Counter()
        self.stops = 0  # for inputs that were too old
        self.divergences = 0
        self._stepper = wheel.stepper(unit, model)
        self._belt = BeltMotion(unit, n_max, model)
        self.unit = unit
        self.reset()

    def set_unit(self, unit: TireWheelUnit) -> None:
        """Change the tire from now on. Positions and velocities go on as they are."""
        self._stepper = wheel.stepper(unit, self.model)
        self._spinning = self._stepper.at(self._turning_at)
        self._belt.replace_unit(unit)
        self.unit = unit

    def reset(self) -> None:
        """Forget every sample, the state and the time."""
        self.time: int | None = None
        self.running = False
        self._diverged = False
        self._speed = _Input()
        self._load = _Input()
        self._state = np.zeros(self._stepper.states + 2 * self._stepper.inputs)  # state, input, its change: 0
        self._turning_at = 0.0  # the speed that the state's velocities and the steppers are for
        self._spinning = self._stepper.at(0.0)
        self._phase = 0.0

    # -- samples and time -----------------------------------------------------------------------------------

    def add_speed(self, stamp: int, speed: float) -> Outcome:
        """Take a sample of the spin [rad/s], positive rolling forward."""
        outcome = self._speed.add(_sample(stamp, (speed,)), self.time)
        self.counts[outcome] += 1
        return outcome

    def add_load(self, stamp: int, load: float, traction: float = 0.0) -> Outcome:
        """Take a sample of the vertical load, up positive, and of the traction along x_ros, on the tire [N]."""
        outcome = self._load.add(_sample(stamp, (load, traction)), self.time)
        self.counts[outcome] += 1
        return outcome

    @np.errstate(over="ignore", invalid="ignore")  # what overflows is given up at the end of it
    def advance(self, stamp: int) -> bool:
        """Bring the state to the given time [ns].

        Returns
        -------
        bool
            Whether the wheel is in motion: whether there is a state to read.

        Raises
        ------
        ValueError
            The time lies before the one reached already; :meth:`reset` first if the clock was set back.
        """
        if self.time is not None:
            if stamp < self.time:
                raise ValueError(f"stamp is {stamp}; the estimator has already reached {self.time}")
            self._start_if_complete(self.time)  # with what came late
        while True:
            coming = [s for s in (self._speed.next_stamp, self._load.next_stamp) if s is not None and s <= stamp]
            if not coming:
                self._move(stamp)
                self._give_up_if_diverged()
                return self.running
            moment = min(coming)
            self._move(moment)
            self._speed.let_in(moment)
            self._load.let_in(moment)
            self._start_if_complete(moment)

    def _start_if_complete(self, moment: int) -> None:
        expiry = self._expiry()
        if self.running or expiry is None or moment > expiry:
            return
        speed, load = self.speed, self.load
        if self._diverged and wheel.is_unstable(self.unit, speed, self.model):
            return
        self._diverged = False
        self._state[: self._stepper.states] = wheel.equilibrium(self.unit, speed, *load, self.model)
        self._belt.start(speed, *load)
        self._turn_at(speed)
        self._phase = 0.0
        self.running = True

    def _turn_at(self, speed: float) -> None:
        if speed != self._turning_at:
            self._spinning = self._stepper.at(speed)
            self._turning_at = speed

    def _expiry(self) -> int | None:
        """The last moment at which both inputs are believed; None while one is missing."""
        speed, load = self._speed.in_force, self._load.in_force
        if speed is None or load is None:
            return None
        return min(speed.stamp, load.stamp) + self.timeout

    def _move(self, moment: int) -> None:
        if self.running and moment > (self._expiry() or 0):
            self.running = False
            self.stops += 1
        if self.running and self.time is not None and moment > self.time:
            n = self._stepper.states
            speed, load = self.speed, self.load
            self._state[:n] = wheel.change_speed(self._state[:n], speed - self._turning_at, self.model)
            self._turn_at(speed)
            length = (moment - self.time) * _NANO
            self._state[n : n + 2] = load
            self._state[:n] = self._spinning.step(length, self._state)
            self._belt.hold(length, speed, *load)
            self._phase = math.fmod(self._phase + speed * length, _FULL_TURN)
        self.time = moment

    def _give_up_if_diverged(self) -> None:
        bounded = np.abs(self._state[: self._stepper.states]).max() < _BEYOND_ALL_BOUNDS  # false for NaN
        if self.running and not bounded:
            self.running, self._diverged = False, True
            self.divergences += 1

    def snapshot(self) -> dict[str, Any]:
        """Everything that later results depend on, in JSON's types; :meth:`restore` continues from it bit for bit."""
        return {
            "time": self.time,
            "running": self.running,
            "diverged": self._diverged,
            "speed": self._speed.snapshot(),
            "load": self._load.snapshot(),
            "state": self.state.tolist(),
            "turning_at": self._turning_at,
            "phase": self._phase,
            "belt": self._belt.snapshot(),
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over the samples, the state and the time of a :meth:`snapshot`."""
        self.reset()
        self.time = None if snapshot["time"] is None else operator.index(snapshot["time"])
        self.running = snapshot["running"]
        self._diverged = snapshot["diverged"]
        self._speed.restore(snapshot["speed"])
        self._load.restore(snapshot["load"])
        self._state[: self._stepper.states] = snapshot["state"]
        self._turn_at(snapshot["turning_at"])
        self._phase = snapshot["phase"]
        self._belt.restore(snapshot["belt"])

    # -- what can be read -----------------------------------------------------------------------------------

    def ages(self) -> tuple[int | None, int | None]:
        """Ages [ns] of the speed and of the load in force at the estimator's time, None where there is none."""
        speed, load = self._speed.in_force, self._load.in_force
        if self.time is None:
            return None, None
        return (
            self.time - speed.stamp if speed is not None else None,
            self.time - load.stamp if load is not None else None,
        )

    @property
    def speed(self) -> float:
        """Spin in force [rad/s]."""
        sample = self._speed.in_force
        return sample.values[0] if sample is not None else 0.0

    @property
    def load(self) -> tuple[float, float]:
        """Vertical load and traction in force [N]."""
        sample = self._load.in_force
        return (sample.values[0], sample.values[1]) if sample is not None else (0.0, 0.0)

    @property
    def state(self) -> FloatArray:
        """Fixed-frame state in the paper's axes, as :func:`~tire_dynamics.science.wheel.fixed_frame_matrix` has it."""
        return self._state[: self._stepper.states].copy()

    @property
    def phase(self) -> float:
        """Angle turned since the start, modulo 2 pi [rad]."""
        return self._phase

    @property
    def ring_state(self) -> FloatArray:
        """Ring-frame state of (5.1) [m/s, m]."""
        return wheel.rotation(self._phase, self._turning_at, self.model) @ self.state

    @property
    def axle_force(self) -> tuple[float, float]:
        """Force on the axle (x, z), REP 103 axes [N]."""
        x, z = wheel.axle_force(self.unit, self.speed, self._state[: self._stepper.states], self.model).tolist()
        return x, z

    def belt(self, shape: BeltShape) -> FloatArray:
        """Radial and tangential deflection of the belt relative to the wheel centre [m], shape (2, P)."""
        first = wheel.belt_amplitudes(self._state[: self._stepper.states], self.model)
        return shape.deflection(first, *self._belt.amplitudes())
