"""What a report computes from samples, without a bag and without a page.

Times are seconds from the beginning of the drive. The classes take a drive block by block, in bounded memory, and
give what the whole at once would give.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..science.spectra import Spectra, Transfer, segment_length
from ..science.uniformity import OrderSums, Variation

__all__ = [
    "MEASURED",
    "Envelope",
    "HeldInput",
    "Intervals",
    "Moment",
    "Moments",
    "NewestInput",
    "Orders",
    "Spectra",
    "Transfer",
    "WheelAngle",
    "decimate",
    "extremes",
    "gaps",
    "segment_length",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MEASURED = 0
"""The segment of a :class:`WheelAngle` whose angles are those that were measured."""


# -- decimation ---------------------------------------------------------------------------------------------------


def decimate(
    time: ArrayLike, value: ArrayLike, start: float, end: float, buckets: int
) -> tuple[FloatArray, FloatArray]:
    """The lowest and the highest sample of each bucket of time, and the first and the last of all.

    Parameters
    ----------
    time : (N,) array_like
        In any order; those before ``start`` belong to the first bucket, those after ``end`` to the last [s].
    value : (N,) array_like
        What is not finite is left out.
    start, end : float
        What is divided into buckets [s].
    buckets : int

    Returns
    -------
    time, value : (M,) ndarray
        Samples as they were given, in order of time; M <= 2 buckets + 2.

    Notes
    -----
    To decimate pieces and then what is left of them all gives what decimating all at once gives: an extreme of the
    whole is one of its piece.
    """
    times, values = np.asarray(time, np.float64), np.asarray(value, np.float64)
    finite = np.isfinite(values)
    if not finite.all():
        times, values = times[finite], values[finite]
    if (times[1:] < times[:-1]).any():
        order = np.argsort(times, kind="stable")
        times, values = times[order], values[order]
    if not times.size:
        return times.copy(), values.copy()
    number = np.clip((times - start) * (buckets / max(end - start, 1e-300)), 0, buckets - 1).astype(np.int64)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    length = np.diff(first, append=number.size)
    kept = np.zeros(times.size, np.bool_)
    kept[[0, -1]] = True
    for extreme in (np.minimum, np.maximum):
        reached = np.flatnonzero(values == np.repeat(extreme.reduceat(values, first), length))
        kept[reached[np.diff(number[reached], prepend=-1) != 0]] = True  # the first of equals
    return times[kept], values[kept]


class Envelope:
    """A curve over a drive that keeps its peaks: :func:`decimate` of all samples that were added."""

    def __init__(self, start: float, end: float, buckets: int) -> None:
        self._range = start, end, buckets
        self._limit = 8 * buckets
        self._pieces: list[tuple[FloatArray, FloatArray]] = []
        self._size = 0

    def add(self, time: FloatArray, value: FloatArray) -> None:
        """Take samples."""
        self._pieces.append((time, value))
        self._size += time.size
        if self._size > self._limit:
            self._pieces = [self.curve()]
            self._size = self._pieces[0][0].size

    def curve(self) -> tuple[FloatArray, FloatArray]:
        """Times and values, in order of time."""
        if not self._pieces:
            return np.empty(0), np.empty(0)
        times, values = (np.concatenate(column) for column in zip(*self._pieces, strict=True))
        return decimate(times, values, *self._range)


def extremes(time: FloatArray, value: FloatArray, pieces: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of a curve in pieces of equally many samples: the middles of their times, their lowest and highest values."""
    first = np.arange(0, time.size, max(1, -(-time.size // pieces)))
    last = np.append(first[1:], time.size) - 1
    middle = 0.5 * (time[first] + time[last])
    return middle, np.minimum.reduceat(value, first), np.maximum.reduceat(value, first)


def gaps(time: ArrayLike, longest: float) -> FloatArray:
    """Pairs of neighbouring times, shape (K, 2), that lie more than ``longest`` apart."""
    times = np.asarray(time, np.float64)
    wide = np.flatnonzero(np.diff(times) > longest)
    return np.stack([times[wide], times[wide + 1]], axis=1)


# -- numbers ------------------------------------------------------------------------------------------------------


class Moments:
    """Count, mean, extremes and root mean square of the samples that were added."""

    def __init__(self) -> None:
        self.count = 0
        self.mean = 0.0
        self.low, self.high = math.inf, -math.inf
        self._squares = 0.0  # about the mean

    def add(self, value: FloatArray) -> None:
        """Take samples; each has the same weight."""
        if not value.size:
            return
        mean = float(value.mean())
        count = self.count + value.size
        shift = mean - self.mean
        # of two sets: Chan, Golub and LeVeque, The American Statistician 37 (1983), 242-247
        self._squares += float(((value - mean) ** 2).sum()) + shift * shift * self.count * value.size / count
        self.mean += shift * value.size / count
        self.count = count
        self.low, self.high = min(self.low, float(value.min())), max(self.high, float(value.max()))

    @property
    def rms(self) -> float:
        """About zero."""
        return math.hypot(self.mean, self.deviation)

    @property
    def deviation(self) -> float:
        """Root mean square about the mean."""
        return math.sqrt(self._squares / self.count) if self.count else 0.0

    @property
    def peak(self) -> float:
        """The value furthest from zero."""
        if not self.count:
            return 0.0
        return self.high if abs(self.high) >= abs(self.low) else self.low


class Intervals:
    """Times between samples: their quantiles to 1 %, exactly if they are all the same."""

    PER_DECADE = 200
    DECADES = (-7, 5)  # [s], powers of ten; what is shorter or longer goes to the outermost bin

    def __init__(self) -> None:
        bins = self.PER_DECADE * (self.DECADES[1] - self.DECADES[0])
        self._count, self._sum = np.zeros(bins), np.zeros(bins)
        self.longest = 0.0

    def add(self, interval: FloatArray) -> None:
        """Take intervals [s]; those that are not positive are left out."""
        interval = interval[interval > 0.0]
        if interval.size:
            place = np.floor((np.log10(interval) - self.DECADES[0]) * self.PER_DECADE)
            place = np.clip(place, 0, self._count.size - 1).astype(np.int64)
            self._count += np.bincount(place, minlength=self._count.size)
            self._sum += np.bincount(place, interval, minlength=self._count.size)
            self.longest = max(self.longest, float(interval.max()))

    def quantile(self, share: float) -> float:
        """The interval than which a share of all are shorter [s]; NaN of none."""
        total = np.cumsum(self._count)
        if not total[-1]:
            return math.nan
        place = int(np.searchsorted(total, share * total[-1]))
        return float(self._sum[place] / self._count[place])


# -- the load that acts -------------------------------------------------------------------------------------------


class HeldInput:
    """An input that is held from one sample to the next, and its mean over the time between two ticks."""

    def __init__(self) -> None:
        self._time, self._value = np.empty(0), np.empty(0)
        self._tick: float | None = None

    def mean(self, time: FloatArray, value: FloatArray, tick: FloatArray) -> FloatArray:
        """Means of the input between ticks.

        Parameters
        ----------
        time : (N,) ndarray
            From when on each sample acts [s].
        value : (N,) ndarray
        tick : (T,) ndarray
            Ascending times [s], after which no sample comes to act before them.

        Returns
        -------
        (T,) ndarray
            Each over the time that ends with the tick; NaN if some of that time has no input, or there is none.
        """
        times, values = np.concatenate([self._time, time]), np.concatenate([self._value, value])
        if (times[1:] < times[:-1]).any():
            order = np.argsort(times, kind="stable")
            times, values = times[order], values[order]
        if not tick.size or not times.size:
            self._time, self._value = times, values
            self._tick = float(tick[-1]) if tick.size else self._tick
            return np.full(tick.size, math.nan)
        edges = np.concatenate([[math.nan if self._tick is None else self._tick], tick])
        integral = np.concatenate([[0.0], np.cumsum(np.diff(times) * values[:-1])])
        place = np.searchsorted(times, edges, side="right") - 1
        known = (place >= 0) & np.isfinite(edges)
        until = np.where(known, integral[place] + (edges - times[place]) * values[place], math.nan)
        length = np.diff(edges)
        mean = np.divide(np.diff(until), length, out=np.full(tick.size, math.nan), where=length > 0.0)
        kept = max(int(place[-1]), 0)
        self._time, self._value, self._tick = times[kept:], values[kept:], float(tick[-1])
        return mean


# -- what repeats with the turn of the wheel ----------------------------------------------------------------------


class NewestInput:
    """The newest sample of an input at each tick."""

    def __init__(self) -> None:
        self._time, self._value = np.empty(0), np.empty(0)

    def add(self, time: FloatArray, value: FloatArray) -> None:
        """Take samples, from the times on at which they act."""
        times, values = np.concatenate([self._time, time]), np.concatenate([self._value, value])
        order = np.argsort(times, kind="stable")
        self._time, self._value = times[order], values[order]

    def at(self, tick: FloatArray) -> FloatArray:
        """Values at ascending ticks, after which none earlier are asked for; NaN before the first sample."""
        place = np.searchsorted(self._time, tick, side="right") - 1
        found = np.where(place >= 0, self._value[place], math.nan) if self._time.size else np.full(tick.size, math.nan)
        if tick.size:
            kept = max(int(place[-1]), 0)
            self._time, self._value = self._time[kept:], self._value[kept:]
        return found


class WheelAngle:
    """The angle of a wheel: as it was measured, and between and without that from its speed, held between samples.

    Parameters
    ----------
    longest : float
        Time over which a speed is held [s]. After it the angle is lost, unless it is measured again.
    """

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self._waiting: list[FloatArray] = []
        self._since = np.empty((4, 0))  # the last sample before the last tick: time, speed, angle, segment
        self._tick, self._position = -math.inf, math.nan
        self._lost = MEASURED
        self.measured = 0  # angles that were of use

    def add(self, time: FloatArray, speed: FloatArray, position: FloatArray) -> None:
        """Take speeds [rad/s], and angles [rad] where they were measured, else NaN, at their times [s]."""
        self._waiting.append(np.stack([time, speed, position]))

    def at(self, tick: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Angles at ticks.

        Parameters
        ----------
        tick : (T,) ndarray
            Ascending times [s], each after those before; if not, the clock was set back, and all begins anew.

        Returns
        -------
        angle, speed : (T,) ndarray
            [rad], not wrapped, and [rad/s]; NaN before the first sample.
        segment : (T,) ndarray of int
            ``MEASURED``, or the number of the segment at whose begin the angle was set to 0.
        """
        if tick.size and (np.diff(tick, prepend=self._tick) < 0.0).any():
            self._waiting, self._since = [], np.empty((4, 0))
        if tick.size:
            self._tick = float(tick[-1])
        time, speed, angle, segment = self._resolved()
        place = np.searchsorted(time, tick, side="right") - 1
        if not time.size:
            unknown = np.full(tick.size, math.nan)
            return unknown, unknown, np.zeros(tick.size, np.int64)
        held = np.where(place >= 0, speed[place], math.nan)
        return angle[place] + held * (tick - time[place]), held, segment[place].astype(np.int64)

    def _resolved(self) -> FloatArray:
        """The samples from the one before the last tick to those at this one."""
        new = np.concatenate([np.empty((3, 0)), *self._waiting], axis=1)
        new = new[:, np.argsort(new[0], kind="stable")]
        self._waiting = [new[:, new[0] > self._tick]]
        earliest = self._since[0, 0] if self._since.size else -math.inf
        new = new[:, (new[0] >= earliest) & (new[0] <= self._tick)]
        if not new.size:
            return self._since
        # One that repeats is none: it rests, or there is no sensor, and somebody sends zeros.
        measured = finite = np.isfinite(new[2])
        if finite.any():
            measured = finite.copy()
            measured[finite] = np.diff(new[2, finite], prepend=self._position) != 0.0
            self._position = float(new[2, finite][-1])
        self.measured += int(measured.sum())
        known = self._since.shape[1]  # 1, or 0 at the begin
        time, speed, angle = np.concatenate([self._since[:3], new], axis=1)
        segment = np.concatenate([self._since[3], np.zeros(time.size - known)])
        measured = np.concatenate([np.zeros(known, np.bool_), measured])
        wait = np.diff(time, prepend=time[0] if known else -math.inf)
        lost = ~measured & (wait > self._longest)
        angle[lost] = 0.0
        segment[lost] = self._lost + np.cumsum(lost)[lost]
        self._lost += int(lost.sum())
        begin = np.maximum.accumulate(np.where(measured | lost, np.arange(time.size), 0))
        turned = np.concatenate([[0.0], np.cumsum(speed[:-1] * wait[1:])])
        columns = np.stack([time, speed, angle[begin] + turned - turned[begin], segment[begin]])
        self._since = columns[:, -1:]
        return columns


class Orders:
    """The harmonics of a force over the wheel's angle, and how far one segment of turns differs from the next.

    Each segment is weighted by Hann's window over the angle, so that a load that drifts is not taken for a harmonic,
    and each sample by the angle that it stands for, so that what is driven slowly counts no more.
    """

    TURNS = 10.0  # of a segment

    def __init__(self) -> None:
        self._whole, self._part, self._few = OrderSums(), OrderSums(), OrderSums()
        self._last = math.nan  # angle
        self._parts = np.zeros(self._whole.harmonics)
        self._mean = np.zeros(self._whole.harmonics, np.complex128)
        self._squares = np.zeros(self._whole.harmonics)  # about the mean

    def add(self, angle: FloatArray, force: FloatArray) -> None:
        """Take forces [N] at angles [rad], in order of time."""
        if not angle.size:
            return
        before = angle[0] if math.isnan(self._last) else self._last
        self._last = float(angle[-1])
        steps = np.abs(np.mod(np.diff(angle, prepend=before) + math.pi, 2.0 * math.pi) - math.pi)
        turns = self._part.turns + np.cumsum(steps) / (2.0 * math.pi)
        weight = steps * np.sin(math.pi / self.TURNS * turns) ** 2
        cuts = np.flatnonzero(np.diff(np.floor(turns / self.TURNS), prepend=0.0) > 0.0).tolist()
        if not self._whole.turns:
            self._few.add(angle, force)
        for first, last in zip([0, *cuts], [*cuts, angle.size], strict=True):
            if first in cuts:
                self._close()
            self._part.add(angle[first:last], force[first:last], weight[first:last])

    def _close(self) -> None:
        phasors = self._part.phasors()
        self._whole.merge(self._part)
        self._part = OrderSums()
        if phasors is None:
            return
        known = np.isfinite(phasors)
        self._parts += known
        shift = np.where(known, phasors - self._mean, 0.0)
        self._mean += shift / np.maximum(self._parts, 1.0)
        self._squares += (shift * np.where(known, phasors - self._mean, 0.0).conj()).real

    @property
    def turns(self) -> float:
        """Of the wheel, either way."""
        return self._whole.turns + self._part.turns

    def variation(self) -> tuple[Variation | None, FloatArray]:
        """The harmonics of all whole segments, and the standard errors of their peak to peaks (H,) [N].

        If no segment is whole the harmonics are those of what there is, without weights; errors of fewer than three
        segments are NaN.
        """
        whole = self._whole if self._whole.turns else self._few
        n = np.where(self._parts >= 3.0, self._parts, math.nan)
        # half of a phasor's variance lies along it; peak to peak is twice its size
        return whole.variation(), 2.0 * np.sqrt(0.5 * self._squares / (n * (n - 1.0)))


# -- the moment of the highest load -------------------------------------------------------------------------------

Curve = tuple[FloatArray, NDArray[Any]]


class Moment:
    """Every sample of several curves around the highest value of the first, of a drive that comes in blocks.

    Parameters
    ----------
    before, after : float
        How much to keep on either side [s].
    kinds : sequence of dtype
        Of the values of each curve; ``object`` for what is not a number.
    """

    def __init__(self, before: float, after: float, kinds: Sequence[Any]) -> None:
        self._before, self._after = before, after
        self.peak, self.time = -math.inf, math.nan
        self._recent: list[Curve] = [(np.empty(0), np.empty(0, kind)) for kind in kinds]
        self._kept = list(self._recent)

    def add(self, *curves: Curve) -> None:
        """Take a block: times and values of each curve."""
        time, value = curves[0]
        place = int(np.argmax(value)) if time.size else 0
        if time.size and value[place] > self.peak:
            self.peak, self.time = float(value[place]), float(time[place])
            self._kept = [self._around(_joined(old, new)) for old, new in zip(self._recent, curves, strict=True)]
        else:
            self._kept = [_joined(old, self._around(new)) for old, new in zip(self._kept, curves, strict=True)]
        latest = max((float(time[-1]) for time, _ in curves if time.size), default=math.inf)
        self._recent = [
            _between(_joined(old, new), latest - 2.0 * self._before, math.inf)
            for old, new in zip(self._recent, curves, strict=True)
        ]

    def _around(self, curve: Curve) -> Curve:
        return _between(curve, self.time - self._before, self.time + self._after)

    def curves(self) -> list[Curve]:
        """The curves around :attr:`time`, where the first has its highest value :attr:`peak`."""
        return self._kept


def _joined(one: Curve, other: Curve) -> Curve:
    return np.concatenate([one[0], other[0]]), np.concatenate([one[1], other[1]])


def _between(curve: Curve, first: float, last: float) -> Curve:
    inside = (curve[0] >= first) & (curve[0] <= last)
    return curve[0][inside], curve[1][inside]
