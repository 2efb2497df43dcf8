"""Parameters of a unit from a force that was measured at its axle: the frequency response first, then the time series.

The measured force is taken to be that of the unit a constant time ago, with a constant offset and a noise of any
spectrum that does not change. Speed, load and traction are taken to be exact. Parameters are positive and fitted by
their logarithms, so that an error is a ratio; each has a Gaussian prior there, around the starting unit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate, linalg, optimize, signal

from ..science import wheel
from ..science.spectra import Spectra, Transfer
from ..science.uncertainty import value_of, with_values
from ..science.unit import ROAD, ROTATING, TireWheelUnit
from .simulate import simulate

__all__ = ["AXES", "DEFAULT_FIT", "FITTED", "UNSEEN", "Identification", "Recording", "Seen", "identify"]

FloatArray = NDArray[np.float64]
Joined = Literal["smooth", "lines", "zero-order-hold"]

DEFAULT_FIT: Final = ("k_1", "zeta_1", "wheel_mass", "suspension_stiffness", "zeta_s")
FORE_AFT: Final = ("longitudinal_stiffness", "longitudinal_damping_ratio", "longitudinal_mass")
FITTED: Final = (*DEFAULT_FIT, "density", *FORE_AFT)
"""What can be fitted; ``k_1`` scales radial and tangential stiffness together, the rest are fields."""

_NOT_N_1: Final = "it has no part in n = 1, and nothing but n = 1 reaches the axle"
_ONLY_K_1: Final = "it reaches the axle only within k_1 = pi a b (k_z + k_theta); fit k_1"
_ONLY_MASS: Final = "it reaches the axle only within the ring's mass and k_1; fit density and k_1"
UNSEEN: Final[Mapping[str, str]] = {
    "bending_stiffness": _NOT_N_1,
    "membrane_stiffness": _NOT_N_1,
    "inflation_pressure": _NOT_N_1,
    "zeta_n": _NOT_N_1,
    "radial_stiffness": _ONLY_K_1,
    "tangential_stiffness": _ONLY_K_1,
    "radius": _ONLY_MASS,
    "width": _ONLY_MASS,
    "thickness": _ONLY_MASS,
    "contact_half_angle": "the whole load reaches n = 1, however long the patch is",
    **dict.fromkeys(ROAD, "it matters on the road alone, and what is fitted is the response to a load"),
    **dict.fromkeys(ROTATING, "it turns with the tire, and what is fitted is the response of the mean tire"),
    "sidewall_damping": "it is a choice, not a number; compare the noise that two fits leave",
}
"""Why the other fields cannot be fitted."""

AXES: Final = {"z": (1,), "xz": (0, 1)}  # columns of the force

_FINE = 1000.0  # [Hz], at least, of the steps in which the model runs
_GAP = 3.5  # sampling intervals without a sample end a stretch
_SLOWEST = 10.0  # [Hz] of the samples
_FORGET = 9.0  # e-foldings of the slowest motion until a stretch no longer remembers how it began; see _forgetting
_STEADY = 15.0  # [rad/s] that the speed may vary by in a spectrum's segment
_SEGMENT = 2.0  # [s] of a spectrum's segment, or a sixteenth of the recording
_FEW = 8  # segments; of fewer nothing is known about coherence
_COHERENT = 0.5  # somewhere, lest there be nothing to fit
_LEAKAGE = 0.05  # of H1: what windows and a speed that is not quite steady do, which no coherence shows
_EARLIEST, _LATEST = -0.1, 0.3  # [s]: delays that are looked for
_NEARBY = 0.02  # [s]: how far the time series may move the delay
_FACTOR = 30.0  # by which a parameter may leave the starting unit's
_WIDTH = 0.5  # of a prior
_TOP_ZETA = 0.99
_DIFFERENCE = 1e-6  # of the logarithm, for derivatives
_ORDERS = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32)  # of the noise's autoregression
_CALLS = (6, 10, 25, 25, 25)  # of the model by turns of fit and noise: the first are for the noise's sake


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
        Of the measurement [s]: it shows what the axle did so long before.
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
    samples, stretches : int
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
    axes: tuple[int, ...]
    offset: FloatArray
    offset_error: FloatArray
    noise: FloatArray
    explained: FloatArray
    orders: tuple[int, ...]
    unexplained: float
    seconds: float
    samples: int
    stretches: int
    seen: tuple[Seen, ...]

    @property
    def priors(self) -> tuple[str, ...]:
        """Parameters of which the data say less than the prior."""
        known = zip(self.names, self.from_data, self.prior_width, strict=True)
        return tuple(name for name, own, width in known if own > width)


def identify(
    recording: Recording,
    start: TireWheelUnit,
    fit: Sequence[str] = DEFAULT_FIT,
    *,
    axes: Literal["z", "xz"] = "z",
    joined: Joined = "smooth",
    prior_width: float | Mapping[str, float] = 0.5,
    model: wheel.Model = "inextensional",
) -> Identification:
    """Fit parameters of a unit to a force that was measured at its axle.

    Parameters
    ----------
    recording : Recording
    start : TireWheelUnit
        Where the fit begins, the middle of the priors, and the fields that are not fitted.
    fit : sequence of str
        Of ``FITTED``.
    axes : {"z", "xz"}
        What was measured: the force on the suspension, or force.x as well.
    joined : {"smooth", "lines", "zero-order-hold"}
        What the load was between its samples: a cubic spline, for a quantity that was sampled faster than it changes;
        straight lines, as :func:`.simulate` has them; or a zero-order hold, as the live estimator takes it.
    prior_width : float or mapping of str to float
        Standard deviation of the prior of each parameter's logarithm, of all or by their names; 0.5 of those that a
        mapping leaves out.
    model : {"inextensional", "complete"}

    Returns
    -------
    Identification

    Raises
    ------
    ValueError
        A name cannot be fitted, an option is out of bounds, the starting unit forgets nothing, or the recording has too
        little in common; the message says which.

    Notes
    -----
    1. Where the speed varies by less than 15 rad/s over 2 s, H1 from load to F' by Welch's method, for each speed; the
       traction's part is subtracted as the starting unit has it. Least squares on H(f) exp(-2 pi i f delay) -
       H1(f), over the standard deviation |H1| sqrt((1 - coherence)/(2 coherence segments)) of H1, give a first
       estimate, for several delays.
    2. Least squares on the force through :func:`.simulate`, at the times of measurement less the delay. The noise is
       whitened: an autoregression, of an order by Akaike's criterion, is fitted to what the model leaves, stretch by
       stretch, and its prediction errors are what is squared (generalised least squares). Fit and noise take turns
       until the estimates rest. After a gap the model begins in the steady state; what is measured before it has
       forgotten that is left out.

    The errors are those of (J^T J + 1/prior_width^2)^-1, J the whitened derivatives over the noise's standard
    deviation. They are right if the model is: what a wrong model or a wrong fixed field does is not in them.
    """
    _check(start, fit, axes, prior_width)
    problem = _Problem(recording, start, tuple(fit), AXES[axes], joined, _widths(fit, prior_width), model)
    seen, first, delay = _from_spectra(problem)
    return _from_time_series(problem, seen, first, delay)


def _widths(fit: Sequence[str], prior_width: float | Mapping[str, float]) -> FloatArray:
    if isinstance(prior_width, Mapping):
        return np.array([prior_width.get(name, _WIDTH) for name in fit], np.float64)
    return np.full(len(fit), prior_width, np.float64)


def _check(start: TireWheelUnit, fit: Sequence[str], axes: str, prior_width: float | Mapping[str, float]) -> None:
    if not fit:
        raise ValueError("fit is empty; it must name at least one parameter")
    for name in fit:
        if name in UNSEEN:
            raise ValueError(f"{name} cannot be fitted: {UNSEEN[name]}")
        if name not in FITTED:
            raise ValueError(f"{name[:100]!r} is no parameter that can be fitted; those are {', '.join(FITTED)}")
        if name in FORE_AFT and start.is_longitudinally_rigid:
            raise ValueError(
                f"{name} cannot be fitted: the starting unit's longitudinal_stiffness is 0, which holds it"
            )
        if name in FORE_AFT and axes == "z":
            raise ValueError(f"{name} cannot be fitted without force.x")
        if not value_of(start, name) > 0.0:
            raise ValueError(f"{name} is 0 in the starting unit; to be fitted it must be > 0")
        if name.startswith(("zeta", "longitudinal_damping")) and not value_of(start, name) < _TOP_ZETA:
            raise ValueError(f"{name} is {value_of(start, name)} in the starting unit; to be fitted it must be < 0.99")
    if len(set(fit)) < len(fit):
        raise ValueError(f"fit is {', '.join(fit)}; no parameter may stand twice")
    if axes not in AXES:
        raise ValueError(f"axes is {axes!r}; it must be one of {', '.join(AXES)}")
    for width in _widths(fit, prior_width).tolist():
        if not 1e-3 <= width <= 10.0:
            raise ValueError(f"prior_width is {width!r}; it must be from 0.001 to 10")


# -- stretches ----------------------------------------------------------------------------------------------------


class _Stretch(NamedTuple):
    """Inputs over a time without gaps, at the times at which the model is computed; those ``kept`` are wanted."""

    time: FloatArray
    speed: FloatArray
    load: FloatArray
    traction: FloatArray
    kept: slice | NDArray[np.bool_]


class _Problem:
    """A recording in stretches, and the unit at parameters x = ln(value)."""

    def __init__(
        self,
        recording: Recording,
        start: TireWheelUnit,
        names: tuple[str, ...],
        axes: tuple[int, ...],
        joined: Joined,
        prior_width: FloatArray,
        model: wheel.Model,
    ) -> None:
        self.recording, self.start, self.names, self.axes = recording, start, names, axes
        self.joined, self.prior_width, self.model = joined, prior_width, model
        self.origin = np.log([value_of(start, name) for name in names])
        reach = math.log(_FACTOR)
        tops = [math.log(_TOP_ZETA) if "zeta" in n or "damping_ratio" in n else math.inf for n in names]
        self.low, self.high = self.origin - reach, np.minimum(self.origin + reach, tops)
        self.interval = float(np.median(np.diff(recording.force_time)))
        for name, time in (("load", recording.load_time), ("force", recording.force_time)):
            rate = 1.0 / float(np.median(np.diff(time)))
            if not _SLOWEST <= rate:
                raise ValueError(f"the {name} has {rate:.3g} samples per second; it must have {_SLOWEST:g} at least")
        self.settling = _forgetting(start, recording.speed, model)
        spans = _common(
            _runs(recording.load_time, _GAP),
            _runs(recording.speed_time, max(_GAP, 0.3 / _median(recording.speed_time))),
        )
        if not len(spans):
            raise ValueError("speed and load are never there at the same time")
        longest = float((spans[:, 1] - spans[:, 0]).max())
        self.stretches = [self._stretch(a, b) for a, b in spans if b - a > self.settling + 0.2]
        if not self.stretches:
            raise ValueError(
                f"no stretch without a gap is longer than {longest:.3g} s; the starting unit takes "
                f"{self.settling:.3g} s to forget how it began"
            )

    def _stretch(self, begin: float, end: float) -> _Stretch:
        record = self.recording
        inside = slice(*np.searchsorted(record.load_time, [begin - 1e-9, end + 1e-9]))
        stamps = record.load_time[inside]
        inputs = np.column_stack([record.load[inside], record.traction[inside]])
        parts = max(1, math.ceil(_FINE * float(np.median(np.diff(record.load_time)))))
        kept: slice | NDArray[np.bool_] = slice(None)
        if self.joined == "smooth":
            step = (stamps[-1] - stamps[0]) / (parts * (stamps.size - 1))
            time = stamps[0] + step * np.arange(parts * (stamps.size - 1) + 1)
            curve = interpolate.CubicSpline(stamps, inputs)
            # The model joins its samples by lines: those which lie beside the curve such that they carry what it does.
            forces = curve(time) - step * step / 12.0 * curve(time, 2)
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
        return _Stretch(time, speed, forces[:, 0], forces[:, 1], kept)

    def unit(self, x: FloatArray) -> TireWheelUnit:
        """The unit at parameters."""
        return with_values(self.start, dict(zip(self.names, np.exp(x).tolist(), strict=True)))

    def forces(self, unit: TireWheelUnit, stretch: _Stretch) -> FloatArray:
        """The unit's axle forces (K, 2) at the kept times; not finite where it is so unstable that they overflow."""
        with np.errstate(over="ignore", invalid="ignore"):
            time = stretch.time - stretch.time[0]  # a regular grid's rounding is then no more than its own
            seen = simulate(unit, time, stretch.speed, stretch.load, stretch.traction, model=self.model, n_max=2)
            return seen.axle_force[stretch.kept]


