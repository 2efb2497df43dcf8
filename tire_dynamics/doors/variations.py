"""The force variation of every wheel's axle force by harmonic of its turn, for the diagnostics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..estimator.vehicle import Output
from ..science.uniformity import OrderSums, Variation

__all__ = ["Variations", "variation_of"]

_TURNS: Final = 10  # that are taken together, or all since the last look
_FULL_TURN: Final = 2.0 * math.pi
_APART: Final = _FULL_TURN / 200.0  # [rad] at least from one sample to the next: a wheel that crawls has no more


class Variations:
    """Radial force variation of W wheels, of ten turns after the other.

    What comes with each tick is only kept; :meth:`take_up` does the rest, or :func:`variation_of` on another thread.
    Samples have the weight of a Hann window over the ten turns: a load that rises or falls meanwhile is no harmonic.
    """

    def __init__(self, wheels: int) -> None:
        self._samples: list[list[tuple[float, float]]] = [[] for _ in range(wheels)]
        self._last = [math.inf] * wheels  # angle that was kept
        self._found: list[Variation | None] = [None] * wheels

    def note(self, angles: NDArray[np.float64], forces: Sequence[Output]) -> None:
        """Keep the angles [rad] of all wheels and the axle forces [N] of those in motion, each so often in a turn."""
        turned = angles.tolist()
        for index, _, force_z in forces:
            way = abs(turned[index] - self._last[index])
            if not min(way, abs(way - _FULL_TURN)) < _APART:
                self._last[index] = turned[index]
                self._samples[index].append((turned[index], force_z))

    def take_up(self, index: int) -> None:
        """Work on what was noted of a wheel, if it has turned far enough."""
        self.keep(index, variation_of(self.taken(index)))

    def taken(self, index: int) -> list[tuple[float, float]]:
        """What was noted of a wheel by now, for :func:`variation_of` on any thread."""
        return self._samples[index].copy()

    def keep(self, index: int, found: tuple[Variation | None, int] | None) -> None:
        """Take over what :func:`variation_of` found."""
        if found is not None:
            self._found[index], used = found
            del self._samples[index][: used - 1]

    def values(self, index: int) -> dict[str, str]:
        """What the diagnostics say of a wheel: of harmonics 1 to 10, peak to peak and the wheel's angle at the peak."""
        found = self._found[index]
        if found is None:
            return {"RFV [N]": "-"}
        return {
            "RFV [N]": f"{found.whole:.1f}",
            "RFV over [turns]": f"{found.turns:.1f}",
            "RFV by harmonic [N]": _row(found.peak_to_peak),
            "RFV phase by harmonic [deg]": _row(np.degrees(found.phase)),
        }


def variation_of(samples: Sequence[tuple[float, float]]) -> tuple[Variation | None, int] | None:
    """The force variation in samples of angle [rad] and force [N], and their number; None for less than ten turns."""
    if len(samples) < 2:
        return None
    angle, force = np.array(samples).T
    step = np.mod(np.diff(angle, prepend=angle[:1]) + math.pi, 2.0 * math.pi) - math.pi
    turns = np.cumsum(np.abs(step)) / (2.0 * math.pi)
    if turns[-1] < _TURNS:
        return None
    sums = OrderSums()  # of some 2000 samples, or as many as there were ticks
    sums.add(angle, force, np.abs(step) * np.sin(math.pi * turns / turns[-1]) ** 2)
    return sums.variation(), len(samples)


def _row(values: NDArray[np.float64]) -> str:
    return " ".join(f"{value:.1f}" if math.isfinite(value) else "-" for value in values.tolist())
