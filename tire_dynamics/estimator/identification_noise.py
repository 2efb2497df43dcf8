"""What the model leaves: an autoregression, and noise of the load that the unit has passed on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

__all__ = ["LONGEST", "Noise", "autoregression", "autoregression_with", "power_of"]

FloatArray = NDArray[np.float64]

LONGEST: Final = 64
"""Of the orders that are tried."""
_ORDERS: Final = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, LONGEST)
_GRID: Final = 2048  # samples of a periodogram, and of the whole circle of frequencies
_TURNS: Final = 20  # of expectation and maximisation
_NOTHING: Final = 1e-12  # of the power; the least that is taken to be noise, which is rounding


class Noise(NamedTuple):
    """An autoregression e_k = sum_j a_j e_(k-j) + white of this deviation."""

    coefficients: FloatArray
    deviation: float


def autoregression(residual: FloatArray, runs: Sequence[slice]) -> Noise:
    """The autoregression of a series, its order by Akaike's criterion.

    Parameters
    ----------
    residual : ndarray, shape (N,)
    runs : sequence of slice
        Of it, with nothing known in between.

    Returns
    -------
    Noise

    Notes
    -----
    The Yule-Walker equations.
    """
    orders = _possible(residual, runs)
    correlation = np.zeros(orders[-1] + 1)
    for run in runs:
        part = residual[run]
        size = min(correlation.size, part.size)
        correlation[:size] += [float(part[: part.size - k] @ part[k:]) for k in range(size)]
    correlation /= residual.size
    best, lowest = Noise(np.empty(0), 1.0), math.inf
    for p in orders:
        found = _yule_walker(correlation, p)
        criterion = 2.0 * residual.size * math.log(found.deviation) + 2.0 * p
        if criterion < lowest:
            best, lowest = found, criterion
    return best


def autoregression_with(passed: FloatArray, residual: FloatArray, runs: Sequence[slice], order: int) -> Noise:
    """The autoregression of a series that is the sum of a noise whose spectrum is known and one that is not.

    Parameters
    ----------
    passed : ndarray, shape (1025,)
        Power of the known one from 0 to half the sampling rate; its mean, the ends counting half, is its variance.
    residual : ndarray, shape (N,)
    runs : sequence of slice
        Of it, with nothing known in between.
    order : int
        Of the sum's autoregression, at most.

    Returns
    -------
    Noise

    Notes
    -----
    The unknown one is an autoregression, of the order with the lowest of Akaike's criterion with Whittle's likelihood,
    sum over frequencies of ln S + P/S, P the mean periodogram and S the sum of both spectra. For each order by
    expectation and maximisation (A. P. Dempster, N. M. Laird, D. B. Rubin, 1977): its expected power, given P, is
    (S_e/S)^2 P + S_e passed/S; the Yule-Walker equations of that give the next S_e.
    """
    power = np.zeros(_GRID // 2 + 1)
    for run in runs:
        for first in range(run.start, run.stop, _GRID):
            power += np.abs(np.fft.rfft(residual[first : min(first + _GRID, run.stop)], _GRID)) ** 2
    power = np.maximum(power / residual.size, max(float(power.max()) / residual.size, 1e-300) * _NOTHING)
    share = np.ones(power.size)
    share[[0, -1]] = 0.5  # of the circle, on which these two stand once
    share /= share.sum()
    whole, lowest = power, math.inf
    for p in _possible(residual, runs):
        own = np.maximum(power - passed, 0.3 * power)
        for _ in range(_TURNS):
            spectrum = _spectrum(_yule_walker(_correlation(own), p))
            gain = spectrum / (spectrum + passed)
            own = gain**2 * power + gain * passed
        both = _spectrum(_yule_walker(_correlation(own), p)) + passed
        criterion = residual.size * float(share @ (np.log(both) + power / both)) + 2.0 * p
        if criterion < lowest:
            whole, lowest = both, criterion
    longest = max(run.stop - run.start for run in runs)
    return _yule_walker(_correlation(whole), min(order, longest - 1, residual.size // 20))


def power_of(frequency: FloatArray, density: FloatArray, rate: float) -> FloatArray:
    """The power from 0 to half a sampling rate of what is sampled, what lies above being folded down.

    Parameters
    ----------
    frequency, density : ndarray, shape (F,)
        Ascending from 0 [Hz]; one-sided density [N^2/Hz], nothing beyond the last.
    rate : float
        [Hz]

    Returns
    -------
    ndarray, shape (1025,)
        Its mean, the ends counting half, is the variance [N^2].
    """
    grid = np.fft.rfftfreq(_GRID, 1.0 / rate)
    folds = range(math.ceil(float(frequency[-1]) / rate) + 1)
    at = np.concatenate([k * rate + side * grid for k in folds for side in (1.0, -1.0) if k or side > 0.0])
    found = np.interp(at, frequency, density, left=0.0, right=0.0).reshape(-1, grid.size).sum(axis=0)
    power: FloatArray = 0.5 * rate * found
    return power


def _possible(residual: FloatArray, runs: Sequence[slice]) -> list[int]:
    longest = max(run.stop - run.start for run in runs)
    return [p for p in _ORDERS if p == 0 or p < min(longest, residual.size / 20)]


def _yule_walker(correlation: FloatArray, p: int) -> Noise:
    least = max(float(correlation[0]), 1e-300) * _NOTHING
    a = linalg.solve_toeplitz(correlation[:p], correlation[1 : p + 1]) if p else np.empty(0)
    return Noise(a, math.sqrt(max(float(correlation[0] - a @ correlation[1 : p + 1]), least)))


def _correlation(power: FloatArray) -> FloatArray:
    found: FloatArray = np.fft.irfft(power, _GRID)
    return found


def _spectrum(noise: Noise) -> FloatArray:
    taps = np.concatenate([[1.0], -noise.coefficients])
    found: FloatArray = noise.deviation**2 / np.abs(np.fft.rfft(taps, _GRID)) ** 2
    return found
