"""The live node over real topics, services and parameters; nothing of rclpy is replaced."""

from __future__ import annotations

import json
import math
import os
import random
import struct
import threading
import time

import numpy as np
import pytest
from scipy.linalg import expm

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import ParameterType
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Float64, Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from tire_dynamics import TireWheelUnit, ring, wheel
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay.parameters import PARAMETERS
from tire_dynamics.ros.deadlines import MADE_UP
from tire_dynamics.ros.node import TireDynamicsNode

PATIENCE = 180.0  # [s] after which what should have happened has not; a passing test never waits for it
SECOND = 10**9
RELIABLE = QoSProfile(depth=50)
MODAL = TireWheelUnit.table_1()
REACTION = TireWheelUnit.table_1(sidewall_damping="reaction")


class Bench:
    """The node under test, in a thread and a context of its own as in a process, and a peer that talks to it."""

    def __init__(self, domain: int, *arguments: str) -> None:
        self._contexts = [Context(), Context()]
        for context in self._contexts:
            context.init(args=[], domain_id=domain)
        self._executors = [EventsExecutor(context=context) for context in self._contexts]
        self._feed = {}
        self._stop = threading.Event()
        self._crash = []
        self._thread = threading.Thread(target=self._turn)
        self.node = self.peer = None
        try:
            self.node = TireDynamicsNode(context=self._contexts[0], arguments=["--ros-args", *arguments])
            self.peer = Node("peer", context=self._contexts[1])
            self._executors[0].add_node(self.node)
            self._executors[1].add_node(self.peer)
            self._thread.start()
        except BaseException:
            self.close()
            raise

    def _turn(self) -> None:
        try:
            while not self._stop.is_set():
                self._executors[0].spin_once(timeout_sec=0.05)
        except BaseException as error:
            self._crash.append(error)

    def close(self) -> None:
        """End everything; what the node's callbacks raised comes out here at the latest."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        if self.peer is not None:
            self.peer.destroy_node()
            self.peer = None
        if self.node is not None:
            self.node.destroy_node()
            self.node = None
        for executor, context in zip(self._executors, self._contexts, strict=True):
            executor.shutdown()
            context.try_shutdown()
        self._look()

    def _look(self) -> None:
        if self._crash:
            raise AssertionError("a callback of the node raised") from self._crash.pop()

    def until(self, condition, what: str):
        """Spin until the condition holds; its value."""
        clock = self.peer.get_clock()
        end = clock.now().nanoseconds + int(PATIENCE * SECOND)
        while not (value := condition()):
            self._look()
            if clock.now().nanoseconds > end:
                pytest.fail(f"waited {PATIENCE:g} s for {what}")
            self._executors[1].spin_once(timeout_sec=0.002)
        return value

    def now(self) -> int:
        return self.peer.get_clock().now().nanoseconds

    def messages(self, kind, topic: str) -> list:
        """What is published on a topic from now on; the list grows."""
        received = []
        self.peer.create_subscription(kind, topic, received.append, RELIABLE)
        self.until(lambda: self.peer.count_publishers(topic), f"a publisher on {topic}")
        return received

    def publisher(self, kind, topic: str, qos=RELIABLE):
        publisher = self.peer.create_publisher(kind, topic, qos)
        self.until(publisher.get_subscription_count, f"a subscriber on {topic}")
        return publisher

    def feed(self, name: str = "wheel", *, speed: float | None = None, load: float | None = None) -> None:
        """Send a wheel this speed and this load, every 10 ms, from now on; None stops."""
        if not self._feed:
            self.peer.create_timer(0.01, self._send)
        if name not in self._feed:
            publishers = self.publisher(Float64, f"/{name}/wheel_speed"), self.publisher(WrenchStamped, f"/{name}/load")
            self._feed[name] = [*publishers, None, None]
        self._feed[name][2:] = speed, load

    def _send(self) -> None:
        for speeds, loads, speed, load in self._feed.values():
            if speed is not None:
                speeds.publish(Float64(data=speed))
            if load is not None:
                loads.publish(wrench(self.now(), load))

    def send_load(self, message: WrenchStamped, name: str = "wheel") -> None:
        """Send one load on the way that ``feed`` has opened: a new publisher's first message may get lost."""
        self._feed[name][1].publish(message)

    def call(self, kind, name: str, request=None):
        client = self.peer.create_client(kind, name)
        self.until(client.service_is_ready, f"the service {name}")
        future = client.call_async(request or kind.Request())
        self.until(future.done, f"the reply of {name}")
        return future.result()

    def set_logging(self, on: bool) -> SetBool.Response:
        return self.call(SetBool, "/tire_dynamics/set_logging", SetBool.Request(data=on))

    def parameters(self) -> AsyncParameterClient:
        client = AsyncParameterClient(self.peer, "tire_dynamics")
        self.until(client.services_are_ready, "the node's parameter services")
        return client

    def result(self, future):
        self.until(future.done, "a parameter service's reply")
        return future.result()

    def set(self, name: str, value):
        kind = Parameter.Type.from_parameter_value(value)
        (result,) = self.result(self.parameters().set_parameters([Parameter(name, kind, value)])).results
        return result

    def get(self, name: str):
        (value,) = self.result(self.parameters().get_parameters([name])).values
        return Parameter.from_parameter_msg(_parameter_message(name, value)).value


