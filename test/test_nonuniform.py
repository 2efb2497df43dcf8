"""A non-uniform sidewall: against energies by quadrature, direct integration, closed forms and published cases."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import linear_sum_assignment
from scipy.special import mathieu_a, mathieu_b
from test_modes import Lagrangian
from test_modes import units as held_units

from tire_dynamics import TireWheelUnit
from tire_dynamics.science import floquet, wheel
from tire_dynamics.science.modes import CONTACT_ANGLE, RingModes
from tire_dynamics.science.nonuniform import (
    Nonuniformity,
    combination_resonances,
    fixed_frame_matrix,
    instability_scale,
    nearest_resonance,
    nearest_tongue,
    stability,
    state_matrix,
    tongue_map,
    tongue_threshold,
)
from tire_dynamics.science.periodic import Trigonometric, transition

TABLE_1 = TireWheelUnit.table_1()
UNDAMPED = TABLE_1.replace(zeta_1=0.0, zeta_s=0.0, zeta_n=0.0)
MARGINAL, UNSTABLE = "marginally stable", "unstable"
UNIFORM = Nonuniformity()
MIXED = Nonuniformity(
    radial=((1, 0.05, 1.0), (2, 0.1, 0.3), (3, 0.03, -0.2)), tangential=((1, 0.02, 0.0), (2, 0.08, 2.0), (4, 0.01, 0.1))
)
both = pytest.mark.parametrize("model", ["inextensional", "complete"])


def second(eps, chi=0.0):
    """What gives n = 1 a stiffness of k_1 (1 +- eps): k_z strongest along chi, where k_theta is weakest."""
    return Nonuniformity(((2, 2.0 * eps, chi),), ((2, 2.0 * eps, chi + 0.5 * math.pi),))


def worst_difference(expected, found):
    """Largest difference between two sets of numbers, paired off in the best way."""
    distance = np.abs(np.asarray(expected)[:, None] - np.asarray(found)[None, :])
    return distance[linear_sum_assignment(distance)].max()


@st.composite
def units(draw):
    """Tires around Table 1, with the wheel held or not."""
    unit = draw(held_units()).replace(contact_half_angle=0.0)
    if draw(st.booleans()):
        return unit
    return unit.replace(
        longitudinal_stiffness=draw(st.floats(1e4, 1e6)),
        longitudinal_damping_ratio=draw(st.floats(0.0, 0.5)),
        longitudinal_mass=draw(st.sampled_from([0.0, 5.0])),
    )


@st.composite
def harmonics(draw):
    numbers = draw(st.lists(st.integers(1, 5), unique=True, max_size=3))
    return tuple((j, draw(st.floats(0.0, 0.3)), draw(st.floats(-7.0, 7.0))) for j in numbers)


nonuniformities = st.builds(Nonuniformity, harmonics(), harmonics())
speeds = st.tuples(st.floats(50.0, 1500.0), st.sampled_from([-1.0, 1.0])).map(lambda pair: pair[0] * pair[1])


# -- what a Nonuniformity may be --


@pytest.mark.parametrize(
    ("radial", "message"),
    [
        (((0, 0.1, 0.0),), r"radial\[0\] has harmonic 0; it must be from 1 to 100"),
        (((101, 0.1, 0.0),), r"radial\[0\] has harmonic 101; it must be from 1 to 100"),
        (((1.5, 0.1, 0.0),), r"radial\[0\] has harmonic 1.5; it must be an integer"),
        (((True, 0.1, 0.0),), r"radial\[0\] has harmonic True; it must be an integer"),
        (((1, 0.1, 0.0), (2, -0.1, 0.0)), r"radial\[1\] has amplitude -0.1; it must be >= 0"),
        (((1, math.nan, 0.0),), r"radial\[0\] has amplitude nan; it must be a finite number"),
        (((1, "0.1", 0.0),), r"radial\[0\] has amplitude '0.1'; it must be a finite number"),
        (((1, 0.1, math.inf),), r"radial\[0\] has angle inf; it must be a finite number"),
        (((1, 0.1),), r"radial\[0\] is \(1, 0.1\); it must be \(harmonic, amplitude, angle\)"),
        ((3,), r"radial is \[3\]; it must have three for each harmonic"),
        (((2, 0.1, 0.0), (2, 0.1, 1.0)), "radial has harmonic 2 twice"),
        (((2, 1.0, 0.5),), r"radial makes the stiffness .* of its mean at .* rad; it must be > 0"),
        (((1, 0.6, 0.0), (3, 0.6, 0.0)), r"radial makes the stiffness -0.2 of its mean at 3.14159 rad"),
    ],
)
def test_what_is_refused(radial, message):
    with pytest.raises(ValueError, match=message):
        Nonuniformity(radial)
    with pytest.raises(ValueError, match=message.replace("radial", "tangential")):
        Nonuniformity(tangential=radial)


@settings(max_examples=30)
@given(st.lists(st.tuples(st.integers(1, 8), st.floats(0.0, 0.9), st.floats(-7.0, 7.0)), max_size=4))
def test_refused_where_the_stiffness_is_negative_anywhere(given_harmonics):
    unique = tuple({j: (j, e, chi) for j, e, chi in given_harmonics}.values())
    theta = np.linspace(0.0, 2.0 * math.pi, 20001)
    lowest = 1.0 + np.min(sum((e * np.cos(j * (theta - chi)) for j, e, chi in unique), np.zeros_like(theta)))
    if abs(lowest) < 1e-4:  # between the points it may be lower by a (j step)^2 e/8
        return
    if lowest > 0.0:
        assert Nonuniformity(unique).radial == unique
    else:
        with pytest.raises(ValueError, match="it must be > 0"):
            Nonuniformity(unique)


def test_epsilon_of_table_1():
    """By hand: (5.80 e_z - 4.03 e_theta)/(2 9.83) for one angle; both add where k_theta is turned by a right angle."""
    one = Nonuniformity(((2, 0.1, 0.7),), ((2, 0.05, 0.7), (1, 0.2, 0.0)))
    assert one.epsilon(TABLE_1) == pytest.approx((5.80 * 0.1 - 4.03 * 0.05) / (2.0 * 9.83), rel=1e-12)
    assert np.angle(one.second_harmonic(TABLE_1)) == pytest.approx(1.4)
    assert second(0.03).epsilon(TABLE_1) == pytest.approx(0.03, rel=1e-12)
    assert one.scaled(0.5).epsilon(TABLE_1) == pytest.approx(0.5 * one.epsilon(TABLE_1))
    assert one.scaled(0.0).is_uniform and UNIFORM.is_uniform and not one.is_uniform


@pytest.mark.parametrize("n_max", [0, 1.5, True])
def test_n_max_is_checked(n_max):
    with pytest.raises(ValueError, match="n_max is .*; it must be an integer >= 1"):
        state_matrix(TABLE_1, MIXED, 100.0, 0.0, n_max=n_max)


# -- equations against the energies --


class Varying(Lagrangian):
    """The energies of test_modes with a sidewall that varies, and with the wind-up in the inextensional model."""

    def __init__(self, unit, nonuniformity, numbers, model):
        super().__init__(unit, numbers, model)
        points = self.E.shape[1] // 2
        assert points > 2 * max(numbers) + 5, "the quadrature is exact up to harmonic 5"
        theta = 2.0 * math.pi * np.arange(points) / points
        more = [
            k * sum((e * np.cos(j * (theta - chi)) for j, e, chi in each), np.zeros(points))
            for k, each in (
                (unit.radial_stiffness, nonuniformity.radial),
                (unit.tangential_stiffness, nonuniformity.tangential),
            )
        ]
        area = 2.0 * math.pi * unit.radius * unit.width / points
        self.more = self._forms(self.E, area * np.concatenate(more))

    def _motions(self):
        if self.model == "complete" or 0 not in self.numbers:
            return super()._motions()
        motions = np.zeros((len(self.place), 2 * len(self.numbers)))
        motions[self.place[0, "xi"], 0] = motions[-1, -1] = 1.0
        for i, n in enumerate(self.numbers[1:]):
            motions[[self.place[n, "alpha"], self.place[n, "eta"]], 2 * i + 1] = 1.0, -1.0 / n
            motions[[self.place[n, "beta"], self.place[n, "xi"]], 2 * i + 2] = 1.0, 1.0 / n
        return motions

    def _kept(self, K):
        if self.model == "complete" or 0 not in self.numbers:
            return super()._kept(K)
        kept = self.motions.T.copy()
        for i, n in enumerate(self.numbers):
            if n > 1:
                alpha, beta, xi, eta = (self.place[n, kind] for kind in ("alpha", "beta", "xi", "eta"))
                ratio = K[alpha, eta] / K[eta, eta]
                kept[2 * i - 1, eta], kept[2 * i, xi] = -ratio, ratio
        return kept

    def matrix(self, speed, phi):
        """Of [q', q]. What varies does its work on the static shapes, which are the sums of equations that are kept."""
        size = 2 * self.motions.shape[1]
        half = size // 2
        columns = [self.slope(z, phi, speed, 0.0, 0.0, 0.0, CONTACT_ANGLE, held=False) for z in np.eye(size)]
        turn = np.array([1.0, math.sin(phi), math.cos(phi)])
        uniform = self.K + speed**2 * (self.K_spin - self.NN) + np.einsum("i,j,ijkl", turn, turn, self.springs)
        kept = self._kept(uniform)
        A = np.array(columns).T
        more = kept @ np.einsum("i,j,ijkl", turn, turn, self.more) @ kept.T
        A[:half, half:] -= np.linalg.solve(kept @ self.M @ self.motions, more)
        return A


@both
@pytest.mark.parametrize("n_max", [1, 2, 4])
@settings(max_examples=12)
@given(unit=held_units(), nonuniformity=nonuniformities, speed=speeds, phi=st.floats(0.0, 7.0))
@example(unit=TABLE_1, nonuniformity=MIXED, speed=-200.0, phi=1.0)
def test_equations_are_those_of_the_energies(model, n_max, unit, nonuniformity, speed, phi):
    numbers = [1] if n_max == 1 else list(range(n_max + 1))
    expected = Varying(unit, nonuniformity, numbers, model).matrix(speed, phi)
    found = state_matrix(unit, nonuniformity, speed, phi / abs(speed), model, n_max)
    if speed < 0.0:
        expected = Varying(unit, nonuniformity, numbers, model).matrix(speed, -phi)
    # rounding of the energies' membrane and hoop terms, n^2 K/a^2 and n^2 Omega^2, which nearly cancel in g_n
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max() * (1.0 + n_max) ** 2)


