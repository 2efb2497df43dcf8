"""n = 1 of the ring and the wheel on its suspension: the matrices of their equations.

Equation numbers are those of Huang & Hsu (1992). The ring-frame state is (5.1)

    inextensional  z = [alpha', beta', y', alpha, beta, y]
    complete       z = [alpha', beta', xi', eta', y', alpha, beta, xi, eta, y]

and the fixed-frame state has the same shape, with each pair turned by phi = int Omega dt:
X = alpha cos phi - beta sin phi, Y = alpha sin phi + beta cos phi, and likewise U, V from xi, eta.
A wheel that is longitudinally compliant has x' behind y' and x behind y, along the paper's X: 8 and 12 states.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .coefficients import coefficients, mode_damping
from .unit import MODAL, TireWheelUnit

__all__ = [
    "FixedFrame",
    "Model",
    "check_speed",
    "fixed_frame",
    "fixed_frame_matrix",
    "rotation",
    "stacked_frames",
    "states",
    "uniform_state_matrix",
]

Model = Literal["complete", "inextensional"]
FloatArray = NDArray[np.float64]


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
    that frame the centrifugal parts of A_1, B_1, C_1, those of the hoop tension among them, and the Coriolis terms
    cancel, so the stiffness does not depend on Omega; what the pressure puts into the hoop tension stays. What is left
    of rotation is the gyroscopic coupling of the complete model and the circulatory term -i d Omega Z of a damper that
    turns with the ring. docs/model.md has each step.
    """
    system = _builder(model)(unit)
    for matrix in system:
        matrix.setflags(write=False)  # they are shared
    return system


def stacked_frames(units: TireWheelUnit, shape: tuple[int, ...], model: Model = "inextensional") -> FixedFrame:
    """:func:`fixed_frame` of a unit whose fields are arrays, broadcast to ``shape``, which matrices have in front."""
    return _builder(model)(units, shape)


def states(unit: TireWheelUnit, model: Model = "inextensional") -> int:
    """The number of states: 6 or 10, and two more for a wheel that is compliant fore and aft."""
    return (6 if model == "inextensional" else 10) + 2 * (not unit.is_longitudinally_rigid)


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
    return system if unit.is_longitudinally_rigid else _inextensional_fore_and_aft(unit, system, kappa, d)


def _inextensional_fore_and_aft(unit: TireWheelUnit, rigid: FixedFrame, kappa: float, d: float) -> FixedFrame:
    """With x, which the sidewall's forces act on as they do on y; docs/model.md, section 5."""
    m, M, m_x, k_1 = unit.ring_mass, unit.wheel_mass, unit.fore_aft_mass, unit.sidewall_stiffness
    k_x, c_x = unit.longitudinal_stiffness, unit.longitudinal_damping
    system = _with_place_for_x(rigid)
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


def _with_place_for_x(rigid: FixedFrame) -> FixedFrame:
    """The same system with a row and a column of zeros for x' behind y' and for x behind y."""
    *shape, n, _ = rigid.constant.shape
    old = np.array([k for k in range(n + 2) if k not in (n // 2, n + 1)])
    system = _zeros(tuple(shape), n + 2)
    for large, small in zip(system[:2], rigid[:2], strict=True):
        large[..., old[:, None], old] = small
    system.input[..., old, :] = rigid.input
    system.output[..., old] = rigid.output
    system.output_spin[..., old] = rigid.output_spin
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
    return system if unit.is_longitudinally_rigid else _complete_fore_and_aft(unit, system, d)


def _complete_fore_and_aft(unit: TireWheelUnit, rigid: FixedFrame, d: Any) -> FixedFrame:
    """With x, on which the belt's X pulls and its V pushes; docs/model.md, section 5."""
    M, m_x, k_x, c_x = unit.wheel_mass, unit.fore_aft_mass, unit.longitudinal_stiffness, unit.longitudinal_damping
    area = math.pi * unit.radius * unit.width
    radial, tangential = unit.radial_stiffness, unit.tangential_stiffness
    system = _with_place_for_x(rigid)
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
        y' and y where the wheel is compliant fore and aft.
    """
    check_speed(speed)
    system = fixed_frame(unit, model)
    return system.constant + speed * system.spin


def uniform_state_matrix(unit: TireWheelUnit, speed: float, time: float, model: Model = "inextensional") -> FloatArray:
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
        Of the unit's mean, where it is not uniform.
    """
    check_speed(speed)
    if not math.isfinite(time):
        raise ValueError(f"time is {time!r}; it must be finite")
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
    if unit.is_longitudinally_rigid:
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
    if not unit.is_longitudinally_rigid:
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


def rotation(
    phase: float, speed: float, model: Model = "inextensional", longitudinally_rigid: bool = True
) -> FloatArray:
    """The matrix that takes a fixed-frame state to the ring-frame state at phi = phase, spin Omega = speed.

    Parameters
    ----------
    phase, speed : float
        phi [rad] and Omega [rad/s].
    model : {"inextensional", "complete"}
    longitudinally_rigid : bool
        Whether the wheel cannot move fore and aft.

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
    half = 2 * pairs + (1 if longitudinally_rigid else 2)
    T = np.zeros((2 * half, 2 * half))
    for first in range(0, 2 * pairs, 2):
        pair = slice(first, first + 2)
        shifted = slice(half + first, half + first + 2)
        T[pair, pair] = T[shifted, shifted] = turn
        T[pair, shifted] = -speed * turn @ np.array([[0.0, -1.0], [1.0, 0.0]])
    still = np.arange(2 * pairs, half)
    T[still, still] = T[half + still, half + still] = 1.0
    return T


def check_speed(speed: float) -> None:
    """``ValueError`` unless a speed is finite."""
    if not math.isfinite(speed):
        raise ValueError(f"speed is {speed!r}; it must be finite")
