"""The force variation of every wheel's axle force by harmonic of its turn, for the diagnostics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..estimator.vehicle import Output
from ..science.uniformity import OrderSums, Variation

__all__ = ["Variations"]

_TURNS: Final = 10  # that are taken together, or all since the last look
_MOST: Final = 200_000  # samples: some minutes at a crawl


class Variations:
    """Radial force variation of W wheels, of ten turns after the other.

    What comes with each tick is only kept; :meth:`take_up` does the rest, once a second or so. Samples have the weight
    of a Hann window over the ten turns: a load that rises or falls meanwhile then is no harmonic.
    """

    def __init__(self, wheels: int) -> None:
        self._samples = [np.empty((2, 0)) for _ in range(wheels)]
        self._found: list[Variation | None] = [None] * wheels
        self._noted: list[tuple[list[float], Sequence[Output]]] = []

    def note(self, angles: NDArray[np.float64], forces: Sequence[Output]) -> None:
        """Keep the angles [rad] of all wheels and the axle forces [N] of those in motion."""
        self._noted.append((angles.tolist(), forces))

    def take_up(self) -> None:
        """Work on what was noted."""
        samples: list[list[tuple[float, float]]] = [[] for _ in self._samples]
        for angles, forces in self._noted:
            for index, _, force_z in forces:
                samples[index].append((angles[index], force_z))
        self._noted = []
        for index, mine in enumerate(samples):
            angle, force = np.concatenate([self._samples[index], np.array(mine).reshape(-1, 2).T], axis=1)
            step = np.mod(np.diff(angle, prepend=angle[:1]) + math.pi, 2.0 * math.pi) - math.pi
            turns = np.cumsum(np.abs(step)) / (2.0 * math.pi)
            if turns.size and turns[-1] >= _TURNS:
                sums = OrderSums()
                sums.add(angle, force, np.abs(step) * np.sin(math.pi * turns / turns[-1]) ** 2)
                self._found[index] = sums.variation()
                angle, force = angle[-1:], force[-1:]
            self._samples[index] = np.stack([angle, force])[:, -_MOST:]

    def values(self, index: int) -> dict[str, str]:
        """What the diagnostics say of a wheel: N peak to peak, and the wheel's angle at the peak."""
        found = self._found[index]
        if found is None:
            return {"RFV [N]": "-"}
        values = {"RFV [N]": f"{found.whole:.1f}", "RFV over [turns]": f"{found.turns:.1f}"}
        for j, (size, phase) in enumerate(zip(found.peak_to_peak.tolist(), found.phase.tolist(), strict=True), 1):
            if math.isfinite(size):
                values[f"RFV {j} [N]"] = f"{size:.1f}"
                values[f"RFV {j} phase [deg]"] = f"{math.degrees(phase):.1f}"
        return values
