"""What is odd about recorded speeds and loads: in another unit, upside down, of another clock. Said, never mended."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

__all__ = ["GRAVITY", "RECORD", "Plausibility", "acceleration_doubts", "doubts"]

GRAVITY = 9.80665  # [m/s^2]
RECORD = "tire_dynamics.import"
"""Name of the metadata record in which an import says where a bag's numbers come from, and what is odd about them."""

_LEAST_LOAD = 100.0  # [N] in the mean; a wheelchair's wheel has more
_MOST_LOAD = 2e5  # [N], of the largest mine truck's tires nearly 1 MN
_LEAST_SHARE = 2.0  # of the unsprung weight; the axle of an empty trailer carries as much, all others more
_MOST_SPEED = 500.0  # [rad/s] in the mean; 540 km/h of a car
_ALIKE = 1.5  # between the wheels of a vehicle, mean speeds differ by less
_FEW = 20  # samples of which nothing is said


@dataclass
class _Sums:
    """Of one series of samples."""

    count: int = 0
    total: float = 0.0
    size: float = 0.0  # sum of absolute values
    squares: float = 0.0
    last: int | None = None  # [ns]
    repeats: int = 0
    steps: int = 0  # of exactly a second
    first: int = 0

    def add(self, times: NDArray[np.int64], values: NDArray[np.float64]) -> None:
        import numpy as np

        kept = np.isfinite(values)
        times, values = times[kept], values[kept]
        if not times.size:
            return
        between = np.diff(times, prepend=times[:1] if self.last is None else self.last)
        if self.last is None:
            self.first = int(times[0])
            between = between[1:]
        self.repeats += int(np.count_nonzero(between == 0))
        self.steps += int(np.count_nonzero(between == 10**9))
        self.last = int(times[-1])
        self.count += times.size
        with np.errstate(over="ignore"):  # sums of what is finite may be infinite, which is as odd
            self.total += float(values.sum())
            self.size += float(np.abs(values).sum())
            self.squares += float(values @ values)

    @property
    def mean(self) -> float:
        return self.total / self.count

    @property
    def deviation(self) -> float:
        return math.sqrt(max(self.squares / self.count - self.mean * self.mean, 0.0))


class Plausibility:
    """Looks at samples as they pass, and keeps a few sums of each wheel.

    Parameters
    ----------
    weight : float, optional
        What each wheel carries at rest [N], where it is known.
    unsprung : float, optional
        What wheel and tire weigh by themselves [N]; looked at where ``weight`` is not known.

    Attributes
    ----------
    partial : bool
        Whether there were samples that it was not given: to be set by whoever left them out.
    """

    def __init__(self, weight: float | None = None, unsprung: float | None = None) -> None:
        self.partial = False
        self._weight, self._unsprung = weight, unsprung
        self._speeds: dict[str, _Sums] = {}
        self._loads: dict[str, _Sums] = {}

    def speeds(self, wheel: str, times: ArrayLike, values: ArrayLike) -> None:
        """Take speeds of a wheel [rad/s] at times [ns], later than those taken before."""
        self._add(self._speeds, wheel, times, values)

    def loads(self, wheel: str, times: ArrayLike, values: ArrayLike) -> None:
        """Take vertical loads of a wheel [N] at times [ns], later than those taken before."""
        self._add(self._loads, wheel, times, values)

    def sums(self, quantity: str, wheel: str, count: int, total: float, size: float, squares: float) -> None:
        """Take the sums of many speeds or loads ("speed", "load"): how many, of values, their sizes and squares."""
        of = self._speeds if quantity == "speed" else self._loads
        of[wheel] = _Sums(count, total, size, squares)

    def _add(self, of: dict[str, _Sums], wheel: str, times: ArrayLike, values: ArrayLike) -> None:
        import numpy as np

        some = np.atleast_1d(np.asarray(values, np.float64))
        of.setdefault(wheel, _Sums()).add(np.atleast_1d(np.asarray(times, np.int64)), some)

    def doubts(self) -> list[str]:
        """What is odd so far, one line each; none of series with fewer than 20 samples."""
        loads = {wheel: sums for wheel, sums in self._loads.items() if sums.count >= _FEW}
        speeds = {wheel: sums for wheel, sums in self._speeds.items() if sums.count >= _FEW}
        return [
            *_of_loads(loads, self._weight, self._unsprung),
            *_of_speeds(speeds, self.partial),
            *_of_times(speeds, "speeds"),
            *_of_times(loads, "loads"),
        ]


def doubts(
    speeds: Mapping[str, tuple[ArrayLike, ArrayLike]],
    loads: Mapping[str, tuple[ArrayLike, ArrayLike]],
    weight: float | None = None,
) -> list[str]:
    """What is odd about whole recordings.

    Parameters
    ----------
    speeds, loads : mapping of str to (times, values)
        By wheel: times [ns], ascending, and speeds [rad/s] or vertical loads on the tire [N], up positive.
    weight : float, optional
        What each wheel carries at rest [N], where it is known.

    Returns
    -------
    list of str
        One line each.
    """
    seen = Plausibility(weight)
    for wheel, (times, values) in speeds.items():
        seen.speeds(wheel, times, values)
    for wheel, (times, values) in loads.items():
        seen.loads(wheel, times, values)
    return seen.doubts()


