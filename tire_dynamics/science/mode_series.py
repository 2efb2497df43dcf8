# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Steps of the modes beside n = 1 over which the speed changes: Taylor series of their states.

With the speed linear over a step of length h, Omega = Omega_0 + D tau, tau = t/h, A, B, C and B C - A^2 of (3.5) are
polynomials in tau, so that the equations of :mod:`.modes` give one Taylor coefficient of the state after the other.
Those of the inextensional modes are multiplied by A + n C before, by which they are divided.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .eigensystem import COLUMNS

try:
    import cython
except ImportError:
    from . import cython_stand_in as cython
if cython.compiled:
    from cython.cimports.libc.math import ceil, sqrt
else:
    from math import ceil, sqrt

__all__ = ["mode_steps"]

ComplexArray = NDArray[np.complex128]
FloatArray = NDArray[np.float64]

_COLUMNS = cython.declare(cython.Py_ssize_t, COLUMNS)
_LONGEST = cython.declare(cython.double, 3.0)  # norm of the system times the length of a piece
_NEGLIGIBLE = cython.declare(cython.double, 2.0**-57)
_MOST_PIECES = cython.declare(cython.double, 1e6)
_MOST_TERMS = 64


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _order(reach: cython.double) -> cython.Py_ssize_t:
    """Of a Taylor series whose term k is at most reach^k/k!."""
    order: cython.Py_ssize_t = 1
    term: cython.double = reach
    while term > _NEGLIGIBLE or order < reach:
        order += 1
        term = term * reach / order
    return order


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _sum(
    width: cython.Py_ssize_t,
    order: cython.Py_ssize_t,
    terms: cython.double[::1],
    state: cython.double[::1],
    first: cython.Py_ssize_t,
) -> cython.void:
    """The sum of the terms of each of ``width`` numbers, the smallest first, into the state."""
    j: cython.Py_ssize_t
    k: cython.Py_ssize_t
    total: cython.double
    for j in range(width):
        total = terms[width * order + j]
        for k in range(order - 1, -1, -1):
            total += terms[width * k + j]
        state[first + j] = total


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _inextensional(
    table: cython.double[::1],
    at: cython.Py_ssize_t,
    state: cython.double[::1],
    first: cython.Py_ssize_t,
    length: cython.double,
    speed: cython.double,
    slope: cython.double,
    radial: cython.double,
    tangential: cython.double,
    radial_change: cython.double,
    tangential_change: cython.double,
    order: cython.Py_ssize_t,
    terms: cython.double[::1],
    poly: cython.double[::1],
) -> cython.void:
    """One piece of one mode (V, Z): P V' = [P (i n Omega - d) - 2 i Omega T] V - [i Omega' T + n D] Z + force.

    P = A + n C, T = C + n A and D = B C - A^2; the force is force n (C f_r + i A f_t).
    """
    n: cython.double = table[at]
    d: cython.double = table[at + 1]
    j: cython.Py_ssize_t
    k: cython.Py_ssize_t
    r: cython.double
    i: cython.double
    a: cython.double
    b: cython.double
    s_0: cython.double = speed * speed
    s_1: cython.double = 2.0 * speed * slope
    s_2: cython.double = slope * slope
    A: cython.double = table[at + 5]
    C: cython.double = table[at + 7]
    # poly: A (3), C (3), P (3), T (3), D (5), then the factors of V (4, 4) and of Z (5, 3), real and imaginary
    poly[0], poly[1], poly[2] = table[at + 4] + s_0 * A, s_1 * A, s_2 * A
    poly[3], poly[4], poly[5] = table[at + 6] + s_0 * C, s_1 * C, s_2 * C
    for j in range(3):
        poly[6 + j] = poly[j] + n * poly[3 + j]
        poly[9 + j] = table[at + 11] * (poly[3 + j] + n * poly[j])
    a, b = table[at + 9], table[at + 10]
    poly[12] = table[at + 8] + s_0 * (a + s_0 * b)
    poly[13] = s_1 * (a + 2.0 * s_0 * b)
    poly[14] = s_2 * a + (s_1 * s_1 + 2.0 * s_0 * s_2) * b
    poly[15] = 2.0 * s_1 * s_2 * b
    poly[16] = s_2 * s_2 * b
    for j in range(4):
        a = n * poly[6 + j] - 2.0 * poly[9 + j] if j < 3 else 0.0
        b = n * poly[5 + j] - 2.0 * poly[8 + j] if j > 0 else 0.0
        poly[17 + j] = -d * poly[6 + j] if j < 3 else 0.0
        poly[21 + j] = speed * a + slope * b
    for j in range(5):
        poly[25 + j] = -n * poly[12 + j]
        poly[30 + j] = -(slope / length) * poly[9 + j] if j < 3 else 0.0
    for j in range(4):
        terms[j] = state[first + j]
    for k in range(order):
        r = i = 0.0
        for j in range(4):
            if j <= k:
                a, b = terms[4 * (k - j)], terms[4 * (k - j) + 1]
                r += poly[17 + j] * a - poly[21 + j] * b
                i += poly[17 + j] * b + poly[21 + j] * a
        for j in range(5):
            if j <= k:
                a, b = terms[4 * (k - j) + 2], terms[4 * (k - j) + 3]
                r += poly[25 + j] * a - poly[30 + j] * b
                i += poly[25 + j] * b + poly[30 + j] * a
        if k < 4:
            a = b = 0.0  # C f_r and A f_t
            if k < 3:
                a, b = poly[3 + k] * radial, poly[k] * tangential
            if k > 0:
                a, b = a + poly[2 + k] * radial_change, b + poly[k - 1] * tangential_change
            r += n * (table[at + 2] * a - table[at + 3] * b)
            i += n * (table[at + 3] * a + table[at + 2] * b)
        r, i = length * r, length * i
        if k > 0:
            r -= poly[7] * k * terms[4 * k]
            i -= poly[7] * k * terms[4 * k + 1]
        if k > 1:
            r -= poly[8] * (k - 1) * terms[4 * k - 4]
            i -= poly[8] * (k - 1) * terms[4 * k - 3]
        a = 1.0 / (poly[6] * (k + 1))
        terms[4 * k + 4], terms[4 * k + 5] = r * a, i * a
        a, b = speed * terms[4 * k + 2], speed * terms[4 * k + 3]
        if k > 0:
            a, b = a + slope * terms[4 * k - 2], b + slope * terms[4 * k - 1]
        terms[4 * k + 6] = length / (k + 1) * (terms[4 * k] - n * b)
        terms[4 * k + 7] = length / (k + 1) * (terms[4 * k + 1] + n * a)
    _sum(4, order, terms, state, first)


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _complete(
    table: cython.double[::1],
    at: cython.Py_ssize_t,
    state: cython.double[::1],
    first: cython.Py_ssize_t,
    length: cython.double,
    speed: cython.double,
    slope: cython.double,
    radial: cython.double,
    tangential: cython.double,
    radial_change: cython.double,
    tangential_change: cython.double,
    order: cython.Py_ssize_t,
    terms: cython.double[::1],
    poly: cython.double[::1],
    radius: cython.double,
) -> cython.void:
    """One piece of one mode (V_1, V_2, Z_1, Z_2), of which n = 0 also takes the spin's own Euler term."""
    n: cython.double = table[at]
    d: cython.double = table[at + 1]
    j: cython.Py_ssize_t
    k: cython.Py_ssize_t
    m: cython.Py_ssize_t
    row: cython.Py_ssize_t
    part: cython.double
    euler: cython.double = slope / length
    v: cython.double[::1] = poly
    f: cython.double
    t: cython.double
    # poly: A (3), B (3), C (3) in powers of tau; then i n Omega and 2 Omega times V, and the sums
    v[0], v[1], v[2] = speed * speed, 2.0 * speed * slope, slope * slope
    for j in range(3):
        v[3 + j] = v[j] * table[at + 5]
        v[6 + j] = v[j] * table[at + 13]
        v[9 + j] = v[j] * table[at + 7]
    v[3] += table[at + 4]
    v[6] += table[at + 12]
    v[9] += table[at + 6]
    for j in range(8):
        terms[j] = state[first + j]
    for k in range(order):
        row = 8 * k
        part = length / (k + 1)
        # Omega times each element, in v[12..19]
        for j in range(8):
            v[12 + j] = speed * terms[row + j]
            if k > 0:
                v[12 + j] += slope * terms[row - 8 + j]
        # V_1 and V_2, real and imaginary
        v[20] = -d * terms[row] - n * v[13] + 2.0 * v[14] + euler * terms[row + 6]
        v[21] = -d * terms[row + 1] + n * v[12] + 2.0 * v[15] + euler * terms[row + 7]
        v[22] = -d * terms[row + 2] - n * v[15] - 2.0 * v[12] - euler * terms[row + 4]
        v[23] = -d * terms[row + 3] + n * v[14] - 2.0 * v[13] - euler * terms[row + 5]
        for j in range(3):
            if j <= k:
                m = row - 8 * j
                v[20] -= v[6 + j] * terms[m + 4] + v[3 + j] * terms[m + 7]
                v[21] -= v[6 + j] * terms[m + 5] - v[3 + j] * terms[m + 6]
                v[22] -= v[9 + j] * terms[m + 6] - v[3 + j] * terms[m + 5]
                v[23] -= v[9 + j] * terms[m + 7] + v[3 + j] * terms[m + 4]
        if k < 2:
            f = radial if k == 0 else radial_change
            t = tangential if k == 0 else tangential_change
            v[20] += table[at + 2] * f
            v[21] += table[at + 3] * f
            v[22] += table[at + 2] * t
            v[23] += table[at + 3] * t
            if k == 0 and n == 0.0:
                v[22] -= euler * radius
        for j in range(4):
            terms[row + 8 + j] = part * v[20 + j]
        terms[row + 12] = part * (terms[row] - n * v[17])
        terms[row + 13] = part * (terms[row + 1] + n * v[16])
        terms[row + 14] = part * (terms[row + 2] - n * v[19])
        terms[row + 15] = part * (terms[row + 3] + n * v[18])
    _sum(8, order, terms, state, first)


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _norm(
    table: cython.double[::1], at: cython.Py_ssize_t, speed: cython.double, is_complete: cython.bint
) -> cython.double:
    """Of one mode's equations at speeds up to this one, velocities beside displacements times their frequency [1/s]."""
    square: cython.double = speed * speed
    A: cython.double = table[at + 4] + square * table[at + 5]
    C: cython.double = table[at + 6] + square * table[at + 7]
    n: cython.double = table[at]
    D: cython.double
    if is_complete:
        D = table[at + 12] + square * table[at + 13]
        return sqrt((D if D > C else C) + abs(A)) + 2.0 * (n + 1.0) * speed + table[at + 1]
    D = table[at + 8] + square * (table[at + 9] + square * table[at + 10])
    return sqrt(abs(n * D / (A + n * C))) + (2.0 * n + 4.0) * speed + table[at + 1]


