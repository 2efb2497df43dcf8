"""Two forces held against each other: known transfer functions, known coherence, and intervals that keep their word."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal, stats

from tire_dynamics.science.comparison import (
    Sums,
    coherence_interval,
    compare_bands,
    compare_lines,
    cross_spectra,
    gain_and_delay,
    lag_of,
)
from tire_dynamics.science.interpolation import DEGREE, smooth_curve

RATE = 500.0


def white(seed: int, size: int, count: int = 2) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((count, size))


def sums_of(x: np.ndarray, y: np.ndarray, length: int = 256) -> Sums:
    found = cross_spectra([(x, y)], RATE, length)
    assert found is not None
    return found


def all_but_few(count: int, probability: float = 0.95) -> tuple[float, float]:
    """Between how many of so many draws lie within, in 999 of 1000 honest cases."""
    low, high = stats.binom.interval(0.999, count, probability)
    return float(low), float(high)


# -- spectra ------------------------------------------------------------------------------------------------------


def test_white_noise_has_its_density():
    sums = sums_of(*white(1, 400_000))
    xx = sums.xx.sum(axis=0) / sums.segments.sum()
    # variance 1 over 250 Hz; the mean over 125 lines of some 3000 averages is known to 1/sqrt(3000 125/1.9)
    assert xx[1:-1].mean() == pytest.approx(1.0 / 250.0, rel=0.01)
    assert sums.segments.sum() == (400_000 - 256) // 128 + 1


def test_the_spectra_are_scipys():
    x, y = white(2, 5000)
    sums = sums_of(x, y)
    f, expected = signal.csd(x, y, RATE, nperseg=256)
    assert sums.frequency == pytest.approx(f[1:])
    assert sums.xy.sum(axis=0)[:-1] / sums.segments.sum() == pytest.approx(expected[1:-1], rel=1e-12, abs=1e-15)


def test_blocks_and_gaps_hold_every_segment_once():
    x, y = white(3, 9000)
    parts = [(x[:2000], y[:2000]), (x[2100:2200], y[2100:2200]), (x[2300:], y[2300:])]
    one, many = cross_spectra(parts, RATE, 256, 1), cross_spectra(parts, RATE, 256, 7)
    assert one is not None and many is not None
    assert many.segments.sum() == one.segments.sum() == 14 + 51 and len(many.segments) == 7
    assert many.xy.sum(axis=0) == pytest.approx(one.xy[0], rel=1e-12)
    assert cross_spectra(parts[1:2], RATE, 256) is None


def test_a_known_filter_is_seen():
    """y_k = 0.3 x_k + 0.7 y_(k-1): H = 0.3/(1 - 0.7 exp(-i w))."""
    x = white(4, 200_000, 1)[0]
    seen = compare_lines(sums_of(x, signal.lfilter([0.3], [1.0, -0.7], x), 1024))
    H = 0.3 / (1.0 - 0.7 * np.exp(-2j * math.pi * seen.frequency / RATE))
    # a segment's beginning is forgotten in 3 samples of 1024: some 3e-3 of H, and its square of the power
    assert seen.gain * np.exp(1j * seen.phase) == pytest.approx(H, rel=5e-3)
    assert seen.coherence.min() > 0.9995


# -- intervals ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.05, 0.3, 0.8, 0.99])
def test_intervals_of_lines_hold_the_truth(share):
    """Of white noises with a known coherence, at lines three apart, which are independent under Hann's window."""
    x, noise = white(int(1000 * share), 30 * 4096)
    gain = 1.7
    y = gain * x + gain * math.sqrt(1.0 / share - 1.0) * noise
    seen = compare_lines(sums_of(x, y, 4096))
    some = slice(2, -2, 3)
    count = seen.gain[some].size
    low, high = all_but_few(count)
    spare = 0.012 * count  # that the intervals of coherence are normal in artanh is true to 1 %
    truths = ((seen.coherence_interval, share, spare), (seen.gain_interval, gain, 0.0))
    for interval, truth, more in truths:
        within = int(((interval[0] <= truth) & (truth <= interval[1]))[some].sum())
        assert low - more <= within <= high + more, (share, truth, within, count)
    if share > 0.2:  # else a few of the phases are not known at all
        within = int(((seen.phase_interval[0] <= 0.0) & (0.0 <= seen.phase_interval[1]))[some].sum())
        assert low <= within <= high + 0.01 * count
    errors = (seen.gain - gain)[some] / seen.gain_error[some]
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(1.0, abs=0.1)


