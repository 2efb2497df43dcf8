"""The figures: their numbers against the paper's statements, closed forms and other routes; the files they become."""

from __future__ import annotations

import csv
import functools
import io
import json
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from scipy.integrate import solve_ivp

from tire_dynamics import TireWheelUnit, floquet, ring, wheel
from tire_dynamics.cli import figures as command
from tire_dynamics.cli.figures import FIGURES
from tire_dynamics.cli.main import main
from tire_dynamics.figures import tables
from tire_dynamics.files.errors import InputError
from tire_dynamics.science import campbell, nonuniform
from tire_dynamics.science.modes import RingModes

RPM = np.pi / 30.0
LOAD = 1961.33  # 200 kgf [N]
UNIT = TireWheelUnit.table_1()


@functools.cache
def table(name: str) -> tables.Table:
    return getattr(tables, name)()


def at(name: str, abscissa: float) -> dict[str, float]:
    """The row at a value of the first column."""
    columns = table(name)
    [row] = np.flatnonzero(np.isclose(next(iter(columns.values())), abscissa, rtol=1e-9, atol=1e-12))
    return {column: values[row] for column, values in columns.items()}


def flexural(unit: TireWheelUnit, n: int, speed: float, model: str) -> tuple[float, float, float]:
    """R_n, I_n [1/s^2] and F_n of (4.4) per newton [1/(kg s^2) m], written as they stand in docs/model.md."""
    a, mass = unit.radius, unit.density * unit.thickness

    def coefficients(omega: float) -> tuple[float, float, float]:
        sigma = omega**2 + unit.inflation_pressure / (mass * a)
        bending, membrane = unit.bending_stiffness / a**4, unit.membrane_stiffness / a**2
        pressure = unit.inflation_pressure / a
        A = (n**3 * bending + n * membrane) / mass + 2 * n * sigma
        B = (n**4 * bending + membrane + unit.radial_stiffness + pressure) / mass + n**2 * sigma
        C = (n**2 * bending + n**2 * membrane + unit.tangential_stiffness + pressure) / mass + n**2 * sigma
        return A, B, C

    A, B, C = coefficients(0.0)
    d = 2.0 * unit.zeta_n * np.sqrt(n * (B * C - A**2) / (A + n * C))
    A, B, C = coefficients(speed)
    coriolis = 0.0 if model == "hybrid" else 2.0 * speed * (C + n * A) / (A + n * C)
    R = n * (B * C - A**2) / (A + n * C) + n * speed * coriolis - (n * speed) ** 2
    return R, d * n * speed, n * C / ((A + n * C) * np.pi * a * unit.width * mass)


# -- Figure 3: steady deflection around the belt --


@pytest.mark.parametrize(
    ("model", "rpm", "amplitude", "lag"),
    [
        ("inextensional", 0, 1.613798, 0.0),
        ("inextensional", 1600, 1.610579, 0.668803),
        ("hybrid", 1600, 2.211160, None),
    ],
)
def test_fig3_holds_the_reference_amplitudes_of_n_2(model, rpm, amplitude, lag):
    theta = np.radians(table("fig3")["angle_from_contact_deg"])[:-1]  # the last angle is the first again
    u_z = table("fig3")[f"u_z_{model}_{rpm}_rpm_zeta_n_0.02_mm"][:-1]
    harmonic = -2.0 * np.mean(u_z * np.exp(-2j * theta))  # amplitude exp(-i phase)
    assert abs(harmonic) == pytest.approx(amplitude, abs=6e-7)  # the last digit given
    if lag is not None:
        assert -np.degrees(np.angle(harmonic)) / 2.0 == pytest.approx(lag, abs=6e-7)


@pytest.mark.parametrize("zeta_n", [0.02, 0.2])
@pytest.mark.parametrize("model", ["inextensional", "hybrid"])
def test_fig3_is_symmetric_about_the_contact_at_standstill_only(model, zeta_n):
    def asymmetry(rpm: int) -> float:
        radial, tangential = (
            table("fig3")[f"{name}_{model}_{rpm}_rpm_zeta_n_{zeta_n}_mm"] for name in ("u_z", "u_theta")
        )
        return float(max(np.abs(radial - radial[::-1]).max(), np.abs(tangential + tangential[::-1]).max()))

    assert asymmetry(0) < 1e-12  # rounding of a few mm
    assert 1e-3 < asymmetry(800) < asymmetry(1600) < asymmetry(3600)


