"""The tire on the road at constant speed: everything that is linear while the contact lasts.

The belt, the wheel and what stands on the suspension are one system in the fixed frame,

    z' = A z + push F + traction F_x,      u_c = contact z,

driven by the contact force F (up, on the tire). u_c is the belt's radial displacement at the road, outward, its mean
over the patch; with the road's height r the residual spring is compressed by delta = r + u_c, and F = k_c delta +
c_c delta'. So with H(s) = contact (s - A)^-1 push,

    F = r / (1/(k_c + c_c s) - H(s)),      A_contact = A + push (k_c contact + c_c contact A),

as contact push = 0: a force moves no place at once. A rigid tread, k_c infinite, holds u_c = -r: two states fewer.
docs/model.md, section 11, derives it. z has the states of ``wheel_matrices.fixed_frame``, then [b', b] of a sprung
mass, then, of each belt harmonic, the real parts of (V, Z) and their imaginary parts (``modes``); of n = 0, which has
none, the real ones.

The file is long because all of it is one linear system: the belt's matrices, the wheel's, the contact that closes them,
and what is read from the whole, which is equilibrium, stability, frequency response and force variation.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import floquet
from .coefficients import coefficients, contact_patch_factor, mode_damping, residual_stiffness, twist
from .floquet import FloquetResult
from .harmonics import Harmonic
from .modes import CONTACT_ANGLE
from .nonuniform_matrices import coordinates, coupling
from .periodic import Trigonometric, transition
from .unit import TireWheelUnit
from .wheel_matrices import Model, fixed_frame

__all__ = [
    "ContactSystem",
    "ForceVariation",
    "belt_numbers",
    "critical_speed",
    "fixed_height_force",
    "force_variation",
    "frequency_response",
    "is_varying",
    "open_system",
    "oscillatory_exponents",
    "periodic_system",
    "stability",
    "standing",
]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


class ContactSystem(NamedTuple):
    """The system of the module's notes at one speed, n states.

    Attributes
    ----------
    matrix : ndarray, shape (n, n)
        A [1/s], without the contact's spring.
    push, traction : ndarray, shape (n,)
        What a contact force of 1 N, up, and a traction of 1 N, along x_ros, do to z'.
    weight : ndarray, shape (n,)
        What a weight of 1 N on the sprung mass does to z'; zero where the body is held.
    contact : ndarray, shape (n,)
        u_c = contact z [m].
    output : ndarray, shape (2, n)
        Axle force [x_ros, z_ros] = output z [N].
    stiffness, damping : float
        k_c [N/m], infinite where the tread is rigid, and c_c [N s/m].
    """

    matrix: FloatArray
    push: FloatArray
    traction: FloatArray
    weight: FloatArray
    contact: FloatArray
    output: FloatArray
    stiffness: float
    damping: float

    @property
    def rate(self) -> FloatArray:
        """u_c' = rate z [m/s]."""
        return self.contact @ self.matrix

    def closed(self) -> FloatArray:
        """A_contact [1/s], shape (n, n); for a rigid tread (n - 2, n - 2), on the states that u_c = u_c' = 0 leaves."""
        return self.constrained(self.matrix, self.rate)

    def constrained(self, matrix: FloatArray, rate: FloatArray | None = None) -> FloatArray:
        """A part of A with the contact, likewise; the contact's spring and damper go with the part that has a ``rate``.

        A soft tread leaves the other parts as they are; a rigid one projects each of them on u_c = u_c' = 0.
        """
        if math.isfinite(self.stiffness):
            if rate is None:
                return matrix
            return matrix + np.outer(self.push, self.stiffness * self.contact + self.damping * rate)
        moves = self.rate
        basis = self.basis
        return np.asarray(basis.T @ (matrix - np.outer(self.push, moves @ matrix) / (moves @ self.push)) @ basis)

    @property
    def basis(self) -> FloatArray:
        """An orthonormal basis, shape (n, n - 2), of the states with u_c = u_c' = 0: a rigid tread leaves these."""
        rows = np.stack([self.contact / np.abs(self.contact).max(), self.rate / np.abs(self.rate).max()])
        basis: FloatArray = np.linalg.svd(rows)[2][2:].T
        return basis


