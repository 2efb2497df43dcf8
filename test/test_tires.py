"""docs/tires.md: what comes out for the tires whose property files are public and hold a rigid ring."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from tire_dynamics import TireWheelUnit, read_tir_unit, wheel
from tire_dynamics.science import contact

PAGE = (Path(__file__).parents[1] / "docs" / "tires.md").read_text(encoding="utf-8")
RPM = math.pi / 30.0
TABLE_1 = TireWheelUnit.table_1()
SAME = {"wheel_mass": TABLE_1.wheel_mass, "suspension_stiffness": TABLE_1.suspension_stiffness}
CAR = {"UNLOADED_RADIUS": 0.3135, "WIDTH": 0.205, "RIM_RADIUS": 0.1905, "INFLPRES": 220e3, "MASS": 9.3, "IYY": 0.736}
# The keys of each file that the unit takes; where each is from is in docs/tires.md.
FILES = {
    "205/60R15, MF-Swift 6.1": CAR
    | {"BELT_MASS": 7.247, "BELT_IYY": 0.5698, "FREQ_LONG": 77.17, "FREQ_WINDUP": 58.95, "DAMP_LONG": 0.056}
    | {"VERTICAL_STIFFNESS": 209651.0},
    "205/60R15, MF-Swift 6.2": CAR
    | {"BELT_MASS": 7.698, "BELT_IYY": 0.4889, "FREQ_LONG": 76.63, "FREQ_WINDUP": 67.73, "DAMP_LONG": 0.04881}
    | {"VERTICAL_STIFFNESS": 209651.5},
    "13 inch, racing": {"UNLOADED_RADIUS": 0.2391, "WIDTH": 0.185, "RIM_RADIUS": 0.1651, "INFLPRES": 125e3}
    | {"BELT_MASS": 4.5633, "BELT_IYY": 0.17719, "FREQ_LONG": 49.329, "FREQ_WINDUP": 42.3721, "DAMP_LONG": 0.04}
    | {"VERTICAL_STIFFNESS": 75831.6, "MASS": 6.4658, "IYY": 0.3046},
}


def file_of(folder, values):
    lines = ["[UNITS]", "LENGTH='meter'", "MASS='kg'", "FORCE='newton'", "TIME='second'", "[MODEL]", "FITTYP = 62"]
    path = folder / "tire.tir"
    path.write_text("\n".join([*lines, "[DIMENSION]", *(f"{key} = {value!r}" for key, value in values.items())]) + "\n")
    return path


def unit_of(name, folder):
    if name == "Table 1":
        return TABLE_1.replace(vertical_stiffness=2e5)
    return read_tir_unit(file_of(folder, FILES[name]), **SAME, zeta_s=0.05)


def found(unit):
    """The columns of the page's table."""
    given, modal = unit.replace(vertical_stiffness=0.0), {"sidewall_damping": "modal"}
    reaction = {"sidewall_damping": "reaction"}
    road = unit.replace(**reaction, contact_half_angle=0.15)
    values = np.linalg.eigvals(contact.open_system(road, 60.0, n_max=30).closed())
    hop = np.sort(np.abs(values[values.imag > 0.0].imag))[0] / (2.0 * math.pi)
    return [
        unit.sidewall_stiffness / 1e6,
        math.sqrt(unit.sidewall_stiffness / unit.ring_mass) / (2.0 * math.pi),
        unit.zeta_1,
        float(wheel.transmissibility(given.replace(**modal), 1500.0 * RPM)),
        hop,
        wheel.critical_speed(given.replace(**modal)) / RPM,
        wheel.critical_speed(given.replace(**reaction)) / RPM,
        contact.critical_speed(road, n_max=30) / RPM,
    ]


def stated():
    for line in PAGE.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if cells[0] in (*FILES, "Table 1"):
            yield cells[0], [float(cell.replace(" ", "").replace("\u202f", "")) for cell in cells[1:9]]


def test_every_tire_is_on_the_page():
    assert [name for name, _ in stated()] == ["Table 1", *FILES]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Table 1", *FILES])
def test_the_numbers_of_the_page(name, tmp_path):
    digits = [6e-4, 0.06, 6e-5, 6e-4, 0.06, 1.0, 1.0, 1.0]
    for value, number, digit in zip(dict(stated())[name], found(unit_of(name, tmp_path)), digits, strict=True):
        assert number == pytest.approx(value, abs=digit)


def test_the_transmissibility_by_hand(tmp_path):
    """K = 1/(1 + (2 zeta_1 Omega/omega_1)^2 (k_1 + k_s)/k_s) from the file's own numbers."""
    for name, values in FILES.items():
        omega_1, zeta, k_s = 2.0 * math.pi * values["FREQ_LONG"], values["DAMP_LONG"], SAME["suspension_stiffness"]
        k_1 = values["BELT_MASS"] * omega_1**2
        K = 1.0 / (1.0 + (2.0 * zeta * 1500.0 * RPM / omega_1) ** 2 * (k_1 + k_s) / k_s)
        assert dict(stated())[name][3] == pytest.approx(K, abs=6e-4)


def test_the_spread_that_the_page_states():
    rows = np.array([row for name, row in stated()])
    ratios = rows.max(axis=0) / rows.min(axis=0)
    said = [float(text) for text in re.findall(r"by\s+a\s+factor\s+of\s+(\d+\.\d+)", PAGE)]
    # k_1, frequency, damping, hop; critical speed modal, reaction, on the road
    assert said == pytest.approx(ratios[[0, 1, 2, 4, 5, 6, 7]], abs=0.051)


def test_how_far_two_fits_of_one_tire_are_apart():
    first, second = (FILES[f"205/60R15, MF-Swift 6.{k}"] for k in (1, 2))
    rows = dict(stated())
    k_1, critical = (rows["205/60R15, MF-Swift 6.2"][k] / rows["205/60R15, MF-Swift 6.1"][k] for k in (0, 5))
    apart = [k_1, first["DAMP_LONG"] / second["DAMP_LONG"], first["BELT_IYY"] / second["BELT_IYY"], critical]
    found = re.search(r"(\d+) % in \$k_1\$, (\d+) % in the\s+damping, (\d+) % in the belt's inertia, and (\d+) %", PAGE)
    assert [float(text) for text in found.groups()] == pytest.approx([100.0 * (each - 1.0) for each in apart], abs=0.51)
    stiffnesses = [values["VERTICAL_STIFFNESS"] for values in FILES.values()]
    assert max(stiffnesses) / min(stiffnesses) == pytest.approx(2.8, abs=0.05)