@pytest.mark.parametrize("zeta_n", [0.02, 0.2])
@pytest.mark.parametrize("rpm", [800, 3600])
def test_fig3_is_the_closed_series(rpm, zeta_n):
    """(4.3)-(4.5), summed by hand from docs/model.md."""
    angle = np.radians(table("fig3")["angle_from_contact_deg"])
    for model in ("inextensional", "hybrid"):
        u_z, u_theta = np.zeros((2, angle.size))
        for n in range(2, 31):
            R, damping, force = flexural(UNIT.replace(zeta_n=zeta_n), n, rpm * RPM, model)
            size, phase = 1e3 * LOAD * force / np.hypot(R, damping), np.arctan2(damping, R)
            u_z -= size * np.cos(n * angle - phase)
            u_theta += size / n * np.sin(n * angle - phase)
        for name, expected in (("u_z", u_z), ("u_theta", u_theta)):
            values = table("fig3")[f"{name}_{model}_{rpm}_rpm_zeta_n_{zeta_n}_mm"]
            np.testing.assert_allclose(values, expected, rtol=0.0, atol=1e-7)  # B C - A^2 as it stands: six digits


@pytest.mark.parametrize(("zeta_n", "lag"), [(0.02, 0.4), (0.2, 3.9)])
def test_fig3_the_lag_can_be_seen_at_the_damping_of_the_text_only(zeta_n, lag):
    """At 3600 rpm the deepest place of the rotating tire is that of the closed series, and as far as the page says."""
    from scipy.optimize import minimize_scalar

    terms = [flexural(UNIT.replace(zeta_n=zeta_n), n, 3600 * RPM, "inextensional") for n in range(2, 31)]

    def inward(angle):
        return sum(
            -force / np.hypot(R, damping) * np.cos(n * angle - np.arctan2(damping, R))
            for n, (R, damping, force) in enumerate(terms, 2)
        )

    deepest = np.degrees(minimize_scalar(inward, bounds=(0.0, 0.2), method="bounded", options={"xatol": 1e-7}).x)
    assert deepest == pytest.approx(lag, abs=0.05)  # the last digit of docs/figures.md
    u_z = table("fig3")[f"u_z_inextensional_3600_rpm_zeta_n_{zeta_n}_mm"]
    drawn = table("fig3")["angle_from_contact_deg"][np.argmin(u_z)]
    assert abs(drawn - deepest) <= 0.25  # half a step of the table


def test_fig3_rotation_hardly_changes_the_deflection_unless_coriolis_is_left_out():
    static = table("fig3")["u_z_inextensional_0_rpm_zeta_n_0.02_mm"]
    largest = np.abs(static).max()
    np.testing.assert_array_equal(static, table("fig3")["u_z_hybrid_0_rpm_zeta_n_0.02_mm"])
    for rpm in (800, 1600, 3600):
        rotating, hybrid = (
            np.abs(table("fig3")[f"u_z_{m}_{rpm}_rpm_zeta_n_0.02_mm"]).max() for m in ("inextensional", "hybrid")
        )
        assert rotating == pytest.approx(largest, rel=0.01)  # "nearly cancel"
        assert hybrid > 1.03 * largest
    assert hybrid > 2.0 * largest  # beyond the first two critical speeds


# -- Figure 4: amplitude, lag, and the critical speeds of the hybrid --


