"""Floquet analysis against closed forms: multipliers, the honesty of the error bound, the three verdicts."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg
from scipy.integrate import solve_ivp
from scipy.optimize import linear_sum_assignment
from scipy.special import mathieu_a, mathieu_b

from tire_dynamics.science import floquet

STABLE, MARGINAL, UNSTABLE = "asymptotically stable", "marginally stable", "unstable"
PERIOD = 1.25
TOLERANCES = [1e-4, 1e-7, 1e-10, 1e-13]
SEEDS = st.integers(0, 2**32 - 1)
thorough = settings(max_examples=25)


def worst_difference(expected, found):
    """Largest difference between two sets of numbers, paired off in the best way."""
    distance = np.abs(np.asarray(expected)[:, None] - np.asarray(found)[None, :])
    return distance[linear_sum_assignment(distance)].max()


def rotating_excitation(F, rng, period=PERIOD):
    """A(t) of x' = F x seen from axes that turn, z = L(t) x, at whole multiples of 2 pi/T in random planes.

    z' = (L' L^-1 + L F L^-1) z and L(T) = L(0): the multipliers are exp(lambda(F) T) (Lyapunov).
    """
    n = len(F)
    axes = np.linalg.qr(rng.normal(size=(n, n)))[0]
    rates = 2.0 * np.pi / period * rng.choice([-2, -1, 1, 2], size=n // 2)

    def A(t):
        turn, rate = np.eye(n, dtype=F.dtype), np.zeros((n, n), dtype=F.dtype)
        for k, w in enumerate(rates):
            pair = slice(2 * k, 2 * k + 2)
            c, s = math.cos(w * t), math.sin(w * t)
            turn[pair, pair] = [[c, -s], [s, c]]
            rate[pair, pair] = [[0.0, -w], [w, 0.0]]
        L = axes @ turn @ axes.T
        return axes @ rate @ axes.T + L @ F @ L.T

    return A


def similar(F, rng, condition=5.0):
    """S F S^-1 with a random S of the given condition number."""
    n = len(F)
    left, right = (np.linalg.qr(rng.normal(size=(n, n)))[0] for _ in range(2))
    stretch = np.geomspace(1.0, condition, n)
    return (left * stretch) @ right @ F @ right.T @ (left / stretch).T


def smooth_periodic(rng, n, period=PERIOD):
    """A random trigonometric A(t), and its trace's integral over the period (that of the constant term)."""
    constant, cosine, sine = rng.normal(size=(3, n, n))
    w = 2.0 * np.pi / period
    return (
        lambda t: constant + cosine * math.cos(w * t) + sine * math.sin(2.0 * w * t + 0.3),
        np.trace(constant) * period,
    )


def oscillator(frequency, damping=0.0):
    """[velocity, displacement]; damping [1/s] is the decay rate of the amplitude."""
    return np.array([[-2.0 * damping, -(frequency**2 + damping**2)], [1.0, 0.0]])


def mathieu(a, q):
    """x'' + (a - 2 q cos 2t) x = 0, z = [x', x]; the period is pi."""
    return lambda t: [[0.0, 2.0 * q * math.cos(2.0 * t) - a], [1.0, 0.0]]


def meissner(a, q, switch, period=PERIOD):
    """x'' + (a +- q) x = 0, plus before the switch and minus after; multipliers by exponentials."""
    first, second = np.array([[0.0, -(a + q)], [1.0, 0.0]]), np.array([[0.0, -(a - q)], [1.0, 0.0]])
    product = linalg.expm(second * (period - switch)) @ linalg.expm(first * switch)
    return (lambda t: first if t < switch else second), np.linalg.eigvals(product)


FREE_MASS = np.array([[0.0, 0.0], [1.0, 0.0]])
JORDAN_OSCILLATORS = np.block([[oscillator(3.0), 0.1 * np.eye(2)], [np.zeros((2, 2)), oscillator(3.0)]])
TWIN_OSCILLATORS = linalg.block_diag(oscillator(3.0), oscillator(3.0))


# ---- multipliers against closed forms


