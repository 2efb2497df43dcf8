"""The n = 1 mode of the ring and the wheel on its suspension: matrices, stability, transmissibility.

Equation numbers are those of Huang & Hsu (1992). The ring-frame state is (5.1)

    inextensional  z = [alpha', beta', y', alpha, beta, y]
    complete       z = [alpha', beta', xi', eta', y', alpha, beta, xi, eta, y]

and the fixed-frame state has the same shape, with each pair turned by phi = int Omega dt:
X = alpha cos phi - beta sin phi, Y = alpha sin phi + beta cos phi, and likewise U, V from xi, eta.
A wheel that gives fore and aft has x' behind y' and x behind y, along the paper's X: 8 and 12 states.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import floquet
from .coefficients import coefficients, mode_damping, residual_stiffness
from .floquet import FloquetResult
from .roots import root_between
from .stepping import solve_in_order
from .unit import MODAL, TireWheelUnit

if TYPE_CHECKING:
    from .maps import StabilityMap, TransmissibilityMap, stability_map, transmissibility_map
    from .response import frequency_response, whirl_frequencies

__all__ = [
    "FixedFrame",
    "StabilityMap",
    "TransmissibilityMap",
    "axle_force",
    "axle_forces",
    "belt_amplitudes",
    "change_speed",
    "critical_speed",
    "crossings",
    "equilibrium",
    "fixed_frame",
    "fixed_frame_matrix",
    "frequency_response",
    "is_unstable",
    "output_matrices",
    "residual_stiffness",
    "reshaped",
    "ring_centre",
    "rotation",
    "stability",
    "stability_map",
    "stacked_frames",
    "state_matrix",
    "states",
    "transmissibility",
    "transmissibility_map",
    "wheel_displacement",
    "whirl_frequencies",
]

Model = Literal["complete", "inextensional"]
FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


class FixedFrame(NamedTuple):
    """The system in the fixed frame, z' = (constant + Omega spin) z + input [load, traction].

    ``load`` is the vertical contact force, up positive, ``traction`` the horizontal one along x_ros [N].
    The axle force [x_ros, z_ros] is (output + Omega output_spin) z [N].
    """

    constant: FloatArray
    spin: FloatArray
    input: FloatArray
    output: FloatArray
    output_spin: FloatArray


@lru_cache(maxsize=256)
def fixed_frame(unit: TireWheelUnit, model: Model = "inextensional") -> FixedFrame:
    """The parts of the fixed-frame system, for the given model and the unit's ``sidewall_damping``.

    Parameters
    ----------
    unit : TireWheelUnit
    model : {"inextensional", "complete"}

    Returns
    -------
    FixedFrame
        Its matrices are shared, and cannot be written to.

    Notes
    -----
    Complex amplitudes Z = X + i Y turn the rotation into z = Z exp(-i phi), hence z' -> Z' - i Omega Z. In
    that frame the centrifugal, hoop-tension and Coriolis parts of A_1, B_1, C_1 cancel, so the stiffness does
    not depend on Omega; what is left of rotation is the gyroscopic coupling of the complete model and the
    circulatory term -i d Omega Z of a damper that turns with the ring. docs/model.md has each step.
    """
    system = _builder(model)(unit)
    for matrix in system:
        matrix.setflags(write=False)  # they are shared
    return system


def stacked_frames(units: TireWheelUnit, shape: tuple[int, ...], model: Model = "inextensional") -> FixedFrame:
    """:func:`fixed_frame` of a unit whose fields are arrays, broadcast to ``shape``, which matrices have in front."""
    return _builder(model)(units, shape)


def states(unit: TireWheelUnit, model: Model = "inextensional") -> int:
    """The number of states: 6 or 10, and two more for a wheel that gives fore and aft."""
    return (6 if model == "inextensional" else 10) + 2 * (not unit.is_held)


def _builder(model: str) -> Callable[..., FixedFrame]:
    if model == "inextensional":
        return _inextensional
    if model == "complete":
        return _complete
    raise ValueError(f"model is {model!r}; it must be 'inextensional' or 'complete'")


def _inextensional(unit: TireWheelUnit, shape: tuple[int, ...] = ()) -> FixedFrame:
    m, M, k_s, c_s = unit.ring_mass, unit.wheel_mass, unit.suspension_stiffness, unit.suspension_damping
    k_1 = unit.sidewall_stiffness
    kappa = k_1 / m
    d = 2.0 * unit.zeta_1 * unit.rigid_mode_frequency
    c_1 = m * d  # the sidewall's damping as it acts between belt and wheel [N s/m]
    constant, spin, force, output, output_spin = _zeros(shape, 6)
    constant[..., 3:, :3] = np.eye(3)
    #                    X'    Y'    y'           X       Y       y
    _set(constant, 0, [  -d,   0.0,  0.0,      -kappa,    0.0,    0.0])  # fmt: skip
    _set(constant, 1, [ 0.0,    -d,  0.0,         0.0, -kappa,  kappa])  # fmt: skip
    _set(constant, 2, [ 0.0,   0.0, -c_s / M,     0.0, k_1 / M, -(k_1 + k_s) / M])  # fmt: skip
    _set(spin, 0, {4: -d})
    _set(spin, 1, {3: d})
    _set(output, 0, {3: -k_1})
    _set(output, 1, {2: c_s, 5: k_s})
    if unit.sidewall_damping != MODAL:  # the dashpots see the wheel, and the wheel sees them
        _set(constant, 1, {2: d})
        _set(constant, 2, {1: c_1 / M, 2: -(c_s + c_1) / M})
        _set(spin, 0, {5: d})
        _set(spin, 2, {3: -c_1 / M})
        _set(output, 0, {0: -c_1})
        _set(output_spin, 0, {4: -c_1, 5: c_1})
    _set(force, 0, {1: -1.0 / m})  # a contact patch changes nothing here: s_1 = 1
    _set(force, 1, {0: 1.0 / m})
    system = FixedFrame(constant, spin, force, output, output_spin)
    return system if unit.is_held else _inextensional_fore_and_aft(unit, system, kappa, d)


def _inextensional_fore_and_aft(unit: TireWheelUnit, held: FixedFrame, kappa: float, d: float) -> FixedFrame:
    """With x, which the sidewall's forces act on as they do on y; docs/model.md, section 5."""
    m, M, m_x, k_1 = unit.ring_mass, unit.wheel_mass, unit.fore_aft_mass, unit.sidewall_stiffness
    k_x, c_x = unit.longitudinal_stiffness, unit.longitudinal_damping
    system = _with_place_for_x(held)
    X, Y, x = 4, 5, 7  # columns; those of their velocities lie 4 before
    _set(system.constant, 0, {x: kappa})
    _set(system.constant, 3, {X: k_1 / m_x, x: -(k_1 + k_x) / m_x, x - 4: -c_x / m_x})
    _set(system.output, 0, dict.fromkeys(range(8), 0.0) | {x: -k_x, x - 4: -c_x})
    _set(system.output_spin, 0, dict.fromkeys(range(8), 0.0))
    if unit.sidewall_damping != MODAL:
        c_1 = m * d
        _set(system.constant, 0, {x - 4: d})
        _set(system.constant, 3, {X - 4: c_1 / m_x, x - 4: -(c_x + c_1) / m_x})
        _set(system.spin, 1, {x: -d})
        _set(system.spin, 2, {x: c_1 / M})
        _set(system.spin, 3, {Y: c_1 / m_x, Y + 1: -c_1 / m_x})
    return system


