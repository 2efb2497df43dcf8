"""The unit's parameters: what is refused and how it says so, and YAML in and out without losing a bit."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from tire_dynamics import TireWheelUnit, read_unit, ring, write_unit
from tire_dynamics.files.yaml_file import read_yaml, yaml_number

FIELDS = [field.name for field in dataclasses.fields(TireWheelUnit)]
RATIOS = ["zeta_1", "zeta_s", "zeta_n", "longitudinal_damping_ratio"]
NOT_NEGATIVE = [
    "longitudinal_stiffness", "longitudinal_mass", "imbalance_mass", "residual_damping",
    "sprung_mass",
]  # fmt: skip
HARMONICS = ["radial_nonuniformity", "tangential_nonuniformity", "radial_runout"]
SPECIAL = ["contact_half_angle", "imbalance_angle", "vertical_stiffness"]  # bounds of their own
OTHERS = (*RATIOS, *NOT_NEGATIVE, *HARMONICS, *SPECIAL, "sidewall_damping")
POSITIVE = [name for name in FIELDS if name not in OTHERS]
NUMBERS = [*POSITIVE, *RATIOS, *NOT_NEGATIVE, *SPECIAL]
TABLE_1 = TireWheelUnit.table_1()
CONFIG = Path(__file__).parents[1] / "config" / "table_1.yaml"

positive = st.floats(min_value=1e-12, max_value=1e12)
ratio = st.floats(min_value=0.0, max_value=1.0, exclude_max=True)
half_angle = st.floats(min_value=0.0, max_value=0.5 * math.pi)
angle = st.floats(-1e3, 1e3)


def harmonics(most):
    """Harmonics whose amplitudes add up to less than ``most``."""
    one = st.tuples(st.integers(1, 100), st.floats(0.0, most / 5.0), angle)
    return st.lists(one, max_size=4, unique_by=lambda item: item[0]).map(tuple)


@st.composite
def mappings(draw):
    """Every field, anywhere in its bounds."""
    values = {name: draw(positive) for name in POSITIVE} | {name: draw(ratio) for name in RATIOS}
    values["thickness"] = values["radius"] * draw(st.floats(1e-3, 0.99))
    values["contact_half_angle"] = draw(half_angle)
    values |= {name: draw(st.just(0.0) | positive) for name in NOT_NEGATIVE} | {"imbalance_angle": draw(angle)}
    own = ring.static_stiffness(TireWheelUnit(**values), 100)
    values["vertical_stiffness"] = draw(st.just(0.0) | st.floats(1e-9, 0.999)) * own
    values |= {name: draw(harmonics(1.0 if name != "radial_runout" else values["radius"])) for name in HARMONICS}
    return values | {"sidewall_damping": draw(st.sampled_from(["modal", "reaction"]))}


def test_fields():
    assert FIELDS == [
        "density", "bending_stiffness", "membrane_stiffness", "radius", "width", "thickness", "radial_stiffness",
        "tangential_stiffness", "inflation_pressure", "wheel_mass", "suspension_stiffness", "zeta_1", "zeta_s",
        "zeta_n", "contact_half_angle", "sidewall_damping", "longitudinal_stiffness", "longitudinal_damping_ratio",
        "longitudinal_mass", "radial_nonuniformity", "tangential_nonuniformity", "imbalance_mass", "imbalance_angle",
        "radial_runout", "vertical_stiffness", "residual_damping", "sprung_mass",
    ]  # fmt: skip


# -- validation -------------------------------------------------------------------------------------------------


@given(values=mappings())
def test_any_value_in_its_bounds_is_taken(values):
    unit = TireWheelUnit(**values)
    kept = {name: [list(each) for each in values[name] if each[1]] for name in HARMONICS}  # with an amplitude
    assert unit.to_mapping() == values | kept
    assert all(type(getattr(unit, name)) is float for name in NUMBERS)


def refused(name, value, bound):
    """The error of a changed Table 1 names the field, the value and what was expected, in one line."""
    with pytest.raises(ValueError) as caught:
        TABLE_1.replace(**{name: value})
    message = str(caught.value)
    assert message.startswith(name) and bound in message and "\n" not in message, message
    return message


def test_a_tire_on_the_road_is_softer_than_with_a_rigid_tread():
    """docs/model.md, section 11: k_c exists only while K_v is below the tire's own; both numbers are said."""
    own = ring.static_stiffness(TABLE_1, 100)
    for value in (own, 2.0 * own):
        assert repr(value) in refused("vertical_stiffness", value, f"{own:.10g}")
    assert "0" in refused("vertical_stiffness", -1.0, ">= 0")
    assert TABLE_1.replace(vertical_stiffness=0.999 * own).vertical_stiffness == 0.999 * own


