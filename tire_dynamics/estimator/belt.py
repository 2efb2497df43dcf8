"""The motion of the belt: its modes beside n = 1, and the shape that all modes make together."""

from __future__ import annotations

import math
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..science.modes import RingModes
from ..science.unit import TireWheelUnit
from ..science.wheel import Model

__all__ = ["BeltMotion", "BeltShape", "belt_numbers", "ring_angles"]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_MOST_HELD = 256  # steps that wait to be taken together


def ring_angles(samples: int) -> FloatArray:
    """psi_j = 2 pi j/samples, fixed in space [rad], shape (samples,)."""
    return 2.0 * math.pi * np.arange(samples) / samples


def belt_numbers(n_max: int, model: Model) -> NDArray[np.int64]:
    """The wavenumbers beside n = 1: 2..n_max, and 0 where the ring can stretch."""
    if not isinstance(n_max, Integral) or n_max < 2:
        raise ValueError(f"n_max is {n_max!r}; it must be an integer >= 2")
    numbers = np.arange(2, n_max + 1)
    return np.concatenate([[0], numbers]) if model == "complete" else numbers


class BeltShape:
    """Deflection of the belt relative to the wheel centre, at fixed angles, from the amplitudes of all modes.

    Parameters
    ----------
    psi : array_like, shape (P,)
        Angles fixed in space [rad].
    numbers : array_like of int, shape (N,)
        Wavenumbers of the modes beside n = 1.
    """

    def __init__(self, psi: ArrayLike, numbers: ArrayLike) -> None:
        angle = np.asarray(psi, dtype=np.float64)
        if angle.ndim != 1 or not np.isfinite(angle).all():
            raise ValueError("psi must be a row of finite angles")
        self._first = np.stack([np.cos(angle), np.sin(angle)])
        phase = np.multiply.outer(np.asarray(numbers, dtype=np.float64), angle)
        self._rest = np.concatenate([np.cos(phase), np.sin(phase)])

    def deflection(self, first: FloatArray, radial: ComplexArray, tangential: ComplexArray) -> FloatArray:
        """Radial (outward) and tangential (along increasing psi) deflection [m], shape (..., 2, P).

        Parameters
        ----------
        first : ndarray, shape (..., 4)
            The n = 1 part, :func:`~tire_dynamics.science.wheel.belt_amplitudes`.
        radial, tangential : ndarray of complex, shape (..., N)
            Z_1 and Z_2 of the others: u = Re[conj(Z) exp(i n psi)].
        """
        rest = np.stack([radial, tangential], axis=-2)
        shape = np.concatenate([rest.real, rest.imag], axis=-1) @ self._rest
        shape += np.stack([first[..., :2], first[..., 2:]], axis=-2) @ self._first
        deflection: FloatArray = shape
        return deflection


class BeltMotion:
    """The modes beside n = 1 through time, under forces that are held between changes.

    Steps are noted as they come and taken together when the state is wanted or the speed changes; exactly in
    either case.

    Parameters
    ----------
    unit : TireWheelUnit
    n_max : int
    model : {"inextensional", "complete"}
    """

    def __init__(self, unit: TireWheelUnit, n_max: int, model: Model) -> None:
        self.modes = RingModes(unit, belt_numbers(n_max, model), model)
        self._speed = 0.0
        self._spinning = self.modes.at(0.0)
        self._state = np.zeros(self._spinning.exponents.shape, dtype=np.complex128)
        self._steps: list[tuple[float, float, float]] = []  # length, f_r, f_t

    def replace_unit(self, unit: TireWheelUnit) -> None:
        """Change the tire from now on. Positions and velocities go on as they are."""
        self._take_steps()
        self.modes = RingModes(unit, self.modes.numbers, self.modes.model)
        self._spinning = self.modes.at(self._speed)

    def start(self, speed: float, load: float, traction: float) -> None:
        """Be in the steady state of a constant speed [rad/s], load and traction [N]."""
        self._steps = []
        self._turn_at(speed)
        self._state = self._spinning.steady(-load, -traction)

    def hold(self, length: float, speed: float, load: float, traction: float) -> None:
        """Go on for a time [s] under a speed [rad/s], a load and a traction [N]."""
        if speed != self._speed:
            self._take_steps()
            self._state = self.modes.change_speed(self._state, self._speed, speed)
            self._turn_at(speed)
        self._steps.append((length, -load, -traction))
        if len(self._steps) >= _MOST_HELD:
            self._take_steps()

    def _turn_at(self, speed: float) -> None:
        if speed != self._speed:
            self._speed = speed
            self._spinning = self.modes.at(speed)

    def _take_steps(self) -> None:
        if self._steps:
            steps = np.array(self._steps)
            self._state = self._spinning.hold(self._state, steps[:, 0], steps[:, 1:])
            self._steps = []

    def amplitudes(self) -> tuple[ComplexArray, ComplexArray]:
        """Z_1 and Z_2 of the modes, shape (N,) [m]."""
        self._take_steps()
        return self.modes.amplitudes(self._state)

    def snapshot(self) -> dict[str, Any]:
        """Everything that later results depend on, in JSON's types."""
        self._take_steps()
        return {"speed": self._speed, "state": [self._state.real.tolist(), self._state.imag.tolist()]}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Take over a :meth:`snapshot`."""
        self._steps = []
        self._turn_at(snapshot["speed"])
        real, imaginary = (np.array(part) for part in snapshot["state"])
        if real.shape != self._state.shape or imaginary.shape != self._state.shape:
            raise ValueError(f"the belt's state has shape {real.shape}; it must be {self._state.shape}")
        self._state = real + 1j * imaginary
