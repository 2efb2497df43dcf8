"""Bags played live: what is published, when, and with which stamps."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_profile_sensor_data,
)
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String

from tire_dynamics.bag import BagWriter
from tire_dynamics.bag.writer import offered_qos
from tire_dynamics.cdr import messages
from tire_dynamics.cdr.messages import JointStateEncoder, encode_float64
from tire_dynamics.ros.play import publisher_qos

REPOSITORY = Path(__file__).parents[1]
PATIENCE = 180.0  # [s] after which what should have happened has not
SECOND = 10**9
BEGIN = 1_600_000_000 * SECOND
STEP = 20_000_000
LAG = 3_000_000  # from stamp to recording


class Listener:
    """Hears /speed and /joint_states, and when; own context, so that it is a process of its own to the player."""

    def __init__(self, domain: int) -> None:
        self.context = Context()
        self.context.init(args=[], domain_id=domain)
        self.node = Node("listener", context=self.context)
        self.executor = EventsExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.speeds: list[tuple[int, float]] = []
        self.joints: list[tuple[int, int, float]] = []  # receipt, stamp, velocity
        qos = QoSProfile(depth=1000)
        self.node.create_subscription(Float64, "/speed", self._speed, qos)
        self.node.create_subscription(JointState, "/joint_states", self._joint_states, qos)

    def _speed(self, message: Float64) -> None:
        self.speeds.append((time.time_ns(), message.data))

    def _joint_states(self, message: JointState) -> None:
        stamp = message.header.stamp.sec * SECOND + message.header.stamp.nanosec
        self.joints.append((time.time_ns(), stamp, message.velocity[0]))

    def until(self, condition, what: str) -> None:
        limit = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > limit:
                pytest.fail(f"waited {PATIENCE:g} s for {what}")
            self.executor.spin_once(timeout_sec=0.005)

    def close(self) -> None:
        self.node.destroy_node()
        self.executor.shutdown()
        self.context.try_shutdown()


@pytest.fixture
def listener(ros_domain):
    one = Listener(ros_domain)
    try:
        yield one
    finally:
        one.close()


def write_bag(folder: Path, count: int, *, stamp_lag: int = LAG, begin: int = BEGIN) -> Path:
    """``count`` speeds and joint states, numbered, one of each every 20 ms; the last stamp is zero: none."""
    encoder = JointStateEncoder(["wheel"])
    with BagWriter(folder) as writer:
        speed = writer.add_topic("/speed", messages.FLOAT64, "default")
        joints = writer.add_topic("/joint_states", messages.JOINT_STATE, "default")
        for number in range(count):
            now = begin + number * STEP
            writer.write(speed, now, now, encode_float64(float(number)))
            stamp = now - stamp_lag if number < count - 1 else 0
            writer.write(joints, now, now, encoder.encode(stamp, [float(number)]))
    return folder


@contextmanager
def player(*arguments):
    process = subprocess.Popen(
        [sys.executable, "-m", "tire_dynamics.cli.main", "play", *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def ended(listener: Listener, process: subprocess.Popen) -> str:
    """What the player said once it has ended well."""
    listener.until(lambda: process.poll() is not None, "the player's end")
    said = process.communicate()[1]
    assert process.returncode == 0, said
    assert "Traceback" not in said
    return said


def test_all_messages_at_the_recorded_pace_with_stamps_moved_to_the_present(listener, tmp_path):
    count = 60
    bag = write_bag(tmp_path / "bag", count)
    begun = time.time_ns()
    with player(bag, "--wait", "120") as process:
        said = ended(listener, process)
    listener.until(lambda: len(listener.joints) == count, "the last message")
    assert f"{2 * count} messages" in said
    assert [value for _, value in listener.speeds] == [value for _, _, value in listener.joints] == [*range(count)]
    # A stamp keeps its distance to the recording, which is now the moment of sending.
    for at, stamp, _ in listener.joints[:-1]:
        assert begun <= stamp + LAG <= at
    # Pace: nothing is sent before its time after the first; a busy machine may make it late, the first too, by less
    # than it makes the sum of all.
    sent = [stamp + LAG for _, stamp, _ in listener.joints[:-1]]
    assert all(b - a > 0 for a, b in zip(sent, sent[1:], strict=False))
    assert sent[-1] - begun >= (len(sent) - 1) * STEP
    assert listener.joints[-1][1] == 0  # no stamp stays no stamp
    stamps = [stamp for _, stamp, _ in listener.joints[:-1]]
    assert all(after > before for before, after in zip(stamps, stamps[1:], strict=False))


def test_kept_stamps_and_another_rate(listener, tmp_path):
    count = 1000  # 20 s, at forty times the pace half a second
    bag = write_bag(tmp_path / "bag", count)
    with player(bag, "--wait", "120", "--rate", "40", "--keep-stamps") as process:
        ended(listener, process)
    listener.until(lambda: len(listener.joints) == count, "the last message")
    assert [stamp for _, stamp, _ in listener.joints[:-1]] == [BEGIN + i * STEP - LAG for i in range(count - 1)]
    assert listener.speeds[-1][0] - listener.speeds[0][0] < count * STEP  # faster than it was recorded


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_loop_goes_on_until_a_signal(listener, tmp_path, number):
    count = 5
    bag = write_bag(tmp_path / "bag", count)
    with player(bag, "--wait", "120", "--loop") as process:
        listener.until(lambda: len(listener.speeds) > 3 * count, "three turns")
        process.send_signal(number)
        ended(listener, process)
    values = [int(value) for _, value in listener.speeds]
    assert values[: 3 * count] == [*range(count)] * 3


def test_a_pause_in_the_bag_ends_at_a_signal(listener, tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        speed = writer.add_topic("/speed", messages.FLOAT64, "default")
        for now in (BEGIN, BEGIN + 3600 * SECOND):
            writer.write(speed, now, now, encode_float64(1.0))
    with player(tmp_path / "bag", "--wait", "120") as process:
        listener.until(lambda: listener.speeds, "the first message")
        process.send_signal(signal.SIGINT)
        ended(listener, process)


@pytest.mark.parametrize(("options", "gap"), [((), 3 * 31_557_600), (("--max-gap", "5"), 7300)])
def test_a_long_gap_is_skipped_and_said(listener, tmp_path, options, gap):
    """As of a recording whose clock was set in between: all of it is played, without years of waiting."""
    with BagWriter(tmp_path / "bag") as writer:
        speed = writer.add_topic("/speed", messages.FLOAT64, "default")
        for number, now in enumerate((BEGIN, BEGIN + STEP, BEGIN + gap * SECOND, BEGIN + gap * SECOND + STEP)):
            writer.write(speed, now, now, encode_float64(float(number)))
    with player(tmp_path / "bag", "--wait", "10", *options) as process:
        said = ended(listener, process)
    assert f"a gap of {'3.0 years' if gap > 7300 else '2.0 hours'} is skipped" in said and "4 messages" in said
    listener.until(lambda: [value for _, value in listener.speeds] == [0.0, 1.0, 2.0, 3.0], "the last message")


def test_it_begins_without_subscribers_when_the_wait_is_over(listener, tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for topic in ("/speed", "/nobody"):
            writer.write(writer.add_topic(topic, messages.FLOAT64), BEGIN, BEGIN, encode_float64(1.0))
    with player(tmp_path / "bag", "--wait", "0.5") as process:
        assert "2 messages" in ended(listener, process)


def mcap_with(path: Path, topics: dict[str, tuple[str, bytes]]) -> Path:
    """A file as another recorder could have written it: any topic, type name and content."""
    from mcap.writer import Writer

    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start("ros2", "test")
        for topic, (msgtype, data) in topics.items():
            schema = writer.register_schema(msgtype, "ros2msg", b"float64 data")
            channel = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channel, BEGIN, data, BEGIN)
        writer.finish()
    return path


@pytest.mark.parametrize(
    "msgtype",
    ["no_such_msgs/msg/Thing", "std_msgs/msg/NoSuchThing", "std_msgs/Float64", "os/msg/path", "", "a/b/c/d", "/msg/",
     "example_interfaces/srv/AddTwoInts_Event", "..x/msg/Y"],
)  # fmt: skip
def test_types_that_are_not_known_are_said_and_left_out(listener, tmp_path, msgtype):
    known = ("std_msgs/msg/Float64", encode_float64(7.0))
    bag = mcap_with(tmp_path / "bag.mcap", {"/thing": (msgtype, b"\0\1\0\0xxxx"), "/speed": known})
    with player(bag, "--wait", "120") as process:
        said = ended(listener, process)
    assert "/thing" in said and "1 messages" in said
    listener.until(lambda: [value for _, value in listener.speeds] == [7.0], "the message of the known type")


def test_nothing_to_play_is_an_error(ros_domain, tmp_path):
    bag = mcap_with(tmp_path / "bag.mcap", {"/thing": ("no_such_msgs/msg/Thing", b"\0\1\0\0")})
    with player(bag) as process:
        _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2, said
    assert said.splitlines()[-1].startswith("tire-dynamics: ") and "Traceback" not in said


@pytest.mark.parametrize(
    ("topic", "msgtype", "data"),
    [
        ("not a topic", "std_msgs/msg/Float64", encode_float64(1.0)),
        ("/joint_states", "sensor_msgs/msg/JointState", b"\0\1\0\0"),  # ends before its stamp
        ("/joint_states", "sensor_msgs/msg/JointState", b"\0\1\0\0\0\1"),
        ("/empty", "std_msgs/msg/Float64", b""),
    ],
)
def test_what_cannot_be_published_is_no_traceback(ros_domain, tmp_path, topic, msgtype, data):
    bag = mcap_with(tmp_path / "bag.mcap", {topic: (msgtype, data)})
    with player(bag) as process:
        _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode in (0, 2), said
    assert "Traceback" not in said


def test_stamps_far_from_the_recorded_times_are_no_traceback(listener, tmp_path):
    """Recorded in simulated time near 0, stamped with real time: moved to the present it is beyond ROS's range."""
    bag = write_bag(tmp_path / "bag", 5, begin=0, stamp_lag=-BEGIN)
    with player(bag, "--wait", "120") as process:
        ended(listener, process)
    assert len(listener.speeds) == 5


