"""Stiffness and damping coefficients of the ring's modes, (3.5) of Huang & Hsu (1992)."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .unit import TireWheelUnit

__all__ = [
    "Coefficients",
    "Model",
    "coefficients",
    "constants",
    "formula",
    "mode_damping",
    "rest_frequency",
    "speed_polynomials",
    "twist",
]

Model = Literal["complete", "inextensional", "hybrid"]
FloatArray = NDArray[np.float64]


class Coefficients(NamedTuple):
    """A_n, B_n, C_n of (3.5) [1/s^2] and their combination B C - A^2 [1/s^4], which loses its digits if formed late."""

    coupling: FloatArray
    radial: FloatArray
    tangential: FloatArray
    determinant: FloatArray


def coefficients(unit: TireWheelUnit, n: ArrayLike, speed: float | FloatArray = 0.0) -> Coefficients:
    """Stiffness coefficients A_n, B_n, C_n of (3.5a-c).

    Parameters
    ----------
    unit : TireWheelUnit
    n : array_like of int
        Circumferential wavenumbers.
    speed : float or ndarray
        Spin Omega [rad/s]; broadcast against n.

    Notes
    -----
    The membrane terms b = K/(a^2 rho h) are kept apart from the rest, written with a tilde:
    B C - A^2 = b (C~ + n^2 B~ - 2 n A~) + B~ C~ - A~^2. The product b^2 has cancelled, and no digits with it.
    """
    return Coefficients(*formula(constants(unit), np.asarray(n, dtype=np.float64), speed))


def constants(unit: TireWheelUnit) -> tuple[float, float, float, float, float]:
    """What (3.5) takes of a unit: bending, membrane, pressure, k_z and k_theta, each over rho h [1/s^2]."""
    mass = unit.surface_density
    return (
        unit.bending_stiffness / (unit.radius * unit.radius * unit.radius * unit.radius) / mass,
        unit.membrane_stiffness / (unit.radius * unit.radius) / mass,
        unit.inflation_pressure / unit.radius / mass,
        unit.radial_stiffness / mass,
        unit.tangential_stiffness / mass,
    )


def formula(constants: tuple[float, float, float, float, float], number: Any, speed: Any) -> tuple[Any, Any, Any, Any]:
    """(3.5) of numbers or arrays: A_n, B_n, C_n and B_n C_n - A_n^2."""
    (A, A_1), (B, B_1), (C, C_1), (D, D_1, D_2) = speed_polynomials(constants, number)
    square = speed * speed
    return A + square * A_1, B + square * B_1, C + square * C_1, D + square * (D_1 + square * D_2)


def speed_polynomials(constants: tuple[float, float, float, float, float], number: Any) -> tuple[tuple[Any, ...], ...]:
    """(3.5) by powers of Omega^2: (A, A_1), (B, B_1), (C, C_1) and (D, D_1, D_2) of B_n C_n - A_n^2."""
    bending, membrane, pressure, radial_stiffness, tangential_stiffness = constants
    square = number * number
    # p_0/(rho h a), the static part of the hoop tension over rho h, is the same number as the pressure's
    A = number * square * bending + 2.0 * number * pressure
    B = square * square * bending + radial_stiffness + pressure + square * pressure
    C = square * bending + tangential_stiffness + pressure + square * pressure
    D = membrane * (C + square * B - 2.0 * number * A) + (B * C - A * A)
    D_1 = membrane * square * (square - 3.0) + (square * (B + C) - 4.0 * number * A)
    D_2 = square * (square - 4.0)
    return (
        (A + number * membrane, 2.0 * number),
        (B + membrane, square),
        (C + square * membrane, square),
        (D, D_1, D_2),
    )


def twist(number: Any, coupling: Any, tangential: Any) -> Any:
    """gamma_n = (C + n A)/(A + n C), the share of the Coriolis term that is left without stretching."""
    return (tangential + number * coupling) / (coupling + number * tangential)


def rest_frequency(unit: TireWheelUnit, n: ArrayLike, model: Model = "inextensional") -> FloatArray:
    """omega_n [rad/s], the frequency of mode n at rest with the wheel held, that the damping ratio refers to.

    Of the complete model's two frequencies, the lower.
    """
    number = np.asarray(n, dtype=np.float64)
    A, B, C, determinant = coefficients(unit, number)
    if model == "complete":
        upper = 0.5 * (B + C) + np.sqrt(0.25 * (B - C) * (B - C) + A * A)
        return np.asarray(np.sqrt(determinant / upper))
    # n = 1 follows (3.13), where the paper's elimination leaves kappa = k_1/m
    return np.asarray(
        np.where(number == 1.0, unit.rigid_mode_frequency, np.sqrt(number * determinant / (A + number * C)))
    )


def mode_damping(unit: TireWheelUnit, n: ArrayLike, model: Model = "inextensional") -> FloatArray:
    """d_n = lambda_n/(rho h) = 2 zeta_n omega_n [1/s]; zeta_1 for n = 1."""
    number = np.asarray(n)
    zeta = np.where(number == 1, unit.zeta_1, unit.zeta_n)
    return np.asarray(2.0 * zeta * rest_frequency(unit, number, model))
