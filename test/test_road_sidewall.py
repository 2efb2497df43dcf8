"""A sidewall that varies, on the road: every harmonic coupled with others, the wheel and the contact, live."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_road_motion import goes_on_from_its_snapshot, wheels_on_the_road

from tire_dynamics import TireWheelUnit, simulate
from tire_dynamics.science import contact

CAR = TireWheelUnit.table_1(
    contact_half_angle=0.15, vertical_stiffness=2e5, sidewall_damping="reaction", zeta_s=0.3, sprung_mass=350.0
)
LOAD = 4000.0
VARYING = {
    "radial_nonuniformity": [(1, 0.05, 0.3), (2, 0.03, 1.0), (3, 0.02, 0.5)],
    "tangential_nonuniformity": [(1, 0.04, 0.2), (2, 0.02, 0.1)],
}
models = pytest.mark.parametrize("model", ["inextensional", "complete"])


def road_at(t):
    return 5e-3 * np.sin(60.0 * t) ** 2


def integrated(unit, speed, model, n_max, t):
    """[axle x, axle z, contact force] of the periodic system in contact, by DOP853; imbalance and run-out beside."""
    parts, system = contact.periodic_system(unit, speed, model, n_max)
    state, height, weight = contact.standing(system, LOAD)
    imbalance = unit.imbalance_mass * unit.radius * speed**2
    ring_mass = unit.ring_mass * (1.0 if model == "inextensional" else 0.5)

    def felt(t):
        away = sum(e * math.cos(j * (1.5 * math.pi - speed * t - chi)) for j, e, chi in unit.radial_runout)
        return height + road_at(t) + away  # a point's: these tests' run-out is on a tire without a patch

    def slope(t, z):
        rates = parts.at(speed * t) @ z + system.push * (system.stiffness * felt(t)) + weight * system.weight
        rates[0] += imbalance / ring_mass * math.cos(unit.imbalance_angle + speed * t)
        rates[1] += imbalance / ring_mass * math.sin(unit.imbalance_angle + speed * t)
        return rates

    motion = solve_ivp(slope, (0.0, t[-1]), state, method="DOP853", rtol=1e-10, atol=1e-13, t_eval=t).y.T
    force = system.stiffness * (np.array([felt(each) for each in t]) + motion @ system.contact)
    return np.column_stack([motion @ system.output.T, force])


def stepped(unit, speed, model, n_max, t, parts):
    fine = np.linspace(0.0, t[-1], (len(t) - 1) * parts + 1)
    found = simulate(unit, fine, speed, road=road_at(fine), static_load=LOAD, n_max=n_max, model=model)
    return np.column_stack([found.axle_force, found.contact_force])[::parts]


@models
@pytest.mark.parametrize("speed", [60.0, -150.0])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"sprung_mass": 0.0, "sidewall_damping": "modal"},
        {"longitudinal_stiffness": 2e5, "longitudinal_damping_ratio": 0.2, "imbalance_mass": 0.05},
        {"radial_runout": [(1, 5e-4, 0.2), (2, 3e-4, 0.1)], "contact_half_angle": 0.0},
    ],
    ids=["car", "held body", "fore and aft", "run-out"],
)
def test_against_the_periodic_system(model, speed, changes):
    """Second order in the step; the road is a chain of lines, which is of second order too."""
    unit, n_max = CAR.replace(**VARYING).replace(**changes), 3
    t = 2e-3 * np.arange(16)
    expected = integrated(unit, speed, model, n_max, t)
    kept = slice(None) if "longitudinal_stiffness" in changes else slice(1, None)  # system.output has k_1 X, uniform
    later = slice(1, None)  # at the first moment run-out is in the road, and not yet in simulate's contact force
    errors = [np.abs(stepped(unit, speed, model, n_max, t, parts) - expected)[later, kept].max() for parts in (4, 8)]
    size = np.ptp(expected[:, 2])
    assert errors[1] < errors[0] / 3.5
    assert errors[1] < 3e-3 * size
    even = np.abs(stepped(unit.mean, speed, model, n_max, t, 8) - expected)[later, kept].max()
    assert errors[1] < 0.1 * even  # and what is compared does vary


@pytest.mark.parametrize(("harmonic", "expected"), [(1, 62.902), (2, 57.602)])
def test_fixed_height_force_variation(harmonic, expected):
    """docs/model.md, section 12: complete ring, point contact, rigid tread, n_max 30, 2 % of k_z, a slow turn, 4000 N.

    The wheel is held by 1e11 N/m, which gives 2e-6 of what the tire does; turning at 2 rad/s adds some (4/400)^2 to
    the second harmonic, the tire's lowest mode being at 400 rad/s.
    """
    unit = TireWheelUnit.table_1(
        sidewall_damping="reaction", wheel_mass=1e6, suspension_stiffness=1e11, zeta_s=0.5, zeta_1=0.2, zeta_n=0.2,
        radial_nonuniformity=[(harmonic, 0.02, 0.3)],
    )  # fmt: skip
    t = np.linspace(0.0, 1.1 * math.pi, 866)  # of 4 ms; two steps of 2 ms each
    found = simulate(unit, t, 2.0, road=0.0, static_load=LOAD, n_max=30, model="complete")
    turned = t > 0.1 * math.pi
    assert np.ptp(found.axle_force[turned, 1]) == pytest.approx(expected, abs=0.01)
    assert np.ptp(found.contact_force[turned]) == pytest.approx(expected, abs=0.01)


@models
def test_a_held_wheel_feels_the_whole_sidewall_fore_and_aft(model):
    """Turned slowly and without traction the sidewall's forces have no resultant but the load; k_1 X alone has."""
    unit = CAR.replace(sprung_mass=0.0, zeta_1=0.3, zeta_n=0.3, **VARYING)
    t = 0.01 * np.arange(100)
    found = simulate(unit, t, 3.0, road=0.0, static_load=LOAD, n_max=3, model=model)
    assert np.ptp(unit.sidewall_stiffness * found.ring_centre[50:, 0]) > 20.0
    assert found.axle_force[50:, 0] == pytest.approx(np.zeros(50), abs=0.05)


