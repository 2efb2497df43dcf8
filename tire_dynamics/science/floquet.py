"""Floquet stability of linear systems z' = A(t) z with A(t + T) = A(t).

The verdict is (5.4) of Huang & Hsu (1992): asymptotically stable if every multiplier has modulus below one;
marginally stable if the largest modulus is one and every multiplier of modulus one has as many eigenvectors
as its multiplicity; unstable otherwise. Rounding destroys both conditions as they stand: no computed modulus
is exactly one, and a double multiplier that lacks an eigenvector, disturbed by eps, becomes two simple ones
sqrt(eps) apart. The verdict is therefore taken from what is well conditioned (Stewart & Sun, *Matrix
Perturbation Theory*, 1990, ch. V):

1. What is known is a matrix and a bound E on its error, in balanced coordinates, so that neither depends on
   the units of the states.
2. A Schur form ordered to begin with a set of m multipliers begins with their own m x m block B, known to
   e = ||P|| E, P being the spectral projector of the set, sqrt(1 + ||X||_F^2) with B X - X C = D for the form
   [[B, D], [0, C]]. Their mean is known to the same e, however far the members scatter.
3. All multipliers start as one set. A set is cut at its widest gap if the gap is more than 4 (e_1 + e_2) of
   its two parts. The m multipliers into which E splits one of multiplicity m, in a single Jordan chain, lie
   on a circle at gaps of at most m sin(pi/m) < pi times e_1 + e_2, so these are not cut; nor are multipliers
   with all their eigenvectors, which E moves by E; and multipliers that E cannot have parted are.
4. R = B - mean I of a set that is one multiplier is nilpotent, R^k = 0 for a k <= m, and has all eigenvectors
   exactly if k = 1. Being known to 2 e (e from B, e from the mean), it shows
   ||R^k|| <= 2 e k (||R|| + 2 e)^(k - 1). The smallest k for which this holds is taken; if there is none, the
   set is not one multiplier and is cut after all. For k = 1 this compares ||R|| with its own error; where an
   eigenvector is missing, ||R|| is the coupling in the Jordan chain, which does not shrink with E, so the
   two cases lie some ten decades apart.
5. The mean says whether a set lies inside, outside or, within e, on the circle; k whether it may lie there.

The same rule reads exponents, with the imaginary axis in place of the circle.

For a constant matrix the common case is decided from eigenvalues and eigenvectors alone, many matrices at once: where
all eigenvalues lie further apart than 4 (e_1 + ... + e_n), e_i = ||P_i|| E, step 3 cuts every set down to single
ones, because ||P|| of a set is at most the sum over its members, and step 4 has nothing left to do.

The file is long because each of these steps carries the error bound of the one before.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "VERDICTS",
    "FloquetResult",
    "Verdict",
    "analyze",
    "analyze_constant",
    "constant_verdicts",
    "judge",
    "monodromy_verdicts",
]

Verdict = Literal["asymptotically stable", "marginally stable", "unstable"]
VERDICTS: Final[tuple[Verdict, ...]] = ("asymptotically stable", "marginally stable", "unstable")
Matrix = NDArray[Any]  # float64 or complex128
ComplexArray = NDArray[np.complex128]
StateMatrix = Callable[[float], ArrayLike]

EPSILON = float(np.finfo(np.float64).eps)
TINY = float(np.finfo(np.float64).tiny)
LOG_MAX = math.log(np.finfo(np.float64).max)
MOST_CELLS = 2**15  # some seconds of work; 10^5 radians of the fastest motion in one period
SHORTEST_CELL = 2.0**-44  # over the period; below it the rounding of t shows
LARGE = 16  # states, from which on arrays are faster than lists


@dataclass(frozen=True, slots=True, eq=False)
class FloquetResult:
    """Floquet multipliers and exponents of a linear system, and what they say about its stability.

    Attributes
    ----------
    multipliers : ndarray of complex, shape (n,), or None
        By descending modulus, then descending imaginary part of the exponent. None where there is no period.
    exponents : ndarray of complex, shape (n,)
        [1/s], in the same order; exp(exponents * period) = multipliers.
    spectral_radius : float or None
        Largest modulus of the multipliers.
    error_estimate : float
        Bound on the absolute error of each multiplier; of each exponent [1/s] where there is no period. If a
        double multiplier lacks an eigenvector, of the order of the square root of the matrix's error.
    verdict : {"asymptotically stable", "marginally stable", "unstable"}
        By (5.4), as the module's notes say: as sharp as the clusters' means, not as single multipliers.
    period : float or None
        [s]; None for a constant system judged by its exponents alone.
    """

    multipliers: ComplexArray | None
    exponents: ComplexArray
    spectral_radius: float | None
    error_estimate: float
    verdict: Verdict
    period: float | None


def analyze(state_matrix: StateMatrix | ArrayLike, period: float, rtol: float = 1e-10) -> FloquetResult:
    """Floquet multipliers, exponents and stability of z' = A(t) z.

    Parameters
    ----------
    state_matrix : callable t -> (n, n) array_like, real or complex, or one such array
        A(t) [1/s] for 0 < t < period, piecewise smooth; what lasts less than a hundredth of the period may be
        missed. An array goes to `analyze_constant`.
    period : float
        T [s], positive.
    rtol : float
        Relative accuracy asked of the propagators, 1e-14 to 1e-2; ``error_estimate`` says what was reached.

    Returns
    -------
    FloquetResult
        Imaginary parts of exponents lie in (-pi/T, pi/T]. The exponent of a multiplier that is smaller than
        ``error_estimate`` is not resolved.

    Raises
    ------
    ValueError
        An argument is out of its bounds, or A(t) is not finite, not square or changes its size.
    ArithmeticError
        A(t) is too large or too irregular to be integrated, or the solution overflows.

    Notes
    -----
    The monodromy matrix is a product of propagators over cells of the period, each from Lobatto collocation
    with eight nodes (order 14, A-stable), which is linear in the state, so that units do not matter. A cell
    is halved until its propagator agrees with the product over its halves, which is then used.

    Where A is smooth the disagreement falls by 2^15 per halving and bounds the error with ease. Where it fell
    by less than 2^10, as at a jump of A, the larger of it and the parent's is taken, fourfold: enough for
    singularities up to t^(-1/2). A node at each end of a cell sees to it that no jump hides there. All this,
    and rounding, is carried to the end of the period by the norms of the products before and after the cell;
    the sum bounds the error of the monodromy matrix.
    """
    if not 1e-14 <= rtol <= 1e-2:
        raise ValueError(f"rtol is {rtol!r}; it must be between 1e-14 and 1e-2")
    _check_period(period)
    if not callable(state_matrix):
        return analyze_constant(state_matrix, period)
    evaluate, rate = _balanced(state_matrix, period)
    monodromy, log_norm, error = _monodromy(evaluate, rate, period, rtol)
    return judge(monodromy, log_norm, error, period)


def judge(monodromy: Matrix, log_norm: float, error: float, period: float, repeats: int = 1) -> FloquetResult:
    """The same from a monodromy matrix, or from one whose power it is.

    Parameters
    ----------
    monodromy : ndarray, shape (n, n)
        Over exp(log_norm), in balanced coordinates.
    log_norm : float
        Logarithm of what it is to be multiplied with.
    error : float
        Bound on its error, in the 2-norm.
    period : float
        T [s], positive.
    repeats : int
        How often the matrix stands in the period: the multipliers are this power of its eigenvalues. The verdict is
        read from the matrix, whose eigenvalues may differ where their powers do not.

    Returns
    -------
    FloquetResult

    Raises
    ------
    ArithmeticError
        A multiplier overflows.
    """
    whole = repeats * log_norm
    if whole > LOG_MAX:
        raise ArithmeticError(f"the solution grows by exp({whole:.4g}) in a period; it overflows")
    circle = math.exp(min(-log_norm, LOG_MAX))
    found, all_errors = _eigenvalues(monodromy[None], np.array([error]))
    values, errors = found[0], all_errors[0]
    if np.isnan(errors[0]):
        clusters = _clusters(monodromy, error)
        verdict = _verdict([(abs(cluster.mean) - circle, cluster) for cluster in clusters])
        radius = max(cluster.radius for cluster in clusters)
    else:  # every multiplier a cluster of its own
        verdict = VERDICTS[_codes(np.abs(found) - circle, all_errors)[0]]
        radius = 3.0 * float(errors.max())
    # a multiplier of zero has no exponent; the smallest normal number stands in for it
    exponents = (np.log(values + TINY * (values == 0.0)) + log_norm) * repeats / period
    largest = float(np.abs(values).max())
    spread = radius if repeats == 1 else (largest + radius) ** repeats - largest**repeats
    return _result(values**repeats * math.exp(whole), exponents, spread * math.exp(whole), verdict, period)


def monodromy_verdicts(
    monodromies: Matrix, log_norms: NDArray[np.float64], errors: NDArray[np.float64]
) -> tuple[ComplexArray, NDArray[np.int8]]:
    """Eigenvalues and verdicts of many monodromy matrices, each the same as `judge` has them.

    Parameters
    ----------
    monodromies : ndarray, shape (N, n, n)
        Each over exp(log_norm), in balanced coordinates.
    log_norms, errors : ndarray, shape (N,)
        As for `judge`.

    Returns
    -------
    values : ndarray of complex, shape (N, n)
        Eigenvalues of the matrices as they are given, in no particular order.
    verdicts : ndarray of int8, shape (N,)
        Indices into ``VERDICTS``.
    """
    circles = np.exp(np.minimum(-log_norms, LOG_MAX))
    values, bounds = _eigenvalues(monodromies, errors)
    codes = _codes(np.abs(values) - circles[:, None], bounds)
    for k in np.flatnonzero(np.isnan(bounds[:, 0])):
        clusters = _clusters(monodromies[k], float(errors[k]))
        codes[k] = VERDICTS.index(_verdict([(abs(cluster.mean) - circles[k], cluster) for cluster in clusters]))
    return values, codes


def analyze_constant(matrix: ArrayLike, period: float | None = None) -> FloquetResult:
    """The same for constant A, in closed form: the exponents are its eigenvalues, multipliers exp(lambda T).

    Serves every system that a periodic change of coordinates (Lyapunov, Coleman) makes constant.

    Parameters
    ----------
    matrix : array_like, shape (n, n)
        A [1/s], real or complex, taken as exact but for rounding.
    period : float, optional
        T [s], positive. Without it there are no multipliers.

    Returns
    -------
    FloquetResult
        The verdict is read from the exponents in either case: exp(A T) has the eigenvectors of A.

    Raises
    ------
    ValueError
        The matrix is not finite or not square, or the period not positive.
    ArithmeticError
        A multiplier overflows.
    """
    A = _square(matrix, "matrix")[None]
    A = A * balance(np.abs(A))
    rounding = _rounding(A)
    values, all_errors = _eigenvalues(A, rounding)
    exponents, errors = values[0], all_errors[0]
    if np.isnan(errors[0]):
        clusters = _clusters(A[0], float(rounding[0]))
        verdict = _verdict([(cluster.mean.real, cluster) for cluster in clusters])
        reals = np.array([cluster.mean.real for cluster in clusters])
        radii = np.array([cluster.radius for cluster in clusters])
    else:  # every eigenvalue a cluster of its own
        verdict = VERDICTS[_codes(values.real, all_errors)[0]]
        reals, radii = exponents.real, 3.0 * errors
    if period is None:
        return _result(None, exponents, float(radii.max()), verdict, None)
    _check_period(period)
    growth = float(exponents.real.max()) * period
    if growth > LOG_MAX:
        raise ArithmeticError(f"the solution grows by exp({growth:.4g}) in a period; it overflows")
    # |exp(a T) - exp(b T)| <= min(|a - b| T, 2) times the larger of their moduli
    larger = np.exp(np.minimum((reals + radii) * period, LOG_MAX - 1.0))
    error = float((np.minimum(radii * period, 2.0) * larger).max())
    return _result(np.exp(exponents * period), exponents, error, verdict, period)


def constant_verdicts(matrices: Matrix, sizes: NDArray[np.float64]) -> tuple[ComplexArray, NDArray[np.int8]]:
    """Exponents and verdicts of many systems of constant A, each the same as `analyze_constant` has them.

    Parameters
    ----------
    matrices : ndarray, shape (N, n, n)
        A [1/s].
    sizes : ndarray, shape (N, n)
        Units for the states, powers of two, that bring rows and columns of A to about one size: speed hangs on them.

    Returns
    -------
    exponents : ndarray of complex, shape (N, n)
        [1/s], in no particular order.
    verdicts : ndarray of int8, shape (N,)
        Indices into ``VERDICTS``.

    Raises
    ------
    ValueError
        A matrix is not finite.

    Notes
    -----
    Most matrices are clear from eigenvalues alone, which are had in half the time: with delta_i the distance from
    eigenvalue i to the nearest other and D^2 = ||A||_F^2 - sum |lambda|^2, ||P_i|| is at most
    (1 + (D/delta_i)^2/(n - 1))^((n - 1)/2) (Smith, *Numerische Mathematik* 10, 1967). Where this, sixteenfold, says
    that no eigenvalue can be on the axis, nor two of them be one, the signs of the real parts are the verdict.
    """
    if not np.isfinite(matrices).all():
        raise ValueError("matrix is not finite; every element must be")
    n = matrices.shape[1]
    scaled = matrices * (sizes[:, None, :] / sizes[:, :, None])
    values = np.linalg.eigvals(scaled).astype(np.complex128, copy=False)
    square = np.square(np.abs(scaled)).sum(axis=(1, 2))
    departure = np.maximum(square - np.square(np.abs(values)).sum(axis=1), EPSILON * square)
    distance = _distances(values).min(axis=2)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # what is not a number is not clear
        projector = (1.0 + departure[:, None] / (distance * distance) / max(n - 1, 1)) ** (0.5 * (n - 1))
        errors = 16.0 * (10.0 * n * EPSILON * np.sqrt(square))[:, None] * projector
        clear = (np.abs(values.real) > errors).all(axis=1) & (distance.min(axis=1) > 4.0 * errors.sum(axis=1))
    codes = _codes(values.real, errors)
    others = np.flatnonzero(~clear)
    if others.size:
        A = matrices[others] * balance(np.abs(matrices[others]))
        rounding = _rounding(A)
        near, errors = _eigenvalues(A, rounding)
        codes[others] = _codes(near.real, errors)
        for k in np.flatnonzero(np.isnan(errors[:, 0])):
            clusters = _clusters(A[k], float(rounding[k]))
            codes[others[k]] = VERDICTS.index(_verdict([(cluster.mean.real, cluster) for cluster in clusters]))
    return values, codes


def _rounding(matrices: Matrix) -> NDArray[np.float64]:
    """The error E of each matrix that rounding stands for."""
    return np.asarray(10.0 * matrices.shape[1] * EPSILON * np.linalg.norm(matrices, 2, axis=(1, 2)))


def _distances(values: ComplexArray) -> NDArray[np.float64]:
    """Of all pairs, (N, n, n) for values (N, n); infinite from each to itself."""
    one = np.arange(values.shape[1])
    distances = np.abs(values[:, :, None] - values[:, None, :])
    distances[:, one, one] = math.inf
    return distances


def _eigenvalues(matrices: Matrix, rounding: NDArray[np.float64]) -> tuple[ComplexArray, NDArray[np.float64]]:
    """Eigenvalues (N, n) and bounds e_i on their errors, NaN where a matrix may have multiple ones."""
    n = matrices.shape[1]
    found, columns = np.linalg.eig(matrices)
    values, vectors = found.astype(np.complex128), columns.astype(np.complex128)
    gap = _distances(values).min(axis=(1, 2))
    vectors[gap <= 4.0 * n * rounding] = np.eye(n)  # multiple; may have no inverse
    # P_i = v_i u_i, the columns v_i of length 1 and the rows u_i of the inverse
    errors = rounding[:, None] * np.linalg.norm(_inverses(vectors), axis=2)
    errors[~(gap > 4.0 * np.maximum(errors.sum(axis=1), n * rounding))] = math.nan
    return values, errors


def _inverses(matrices: ComplexArray) -> ComplexArray:
    """The inverse of each matrix, NaN where there is none."""
    try:
        return np.linalg.inv(matrices).astype(np.complex128, copy=False)
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full_like(matrices, math.nan)
        middle = len(matrices) // 2
        return np.concatenate([_inverses(matrices[:middle]), _inverses(matrices[middle:])])


def _codes(beyond: NDArray[np.float64], errors: NDArray[np.float64]) -> NDArray[np.int8]:
    """(5.4) for simple eigenvalues so far beyond the boundary, as indices into ``VERDICTS``; NaN errors: anything."""
    outside, on_boundary = (beyond > errors).any(axis=1), (np.abs(beyond) <= errors).any(axis=1)
    return np.where(outside, 2, np.where(on_boundary, 1, 0)).astype(np.int8)


def _result(
    multipliers: ComplexArray | None,
    exponents: ComplexArray,
    error: float,
    verdict: Verdict,
    period: float | None,
) -> FloquetResult:
    order = np.lexsort((-exponents.imag, -exponents.real))
    if multipliers is None:
        return FloquetResult(None, exponents[order], None, error, verdict, None)
    radius = float(np.abs(multipliers).max())
    return FloquetResult(multipliers[order], exponents[order], radius, error, verdict, period)


class _Cluster(NamedTuple):
    """Eigenvalues taken for one: mean, bounds on its error and on any member's, lack of eigenvectors."""

    mean: complex
    mean_error: float
    radius: float
    defective: bool


