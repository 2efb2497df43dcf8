"""What a report needs of a log, read once, block by block: curves, sums and spectra, and not the samples themselves."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bag import BagReader, Block
from ..cdr import messages
from ..estimator.load_filter import BANDS
from ..files.errors import InputError
from ..files.progress import progress
from ..replay.bag_setup import bag_setup, log_record, log_topic, pipeline_of
from ..replay.doubts import InputDoubts
from ..replay.inputs import reasons
from ..replay.load_source import FILTERED
from ..replay.mapped_messages import MappedMessages
from ..replay.parameters import complete, unit_of
from ..replay.pipeline import LOG_RECORD, TICK, fixed_inputs
from ..science.uniformity import Variation
from .analysis import (
    MEASURED,
    Envelope,
    HeldInput,
    Intervals,
    Moment,
    Moments,
    NewestInput,
    Orders,
    Spectra,
    WheelAngle,
    gaps,
    segment_length,
)

__all__ = ["CURVES", "ROLLING", "Drive", "ForceHarmonics", "Input", "Wheel", "WheelHarmonics", "gather", "has_outputs"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CURVES = ("load_z", "axle_z", "load_x", "axle_x", "speed")
BUCKETS, ALL_BUCKETS = 3000, 12_000  # of a curve; of a curve of all wheels together
BEFORE, AFTER = 0.35, 0.65  # [s] that are kept in full around the highest load
BEYOND = 1e15  # [N]: no force of an estimator, which marks itself diverged long before; a stranger's log may have any
MOST_MODES = 30  # belt harmonics on the road: more move nothing that is shown, and take as long as their cube
MOST_GAPS = 1000  # of each wheel that are listed one by one
ROLLING = 1.0  # [rad/s]: a slower wheel stands, and would count for what it stands on


@dataclass
class Input:
    """One topic that feeds the model: its messages, and what is wrong with some of them.

    ``counts`` has the node's own words, but is taken from the stamps alone, so that a log need not be replayed for it.
    ``is_sensor``: it brings no speed, load or height, only what loads are estimated from: no wheel waits for it.
    """

    topic: str
    kind: str
    is_sensor: bool = False
    intervals: Intervals = field(default_factory=Intervals)
    delay: Moments = field(default_factory=Moments)  # receipt after stamp [s]
    counts: Counter[str] = field(default_factory=Counter)
    messages: int = 0
    first: float = math.nan  # receipt [s]
    last: float = math.nan
    newest: int = -(2**62)  # stamp [ns]

    @property
    def rate(self) -> float:
        """Messages per second between the first and the last; NaN for fewer than two."""
        return (self.messages - 1) / (self.last - self.first) if self.last > self.first else math.nan


class ForceHarmonics(NamedTuple):
    """The harmonics of a force over the wheel's angle, and the standard error of each peak to peak [N]."""

    variation: Variation
    error: FloatArray


class WheelHarmonics(NamedTuple):
    """Those of the axle force fore and aft and of the vertical one."""

    x: ForceHarmonics
    z: ForceHarmonics