@models
def test_in_a_car_the_steady_variation_is_that_of_the_equations(model):
    """``contact.force_variation`` solves them to first order in the amplitudes, at each harmonic of the spin."""
    unit = CAR.replace(zeta_1=0.1, zeta_n=0.1, radial_nonuniformity=[(1, 0.01, 0.3), (2, 0.01, 1.0)])
    speed = 60.0
    t = 1e-3 * np.arange(4001)
    found = simulate(unit, t, speed, road=0.0, static_load=LOAD, n_max=4, model=model)
    expected = contact.force_variation(unit, speed, LOAD, model, n_max=4)
    last = t > 2.0
    waves = np.exp(1j * speed * np.outer(t[last], expected.harmonics))
    columns = np.concatenate([waves.real, -waves.imag, np.ones((last.sum(), 1))], axis=1)
    both = (found.axle_force[:, 1], expected.axle), (found.contact_force, expected.contact)
    for values, amplitudes in both:
        fit = np.linalg.lstsq(columns, values[last], rcond=None)[0]
        assert fit[:2] + 1j * fit[2:4] == pytest.approx(amplitudes, abs=0.02 * np.abs(amplitudes).max())


@models
@pytest.mark.parametrize("points", [1, 5])
def test_what_is_coupled(model, points):
    """Nothing with coupled_harmonics 0, all without it, and a tire that is even all around is as it was."""
    t, speed = 2e-3 * np.arange(60), 40.0
    unit = CAR.replace(**VARYING)

    def force(unit, **others):
        return simulate(
            unit, t, speed, road=road_at(t), static_load=LOAD, n_max=6, model=model, contact_points=points, **others
        ).contact_force  # fmt: skip

    assert force(unit, coupled_harmonics=0).tobytes() == force(unit.mean).tobytes()
    for every in (6, 99):
        assert force(unit).tobytes() == force(unit, coupled_harmonics=every).tobytes()
    some = force(unit, coupled_harmonics=2)
    assert min(np.abs(some - force(unit)).max(), np.abs(some - force(unit.mean)).max()) > 1.0


@models
def test_the_step_may_be_long_and_the_variation_large(model):
    """30 % of both kinds, no damping but the suspension's, steps of 2.5 ms over a rough road: bounded, and near."""
    unit = CAR.replace(
        zeta_1=0.02, zeta_n=0.005, radial_nonuniformity=[(1, 0.3, 0.0)], tangential_nonuniformity=[(2, 0.3, 1.0)]
    )
    t = 2.5e-3 * np.arange(1200)
    road = np.interp(t, t[::4], np.random.default_rng(0).normal(0.0, 2e-3, t[::4].size))
    found = simulate(unit, t, 30.0, road=road, static_load=LOAD, n_max=30, model=model).contact_force
    fine_t = np.linspace(0.0, t[-1], 4 * (t.size - 1) + 1)
    fine = simulate(
        unit, fine_t, 30.0, road=np.interp(fine_t, t, road), static_load=LOAD, n_max=30, model=model
    ).contact_force[::4]
    assert np.sqrt(((found - fine) ** 2).mean()) < 0.1 * fine.std()


@models
def test_a_snapshot_goes_on_bit_for_bit(model):
    goes_on_from_its_snapshot(CAR.replace(**VARYING), model, coupled=4)


def test_a_tire_may_begin_and_end_to_vary():
    """Places go on as they are; forces of the wheel's springs do."""
    road = wheels_on_the_road(CAR, n_max=4, coupled=4)
    road.put(0, 50.0, 0.0, 0.0)
    for unit in (CAR.replace(**VARYING), CAR, CAR.replace(radial_nonuniformity=[(1, 0.3, 0.0)])):
        for k in range(10):
            road.advance(0, 2e-3, 50.0, 2e-3 * math.sin(k))
        place, shape, force = road.motion.state_of(0), road.deflection(0), road.contact_of(0)
        road.set_unit(unit)
        assert road.motion.state_of(0) == pytest.approx(place, abs=1e-12)
        assert road.deflection(0) == pytest.approx(shape, abs=1e-12)
        road.advance(0, 1e-6, 50.0, 2e-3 * math.sin(9))
        assert road.contact_of(0) == pytest.approx(force, rel=1e-2)


def test_bad_numbers():
    for number in (-1, 1.5, True):
        with pytest.raises(ValueError, match=f"coupled_harmonics is {number!r}; it must be"):
            simulate(CAR, [0.0, 1e-3], 1.0, road=0.0, static_load=LOAD, coupled_harmonics=number)
    with pytest.raises(ValueError, match="coupled_harmonics is 3; it must not be given"):
        simulate(CAR, [0.0, 1e-3], 1.0, 1.0, coupled_harmonics=3)
