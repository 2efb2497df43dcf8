"""``tire-dynamics import --inputs``: CSV files by a field map, against the options that do the same."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tire_dynamics.bag import BagReader
from tire_dynamics.cli.info import info
from tire_dynamics.cli.main import main
from tire_dynamics.replay.bag_setup import bag_setup, pipeline_of

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
CAR = Path(__file__).parents[1] / "config" / "car.yaml"
HEAD = "/**:\n  ros__parameters:\n    inputs:\n"


@pytest.fixture
def folder(tmp_path):
    time = 0.01 * np.arange(200)
    speed = np.column_stack([time, *(30.0 + k + np.sin(time + k) for k in range(4))])
    load = np.column_stack([time, *(4000.0 + 10.0 * k + 50.0 * np.cos(7.0 * time) for k in range(4))])
    still = np.column_stack([1e3 * time, *(np.full(200, value) for value in (0.1, -0.2, 1.0, 5.0, 6.0, 7.0))])
    travel = np.column_stack([time, *(np.full(200, 100.0 + k) for k in range(4))])
    for name, columns, header in (
        ("speed", speed, "time_s,fl,fr,rl,rr"), ("load", load, "time_s,fl_n,fr_n,rl_n,rr_n"),
        ("imu", still, "t,ax,ay,az,gx,gy,gz"), ("travel", travel, "time_s," + ",".join(WHEELS)),
    ):  # fmt: skip
        np.savetxt(tmp_path / f"{name}.csv", columns, "%.17g", ",", header=header, comments="")
    return tmp_path


def written(folder, text):
    (folder / "map.yaml").write_text(HEAD + text, encoding="utf-8")
    return ["import", "--inputs", str(folder / "map.yaml"), "-o", str(folder / "bag")]


def test_speeds_and_loads_by_a_map_make_the_forces_that_the_options_make(folder):
    text = (
        "      speed: {topic: speed.csv, field: [fl, fr, rl, rr]}\n"
        "      load: {topic: load.csv, field: [fl_n, fr_n, rl_n, rr_n]}\n"
    )
    assert main([*written(folder, text), "--forces", str(folder / "by_map")]) == 0
    speeds = [f"{wheel}={column}" for wheel, column in zip(WHEELS, ("fl", "fr", "rl", "rr"), strict=True)]
    loads = [f"{wheel}={column}_n" for wheel, column in zip(WHEELS, ("fl", "fr", "rl", "rr"), strict=True)]
    options = ["--speed", str(folder / "speed.csv"), "--speed-columns", *speeds]
    options += ["--load", str(folder / "load.csv"), "--load-columns", *loads, "-o", str(folder / "other")]
    assert main(["import", *options, "--forces", str(folder / "by_options")]) == 0
    for wheel in WHEELS:
        one, two = (
            [message[3:] for message in BagReader(folder / name).messages([f"/{wheel}/axle_wrench"])]
            for name in ("by_map", "by_options")
        )
        assert one == two and len(one) > 900


def test_info_says_what_a_bag_without_loads_has_for_an_estimate(folder, capsys):
    text = (
        "      speed: {topic: speed.csv, field: [fl, fr, rl, rr]}\n"
        "      imu: {topic: imu.csv, field: [ax, ay, az, gx, gy, gz], unit: g deg/s, stamp: t ms}\n"
    )
    assert main(written(folder, text)) == 0
    why_not = info(folder / "bag")["replay"]["why_not"]
    assert "; if it has none: replay --vehicle config/car.yaml has them estimated" in why_not
    found = info(folder / "bag", vehicle=CAR)["replay"]
    assert found["possible"] and found["without"] == {}
    speed, imu = found["mapped"]
    assert (speed["quantity"], imu["quantity"], imu["unit"]) == ("speed", "imu", "m/s^2 rad/s")
    assert imu["values"]["force_z"]["low"] == imu["values"]["force_z"]["high"] == pytest.approx(9.80665)
    assert {name: of["count"] for name, of in speed["values"].items()} == dict.fromkeys(WHEELS, 200)
    capsys.readouterr()
    assert main(["info", str(folder / "bag"), "--vehicle", str(CAR)]) == 0
    assert "speed [rad/s] of /speed: front_left 30 to 31, " in capsys.readouterr().out


def test_every_quantity_in_its_unit(folder, capsys):
    text = (
        "      speed: {topic: speed.csv, field: [fr, fl, rl, rr],\n"
        "              order: [front_right, front_left, rear_left, rear_right]}\n"
        "      imu: {topic: imu.csv, field: [ax, ay, az, gx, gy, gz], unit: g deg/s, stamp: t ms}\n"
        "      travel: {topic: travel.csv, field: '{wheel}', unit: mm, zero: 100.0, sign: -1.0}\n"
        "      load: {topic: load.csv, field: [fl_n, fr_n, rl_n, rr_n]}\n"
    )
    assert main([*written(folder, text), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"] == {"/speed": 200, "/imu": 200, "/travel": 200, "/load": 200}
    reader = BagReader(folder / "bag")
    how = bag_setup(reader)
    pipeline, got = pipeline_of(reader, how), {}
    pipeline.set_sink(lambda name, wheel, stamp, received, values: got.setdefault(name, []).append((stamp, values)))
    for topic, _, received, _, data in reader.messages():
        pipeline.receive(topic, received, data)
    assert {name: len(samples) for name, samples in got.items()} == {"speed": 200, "imu": 200, "travel": 200}
    assert [stamp for stamp, _ in got["imu"]] == [10_000_000 * k for k in range(200)]
    g, degree = 9.80665, np.pi / 180.0
    expected = 0.1 * g, -0.2 * g, g, 5.0 * degree, 6.0 * degree, 7.0 * degree
    assert got["imu"][7][1] == pytest.approx(expected, rel=1e-14)
    assert got["travel"][7][1] == pytest.approx((0.0, -1e-3, -2e-3, -3e-3), abs=1e-15)
    first = [30.0 + k + np.sin(k) for k in range(4)]
    assert got["speed"][0][1] == pytest.approx(first, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("      speed: {topic: speed.csv, field: [fl, fr, rl, nothing]}\n", "speed.csv"),
        ("      speed: {topic: absent.csv, field: [fl, fr, rl, rr]}\n", "absent.csv"),
        ("      speed: {topic: speed.csv, field: [fl, fr]}\n", "gives 2 numbers; 4 are wanted"),
        ("      speed: {topic: '{wheel}.csv', field: a}\n", "must be one CSV file"),
        ("      speed: {topic: speed.csv}\n", "inputs.speed.field is empty"),
        ("      speed: {topic: speed.csv, field: [fl, fr, rl, rr], unit: km/h}\n", "inputs.speed.radius"),
        ("      angle: {topic: speed.csv, field: [fl, fr, rl, rr]}\n", "inputs.speed.topic is not"),
        ("      speed: {topik: speed.csv}\n", "did you mean 'inputs.speed.topic'"),
        ("      speed: {unit: rpm}\n", "maps nothing"),
    ],
)
def test_a_map_that_cannot_be_used_is_refused_and_nothing_is_written(folder, capsys, text, said):
    assert main(written(folder, text)) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not (folder / "bag").exists()


def test_the_map_takes_the_place_of_the_options(folder, capsys):
    text = "      speed: {topic: speed.csv, field: [fl, fr, rl, rr]}\n"
    assert main([*written(folder, text), "--speed", str(folder / "speed.csv")]) == 2
    assert "the map names files and columns" in capsys.readouterr().err
    assert main(["import", "-o", str(folder / "bag")]) == 2
    assert "needs --speed, --speed-columns, --load, --load-columns, or --inputs" in capsys.readouterr().err
