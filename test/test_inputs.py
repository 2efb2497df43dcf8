"""What a bag has for its wheels: clocks, joint names, velocities, encodings; what is refused, and what helps."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.typesys import Stores, get_typestore

from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.cdr import messages
from tire_dynamics.cdr.messages import JointStateEncoder, WrenchEncoder, encode_float64
from tire_dynamics.cli.info import info
from tire_dynamics.cli.main import main
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay.replay import replay

SECOND = 10**9
BEGIN = 1_700_000_000 * SECOND  # of the recorder's clock
SIMULATED = 12 * SECOND  # where a simulation's clock is then
STEP = 5_000_000


def write(
    folder: Path,
    *,
    stamp=lambda received: received,
    joints=("front_left", "front_right"),
    speeds=(60.0, 61.0),
    wheels=("front_left", "front_right"),
    count=120,
) -> Path:
    """Joint states and loads; ``stamp`` of the time of receipt."""
    with BagWriter(folder) as bag:
        states = bag.add_topic("/joint_states", messages.JOINT_STATE)
        loads = [bag.add_topic(f"/{wheel}/load", messages.WRENCH_STAMPED) for wheel in wheels]
        encode, wrench = JointStateEncoder(list(joints)).encode, WrenchEncoder("axle").encode
        for number in range(count):
            received = BEGIN + number * STEP
            bag.write(states, received, received, encode(stamp(received), list(speeds)))
            for load in loads:
                bag.write(load, received + 1, received + 1, wrench(stamp(received), 0.0, 4000.0 + 10.0 * (number % 7)))
    return folder


def simulated(received: int) -> int:
    """A simulation at half of real time."""
    return SIMULATED + (received - BEGIN) // 2


def forces(folder: Path, wheel: str = "front_left") -> list[tuple[int, float, float]]:
    rows = BagReader(folder).messages([f"/{wheel}/axle_wrench"])
    return [(row.stamp_ns, row.fx, row.fz) for row in (messages.decode_wrench(data) for *_, data in rows)]


def said_no(path: Path) -> str:
    """Why it cannot be replayed, which info and replay say alike."""
    answer = info(path)["replay"]
    assert not answer["possible"]
    with pytest.raises(InputError) as error:
        replay(path, path.with_name("never"))
    assert answer["why_not"] in " ".join(str(error.value).split())
    assert not path.with_name("never").exists()
    return answer["why_not"]


# --- clocks ---


def test_two_clocks_are_refused_with_the_reason(tmp_path):
    why = said_no(write(tmp_path / "bag", stamp=simulated))
    assert "stamp 12.000 s, received 2023-11-14 22:13:20" in why
    assert "--clock stamp" in why and "--clock log" in why


def test_with_the_clock_of_the_stamps_it_is_as_if_received_then(tmp_path):
    """Simulated time at half speed: the outputs are those of a bag that was received when the stamps say."""
    bag = write(tmp_path / "bag", stamp=simulated)
    with BagWriter(tmp_path / "same") as same:
        handles = {topic: same.add_topic(topic, kind) for topic, kind in BagReader(bag).topics.items()}
        for topic, _, received, _, data in BagReader(bag).messages():
            moment = simulated(received - received % STEP)
            same.write(handles[topic], moment, moment, data)
    replay(tmp_path / "same", tmp_path / "expected")
    assert info(bag, clock="stamp")["replay"]["possible"]
    summary = replay(bag, tmp_path / "out", clock="stamp")
    assert forces(tmp_path / "out") == forces(tmp_path / "expected") and len(forces(tmp_path / "out")) > 100
    assert not summary.without
    rows = [(time, data) for _, _, time, _, data in BagReader(tmp_path / "out").messages(["/joint_states"])]
    assert [time for time, _ in rows] == [simulated(BEGIN + number * STEP) for number in range(120)]
    replay(tmp_path / "out", tmp_path / "again")  # the output is a log that needs no --clock
    assert forces(tmp_path / "again") == forces(tmp_path / "out")


def test_with_the_clock_of_the_log_it_is_as_if_stamped_on_receipt(tmp_path):
    replay(write(tmp_path / "same", stamp=lambda received: received), tmp_path / "expected")
    bag = write(tmp_path / "bag", stamp=simulated)
    assert info(bag, clock="log")["replay"]["possible"]
    replay(bag, tmp_path / "out", clock="log")
    ours, theirs = np.array(forces(tmp_path / "out")), np.array(forces(tmp_path / "expected"))
    # The loads were received a nanosecond after their stamps: 1e-9 of 2 ms of a force that changes by tens of N.
    assert len(ours) > 100 and np.allclose(ours, theirs, rtol=0.0, atol=1e-3)


def test_either_byte_order_is_restamped(tmp_path):
    little = JointStateEncoder(["a"]).encode(SIMULATED + 7, [1.0])
    sec, nanosec = struct.unpack_from("<iI", little, 4)
    big = b"\x00\x00" + little[2:4] + struct.pack(">iI", sec, nanosec) + little[12:]
    with BagWriter(tmp_path / "bag") as bag:
        topic = bag.add_topic("/joint_states", messages.JOINT_STATE)
        for data in (little, big):
            bag.write(topic, BEGIN + 5, BEGIN + 5, data)
    stamps = [data[4:12] for *_, data in BagReader(tmp_path / "bag", "log").messages()]
    assert stamps == [struct.pack("<iI", BEGIN // SECOND, 5), struct.pack(">iI", BEGIN // SECOND, 5)]
    assert [time for _, _, time, _, _ in BagReader(tmp_path / "bag", "stamp").messages()] == 2 * [SIMULATED + 7]


def test_a_stamp_that_leaps_ahead_is_not_followed(tmp_path):
    """One stamp of the year 2100 does not put an end to the drive; a pause of the recorder is followed."""

    def stamp(received: int) -> int:
        number = (received - BEGIN) // STEP
        return 4_102_444_800 * SECOND % (2**31 * SECOND) if number == 10 else simulated(received)

    bag = write(tmp_path / "bag", stamp=stamp)
    times = [time for _, _, time, _, _ in BagReader(bag, "stamp").messages()]
    assert times == sorted(times) and times[-1] == simulated(BEGIN + 119 * STEP)
    with BagWriter(tmp_path / "pause") as bag:
        topic = bag.add_topic("/joint_states", messages.JOINT_STATE)
        for pause in (0, 3600 * SECOND):
            bag.write(topic, BEGIN + pause, BEGIN, JointStateEncoder(["a"]).encode(SIMULATED + pause, [1.0]))
    times = [time for _, _, time, _, _ in BagReader(tmp_path / "pause", "stamp").messages()]
    assert times == [SIMULATED, SIMULATED + 3600 * SECOND]


def test_what_has_no_stamp_counts_from_the_stamps_around_it(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        states, load = (
            bag.add_topic("/joint_states", messages.JOINT_STATE),
            bag.add_topic("/w/load_force", messages.FLOAT64),
        )
        for number in range(3):
            moment = BEGIN + number * STEP
            bag.write(load, moment, moment, encode_float64(4000.0))
            bag.write(states, moment + 1, moment, JointStateEncoder(["w"]).encode(simulated(moment), [1.0]))
    times = [
        time for topic, _, time, _, _ in BagReader(tmp_path / "bag", "stamp").messages() if topic == "/w/load_force"
    ]
    assert times == [simulated(BEGIN), simulated(BEGIN), simulated(BEGIN + STEP)]


# --- joints ---


def test_joints_that_do_not_fit_are_listed_and_can_be_named(tmp_path):
    bag = write(tmp_path / "bag", joints=("fl_wheel", "fr_wheel"))
    why = said_no(bag)
    assert "its joints: fl_wheel, fr_wheel" in why and "--joint front_left:=fl_wheel" in why
    joints = {"front_left": "fl_wheel", "front_right": "fr_wheel"}
    assert info(bag, joints=joints)["replay"]["possible"]
    summary = replay(bag, tmp_path / "out", joints=joints)
    replay(write(tmp_path / "same"), tmp_path / "expected")
    assert forces(tmp_path / "out") == forces(tmp_path / "expected")
    assert summary.parameters["joint_names"] == ("fl_wheel", "fr_wheel")


def test_joints_of_the_command_line(tmp_path, capsys):
    bag = write(tmp_path / "bag", joints=("a", "b"))
    out = str(tmp_path / "out")
    command = ["replay", str(bag), "-o", out, "--joint", "front_left:=a", "--joint", "front_right:=b"]
    assert main(command) == 0
    assert main(["info", str(bag), "--joint", "front_left:=a", "--joint", "front_right:=b", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["replay"]["without"] == {}
    assert main([*command, "--joint", "rear:=b", "--force"]) == 2
    assert "rear is no wheel; the wheels are front_left, front_right" in capsys.readouterr().err
    assert main([*command, "--joint", "front_left", "--force"]) == 2
    assert "it must be WHEEL:=NAME" in capsys.readouterr().err


def test_joint_states_without_velocities_are_refused(tmp_path):
    """As arms are published: positions alone."""
    store = get_typestore(Stores.ROS2_JAZZY)
    kind = store.types[messages.JOINT_STATE]
    header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](BEGIN // SECOND, 0), "")
    state = kind(header, ["front_left", "front_right"], np.zeros(2), np.zeros(0), np.zeros(0))
    bag = write(tmp_path / "whole")
    with BagWriter(tmp_path / "bag") as positions:
        handles = {topic: positions.add_topic(topic, of) for topic, of in BagReader(bag).topics.items()}
        for topic, of, at, _, data in BagReader(bag).messages():
            data = bytes(store.serialize_cdr(state, of)) if of == messages.JOINT_STATE else data
            positions.write(handles[topic], at, at, data)
    assert "front_left, front_right: its joint_states have no velocities" in said_no(tmp_path / "bag")


# --- one wheel of several ---


def test_a_wheel_without_outputs_is_said_with_the_reason_and_the_status(tmp_path, capsys):
    bag = write(tmp_path / "bag", speeds=(math.nan, 61.0))
    assert main(["replay", str(bag), "-o", str(tmp_path / "out")]) == 2
    assert "front_left: no output; its speed was not finite 120 times" in capsys.readouterr().err
    assert forces(tmp_path / "out", "front_right")  # the other has its own
    assert main(["replay", str(bag), "-o", str(tmp_path / "out"), "--force", "--json"]) == 2
    answer = json.loads(capsys.readouterr().out)
    assert answer["without"] == {"front_left": "its speed was not finite 120 times"}
    assert main(["replay", str(bag), "-o", str(tmp_path / "many"), "--jobs", "1", "--json"]) == 2
    (one,) = json.loads(capsys.readouterr().out)["bags"]
    assert one["without"] == answer["without"] and one["error"] is None


def test_the_report_says_why_a_wheel_has_no_outputs(tmp_path):
    pytest.importorskip("plotly")
    from tire_dynamics.cli.report import report

    bag = write(tmp_path / "bag", speeds=(math.nan, 61.0))
    report(bag, tmp_path / "a.html", quiet=True)
    assert "front_left has no outputs: its speed was not finite 120 times." in (tmp_path / "a.html").read_text("utf-8")


def test_info_says_which_wheel_will_have_no_outputs(tmp_path, capsys):
    bag = write(tmp_path / "bag", joints=("front_left", "fr"))
    replayed = info(bag)["replay"]
    assert replayed["possible"] and list(replayed["without"]) == ["front_right"]
    assert "no joint of joint_states is named front_right" in replayed["without"]["front_right"]
    assert main(["info", str(bag)]) == 0
    shown = capsys.readouterr().out
    assert "yes: front_left\n" in shown and "no output of front_right" in shown


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"speeds": (math.nan, math.inf)}, "front_left: its speed was not finite 120 times"),
        ({"speeds": (1e6, 1e6)}, "its speed was beyond max_speed_rad_s (1000) 120 times"),
    ],
)
def test_nothing_at_all_is_refused_with_the_reasons(tmp_path, options, reason):
    bag = write(tmp_path / "bag", **options)
    with pytest.raises(InputError) as error:
        replay(bag, tmp_path / "out")
    assert reason in str(error.value)


# --- what else is in a bag ---


def foreign(path: Path, *topics: tuple[str, str, str]) -> Path:
    """An .mcap file of these topics, types and encodings, with a message each."""
    with open(path, "wb") as file:
        writer = McapWriter(file)
        writer.start("")
        for topic, kind, encoding in topics:
            channel = writer.register_channel(topic, encoding, writer.register_schema(kind, "jsonschema", b""))
            writer.add_message(channel, BEGIN, b"\0\1\0\0", BEGIN)
        writer.finish()
    return path


def test_an_unrelated_topic_of_two_types_refuses_nothing(tmp_path):
    import shutil

    folder = tmp_path / "bag"
    write(folder, wheels=("front_left",))
    [path] = folder.glob("*.mcap")
    shutil.copy(path, tmp_path / "one.mcap")
    content = BagReader(path)
    with open(tmp_path / "two.mcap", "wb") as file:
        writer = McapWriter(file)
        writer.start("ros2")
        for kind in ("a/msg/A", "a/msg/B"):
            schema = writer.register_schema(kind, "ros2msg", b"")
            writer.add_message(writer.register_channel("/odd", "cdr", schema), BEGIN, b"\0\1\0\0", BEGIN)
        handles = {}
        for topic, kind, at, _, data in content.messages():
            if topic not in handles:
                handles[topic] = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", b""))
            writer.add_message(handles[topic], at, data, at)
        writer.finish()
    assert BagReader(tmp_path / "two.mcap").topics["/odd"] == "a/msg/A, a/msg/B"
    for name in ("one", "two"):
        replay(tmp_path / f"{name}.mcap", tmp_path / name)
    assert forces(tmp_path / "one") == forces(tmp_path / "two")


@pytest.mark.parametrize(
    ("encoding", "help"), [("ros1", "the bag of ROS 1 itself (.bag) is read"), ("json", "record it with ros2 bag")]
)
def test_other_encodings_are_named(tmp_path, encoding, help):
    kinds = (messages.WRENCH_STAMPED, messages.FLOAT64)
    bag = foreign(tmp_path / "a.mcap", *zip(("/w/load", "/w/wheel_speed"), kinds, (encoding,) * 2, strict=True))
    why = said_no(bag)
    assert f"encoded as {encoding}" in why and help in why
    # Types are named otherwise there, so that the topics are not even found.
    bag = foreign(tmp_path / "b.mcap", ("/w/load", "geometry_msgs/WrenchStamped", encoding))
    why = said_no(bag)
    assert f"encoded as {encoding}" in why and help in why


def test_a_remap_that_collides_names_the_two(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        for wheel in ("left", "right"):
            bag.add_topic(f"/{wheel}/load", messages.WRENCH_STAMPED)
            bag.add_topic(f"/{wheel}/wheel_speed", messages.FLOAT64)
    remaps = {"left/load": "/right/load"}
    with pytest.raises(InputError, match=r"--remap makes /right/load both left/load and right/load"):
        replay(tmp_path / "bag", tmp_path / "out", remaps=remaps)


def test_identify_reads_on_one_clock(tmp_path):
    """Speeds and the measured force are stamped with simulated time, a Float64 load is not stamped."""
    from argparse import Namespace

    from tire_dynamics.cli.identify import read
    from tire_dynamics.replay.bag_setup import bag_setup

    with BagWriter(tmp_path / "bag") as bag:
        states = bag.add_topic("/joint_states", messages.JOINT_STATE)
        load = bag.add_topic("/w/load_force", messages.FLOAT64)
        force = bag.add_topic("/hub", messages.WRENCH_STAMPED)
        for moment in range(BEGIN, BEGIN + 120 * STEP, STEP):
            bag.write(states, moment, moment, JointStateEncoder(["w"]).encode(simulated(moment), [60.0]))
            bag.write(load, moment + 1, moment, encode_float64(4000.0))
            bag.write(force, moment + 2, moment, WrenchEncoder("hub").encode(simulated(moment), 1.0, 2.0))
    options = Namespace(measured="hub", wheel=None, begin=0.0, end=None, quiet=True)
    reader = BagReader(tmp_path / "bag")
    with pytest.raises(InputError, match="look at their stamps"):
        read(reader, bag_setup(reader), options)
    reader = BagReader(tmp_path / "bag", "stamp")
    recording, _ = read(reader, bag_setup(reader), options)
    expected = np.arange(120) * STEP / 2 / SECOND
    # Times are taken from the beginning of the log, 1.7e9 s away: of 2e-7 s, as float64 has it.
    for time in (recording.speed_time, recording.load_time, recording.force_time):
        assert np.allclose(time, expected, rtol=0.0, atol=5e-7)
