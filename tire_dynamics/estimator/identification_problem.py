"""What is fitted to what: a recording, the logarithms of a unit's parameters, and the model over sections of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from ..science import wheel
from ..science.interpolation import smooth_curve
from ..science.spectra import Transfer
from ..science.uncertainty import value_of, with_values
from ..science.unit import TireWheelUnit
from .simulate import simulate

__all__ = [
    "AXES",
    "DEFAULT_FIT",
    "DIFFERENCE",
    "FITTED",
    "FORE_AFT",
    "GAP",
    "HELD",
    "Identification",
    "Joined",
    "OUTPUT_DEGREE",
    "Problem",
    "Recording",
    "Seen",
    "Section",
    "TOP_ZETA",
    "median",
]

FloatArray = NDArray[np.float64]

Joined = Literal["smooth", "lines", "zero-order-hold"]
OUTPUT_DEGREE: Final = 5
"""Of the splines through the model's force, at 1 kHz at least: they keep the gain to 3e-6 at 100 Hz."""

DEFAULT_FIT: Final = ("k_1", "zeta_1", "wheel_mass", "suspension_stiffness", "zeta_s")
FORE_AFT: Final = ("longitudinal_stiffness", "longitudinal_damping_ratio", "longitudinal_mass")
FITTED: Final = (*DEFAULT_FIT, "density", *FORE_AFT)
"""What can be fitted; ``k_1`` scales radial and tangential stiffness together, the rest are fields."""

AXES: Final = {"z": (1,), "xz": (0, 1)}  # columns of the force

_FINE = 1000.0  # [Hz], at least, of the steps in which the model runs
GAP = 3.5  # sampling intervals without a sample end a section
_SLOWEST = 10.0  # [Hz] of the samples
_FORGET = 9.0  # e-foldings of the slowest motion until a section no longer remembers how it began; see _forgetting
_FACTOR = 30.0  # by which a parameter may leave the starting unit's
TOP_ZETA = 0.99
HELD: Final = 1e-6  # width of a prior that leaves nothing free
DIFFERENCE = 1e-6  # of the logarithm, for derivatives


@dataclass(frozen=True, eq=False)
class Recording:
    """One wheel's samples; every time ascends strictly [s], on one clock.

    Attributes
    ----------
    speed_time, speed : ndarray, shape (S,)
        Spin Omega [rad/s].
    load_time, load, traction : ndarray, shape (L,)
        Vertical load, up positive, and traction on the tire along x_ros [N].
    force_time : ndarray, shape (N,)
    force : ndarray, shape (N, 2)
        What was measured at the axle, [x, z], REP 103 axes [N].
    """

    speed_time: FloatArray
    speed: FloatArray
    load_time: FloatArray
    load: FloatArray
    traction: FloatArray
    force_time: FloatArray
    force: FloatArray

    def __post_init__(self) -> None:
        for name, size in (("speed", (self.speed.size,)), ("load", (self.load.size,)), ("force", self.force.shape)):
            time, values = getattr(self, f"{name}_time"), getattr(self, name)
            if time.size < 2 or values.shape != size or time.shape != size[:1]:
                raise ValueError(f"{name} has {time.size} times and values of shape {values.shape}; two are needed")
            if not (np.isfinite(time).all() and np.isfinite(values).all()):
                raise ValueError(f"{name} holds a value that is not finite")
            if not (np.diff(time) > 0.0).all():
                raise ValueError(f"{name}_time must ascend")
        if self.force.ndim != 2 or self.force.shape[1] != 2:
            raise ValueError(f"force has shape {self.force.shape}; it must be (N, 2)")
        if self.traction.shape != self.load.shape or not np.isfinite(self.traction).all():
            raise ValueError("traction must be finite and of the load's shape")


class Seen(NamedTuple):
    """The frequency response from load to F' that was seen around one speed [rad/s]; its phase has the delay."""

    speed: float
    transfer: Transfer