@pytest.mark.parametrize("model", ["inextensional", "hybrid"])
@pytest.mark.parametrize("n", [2, 3, 4])
def test_fig4_is_the_closed_form(model, n):
    unit = UNIT.replace(zeta_n=0.2)
    stiffness, damping, force = np.array([flexural(unit, n, rpm * RPM, model) for rpm in table("fig4")["speed_rpm"]]).T
    amplitude = force / np.hypot(stiffness, damping)
    close = {"rtol": 1e-9, "atol": 1e-9}  # B C - A^2 formed as it stands loses six digits
    np.testing.assert_allclose(table("fig4")[f"amplitude_ratio_{model}_n_{n}"], amplitude / amplitude[0], **close)
    lag = np.degrees(np.arctan2(damping, stiffness)) / n
    np.testing.assert_allclose(table("fig4")[f"lag_{model}_n_{n}_deg"], lag, **close)
    ratio = stiffness / force
    np.testing.assert_allclose(table("fig4")[f"stiffness_ratio_{model}_n_{n}"], ratio / ratio[0], **close)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_fig4_the_full_model_has_no_critical_speed(n):
    np.testing.assert_allclose(table("fig4")[f"stiffness_ratio_inextensional_n_{n}"], 1.0, atol=0.05)  # "nearly cancel"
    assert n * table("fig4")[f"lag_inextensional_n_{n}_deg"].max() < 90.0  # the phase of resonance
    assert (np.diff(table("fig4")[f"amplitude_ratio_inextensional_n_{n}"]) < 0.0).all()


@pytest.mark.parametrize("n", [2, 3, 4])
def test_fig4_the_hybrid_has_one_critical_speed_per_mode(n):
    speed = table("fig4")["speed_rpm"]
    stiffness = table("fig4")[f"stiffness_ratio_hybrid_n_{n}"]
    assert (np.diff(stiffness) < 0.0).all() and stiffness[-1] < 0.0  # one zero
    critical = tables.hybrid_critical_speed(UNIT, n) / RPM
    before = np.searchsorted(speed, critical) - 1
    assert stiffness[before] > 0.0 > stiffness[before + 1]
    lag = np.interp(critical, speed, table("fig4")[f"lag_hybrid_n_{n}_deg"])
    assert lag == pytest.approx(90.0 / n, rel=1e-3)  # linear between samples 20 rpm apart
    assert 1.0 < table("fig4")[f"amplitude_ratio_hybrid_n_{n}"].max()


@pytest.mark.parametrize("n", range(2, 11))
def test_at_the_hybrids_critical_speed_R_n_is_zero(n):
    critical = tables.hybrid_critical_speed(UNIT, n)
    R, _, _ = flexural(UNIT, n, critical, "hybrid")
    assert abs(R) < 1e-8 * (n * critical) ** 2  # of the two terms that cancel there
    stiff = UNIT.replace(membrane_stiffness=1e6 * UNIT.membrane_stiffness)
    limit = 0.5 * float(ring.rest_frequency(stiff, n)) * np.sqrt(1.0 + 1.0 / n**2)
    assert tables.hybrid_critical_speed(stiff, n) == pytest.approx(limit, rel=1e-5)  # error of the order 1/K


# -- Figure 5: step of the load --


@pytest.mark.parametrize(("rpm", "zeta_s"), tables.FIG5_CASES)
def test_fig5_is_the_integral_of_the_ring_frame_equations(rpm, zeta_s):
    """(3.13) and (4.6) with the periodic matrix, seen from the ring; the figure's states are fixed in space."""
    unit = UNIT.replace(zeta_1=0.05, zeta_s=zeta_s)
    omega, m = rpm * RPM, unit.ring_mass

    def derivative(t, z):
        push = [LOAD / m * np.sin(omega * t), LOAD / m * np.cos(omega * t), 0.0, 0.0, 0.0, 0.0]
        return wheel.state_matrix(unit, omega, t) @ z + push

    t = table("fig5")["time_s"][:301:20]
    solution = solve_ivp(derivative, (0.0, t[-1]), np.zeros(6), t_eval=t, rtol=1e-10, atol=1e-12)
    alpha, beta, y = 1e3 * solution.y[3:]
    s, c = np.sin(omega * t), np.cos(omega * t)
    for name, expected in (("y", y), ("y_c", alpha * s + beta * c), ("x_c", alpha * c - beta * s)):
        values = table("fig5")[f"{name}_{rpm}_rpm_zeta_s_{zeta_s}_mm"][:301:20]
        np.testing.assert_allclose(values, expected, rtol=0.0, atol=1e-6)  # mm; the integration's tolerance


