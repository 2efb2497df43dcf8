"""The ring against its equations of motion, written out here as the paper has them."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from test_modes import SIZES, Drive, Lagrangian

from tire_dynamics import TireWheelUnit, ring

TABLE_1 = TireWheelUnit.table_1()


@st.composite
def units(draw):
    """Tires around Table 1: every stiffness, mass and length by a factor of up to four either way."""
    factor = st.floats(-2.0, 2.0).map(lambda x: 2.0**x)
    changes = {
        name: getattr(TABLE_1, name) * draw(factor)
        for name in SIZES
    }
    changes["thickness"] = min(changes["thickness"], 0.2 * changes["radius"])
    damping = st.floats(0.01, 0.5)
    return TABLE_1.replace(**changes, zeta_1=draw(damping), zeta_s=draw(damping), zeta_n=draw(damping))


wavenumbers = st.integers(2, 30)
speeds = st.floats(-400.0, 400.0)


def paper_coefficients(unit, n, W):
    """(3.5a-c) as printed, in exact fractions of the same doubles: A, B, C."""
    rho, D, K, a, h, k_z, k_t, p = (
        Fraction(getattr(unit, name))
        for name in (
            "density", "bending_stiffness", "membrane_stiffness", "radius", "thickness",
            "radial_stiffness", "tangential_stiffness", "inflation_pressure",
        )
    )  # fmt: skip
    sigma = Fraction(W) ** 2 + p / (rho * h * a)
    A = (n**3 * D / a**4 + n * K / a**2) / (rho * h) + 2 * n * sigma
    B = (n**4 * D / a**4 + K / a**2 + k_z + p / a) / (rho * h) + n**2 * sigma
    C = (n**2 * D / a**4 + n**2 * K / a**2 + k_t + p / a) / (rho * h) + n**2 * sigma
    return A, B, C


@given(unit=units(), n=st.integers(0, 200), speed=speeds)
def test_coefficients(unit, n, speed):
    found = ring.coefficients(unit, n, speed)
    A, B, C = paper_coefficients(unit, n, speed)
    # sums of positive terms: a rounding of 2^-53 for each of some ten operations
    for value, exact in zip(found, (A, B, C, B * C - A * A), strict=True):
        assert float(value) == pytest.approx(float(exact), rel=4e-15, abs=0.0)


def test_coefficients_of_many_modes_at_once():
    together = ring.coefficients(TABLE_1, np.arange(6), 100.0)
    for n in range(6):
        assert [float(value[n]) for value in together] == [float(v) for v in ring.coefficients(TABLE_1, n, 100.0)]


# -- natural frequencies ----------------------------------------------------------------------------------------


def matrices(unit, n, W):
    """G and K of (3.2), undamped, x = [alpha, beta, xi, eta]."""
    A, B, C = (float(value) for value in paper_coefficients(unit, n, W))
    G = 2.0 * W * np.array([[0, 0, -1, 0], [0, 0, 0, -1], [1, 0, 0, 0], [0, 1, 0, 0]])
    K = np.array([[B, 0, 0, A], [0, B, -A, 0], [0, -A, C, 0], [A, 0, 0, C]])
    return G, K


def inextensional_matrices(unit, n, W):
    """The same of (3.10), (3.11), x = [alpha, beta]; n = 1 by (3.13)."""
    coriolis, g = map(float, inextensional(unit, n, W))
    return coriolis * np.array([[0.0, -1.0], [1.0, 0.0]]), g * np.eye(2)


def real_roots(*coefficients):
    """The roots of a polynomial whose roots are all real, highest power first, in 80 digits.

    Between two neighbouring roots of the derivative lies one root, to be bisected; a double root is a root of both. No
    matrix, and so nothing that may not converge, whatever the sizes of the coefficients are beside each other.
    """
    with localcontext() as context:
        context.prec = 80
        exact = [Decimal(c.numerator) / Decimal(c.denominator) for c in map(Fraction, coefficients)]
        roots = _real_roots(exact)
        product = [Decimal(1)]  # the coefficients again; where two roots coincide, to half of the digits
        for root in roots:
            product = [a - root * b for a, b in zip([*product, Decimal(0)], [Decimal(0), *product], strict=True)]
        size = 1 + max(map(abs, roots))
        for k, (found, given) in enumerate(zip(product, exact, strict=True)):
            assert abs(found - given / exact[0]) <= Decimal("1e-30") * size**k
        return roots


def _real_roots(c):
    if len(c) == 2:
        return [-c[1] / c[0]]

    def value(x):
        total = Decimal(0)
        for each in c:
            total = total * x + each
        return total

    degree = len(c) - 1
    bound = 1 + max(abs(each / c[0]) for each in c)  # Cauchy's
    edges = [-bound, *_real_roots([each * (degree - k) for k, each in enumerate(c[:-1])]), bound]
    roots = []
    for low, high in zip(edges, edges[1:], strict=False):
        if (value(low) > 0) == (value(high) > 0):
            roots.append(min(low, high, key=lambda x: abs(value(x))))
            continue
        rising = value(high) > 0
        while high - low > Decimal("1e-75") * bound:
            middle = (low + high) / 2
            low, high = (low, middle) if (value(middle) > 0) == rising else (middle, high)
        roots.append((low + high) / 2)
    return roots


def frequencies(*coefficients):
    """The sizes of the roots, ascending."""
    return np.sort([float(abs(root)) for root in real_roots(*coefficients)])


def complete(unit, n, W):
    """Coefficients of the polynomial of (3.2), undamped, in w of exp(i w t); the other two frequencies are -w of these.

    In u = alpha + i beta, v = xi + i eta it is u'' - 2 W v' + B u = i A v, v'' + 2 W u' + C v = -i A u, and so
    (B - w^2) (C - w^2) = (A + 2 W w)^2.
    """
    A, B, C = paper_coefficients(unit, n, W)
    W = Fraction(W)
    return 1, 0, -(B + C + 4 * W**2), -4 * A * W, B * C - A**2


@given(unit=units(), n=st.integers(0, 30), speed=speeds)
def test_complete_frequencies(unit, n, speed):
    found = ring.natural_frequencies(unit, n, speed)
    expected = frequencies(*complete(unit, n, speed))
    assert found.shape == (4,) and (np.diff(found) >= 0.0).all()
    # The root of an eigenvalue, which is known to some 1e-16 of the largest.
    assert np.abs(found**2 - expected**2).max() <= 1e-12 * expected[-1] ** 2


@given(unit=units(), n=st.integers(1, 30), speed=speeds)
@example(unit=TABLE_1, n=27, speed=4e-9)  # a Coriolis term of 1e-8 beside a stiffness of 1e6
def test_inextensional_frequencies(unit, n, speed):
    """(3.10), (3.11) undamped; n = 1 by (3.13). z'' + i c z' + g z = 0 in z = alpha + i beta; w^2 + c w = g."""
    coriolis, g = inextensional(unit, n, speed)
    found = ring.natural_frequencies(unit, n, speed, "inextensional")
    expected = frequencies(1, coriolis, -g)
    assert found.shape == (2,)
    # At n = 1 the two are omega_1 -+ Omega: they may meet zero, where only the larger one's digits count.
    assert np.abs(found - expected).max() <= 1e-12 * expected[-1]


