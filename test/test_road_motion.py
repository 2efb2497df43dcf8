"""The compiled steps on the road, against DOP853 with events in ring axes, numbers of others, and the reference."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from contact_reference import ContactStepper
from test_contact_step import (
    CAR,
    LOAD,
    bump,
    bumps,
    errors_fall_at_constant_speed,
    errors_fall_at_varying_speed,
    errors_fall_through_lift_off,
    meets_the_bump,
    models,
)

from tire_dynamics import TireWheelUnit, ring, simulate, wheel
from tire_dynamics.estimator.belt import BeltMotion
from tire_dynamics.estimator.motion import Motion
from tire_dynamics.estimator.road_constants import on_the_road, under_the_belt
from tire_dynamics.estimator.road_motion import RoadMotion
from tire_dynamics.science import contact
from tire_dynamics.science.contact_points import ContactPoints

HELD = CAR.replace(sprung_mass=0.0)


def wheels_on_the_road(unit, model="inextensional", n_max=10, loads=(LOAD,), points=1, coupled=0):
    motion = Motion(on_the_road(unit), model, len(loads))
    belt = BeltMotion(under_the_belt(unit), model, n_max, len(loads), [0.0, 1.0])
    return RoadMotion(unit, motion, belt, loads, points, coupled)


def seen(road, index=0):
    return [*road.axle_force(index), road.contact_of(index)]


def driven(unit, model, n_max, drive, parts):
    """[axle x, axle z, contact force] at the drive's times, each piece of the drive in equal parts."""
    place = np.arange((len(drive.t) - 1) * parts + 1) / parts
    at = np.arange(len(drive.t))
    time, speed, height = (np.interp(place, at, values) for values in (drive.t, drive.speed, drive.radial))
    found = simulate(unit, time, speed, road=height, static_load=LOAD, n_max=n_max, model=model)
    return np.column_stack([found.axle_force, found.contact_force])[::parts]


# -- direct integration -----------------------------------------------------------------------------------------------


@pytest.mark.slow
@models
@pytest.mark.parametrize("seed", range(3))
def test_steps_at_constant_speed(model, seed):
    errors_fall_at_constant_speed(driven, model, seed)


@pytest.mark.slow
@models
@pytest.mark.parametrize("seed", range(2))
def test_steps_at_varying_speed(model, seed):
    errors_fall_at_varying_speed(driven, model, seed)


@pytest.mark.slow
@models
def test_lift_off_and_landing(model):
    errors_fall_through_lift_off(driven, model, (8, 16, 32))


@models
@pytest.mark.parametrize("points", [1, 5])
def test_a_damper_of_the_tread_keeps_the_order(model, points):
    """The contact force that is published, on a road of lines: third order, as without a damper; to itself, finer."""
    unit, at = HELD.replace(residual_damping=400.0, zeta_1=0.1), 4e-3 * np.arange(9)
    heights = np.concatenate([[0.0], np.random.default_rng(1).normal(0.0, 1e-3, 8)])

    def contact_force(parts):
        t = np.linspace(0.0, at[-1], 8 * parts + 1)
        road = np.interp(t, at, heights)
        speed = 0.0 if points > 1 else 60.0  # where points roll, they feel the bends of the road within a step
        found = simulate(unit, t, speed, road=road, static_load=LOAD, n_max=3, model=model, contact_points=points)
        return found.contact_force[::parts]

    errors = [np.abs(contact_force(parts) - contact_force(128)).max() for parts in (4, 8, 16)]
    assert errors[0] > 6.0 * errors[1] > 36.0 * errors[2]


# -- numbers of docs/model.md, section 12 -----------------------------------------------------------------------------


def over_the_bump(height, step):
    """[axle z, contact force] every millisecond to 120 ms, n_max 10, 60 rad/s, on a body that is held."""
    at, _ = bump(height)
    t = step * np.arange(round(0.12 / step) + 1)
    found = simulate(HELD, t, 60.0, road=[at(each) for each in t], static_load=LOAD, n_max=10)
    return np.column_stack([found.axle_force[:, 1], found.contact_force])[:: round(1e-3 / step)]


@bumps
def test_bumps(height, force, axle, lost):
    meets_the_bump(over_the_bump(height, 2.5e-4), height, force, axle, lost)