@pytest.mark.parametrize(("rpm", "zeta_s"), tables.FIG5_CASES)
def test_fig5_settles_where_the_closed_form_says(rpm, zeta_s):
    end = at("fig5", 1.0)
    case = f"{rpm}_rpm_zeta_s_{zeta_s}_mm"
    left = {"abs": 1e-3}  # mm; after 1 s at a decay rate of 12.5 1/s, 4e-6 of the first swing of 24 mm
    K = wheel.transmissibility(UNIT, rpm * RPM)
    y = 1e3 * K * LOAD / UNIT.suspension_stiffness
    assert end[f"y_{case}"] == pytest.approx(y, **left)
    # the sidewall springs carry to the wheel what the suspension carries
    assert end[f"y_c_{case}"] == pytest.approx(y + 1e3 * K * LOAD / UNIT.sidewall_stiffness, **left)
    x_ros = 3162.18 / UNIT.sidewall_stiffness if rpm else 0.0
    assert end[f"x_c_{case}"] == pytest.approx(-1e3 * x_ros, **left)


def test_fig5_the_ring_moves_aside_only_when_it_turns_and_rises_less():
    columns = table("fig5")
    assert np.abs(columns["x_c_0_rpm_zeta_s_0.05_mm"]).max() < 1e-9
    assert np.abs(columns["x_c_2000_rpm_zeta_s_0.05_mm"]).max() > 1.0
    for name in ("y", "y_c"):
        standing, turning = (columns[f"{name}_{rpm}_rpm_zeta_s_0.05_mm"] for rpm in (0, 2000))
        assert turning.max() < standing.max() and turning[-1] < standing[-1]


# -- Figure 6: force transmitted --


@pytest.mark.parametrize(
    ("zeta_1", "rpm", "K"),
    [(0.05, 1000, 0.981963), (0.05, 2000, 0.931556), (0.05, 4000, 0.772863), (0.2, 2000, 0.459652)],
)
def test_fig6_holds_the_reference_values(zeta_1, rpm, K):
    assert at("fig6", rpm)[f"K_zeta_1_{zeta_1}"] == pytest.approx(K, abs=6e-7)  # the last digit given
    assert at("fig6_damping", rpm)[f"K_modal_zeta_1_{zeta_1}"] == pytest.approx(K, abs=6e-7)


def test_fig6_K_falls_from_one_with_speed_and_with_damping():
    K = np.array([table("fig6")[f"K_zeta_1_{zeta_1}"] for zeta_1 in tables.FIG6_ZETA_1])
    assert (K[:, 0] == 1.0).all()
    assert (np.diff(K, axis=1) < 0.0).all()
    assert (np.diff(K[:, 1:], axis=0) < 0.0).all()


def test_fig6_with_a_reaction_the_axle_carries_the_load_and_nothing_else():
    columns = table("fig6_damping")
    for zeta_1 in tables.FIG6_ZETA_1:
        close = {"rtol": 0.0, "atol": 1e-9}  # the equilibrium solves a matrix of condition 1e2 or so
        np.testing.assert_allclose(columns[f"K_reaction_zeta_1_{zeta_1}"], 1.0, **close)
        np.testing.assert_allclose(columns[f"force_x_over_load_reaction_zeta_1_{zeta_1}"], 0.0, **close)
        np.testing.assert_allclose(columns[f"K_modal_zeta_1_{zeta_1}"], table("fig6")[f"K_zeta_1_{zeta_1}"], **close)
    forward = at("fig6_damping", 2000)["force_x_over_load_modal_zeta_1_0.05"]
    assert forward * LOAD == pytest.approx(3162.18, abs=0.006)  # the last digit given


# -- Figure 7: stable region --


