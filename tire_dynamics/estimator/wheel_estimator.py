"""One wheel through time, fed with stamped samples."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..science import wheel
from ..science.unit import TireWheelUnit
from .belt import shape_basis
from .schedule import FOREVER
from .settings import VehicleSettings
from .wheels import Wheels

__all__ = ["WheelEstimator"]

FloatArray = NDArray[np.float64]


class WheelEstimator:
    """The motion of one ring, its wheel and its suspension, in real time or faster.

    Speed samples, load samples and calls of :meth:`advance` each bring their own time stamp, in integer
    nanoseconds of one common clock; the estimator reads no clock. It integrates the periodic system exactly
    between samples, and the same calls in the same order give the same bits.

    For programs of one wheel. It is one wheel of :class:`.wheels.Wheels`, the loop of the node and the replay, and has
    no arithmetic of its own.

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
    What happens to a sample is :class:`.schedule.Schedule`'s to say, and what to a motion that diverges
    :class:`.wheels.Wheels`'s. The motion starts at equilibrium, in the steady state of the speed and the load, at the
    first moment at which both are known and neither is older than the timeout. When one of them becomes older than the
    timeout the motion stops; it starts again from equilibrium by the same rule. A gap shorter than the timeout is
    bridged with the held values, exactly and in one step.
    """

    def __init__(
        self,
        unit: TireWheelUnit,
        model: wheel.Model = "inextensional",
        n_max: int = 30,
        timeout: int | None = None,
    ) -> None:
        self.model = model
        settings = VehicleSettings(
            unit, model=model, n_max=n_max, ring_samples=3, max_speed=math.inf, max_load=math.inf,
            input_timeout=FOREVER if timeout is None else timeout,
        )  # fmt: skip
        self._wheels = Wheels(settings)
        self._schedule, self._motion, self._belt = self._wheels.schedule, self._wheels.motion, self._wheels.belt

    @property
    def unit(self) -> TireWheelUnit:
        """The tire."""
        return self._motion.unit

    @property
    def counts(self) -> Counter[str]:
        """Samples by outcome."""
        return self._schedule.counts_of(0)

    @property
    def stops(self) -> int:
        """How often the motion stopped for inputs that were too old."""
        return self._schedule.stops_of(0)

    @property
    def divergences(self) -> int:
        """How often the motion was given up."""
        return self._schedule.divergences_of(0)

    @property
    def time(self) -> int | None:
        """The time reached [ns]."""
        return self._schedule.time_of(0)

    @property
    def running(self) -> bool:
        """Whether the wheel is in motion."""
        return self._schedule.is_running(0)

    def set_unit(self, unit: TireWheelUnit) -> None:
        """Change the tire from now on. Positions and velocities go on as they are."""
        self._wheels.set_unit(unit)

    def reset(self) -> None:
        """Forget every sample, the state and the time."""
        self._wheels.reset()

    # -- samples and time -----------------------------------------------------------------------------------

    def add_speed(self, stamp: int, speed: float, angle: float = math.nan) -> str:
        """Take a sample of the spin [rad/s], positive rolling forward, and of the wheel's angle [rad] if it is known.

        Only a tire that is not the same all around asks for the angle; from sample to sample it follows the spin.
        """
        return self._schedule.add_speed(0, stamp, speed, angle)

    def add_load(self, stamp: int, load: float, traction: float = 0.0) -> str:
        """Take a sample of the vertical load, up positive, and of the traction along x_ros, on the tire [N]."""
        return self._schedule.add_load(0, stamp, load, traction)

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
        reached = self.time
        if reached is not None and stamp < reached:
            raise ValueError(f"stamp is {stamp}; the estimator has already reached {reached}")
        self._wheels.tick(stamp)
        return self.running

    def snapshot(self) -> dict[str, Any]:
        """Everything that later results depend on, in JSON's types; :meth:`restore` continues from it bit for bit."""
        return self._wheels.snapshot()

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over the samples, the state and the time of a :meth:`snapshot`."""
        self._wheels.restore(snapshot)

    # -- what can be read -----------------------------------------------------------------------------------

    def ages(self) -> tuple[int | None, int | None]:
        """Ages [ns] of the speed and of the load in force at the estimator's time, None where there is none."""
        return self._schedule.ages(0)

    @property
    def speed(self) -> float:
        """Spin in force [rad/s]."""
        return self._schedule.speed_of(0)

    @property
    def load(self) -> tuple[float, float]:
        """Vertical load and traction in force [N]."""
        return self._schedule.load_of(0)

    @property
    def state(self) -> FloatArray:
        """Fixed-frame state in the paper's axes, as :func:`~tire_dynamics.science.wheel.fixed_frame_matrix` has it."""
        return self._motion.state_of(0)

    @property
    def phase(self) -> float:
        """How far the wheel has turned, modulo 2 pi [rad]: as measured last, or since the start."""
        return self._motion.phase_of(0)

    @property
    def ring_state(self) -> FloatArray:
        """Ring-frame state of (5.1) [m/s, m]."""
        speed = self._motion.spin_speed_of(0)
        return wheel.rotation(self.phase, speed, self.model, self.unit.is_longitudinally_rigid) @ self.state

    @property
    def axle_force(self) -> tuple[float, float]:
        """Force on the axle (x, z), REP 103 axes [N]."""
        return self._motion.axle_force(0, self.speed)

    def belt(self, psi: ArrayLike) -> FloatArray:
        """Radial and tangential deflection of the belt relative to the wheel centre [m], shape (2, P), at P angles."""
        first = wheel.belt_amplitudes(self.state, self.model)
        radial, tangential = self._belt.modes.amplitudes(self._belt.state_of(0))
        rows = np.concatenate([first.reshape(2, 2), np.stack([radial.real, tangential.real]),
                               np.stack([radial.imag, tangential.imag])], axis=1)
        return rows @ shape_basis(psi, self._belt.modes.numbers)