def _run(
    count: cython.Py_ssize_t,
    is_complete: cython.bint,
    table: cython.double[::1],
    state: cython.double[::1],
    length: cython.double,
    speed: cython.double,
    change: cython.double,
    force: cython.double[::1],
    terms: cython.double[::1],
    poly: cython.double[::1],
    radius: cython.double,
) -> bool:
    m: cython.Py_ssize_t
    piece: cython.Py_ssize_t
    order: cython.Py_ssize_t
    at: cython.Py_ssize_t
    share: cython.double
    pieces: cython.double
    norm: cython.double
    fits: cython.bint = True
    with cython.nogil:
        for m in range(count):
            at = m * _COLUMNS
            # the speed's own change counts as a speed: what is linear in it brings the term before
            norm = _norm(table, at, abs(speed) + 2.0 * abs(change), is_complete) * length + abs(change) / (
                abs(speed) + abs(change) + 1.0
            )
            pieces = ceil(norm / _LONGEST) if norm < 1e18 else 1e18
            pieces = pieces if pieces > 1.0 else 1.0
            if not pieces <= _MOST_PIECES:
                fits = False
                continue
            order = _order(norm / pieces)
            for piece in range(cython.cast(cython.Py_ssize_t, pieces)):
                share = piece / pieces
                if is_complete:
                    _complete(
                        table, at, state, 8 * m, length / pieces, speed + change * share, change / pieces,
                        force[0] + force[2] * share, force[1] + force[3] * share, force[2] / pieces, force[3] / pieces,
                        order, terms, poly, radius,
                    )  # fmt: skip
                else:
                    _inextensional(
                        table, at, state, 4 * m, length / pieces, speed + change * share, change / pieces,
                        force[0] + force[2] * share, force[1] + force[3] * share, force[2] / pieces, force[3] / pieces,
                        order, terms, poly,
                    )  # fmt: skip
    return bool(fits)


