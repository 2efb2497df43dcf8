"""Rigid rings that are estimated: the rules against rings that were measured, and where their spread goes."""

import argparse
import json
import math

import numpy as np
import pytest
from test_identify import CAR as VEHICLE
from test_identify import recording
from test_tir import GIVEN, OPTIONS, refused, written

from tire_dynamics import read_unit
from tire_dynamics.cli.identify import prior_widths
from tire_dynamics.cli.main import main
from tire_dynamics.estimator.identification import identify
from tire_dynamics.files.errors import InputError
from tire_dynamics.files.tir_estimate import RULES, stiffness_of_size, tire_mass_of_size
from tire_dynamics.files.tir_unit import unit_from_tir
from tire_dynamics.science.uncertainty import bands, value_of

# What is known of tires whose rigid ring was measured: Zegelaar (1998), whose tire Pacejka's book has, MF-Swift's two
# fits of the same 205/60R15 for versions 6.1 and 6.2, and a 13 inch racing tire of a student formula.
CAR = {"UNLOADED_RADIUS": 0.3135, "RIM_RADIUS": 0.1905, "WIDTH": 0.205, "MASS": 9.3, "IYY": 0.736, "INFLPRES": 220e3}
RACING = {"UNLOADED_RADIUS": 0.2391, "RIM_RADIUS": 0.1651, "WIDTH": 0.185, "MASS": 6.4658, "IYY": 0.3046}
MEASURED = {
    "Zegelaar": (CAR, {"BELT_MASS": 7.1, "BELT_IYY": 0.636}),
    "6.1": (
        CAR | {"VERTICAL_STIFFNESS": 209651.0},
        {"BELT_MASS": 7.247, "BELT_IYY": 0.5698, "FREQ_LONG": 77.17, "FREQ_WINDUP": 58.95, "DAMP_LONG": 0.056},
    ),
    "6.2": (
        CAR | {"VERTICAL_STIFFNESS": 209651.5},
        {"BELT_MASS": 7.698, "BELT_IYY": 0.4889, "FREQ_LONG": 76.63, "FREQ_WINDUP": 67.73, "DAMP_LONG": 0.04881},
    ),
    "racing": (
        RACING | {"VERTICAL_STIFFNESS": 75831.6, "INFLPRES": 125e3},
        {"BELT_MASS": 4.5633, "BELT_IYY": 0.17719, "FREQ_LONG": 49.33, "FREQ_WINDUP": 42.37, "DAMP_LONG": 0.04},
    ),
}
LITTLE = {"UNLOADED_RADIUS": 0.344, "WIDTH": 0.245, "RIM_RADIUS": 0.2286, "VERTICAL_STIFFNESS": 2.8e5}
NEEDED = ("BELT_MASS", "BELT_IYY", "FREQ_LONG", "FREQ_WINDUP", "DAMP_LONG")


def file_of(folder, values, model="PROPERTY_FILE_FORMAT = 'PAC2002'"):
    """A property file of these values, each in a section where it may stand."""
    sections = {"DIMENSION": ("RADIUS", "WIDTH", "RATIO"), "INERTIA": ("MASS", "IYY"), "STRUCTURAL": ("FREQ", "DAMP")}
    lines = ["[UNITS]", "LENGTH='meter'", "MASS='kg'", "FORCE='newton'", "TIME='second'", "[MODEL]", model]
    rest = dict(values)
    for section, words in sections.items():
        lines.append(f"[{section}]")
        lines += [f"{key} = {rest.pop(key)!r}" for key in list(rest) if any(word in key for word in words)]
    lines += ["[PARAMETER]", *(f"{key} = {value!r}" for key, value in rest.items())]
    return written(folder, "\n".join(lines) + "\n")


def estimated(folder, values, **fields):
    return unit_from_tir(file_of(folder, values), **GIVEN, estimate=True, **fields)


