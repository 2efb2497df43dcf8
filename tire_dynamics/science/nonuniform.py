"""A sidewall whose stiffness varies around the tire: equations, stability, tongues of parametric instability.

With k_z(theta) = k_z [1 + sum_j e_j cos j(theta - chi_j)], and likewise k_theta, the sidewall's stiffness turns with
the ring while the suspension stands: no change of frame makes that constant, and stability is a matter of Floquet
theory. docs/model.md derives the equations. Two forms of them are here:

- n = 1 and the wheel in the fixed frame, z' = (C + Omega S + cos(2 phi) P + sin(2 phi) Q) z with the states of
  ``wheel.fixed_frame``. Of all harmonics only the second acts here, and half a turn is a period.
- The modes n = 0 to N and the wheel in the ring's frame, where harmonic j couples n with n + j, n - j and j - n. There
  q = [alpha_0, xi_0, alpha_1, beta_1, xi_1, eta_1, alpha_2, ..., y, x] for the complete model, and for the
  inextensional one [xi_0, alpha_1, beta_1, alpha_2, beta_2, ..., y, x]; z = [q', q]; x only where the wheel gives fore
  and aft.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import floquet, ring, wheel
from .coefficients import coefficients
from .elementary import cos_sin
from .floquet import FloquetResult
from .harmonics import Harmonic, check_factor, harmonics
from .periodic import Transition, Trigonometric, transition
from .roots import root_between
from .unit import TireWheelUnit

__all__ = [
    "Nonuniformity",
    "PeriodicFrame",
    "Tip",
    "TongueMap",
    "coordinates",
    "coupling",
    "fixed_frame_matrix",
    "is_genuine",
    "nearest_tongue",
    "periodic_frame",
    "sidewall",
    "stability",
    "state_matrix",
    "tongue_map",
    "tongue_tips",
]

Model = Literal["complete", "inextensional"]
FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class Nonuniformity:
    """How the sidewall's stiffness varies around the ring.

    A bad value raises ``ValueError`` with the field, the value and its bound.

    Parameters
    ----------
    radial, tangential : sequence of (int, float, float)
        Harmonics j >= 1, each once, amplitudes e_j >= 0 and angles chi_j [rad] of k_z and k_theta: the factor
        1 + sum_j e_j cos j(theta - chi_j) must be > 0 at every theta.
    """

    radial: tuple[Harmonic, ...] = ()
    tangential: tuple[Harmonic, ...] = ()

    def __post_init__(self) -> None:
        for name in ("radial", "tangential"):
            value = harmonics(name, getattr(self, name))
            check_factor(name, value)
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, unit: TireWheelUnit) -> Nonuniformity:
        """The one that a unit's own fields describe."""
        return cls(unit.radial_nonuniformity, unit.tangential_nonuniformity)

    @property
    def is_uniform(self) -> bool:
        """Whether every amplitude is zero."""
        return not any(e for _, e, _ in (*self.radial, *self.tangential))

    def scaled(self, factor: float) -> Nonuniformity:
        """The same with every amplitude times a factor >= 0."""
        fields = ([(j, factor * e, chi) for j, e, chi in each] for each in (self.radial, self.tangential))
        return Nonuniformity(*(tuple(each) for each in fields))

    def second_harmonic(self, unit: TireWheelUnit) -> complex:
        """eps exp(2 i chi): k_1 (1 + eps) along the angle chi of the ring and k_1 (1 - eps) across it."""
        k_z, k_t = unit.radial_stiffness, unit.tangential_stiffness
        z, t = _second(self.radial), _second(self.tangential)
        both = 2.0 * (k_z + k_t)
        return complex((k_z * z.real - k_t * t.real) / both, (k_z * z.imag - k_t * t.imag) / both)

    def epsilon(self, unit: TireWheelUnit) -> float:
        """The eps of :meth:`second_harmonic`, what n = 1 of the inextensional model feels."""
        return abs(self.second_harmonic(unit))


def _second(some: tuple[Harmonic, ...]) -> complex:
    """e exp(2 i chi) of the second harmonic, with the same bits on every machine, as the steps have them."""
    for j, e, chi in some:
        if j == 2:
            cosine, sine = cos_sin(2.0 * chi)
            return complex(e * float(cosine), e * float(sine))
    return 0j


