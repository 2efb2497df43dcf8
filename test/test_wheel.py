"""The wheel on its suspension: both frames, both models, both dampings, stability and transmissibility."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from tire_dynamics import TireWheelUnit, floquet, wheel

TABLE_1 = TireWheelUnit.table_1()
RPM = math.pi / 30.0
MODELS, DAMPINGS = ("inextensional", "complete"), ("modal", "reaction")


@st.composite
def units(draw, least_damping=0.01):
    """Tires around Table 1, every quantity that n = 1 depends on by a factor of up to three either way."""
    factor = st.floats(-1.5, 1.5).map(lambda x: 2.0**x)
    changes = {
        name: getattr(TABLE_1, name) * draw(factor)
        for name in ("density", "membrane_stiffness", "radius", "width", "radial_stiffness", "tangential_stiffness",
                     "inflation_pressure", "wheel_mass", "suspension_stiffness")
    }  # fmt: skip
    damping = st.floats(least_damping, 0.6)
    return TABLE_1.replace(
        **changes, zeta_1=draw(damping), zeta_s=draw(damping), sidewall_damping=draw(st.sampled_from(DAMPINGS))
    )


models = st.sampled_from(MODELS)
speeds = st.floats(-800.0, 800.0)


def scaled(matrix, omega=500.0):
    """Velocities as they are, displacements times a frequency: all elements in 1/s, of one size."""
    size = np.repeat([1.0, omega], len(matrix) // 2)
    return matrix * (size[:, None] / size)


# -- the matrices against the paper's equations -----------------------------------------------------------------


@given(unit=units(), speed=speeds, time=st.floats(0.0, 0.1))
def test_inextensional_state_matrix(unit, speed, time):
    """(3.13) written out, modal damping."""
    unit = unit.replace(sidewall_damping="modal")
    a, b, M, m = unit.radius, unit.width, unit.wheel_mass, unit.ring_mass
    rho_h = unit.density * unit.thickness
    k_1 = math.pi * a * b * (unit.radial_stiffness + unit.tangential_stiffness)
    kappa = (unit.radial_stiffness + unit.tangential_stiffness) / (2.0 * rho_h)
    k_s, c_s = unit.suspension_stiffness, 2.0 * unit.zeta_s * math.sqrt(unit.suspension_stiffness * (M + m))
    d, W = 2.0 * unit.zeta_1 * math.sqrt(kappa), speed
    s, c = math.sin(W * time), math.cos(W * time)

    def acceleration(z):
        va, vb, vy, alpha, beta, y = z
        return [
            -(d * va - 2 * W * vb + (kappa - W * W) * alpha - kappa * s * y),
            -(d * vb + 2 * W * va + (kappa - W * W) * beta - kappa * c * y),
            -(c_s / M * vy - k_1 / M * (s * alpha + c * beta) + (k_1 + k_s) / M * y),
        ]

    expected = np.array([[*acceleration(e), *e[:3]] for e in np.eye(6)]).T
    found = wheel.state_matrix(unit, speed, time)
    # two ways to round the same numbers
    assert np.abs(scaled(found - expected)).max() <= 1e-13 * np.abs(scaled(expected)).max()


@given(unit=units(), speed=speeds, time=st.floats(0.0, 0.1))
def test_complete_state_matrix(unit, speed, time):
    """(3.4) written out, modal damping, whose omega_1 is the lower root of the complete model at rest."""
    unit = unit.replace(sidewall_damping="modal")
    a, M, W = unit.radius, unit.wheel_mass, speed
    rho_h = unit.density * unit.thickness
    k_z, k_t, p_0 = unit.radial_stiffness, unit.tangential_stiffness, unit.inflation_pressure

    def coefficients(W):
        D, K, sigma = unit.bending_stiffness, unit.membrane_stiffness, W * W + p_0 / (rho_h * a)
        A = (D / a**4 + K / a**2) / rho_h + 2.0 * sigma
        B = (D / a**4 + K / a**2 + k_z + p_0 / a) / rho_h + sigma
        return A, B, (D / a**4 + K / a**2 + k_t + p_0 / a) / rho_h + sigma

    A, B, C = coefficients(0.0)
    d = 2.0 * unit.zeta_1 * math.sqrt(np.linalg.eigvalsh([[B, A], [A, C]])[0])
    A, B, C = coefficients(W)
    k_s, g = unit.suspension_stiffness, math.pi * a * unit.width / M
    c_s = 2.0 * unit.zeta_s * math.sqrt(k_s * (M + unit.ring_mass))
    s, c = math.sin(W * time), math.cos(W * time)
    G = np.array([
        [d, 0, -2 * W, 0, 0],
        [0, d, 0, -2 * W, 0],
        [2 * W, 0, d, 0, 0],
        [0, 2 * W, 0, d, 0],
        [0, 0, 0, 0, c_s / M],
    ])  # fmt: skip
    K = np.array([
        [B, 0, 0, A, -k_z * s / rho_h],
        [0, B, -A, 0, -k_z * c / rho_h],
        [0, -A, C, 0, -k_t * c / rho_h],
        [A, 0, 0, C, k_t * s / rho_h],
        [-g * k_z * s, -g * k_z * c, -g * k_t * c, g * k_t * s, g * (k_z + k_t) + k_s / M],
    ])  # fmt: skip
    expected = np.block([[-G, -K], [np.eye(5), np.zeros((5, 5))]])
    found = wheel.state_matrix(unit, speed, time, "complete")
    # d comes from the small root of a quadratic: 1e-16 of the large one, some ten times as large
    assert np.abs(scaled(found - expected)).max() <= 1e-12 * np.abs(scaled(expected)).max()


def reaction_by_hand(unit, W, model):
    """F and the axle force's rows, from section 4 in the fixed frame, the damping from its dissipation.

    Complete model: u_z = X cos psi + Y sin psi, u_theta = U cos psi + V sin psi. A dashpot of area dA turns with the
    ring and feels e' = (d/dt + Omega d/dpsi) e, e_z = u_z - x cos psi - y sin psi, e_theta = u_theta + x sin psi -
    y cos psi, x being the held wheel; its work on each coordinate is integrated around the ring.
    """
    M, m, k_s, c_s = unit.wheel_mass, unit.ring_mass, unit.suspension_stiffness, unit.suspension_damping
    if model == "inextensional":
        kappa, d = unit.sidewall_stiffness / m, 2.0 * unit.zeta_1 * unit.rigid_mode_frequency
        J, e_Y = np.array([[0.0, -1.0], [1.0, 0.0]]), np.array([0.0, 1.0])
        F, force = [], []
        for z in np.eye(6):
            R_dot, y_dot, R, y = z[:2], z[2], z[3:5], z[5]
            R_rel, R_rel_dot = R - y * e_Y, R_dot - y_dot * e_Y
            S = m * (kappa * R_rel + d * (R_rel_dot - W * J @ R_rel))
            F.append([*(-S / m), (S[1] - c_s * y_dot - k_s * y) / M, *R_dot, y_dot])
            force.append([-S[0], k_s * y + c_s * y_dot])
        return np.array(F).T, np.array(force).T
    undamped = unit.replace(zeta_1=0.0)
    F = wheel.fixed_frame_matrix(undamped, W, "complete")
    area = unit.radius * unit.width
    # the modal variant's damping of a coordinate is d times its rate: read d off it, at rest
    d = -wheel.fixed_frame_matrix(unit.replace(sidewall_damping="modal"), 0.0, "complete")[0, 0]
    per_area = unit.density * unit.thickness * d
    psi = 2.0 * math.pi * np.arange(16) / 16  # exact for products of first harmonics
    c, s, zero = np.cos(psi), np.sin(psi), np.zeros_like(psi)
    shape_z = np.array([c, s, zero, zero, -s, -c])  # of X, Y, U, V, y, x
    shape_t = np.array([zero, zero, c, s, -c, s])
    slope_z = np.array([-s, c, zero, zero, -c, s])
    slope_t = np.array([zero, zero, -s, c, s, c])
    around = 2.0 * math.pi * area / 16
    rate = -per_area * around * (shape_z @ shape_z.T + shape_t @ shape_t.T)[:, :5]  # force on i by the rate of j
    turn = -per_area * around * W * (shape_z @ slope_z.T + shape_t @ slope_t.T)[:, :5]
    springs = (
        -around * (unit.radial_stiffness * shape_z @ shape_z.T + unit.tangential_stiffness * shape_t @ shape_t.T)[:, :5]
    )
    inertia = np.array([m / 2.0] * 4 + [M])
    F[:5, :5] += rate[:5] / inertia[:, None]
    F[:5, 5:] += turn[:5] / inertia[:, None]
    on_wheel = np.concatenate([rate[5], turn[5] + springs[5]])  # along X; springs[5] has the held wheel's share
    vertical = np.zeros(10)
    vertical[[4, 9]] = c_s, k_s
    return F, np.array([-on_wheel, vertical])


@given(unit=units(), speed=speeds, model=models)
def test_reaction(unit, speed, model):
    """Section 4, derived again: the state matrix, and the force on the axle."""
    unit = unit.replace(sidewall_damping="reaction")
    F, force = reaction_by_hand(unit, speed, model)
    found = wheel.fixed_frame_matrix(unit, speed, model)
    assert np.abs(scaled(found - F)).max() <= 1e-12 * np.abs(scaled(F)).max()
    rows = np.array([wheel.axle_force(unit, speed, z, model) for z in np.eye(len(F))]).T
    assert (np.abs(rows - force) <= 1e-12 * np.abs(force).max(axis=1, keepdims=True)).all()


@given(unit=units(), speed=speeds, model=models)
def test_force_of_modal_damping(unit, speed, model):
    """The sidewall's springs alone act on the wheel: k_1 X, or the integral of both springs around the ring."""
    unit = unit.replace(sidewall_damping="modal")
    half = 3 if model == "inextensional" else 5
    rows = np.array([wheel.axle_force(unit, speed, z, model) for z in np.eye(2 * half)]).T
    expected = np.zeros((2, 2 * half))
    expected[1, [half - 1, -1]] = unit.suspension_damping, unit.suspension_stiffness
    if model == "inextensional":
        expected[0, 3] = -unit.sidewall_stiffness
    else:
        # k_z X cos^2 - k_theta V sin^2 ... on a held wheel; V = -X/1 for a rigid shift: both push the same way
        area = math.pi * unit.radius * unit.width
        expected[0, [5, 8]] = -area * unit.radial_stiffness, area * unit.tangential_stiffness
        shift = np.zeros(10)
        shift[[5, 8]] = 1.0, -1.0
        assert wheel.axle_force(unit, speed, shift, model)[0] == pytest.approx(-unit.sidewall_stiffness, rel=1e-14)
    assert rows == pytest.approx(expected, rel=1e-14)