def belt_numbers(model: Model, n_max: int, windup: bool = False) -> FloatArray:
    """The belt harmonics beside n = 1: 2 to n_max, and 0 of the complete model, or where the wind-up is asked for."""
    if isinstance(n_max, bool) or not isinstance(n_max, (int, np.integer)) or n_max < 1:
        raise ValueError(f"n_max is {n_max!r}; it must be an integer >= 1")
    numbers = np.arange(2.0, n_max + 1.0)
    return np.concatenate([[0.0], numbers]) if model == "complete" or windup else numbers


def _turned(numbers: FloatArray) -> ComplexArray:
    """exp(i n psi_0) = (-i)^n, exactly."""
    return np.asarray(np.array([1.0, -1.0j, -1.0, 1.0j])[np.mod(numbers, 4.0).astype(int)])


def belt_matrices(
    unit: TireWheelUnit, numbers: FloatArray, speed: float, model: Model
) -> tuple[ComplexArray, ComplexArray]:
    """x' = M x + drive [f_r, f_t] of each harmonic's x = (V, Z), shapes (N, k, k) and (N, k, 2); ``modes`` has it."""
    mass = math.pi * unit.radius * unit.width * unit.surface_density * np.where(numbers == 0.0, 2.0, 1.0)
    force = contact_patch_factor(unit, numbers) * _turned(numbers) / mass
    n = numbers if model == "complete" else np.maximum(numbers, 2.0)  # the wind-up has its own place below
    d = mode_damping(unit, n, model)
    A, B, C, determinant = coefficients(unit, n, speed)
    k = 4 if model == "complete" else 2
    M = np.zeros((n.size, k, k), dtype=np.complex128)
    drive = np.zeros((n.size, k, 2), dtype=np.complex128)
    if model == "complete":
        M[:, 0, 0] = M[:, 1, 1] = 1j * n * speed - d
        M[:, 0, 1], M[:, 1, 0] = 2.0 * speed, -2.0 * speed
        M[:, 0, 2], M[:, 0, 3] = -B, 1j * A
        M[:, 1, 2], M[:, 1, 3] = -1j * A, -C
        M[:, 2, 0] = M[:, 3, 1] = 1.0
        M[:, 2, 2] = M[:, 3, 3] = 1j * n * speed
        drive[:, 0, 0] = drive[:, 1, 1] = force
    else:
        through = A + n * C
        M[:, 0, 0] = 1j * n * speed - d - 2j * twist(n, A, C) * speed
        M[:, 0, 1] = -n * determinant / through
        M[:, 1, 0] = 1.0
        M[:, 1, 1] = 1j * n * speed
        drive[:, 0, 0] = n * C / through * force
        drive[:, 0, 1] = 1j * n * A / through * force
        if numbers.size and numbers[0] == 0.0:  # the wind-up xi_0: u_z = -u_theta' = 0
            square = float(coefficients(unit, 0).tangential)
            M[0] = [[-2.0 * unit.zeta_n * math.sqrt(square), -square], [1.0, 0.0]]
            drive[0, 0] = 0.0, force[0]
    return M, drive