def _verdict(clusters: list[tuple[float, _Cluster]]) -> Verdict:
    """(5.4) from every cluster and how far its mean lies beyond the boundary of stability."""
    on_boundary = [cluster for beyond, cluster in clusters if abs(beyond) <= cluster.mean_error]
    outside = any(beyond > cluster.mean_error for beyond, cluster in clusters)
    if outside or any(cluster.defective for cluster in on_boundary):
        return "unstable"
    return "marginally stable" if on_boundary else "asymptotically stable"


def _clusters(matrix: Matrix, error: float) -> list[_Cluster]:
    """Steps 2 to 4 of the module's notes, for a matrix whose 2-norm error is at most ``error``."""
    form = _schur_form(matrix)
    values = np.diag(form)
    n = len(values)

    def block(members: list[int]) -> tuple[ComplexArray, float]:
        ordered, m = _ordered(form, members), len(members)
        B = ordered[:m, :m]
        return B, error * min(_projector_norm(B, ordered[:m, m:], ordered[m:, m:]), 1.0 / EPSILON)

    clusters = []
    undecided = [(list(range(n)), *block(list(range(n))))]
    while undecided:
        members, B, e = undecided.pop()
        m = len(members)
        parts, gap = _cut_at_widest_gap(members, values)
        blocks = [(part, *block(part)) for part in parts if part and m > 1]
        if gap > 4.0 * sum(part_error for _, _, part_error in blocks):
            undecided += blocks
            continue
        mean = complex(np.trace(B)) / m
        R = B - mean * np.eye(m)
        size = float(np.linalg.norm(R, 2))
        power = np.eye(m)
        for k in range(1, m + 1):
            power = power @ R
            rest, bound = float(np.linalg.norm(power, 2)), 2.0 * e * k * (size + 2.0 * e) ** (k - 1)
            if rest <= bound:
                # the true R^k is at most rest + bound, and no eigenvalue of R exceeds its k-th root
                radius = e + (rest + bound) ** (1.0 / k) + float(np.abs(np.diag(R)).max())
                clusters.append(_Cluster(mean, e, radius, k > 1))
                break
        else:
            undecided += blocks
    return clusters