def acceleration_doubts(name: str, values: ArrayLike, gravity: float) -> list[str]:
    """What is odd about a vertical acceleration from which a load is to be estimated.

    Parameters
    ----------
    name : str
        Of the column.
    values : array_like
        In any unit.
    gravity : float
        In the unit that they are said to be in: 9.80665 of m/s^2, 1 of g.

    Returns
    -------
    list of str
    """
    import numpy as np

    some = np.asarray(values, np.float64)
    some = some[np.isfinite(some)]
    if some.size < _FEW:
        return []
    mean = abs(float(some.mean())) / gravity
    if gravity > 1.0 and 0.7 / GRAVITY < mean < 1.4 / GRAVITY:
        return [f"{name} is {mean * gravity:.3g} m/s^2 in the mean: is it in g?"]
    if gravity == 1.0 and 0.7 * GRAVITY < mean < 1.4 * GRAVITY:
        return [f"{name} is {mean:.3g} g in the mean: is it in m/s^2?"]
    if mean < 0.5:
        return [f"{name} is {mean:.2g} g in the mean: gravity is not in it, and a load estimated from it is no load"]
    return []


def _listed(wheels: Mapping[str, _Sums]) -> str:
    return ", ".join(wheels)


def _of_loads(loads: Mapping[str, _Sums], weight: float | None, unsprung: float | None) -> Iterator[str]:
    below = {wheel: sums for wheel, sums in loads.items() if sums.mean <= 0.0}
    if below:
        worst = min(sums.mean for sums in below.values())
        yield f"the mean load of {_listed(below)} is {worst:.4g} N; up is positive: is z down?"
    above = {wheel: sums for wheel, sums in loads.items() if sums.mean > 0.0}
    small = {wheel: sums for wheel, sums in above.items() if sums.mean < _LEAST_LOAD}
    if small:
        mean = max(sums.mean for sums in small.values())
        yield f"the mean load of {_listed(small)} is {mean:.3g} N: is it in kN?"
    large = {wheel: sums for wheel, sums in above.items() if sums.mean > _MOST_LOAD}
    if large:
        mean = max(sums.mean for sums in large.values())
        yield f"the mean load of {_listed(large)} is {mean:.3g} N, or {mean / 9806.65:.3g} t: in which unit is it?"
    if weight is None:
        less = {wheel: sums for wheel, sums in above.items() if unsprung and sums.mean < _LEAST_SHARE * unsprung}
        less = {wheel: sums for wheel, sums in less.items() if wheel not in small}
        if less:
            mean = max(sums.mean for sums in less.values())
            yield (
                f"the mean load of {_listed(less)} is {mean:.4g} N, hardly more than wheel and tire weigh by "
                f"themselves, {unsprung:.4g} N: is it in kg, or of an acceleration in g?"
            )
        return
    off: dict[str, list[str]] = {}
    for wheel, sums in above.items():
        share = sums.mean / weight
        if wheel not in small and wheel not in large and not 0.5 <= share <= 2.0:
            in_g = 0.5 / GRAVITY <= share <= 2.0 / GRAVITY
            off.setdefault(": is the acceleration in g?" if in_g else "", []).append(f"{wheel} {sums.mean:.4g} N")
    for why, which in off.items():
        yield f"the mean load is {', '.join(which)}, where the mass weighs {weight:.4g} N{why}"


def _of_speeds(speeds: Mapping[str, _Sums], partial: bool) -> Iterator[str]:
    fast = {wheel: sums for wheel, sums in speeds.items() if sums.size / sums.count > _MOST_SPEED}
    if fast:
        mean = max(sums.size / sums.count for sums in fast.values())
        yield (
            f"the mean speed of {_listed(fast)} is {mean:.4g} rad/s, {3.6 * 0.3 * mean:.3g} km/h of a wheel of 0.3 m: "
            "is it in rpm or deg/s?"
        )
    moving = {wheel: sums for wheel, sums in speeds.items() if sums.size > 0.0}
    still = {wheel: sums for wheel, sums in speeds.items() if wheel not in moving}
    if still:
        when = "in every sample that was looked at" if partial else "all the time"
        yield f"the speed of {_listed(still)} is 0 {when}"
    if len(moving) < 2:
        return
    sizes = {wheel: sums.size / sums.count for wheel, sums in moving.items()}
    middle = sorted(sizes.values())[(len(sizes) - 1) // 2]
    for wheel, size in sizes.items():
        if not 1.0 / _ALIKE < size / middle < _ALIKE:
            yield f"{wheel} turns {size / middle:.3g} times as fast as the others: do the speeds have one unit?"
    forward = {wheel: sums.total > 0.0 for wheel, sums in moving.items() if abs(sums.total) > 0.5 * sums.size}
    backward = [wheel for wheel, is_forward in forward.items() if not is_forward]
    if backward and len(backward) < len(forward):
        yield f"{', '.join(backward)} turns the other way than the rest: rolling forward is positive"


def _of_times(series: Mapping[str, _Sums], what: str) -> Iterator[str]:
    for sums in series.values():
        if sums.repeats:
            yield f"{sums.repeats} of {sums.count} {what} have the time of the one before, of which the last counts"
            break
    for sums in series.values():
        if sums.steps == sums.count - 1 and sums.first in (0, 10**9):
            first = sums.first // 10**9
            yield f"the times of the {what} are {first}, {first + 1}, ... s: do they count rows?"
            break