class Wheel:
    """One wheel through a drive. Forces in N, REP 103 axes; speed in rad/s; times in s.

    ``spectra`` are from the load to the axle force z, on the road from its height; ``of_load`` always from the load.
    """

    def __init__(
        self, name: str, duration: float, rate: float, buckets: int, timeout: float, *, on_road: bool = False
    ) -> None:
        self.name = name
        self.curves = {curve: Envelope(0.0, duration, buckets) for curve in CURVES}
        self.numbers = {curve: Moments() for curve in CURVES}
        self.deviations = Moments()  # of the load, where it is estimated: its stated standard deviation [N]
        self.deviation = Envelope(0.0, duration, buckets)  # the same over time
        self.speeds: Counter[int] = Counter()  # samples by speed, to 1 rad/s
        self.spectra = Spectra(rate, segment_length(rate, duration), hold=1 if on_road else 0)
        self.of_load = Spectra(rate, segment_length(rate, duration)) if on_road else self.spectra
        self._heights = NewestInput() if on_road else None
        self.moment = Moment(BEFORE, AFTER, [np.float64, np.float64, object])  # load, axle force z, belts
        self.outputs = self.unusable = 0
        self.gaps: list[tuple[float, float]] = []
        self.missing = 0.0  # [s] without outputs
        self.first = self.last = math.nan
        self.intervals = Intervals()
        self.angle = WheelAngle(timeout)
        self._orders: dict[int, tuple[Orders, Orders]] = {}  # of axle force x and z, by segment
        self._held = HeldInput()
        self._before: tuple[float, float] | None = None  # tick and force

    def take_loads(self, acts: FloatArray, load: FloatArray, traction: FloatArray) -> None:
        """Take loads and tractions, from the times on at which they act."""
        for curve, values in (("load_z", load), ("load_x", traction)):
            self.curves[curve].add(acts, values)
            self.numbers[curve].add(values)

    def take_heights(self, acts: FloatArray, height: FloatArray) -> None:
        """Take the road's heights [m], from the times on at which they act."""
        if self._heights is not None:
            self._heights.add(acts, height)

    def take_speeds(self, time: FloatArray, speed: FloatArray, stamp: FloatArray, position: FloatArray) -> None:
        """Take speeds and, unless NaN, angles: from the times on at which they act, and the times that they are of."""
        self.angle.add(stamp, speed, position)
        self.curves["speed"].add(time, speed)
        self.numbers["speed"].add(speed)
        values, counts = np.unique(np.round(np.abs(speed)), return_counts=True)
        for value, count in zip(values.tolist(), counts.tolist(), strict=True):
            self.speeds[int(value)] += count

    def take_forces(self, tick: FloatArray, force: FloatArray, acts: FloatArray, load: FloatArray) -> None:
        """Take axle forces (T, 2) at ticks, and the loads that have come since the last ones."""
        self.curves["axle_x"].add(tick, force[:, 0])
        self.curves["axle_z"].add(tick, force[:, 1])
        self.numbers["axle_x"].add(force[:, 0])
        self.numbers["axle_z"].add(force[:, 1])
        self.outputs += tick.size
        mean = self._held.mean(acts, load, tick)
        if not tick.size:
            return
        if math.isnan(self.first):
            self.first = float(tick[0])
        # The force at a tick is the answer to loads before it: it goes with the mean load until the next.
        at = np.concatenate([[math.nan if self._before is None else self._before[0]], tick])
        z = np.concatenate([[math.nan if self._before is None else self._before[1]], force[:, 1]])
        self.intervals.add(np.diff(at)[np.isfinite(np.diff(at))])
        usable = np.isfinite(mean) & np.isfinite(at[:-1])
        self.of_load.add(at[:-1][usable], mean[usable], z[:-1][usable])
        if self._heights is not None:
            height = self._heights.at(tick)  # to which the road has come by then
            known = np.isfinite(height)
            self.spectra.add(tick[known], height[known], force[known, 1])
        for begin, end in gaps(at[np.isfinite(at)], 1.5 / self.spectra.rate).tolist():
            self.missing += end - begin - 1.0 / self.spectra.rate
            if len(self.gaps) < MOST_GAPS:
                self.gaps.append((begin, end))
        self._before = float(tick[-1]), float(force[-1, 1])
        self.last = float(tick[-1])

    def take_forces_by_angle(self, tick: FloatArray, force: FloatArray) -> None:
        """Take axle forces (T, 2) at ticks, for their harmonics over the wheel's angle."""
        angle, speed, segment = self.angle.at(tick)
        rolling = np.abs(speed) >= ROLLING
        for number in np.unique(segment[rolling]).tolist():
            if number not in self._orders:  # of those whose zero is their own, only the longest is of use
                longest = max(self._orders, key=lambda key: self._orders[key][0].turns, default=MEASURED)
                self._orders = {key: some for key, some in self._orders.items() if key in (MEASURED, longest)}
                self._orders[number] = Orders(), Orders()
            some = rolling & (segment == number)
            for orders, column in zip(self._orders[number], force.T, strict=True):
                orders.add(angle[some], column[some])

    @property
    def measured(self) -> bool:
        """Whether its angle was measured, and not only its speed."""
        return self.angle.measured > 1 and MEASURED in self._orders

    @property
    def orders(self) -> tuple[Orders, Orders] | None:
        """The harmonics of axle force x and z over the wheel's measured angle, or else its longest segment; if any."""
        if self.measured:
            return self._orders[MEASURED]
        return max(self._orders.values(), key=lambda some: some[0].turns, default=None)

    @property
    def harmonics(self) -> WheelHarmonics | None:
        """The harmonics of the axle force; None if the wheel went too few turns, or too unevenly."""
        if self.orders is None:
            return None
        (x, x_error), (z, z_error) = (orders.variation() for orders in self.orders)
        if x is None or z is None:
            return None
        return WheelHarmonics(ForceHarmonics(x, x_error), ForceHarmonics(z, z_error))

    @property
    def mean_speed(self) -> float:
        """[rad/s]; NaN if no speed is known."""
        return self.numbers["speed"].mean

    @property
    def highest_speed(self) -> float:
        """Either way [rad/s]."""
        return abs(self.numbers["speed"].peak)


