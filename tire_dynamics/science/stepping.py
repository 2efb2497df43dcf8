"""The steps between samples, and linear equations solved in a fixed order of operations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Steps", "solve_in_order"]

FloatArray = NDArray[np.float64]


class Steps:
    """The steps between samples: their lengths [s], and the speed [rad/s] that is held over each.

    Parameters
    ----------
    time, speed : ndarray, shape (N,)
        Ascending times, and the speed at them, linear in between; the middle value is held.
    """

    def __init__(self, time: FloatArray, speed: FloatArray) -> None:
        self.count = time.size - 1
        self.lengths = np.diff(time)
        if self.count:
            mean = (time[-1] - time[0]) / self.count
            # a regular grid is one whose times are regular but for their own rounding
            if np.abs(self.lengths - mean).max() <= 4.0 * np.spacing(np.abs(time).max()):
                self.lengths = np.full(self.count, mean)
        self.speeds = 0.5 * (speed[:-1] + speed[1:])
        self.first_speed = float(speed[0])


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
