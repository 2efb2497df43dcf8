"""Units from MF-Tyre/MF-Swift property files: the known case, every unit, hostile files, the command and its YAML."""

import json
import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tire_dynamics import TireWheelUnit, read_tir_unit, read_unit, ring, wheel
from tire_dynamics.cli.main import main
from tire_dynamics.files.tir_file import TirFile, read_tir
from tire_dynamics.files.tir_unit import OPEN_FIELDS, unit_from_tir
from tire_dynamics.science.coefficients import coefficients, static_compliance

TABLE_1 = TireWheelUnit.table_1()
GIVEN = {"wheel_mass": 12.0, "suspension_stiffness": 3.2e4}

KNOWN = """\
[MDI_HEADER]
FILE_TYPE = 'tir'
$--------------------------------------------------------------- units
[UNITS]
LENGTH = 'meter'
FORCE = 'newton'
ANGLE = 'radians'
MASS = 'kg'
TIME = 'second'
[DIMENSION]
UNLOADED_RADIUS = 0.3135   $ free radius
WIDTH = 0.205              ! section
[OPERATING_CONDITIONS]
INFLPRES = 220000
NOMPRES = 200000
[INERTIA]
MASS = 9.3
BELT_MASS = 7.247
BELT_IYY = 0.5698
[STRUCTURAL]
FREQ_LONG = 77.17
FREQ_WINDUP = 58.95
DAMP_LONG = 0.056
"""


def written(folder, text, encoding="ascii"):
    path = folder / "tire.tir"
    path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
    return path


def changed(**values):
    """KNOWN with other values, or without the keys whose value is None."""
    lines = []
    for line in KNOWN.splitlines():
        key = line.partition("=")[0].strip()
        if key not in values:
            lines.append(line)
        elif values[key] is not None:
            lines.append(f"{key} = {values[key]}")
    return "\n".join(lines) + "\n"


def with_stiffness(text, value):
    return f"{text}[VERTICAL]\nVERTICAL_STIFFNESS = {value}\n"


def refusal(path, **fields):
    """The one line with which the file is refused."""
    with pytest.raises(ValueError) as caught:
        read_tir_unit(path, **{**GIVEN, **fields})
    words = str(caught.value)
    assert "\n" not in words
    return words


# -- the relations ------------------------------------------------------------------------------------------------


def test_the_known_tire(tmp_path):
    """205/60R15: k_1, a and the stiffnesses times a b to their printed digits, the ring's mass exact."""
    unit = read_tir_unit(written(tmp_path, KNOWN), wheel_mass=12.0, suspension_stiffness=3.2e4)
    assert unit.sidewall_stiffness == pytest.approx(1.7038e6, abs=0.5e2)
    assert unit.radius == pytest.approx(0.2804, abs=0.5e-4)
    area = unit.radius * unit.width
    assert area * unit.tangential_stiffness == pytest.approx(1.582e5, abs=0.5e2)
    assert area * unit.radial_stiffness == pytest.approx(3.841e5, abs=0.5e2)
    assert unit.ring_mass == pytest.approx(7.247, rel=1e-15)  # rounding of four products
    assert (unit.zeta_1, unit.width, unit.inflation_pressure) == (0.056, 0.205, 220e3)
    assert (unit.wheel_mass, unit.suspension_stiffness) == (12.0, 3.2e4)


def test_the_file_gets_its_frequencies_back(tmp_path):
    """The model at rest on a wheel that gives nothing: n = 1 at FREQ_LONG with DAMP_LONG, wind-up at its own."""
    unit = read_tir_unit(written(tmp_path, KNOWN), wheel_mass=1e12, suspension_stiffness=1e18)
    [ring, *_] = wheel.whirl_frequencies(unit.replace(zeta_1=0.0, zeta_s=0.0), 0.0)
    assert ring == pytest.approx(77.17, rel=1e-9)
    exponents = np.linalg.eigvals(wheel.fixed_frame_matrix(unit, 0.0))
    ring = exponents[np.argmin(np.abs(np.abs(exponents) - 2.0 * math.pi * 77.17))]
    assert -ring.real / abs(ring) == pytest.approx(0.056, rel=1e-6)
    # The ring that turns against the wheel is the tangential part of n = 0, less the paper's p_0/a: see docs/model.md.
    C_0 = coefficients(unit, 0).tangential - unit.inflation_pressure / unit.radius / unit.surface_density
    assert math.sqrt(C_0) / (2.0 * math.pi) == pytest.approx(58.95, rel=1e-12)


def test_vertical_stiffness_comes_back_as_force_over_displacement(tmp_path):
    """In the file's units; whatever n_max is, the residual spring makes up for what the belt does not give."""
    text = changed(LENGTH="'mm'", UNLOADED_RADIUS=313.5, WIDTH=205, INFLPRES=0.22, NOMPRES=0.2, BELT_IYY=0.5698e6)
    path = written(tmp_path, text + "[VERTICAL]\nVERTICAL_STIFFNESS = 190.0\n")
    unit = read_tir_unit(path, **GIVEN)
    assert unit.vertical_stiffness == 190e3
    for n_max in (1, 10, 30, 100):
        k_c = wheel.residual_stiffness(unit, n_max)
        numbers = range(2, n_max + 1)
        psi = np.array([ring.CONTACT_ANGLE])
        belt = 0.0 if n_max == 1 else -ring.point_force_response(unit, 0.0, -1.0, 0.0, psi, numbers=numbers)[0][0]
        assert 1.0 / (1.0 / k_c + 1.0 / unit.sidewall_stiffness + belt) == pytest.approx(190e3, rel=1e-9)
        assert ring.static_stiffness(unit, n_max) == pytest.approx(190e3, rel=1e-12)
    assert read_tir_unit(written(tmp_path, KNOWN), **GIVEN).vertical_stiffness == 0.0


