# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""The eigenvalues of the inextensional modes at a speed, in a fixed order of operations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

try:
    import cython
except ImportError:
    from . import cython_stand_in as cython
if cython.compiled:
    from cython.cimports.libc.math import sqrt
else:
    from math import sqrt

__all__ = ["COLUMNS", "eigensystems"]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

COLUMNS = 14
"""Of a table of modes: n, d, the force's real and imaginary part, A, A_1, C, C_1, D, D_1, D_2, 1 (0 in the hybrid
model, which has no Coriolis term), B, B_1."""

_COLUMNS = cython.declare(cython.Py_ssize_t, COLUMNS)


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def twist_at(table: cython.double[::1], mode: cython.Py_ssize_t, square: cython.double) -> cython.double:
    """gamma_n = (C + n A)/(A + n C) of a mode at a speed of this square, the share of the Coriolis term."""
    at: cython.Py_ssize_t = mode * _COLUMNS
    n: cython.double = table[at]
    A: cython.double = table[at + 4] + square * table[at + 5]
    C: cython.double = table[at + 6] + square * table[at + 7]
    return table[at + 11] * ((C + n * A) / (A + n * C))


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def stretch_at(table: cython.double[::1], mode: cython.Py_ssize_t, square: cython.double) -> cython.double:
    """A_n/C_n at a speed of this square: without inertia, the tangential amplitude is -i times this of the radial."""
    at: cython.Py_ssize_t = mode * _COLUMNS
    return (table[at + 4] + square * table[at + 5]) / (table[at + 6] + square * table[at + 7])


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def mode_eigensystem(
    count: cython.Py_ssize_t,
    table: cython.double[::1],
    speed: cython.double,
    wheel: cython.Py_ssize_t,
    rate: cython.double[::1],
    frequency: cython.double[::1],
    steady: cython.double[::1],
    right: cython.double[::1],
    left: cython.double[::1],
) -> cython.void:
    """Eigenvalues of all modes at a speed, and what goes with them, into the places of one wheel.

    With k = n (B C - A^2)/(A + n C), g = gamma Omega and w = n Omega,

        V' = i w V - (d + 2 i g) V - k Z + r f,     Z' = V + i w Z,
        r = force n C/(A + n C) for f_r, and i force n A/(A + n C) for f_t.

    In x = (V, Z) = right own, own' = mu own + b f, right = [[s+, s-], [1, 1]], s = mu - i w, left its inverse.

    Parameters
    ----------
    count : int
        N.
    table : buffer, shape (N * COLUMNS,)
    speed : float
        Omega [rad/s].
    wheel : int
    rate, frequency : buffer, shape (W * 2 N,)
        Filled with mu [1/s], at 2 n + k behind 2 N wheel.
    steady : buffer, shape (W * 8 N,)
        -b/mu, what a constant f of 1 N leaves: in rows of 2 N the real and imaginary part for f_r, those for f_t.
    right, left : buffer, shapes (W * 4 N,), (W * 8 N,)
        s in rows of 2 N, real and imaginary; left in rows of 2 N by (real, imaginary) and column.
    """
    M: cython.Py_ssize_t = 2 * count
    e: cython.Py_ssize_t
    i: cython.Py_ssize_t
    k: cython.Py_ssize_t
    at: cython.Py_ssize_t
    square: cython.double = speed * speed
    n: cython.double
    A: cython.double
    C: cython.double
    d: cython.double
    g: cython.double
    p: cython.double
    q: cython.double
    x: cython.double
    y: cython.double
    u: cython.double
    v: cython.double
    size: cython.double
    sign: cython.double
    real: cython.double
    imaginary: cython.double
    turned: cython.double
    r: cython.double
    t: cython.double
    c: cython.double
    h: cython.double
    for i in range(count):
        at = i * _COLUMNS
        n, d = table[at], table[at + 1]
        A = table[at + 4] + square * table[at + 5]
        C = table[at + 6] + square * table[at + 7]
        size = 1.0 / (A + n * C)
        g = speed * (table[at + 11] * ((C + n * A) * size))
        p = table[at + 8] + square * (table[at + 9] + square * table[at + 10])
        p, q = 0.25 * d * d - g * g - n * p * size, d * g
        A, C = n * A * size, n * C * size
        # the root x + i y of p + i q
        size = sqrt(p * p + q * q)
        x = sqrt(0.5 * (size + abs(p)))
        if x < 1e-7 * (0.5 * d + abs(g)):  # two equal eigenvalues have one eigenvector: keep them apart
            x = 1e-7 * (0.5 * d + abs(g))
            size = x * x
        y = 0.5 * q / x
        if p < 0.0:
            x, y = y, x
        # 1/(2 root) = u + i v
        size = 0.5 / size
        u, v = x * size, -y * size
        for k in range(2):
            e = 2 * i + k
            sign = 1.0 if k == 0 else -1.0
            real, imaginary = sign * x - 0.5 * d, sign * y - g
            turned = imaginary + n * speed
            rate[wheel * M + e], frequency[wheel * M + e] = real, turned
            right[2 * wheel * M + e], right[(2 * wheel + 1) * M + e] = real, imaginary
            # left = 1/(2 root) [[1, -s-], [-1, s+]]
            left[4 * wheel * M + e], left[(4 * wheel + 1) * M + e] = sign * u, sign * v
            # the row of the other eigenvalue
            left[(4 * wheel + 2) * M + e + 1 - 2 * k] = sign * (u * real - v * imaginary)
            left[(4 * wheel + 3) * M + e + 1 - 2 * k] = sign * (u * imaginary + v * real)
            # -1/mu, with the sign of the row of left
            size = sign / (real * real + turned * turned)
            c, h = -real * size, turned * size
            r, t = C * table[at + 2], C * table[at + 3]
            r, t = u * r - v * t, u * t + v * r
            steady[4 * wheel * M + e], steady[(4 * wheel + 1) * M + e] = r * c - t * h, r * h + t * c
            r, t = -(A * table[at + 3]), A * table[at + 2]
            r, t = u * r - v * t, u * t + v * r
            steady[(4 * wheel + 2) * M + e], steady[(4 * wheel + 3) * M + e] = r * c - t * h, r * h + t * c


def eigensystems(table: FloatArray, speed: float) -> tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]:
    """:func:`mode_eigensystem` as arrays.

    Parameters
    ----------
    table : ndarray, shape (N, COLUMNS)
    speed : float
        Omega [rad/s].

    Returns
    -------
    exponents : ndarray of complex, shape (N, 2)
        mu [1/s].
    steady : ndarray of complex, shape (N, 2, 2)
        By eigenvalue and force (f_r, f_t).
    right, left : ndarray of complex, shape (N, 2, 2)
    """
    N = len(table)
    rate, frequency, steady, slow, left = (np.empty(rows * 2 * N) for rows in (1, 1, 4, 2, 4))
    mode_eigensystem(
        N, np.ascontiguousarray(table).reshape(-1).data, speed, 0, rate.data, frequency.data,
        steady.data, slow.data, left.data,
    )  # fmt: skip
    s = (slow[: 2 * N] + 1j * slow[2 * N :]).reshape(N, 2)
    shapes = (steady.reshape(4, N, 2)[0::2] + 1j * steady.reshape(4, N, 2)[1::2]).transpose(1, 2, 0)
    inverse = (left.reshape(4, N, 2)[0::2] + 1j * left.reshape(4, N, 2)[1::2]).transpose(1, 2, 0)
    return (rate + 1j * frequency).reshape(N, 2), shapes, np.stack([s, np.ones_like(s)], axis=1), inverse