def _schur_form(matrix: Matrix) -> ComplexArray:
    """The upper triangular Q^H A Q of a square matrix A for some unitary Q.

    One eigenvalue after the other is split off: a computed eigenvector has a small residual, however close to another
    it is, and a unitary matrix that begins with it takes it out. SciPy has this from LAPACK in less time; but the live
    node needs it too, at a slow turn of a tire that varies, and SciPy is 40 MB of its memory.
    """
    form = matrix.astype(np.complex128)
    for k in range(len(form) - 1):
        _, vectors = np.linalg.eig(form[k:, k:])
        unitary, _ = np.linalg.qr(vectors[:, :1], mode="complete")
        form[:, k:] = form[:, k:] @ unitary
        form[k:] = unitary.conj().T @ form[k:]
        form[k + 1 :, k] = 0.0
    return form


def _ordered(form: ComplexArray, members: list[int]) -> ComplexArray:
    """A Schur form with the same eigenvalues in another order: these places of the diagonal first."""
    form = form.copy()
    for place, member in enumerate(sorted(members)):
        for k in range(member - 1, place - 1, -1):  # exchange the places k and k + 1 (Golub & Van Loan, 7.6.2)
            vector = np.array([form[k, k + 1], form[k + 1, k + 1] - form[k, k]])
            size = float(np.linalg.norm(vector))
            if size == 0.0:  # twice the same, uncoupled
                continue
            c, s = vector / size
            turn = np.array([[c, -s.conjugate()], [s, c.conjugate()]])
            form[:, k : k + 2] = form[:, k : k + 2] @ turn
            form[k : k + 2] = turn.conj().T @ form[k : k + 2]
            form[k + 1, k] = 0.0
    return form


