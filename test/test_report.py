"""The report: what is computed on the way, what the page says, and the page in a browser with no network."""

from __future__ import annotations

import base64
import contextlib
import dataclasses
import json
import math
import re
import shutil
import sys
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from rosbags.typesys import Stores, get_typestore
from scipy import signal
from test_cli import called, refused
from test_replay import BEGIN, SECOND, InputBag, constant, wild

from tire_dynamics import TireWheelUnit, wheel, write_unit
from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.cdr import messages
from tire_dynamics.replay.replay import replay
from tire_dynamics.report import analysis, theory
from tire_dynamics.report.findings import critical_range, number, seconds, summary
from tire_dynamics.report.gather import Drive, gather, has_outputs
from tire_dynamics.report.page import page as page_of
from tire_dynamics.science.response import frequency_response
from tire_dynamics.science.uncertainty import bands, value_of
from tire_dynamics.science.uncertainty import sample as sample_units

pytestmark = pytest.mark.slow

REPOSITORY = Path(__file__).parents[1]
SAMPLE = REPOSITORY / "bags" / "sample"
VEHICLE = REPOSITORY / "config" / "vehicle.yaml"
WHEELS = ["front_left", "front_right", "rear_left", "rear_right"]
SIZES = {"desktop": (1440, 900), "phone": (390, 844)}


# -- decimation ---------------------------------------------------------------------------------------------------


@st.composite
def curves(draw):
    """Times from -1 to 11, most of them in [0, 10], in any order, and values of which few differ."""
    count = draw(st.integers(0, 60))
    time = draw(npst.arrays(float, count, elements=st.floats(-1.0, 11.0)))
    value = draw(npst.arrays(float, count, elements=st.sampled_from([-2.5, -1.0, 0.0, 0.5, 7.0, math.nan, math.inf])))
    return time, value


def bucket(time, buckets):
    return np.clip(np.floor(np.asarray(time) * (buckets / 10.0)), 0, buckets - 1)


@given(curve=curves(), buckets=st.integers(1, 9))
def test_decimation_keeps_the_peaks_of_every_bucket_and_both_ends(curve, buckets):
    time, value = (column[np.isfinite(curve[1])] for column in curve)
    kept_time, kept = analysis.decimate(*curve, 0.0, 10.0, buckets)
    assert kept.size <= 2 * buckets + 2
    assert (np.diff(kept_time) >= 0.0).all()
    assert not Counter(zip(kept_time, kept, strict=True)) - Counter(zip(time, value, strict=True))
    for each in np.unique(bucket(time, buckets)):
        before, after = value[bucket(time, buckets) == each], kept[bucket(kept_time, buckets) == each]
        assert (after.min(), after.max()) == (before.min(), before.max())
    if time.size:
        assert (kept_time[0], kept_time[-1]) == (time.min(), time.max())


@given(curve=curves(), buckets=st.integers(1, 9), cut=st.integers(0, 60))
def test_a_curve_decimated_in_pieces_has_the_same_peaks(curve, buckets, cut):
    time, value = curve
    envelope = analysis.Envelope(0.0, 10.0, buckets)
    envelope._limit = 7  # so that it decimates on the way
    for some in (slice(0, cut), slice(cut, None)):
        envelope.add(time[some], value[some])
    whole, pieces = analysis.decimate(time, value, 0.0, 10.0, buckets), envelope.curve()
    for each in np.unique(bucket(whole[0], buckets)):
        one, other = (kept[bucket(t, buckets) == each] for t, kept in (whole, pieces))
        assert (one.min(), one.max()) == (other.min(), other.max())
    if whole[0].size:
        assert (whole[0][0], whole[0][-1]) == (pieces[0][0], pieces[0][-1])


def test_an_envelope_of_a_long_drive_stays_small():
    envelope = analysis.Envelope(0.0, 1000.0, 50)
    for start in range(1000):
        envelope.add(start + np.linspace(0.0, 0.999, 500), np.full(500, float(start == 777)))
        assert envelope._size <= 8 * 50 + 500
    time, value = envelope.curve()
    assert value.max() == 1.0 and 777.0 <= time[np.argmax(value)] < 778.0


# -- sums ---------------------------------------------------------------------------------------------------------

PIECES = st.lists(npst.arrays(float, st.integers(0, 20), elements=st.floats(-1e4, 1e4)), max_size=5)


@given(PIECES)
def test_moments_of_pieces_are_those_of_the_whole(pieces):
    moments = analysis.Moments()
    for piece in pieces:
        moments.add(piece)
    whole = np.concatenate([np.empty(0), *pieces])
    assert moments.count == whole.size
    if whole.size:
        # sums of at most 100 numbers of size 1e4, squared: some hundred roundings
        assert moments.mean == pytest.approx(whole.mean(), abs=1e-9)
        assert moments.deviation == pytest.approx(whole.std(), abs=1e-5)
        assert moments.rms == pytest.approx(math.sqrt((whole**2).mean()), abs=1e-5)
        assert abs(moments.peak) == np.abs(whole).max() and moments.peak in whole
    else:
        assert (moments.peak, moments.deviation) == (0.0, 0.0)


@given(npst.arrays(float, st.integers(1, 200), elements=st.floats(1e-6, 1e4)), st.floats(0.01, 1.0))
def test_quantiles_of_intervals_are_those_of_the_samples_to_a_bin(interval, share):
    intervals = analysis.Intervals()
    intervals.add(interval)
    exact = np.sort(interval)[math.ceil(share * interval.size - 1e-9) - 1]
    # a bin is 10^(1/200) = 1.2 % wide
    assert intervals.quantile(share) == pytest.approx(exact, rel=0.012)
    assert intervals.longest == interval.max()


def test_equal_intervals_are_told_exactly_and_none_is_nan():
    intervals = analysis.Intervals()
    assert math.isnan(intervals.quantile(0.5))
    intervals.add(np.array([0.002, 0.002, -1.0, 0.0, math.nan, 0.002]))
    assert [intervals.quantile(share) for share in (0.01, 0.5, 0.99)] == pytest.approx([0.002] * 3, rel=1e-15)