def _parameter_message(name, value):
    from rcl_interfaces.msg import Parameter as ParameterMessage

    return ParameterMessage(name=name, value=value)


def ns(stamp: Time) -> int:
    return stamp.sec * SECOND + stamp.nanosec


def wrench(stamp: int, load: float, traction: float = 0.0) -> WrenchStamped:
    message = WrenchStamped()
    message.header.stamp = Time(sec=stamp // SECOND, nanosec=stamp % SECOND)
    message.wrench.force.z, message.wrench.force.x = load, traction
    return message


def stamp_of(message) -> int:
    return ns(message.header.stamp)


def steady_force(unit: TireWheelUnit, speed: float, load: float) -> tuple[float, float]:
    """(x, z) on the axle under a constant load at constant speed, by hand from docs/model.md, sections 3 and 5.

    Modal: R = (X, Y) with kappa X + d Omega Y = 0, Y = y (k_1 + k_s)/k_1, k_s y = K F, force.x = -k_1 X.
    Reaction: the dashpots turn with the ring, S = f: all of the load, and nothing sideways.
    """
    if unit.sidewall_damping == "reaction":
        return 0.0, load
    k_1, k_s, omega_1 = unit.sidewall_stiffness, unit.suspension_stiffness, unit.rigid_mode_frequency
    K = 1.0 / (1.0 + (2.0 * unit.zeta_1 * speed / omega_1) ** 2 * (k_1 + k_s) / k_s)  # section 3
    Y = K * load * (k_1 + k_s) / (k_1 * k_s)
    return unit.ring_mass * 2.0 * unit.zeta_1 * omega_1 * speed * Y, K * load


def near(force, unit, speed, load, tolerance=1e-9) -> bool:
    """Whether a wrench is the steady one. The closed form and the stepped state differ by rounding: some
    hundred steps, each of 1e-16 of the forces inside, leave 1e-9 of the load far away."""
    x, z = steady_force(unit, speed, load)
    return abs(force.x - x) <= tolerance * load and abs(force.z - z) <= tolerance * load


# --- the interface ---


OF_EVERY_NODE = ("/rosout", "/parameter_events", "/tire_dynamics/transition_event")  # of every managed one


def test_topics_types_and_qos(bench):
    one = bench("-p", "wheels:=[left, right]")
    inputs = {"/joint_states": "sensor_msgs/msg/JointState"}
    outputs = {"/diagnostics": "diagnostic_msgs/msg/DiagnosticArray"}
    for name in ("left", "right"):
        inputs[f"/{name}/wheel_speed"] = "std_msgs/msg/Float64"
        inputs[f"/{name}/load"] = "geometry_msgs/msg/WrenchStamped"
        inputs[f"/{name}/load_force"] = "std_msgs/msg/Float64"
        outputs[f"/{name}/axle_wrench"] = "geometry_msgs/msg/WrenchStamped"
        outputs[f"/{name}/ring_deflection"] = "std_msgs/msg/Float64MultiArray"
        outputs[f"/{name}/ring_shape"] = "sensor_msgs/msg/PointCloud2"
        outputs[f"/{name}/markers"] = "visualization_msgs/msg/MarkerArray"

    def mine(found) -> dict:
        return {name: kind for name, (kind,) in found if not name.endswith(OF_EVERY_NODE)}

    peer = one.peer
    one.until(lambda: ("tire_dynamics", "/") in peer.get_node_names_and_namespaces(), "the node's discovery")
    one.until(lambda: mine(peer.get_publisher_names_and_types_by_node("tire_dynamics", "/")) == outputs, f"{outputs}")
    one.until(lambda: mine(peer.get_subscriber_names_and_types_by_node("tire_dynamics", "/")) == inputs, f"{inputs}")
    for topic in inputs:
        (end,) = peer.get_subscriptions_info_by_topic(topic)
        assert end.qos_profile.reliability == qos_profile_sensor_data.reliability, topic
    for topic in outputs:
        (end,) = peer.get_publishers_info_by_topic(topic)
        assert end.qos_profile.reliability == ReliabilityPolicy.RELIABLE, topic
    services = {
        "/left/floquet_stability": ["std_srvs/srv/Trigger"],
        "/right/floquet_stability": ["std_srvs/srv/Trigger"],
        "/tire_dynamics/set_logging": ["std_srvs/srv/SetBool"],
    }
    one.until(
        lambda: services.items() <= dict(peer.get_service_names_and_types_by_node("tire_dynamics", "/")).items(),
        f"{services}",
    )


def test_a_namespace_moves_everything_but_the_diagnostics(bench):
    one = bench("-r", "__ns:=/car", "-r", "wheel/load:=contact")
    outputs = {f"/car/wheel/{name}" for name in ("axle_wrench", "ring_deflection", "ring_shape", "markers")}
    outputs.add("/diagnostics")
    peer = one.peer

    def published() -> set:
        found = peer.get_publisher_names_and_types_by_node("tire_dynamics", "/car")
        return {name for name, _ in found if not name.endswith(OF_EVERY_NODE)}

    one.until(lambda: ("tire_dynamics", "/car") in peer.get_node_names_and_namespaces(), "the node's discovery")
    one.until(lambda: published() == outputs, f"{outputs}")
    one.until(lambda: peer.count_subscribers("/car/contact") == 1, "the remapped input")
    assert peer.count_subscribers("/car/joint_states") == 1


INTERFACE_DEFAULTS = {
    "wheels": ["wheel"],
    "rate_hz": 500.0,
    "ring_rate_hz": 50.0,
    "ring_samples": 72,
    "n_max": 30,
    "input_timeout_s": 0.2,
    "joint_names": ["wheel"],
    "frame_ids": ["wheel_axle"],
    "log.directory": "",
    **{f"tire.{name}": value for name, value in MODAL.to_mapping().items()},
}


def test_parameters_have_the_defaults_of_the_interface_and_describe_themselves(bench):
    one = bench()
    client = one.parameters()
    listed = set(one.result(client.list_parameters([], 0)).result.names)
    assert INTERFACE_DEFAULTS.keys() <= listed
    for name, default in INTERFACE_DEFAULTS.items():
        value = one.get(name)
        assert (list(value) if isinstance(default, list) else value) == default, name
    names = [row.name for row in PARAMETERS]
    assert set(names) <= listed
    descriptors = one.result(client.describe_parameters(names)).descriptors
    for row, descriptor in zip(PARAMETERS, descriptors, strict=True):
        assert descriptor.name == row.name
        assert len(descriptor.description) > 10, row.name
        assert descriptor.read_only == row.read_only, row.name
        assert not descriptor.dynamic_typing, row.name
        if descriptor.type == ParameterType.PARAMETER_DOUBLE:
            (bounds,) = descriptor.floating_point_range
            assert bounds.from_value <= row.default <= bounds.to_value, row.name
            assert bounds.from_value >= 0.0 or row.name == "tire.imbalance_angle"
        if descriptor.type == ParameterType.PARAMETER_INTEGER:
            (bounds,) = descriptor.integer_range
            assert bounds.from_value <= row.default <= bounds.to_value, row.name


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["-p", "rate_hz:=-1.0"], ["rate_hz", "-1.0"]),
        (["-p", "tire.radius:=-1.0"], ["tire.radius", "-1.0"]),
        (["-p", "tire.radius:=1"], ["tire.radius", "floating-point"]),
        (["-p", "tire.radus:=1.0"], ["tire.radus", "tire.radius"]),
        (["-p", "wheels:=[a, a]"], ["wheels", "twice"]),
        (["-p", "wheels:=[a/b]"], ["wheels", "a/b"]),
        (["-p", "wheels:=[]"], ["wheels"]),
        (["-p", "joint_names:=[a, b]"], ["joint_names", "2"]),
        (["-p", f"wheels:=[{'a' * 300}]"], ["wheels"]),
        (["-p", "log.directory:=/proc/nowhere"], ["/proc/nowhere"]),
        (["-p", f"log.directory:=/tmp/{'a' * 300}"], ["/tmp/aaa"]),
        (["-p", "tire.density:=1.0e-300"], ["tire.density", "1e-300"]),
    ],
)
def test_bad_parameters_at_the_start_are_one_clear_error(bench, arguments, named):
    with pytest.raises(InputError) as caught:
        bench(*arguments)
    for text in named:
        assert text in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value", "named"),
    [
        ("tire.radius", -0.3, "tire.radius"),
        ("tire.radius", 0.0, "tire.radius"),
        ("tire.radius", math.nan, "tire.radius"),
        ("tire.radius", 1, "DOUBLE"),  # rclpy's own check of the type
        ("tire.thickness", 0.4, "thickness"),  # not thinner than the radius
        ("tire.zeta_1", 1.0, "zeta_1"),
        ("tire.sidewall_damping", "paper", "sidewall_damping"),
        ("tire.density", 1e-300, "out of range"),
        ("rate_hz", 100.0, "rate_hz"),  # read-only, like all that gives the node its form
        ("wheels", ["other"], "wheels"),
        ("ring_samples", 10, "ring_samples"),
        ("tire.no_such", 1.0, "undeclared"),  # rclpy's
    ],
)
def test_a_bad_change_is_refused_with_a_reason_and_changes_nothing(bench, name, value, named):
    one = bench()
    one.feed(speed=100.0, load=4000.0)
    before = one.get(name) if name != "tire.no_such" else None
    result = one.set(name, value)
    assert not result.successful
    assert named in result.reason or "read-only" in result.reason
    if before is not None:
        assert one.get(name) == before
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    one.until(lambda: len(forces) > 10, "forces after the change was refused")
    assert all(near(message.wrench.force, MODAL, 100.0, 4000.0) for message in forces)