sizes = st.floats(0.0, 1.0)


@given(mass=sizes, radius=sizes, long=sizes, windup=sizes, damping=st.floats(0.0, 0.9), width=sizes)
def test_any_ring_comes_back(tmp_path_factory, mass, radius, long, windup, damping, width):
    """From a kart's belt to a mine truck's: what the file says is what the unit has."""
    m, a, f = 0.5 * 2000.0**mass, 0.1 * 20.0**radius, 10.0 * 10.0**long
    f_windup = f * (0.1 + 1.3 * windup)
    b = 0.05 * 20.0**width
    text = changed(
        **{"BELT_MASS": repr(m), "BELT_IYY": repr(m * a * a), "FREQ_LONG": repr(f), "FREQ_WINDUP": repr(f_windup)},
        **{"DAMP_LONG": repr(damping), "WIDTH": repr(b), "UNLOADED_RADIUS": None},
    ).replace("\nMASS = 9.3", "")
    unit = read_tir_unit(written(tmp_path_factory.getbasetemp(), text), **GIVEN)
    turn = 2.0 * math.pi
    # 1e-12: repr() is exact, 15 digits of it are taken, and k_z may be a fiftieth of the difference that it is
    assert unit.ring_mass == pytest.approx(m, rel=1e-12) and unit.radius == pytest.approx(a, rel=1e-12)
    assert unit.rigid_mode_frequency == pytest.approx(turn * f, rel=1e-12)
    torsion = turn * unit.radius**3 * unit.width * unit.tangential_stiffness
    assert torsion == pytest.approx(m * a * a * (turn * f_windup) ** 2, rel=1e-12)
    assert unit.radial_stiffness > 0.0 and unit.zeta_1 == pytest.approx(damping, rel=1e-14)


# -- what is assumed ----------------------------------------------------------------------------------------------


def test_what_is_assumed_is_scaled_from_table_1_and_said(tmp_path):
    path = written(tmp_path, changed(WIDTH=None, INFLPRES=None, NOMPRES=None))
    unit, sources, notes, *_ = unit_from_tir(path, **GIVEN)
    a = unit.radius / TABLE_1.radius
    assert unit.width == pytest.approx(TABLE_1.width * a, rel=1e-14)  # products in another order
    assert unit.thickness == pytest.approx(TABLE_1.thickness * a, rel=1e-14)
    assert unit.membrane_stiffness == pytest.approx(TABLE_1.membrane_stiffness * a, rel=1e-14)
    assert unit.bending_stiffness == pytest.approx(TABLE_1.bending_stiffness * a**3, rel=1e-14)
    assert unit.inflation_pressure == TABLE_1.inflation_pressure
    assert list(sources) == list(unit.to_mapping())
    assumed = {name for name, source in sources.items() if source.kind == "assumed"}
    assert assumed == set(OPEN_FIELDS)
    assert all(source.reason for source in sources.values())
    assert {name for name, source in sources.items() if source.kind == "given"} == set(GIVEN)
    assert notes == ("the tire is 9.3 kg, of which 2.053 kg beside the belt belong to the wheel's mass",)


def test_a_tire_like_table_1_comes_back_whole(tmp_path):
    """A file that has what Table 1 has gives Table 1, whatever is assumed."""
    m, a, b = TABLE_1.ring_mass, TABLE_1.radius, TABLE_1.width
    torsion = 2.0 * math.pi * a**3 * b * TABLE_1.tangential_stiffness
    inertia = m * a * a
    text = changed(
        BELT_MASS=repr(m), BELT_IYY=repr(inertia), FREQ_LONG=repr(TABLE_1.rigid_mode_frequency / (2.0 * math.pi)),
        FREQ_WINDUP=repr(math.sqrt(torsion / inertia) / (2.0 * math.pi)), DAMP_LONG=0.05, WIDTH=b, INFLPRES=2.07e5,
    )  # fmt: skip
    unit = read_tir_unit(
        written(tmp_path, text), wheel_mass=TABLE_1.wheel_mass, suspension_stiffness=TABLE_1.suspension_stiffness
    )
    for name, value in TABLE_1.to_mapping().items():
        expected = value if isinstance(value, str) else pytest.approx(value, rel=1e-13)
        assert getattr(unit, name) == expected, name