def test_no_coherence_has_an_interval_from_zero():
    x, y = white(6, 40 * 4096)
    sums = sums_of(x, y, 4096)
    low = compare_lines(sums).coherence_interval[0][2:-2:3]
    few, many = all_but_few(low.size)
    assert few <= (low == 0.0).sum() <= many + 0.01 * low.size


def test_coherence_of_a_known_ratio():
    """1/(1 + noise over signal), and (1 - c)^2/K more, which is the estimate's bias to first order."""
    x, noise = white(7, 400 * 256)
    sums = sums_of(x, x + math.sqrt(0.5) * noise)
    c = 1.0 / 1.5
    seen = compare_lines(sums).coherence[2:-2]
    # deviation of one line: sqrt(2 c/K) (1 - c); of the mean of 123 lines, every second counts
    deviation = math.sqrt(2.0 * c / sums.averages) * (1.0 - c) / math.sqrt(seen.size / 2.0)
    assert seen.mean() == pytest.approx(c + (1.0 - c) ** 2 / sums.averages, abs=3.0 * deviation)


@pytest.mark.parametrize("averages", [4.0, 30.0, 1000.0])
def test_the_interval_lies_around_the_estimate(averages):
    seen = np.linspace(0.0, 1.0, 101)
    low, high = coherence_interval(seen, averages)
    assert (low >= 0.0).all() and (high <= 1.0).all() and (low <= high).all()
    assert (np.diff(low) >= 0.0).all() and (np.diff(high) >= 0.0).all()
    assert low[-1] == pytest.approx(1.0, abs=1e-6)


# -- one gain, one delay ------------------------------------------------------------------------------------------


def late(seed: int, gain: float, delay: float, noise: float, size: int = 8192) -> tuple[np.ndarray, np.ndarray]:
    """A load that falls beyond 30 Hz, and the same later by a fraction of a sample, exactly, with white noise."""
    x, n = white(seed, size)
    f = np.fft.rfftfreq(size, 1.0 / RATE)
    X = np.fft.rfft(x) / (1.0 + (f / 30.0) ** 2)
    x = np.fft.irfft(X, size)
    y = np.fft.irfft(gain * X * np.exp(-2j * math.pi * f * delay), size)
    return x / x.std(), y / x.std() + noise * n


def test_gain_and_delay_without_noise():
    found = gain_and_delay(sums_of(*late(1, 1.02, 0.00123, 0.0, 65536)), 2.0, 150.0, 0.05)
    # of a segment, what the delay shifts out of it: 0.6 samples of 256, squared under Hann's window
    assert found.gain == pytest.approx(1.02, rel=2e-4)
    assert found.delay == pytest.approx(0.00123, rel=1e-3)


@pytest.mark.parametrize(("gain", "delay"), [(1.02, 0.001), (-0.9, -0.0013)])
def test_a_planted_gain_and_delay_are_within_two_errors(gain, delay):
    """In as many of 60 draws as the errors promise: two of Student's with 23 degrees of freedom are 94 %."""
    misses = []
    for seed in range(60):
        found = gain_and_delay(sums_of(*late(seed, gain, delay, 0.3)), 2.0, 150.0, 0.05)
        misses.append([(found.gain - gain) / found.gain_error, (found.delay - delay) / found.delay_error])
        assert found.gain_error < 0.02 and found.delay_error < 1e-4
    few, many = all_but_few(60, 0.94)
    within = (np.abs(misses) <= 2.0).sum(axis=0)
    assert (within >= few).all() and (within <= many).all(), within
    assert np.sqrt(np.mean(np.square(misses), axis=0)) == pytest.approx(1.0, abs=0.35)


def test_what_is_more_than_a_gain_and_a_delay_is_told():
    x, y = late(3, 1.0, 0.001, 0.05, 65536)
    plain = gain_and_delay(sums_of(x, y), 2.0, 150.0, 0.05)
    softer = gain_and_delay(sums_of(x, signal.lfilter([0.5], [1.0, -0.5], y)), 2.0, 150.0, 0.05)
    assert plain.misfit < 1.5 and softer.misfit > 10.0


