"""One wheel through time, fed with stamped samples."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..science import wheel
from ..science.unit import TireWheelUnit
from .belt import BeltShape
from .motion import Motion
from .schedule import Outcome, Schedule

__all__ = ["Outcome", "WheelEstimator"]

FloatArray = NDArray[np.float64]


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
        self._schedule = Schedule(timeout, lambda speed: wheel.is_unstable(self.unit, speed, model))
        self._motion = Motion(unit, model, n_max, 1)

    @property
    def unit(self) -> TireWheelUnit:
        """The tire."""
        return self._motion.unit

    @property
    def counts(self) -> Counter[str]:
        """Samples by outcome."""
        return self._schedule.counts

    @property
    def stops(self) -> int:
        """How often the motion stopped for inputs that were too old."""
        return self._schedule.stops

    @property
    def divergences(self) -> int:
        """How often the motion was given up."""
        return self._schedule.divergences

    @property
    def time(self) -> int | None:
        """The time reached [ns]."""
        return self._schedule.time

    @property
    def running(self) -> bool:
        """Whether the wheel is in motion."""
        return self._schedule.running

    def set_unit(self, unit: TireWheelUnit) -> None:
        """Change the tire from now on. Positions and velocities go on as they are."""
        self._motion.set_unit(unit)

    def reset(self) -> None:
        """Forget every sample, the state and the time."""
        self._schedule.reset()
        self._motion.reset(0)

    # -- samples and time -----------------------------------------------------------------------------------

    def add_speed(self, stamp: int, speed: float, angle: float = math.nan) -> Outcome:
        """Take a sample of the spin [rad/s], positive rolling forward, and of the wheel's angle [rad] if it is known.

        Only a tire that is not the same all around asks for the angle; from sample to sample it follows the spin.
        """
        return self._schedule.add_speed(stamp, speed, angle)

    def add_load(self, stamp: int, load: float, traction: float = 0.0) -> Outcome:
        """Take a sample of the vertical load, up positive, and of the traction along x_ros, on the tire [N]."""
        return self._schedule.add_load(stamp, load, traction)

    def advance(self, stamp: int) -> bool:
        """Bring the state to the given time.

        Parameters
        ----------
        stamp : int
            [ns]

        Returns
        -------
        bool
            Whether the wheel is in motion: whether there is a state to read.

        Raises
        ------
        ValueError
            The time lies before the one reached already; :meth:`reset` first if the clock was set back.
        """
        self._motion.follow([self._schedule.plan(stamp)])
        if self._schedule.running and not self._motion.read([self.speed])[1][0]:
            self._schedule.give_up()
        return self._schedule.running

    def snapshot(self) -> dict[str, Any]:
        """Everything that later results depend on, in JSON's types; :meth:`restore` continues from it bit for bit."""
        return {**self._schedule.snapshot(), **self._motion.snapshot(0)}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over the samples, the state and the time of a :meth:`snapshot`."""
        self._schedule.restore(snapshot)
        self._motion.restore(0, snapshot)

    # -- what can be read -----------------------------------------------------------------------------------

    def ages(self) -> tuple[int | None, int | None]:
        """Ages [ns] of the speed and of the load in force at the estimator's time, None where there is none."""
        return self._schedule.ages()

    @property
    def speed(self) -> float:
        """Spin in force [rad/s]."""
        return self._schedule.speed

    @property
    def load(self) -> tuple[float, float]:
        """Vertical load and traction in force [N]."""
        return self._schedule.load

    @property
    def state(self) -> FloatArray:
        """Fixed-frame state in the paper's axes, as :func:`~tire_dynamics.science.wheel.fixed_frame_matrix` has it."""
        state: FloatArray = self._motion.state[0].copy()
        return state

    @property
    def phase(self) -> float:
        """How far the wheel has turned, modulo 2 pi [rad]: as it was told last, or since the start."""
        return float(self._motion.phase[0])

    @property
    def ring_state(self) -> FloatArray:
        """Ring-frame state of (5.1) [m/s, m]."""
        speed = float(self._motion.turning_at[0])
        return wheel.rotation(self.phase, speed, self.model, self._motion.unit.is_held) @ self.state

    @property
    def axle_force(self) -> tuple[float, float]:
        """Force on the axle (x, z), REP 103 axes [N]."""
        x, z = self._motion.read([self.speed])[0][0].tolist()
        return x, z

    def belt(self, shape: BeltShape) -> FloatArray:
        """Radial and tangential deflection of the belt relative to the wheel centre [m], shape (2, P)."""
        belt: FloatArray = self._motion.deflections([0], shape)[0]
        return belt