def _forgetting(unit: TireWheelUnit, speeds: FloatArray, model: wheel.Model) -> float:
    """After how long a stretch no longer shows how it began [s].

    Nine times the slowest motion's time: exp(-9), or exp(-6) for a damping that is a third less than that of the unit.
    """
    extremes = {float(speeds.min()), float(speeds.max()), 0.5 * float(speeds.min() + speeds.max())}
    rates = {s: -float(np.linalg.eigvals(wheel.fixed_frame_matrix(unit, s, model)).real.max()) for s in extremes}
    speed = min(rates, key=lambda s: rates[s])
    if not rates[speed] > 1e-3:
        raise ValueError(f"the starting unit is unstable or undamped at {speed:.6g} rad/s: it never settles")
    return _FORGET / rates[speed]


def _median(time: FloatArray) -> float:
    return float(np.median(np.diff(time)))


def _runs(time: FloatArray, most: float) -> FloatArray:
    """First and last time of every run in which no interval is longer than ``most`` medians, shape (K, 2)."""
    cuts = np.flatnonzero(np.diff(time) > most * _median(time))
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


# -- the frequency response ---------------------------------------------------------------------------------------


def _from_spectra(problem: _Problem) -> tuple[tuple[Seen, ...], FloatArray, float]:
    """What was seen, and the estimates and the delay that go with it."""
    seen = _spectra(problem, 0.0)
    if not seen:
        longest = max(float(stretch.time[-1] - stretch.time[0]) for stretch in problem.stretches)
        raise ValueError(
            f"no stretch with speed, load and force is long enough for a spectrum; the longest with speed and load has "
            f"{longest:.3g} s, of which the starting unit takes {problem.settling:.3g} s to settle"
        )
    if not any((each.transfer.coherence > _COHERENT).any() for each in seen):
        raise ValueError(
            f"load and force are nowhere coherent (> {_COHERENT:g}): the load varies too little, or the force is not "
            "this wheel's"
        )
    x, delay = _fit_spectra(problem, seen, problem.origin, None)
    again = _spectra(problem, delay)  # without what the delay shifted out of each segment
    return (again, *_fit_spectra(problem, again, x, delay)) if again else (seen, x, delay)


