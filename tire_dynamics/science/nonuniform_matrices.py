"""A sidewall whose stiffness varies around the tire: the equations.

With k_z(theta) = k_z [1 + sum_j e_j cos j(theta - chi_j)], and likewise k_theta, the sidewall's stiffness turns with
the ring while the suspension stands: no change of frame makes that constant, and stability is a matter of Floquet
theory. docs/model.md derives the equations. Two forms of them are here:

- n = 1 and the wheel in the fixed frame, z' = (C + Omega S + cos(2 phi) P + sin(2 phi) Q) z with the states of
  ``wheel.fixed_frame``. Of all harmonics only the second acts here, and half a turn is a period.
- The modes n = 0 to N and the wheel in the ring's frame, where harmonic j couples n with n + j, n - j and j - n. There
  q = [alpha_0, xi_0, alpha_1, beta_1, xi_1, eta_1, alpha_2, ..., y, x] for the complete model, and for the
  inextensional one [xi_0, alpha_1, beta_1, alpha_2, beta_2, ..., y, x]; z = [q', q]; x only with fore-aft
  compliance.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import ring, wheel_matrices
from .coefficients import coefficients
from .elementary import cos_sin
from .harmonics import Harmonic, check_factor, harmonics
from .unit import TireWheelUnit
from .wheel_matrices import Model

__all__ = [
    "Nonuniformity",
    "PeriodicFrame",
    "anisotropy",
    "check_model",
    "coordinates",
    "coupling",
    "fixed_frame_matrix",
    "is_irreducibly_periodic",
    "periodic_frame",
    "seen_by_the_sidewall",
    "sidewall",
    "state_matrix",
    "uniform_part",
]

FloatArray = NDArray[np.float64]


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


# -- n = 1 and the wheel, fixed frame -------------------------------------------------------------------------------


class PeriodicFrame(NamedTuple):
    """z' = (constant + Omega spin + cos(2 phi) cosine + sin(2 phi) sine) z, the first two of ``wheel.fixed_frame``."""

    constant: FloatArray
    spin: FloatArray
    cosine: FloatArray
    sine: FloatArray


def is_irreducibly_periodic(unit: TireWheelUnit, model: Model = "inextensional", n_max: int = 1) -> bool:
    """Whether a unit's equations are irreducibly periodic: no change of frame makes them constant.

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
    acts = any(anisotropy(unit, sidewall, check_model(model)))
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
    system = wheel_matrices.fixed_frame(unit, model)
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
    half = len(masses) - unit.is_longitudinally_rigid
    parts = zip(springs, anisotropy(unit, nonuniformity, model), strict=True)
    strengths = [complex(k * e.real, k * e.imag) for k, e in parts]
    return net[:, :half], masses[:half], -net[:, -1], strengths


def anisotropy(unit: TireWheelUnit, nonuniformity: Nonuniformity, model: Model) -> list[complex]:
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
    matrix = wheel_matrices.fixed_frame_matrix(unit, speed, model)
    parts = periodic_frame(unit, nonuniformity, model)
    if parts.cosine.any():
        matrix = matrix + math.cos(2.0 * phase) * parts.cosine + math.sin(2.0 * phase) * parts.sine
    return matrix


# -- modes n = 0 to N and the wheel, ring's frame ------------------------------------------------------------------


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
    matrix = uniform_part(unit, speed, time, model, n_max)
    stiffness, mass = coupling(unit, nonuniformity.radial, nonuniformity.tangential, speed, model, n_max)
    if stiffness.any():
        constant, sine, cosine = seen_by_the_sidewall(unit, model, n_max)
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


def uniform_part(unit: TireWheelUnit, speed: float, time: float, model: Model, n_max: int) -> FloatArray:
    """A(t) of the uniform tire: :func:`.wheel.state_matrix` and, beside it, the modes of ``ring.matrices``."""
    if isinstance(n_max, bool) or not isinstance(n_max, (int, np.integer)) or n_max < 1:
        raise ValueError(f"n_max is {n_max!r}; it must be an integer >= 1")
    one = wheel_matrices.uniform_state_matrix(unit.mean, speed, time, model)
    if n_max == 1:
        return one
    labels = coordinates(model, int(n_max))
    still = 1 if unit.is_longitudinally_rigid else 2
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
        Of them, of y, and of x where the wheel is compliant fore and aft. Both are shared, and cannot be written to.

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
    still = [unit.wheel_mass, unit.fore_aft_mass][: 1 if unit.is_longitudinally_rigid else 2]
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
def seen_by_the_sidewall(unit: TireWheelUnit, model: Model, n_max: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Net amplitudes of the ring = (constant + sin(phi) sine + cos(phi) cosine) q: what y and x take from n = 1."""
    labels = coordinates(model, n_max)
    y = len(labels)
    constant, sine, cosine = np.zeros((3, y, y + (1 if unit.is_longitudinally_rigid else 2)))
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
            if not unit.is_longitudinally_rigid:
                sine[row, y + 1], cosine[row, y + 1] = -by_x[0], -by_x[1]
    return _shared(constant), _shared(sine), _shared(cosine)


def check_model(model: Model) -> Model:
    if model not in ("inextensional", "complete"):
        raise ValueError(f"model is {model!r}; it must be 'inextensional' or 'complete'")
    return model