def open_system(
    unit: TireWheelUnit, speed: float, model: Model = "inextensional", n_max: int = 30, *, windup: bool = False
) -> ContactSystem:
    """The system of the module's notes; of a unit that is not uniform, its mean's.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign.
    model : {"inextensional", "complete"}
    n_max : int
        Highest belt harmonic, >= 1.
    windup : bool
        Whether the inextensional model has the wind-up of n = 0, which traction and a varying sidewall drive, too.

    Returns
    -------
    ContactSystem

    Raises
    ------
    ValueError
        An argument is out of its bounds, or the unit's ``vertical_stiffness`` is not below the tire's own.
    """
    if not math.isfinite(speed):
        raise ValueError(f"speed is {speed!r}; it must be finite")
    numbers = belt_numbers(model, n_max, windup)
    frame = fixed_frame(unit, model)
    one, half = len(frame.constant), len(frame.constant) // 2
    M, drive = belt_matrices(unit, numbers, speed, model)
    k = M.shape[1] if numbers.size else 0
    sprung = 2 if unit.sprung_mass else 0
    sizes = [k if n == 0.0 else 2 * k for n in numbers]
    total = one + sprung + sum(sizes)
    A = np.zeros((total, total))
    push, traction, weight, contact = np.zeros((4, total))
    output = np.zeros((2, total))
    A[:one, :one] = frame.constant + speed * frame.spin
    push[:one], traction[:one] = frame.input.T
    output[:, :one] = frame.output + speed * frame.output_spin
    contact[half + 1] = -1.0  # Y
    y = half + (2 if model == "inextensional" else 4)
    if sprung:
        body = one + 1
        k_s, c_s, M_w, m_b = unit.suspension_stiffness, unit.suspension_damping, unit.wheel_mass, unit.sprung_mass
        A[y - half, [one, body]] = c_s / M_w, k_s / M_w
        A[one, [y - half, y, one, body]] = c_s / m_b, k_s / m_b, -c_s / m_b, -k_s / m_b
        A[body, one] = 1.0
        output[1, [one, body]] = -c_s, -k_s
        weight[one] = -1.0 / m_b
    first = one + sprung
    factors = contact_patch_factor(unit, numbers)
    for n, matrix, forces, factor, size in zip(numbers.tolist(), M, drive, factors, sizes, strict=True):
        place = slice(first, first + size)
        toward = factor * _turned(np.array([n]))[0]  # u_n = Re[conj(Z) exp(i n psi_0)]
        radial = k // 2  # Z_1 among (V, Z)
        if size == k:
            A[place, place] = matrix.real
            push[place], traction[place] = -forces[:, 0].real, -forces[:, 1].real
            contact[first + radial] = factor if model == "complete" else 0.0
        else:
            A[place, place] = np.block([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]])
            push[place] = np.concatenate([-forces[:, 0].real, -forces[:, 0].imag])
            traction[place] = np.concatenate([-forces[:, 1].real, -forces[:, 1].imag])
            contact[first + radial], contact[first + k + radial] = toward.real, toward.imag
        first += size
    stiffness = residual_stiffness(unit, int(n_max), model)
    return ContactSystem(A, push, traction, weight, contact, output, stiffness, unit.residual_damping)


# -- at rest ------------------------------------------------------------------------------------------------------


def standing(system: ContactSystem, load: float) -> tuple[FloatArray, float, float]:
    """The steady state in which a tire carries a load on a flat road at the speed of ``system``.

    Parameters
    ----------
    system : ContactSystem
    load : float
        F_0 [N].

    Returns
    -------
    state : ndarray, shape (n,)
        With the body at b = 0.
    compression : float
        r of the flat road, from where it touches the tire that is not loaded [m].
    weight : float
        What the body weighs for it to stay there, F' of this state [N]: F_0 but for modal damping at speed.
    """
    n = len(system.matrix)
    free = np.flatnonzero(system.weight == 0.0) if system.weight.any() else np.arange(n)
    if system.weight.any():  # b stands still: its velocity's row is the body's, whose weight is an outcome
        body = int(np.flatnonzero(system.weight)[0])
        free = np.array([k for k in range(n) if k not in (body, body + 1)])
    state = np.zeros(n)
    state[free] = np.linalg.solve(system.matrix[np.ix_(free, free)], -load * system.push[free])
    spring = load / system.stiffness  # 0 where it is rigid
    return state, float(spring - system.contact @ state), float(system.output[1] @ state)


# -- stability ----------------------------------------------------------------------------------------------------


def is_varying(unit: TireWheelUnit) -> bool:
    """Whether the sidewall's stiffness varies around the tire: then its equations on the road have no constant form."""
    return bool(unit.radial_nonuniformity or unit.tangential_nonuniformity)


