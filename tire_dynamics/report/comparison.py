"""A measured force and a model's on one grid, and what is seen of them by frequency and by order of the wheel."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..files.errors import InputError
from ..science.comparison import (
    BLOCKS,
    FEWEST,
    Band,
    GainDelay,
    Lines,
    Sums,
    compare_bands,
    compare_lines,
    cross_spectra,
    gain_and_delay,
    lag_of,
)
from ..science.interpolation import smooth_curve
from .wrenches import Series, Wrench

__all__ = ["COHERENT", "Axis", "Comparison", "OrderLine", "compare"]

FloatArray = NDArray[np.float64]
Pairs = list[tuple[FloatArray, FloatArray]]

GAP = 3.5  # sampling intervals without a sample end a section
REGULAR = 0.02  # of an interval: how far stamps may be from a straight line to be taken for it
SAME = 0.45  # of the rate: what is compared of two that are sampled alike
OTHER = 0.3  # of the slower rate, between whose samples there is a curve: it keeps 1 - 1e-3 of the gain up to there
SEGMENT = 2.0  # [s], or a sixteenth of what there is
TURNS = 8  # of the wheel in a segment by order
ORDERS: Final = 10  # reported one by one
HIGHEST_ORDER = 60.0  # that is drawn
ROLLING = 1.0  # [rad/s]: a slower wheel stands
EPOCH = 10**17  # [ns]: 1973; times before it are from the beginning of something
COHERENT = 0.5  # the least coherence that is said to be one
SHOWN = 1.5  # [s] around the highest force
NAMES = ("x", "z")


class OrderLine(NamedTuple):
    """One order of the wheel: its line, and the root mean square of model and measurement within a line either way."""

    order: int
    line: int
    model: float
    measured: float


@dataclass
class Axis:
    """What was found along one axis, "x" or "z".

    Attributes
    ----------
    whole : GainDelay
        Over the band; the delay is that of the measurement after the model, on the clocks as they are.
    lines : Lines
        By frequency, its phase without the delay.
    orders : Lines or None
        By order of the wheel, the delay being taken out; None where no speed is known or the wheel turned too little.
    by_order : list of OrderLine
    bands : list of Band
    offset : tuple of float
        Mean of measurement less model, its standard error [N].
    explained : float
        Share of the measured power in the band that follows the model, by whatever filter.
    peak : dict
        Time and both forces around the highest measured force, as they are.
    """

    name: str
    whole: GainDelay
    lines: Lines
    orders: Lines | None
    by_order: list[OrderLine]
    bands: list[Band]
    offset: tuple[float, float]
    explained: float
    peak: dict[str, FloatArray]


@dataclass
class Comparison:
    """A measured wrench beside a model's."""

    measured: str
    model: str
    seconds: float
    sections: int
    rate: float
    segments: int
    segment: float
    band: tuple[float, float]
    axes: list[Axis]
    speed: float | None
    turns: float
    notes: list[str] = field(default_factory=list)


class _Grid(NamedTuple):
    """Both forces at the same times, section by section; column 0 is the model's."""

    rate: float
    begin: list[float]
    forces: list[tuple[FloatArray, FloatArray]]  # model (K, 2), measured (K, 2)
    ahead: float  # [s]: so much after the model's is each measured sample that stands beside it
    highest: float  # [Hz]


