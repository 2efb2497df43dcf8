"""What the node says on /rosout and in the diagnostics of its inputs, clock, ticks and logs."""

from __future__ import annotations

import re
import signal
import time

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from test_lifecycle import ACTIVATE, CONFIGURE, change
from test_live_log import end, live_node
from test_node import SECOND, Bench, wrench

from tire_dynamics.bag import BagReader
from tire_dynamics.ros import diagnostics

LATCHED = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
INFO, WARN, ERROR = 20, 30, 40  # of rcl_interfaces/Log


class Ear:
    """Hears the node's lines, also those from before."""

    def __init__(self, one: Bench, node: str = "tire_dynamics") -> None:
        self.one, self.heard = one, []
        wanted = node.lstrip("/").replace("/", ".")

        def take(line: Log) -> None:
            if line.name == wanted:
                self.heard.append(line)

        one.peer.create_subscription(Log, "/rosout", take, LATCHED)

    def lines(self, level: int | None = None) -> list[str]:
        return [line.msg for line in self.heard if level is None or ord_of(line.level) == level]

    def until(self, pattern: str, level: int, count: int = 1) -> str:
        """Wait for a line of this form; the newest such."""

        def found() -> list[str]:
            return [line for line in self.lines(level) if re.search(pattern, line)]

        self.one.until(lambda: len(found()) >= count, f"{count} of {pattern!r}; there is {self.lines()}")
        return found()[-1]


def ord_of(level) -> int:
    return level if isinstance(level, int) else ord(level)


def status_of(arrays: list, name: str) -> DiagnosticStatus:
    for array in reversed(arrays):
        for status in array.status:
            if status.name.endswith(f": {name}"):
                return status
    return DiagnosticStatus()


# -- in order --


def test_a_start_and_its_first_inputs_are_said_in_order(bench, tmp_path):
    one = bench("-p", "wheels:=[left, right]", "-p", f"log.directory:={tmp_path}")
    ear = Ear(one)
    ear.until("^active", INFO)
    one.feed("left", speed=50.0, load=4000.0)
    ear.until("^left: first", INFO)
    one.feed("right", speed=51.0)
    ear.until("^right: first speed", INFO)
    one.feed("right", speed=51.0, load=3000.0)
    ear.until("^right: first load", INFO)
    (log,) = tmp_path.glob("tire_dynamics_*")
    lines = ear.lines(INFO)
    assert lines[:4] == [
        "starting as /tire_dynamics",
        "configured: left, right; listens to 7 topics",
        f"log opened: {log}",
        f"active: 2 wheels, 500 Hz, log in {log}",
    ]
    firsts = [line for line in lines[4:] if "first" in line]
    assert firsts[-2:] == ["right: first speed 51 rad/s", "right: first load 3000 N"]
    # of left, what came first may have been seen alone
    assert "; ".join(firsts[:-2]).replace("left: first ", "").replace(" and ", "; ") in (
        "speed 50 rad/s; load 4000 N",
        "load 4000 N; speed 50 rad/s",
    )


def test_inputs_that_are_lost_and_come_back_are_said_once_for_all_wheels_and_not_too_often(bench):
    one = bench("-p", "wheels:=[left, right]", "-p", "input_timeout_s:=1.0")
    ear = Ear(one)
    for wheel in ("left", "right"):
        one.feed(wheel, speed=50.0, load=4000.0)
    for wheel in ("left", "right"):
        ear.until(f"^{wheel}: first", INFO)
    one.until(lambda: all(inputs.running for inputs in one.node._pipeline.vehicle.inputs), "both in motion")
    for wheel in ("left", "right"):
        one.feed(wheel, speed=50.0)
    lost = ear.until("^no output of", WARN)
    assert lost.endswith("load older than input_timeout_s, 1 s")
    for wheel in ("left", "right"):
        one.feed(wheel, speed=50.0, load=4000.0)
    ear.until("are back after", INFO)

    def stops() -> list[int]:
        return [inputs.stops for inputs in one.node._pipeline.vehicle.inputs]

    for _ in range(2):  # again, within the ten seconds in which nothing more is said of it
        before = stops()
        for wheel in ("left", "right"):
            one.feed(wheel, speed=50.0)
        one.until(lambda before=before: min(stops()) > min(before), "another stop")
        for wheel in ("left", "right"):
            one.feed(wheel, speed=50.0, load=4000.0)
        one.until(lambda: all(inputs.running for inputs in one.node._pipeline.vehicle.inputs), "motion again")
    said = sum(line.startswith("no output of") for line in ear.lines(WARN))
    assert said <= 1 + max(stops()) // 2, "more lines than stops are worth"


# -- what does not fit --