@given(st.data())
def test_the_mean_of_a_held_input_is_its_integral(data):
    """Held samples as sums over a fine grid of 1/64 s, on which all times lie."""
    step = 1.0 / 64.0
    moments = np.array(sorted(data.draw(st.sets(st.integers(0, 60), min_size=1, max_size=12))))
    values = data.draw(npst.arrays(float, moments.size, elements=st.integers(-50, 50).map(float)))
    ticks = np.array(sorted(data.draw(st.sets(st.integers(1, 64), min_size=2, max_size=12))))
    grid = np.full(64, math.nan)
    for moment, value in zip(moments, values, strict=True):
        grid[moment:] = value
    exact = [grid[a:b].mean() for a, b in zip(ticks[:-1], ticks[1:], strict=True)]
    cut = data.draw(st.integers(0, ticks.size))
    held = analysis.HeldInput()
    last = ticks[cut - 1] if cut else 0
    first = moments <= last
    means = [
        held.mean(moments[first] * step, values[first], ticks[:cut] * step),
        held.mean(moments[~first] * step, values[~first], ticks[cut:] * step),
    ]
    found = np.concatenate(means)
    assert math.isnan(found[0])  # before the first tick there is no interval
    # sums of a dozen numbers below 50
    np.testing.assert_allclose(found[1:], exact, rtol=0, atol=1e-10)


def test_the_moment_of_the_highest_value_is_kept_whole_across_blocks():
    time = np.arange(0.0, 20.0, 0.01)
    value = np.sin(time) + np.where(np.abs(time - 11.0) < 0.004, 5.0, 0.0)
    moment = analysis.Moment(0.5, 1.0, [float, object])
    for block in np.array_split(np.arange(time.size), 37):
        marks = np.empty(block.size, object)
        marks[:] = [f"at {t:.2f}" for t in time[block]]
        moment.add((time[block], value[block]), (time[block], marks))
    (kept, values), (marked, marks) = moment.curves()
    inside = (time >= moment.time - 0.5) & (time <= moment.time + 1.0)
    assert moment.time == pytest.approx(11.0) and moment.peak == value.max()
    np.testing.assert_array_equal(kept, time[inside])
    np.testing.assert_array_equal(values, value[inside])
    assert marks.tolist() == [f"at {t:.2f}" for t in time[inside]] and marked.size == kept.size


# -- spectra ------------------------------------------------------------------------------------------------------

RATE, NATURAL, DAMPING = 500.0, 12.0, 0.3  # [Hz], [Hz], [-]


def oscillator(frequency):
    ratio = frequency / NATURAL
    return 1.0 / (1.0 - ratio**2 + 2j * DAMPING * ratio)


@pytest.fixture(scope="module")
def oscillation():
    """A minute of white noise, held over each step, and the exact motion of an oscillator under it."""
    omega = 2.0 * math.pi * NATURAL
    system = (np.array([[0.0, 1.0], [-(omega**2), -2.0 * DAMPING * omega]]), np.array([[0.0], [omega**2]]))
    A, B, C, D, _ = signal.cont2discrete((*system, np.array([[1.0, 0.0]]), np.zeros((1, 1))), 1.0 / RATE, "zoh")
    u = np.random.default_rng(3).normal(0.0, 100.0, round(60 * RATE))
    _, y, _ = signal.dlsim((A, B, C, D, 1.0 / RATE), u)
    return np.arange(u.size) / RATE, u, y[:, 0]


def estimated(oscillation, cuts=()):
    spectra = analysis.Spectra(RATE, 1024)
    for some in np.split(np.arange(oscillation[0].size), cuts):
        spectra.add(*(column[some] for column in oscillation))
    return spectra.transfer()


def test_the_transfer_that_is_seen_is_the_closed_form(oscillation):
    seen = estimated(oscillation)
    assert seen.segments == (30_000 - 1024) // 512 + 1
    low = seen.frequency < 0.15 * RATE
    # Images of a held white input, which are what is left, are (f/(500 - f))^3 < 0.6 % of the response there; Hann's
    # window of 2 s blurs what is 2 zeta f = 7 Hz wide over 1 Hz: some per cent, and as much in coherence.
    np.testing.assert_allclose(seen.response[low], oscillator(seen.frequency[low]), rtol=0.05)
    assert np.median(np.abs(seen.response[low] / oscillator(seen.frequency[low]) - 1.0)) < 0.01
    assert seen.coherence[low].min() > 0.99 and seen.coherence.max() <= 1.0
    # White noise of variance 1e4 has its density spread over RATE/2; 57 segments overlapping by half, 2.5 per segment
    # of degrees of freedom, leave 1/sqrt(50) = 14 % at one frequency, and a tenth of that in the mean of all.
    assert seen.input.mean() == pytest.approx(1e4 / (RATE / 2.0), rel=0.05)


@settings(max_examples=8)
@given(cuts=st.sets(st.integers(1, 29_999), max_size=6))
def test_spectra_of_blocks_are_those_of_the_whole(oscillation, cuts):
    whole, blocks = estimated(oscillation), estimated(oscillation, sorted(cuts))
    assert blocks.segments == whole.segments
    for one, other in zip(whole[:5], blocks[:5], strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-9)


def test_a_gap_begins_a_new_stretch_and_few_missing_samples_are_filled_in(oscillation):
    time, u, y = oscillation
    rest = np.r_[:6000, 6100:30_000]
    assert estimated([column[rest] for column in oscillation]).segments == (
        (6000 - 1024) // 512 + 1 + (23_900 - 1024) // 512 + 1
    )
    some = np.delete(np.arange(30_000), np.arange(500, 29_000, 1000))
    seen = estimated((time[some], u[some], y[some]))
    assert seen.segments == estimated(oscillation).segments
    low = seen.frequency < 2.0 * NATURAL
    # one load in a thousand is another: its share in the power is 1e-3, of random phase
    np.testing.assert_allclose(np.abs(seen.response[low]), np.abs(oscillator(seen.frequency[low])), rtol=0.08)


def test_too_short_a_drive_has_no_spectrum():
    spectra = analysis.Spectra(RATE, 1024)
    spectra.add(np.arange(1000) / RATE, np.ones(1000), np.ones(1000))
    assert spectra.transfer() is None


@pytest.mark.parametrize(("rate", "duration", "length"), [(500.0, 3600.0, 1024), (500.0, 4.0, 256), (10.0, 0.1, 64)])
def test_segments_are_2_s_or_an_eighth_of_the_drive(rate, duration, length):
    assert analysis.segment_length(rate, duration) == length


# -- what repeats with the turn -----------------------------------------------------------------------------------

LONGEST = 0.25  # [s] for which a speed is held


def angles_by_hand(samples, ticks):
    """Sample by sample: measured if new, else from the speed, else from 0 on in a stretch of its own."""
    known, before, seen, lost = [], None, math.nan, 0
    for time, speed, position in samples:
        if math.isfinite(position) and position != seen:
            angle, stretch = position, analysis.MEASURED
        elif before is None or time - before[0] > LONGEST:
            lost += 1
            angle, stretch = 0.0, lost
        else:
            angle, stretch = before[2] + before[1] * (time - before[0]), before[3]
        seen = position if math.isfinite(position) else seen
        before = (time, speed, angle, stretch)
        known.append(before)
    for tick in ticks:
        last = [each for each in known if each[0] <= tick]
        yield (last[-1][2] + last[-1][1] * (tick - last[-1][0]), last[-1][3]) if last else (math.nan, 0)