# -- n = 1 and the wheel, fixed frame -----------------------------------------------------------------------------


class PeriodicFrame(NamedTuple):
    """z' = (constant + Omega spin + cos(2 phi) cosine + sin(2 phi) sine) z, the first two of ``wheel.fixed_frame``."""

    constant: FloatArray
    spin: FloatArray
    cosine: FloatArray
    sine: FloatArray


def is_genuine(unit: TireWheelUnit, model: Model = "inextensional", n_max: int = 1) -> bool:
    """Whether a unit's equations are periodic for good, and no change of frame makes them constant.

    Parameters
    ----------
    unit : TireWheelUnit
    model : {"inextensional", "complete"}
    n_max : int
        Highest wavenumber, as of :func:`state_matrix`.

    Returns
    -------
    bool
        False where the sidewall is the same all around as far as n = 1 feels it, which the fixed frame makes constant,
        and where the wheel's support has no direction, which axes that turn with the ring make so. n = 1 feels the
        second harmonic, and j through n = j - 1 or j + 1.
    """
    sidewall = Nonuniformity.of(unit)
    acts = any(_anisotropy(unit, sidewall, _checked(model)))
    if n_max > 1:
        acts = acts or any(e and j - 1 <= n_max for j, e, _ in (*sidewall.radial, *sidewall.tangential))
    vertical = unit.suspension_stiffness, unit.suspension_damping, unit.wheel_mass
    return acts and vertical != (unit.longitudinal_stiffness, unit.longitudinal_damping, unit.fore_aft_mass)


@lru_cache(maxsize=256)
def periodic_frame(unit: TireWheelUnit, nonuniformity: Nonuniformity, model: Model = "inextensional") -> PeriodicFrame:
    """The parts of the n = 1 system with the wheel, in the fixed frame.

    Parameters
    ----------
    unit : TireWheelUnit
    nonuniformity : Nonuniformity
        Its second harmonic acts here, and nothing else of it.
    model : {"inextensional", "complete"}

    Returns
    -------
    PeriodicFrame
        Its matrices are shared, and cannot be written to.

    Notes
    -----
    A stiffness k (1 +- e) along and across the angle chi of the ring pulls Z = X + i Y back with
    k [Z + e exp(2 i (chi + phi)) conj(Z)], Z relative to the wheel.
    """
    system = wheel.fixed_frame(unit, model)
    half = len(system.constant) // 2
    net, masses, _, strengths = sidewall(unit, nonuniformity, model)
    cosine, sine = np.zeros((2, 2 * half, 2 * half))
    for pair, strength in enumerate(strengths):
        seen = net[2 * pair : 2 * pair + 2]
        a, b = strength.real, strength.imag
        cosine[:half, half:] -= seen.T @ np.array([[a, b], [b, -a]]) @ seen / masses[:, None]
        sine[:half, half:] -= seen.T @ np.array([[-b, a], [a, b]]) @ seen / masses[:, None]
    return PeriodicFrame(system.constant, system.spin, _shared(cosine), _shared(sine))


def sidewall(
    unit: TireWheelUnit, nonuniformity: Nonuniformity, model: Model = "inextensional"
) -> tuple[FloatArray, FloatArray, FloatArray, list[complex]]:
    """How the sidewall's springs, p kinds of them, act between belt and wheel in n = 1.

    Parameters
    ----------
    unit : TireWheelUnit
    nonuniformity : Nonuniformity
    model : {"inextensional", "complete"}

    Returns
    -------
    net : ndarray, shape (2 p, h)
        What they see of the coordinates q: [X - x, Y - y], and of the complete model [U - y, V + x] behind.
    masses : ndarray, shape (h,)
        Of the coordinates [kg].
    along_x : ndarray, shape (2 p,)
        The force on the wheel along X is this times their forces; what ``net`` has for x, but for the sign.
    strengths : list of complex, p
        k e exp(2 i chi) [N/m]: the stiffness is k (1 +- e) along the angle chi of the ring and across.
    """
    area = math.pi * unit.radius * unit.width
    if model == "inextensional":
        net = np.array([[1.0, 0.0, 0.0, -1.0], [0.0, 1.0, -1.0, 0.0]])
        springs, mass = [unit.sidewall_stiffness], unit.ring_mass
    else:
        net = np.concatenate([np.eye(4), [[0.0, -1.0], [-1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]]], axis=1)
        springs = [area * unit.radial_stiffness, area * unit.tangential_stiffness]
        mass = area * unit.surface_density
    masses = np.array([mass] * len(net) + [unit.wheel_mass, unit.fore_aft_mass])
    half = len(masses) - unit.is_held
    parts = zip(springs, _anisotropy(unit, nonuniformity, model), strict=True)
    strengths = [complex(k * e.real, k * e.imag) for k, e in parts]
    return net[:, :half], masses[:half], -net[:, -1], strengths


