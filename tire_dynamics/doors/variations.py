"""The force variation of every wheel's axle force by harmonic of its turn, for the diagnostics."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..estimator.wheels import Wheels
from ..science.uniformity import OrderSums, Variation

__all__ = ["Variations"]

_TURNS: Final = 10  # that are taken together, or all since the last look


class Variations:
    """Radial force variation of W wheels, of ten turns after the other.

    What comes with each tick is noted by the wheels; :meth:`take_up` does the rest, for one wheel at a time: all of them
    together would take longer than a tick may. Samples have the weight of a Hann window over the ten turns: a load that rises or
    falls meanwhile then is no harmonic.
    """

    def __init__(self, wheels: Wheels) -> None:
        wheels.note_orders()
        self._wheels = wheels
        self._samples = [np.empty((0, 2)) for _ in range(wheels.count)]
        self._found: list[Variation | None] = [None] * wheels.count

    def take_up(self, index: int) -> None:
        """Work on what was noted of a wheel, if it has turned far enough."""
        self._samples[index] = np.concatenate([self._samples[index], self._wheels.noted_orders(index)])
        angle, force = self._samples[index].T
        if angle.size < 2:
            return
        step = np.mod(np.diff(angle, prepend=angle[:1]) + math.pi, 2.0 * math.pi) - math.pi
        turns = np.cumsum(np.abs(step)) / (2.0 * math.pi)
        if turns[-1] >= _TURNS:  # some 2000 samples, or as many as there were ticks
            sums = OrderSums()
            sums.add(angle, force, np.abs(step) * np.sin(math.pi * turns / turns[-1]) ** 2)
            self._found[index] = sums.variation()
            self._samples[index] = self._samples[index][-1:]

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


def _row(values: NDArray[np.float64]) -> str:
    return " ".join(f"{value:.1f}" if math.isfinite(value) else "-" for value in values.tolist())