def inextensional(unit, n, W):
    """Coriolis term and stiffness of (3.10), (3.11), exact in the same doubles."""
    W = Fraction(W)
    if n == 1:
        k_z, k_t = Fraction(unit.radial_stiffness), Fraction(unit.tangential_stiffness)
        return 2 * W, (k_z + k_t) / (2 * Fraction(unit.density) * Fraction(unit.thickness)) - W**2
    A, B, C = paper_coefficients(unit, n, W)
    return 2 * W * (C + n * A) / (A + n * C), n * (B * C - A**2) / (A + n * C)


@given(unit=units(), n=wavenumbers, speed=speeds)
def test_hybrid_frequencies(unit, n, speed):
    """No Coriolis term, centrifugal terms kept: sqrt(g_n), twice."""
    _, g = inextensional(unit, n, speed)
    assert ring.natural_frequencies(unit, n, speed, "hybrid") == pytest.approx([math.sqrt(g)] * 2, rel=1e-14)


@given(unit=units(), n=st.integers(0, 30), speed=speeds)
def test_frequencies_do_not_know_the_direction(unit, n, speed):
    there, back = (ring.natural_frequencies(unit, n, w) for w in (speed, -speed))
    assert there == pytest.approx(back, rel=1e-12)


def test_modes_split_with_speed():
    """Forward and backward waves part; the inextensional ring keeps the complete one's lower pair within 2 %."""
    for n in (2, 3, 5):
        complete = ring.natural_frequencies(TABLE_1, n, 100.0)
        inextensional = ring.natural_frequencies(TABLE_1, n, 100.0, "inextensional")
        assert complete[1] - complete[0] > 10.0
        assert inextensional == pytest.approx(complete[:2], rel=0.02)  # at rest 0.6 % at n = 2