@pytest.mark.parametrize(("zeta_1", "rpm"), [(0.5, 4350), (0.1, 12100), (0.05, 22400), (0.02, 56150)])
@pytest.mark.parametrize("name", ["fig7a", "fig7b"])
def test_fig7_holds_the_reference_speeds(name, zeta_1, rpm):
    assert at(name, zeta_1)["critical_speed_zeta_s_0.05_rpm"] == pytest.approx(rpm, abs=50)  # "near", to 50 rpm


@pytest.mark.slow
@pytest.mark.parametrize(("zeta_1", "rpm"), [(0.5, 5417), (0.1, 7986), (0.05, 13035), (0.02, 29965)])
def test_fig7_holds_the_reference_speeds_with_a_reaction(zeta_1, rpm):
    assert at("fig7_damping", zeta_1)["critical_speed_reaction_inextensional_rpm"] == pytest.approx(rpm, abs=0.5)


@pytest.mark.parametrize(("name", "highest"), [("fig7a", 6000), ("fig7b", 60000)])
def test_fig7_has_the_papers_axes(name, highest):
    """The speed along, the damping ratio up; the boundary is where the table has it."""
    from tire_dynamics.figures import drawings

    [ax] = getattr(drawings, name)(table(name)).axes
    assert "Speed" in ax.get_xlabel() and ax.get_xlim() == (0, highest)
    assert "zeta_1" in ax.get_ylabel() and ax.get_ylim() == (0, 0.5)
    x, y = ax.lines[0].get_data()
    np.testing.assert_array_equal(x, table(name)["critical_speed_zeta_s_0.05_rpm"])
    np.testing.assert_array_equal(y, table(name)["zeta_1"])


def test_fig5_has_the_papers_order():
    from tire_dynamics.figures import drawings

    labels = [ax.get_ylabel() for ax in drawings.fig5(table("fig5")).axes]
    assert [label.split("$")[1] for label in labels] == ["y", "x_c", "y_c"]


def test_fig7_damping_repeats_fig7():
    boundary = table("fig7_damping")["critical_speed_modal_inextensional_rpm"]
    np.testing.assert_array_equal(boundary, table("fig7a")["critical_speed_zeta_s_0.05_rpm"])


@pytest.mark.parametrize("zeta_1", [0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5])
@pytest.mark.parametrize("model", ["inextensional", "complete"])
@pytest.mark.parametrize("damping", ["modal", "reaction"])
def test_fig7_is_stable_below_the_boundary_and_unstable_above(damping, model, zeta_1):
    unit = UNIT.replace(zeta_1=zeta_1, sidewall_damping=damping)
    boundary = at("fig7_damping", zeta_1)[f"critical_speed_{damping}_{model}_rpm"]

    def verdict(rpm: float) -> str:
        return wheel.stability(unit, rpm * RPM, model).verdict

    below = [verdict(share * boundary) for share in (0.05, 0.3, 0.6, 0.9, 0.999)]
    assert below == ["asymptotically stable"] * len(below)
    above = [verdict(rpm) for rpm in [1.001 * boundary, *np.linspace(1.1 * boundary, max(60000, 1.2 * boundary), 7)]]
    assert above == ["unstable"] * len(above)


def test_fig7_damping_of_the_ring_moves_the_boundary_and_that_of_the_suspension_hardly_does():
    columns = table("fig7a")
    low, high = (columns[f"critical_speed_zeta_s_{zeta_s}_rpm"] for zeta_s in (0.05, 0.5))
    assert low.min() > 2.0 * 1500  # "far above 1500 rpm for practical damping"
    practical = columns["zeta_1"] > 0.029
    assert np.abs(np.log(high / low))[practical].max() < np.log(1.4)  # zeta_s tenfold: a factor of 1.4 at most ...
    name = "critical_speed_zeta_s_0.05_rpm"
    assert at("fig7a", 0.05)[name] > 5.0 * at("fig7a", 0.5)[name]  # ... and zeta_1 tenfold: of 5


# -- Campbell diagram --

AT_REST = {  # Hz, natural frequencies
    "inextensional": {2: 91.7443, 3: 112.5610, 4: 137.9976},
    "complete": {2: 91.1550, 3: 112.1447, 4: 137.6736},
}