def test_mathieu_multipliers():
    # Floquet solutions of Mathieu's equation at (1, 0.1); the six decimals given bound the comparison
    result = floquet.analyze(mathieu(1.0, 0.1), math.pi)
    np.testing.assert_allclose(result.multipliers, [-1.169874, -0.854793], atol=5e-7)
    assert result.verdict == UNSTABLE
    assert result.spectral_radius == pytest.approx(1.169874, abs=5e-7)
    assert result.period == math.pi


@pytest.mark.slow
@pytest.mark.parametrize("q", [0.1, 1.0, 3.0])
def test_mathieu_stability_boundaries(q):
    """The characteristic values a_m, b_m part stable from unstable (Abramowitz & Stegun 20.2, 20.3)."""
    boundaries = np.sort([mathieu_a(m, q) for m in range(4)] + [mathieu_b(m, q) for m in range(1, 4)])

    def is_unstable(a):
        return floquet.analyze(mathieu(a, q), math.pi).verdict == UNSTABLE

    for index, boundary in enumerate(boundaries[:-1]):
        below = boundaries[index - 1] if index else boundary - 1.0
        low, high = 0.5 * (below + boundary), 0.5 * (boundary + boundaries[index + 1])
        unstable_below = index % 2 == 0  # unstable below a_0, stable up to b_1, unstable up to a_1, ...
        assert is_unstable(low) == unstable_below
        assert is_unstable(high) != unstable_below
        while high - low > 1e-9:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if is_unstable(middle) == unstable_below else (low, middle)
        # A resolution of e in the monodromy matrix is one of order e in a: rtol = 1e-10, and some room.
        assert low == pytest.approx(boundary, abs=1e-8)


@pytest.mark.parametrize("n", [1, 2, 5, 12])
@pytest.mark.parametrize("complex_valued", [False, True])
def test_constant_matrix_is_exp(n, complex_valued):
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n, n)) + (1j * rng.normal(size=(n, n)) if complex_valued else 0.0)
    expected = np.linalg.eigvals(linalg.expm(A * PERIOD))
    for result in (
        floquet.analyze(lambda t: A, PERIOD),
        floquet.analyze(A, PERIOD),
        floquet.analyze_constant(A, PERIOD),
    ):
        difference = worst_difference(expected, result.multipliers)
        # 1e-12 for expm and eigvals, whose error goes with the largest element
        assert difference <= result.error_estimate + 1e-12 * result.spectral_radius
        assert difference < 1e-9 * result.spectral_radius


@pytest.mark.parametrize("rtol", TOLERANCES)
def test_scalar_is_exp_of_the_integral(rtol):
    w = 2.0 * math.pi / PERIOD
    result = floquet.analyze(lambda t: [[3.0 * math.cos(w * t) ** 2 + 2j * math.sin(w * t)]], PERIOD, rtol)
    expected = math.exp(1.5 * PERIOD)
    assert abs(result.multipliers[0] - expected) <= result.error_estimate
    assert result.error_estimate < 100.0 * rtol  # honest, and still of use


@thorough
@given(
    a=st.floats(-2.0, 20.0),
    q=st.floats(0.1, 10.0),
    switch=st.floats(0.01, 0.99).map(lambda x: x * PERIOD),
    rtol=st.sampled_from(TOLERANCES),
)
def test_meissner_with_a_jump_anywhere(a, q, switch, rtol):
    """Piecewise constant, closed form by exponentials: the error bound holds where smoothness does not."""
    A, expected = meissner(a, q, switch)
    result = floquet.analyze(A, PERIOD, rtol)
    # Near a double multiplier eigvals of the closed form itself is only good to sqrt(eps).
    reference_error = 1e-7 if abs(expected[0] - expected[1]) < 1e-6 else 1e-12 * np.abs(expected).max()
    assert worst_difference(expected, result.multipliers) <= result.error_estimate + reference_error
    trace = abs(expected.sum())
    if abs(trace - 2.0) > 10.0 * result.error_estimate:
        assert result.verdict == (UNSTABLE if trace > 2.0 else MARGINAL)