def compare(
    measured: Wrench,
    model: Wrench,
    *,
    axes: str = "xz",
    shift: float = 0.0,
    align: bool = False,
    scale: float = 1.0,
    most_delay: float = 0.5,
    segment: float | None = None,
    low: float | None = None,
    high: float | None = None,
) -> Comparison:
    """Hold a measured force against a model's.

    Parameters
    ----------
    measured, model : Wrench
        One of them may have the wheel's speed.
    axes : {"z", "x", "xz"}
    shift : float
        Added to the times of the measurement [s].
    align : bool
        Take both to begin together, whatever their clocks say.
    scale : float
        By which the measured force is multiplied.
    most_delay : float
        How far a delay is looked for, either way [s].
    segment : float, optional
        Length of the spectra's segments [s].
    low, high : float, optional
        Edges of the band in which one gain and one delay are fitted [Hz]; else all that is seen.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        They have too little time in common, or one of them does not vary.
    """
    notes = [*measured.notes, *model.notes]
    later = _later(measured.force, model.force, shift, align, notes)
    grid = _on_one_grid(measured.force, model.force, later, scale)
    kept = [k for k in (1, 0) if NAMES[k] in axes]
    missing = [k for k in kept if not all(np.isfinite(each[:, k]).all() for pair in grid.forces for each in pair)]
    if missing and len(missing) == len(kept):
        raise InputError(f"--axes is {axes}; no such force is in both files")
    still = [k for k in kept if k not in missing and not _varies(grid, k)]
    for k in missing:
        notes.append(f"force.{NAMES[k]} is not in both files, and left out")
    for k in still:
        notes.append(f"force.{NAMES[k]} does not vary in both files, and is left out")
    kept = [k for k in kept if k not in missing and k not in still]
    if not kept:
        raise InputError("one of the two forces does not vary; nothing can be compared")
    seconds = sum(len(x) for x, _ in grid.forces) / grid.rate
    wanted = min(SEGMENT, seconds / 16.0) if segment is None else segment
    length = 2 ** max(4, round(math.log2(max(wanted * grid.rate, 1.0))))
    # The axis with the larger force says what the lag is; both are of one sensor.
    lead = max(kept, key=lambda k: sum(float(np.var(y[:, k])) * len(y) for _, y in grid.forces))
    lag = lag_of([(x[:, lead], y[:, lead]) for x, y in grid.forces], round(most_delay * grid.rate))
    reach = min(0.5 * length / grid.rate, 0.05)
    for _ in range(2):  # the second time from the nearest sample: a window that is off takes from gain and coherence
        pairs = [_shifted(x, y, lag) for x, y in grid.forces]
        sums = {k: cross_spectra([(x[:, k], y[:, k]) for x, y in pairs], grid.rate, length, BLOCKS) for k in kept}
        first = sums[lead]
        if first is None or first.segments.sum() < FEWEST:
            count = 0 if first is None else int(first.segments.sum())
            raise InputError(
                f"{seconds:.3g} s in common make {count} segments of {length / grid.rate:.3g} s; at least {FEWEST} are "
                "needed: a longer recording, or a shorter --segment"
            )
        band = (low if low is not None else float(first.frequency[0]), min(high or math.inf, grid.highest))
        if not band[0] < band[1]:
            raise InputError(f"--low is {band[0]:g} and --high {band[1]:g}; at most {grid.highest:.4g} Hz can be seen")
        more = round(_fitted(NAMES[lead], first, band, reach).delay * grid.rate)
        if not more:
            break
        lag += more
    segments = 0 if first is None else int(first.segments.sum())
    taken = lag / grid.rate + grid.ahead  # by which the pairs' measurement is taken earlier
    speed = model.speed or measured.speed
    angle = None
    if speed is None:
        notes.append("no speed of the wheel is in either file: nothing is said by order of the wheel")
    else:
        own = model if model.speed is not None else measured
        behind = (speed.origin_ns - own.force.origin_ns) * 1e-9 + (later if own is measured else 0.0)
        angle = _angles(grid, Series(0, speed.time + behind, speed.values), lag)
    found = []
    for k in kept:
        each = sums[k]
        assert each is not None
        found.append(_axis(NAMES[k], k, each, grid, pairs, angle, taken, band, reach))
    turns = 0.0 if angle is None else sum(abs(float(a[-1] - a[0])) for a in angle if a.size) / (2.0 * math.pi)
    if angle is not None and found[0].orders is None:
        notes.append(f"the wheel turned {turns:.3g} times while both forces were there: too little to tell orders")
    return Comparison(
        measured.name,
        model.name,
        seconds,
        len(grid.forces),
        grid.rate,
        segments,
        length / grid.rate,
        band,
        found,
        None if speed is None else float(np.mean(np.abs(speed.values))),
        turns,
        notes,
    )


# -- one grid -----------------------------------------------------------------------------------------------------


def _later(measured: Series, model: Series, shift: float, align: bool, notes: list[str]) -> float:
    """By how much the measurement's origin is after the model's [s]."""
    if not align and (measured.origin_ns > EPOCH) == (model.origin_ns > EPOCH):
        return (measured.origin_ns - model.origin_ns) * 1e-9 + shift
    if not align:
        notes.append(
            "only one of the two files has times since 1970: both are taken to begin together, but for --shift"
        )
    return float(model.time[0] - measured.time[0]) + shift