@given(st.data())
def test_a_wheel_has_the_angle_that_was_measured_or_that_its_speed_makes(data):
    steps = data.draw(st.lists(st.sampled_from([0.01, 0.1, 0.2, 0.3, 1.0]), min_size=1, max_size=12))
    times = np.cumsum(steps)
    speeds = data.draw(npst.arrays(float, times.size, elements=st.floats(-50.0, 50.0)))
    positions = data.draw(npst.arrays(float, times.size, elements=st.sampled_from([math.nan, 0.0, 0.0, 2.0, -3.0])))
    samples = np.stack([times, speeds, positions])
    ticks = np.cumsum(data.draw(st.lists(st.floats(0.001, 0.5), min_size=1, max_size=12)))
    cuts = sorted(data.draw(st.sets(st.integers(0, ticks.size), max_size=3)))
    angle = analysis.WheelAngle(LONGEST)
    found = []
    for some in np.split(ticks, cuts):
        # a block has the samples that came with its ticks; some are of a time that no tick has reached
        given_now = samples[0] <= (some[-1] + data.draw(st.sampled_from([0.0, 0.3])) if some.size else 0.0)
        angle.add(*samples[:, given_now])
        samples = samples[:, ~given_now]
        found.append(angle.at(some))
    turned, _, stretch = (np.concatenate(column) for column in zip(*found, strict=True))
    expected = np.array(list(angles_by_hand(zip(times, speeds, positions, strict=True), ticks)))
    # a dozen steps of at most 50 rad
    np.testing.assert_allclose(turned, expected[:, 0], rtol=0, atol=1e-10)
    np.testing.assert_array_equal(stretch[np.isfinite(turned)], expected[np.isfinite(turned), 1])


def test_a_clock_that_was_set_back_begins_the_angle_anew():
    angle = analysis.WheelAngle(LONGEST)
    angle.add(np.array([10.0]), np.array([5.0]), np.array([1.0]))
    assert angle.at(np.array([10.1]))[0] == pytest.approx([1.5])
    angle.add(np.array([2.0]), np.array([5.0]), np.array([3.0]))
    assert math.isnan(angle.at(np.array([2.1]))[0][0])
    angle.add(np.array([2.2]), np.array([5.0]), np.array([4.0]))
    assert angle.at(np.array([2.3]))[0] == pytest.approx([4.5])


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32), cuts=st.lists(st.integers(0, 20_000), max_size=4))
def test_the_error_of_a_harmonic_is_that_of_its_noise(seed, cuts):
    """White noise at even angles: an amplitude is known to sigma sqrt(2/N), sqrt(3/2) times that with Hann's window."""
    turns, sigma, per_turn = 200, 30.0, 100
    phi = 2.0 * math.pi / per_turn * np.arange(turns * per_turn + 1)
    force = 4000.0 + 20.0 * np.cos(2.0 * phi - 1.0) + np.random.default_rng(seed).normal(0.0, sigma, phi.size)
    orders = analysis.Orders()
    for some in np.split(np.arange(phi.size), sorted(cuts)):
        orders.add(phi[some], force[some])
    found, error = orders.variation()
    expected = 2.0 * sigma * math.sqrt(1.5 * 2.0 / (turns * per_turn))
    # of 20 stretches, each harmonic's error has 38 degrees of freedom: 11 %, all ten together 4 %
    assert np.sqrt((error**2).mean()) == pytest.approx(expected, rel=0.25)
    # 20 numbers, none beyond five deviations
    truth = np.where(np.arange(1, 11) == 2, 40.0 * np.exp(-1j), 0.0)
    seen = found.peak_to_peak * np.exp(-1j * np.arange(1, 11) * found.phase)
    assert np.abs((seen - truth).view(float)).max() < 5.0 * expected


def test_a_load_that_drifts_is_no_harmonic():
    phi = np.linspace(0.0, 400.0, 20_000)
    orders = analysis.Orders()
    orders.add(phi, 3000.0 + 5.0 * phi)
    # The Fourier series of a line that rises by s in a turn has 2 s/(pi j) peak to peak; Hann's window over M turns
    # makes 1/k - 1/(2 (k - 1)) - 1/(2 (k + 1)) = -1/(k (k^2 - 1)) of 1/k, k = j M. Here s = 10 pi N, M = 10.
    j = np.arange(1, 11)
    np.testing.assert_allclose(orders.variation()[0].peak_to_peak, 20.0 / j / ((10.0 * j) ** 2 - 1.0), rtol=1e-3)


def test_few_turns_are_told_without_errors():
    phi = np.linspace(3.0, 20.0, 300)
    orders = analysis.Orders()
    orders.add(phi[:100], 4000.0 + 5.0 * np.cos(phi[:100]))
    orders.add(phi[100:], 4000.0 + 5.0 * np.cos(phi[100:]))
    found, error = orders.variation()
    assert found.peak_to_peak[0] == pytest.approx(10.0) and found.turns == pytest.approx(17.0 / (2.0 * math.pi))
    assert np.isnan(error).all()


def test_what_is_driven_slowly_counts_no_more():
    """Half the turns at a tenth of the speed, with another force: the mean of both."""
    phi = np.concatenate([np.arange(0.0, 600.0, 0.02), np.arange(600.0, 1200.0, 0.2)])
    force = np.where(phi < 600.0, 10.0, 30.0) * np.cos(phi)
    orders = analysis.Orders()
    orders.add(phi, force)
    # 1200 rad are 190.99 turns, of which 190 are taken; the last stretch of slow ones is 0.5 of 10 turns
    assert orders.variation()[0].peak_to_peak[0] == pytest.approx(40.0, rel=0.02)


# -- what the model says ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["inextensional", "complete"])
@pytest.mark.parametrize("damping", ["modal", "reaction"])
def test_steady_is_what_an_equilibrium_has(model, damping):
    unit = TireWheelUnit.table_1(sidewall_damping=damping)
    at_rest = wheel.equilibrium(unit, 200.0, 1000.0, model=model)
    # two ways through the same matrices, of condition 1e5
    expected = wheel.axle_force(unit, 200.0, at_rest, model)[1] / 1000.0
    assert theory.steady(unit, 200.0, model) == pytest.approx(expected, rel=1e-9)


def test_a_response_without_bound_is_none():
    unit = TireWheelUnit.table_1(zeta_1=0.0, zeta_s=0.0)
    poles = np.linalg.eigvals(wheel.fixed_frame_matrix(unit, 0.0)).imag
    found = theory.load_to_force(unit, 0.0, np.array([1.0, poles.max() / (2.0 * math.pi)]))
    assert found.shape == (2,)