@dataclass
class Drive:
    """A drive as the report tells it."""

    name: str
    replayed: bool
    begin_ns: int
    duration: float
    parameters: dict[str, Any]
    wheels: list[Wheel]
    inputs: list[Input]
    topics: dict[str, tuple[str, int | None]]  # type, and count if the bag says it
    damage: str
    dropped: dict[str, int]
    changes: int = 0  # of the tire, in the drive
    clock_resets: int = 0
    without: dict[str, str] = field(default_factory=dict)  # why a wheel has no outputs
    doubts: list[str] = field(default_factory=list)  # what is odd about speeds and loads
    sources: tuple[str, ...] = ()  # that loads were estimated from: wheel_speed, imu, travel, hub

    @property
    def unit(self) -> Any:
        """The tire with which the drive began."""
        return unit_of(self.parameters)

    @property
    def on_road(self) -> bool:
        """Whether its tires stand on a road, and the loads are what comes of it."""
        return self.load_source == "road"

    @property
    def load_source(self) -> str:
        """Where its loads are from: topic, road or estimate."""
        return str(self.parameters["load_source"])

    @property
    def band_hz(self) -> float:
        """Frequency up to which the sources make estimated loads known [Hz]; 0 without any."""
        return max((BANDS[name] for name in self.sources), default=0.0)

    @property
    def contact_modes(self) -> int | None:
        """Highest belt harmonic of the tire on the road, at most ``MOST_MODES``; None under given loads."""
        return min(int(self.parameters["n_max"]), MOST_MODES) if self.on_road else None


def has_outputs(reader: BagReader) -> bool:
    """Whether a bag is a log that can be reported as it is; ``InputError`` if its record is damaged."""
    if log_topic(reader) is None:
        return False
    names = bag_setup(reader).names
    forces = [full for name, full in names.items() if name.endswith("/axle_wrench") and full in reader.topics]
    return any(True for _ in reader.messages(forces))