@given(unit=units(), n=st.integers(0, 30))
def test_damping_refers_to_the_frequency_at_rest(unit, n):
    """d_n = 2 zeta_n omega_n, omega_n in the model that is used; of the complete model's two, the lower."""
    zeta = unit.zeta_1 if n == 1 else unit.zeta_n
    lowest = ring.natural_frequencies(unit, n)[0]
    # roots of a quartic against a quadratic formula: digits of the lower root beside the higher
    assert float(ring.mode_damping(unit, n, "complete")) == pytest.approx(2.0 * zeta * lowest, rel=1e-9)
    if n >= 1:
        lowest = ring.natural_frequencies(unit, n, model="inextensional")[0]
        assert float(ring.mode_damping(unit, n)) == pytest.approx(2.0 * zeta * lowest, rel=1e-14)


# -- steady response --------------------------------------------------------------------------------------------


def harmonic_balance(unit, n, W, f_r, f_t, coriolis=True):
    """Complex amplitudes (alpha, beta) exp(i n Omega t) of (3.10)-(3.12) under a force fixed in space, as real pairs.

    The two equations with Q of section 2.1: theta* = psi_0 - Omega t turns the right side at n Omega.
    """
    A, B, C = paper_coefficients(unit, n, W)
    g = float(n * (B * C - A * A) / (A + n * C))
    A, C = float(A), float(C)
    Dc = 2.0 * W * (C + n * A) / (A + n * C) if coriolis else 0.0
    rest = paper_coefficients(unit, n, 0)
    omega_n = math.sqrt(n * (rest[1] * rest[2] - rest[0] ** 2) / (rest[0] + n * rest[2]))
    d = 2.0 * unit.zeta_n * omega_n
    mass = math.pi * unit.radius * unit.width * unit.density * unit.thickness
    # cos(n theta*) and sin(n theta*) as real parts of c exp(i n W t), s exp(i n W t)
    psi_0 = 1.5 * math.pi
    cos, sin = np.exp(-1j * n * psi_0), 1j * np.exp(-1j * n * psi_0)
    Q_1, Q_2, Q_3, Q_4 = (f_r * cos / mass, f_r * sin / mass, f_t * cos / mass, f_t * sin / mass)
    q_1, q_2 = n * (C * Q_1 - A * Q_4) / (A + n * C), n * (C * Q_2 + A * Q_3) / (A + n * C)
    s = 1j * n * W
    return np.linalg.solve([[s * s + d * s + g, -Dc * s], [Dc * s, s * s + d * s + g]], [q_1, q_2])


@settings(max_examples=60)
@given(unit=units(), n=wavenumbers, speed=speeds, load=st.floats(10.0, 1e4), traction=st.floats(-1e3, 1e3))
def test_steady_amplitudes(unit, n, speed, load, traction):
    """Against harmonic balance of the ring-frame equations; u_z(psi) at theta = psi - Omega t is the same at all t."""
    psi = np.linspace(0.0, 2.0 * math.pi, 7)
    cosine, sine = ring.steady_amplitudes(unit, [n], speed, load, traction)
    angle = n * (psi - ring.CONTACT_ANGLE)
    found = cosine * np.cos(angle) + sine * np.sin(angle)
    alpha, beta = harmonic_balance(unit, n, speed, -load, -traction)
    scale = max(abs(alpha), abs(beta))
    for time in (0.0, 0.0123):
        turn = np.exp(1j * n * speed * time)
        theta = psi - speed * time
        expected = (alpha * turn).real * np.cos(n * theta) + (beta * turn).real * np.sin(n * theta)
        # near a resonance (R = 0) digits are lost to 1/(2 zeta_n), 50 at the most; angles of n Omega t to 150
        assert np.abs(found - expected).max() <= 1e-10 * scale


@settings(max_examples=30)
@given(unit=units(), n=wavenumbers, speed=speeds)
def test_steady_amplitudes_without_coriolis(unit, n, speed):
    cosine, sine = ring.steady_amplitudes(unit, [n], speed, 1000.0, model="hybrid")
    alpha, beta = harmonic_balance(unit, n, speed, -1000.0, 0.0, coriolis=False)
    # at t = 0: u_z = Re alpha cos n psi + Re beta sin n psi, about the contact
    psi = np.linspace(0.0, 2.0 * math.pi, 7)
    angle = n * (psi - ring.CONTACT_ANGLE)
    expected = alpha.real * np.cos(n * psi) + beta.real * np.sin(n * psi)
    found = cosine * np.cos(angle) + sine * np.sin(angle)
    assert np.abs(found - expected).max() <= 1e-10 * max(abs(alpha), abs(beta))


