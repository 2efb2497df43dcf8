"""The force variation of every wheel's axle force by harmonic of its turn, for the diagnostics."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..estimator.wheels import Wheels
from ..science.uniformity import OrderSums, Variation

__all__ = ["UniformityMonitor", "variation_of"]

_TURNS: Final = 10  # that are taken together, or all since the last look


class UniformityMonitor:
    """Radial force variation of W wheels, of ten turns after the other.

    What comes with each tick is noted by the wheels; :meth:`update` does the rest, or :func:`variation_of` on another
    thread. Samples have the weight of a Hann window over the ten turns: a load that rises or falls meanwhile is no
    harmonic.
    """

    def __init__(self, wheels: Wheels) -> None:
        wheels.note_orders()
        self._wheels = wheels
        self._samples = [np.empty((0, 2)) for _ in range(wheels.count)]
        self._found: list[Variation | None] = [None] * wheels.count

    def update(self, index: int) -> None:
        """Work on what was noted of a wheel, if it has turned far enough."""
        self.keep(index, variation_of(self.taken(index)))

    def taken(self, index: int) -> NDArray[np.float64]:
        """What was noted of a wheel by now, shape (M, 2), for :func:`variation_of` on any thread."""
        self._samples[index] = np.concatenate([self._samples[index], self._wheels.noted_orders(index)])
        return self._samples[index]

    def keep(self, index: int, found: tuple[Variation | None, int] | None) -> None:
        """Take over what :func:`variation_of` found."""
        if found is not None:
            self._found[index], used = found
            self._samples[index] = self._samples[index][used - 1 :]

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


def variation_of(samples: NDArray[np.float64]) -> tuple[Variation | None, int] | None:
    """The force variation in samples of angle [rad] and force [N], (M, 2), and M; None for less than ten turns."""
    if len(samples) < 2:
        return None
    angle, force = samples.T
    step = np.mod(np.diff(angle, prepend=angle[:1]) + math.pi, 2.0 * math.pi) - math.pi
    turns = np.cumsum(np.abs(step)) / (2.0 * math.pi)
    if turns[-1] < _TURNS:
        return None
    sums = OrderSums()  # of some 2000 samples, or as many as there were ticks
    sums.add(angle, force, np.abs(step) * np.sin(math.pi * turns / turns[-1]) ** 2)
    return sums.variation(), len(samples)


def _row(values: NDArray[np.float64]) -> str:
    return " ".join(f"{value:.1f}" if math.isfinite(value) else "-" for value in values.tolist())
