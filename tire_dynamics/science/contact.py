"""The tire on the road at constant speed: everything that is linear while the contact lasts.

The belt, the wheel and what stands on the suspension are one system in the fixed frame,

    z' = A z + push F + traction F_x,      u_c = contact z,

driven by the contact force F (up, on the tire). u_c is the belt's radial displacement at the road, outward, its mean
over the patch; with the road's height r the residual spring is compressed by delta = r + u_c, and F = k_c delta +
c_c delta'. So with H(s) = contact (s - A)^-1 push,

    F = r / (1/(k_c + c_c s) - H(s)),      A_contact = A + push (k_c contact + c_c contact A),

as contact push = 0: a force moves no place at once. A rigid tread, k_c infinite, holds u_c = -r: two states fewer.
docs/model.md, section 11, derives it. z has the states of ``wheel.fixed_frame``, then [b', b] of a sprung mass, then,
of each belt harmonic, the real parts of (V, Z) and their imaginary parts (``modes``); of n = 0, which has none, the
real ones.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import floquet, wheel
from .coefficients import coefficients, contact_patch_factor, mode_damping, residual_stiffness, twist
from .floquet import FloquetResult
from .unit import TireWheelUnit

__all__ = [
    "ContactSystem",
    "belt_numbers",
    "open_system",
]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


class ContactSystem(NamedTuple):
    """The system of the module's notes at one speed, n states.

    Attributes
    ----------
    matrix : ndarray, shape (n, n)
        A [1/s], without the contact's spring.
    push, traction : ndarray, shape (n,)
        What a contact force of 1 N, up, and a traction of 1 N, along x_ros, do to z'.
    weight : ndarray, shape (n,)
        What a weight of 1 N on the sprung mass does to z'; zero where the body is held.
    contact : ndarray, shape (n,)
        u_c = contact z [m].
    output : ndarray, shape (2, n)
        Axle force [x_ros, z_ros] = output z [N].
    stiffness, damping : float
        k_c [N/m], infinite where the tread is rigid, and c_c [N s/m].
    """

    matrix: FloatArray
    push: FloatArray
    traction: FloatArray
    weight: FloatArray
    contact: FloatArray
    output: FloatArray
    stiffness: float
    damping: float

    @property
    def rate(self) -> FloatArray:
        """u_c' = rate z [m/s]."""
        return self.contact @ self.matrix

    def closed(self) -> FloatArray:
        """A_contact [1/s], shape (n, n); for a rigid tread (n - 2, n - 2), on the states that u_c = u_c' = 0 leaves."""
        if math.isfinite(self.stiffness):
            feedback = self.stiffness * self.contact + self.damping * self.rate
            return self.matrix + np.outer(self.push, feedback)
        rate = self.rate
        held = self.matrix - np.outer(self.push, rate @ self.matrix) / (rate @ self.push)
        basis = _complement(np.stack([self.contact / np.abs(self.contact).max(), rate / np.abs(rate).max()]), held)
        return np.asarray(basis.T @ held @ basis)


