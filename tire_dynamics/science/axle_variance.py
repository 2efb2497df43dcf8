"""What the error of a load makes of the axle's force."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .stepping import solve_in_order
from .unit import TireWheelUnit
from .wheel_matrices import Model, fixed_frame

__all__ = ["axle_force_covariance"]

FloatArray = NDArray[np.float64]


def axle_force_covariance(
    unit: TireWheelUnit, speed: float, corner_hz: float, model: Model = "inextensional"
) -> FloatArray:
    """Covariance of the axle force per variance of the load, where the load is noise of first order.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s].
    corner_hz : float
        Above which the noise of the load falls, > 0 [Hz].
    model : {"inextensional", "complete"}

    Returns
    -------
    ndarray, shape (2, 2)
        Of force x and force z [-]: times the load's variance [N^2] it is the force's covariance. NaN where the unit is
        not stable, so that there is none.

    Raises
    ------
    ValueError
        ``corner_hz`` is not above 0, or an argument is not finite.

    Notes
    -----
    The load f' = -w_c f + (2 w_c)^(1/2) noise, of variance 1, drives the system of :class:`.wheel_matrices.FixedFrame`.
    Of both together, z' = A z + noise, the covariance P follows from A P + P A' + Q = 0, which is solved for the upper
    half of P by elimination in a fixed order.
    """
    if not (math.isfinite(corner_hz) and corner_hz > 0.0):
        raise ValueError(f"corner_hz is {corner_hz!r}; it must be > 0")
    if not math.isfinite(speed):
        raise ValueError(f"speed is {speed!r}; it must be finite")
    system = fixed_frame(unit, model)
    corner = 2.0 * math.pi * corner_hz
    n = len(system.constant) + 1
    A = np.zeros((n, n))
    A[:-1, :-1] = system.constant + speed * system.spin
    A[:-1, -1] = system.input[:, 0]
    A[-1, -1] = -corner
    place = {pair: k for k, pair in enumerate((i, j) for i in range(n) for j in range(i, n))}
    equations, right = np.zeros((len(place), len(place))), np.zeros(len(place))
    for (i, j), row in place.items():
        for k in range(n):
            equations[row, place[min(k, j), max(k, j)]] += A[i, k]
            equations[row, place[min(k, i), max(k, i)]] += A[j, k]
    right[place[n - 1, n - 1]] = -2.0 * corner
    sizes = np.abs(equations).max(axis=1)
    solution = solve_in_order(equations / sizes[:, None], right / sizes)
    P = np.zeros((n, n))
    for (i, j), row in place.items():
        P[i, j] = P[j, i] = solution[row]
    output = np.zeros((2, n))
    output[:, :-1] = system.output + speed * system.output_spin
    half = np.add.reduce(output[:, :, None] * P[None, :, :], axis=1)
    found = np.add.reduce(half.T[:, :, None] * output.T[:, None, :], axis=0)
    if not np.isfinite(found).all() or (P.diagonal() < 0.0).any() or found[0, 0] < 0.0 or found[1, 1] < 0.0:
        return np.full((2, 2), math.nan)
    return np.asarray(found)
