"""Many messages of a bag at once, as columns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Block"]


class Block(NamedTuple):
    """Messages of a bag as columns; message ``i`` is ``data[start[i] : start[i] + size[i]]``.

    Attributes
    ----------
    topics : tuple of str
    topic : (N,) ndarray of int
        Index into ``topics``.
    log_time, publish_time : (N,) ndarray of int
        ns since the epoch.
    data : bytes
        The serialised messages (CDR), among other bytes.
    start, size : (N,) ndarray of int
    """

    topics: tuple[str, ...]
    topic: NDArray[np.int64]
    log_time: NDArray[np.int64]
    publish_time: NDArray[np.int64]
    data: bytes
    start: NDArray[np.int64]
    size: NDArray[np.int64]