def mode_steps(
    table: FloatArray,
    state: ComplexArray,
    length: float,
    speed: float,
    change: float,
    force: FloatArray,
    force_change: FloatArray,
    radius: float,
) -> ComplexArray:
    """The states of all modes after a step over which speed and force are linear.

    Parameters
    ----------
    table : ndarray, shape (N, eigensystem.COLUMNS)
    state : ndarray of complex, shape (N, 2) or (N, 4)
        (V, Z) of inextensional modes, (V_1, V_2, Z_1, Z_2) of complete ones.
    length : float
        [s]
    speed, change : float
        At the beginning, and over the step [rad/s].
    force, force_change : ndarray, shape (2,)
        f_r (outward), f_t (along increasing psi) at the beginning, and over the step [N].
    radius : float
        a [m].

    Returns
    -------
    ndarray of complex, shape as ``state``
        NaN where a mode would take more than a million pieces: no tire has such frequencies.
    """
    N, K = state.shape
    flat = np.ascontiguousarray(state).view(np.float64).reshape(-1).copy()
    forces = np.concatenate([np.asarray(force, dtype=np.float64), np.asarray(force_change, dtype=np.float64)])
    rows = np.ascontiguousarray(table).reshape(-1)
    terms, poly = np.empty((_MOST_TERMS + 2) * 2 * K), np.zeros(40)
    fits = _run(
        N, K == 4, rows.data, flat.data, length, speed, change, forces.data, terms.data, poly.data, radius
    )
    after: ComplexArray = flat.view(np.complex128).reshape(N, K)
    return after if fits else np.full_like(after, np.nan)
