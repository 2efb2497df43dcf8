"""What a state of n = 1 and the wheel says: forces on the axle, deflection of the belt, places; states of equilibrium.

States are those of ``wheel_matrices.fixed_frame``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .stepping import solve_in_order
from .unit import TireWheelUnit
from .wheel_matrices import Model, fixed_frame

__all__ = [
    "axle_force",
    "axle_forces",
    "belt_amplitudes",
    "change_speed",
    "equilibrium",
    "output_matrices",
    "reshaped",
    "ring_centre",
    "wheel_displacement",
]

FloatArray = NDArray[np.float64]


def equilibrium(
    unit: TireWheelUnit, speed: float, load: float, traction: float = 0.0, model: Model = "inextensional"
) -> FloatArray:
    """The fixed-frame state, shape (6,) or (10,), in which a constant load at constant speed leaves the unit."""
    system = fixed_frame(unit, model)
    half = len(system.constant) // 2
    stiffness = system.constant[:half, half:] + speed * system.spin[:half, half:]
    force = system.input[:half, 0] * load + system.input[:half, 1] * traction
    return np.concatenate([np.zeros(half), solve_in_order(-stiffness, force)])


def axle_force(unit: TireWheelUnit, speed: float, state: FloatArray, model: Model = "inextensional") -> FloatArray:
    """Force on the axle [x, z], REP 103 axes [N], in a fixed-frame state: x on the held wheel, z on the suspension."""
    return axle_forces(output_matrices(unit, np.asarray(speed), model), state)


def output_matrices(unit: TireWheelUnit, speeds: FloatArray, model: Model = "inextensional") -> FloatArray:
    """Transposed matrices that take states to axle forces at speeds [rad/s] of shape (...,), shape (..., n, 2)."""
    system = fixed_frame(unit, model)
    # in C order, lest NumPy add the products of a row in pairs
    matrices: FloatArray = np.ascontiguousarray(system.output.T + speeds[..., None, None] * system.output_spin.T)
    return matrices


def axle_forces(matrices: FloatArray, states: FloatArray) -> FloatArray:
    """Axle forces (..., 2) [N] in states (..., n), from :func:`output_matrices` (..., n, 2); sums in order."""
    force: FloatArray = np.add.reduce(matrices * states[..., None], axis=-2)
    return force


def change_speed(state: FloatArray, change: float, model: Model = "inextensional") -> FloatArray:
    """The fixed-frame state after a jump of the speed.

    Parameters
    ----------
    state : ndarray, shape (n,)
    change : float
        Of the spin Omega [rad/s].
    model : {"inextensional", "complete"}

    Returns
    -------
    ndarray, shape (n,)
        A new one, or the same where nothing jumps.

    Notes
    -----
    In the fixed frame the Euler terms of the complete model are i Omega' (Z_1 - i Z_2) in Z_1'' and
    -Omega' (Z_1 - i Z_2) in Z_2'', with Z_1 - i Z_2 = (X + V) + i (Y - U). They vanish for a ring that does not
    stretch, where U = Y and V = -X.
    """
    if model == "inextensional" or change == 0.0:
        return state
    X, Y, U, V = _amplitudes(state)
    jumped = state.copy()
    jumped[0] -= change * (Y - U)
    jumped[1] += change * (X + V)
    jumped[2] -= change * (X + V)
    jumped[3] -= change * (Y - U)
    return jumped


def belt_amplitudes(state: FloatArray, model: Model = "inextensional") -> FloatArray:
    """The n = 1 deflection of the belt relative to the wheel centre, from fixed-frame states.

    Parameters
    ----------
    state : ndarray, shape (..., 6) or (..., 10)
    model : {"inextensional", "complete"}

    Returns
    -------
    ndarray, shape (..., 4)
        (a, b, c, d) of u_z = a cos psi + b sin psi and u_theta = c cos psi + d sin psi [m].
    """
    y, x = wheel_displacement(state, model)
    if model == "inextensional":
        X, Y = _amplitudes(state, 2)
        return np.stack([X - x, Y - y, Y - y, x - X], axis=-1)
    X, Y, U, V = _amplitudes(state)
    return np.stack([X - x, Y - y, U - y, V + x], axis=-1)


def wheel_displacement(state: FloatArray, model: Model = "inextensional") -> tuple[FloatArray, FloatArray]:
    """The wheel's y, up, and x, along the paper's X, which is backward [m], shape (...), from fixed-frame states.

    Where it is held, x is zero.
    """
    half = state.shape[-1] // 2
    up = half + (2 if model == "inextensional" else 4)
    y: FloatArray = state[..., up]
    return y, state[..., up + 1] if up + 1 < 2 * half else np.zeros_like(y)


def reshaped(state: FloatArray, states: int) -> FloatArray:
    """The same motion (..., n) with another number of states: x and x' left out, or added at rest."""
    n = state.shape[-1]
    if states == n:
        return state
    if states < n:
        return np.delete(state, [n // 2 - 1, n - 1], axis=-1)
    return np.insert(state, [n // 2, n], 0.0, axis=-1)


def _amplitudes(state: FloatArray, count: int = 4) -> list[FloatArray]:
    """X, Y and, of the complete model, U, V."""
    half = state.shape[-1] // 2
    return [state[..., half + k] for k in range(count)]


def ring_centre(state: FloatArray, model: Model = "inextensional") -> FloatArray:
    """The ring's centre of mass (X, Y) in the paper's axes [m], shape (..., 2), from fixed-frame states.

    The mean of u_z e_r + u_theta e_theta over the ring: ((X - V)/2, (Y + U)/2), which is (X, Y) if it cannot stretch.
    """
    if model == "inextensional":
        return np.stack(_amplitudes(state, 2), axis=-1)
    X, Y, U, V = _amplitudes(state)
    return 0.5 * np.stack([X - V, Y + U], axis=-1)