def _varies(grid: _Grid, k: int) -> bool:
    return all(any(np.ptp(pair[side][:, k]) > 0.0 for pair in grid.forces) for side in (0, 1))


def _runs(time: FloatArray) -> list[tuple[float, float]]:
    """First and last time of each section without a gap."""
    steps = np.diff(time)
    cuts = np.flatnonzero(steps > GAP * float(np.median(steps)))
    firsts, lasts = np.concatenate([[0], cuts + 1]), np.concatenate([cuts, [time.size - 1]])
    return list(zip(time[firsts].tolist(), time[lasts].tolist(), strict=True))


def _common(ones: list[tuple[float, float]], others: list[tuple[float, float]]) -> list[tuple[float, float]]:
    found, i, j = [], 0, 0
    while i < len(ones) and j < len(others):
        begin, end = max(ones[i][0], others[j][0]), min(ones[i][1], others[j][1])
        if begin < end:
            found.append((begin, end))
        if ones[i][1] < others[j][1]:
            i += 1
        else:
            j += 1
    return found


def _regular(time: FloatArray, spans: list[tuple[float, float]], step: float) -> bool:
    """Whether the samples stand evenly in every span, none missing."""
    for begin, end in spans:
        part = time[slice(*np.searchsorted(time, [begin - 1e-9, end + 1e-9]))]
        if part.size < 2 or np.abs(part - (part[0] + step * np.arange(part.size))).max() > REGULAR * step:
            return False
    return True


def _on_one_grid(measured: Series, model: Series, later: float, scale: float) -> _Grid:
    at, other = measured.time + later, model.time
    spans = [each for each in _common(_runs(at), _runs(other)) if each[1] - each[0] > 0.1]
    if not spans:
        raise InputError(
            f"the measurement is there from {at[0]:.6g} to {at[-1]:.6g} s and the model from {other[0]:.6g} to "
            f"{other[-1]:.6g} s: never together for a tenth of a second; look at the stamps, or give --shift or --align"
        )
    steps = [float(np.median(np.diff(each))) for each in (other, at)]
    steps = [_mean_step(each, spans, step) for each, step in zip((other, at), steps, strict=True)]
    same = abs(steps[0] - steps[1]) < 1e-3 * steps[0]
    even = [_regular(each, spans, step) for each, step in zip((other, at), steps, strict=True)]
    values = model.values, scale * measured.values
    if same and all(even):
        pieces, distances = [], []
        for begin, end in spans:
            rows = [np.searchsorted(each, [begin - 1e-9, end + 1e-9]) for each in (other, at)]
            # the measured sample next after, or at, the model's: less than a step apart
            first = int(rows[0][0])
            beside = int(np.searchsorted(at, other[first] - 0.5 * steps[0]))
            count = min(int(rows[0][1]) - first, int(rows[1][1]) - beside)
            if count > 1:
                pieces.append((begin, first, beside, count))
                distances.append(
                    [float(at[beside] - other[first]), float(at[beside + count - 1] - other[first + count - 1])]
                )
        spread = np.ptp(distances) if distances else math.inf
        if spread <= REGULAR * steps[0]:
            forces = [(values[0][a : a + n], values[1][b : b + n]) for _, a, b, n in pieces]
            begins = [float(other[a]) for _, a, _, _ in pieces]
            return _Grid(1.0 / steps[0], begins, forces, float(np.mean(distances)), SAME / steps[0])
    fast = 0 if steps[0] <= steps[1] else 1
    step = steps[fast]
    curves = [_Curve(each, rows) for each, rows in zip((other, at), values, strict=True)]
    begins, forces = [], []
    for begin, end in spans:
        own = (other, at)[fast]
        start = float(own[np.searchsorted(own, begin - 1e-9)]) if even[fast] else begin
        grid = start + step * np.arange(math.floor((end - start) / step + 1e-9) + 1, dtype=np.float64)
        grid = grid[grid <= end]
        if grid.size > 1:
            begins.append(start)
            both = [
                rows[slice(*np.searchsorted(own, [grid[0] - 0.5 * step, grid[-1] + 0.5 * step]))]
                if side == fast and even[fast]
                else curve(grid)
                for side, (curve, rows) in enumerate(zip(curves, values, strict=True))
            ]
            forces.append((both[0], both[1]))
    if not forces:
        raise InputError("measurement and model have no two samples in common")
    return _Grid(1.0 / step, begins, forces, 0.0, OTHER / max(steps))


