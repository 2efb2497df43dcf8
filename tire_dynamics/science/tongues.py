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

__all__ = ["CombinationResonance", "TongueMap", "nearest_tongue", "tongue_map", "combination_resonances"]

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
        damping, NaN where one of the two does not decay by itself.
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
    if not math.isfinite(speed):
        raise ValueError(f"speed is {speed!r}; it must be finite")
    resonances = combination_resonances(unit, nonuniformity, model)
    if not resonances:
        return None
    return math.copysign(min((resonance.speed for resonance in resonances), key=lambda at: abs(at - abs(speed))), speed)
