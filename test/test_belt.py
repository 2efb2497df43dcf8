"""The belt of the live estimator: the same motion as the simulated one, its steady state, and its snapshot."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tire_dynamics import TireWheelUnit, ring, simulate, wheel
from tire_dynamics.estimator.belt import BeltMotion, BeltShape, belt_numbers, ring_angles
from tire_dynamics.estimator.wheel_estimator import WheelEstimator
from tire_dynamics.science import kernels

MS = 1_000_000  # ns
NOW = 1_800_000_000_000_000_000
UNIT = TireWheelUnit.table_1(sidewall_damping="reaction", contact_half_angle=0.1)
N_MAX, SAMPLES = 9, 24
PSI = ring_angles(SAMPLES)
models = pytest.mark.parametrize("model", ["inextensional", "complete"])


def estimator_of(model, unit=UNIT, timeout=None):
    return WheelEstimator(unit, model=model, n_max=N_MAX, timeout=timeout)


def shape_of(model):
    return BeltShape(PSI, belt_numbers(N_MAX, model))


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


@pytest.mark.parametrize("rows", [(), (3,), (2, 3)])
def test_shape_is_the_sum_over_its_modes(rows):
    """u = Re[conj(Z) exp(i n psi)] for each n, and the first harmonic from its four amplitudes, row by row."""
    rng = np.random.default_rng(1)
    numbers, psi = [0, 2, 5], np.array([0.0, 0.3, 4.0, -1.0, 10.0])
    first = rng.normal(size=(*rows, 4))
    Z_1, Z_2 = rng.normal(size=(2, *rows, 3)) + 1j * rng.normal(size=(2, *rows, 3))
    found = BeltShape(psi, numbers).deflection(first, Z_1, Z_2)
    assert found.shape == (*rows, 2, 5)
    for row in np.ndindex(*rows):
        for component, Z in enumerate((Z_1[row], Z_2[row])):
            a, b = first[row][2 * component : 2 * component + 2]
            expected = a * np.cos(psi) + b * np.sin(psi)
            for n, value in zip(numbers, Z, strict=True):
                expected = expected + (np.conj(value) * np.exp(1j * n * psi)).real
            assert found[row][component] == pytest.approx(expected, abs=1e-14)  # eight terms of size 1


@pytest.mark.parametrize("psi", [0.0, [[0.0]], [math.nan], [math.inf]], ids=str)
def test_wrong_angles(psi):
    with pytest.raises(ValueError, match="psi"):
        BeltShape(psi, [2, 3])


# -- the same as the simulated one ------------------------------------------------------------------------------


@models
@pytest.mark.parametrize("speed", [0.0, 120.0, -200.0])
def test_constant_inputs(model, speed):
    """Steady from the start, tick after tick, in both."""
    estimator, shape = estimator_of(model), shape_of(model)
    estimator.add_speed(NOW, speed)
    estimator.add_load(NOW, 4000.0, 250.0)
    t = 2e-3 * np.arange(51)
    expected = simulate(UNIT, t, speed, 4000.0, 250.0, psi=PSI, n_max=N_MAX, model=model)
    scale = np.abs(expected.u_z).max()
    for k in range(51):
        assert estimator.advance(NOW + 2 * MS * k)
        belt = estimator.belt(shape)
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
    estimator, shape = estimator_of(model), shape_of(model)
    for stamp, speed, load, traction in zip(stamps, speeds, loads, tractions, strict=True):
        estimator.add_speed(NOW + int(stamp), speed)
        estimator.add_load(NOW + int(stamp), load, traction)
    found, ticks = [], range(0, 42 * MS, 3 * MS)
    for tick in ticks:
        assert estimator.advance(NOW + tick)
        found.append(estimator.belt(shape))

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
    estimator, shape = estimator_of(model), shape_of(model)
    samples = [(0, 100.0, 4000.0, 0.0), (4 * MS, 140.0, 7000.0, -500.0), (9 * MS, 60.0, 1000.0, 800.0)]
    for stamp, speed, load, traction in samples:
        estimator.add_speed(NOW + stamp, speed)
        estimator.add_load(NOW + stamp, load, traction)
    estimator.advance(NOW + 14 * MS)
    found, errors = estimator.belt(shape), []
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
    estimator, shape = estimator_of(model, unit), shape_of(model)
    estimator.add_speed(NOW, 30.0)
    estimator.add_load(NOW, 9000.0, 0.0)
    estimator.advance(NOW)
    estimator.add_speed(NOW + 5 * MS, speed)
    estimator.add_load(NOW + 5 * MS, 4000.0, 0.0)
    for k in range(1, 401):
        estimator.advance(NOW + 50 * MS * k)
    belt = estimator.belt(shape)
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
    estimator, shape = estimator_of(model), shape_of(model)
    estimator.add_speed(NOW, 77.0)
    estimator.add_load(NOW, 4000.0, 300.0)
    estimator.advance(NOW)
    belt = estimator.belt(shape)
    expected = simulate(UNIT, [0.0], 77.0, 4000.0, 300.0, psi=PSI, n_max=N_MAX, model=model)
    assert np.abs(belt - [expected.u_z[0], expected.u_theta[0]]).max() <= 1e-15  # millimetres, rounded
    estimator.advance(NOW + 3600 * 1000 * MS)
    assert np.abs(estimator.belt(shape) - belt).max() <= 1e-12 * np.abs(belt).max()


@models
def test_starts_steady_again_after_a_gap(model):
    """Nothing of the motion before the gap is left."""
    estimator, shape = estimator_of(model, timeout=100 * MS), shape_of(model)
    estimator.add_speed(NOW, 77.0)
    estimator.add_load(NOW, 4000.0)
    estimator.add_load(NOW + 50 * MS, 9000.0)
    assert estimator.advance(NOW + 60 * MS) and not estimator.advance(NOW + 400 * MS)
    estimator.add_speed(NOW + 500 * MS, 30.0)
    estimator.add_load(NOW + 500 * MS, 2000.0)
    assert estimator.advance(NOW + 500 * MS)
    expected = simulate(UNIT, [0.0], 30.0, 2000.0, psi=PSI, n_max=N_MAX, model=model)
    assert np.abs(estimator.belt(shape) - [expected.u_z[0], expected.u_theta[0]]).max() <= 1e-15


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


def run(estimator, shape, calls):
    seen = []
    for name, offset, *values in calls:
        stamp = (estimator.time if estimator.time is not None else NOW) + offset * MS
        if name == "belt":
            seen.append(estimator.belt(shape).tobytes())
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
    shape, calls = shape_of(model), [*calls, ("belt", 0)]
    assert run(running(model), shape, calls) == run(running(model), shape, calls)


@models
@settings(max_examples=25)
@given(before=CALLS, after=CALLS)
def test_snapshot_continues_bit_for_bit(model, before, after):
    """Through JSON, with steps that wait to be taken together, in an estimator that has had another past."""
    shape, original, copied = shape_of(model), running(model), estimator_of(model, timeout=50 * MS)
    run(original, shape, before)
    text = json.dumps(original.snapshot(), allow_nan=False)
    run(copied, shape, [("speed", 0, 33.0), ("load", 0, 1.0, 1.0), ("advance", 7), ("speed", 9, 1.0)])
    copied.restore(json.loads(text))
    after = [*after, ("belt", 0)]
    assert run(original, shape, after) == run(copied, shape, after)
    assert json.dumps(original.snapshot()) == json.dumps(copied.snapshot())


@models
def test_reading_or_saving_does_not_change_the_motion(model):
    """Steps wait to be taken together until the belt is read; how often that is changes the last bits at most."""
    shape, seldom, often = shape_of(model), running(model), running(model)
    for k in range(1, 700):  # more than the steps that may wait
        for estimator in (seldom, often):
            estimator.add_load(NOW + k * MS, 4000.0 + 2000.0 * math.sin(0.3 * k), 10.0 * (k % 7))
            estimator.add_speed(NOW + k * MS, 90.0 if k < 350 else 110.0)
            estimator.advance(NOW + k * MS)
        if k % 3 == 0:
            often.belt(shape)
    difference = np.abs(seldom.belt(shape) - often.belt(shape)).max()
    # a rounding per step, of a motion that decays
    assert difference <= 1e-13 * np.abs(often.belt(shape)).max()


@models
def test_another_tire_goes_on_from_the_same_belt(model):
    estimator, shape = running(model), shape_of(model)
    estimator.add_load(NOW, 8000.0)
    estimator.advance(NOW + 5 * MS)
    before = estimator.belt(shape)
    estimator.set_unit(UNIT.replace(radial_stiffness=4e6))
    assert np.array_equal(estimator.belt(shape), before)
    # it moves on with the new stiffness: like an estimator of that unit from the same snapshot
    other = estimator_of(model, UNIT.replace(radial_stiffness=4e6), timeout=50 * MS)
    other.restore(json.loads(json.dumps(estimator.snapshot())))
    for each in (estimator, other):
        each.advance(NOW + 9 * MS)
    assert np.array_equal(estimator.belt(shape), other.belt(shape))
    assert not np.array_equal(estimator.belt(shape), before)


def test_snapshot_of_another_belt_is_refused():
    for other in (BeltMotion(UNIT, 5, "inextensional", 1, kernels), BeltMotion(UNIT, N_MAX, "complete", 1, kernels)):
        with pytest.raises(ValueError, match="shape"):
            BeltMotion(UNIT, N_MAX, "inextensional", 1, kernels).restore(0, other.snapshot(0))