# --- what it computes ---


@pytest.mark.parametrize("qos", [RELIABLE, qos_profile_sensor_data], ids=["reliable", "best effort"])
@pytest.mark.parametrize("unit", [MODAL, REACTION], ids=["modal", "reaction"])
def test_a_steady_load_gives_the_closed_form(bench, unit, qos):
    one = bench("-p", f"tire.sidewall_damping:={unit.sidewall_damping}")
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    speeds = one.publisher(Float64, "/wheel/wheel_speed", qos)
    loads = one.publisher(WrenchStamped, "/wheel/load", qos)
    speed = 2000.0 * math.pi / 30.0

    def send() -> None:
        speeds.publish(Float64(data=speed))
        loads.publish(wrench(one.now(), 1961.33))

    one.peer.create_timer(0.02, send)
    one.until(lambda: len(forces) > 100, "axle wrenches")
    for message in forces:
        assert message.header.frame_id == "wheel_axle"
        assert near(message.wrench.force, unit, speed, 1961.33)
        assert (message.wrench.force.y, message.wrench.torque.x, message.wrench.torque.y) == (0.0, 0.0, 0.0)
    if unit is MODAL:  # docs/model.md, section 12: the paper's 2000 rpm and 200 kgf
        assert forces[-1].wrench.force.x == pytest.approx(3162.18, abs=0.005)
        assert forces[-1].wrench.force.z / 1961.33 == pytest.approx(0.931556, abs=5e-7)