@pytest.mark.parametrize("speed", [60.0, -60.0, 170.0])
def test_steady_response_is_what_the_motion_comes_to(speed):
    """(3.10)-(3.12) integrated from rest by DOP853 until the transient is gone."""
    unit = TABLE_1.replace(zeta_n=0.3)
    load, psi = 2000.0, np.linspace(0.0, 2.0 * math.pi, 9)
    end = 0.25  # decay by exp(-0.3 * 570 * 0.25) = 2e-19
    expected = np.zeros((2, psi.size))
    for n in (2, 3):
        A, B, C = (float(value) for value in paper_coefficients(unit, n, speed))
        rest = [float(value) for value in paper_coefficients(unit, n, 0)]
        g, Dc = n * (B * C - A * A) / (A + n * C), 2.0 * speed * (C + n * A) / (A + n * C)
        d = 2.0 * unit.zeta_n * math.sqrt(n * (rest[1] * rest[2] - rest[0] ** 2) / (rest[0] + n * rest[2]))
        mass = math.pi * unit.radius * unit.width * unit.surface_density

        def slope(t, z, n=n, A=A, C=C, g=g, Dc=Dc, d=d, mass=mass):
            contact = n * (1.5 * math.pi - speed * t)
            push = n * C * -load / ((A + n * C) * mass)
            return [
                z[2],
                z[3],
                push * math.cos(contact) - d * z[2] + Dc * z[3] - g * z[0],
                push * math.sin(contact) - d * z[3] - Dc * z[2] - g * z[1],
            ]

        z = solve_ivp(slope, (0.0, end), np.zeros(4), method="DOP853", rtol=1e-11, atol=1e-15).y[:, -1]
        theta = psi - speed * end
        expected[0] += z[0] * np.cos(n * theta) + z[1] * np.sin(n * theta)
        expected[1] += z[1] / n * np.cos(n * theta) - z[0] / n * np.sin(n * theta)  # xi = beta/n, eta = -alpha/n
    found = ring.steady_response(unit, speed, load, psi, n_max=3)
    # rtol 1e-11 over a few hundred steps
    assert np.abs(np.array(found) - expected).max() <= 1e-8 * np.abs(expected).max()


@given(unit=units(), n=wavenumbers)
def test_static_radial_deflection_is_the_complete_models(unit, n):
    """Section 2.3: the elimination changes nothing in the radial deflection under a radial load."""
    A, B, C = paper_coefficients(unit, n, 0)
    mass = math.pi * unit.radius * unit.width * unit.surface_density
    f = Fraction(-1000.0) / Fraction(mass)
    alpha = f * C / (B * C - A * A)  # of B alpha + A eta = f, A alpha + C eta = 0, psi from the contact
    cosine, sine = ring.steady_amplitudes(unit, [n], 0.0, 1000.0)
    assert cosine[0] == pytest.approx(float(alpha), rel=1e-13)
    assert abs(sine[0]) <= 1e-13 * abs(cosine[0])  # the angle of the contact, n 3 pi/2, rounded
    complete, _ = ring.steady_amplitudes(unit, [n], 0.0, 1000.0, model="complete")
    # its eigenvectors are taken in doubles, of a matrix whose determinant cancels
    assert complete[0] == pytest.approx(float(alpha), rel=1e-10)


@pytest.mark.parametrize("model", ["inextensional", "complete"])
def test_symmetric_about_the_load_at_rest_only(model):
    offset = np.linspace(0.1, 3.0, 12)
    for speed in (0.0, 150.0):
        (right, along), (left, against) = (
            ring.steady_response(TABLE_1, speed, 1961.33, ring.CONTACT_ANGLE + side * offset, model=model)
            for side in (1.0, -1.0)
        )
        skew = np.abs(right - left).max() / np.abs(right).max()
        if speed == 0.0:
            assert skew < 1e-12  # rounding of thirty cosines and of 3 pi/2
            assert along == pytest.approx(-against, abs=1e-15)
        else:
            assert skew > 1e-3


@given(unit=units(), speed=speeds, model=st.sampled_from(["inextensional", "complete", "hybrid"]))
def test_rolling_backward_is_the_mirror_image(unit, speed, model):
    offset = np.linspace(0.0, 3.0, 7)
    u_z, u_theta = ring.steady_response(unit, speed, 1000.0, ring.CONTACT_ANGLE + offset, model=model)
    mirrored = ring.steady_response(unit, -speed, 1000.0, ring.CONTACT_ANGLE - offset, model=model)
    scale = np.abs(u_z).max() + np.abs(mirrored[0]).max()
    # the complete model's eigenvectors: 1e-16 of a matrix whose determinant cancels
    tolerance = 1e-10 if model == "complete" else 1e-12
    assert np.abs(u_z - mirrored[0]).max() <= tolerance * scale
    assert np.abs(u_theta + mirrored[1]).max() <= tolerance * scale


