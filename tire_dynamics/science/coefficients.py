"""Stiffness and damping coefficients of the ring's modes, (3.5) of Huang & Hsu (1992)."""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .elementary import cos_sin

__all__ = [
    "Coefficients",
    "Model",
    "RingUnit",
    "coefficients",
    "constants",
    "contact_patch_factor",
    "formula",
    "mode_damping",
    "residual_stiffness",
    "rest_frequency",
    "speed_polynomials",
    "static_compliance",
    "twist",
]

Model = Literal["complete", "inextensional", "hybrid"]
FloatArray = NDArray[np.float64]


class RingUnit(Protocol):
    """What is taken here of a :class:`.TireWheelUnit`, which itself asks for its stiffness on the road."""

    @property
    def radius(self) -> float: ...

    @property
    def width(self) -> float: ...

    @property
    def surface_density(self) -> float: ...

    @property
    def bending_stiffness(self) -> float: ...

    @property
    def membrane_stiffness(self) -> float: ...

    @property
    def inflation_pressure(self) -> float: ...

    @property
    def radial_stiffness(self) -> float: ...

    @property
    def tangential_stiffness(self) -> float: ...

    @property
    def sidewall_stiffness(self) -> float: ...

    @property
    def rigid_mode_frequency(self) -> float: ...

    @property
    def zeta_1(self) -> float: ...

    @property
    def zeta_n(self) -> float: ...

    @property
    def contact_half_angle(self) -> float: ...

    @property
    def vertical_stiffness(self) -> float: ...


class Coefficients(NamedTuple):
    """A_n, B_n, C_n of (3.5) [1/s^2] and their combination B C - A^2 [1/s^4], which loses its digits if formed late."""

    coupling: FloatArray
    radial: FloatArray
    tangential: FloatArray
    determinant: FloatArray


def coefficients(unit: RingUnit, n: ArrayLike, speed: float | FloatArray = 0.0) -> Coefficients:
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


def constants(unit: RingUnit) -> tuple[float, float, float, float, float]:
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


def rest_frequency(unit: RingUnit, n: ArrayLike, model: Model = "inextensional") -> FloatArray:
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


def mode_damping(unit: RingUnit, n: ArrayLike, model: Model = "inextensional") -> FloatArray:
    """d_n = lambda_n/(rho h) = 2 zeta_n omega_n [1/s]; zeta_1 for n = 1."""
    number = np.asarray(n)
    zeta = np.where(number == 1, unit.zeta_1, unit.zeta_n)
    return np.asarray(2.0 * zeta * rest_frequency(unit, number, model))


def contact_patch_factor(unit: RingUnit, n: ArrayLike) -> FloatArray:
    """s_n = sin(n phi_c)/(n sin phi_c): what harmonic n feels of a contact force that is spread over the patch.

    Parameters
    ----------
    unit : TireWheelUnit
        Its ``contact_half_angle`` is phi_c; 0 is a point, for which every factor is 1.
    n : array_like of int
        Circumferential wavenumbers, >= 0.

    Returns
    -------
    ndarray, the shape of n
        With the same bits on every machine. s_1 = 1: a pressure that is even over the patch, and whose vertical
        resultant is the load, drives n = 1 with the whole load. s_0 = phi_c/sin(phi_c). The mean over the patch of a
        harmonic's displacement, weighed as the pressure is, has the same factor: the contact gives what it takes.
    """
    numbers = np.asarray(n, dtype=np.float64)
    half = unit.contact_half_angle
    if half == 0.0:
        return np.ones_like(numbers)
    zero = numbers == 0.0
    sines = np.where(zero, half, cos_sin(numbers * half)[1])
    factors: FloatArray = sines / np.where(zero, 1.0, numbers) / float(cos_sin(half)[1])
    return np.where(numbers == 1.0, 1.0, factors)


def static_compliance(unit: RingUnit, n_max: int, model: Model = "inextensional") -> float:
    """How far the contact gives way under 1 N, mean over the patch, at rest with the wheel held [m/N].

    Parameters
    ----------
    unit : TireWheelUnit
    n_max : int
        Highest wavenumber, >= 1.
    model : {"inextensional", "complete"}
        Of the inextensional model 1/k_1 + sum_{n=2}^{n_max} s_n^2 C_n/(pi a b rho h (B_n C_n - A_n^2)), which has the
        complete model's deflection by n >= 2, (4.5); the complete one has n = 0 and its own n = 1 beside.
    """
    mass = math.pi * unit.radius * unit.width * unit.surface_density
    numbers = np.arange(0 if model == "complete" else 2, n_max + 1)
    _, B, C, determinant = coefficients(unit, numbers)
    factors = contact_patch_factor(unit, numbers)
    each = factors * factors * C / (mass * determinant)
    total = 0.0 if model == "complete" else 1.0 / unit.sidewall_stiffness
    for k, n in enumerate(numbers.tolist()):  # in order, for the same bits everywhere
        total += float(each[k]) if n else float(factors[0] * factors[0]) / (2.0 * mass * float(B[0]))
    return total


def residual_stiffness(unit: RingUnit, n_max: int = 30, model: Model = "inextensional") -> float:
    """Stiffness of the residual spring between belt and road, k_c [N/m].

    Parameters
    ----------
    unit : TireWheelUnit
    n_max : int
        Highest wavenumber of the belt, >= 1; what higher ones would give way is in this spring.
    model : {"inextensional", "complete"}

    Returns
    -------
    float
        1/(1/K_v - :func:`static_compliance`), K_v the unit's ``vertical_stiffness``; infinite where that is 0.

    Raises
    ------
    ValueError
        ``n_max`` is out of its bounds, or K_v is not below the tire's own stiffness to this n_max.
    """
    if isinstance(n_max, bool) or not isinstance(n_max, (int, np.integer)) or n_max < 1:
        raise ValueError(f"n_max is {n_max!r}; it must be an integer >= 1")
    if not unit.vertical_stiffness:
        return math.inf
    own = static_compliance(unit, int(n_max), model)
    left = 1.0 / unit.vertical_stiffness - own
    if not left > 0.0:
        raise ValueError(
            f"vertical_stiffness is {unit.vertical_stiffness!r}; it must be < {1.0 / own:.10g} N/m, the tire's own to "
            f"n_max = {n_max} ({model})"
        )
    return 1.0 / left
