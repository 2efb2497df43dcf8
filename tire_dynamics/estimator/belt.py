# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""The motion of the belts: their modes beside n = 1, and the shape that all modes make together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Integral
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..science.elementary import cos_sin
from ..science.modes import RingModes
from ..science.unit import TireWheelUnit
from ..science.wheel import Model
from .buffers import zeros
from .settings import check_wheel

try:
    import cython
except ImportError:
    from ..science import cython_stand_in as cython
if cython.compiled:
    from cython.cimports.tire_dynamics.estimator.motion import Motion
    from cython.cimports.tire_dynamics.science.eigensystem import mode_eigensystem, twist_at
    from cython.cimports.tire_dynamics.science.elementary import grow
else:

    from ..science.eigensystem import mode_eigensystem, twist_at
    from ..science.elementary import grow
    from .motion import Motion

__all__ = ["BeltMotion", "belt_numbers", "ring_angles", "shape_basis"]

FloatArray = NDArray[np.float64]

_ROOM = cython.declare(cython.Py_ssize_t, 64)  # intervals that may wait


def ring_angles(samples: int) -> FloatArray:
    """psi_j = 2 pi j/samples, fixed in space [rad], shape (samples,)."""
    return 2.0 * math.pi * np.arange(samples) / samples


def belt_numbers(n_max: SupportsIndex, model: Model) -> NDArray[np.int64]:
    """The wavenumbers beside n = 1: 2..n_max, and 0 where the ring can stretch."""
    if not isinstance(n_max, Integral) or n_max < 2:
        raise ValueError(f"n_max is {n_max!r}; it must be an integer >= 2")
    numbers = np.arange(2, int(n_max) + 1)
    return np.concatenate([[0], numbers]) if model == "complete" else numbers


def shape_basis(psi: ArrayLike, numbers: ArrayLike) -> FloatArray:
    """What makes the belt's deflection at angles of the amplitudes of its modes.

    Parameters
    ----------
    psi : array_like, shape (P,)
        Angles fixed in space [rad].
    numbers : array_like of int, shape (N,)
        Wavenumbers of the modes beside n = 1.

    Returns
    -------
    ndarray, shape (2 + 2 N, P)
        cos psi and sin psi, then cos n psi of all modes, then sin n psi.
    """
    angle = np.asarray(psi, dtype=np.float64)
    if angle.ndim != 1 or not np.isfinite(angle).all():
        raise ValueError("psi must be a row of finite angles")
    phase = np.multiply.outer(np.concatenate([[1.0], np.asarray(numbers, dtype=np.float64)]), angle)
    cosine, sine = cos_sin(phase)
    basis: FloatArray = np.concatenate([cosine[:1], sine[:1], cosine[1:], sine[1:]])
    return basis


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _combine(
    rows: cython.double[::1],
    basis: cython.double[::1],
    shape: cython.double[::1],
    B: cython.Py_ssize_t,
    P: cython.Py_ssize_t,
) -> cython.void:
    """rows (2, B) times basis (B, P) into shape (2, P), sums over B in order; B is even."""
    c: cython.Py_ssize_t
    k: cython.Py_ssize_t
    i: cython.Py_ssize_t
    x: cython.double
    y: cython.double
    for c in range(2):
        for i in range(P):
            shape[c * P + i] = 0.0
        for k in range(0, B, 2):
            x, y = rows[c * B + k], rows[c * B + k + 1]
            for i in range(P):
                shape[c * P + i] = (shape[c * P + i] + x * basis[k * P + i]) + y * basis[(k + 1) * P + i]


