"""Stability of n = 1 and the wheel where the tire is uniform: in the fixed frame its equations are constant."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from . import floquet
from .floquet import FloquetResult
from .roots import root_between
from .unit import TireWheelUnit
from .wheel_matrices import Model, fixed_frame, fixed_frame_matrix

__all__ = ["crossings", "uniform_stability"]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def uniform_stability(unit: TireWheelUnit, speed: float, model: Model = "inextensional") -> FloquetResult:
    """Floquet stability at a constant speed, in closed form; of a unit that is not uniform, its mean's.

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


def crossings(unit: TireWheelUnit, model: Model = "inextensional") -> Iterator[tuple[float, bool]]:
    """Every speed > 0 at which stability is lost (True) or regained (False) [rad/s], from the lowest on.

    Of a unit that is not uniform, its mean's. Backward, they are the same.

    Parameters
    ----------
    unit : TireWheelUnit
    model : {"inextensional", "complete"}

    Notes
    -----
    F(Omega) = F_0 + Omega F_1 can only change its stability where one of its eigenvalues is zero, or two add up to
    zero. Then F is singular, or the matrix whose eigenvalues are all such sums, which acts on antisymmetric matrices X
    as F X + X F^T. Both are linear in the speed, so all these speeds are the real eigenvalues of two matrix pencils,
    and none is missed. Between two of them the verdict cannot change; it is read in the middle of each interval, and
    the crossing is then refined on the spectral abscissa.
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
