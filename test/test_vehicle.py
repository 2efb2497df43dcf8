"""Several wheels: routing, outcomes, independence, the clock, the belt's period, the stability reply."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tire_dynamics import TireWheelUnit, simulate, wheel
from tire_dynamics.estimator.belt import ring_angles
from tire_dynamics.estimator.vehicle import Vehicle, VehicleSettings, stability_reply
from tire_dynamics.estimator.wheel_estimator import WheelEstimator

MS = 1_000_000  # ns
NOW = 1_800_000_000_000_000_000
UNIT = TireWheelUnit.table_1(sidewall_damping="reaction")
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
JOINTS = tuple(f"{name}_joint" for name in WHEELS)
SETTINGS = VehicleSettings(UNIT, WHEELS, JOINTS)
TICK = SETTINGS.period


@pytest.fixture
def vehicle():
    return Vehicle(SETTINGS)


def drive(vehicle, ticks, start=NOW, without=(), perturb=()):
    """Speeds, loads and ticks at the node's rate; per wheel the bits of every output, belts included."""
    seen = [[] for _ in WHEELS]
    for k in range(ticks):
        stamp = start + k * TICK
        vehicle.joint_states(stamp, stamp - 300_000, JOINTS, [80.0 + w + 0.1 * k for w in range(4)])
        for index in range(4):
            if index in without and k > ticks // 2:
                continue
            load = 4000.0 + 10.0 * k + (500.0 if index in perturb else 0.0)
            vehicle.load(index, stamp, stamp - 500_000, load, 20.0 * index)
        outputs = vehicle.tick(stamp)
        belts = {belt.wheel: belt.deflection.tobytes() for belt in vehicle.belts()}
        for output in outputs:
            seen[output.wheel].append((k, output.force_x, output.force_z, belts.get(output.wheel)))
    return seen


# -- routing ----------------------------------------------------------------------------------------------------


def test_joint_states_go_by_name(vehicle):
    """In any order, among other joints, and some of them only."""
    names = ["arm", JOINTS[2], JOINTS[0], "steering"]
    vehicle.joint_states(NOW, NOW, names, [9.0, 2.0, math.nan, 8.0])
    vehicle.joint_states(NOW, NOW, [JOINTS[3]], [3.0])
    vehicle.tick(NOW)
    assert [estimator.speed for estimator in vehicle.inputs] == [0.0, 0.0, 2.0, 3.0]
    assert [dict(each.counts) for each in vehicle.inputs] == [{"not finite": 1}, {}, {"taken": 1}, {"taken": 1}]


def test_a_name_that_only_begins_alike_is_another_joint(vehicle):
    vehicle.joint_states(NOW, NOW, [JOINTS[0] + "_2", JOINTS[0][:-1]], [1.0, 2.0])
    assert not any(each.counts for each in vehicle.inputs)


def test_two_messages_with_the_same_names_in_another_order(vehicle):
    vehicle.joint_states(NOW, NOW, JOINTS, [1.0, 2.0, 3.0, 4.0])
    vehicle.joint_states(NOW, NOW + 1, JOINTS[::-1], [40.0, 30.0, 20.0, 10.0])
    vehicle.tick(NOW)
    assert [estimator.speed for estimator in vehicle.inputs] == [1.0, 2.0, 3.0, 4.0]
    vehicle.tick(NOW + 1)
    assert [estimator.speed for estimator in vehicle.inputs] == [10.0, 20.0, 30.0, 40.0]


def test_publishers_without_number_are_not_remembered_for_ever(vehicle):
    for k in range(1000):
        vehicle.joint_states(NOW, NOW + k, [f"joint_{k}", JOINTS[1]], [0.0, float(k)])
    vehicle.tick(NOW + 1000)
    assert vehicle.inputs[1].speed == 999.0
    assert len(vehicle._places) <= 64