def test_fields_given_beside_the_file(tmp_path):
    path = written(tmp_path, KNOWN)
    fields = {
        "sidewall_damping": "reaction",
        "zeta_s": 0.3,
        "width": 0.16,
        "thickness": 0.02,
        "inflation_pressure": 3e5,
    }
    unit, sources, *_ = unit_from_tir(path, **GIVEN, **fields)
    assert {name: getattr(unit, name) for name in fields} == fields
    assert all(sources[name].kind == "given" for name in fields)
    # the file's numbers stand, whatever the section
    assert unit.ring_mass == pytest.approx(7.247, rel=1e-15)
    assert unit.sidewall_stiffness == pytest.approx(1.7038e6, abs=0.5e2)
    assert unit.bending_stiffness == pytest.approx(TABLE_1.bending_stiffness * (0.02 / TABLE_1.thickness) ** 3)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"radius": 0.3}, "radius cannot be given; the file says it"),
        ({"zeta_1": 0.1}, "zeta_1 cannot be given; the file says it"),
        ({"rim": 0.1}, "'rim' is not a field of TireWheelUnit"),
        ({"wheel_mass": -1.0}, "wheel_mass is -1.0; it must be > 0"),
        ({"wheel_mass": "12"}, "wheel_mass is '12'; it must be a number"),
        ({"suspension_stiffness": math.nan}, "suspension_stiffness is nan; it must be finite"),
        ({"thickness": 0.29}, "thickness is 0.29; a thin ring needs thickness < radius = 0.2804"),
        ({"thickness": 1e-200}, "thickness is 1e-200; it must be from 1e-06 to 10 m"),
        ({"width": 1e300}, "width is 1e+300; it must be from 0.001 to 10 m"),
        ({"sidewall_damping": "none"}, "sidewall_damping is 'none'; it must be 'modal' or 'reaction'"),
    ],
)
def test_wrong_fields(tmp_path, fields, words):
    assert words in refusal(written(tmp_path, KNOWN), **fields)


# -- units of measurement -----------------------------------------------------------------------------------------

POUND, INCH = 0.45359237, 0.0254  # [kg], [m], by definition
UNITS = [
    # LENGTH, MASS, FORCE, TIME and how many SI units each is
    ("mm", 1e-3, "kg", 1.0, "newton", 1.0, "second", 1.0),
    ("METER", 1.0, "gram", 1e-3, "N", 1.0, "sec", 1.0),
    ("Inch", INCH, "pound_mass", POUND, "pound_force", POUND * 9.80665, "s", 1.0),
    ("foot", 12 * INCH, "slug", POUND * 9.80665 / (12 * INCH), "lbf", POUND * 9.80665, "minute", 60.0),
    ("cm", 1e-2, "tonne", 1e3, "kg_force", 9.80665, "millisecond", 1e-3),
]


@pytest.mark.parametrize(("length", "m", "mass", "kg", "force", "N", "time", "s"), UNITS)
@pytest.mark.parametrize("quote", ["'", '"', ""])
def test_units(tmp_path, length, m, mass, kg, force, N, time, s, quote):
    """The known tire in other units, in which a pressure is a force over a length squared."""
    text = changed(
        LENGTH=quote + length + quote, MASS=None, FORCE=quote + force + quote, TIME=quote + time + quote,
        BELT_MASS=7.247 / kg, BELT_IYY=0.5698 / (kg * m * m), FREQ_LONG=77.17 * s, FREQ_WINDUP=58.95 * s,
        WIDTH=0.205 / m, UNLOADED_RADIUS=0.3135 / m, INFLPRES=220e3 * m * m / N,
    ).replace("[UNITS]", f"[UNITS]\nMASS = {quote}{mass}{quote}")  # fmt: skip
    unit = read_tir_unit(written(tmp_path, text), **GIVEN)
    known = read_tir_unit(written(tmp_path, KNOWN), **GIVEN)
    for name, value in known.to_mapping().items():
        expected = value if isinstance(value, str) else pytest.approx(value, rel=1e-12)
        assert getattr(unit, name) == expected, name


def test_a_pressure_of_its_own_unit(tmp_path):
    text = changed(INFLPRES=2.2).replace("[UNITS]", "[UNITS]\nPRESSURE = 'bar'")
    assert read_tir_unit(written(tmp_path, text), **GIVEN).inflation_pressure == 220e3


@pytest.mark.parametrize(("key", "pressure"), [("INFLPRES", 220e3), ("NOMPRES", 200e3)])
def test_which_pressure(tmp_path, key, pressure):
    text = changed(NOMPRES="unknown") if key == "INFLPRES" else changed(INFLPRES=None)  # the other is not looked at
    unit, sources, *_ = unit_from_tir(written(tmp_path, text), **GIVEN)
    assert (unit.inflation_pressure, sources["inflation_pressure"]) == (pressure, ("file", key))


def test_what_nothing_hangs_on_may_be_absurd(tmp_path):
    path = written(tmp_path, changed(WIDTH="205", INFLPRES="0").replace("MASS = 9.3", "MASS = 0"))
    unit, _, notes, *_ = unit_from_tir(path, **GIVEN, width=0.16, inflation_pressure=2e5)
    assert (unit.width, unit.inflation_pressure, notes) == (0.16, 2e5, ())


def test_without_units_they_are_SI_and_it_is_said(tmp_path):
    text = KNOWN.replace("[UNITS]", "[NOTHING]")
    unit, _, notes, *_ = unit_from_tir(written(tmp_path, text), **GIVEN)
    assert unit == read_tir_unit(written(tmp_path, KNOWN), **GIVEN)
    assert notes[0] == "[UNITS] does not say LENGTH, MASS, FORCE, TIME; SI units are assumed"


