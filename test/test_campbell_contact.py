"""The Campbell diagram on the road: names and numbers of the modes that the contact couples; the command."""

from __future__ import annotations

import csv
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tire_dynamics import TireWheelUnit, ring, wheel, write_unit
from tire_dynamics.cli.main import main
from tire_dynamics.science import campbell, contact

TABLE_1 = TireWheelUnit.table_1()
ROAD = TABLE_1.replace(contact_half_angle=0.15, vertical_stiffness=2e5, sidewall_damping="reaction")
RPM = math.pi / 30.0
MODELS = ("inextensional", "complete")


@pytest.mark.parametrize(
    ("rpm", "names", "frequencies", "decay"),
    [
        (0.0, ("wheel_hop", "ring_fore_aft", (2, "backward")), (20.9408, 78.4220, 91.7260), (2.8868, 24.6679, 11.5289)),
        (1e3, ("wheel_hop", (2, "backward"), "ring_fore_aft"), (20.8769, 75.7161, 78.4645), (2.9983, 13.6873, 24.6516)),
    ],
)  # fmt: skip
def test_the_lowest_three_are_models_and_have_their_names(rpm, names, frequencies, decay):
    """docs/model.md, section 12; which motion each is, by those of the free tire at that speed."""
    found = campbell.campbell_exponents(ROAD, [rpm * RPM], (2, 3), contact=True)
    exponents = np.array([(found[0] | found[1])[name][0] for name in names])
    np.testing.assert_allclose(exponents.imag / (2.0 * math.pi), frequencies, atol=5.1e-5)
    np.testing.assert_allclose(-exponents.real, decay, atol=5.1e-5)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("rpm", [0.0, 700.0, 3000.0])
def test_a_tread_that_hardly_presses_leaves_the_free_tire(model, rpm):
    """Exponents and names of every motion; k_c is K_v to first order, and moves them by some k_c/k_1, 1e-6."""
    numbers = (2, 3, 4, 5)
    soft = TABLE_1.replace(contact_half_angle=0.15, vertical_stiffness=1.0, sidewall_damping="reaction")
    free = campbell.campbell_exponents(soft, [rpm * RPM], numbers, model)
    found = campbell.campbell_exponents(soft, [rpm * RPM], numbers, model, contact=True, n_max=8)
    for one, other in zip(free, found, strict=True):
        assert list(one) == list(other)
        for name in one:
            expected, exponent = one[name][0], other[name][0]
            assert exponent.real == pytest.approx(expected.real, abs=1e-3)
            assert exponent.imag == pytest.approx(abs(expected.imag), rel=1e-4)


@pytest.mark.parametrize("model", MODELS)
def test_at_rest_the_mirror_keeps_one_wave_of_each_number_from_the_contact(model):
    """It is the ring's own, the lower of the two: a spring only lifts the other (Rayleigh)."""
    tire = ROAD.replace(zeta_1=0.0, zeta_n=0.0, zeta_s=0.0)
    modes = campbell.contact_modes(tire, [0.0], model, 8)
    _, waves = campbell.campbell_exponents(tire, [0.0], (2, 3, 4), model, contact=modes, n_max=8)
    own = {n: ring.natural_frequencies(tire, n, model=model)[0] for n in (2, 3, 4)}
    for n in (2, 3, 4):
        assert waves[n, "backward"][0].imag == pytest.approx(own[n], rel=1e-9)
        assert waves[n, "forward"][0].imag > own[n] * (1.0 + 1e-6)


@given(
    speed=st.floats(-400.0, 400.0),
    model=st.sampled_from(MODELS),
    changes=st.fixed_dictionaries(
        {
            "vertical_stiffness": st.sampled_from([0.0, 1e5, 2.5e5]),
            "sprung_mass": st.sampled_from([0.0, 300.0]),
            "longitudinal_stiffness": st.sampled_from([0.0, 3e5]),
            "zeta_s": st.floats(0.01, 0.6),
            "residual_damping": st.sampled_from([0.0, 100.0]),
        }
    ),
)
@settings(max_examples=25)
def test_all_modes_are_those_of_the_system_in_contact(speed, model, changes):
    """As many of each harmonic as it has by itself, at either sign of the speed."""
    unit = ROAD.replace(**changes)
    n_max = 4
    modes = campbell.contact_modes(unit, [speed, -speed], model, n_max)
    expected = contact.oscillatory_exponents(unit, speed, model, n_max)
    for exponents in modes.exponents:
        moving = exponents[np.isfinite(exponents)]
        moving = moving[np.argsort(moving.imag)]
        np.testing.assert_allclose(moving, expected, atol=1e-6 * np.abs(expected).max())
    waves = 1 if model == "inextensional" else 2
    counts = {(n, wave): waves for n in range(2, n_max + 1) for wave in (-1, 1)}
    if not unit.vertical_stiffness:  # a rigid tread has one mode fewer, which would be the highest
        counts[n_max, 1] -= 1
    found = list(zip(modes.harmonic[0].tolist(), modes.wave[0].tolist(), strict=True))
    assert all(found.count(name) == count for name, count in counts.items())
    of_wheel = 3 * waves + bool(unit.sprung_mass) + (not unit.is_longitudinally_rigid)
    assert found.count((1, 0)) == of_wheel - (waves - 1)  # complete: X, Y, U, V and the wheel
    names = campbell.wheel_mode_names(unit, model, contact=True)
    assert ("body" in names) == bool(unit.sprung_mass)
    assert ("wheel_fore_aft" in names) != unit.is_longitudinally_rigid


