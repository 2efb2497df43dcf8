# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""The n = 1 motion of the rings with their wheels, stepped exactly.

In the fixed frame, with the speed Omega, the load and the traction linear over a step of length h, tau = t/h,

    dz/dtau = h [C + Omega S + Omega' E] z + h B [load, traction] + h imbalance
              - h M^-1 N^T kappa exp(2 i phi) conj(N q)

(:mod:`.rotating_excitation`; E makes the Euler terms of the complete model). Everything in it is an entire
function of tau, so that the Taylor coefficients of z follow one from the other. The series is summed until what is
left is below the rounding of a double; it has no truncation error at any step length. Long steps are cut into pieces
over which the norm is small, and where nothing rotates with the tire a very long one is doubled up.

Sums, products and quotients are taken in a fixed order, with no BLAS and no library function in between: the same
inputs give the same bits on every IEEE machine, which is what lets a log that was written in a vehicle be replayed
exactly on a desk.

The file is long because it is one compiled class: every step calls several of its methods, as C functions on the
class's own buffers, and between modules these could not be inlined.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..science import rotating_excitation, wheel
from ..science.stepping import TERMS, reaches
from ..science.unit import TireWheelUnit
from .buffers import flat, zeros
from .settings import check_wheel

try:
    import cython
except ImportError:
    from ..science import cython_stand_in as cython
if cython.compiled:
    from cython.cimports.libc.math import ceil, fmod
    from cython.cimports.tire_dynamics.science.elementary import grow
else:
    from math import ceil, fmod

    from ..science.elementary import grow

__all__ = ["Motion"]

FloatArray = NDArray[np.float64]

_LONGEST = cython.declare(cython.double, 3.0)  # norm times step of one series
_MOST_TERMS = cython.declare(cython.Py_ssize_t, TERMS)  # 27 terms are enough for the longest piece
_MOST_PIECES = cython.declare(cython.double, 1e5)  # of a step; a unit that needs more has nothing of a tire
_DOUBLED = cython.declare(cython.double, 24.0)  # pieces from which on doubling is quicker
_BEYOND_ALL_BOUNDS = cython.declare(cython.double, 1e6)  # [m/s] and [m]
_FULL_TURN = cython.declare(cython.double, 2.0 * math.pi)
_NAN = cython.declare(cython.double, math.nan)


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _next_term(
    half: cython.Py_ssize_t,
    matrix: cython.double[::1],
    at: cython.Py_ssize_t,
    terms: cython.double[::1],
    row: cython.Py_ssize_t,
    part: cython.double,
    force: cython.double[::1],
    first: cython.Py_ssize_t,
) -> cython.void:
    r: cython.Py_ssize_t
    c: cython.Py_ssize_t
    total: cython.double
    for r in range(half):
        total = 0.0
        for c in range(2 * half):
            total += matrix[at + r * 2 * half + c] * terms[row + c]
        if first >= 0:
            total += force[first + r]
        terms[row + 2 * half + r] = total * part
        terms[row + 3 * half + r] = terms[row + r] * part


@cython.cclass
class Motion:
    """States of W wheels of one kind: the first mode of each ring, and its wheel.

    Parameters
    ----------
    unit : TireWheelUnit
    model : {"inextensional", "complete"}
    wheels : int

    Notes
    -----
    States are those of :func:`~tire_dynamics.science.wheel.fixed_frame_matrix`; their velocities are for
    ``spin_speed``, the speed at the end of the last step.
    """

    def __init__(self, unit: TireWheelUnit, model: wheel.Model, wheels: int) -> None:
        self.wheels, self.model = wheels, model
        self.complete = model == "complete"
        self.states = wheel.states(unit, model)
        self.state = zeros(wheels * self.states)
        self.phase, self.spin_speed = zeros(wheels), zeros(wheels)
        self.force_x = self.force_z = 0.0
        self.set_unit(unit)

    def set_unit(self, unit: TireWheelUnit) -> None:
        """Change the tire from now on. Positions and velocities go on as they are; a wheel is let go at rest."""
        parts, frame = rotating_excitation.rotating_excitation(unit, self.model), wheel.fixed_frame(unit, self.model)
        states = wheel.states(unit, self.model)
        self.state = flat(wheel.reshaped(np.array(self.state).reshape(self.wheels, -1), states))
        self.unit, self.parts, self.states = unit, parts, states
        n, half, self.half, self.pairs = states, states // 2, states // 2, len(parts.spring)
        self.rotating, self.varying, self.rigid = parts.is_rotating, self.pairs > 0, unit.is_longitudinally_rigid
        self.harmonics, self.highest = 2, parts.highest
        # of the accelerations alone: the displacements' rows only say that their rates are the velocities
        self.system, self.spin = flat(parts.system[:half, :n]), flat(parts.spin[:half, :n])
        self.input, self.imbalance = flat(parts.input[:half]), flat(parts.imbalance[:half])
        self.pull, self.net = flat(parts.system[:half, n:]), flat(parts.seen[:, half:])
        self.spring, self.sizes = flat(parts.spring), flat(parts.sizes)
        self.wheel_x = flat(parts.wheel_x)
        self.output, self.output_spin = flat(frame.output), flat(frame.output_spin)
        self.matrix, self.between = zeros(self.wheels * half * n), zeros(half * n)
        self.matrix_at = np.full(self.wheels, math.nan).data
        self.after, self.force = zeros(n), zeros(2 * half)
        self.terms, self.pulls = zeros((TERMS + 2) * n), zeros(2 * max(self.pairs, 1))
        self.convolved, self.answers = (zeros(2 * max(self.pairs, 1) * (TERMS + 2)) for _ in range(2))
        self.cosines, self.sines = (zeros(self.harmonics * 3) for _ in range(2))
        self.angles, self.none = (zeros(self.harmonics) for _ in range(2))
        self.affine, self.squared = (zeros((n + 3) * n) for _ in range(2))
        self.reach = np.array(reaches()).data

    def reset(self, index: int) -> None:
        """Be at rest."""
        self.put(index, np.zeros(self.states), 0.0, 0.0)

    def put(self, index: int, state: FloatArray, speed: float, angle: float) -> None:
        """Be in a state, shape (n,), whose velocities are for a speed [rad/s], at the wheel's angle [rad]."""
        check_wheel(index, self.wheels)
        n = self.states
        if state.shape != (n,):
            raise ValueError(f"the state has shape {state.shape}; it must be {(n,)}")
        for k, value in enumerate(state.tolist()):
            self.state[index * n + k] = value
        self.spin_speed[index], self.phase[index] = speed, angle

    # -- steps ----------------------------------------------------------------------------------------------

    def advance(
        self,
        index: int,
        seconds: float,
        speed: float,
        load: float,
        traction: float = 0.0,
        speed_change: float = 0.0,
        load_change: float = 0.0,
        traction_change: float = 0.0,
        angle: float = math.nan,
    ) -> None:
        """One step of one wheel.

        Parameters
        ----------
        index : int
        seconds : float
            [s], >= 0.
        speed, load, traction : float
            At the beginning of the step [rad/s], [N].
        speed_change, load_change, traction_change : float
            Over the step, linear.
        angle : float
            The wheel's at the beginning [rad], if it is known; NaN if not.
        """
        check_wheel(index, self.wheels)
        self.step(index, seconds, speed, speed_change, load, traction, load_change, traction_change, angle)

    def follow_lines(self, time: FloatArray, speed: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Wheel 0 from sample to sample, from the state that it is in at the first.

        Parameters
        ----------
        time, speed : ndarray, shape (N,)
            [s], ascending, and [rad/s].
        force : ndarray, shape (N, 2)
            Load and traction [N]; all is linear between samples.

        Returns
        -------
        states : ndarray, shape (N, n)
        forces : ndarray, shape (N, 2)
            On the axle (x, z), REP 103 axes [N].
        """
        if time.ndim != 1 or speed.shape != time.shape or force.shape != (len(time), 2):
            raise ValueError(f"time, speed, force have the shapes {time.shape}, {speed.shape}, {force.shape}")
        states, forces = np.empty((len(time), self.states)), np.empty((len(time), 2))
        time, speed, force = (np.ascontiguousarray(each).reshape(-1) for each in (time, speed, force))
        self._follow_lines(
            len(time), time.data, speed.data, force.data, states.reshape(-1).data, forces.reshape(-1).data
        )
        return states, forces

    def _follow_lines(
        self,
        count: cython.Py_ssize_t,
        time: cython.const[cython.double][::1],
        speed: cython.const[cython.double][::1],
        force: cython.const[cython.double][::1],
        states: cython.double[::1],
        forces: cython.double[::1],
    ) -> None:
        i: cython.Py_ssize_t
        k: cython.Py_ssize_t
        with cython.nogil:
            for i in range(count):
                if i > 0:
                    self.step(
                        0, time[i] - time[i - 1], speed[i - 1], speed[i] - speed[i - 1], force[2 * i - 2],
                        force[2 * i - 1], force[2 * i] - force[2 * i - 2], force[2 * i + 1] - force[2 * i - 1], _NAN,
                    )  # fmt: skip
                self.axle_force_and_norm(0, speed[i])
                for k in range(self.states):
                    states[i * self.states + k] = self.state[k]
                forces[2 * i], forces[2 * i + 1] = self.force_x, self.force_z

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def set_matrix(
        self, matrix: cython.double[::1], at: cython.Py_ssize_t, speed: cython.double
    ) -> cython.void:
        k: cython.Py_ssize_t
        for k in range(self.half * self.states):
            matrix[at + k] = self.system[k] + speed * self.spin[k]

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def spin_at(self, wheel: cython.Py_ssize_t, speed: cython.double) -> cython.void:
        """The matrix of one wheel at a speed."""
        if speed != self.matrix_at[wheel]:
            self.set_matrix(self.matrix, wheel * self.half * self.states, speed)
            self.matrix_at[wheel] = speed

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def jump(self, wheel: cython.Py_ssize_t, change: cython.double) -> cython.void:
        """The jump of the complete model's state with the speed: the Euler terms' integral, change E z."""
        v: cython.Py_ssize_t = wheel * self.states
        q: cython.Py_ssize_t = v + self.states // 2
        radial: cython.double = change * (self.state[q] + self.state[q + 3])  # X + V
        shear: cython.double = change * (self.state[q + 1] - self.state[q + 2])  # Y - U
        self.state[v] -= shear
        self.state[v + 1] += radial
        self.state[v + 2] -= radial
        self.state[v + 3] -= shear

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def step(
        self,
        wheel: cython.Py_ssize_t,
        seconds: cython.double,
        speed: cython.double,
        speed_change: cython.double,
        load: cython.double,
        traction: cython.double,
        load_change: cython.double,
        traction_change: cython.double,
        angle: cython.double,
    ) -> cython.void:
        """One step of one wheel, as :meth:`advance` has it."""
        n: cython.Py_ssize_t = self.states
        first: cython.Py_ssize_t = wheel * n
        at: cython.Py_ssize_t = wheel * self.half * self.states
        k: cython.Py_ssize_t
        order: cython.Py_ssize_t
        piece: cython.Py_ssize_t
        count: cython.Py_ssize_t
        share: cython.double
        now: cython.double
        start: cython.double
        if angle == angle:
            self.phase[wheel] = angle
        if speed != self.spin_speed[wheel]:
            if self.complete:
                self.jump(wheel, speed - self.spin_speed[wheel])
            self.spin_speed[wheel] = speed
        norm: cython.double = (
            self.sizes[0]
            + (abs(speed) + abs(speed_change)) * (self.sizes[1] + (self.highest if self.rotating else 0.0))
            + self.sizes[2]
        )
        if speed_change != 0.0 and self.complete and seconds > 0.0:
            norm = norm + abs(speed_change) / seconds * self.sizes[3]
        pieces: cython.double = ceil(norm * seconds / _LONGEST) if norm * seconds < 1e18 else 1e18
        pieces = pieces if pieces > 1.0 else 1.0
        if pieces > _DOUBLED and not self.rotating and speed_change == 0.0 and pieces < 1e18:
            self.spin_at(wheel, speed)
            self.long_step(
                wheel, seconds, load, traction, load_change, traction_change, norm
            )
        elif not pieces <= _MOST_PIECES:
            for k in range(n):
                self.state[first + k] = _NAN
        else:
            reach: cython.double = norm * seconds / pieces
            order = self.order_of(reach)
            count = cython.cast(cython.Py_ssize_t, pieces)
            length: cython.double = seconds / pieces
            slope: cython.double = speed_change / pieces
            self.spin_at(wheel, speed)
            for piece in range(count):
                share = piece / pieces
                now = speed + speed_change * share
                for k in range(n):
                    self.terms[k] = self.state[first + k]
                if piece > 0 and slope != 0.0:
                    self.set_matrix(self.between, 0, now)
                if self.rotating:
                    start = self.phase[wheel] + (speed + 0.5 * speed_change * share) * length * piece
                    if piece > 0 and slope != 0.0:
                        self.rotating_taylor_step(
                            self.between, 0, order, length, now, slope, start, load + load_change * share,
                            traction + traction_change * share, load_change / pieces, traction_change / pieces,
                        )  # fmt: skip
                    else:
                        self.rotating_taylor_step(
                            self.matrix, at, order, length, now, slope, start, load + load_change * share,
                            traction + traction_change * share, load_change / pieces, traction_change / pieces,
                        )  # fmt: skip
                elif piece > 0 and slope != 0.0:
                    self.taylor_step(
                        self.between, 0, order, length, slope, load + load_change * share,
                        traction + traction_change * share, load_change / pieces, traction_change / pieces,
                    )  # fmt: skip
                else:
                    self.taylor_step(
                        self.matrix, at, order, length, slope, load + load_change * share,
                        traction + traction_change * share, load_change / pieces, traction_change / pieces,
                    )  # fmt: skip
                for k in range(n):
                    self.state[first + k] = self.after[k]
        self.phase[wheel] = fmod(self.phase[wheel] + (speed + 0.5 * speed_change) * seconds, _FULL_TURN)
        if speed_change != 0.0:
            self.spin_speed[wheel] = speed + speed_change

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def order_of(self, reach: cython.double) -> cython.Py_ssize_t:
        """The terms of a series whose term k is at most reach^k/k!, such that what is left out is negligible."""
        k: cython.Py_ssize_t = 1
        while reach > self.reach[k]:
            k += 1
        return k

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def next_term(
        self,
        matrix: cython.double[::1],
        at: cython.Py_ssize_t,
        k: cython.Py_ssize_t,
        part: cython.double,
        first: cython.Py_ssize_t,
    ) -> cython.void:
        """Term k + 1 of the series from the term k: part [A x + force], the force from a place on, and part v."""
        if self.half == 3:  # the usual one: with a number, the compiler unrolls its loops
            _next_term(3, matrix, at, self.terms, 6 * k, part, self.force, first)
        else:
            _next_term(self.half, matrix, at, self.terms, self.states * k, part, self.force, first)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def add_slope(
        self, k: cython.Py_ssize_t, part: cython.double, slope: cython.double, length: cython.double
    ) -> cython.void:
        """What a speed that changes by ``slope`` over a piece adds: part slope [S x_before + E x/length]."""
        n: cython.Py_ssize_t = self.states
        half: cython.Py_ssize_t = self.half
        row: cython.Py_ssize_t = k * n
        r: cython.Py_ssize_t
        c: cython.Py_ssize_t
        total: cython.double
        if k > 0:
            for r in range(half):
                total = 0.0
                for c in range(n):
                    total += self.spin[r * n + c] * self.terms[row - n + c]
                self.terms[row + n + r] += part * slope * total
        if self.complete:
            total = part * slope / length
            c = row + half
            self.terms[row + n] -= total * (self.terms[c + 1] - self.terms[c + 2])
            self.terms[row + n + 1] += total * (self.terms[c] + self.terms[c + 3])
            self.terms[row + n + 2] -= total * (self.terms[c] + self.terms[c + 3])
            self.terms[row + n + 3] -= total * (self.terms[c + 1] - self.terms[c + 2])

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def sum_terms(self, order: cython.Py_ssize_t) -> cython.void:
        """The sum of all terms into ``after``, the smallest first."""
        n: cython.Py_ssize_t = self.states
        k: cython.Py_ssize_t
        b: cython.Py_ssize_t
        for b in range(n):
            self.after[b] = self.terms[order * n + b]
        for k in range(order - 1, -1, -1):
            for b in range(n):
                self.after[b] += self.terms[k * n + b]
        for b in range(n):
            self.after[b] += 0.0  # no negative zeros

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def taylor_step(
        self,
        matrix: cython.double[::1],
        at: cython.Py_ssize_t,
        order: cython.Py_ssize_t,
        length: cython.double,
        slope: cython.double,
        load: cython.double,
        traction: cython.double,
        load_change: cython.double,
        traction_change: cython.double,
    ) -> cython.void:
        """One series from the term 0 into ``after``, where nothing rotates with the tire."""
        half: cython.Py_ssize_t = self.half
        k: cython.Py_ssize_t
        b: cython.Py_ssize_t
        for b in range(half):
            self.force[b] = load * self.input[2 * b] + traction * self.input[2 * b + 1]
            self.force[half + b] = load_change * self.input[2 * b] + traction_change * self.input[2 * b + 1]
        for k in range(order):
            self.next_term(matrix, at, k, length / (k + 1), k * half if k < 2 else -1)
            if slope != 0.0:
                self.add_slope(k, length / (k + 1), slope, length)
        self.sum_terms(order)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def rotating_taylor_step(
        self,
        matrix: cython.double[::1],
        at: cython.Py_ssize_t,
        order: cython.Py_ssize_t,
        length: cython.double,
        speed: cython.double,
        slope: cython.double,
        phase: cython.double,
        load: cython.double,
        traction: cython.double,
        load_change: cython.double,
        traction_change: cython.double,
    ) -> cython.void:
        """The same where something does.

        exp(i j phi) has the Taylor coefficients e_k = i j h/k (Omega e_(k-1) + slope e_(k-2)); the springs' is
        multiplied with that of conj(R), R = N q.
        """
        n: cython.Py_ssize_t = self.states
        half: cython.Py_ssize_t = self.half
        J: cython.Py_ssize_t = self.harmonics
        P: cython.Py_ssize_t = self.pairs
        T: cython.Py_ssize_t = _MOST_TERMS + 2
        k: cython.Py_ssize_t
        a: cython.Py_ssize_t
        b: cython.Py_ssize_t
        j: cython.Py_ssize_t
        p: cython.Py_ssize_t
        q: cython.Py_ssize_t
        scale: cython.double
        c: cython.double
        s: cython.double
        total: cython.double
        pressed: cython.double
        pushed: cython.double
        xx: cython.double
        xy: cython.double
        yx: cython.double
        yy: cython.double
        square: cython.double
        for j in range(J):
            self.angles[j] = (j + 1) * phase
        grow(J, 0, self.none, self.angles, 1.0, self.cosines, self.sines)
        for j in range(J):
            self.cosines[J + j] = self.cosines[2 * J + j] = self.sines[J + j] = self.sines[2 * J + j] = 0.0
        for k in range(order):
            if k > 0:
                for j in range(J):
                    scale = (j + 1) * length / k
                    c = -(scale * (speed * self.sines[j] + slope * self.sines[J + j]))
                    s = scale * (speed * self.cosines[j] + slope * self.cosines[J + j])
                    self.cosines[2 * J + j] = self.cosines[J + j]
                    self.sines[2 * J + j] = self.sines[J + j]
                    self.cosines[J + j] = self.cosines[j]
                    self.sines[J + j] = self.sines[j]
                    self.cosines[j] = c
                    self.sines[j] = s
            pressed = load if k == 0 else load_change if k == 1 else 0.0
            pushed = traction if k == 0 else traction_change if k == 1 else 0.0
            # Omega^2 exp(i phi)
            square = speed * speed
            c = square * self.cosines[0]
            s = square * self.sines[0]
            if slope != 0.0:
                c = c + (2.0 * speed * slope * self.cosines[J] + slope * slope * self.cosines[2 * J])
                s = s + (2.0 * speed * slope * self.sines[J] + slope * slope * self.sines[2 * J])
            for p in range(P):
                for q in range(2):
                    total = 0.0
                    for b in range(half):
                        total += self.net[(2 * p + q) * half + b] * self.terms[k * n + half + b]
                    self.answers[(2 * p + q) * T + k] = total
                a = 2 * p * T
                xx, xy = self.cosines[1], self.sines[1]
                self.convolved[a + k] = self.spring[2 * p] * xx - self.spring[2 * p + 1] * xy
                self.convolved[a + T + k] = self.spring[2 * p] * xy + self.spring[2 * p + 1] * xx
                xx = xy = yx = yy = 0.0
                for q in range(k + 1):
                    xx += self.convolved[a + q] * self.answers[a + k - q]
                    xy += self.convolved[a + T + q] * self.answers[a + T + k - q]
                    yx += self.convolved[a + T + q] * self.answers[a + k - q]
                    yy += self.convolved[a + q] * self.answers[a + T + k - q]
                self.pulls[2 * p] = xx + xy
                self.pulls[2 * p + 1] = yx - yy
            for b in range(half):
                total = pressed * self.input[2 * b] + pushed * self.input[2 * b + 1]
                total += c * self.imbalance[2 * b] + s * self.imbalance[2 * b + 1]
                for q in range(2 * P):
                    total += self.pull[2 * P * b + q] * self.pulls[q]
                self.force[b] = total
            self.next_term(matrix, at, k, length / (k + 1), 0)
            if slope != 0.0:
                self.add_slope(k, length / (k + 1), slope, length)
        self.sum_terms(order)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def long_step(
        self,
        wheel: cython.Py_ssize_t,
        seconds: cython.double,
        load: cython.double,
        traction: cython.double,
        load_change: cython.double,
        traction_change: cython.double,
        norm: cython.double,
    ) -> cython.void:
        """A step over which nothing rotates and the speed stays: [Phi g d e] of a short one, doubled up.

        z(h) = Phi z + g + e, where g comes of the forces at the beginning, e of their change, and d of as large a force
        as that, held; over 2 h, Phi Phi, Phi g + g, Phi d + d and (Phi e + d + e)/2.
        """
        n: cython.Py_ssize_t = self.states
        first: cython.Py_ssize_t = wheel * n
        at: cython.Py_ssize_t = wheel * self.half * self.states
        doublings: cython.Py_ssize_t = 0
        order: cython.Py_ssize_t
        a: cython.Py_ssize_t
        b: cython.Py_ssize_t
        k: cython.Py_ssize_t
        total: cython.double
        length: cython.double = seconds
        while norm * length > _LONGEST:
            length = 0.5 * length
            doublings += 1
        order = self.order_of(norm * length)
        for a in range(n + 3):
            for b in range(n):
                self.terms[b] = 1.0 if a == b else 0.0
            if a < n:
                self.taylor_step(self.matrix, at, order, length, 0.0, 0.0, 0.0, 0.0, 0.0)
            elif a == n:
                self.taylor_step(self.matrix, at, order, length, 0.0, load, traction, 0.0, 0.0)
            elif a == n + 1:
                self.taylor_step(self.matrix, at, order, length, 0.0, load_change, traction_change, 0.0, 0.0)
            else:
                self.taylor_step(self.matrix, at, order, length, 0.0, 0.0, 0.0, load_change, traction_change)
            for b in range(n):
                self.affine[a * n + b] = self.after[b]
        for _ in range(doublings):
            for a in range(n + 3):
                for b in range(n):
                    self.squared[a * n + b] = 0.0
                for k in range(n):
                    total = self.affine[a * n + k]
                    for b in range(n):
                        self.squared[a * n + b] += total * self.affine[k * n + b]
            for b in range(n):
                self.squared[n * n + b] += self.affine[n * n + b]
                self.squared[(n + 1) * n + b] += self.affine[(n + 1) * n + b]
                self.squared[(n + 2) * n + b] += self.affine[(n + 1) * n + b] + self.affine[(n + 2) * n + b]
                self.squared[(n + 2) * n + b] *= 0.5
            for b in range((n + 3) * n):
                self.affine[b] = self.squared[b]
        for b in range(n):
            self.after[b] = self.affine[n * n + b] + self.affine[(n + 2) * n + b]
        for a in range(n):
            total = self.state[first + a]
            for b in range(n):
                self.after[b] += total * self.affine[a * n + b]
        for b in range(n):
            self.state[first + b] = self.after[b] + 0.0

    # -- what can be read -----------------------------------------------------------------------------------

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def axle_force_and_norm(self, wheel: cython.Py_ssize_t, speed: cython.double) -> cython.bint:
        """Force on one axle at the speed in force into ``force_x`` and ``force_z``; whether the state is bounded."""
        n: cython.Py_ssize_t = self.states
        first: cython.Py_ssize_t = wheel * n
        k: cython.Py_ssize_t
        p: cython.Py_ssize_t
        x: cython.double = 0.0
        z: cython.double = 0.0
        value: cython.double
        real: cython.double
        imaginary: cython.double
        X: cython.double
        Y: cython.double
        bounded: cython.bint = True
        for k in range(n):
            value = self.state[first + k]
            if not abs(value) < _BEYOND_ALL_BOUNDS:  # NaN is not
                bounded = False
            x += (self.output[k] + speed * self.output_spin[k]) * value
            z += (self.output[n + k] + speed * self.output_spin[n + k]) * value
        if self.varying and self.rigid:
            # what the springs beyond their mean add to the force on a held wheel; x_ros = -X
            self.angles[0] = 2.0 * self.phase[wheel]
            grow(1, 0, self.none, self.angles, 1.0, self.cosines, self.sines)
            for p in range(self.pairs):
                X = Y = 0.0
                for k in range(self.half):
                    X += self.net[2 * p * self.half + k] * self.state[first + self.half + k]
                    Y += self.net[(2 * p + 1) * self.half + k] * self.state[first + self.half + k]
                real = self.spring[2 * p] * self.cosines[0] - self.spring[2 * p + 1] * self.sines[0]
                imaginary = self.spring[2 * p] * self.sines[0] + self.spring[2 * p + 1] * self.cosines[0]
                x = x - self.wheel_x[2 * p] * (real * X + imaginary * Y)
                x = x - self.wheel_x[2 * p + 1] * (imaginary * X - real * Y)
        self.force_x, self.force_z = x, z
        return bounded

    def axle_force(self, index: int, speed: float) -> tuple[float, float]:
        """Force on one axle (x, z) at the speed in force [rad/s], REP 103 axes [N]."""
        check_wheel(index, self.wheels)
        self.axle_force_and_norm(index, speed)
        return self.force_x, self.force_z

    def state_of(self, index: int) -> FloatArray:
        """The state of one wheel, shape (n,); a copy."""
        check_wheel(index, self.wheels)
        n = self.states
        return np.array(self.state[index * n : (index + 1) * n])

    def phase_of(self, index: int) -> float:
        """The wheel's angle, modulo 2 pi [rad]: as it was measured last, or turned since the start."""
        check_wheel(index, self.wheels)
        return float(self.phase[index])

    def spin_speed_of(self, index: int) -> float:
        """The speed that a wheel's velocities are for [rad/s]."""
        check_wheel(index, self.wheels)
        return float(self.spin_speed[index])

    def snapshot(self, index: int) -> dict[str, Any]:
        """Everything of a wheel that later results depend on, in JSON's types."""
        return {
            "state": self.state_of(index).tolist(),
            "spin_speed": self.spin_speed_of(index),
            "phase": self.phase_of(index),
        }

    def restore(self, index: int, snapshot: Mapping[str, Any]) -> None:
        """Take over a :meth:`snapshot`."""
        state = np.array(snapshot["state"], dtype=np.float64)
        self.put(index, state, float(snapshot["spin_speed"]), float(snapshot["phase"]))