# The names that Adams' UNITS statement and MotionView's document, and those of tires' files, with what each is.
NAMES = {
    "LENGTH": {
        **dict.fromkeys(("m", "METER", "meters", "metre"), 1.0),
        **dict.fromkeys(("mm", "millimeter", "MILLIMETERS"), 1e-3),
        **{"centimeter": 1e-2, "cm": 1e-2, "km": 1e3, "kilometer": 1e3, "micrometer": 1e-6, "um": 1e-6},
        **{"nanometer": 1e-9, "mile": 1609.344, "miles": 1609.344, "yard": 0.9144, "foot": 0.3048, "feet": 0.3048},
        **{"inch": INCH, "inches": INCH},
        **{"mils": 1e-3 * INCH, "microinch": 1e-6 * INCH, "angstrom": 1e-10},
    },
    "MASS": {
        **{"kg": 1.0, "kilogram": 1.0, "gram": 1e-3, "grams": 1e-3, "mg": 1e-6, "milligram": 1e-6, "microgram": 1e-9},
        **{"Mg": 1e3, "megagram": 1e3, "tonne": 1e3, "ton": 1e3, "us_ton": 2000 * POUND, "kpound_mass": 1000 * POUND},
        **dict.fromkeys(("slug", "slugs"), POUND * 9.80665 / 0.3048),
        **{"pound_mass": POUND, "ounce_mass": POUND / 16, "slinch": POUND * 9.80665 / INCH},
    },
    "FORCE": {
        **{"newton": 1.0, "Newtons": 1.0, "N": 1.0, "kN": 1e3, "knewton": 1e3, "mN": 1e-3, "MN": 1e6},
        **{"meganewton": 1e6, "millinewton": 1e-3, "centinewton": 1e-2, "micronewton": 1e-6, "dyne": 1e-5},
        **{"kg_force": 9.80665, "kilogram_force": 9.80665, "pound_force": POUND * 9.80665},
        **{"kpound_force": 1000 * POUND * 9.80665},
        **{"ounce_force": POUND * 9.80665 / 16, "poundal": POUND * 0.3048},
    },
    "TIME": {
        **{"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0},
        **dict.fromkeys(("milli", "millisecond", "milliseconds"), 1e-3),
        **{"microsecond": 1e-6, "minute": 60.0, "min": 60.0, "hour": 3600.0, "day": 86400.0},
    },
}  # fmt: skip


@pytest.mark.parametrize(
    ("quantity", "name", "size"), [(q, n, x) for q, names in NAMES.items() for n, x in names.items()]
)
def test_every_name_of_a_unit(tmp_path, quantity, name, size):
    """One value that hangs on this unit alone: a length, a mass, a pressure per square metre, a frequency."""
    values = {"LENGTH": ("WIDTH", 0.2, size), "MASS": ("BELT_MASS", 7.0, size), "FORCE": ("INFLPRES", 2e5, size),
              "TIME": ("FREQ_LONG", 77.0, 1.0 / size)}  # fmt: skip
    key, value, factor = values[quantity]
    text = KNOWN.replace(f"{quantity} = ", f"{quantity} = {name} $ ", 1)
    text = "\n".join(
        f"{key} = {value / factor!r}" if line.startswith(f"{key} =") else line for line in text.splitlines()
    )
    assert TirFile(written(tmp_path, text)).number(key) == pytest.approx(value, rel=1e-12)


def test_what_is_blank_or_zero_is_absent(tmp_path):
    zero = dict.fromkeys(("WIDTH", "INFLPRES", "NOMPRES", "UNLOADED_RADIUS"), "0.0")
    text = changed(**zero).replace("MASS = 9.3", "MASS =\nIYY = 0\nVERTICAL_STIFFNESS =")
    unit, sources, notes, doubts, *_ = unit_from_tir(written(tmp_path, text), **GIVEN)
    assert unit.width == pytest.approx(TABLE_1.width / TABLE_1.radius * unit.radius, rel=1e-14)
    assert sources["inflation_pressure"].kind == "assumed" and notes == doubts == ()
    # no damping is one
    assert read_tir_unit(written(tmp_path, changed(DAMP_LONG="0")), **GIVEN).zeta_1 == 0.0


def test_without_any_header(tmp_path):
    """Keys as they stand, MASS once as a unit and once as a mass."""
    text = "\n".join(line for line in KNOWN.splitlines() if not line.startswith("[")) + "\n"
    unit = read_tir_unit(written(tmp_path, text), **GIVEN)
    assert unit == read_tir_unit(written(tmp_path, KNOWN), **GIVEN)


@pytest.mark.parametrize("line", ["WIDTH 0.205", "WIDTH: 0.205", "width\t:0.205 $ section"])
def test_lines_without_an_equals_sign_are_said(tmp_path, line):
    text = changed(WIDTH=None).replace("[DIMENSION]", f"[DIMENSION]\n{line}")
    notes = unit_from_tir(written(tmp_path, text), **GIVEN).notes
    assert any(note.startswith("line 11 is ") and "it must be WIDTH = value" in note for note in notes)
    # one that stands beside a value, and words of a title, are nobody's concern
    text = KNOWN.replace("[DIMENSION]", "[DIMENSION]\nWIDTH of the section\nRADIUS 0.3")
    assert not any("is not read" in note for note in unit_from_tir(written(tmp_path, text), **GIVEN).notes)


# -- what does not fit --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "words"),
    [
        # a truck's file, with the belt of a car: nearer to the rim than to the tread
        (changed(BELT_IYY="0.9"), "sqrt(BELT_IYY/BELT_MASS) = 0.3524 m, is more than UNLOADED_RADIUS = 0.3135 m"),
        (changed(UNLOADED_RADIUS="0.538\nRIM_RADIUS = 0.2858"), "0.2804 m, is within RIM_RADIUS = 0.2858 m"),
        (changed(UNLOADED_RADIUS="0.538\nRIM_RADIUS = 0.25"), "0.2804 m, is nearer to RIM_RADIUS"),
        (changed(UNLOADED_RADIUS="0.3135\nRIM_RADIUS = 0.35"), "RIM_RADIUS = 0.35 m is not less than UNLOADED_RADIUS"),
        (KNOWN.replace("MASS = 9.3", "MASS = 7.0"), "BELT_MASS = 7.247 is not less than MASS = 7, of which it is"),
        (KNOWN.replace("MASS = 9.3", "MASS = 60"), "BELT_MASS = 7.247 is 12% of MASS = 60"),
        (KNOWN.replace("MASS = 9.3", "MASS = 9.3\nIYY = 0.5"), "BELT_IYY = 0.5698 is not less than IYY = 0.5"),
        (KNOWN.replace("MASS = 9.3", "MASS = 9.3\nIYY = 6"), "BELT_IYY = 0.5698 is 9% of IYY = 6"),
        (KNOWN.replace("MASS = 9.3", "MASS = kg"), "MASS is 'kg' in line 17; it must be a number"),
        (changed(INFLPRES="2.2").replace("'newton'", "'newton'\nPRESSURE='MPa'"),
         "INFLPRES is 22 bar; 2.2 bar would be INFLPRES = 0.22 in the file's unit"),
        (changed(INFLPRES="32").replace("'newton'", "'newton'\nPRESSURE='kPa'"),
         "INFLPRES is 0.32 bar; 32 psi would be INFLPRES = 220.632 in the file's unit"),
        (changed(BELT_MASS="7.0", BELT_IYY="0.6", FREQ_LONG="80", FREQ_WINDUP="70", DAMP_LONG="0.04"),
         "BELT_MASS = 7, BELT_IYY = 0.6, FREQ_LONG = 80, FREQ_WINDUP = 70, DAMP_LONG = 0.04 are what tools write by"),
        (with_stiffness(changed(UNLOADED_RADIUS="0.3135\nRIM_RADIUS = 0.1905"), "2.1e6"),
         "VERTICAL_STIFFNESS is 2.1e+06 N/m; a tire of this size and pressure has about 2.3e+05"),
    ],
)  # fmt: skip
def test_doubts(tmp_path, text, words):
    """Used as it is, and said: in the result, as a warning, in the YAML and by the command."""
    path = written(tmp_path, text)
    doubts = unit_from_tir(path, **GIVEN).doubts
    assert any(words in doubt for doubt in doubts), doubts
    with pytest.warns(UserWarning) as caught:
        read_tir_unit(path, **GIVEN)
    assert [str(each.message) for each in caught] == [f"{path}: {doubt}" for doubt in doubts]


