"""The functions of kernels.py as compiled loops, for where Numba is installed: the same sums, so the same bits.

Numba neither reorders nor fuses sums and products unless it is told to.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from .elementary import COSINE, DOUBLING, EXPONENTIAL, LARGEST, PER_DOUBLING, PER_QUARTER, QUARTER, ROUND, SINE

__all__ = ["advance_first", "advance_modes", "deflections", "series", "whirl_changes", "whirls"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

P1, P2, P3 = QUARTER
L1, L2 = DOUBLING
S6, S5, S4, S3, S2, S1 = SINE
C6, C5, C4, C3, C2, C1, C0 = COSINE
E13, E12, E11, E10, E9, E8, E7, E6, E5, E4, E3, E2, E1 = EXPONENTIAL


def _compile(function: Callable[..., Any]) -> Any:
    try:
        return numba.njit(cache=True, nogil=True)(function)
    except RuntimeError:  # nowhere to keep the machine code: it is made anew in each process
        return numba.njit(nogil=True)(function)


@_compile
def series(table: FloatArray, speed: FloatArray) -> FloatArray:
    J, K, R = table.shape
    result = np.empty((speed.size, J, R))
    for s in range(speed.size):
        for j in range(J):
            total = result[s, j]
            total[:] = table[j, 0]
            power = 1.0
            for k in range(1, K):
                power = power * speed[s]
                row = table[j, k]
                for r in range(R):
                    total[r] += power * row[r]
    return result


@_compile
def advance_first(
    state: FloatArray,
    coefficients: FloatArray,
    which: IntArray,
    length: FloatArray,
    doublings: IntArray,
    force: FloatArray,
    jump: FloatArray,
    begin: IntArray,
    stop: IntArray,
) -> FloatArray:
    T, W = stop.shape
    n, J = state.shape[1], coefficients.shape[1]
    m = force.shape[1]
    R = (n + m) * n
    flat = coefficients.reshape(coefficients.shape[0], J, R)
    states = np.empty((T, W, n))
    transition, squared, z = np.empty(R), np.empty(R), np.empty(n)
    for w in range(W):
        i = begin[w]
        for t in range(T):
            while i < stop[t, w]:
                if jump[i] != 0.0:
                    stretch = jump[i] * (state[w, 5] + state[w, 8])
                    shear = jump[i] * (state[w, 6] - state[w, 7])
                    state[w, 0] -= shear
                    state[w, 1] += stretch
                    state[w, 2] -= stretch
                    state[w, 3] -= shear
                transition[:] = flat[which[i], 0]
                power = 1.0
                for j in range(1, J):
                    power = power * length[i]
                    row = flat[which[i], j]
                    for r in range(R):
                        transition[r] += row[r] * power
                for _ in range(doublings[i]):
                    for a in range(n + m):
                        for b in range(n):
                            total = transition[a * n] * transition[b]
                            for c in range(1, n):
                                total += transition[a * n + c] * transition[c * n + b]
                            squared[a * n + b] = total
                    for r in range(n * n, R):
                        squared[r] += transition[r]
                    transition[:] = squared
                for b in range(n):
                    z[b] = transition[b] * state[w, 0]
                for a in range(1, n):
                    for b in range(n):
                        z[b] += transition[a * n + b] * state[w, a]
                for a in range(m):
                    for b in range(n):
                        z[b] += transition[(n + a) * n + b] * force[i, a]
                for b in range(n):
                    state[w, b] = z[b] + 0.0
                i += 1
            states[t, w] = state[w]
    return states


@_compile
def whirls(
    turning: FloatArray,
    twist: FloatArray,
    stiffness: FloatArray,
    damping: FloatArray,
    radial: FloatArray,
    tangential: FloatArray,
    force: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    S, N = turning.shape
    exponents, right, left = np.empty((2, S, N, 2)), np.empty((2, S, N, 2, 2)), np.empty((2, S, N, 2, 2))
    steady = np.empty((2, S, N, 2, 2))
    for s in range(S):
        for n in range(N):
            d, g = damping[n], twist[s, n]
            p, q = 0.25 * d * d - g * g - stiffness[s, n], d * g
            larger = np.sqrt(0.5 * (np.sqrt(p * p + q * q) + abs(p)))
            smaller = 0.5 * q / larger
            x, y = (larger, smaller) if p >= 0.0 else (smaller, larger)
            half = 0.5 * d
            u, v = x + x, y + y
            square = u * u + v * v
            u, v = u / square, -v / square
            along = radial[s, n] * force[0, n], radial[s, n] * force[1, n]
            across = -(tangential[s, n] * force[1, n]), tangential[s, n] * force[0, n]
            for k in range(2):
                real, imaginary = (x - half, y - g) if k == 0 else (-x - half, -y - g)
                right[0, s, n, 0, k], right[1, s, n, 0, k] = real, imaginary
                right[0, s, n, 1, k], right[1, s, n, 1, k] = 1.0, 0.0
                turned = imaginary + turning[s, n]
                exponents[0, s, n, k], exponents[1, s, n, k] = real, turned
                # the other row of left
                a, b = (real, imaginary) if k == 0 else (-real, -imaginary)
                left[0, s, n, 1 - k, 1], left[1, s, n, 1 - k, 1] = u * a - v * b, u * b + v * a
                left[0, s, n, k, 0], left[1, s, n, k, 0] = (u, v) if k == 0 else (-u, -v)
                square = real * real + turned * turned
                c, e = real / square, -turned / square
                for f in range(2):
                    r, t = along if f == 0 else across
                    r, t = u * r - v * t, u * t + v * r
                    if k == 0:
                        r, t = -r, -t
                    steady[0, s, n, k, f], steady[1, s, n, k, f] = r * c - t * e, r * e + t * c
    return exponents, steady, right, left


@_compile
def whirl_changes(
    right: FloatArray, left: FloatArray, before: IntArray, after: IntArray, twist: FloatArray
) -> FloatArray:
    C, N = twist.shape
    result = np.empty((2, C, N, 2, 2))
    for c in range(C):
        b, a = before[c], after[c]
        for n in range(N):
            for j in range(2):
                real, imaginary = right[0, b, n, 0, j], right[1, b, n, 0, j] - twist[c, n]
                for i in range(2):
                    x, y = left[0, a, n, i, 0], left[1, a, n, i, 0]
                    result[0, c, n, i, j] = x * real - y * imaginary + left[0, a, n, i, 1]
                    result[1, c, n, i, j] = x * imaginary + y * real + left[1, a, n, i, 1]
    return result


@_compile
def _grow(
    rate: FloatArray,
    angle: FloatArray,
    time: float,
    real: FloatArray,
    imaginary: FloatArray,
    quarter: FloatArray,
    doubling: FloatArray,
) -> None:
    """exp((rate + i angle) time); elementary.growth, with two rows to work in."""
    for i in range(rate.size):
        y = angle[i] * time
        shifted = y * PER_QUARTER + ROUND
        quarter[i] = shifted
        shifted = shifted - ROUND
        rest = ((y - shifted * P1) - shifted * P2) - shifted * P3
        z = rest * rest
        sine = (((((S6 * z + S5) * z + S4) * z + S3) * z + S2) * z + S1) * z
        imaginary[i] = sine * rest + rest
        real[i] = ((((((C6 * z + C5) * z + C4) * z + C3) * z + C2) * z + C1) * z + C0) * z + 1.0
    turned = quarter.view(np.int64)
    for i in range(rate.size):
        limited = min(max(rate[i] * time, -LARGEST), LARGEST)
        shifted = limited * PER_DOUBLING + ROUND
        doubling[i] = shifted
        shifted = shifted - ROUND
        u = (limited - shifted * L1) - shifted * L2
        size = (((((E13 * u + E12) * u + E11) * u + E10) * u + E9) * u + E8) * u + E7
        quarter_size = (((((size * u + E6) * u + E5) * u + E4) * u + E3) * u + E2) * u + E1
        rate_size = quarter_size * u + 1.0
        sine, cosine = imaginary[i], real[i]
        if turned[i] & 1:
            sine, cosine = cosine, sine
        imaginary[i] = -sine if turned[i] & 2 else sine
        real[i] = -cosine if (turned[i] + 1) & 2 else cosine
        quarter[i] = rate_size
    doubled = doubling.view(np.int64)
    for i in range(rate.size):
        doubled[i] = (doubled[i] + 1023) << 52
    for i in range(rate.size):
        size = quarter[i] * doubling[i]
        real[i] = real[i] * size
        imaginary[i] = imaginary[i] * size


@_compile
def advance_modes(
    own: FloatArray,
    exponents: FloatArray,
    steady: FloatArray,
    changes: FloatArray,
    offsets: FloatArray,
    spin: IntArray,
    change: IntArray,
    output: IntArray,
    first: IntArray,
    begin: IntArray,
    left: FloatArray,
    force: FloatArray,
    outputs: FloatArray,
) -> None:
    _, W, N, K = own.shape
    size = N * K
    mu = exponents.reshape(2, exponents.shape[1], size)
    shape = steady.reshape(2, steady.shape[1], size, 2)
    real, imaginary, quarter, doubling = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    driven, push, before = np.empty((2, size)), np.empty((2, size)), np.empty((2, size))
    w = np.empty((2, size))
    for wheel in range(W):
        w[0] = own[0, wheel].copy().reshape(size)
        w[1] = own[1, wheel].copy().reshape(size)
        for g in range(begin[wheel], begin[wheel + 1]):
            at = spin[g]
            if first[g + 1] > first[g]:
                driven[:] = 0.0
                for i in range(first[g], first[g + 1]):
                    _grow(mu[0, at], mu[1, at], left[i], real, imaginary, quarter, doubling)
                    f, t = force[i, 0], force[i, 1]
                    for e in range(size):
                        push[0, e] = shape[0, at, e, 0] * f + shape[0, at, e, 1] * t
                        push[1, e] = shape[1, at, e, 0] * f + shape[1, at, e, 1] * t
                    if i == first[g]:
                        for e in range(size):
                            a, b = w[0, e] - push[0, e], w[1, e] - push[1, e]
                            w[0, e] = real[e] * a - imaginary[e] * b
                            w[1, e] = real[e] * b + imaginary[e] * a
                    else:
                        for e in range(size):
                            a, b = before[0, e] - push[0, e], before[1, e] - push[1, e]
                            driven[0, e] += real[e] * a - imaginary[e] * b
                            driven[1, e] += real[e] * b + imaginary[e] * a
                    before[:] = push
                for e in range(size):
                    w[0, e] = w[0, e] + driven[0, e] + before[0, e]
                    w[1, e] = w[1, e] + driven[1, e] + before[1, e]
            if output[g] >= 0:
                outputs[0, output[g]] = w[0].copy().reshape(N, K)
                outputs[1, output[g]] = w[1].copy().reshape(N, K)
            if change[g] >= 0:
                c = change[g]
                before[:] = w
                for e in range(N):
                    for a in range(K):
                        p, q = before[0, e * K], before[1, e * K]
                        r, s = changes[0, c, e, a, 0], changes[1, c, e, a, 0]
                        x, y = r * p - s * q, r * q + s * p
                        for b in range(1, K):
                            p, q = before[0, e * K + b], before[1, e * K + b]
                            r, s = changes[0, c, e, a, b], changes[1, c, e, a, b]
                            x += r * p - s * q
                            y += r * q + s * p
                        w[0, e * K + a] = x + offsets[0, c, e, a]
                        w[1, e * K + a] = y + offsets[1, c, e, a]
        own[0, wheel] = w[0].copy().reshape(N, K)
        own[1, wheel] = w[1].copy().reshape(N, K)


@_compile
def deflections(amplitudes: FloatArray, basis: FloatArray) -> FloatArray:
    M, _, B = amplitudes.shape
    P = basis.shape[1]
    result = np.empty((M, 2, P))
    for m in range(M):
        for c in range(2):
            total = result[m, c]
            for p in range(P):
                total[p] = amplitudes[m, c, 0] * basis[0, p]
            for b in range(1, B):
                size = amplitudes[m, c, b]
                for p in range(P):
                    total[p] += size * basis[b, p]
    return result