@pytest.mark.parametrize(
    ("height", "bars"),
    [(0.01, ((0.97, 20.0), (0.25, 5.6), (0.06, 1.4))), (0.06, ((16.0, 150.0), (2.7, 38.0), (0.85, 10.0)))],
)
def test_bumps_are_closer_than_with_a_force_that_is_continuous(height, bars):
    """Its errors at 1, 0.5 and 0.25 ms, of axle and contact [N]; the road is here a chain of lines of the step."""
    fine = over_the_bump(height, 1.0 / 32e3)
    for step, bar in zip((1e-3, 5e-4, 2.5e-4), bars, strict=True):
        assert (np.abs(over_the_bump(height, step) - fine).max(axis=0) < bar).all()


@pytest.mark.parametrize(("kmh", "expected"), [(2.0, 30.52), (33.0, 34.23), (154.0, 202.99)])
def test_run_out_over_speed(kmh, expected):
    """First harmonic of 0.5 mm of run-out, axle force peak to peak."""
    unit = HELD.replace(radial_runout=[(1, 5e-4, 0.3)])
    speed = kmh / 3.6 / unit.radius
    turn = 2.0 * math.pi / speed
    settle = max(3.0 * turn, 1.5)
    t = np.linspace(0.0, settle + turn, round((settle + turn) / 1e-3) + 1)
    found = simulate(unit, t, speed, road=0.0, static_load=LOAD, n_max=10).axle_force[:, 1]
    last = t >= settle
    wave = np.exp(-1j * speed * t[last])
    amplitude = np.linalg.lstsq(
        np.column_stack([wave.real, wave.imag, np.ones(last.sum())]), found[last], rcond=None
    )[0]
    assert 2.0 * math.hypot(*amplitude[:2]) == pytest.approx(expected, rel=5e-3)  # n_max 10 in place of 30


def test_imbalance_on_the_road():
    """The first-order answer of ``contact.force_variation``, which solves the equations at the spin's frequency."""
    unit = HELD.replace(imbalance_mass=0.05, imbalance_angle=0.7)
    speed = 100.0
    t = 1e-3 * np.arange(1500)
    found = simulate(unit, t, speed, road=0.0, static_load=LOAD, n_max=6)
    expected = contact.force_variation(unit, speed, LOAD, n_max=6)
    last = t > 1.0
    wave = np.exp(1j * speed * t[last])
    for values, amplitude in ((found.axle_force[:, 1], expected.axle[0]), (found.contact_force, expected.contact[0])):
        assert values[last] - LOAD == pytest.approx((amplitude * wave).real, abs=2e-3 * abs(amplitude))
    rest = simulate(unit, [0.0, 1e-3], speed, road=0.0, static_load=LOAD, n_max=6).axle_force[0, 0]
    forward = found.axle_force[last, 0] - rest
    assert forward == pytest.approx((expected.forward[0] * wave).real, abs=2e-3 * abs(expected.forward[0]))


@models
@pytest.mark.parametrize("entry", ["road", "traction"])
def test_a_sine_is_answered_as_the_frequency_response_says(model, entry):
    """After its beginning has died away; steps of 0.5 ms of 12 Hz err by some 1e-5."""
    unit = HELD.replace(zeta_1=0.1, zeta_n=0.1, longitudinal_stiffness=2e5, longitudinal_damping_ratio=0.3)
    speed, cycles, t = 60.0, 12.0, 5e-4 * np.arange(5001)
    wave = np.exp(2j * math.pi * cycles * t)
    size = 1e-3 if entry == "road" else 100.0
    inputs = {"road": 0.0, "traction": 0.0, entry: size * wave.imag}
    found = simulate(unit, t, speed, static_load=LOAD, n_max=3, model=model, **inputs)
    gain = size * contact.frequency_response(unit, speed, cycles, model, n_max=3)[:, 0 if entry == "road" else 1]
    last = t > 2.0
    values = np.column_stack([found.axle_force, found.contact_force])[last] - [0.0, LOAD, LOAD]
    expected = (wave[last, None] * gain).imag
    rest = simulate(unit, t[:2], speed, road=0.0, static_load=LOAD, n_max=3, model=model)
    values[:, 0] -= rest.axle_force[0, 0]
    assert values == pytest.approx(expected, abs=1e-3 * np.abs(gain).max())


# -- rest, energy, statics --------------------------------------------------------------------------------------------


def state(road):
    """All but how far it has come."""
    return {name: value for name, value in road.snapshot(0).items() if name not in ("way", "profile")}


