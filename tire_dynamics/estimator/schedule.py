"""When what is in force: the samples of one wheel, and the steps through time that they make."""

from __future__ import annotations

import math
import operator
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Outcome", "Plan", "Samples", "Schedule", "Stretch"]

Outcome = Literal["taken", "late", "repeated", "out of order", "not finite"]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FOR_EVER: Final = 2**62  # [ns]
_NEVER: Final = 2**70
_FULL_TURN: Final = 2.0 * math.pi


class _Sample(NamedTuple):
    stamp: int
    values: tuple[float, ...]


class _Input:
    """The samples of one kind: the one in force, and those whose time is yet to come."""

    def __init__(self) -> None:
        self.in_force: _Sample | None = None
        self.waiting: list[_Sample] = []  # ascending stamps, none twice

    def add(self, sample: _Sample, time: int | None) -> Outcome:
        if not all(map(math.isfinite, sample.values)):
            return "not finite"
        if time is None or sample.stamp > time:
            if not self.waiting or sample.stamp > self.waiting[-1].stamp:
                self.waiting.append(sample)
                return "taken"
            place = bisect_left(self.waiting, sample.stamp, key=_stamp)
            if self.waiting[place].stamp == sample.stamp:
                self.waiting[place] = sample
                return "repeated"
            self.waiting.insert(place, sample)
            return "taken"
        if self.in_force is not None and sample.stamp < self.in_force.stamp:
            return "out of order"
        outcome: Outcome = "late"
        if self.in_force is not None and sample.stamp == self.in_force.stamp:
            outcome = "repeated"
        self.in_force = sample
        return outcome

    def snapshot(self) -> list[Any]:
        return [self.in_force, list(self.waiting)]

    def restore(self, snapshot: list[Any]) -> None:
        in_force, waiting = snapshot
        self.in_force = _sample(*in_force) if in_force else None
        self.waiting = [_sample(*sample) for sample in waiting]


def _sample(stamp: int, values: Iterable[float]) -> _Sample:
    # a negative zero becomes a positive one, lest equal inputs differ in their bits
    return _Sample(operator.index(stamp), tuple(float(value) + 0.0 for value in values))


def _known(values: Iterable[float]) -> tuple[float, ...]:
    """Without those that are NaN."""
    return tuple(value for value in values if value == value)


def _stamp(sample: _Sample) -> int:
    return sample.stamp


class Plan(NamedTuple):
    """What a wheel does until a moment: it may start anew, and then goes through steps, if it is in motion.

    A step is its length [ns], and the speed [rad/s], the load and the traction [N] that are held over it. ``angles``
    are the wheel's at the beginning of each step [rad] where a sample has just told it, else NaN.
    ``start`` ends with one.
    """

    start: tuple[float, float, float, float] | None
    steps: list[tuple[int, float, float, float]]
    angles: list[float]


class Samples(NamedTuple):
    """Samples of one kind in the order of their receipt; ``after`` is the number of ticks that came before each."""

    after: IntArray
    stamp: IntArray
    values: FloatArray  # (N, 2): load and traction, or speed and the wheel's angle, NaN where it is not known


class Stretch(NamedTuple):
    """Steps over several ticks: lengths [ns], speeds [rad/s], forces [N] (I, 2), and steps done by each tick (T,).

    ``angle`` is as in :class:`Plan`; ``speed_at`` are in force at the ticks.
    """

    length: IntArray
    speed: FloatArray
    force: FloatArray
    angle: FloatArray
    done: IntArray
    speed_at: FloatArray