def _projector_norm(B: ComplexArray, D: ComplexArray, C: ComplexArray) -> float:
    """||P|| of the spectral projector [[I, X], [0, 0]] that goes with B of [[B, D], [0, C]], both triangular."""
    X = np.zeros_like(D)
    one = np.eye(len(B))
    for k in range(len(C)):  # B X - X C = -D, column by column
        shifted = B - C[k, k] * one
        right = X[:, :k] @ C[:k, k] - D[:, k]
        try:
            X[:, k] = np.linalg.solve(shifted, right)
        except np.linalg.LinAlgError:  # an eigenvalue is in both
            return math.inf
    return math.hypot(1.0, float(np.linalg.norm(X)))


def _cut_at_widest_gap(members: list[int], values: ComplexArray) -> tuple[list[list[int]], float]:
    """Two parts and their distance: the longest edge of the minimal spanning tree (Prim's) is cut."""
    order, rest, gaps = members[:1], members[1:], [0.0]
    nearest = np.full(len(rest), np.inf)
    while rest:
        nearest = np.minimum(nearest, np.abs(values[rest] - values[order[-1]]))
        closest = int(nearest.argmin())
        gaps.append(float(nearest[closest]))
        order.append(rest.pop(closest))
        nearest = np.delete(nearest, closest)
    cut = int(np.argmax(gaps))
    # Prim's tree has all of one side before it takes the longest edge.
    return [order[:cut], order[cut:]], gaps[cut]


