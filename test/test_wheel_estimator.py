"""One wheel through time: what each sample does, exact holding, gaps, and the same bits every time."""

from __future__ import annotations

import copy
import json
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from tire_dynamics import TireWheelUnit, simulate, wheel
from tire_dynamics.estimator.wheel_estimator import WheelEstimator

MS = 1_000_000  # ns
NOW = 1_800_000_000_000_000_000  # 2027 in ROS time [ns], beyond what a double can count
UNITS = {damping: TireWheelUnit.table_1(sidewall_damping=damping) for damping in ("modal", "reaction")}
both = pytest.mark.parametrize("unit", UNITS.values(), ids=UNITS)


@pytest.fixture
def estimator():
    return WheelEstimator(UNITS["modal"])


def started(unit=UNITS["modal"], speed=100.0, load=4000.0, traction=0.0, at=NOW, timeout=None):
    """An estimator in equilibrium at a time."""
    estimator = WheelEstimator(unit, timeout=timeout)
    estimator.add_speed(at, speed)
    estimator.add_load(at, load, traction)
    assert estimator.advance(at)
    return estimator


def exact(unit, speed, load, traction, state, seconds):
    """The fixed-frame state after an exact hold, by scipy's expm on scaled states, about the equilibrium."""
    scale = np.repeat([1.0, 1e3], 3)
    F = wheel.fixed_frame_matrix(unit, speed) * (scale[:, None] / scale)
    rest = wheel.equilibrium(unit, speed, load, traction)
    return rest + (expm(F * seconds) @ ((state - rest) * scale)) / scale


def assert_close(found, expected, relative=1e-11):
    """States alike: expm and the steps each err by some 1e-13 of the largest velocity (displacement times 500/s)."""
    scale = np.repeat([1.0, 500.0], 3)
    assert np.abs((found - expected) * scale).max() <= relative * np.abs(expected * scale).max()


# -- start ------------------------------------------------------------------------------------------------------


@both
@pytest.mark.parametrize("speed", [0.0, 150.0, -150.0])
def test_starts_at_equilibrium(unit, speed):
    estimator = started(unit, speed, 4000.0, 500.0)
    first = simulate(unit, [0.0], speed, 4000.0, 500.0)
    assert estimator.axle_force == pytest.approx(first.axle_force[0], rel=1e-13)  # the same sum in another order
    assert not estimator.state[:3].any()
    assert estimator.phase == 0.0
    held = np.array(estimator.axle_force)
    estimator.advance(NOW + 3600 * 1000 * MS)
    # in steady state an hour in one step changes nothing but the last digits, which stiffness magnifies 40 times
    assert np.abs(np.array(estimator.axle_force) - held).max() < 1e-11 * np.abs(held).max()


def test_no_motion_before_both_inputs(estimator):
    assert not estimator.advance(NOW)
    estimator.add_speed(NOW + MS, 10.0)
    assert not estimator.advance(NOW + 2 * MS)
    assert not estimator.running and estimator.ages() == (MS, None)
    estimator.add_load(NOW + 3 * MS, 4000.0)
    assert not estimator.advance(NOW + 3 * MS - 1)
    assert estimator.advance(NOW + 3 * MS)
    assert estimator.ages() == (2 * MS, 0)


def test_starts_at_the_moment_of_the_first_complete_set():
    """At the later of the two stamps, not at the tick that follows: from there on the hold is exact."""
    unit = UNITS["modal"]
    estimator = WheelEstimator(unit)
    estimator.add_load(NOW, 4000.0)
    estimator.add_speed(NOW + MS, 100.0)
    estimator.add_speed(NOW + 3 * MS, 200.0)
    estimator.advance(NOW + 10 * MS)
    start = wheel.equilibrium(unit, 100.0, 4000.0)
    assert_close(estimator.state, exact(unit, 200.0, 4000.0, 0.0, start, 7e-3))
    assert estimator.phase == pytest.approx(100.0 * 2e-3 + 200.0 * 7e-3, rel=1e-14)


