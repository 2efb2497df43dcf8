"""What an estimator of several wheels is made of."""

from __future__ import annotations

from dataclasses import dataclass

from ..science.unit import TireWheelUnit
from ..science.wheel import Model

__all__ = ["VehicleSettings", "check_wheel"]


@dataclass(frozen=True)
class VehicleSettings:
    """What a :class:`~.vehicle.Vehicle` is made of; times in nanoseconds, the rest SI."""

    unit: TireWheelUnit
    wheels: tuple[str, ...] = ("wheel",)
    joint_names: tuple[str, ...] = ("wheel",)
    period: int = 2_000_000
    ring_period: int = 20_000_000
    ring_samples: int = 72
    n_max: int = 30
    model: Model = "inextensional"
    input_timeout: int = 200_000_000
    max_speed: float = 1000.0
    max_load: float = 200e3
    static_loads: tuple[float, ...] | None = None  # on the road [N]; None: loads are given
    max_road_step: float = 0.25
    contact_points: int = 1
    coupled_harmonics: int = 30


def check_wheel(index: int, count: int) -> None:
    """Raise an IndexError if there is no wheel of this index: the compiled loops write where they are told to."""
    if not 0 <= index < count:
        raise IndexError(f"wheel is {index}; it must be from 0 to {count - 1}")
