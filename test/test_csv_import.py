"""CSV recordings into input bags: units, time, files that are not as they should be, and a real drive."""

from __future__ import annotations

import argparse
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tire_dynamics.bag import BagReader
from tire_dynamics.cdr.messages import JOINT_STATE, WRENCH_STAMPED, JointStateDecoder, decode_wrench
from tire_dynamics.cli import answer, csv_import
from tire_dynamics.files.csv_table import read_table
from tire_dynamics.files.errors import InputError

SPEED = "t,left,right\n1.0,10,20\n1.5,11,21\n2.0,12,22\n"
LOAD = "t,a,b\n1.25,3000,-9.5\n1.5,3100,-9.25\n"


@pytest.fixture
def do_import(tmp_path, monkeypatch):
    """Writes the two files, imports them with the given options in place of the usual ones, reads the bag."""
    monkeypatch.chdir(tmp_path)

    def do(speed: str | bytes = SPEED, load: str | bytes = LOAD, options: str = ""):
        for name, content in (("speed.csv", speed), ("load.csv", load)):
            (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        parser = argparse.ArgumentParser(exit_on_error=False)
        csv_import.add_arguments(parser)
        answer.add_arguments(parser)
        usual = {
            "--speed": "speed.csv",
            "--speed-columns": "left=left right=right",
            "--load": "load.csv",
            "--load-columns": "left=a right=b",
            "--output": "out",
        }
        kept = [f"{name} {value}" for name, value in usual.items() if name not in options.split()]
        assert csv_import.run(parser.parse_args(" ".join([*kept, options]).split())) == 0
        return BagReader(tmp_path / "out")

    return do


def speeds_of(reader: BagReader) -> list[tuple[int, dict[str, float]]]:
    """Stamp and velocity by joint of every JointState, all times of a message being the same."""
    samples = []
    for _, msgtype, log_time, publish_time, data in reader.messages(["/joint_states"]):
        state = JointStateDecoder().decode(data)
        assert msgtype == JOINT_STATE and log_time == publish_time == state.stamp_ns
        samples.append((state.stamp_ns, dict(zip(state.names, state.velocities, strict=True))))
    return samples


def loads_of(reader: BagReader, wheel: str) -> list[tuple[int, float]]:
    """Stamp and force.z of every load of a wheel."""
    samples = []
    for _, msgtype, log_time, publish_time, data in reader.messages([f"/{wheel}/load"]):
        wrench = decode_wrench(data)
        assert msgtype == WRENCH_STAMPED and log_time == publish_time == wrench.stamp_ns
        assert wrench.frame_id == f"{wheel}_axle" and wrench.fx == wrench.fy == 0.0
        samples.append((wrench.stamp_ns, wrench.fz))
    return samples


def test_rows_become_messages_at_their_times(do_import, capsys):
    reader = do_import()
    assert set(reader.topics) == {"/joint_states", "/left/load", "/right/load"}
    assert speeds_of(reader) == [
        (1_000_000_000, {"left": 10.0, "right": 20.0}),
        (1_500_000_000, {"left": 11.0, "right": 21.0}),
        (2_000_000_000, {"left": 12.0, "right": 22.0}),
    ]
    assert loads_of(reader, "left") == [(1_250_000_000, 3000.0), (1_500_000_000, 3100.0)]
    assert loads_of(reader, "right") == [(1_250_000_000, -9.5), (1_500_000_000, -9.25)]
    times = [message[2] for message in reader.messages()]
    assert times == sorted(times)
    assert [message[0] for message in reader.messages()][-4] == "/joint_states"  # at 1.5 s, before the loads
    said = capsys.readouterr()
    assert said.out == "" and "2 wheels, 3 speeds" in said.err and "left out" not in said.err


@pytest.mark.parametrize(
    ("options", "factor"),
    [
        ("--speed-unit rad/s", 1.0),
        ("--speed-unit rpm", 2 * math.pi / 60),
        ("--speed-unit m/s --rolling-radius 0.3", 1 / 0.3),
    ],
)
def test_speed_units(do_import, options, factor):
    got = [sample["left"] for _, sample in speeds_of(do_import(options=options))]
    # Two roundings, one in the factor and one in the product.
    np.testing.assert_allclose(got, np.array([10.0, 11.0, 12.0]) * factor, rtol=4e-16)


def test_loads_estimated_from_one_accelerometer(do_import, capsys):
    reader = do_import(options="--load-columns b --load-unit m/s^2 --corner-mass 400")
    for wheel in ("left", "right"):
        assert [load for _, load in loads_of(reader, wheel)] == [3800.0, 3700.0]  # 400 kg * |-9.5 m/s^2|
    note = reader.metadata[csv_import.RECORD]["load"]
    assert "estimate" in note and "400 kg * |acceleration [m/s^2]|" in note and "load.csv: b" in note
    assert note in capsys.readouterr().err


def test_loads_given_in_newton_are_not_called_an_estimate(do_import):
    assert "estimate" not in do_import().metadata[csv_import.RECORD]["load"]


@pytest.mark.parametrize(
    "convert",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: "\ufeff" + text,
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", "\t"),
        lambda text: text.replace(",", " , "),
        lambda text: text.replace(",", ";").replace(".", ","),
        lambda text: text.replace("\n", "\n\n"),
        lambda text: text.rstrip("\n"),
        lambda text: text.replace("left", '"left"').replace(",10,", ',"10",'),
        lambda text: text.replace("t,", "Zeit °,", 1).encode("latin-1"),
    ],
    ids=[
        "CRLF",
        "BOM",
        "semicolon",
        "tab",
        "spaces",
        "decimal comma",
        "blank lines",
        "no end",
        "quotes",
        "latin",
    ],
)
def test_dialects_give_the_same_bag(do_import, convert, capsys):
    expected = list(do_import().messages())
    reader = do_import(convert(SPEED), convert(LOAD), "--force")
    assert list(reader.messages()) == expected
    assert "left out" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("unit", "text", "expected"),
    [
        ("s", "1700000000.123456789", 1_700_000_000_123_456_789),  # a float would be off by up to 119 ns
        ("ms", "1700000000123.456789", 1_700_000_000_123_456_789),
        ("us", "1.700000000123456789e15", 1_700_000_000_123_456_789),
        ("ns", "1700000000123456789", 1_700_000_000_123_456_789),
    ],
)
def test_times_are_exact_to_the_nanosecond(do_import, unit, text, expected):
    reader = do_import(f"t,left,right\n{text},1,2\n", f"t,a,b\n{text},3,4\n", f"--time-unit {unit}")
    assert [stamp for stamp, _ in speeds_of(reader)] == [expected]