@pytest.mark.slow
@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("place", [0.3, 0.6180339])
def test_error_bound_holds_at_a_singularity(place, rtol):
    """z' = |t - place|^(-1/2) z: errors fall by sqrt(2) per halving only, and two may agree by luck."""
    result = floquet.analyze(lambda t: [[abs(t - place) ** -0.5]], 1.0, rtol)
    error = abs(result.multipliers[0] - math.exp(2.0 * (math.sqrt(place) + math.sqrt(1.0 - place))))
    assert error <= result.error_estimate < 0.1


@pytest.mark.parametrize("growth", [8.0, 25.0, -25.0])
def test_error_estimate_is_absolute(growth):
    result = floquet.analyze(lambda t: [[growth / PERIOD]], PERIOD)
    expected = math.exp(growth)
    assert abs(result.multipliers[0] - expected) <= result.error_estimate
    assert 1e-16 * expected < result.error_estimate < 1e-9 * expected


def test_error_estimate_sees_growth_within_the_period():
    """A(t) = A cos(2 pi t) commutes with itself: Phi(1) = 1, with much growth and decay before."""
    A = np.random.default_rng(0).normal(size=(3, 3))
    result = floquet.analyze(lambda t: 40.0 * A * math.cos(2.0 * math.pi * t), 1.0)
    error = np.abs(result.multipliers - 1.0).max()
    assert error > 1e-12, "rounding alone: otherwise this system would test nothing"
    assert error <= result.error_estimate < 1e-3
    with pytest.raises(ArithmeticError, match="relative error .* must be below 0.1"):
        floquet.analyze(lambda t: 80.0 * A * math.cos(2.0 * math.pi * t), 1.0)


def test_finer_result_is_returned():
    """The bound is that of the coarser propagators, 2^14 times their halves' error."""
    result = floquet.analyze(lambda t: [[16.0 * math.cos(2.0 * math.pi * t) ** 2]], 1.0, 1e-4)
    assert abs(result.multipliers[0] - math.exp(8.0)) < result.error_estimate / 2**10


def calls(A, period, rtol=1e-10):
    times = []
    floquet.analyze(lambda t: times.append(t) or A(t), period, rtol)
    assert 0.0 < min(times) and max(times) < period
    return len(times)


def test_evaluations_of_the_state_matrix():
    costs = [calls(mathieu(90.0, 30.0), math.pi, rtol) for rtol in (1e-2, 1e-6, 1e-10, 1e-14)]
    assert costs == sorted(set(costs)), "a tighter tolerance must cost more"
    # a jump on the border of two cells costs nothing
    assert calls(meissner(5.0, 2.0, 0.5 * PERIOD)[0], PERIOD) == calls(lambda t: oscillator(2.0), PERIOD)
    # nor does a large unit
    assert calls(lambda t: 1e4 * FREE_MASS, PERIOD) == calls(lambda t: FREE_MASS, PERIOD)


@pytest.mark.parametrize("n", [2, 6, 10])
@pytest.mark.parametrize("rtol", TOLERANCES)
def test_turning_frame_leaves_multipliers(n, rtol):
    rng = np.random.default_rng(10 * n)
    F = rng.normal(size=(n, n)) - 0.5 * np.eye(n)
    expected = np.exp(np.linalg.eigvals(F) * PERIOD)
    result = floquet.analyze(rotating_excitation(F, rng), PERIOD, rtol)
    assert worst_difference(expected, result.multipliers) <= result.error_estimate
    assert result.error_estimate < 1e4 * rtol * result.spectral_radius  # non-normal, hence the room


def test_complex_turning_frame():
    rng = np.random.default_rng(3)
    F = rng.normal(size=(4, 4)) + 1j * rng.normal(size=(4, 4))
    result = floquet.analyze(rotating_excitation(F, rng), PERIOD)
    expected = np.exp(np.linalg.eigvals(F) * PERIOD)
    assert worst_difference(expected, result.multipliers) <= result.error_estimate
    assert result.error_estimate < 1e-6 * result.spectral_radius