# -- rotating and fixed frame -----------------------------------------------------------------------------------


@given(unit=units(), speed=speeds, time=st.floats(0.0, 0.1), model=models)
def test_lyapunov_transformation(unit, speed, time, model):
    """z_ring = T z_fixed with A T = T' + T F; T' = Omega N T, N the turn of every pair by a quarter."""
    T = wheel.rotation(speed * time, speed, model)
    half = len(T) // 2
    N = np.zeros_like(T)
    for first in [k for start in (0, half) for k in range(start, start + half - 1, 2)]:
        N[first, first + 1], N[first + 1, first] = 1.0, -1.0
    left = wheel.state_matrix(unit, speed, time, model) @ T
    right = speed * N @ T + T @ wheel.fixed_frame_matrix(unit, speed, model)
    # rounding, of Omega^2 terms that cancel as well
    assert np.abs(scaled(left - right)).max() <= 1e-12 * max(np.abs(scaled(left)).max(), 1.0)


def test_rotation_is_the_one_of_the_page():
    """X = alpha cos phi - beta sin phi, Y = alpha sin phi + beta cos phi, and the rates of a point at rest."""
    phi, W = 0.7, 30.0
    c, s = math.cos(phi), math.sin(phi)
    alpha, beta, y = 0.3, -0.2, 0.1
    X, Y = alpha * c - beta * s, alpha * s + beta * c
    z = wheel.rotation(phi, W) @ [0.0, 0.0, 5.0, X, Y, y]
    # fixed in space: seen from the ring it turns backward
    assert z == pytest.approx([W * beta, -W * alpha, 5.0, alpha, beta, y], rel=1e-14)


