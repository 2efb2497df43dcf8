"""What loggers and simulators export, made here in their manner: each becomes a bag, and forces, in one command."""

from __future__ import annotations

import json
import shlex

import numpy as np
import pytest
from test_csv_import import do_import, loads_of, speeds_of  # noqa: F401
from test_readme import blocks

from tire_dynamics import TireWheelUnit, write_unit
from tire_dynamics.bag import BagReader
from tire_dynamics.cdr.messages import decode_wrench
from tire_dynamics.cli.csv_import import RECORD
from tire_dynamics.cli.main import main
from tire_dynamics.files import plausibility
from tire_dynamics.files.csv_table import read_table
from tire_dynamics.files.errors import InputError

N = 100
TIME = np.arange(N) / 100.0  # [s]
SPEED = np.column_stack([60.0 + np.sin(TIME), 61.0 + np.cos(TIME)])  # [rad/s]
LOAD = np.column_stack([4000.0 + 100.0 * np.sin(9 * TIME), 3900.0 + 100.0 * np.cos(9 * TIME)])  # [N]
RADIUS, MASS, G = 0.31, 400.0, 9.80665


def table(rows, delimiter=",", quote="", comma=False):
    """Numbers with eight decimals; None is a blank cell."""

    def cell(value):
        text = "" if value is None else value if isinstance(value, str) else f"{value:.8f}"
        return f"{quote}{text.replace('.', ',') if comma else text}{quote}"

    return "".join(delimiter.join(map(cell, row)) + "\n" for row in rows)


def motec():
    """A preamble of two blocks, names, units, a blank line; everything in quotation marks."""
    head = [
        '"Format","MoTeC CSV File",,,"Workbook","Default"',
        '"Venue","Proving ground",,,"Worksheet","Wheels"',
        '"Sample Rate","100.000","Hz",,"End Time","1.000","s"',
        '"Beacon Markers","0.5 0.9"',
        "",
        "",
        '"Time","Distance","Wheel Speed FL","Wheel Speed FR","Tyre Load FL","Tyre Load FR"',
        '"s","m","km/h","km/h","kN","kN"',
        "",
    ]
    columns = np.column_stack([TIME, 18.0 * TIME, 3.6 * RADIUS * SPEED, LOAD / 1e3])
    return "\r\n".join(head) + "\r\n" + table(columns, quote='"').replace("\n", "\r\n")


def aim():
    """A preamble with a line that begins with Time, names, units, blank lines; an accelerometer in g."""
    head = [
        '"Format","AiM CSV File"',
        '"Session","Test"',
        '"Date","Monday, May 5, 2025"',
        '"Time","10:03:24 AM"',
        '"Sample Rate","100"',
        '"Segment Times","0:01.000"',
        "",
        '"Time","Speed FL","Speed FR","VerticalAcc"',
        '"sec","rpm","rpm","g"',
        "",
        "",
    ]
    columns = np.column_stack([TIME, SPEED * 30.0 / np.pi, LOAD[:, 0] / MASS / G])
    return "\n".join(head) + "\n" + table(columns, quote='"')


def racecapture():
    """Units, range and rate in the names, one clock of milliseconds, and a cell only where a channel had a sample."""
    names = ['"Interval"|"ms"|0|0|1', '"Utc"|"ms"|0|0|1', '"WheelFL"|"MPH"|0|200|50', '"WheelFR"|"MPH"|0|200|50']
    names.append('"AccelZ"|"G"|-3|3|100')
    mph = SPEED * RADIUS / 0.44704
    rows = [[f"{10 * k}", "", *(mph[k] if k % 2 == 0 else [None, None]), LOAD[k, 0] / MASS / G] for k in range(N)]
    return ",".join(names) + "\n" + table(rows)


def plotjuggler():
    """A row per message, and in it the columns of one topic; times of 2023 in seconds."""
    names = ["__time", "/joint_states/fl/velocity", "/joint_states/fr/velocity", "/fl/load/force/z", "/fr/load/force/z"]
    rows = []
    for k in range(N):
        rows.append([f"17000000{k // 100:02}.{k % 100:02}0", *SPEED[k], None, None])
        rows.append([f"17000000{k // 100:02}.{k % 100:02}1", None, None, LOAD[k, 0], None])
        rows.append([f"17000000{k // 100:02}.{k % 100:02}2", None, None, None, LOAD[k, 1]])
    return ",".join(names) + "\n" + table(rows)