@pytest.mark.parametrize("model", ["inextensional", "hybrid"])
def test_inextensional(model):
    """u_z = -d u_theta/d psi."""
    psi = 2.0 * math.pi * np.arange(64) / 64
    u_z, u_theta = ring.steady_response(TABLE_1, 120.0, 1961.33, psi, n_max=20, model=model)
    derivative = np.fft.irfft(1j * np.arange(33) * np.fft.rfft(u_theta))  # exact: 20 harmonics on 64 points
    assert u_z == pytest.approx(-derivative, abs=1e-12 * np.abs(u_z).max())


def test_the_load_pushes_the_belt_inward_at_the_contact():
    u_z, _ = ring.steady_response(TABLE_1, 0.0, 1961.33, [ring.CONTACT_ANGLE, 0.5 * math.pi])
    assert u_z[0] < 0.0 and abs(u_z[0]) > abs(u_z[1])


def test_shapes_follow_psi():
    for shape in ((), (3,), (2, 5)):
        u_z, u_theta = ring.steady_response(TABLE_1, 10.0, 1.0, np.zeros(shape))
        assert np.shape(u_z) == np.shape(u_theta) == shape


# -- a belt that hardly stretches -------------------------------------------------------------------------------

STIFFER = TABLE_1.membrane_stiffness * 4.0 ** np.arange(3, 8)


def rate_of(differences):
    """By what each difference is smaller than the one before it, the membrane being four times as stiff."""
    return np.array(differences[:-1]) / np.array(differences[1:])


@pytest.mark.parametrize("speed", [0.0, 100.0])
@pytest.mark.parametrize("n", [1, 2, 5, 10])
def test_complete_frequencies_come_to_the_inextensional_ones(n, speed):
    """With 1/K."""
    differences = []
    for K in STIFFER:
        unit = TABLE_1.replace(membrane_stiffness=K)
        complete = ring.natural_frequencies(unit, n, speed)[:2]
        differences.append(np.abs(complete / ring.natural_frequencies(unit, n, speed, "inextensional") - 1.0).max())
    assert rate_of(differences) == pytest.approx(4.0, abs=0.05)  # 1/K beside 1, below 1 % from 4^3 K on
    assert differences[-1] < 1e-5


@pytest.mark.parametrize("speed", [0.0, 100.0, -300.0])
def test_complete_steady_response_comes_to_the_inextensional_one(speed):
    """With 1/K, both components."""
    psi, differences = np.linspace(0.0, 6.0, 40), []
    for K in STIFFER:
        complete, inextensional = (
            np.array(ring.steady_response(TABLE_1.replace(membrane_stiffness=K), speed, 2e3, psi, n_max=6, model=model))
            for model in ("complete", "inextensional")
        )
        differences.append(np.abs(complete - inextensional).max() / np.abs(inextensional).max())
    assert rate_of(differences) == pytest.approx(4.0, abs=0.05)
    assert differences[-1] < 1e-5


# -- matrices, fixed frame, shapes ------------------------------------------------------------------------------


@given(unit=units(), n=st.integers(0, 30), speed=speeds)
def test_matrices(unit, n, speed):
    """(3.2), (3.10)-(3.13) with their damping."""
    for model in ("complete", "inextensional", "hybrid"):
        if n == 0 and model != "complete":
            continue
        G, K = ring.matrices(unit, n, speed, model)
        expected_G, expected_K = (matrices if model == "complete" else inextensional_matrices)(unit, n, speed)
        d = float(ring.mode_damping(unit, n, "complete" if model == "complete" else "inextensional"))
        expected_G = (0.0 if model == "hybrid" else 1.0) * expected_G + d * np.eye(len(K))
        assert np.abs(G - expected_G).max() <= 1e-13 * np.abs(expected_G).max()
        # g_1 = omega_1^2 - Omega^2 may cancel
        assert np.abs(K - expected_K).max() <= 1e-13 * (np.abs(expected_K).max() + speed**2)


@pytest.mark.parametrize("n", [0, 1, 2, 6])
@pytest.mark.parametrize("speed", [0.0, -170.0])
def test_matrices_are_the_energies(n, speed):
    """The complete model's, from Lagrange's equations of the energies of section 2, wheel held."""
    unit = TABLE_1.replace(zeta_1=0.1, zeta_n=0.3)
    reference = Lagrangian(unit, [n])
    M = np.diag(reference.M)[:-1]
    stiffness = reference.K + speed**2 * (reference.K_spin - reference.NN) + reference.springs[0, 0]
    rates = reference.damping + speed * (reference.PN - reference.PN.T)
    there = [0, 2] if n == 0 else [0, 1, 2, 3]  # n = 0 has no sine coordinates of its own
    for found, expected in zip(ring.matrices(unit, n, speed), (rates, stiffness), strict=True):
        expected = expected[:-1, :-1] / M[:, None]
        assert np.abs(found[np.ix_(there, there)] - expected).max() <= 1e-12 * np.abs(expected).max()