def _anisotropy(unit: TireWheelUnit, nonuniformity: Nonuniformity, model: Model) -> list[complex]:
    """e exp(2 i chi) of each of those springs."""
    if model == "inextensional":
        return [nonuniformity.second_harmonic(unit)]
    both = _second(nonuniformity.radial), _second(nonuniformity.tangential)
    return [complex(0.5 * e.real, 0.5 * e.imag) for e in both]


def fixed_frame_matrix(
    unit: TireWheelUnit, nonuniformity: Nonuniformity, speed: float, phase: float, model: Model = "inextensional"
) -> FloatArray:
    """The state matrix of n = 1 and the wheel seen from the fixed frame.

    Parameters
    ----------
    unit : TireWheelUnit
    nonuniformity : Nonuniformity
    speed : float
        Spin Omega [rad/s], either sign.
    phase : float
        phi, the angle that the ring has turned [rad]; the period is pi.
    model : {"inextensional", "complete"}

    Returns
    -------
    ndarray, shape (n, n)
        With the states of :func:`.wheel.fixed_frame_matrix`, whose bits it has where the second harmonic is zero.
    """
    if not math.isfinite(phase):
        raise ValueError(f"phase is {phase!r}; it must be finite")
    matrix = wheel.fixed_frame_matrix(unit, speed, model)
    parts = periodic_frame(unit, nonuniformity, model)
    if parts.cosine.any():
        matrix = matrix + math.cos(2.0 * phase) * parts.cosine + math.sin(2.0 * phase) * parts.sine
    return matrix


# -- modes n = 0 to N and the wheel, ring's frame -------------------------------------------------------------------


def state_matrix(
    unit: TireWheelUnit,
    nonuniformity: Nonuniformity,
    speed: float,
    time: float,
    model: Model = "inextensional",
    n_max: int = 1,
) -> FloatArray:
    """The periodic state matrix A(t) seen from the rotating ring, phi = Omega t.

    Parameters
    ----------
    unit : TireWheelUnit
    nonuniformity : Nonuniformity
    speed : float
        Spin Omega [rad/s], either sign; the period is 2 pi/abs(Omega).
    time : float
        Time [s].
    model : {"inextensional", "complete"}
    n_max : int
        Highest wavenumber. 1 is n = 1 and the wheel alone, with the states of :func:`.wheel.state_matrix`; from 2 on,
        the modes n = 0 to n_max and the wheel, with the states that the module's notes have.

    Returns
    -------
    ndarray, shape (n, n)
        For n_max = 1 the bits of :func:`.wheel.state_matrix` where the second harmonic is zero.

    Notes
    -----
    Inextensional: uniform parts are the paper's, (3.10)-(3.13). Coupling is what the sidewall's potential energy gives
    with the static shape z_2 = -i (A_n/C_n) z_1 behind the paper's elimination, z_2 = -i z_1 for n = 1, over the masses
    pi a b rho h (A_n + n C_n)/(n C_n) that go with it; n = 0 is the wind-up xi_0.
    """
    matrix = _uniform(unit, speed, time, model, n_max)
    stiffness, mass = coupling(unit, nonuniformity.radial, nonuniformity.tangential, speed, model, n_max)
    if stiffness.any():
        constant, sine, cosine = _seen_by_the_sidewall(unit, model, n_max)
        seen = constant + math.sin(speed * time) * sine + math.cos(speed * time) * cosine
        half = len(mass)
        matrix[:half, half:] -= seen.T @ stiffness @ seen / mass[:, None]
    return matrix


def _kinds(model: Model, n: int) -> tuple[str, ...]:
    """Coordinates of a wavenumber."""
    if model == "inextensional":
        return ("alpha", "beta") if n else ("xi",)
    return ("alpha", "beta", "xi", "eta") if n else ("alpha", "xi")