# -- the rules ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MEASURED)
@pytest.mark.parametrize("without", [(), ("IYY",), ("IYY", "MASS")], ids=["", "no IYY", "no MASS"])
def test_measured_rings_are_within_the_range(tmp_path, name, without):
    """Nine in ten should be. The racing tire is far heavier than its size says, which only MASS tells."""
    says, has = MEASURED[name]
    found = estimated(tmp_path, {key: value for key, value in says.items() if key not in without}).estimates
    assert set(NEEDED) <= set(found)
    outside = {
        key: (value, *found[key]) for key, value in has.items() if not found[key].low <= value <= found[key].high
    }
    heavy = {"BELT_MASS", "FREQ_LONG", "FREQ_WINDUP"} if name == "racing" and "MASS" in without else set()
    assert set(outside) <= heavy, outside


def test_the_stated_shares_are_those_of_the_measured_rings():
    """The middle of each rule is the geometric mean over the rings, to its two digits, and its spread theirs."""
    shares = {
        "belt's share of MASS": [has["BELT_MASS"] / says["MASS"] for says, has in MEASURED.values()],
        "belt's share of IYY": [has["BELT_IYY"] / says["IYY"] for says, has in MEASURED.values()],
        "belt's radius over UNLOADED_RADIUS": [
            math.sqrt(has["BELT_IYY"] / has["BELT_MASS"]) / says["UNLOADED_RADIUS"] for says, has in MEASURED.values()
        ],
    }
    swift = [MEASURED[name] for name in ("6.1", "6.2", "racing")]
    shares["k_1 over VERTICAL_STIFFNESS"] = [
        has["BELT_MASS"] * (2.0 * math.pi * has["FREQ_LONG"]) ** 2 / says["VERTICAL_STIFFNESS"] for says, has in swift
    ]
    shares["FREQ_WINDUP over FREQ_LONG"] = [has["FREQ_WINDUP"] / has["FREQ_LONG"] for _, has in swift]
    shares["DAMP_LONG"] = [has["DAMP_LONG"] for _, has in swift]
    for name, values in shares.items():
        logs = np.log(values)
        assert RULES[name].value == pytest.approx(math.exp(logs.mean()), rel=0.05), name
        # of so few the deviation is known to a third
        assert RULES[name].spread == pytest.approx(logs.std(ddof=1), rel=0.35), name


@pytest.mark.parametrize(
    ("radius", "rim", "width", "low", "high"),
    [(0.3135, 0.1905, 0.205, 9.3, 9.3), (0.527, 0.2858, 0.279, 53.5, 57.0), (0.3, 0.2159, 0.12, 4.0, 6.5)],
    ids=["205/60R15", "11R22.5", "motorcycle 120/70R17"],
)
def test_masses_by_size(radius, rim, width, low, high):
    """Masses as dealers state them; the spread is 30 %."""
    assert 0.99 * low < tire_mass_of_size(radius, rim, width) < 1.01 * high


@pytest.mark.parametrize(
    ("radius", "rim", "width", "pressure", "stiffness"),
    [
        (0.3135, 0.1905, 0.205, 220e3, 209651.0),
        (0.548, 0.28, 0.318, 800e3, 1e6),
        (0.2391, 0.1651, 0.185, 125e3, 110070.0),
    ],
    ids=["205/60R15", "bus", "racing"],
)
def test_stiffness_by_size(radius, rim, width, pressure, stiffness):
    """Of tires whose property file has it; Rhyne's own spread is some 10 %."""
    assert stiffness_of_size(radius, rim, width, pressure) == pytest.approx(stiffness, rel=0.2)


# -- what comes of them -------------------------------------------------------------------------------------------


