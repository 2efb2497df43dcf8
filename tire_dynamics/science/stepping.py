"""The steps between samples, how many terms a Taylor series takes, and linear equations solved in a fixed order."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["TERMS", "Steps", "reaches", "solve_in_order"]

FloatArray = NDArray[np.float64]

TERMS = 40
"""Of the longest Taylor series of n = 1."""

_NEGLIGIBLE = 2.0**-57  # beside a state of size 1, whose rounding is 2^-53


class Steps:
    """The steps between samples: their lengths [s], and the speeds [rad/s] at the samples.

    Parameters
    ----------
    time, speed : ndarray, shape (N,)
        Ascending times, and the speed at them, linear in between.
    """

    def __init__(self, time: FloatArray, speed: FloatArray) -> None:
        self.count = time.size - 1
        self.lengths = np.diff(time)
        if self.count:
            mean = (time[-1] - time[0]) / self.count
            # a regular grid is one whose times are regular but for their own rounding
            if np.abs(self.lengths - mean).max() <= 4.0 * np.spacing(np.abs(time).max()):
                self.lengths = np.full(self.count, mean)
        self.speeds = speed


def reaches() -> list[float]:
    """By the number of terms up to :data:`TERMS`, the largest norm times step for which they are enough.

    The next term is then at most 2^-57; rounded down to ten bits.
    """
    found = [0.0]
    for k in range(1, TERMS + 1):
        low, high = 0.0, 64.0
        while high - low > 2.0**-10:
            middle = 0.5 * (low + high)
            enough = math.prod(middle / j for j in range(1, k + 1)) <= _NEGLIGIBLE
            low, high = (middle, high) if enough else (low, middle)
        found.append(low)
    return found


def solve_in_order(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """x of matrix x = right by elimination with row pivoting, in a fixed order of operations."""
    rows = np.concatenate([matrix, right[:, None]], axis=1)
    n = len(rows)
    for column in range(n):
        pivot = column + int(np.abs(rows[column:, column]).argmax())
        rows[[column, pivot]] = rows[[pivot, column]]
        for row in range(column + 1, n):
            rows[row] -= rows[row, column] / rows[column, column] * rows[column]
    x = np.empty(n)
    for row in reversed(range(n)):
        value = rows[row, n]
        for column in range(row + 1, n):
            value -= rows[row, column] * x[column]
        x[row] = value / rows[row, row]
    return x