@dataclass(frozen=True, eq=False)
class Identification:
    """What :func:`identify` found.

    Attributes
    ----------
    unit, start : TireWheelUnit
        With the estimates, and what it began from.
    names : tuple of str
        What was fitted.
    values : ndarray, shape (P,)
    errors : ndarray, shape (P,)
        Standard errors of ln(value): 0.02 is 2 %. The 95 % interval is value exp(+-2 error).
    correlation : ndarray, shape (P, P)
        Of the estimates, the delay and the offset being unknown as well.
    from_data : ndarray, shape (P,)
        Standard errors as the data alone would have them, without the prior; beyond ``prior_width`` the estimate is
        more the prior's than theirs.
    at_bound : tuple of str
        Parameters that ended at the end of the range that is looked at.
    prior_width : ndarray, shape (P,)
        Standard deviation of the prior of each ln(value).
    delay, delay_error : float
        Of the measured force after the load's channel [s]: where that is late itself, so much less.
    gain, gain_error : float
        Of the force's sensor over the load's, with its prior.
    load_noise : float
        White noise that the load's channel has [N rms], as it was said, or may have at the most.
    bias : ndarray, shape (P,)
        What that noise does to ln(value), and is in ``errors``; where it was said, it is taken out.
    axes : tuple of int
        Columns of the force that were fitted, 0 for x and 1 for z; the next four have a value for each.
    offset, offset_error, noise, explained : ndarray
        Of the sensor [N]; rms of what the model leaves [N]; the share of the force's variance that it explains.
    orders : tuple of int
        Of the autoregression that describes the noise.
    unexplained : float
        Share of what is left that follows the load nevertheless, by its coherence; of noise there is next to none.
    seconds : float
        Of the measurement that was used.
    samples, sections : int
        Those of the measurement that were used; in how many pieces the speed and the load came.
    seen : tuple of Seen
        The speed with the most segments first.
    """

    unit: TireWheelUnit
    start: TireWheelUnit
    names: tuple[str, ...]
    values: FloatArray
    errors: FloatArray
    correlation: FloatArray
    from_data: FloatArray
    at_bound: tuple[str, ...]
    prior_width: FloatArray
    delay: float
    delay_error: float
    gain: float
    gain_error: float
    load_noise: float
    bias: FloatArray
    axes: tuple[int, ...]
    offset: FloatArray
    offset_error: FloatArray
    noise: FloatArray
    explained: FloatArray
    orders: tuple[int, ...]
    unexplained: float
    seconds: float
    samples: int
    sections: int
    seen: tuple[Seen, ...]

    @property
    def priors(self) -> tuple[str, ...]:
        """Parameters of which the data say less than the prior."""
        known = zip(self.names, self.from_data, self.prior_width, strict=True)
        return tuple(name for name, own, width in known if own > width)


class Section(NamedTuple):
    """Inputs over a time without gaps, at the times at which the model is computed; those ``kept`` are wanted."""

    time: FloatArray
    speed: FloatArray
    load: FloatArray
    traction: FloatArray
    kept: slice | NDArray[np.bool_]