def test_before_any_time_is_known_samples_may_come_in_any_order():
    a, b = WheelEstimator(UNITS["modal"]), WheelEstimator(UNITS["modal"])
    samples = [(NOW + k * MS, 50.0 + k) for k in range(6)]
    for stamp, speed in samples:
        assert a.add_speed(stamp, speed) == "taken"
    for stamp, speed in reversed(samples):
        assert b.add_speed(stamp, speed) == "taken"
    for estimator in (a, b):
        estimator.add_load(NOW, 4000.0)
        assert estimator.advance(NOW + 20 * MS)
    assert a.snapshot() == b.snapshot()


# -- every row of the table of outcomes -------------------------------------------------------------------------


def add(estimator, kind, stamp, value):
    return estimator.add_speed(stamp, value) if kind == "speed" else estimator.add_load(stamp, value)


def in_force(estimator, kind):
    return estimator.speed if kind == "speed" else estimator.load[0]


kinds = pytest.mark.parametrize("kind", ["speed", "load"])


@kinds
def test_taken(kind):
    """s > t: in force from s on, whatever order the samples came in."""
    estimator = started()
    assert add(estimator, kind, NOW + 6 * MS, 60.0) == "taken"
    assert add(estimator, kind, NOW + 2 * MS, 20.0) == "taken"
    before = 100.0 if kind == "speed" else 4000.0
    for stamp, expected in [(1, before), (2 * MS - 1, before), (2 * MS, 20.0), (6 * MS - 1, 20.0), (6 * MS, 60.0)]:
        estimator.advance(NOW + stamp)
        assert in_force(estimator, kind) == expected
    assert estimator.counts["taken"] == 4


@kinds
def test_taken_takes_effect_at_its_stamp(kind):
    """And not at the tick after it."""
    unit, estimator = UNITS["modal"], started(speed=100.0, load=4000.0)
    add(estimator, kind, NOW + 3 * MS, 150.0)
    estimator.advance(NOW + 10 * MS)
    speed, load = (150.0, 4000.0) if kind == "speed" else (100.0, 150.0)
    start = wheel.equilibrium(unit, 100.0, 4000.0)
    assert_close(estimator.state, exact(unit, speed, load, 0.0, start, 7e-3))


@kinds
@pytest.mark.parametrize("late_by", [0, 1, 3 * MS])
def test_late(kind, late_by):
    """k < s <= t: in force from t on; the past is not redone."""
    unit, estimator = UNITS["modal"], started()
    estimator.advance(NOW + 5 * MS)
    before = estimator.state
    assert add(estimator, kind, NOW + 5 * MS - late_by, 150.0) == "late"
    assert in_force(estimator, kind) == 150.0
    assert np.array_equal(estimator.state, before)
    estimator.advance(NOW + 9 * MS)
    speed, load = (150.0, 4000.0) if kind == "speed" else (100.0, 150.0)
    assert_close(estimator.state, exact(unit, speed, load, 0.0, before, 4e-3))
    assert estimator.counts["late"] == 1


@kinds
def test_repeated_in_force(kind):
    """s = k: replaces that sample from t on."""
    unit, estimator = UNITS["modal"], started()
    estimator.advance(NOW + 5 * MS)
    before = estimator.state
    assert add(estimator, kind, NOW, 150.0) == "repeated"
    assert in_force(estimator, kind) == 150.0
    estimator.advance(NOW + 9 * MS)
    speed, load = (150.0, 4000.0) if kind == "speed" else (100.0, 150.0)
    assert_close(estimator.state, exact(unit, speed, load, 0.0, before, 4e-3))


@kinds
def test_repeated_while_waiting(kind):
    """s waits: replaces that sample from s on."""
    estimator = started()
    assert add(estimator, kind, NOW + 5 * MS, 50.0) == "taken"
    assert add(estimator, kind, NOW + 5 * MS, 60.0) == "repeated"
    estimator.advance(NOW + 5 * MS - 1)
    assert in_force(estimator, kind) != 60.0
    estimator.advance(NOW + 5 * MS)
    assert in_force(estimator, kind) == 60.0


