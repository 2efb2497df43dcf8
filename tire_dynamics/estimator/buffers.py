"""Flat buffers of doubles, as the compiled classes have them; never empty, so that each has a first element."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["flat", "zeros"]


def zeros(count: int) -> memoryview:
    """Zeros; one where none is asked for."""
    return np.zeros(max(count, 1)).data


def flat(array: NDArray[np.float64]) -> memoryview:
    """A copy in rows; of nothing, one zero."""
    rows = np.array(array, dtype=np.float64, order="C").reshape(-1)
    return (rows if rows.size else np.zeros(1)).data