def stability(
    unit: TireWheelUnit, speed: float, model: Model = "inextensional", n_max: int = 30, *, turn: bool = True
) -> FloquetResult:
    """Floquet stability on the road, without lift-off, at a constant speed.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign. At standstill the verdict comes from the exponents.
    model : {"inextensional", "complete"}
    n_max : int
        Highest belt harmonic. Of a tire whose sidewall varies all of them are coupled, and the work grows as its cube:
        about 1 s for 10.
    turn : bool
        Whether there is to be a period, a turn, and its multipliers; of a tire that varies there always is.

    Returns
    -------
    FloquetResult
        In closed form where the tire is the same all around, and otherwise from the transition over a turn.

    Raises
    ------
    ValueError
        As of :func:`open_system`.
    ArithmeticError
        Of a tire that varies: the speed is so low that a turn is too long to be integrated, or the solution overflows.
    """
    period = 2.0 * math.pi / abs(speed) if abs(speed) > 1e-300 else None
    if not is_varying(unit):
        return floquet.analyze_constant(open_system(unit, speed, model, n_max).closed(), period if turn else None)
    system, _ = periodic_system(unit, speed, model, n_max)
    if period is None:
        return floquet.analyze_constant(system.at(0.0))
    often = math.gcd(*system.harmonics)
    part = transition(system, speed, 0.0, math.copysign(2.0 * math.pi / often, speed))
    return floquet.judge(part.matrix[0], float(part.log_norm[0]), float(part.error[0]), period, often)


def periodic_system(
    unit: TireWheelUnit, speed: float, model: Model = "inextensional", n_max: int = 30, *, contact: bool = True
) -> tuple[Trigonometric, ContactSystem]:
    """A(phi) of a tire whose sidewall varies, seen from the fixed frame.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign.
    model : {"inextensional", "complete"}
    n_max : int
        Highest belt harmonic.
    contact : bool
        Whether the contact is closed. Without it this is what ``nonuniform.state_matrix`` is, seen from where the road
        stands: there the sidewall's harmonic j turns as j phi, whatever n_max is, and no contact turns.

    Returns
    -------
    Trigonometric
        On the states of :class:`ContactSystem`, for a rigid tread on those that u_c = u_c' = 0 leaves; the
        inextensional model has the wind-up of n = 0 too.
    ContactSystem
        Of the mean tire.
    """
    system = open_system(unit.mean, speed, model, n_max, windup=True)
    parts = _sidewall(unit, system, speed, model, int(n_max))
    in_contact = system.constrained if contact else _as_it_is
    constant = system.closed() if contact else system.matrix
    harmonics = tuple(sorted(parts)) or (1,)
    none = np.zeros_like(system.matrix)
    pairs = [parts.get(j, (none, none)) for j in harmonics]
    cosines, sines = (np.stack([in_contact(pair[k]) for pair in pairs]) for k in (0, 1))
    return Trigonometric(constant, harmonics, cosines, sines), system


def _as_it_is(matrix: FloatArray) -> FloatArray:
    return matrix


def _sidewall(
    unit: TireWheelUnit, system: ContactSystem, speed: float, model: Model, n_max: int
) -> dict[int, tuple[FloatArray, FloatArray]]:
    """What the sidewall's harmonics j add to A, over cos j phi and sin j phi."""
    labels = coordinates(model, max(n_max, 2))
    labels = [label for label in labels if label[0] <= n_max]
    places = _places(unit, model, n_max)
    n = len(system.matrix)
    net = np.zeros((len(labels), n))
    rows = np.array([places[label][0] for label in labels])
    for k, label in enumerate(labels):
        net[k, places[label][1]] = 1.0
    y, x = places["y"], places.get("x")
    # as in nonuniform.sidewall: X - x, Y - y, and of the complete model U - y, V + x
    for kind, up, along in (("alpha", 0.0, -1.0), ("beta", -1.0, 0.0), ("xi", -1.0, 0.0), ("eta", 0.0, 1.0)):
        if (1, kind) in labels:
            net[labels.index((1, kind)), y[1]] = up
            if x is not None:
                net[labels.index((1, kind)), x[1]] = along
    every = sorted({j for j, _, _ in (*unit.radial_nonuniformity, *unit.tangential_nonuniformity)})
    found = {}
    for j in every:
        both = []
        for turn in (0.0, 0.5 * math.pi / j):  # cos j(psi - phi - chi) = cos j phi cos j(psi - chi) + sin .. sin ..
            radial, tangential = (
                tuple((i, e, chi + turn) for i, e, chi in some if i == j)
                for some in (unit.radial_nonuniformity, unit.tangential_nonuniformity)
            )
            stiffness, masses = _coupled(unit.mean, radial, tangential, speed, model, n_max, len(labels))
            matrix = np.zeros((n, n))
            pull = -stiffness @ net  # generalised forces on the ring's coordinates
            matrix[rows] += pull / masses[: len(labels), None]
            matrix[y[0]] += net[:, y[1]] @ pull / unit.wheel_mass
            if x is not None:
                matrix[x[0]] += net[:, x[1]] @ pull / unit.fore_aft_mass
            both.append(matrix)
        found[j] = (both[0], both[1])
    return found