def test_joints_that_do_not_fit_are_named(bench):
    one = bench("-p", "wheels:=[left, right]", "-p", "joint_names:=[left_joint, right_joint]")
    ear, arrays = Ear(one), one.messages(DiagnosticArray, "/diagnostics")
    joints = one.publisher(JointState, "/joint_states")
    names = iter([["fl_wheel", "left_joint"], ["steering"]] * 10**6)

    def send() -> None:
        some = next(names)
        joints.publish(JointState(name=some, velocity=[10.0] * len(some)))

    one.peer.create_timer(0.01, send)
    line = ear.until("^joint_states has joints", WARN)
    heard, missing = re.match(r"joint_states has joints (.*); none is (\w+); the parameter joint_names", line).groups()
    assert set(heard.split(", ")) <= {"fl_wheel", "left_joint", "steering"} and missing == "right_joint"
    one.until(lambda: "none is right_joint" in status_of(arrays, "right").message, "it in the diagnostics")
    assert status_of(arrays, "right").level == DiagnosticStatus.ERROR
    assert "none is" not in status_of(arrays, "left").message


def test_inputs_that_never_come_are_said_with_their_topics(bench):
    one = bench("-r", "__ns:=/car", "-r", "wheel/load:=/hub/force")
    line = Ear(one, "/car/tire_dynamics").until("^no speed yet", WARN)
    assert line == (
        "no speed yet of wheel: nothing that can be used on /car/joint_states, /car/wheel/wheel_speed; "
        "no load yet of wheel: nothing that can be used on /hub/force, /car/wheel/load_force"
    )


