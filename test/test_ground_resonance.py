"""Ground resonance: hinged blades on a hub whose supports give, against published and closed-form boundaries.

Blade k, at psi = Omega t + 2 pi k/N, is hinged at the radius e and lags by xi_k, forward positive; S, I are its first
and second moments of mass about the hinge. Hub and blades weigh m_x along x and m_y along y. With n the direction in
which a blade's tip goes and h = (x, y), the Lagrangian gives to first order

    I xi'' + c xi' + (k + e S Omega^2) xi + S n . h'' = 0,    m h'' + C h' + K h + sum_k (S xi_k n_k)'' = 0.

With three blades or more, all alike, this is constant in the cyclic coordinates of R. P. Coleman and A. M. Feingold
(NACA Report 1351, 1958); with two it is so on equal supports, in axes that turn; on unequal ones it never is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pytest
from scipy.linalg import eigvals
from scipy.optimize import brentq, linear_sum_assignment

from tire_dynamics.science import floquet
from tire_dynamics.science.periodic import Trigonometric, transition

STABLE, MARGINAL, UNSTABLE = "asymptotically stable", "marginally stable", "unstable"
RPM = math.pi / 30.0


@dataclass(frozen=True)
class Rotor:
    blades: int
    offset: float  # e [m]
    moment: float  # S [kg m]
    inertia: float  # I [kg m^2]
    spring: float  # k [N m/rad]
    dampers: tuple[float, ...]  # c of each blade [N m s/rad]
    mass: tuple[float, float]  # [kg]
    stiffness: tuple[float, float]  # [N/m]
    damping: tuple[float, float]  # [N s/m]


# C. E. Hammond, J. Am. Helicopter Soc. 19(4), 1974: blades of 6.5 slug, 65 slug ft, 800 slug ft^2 hinged at 1 ft, lag
# dampers of 3000 ft lb s, hub of 550 and 225 slug, 85 000 lb/ft, 3500 and 1750 lb s/ft; in SI as in later papers.
HUB = (8026.6 + 4.0 * 94.9, 3283.6 + 4.0 * 94.9)
HAMMOND = Rotor(4, 0.3048, 289.1, 1084.7, 0.0, (4067.5,) * 4, HUB, (1240481.8,) * 2, (51078.7, 25539.35))
# Two such blades on its lighter mass, without dampers
TWO = Rotor(2, 0.3048, 289.1, 1084.7, 3e4, (0.0,) * 2, (3473.4,) * 2, (1240481.8,) * 2, (0.0,) * 2)
UNEQUAL = replace(TWO, stiffness=(1240481.8, 1.5 * 1240481.8))


def matrices(rotor, speed, phase):
    """Mass, damping and stiffness, of [xi_0, ..., x, y]."""
    N, S = rotor.blades, rotor.moment
    psi = phase + 2.0 * np.pi * np.arange(N) / N
    outward, onward = np.array([np.cos(psi), np.sin(psi)]), np.array([-np.sin(psi), np.cos(psi)])
    nothing = np.zeros((N, 2))
    lag = rotor.spring + rotor.offset * S * speed**2
    return (
        np.block([[rotor.inertia * np.eye(N), S * onward.T], [S * onward, np.diag(rotor.mass)]]),
        np.block([[np.diag(rotor.dampers), nothing], [-2.0 * speed * S * outward, np.diag(rotor.damping)]]),
        np.block([[lag * np.eye(N), nothing], [-(speed**2) * S * onward, np.diag(rotor.stiffness)]]),
    )


def first_order(M, C, K):
    n = len(M)
    return np.block([[-np.linalg.solve(M, np.hstack([C, K]))], [np.eye(n), np.zeros((n, n))]])


def analyze(rotor, speed):
    return floquet.analyze(lambda t: first_order(*matrices(rotor, speed, speed * t)), 2.0 * math.pi / speed)


def growth(rotor, speed):
    return analyze(rotor, speed).exponents.real.max()


def worst_difference(expected, found):
    """Largest difference between two sets of numbers, paired off in the best way."""
    distance = np.abs(np.asarray(expected)[:, None] - np.asarray(found)[None, :])
    return distance[linear_sum_assignment(distance)].max()


def check_boundary(rotor, speed, below, above):
    """A millionth of the speed to either side: there it grows by 1e-7 1/s or more, known to 1e-10."""
    assert analyze(rotor, speed * (1.0 - 1e-6)).verdict == below
    assert analyze(rotor, speed * (1.0 + 1e-6)).verdict == above


def zeros(function, low, high, step):
    points = np.arange(low, high, step).tolist()
    values = [function(x) for x in points]
    return [
        brentq(function, points[k], points[k + 1], xtol=1e-9)
        for k in range(len(points) - 1)
        if values[k] * values[k + 1] < 0.0
    ]


# -- equations against the energies --


@pytest.mark.parametrize("blades", [2, 3, 4])
def test_equations_are_those_of_the_lagrangian(blades):
    """Second derivatives of L(q', q, t) for point masses on blades that lag by any angle, by differences."""
    rng = np.random.default_rng(blades)
    m, r = rng.uniform(0.5, 1.5, size=(2, 3))
    hub, stiffness, (e, k, c, speed) = rng.uniform(0.5, 2.0, 2), rng.uniform(0.5, 2.0, 2), rng.uniform(0.5, 1.5, 4)
    rotor = Rotor(blades, e, m @ r, m @ r**2, k, (c,) * blades, tuple(hub + blades * m.sum()), tuple(stiffness), (c, k))
    n = blades + 2

    def lagrangian(state, t):
        rates, xi, h = state[:n], state[n:-2, None], state[-2:]
        turn = np.exp(1j * (speed * t + 2.0 * np.pi * np.arange(blades) / blades))[:, None]
        lag_rate, (vx, vy) = rates[:-2, None], rates[-2:]
        velocity = vx + 1j * vy + 1j * turn * (speed * e + (speed + lag_rate) * r * np.exp(1j * xi))
        kinetic = (m * np.abs(velocity) ** 2).sum() + hub @ rates[-2:] ** 2
        return 0.5 * (kinetic - k * (xi**2).sum() - stiffness @ h**2)

    def hessian(t, step=1e-3):
        unit = step * np.eye(2 * n)
        signs = list(product([1.0, -1.0], repeat=2))
        entries = [[sum(a * b * lagrangian(a * x + b * y, t) for a, b in signs) for y in unit] for x in unit]
        return np.array(entries) / (4.0 * step**2)

    t = 0.37
    H, H_dot = hessian(t), (hessian(t + 1e-4) - hessian(t - 1e-4)) / 2e-4
    M, G, P = H[:n, :n], H[:n, n:], H[n:, n:]
    lagrange = M, H_dot[:n, :n] + G - G.T + np.diag([*rotor.dampers, *rotor.damping]), H_dot[:n, n:] - P
    for found, expected in zip(matrices(rotor, speed, speed * t), lagrange, strict=True):
        # differences: 1e-6 of the fourth derivatives, rounding of 1e-10 over 1e-4
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-5 * np.abs(expected).max())