@np.errstate(over="ignore", invalid="ignore")  # what is not finite is not accepted
def _monodromy(
    evaluate: Callable[[float], Matrix], rate: float, period: float, rtol: float
) -> tuple[Matrix, float, float]:
    """The monodromy matrix over its 2-norm, the norm's logarithm, a bound on the error of the former."""
    if not rate * period <= 4 * MOST_CELLS:
        raise ArithmeticError(f"|A| T is {rate * period:.4g}; up to {4 * MOST_CELLS} can be integrated")
    count = max(8, math.ceil(rate * period / 4.0))
    width = period / count
    shortest, edge = SHORTEST_CELL * period, EPSILON * period
    cells = []  # start, width, propagator, the parent's disagreement; the earliest comes last
    for k in reversed(range(count)):
        cells.append((k * width, width, _propagator(evaluate, k * width, width, edge), math.inf))
    steps: list[Matrix] = []
    errors = []
    while cells:
        start, width, coarse, parent_gap = cells.pop()
        width *= 0.5
        halves = [_propagator(evaluate, t, width, edge) for t in (start, start + width)]
        fine = halves[1] @ halves[0]
        size = float(np.linalg.norm(fine))
        gap = float(np.linalg.norm(fine - coarse))
        estimate = gap if 2.0**10 * gap <= parent_gap else 4.0 * max(gap, parent_gap)
        rounding = 10.0 * len(fine) * EPSILON
        tolerance = max(rtol * max(width / period, 2.0**-10), rounding) * size
        if estimate <= tolerance or (width < shortest and math.isfinite(estimate)):
            steps.append(fine)
            errors.append(estimate + rounding * size)
        else:
            cells += [(start + width, width, halves[1], gap), (start, width, halves[0], gap)]
        if len(cells) + len(steps) > MOST_CELLS or width < 0.5 * shortest:
            raise ArithmeticError(f"A(t) is too irregular or too large to be integrated at t = {start:.6g}")
    monodromy, before = _products(steps)
    _, after = _products([step.T for step in reversed(steps)])
    error = float(np.exp(before[:-1] + after[-2::-1] - before[-1]) @ errors)
    if not error < 0.1:
        raise ArithmeticError(f"A(t) cannot be integrated: relative error {error:.2g}; it must be below 0.1")
    return monodromy, float(before[-1]), error  # eight cells' rounding covers that of the eigenvalues