def coordinates(model: Model, n_max: int) -> list[tuple[int, str]]:
    """The ring's coordinates in their order: wavenumber, and "alpha", "beta", "xi" or "eta"."""
    return [(n, kind) for n in range(1 if n_max == 1 else 0, n_max + 1) for kind in _kinds(model, n)]


def _uniform(unit: TireWheelUnit, speed: float, time: float, model: Model, n_max: int) -> FloatArray:
    """A(t) of the uniform tire: :func:`.wheel.state_matrix` and, beside it, the modes of ``ring.matrices``."""
    if isinstance(n_max, bool) or not isinstance(n_max, (int, np.integer)) or n_max < 1:
        raise ValueError(f"n_max is {n_max!r}; it must be an integer >= 1")
    one = wheel.state_matrix(unit.mean, speed, time, model)
    if n_max == 1:
        return one
    labels = coordinates(model, int(n_max))
    still = 1 if unit.is_held else 2
    half = len(labels) + still
    A = np.zeros((2 * half, 2 * half))
    A[half:, :half] = np.eye(half)
    for n in (0, *range(2, n_max + 1)):
        G, K = _mode(unit, n, speed, model)
        rows = np.array([k for k, label in enumerate(labels) if label[0] == n])
        A[rows[:, None], rows] = -G
        A[rows[:, None], half + rows] = -K
    rows = np.array([k for k, label in enumerate(labels) if label[0] == 1] + list(range(len(labels), half)))
    both = np.concatenate([rows, half + rows])
    A[rows[:, None], both] = one[: len(rows)]
    return A


def _mode(unit: TireWheelUnit, n: int, speed: float, model: Model) -> tuple[FloatArray, FloatArray]:
    """G and K of a mode other than n = 1."""
    if n == 0 and model == "inextensional":  # the wind-up: u_z = -u_theta' = 0
        square = float(coefficients(unit, 0).tangential)
        return np.array([[2.0 * unit.zeta_n * math.sqrt(square)]]), np.array([[square]])
    G, K = ring.matrices(unit, n, speed, model)
    if n == 0:
        G, K = G[::2, ::2], K[::2, ::2]  # without the sines
    return G, K


@lru_cache(maxsize=64)
def coupling(
    unit: TireWheelUnit,
    radial: tuple[Harmonic, ...],
    tangential: tuple[Harmonic, ...],
    speed: float,
    model: Model,
    n_max: int,
) -> tuple[FloatArray, FloatArray]:
    """What harmonics add to the stiffness between the ring's amplitudes and the wheel [N/m]; masses of q [kg].

    Parameters
    ----------
    unit : TireWheelUnit
    radial, tangential : tuple of (int, float, float)
        Harmonics of k_z and k_theta. From the fixed frame they are seen at the angles chi_j + phi.
    speed : float
        Spin Omega [rad/s]: the shapes of the inextensional model hang on it.
    model : {"inextensional", "complete"}
    n_max : int

    Returns
    -------
    stiffness : ndarray, shape (L, L)
        Between the ring's L coordinates, in the order of :func:`coordinates`, net of the wheel.
    masses : ndarray, shape (L + 1,) or (L + 2,)
        Of them, of y, and of x where the wheel gives fore and aft. Both are shared, and cannot be written to.

    Notes
    -----
    The elements are a b times the integrals of k_z e_j cos j(theta - chi_j) with two shapes of u_z, and likewise of
    k_theta and u_theta.
    """
    labels = coordinates(model, n_max)
    area = unit.radius * unit.width
    stiffness = np.zeros((len(labels), len(labels)))
    mass = np.empty(len(labels))
    shapes = []
    for n, kind in labels:
        u_z, u_t, ratio = _shape(unit, n, kind, speed, model)
        shapes.append((n, u_z, u_t))
        mass[len(shapes) - 1] = math.pi * area * unit.surface_density * (ratio if n else 2.0)
    for k, (n, u_z, u_t) in enumerate(shapes):
        for i, (other, v_z, v_t) in enumerate(shapes[: k + 1]):
            along = unit.radial_stiffness * _integral(radial, n, u_z, other, v_z)
            around = unit.tangential_stiffness * _integral(tangential, n, u_t, other, v_t)
            stiffness[k, i] = stiffness[i, k] = area * (along + around)
    still = [unit.wheel_mass, unit.fore_aft_mass][: 1 if unit.is_held else 2]
    return _shared(stiffness), _shared(np.concatenate([mass, still]))


