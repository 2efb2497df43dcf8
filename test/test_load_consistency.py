"""Whether the stated deviations of estimated loads are to be believed: innovations, starts, gaps, a car of others."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from multibody_car import MANOEUVRES, record
from simulated_car import GRAVITY, Car, Drive, simulate_drives

from tire_dynamics import LoadFilter, SensorNoise, estimate_loads, read_vehicle

CAR = read_vehicle(Path(__file__).parents[1] / "config" / "car.yaml")
SETS = {"imu": "imu wheel_speed", "travel": "imu wheel_speed travel", "hub": "imu wheel_speed travel hub"}
MILLISECOND = 1_000_000
pytestmark = pytest.mark.slow


def inside(recording, estimate):
    return 100.0 * (abs(estimate.load - recording.load) < 2.0 * estimate.standard_deviation).mean()


def followed(recording, names, keep=lambda name, time: True, late=None):
    """A filter that has been given the samples; loads, deviations and whether there was an estimate at 200 Hz."""
    car, events = LoadFilter(CAR), []
    for name in names.split():
        source = getattr(recording, name)
        for row, time in enumerate(source[0]):
            if keep(name, time):
                known = time + (0.0 if late is None else late(name))
                events.append((known, round(1e9 * time), name, [column[row].tolist() for column in source[1:]]))
    events.sort(key=lambda event: event[:2])
    shape = recording.load.shape
    load, deviation, following = np.full(shape, np.nan), np.full(shape, np.nan), 0
    for k, time in enumerate(recording.time):
        while following < len(events) and events[following][0] <= time + 1e-9:
            _, stamp, name, values = events[following]
            getattr(car, f"add_{name}")(stamp, *values)
            following += 1
        if car.advance(round(1e9 * time)):
            load[k], deviation[k] = car.load, car.standard_deviation
    return car, load, deviation


@pytest.fixture(scope="module")
def drives():
    """Three of those of benchmarks/loads.py, which has a hundred: smooth, rough, and with a lever of the weight."""
    some = [
        Drive(duration=8.0, roughness=r, target=v, steering=0.7, speed=v / 2.0, bump=0.0, tip=tip)
        for r, v, tip in ((12e-6, 25.0, False), (64e-6, 15.0, False), (32e-6, 20.0, True))
    ]
    return simulate_drives(Car(), some, [0, 1, 2])


@pytest.mark.parametrize("name", SETS)
def test_innovations_are_as_large_as_the_filter_says(drives, name):
    """Their squares over their variances have mean 1 if equations and noise are right. Learning, two slopes of the
    dampers and the tires' damping, which the filter leaves out, are allowed a factor of two.
    """
    for recording in drives:
        car, load, deviation = followed(recording, SETS[name])
        told = {source: value for source, value in car.consistency.items() if value == value}
        assert set(told) == set(SETS[name].split()) - {"wheel_speed"}
        assert all(0.5 < value < 2.0 for value in told.values()), told
        assert (abs(load - recording.load) < 2.0 * deviation).mean() > 0.9


@pytest.mark.parametrize(
    "drive",
    [
        Drive(duration=6.0, speed=0.0, target=0.0, steering=0.0, bump=0.0),
        Drive(duration=6.0, speed=0.0, target=0.0, steering=0.0, bump=0.0, slope=0.12, bank=0.05),
        Drive(duration=6.0, speed=25.0, target=25.0, bump=0.0),
        Drive(duration=6.0, speed=15.0, target=15.0, bump=0.0, slope=-0.1, bank=-0.04, steering=0.5),
    ],
    ids=["at standstill", "at standstill on a slope", "under way", "under way on a slope"],
)
@pytest.mark.parametrize("name", SETS)
def test_it_starts_anywhere(drive, name):
    """From the first second on. A mean load that is off is off for all of one drive: three deviations, not two.

    What it knows before anything was measured is a quarter of the static load.
    """
    [recording] = simulate_drives(Car(), [drive], [5])
    estimate = estimate_loads(CAR, **recording.sources(SETS[name]), at=recording.time)
    within = abs(estimate.load - recording.load) < 3.0 * estimate.standard_deviation
    assert within.mean() > 0.97
    assert within[recording.time < 1.0].mean() > 0.97
    assert (estimate.standard_deviation[recording.time > 0.1] < 0.1 * recording.static).all()


def test_sources_that_vanish_and_come_back_stay_within_what_is_stated(drives):
    recording = drives[0]
    gone = {"travel": (2.0, 4.0), "hub": (3.0, 5.0), "imu": (5.5, 6.5)}
    car, load, deviation = followed(
        recording, SETS["hub"], lambda name, time: not (name in gone and gone[name][0] <= time < gone[name][1])
    )
    error = abs(load - recording.load)
    assert np.isfinite(load).all() and (error < 2.0 * deviation).mean() > 0.9
    time, mean = recording.time, deviation.mean(1)
    degraded, whole = mean[(time > 3.5) & (time < 4.0)].mean(), mean[(time > 1.5) & (time < 2.0)].mean()
    assert degraded > 1.3 * whole
    assert mean[time > 7.5].mean() < 1.2 * whole
    assert car.sources == ("wheel_speed", "imu", "travel", "hub")


def test_gaps_of_everything_and_late_samples(drives):
    """After a gap of 700 ms it begins anew, and knows the mass still; samples up to 40 ms late change no later bit."""
    recording = drives[0]
    random = np.random.default_rng(2)
    car, load, deviation = followed(recording, SETS["hub"], lambda name, time: not 4.0 <= time < 4.7)
    known = np.isfinite(load)
    assert car.restarts == 1 and not known[(recording.time > 4.51) & (recording.time < 4.69)].any()
    assert (abs(load - recording.load) < 2.0 * deviation)[known].mean() > 0.9
    late, some, _ = followed(recording, SETS["hub"], late=lambda name: random.uniform(0.0, 0.04))
    in_time, all_of_them, _ = followed(recording, SETS["hub"])
    end = round(1e9 * recording.time[-1]) - 50 * MILLISECOND
    assert sum(late.counts[name]["late"] for name in late.counts) > 100
    assert np.isfinite(some[20:]).all()
    # what was read while a sample was on its way lacks it; by its size that is little
    np.testing.assert_allclose(some[400:], all_of_them[400:], atol=0.1 * CAR.static_loads[0] * 4.0)
    assert end > 0 and math.isclose(late.mass_error[0], in_time.mass_error[0], abs_tol=5e-3)


def test_what_cannot_be_seen_has_a_large_deviation():
    """A mean load, without travel or a known mass; and the road, for wheel speeds alone."""
    time = np.arange(600) / 100
    still = time, np.tile([0.0, 0.0, GRAVITY], (600, 1)), np.zeros((600, 3))
    carried = np.array(CAR.static_loads) - GRAVITY * np.array(CAR.unsprung_masses)
    for mass in (0.05, 0.2):
        estimate = estimate_loads(CAR, imu=still, noise=SensorNoise(mass=mass))
        assert (estimate.standard_deviation[-1] > 0.95 * mass * carried).all()
    alone = estimate_loads(CAR, wheel_speed=(time, np.full((600, 4), 60.0)))
    with_imu = estimate_loads(CAR, imu=still, wheel_speed=(time, np.full((600, 4), 60.0)))
    assert (alone.standard_deviation[-1] > 1.5 * with_imu.standard_deviation[-1]).all()


@pytest.mark.parametrize("manoeuvre", MANOEUVRES)
def test_the_multibody_model_of_others(manoeuvre):
    """With links that lift the body in a curve, joints that give, and brakes whose moment the springs take whole. It
    goes up to 9 m/s^2, where wheels are about to lift. The filter's own uncertainty covers all of it.
    """
    car, recording = record(manoeuvre)
    change = np.sqrt(((recording.load - recording.static) ** 2).mean())
    for names in SETS.values():
        estimate = estimate_loads(car, **recording.sources(names), at=recording.time)
        assert inside(recording, estimate) > 93.0
        assert np.sqrt(((estimate.load - recording.load) ** 2).mean()) < 0.3 * change