def _spectra(problem: _Problem, delay: float) -> tuple[Seen, ...]:
    """H1 from load to F', by speed; its phase has the delay, but the segments are taken so much later."""
    record = problem.recording
    low, high = record.force_time[0], record.force_time[-1]
    total = sum(min(s.time[-1], high) - max(s.time[0], low) for s in problem.stretches)
    rate = 1.0 / _median(problem.stretches[0].time[problem.stretches[0].kept])
    seen: tuple[Seen, ...] = ()
    length = 2 ** round(math.log2(rate * min(_SEGMENT, max(total, 1.0) / 16.0)))
    while length >= 0.2 * rate:  # shorter, if gaps leave few of this length
        found = _of_length(problem, delay, rate, length)
        seen = found or seen
        if sum(each.transfer.segments for each in found) >= _FEW:
            break
        length //= 2
    return seen


def _of_length(problem: _Problem, delay: float, rate: float, length: int) -> tuple[Seen, ...]:
    record = problem.recording
    middle = float(np.mean(np.concatenate([stretch.speed for stretch in problem.stretches])))
    kinds: dict[int, tuple[Spectra, list[float]]] = {}
    relaxed: list[tuple[FloatArray, ...]] = []
    for stretch in problem.stretches:
        for window in _windows(problem, stretch, delay, rate, length):
            if np.ptp(window[1]) > _STEADY:
                relaxed.append(window)
            else:
                _add(kinds, middle, rate, length, *window)
    if not kinds:  # the speed was never steady: its mean must do, for a beginning
        for window in relaxed:
            _add(kinds, middle, rate, length, *window)
    seen = []
    for spectra, speeds in kinds.values():
        transfer = spectra.transfer()
        if transfer is not None:
            f, uu, yy, response, coherence, segments = transfer
            response = response * np.exp(-2j * math.pi * f * delay)
            some = f < 0.45 * min(1.0 / problem.interval, 1.0 / _median(record.load_time))
            transfer = Transfer(f[some], uu[some], yy[some], response[some], coherence[some], segments)
            seen.append(Seen(float(np.mean(speeds)), transfer))
    return tuple(sorted(seen, key=lambda each: -each.transfer.segments))


