"""The axle forces under a load that is constant, and under a load and a traction that vary as a sine."""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import contact as road
from .unit import MODAL, TireWheelUnit
from .wheel_matrices import FixedFrame, Model, fixed_frame, fixed_frame_matrix

__all__ = ["frequency_response", "transmissibility", "whirl_frequencies"]

ComplexArray = NDArray[np.complex128]
FloatArray = NDArray[np.float64]

_BLOCK: Final = 16384  # points that are solved together: some 10 MB
_LEAST: Final = 1e-13  # of the reciprocal condition number: below it, no three digits are left


def frequency_response(
    unit: TireWheelUnit,
    speed: ArrayLike,
    frequencies: ArrayLike,
    model: Model = "inextensional",
    *,
    input: Literal["load", "road"] = "load",
    n_max: int = 30,
) -> ComplexArray:
    """Axle forces per load and traction, or per road and traction, as complex amplitudes at constant speed, exact.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : array_like, shape (...)
        Spin Omega [rad/s], either sign.
    frequencies : array_like, shape (...)
        Of the load or the traction, seen by one who stands beside the axle [Hz]. May be 0 and negative.
    model : {"inextensional", "complete"}
    input : {"load", "road"}
        What drives the tire beside the traction: a load that is given, or the road's height
        (:func:`.contact.frequency_response`).
    n_max : int
        Highest belt harmonic on the road; a given load reaches the axle of a uniform tire through n = 1 alone.

    Returns
    -------
    ndarray of complex, shape (*speed.shape, *frequencies.shape, 2, 2), on the road (..., 3, 2)
        H[..., output, input] [-]: outputs are the axle forces (force.x, forward, and F', up, on the suspension), as in
        :func:`.wheel_state.axle_force`, inputs the vertical load (up) and the traction (forward) on the tire. A load
        F cos(2 pi f t) gives F abs(H[..., 1, 0]) cos(2 pi f t + angle(H[..., 1, 0])) at the suspension. H of load to F'
        at 0 Hz is :func:`transmissibility`. On the road the first input is its height, up [N/m], and the third
        output the contact force.

    Raises
    ------
    ValueError
        An argument is not finite, or the response is not: an undamped resonance, or a frequency beyond what double
        precision holds. The message has the frequency and the speed.

    Notes
    -----
    H = (C_0 + Omega C_1) (2 pi i f - F_0 - Omega F_1)^-1 B of :class:`.wheel_matrices.FixedFrame`, solved for the
    displacements alone. Where the unit is unstable this is still what the equations have at that frequency, but
    nothing settles to it: :func:`.wheel.stability` says so. A varying speed mixes frequencies and has no such
    response.

    Examples
    --------
    >>> unit = TireWheelUnit.table_1()
    >>> H = frequency_response(unit, 209.4, [0.0, 78.5])
    >>> H.shape
    (2, 2, 2)
    >>> bool(np.isclose(H[0, 1, 0], transmissibility(unit, 209.4)))
    True
    """
    if input not in ("load", "road"):
        raise ValueError(f"input is {input!r}; it must be 'load' or 'road'")
    if input == "road":
        return road.frequency_response(unit, speed, frequencies, model, n_max)
    system = fixed_frame(unit, model)
    spins, cycles = _finite("speed", speed), _finite("frequencies", frequencies)
    grid = np.broadcast_arrays(spins.reshape(-1, 1), cycles.reshape(1, -1))
    Omega, f = (np.ascontiguousarray(values).reshape(-1) for values in grid)
    response = np.empty((f.size, 2, 2), dtype=np.complex128)
    for first in range(0, f.size, _BLOCK):
        block = slice(first, first + _BLOCK)
        response[block] = _solve(system, Omega[block], f[block])
    return response.reshape(*spins.shape, *cycles.shape, 2, 2)


