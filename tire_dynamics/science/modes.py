"""The ring's modes in the fixed frame, driven by a point force, and their exact steps.

A mode is carried as complex amplitudes Z = z exp(i n phi) of z = alpha + i beta (radial, z_1) and xi + i eta
(tangential, z_2); u_z = Re[conj(Z_1) exp(i n psi)], u_theta = Re[conj(Z_2) exp(i n psi)]. With the velocities seen from
the ring, V = z' exp(i n phi), the equations (3.2), (3.10) and (3.11) have constant coefficients at constant speed:

    Z' = V + i n Omega Z
    complete       V_1' = (i n Omega - d) V_1 + 2 Omega V_2 - B Z_1 + i A Z_2 + q_1
                   V_2' = (i n Omega - d) V_2 - 2 Omega V_1 - C Z_2 - i A Z_1 + q_2
    inextensional  V'   = (i n Omega - d - 2 i gamma Omega) V - g Z + q,     Z_2 = -i Z_1/n

with gamma = (C + n A)/(A + n C) and g = n (B C - A^2)/(A + n C); the hybrid model is the last one without gamma.
Where Omega varies, V_1' and V_2' have Euler terms, Omega' Z_2 and -Omega' (Z_1 + a [n = 0]), and the inextensional V'
has -i gamma Omega' Z: docs/model.md derives them. A speed that is held over each step changes in jumps, which the
Euler terms turn into jumps of V.
"""

from __future__ import annotations

import cmath
import math
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .coefficients import (
    Model,
    coefficients,
    constants,
    contact_patch_factor,
    mode_damping,
    speed_polynomials,
    twist,
)
from .eigensystem import eigensystems
from .mode_series import mode_steps
from .stepping import Steps
from .unit import TireWheelUnit

__all__ = ["CONTACT_ANGLE", "RingModes", "SpinningModes"]

CONTACT_ANGLE = 1.5 * math.pi
"""psi_0, where the road is."""

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]