def gather(reader: BagReader, source: BagReader, *, replayed: bool = False, quiet: bool = False) -> Drive:
    """Read a log.

    Parameters
    ----------
    reader : BagReader
        Of a log, see :func:`has_outputs`.
    source : BagReader
        Of the bag that the user named: the same, or what was replayed into the log.
    replayed : bool
        Whether the outputs come from a replay that was made for the report.
    quiet : bool
        Show no progress, not even on a terminal.

    Returns
    -------
    Drive

    Raises
    ------
    InputError
        The log is damaged, or its record cannot be used.
    """
    reading = _Reading(reader)
    seen = InputDoubts(source, reading.parameters, reading.names)
    blocks = reader.blocks(reading.full & reader.topics.keys(), in_file_order=True)
    for block in progress(
        blocks, reader.message_count, "report", size=lambda block: block.topic.size, unit="messages", quiet=quiet
    ):
        seen.take(block)
        reading.take(block)
    return Drive(
        name=source.path.resolve().name,
        replayed=replayed,
        begin_ns=reading.begin,
        duration=reading.duration,
        parameters=reading.parameters,
        wheels=reading.wheels,
        inputs=[each for each in reading.inputs.values() if each.messages],
        topics={name: (kind, source.counts.get(name)) for name, kind in source.topics.items()},
        damage=source.damage,
        dropped={str(key): value for key, value in reading.dropped.items() if isinstance(value, int) and value > 0},
        changes=reading.changes,
        clock_resets=reading.clock_resets,
        without=reading.reasons(reader),
        doubts=seen.doubts(),
        sources=reading.sources(),
    )