def test_the_campbell_diagram_begins_with_the_frequencies_at_rest():
    unit = TireWheelUnit.table_1()
    diagram = theory.campbell(unit, 200.0)
    # MODEL, table of section 5: the waves n = 2, 3 of the inextensional model [Hz], to its four digits
    for n, frequency in ((2, 91.7443), (3, 112.5610)):
        for direction in ("backward", "forward"):
            # damped: sqrt(1 - zeta_n^2) of it
            damped = frequency * math.sqrt(1.0 - unit.zeta_n**2)
            assert diagram.frequency[f"n_{n}_{direction}"][0] == pytest.approx(damped, abs=1e-4)
    assert all((decay > 0.0).all() for decay in diagram.decay.values())


def test_the_stability_map_holds_the_critical_speed():
    unit = TireWheelUnit.table_1(sidewall_damping="reaction")
    grid, critical = theory.stability_around(unit, 60.0)
    assert critical == wheel.critical_speed(unit)
    assert grid.x[0] < critical < grid.x[-1] and grid.y[0] < unit.zeta_1 < grid.y[-1]
    assert theory.verdict_of(unit, [0.0, 60.0])[0] == "asymptotically stable"
    assert theory.verdict_of(unit, [60.0, 1.01 * critical]) == ("unstable", [1.01 * critical])


# -- a drive ------------------------------------------------------------------------------------------------------


def drive_of(bag: Path, folder: Path, **options) -> Drive:
    replay(bag, folder / "log", **options)
    return gather(BagReader(folder / "log"), BagReader(bag), replayed=True)


@pytest.fixture(scope="module")
def sample(tmp_path_factory) -> Drive:
    return drive_of(SAMPLE, tmp_path_factory.mktemp("sample"), config=VEHICLE)


def test_what_is_gathered_is_what_the_bag_holds(sample):
    assert [each.name for each in sample.wheels] == WHEELS
    assert sample.duration == pytest.approx(19.998)  # the last load of 20 s at 500 Hz
    assert {each.topic: each.messages for each in sample.inputs} == {
        "/joint_states": 2000,
        **{f"/{name}/load": 10_000 for name in WHEELS},
    }
    assert not any(+each.counts for each in sample.inputs)
    for each in sample.wheels:
        assert (each.outputs, each.missing, each.gaps) == (10_000, 0.0, [])
        assert each.numbers["load_z"].count == each.numbers["axle_z"].count == 10_000
    front = sample.wheels[0]
    time, load = front.curves["load_z"].curve()
    assert load.max() == front.numbers["load_z"].high == front.moment.peak
    assert front.moment.time == pytest.approx(12.0, abs=0.004)  # the cleat: test_sample_bag


def test_the_sample_drive_passes_loads_on_as_the_linear_model_does(sample):
    for each in sample.wheels:
        seen = each.spectra.transfer()
        band = (seen.frequency > 15.0) & (seen.frequency < 95.0)
        mean = each.numbers["speed"].mean
        expected = theory.load_to_force(sample.unit, mean, seen.frequency[band])
        # 18 segments of a smooth spectrum, without noise: what is left is the window's blur
        np.testing.assert_allclose(np.abs(seen.response[band]), np.abs(expected), rtol=0.03)
        assert seen.coherence[band].min() > 0.98


def test_the_sample_drive_has_no_concerns(sample):
    found = summary(sample, wheel.critical_speed(sample.unit))
    assert found.level == "good" and found.headline.endswith("no concerns.")
    assert found.covered == [1.0] * 4 and set(found.verdicts) == {"asymptotically stable"}


def test_everything_that_is_wrong_is_told(tmp_path):
    drive = drive_of(wild(tmp_path / "in"), tmp_path)
    found = summary(drive, wheel.critical_speed(drive.unit))
    text = " ".join(finding.text for finding in found.findings)
    for words in ("no outputs for", "older than one received", "not finite", "negative loads", "no stamp", "modal"):
        assert words in text, words
    assert found.level == "warning" and max(found.covered) < 0.9


def test_what_is_wrong_with_stamps_and_values_is_counted(tmp_path):
    bag = InputBag(tmp_path / "in", ["wheel"])
    stamps = [0, 11, 20, 15, 20, 30, -50, 40, 1000, 50, 60]
    for k, late in enumerate(stamps):
        now = BEGIN + (k + 1) * 10_000_000
        stamp = 0 if late == 0 else BEGIN + late * 1_000_000
        bag.at(now).speed("wheel", 50.0).load("wheel", [4000.0, math.nan][k == 10], stamp=stamp)
    drive = drive_of(bag.close(), tmp_path)
    (load,) = (each for each in drive.inputs if each.topic.endswith("/load"))
    # 20 again is a repetition; 15 and -50 are older than 20 and 30; 1000 ms is ahead by more than the timeout of 200 ms
    expected = {"no stamp": 1, "repeated": 1, "out of order": 2, "in the future": 1, "not finite": 1}
    assert {reason: count for reason, count in load.counts.items() if count and reason != "late"} == expected


def test_an_unstable_tire_is_the_headline(tmp_path):
    unit = TireWheelUnit.table_1(zeta_1=0.5, sidewall_damping="reaction")
    write_unit(unit, tmp_path / "unit.yaml")
    speed = 1.05 * wheel.critical_speed(unit)
    bag = constant(tmp_path / "in", 1.0, speed=speed)
    found = summary(drive_of(bag, tmp_path, config=tmp_path / "unit.yaml"), wheel.critical_speed(unit))
    assert found.level == "bad" and "was unstable" in found.headline and found.verdicts == ["unstable"]


SPEED, MEAN = 47.0, 4000.0  # [rad/s], [N]
LOADS = {1: (200.0, 0.7), 3: (60.0, -1.1)}  # harmonic: amplitude [N] and phase [rad] at angle 0
REACTION = TireWheelUnit.table_1(sidewall_damping="reaction", zeta_s=0.3)