def _mean_step(time: FloatArray, spans: list[tuple[float, float]], step: float) -> float:
    """The interval over the longest span: the median's, but without its rounding."""
    begin, end = max(spans, key=lambda span: span[1] - span[0])
    part = time[slice(*np.searchsorted(time, [begin - 1e-9, end + 1e-9]))]
    if part.size < 2:
        return step
    whole = float(part[-1] - part[0]) / (part.size - 1)
    return whole if abs(whole - step) < 0.01 * step else step


class _Curve:
    """The curve through samples, made where it is asked for; what is not there stays NaN."""

    def __init__(self, time: FloatArray, values: FloatArray) -> None:
        self._time, self._values = time, values

    def __call__(self, at: FloatArray) -> FloatArray:
        first, last = np.searchsorted(self._time, [at[0], at[-1]])
        some = slice(max(int(first) - 20, 0), int(last) + 20)
        whole = np.full((at.size, 2), math.nan)
        for k in range(2):
            if np.isfinite(self._values[some, k]).all():
                whole[:, k] = smooth_curve(self._time[some], self._values[some, k])(at)
        return whole


def _shifted(x: FloatArray, y: FloatArray, lag: int) -> tuple[FloatArray, FloatArray]:
    """Both with the measurement taken ``lag`` samples later."""
    if lag >= 0:
        return x[: max(len(x) - lag, 0)], y[lag:]
    return x[-lag:], y[: max(len(y) + lag, 0)]


# -- one axis -----------------------------------------------------------------------------------------------------


def _axis(
    name: str, k: int, sums: Sums, grid: _Grid, pairs: Pairs, angle: list[FloatArray] | None, taken: float,
    band: tuple[float, float], reach: float,
) -> Axis:  # fmt: skip
    whole = _fitted(name, sums, band, reach)
    seen = compare_lines(sums)
    some = seen.frequency <= grid.highest
    seen = Lines(*(each[..., some] for each in seen))
    turn = 2.0 * math.pi * seen.frequency * whole.delay
    turned = np.angle(np.exp(1j * (seen.phase + turn)))
    seen = seen._replace(phase=turned, phase_interval=seen.phase_interval + (turned - seen.phase))
    edges = _third_octaves(band[0], band[1], sums.spacing)
    bands = compare_bands(sums, edges, whole.gain, whole.delay, taken)
    orders, by_order = (None, []) if angle is None else _orders(k, pairs, angle, whole.delay, grid)
    inside = (seen.frequency >= band[0]) & (seen.frequency <= band[1])
    K = sums.averages
    unexplained = float(np.sum((seen.y_density * (1.0 - seen.coherence))[inside])) * K / (K - 1.0)
    power = float(np.sum(seen.y_density[inside]))
    late = whole.delay + taken
    delay_interval = (whole.delay_interval[0] + taken, whole.delay_interval[1] + taken)
    return Axis(
        name,
        whole._replace(delay=late, delay_interval=delay_interval),
        seen,
        orders,
        by_order,
        bands,
        _offset(sums),
        max(0.0, 1.0 - unexplained / power) if power > 0.0 else 0.0,
        _peak(k, grid),
    )


def _fitted(name: str, sums: Sums, band: tuple[float, float], reach: float) -> GainDelay:
    try:
        return gain_and_delay(sums, *band, reach)
    except ValueError as error:
        raise InputError(f"force.{name}: {error}") from None


def _third_octaves(low: float, high: float, spacing: float) -> list[float]:
    """Edges of third-octave bands of at least three lines, the first and the last as they come."""
    numbers = range(math.floor(3.0 * math.log2(low / 1000.0)), math.ceil(3.0 * math.log2(high / 1000.0)) + 1)
    edges = [low - 1e-9]
    for edge in (1000.0 * 2.0 ** ((k + 0.5) / 3.0) for k in numbers):
        if edge - edges[-1] >= 3.0 * spacing and edge < high - 3.0 * spacing:
            edges.append(edge)
    return [*edges, high + 1e-9]


def _offset(sums: Sums) -> tuple[float, float]:
    """Mean of y - x over blocks, and its standard error."""
    share = sums.segments / sums.segments.sum()
    each = (sums.y_mean - sums.x_mean) / sums.segments
    mean = float(share @ each)
    return mean, math.sqrt(float(share @ (each - mean) ** 2) / max(each.size - 1, 1))


