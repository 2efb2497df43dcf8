"""Replay: what it computes from which bags, what it costs, and what comes out. No ROS is needed here."""

from __future__ import annotations

import json
import math
import os
import random
import shutil
import signal
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from tire_dynamics import TireWheelUnit, simulate, write_unit
from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.cdr import messages
from tire_dynamics.cdr.messages import JointStateEncoder, WrenchEncoder, encode_float64
from tire_dynamics.cli.main import main
from tire_dynamics.estimator.vehicle import Vehicle, VehicleSettings
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay.pipeline import Pipeline
from tire_dynamics.replay.replay import replay

SECOND = 10**9
BEGIN = 1_700_000_000 * SECOND
PERIOD = 2_000_000  # rate_hz = 500
MODAL = TireWheelUnit.table_1()
REACTION = TireWheelUnit.table_1(sidewall_damping="reaction")
OUTPUT_TYPES = {
    "axle_wrench": "geometry_msgs/msg/WrenchStamped",
    "ring_deflection": "std_msgs/msg/Float64MultiArray",
    "ring_shape": "sensor_msgs/msg/PointCloud2",
}


class InputBag:
    """Writes an input bag: ``at`` sets the time of receipt, then each call adds a message."""

    def __init__(self, folder: Path, wheels, prefix: str = "", joints: bool = False) -> None:
        self.folder = folder
        self._writer = BagWriter(folder)
        self._wrench = WrenchEncoder("axle")
        self._load = {w: self._writer.add_topic(f"{prefix}/{w}/load", messages.WRENCH_STAMPED) for w in wheels}
        self._joint_states = JointStateEncoder([*wheels, "steering"])
        if joints:
            self._joints = self._writer.add_topic(f"{prefix}/joint_states", messages.JOINT_STATE)
        else:
            self._speed = {w: self._writer.add_topic(f"{prefix}/{w}/wheel_speed", messages.FLOAT64) for w in wheels}
        self.now = BEGIN

    def at(self, now: int) -> InputBag:
        self.now = now
        return self

    def speed(self, wheel: str, value: float) -> InputBag:
        self._writer.write(self._speed[wheel], self.now, self.now, encode_float64(value))
        return self

    def joints(self, *values: float, stamp: int | None = None) -> InputBag:
        stamp = self.now if stamp is None else stamp
        self._writer.write(self._joints, self.now, stamp, self._joint_states.encode(stamp, [*values, math.nan]))
        return self

    def load(self, wheel: str, value: float, traction: float = 0.0, stamp: int | None = None) -> InputBag:
        stamp = self.now if stamp is None else stamp
        data = self._wrench.encode(stamp, traction, value)
        self._writer.write(self._load[wheel], self.now, stamp, data)
        return self

    def close(self) -> Path:
        self._writer.close()
        return self.folder


def constant(folder: Path, seconds: float, wheels=("wheel",), speed=100.0, load=4000.0, begin=BEGIN, **options) -> Path:
    bag = InputBag(folder, wheels, **options)
    for number in range(round(100 * seconds)):
        bag.at(begin + number * 10_000_000)
        for name in wheels:
            bag.speed(name, speed).load(name, load)
    return bag.close()


def wild(folder: Path, seed: int = 5) -> Path:
    """Two wheels, jittery, late, out of order, with values that are none and a gap."""
    chance = random.Random(seed)
    bag = InputBag(folder, ["left", "right"], joints=True)
    now = BEGIN
    for number in range(1500):
        now += chance.randrange(0, 4_000_000)
        if number == 700:
            now += SECOND
        stamp = now - int(chance.expovariate(1e-7))
        if chance.random() < 0.05:
            stamp = chance.choice([0, now + 50_000_000, now - 500_000_000])
        bag.at(now)
        if number % 5 == 0:
            bag.joints(50.0 + number / 100.0, math.nan if chance.random() < 0.1 else -50.0, stamp=stamp)
        for name in ("left", "right"):
            bag.load(name, chance.choice([4000.0, math.nan, -10.0]) + chance.gauss(0.0, 300.0), 200.0, stamp=stamp)
    return bag.close()


