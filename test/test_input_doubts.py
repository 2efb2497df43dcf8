"""Doubtful speeds and loads: named by a replay and in a report, and replayed all the same."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.cdr import messages
from tire_dynamics.cdr.messages import JointStateEncoder, WrenchEncoder, encode_float64
from tire_dynamics.cli.main import main
from tire_dynamics.files.plausibility import GRAVITY, RECORD
from tire_dynamics.replay.bag_setup import bag_setup
from tire_dynamics.replay.doubts import InputDoubts
from tire_dynamics.replay.input_watch import InputWatch
from tire_dynamics.replay.parameters import complete
from tire_dynamics.replay.pipeline import Pipeline
from tire_dynamics.report.findings import summary
from tire_dynamics.report.gather import gather

WHEELS = ["left", "right"]
STEP = 5_000_000
COUNT = 60
SPEED, LOAD = np.array([60.0, 61.0]), 4000.0


def write(folder: Path, speeds=SPEED, load=LOAD, stamps=None, force=False, note=None) -> Path:
    """Joint states and loads, as ``WrenchStamped`` or, with ``force``, ``Float64``."""
    stamps = STEP * (200 + np.arange(COUNT)) if stamps is None else stamps
    with BagWriter(folder, metadata=note and {RECORD: note}) as bag:
        states = bag.add_topic("/joint_states", messages.JOINT_STATE)
        kind, name = (messages.FLOAT64, "load_force") if force else (messages.WRENCH_STAMPED, "load")
        loads = [bag.add_topic(f"/{wheel}/{name}", kind) for wheel in WHEELS]
        state, wrench = JointStateEncoder(WHEELS).encode, WrenchEncoder("axle").encode
        for number, stamp in enumerate(stamps.tolist()):
            received = STEP * (200 + number)
            bag.write(states, received, received, state(stamp, list(speeds)))
            for each in loads:
                value = load * (1.0 + 0.01 * (number % 7))
                data = encode_float64(value) if force else wrench(received, 0.0, value)
                bag.write(each, received, received, data)
    return folder


KINDS = {
    "z down": ({"load": -LOAD}, "the mean load of left, right is -4"),
    "z down in load_force": ({"load": -LOAD, "force": True}, "is z down?"),
    "kN": ({"load": LOAD / 1e3}, "N: is it in kN?"),
    "g": ({"load": LOAD / GRAVITY}, "is the acceleration in g?"),
    "rpm": ({"speeds": 10.0 * SPEED}, "is it in rpm or deg/s?"),
    "km/h and m/s": ({"speeds": SPEED * [1.0, 3.6]}, "right turns 3.66 times as fast as the others"),
    "the other way": ({"speeds": SPEED * [1.0, -1.0]}, "right turns the other way than the rest"),
    "still": ({"speeds": SPEED * [1.0, 0.0]}, "the speed of right is 0 all the time"),
    "repeated times": ({"stamps": STEP * (200 + np.arange(COUNT) // 2 * 2)}, "30 of 60 speeds have the time"),
    "at import": ({"note": {"doubts": "a is in g?"}}, "said at import: a is in g?"),
}  # fmt: skip


@pytest.fixture
def config(tmp_path):
    """A tire below a corner that weighs some 4 kN with it."""
    path = tmp_path / "car.yaml"
    path.write_text("/**:\n  ros__parameters:\n    wheels: [left, right]\n    joint_names: [left, right]\n"
                    "    tire:\n      sprung_mass: 390.0\n")  # fmt: skip
    return path


@pytest.mark.parametrize(("odd", "words"), KINDS.values(), ids=KINDS)
def test_doubts_at_replay_and_in_the_report(tmp_path, capsys, config, odd, words):
    bag, log = write(tmp_path / "in", **odd), tmp_path / "log"
    assert main(["replay", str(bag), "-o", str(log), "--config", str(config), "--json"]) == 0
    out, err = capsys.readouterr()
    doubts = json.loads(out)["doubts"]
    assert len(doubts) == 1 and words in doubts[0]
    assert [line for line in err.splitlines() if line.startswith("doubtful: ")] == [f"doubtful: {doubts[0]}"]
    found = summary(gather(BagReader(log), BagReader(bag), replayed=True, quiet=True), None).findings
    assert [each.text for each in found if "doubtful" in each.text] == [f"The inputs are doubtful: {doubts[0]}"]


def test_nothing_is_said_of_a_sound_drive(tmp_path, capsys, config):
    bag, log = write(tmp_path / "in"), tmp_path / "log"
    assert main(["replay", str(bag), "-o", str(log), "--config", str(config)]) == 0
    assert "doubtful" not in capsys.readouterr().err
    found = summary(gather(BagReader(log), BagReader(bag), replayed=True, quiet=True), None).findings
    assert not any("doubtful" in each.text for each in found)


def test_each_of_several_bags_has_its_own(tmp_path, capsys, config):
    bags = [str(write(tmp_path / "sound")), str(write(tmp_path / "down", load=-LOAD))]
    out = str(tmp_path / "out")
    assert main(["replay", *bags, "-o", out, "--config", str(config), "--jobs", "1", "--json"]) == 0
    text, err = capsys.readouterr()
    sound, down = (bag["doubts"] for bag in json.loads(text)["bags"])
    assert sound == [] and len(down) == 1 and f"{bags[1]}: doubtful: {down[0]}" in err


@pytest.mark.parametrize(("load", "odd"), [(LOAD / GRAVITY, True), (850.0, True), (950.0, False), (LOAD, False)])
def test_without_a_sprung_mass_loads_are_held_against_the_weight_of_wheel_and_tire(tmp_path, capsys, load, odd):
    """A wheel of 40 kg with a belt of 5.88 kg weighs 449.9 N; loads have 3 % more in the mean."""
    config = tmp_path / "unit.yaml"
    config.write_text("wheel_mass: 40.0\n")
    bag = write(tmp_path / "in", load=load / 1.03)
    assert main(["replay", str(bag), "-o", str(tmp_path / "log"), "--config", str(config), "--json"]) == 0
    doubts = json.loads(capsys.readouterr().out)["doubts"]
    words = "hardly more than wheel and tire weigh by themselves, 449.9 N: is it in kg, or of an acceleration in g?"
    assert [words in doubt for doubt in doubts] == [True] * odd


def test_of_a_long_bag_every_other_block_is_looked_at_in_part(tmp_path, config):
    """A wheel that stands in the first blocks and turns in the next is not said to stand."""
    still, turning = write(tmp_path / "still", SPEED * [1.0, 0.0]), write(tmp_path / "turning")
    reader = BagReader(still)
    values, names, _ = bag_setup(reader, config)
    seen = InputDoubts(reader, values, names)
    [block] = reader.blocks()
    fields = "topic", "log_time", "publish_time", "start", "size"
    columns = {field: np.tile(getattr(block, field), 8) for field in fields}
    seen.take(block._replace(**columns))
    assert any("the speed of right is 0 in every sample that was looked at" in each for each in seen.doubts())
    for block in list(BagReader(turning).blocks()) * 2:
        seen.take(block)
    assert not any("the speed of right is 0" in each for each in seen.doubts())


@pytest.mark.parametrize("kind", ["wheel_speed", "load_force"])
def test_noise_for_numbers_does_not_end_the_watch_of_a_live_node(kind):
    """Their squares are beyond all numbers; they are no measurement, and say nothing of those between them."""
    values = complete({"wheels": WHEELS})
    pipeline, watch = Pipeline(values), InputWatch(values)
    said = []
    for second in range(4):
        for number in range(COUNT):
            now = (10 + second) * 10**9 + number * STEP
            for wheel in WHEELS:
                speed = SPEED[0] + 0.1 * (number % 3)
                pipeline.receive(f"{wheel}/wheel_speed", now, encode_float64(speed))
                pipeline.receive(f"{wheel}/load_force", now, encode_float64(LOAD))
            pipeline.receive(f"left/{kind}", now, encode_float64([1e308, -1e308, 1e200, np.inf][number % 4]))
        sums = pipeline.take_sums()
        assert np.isfinite([*sums.values()]).all()
        said = watch.update(sums)
    assert said == []