def test_a_force_that_does_not_vary_is_refused():
    x = white(1, 4096, 1)[0]
    with pytest.raises(ValueError, match="does not vary"):
        gain_and_delay(sums_of(x, np.zeros_like(x)), 2.0, 150.0, 0.05)
    with pytest.raises(ValueError, match="no line"):
        gain_and_delay(sums_of(x, x), 2.1, 2.2, 0.05)


@pytest.mark.parametrize("lag", [-37, 0, 1, 80])
def test_the_lag_is_found(lag):
    x = white(8, 3000, 1)[0]
    later = -1.5 * np.roll(x, lag)
    assert lag_of([(x[100:1500], later[100:1500]), (x[1600:2900], later[1600:2900])], 90) == lag
    assert lag_of([(np.zeros(50), np.zeros(50))], 10) == 0


# -- bands --------------------------------------------------------------------------------------------------------


def test_errors_by_band_of_white_noise():
    """y = x + noise: in a band of B Hz the error is the noise's sqrt(B/250), in as many draws as promised."""
    edges = [10.0, 30.0, 100.0, 200.0]
    hits = np.zeros((3, 3))
    for seed in range(60):
        x, noise = white(100 + seed, 8192)
        for k, band in enumerate(compare_bands(sums_of(x, x + 0.4 * noise), edges, 1.0, 0.0)):
            lines = np.arange(1, 129) * RATE / 256
            width = ((lines >= band.low) & (lines < band.high)).sum() * RATE / 256
            root = math.sqrt(width / 250.0)
            for row, (triple, truth) in enumerate(
                ((band.error, 0.4 * root), (band.unexplained, 0.4 * root), (band.gain, 1.0))
            ):
                hits[row, k] += triple[1] <= truth <= triple[2]
    few, many = all_but_few(60)
    assert (hits >= few - 1).all() and (hits <= many).all(), hits  # neighbouring lines leak into a band's edges


def test_a_delay_is_an_error_of_its_own():
    """|1 - exp(-i w tau)|^2 of the power, as y is; nothing once the delay is out."""
    delay = 0.002
    x, y = late(9, 1.0, delay, 0.0, 65536)
    sums = sums_of(x, y)
    [band] = compare_bands(sums, [20.0, 22.5], 1.0, delay)  # one line
    f = 10 * RATE / 256 if 20.0 <= 10 * RATE / 256 < 22.5 else 11 * RATE / 256
    assert band.error[0] / band.x[0] == pytest.approx(abs(1.0 - np.exp(-2j * math.pi * f * delay)), rel=0.01)
    assert band.aligned[0] < 0.02 * band.x[0]
    again = compare_bands(sums_of(x[:-1], y[1:]), [20.0, 22.5], 1.0, delay - 1.0 / RATE, 1.0 / RATE)[0]
    assert again.error[0] == pytest.approx(band.error[0], rel=0.01)


# -- curves through samples ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.1, 0.2, 0.3])
def test_a_curve_keeps_the_gain_of_the_cardinal_spline(share):
    time = np.arange(400.0)
    wave = np.exp(2j * math.pi * share * time)
    curve = smooth_curve(time, np.column_stack([wave.real, wave.imag]))
    count = 10 * 100  # a whole number of turns between the samples
    at = 150.0 + np.arange(count) / 10.0
    seen = np.mean((curve(at) @ [1.0, 1j]) * np.exp(-2j * math.pi * share * at))
    j = np.arange(-200, 201)
    expected = 1.0 / np.sum((share / (share - j)) ** (DEGREE + 1.0))
    # ten points between samples see the images of the wave as well where they fall on it: beyond the tenth
    assert abs(seen) == pytest.approx(expected, abs=1e-7)


def test_a_curve_takes_uneven_and_few_samples():
    time = np.arange(200.0) + np.random.default_rng(1).uniform(-0.2, 0.2, 200)
    at = np.linspace(30.0, 160.0, 999)
    assert smooth_curve(time, np.sin(0.6 * time))(at) == pytest.approx(np.sin(0.6 * at), abs=2e-6)
    for few in (2, 3, 5):
        line = 2.0 * time[:few] + 1.0
        assert smooth_curve(time[:few], line)(0.5) == pytest.approx(2.0)