def _coupled(
    unit: TireWheelUnit,
    radial: tuple[Harmonic, ...],
    tangential: tuple[Harmonic, ...],
    speed: float,
    model: Model,
    n_max: int,
    count: int,
) -> tuple[FloatArray, FloatArray]:
    stiffness, masses = coupling(unit, radial, tangential, speed, model, max(n_max, 2))
    return stiffness[:count, :count], masses[:count]


def _places(unit: TireWheelUnit, model: Model, n_max: int) -> dict[object, tuple[int, int]]:
    """Where velocity and displacement of each coordinate stand among the states, wind-up included."""
    frame = fixed_frame(unit.mean, model)
    half = len(frame.constant) // 2
    kinds = ("alpha", "beta") if model == "inextensional" else ("alpha", "beta", "xi", "eta")
    places: dict[object, tuple[int, int]] = {(1, kind): (k, half + k) for k, kind in enumerate(kinds)}
    places["y"] = len(kinds), half + len(kinds)
    if not unit.is_longitudinally_rigid:
        places["x"] = len(kinds) + 1, half + len(kinds) + 1
    first = 2 * half + 2 * bool(unit.sprung_mass)
    k = 1 if model == "inextensional" else 2  # complex amplitudes of a harmonic
    places |= {(0, "xi"): (first, first + 1)} if k == 1 else {(0, "alpha"): (first, first + 2)}
    if k == 2:
        places[(0, "xi")] = first + 1, first + 3
    first += 2 * k
    for n in range(2, n_max + 1):
        for part, names in enumerate((("alpha", "xi"), ("beta", "eta"))):  # real parts, imaginary ones
            for i, name in enumerate(names[:k]):
                places[(n, name)] = first + 2 * k * part + i, first + 2 * k * part + k + i
        first += 4 * k
    return places


@lru_cache(maxsize=256)
def critical_speed(unit: TireWheelUnit, model: Model = "inextensional", n_max: int = 30) -> float | None:
    """The lowest speed at which the mean tire on the road loses stability [rad/s], or None up to 12 000 rad/s.

    Parameters
    ----------
    unit : TireWheelUnit
    model : {"inextensional", "complete"}
    n_max : int
        Highest belt harmonic.

    Notes
    -----
    The belt harmonics' coefficients are rational in Omega^2, so there is no pencil as of :func:`.wheel.critical_speed`.
    The spectral abscissa is looked at every 50 rad/s to 3000 rad/s, and every 500 above, and its first change of sign
    is refined. Without damping the fixed frame has gyroscopic and positive elastic terms alone, and nothing opens; what
    destabilises is the circulatory force of dashpots that turn, which grows with the speed. So the abscissa is smooth,
    and what comes and goes between two of those speeds is not to be expected.
    """
    from scipy.optimize import brentq

    unit = unit.mean

    def abscissa(speed: float) -> float:
        return float(np.linalg.eigvals(open_system(unit, speed, model, n_max).closed()).real.max())

    noise = 1e-9 * unit.rigid_mode_frequency
    before = 0.0
    for speed in (*range(50, 3000, 50), *range(3000, 12001, 500)):
        if abscissa(float(speed)) > noise:
            if abscissa(before) >= 0.0:
                return before
            return float(brentq(abscissa, before, float(speed), xtol=1e-6))
        before = float(speed)
    return None


def oscillatory_exponents(
    unit: TireWheelUnit, speed: float, model: Model = "inextensional", n_max: int = 30
) -> ComplexArray:
    """Exponents of the mean tire on the road that have a positive frequency, by their frequencies.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign.
    model : {"inextensional", "complete"}
    n_max : int
        Highest belt harmonic.

    Returns
    -------
    ndarray of complex, shape (k,)
        [1/s]: decay rate -Re, damped frequency Im/(2 pi) in the fixed frame.
    """
    exponents = np.linalg.eigvals(open_system(unit.mean, speed, model, n_max).closed())
    moving = exponents[exponents.imag > 0.0]
    return np.asarray(moving[np.argsort(moving.imag)], dtype=np.complex128)


