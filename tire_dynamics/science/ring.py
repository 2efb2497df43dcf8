"""The flexible ring with the wheel held: matrices, natural frequencies, mode shapes, forced response.

Equation numbers are those of Huang & Hsu (1992). ``theta`` is fixed to the ring, ``psi = theta + int Omega dt``
is fixed in space; ``psi = 0`` points along the paper's horizontal axis X (which is -x of REP 103),
``psi = pi/2`` up, and the contact is at ``psi_0 = 3 pi/2``.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .coefficients import (
    Coefficients,
    Model,
    coefficients,
    mode_damping,
    residual_stiffness,
    rest_frequency,
    static_compliance,
)
from .modes import CONTACT_ANGLE, RingModes
from .stepping import Steps
from .unit import TireWheelUnit

__all__ = [
    "CONTACT_ANGLE",
    "Coefficients",
    "coefficients",
    "matrices",
    "mode_damping",
    "mode_shapes",
    "natural_frequencies",
    "point_force_response",
    "rest_frequency",
    "static_stiffness",
    "steady_amplitudes",
    "steady_response",
    "transient_response",
]

Frame = Literal["ring", "fixed"]
FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def matrices(
    unit: TireWheelUnit, n: int, speed: float = 0.0, model: Model = "complete"
) -> tuple[FloatArray, FloatArray]:
    """G and K of x'' + G x' + K x = Q in the ring-fixed frame at constant speed, (3.2), (3.10), (3.11).

    Parameters
    ----------
    unit : TireWheelUnit
    n : int
        Circumferential wavenumber; n >= 0 for "complete", n >= 1 for the others.
    speed : float
        Spin Omega [rad/s], either sign.
    model : {"complete", "inextensional", "hybrid"}

    Returns
    -------
    G, K : ndarray, shape (4, 4) for "complete", (2, 2) otherwise
        [1/s], [1/s^2]; x = [alpha, beta, xi, eta] or [alpha, beta]. Damping is on the diagonal of G.
    """
    _check(n, speed, model, lowest=0 if model == "complete" else 1)
    A, B, C, _ = (float(value) for value in coefficients(unit, n, speed))
    d = float(mode_damping(unit, n, "complete" if model == "complete" else "inextensional"))
    if model == "complete":
        G, K = d * np.eye(4), np.diag([B, B, C, C])
        G[[0, 1], [2, 3]] = -2.0 * speed
        G[[2, 3], [0, 1]] = 2.0 * speed
        K[0, 3] = K[3, 0] = A
        K[1, 2] = K[2, 1] = -A
        return G, K
    g, coriolis = _reduced(unit, n, speed, model)
    return np.array([[d, -coriolis], [coriolis, d]]), g * np.eye(2)


def _reduced(unit: TireWheelUnit, n: int, speed: float, model: Model) -> tuple[float, float]:
    """g_n and the Coriolis coefficient D_c of the inextensional ring, (3.12), and (3.13) for n = 1."""
    A, _, C, determinant = (float(value) for value in coefficients(unit, n, speed))
    if n == 1:
        g, coriolis = unit.rigid_mode_frequency**2 - speed * speed, 2.0 * speed
    else:
        g, coriolis = n * determinant / (A + n * C), 2.0 * speed * (C + n * A) / (A + n * C)
    return g, 0.0 if model == "hybrid" else coriolis


def natural_frequencies(
    unit: TireWheelUnit, n: int, speed: float = 0.0, model: Model = "complete", *, frame: Frame = "ring"
) -> FloatArray:
    """Undamped natural frequencies of the ring with the wheel held.

    Parameters
    ----------
    unit : TireWheelUnit
    n : int
        Circumferential wavenumber; n >= 0 for "complete", n >= 1 for the others.
    speed : float
        Spin Omega [rad/s], either sign.
    model : {"complete", "inextensional", "hybrid"}
        "hybrid" is the inextensional model without its Coriolis term.
    frame : {"ring", "fixed"}
        Whether an observer turns with the ring or stands still.

    Returns
    -------
    ndarray, shape (4,) for "complete", (2,) otherwise
        Frequencies [rad/s], ascending. For n = 0 the complete model's sine coordinates repeat its cosine
        coordinates, so each value stands twice. A mode that diverges has frequency 0 in the ring's frame.

    Notes
    -----
    With z_1 = alpha + i beta and z_2 = xi + i eta the four equations (3.2) are two complex ones; a motion
    exp(i nu t) then asks det [[B - nu^2, -i A - 2 i Omega nu], [i A + 2 i Omega nu, C - nu^2]] = 0, whose four
    roots nu are real for a stable ring: positive ones travel forward, negative ones backward.
    The inextensional model has nu^2 + D_c nu - g_n = 0 (3.10). From the fixed frame, nu is seen as nu + n Omega.
    """
    _check(n, speed, model, lowest=0 if model == "complete" else 1)
    _check_frame(frame)
    if model == "complete":
        A, B, C, determinant = (float(value) for value in coefficients(unit, n, speed))
        roots = np.roots([1.0, 0.0, -(B + C + 4.0 * speed * speed), -4.0 * A * speed, determinant])
    else:
        g, coriolis = _reduced(unit, n, speed, model)
        root = np.sqrt(complex(0.25 * coriolis * coriolis + g))
        roots = np.array([root - 0.5 * coriolis, -root - 0.5 * coriolis])
    seen = roots.real + (n * speed if frame == "fixed" else 0.0)
    return np.asarray(np.sort(np.abs(seen)), dtype=np.float64)


def mode_shapes(
    unit: TireWheelUnit, n: int, speed: float = 0.0, model: Model = "complete", *, frame: Frame = "ring"
) -> tuple[ComplexArray, ComplexArray]:
    """Damped exponents and shapes of the waves of wavenumber n, with the wheel held.

    Parameters
    ----------
    unit : TireWheelUnit
    n : int
        Circumferential wavenumber; n >= 0 for "complete", n >= 2 for the others.
    speed : float
        Spin Omega [rad/s], either sign.
    model : {"complete", "inextensional", "hybrid"}
    frame : {"ring", "fixed"}
        Where the exponents are seen from; the shapes are the same.

    Returns
    -------
    exponents : ndarray of complex, shape (4,) for "complete", (2,) otherwise
        [1/s], by ascending imaginary part: waves that travel against the ring's theta first.
    shapes : ndarray of complex, shape (4, 2) or (2, 2)
        (z_1, z_2) of each, the larger of the two 1: u_z = Re[conj(z_1) exp(i n theta)], u_theta with z_2.
    """
    _check(n, speed, model, lowest=0 if model == "complete" else 2)
    _check_frame(frame)
    modes = RingModes(unit, [n], model)
    spinning = modes.at(speed)
    states = np.swapaxes(spinning.right[0], 0, 1)[:, None, :]  # a wave a row
    shapes = np.concatenate(modes.amplitudes(states), axis=1)
    shapes /= np.take_along_axis(shapes, np.abs(shapes).argmax(axis=1)[:, None], axis=1)
    exponents = spinning.exponents[0] - (1j * n * speed if frame == "ring" else 0.0)
    order = np.argsort(exponents.imag)
    return exponents[order], shapes[order]


def steady_amplitudes(
    unit: TireWheelUnit,
    n: ArrayLike,
    speed: float,
    load: float,
    traction: float = 0.0,
    model: Model = "inextensional",
) -> tuple[FloatArray, FloatArray]:
    """Steady radial amplitudes of modes n >= 2 about the contact, under a constant force there, (4.4).

    Parameters
    ----------
    unit : TireWheelUnit
    n : array_like of int, shape (N,)
        Wavenumbers, all >= 2.
    speed, load, traction : float
        Spin [rad/s]; vertical load, up positive [N]; traction on the tire, along x_ros [N].
    model : {"inextensional", "hybrid", "complete"}

    Returns
    -------
    cosine, sine : ndarray, shape (N,)
        u_z = sum cosine cos n(psi - psi_0) + sine sin n(psi - psi_0) [m].
    """
    modes = RingModes(unit, n, model)
    radial, _ = modes.amplitudes(modes.at(speed).steady(-load, -traction))
    about_contact = radial * np.exp(-1j * modes.numbers * CONTACT_ANGLE)
    return about_contact.real, about_contact.imag


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
    model : {"inextensional", "hybrid", "complete"}

    Returns
    -------
    u_z, u_theta : ndarray, the shape of psi
        Radial (outward) and tangential (along increasing psi) deflection [m].
    """
    _check(n_max, speed, model, lowest=2)
    _check_finite(load=load)
    return point_force_response(unit, speed, -load, 0.0, psi, numbers=np.arange(2, n_max + 1), model=model)