@kinds
def test_out_of_order(kind):
    """s < k: none, something newer is in force."""
    estimator = started()
    add(estimator, kind, NOW + 5 * MS, 50.0)
    estimator.advance(NOW + 6 * MS)
    before = copy.deepcopy(estimator.snapshot())
    assert add(estimator, kind, NOW + 5 * MS - 1, 70.0) == "out of order"
    assert estimator.snapshot() == before
    assert estimator.counts["out of order"] == 1


@kinds
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("stamp", [NOW - 1, NOW, NOW + 1])
def test_not_finite(kind, value, stamp):
    """Whatever its stamp, it leaves no trace."""
    estimator = started()
    before = copy.deepcopy(estimator.snapshot())
    assert add(estimator, kind, stamp, value) == "not finite"
    assert estimator.snapshot() == before
    estimator.advance(NOW + MS)
    assert np.isfinite(estimator.axle_force).all()


def test_traction_that_is_not_finite_takes_its_load_with_it():
    estimator = started()
    assert estimator.add_load(NOW + 1, 5000.0, math.nan) == "not finite"
    estimator.advance(NOW + 2)
    assert estimator.load == (4000.0, 0.0)


def test_counts_are_of_both_kinds():
    estimator = started()
    estimator.add_speed(NOW - 1, 1.0)
    estimator.add_load(NOW - 1, 1.0)
    assert estimator.counts == {"taken": 2, "out of order": 2}


# -- exact holding ----------------------------------------------------------------------------------------------


@both
def test_zero_order_hold_is_exact(unit):
    """Samples at uneven stamps, some many per tick and some none, against a matrix exponential per hold."""
    rng = np.random.default_rng(4)
    estimator = started(unit)
    stamps = np.unique(rng.integers(1, 200 * MS, 60))
    speeds = {int(s): rng.uniform(-300.0, 300.0) for s in stamps[rng.random(len(stamps)) < 0.6]}
    loads = {int(s): rng.uniform([0.0, -900.0], [8000.0, 900.0]) for s in stamps[rng.random(len(stamps)) < 0.7]}
    for stamp, speed in speeds.items():
        estimator.add_speed(NOW + stamp, speed)
    for stamp, load in loads.items():
        estimator.add_load(NOW + stamp, *load)

    state, phase, speed, load, time = wheel.equilibrium(unit, 100.0, 4000.0), 0.0, 100.0, np.array([4000.0, 0.0]), 0
    for tick in range(2 * MS, 202 * MS, 2 * MS):
        for stamp in sorted({s for s in (*speeds, *loads) if time < s <= tick} | {tick}):
            state = exact(unit, speed, *load, state, (stamp - time) * 1e-9)
            phase += speed * (stamp - time) * 1e-9
            time, speed, load = stamp, speeds.get(stamp, speed), loads.get(stamp, load)
        assert estimator.advance(NOW + tick)
        # a hundred and sixty steps, each with the rounding of expm and of the step
        assert_close(estimator.state, state, relative=1e-10)
        assert math.remainder(estimator.phase - phase, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)
        ring = wheel.rotation(phase, speed) @ state
        assert_close(estimator.ring_state, ring, relative=1e-10)
        x = -unit.sidewall_stiffness * state[3]
        if unit.sidewall_damping == "reaction":
            d = 2.0 * unit.zeta_1 * unit.rigid_mode_frequency
            x -= unit.ring_mass * d * (state[0] + speed * (state[4] - state[5]))
        z = unit.suspension_stiffness * state[5] + unit.suspension_damping * state[2]
        assert estimator.axle_force == pytest.approx((x, z), abs=1e-10 * 4000.0 * 40.0)