def test_wheel_speed_and_load_go_by_index(vehicle):
    vehicle.wheel_speed(1, NOW, 55.0)
    vehicle.load(1, NOW, NOW, 4000.0, 100.0)
    (output,) = vehicle.tick(NOW)
    assert output.wheel == 1
    expected = simulate(UNIT, [0.0], 55.0, 4000.0, 100.0).axle_force[0]
    assert (output.force_x, output.force_z) == pytest.approx(tuple(expected), abs=1e-8)  # k_1/k_s = 40 times rounding


def test_wheel_speed_is_as_of_its_receipt(vehicle):
    vehicle.tick(NOW)
    vehicle.wheel_speed(0, NOW + MS, 55.0)
    vehicle.tick(NOW + MS - 1)
    assert vehicle.inputs[0].speed == 0.0
    vehicle.tick(NOW + MS)
    assert vehicle.inputs[0].speed == 55.0


# -- outcomes ---------------------------------------------------------------------------------------------------


def outcome(vehicle, index=0):
    (name,) = vehicle.inputs[index].counts
    return name


@pytest.mark.parametrize("kind", ["speed", "load"])
def test_no_stamp(vehicle, kind):
    """The time of receipt is taken for it."""
    vehicle.tick(NOW)
    if kind == "speed":
        vehicle.joint_states(NOW + MS, 0, [JOINTS[0]], [5.0])
    else:
        vehicle.load(0, NOW + MS, 0, 5.0, 0.0)
    assert vehicle.inputs[0].counts == {"no stamp": 1, "taken": 1}
    vehicle.tick(NOW + MS)
    assert vehicle.inputs[0].ages() == ((0, None) if kind == "speed" else (None, 0))


@pytest.mark.parametrize("kind", ["speed", "load"])
def test_in_the_future(vehicle, kind):
    """Up to the input timeout after the receipt a stamp is believed, beyond it not."""
    for ahead in (SETTINGS.input_timeout, SETTINGS.input_timeout + 1):
        if kind == "speed":
            vehicle.joint_states(NOW, NOW + ahead, [JOINTS[0]], [5.0])
        else:
            vehicle.load(0, NOW, NOW + ahead, 5.0, 0.0)
    assert vehicle.inputs[0].counts == {"taken": 1, "in the future": 1}


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_too_high(vehicle, sign):
    top_speed, top_load = SETTINGS.max_speed, SETTINGS.max_load
    vehicle.wheel_speed(0, NOW, sign * top_speed)
    vehicle.wheel_speed(1, NOW, sign * np.nextafter(top_speed, np.inf))
    vehicle.wheel_speed(2, NOW, sign * math.inf)
    assert [outcome(vehicle, k) for k in range(3)] == ["taken", "speed too high", "speed too high"]

    vehicle = Vehicle(SETTINGS)
    vehicle.load(0, NOW, NOW, top_load, sign * top_load)
    vehicle.load(1, NOW, NOW, sign * np.nextafter(top_load, np.inf), 0.0)
    vehicle.load(2, NOW, NOW, 0.0, sign * np.nextafter(top_load, np.inf))
    vehicle.load(3, NOW, NOW, sign * math.inf, 0.0)
    assert [outcome(vehicle, k) for k in range(4)] == ["taken", *["load too high"] * 3]
    assert vehicle.tick(NOW) == []


def test_not_finite(vehicle):
    vehicle.wheel_speed(0, NOW, math.nan)
    vehicle.load(1, NOW, NOW, math.nan, 0.0)
    vehicle.load(2, NOW, NOW, 0.0, math.nan)
    assert [outcome(vehicle, k) for k in range(3)] == ["not finite"] * 3


def test_off_the_ground(vehicle):
    """A negative load is taken as zero; its traction stays."""
    vehicle.wheel_speed(0, NOW, 10.0)
    vehicle.load(0, NOW, NOW, -500.0, 30.0)
    (output,) = vehicle.tick(NOW)
    assert vehicle.inputs[0].counts == {"taken": 2, "off the ground": 1}
    assert vehicle.inputs[0].load == (0.0, 30.0)
    assert (output.force_x, output.force_z) == pytest.approx((30.0, 0.0), abs=1e-10)


