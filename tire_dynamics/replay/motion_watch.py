"""Wheel speeds against an IMU: all wheels in another unit, of another sign, left and right exchanged.

Wheels that are all wrong by the same factor agree with each other; an IMU is a witness that does not know them. It is
one while the vehicle speeds up, slows down or turns. At rest and at constant speed straight ahead nothing can be said.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..files.plausibility import GRAVITY

__all__ = ["MotionWatch", "other_unit"]

FloatArray = NDArray[np.float64]

_BIN = 100_000_000  # [ns] over which samples are averaged
_STEP = 1e-9 * _BIN  # [s]
_BINS = 40, 160  # that are looked at together: 4 s, and 16 s of a gentle drive
_EACH = 10  # bins from one look to the next
_GAP = 8  # bins without a sample, that may follow one another
_MISSING = 0.2  # of all bins, that may have no sample
_STILL = 0.2  # [m/s] of the wheels as they are told, below which nothing is said
_MOST = 1e6  # beyond it is no measurement in any unit
_SPEEDING, _CURVES, _TURNING = 0.15, 0.3, 0.03  # [m/s], [m/s^2], [rad/s] of motion that are enough, rms
_SURE = 4.0  # standard errors
_SCALE = math.log(1.05)  # what IMU, slip and radius make of a factor seen in acceleration and braking, as a logarithm
_COARSE = math.log(1.3)  # and in curves, where the body slips sideways
_BLIND = math.log(1.6)  # and without rates, by slopes
_NEAR = math.log(1.05)  # so near a factor between units comes to be the one; more where more is allowed for
_TRACKS = 0.5  # [m]; every vehicle's is wider
_FACTORS = {
    "km/h": 3.6, "m/s": 1.0, "mph": 1.0 / 0.44704, "rpm": 30.0 / math.pi, "deg/s": 180.0 / math.pi,
    "rev/s": 0.5 / math.pi, "rad/s": 1.0,
}  # fmt: skip
"""Of a unit, how many there are in m/s or rad/s."""
_LINEAR = ("km/h", "m/s", "mph")


def other_unit(share: float, values: Mapping[str, Any], near: float) -> str | None:
    """The unit that wheel speeds are in if they are so many times too large; None if none is near.

    Parameters
    ----------
    share : float
        Wheel speeds, times the rolling radius, over the vehicle's.
    values : mapping
        All parameters.
    near : float
        How near, as the logarithm of a factor.

    Returns
    -------
    str or None
    """
    radius, unit = rolling_radius(values), values["inputs.speed.unit"]
    metres = {name: (1.0 if name in _LINEAR else radius) / factor for name, factor in _FACTORS.items()}
    off = {name: abs(math.log(share * metres[name] / metres[unit])) for name in metres}
    other = min(off, key=lambda name: off[name])
    return other if other != unit and off[other] < near else None


def rolling_radius(values: Mapping[str, Any]) -> float:
    """As the parameters have it [m]."""
    return float(values["inputs.speed.radius"] or values["tire.radius"])


class _Ratio(NamedTuple):
    """y over x by the regression of each on the other, and the standard error of the first, relative.

    Noise of y makes the second too large in size, noise of x the first too small.
    """

    low: float
    high: float
    error: float

    @property
    def middle(self) -> float:
        return math.copysign(math.sqrt(self.low * self.high), self.low)

    def is_off(self, allowed: float) -> bool:
        """Whether its size is not 1, whatever is allowed for as the logarithm of a factor."""
        least = max(math.log(abs(self.low)), -math.log(abs(self.high)))
        return least > allowed + _SURE * self.error

    @property
    def is_one(self) -> bool:
        """Whether it is known to be 1, up to what is always allowed for."""
        return self.low > 0.0 and abs(math.log(self.middle)) < _SCALE and self.is_known

    @property
    def is_known(self) -> bool:
        return _SURE * self.error + 0.5 * math.log(self.high / self.low) < _COARSE


class _Finding(NamedTuple):
    kind: str
    """What is wrong; empty if nothing is known to be."""
    text: str
    is_sound: bool
    """Whether it is known that nothing is wrong."""


def _at_once(work: Callable[[], _Finding], then: Callable[[_Finding], None]) -> None:
    then(work())


class MotionWatch:
    """Holds the wheel speeds against an IMU, as they come.

    Parameters
    ----------
    values : mapping
        All parameters.

    Attributes
    ----------
    doubts : list of str
        What is odd: one line, from when it is seen until it is seen to be so no more.
    ever : dict of str to str
        All that was odd so far, by its kind.
    analyse : callable
        Called once a second with the regressions, a millisecond of work, and with what takes their result: at once,
        unless another is put here, which may do the first on another thread.

    Notes
    -----
    With the specific force f and the angular rate w of the body, REP 103, and the wheels' speed v:

    - dv/dt = f_x + g theta, theta the integral of w_y: slopes and the body's pitch are in it. v is regressed on the
      integral of that, beside a constant, time, its square (where theta begins, biases) and the acceleration (slip,
      samples that are late);
    - v w_z = f_y - g phi, phi the integral of w_x, beside a constant, time and dw_z/dt (the body's own sideslip);
    - right minus left wheels have the sign of w_z.

    Each regression is done from both sides, of y on x and of x on y; noise in either makes one of them too small and
    the other too large. What both say in two looks, a second apart, at the last 4 s or 16 s, by more than four standard
    errors and what sensors and slip may do, is said.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self.doubts: list[str] = []
        self.ever: dict[str, str] = {}
        self.analyse: Callable[[Callable[[], _Finding], Callable[[_Finding], None]], None] = _at_once
        self._values, wheels = values, values["wheels"]
        self._radius = rolling_radius(values)
        estimated = values["load_source"] == "estimate"  # whose order of wheels is front left, front right, ...
        self._left = [k for k, name in enumerate(wheels) if (k % 2 == 0 if estimated else "left" in name)]
        self._right = [k for k, name in enumerate(wheels) if (k % 2 == 1 if estimated else "right" in name)]
        self._width = len(wheels)
        self._rows: deque[list[float]] = deque(maxlen=_BINS[-1])
        self._before = ""  # what the last look found
        self._bin: int | None = None
        self._empty()

    def _empty(self) -> None:
        self._sums, self._counts = [0.0] * (self._width + 6), [0] * (self._width + 6)

    def take(self, quantity: str, wheel: int | None, stamp: int, received: int, values: tuple[float, ...]) -> None:
        """Take a sample, as the field map hands it over."""
        if quantity == "imu":
            first = self._width
        elif quantity == "speed":
            first = 0
        else:
            return
        number = received // _BIN
        if number != self._bin:
            self._go_to(number)
        for k, value in enumerate(values, first):
            if abs(value) < _MOST:  # and is a number
                self._sums[k] += value
                self._counts[k] += 1

    def _go_to(self, number: int) -> None:
        last, self._bin = self._bin, number
        if last is None:
            return
        if not 0 < number - last <= _GAP:  # a gap, or the clock was set back
            self._rows.clear()
            self._before = ""
        else:
            row = [total / count if count else math.nan for total, count in zip(self._sums, self._counts, strict=True)]
            self._rows.append(row)
            self._rows.extend([[math.nan] * len(row)] * (number - last - 1))
            if number // _EACH != last // _EACH:
                self._ask()
        self._empty()

    def _ask(self) -> None:
        self.analyse(partial(self._find, np.array(self._rows)), self._take_finding)

    def _take_finding(self, found: _Finding) -> None:
        if found.kind and found.kind == self._before and not self.doubts:
            self.doubts = [found.text]
            self.ever.setdefault(found.kind, found.text)
        elif found.is_sound:
            self.doubts = []
        self._before = found.kind

    def _find(self, rows: FloatArray) -> _Finding:
        """What the short time says, or else the long one; of this object only what never changes is read."""
        found = _Finding("", "", False)
        for count in _BINS:
            if len(rows) >= count and not found.kind and not found.is_sound:
                found = self._judge(rows[-count:])
        return found

    def _judge(self, rows: FloatArray) -> _Finding:
        speeds, imu = _whole(self._radius * rows[:, : self._width]), _whole(rows[:, self._width :])
        if np.isnan(imu).any() or not 0.7 < imu[:, 2].mean() / GRAVITY < 1.3:
            return _Finding("", "", False)
        there = speeds[:, ~np.isnan(speeds[0])]
        if not there.size or np.abs(there).mean() < _STILL:
            return _Finding("", "", False)
        v = np.median(there, axis=1)  # of three wheels and more one may be dead, which is said elsewhere
        along, across = _speeding(v, imu), _curves(v, imu)
        kind, text = self._of_the_speed(along, across, has_rates=bool(imu[:, 4].any()))
        if not kind:
            kind, text = self._of_the_sides(speeds, imu)
        is_sound = not kind and any(each.is_one for each in (along, across) if each is not None)
        return _Finding(kind, text, is_sound)

    def _of_the_speed(self, along: _Ratio | None, across: _Ratio | None, has_rates: bool) -> tuple[str, str]:
        """What is wrong with all speeds, as a kind and a line; with rates, slope and pitch are known."""
        seen = [each for each in (along, across) if each is not None and each.is_known]
        if seen and all(each.low < 0.0 for each in seen):
            return "sign", "by the imu the wheels roll the other way: is the sign of the speeds another, or the imu's?"
        if any(each.low < 0.0 for each in seen):
            return "", ""
        allowed, near = (_SCALE, _NEAR) if has_rates else (_BLIND, _BLIND)
        if along is not None and along.low > 0.0 and along.is_off(allowed):
            share, other = along.middle, across
        elif across is not None and across.low > 0.0 and across.is_off(_COARSE):
            share, other, near = across.middle, along, _COARSE
        else:
            return "", ""
        if other is not None and other.is_known and abs(math.log(other.middle / share)) > _COARSE:
            return "", ""
        unit, told = other_unit(share, self._values, near), self._values["inputs.speed.unit"]
        text = f"the wheels are {share:.3g} times as fast as by the imu, with a rolling radius of {self._radius:g} m: "
        if unit is not None:
            return unit, f"{text}are the speeds in {unit}, and not in {told}?"
        if abs(math.log(share)) > _COARSE:
            return "factor", f"{text}do unit and radius fit?"
        return "", ""

    def _of_the_sides(self, speeds: FloatArray, imu: FloatArray) -> tuple[str, str]:
        left, right = speeds[:, self._left], speeds[:, self._right]
        if not left.size or not right.size or np.isnan(left).any() or np.isnan(right).any():
            return "", ""
        track = _ratio(imu[:, 5], right.mean(axis=1) - left.mean(axis=1), [_even(len(imu))], _TURNING)
        if track is None or not track.is_known or track.low > -_TRACKS:
            return "", ""
        return "sides", "by the imu the left wheels are on the right: is the order of the wheels another?"


def _even(count: int) -> FloatArray:
    return np.linspace(-1.0, 1.0, count)


def _speeding(v: FloatArray, imu: FloatArray) -> _Ratio | None:
    """Wheels over vehicle, by speeding up and braking."""
    a = imu[:, 0] + GRAVITY * _integral(imu[:, 4])
    t = _even(len(v))
    return _ratio(_integral(a), v, [t, t * t, a], _SPEEDING)


def _curves(v: FloatArray, imu: FloatArray) -> _Ratio | None:
    """Wheels over vehicle, by curves."""
    a = imu[:, 1] - GRAVITY * _integral(imu[:, 3])
    return _ratio(a, v * imu[:, 5], [_even(len(v)), np.gradient(imu[:, 5])], _CURVES)


def _whole(columns: FloatArray) -> FloatArray:
    """Columns with their gaps closed by lines; NaN where too much is missing."""
    there = ~np.isnan(columns)
    if there.all():
        return columns
    at = np.arange(len(columns))
    found = np.full_like(columns, np.nan)
    for k in np.flatnonzero(there.mean(axis=0) >= 1.0 - _MISSING).tolist():
        found[:, k] = np.interp(at, at[there[:, k]], columns[there[:, k], k])
    return found


def _integral(rate: FloatArray) -> FloatArray:
    return np.asarray((np.cumsum(rate) - 0.5 * rate) * _STEP)


def _ratio(x: FloatArray, y: FloatArray, beside: list[FloatArray], least: float) -> _Ratio | None:
    """y over x, both without a constant and what lies in ``beside``; None where x moves too little."""
    N, both = np.column_stack([np.ones(len(x)), *beside]), np.column_stack([x, y])
    x, y = (both - N @ np.linalg.lstsq(N, both, rcond=None)[0]).T
    xx, xy, yy = float(x @ x), float(x @ y), float(y @ y)
    if not len(x) * least**2 <= xx < math.inf or not 1e-9 * xx < abs(xy) < math.inf:
        return None
    left = y - xy / xx * x
    whole = float(left @ left)
    follows = min(max(float(left[1:] @ left[:-1]) / whole, 0.0), 0.95) if whole else 0.0
    error = math.sqrt(whole / (len(x) - N.shape[1] - 1) / xx * (1.0 + follows) / (1.0 - follows))
    return _Ratio(xy / xx, yy / xy, error * xx / abs(xy))
