"""Force variation by harmonic: against least squares done directly, and by what turns, shifts and gaps must do."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tire_dynamics.science.uniformity import OrderSums, Variation

H = 10
SIZES = np.array([30.0, 12.0, 8.0, 5.0, 4.0, 3.0, 2.0, 2.0, 1.5, 1.0])  # amplitudes [N]
PHASES = 2.0 * math.pi * np.array([0.1, 0.45, 0.33, 0.2, 0.15, 0.01, 0.07, 0.03, 0.1, 0.09])  # < 2 pi/j [rad]


def series(phi, mean=4000.0, sizes=SIZES, phases=PHASES):
    j = np.arange(1, len(sizes) + 1)
    return mean + (sizes * np.cos(j * (np.asarray(phi)[:, None] - phases))).sum(axis=1)


def found(phi, force, harmonics=H, **options) -> Variation:
    sums = OrderSums(harmonics)
    sums.add(phi, force, **options)
    variation = sums.variation()
    assert variation is not None
    return variation


def close(one, other, j=None):
    """Angles of harmonics that are the same but for whole periods, [0, 2 pi/j)."""
    j = np.arange(1, H + 1) if j is None else j
    return np.abs(np.exp(1j * j * np.asarray(one)) - np.exp(1j * j * np.asarray(other))).max()


@st.composite
def rolls(draw):
    """Angles that go on by uneven steps through some turns, forward or backward, from anywhere."""
    chance = np.random.default_rng(draw(st.integers(0, 2**32)))
    turns = draw(st.floats(1.5, 6.0))
    steps = chance.uniform(0.2, 1.0, draw(st.integers(200, 500)))  # of 10 harmonics, 20 samples a turn are the least
    phi = np.cumsum(steps) / steps.sum() * 2.0 * math.pi * turns
    return draw(st.sampled_from([1.0, -1.0])) * phi + draw(st.floats(-100.0, 100.0))


# -- what it computes ---------------------------------------------------------------------------------------------


@given(phi=rolls(), seed=st.integers(0, 2**32))
def test_any_force_has_the_least_squares_of_the_whole(phi, seed):
    force = np.random.default_rng(seed).normal(4000.0, 300.0, phi.size)
    j = np.arange(1, H + 1)
    columns = np.concatenate([np.ones((phi.size, 1)), np.cos(j * phi[:, None]), np.sin(j * phi[:, None])], axis=1)
    solution = np.linalg.lstsq(columns, force, rcond=None)[0]
    variation = found(phi, force)
    # a condition of the normal equations of at most 100, on 4000 N: 1e-10
    assert variation.mean == pytest.approx(solution[0], abs=1e-9)
    phasor = solution[1 : H + 1] - 1j * solution[H + 1 :]
    np.testing.assert_allclose(
        0.5 * variation.peak_to_peak * np.exp(-1j * j * variation.phase), phasor, rtol=0, atol=1e-9
    )
    assert ((variation.phase >= 0.0) & (variation.phase < 2.0 * math.pi / j)).all()


@given(phi=rolls())
def test_a_series_is_found_to_rounding(phi):
    variation = found(phi, series(phi))
    assert variation.mean == pytest.approx(4000.0, abs=1e-9)
    np.testing.assert_allclose(variation.peak_to_peak, 2.0 * SIZES, rtol=0, atol=1e-9)
    # 1e-10 N beside 1 N; the angles themselves are rounded at 100 rad
    assert close(variation.phase, PHASES) < 1e-9
    fine = series(np.linspace(0.0, 2.0 * math.pi, 20_001))
    assert variation.whole == pytest.approx(np.ptp(fine), abs=2e-5 * 2.0 * SIZES.sum())  # as the docstring says


def test_a_phase_is_where_the_harmonic_is_highest():
    """By eye: the third of three crests of a cosine shifted by 0.2 rad."""
    phi = np.linspace(0.0, 13.0, 400)
    force = 10.0 * np.cos(3.0 * (phi - 0.2 - 4.0 * math.pi / 3.0))
    assert found(phi, force).phase[2] == pytest.approx(0.2)
    assert found(phi, -force).phase[2] == pytest.approx(0.2 + math.pi / 3.0)


def test_speed_may_vary_and_the_wheel_may_stop_and_turn_back():
    t = np.arange(0.0, 20.0, 0.002)
    phi = 40.0 * np.sin(0.3 * t) + 3.0 * np.sin(2.0 * t)  # stands still and goes back
    variation = found(phi, series(phi))
    np.testing.assert_allclose(variation.peak_to_peak, 2.0 * SIZES, rtol=0, atol=1e-9)
    assert close(variation.phase, PHASES) < 1e-9


# -- what must not matter, or matter in a known way -----------------------------------------------------------------


@given(phi=rolls(), seed=st.integers(0, 2**32), shift=st.floats(-10.0, 10.0), factor=st.floats(0.1, 10.0))
def test_zero_shifts_phases_and_factors_scale(phi, seed, shift, factor):
    force = np.random.default_rng(seed).normal(0.0, 10.0, phi.size)
    one, other = found(phi, force), found(phi + shift, factor * force + 100.0)
    np.testing.assert_allclose(other.peak_to_peak, factor * one.peak_to_peak, rtol=0, atol=1e-9)
    assert other.mean == pytest.approx(factor * one.mean + 100.0, abs=1e-8)
    clear = one.peak_to_peak > 0.1  # the phase of nothing is anything
    j = np.arange(1, H + 1)
    assert close(other.phase[clear], one.phase[clear] + shift, j[clear]) < 1e-8
    # the grid on which extremes are looked for shifts too
    assert other.whole == pytest.approx(factor * one.whole, rel=1e-4)


@given(phi=rolls(), seed=st.integers(0, 2**32), cuts=st.lists(st.integers(0, 500), max_size=5))
def test_blocks_and_their_order_and_whole_turns_do_not_matter(phi, seed, cuts):
    chance = np.random.default_rng(seed)
    force = chance.normal(4000.0, 10.0, phi.size)
    whole = found(phi, force)
    sums, turned = OrderSums(), OrderSums()
    pieces = np.split(np.arange(phi.size), sorted(min(cut, phi.size) for cut in cuts))
    for piece in pieces:
        sums.add(phi[piece], force[piece])
    wrapped = np.angle(np.exp(1j * phi))
    for k in chance.permutation(len(pieces)):
        turned.add(wrapped[pieces[k]], force[pieces[k]])
    assert sums.turns == pytest.approx(np.abs(np.diff(phi)).sum() / (2.0 * math.pi))
    for each in (sums.variation(), turned.variation()):
        assert each is not None
        np.testing.assert_allclose(each.peak_to_peak, whole.peak_to_peak, rtol=0, atol=1e-8)
        clear = whole.peak_to_peak > 0.1
        assert close(each.phase[clear], whole.phase[clear], np.arange(1, H + 1)[clear]) < 1e-7


def test_what_is_not_finite_is_left_out():
    phi = np.linspace(0.0, 30.0, 700)
    force = series(phi)
    force[::7], phi[3::50] = math.nan, math.inf
    variation = found(phi, force)
    np.testing.assert_allclose(variation.peak_to_peak, 2.0 * SIZES, rtol=0, atol=1e-9)
    assert variation.turns == pytest.approx(np.ptp(phi[np.isfinite(phi) & np.isfinite(force)]) / (2.0 * math.pi))


def test_a_weight_is_how_often_a_sample_counts():
    chance = np.random.default_rng(2)
    phi, force, weight = np.linspace(0.0, 25.0, 300), chance.normal(0.0, 1.0, 300), chance.integers(0, 4, 300)
    weighted, repeated = found(phi, force, weight=weight), found(np.repeat(phi, weight), np.repeat(force, weight))
    np.testing.assert_allclose(weighted.peak_to_peak, repeated.peak_to_peak, rtol=0, atol=1e-12)
    one, other = OrderSums(), OrderSums()
    one.add(phi[:100], force[:100], weight[:100])
    other.add(phi[100:], force[100:], weight[100:])
    one.merge(other)
    np.testing.assert_allclose(one.variation().peak_to_peak, weighted.peak_to_peak, rtol=0, atol=1e-12)
    one.clear()
    assert one.turns == 0.0 and one.variation() is None


# -- what cannot be told --------------------------------------------------------------------------------------------


@given(per_turn=st.floats(4.2, 25.0), turns=st.floats(30.0, 60.0))
def test_harmonics_beyond_half_the_samples_of_a_turn_are_not_told(per_turn, turns):
    """Samples at even steps; harmonics that are told are right if there are no others."""
    told = min(H, math.floor(per_turn / 2.0))
    phi = np.arange(0.0, turns * 2.0 * math.pi, 2.0 * math.pi / per_turn)
    # where a whole number of samples goes into few turns, the angles are few: then fewer are told
    assume(min(abs(per_turn * n - round(per_turn * n)) for n in range(1, 5)) > 0.05)
    variation = found(phi, series(phi, sizes=SIZES[:told], phases=PHASES[:told]))
    np.testing.assert_allclose(variation.peak_to_peak[:told], 2.0 * SIZES[:told], rtol=0, atol=1e-8)
    assert np.isnan(variation.peak_to_peak[told:]).all() and np.isnan(variation.phase[told:]).all()
    assert math.isfinite(variation.whole)


def test_angles_that_are_always_the_same_tell_little():
    """Eight angles: a cosine of the fourth harmonic is seen, its sine is not, and 5 looks like 3."""
    phi = np.arange(0.0, 400.0) * (2.0 * math.pi / 8.0)
    variation = found(phi, series(phi, sizes=SIZES[:3], phases=PHASES[:3]))
    np.testing.assert_allclose(variation.peak_to_peak[:3], 2.0 * SIZES[:3], rtol=0, atol=1e-9)
    assert np.isnan(variation.peak_to_peak[3:]).all()


def test_less_than_a_turn_or_a_part_of_the_wheel_tells_nothing():
    sums = OrderSums()
    assert sums.variation() is None and sums.turns == 0.0
    sums.add([], [])
    sums.add([1.0], [4000.0])
    assert sums.variation() is None
    sums.clear()
    phi = np.linspace(0.0, 0.99 * 2.0 * math.pi, 500)
    sums.add(phi, series(phi))
    assert sums.turns == pytest.approx(0.99) and sums.variation() is None
    sums.clear()
    rocking = 0.5 * np.sin(np.linspace(0.0, 300.0, 9000))
    sums.add(rocking, series(rocking))
    assert sums.turns > 10.0 and sums.variation() is None


def test_a_step_is_the_shorter_way_round():
    sums = OrderSums()
    sums.add([3.0, -3.0, -3.0 + 4.0 * math.pi, 3.0], np.zeros(4))
    assert sums.turns == pytest.approx(2.0 * (2.0 * math.pi - 6.0) / (2.0 * math.pi))


@pytest.mark.parametrize("harmonics", [0, 101])
def test_harmonics_are_from_1_to_100(harmonics):
    with pytest.raises(ValueError, match="from 1 to 100"):
        OrderSums(harmonics)


def test_rows_of_other_lengths_are_refused():
    sums = OrderSums()
    for rows in (([0.0, 1.0], [1.0]), ([[0.0]], [[1.0]]), ([0.0], [1.0], [1.0, 2.0])):
        with pytest.raises(ValueError, match="one length"):
            sums.add(*rows)
    with pytest.raises(ValueError, match="harmonics"):
        sums.merge(OrderSums(3))