@pytest.mark.parametrize("seed", range(4))
def test_irreducibly_periodic_system_against_runge_kutta(seed):
    """No closed form: an independent method, DOP853, at the tightest tolerance it takes."""
    n = 2 + seed
    A, _ = smooth_periodic(np.random.default_rng(seed), n)
    solution = solve_ivp(
        lambda t, z: (A(t) @ z.reshape(n, n)).ravel(),
        (0.0, PERIOD),
        np.eye(n).ravel(),
        method="DOP853",
        rtol=3e-14,
        atol=1e-14,
    )
    expected = np.linalg.eigvals(solution.y[:, -1].reshape(n, n))
    result = floquet.analyze(A, PERIOD)
    # 1e-11: DOP853's own error, some hundred steps of 1e-14 and their growth
    assert worst_difference(expected, result.multipliers) < 1e-11 * max(1.0, result.spectral_radius)
    assert result.error_estimate < 1e-7 * max(1.0, result.spectral_radius)


# ---- invariants


@thorough
@given(seed=SEEDS, n=st.integers(1, 6))
def test_product_of_multipliers_is_exp_of_the_trace(seed, n):
    """Liouville: det Phi(T) = exp(int tr A)."""
    A, exponent = smooth_periodic(np.random.default_rng(seed), n)
    result = floquet.analyze(A, PERIOD)
    moduli = np.abs(result.multipliers)
    allowed = np.prod(moduli + result.error_estimate) - np.prod(moduli)
    assert abs(np.prod(result.multipliers) - math.exp(exponent)) <= allowed + 1e-12 * math.exp(exponent)
    assert result.error_estimate < 1e-5 * max(1.0, result.spectral_radius)


@thorough
@given(seed=SEEDS, shift=st.floats(0.0, 1.0))
def test_multipliers_do_not_depend_on_where_the_period_starts(seed, shift):
    A, _ = smooth_periodic(np.random.default_rng(seed), 3)
    result = floquet.analyze(A, PERIOD)
    shifted = floquet.analyze(lambda t: A(t + shift * PERIOD), PERIOD)
    difference = worst_difference(result.multipliers, shifted.multipliers)
    assert difference <= result.error_estimate + shifted.error_estimate
    assert difference < 1e-6 * max(1.0, result.spectral_radius)


def test_balance_is_lapacks():
    """To a factor of 2: where two are as good, rounding decides."""
    random = np.random.default_rng(1992)
    for _ in range(20):
        n = int(random.integers(1, 9))
        units = 10.0 ** random.uniform(-12.0, 12.0, n)
        matrix = np.abs(random.normal(size=(n, n))) * units[:, None] / units
        matrix[np.abs(matrix) < floquet.EPSILON * matrix.max()] = 0.0
        ours = floquet.balance(matrix[None])[0]
        scale = linalg.lapack.dgebal(matrix, scale=1)[3]
        assert (np.abs(np.log2(ours) - np.log2(scale / scale[:, None])) <= 2.0).all()
        assert (np.mod(np.log2(ours), 1.0) == 0.0).all()  # powers of two round nothing


@pytest.mark.parametrize("unit_of_time", [1e-6, 1e3])
def test_unit_of_time(unit_of_time):
    A, _ = smooth_periodic(np.random.default_rng(1), 3)
    result = floquet.analyze(A, PERIOD)
    scaled = floquet.analyze(lambda t: A(t / unit_of_time) / unit_of_time, PERIOD * unit_of_time)
    np.testing.assert_allclose(scaled.multipliers, result.multipliers, rtol=1e-10)  # 1/unit_of_time rounds
    np.testing.assert_allclose(scaled.exponents * unit_of_time, result.exponents, rtol=1e-9)
    assert scaled.verdict == result.verdict


FRAMED = [
    (linalg.block_diag(FREE_MASS, oscillator(4.0, 0.1)), UNSTABLE),
    (JORDAN_OSCILLATORS, UNSTABLE),
    (TWIN_OSCILLATORS, MARGINAL),
    (linalg.block_diag(oscillator(3.0, 1e-6), oscillator(3.0, 0.2)), STABLE),
    (linalg.block_diag(oscillator(3.0, -1e-6), oscillator(3.0, 0.2)), UNSTABLE),
]