def test_no_load_is_on_the_ground_yet(vehicle):
    vehicle.load(0, NOW, NOW, 0.0, 0.0)
    assert outcome(vehicle) == "taken"


@pytest.mark.parametrize("velocities", [[], [1.0], [1.0, 2.0, 3.0]])
def test_no_velocity(vehicle, velocities):
    vehicle.joint_states(NOW, NOW, JOINTS[:2], velocities)
    assert vehicle.message_counts == {"no velocity": 1}
    assert not any(each.counts for each in vehicle.inputs)


def test_joint_twice(vehicle):
    """The first is taken."""
    vehicle.joint_states(NOW, NOW, [JOINTS[0], JOINTS[1], JOINTS[0]], [1.0, 2.0, 3.0])
    vehicle.joint_states(NOW, NOW + 1, [JOINTS[0], JOINTS[1], JOINTS[0]], [4.0, 5.0, 6.0])
    vehicle.tick(NOW + 1)
    assert vehicle.inputs[0].counts == {"taken": 2, "joint twice": 2} and vehicle.inputs[1].counts == {"taken": 2}
    assert vehicle.inputs[0].speed == 4.0


def test_late_and_out_of_order_are_the_estimators(vehicle):
    vehicle.tick(NOW)
    for stamp in (NOW - 2, NOW - 1, NOW - 1, NOW - 3, NOW + 1):
        vehicle.load(3, NOW, stamp, 1.0, 0.0)
    assert vehicle.inputs[3].counts == {"late": 2, "repeated": 1, "out of order": 1, "taken": 1}


# -- several wheels ---------------------------------------------------------------------------------------------


def test_outputs_are_those_of_a_wheel_of_its_own():
    seen = drive(Vehicle(SETTINGS), 40)
    alone = Vehicle(VehicleSettings(UNIT, ("only",), (JOINTS[2],)))
    forces = []
    for k in range(40):
        stamp = NOW + k * TICK
        alone.joint_states(stamp, stamp - 300_000, JOINTS, [80.0 + w + 0.1 * k for w in range(4)])
        alone.load(0, stamp, stamp - 500_000, 4000.0 + 10.0 * k, 40.0)
        forces += [(k, o.force_x, o.force_z) for o in alone.tick(stamp)]
    assert forces == [output[:3] for output in seen[2]]