@pytest.mark.parametrize("model", AT_REST)
@pytest.mark.parametrize("n", [2, 3, 4])
def test_campbell_starts_at_the_reference_frequencies(model, n):
    frequency, zeta = AT_REST[model][n], UNIT.zeta_n
    row = at("campbell", 0.0)
    for wave in ("backward", "forward"):
        for frame in ("ring", "fixed"):
            damped = row[f"{frame}_frame_{model}_n_{n}_{wave}_Hz"]
            assert damped == pytest.approx(frequency * np.sqrt(1.0 - zeta**2), abs=6e-5)  # the last digit given
        assert row[f"decay_rate_{model}_n_{n}_{wave}_1_s"] == pytest.approx(zeta * 2.0 * np.pi * frequency, rel=1e-6)


@pytest.mark.parametrize("model", AT_REST)
@pytest.mark.parametrize("n", [2, 3, 4])
def test_campbell_frequencies_differ_by_n_omega_and_no_backward_wave_stands_still(model, n):
    columns = table("campbell")
    turns = n * columns["speed_rpm"] / 60.0
    name = f"_frame_{model}_n_{n}_"
    backward, forward = (columns[f"ring{name}{wave}_Hz"] for wave in ("backward", "forward"))
    close = {"rtol": 1e-12, "atol": 1e-9}  # Hz
    np.testing.assert_allclose(columns[f"fixed{name}forward_Hz"], forward + turns, **close)
    np.testing.assert_allclose(columns[f"fixed{name}backward_Hz"], backward - turns, **close)
    assert (backward > turns).all()  # a critical speed is where they are equal
    assert (np.diff(columns[f"fixed{name}backward_Hz"]) < 0.0).all()


@pytest.mark.parametrize("n", [2, 3, 4])
def test_campbell_two_waves_share_the_damping_of_their_mode(n):
    """The roots of (3.10) add up to -(d + i D_c), at every speed."""
    both = sum(table("campbell")[f"decay_rate_inextensional_n_{n}_{wave}_1_s"] for wave in ("backward", "forward"))
    np.testing.assert_allclose(both, float(ring.mode_damping(UNIT, n)), rtol=1e-9)


@pytest.mark.parametrize("model", AT_REST)
@pytest.mark.parametrize("speed", [-400.0, 0.0, 100.0, 628.0])
@pytest.mark.parametrize("n", [2, 3, 7])
def test_undamped_waves_have_the_natural_frequencies(model, speed, n):
    modes = RingModes(UNIT.replace(zeta_n=0.0), [n], model)
    [exponents] = campbell.wave_exponents(modes, speed)
    on_ring = np.sort(np.abs(exponents.imag - n * speed))
    expected = ring.natural_frequencies(UNIT, n, speed, model)[:2]
    np.testing.assert_allclose(on_ring, expected, rtol=1e-7)  # the complete quartic has K^2-sized coefficients
    assert np.abs(exponents.real).max() < 1e-6


@pytest.mark.parametrize("model", AT_REST)
def test_campbell_n_1_agrees_with_the_periodic_system_on_the_ring(model):
    """exp((-decay + i frequency) T) is a multiplier of A(t), for each frequency on the ring, which T leaves open."""
    rpm = 3000.0
    speed, period, row = rpm * RPM, 60.0 / rpm, at("campbell", rpm)
    result = floquet.analyze(lambda t: wheel.state_matrix(UNIT, speed, t, model), period)
    for mode in ("wheel_hop", "ring_fore_aft", "ring_vertical"):
        decay = row[f"decay_rate_{model}_{mode}_1_s"]
        for side in ("plus", "minus"):
            frequency = 2.0 * np.pi * row[f"ring_frame_{model}_{mode}_{side}_Hz"]
            multiplier = np.exp((-decay + 1j * frequency) * period)
            assert np.abs(result.multipliers - multiplier).min() < 1e-8 + result.error_estimate


# -- multipliers --


def test_multipliers_hold_the_reference_moduli():
    row = at("multipliers", 2000.0)
    moduli = sorted(value for name, value in row.items() if name.endswith("modulus"))
    assert moduli == pytest.approx([0.476304, 0.613536, 0.687992], abs=6e-7)  # the last digit given