@pytest.mark.parametrize(("F", "verdict"), FRAMED)
@pytest.mark.parametrize("scales", [(1, 1, 1, 1), (1e3, 1e3, 1, 1), (1, 1e3, 1, 1e-3), (1e-6, 1, 1e6, 1)])
def test_units_of_the_states_do_not_matter(F, verdict, scales):
    rng = np.random.default_rng(7)
    A, D = rotating_excitation(F, rng), np.diag(scales)
    expected = np.exp(np.linalg.eigvals(F) * PERIOD)
    result = floquet.analyze(lambda t: D @ A(t) @ np.linalg.inv(D), PERIOD)
    assert result.verdict == verdict
    assert worst_difference(expected, result.multipliers) <= result.error_estimate < 1e-4
    constant = floquet.analyze_constant(D @ F @ np.linalg.inv(D), PERIOD)
    assert constant.verdict == verdict
    # no cap: a coupling in one direction only cannot be balanced, and large units make it look large
    assert worst_difference(expected, constant.multipliers) <= constant.error_estimate


# ---- verdicts on and near the unit circle


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize(("F", "verdict"), FRAMED)
def test_verdicts_at_every_tolerance(F, verdict, rtol):
    result = floquet.analyze(rotating_excitation(F, np.random.default_rng(11)), PERIOD, rtol)
    assert result.verdict == verdict


def test_free_mass_seen_from_a_turning_frame():
    """r'' = 0 in axes that turn at W: r'' + 2 W J r' - W^2 r = 0; the four multipliers are one."""
    W = 2.0 * math.pi / PERIOD
    J = np.array([[0.0, -1.0], [1.0, 0.0]])
    A = np.block([[-2.0 * W * J, W * W * np.eye(2)], [np.eye(2), np.zeros((2, 2))]])
    result = floquet.analyze(lambda t: A, PERIOD)
    assert result.verdict == UNSTABLE
    assert np.abs(result.multipliers - 1.0).max() <= result.error_estimate < 1e-4
    # In those axes lambda = +-iW, both of them double and short of an eigenvector.
    assert floquet.analyze_constant(A).verdict == UNSTABLE


@thorough
@given(
    seed=SEEDS,
    size=st.integers(1, 3),
    coupling=st.sampled_from([0.0, 1e-4, 1.0]),
    decay=st.sampled_from([-1e-3, 0.0, 1e-3]),
    frequency=st.floats(-4.0, 4.0),
    rtol=st.sampled_from([1e-7, 1e-10]),
)
def test_jordan_blocks_under_random_similarity(seed, size, coupling, decay, frequency, rtol):
    """One multiplier, one- to threefold, with all eigenvectors or not, inside, on or outside the circle."""
    rng = np.random.default_rng(seed)
    block = (1j * frequency - decay) * np.eye(size) + coupling * np.eye(size, k=1)
    F = linalg.block_diag(block, np.diag([-0.3 + 0.2j, -0.7]))
    expected = np.exp(np.diag(F) * PERIOD)
    defective = size > 1 and coupling > 0.0
    if decay:
        verdict = STABLE if decay > 0.0 else UNSTABLE
    else:
        verdict = UNSTABLE if defective else MARGINAL
    periodic = floquet.analyze(rotating_excitation(similar(F, rng), rng), PERIOD, rtol)
    constant = floquet.analyze_constant(similar(F, rng), PERIOD)
    for result in (periodic, constant):
        assert result.verdict == verdict
        assert worst_difference(expected, result.multipliers) <= result.error_estimate
        # E < 1e-6, whatever the similarity adds to rounding; its size-th root where defective
        assert result.error_estimate < (1e-6 ** (1.0 / size) if defective else 1e-6)


@pytest.mark.parametrize("decay", [1e-6, -1e-6])
def test_critical_damping_just_off_the_circle(decay):
    """A double multiplier without its second eigenvector, 1e-6 from the circle and split by about as much."""
    F = np.array([[-decay, 1.0], [0.0, -decay]])
    result = floquet.analyze(rotating_excitation(F, np.random.default_rng(2)), PERIOD)
    assert result.verdict == (STABLE if decay > 0.0 else UNSTABLE)
    assert floquet.analyze_constant(F, PERIOD).verdict == result.verdict