@pytest.mark.parametrize("name", NOT_NEGATIVE)
@given(value=st.floats(max_value=0.0, exclude_max=True, allow_infinity=False))
@settings(max_examples=10)
def test_negative(name, value):
    assert repr(value) in refused(name, value, ">= 0")


@pytest.mark.parametrize("name", POSITIVE)
@given(value=st.floats(max_value=0.0, allow_infinity=False))
@settings(max_examples=10)
def test_not_positive(name, value):
    assert repr(value) in refused(name, value, "> 0")


@pytest.mark.parametrize("name", RATIOS)
@given(value=st.floats(min_value=1.0, allow_infinity=False) | st.floats(max_value=-1e-300, allow_infinity=False))
@settings(max_examples=10)
def test_not_a_damping_ratio(name, value):
    assert repr(value) in refused(name, value, "[0, 1)")


@given(value=st.floats(max_value=-1e-300, allow_infinity=False) | st.floats(min_value=1.571, allow_infinity=False))
@settings(max_examples=20)
def test_not_a_half_angle(value):
    assert repr(value) in refused("contact_half_angle", value, "[0, pi/2]")


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_not_finite(name, value):
    assert repr(value) in refused(name, value, "finite")


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", ["5.80e6", None, True, [1.0], 1j, np.array([1.0, 2.0])], ids=repr)
def test_not_a_number(name, value):
    assert repr(value) in refused(name, value, "number")


@pytest.mark.parametrize("name", HARMONICS)
@pytest.mark.parametrize(
    ("value", "bound"),
    [
        (3.0, "list of (harmonic, amplitude, angle)"),
        ("2, 0.1, 0.0", "list of (harmonic, amplitude, angle)"),
        (None, "list of (harmonic, amplitude, angle)"),
        ([2.0, 0.1], "three for each harmonic"),
        ([2.0, 0.1, 0.0, 3.0], "three for each harmonic"),
        ([[2, 0.1]], "(harmonic, amplitude, angle)"),
        ([(2, 0.1, 0.0), 7], "(harmonic, amplitude, angle)"),
        ([(0, 0.1, 0.0)], "from 1 to 100"),
        ([(101, 0.1, 0.0)], "from 1 to 100"),
        ([(2.5, 0.1, 0.0)], "integer"),
        ([(2, -0.1, 0.0)], ">= 0"),
        ([(2, math.nan, 0.0)], "finite"),
        ([(2, 0.1, math.inf)], "finite"),
        ([(2, 10**400, 0.0)], "finite"),
        ([(2, 0.1, 0.0), (2, 0.1, 1.0)], "once"),
    ],
    ids=repr,
)
def test_not_harmonics(name, value, bound):
    refused(name, value, bound)


def test_a_stiffness_below_zero_and_a_run_out_beyond_the_radius():
    for name in HARMONICS[:2]:
        refused(name, [(2, 1.0, 0.0)], "> 0")
        assert TABLE_1.replace(**{name: [(2, 0.6, 0.0), (1, 0.6, 0.0)]})  # it is 0.28 of the mean at the least
    refused("radial_runout", [(1, 0.2, 0.0), (2, 0.2, 0.0)], "< radius")


def test_harmonics_as_one_row_of_numbers():
    """As a ROS parameter has them; numbers of NumPy too."""
    nested = TABLE_1.replace(radial_nonuniformity=[[2, 0.1, 0.3], [3, 0.05, -1.0]])
    flat = TABLE_1.replace(radial_nonuniformity=np.array([2.0, 0.1, 0.3, 3.0, 0.05, -1.0]))
    assert nested == flat and hash(nested) == hash(flat)
    assert flat.radial_nonuniformity == ((2, 0.1, 0.3), (3, 0.05, -1.0))