@models
@pytest.mark.parametrize("speed", [0.0, 60.0, -200.0])
@pytest.mark.parametrize("points", [1, 4])
def test_on_a_flat_road_not_a_bit_moves(model, speed, points):
    for unit in (CAR, HELD.replace(vertical_stiffness=0.0), HELD.replace(residual_damping=80.0)):
        road = wheels_on_the_road(unit, model, 5, points=points)
        road.put(0, speed, 0.3, 1.25)
        before = json.dumps(state(road)), seen(road)
        for _ in range(200):
            road.advance(0, 2e-3, speed, 1.25)
        assert (json.dumps(state(road)), seen(road)) == before
        assert seen(road)[2] == pytest.approx(LOAD, rel=1e-15)
        assert seen(road)[1] == pytest.approx(LOAD, rel=1e-9)  # K = 1


@pytest.mark.slow
def test_a_standing_tire_does_not_move_in_a_million_steps():
    road = wheels_on_the_road(CAR, n_max=2)
    before = json.dumps(road.snapshot(0)), seen(road)
    road.advance(0, 2500.0, 0.0, 0.0)  # of 2.5 ms
    assert (json.dumps(road.snapshot(0)), seen(road)) == before


@pytest.mark.parametrize("speed", [0.0, 60.0, -150.0])
def test_a_changed_speed_on_a_flat_road_ends_in_its_own_steady_state(speed):
    """Reaction damping on a flat road: the contact force is the static load, at any speed, and so is the axle's."""
    road = wheels_on_the_road(HELD, n_max=5)
    road.put(0, 40.0, 0.0, 0.0)
    road.advance(0, 3.0, speed, 0.0)
    # the steady deflection depends a little on the speed, the axle's height is held by its spring alone
    assert seen(road)[1:] == pytest.approx([seen(road)[2], seen(road)[2]], rel=1e-6)
    assert seen(road)[2] == pytest.approx(LOAD, rel=1e-3)


def test_static_stiffness_in_series_with_the_suspension():
    """Lifted by 10 mm and left alone: 1/K = 1/K_v + 1/k_s, the wheel held by its suspension alone."""
    unit = HELD.replace(zeta_1=0.3, zeta_n=0.3)
    t = np.linspace(0.0, 3.0, 1501)
    found = simulate(unit, t, 0.0, road=0.01 * np.minimum(1.0, t / 0.2), static_load=LOAD, n_max=20)
    expected = 0.01 / (1.0 / unit.vertical_stiffness + 1.0 / unit.suspension_stiffness)
    assert found.contact_force[-1] - LOAD == pytest.approx(expected, rel=1e-6)
    assert found.axle_force[-1, 1] == pytest.approx(found.contact_force[-1], rel=1e-6)


@pytest.mark.parametrize("step", [5e-4, 2e-3])
def test_energy_never_grows(step):
    """No damping, n_max 30, thrown up by a rough road and left to hop on a flat one; the energy's parts by hand."""
    unit = HELD.replace(zeta_1=0.0, zeta_n=0.0, zeta_s=0.0)
    road = wheels_on_the_road(unit, n_max=30)
    height = 0.0
    for height in np.random.default_rng(0).normal(0.0, 0.02, 10).tolist():
        road.advance(0, step, 0.0, height)
    energies, lost = [], 0
    A, _, C, determinant = ring.coefficients(unit, n := np.arange(2.0, 31.0))
    mass = math.pi * unit.radius * unit.width * unit.surface_density * (A + n * C) / (n * C)
    square = n * determinant / (A + n * C)
    k_c = wheel.residual_stiffness(unit, 30)
    turned = np.array([1.0, -1.0j, -1.0, 1.0j])[n.astype(int) % 4]
    factors = np.sin(n * 0.15) / (n * math.sin(0.15))
    start = None
    for _ in range(150):
        road.advance(0, step, 0.0, height)
        X_, Y_, y_, X, Y, y = road.motion.state_of(0)
        road.deflection(0)  # which gives the belt its state
        V, Z = np.moveaxis(road.belt.state_of(0), -1, 0)
        u_c = -Y + (factors * np.conj(turned) * Z).sum().real
        if start is None:  # at rest the spring is compressed by the load over its stiffness
            steady = contact.standing(contact.open_system(unit, 0.0, n_max=30), LOAD)
            start = steady[1]
        kinetic = unit.ring_mass * (X_**2 + Y_**2) + unit.wheel_mass * y_**2
        elastic = unit.sidewall_stiffness * (X**2 + (Y - y) ** 2) + unit.suspension_stiffness * y**2
        belt = (mass * (np.abs(V) ** 2 + square * np.abs(Z) ** 2)).sum()
        energies.append(0.5 * (kinetic + elastic + belt + k_c * max(0.0, start + height + u_c) ** 2))
        lost += road.contact_of(0) == 0.0
    assert lost > 10
    assert np.diff(energies).max() <= 1e-9 * energies[0]


