"""The flexible ring: stiffness coefficients, natural frequencies, steady response.

Equation numbers are those of Huang & Hsu (1992). ``theta`` is fixed to the ring, ``psi = theta + int Omega dt``
is fixed in space; ``psi = 0`` points along the paper's horizontal axis X (which is -x of REP 103),
``psi = pi/2`` up, and the contact is at ``psi_0 = 3 pi/2``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .coefficients import Coefficients, Model, coefficients, mode_damping, rest_frequency
from .unit import TireWheelUnit

__all__ = [
    "CONTACT_ANGLE",
    "Coefficients",
    "coefficients",
    "mode_damping",
    "natural_frequencies",
    "rest_frequency",
    "steady_amplitudes",
    "steady_response",
]

CONTACT_ANGLE = 1.5 * math.pi
"""psi_0, where the road is."""

FloatArray = NDArray[np.float64]


def natural_frequencies(unit: TireWheelUnit, n: int, speed: float = 0.0, model: Model = "complete") -> FloatArray:
    """Undamped natural frequencies of the ring with the wheel held, in the ring-fixed frame.

    Parameters
    ----------
    unit : TireWheelUnit
    n : int
        Circumferential wavenumber; n >= 0 for "complete", n >= 1 for the others.
    speed : float
        Spin Omega [rad/s].
    model : {"complete", "inextensional", "hybrid"}
        "hybrid" is the inextensional model without its Coriolis term, section 2.4 of docs/model.md.

    Returns
    -------
    ndarray, shape (4,) for "complete", (2,) otherwise
        Frequencies [rad/s], ascending. For n = 0 the complete model's sine coordinates repeat its cosine
        coordinates, so each value stands twice.

    Notes
    -----
    With z_1 = alpha + i beta and z_2 = xi + i eta the four equations (3.2) are two complex ones; a motion
    exp(i nu t) then asks det [[B - nu^2, -i A - 2 i Omega nu], [i A + 2 i Omega nu, C - nu^2]] = 0, whose four
    roots nu are real for a stable ring: positive ones travel forward, negative ones backward.
    The inextensional model has nu^2 + D_c nu - g_n = 0 (3.10).
    """
    _check(unit, n, speed, model, lowest=0 if model == "complete" else 1)
    A, B, C, determinant = (float(value) for value in coefficients(unit, n, speed))
    if model == "complete":
        quartic = [1.0, 0.0, -(B + C + 4.0 * speed * speed), -4.0 * A * speed, determinant]
        return np.sort(np.abs(np.roots(quartic).real))
    if n == 1:  # (3.13)
        g, coriolis = unit.rigid_mode_frequency**2 - speed * speed, 2.0 * speed
    else:
        g, coriolis = n * determinant / (A + n * C), 2.0 * speed * (C + n * A) / (A + n * C)
    if model == "hybrid":
        coriolis = 0.0
    root = np.sqrt(complex(0.25 * coriolis * coriolis + g))
    return np.sort(np.abs([(root - 0.5 * coriolis).real, (root + 0.5 * coriolis).real]))


def steady_amplitudes(
    unit: TireWheelUnit,
    n: ArrayLike,
    speed: float,
    load: float,
    traction: float = 0.0,
    model: Model = "inextensional",
) -> tuple[FloatArray, FloatArray]:
    """Steady radial amplitudes of modes n >= 2 about the contact, under a constant force there.

    Parameters
    ----------
    unit : TireWheelUnit
    n : array_like of int, shape (N,)
        Wavenumbers, all >= 2.
    speed, load, traction : float
        Spin [rad/s]; vertical load, up positive [N]; traction on the tire, along x_ros [N].
    model : {"inextensional", "hybrid"}

    Returns
    -------
    cosine, sine : ndarray, shape (N,)
        u_z = sum cosine cos n(psi - psi_0) + sine sin n(psi - psi_0) [m]; and since u_z = -d u_theta/d psi,
        u_theta = sum (sine cos n(psi - psi_0) - cosine sin n(psi - psi_0))/n.

    Notes
    -----
    Seen from the fixed frame the mode is W = q/(R - i I) with R and I of (4.4) and
    q = n (C f_r + i A f_t)/((A + n C) pi a b rho h), f_r = -load, f_t = -traction;
    u_z = Re[conj(W) exp(i n (psi - psi_0))].
    Written in real arithmetic, so that the result is the same on every machine.
    """
    number = np.asarray(n, dtype=np.float64)
    A, _, C, determinant = coefficients(unit, number, speed)
    through = A + number * C
    spin = number * speed
    real = number * determinant / through - spin * spin
    if model != "hybrid":
        real = real + spin * (2.0 * speed * (C + number * A) / through)
    imaginary = mode_damping(unit, number) * spin
    modal_mass = math.pi * unit.radius * unit.width * unit.surface_density
    scale = number / (through * modal_mass * (real * real + imaginary * imaginary))
    radial, tangential = -load * C, -traction * A
    # conj(W) = (q_r - i q_i)(R - i I)/(R^2 + I^2)
    cosine = scale * (radial * real - tangential * imaginary)
    sine = scale * (radial * imaginary + tangential * real)
    return cosine, sine


def steady_response(
    unit: TireWheelUnit,
    speed: float,
    load: float,
    psi: ArrayLike,
    n_max: int = 30,
    model: Model = "inextensional",
) -> tuple[FloatArray, FloatArray]:
    """Steady deflection of the belt by its modes n = 2..n_max under a constant vertical load (4.3)-(4.5).

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign.
    load : float
        Vertical load at the contact, up positive [N].
    psi : array_like
        Angles fixed in space [rad].
    n_max : int
        Highest wavenumber, >= 2.
    model : {"inextensional", "hybrid"}

    Returns
    -------
    u_z, u_theta : ndarray, the shape of psi
        Radial (outward) and tangential (along increasing psi) deflection [m].
    """
    _check(unit, n_max, speed, model, lowest=2)
    if not math.isfinite(load):
        raise ValueError(f"load is {load!r}; it must be finite")
    angle = np.asarray(psi, dtype=np.float64)
    number = np.arange(2, n_max + 1)
    cosine, sine = steady_amplitudes(unit, number, speed, load, model=model)
    phase = np.multiply.outer(angle - CONTACT_ANGLE, number)
    u_z = np.cos(phase) @ cosine + np.sin(phase) @ sine
    u_theta = np.cos(phase) @ (sine / number) - np.sin(phase) @ (cosine / number)
    return u_z, u_theta


def _check(unit: TireWheelUnit, n: int, speed: float, model: str, lowest: int) -> None:
    if model not in ("complete", "inextensional", "hybrid"):
        raise ValueError(f"model is {model!r}; it must be 'complete', 'inextensional' or 'hybrid'")
    if not math.isfinite(n) or int(n) != n or n < lowest:
        raise ValueError(f"n is {n!r}; model {model!r} needs an integer >= {lowest}")
    if not math.isfinite(speed):
        raise ValueError(f"speed is {speed!r}; it must be finite")