@given(unit=units(), n=st.integers(0, 30), speed=speeds, model=st.sampled_from(["complete", "inextensional", "hybrid"]))
def test_frequencies_seen_from_the_fixed_frame(unit, n, speed, model):
    """exp(i w t) of z = alpha + i beta turns on by n phi: w + n Omega, of each root w of the ring's polynomial."""
    if model == "complete":
        coefficients = complete(unit, n, speed)
    else:
        n = max(n, 2)
        coriolis, g = inextensional(unit, n, speed)
        coefficients = 1, 0 if model == "hybrid" else coriolis, -g
    roots = [float(root) for root in real_roots(*coefficients)]
    expected = np.sort(np.abs(np.array(roots) + n * speed))
    half = len(roots)
    found = ring.natural_frequencies(unit, n, speed, model, frame="fixed")
    assert found.shape == (half,) and (np.diff(found) >= 0.0).all()
    # the root of an eigenvalue, which is known to some 1e-16 of the largest: two that coincide to its root
    assert np.abs(found - expected).max() <= 1e-7 * (max(map(abs, roots)) + abs(n * speed))


def test_the_two_frames_agree_at_standstill_and_at_n_0():
    for n in (0, 2, 5):
        assert np.array_equal(*(ring.natural_frequencies(TABLE_1, n, frame=frame) for frame in ("ring", "fixed")))
    assert np.array_equal(*(ring.natural_frequencies(TABLE_1, 0, 90.0, frame=frame) for frame in ("ring", "fixed")))


def test_a_hybrid_ring_that_diverges_has_frequency_zero():
    """n = 1 without Coriolis: only the centrifugal force is left beside the sidewall, and beats it at omega_1."""
    omega_1 = TABLE_1.rigid_mode_frequency
    assert (ring.natural_frequencies(TABLE_1, 1, 0.99 * omega_1, "hybrid") > 0.0).all()
    assert (ring.natural_frequencies(TABLE_1, 1, 1.01 * omega_1, "hybrid") == 0.0).all()


@settings(max_examples=40)
@given(unit=units(), n=st.integers(0, 30), speed=speeds, model=st.sampled_from(["complete", "inextensional", "hybrid"]))
def test_mode_shapes(unit, n, speed, model):
    """z = shape exp(lambda t) moves freely: the damped equations of section 2 of docs/model.md, in complex form."""
    n = n if model == "complete" else max(n, 2)
    exponents, shapes = ring.mode_shapes(unit, n, speed, model)
    count = 4 if model == "complete" else 2
    assert exponents.shape == (count,) and shapes.shape == (count, 2)
    assert (np.diff(exponents.imag) >= 0.0).all()
    assert np.abs(shapes).max(axis=1) == pytest.approx(np.ones(count), rel=1e-14)
    A, B, C = (float(value) for value in paper_coefficients(unit, n, speed))
    d = float(ring.mode_damping(unit, n, "complete" if model == "complete" else "inextensional"))
    for s, (z_1, z_2) in zip(exponents, shapes, strict=True):
        # z_1 = alpha + i beta, z_2 = xi + i eta of (3.2)
        radial = [(s * s + d * s + B) * z_1, -(2.0 * speed * s + 1j * A) * z_2]
        tangential = [(s * s + d * s + C) * z_2, (2.0 * speed * s + 1j * A) * z_1]
        if model == "complete":
            for terms in (radial, tangential):
                # an eigenvector is known to 1e-16 of the largest term, over the distance of its eigenvalue
                assert abs(sum(terms)) <= 1e-10 * (abs(s) ** 2 + B + C)
        else:
            assert z_2 == pytest.approx(-1j * z_1 / n, rel=1e-14)
            coriolis = 0.0 if model == "hybrid" else 2.0 * speed * (C + n * A) / (A + n * C)
            g = n * (B * C - A * A) / (A + n * C)
            assert abs(s * s + (d + 1j * coriolis) * s + g) <= 1e-8 * abs(g)  # B C - A^2 in doubles here
    seen, same = ring.mode_shapes(unit, n, speed, model, frame="fixed")
    assert np.sort_complex(seen) == pytest.approx(np.sort_complex(exponents + 1j * n * speed), rel=1e-12)
    assert same.shape == shapes.shape


