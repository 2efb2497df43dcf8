"""The belt of the live estimator: the same motion as the simulated one, its steady state, and its snapshot."""

from __future__ import annotations

import json
import math
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_build import SOURCE_ONLY, output

from tire_dynamics import TireWheelUnit, ring, simulate, wheel
from tire_dynamics.estimator.belt import BeltMotion, belt_numbers, ring_angles, shape_basis
from tire_dynamics.estimator.wheel_estimator import WheelEstimator

MS = 1_000_000  # ns
NOW = 1_800_000_000_000_000_000
UNIT = TireWheelUnit.table_1(sidewall_damping="reaction", contact_half_angle=0.1)
N_MAX, SAMPLES = 9, 24
PSI = ring_angles(SAMPLES)
models = pytest.mark.parametrize("model", ["inextensional", "complete"])


def estimator_of(model, unit=UNIT, timeout=None):
    return WheelEstimator(unit, model=model, n_max=N_MAX, timeout=timeout)


# -- the shape --------------------------------------------------------------------------------------------------


def test_ring_angles():
    """psi = 2 pi j/P, as the message of the live node has them."""
    assert ring_angles(4) == pytest.approx([0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi], rel=1e-15)


def test_belt_numbers():
    assert belt_numbers(4, "inextensional").tolist() == [2, 3, 4]
    assert belt_numbers(4, "complete").tolist() == [0, 2, 3, 4]
    assert belt_numbers(2, "inextensional").tolist() == [2]
    for n_max in (1, 0, -3, 2.0, 2.5, math.nan, "3", None):
        with pytest.raises(ValueError, match="n_max"):
            belt_numbers(n_max, "inextensional")


def test_shape_is_the_sum_over_its_modes():
    """u = Re[conj(Z) exp(i n psi)] for each n, and the first harmonic from its two amplitudes."""
    rng = np.random.default_rng(1)
    numbers, psi = [0, 2, 5], np.array([0.0, 0.3, 4.0, -1.0, 10.0])
    a, b = rng.normal(size=2)
    Z = rng.normal(size=3) + 1j * rng.normal(size=3)
    basis = shape_basis(psi, numbers)
    assert basis.shape == (8, 5)
    expected = a * np.cos(psi) + b * np.sin(psi)
    for n, value in zip(numbers, Z, strict=True):
        expected = expected + (np.conj(value) * np.exp(1j * n * psi)).real
    assert [a, b, *Z.real, *Z.imag] @ basis == pytest.approx(expected, abs=1e-14)  # eight terms of size 1


@pytest.mark.parametrize("psi", [0.0, [[0.0]], [math.nan], [math.inf]], ids=str)
def test_wrong_angles(psi):
    with pytest.raises(ValueError, match="psi"):
        shape_basis(psi, [2, 3])


# -- the same as the simulated one ------------------------------------------------------------------------------


@models
@pytest.mark.parametrize("speed", [0.0, 120.0, -200.0])
def test_constant_inputs(model, speed):
    """Steady from the start, tick after tick, in both."""
    estimator = estimator_of(model)
    estimator.add_speed(NOW, speed)
    estimator.add_load(NOW, 4000.0, 250.0)
    t = 2e-3 * np.arange(51)
    expected = simulate(UNIT, t, speed, 4000.0, 250.0, psi=PSI, n_max=N_MAX, model=model)
    scale = np.abs(expected.u_z).max()
    for k in range(51):
        assert estimator.advance(NOW + 2 * MS * k)
        belt = estimator.belt(PSI)
        # rounding of fifty steps of a motion that decays
        assert np.abs(belt - [expected.u_z[k], expected.u_theta[k]]).max() <= 1e-13 * scale


JUMP = 1e-7  # s; what the simulation takes for a jump of the inputs