# -- the prototype, several points, changes ---------------------------------------------------------------------------


@models
@pytest.mark.parametrize("points", [1, 5])
@pytest.mark.parametrize(
    "changes",
    [
        {}, {"sprung_mass": 0.0, "residual_damping": 80.0}, {"vertical_stiffness": 0.0},
        {"longitudinal_stiffness": 2e5, "sidewall_damping": "modal"},
    ],
    ids=["car", "damper", "rigid", "fore and aft"],
)  # fmt: skip
def test_the_reference_steps_are_these(model, points, changes):
    unit, random = CAR.replace(**changes), np.random.default_rng(3)
    reference = ContactStepper(unit, LOAD, 60.0, model=model, n_max=4, points=points)
    road = wheels_on_the_road(unit, model, 4, points=points)
    road.put(0, 60.0, 0.0, 0.0)
    before = np.zeros(points)
    for k in range(40):
        heights, speed = random.normal(0.0, 0.01, points), 60.0 + 20.0 * (k > 15)
        reference.turn(speed)
        reference.step(5e-4, heights)
        if points == 1:
            road.advance(0, 5e-4, speed, float(heights[0]))
        else:
            road.follow_lines(np.array([0.0, 5e-4]), np.full(2, speed), np.stack([before, heights]), np.zeros(2))
        before = heights
        expected = [*reference.axle_force(), reference.force.sum()]
        acting = sum(road.snapshot(0)["forces"])  # to a step's end; with a damper not quite what is published
        assert [*road.axle_force(0), acting] == pytest.approx(expected, abs=1e-11 * LOAD / 1e-4)  # behind stiff springs


def test_points_envelop_a_cleat_shorter_than_the_patch():
    """10 mm by 20 mm: one patch is lifted by it as a whole, nine points feel it one by one, and push backward."""
    t = 5e-4 * np.arange(121)
    way = 10.0 * HELD.radius * t
    cleat = np.where((way > 0.05) & (way < 0.07), 0.01, 0.0)
    one, nine = (
        simulate(HELD, t, 10.0, road=cleat, static_load=LOAD, n_max=20, contact_points=points) for points in (1, 9)
    )
    assert np.abs(nine.contact_force - LOAD).max() < 0.8 * np.abs(one.contact_force - LOAD).max()
    assert np.abs(nine.axle_force[:, 0]).max() > 5.0 * np.abs(one.axle_force[:, 0]).max()


@pytest.mark.parametrize(
    ("steps", "part", "tolerance"),
    [([1] * 24, 6, 1e-6), ([1] * 20 + [-1] * 20, 6, 1e-6), ([-1] * 20 + [0] * 5 + [1] * 8, 6, 1e-6),
     ([1] * 700 + [-1] * 300, 384, 20.0)],
    ids=["on", "there and back", "back, a stop, and on", "creeping"],
)  # fmt: skip
def test_points_on_a_profile_that_is_told_sample_by_sample(steps, part, tolerance):
    """Against heights that are known under every point: a road of lines, told at the patch's foremost edge.

    Whoever turns round tells heights at the other edge, a whole number of steps away. In creeping, knots closer than a
    64th of the patch are merged, which leaves the road 0.1 mm from itself where it bends.
    """
    told, known = (wheels_on_the_road(HELD, n_max=4, points=5) for _ in range(2))
    ahead = -HELD.radius * np.sin(told.angles_of_points())
    edge = float(ahead[0])
    step = 2.0 * edge / part
    speed = step / HELD.radius / 2e-3
    places = edge * np.array([-9.0, -7.0, -6.0, -4.0, -3.0, -1.0, 1.0, 2.0, 4.0, 5.0])  # flat at the start
    heights = 1e-3 * np.array([2.0, 3.0, -4.0, 2.0, 0.0, 0.0, 0.0, 4.0, 4.0, 1.0])
    for each in (told, known):
        each.put(0, steps[0] * speed, 0.0, 0.0)
    way, direction = 0.0, 1
    for sign in steps:
        before, way, direction = way, way + sign * step, sign or direction
        told.advance(0, 2e-3, sign * speed, float(np.interp(way + direction * edge, places, heights)))
        under = np.array([np.interp(s + ahead, places, heights) for s in (before, way)])
        known.follow_lines(np.array([0.0, 2e-3]), np.full(2, sign * speed), under, np.zeros(2))
        assert seen(told) == pytest.approx(seen(known), abs=tolerance)
    assert abs(seen(known)[2] - LOAD) > 20.0