def rosbag():
    """rostopic echo -p: the log's time in nanoseconds under %time, fields by their path."""
    names = ["%time", "field.header.seq", "field.velocity0", "field.velocity1", "field.load0", "field.load1"]
    rows = [[f"{1_700_000_000 * 10**9 + 10**7 * k}", f"{k}", *SPEED[k], *LOAD[k]] for k in range(N)]
    return ",".join(names) + "\n" + table(rows)


def trucksim():
    """Short names, a row of units, another that says what they are; semicolons and decimal commas, as Excel has it."""
    head = ["sep=;", "Time;AVy_L1;AVy_R1;Fz_L1;Fz_R1", "s;rpm;rpm;N;N"]
    columns = np.column_stack([TIME, SPEED * 30.0 / np.pi, LOAD])
    return "\n".join(head) + "\n" + table(columns, ";", comma=True)


EXPORTS = {
    "motec": motec,
    "aim": aim,
    "racecapture": racecapture,
    "plotjuggler": plotjuggler,
    "rosbag": rosbag,
    "trucksim": trucksim,
}


def commands():
    """Those of the page, by the name of their file."""
    page = blocks("docs/recordings.md", "Six exports, forces in one command each")
    words = [shlex.split(block.replace("\\\n", " ")) for _, block in page]
    assert all(line[:3] == ["tire-dynamics", "import", "--speed"] for line in words)
    return {line[3].removesuffix(".csv"): line[1:] for line in words}


COMMANDS = commands()


@pytest.fixture
def export(tmp_path, monkeypatch):
    """Writes one of the files, and a tire."""
    monkeypatch.chdir(tmp_path)
    write_unit(TireWheelUnit.table_1(zeta_s=0.3, sidewall_damping="reaction"), "tire.yaml")

    def write(name):
        (tmp_path / f"{name}.csv").write_bytes(EXPORTS[name]().encode())
        return COMMANDS[name]

    return write


def test_the_page_has_a_command_for_each():
    assert list(COMMANDS) == list(EXPORTS)


@pytest.mark.parametrize("name", EXPORTS)
def test_an_export_becomes_forces_in_one_command(name, export, capsys):
    words = export(name)
    assert main([*words, "--json"]) == 0
    out, err = capsys.readouterr()
    said = json.loads(out)
    assert said["doubts"] == [] and "left out" not in err and "doubtful" not in err
    reader = BagReader(said["output"])
    samples = speeds_of(reader)
    every = 2 if name == "racecapture" else 1
    got = [[sample["left"], sample["right"]] for _, sample in samples]
    np.testing.assert_allclose(got, SPEED[::every], rtol=1e-8)  # eight decimals
    start = 1_700_000_000 * 10**9 if name in ("plotjuggler", "rosbag") else 0
    assert [stamp - start for stamp, _ in samples] == (10**7 * np.arange(0, N, every)).tolist()
    one = name in ("aim", "racecapture")
    for k, wheel in enumerate(("left", "right")):
        loads = loads_of(reader, wheel)
        np.testing.assert_allclose([load for _, load in loads], LOAD[:, 0 if one else k], rtol=1e-7)
        late = (k + 1) * 10**6 if name == "plotjuggler" else 0
        assert [stamp - start - late for stamp, _ in loads] == (10**7 * np.arange(N)).tolist()
    forces = BagReader(said["forces"])
    for wheel in ("left", "right"):
        wrenches = [decode_wrench(data) for *_, data in forces.messages([f"/{wheel}/axle_wrench"])]
        assert wrenches[-1].fz == pytest.approx(4000.0, rel=0.1)  # the load, whole, but for the wheel's own motion


def test_what_was_recognised_is_said(export, capsys):
    for name, parts in {
        "motec": ["names are in line 7", "the speed is in km/h, as its header says", "the load is in kN, as its"],
        "racecapture": [
            "times are in ms, as its header says",
            "the speed is in mph",
            "50 rows have none of these columns",
        ],
        "plotjuggler": ["200 rows have none of these columns, and are passed over", "cells without a value"],
        "rosbag": ["times are taken for ns since 1970, 1700000000000000000 being the first"],
        "trucksim": ["names are in line 2", "the speed is in rpm"],
    }.items():
        words = export(name)
        assert main(words[: words.index("--forces")]) == 0
        said = capsys.readouterr().err
        assert all(part in said for part in parts), (name, said)