@pytest.mark.slow
@models
@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), varying=st.booleans())
def test_held_inputs(model, seed, varying):
    """Random samples at random stamps, held until the next, against a simulation with inputs that almost jump.

    The simulated ones change linearly over JUMP before each sample's time: an error of JUMP times a rate.
    """
    rng = np.random.default_rng(seed)
    stamps = np.concatenate([[0], np.sort(rng.choice(np.arange(1, 40), 10, replace=False))]) * MS
    speeds = 100.0 + (rng.uniform(-40.0, 40.0, stamps.size) if varying else np.zeros(stamps.size))
    loads, tractions = rng.uniform(0.0, 8000.0, stamps.size), rng.uniform(-900.0, 900.0, stamps.size)
    estimator = estimator_of(model)
    for stamp, speed, load, traction in zip(stamps, speeds, loads, tractions, strict=True):
        estimator.add_speed(NOW + int(stamp), speed)
        estimator.add_load(NOW + int(stamp), load, traction)
    found, ticks = [], range(0, 42 * MS, 3 * MS)
    for tick in ticks:
        assert estimator.advance(NOW + tick)
        found.append(estimator.belt(PSI))

    before = stamps[1:] * 1e-9
    t = np.unique(np.concatenate([before - JUMP, before, np.array(ticks) * 1e-9]))
    sample = np.searchsorted(stamps * 1e-9, t + 1e-12, side="right") - 1
    response = simulate(
        UNIT, t, speeds[sample], loads[sample], tractions[sample], psi=PSI, n_max=N_MAX, model=model
    )  # fmt: skip
    at = np.searchsorted(t, np.array(ticks) * 1e-9 - 1e-12)
    expected = np.stack([response.u_z, response.u_theta], axis=1)[at]
    # ten jumps, each JUMP/2 early: JUMP/2 of the velocities, of modes up to some 1e4 rad/s
    assert np.abs(np.array(found) - expected).max() <= 5.0 * JUMP * 1e4 * np.abs(expected).max()


@models
def test_the_jumps_are_what_differs(model):
    """With a tenth of the time for a jump a tenth of the difference: the two meet in the limit.

    Over a ramp of length h about the jump, n^2 Omega^2 of the stiffness is held at the middle speed, which misses
    n^2 (change/2)^2 h of the displacement, as a velocity. The inextensional model keeps 1e-5 besides: its Euler terms
    have a factor gamma that depends on Omega, and a jump at once takes it at one speed, the ramp in two halves at two.
    """
    estimator = estimator_of(model)
    samples = [(0, 100.0, 4000.0, 0.0), (4 * MS, 140.0, 7000.0, -500.0), (9 * MS, 60.0, 1000.0, 800.0)]
    for stamp, speed, load, traction in samples:
        estimator.add_speed(NOW + stamp, speed)
        estimator.add_load(NOW + stamp, load, traction)
    estimator.advance(NOW + 14 * MS)
    found, errors = estimator.belt(PSI), []
    for jump in (1e-4, 1e-5, 1e-6):
        t = [0.0, 0.004 - 0.5 * jump, 0.004 + 0.5 * jump, 0.009 - 0.5 * jump, 0.009 + 0.5 * jump, 0.014]
        each = [np.repeat(column, 2) for column in list(zip(*samples, strict=True))[1:]]
        response = simulate(UNIT, t, *each, psi=PSI, n_max=N_MAX, model=model)
        errors.append(np.abs(found - [response.u_z[-1], response.u_theta[-1]]).max() / np.abs(found).max())
    floor = 2e-5 if model == "inextensional" else 0.0
    assert errors[1] < 0.2 * errors[0] and errors[2] < 0.2 * errors[1] + floor and errors[2] < 3e-5, errors


# -- the steady state -------------------------------------------------------------------------------------------


