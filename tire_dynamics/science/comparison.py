"""Two forces held against each other: coherence, gain, phase, delay and errors by band, each with its error.

One of them, x, is known exactly: a model's. The other, y, is measured: y(t) = g x(t - tau) + what x does not explain.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage, optimize, signal, stats

__all__ = [
    "BLOCKS",
    "CONFIDENCE",
    "FEWEST",
    "Band",
    "GainDelay",
    "Lines",
    "Sums",
    "coherence_interval",
    "compare_bands",
    "compare_lines",
    "cross_spectra",
    "gain_and_delay",
    "lag_of",
]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

CONFIDENCE: Final = 0.95
BLOCKS: Final = 24
"""Into which the segments are put, at most, for errors by leaving out one after the other."""
FEWEST: Final = 8
"""Segments: of fewer nothing is known about coherence."""
_OVERLAP: Final = 1.0 + 2.0 / 36.0  # segments that overlap by half under Hann's window count for so many fewer
_SMOOTH = 11  # lines over which the unexplained power is averaged
_AT_ONCE = 64  # segments that are transformed at once
_NEARLY_ALL = 1e-12  # of the output; the least that is taken to be unexplained, which is rounding


class Sums(NamedTuple):
    """Mean products of the transforms of two series, by block of segments.

    Attributes
    ----------
    frequency : ndarray, shape (F,)
        Without zero [Hz, or cycles per unit of what the samples are over].
    xx, yy : ndarray, shape (B, F)
        One-sided spectral densities, each times the block's number of segments.
    xy : complex ndarray, shape (B, F)
        Cross spectrum conj(X) Y likewise: its phase is that of y after x.
    segments : ndarray of int, shape (B,)
    x_mean, y_mean : ndarray, shape (B,)
        Of the segments, times their number.
    """

    frequency: FloatArray
    xx: FloatArray
    yy: FloatArray
    xy: ComplexArray
    segments: NDArray[np.int64]
    x_mean: FloatArray
    y_mean: FloatArray

    @property
    def averages(self) -> float:
        """Independent segments that have the same errors as these, which overlap."""
        return max(float(self.segments.sum()) / _OVERLAP, 1.0 + 1e-9)

    @property
    def spacing(self) -> float:
        """Of the lines."""
        return float(self.frequency[0])


class Lines(NamedTuple):
    """What is seen at each line, with 95 % intervals; all of shape (F,), intervals (2, F).

    Attributes
    ----------
    frequency, x_density, y_density : ndarray
    coherence, coherence_interval : ndarray
        Share of the power of y that x explains.
    gain, gain_error, gain_interval : ndarray
        Of y over x; the error is one standard error.
    phase, phase_error, phase_interval : ndarray
        Of y after x, in (-pi, pi] [rad]; NaN as an interval where it may be anything.
    """

    frequency: FloatArray
    x_density: FloatArray
    y_density: FloatArray
    coherence: FloatArray
    coherence_interval: FloatArray
    gain: FloatArray
    gain_error: FloatArray
    gain_interval: FloatArray
    phase: FloatArray
    phase_error: FloatArray
    phase_interval: FloatArray


class GainDelay(NamedTuple):
    """One gain and one delay over a band, with standard errors and 95 % intervals.

    Attributes
    ----------
    gain, gain_error : float
    gain_interval : tuple of float
    delay, delay_error : float
        [s], y after x.
    delay_interval : tuple of float
    misfit : float
        Mean square of what is left of the response over its variance: 1 if a gain and a delay are all there is.
    """

    gain: float
    gain_error: float
    gain_interval: tuple[float, float]
    delay: float
    delay_error: float
    delay_interval: tuple[float, float]
    misfit: float


class Band(NamedTuple):
    """What is seen in a band; each value is (value, low, high), the latter a 95 % interval.

    Attributes
    ----------
    low, high : float
        Its edges.
    x, y : tuple of float
        Root mean squares.
    error : tuple of float
        Root mean square of y - x, as they are.
    aligned : tuple of float
        And of y - g x(t - tau), with one gain and delay for all bands.
    unexplained : tuple of float
        And of what no linear filter of x explains.
    coherence : float
        Share of the power of y that x explains, lines apart.
    gain, phase : tuple of float
        Of y over x and after x [rad], the delay being taken out.
    """

    low: float
    high: float
    x: tuple[float, float, float]
    y: tuple[float, float, float]
    error: tuple[float, float, float]
    aligned: tuple[float, float, float]
    unexplained: tuple[float, float, float]
    coherence: float
    gain: tuple[float, float, float]
    phase: tuple[float, float, float]


def lag_of(pairs: Sequence[tuple[FloatArray, FloatArray]], most: int) -> int:
    """Samples by which y comes after x, by the highest or lowest of their cross-correlation.

    Parameters
    ----------
    pairs : sequence of (ndarray, ndarray)
        x and y over sections without gaps, of equal length each.
    most : int
        Largest lag that is looked for, either way.

    Returns
    -------
    int
        0 where nothing correlates.
    """
    total = np.zeros(2 * most + 1)
    for x, y in pairs:
        size = x.size
        if size < 2:
            continue
        count = 2 ** math.ceil(math.log2(2 * size))
        product = np.conj(np.fft.rfft(x - x.mean(), count)) * np.fft.rfft(y - y.mean(), count)
        whole = np.fft.irfft(product, count)
        reach = min(most, size - 1)
        total[most - reach : most + reach + 1] += np.concatenate([whole[count - reach :], whole[: reach + 1]])
    return int(np.abs(total).argmax()) - most if total.any() else 0


def cross_spectra(
    pairs: Iterable[tuple[FloatArray, FloatArray]], rate: float, length: int, blocks: int = BLOCKS
) -> Sums | None:
    """Welch's spectra of two series, by block.

    Parameters
    ----------
    pairs : iterable of (ndarray, ndarray)
        x and y over sections without gaps, of equal length each.
    rate : float
        Samples per second, or per unit of what they are over.
    length : int
        Samples of a segment: Hann's window, half overlapping, each without its mean.
    blocks : int
        At most so many, of segments that follow one another.

    Returns
    -------
    Sums or None
        None if no section has a whole segment.
    """
    step = length - length // 2
    cut = [(x, y, (x.size - length) // step + 1) for x, y in pairs if x.size >= length]
    total = sum(count for _, _, count in cut)
    if not total:
        return None
    blocks = min(blocks, total)
    window = signal.get_window("hann", length)
    scale = 2.0 / (rate * float(window @ window))
    lines = length // 2
    xx, yy = np.zeros((blocks, lines)), np.zeros((blocks, lines))
    xy = np.zeros((blocks, lines), np.complex128)
    means = np.zeros((2, blocks))
    segments = np.zeros(blocks, np.int64)
    done = 0
    for x, y, count in cut:
        frames = [np.lib.stride_tricks.sliding_window_view(each, length)[::step] for each in (x, y)]
        for first in range(0, count, _AT_ONCE):
            some = slice(first, min(first + _AT_ONCE, count))
            block = (done + np.arange(some.start, some.stop)) * blocks // total
            mean = [each[some].mean(axis=1) for each in frames]
            X, Y = (
                np.fft.rfft((each[some] - middle[:, None]) * window, axis=1)[:, 1 : lines + 1]
                for each, middle in zip(frames, mean, strict=True)
            )
            for number in np.unique(block).tolist():
                rows = block == number
                xx[number] += scale * np.sum(np.abs(X[rows]) ** 2, axis=0)
                yy[number] += scale * np.sum(np.abs(Y[rows]) ** 2, axis=0)
                xy[number] += scale * np.sum(np.conj(X[rows]) * Y[rows], axis=0)
                segments[number] += int(rows.sum())
                means[:, number] += [float(middle[rows].sum()) for middle in mean]
        done += count
    frequency = np.arange(1, lines + 1, dtype=np.float64) * (rate / length)
    return Sums(frequency, xx, yy, xy, segments, means[0], means[1])


def coherence_interval(coherence: ArrayLike, averages: float) -> FloatArray:
    """The 95 % interval of a coherence that was estimated from so many independent segments.

    Parameters
    ----------
    coherence : array_like, shape (F,)
        As estimated, 0 to 1.
    averages : float
        > 1.

    Returns
    -------
    ndarray, shape (2, F)
        From 0 on where no coherence at all would look like this once in twenty.

    Notes
    -----
    artanh of the root of the estimate is normal around that of the true one, 1/(2 K - 2) too high, with the variance
    1/(2 K - 2) (L. D. Enochson and N. R. Goodman, Gaussian approximations to the distribution of sample coherence,
    AFFDL-TR-65-57, 1965). Of two series that have nothing in common the estimate is below c with the probability
    1 - (1 - c)^(K - 1), exactly.
    """
    seen = np.clip(np.asarray(coherence, np.float64), 0.0, 1.0 - 1e-15)
    spare = max(2.0 * averages - 2.0, 1e-9)
    middle = np.arctanh(np.sqrt(seen)) - 1.0 / spare
    reach = float(stats.norm.ppf(0.5 + 0.5 * CONFIDENCE)) / math.sqrt(spare)
    low, high = (np.tanh(np.maximum(middle + side, 0.0)) ** 2 for side in (-reach, reach))
    by_chance = 1.0 - (1.0 - CONFIDENCE) ** (2.0 / spare)
    return np.stack([np.where(seen < by_chance, 0.0, low), high])


def compare_lines(sums: Sums) -> Lines:
    """Coherence, gain and phase of y over x at each line.

    Parameters
    ----------
    sums : Sums

    Returns
    -------
    Lines

    Notes
    -----
    H1 = S_xy/S_xx. Given x, its error is complex normal with the variance S_ee/(K S_xx), S_ee = S_yy (1 - coherence)
    K/(K - 1) (J. S. Bendat and A. G. Piersol, Random Data, 4th ed., chapter 9), half of it along H1, which is the
    gain's, and half across, the phase's; intervals have Student's factor of 2 K - 2 degrees of freedom.
    """
    K = sums.averages
    total = float(sums.segments.sum())
    xx, yy, xy = sums.xx.sum(axis=0) / total, sums.yy.sum(axis=0) / total, sums.xy.sum(axis=0) / total
    with np.errstate(divide="ignore", invalid="ignore"):
        coherence = np.where(xx * yy > 0.0, np.minimum(np.abs(xy) ** 2 / (xx * yy), 1.0), 0.0)
        response = np.where(xx > 0.0, xy / xx, math.nan)
        error = np.where(xx > 0.0, np.sqrt(yy * (1.0 - coherence) / (2.0 * (K - 1.0) * xx)), math.nan)
        gain, phase = np.abs(response), np.angle(response)
        factor = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, 2.0 * K - 2.0))
        turned = np.arcsin(np.where(factor * error < gain, factor * error / gain, math.nan))
        phase_error = error / gain
    return Lines(
        sums.frequency,
        xx,
        yy,
        coherence,
        coherence_interval(coherence, K),
        gain,
        error,
        np.stack([np.maximum(gain - factor * error, 0.0), gain + factor * error]),
        phase,
        phase_error,
        np.stack([phase - turned, phase + turned]),
    )


def gain_and_delay(sums: Sums, low: float, high: float, reach: float) -> GainDelay:
    """The one gain and delay that fit best between two frequencies.

    Parameters
    ----------
    sums : Sums
        Of at least two blocks.
    low, high : float
        Edges of the band [Hz].
    reach : float
        How far from 0 the delay is looked for [s].

    Returns
    -------
    GainDelay

    Raises
    ------
    ValueError
        The band has no line, or x and y have nothing in common there.

    Notes
    -----
    Least squares of H1 - g exp(-2 pi i f tau) over its variance, the unexplained part being smooth over lines. Errors
    by the jackknife: each block of segments is left out once, with the weights of all.
    """
    some = (sums.frequency >= low - 1e-9) & (sums.frequency <= high + 1e-9)
    if not some.any():
        raise ValueError(f"no line of the spectrum lies between {low:g} and {high:g} Hz; the recording is too short")
    omega = 2.0 * math.pi * sums.frequency[some]
    xx, yy, xy = sums.xx[:, some], sums.yy[:, some], sums.xy[:, some]
    whole_x, whole_y, whole_xy = xx.sum(axis=0), yy.sum(axis=0), xy.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        left = whole_y - np.where(whole_x > 0.0, np.abs(whole_xy) ** 2 / whole_x, 0.0)
    # of the mean over lines: what chance leaves at one of them would give it weight
    smooth = ndimage.uniform_filter1d(left, _SMOOTH, mode="nearest")
    weight = 1.0 / np.maximum(smooth, np.maximum(_NEARLY_ALL * whole_y, 1e-300))
    weight[whole_x <= 0.0] = 0.0
    if not (np.abs(whole_xy) * weight).any():
        raise ValueError("one of the two forces does not vary; nothing can be compared")

    def turned(product: ComplexArray, delay: float, power: int = 0) -> float:
        return float(np.sum(weight * omega**power * (product * np.exp(1j * omega * delay)).real))

    count = 2 ** math.ceil(
        math.log2(16 * sums.frequency.size)
    )  # delays tried in a period of the lines, by one transform
    product = np.zeros(count, np.complex128)
    product[1 : sums.frequency.size + 1][some] = weight * whole_xy
    trials = np.fft.fftfreq(count) / sums.spacing
    fits = np.fft.ifft(product).real * (np.abs(trials) <= reach)
    best = float(trials[np.abs(fits).argmax()])
    sign = math.copysign(1.0, float(fits[np.abs(fits).argmax()]))

    def fitted(product: ComplexArray, power: FloatArray, start: float) -> tuple[float, float]:
        width = math.pi / (4.0 * omega[-1])
        found = optimize.minimize_scalar(
            lambda delay: -sign * turned(product, delay),
            bounds=(start - width, start + width),
            method="bounded",
            options={"xatol": 1e-12},
        )
        delay = float(found.x)
        for _ in range(3):  # to rounding
            bend = turned(product, delay, 2)
            slope = float(np.sum(weight * omega * (1j * product * np.exp(1j * omega * delay)).real))
            if bend != 0.0 and abs(slope / bend) < width:
                delay += slope / bend
        return turned(product, delay) / float(np.sum(weight * power)), delay

    gain, delay = fitted(whole_xy, whole_x, best)
    without = np.array([fitted(whole_xy - xy[b], whole_x - xx[b], delay) for b in range(len(xx))])
    errors = _errors(np.array([gain, delay]), without, sums.segments)
    factor = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, max(len(xx) - 1, 1)))
    K = sums.averages
    apart = np.abs(whole_xy / np.maximum(whole_x, 1e-300) - gain * np.exp(-1j * omega * delay)) ** 2
    variance = np.maximum(left, _NEARLY_ALL * whole_y) / (np.maximum(whole_x, 1e-300) * (K - 1.0))
    return GainDelay(
        gain,
        float(errors[0]),
        (gain - factor * float(errors[0]), gain + factor * float(errors[0])),
        delay,
        float(errors[1]),
        (delay - factor * float(errors[1]), delay + factor * float(errors[1])),
        float(np.mean((apart / np.maximum(variance, 1e-300))[whole_x > 0.0])),
    )


def _errors(whole: FloatArray, without: FloatArray, segments: NDArray[np.int64]) -> FloatArray:
    """Standard errors of values (P,) from those without each block, (B, P).

    The jackknife for blocks of different sizes: F. M. T. A. Busing, E. Meijer, R. van der Leeden, Delete-m jackknife
    for unequal m, Statistics and Computing 9 (1999), 3-8.
    """
    parts = segments.sum() / segments[:, None].astype(np.float64)
    with np.errstate(invalid="ignore"):
        pseudo = parts * whole - (parts - 1.0) * without
        middle = np.sum(pseudo / parts, axis=0)
        errors: FloatArray = np.sqrt(np.mean((pseudo - middle) ** 2 / (parts - 1.0), axis=0))
    return errors


def compare_bands(sums: Sums, edges: Sequence[float], gain: float, delay: float, shift: float = 0.0) -> list[Band]:
    """Root mean squares, errors, gain and phase in bands.

    Parameters
    ----------
    sums : Sums
        Of at least two blocks.
    edges : sequence of float
        Ascending; bands without a line are left out.
    gain, delay : float
        Of all bands together, as these sums have them.
    shift : float
        By how much earlier y was taken for the sums than it was [s]; the errors of y - x are those of y as it was.

    Returns
    -------
    list of Band

    Notes
    -----
    Intervals by the jackknife over blocks, of sizes in their logarithms.
    """
    found = []
    frequency = sums.frequency
    total = float(sums.segments.sum())
    K = sums.averages
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        some = (frequency >= low) & (frequency < high)
        if not some.any():
            continue
        omega = 2.0 * math.pi * frequency[some]
        as_it_was, aligned = np.exp(1j * omega * -shift), np.exp(1j * omega * delay)
        xx, yy, xy = sums.xx[:, some], sums.yy[:, some], sums.xy[:, some]

        def values(
            xx: FloatArray, yy: FloatArray, xy: ComplexArray, count: float,
            as_it_was: ComplexArray = as_it_was, aligned: ComplexArray = aligned,
        ) -> FloatArray:  # fmt: skip
            power_x, power_y = float(xx.sum()), float(yy.sum())
            raw = power_x + power_y - 2.0 * float((xy * as_it_was).real.sum())
            rest = power_y + gain**2 * power_x - 2.0 * gain * float((xy * aligned).real.sum())
            explained = np.divide(np.abs(xy) ** 2, xx, out=np.zeros_like(xx), where=xx > 0.0)
            unknown = (power_y - float(explained.sum())) * K / (K - 1.0)
            response = complex((xy * aligned).sum()) / power_x if power_x > 0.0 else complex(math.nan)
            squares = np.array([power_x, power_y, raw, rest, unknown]) * sums.spacing / count
            with np.errstate(divide="ignore"):
                sizes = 0.5 * np.log(np.maximum(squares, 0.0))
            return np.array([*sizes, math.log(abs(response)) if abs(response) > 0.0 else math.nan, np.angle(response)])

        whole = xx.sum(axis=0), yy.sum(axis=0), xy.sum(axis=0)
        middle = values(*whole, total)
        count = len(sums.segments)
        without = np.array(
            [
                values(whole[0] - xx[b], whole[1] - yy[b], whole[2] - xy[b], total - float(sums.segments[b]))
                for b in range(count)
            ]
        )
        without[:, 6] = middle[6] + np.angle(np.exp(1j * (without[:, 6] - middle[6])))
        errors = _errors(middle, without, sums.segments)
        reach = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, max(count - 1, 1))) * errors
        ranges = [
            (float(m), float(m - r), float(m + r)) if k == 6 else tuple(map(float, np.exp([m, m - r, m + r])))
            for k, (m, r) in enumerate(zip(middle, reach, strict=True))
        ]
        x, y, error, rest, unknown, ratio, phase = ranges
        share = 1.0 - min((unknown[0] / y[0]) ** 2, 1.0) if y[0] > 0.0 else 0.0
        found.append(Band(low, high, x, y, error, rest, unknown, share, ratio, phase))  # type: ignore[arg-type]
    return found
