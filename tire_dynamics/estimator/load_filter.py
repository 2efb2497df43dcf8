"""The loads on four wheels through time, from what a vehicle measures, fed with stamped samples."""

from __future__ import annotations

import math
import operator
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .load_equations import SensorNoise
from .load_kernel import CarFilter
from .vehicle_parameters import VehicleParameters

__all__ = ["SOURCES", "LoadFilter", "SensorNoise"]

FloatArray = NDArray[np.float64]

SOURCES: Final = ("wheel_speed", "imu", "travel", "hub")  # those of one stamp are taken in this order
BANDS: Final = {"hub": 20.0, "travel": 5.0, "imu": 2.0, "wheel_speed": 0.5}  # [Hz] up to which each makes loads known
LARGEST: Final = {"wheel_speed": 1e4, "imu": 1e4, "travel": 10.0, "hub": 1e5}  # beyond is no measurement, in SI units
_WHEEL_SPEED, _IMU, _TRAVEL, _HUB = range(4)
_COUNT: Final = (4, 6, 4, 4)

VERSION: Final = 2  # of what a snapshot holds: it goes up when the filter's state or equations change
STEP: Final = 2_500_000  # the longest step [ns]
WINDOW: Final = 50_000_000  # how late a sample may be [ns]
BETWEEN: Final = 5_000_000  # two kept states [ns]
USUAL_TIMEOUT: Final = 250_000_000  # [ns]
LONGEST_GAP: Final = 500_000_000  # without any sample [ns]
SPEEDS_APART: Final = 100_000_000  # two wheel speeds that tell an acceleration [ns]


class _Sample(NamedTuple):
    stamp: int
    source: int
    values: tuple[float, ...]  # NaN where one is not known


class _Kept(NamedTuple):
    """Everything that the filter is, at a moment, before the samples of that moment."""

    buffer: FloatArray
    time: int | None
    newest: tuple[int | None, ...]
    speed: tuple[int, float] | None
    restarts: int