def _with_place_for_x(held: FixedFrame) -> FixedFrame:
    """The same system with a row and a column of zeros for x' behind y' and for x behind y."""
    *shape, n, _ = held.constant.shape
    old = np.array([k for k in range(n + 2) if k not in (n // 2, n + 1)])
    system = _zeros(tuple(shape), n + 2)
    for large, small in zip(system[:2], held[:2], strict=True):
        large[..., old[:, None], old] = small
    system.input[..., old, :] = held.input
    system.output[..., old] = held.output
    system.output_spin[..., old] = held.output_spin
    _set(system.constant, n + 1, {n // 2: 1.0})
    return system


def _complete(unit: TireWheelUnit, shape: tuple[int, ...] = ()) -> FixedFrame:
    M, k_s, c_s = unit.wheel_mass, unit.suspension_stiffness, unit.suspension_damping
    A, B, C, _ = coefficients(unit, 1)  # at rest: what the fixed frame keeps
    area = math.pi * unit.radius * unit.width
    half_mass = area * unit.surface_density
    radial, tangential = unit.radial_stiffness, unit.tangential_stiffness
    k_z, k_t = radial / unit.surface_density, tangential / unit.surface_density
    d = mode_damping(unit, 1, "complete")
    c_1 = half_mass * d
    constant, spin, force, output, output_spin = _zeros(shape, 10)
    constant[..., 5:, :5] = np.eye(5)
    #                    X'    Y'    U'    V'    y'          X    Y    U    V    y
    _set(constant, 0, [  -d,  0.0,  0.0,  0.0,  0.0,         -B, 0.0, 0.0,  -A, 0.0])  # fmt: skip
    _set(constant, 1, [ 0.0,   -d,  0.0,  0.0,  0.0,        0.0,  -B,   A, 0.0, k_z])  # fmt: skip
    _set(constant, 2, [ 0.0,  0.0,   -d,  0.0,  0.0,        0.0,   A,  -C, 0.0, k_t])  # fmt: skip
    _set(constant, 3, [ 0.0,  0.0,  0.0,   -d,  0.0,         -A, 0.0, 0.0,  -C, 0.0])  # fmt: skip
    _set(constant, 4, [ 0.0,  0.0,  0.0,  0.0, -c_s / M,    0.0, area * radial / M, area * tangential / M, 0.0,
                       -(area * (radial + tangential) + k_s) / M])  # fmt: skip
    _set(spin, 0, [0.0, -2.0, 2.0, 0.0, 0.0,    0.0,  -d])  # fmt: skip
    _set(spin, 1, [2.0, 0.0, 0.0, 2.0, 0.0,       d])  # fmt: skip
    _set(spin, 2, [-2.0, 0.0, 0.0, -2.0, 0.0,   0.0, 0.0, 0.0,  -d])  # fmt: skip
    _set(spin, 3, [0.0, -2.0, 2.0, 0.0, 0.0,    0.0, 0.0,   d])  # fmt: skip
    _set(output, 0, {5: -area * radial, 8: area * tangential})
    _set(output, 1, {4: c_s, 9: k_s})
    if unit.sidewall_damping != MODAL:
        _set(constant, 1, {4: d})
        _set(constant, 2, {4: d})
        _set(constant, 4, {1: c_1 / M, 2: c_1 / M, 4: -(c_s + 2.0 * c_1) / M})
        _set(spin, 0, {9: d})
        _set(spin, 3, {9: -d})
        _set(spin, 4, {5: -c_1 / M, 8: c_1 / M})
        _set(output, 0, {0: -c_1, 3: c_1})
        _set(output_spin, 0, {6: -c_1, 7: -c_1, 9: 2.0 * c_1})
    _set(force, 1, {0: 1.0 / half_mass})
    _set(force, 3, {1: 1.0 / half_mass})
    system = FixedFrame(constant, spin, force, output, output_spin)
    return system if unit.is_held else _complete_fore_and_aft(unit, system, d)


def _complete_fore_and_aft(unit: TireWheelUnit, held: FixedFrame, d: Any) -> FixedFrame:
    """With x, on which the belt's X pulls and its V pushes; docs/model.md, section 5."""
    M, m_x, k_x, c_x = unit.wheel_mass, unit.fore_aft_mass, unit.longitudinal_stiffness, unit.longitudinal_damping
    area = math.pi * unit.radius * unit.width
    radial, tangential = unit.radial_stiffness, unit.tangential_stiffness
    system = _with_place_for_x(held)
    X, Y, U, V, y, x = range(6, 12)  # columns; those of their velocities lie 6 before
    _set(system.constant, 0, {x: radial / unit.surface_density})
    _set(system.constant, 3, {x: -tangential / unit.surface_density})
    stiffness = area * (radial + tangential) + k_x
    pulls = {X: area * radial / m_x, V: -area * tangential / m_x, x: -stiffness / m_x, x - 6: -c_x / m_x}
    _set(system.constant, 5, pulls)
    _set(system.output, 0, dict.fromkeys(range(12), 0.0) | {x: -k_x, x - 6: -c_x})
    _set(system.output_spin, 0, dict.fromkeys(range(12), 0.0))
    if unit.sidewall_damping != MODAL:
        c_1 = area * unit.surface_density * d
        _set(system.constant, 0, {x - 6: d})
        _set(system.constant, 3, {x - 6: -d})
        _set(system.constant, 5, {X - 6: c_1 / m_x, V - 6: -c_1 / m_x, x - 6: -(c_x + 2.0 * c_1) / m_x})
        _set(system.spin, 1, {x: -d})
        _set(system.spin, 2, {x: -d})
        _set(system.spin, 4, {x: 2.0 * c_1 / M})
        _set(system.spin, 5, {Y: c_1 / m_x, U: c_1 / m_x, y: -2.0 * c_1 / m_x})
    return system


def _zeros(shape: tuple[int, ...], states: int) -> FixedFrame:
    n = states
    return FixedFrame(*(np.zeros((*shape, *size)) for size in ((n, n), (n, n), (n, 2), (2, n), (2, n))))


def _set(matrix: FloatArray, row: int, values: Sequence[Any] | Mapping[int, Any]) -> None:
    """Elements of a row, from the first column on or by their columns; each a number or an array."""
    for column, value in values.items() if isinstance(values, Mapping) else enumerate(values):
        matrix[..., row, column] = value




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


def fixed_frame_matrix(unit: TireWheelUnit, speed: float, model: Model = "inextensional") -> FloatArray:
    """The constant state matrix seen from the fixed frame; of a unit that is not uniform, its mean's.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign.
    model : {"inextensional", "complete"}

    Returns
    -------
    ndarray, shape (n, n)
        F of z' = F z with z = [X', Y', y', X, Y, y], or [X', Y', U', V', y', X, Y, U, V, y]; with x' and x behind
        y' and y where the wheel gives fore and aft.
    """
    _check_speed(speed)
    system = fixed_frame(unit, model)
    return system.constant + speed * system.spin


def state_matrix(unit: TireWheelUnit, speed: float, time: float, model: Model = "inextensional") -> FloatArray:
    """The periodic state matrix A(t) seen from the rotating ring, (3.13) or (3.4), phi = Omega t.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign; the period is 2 pi/abs(Omega).
    time : float
        Time [s].
    model : {"inextensional", "complete"}

    Returns
    -------
    ndarray, shape (n, n)
        With the unit's own non-uniformity: :func:`.nonuniform.state_matrix`.
    """
    _check_speed(speed)
    if not math.isfinite(time):
        raise ValueError(f"time is {time!r}; it must be finite")
    if not unit.is_uniform:
        from . import nonuniform  # which builds on this module

        return nonuniform.state_matrix(unit, nonuniform.Nonuniformity.of(unit), speed, time, model)
    s, c = math.sin(speed * time), math.cos(speed * time)
    if model == "inextensional":
        return _periodic_inextensional(unit, speed, s, c)
    if model == "complete":
        return _periodic_complete(unit, speed, s, c)
    raise ValueError(f"model is {model!r}; it must be 'inextensional' or 'complete'")


def _periodic_inextensional(unit: TireWheelUnit, W: float, s: float, c: float) -> FloatArray:
    m, M, k_s, c_s = unit.ring_mass, unit.wheel_mass, unit.suspension_stiffness, unit.suspension_damping
    k_1 = unit.sidewall_stiffness
    kappa = k_1 / m
    d = 2.0 * unit.zeta_1 * unit.rigid_mode_frequency
    stiff = kappa - W * W
    reaction = unit.sidewall_damping != MODAL
    n = states(unit)
    A = np.zeros((n, n))
    alpha, beta, y = n // 2, n // 2 + 1, n // 2 + 2
    A[alpha:, :alpha] = np.eye(alpha)
    _set(A, 0, {0: -d, 1: 2.0 * W, alpha: -stiff, y: kappa * s})
    _set(A, 1, {0: -2.0 * W, 1: -d, beta: -stiff, y: kappa * c})
    _set(A, 2, {2: -c_s / M, alpha: k_1 * s / M, beta: k_1 * c / M, y: -(k_1 + k_s) / M})
    if reaction:  # d acts on (alpha - y s, beta - y c)'
        A[0, [2, y]] += [d * s, d * W * c]
        A[1, [2, y]] += [d * c, -d * W * s]
        A[2, :3] += [m * d * s / M, m * d * c / M, -m * d / M]
    if unit.is_held:
        return A
    m_x, k_x, c_x, x = unit.fore_aft_mass, unit.longitudinal_stiffness, unit.longitudinal_damping, y + 1
    A[0, x], A[1, x] = kappa * c, -kappa * s
    A[3, [alpha, beta, x, 3]] = [k_1 * c / m_x, -k_1 * s / m_x, -(k_1 + k_x) / m_x, -c_x / m_x]
    if reaction:  # d acts on (alpha - y s - x c, beta - y c + x s)'
        A[0, [3, x]] += [d * c, -d * W * s]
        A[1, [3, x]] += [-d * s, -d * W * c]
        A[2, x] += m * d * W / M
        A[3, [0, 1, 3, y]] += [m * d * c / m_x, -m * d * s / m_x, -m * d / m_x, -m * d * W / m_x]
    return A


def _periodic_complete(unit: TireWheelUnit, W: float, s: float, c: float) -> FloatArray:
    M, k_s, c_s = unit.wheel_mass, unit.suspension_stiffness, unit.suspension_damping
    A_1, B_1, C_1, _ = (float(value) for value in coefficients(unit, 1, W))
    rho_h = unit.surface_density
    g = math.pi * unit.radius * unit.width / M
    k_z, k_t = unit.radial_stiffness, unit.tangential_stiffness
    d = float(mode_damping(unit, 1, "complete"))
    half = states(unit, "complete") // 2
    damping, stiffness = np.zeros((half, half)), np.zeros((half, half))
    damping[:5, :5] = np.diag([d, d, d, d, c_s / M])
    damping[[0, 1], [2, 3]] = -2.0 * W
    damping[[2, 3], [0, 1]] = 2.0 * W
    stiffness[:5, :5] = np.diag([B_1, B_1, C_1, C_1, g * (k_z + k_t) + k_s / M])
    stiffness[0, 3] = stiffness[3, 0] = A_1
    stiffness[1, 2] = stiffness[2, 1] = -A_1
    springs = np.array([k_z, k_z, k_t, k_t])
    # The wheel's motion as the belt would have it: u_z = y sin(psi) + x cos(psi), u_theta = y cos(psi) - x sin(psi).
    along_y, along_x = np.array([s, c, c, -s]), np.array([c, -s, -s, -c])
    moved = [(4, M, along_y, along_x, 1.0)]  # number, mass, amplitudes, those of the other and the sign of their rate
    if not unit.is_held:
        m_x = unit.fore_aft_mass
        damping[5, 5] = unit.longitudinal_damping / m_x
        stiffness[5, 5] = (math.pi * unit.radius * unit.width * (k_z + k_t) + unit.longitudinal_stiffness) / m_x
        moved.append((5, m_x, along_x, along_y, -1.0))
    for k, mass, direction, across, sign in moved:
        stiffness[:4, k] = -springs * direction / rho_h
        stiffness[k, :4] = -g * M / mass * springs * direction
        if unit.sidewall_damping != MODAL:  # d acts on the rates of the net deflections
            c_1 = g * M * rho_h * d / mass
            damping[:4, k] -= d * direction
            stiffness[:4, k] -= d * W * sign * across
            damping[k, :4] -= c_1 * direction
            damping[k, k] += 2.0 * c_1
            if len(moved) == 2:
                stiffness[k, 9 - k] -= sign * 2.0 * c_1 * W
    A = np.zeros((2 * half, 2 * half))
    A[half:, :half] = np.eye(half)
    A[:half, :half], A[:half, half:] = -damping, -stiffness
    return A


def rotation(phase: float, speed: float, model: Model = "inextensional", held: bool = True) -> FloatArray:
    """The matrix that takes a fixed-frame state to the ring-frame state at phi = phase, spin Omega = speed.

    Parameters
    ----------
    phase, speed : float
        phi [rad] and Omega [rad/s].
    model : {"inextensional", "complete"}
    held : bool
        Whether the wheel is held fore and aft.

    Returns
    -------
    ndarray, shape (n, n)

    Notes
    -----
    r = R(-phi) R_fixed and r' = R(-phi) (R_fixed' - Omega J R_fixed), J = [[0, -1], [1, 0]], for each pair.
    """
    s, c = math.sin(phase), math.cos(phase)
    turn = np.array([[c, s], [-s, c]])
    pairs = 1 if model == "inextensional" else 2
    half = 2 * pairs + (1 if held else 2)
    T = np.zeros((2 * half, 2 * half))
    for first in range(0, 2 * pairs, 2):
        pair = slice(first, first + 2)
        shifted = slice(half + first, half + first + 2)
        T[pair, pair] = T[shifted, shifted] = turn
        T[pair, shifted] = -speed * turn @ np.array([[0.0, -1.0], [1.0, 0.0]])
    still = np.arange(2 * pairs, half)
    T[still, still] = T[half + still, half + still] = 1.0
    return T


def stability(
    unit: TireWheelUnit,
    speed: float,
    model: Model = "inextensional",
    *,
    contact: bool = False,
    n_max: int = 30,
) -> FloquetResult:
    """Floquet stability at a constant speed, of a uniform unit in closed form.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign. At standstill there is no period; the verdict comes from the exponents.
    model : {"inextensional", "complete"}
    contact : bool
        On the road, without lift-off (:func:`.contact.stability`), and not under a load that is given.
    n_max : int
        Highest belt harmonic on the road; under a given load only n = 1 reaches the wheel.

    Returns
    -------
    FloquetResult
        multipliers = exp(lambda T), lambda the eigenvalues of the fixed-frame matrix, T = 2 pi/abs(Omega). Of a unit
        whose sidewall is not uniform what :func:`.nonuniform.stability` says.
    """
    if contact:
        from . import contact as road  # which builds on this module

        return road.stability(unit, speed, model, n_max)
    if not unit.is_uniform:
        from . import nonuniform  # and this one

        return nonuniform.stability(unit, nonuniform.Nonuniformity.of(unit), speed, model)
    F = fixed_frame_matrix(unit, speed, model)
    period = 2.0 * math.pi / abs(speed) if abs(speed) > 1e-300 else None
    return floquet.analyze_constant(F, period)


def is_unstable(unit: TireWheelUnit, speed: float, model: Model = "inextensional") -> bool:
    """Whether the verdict of :func:`stability` at this speed is "unstable"; remembered.

    Of a unit that is not uniform, at this speed to 1 rad/s and above 20: what takes milliseconds is not done at each.
    """
    if not unit.is_uniform:
        speed = math.copysign(max(float(round(abs(speed))), 20.0), speed)
    return _is_unstable(unit, speed, model)


@lru_cache(maxsize=1024)
def _is_unstable(unit: TireWheelUnit, speed: float, model: Model) -> bool:
    try:
        return stability(unit, speed, model).verdict == "unstable"
    except ArithmeticError:  # it grows beyond all numbers in a turn, or a turn is too long
        return bool(np.linalg.eigvals(fixed_frame_matrix(unit, speed, model)).real.max() > 0.0)


@lru_cache(maxsize=256)
def critical_speed(
    unit: TireWheelUnit, model: Model = "inextensional", *, contact: bool = False, n_max: int = 30
) -> float | None:
    """The lowest speed at which the unit loses stability [rad/s], or None if it never does.

    Of a unit that is not uniform it is its mean's: :func:`.nonuniform.tongue_tips` has what comes beside.

    Parameters
    ----------
    unit : TireWheelUnit
    model : {"inextensional", "complete"}
    contact, n_max
        As of :func:`stability`; on the road it is :func:`.contact.critical_speed`.

    Notes
    -----
    F(Omega) = F_0 + Omega F_1 can only change its stability where one of its eigenvalues is zero, or two add up to
    zero. Then F is singular, or the matrix whose eigenvalues are all such sums, which acts on antisymmetric matrices X
    as F X + X F^T. Both are linear in the speed, so all these speeds are the real eigenvalues of two matrix pencils,
    and none is missed. Between two of them the verdict cannot change; it is read in the middle of each interval, and
    the crossing is then refined on the spectral abscissa.
    """
    if contact:
        from . import contact as road  # which builds on this module

        return road.critical_speed(unit, model, n_max)
    return next((speed for speed, lost in crossings(unit, model) if lost), None)


def crossings(unit: TireWheelUnit, model: Model = "inextensional") -> Iterator[tuple[float, bool]]:
    """Every speed > 0 at which stability is lost (True) or regained (False) [rad/s], from the lowest on.

    Found as the notes of :func:`critical_speed` say. Backward, they are the same.
    """
    system = fixed_frame(unit, model)
    F_0, F_1 = system.constant, system.spin
    if not F_1.any():
        return
    scale = _balance(F_0)
    F_0, F_1 = F_0 * scale, F_1 * scale
    roots = np.concatenate([_singular_at(F_0, F_1), _singular_at(_sums_of_two(F_0), _sums_of_two(F_1))])
    size = float(np.abs(F_0).max())
    roots = roots[np.abs(roots) < 1e8 * size]  # the pencils' infinite eigenvalues, which rounding makes finite
    nearly_real = np.abs(roots.imag) <= 1e-6 * np.abs(roots)  # rounding may split a double root
    candidates = np.unique(roots[nearly_real & (roots.real > 0.0)].real)

    def abscissa(speed: float) -> float:
        return float(np.linalg.eigvals(F_0 + speed * F_1).real.max())

    noise = 1e-12 * size  # an undamped unit stays on the axis, but for rounding
    edges = np.concatenate([[0.0], candidates, [2.0 * candidates[-1]]]) if candidates.size else np.zeros(1)
    middles = 0.5 * (edges[:-1] + edges[1:])
    heights = np.linalg.eigvals(F_0 + middles[:, None, None] * F_1).real.max(axis=1)
    for k, candidate in enumerate(candidates):
        (before, after), (low, high) = middles[k : k + 2], heights[k : k + 2]
        if (low > noise) != (high > noise):
            opposite = low < 0.0 < high or high < 0.0 < low
            speed = root_between(abscissa, before, after, low, high, 1e-6) if opposite else candidate
            yield float(speed), high > noise


def _sums_of_two(F: FloatArray) -> FloatArray:
    """X -> F X + X F^T for X = -X^T, a matrix (n (n - 1)/2) whose eigenvalues are the sums of two different ones of F.

    Twice the bialternate product with I (Fuller, *J. Math. Anal. Appl.* 23, 1968): a quarter of F (x) I + I (x) F.
    """
    n = len(F)
    one = np.eye(n)
    p, q = np.tril_indices(n, -1)
    both = F[:, None, :, None] * one[:, None] + one[:, None, :, None] * F[:, None]  # of X[i, k] from X[j, l]
    rows = both[p, q]
    return np.asarray(rows[:, p, q] - rows[:, q, p])


def _singular_at(constant: FloatArray, slope: FloatArray) -> ComplexArray:
    """The s at which constant + s slope has a lower rank than at others; and others, where it has a low one at all.

    With s = s_0 + 1/mu, mu are the eigenvalues of -(constant + s_0 slope)^-1 slope. Of a unit without damping the sum
    of an eigenvalue and its conjugate is zero at every speed; what is left of full rank is then seen through two
    arbitrary matrices, which adds speeds of no meaning and loses none (Hochstenbach, Mehl & Plestenjak, *SIAM J. Matrix
    Anal. Appl.* 40, 2019).
    """
    shift = -0.37 * float(np.abs(constant).max())
    at_shift = constant + shift * slope
    sizes = np.linalg.svd(at_shift, compute_uv=False)
    rank = int(np.count_nonzero(sizes > 1e-11 * sizes[0]))
    if rank < len(constant):
        left, right = np.random.default_rng(1992).standard_normal((2, rank, len(constant)))
        at_shift, slope = left @ at_shift @ right.T, left @ slope @ right.T
    inverse = np.linalg.eigvals(np.linalg.solve(at_shift, -slope))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(shift + 1.0 / inverse[inverse != 0.0], dtype=np.complex128)


def _balance(F: FloatArray) -> FloatArray:
    """Factors S_i^-1 S_j that bring velocities and displacements to one scale, for a matrix like F."""
    size = np.repeat([1.0, _stiffest(F)], len(F) // 2)  # velocities as they are, displacements times omega
    return np.outer(size, 1.0 / size)


def _stiffest(F: FloatArray) -> float:
    """The highest frequency there can be, about: the root of the largest stiffness over mass [rad/s]."""
    half = len(F) // 2
    return math.sqrt(float(np.abs(F[:half, half:]).max()))


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
        if not unit.is_held:
            series = series * (unit.sidewall_stiffness / unit.longitudinal_stiffness + 1.0)
        K = 1.0 / (1.0 + ratio * ratio * series)
    else:
        K = np.ones_like(omega)
    return float(K) if K.ndim == 0 else K


def __getattr__(name: str) -> Any:
    if name in ("StabilityMap", "TransmissibilityMap", "stability_map", "transmissibility_map"):
        from . import maps  # which builds on this module

        return getattr(maps, name)
    if name in ("frequency_response", "whirl_frequencies"):
        from . import response  # and this one

        return getattr(response, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _check_speed(speed: float) -> None:
    if not math.isfinite(speed):
        raise ValueError(f"speed is {speed!r}; it must be finite")