# -- headers, clocks and numbers ----------------------------------------------------------------------------------


def rows_of(tmp_path, text, *columns, time=None, unit=None):
    path = tmp_path / "a.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_table(path, columns, time, unit)


@pytest.mark.parametrize(
    "text",
    [
        "# made by a logger\n# t,v: two columns\nt,v\n0,1.5\n1,2.5\n",
        "# t,v\n0,1.5\n1,2.5\n",  # as numpy.savetxt writes it
        "t,v\n# a comment\n0,1.5\n# another\n1,2.5\n",
        '"t";"v";"a, with a comma, or two, or three"\n0;1.5;x\n1;2.5;x\n',
        't,v,"a; b; c"\n0,1.5,x\n1,2.5,x\n',
        "sep=;\nt;v\n0;1,5\n1;2,5\n",
        'sep=,\nt,v\n0,"1,5"\n1,"2,5"\n',
        "t\tv\n0\t1,5\n1\t2,5\n",
        "t;v\n0;1.000,5\n1;2.000,5\n".replace("1.000", "0.001").replace("2.000", "0.002"),
        "t [s],v [rad/s]\n0,1.5\n1,2.5\n",
        "t,v\nseconds,radians\n0,1.5\n1,2.5\n",
        "t,v\ns,rad/s\n,\n0,1.5\n1,2.5\n",
        "t,v,w\n0,1.5,\n0.5,,7\n1,2.5,\n",
        ("\ufefft,v\n0,1.5\n1,2.5\n").encode("utf-16"),
        "t,v\n0 sec,1.5\n1 sec,2.5\n",
        "t,v,t2\n0,1.5,3\n1,2.5,4\n\n\n",
    ],
)
def test_dialects(tmp_path, text):
    table = rows_of(tmp_path, text, "v")
    assert table.times.tolist() == [0, 10**9] and table.values.tolist() == [[1.5], [2.5]]
    assert table.unusable == 0


def test_commas_that_part_thousands(tmp_path):
    assert rows_of(tmp_path, 't,v\n0,"1,234.5"\n0.5,"2,000"\n', "v").values.tolist() == [[1234.5], [2000.0]]
    assert rows_of(tmp_path, "t;v\n0;1.234,5\n", "v").values.tolist() == [[1234.5]]


@pytest.mark.parametrize(
    ("cells", "first", "said"),
    [
        (("2022-02-23T06:34:27.403Z", "2022-02-23T06:34:27.503Z"), 1645598067403, "times are dates"),
        (("2022-02-23 06:34:27.403", "2022-02-23 06:34:27.503"), 1645598067403, "dates without a zone, taken for UTC"),
        (("2022-02-23T07:34:27.403+01:00", "2022-02-23T07:34:27.503+0100"), 1645598067403, "times are dates"),
        (("23-Feb-2022 06:34:27.403", "23-Feb-2022 06:34:27.503"), 1645598067403, "dates without a zone"),
        (("2022/02/23 06:34:27.403 AM", "2022/02/23 06:34:27.503 AM"), 1645598067403, "dates without a zone"),
        (("06:34:27.403", "06:34:27.503"), 23667403, "times are of the day, hh:mm:ss"),
        (("34:27.403".join(("0:", "")), "0:34:27.503"), 2067403, "times are of the day"),
        (("1645598067403", "1645598067503"), 1645598067403, "taken for ms since 1970"),
        (("1645598067403000", "1645598067503000"), 1645598067403, "taken for us since 1970"),
        (("1645598067403000000", "1645598067503000000"), 1645598067403, "taken for ns since 1970"),
        (("1645598067.403", "1645598067.503"), 1645598067403, None),
    ],
)
def test_clocks(tmp_path, cells, first, said):
    """Known instants: 2022-02-23 06:34:27 UTC is 1645598067 s after 1970."""
    table = rows_of(tmp_path, "t,v\n" + "".join(f"{cell},1\n" for cell in cells), "v")
    assert table.times.tolist() == [first * 10**6, (first + 100) * 10**6]
    assert (said is None and table.notes == []) or any(said in note for note in table.notes)


def test_past_midnight_the_day_goes_on(tmp_path):
    table = rows_of(tmp_path, "t,v\n23:59:59.9,1\n00:00:00.1,2\n", "v")
    assert np.diff(table.times).tolist() == [2 * 10**8] and table.unsorted == 0