def test_no_doubt_about_a_sound_file(tmp_path):
    text = with_stiffness(changed(UNLOADED_RADIUS="0.3135\nRIM_RADIUS = 0.1905"), 209651)
    text = text.replace("MASS = 9.3", "MASS = 9.3\nIYY = 0.736")
    assert unit_from_tir(written(tmp_path, text), **GIVEN).doubts == ()


# -- how stiff it stands ------------------------------------------------------------------------------------------


def test_a_ring_that_is_too_soft_bends_less(tmp_path):
    """The bending stiffness is raised until the ring carries VERTICAL_STIFFNESS, and 1 % more for a residual spring."""
    soft = unit_from_tir(written(tmp_path, KNOWN), **GIVEN).unit
    own = 1.0 / static_compliance(soft, 100)
    text = with_stiffness(KNOWN, repr(1.3 * own))
    unit, sources, notes, *_ = unit_from_tir(written(tmp_path, text), **GIVEN)
    assert 1.0 / static_compliance(unit, 100) == pytest.approx(1.01 * 1.3 * own, rel=1e-9)  # brentq's
    assert unit.bending_stiffness > soft.bending_stiffness
    assert unit.vertical_stiffness == pytest.approx(1.3 * own, rel=1e-15)
    others = {"bending_stiffness": soft.bending_stiffness, "vertical_stiffness": 0.0}
    assert unit.to_mapping() | others == soft.to_mapping()
    assert "raised" in sources["bending_stiffness"].reason and any("raised from 16" in note for note in notes)

    given = unit_from_tir(written(tmp_path, text), **GIVEN, bending_stiffness=20.0)
    assert given.unit.bending_stiffness == 20.0 and any("is given, and stays" in note for note in given.notes)


def test_a_ring_that_is_stiff_enough_stays(tmp_path):
    text = with_stiffness(KNOWN, 100000)
    unit, sources, notes, *_ = unit_from_tir(written(tmp_path, text), **GIVEN)
    assert unit.bending_stiffness == unit_from_tir(written(tmp_path, KNOWN), **GIVEN).unit.bending_stiffness
    assert not any("stiffness" in note for note in notes)


def test_a_stiffness_that_no_ring_has_is_said(tmp_path):
    """The sidewall is in series: no ring is stiffer than k_1."""
    text = with_stiffness(KNOWN, "2e6")
    unit, _, notes, *_ = unit_from_tir(written(tmp_path, text), **GIVEN)
    own = f"{1.0 / static_compliance(unit, 100):.4g} N/m, below VERTICAL_STIFFNESS = 2e+06 N/m"
    words = f"static stiffness is {own}; no bending stiffness mends that, for k_1 is 1.704e+06 N/m"
    assert any(words in note for note in notes)
    assert unit.vertical_stiffness == 0.0 and any("left at 0, a rigid tread" in note for note in notes)