# -- constant in other coordinates --


def rotating_excitation(rotor, speed):
    """A of X, Y and b = (xi_0 - xi_1)/2 in axes that turn with two blades, over the phase; of (xi_0 + xi_1)/2 alone."""
    W, S, I = speed, rotor.moment, rotor.inertia  # noqa: E741
    c, lag = rotor.dampers[0], rotor.spring + rotor.offset * S * W**2
    m, J = rotor.mass[0], np.array([[0.0, -1.0], [1.0, 0.0]])

    def at(phase):
        R = np.array([[math.cos(phase), -math.sin(phase)], [math.sin(phase), math.cos(phase)]])
        C, K = R.T @ np.diag(rotor.damping) @ R, R.T @ np.diag(rotor.stiffness) @ R
        C, K = C + 2.0 * W * m * J, K + W * C @ J - m * W**2 * np.eye(2)
        return first_order(
            np.block([[m * np.eye(2), np.array([[0.0], [2.0 * S]])], [np.array([[0.0, S, I]])]]),
            np.block([[C, np.array([[-4.0 * S * W], [0.0]])], [np.array([[2.0 * S * W, 0.0, c]])]]),
            np.block([[K, np.array([[0.0], [-2.0 * S * W**2]])], [np.array([[0.0, -S * W**2, lag]])]]),
        )

    mean = 0.5 * (at(0.0) + at(0.5 * math.pi))
    return Trigonometric(mean, (2,), (at(0.0) - mean)[None], (at(0.25 * math.pi) - mean)[None]), np.roots([I, c, lag])