@models
@pytest.mark.parametrize("changes", [{"zeta_1": 0.2}, {"sprung_mass": 0.0}, {"longitudinal_stiffness": 3e5},
                                     {"vertical_stiffness": 1.5e5}])  # fmt: skip
def test_a_tire_that_changes_goes_on_from_where_it_is(model, changes):
    """The wheel's place, and how far the spring is pressed, go on; so forces jump by the spring's change alone."""
    road = wheels_on_the_road(CAR, model, 4)
    road.put(0, 50.0, 0.0, 0.0)
    for k in range(20):
        road.advance(0, 2e-3, 50.0, 2e-3 * math.sin(k))
    place, force = road.motion.state_of(0), road.contact_of(0)
    shape = road.deflection(0)
    new = CAR.replace(**changes)
    road.set_unit(new)
    half = len(place) // 2
    after = road.motion.state_of(0)
    kept = min(half, len(after) // 2)
    assert after[len(after) // 2 :][:kept] == pytest.approx(place[half:][:kept], abs=1e-12)
    assert road.deflection(0) == pytest.approx(shape, abs=1e-12)
    road.advance(0, 1e-6, 50.0, 2e-3 * math.sin(19))
    ratio = wheel.residual_stiffness(new, 4, model) / wheel.residual_stiffness(CAR, 4, model)
    assert road.contact_of(0) == pytest.approx(ratio * force, rel=1e-2)


def goes_on_from_its_snapshot(unit, model, coupled=0):
    """Half of a drive on one, its state as JSON into another, and the rest on both."""
    first, second = (wheels_on_the_road(unit, model, 4, coupled=coupled) for _ in range(2))
    first.put(0, 50.0, 0.0, 0.5)
    for k in range(30):
        first.advance(0, 2e-3, 50.0 + k, 0.5 + 0.02 * math.sin(k))
        if k == 15:
            kept = json.loads(json.dumps([first.motion.snapshot(0), first.snapshot(0)]))
            second.motion.restore(0, kept[0])
            second.restore(0, kept[1])
        elif k > 15:
            second.advance(0, 2e-3, 50.0 + k, 0.5 + 0.02 * math.sin(k))
            assert seen(first) == seen(second)
    assert json.dumps(first.snapshot(0)) == json.dumps(second.snapshot(0))


@models
def test_a_snapshot_goes_on_bit_for_bit(model):
    goes_on_from_its_snapshot(CAR.replace(residual_damping=50.0), model)


def test_wheels_do_not_touch_one_another():
    """Two wheels, each as if it were alone."""
    both = wheels_on_the_road(CAR, n_max=4, loads=(LOAD, 3000.0))
    alone = [wheels_on_the_road(CAR, n_max=4, loads=(load,)) for load in (LOAD, 3000.0)]
    for k in range(50):
        for index, each in enumerate(alone):
            height = 0.03 * math.sin((k + 3) * (index + 1.0))
            both.advance(index, 2e-3, 40.0 + index, height)
            each.advance(0, 2e-3, 40.0 + index, height)
            assert seen(both, index) == seen(each)


# -- simulate ---------------------------------------------------------------------------------------------------------


def test_what_simulate_gives_beside_the_axle_force():
    t = 1e-3 * np.arange(100)
    height = 0.01 * np.sin(60.0 * t)
    found = simulate(CAR, t, 60.0, road=height, static_load=LOAD, n_max=5, psi=[1.5 * math.pi, 0.3])
    again = simulate(CAR, t, 60.0, road=height, static_load=LOAD, n_max=5)
    assert found.axle_force.tobytes() == again.axle_force.tobytes()
    # F' = m_b b'' of the sprung mass, the weight apart: the second difference of its path
    bend = CAR.sprung_mass * np.diff(found.body_displacement, 2) / 1e-6
    assert bend == pytest.approx(found.axle_force[1:-1, 1] - LOAD, abs=5e-3 * np.ptp(found.axle_force[:, 1]))
    static = simulate(CAR, t, 60.0, load=LOAD, n_max=5, psi=[1.5 * math.pi, 0.3])
    assert found.u_z[0] == pytest.approx(static.u_z[0], rel=1e-9)
    assert static.contact_force == pytest.approx(np.full(t.size, LOAD), rel=0.0)
    assert static.body_displacement is None
    assert simulate(HELD, t, 1.0, road=0.0, static_load=1.0).body_displacement is None


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"load": 1.0}, "either load"),
        ({"road": None}, "either load"),
        ({"static_load": None}, "either load"),
        ({"static_load": -1.0}, "static_load is -1.0"),
        ({"initial": "rest"}, "initial is 'rest'"),
        ({"road": math.nan}, "road holds"),
        ({"contact_points": 0}, "contact_points is 0"),
        ({"contact_points": 3, "speed": [-1.0, 1.0]}, "speed changes its sign"),
    ],
)
def test_simulate_refuses(changes, word):
    with pytest.raises(ValueError, match=word):
        simulate(CAR, **{"time": [0.0, 1e-3], "speed": 1.0, "road": 0.0, "static_load": LOAD, **changes})