def test_joint_states_are_taken_by_name_and_wheels_keep_apart(bench):
    one = bench(
        "-p", "wheels:=[left, right]", "-p", "joint_names:=[hub_l, hub_r]", "-p", "frame_ids:=[axle_l, axle_r]"
    )  # fmt: skip
    forces = {name: one.messages(WrenchStamped, f"/{name}/axle_wrench") for name in ("left", "right")}
    joints = one.publisher(JointState, "/joint_states", qos_profile_sensor_data)
    loads = {name: one.publisher(WrenchStamped, f"/{name}/load") for name in ("left", "right")}
    turn = iter(range(10**9))

    def send() -> None:
        now = one.now()
        message = JointState()
        message.header.stamp = Time(sec=now // SECOND, nanosec=now % SECOND)
        if next(turn) % 2:
            message.name, message.velocity = ["steer", "hub_r", "hub_l"], [math.nan, -80.0, 50.0]
            message.position = [0.1, 0.2, 0.3]
        else:  # another order, other joints
            message.name, message.velocity = ["hub_l", "left", "hub_r"], [50.0, 7.0, -80.0]
        joints.publish(message)
        loads["left"].publish(wrench(now, 3000.0))
        loads["right"].publish(wrench(now, 5000.0))

    one.peer.create_timer(0.02, send)
    one.until(lambda: min(map(len, forces.values())) > 50, "axle wrenches of both wheels")
    for name, frame, speed, load in (("left", "axle_l", 50.0, 3000.0), ("right", "axle_r", -80.0, 5000.0)):
        assert {message.header.frame_id for message in forces[name]} == {frame}
        assert all(near(message.wrench.force, MODAL, speed, load) for message in forces[name])
    assert forces["right"][-1].wrench.force.x < 0.0 < forces["left"][-1].wrench.force.x


def test_a_change_of_the_tire_takes_effect_while_it_turns(bench):
    one = bench()
    one.feed(speed=200.0, load=4000.0)
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    one.until(lambda: len(forces) > 10, "axle wrenches")
    assert near(forces[-1].wrench.force, MODAL, 200.0, 4000.0)
    assert one.set("tire.zeta_1", 0.2).successful
    one.until(lambda: near(forces[-1].wrench.force, MODAL.replace(zeta_1=0.2), 200.0, 4000.0, 1e-6), "the new K")
    assert one.set("tire.sidewall_damping", "reaction").successful
    one.until(lambda: near(forces[-1].wrench.force, REACTION, 200.0, 4000.0, 1e-6), "K = 1")
    stamps = [stamp_of(message) for message in forces]
    assert all(after > before for before, after in zip(stamps, stamps[1:], strict=False))


def test_a_step_of_the_load_acts_at_its_stamp_and_follows_the_exact_solution(bench):
    one = bench("-p", "input_timeout_s:=10.0")
    one.feed(speed=150.0, load=3000.0)
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    one.until(lambda: len(forces) > 10, "axle wrenches")
    one.feed(speed=150.0)  # from now on no loads but the step
    step = stamp_of(forces[-1]) + SECOND  # in the future: it must wait for its time, and comes before it
    one.send_load(wrench(step, 4500.0))
    end = step + SECOND // 2
    one.until(lambda: stamp_of(forces[-1]) >= end, "half a second after the step")

    F = wheel.fixed_frame_matrix(MODAL, 150.0)
    push = np.zeros(6)
    push[1] = 1.0 / MODAL.ring_mass  # the load on Y', docs/model.md, section 3
    before, after = (np.linalg.solve(-F, push * load) for load in (3000.0, 4500.0))
    early = [message for message in forces if stamp_of(message) <= step]
    late = [message for message in forces if step < stamp_of(message) <= end]
    assert len(early) > 10 and len(late) > 10
    assert all(near(message.wrench.force, MODAL, 150.0, 3000.0) for message in early)
    k_1, k_s, c_s = MODAL.sidewall_stiffness, MODAL.suspension_stiffness, MODAL.suspension_damping
    for message in late:
        _, _, vy, X, _, y = after + expm(F * ((stamp_of(message) - step) * 1e-9)) @ (before - after)
        # Both are exact but for rounding, which the stiffest state (k_1 X) carries into the forces.
        assert message.wrench.force.z == pytest.approx(k_s * y + c_s * vy, abs=1e-6)
        assert message.wrench.force.x == pytest.approx(-k_1 * X, abs=1e-6)


def test_stamps_ascend_one_period_apart_and_never_lie_ahead(bench):
    one = bench("-p", "rate_hz:=250.0")
    one.feed(speed=50.0, load=4000.0)
    ahead = []
    stamps = []

    def take(message) -> None:
        stamps.append(stamp_of(message))
        ahead.append(stamps[-1] - one.now())

    one.peer.create_subscription(WrenchStamped, "/wheel/axle_wrench", take, RELIABLE)
    one.until(lambda: len(stamps) > 500, "axle wrenches")
    differences = np.diff(stamps)
    period = SECOND // 250
    assert differences.min() > 0
    assert max(ahead) <= 0  # one machine, one clock
    # A timer that comes earlier than ever before moves the instants; that gets rarer and rarer.
    regular = differences % period == 0
    assert np.count_nonzero(~regular) <= len(differences) // 5
    assert differences[regular].min() == period


def test_paced_by_its_caller(ros_domain):
    """Deadlines one period apart: a stall is made up for, and of what is missed beyond that the rest is counted."""
    context = Context()
    context.init(args=[], domain_id=ros_domain)
    arguments = ["--ros-args", "-p", "rate_hz:=20.0", "-p", "ring_rate_hz:=10.0"]
    node = TireDynamicsNode(context=context, arguments=arguments, paced=True)
    period = 0.05
    try:
        def ticks() -> tuple[int, int]:
            values = {pair.key: pair.value for pair in node._node_status().values}
            return int(values["ticks"]), int(values["ticks missed"])

        for _ in range(10):
            time.sleep(max(0.0, node.until_tick()))
            count = ticks()[0]
            node.pace()
            assert ticks()[0] == count + 1
            due = time.monotonic() + node.until_tick()
            node.pace()
            assert ticks()[0] == count + 1 or time.monotonic() >= due, "a tick before it is due"
        while node.until_tick() <= 0.0:
            node.pace()
        count, before = ticks()
        time.sleep(20.0 * period)
        passed = 1 + int(-node.until_tick() / period)
        node.pace()
        done, missed = ticks()
        assert done == count + 1
        assert passed - 1 - MADE_UP <= missed - before <= passed + 1  # a deadline may pass between the looks
        behind = -node.until_tick() / period
        assert behind <= MADE_UP + 1, "a backlog"
    finally:
        node.destroy_node()
        context.try_shutdown()


def test_ring_messages(bench):
    samples = 40
    one = bench("-p", f"ring_samples:={samples}", "-p", "ring_rate_hz:=100.0", "-p", "n_max:=12")
    speed, load = 120.0, 4000.0
    one.feed(speed=speed, load=load)
    arrays = one.messages(Float64MultiArray, "/wheel/ring_deflection")
    clouds = one.messages(PointCloud2, "/wheel/ring_shape")
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    one.until(lambda: len(arrays) > 5 and len(clouds) > 5 and len(forces) > 50, "ring messages")

    array = arrays[-1]
    assert [(d.label, d.size, d.stride) for d in array.layout.dim] == [
        ("component", 2, 2 * samples), ("angle", samples, samples)
    ]  # fmt: skip
    assert array.layout.data_offset == 0
    u_z, u_theta = np.array(array.data).reshape(2, samples)
    psi = 2.0 * np.pi * np.arange(samples) / samples
    flexural = ring.steady_response(MODAL, speed, load, psi, n_max=12)
    # n = 1: the sidewall holds the belt against the load, k_1 (R - y e_Y) = (-force.x, F + d m Omega X);
    # X = -force.x/k_1 from the wrench, and Y - y from K F = k_s y, k_1 (Y - y) = k_s y.
    x, z = steady_force(MODAL, speed, load)
    X, Y_y = -x / MODAL.sidewall_stiffness, z / MODAL.sidewall_stiffness
    # Sums of a dozen terms of some mm, in another order: 1e-15 of them, 1e-12 m leaves room.
    np.testing.assert_allclose(u_z, flexural[0] + X * np.cos(psi) + Y_y * np.sin(psi), rtol=0, atol=1e-12)
    np.testing.assert_allclose(u_theta, flexural[1] + Y_y * np.cos(psi) - X * np.sin(psi), rtol=0, atol=1e-12)
    contact = 3 * samples // 4  # psi = 3 pi/2
    assert np.argmin(u_z) in (contact - 1, contact, contact + 1)  # pressed in where the road is

    cloud = clouds[-1]
    assert (cloud.header.frame_id, cloud.height, cloud.width) == ("wheel_axle", 1, samples)
    assert [(f.name, f.offset, f.datatype, f.count) for f in cloud.fields] == [
        (name, 4 * i, 7, 1) for i, name in enumerate(("x", "y", "z", "radial", "tangential"))
    ]
    assert (cloud.point_step, cloud.row_step, cloud.is_bigendian, cloud.is_dense) == (20, 20 * samples, False, True)
    points = np.frombuffer(bytes(cloud.data), "<f4").reshape(samples, 5)
    # REP 103: x_ros = -X, so psi = 0 lies at -x, psi = pi/2 at +z; the tangent turns with it.
    x_ros = -(MODAL.radius + u_z) * np.cos(psi) + u_theta * np.sin(psi)
    z_ros = (MODAL.radius + u_z) * np.sin(psi) + u_theta * np.cos(psi)
    expected = np.stack([x_ros, np.zeros(samples), z_ros, u_z, u_theta], axis=1)
    np.testing.assert_allclose(points, expected, rtol=0, atol=2e-8)  # float32 at 0.3 m: 1.5e-8
    stamps = [stamp_of(message) for message in clouds]
    assert set(stamps) <= {stamp_of(message) for message in forces} | set(stamps[:1])
    assert SECOND // 100 in np.diff(stamps)  # and more, where a busy machine misses ticks; then one comes sooner


# --- services and diagnostics ---


@pytest.mark.parametrize("speed", [209.43951023931953, -60.0, 0.0, 5e-324])
def test_the_stability_service_gives_the_closed_form(bench, speed):
    one = bench("-p", "rate_hz:=50.0")
    one.feed(speed=speed, load=4000.0)
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    one.until(lambda: len(forces) > 2, "axle wrenches")
    response = one.call(Trigger, "/wheel/floquet_stability")
    assert response.success, response.message
    reply = json.loads(response.message, parse_constant=lambda text: pytest.fail(f"{text} is not JSON"))
    assert list(reply) == [
        "wheel", "speed_rad_s", "period_s", "verdict", "spectral_radius", "multipliers", "exponents_1_s",
        "critical_speed_rad_s",
        "periodicity",
        "nearest_tongue_rad_s",
        "contact",
        "n_max",
    ]  # fmt: skip
    assert (reply["wheel"], reply["verdict"]) == ("wheel", "asymptotically stable")
    assert reply["speed_rad_s"] == speed
    # docs/model.md, section 12: loss of stability near 22 400 rpm at zeta_1 = zeta_s = 0.05
    assert reply["critical_speed_rad_s"] * 30.0 / math.pi == pytest.approx(22_400, abs=50)
    exponents = np.array([complex(*pair) for pair in reply["exponents_1_s"]])
    eigenvalues = np.linalg.eigvals(wheel.fixed_frame_matrix(MODAL, speed))
    for value in eigenvalues:
        assert abs(exponents - value).min() < 1e-9 * abs(value)
    if abs(speed) < 1e-300:
        assert reply["period_s"] is reply["multipliers"] is reply["spectral_radius"] is None
        return
    assert reply["period_s"] == pytest.approx(2.0 * math.pi / abs(speed), rel=1e-15)
    moduli = sorted(abs(complex(*pair)) for pair in reply["multipliers"])
    assert reply["spectral_radius"] == pytest.approx(moduli[-1], rel=1e-12)
    if speed > 200.0:  # 2000 rpm
        expected = [0.476304, 0.476304, 0.613536, 0.613536, 0.687992, 0.687992]
        assert moduli == pytest.approx(expected, abs=5e-7)


def test_diagnostics_once_a_second_with_every_wheels_ages(bench):
    one = bench("-p", "wheels:=[left, right]")
    one.feed("left", speed=50.0, load=4000.0)
    arrays = one.messages(DiagnosticArray, "/diagnostics")
    one.until(lambda: len(arrays) >= 3, "three diagnostics")
    spacing = np.diff([stamp_of(array) for array in arrays]) * 1e-9
    assert np.mean(spacing) > 0.5  # the timer's period; a busy machine delays one, and the next comes sooner

    def in_order() -> bool:
        status = arrays[-1].status[1]
        ages = [float(item.value) for item in status.values if item.key.startswith("age of") and item.value != "-"]
        return status.level == b"\0" and len(ages) == 2 and 0.0 <= min(ages) and max(ages) < 0.2

    one.until(in_order, "diagnostics of a wheel whose inputs are fresh")
    node, left, right = (status for status in arrays[-1].status)
    assert [status.name for status in arrays[-1].status] == [
        "tire_dynamics: node", "tire_dynamics: left", "tire_dynamics: right"
    ]  # fmt: skip
    assert node.message == "2 wheels" or "ticks missed" in node.message  # which is the machine's doing
    assert left.level == b"\0", left.message
    values = {item.key: item.value for item in left.values}
    assert float(values["speed [rad/s]"]) == 50.0
    assert values["stability"] == "asymptotically stable"
    assert right.level == b"\x02"
    assert "no speed" in right.message and "no load" in right.message
    one.feed("left", speed=50.0)
    one.until(lambda: arrays[-1].status[1].level == b"\x02", "the stale load in the diagnostics")
    assert "load" in arrays[-1].status[1].message


def test_set_logging(bench, tmp_path):
    one = bench()
    one.feed(speed=50.0, load=4000.0)
    response = one.set_logging(True)
    assert not response.success
    assert "log.directory" in response.message
    assert one.set_logging(False).success  # nothing to stop is no failure

    assert one.set("log.directory", str(tmp_path / "logs")).successful
    response = one.set_logging(True)
    assert response.success
    logs = tmp_path / "logs"
    one.until(lambda: logs.exists() and list(logs.glob("*/*.mcap")), "the log, which another thread makes")
    (folder,) = logs.iterdir()
    assert str(folder) in response.message
    assert one.set_logging(True).success  # still the same one
    assert list((tmp_path / "logs").iterdir()) == [folder]
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    one.until(lambda: len(forces) > 20, "axle wrenches")
    assert one.set_logging(False).success
    whole = {"metadata.yaml", f"{folder.name}_0.mcap"}
    one.until(lambda: {path.name for path in folder.iterdir()} == whole, "the end of the log")
    assert one.set_logging(True).success
    one.until(lambda: len(list(logs.iterdir())) == 2, "the second log")


def test_a_directory_that_cannot_be_written_is_said_and_the_node_goes_on(bench, tmp_path):
    one = bench()
    one.feed(speed=50.0, load=4000.0)
    (tmp_path / "file").write_text("")
    for directory in (str(tmp_path / "file"), str(tmp_path / ("a" * 300))):
        assert one.set("log.directory", directory).successful
        response = one.set_logging(True)
        assert not response.success and directory in response.message
        assert one.node._journal.log is None  # and it is not tried again: who asked was told
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    one.until(lambda: len(forces) > 20, "axle wrenches")


def latest(diagnostics) -> DiagnosticStatus:
    """The node's last status."""
    return diagnostics[-1].status[0] if diagnostics else DiagnosticStatus()


def test_a_log_that_the_disk_ends_is_said_and_another_begins(bench, tmp_path):
    one = bench("-p", f"log.directory:={tmp_path}")
    one.feed(speed=50.0, load=4000.0)
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    diagnostics = one.messages(DiagnosticArray, "/diagnostics")
    first = one.node._journal.log.folder
    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, one.node._journal.log._writer._file.fileno())  # from now on its disk is full
    os.close(full)
    one.until(lambda: "the log stopped" in latest(diagnostics).message, "the log's end in the diagnostics")
    assert latest(diagnostics).level == b"\x02"
    count = len(forces)
    one.until(lambda: len(forces) > count + 20, "axle wrenches without a log")
    one.until(lambda: set(tmp_path.glob("tire_dynamics_*")) - {first}, "the second log")
    assert one.set_logging(True).success  # it is there already
    assert one.set_logging(False).success