@pytest.mark.parametrize("rotor", [TWO, replace(TWO, dampers=(500.0,) * 2, damping=(4e3,) * 2)])
def test_two_blades_on_equal_supports(rotor):
    for speed in (8.0, 18.0, 25.0, 32.0, 50.0):
        result, (system, collective) = analyze(rotor, speed), rotating_excitation(rotor, speed)
        assert np.abs([system.cosines, system.sines]).max() < 1e-12 * np.abs(system.constant).max()
        expected = np.exp(np.concatenate([np.linalg.eigvals(system.constant), collective]) * result.period)
        # rtol = 1e-10 of the propagators
        assert worst_difference(expected, result.multipliers) < 1e-10 * max(1.0, result.spectral_radius)


@pytest.mark.parametrize("spring", [0.0, 3e4])
def test_boundaries_of_two_blades_on_equal_supports(spring):
    """The undamped frequency equation in p = s^2 of the axes that turn (Coleman & Feingold, chapter 2):

    (I p + l)(P^2 + 4 W^2 m^2 p) = 2 S^2 [P (p - W^2)^2 + 8 W^2 m p (p - W^2) - 4 W^2 p P],
    P = m (p - W^2) + K, l = k + e S W^2.

    p = 0 bounds the range in which the rotor is thrown out, K = m W^2 and l (K - m W^2) = 2 S^2 W^4; a double root p
    the self-excited one, the cubic's discriminant.
    """
    rotor = replace(TWO, spring=spring)
    m, K, S, e = rotor.mass[0], rotor.stiffness[0], rotor.moment, rotor.offset

    def discriminant(W):
        p, P, gap = np.poly1d([1.0, 0.0]), np.poly1d([m, K - m * W**2]), np.poly1d([1.0, -(W**2)])
        lag = np.poly1d([rotor.inertia, spring + e * S * W**2])
        blades = P * gap**2 + 8.0 * W**2 * m * p * gap - 4.0 * W**2 * p * P
        a, b, c, d = (lag * (P**2 + 4.0 * W**2 * m**2 * p) - 2.0 * S**2 * blades).coeffs
        return b**2 * c**2 - 4.0 * a * c**3 - 4.0 * b**3 * d - 27.0 * a**2 * d**2 + 18.0 * a * b * c * d

    low = math.sqrt(np.roots([2.0 * S**2 + e * S * m, spring * m - e * S * K, -spring * K]).max())
    flutter = zeros(discriminant, 20.0, 60.0, 1.0)
    assert len(flutter) == 2
    for speed in (low, flutter[0]):
        check_boundary(rotor, speed, MARGINAL, UNSTABLE)
    for speed in (math.sqrt(K / m), flutter[1]):
        check_boundary(rotor, speed, UNSTABLE, MARGINAL)


def cyclic(rotor, speed):
    """Exponents in cyclic coordinates, sum_k xi_k exp(i psi_k) 2/N = a + i b, with x, y; of the other N - 2 motions."""
    N, S, I, c = rotor.blades, rotor.moment, rotor.inertia, rotor.dampers[0]  # noqa: E741
    lag = rotor.spring + rotor.offset * S * speed**2
    M = np.diag([I, I, *rotor.mass])
    M[0, 3], M[1, 2], M[2, 1], M[3, 0] = S, -S, -0.5 * N * S, 0.5 * N * S
    C, K = np.diag([c, c, *rotor.damping]), np.diag([lag - I * speed**2] * 2 + [*rotor.stiffness])
    C[:2, :2] += 2.0 * speed * I * np.array([[0.0, 1.0], [-1.0, 0.0]])
    K[:2, :2] += speed * c * np.array([[0.0, 1.0], [-1.0, 0.0]])
    return np.concatenate([np.linalg.eigvals(first_order(M, C, K)), np.tile(np.roots([I, c, lag]), N - 2)])


@pytest.mark.parametrize("blades", [3, 4])
def test_more_blades_on_unequal_supports(blades):
    """Hammond's hub, masses and dampers unequal, with less lag damping: constant in cyclic coordinates."""
    rotor = replace(HAMMOND, blades=blades, dampers=(1627.0,) * blades)  # 0.4 of Hammond's
    for speed in (8.0, 17.0, 25.0, 33.0):
        result = analyze(rotor, speed)
        expected = np.exp(cyclic(rotor, speed) * result.period)
        # rtol = 1e-10 of the propagators
        assert worst_difference(expected, result.multipliers) < 1e-10 * max(1.0, result.spectral_radius)
    speeds = zeros(lambda w: cyclic(rotor, w).real.max(), 10.0, 60.0, 1.0)
    assert len(speeds) == 2
    check_boundary(rotor, speeds[0], STABLE, UNSTABLE)
    check_boundary(rotor, speeds[1], UNSTABLE, STABLE)


# -- constant nowhere --