@both
def test_rolling_backward_at_the_same_speed(unit):
    """From one tick to the next only the sign of the speed changes."""
    estimator = started(unit, 100.0)
    estimator.add_load(NOW, 6000.0)
    estimator.advance(NOW + 5 * MS)
    before = estimator.state
    estimator.add_speed(NOW + 5 * MS, -100.0)
    estimator.advance(NOW + 9 * MS)
    assert_close(estimator.state, exact(unit, -100.0, 6000.0, 0.0, before, 4e-3))


@settings(max_examples=30)
@given(
    damping=st.sampled_from(list(UNITS)),
    speed=st.floats(-400.0, 400.0),
    cuts=st.lists(st.integers(1, 50 * MS), min_size=1, max_size=15),
)
def test_ticks_do_not_matter(damping, speed, cuts):
    """Advancing in many steps or one ends in the same state but for rounding: there is no truncation error."""
    many, one = (started(UNITS[damping]) for _ in range(2))
    for estimator in (many, one):
        estimator.add_speed(NOW, speed)
        estimator.add_load(NOW, 6000.0, 300.0)
    for cut in sorted(cuts):
        many.advance(NOW + cut)
    for estimator in (many, one):
        estimator.advance(NOW + 50 * MS)
    # each step rounds by about 1e-15 of the state
    assert_close(many.state, one.state, relative=1e-12)
    assert math.remainder(many.phase - one.phase, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-13)


@both
def test_agrees_with_simulate(unit):
    """A speed and a load that step once and then hold are linear too: both paths must give one answer."""
    estimator = started(unit, 100.0, 4000.0)
    estimator.add_speed(NOW, 160.0)
    estimator.add_load(NOW, 6500.0, -400.0)
    # simulate has no way to start in another load's equilibrium, so a short last step stands in for the jump
    t = np.concatenate([[-1e-9, 0.0], 2e-3 * np.arange(1, 51)])
    after = t >= 0.0
    response = simulate(
        unit, t, np.where(after, 160.0, 100.0), np.where(after, 6500.0, 4000.0), np.where(after, -400.0, 0.0)
    )
    for k in range(1, 51):
        estimator.advance(NOW + 2 * MS * k)
        # 1e-9 s of the old inputs: 1e-9 of 500 rad/s
        expected = response.axle_force[k + 1]
        assert np.abs(estimator.axle_force - expected).max() < 1e-6 * 6500.0


def test_advance_to_the_same_time_changes_nothing(estimator):
    estimator = started()
    estimator.add_load(NOW, 5000.0)
    estimator.advance(NOW + MS)
    before = copy.deepcopy(estimator.snapshot())
    assert estimator.advance(NOW + MS)
    assert estimator.snapshot() == before


def test_advance_backward_is_refused():
    estimator = started()
    before = copy.deepcopy(estimator.snapshot())
    with pytest.raises(ValueError, match=f"{NOW - 1}.*{NOW}"):
        estimator.advance(NOW - 1)
    assert estimator.snapshot() == before


def test_a_time_that_is_no_whole_number_of_nanoseconds_is_refused(estimator):
    """Seconds, say: cut to a whole number they would be another time."""
    for call in (
        lambda: estimator.add_speed(1.5, 1.0),
        lambda: estimator.add_load(1.5, 1.0),
        lambda: estimator.advance(1.5),
        lambda: WheelEstimator(estimator.unit, timeout=1.5),
    ):
        with pytest.raises(TypeError):
            call()
    assert estimator.time is None and not estimator.counts


# -- a week of driving ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [97.3, -97.3])
def test_a_week_of_turns(speed):
    """Nine million turns in some thousand holds: the phase is still the angle turned, modulo 2 pi.

    2 pi itself is rounded, by 2.4e-16 per turn, and each hold's angle by 2^-53 of its size.
    """
    estimator = started(speed=speed)
    stamp, angle = 0, Fraction(0)
    rng = np.random.default_rng(2)
    week = 7 * 24 * 3600 * 1000 * MS
    while stamp < week:
        step = int(rng.integers(1, 1200 * 1000 * MS))
        stamp += step
        angle += Fraction(speed) * step / 10**9
        estimator.advance(NOW + stamp)
    two_pi = 2 * (Fraction(math.pi) + Fraction(1.2246467991473532e-16))  # pi to 1e-32
    turned = float(angle - two_pi * round(angle / two_pi))
    turns = float(abs(angle / two_pi))
    assert math.remainder(estimator.phase - turned, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-8), turns
    assert abs(estimator.phase) < 2.0 * math.pi
    expected = wheel.rotation(turned, speed) @ wheel.equilibrium(estimator.unit, speed, 4000.0)
    assert_close(estimator.ring_state, expected, relative=1e-8)


