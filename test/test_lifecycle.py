"""The node under a lifecycle manager, and what it publishes beside its outputs: markers and TF."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.node import NodeNameNonExistentError
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Float64
from std_srvs.srv import Trigger
from test_node import PATIENCE, Bench, wrench
from visualization_msgs.msg import MarkerArray

from tire_dynamics.bag import BagReader
from tire_dynamics.cdr import messages
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay.replay import replay

MANAGED = ("-p", "autostart:=false")
CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE
DEACTIVATE, CLEAN_UP = Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP


def change(one: Bench, transition: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=transition))
    return one.call(ChangeState, "/tire_dynamics/change_state", request).success


def state(one: Bench) -> int:
    return one.call(GetState, "/tire_dynamics/get_state").current_state.id


def topics(one: Bench) -> set[str]:
    """What the node publishes of its own, as the peer sees it."""
    found = []

    def discovered() -> bool:
        with suppress(NodeNameNonExistentError):  # its name may be known before it is itself
            found.extend(one.peer.get_publisher_names_and_types_by_node("tire_dynamics", "/"))
            return True
        return False

    one.until(discovered, "the node's discovery")
    return {name for name, _ in found if name.startswith("/wheel/")}


def logs(folder: Path) -> list[Path]:
    return list(folder.glob("tire_dynamics_*"))


def says(received: list, text: str) -> bool:
    return bool(received) and text in received[-1].status[0].message


# -- the states --


def test_it_starts_itself_unless_it_is_told_to_wait(bench):
    one = bench()
    assert state(one) == State.PRIMARY_STATE_ACTIVE
    assert change(one, DEACTIVATE) and state(one) == State.PRIMARY_STATE_INACTIVE
    assert change(one, CLEAN_UP) and state(one) == State.PRIMARY_STATE_UNCONFIGURED
    assert change(one, CONFIGURE) and change(one, ACTIVATE)  # a manager may take over; what was fixed stays so
    assert not one.set("rate_hz", 250.0).successful
    received = one.messages(WrenchStamped, "/wheel/axle_wrench")
    one.feed(speed=100.0, load=4000.0)
    one.until(lambda: len(received) > 20, "wrenches")


def test_a_manager_takes_it_through_its_states(bench, tmp_path):
    one = bench(*MANAGED, "-p", f"log.directory:={tmp_path}")
    diagnostics = one.messages(DiagnosticArray, "/diagnostics")
    assert state(one) == State.PRIMARY_STATE_UNCONFIGURED and topics(one) == set()
    one.until(lambda: says(diagnostics, "unconfigured"), "the state in the diagnostics")

    assert change(one, CONFIGURE)
    own = 4 if find_spec("tire_dynamics_msgs") is None else 5  # with `state`, where its package is installed
    one.until(lambda: len(topics(one)) == own, "the wheel's topics")
    received = one.messages(WrenchStamped, "/wheel/axle_wrench")
    one.feed(speed=100.0, load=4000.0)
    one.until(lambda: says(diagnostics, "inactive"), "the state in the diagnostics")
    assert received == [] and logs(tmp_path) == []
    reply = one.call(Trigger, "/wheel/floquet_stability")
    assert not reply.success and "not active" in reply.message
    reply = one.set_logging(True)
    assert not reply.success and "not active" in reply.message

    assert change(one, ACTIVATE)
    one.until(lambda: len(received) > 50, "wrenches")
    (log,) = logs(tmp_path)
    assert change(one, DEACTIVATE)
    count = BagReader(log).message_count  # the log is whole as soon as the transition is done
    assert BagReader(log).damage == ""
    one.until(lambda: says(diagnostics, "inactive"), "the state in the diagnostics")
    before = len(received)
    diagnostics.clear()
    one.until(lambda: len(diagnostics) > 1, "some time")
    assert len(received) == before, "an output while inactive"
    summary = replay(log, tmp_path / "again")
    assert summary.written["wheel/axle_wrench"] >= before
    assert BagReader(log).message_count == count

    assert change(one, ACTIVATE)  # again, with a log of its own
    one.until(lambda: len(received) > before + 50, "wrenches again")
    assert change(one, DEACTIVATE) and change(one, CLEAN_UP)
    assert len(logs(tmp_path)) == 2
    one.until(lambda: topics(one) == set(), "the topics to go")
    assert state(one) == State.PRIMARY_STATE_UNCONFIGURED


def test_parameters_are_checked_when_it_is_configured_and_can_be_mended(bench):
    one = bench(*MANAGED, "-p", "rate_hz:=-1.0", "-p", "wheels:=[left, right]")
    diagnostics = one.messages(DiagnosticArray, "/diagnostics")
    assert not change(one, CONFIGURE)
    assert state(one) == State.PRIMARY_STATE_UNCONFIGURED
    one.until(lambda: says(diagnostics, "rate_hz is -1.0; it must be at least 1"), "the reason in the diagnostics")
    assert diagnostics[-1].status[0].level == DiagnosticStatus.ERROR
    assert not one.set("rate_hz", "fast").successful and not one.set("rate_hz", -2.0).successful
    assert not change(one, CONFIGURE)
    assert one.set("rate_hz", 250.0).successful
    assert change(one, CONFIGURE) and change(one, ACTIVATE)
    assert one.get("rate_hz") == 250.0 and one.get("joint_names") == ["left", "right"]

    result = one.set("rate_hz", 500.0)
    assert not result.successful and result.reason == "rate_hz may change only while the node is unconfigured"
    assert one.set("tire.zeta_s", 0.2).successful
    assert not one.set("tire.zeta_s", 2.0).successful
    assert change(one, DEACTIVATE) and change(one, CLEAN_UP)
    assert one.set("rate_hz", 500.0).successful
    assert change(one, CONFIGURE) and one.get("rate_hz") == 500.0 and one.get("tire.zeta_s") == 0.2


def test_an_unknown_parameter_is_refused_when_it_is_configured(bench):
    one = bench(*MANAGED, "-p", "rate_hertz:=100.0")
    assert not change(one, CONFIGURE)
    with pytest.raises(InputError, match="autostart is 1; it must be true or false"):
        bench("-p", "autostart:=1")


def test_a_log_that_cannot_be_written_stops_the_activation(bench, tmp_path):
    (tmp_path / "file").write_text("")
    one = bench(*MANAGED, "-p", f"log.directory:={tmp_path / 'file'}")
    assert change(one, CONFIGURE) and not change(one, ACTIVATE)
    assert state(one) == State.PRIMARY_STATE_INACTIVE
    assert one.set("log.directory", "").successful
    assert change(one, ACTIVATE)


def test_it_begins_from_equilibrium_each_time(bench):
    """What it had before it was deactivated is gone: the first output is the load of the moment, at rest."""
    one = bench(*MANAGED, "-p", "tire.sidewall_damping:=reaction", "-p", "input_timeout_s:=10.0")
    assert change(one, CONFIGURE) and change(one, ACTIVATE)
    received = one.messages(WrenchStamped, "/wheel/axle_wrench")
    one.feed(speed=100.0, load=8000.0)
    one.until(lambda: len(received) > 20, "wrenches")
    one.feed()
    assert change(one, DEACTIVATE)
    received.clear()
    assert change(one, ACTIVATE)
    one.feed(speed=100.0, load=2000.0)
    one.until(lambda: received, "a wrench")
    # In equilibrium `reaction` gives the axle the whole load (docs/model.md); from 8000 N it would be far from it.
    assert received[0].wrench.force.z == pytest.approx(2000.0, rel=1e-6)


def test_a_process_that_waits_for_its_manager_ends_at_once(ros_domain, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    command = [sys.executable, "-m", "tire_dynamics.cli.main", "node", "--ros-args", *MANAGED]
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    other = Bench(ros_domain, *MANAGED, "-r", "__node:=manager")
    try:
        other.until(lambda: "tire_dynamics" in other.peer.get_node_names(), "the process")
        assert change(other, CONFIGURE) and change(other, ACTIVATE)
        received = other.messages(WrenchStamped, "/wheel/axle_wrench")
        other.feed(speed=100.0, load=3000.0)
        other.until(lambda: len(received) > 100, "wrenches from the paced loop")
        assert change(other, DEACTIVATE) and change(other, ACTIVATE)
        received.clear()
        other.until(lambda: len(received) > 100, "wrenches after another start")
        process.terminate()
        _, said = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, said
    finally:
        other.close()
        if process.poll() is None:
            process.kill()
            process.communicate()


# -- speeds and loads as stacks publish them --


def test_joint_states_of_two_publishers_in_any_order(bench):
    one = bench("-p", "wheels:=[left, right]")
    front, rear = (one.publisher(JointState, "/joint_states") for _ in range(2))
    loads = [one.publisher(WrenchStamped, f"/{name}/load") for name in ("left", "right")]
    received = [one.messages(WrenchStamped, f"/{name}/axle_wrench") for name in ("left", "right")]

    def send() -> None:
        stamp = wrench(one.now(), 3000.0).header
        front.publish(JointState(header=stamp, name=["steering", "left"], velocity=[0.1, 90.0]))
        rear.publish(JointState(header=stamp, name=["right", "hatch"], velocity=[91.0, 0.0]))
        rear.publish(JointState(header=stamp, name=["lift"], position=[0.1]))
        for publisher in loads:
            publisher.publish(wrench(one.now(), 3000.0))

    one.peer.create_timer(0.01, send)
    for wrenches in received:
        one.until(lambda wrenches=wrenches: len(wrenches) > 50, "wrenches of both wheels")
    assert [wheel.speed for wheel in one.node._pipeline.vehicle.inputs] == [90.0, 91.0]


def test_a_load_without_a_stamp_is_one_of_the_moment(bench, tmp_path):
    one = bench("-p", f"log.directory:={tmp_path}", "-p", "tire.sidewall_damping:=reaction")
    speeds = one.publisher(Float64, "/wheel/wheel_speed")
    loads = one.publisher(Float64, "/wheel/load_force")
    received = one.messages(WrenchStamped, "/wheel/axle_wrench")

    def send() -> None:
        speeds.publish(Float64(data=60.0))
        loads.publish(Float64(data=2500.0))

    one.peer.create_timer(0.01, send)
    one.until(lambda: len(received) > 300, "wrenches")
    assert received[0].wrench.force.z == pytest.approx(2500.0, rel=1e-6)  # equilibrium, see docs/model.md
    one.close()
    (log,) = logs(tmp_path)
    replay(log, tmp_path / "again")
    wanted = "/wheel/axle_wrench"
    first, second = ([m[4] for m in BagReader(bag).messages([wanted])] for bag in (log, tmp_path / "again"))
    assert len(first) > 300 and first == second


# -- what is there to be looked at --


def test_markers_only_for_those_who_look(bench):
    one = bench()
    one.feed(speed=80.0, load=3000.0)
    shapes = one.messages(PointCloud2, "/wheel/ring_shape")
    one.until(lambda: len(shapes) > 5, "shapes")
    received = one.messages(MarkerArray, "/wheel/markers")
    one.until(lambda: len(received) > 5, "markers")
    belt, axle, load = received[-1].markers
    assert [marker.ns for marker in (belt, axle, load)] == ["belt", "axle_force", "contact_load"]
    assert {marker.header.frame_id for marker in (belt, axle, load)} == {"wheel_axle"}
    head, tail = load.points[1], load.points[0]
    assert head.z - tail.z == pytest.approx(3000.0 * 1e-4, rel=1e-9)  # marker_force_scale is 1e-4 m/N, upwards


def test_a_larger_deflection_is_drawn_and_the_true_one_said(bench):
    one = bench()
    one.feed(speed=0.0, load=3000.0)
    shapes = one.messages(PointCloud2, "/wheel/ring_shape")

    def lowest() -> tuple[float, float, float]:
        point = np.frombuffer(shapes[-1].data, "<f4").reshape(-1, 5)[54]  # psi = 3 pi/2 of 72 points
        return float(point[2]), float(point[3]), float(point[4])

    def settled() -> bool:
        return len(shapes) > 50 and shapes[-1].data == shapes[-2].data

    one.until(settled, "standstill")
    z, radial, tangential = lowest()
    assert one.set("ring_shape_scale", 10.0).successful
    one.until(lambda: abs(lowest()[0] - z) > 1e-4, "another shape")
    drawn, again, _ = lowest()
    assert again == pytest.approx(radial, rel=1e-5)
    radius = 0.305
    assert -z - radius == pytest.approx(radial, abs=1e-6)  # of float32
    assert -drawn - radius == pytest.approx(10.0 * radial, abs=1e-6)


def test_the_axles_frames_are_in_the_log(bench, tmp_path):
    one = bench("-p", f"log.directory:={tmp_path}", "-p", "wheels:=[left, right]",
                "-p", "tf.parent_frame:=base_link", "-p", "tf.positions:=[1.0, 0.7, 0.3, 1.0, -0.7, 0.3]")  # fmt: skip
    one.feed("left", speed=10.0, load=1000.0)
    received = one.messages(WrenchStamped, "/left/axle_wrench")
    one.until(lambda: len(received) > 50, "wrenches")
    one.close()
    (log,) = logs(tmp_path)
    replay(log, tmp_path / "again")
    from rosbags.typesys import Stores, get_typestore

    for bag in (log, tmp_path / "again"):
        reader = BagReader(bag)
        assert reader.topics["/tf_static"] == messages.TF
        data = next(iter(reader.messages(["/tf_static"])))[4]
        found = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr(data, messages.TF).transforms
        assert [transform.header.frame_id for transform in found] == ["base_link"] * 2
        assert [transform.child_frame_id for transform in found] == ["left_axle", "right_axle"]
        places = [transform.transform.translation for transform in found]
        assert [(place.x, place.y, place.z) for place in places] == [(1.0, 0.7, 0.3), (1.0, -0.7, 0.3)]
        assert all(transform.transform.rotation.w == 1.0 for transform in found)


@pytest.mark.parametrize("arguments", [(), MANAGED], ids=["active", "unconfigured"])
def test_a_closed_node_is_not_in_the_graph_while_it_is_referred_to(bench, arguments):
    """Else the lifecycle services of the old node take the requests that are meant for the next one of its name."""
    one, other = bench(*arguments), bench("-r", "__node:=other")
    referred, names = one.node, other.peer.get_node_names
    other.until(lambda: "tire_dynamics" in names(), "the node")
    one.close()
    other.until(lambda: "tire_dynamics" not in names(), "the end of the node")
    services = dict(other.peer.get_service_names_and_types())
    assert not [name for name in services if name.startswith("/tire_dynamics/")]
    del referred