def hill(rotor, speed, order):
    """Coefficients of 1, s and s^2 in Hill's determinant: motions exp(s t) sum_j q_j exp(i j Omega t), abs(j) <= order.

    The matrices have the harmonics 0 and +-1 and no other, so that four samples of a turn give them exactly.
    """
    samples = [matrices(rotor, speed, 0.5 * math.pi * k) for k in range(4)]
    M, C, K = (np.fft.fft([s[i] for s in samples], axis=0) / 4.0 for i in range(3))
    count, size = 2 * order + 1, rotor.blades + 2
    rows = np.zeros((3, count, size, count, size), dtype=complex)
    for j, h in product(range(count), (-1, 0, 1)):
        if 0 <= j + h < count:
            s = 1j * (j - order) * speed
            rows[:, j + h, :, j, :] = K[h] + s * C[h] + s * s * M[h], C[h] + 2.0 * s * M[h], M[h]
    return rows.reshape(3, count * size, count * size)


def hill_exponents(rotor, speed, order=6):
    """Those of its exponents, all repeated at steps of i Omega, that the cut of the determinant disturbs least."""
    K, C, M = hill(rotor, speed, order)
    exponents = np.linalg.eigvals(first_order(M, C, K))
    return exponents[np.argsort(np.abs(exponents.imag))][: 2 * (rotor.blades + 2)]


@pytest.mark.slow
def test_hammonds_rotor_with_a_damper_out():
    """Stable with four dampers, unstable at some speeds with three: Hammond; G. Cassoni et al., doi 10.1115/1.4056591.

    The speeds themselves are those of Hill's determinant.
    """
    for rpm in range(40, 401, 40):
        assert analyze(HAMMOND, rpm * RPM).verdict == STABLE
    out = replace(HAMMOND, dampers=(0.0, *HAMMOND.dampers[1:]))
    speeds = zeros(lambda w: hill_exponents(out, w).real.max(), 40.0 * RPM, 400.0 * RPM, 40.0 * RPM)
    assert len(speeds) == 2
    check_boundary(out, speeds[0], STABLE, UNSTABLE)
    check_boundary(out, speeds[1], UNSTABLE, STABLE)


@pytest.mark.parametrize("rotor", [UNEQUAL, replace(UNEQUAL, dampers=(500.0,) * 2, damping=(3e3, 8e3))])
def test_two_blades_on_unequal_supports(rotor):
    """Fixed axes by `analyze`, turning axes by `transition`, and no integration at all by Hill's determinant."""
    for speed in (14.0, 18.0, 25.0, 32.0):
        result, (system, collective) = analyze(rotor, speed), rotating_excitation(rotor, speed)
        period = result.period
        found = transition(system, speed, 0.0, 2.0 * math.pi)
        fast = floquet.judge(found.matrix[0], float(found.log_norm[0]), float(found.error[0]), period)
        both = np.concatenate([fast.multipliers, np.exp(collective * period)])
        room = 1e-10 * max(1.0, result.spectral_radius)  # rtol
        assert worst_difference(both, result.multipliers) < room
        assert worst_difference(np.exp(hill_exponents(rotor, speed) * period), result.multipliers) < room


def test_critical_speeds_on_unequal_supports():
    """s = 0 in Hill's determinant, K + Omega^2 B, whose zeros are eigenvalues (Coleman & Feingold, chapter 3).

    One range to either support. It ends where the hub would be critical alone, but for what the blades' lag at twice
    the speed adds to it, and begins where they are thrown out.
    """
    rest = hill(UNEQUAL, 0.0, 6)[0]
    squares = eigvals(rest, rest - hill(UNEQUAL, 1.0, 6)[0])
    real = squares[np.isfinite(squares) & (np.abs(squares.imag) < 1e-9 * np.abs(squares))].real
    speeds = np.sort(np.sqrt(real[real > 15.0**2]))  # below, the zeros are double
    alone = np.sqrt(np.array(UNEQUAL.stiffness) / UNEQUAL.mass)
    assert speeds[1::2] == pytest.approx(alone, rel=3e-3)
    for speed, verdicts in zip(speeds, ((MARGINAL, UNSTABLE), (UNSTABLE, MARGINAL)) * 2, strict=True):
        check_boundary(UNEQUAL, speed, *verdicts)


def edge(rotor, inside, outside):
    """Where a rotor without dampers ceases to be unstable."""
    for _ in range(18):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if analyze(rotor, middle).verdict == UNSTABLE else (inside, middle)
    return inside


