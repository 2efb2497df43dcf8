"""What is odd about inputs as they come: in another unit, of another sign, dead. Said, never mended."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files.plausibility import GRAVITY, Plausibility
from .input_map import sources
from .motion_watch import other_unit, rolling_radius

__all__ = ["InputWatch", "doubts_of", "watched"]

FloatArray = NDArray[np.float64]
Sums = Mapping[str, FloatArray]
"""As :meth:`.Pipeline.take_sums` gives them."""

_COUNT, _TOTAL, _SIZE = 0, 1, 2
_KEPT = 4  # sums that are judged together
_FEW = 20  # samples of which nothing is said
_SLOW = 5.0  # [rad/s] below which wheels of one vehicle may differ by any factor, as on full lock
_WALK = 2.0  # [m/s] of the vehicle, below which its speed says nothing about that of the wheels
_APART = 1.08  # slip, curves and the radius make less between the speeds of wheels and vehicle
_NEAR = math.log(1.04)  # so near a factor between units comes to be the one
_MOST_TRAVEL = 0.5  # [m] in the mean


class InputWatch:
    """Looks at the inputs of a pipeline every second, and says what is odd about the last four.

    Parameters
    ----------
    values : mapping
        All parameters.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._values = values
        self._seen: deque[Sums] = deque(maxlen=_KEPT)

    def update(self, sums: Sums) -> list[str]:
        """Take what came since the last call; what is odd, one line each."""
        self._seen.append(sums)
        if len(self._seen) < _KEPT - 1:
            return []
        whole = {name: sum((each[name] for each in self._seen), np.zeros_like(sums[name])) for name in sums}
        return doubts_of(whole, self._values)


def doubts_of(sums: Sums, values: Mapping[str, Any], only: frozenset[str] | None = None) -> list[str]:
    """What is odd about the sums of some time.

    Parameters
    ----------
    sums : mapping
        As :meth:`.Pipeline.take_sums` gives them.
    values : mapping
        All parameters.
    only : frozenset of str, optional
        Quantities to look at; default all.

    Returns
    -------
    list of str
        One line each.
    """
    wheels = values["wheels"]
    seen = Plausibility()
    speeds = sums["speed"][: len(wheels)]
    moving = np.sort(speeds[:, _SIZE] / np.maximum(speeds[:, _COUNT], 1.0))[(len(wheels) - 1) // 2] > _SLOW
    for quantity in ("speed", "load"):
        if only is not None and quantity not in only or quantity == "speed" and not moving:
            continue
        for wheel, (count, *others) in zip(wheels, sums[quantity].tolist(), strict=False):
            if count:
                seen.sums(quantity, wheel, int(count), *others)
    found = seen.doubts()
    if only is None or "speed" in only:
        found += _against_the_vehicle(speeds, sums["vehicle_speed"][0], values)
        found += _frozen(speeds, wheels) if moving else []
    for name, rows in (("imu", sums["imu"][2:3]), ("hub_acceleration", sums["hub_acceleration"][: len(wheels)])):
        found += _of_gravity(name, rows, wheels, values[f"inputs.{name}.unit"].split(" ")[0])
    found += _of_travel(sums["travel"][: len(wheels)], wheels)
    return found


def _against_the_vehicle(speeds: FloatArray, vehicle: FloatArray, values: Mapping[str, Any]) -> Iterator[str]:
    """Wheel speeds that are not those of the vehicle."""
    told = speeds[speeds[:, _COUNT] >= _FEW]
    if not len(told) or vehicle[_COUNT] < _FEW or vehicle[_SIZE] / vehicle[_COUNT] < _WALK:
        return
    radius = rolling_radius(values)
    # of three wheels and more one may be dead, which is said elsewhere
    rolling = radius * float(np.median(told[:, _SIZE] / told[:, _COUNT]))
    forward = float(np.median(told[:, _TOTAL] / told[:, _COUNT]))
    speed = float(vehicle[_SIZE] / vehicle[_COUNT])
    if forward * vehicle[_TOTAL] < 0.0 and abs(forward) * radius > 0.5 * rolling:
        yield "the wheels roll backward where the vehicle goes forward: rolling forward is positive"
    share = rolling / speed
    if 1.0 / _APART < share < _APART:
        return
    other, unit = other_unit(share, values, _NEAR), values["inputs.speed.unit"]
    if other is not None:
        yield f"the wheels are {share:.3g} times as fast as the vehicle: are the speeds in {other}, and not in {unit}?"
        return
    yield (
        f"the wheels are {share:.3g} times as fast as the vehicle, with a rolling radius of {radius:g} m: do unit and "
        "radius fit?"
    )


def _frozen(speeds: FloatArray, wheels: tuple[str, ...]) -> Iterator[str]:
    """Wheels whose speed does not change where that of the others does."""
    count, total = np.maximum(speeds[:, _COUNT], 1.0), speeds[:, _TOTAL]
    spread = speeds[:, 3] / count - (total / count) ** 2
    size = (speeds[:, 3] / count) * 1e-12
    still = (speeds[:, _COUNT] >= _FEW) & (spread <= size) & (speeds[:, _SIZE] > 0.0)
    if still.any() and not still.all():
        names = ", ".join(wheel for wheel, is_still in zip(wheels, still, strict=True) if is_still)
        yield f"the speed of {names} does not change at all, and that of the others does"


def _of_gravity(name: str, rows: FloatArray, wheels: tuple[str, ...], unit: str) -> Iterator[str]:
    """Specific forces upward, that have gravity in them: one g and positive in the mean."""
    for wheel, (count, total, *_) in zip(wheels, rows.tolist(), strict=False):
        if count < _FEW:
            continue
        of = "the imu's z" if name == "imu" else f"the hub acceleration of {wheel}"
        mean = total / count / GRAVITY
        other = "g" if unit == "m/s^2" else "m/s^2"
        if mean < -0.5:
            yield f"{of} is {mean:.3g} g in the mean: is z down, or the sign another?"
        elif 0.7 / GRAVITY < mean < 1.4 / GRAVITY and unit == "m/s^2" or mean > 0.7 * GRAVITY and unit == "g":
            yield f"{of} is {mean:.3g} g in the mean: is it in {other}, and not in {unit}?"
        elif mean < 0.5:
            yield f"{of} is {mean:.2g} g in the mean: gravity is not in it, or its axis is not upright"


def _of_travel(rows: FloatArray, wheels: tuple[str, ...]) -> Iterator[str]:
    for wheel, (count, _, size, _) in zip(wheels, rows.tolist(), strict=False):
        if count >= _FEW and size / count > _MOST_TRAVEL:
            yield f"the travel of {wheel} is {size / count:.3g} m in the mean: is it in mm, or is its zero another?"


def watched(values: Mapping[str, Any]) -> frozenset[str]:
    """The quantities that come by the field map."""
    return frozenset(source.quantity for source in sources(values))