def transmissibility(unit: TireWheelUnit, speed: ArrayLike) -> float | FloatArray:
    """Steady force on the suspension over a constant load, K = F'/F, of the inextensional model.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : array_like
        Spin Omega [rad/s].

    Returns
    -------
    float, or ndarray of the shape of speed
        1/(1 + (2 zeta_1 Omega/omega_1)^2 (k_1 + k_s)/k_s (k_1 + k_x)/k_x) for modal damping, without the last factor
        where the wheel is held; 1 for damping with a reaction, whose dashpots cannot carry a constant force to anywhere
        but the wheel.
    """
    omega = np.asarray(speed, dtype=np.float64)
    if not np.isfinite(omega).all():
        raise ValueError(f"speed is {speed!r}; it must be finite")
    if unit.sidewall_damping == MODAL:
        ratio = 2.0 * unit.zeta_1 * omega / unit.rigid_mode_frequency
        series = unit.sidewall_stiffness / unit.suspension_stiffness + 1.0
        if not unit.is_longitudinally_rigid:
            series = series * (unit.sidewall_stiffness / unit.longitudinal_stiffness + 1.0)
        K = 1.0 / (1.0 + ratio * ratio * series)
    else:
        K = np.ones_like(omega)
    return float(K) if K.ndim == 0 else K


def whirl_frequencies(
    unit: TireWheelUnit,
    speed: float,
    model: Model = "inextensional",
    *,
    contact: bool = False,
    n_max: int = 30,
) -> FloatArray:
    """Damped frequencies of n = 1 and the wheel seen from the fixed frame [Hz], from the lowest on.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s].
    model : {"inextensional", "complete"}
    contact : bool
        On the road: with the belt's harmonics to ``n_max``, which the contact couples with n = 1.
    n_max : int

    Returns
    -------
    ndarray, shape (k,)
        abs(Im lambda)/(2 pi) of the pairs of exponents: 3, or 5 of the complete model, but for overdamped motions,
        which have none.
    """
    if contact:
        return np.asarray(road.oscillatory_exponents(unit, speed, model, n_max).imag / (2.0 * math.pi))
    exponents = np.linalg.eigvals(fixed_frame_matrix(unit, speed, model))
    return np.sort(exponents.imag[exponents.imag > 0.0]) / (2.0 * math.pi)


def _finite(name: str, values: ArrayLike) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} is {array[~np.isfinite(array)][0]}; it must be finite")
    return array


def _solve(system: FixedFrame, Omega: FloatArray, f: FloatArray) -> ComplexArray:
    """H at N points (Omega [rad/s], f [Hz]), shape (N, 2, 2).

    The lower half of F says that displacements q have their velocities: (s^2 - s F_vv - F_vq) q = B_v u, s = 2 pi i f.
    """
    half = len(system.constant) // 2
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused
        s = np.asarray(2.0j * math.pi * f, dtype=np.complex128)[:, None, None]
        F = (system.constant + Omega[:, None, None] * system.spin)[:, :half]
        dynamic: ComplexArray = s * s * np.eye(half) - s * F[:, :, :half] - F[:, :, half:]
        output = system.output + Omega[:, None, None] * system.output_spin
        right = np.concatenate([system.input[:half], np.eye(half)], axis=1)
        try:
            solution = np.linalg.solve(dynamic, np.broadcast_to(right, (f.size, *right.shape)))
        except np.linalg.LinAlgError:  # one of them is singular to the last bit: each by itself
            _refuse_first(dynamic, Omega, f)
            raise
        sizes = [np.abs(matrix).sum(axis=1).max(axis=1) for matrix in (dynamic, solution[:, :, 2:])]
        displacement = solution[:, :, :2]
        response = np.asarray((s * output[:, :, :half] + output[:, :, half:]) @ displacement, dtype=np.complex128)
        lost = ~(_LEAST * sizes[0] * sizes[1] < 1.0) | ~np.isfinite(response).all(axis=(1, 2))
    if lost.any():
        _refuse(Omega[lost][0], f[lost][0])
    return response


def _refuse_first(dynamic: ComplexArray, Omega: FloatArray, f: FloatArray) -> None:
    for matrix, speed, frequency in zip(dynamic, Omega, f, strict=True):
        try:
            np.linalg.inv(matrix)
        except np.linalg.LinAlgError:
            _refuse(speed, frequency)


def _refuse(speed: float, frequency: float) -> None:
    raise ValueError(
        f"frequencies has {frequency:.10g} Hz, at which the response at {speed:.10g} rad/s is beyond what double "
        "precision holds; give the unit damping, or leave this frequency out"
    )