def test_a_stiffness_is_the_tires_only_in_its_own_section(tmp_path):
    """[VERTICAL] of Magic Formula files, [PARAMETER] of Fiala's; that of a rim is neither read nor a second one."""
    text = with_stiffness(KNOWN, 100000) + "[RIM]\nVERTICAL_STIFFNESS = 9e5\n"
    both = unit_from_tir(written(tmp_path, text), **GIVEN)
    assert both.unit.vertical_stiffness == 100000.0 and not any("not read" in note for note in both.notes)
    fiala = unit_from_tir(written(tmp_path, text.replace("VERTICAL]", "PARAMETER]")), **GIVEN)
    assert fiala.unit == both.unit
    rim = unit_from_tir(written(tmp_path, KNOWN + "[RIM]\nVERTICAL_STIFFNESS = 9e5\n"), **GIVEN)
    assert rim.unit.vertical_stiffness == 0.0
    words = "VERTICAL_STIFFNESS in line 25 is in [RIM], and not read; the tire's is in [VERTICAL] or [PARAMETER]"
    assert words in rim.notes


# -- keys in place of the file's ----------------------------------------------------------------------------------


def test_keys_that_are_given(tmp_path):
    text = changed(FREQ_LONG="heavy", LENGTH="mm", BELT_IYY="569800", UNLOADED_RADIUS="313.5", WIDTH=None,
                   INFLPRES="0.22", NOMPRES=None)  # fmt: skip
    made = unit_from_tir(written(tmp_path, text), **GIVEN, keys={"FREQ_LONG": 77.17, "width": "205"})
    known = read_tir_unit(written(tmp_path, KNOWN), **GIVEN)
    for name, value in known.to_mapping().items():
        expected = value if isinstance(value, (str, list)) else pytest.approx(value, rel=1e-12)
        assert made.unit.to_mapping()[name] == expected, name
    assert made.sources["radial_stiffness"].reason.endswith("; FREQ_LONG given")
    assert "key 'MASSE' cannot be given; those that are read are BELT_MASS," in refusal(
        written(tmp_path, KNOWN), keys={"MASSE": 1}
    )
    assert "FREQ_LONG is '-1', as given; it must be from 1 to" in refusal(
        written(tmp_path, KNOWN), keys={"FREQ_LONG": -1}
    )


# -- how it is written --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        KNOWN.replace("\n", "\r\n"),
        KNOWN.replace("\n", "\r"),
        KNOWN.lower(),
        KNOWN.replace(" = ", "="),
        KNOWN.replace(" = ", "\t =\t "),
        KNOWN.replace("[INERTIA]", "[ Inertia ]  $ masses"),
        KNOWN.replace("7.247", "'7.247' $ BELT_MASS = 8"),
        KNOWN.replace("7.247", "+7.247D+00"),
        KNOWN.replace("7.247", "&\n   7.247"),
        KNOWN.replace("BELT_IYY", "! BELT_MASS = 8\n$BELT_MASS = 9\nBELT_IYY"),
        KNOWN + "[SHAPE]\n{radial width}\n1.0 0.0\n0.9 1.0\n",
        KNOWN + "[X]\nQ = 1\nQ = 2\nEMPTY =\n'text with = in it'\n",  # what nobody needs may be anything
        KNOWN.replace("[INERTIA]", "[STRUCTURAL]"),  # a section that comes twice, and keys in another
        "a line before any section = 1\n" + KNOWN,
        KNOWN.removesuffix("\n"),
        "\ufeff" + KNOWN,
        KNOWN + "$ Gürtel, 20 °C\n",
        KNOWN + "BELT_MASS = 7.247\nDAMP_LONG =\n[UNITS]\nLENGTH = METER\n",  # the same again, or nothing
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "utf-16"])
def test_every_way_to_write_it(tmp_path, text, encoding):
    if encoding == "latin-1":
        text = text.removeprefix("\ufeff") + "$ \x85 ends a line for Unicode, and is a letter of a code page\n"
    unit = read_tir_unit(written(tmp_path, text, encoding), **GIVEN)
    (tmp_path / "known").mkdir()
    known = read_tir_unit(written(tmp_path / "known", KNOWN), **GIVEN)
    assert unit == known


def test_sections_and_lines(tmp_path):
    sections = read_tir(written(tmp_path, "[a]\nx = 1 $ c\nx = 'two' ! c\n[B]\ny = 'it $ stays'\n"))
    assert sections == {"A": {"X": [("1", 2), ("two", 3)]}, "B": {"Y": [("it $ stays", 5)]}}


@given(st.binary(max_size=400))
def test_any_bytes_give_a_unit_or_a_reason(tmp_path_factory, content):
    """At the end of a good file as well, where the keys are known."""
    for whole in (content, KNOWN.encode() + content):
        path = written(tmp_path_factory.getbasetemp(), whole)
        try:
            read_tir_unit(path, **GIVEN)
        except ValueError as error:
            assert str(path) in str(error)