def _shared(array: FloatArray) -> FloatArray:
    array.setflags(write=False)
    return array


def _shape(unit: TireWheelUnit, n: int, kind: str, speed: float, model: Model) -> tuple[complex, complex, float]:
    """z_1 and z_2 of a coordinate that is 1, and its mass over pi a b rho h; u = Re[conj(z) exp(i n theta)]."""
    z = 1j if kind in ("beta", "eta") else 1.0
    if model == "complete" or n == 0:
        return (z, 0.0, 1.0) if kind in ("alpha", "beta") else (0.0, z, 1.0)
    if n == 1:
        return z, -1j * z, 2.0
    A, _, C, _ = (float(value) for value in coefficients(unit, n, speed))
    return z, -1j * (A / C) * z, (A + n * C) / (n * C)


def _integral(harmonics: tuple[Harmonic, ...], n: int, z: complex, other: int, w: complex) -> float:
    """Of sum_j e_j cos j(theta - chi_j) Re[conj(z) exp(i n theta)] Re[conj(w) exp(i other theta)] around the ring."""
    total = 0.0
    if z == 0.0 or w == 0.0:
        return total
    z = z.conjugate()
    for j, e, chi in harmonics:
        for p, product in ((n - other, z * w), (n + other, z * w.conjugate())):
            if abs(p) == j:
                total += 0.5 * math.pi * e * (product * cmath.exp(1j * p * chi)).real
    return total