def static_stiffness(
    unit: TireWheelUnit, n_max: int = 30, model: Literal["inextensional", "complete"] = "inextensional"
) -> float:
    """Load over displacement of a tire on the road, wheel held, at rest, the residual spring included.

    Parameters
    ----------
    unit : TireWheelUnit
    n_max : int
        Highest wavenumber of the belt, >= 1.
    model : {"inextensional", "complete"}

    Returns
    -------
    float
        [N/m]. Where the unit's ``vertical_stiffness`` is 0 it is the belt's and the sidewall's own, one over
        :func:`.coefficients.static_compliance`; otherwise ``vertical_stiffness``, for that is what the residual
        spring, :func:`.wheel.residual_stiffness`, is there for.

    Raises
    ------
    ValueError
        ``n_max`` is out of its bounds, or ``vertical_stiffness`` is not below the tire's own to this n_max.
    """
    residual = residual_stiffness(unit, n_max, model)
    return 1.0 / (1.0 / residual + static_compliance(unit, n_max, model))


def point_force_response(
    unit: TireWheelUnit,
    speed: float,
    radial: float,
    tangential: float,
    psi: ArrayLike,
    *,
    angle: float = CONTACT_ANGLE,
    numbers: ArrayLike = tuple(range(2, 31)),
    model: Model = "inextensional",
) -> tuple[FloatArray, FloatArray]:
    """Steady deflection under a constant force at an angle fixed in space.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign.
    radial, tangential : float
        f_r, outward, and f_t, along increasing psi [N].
    psi : array_like
        Angles fixed in space [rad].
    angle : float
        Where the force acts [rad].
    numbers : array_like of int
        Wavenumbers that are summed.
    model : {"inextensional", "hybrid", "complete"}

    Returns
    -------
    u_z, u_theta : ndarray, the shape of psi
        Radial (outward) and tangential (along increasing psi) deflection [m].
    """
    _check_finite(speed=speed, radial=radial, tangential=tangential, angle=angle)
    modes = RingModes(unit, numbers, model, angle)
    return _shape(modes, modes.at(speed).steady(radial, tangential), psi)