class Problem:
    """A recording in sections, and the unit at parameters x = ln(value)."""

    def __init__(
        self,
        recording: Recording,
        start: TireWheelUnit,
        names: tuple[str, ...],
        axes: tuple[int, ...],
        joined: Joined,
        prior_width: FloatArray,
        model: wheel.Model,
        gain_width: float = 0.0,
        load_noise: float | None = None,
    ) -> None:
        self.recording, self.start, self.names, self.axes = recording, start, names, axes
        self.joined, self.prior_width, self.model = joined, prior_width, model
        self.gain_width, self.given_noise = max(gain_width, HELD), load_noise
        self.origin = np.log([value_of(start, name) for name in names])
        reach = math.log(_FACTOR)
        tops = [math.log(TOP_ZETA) if "zeta" in n or "damping_ratio" in n else math.inf for n in names]
        self.low, self.high = self.origin - reach, np.minimum(self.origin + reach, tops)
        self.interval = float(np.median(np.diff(recording.force_time)))
        for name, time in (("load", recording.load_time), ("force", recording.force_time)):
            rate = 1.0 / float(np.median(np.diff(time)))
            if not _SLOWEST <= rate:
                raise ValueError(f"the {name} has {rate:.3g} samples per second; it must have {_SLOWEST:g} at least")
        self.settling = _forgetting(start, recording.speed, model)
        spans = _common(
            _runs(recording.load_time, GAP),
            _runs(recording.speed_time, max(GAP, 0.3 / median(recording.speed_time))),
        )
        if not len(spans):
            raise ValueError("speed and load are never there at the same time")
        longest = float((spans[:, 1] - spans[:, 0]).max())
        self.spans = [(a, b) for a, b in spans.tolist() if b - a > self.settling + 0.2]
        self.sections = self._sections(recording.load, recording.traction)
        if not self.sections:
            raise ValueError(
                f"no section without a gap is longer than {longest:.3g} s; the starting unit takes "
                f"{self.settling:.3g} s to forget how it began"
            )

    def _sections(self, load: FloatArray, traction: FloatArray) -> list[Section]:
        """The inputs over each span, of a load and a traction at the stamps of the recording's."""
        return [self._section(begin, end, load, traction) for begin, end in self.spans]

    def load_noise(self) -> float:
        """How much white noise the load's channel has at the most [N rms]: all that is near half its sampling rate.

        There the road has little left, and white noise as much as elsewhere.
        """
        record = self.recording
        rate = 1.0 / median(record.load_time)
        floors, weights = [], []
        for begin, end in self.spans:
            part = record.load[slice(*np.searchsorted(record.load_time, [begin - 1e-9, end + 1e-9]))]
            length = min(256, part.size)
            if length >= 32:
                f, density = signal.welch(part, rate, nperseg=length, detrend="constant")
                band = (f > 0.4 * rate) & (f < 0.48 * rate)
                floors.append(float(density[band].mean()))
                weights.append(part.size)
        return math.sqrt(float(np.average(floors, weights=weights)) * 0.5 * rate) if floors else 0.0

    def sections_of_noise(self, rms: float) -> list[Section]:
        """The spans with white noise [N rms] in the place of the load: always the same, by a seed."""
        noise = np.random.default_rng(1992).standard_normal(self.recording.load.size)
        return self._sections(rms * noise, np.zeros_like(noise))

    def _section(self, begin: float, end: float, load: FloatArray, traction: FloatArray) -> Section:
        record = self.recording
        inside = slice(*np.searchsorted(record.load_time, [begin - 1e-9, end + 1e-9]))
        stamps = record.load_time[inside]
        inputs = np.column_stack([load[inside], traction[inside]])
        parts = max(1, math.ceil(_FINE * float(np.median(np.diff(record.load_time)))))
        kept: slice | NDArray[np.bool_] = slice(None)
        if self.joined == "smooth":
            step = (stamps[-1] - stamps[0]) / (parts * (stamps.size - 1))
            time = stamps[0] + step * np.arange(parts * (stamps.size - 1) + 1)
            curve = smooth_curve(stamps, inputs)
            # The model joins its samples by lines: those which lie beside the curve such that they carry what it does.
            # Lines keep sinc^2(f step) of a sine, whose inverse is 1 + u^2/3 + u^4/15 + ... at u = pi f step.
            forces = curve(time)
            if stamps.size > 5:
                forces = forces - step**2 / 12.0 * curve(time, 2) + step**4 / 240.0 * curve(time, 4)
        else:
            time = np.interp(np.arange(parts * (stamps.size - 1) + 1) / parts, np.arange(stamps.size), stamps)
            forces = np.column_stack([np.interp(time, stamps, column) for column in inputs.T])
            if self.joined == "zero-order-hold":  # a step is a line over a nanosecond
                held = inputs[np.arange(time.size - 1) // parts]
                before = np.arange(parts, time.size, parts)
                forces = np.insert(np.concatenate([held, inputs[-1:]]), before, inputs[before // parts - 1], axis=0)
                time = np.insert(time, before, time[before] - 1e-9)
                kept = np.ones(time.size, np.bool_)
                kept[before + np.arange(before.size)] = False
        speed = np.interp(time, record.speed_time, record.speed)
        return Section(time, speed, forces[:, 0], forces[:, 1], kept)

    def unit(self, x: FloatArray) -> TireWheelUnit:
        """The unit at parameters."""
        return with_values(self.start, dict(zip(self.names, np.exp(x).tolist(), strict=True)))

    def forces(self, unit: TireWheelUnit, section: Section) -> FloatArray:
        """The unit's axle forces (K, 2) at the kept times; not finite where it is so unstable that they overflow."""
        with np.errstate(over="ignore", invalid="ignore"):
            time = section.time - section.time[0]  # a regular grid's rounding is then no more than its own
            seen = simulate(unit, time, section.speed, section.load, section.traction, model=self.model, n_max=2)
            return seen.axle_force[section.kept]


def _forgetting(unit: TireWheelUnit, speeds: FloatArray, model: wheel.Model) -> float:
    """After how long a section no longer shows how it began [s].

    Nine times the slowest motion's time: exp(-9), or exp(-6) for a damping that is a third less than that of the unit.
    """
    extremes = {float(speeds.min()), float(speeds.max()), 0.5 * float(speeds.min() + speeds.max())}
    rates = {s: -float(np.linalg.eigvals(wheel.fixed_frame_matrix(unit, s, model)).real.max()) for s in extremes}
    speed = min(rates, key=lambda s: rates[s])
    if not rates[speed] > 1e-3:
        raise ValueError(f"the starting unit is unstable or undamped at {speed:.6g} rad/s: it never settles")
    return _FORGET / rates[speed]


def median(time: FloatArray) -> float:
    return float(np.median(np.diff(time)))


def _runs(time: FloatArray, most: float) -> FloatArray:
    """First and last time of every run in which no interval is longer than ``most`` medians, shape (K, 2)."""
    cuts = np.flatnonzero(np.diff(time) > most * median(time))
    return np.stack([time[np.concatenate([[0], cuts + 1])], time[np.concatenate([cuts, [time.size - 1]])]], axis=1)


def _common(ones: FloatArray, others: FloatArray) -> FloatArray:
    """Where spans of two rows overlap, shape (K, 2)."""
    found = []
    i = j = 0
    while i < len(ones) and j < len(others):
        begin, end = max(ones[i, 0], others[j, 0]), min(ones[i, 1], others[j, 1])
        if begin < end:
            found.append((begin, end))
        if ones[i, 1] < others[j, 1]:
            i += 1
        else:
            j += 1
    return np.array(found).reshape(-1, 2)