def test_what_is_uniform():
    assert TABLE_1.is_uniform and TABLE_1.mean is TABLE_1
    assert TABLE_1.replace(radial_runout=[(1, 0.0, 0.3)], imbalance_angle=1.0).is_uniform
    for changes in ({"imbalance_mass": 0.1}, *({name: [(2, 1e-3, 0.0)]} for name in HARMONICS)):
        unit = TABLE_1.replace(**changes)
        assert not unit.is_uniform and unit.mean == TABLE_1


def test_beyond_what_a_double_holds():
    """YAML knows integers of any length."""
    refused("density", 10**400, "finite")


@pytest.mark.parametrize("value", ["Modal", "", None, 1, "none", ["modal"]], ids=repr)
def test_not_a_damping(value):
    message = refused("sidewall_damping", value, "'modal' or 'reaction'")
    assert repr(value) in message


@given(radius=positive, factor=st.floats(1.0, 1e3))
def test_not_thin(radius, factor):
    with pytest.raises(ValueError, match="thickness is .* thin ring .* radius"):
        TABLE_1.replace(radius=radius, thickness=radius * factor)


@pytest.mark.parametrize("value", [1, np.float32(1.0), np.int64(1), Fraction(1)], ids=repr)
def test_any_kind_of_real_number(value):
    """It becomes a float, so that equal units are equal, hash alike and print alike."""
    unit = TABLE_1.replace(wheel_mass=value)
    assert unit == TABLE_1.replace(wheel_mass=1.0) and hash(unit) == hash(TABLE_1.replace(wheel_mass=1.0))
    assert type(unit.wheel_mass) is float


@pytest.mark.parametrize("zeta", [0.0, 0.9999])
def test_ratio_bounds(zeta):
    for name in RATIOS:
        assert getattr(TABLE_1.replace(**{name: zeta}), name) == zeta


@pytest.mark.parametrize("angle", [0.0, 0.5 * math.pi])
def test_half_angle_bounds(angle):
    assert TABLE_1.replace(contact_half_angle=angle).contact_half_angle == angle


@pytest.mark.parametrize(
    "changes",
    [
        {"density": 1e-300, "thickness": 1e-300},  # a ring mass of zero
        {"radial_stiffness": 1e308, "radius": 1e10},  # k_1 beyond all numbers
        {"radius": 1e-100, "thickness": 1e-101},  # a^4 of zero
        {"suspension_stiffness": 1e300, "wheel_mass": 1e-300},
    ],
    ids=lambda changes: ", ".join(changes),
)
def test_in_bounds_but_together_beyond_what_a_double_holds(changes):
    with pytest.raises(ValueError, match="together beyond"):
        TABLE_1.replace(**changes)


# -- frozen, replace, table_1 -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FIELDS)
def test_frozen(name):
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(TABLE_1, name, 1.0)


BOUND_BY_OTHERS = {"radius", "thickness", "radial_runout", "vertical_stiffness"}


@given(values=mappings(), name=st.sampled_from(sorted({*FIELDS} - BOUND_BY_OTHERS)))
def test_replace(values, name):
    unit = TABLE_1.replace(**{name: values[name]})
    value = values[name] if name not in HARMONICS else [list(each) for each in values[name] if each[1]]
    assert unit.to_mapping() == TABLE_1.to_mapping() | {name: value}
    assert TABLE_1 == TireWheelUnit.table_1()


def test_replace_refuses_a_name_that_is_no_field():
    with pytest.raises(ValueError, match="'raduis' is not a field .* radius"):
        TABLE_1.replace(raduis=0.3)
    with pytest.raises(ValueError, match="'ring_mass'"):
        TABLE_1.replace(ring_mass=5.0)


def test_table_1_with_changes():
    assert TireWheelUnit.table_1(zeta_1=0.2, sidewall_damping="reaction") == TABLE_1.replace(
        zeta_1=0.2, sidewall_damping="reaction"
    )
    with pytest.raises(ValueError, match="zeta_1 is 1.5"):
        TireWheelUnit.table_1(zeta_1=1.5)


def test_copies_are_equal():
    for unit in (copy.deepcopy(TABLE_1), pickle.loads(pickle.dumps(TABLE_1))):
        assert unit == TABLE_1


