"""All wheel speeds in another unit or of another sign, told by an IMU: on drives that others simulated and recorded."""

from __future__ import annotations

import math

import multibody_car
import numpy as np
import pytest
from simulated_car import Car, Drive, simulate_drives

from tire_dynamics.replay.motion_watch import MotionWatch
from tire_dynamics.replay.parameters import complete

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
SECOND = 10**9
START = 1_700_000_000 * SECOND
RADIUS = 0.31
G = 9.80665

FAULTS = {
    # unit that is told, by what the speeds [m/s] are multiplied to be what it says, what is asked
    "km/h for rad/s": ("rad/s", 3.6, "are the speeds in km/h, and not in rad/s?"),
    "km/h for m/s": ("m/s", 3.6, "are the speeds in km/h, and not in m/s?"),
    "m/s for rad/s": ("rad/s", 1.0, "are the speeds in m/s, and not in rad/s?"),
    "rpm for rad/s": ("rad/s", 30.0 / math.pi / RADIUS, "are the speeds in rpm, and not in rad/s?"),
    "mph for km/h": ("km/h", 1.0 / 0.44704, "are the speeds in mph, and not in km/h?"),
    "backward": ("m/s", -1.0, "is the sign of the speeds another"),
    "of a motor": ("m/s", 8.3, "do unit and radius fit?"),
}  # fmt: skip
TO_SI = {"rad/s": 1.0, "m/s": 1.0 / RADIUS, "km/h": 1.0 / 3.6 / RADIUS}


def watched(time, speed, imu_time, imu, unit="m/s", factor=1.0, order=(0, 1, 2, 3)):
    """What is said of a drive, as (seconds after its begin, line); speeds (N, 4) in m/s."""
    watch = MotionWatch(complete({"wheels": WHEELS, "inputs.speed.unit": unit, "inputs.speed.radius": RADIUS}))
    told = (TO_SI[unit] * factor * np.asarray(speed))[:, list(order)].tolist()
    samples = [(t, "speed", row) for t, row in zip(time.tolist(), told, strict=True)]
    samples += [(t, "imu", row) for t, row in zip(imu_time.tolist(), imu.tolist(), strict=True)]
    said: list[tuple[float, str]] = []
    begin = min(samples)[0]
    for t, quantity, row in sorted(samples, key=lambda sample: sample[0]):
        stamp = START + round(1e9 * (t - begin))
        watch.take(quantity, None, stamp, stamp, tuple(row))
        said += [(t - begin, text) for text in watch.ever.values() if text not in [line for _, line in said]]
    return said


def columns(recording, radius):
    """Of a simulated drive."""
    time, force, rate = recording.imu
    return recording.wheel_speed[0], radius * recording.wheel_speed[1], time, np.column_stack([force, rate])


@pytest.fixture(scope="module")
def drives():
    kinds = {
        "level": Drive(duration=20.0),
        "uphill": Drive(duration=20.0, slope=0.1),
        "banked": Drive(duration=20.0, bank=0.08),
        "fast, its body tipping": Drive(duration=20.0, target=30.0, steering=1.6, tip=True),
        "straight": Drive(duration=20.0, steering=0.0),
    }
    recordings = simulate_drives(Car(), list(kinds.values()), list(range(len(kinds))))
    return {name: columns(each, Car().rolling_radius) for name, each in zip(kinds, recordings, strict=True)}


KINDS = ("level", "uphill", "banked", "fast, its body tipping", "straight")


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", KINDS)
def test_a_unit_that_all_wheels_have_is_said(drives, name, fault):
    """Once the car has been driven in a way that tells: mostly within 5 s."""
    unit, factor, words = FAULTS[fault]
    [(when, said)] = watched(*drives[name], unit, factor)
    assert words in said and when < 12.0


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("unit", ["m/s", "km/h"])
def test_nothing_is_said_of_a_drive_that_is_right(drives, name, unit):
    assert watched(*drives[name], unit, 3.6 if unit == "km/h" else 1.0) == []


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.96, 1.04])
@pytest.mark.parametrize("name", KINDS)
def test_nothing_is_said_of_a_radius_that_is_off_by_4_percent(drives, name, share):
    assert watched(*drives[name], "rad/s", share / RADIUS) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in KINDS if name != "straight"])
def test_left_and_right_exchanged_are_said(drives, name):
    [(when, said)] = watched(*drives[name], order=(1, 0, 3, 2))
    assert said == "by the imu the left wheels are on the right: is the order of the wheels another?" and when < 12.0


@pytest.mark.slow
@pytest.mark.parametrize("name", multibody_car.MANOEUVRES)
def test_slip_is_no_other_unit(name):
    """Braking with 6 m/s^2, a step of the steering, a slalom at the limit, by a car that others wrote."""
    car, recording = multibody_car.record(name, duration=5.5 if name == "braking" else 7.0, speed=24.0)
    assert watched(*columns(recording, car.rolling_radius)) == []


@pytest.mark.slow
def test_a_drive_that_another_program_simulated(fullcar):
    imu = np.loadtxt(fullcar / "imu.csv", delimiter=",", skiprows=1)
    wheels = np.loadtxt(fullcar / "wheel_speed.csv", delimiter=",", skiprows=1)
    drive = wheels[:, 0], 0.305 * wheels[:, 1:], imu[:, 0], imu[:, 1:]
    assert watched(*drive) == []
    for unit, factor, words in FAULTS.values():
        [(when, said)] = watched(*drive, unit, factor)
        assert words in said and when <= 5.05