@pytest.mark.parametrize("broken", range(4))
def test_a_wheel_without_load_leaves_the_others_alone(broken):
    """Not a bit of theirs changes when its load stays away, or is another."""
    ticks = 400  # 0.8 s; the load is gone for the second half, the timeout is 0.2 s
    whole = drive(Vehicle(SETTINGS), ticks)
    vehicle = Vehicle(SETTINGS)
    lost = drive(vehicle, ticks, without=[broken])
    other = drive(Vehicle(SETTINGS), ticks, perturb=[broken])
    for index in range(4):
        if index == broken:
            assert lost[index][: ticks // 2] == whole[index][: ticks // 2]
            assert lost[index][-1][0] == ticks // 2 + 99  # the last load's stamp is half a millisecond before tick 200
            assert other[index] != whole[index]
        else:
            assert lost[index] == whole[index] and other[index] == whole[index]
    assert [estimator.running for estimator in vehicle.inputs] == [index != broken for index in range(4)]


def test_mean_force_is_the_load():
    """A steady drive of four wheels, each with its own load: with a reaction the axle carries it all."""
    vehicle = Vehicle(SETTINGS)
    loads = [3000.0, 3500.0, 4000.0, 4500.0]
    for k in range(100):
        stamp = NOW + k * TICK
        vehicle.joint_states(stamp, stamp, JOINTS, [50.0] * 4)
        for index, load in enumerate(loads):
            vehicle.load(index, stamp, stamp, load, 0.0)
        outputs = vehicle.tick(stamp)
        assert [o.wheel for o in outputs] == [0, 1, 2, 3]
        assert [o.force_z for o in outputs] == pytest.approx(loads, rel=1e-10)
        assert [o.force_x for o in outputs] == pytest.approx([0.0] * 4, abs=1e-7)  # 1e-11 of the load, k_1/k_s = 40


# -- time -------------------------------------------------------------------------------------------------------


def test_no_output_before_both_inputs(vehicle):
    assert vehicle.tick(NOW) == []
    vehicle.wheel_speed(0, NOW, 1.0)
    assert vehicle.tick(NOW + TICK) == []


def test_a_clock_set_back_starts_afresh():
    vehicle = Vehicle(SETTINGS)
    drive(vehicle, 60)
    again = drive(vehicle, 60, start=NOW - 3600 * 1000 * MS)
    assert vehicle.clock_resets == 1
    fresh = drive(Vehicle(SETTINGS), 60, start=NOW - 3600 * 1000 * MS)
    # the first messages after the change come before its first tick, which forgets them: one tick is lost
    for index in range(4):
        assert [output[0] for output in again[index]][0] <= 1
        assert np.isfinite([output[1:3] for output in again[index]]).all()
        assert abs(again[index][-1][2] - fresh[index][-1][2]) < 50.0  # started one sample (10 N) later


def test_time_standing_still_is_no_step_back(vehicle):
    drive(vehicle, 5)
    before = json.dumps(vehicle.snapshot())
    outputs = vehicle.tick(vehicle.time)
    assert len(outputs) == 4 and vehicle.clock_resets == 0
    assert json.dumps(vehicle.snapshot()) == before


def test_belt_comes_once_in_its_period():
    """At a wheel's first tick in each 20 ms of its own part of the clock, whatever the ticks' jitter."""
    vehicle = Vehicle(SETTINGS)
    rng = np.random.default_rng(3)
    stamp, periods = NOW, [[] for _ in WHEELS]
    for _ in range(300):
        stamp += int(rng.integers(1, 4 * MS))
        vehicle.joint_states(stamp, stamp, JOINTS, [50.0] * 4)
        for index in range(4):
            vehicle.load(index, stamp, stamp, 4000.0, 0.0)
        vehicle.tick(stamp)
        wheels = [belt.wheel for belt in vehicle.belts()]
        assert vehicle.belts() == []  # once
        for index in wheels:
            periods[index].append((stamp + index * SETTINGS.ring_period // 4) // SETTINGS.ring_period)
    for index, mine in enumerate(periods):
        assert mine == list(range(mine[0], mine[0] + len(mine)))
        assert mine[-1] == (stamp + index * SETTINGS.ring_period // 4) // SETTINGS.ring_period


def test_belt_is_the_simulated_one():
    settings = VehicleSettings(UNIT, ring_samples=24, n_max=9)
    vehicle = Vehicle(settings)
    vehicle.wheel_speed(0, NOW, 120.0)
    vehicle.load(0, NOW, NOW, 4000.0, 250.0)
    vehicle.tick(NOW)
    ((index, belt),) = vehicle.belts()
    psi = 2.0 * math.pi * np.arange(24) / 24
    expected = simulate(UNIT, [0.0], 120.0, 4000.0, 250.0, psi=psi, n_max=9)
    assert index == 0 and belt.shape == (2, 24)
    # millimetres; equilibrium and cosines rounded
    assert belt[0] == pytest.approx(expected.u_z[0], abs=1e-15)
    assert belt[1] == pytest.approx(expected.u_theta[0], abs=1e-15)
    assert belt[0].argmin() == 18  # 3 pi/2: pressed in at the contact


@pytest.mark.parametrize("model", ["inextensional", "complete"])
def test_belt_and_forces_are_the_wheels_of_that_model(model):
    """In motion too: the forces and the shape are those of an estimator fed with the same samples."""
    settings = VehicleSettings(UNIT, WHEELS, JOINTS, ring_samples=24, n_max=9, model=model)
    seen = drive(Vehicle(settings), 60)
    alone = WheelEstimator(UNIT, model=model, n_max=9, timeout=settings.input_timeout)
    for k in range(60):
        stamp = NOW + k * TICK
        alone.add_speed(stamp - 300_000, 82.0 + 0.1 * k)
        alone.add_load(stamp - 500_000, 4000.0 + 10.0 * k, 40.0)
        alone.advance(stamp)
        period = settings.ring_period
        due = not k or (stamp + period // 2) // period != (stamp - TICK + period // 2) // period  # the third of four
        number, force_x, force_z, belt = seen[2][k]
        assert (number, force_x, force_z) == (k, *alone.axle_force)
        assert (belt is not None) == due
        if due:
            expected = alone.belt(ring_angles(24))
            # the same amplitudes: two dozen products of millimetres, added in another order
            assert np.abs(np.frombuffer(belt).reshape(2, 24) - expected).max() <= 1e-14 * np.abs(expected).max()


def test_another_tire_for_every_wheel(vehicle):
    drive(vehicle, 20)
    before = [state["state"] for state in vehicle.snapshot()["wheels"]]
    soft = UNIT.replace(radial_stiffness=4e6)
    vehicle.set_unit(soft)
    assert vehicle.unit == soft
    assert [state["state"] for state in vehicle.snapshot()["wheels"]] == before
    drive(vehicle, 20, start=NOW + 20 * TICK)
    assert vehicle.stability(0)["critical_speed_rad_s"] == wheel.critical_speed(soft)


# -- snapshot ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=10)
@given(ticks=st.integers(0, 60), model=st.sampled_from(["inextensional", "complete"]))
def test_snapshot_continues_bit_for_bit(ticks, model):
    """Through JSON, belts and all, from the middle of a ring period too."""
    original, copied = (Vehicle(dataclasses.replace(SETTINGS, model=model)) for _ in range(2))
    drive(original, ticks)
    drive(copied, 7, start=NOW + 3600 * 1000 * MS)
    copied.restore(json.loads(json.dumps(original.snapshot(), allow_nan=False)))
    start = NOW + ticks * TICK
    assert drive(original, 60, start) == drive(copied, 60, start)
    assert original.snapshot() == copied.snapshot()


def test_snapshot_of_other_wheels_is_refused(vehicle):
    two = Vehicle(VehicleSettings(UNIT, WHEELS[:2], JOINTS[:2]))
    four = vehicle.snapshot()
    for snapshot in (four, {**four, "wheels": four["wheels"][:2]}, {**four, "ring_turns": four["ring_turns"][:2]}):
        with pytest.raises(ValueError, match="there are 2 wheels"):
            two.restore(snapshot)
    with pytest.raises(ValueError, match="there are 4 wheels"):
        vehicle.restore(two.snapshot())


@pytest.mark.parametrize("index", [-1, 4, 2**40])
def test_there_is_no_other_wheel(vehicle, index):
    """What is compiled writes where it is told to, so that it has to be told where nothing is."""
    wheels = vehicle.wheels
    calls = [
        lambda: vehicle.wheel_speed(index, NOW, 1.0),
        lambda: vehicle.load(index, NOW, NOW, 1.0, 0.0),
        lambda: wheels.force_of(index),
        lambda: wheels.noted_orders(index),
        lambda: wheels.count_joint_twice(index),
        lambda: wheels.schedule.add_speed(index, NOW, 1.0),
        lambda: wheels.schedule.add_load(index, NOW, 1.0),
        lambda: wheels.schedule.ages(index),
        lambda: wheels.schedule.counts_of(index),
        lambda: wheels.motion.advance(index, 1e-3, 1.0, 1.0),
        lambda: wheels.motion.put(index, np.zeros(6), 1.0, 0.0),
        lambda: wheels.motion.reset(index),
        lambda: wheels.motion.axle_force(index, 1.0),
        lambda: wheels.motion.snapshot(index),
        lambda: wheels.belt.advance(index, MS, 1.0, 1.0),
        lambda: wheels.belt.deflection(index, wheels.motion),
        lambda: wheels.belt.reset(index),
        lambda: wheels.belt.start(index, 1.0, 1.0, 0.0),
        lambda: wheels.belt.snapshot(index),
    ]
    before = vehicle.snapshot()
    for call in calls:
        with pytest.raises(IndexError, match=f"wheel is {index}; it must be from 0 to 3"):
            call()
    assert vehicle.snapshot() == before


# -- stability --------------------------------------------------------------------------------------------------

KEYS = ["wheel", "speed_rad_s", "period_s", "verdict", "spectral_radius", "multipliers", "exponents_1_s",
        "critical_speed_rad_s", "periodicity", "nearest_tongue_rad_s", "contact", "n_max"]  # fmt: skip


@pytest.mark.parametrize("speed", [120.0, -120.0])
def test_stability_reply(vehicle, speed):
    vehicle.wheel_speed(2, NOW, speed)
    vehicle.tick(NOW)
    reply = vehicle.stability(2)
    assert list(reply) == KEYS
    assert json.loads(json.dumps(reply, allow_nan=False)) == reply
    assert (reply["wheel"], reply["speed_rad_s"], reply["verdict"]) == ("rear_left", speed, "asymptotically stable")
    assert reply["period_s"] == 2.0 * math.pi / 120.0
    multipliers = np.array([complex(*pair) for pair in reply["multipliers"]])
    exponents = np.array([complex(*pair) for pair in reply["exponents_1_s"]])
    assert reply["spectral_radius"] == np.abs(multipliers).max() < 1.0
    assert np.exp(exponents * reply["period_s"]) == pytest.approx(multipliers, abs=1e-12)
    rpm = reply["critical_speed_rad_s"] * 30.0 / math.pi
    assert rpm == pytest.approx(13035.0, abs=0.5)  # docs/model.md, section 12


def test_stability_reply_at_standstill(vehicle):
    """Before there is a speed, too."""
    reply = vehicle.stability(0)
    assert list(reply) == KEYS
    assert json.loads(json.dumps(reply, allow_nan=False)) == reply
    assert reply["speed_rad_s"] == 0.0
    assert reply["period_s"] is None and reply["multipliers"] is None and reply["spectral_radius"] is None
    assert reply["verdict"] == "asymptotically stable" and len(reply["exponents_1_s"]) == 6


def test_stability_reply_of_the_complete_model():
    """Its own multipliers, ten of them, and its own critical speed."""
    vehicle = Vehicle(dataclasses.replace(SETTINGS, model="complete"))
    vehicle.wheel_speed(2, NOW, 120.0)
    vehicle.tick(NOW)
    reply = vehicle.stability(2)
    assert reply == stability_reply("rear_left", UNIT, 120.0, "complete")
    assert len(reply["multipliers"]) == len(reply["exponents_1_s"]) == 10
    assert reply["critical_speed_rad_s"] == wheel.critical_speed(UNIT, "complete")
    assert reply["critical_speed_rad_s"] != wheel.critical_speed(UNIT)


def test_stability_reply_of_a_unit_that_never_loses_it():
    reply = stability_reply("wheel", UNIT.replace(zeta_1=0.0), 100.0)
    assert reply["critical_speed_rad_s"] is None
    json.dumps(reply, allow_nan=False)


@pytest.mark.parametrize("speed", [1e-12, 1e-3, 0.1, 3000.0, 1e5])
def test_stability_reply_is_json_at_any_speed(speed):
    json.dumps(stability_reply("wheel", UNIT, speed), allow_nan=False)
