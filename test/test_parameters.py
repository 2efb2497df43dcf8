"""The parameter table and the files that fill it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tire_dynamics import TireWheelUnit, read_unit
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay.parameters import PARAMETERS, complete, read_config, unit_of, vehicle_settings

CONFIG = Path(__file__).parents[1] / "config"
ROWS = {row.name: row for row in PARAMETERS}
TIRE_FIELDS = (
    "density", "bending_stiffness", "membrane_stiffness", "radius", "width", "thickness", "radial_stiffness",
    "tangential_stiffness", "inflation_pressure", "wheel_mass", "suspension_stiffness", "zeta_1", "zeta_s", "zeta_n",
    "sidewall_damping", "contact_half_angle", "longitudinal_stiffness", "longitudinal_damping_ratio",
    "longitudinal_mass", "radial_nonuniformity", "tangential_nonuniformity", "imbalance_mass", "imbalance_angle",
    "radial_runout", "vertical_stiffness", "residual_damping", "sprung_mass",
)  # fmt: skip


def test_the_table_has_the_names_and_defaults_of_the_interface():
    interface = {
        "wheels": ("wheel",),
        "rate_hz": 500.0,
        "ring_rate_hz": 50.0,
        "ring_samples": 72,
        "n_max": 30,
        "input_timeout_s": 0.2,
        "log.directory": "",
    }
    assert {name: ROWS[name].default for name in interface} == interface
    assert {f"tire.{field}" for field in TIRE_FIELDS} == {name for name in ROWS if name.startswith("tire.")}
    assert len(ROWS) == len(PARAMETERS)
    whole = complete({"wheels": ["a", "b"]})
    assert whole["joint_names"] == ("a", "b")
    assert whole["frame_ids"] == ("a_axle", "b_axle")
    assert unit_of(whole) == TireWheelUnit.table_1()
    for row in PARAMETERS:
        assert len(row.description) > 10
        row.check(row.default)


def unusable():
    """Each row with values that it must refuse, and what the reason must name beside name and value."""
    for row in PARAMETERS:
        if row.kind in ("double", "integer"):
            yield row.name, row.low - 1, f"{row.low:g}"
            below = math.nextafter(row.low, -math.inf) if row.kind == "double" else row.low - 1
            yield row.name, below, f"{row.low:g}"
            above = math.nextafter(row.high, math.inf) if row.kind == "double" else row.high + 1
            yield row.name, above, f"{row.high:g}"
        if row.kind == "double":
            for value in (math.nan, math.inf, -math.inf):
                yield row.name, value, "finite"
            for value in ("wide", "1.0", 1, True, None, [1.0]):
                yield row.name, value, "floating-point number"
        if row.kind == "integer":
            for value in ("many", 10.0, True, None, [10]):
                yield row.name, value, "integer"
        if row.kind == "string":
            for value in (1, 1.0, True, None, ["a"]):
                yield row.name, value, "text"
        if row.kind == "string[]":
            for value in ("left", 1, None, [1], ["a", None], {"a": 1}):
                yield row.name, value, "list of names"
        if row.kind == "double[]":
            for value in (1.0, "1.0", None, [1], ["a"], {"a": 1.0}):
                yield row.name, value, "list of floating-point numbers"
            yield row.name, [1.0, math.inf, 0.0], "finite"
            if row.name == "static_loads":  # with load_source road alone: test_road_node
                continue
            yield row.name, [1.0, 2.0], "x y z" if row.name == "tf.positions" else "three for each harmonic"
        if row.kind == "string | string[]":
            for value in (1, None, [1], ["a", None], {"a": 1}):
                yield row.name, value, "list of names"
        if row.kind == "double | double[]":
            for value in (1, "1.0", None, [1], ["a"], {"a": 1.0}):
                yield row.name, value, "list of floating-point numbers"
            yield row.name, [1.0, math.inf], "finite"
        if row.kind == "boolean":
            for value in ("true", 1, 0.0, None, []):
                yield row.name, value, "true or false"
        if row.choices:
            yield row.name, "something else", row.choices[0]
            yield row.name, "", row.choices[-1]


@pytest.mark.parametrize(("name", "value", "bound"), [*unusable()], ids=lambda part: repr(part)[:40])
def test_a_row_refuses_with_name_value_and_bound(name, value, bound):
    with pytest.raises(ValueError) as caught:
        complete({name: value})
    reason = str(caught.value)
    assert name in reason and repr(value) in reason and bound in reason
    assert "\n" not in reason


def test_every_row_is_tried():
    assert {name for name, _, _ in unusable()} == set(ROWS)


@given(st.sampled_from([row for row in PARAMETERS if row.kind == "double"]), st.floats())
def test_a_number_is_taken_as_it_is_or_refused_by_name(row, value):
    try:
        whole = complete({row.name: value})
    except ValueError as error:
        together = "radius" in str(error) or "rate_hz" in str(error) or "together" in str(error)
        assert row.name in str(error) or together
    else:
        assert whole[row.name] == value
        vehicle_settings(whole)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"wheels": []}, ["wheels", "[]"]),
        ({"wheels": ["left", "left"]}, ["wheels", "left", "twice"]),
        ({"wheels": ["left", "2nd"]}, ["wheels", "'2nd'"]),
        ({"wheels": ["front/left"]}, ["wheels", "'front/left'"]),
        ({"wheels": [""]}, ["wheels", "''"]),
        ({"wheels": ["left\n"]}, ["wheels"]),
        ({"wheels": ["gauche_é"]}, ["wheels", "é"]),
        ({"wheels": ["a" * 300]}, ["wheels"]),
        ({"wheels": ["a", "b"], "joint_names": ["one"]}, ["joint_names", "1", "2"]),
        ({"wheels": ["a", "b"], "frame_ids": ["x", "y", "z"]}, ["frame_ids", "3", "2"]),
        ({"wheels": ["a", "b"], "joint_names": ["same", "same"]}, ["joint_names", "twice"]),
        ({"wheels": ["a", "b"], "joint_names": ["one", ""]}, ["joint_names", "empty"]),
        ({"wheels": ["a"], "frame_ids": [""]}, ["frame_ids", "empty"]),
        ({"rate_hz": 10.0}, ["ring_rate_hz", "50", "rate_hz", "10"]),
        ({"ring_rate_hz": 501.0}, ["ring_rate_hz", "501", "rate_hz", "500"]),
        ({"tire.thickness": 0.305}, ["tire.thickness", "0.305", "radius"]),
        ({"tire.radius": 0.01}, ["thickness", "0.0127", "0.01"]),
        ({"tire.zeta_1": 1.0}, ["tire.zeta_1", "1.0"]),
        ({"tire.radus": 0.3}, ["'tire.radus'", "'tire.radius'"]),
        ({"radius": 0.3}, ["'radius'", "'tire.radius'"]),
        ({"ratehz": 100.0}, ["'ratehz'", "'rate_hz'"]),
        ({"completely_different": 1}, ["'completely_different'"]),
    ],
)
def test_what_contradicts_itself_is_refused(values, named):
    with pytest.raises(ValueError) as caught:
        complete(values)
    for part in named:
        assert part in str(caught.value)
    assert "\n" not in str(caught.value)


def test_two_wheels_may_share_a_frame_but_not_a_joint():
    complete({"wheels": ["a", "b"], "frame_ids": ["axle", "axle"]})


def test_settings_are_in_nanoseconds():
    settings = vehicle_settings(complete({"rate_hz": 333.0, "ring_rate_hz": 30.0, "input_timeout_s": 0.15}))
    assert (settings.period, settings.ring_period, settings.input_timeout) == (3_003_003, 33_333_333, 150_000_000)


# --- files ---


def write(tmp_path, text: str) -> Path:
    path = tmp_path / "given.yaml"
    path.write_text(text)
    return path


def test_the_configs_of_this_package():
    vehicle = complete(read_config(CONFIG / "vehicle.yaml"))
    assert vehicle["wheels"] == ("front_left", "front_right", "rear_left", "rear_right")
    assert vehicle["frame_ids"][3] == "rear_right_axle"
    # A vehicle's damper is its own; the tire is Table 1's.
    zeta_s = vehicle["tire.zeta_s"]
    assert unit_of(vehicle) == TireWheelUnit.table_1(sidewall_damping="reaction", zeta_s=zeta_s)
    table_1 = read_config(CONFIG / "table_1.yaml")
    assert set(table_1) == {f"tire.{field}" for field in TIRE_FIELDS}
    assert unit_of(complete(table_1)) == read_unit(CONFIG / "table_1.yaml") == TireWheelUnit.table_1()


def test_only_what_is_meant_for_this_node_is_read(tmp_path):
    path = write(
        tmp_path,
        """
        camera: {ros__parameters: {frame_rate: 30, exposure: [1, 2]}}
        /**: {ros__parameters: {rate_hz: 100.0, use_sim_time: true}}
        /car/tire_dynamics:
          ros__parameters:
            tire: {radius: 0.29, zeta_1: 1.0e-1}
            tire.width: 0.2
        """,
    )
    assert read_config(path) == {"rate_hz": 100.0, "tire.radius": 0.29, "tire.zeta_1": 0.1, "tire.width": 0.2}


def test_a_namespace_may_be_a_level_of_its_own(tmp_path):
    # rcl reads this as /car/tire_dynamics
    path = write(tmp_path, "car:\n  tire_dynamics:\n    ros__parameters:\n      rate_hz: 100.0\n")
    assert read_config(path) == {"rate_hz": 100.0}


def test_a_file_with_nothing_for_this_node_is_refused(tmp_path):
    # A node under another name would run with these, a replay with the defaults: that must not pass in silence.
    path = write(tmp_path, "/tyre_dynamics:\n  ros__parameters:\n    rate_hz: 100.0\n")
    with pytest.raises(InputError, match="tire_dynamics"):
        read_config(path)


def test_numbers_as_people_write_them(tmp_path):
    path = write(tmp_path, "radial_stiffness: 5.8e6\nwheel_mass: 9\nzeta_1: 1e-2\n")
    values = read_config(path)
    assert values == {"tire.radial_stiffness": 5.8e6, "tire.wheel_mass": 9.0, "tire.zeta_1": 0.01}
    assert all(type(value) is float for value in values.values())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("radus: 0.3\n", ["radus", "radius"]),
        ("radius: -1\n", ["radius", "-1", "at least 0.001"]),
        ("radius: true\n", ["radius", "True"]),
        ("radius:\n", ["radius", "None"]),
        ("radius: 0.3\nradius: 0.4\n", ["radius", "twice"]),
        ("1: 2\n", ["1"]),
        ("? [a]\n: 2\n", []),
        ("/**:\n  ros__parameters:\n    rate_hz: -5.0\n", ["rate_hz", "-5.0", "at least"]),
        ("/**:\n  ros__parameters:\n    rate_hz: 500\n", ["rate_hz", "500.0"]),  # ROS refuses it too
        ("/**:\n  ros__parameters:\n    wheels: [a, b, a]\n", ["wheels", "twice"]),
        ("/**:\n  ros__parameters:\n    wheels: a\n", ["wheels", "list"]),
        ("/**:\n  ros__parameters:\n    tire: {radus: 0.3}\n", ["tire.radus", "tire.radius"]),
        ("/**:\n  ros__parameters:\n", ["ros__parameters"]),
        ("/**:\n  ros__parameters: 5\n", ["ros__parameters"]),
        ("", ["mapping"]),
        ("- 1\n", ["mapping"]),
        ("a: [\n", ["YAML"]),
        ("a: \x00\n", ["YAML"]),
        ("a: &a [*a]\n", ["a"]),
        ("[" * 5000, []),
    ],
)
def test_a_file_that_cannot_be_used(tmp_path, text, named):
    path = write(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_config(path)
    for part in (str(path), *named):
        assert part in str(caught.value)


def test_a_file_that_cannot_be_read(tmp_path):
    for path in (tmp_path / "none.yaml", tmp_path):
        with pytest.raises(InputError, match=str(path)):
            read_config(path)
    (tmp_path / "binary").write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="binary"):
        read_config(tmp_path / "binary")
