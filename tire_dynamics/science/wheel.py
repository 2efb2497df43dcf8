"""The n = 1 mode of the ring and the wheel on its suspension: matrices, stability, transmissibility.

Equation numbers are those of Huang & Hsu (1992). The ring-frame state is (5.1)

    inextensional  z = [alpha', beta', y', alpha, beta, y]
    complete       z = [alpha', beta', xi', eta', y', alpha, beta, xi, eta, y]

and the fixed-frame state has the same shape, with each pair turned by phi = int Omega dt:
X = alpha cos phi - beta sin phi, Y = alpha sin phi + beta cos phi, and likewise U, V from xi, eta.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from . import floquet
from .coefficients import coefficients, mode_damping
from .elementary import cos_sin
from .floquet import FloquetResult
from .stepping import ExactStepper, solve_in_order
from .unit import MODAL, TireWheelUnit

if TYPE_CHECKING:
    from .maps import StabilityMap, TransmissibilityMap, stability_map, transmissibility_map

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
    "is_unstable",
    "output_matrices",
    "ring_centre",
    "rotation",
    "stability",
    "stability_map",
    "stacked_frames",
    "state_matrix",
    "stepper",
    "transmissibility",
    "transmissibility_map",
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

    Notes
    -----
    Complex amplitudes Z = X + i Y turn the rotation into z = Z exp(-i phi), hence z' -> Z' - i Omega Z. In
    that frame the centrifugal, hoop-tension and Coriolis parts of A_1, B_1, C_1 cancel, so the stiffness does
    not depend on Omega; what is left of rotation is the gyroscopic coupling of the complete model and the
    circulatory term -i d Omega Z of a damper that turns with the ring. docs/model.md has each step.
    """
    system = _builder(model)(unit, _spread(unit))
    for matrix in system:
        matrix.setflags(write=False)  # they are shared
    return system


def stacked_frames(units: TireWheelUnit, shape: tuple[int, ...], model: Model = "inextensional") -> FixedFrame:
    """:func:`fixed_frame` of a unit whose fields are arrays, broadcast to ``shape``, which matrices have in front.

    The columns of ``input`` are those of a point load.
    """
    return _builder(model)(units, 1.0, shape)


def _builder(model: str) -> Callable[..., FixedFrame]:
    if model == "inextensional":
        return _inextensional
    if model == "complete":
        return _complete
    raise ValueError(f"model is {model!r}; it must be 'inextensional' or 'complete'")


def _inextensional(unit: TireWheelUnit, spread: float, shape: tuple[int, ...] = ()) -> FixedFrame:
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
    _set(force, 0, {1: -spread / m})
    _set(force, 1, {0: spread / m})
    return FixedFrame(constant, spin, force, output, output_spin)


def _complete(unit: TireWheelUnit, spread: float, shape: tuple[int, ...] = ()) -> FixedFrame:
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
    _set(force, 1, {0: spread / half_mass})
    _set(force, 3, {1: spread / half_mass})
    return FixedFrame(constant, spin, force, output, output_spin)


def _zeros(shape: tuple[int, ...], states: int) -> FixedFrame:
    n = states
    return FixedFrame(*(np.zeros((*shape, *size)) for size in ((n, n), (n, n), (n, 2), (2, n), (2, n))))


def _set(matrix: FloatArray, row: int, values: Sequence[Any] | Mapping[int, Any]) -> None:
    """Elements of a row, from the first column on or by their columns; each a number or an array."""
    for column, value in values.items() if isinstance(values, Mapping) else enumerate(values):
        matrix[..., row, column] = value


def _spread(unit: TireWheelUnit) -> float:
    """What a load that is spread over the patch leaves of its first harmonic, sin(phi_c)/phi_c."""
    half = unit.contact_half_angle
    return float(cos_sin(half)[1]) / half if half else 1.0


