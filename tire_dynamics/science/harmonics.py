"""What varies around a tire, as harmonics: their numbers, amplitudes and angles on the ring, checked."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable
from numbers import Real
from typing import Any, Final

import numpy as np

__all__ = ["HIGHEST", "Harmonic", "check_factor", "harmonics"]

Harmonic = tuple[int, float, float]

HIGHEST: Final = 100
"""Harmonic; the tread's blocks are above it, and a sidewall knows nothing of them."""


def harmonics(name: str, value: Any) -> tuple[Harmonic, ...]:
    """Harmonics j >= 1, each once, amplitudes e_j >= 0 and angles chi_j [rad] of sum_j e_j cos j(theta - chi_j).

    Parameters
    ----------
    name : str
        Of the field, for the message.
    value : sequence
        Of (harmonic, amplitude, angle), or of all their numbers one after the other, as a ROS parameter has them.

    Raises
    ------
    ValueError
        The message has the field, the value and the bound.
    """
    if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
        raise ValueError(f"{name} is {value!r}; it must be a list of (harmonic, amplitude, angle)")
    items = value.tolist() if isinstance(value, np.ndarray) else list(value)
    if items and all(isinstance(item, Real) for item in items):
        if len(items) % 3:
            raise ValueError(f"{name} is {items!r}; it must have three for each harmonic")
        items = [tuple(items[first : first + 3]) for first in range(0, len(items), 3)]
    found = tuple(_harmonic(f"{name}[{k}]", item) for k, item in enumerate(items))
    numbers = [j for j, _, _ in found]
    for j in numbers:
        if numbers.count(j) > 1:
            raise ValueError(f"{name} has harmonic {j} twice; each must stand once")
    return found


def check_factor(name: str, some: tuple[Harmonic, ...]) -> None:
    """``ValueError`` unless 1 + sum_j e_j cos j(theta - chi_j) > 0 at every theta."""
    lowest, where = _lowest(some)
    if not lowest > 0.0:
        raise ValueError(f"{name} makes the stiffness {lowest:.6g} of its mean at {where:.6g} rad; it must be > 0")


def _harmonic(name: str, value: Any) -> Harmonic:
    try:
        j, e, chi = value
    except (TypeError, ValueError):
        raise ValueError(f"{name} is {value!r}; it must be (harmonic, amplitude, angle)") from None
    if isinstance(j, bool) or not (isinstance(j, (int, np.integer)) or isinstance(j, float) and j.is_integer()):
        raise ValueError(f"{name} has harmonic {j!r}; it must be an integer from 1 to {HIGHEST}")
    if not 1 <= j <= HIGHEST:
        raise ValueError(f"{name} has harmonic {j!r}; it must be from 1 to {HIGHEST}")
    for what, number in (("amplitude", e), ("angle", chi)):
        if isinstance(number, bool) or not isinstance(number, Real) or not _is_finite(number):
            raise ValueError(f"{name} has {what} {number!r}; it must be a finite number")
    if e < 0.0:
        raise ValueError(f"{name} has amplitude {e!r}; it must be >= 0")
    return int(j), float(e), float(chi)


def _is_finite(number: Real) -> bool:
    try:
        return math.isfinite(number)
    except OverflowError:
        return False


def _lowest(some: tuple[Harmonic, ...]) -> tuple[float, float]:
    """The minimum of 1 + sum e cos j(theta - chi), and where it is; a bound where that is enough."""
    if (most := sum(e for _, e, _ in some)) < 1.0:
        return 1.0 - most, 0.0
    highest = max(j for j, _, _ in some)
    slope = np.zeros(2 * highest + 1, dtype=np.complex128)  # coefficients of exp(i p theta), from p = highest down
    for j, e, chi in some:
        slope[highest - j] += 1j * j * e * cmath.exp(-1j * j * chi)
        slope[highest + j] -= 1j * j * e * cmath.exp(1j * j * chi)
    slope[np.abs(slope) < 1e-14 * np.abs(slope).max()] = 0.0  # the roots divide by the first
    roots = np.roots(slope)
    theta = np.mod(np.concatenate([np.linspace(0.0, 2.0 * math.pi, 8 * highest + 1), np.angle(roots)]), 2.0 * math.pi)
    factor = 1.0 + sum(e * np.cos(j * (theta - chi)) for j, e, chi in some) + 0.0 * theta
    k = int(np.argmin(factor))
    return float(factor[k]), float(theta[k])