@given(values=mappings())
def test_derived_quantities(values):
    """docs/model.md, section 2, in another order of factors: rounding only."""
    unit = TireWheelUnit(**values)
    a, b = unit.radius, unit.width
    m = 2 * math.pi * a * b * unit.density * unit.thickness
    assert unit.ring_mass == pytest.approx(m, rel=1e-14, abs=0.0)
    k_1 = math.pi * a * b * (unit.radial_stiffness + unit.tangential_stiffness)
    assert unit.sidewall_stiffness == pytest.approx(k_1, rel=1e-14, abs=0.0)
    kappa = (unit.radial_stiffness + unit.tangential_stiffness) / (2.0 * unit.density * unit.thickness)
    assert unit.rigid_mode_frequency == pytest.approx(math.sqrt(kappa), rel=1e-14, abs=0.0)
    c_s = 2.0 * unit.zeta_s * math.sqrt(unit.suspension_stiffness * (unit.wheel_mass + m))
    assert unit.suspension_damping == pytest.approx(c_s, rel=1e-14, abs=0.0)


# -- YAML -------------------------------------------------------------------------------------------------------


@settings(max_examples=50)
@given(values=mappings())
def test_yaml_round_trip(tmp_path_factory, values):
    """Every bit survives, through our own reader and through plain PyYAML, which follows YAML 1.1."""
    unit = TireWheelUnit(**values)
    path = tmp_path_factory.getbasetemp() / "unit.yaml"
    write_unit(unit, path)
    assert read_unit(path) == unit
    plain = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert TireWheelUnit.from_mapping(plain) == unit
    assert list(plain) == FIELDS


@given(number=st.floats(allow_nan=False, allow_infinity=False))
def test_yaml_number(number):
    text = yaml_number(number)
    assert float(text) == number
    assert type(yaml.safe_load(text)) is float and yaml.safe_load(text) == number


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def table_1_text(**changes):
    lines = {name: str(value) for name, value in TABLE_1.to_mapping().items()} | changes
    return "".join(f"{name}: {value}\n" for name, value in lines.items() if value is not None)


@pytest.mark.parametrize(
    "text", ["5.80e6", "5.8e+6", "58e5", "5800000", "5800000.", "+5.8E6", ".58e7", "580e+04", "5.80e06"]
)
def test_every_way_to_write_a_number(tmp_path, text):
    """YAML 1.1 takes half of these for text; nobody who writes 5.80e6 means text."""
    unit = read_unit(write(tmp_path / "unit.yaml", table_1_text(radial_stiffness=text)))
    assert unit.radial_stiffness == 5.8e6


@pytest.mark.parametrize(
    "text",
    ["'5.80e6'", '"5.80e6"', "5_800_000.0", "0x10", "0o7", "1:30", "5.80e", "e6", "5.8.0e6", "5.80e6 N", "1e5e5", "~",
     "true"],
)  # fmt: skip
def test_not_a_number_in_yaml(tmp_path, text):
    with pytest.raises(ValueError, match="radial_stiffness is .* number"):
        read_unit(write(tmp_path / "unit.yaml", table_1_text(radial_stiffness=text)))


@pytest.mark.parametrize(("text", "number"), [("010", 10.0), ("-0", 0.0), ("08.5", 8.5), ("1e0", 1.0)])
def test_numbers_as_yaml_1_2_reads_them(tmp_path, text, number):
    """YAML 1.1 takes 010 for eight."""
    path = write(tmp_path / "file.yaml", f"a: {text}\n")
    assert read_yaml(path) == {"a": number}


@pytest.mark.parametrize("text", ["no", "on", "y", "Off", "2001-01-01", "1:30", "0x10", "1_000", "=", "<<"])
def test_words_as_yaml_1_2_reads_them(tmp_path, text):
    """YAML 1.1 takes them for false, true, a date, ninety, sixteen, a thousand, and two signs of its own."""
    assert read_yaml(write(tmp_path / "file.yaml", f"a: {text}\n")) == {"a": text}


@pytest.mark.parametrize(
    ("text", "value"),
    [("true", True), ("False", False), ("null", None), ("~", None), ("", None), (".inf", math.inf),
     ("-.INF", -math.inf), ("-7", -7)],
)  # fmt: skip
def test_the_other_plain_values(tmp_path, text, value):
    assert read_yaml(write(tmp_path / "file.yaml", f"a: {text}\n")) == {"a": value}