@given(unit=units(), speed=speeds, model=models)
def test_fixed_frame_stiffness_does_not_know_the_speed(unit, speed, model):
    """Centrifugal, hoop-tension and Coriolis parts cancel; what is left is antisymmetric in pairs."""
    F_0, F = wheel.fixed_frame_matrix(unit, 0.0, model), wheel.fixed_frame_matrix(unit, speed, model)
    half = len(F) // 2
    change = F[:half, half:] - F_0[:half, half:]
    stiffness = change[: half - 1, : half - 1]
    assert stiffness == pytest.approx(-stiffness.T, rel=1e-14)
    back = wheel.fixed_frame_matrix(unit, -speed, model)
    assert np.abs(scaled(F + back - 2.0 * F_0)).max() <= 1e-14 * np.abs(scaled(F)).max()


@pytest.mark.parametrize("model", MODELS)
def test_matrices_are_the_callers_own_or_cannot_be_written(model):
    F = wheel.fixed_frame_matrix(TABLE_1, 10.0, model)
    F[:] = 0.0
    assert wheel.fixed_frame_matrix(TABLE_1, 10.0, model).any()
    for shared in wheel.fixed_frame(TABLE_1, model):
        with pytest.raises(ValueError, match="read-only"):
            shared[:] = 0.0