def _windows(
    problem: _Problem, stretch: _Stretch, delay: float, rate: float, length: int
) -> Iterator[tuple[FloatArray, ...]]:
    """Time, speed, load, and the force that was measured ``delay`` later, on a regular grid, half overlapping."""
    record = problem.recording
    count = math.floor((stretch.time[-1] - stretch.time[0]) * rate) + 1
    time = stretch.time[0] + np.arange(count) / rate
    place = np.searchsorted(record.force_time, time + delay)
    inner = (place > 0) & (place < record.force_time.size)
    gap = record.force_time[np.clip(place, 1, record.force_time.size - 1)]
    gap = gap - record.force_time[np.clip(place, 1, record.force_time.size - 1) - 1]
    missing = np.concatenate([[0], np.cumsum(~inner | (gap > _GAP * problem.interval))])
    settled = math.ceil(problem.settling * rate)
    if not (missing[length:] == missing[:-length]).any():
        return
    load, speed = (np.interp(time, stretch.time, column) for column in (stretch.load, stretch.speed))
    nearby = slice(*np.searchsorted(record.force_time, time[[0, -1]] + delay + [-1.0, 1.0]))
    force = interpolate.CubicSpline(record.force_time[nearby], record.force[nearby, 1])(time + delay)
    if stretch.traction.any():
        alone = stretch._replace(load=np.zeros_like(stretch.load))
        force = force - np.interp(time, stretch.time[stretch.kept], problem.forces(problem.start, alone)[:, 1])
    for first in range(settled if count > settled + length else 0, count - length + 1, length // 2):
        if missing[first + length] == missing[first]:
            part = slice(first, first + length)
            yield time[part], speed[part], load[part], force[part]


def _add(
    kinds: dict[int, tuple[Spectra, list[float]]], middle: float, rate: float, length: int, *window: FloatArray
) -> None:
    time, speed, load, force = window
    key = round((float(speed.mean()) - middle) / _STEADY)
    spectra, speeds = kinds.setdefault(key, (Spectra(rate, length, held=False), []))
    spectra.add(time, load, force)
    speeds.append(float(speed.mean()))


def _fit_spectra(
    problem: _Problem, seen: tuple[Seen, ...], x: FloatArray, delay: float | None
) -> tuple[FloatArray, float]:
    """Estimates and delay, from those given on; without a delay, from wherever the starting unit finds some."""
    frequency = np.concatenate([each.transfer.frequency for each in seen])
    response = np.concatenate([each.transfer.response for each in seen])
    coherence = np.concatenate([each.transfer.coherence for each in seen])
    segments = np.repeat([each.transfer.segments for each in seen], [each.transfer.frequency.size for each in seen])
    by_chance = 1.0 - 0.01 ** (1.0 / np.maximum(segments - 1, 1e-9))  # 99 % of noises are less coherent
    used = np.isfinite(response) & (coherence > by_chance)
    if not used.any():
        return x, delay or 0.0
    share = coherence[used]
    relative = np.sqrt(np.maximum(1.0 - share, 0.0) / (2.0 * share * segments[used]) + _LEAKAGE**2)
    weight = 1.0 / (np.abs(response[used]) * relative)

    def modelled(x: FloatArray) -> NDArray[np.complex128]:
        unit = problem.unit(x)
        parts = [
            wheel.frequency_response(unit, each.speed, each.transfer.frequency, problem.model)[:, 1, 0] for each in seen
        ]
        whole: NDArray[np.complex128] = np.concatenate(parts)[used]
        return whole

    def late(delay: float | FloatArray) -> NDArray[np.complex128]:
        turned: NDArray[np.complex128] = np.exp(-2j * math.pi * frequency[used] * delay)
        return turned

    def residual(z: FloatArray) -> FloatArray:
        prior = (z[:-1] - problem.origin) / problem.prior_width
        try:
            misfit = weight * (modelled(z[:-1]) * late(1e-3 * z[-1]) - response[used])
        except ValueError:  # no response: a trial beyond what is sound
            return np.full(2 * weight.size + prior.size, math.inf)
        return np.concatenate([misfit.real, misfit.imag, prior])

    delays = np.arange(_EARLIEST, _LATEST, 5e-4) if delay is None else np.array([delay])
    H = modelled(x)
    costs = np.array([float(np.sum(np.abs(weight * (H * late(d) - response[used])) ** 2)) for d in delays])
    valleys = signal.argrelmin(costs, order=4, mode="clip")[0]
    best = valleys[np.argsort(costs[valleys])][:3] if valleys.size else np.array([int(costs.argmin())])
    guesses = (delays[best, None] + ([0.0] if delay is not None else [-0.004, 0.0, 0.004])).ravel()
    near = 3.0 * problem.prior_width
    low = np.append(np.maximum(problem.low, problem.origin - near), 1e3 * (_EARLIEST - 0.02))
    high = np.append(np.minimum(problem.high, problem.origin + near), 1e3 * (_LATEST + 0.02))

    def fitted(z: FloatArray, calls: int) -> Any:
        z = np.clip(z, low + 1e-9, high - 1e-9)
        options: dict[str, Any] = {"bounds": (low, high), "x_scale": "jac", "loss": "soft_l1"}
        return optimize.least_squares(residual, z, ftol=1e-4, max_nfev=calls, **options)

    tried = [fitted(np.append(x, 1e3 * guess), 12) for guess in guesses]
    found = fitted(min(tried, key=lambda each: float(each.cost)).x, 30).x
    return found[:-1], 1e-3 * float(found[-1])


# -- the time series ----------------------------------------------------------------------------------------------


class _Noise(NamedTuple):
    """An autoregression e_k = sum_j a_j e_(k-j) + white of this deviation."""

    coefficients: FloatArray
    deviation: float


class _Coordinates:
    """Logarithms x of the values as functions of q, in which the valley of equal fits is straighter.

    Where they are fitted, q has k_s/(M + m), the wheel's hop, for k_s, and k_1 (1/M + 1/m), of ring against wheel, for
    k_1: the data know these far better than the masses.
    """

    def __init__(self, problem: _Problem) -> None:
        self._names, self._start = problem.names, problem.start

    def _shifts(self, x: FloatArray) -> tuple[FloatArray, float]:
        """x less q, and M/(M + m)."""
        fitted = dict(zip(self._names, x.tolist(), strict=True))
        M = math.exp(fitted["wheel_mass"]) if "wheel_mass" in fitted else self._start.wheel_mass
        m = self._start.ring_mass
        if "density" in fitted:
            m *= math.exp(fitted["density"]) / self._start.density
        shifts = {"suspension_stiffness": math.log(M + m), "k_1": -math.log(1.0 / M + 1.0 / m)}
        return np.array([shifts.get(name, 0.0) for name in self._names]), M / (M + m)

    def of(self, x: FloatArray) -> FloatArray:
        """q at x."""
        return x - self._shifts(x)[0]

    def logs(self, q: FloatArray) -> FloatArray:
        """x at q; the masses, which the shifts hang on, are the same in both."""
        return q + self._shifts(q)[0]

    def slope(self, x: FloatArray) -> FloatArray:
        """dx/dq, (P, P)."""
        T = np.eye(x.size)
        share = self._shifts(x)[1]
        parts = {("suspension_stiffness", "wheel_mass"): share, ("suspension_stiffness", "density"): 1.0 - share}
        parts |= {("k_1", "wheel_mass"): 1.0 - share, ("k_1", "density"): share}
        for i, one in enumerate(self._names):
            for j, other in enumerate(self._names):
                T[i, j] += parts.get((one, other), 0.0)
        return T


class _Series:
    """The measured samples that are used, and what the model says of them."""

    def __init__(self, problem: _Problem, delay: float) -> None:
        self.problem = problem
        self.coordinates = _Coordinates(problem)
        record = problem.recording
        self.parts: list[slice] = []  # of the record, one for each stretch
        self.stretches: list[_Stretch] = []
        for stretch in problem.stretches:
            first = stretch.time[0] + problem.settling + delay + _NEARBY
            part = slice(*np.searchsorted(record.force_time, [first, stretch.time[-1] + delay - _NEARBY]).tolist())
            if part.stop - part.start > 1:
                self.parts.append(part)
                self.stretches.append(stretch)
        if not self.parts:
            raise ValueError("no measured force lies where speed, load and a settled motion are known")
        self.time = np.concatenate([record.force_time[part] for part in self.parts])
        self.force = np.concatenate([record.force[part] for part in self.parts])[:, list(problem.axes)]
        cuts = np.flatnonzero(np.diff(self.time) > 1.5 * problem.interval) + 1
        ends = np.cumsum([part.stop - part.start for part in self.parts])[:-1]
        edges = np.unique(np.concatenate([[0], cuts, ends, [self.time.size]]))
        self.runs = [slice(a, b) for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)]
        self._known: tuple[bytes, list[FloatArray]] = (b"", [])
        self._known_jacobian = (b"", np.empty(0))

    def curves(self, x: FloatArray) -> list[FloatArray]:
        """Axle forces (K, A) at the kept times of each stretch; the last are remembered."""
        if self._known[0] != x.tobytes():
            unit = self.problem.unit(x)
            found = [self.problem.forces(unit, each)[:, list(self.problem.axes)] for each in self.stretches]
            self._known = (x.tobytes(), found)
        return self._known[1]

    def at(self, curves: Sequence[FloatArray], delay: float, derivative: int = 0) -> FloatArray:
        """Curves, or their derivatives to time, at the times of the measurement less the delay, shape (N, A)."""
        record = self.problem.recording
        values: list[FloatArray] = []
        for part, stretch, curve in zip(self.parts, self.stretches, curves, strict=True):
            if not np.isfinite(curve).all():
                return np.full_like(self.force, math.nan)
            spline = interpolate.CubicSpline(stretch.time[stretch.kept], curve)
            values.append(spline(record.force_time[part] - delay, derivative))
        whole: FloatArray = np.concatenate(values)
        return whole

    def residual(self, z: FloatArray) -> FloatArray:
        """Model less measurement (N, A); z is q of :class:`_Coordinates`, the delay [ms] and the offsets [N]."""
        P = len(self.problem.names)
        offset: FloatArray = z[P + 1 :] - self.force
        return self.at(self.curves(self.coordinates.logs(z[:P])), 1e-3 * float(z[P])) + offset

    def jacobian(self, z: FloatArray) -> FloatArray:
        """Derivatives of the residual, (N, A, P + 1 + A); the last are remembered."""
        if self._known_jacobian[0] != z.tobytes():
            self._known_jacobian = (z.tobytes(), self._jacobian(z))
        return self._known_jacobian[1]

    def _jacobian(self, z: FloatArray) -> FloatArray:
        P, A = len(self.problem.names), self.force.shape[1]
        q, delay = z[:P], 1e-3 * float(z[P])
        x = self.coordinates.logs(q)
        base = self.curves(x)
        J = np.zeros((*self.force.shape, z.size))
        for k in range(P):
            step = _DIFFERENCE if x[k] + _DIFFERENCE < self.problem.high[k] else -_DIFFERENCE
            unit = self.problem.unit(self.coordinates.logs(q + step * (np.arange(P) == k)))
            moved = [self.problem.forces(unit, each)[:, list(self.problem.axes)] for each in self.stretches]
            J[..., k] = self.at([(one - other) / step for one, other in zip(moved, base, strict=True)], delay)
        J[..., P] = -1e-3 * self.at(base, delay, 1)
        J[:, np.arange(A), P + 1 + np.arange(A)] = 1.0
        return J

    def prior_slope(self, z: FloatArray) -> FloatArray:
        """Derivatives of the priors' residuals (x - origin)/width, (P, P + 1 + A)."""
        P = len(self.problem.names)
        slope = self.coordinates.slope(self.coordinates.logs(z[:P])) / self.problem.prior_width[:, None]
        return np.concatenate([slope, np.zeros((P, z.size - P))], axis=1)

    def noise(self, residual: FloatArray) -> list[_Noise]:
        """The autoregression of each column of a residual, its order by Akaike's criterion."""
        return [_autoregression(column, self.runs) for column in residual.T]

    def whitened(self, values: FloatArray, noise: Sequence[_Noise]) -> FloatArray:
        """Values (N, A, ...) as prediction errors over their deviation, one column after the other, (M, ...)."""
        rows = []
        for column, (coefficients, deviation) in enumerate(noise):
            p = coefficients.size
            taps = np.concatenate([[1.0], -coefficients]) / deviation
            for run in self.runs:
                if run.stop - run.start > p:
                    rows.append(signal.lfilter(taps, [1.0], values[run, column], axis=0)[p:])
        whole: FloatArray = np.concatenate(rows)
        return whole