def _peak(k: int, grid: _Grid) -> dict[str, FloatArray]:
    sizes = [float(np.abs(y[:, k] - y[:, k].mean()).max()) for _, y in grid.forces]
    which = int(np.argmax(sizes))
    x, y = grid.forces[which]
    place = int(np.argmax(np.abs(y[:, k] - y[:, k].mean())))
    around = round(0.5 * SHOWN * grid.rate)
    some = slice(max(place - around, 0), place + around)
    time = grid.begin[which] + np.arange(len(x))[some] / grid.rate
    return {
        "time": time,
        "model": x[some, k],
        "measured_time": time + grid.ahead,
        "measured": y[some, k],
    }


# -- orders of the wheel ------------------------------------------------------------------------------------------


def _angles(grid: _Grid, speed: Series, lag: int) -> list[FloatArray]:
    """The wheel's angle beside each pair of forces [rad]; empty where the speed has a gap."""
    found = []
    runs = _runs(speed.time)
    for begin, (x, _) in zip(grid.begin, grid.forces, strict=True):
        time = begin + np.arange(len(x)) / grid.rate
        inside = any(a <= time[0] + 0.5 and time[-1] - 0.5 <= b for a, b in runs)
        if not inside:
            found.append(np.empty(0))
            continue
        omega = np.interp(time, speed.time, speed.values)
        omega[np.abs(omega) < ROLLING] = 0.0
        angle = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]))]) / grid.rate
        found.append(angle[: max(len(x) - lag, 0)] if lag >= 0 else angle[-lag:])
    return found


def _orders(
    k: int, pairs: Pairs, angle: list[FloatArray], delay: float, grid: _Grid
) -> tuple[Lines | None, list[OrderLine]]:
    steps = np.concatenate([np.abs(np.diff(each)) for each in angle] or [np.empty(0)])
    moving = steps[steps > 0.0]
    if not moving.size:
        return None, []
    typical = float(np.median(moving))  # [rad] from sample to sample
    per_turn = int(min(2 ** math.ceil(math.log2(2.0 * math.pi / typical)), 1024))
    even = []
    for (x, y), each in zip(pairs, angle, strict=True):
        for a, b in _turning(each):
            turned = np.abs(each[a:b] - each[a])
            marks = np.arange(0.0, turned[-1], 2.0 * math.pi / per_turn)
            place = np.interp(marks, turned, np.arange(a, b, dtype=np.float64))
            late = place + delay * grid.rate
            inside = (late > 4.0) & (late < len(y) - 5.0)  # the same marks of both
            if inside.sum() >= TURNS * per_turn:
                even.append((_between(x[:, k], place[inside]), _between(y[:, k], late[inside])))
    sums = cross_spectra(even, float(per_turn), TURNS * per_turn, BLOCKS)
    if sums is None or sums.segments.sum() < FEWEST:
        return None, []
    seen = compare_lines(sums)
    mean = typical * grid.rate / (2.0 * math.pi)  # turns per second
    some = seen.frequency <= min(HIGHEST_ORDER, grid.highest / mean, 0.4 * per_turn)
    seen = Lines(*(each[..., some] for each in seen))
    listed = []
    for order in range(1, ORDERS + 1):
        line = TURNS * order - 1
        if line + 1 < seen.frequency.size:
            lobe = slice(line - 1, line + 2)  # Hann's main lobe
            model, measured = (
                math.sqrt(float(density[lobe].sum()) * sums.spacing) for density in (seen.x_density, seen.y_density)
            )
            listed.append(OrderLine(order, line, model, measured))
    return seen, listed


def _turning(angle: FloatArray) -> list[tuple[int, int]]:
    """Where the wheel turns one way, without standing."""
    if angle.size < 3:
        return []
    way = np.sign(np.diff(angle))
    cuts = np.flatnonzero(np.diff(way)) + 1
    edges = [0, *cuts.tolist(), way.size]
    return [(a, b + 1) for a, b in zip(edges[:-1], edges[1:], strict=True) if way[a] != 0.0 and b - a > 2]


def _between(values: FloatArray, place: FloatArray) -> FloatArray:
    """By a cubic spline; both forces go the same way, so that what it takes off the gain is in both."""
    found: FloatArray = ndimage.map_coordinates(values, place[None], order=3, mode="nearest")
    return found
