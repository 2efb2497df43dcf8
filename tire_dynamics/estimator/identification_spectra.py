"""The frequency response from load to the measured force, and the parameters that it suggests."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, signal

from ..science import wheel
from ..science.interpolation import smooth_curve
from ..science.spectra import Spectra, Transfer
from .identification_problem import GAP, Problem, Section, Seen, median

__all__ = [
    "from_spectra",
]

FloatArray = NDArray[np.float64]

_STEADY = 15.0  # [rad/s] that the speed may vary by in a spectrum's segment
_SEGMENT = 2.0  # [s] of a spectrum's segment, or a sixteenth of the recording
_FEW = 8  # segments; of fewer nothing is known about coherence
_COHERENT = 0.5  # somewhere, lest there be nothing to fit
_LEAKAGE = 0.05  # of H1: what windows and a speed that is not quite steady do, which no coherence shows


def from_spectra(problem: Problem) -> tuple[tuple[Seen, ...], FloatArray, float]:
    """What was seen, and the estimates and the delay that go with it."""
    seen = _spectra(problem, 0.0)
    if not seen:
        longest = max(float(section.time[-1] - section.time[0]) for section in problem.sections)
        raise ValueError(
            f"no section with speed, load and force is long enough for a spectrum; the longest with speed and load has "
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


def _spectra(problem: Problem, delay: float) -> tuple[Seen, ...]:
    """H1 from load to F', by speed; its phase has the delay, but the segments are taken so much later."""
    record = problem.recording
    low, high = record.force_time[0], record.force_time[-1]
    total = sum(min(s.time[-1], high) - max(s.time[0], low) for s in problem.sections)
    rate = 1.0 / median(problem.sections[0].time[problem.sections[0].kept])
    seen: tuple[Seen, ...] = ()
    length = 2 ** round(math.log2(rate * min(_SEGMENT, max(total, 1.0) / 16.0)))
    while length >= 0.2 * rate:  # shorter, if gaps leave few of this length
        found = _of_length(problem, delay, rate, length)
        seen = found or seen
        if sum(each.transfer.segments for each in found) >= _FEW:
            break
        length //= 2
    return seen


def _of_length(problem: Problem, delay: float, rate: float, length: int) -> tuple[Seen, ...]:
    record = problem.recording
    middle = float(np.mean(np.concatenate([section.speed for section in problem.sections])))
    kinds: dict[int, tuple[Spectra, list[float]]] = {}
    relaxed: list[tuple[FloatArray, ...]] = []
    for section in problem.sections:
        for window in _windows(problem, section, delay, rate, length):
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
            some = f < 0.45 * min(1.0 / problem.interval, 1.0 / median(record.load_time))
            transfer = Transfer(f[some], uu[some], yy[some], response[some], coherence[some], segments)
            seen.append(Seen(float(np.mean(speeds)), transfer))
    return tuple(sorted(seen, key=lambda each: -each.transfer.segments))


def _windows(
    problem: Problem, section: Section, delay: float, rate: float, length: int
) -> Iterator[tuple[FloatArray, ...]]:
    """Time, speed, load, and the force that was measured ``delay`` later, on a regular grid, half overlapping."""
    record = problem.recording
    count = math.floor((section.time[-1] - section.time[0]) * rate) + 1
    time = section.time[0] + np.arange(count) / rate
    place = np.searchsorted(record.force_time, time + delay)
    inner = (place > 0) & (place < record.force_time.size)
    gap = record.force_time[np.clip(place, 1, record.force_time.size - 1)]
    gap = gap - record.force_time[np.clip(place, 1, record.force_time.size - 1) - 1]
    missing = np.concatenate([[0], np.cumsum(~inner | (gap > GAP * problem.interval))])
    settled = math.ceil(problem.settling * rate)
    if not (missing[length:] == missing[:-length]).any():
        return
    load, speed = (np.interp(time, section.time, column) for column in (section.load, section.speed))
    nearby = slice(*np.searchsorted(record.force_time, time[[0, -1]] + delay + [-1.0, 1.0]))
    force = smooth_curve(record.force_time[nearby], record.force[nearby, 1])(time + delay)
    if section.traction.any():
        alone = section._replace(load=np.zeros_like(section.load))
        force = force - np.interp(time, section.time[section.kept], problem.forces(problem.start, alone)[:, 1])
    for first in range(settled if count > settled + length else 0, count - length + 1, length // 2):
        if missing[first + length] == missing[first]:
            part = slice(first, first + length)
            yield time[part], speed[part], load[part], force[part]


def _add(
    kinds: dict[int, tuple[Spectra, list[float]]], middle: float, rate: float, length: int, *window: FloatArray
) -> None:
    time, speed, load, force = window
    key = round((float(speed.mean()) - middle) / _STEADY)
    spectra, speeds = kinds.setdefault(key, (Spectra(rate, length, hold=None), []))
    spectra.add(time, load, force)
    speeds.append(float(speed.mean()))


def _fit_spectra(
    problem: Problem, seen: tuple[Seen, ...], x: FloatArray, delay: float | None
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


_EARLIEST, _LATEST = -0.1, 0.3  # [s]: delays that are looked for