@pytest.mark.parametrize("rpm", [2000.0, 7000.0, 22000.0, 27000.0])
def test_multipliers_are_those_of_the_periodic_matrix(rpm):
    row = at("multipliers", rpm)
    result = floquet.analyze(lambda t: wheel.state_matrix(UNIT, rpm * RPM, t), 60.0 / rpm)
    drawn = np.array([row[f"{mode}_real"] + 1j * row[f"{mode}_imag"] for mode in campbell.WHEEL_MODES])
    assert result.multipliers.size == 6
    for multiplier in (*drawn, *drawn.conj()):
        assert np.abs(result.multipliers - multiplier).min() < 1e-8 + result.error_estimate
    np.testing.assert_allclose(np.abs(drawn), [row[f"{mode}_modulus"] for mode in campbell.WHEEL_MODES], rtol=1e-14)


def test_multipliers_leave_the_circle_at_the_loss_of_stability():
    columns = table("multipliers")
    largest = np.max([columns[f"{mode}_modulus"] for mode in campbell.WHEEL_MODES], axis=0)
    critical = wheel.critical_speed(UNIT) / RPM
    np.testing.assert_array_equal(largest > 1.0, columns["speed_rpm"] > critical)
    assert columns["speed_rpm"][0] < critical < columns["speed_rpm"][-1]


def test_paths_of_the_multipliers_do_not_jump():
    columns = table("multipliers")
    for mode in campbell.WHEEL_MODES:
        path = columns[f"{mode}_real"] + 1j * columns[f"{mode}_imag"]
        assert np.abs(np.diff(path)).max() < 0.1  # 10 rpm at 2000 rpm turn omega T = 20 rad by 0.1 rad


# -- tongues --


@pytest.mark.slow
def test_tongues_are_those_of_floquet_analysis():
    """Points on the slopes and beside them, by the slow path; half a turn is a period in the fixed frame."""
    speed = table("tongues")["speed_rpm"]
    for zeta, eps, rpm in ((0.0, tables.TONGUE_EPS[15], 4725), (0.0, tables.TONGUE_EPS[25], 6300), (0.05, 0.24, 5450)):
        row = int(np.argmin(np.abs(speed - rpm)))
        unit, omega = UNIT.replace(zeta_1=zeta, zeta_s=zeta), float(speed[row] * RPM)

        def matrix(t, unit=unit, eps=eps, omega=omega):
            return nonuniform.fixed_frame_matrix(unit, tables.sidewall(eps), omega, omega * t)

        radius = floquet.analyze(matrix, np.pi / omega).spectral_radius ** 2
        assert radius > 1.02
        column = table("tongues")[f"spectral_radius_zeta_{zeta}_eps_{eps:.4f}"]
        assert column[row] == pytest.approx(radius, rel=1e-9)


@pytest.mark.slow
def test_tongues_begin_where_they_are_drawn_to():
    """The least eps at which a point beside a tip is unstable; the tongue may hide between two speeds, 25 rpm apart."""
    speed = table("tongues")["speed_rpm"]
    step = tables.TONGUE_EPS[1]
    for zeta in tables.TONGUE_ZETA:
        radius = np.array([table("tongues")[f"spectral_radius_zeta_{zeta}_eps_{eps:.4f}"] for eps in tables.TONGUE_EPS])
        tips = [tip for tip in tables.tongue_unit(zeta)[1] if tip.growth > 10.0 and tip.threshold < 0.24]
        assert [round(tip.speed / RPM) for tip in tips] == [4711, 5406, 6100]
        drawn = tables.tongue_thresholds(zeta) if zeta else [(tip.speed, 0.0) for tip in tips]
        for tip, (at, eps) in zip(tips, drawn, strict=True):
            near = np.abs(speed - at / RPM) < 150.0
            first = np.array(tables.TONGUE_EPS)[(radius[:, near] > 1.0 + 1e-6).any(axis=1)].min()
            hidden = np.hypot(eps, 12.5 * RPM / tip.growth)  # as wide as that it is at this eps
            assert eps <= first < 1.02 * hidden + step