@lru_cache(maxsize=64)
def _seen_by_the_sidewall(unit: TireWheelUnit, model: Model, n_max: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Net amplitudes of the ring = (constant + sin(phi) sine + cos(phi) cosine) q: what y and x take from n = 1."""
    labels = coordinates(model, n_max)
    y = len(labels)
    constant, sine, cosine = np.zeros((3, y, y + (1 if unit.is_held else 2)))
    constant[:, :y] = np.eye(y)
    # y sin(psi), y cos(psi); x cos(psi), -x sin(psi), as in wheel.state_matrix
    for kind, by_y, by_x in (
        ("alpha", (1.0, 0.0), (0.0, 1.0)),
        ("beta", (0.0, 1.0), (-1.0, 0.0)),
        ("xi", (0.0, 1.0), (-1.0, 0.0)),
        ("eta", (-1.0, 0.0), (0.0, -1.0)),
    ):
        if (1, kind) in labels:
            row = labels.index((1, kind))
            sine[row, y], cosine[row, y] = -by_y[0], -by_y[1]
            if not unit.is_held:
                sine[row, y + 1], cosine[row, y + 1] = -by_x[0], -by_x[1]
    return _shared(constant), _shared(sine), _shared(cosine)


# -- stability ----------------------------------------------------------------------------------------------------


def stability(
    unit: TireWheelUnit,
    nonuniformity: Nonuniformity,
    speed: float,
    model: Model = "inextensional",
    n_max: int = 1,
) -> FloquetResult:
    """Floquet stability at a constant speed.

    Parameters
    ----------
    unit : TireWheelUnit
    nonuniformity : Nonuniformity
    speed : float
        Spin Omega [rad/s], either sign. At standstill there is no period; the verdict comes from the exponents.
    model : {"inextensional", "complete"}
    n_max : int
        As of :func:`state_matrix`.

    Returns
    -------
    FloquetResult
        Of one turn. :func:`.wheel.stability` itself where n_max is 1 and nothing varies that n = 1 could feel.

    Raises
    ------
    ValueError
        An argument is out of its bounds.
    ArithmeticError
        The speed is so low that a turn is too long to be integrated, or the solution overflows.

    Notes
    -----
    Half a turn is enough: it changes nothing in the ring's frame but the sign of y and x, so the monodromy matrix is
    the square of D Phi(pi), D the change of sign. For n = 1 in the fixed frame there is no such sign. The work grows
    as 1/Omega; see :func:`.periodic.transition` for where it ends.
    """
    if n_max == 1 and not any(_anisotropy(unit, nonuniformity, _checked(model))):
        return wheel.stability(unit.mean, speed, model)
    if not abs(speed) > 1e-300:
        return floquet.analyze_constant(state_matrix(unit, nonuniformity, speed, 0.0, model, n_max))
    half = _half_turn(unit, [nonuniformity], speed, model, n_max)
    period = 2.0 * math.pi / abs(speed)
    return floquet.judge(half.matrix[0], float(half.log_norm[0]), float(half.error[0]), period, 2)


def _checked(model: Model) -> Model:
    if model not in ("inextensional", "complete"):
        raise ValueError(f"model is {model!r}; it must be 'inextensional' or 'complete'")
    return model


def _half_turn(unit: TireWheelUnit, several: list[Nonuniformity], speed: float, model: Model, n_max: int) -> Transition:
    """Matrices whose squares are those of a whole turn, one for each of several nonuniformities."""
    sign = None
    if n_max == 1:
        frames = [periodic_frame(unit, each, model) for each in several]
        system = Trigonometric(
            np.stack([wheel.fixed_frame_matrix(unit, speed, model)] * len(frames)),
            (2,),
            np.stack([frame.cosine for frame in frames])[None],
            np.stack([frame.sine for frame in frames])[None],
        )
    else:
        system = _stack([_trigonometric(unit, each, speed, model, n_max) for each in several])
        half = system.constant.shape[-1] // 2
        sign = np.ones(2 * half)
        ring_coordinates = len(coordinates(model, n_max))
        sign[ring_coordinates:half] = sign[half + ring_coordinates :] = -1.0
    result = transition(system, speed, 0.0, math.copysign(math.pi, speed))
    return result if sign is None else result._replace(matrix=sign[:, None] * result.matrix)


def _trigonometric(
    unit: TireWheelUnit, nonuniformity: Nonuniformity, speed: float, model: Model, n_max: int
) -> Trigonometric:
    """A(phi) in the ring's frame: the first harmonic is the wheel's, the second the sidewall's on the wheel."""
    quarter = 0.5 * math.pi / speed
    before, right, opposite = (_uniform(unit, speed, k * quarter, model, n_max) for k in range(3))
    constant = 0.5 * (before + opposite)
    cosines, sines = np.stack([before - constant, 0.0 * constant]), np.stack([right - constant, 0.0 * constant])
    stiffness, mass = coupling(unit, nonuniformity.radial, nonuniformity.tangential, speed, model, n_max)
    still, s, c = _seen_by_the_sidewall(unit, model, n_max)
    half = len(mass)

    def acts(left: FloatArray, right: FloatArray) -> FloatArray:
        product = left.T @ stiffness @ right
        return (product + product.T) / (2.0 * mass[:, None])

    place = np.s_[:half, half:]
    constant[place] -= acts(still, still) + 0.5 * (acts(s, s) + acts(c, c))
    sines[0][place] -= 2.0 * acts(still, s)
    cosines[0][place] -= 2.0 * acts(still, c)
    cosines[1][place] -= 0.5 * (acts(c, c) - acts(s, s))
    sines[1][place] -= acts(s, c)
    return Trigonometric(constant, (1, 2), cosines, sines)


def _stack(systems: list[Trigonometric]) -> Trigonometric:
    constants, harmonics, cosines, sines = zip(*systems, strict=True)
    return Trigonometric(np.stack(constants), harmonics[0], np.stack(cosines, axis=1), np.stack(sines, axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class TongueMap:
    """Stability over speed and the size of the non-uniformity.

    Attributes
    ----------
    speeds, scales : ndarray, shapes (nx,) and (ny,)
        [rad/s]; what the amplitudes are multiplied with.
    growth : ndarray, shape (ny, nx)
        The largest real part of the exponents [1/s].
    spectral_radius : ndarray, shape (ny, nx)
        The largest modulus of the multipliers of one turn; infinite where double precision does not hold it.
    verdict : ndarray of int8, shape (ny, nx)
        Index into ``floquet.VERDICTS``, the verdict of :func:`stability`.
    """

    speeds: FloatArray
    scales: FloatArray
    growth: FloatArray
    spectral_radius: FloatArray
    verdict: NDArray[np.int8]


def tongue_map(
    unit: TireWheelUnit,
    nonuniformity: Nonuniformity,
    speeds: ArrayLike,
    scales: ArrayLike,
    model: Model = "inextensional",
    n_max: int = 1,
) -> TongueMap:
    """:func:`stability` on a grid of speeds and of sizes of a non-uniformity.

    Parameters
    ----------
    unit : TireWheelUnit
    nonuniformity : Nonuniformity
        Which harmonics, in which proportion and where.
    speeds : array_like, shape (nx,)
        Spin Omega [rad/s], either sign, not zero.
    scales : array_like, shape (ny,)
        Factors >= 0 of all amplitudes.
    model : {"inextensional", "complete"}
    n_max : int
        As of :func:`state_matrix`.

    Returns
    -------
    TongueMap

    Raises
    ------
    ValueError
        A speed is zero or not finite, or the largest factor makes a stiffness negative.
    ArithmeticError
        A speed is so low that a turn is too long to be integrated.
    """
    omega, factors = (np.array(values, dtype=np.float64).reshape(-1) for values in (speeds, scales))
    for speed in omega.tolist():
        if not (math.isfinite(speed) and speed != 0.0):
            raise ValueError(f"speeds has {speed!r}; each must be finite and not zero")
    several = [nonuniformity.scaled(float(factor)) for factor in factors]
    growth, radius = np.empty((2, factors.size, omega.size))
    verdict = np.empty((factors.size, omega.size), dtype=np.int8)
    for k, speed in enumerate(omega.tolist()):
        half = _half_turn(unit, several, speed, _checked(model), n_max)
        values, verdict[:, k] = floquet.monodromy_verdicts(half.matrix, half.log_norm, half.error)
        with np.errstate(divide="ignore", over="ignore"):
            logs = np.log(np.abs(values).max(axis=1)) + half.log_norm
            growth[:, k], radius[:, k] = logs * abs(speed) / math.pi, np.exp(2.0 * logs)
    return TongueMap(omega, factors, growth, radius, verdict)


# -- where tongues begin --------------------------------------------------------------------------------------------


class Tip(NamedTuple):
    """Where a tongue of instability begins: the sum of two whirls' frequencies is twice the speed.

    Attributes
    ----------
    speed : float
        Omega > 0 [rad/s].
    frequencies : tuple of float
        omega_i <= omega_j of the uniform unit without damping, in the fixed frame [rad/s]; their sum is 2 Omega.
    growth : float
        Rate at which the motion grows there without damping [1/s], to first order in the amplitudes. The tongue of
        the inextensional model then reaches from Omega - growth to Omega + growth.
    threshold : float
        What the amplitudes must be multiplied with for the tongue to overcome the damping, to first order; 0 without
        damping, NaN where one of the two does not decay by itself.
    """

    speed: float
    frequencies: tuple[float, float]
    growth: float
    threshold: float


@lru_cache(maxsize=256)
def tongue_tips(unit: TireWheelUnit, nonuniformity: Nonuniformity, model: Model = "inextensional") -> tuple[Tip, ...]:
    """Where the tongues of n = 1 and the wheel begin, those that open in proportion to the amplitudes.

    Parameters
    ----------
    unit : TireWheelUnit
    nonuniformity : Nonuniformity
    model : {"inextensional", "complete"}

    Returns
    -------
    tuple of Tip
        By ascending speed. Narrower ones, of order k in the amplitudes, lie at 1/k of the sums.

    Notes
    -----
    In the fixed frame the uniform unit without damping is z' = F z with imaginary eigenvalues, and the second harmonic
    adds exp(2 i phi) E + exp(-2 i phi) conj(E), E = (P - i Q)/2. With right and left eigenvectors v and u, u v = 1, two
    motions p and q for which lambda_p - lambda_q = 2 i Omega drive each other: a_p'' = s^2 a_p,
    s^2 = (u_p E v_q)(u_q conj(E) v_p), and grow if s^2 > 0. The stiffness seen from the fixed frame is positive, so
    every motion has positive energy; then s^2 > 0 for sums, where p is omega_i and q is -omega_j, and s^2 < 0 for
    differences (Krein): those open nothing.
    """
    parts = periodic_frame(unit, nonuniformity, model)
    if not parts.cosine.any():
        return ()
    undamped = unit.replace(zeta_1=0.0, zeta_s=0.0, zeta_n=0.0, longitudinal_damping_ratio=0.0)
    half = len(parts.constant) // 2

    system = wheel.fixed_frame(undamped, model)

    def frequencies(speeds: FloatArray) -> FloatArray:
        values = np.linalg.eigvals(system.constant + speeds[..., None, None] * system.spin)
        return np.asarray(np.sort(np.abs(values.imag))[..., ::2])

    # Beyond twice the highest, no sum is twice the speed: what still grows does so four times as fast as the speed.
    speeds = np.linspace(0.0, 2.0 * float(frequencies(np.array(0.0))[-1]), 513)
    each = frequencies(speeds)
    tips: list[Tip] = []
    for i in range(half):
        for j in range(i, half):

            def excess(speed: float, i: int = i, j: int = j) -> float:
                found = frequencies(np.array(speed))
                return float(found[i] + found[j]) - 2.0 * speed

            beyond = each[:, i] + each[:, j] - 2.0 * speeds
            for k in np.flatnonzero((beyond[:-1] > 0.0) != (beyond[1:] > 0.0)).tolist():
                (a, b), (f_a, f_b) = speeds[k : k + 2].tolist(), beyond[k : k + 2].tolist()
                speed = root_between(excess, a, b, f_a, f_b, 1e-12)
                pair = frequencies(np.array(speed))[[i, j]]
                # a frequency that is there twice gives its tip twice
                if not any(np.allclose([tip.speed, *tip.frequencies], [speed, *pair], rtol=1e-6) for tip in tips):
                    F, damped = (wheel.fixed_frame_matrix(each, speed, model) for each in (undamped, unit))
                    growth, threshold = _tongue(F, damped - F, parts, *pair.tolist())
                    if growth > 0.0:
                        tips.append(Tip(speed, (float(pair[0]), float(pair[1])), growth, threshold))
    return tuple(sorted(tips))


def _tongue(
    F: FloatArray, damping: FloatArray, parts: PeriodicFrame, omega_i: float, omega_j: float
) -> tuple[float, float]:
    """Growth and threshold where omega_i + omega_j = 2 Omega; a growth of 0 where nothing opens."""
    scale = floquet.balance(np.abs(F)[None])[0]
    values, right = np.linalg.eig(F * scale)
    left = np.linalg.inv(right)
    size = float(np.abs(values).max())
    p, q = (np.flatnonzero(np.abs(values.imag - w) < 1e-7 * size) for w in (omega_i, -omega_j))
    E = 0.5 * (parts.cosine - 1j * parts.sine) * scale
    p_q, q_p = left[p] @ E @ right[:, q], left[q] @ E.conj() @ right[:, p]
    square = float(np.linalg.eigvals(p_q @ q_p).real.max())
    if square <= (1e-10 * float(np.abs(E).max())) ** 2:  # rounding of the products
        return 0.0, math.nan
    held = damping * scale

    def rate(factor: float) -> float:
        """At which the fastest of these motions grows, to first order in damping and amplitudes."""
        slow = np.block([[left[p] @ held @ right[:, p], factor * p_q], [factor * q_p, left[q] @ held @ right[:, q]]])
        return float(np.linalg.eigvals(slow).real.max())

    growth = math.sqrt(square)
    if not damping.any():
        return growth, 0.0
    if rate(0.0) >= 0.0:
        return growth, math.nan
    enough = float(np.abs(held).sum()) / growth
    return growth, root_between(rate, 0.0, enough, rate(0.0), rate(enough), 1e-12 * enough)


def nearest_tongue(
    unit: TireWheelUnit, nonuniformity: Nonuniformity, speed: float, model: Model = "inextensional"
) -> float | None:
    """The speed nearest to a given one at which a tongue begins.

    Parameters
    ----------
    unit : TireWheelUnit
    nonuniformity : Nonuniformity
    speed : float
        Spin Omega [rad/s], either sign.
    model : {"inextensional", "complete"}

    Returns
    -------
    float or None
        That of a :class:`Tip` of :func:`tongue_tips`, with the sign of ``speed`` [rad/s]; None if there is none.
    """
    if not math.isfinite(speed):
        raise ValueError(f"speed is {speed!r}; it must be finite")
    tips = tongue_tips(unit, nonuniformity, model)
    if not tips:
        return None
    return math.copysign(min((tip.speed for tip in tips), key=lambda at: abs(at - abs(speed))), speed)