class LoadFilter:
    """The loads on the four wheels of a car, in real time or faster.

    Samples and calls of :meth:`advance` bring their own time stamps, in integer nanoseconds of one common clock; the
    filter reads no clock, and the same calls in the same order give the same bits. Any of the sources may be missing,
    come at any rate, and come and go.

    Parameters
    ----------
    vehicle : VehicleParameters
    noise : SensorNoise, optional
    timeout : int
        Age [ns] beyond which a source is no longer in use: some periods of the slowest.

    Notes
    -----
    What happens to a sample, by its stamp s, the stamp k of the newest sample that has been worked in, and the time t
    that the filter has been advanced to:

    =====================  ================  ================================================================
    case                   outcome           effect
    =====================  ================  ================================================================
    s > t                  ``taken``         worked in at s, whatever order the samples came in
    k - 50 ms <= s <= t    ``late``          worked in at s, as if it had been there: the estimate is redone
                                             from s on. What was read before stays as it was
    s as one of its kind   ``repeated``      replaces that sample, likewise
    s < k - 50 ms          ``out of order``  none: too late
    nothing finite         ``not finite``    none
    =====================  ================  ================================================================

    So the estimate at a time depends on the samples up to that time, not on the order in which they came, if none was
    later than 50 ms. Of the four values of one sample, those that are NaN, infinite or beyond anything that a car does
    are left out, and the others are used; of an IMU's, each.

    Between samples the equations of motion go on, and the standard deviations grow. A source that has not come for
    longer than the timeout is not in use; the band is that of the best of those that are. When no sample at all has
    come for 500 ms, there is no estimate; the next one begins anew, but for what was learnt of mass, biases and
    road.
    """

    def __init__(
        self, vehicle: VehicleParameters, noise: SensorNoise | None = None, timeout: int = USUAL_TIMEOUT
    ) -> None:
        if not timeout > 0:
            raise ValueError(f"timeout is {timeout!r}; it must be > 0")
        self.vehicle = vehicle
        self.noise = noise or SensorNoise()
        self.timeout = operator.index(timeout)
        self._car = CarFilter(vehicle, self.noise)
        self._ahead = CarFilter(vehicle, self.noise)
        self.counts: dict[str, Counter[str]] = {name: Counter() for name in SOURCES}
        self.reset()

    def reset(self) -> None:
        """Forget every sample, the state and the time; not the counts."""
        self.time: int | None = None
        self._car.reset()
        self._reached: int | None = None  # the stamp of the newest sample that has been worked in
        self._newest: list[int | None] = [None] * len(SOURCES)
        self._speed: tuple[int, float] | None = None  # with which the next is compared
        self.restarts = 0
        self._waiting: list[_Sample] = []  # in order of time and source
        self._done: list[_Sample] = []  # those since the first kept state
        self._kept: list[_Kept] = []
        self._redo: int | None = None  # from when on
        self._read: tuple[list[float], list[float]] | None = None

    # -- samples and time -----------------------------------------------------------------------------------

    def add_imu(self, stamp: int, specific_force: Sequence[float], angular_rate: Sequence[float]) -> str:
        """Take a sample of an IMU at the sprung mass's centre of gravity, axes by REP 103.

        Parameters
        ----------
        stamp : int
            [ns]
        specific_force : sequence of 3 floats
            x forward, y left, z up [m/s^2]; at rest z is +9.80665.
        angular_rate : sequence of 3 floats
            Roll, pitch and yaw rate [rad/s].

        Returns
        -------
        str
            What became of it.
        """
        return self._add(_IMU, stamp, (*specific_force, *angular_rate))

    def add_travel(self, stamp: int, travel: Sequence[float]) -> str:
        """Take a sample of how far each spring is compressed from its position at rest [m]."""
        return self._add(_TRAVEL, stamp, travel)

    def add_hub(self, stamp: int, acceleration: Sequence[float]) -> str:
        """Take a sample of the vertical specific force of each hub [m/s^2], +9.80665 at rest."""
        return self._add(_HUB, stamp, acceleration)

    def add_wheel_speed(self, stamp: int, speed: Sequence[float]) -> str:
        """Take a sample of the spin of each wheel [rad/s], positive rolling forward."""
        return self._add(_WHEEL_SPEED, stamp, speed)

    def _add(self, source: int, stamp: int, values: Iterable[float]) -> str:
        outcome = self._place(source, operator.index(stamp), tuple(float(value) + 0.0 for value in values))
        self.counts[SOURCES[source]][outcome] += 1
        return outcome

    def _place(self, source: int, stamp: int, values: tuple[float, ...]) -> str:
        if len(values) != _COUNT[source]:
            raise ValueError(f"{SOURCES[source]} has {len(values)} values; it must have {_COUNT[source]}")
        largest = LARGEST[SOURCES[source]]
        values = tuple(value if abs(value) <= largest else math.nan for value in values)
        if all(value != value for value in values):
            return "not finite"
        sample = _Sample(stamp, source, values)
        if self._reached is not None and stamp < self._reached - WINDOW:
            return "out of order"
        past = self._reached is not None and stamp <= self._reached and self._belongs_to_the_past(sample)
        samples = self._done if past else self._waiting
        place = bisect_left(samples, (stamp, source), key=_order)
        repeated = place < len(samples) and _order(samples[place]) == (stamp, source)
        if repeated:
            samples[place] = sample
        else:
            samples.insert(place, sample)
        if past:
            self._redo = stamp if self._redo is None else min(self._redo, stamp)
        if repeated:
            return "repeated"
        return "taken" if self.time is None or stamp > self.time else "late"

    def _belongs_to_the_past(self, sample: _Sample) -> bool:
        """Whether something has been worked in that comes after it."""
        return bool(self._done) and _order(sample) <= _order(self._done[-1])

    def advance(self, stamp: int) -> bool:
        """Bring the estimate to the given time.

        Parameters
        ----------
        stamp : int
            [ns]

        Returns
        -------
        bool
            Whether there is an estimate to read.

        Raises
        ------
        ValueError
            The time lies before the one reached already; :meth:`reset` first if the clock was set back.
        """
        stamp = operator.index(stamp)
        if self.time is not None and stamp < self.time:
            raise ValueError(f"stamp is {stamp}; the estimator has already reached {self.time}")
        if self._redo is not None:
            self._go_back(self._redo)
            self._redo = None
        due = bisect_right(self._waiting, (stamp, len(SOURCES)), key=_order)
        for sample in self._waiting[:due]:
            self._work_in(sample)
        del self._waiting[:due]
        self.time = stamp
        self._read = None
        return self.running

    def _go_back(self, stamp: int) -> None:
        """Redo what comes from a time on."""
        while len(self._kept) > 1 and (self._kept[-1].time is None or self._moment(self._kept[-1]) > stamp):
            self._kept.pop()
        kept = self._kept.pop()
        self._take_over(kept)
        again = [sample for sample in self._done if kept.time is None or sample.stamp > kept.time]
        if kept.time is None:
            self._done = []
        else:
            self._done = [sample for sample in self._done if sample.stamp <= kept.time]
        for sample in again:
            self._work_in(sample)

    @staticmethod
    def _moment(kept: _Kept) -> int:
        assert kept.time is not None
        return kept.time + 1  # what it holds ends with its time; a sample of that time would come before its end

    def _work_in(self, sample: _Sample) -> None:
        begins = self._reached is None or sample.stamp > self._reached
        last = self._kept[-1].time if self._kept else None
        if not self._kept or begins and (last is None or sample.stamp - last >= BETWEEN):
            newest = tuple(self._newest)
            self._kept.append(_Kept(self._car.buffer.copy(), self._reached, newest, self._speed, self.restarts))
            self._forget(sample.stamp)
        self._done.append(sample)
        car, stamp, source, values = self._car, *sample
        if self._reached is None:
            pass
        elif stamp - self._reached > LONGEST_GAP:
            car.restart()
            self.restarts += 1
            self._speed = None
        else:
            self._predict(car, self._reached, stamp)
        self._reached = stamp
        self._newest[source] = stamp
        if source == _IMU:
            car.take_imu(values[:5])
        elif source == _TRAVEL:
            car.take_travel(values)
        elif source == _HUB:
            car.take_hub(values)
        else:
            self._take_speed(stamp, values)

    def _predict(self, car: CarFilter, begin: int, end: int) -> None:
        length = end - begin
        if length <= 0:
            return
        count = -(-length // STEP)
        step = length / count * 1e-9
        measured, weighs = self._in_use(_IMU, end), self._in_use(_TRAVEL, end)
        car.predict(step, count, measured, weighs)

    def _take_speed(self, stamp: int, values: tuple[float, ...]) -> None:
        """The car's speed; where there is no IMU, also what its change and the difference of the rear wheels tell."""
        known = [value for value in values if value == value]
        total = 0.0
        for value in known:
            total += value
        car, radius = self._car, self.vehicle.rolling_radius
        speed = total / len(known) * radius
        car.set_speed(abs(speed))
        if self._in_use(_IMU, stamp):
            self._speed = None
            return
        if self._speed is None:
            self._speed = stamp, speed
            return
        before, then = self._speed
        if stamp - before < SPEEDS_APART:
            return
        self._speed = stamp, speed
        along = (speed - then) / ((stamp - before) * 1e-9)
        across = speed * (values[3] - values[2]) * radius / self.vehicle.tracks[1]
        car.take_force(along, across)

    def _forget(self, stamp: int) -> None:
        """Let go of kept states and samples that no late sample can ask for."""
        first = 0
        while first + 1 < len(self._kept) and self._moment(self._kept[first + 1]) <= stamp - WINDOW:
            first += 1
        if first:
            del self._kept[:first]
            reached = self._kept[0].time
            assert reached is not None
            del self._done[: bisect_right(self._done, (reached, len(SOURCES)), key=_order)]

    def _in_use(self, source: int, time: int) -> bool:
        newest = self._newest[source]
        return newest is not None and time - newest <= self.timeout

    # -- everything in JSON ---------------------------------------------------------------------------------

    def snapshot(self) -> dict[str, Any]:
        """Everything that later results depend on, in JSON's types; :meth:`restore` continues from it bit for bit."""
        kept = self._kept[0] if self._kept else None
        return {
            "version": VERSION,
            "time": self.time,
            "reached": self._reached,
            "kept": None if kept is None else [kept.buffer.tolist(), kept.time, kept.newest, kept.speed, kept.restarts],
            "done": [_written(sample) for sample in self._done],
            "waiting": [_written(sample) for sample in self._waiting],
            "counts": {name: dict(counts) for name, counts in self.counts.items()},
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over the samples, the state and the time of a :meth:`snapshot`.

        Parameters
        ----------
        snapshot : mapping

        Raises
        ------
        ValueError
            The snapshot's state is that of another version of the filter.
        """
        version = snapshot.get("version", 1)
        if version != VERSION and snapshot["kept"] is not None:
            raise ValueError(
                f"its loads were estimated by version {version} of the filter, whose state version {VERSION} cannot go "
                "on from; replay it with the release that wrote it"
            )
        self.reset()
        self.counts = {name: Counter(snapshot["counts"][name]) for name in SOURCES}
        if snapshot["kept"] is not None:
            buffer, time, newest, speed, restarts = snapshot["kept"]
            speed = None if speed is None else (int(speed[0]), float(speed[1]))
            first = _Kept(np.array(buffer, dtype=np.float64), time, tuple(newest), speed, restarts)
            self._take_over(first)
            for sample in snapshot["done"]:
                self._work_in(_read(sample))
        self._waiting = [_read(sample) for sample in snapshot["waiting"]]
        self.time = snapshot["time"]

    def _take_over(self, kept: _Kept) -> None:
        self._car.buffer[:] = kept.buffer
        self._reached, self._speed, self.restarts = kept.time, kept.speed, kept.restarts
        self._newest = list(kept.newest)

    # -- what can be read -----------------------------------------------------------------------------------

    @property
    def running(self) -> bool:
        """Whether there is an estimate: whether a sample has come within the last 500 ms."""
        return self._reached is not None and self.time is not None and self.time - self._reached <= LONGEST_GAP

    @property
    def sources(self) -> tuple[str, ...]:
        """The sources in use."""
        if self.time is None:
            return ()
        return tuple(name for k, name in enumerate(SOURCES) if self._in_use(k, self.time))

    @property
    def band_hz(self) -> float:
        """Frequency up to which the sources in use make loads known [Hz]; 0 without any."""
        return max((BANDS[name] for name in self.sources), default=0.0)

    def _estimate(self) -> tuple[list[float], list[float]]:
        if self._read is None:
            if not self.running:
                raise ValueError("there is no estimate: no sample has come within the last 500 ms")
            car = self._car
            assert self._reached is not None and self.time is not None
            if self.time > self._reached:
                car = self._ahead
                car.buffer[:] = self._car.buffer
                self._predict(car, self._reached, self.time)
            self._read = car.loads()
        return self._read

    @property
    def load(self) -> FloatArray:
        """Vertical load of each tire [N], shape (4,)."""
        return np.array(self._estimate()[0])

    @property
    def standard_deviation(self) -> FloatArray:
        """Standard deviation of each load's error [N], shape (4,)."""
        return np.array(self._estimate()[1])

    @property
    def mass_error(self) -> tuple[float, float]:
        """By how much the sprung mass seems to exceed its parameter, over the mass, and the standard deviation."""
        return self._car.mass_error()

    @property
    def consistency(self) -> dict[str, float]:
        """Mean of each source's squared normalised innovations, over some ten seconds.

        1 where the equations and the noise are as the parameters say; NaN of a source without a use. Wheel speeds
        are of use where there is no IMU.
        """
        return dict(zip(SOURCES, self._car.consistency(), strict=True))

    @property
    def roughness(self) -> float:
        """Gd(0.1 cycles/m) of the road as it was learnt, if its waviness is 2 [m^3]."""
        return self._car.roughness


def _order(sample: _Sample) -> tuple[int, int]:
    return sample.stamp, sample.source


def _written(sample: _Sample) -> list[Any]:
    return [sample.stamp, sample.source, [None if value != value else value for value in sample.values]]


def _read(sample: Sequence[Any]) -> _Sample:
    stamp, source, values = sample
    return _Sample(int(stamp), int(source), tuple(math.nan if value is None else float(value) for value in values))