def _products(steps: list[Matrix]) -> tuple[Matrix, NDArray[np.float64]]:
    """The product of all steps over its 2-norm; logarithms of the norms of the first 0, 1, ... steps'."""
    product: Matrix = np.eye(len(steps[0]))
    logarithms = [0.0]
    for step in steps:
        product = step @ product
        norm = float(np.linalg.norm(product, 2))
        product = product / norm
        logarithms.append(logarithms[-1] + math.log(norm))
    return product, np.array(logarithms)


def _lobatto(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes c_i on [0, 1], both ends included, and a_ij = int_0^{c_i} l_j, whose last row has the weights."""
    inner = np.sort(legendre.Legendre.basis(count - 1).deriv().roots().real)
    x = np.concatenate([[-1.0], inner, [1.0]])
    lagrange = np.linalg.inv(legendre.legvander(x, count - 1))  # Legendre series of l_j in column j
    return 0.5 + 0.5 * x, 0.5 * legendre.legvander(x, count) @ legendre.legint(lagrange, lbnd=-1)


# Seven implicit stages, an odd number: a cell far too long gives -1 where its halves give (-1)^2, and is cut.
_NODES, _COEFFICIENTS = _lobatto(8)


def _propagator(evaluate: Callable[[float], Matrix], start: float, width: float, edge: float) -> Matrix:
    """The matrix that takes z(start) to z(start + width): slopes K_i = A_i (1 + width sum_j a_ij K_j)."""
    # A jump on the border of two cells belongs to neither: the outer nodes move in by the rounding of t.
    times = np.clip(start + width * _NODES, start + edge, start + width - edge)
    A = np.stack([evaluate(float(t)) for t in times])
    a = width * _COEFFICIENTS
    s, n = len(A) - 1, A.shape[1]
    implicit = np.eye(s * n) - np.einsum("ij,ikl->ikjl", a[1:, 1:], A[1:]).reshape(s * n, s * n)
    explicit = A[1:] + a[1:, 0, None, None] * (A[1:] @ A[0])  # a_0j = 0, hence K_0 = A_0
    slopes = np.linalg.solve(implicit, explicit.reshape(s * n, n)).reshape(s, n, n)
    propagator: Matrix = np.eye(n) + a[-1, 0] * A[0] + np.tensordot(a[-1, 1:], slopes, 1)
    return propagator


def _balanced(state_matrix: StateMatrix, period: float) -> tuple[Callable[[float], Matrix], float]:
    """A(t) with its states scaled to bring rows and columns to one size, and a bound on its rates [1/s]."""
    times = [period * (k + 0.5) / 32 for k in range(32)]
    n = len(_square(state_matrix(times[0]), f"state_matrix({times[0]:.6g})"))
    samples = [_square(state_matrix(t), f"state_matrix({t:.6g})", n) for t in times]
    largest = np.max(np.abs(samples), axis=0)
    [factors] = balance(largest[None])
    norm = max(float(np.linalg.norm(A * factors, 2)) for A in samples)
    # Perron's root bounds the spectral radius too, and is not misled by a coupling in one direction only.
    perron = float(np.abs(np.linalg.eigvals(largest * factors)).max())

    def evaluate(t: float) -> Matrix:
        scaled: Matrix = _square(state_matrix(t), f"state_matrix({t:.6g})", n) * factors
        return scaled

    return evaluate, min(norm, perron)


def balance(sizes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Factors s_j/s_i, powers of two, that bring rows and columns of matrices of these sizes (N, n, n) to one norm."""
    # An element below the rounding of the largest may be rounding itself: not to be magnified.
    sizes = np.where(sizes > EPSILON * sizes.max(axis=(1, 2), keepdims=True), sizes, 0.0)
    if sizes.shape[1] > LARGE:
        scales = np.array([_scales_of_large(size / size.max()) if size.any() else np.ones(len(size)) for size in sizes])
    else:
        scales = np.array([_scales(size.tolist()) for size in sizes])
    return np.asarray(scales[:, None, :] / scales[:, :, None])


def _scales(sizes: list[list[float]]) -> list[float]:
    """Units of the states, powers of two, as LAPACK's gebal has them: Parlett & Reinsch, *Numerische Mathematik* 13
    (1969), with 2-norms and the diagonal (James, Langou & Lowery, arXiv:1401.5766).

    What is coupled in one direction only is so brought down to its own rate, and no further.
    """
    n = len(sizes)
    scales = [1.0] * n
    changed = True
    while changed:
        changed = False
        for i, row in enumerate(sizes):
            into, out = math.hypot(*row), math.hypot(*(other[i] for other in sizes))
            if into > 0.0 and out > 0.0:
                factor = 2.0 ** round(0.5 * math.log2(into / out))
                if out * factor + into / factor < 0.95 * (into + out):
                    changed = True
                    scales[i] *= factor
                    for other in sizes:
                        other[i] *= factor
                    sizes[i] = [value / factor for value in sizes[i]]
    return scales


def _scales_of_large(sizes: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same with arrays, which are faster from some 16 states on; sizes up to 1."""
    scales = np.ones(len(sizes))
    changed = True
    while changed:
        changed = False
        for i in range(len(sizes)):
            row, column = sizes[i], sizes[:, i]
            into, out = math.sqrt(row @ row), math.sqrt(column @ column)
            if into > 0.0 and out > 0.0:
                factor = 2.0 ** round(0.5 * math.log2(into / out))
                if out * factor + into / factor < 0.95 * (into + out):
                    changed = True
                    scales[i] *= factor
                    sizes[:, i] *= factor
                    sizes[i] /= factor
    return scales


def _square(values: ArrayLike, name: str, size: int | None = None) -> Matrix:
    A = np.asarray(values)
    if A.ndim != 2 or A.shape[0] != A.shape[1] or not A.size:
        raise ValueError(f"{name} has shape {A.shape}; it must be square, (n, n) with n >= 1")
    if size is not None and len(A) != size:
        raise ValueError(f"{name} has shape {A.shape}; it must be ({size}, {size}) at all times")
    A = A.astype(np.complex128 if np.iscomplexobj(A) else np.float64)
    if not np.isfinite(A).all():
        raise ValueError(f"{name} is not finite; every element must be")
    return A


def _check_period(period: float) -> None:
    if not (math.isfinite(period) and period > 0.0):
        raise ValueError(f"period is {period!r}; it must be positive and finite")
