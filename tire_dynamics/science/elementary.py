# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""exp, cos and sin whose bits are the same on every IEEE machine, compiled or interpreted.

C libraries and NumPy choose among several of each by the processor. These are sums, products and shifts in a fixed
order: the reduction and the polynomials of sin and cos are those of fdlibm (Sun Microsystems, 1993), exp is its
Taylor series behind a reduction by ln 2. Results are within 4 units in the last place.
"""

from __future__ import annotations

import math
import struct

import numpy as np
from numpy.typing import ArrayLike, NDArray

try:
    import cython
except ImportError:
    from . import cython_stand_in as cython
if cython.compiled:
    from cython.cimports.libc.string import memcpy

__all__ = ["cos_sin", "growth"]

FloatArray = NDArray[np.float64]

# x + ROUND - ROUND is x rounded to an integer, whose bits are the low ones of x + ROUND
ROUND = cython.declare(cython.double, 1.5 * 2.0**52)
PER_QUARTER = cython.declare(cython.double, 2.0 / math.pi)
P1 = cython.declare(cython.double, float.fromhex("0x1.921fb544p+0"))  # pi/2 in three parts
P2 = cython.declare(cython.double, float.fromhex("0x1.0b4611a6p-34"))
P3 = cython.declare(cython.double, float.fromhex("0x1.3198a2e037073p-69"))
PER_DOUBLING = cython.declare(cython.double, 1.0 / math.log(2.0))
L1 = cython.declare(cython.double, float.fromhex("0x1.62e42feep-1"))  # ln 2 in two parts
L2 = cython.declare(cython.double, float.fromhex("0x1.a39ef35793c76p-33"))
LARGEST = cython.declare(cython.double, 708.0)  # exponents beyond are taken as this: no overflow, nothing subnormal
E13 = cython.declare(cython.double, 1.0 / math.factorial(13))
E12 = cython.declare(cython.double, 1.0 / math.factorial(12))
E11 = cython.declare(cython.double, 1.0 / math.factorial(11))
E10 = cython.declare(cython.double, 1.0 / math.factorial(10))
E9 = cython.declare(cython.double, 1.0 / math.factorial(9))
E8 = cython.declare(cython.double, 1.0 / math.factorial(8))
E7 = cython.declare(cython.double, 1.0 / math.factorial(7))
E6 = cython.declare(cython.double, 1.0 / math.factorial(6))
E5 = cython.declare(cython.double, 1.0 / math.factorial(5))
E4 = cython.declare(cython.double, 1.0 / math.factorial(4))
E3 = cython.declare(cython.double, 1.0 / math.factorial(3))


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _bits(x: cython.double) -> cython.longlong:
    if cython.compiled:
        k: cython.longlong = 0
        memcpy(cython.address(k), cython.address(x), 8)
        return k
    else:
        return int(struct.unpack("<q", struct.pack("<d", x))[0])


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _from_bits(k: cython.longlong) -> cython.double:
    if cython.compiled:
        x: cython.double = 0.0
        memcpy(cython.address(x), cython.address(k), 8)
        return x
    else:
        return float(struct.unpack("<d", struct.pack("<Q", k & 0xFFFFFFFFFFFFFFFF))[0])


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def grow(
    count: cython.Py_ssize_t,
    first: cython.Py_ssize_t,
    rate: cython.double[::1],
    angle: cython.double[::1],
    time: cython.double,
    real: cython.double[::1],
    imaginary: cython.double[::1],
) -> cython.void:
    """exp((rate + i angle) time) of ``count`` elements from the ``first`` on, into ``real`` and ``imaginary``."""
    i: cython.Py_ssize_t
    y: cython.double
    shifted: cython.double
    whole: cython.double
    rest: cython.double
    z: cython.double
    u: cython.double
    size: cython.double
    sine: cython.double
    cosine: cython.double
    quarters: cython.longlong
    odd: cython.longlong
    a: cython.longlong
    b: cython.longlong
    for i in range(count):
        y = angle[first + i] * time
        shifted = y * PER_QUARTER + ROUND
        whole = shifted - ROUND
        quarters = _bits(shifted)
        rest = ((y - whole * P1) - whole * P2) - whole * P3
        z = rest * rest
        sine = 1.58969099521155010221e-10 * z + -2.50507602534068634195e-08
        sine = (sine * z + 2.75573137070700676789e-06) * z + -1.98412698298579493134e-04
        sine = ((sine * z + 8.33333333332248946124e-03) * z + -1.66666666666666324348e-01) * z
        sine = sine * rest + rest
        cosine = -1.13596475577881948265e-11 * z + 2.08757232129817482790e-09
        cosine = (cosine * z + -2.75573143513906633035e-07) * z + 2.48015872894767294178e-05
        cosine = (cosine * z + -1.38888888888741095749e-03) * z + 4.16666666666666019037e-02
        cosine = (cosine * z + -0.5) * z + 1.0
        u = rate[first + i] * time
        u = -LARGEST if u < -LARGEST else u  # NaN stays
        u = LARGEST if u > LARGEST else u
        shifted = u * PER_DOUBLING + ROUND
        whole = shifted - ROUND
        u = (u - whole * L1) - whole * L2
        size = ((((E13 * u + E12) * u + E11) * u + E10) * u + E9) * u + E8
        size = (((((size * u + E7) * u + E6) * u + E5) * u + E4) * u + E3) * u + 0.5
        size = (size * u + 1.0) * u + 1.0
        size = size * _from_bits((_bits(shifted) + 1023) << 52)
        # an odd number of quarter turns exchanges the two, and the sign goes into the size: masks, not branches
        odd = -(quarters & 1)
        a, b = _bits(cosine), _bits(sine)
        cosine, sine = _from_bits((a & ~odd) | (b & odd)), _from_bits((b & ~odd) | (a & odd))
        a = _bits(size)
        real[i] = cosine * _from_bits(a ^ (((quarters + 1) & 2) << 62))
        imaginary[i] = sine * _from_bits(a ^ ((quarters & 2) << 62))


def growth(rate: ArrayLike, angle: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Real and imaginary part of exp(rate + i angle).

    Parameters
    ----------
    rate, angle : array_like
        Of one shape, or such that NumPy broadcasts them; the rate is taken as -708 or 708 where it lies beyond, the
        angle [rad] is exactly reduced up to some 1e6.

    Returns
    -------
    real, imaginary : ndarray
    """
    rates, angles = np.broadcast_arrays(np.asarray(rate, dtype=np.float64), np.asarray(angle, dtype=np.float64))
    real, imaginary = np.empty(rates.size), np.empty(rates.size)
    flat = rates.flatten(), angles.flatten()
    grow(rates.size, 0, flat[0].data, flat[1].data, 1.0, real.data, imaginary.data)
    return real.reshape(rates.shape), imaginary.reshape(rates.shape)


def cos_sin(angle: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """cos and sin of angles [rad]."""
    return growth(0.0, angle)
