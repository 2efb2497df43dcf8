"""Tongues of parametric instability over speed and the size of a non-uniformity, and where they begin."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import floquet
from .nonuniform_matrices import Nonuniformity, PeriodicFrame, check_model, periodic_frame
from .nonuniform_stability import half_turn
from .roots import root_between
from .unit import TireWheelUnit
from .wheel_matrices import Model, fixed_frame, fixed_frame_matrix

__all__ = [
    "CombinationResonance",
    "TongueMap",
    "TongueThreshold",
    "combination_resonances",
    "instability_scale",
    "nearest_resonance",
    "nearest_tongue",
    "tongue_map",
    "tongue_threshold",
]

FloatArray = NDArray[np.float64]


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
        half = half_turn(unit, several, speed, check_model(model), n_max)
        values, verdict[:, k] = floquet.monodromy_verdicts(half.matrix, half.log_norm, half.error)
        with np.errstate(divide="ignore", over="ignore"):
            logs = np.log(np.abs(values).max(axis=1)) + half.log_norm
            growth[:, k], radius[:, k] = logs * abs(speed) / math.pi, np.exp(2.0 * logs)
    return TongueMap(omega, factors, growth, radius, verdict)


# -- where tongues begin --------------------------------------------------------------------------------------------


class CombinationResonance(NamedTuple):
    """A combination resonance, where a tongue of instability begins: two whirls' frequencies add up to twice the speed.

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
        damping, NaN where one of the two does not decay by itself. It is an estimate for light damping, and no bound:
        :func:`tongue_threshold` has what the verdict says.
    """

    speed: float
    frequencies: tuple[float, float]
    growth: float
    threshold: float


@lru_cache(maxsize=256)
def combination_resonances(
    unit: TireWheelUnit, nonuniformity: Nonuniformity, model: Model = "inextensional"
) -> tuple[CombinationResonance, ...]:
    """Where the tongues of n = 1 and the wheel begin, those that open in proportion to the amplitudes.

    Parameters
    ----------
    unit : TireWheelUnit
    nonuniformity : Nonuniformity
    model : {"inextensional", "complete"}

    Returns
    -------
    tuple of CombinationResonance
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

    system = fixed_frame(undamped, model)

    def frequencies(speeds: FloatArray) -> FloatArray:
        values = np.linalg.eigvals(system.constant + speeds[..., None, None] * system.spin)
        return np.asarray(np.sort(np.abs(values.imag))[..., ::2])

    # Beyond twice the highest, no sum is twice the speed: what still grows does so four times as fast as the speed.
    speeds = np.linspace(0.0, 2.0 * float(frequencies(np.array(0.0))[-1]), 513)
    each = frequencies(speeds)
    resonances: list[CombinationResonance] = []
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
                # a frequency that is there twice gives its resonance twice
                if not any(np.allclose([r.speed, *r.frequencies], [speed, *pair], rtol=1e-6) for r in resonances):
                    F, damped = (fixed_frame_matrix(each, speed, model) for each in (undamped, unit))
                    growth, threshold = _tongue(F, damped - F, parts, *pair.tolist())
                    if growth > 0.0:
                        whirls = (float(pair[0]), float(pair[1]))
                        resonances.append(CombinationResonance(speed, whirls, growth, threshold))
    return tuple(sorted(resonances))


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
        That of one of the :func:`combination_resonances`, with the sign of ``speed`` [rad/s]; None if there is none.
    """
    nearest = nearest_resonance(unit, nonuniformity, speed, model)
    return None if nearest is None else math.copysign(nearest.speed, speed)


def nearest_resonance(
    unit: TireWheelUnit, nonuniformity: Nonuniformity, speed: float, model: Model = "inextensional"
) -> CombinationResonance | None:
    """The combination resonance whose speed is nearest to a given one.

    Parameters
    ----------
    unit : TireWheelUnit
    nonuniformity : Nonuniformity
    speed : float
        Spin Omega [rad/s], either sign.
    model : {"inextensional", "complete"}

    Returns
    -------
    CombinationResonance or None
        One of the :func:`combination_resonances`; None if there is none.
    """
    if not math.isfinite(speed):
        raise ValueError(f"speed is {speed!r}; it must be finite")
    resonances = combination_resonances(unit, nonuniformity, model)
    return min(resonances, key=lambda resonance: abs(resonance.speed - abs(speed)), default=None)


# -- how large the amplitudes must be -------------------------------------------------------------------------------

_STEPS = 8  # among which the first unstable size is looked for before it is bisected


def instability_scale(
    unit: TireWheelUnit,
    nonuniformity: Nonuniformity,
    speed: float,
    model: Model = "inextensional",
    tolerance: float = 1e-6,
) -> float | None:
    """What the amplitudes must be multiplied with for n = 1 and the wheel to be unstable at a speed.

    Parameters
    ----------
    unit : TireWheelUnit
    nonuniformity : Nonuniformity
    speed : float
        Spin Omega [rad/s], either sign, not zero.
    model : {"inextensional", "complete"}
    tolerance : float
        Of the answer, relative to the largest size that is looked at, > 0.

    Returns
    -------
    float or None
        The lowest factor found, by bisection of the verdict of :func:`.nonuniform_stability.stability`; 0 where the
        uniform unit is unstable too. None where no size is, up to amplitudes of one stiffness that add up to 1.

    Raises
    ------
    ValueError
        The speed is zero or not finite, the tolerance is not > 0, or every amplitude is zero.
    ArithmeticError
        The speed is so low that a turn is too long to be integrated.
    """
    if not (math.isfinite(speed) and speed != 0.0):
        raise ValueError(f"speed is {speed!r}; it must be finite and not zero")
    if not tolerance > 0.0:
        raise ValueError(f"tolerance is {tolerance!r}; it must be > 0")
    if nonuniformity.is_uniform:
        raise ValueError("every amplitude of the nonuniformity is 0; no factor changes that")
    largest = max(sum(e for _, e, _ in each) for each in (nonuniformity.radial, nonuniformity.tangential))
    highest = (1.0 - 1e-9) / largest

    def unstable(scales: list[float]) -> list[bool]:
        half = half_turn(unit, [nonuniformity.scaled(scale) for scale in scales], speed, check_model(model), 1)
        _, verdicts = floquet.monodromy_verdicts(half.matrix, half.log_norm, half.error)
        return [floquet.VERDICTS[verdict] == "unstable" for verdict in verdicts]

    scales = [highest * k / _STEPS for k in range(_STEPS + 1)]
    found = unstable(scales)
    if not any(found):
        return None
    first = found.index(True)
    if first == 0:
        return 0.0
    low, high = scales[first - 1 : first + 1]
    while high - low > tolerance * highest:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if unstable([middle])[0] else (middle, high)
    return high


class TongueThreshold(NamedTuple):
    """The lowest point of a tongue of instability over speed and the size of a non-uniformity.

    Attributes
    ----------
    speed : float
        Omega > 0 [rad/s] at which the least amplitudes are enough.
    scale : float
        What the amplitudes must be multiplied with there: the bisected :func:`instability_scale`.
    """

    speed: float
    scale: float


@lru_cache(maxsize=256)
def tongue_threshold(
    unit: TireWheelUnit,
    nonuniformity: Nonuniformity,
    resonance: CombinationResonance,
    model: Model = "inextensional",
) -> TongueThreshold | None:
    """How large the amplitudes must be for a tongue to overcome the damping, by bisection of the verdict.

    Parameters
    ----------
    unit : TireWheelUnit
    nonuniformity : Nonuniformity
    resonance : CombinationResonance
        One of the :func:`combination_resonances` of these.
    model : {"inextensional", "complete"}

    Returns
    -------
    TongueThreshold or None
        To 1e-6 of the largest amplitudes. None where no amplitudes are large enough, and where the tongue has no lowest
        point of its own, as a wider one has swallowed it.

    Raises
    ------
    ArithmeticError
        The speed is so low that a turn is too long to be integrated.

    Notes
    -----
    The speed is looked for within a tenth of the resonance's, and no farther than halfway to the next ones. Bisected
    and first-order thresholds part as the damping grows: for Table 1 at zeta_1 = zeta_s = 0.05 the tongue at 6100 rpm
    begins at 0.090 and not at 0.103, that at 4711 rpm at 0.167 and not at 0.200.
    """
    at = resonance.speed
    if resonance.threshold == 0.0:
        return TongueThreshold(at, 0.0)
    others = [each.speed for each in combination_resonances(unit, nonuniformity, model)]
    low = max([0.9 * at, *(0.5 * (at + other) for other in others if other < at * (1.0 - 1e-6))])
    high = min([1.1 * at, *(0.5 * (at + other) for other in others if other > at * (1.0 + 1e-6))])

    def scale(speed: float, tolerance: float = 1e-6) -> float:
        found = instability_scale(unit, nonuniformity, speed, model, tolerance)
        return math.inf if found is None else found

    # the tongue's own lowest point is the local one that is nearest to the resonance
    speeds = [*np.linspace(low, at, 7).tolist(), *np.linspace(at, high, 7)[1:].tolist()]
    sizes = [scale(speed, 1e-3) for speed in speeds]
    lowest = [
        k for k in range(1, len(speeds) - 1)
        if math.isfinite(sizes[k]) and sizes[k] <= min(sizes[k - 1], sizes[k + 1])
    ]  # fmt: skip
    if not lowest:
        return None
    k = min(lowest, key=lambda k: abs(speeds[k] - at))
    low, high = speeds[k - 1], speeds[k + 1]
    # golden sections, as SciPy, which has better ones, is not loaded beside a running node
    section = 0.5 * (3.0 - math.sqrt(5.0))
    left, right = low + section * (high - low), high - section * (high - low)
    at_left, at_right = scale(left), scale(right)
    while high - low > 1e-4 * at:
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = low + section * (high - low)
            at_left = scale(left)
        else:
            low, left, at_left = left, right, at_right
            right = high - section * (high - low)
            at_right = scale(right)
    return TongueThreshold(left, at_left) if at_left < at_right else TongueThreshold(right, at_right)