def test_of_a_file_that_has_next_to_nothing(tmp_path):
    """Fiala's: a radius, a width and a stiffness. Each estimate is said with its range and its rule."""
    path = file_of(
        tmp_path,
        {"UNLOADED_RADIUS": 0.31, "WIDTH": 0.2, "ASPECT_RATIO": 0.6, "VERTICAL_STIFFNESS": 2e5},
        "PROPERTY_FILE_FORMAT = 'FIALA'",
    )
    with pytest.raises(ValueError) as refused:
        unit_from_tir(path, **GIVEN)
    words = str(refused.value)
    assert ", ".join(NEEDED) + " are missing; it is a file with PROPERTY_FILE_FORMAT = FIALA" in words
    assert "--estimate" in words and "--key" in words
    made = unit_from_tir(path, **GIVEN, estimate=True)
    assert made.estimates["RIM_RADIUS"].value == pytest.approx(0.19)
    for key, each in made.estimates.items():
        assert 0.0 < each.low < each.value < each.high, key
        assert any(note.startswith(f"{key} is estimated") and each.rule in note for note in made.notes)
    kinds = {name: source.kind for name, source in made.sources.items()}
    names = ("density", "radius", "radial_stiffness", "tangential_stiffness", "zeta_1", "inflation_pressure")
    assert [kinds[name] for name in names] == ["estimated"] * 6
    assert kinds["width"] == "file" and kinds["zeta_s"] == "assumed"


@pytest.mark.parametrize("key", NEEDED)
def test_what_the_file_has_is_its_own(tmp_path, key):
    says, has = MEASURED["6.1"]
    whole = unit_from_tir(file_of(tmp_path, says | has), **GIVEN)
    made = estimated(tmp_path, says | {name: value for name, value in has.items() if name != key})
    assert set(made.estimates) == {key}
    assert made.unit.to_mapping() != whole.unit.to_mapping()
    every = estimated(tmp_path, says | has)
    assert every.unit == whole.unit and every.errors is None and every.estimates == {}


def test_zeros_of_a_tool_are_no_damping(tmp_path):
    zero = dict.fromkeys((*NEEDED, "MASS", "IYY", "INFLPRES"), 0.0)
    assert estimated(tmp_path, LITTLE | zero).unit == estimated(tmp_path, LITTLE).unit
    assert estimated(tmp_path, LITTLE | {"DAMP_LONG": 0.0, "FREQ_LONG": 70.0}).unit.zeta_1 == 0.0


def test_without_a_radius_there_is_nothing_to_begin_with(tmp_path):
    with pytest.raises(ValueError, match="UNLOADED_RADIUS is missing; nothing can be estimated without"):
        estimated(tmp_path, {"WIDTH": 0.2})


def test_a_value_that_cannot_be_read_is_estimated_and_said(tmp_path):
    """MASS = kg stands in a public file."""
    path = file_of(tmp_path, LITTLE)
    path.write_text(path.read_text().replace("[INERTIA]", "[INERTIA]\nMASS = kg"))
    made = unit_from_tir(path, **GIVEN, estimate=True)
    assert "MASS" in made.estimates and any("MASS is 'kg' in line " in doubt for doubt in made.doubts)


# -- how far it may be off ----------------------------------------------------------------------------------------


def test_errors_are_those_of_the_rules(tmp_path):
    """Shares are independent of each other: radius and k_1 by hand, and the whole by sampling the rules."""
    says, _ = MEASURED["6.1"]
    made = estimated(tmp_path, says)
    assert made.errors is not None
    spread = {name: rule.spread for name, rule in RULES.items()}
    radius = 0.5 * math.hypot(spread["belt's share of IYY"], spread["belt's share of MASS"])
    # 2e-4: differences of the logarithms at 1e-3 have the third derivatives in them
    assert made.errors.relative["radius"] == pytest.approx(radius, rel=2e-4)
    assert made.errors.k_1 == pytest.approx(spread["k_1 over VERTICAL_STIFFNESS"], rel=2e-4)
    assert made.errors.relative["zeta_1"] == pytest.approx(0.2, rel=2e-4)
    C = made.errors.correlation
    assert np.allclose(np.diag(C), 1.0) and np.linalg.eigvalsh(C).min() > -1e-9
    names = list(made.errors.relative)
    assert {"inflation_pressure", "width", "wheel_mass"}.isdisjoint(names)  # the file's, and given
    # a softer ring is a softer ring on either spring
    assert C[names.index("radial_stiffness"), names.index("tangential_stiffness")] > 0.3
    found = bands(made.unit, 60.0, made.errors.relative, C, samples=200)
    assert found.transmissibility[0] < found.transmissibility[1] < found.transmissibility[2]