def _complement(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    """An orthonormal basis, shape (n, n - k), of what k rows send to zero."""
    _, _, right = np.linalg.svd(rows)
    basis: FloatArray = right[len(rows) :].T
    return basis


def belt_numbers(model: wheel.Model, n_max: int) -> FloatArray:
    """The belt harmonics beside n = 1: 2 to n_max, and 0 of the complete model."""
    if isinstance(n_max, bool) or not isinstance(n_max, (int, np.integer)) or n_max < 1:
        raise ValueError(f"n_max is {n_max!r}; it must be an integer >= 1")
    numbers = np.arange(2.0, n_max + 1.0)
    return np.concatenate([[0.0], numbers]) if model == "complete" else numbers


def belt_matrices(
    unit: TireWheelUnit, numbers: FloatArray, speed: float, model: wheel.Model
) -> tuple[ComplexArray, ComplexArray]:
    """x' = M x + drive [f_r, f_t] of each harmonic's x = (V, Z), shapes (N, k, k) and (N, k, 2); ``modes`` has it."""
    n, d = numbers, mode_damping(unit, numbers, model)
    A, B, C, determinant = coefficients(unit, n, speed)
    mass = math.pi * unit.radius * unit.width * unit.surface_density * np.where(n == 0.0, 2.0, 1.0)
    turned = np.array([1.0, -1.0j, -1.0, 1.0j])[np.mod(n, 4.0).astype(int)]  # exp(i n psi_0)
    force = contact_patch_factor(unit, n) * turned / mass
    k = 4 if model == "complete" else 2
    M = np.zeros((n.size, k, k), dtype=np.complex128)
    drive = np.zeros((n.size, k, 2), dtype=np.complex128)
    if model == "complete":
        M[:, 0, 0] = M[:, 1, 1] = 1j * n * speed - d
        M[:, 0, 1], M[:, 1, 0] = 2.0 * speed, -2.0 * speed
        M[:, 0, 2], M[:, 0, 3] = -B, 1j * A
        M[:, 1, 2], M[:, 1, 3] = -1j * A, -C
        M[:, 2, 0] = M[:, 3, 1] = 1.0
        M[:, 2, 2] = M[:, 3, 3] = 1j * n * speed
        drive[:, 0, 0] = drive[:, 1, 1] = force
    else:
        through = A + n * C
        M[:, 0, 0] = 1j * n * speed - d - 2j * twist(n, A, C) * speed
        M[:, 0, 1] = -n * determinant / through
        M[:, 1, 0] = 1.0
        M[:, 1, 1] = 1j * n * speed
        drive[:, 0, 0] = n * C / through * force
        drive[:, 0, 1] = 1j * n * A / through * force
    return M, drive


def open_system(
    unit: TireWheelUnit, speed: float, model: wheel.Model = "inextensional", n_max: int = 30
) -> ContactSystem:
    """The system of the module's notes; of a unit that is not uniform, its mean's.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign.
    model : {"inextensional", "complete"}
    n_max : int
        Highest belt harmonic, >= 1.

    Returns
    -------
    ContactSystem

    Raises
    ------
    ValueError
        An argument is out of its bounds, or the unit's ``vertical_stiffness`` is not below the tire's own.
    """
    if not math.isfinite(speed):
        raise ValueError(f"speed is {speed!r}; it must be finite")
    numbers = belt_numbers(model, n_max)
    frame = wheel.fixed_frame(unit, model)
    one, half = len(frame.constant), len(frame.constant) // 2
    M, drive = belt_matrices(unit, numbers, speed, model)
    k = M.shape[1] if numbers.size else 0
    sprung = 2 if unit.sprung_mass else 0
    sizes = [k if n == 0.0 else 2 * k for n in numbers]
    total = one + sprung + sum(sizes)
    A = np.zeros((total, total))
    push, traction, weight, contact = np.zeros((4, total))
    output = np.zeros((2, total))
    A[:one, :one] = frame.constant + speed * frame.spin
    push[:one], traction[:one] = frame.input.T
    output[:, :one] = frame.output + speed * frame.output_spin
    contact[half + 1] = -1.0  # Y
    y = half + (2 if model == "inextensional" else 4)
    if sprung:
        body = one + 1
        k_s, c_s, M_w, m_b = unit.suspension_stiffness, unit.suspension_damping, unit.wheel_mass, unit.sprung_mass
        A[y - half, [one, body]] = c_s / M_w, k_s / M_w
        A[one, [y - half, y, one, body]] = c_s / m_b, k_s / m_b, -c_s / m_b, -k_s / m_b
        A[body, one] = 1.0
        output[1, [one, body]] = -c_s, -k_s
        weight[one] = -1.0 / m_b
    first = one + sprung
    factors = contact_patch_factor(unit, numbers)
    for n, matrix, forces, factor, size in zip(numbers.tolist(), M, drive, factors, sizes, strict=True):
        place = slice(first, first + size)
        toward = np.array([1.0, -1.0j, -1.0, 1.0j])[int(n) % 4] * factor  # u_n = Re[conj(Z) exp(i n psi_0)]
        radial = k // 2  # Z_1 among (V, Z)
        if size == k:
            A[place, place] = matrix.real
            push[place], traction[place] = -forces[:, 0].real, -forces[:, 1].real
            contact[first + radial] = factor
        else:
            A[place, place] = np.block([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]])
            push[place] = np.concatenate([-forces[:, 0].real, -forces[:, 0].imag])
            traction[place] = np.concatenate([-forces[:, 1].real, -forces[:, 1].imag])
            contact[first + radial], contact[first + k + radial] = toward.real, toward.imag
        first += size
    stiffness = residual_stiffness(unit, int(n_max), model)
    return ContactSystem(A, push, traction, weight, contact, output, stiffness, unit.residual_damping)
