"""A tire that is not the same all around, stepped in real time: direct integration, invariants, closed forms."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
import ring_frame
from examples import spared
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from test_unit import mappings

from tire_dynamics import TireWheelUnit
from tire_dynamics.build_state import how_to_compile, is_compiled
from tire_dynamics.estimator.motion import Motion
from tire_dynamics.estimator.vehicle import stability_reply
from tire_dynamics.estimator.wheel_estimator import WheelEstimator
from tire_dynamics.science import nonuniform, rotating_excitation, wheel
from tire_dynamics.science.nonuniform import Nonuniformity

MS = 1_000_000  # ns
TABLE_1 = TireWheelUnit.table_1()
SIDEWALL = {"radial_nonuniformity": [(1, 0.1, 0.3), (2, 0.3, 0.4)], "tangential_nonuniformity": [(2, 0.1, 1.7)]}
IMBALANCE = {"imbalance_mass": 0.08, "imbalance_angle": 0.7}
RUNOUT = {"radial_runout": [(1, 8e-4, 0.3), (3, 2e-4, -1.0)]}
FORE_AFT = {"longitudinal_stiffness": 2.0e5, "longitudinal_damping_ratio": 0.1, "longitudinal_mass": 20.0}
UNITS = {
    "sidewall": TABLE_1.replace(**SIDEWALL),
    "sidewall, reaction": TABLE_1.replace(**SIDEWALL, sidewall_damping="reaction"),
    "imbalance": TABLE_1.replace(**IMBALANCE),
    "run-out": TABLE_1.replace(**RUNOUT),
    "all": TABLE_1.replace(**SIDEWALL, **IMBALANCE, **RUNOUT),
    "all, longitudinally compliant": TABLE_1.replace(**SIDEWALL, **IMBALANCE, **RUNOUT, **FORE_AFT),
    "all, without damping": TABLE_1.replace(**SIDEWALL, **IMBALANCE, **RUNOUT, zeta_1=0.0, zeta_s=0.0),
}


def started(unit, model, speed, load, traction=0.0, angle=0.0):
    """A wheel in the steady state, as the estimator starts one."""
    motion = Motion(unit, model, 1)
    motion.put(0, rotating_excitation.steady_state(unit, speed, load, traction, angle, model), speed, angle)
    return motion


def steps(motion, count, seconds, *inputs):
    for _ in range(count):
        motion.advance(0, seconds, *inputs)
    return motion


CASES = list(itertools.product(UNITS, [60.0, -250.0, 640.0], ["inextensional", "complete"]))
DAILY = {
    ("sidewall", 640.0, "inextensional"),
    ("sidewall, reaction", -250.0, "inextensional"),
    ("imbalance", -250.0, "complete"),
    ("run-out", 60.0, "complete"),
    ("all", -250.0, "complete"),
    ("all, longitudinally compliant", 60.0, "complete"),
    ("all, without damping", 640.0, "inextensional"),
}  # each unit once, each speed and model twice or more


@pytest.mark.slow
@pytest.mark.parametrize(("name", "speed", "model"), spared(CASES, [case for case in CASES if case not in DAILY]))
def test_against_integration_in_the_rings_frame(name, speed, model):
    """Tolerance: a few thousand steps of DOP853, each allowed 3e-14 of the state."""
    unit, load, traction, phi_0, duration = UNITS[name], 3000.0, 400.0, 1.1, 0.06
    start = rotating_excitation.steady_state(unit, speed, load, traction, phi_0, model)
    start = start + 1e-5 * np.cos(np.arange(start.size))  # [m, m/s]: in motion, the wheel too
    inputs = [0.0, duration], [speed] * 2, [(load, traction)] * 2
    (_, expected), _ = ring_frame.integrate(unit, model, *inputs, start, phi_0, rtol=3e-14)
    for step in (0.5e-3, 2e-3, 20e-3):
        motion = Motion(unit, model, 1)
        motion.put(0, start, speed, phi_0)
        steps(motion, round(duration / step), step, speed, load, traction)
        assert np.abs(motion.state_of(0) - expected).max() < 1e-10 * np.abs(expected).max()
        turned = math.remainder(motion.phase_of(0) - phi_0 - speed * duration, 2.0 * math.pi)
        assert turned == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("model", ["inextensional", "complete"])
def test_long_steps_are_short_ones(model):
    """Nothing is cut off at any length of the step: what differs is rounding, of some hundred steps."""
    unit = UNITS["all"]
    ends = []
    for count in (1, 7, 200):
        motion = steps(started(unit, model, 150.0, 3000.0, angle=0.3), count, 0.14 / count, 150.0, 3000.0)
        ends.append(motion.state_of(0))
    for end in ends[1:]:
        assert np.abs(end - ends[0]).max() < (1e-12 if model == "inextensional" else 1e-10) * np.abs(end).max()


# -- forces -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["inextensional", "complete"])
def test_force_on_a_held_wheel_is_that_of_the_springs(model):
    """By quadrature of all springs around the ring; beside the paper's damping nothing else acts there."""
    unit = UNITS["all"].replace(zeta_1=0.0)
    rng = np.random.default_rng(4)
    state, phi = rng.normal(size=wheel.states(unit, model)) * 1e-3, 0.9
    motion = Motion(unit, model, 1)
    motion.put(0, state, 120.0, phi)
    expected = ring_frame.pull_of_the_springs(unit, model, state, phi)
    assert motion.axle_force(0, 120.0)[0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("speed", [80.0, -200.0])
def test_imbalance_on_a_round_support_is_a_whirl(speed):
    """Two masses in a row in complex amplitudes, Z exp(i phi) of the belt and W exp(i phi) of the wheel."""
    unit = TABLE_1.replace(
        **IMBALANCE, zeta_1=0.0, zeta_s=0.0, longitudinal_stiffness=TABLE_1.suspension_stiffness
    )  # fmt: skip
    k, K, m, M = unit.sidewall_stiffness, unit.suspension_stiffness, unit.ring_mass, unit.wheel_mass
    push = unit.imbalance_mass * unit.radius * speed**2 * np.exp(1j * unit.imbalance_angle)
    Z, W = np.linalg.solve([[k - m * speed**2, -k], [-k, k + K - M * speed**2]], [push, 0.0])
    for phi in (0.0, 2.0):
        turn = np.exp(1j * phi)
        state = rotating_excitation.steady_state(unit, speed, 0.0, 0.0, phi)
        expected = [(Z * turn).real, (Z * turn).imag, (W * turn).imag, (W * turn).real]  # X, Y, y, x
        assert state[4:] == pytest.approx(expected, rel=1e-11, abs=1e-18)
        rates = [1j * speed * Z * turn, 1j * speed * W * turn]
        assert state[:4] == pytest.approx([rates[0].real, rates[0].imag, rates[1].imag, rates[1].real], rel=1e-11)


def test_an_imbalance_grows_with_the_square_of_the_speed_and_points_where_it_is():
    """Far below all frequencies the axle carries m_u a Omega^2 where the mass is: x_ros = -X, z = Y."""
    unit = TABLE_1.replace(**IMBALANCE, sidewall_damping="reaction")
    for speed in (0.5, 1.0):
        state = rotating_excitation.steady_state(unit, speed, 0.0, 0.0, 0.4)
        parts = rotating_excitation.rotating_excitation(unit)
        x, z = wheel.axle_force(unit, speed, state)
        assert parts.is_rotating and not parts.spring.any()
        size, angle = unit.imbalance_mass * unit.radius * speed**2, unit.imbalance_angle + 0.4
        # what is left out: (Omega/omega)^2 with a hop of 49 rad/s, and the damping's 2 zeta Omega/omega
        assert [x, z] == pytest.approx([-size * math.cos(angle), size * math.sin(angle)], abs=5e-3 * size)


@pytest.mark.parametrize("model", ["inextensional", "complete"])
def test_run_out_has_no_effect_on_a_load_that_is_given(model):
    """A given load is the load; on the road run-out is a road that turns (test_road_motion)."""
    moved, round_ = (
        steps(started(unit, model, 100.0, 3000.0, angle=0.3), 20, 1e-3, 110.0, 3500.0)
        for unit in (UNITS["run-out"], TABLE_1)
    )
    assert moved.state_of(0).tobytes() == round_.state_of(0).tobytes()


# -- steady states ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["inextensional", "complete"])
@pytest.mark.parametrize("name", ["imbalance"])
def test_forces_that_turn_have_an_exact_steady_state(name, model):
    """The equations stay linear: whatever it is left alone for, the motion stays what it was at the start."""
    unit, speed = UNITS[name], 130.0
    motion = steps(started(unit, model, speed, 2500.0, 100.0, 0.2), 300, 2e-3, speed, 2500.0, 100.0)
    expected = rotating_excitation.steady_state(unit, speed, 2500.0, 100.0, 0.2 + speed * 0.6, model)
    assert np.abs(motion.state_of(0) - expected).max() < 1e-9 * np.abs(expected).max()


def test_a_sidewalls_steady_state_is_right_to_first_order():
    """What the motion does after the start falls with the square of the amplitude."""
    left = []
    for scale in (0.02, 0.01):
        unit = TABLE_1.replace(radial_nonuniformity=[(2, scale, 0.5)])
        motion = steps(started(unit, "inextensional", 100.0, 3000.0), 20, 2e-3, 100.0, 3000.0)
        expected = rotating_excitation.steady_state(unit, 100.0, 3000.0, 0.0, 100.0 * 0.04)
        left.append(np.abs(motion.state_of(0) - expected).max())
    assert left[0] == pytest.approx(4.0 * left[1], rel=0.1)


def test_a_resonance_without_damping_starts_from_the_mean():
    """The hop frequency of Table 1 at zeta = 0: the imbalance has no steady answer."""
    unit = TABLE_1.replace(**IMBALANCE, zeta_1=0.0, zeta_s=0.0)
    hop = wheel.whirl_frequencies(unit, 0.0)[0]
    state = rotating_excitation.steady_state(unit, float(hop), 1000.0)
    assert np.isfinite(state).all()


# -- what is conserved --------------------------------------------------------------------------------------------

MILLION = 1_000_000


def million_steps(unit, start, speed, step, keep):
    """States after every ``keep`` of a million steps without load, and the wheel's angles there."""
    if not is_compiled():
        pytest.skip(f"a million steps take hours interpreted; {how_to_compile()}")
    motion, states, angles = Motion(unit, "inextensional", 1), [], []
    motion.put(0, start, speed, 0.0)
    time, speeds, none = step * np.arange(keep + 1), np.full(keep + 1, speed), np.zeros((keep + 1, 2))
    for _ in range(MILLION // keep):
        motion.follow_lines(time, speeds, none)
        states.append(motion.state_of(0))
        angles.append(motion.phase_of(0))
    return np.array(states), np.array(angles)


@pytest.mark.slow
def test_energy_on_a_round_support_over_a_million_steps():
    """E - Omega L, the energy in axes that turn with the tire, where its stiffness stands still (Jacobi's integral).

    A million roundings of 2^-53 at random make 1e-13, all of one sign 1e-10.
    """
    unit = TABLE_1.replace(
        radial_nonuniformity=[(2, 0.3, 0.4)], zeta_1=0.0, zeta_s=0.0,
        longitudinal_stiffness=TABLE_1.suspension_stiffness,
    )  # fmt: skip
    speed = 100.0
    start = np.array([0.3, -0.2, 0.1, 0.4, 1e-3, 2e-3, -1e-3, 5e-4])
    assert not nonuniform.is_irreducibly_periodic(unit)
    states, phases = million_steps(unit, start, speed, 1e-3, 1000)
    m, M, k, K = unit.ring_mass, unit.wheel_mass, unit.sidewall_stiffness, unit.suspension_stiffness
    e = Nonuniformity.of(unit).second_harmonic(unit)

    def jacobi(z, phi):
        dX, dY, dy, dx, X, Y, y, x = z.T
        R = (X - x) + 1j * (Y - y)
        varying = (R**2 * np.conj(e) * np.exp(-2j * phi)).real
        energy = m * (dX**2 + dY**2) + M * (dx**2 + dy**2) + K * (x**2 + y**2) + k * (np.abs(R) ** 2 + varying)
        return 0.5 * energy - speed * (m * (X * dY - Y * dX) + M * (x * dy - y * dx))

    before, after = jacobi(start[None], 0.0), jacobi(states, phases)
    scale = m * 0.13 + M * 0.17 + k * 1e-5  # of the energy's parts
    assert np.abs(after - before).max() < 1e-10 * scale
    assert np.abs(states[-100:]).max() > 0.01  # it still moves


@pytest.mark.slow
def test_multipliers_of_a_held_wheel_over_a_million_steps():
    """What each Floquet mode has of the motion, looked at once a turn, stays where it is on its circle.

    In a turn of the undamped, stable unit, whose sidewall differs by 10 %, the modes' parts turn by the multipliers, of
    modulus 1; the modes are those of the matrix that direct integration of one turn gives.
    """
    unit = TABLE_1.replace(radial_nonuniformity=[(2, 0.34, 0.4)], zeta_1=0.0, zeta_s=0.0)
    steps, speed = 50, 100.0
    step = 2.0 * math.pi / speed / steps
    sidewall = Nonuniformity.of(unit)

    def slope(t, z):
        return (nonuniform.fixed_frame_matrix(unit, sidewall, speed, speed * t) @ z.reshape(6, 6)).ravel()

    omega = 500.0
    scale = np.repeat([1.0, 1.0 / omega], 3)
    turn = solve_ivp(slope, (0.0, steps * step), np.diag(scale).ravel(), method="DOP853", rtol=1e-13, atol=1e-16)
    turn = turn.y[:, -1].reshape(6, 6) / scale[:, None]
    values, modes = np.linalg.eig(turn)
    assert np.abs(np.abs(values) - 1.0).max() < 1e-10 and nonuniform.is_irreducibly_periodic(unit)
    parts = np.linalg.inv(modes)
    start = np.array([0.3, -0.2, 0.1, 1e-3, 2e-3, -1e-3])
    states, _ = million_steps(unit, start, speed, step, steps)
    sizes = np.abs(states / scale @ parts.T)
    first = np.abs(parts @ (start / scale))
    # the matrix is known to 1e-12 or so, and so are its modes; the rest is a million roundings
    assert np.abs(sizes - first).max() < 1e-9 * first.max()


def turned_axes(phi, speed, n):
    """States in axes that turn with the tire, of states in the fixed frame; the wheel's pair is x, y."""
    half, c, s = n // 2, math.cos(phi), math.sin(phi)
    R, J = np.array([[c, s], [-s, c]]), np.array([[0.0, -1.0], [1.0, 0.0]])
    T = np.zeros((n, n))
    for pair in [*((k, k + 1) for k in range(0, half - 2, 2)), (half - 1, half - 2)]:
        behind = [half + k for k in pair]
        T[np.ix_(pair, pair)] = T[np.ix_(behind, behind)] = R
        T[np.ix_(pair, behind)] = -speed * R @ J
    return T


@pytest.mark.parametrize("model", ["inextensional", "complete"])
@pytest.mark.parametrize("damping", ["modal", "reaction"])
@pytest.mark.parametrize(("change", "irreducible"), [({}, False), ({"longitudinal_mass": 9.0}, True), (None, True)])
def test_reducible_is_what_axes_that_turn_make_constant(model, damping, change, irreducible):
    """On a support without direction; one that differs in mass alone, or holds the wheel, leaves it periodic."""
    round_support = {"longitudinal_stiffness": TABLE_1.suspension_stiffness, "longitudinal_damping_ratio": 0.05}
    unit = TABLE_1.replace(**SIDEWALL, sidewall_damping=damping, **({} if change is None else round_support | change))
    assert nonuniform.is_irreducibly_periodic(unit, model) == irreducible
    assert not nonuniform.is_irreducibly_periodic(unit.mean, model)
    if change is None:
        return
    matrices = []
    for phi in (0.0, 0.7, 2.0):
        F = nonuniform.fixed_frame_matrix(unit, Nonuniformity.of(unit), 100.0, phi, model)
        T = turned_axes(phi, 100.0, len(F))
        matrices.append(T @ F @ np.linalg.inv(T))
    largest = np.abs(matrices[0]).max()
    differs = max(np.abs(each - matrices[0]).max() for each in matrices) / largest
    assert differs > 1e-3 if irreducible else differs < 1e-13  # the rounding of three products


def test_growth_in_a_tongue_is_the_multipliers():
    unit = TABLE_1.replace(radial_nonuniformity=[(2, 0.3, 0.0)], zeta_1=0.0, zeta_s=0.0)
    speed = nonuniform.nearest_tongue(unit, Nonuniformity.of(unit), 640.0)
    found = wheel.stability(unit, speed)
    assert found.verdict == "unstable"
    motion = Motion(unit, "inextensional", 1)
    motion.put(0, np.full(6, 1e-6), speed, 0.0)
    sizes = []
    for _ in range(60):
        motion.advance(0, 2.0 * math.pi / speed, speed, 0.0)
        sizes.append(np.linalg.norm(motion.state_of(0)[:3]))
    # slower modes are gone by then
    growth = (sizes[-1] / sizes[-21]) ** (1.0 / 20.0)
    assert growth == pytest.approx(found.spectral_radius, rel=1e-3)


# -- the uniform tire as the limit --------------------------------------------------------------------------------


def drive(unit, model, seed=3):
    """An estimator's axle forces and belts under random speeds, loads and angles."""
    rng = np.random.default_rng(seed)
    estimator = WheelEstimator(unit, model, n_max=4)
    seen = []
    for k in range(60):
        now = k * 2 * MS
        estimator.add_speed(now, 100.0 + rng.normal(), rng.uniform(0.0, 6.0) if k % 3 == 0 else math.nan)
        estimator.add_load(now + int(rng.integers(0, MS)), 3000.0 + 100.0 * rng.normal(), 50.0 * rng.normal())
        if estimator.advance(now + MS):
            seen.append((*estimator.axle_force, *estimator.state))
    return np.array(seen)


@pytest.mark.parametrize("model", ["inextensional", "complete"])
def test_no_amplitude_is_the_uniform_tire_bit_for_bit(model):
    still = {"radial_nonuniformity": [(2, 0.0, 0.4)], "radial_runout": [(1, 0.0, 1.0)], "imbalance_angle": 1.0}
    other_harmonics = {"radial_nonuniformity": [(3, 0.2, 0.4)]}  # n = 1 feels the second alone
    expected = drive(TABLE_1, model)
    for changes in (still, other_harmonics):
        assert drive(TABLE_1.replace(**changes), model).tobytes() == expected.tobytes()


@pytest.mark.parametrize("model", ["inextensional", "complete"])
def test_small_amplitudes_tend_to_the_uniform_tire(model):
    """To first order in them; the smallest meets the exact steps of the uniform tire to rounding."""
    expected = drive(TABLE_1, model)
    left = []
    for size in (1e-2, 1e-3, 1e-18):
        unit = TABLE_1.replace(
            radial_nonuniformity=[(2, size, 0.4)], imbalance_mass=size, radial_runout=[(1, 1e-2 * size, 0.0)]
        )
        left.append(np.abs(drive(unit, model) - expected).max())
    assert left[0] == pytest.approx(10.0 * left[1], rel=0.05)
    assert left[2] < 1e-10 * np.abs(expected).max()


@pytest.mark.parametrize("stiffness", [1e30, 1e80])
@pytest.mark.parametrize("varying", [{}, {"radial_nonuniformity": [(2, 0.1, 0.0)]}], ids=["uniform", "varying"])
def test_a_unit_that_is_no_tire_is_given_up(varying, stiffness):
    """It would take more pieces than there is time for, or doubles hold: no hang, no exception."""
    estimator = WheelEstimator(TABLE_1.replace(**varying, radial_stiffness=stiffness))
    estimator.add_speed(0, 100.0)
    estimator.add_load(0, 1000.0)
    estimator.advance(0)
    estimator.add_load(1, 3000.0)
    estimator.advance(MS)
    if estimator.advance(100 * MS):  # a uniform one may be as stiff as it likes
        assert not varying and np.isfinite(estimator.axle_force).all()
    else:
        assert estimator.divergences > 0


# -- the wheel's angle --------------------------------------------------------------------------------------------


def test_the_latest_measured_angle_counts_and_follows_the_speed():
    estimator = WheelEstimator(UNITS["imbalance"])
    estimator.add_load(0, 1000.0)
    estimator.add_speed(0, 100.0)
    estimator.advance(0)
    estimator.advance(10 * MS)
    assert estimator.phase == pytest.approx(1.0)
    estimator.add_speed(8 * MS, 50.0, 40.0)  # late: 2 ms old when it comes
    estimator.advance(20 * MS)
    assert estimator.phase == pytest.approx(math.fmod(40.0 + 50.0 * 12e-3, 2.0 * math.pi))
    estimator.add_speed(25 * MS, -50.0, -3.0)
    estimator.advance(24 * MS)
    assert estimator.phase == pytest.approx(math.fmod(40.0 + 50.0 * 16e-3, 2.0 * math.pi))
    estimator.advance(30 * MS)
    assert estimator.phase == pytest.approx(-3.25)
    estimator.add_speed(31 * MS, -50.0, math.inf)  # no angle: it goes on
    estimator.advance(40 * MS)
    assert estimator.phase == pytest.approx(-3.75)


def test_a_wheel_that_starts_again_has_the_measured_angle():
    """Its load was stale, its speed was not: the sample in force says where the wheel is by now."""
    estimator = WheelEstimator(UNITS["imbalance"], timeout=100 * MS)
    estimator.add_speed(0, 10.0, 2.0)
    estimator.add_load(0, 1000.0)
    estimator.advance(50 * MS)
    estimator.add_speed(90 * MS, 10.0, 2.9)
    assert estimator.advance(95 * MS)
    assert not estimator.advance(150 * MS)
    estimator.add_load(160 * MS, 1000.0)
    assert estimator.advance(170 * MS)
    assert estimator.phase == pytest.approx(2.9 + 10.0 * 0.08)


def test_positions_that_stand_still_are_none():
    """A publisher without encoders may fill them with zeros."""
    estimator = WheelEstimator(UNITS["imbalance"])
    estimator.add_load(0, 1000.0)
    for k in range(11):
        estimator.add_speed(k * 10 * MS, 10.0, 0.0)
        estimator.advance(k * 10 * MS)
    assert estimator.phase == pytest.approx(1.0)


@settings(max_examples=20)
@given(shift=st.floats(-6.0, 6.0))
def test_a_wheel_turned_further_is_a_tire_mounted_further(shift):
    """All angles of the tire back by what the wheel's is forward."""
    unit = UNITS["all"]
    back = unit.replace(
        **{
            name: [(j, e, chi - shift) for j, e, chi in getattr(unit, name)]
            for name in ("radial_nonuniformity", "tangential_nonuniformity", "radial_runout")
        },
        imbalance_angle=unit.imbalance_angle - shift,
    )
    ends = []
    for tire, angle in ((unit, 0.5), (back, 0.5 + shift)):
        motion = steps(started(tire, "inextensional", 90.0, 3000.0, angle=angle), 20, 2e-3, 90.0, 3100.0)
        ends.append(np.concatenate([motion.state_of(0), motion.axle_force(0, 90.0)]))
    assert ends[0] == pytest.approx(ends[1], rel=1e-9, abs=1e-9)


# -- any unit at all -------------------------------------------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=60)
@given(values=mappings(), speed=st.floats(-1e3, 1e3), model=st.sampled_from(["inextensional", "complete"]))
def test_any_unit_that_is_accepted_gives_finite_forces_or_none(values, speed, model):
    """However far from a tire: what cannot be stepped is given up, and stability says why it has no answer."""
    try:
        unit = TireWheelUnit(**values)
    except ValueError:
        return  # each field in bounds, but not all together
    try:
        json.dumps(stability_reply("wheel", unit, speed, model), allow_nan=False)
    except (ArithmeticError, ValueError) as error:
        assert str(error)
    estimator = WheelEstimator(unit, model, n_max=2)
    estimator.add_speed(0, speed, 1.0)
    estimator.add_load(0, 1000.0)
    for tick in range(3):
        if estimator.advance(tick * 2 * MS):
            assert all(map(math.isfinite, estimator.axle_force))
        else:
            assert estimator.divergences > 0 or tick == 0
