"""Loads that are estimated: samples of the field map in, the loads of each tick out, live and in replay."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any, Final

from ..estimator.load_filter import SOURCES, LoadFilter, SensorNoise
from ..estimator.vehicle import Vehicle
from ..estimator.vehicle_parameters import VehicleParameters
from ..science.axle_variance import axle_force_covariance
from ..science.unit import TireWheelUnit
from ..science.wheel_matrices import Model

__all__ = ["FILTERED", "LoadSource"]

FILTERED: Final = {"speed": "wheel_speed", "travel": "travel", "hub_acceleration": "hub", "imu": "imu"}
"""The filter's sources, by quantity of the field map."""

_KNOT: Final = 5.0  # [rad/s] by which the response of an axle is taken anew


class LoadSource:
    """Feeds a :class:`~tire_dynamics.LoadFilter` and reads it.

    Parameters
    ----------
    car : VehicleParameters
    noise : SensorNoise
    vehicle : Vehicle
        The wheels that the loads are for, in the order of the car's.
    has_covariance : bool
        Whether what the loads' errors make of the axle forces is wanted.
    mapped : iterable of str
        Quantities of the field map: what is to come, beside wheel speeds.

    Notes
    -----
    Messages that bring values of one wheel each are put together where their stamps are the same. A stamp that lies
    more than the input timeout after the receipt is refused, and counted ``in the future``. A tick before the last one
    means that the clock was set back: all is forgotten.
    """

    def __init__(
        self,
        car: VehicleParameters,
        noise: SensorNoise,
        vehicle: Vehicle,
        has_covariance: bool = False,
        mapped: Iterable[str] = (),
    ) -> None:
        self.filter = LoadFilter(car, noise)
        wanted = {FILTERED[quantity] for quantity in ("speed", *mapped) if quantity in FILTERED}
        self._wanted = tuple(name for name in SOURCES if name in wanted)
        self.in_the_future: Counter[str] = Counter()
        self._vehicle, self._has_covariance = vehicle, has_covariance
        self._last: dict[str, tuple[int, tuple[float, ...]]] = {}
        self._corners = car.hop_frequencies

    @property
    def wheels(self) -> tuple[str, ...]:
        """Names of the wheels."""
        return self._vehicle.settings.wheels

    @property
    def missing(self) -> tuple[str, ...]:
        """Sources that are to come and are not in use."""
        used = self.filter.sources
        return tuple(name for name in self._wanted if name not in used)

    def take(self, quantity: str, wheel: int | None, stamp: int, received: int, values: tuple[float, ...]) -> None:
        """Take a sample, as the field map hands it over; of one wheel, the values of the others are NaN."""
        name = FILTERED.get(quantity)
        if name is None:
            return
        if stamp > received + self._vehicle.settings.input_timeout:
            self.in_the_future[name] += 1
            return
        before = self._last.get(name)
        if before is not None and before[0] == stamp:
            values = tuple(old if new != new else new for old, new in zip(before[1], values, strict=True))
        self._last[name] = stamp, values
        if name == "imu":
            self.filter.add_imu(stamp, values[:3], values[3:])
        elif name == "travel":
            self.filter.add_travel(stamp, values)
        elif name == "hub":
            self.filter.add_hub(stamp, values)
        else:
            self.filter.add_wheel_speed(stamp, values)

    def estimate(self, stamp: int) -> tuple[list[float], list[float], list[float] | None] | None:
        """The loads of a tick and their standard deviations [N], and what these make of the axle forces; or None.

        Returns
        -------
        tuple or None
            Load and standard deviation of each wheel [N]; xx, xz and zz of each axle force's covariance [N^2].
        """
        if self.filter.time is not None and stamp < self.filter.time:
            self.filter.reset()
            self._last.clear()
        if not self.filter.advance(stamp):
            return None
        loads, deviations = self.filter.load.tolist(), self.filter.standard_deviation.tolist()
        if not self._has_covariance:
            return loads, deviations, None
        variances = []
        for index, (corner, deviation) in enumerate(zip(self._corners, deviations, strict=True)):
            speed = _KNOT * round(self._vehicle.inputs[index].speed / _KNOT)
            share = _share(self._vehicle.unit, speed, corner, self._vehicle.settings.model)
            variances += [each * deviation * deviation for each in share]
        return loads, deviations, variances

    def snapshot(self) -> dict[str, Any]:
        """Everything that later estimates depend on, in JSON's types."""
        last = {
            name: [stamp, [None if value != value else value for value in values]]
            for name, (stamp, values) in self._last.items()
        }
        return {"filter": self.filter.snapshot(), "last": last}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over a :meth:`snapshot`."""
        self.filter.restore(snapshot["filter"])
        self._last = {
            name: (int(stamp), tuple(math.nan if value is None else float(value) for value in values))
            for name, (stamp, values) in snapshot["last"].items()
        }


@lru_cache(maxsize=4096)
def _share(unit: TireWheelUnit, speed: float, corner: float, model: Model) -> tuple[float, float, float]:
    found = axle_force_covariance(unit, speed, corner, model)
    return float(found[0, 0]), float(found[0, 1]), float(found[1, 1])