@models
@pytest.mark.parametrize("speed", [0.0, 120.0, -200.0])
def test_settles_to_the_steady_response(model, speed):
    """A constant load at constant speed: (4.5) for n >= 2, and the unit's equilibrium, to 1e-9.

    From another load and another speed; 20 s of decay by exp(-3 t) at the least leave 1e-26.
    """
    unit = UNIT.replace(contact_half_angle=0.0)
    estimator = estimator_of(model, unit)
    estimator.add_speed(NOW, 30.0)
    estimator.add_load(NOW, 9000.0, 0.0)
    estimator.advance(NOW)
    estimator.add_speed(NOW + 5 * MS, speed)
    estimator.add_load(NOW + 5 * MS, 4000.0, 0.0)
    for k in range(1, 401):
        estimator.advance(NOW + 50 * MS * k)
    belt = estimator.belt(PSI)
    first = wheel.belt_amplitudes(wheel.equilibrium(unit, speed, 4000.0, model=model), model)
    a, b, c, d = first
    u_z, u_theta = ring.steady_response(unit, speed, 4000.0, PSI, n_max=N_MAX, model=model)
    expected = np.array([a * np.cos(PSI) + b * np.sin(PSI) + u_z, c * np.cos(PSI) + d * np.sin(PSI) + u_theta])
    if model == "complete":  # the ring breathes: B_0 z_1 = -F/(2 pi a b rho h)
        A_0, B_0, C_0, _ = (float(value) for value in ring.coefficients(unit, 0, speed))
        breath = -4000.0 / unit.ring_mass / B_0
        assert float(A_0) == 0.0
        expected[0] += breath
    assert np.abs(belt - expected).max() <= 1e-9 * np.abs(expected).max()


@models
def test_starts_steady(model):
    estimator = estimator_of(model)
    estimator.add_speed(NOW, 77.0)
    estimator.add_load(NOW, 4000.0, 300.0)
    estimator.advance(NOW)
    belt = estimator.belt(PSI)
    expected = simulate(UNIT, [0.0], 77.0, 4000.0, 300.0, psi=PSI, n_max=N_MAX, model=model)
    assert np.abs(belt - [expected.u_z[0], expected.u_theta[0]]).max() <= 1e-15  # millimetres, rounded
    estimator.advance(NOW + 3600 * 1000 * MS)
    assert np.abs(estimator.belt(PSI) - belt).max() <= 1e-12 * np.abs(belt).max()


@models
def test_starts_steady_again_after_a_gap(model):
    """Nothing of the motion before the gap is left."""
    estimator = estimator_of(model, timeout=100 * MS)
    estimator.add_speed(NOW, 77.0)
    estimator.add_load(NOW, 4000.0)
    estimator.add_load(NOW + 50 * MS, 9000.0)
    assert estimator.advance(NOW + 60 * MS) and not estimator.advance(NOW + 400 * MS)
    estimator.add_speed(NOW + 500 * MS, 30.0)
    estimator.add_load(NOW + 500 * MS, 2000.0)
    assert estimator.advance(NOW + 500 * MS)
    expected = simulate(UNIT, [0.0], 30.0, 2000.0, psi=PSI, n_max=N_MAX, model=model)
    assert np.abs(estimator.belt(PSI) - [expected.u_z[0], expected.u_theta[0]]).max() <= 1e-15


# -- when it is read, and the same bits -------------------------------------------------------------------------

CALLS = st.lists(
    st.one_of(
        st.tuples(st.just("speed"), st.integers(-30, 30), st.floats(-300.0, 300.0)),
        st.tuples(st.just("load"), st.integers(-30, 30), st.floats(0.0, 9000.0), st.floats(-500.0, 500.0)),
        st.tuples(st.just("advance"), st.integers(0, 40)),
        st.tuples(st.just("belt"), st.just(0)),
    ),
    max_size=40,
)


def run(estimator, calls):
    seen = []
    for name, offset, *values in calls:
        stamp = (estimator.time if estimator.time is not None else NOW) + offset * MS
        if name == "belt":
            seen.append(estimator.belt(PSI).tobytes())
        else:
            getattr(estimator, {"speed": "add_speed", "load": "add_load"}.get(name, name))(stamp, *values)
    return seen