def test_undamped_mode_shapes_have_the_natural_frequencies():
    unit = TABLE_1.replace(zeta_1=0.0, zeta_n=0.0)
    for n, speed in ((0, 120.0), (1, 50.0), (3, -200.0)):
        for frame in ("ring", "fixed"):
            exponents, _ = ring.mode_shapes(unit, n, speed, frame=frame)
            expected = ring.natural_frequencies(unit, n, speed, frame=frame)
            assert np.sort(np.abs(exponents.imag)) == pytest.approx(expected, rel=1e-10)
            assert np.abs(exponents.real).max() <= 1e-10 * expected.max()


# -- any point force --------------------------------------------------------------------------------------------


def test_point_force_at_rest_against_the_energies():
    """Static deflection by all modes to n = 6, wheel held: K q = Q of Lagrange's equations, at any angle."""
    numbers, psi = range(7), np.linspace(0.0, 6.0, 13)
    unit = TABLE_1.replace(contact_half_angle=0.3)
    reference = Lagrangian(unit, numbers)
    K = (reference.K + reference.springs[0, 0])[:-1, :-1]
    q = np.append(np.linalg.solve(K, reference.push(0.0, -2000.0, 700.0, 4.0)[:-1]), 0.0)
    expected = [shape @ q for shape in reference.shapes(psi)]
    found = ring.point_force_response(unit, 0.0, -2000.0, 700.0, psi, angle=4.0, numbers=numbers, model="complete")
    # membrane 1e3 times as stiff as what bends
    assert np.abs(np.array(found) - expected).max() <= 1e-11 * np.abs(expected).max()


@settings(max_examples=20)
@given(
    unit=units(), speed=speeds, angle=st.floats(-10.0, 10.0), turn=st.floats(-3.0, 3.0),
    model=st.sampled_from(["inextensional", "hybrid", "complete"]),
)  # fmt: skip
def test_the_ring_is_round(unit, speed, angle, turn, model):
    """A force further on has the same response further on; and responses add up."""
    psi = np.linspace(0.0, 6.0, 7)

    def response(radial, tangential, angle, psi, numbers=range(2, 8)):
        return np.array(ring.point_force_response(
            unit, speed, radial, tangential, psi, angle=angle, numbers=numbers, model=model
        ))  # fmt: skip

    here, there = response(1e3, -400.0, angle, psi), response(1e3, -400.0, angle + turn, psi + turn)
    scale = np.abs(here).max()
    assert np.abs(here - there).max() <= 1e-11 * scale  # angles of up to 7 * 20, rounded, and sharp resonances
    parts = response(1e3, 0.0, angle, psi) + response(0.0, -400.0, angle, psi)
    halves = response(1e3, -400.0, angle, psi, [2, 5]) + response(1e3, -400.0, angle, psi, [3, 4, 6, 7])
    assert np.abs(here - parts).max() <= 1e-12 * np.abs(parts).max() + 1e-12 * scale
    assert np.abs(here - halves).max() <= 1e-12 * np.abs(halves).max() + 1e-12 * scale


@given(unit=units(), here=st.floats(0.0, 6.0), there=st.floats(0.0, 6.0))
@settings(max_examples=20)
def test_reciprocity_at_rest(unit, here, there):
    """Maxwell: what a unit force at one place does at another, along each direction, the other does here."""

    def compliance(at, seen):
        return np.array([
            ring.point_force_response(unit, 0.0, *force, seen, angle=at, numbers=range(9), model="complete")
            for force in ((1.0, 0.0), (0.0, 1.0))
        ])  # fmt: skip

    forth, back = compliance(here, there), compliance(there, here)
    # sums of nine modes; the determinant of each cancels two digits
    assert np.abs(forth - back.T).max() <= 1e-10 * np.abs(compliance(here, here)).max()


def test_steady_response_is_that_of_a_load_at_the_contact():
    psi = np.linspace(0.0, 6.0, 11)
    for model in ("inextensional", "hybrid", "complete"):
        load = ring.steady_response(TABLE_1, 120.0, 1500.0, psi, n_max=12, model=model)
        force = ring.point_force_response(
            TABLE_1, 120.0, -1500.0, 0.0, psi, angle=1.5 * math.pi, numbers=range(2, 13), model=model
        )  # fmt: skip
        assert np.array_equal(load, force)


DRIVE = Drive([0.0, 0.004, 0.01], [-80.0, -80.0, -80.0], [0.0, 3e3, -1e3], [500.0, -2e3, 0.0])