# -- what is refused ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "words"),
    [
        *((changed(**{key: None}), f": {key} is missing; it is a file that does not say its format, without the")
          for key in ("BELT_MASS", "BELT_IYY", "FREQ_LONG", "FREQ_WINDUP", "DAMP_LONG")),
        (changed(BELT_MASS="heavy"), "BELT_MASS is 'heavy' in line 18; it must be a number"),
        (changed(BELT_MASS="7,247"), "BELT_MASS is '7,247' in line 18; it must be a number"),
        (changed(BELT_MASS="nan"), "BELT_MASS is 'nan' in line 18; it must be a number"),
        (changed(BELT_MASS=""), "BELT_MASS (blank in line 18) is missing"),
        (changed(BELT_MASS="7_247"), "BELT_MASS is '7_247' in line 18; it must be a number"),
        (changed(BELT_MASS="0.0"), "BELT_MASS (0.0 in line 18) is missing"),
        (changed(BELT_MASS=None, FREQ_LONG=None).replace("[DIM", "[MODEL]\nPROPERTY_FILE_FORMAT='PAC2002'\n[DIM"),
         "BELT_MASS, FREQ_LONG are missing; it is a file with PROPERTY_FILE_FORMAT = PAC2002, without"),
        (changed(BELT_MASS=None) + "BELT_MASS 7.247\n",
         "BELT_MASS (line 23 is 'BELT_MASS 7.247'; it must be BELT_MASS = value) is missing"),
        (changed(BELT_MASS="-7"), "BELT_MASS is '-7' in line 18; it must be from 0.05 to 5000 kg"),
        (changed(BELT_MASS="1e999"), "BELT_MASS is '1e999' in line 18; it must be from 0.05 to 5000 kg"),
        (changed(LENGTH="mm", BELT_IYY="0.5698"), "BELT_IYY is '0.5698' in line 19, 5.698e-07 kg m^2; it must be from"),
        (changed(BELT_IYY="569.8"), "(BELT_IYY/BELT_MASS), the radius, is 8.86711 m; it must be from 0.05 to 2.5 m"),
        (changed(FREQ_LONG="0"), "FREQ_LONG (0 in line 21) is missing"),
        (changed(FREQ_WINDUP="1e5"), "FREQ_WINDUP is '1e5' in line 22; it must be from 1 to 1000 Hz"),
        (changed(FREQ_WINDUP="110"), "FREQ_WINDUP is 110 Hz; it must be less than sqrt(2) FREQ_LONG = 109.135 Hz"),
        (changed(DAMP_LONG="5.6"), "DAMP_LONG is '5.6' in line 23; it must be in [0, 1)"),
        (changed(DAMP_LONG="1"), "DAMP_LONG is '1' in line 23; it must be in [0, 1)"),
        (changed(WIDTH="205"), "WIDTH is '205' in line 12; it must be from 0.01 to 2 m"),
        (changed(INFLPRES="2.2"), "INFLPRES is '2.2' in line 14; it must be from 10000 to 5e+06 Pa; 2.2 bar would be "
         "INFLPRES = 220000 in the file's unit"),
        (changed(LENGTH="furlong"), "LENGTH is 'furlong' in line 5; it must be one of m, meter,"),
        (changed(FORCE="pound"), "FORCE is 'pound' in line 6; it must be one of n, newton,"),
        (KNOWN + "BELT_MASS = 7.3\n", "BELT_MASS is given twice, in lines 18 and 24, as 7.247 and 7.3"),
        (KNOWN + "[UNITS]\nLENGTH = 'mm'\n", "LENGTH is given twice, in lines 5 and 25, as meter and mm"),
        (KNOWN.replace("'tir'", "'rdf'"), "FILE_TYPE is 'rdf'; it must be 'tir'"),
        (KNOWN.replace("[INERTIA]", "[INERTIA"), "line 16 is '[INERTIA'; a section must be [NAME]"),
        ("", "is no tire property file; it has no [SECTION] with lines of KEY = value"),
        ("radius: 0.3\nwidth: 0.2\n", "it has no [SECTION] with lines of KEY = value; line 2 is 'width: 0.2'"),
        ("[UNITS]\n", "is no tire property file"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "is not a text file"),
        (b"\xff\xfe\0", "is not a text file"),
        (KNOWN.encode() + b"$" * 5_000_000, "is too large for a tire property file; it must be at most 4194304 bytes"),
    ],
)  # fmt: skip
def test_one_line_says_what_is_wrong(tmp_path, text, words):
    path = written(tmp_path, text)
    said = refusal(path)
    assert said.startswith(str(path)) and words in said