def test_large_stamps_lose_nothing():
    """1.8e18 ns is beyond a double's integers: only differences of stamps may become floats."""
    near, far = started(at=0), started(at=NOW + 1)
    for k in range(1, 40):
        stamp = 1_999_999 * k + k % 3
        for estimator, start in ((near, 0), (far, NOW + 1)):
            estimator.add_load(start + stamp, 4000.0 + 100.0 * k)
            estimator.advance(start + stamp + 7)
        assert near.state.tobytes() == far.state.tobytes()
        assert near.phase == far.phase


def test_an_error_made_once_is_forgotten():
    """The motion is stable, so that rounding cannot pile up: a disturbed twin comes back to the same forces."""
    one, two = started(), started()
    two.add_load(NOW, 9000.0)
    two.advance(NOW + 10 * MS)
    two.add_load(NOW + 10 * MS, 4000.0)
    for estimator in (one, two):
        for k in range(1, 2001):
            estimator.advance(NOW + k * 10 * MS)
    # after 20 s at a decay of exp(-3 t) nothing is left but rounding
    assert two.axle_force == pytest.approx(one.axle_force, abs=1e-9)


UNSTABLE = UNITS["modal"].replace(zeta_1=0.5)  # from 4350 rpm = 456 rad/s on, docs/model.md, section 12


def gone(speed=600.0, timeout=None):
    """An estimator whose motion has grown out of all bounds, at NOW + 60 s."""
    estimator = started(UNSTABLE, speed, timeout=timeout)
    estimator.add_load(NOW, 5000.0)
    for second in range(1, 61):
        estimator.advance(NOW + second * 1000 * MS)
    assert not estimator.running and (estimator.divergences, estimator.stops) == (1, 0)
    return estimator


def test_a_motion_beyond_all_bounds_is_given_up():
    """Not before a velocity or a displacement exceeds 1e6, and at the first tick that finds one beyond."""
    estimator = started(UNSTABLE, 600.0)
    estimator.add_load(NOW, 5000.0)
    start, tick = wheel.equilibrium(UNSTABLE, 600.0, 4000.0), 0
    while estimator.advance(NOW + (tick := tick + 100 * MS)):
        assert np.abs(estimator.state).max() < 1e6
    assert np.abs(exact(UNSTABLE, 600.0, 5000.0, 0.0, start, tick * 1e-9)).max() >= 1e6
    assert estimator.divergences == 1


def test_a_gap_of_an_hour_beyond_the_critical_speed_is_given_up_too():
    """No double holds what the one long step comes to: infinite or not a number is beyond the bound as well."""
    estimator = started(UNSTABLE, 600.0)
    estimator.add_load(NOW, 5000.0)
    with np.errstate(over="ignore", invalid="ignore"):
        assert not estimator.advance(NOW + 3600 * 1000 * MS)
    assert estimator.divergences == 1


def test_a_motion_that_was_given_up_starts_again_when_it_is_stable():
    """Not at another unstable speed, however long; from equilibrium at the first stable one."""
    estimator = gone()
    estimator.add_speed(NOW + 60_000 * MS, 500.0)
    assert not estimator.advance(NOW + 70_000 * MS)
    estimator.add_load(NOW + 70_000 * MS, 5500.0)
    assert not estimator.advance(NOW + 80_000 * MS)
    estimator.add_speed(NOW + 80_500 * MS, 10.0)
    assert estimator.advance(NOW + 81_000 * MS)
    assert_close(estimator.state, wheel.equilibrium(UNSTABLE, 10.0, 5500.0), relative=1e-13)
    assert estimator.phase == pytest.approx(10.0 * 0.5, rel=1e-13)
    assert (estimator.divergences, estimator.stops) == (1, 0)


