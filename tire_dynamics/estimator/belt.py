"""The shape of the belt, from the states of its modes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..science import ring
from ..science.unit import TireWheelUnit

__all__ = ["Belt", "ring_angles"]

FloatArray = NDArray[np.float64]


def ring_angles(samples: int) -> FloatArray:
    """psi_j = 2 pi j/samples, fixed in space [rad], shape (samples,)."""
    return 2.0 * math.pi * np.arange(samples) / samples


class Belt:
    """Deflection of the belt relative to the wheel centre, at fixed angles.

    Parameters
    ----------
    unit : TireWheelUnit
    psi : array_like, shape (P,)
        Angles fixed in space [rad].
    n_max : int
        Highest wavenumber, >= 2.
    """

    def __init__(self, unit: TireWheelUnit, psi: ArrayLike, n_max: int) -> None:
        if n_max < 2:
            raise ValueError(f"n_max is {n_max!r}; it must be >= 2")
        angle = np.asarray(psi, dtype=np.float64)
        if angle.ndim != 1 or not np.isfinite(angle).all():
            raise ValueError("psi must be a row of finite angles")
        self.unit = unit
        self._cos, self._sin = np.cos(angle), np.sin(angle)
        self._number = np.arange(2, n_max + 1)
        phase = self._number[:, None] * (angle - ring.CONTACT_ANGLE)
        self._mode_cos, self._mode_sin = np.cos(phase), np.sin(phase)

    def deflection(self, state: FloatArray, speed: float, load: float, traction: float) -> FloatArray:
        """Radial (outward) and tangential (along increasing psi) deflection [m], shape (2, P).

        The n = 1 motion in the given fixed-frame state [X', Y', y', X, Y, y], relative to the wheel, plus the
        steady response of modes 2..n_max to the present load, traction and speed, (4.5).
        """
        X, Y, y = state[3], state[4], state[5]
        cosine, sine = ring.steady_amplitudes(self.unit, self._number, speed, load, traction)
        shape = np.empty((2, self._cos.size))
        shape[0] = _sum(cosine, self._mode_cos) + _sum(sine, self._mode_sin)
        shape[0] += X * self._cos + (Y - y) * self._sin
        shape[1] = _sum(sine / self._number, self._mode_cos) - _sum(cosine / self._number, self._mode_sin)
        shape[1] += (Y - y) * self._cos - X * self._sin
        return shape


def _sum(amplitude: FloatArray, mode: FloatArray) -> FloatArray:
    """sum_n amplitude_n mode_n(psi), the terms added in order: the same bits everywhere."""
    return np.asarray(np.add.reduce(amplitude[:, None] * mode, axis=0))