@pytest.mark.parametrize("model", ["inextensional", "complete"])
def test_transient_response_against_the_energies(model):
    """From rest at constant speed, all modes of the model to n = 5, wheel held, at another angle than the contact's."""
    numbers, psi = (range(2, 6) if model == "inextensional" else range(6)), np.linspace(0.0, 6.0, 9)
    reference = Lagrangian(TABLE_1, numbers, model)
    states = reference.run(DRIVE, angle=0.4, held=True)
    expected = np.array(
        [reference.belt(z, DRIVE.at(t)[0], psi) for z, t in zip(states, DRIVE.t, strict=True)]
    ).swapaxes(0, 1)
    found = ring.transient_response(
        TABLE_1, DRIVE.t, -80.0, DRIVE.radial, DRIVE.tangential, psi, angle=0.4, numbers=numbers, model=model
    )  # fmt: skip
    # rtol 1e-12 per step of DOP853
    assert np.abs(np.array(found) - expected).max() <= 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("model", ["inextensional", "complete", "hybrid"])
@pytest.mark.parametrize("speed", [0.0, 130.0, -60.0])
def test_transient_response_comes_to_the_steady_one_and_stays(model, speed):
    """After 10 s, from rest, exp(-0.02 * 480 * 10) of it is left."""
    psi, numbers = np.linspace(0.0, 6.0, 9), range(2, 9)
    steady = np.array(ring.point_force_response(TABLE_1, speed, -3e3, 500.0, psi, numbers=numbers, model=model))
    for steady_start in (False, True):
        found = np.array(ring.transient_response(
            TABLE_1, [0.0, 5.0, 10.0], speed, -3e3, 500.0, psi, numbers=numbers, model=model, steady_start=steady_start
        ))  # fmt: skip
        assert found.shape == (2, 3, 9)
        assert np.abs(found[:, -1] - steady).max() <= 1e-9 * np.abs(steady).max()
        if steady_start:
            assert np.abs(found - steady[:, None]).max() <= 1e-11 * np.abs(steady).max()
        else:
            assert not found[:, 0].any()


# -- arguments --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: ring.natural_frequencies(TABLE_1, -1), "n is -1"),
        (lambda: ring.natural_frequencies(TABLE_1, 2.5), "n is 2.5"),
        (lambda: ring.natural_frequencies(TABLE_1, math.nan), "n"),
        (lambda: ring.natural_frequencies(TABLE_1, math.inf), "n is inf"),
        (lambda: ring.natural_frequencies(TABLE_1, 0, model="inextensional"), "n is 0"),
        (lambda: ring.natural_frequencies(TABLE_1, 2, model="rigid"), "model is 'rigid'"),
        (lambda: ring.natural_frequencies(TABLE_1, 2, math.inf), "speed is inf"),
        (lambda: ring.natural_frequencies(TABLE_1, 2, frame="wheel"), "frame is 'wheel'"),
        (lambda: ring.matrices(TABLE_1, 0, model="hybrid"), "n is 0"),
        (lambda: ring.matrices(TABLE_1, 2, model="rigid"), "model is 'rigid'"),
        (lambda: ring.mode_shapes(TABLE_1, 1, model="inextensional"), "n is 1"),
        (lambda: ring.mode_shapes(TABLE_1, 2, math.nan), "speed is nan"),
        (lambda: ring.mode_shapes(TABLE_1, 2, frame="wheel"), "frame is 'wheel'"),
        (lambda: ring.point_force_response(TABLE_1, 1.0, math.nan, 0.0, 0.0), "radial is nan"),
        (lambda: ring.point_force_response(TABLE_1, 1.0, 0.0, math.inf, 0.0), "tangential is inf"),
        (lambda: ring.point_force_response(TABLE_1, 1.0, 0.0, 0.0, 0.0, angle=math.nan), "angle is nan"),
        (lambda: ring.point_force_response(TABLE_1, 1.0, 0.0, 0.0, 0.0, numbers=[1]), "numbers is"),
        (lambda: ring.transient_response(TABLE_1, [0.0, 0.0], 1.0, 0.0, 0.0, [0.0]), "time"),
        (lambda: ring.transient_response(TABLE_1, [], 1.0, 0.0, 0.0, [0.0]), "time"),
        (lambda: ring.transient_response(TABLE_1, [0.0, 1.0], [1.0], 0.0, 0.0, [0.0]), r"speed has shape \(1,\)"),
        (lambda: ring.transient_response(TABLE_1, [0.0, 1.0], 1.0, math.nan, 0.0, [0.0]), "radial"),
        (lambda: ring.steady_response(TABLE_1, math.nan, 1.0, 0.0), "speed is nan"),
        (lambda: ring.steady_response(TABLE_1, 1.0, math.nan, 0.0), "load is nan"),
        (lambda: ring.steady_response(TABLE_1, 1.0, 1.0, 0.0, n_max=1), "is 1"),
        (lambda: ring.steady_response(TABLE_1, 1.0, 1.0, 0.0, model="rigid"), "model is 'rigid'"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_wrong_arguments(call, words):
    with pytest.raises(ValueError, match=words):
        call()