def transient_response(
    unit: TireWheelUnit,
    time: ArrayLike,
    speed: ArrayLike,
    radial: ArrayLike,
    tangential: ArrayLike,
    psi: ArrayLike,
    *,
    angle: float = CONTACT_ANGLE,
    numbers: ArrayLike = tuple(range(2, 31)),
    model: Model = "inextensional",
    steady_start: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Deflection through time under a varying force at an angle fixed in space, at a varying speed.

    Parameters
    ----------
    unit : TireWheelUnit
    time : array_like, shape (N,)
        Ascending times [s].
    speed, radial, tangential : array_like, shape (N,) or scalar
        Spin [rad/s], f_r (outward) and f_t (along increasing psi) [N], linear between samples.
    psi : array_like, shape (P,)
        Angles fixed in space [rad].
    angle, numbers, model
        As for :func:`point_force_response`.
    steady_start : bool
        Start in the steady state of the first sample, otherwise at rest.

    Returns
    -------
    u_z, u_theta : ndarray, shape (N, P)
        [m]; exact at constant speed, of second order in the step where the speed varies.
    """
    t = np.asarray(time, dtype=np.float64)
    if t.ndim != 1 or t.size == 0 or not np.isfinite(t).all() or not (np.diff(t) > 0.0).all():
        raise ValueError("time must be a row of at least one finite number, ascending")
    series = []
    for name, value in (("speed", speed), ("radial", radial), ("tangential", tangential)):
        array = np.asarray(value, dtype=np.float64)
        if array.shape not in ((), t.shape) or not np.isfinite(array).all():
            raise ValueError(f"{name} has shape {array.shape}; it must be finite, a number or one per time, {t.shape}")
        series.append(np.broadcast_to(array, t.shape))
    modes = RingModes(unit, numbers, model, angle)
    states = modes.integrate(Steps(t, series[0]), np.stack(series[1:], axis=1), steady=steady_start)
    return _shape(modes, states, psi)


def _shape(modes: RingModes, states: ComplexArray, psi: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """u_z and u_theta, shape (...,) + psi.shape, of states of shape (..., N, k)."""
    wave = np.exp(1j * np.multiply.outer(modes.numbers, np.asarray(psi, dtype=np.float64)))
    u_z, u_theta = (np.tensordot(np.conj(Z), wave, axes=1).real for Z in modes.amplitudes(states))
    return u_z, u_theta


def _check(n: int, speed: float, model: str, lowest: int) -> None:
    if model not in ("complete", "inextensional", "hybrid"):
        raise ValueError(f"model is {model!r}; it must be 'complete', 'inextensional' or 'hybrid'")
    if not math.isfinite(n) or int(n) != n or n < lowest:
        raise ValueError(f"n is {n!r}; model {model!r} needs an integer >= {lowest}")
    _check_finite(speed=speed)


def _check_frame(frame: str) -> None:
    if frame not in ("ring", "fixed"):
        raise ValueError(f"frame is {frame!r}; it must be 'ring' or 'fixed'")


def _check_finite(**values: float) -> None:
    for name, value in values.items():
        if not math.isfinite(value):
            raise ValueError(f"{name} is {value!r}; it must be finite")