@lru_cache(maxsize=256)
def stepper(unit: TireWheelUnit, model: Model = "inextensional") -> ExactStepper:
    """The exact stepper of the fixed-frame system, inputs [load, traction]."""
    system = fixed_frame(unit, model)
    half = len(system.constant) // 2
    scale = np.repeat([1.0, 1.0 / _stiffest(system.constant)], half)
    return ExactStepper([system.constant, system.spin], system.input, scale)


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
    """The fixed-frame state after a jump of the speed [rad/s].

    Notes
    -----
    In the fixed frame the Euler terms of the complete model are i Omega' (Z_1 - i Z_2) in Z_1'' and
    -Omega' (Z_1 - i Z_2) in Z_2'', with Z_1 - i Z_2 = (X + V) + i (Y - U). They vanish for a ring that does not
    stretch, where U = Y and V = -X.
    """
    if model == "inextensional" or change == 0.0:
        return state
    X, Y, U, V = state[5:9]
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

    Returns
    -------
    ndarray, shape (..., 4)
        (a, b, c, d) of u_z = a cos psi + b sin psi and u_theta = c cos psi + d sin psi [m].
    """
    y = state[..., -1]
    if model == "inextensional":
        X, Y = state[..., 3], state[..., 4]
        return np.stack([X, Y - y, Y - y, -X], axis=-1)
    X, Y, U, V = (state[..., k] for k in range(5, 9))
    return np.stack([X, Y - y, U - y, V], axis=-1)


def ring_centre(state: FloatArray, model: Model = "inextensional") -> FloatArray:
    """The ring's centre of mass (X, Y) in the paper's axes [m], shape (..., 2), from fixed-frame states.

    The mean of u_z e_r + u_theta e_theta over the ring: ((X - V)/2, (Y + U)/2), which is (X, Y) if it cannot stretch.
    """
    if model == "inextensional":
        return state[..., 3:5]
    X, Y, U, V = (state[..., k] for k in range(5, 9))
    return 0.5 * np.stack([X - V, Y + U], axis=-1)


def fixed_frame_matrix(unit: TireWheelUnit, speed: float, model: Model = "inextensional") -> FloatArray:
    """The constant state matrix seen from the fixed frame.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign.
    model : {"inextensional", "complete"}

    Returns
    -------
    ndarray, shape (6, 6) or (10, 10)
        F of z' = F z with z = [X', Y', y', X, Y, y], or [X', Y', U', V', y', X, Y, U, V, y].
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
    ndarray, shape (6, 6) or (10, 10)
    """
    _check_speed(speed)
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
    A = np.zeros((6, 6))
    A[3:, :3] = np.eye(3)
    #            alpha'   beta'      y'       alpha        beta         y
    A[0, :] = [     -d, 2.0 * W,    0.0,     -stiff,        0.0,  kappa * s]  # fmt: skip
    A[1, :] = [-2.0 * W,     -d,    0.0,        0.0,     -stiff,  kappa * c]  # fmt: skip
    A[2, :] = [    0.0,     0.0, -c_s / M, k_1 * s / M, k_1 * c / M, -(k_1 + k_s) / M]  # fmt: skip
    if unit.sidewall_damping != MODAL:  # d acts on (alpha - y s, beta - y c)'
        A[0, [2, 5]] += [d * s, d * W * c]
        A[1, [2, 5]] += [d * c, -d * W * s]
        A[2, :3] += [m * d * s / M, m * d * c / M, -m * d / M]
    return A


def _periodic_complete(unit: TireWheelUnit, W: float, s: float, c: float) -> FloatArray:
    M, k_s, c_s = unit.wheel_mass, unit.suspension_stiffness, unit.suspension_damping
    A_1, B_1, C_1, _ = (float(value) for value in coefficients(unit, 1, W))
    rho_h = unit.surface_density
    g = math.pi * unit.radius * unit.width / M
    k_z, k_t = unit.radial_stiffness, unit.tangential_stiffness
    d = float(mode_damping(unit, 1, "complete"))
    damping = np.diag([d, d, d, d, c_s / M])
    damping[[0, 1], [2, 3]] = -2.0 * W
    damping[[2, 3], [0, 1]] = 2.0 * W
    stiffness = np.diag([B_1, B_1, C_1, C_1, g * (k_z + k_t) + k_s / M])
    stiffness[0, 3] = stiffness[3, 0] = A_1
    stiffness[1, 2] = stiffness[2, 1] = -A_1
    coupling = np.array([-k_z * s, -k_z * c, -k_t * c, k_t * s])
    stiffness[:4, 4] = coupling / rho_h
    stiffness[4, :4] = g * coupling
    if unit.sidewall_damping != MODAL:  # d acts on (alpha - y s, beta - y c, xi - y c, eta + y s)'
        direction = np.array([s, c, c, -s])
        damping[:4, 4] -= d * direction
        stiffness[:4, 4] -= d * W * np.array([c, -s, -s, -c])
        damping[4, :4] -= g * rho_h * d * direction
        damping[4, 4] += 2.0 * g * rho_h * d
    A = np.zeros((10, 10))
    A[5:, :5] = np.eye(5)
    A[:5, :5], A[:5, 5:] = -damping, -stiffness
    return A


def rotation(phase: float, speed: float, model: Model = "inextensional") -> FloatArray:
    """The matrix that takes a fixed-frame state to the ring-frame state at phi = phase, spin Omega = speed.

    Notes
    -----
    r = R(-phi) R_fixed and r' = R(-phi) (R_fixed' - Omega J R_fixed), J = [[0, -1], [1, 0]], for each pair.
    """
    s, c = math.sin(phase), math.cos(phase)
    turn = np.array([[c, s], [-s, c]])
    pairs = 1 if model == "inextensional" else 2
    half = 2 * pairs + 1
    T = np.zeros((2 * half, 2 * half))
    for first in range(0, 2 * pairs, 2):
        pair = slice(first, first + 2)
        shifted = slice(half + first, half + first + 2)
        T[pair, pair] = T[shifted, shifted] = turn
        T[pair, shifted] = -speed * turn @ np.array([[0.0, -1.0], [1.0, 0.0]])
    T[half - 1, half - 1] = T[-1, -1] = 1.0
    return T


def stability(unit: TireWheelUnit, speed: float, model: Model = "inextensional") -> FloquetResult:
    """Floquet stability at a constant speed, in closed form.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign. At standstill there is no period; the verdict comes from the exponents.
    model : {"inextensional", "complete"}

    Returns
    -------
    FloquetResult
        multipliers = exp(lambda T), lambda the eigenvalues of the fixed-frame matrix, T = 2 pi/abs(Omega).
    """
    F = fixed_frame_matrix(unit, speed, model)
    period = 2.0 * math.pi / abs(speed) if abs(speed) > 1e-300 else None
    return floquet.analyze_constant(F, period)


@lru_cache(maxsize=1024)
def is_unstable(unit: TireWheelUnit, speed: float, model: Model = "inextensional") -> bool:
    """Whether the verdict of :func:`stability` at this speed is "unstable"; remembered."""
    return stability(unit, speed, model).verdict == "unstable"


@lru_cache(maxsize=256)
def critical_speed(unit: TireWheelUnit, model: Model = "inextensional") -> float | None:
    """The lowest speed at which the unit loses stability [rad/s], or None if it never does.

    Notes
    -----
    F(Omega) = F_0 + Omega F_1 can only change its stability where two of its eigenvalues add up to zero, and
    then the Kronecker sum F (x) I + I (x) F is singular: all such speeds are the real eigenvalues of one
    matrix pencil, so none is missed. Between two of them the verdict cannot change; it is read in the middle
    of each interval, and the crossing is then refined on the spectral abscissa.
    """
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
    with np.errstate(divide="ignore", invalid="ignore"):
        roots = np.asarray(linalg.eigvals(_kronecker_sum(F_0), -_kronecker_sum(F_1)), dtype=np.complex128)
    size = float(np.abs(F_0).max())
    roots = roots[np.abs(roots) < 1e8 * size]  # the pencil's infinite eigenvalues, which rounding makes finite
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
            speed = _root(abscissa, before, after, low, high) if opposite else candidate
            yield float(speed), high > noise


def _root(f: Callable[[float], float], a: float, b: float, f_a: float, f_b: float) -> float:
    """Where f changes its sign between a and b, to 1e-6; by the Illinois method, which keeps the root enclosed."""
    while abs(b - a) > 1e-6:
        c = b - f_b * (b - a) / (f_b - f_a)
        if not min(a, b) < c < max(a, b):
            c = 0.5 * (a + b)
        f_c = f(c)
        if f_c == 0.0:
            return c
        if (f_c < 0.0) != (f_b < 0.0):
            a, f_a = b, f_b
        else:
            f_a *= 0.5
        if abs(c - b) < 1e-7:  # the root is this close, on one side or the other
            return c
        b, f_b = c, f_c
    return b


def _kronecker_sum(F: FloatArray) -> FloatArray:
    """F (x) I + I (x) F, whose eigenvalues are the sums of any two of F."""
    n = len(F)
    one = np.eye(n)
    both = F[:, None, :, None] * one[:, None] + one[:, None, :, None] * F[:, None]
    return np.asarray(both.reshape(n * n, n * n))


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
        1/(1 + (2 zeta_1 Omega/omega_1)^2 (k_1 + k_s)/k_s) for modal damping; 1 for damping with a reaction,
        whose dashpots cannot carry a constant force to anywhere but the wheel.
    """
    omega = np.asarray(speed, dtype=np.float64)
    if not np.isfinite(omega).all():
        raise ValueError(f"speed is {speed!r}; it must be finite")
    if unit.sidewall_damping == MODAL:
        ratio = 2.0 * unit.zeta_1 * omega / unit.rigid_mode_frequency
        K = 1.0 / (1.0 + ratio * ratio * (unit.sidewall_stiffness / unit.suspension_stiffness + 1.0))
    else:
        K = np.ones_like(omega)
    return float(K) if K.ndim == 0 else K


def __getattr__(name: str) -> Any:
    if name in ("StabilityMap", "TransmissibilityMap", "stability_map", "transmissibility_map"):
        from . import maps  # which builds on this module

        return getattr(maps, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _check_speed(speed: float) -> None:
    if not math.isfinite(speed):
        raise ValueError(f"speed is {speed!r}; it must be finite")