@pytest.mark.parametrize("pole", [0.0, 2.0j])
def test_multiplier_on_the_circle_beside_a_defective_one_inside(pole):
    """The pair 1e-4 inside must not drag its neighbour on the circle in with it."""
    F = linalg.block_diag([[-1e-4, 1.0], [0.0, -1e-4]], [[0.0]], [[-1.0]]) + pole * np.eye(4)
    assert floquet.analyze(rotating_excitation(F, np.random.default_rng(5)), PERIOD).verdict == MARGINAL
    assert floquet.analyze_constant(F, PERIOD).verdict == MARGINAL


def test_multipliers_that_meet_while_their_exponents_differ():
    """lambda = +-2 pi i/T give mu = 1 twice, with two eigenvectors: marginal. Of two free masses, not."""
    w = 2.0 * math.pi / PERIOD
    for analyze in (floquet.analyze, floquet.analyze_constant):
        result = analyze(oscillator(w), PERIOD)
        assert result.verdict == MARGINAL
        np.testing.assert_allclose(result.multipliers, 1.0, atol=1e-12)
    periodic = floquet.analyze(lambda t: oscillator(w), PERIOD)
    assert periodic.verdict == MARGINAL
    assert np.abs(periodic.multipliers - 1.0).max() <= periodic.error_estimate < 1e-9


@pytest.mark.parametrize("noise", [1e-17, -1e-17])
def test_rounding_is_not_taken_for_a_spring(noise):
    """A free mass whose acceleration is not exactly zero is not, by a choice of units, an oscillator."""
    A = np.array([[0.0, noise], [1.0, 0.0]])
    assert floquet.analyze_constant(A).verdict == UNSTABLE
    assert floquet.analyze(lambda t: A, PERIOD).verdict == UNSTABLE


@pytest.mark.parametrize(
    ("A", "verdict"),
    [
        (oscillator(3.0, 0.1), STABLE),
        (oscillator(3.0, -0.1), UNSTABLE),
        (oscillator(500.0), MARGINAL),
        (FREE_MASS, UNSTABLE),
        (1e-9 * FREE_MASS, UNSTABLE),
        (np.zeros((3, 3)), MARGINAL),
        (np.diag([0.0, -1.0]), MARGINAL),
        (TWIN_OSCILLATORS, MARGINAL),
        (JORDAN_OSCILLATORS, UNSTABLE),
        (-np.eye(2) + np.eye(2, k=1), STABLE),
    ],
)
def test_no_period_verdict_from_the_exponents(A, verdict):
    result = floquet.analyze_constant(A)
    assert result.verdict == verdict == floquet.analyze_constant(A, PERIOD).verdict
    assert result.multipliers is None and result.spectral_radius is None and result.period is None
    characteristic = np.poly(A)
    residual = np.abs([np.polyval(characteristic, z) for z in result.exponents]).max()
    assert residual < 1e-12 * np.abs(characteristic).max()
    assert result.error_estimate < 1e-5


# ---- form of the result


def test_order_and_consistency():
    result = floquet.analyze(rotating_excitation(linalg.block_diag(oscillator(2.0, 0.5), [[0.3]], [[-2.0]]),
                                     np.random.default_rng(0)), PERIOD)  # fmt: skip
    moduli = np.abs(result.multipliers)
    assert (np.diff(moduli) <= 1e-12).all()
    np.testing.assert_allclose(np.exp(result.exponents * PERIOD), result.multipliers, rtol=1e-13)
    np.testing.assert_allclose(result.exponents.real, [0.3, -0.5, -0.5, -2.0], atol=1e-9)
    assert result.exponents[1] == np.conj(result.exponents[2]) and result.exponents[1].imag > 0.0
    assert result.spectral_radius == moduli.max()
    constant = floquet.analyze_constant(np.diag([-1.0, 2.0, 0.5]), 2.0)
    np.testing.assert_allclose(constant.exponents, [2.0, 0.5, -1.0], rtol=1e-15)
    np.testing.assert_allclose(constant.multipliers, np.exp([4.0, 1.0, -2.0]), rtol=1e-15)
    with pytest.raises(dataclasses.FrozenInstanceError):
        result.verdict = STABLE


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_multiplier_that_underflows_keeps_its_exponent():
    result = floquet.analyze(lambda t: [[-1000.0 + math.cos(math.pi * t)]], 2.0)
    assert result.multipliers[0] == 0.0 and result.verdict == STABLE
    assert result.exponents[0] == pytest.approx(-1000.0, abs=1e-9)
    beside = floquet.analyze(lambda t: np.diag([0.1, -1000.0]), 2.0)  # exactly zero beside exp(0.2)
    assert np.isfinite(beside.exponents).all() and beside.exponents[1].real < -300.0
    assert beside.multipliers[1] == 0.0 and beside.verdict == UNSTABLE