# -- frequency response -------------------------------------------------------------------------------------------


def frequency_response(
    unit: TireWheelUnit,
    speed: ArrayLike,
    frequencies: ArrayLike,
    model: Model = "inextensional",
    n_max: int = 30,
) -> ComplexArray:
    """Axle forces and contact force per metre of road and per traction, as complex amplitudes, exact.

    Parameters
    ----------
    unit : TireWheelUnit
        Of one that is not uniform, the mean.
    speed : array_like, shape (...)
        Spin Omega [rad/s], either sign.
    frequencies : array_like, shape (...)
        Of the road's height under the wheel, or of the traction [Hz]. May be 0 and negative.
    model : {"inextensional", "complete"}
    n_max : int
        Highest belt harmonic.

    Returns
    -------
    ndarray of complex, shape (*speed.shape, *frequencies.shape, 3, 2)
        H[..., output, input]: outputs force.x, forward, F', up, on the suspension, and the contact force, up, on the
        tire; inputs the road's height, up [N/m], and the traction, forward, on the tire [-].

    Raises
    ------
    ValueError
        An argument is out of its bounds, or the response at a frequency is beyond what double precision holds.

    Notes
    -----
    With the compliance H_c(s) of the contact, H_r = 1/(1/(k_c + c_c s) - H_c) of the module's notes; n = 1 and the
    wheel are solved for, a belt harmonic adds half of c (s - M)^-1 b and of its conjugate's.
    """
    spins, cycles = (np.asarray(values, dtype=np.float64) for values in (speed, frequencies))
    for name, values in (("speed", spins), ("frequencies", cycles)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name} is {values[~np.isfinite(values)][0]}; it must be finite")
    s = np.asarray(2j * math.pi * cycles.reshape(-1), dtype=np.complex128)
    found = np.array([_response(unit.mean, Omega, s, model, n_max) for Omega in spins.reshape(-1).tolist()])
    return found.reshape(*spins.shape, *cycles.shape, 3, 2)


