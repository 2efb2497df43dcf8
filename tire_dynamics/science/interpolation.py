"""Curves through samples that lose little of what was sampled: splines of a high degree."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy import interpolate

__all__ = ["DEGREE", "smooth_curve"]

DEGREE: Final = 7
"""Of the splines."""


def smooth_curve(time: ArrayLike, values: ArrayLike, degree: int = DEGREE) -> Any:
    """The spline of a high degree through samples, which may lie unevenly.

    Parameters
    ----------
    time : array_like, shape (N,)
        Ascending [s].
    values : array_like, shape (N,) or (N, A)
    degree : int
        Odd, at most 7; of few samples it is the highest odd one that they allow, or 1.

    Returns
    -------
    scipy.interpolate.BSpline

    Notes
    -----
    Of a sine at the share x of the sampling rate, the cardinal spline of degree k keeps the gain
    1/sum_j (x/(x - j))^(k + 1), j over all integers (I. J. Schoenberg, Cardinal Spline Interpolation, 1973), without
    phase. At x = 0.2 that is 1 - 1.6e-5 for k = 7, where the cubic spline loses 0.49 % and straight lines 12 %; at
    x = 0.3 it is 1 - 1.1e-3.
    """
    t, y = np.asarray(time, np.float64), np.asarray(values, np.float64)
    possible = next((k for k in (7, 5, 3) if k <= degree and t.size > k), 1)
    return interpolate.make_interp_spline(t, y, possible)
