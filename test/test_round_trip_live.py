"""As a user does it: start the node, drive, dump its parameters, start it with the dump, and drive the same again."""

from __future__ import annotations

import json
import math
import re
import sys
from pathlib import Path

import pytest
import yaml

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from test_live_log import (
    SECOND,
    Peer,
    assert_inputs_kept,
    assert_replayed,
    decoded,
    end,
    live_node,
    raw,
    replay,
    time_message,
)
from test_node import near, wrench
from test_node_parameters import dump
from test_rosout import INFO, Ear

from tire_dynamics import TireWheelUnit
from tire_dynamics.bag import BagReader
from tire_dynamics.bag.writer import offered_qos

WHEELS = {"left": "left_wheel_joint", "right": "right_wheel_joint"}
UNIT = TireWheelUnit.table_1(zeta_1=0.13, zeta_s=0.2)
GIVEN = {
    "wheels": list(WHEELS),
    "joint_names": list(WHEELS.values()),
    "ring_rate_hz": 20.0,
    "input_timeout_s": 30.0,  # however busy the machine is
    "tire": {"zeta_1": UNIT.zeta_1, "zeta_s": UNIT.zeta_s},
    "qos_overrides": {"/left/load": {"subscription": {"reliability": "reliable"}}},
}
INPUTS = ("/joint_states", *(f"/{wheel}/load" for wheel in WHEELS))
STEP = SECOND // 100
CHANGES = 100  # samples until speeds and loads stay as they are
SPEED, LOAD = 55.0, 4200.0


class User(Peer):
    """Drives the same course whenever it begins: the same values, at the same times after the start."""

    def __init__(self, domain: int) -> None:
        super().__init__(domain)
        self.peer = self.node
        self.sent: dict[str, list] = {}

    def result(self, future):
        self.until(future.done, "a parameter service's reply")
        return future.result()

    def begin(self) -> None:
        qos = QoSProfile(depth=100)
        self.sent = {topic: [] for topic in INPUTS}
        self.out = [self.publisher(JointState if topic == INPUTS[0] else WrenchStamped, topic, qos) for topic in INPUTS]
        self.start, self.number = self.node.get_clock().now().nanoseconds, 0
        self.timer = self.node.create_timer(STEP / SECOND, self._drive)

    def _drive(self) -> None:
        while (stamp := self.start + self.number * STEP) <= self.node.get_clock().now().nanoseconds:
            left = max(0.0, 1.0 - self.number / CHANGES)
            speeds = [SPEED - left * 50.0 - index * left for index in range(len(WHEELS))]
            joints = JointState(name=list(WHEELS.values()), velocity=speeds)
            joints.header.stamp = time_message(stamp)
            loads = [wrench(stamp, LOAD + 500.0 * left * math.sin(self.number + index)) for index in range(len(WHEELS))]
            for publisher, message in zip(self.out, (joints, *loads), strict=True):
                self.sent[publisher.topic_name].append(message)
                publisher.publish(message)
            self.number += 1

    def halt(self) -> None:
        self.node.destroy_timer(self.timer)
        for publisher in self.out:
            self.node.destroy_publisher(publisher)


@pytest.fixture
def user(ros_domain):
    one = User(ros_domain)
    try:
        yield one
    finally:
        one.close()


def drive(user: User, parameters: Path, logs: Path, dumped: Path) -> Path:
    """A run of the node with these parameters, which are dumped on the way; its log."""
    before = set(logs.glob("*"))
    command = [sys.executable, "-m", "tire_dynamics"]
    with live_node("--params-file", str(parameters), command=command) as node:
        ear = Ear(user)
        ear.until("^active", INFO)
        (log,) = set(logs.iterdir()) - before
        for wheel in WHEELS:
            user.hear(f"/{wheel}/axle_wrench")
        user.begin()
        user.until(lambda: all(user.heard.values()), "the first wrench of each wheel")
        dump(user, dumped, "/tire_dynamics")
        user.until(
            lambda: all(near(heard[-1].wrench.force, UNIT, SPEED, LOAD) for heard in user.heard.values()),
            "the steady wrench of this tire at this speed and load",
        )
        user.halt()
        said = end(node)
    lines = re.findall(r"\[tire_dynamics\]: (.*)", said)
    order = ["loading version", "starting as /tire_dynamics", "configured: left, right; listens to 7 topics"]
    order += [f"log opened: {log}", f"active: 2 wheels, 500 Hz, log in {log}"]
    assert [line[: len(wanted)] for line, wanted in zip(lines, order, strict=False)] == order, said
    assert f"log closed: {log}" in lines[-1]
    assert [line for line in ear.lines(INFO) if line in order] == order[1:]  # and on /rosout
    assert "[ERROR]" not in said
    assert_inputs_kept(log, user.sent)
    return log


def test_a_restart_with_the_dump_is_the_same_node(user, tmp_path):
    logs, given = tmp_path / "logs", tmp_path / "given.yaml"
    given.write_text(yaml.dump({"/**": {"ros__parameters": {**GIVEN, "log": {"directory": str(logs)}}}}))
    first = drive(user, given, logs, tmp_path / "first.yaml")
    second = drive(user, tmp_path / "first.yaml", logs, tmp_path / "second.yaml")
    assert (tmp_path / "second.yaml").read_text() == (tmp_path / "first.yaml").read_text()
    records = [decoded(log)["/tire_dynamics/log_record"][0] for log in (first, second)]
    ran = [json.loads(record.data)["parameters"] for record in records]
    assert ran[0] == ran[1]
    for log in (first, second):
        replay(log, tmp_path / f"{log.name}_again")
        assert_replayed(log, tmp_path / f"{log.name}_again", list(WHEELS))
        qos = {topic: offered_qos(text)[0]["reliability"] for topic, text in BagReader(log).qos.items()}
        assert qos["/left/load"] == "reliable" and qos["/right/load"] == "best_effort"
    replay(first, tmp_path / "with_dump", "--config", str(tmp_path / "first.yaml"))
    assert_replayed(first, tmp_path / "with_dump", list(WHEELS))
    one, other = raw(tmp_path / "with_dump"), raw(tmp_path / f"{first.name}_again")
    for messages in (one, other):  # says also whether the node or the replay judges the stability of wheels
        del messages["/tire_dynamics/log_record"]
    assert one == other