# -- a speed that jumps, and what a state means -----------------------------------------------------------------


def random_state(seed, model):
    size = np.repeat([1.0, 1.0 / 500.0], 3 if model == "inextensional" else 5)
    return np.random.default_rng(seed).normal(size=size.size) * size


def slopes(model, unit, speed, acceleration, state):
    """Ring-frame rate of a ring-frame state at phi = 0, with the Euler terms of section 2 of docs/model.md.

    Z'' has them as +Omega' z_2 (radial) and -Omega' z_1 (tangential); with xi = beta, eta = -alpha for n = 1 of a ring
    that cannot stretch, as +Omega' beta and -Omega' alpha.
    """
    rate = wheel.state_matrix(unit, speed, 0.0, model) @ state
    half = len(state) // 2
    position = state[half:]
    if model == "inextensional":
        rate[:2] += acceleration * np.array([position[1], -position[0]])
    else:
        rate[:4] += acceleration * np.array([position[2], position[3], -position[0], -position[1]])
    return rate


@given(unit=units(), speed=speeds, change=st.floats(-200.0, 200.0), seed=st.integers(0, 99), model=models)
def test_change_speed(unit, speed, change, seed, model):
    """The Euler terms' integral over a jump: in the ring's frame velocities jump by it, positions do not.

    They are linear in the position, which a jump leaves as it is: the integral is the change of the speed times them.
    """
    fixed = random_state(seed, model)
    before = wheel.rotation(0.0, speed, model) @ fixed
    after = wheel.rotation(0.0, speed + change, model) @ wheel.change_speed(fixed, change, model)
    euler = slopes(model, unit, speed, change, before) - slopes(model, unit, speed, 0.0, before)
    # rounding beside terms like Omega^2 z and Omega z; the Euler terms come as a difference of rates of 1e6
    assert np.abs(after - before - euler).max() <= 1e-9 * (1.0 + np.abs(before).max())


@given(change=st.floats(-200.0, 200.0), seed=st.integers(0, 99), model=models)
def test_change_speed_there_and_back(change, seed, model):
    fixed = random_state(seed, model)
    copy = fixed.copy()
    back = wheel.change_speed(wheel.change_speed(fixed, change, model), -change, model)
    assert back == pytest.approx(fixed, rel=1e-15, abs=1e-14)  # one rounding each way, of velocities of 1
    assert np.array_equal(fixed, copy)  # the caller's own is left alone