def wrenches(folder: Path, wheel: str = "wheel") -> np.ndarray:
    """Rows of stamp [ns], x, z of a wheel's axle force, with our own reader."""
    rows = [
        (decoded.stamp_ns, decoded.fx, decoded.fz)
        for _, _, _, _, data in BagReader(folder).messages([f"/{wheel}/axle_wrench"])
        for decoded in [messages.decode_wrench(data)]
    ]
    return np.array(rows, dtype=object)


# --- what it computes ---


@pytest.mark.parametrize("unit", [MODAL, REACTION], ids=["modal", "reaction"])
def test_constant_inputs_give_what_simulate_gives(tmp_path, unit):
    constant(tmp_path / "in", 2.0, speed=209.44, load=1961.33)
    write_unit(unit, tmp_path / "unit.yaml")
    replay(tmp_path / "in", tmp_path / "out", config=tmp_path / "unit.yaml")
    rows = wrenches(tmp_path / "out")
    assert len(rows) == 996  # 500 Hz from BEGIN, which is a multiple of the period, to the last input at 1.99 s
    assert [stamp for stamp, _, _ in rows] == list(range(BEGIN, BEGIN + 996 * PERIOD, PERIOD))
    time = np.arange(996) * 2e-3
    expected = simulate(unit, time, 209.44, 1961.33).axle_force
    # Both exact but for rounding, of a thousand steps among forces of some kN.
    np.testing.assert_allclose(rows[:, 1:].astype(float), expected, rtol=0, atol=1e-6)


def test_a_load_that_is_held_between_samples_is_what_simulate_gives_for_short_ramps(tmp_path):
    """A staircase of 10 ms, sampled by the ticks that fall between its steps."""
    bag = InputBag(tmp_path / "in", ["wheel"])
    loads = 4000.0 + 800.0 * np.sin(0.37 * np.arange(100))
    for number, load in enumerate(loads):
        bag.at(BEGIN + number * 10_000_000).speed("wheel", 80.0).load("wheel", float(load), 150.0)
    replay(bag.close(), tmp_path / "out")
    rows = wrenches(tmp_path / "out")
    # The same staircase for simulate, whose inputs are linear between samples: each step as a ramp of 1 ns.
    edges = 0.01 * np.arange(100)
    time = np.unique(np.concatenate([edges[1:] - 1e-9, edges, 2e-3 * np.arange(496)]))
    held = loads[np.searchsorted(edges, time, side="right") - 1]
    force = simulate(MODAL, time, 80.0, held, traction=150.0).axle_force
    at_ticks = np.stack([np.interp(2e-3 * np.arange(len(rows)), time, force[:, i]) for i in range(2)], axis=1)
    # A ramp of 1 ns against a step shifts a change of 500 N by half a nanosecond: 1e-6 of N and less matter.
    np.testing.assert_allclose(rows[:, 1:].astype(float), at_ticks, rtol=0, atol=1e-3)