def test_a_simulated_clock_that_does_not_come_is_said(bench):
    one = bench("-p", "use_sim_time:=true")
    ear, arrays = Ear(one), one.messages(DiagnosticArray, "/diagnostics")
    ear.until("^use_sim_time is set and no /clock comes", WARN)
    one.until(lambda: "no /clock comes" in status_of(arrays, "node").message, "it in the diagnostics")
    assert status_of(arrays, "node").level == DiagnosticStatus.ERROR
    clock = one.publisher(Clock, "/clock")
    ticks = iter(range(1, 10**9))

    def tick() -> None:
        clock.publish(Clock(clock=wrench(next(ticks) * SECOND // 100, 0.0).header.stamp))

    one.peer.create_timer(0.01, tick)
    one.until(lambda: "no /clock" not in status_of(arrays, "node").message, "its end")
    # /clock makes a hundred ticks of the five hundred: no fault of the machine's, but said
    one.until(lambda: "/clock comes less often than rate_hz, 500 Hz" in status_of(arrays, "node").message, "that")
    assert status_of(arrays, "node").level == DiagnosticStatus.WARN


def test_ticks_that_are_missed_are_said_and_their_share_makes_the_level(bench):
    """The executor is held for longer than half of each second: no machine keeps the rate then."""
    one = bench()
    ear, arrays = Ear(one), one.messages(DiagnosticArray, "/diagnostics")
    one.node.create_timer(0.1, lambda: time.sleep(0.06))
    line = ear.until("of the ticks missed", WARN)
    assert "this machine is too slow or too busy for 500 Hz" in line
    one.until(lambda: "of the ticks missed" in status_of(arrays, "node").message, "it in the diagnostics")
    one.until(lambda: status_of(arrays, "node").level == DiagnosticStatus.ERROR, "an error")


@pytest.mark.parametrize(
    ("missed", "ticks", "level"),
    [
        (0, 500, b"\0"), (4, 496, b"\0"), (5, 495, b"\1"), (49, 451, b"\1"), (50, 450, b"\2"), (150, 350, b"\2"),
        (0, 0, b"\0"),
    ],
)  # fmt: skip
def test_the_share_of_missed_ticks_makes_the_level(missed, ticks, level):
    found, text = diagnostics.of_ticks(missed, ticks, 500.0, False)
    assert found == level and bool(text) == (level != b"\0")
    if text:
        assert text.startswith(f"{missed / 5.0:.0f} % of the ticks missed")


@pytest.mark.parametrize("how", ["late", "in the future", "not finite"])
def test_samples_that_are_late_or_refused_are_a_warning(bench, how):
    one = bench()
    arrays = one.messages(DiagnosticArray, "/diagnostics")
    one.feed(speed=50.0, load=4000.0)
    loads = one.publisher(type(wrench(0, 0.0)), "/wheel/load")

    def send() -> None:
        distance = {"late": -SECOND // 20, "in the future": 10 * SECOND, "not finite": 0}[how]
        loads.publish(wrench(one.now() + distance, float("nan") if how == "not finite" else 4000.0))

    if how == "late":
        one.feed(speed=50.0)  # two samples of three would be out of order, and not late
    one.peer.create_timer(0.005, send)
    one.until(lambda: f"% of its samples {how}" in status_of(arrays, "wheel").message, "it in the diagnostics")
    assert status_of(arrays, "wheel").level >= DiagnosticStatus.WARN


# -- names --


def test_two_cars_have_statuses_of_their_own(bench):
    cars = [bench("-r", f"__ns:=/{name}") for name in ("front_car", "rear_car")]
    arrays = cars[0].messages(DiagnosticArray, "/diagnostics")
    wanted = {f"{name}/tire_dynamics: {what}" for name in ("front_car", "rear_car") for what in ("node", "wheel")}

    def seen() -> dict[str, str]:
        return {status.name: status.hardware_id for array in arrays for status in array.status}

    cars[0].until(lambda: seen().keys() >= wanted, "both in the diagnostics")
    assert seen().keys() == wanted
    assert set(seen().values()) == {"/front_car/tire_dynamics", "/rear_car/tire_dynamics"}


# -- logs --


def test_logs_are_said_when_they_open_and_close(bench, tmp_path):
    one = bench()
    ear = Ear(one)
    assert one.set("log.directory", str(tmp_path / "logs")).successful
    reply = one.set_logging(True)
    (folder,) = (tmp_path / "logs").iterdir()  # it is there when the answer comes
    assert reply.success and reply.message == f"logging to {folder}"
    assert ear.until("^log opened", INFO) == f"log opened: {folder}"
    assert one.set_logging(True).message == f"logging to {folder} already"
    assert one.set_logging(False).success
    assert ear.until("^log closed", INFO).startswith(f"log closed: {folder}, ")
    assert BagReader(folder).damage == ""


@pytest.mark.parametrize("kind", ["a file", "a name too long", "no such file system"])
def test_set_logging_answers_false_where_no_log_can_be(bench, tmp_path, kind):
    (tmp_path / "file").write_text("")
    directory = {
        "a file": tmp_path / "file",
        "a name too long": tmp_path / ("a" * 300),
        "no such file system": "/proc/nowhere",
    }[kind]
    one = bench()
    ear = Ear(one)
    assert one.set("log.directory", str(directory)).successful
    for _ in range(2):
        reply = one.set_logging(True)
        assert not reply.success and str(directory) in reply.message
    ear.until("^log failed: ", ERROR, 2)
    arrays = one.messages(DiagnosticArray, "/diagnostics")
    one.until(lambda: arrays, "diagnostics")
    assert {item.key: item.value for item in arrays[-1].status[0].values}["log"] == "off"  # and none is tried again
    assert one.set("log.directory", str(tmp_path / "logs")).successful
    assert one.set_logging(True).success


def test_an_empty_directory_ends_the_retries(bench, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    one = bench("-p", f"log.directory:={tmp_path / 'logs'}")
    one.feed(speed=50.0, load=4000.0)
    ear, arrays = Ear(one), one.messages(DiagnosticArray, "/diagnostics")
    folder = one.node._journal.log.folder
    for path in folder.iterdir():
        path.unlink()  # the log looks whether its file is there
    ear.until("^log failed: .*removed", ERROR)
    assert one.set("log.directory", "").successful
    ear.until("^log.directory is empty: no other log is tried", INFO)
    one.until(
        lambda: {item.key: item.value for item in status_of(arrays, "node").values}.get("log") == "off", "no log"
    )
    assert "log" not in status_of(arrays, "node").message
    assert {path.name for path in tmp_path.iterdir()} <= {"logs", "ros_log"}, "a log where none was asked for"


@pytest.mark.parametrize("state", ["while it opens", "inactive"])
def test_set_logging_that_cannot_be_answered_any_more_is(bench, tmp_path, state):
    one = bench("-p", "autostart:=false", "-p", f"log.directory:={tmp_path}")
    assert change(one, CONFIGURE)
    if state == "inactive":
        reply = one.set_logging(True)
        assert not reply.success and reply.message == "the node is not active"
        return
    assert change(one, ACTIVATE) and one.set_logging(False).success
    outcome = one.node._journal.switch(True)
    one.node._journal.finish()  # before the disk has answered, or after
    done, message = one.until(outcome, "an outcome")
    assert ("before it was open" in message and not done) or (done and str(tmp_path) in message)


# -- the end --


def test_sighup_closes_the_log_whole(ros_domain, tmp_path):
    with live_node("-p", f"log.directory:={tmp_path}") as node:
        rig = Bench(ros_domain, "-r", "__node:=other")
        try:
            speeds, loads = rig.publisher(Float64, "/wheel/wheel_speed"), rig.publisher(Float64, "/wheel/load_force")

            def send() -> None:
                speeds.publish(Float64(data=50.0))
                loads.publish(Float64(data=4000.0))

            rig.peer.create_timer(0.01, send)
            rig.until(lambda: any(path.stat().st_size > 100_000 for path in tmp_path.glob("*/*.mcap")), "a log")
        finally:
            rig.close()
        said = end(node, signal.SIGHUP)
    assert "log closed" in said
    (log,) = tmp_path.glob("tire_dynamics_*")
    reader = BagReader(log)
    assert reader.damage == "" and (log / "metadata.yaml").is_file()
    assert reader.message_count > 500