@pytest.mark.parametrize(
    "cell", ["2022-02-30 00:00:00", "2022-13-01 00:00:00", "25:00:00", "12:61:00", "23-Foo-2022 1:00:00"]
)
def test_no_such_time(tmp_path, cell):
    with pytest.raises(InputError, match="no usable row"):
        rows_of(tmp_path, f"t,v\n{cell},1\n", "v")
    good = "2022-02-23 00:00:00" if "-" in cell else "00:00:01"
    assert rows_of(tmp_path, f"t,v\n{good},1\n{cell},1\n", "v").unusable == 1


def test_which_column_is_the_time(tmp_path):
    table = rows_of(tmp_path, "index,Time,v\n0,5,1\n1,6,2\n", "v")
    assert table.times.tolist() == [5 * 10**9, 6 * 10**9] and "times are column 'Time'" in table.notes[0]
    assert rows_of(tmp_path, "index,Time,v\n0,5,1\n", "v", time="index").times.tolist() == [0]
    assert "is it a distance?" in rows_of(tmp_path, "Distance [m],v\n0,1\n", "v").doubts[0]
    assert rows_of(tmp_path, "t [ms],v\n1500,1\n", "v").times.tolist() == [1_500_000_000]
    other = rows_of(tmp_path, "t [ms],v\n1500,1\n", "v", unit="s")
    assert other.times.tolist() == [1500 * 10**9] and "the header says that times are in ms" in other.doubts[0]


def test_a_name_that_is_not_there_is_looked_for_behind_the_preamble(tmp_path):
    with pytest.raises(InputError) as error:
        rows_of(tmp_path, motec(), "Wheel Sped FL")
    words = str(error.value)
    assert (
        "column 'Wheel Sped FL' is not there (did you mean 'Wheel Speed FL'?); the columns are ['Time', 'Dist" in words
    )


def test_time_columns_of_each_file(do_import):  # noqa: F811
    reader = do_import("a,left,right,t1\n9,1,2,5\n", "t2,a,b\n5,3,4\n", "--speed-time-column t1 --load-time-column t2")
    assert [stamp for stamp, _ in speeds_of(reader)] == [5 * 10**9] == [stamp for stamp, _ in loads_of(reader, "left")]


def test_a_blank_cell_is_no_sample(do_import, capsys):  # noqa: F811
    reader = do_import("t,left,right\n1,10,\n1.5,,21\n2,nan,22\n2.5,13,23\n")
    assert speeds_of(reader) == [
        (1_000_000_000, {"left": 10.0}),
        (1_500_000_000, {"right": 21.0}),
        (2_000_000_000, {"right": 22.0}),
        (2_500_000_000, {"left": 13.0, "right": 23.0}),
    ]
    assert (
        "cells without a value, beside which the rest of their rows is used: left 2, right 1" in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("unit", "factor", "more"),
    [
        ("rev/s", 2.0 * np.pi, ""),
        ("deg/s", np.pi / 180.0, ""),
        ("km/h", 1.0 / 3.6 / 0.3, "--rolling-radius 0.3"),
        ("mph", 0.44704 / 0.3, "--rolling-radius 0.3"),
    ],
)
def test_units_of_speeds(do_import, unit, factor, more):  # noqa: F811
    got = [sample["left"] for _, sample in speeds_of(do_import(options=f"--speed-unit {unit} {more}"))]
    np.testing.assert_allclose(got, np.array([10.0, 11.0, 12.0]) * factor, rtol=1e-15)


@pytest.mark.parametrize(("unit", "factor"), [("kN", 1e3), ("daN", 10.0), ("lbf", 4.4482216152605), ("kgf", 9.80665)])
def test_units_of_loads(do_import, unit, factor):  # noqa: F811
    got = [load for _, load in loads_of(do_import(options=f"--load-unit {unit}"), "left")]
    np.testing.assert_allclose(got, np.array([3000.0, 3100.0]) * factor, rtol=1e-15)


# -- what is hardly meant so --------------------------------------------------------------------------------------


PLAIN = "t,left,right,a,b"
ESTIMATE = "--corner-mass 400 --load-unit"


