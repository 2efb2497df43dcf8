"""The Campbell diagram: exponents of the wheel's modes and the belt's waves over speed, seen from the fixed frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .modes import RingModes
from .unit import TireWheelUnit
from .wheel_matrices import Model, fixed_frame_matrix

__all__ = ["WAVES", "WHEEL_MODES", "campbell_exponents", "wave_exponents", "wheel_exponents"]

ComplexArray = NDArray[np.complex128]

WAVES: Final = ("backward", "forward")
"""Seen from the ring: against its spin and along it."""

WHEEL_MODES: Final = ("wheel_hop", "ring_fore_aft", "ring_vertical")
"""Of n = 1 with the wheel, by frequency, named as they are at rest."""


def campbell_exponents(
    unit: TireWheelUnit, speeds: ArrayLike, numbers: Sequence[int], model: Model = "inextensional"
) -> tuple[dict[str, ComplexArray], dict[tuple[int, str], ComplexArray]]:
    """Exponents over speed.

    Parameters
    ----------
    unit : TireWheelUnit
    speeds : array_like, shape (S,)
        Spin Omega [rad/s].
    numbers : sequence of int
        Wavenumbers n >= 2.
    model : {"inextensional", "complete"}

    Returns
    -------
    wheel_modes : dict of ndarray of complex, shape (S,)
        Exponents [1/s] by the names of ``WHEEL_MODES``; fewer where a motion is overdamped at a speed.
    waves : dict of ndarray of complex, shape (S,)
        Likewise by wavenumber and the names of ``WAVES``; of the complete model the slower two.
    """
    each = np.asarray(speeds, dtype=np.float64).tolist()
    rigid = [wheel_exponents(unit, speed, model) for speed in each]
    count = min((len(some) for some in rigid), default=0)
    wheel_modes = {name: np.array([some[k] for some in rigid]) for k, name in enumerate(WHEEL_MODES[:count])}
    modes = RingModes(unit, numbers, model)
    both = np.array([wave_exponents(modes, speed) for speed in each])
    waves = {(n, wave): both[:, k, j] for k, n in enumerate(numbers) for j, wave in enumerate(WAVES)}
    return wheel_modes, waves


def wave_exponents(modes: RingModes, speed: float) -> ComplexArray:
    """Exponents [1/s], fixed frame, of each mode's slower two waves, shape (N, 2): backward, forward on the ring."""
    exponents = modes.at(speed).exponents
    order = np.argsort(exponents.imag, axis=1)
    middle = order.shape[1] // 2
    return np.take_along_axis(exponents, order[:, middle - 1 : middle + 1], axis=1)


def wheel_exponents(unit: TireWheelUnit, speed: float, model: Model = "inextensional") -> ComplexArray:
    """Exponents [1/s] of n = 1 with the wheel, fixed frame, positive frequency: the slowest three, ascending."""
    exponents = np.linalg.eigvals(fixed_frame_matrix(unit, speed, model))
    exponents = exponents[exponents.imag > 0.0]
    return np.asarray(exponents[np.argsort(exponents.imag)][: len(WHEEL_MODES)], dtype=np.complex128)