@pytest.mark.slow
def test_a_real_drive_without_a_gyroscope(drive):
    """Slopes are unknown then: nothing is said of the drive as it is, and what is far off is said later."""
    meter = np.loadtxt(drive / "accelerometer.csv", delimiter=",", skiprows=1)
    wheels = np.loadtxt(drive / "wheel_speed.csv", delimiter=",", skiprows=1)
    imu = np.column_stack([meter[:, 1:] * [1.0, -1.0, -1.0], np.zeros((len(meter), 3))])
    recorded = wheels[:, 0], wheels[:, 1:], meter[:, 0], imu
    assert watched(*recorded) == []
    for fault in ("km/h for m/s", "m/s for rad/s", "rpm for rad/s", "backward"):
        unit, factor, words = FAULTS[fault]
        [(when, said)] = watched(*recorded, unit, factor)
        assert words in said and when < 20.0


# -- where nothing can be said ----------------------------------------------------------------------------------------


def motion(speed, seconds=20.0, slope=0.0, noise=0.3):
    """A drive straight ahead at a speed of time, on a slope, with a noisy IMU."""
    random = np.random.default_rng(3)
    time = np.arange(0.0, seconds, 0.01)
    v = speed(time)
    imu = noise * random.standard_normal((time.size, 6)) * [1.0, 1.0, 1.0, 0.03, 0.03, 0.03]
    imu[:, 0] += np.gradient(v, time) + G * math.sin(slope)
    imu[:, 2] += G * math.cos(slope)
    return time, np.repeat(v[:, None], 4, axis=1), time, imu


@pytest.mark.parametrize("factor", [1.0, 3.6])
@pytest.mark.parametrize(
    ("speed", "slope"),
    [
        (lambda t: 0.0 * t, 0.0),
        (lambda t: 0.0 * t, 0.3),
        (lambda t: 20.0 + 0.0 * t, 0.0),
        (lambda t: 20.0 + 0.0 * t, 0.25),
        (lambda t: 10.0 + 0.5 * t, -0.1),
        (lambda t: 0.2 + 0.2 * np.sin(2.0 * t), 0.0),
    ],
    ids=["at rest", "at rest on a slope", "at constant speed", "up a slope", "evenly faster", "creeping"],
)
def test_nothing_is_said_where_nothing_can_be(speed, slope, factor):
    assert watched(*motion(speed, slope=slope), factor=factor) == []


def wavy(t):
    return 15.0 + 4.0 * np.sin(1.5 * t)


@pytest.mark.parametrize("fault", FAULTS)
def test_it_is_said_within_5_s_of_a_drive_that_tells(fault):
    unit, factor, words = FAULTS[fault]
    [(when, said)] = watched(*motion(wavy), unit, factor)
    assert words in said and when <= 5.05


def test_what_is_right_again_is_said_no_more():
    time, speed, imu_time, imu = motion(wavy, 40.0)
    watch = MotionWatch(complete({"wheels": WHEELS, "inputs.speed.unit": "m/s", "inputs.speed.radius": RADIUS}))
    held = []
    for t, row, six in zip(time.tolist(), (speed / RADIUS).tolist(), imu.tolist(), strict=True):
        stamp = START + round(1e9 * t)
        watch.take("imu", None, stamp, stamp, tuple(six))
        for wheel in range(4):  # each wheel by itself, and the others not numbers
            own = [row[k] * (3.6 if t < 10.0 else 1.0) if k == wheel else math.nan for k in range(4)]
            watch.take("speed", wheel, stamp, stamp, tuple(own))
        held.append(list(watch.doubts))
    assert held[300] == [] and "in km/h" in held[999][0] and held[-1] == []
    assert len(watch.ever) == 1


def test_an_imu_without_gravity_in_it_a_dead_one_and_gaps_are_no_witness():
    time, speed, imu_time, imu = motion(wavy)
    assert watched(time, speed, imu_time, imu - [0.0, 0.0, G, 0.0, 0.0, 0.0], factor=3.6) == []
    assert watched(time, speed, imu_time[:5], imu[:5], factor=3.6) == []
    seldom = slice(None, None, 300)  # every 3 s
    assert watched(time[seldom], speed[seldom], imu_time, imu, factor=3.6) == []
    assert watched(time, speed, imu_time, imu, factor=3.6)


def test_noise_for_numbers_and_a_clock_that_is_set_back_end_nothing():
    watch = MotionWatch(complete({"wheels": WHEELS}))
    for k in range(3000):
        stamp = START + 10_000_000 * (k if k < 1500 else k - 1500)
        odd = [1e308, -1e308, math.inf, math.nan][k % 4]
        watch.take("speed", None, stamp, stamp, (odd, 50.0, 50.0, 50.0))
        watch.take("imu", None, stamp, stamp, (odd, 0.0, G, 0.0, odd, 0.0))
        watch.take("travel", None, stamp, stamp, (odd,) * 4)
    assert watch.doubts == []