def test_a_unit_stiffer_than_its_belt_is_refused():
    with pytest.raises(ValueError, match="vertical_stiffness is 300000.0; it must be <"):
        simulate(TireWheelUnit.table_1(vertical_stiffness=300000.0), [0.0], 1.0, road=0.0, static_load=LOAD)


@pytest.mark.parametrize("step", [5e-4, 2e-3])
def test_energy_of_several_points_never_grows(step):
    """As of one: each point's spring is its own, k_j delta_j^2/2 while it presses."""
    unit = HELD.replace(zeta_1=0.0, zeta_n=0.0, zeta_s=0.0)
    road = wheels_on_the_road(unit, n_max=20, points=5)
    springs = ContactPoints(unit, 5, "inextensional", 20)
    n = springs.numbers
    A, _, C, determinant = ring.coefficients(unit, n)
    mass = math.pi * unit.radius * unit.width * unit.surface_density * (A + n * C) / (n * C)
    square = n * determinant / (A + n * C)
    waves = springs.spread * np.exp(1j * np.outer(springs.angles, n)) / springs.cosines[:, None]
    turned = np.array([1.0, -1.0j, -1.0, 1.0j])[n.astype(int) % 4]

    def delta(heights):
        state, belt = np.array(road.motion.state_of(0)), road.deflection(0)  # which gives the belt its state
        assert np.isfinite(belt).all()
        V, Z = np.moveaxis(road.belt.state_of(0), -1, 0)
        moved = (np.conj(turned * waves) @ Z).real + state[3] * springs.tangents - state[4]
        return moved + heights, state, V, Z

    rest = delta(np.zeros(5))[0]  # of the static load, with load times share on each
    pressed = LOAD * springs.share / springs.stiffness
    heights = np.zeros(5)
    random, energies, lost = np.random.default_rng(0), [], 0
    for k in range(160):
        before, heights = heights, random.normal(0.0, 0.02, 5) if k < 10 else heights
        road.follow_lines(np.array([0.0, step]), np.zeros(2), np.stack([before, heights]), np.zeros(2))
        now, (X_, Y_, y_, X, Y, y), V, Z = delta(heights)
        kinetic = unit.ring_mass * (X_**2 + Y_**2) + unit.wheel_mass * y_**2
        elastic = unit.sidewall_stiffness * (X**2 + (Y - y) ** 2) + unit.suspension_stiffness * y**2
        belt = (mass * (np.abs(V) ** 2 + square * np.abs(Z) ** 2)).sum()
        tread = (springs.stiffness * np.maximum(0.0, pressed + now - rest) ** 2).sum()
        if k >= 10:
            energies.append(0.5 * (kinetic + elastic + belt + tread))
            lost += 0.0 in road.snapshot(0)["forces"]
    assert lost > 5
    assert np.diff(energies).max() <= 1e-9 * energies[0]
