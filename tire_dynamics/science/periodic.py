"""Systems z' = A(phi) z whose matrix is a trigonometric polynomial, phi' constant: propagators by Taylor series.

Over a short interval of the phase the transition matrix is its Taylor series, because that of a cosine is known: with
the sums C, S of a harmonic turned to the interval's begin, only even powers of the phase meet C and only odd ones S.
All intervals, and all systems of a batch, go through the same sums together.

What is cut off a series is bounded by the tail of the series that has norms for matrices and absolute values for the
coefficients of cosines. This, and rounding, is carried to the end by the norms of the products before and after.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .floquet import EPSILON, balance

__all__ = ["ORDER", "Transition", "Trigonometric", "transition"]

ORDER = 20  # of the series
REACH = 1.5  # |A| h + (highest harmonic) |phi' h| of an interval: its 21st term is 1e-16
TAIL = 24  # terms of the series' remainder that are summed; the next is below 1e-30
MOST_NUMBERS = 2**23  # of all intervals' matrices together: some seconds of work and 200 MB
ROOM = 2**16  # numbers of a coefficient of the series that are held at once
FloatArray = NDArray[np.float64]


class Trigonometric(NamedTuple):
    """A(phi) = constant + sum_k cosines[k] cos(harmonics[k] phi) + sines[k] sin(harmonics[k] phi) [1/s].

    Attributes
    ----------
    constant : ndarray, shape (n, n), or (B, n, n) for many systems
    harmonics : tuple of int, length H
    cosines, sines : ndarray, shape (H, n, n), or (H, B, n, n)
    """

    constant: FloatArray
    harmonics: tuple[int, ...]
    cosines: FloatArray
    sines: FloatArray

    def at(self, phase: float) -> FloatArray:
        """A at a phase [rad]."""
        total: FloatArray = self.constant.copy()
        for m, cosine, sine in zip(self.harmonics, self.cosines, self.sines, strict=True):
            total = total + math.cos(m * phase) * cosine + math.sin(m * phase) * sine
        return total


class Transition(NamedTuple):
    """Transition matrices in balanced coordinates, each over exp(log_norm).

    Attributes
    ----------
    matrix : ndarray, shape (B, n, n)
        Of norm 1.
    log_norm, error : ndarray, shape (B,)
        Logarithm of what each is to be multiplied with; bound on the error of each, in the 2-norm.
    factors : ndarray, shape (n, n)
        What they have been multiplied with, element by element, to balance them.
    """

    matrix: FloatArray
    log_norm: FloatArray
    error: FloatArray
    factors: FloatArray


def transition(system: Trigonometric, rate: float, start: float, stop: float) -> Transition:
    """The matrices that take z at one phase to z at another.

    Parameters
    ----------
    system : Trigonometric
        One, or B of them.
    rate : float
        phi' [rad/s], not zero.
    start, stop : float
        Phases [rad], apart in the sense of ``rate``.

    Returns
    -------
    Transition

    Raises
    ------
    ArithmeticError
        The time is too long: the matrices of all intervals would be more than 2^23 numbers.

    Notes
    -----
    The work is proportional to abs(A) (stop - start)/rate: a slow turn is a long one.
    """
    n = system.constant.shape[-1]
    H = len(system.harmonics)
    A = system.constant.reshape(-1, n, n)
    B = len(A)
    C, S = (np.broadcast_to(x if x.ndim == 4 else x[:, None], (H, B, n, n)) for x in (system.cosines, system.sines))
    [factors] = balance((np.abs(A) + np.abs(C).sum(axis=0) + np.abs(S).sum(axis=0)).max(axis=0)[None])
    A, C, S = A * factors, C * factors, S * factors
    sizes = np.stack([_norms(A), *(_norms(C[k]) + _norms(S[k]) for k in range(H))])
    time = (stop - start) / rate
    need = (float(sizes.sum(axis=0).max()) * time + max(system.harmonics, default=0) * abs(stop - start)) / REACH
    most = MOST_NUMBERS // (B * n * n)
    if not need <= most:
        raise ArithmeticError(f"|A| T is {need * REACH:.4g}; up to {most * REACH:.6g} can be integrated")
    count = max(1, math.ceil(need))
    h = time / count
    weights = _weights(system.harmonics, rate * h)
    cut = _remainder(sizes, np.abs(weights), h)
    blocks = np.concatenate([A, *C, *S], axis=0).reshape(1 + 2 * H, B, n, n)
    wide = np.ascontiguousarray(blocks.transpose(1, 2, 0, 3).reshape(B, n, -1))
    phases = start + (stop - start) * (np.arange(count) / count)
    step = max(1, ROOM // (B * n * n))
    Z = np.empty((count, B, n, n))
    for first in range(0, count, step):
        part = slice(first, first + step)
        Z[part] = _series(wide, weights, phases[part], system.harmonics, h)
    matrix, before = _products(Z)
    _, after = _products(np.swapaxes(Z[::-1], -2, -1))
    log_norm = before[-1]
    sizes = np.sqrt(np.square(Z).sum(axis=(-2, -1)))
    lost = np.log(cut + 10.0 * n * EPSILON * sizes)  # eight of ten cover the products' own rounding
    error = np.exp(before[:-1] + after[-2::-1] + lost - log_norm).sum(axis=0)
    if not float(error.max()) < 0.1:
        raise ArithmeticError(
            f"A(t) cannot be integrated: relative error {float(error.max()):.2g}; it must be below 0.1"
        )
    return Transition(matrix, log_norm, error, factors)


def _weights(harmonics: tuple[int, ...], turn: float) -> FloatArray:
    """Coefficients of x^l in cos(m turn x) and sin(m turn x), shape (2 H, ORDER + TAIL): cosines first."""
    l = np.arange(ORDER + TAIL)  # noqa: E741
    factorial = np.array([float(math.factorial(k)) for k in l])
    power = (np.array(harmonics, dtype=np.float64).reshape(-1, 1) * turn) ** l / factorial
    cosine = np.where(l % 2 == 0, np.where(l % 4 == 0, 1.0, -1.0), 0.0)
    sine = np.where(l % 2 == 1, np.where(l % 4 == 1, 1.0, -1.0), 0.0)
    return np.concatenate([power * cosine, power * sine])


def _series(wide: FloatArray, weights: FloatArray, phases: FloatArray, harmonics: tuple[int, ...], h: float) -> Any:
    """Transitions (S, B, n, n) over intervals that begin at the phases (S,), each of the duration h."""
    B, n, _ = wide.shape
    S, H = phases.size, len(harmonics)
    terms = np.empty((ORDER + 1, B, n, S, n))
    terms[0] = np.eye(n)[:, None, :]
    flat = terms.reshape(ORDER + 1, -1)
    entering = np.empty((1 + 2 * H, B, n, S, n))
    turned = np.multiply.outer(np.array(harmonics, dtype=np.float64), phases)[:, None, None, :, None]
    cos, sin = np.cos(turned), np.sin(turned)
    for k in range(ORDER):
        entering[0] = terms[k]
        if H:
            past = np.stack([weight[k::-1] @ flat[: k + 1] for weight in weights]).reshape(2 * H, B, n, S, n)
            entering[1 : 1 + H] = cos * past[:H] - sin * past[H:]
            entering[1 + H :] = sin * past[:H] + cos * past[H:]
        columns = entering.transpose(1, 0, 2, 3, 4).reshape(B, -1, S * n)
        terms[k + 1] = (wide @ columns).reshape(B, n, S, n) * (h / (k + 1))
    return terms[::-1].sum(axis=0).transpose(2, 0, 1, 3)  # small ones first


def _remainder(sizes: FloatArray, weights: FloatArray, h: float) -> FloatArray:
    """Bound on what the series leave out, shape (B,), from norms of the matrices (1 + H, B)."""
    H = len(weights) // 2
    both = weights[:H] + weights[H:]
    terms = np.zeros((ORDER + TAIL, sizes.shape[1]))
    terms[0] = 1.0
    for k in range(ORDER + TAIL - 1):
        past = both[:, k::-1] @ terms[: k + 1]
        terms[k + 1] = (sizes[0] * terms[k] + (sizes[1:] * past).sum(axis=0)) * (h / (k + 1))
    remainder: FloatArray = terms[ORDER + 1 :].sum(axis=0)
    return remainder


def _products(Z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The product of all (S, B, n, n) over its norm, later to the left; logarithms of the first 0, 1, ...'s norms."""
    product = np.empty((len(Z) + 1, *Z.shape[1:]))
    product[0] = np.eye(Z.shape[-1])
    scales = np.zeros((len(Z) + 1, Z.shape[1]))
    for k, step in enumerate(Z):
        grown = step @ product[k]
        size = np.abs(grown).max(axis=(1, 2))
        np.divide(grown, size[:, None, None], out=product[k + 1])
        scales[k + 1] = np.log(size)
    norms = _norms(product)
    last: FloatArray = product[-1] / norms[-1][:, None, None]
    return last, np.cumsum(scales, axis=0) + np.log(norms)


def _norms(matrices: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(matrices, 2, axis=(-2, -1)), dtype=np.float64)