def running(model):
    estimator = estimator_of(model, timeout=50 * MS)
    estimator.add_speed(NOW, 90.0)
    estimator.add_load(NOW, 4000.0, 100.0)
    estimator.advance(NOW)
    return estimator


@pytest.mark.slow
@models
@settings(max_examples=25)
@given(calls=CALLS)
def test_same_calls_same_bits(model, calls):
    calls = [*calls, ("belt", 0)]
    assert run(running(model), calls) == run(running(model), calls)


@models
@settings(max_examples=25)
@given(before=CALLS, after=CALLS)
def test_snapshot_continues_bit_for_bit(model, before, after):
    """Through JSON, with steps that wait to be taken together, in an estimator that has had another past."""
    original, copied = running(model), estimator_of(model, timeout=50 * MS)
    run(original, before)
    text = json.dumps(original.snapshot(), allow_nan=False)
    run(copied, [("speed", 0, 33.0), ("load", 0, 1.0, 1.0), ("advance", 7), ("speed", 9, 1.0)])
    copied.restore(json.loads(text))
    after = [*after, ("belt", 0)]
    assert run(original, after) == run(copied, after)
    assert json.dumps(original.snapshot()) == json.dumps(copied.snapshot())


@models
@settings(max_examples=25)
@given(calls=CALLS, looks=st.lists(st.sampled_from(["belt", "snapshot", "state"]), min_size=1))
def test_reading_or_saving_changes_no_bit(model, calls, looks):
    """Intervals wait until the shape is wanted; one that is not over yet is never cut."""
    seldom, often = running(model), running(model)
    for number, call in enumerate(calls):
        run(seldom, [call])
        run(often, [call])
        look = looks[number % len(looks)]
        if look == "belt":
            often.belt(PSI)
        elif look == "snapshot":
            often.snapshot()
    assert seldom.belt(PSI).tobytes() == often.belt(PSI).tobytes()
    assert seldom.snapshot() == often.snapshot()


@models
def test_a_belt_that_is_seldom_looked_at_is_that_which_always_is(model):
    """Far more changes of the force than intervals that may wait, and holds of many ticks between them."""
    seldom, often = running(model), running(model)
    for k in range(1, 700):
        for estimator in (seldom, often):
            if k < 300 or k % 20 == 0:
                estimator.add_load(NOW + k * MS, 4000.0 + 2000.0 * math.sin(0.3 * k), 10.0 * (k % 7))
                estimator.add_speed(NOW + k * MS, 90.0 if k < 350 else 110.0)
            else:
                estimator.add_speed(NOW + k * MS, estimator.speed)
                estimator.add_load(NOW + k * MS, *estimator.load)
            estimator.advance(NOW + k * MS)
        often.belt(PSI)
    assert seldom.belt(PSI).tobytes() == often.belt(PSI).tobytes()


@models
def test_another_tire_goes_on_from_the_same_belt(model):
    estimator = running(model)
    estimator.add_load(NOW, 8000.0)
    estimator.advance(NOW + 5 * MS)
    before = estimator.belt(PSI)
    estimator.set_unit(UNIT.replace(radial_stiffness=4e6))
    # through the modes' own coordinates and back: their matrices' condition, hundred or so, times rounding
    assert np.abs(estimator.belt(PSI) - before).max() <= 1e-13 * np.abs(before).max()
    # it moves on with the new stiffness: like an estimator of that unit from the same snapshot
    other = estimator_of(model, UNIT.replace(radial_stiffness=4e6), timeout=50 * MS)
    other.restore(json.loads(json.dumps(estimator.snapshot())))
    for each in (estimator, other):
        each.advance(NOW + 9 * MS)
    assert np.array_equal(estimator.belt(PSI), other.belt(PSI))
    assert not np.array_equal(estimator.belt(PSI), before)