def rolling(folder: Path, rolls: float, zero: float | None = None, spare: float = 0.0) -> Path:
    """A wheel at constant speed under a load with two harmonics, held at 500 Hz.

    Its angle is ``zero`` at the begin and told in joint_states, or not at all; for ``spare`` seconds after a third of
    the drive there are no speeds.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    types = (store.types[f"{name}"] for name in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    header, time = types
    with BagWriter(folder) as bag:
        load = bag.add_topic("/wheel/load", messages.WRENCH_STAMPED)
        joints = bag.add_topic("/joint_states", messages.JOINT_STATE) if zero is not None else None
        speed = bag.add_topic("/wheel/wheel_speed", messages.FLOAT64) if zero is None else None
        wrench = messages.WrenchEncoder("axle")
        for k in range(round(rolls * 500.0)):
            now, phi = BEGIN + k * 2_000_000, SPEED * k / 500.0
            if k % 5 == 0 and not 0.0 <= k / 500.0 - rolls / 3.0 < spare:
                if joints is None:
                    bag.write(speed, now, now, messages.encode_float64(SPEED))
                else:
                    turned = math.remainder(zero + phi, 2.0 * math.pi)  # an encoder's, in (-pi, pi]
                    stamp = time(now // SECOND, now % SECOND)
                    fields = (header(stamp, ""), ["x", "wheel"], *(np.array([0.0, v]) for v in (turned, SPEED)))
                    message = store.types["sensor_msgs/msg/JointState"](*fields, np.zeros(0))
                    bag.write(joints, now, now, bytes(store.serialize_cdr(message, "sensor_msgs/msg/JointState")))
            force = MEAN + sum(size * math.cos(j * phi + phase) for j, (size, phase) in LOADS.items())
            bag.write(load, now, now, wrench.encode(now, 0.0, force))
    return folder


@pytest.mark.parametrize("zero", [None, 2.0], ids=["integrated", "measured"])
@pytest.mark.parametrize("model", ["inextensional", "complete"])
def test_harmonics_of_the_axle_force_are_those_of_the_frequency_response(tmp_path, zero, model):
    (tmp_path / "unit.yaml").write_text(
        "tire_dynamics: {ros__parameters: {tire: {sidewall_damping: reaction, zeta_s: 0.3}, model: " + model + "}}"
    )
    drive = drive_of(rolling(tmp_path / "in", 20.0, zero), tmp_path, config=tmp_path / "unit.yaml")
    (found,) = drive.wheels
    assert drive.unit == REACTION and found.measured == (zero is not None)
    f = np.array([j * SPEED / (2.0 * math.pi) for j in LOADS])
    held = np.sinc(f / 500.0) * np.exp(-1j * math.pi * f / 500.0)  # what holding does to a sine
    H = frequency_response(REACTION, SPEED, f, model)[:, :, 0].T * held
    phi = 0.0 if zero is None else zero
    for (variation, error), gain in zip((orders.variation() for orders in found.orders), H, strict=True):
        assert variation.turns > 135.0  # of 149.6 those in whole stretches; the last may lack a little
        for j, response in zip(LOADS, gain, strict=True):
            size, phase = LOADS[j]
            expected = 2.0 * size * response * np.exp(1j * (phase - j * phi))
            seen = variation.peak_to_peak[j - 1] * np.exp(-1j * j * variation.phase[j - 1])
            # [N] The transient at the begin, some 400 N exp(-t/0.07 s), under sin^2(pi t/1.3 s) of 10 turns, beside
            # half of 19 s. Images of what is held, at 500 Hz less the harmonic, are 5 % and passed on by 1e-3.
            assert abs(seen - expected) < 0.5
            assert error[j - 1] < 0.5
        rest = [j - 1 for j in range(1, 11) if j not in LOADS]
        assert variation.peak_to_peak[rest].max() < 0.5  # likewise


def test_an_angle_that_was_lost_begins_anew(tmp_path):
    drive = drive_of(rolling(tmp_path / "in", 12.0, None, spare=0.5), tmp_path)
    (found,) = drive.wheels
    # 4 s before, 7.5 s after
    assert not found.measured and found.orders[1].turns == pytest.approx(7.5 * SPEED / (2.0 * math.pi), rel=0.01)
    drive = drive_of(rolling(tmp_path / "measured", 12.0, 1.0, spare=0.5), tmp_path / "other")
    (found,) = drive.wheels
    assert found.measured and found.orders[1].turns == pytest.approx(11.7 * SPEED / (2.0 * math.pi), rel=0.01)


def test_errors_of_the_parameters_are_in_the_findings(sample):
    critical = wheel.critical_speed(sample.unit)
    for zeta, level, words in ((0.1, "good", "none of them is unstable"), (2.9, "warning", "% of them is unstable")):
        known = theory.Errors({"zeta_1": zeta}, None, 40, 1)
        highest = 60.0 if zeta < 1.0 else critical
        means = np.array([30.0, 30.0, 31.0, 31.0])
        band = theory.bands(sample.unit, known, highest, np.array([0.0, 60.0]), means, np.array([1.0, 10.0]))
        (finding,) = (each for each in summary(sample, critical, known, band).findings if "zeta_1" in each.text)
        assert finding.level == level and words in finding.text


def test_of_a_tire_that_is_not_uniform_it_says_what_is_its_mean_s(sample):
    uneven = {"tire.radial_nonuniformity": (2.0, 0.4, 0.0), "tire.imbalance_mass": 0.05}
    drive = dataclasses.replace(sample, parameters={**sample.parameters, **uneven})
    grid, critical = theory.stability_around(drive.unit, 66.0)
    np.testing.assert_array_equal(grid.abscissa, theory.stability_around(sample.unit, 66.0)[0].abscissa)
    (finding,) = (each for each in summary(drive, critical).findings if "not uniform" in each.text)
    assert finding.level == "note" and "tongue" in finding.text
    drive.parameters["tire.radial_nonuniformity"] = ()  # an imbalance turns, but makes no tongues
    (finding,) = (each for each in summary(drive, critical).findings if "not uniform" in each.text)
    assert "tongue" not in finding.text


def test_a_gap_is_missing_time(tmp_path):
    bag = InputBag(tmp_path / "in", ["wheel"])
    for k in [*range(100), *range(200, 300)]:
        bag.at(BEGIN + k * 10_000_000).speed("wheel", 50.0).load("wheel", 4000.0)
    drive = drive_of(bag.close(), tmp_path)
    found = summary(drive, None)
    # silent from 0.99 to 2 s, of which the first 0.2 s, the timeout, are bridged
    assert drive.wheels[0].missing == pytest.approx(0.81, abs=0.01)
    assert found.covered[0] == pytest.approx(1.0 - 0.81 / 2.99, abs=0.005)


@pytest.mark.parametrize(
    ("value", "text"), [(2e-6, "2 \u00b5s"), (0.0021, "2.1 ms"), (20.0, "20 s"), (900.0, "15 min"), (7200.0, "2 h")]
)
def test_times_have_their_unit(value, text):
    assert seconds(value) == text
    assert seconds(math.nan) == number(math.inf) == "-"


# -- the command --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Path:
    pytest.importorskip("plotly", reason="plotly is not installed: the extra `report` brings it")
    path = tmp_path_factory.mktemp("page") / "report.html"
    done = called("report", SAMPLE, "-o", path, "--config", VEHICLE)
    assert done.returncode == 0 and done.stdout == "" and "no concerns" in done.stderr
    return path


MODAL = TireWheelUnit.table_1()
UNCERTAIN = {"fields": ["k_1", "zeta_1"], "relative_errors": [0.05, 0.1], "correlation": [[1.0, 0.5], [0.5, 1.0]]}


@pytest.fixture(scope="module")
def uncertain(tmp_path_factory) -> Path:
    """A page with bands, of one wheel whose angle is known; beside it the log, the unit and its errors."""
    pytest.importorskip("plotly", reason="plotly is not installed: the extra `report` brings it")
    folder = tmp_path_factory.mktemp("uncertain")
    write_unit(MODAL, folder / "unit.yaml")
    values = [value_of(MODAL, name) for name in UNCERTAIN["fields"]]
    (folder / "unit.errors.json").write_text(json.dumps({**UNCERTAIN, "values": values}))
    replay(rolling(folder / "in", 10.0, 2.0), folder / "log", config=folder / "unit.yaml")
    options = "--errors", folder / "unit.errors.json", "--samples", "60", "--seed", "3"
    assert called("report", folder / "log", "-o", folder / "page.html", *options).returncode == 0
    return folder / "page.html"


class Elements(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found, self.ids, self.scripts, self.texts, self._script = [], [], [], [], False

    def handle_starttag(self, tag, attributes):
        self.found.append((tag, dict(attributes)))
        self.ids += [value for name, value in attributes if name == "id"]
        self._script = tag == "script"
        if self._script:
            self.scripts.append("")

    def handle_endtag(self, tag):
        self._script = False

    def handle_data(self, data):
        if self._script:
            self.scripts[-1] += data
        else:
            self.texts.append(data)


def elements(page: Path) -> Elements:
    parser = Elements()
    parser.feed(page.read_text(encoding="utf-8"))
    return parser


def test_the_page_refers_to_nothing_but_itself(page):
    found = elements(page)
    for tag, attributes in found.found:
        for name in ("src", "href", "action", "data", "poster", "srcset"):
            assert attributes.get(name, "#").startswith(("#", "data:")), (tag, attributes)
    text = page.read_text(encoding="utf-8")
    styles = re.findall(r"<style>(.*?)</style>", text, re.DOTALL)
    assert len(styles) == 1 and "url(" not in styles[0] and "@import" not in styles[0]
    assert text.count("plotly.js v") == 1 and len(found.scripts) == 3
    assert len(set(found.ids)) == len(found.ids)
    assert "{{" not in text.replace(found.scripts[1], "")
    assert page.stat().st_size < 10e6


def test_the_figures_are_what_plotly_takes(page):
    from plotly import graph_objects

    data = json.loads(elements(page).scripts[0])
    assert data["wheels"] == WHEELS and len(data["belts"]) == 4
    for name, figure in data["figures"].items():
        text = re.sub(r'"\$\w+"', '"#123456"', json.dumps(figure))
        made = graph_objects.Figure(json.loads(text))  # refuses what it does not know
        assert len(made.data), name
        axes = [axis for axis in made.layout if re.match("[xy]axis", axis)]
        assert name == "coverage" or all(made.layout[axis].title.text for axis in axes)


def typed(values) -> np.ndarray:
    return np.frombuffer(base64.b64decode(values["bdata"]), values["dtype"])


def test_errors_of_the_parameters_are_bands(uncertain, page):
    errors = dict(zip(UNCERTAIN["fields"], UNCERTAIN["relative_errors"], strict=True))
    options = {"samples": 60, "seed": 3}
    expected = bands(MODAL, SPEED, errors, UNCERTAIN["correlation"], **options)
    figures = json.loads(elements(uncertain).scripts[0])["figures"]
    # numbers of 4 bytes
    (bar,) = (each for each in figures["stability"]["data"] if "within the errors" in each.get("name", ""))
    assert typed(bar["x"]) == pytest.approx(expected.critical_speed[[0, 2]] / theory.RPM, rel=1e-6)
    band = figures["steady"]["data"][0]
    x, y = typed(band["x"]), typed(band["y"])
    low, high = y[x == x.max()][[1, 0]]  # once there, once back
    assert x.max() == pytest.approx(SPEED / theory.RPM)
    K = [
        wheel.transmissibility(each, SPEED) for each in sample_units(MODAL, errors, UNCERTAIN["correlation"], **options)
    ]
    assert (low, high) == pytest.approx(np.quantile(K, [0.05, 0.95]), rel=1e-6)
    (response,) = (each for each in figures["spectra"]["data"] if each["legendgroup"] == "errors" and "fill" in each)
    below, above = typed(response["y"])[[-1, 0]]
    gains = [abs(frequency_response(each, SPEED, typed(response["x"])[0])[1, 0]) for each in
             sample_units(MODAL, errors, UNCERTAIN["correlation"], **options)]  # fmt: skip
    assert (below, above) == pytest.approx(np.quantile(gains, [0.05, 0.95]), rel=1e-5)
    text = uncertain.read_text(encoding="utf-8")
    low, _, high = (number(speed / theory.RPM) for speed in expected.critical_speed)
    assert f"With errors of k_1 5 %, zeta_1 10 % the critical speed is {low} to {high} rpm" in text
    assert f"5 to 95 %: {low} to {high} rpm" in text and "in brackets 5 to 95 %" in text
    # and without errors nothing of it
    assert "steady" not in (without := json.loads(elements(page).scripts[0])["figures"])
    assert "errors" not in json.dumps(without) and "5 to 95" not in page.read_text(encoding="utf-8")


def test_a_tire_that_has_no_critical_speed_has_no_band_of_it():
    unit = TireWheelUnit.table_1(zeta_1=0.0)
    band = theory.bands(
        unit, theory.Errors({"wheel_mass": 0.1}, None, 5, 0), 60.0, np.array([60.0]), np.array([60.0]), np.array([1.0])
    )
    assert critical_range(band) == "none" and band.whole.never == 1.0


def test_the_page_tells_harmonics_and_phases(uncertain, page):
    figures = json.loads(elements(uncertain).scripts[0])["figures"]
    vertical, along = figures["variation"]["data"]
    assert (vertical["yaxis"], along["yaxis"]) == ("y", "y2")
    size = typed(vertical["y"])
    assert (
        size.size == 10
        and (np.argsort(size)[:-3:-1] == [0, 2]).all()
        and typed(vertical["error_y"]["array"]).size == 10
    )
    # the table has the same number, and below it the phase: of both harmonics, as they stand clear of their errors
    text = uncertain.read_text(encoding="utf-8")
    row = re.search(r"<h3>Axle force z.*?<tr data-wheel=\"0\">(.*?)</tr>", text, re.DOTALL)[1]
    cells = re.findall(r"<td>(.*?)</td>", row)
    assert re.fullmatch(rf"{number(size[0])} \u00b1 [\d.]+<small>\d+\u00b0</small>", cells[2])
    assert re.search(r"<small>\d+\u00b0</small>", cells[4])
    assert "has no angle" not in text and "Of all wheels the log has no angle" in page.read_text(encoding="utf-8")


HOSTILE = "</script><script>alert('1')</script>\"&amp;{{ 7 * 7 }}"


def test_hostile_names_stay_text(tmp_path):
    """Of the drive, a topic, a parameter, a wheel; what the scripts read is the JSON that went in."""
    pytest.importorskip("plotly", reason="plotly is not installed: the extra `report` brings it")
    drive = drive_of(constant(tmp_path / "in", 0.5), tmp_path)
    drive.wheels[0].name = drive.name = drive.parameters["wheels"] = HOSTILE
    drive.topics[HOSTILE] = "a/msg/b", 1
    drive.doubts.append(HOSTILE)
    text, _ = page_of(drive)
    (tmp_path / "page.html").write_text(text, encoding="utf-8")
    found = elements(tmp_path / "page.html")
    assert f"{HOSTILE} - tire_dynamics report" in found.texts
    assert found.texts.count(HOSTILE) >= 5  # heading, button, tables
    assert len(found.scripts) == 3 and json.loads(found.scripts[0])["wheels"] == [HOSTILE]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("stamp", [0, 2**30 * SECOND, -(2**30) * SECOND])
def test_a_log_full_of_nonsense_makes_a_page_that_says_so(tmp_path, stamp):
    pytest.importorskip("plotly", reason="plotly is not installed: the extra `report` brings it")
    replay(constant(tmp_path / "in", 0.1), tmp_path / "log")
    _, _, begin, _, record = next(BagReader(tmp_path / "log").messages(["/tire_dynamics/log_record"]))
    wrench = messages.WrenchEncoder("axle")
    with BagWriter(tmp_path / "bad") as bag:
        kinds = BagReader(tmp_path / "log").topics
        topics = {name: bag.add_topic(name, kind) for name, kind in kinds.items()}
        bag.write(topics["/tire_dynamics/log_record"], begin, begin, record)
        for k in range(40):
            now = begin + k * 2_000_000
            bag.write(topics["/tire_dynamics/tick"], now, now, messages.encode_clock(stamp or now))
            bag.write(topics["/wheel/load"], now, now, wrench.encode(stamp, math.nan, 1e300))
            bag.write(topics["/wheel/wheel_speed"], now, now, messages.encode_float64([math.nan, -1e9][k % 2]))
            for value in (math.inf, 1e300, 2000.0):
                bag.write(topics["/wheel/axle_wrench"], now, now, wrench.encode(stamp or now, 0.0, value))
            bag.write(topics["/wheel/ring_deflection"], now, now, b"\0\1\0\0" + b"\xff" * 40)
    done = called("report", tmp_path / "bad", "-o", tmp_path / "page.html")
    assert done.returncode == 0 and "No speed is known" in done.stderr
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "80 axle forces are malformed or not finite" in text and "40 of 40 messages are not finite" in text


def test_a_log_is_reported_as_it_is_and_with_other_parameters_replayed(tmp_path):
    pytest.importorskip("plotly", reason="plotly is not installed: the extra `report` brings it")
    constant(tmp_path / "in", 1.0)
    replay(tmp_path / "in", tmp_path / "log")
    assert has_outputs(BagReader(tmp_path / "log")) and not has_outputs(BagReader(tmp_path / "in"))
    done = called("report", tmp_path / "log", "-o", tmp_path / "log.html", "--json")
    assert json.loads(done.stdout)["bytes"] == (tmp_path / "log.html").stat().st_size and done.stderr == ""
    assert "a log, as it was recorded" in (tmp_path / "log.html").read_text(encoding="utf-8")
    assert called("report", tmp_path / "log", "-o", tmp_path / "new.html", "--config", VEHICLE).returncode == 2
    write_unit(TireWheelUnit.table_1(zeta_1=0.1), tmp_path / "unit.yaml")
    done = called("report", tmp_path / "log", "-o", tmp_path / "new.html", "--config", tmp_path / "unit.yaml")
    assert done.returncode == 0
    assert "replayed for this report" in (tmp_path / "new.html").read_text(encoding="utf-8")


def test_what_cannot_be_used_is_refused_with_one_line(tmp_path):
    pytest.importorskip("plotly", reason="plotly is not installed: the extra `report` brings it")
    bag = constant(tmp_path / "in", 0.5)
    for options, words in (
        (["--samples", "0"], "--samples is 0"),
        (["--samples", "9"], "needs errors"),
        (["--errors", tmp_path / "none.json"], "there is no such file"),
        (["--error", "zeta_1"], "FIELD=VALUE"),
        (["--error", "zeta_1=5%", "--seed", "-1"], "--seed is -1"),
        (["--errors", bag / "metadata.yaml"], "is no file of errors"),
    ):
        assert words in refused("report", bag, "-o", tmp_path / "page.html", *options)
    assert "its name must end in .html" in refused("report", bag, "-o", tmp_path / "page.pdf")
    assert "no such folder" in refused("report", bag, "-o", tmp_path / "none" / "page.html")
    assert "does not exist" in refused("report", tmp_path / "none", "-o", tmp_path / "page.html")
    assert "never changed" in refused("report", bag, "-o", bag / "page.html")
    (tmp_path / "page.html").write_text("mine")
    assert "exists already (--force replaces it)" in refused("report", bag, "-o", tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text() == "mine"
    assert called("report", bag, "-o", tmp_path / "page.html", "--force").returncode == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "page.html"]


@pytest.mark.parametrize("missing", ["plotly", "jinja2"])
def test_without_what_the_page_is_made_with_it_says_how_to_get_it(tmp_path, monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    assert "pip install 'tire_dynamics[report]'" in refused("report", SAMPLE, "-o", tmp_path / "page.html")


# -- in a browser -------------------------------------------------------------------------------------------------

QUIET = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip


@pytest.fixture(scope="module")
def browser():
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: extra `test`")
    names = ("chromium", "chromium-browser", "google-chrome")
    program = next(filter(None, map(shutil.which, names)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(names)} is on the PATH")
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=program, args=list(QUIET))
        yield chromium
        chromium.close()


@contextlib.contextmanager
def opened(browser, page, size, scheme="light"):
    """The page from disk, with no network; fails if the browser has anything to say, or asks for anything else."""
    width, height = SIZES[size]
    said, asked = [], []
    context = browser.new_context(
        viewport={"width": width, "height": height}, color_scheme=scheme, offline=True, has_touch=size == "phone"
    )
    view = context.new_page()
    view.set_default_timeout(60_000)  # [ms], of each step: on a busy machine a chart takes its time
    view.on("console", lambda message: said.append(message.text))
    view.on("pageerror", lambda error: said.append(str(error)))
    view.on("request", lambda request: asked.append(request.url))
    view.goto(page.as_uri())
    view.wait_for_selector("html[data-ready=true]", state="attached")
    yield view
    context.close()
    assert said == []
    assert [url for url in asked if not url.startswith(("data:", "blob:"))] == [page.as_uri()]


def until(view, condition):
    """Wait for a condition in the page, asking from outside: the page's own policy forbids to evaluate texts."""
    for _ in range(600):
        if view.evaluate(condition):
            return
        view.wait_for_timeout(100)
    pytest.fail(f"never: {condition[:200]}")


