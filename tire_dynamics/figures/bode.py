"""A frequency response as it is drawn and written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..science.unit import TireWheelUnit

__all__ = ["PATHS", "ROAD_PATHS", "Bode"]

PATHS = {  # output and input, as indices of the response
    "load_to_force_z": (1, 0),
    "load_to_force_x": (0, 0),
    "traction_to_force_z": (1, 1),
    "traction_to_force_x": (0, 1),
}
ROAD_PATHS = {  # N/m of road, - of traction
    "road_to_force_z": (1, 0),
    "road_to_force_x": (0, 0),
    "road_to_contact_force": (2, 0),
    "traction_to_force_z": (1, 1),
    "traction_to_force_x": (0, 1),
    "traction_to_contact_force": (2, 1),
}


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
    contact : bool
        Whether it is the tire on the road: the first input is then its height, and the third output the contact force.
    """

    unit: TireWheelUnit
    model: str
    speeds: tuple[float, ...]
    frequencies: Any
    response: Any
    whirl: tuple[Any, ...]
    verdicts: tuple[str, ...]
    contact: bool = False

    @property
    def paths(self) -> dict[str, tuple[int, int]]:
        """Names of outputs per inputs, and their places in the response."""
        return ROAD_PATHS if self.contact else PATHS
