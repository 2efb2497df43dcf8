"""The functions of kernels.py as compiled loops, for where Numba is installed: the same sums, so the same bits.

Numba neither reorders nor fuses sums and products unless it is told to.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from .coefficients import formula, twist
from .elementary import COSINE, DOUBLING, EXPONENTIAL, LARGEST, PER_DOUBLING, PER_QUARTER, QUARTER, ROUND, SINE
from .kernels import LONGEST, MOST_PIECES, MOST_TOGETHER, NEGLIGIBLE

__all__ = [
    "advance_first",
    "advance_turning",
    "axle_pull",
    "deflections",
    "follow",
    "read",
    "series",
    "take_up",
    "whirl_changes",
    "whirls",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FULL_TURN = 2.0 * math.pi
P1, P2, P3 = QUARTER
L1, L2 = DOUBLING
S6, S5, S4, S3, S2, S1 = SINE
C6, C5, C4, C3, C2, C1, C0 = COSINE
E13, E12, E11, E10, E9, E8, E7, E6, E5, E4, E3, E2, E1 = EXPONENTIAL


def _compile(function: Callable[..., Any]) -> Any:
    try:
        return numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:  # nowhere to keep the machine code: it is made anew in each process
        return numba.njit(nogil=True, error_model="numpy")(function)


@_compile
def series(table: FloatArray, speed: FloatArray, result: FloatArray) -> None:
    J, K, R = table.shape
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


@_compile
def _euler(state: FloatArray, w: int, jump: float) -> None:
    if jump != 0.0:
        X = state.shape[1] // 2
        stretch = jump * (state[w, X] + state[w, X + 3])
        shear = jump * (state[w, X + 1] - state[w, X + 2])
        state[w, 0] -= shear
        state[w, 1] += stretch
        state[w, 2] -= stretch
        state[w, 3] -= shear


@_compile
def advance_first(
    state: FloatArray,
    phase: FloatArray,
    coefficients: FloatArray,
    unit_step: float,
    top_speed: float,
    steps: FloatArray,
    which: IntArray,
    jump: FloatArray,
    angle: FloatArray,
    begin: IntArray,
    stop: IntArray,
) -> FloatArray:
    T, W = stop.shape
    n, J = state.shape[1], coefficients.shape[1]
    m = steps.shape[1] - 2
    R = (n + m) * n
    flat = coefficients.reshape(coefficients.shape[0], J, R)
    states = np.empty((T, W, n))
    transition, squared, z = np.empty(R), np.empty(R), np.empty(n)
    for w in range(W):
        i = begin[w]
        for t in range(T):
            while i < stop[t, w]:
                _euler(state, w, jump[i])
                seconds = steps[i, 0] * 1e-9
                if not np.isnan(angle[i]):
                    phase[w] = angle[i]
                phase[w] = np.fmod(phase[w] + steps[i, 1] * seconds, _FULL_TURN)
                limit = unit_step * (top_speed / max(abs(steps[i, 1]), top_speed))
                mantissa, exponent = math.frexp(seconds / limit)
                doublings = max(0, exponent - 1 if mantissa == 0.5 else exponent)
                length = seconds / math.ldexp(unit_step, doublings)
                transition[:] = flat[which[i], 0]
                power = 1.0
                for j in range(1, J):
                    power = power * length
                    row = flat[which[i], j]
                    for r in range(R):
                        transition[r] += row[r] * power
                for _ in range(doublings):
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
                        z[b] += transition[(n + a) * n + b] * steps[i, 2 + a]
                for b in range(n):
                    state[w, b] = z[b] + 0.0
                i += 1
            states[t, w] = state[w]
    return states


@_compile
def advance_turning(
    state: FloatArray,
    phase: FloatArray,
    system: FloatArray,
    spin: FloatArray,
    input: FloatArray,
    seen: FloatArray,
    spring: FloatArray,
    imbalance: FloatArray,
    runout: FloatArray,
    sizes: FloatArray,
    highest: int,
    steps: FloatArray,
    change: FloatArray,
    jump: FloatArray,
    angle: FloatArray,
    begin: IntArray,
    stop: IntArray,
) -> tuple[FloatArray, FloatArray]:
    T, W = stop.shape
    n, J = state.shape[1], max(len(runout), 2)
    wide = len(system)
    states, phases = np.empty((T, W, n)), np.empty((T, W))
    A, force, x, after = np.empty((wide, wide)), np.empty(wide), np.empty(wide), np.empty(wide)
    work, zero, power = np.empty((5, J)), np.zeros(J), np.empty(J)
    turned, R, terms = np.empty((2, len(spring), 1)), np.empty((len(spring), 2, 1)), np.empty((2, n))
    known = np.nan
    for w in range(W):
        i = begin[w]
        for t in range(T):
            while i < stop[t, w]:
                if not np.isnan(angle[i]):
                    phase[w] = angle[i]
                _euler(state, w, jump[i])
                seconds, speed = steps[i, 0], steps[i, 1]
                norm = sizes[0] + abs(speed) * (sizes[1] + highest) + sizes[2]
                pieces = max(np.ceil(norm * seconds / LONGEST), 1.0)
                if not pieces <= MOST_PIECES:
                    state[w] = np.nan
                    pieces = 0.0
                reach = norm * seconds / max(pieces, 1.0) if pieces > 0.0 else 0.0
                order, term = 1, reach
                while term > NEGLIGIBLE or order < reach:
                    order += 1
                    term = term * reach / order
                if order > R.shape[2]:
                    turned, R = np.empty((2, len(spring), order)), np.empty((len(spring), 2, order))
                    terms = np.empty((order + 1, n))
                if speed != known:
                    known = speed
                    for a in range(wide):
                        for b in range(wide):
                            A[b, a] = system[a, b] + speed * spin[a, b]
                length = seconds / max(pieces, 1.0)
                for piece in range(int(pieces)):
                    start = phase[w] + speed * length * piece
                    for j in range(J):
                        work[4, j] = (j + 1) * start
                        power[j] = 1.0
                    _grow(zero, work[4], 1.0, work[0], work[1], work[2], work[3])
                    share = piece / pieces
                    for p in range(len(spring)):
                        for side in range(2):
                            total = seen[2 * p + side, 0] * state[w, 0]
                            for b in range(1, n):
                                total += seen[2 * p + side, b] * state[w, b]
                            R[p, side, 0] = total
                    for b in range(n):
                        x[b] = terms[0, b] = state[w, b]
                    x[n:] = 0.0
                    for k in range(order):
                        load, traction, c_1, s_1, c_2, s_2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                        first = steps[i, 2] + change[i, 0] * share
                        if k == 0:
                            load, traction = first, steps[i, 3] + change[i, 1] * share
                        elif k == 1:
                            load, traction = change[i, 0] / pieces, change[i, 1] / pieces
                        for j in range(J):
                            if k > 0:
                                power[j] = power[j] * ((j + 1) * speed * length / k)
                            c, s = work[0, j], work[1, j]
                            if k % 4 == 1:
                                c, s = -s, c
                            elif k % 4 == 2:
                                c, s = -c, -s
                            elif k % 4 == 3:
                                c, s = s, -c
                            c, s = power[j] * c, power[j] * s
                            if j == 0:
                                c_1, s_1 = c, s
                            elif j == 1:
                                c_2, s_2 = c, s
                            if first > 0.0 and j < len(runout):
                                load = load + (runout[j, 0] * c + runout[j, 1] * s)
                        c_1, s_1 = speed * speed * c_1, speed * speed * s_1
                        for b in range(wide):
                            force[b] = load * input[b, 0] + traction * input[b, 1]
                            force[b] += c_1 * imbalance[b, 0] + s_1 * imbalance[b, 1]
                        for p in range(len(spring)):
                            turned[0, p, k] = spring[p, 0] * c_2 - spring[p, 1] * s_2
                            turned[1, p, k] = spring[p, 0] * s_2 + spring[p, 1] * c_2
                            xx, xy = turned[0, p, 0] * R[p, 0, k], turned[1, p, 0] * R[p, 1, k]
                            yx, yy = turned[1, p, 0] * R[p, 0, k], turned[0, p, 0] * R[p, 1, k]
                            for q in range(1, k + 1):
                                xx += turned[0, p, q] * R[p, 0, k - q]
                                xy += turned[1, p, q] * R[p, 1, k - q]
                                yx += turned[1, p, q] * R[p, 0, k - q]
                                yy += turned[0, p, q] * R[p, 1, k - q]
                            x[n + 2 * p], x[n + 2 * p + 1] = xx + xy, yx - yy
                        for b in range(wide):
                            after[b] = A[0, b] * x[0]
                        for a in range(1, wide):
                            for b in range(wide):
                                after[b] += A[a, b] * x[a]
                        part = length / (k + 1)
                        for b in range(wide):
                            after[b] = (after[b] + force[b]) * part
                        for b in range(n):
                            x[b] = terms[k + 1, b] = after[b]
                        if k + 1 < order:
                            for p in range(len(spring)):
                                R[p, 0, k + 1], R[p, 1, k + 1] = after[n + 2 * p], after[n + 2 * p + 1]
                    for b in range(n):
                        total = terms[order, b]
                        for k in range(order - 1, -1, -1):
                            total += terms[k, b]
                        state[w, b] = total + 0.0
                phase[w] = np.fmod(phase[w] + speed * seconds, _FULL_TURN)
                i += 1
            states[t, w], phases[t, w] = state[w], phase[w]
    return states, phases


@_compile
def read(state: FloatArray, output: FloatArray) -> tuple[FloatArray, FloatArray]:
    W, n = state.shape
    force, largest = np.empty((W, 2)), np.empty(W)
    for w in range(W):
        largest[w] = abs(state[w, 0])
        for c in range(2):
            force[w, c] = output[w, 0, c] * state[w, 0]
        for k in range(1, n):
            size = abs(state[w, k])
            if not size <= largest[w]:  # a NaN stays
                largest[w] = size
            for c in range(2):
                force[w, c] += output[w, k, c] * state[w, k]
    return force, largest


_formula, _twist = _compile(formula), _compile(twist)


@_compile
def axle_pull(
    state: FloatArray, phase: FloatArray, seen: FloatArray, spring: FloatArray, wheel_x: FloatArray
) -> FloatArray:
    M, n = state.shape
    cosine, sine, work, result = np.empty(M), np.empty(M), np.empty((2, M)), np.empty(M)
    _grow(np.zeros(M), 2.0 * phase, 1.0, cosine, sine, work[0], work[1])
    for m in range(M):
        total = 0.0
        for p in range(len(spring)):
            X, Y = seen[2 * p, 0] * state[m, 0], seen[2 * p + 1, 0] * state[m, 0]
            for b in range(1, n):
                X += seen[2 * p, b] * state[m, b]
                Y += seen[2 * p + 1, b] * state[m, b]
            real = spring[p, 0] * cosine[m] - spring[p, 1] * sine[m]
            imaginary = spring[p, 0] * sine[m] + spring[p, 1] * cosine[m]
            total = total - wheel_x[2 * p] * (real * X + imaginary * Y)
            total = total - wheel_x[2 * p + 1] * (imaginary * X - real * Y)
        result[m] = total
    return result


@_compile
def whirls(
    constants: tuple[float, float, float, float, float],
    numbers: FloatArray,
    damping: FloatArray,
    force: FloatArray,
    speeds: FloatArray,
    exponents: FloatArray,
    steady: FloatArray,
    right: FloatArray,
    left: FloatArray,
) -> None:
    S, N = speeds.size, numbers.size
    for s in range(S):
        for n in range(N):
            A, _, C, determinant = _formula(constants, numbers[n], speeds[s])
            through = A + numbers[n] * C
            turning = numbers[n] * speeds[s]
            radial, tangential = numbers[n] * C / through, numbers[n] * A / through
            d, g = damping[n], speeds[s] * _twist(numbers[n], A, C)
            p, q = 0.25 * d * d - g * g - numbers[n] * determinant / through, d * g
            larger = np.sqrt(0.5 * (np.sqrt(p * p + q * q) + abs(p)))
            smaller = 0.5 * q / larger
            x, y = (larger, smaller) if p >= 0.0 else (smaller, larger)
            half = 0.5 * d
            u, v = x + x, y + y
            square = u * u + v * v
            u, v = u / square, -v / square
            along = radial * force[0, n], radial * force[1, n]
            across = -(tangential * force[1, n]), tangential * force[0, n]
            for k in range(2):
                real, imaginary = (x - half, y - g) if k == 0 else (-x - half, -y - g)
                right[0, s, n, 0, k], right[1, s, n, 0, k] = real, imaginary
                right[0, s, n, 1, k], right[1, s, n, 1, k] = 1.0, 0.0
                turned = imaginary + turning
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


@_compile
def whirl_changes(
    constants: tuple[float, float, float, float, float],
    numbers: FloatArray,
    right: FloatArray,
    left: FloatArray,
    before: IntArray,
    after: IntArray,
    speeds: FloatArray,
) -> FloatArray:
    N = numbers.size
    result = np.empty((2, before.size, N, 2, 2))
    for c in range(before.size):
        b, a = before[c], after[c]
        first, second = speeds[b], speeds[a]
        middle = np.sqrt((first * first + first * second + second * second) / 3.0)
        for n in range(N):
            A, _, C, _ = _formula(constants, numbers[n], middle)
            jump = (second - first) * _twist(numbers[n], A, C)
            for j in range(2):
                real, imaginary = right[0, b, n, 0, j], right[1, b, n, 0, j] - jump
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
def follow(
    own: FloatArray,
    exponents: FloatArray,
    steady: FloatArray,
    changes: FloatArray,
    offsets: FloatArray,
    length: IntArray,
    force: FloatArray,
    changed: IntArray,
    ends: IntArray,
    steps_of: IntArray,
    ends_of: IntArray,
    outputs: FloatArray,
) -> tuple[IntArray, IntArray]:
    _, W, N, K = own.shape
    size = N * K
    mu = exponents.reshape(2, exponents.shape[1], size)
    shape = steady.reshape(2, steady.shape[1], size, 2)
    w, work = np.empty((2, size)), np.empty((8, size))
    taken, spin = np.empty(W, np.int64), np.empty(ends.size, np.int64)
    turn = 0
    for wheel in range(W):
        w[0] = own[0, wheel].copy().reshape(size)
        w[1] = own[1, wheel].copy().reshape(size)
        at, first, intervals = wheel, steps_of[wheel], 0
        end = ends_of[wheel]
        for step in range(steps_of[wheel], steps_of[wheel + 1] + 1):
            while end < ends_of[wheel + 1] and ends[end] == step:
                _advance_group(w, mu, shape, at, length, force, first, step, work)
                first, intervals = step, 0
                outputs[0, end] = w[0].copy().reshape(N, K)
                outputs[1, end] = w[1].copy().reshape(N, K)
                spin[end] = at
                end += 1
            if step == steps_of[wheel + 1]:
                break
            if turn < changed.size and changed[turn] == step:
                _advance_group(w, mu, shape, at, length, force, first, step, work)
                first, intervals = step, 0
                _turn(w, changes, offsets, turn, work)
                at = W + turn
                turn += 1
            if step == first or force[step, 0] != force[step - 1, 0] or force[step, 1] != force[step - 1, 1]:
                if intervals == MOST_TOGETHER:
                    _advance_group(w, mu, shape, at, length, force, first, step, work)
                    first, intervals = step, 0
                intervals += 1
        taken[wheel] = first
        own[0, wheel] = w[0].copy().reshape(N, K)
        own[1, wheel] = w[1].copy().reshape(N, K)
    return taken, spin


@_compile
def take_up(
    own: FloatArray,
    exponents: FloatArray,
    steady: FloatArray,
    right: FloatArray,
    left: FloatArray,
    wheel: int,
    speed: float,
    constants: tuple[float, float, float, float, float],
    numbers: FloatArray,
    damping: FloatArray,
    force: FloatArray,
    steps: FloatArray,
    first: FloatArray,
    rows: FloatArray,
) -> float:
    """What BeltMotion does with the steps of one wheel that wait, in one go; the speed after them.

    ``own`` and the four fields of the spins of all wheels are changed in place for this one; ``steps`` are length,
    speed, load and traction, (I, 4); ``rows`` (2, 2 + 2 N) is filled with what :func:`deflections` takes of this wheel.
    """
    count, N, C = len(steps), numbers.size, 0
    changed, speeds = np.empty(count, np.int64), np.empty(count + 1)
    speeds[0] = speed
    length, held = np.empty(count, np.int64), np.empty((count, 2))
    for i in range(count):
        if steps[i, 1] != speeds[C]:
            changed[C] = i
            C += 1
            speeds[C] = steps[i, 1]
        length[i] = int(steps[i, 0])
        held[i, 0], held[i, 1] = -steps[i, 2], -steps[i, 3]
    speeds = speeds[: C + 1].copy()
    exponent, shape = np.empty((2, C + 1, N, 2)), np.empty((2, C + 1, N, 2, 2))
    columns, inverse = np.empty((2, C + 1, N, 2, 2)), np.empty((2, C + 1, N, 2, 2))
    whirls(constants, numbers, damping, force, speeds, exponent, shape, columns, inverse)
    exponent[:, 0], shape[:, 0] = exponents[:, wheel], steady[:, wheel]
    columns[:, 0], inverse[:, 0] = right[:, wheel], left[:, wheel]
    after = np.arange(1, C + 1)
    matrices = whirl_changes(constants, numbers, columns, inverse, after - 1, after, speeds)
    mine, output = np.empty((2, 1, N, 2)), np.empty((2, 1, N, 2))
    mine[:, 0] = own[:, wheel]
    ends, none = np.array([count]), np.zeros((2, C, N, 2))
    bounds, two = np.array([0, count]), np.array([0, 1])
    follow(mine, exponent, shape, matrices, none, length, held, changed[:C].copy(), ends, bounds, two, output)
    own[:, wheel] = mine[:, 0]
    exponents[:, wheel], steady[:, wheel] = exponent[:, C], shape[:, C]
    right[:, wheel], left[:, wheel] = columns[:, C], inverse[:, C]
    rows[0, 0], rows[0, 1], rows[1, 0], rows[1, 1] = first[0], first[1], first[2], first[3]
    for n in range(N):
        x, y = 0.0, 0.0
        for k in range(2):
            a, b = columns[0, C, n, 1, k], columns[1, C, n, 1, k]
            p, q = output[0, 0, n, k], output[1, 0, n, k]
            if k == 0:
                x, y = a * p - b * q, a * q + b * p
            else:
                x += a * p - b * q
                y += a * q + b * p
        rows[0, 2 + n], rows[0, 2 + N + n] = x, y
        rows[1, 2 + n], rows[1, 2 + N + n] = y / numbers[n], -x / numbers[n]
    return float(speeds[C])


@_compile
def _advance_group(
    w: FloatArray,
    mu: FloatArray,
    shape: FloatArray,
    at: int,
    length: IntArray,
    force: FloatArray,
    first: int,
    stop: int,
    work: FloatArray,
) -> None:
    """Take the steps from the first to before the last; ``work`` is (8, size) to work in."""
    if first == stop:
        return
    size = w.shape[1]
    real, imaginary, driven, push, before = work[0], work[1], work[2:4], work[4:6], work[6:8]
    left = 0
    for i in range(first, stop):
        left += length[i]
    driven[:] = 0.0
    for i in range(first, stop):
        if i == first or force[i, 0] != force[i - 1, 0] or force[i, 1] != force[i - 1, 1]:
            _grow(mu[0, at], mu[1, at], left * 1e-9, real, imaginary, push[0], push[1])
            f, t = force[i, 0], force[i, 1]
            for e in range(size):
                push[0, e] = shape[0, at, e, 0] * f + shape[0, at, e, 1] * t
                push[1, e] = shape[1, at, e, 0] * f + shape[1, at, e, 1] * t
            if i == first:
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
        left -= length[i]
    for e in range(size):
        w[0, e] = w[0, e] + driven[0, e] + before[0, e]
        w[1, e] = w[1, e] + driven[1, e] + before[1, e]


@_compile
def _turn(w: FloatArray, changes: FloatArray, offsets: FloatArray, c: int, work: FloatArray) -> None:
    """The jump of the coordinates with the speed."""
    _, _, N, K, _ = changes.shape
    before = work[:2]
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