def test_config_is_table_1():
    assert read_unit(CONFIG) == TABLE_1
    assert read_unit(str(CONFIG)) == TABLE_1
    assert TireWheelUnit.from_mapping(yaml.safe_load(CONFIG.read_text(encoding="utf-8"))) == TABLE_1


def test_defaults_in_yaml(tmp_path):
    text = table_1_text(**dict.fromkeys(OTHERS))
    assert read_unit(write(tmp_path / "unit.yaml", text)) == TABLE_1


@pytest.mark.parametrize("name", POSITIVE)
def test_missing_field(tmp_path, name):
    path = write(tmp_path / "unit.yaml", table_1_text(**{name: None}))
    with pytest.raises(ValueError, match=f"^{name} is missing"):
        read_unit(path)


@pytest.mark.parametrize("extra", ["raduis: 0.305", "zeta: 0.1", "Radius: 0.3", "1: 2", "~: 2", "true: 1"])
def test_field_that_is_none(tmp_path, extra):
    """Not a word of it is skipped."""
    path = write(tmp_path / "unit.yaml", table_1_text() + extra + "\n")
    with pytest.raises(ValueError, match="is not a field of TireWheelUnit; the fields are density, "):
        read_unit(path)


@pytest.mark.parametrize("name", FIELDS)
def test_field_given_twice(tmp_path, name):
    path = write(tmp_path / "unit.yaml", table_1_text() + f"{name}: {getattr(TABLE_1, name)}\n")
    with pytest.raises(ValueError, match=f"'{name}' is given twice"):
        read_unit(path)


def test_radius_of_minus_one(tmp_path):
    with pytest.raises(ValueError, match="^radius is -1.0; it must be > 0$"):
        read_unit(write(tmp_path / "unit.yaml", table_1_text(radius="-1")))


@pytest.mark.parametrize(
    "text",
    [
        "", "- 1\n", "5", "radius", "radius: [1, 2\n", "radius: {\n", "a: b: c\n", "\tradius: 1\n", "radius: \x01\n",
        "? [1]\n: 2\n", "? {a: 1}\n: 2\n", "? !!set {a}\n: 1\n", "radius: !!python/object:os.system {}\n",
        "radius: &x [*x]\n", "radius: *unknown\n", "radius: !!timestamp noon\n", "radius: 2001-99-99\n",
        "radius: !!int one\n", "radius: !!float one\n", "--- \na: 1\n---\nb: 2\n", "<<: {radius: 1}\n",
    ],
    ids=repr,
)  # fmt: skip
def test_not_such_a_file(tmp_path, text):
    """One clear line that names the file or the field, whatever it holds."""
    path = write(tmp_path / "unit.yaml", text)
    with pytest.raises(ValueError) as caught:
        read_unit(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message or any(name in message for name in FIELDS)


def test_not_text(tmp_path):
    path = tmp_path / "unit.yaml"
    path.write_bytes(b"\x89MCAP0\r\n\xff\xfe\x00")
    with pytest.raises(ValueError, match="unit.yaml"):
        read_unit(path)


def test_no_such_file(tmp_path):
    with pytest.raises(FileNotFoundError, match="unit.yaml"):
        read_unit(tmp_path / "unit.yaml")
    with pytest.raises(IsADirectoryError):
        read_unit(tmp_path)


def test_read_yaml_nested(tmp_path):
    """Duplicates are found in every mapping of the file, and numbers read in every list."""
    path = write(tmp_path / "file.yaml", "a: {b: 1e3, c: [1e-3, 2E6]}\n")
    assert read_yaml(path) == {"a": {"b": 1000.0, "c": [0.001, 2e6]}}
    with pytest.raises(ValueError, match="'b' is given twice"):
        read_yaml(write(path, "a: {b: 1, b: 2}\n"))


def test_the_units_own_methods_read_and_write_the_same_files(tmp_path):
    unit = TireWheelUnit.table_1(zeta_1=0.1)
    unit.to_yaml(tmp_path / "unit.yaml")
    assert TireWheelUnit.from_yaml(tmp_path / "unit.yaml") == unit
    with pytest.raises(ValueError, match="missing"):
        (tmp_path / "bad.yaml").write_text("density: -1.0\n")
        TireWheelUnit.from_yaml(tmp_path / "bad.yaml")