# --- inputs that are wrong or missing ---


def test_malformed_inputs_do_not_stop_the_outputs(bench):
    one = bench()
    one.feed(speed=50.0, load=4000.0)
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    diagnostics = one.messages(DiagnosticArray, "/diagnostics")
    one.until(lambda: forces, "axle wrenches")
    joints = one.publisher(JointState, "/joint_states")
    loads = one.publisher(WrenchStamped, "/wheel/load")
    speeds = one.publisher(Float64, "/wheel/wheel_speed")
    now = one.now()
    far = 2**31 - 1
    for value in (math.nan, math.inf, -math.inf, 1e300):
        loads.publish(wrench(now, value))
        loads.publish(wrench(now, 4000.0, traction=value))
        speeds.publish(Float64(data=value))
        joints.publish(JointState(name=["wheel"], velocity=[value]))
    loads.publish(wrench(far * SECOND, 1.0))
    for names, velocities in ((["wheel"], []), ([], [1.0]), (["a", "wheel"], [1.0]), ([""] * 5000, [1.0] * 5000)):
        joints.publish(JointState(name=names, velocity=velocities))
    noise = random.Random(1)
    little = struct.pack("<4s", b"\0\1\0\0")
    for length in [*range(4, 40), *(noise.randrange(4, 400) for _ in range(60))]:  # the middleware wants 4 bytes
        for publisher in (joints, loads, speeds):
            size = min(length, 12) if publisher is speeds else length  # and no more than a Float64 has
            publisher.publish(noise.randbytes(size))
            publisher.publish(little + noise.randbytes(size - 4))  # a good head makes them go deeper
        count = len(forces)
        one.until(lambda count=count: len(forces) > count, "an axle wrench after noise")
    count = len(forces)
    one.until(lambda: len(forces) > count + 100, "axle wrenches after the noise")
    # Noise may decode to a load that is a load; the last ones come long after it.
    one.until(lambda: near(forces[-1].wrench.force, MODAL, 50.0, 4000.0, 1e-6), "the steady force again")
    assert all(math.isfinite(message.wrench.force.z) for message in forces)

    def counted() -> dict:
        values = {item.key: item.value for item in diagnostics[-1].status[0].values} if diagnostics else {}
        return {key: int(value) for key, value in values.items() if "malformed" in key and int(value) > 0}

    one.until(lambda: len(counted()) == 3, "malformed messages of all three topics in the diagnostics")