def test_snapshot_of_another_belt_is_refused():
    for other in (BeltMotion(UNIT, "inextensional", 5, 1, PSI), BeltMotion(UNIT, "complete", N_MAX, 1, PSI)):
        with pytest.raises(ValueError, match="shape"):
            BeltMotion(UNIT, "inextensional", N_MAX, 1, PSI).restore(0, other.snapshot(0))


# -- nothing grows ------------------------------------------------------------------------------------------------

GROWTH = """
import sys
from tire_dynamics import TireWheelUnit
from tire_dynamics.estimator.settings import VehicleSettings
from tire_dynamics.estimator.wheels import Wheels

MS = 1_000_000
settings = VehicleSettings(
    TireWheelUnit.table_1(), wheels=("one", "two"), n_max=2, ring_samples=3, input_timeout=400 * MS, period=2 * MS,
    ring_period=10**18,  # nobody looks at the belt
)
wheels = Wheels(settings)
most_intervals = most_waiting = 0

def count():
    global most_intervals, most_waiting
    most_intervals = max(most_intervals, *wheels.belt.waiting.tolist())
    most_waiting = max(most_waiting, *wheels.schedule.waiting.tolist())

for k in range(400):  # a change at each tick, one of two wheels: its belt waits
    now = k * 2 * MS
    wheels.add_speed(0, now + 1, now + 1, 90.0)
    wheels.add_load(0, now, now + 1, 4000.0 + k)
    wheels.add_load(0, now, now + 2 + (k + 99) * 2 * MS, 4000.0 + k)  # and one that waits 198 ms for its time
    wheels.tick(now)
    count()
rooms = [len(wheels.belt.length), len(wheels.belt.inputs), wheels.schedule.room, len(wheels.schedule.waiting_stamp)]
for k in range(400, 600):  # constant inputs are one interval, however long
    now = k * 2 * MS
    wheels.add_speed(0, now + 1, now + 1, 90.0)
    wheels.add_load(0, now, now + 1, 5000.0)
    wheels.tick(now)
    count()
print(most_intervals, wheels.belt.room, most_waiting, wheels.belt.waiting.tolist()[0], *rooms)
"""


@pytest.mark.slow
def test_no_queue_grows():
    """Counted in the source as it runs interpreted, whose buffers can be looked at; it is the compiled core's."""
    folder = str(Path(__file__).parents[1])
    numbers = output(sys.executable, "-c", SOURCE_ONLY + GROWTH, PWD=folder).split()
    most_intervals, room, most_waiting, left, lengths, held, stamps, stamps_held = map(int, numbers)
    # 400 changes and the holds between them went by; each made two intervals
    assert most_intervals <= room == 64 and lengths == 2 * room and held == 3 * lengths
    assert 1 <= left <= most_intervals
    # a sample each 2 ms that waits for 198 ms: a hundred, and not four; room is made by doubling, from 16 on
    assert 90 < most_waiting <= 102 and most_waiting <= stamps == 128 and stamps_held == 4 * stamps


@pytest.mark.slow
@models
def test_memory_does_not_grow_with_time(model):
    """Of an estimator whose belt nobody looks at, with inputs that change at every tick, and that stay the same."""
    estimator = running(model)
    estimator.belt(PSI)
    sizes = []
    tracemalloc.start()
    try:
        for first, last in ((0, 500), (500, 1000), (1000, 3000)):
            for k in range(first, last):
                stamp = NOW + (k + 1) * MS
                estimator.add_speed(stamp, 90.0 + (k % 2 if k % 500 < 100 else 0))
                estimator.add_load(stamp, 4000.0 + (k % 3 if k % 500 < 300 else 0))
                assert estimator.advance(stamp)
            sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    # some small integers and caches come and go; one number kept for each of the last 2000 ticks would be 16 000 bytes
    assert sizes[2] - sizes[1] < 10_000