def test_start_time_moves_both_files_together(do_import):
    reader = do_import(options="--start-time 1700000000.5")
    start = 1_700_000_000_500_000_000
    assert [stamp - start for stamp, _ in speeds_of(reader)] == [0, 500_000_000, 1_000_000_000]
    assert [stamp - start for stamp, _ in loads_of(reader, "left")] == [250_000_000, 500_000_000]


def test_the_time_column_can_be_any(do_import):
    reader = do_import("left,right,t\n1,2,5\n", "a,t,b\n3,5,4\n", "--time-column t")
    assert speeds_of(reader) == [(5 * 10**9, {"left": 1.0, "right": 2.0})]
    assert loads_of(reader, "right") == [(5 * 10**9, 4.0)]


def test_rows_out_of_order_are_sorted_and_counted(do_import, capsys):
    reader = do_import("t,left,right\n2,1,1\n1,2,2\n1,3,3\n3,4,4\n")
    assert [(t // 10**9, sample["left"]) for t, sample in speeds_of(reader)] == [
        (1, 2),
        (1, 3),
        (2, 1),
        (3, 4),
    ]
    assert "speed.csv: 1 rows out of order, sorted by time" in capsys.readouterr().err


def test_rows_of_equal_time_keep_their_order(do_import):
    rows = "".join(f"{2 - i % 2},{i},0\n" for i in range(100))  # enough for a sort to mix them up
    got = [sample["left"] for _, sample in speeds_of(do_import("t,left,right\n" + rows))]
    assert got == [*range(1, 100, 2), *range(0, 100, 2)]


@pytest.mark.parametrize(
    ("row", "why"),
    [
        ("1.2,x,5", "'left' is 'x'"),
        ("1.2,nan,NaN", "'left' is 'nan'"),
        ("1.2,5,inf", "'right' is 'inf'"),
        ("1.2,5,1e999", "'right' is '1e999'"),
        ("1.2,5", "it has 2 columns of 3"),
        ("later,5,5", "'t' is 'later'"),
        ("nan,5,5", "'t' is 'nan'"),
        ("9e99,5,5", "beyond the range of ROS time"),
        ("1e999999999999,5,5", "'t' is '1e999999999999'|beyond the range of ROS time"),
    ],
)
def test_rows_that_cannot_be_used_are_left_out_and_counted(do_import, capsys, row, why):
    expected = list(do_import().messages())
    lines = SPEED.splitlines()
    text = "\n".join([*lines[:2], row, lines[2], row, *lines[3:]])
    assert list(do_import(text, options="--force").messages()) == expected
    said = capsys.readouterr().err
    assert "speed.csv: 2 rows left out; the first is line 3: " in said
    assert any(part in said for part in why.split("|"))


@pytest.mark.parametrize(
    ("speed", "load", "options", "why"),
    [
        (b"", LOAD, "", "speed.csv: is empty"),
        (SPEED, b"", "", "load.csv: is empty"),
        (b"\x89MCAP\x00\r\n\x00\x00", LOAD, "", "is not a text file"),
        (b"a," * 2**20, LOAD, "", "is not a text file"),
        ('t,left,right\n1,"' + "x" * 200_000 + '",1\n', LOAD, "", "speed.csv: is not CSV"),
        (SPEED.split("\n", 1)[1], LOAD, "", "no line has the columns' names; it begins with '1.0,10,20'"),
        ("t,left,right\n", LOAD, "", "speed.csv: has no usable row"),
        ("t,left,right\n1,a,b\n", LOAD, "", "no usable row; the first is line 2: 'left' is 'a'"),
        (
            SPEED,
            LOAD,
            "--speed-columns left=front --load-columns a",
            "'front' is not there; the columns are ['t', 'left",
        ),
        (
            "t,left,left\n1,1,1\n",
            LOAD,
            "--speed-columns left=left --load-columns a",
            "'left' stands twice",
        ),
        (SPEED, LOAD, "--time-column stamp", "'stamp' is not there"),
        (SPEED, LOAD, "--speed gone.csv", "gone.csv: does not exist"),
        (SPEED, LOAD, "--load .", "cannot be read"),
        (SPEED, LOAD, "--speed-columns left", "'left' is not WHEEL=COLUMN"),
        (SPEED, LOAD, "--speed-columns 1left=left", "'1left=left' is not WHEEL=COLUMN"),
        (SPEED, LOAD, "--speed-columns left=left left=right", "left stands there twice"),
        (SPEED, LOAD, "--load-columns a b", "'a' is not WHEEL=COLUMN"),
        (SPEED, LOAD, "--load-columns left=a", "has left, but --speed-columns has left, right"),
        (SPEED, LOAD, "--load-columns left=a left=b", "left stands there twice"),
        (SPEED, LOAD, "--speed-unit m/s", "--speed-unit m/s needs --rolling-radius"),
        (
            SPEED,
            LOAD,
            "--rolling-radius 0.3",
            "--rolling-radius goes with --speed-unit m/s or km/h or mph; the speed is in rad/s",
        ),
        (SPEED, LOAD, "--speed-unit m/s --rolling-radius 0", "--rolling-radius is 0; it must be > 0"),
        (SPEED, LOAD, "--speed-unit m/s --rolling-radius nan", "--rolling-radius is nan; it must be > 0"),
        (SPEED, LOAD, "--load-unit m/s^2", "--load-unit m/s^2 needs --corner-mass"),
        (SPEED, LOAD, "--speed-unit mph", "--speed-unit mph needs --rolling-radius"),
        (SPEED, LOAD, "--load-unit g", "--load-unit g needs --corner-mass"),
        (SPEED.replace("left,", "lefft,"), LOAD, "", "'left' is not there (did you mean 'lefft'?); the columns are"),
        ("t,left [km/h],right [rpm]\n1,2,3\n", LOAD, "", "different units (km/h: left; rpm: right); convert one"),
        ("t,left [km/h],right [km/h]\n1,2,3\n", LOAD, "", "--speed-unit km/h needs --rolling-radius"),
        ("t,left,right\n1,,\n2,,\n", LOAD, "", "has no usable row; all of these columns are blank"),
        (SPEED, LOAD, "--config tire.yaml", "--config belongs to --forces, which is not given"),
        (SPEED, LOAD, "--forces out", "--forces is out, which is also the output of the import"),
        (SPEED, LOAD, "--forces forces --config gone.yaml", "gone.yaml"),
        (SPEED, LOAD, "--start-time soon", "--start-time is 'soon'"),
        (SPEED, LOAD, "--start-time nan", "--start-time is 'nan'"),
        (SPEED, LOAD, "--start-time 1e999999999", "--start-time is '1e999999999'"),
        (SPEED.replace("\n1.0", "\n-1.0"), LOAD, "", "ROS has 0 s to 2147483648 s"),
        (SPEED.replace("\n1.0", "\n-1.0"), LOAD, "--start-time 2147483647", "ROS has 0 s to"),
        (SPEED, "t,a,b\n3.5,1,1\n", "", "no time in common"),
    ],
    ids=lambda value: value if isinstance(value, str) and "\n" not in value else "",
)
def test_what_cannot_be_used_is_one_clear_line(do_import, tmp_path, speed, load, options, why):
    with pytest.raises(InputError) as error:
        do_import(speed, load, options)
    assert why in str(error.value) and "\n" not in str(error.value) and len(str(error.value)) < 400
    assert not (tmp_path / "out").exists()


def test_an_output_that_exists_is_kept_unless_forced(do_import):
    do_import()
    with pytest.raises(InputError, match="exists already"):
        do_import("t,left,right\n1.5,1,1\n")
    assert len(speeds_of(do_import("t,left,right\n1.5,1,1\n", options="--force"))) == 1


@given(st.binary(max_size=300), st.binary(max_size=60))
def test_any_bytes_are_imported_or_refused(tmp_path_factory, body, head):
    path = tmp_path_factory.getbasetemp() / "any.csv"
    for content in (body, b"t,a\n" + body, head + b"\n" + body):
        path.write_bytes(content)
        try:
            table = read_table(path, ["a"], None, None)
        except InputError as error:
            assert "any.csv" in str(error) and "\n" not in str(error)
        else:
            assert np.isfinite(table.values).all() and (np.diff(table.times) >= 0).all()


def test_a_real_drive_in_one_command(do_import, drive):
    """Four wheel speeds in m/s and one accelerometer, from a car's CAN bus and its windscreen."""
    columns = " ".join(f"{w}={w}_m_s" for w in ("front_left", "front_right", "rear_left", "rear_right"))
    reader = do_import(
        options=f"--speed {drive}/wheel_speed.csv --speed-columns {columns} --speed-unit m/s "
        f"--rolling-radius 0.31 --load {drive}/accelerometer.csv --load-columns down_m_s2 "
        "--load-unit m/s^2 --corner-mass 380"
    )
    speed = np.loadtxt(drive / "wheel_speed.csv", delimiter=",", skiprows=1)
    acceleration = np.loadtxt(drive / "accelerometer.csv", delimiter=",", skiprows=1)
    samples = speeds_of(reader)
    assert [stamp for stamp, _ in samples] == np.round(speed[:, 0] * 1e9).astype(int).tolist()
    # One rounding apart: the file's text is read as the same floats.
    np.testing.assert_allclose([list(s.values()) for _, s in samples], speed[:, 1:] / 0.31, rtol=4e-16)
    for wheel in ("front_left", "rear_right"):
        loads = loads_of(reader, wheel)
        np.testing.assert_allclose([f for _, f in loads], 380 * np.abs(acceleration[:, 3]), rtol=4e-16)
    assert reader.message_count == len(speed) + 4 * len(acceleration)
