"""A longitudinally compliant wheel: closed forms, the other frame's equations, and the held wheel as its limit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tire_dynamics import TireWheelUnit, floquet, simulate, wheel
from tire_dynamics.estimator.vehicle import Vehicle, VehicleSettings
from tire_dynamics.science import maps

MODELS = ("inextensional", "complete")
DAMPINGS = ("modal", "reaction")
CAR = {"longitudinal_stiffness": 2.0e5, "longitudinal_damping_ratio": 0.1, "longitudinal_mass": 25.0}

units = st.builds(
    TireWheelUnit.table_1,
    longitudinal_stiffness=st.floats(1e4, 1e7),
    longitudinal_damping_ratio=st.floats(0.0, 0.5),
    longitudinal_mass=st.floats(1.0, 100.0),
    zeta_1=st.floats(0.0, 0.5),
    zeta_s=st.floats(0.0, 0.5),
    sidewall_damping=st.sampled_from(DAMPINGS),
)


def round_wheel(**changes: float) -> TireWheelUnit:
    """The same support and mass in both directions, so that no direction is any other."""
    unit = TireWheelUnit.table_1(**changes)
    return unit.replace(
        longitudinal_stiffness=unit.suspension_stiffness,
        longitudinal_damping_ratio=unit.zeta_s,
        longitudinal_mass=unit.wheel_mass,
    )


@pytest.mark.parametrize("model", MODELS)
@given(unit=units, speed=st.floats(-500.0, 500.0), time=st.floats(0.0, 0.1))
def test_both_frames_have_the_same_equations(model, unit, speed, time):
    """Each was written down for itself: A = (T F + T') T^-1, T' by central differences of a smooth T."""
    T, step = wheel.rotation(speed * time, speed, model, longitudinally_rigid=False), 1e-5
    turned = (speed * time + step, speed * time - step)
    after, before = (wheel.rotation(angle, speed, model, longitudinally_rigid=False) for angle in turned)
    rate = speed * (after - before) / (2.0 * step)
    A = wheel.state_matrix(unit, speed, time, model)
    expected = (T @ wheel.fixed_frame_matrix(unit, speed, model) + rate) @ np.linalg.inv(T)
    # T' has an error of step^2/6 times Omega^2 beside stiffnesses of 1e4 1/s^2 and more
    np.testing.assert_allclose(A, expected, rtol=0.0, atol=1e-9 * np.abs(A).max())


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("damping", DAMPINGS)
def test_a_stiff_support_holds_the_wheel(model, damping):
    """The difference falls with 1/k_x: a hundredfold stiffness leaves a hundredth of it."""
    held = TireWheelUnit.table_1(sidewall_damping=damping)
    time = np.linspace(0.0, 0.1, 101)
    load = 3000.0 + 500.0 * np.sin(200.0 * time)
    expected = simulate(held, time, 150.0, load, 300.0, model=model).axle_force[:, 1]

    def difference(stiffness: float) -> float:
        unit = held.replace(longitudinal_stiffness=stiffness, longitudinal_damping_ratio=0.9)
        return float(np.abs(simulate(unit, time, 150.0, load, 300.0, model=model).axle_force[:, 1] - expected).max())

    coarse, fine = difference(1e9), difference(1e11)
    assert coarse < 0.02 * 3000.0  # k_1/k_x is 0.0014, and the modal belt's own force is as large as the load
    assert fine == pytest.approx(0.01 * coarse, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("damping", DAMPINGS)
def test_simulate_is_the_ring_frame_integrated(model, damping):
    """DOP853 at 1e-12 on the periodic equations, forced as (4.6) and section 5 of docs/model.md say."""
    unit = TireWheelUnit.table_1(sidewall_damping=damping, **CAR)
    speed, end = 120.0, 0.08
    time = np.linspace(0.0, end, 41)
    n = wheel.states(unit, model)
    half = n // 2
    force = wheel.fixed_frame(unit, model).input

    def load(t: float) -> np.ndarray:
        return np.array([2000.0 + 20000.0 * t, 400.0])

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        turned = wheel.rotation(speed * t, speed, model, longitudinally_rigid=False)[:half, :half]
        push = np.concatenate([turned @ (force[:half] @ load(t)), np.zeros(half)])
        return wheel.state_matrix(unit, speed, t, model) @ z + push

    solution = solve_ivp(rate, (0.0, end), np.zeros(n), "DOP853", t_eval=time, rtol=1e-12, atol=1e-15)
    turns = [wheel.rotation(speed * t, speed, model, longitudinally_rigid=False) for t in time]
    fixed = [np.linalg.solve(turn, z) for turn, z in zip(turns, solution.y.T, strict=True)]
    expected = wheel.axle_forces(wheel.output_matrices(unit, np.full(time.size, speed), model), np.array(fixed))
    response = simulate(unit, time, speed, 2000.0 + 20000.0 * time, 400.0, initial="rest", model=model)
    size = np.abs(expected).max()
    np.testing.assert_allclose(response.axle_force, expected, rtol=0.0, atol=1e-9 * size)


# -- closed forms --


@given(unit=units, speed=st.floats(-1000.0, 1000.0))
def test_what_is_at_rest(unit, speed):
    """Constant load and traction: k_1 in series with each support, and the circulatory force between them."""
    z = wheel.equilibrium(unit, speed, 3000.0, 400.0)
    x_ros, up = wheel.axle_force(unit, speed, z)
    k_1 = unit.sidewall_stiffness
    if unit.sidewall_damping == "reaction":
        expected = 400.0, 3000.0
    else:
        delta = 2.0 * unit.zeta_1 * unit.rigid_mode_frequency * unit.ring_mass * speed
        k_X = 1.0 / (1.0 / k_1 + 1.0 / unit.longitudinal_stiffness)
        k_Y = 1.0 / (1.0 / k_1 + 1.0 / unit.suspension_stiffness)
        # k_X X + delta Y = -400 (X is backward), k_Y Y - delta X = 3000
        X, Y = np.linalg.solve([[k_X, delta], [-delta, k_Y]], [-400.0, 3000.0])
        expected = -k_X * X, k_Y * Y
    np.testing.assert_allclose((x_ros, up), expected, rtol=0.0, atol=1e-9 * max(3000.0, *map(abs, expected)))


@given(unit=units, speed=st.floats(-1000.0, 1000.0))
def test_transmissibility_is_the_equilibrium(unit, speed):
    force = wheel.axle_force(unit, speed, wheel.equilibrium(unit, speed, 1.0))[1]
    assert wheel.transmissibility(unit, speed) == pytest.approx(force, rel=1e-9)


def whirl_exponents(unit: TireWheelUnit, speed: float) -> np.ndarray:
    """Roots of the characteristic polynomial in Z = X + i Y and w = x + i y of a wheel that has no direction.

    m Z'' + m d (Z' - i Omega Z) + k_1 (Z - w) = 0, M w'' + c w' + k_s w = k_1 (Z - w), the dashpots on Z - w and on w
    too where they have a reaction.
    """
    m, M, k_1, k_s = unit.ring_mass, unit.wheel_mass, unit.sidewall_stiffness, unit.suspension_stiffness
    d, c = 2.0 * unit.zeta_1 * unit.rigid_mode_frequency * m, unit.suspension_damping
    inner = np.array([d, -1j * d * speed])
    own = np.polyadd([m, 0.0, k_1], inner)
    if unit.sidewall_damping == "modal":
        polynomial = np.polysub(np.polymul(own, [M, c, k_s + k_1]), [k_1 * k_1])
    else:
        joint = np.polyadd([k_1], inner)
        polynomial = np.polysub(np.polymul(own, np.polyadd([M, c, k_s], joint)), np.polymul(joint, joint))
    return np.roots(polynomial)


def milli(value: float) -> float:
    """To three places: on terms of 1e-9 beside 1e6 the eigenvalues that are compared here may not converge."""
    return round(value, 3)


@settings(max_examples=50)
@given(
    speed=st.floats(-2000.0, 2000.0).map(milli),
    zeta_1=st.floats(0.0, 0.4).map(milli),
    damping=st.sampled_from(DAMPINGS),
)
def test_a_wheel_without_a_direction_whirls(speed, zeta_1, damping):
    """Four whirls and their mirror images: the exponents are the roots and their conjugates."""
    unit = round_wheel(zeta_1=zeta_1, sidewall_damping=damping)
    roots = whirl_exponents(unit, speed)
    expected = np.concatenate([roots, roots.conj()])
    exponents = np.linalg.eigvals(wheel.fixed_frame_matrix(unit, speed))
    distance = np.abs(exponents[:, None] - expected[None, :])
    # Roots that nearly meet are known to the root of the rounding, 1e-8 of their size of 1e3 1/s
    assert distance.min(axis=1).max() < 1e-4 and distance.min(axis=0).max() < 1e-4


def test_the_whirl_that_goes_with_the_wheel_is_lost_where_it_turns_faster():
    """Without damping of the supports a whirl is lost as soon as the wheel overtakes it, the slowest first."""
    unit = round_wheel(zeta_1=0.05, zeta_s=0.0)
    undamped = whirl_exponents(unit.replace(zeta_1=0.0), 0.0).imag
    slowest = undamped[undamped > 0.0].min()
    assert wheel.critical_speed(unit) == pytest.approx(slowest, rel=1e-6)
    below, above = (whirl_exponents(unit, factor * slowest) for factor in (0.99, 1.01))
    assert below.real.max() < 0.0
    growing = above[above.real > 0.0]
    assert growing.size == 1 and growing[0].imag > 0.0, "only the forward whirl grows"


def test_the_threshold_of_rotating_damping():
    """A stiff sidewall makes belt and wheel one mass: Omega_crit = omega (1 + external/internal damping)."""
    stiff = TireWheelUnit.table_1(radial_stiffness=5.8e12, tangential_stiffness=4.03e12)
    internal = 40.0  # [N s/m]: m 2 zeta_1 omega_1
    unit = round_wheel(
        radial_stiffness=5.8e12,
        tangential_stiffness=4.03e12,
        zeta_1=internal / (2.0 * stiff.ring_mass * stiff.rigid_mode_frequency),
        zeta_s=0.05,
    )
    omega = math.sqrt(unit.suspension_stiffness / (unit.wheel_mass + unit.ring_mass))
    expected = omega * (1.0 + unit.suspension_damping / internal)
    # k_s/k_1 is 3e-8; critical_speed itself is sharp to 1e-6
    assert wheel.critical_speed(unit) == pytest.approx(expected, rel=1e-5)


def test_the_threshold_of_two_masses():
    """On the threshold the exponent is i w; the real and the imaginary part of the polynomial give w and Omega."""
    unit = round_wheel(zeta_1=0.05, zeta_s=0.02)
    m, M, k_1, k_s = unit.ring_mass, unit.wheel_mass, unit.sidewall_stiffness, unit.suspension_stiffness
    d, c = 2.0 * unit.zeta_1 * unit.rigid_mode_frequency * m, unit.suspension_damping

    def slip(w: float) -> float:
        """w - Omega from the imaginary part."""
        return -c * w * (k_1 - m * w * w) / (d * (k_s + k_1 - M * w * w))

    def real(w: float) -> float:
        return (k_1 - m * w * w) * (k_s + k_1 - M * w * w) - d * c * w * slip(w) - k_1 * k_1

    guess = math.sqrt(k_s / (M + m))
    w = brentq(real, 0.5 * guess, 1.5 * guess, xtol=1e-12)
    assert wheel.critical_speed(unit) == pytest.approx(w - slip(w), rel=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_energy_without_damping_stays(model):
    """Kinetic energy, sidewall and supports, in the ring's centre and the wheel: nothing else moves."""
    unit = TireWheelUnit.table_1(zeta_1=0.0, zeta_s=0.0, longitudinal_stiffness=2e5, longitudinal_mass=20.0)
    F = wheel.fixed_frame_matrix(unit, 0.0, model)
    exponents = np.linalg.eigvals(F)
    assert np.abs(exponents.real).max() < 1e-9 * np.abs(exponents).max()
    moving = wheel.stability(unit, 300.0, model)
    assert moving.verdict == "marginally stable" and moving.spectral_radius == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_multipliers_are_those_of_the_periodic_equations(model):
    unit = TireWheelUnit.table_1(sidewall_damping="reaction", **CAR)
    speed = 209.4
    direct = floquet.analyze(lambda t: wheel.state_matrix(unit, speed, t, model), 2.0 * math.pi / speed)
    fast = wheel.stability(unit, speed, model)
    assert direct.verdict == fast.verdict
    distance = np.abs(direct.multipliers[:, None] - fast.multipliers[None, :])
    assert distance.min(axis=0).max() < 10.0 * direct.error_estimate + 1e-12


# -- through the estimator --


def test_a_map_over_the_stiffness():
    unit = TireWheelUnit.table_1(zeta_s=0.0, sidewall_damping="reaction")
    grid = maps.stability_map(unit, ("longitudinal_stiffness", [1e5, 4e5]), ("speed", [100.0, 2000.0]))
    for j, speed in enumerate(grid.y):
        for i, stiffness in enumerate(grid.x):
            alone = wheel.stability(unit.replace(longitudinal_stiffness=float(stiffness)), float(speed))
            assert maps.VERDICTS[grid.verdict[j, i]] == alone.verdict
    with pytest.raises(ValueError, match="longitudinal_stiffness is 0.0"):
        maps.stability_map(unit, ("longitudinal_stiffness", [0.0, 4e5]), ("speed", [100.0, 2000.0]))


@pytest.mark.parametrize("model", MODELS)
def test_a_wheel_is_let_go_and_held_again(model):
    """The node's tire may change while it turns; belt and wheel go on where they are."""
    held = TireWheelUnit.table_1(sidewall_damping="reaction")
    vehicle = Vehicle(VehicleSettings(unit=held, n_max=2, model=model))
    period = vehicle.settings.period

    def drive(ticks: int) -> np.ndarray:
        forces = []
        for _ in range(ticks):
            now = (vehicle.time or 10**9) + period
            vehicle.wheel_speed(0, now, 100.0)
            vehicle.load(0, now, now, 4000.0, 500.0)
            forces += [(x, z) for _, x, z in vehicle.tick(now)]
        return np.array(forces)

    first = drive(20)
    vehicle.set_unit(held.replace(longitudinal_stiffness=2e5, longitudinal_damping_ratio=0.3))
    after = drive(2000)
    # In 2 ms 500 N move 8.78 kg by 0.11 mm at 0.11 m/s: 23 N of the bushing and 117 N of its damper, at the most.
    assert abs(after[0, 0]) < 140.0 < abs(first[-1, 0])
    np.testing.assert_allclose(after[-1], (500.0, 4000.0), rtol=1e-6)  # `reaction`: all of it arrives
    vehicle.set_unit(held)
    np.testing.assert_allclose(drive(2000)[-1], (500.0, 4000.0), rtol=1e-6)