def test_a_wheel_that_gives_fore_and_aft_has_its_mode_in_both_diagrams():
    """At rest fore and aft is a matter of its own: two masses in a row, which the contact does not touch."""
    unit = ROAD.replace(longitudinal_stiffness=3e5, longitudinal_mass=30.0, zeta_1=0.0, longitudinal_damping_ratio=0.0)
    k, m, k_x, M_x = unit.sidewall_stiffness, unit.ring_mass, unit.longitudinal_stiffness, unit.fore_aft_mass
    matrix = np.array([[k / m, -k / m], [-k / M_x, (k + k_x) / M_x]])
    expected = np.sqrt(np.sort(np.linalg.eigvals(matrix).real))
    for on_road in (True, False):
        found, _ = campbell.campbell_exponents(unit, [0.0], (2,), contact=on_road)
        slow, fast = (found[name][0].imag for name in ("wheel_fore_aft", "ring_fore_aft"))
        assert [slow, fast] == pytest.approx(expected, rel=1e-9)


def test_bad_arguments():
    with pytest.raises(ValueError, match="numbers has 9; it must be from 2 to n_max, which is 8"):
        campbell.campbell_exponents(ROAD, [0.0], (2, 9), contact=True, n_max=8)
    with pytest.raises(ValueError, match="speed is nan"):
        campbell.contact_modes(ROAD, [math.nan])


def test_where_a_name_goes_over_to_another_mode_is_found():
    speeds = np.linspace(0.0, 300.0, 181)
    modes = campbell.contact_modes(ROAD, speeds, n_max=8)
    _, waves = campbell.campbell_exponents(ROAD, speeds, (2,), contact=modes, n_max=8)
    frequency = waves[2, "forward"].imag / (2.0 * math.pi)
    rows = [np.flatnonzero(np.isclose(modes.exponents[k].imag, 2.0 * math.pi * f)) for k, f in enumerate(frequency)]
    rank = np.array([row[0] if row.size else -1 for row in rows])
    jumps = campbell.jumps(speeds, frequency, 2)
    assert jumps.any() and (np.diff(rank)[jumps] != 0).all()


# -- the command --------------------------------------------------------------------------------------------------


def test_the_command_has_the_numbers_and_a_picture(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    write_unit(ROAD, tmp_path / "unit.yaml")
    picture = tmp_path / "campbell.png"
    arguments = ["campbell", "--contact", "--config", str(tmp_path / "unit.yaml"), "--n-max", "6"]
    arguments += ["--points", "5", "--to-rpm", "2000", "--waves", "3", "-o", str(picture)]
    assert main([*arguments, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["contact"], answer["n_max"], answer["model"]) == (True, 6, "inextensional")
    assert picture.read_bytes().startswith(b"\x89PNG")
    with open(picture.with_suffix(".csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    found = campbell.campbell_exponents(ROAD, np.linspace(0.0, 2000.0 * RPM, 5), (2, 3), contact=True, n_max=6)
    for name, column in (*found[0].items(), *((f"n_{n}_{wave}", column) for (n, wave), column in found[1].items())):
        expected = np.abs(column.imag) / (2.0 * math.pi)
        np.testing.assert_allclose([float(row[f"{name}_Hz"]) for row in rows], expected, rtol=1e-9)
        found_decay = [math.nan if value is None else value for value in answer[f"{name}_decay_1_s"]]
        np.testing.assert_allclose(found_decay, -column.real, rtol=1e-12)
    assert main([*arguments]) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "needs -o PNG or --json"),
        (["--json", "--to-rpm", "0"], "--to-rpm is 0.0; it must be above 0"),
        (["--json", "--points", "1"], "--points is 1; it must be from 2"),
        (["--json", "--contact", "--n-max", "3"], "--waves is 4; it must be from 2 to 3"),
        (["--json", "--contact", "--n-max", "0"], "--n-max is 0; it must be from 1"),
        (["-o", "campbell.pdf"], "its name must end in .png"),
    ],
)
def test_what_the_command_refuses(arguments, words, capsys):
    pytest.importorskip("matplotlib")
    assert main(["campbell", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_the_command_without_contact_is_the_diagram_under_a_given_load(capsys):
    pytest.importorskip("matplotlib")
    assert main(["campbell", "--json", "--points", "3", "--to-rpm", "2000", "--model", "complete"]) == 0
    answer = json.loads(capsys.readouterr().out)
    expected = wheel.whirl_frequencies(TABLE_1, 2000.0 * RPM, "complete")[:3]
    assert [answer[f"{name}_Hz"][-1] for name in campbell.WHEEL_MODES] == pytest.approx(expected, rel=1e-12)
    assert answer["n_max"] is None and not any(name.startswith("mode_") for name in answer)