def test_a_stale_input_stops_the_output_and_a_fresh_one_starts_it_again(bench):
    one = bench("-p", "input_timeout_s:=0.1")
    one.feed(speed=50.0, load=4000.0)
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    one.until(lambda: len(forces) > 20, "axle wrenches")
    one.feed(speed=50.0)
    last_load = one.now()
    one.until(lambda: one.now() > last_load + SECOND // 2, "half a second without loads")
    stopped = len(forces)
    assert stamp_of(forces[-1]) <= last_load + SECOND // 10 + SECOND // 50  # the last sent is at most a turn late
    one.feed(speed=50.0, load=2000.0)
    one.until(lambda: len(forces) > stopped + 20, "axle wrenches again")
    assert all(near(message.wrench.force, MODAL, 50.0, 2000.0) for message in forces[stopped:])
    stamps = [stamp_of(message) for message in forces]
    assert all(after > before for before, after in zip(stamps, stamps[1:], strict=False))


def test_an_unstable_motion_recovers_when_the_speed_does(bench):
    # docs/model.md, section 12: zeta_1 = 0.5 loses its stability near 4350 rpm, 455 rad/s.
    one = bench("-p", "tire.zeta_1:=0.5", "-p", "max_speed_rad_s:=100000.0")
    one.feed(speed=5000.0, load=4000.0)
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    diagnostics = one.messages(DiagnosticArray, "/diagnostics")
    one.until(lambda: diagnostics and diagnostics[-1].status[1].level == b"\x02", "the verdict in the diagnostics")
    begin = one.now()
    one.until(lambda: one.now() > begin + 3 * SECOND, "three seconds of growth")
    one.feed(speed=50.0, load=4000.0)
    one.until(
        lambda: forces and near(forces[-1].wrench.force, MODAL.replace(zeta_1=0.5), 50.0, 4000.0, 1e-6),
        "the steady force at a stable speed",
    )


def test_a_speed_that_fades_out_as_a_filter_does_is_standstill(bench):
    one = bench()
    one.feed(speed=5e-324, load=4000.0)  # 0.9 times this is this: where a first-order low-pass ends
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    diagnostics = one.messages(DiagnosticArray, "/diagnostics")
    one.until(lambda: len(diagnostics) > 1, "two diagnostics")
    assert near(forces[-1].wrench.force, MODAL, 0.0, 4000.0)


# --- simulated time ---


class SimulatedTime:
    """A /clock, and inputs that are stamped with it."""

    def __init__(self, bench: Bench, begin: int) -> None:
        self._bench = bench
        self._clock = bench.publisher(Clock, "/clock")
        self._speeds = bench.publisher(Float64, "/wheel/wheel_speed")
        self._loads = bench.publisher(WrenchStamped, "/wheel/load")
        self.forces = bench.messages(WrenchStamped, "/wheel/axle_wrench")
        self.to(begin, load=None)

    def to(self, time: int, load: float | None = 4000.0) -> None:
        """Set the clock, and send what is then measured."""
        self.time = time
        bench = self._bench
        message = Clock(clock=Time(sec=time // SECOND, nanosec=time % SECOND))

        def arrived() -> bool:
            if bench.node.get_clock().now().nanoseconds == time:
                return True
            self._clock.publish(message)  # the first may get lost: /clock is taken with best effort
            return False

        bench.until(arrived, f"the clock at {time}")
        if load is not None:
            self.send(load)

    def send(self, load: float = 4000.0) -> None:
        """Publish the present time once more, and what is measured."""
        self._clock.publish(Clock(clock=Time(sec=self.time // SECOND, nanosec=self.time % SECOND)))
        self._speeds.publish(Float64(data=50.0))
        self._loads.publish(wrench(self.time, load))

    def run(self, step: int, until) -> None:
        """Let it run in steps until the condition holds."""

        def turn() -> bool:
            self.to(self.time + step)
            return until()

        self._bench.until(turn, "a condition in simulated time")


def test_simulated_time_runs_stands_and_goes_back(bench):
    one = bench("-p", "use_sim_time:=true", "-p", "rate_hz:=100.0")
    one.feed(speed=50.0, load=4000.0)  # stamped with this machine's time, which means nothing here
    begin = one.now()
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    one.until(lambda: one.now() > begin + SECOND // 2, "half a second before the first /clock")
    assert not forces
    one.feed()
    sim = SimulatedTime(one, 1000 * SECOND)
    sim.run(10_000_000, lambda: len(sim.forces) > 20)
    assert all(1000 * SECOND < stamp_of(message) <= sim.time for message in sim.forces)
    stamps = [stamp_of(message) for message in sim.forces]
    assert set(np.diff(stamps) % 10_000_000) == {0}

    # It stands: nothing more comes, however long it takes, though the inputs go on.
    stood = one.now()
    one.until(lambda: one.now() > stood + SECOND, "what was on its way")
    count = len(sim.forces)
    one.peer.create_timer(0.01, sim.send)
    one.until(lambda: one.now() > stood + 2 * SECOND, "a second of standing")
    assert len(sim.forces) == count

    # It goes back, as a looping bag does: it starts again from there.
    sim.to(10 * SECOND)
    sim.run(10_000_000, lambda: len(sim.forces) > count + 20)
    stamps = [stamp_of(message) for message in sim.forces[count:]]
    assert all(10 * SECOND <= stamp <= sim.time for stamp in stamps)
    assert min(np.diff(stamps)) > 0
    assert all(near(message.wrench.force, MODAL, 50.0, 4000.0) for message in sim.forces)


def test_slow_simulated_time_keeps_the_period(bench):
    # A simulation at a tenth of real time: the node's timer comes ten times in each of its periods.
    one = bench("-p", "use_sim_time:=true", "-p", "rate_hz:=100.0")
    sim = SimulatedTime(one, 1000 * SECOND)
    real = one.now()
    begin = sim.time

    def follow() -> bool:
        sim.to(begin + (one.now() - real) // 10)
        return len(sim.forces) > 30

    one.until(follow, "thirty axle wrenches")
    differences = np.diff([stamp_of(message) for message in sim.forces])
    assert differences.min() == 10_000_000 and set(differences % 10_000_000) == {0}


def test_two_nodes_run_side_by_side(bench, tmp_path):
    directory = f"log.directory:={tmp_path}"
    one = bench("-r", "__ns:=/a", "-p", directory)
    other = bench("-r", "__ns:=/b", "-p", directory)
    other.until(lambda: other.peer.count_publishers("/a/wheel/axle_wrench"), "the first node, seen by the second")
    assert len(list(tmp_path.glob("tire_dynamics_*"))) == 2
    one.close()
    other.close()
    assert len(list(tmp_path.glob("tire_dynamics_*/metadata.yaml"))) == 2