def test_a_motion_that_was_given_up_needs_fresh_inputs_as_any_start_does():
    estimator = started(UNSTABLE, 600.0, timeout=200 * MS)
    tick = NOW
    while not estimator.divergences:
        tick += 100 * MS
        estimator.add_speed(tick, 600.0)
        estimator.add_load(tick, 5000.0 + (tick // (100 * MS)) % 2)
        estimator.advance(tick)
    estimator.add_speed(tick + 300 * MS, 10.0)
    assert not estimator.advance(tick + 300 * MS)  # stable, but the load is 300 ms old
    estimator.add_load(tick + 310 * MS, 5000.0)
    assert estimator.advance(tick + 310 * MS)


def test_reset_forgets_that_a_motion_was_given_up():
    estimator = gone()
    estimator.reset()
    estimator.add_speed(NOW, 600.0)
    estimator.add_load(NOW, 5000.0)
    assert estimator.advance(NOW)


def test_snapshot_of_a_motion_that_was_given_up():
    """Plain JSON, and the copy waits for a stable speed as the original does."""
    original = gone()
    copied = WheelEstimator(UNSTABLE)
    copied.restore(json.loads(json.dumps(original.snapshot(), allow_nan=False)))
    for estimator in (original, copied):
        assert not estimator.advance(NOW + 61_000 * MS)
        estimator.add_speed(NOW + 61_000 * MS, 10.0)
        assert estimator.advance(NOW + 62_000 * MS)
    assert original.snapshot() == copied.snapshot()


def test_an_unstable_speed_alone_gives_nothing_up():
    """A spell beyond the limit that stays in bounds is part of the motion."""
    estimator = started(UNSTABLE, 600.0)
    estimator.add_load(NOW, 5000.0)
    assert estimator.advance(NOW + 50 * MS)
    before = estimator.state
    estimator.add_speed(NOW + 50 * MS, 10.0)
    assert estimator.advance(NOW + 60 * MS)
    assert_close(estimator.state, exact(UNSTABLE, 10.0, 5000.0, 0.0, before, 10e-3))
    assert estimator.divergences == 0


def test_without_sidewall_damping_nothing_is_ever_given_up():
    """Marginal is not unstable: an undamped unit swings on, at any speed."""
    unit = UNITS["modal"].replace(zeta_1=0.0, zeta_s=0.0)
    estimator = started(unit, 900.0)
    estimator.add_load(NOW, 9000.0)
    assert all(estimator.advance(NOW + k * 1000 * MS) for k in range(1, 100))


# -- gaps -------------------------------------------------------------------------------------------------------


@kinds
def test_motion_stops_when_an_input_is_too_old(kind):
    estimator = started(timeout=200 * MS)
    other = "load" if kind == "speed" else "speed"
    assert add(estimator, other, NOW + 100 * MS, 50.0) == "taken"
    assert estimator.advance(NOW + 200 * MS)  # as old as the timeout, not older
    assert not estimator.advance(NOW + 200 * MS + 1)
    assert not estimator.running


def test_starts_again_from_equilibrium():
    unit = UNITS["modal"]
    estimator = started(timeout=200 * MS)
    estimator.add_load(NOW, 9000.0)  # out of equilibrium
    estimator.advance(NOW + 100 * MS)
    assert not estimator.advance(NOW + 300 * MS)
    assert estimator.stops == 1
    estimator.add_load(NOW + 350 * MS, 5000.0)
    assert not estimator.advance(NOW + 360 * MS)  # the speed is still too old
    estimator.add_speed(NOW + 370 * MS, 120.0)
    assert estimator.advance(NOW + 400 * MS)
    # in force at once from 370 ms on; still in equilibrium at 400
    assert_close(estimator.state, wheel.equilibrium(unit, 120.0, 5000.0), relative=1e-13)
    assert estimator.phase == pytest.approx(120.0 * 30e-3, rel=1e-14)


def test_a_late_sample_restarts_at_the_time_it_is_known():
    estimator = started(timeout=200 * MS)
    estimator.add_load(NOW + 150 * MS, 5000.0)
    assert not estimator.advance(NOW + 300 * MS)
    assert estimator.add_speed(NOW + 290 * MS, 120.0) == "late"
    assert not estimator.running
    assert estimator.advance(NOW + 310 * MS)
    assert estimator.phase == pytest.approx(120.0 * 10e-3, rel=1e-14)


def test_a_late_sample_that_is_too_old_restarts_nothing():
    estimator = started(timeout=200 * MS)
    estimator.add_load(NOW + 900 * MS, 5000.0)
    assert not estimator.advance(NOW + 1000 * MS)
    assert estimator.add_speed(NOW + 700 * MS, 120.0) == "late"
    assert not estimator.advance(NOW + 1000 * MS)


def test_starts_with_an_input_as_old_as_the_timeout_but_not_older():
    for age, running in ((200 * MS, True), (200 * MS + 1, False)):
        estimator = WheelEstimator(UNITS["modal"], timeout=200 * MS)
        estimator.add_speed(NOW, 100.0)
        estimator.add_load(NOW + age, 4000.0)
        assert estimator.advance(NOW + age) == running


def test_a_sample_inside_the_gap_is_too_late_if_the_other_input_was_already_too_old():
    """The next load comes after the speed's time-out: stop and start again, though both are fresh at the tick."""
    estimator = started(timeout=200 * MS)
    estimator.add_load(NOW + 150 * MS, 6000.0)
    estimator.add_speed(NOW + 250 * MS, 120.0)
    assert estimator.advance(NOW + 260 * MS)
    assert estimator.stops == 1
    assert_close(estimator.state, wheel.equilibrium(estimator.unit, 120.0, 6000.0), relative=1e-13)


def test_a_gap_within_the_timeout_is_bridged_in_one_step():
    unit, estimator = UNITS["modal"], started(timeout=500 * MS)
    estimator.add_load(NOW, 9000.0)
    assert estimator.advance(NOW + 450 * MS)
    assert estimator.stops == 0
    start = wheel.equilibrium(unit, 100.0, 4000.0)
    assert_close(estimator.state, exact(unit, 100.0, 9000.0, 0.0, start, 0.45), relative=1e-10)


def test_without_a_timeout_the_last_values_hold_for_ever():
    estimator = started()
    assert estimator.advance(NOW + 365 * 24 * 3600 * 1000 * MS)
    assert estimator.stops == 0 and np.isfinite(estimator.axle_force).all()


# -- the same bits ----------------------------------------------------------------------------------------------

CALLS = st.lists(
    st.one_of(
        st.tuples(st.just("speed"), st.integers(-30, 30), st.floats(-300.0, 300.0) | st.just(math.nan)),
        st.tuples(st.just("load"), st.integers(-30, 30), st.floats(0.0, 9000.0), st.floats(-500.0, 500.0)),
        st.tuples(st.just("advance"), st.integers(0, 40)),
    ),
    max_size=40,
)


def run(estimator, calls):
    """Calls with stamps relative to the time so far [ms]; everything that could be seen on the way."""
    seen = []
    for name, offset, *values in calls:
        stamp = (estimator.time if estimator.time is not None else NOW) + offset * MS
        if name == "advance":
            seen.append(estimator.advance(stamp))
        else:
            seen.append((estimator.add_speed if name == "speed" else estimator.add_load)(stamp, *values))
        seen += [estimator.state.tobytes(), estimator.axle_force, estimator.phase, estimator.ages()]
    return seen


@settings(max_examples=60)
@given(calls=CALLS, damping=st.sampled_from(list(UNITS)))
def test_same_calls_same_bits(calls, damping):
    first = WheelEstimator(UNITS[damping], timeout=50 * MS)
    second = WheelEstimator(UNITS[damping], timeout=50 * MS)
    run(second, [("speed", 0, 33.0), ("load", 0, 1.0, 1.0), ("advance", 7)])  # a past that reset() wipes out
    second.reset()
    assert run(first, calls) == run(second, calls)


@settings(max_examples=60)
@given(before=CALLS, after=CALLS, damping=st.sampled_from(list(UNITS)))
def test_snapshot_continues_bit_for_bit(before, after, damping):
    """Through JSON, in an estimator that has lived through something else."""
    original = WheelEstimator(UNITS[damping], timeout=50 * MS)
    run(original, before)
    text = json.dumps(original.snapshot(), allow_nan=False)
    copied = WheelEstimator(UNITS[damping], timeout=50 * MS)
    run(copied, [("speed", 0, 33.0), ("load", 0, 1.0, 1.0), ("advance", 7), ("speed", 9, 1.0)])
    copied.restore(json.loads(text))
    assert run(original, after) == run(copied, after)
    assert original.snapshot() == copied.snapshot()


@settings(max_examples=60)
@given(calls=CALLS)
def test_holds_whatever_comes(calls):
    """No order of calls breaks it: time is the last tick, ages are not negative, nothing is not finite."""
    estimator = WheelEstimator(UNITS["modal"], timeout=50 * MS)
    for call in calls:
        run(estimator, [call])
        assert np.isfinite(estimator.state).all() and np.isfinite(estimator.axle_force).all()
        ages = [age for age in estimator.ages() if age is not None]
        assert all(age >= 0 for age in ages)
        if call[0] == "advance" and estimator.running:
            assert len(ages) == 2 and max(ages) <= 50 * MS


def test_snapshot_is_a_copy():
    """It is written by another thread later: what happens to the estimator meanwhile must not show in it."""
    estimator = started()
    estimator.add_speed(NOW + MS, 120.0)
    estimator.add_load(NOW + MS, 5000.0)
    snapshot = estimator.snapshot()
    text = json.dumps(snapshot)
    estimator.add_speed(NOW + 2 * MS, 130.0)
    estimator.advance(NOW + 5 * MS)
    assert json.dumps(snapshot) == text


def test_restore_does_not_keep_the_snapshot():
    estimator = started()
    estimator.add_speed(NOW + MS, 120.0)
    snapshot = json.loads(json.dumps(estimator.snapshot()))
    text = json.dumps(snapshot)
    other = WheelEstimator(UNITS["modal"])
    other.restore(snapshot)
    other.advance(NOW + 5 * MS)
    assert json.dumps(snapshot) == text


# -- reset and change of tire -----------------------------------------------------------------------------------


def test_reset_forgets_everything_but_the_counts():
    estimator = started()
    estimator.add_speed(NOW + 50 * MS, 1.0)  # waiting
    estimator.advance(NOW + 5 * MS)
    estimator.reset()
    assert estimator.time is None and not estimator.running and estimator.ages() == (None, None)
    assert (estimator.speed, estimator.load, estimator.phase) == (0.0, (0.0, 0.0), 0.0)
    assert not estimator.advance(0)  # any time will do now
    assert not estimator.advance(NOW + 60 * MS)
    assert estimator.counts["taken"] == 3


def test_another_tire_goes_on_from_the_same_state():
    estimator = started(UNITS["modal"])
    estimator.advance(NOW + 5 * MS)
    state = estimator.state
    estimator.set_unit(UNITS["reaction"])
    assert np.array_equal(estimator.state, state)
    estimator.advance(NOW + 9 * MS)
    assert_close(estimator.state, exact(UNITS["reaction"], 100.0, 4000.0, 0.0, state, 4e-3))


def test_what_is_read_is_a_copy():
    estimator = started()
    state = estimator.state
    state[:] = math.nan
    assert np.isfinite(estimator.state).all()
