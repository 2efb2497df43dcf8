"""The ring against its equations of motion, written out here as the paper has them."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from tire_dynamics import TireWheelUnit, ring

TABLE_1 = TireWheelUnit.table_1()


@st.composite
def units(draw):
    """Tires around Table 1: every stiffness, mass and length by a factor of up to four either way."""
    factor = st.floats(-2.0, 2.0).map(lambda x: 2.0**x)
    changes = {
        name: getattr(TABLE_1, name) * draw(factor)
        for name in (
            "density", "bending_stiffness", "membrane_stiffness", "radius", "width", "thickness",
            "radial_stiffness", "tangential_stiffness", "inflation_pressure", "wheel_mass", "suspension_stiffness",
        )
    }  # fmt: skip
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


def companion_frequencies(G, K):
    """Frequencies of x'' + G x' + K x = 0 from its first-order form, states scaled to one size."""
    size = math.sqrt(np.abs(K).max())
    one, zero = np.eye(len(K)), np.zeros_like(K)
    values = np.linalg.eigvals(np.block([[-G / size, -K / size**2], [one, zero]])) * size
    return np.sort(values.imag[values.imag > 0.0]), np.abs(values.real).max()


# A frequency is the root of an eigenvalue, known to 1e-16 of the largest nu^2: relatively to its own square, with
# nu_max/nu up to some hundred at n = 30, that is 1e-12; the eight companion eigenvalues may be ten times worse.


@given(unit=units(), n=st.integers(0, 30), speed=speeds)
def test_complete_frequencies(unit, n, speed):
    found = ring.natural_frequencies(unit, n, speed)
    expected, growth = companion_frequencies(*matrices(unit, n, speed))
    assert found.shape == (4,) and (np.diff(found) >= 0.0).all()
    assert np.abs(found**2 - expected**2).max() <= 1e-12 * expected[-1] ** 2
    assert growth <= 1e-6 * expected[-1]  # real frequencies: the ring itself is stable (two may coincide: root of eps)


def inextensional_matrices(unit, n, W):
    """(3.10), (3.11) without damping, x = [alpha, beta]; n = 1 by (3.13)."""
    if n == 1:
        coriolis = 2.0 * W
        g = (unit.radial_stiffness + unit.tangential_stiffness) / (2.0 * unit.density * unit.thickness) - W * W
    else:
        A, B, C = paper_coefficients(unit, n, W)
        g = float(n * (B * C - A * A) / (A + n * C))
        coriolis = float(2 * Fraction(W) * (C + n * A) / (A + n * C))
    return coriolis * np.array([[0.0, -1.0], [1.0, 0.0]]), g * np.eye(2)


@given(unit=units(), n=st.integers(1, 30), speed=speeds)
def test_inextensional_frequencies(unit, n, speed):
    found = ring.natural_frequencies(unit, n, speed, "inextensional")
    expected, _ = companion_frequencies(*inextensional_matrices(unit, n, speed))
    assert found.shape == (2,)
    # at n = 1 the two are omega_1 -+ Omega: they may meet zero, where only the larger one's digits count
    tolerance = 1e-7 if n == 1 else 1e-12
    if len(expected) == 2:
        assert np.abs(found - expected).max() <= tolerance * expected[-1]
    else:
        assert n == 1 and found[0] <= 1e-6 * found[1]


@given(unit=units(), n=wavenumbers, speed=speeds)
def test_hybrid_frequencies(unit, n, speed):
    """No Coriolis term, centrifugal terms kept: sqrt(g_n), twice."""
    _, K = inextensional_matrices(unit, n, speed)
    assert ring.natural_frequencies(unit, n, speed, "hybrid") == pytest.approx([math.sqrt(K[0, 0])] * 2, rel=1e-14)


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
    cosine, sine = ring.steady_amplitudes(unit, n, speed, load, traction)
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
    cosine, sine = ring.steady_amplitudes(unit, n, speed, 1000.0, model="hybrid")
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
    cosine, sine = ring.steady_amplitudes(unit, n, 0.0, 1000.0)
    assert float(cosine) == pytest.approx(float(alpha), rel=1e-14)
    assert float(sine) == 0.0


def test_symmetric_about_the_load_at_rest_only():
    offset = np.linspace(0.1, 3.0, 12)
    for speed in (0.0, 150.0):
        (right, along), (left, against) = (
            ring.steady_response(TABLE_1, speed, 1961.33, ring.CONTACT_ANGLE + side * offset) for side in (1.0, -1.0)
        )
        skew = np.abs(right - left).max() / np.abs(right).max()
        if speed == 0.0:
            assert skew < 1e-12  # rounding of thirty cosines and of 3 pi/2
            assert along == pytest.approx(-against, abs=1e-15)
        else:
            assert skew > 1e-3


@given(unit=units(), speed=speeds)
def test_rolling_backward_is_the_mirror_image(unit, speed):
    offset = np.linspace(0.0, 3.0, 7)
    u_z, u_theta = ring.steady_response(unit, speed, 1000.0, ring.CONTACT_ANGLE + offset)
    mirrored = ring.steady_response(unit, -speed, 1000.0, ring.CONTACT_ANGLE - offset)
    scale = np.abs(u_z).max() + np.abs(mirrored[0]).max()
    assert np.abs(u_z - mirrored[0]).max() <= 1e-12 * scale
    assert np.abs(u_theta + mirrored[1]).max() <= 1e-12 * scale


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
