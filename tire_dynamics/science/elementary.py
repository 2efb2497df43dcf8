"""exp, cos and sin whose bits are the same on every IEEE machine.

C libraries and NumPy choose among several of each by the processor. These are sums, products and shifts in a fixed
order: the reduction and the polynomials of sin and cos are those of fdlibm (Sun Microsystems, 1993), exp is its
Taylor series behind a reduction by ln 2. Results are within 4 units in the last place.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["cos_sin", "growth"]

FloatArray = NDArray[np.float64]

ROUND: Final = 1.5 * 2.0**52  # x + ROUND - ROUND is x rounded to an integer, whose bits are the low ones of x + ROUND
PER_QUARTER: Final = 2.0 / math.pi
QUARTER: Final = tuple(map(float.fromhex, ("0x1.921fb544p+0", "0x1.0b4611a6p-34", "0x1.3198a2e037073p-69")))  # pi/2
PER_DOUBLING: Final = 1.0 / math.log(2.0)
DOUBLING: Final = tuple(map(float.fromhex, ("0x1.62e42feep-1", "0x1.a39ef35793c76p-33")))  # ln 2
SINE: Final = (
    *(1.58969099521155010221e-10, -2.50507602534068634195e-08, 2.75573137070700676789e-06),
    *(-1.98412698298579493134e-04, 8.33333333332248946124e-03, -1.66666666666666324348e-01),
)
COSINE: Final = (
    *(-1.13596475577881948265e-11, 2.08757232129817482790e-09, -2.75573143513906633035e-07),
    *(2.48015872894767294178e-05, -1.38888888888741095749e-03, 4.16666666666666019037e-02, -0.5),
)
EXPONENTIAL: Final = tuple(1.0 / math.factorial(k) for k in range(13, 0, -1))
LARGEST: Final = 708.0  # exponents beyond are taken as this one: nothing overflows, nothing is subnormal


def growth(rate: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Real and imaginary part of exp(rate + i angle), for arrays of one shape.

    Parameters
    ----------
    rate : ndarray
        Taken as -708 or 708 where it lies beyond.
    angle : ndarray
        [rad]; exactly reduced up to some 1e6.

    Returns
    -------
    real, imaginary : ndarray
    """
    shifted = angle * PER_QUARTER + ROUND
    quarters = shifted.view(np.int64)
    shifted = shifted - ROUND
    rest = ((angle - shifted * QUARTER[0]) - shifted * QUARTER[1]) - shifted * QUARTER[2]
    square = rest * rest
    sine = _polynomial(SINE, square)
    sine *= rest
    sine += rest
    cosine = _polynomial(COSINE, square)
    cosine += 1.0
    odd = (quarters & 1).astype(bool)
    sine, cosine = np.where(odd, cosine, sine), np.where(odd, sine, cosine)

    limited = np.minimum(np.maximum(rate, -LARGEST), LARGEST)
    shifted = limited * PER_DOUBLING + ROUND
    doublings = shifted.view(np.int64)
    shifted = shifted - ROUND
    size = _polynomial(EXPONENTIAL, (limited - shifted * DOUBLING[0]) - shifted * DOUBLING[1])
    size += 1.0
    size *= ((doublings + 1023) << 52).view(np.float64)
    bits = size.view(np.int64)  # the sign of a quarter turn goes into the size
    cosine *= (bits ^ (((quarters + 1) & 2) << 62)).view(np.float64)
    sine *= (bits ^ ((quarters & 2) << 62)).view(np.float64)
    return cosine, sine


def cos_sin(angle: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """cos and sin of angles [rad]."""
    angles = np.asarray(angle, dtype=np.float64)
    flat = angles.reshape(-1)
    cosine, sine = growth(np.zeros_like(flat), flat)
    return cosine.reshape(angles.shape), sine.reshape(angles.shape)


def _polynomial(coefficients: tuple[float, ...], x: FloatArray) -> FloatArray:
    """(...((c_0 x + c_1) x + c_2) ... + c_last) x."""
    total = coefficients[0] * x
    for coefficient in coefficients[1:]:
        total += coefficient
        total *= x
    return total