@cython.cclass
class BeltMotion:
    """The modes beside n = 1 of W belts through time, under forces that are held between changes.

    In its own coordinates each mode goes to its steady state s under the force, w <- s + exp(mu h) (w - s), exactly
    over any length h. Steps of one speed and force make one interval; intervals wait, a bounded number of them, until
    the shape is wanted, and the one that is not over yet is never cut: when the shape is wanted changes nothing.

    Parameters
    ----------
    unit : TireWheelUnit
    model : {"inextensional", "complete"}
    n_max : int
    wheels : int
    psi : array_like, shape (P,)
        Angles fixed in space [rad] at which the shape is wanted.
    """

    # Per wheel, M = N K numbers side by side (K = 2 eigenvalues of each inextensional mode, 4 of each complete one),
    # real and imaginary parts in rows of their own. For K = 2 the layouts are those of mode_eigensystem; for K = 4,
    # right and left have a row for each element of the state x = (V_1, V_2, Z_1, Z_2).

    def __init__(self, unit: TireWheelUnit, model: Model, n_max: SupportsIndex, wheels: int, psi: ArrayLike) -> None:
        numbers = belt_numbers(n_max, model)
        basis = shape_basis(psi, numbers)
        self.wheels, self.points = wheels, basis.shape[1]
        self.complete = model == "complete"
        self.N, self.K = numbers.size, 4 if self.complete else 2
        self.M = self.N * self.K
        self.basis = np.ascontiguousarray(basis).reshape(-1).data
        self.numbers = numbers.astype(np.float64).data
        self.speed = zeros(wheels)
        self.own = zeros(2 * wheels * self.M)
        self.rate, self.frequency = zeros(wheels * self.M), zeros(wheels * self.M)
        self.steady = zeros(4 * wheels * self.M)
        rows = 8 if self.complete else 2  # of right
        self.right = zeros(rows * wheels * self.M)
        self.left = zeros((8 if self.complete else 4) * wheels * self.M)
        self.real, self.imaginary = zeros(self.M), zeros(self.M)
        self.shown = zeros(2 * self.M)
        self.rows = zeros(2 * (2 + 2 * self.N))
        self.shape = zeros(2 * self.points)
        self.room = _ROOM
        self.waiting = np.zeros(wheels, dtype=np.int64).data
        self.length = np.zeros(wheels * _ROOM, dtype=np.int64).data
        self.inputs = zeros(3 * wheels * _ROOM)
        self._set_modes(RingModes(unit, numbers, model))
        for wheel in range(wheels):
            self._eigensystem(wheel, 0.0)

    def _set_modes(self, modes: RingModes) -> None:
        self.modes = modes
        self.table = np.ascontiguousarray(modes.table).reshape(-1).data

    def set_unit(self, unit: TireWheelUnit) -> None:
        """Change the tires from now on. Positions and velocities go on as they are."""
        if unit == self.modes.unit:
            return
        states = [self._state_now(wheel) for wheel in range(self.wheels)]
        self._set_modes(RingModes(unit, self.modes.numbers, self.modes.model))
        for wheel, state in enumerate(states):
            self.waiting[wheel] = 0
            self._eigensystem(wheel, self.speed[wheel])
            self._put(wheel, self._own(wheel, state))

    def reset(self, index: int) -> None:
        """Be at rest."""
        check_wheel(index, self.wheels)
        self.waiting[index] = 0
        self._eigensystem(index, 0.0)
        self._put(index, np.zeros((2, self.N, self.K)))

    def start(self, index: int, speed: float, load: float, traction: float) -> None:
        """Be in the steady state of a constant speed [rad/s], load and traction [N]."""
        check_wheel(index, self.wheels)
        self.waiting[index] = 0
        if speed != self.speed[index]:
            self._eigensystem(index, speed)
        first, M = 4 * index * self.M, self.M
        steady = np.array(self.steady[first : first + 4 * M]).reshape(4, M)
        radial, tangential = -load, -traction
        self._put(index, steady[:2] * radial + steady[2:] * tangential)

    def _put(self, wheel: int, own: FloatArray) -> None:
        """Coordinates, real and imaginary parts."""
        for k, value in enumerate(own.reshape(-1).tolist(), 2 * wheel * self.M):
            self.own[k] = value

    def _eigensystem(self, wheel: int, speed: float) -> None:
        self.speed[wheel] = speed
        if not self.complete:
            mode_eigensystem(
                self.N, self.table, speed, wheel, self.rate, self.frequency, self.steady, self.right, self.left
            )
            return
        modes, M = self.modes.at(speed), self.M
        shapes = modes.steady_shapes()
        for target, rows in (
            (self.rate, [modes.exponents.real]),
            (self.frequency, [modes.exponents.imag]),
            (self.steady, [part for k in range(2) for part in (shapes[..., k].real, shapes[..., k].imag)]),
            (self.right, [part for k in range(4) for part in (modes.right[:, k].real, modes.right[:, k].imag)]),
            (self.left, [part for k in range(4) for part in (modes.left[..., k].real, modes.left[..., k].imag)]),
        ):
            values = np.concatenate([np.ascontiguousarray(row).reshape(-1) for row in rows])
            np.asarray(target)[wheel * len(rows) * M : (wheel + 1) * len(rows) * M] = values

    # -- time -----------------------------------------------------------------------------------------------

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def enqueue(
        self,
        wheel: cython.Py_ssize_t,
        length: cython.longlong,
        speed: cython.double,
        load: cython.double,
        traction: cython.double,
    ) -> cython.void:
        """Go on by a length [ns] under a speed, a load and a traction."""
        first: cython.Py_ssize_t = wheel * self.room
        last: cython.Py_ssize_t = first + self.waiting[wheel] - 1
        if (
            self.waiting[wheel]
            and self.inputs[3 * last] == speed
            and self.inputs[3 * last + 1] == load
            and self.inputs[3 * last + 2] == traction
        ):
            self.length[last] += length
            return
        if self.waiting[wheel] == self.room:
            self.advance_queue(wheel)
            last = first + self.waiting[wheel] - 1
        last += 1
        self.waiting[wheel] += 1
        self.length[last] = length
        self.inputs[3 * last] = speed
        self.inputs[3 * last + 1] = load
        self.inputs[3 * last + 2] = traction

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def advance_queue(self, wheel: cython.Py_ssize_t) -> cython.void:
        """Go through the intervals that are over, and to the beginning of the last."""
        first: cython.Py_ssize_t = wheel * self.room
        last: cython.Py_ssize_t = first + self.waiting[wheel] - 1
        entry: cython.Py_ssize_t
        k: cython.Py_ssize_t
        if not self.waiting[wheel]:
            return
        for entry in range(first, last + 1):
            if self.inputs[3 * entry] != self.speed[wheel]:
                self.change_speed(wheel, self.inputs[3 * entry])
            if entry < last:
                self.interval(wheel, entry, self.own, 2 * wheel * self.M)
        self.length[first] = self.length[last]
        for k in range(3):
            self.inputs[3 * first + k] = self.inputs[3 * last + k]
        self.waiting[wheel] = 1

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def change_speed(self, wheel: cython.Py_ssize_t, speed: cython.double) -> cython.void:
        """Change the speed at once: the Euler terms' integral makes the velocities jump."""
        M: cython.Py_ssize_t = self.M
        at: cython.Py_ssize_t = 2 * wheel * M
        i: cython.Py_ssize_t
        e: cython.Py_ssize_t
        before: cython.double = self.speed[wheel]
        # gamma depends on Omega^2; that of the mean square
        square: cython.double = (before * before + before * speed + speed * speed) / 3.0
        V: cython.double
        U: cython.double
        X: cython.double
        Y: cython.double
        twist: cython.double
        if self.complete:
            with cython.gil:
                self._change_speed_complete(wheel, speed)
            return
        for i in range(self.N):
            V = U = X = Y = 0.0
            for e in range(2 * i, 2 * i + 2):
                V += self.right[at + e] * self.own[at + e] - self.right[at + M + e] * self.own[at + M + e]
                U += self.right[at + e] * self.own[at + M + e] + self.right[at + M + e] * self.own[at + e]
                X += self.own[at + e]
                Y += self.own[at + M + e]
            # V - i gamma change Z
            twist = (speed - before) * twist_at(self.table, i, square)
            V, U = V + twist * Y, U - twist * X
            self.shown[4 * i], self.shown[4 * i + 1], self.shown[4 * i + 2], self.shown[4 * i + 3] = V, U, X, Y
        self.speed[wheel] = speed
        mode_eigensystem(
            self.N, self.table, speed, wheel, self.rate, self.frequency, self.steady, self.right, self.left
        )
        for i in range(self.N):
            V, U, X, Y = self.shown[4 * i], self.shown[4 * i + 1], self.shown[4 * i + 2], self.shown[4 * i + 3]
            for e in range(2 * i, 2 * i + 2):
                self.own[at + e] = (self.left[2 * at + e] * V - self.left[2 * at + M + e] * U) + (
                    self.left[2 * at + 2 * M + e] * X - self.left[2 * at + 3 * M + e] * Y
                )
                self.own[at + M + e] = (self.left[2 * at + e] * U + self.left[2 * at + M + e] * V) + (
                    self.left[2 * at + 2 * M + e] * Y + self.left[2 * at + 3 * M + e] * X
                )

    def _change_speed_complete(self, wheel: int, speed: float) -> None:
        real, imaginary = self._state(wheel)
        state = self.modes.change_speed(real + 1j * imaginary, self.speed[wheel], speed)
        self._eigensystem(wheel, speed)
        self._put(wheel, self._own(wheel, np.stack([state.real, state.imag])))

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def interval(
        self,
        wheel: cython.Py_ssize_t,
        entry: cython.Py_ssize_t,
        result: cython.double[::1],
        at: cython.Py_ssize_t,
    ) -> cython.void:
        """The coordinates behind an interval, into two rows of a buffer."""
        M: cython.Py_ssize_t = self.M
        own: cython.Py_ssize_t = 2 * wheel * M
        row: cython.Py_ssize_t = 4 * wheel * M
        e: cython.Py_ssize_t
        radial: cython.double = -self.inputs[3 * entry + 1]
        tangential: cython.double = -self.inputs[3 * entry + 2]
        p: cython.double
        q: cython.double
        a: cython.double
        b: cython.double
        grow(M, wheel * M, self.rate, self.frequency, self.length[entry] * 1e-9, self.real, self.imaginary)
        for e in range(M):
            p = self.steady[row + e] * radial + self.steady[row + 2 * M + e] * tangential
            q = self.steady[row + M + e] * radial + self.steady[row + 3 * M + e] * tangential
            a, b = self.own[own + e] - p, self.own[own + M + e] - q
            result[at + e] = p + (self.real[e] * a - self.imaginary[e] * b)
            result[at + M + e] = q + (self.real[e] * b + self.imaginary[e] * a)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def deflect(self, wheel: cython.Py_ssize_t, motion: Motion) -> cython.void:
        """The belt's deflection into ``shape``: radial at all points, then tangential."""
        N: cython.Py_ssize_t = self.N
        M: cython.Py_ssize_t = self.M
        B: cython.Py_ssize_t = 2 + 2 * self.N
        P: cython.Py_ssize_t = self.points
        i: cython.Py_ssize_t
        e: cython.Py_ssize_t
        k: cython.Py_ssize_t
        q: cython.Py_ssize_t = wheel * motion.states + motion.states // 2
        right: cython.Py_ssize_t = 8 * wheel * M
        a: cython.double
        b: cython.double
        x: cython.double
        y: cython.double
        u: cython.double
        v: cython.double
        up: cython.Py_ssize_t = q + (4 if self.complete else 2)
        # the n = 1 part, relative to the wheel's centre
        y = motion.state[up]
        x = 0.0 if motion.rigid else motion.state[up + 1]
        self.rows[0] = motion.state[q] - x
        self.rows[1] = motion.state[q + 1] - y
        self.rows[B] = (motion.state[q + 2] if self.complete else motion.state[q + 1]) - y
        self.rows[B + 1] = motion.state[q + 3] + x if self.complete else x - motion.state[q]
        self.advance_queue(wheel)
        if self.waiting[wheel]:
            self.interval(wheel, wheel * self.room, self.shown, 0)
        else:
            for e in range(2 * M):
                self.shown[e] = self.own[2 * wheel * M + e]
        for i in range(N):
            x = y = u = v = 0.0
            if self.complete:
                for e in range(4 * i, 4 * i + 4):
                    a, b = self.shown[e], self.shown[M + e]
                    k = right + 4 * M + e  # Z_1 of the eigenvector, then Z_2
                    x += self.right[k] * a - self.right[k + M] * b
                    y += self.right[k] * b + self.right[k + M] * a
                    u += self.right[k + 2 * M] * a - self.right[k + 3 * M] * b
                    v += self.right[k + 2 * M] * b + self.right[k + 3 * M] * a
            else:  # Z_2 = -i Z_1/n
                x = self.shown[2 * i] + self.shown[2 * i + 1]
                y = self.shown[M + 2 * i] + self.shown[M + 2 * i + 1]
                u = y / self.numbers[i]
                v = -x / self.numbers[i]
            self.rows[2 + i], self.rows[2 + N + i] = x, y
            self.rows[B + 2 + i], self.rows[B + 2 + N + i] = u, v
        _combine(self.rows, self.basis, self.shape, B, P)

    # -- what can be read -----------------------------------------------------------------------------------

    def advance(self, index: int, length: int, speed: float, load: float, traction: float = 0.0) -> None:
        """Go on by a length [ns] under a speed [rad/s], a load and a traction [N] that are held."""
        check_wheel(index, self.wheels)
        self.enqueue(index, length, speed, load, traction)

    def deflection(self, index: int, motion: Motion) -> FloatArray:
        """Radial and tangential deflection relative to the wheel centre [m], shape (2, P), with the n = 1 motion."""
        check_wheel(index, self.wheels)
        self.deflect(index, motion)
        return np.array(self.shape[: 2 * self.points]).reshape(2, -1)

    def state_of(self, index: int) -> NDArray[np.complex128]:
        """The state x of one belt now, shape (N, K): V, Z, or V_1, V_2, Z_1, Z_2."""
        check_wheel(index, self.wheels)
        real, imaginary = self._state_now(index)
        return real + 1j * imaginary

    # Real and imaginary parts along the first axis: NumPy's own complex products may or may not be fused.

    def _state_now(self, wheel: int) -> FloatArray:
        """The state x, shape (2, N, K)."""
        self.advance_queue(wheel)
        if not self.waiting[wheel]:
            return self._state(wheel)
        self.interval(wheel, wheel * self.room, self.shown, 0)
        return self._with_right(wheel, np.array(self.shown[: 2 * self.M]).reshape(2, self.N, self.K))

    def _state(self, wheel: int) -> FloatArray:
        """The same at the beginning of the interval."""
        own = np.array(self.own[2 * wheel * self.M : 2 * (wheel + 1) * self.M])
        return self._with_right(wheel, own.reshape(2, self.N, self.K))

    def _with_right(self, wheel: int, own: FloatArray) -> FloatArray:
        rows = 8 if self.complete else 2
        right = np.array(self.right[rows * wheel * self.M : rows * (wheel + 1) * self.M]).reshape(-1, 2, self.N, self.K)
        elements = [_sum_of_products(row, own) for row in right]
        if not self.complete:  # its last row is one
            elements.append(_sum(own))
        return np.stack(elements, axis=-1)

    def _own(self, wheel: int, state: FloatArray) -> FloatArray:
        rows = 8 if self.complete else 4
        left = np.array(self.left[rows * wheel * self.M : rows * (wheel + 1) * self.M]).reshape(-1, 2, self.N, self.K)
        products = [_product(column, state[..., k : k + 1]) for k, column in enumerate(left)]
        total = products[0]
        for product in products[1:]:
            total = total + product
        return total

    def snapshot(self, index: int) -> dict[str, Any]:
        """Everything of a wheel that later results depend on, in JSON's types."""
        check_wheel(index, self.wheels)
        self.advance_queue(index)
        first, M = index * self.room, self.M
        own = np.array(self.own[2 * index * M : 2 * (index + 1) * M]).reshape(2, self.N, self.K)
        inputs = [float(self.inputs[3 * first + k]) for k in range(3)]
        return {
            "speed": float(self.speed[index]),
            "own": own.tolist(),
            "interval": [int(self.length[first]), *inputs] if self.waiting[index] else None,
        }

    def restore(self, index: int, snapshot: Mapping[str, Any]) -> None:
        """Take over a :meth:`snapshot`."""
        check_wheel(index, self.wheels)
        own = np.array(snapshot["own"], dtype=np.float64)
        expected = (2, self.N, self.K)
        if own.shape != expected:
            raise ValueError(f"the belt's state has shape {own.shape}; it must be {expected}")
        self.waiting[index] = 0
        self._eigensystem(index, float(snapshot["speed"]))
        self._put(index, own)
        if snapshot["interval"] is not None:
            length, speed, load, traction = snapshot["interval"]
            self.enqueue(index, int(length), float(speed), float(load), float(traction))


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of complex numbers by their parts, (2, ...)."""
    return np.stack([a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]])


def _sum(a: FloatArray) -> FloatArray:
    """Sums over the last axis of three, in order."""
    total = a[..., 0]
    for k in range(1, a.shape[2]):
        total = total + a[..., k]
    return total


def _sum_of_products(a: FloatArray, b: FloatArray) -> FloatArray:
    return _sum(_product(a, b))