@given(seed=st.integers(0, 99), model=models)
def test_belt_amplitudes_and_ring_centre(seed, model):
    """Against the displacements of points around the ring, from the ring-frame amplitudes at some angle phi."""
    fixed = np.stack([random_state(seed, model), random_state(seed + 100, model)])
    phi, psi = 0.8, 2.0 * math.pi * np.arange(8) / 8
    theta = psi - phi
    for state, belt, centre in zip(
        fixed, wheel.belt_amplitudes(fixed, model), wheel.ring_centre(fixed, model), strict=True
    ):
        coordinates = (wheel.rotation(phi, 123.0, model) @ state)[len(state) // 2 :]
        alpha, beta, *rest, y = coordinates
        xi, eta = rest if rest else (beta, -alpha)
        u_z = alpha * np.cos(theta) + beta * np.sin(theta)
        u_theta = xi * np.cos(theta) + eta * np.sin(theta)
        a, b, c, d = belt
        assert a * np.cos(psi) + b * np.sin(psi) == pytest.approx(u_z - y * np.sin(psi), abs=1e-15)
        assert c * np.cos(psi) + d * np.sin(psi) == pytest.approx(u_theta - y * np.cos(psi), abs=1e-15)
        # e_r = (cos, sin), e_theta = (-sin, cos); the mean over evenly spaced points is exact
        X = np.mean(u_z * np.cos(psi) - u_theta * np.sin(psi))
        Y = np.mean(u_z * np.sin(psi) + u_theta * np.cos(psi))
        assert centre == pytest.approx([X, Y], abs=1e-15)


@pytest.mark.parametrize("model", MODELS)
def test_is_unstable(model):
    unit = TABLE_1.replace(zeta_1=0.5)
    critical = wheel.critical_speed(unit, model)
    assert [wheel.is_unstable(unit, w * critical, model) for w in (0.0, 0.99, 1.01)] == [False, False, True]
    undamped = TABLE_1.replace(zeta_1=0.0, zeta_s=0.0)
    assert not wheel.is_unstable(undamped, 300.0, model)  # marginal is not unstable


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("half_angle", [1e-9, 0.1, 0.5, 0.5 * math.pi])
def test_contact_patch(model, half_angle):
    """Section 4: s_1 = 1, for what is spread is a pressure whose resultant is the load. All of it reaches n = 1."""
    point, spread = (wheel.fixed_frame(TABLE_1.replace(contact_half_angle=a), model) for a in (0.0, half_angle))
    for name in ("constant", "spin", "input", "output", "output_spin"):
        assert np.array_equal(getattr(spread, name), getattr(point, name))


# -- steady state -----------------------------------------------------------------------------------------------


@given(unit=units(), speed=speeds, load=st.floats(-1e4, 1e4), traction=st.floats(-1e4, 1e4), model=models)
def test_equilibrium_is_one(unit, speed, load, traction, model):
    z = wheel.equilibrium(unit, speed, load, traction, model)
    F = wheel.fixed_frame_matrix(unit, speed, model)
    push = wheel.fixed_frame(unit, model).input @ [load, traction]
    residual = F @ z + push
    # rounding beside the largest terms that cancel: k_1/m z, and for "complete" K/(a^2 rho h) z
    assert np.abs(residual).max() <= 1e-13 * max((np.abs(F) @ np.abs(z)).max(), np.abs(push).max())


@given(unit=units(), speed=speeds)
def test_transmissibility(unit, speed):
    """The closed form against the steady state of the equations."""
    _, z = wheel.axle_force(unit, speed, wheel.equilibrium(unit, speed, 1000.0))
    assert wheel.transmissibility(unit, speed) == pytest.approx(z / 1000.0, rel=1e-11)  # k_1/k_s up to 10^3


@given(unit=units(), speed=speeds, zeta_s=st.floats(0.0, 0.9))
def test_transmissibility_does_not_know_the_suspension_damper(unit, speed, zeta_s):
    changed = unit.replace(zeta_s=zeta_s)
    assert wheel.transmissibility(changed, speed) == wheel.transmissibility(unit, speed)
    forces = [wheel.axle_force(u, speed, wheel.equilibrium(u, speed, 1000.0)) for u in (unit, changed)]
    assert np.array_equal(*forces)


@given(unit=units(), speed=speeds, traction=st.floats(-1e3, 1e3), model=models)
def test_reaction_passes_on_what_it_gets(unit, speed, traction, model):
    """Section 4: K = 1, and no horizontal force but the traction, at every speed."""
    unit = unit.replace(sidewall_damping="reaction")
    force = wheel.axle_force(unit, speed, wheel.equilibrium(unit, speed, 1000.0, traction, model), model)
    # k_1/k_s up to 10^3, and the complete ring's membrane as stiff again
    assert force == pytest.approx([traction, 1000.0], abs=1e-8)
    assert wheel.transmissibility(unit, speed) == 1.0


def test_transmissibility_of_many_speeds():
    speeds = np.array([[0.0, 100.0], [-100.0, 300.0]])
    for damping in DAMPINGS:
        unit = TABLE_1.replace(sidewall_damping=damping)
        K = wheel.transmissibility(unit, speeds)
        assert K.shape == (2, 2)
        assert [[wheel.transmissibility(unit, float(w)) for w in row] for row in speeds] == K.tolist()
    assert isinstance(wheel.transmissibility(TABLE_1, 10.0), float)
    assert wheel.transmissibility(TABLE_1, 0.0) == 1.0


def test_transmissibility_falls_with_speed_and_damping():
    K = wheel.transmissibility(TABLE_1, np.linspace(0.0, 1000.0, 50))
    assert (np.diff(K) < 0.0).all()
    assert wheel.transmissibility(TABLE_1.replace(zeta_1=0.1), 200.0) < wheel.transmissibility(TABLE_1, 200.0)


# -- stability --------------------------------------------------------------------------------------------------


def worst_difference(expected, found):
    """Largest difference between two sets of numbers, paired off in the best way."""
    distance = np.abs(expected[:, None] - found[None, :])
    return distance[linear_sum_assignment(distance)].max()


@pytest.mark.slow
@settings(max_examples=20)
@given(unit=units(), speed=st.floats(60.0, 2500.0), backward=st.booleans(), model=models)
@example(unit=TABLE_1, speed=2000.0 * RPM, backward=False, model="inextensional")
@example(unit=TABLE_1.replace(zeta_1=0.5), speed=4400.0 * RPM, backward=False, model="inextensional")
@example(unit=TABLE_1.replace(sidewall_damping="reaction"), speed=13100.0 * RPM, backward=True, model="complete")
@example(unit=TABLE_1.replace(zeta_1=0.0, zeta_s=0.0), speed=300.0, backward=True, model="inextensional")
def test_stability_against_numerical_floquet_analysis(unit, speed, backward, model):
    """The closed form against the monodromy matrix of the periodic equations."""
    speed = -speed if backward else speed
    period = 2.0 * math.pi / abs(speed)
    closed = wheel.stability(unit, speed, model)
    numerical = floquet.analyze(lambda t: wheel.state_matrix(unit, speed, t, model), period)
    difference = worst_difference(closed.multipliers, numerical.multipliers)
    assert difference <= closed.error_estimate + numerical.error_estimate
    # rtol 1e-10 of the monodromy, whose eigenvalues are not that ill-conditioned but near a double one
    assert closed.spectral_radius == pytest.approx(numerical.spectral_radius, rel=1e-6)
    if abs(closed.spectral_radius - 1.0) > 1e-6:
        assert closed.verdict == numerical.verdict
    assert closed.period == numerical.period == period


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("damping", DAMPINGS)
def test_stability_at_standstill(model, damping):
    unit = TABLE_1.replace(sidewall_damping=damping)
    for speed in (0.0, -0.0):
        result = wheel.stability(unit, speed, model)
        assert result.multipliers is None and result.spectral_radius is None and result.period is None
        assert result.verdict == "asymptotically stable"
        expected = np.linalg.eigvals(wheel.fixed_frame_matrix(unit, 0.0, model))
        assert worst_difference(expected, result.exponents) < 1e-6 * np.abs(expected).max()
    undamped = unit.replace(zeta_1=0.0, zeta_s=0.0)
    assert wheel.stability(undamped, 0.0, model).verdict == "marginally stable"


@pytest.mark.parametrize("speed", [1e-320, 1e-300, 1e-9, 1e-3])
def test_stability_at_a_crawl(speed):
    """A period of years, of which nothing is left at the end; the verdict is that of standstill."""
    for sign in (1.0, -1.0):
        result = wheel.stability(TABLE_1, sign * speed)
        assert result.verdict == "asymptotically stable"
        assert result.multipliers is None or not np.any(result.multipliers)


@given(unit=units(), speed=st.floats(1.0, 800.0), model=models)
def test_stability_does_not_know_the_direction(unit, speed, model):
    there, back = (wheel.stability(unit, w, model) for w in (speed, -speed))
    assert there.spectral_radius == pytest.approx(back.spectral_radius, rel=1e-9)
    assert there.verdict == back.verdict or abs(there.spectral_radius - 1.0) < 1e-9


# Loses its stability at 690 rad/s, has it back from 1550 to 4790 rad/s, and loses it again (complete model).
STABLE_AGAIN = TABLE_1.replace(
    density=1370.0, membrane_stiffness=5.6e5, radius=0.6, width=0.43, radial_stiffness=1.2e6,
    tangential_stiffness=1.5e7, inflation_pressure=5.5e4, wheel_mass=4.7, suspension_stiffness=3.4e4,
    zeta_1=0.067, zeta_s=0.026,
)  # fmt: skip


@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("speed", [50.0, 2000.0 * RPM])
def test_complete_multipliers_come_to_the_inextensional_ones(damping, speed):
    """As the membrane grows stiffer, with a difference that falls as 1/K; the 4 of the stretching motion apart."""
    differences = []
    for K in TABLE_1.membrane_stiffness * 4.0 ** np.arange(3, 8):
        unit = TABLE_1.replace(membrane_stiffness=K, sidewall_damping=damping)
        complete, inextensional = (wheel.stability(unit, speed, model) for model in ("complete", "inextensional"))
        slow = complete.exponents[np.argsort(np.abs(complete.exponents))[:6]]
        moduli = np.sort(np.exp(slow.real * complete.period))
        differences.append(np.abs(moduli / np.sort(np.abs(inextensional.multipliers)) - 1.0).max())
    ratios = np.array(differences[:-1]) / differences[1:]
    assert ratios == pytest.approx(4.0, abs=0.05)  # the next order is 1/K itself beside 1, below 1 % from 4^3 K on
    assert differences[-1] < 1e-5


@pytest.mark.parametrize("damping", DAMPINGS)
def test_complete_critical_speed_comes_to_the_inextensional_one(damping):
    differences = []
    for K in TABLE_1.membrane_stiffness * 4.0 ** np.arange(5, 9):
        unit = TABLE_1.replace(membrane_stiffness=K, sidewall_damping=damping)
        differences.append(abs(wheel.critical_speed(unit, "complete") / wheel.critical_speed(unit) - 1.0))
    ratios = np.array(differences[:-1]) / differences[1:]
    # its rate is reached late: 2000 rad/s are much beside the stretching motion's sqrt(K)
    assert ratios == pytest.approx(4.0, abs=0.2) and differences[-1] < 1e-7


# -- critical speed ---------------------------------------------------------------------------------------------


def first_unstable(unit, model, speeds):
    """The first of some speeds at which an eigenvalue lies right of the axis, by more than rounding."""
    for block in np.array_split(speeds, max(1, len(speeds) // 2000)):
        F = np.stack([scaled(wheel.fixed_frame_matrix(unit, w, model)) for w in block])
        growing = np.linalg.eigvals(F).real.max(axis=1) > 1e-9
        if growing.any():
            return float(block[growing.argmax()])
    return None


@pytest.mark.parametrize("damping", DAMPINGS)
def test_critical_speed_against_a_scan_in_steps_of_a_tenth(damping):
    """Table 1 with zeta_1 = 0.5, every 0.1 rpm from standstill to the loss of stability."""
    unit = TABLE_1.replace(zeta_1=0.5, sidewall_damping=damping)
    first = first_unstable(unit, "inextensional", 0.1 * RPM * np.arange(60_000))
    assert first - 0.1 * RPM <= wheel.critical_speed(unit) <= first


@settings(max_examples=25)
@given(unit=units(), model=models)
@example(unit=TABLE_1.replace(zeta_s=0.0), model="complete")
@example(unit=TABLE_1.replace(zeta_1=0.9, sidewall_damping="reaction"), model="inextensional")
@example(unit=TABLE_1.replace(zeta_1=1e-3), model="inextensional")
@example(unit=STABLE_AGAIN, model="complete")
def test_critical_speed(unit, model):
    """Nothing unstable on 300 speeds below it, unstable 0.1 rpm above."""
    critical = wheel.critical_speed(unit, model)
    if critical is None:
        assert first_unstable(unit, model, np.linspace(0.0, 1e5, 1001)) is None
        return
    assert first_unstable(unit, model, np.linspace(0.0, critical - 0.1 * RPM, 300)) is None
    assert first_unstable(unit, model, np.array([critical + 0.1 * RPM])) is not None
    below, above = (wheel.stability(unit, critical + side * 0.1 * RPM, model) for side in (-1.0, 1.0))
    assert (below.verdict, above.verdict) == ("asymptotically stable", "unstable")


def test_the_lowest_of_several_critical_speeds():
    verdicts = [wheel.stability(STABLE_AGAIN, w, "complete").verdict for w in (500.0, 1000.0, 3000.0, 6000.0)]
    assert verdicts == ["asymptotically stable", "unstable"] * 2
    assert 500.0 < wheel.critical_speed(STABLE_AGAIN, "complete") < 1000.0


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("zeta_s", [0.0, 0.05])
def test_without_sidewall_damping_stability_is_never_lost(model, damping, zeta_s):
    """Nothing circulates: the energy of the springs bounds the motion at every speed."""
    unit = TABLE_1.replace(zeta_1=0.0, zeta_s=zeta_s, sidewall_damping=damping)
    assert wheel.critical_speed(unit, model) is None
    assert first_unstable(unit, model, np.linspace(0.0, 2e4, 401)) is None


@given(unit=units(least_damping=0.05))
@settings(max_examples=15)
def test_more_sidewall_damping_is_less_stable(unit):
    """The shape of the paper's Figure 7, for modal damping."""
    unit = unit.replace(sidewall_damping="modal", zeta_1=0.1, zeta_s=0.05)
    speeds = [wheel.critical_speed(unit.replace(zeta_1=zeta)) for zeta in (0.02, 0.1, 0.5)]
    assume(None not in speeds)
    assert speeds == sorted(speeds, reverse=True)


# -- arguments --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: wheel.state_matrix(TABLE_1, math.nan, 0.0), "speed is nan"),
        (lambda: wheel.state_matrix(TABLE_1, 1.0, math.inf), "time is inf"),
        (lambda: wheel.state_matrix(TABLE_1, 1.0, 0.0, "hybrid"), "model is 'hybrid'"),
        (lambda: wheel.fixed_frame_matrix(TABLE_1, math.inf), "speed is inf"),
        (lambda: wheel.fixed_frame_matrix(TABLE_1, 1.0, "hybrid"), "model is 'hybrid'"),
        (lambda: wheel.stability(TABLE_1, math.nan), "speed is nan"),
        (lambda: wheel.stability(TABLE_1, 1.0, "rigid"), "model is 'rigid'"),
        (lambda: wheel.critical_speed(TABLE_1, "rigid"), "model is 'rigid'"),
        (lambda: wheel.transmissibility(TABLE_1, [1.0, math.nan]), "speed is .*nan"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_wrong_arguments(call, words):
    with pytest.raises(ValueError, match=words):
        call()