def _autoregression(residual: FloatArray, runs: Sequence[slice]) -> _Noise:
    """By the Yule-Walker equations, of runs with nothing known in between."""
    longest = max(run.stop - run.start for run in runs)
    orders = [p for p in _ORDERS if p == 0 or p < min(longest, residual.size / 20)]
    correlation = np.zeros(orders[-1] + 1)
    for run in runs:
        part = residual[run]
        size = min(correlation.size, part.size)
        correlation[:size] += [float(part[: part.size - k] @ part[k:]) for k in range(size)]
    correlation /= residual.size
    least = max(correlation[0], 1e-300) * 1e-12
    best, lowest = _Noise(np.empty(0), math.sqrt(max(correlation[0], 1e-300))), math.inf
    for p in orders:
        a = linalg.solve_toeplitz(correlation[:p], correlation[1 : p + 1]) if p else np.empty(0)
        variance = max(float(correlation[0] - a @ correlation[1 : p + 1]), least)
        criterion = residual.size * math.log(variance) + 2.0 * p
        if criterion < lowest:
            best, lowest = _Noise(a, math.sqrt(variance)), criterion
    return best


def _from_time_series(problem: _Problem, seen: tuple[Seen, ...], first: FloatArray, delay: float) -> Identification:
    series = _Series(problem, delay)
    P, A = len(problem.names), series.force.shape[1]
    if series.time.size < 20 * (P + 1 + A):
        raise ValueError(f"{series.time.size} samples of the measured force are left; {20 * (P + 1 + A)} are needed")
    if not np.isfinite(series.curves(first)[0]).all():
        first = problem.origin
    first = np.clip(first, problem.low + 1e-9, problem.high - 1e-9)
    z = np.concatenate([series.coordinates.of(first), [1e3 * delay], np.zeros(A)])
    z[P + 1 :] = -series.residual(z).mean(axis=0)
    residual = series.residual(z)
    for calls in _CALLS:
        noise = series.noise(residual)
        z, J, moved = _solve(series, noise, z, delay, calls)
        residual = series.residual(z)
        if moved < 0.3:
            break
    x = series.coordinates.logs(z[:P])
    white = series.whitened(residual, noise)
    spare = max(white.size - z.size, 1)
    information = J.T @ J * (spare / float(white @ white))  # what the noise turned out to be
    prior = series.prior_slope(z)
    to_logs = linalg.block_diag(series.coordinates.slope(x), np.eye(1 + A))
    covariance, own = (to_logs @ _inverse(information + share * prior.T @ prior) @ to_logs.T for share in (1.0, 1e-4))
    errors = np.sqrt(np.diag(covariance))
    at = [name for k, name in enumerate(problem.names) if min(x[k] - problem.low[k], problem.high[k] - x[k]) < 1e-3]
    power = np.var(series.force, axis=0)
    left = np.var(residual, axis=0)
    return Identification(
        unit=problem.unit(x),
        start=problem.start,
        names=problem.names,
        values=np.exp(x),
        errors=errors[:P],
        correlation=covariance[:P, :P] / np.outer(errors[:P], errors[:P]),
        from_data=np.sqrt(np.diag(own))[:P],
        at_bound=tuple(at),
        prior_width=problem.prior_width,
        delay=1e-3 * float(z[P]),
        delay_error=1e-3 * float(errors[P]),
        axes=problem.axes,
        offset=z[P + 1 :],
        offset_error=errors[P + 1 :],
        noise=np.sqrt(left),
        explained=1.0 - np.divide(left, power, out=np.ones_like(left), where=power > 0.0),
        orders=tuple(each.coefficients.size for each in noise),
        unexplained=_unexplained(series, residual[:, -1], 1e-3 * float(z[P])),
        seconds=series.time.size * problem.interval,
        samples=series.time.size,
        stretches=len(series.stretches),
        seen=seen,
    )