def _response(unit: TireWheelUnit, speed: float, s: ComplexArray, model: Model, n_max: int) -> ComplexArray:
    system = open_system(unit, speed, model, 1)  # n = 1; the harmonics follow
    stiffness = residual_stiffness(unit, n_max, model)
    forces = np.stack([system.push, system.traction], axis=1).astype(np.complex128)
    first = 0 if model == "inextensional" else 4  # n = 0 stands behind n = 1, and is added with the others
    one = len(system.matrix) - first
    dynamic = s[:, None, None] * np.eye(one) - system.matrix[:one, :one]
    with np.errstate(all="ignore"):
        try:
            state = np.linalg.solve(dynamic, np.broadcast_to(forces[:one], (s.size, one, 2)))
        except np.linalg.LinAlgError:
            state = np.full((s.size, one, 2), np.nan + 0j)
        axle = system.output[:, :one] @ state
        contact = system.contact[:one] @ state
        numbers = belt_numbers(model, n_max)
        if numbers.size:
            M, drive = belt_matrices(unit, numbers, speed, model)
            k = M.shape[1]
            seen = np.conj(_turned(numbers)) * contact_patch_factor(unit, numbers)
            grid = s[:, None, None, None] * np.eye(k)
            for matrices, pushes, sees in ((M, -drive, seen), (np.conj(M), -np.conj(drive), np.conj(seen))):
                moved = np.linalg.solve(grid - matrices, np.broadcast_to(pushes, (s.size, *pushes.shape)))
                contact = contact + 0.5 * np.einsum("n,fni->fi", sees, moved[:, :, k // 2, :])
        soft = 1.0 / (stiffness + unit.residual_damping * s) if math.isfinite(stiffness) else np.zeros_like(s)
        against = soft - contact[:, 0]
        force = np.stack([1.0 / against, contact[:, 1] / against], axis=1)  # per road and per traction
        pulled = np.stack([np.zeros_like(axle[:, :, 1]), axle[:, :, 1]], axis=2)
        response = np.concatenate([axle[:, :, :1] * force[:, None, :] + pulled, force[:, None, :]], axis=1)
    lost = ~np.isfinite(response).all(axis=(1, 2))
    if lost.any():
        raise ValueError(
            f"frequencies has {s[lost][0].imag / (2.0 * math.pi):.10g} Hz, at which the response at {speed:.10g} rad/s "
            "is beyond what double precision holds; give the unit damping, or leave this frequency out"
        )
    return np.asarray(response, dtype=np.complex128)


# -- force variation ----------------------------------------------------------------------------------------------


class ForceVariation(NamedTuple):
    """How the forces vary as the tire turns, to first order in what is not the same all around.

    Attributes
    ----------
    harmonics : ndarray of int, shape (J,)
    axle, contact : ndarray of complex, shape (J,)
        Re[axle_j exp(i j phi)] of the force on the axle, up, and likewise of the contact force [N]; phi is the wheel's
        angle. Peak to peak is twice the modulus.
    forward : ndarray of complex, shape (J,)
        Of the force on the axle along x_ros, likewise. The contact has no friction, so it is the ring's alone.
    """

    harmonics: NDArray[np.int64]
    axle: ComplexArray
    contact: ComplexArray
    forward: ComplexArray


def fixed_height_force(
    unit: TireWheelUnit, load: float, angles: ArrayLike, model: Model = "complete", n_max: int = 30
) -> FloatArray:
    """The force of a tire that turns slowly, its wheel held at the height where the mean force is the load.

    What a uniformity machine reads, but for its speed. Exact in the amplitudes.

    Parameters
    ----------
    unit : TireWheelUnit
        With ``radial_nonuniformity``, ``tangential_nonuniformity`` and ``radial_runout``.
    load : float
        Mean over a turn, > 0 [N].
    angles : array_like, shape (K,)
        phi, evenly around a turn: over them the mean is taken [rad].
    model : {"inextensional", "complete"}
    n_max : int
        Highest belt harmonic.

    Returns
    -------
    ndarray, shape (K,)
        [N], up, on the tire and on the wheel.
    """
    parts, system = periodic_system(unit, 0.0, model, n_max, contact=False)
    places = _places(unit, model, int(n_max))
    wheel_places = [places[name] for name in ("y", "x") if name in places]
    body = [] if not unit.sprung_mass else [len(fixed_frame(unit.mean, model).constant) + k for k in (0, 1)]
    gone = {*body, *(k for pair in wheel_places for k in pair)}
    pairs = sorted(pair for name, pair in places.items() if name not in ("y", "x") and not gone & set(pair))
    v, q = (np.array(each) for each in zip(*pairs, strict=True))
    soft = 1.0 / system.stiffness
    phi = np.asarray(angles, dtype=np.float64)
    compliance, away = np.empty(phi.size), np.zeros(phi.size)
    for k, angle in enumerate(phi.tolist()):
        stiffness = -parts.at(angle)[np.ix_(v, q)]
        compliance[k] = soft - system.contact[q] @ np.linalg.solve(stiffness, system.push[v])
        away[k] = _runout(unit, angle)
    # F = (r + e)/compliance, r such that the mean is the load
    height = (load - (away / compliance).mean()) / (1.0 / compliance).mean()
    return np.asarray((height + away) / compliance)


def _runout(unit: TireWheelUnit, phi: float) -> float:
    """How much farther out the tread is at the contact [m], mean over the patch as the pressure weighs it."""
    numbers = [j for j, _, _ in unit.radial_runout]
    each = zip(unit.radial_runout, contact_patch_factor(unit, numbers).tolist(), strict=True)
    return float(sum(factor * e * math.cos(j * (CONTACT_ANGLE - phi - chi)) for (j, e, chi), factor in each))


def force_variation(
    unit: TireWheelUnit,
    speed: float,
    load: float,
    model: Model = "inextensional",
    n_max: int = 30,
    *,
    mount: str = "car",
) -> ForceVariation:
    """Harmonics of the axle's and of the contact's force at a constant speed on a flat road, to first order.

    Parameters
    ----------
    unit : TireWheelUnit
        With what turns: sidewall, run-out, imbalance.
    speed : float
        Omega [rad/s], either sign, not 0.
    load : float
        Static, > 0 [N].
    model : {"inextensional", "complete"}
    n_max : int
        Highest belt harmonic.
    mount : {"car", "machine"}
        On the unit's own suspension, and its sprung mass; or on a wheel that is held at a fixed height, where the
        axle's force is the sidewall's on the wheel.

    Returns
    -------
    ForceVariation

    Notes
    -----
    The steady state z_0 of the mean tire under the load is driven by the sidewall's parts, Re[(P_j - i Q_j) z_0
    exp(i j phi)] for A = ... + cos(j phi) P_j + sin(j phi) Q_j, by run-out in the spring, and by m_u a Omega^2. What
    the variation of the answer does is of second order.
    """
    if mount not in ("car", "machine"):
        raise ValueError(f"mount is {mount!r}; it must be 'car' or 'machine'")
    if not (math.isfinite(speed) and speed != 0.0):
        raise ValueError(f"speed is {speed!r}; it must be finite and not 0")
    # What pulls at a wheel that does not move along x is the row of that motion, sidewall included.
    free = unit.replace(longitudinal_stiffness=1.0) if unit.is_longitudinally_rigid else unit
    system = open_system(free.mean, speed, model, n_max, windup=True)
    places = _places(free, model, int(n_max))
    along, up = -free.fore_aft_mass * system.matrix[places["x"][0]], system.output[1]
    stuck = set(places["x"]) if unit.is_longitudinally_rigid or mount == "machine" else set()
    if mount == "machine":
        stuck |= set(places["y"])
        if unit.sprung_mass:
            stuck |= set(range(first := len(fixed_frame(free.mean, model).constant), first + 2))
        up = unit.wheel_mass * system.matrix[places["y"][0]]  # all that pulls at a wheel that does not move
    elif not stuck:
        along = system.output[0]
    kept = np.array([k for k in range(len(system.matrix)) if k not in stuck])
    parts = _sidewall(free, system, speed, model, int(n_max))
    rest = np.zeros(len(system.matrix))
    if mount == "machine":
        rest[kept] = np.linalg.solve(system.matrix[np.ix_(kept, kept)], -load * system.push[kept])
    else:
        rest[kept] = standing(open_system(unit.mean, speed, model, n_max, windup=True), load)[0]
    numbers = sorted({*parts, *(j for j, _, _ in unit.radial_runout), *([1] if unit.imbalance_mass else [])})
    axle, contact, forward = np.zeros((3, len(numbers)), dtype=np.complex128)
    one = np.eye(len(kept))
    soft_rest = 0.0 if not math.isfinite(system.stiffness) else 1.0
    for k, j in enumerate(numbers):
        s = 1j * j * speed
        cosine, sine = parts.get(j, (np.zeros_like(system.matrix),) * 2)
        drive = ((cosine - 1j * sine) @ rest).astype(np.complex128)
        direct = unit.wheel_mass * drive[places["y"][0]] if mount == "machine" else 0.0
        pulled = -free.fore_aft_mass * drive[places["x"][0]] if stuck else 0.0
        if j == 1 and unit.imbalance_mass:  # cos(theta_u + phi) on X, sin on Y
            size = unit.imbalance_mass * unit.radius * speed * speed
            turned = np.exp(1j * unit.imbalance_angle)
            ring = unit.ring_mass if model == "inextensional" else 0.5 * unit.ring_mass
            drive[0] += size / ring * turned
            drive[1] += size / ring * turned / 1j
        away = sum(
            e * np.exp(-1j * j * (CONTACT_ANGLE - chi)) for i, e, chi in unit.radial_runout if i == j
        ) * contact_patch_factor(unit, j)
        dynamic = s * one - system.matrix[np.ix_(kept, kept)]
        moved = np.linalg.solve(dynamic, np.stack([drive[kept], system.push[kept].astype(np.complex128)], axis=1))
        u = system.contact[kept] @ moved
        soft = soft_rest / (system.stiffness + system.damping * s) if soft_rest else 0.0
        force = (away + u[0]) / (soft - u[1])
        state = moved @ np.array([1.0, force])
        axle[k] = up[kept] @ state + direct
        forward[k] = along[kept] @ state + pulled
        contact[k] = force
    return ForceVariation(np.array(numbers, dtype=np.int64), axle, contact, forward)