def test_a_bag_without_messages_does_not_loop_for_nothing(ros_domain, tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/speed", messages.FLOAT64)
    with player(tmp_path / "bag", "--loop") as process:
        _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2, said


# --- quality of service ---


FOREVER = QosTime(9223372036, 854775807)


def recorded(
    reliability=QosReliability.RELIABLE,
    durability=QosDurability.VOLATILE,
    deadline=FOREVER,
    liveliness=QosLiveliness.AUTOMATIC,
    lease=FOREVER,
    history=QosHistory.KEEP_LAST,
    depth=10,
) -> Qos:
    return Qos(history, depth, reliability, durability, deadline, FOREVER, liveliness, lease, False)


RECORDED = {
    "/default": [recorded()],
    "/best_effort": [recorded(QosReliability.BEST_EFFORT)],
    "/latched": [recorded(durability=QosDurability.TRANSIENT_LOCAL, depth=1)],
    "/watched": [recorded(deadline=QosTime(2, 5), liveliness=QosLiveliness.MANUAL_BY_TOPIC, lease=QosTime(3, 0))],
    "/of_two": [recorded(QosReliability.BEST_EFFORT), recorded(durability=QosDurability.TRANSIENT_LOCAL)],
    "/unknown": [recorded(QosReliability.UNKNOWN, QosDurability.UNKNOWN, QosTime(0, 0))],
    "/nothing": [],
}


def test_each_topic_is_offered_as_it_was_recorded(listener, tmp_path):
    """A bag of the rosbags library's, and the player's offers as DDS tells them to all who are there."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with RosbagsWriter(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, offered in RECORDED.items():
            connection = writer.add_connection(topic, messages.FLOAT64, typestore=store, offered_qos_profiles=offered)
            writer.write(connection, BEGIN, encode_float64(1.0))
            writer.write(connection, BEGIN + 3600 * SECOND, encode_float64(1.0))
    found = {}
    with player(tmp_path / "bag") as process:
        for topic in RECORDED:
            listener.until(lambda topic=topic: listener.node.get_publishers_info_by_topic(topic), topic)
            (found[topic],) = (info.qos_profile for info in listener.node.get_publishers_info_by_topic(topic))
        process.send_signal(signal.SIGINT)
        ended(listener, process)
    best_effort = {topic for topic, qos in found.items() if qos.reliability == ReliabilityPolicy.BEST_EFFORT}
    latched = {topic for topic, qos in found.items() if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL}
    manual = {topic for topic, qos in found.items() if qos.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC}
    assert (best_effort, latched, manual) == ({"/best_effort"}, {"/latched", "/of_two"}, {"/watched"})
    assert found["/watched"].deadline.nanoseconds == 2 * SECOND + 5
    assert found["/watched"].liveliness_lease_duration.nanoseconds == 3 * SECOND
    forever = found["/nothing"].deadline
    assert all(qos.deadline == forever for topic, qos in found.items() if topic != "/watched")


def test_who_comes_later_hears_what_was_latched(listener, tmp_path):
    """Of two messages the last, since the recorded depth is 1; of a topic that was not latched none."""
    with BagWriter(tmp_path / "bag") as writer:
        note = writer.add_topic("/note", messages.STRING, "latched")
        plain = writer.add_topic("/plain", messages.STRING, "default")
        speed = writer.add_topic("/speed", messages.FLOAT64, "default")
        for text in ("first", "last"):
            writer.write(note, BEGIN, BEGIN, messages.encode_string(text))
            writer.write(plain, BEGIN, BEGIN, messages.encode_string(text))
        for number in range(3000):
            now = BEGIN + (number + 1) * STEP
            writer.write(speed, now, now, encode_float64(1.0))
    heard = []
    with player(tmp_path / "bag") as process:
        listener.until(lambda: listener.speeds, "what comes behind them")
        for topic, durability in (("/plain", DurabilityPolicy.VOLATILE), ("/note", DurabilityPolicy.TRANSIENT_LOCAL)):
            qos = QoSProfile(depth=10, durability=durability)
            listener.node.create_subscription(String, topic, lambda m, t=topic: heard.append((t, m.data)), qos)
        listener.until(lambda: heard, "the latched message")
        count = len(listener.speeds)
        listener.until(lambda: len(listener.speeds) > count + 10, "what else might come")
        process.send_signal(signal.SIGINT)
        ended(listener, process)
    assert heard == [("/note", "last")]


def test_who_asks_for_more_than_was_recorded_is_named(listener, tmp_path):
    """Best effort is not given to whoever wants every message; the player says so, as every ROS node does."""
    with BagWriter(tmp_path / "bag") as writer:
        speed = writer.add_topic("/speed", messages.FLOAT64, "sensor_data")
        for number in range(3000):
            writer.write(speed, BEGIN + number * STEP, BEGIN + number * STEP, encode_float64(1.0))
    heard = []
    with player(tmp_path / "bag") as process:
        listener.node.create_subscription(Float64, "/speed", heard.append, qos_profile_sensor_data)
        listener.until(lambda: len(heard) > 50, "the messages")
        process.send_signal(signal.SIGINT)
        said = ended(listener, process)
    assert not listener.speeds
    assert "/speed" in said and "incompatible QoS" in said and "RELIABILITY" in said


def profile(**changes: str) -> str:
    """As a recorder before Jazzy wrote it, by numbers: reliable, transient local, history and depth not known."""
    fields = {"history": "3", "depth": "0", "reliability": "1", "durability": "1"}
    fields |= dict.fromkeys(("deadline", "lifespan"), "{sec: 2147483647, nsec: 4294967295}")
    fields |= {"liveliness": "1", "liveliness_lease_duration": "{sec: 2147483647, nsec: 4294967295}"}
    fields |= {"avoid_ros_namespace_conventions": "false", **changes}
    return "- " + "\n  ".join(f"{name}: {value}" for name, value in fields.items()) + "\n"


def test_depth_is_what_all_publishers_kept_for_those_who_come_later():
    """Four that latch one message each, as static transforms have it, are one publisher that latches four."""

    def depth(*texts: str) -> int:
        return publisher_qos(offered_qos("".join(texts))).depth

    one = profile(history="1", depth="1")
    assert depth(one) == 1 and depth(one, one, one, one) == 4
    assert depth(one, profile(history="1", depth="7", durability="2")) == 1  # that one kept nothing
    assert depth(profile()) == 10  # not told: ROS's default
    assert depth(profile(history="2", depth="0")) == 10_000  # all: within bounds
    assert depth(profile(history="1", depth="4000000000")) == 10_000


@pytest.mark.parametrize("sec", ["2147483647", "9223372036", "18446744073709551615", "-1"])
def test_times_without_end_are_those_of_every_recorder(sec):
    time = f"{{sec: {sec}, nsec: 4294967295}}"
    qos = publisher_qos(offered_qos(profile(deadline=time, lifespan=time, liveliness_lease_duration=time)))
    assert qos.deadline == qos.lifespan == qos.liveliness_lease_duration == publisher_qos([]).deadline


@pytest.mark.parametrize("text", ["", "-", "no list", "- {history: 9}", "[" * 50, profile(depth="x")])
def test_qos_that_cannot_be_read_is_the_default(text):
    qos = publisher_qos(offered_qos(text))
    assert (qos.reliability, qos.durability) == (ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)


# -- ROS arguments --


def test_a_namespace_moves_the_topics_and_a_remapping_one_of_them(listener, tmp_path):
    """For a second car, beside which the first one hears nothing."""
    heard: dict[str, list] = {"/car/speed": [], "/elsewhere": [], "/tf_static": []}
    for name, kind in (("/car/speed", Float64), ("/elsewhere", JointState), ("/tf_static", String)):
        listener.node.create_subscription(kind, name, heard[name].append, QoSProfile(depth=100))
    bag = write_bag(tmp_path / "bag", 20)
    with BagWriter(tmp_path / "shared") as writer:  # /tf_static is everybody's, whatever its type is here
        topic = writer.add_topic("/tf_static", messages.STRING, "latched")
        writer.write(topic, BEGIN, BEGIN, messages.encode_string("x"))
    arguments = ("--ros-args", "-r", "__ns:=/car", "-r", "__node:=second", "-r", "joint_states:=/elsewhere")
    with player(bag, "--wait", "120", *arguments) as process:
        ended(listener, process)
    with player(tmp_path / "shared", "--wait", "120", *arguments) as process:
        ended(listener, process)
    listener.until(lambda: len(heard["/car/speed"]) == len(heard["/elsewhere"]) == 20, "all of both")
    listener.until(lambda: heard["/tf_static"], "what is not moved")
    assert listener.speeds == listener.joints == []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--ros-args", "-r", "no rule"], "no rule"),
        (["--ros-args", "--rate", "2"], "--rate"),
        (["--ros-args", "-r", "a:=b", "2"], "2"),
        (["--ros-args", "--params-file", "none.yaml"], "none.yaml"),
    ],
)
def test_ros_arguments_that_cannot_be_used_are_a_line(ros_domain, tmp_path, arguments, said):
    with player(write_bag(tmp_path / "bag", 2), *arguments) as process:
        error = process.communicate(timeout=PATIENCE)[1]
    assert process.returncode == 2 and said in error and "Traceback" not in error
    assert error.strip().splitlines()[-1].startswith("tire-dynamics: ")