def _inverse(information: FloatArray) -> FloatArray:
    """Of a symmetric matrix whose rows have units of their own."""
    size = 1.0 / np.sqrt(np.diag(information))
    inverse: FloatArray = np.linalg.inv(information * np.outer(size, size)) * np.outer(size, size)
    return inverse


def _solve(
    series: _Series, noise: Sequence[_Noise], z: FloatArray, delay: float, calls: int
) -> tuple[FloatArray, FloatArray, float]:
    """Least squares with this noise: z, whitened Jacobian, and how far z moved, in standard errors.

    Solved in coordinates in which the first Jacobian is 0.01: parameters that the data hardly tell apart then cost no
    more steps than others.
    """
    problem, P = series.problem, len(series.problem.names)
    whole = P + series.whitened(series.force, noise).shape[0]

    def whitened(z: FloatArray) -> FloatArray:
        return np.concatenate([series.whitened(series.jacobian(z), noise), series.prior_slope(z)])

    triangle = np.linalg.qr(whitened(z), mode="r")
    across = 100.0 * linalg.solve_triangular(triangle, np.eye(z.size))

    def residual(w: FloatArray) -> FloatArray:
        at = z + across @ w
        with np.errstate(over="ignore"):
            x = series.coordinates.logs(at[:P]) if np.abs(at[:P]).max() < 600.0 else np.full(P, math.inf)
        inside = ((x >= problem.low) & (x <= problem.high)).all() and abs(1e-3 * at[P] - delay) < 0.9 * _NEARBY
        if not inside:
            return np.full(whole, math.inf)  # a shorter step is tried
        return np.concatenate([series.whitened(series.residual(at), noise), (x - problem.origin) / problem.prior_width])

    solver: Callable[..., optimize.OptimizeResult] = optimize.least_squares
    found = solver(
        residual,
        np.zeros(z.size),
        jac=lambda w: whitened(z + across @ w) @ across,
        ftol=1e-7,
        xtol=1e-6,
        max_nfev=calls,
    )
    at = z + across @ found.x
    return at, whitened(at)[:-P], float(np.linalg.norm(triangle @ (at - z)))


def _unexplained(series: _Series, residual: FloatArray, delay: float) -> float:
    """Share of the residual's power that is coherent with the load, less what chance gives."""
    load = np.concatenate(
        [
            np.interp(series.problem.recording.force_time[part] - delay, each.time, each.load)
            for part, each in zip(series.parts, series.stretches, strict=True)
        ]
    )
    longest = max(run.stop - run.start for run in series.runs)
    length = 2 ** int(math.log2(max(min(1.0 / series.problem.interval, longest, residual.size / 6.0), 8.0)))
    spectra = Spectra(1.0 / series.problem.interval, length, held=False)
    for run in series.runs:
        spectra.add(series.time[run], load[run], residual[run])
    transfer = spectra.transfer()
    if transfer is None or transfer.segments < 8:
        return 0.0
    by_chance = 1.2 / transfer.segments  # segments that overlap by half are not quite independent
    share = np.sum(transfer.output * (transfer.coherence - by_chance)) / max(float(np.sum(transfer.output)), 1e-300)
    return float(np.clip(share, 0.0, 1.0))