@pytest.mark.parametrize(
    ("names", "speed", "load", "time", "options", "words"),
    [
        (PLAIN, SPEED, -LOAD, TIME, "", "the mean load of left, right is -4"),
        (PLAIN, SPEED, LOAD / 1e3, TIME, "", "N: is it in kN?"),
        (PLAIN, SPEED, LOAD * 1e3, TIME, "", "in which unit is it?"),
        (PLAIN, SPEED, LOAD / MASS / G, TIME, f"{ESTIMATE} m/s^2", "m/s^2 in the mean: is it in g?"),
        (PLAIN, SPEED, LOAD / MASS, TIME, f"{ESTIMATE} g", "g in the mean: is it in m/s^2?"),
        (PLAIN, SPEED, LOAD / MASS - G, TIME, f"{ESTIMATE} m/s^2", "gravity is not in it"),
        (PLAIN, SPEED, LOAD * 3 / MASS, TIME, f"{ESTIMATE} m/s^2", "where the mass weighs 3923 N"),
        (PLAIN, SPEED, LOAD / G, TIME, "--corner-mass 400", "where the mass weighs 3923 N: is the acceleration in g?"),
        ("t,left [rpm],right [rpm],a,b", SPEED, LOAD, TIME, "--speed-unit rad/s", "the header says rpm, and --speed-"),
        ("t,left,right,a [kN],b [kN]", SPEED, LOAD, TIME, "--load-unit N", "the header says kN, and --load-unit N"),
        ("t,left,right,a [V],b [V]", SPEED, LOAD, TIME, "", "the header's unit 'V' of a, b is none of a load"),
        ("t,left_kmh,right_kmh,a,b", SPEED, LOAD, TIME, "--speed-columns left=left_kmh right=right_kmh",
         "by their names 'left_kmh', 'right_kmh' have another unit than rad/s"),
        (PLAIN, SPEED, LOAD, np.arange(N) + 0.0, "", "speeds are 0, 1, ... s: do they count rows?"),
        ("dist,left,right,a,b", SPEED, LOAD, TIME, "", "column 'dist' is taken for the time: is it a distance?"),
        (PLAIN, SPEED, LOAD, np.repeat(TIME[::2], 2), "", "50 of 100 speeds have the time of the one before"),
        (PLAIN, SPEED * [1.0, 3.6], LOAD, TIME, "", "right turns 3.6"),
        (PLAIN, SPEED * [1.0, -1.0], LOAD, TIME, "", "right turns the other way than the rest"),
        (PLAIN, SPEED * [1.0, 0.0], LOAD, TIME, "", "the speed of right is 0 all the time"),
        (PLAIN, SPEED * 30 / np.pi, LOAD, TIME, "", "is it in rpm or deg/s?"),
    ],
)  # fmt: skip
def test_doubts(do_import, capsys, names, speed, load, time, options, words):  # noqa: F811
    """Said on standard error, kept in the bag, and imported all the same."""
    text = names + "\n" + table(np.column_stack([time, speed, load]))
    reader = do_import(text, text, options)
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("doubtful: ")]
    assert 1 <= len(said) <= 2 and words in said[0], said  # of speeds, and the same of loads
    assert words in reader.metadata[RECORD]["doubts"]


@pytest.mark.parametrize(
    "names", [PLAIN, "t,left (FL),right (FR),a (-),b [raw]", "t [s],left [rad/s],right [rad/s],a [N],b [N]"]
)
def test_nothing_is_said_of_a_sound_drive(do_import, capsys, names):  # noqa: F811
    text = names + "\n" + table(np.column_stack([TIME, SPEED, LOAD]))
    reader = do_import(text, text)
    assert "doubtful" not in capsys.readouterr().err and "doubts" not in reader.metadata[RECORD]


def test_sums_of_pieces_are_those_of_the_whole():
    """As a replay would look at samples: one by one, or all at once."""
    stamps = (TIME * 1e9).astype(np.int64)
    stamps[50] = stamps[49]
    whole = {"left": (stamps, SPEED[:, 0]), "right": (stamps, -7.0 * SPEED[:, 1])}, {"left": (stamps, LOAD[:, 0] / 1e3)}
    seen = plausibility.Plausibility()
    for k in range(N):
        seen.speeds("left", stamps[k], SPEED[k, 0])
        seen.loads("left", stamps[k], LOAD[k, 0] / 1e3)
    for part in (slice(0, 30), slice(30, None)):
        seen.speeds("right", stamps[part], -7.0 * SPEED[part, 1])
    assert seen.doubts() == plausibility.doubts(*whole)
    assert len(seen.doubts()) == 5  # kN, 7 times as fast, the other way, repeated times of speeds and of loads