class Schedule:
    """The inputs of one wheel through time; :class:`~.wheel_estimator.WheelEstimator` says what happens to a sample.

    Parameters
    ----------
    timeout : int or None
        Age [ns] beyond which an input is no longer believed.
    unstable : callable
        Whether the unit is unstable at a speed [rad/s].
    """

    def __init__(self, timeout: int | None, unstable: Callable[[float], bool]) -> None:
        self.timeout = timeout if timeout is not None else _FOR_EVER
        self.counts: Counter[str] = Counter()
        self.stops = 0  # for inputs that were too old
        self.divergences = 0
        self._unstable = unstable
        self.reset()

    def reset(self) -> None:
        """Forget every sample and the time."""
        self.time: int | None = None
        self.running = False
        self._diverged = False
        self._speed = _Input()
        self._load = _Input()
        self._told: float | None = None  # the last angle
        self._turned: _Sample | None = None  # the speed whose angle has been used

    def add_speed(self, stamp: int, speed: float, angle: float = math.nan) -> Outcome:
        """Take a sample of the spin [rad/s] and, where it is known, of the wheel's angle [rad].

        An angle that is the last one again is none: who publishes no positions may publish zeros.
        """
        is_known = math.isfinite(angle) and angle != self._told and math.isfinite(speed)
        if is_known:
            self._told = float(angle) + 0.0
        values = (speed, angle) if is_known else (speed,)
        outcome = self._speed.add(_sample(stamp, values), self.time)
        self.counts[outcome] += 1
        return outcome

    def add_load(self, stamp: int, load: float, traction: float) -> Outcome:
        """Take a sample of the load and the traction [N]."""
        outcome = self._load.add(_sample(stamp, (load, traction)), self.time)
        self.counts[outcome] += 1
        return outcome

    def plan(self, stamp: int) -> Plan:
        """Go on to a time [ns]; ``ValueError`` if it lies before the one reached already."""
        start: tuple[float, float, float, float] | None = None
        steps: list[tuple[int, float, float, float]] = []
        angles: list[float] = []
        speeds, loads = self._speed, self._load
        time = stamp if self.time is None else self.time
        if stamp < time:
            raise ValueError(f"stamp is {stamp}; the estimator has already reached {time}")
        if self.time is not None and not self.running and self._starts(time):  # with what came late
            start = (self.speed, *self.load, self._angle(time, again=True))
        while True:
            moment = stamp
            if speeds.waiting and speeds.waiting[0].stamp < moment:
                moment = speeds.waiting[0].stamp
            if loads.waiting and loads.waiting[0].stamp < moment:
                moment = loads.waiting[0].stamp
            if self.running:
                speed, load = speeds.in_force, loads.in_force
                assert speed is not None and load is not None
                if moment > min(speed.stamp, load.stamp) + self.timeout:
                    self.running = False
                    self.stops += 1
                elif moment > time:
                    steps.append((moment - time, speed.values[0], load.values[0], load.values[1]))
                    angles.append(self._angle(time))
            time = moment
            let_in = False
            if speeds.waiting and speeds.waiting[0].stamp == moment:
                speeds.in_force = speeds.waiting.pop(0)
                let_in = True
            if loads.waiting and loads.waiting[0].stamp == moment:
                loads.in_force = loads.waiting.pop(0)
                let_in = True
            if not let_in:
                self.time = moment
                return Plan(start, steps, angles)
            if not self.running and self._starts(moment):
                start, steps, angles = (self.speed, *self.load, self._angle(moment, again=True)), [], []

    def _angle(self, moment: int, *, again: bool = False) -> float:
        """The wheel's angle at a moment [rad] if the speed in force brought one; NaN from the second time on."""
        sample = self._speed.in_force
        if sample is None or sample is self._turned and not again:
            return math.nan
        self._turned = sample
        if len(sample.values) == 1:
            return math.nan
        return math.fmod(sample.values[1] + sample.values[0] * ((moment - sample.stamp) * 1e-9), _FULL_TURN)

    def _starts(self, moment: int) -> bool:
        if moment > self._expiry() or self._diverged and self._unstable(self.speed):
            return False
        self._diverged = False
        self.running = True
        return True

    def _expiry(self) -> int:
        """The last moment at which both inputs are believed; before all times while one is missing."""
        speed, load = self._speed.in_force, self._load.in_force
        if speed is None or load is None:
            return -_NEVER
        return min(speed.stamp, load.stamp) + self.timeout

    def give_up(self) -> None:
        """Stop because the motion diverged."""
        self.running, self._diverged = False, True
        self.divergences += 1

    # -- many ticks at once ---------------------------------------------------------------------------------

    def stretch(self, ticks: IntArray, speeds: Samples, loads: Samples) -> Stretch | None:
        """What :meth:`add_speed`, :meth:`add_load` and :meth:`plan` would do, tick after tick.

        Parameters
        ----------
        ticks : ndarray of int, shape (T,)
            Ascending times [ns].
        speeds, loads : Samples
            All finite.

        Returns
        -------
        Stretch or None
            None if something would happen in it that is not a step: then nothing has changed, and the samples and
            ticks have to be taken one by one.
        """
        if not self.running or self.time is None or not ticks.size or ticks[0] < self.time:
            return None
        before = np.concatenate([[self.time], ticks])
        told = np.concatenate([[math.nan if self._told is None else self._told], speeds.values[:, 1] + 0.0])
        known = np.flatnonzero(np.isfinite(told))
        again = known[1:][told[known[1:]] == told[known[:-1]]] - 1
        new = speeds.values.copy()
        new[again, 1] = math.nan
        new_speeds = speeds._replace(values=new)
        speed, load = _in_force(self._speed, new_speeds, before), _in_force(self._load, loads, before)
        if speed is None or load is None:
            return self._one_by_one(ticks, speeds, loads)
        moments = np.unique(np.concatenate([before, speed.since[1:], load.since[1:]]))
        moments = moments[: np.searchsorted(moments, ticks[-1], side="right")]
        began, ended = moments[:-1], moments[1:]
        at = [np.searchsorted(each.since, began, side="right") - 1 for each in (speed, load)]
        stamp = speed.stamp[at[0]]
        if (ended - np.minimum(stamp, load.stamp[at[1]]) > self.timeout).any():
            return None
        turned = 0 if self._turned is not None and self._turned is self._speed.in_force else -1
        angle = np.fmod(speed.values[at[0], 1] + speed.values[at[0], 0] * ((began - stamp) * 1e-9), _FULL_TURN)
        angle[at[0] == np.concatenate([[turned], at[0][:-1]])] = math.nan
        result = Stretch(
            ended - began,
            speed.values[at[0], 0],
            load.values[at[1]],
            angle,
            np.searchsorted(ended, ticks, side="right"),
            speed.values[speed.at_tick, 0],
        )
        for kept, each, samples in ((self._speed, speed, speeds), (self._load, load, loads)):
            self.counts["late"] += each.late
            self.counts["taken"] += samples.stamp.size - each.late
            rest = zip(each.stamp[each.last :].tolist(), each.values[each.last :].tolist(), strict=True)
            kept.in_force, *kept.waiting = (_Sample(stamp, _known(values)) for stamp, values in rest)
        self._told = float(told[known[-1]]) if known.size else None
        self._turned = self._speed.in_force if speed.last == (at[0][-1] if at[0].size else turned) else None
        self.counts += Counter()  # without those that are zero
        self.time = int(ticks[-1])
        return result

    def idle(self, ticks: IntArray, speeds: Samples, loads: Samples) -> bool:
        """The same for a wheel at rest that stays so for want of one input; whether it is one."""
        for known, samples in ((self._speed, speeds), (self._load, loads)):
            if not self.running and known.in_force is None and not known.waiting and not samples.stamp.size:
                return self._one_by_one(ticks, speeds, loads) is not None
        return False

    def _one_by_one(self, ticks: IntArray, speeds: Samples, loads: Samples) -> Stretch | None:
        """:meth:`stretch` for samples whose stamps do not ascend."""
        kept, running = self.keep(), self.running
        steps: list[tuple[int, float, float, float]] = []
        angles: list[float] = []
        done, speed_at = [], []
        samples = [(after, 0, k) for k, after in enumerate(speeds.after.tolist())]
        samples += [(after, 1, k) for k, after in enumerate(loads.after.tolist())]
        samples.sort(reverse=True)
        for tick, stamp in enumerate([*ticks.tolist(), None]):
            while samples and samples[-1][0] <= tick:
                _, kind, k = samples.pop()
                if kind:
                    self.add_load(int(loads.stamp[k]), *loads.values[k].tolist())
                else:
                    self.add_speed(int(speeds.stamp[k]), *speeds.values[k].tolist())
            if stamp is None:
                break
            plan = self.plan(stamp)
            if plan.start is not None or self.running != running:
                self.put_back(kept)
                return None
            steps += plan.steps
            angles += plan.angles
            done.append(len(steps))
            speed_at.append(self.speed)
        columns = np.array(steps, dtype=np.float64).reshape(-1, 4)
        length, ends = columns[:, 0].astype(np.int64), np.array(done, np.int64)
        return Stretch(length, columns[:, 1], columns[:, 2:], np.array(angles), ends, np.array(speed_at))

    # -- what can be read -----------------------------------------------------------------------------------

    def ages(self) -> tuple[int | None, int | None]:
        """Ages [ns] of the speed and of the load in force, None where there is none."""
        speed, load = self._speed.in_force, self._load.in_force
        if self.time is None:
            return None, None
        return (
            self.time - speed.stamp if speed is not None else None,
            self.time - load.stamp if load is not None else None,
        )

    @property
    def speed(self) -> float:
        """Spin in force [rad/s]."""
        sample = self._speed.in_force
        return sample.values[0] if sample is not None else 0.0

    @property
    def load(self) -> tuple[float, float]:
        """Vertical load and traction in force [N]."""
        sample = self._load.in_force
        return (sample.values[0], sample.values[1]) if sample is not None else (0.0, 0.0)

    def keep(self) -> Any:
        """Everything, for :meth:`put_back`."""
        return self.snapshot(), self.counts.copy(), self.stops, self.divergences

    def put_back(self, kept: Any) -> None:
        """Be as when it was kept."""
        snapshot, self.counts, self.stops, self.divergences = kept
        self.restore(snapshot)

    def snapshot(self) -> dict[str, Any]:
        """Everything that later results depend on, in JSON's types."""
        return {
            "time": self.time,
            "running": self.running,
            "diverged": self._diverged,
            "told": self._told,
            "turned": self._turned is not None and self._turned is self._speed.in_force,
            "speed": self._speed.snapshot(),
            "load": self._load.snapshot(),
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over a :meth:`snapshot`."""
        self.time = None if snapshot["time"] is None else operator.index(snapshot["time"])
        self.running = snapshot["running"]
        self._diverged = snapshot["diverged"]
        self._speed.restore(snapshot["speed"])
        self._load.restore(snapshot["load"])
        self._told = snapshot.get("told")
        self._turned = self._speed.in_force if snapshot.get("turned", True) else None


class _InForce(NamedTuple):
    """Samples of one kind, the one in force before them first: since when each is in force (in order, not ascending
    strictly), which is in force at each tick, which after the last, and how many came late."""

    stamp: IntArray
    values: FloatArray
    since: IntArray
    at_tick: IntArray
    last: int
    late: int


def _in_force(known: _Input, samples: Samples, before: IntArray) -> _InForce | None:
    """None unless every stamp is later than all before it: then samples are in force in the order of their receipt."""
    if known.in_force is None:
        return None
    held = [known.in_force, *known.waiting]
    stamp = np.concatenate([np.array([each.stamp for each in held], np.int64), samples.stamp])
    if not (stamp[1:] > stamp[:-1]).all():
        return None
    values = np.concatenate([np.array([(*each.values, math.nan)[:2] for each in held]), samples.values + 0.0])
    received = np.concatenate([np.zeros(len(held), np.int64), samples.after])
    arrived = before[received]  # the time that had been reached
    since = np.maximum(stamp, arrived)
    late = since == arrived
    late[: len(held)] = False
    # What comes late is in force from the time that has been reached, and not yet in what was put out then.
    ticks = before[1:]
    number = np.searchsorted(2 * (since - before[0]) + late, 2 * (ticks - before[0]), side="right")
    last = int(np.searchsorted(since, ticks[-1], side="right")) - 1
    return _InForce(stamp, values, since, number - 1, last, int(late.sum()))
