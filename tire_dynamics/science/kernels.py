"""The loops that carry wheels through time, on NumPy; compiled.py has them once more, with the same bits.

Several wheels are stepped together, and what one wheel needs beside the others is in flat arrays, wheel after wheel.
Every sum is taken in one order, so that neither the number of wheels nor the length of the stretch changes a bit.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .coefficients import formula, twist
from .elementary import cos_sin, growth

__all__ = [
    "advance_first",
    "advance_turning",
    "axle_pull",
    "deflections",
    "follow",
    "read",
    "series",
    "whirl_changes",
    "whirls",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOST_TOGETHER = 256  # intervals in one group
LONGEST, NEGLIGIBLE = 3.0, 2.0**-57  # of a Taylor series: norm times step; what is left out beside 1
MOST_PIECES = 100_000  # of a step; a unit that needs more has nothing of a tire, and is given up
_SHOWN, _CHANGED, _CUT = range(3)  # why a group ends
_FULL_TURN = 2.0 * math.pi
_TOGETHER, _SPEEDS_TOGETHER = 64, 16  # what is summed at once, so that it stays in the cache


def series(table: FloatArray, speed: FloatArray, result: FloatArray) -> None:
    """Taylor coefficients of transitions at speeds, from those in step and speed.

    Parameters
    ----------
    table : ndarray, shape (J, K, R)
    speed : ndarray, shape (S,)
        In units of the table's top speed.
    result : ndarray, shape (S, J, R)
        Filled with them.
    """
    for first in range(0, speed.size, _SPEEDS_TOGETHER):
        block = slice(first, first + _SPEEDS_TOGETHER)
        power = np.ones_like(speed[block])
        total = result[block]
        total[:] = table[:, 0]
        for k in range(1, table.shape[1]):
            power = power * speed[block]
            total += power[:, None, None] * table[:, k]


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
    """The n = 1 motion and the wheel's over a stretch of time, under inputs that are held over each step.

    Parameters
    ----------
    state : ndarray, shape (W, n)
        Changed in place.
    phase : ndarray, shape (W,)
        Angle turned, modulo 2 pi [rad]; changed in place.
    coefficients : ndarray, shape (S, J, n + m, n)
        Taylor coefficients of transposed [Phi G_0] in the step's length, at S speeds (:func:`series`).
    unit_step, top_speed : float
        The longest step [s] that is summed directly; beyond the top speed [rad/s] it is shorter in proportion.
        Longer steps are doubled up.
    steps : ndarray, shape (I, 2 + m)
        Length [ns], speed [rad/s] and inputs of each step.
    which : ndarray of int, shape (I,)
        Coefficients of each step.
    jump : ndarray, shape (I,)
        Change of the speed before the step [rad/s] in the complete model, whose state has Euler terms; otherwise zero.
    angle : ndarray, shape (I,)
        The wheel's angle at the beginning of the step [rad] where it is told anew, else NaN.
    begin : ndarray of int, shape (W,)
        First step of each wheel.
    stop : ndarray of int, shape (T, W)
        The step behind the last that ends at or before each of T ticks.

    Returns
    -------
    ndarray, shape (T, W, n)
        The states at the ticks.
    """
    T, W = stop.shape
    n = state.shape[1]
    length, force = steps[:, 0] * 1e-9, steps[:, 2:]
    turned = list(zip((steps[:, 1] * length).tolist(), angle.tolist(), strict=True))
    for w, (first, end) in enumerate(zip(begin.tolist(), stop[-1].tolist(), strict=True)):
        for turn, told in turned[first:end]:
            phase[w] = math.fmod((phase[w] if math.isnan(told) else told) + turn, _FULL_TURN)
    mantissa, exponent = np.frexp(length / (unit_step * (top_speed / np.maximum(np.abs(steps[:, 1]), top_speed))))
    doublings = np.maximum(exponent - (mantissa == 0.5), 0).astype(np.int64)
    length = length / (unit_step * 2.0**doublings)
    before = np.concatenate([begin[None, :], stop[:-1]])
    rounds = (stop - before).max(axis=1, initial=0)
    states = np.empty((T, W, n))
    tick = np.repeat(np.arange(T), rounds)
    turn = np.arange(tick.size) - np.repeat(np.cumsum(rounds) - rounds, rounds)
    step = before[tick] + turn[:, None]  # (rounds, W)
    idle = step >= stop[tick]  # a wheel that waits for the others: a step of no length changes nothing
    any_idle, jumps = bool(idle.any()), bool(jump.any())
    if any_idle:
        step = np.where(idle, 0, step)
    lengths, doubled, forces = length[step], doublings[step], force[step]
    if any_idle:
        lengths, doubled = np.where(idle, 0.0, lengths), np.where(idle, 0, doubled)
    last_of_tick = np.append(tick[1:] != tick[:-1], True)
    together = max(1, _TOGETHER // W)
    at = 0
    if tick.size and tick[0]:
        states[: tick[0]] = state
    for first in range(0, tick.size, together):
        block = slice(first, first + together)
        transitions = _transitions(coefficients[which[step[block]]], lengths[block], doubled[block], n)
        for k, transition in enumerate(transitions, first):
            if jumps:
                _euler(state, np.where(idle[k], 0.0, jump[step[k]]))
            z = np.concatenate([state, forces[k]], axis=1)
            np.add.reduce(transition * z[:, :, None], axis=1, out=state)
            state += 0.0  # no negative zeros
            if last_of_tick[k]:
                at = tick[k]
                states[at : tick[k + 1] if k + 1 < tick.size else T] = state
    if not tick.size:
        states[:] = state
    return states


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
    """As :func:`advance_first`, of a tire that is not the same all around: of periodic equations.

    A step of length h is a Taylor series of the state itself, z = sum_k x_k, summed until what is left is below the
    rounding of a double: x_(k+1) = h/(k+1) [A x_k + what turns], where each harmonic exp(i j phi) has the coefficients
    exp(i j phi_0) (i j Omega h)^k/k!, and the springs' is multiplied with that of conj(R). Long steps are cut; a state
    that would take more than 100 000 pieces is NaN.

    Parameters
    ----------
    state : ndarray, shape (W, n)
        Changed in place.
    phase : ndarray, shape (W,)
        Angle turned, modulo 2 pi [rad]; changed in place.
    system, spin, input, seen, spring, imbalance, runout, sizes, highest
        Of :class:`.turning.Turning`.
    steps : ndarray, shape (I, 2 + m)
        Length [s], speed [rad/s] and inputs at the beginning of each step.
    change : ndarray, shape (I, m)
        Change of the inputs over it.
    jump, angle, begin, stop
        As of :func:`advance_first`.

    Returns
    -------
    states : ndarray, shape (T, W, n)
        At the ticks.
    phases : ndarray, shape (T, W)
    """
    T, W = stop.shape
    n = state.shape[1]
    states, phases = np.empty((T, W, n)), np.empty((T, W))
    norm = sizes[0] + np.abs(steps[:, 1]) * (sizes[1] + highest) + sizes[2]
    pieces = np.maximum(np.ceil(norm * steps[:, 0] / LONGEST), 1.0)
    lost = ~(pieces <= MOST_PIECES)
    pieces[lost] = 1.0
    reach = np.where(lost, 0.0, norm * steps[:, 0] / pieces)
    order = np.array([_order(value) for value in reach.tolist()], dtype=np.int64)
    parts = system, spin, input, seen, spring, imbalance, runout
    at = begin.copy()
    for tick in range(T):
        while (active := at < stop[tick]).any():
            step = np.where(active, at, 0)
            told = angle[step]
            phase[:] = np.where(active & ~np.isnan(told), told, phase)
            if jump.any():
                _euler(state, np.where(active, jump[step], 0.0))
            seconds, speed = np.where(active, steps[step, 0], 0.0), steps[step, 1]
            length = seconds / pieces[step]
            for piece in range(int(pieces[step][active].max())):
                busy = active & (piece < pieces[step])
                inputs = steps[step, 2:] + change[step] * (piece / pieces[step])[:, None]
                changes = change[step] / pieces[step][:, None]
                start = phase + speed * length * piece
                orders = np.where(busy, order[step], 0)
                _turn_on(state, start, speed, np.where(busy, length, 0.0), orders, inputs, changes, *parts)
            phase[:] = np.fmod(phase + speed * seconds, _FULL_TURN)
            state[active & lost[step]] = math.nan
            at = at + active
        states[tick], phases[tick] = state, phase
    return states, phases


def _order(reach: float) -> int:
    """Of a Taylor series whose term k is at most reach^k/k!."""
    order, term = 1, reach
    while term > NEGLIGIBLE or order < reach:
        order += 1
        term = term * reach / order
    return order


def _turn_on(
    state: FloatArray,
    phase: FloatArray,
    speed: FloatArray,
    length: FloatArray,
    orders: IntArray,
    inputs: FloatArray,
    changes: FloatArray,
    system: FloatArray,
    spin: FloatArray,
    input: FloatArray,
    seen: FloatArray,
    spring: FloatArray,
    imbalance: FloatArray,
    runout: FloatArray,
) -> None:
    """One series for each wheel, all of which have a first order of at most ``orders``."""
    W, n = state.shape
    most, pairs = int(orders.max()), len(spring)
    springs = bool(spring.any())
    harmonics = np.arange(1, max(len(runout), 2) + 1)
    cosine, sine = cos_sin(harmonics * phase[:, None])  # (W, J)
    power = np.ones((W, harmonics.size, most))
    power[..., 1:] = (harmonics * speed[:, None] * length[:, None])[..., None] / np.arange(1, most)
    np.multiply.accumulate(power, axis=-1, out=power)
    quarter = np.arange(most) % 4
    c = power * np.stack([cosine, -sine, -cosine, sine], axis=-1)[..., quarter]
    s = power * np.stack([sine, cosine, -sine, -cosine], axis=-1)[..., quarter]
    push = np.zeros((inputs.shape[1], W, most))
    push[:, :, 0] = inputs.T
    if most > 1:
        push[:, :, 1] = changes.T
    on = (inputs[:, 0] > 0.0)[:, None]
    for j, (a, b) in enumerate(runout.tolist()):
        push[0] = np.where(on, push[0] + (a * c[:, j] + b * s[:, j]), push[0])
    square = (speed * speed)[:, None]
    force = push[0][..., None] * input[:, 0] + push[1][..., None] * input[:, 1]
    force += (square * c[:, 0])[..., None] * imbalance[:, 0] + (square * s[:, 0])[..., None] * imbalance[:, 1]
    a, b = spring[:, 0], spring[:, 1]
    real = a * c[:, 1, :, None] - b * s[:, 1, :, None]  # (W, k, p)
    imaginary = a * s[:, 1, :, None] + b * c[:, 1, :, None]
    turning = np.stack([np.stack([real, imaginary], -1), np.stack([imaginary, -real], -1)], -2)
    A = np.ascontiguousarray((system + speed[:, None, None] * spin).swapaxes(1, 2))
    k = np.arange(most)[:, None]
    part = np.where(k < orders, length / (k + 1), 0.0)[:, :, None]
    terms = np.zeros((W, most + 1, n + 2 * pairs))  # of z and R, the newest first
    terms[:, most, :n] = state
    terms[:, most, n:] = np.add.reduce(state[:, :, None] * np.ascontiguousarray(seen.T), axis=1)
    R = terms[:, :, n:].reshape(W, most + 1, pairs, 1, 2)  # these two are views
    g = (x := np.zeros((W, n + 2 * pairs)))[:, n:].reshape(W, pairs, 2)
    for order in range(most):
        x[:, :n] = terms[:, most - order, :n]
        if springs:
            pulls = np.add.reduce(turning[:, : order + 1] * R[:, most - order :], axis=1)  # (W, p, out, in)
            np.add(pulls[..., 0], pulls[..., 1], out=g)
        after = np.add.reduce(A * x[:, :, None], axis=1)
        after += force[:, order]
        np.multiply(after, part[order], out=terms[:, most - order - 1])
    np.add.reduce(terms[:, :, :n], axis=1, out=state)
    state += 0.0  # no negative zeros


def _transitions(coefficients: FloatArray, length: FloatArray, doublings: IntArray, n: int) -> FloatArray:
    """Transposed [Phi G_0], shape (..., n + m, n), from coefficients of shape (..., J, n + m, n)."""
    power = np.empty((*length.shape, coefficients.shape[-3]))
    power[..., 0], power[..., 1:] = 1.0, length[..., None]
    np.multiply.accumulate(power, axis=-1, out=power)
    total: FloatArray = np.add.reduce(coefficients * power[..., None, None], axis=-3)
    for more in range(int(doublings.max(initial=0))):
        squared = total[..., :, :1] * total[..., None, 0, :n]
        for j in range(1, n):
            squared += total[..., :, j : j + 1] * total[..., None, j, :n]
        squared[..., n:, :] += total[..., n:, :]
        total = np.where((doublings > more)[..., None, None], squared, total)
    return total


def _euler(state: FloatArray, change: FloatArray) -> None:
    """The jump of the complete model's state (X', Y', U', V', y', X, Y, U, V, y), or with x' and x, with the speed."""
    X, Y, U, V = (state[:, state.shape[1] // 2 + k] for k in range(4))
    stretch, shear = change * (X + V), change * (Y - U)
    state[:, 0] -= shear
    state[:, 1] += stretch
    state[:, 2] -= stretch
    state[:, 3] -= shear


def read(state: FloatArray, output: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What is put out of states (W, n): output (W, n, 2) times the state, (W, 2), and the largest size in it, (W,)."""
    return np.add.reduce(output * state[:, :, None], axis=1), np.abs(state).max(axis=1)


def axle_pull(
    state: FloatArray, phase: FloatArray, seen: FloatArray, spring: FloatArray, wheel_x: FloatArray
) -> FloatArray:
    """What the springs beyond their mean add to the force on a held wheel along x_ros [N], shape (M,).

    Parameters
    ----------
    state : ndarray, shape (M, n)
        In the fixed frame.
    phase : ndarray, shape (M,)
        phi [rad].
    seen, spring, wheel_x
        Of :class:`.turning.Turning`.
    """
    R = np.add.reduce(state[:, :, None] * np.ascontiguousarray(seen.T), axis=1)
    cosine, sine = cos_sin(2.0 * phase)
    total = np.zeros_like(phase)
    for p, (a, b) in enumerate(spring.tolist()):
        real, imaginary = a * cosine - b * sine, a * sine + b * cosine
        X, Y = R[:, 2 * p], R[:, 2 * p + 1]
        total = total - wheel_x[2 * p] * (real * X + imaginary * Y)  # x_ros = -X
        total = total - wheel_x[2 * p + 1] * (imaginary * X - real * Y)
    return total


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
    """The eigenvalues of the inextensional modes, and what goes with them.

    With k = n (B C - A^2)/(A + n C), g = gamma Omega and w = n Omega,

        V' = i w V - (d + 2 i g) V - k Z + r f,     Z' = V + i w Z,
        r = force n C/(A + n C) for f_r, and i force n A/(A + n C) for f_t.

    Parameters
    ----------
    constants : tuple of float
        Of :func:`~tire_dynamics.science.coefficients.constants`.
    numbers, damping : ndarray, shape (N,)
        n and d.
    force : ndarray, shape (2, N)
    speeds : ndarray, shape (S,)
        Omega [rad/s].
    exponents, steady, right, left : ndarray
        Filled with the fields of :class:`~tire_dynamics.science.modes.Spins`; right = [[s+, s-], [1, 1]], s = mu - i w.
    """
    A, _, C, determinant = formula(constants, numbers, speeds[:, None])
    through = A + numbers * C
    turning, twisting = numbers * speeds[:, None], speeds[:, None] * twist(numbers, A, C)
    stiffness = numbers * determinant / through
    radial, tangential = numbers * C / through, numbers * A / through
    real = 0.25 * damping * damping - twisting * twisting - stiffness
    imaginary = damping * twisting
    larger = np.sqrt(0.5 * (np.sqrt(real * real + imaginary * imaginary) + np.abs(real)))
    smaller = 0.5 * imaginary / larger
    root = np.stack([np.where(real >= 0.0, larger, smaller), np.where(real >= 0.0, smaller, larger)])
    half = 0.5 * damping
    slow = np.stack([np.stack([root[0] - half, -root[0] - half]), np.stack([root[1] - twisting, -root[1] - twisting])])
    slow = np.moveaxis(slow, 1, -1)  # (2, S, N, 2)
    exponents[:] = slow
    exponents[1] += turning[..., None]
    right[..., 0, :] = slow
    right[0, ..., 1, :], right[1, ..., 1, :] = 1.0, 0.0
    inverse = _inverse(root + root)
    plus, minus = _times(inverse, -slow[..., 1]), _times(inverse, slow[..., 0])
    left[..., 0, 0], left[..., 0, 1], left[..., 1, 0], left[..., 1, 1] = inverse, plus, -inverse, minus
    along = np.stack([radial * force[0], radial * force[1]])
    across = np.stack([-(tangential * force[1]), tangential * force[0]])
    drive = np.stack([_times(inverse, along), _times(inverse, across)], axis=-1)  # (2, S, N, 2)
    steady[..., 0, :] = _times(-drive, _inverse(exponents[..., :1]))
    steady[..., 1, :] = _times(drive, _inverse(exponents[..., 1:]))


def whirl_changes(
    constants: tuple[float, float, float, float, float],
    numbers: FloatArray,
    right: FloatArray,
    left: FloatArray,
    before: IntArray,
    after: IntArray,
    speeds: FloatArray,
) -> FloatArray:
    """left[after] J right[before] of jumps of the speed, shape (2, C, N, 2, 2); J takes V to V - i gamma change Z.

    Parameters
    ----------
    constants, numbers
        As for :func:`whirls`.
    right, left : ndarray, shape (2, S, N, 2, 2)
    before, after : ndarray of int, shape (C,)
        Places in ``speeds`` (S,) [rad/s]. gamma is that of the root of the mean square.
    """
    first, second = speeds[before], speeds[after]
    middle = np.sqrt((first * first + first * second + second * second) / 3.0)
    A, _, C, _ = formula(constants, numbers, middle[:, None])
    jumped = right[:, before][..., 0, :]  # V of each column; Z is 1
    jumped[1] -= ((second - first)[:, None] * twist(numbers, A, C))[..., None]
    lefts = left[:, after]
    return _times(lefts[..., :1], jumped[..., None, :]) + lefts[..., 1:]


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
    """The modes beside n = 1 over a stretch of time, under forces that are held over each step.

    Steps under one force are taken as one interval. The stretch of each wheel is cut into groups of intervals where its
    state is put out, where its speed changes, and where a group would have more than 256 intervals. Over a group,

        w <- exp(mu r_0) (w - s_0) + sum_(i > 0) exp(mu r_i) (s_(i-1) - s_i) + s_last,

    r_i the time from the begin of interval i to the end of the group, s_i the steady state under its force. What
    stands behind the last end of a group is left to the next call.

    Parameters
    ----------
    own : ndarray, shape (2, W, N, k)
        w, (real, imaginary) along the first axis, as everywhere here; changed in place.
    exponents, steady : ndarray, shapes (2, W + C, N, k) and (2, W + C, N, k, 2)
        Of :class:`~tire_dynamics.science.modes.Spins`, at the speeds of the wheels, then behind each of C changes.
    changes, offsets : ndarray, shapes (2, C, N, k, k) and (2, C, N, k)
        Of :meth:`~tire_dynamics.science.modes.RingModes.changes`.
    length : ndarray of int, shape (I,)
        Of each step [ns], wheel after wheel.
    force : ndarray, shape (I, 2)
        f_r (outward), f_t (along increasing psi) [N].
    changed : ndarray of int, shape (C,)
        The steps before which the speed changes, ascending.
    ends : ndarray of int, shape (M,)
        The steps before which the state is put out, wheel after wheel, ascending in each.
    steps_of, ends_of : ndarray of int, shape (W + 1,)
        First step and first end of each wheel.
    outputs : ndarray, shape (2, M, N, k)
        Filled with w at the ends.

    Returns
    -------
    taken : ndarray of int, shape (W,)
        The first step of each wheel that is left.
    spin : ndarray of int, shape (M,)
        At which of the speeds each output is.
    """
    W = own.shape[1]
    begin, sizes = steps_of[:-1], np.diff(steps_of)
    fresh = np.zeros(length.size + 1, dtype=bool)  # whether another interval begins with this step
    fresh[1:-1] = (force[1:] != force[:-1]).any(axis=1)
    fresh[begin] = fresh[changed] = fresh[ends] = True
    starts = np.flatnonzero(fresh[:-1])
    clock = np.concatenate([[0], np.cumsum(length)])  # [ns]

    # What ends a group, in order: its state is put out, then the speed changes.
    place = np.concatenate([ends, changed])
    kind = np.repeat([_SHOWN, _CHANGED], [ends.size, changed.size])
    whose = np.concatenate(
        [np.repeat(np.arange(W), np.diff(ends_of)), np.searchsorted(steps_of, changed, side="right") - 1]
    )
    order = np.lexsort([kind, place, whose])
    place, kind, whose = place[order], kind[order], whose[order]
    place, kind, whose = _cut_long_groups(place, kind, whose, starts, begin, sizes)

    leads = np.concatenate([[True], whose[1:] != whose[:-1]])[: place.size]
    previous = np.where(leads, begin[whose], np.concatenate([[0], place[:-1]])[: place.size])
    first, stop = np.searchsorted(starts, previous), np.searchsorted(starts, place)
    count = stop - first
    kept = np.repeat(first - (np.cumsum(count) - count), count) + np.arange(count.sum())
    left = (np.repeat(clock[place], count) - clock[starts[kept]]) * 1e-9

    turned, shown = kind == _CHANGED, kind == _SHOWN
    passed = np.cumsum(turned) - turned
    in_wheel = passed - np.repeat(passed[leads], np.diff(np.append(np.flatnonzero(leads), place.size)))
    spin = np.where(in_wheel > 0, W + passed - 1, whose)
    output, change = np.full(place.size, -1), np.full(place.size, -1)
    output[shown], change[turned] = np.arange(ends.size), np.arange(changed.size)
    groups = np.searchsorted(whose, np.arange(W + 1))
    _advance_groups(
        own, exponents, steady, changes, offsets, spin, change, output,
        np.concatenate([[0], np.cumsum(count)]), groups, left, force[starts[kept]], outputs,
    )  # fmt: skip
    taken = begin.copy()
    taken[whose] = place  # the last one stays
    return taken, spin[shown]


def _cut_long_groups(
    place: IntArray, kind: IntArray, whose: IntArray, starts: IntArray, begin: IntArray, sizes: IntArray
) -> tuple[IntArray, IntArray, IntArray]:
    """Ends of groups, with more of them where one would have over _MOST_TOGETHER intervals."""
    wheels = np.arange(sizes.size)
    edges = np.concatenate([place, begin, begin + sizes])
    ranks = np.repeat([1, 0, 2], [place.size, wheels.size, wheels.size])
    owners = np.concatenate([whose, wheels, wheels])
    order = np.lexsort([ranks, edges, owners])
    at = np.searchsorted(starts, edges[order])
    many = np.flatnonzero((np.diff(at) > MOST_TOGETHER) & (np.diff(owners[order]) == 0))
    if not many.size:
        return place, kind, whose
    more = [np.arange(at[k] + MOST_TOGETHER, at[k + 1], MOST_TOGETHER) for k in many]
    cuts = starts[np.concatenate(more)]
    mine = np.repeat(owners[order][many], [each.size for each in more])
    place, whose = np.concatenate([place, cuts]), np.concatenate([whose, mine])
    kind = np.concatenate([kind, np.full(cuts.size, _CUT)])
    order = np.lexsort([kind, place, whose])
    return place[order], kind[order], whose[order]


def _advance_groups(
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
    """:func:`follow` for groups: speed of each, change after it, place in the outputs (-1 for none), first interval;
    first group of each wheel; r_i [s] and force of each interval."""
    count = np.diff(first)
    spin_of = np.repeat(spin, count)
    grown = np.stack(growth(exponents[0, spin_of] * left[:, None, None], exponents[1, spin_of] * left[:, None, None]))
    push = _shape(steady, spin_of, force)
    step = _times(grown[:, 1:], push[:, :-1] - push[:, 1:])  # for each interval but a group's first
    driven = np.zeros((2, spin.size, *own.shape[2:]))
    for i in range(1, int(count.max(initial=0))):
        having = np.flatnonzero(count > i)
        driven[:, having] += step[:, first[having] + i - 1]
    for turn in range(int(np.diff(begin).max(initial=0))):
        wheels = np.flatnonzero(begin[:-1] + turn < begin[1:])
        groups = begin[wheels] + turn
        moving = count[groups] > 0
        if moving.any():
            w, g = wheels[moving], groups[moving]
            start, last = first[g], first[g + 1] - 1
            own[:, w] = _times(grown[:, start], own[:, w] - push[:, start]) + driven[:, g] + push[:, last]
        shown = output[groups] >= 0
        if shown.any():
            outputs[:, output[groups[shown]]] = own[:, wheels[shown]]
        turning = change[groups] >= 0
        if turning.any():
            w, c = wheels[turning], change[groups[turning]]
            own[:, w] = _apply(changes[:, c], own[:, w]) + offsets[:, c]


def _shape(steady: FloatArray, which: IntArray, force: FloatArray) -> FloatArray:
    shapes = steady[:, which]
    result: FloatArray = shapes[..., 0] * force[:, 0, None, None] + shapes[..., 1] * force[:, 1, None, None]
    return result


def _times(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.stack([a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]])


def _inverse(a: FloatArray) -> FloatArray:
    square = a[0] * a[0] + a[1] * a[1]
    return np.stack([a[0] / square, -a[1] / square])


def _apply(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    total = _times(matrix[..., 0], vector[..., :1])
    for j in range(1, matrix.shape[-1]):
        total += _times(matrix[..., j], vector[..., j : j + 1])
    return total


def deflections(amplitudes: FloatArray, basis: FloatArray) -> FloatArray:
    """Sums over modes, in their order.

    Parameters
    ----------
    amplitudes : ndarray, shape (M, 2, B)
        Radial and tangential.
    basis : ndarray, shape (B, P)

    Returns
    -------
    ndarray, shape (M, 2, P)
    """
    total: FloatArray = amplitudes[..., :1] * basis[0]
    for b in range(1, len(basis)):
        total += amplitudes[..., b : b + 1] * basis[b]
    return total