def test_array_used_again_by_its_function():
    A, _ = smooth_periodic(np.random.default_rng(4), 2)
    buffer = np.empty((2, 2))

    def reused(t):
        buffer[:] = A(t)
        return buffer

    np.testing.assert_array_equal(floquet.analyze(reused, PERIOD).multipliers, floquet.analyze(A, PERIOD).multipliers)


# ---- input that cannot be used


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.eye(2), 0.0), r"period is 0\.0; it must be positive and finite"),
        ((np.eye(2), -1.0), r"period is -1\.0; it must be positive"),
        ((lambda t: np.eye(2), math.inf), r"period is inf; it must be positive and finite"),
        ((lambda t: np.eye(2), math.nan), r"period is nan"),
        ((lambda t: np.eye(2), 1.0, 1e-15), r"rtol is 1e-15; it must be between 1e-14 and 1e-2"),
        ((lambda t: np.eye(2), 1.0, 0.1), r"rtol is 0\.1; it must be between"),
        ((lambda t: np.eye(2), 1.0, math.nan), r"rtol is nan"),
        ((lambda t: np.ones((2, 3)), 1.0), r"state_matrix\(.*\) has shape \(2, 3\); it must be square"),
        ((lambda t: 1.0, 1.0), r"shape \(\); it must be square"),
        ((lambda t: np.eye(2 if t < 0.7 else 3), 1.0), r"\(0\.7.*\) has shape \(3, 3\); it must be \(2, 2\)"),
        ((lambda t: [[math.nan if 0.4 < t < 0.6 else 1.0]], 1.0), r"state_matrix\(0\.4.*\) is not finite"),
        ((lambda t: [[math.inf if t > 0.999 else 1.0]], 1.0), r"state_matrix\(.*\) is not finite"),
        ((np.zeros((0, 0)), 1.0), r"matrix has shape \(0, 0\)"),
        ((np.diag([1.0, math.nan]), 1.0), r"matrix is not finite"),
    ],
)  # fmt: skip
def test_bad_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        floquet.analyze(*arguments)


@pytest.mark.parametrize("matrix", [[[1.0, 2.0]], [1.0], [[math.inf]]])
def test_bad_constant_matrix(matrix):
    with pytest.raises(ValueError, match="^matrix "):
        floquet.analyze_constant(matrix)
    with pytest.raises(ValueError, match="period is 0.0"):
        floquet.analyze_constant(np.eye(2), 0.0)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("A", "message"),
    [
        (lambda t: [[1000.0]], r"grows by exp\(1000\) in a period; it overflows"),
        (np.array([[1000.0]]), r"grows by exp\(1000\) in a period; it overflows"),
        (lambda t: [[-1e20]], r"\|A\| T is 1e\+20; up to"),
        (lambda t: [[-1e160 * (0.0 < t < 0.005)]], "too irregular or too large to be integrated at t = 0"),
        (lambda t: [[1.0 / abs(t - 0.3)]], "too irregular or too large to be integrated at t = 0.(3|29)"),
    ],
)
def test_what_cannot_be_integrated(monkeypatch, A, message):
    monkeypatch.setattr(floquet, "MOST_CELLS", 2000)  # only to have the refusal sooner
    with pytest.raises(ArithmeticError, match=message):
        floquet.analyze(A, 1.0)