class _Reading:
    """A log on its way through."""

    def __init__(self, reader: BagReader) -> None:
        self.parameters, self.names, log = how = bag_setup(reader)
        assert log is not None and reader.start_ns is not None and reader.end_ns is not None
        self.begin = reader.start_ns
        self.duration = max((reader.end_ns - reader.start_ns) * 1e-9, 1e-9)
        self.dropped: Mapping[str, Any] = {}
        self.changes = self.clock_resets = 0
        self._unit = unit_of(self.parameters)
        self._timeout = round(1e9 * self.parameters["input_timeout_s"])
        self._tick = -(2**62)  # [ns]
        wheels = self.parameters["wheels"]
        buckets = max(100, min(BUCKETS, ALL_BUCKETS // len(wheels)))
        timeout = self.parameters["input_timeout_s"]
        rate, on_road = self.parameters["rate_hz"], self.parameters["load_source"] == "road"
        self.wheels = [Wheel(wheel, self.duration, rate, buckets, timeout, on_road=on_road) for wheel in wheels]
        self.inputs = {
            relative: Input(self.names[relative], kind)
            for relative, kind in fixed_inputs(self.parameters).items()
            if self.names.get(relative) in reader.topics
        }
        self._fixed = fixed_inputs(self.parameters).keys()
        mapped = pipeline_of(reader, how).mapped
        self._mapped = MappedMessages(mapped, len(wheels))
        for each in mapped:
            is_sensor = not {group.quantity for group in each.values} & {"speed", "load", "road_height"}
            self.inputs.setdefault(each.topic, Input(self.names[each.topic], each.msgtype, is_sensor))
        self._used: set[str] = set()  # quantities of which there was a value
        self._mapped_loads: dict[str, list[tuple[FloatArray, FloatArray, FloatArray]]] = {}
        self.full = set(self.names.values())
        self._joints = messages.JointStateDecoder()

    def reasons(self, reader: BagReader) -> dict[str, str]:
        """Why wheels have no outputs."""
        without = [each.name for each in self.wheels if not each.outputs]
        return reasons(reader, self.parameters, self.names, without, self._mapped.mapped)

    def sources(self) -> tuple[str, ...]:
        """What the loads were estimated from, if they were, the best last."""
        if self.parameters["load_source"] != "estimate":
            return ()
        used = self._used | ({"speed"} if any(each.numbers["speed"].count for each in self.wheels) else set())
        return tuple(sorted((FILTERED[each] for each in used if each in FILTERED), key=BANDS.__getitem__))

    def take(self, block: Block) -> None:
        """Take a block."""
        where = {full: number for number, full in enumerate(block.topics)}
        order = np.argsort(block.topic, kind="stable")
        edges = np.searchsorted(block.topic[order], np.arange(len(block.topics) + 1))

        def of(relative: str) -> IntArray:
            number = where.get(self.names.get(relative, ""))
            return np.empty(0, np.int64) if number is None else order[edges[number] : edges[number + 1]]

        place = of(LOG_RECORD)
        for each in place.tolist():
            self._take_record(block.data[block.start[each] : block.start[each] + block.size[each]])
        place = of(TICK)
        valid, ticks = messages.decode_clocks(block.data, block.start[place], block.size[place])
        self._ticks, self._tick_place = ticks[valid], place[valid]
        self.clock_resets += int((np.diff(self._ticks, prepend=self._tick) < 0).sum())
        if "joint_states" in self._fixed:
            self._take_joint_states(block, of("joint_states"))
        self._mapped_loads = {}
        for topic in self._mapped.topics:
            self._take_mapped(topic, block, of(topic))
        for wheel in self.wheels:
            place = of(name := f"{wheel.name}/wheel_speed")
            valid, speed = messages.decode_float64s(block.data, block.start[place], block.size[place])
            self._take_speeds(name, wheel, block, place, valid, block.log_time[place], speed)
            acts, load = self._take_loads(wheel, block, of)
            place = of(f"{wheel.name}/axle_wrench")
            valid, stamp, fx, fz = messages.decode_wrenches(block.data, block.start[place], block.size[place])
            force = np.stack([fx, fz], axis=1)
            usable = valid & (np.abs(force) < BEYOND).all(axis=1)
            wheel.unusable += int((~usable).sum())
            tick, force = self._seconds(stamp[usable]), force[usable]
            wheel.take_forces(tick, force, acts, load)
            wheel.take_forces_by_angle(tick, force)
            place = of(f"{wheel.name}/ring_deflection")
            belts = np.empty(place.size, object)
            belts[:] = [block.data[k : k + n] for k, n in zip(block.start[place], block.size[place], strict=True)]
            wheel.moment.add((acts, load), (tick, force[:, 1]), (self._seconds(self._tick_before(place)), belts))
        if self._ticks.size:
            self._tick = int(self._ticks[-1])

    def _seconds(self, stamp: IntArray) -> FloatArray:
        return (stamp - self.begin).astype(np.float64) * 1e-9

    def _tick_before(self, place: IntArray) -> IntArray:
        """The tick before each place in the block [ns]."""
        return np.concatenate([[self._tick], self._ticks])[np.searchsorted(self._tick_place, place)]

    def _take_record(self, data: bytes) -> None:
        record = log_record(data)
        self.dropped = record.get("dropped") or self.dropped
        try:
            unit = unit_of(complete(record["parameters"]))
        except ValueError as error:
            raise InputError(f"the log's record of its parameters cannot be used: {error}") from None
        self.changes += unit != self._unit
        self._unit = unit

    def _accepted(
        self, name: str, block: Block, place: IntArray, valid: NDArray[np.bool_], stamp: IntArray
    ) -> tuple[NDArray[np.bool_], IntArray, IntArray]:
        """Which messages the model may have taken, what time they are of, and from when on they act [ns].

        Everything else is counted.
        """
        known = self.inputs[name]
        received = block.log_time[place]
        if not place.size:
            return valid, stamp, stamp
        known.messages += place.size
        times = self._seconds(received)
        known.intervals.add(np.diff(times, prepend=known.last))
        known.first, known.last = (times[0] if math.isnan(known.first) else known.first), times[-1]
        counts = known.counts
        counts["malformed"] += int((~valid).sum())
        none = valid & (stamp == 0)
        counts["no stamp"] += int(none.sum())
        stamp = np.where(none, received, stamp)
        early = valid & (stamp > received + self._timeout)
        counts["in the future"] += int(early.sum())
        valid = valid & ~early
        stamps = stamp[valid]
        if not known.kind == messages.FLOAT64:
            known.delay.add((received[valid] - stamps).astype(np.float64) * 1e-9)
        if known.is_sensor:  # the filter works it in at its own time, whatever the order
            return valid, stamp, stamp
        newest = np.maximum.accumulate(np.concatenate([[known.newest], stamps]))
        counts["repeated"] += int((stamps == newest[:-1]).sum())
        behind = stamps < newest[:-1]
        counts["out of order"] += int(behind.sum())
        known.newest = int(newest[-1])
        valid = valid.copy()
        valid[np.flatnonzero(valid)[behind]] = False
        tick = self._tick_before(place)
        counts["late"] += int((valid & (stamp < tick)).sum())
        return valid, stamp, np.maximum(stamp, tick)

    def _refused(self, name: str, reason: str, valid: NDArray[np.bool_], wrong: NDArray[np.bool_]) -> NDArray[np.bool_]:
        self.inputs[name].counts[reason] += int((valid & wrong).sum())
        return valid & ~wrong

    def _take_joint_states(self, block: Block, place: IntArray) -> None:
        if not place.size:
            return
        valid, stamp, groups = self._joints.decode_block(block.data, block.start[place], block.size[place])
        valid, stamp, acts = self._accepted("joint_states", block, place, valid, stamp)
        for some, names, velocities, positions in groups:
            if velocities.shape[1] != len(names):
                self.inputs["joint_states"].counts["no velocity"] += len(some)
                continue
            for wheel, joint in zip(self.wheels, self.parameters["joint_names"], strict=True):
                if joint in names:
                    column = names.index(joint)
                    speed = velocities[:, column]
                    angle = np.full(speed.size, math.nan) if positions is None else positions[:, column]
                    self._take_usable_speeds("joint_states", wheel, valid[some], acts[some], speed, stamp[some], angle)

    def _take_mapped(self, topic: str, block: Block, place: IntArray) -> None:
        if not place.size:
            return
        where = block.log_time[place], block.data, block.start[place], block.size[place]
        samples = self._mapped.read(topic, *where)
        self._used |= {name for name, values in samples.values.items() if np.isfinite(values[samples.valid]).any()}
        if topic in self._fixed:  # it is counted, and its speeds are taken, as what it is without the map
            return
        valid, stamp, acts = self._accepted(topic, block, place, samples.valid, samples.stamp)
        for k, wheel in enumerate(self.wheels):
            if "road_height" in samples.values:
                heights = samples.values["road_height"][:, k]
                there = valid & np.isfinite(heights)
                wheel.take_heights(self._seconds(acts[there]), heights[there])
        none = np.full((place.size, len(self.wheels)), math.nan)
        speeds, angles = (samples.values.get(name, none) for name in ("speed", "angle"))
        loads, tractions = (samples.values.get(name, none) for name in ("load", "traction"))
        for k, wheel in enumerate(self.wheels):
            if "speed" in samples.values:
                there = valid & ~np.isnan(speeds[:, k])
                self._take_usable_speeds(topic, wheel, there, acts, speeds[:, k], stamp, angles[:, k])
            if "load" in samples.values:
                there = valid & ~np.isnan(loads[:, k])
                too_high = np.abs(loads[:, k]) > self.parameters["max_load_n"]
                there = self._refused(topic, "load too high", there, too_high)
                self.inputs[topic].counts["off the ground"] += int((there & (loads[:, k] < 0.0)).sum())
                part = self._seconds(acts[there]), np.maximum(loads[there, k], 0.0), np.nan_to_num(tractions[there, k])
                self._mapped_loads.setdefault(wheel.name, []).append(part)

    def _take_speeds(
        self, name: str, wheel: Wheel, block: Block, place: IntArray, valid: Any, stamp: IntArray, speed: FloatArray
    ) -> None:
        if place.size:
            valid, stamp, acts = self._accepted(name, block, place, valid, stamp)
            self._take_usable_speeds(name, wheel, valid, acts, speed, stamp, np.full(speed.size, math.nan))

    def _take_usable_speeds(
        self, name: str, wheel: Wheel, valid: Any, acts: IntArray, speed: FloatArray, stamp: IntArray, angle: FloatArray
    ) -> None:
        usable = self._usable_speed(name, valid, speed)
        times = self._seconds(acts[usable]), self._seconds(stamp[usable])
        wheel.take_speeds(times[0], speed[usable], times[1], angle[usable])

    def _usable_speed(self, name: str, valid: NDArray[np.bool_], speed: FloatArray) -> NDArray[np.bool_]:
        valid = self._refused(name, "not finite", valid, ~np.isfinite(speed))
        return self._refused(name, "speed too high", valid, np.abs(speed) > self.parameters["max_speed_rad_s"])

    def _take_loads(self, wheel: Wheel, block: Block, of: Any) -> tuple[FloatArray, FloatArray]:
        """The loads of a wheel, and from when on they act [s]."""
        if self.parameters["load_source"] == "road":
            return self._take_contact(wheel, block, of)
        if self.parameters["load_source"] == "estimate":
            return self._take_estimate(wheel, block, of)
        parts = []
        for name in (f"{wheel.name}/load", f"{wheel.name}/load_force"):
            place = of(name) if name in self.inputs else np.empty(0, np.int64)
            if not place.size:
                continue
            if self.inputs[name].kind == messages.FLOAT64:
                valid, fz = messages.decode_float64s(block.data, block.start[place], block.size[place])
                stamp, fx = block.log_time[place], np.zeros(place.size)
            else:
                valid, stamp, fx, fz = messages.decode_wrenches(block.data, block.start[place], block.size[place])
            valid, _, acts = self._accepted(name, block, place, valid, stamp)
            valid = self._refused(name, "not finite", valid, ~(np.isfinite(fz) & np.isfinite(fx)))
            limit = self.parameters["max_load_n"]
            valid = self._refused(name, "load too high", valid, (np.abs(fz) > limit) | (np.abs(fx) > limit))
            self.inputs[name].counts["off the ground"] += int((valid & (fz < 0.0)).sum())
            parts.append((self._seconds(acts[valid]), np.maximum(fz[valid], 0.0), fx[valid]))
        parts += self._mapped_loads.get(wheel.name, [])
        if not parts:
            return np.empty(0), np.empty(0)
        acts_s, load, traction = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        wheel.take_loads(acts_s, load, traction)
        return acts_s, load

    def _take_contact(self, wheel: Wheel, block: Block, of: Any) -> tuple[FloatArray, FloatArray]:
        """The same on the road, where loads are an output; its heights are taken and counted."""
        place = of(name := f"{wheel.name}/road_height")
        if name in self.inputs and place.size:
            valid, height = messages.decode_float64s(block.data, block.start[place], block.size[place])
            valid, _, acts = self._accepted(name, block, place, valid, block.log_time[place])
            valid = self._refused(name, "not finite", valid, ~np.isfinite(height))
            wheel.take_heights(self._seconds(acts[valid]), height[valid])
        return self._take_output(wheel, block, of(f"{wheel.name}/contact_load"))

    def _take_estimate(self, wheel: Wheel, block: Block, of: Any) -> tuple[FloatArray, FloatArray]:
        """The same where loads are estimated; each acts from its tick on."""
        place = of(f"{wheel.name}/load_standard_deviation")
        valid, deviation = messages.decode_float64s(block.data, block.start[place], block.size[place])
        usable = valid & (deviation >= 0.0) & (deviation < BEYOND)
        wheel.deviations.add(deviation[usable])
        wheel.deviation.add(self._seconds(self._tick_before(place[usable])), deviation[usable])
        return self._take_output(wheel, block, of(f"{wheel.name}/load_estimate"))

    def _take_output(self, wheel: Wheel, block: Block, place: IntArray) -> tuple[FloatArray, FloatArray]:
        """Loads that are an output of the node."""
        valid, stamp, _, fz = messages.decode_wrenches(block.data, block.start[place], block.size[place])
        usable = valid & (np.abs(fz) < BEYOND)
        wheel.unusable += int((~usable).sum())
        acts, load = self._seconds(stamp[usable]), fz[usable]
        wheel.take_loads(acts, load, np.zeros(load.size))
        return acts, load