def test_it_is_a_vehicle_fed_by_hand(tmp_path):
    wild(tmp_path / "in")
    replay(tmp_path / "in", tmp_path / "out")
    settings = VehicleSettings(unit=MODAL, wheels=("left", "right"), joint_names=("left", "right"))
    vehicle = Vehicle(settings)
    decoder = messages.JointStateDecoder()
    expected = {"left": [], "right": []}
    due = None

    def tick(moment: int) -> None:
        for index, x, z in vehicle.tick(moment):
            expected[settings.wheels[index]].append((moment, x, z))

    for topic, _, received, _, data in BagReader(tmp_path / "in").messages():
        due = -(-received // PERIOD) * PERIOD if due is None else due
        while due < received:  # a tick after every message received until then
            tick(due)
            due += PERIOD
        if topic == "/joint_states":
            state = decoder.decode(data)
            vehicle.joint_states(received, state.stamp_ns, state.names, state.velocities)
        else:
            load = messages.decode_wrench(data)
            index = settings.wheels.index(topic.split("/")[1])
            vehicle.load(index, received, load.stamp_ns, load.fz, load.fx)
    for name, rows in expected.items():
        assert len(rows) > 500
        assert [*map(tuple, wrenches(tmp_path / "out", name))] == rows  # the same bits


@pytest.mark.slow
def test_a_replay_replayed_is_the_same_bytes(tmp_path):
    wild(tmp_path / "in")
    for source, target in (("in", "a"), ("a/bag", "b"), ("b/bag", "c")):
        (tmp_path / target).mkdir()
        replay(tmp_path / source, tmp_path / target / "bag")
    one, two, three = ((tmp_path / name / "bag" / "bag_0.mcap").read_bytes() for name in "abc")
    assert one == two == three


def test_inputs_come_out_as_they_went_in(tmp_path):
    wild(tmp_path / "in")
    summary = replay(tmp_path / "in", tmp_path / "out")
    inputs = [*BagReader(tmp_path / "in").messages()]
    topics = BagReader(tmp_path / "in").topics
    assert [*BagReader(tmp_path / "out").messages(topics)] == inputs
    assert sum(summary.received.values()) == len(inputs)
    found = dict.fromkeys(summary.written, 0)
    for topic, _, _, _, _ in BagReader(tmp_path / "out").messages(f"/{name}" for name in found):
        found[topic[1:]] += 1
    assert found == summary.written


def test_the_output_opens_with_rosbags(tmp_path):
    constant(tmp_path / "in", 1.0, wheels=("left", "right"))
    summary = replay(tmp_path / "in", tmp_path / "out")
    with AnyReader([tmp_path / "out"]) as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
        for name in ("left", "right"):
            for output, msgtype in OUTPUT_TYPES.items():
                assert types[f"/{name}/{output}"] == msgtype
        count = dict.fromkeys(types, 0)
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            count[connection.topic] += 1
            if connection.topic == "/left/axle_wrench":
                assert message.header.frame_id == "left_axle"
                assert math.isfinite(message.wrench.force.z)
    for topic, written in summary.written.items():
        assert count[f"/{topic}"] == written > 0


# --- which wheels, which parameters ---


def test_wheels_are_found_under_any_prefix(tmp_path):
    constant(tmp_path / "in", 0.5, wheels=("left", "right"), prefix="/car/chassis")
    summary = replay(tmp_path / "in", tmp_path / "out")
    assert summary.parameters["wheels"] == ("left", "right")
    assert "/car/chassis/left/axle_wrench" in BagReader(tmp_path / "out").topics


def test_the_exact_name_is_taken_before_a_longer_one_that_ends_alike(tmp_path):
    # A robot on the car has joint states of its own; the node in the root namespace would hear the car's only.
    bag = InputBag(tmp_path / "in", ["wheel"], joints=True)
    other = bag._writer.add_topic("/arm/joint_states", messages.JOINT_STATE)
    for number in range(50):
        bag.at(BEGIN + number * 10_000_000).joints(90.0).load("wheel", 4000.0)
        bag._writer.write(other, bag.now, bag.now, JointStateEncoder(["wheel"]).encode(bag.now, [5.0]))
    replay(bag.close(), tmp_path / "out")
    expected = simulate(MODAL, [0.0, 0.1], 90.0, 4000.0).axle_force[0]
    np.testing.assert_allclose(wrenches(tmp_path / "out")[-1, 1:].astype(float), expected, rtol=0, atol=1e-6)


def test_a_config_with_only_a_tire_leaves_the_wheels_to_the_bag(tmp_path):
    constant(tmp_path / "in", 0.5, wheels=("left", "right"))
    (tmp_path / "tire.yaml").write_text("sidewall_damping: reaction\nzeta_1: 0.1\n")
    summary = replay(tmp_path / "in", tmp_path / "out", config=tmp_path / "tire.yaml")
    assert summary.parameters["wheels"] == ("left", "right")
    x, z = wrenches(tmp_path / "out", "right")[-1, 1:]
    assert z == pytest.approx(4000.0, abs=1e-6) and x == pytest.approx(0.0, abs=1e-6)  # docs/model.md, section 5


def test_a_config_with_only_a_tire_keeps_the_rest_of_a_log(tmp_path):
    """What would another tire have done on the same drive: the log's joints, frames and rate stay."""
    bag = InputBag(tmp_path / "in", ["left", "right"], joints=True)
    for number in range(100):
        bag.at(BEGIN + number * 10_000_000).joints(60.0, 70.0).load("left", 3000.0).load("right", 5000.0)
    (tmp_path / "car.yaml").write_text(
        "/**:\n  ros__parameters:\n    wheels: [right, left]\n    joint_names: [left, right]\n    rate_hz: 200.0\n"
    )
    first = replay(bag.close(), tmp_path / "log", config=tmp_path / "car.yaml")
    (tmp_path / "tire.yaml").write_text("sidewall_damping: reaction\n")
    second = replay(tmp_path / "log", tmp_path / "out", config=tmp_path / "tire.yaml")
    for name in ("wheels", "joint_names", "rate_hz"):
        assert second.parameters[name] == first.parameters[name], name
    assert second.written == first.written


def test_another_rate(tmp_path):
    constant(tmp_path / "in", 1.0)
    replay(tmp_path / "in", tmp_path / "log")
    config = tmp_path / "slow.yaml"
    config.write_text("/**:\n  ros__parameters:\n    rate_hz: 100.0\n    ring_rate_hz: 10.0\n")
    for source in ("in", "log"):  # a log is then followed by its inputs, not by its ticks
        summary = replay(tmp_path / source, tmp_path / f"{source}_slow", config=config)
        rows = wrenches(tmp_path / f"{source}_slow")
        assert [stamp for stamp, _, _ in rows] == list(range(BEGIN, BEGIN + 100 * 10_000_000, 10_000_000))
        assert summary.written["wheel/ring_shape"] == 10
    assert np.array_equal(wrenches(tmp_path / "in_slow"), wrenches(tmp_path / "log_slow"))


@pytest.mark.slow
def test_another_ring_rate_leaves_the_ticks_of_a_log_alone(tmp_path):
    wild(tmp_path / "in")
    replay(tmp_path / "in", tmp_path / "log")
    config = tmp_path / "ring.yaml"
    config.write_text(
        "/**:\n  ros__parameters:\n    wheels: [left, right]\n    ring_rate_hz: 500.0\n    ring_samples: 8\n"
    )
    summary = replay(tmp_path / "log", tmp_path / "out", config=config)
    assert np.array_equal(wrenches(tmp_path / "out", "left"), wrenches(tmp_path / "log", "left"))
    assert summary.written["left/ring_shape"] == summary.written["left/axle_wrench"]


def test_a_wheel_without_topics_is_named(tmp_path):
    constant(tmp_path / "in", 0.1)
    config = tmp_path / "car.yaml"
    config.write_text("/**:\n  ros__parameters:\n    wheels: [wheel, spare]\n")
    with pytest.raises(InputError, match="spare/load"):
        replay(tmp_path / "in", tmp_path / "out", config=config)


def test_a_topic_of_another_type_is_named(tmp_path):
    with BagWriter(tmp_path / "in") as writer:
        writer.add_topic("/w/load", messages.WRENCH_STAMPED)
        writer.add_topic("/w/wheel_speed", messages.STRING)
    with pytest.raises(InputError, match="/w/wheel_speed is std_msgs/msg/String"):
        replay(tmp_path / "in", tmp_path / "out")


def _damaged_records():
    good = json.loads(messages.decode_string(Pipeline({"wheels": ["w"]}).record({})))
    yield from ("", "{}", "[]", "nonsense")
    for key in good:
        for value in (None, 5, "text", [5]):
            yield json.dumps({**good, key: value})
    yield json.dumps({**good, "parameters": {**good["parameters"], "wheels": 5}})
    yield json.dumps({**good, "parameters": {**good["parameters"], "rate": 5.0}})
    yield json.dumps({**good, "topics": {"w/axle_wrench": "/w/load"}})
    yield json.dumps({**good, "topics": {"w/axle_wrench": 5}})
    yield json.dumps({**good, "vehicle": {"time": 5, "ring_turns": [1], "wheels": [5]}})
    yield json.dumps({**good, "vehicle": {**good["vehicle"], "time": "now"}})
    yield json.dumps({**good, "vehicle": {**good["vehicle"], "wheels": []}})
    yield json.dumps({**good, "vehicle": {**good["vehicle"], "time": 2**70}})
    # more than there is room for: what is compiled writes where it is told to
    yield json.dumps({**good, "vehicle": {**good["vehicle"], "ring_turns": [1] * 10_000}})
    yield json.dumps({**good, "vehicle": {**good["vehicle"], "wheels": good["vehicle"]["wheels"] * 10_000}})
    [wheel] = good["vehicle"]["wheels"]
    belt = wheel["belt"]
    for changes in (
        {"state": [0.0] * 10_000}, {"state": []}, {"speed": [[2**70, 1.0, None], []]}, {"load": [None, [[5, 1.0]]]},
        {"spin_speed": 10**400}, {"belt": {**belt, "own": [[[0.0] * 1000] * 2] * 2}},
        {"belt": {**belt, "interval": [2**64, 1.0, 1.0, 1.0]}}, {"belt": {**belt, "interval": [1]}},
    ):  # fmt: skip
        yield json.dumps({**good, "vehicle": {**good["vehicle"], "wheels": [{**wheel, **changes}]}})


@pytest.mark.parametrize("record", [*_damaged_records()], ids=lambda record: record[-60:])
def test_a_damaged_log_record_is_an_input_error(tmp_path, record):
    encoder = WrenchEncoder("axle")
    with BagWriter(tmp_path / "in") as writer:
        text = writer.add_topic("/tire_dynamics/log_record", messages.STRING)
        tick = writer.add_topic("/tire_dynamics/tick", messages.CLOCK)
        speed = writer.add_topic("/w/wheel_speed", messages.FLOAT64)
        load = writer.add_topic("/w/load", messages.WRENCH_STAMPED)
        writer.write(text, BEGIN, BEGIN, messages.encode_string(record))
        writer.write(speed, BEGIN, BEGIN, encode_float64(1.0))
        writer.write(load, BEGIN, BEGIN, encoder.encode(BEGIN, 0.0, 1.0))
        writer.write(tick, BEGIN, BEGIN, messages.encode_clock(BEGIN))
    with pytest.raises(InputError):
        replay(tmp_path / "in", tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_malformed_messages_are_left_out(tmp_path):
    noise = random.Random(3)
    bag = InputBag(tmp_path / "in", ["wheel"])
    for number in range(100):
        bag.at(BEGIN + number * 10_000_000).speed("wheel", 100.0).load("wheel", 4000.0)
        for topic in (*bag._load.values(), *bag._speed.values()):
            bag._writer.write(topic, bag.now, bag.now, b"\0\x07" + noise.randbytes(noise.randrange(40)))
    replay(bag.close(), tmp_path / "out")
    expected = simulate(MODAL, [0.0, 0.1], 100.0, 4000.0).axle_force[0]
    rows = wrenches(tmp_path / "out")
    np.testing.assert_allclose(rows[:, 1:].astype(float), np.tile(expected, (len(rows), 1)), rtol=0, atol=1e-6)


def test_nothing_but_malformed_messages_is_an_error_that_says_so(tmp_path):
    with BagWriter(tmp_path / "in") as writer:
        speed = writer.add_topic("/w/wheel_speed", messages.FLOAT64)
        load = writer.add_topic("/w/load", messages.WRENCH_STAMPED)
        for number in range(10):
            for topic in (speed, load):
                writer.write(topic, BEGIN + number, BEGIN, b"\0\1\0\0abc")
    with pytest.raises(InputError, match="not what their type says"):
        replay(tmp_path / "in", tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


# --- what it costs ---


def test_a_year_of_silence_costs_nothing(tmp_path):
    bag = InputBag(tmp_path / "in", ["wheel"])
    year = 365 * 86400 * SECOND
    for begin in (BEGIN, BEGIN + year):
        for number in range(50):
            bag.at(begin + number * 10_000_000).speed("wheel", 100.0).load("wheel", 4000.0)
    summary = replay(bag.close(), tmp_path / "out")
    # 0.49 s each with both ends, and after the first the timeout of 0.2 s, in which the last inputs are believed.
    assert summary.written["wheel/axle_wrench"] == 246 + 100 + 246
    assert BagReader(tmp_path / "out").message_count < 2000


@pytest.mark.slow
def test_memory_does_not_grow_with_the_bag(tmp_path):
    peaks = []
    for seconds in (45.0, 135.0):  # the shorter one is longer than what is taken together, twice
        source = constant(tmp_path / f"in_{seconds:g}", seconds)
        replay(source, tmp_path / f"warm_{seconds:g}")  # what is loaded and cached once is no growth
        tracemalloc.start()
        replay(source, tmp_path / f"out_{seconds:g}")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # 120 000 messages more, each at least 100 bytes: kept, they would be 12 MB and up. Which parts of the block that is
    # written and of the one that is computed meet is the threads' affair, and worth a few MB either way.
    assert peaks[1] - peaks[0] < 8e6


# --- a real drive ---


@pytest.mark.slow
def test_a_real_drive(drive, tmp_path):
    wheels = ("front_left", "front_right", "rear_left", "rear_right")
    status = main(
        ["import", "--speed", str(drive / "wheel_speed.csv"), "--speed-unit", "m/s", "--rolling-radius", "0.305"]
        + ["--speed-columns", *(f"{wheel}={wheel}_m_s" for wheel in wheels)]
        + ["--load", str(drive / "accelerometer.csv"), "--load-unit", "m/s^2", "--corner-mass", "380"]
        + ["--load-columns", "down_m_s2", "-o", str(tmp_path / "in")]
    )
    assert status == 0
    (tmp_path / "reaction.yaml").write_text("sidewall_damping: reaction\n")
    summary = replay(tmp_path / "in", tmp_path / "out", config=tmp_path / "reaction.yaml")
    assert summary.parameters["wheels"] == wheels
    # The recording's own estimate of the load: 380 kg on each corner times |down|, in its README.
    down = np.genfromtxt(drive / "accelerometer.csv", delimiter=",", names=True)["down_m_s2"]
    mean_load = 380.0 * np.abs(down).mean()
    for wheel in wheels:
        rows = wrenches(tmp_path / "out", wheel)
        stamps, force = rows[:, 0].astype(np.int64), rows[:, 1:].astype(float)
        assert stamps[-1] - stamps[0] > 59 * SECOND
        assert len(rows) > 0.99 * (stamps[-1] - stamps[0]) / PERIOD
        assert np.isfinite(force).all()
        assert force[:, 1].mean() == pytest.approx(mean_load, rel=0.01)


@pytest.mark.slow
def test_interrupting_leaves_nothing_behind(tmp_path):
    """Ctrl-C in the middle: no half bag under the name of the output, and no other."""
    for seconds in (60.0, 240.0, 960.0, 3840.0):  # until one takes longer than this process waits for its turn
        shutil.rmtree(tmp_path)
        tmp_path.mkdir()
        status, said = interrupted(constant(tmp_path / "in", seconds), tmp_path)
        if status != 0:
            break
    # Where the signal met code that C called, Python ends by it after all; a shell calls both 130.
    assert status in (128 + signal.SIGINT, -signal.SIGINT), said
    assert "Traceback" not in said
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def interrupted(source: Path, tmp_path: Path) -> tuple[int, str]:
    """Exit status and last words of a replay that gets a SIGINT as soon as it has begun to write."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tire_dynamics.cli.main", "replay", str(source), "-o", str(tmp_path / "out")],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])},
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        while len([*tmp_path.iterdir()]) == 1 and process.poll() is None:
            pass
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=300)
    finally:
        process.kill()
        process.wait()
    return process.returncode, said


@pytest.mark.parametrize("place", ["in", "in/inner", "."])
def test_what_is_replayed_is_never_written_over(tmp_path, place):
    source = constant(tmp_path / "in", 1.0)
    before = sorted((path, path.read_bytes()) for path in source.iterdir())
    with pytest.raises(InputError, match="never changed"):
        replay(source, tmp_path / place, force=True)
    if place != "in/inner":  # beside a file there may be something
        with pytest.raises(InputError, match="never changed"):
            replay(source / "in_0.mcap", tmp_path / place, force=True)
    assert sorted((path, path.read_bytes()) for path in source.iterdir()) == before