@pytest.mark.slow
def test_the_tongue_between_unequal_supports():
    """T. Yamamoto and H. Ota (J. Appl. Mech. 31, 1964): an unsymmetric rotor is unstable around 2 W = w_x + w_y.

    By averaging, with m = I = 1: the blades see the hub at the frequencies d = w - W and W + w, and follow as forced
    oscillators of the stiffness k. This lowers each w by S^2 w^3/4 [1/(k - d^2) + 1/(k - (W + w)^2)] and couples the
    two; the growth, and half the width in W, is S^2 (w_x w_y)^(3/2)/(4 (k - d^2)). Next comes S^4: half of S^2 leaves
    half of the relative error. With three blades nothing grows.
    """
    w, k = np.array([1.0, 1.5]), 16.0
    W = 0.5 * w.sum()
    near, far = k - 0.25 * (w[0] - w[1]) ** 2, k - (W + w) ** 2
    errors = []
    for square in (0.02, 0.01):
        rotor = Rotor(2, 0.0, math.sqrt(square), 1.0, k, (0.0,) * 2, (1.0,) * 2, tuple(w**2), (0.0,) * 2)
        rate = square * w.prod() ** 1.5 / (4.0 * near)
        center = W - 0.125 * square * (w**3 * (1.0 / near + 1.0 / far)).sum()
        low, high = (edge(rotor, center, center + side * 3.0 * rate) for side in (-1.0, 1.0))
        found = 0.5 * (low + high)
        errors.append([0.5 * (high - low) / rate - 1.0, growth(rotor, found) / rate - 1.0, (found - center) / rate])
        three = replace(rotor, blades=3, dampers=(0.0,) * 3)
        assert all(analyze(three, center + shift * rate).verdict == MARGINAL for shift in np.linspace(-3.0, 3.0, 13))
    coarse, fine = np.abs(errors)
    assert (coarse < (0.02, 0.02, 0.2)).all()
    assert (fine < 0.55 * coarse + 1e-4).all()  # 1e-4: bisection, and verdicts' own error


def needed(blades, support, S):
    """Width of the unstable range, and product of the dampings that close it, over what is predicted, less one."""
    w = (1.0, 1.5)

    def nu(speed):
        return math.sqrt(0.1 + 0.1 * speed**2)  # of which a half is the hinge's offset, e S = 0.1

    def meets(shift):
        return brentq(lambda speed: speed - nu(speed) - w[support] - shift, 0.0, 10.0)

    g = math.sqrt(blades * S**2 * w[support] ** 3 / (16.0 * nu(meets(0.0))))
    a, b = 0.5 * g, g

    def damped(scale):
        dampers, damping = (2.0 * b * scale,) * blades, (2.0 * a * scale,) * 2
        return Rotor(blades, 0.1 / S, S, 1.0, 0.1, dampers, (1.0,) * 2, (w[0] ** 2, w[1] ** 2), damping)

    half = (a + b) * math.sqrt(g**2 / (a * b) - 1.0)
    expected = meets(-half), meets(half)
    width = expected[1] - expected[0]
    rotor = damped(1.0)
    found = [brentq(lambda x: growth(rotor, x), x - 0.5 * width, x + 0.5 * width, xtol=1e-9) for x in expected]
    check_boundary(rotor, found[0], STABLE, UNSTABLE)
    check_boundary(rotor, found[1], UNSTABLE, STABLE)
    enough = brentq(lambda scale: growth(damped(scale), 0.5 * sum(found)), 1.0, 2.0, xtol=1e-9)
    return (found[1] - found[0]) / width - 1.0, enough**2 * a * b / g**2 - 1.0


@pytest.mark.slow
@pytest.mark.parametrize("blades", [2, 4])
@pytest.mark.parametrize("support", [0, 1])
def test_the_damping_that_is_needed(blades, support):
    """M. L. Deutsch (J. Aeronaut. Sci. 13, 1946): where W - nu = w of a support, C c > N/4 S^2 w^2 (W - nu)/nu.

    nu is the lag frequency; here the supports are unequal, and two blades obey it too. By averaging, with m = I = 1:
    the growth without dampers is g, g^2 = N S^2 w^3/(16 nu), and with the rates of decay a = C/2 and b = c/2 all is
    unstable where abs(W - nu - w) < (a + b) sqrt(g^2/(a b) - 1). Next comes S^2: half of S leaves a quarter.
    """
    coarse, fine = (np.abs(needed(blades, support, S)) for S in (0.04, 0.02))
    assert (coarse < 0.03).all() and (fine < 0.3 * coarse).all()