def shown(view, figure):
    """By wheel, what is visible of a figure's traces."""
    data = f"document.getElementById('plot-{figure}').data"
    return view.evaluate(f"{data}.map(trace => [(trace.meta || {{}}).wheel, trace.legendgroup, trace.visible])")


@pytest.mark.parametrize(
    ("of", "size", "scheme"), [("page", "desktop", "light"), ("page", "phone", "dark"), ("uncertain", "phone", "light")]
)
def test_the_page_fits_and_draws_everything(browser, request, of, size, scheme):
    page = request.getfixturevalue(of)
    with opened(browser, page, size, scheme) as view:
        assert view.evaluate("document.documentElement.scrollWidth") == SIZES[size][0]
        for plot in view.query_selector_all(".plot"):
            box = plot.query_selector(".main-svg").bounding_box()
            assert box["x"] >= 0 and box["x"] + box["width"] <= SIZES[size][0] and box["height"] > 100
        assert view.locator("#verdict").inner_text().endswith("no concerns.")
        luminance = view.evaluate("getComputedStyle(document.body).color.match(/\\d+/g).map(Number)")
        assert (min(luminance) > 200) == (scheme == "dark")  # the ink


def test_the_controls_do_what_they_say(browser, page):
    with opened(browser, page, "desktop") as view:
        # wheels
        view.click(".chip[data-wheel='1']")
        for figure in ("forces", "spectra", "variation", "coverage"):
            assert {w: v for w, _, v in shown(view, figure) if w is not None} == {0: True, 1: False, 2: True, 3: True}
        assert view.get_attribute(".chip[data-wheel='1']", "aria-pressed") == "false"
        assert "off" in view.get_attribute("tr[data-wheel='1']", "class")

        # legend: hides a kind of line of every wheel, and a wheel that is hidden stays so when it comes back
        entry = view.locator("#plot-spectra .legendtoggle").nth(1)
        entry.click()
        until(view, "document.getElementById('plot-spectra').data.some(t => t.visible === 'legendonly')")
        model = [(w, v) for w, group, v in shown(view, "spectra") if group == "model" and w is not None]
        assert set(model) == {(0, "legendonly"), (1, False), (2, "legendonly"), (3, "legendonly")}
        view.click(".chip[data-wheel='1']")
        assert {v for w, group, v in shown(view, "spectra") if group == "model"} == {"legendonly"}
        view.wait_for_timeout(400)  # two clicks in a row would be a double click
        entry.click()
        until(view, "document.getElementById('plot-spectra').data.every(t => t.visible === true)")

        # belt: play, pause, slider, another wheel
        outline = "document.getElementById('plot-belt').data[1].y.join()"
        before, moment = view.evaluate(outline), view.inner_text("#moment")
        view.click("#play")
        until(view, f"{outline} !== {json.dumps(before)}")
        view.click("#play")
        assert "Play" in view.inner_text("#play") and view.inner_text("#moment") != moment
        view.locator("#frame").fill("3")
        assert view.evaluate("document.getElementById('plot-moment').layout.shapes[0].x0") == pytest.approx(
            float(view.inner_text("#moment").split(" s")[0]), abs=1e-3
        )
        view.select_option("#belt-wheel", "2")
        assert {w for w, _, v in shown(view, "moment") if v is True} == {2}

        # zoom: one axis of time under all five charts
        box = view.locator("#plot-forces .nsewdrag").first.bounding_box()
        x, y = box["x"], box["y"] + 0.5 * box["height"]
        view.locator("#forces").scroll_into_view_if_needed()
        box = view.locator("#plot-forces .nsewdrag").first.bounding_box()
        x, y = box["x"], box["y"] + 0.5 * box["height"]
        view.mouse.move(x + 0.25 * box["width"], y)
        view.mouse.down()
        view.mouse.move(x + 0.5 * box["width"], y, steps=4)
        view.mouse.up()
        until(view, "document.getElementById('plot-forces').layout.xaxis.range[0] > 4")
        low, high = view.evaluate("document.getElementById('plot-forces').layout.xaxis.range")
        assert (low, high) == pytest.approx((5.0, 10.0), abs=0.3)  # of 20 s; a pixel is 0.02 s, a drag begins late
        assert set(view.evaluate("document.getElementById('plot-forces').data.map(t => t.xaxis || 'x')")) == {"x"}

        # light and dark
        paper = "getComputedStyle(document.querySelector('section')).backgroundColor"
        light = view.evaluate(paper)
        view.click("#theme")
        assert view.evaluate(paper) != light
        assert view.evaluate("document.getElementById('plot-forces').layout.xaxis.range[0]") == pytest.approx(low)
        view.click("#summary details summary")
        assert view.locator("#summary details").first.get_attribute("open") is not None


def test_a_bag_in_which_little_can_be_shown_still_makes_a_page(browser, tmp_path):
    pytest.importorskip("plotly", reason="plotly is not installed: the extra `report` brings it")
    constant(tmp_path / "in", 0.1, begin=BEGIN + SECOND, speed=20.0)
    assert called("report", tmp_path / "in", "-o", tmp_path / "page.html").returncode == 0
    with opened(browser, tmp_path / "page.html", "phone") as view:
        assert "No segment of outputs is long enough" in view.inner_text("#spectra")
        assert (
            "wheel: 0.29 turns above 10 rpm" in view.inner_text("#variation")
            and not view.locator("#plot-variation").count()
        )


@given(st.floats(1.0, 1e6), st.floats(1.1, 1e4))
def test_axes_of_equal_ratios_have_ticks_within(low, ratio):
    from tire_dynamics.report.traces import log_axis

    assume(ratio > 10.0)
    axis = log_axis(low, low * ratio)
    assert axis["tickvals"] and all(low <= tick <= low * ratio for tick in axis["tickvals"])