# -- files --


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """All figures, drawn once by the command."""
    path = tmp_path_factory.mktemp("figures") / "made" / "here"
    with redirect_stdout(io.StringIO()) as said:
        assert main(["figures", "-o", str(path), "--json"]) == 0
    answer = json.loads(said.getvalue())
    assert answer["output"] == str(path) and len(answer["figures"]) == len(FIGURES)
    assert all(Path(each[kind]).is_file() for each in answer["figures"] for kind in ("picture", "numbers"))
    return path


@pytest.mark.slow
def test_the_command_writes_a_picture_and_its_numbers_for_every_figure(folder):
    assert {path.name for path in folder.iterdir()} == {f"{name}.{kind}" for name in FIGURES for kind in ("png", "csv")}


@pytest.mark.slow
@pytest.mark.parametrize("name", FIGURES)
def test_the_csv_holds_the_table(folder, name):
    with open(folder / f"{name}.csv", encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == list(table(name)) and len(set(header)) == len(header)
    numbers = np.array(rows, dtype=float)
    np.testing.assert_allclose(numbers, np.stack(list(table(name).values()), axis=1), rtol=1e-9)  # ten digits
    known = np.isfinite(numbers)
    if name == "campbell_contact":  # NaN where no mode is mostly of one harmonic; the modes themselves are all there
        known = known[:, [k for k, column in enumerate(header) if "_mode_" in column]]
    assert known.all()


@pytest.mark.slow
@pytest.mark.parametrize("name", FIGURES)
def test_the_picture_can_be_read_and_shows_something(folder, name):
    pixels = imread(folder / f"{name}.png")
    assert pixels.shape[1] == 1320 and pixels.shape[0] > 600  # 6.6 in at 200 dpi
    luminance = pixels[..., :3] @ [0.299, 0.587, 0.114]
    ink = luminance < 0.9
    assert 0.005 < ink.mean() < 0.5
    edges = np.concatenate([ink[0], ink[-1], ink[:, 0], ink[:, -1]])
    assert not edges.any()  # nothing reaches the border, so nothing is cut off


@pytest.mark.slow
def test_an_output_that_holds_something_is_kept_unless_forced(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "FIGURES", ("fig6",))
    assert command.figures(tmp_path) == [tmp_path / "fig6.png"]  # it exists, and is empty
    for file in (tmp_path / "fig6.csv", tmp_path / "other.txt"):
        file.write_text("mine")
    with pytest.raises(InputError, match="exists already and is not empty"):
        command.figures(tmp_path)
    assert (tmp_path / "fig6.csv").read_text() == "mine"
    command.figures(tmp_path, force=True)
    assert (tmp_path / "fig6.csv").read_text().startswith("speed_rpm,")
    assert (tmp_path / "other.txt").read_text() == "mine"


def test_a_place_that_cannot_be_written_is_one_clear_line(tmp_path):
    file = tmp_path / "file"
    file.write_text("mine")
    for place in (file, file / "folder"):
        with pytest.raises(InputError) as error:
            command.figures(place, force=True)
        assert str(place) in str(error.value) and "\n" not in str(error.value)
    assert file.read_text() == "mine"


def test_without_matplotlib_it_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(InputError, match=r"pip install 'tire_dynamics\[plot\]'"):
        command.figures(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_users_own_style_changes_nothing(folder, tmp_path, monkeypatch):
    import matplotlib

    monkeypatch.setattr(command, "FIGURES", ("fig6",))
    with matplotlib.rc_context({"lines.linewidth": 7.0, "savefig.transparent": True, "font.size": 20.0}):
        command.figures(tmp_path)
        assert matplotlib.rcParams["lines.linewidth"] == 7.0
    assert (tmp_path / "fig6.png").read_bytes() == (folder / "fig6.png").read_bytes()


def test_the_options_load_neither_numpy_nor_matplotlib():
    script = "import sys, tire_dynamics.cli.figures; print({'numpy', 'scipy', 'matplotlib'} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"