def test_the_command_and_who_reads_its_errors(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    file_of(tmp_path, LITTLE)
    arguments = ["import-tir", "tire.tir", "-o", "unit.yaml", *OPTIONS, "--set", "sidewall_damping=reaction"]
    assert "--estimate" in refused(capsys, *arguments)
    assert main([*arguments, "--estimate"]) == 0
    said = capsys.readouterr().err
    assert "6 estimated" in said and "unit.errors.json, which --samples and --start read" in said
    assert all(f"note: {key} is estimated" in said for key in NEEDED)
    unit = read_unit("unit.yaml")
    written = json.loads((tmp_path / "unit.errors.json").read_text())
    made = unit_from_tir("tire.tir", **GIVEN, estimate=True, sidewall_damping="reaction")
    assert unit == made.unit and dict(zip(written["fields"], written["relative_errors"], strict=True)) == (
        pytest.approx(made.errors.relative)
    )
    assert written["values"] == [value_of(unit, name) for name in written["fields"]]
    assert "# estimated: " in (tmp_path / "unit.yaml").read_text()

    assert main(["stability", "--speed-rpm", "800", "--config", "unit.yaml", "--samples", "50"]) == 0
    bands_said = json.loads(capsys.readouterr().out)["uncertainty"]
    assert bands_said["relative_errors"] == pytest.approx(made.errors.relative)
    low, middle, high = bands_said["critical_speed_rad_s"].values()
    assert 0.0 < low < middle < high
    # another unit under the same name would be taken with these errors
    (tmp_path / "unit.yaml").unlink()
    says, has = MEASURED["6.1"]
    file_of(tmp_path, says | has)
    assert "unit.errors.json: holds errors of another unit" in refused(capsys, *arguments)


def test_priors_by_name():
    """Forces over forces do not tell whether all masses and stiffnesses are larger: there the narrowest prior decides.

    With four priors of 0.5 the common factor has an error of 0.25.
    """
    names = ("density", "k_1", "wheel_mass", "suspension_stiffness")
    drive = recording(VEHICLE, seconds=4.0, noise=3.0)
    found = identify(drive, VEHICLE, names, joined="lines", prior_width={"density": 0.02})
    assert found.prior_width.tolist() == [0.02, 0.5, 0.5, 0.5]
    assert found.errors[:2].max() < 0.03


def test_priors_from_beside_the_start(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file_of(tmp_path, LITTLE)
    assert main(["import-tir", "tire.tir", "-o", "unit.yaml", *OPTIONS, "--estimate", "-q"]) == 0
    options = argparse.Namespace(start="unit.yaml", fit="k_1, wheel_mass", prior_width=0.4)
    widths = prior_widths(options, False)
    assert widths["k_1"] == pytest.approx(0.25, rel=2e-4) and widths["wheel_mass"] == 0.4
    assert widths["zeta_1"] == pytest.approx(0.2, rel=2e-4) and set(widths) == {
        "k_1",
        "wheel_mass",
        "zeta_1",
        "density",
    }
    for text in ("{", "[]", '{"prior_widths": {"k_1": 0}}', '{"prior_widths": {"k_1": "wide"}}'):
        (tmp_path / "unit.errors.json").write_text(text)
        with pytest.raises(InputError, match="unit.errors.json: is no file of errors"):
            prior_widths(options, False)
    (tmp_path / "unit.errors.json").write_text('{"fields": []}')  # identify's own has none
    assert prior_widths(options, False) == {"k_1": 0.4, "wheel_mass": 0.4}
    (tmp_path / "unit.errors.json").unlink()
    assert prior_widths(options, False) == 0.4
