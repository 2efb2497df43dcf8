"""Printed numbers: what Huang & Hsu (1992) and docs/model.md, section 12, give for the tire of Table 1.

S. C. Huang and B. S. Hsu, "An approach to the dynamic analysis of rotating tire-wheel-suspension units",
Journal of Sound and Vibration 156(3), 1992, 505-519. Every expected value is a printed one, and its tolerance is
half a unit in its last digit, unless the source only says "near".
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from tire_dynamics import TireWheelUnit, ring, simulate, wheel

RPM = math.pi / 30.0  # rad/s
LOAD = 1961.33  # N: 200 kgf, the paper's load


def printed(text):
    """A printed number, to half a unit in its last digit."""
    _, _, decimals = text.partition(".")
    return pytest.approx(float(text), rel=0.0, abs=0.5 * 10.0 ** -len(decimals))


@pytest.fixture(scope="module")
def unit():
    return TireWheelUnit.table_1()


# -- Table 1 and what follows from it ---------------------------------------------------------------------------


def test_table_1():
    """Table 1 of the paper."""
    unit = TireWheelUnit.table_1()
    assert (unit.density, unit.bending_stiffness, unit.membrane_stiffness) == (1.59e3, 2.175e1, 1.618e6)
    assert (unit.radius, unit.width, unit.thickness) == (0.305, 0.152, 0.0127)
    assert (unit.radial_stiffness, unit.tangential_stiffness) == (5.80e6, 4.03e6)
    assert (unit.inflation_pressure, unit.wheel_mass, unit.suspension_stiffness) == (2.07e5, 8.78, 3.60e4)
    assert (unit.zeta_1, unit.zeta_s, unit.zeta_n, unit.sidewall_damping) == (0.05, 0.05, 0.02, "modal")


def test_bending_stiffness_of_table_1(unit):
    """Table 1: D = K h^2/12 = 2.175e1 N m, in four digits."""
    assert unit.membrane_stiffness * unit.thickness**2 / 12.0 == pytest.approx(21.75, rel=0.0, abs=0.005)
    assert unit.bending_stiffness == 21.75


def test_derived_quantities(unit):
    """Section 12: ring mass, sidewall stiffness, rigid mode."""
    assert unit.ring_mass == printed("5.88198809")
    assert unit.sidewall_stiffness == printed("1431682.834")
    assert unit.rigid_mode_frequency == printed("493.3570498")
    assert unit.rigid_mode_frequency / (2.0 * math.pi) == printed("78.5202132")


# -- natural frequencies ----------------------------------------------------------------------------------------

FREQUENCIES = [  # n, complete lower, complete upper, inextensional [Hz]; section 12
    (0, "76.8546", "173.0465", None),
    (1, "78.3533", "230.7372", "78.5202"),
    (2, "91.1550", "348.8396", "91.7443"),
    (3, "112.1447", "485.0226", "112.5610"),
    (4, "137.6736", "627.7653", "137.9976"),
    (5, "166.2970", "773.4780", "166.5680"),
]


@pytest.mark.parametrize(("n", "lower", "upper", "inextensional"), FREQUENCIES)
def test_natural_frequencies_at_rest(unit, n, lower, upper, inextensional):
    """Section 12: natural frequencies at rest, wheel held; at rest each is a pair."""
    hertz = ring.natural_frequencies(unit, n) / (2.0 * math.pi)
    assert hertz.tolist() == [printed(lower), printed(lower), printed(upper), printed(upper)]
    if inextensional is not None:
        for model in ("inextensional", "hybrid"):  # at rest there is no Coriolis term to leave out
            hertz = ring.natural_frequencies(unit, n, model=model) / (2.0 * math.pi)
            assert hertz.tolist() == [printed(inextensional), printed(inextensional)]


# -- transmissibility and horizontal force ----------------------------------------------------------------------

TRANSMISSIBILITY = [  # zeta_1, rpm, K; section 12
    (0.05, 1000.0, "0.981963"),
    (0.05, 2000.0, "0.931556"),
    (0.05, 4000.0, "0.772863"),
    (0.2, 2000.0, "0.459652"),
]


@pytest.mark.parametrize(("zeta_1", "rpm", "expected"), TRANSMISSIBILITY)
def test_transmissibility(unit, zeta_1, rpm, expected):
    """Section 12: steady K, in closed form and as the force of a simulated steady state."""
    damped = unit.replace(zeta_1=zeta_1)
    assert wheel.transmissibility(damped, rpm * RPM) == printed(expected)
    assert wheel.transmissibility(damped, -rpm * RPM) == printed(expected)
    response = simulate(damped, [0.0, 1.0], rpm * RPM, LOAD)
    assert (response.axle_force[:, 1] / LOAD).tolist() == [printed(expected)] * 2


def test_horizontal_force_of_modal_damping(unit):
    """Section 12: +3162.18 N at x_ros at 2000 rpm under 1961.33 N, with no traction at all."""
    response = simulate(unit, [0.0, 1.0], 2000.0 * RPM, LOAD)
    assert response.axle_force[:, 0].tolist() == [printed("3162.18")] * 2
    assert simulate(unit, [0.0], -2000.0 * RPM, LOAD).axle_force[0, 0] == printed("-3162.18")


# -- steady flexural response -----------------------------------------------------------------------------------


def second_harmonic(unit, rpm, model="inextensional"):
    """Amplitude [mm] and lag angle [deg] of u_z = -amplitude cos(2 (psi - psi_0) - 2 lag), (4.5), n = 2 alone."""
    from_contact = 2.0 * math.pi * np.arange(16) / 16
    u_z, _ = ring.steady_response(unit, rpm * RPM, LOAD, ring.CONTACT_ANGLE + from_contact, n_max=2, model=model)
    coefficient = -np.mean(u_z * np.exp(2j * from_contact)) * 2.0  # amplitude exp(i phase)
    return 1e3 * abs(coefficient), math.degrees(np.angle(coefficient)) / 2.0


def test_second_harmonic_at_rest(unit):
    """Section 12: 1.613798 mm straight under the load."""
    amplitude, lag = second_harmonic(unit, 0.0)
    assert amplitude == printed("1.613798")
    assert lag == pytest.approx(0.0, abs=1e-12)  # rounding of the sum above, in degrees


def test_second_harmonic_at_1600_rpm(unit):
    """Section 12: 1.610579 mm at a lag angle of 0.668803 deg."""
    amplitude, lag = second_harmonic(unit, 1600.0)
    assert (amplitude, lag) == (printed("1.610579"), printed("0.668803"))
    amplitude, lag = second_harmonic(unit, -1600.0)  # rolling backward is the mirror image
    assert (amplitude, lag) == (printed("1.610579"), printed("-0.668803"))


def test_second_harmonic_without_coriolis(unit):
    """Section 12: hybrid model, 2.211160 mm at 1600 rpm."""
    assert second_harmonic(unit, 1600.0, "hybrid")[0] == printed("2.211160")


# -- stability --------------------------------------------------------------------------------------------------


def test_multipliers(unit):
    """Section 12: |mu| at zeta_1 = zeta_s = 0.05 and 2000 rpm, each twice."""
    moduli = np.sort(np.abs(wheel.stability(unit, 2000.0 * RPM).multipliers))
    expected = [printed(text) for text in ("0.476304", "0.476304", "0.613536", "0.613536", "0.687992", "0.687992")]
    assert moduli.tolist() == expected


@pytest.mark.parametrize(("zeta_1", "rpm"), [(0.5, 4350.0), (0.1, 12100.0), (0.05, 22400.0), (0.02, 56150.0)])
def test_loss_of_stability(unit, zeta_1, rpm):
    """Section 12, and the shape of the paper's Figure 7: "near" these speeds, printed to 50 rpm."""
    assert wheel.critical_speed(unit.replace(zeta_1=zeta_1)) / RPM == pytest.approx(rpm, rel=0.0, abs=50.0)


@pytest.mark.parametrize(("zeta_1", "rpm"), [(0.02, "29965"), (0.05, "13035"), (0.1, "7986"), (0.5, "5417")])
def test_loss_of_stability_with_reaction(unit, zeta_1, rpm):
    """Section 12: sidewall damping with a reaction, zeta_s = 0.05."""
    changed = unit.replace(zeta_1=zeta_1, sidewall_damping="reaction")
    assert wheel.critical_speed(changed) / RPM == printed(rpm)
    before, after = (wheel.stability(changed, (float(rpm) + step) * RPM) for step in (-1.0, 1.0))
    assert (before.verdict, after.verdict) == ("asymptotically stable", "unstable")
