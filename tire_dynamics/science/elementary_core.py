# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
# mypy: disable-error-code=untyped-decorator
"""exp, cos and sin whose bits are the same on every IEEE machine; compiled where the package was built with a compiler.

The sums are those of elementary.py, in the same order.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np

from . import elementary
from .elementary import COSINE, DOUBLING, EXPONENTIAL, QUARTER, SINE

try:
    import cython
except ImportError:
    from . import cython_stand_in as cython
if cython.compiled:
    from cython.cimports.libc.string import memcpy

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["COMPILED", "Growth"]

COMPILED = cython.compiled

# C globals: a name of the module would be looked up and unpacked at each use.
LARGEST = cython.declare(cython.double, elementary.LARGEST)
ROUND = cython.declare(cython.double, elementary.ROUND)
PER_QUARTER = cython.declare(cython.double, elementary.PER_QUARTER)
PER_DOUBLING = cython.declare(cython.double, elementary.PER_DOUBLING)
P1 = cython.declare(cython.double, QUARTER[0])
P2 = cython.declare(cython.double, QUARTER[1])
P3 = cython.declare(cython.double, QUARTER[2])
L1 = cython.declare(cython.double, DOUBLING[0])
L2 = cython.declare(cython.double, DOUBLING[1])
S6 = cython.declare(cython.double, SINE[0])
S5 = cython.declare(cython.double, SINE[1])
S4 = cython.declare(cython.double, SINE[2])
S3 = cython.declare(cython.double, SINE[3])
S2 = cython.declare(cython.double, SINE[4])
S1 = cython.declare(cython.double, SINE[5])
C6 = cython.declare(cython.double, COSINE[0])
C5 = cython.declare(cython.double, COSINE[1])
C4 = cython.declare(cython.double, COSINE[2])
C3 = cython.declare(cython.double, COSINE[3])
C2 = cython.declare(cython.double, COSINE[4])
C1 = cython.declare(cython.double, COSINE[5])
C0 = cython.declare(cython.double, COSINE[6])
E13 = cython.declare(cython.double, EXPONENTIAL[0])
E12 = cython.declare(cython.double, EXPONENTIAL[1])
E11 = cython.declare(cython.double, EXPONENTIAL[2])
E10 = cython.declare(cython.double, EXPONENTIAL[3])
E9 = cython.declare(cython.double, EXPONENTIAL[4])
E8 = cython.declare(cython.double, EXPONENTIAL[5])
E7 = cython.declare(cython.double, EXPONENTIAL[6])
E6 = cython.declare(cython.double, EXPONENTIAL[7])
E5 = cython.declare(cython.double, EXPONENTIAL[8])
E4 = cython.declare(cython.double, EXPONENTIAL[9])
E3 = cython.declare(cython.double, EXPONENTIAL[10])
E2 = cython.declare(cython.double, EXPONENTIAL[11])
E1 = cython.declare(cython.double, EXPONENTIAL[12])


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _bits(x: cython.double) -> cython.longlong:
    """The 64 bits of a double; in C by memcpy, which is one instruction, as a cast of pointers is undefined."""
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
def _double(k: cython.longlong) -> cython.double:
    """The double with these 64 bits."""
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
    rate: cython.double[::1],
    angle: cython.double[::1],
    time: cython.double,
    real: cython.double[::1],
    imaginary: cython.double[::1],
) -> cython.void:
    """exp((rate + i angle) time), as elementary.growth has it."""
    i: cython.Py_ssize_t
    quarters: cython.longlong
    y: cython.double
    shifted: cython.double
    rest: cython.double
    z: cython.double
    sine: cython.double
    cosine: cython.double
    u: cython.double
    size: cython.double
    for i in range(rate.shape[0]):
        y = angle[i] * time
        shifted = y * PER_QUARTER + ROUND
        quarters = _bits(shifted)
        shifted = shifted - ROUND
        rest = ((y - shifted * P1) - shifted * P2) - shifted * P3
        z = rest * rest
        sine = (((((S6 * z + S5) * z + S4) * z + S3) * z + S2) * z + S1) * z
        sine = sine * rest + rest
        cosine = ((((((C6 * z + C5) * z + C4) * z + C3) * z + C2) * z + C1) * z + C0) * z + 1.0
        if quarters & 1:
            sine, cosine = cosine, sine
        if quarters & 2:
            sine = -sine
        if (quarters + 1) & 2:
            cosine = -cosine
        u = min(max(rate[i] * time, -LARGEST), LARGEST)
        shifted = u * PER_DOUBLING + ROUND
        quarters = _bits(shifted)
        shifted = shifted - ROUND
        u = (u - shifted * L1) - shifted * L2
        size = (((((E13 * u + E12) * u + E11) * u + E10) * u + E9) * u + E8) * u + E7
        size = ((((((size * u + E6) * u + E5) * u + E4) * u + E3) * u + E2) * u + E1) * u + 1.0
        size = size * _double((quarters + 1023) << 52)
        real[i] = cosine * size
        imaginary[i] = sine * size


@cython.cclass
class Growth:
    """exp((rate + i angle) time) of given exponents, at one time after the other.

    Parameters
    ----------
    rate, angle : array_like
        Real and imaginary parts of the exponents, [1/s]; of one length.

    Raises
    ------
    ValueError
        If they are not of one length.
    """

    rate: cython.double[::1]
    angle: cython.double[::1]
    real: cython.double[::1]
    imaginary: cython.double[::1]

    def __init__(self, rate: ArrayLike, angle: ArrayLike) -> None:
        rates, angles = (np.array(values, dtype=np.float64).reshape(-1) for values in (rate, angle))
        if rates.size != angles.size:
            raise ValueError(f"rate and angle must be of one length, not {rates.size} and {angles.size}")
        self.rate, self.angle = rates.data, angles.data
        self.real, self.imaginary = np.zeros(rates.size).data, np.zeros(rates.size).data

    def take(self, time: cython.double) -> None:
        """Computes the values at a time [s]."""
        grow(self.rate, self.angle, time, self.real, self.imaginary)

    def values(self) -> NDArray[np.complex128]:
        """The values at the time taken last."""
        return np.asarray(self.real) + 1j * np.asarray(self.imaginary)