def test_no_file_at_all(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_tir_unit(tmp_path / "nowhere.tir", **GIVEN)
    with pytest.raises(IsADirectoryError):
        read_tir_unit(tmp_path, **GIVEN)
    os.mkfifo(tmp_path / "pipe.tir")
    assert "is not a file" in refusal(tmp_path / "pipe.tir")  # and does not wait for a writer


# -- the command --------------------------------------------------------------------------------------------------

OPTIONS = ("--wheel-mass", "12", "--suspension-stiffness", "3.2e4")


def refused(capsys, *arguments):
    assert main([str(argument) for argument in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    return err


def test_the_yaml_is_a_unit_and_marks_what_is_assumed(tmp_path, capsys):
    path, output = written(tmp_path, KNOWN), tmp_path / "unit.yaml"
    assert main(["import-tir", str(path), "-o", str(output), *OPTIONS]) == 0
    out, err = capsys.readouterr()
    unit, sources, notes, *_ = unit_from_tir(path, **GIVEN)
    assert read_unit(output) == unit
    fields = [line for line in output.read_text().splitlines() if not line.startswith("#")]
    assert len(fields) == len(sources)
    for line, (name, source) in zip(fields, sources.items(), strict=True):
        assert line.startswith(f"{name}: ") and line.endswith(f"{source.reason}")
        assert ("# assumed: " in line) == (source.kind == "assumed") == (f"  {name} " in err)
    assert out == "" and "7 fields from the file, 2 given, 18 assumed" in err
    assert all(f"note: {note}" in err for note in notes) and str(tmp_path) not in output.read_text()


def test_the_yaml_serves_the_other_commands(tmp_path, capsys):
    path, output = written(tmp_path, KNOWN), tmp_path / "unit.yaml"
    arguments = ["import-tir", str(path), "-o", str(output), *OPTIONS, "--set", "sidewall_damping=reaction"]
    assert main([*arguments, "--set", "zeta_s=0.3", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    unit = read_tir_unit(path, **GIVEN, sidewall_damping="reaction", zeta_s=0.3)
    assert said["unit"] == unit.to_mapping() and said["sidewall_stiffness_N_m"] == unit.sidewall_stiffness
    assert said["sources"]["zeta_s"] == {"kind": "given", "reason": "given"}
    assert main(["stability", "--speed-rpm", "800", "--config", str(output)]) == 0
    verdict = wheel.stability(unit, 800 * math.pi / 30.0).verdict
    assert json.loads(capsys.readouterr().out)["verdict"] == verdict


def test_keys_and_lists_by_the_command(tmp_path, capsys):
    path, output = written(tmp_path, changed(FREQ_LONG=None)), tmp_path / "unit.yaml"
    arguments = ["import-tir", str(path), "-o", str(output), *OPTIONS, "--key", "freq_long=77.17", "-q"]
    assert main([*arguments, "--set", "radial_runout=[[1, 0.001, 0]]", "--set", "imbalance_mass=0.02"]) == 0
    unit = read_unit(output)
    assert unit.radial_runout == ((1, 0.001, 0.0),) and unit.imbalance_mass == 0.02
    assert unit.mean.sidewall_stiffness == pytest.approx(1.7038e6, abs=0.5e2)


def test_a_tire_file_for_config_names_the_command(tmp_path, capsys):
    path = written(tmp_path, KNOWN)
    said = refused(capsys, "stability", "--speed-rpm", "800", "--config", path)
    assert "tire.tir: is a tire property file; tire-dynamics import-tir makes the YAML of a unit of it" in said


def test_any_name_of_a_file(tmp_path, capsys):
    path = tmp_path / "a\nb: 1 #.tir"
    path.write_text(KNOWN)
    output = tmp_path / "unit.yaml"
    assert main(["import-tir", str(path), "-o", str(output), *OPTIONS]) == 0
    assert read_unit(output).radius == pytest.approx(0.2804, abs=0.5e-4)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.tir"], "nowhere.tir: No such file"),
        (["bad.tir"], "bad.tir: BELT_MASS is missing; it is a file that"),
        (["--set", "radius=0.3"], "--set is 'radius=0.3'; it must be FIELD=VALUE, FIELD one of bending_stiffness,"),
        (["--set", "zeta_s"], "--set is 'zeta_s'; it must be FIELD=VALUE"),
        (["--set", "radial_runout=1"], "radial_runout is 1"),
        (["--set", "radial_runout=[[1,"], "--set is 'radial_runout=[[1,'; VALUE must be a list as in [[1,0.001,0]]"),
        (["--key", "FREQ_LONG"], "--key is 'FREQ_LONG'; it must be KEY=VALUE, KEY one of BELT_MASS,"),
        (["--key", "FREQ=77"], "--key is 'FREQ=77'; it must be KEY=VALUE"),
        (["--key", "WIDTH=1", "--key", "WIDTH=2"], "no key may be given twice"),
        (["--key", "WIDTH=wide"], "WIDTH is 'wide', as given; it must be a number"),
        (["--set", "zeta_s=some"], "--set is 'zeta_s=some'; VALUE must be a number"),
        (["--set", "zeta_s=2"], "zeta_s is 2.0; a damping ratio must be in [0, 1)"),
        (["--set", "zeta_s=0.1", "--set", "zeta_s=0.2"], "no field may be given twice"),
        (["--wheel-mass", "0"], "wheel_mass is 0.0; it must be > 0"),
        (["--wheel-mass", "heavy"], "--wheel-mass"),
        (["-o", "nowhere/unit.yaml"], "nowhere: no such folder"),
        (["-o", "there.yaml"], "there.yaml: exists already (--force replaces it)"),
        (["-o", "tire.tir", "--force"], "tire.tir: is the file that is read"),
    ],
)
def test_what_the_command_refuses(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, KNOWN)
    (tmp_path / "bad.tir").write_text(changed(BELT_MASS=None))
    (tmp_path / "there.yaml").write_text("mine")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    source = arguments.pop(0) if arguments[0].endswith(".tir") else "tire.tir"
    assert words in refused(capsys, "import-tir", source, "-o", "unit.yaml", *OPTIONS, *arguments)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_force_replaces(tmp_path):
    path, output = written(tmp_path, KNOWN), tmp_path / "unit.yaml"
    output.write_text("mine")
    assert main(["import-tir", str(path), "-o", str(output), *OPTIONS, "--force", "--quiet"]) == 0
    assert read_unit(output) == read_tir_unit(path, **GIVEN)


def test_as_a_program(tmp_path):
    """The status and the one line, as a shell sees them."""
    path = written(tmp_path, changed(BELT_IYY="569.8"))
    command = [sys.executable, "-m", "tire_dynamics.cli.main", "import-tir", str(path), *OPTIONS]
    done = subprocess.run([*command, "-o", str(tmp_path / "unit.yaml")], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert not (tmp_path / "unit.yaml").exists()