@both
@settings(max_examples=25)
@given(unit=units(), nonuniformity=nonuniformities, speed=speeds, time=st.floats(0.0, 0.1))
def test_both_frames_belong_together(model, unit, nonuniformity, speed, time):
    """A T = T' + T F, T as of wheel.rotation."""
    A = state_matrix(unit, nonuniformity, speed, time, model)
    F = fixed_frame_matrix(unit, nonuniformity, speed, speed * time, model)
    rigid = unit.is_longitudinally_rigid
    T = wheel.rotation(speed * time, speed, model, rigid)
    step = 1e-3 / abs(speed)  # a symmetric difference of fourth order: sines, whose fifth derivative is below 1
    shifted = [wheel.rotation(speed * (time + k * step), speed, model, rigid) for k in (-2, -1, 1, 2)]
    T_dot = (shifted[0] - 8.0 * shifted[1] + 8.0 * shifted[2] - shifted[3]) / (12.0 * step)
    size = np.abs(T).max() * max(np.abs(A).max(), np.abs(F).max())
    assert np.abs(A @ T - T_dot - T @ F).max() < 1e-10 * size


@settings(max_examples=10)
@given(unit=held_units(), harmonic=st.integers(1, 4), angle=st.floats(0.0, 6.0))
def test_static_stiffness_is_the_complete_models_to_first_order(unit, harmonic, angle):
    """At rest, without tangential displacements, the complete model has the inextensional one's stiffness + O(e^2)."""
    labels = [(n, kind) for n in range(1, 4) for kind in ("alpha", "beta", "xi", "eta")]
    place = {label: 2 + k for k, label in enumerate(labels)}
    radial = [place[n, kind] for n in (2, 3) for kind in ("alpha", "beta")]
    tangential = [place[n, kind] for n in (2, 3) for kind in ("xi", "eta")]
    own = [3, 4, 5, 6]  # xi_0, alpha_1, beta_1, then those
    per_area = math.pi * unit.radius * unit.width * unit.surface_density

    def difference(e):
        nonuniformity = Nonuniformity(((harmonic, e, angle),), ((harmonic, e, angle + 1.0),))
        stiffness = []
        for model in ("complete", "inextensional"):
            A = state_matrix(unit, nonuniformity, 0.0, 0.0, model, 3)
            stiffness.append(-A[: len(A) // 2, len(A) // 2 :])
        K, k = stiffness
        inside = np.linalg.solve(K[np.ix_(tangential, tangential)], K[np.ix_(tangential, radial)])
        condensed = per_area * (K[np.ix_(radial, radial)] - K[np.ix_(radial, tangential)] @ inside)
        C = [K[place[n, "xi"], place[n, "xi"]] for n in (2, 3)] if e == 0.0 else uniform_C
        A_n = [K[place[n, "alpha"], place[n, "eta"]] for n in (2, 3)] if e == 0.0 else uniform_A
        mass = per_area * np.repeat([(a + n * c) / (n * c) for n, a, c in zip((2, 3), A_n, C, strict=True)], 2)
        return np.abs(condensed - mass[:, None] * k[np.ix_(own, own)]).max() / np.abs(condensed).max(), C, A_n

    error, uniform_C, uniform_A = difference(0.0)
    assert error < 1e-11
    coarse, fine = difference(0.2)[0], difference(0.02)[0]
    assert fine < coarse / 80.0 + 1e-11 and coarse < 0.1  # a hundredth


# -- uniform limit --


@both
@settings(max_examples=15)
@given(unit=units(), speed=speeds, time=st.floats(0.0, 1.0))
def test_without_amplitudes_the_bits_are_the_uniform_units(model, unit, speed, time):
    for none in (UNIFORM, Nonuniformity(((2, 0.0, 1.0),), ((2, 0.0, 0.0),)), Nonuniformity(((3, 0.1, 1.0),))):
        assert np.array_equal(
            state_matrix(unit, none, speed, time, model), wheel.state_matrix(unit, speed, time, model)
        )
        assert np.array_equal(
            fixed_frame_matrix(unit, none, speed, 1.0, model), wheel.fixed_frame_matrix(unit, speed, model)
        )
        found, expected = stability(unit, none, speed, model), wheel.stability(unit, speed, model)
        assert found.multipliers.tobytes() == expected.multipliers.tobytes()
        assert (found.verdict, found.error_estimate) == (expected.verdict, expected.error_estimate)


@both
def test_uniform_modes_beside_the_wheel(model):
    """Multipliers are those of the wheel with n = 1, and of each other mode with the wheel held."""
    speed, n_max = 180.0, 4
    period = 2.0 * math.pi / speed
    expected = [*wheel.stability(TABLE_1, speed, model).multipliers]
    for n in range(2, n_max + 1):
        each = np.exp(RingModes(TABLE_1, [n], model).at(speed).exponents[0] * period)
        expected += [*each, *each.conj()]
    if model == "complete":
        expected += [*np.exp(RingModes(TABLE_1, [0], model).at(speed).exponents[0] * period)]
    else:  # the wind-up: sqrt((k_theta + p_0/a)/(rho h)) and zeta_n
        omega = math.sqrt((4.03e6 + 2.07e5 / 0.305) / (1.59e3 * 0.0127))
        root = omega * complex(-0.02, math.sqrt(1.0 - 0.02**2))
        expected += [np.exp(root * period), np.exp(root.conjugate() * period)]
    result = stability(TABLE_1, UNIFORM, speed, model, n_max)
    # n = 0 and its four exponents stand for two real coordinates
    assert worst_difference(expected, result.multipliers) < 1e-11


@both
@pytest.mark.parametrize("n_max", [1, 2])
def test_the_uniform_limit_is_continuous(model, n_max):
    """Away from tongues the first order in the amplitudes cancels over a turn: a tenth leaves a hundredth."""
    expected = stability(TABLE_1, UNIFORM, 220.0, model, n_max).multipliers
    errors = [
        worst_difference(expected, stability(TABLE_1, MIXED.scaled(e), 220.0, model, n_max).multipliers)
        for e in (1e-1, 1e-2, 1e-3, 1e-9)
    ]
    assert 1e-6 < errors[0] < 1e-2
    assert errors[1] < errors[0] / 80.0 and errors[2] < errors[1] / 80.0 and errors[3] < 1e-11


@pytest.mark.parametrize("n_max", [1, 2])
def test_the_complete_model_tends_to_the_inextensional_one(n_max):
    """As the belt gets stiffer: differences fall like 1/K."""

    def difference(factor):
        unit = TABLE_1.replace(membrane_stiffness=factor * TABLE_1.membrane_stiffness)
        inextensional = stability(unit, MIXED, 250.0, "inextensional", n_max).multipliers
        complete = stability(unit, MIXED, 250.0, "complete", n_max).multipliers
        return np.abs(inextensional[:, None] - complete[None, :]).min(axis=1).max()

    coarse, fine = difference(10.0), difference(100.0)
    assert fine < coarse / 7.0 and fine < 0.05


# -- multipliers against direct integration --


def integrated(A, period, n, omega=600.0):
    """Multipliers by DOP853 at its tightest, displacements times omega beside velocities."""
    scale = np.repeat([1.0, omega], n // 2)
    factors = scale[:, None] / scale

    def rate(t, z):
        return ((A(t) * factors) @ z.reshape(n, n)).ravel()

    end = solve_ivp(rate, (0.0, period), np.eye(n).ravel(), method="DOP853", rtol=3e-14, atol=1e-15).y[:, -1]
    return np.linalg.eigvals(end.reshape(n, n))


# some ten to a hundred steps whose errors are 1e-14 each
DIRECT = 1e-12


@pytest.mark.slow
@both
@pytest.mark.parametrize("unit", [TABLE_1, UNDAMPED], ids=["damped", "undamped"])
@pytest.mark.parametrize("speed", [150.0, -271.4, 493.4, 640.0, 1500.0])
def test_multipliers_against_direct_integration(model, unit, speed):
    period = 2.0 * math.pi / abs(speed)
    for eps in (0.01, 0.1, 0.4) if model == "inextensional" else (0.1,):
        nonuniformity = second(eps, 0.4)
        result = stability(unit, nonuniformity, speed, model)
        n = result.multipliers.size
        expected = integrated(lambda t: state_matrix(unit, nonuniformity, speed, t, model), period, n)  # noqa: B023
        assert worst_difference(expected, result.multipliers) < DIRECT * max(1.0, result.spectral_radius)


@pytest.mark.slow
@both
@pytest.mark.parametrize("unit", [TABLE_1, UNDAMPED.replace(longitudinal_stiffness=2e5)], ids=["damped", "undamped"])
def test_coupled_modes_against_direct_integration(model, unit):
    speed, n_max = 640.0, 2 if model == "complete" else 3
    result = stability(unit, MIXED, speed, model, n_max)
    n = result.multipliers.size
    expected = integrated(lambda t: state_matrix(unit, MIXED, speed, t, model, n_max), 2.0 * math.pi / speed, n)
    assert worst_difference(expected, result.multipliers) < DIRECT


@pytest.mark.slow
@both
@settings(max_examples=8, deadline=None)
@given(unit=units(), nonuniformity=nonuniformities, speed=speeds.filter(lambda w: abs(w) > 300.0))
@example(unit=UNDAMPED, nonuniformity=second(0.1), speed=493.357)
def test_the_fast_path_is_floquet_analyze(model, unit, nonuniformity, speed):
    check_fast_path(unit, nonuniformity, speed, model, 1)


@pytest.mark.parametrize(("model", "n_max", "speed"), [("inextensional", 3, -1200.0), ("complete", 2, 1500.0)])
def test_the_fast_path_of_coupled_modes_is_floquet_analyze(model, n_max, speed):
    check_fast_path(UNDAMPED, MIXED, speed, model, n_max)


def check_fast_path(unit, nonuniformity, speed, model, n_max):
    result = stability(unit, nonuniformity, speed, model, n_max)
    other = floquet.analyze(
        lambda t: state_matrix(unit, nonuniformity, speed, t, model, n_max), 2.0 * math.pi / abs(speed)
    )
    assert worst_difference(other.multipliers, result.multipliers) <= result.error_estimate + other.error_estimate
    np.testing.assert_allclose(np.exp(result.exponents * result.period), result.multipliers, rtol=1e-9)
    assert result.period == other.period


# -- invariants --


@both
@settings(max_examples=15)
@given(unit=units(), nonuniformity=nonuniformities, speed=speeds, n_max=st.integers(1, 2))
def test_multipliers_without_damping_are_reciprocal(model, unit, nonuniformity, speed, n_max):
    """The flow of a Hamiltonian system is symplectic: with mu also 1/mu and the conjugates."""
    unit = unit.replace(zeta_1=0.0, zeta_s=0.0, zeta_n=0.0, longitudinal_damping_ratio=0.0)
    result = stability(unit, nonuniformity, speed, model, n_max)
    mu = result.multipliers
    room = 2.0 * result.error_estimate / np.abs(mu).min() ** 2
    assert worst_difference(mu, 1.0 / mu) <= room and worst_difference(mu, mu.conj()) <= room
    assert result.verdict in (MARGINAL, UNSTABLE)


@both
@settings(max_examples=15)
@given(unit=units(), nonuniformity=nonuniformities, speed=speeds, n_max=st.integers(1, 2))
def test_product_of_multipliers_is_exp_of_the_trace(model, unit, nonuniformity, speed, n_max):
    """Liouville: the trace of A is that of the dampings and does not vary."""
    result = stability(unit, nonuniformity, speed, model, n_max)
    trace = np.trace(state_matrix(unit, nonuniformity, speed, 0.01, model, n_max))
    logarithm = np.log(np.abs(result.multipliers)).sum()
    room = (result.error_estimate / np.abs(result.multipliers)).sum()
    assert abs(logarithm - trace * result.period) <= 2.0 * room + 1e-9 * abs(trace * result.period)


@settings(max_examples=10)
@given(
    unit=held_units(), nonuniformity=nonuniformities, speed=speeds, n_max=st.integers(1, 2), turn=st.floats(-3.0, 3.0)
)
def test_where_the_angles_begin_does_not_matter(unit, nonuniformity, speed, n_max, turn):
    """Angles counted from elsewhere on the ring begin the turn elsewhere; backward is the mirror image of forward."""
    turned, mirrored = (
        Nonuniformity(*(tuple((j, e, move(chi)) for j, e, chi in each) for each in (nu.radial, nu.tangential)))
        for nu, move in ((nonuniformity, lambda chi: chi + turn), (nonuniformity, lambda chi: math.pi - chi))
    )
    here = stability(unit, nonuniformity, speed, n_max=n_max)
    for other in (stability(unit, turned, speed, n_max=n_max), stability(unit, mirrored, -speed, n_max=n_max)):
        room = here.error_estimate + other.error_estimate
        assert worst_difference(here.multipliers, other.multipliers) <= room


def test_standstill_has_no_period():
    result = stability(TABLE_1, MIXED, 0.0)
    assert result.period is None and result.verdict == "asymptotically stable"
    assert stability(UNDAMPED, MIXED, 0.0, n_max=3).verdict == MARGINAL


def test_a_turn_that_is_too_long_is_refused():
    with pytest.raises(ArithmeticError, match=r"\|A\| T is .*; up to .* can be integrated"):
        stability(TABLE_1, MIXED, 1e-3)
    slow = stability(TABLE_1, MIXED, 1.0)  # in a turn of 6 s all dies down
    assert slow.verdict == "asymptotically stable" and slow.spectral_radius < 1e-5


# -- the propagator against closed forms --


def unbalanced(found):
    """Transition matrices in the system's own units."""
    return found.matrix / found.factors * np.exp(found.log_norm)[:, None, None]


@settings(max_examples=40)
@given(a=st.floats(-5.0, 60.0), q=st.floats(0.1, 40.0), switch=st.floats(0.1, 3.0))
def test_meissners_equation(a, q, switch):
    """x'' + (a +- q) x = 0 over pi (E. Meissner, Schweiz. Bauzeitung 72, 1918).

    tr = 2 c_1 c_2 - (w_1^2 + w_2^2) s_1 s_2 with c_i = cos w_i t_i and s_i = sin(w_i t_i)/w_i, w^2 = a +- q.
    """
    lengths = (switch, math.pi - switch)
    matrices, c, s = [], [], []
    for square, length in zip((a + q, a - q), lengths, strict=True):
        w = np.sqrt(complex(square))
        c.append(np.cos(w * length).real)
        s.append((np.sin(w * length) / w).real if abs(w) > 1e-6 else length)
        A = np.array([[0.0, -square], [1.0, 0.0]])
        found = transition(Trigonometric(A, (), np.zeros((0, 2, 2)), np.zeros((0, 2, 2))), 1.0, 0.0, length)
        matrices.append(unbalanced(found)[0])
        closed = np.array([[c[-1], -square * s[-1]], [s[-1], c[-1]]])
        error = np.linalg.norm((matrices[-1] - closed) * found.factors, 2)
        assert error <= 2.0 * found.error[0] * np.exp(found.log_norm[0])  # the closed form rounds too
        assert found.error[0] < 1e-11
    trace = 2.0 * c[0] * c[1] - 2.0 * a * s[0] * s[1]
    size = np.prod([np.linalg.norm(each) for each in matrices])
    assert np.trace(matrices[1] @ matrices[0]) == pytest.approx(trace, abs=1e-12 * size)


# what is grown and lost again within the period, exp(4 sqrt(q)) or so each, loses digits
@pytest.mark.parametrize(("q", "lost"), [(0.1, 1e-11), (1.0, 1e-11), (5.0, 1e-8), (25.0, 1e-4)])
def test_mathieus_equation(q, lost):
    """x'' + (a - 2 q cos 2t) x = 0 has the trace +-2 over pi at a_m(q), b_m(q) (Abramowitz & Stegun 20.2, 20.3)."""
    values = [(m, mathieu_a(m, q)) for m in range(6)] + [(m, mathieu_b(m, q)) for m in range(1, 6)]
    constant = np.array([[[0.0, -a], [1.0, 0.0]] for _, a in values])  # a batch
    cosine = np.zeros((1, len(values), 2, 2))
    cosine[:, :, 0, 1] = 2.0 * q
    found = transition(Trigonometric(constant, (2,), cosine, 0.0 * cosine), 1.0, 0.0, math.pi)
    traces = np.trace(unbalanced(found), axis1=1, axis2=2)
    expected = [2.0 * (-1.0) ** m for m, _ in values]
    # the last digits of a count as those of A do
    assert (np.abs(traces - expected) <= 2.0 * found.error * np.exp(found.log_norm)).all()
    assert found.error.max() < lost
    determinants = np.linalg.det(found.matrix) * np.exp(2.0 * found.log_norm)
    assert (np.abs(determinants - 1.0) < 4.0 * found.error * np.exp(2.0 * found.log_norm)).all()


def test_the_propagators_error_is_a_bound():
    """A(t) = A cos t + B: against the same in many short pieces, where rounding is all that is left."""
    rng = np.random.default_rng(5)
    system = Trigonometric(rng.normal(size=(4, 4)), (1, 3), *rng.normal(size=(2, 2, 4, 4)))
    found = transition(system, -2.0, 0.5, -1.5)
    pieces = np.linspace(0.5, -1.5, 101)
    product, rule = np.eye(4), np.eye(4)
    for start, stop in zip(pieces, pieces[1:], strict=False):
        product = unbalanced(transition(system, -2.0, start, stop))[0] @ product
        rule = expm(system.at(0.5 * (start + stop)) * (stop - start) / -2.0) @ rule
    scaled = product * found.factors / np.exp(found.log_norm[0])
    error = np.linalg.norm(scaled - found.matrix[0], 2)
    assert error <= 2.0 * found.error[0] < 1e-9
    assert np.abs(product - rule).max() < 1e-3 * np.abs(product).max()  # the midpoint rule, of second order in 1/100


# -- unsymmetric shafts --


def shaft_rate(kappa, eps, speed):
    """The largest growth of a shaft with unequal stiffness in rigid bearings.

    (s^2 + kappa (1 + eps) - W^2)(s^2 + kappa (1 - eps) - W^2) + 4 W^2 s^2 = 0, a quadratic in s^2: unstable just where
    sqrt(kappa (1 - eps)) < W < sqrt(kappa (1 + eps)) (D. M. Smith, Proc. R. Soc. A 142, 1933, 92-118).
    """
    b, c = 2.0 * kappa + 2.0 * speed**2, (kappa - speed**2) ** 2 - (kappa * eps) ** 2
    square = -0.5 * b + math.sqrt(0.25 * b * b - c)
    return math.sqrt(max(square, 0.0))


@pytest.mark.parametrize("eps", [0.01, 0.1, 0.4])
def test_unsymmetric_shaft_in_rigid_bearings(eps):
    """The ring is the rotor, the sidewall the shaft; the wheel a bearing so heavy that it does not move.

    With 10^8 times the ring's mass it moves by 10^-8 of the ring, and so little do the boundaries.
    """
    m, k = TABLE_1.ring_mass, TABLE_1.sidewall_stiffness
    unit = UNDAMPED.replace(wheel_mass=1e8 * m, suspension_stiffness=3e8 * k)
    low, high = (math.sqrt(k / m * (1.0 + sign * eps)) for sign in (-1.0, 1.0))
    for speed, verdict in (
        (low * (1.0 - 1e-6), MARGINAL),
        (low * (1.0 + 1e-6), UNSTABLE),
        (0.5 * (low + high), UNSTABLE),
        (high * (1.0 - 1e-6), UNSTABLE),
        (high * (1.0 + 1e-6), MARGINAL),
    ):
        result = stability(unit, second(eps, 1.0), speed)
        assert result.verdict == verdict
        if verdict == UNSTABLE:
            assert result.exponents.real.max() == pytest.approx(shaft_rate(k / m, eps, speed), rel=1e-2, abs=1e-5)
    middle = stability(unit, second(eps), 0.5 * (low + high)).exponents.real.max()
    assert middle == pytest.approx(shaft_rate(k / m, eps, 0.5 * (low + high)), rel=1e-6)


def round_support(unit, eps, chi, speed):
    """Exponents of shaft and bearing in axes that turn: with a support that has no direction all is constant there.

    Complex r, w of ring and wheel, D = d/dt + i W: m (D^2 + d (D - i W)) r + f = 0, M D^2 w + c_s D w + k_s w - f = 0,
    f = k_1 (r - w + eps exp(2 i chi) conj(r - w)), over r, w and their conjugates.
    """
    m, M, k_1, k_s = unit.ring_mass, unit.wheel_mass, unit.sidewall_stiffness, unit.suspension_stiffness
    d, c_s, W = 2.0 * unit.zeta_1 * unit.rigid_mode_frequency, unit.suspension_damping, speed
    turn = k_1 * eps * np.exp(2j * chi)
    stiffness = np.array(
        [
            [k_1 - m * W**2, -k_1, turn, -turn],
            [-k_1, k_1 + k_s - M * W**2 + 1j * W * c_s, -turn, turn],
        ]
    )
    damping = np.array([[m * d + 2j * m * W, 0.0, 0.0, 0.0], [0.0, c_s + 2j * M * W, 0.0, 0.0]])
    swap = [2, 3, 0, 1]
    K, G = (np.concatenate([S, S[:, swap].conj()]) for S in (stiffness, damping))
    mass = np.array([m, M, m, M])[:, None]
    A = np.block([[-G / mass, -K / mass], [np.eye(4), np.zeros((4, 4))]])
    return np.linalg.eigvals(A)


@pytest.mark.parametrize("zeta", [0.0, 0.03])
@pytest.mark.parametrize("eps", [0.02, 0.3])
def test_unsymmetric_shaft_on_a_round_support(eps, zeta):
    unit = TABLE_1.replace(
        zeta_1=zeta, zeta_s=zeta, longitudinal_stiffness=TABLE_1.suspension_stiffness, longitudinal_damping_ratio=zeta
    )
    for speed in (30.0, 49.0, 300.0, -344.0, 600.0, 640.0, 900.0):
        result = stability(unit, second(eps, 0.2), speed)
        expected = np.exp(round_support(unit, eps, 0.2, speed) * result.period)
        # eigenvalues of either matrix to 1e-13; close to a boundary two of them meet, hence the root's room
        assert worst_difference(expected, result.multipliers) < 1e-9 * max(1.0, result.spectral_radius)


@pytest.mark.parametrize("eps", [0.02, 0.2])
def test_boundaries_of_an_unsymmetric_shaft_on_a_round_support(eps):
    """Unstable between the critical speeds of the stiff and of the soft side, of either mode.

    Critical is where a motion rests in the axes that turn: (k - m W^2)(k + k_s - M W^2) = k^2 with k = k_1 (1 +- eps).
    """
    unit = UNDAMPED.replace(longitudinal_stiffness=TABLE_1.suspension_stiffness)
    m, M, k_s = unit.ring_mass, unit.wheel_mass, unit.suspension_stiffness

    def critical(k):
        return np.sqrt(np.sort(np.roots([m * M, -(m * (k + k_s) + M * k), k * k_s]).real))

    soft, stiff = (critical(unit.sidewall_stiffness * (1.0 + sign * eps)) for sign in (-1.0, 1.0))
    for low, high in zip(soft, stiff, strict=True):
        edge = 0.01 * (high - low)  # the boundary is known better than that, but the growth begins as a root
        verdicts = [
            stability(unit, second(eps), speed).verdict for speed in (low - edge, low + edge, high - edge, high + edge)
        ]
        assert verdicts == [MARGINAL, UNSTABLE, UNSTABLE, MARGINAL]


# -- tongues --


def whirls(unit):
    """Frequencies [rad/s] and net deflections of the sidewall over sqrt(mass), by hand: X alone; Y and y in a row."""
    m, M, k_1, k_s = unit.ring_mass, unit.wheel_mass, unit.sidewall_stiffness, unit.suspension_stiffness
    squares = np.sort(np.roots([m * M, -(m * (k_1 + k_s) + M * k_1), k_1 * k_s]).real)
    found = [(math.sqrt(k_1 / m), 1.0 / math.sqrt(m))]
    for square in squares:
        Y, y = 1.0, 1.0 - m * square / k_1
        found.append((math.sqrt(square), abs(Y - y) / math.sqrt(m * Y * Y + M * y * y)))
    return sorted(found)


def test_tips_of_table_1_by_hand():
    """Sums of 49.4507, 493.3570 and 638.8410 rad/s are 2 Omega; growth eps k_1 r_i r_j/4 sqrt(omega_i omega_j).

    The stiffness eps k_1 [[cos, sin], [sin, -cos]](2 phi) couples motions with net deflections (X, Y) by
    (X_i - i Y_i)(X_j - i Y_j), which is zero for none of the three: all six sums open.
    """
    eps = 0.01
    motions = whirls(TABLE_1)
    assert [round(w, 4) for w, _ in motions] == [49.4507, 493.357, 638.841]
    k_1 = TABLE_1.sidewall_stiffness
    expected = sorted(
        (0.5 * (w + v), w, v, eps * k_1 * r * s / (4.0 * math.sqrt(w * v)))
        for i, (w, r) in enumerate(motions)
        for v, s in motions[i:]
    )
    assert [round(tip[0] * 30.0 / math.pi) for tip in expected] == [472, 2592, 3286, 4711, 5406, 6100]
    found = combination_resonances(TABLE_1, second(eps, 0.9))
    assert len(found) == 6
    for tip, (speed, low, high, growth) in zip(found, expected, strict=True):
        assert (tip.speed, *tip.frequencies) == pytest.approx((speed, low, high), rel=1e-10)
        assert tip.growth == pytest.approx(growth, rel=1e-7)


def edges(nonuniformity, tip, unit=UNDAMPED, model="inextensional"):
    """Where the instability around a tip begins and ends, by bisection."""
    found = []
    for sign in (-1.0, 1.0):
        inside, outside = tip.speed, tip.speed + 3.0 * sign * tip.growth
        for _ in range(30):
            middle = 0.5 * (inside + outside)
            if stability(unit, nonuniformity, middle, model).verdict == UNSTABLE:
                inside = middle
            else:
                outside = middle
        found.append(inside)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("which", range(6))
def test_tongues_begin_at_the_tips(which):
    """Growth and width are as predicted but for the next order: a tenth of eps leaves a tenth of the relative error."""
    errors = []
    for eps in (1e-2, 1e-3):
        tip = combination_resonances(UNDAMPED, second(eps))[which]
        growth = stability(UNDAMPED, second(eps), tip.speed).exponents.real.max()
        low, high = edges(second(eps), tip)
        errors.append(
            [growth / tip.growth - 1.0, (tip.speed - low) / tip.growth - 1.0, (high - tip.speed) / tip.growth - 1.0]
        )
    assert np.abs(errors[0]).max() < 0.25
    assert (np.abs(errors[1]) < 0.15 * np.abs(errors[0]) + 1e-3).all()  # 1e-3: bisection, and verdicts' own error


def test_differences_open_nothing():
    w = [frequency for frequency, _ in whirls(TABLE_1)]
    for speed in (0.5 * (w[1] - w[0]), 0.5 * (w[2] - w[0]), 0.5 * (w[2] - w[1])):
        for shift in np.linspace(-0.3, 0.3, 13):
            assert stability(UNDAMPED, second(0.05), speed + shift).verdict == MARGINAL


@pytest.mark.slow
@both
def test_damping_lifts_the_tips(model):
    """The threshold is that of the map but for the next order, which a quarter of the damping leaves a quarter of."""
    ratios = []
    for zeta in (0.004, 0.001):
        unit = UNDAMPED.replace(zeta_1=zeta, zeta_s=2.0 * zeta)
        tips = [tip for tip in combination_resonances(unit, second(0.01), model) if tip.growth > 1.0]
        for tip in tips:
            low, high = 0.0, 2.0 * tip.threshold
            for _ in range(20):
                middle = 0.5 * (low + high)
                unstable = stability(unit, second(0.01 * middle), tip.speed, model).verdict == UNSTABLE
                low, high = (low, middle) if unstable else (middle, high)
            ratios.append(low / tip.threshold - 1.0)
    coarse, fine = np.abs(np.array(ratios).reshape(2, -1))
    assert coarse.size >= 3 and (coarse < 0.02).all() and (fine < 0.3 * coarse + 1e-5).all()


def rpm(speed):
    return speed * 30.0 / math.pi


def bisected(unit, speed, model, low, high, steps=20):
    """The eps at which the verdict turns at a speed, by bisection with nothing else."""
    for _ in range(steps):
        middle = 0.5 * (low + high)
        unstable = stability(unit, second(middle), speed, model).verdict == UNSTABLE
        low, high = (low, middle) if unstable else (middle, high)
    return high


def test_the_size_at_a_speed_is_bisected():
    unit = TABLE_1.replace(zeta_1=0.05, zeta_s=0.05)
    for speed in (638.0, -520.0):
        eps = 0.01 * instability_scale(unit, second(0.01), speed)
        assert eps == pytest.approx(bisected(unit, speed, "inextensional", 0.0, 0.45), abs=2e-6)
        verdicts = [stability(unit, second(each), speed).verdict for each in (eps - 2e-6, eps + 2e-6)]
        assert verdicts == ["asymptotically stable", UNSTABLE]
    assert instability_scale(unit, second(0.01), 150.0) is None
    assert instability_scale(unit, second(0.01), 3000.0) == 0.0  # beyond the critical speed
    for bad, message in [((second(0.01), 0.0), "speed is 0.0; it must be finite and not zero"),
                         ((Nonuniformity(), 100.0), "every amplitude"),
                         ((second(0.01), 100.0, "inextensional", 0.0), "tolerance is 0.0; it must")]:  # fmt: skip
        with pytest.raises(ValueError, match=message):
            instability_scale(unit, *bad)


THRESHOLDS = {
    # zeta_1 = zeta_s: (speed of the resonance [rpm], eps to first order, eps bisected) of docs/model.md
    ("inextensional", 0.02): [
        (472, 98.9, None), (2592, 2.81, None), (3286, 2.02, None),
        (4711, 0.080, 0.0772), (5406, 0.0573, 0.0573), (6100, 0.0411, 0.0402),
    ],
    ("inextensional", 0.05): [
        (472, 247.0, None), (2592, 7.03, None), (3286, 5.04, None),
        (4711, 0.200, 0.1675), (5406, 0.143, 0.1435), (6100, 0.103, 0.0899),
    ],
    ("complete", 0.02): [
        (472, 98.7, None), (2586, 2.83, None), (3277, 2.00, None), (4161, 37.4, None), (4697, 0.0822, 0.0791),
        (5374, 0.0573, 0.0573), (5660, 0.250, None), (6004, 0.0426, 0.0413), (6159, 0.0913, 0.0858),
        (6288, 0.128, 0.1036),
    ],
    ("complete", 0.05): [
        (472, 247.0, None), (2586, 7.07, None), (3277, 5.01, None), (4161, 93.5, None), (4697, 0.205, 0.1708),
        (5374, 0.143, 0.1431), (5660, 0.624, None), (6004, 0.1065, 0.0898), (6159, 0.228, 0.1799),
        (6288, 0.319, 0.1783),
    ],
}  # fmt: skip


def test_ten_tongues_of_the_complete_model():
    """Its upper n = 1 whirls fall with the speed, from 231 to 110 Hz at 5660 rpm, and meet the lower ones."""
    found = combination_resonances(TABLE_1, second(0.01), "complete")
    assert [round(rpm(tip.speed)) for tip in found] == [each[0] for each in THRESHOLDS["complete", 0.05]]
    upper = next(tip for tip in found if round(rpm(tip.speed)) == 5660).frequencies[1]
    undamped = TABLE_1.replace(zeta_1=0.0, zeta_s=0.0)
    at_rest, at_5660, at_6159 = (
        np.sort(np.abs(np.linalg.eigvals(wheel.fixed_frame_matrix(undamped, speed, "complete")).imag))[::2]
        for speed in (0.0, 5660.3 * math.pi / 30.0, 6158.7 * math.pi / 30.0)
    )
    # section 9 of docs/model.md: hop, fore-aft, vertical, then the two upper whirls
    assert at_rest[1:3] == pytest.approx([492.3, 637.4], abs=0.05)
    assert at_5660[1] == pytest.approx(491.6, abs=0.05) and at_6159[2] == pytest.approx(625.9, abs=0.05)
    assert at_rest[3:] / (2.0 * math.pi) == pytest.approx([231.0, 231.0], abs=0.5)
    assert at_5660[3:] / (2.0 * math.pi) == pytest.approx([110.0, 487.0], abs=0.5)
    assert at_5660[3] == pytest.approx(upper, rel=1e-5)


@pytest.mark.parametrize(
    ("model", "zeta"),
    [
        pytest.param(*case, marks=pytest.mark.slow if case[0] == "inextensional" else pytest.mark.nightly)
        for case in THRESHOLDS
    ],
)
def test_thresholds_of_the_tongues_of_table_1(model, zeta):
    """The tables of docs/model.md: ten tongues of the complete model below 6300 rpm, six of the inextensional one.

    The bisected threshold is the lowest point: stable 0.1 % below it at every speed nearby, unstable 0.1 % above it.
    """
    unit = TABLE_1.replace(zeta_1=zeta, zeta_s=zeta)
    found = combination_resonances(unit, second(0.01), model)
    assert [round(rpm(tip.speed)) for tip in found] == [each[0] for each in THRESHOLDS[model, zeta]]
    for tip, (_, first_order, least) in zip(found, THRESHOLDS[model, zeta], strict=True):
        assert 0.01 * tip.threshold == pytest.approx(first_order, rel=5e-3)
        threshold = tongue_threshold(unit, second(0.01), tip, model)
        if least is None:
            assert threshold is None
            continue
        eps, at = 0.01 * threshold.scale, threshold.speed
        assert eps == pytest.approx(least, abs=6e-5)  # the last digit of the table
        assert stability(unit, second(1.001 * eps), at, model).verdict == UNSTABLE
        for shift in (-0.001, -0.0005, 0.0, 0.0005, 0.001):
            assert stability(unit, second(0.999 * eps), (1.0 + shift) * at, model).verdict != UNSTABLE


def test_the_first_order_is_no_bound():
    """At zeta = 0.05 the first tongue opens at eps 0.090 and the next but one at 0.167, not at 0.103 and 0.200."""
    unit = TABLE_1.replace(zeta_1=0.05, zeta_s=0.05)
    tips = {round(rpm(tip.speed)): tip for tip in combination_resonances(unit, second(0.01))}
    for at, below, least, first_order in ((6074.7, 0.0895, 0.0900, 0.103), (4687.3, 0.167, 0.168, 0.200)):
        tip = tips[6100 if at > 6000 else 4711]
        assert 0.01 * tip.threshold == pytest.approx(first_order, abs=5e-4)
        speeds = np.linspace(0.985, 1.015, 31) * tip.speed
        assert not any(stability(unit, second(below), speed).verdict == UNSTABLE for speed in speeds)
        assert stability(unit, second(least), at * math.pi / 30.0).verdict == UNSTABLE


@pytest.mark.slow
def test_a_threshold_tends_to_the_first_order_and_needs_damping():
    tip = combination_resonances(UNDAMPED, second(0.01))[-1]
    assert tongue_threshold(UNDAMPED, second(0.01), tip) == (tip.speed, 0.0)
    ratios = []
    for zeta in (0.02, 0.01):
        unit = UNDAMPED.replace(zeta_1=zeta, zeta_s=zeta)
        tip = combination_resonances(unit, second(0.01))[-1]
        ratios.append(tongue_threshold(unit, second(0.01), tip).scale / tip.threshold - 1.0)
    assert abs(ratios[1]) < 0.3 * abs(ratios[0])  # the next order is the second


@both
def test_tips_on_a_round_support(model):
    """Without a direction only forward whirls meet the turning stiffness, and each tip is there once."""
    unit = UNDAMPED.replace(longitudinal_stiffness=TABLE_1.suspension_stiffness)
    tips = combination_resonances(unit, second(0.01), model)
    if model == "inextensional":
        low, high = (whirls(TABLE_1)[k][0] for k in (0, 2))
        assert [tip.speed for tip in tips] == pytest.approx([low, 0.5 * (low + high), high], rel=1e-7)
    for tip in tips:
        growth = stability(unit, second(0.01), tip.speed, model).exponents.real.max()
        assert growth == pytest.approx(tip.growth, rel=0.05)


@pytest.mark.slow
def test_an_unround_support_splits_the_region_in_three():
    """H. Ota and K. Mizutani (Mem. Fac. Eng. Nagoya Univ. 34, 1983): here at both frequencies and between them."""
    _, high = (whirls(TABLE_1)[k][0] for k in (0, 2))
    stiffer = TABLE_1.replace(suspension_stiffness=2.0 * TABLE_1.suspension_stiffness)
    other = whirls(stiffer)[2][0]  # fore and aft is as vertical, of a stiffer suspension
    unit = UNDAMPED.replace(longitudinal_stiffness=stiffer.suspension_stiffness)
    tips = [tip for tip in combination_resonances(unit, second(1e-3)) if tip.growth > 0.1]
    assert [tip.speed for tip in tips] == pytest.approx([high, 0.5 * (high + other), other], rel=1e-9)
    for tip in tips:
        low, top = edges(second(1e-3), tip, unit)
        assert top - low == pytest.approx(2.0 * tip.growth, rel=0.05)
        assert stability(unit, second(1e-3), tip.speed + 2.0 * tip.growth).verdict == MARGINAL


def test_tips_of_the_complete_model_are_tongues():
    for tip in combination_resonances(UNDAMPED, second(0.001), "complete"):
        growth = stability(UNDAMPED, second(0.001), tip.speed, "complete").exponents.real.max()
        assert growth == pytest.approx(tip.growth, rel=0.05)


def test_nearest_tongue():
    near = second(0.01)
    assert nearest_tongue(TABLE_1, near, 500.0) == pytest.approx(493.3570498)
    assert nearest_tongue(TABLE_1, near, -300.0) == pytest.approx(-271.4038799)
    assert nearest_tongue(TABLE_1, near, 0.0) == pytest.approx(49.4507099)
    assert nearest_tongue(TABLE_1, Nonuniformity(((1, 0.1, 0.0),)), 500.0) is None
    # k_z and k_theta that vary together in proportion cancel for a ring that cannot stretch, to rounding
    balanced = Nonuniformity(((2, 0.0403, 0.0),), ((2, 0.0580, 0.0),))
    assert balanced.epsilon(TABLE_1) < 1e-15
    assert nearest_tongue(TABLE_1, balanced, 500.0, "complete") is not None
    assert nearest_resonance(TABLE_1, near, -300.0) == combination_resonances(TABLE_1, near)[1]
    with pytest.raises(ValueError, match="speed is nan; it must be finite"):
        nearest_tongue(TABLE_1, near, math.nan)


@pytest.mark.parametrize(("model", "n_max"), [("inextensional", 1), ("complete", 1), ("inextensional", 2)])
def test_map_is_stability_point_by_point(model, n_max):
    unit = UNDAMPED.replace(zeta_1=0.002, zeta_s=0.01, zeta_n=0.01)
    grid = tongue_map(unit, MIXED, [-300.0, 493.0, 640.0], [0.0, 0.5, 2.0], model, n_max)
    assert len(np.unique(grid.verdict)) == 2
    for i, scale in enumerate(grid.scales):
        for k, speed in enumerate(grid.speeds):
            point = stability(unit, MIXED.scaled(scale), speed, model, n_max)
            assert floquet.VERDICTS[grid.verdict[i, k]] == point.verdict
            assert grid.spectral_radius[i, k] == pytest.approx(point.spectral_radius, abs=1e-9)
            assert grid.growth[i, k] == pytest.approx(point.exponents.real.max(), abs=1e-7)


@pytest.mark.slow
def test_map_has_tongues_at_the_tips_and_nowhere_else():
    """At eps = 0.01 half a tongue is `growth` wide; those of order 2 and 3 lie at halves and thirds of the sums."""
    tips = combination_resonances(UNDAMPED, second(0.01))
    step = 0.5
    omega = np.arange(150.0, 700.0, step)
    grid = tongue_map(UNDAMPED, second(0.01), omega, [1.0])
    unstable = grid.verdict[0] == floquet.VERDICTS.index(UNSTABLE)
    for speed in omega[unstable]:
        first = [abs(speed - tip.speed) < 1.1 * tip.growth for tip in tips]
        higher = [abs(speed - tip.speed / order) < 0.02 for tip in tips for order in (2, 3, 4)]
        assert any(first) or any(higher)
    for tip in tips:
        if tip.growth > step:
            assert unstable[np.abs(omega - tip.speed) < 0.8 * tip.growth].all()
    assert 8 < unstable.sum() < 24


@pytest.mark.parametrize("bad", [0.0, math.inf])
def test_map_needs_a_speed(bad):
    with pytest.raises(ValueError, match="speeds has .*; each must be finite and not zero"):
        tongue_map(TABLE_1, MIXED, [10.0, bad], [1.0])
    with pytest.raises(ValueError, match="it must be > 0"):
        tongue_map(TABLE_1, MIXED, [10.0], [1.0, 100.0])
