"""A frequency response as it is drawn and written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..science.unit import TireWheelUnit

__all__ = ["Bode"]


@dataclass(frozen=True)
class Bode:
    """What is drawn and written.

    Attributes
    ----------
    unit, model
        Of what.
    speeds : tuple of float, S
        [rpm]
    frequencies : ndarray, shape (N,)
        [Hz]
    response : ndarray of complex, shape (S, N, 2, 2)
        As :func:`.wheel.frequency_response` returns it.
    whirl : tuple of ndarray, S
        Damped frequencies of n = 1 and the wheel at each speed [Hz].
    verdicts : tuple of str, S
        Of :func:`.wheel.stability`.
    """

    unit: TireWheelUnit
    model: str
    speeds: tuple[float, ...]
    frequencies: Any
    response: Any
    whirl: tuple[Any, ...]
    verdicts: tuple[str, ...]