class RingModes:
    """Modes n of the ring with the wheel held, under a force at one angle fixed in space.

    Parameters
    ----------
    unit : TireWheelUnit
    numbers : array_like of int, shape (N,)
        Wavenumbers; n >= 0 for "complete", n >= 2 for the others.
    model : {"complete", "inextensional", "hybrid"}
    angle : float
        Where the force acts, psi [rad].
    """

    def __init__(
        self,
        unit: TireWheelUnit,
        numbers: ArrayLike,
        model: Model = "inextensional",
        angle: float = CONTACT_ANGLE,
    ) -> None:
        self.unit = unit
        self.model = model
        self.numbers = np.atleast_1d(np.asarray(numbers, dtype=np.float64))
        lowest = 0 if model == "complete" else 2  # for n = 1 the paper's elimination does not hold: wheel.py
        if model not in get_args(Model):
            raise ValueError(f"model is {model!r}; it must be one of {', '.join(get_args(Model))}")
        if not (self.numbers == np.round(self.numbers)).all() or not (self.numbers >= lowest).all():
            raise ValueError(f"numbers is {numbers!r}; model {model!r} needs integers >= {lowest}")
        self.damping = mode_damping(unit, self.numbers, "complete" if model == "complete" else "inextensional")
        modal_mass = math.pi * unit.radius * unit.width * unit.surface_density * np.where(self.numbers == 0, 2.0, 1.0)
        spread = contact_patch_factor(unit, self.numbers)
        if angle == CONTACT_ANGLE:  # exactly (-i)^n
            turned = np.array([1.0, -1.0j, -1.0, 1.0j])[np.mod(self.numbers, 4.0).astype(int)]
        else:
            turned = np.array([cmath.exp(1j * n * angle) for n in self.numbers])
        self._force = spread * turned / modal_mass
        (A, A_1), B, (C, C_1), D = speed_polynomials(constants(unit), self.numbers)
        ones = np.ones_like(self.numbers)
        columns = [self.numbers, self.damping, self._force.real, self._force.imag, A, A_1, C, C_1, *D]
        self.table = np.stack([column * ones for column in (*columns, 0.0 if model == "hybrid" else 1.0, *B)], axis=1)
        """What :mod:`.eigensystem` takes of the modes, shape (N, COLUMNS)."""

    def at(self, speed: float) -> SpinningModes:
        """The modes at a constant speed [rad/s]."""
        if self.model == "complete":
            return self._complete(speed)
        exponents, steady, right, left = eigensystems(self.table, speed)
        return SpinningModes(speed, exponents, right, left, -exponents[..., None] * steady)

    def _complete(self, speed: float) -> SpinningModes:
        A, B, C, _ = coefficients(self.unit, self.numbers, speed)
        n, d = self.numbers, self.damping
        M = np.zeros((n.size, 4, 4), dtype=np.complex128)
        M[:, 0, 0] = M[:, 1, 1] = 1j * n * speed - d
        M[:, 0, 1], M[:, 1, 0] = 2.0 * speed, -2.0 * speed
        M[:, 0, 2], M[:, 0, 3] = -B, 1j * A
        M[:, 1, 2], M[:, 1, 3] = -1j * A, -C
        M[:, 2, 0] = M[:, 3, 1] = 1.0
        M[:, 2, 2] = M[:, 3, 3] = 1j * n * speed
        size = np.sqrt(np.maximum(B, C))  # velocities beside displacements
        scale = np.stack([size, size, np.ones_like(size), np.ones_like(size)], axis=1)
        try:
            roots, right = np.linalg.eig(M * scale[:, None, :] / scale[:, :, None])
            left = np.linalg.inv(right)
        except np.linalg.LinAlgError:  # no finite matrix, or none that can be inverted: a unit that is no tire
            roots, right, left = (np.full(shape, math.nan + 0j) for shape in (M.shape[:2], M.shape, M.shape))
        drive = np.zeros((n.size, 4, 2), dtype=np.complex128)
        drive[:, 0, 0] = drive[:, 1, 1] = self._force
        left = left / scale[:, None, :]
        return SpinningModes(speed, roots, right * scale[:, :, None], left, left @ drive)

    def change_speed(self, state: ComplexArray, before: float, after: float) -> ComplexArray:
        """The state after a jump of the speed [rad/s]: the Euler terms' integral over it."""
        change = after - before
        if change == 0.0:
            return state
        jumped = state.copy()
        if self.model == "complete":
            jumped[..., 0] += change * state[..., 3]
            jumped[..., 1] -= change * (state[..., 2] + self.unit.radius * (self.numbers == 0.0))
        else:
            mean_square = (before * before + before * after + after * after) / 3.0  # gamma depends on Omega^2
            middle = coefficients(self.unit, self.numbers, math.sqrt(mean_square))
            jumped[..., 0] -= 1j * change * self._gamma(middle.coupling, middle.tangential) * state[..., 1]
        return jumped

    def _gamma(self, A: FloatArray, C: FloatArray) -> FloatArray:
        if self.model == "hybrid":
            return np.zeros_like(A)
        gamma: FloatArray = twist(self.numbers, A, C)
        return gamma

    def integrate(self, steps: Steps, force: FloatArray, *, steady: bool) -> ComplexArray:
        """States at the N samples between which the steps lie, shape (N, modes, k).

        Parameters
        ----------
        steps : Steps
        force : ndarray, shape (N, 2)
            f_r (outward), f_t (along increasing psi) at the samples [N], linear in between.
        steady : bool
            Start in the steady state of the first sample, otherwise at rest.
        """
        speed = float(steps.speeds[0])
        spinning = self.at(speed)
        state = spinning.steady(force[0, 0], force[0, 1])
        if not steady:
            state = np.zeros_like(state)
        states = np.empty((steps.count + 1, *state.shape), dtype=np.complex128)
        states[0] = state
        for k, length in enumerate(steps.lengths.tolist()):
            speed, change = float(steps.speeds[k]), float(steps.speeds[k + 1] - steps.speeds[k])
            push = force[k + 1] - force[k]
            if change != 0.0:
                state = mode_steps(self.table, state, length, speed, change, force[k], push, self.unit.radius)
            else:
                if speed != spinning.speed:
                    spinning = self.at(speed)
                state = spinning.step(state, length, force[k], push)
            states[k + 1] = state
        return states

    def amplitudes(self, state: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Z_1 and Z_2, shape (..., N), of states of shape (..., N, k) [m]."""
        if self.model == "complete":
            return state[..., 2], state[..., 3]
        return state[..., 1], -1j * state[..., 1] / self.numbers


class SpinningModes:
    """Modes at one constant speed, by their eigenvalues: L x' = diag(mu) L x + drive [f_r, f_t].

    Attributes
    ----------
    exponents : ndarray of complex, shape (N, k)
        mu [1/s], in the fixed frame; k = 4 for the complete model, 2 otherwise.
    right, left : ndarray of complex, shape (N, k, k)
        Columns of R are the eigenvectors in the state (V, Z); L is its inverse.

    ``drive`` is that in the modes' own coordinates, (N, k, 2).
    """

    def __init__(
        self, speed: float, exponents: ComplexArray, right: ComplexArray, left: ComplexArray, drive: ComplexArray
    ) -> None:
        self.speed = speed
        self.exponents, self.right, self.left = exponents, right, left
        self._drive = drive
        self._length = -1.0
        self._factors: tuple[ComplexArray, ComplexArray, ComplexArray]

    def steady(self, radial: float, tangential: float) -> ComplexArray:
        """The state, shape (N, k), in which a constant force [N] at constant speed leaves the modes."""
        force = self._drive @ np.array([radial, tangential])
        state: ComplexArray = (self.right @ (-force / self.exponents)[..., None])[..., 0]
        return state

    def steady_shapes(self) -> ComplexArray:
        """-b/mu: what a constant force of 1 N leaves in the modes' own coordinates, shape (N, k, 2)."""
        shapes: ComplexArray = -self._drive / self.exponents[..., None]
        return shapes

    def step(self, state: ComplexArray, length: float, force: FloatArray, change: FloatArray) -> ComplexArray:
        """The state after a step [s] over which the force [f_r, f_t] [N] changes linearly by ``change``.

        Exact: with x = mu h, each mode's own coordinate becomes
        e^x c + h phi_1(x) b f + h phi_2(x) b df, phi_1 = (e^x - 1)/x, phi_2 = (phi_1 - 1)/x.
        """
        if length != self._length:
            x = self.exponents * length
            growth: ComplexArray = np.exp(x)
            first: ComplexArray = np.where(np.abs(x) < 0.5, _series(x, 1), (growth - 1.0) / np.where(x == 0.0, 1.0, x))
            second: ComplexArray = np.where(np.abs(x) < 0.5, _series(x, 2), (first - 1.0) / np.where(x == 0.0, 1.0, x))
            self._factors = growth, length * first, length * second
            self._length = length
        growth, first, second = self._factors
        own = growth * (self.left @ state[..., None])[..., 0]
        own += first * (self._drive @ force) + second * (self._drive @ change)
        after: ComplexArray = (self.right @ own[..., None])[..., 0]
        return after


def _series(x: ComplexArray, order: int) -> ComplexArray:
    """phi_order(x) = sum_j x^j/(j + order)! for small x, where the closed form cancels."""
    total = np.zeros_like(x)
    for j in reversed(range(1, 16)):
        total = (total + 1.0) * x / (j + order)
    result: ComplexArray = (total + 1.0) / math.factorial(order)
    return result
