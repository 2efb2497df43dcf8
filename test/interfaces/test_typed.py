"""The node beside messages that are no part of the wheels: fields instead of JSON, /tf_static, other stacks' messages.

``test_workspace`` runs these in an environment in which the packages are built, and ``make colcon`` in its workspace.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
from four_wheel_msgs.msg import FourWheels
from lifecycle_msgs.srv import ChangeState
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from std_srvs.srv import Trigger
from test_node import near
from tf2_msgs.msg import TFMessage
from tire_dynamics_msgs.msg import Stability, WheelState
from tire_dynamics_msgs.srv import FloquetStability

from tire_dynamics import TireWheelUnit, wheel
from tire_dynamics.bag import BagReader
from tire_dynamics.bag.definitions import HASHES

REPOSITORY = Path(__file__).parents[2]
SPEED, LOAD = 60.0, 4000.0
DEACTIVATE = 4  # lifecycle_msgs/msg/Transition


def numbers(values) -> list[complex]:
    return sorted((complex(value.real, value.imaginary) for value in values), key=lambda z: (z.real, z.imag))


def in_order(values) -> list[complex]:
    return sorted(np.asarray(values).tolist(), key=lambda z: (z.real, z.imag))


def test_the_state_of_a_wheel_has_fields(bench):
    one = bench()
    one.feed(speed=SPEED, load=LOAD)
    states = one.messages(WheelState, "/wheel/state")
    unit = TireWheelUnit.table_1()
    one.until(lambda: states and near(states[-1].force, unit, SPEED, LOAD), "the steady force")
    one.until(lambda: states[-1].stability.verdict and states[-1].stability.speed == SPEED, "its stability")
    state = states[-1]
    assert (state.wheel, state.header.frame_id, state.speed) == ("wheel", "wheel_axle", SPEED)
    assert (state.load, state.traction, state.force.y) == (LOAD, 0.0, 0.0)
    assert not state.force_covariance.any() and state.load_variance == 0.0  # nothing is known of a load that is given
    stamps = [state.header.stamp.sec * 10**9 + state.header.stamp.nanosec for state in states]
    assert all(np.diff(stamps) > 0)
    judged = wheel.stability(unit, SPEED)
    assert state.stability.verdict == Stability.ASYMPTOTICALLY_STABLE
    assert numbers(state.stability.multipliers) == in_order(judged.multipliers)
    assert list(state.stability.spectral_radius) == [judged.spectral_radius]


def test_the_service_has_the_fields_of_the_json(bench):
    one = bench("-p", "tire.radial_nonuniformity:=[2.0, 0.1, 0.0]")
    one.feed(speed=SPEED, load=LOAD)
    one.until(lambda: one.node._pipeline.vehicle.inputs[0].speed == SPEED, "the speed")
    reply = one.call(FloquetStability, "/wheel/stability")
    told = json.loads(one.call(Trigger, "/wheel/floquet_stability").message)
    assert reply.success and not reply.message and reply.wheel == told["wheel"] == "wheel"
    found = reply.stability
    assert told["verdict"] == "asymptotically stable" and found.verdict == Stability.ASYMPTOTICALLY_STABLE
    assert numbers(found.multipliers) == in_order([complex(*pair) for pair in told["multipliers"]])
    assert numbers(found.exponents) == in_order([complex(*pair) for pair in told["exponents_1_s"]])
    assert [*found.period, *found.spectral_radius] == [told["period_s"], told["spectral_radius"]]
    assert [*found.critical_speed] == [told["critical_speed_rad_s"]]
    assert [*found.nearest_tongue] == [told["nearest_tongue_rad_s"]]
    assert found.speed == told["speed_rad_s"] == SPEED
    assert found.irreducible and told["periodicity"] == "irreducible" and not found.contact


def test_at_standstill_there_are_no_multipliers(bench):
    one = bench("-p", "tire.zeta_1:=0.0", "-p", "tire.zeta_s:=0.0")
    found = one.call(FloquetStability, "/wheel/stability").stability
    assert found.verdict == Stability.MARGINALLY_STABLE
    assert not found.period and not found.spectral_radius and not found.multipliers and found.exponents
    assert max(abs(number.real) for number in found.exponents) < 1e-6


def test_on_the_road_the_fields_say_so(bench):
    road = ["load_source:=road", "static_loads:=[4000.0]", "tire.vertical_stiffness:=200000.0", "n_max:=5"]
    one = bench(*(part for value in road for part in ("-p", value)))
    found = one.call(FloquetStability, "/wheel/stability").stability
    assert found.contact and found.exponents


def test_what_is_not_active_answers_in_words(bench):
    one = bench()
    request = ChangeState.Request()
    request.transition.id = DEACTIVATE
    assert one.call(ChangeState, "/tire_dynamics/change_state", request).success
    reply = one.call(FloquetStability, "/wheel/stability")
    assert not reply.success and reply.message == "the node is not active"
    assert reply.stability == Stability()


def test_the_readme_has_their_names(bench):
    node = bench("-p", "wheels:=[a]").node
    readme = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    said = dict(re.findall(r"^\| (?:out|service) \| `<wheel>/(\w+)` \| tire_dynamics_msgs/(\w+) \|", readme, re.M))
    real = {
        **dict(node.get_publisher_names_and_types_by_node("tire_dynamics", "/")),
        **dict(node.get_service_names_and_types_by_node("tire_dynamics", "/")),
    }
    typed = {name: kind for name, [kind] in real.items() if kind.startswith("tire_dynamics_msgs/")}
    assert {name.removeprefix("/a/"): kind.split("/")[-1] for name, kind in typed.items()} == said != {}


def test_the_axles_frames_are_published(bench, tmp_path):
    """To a peer that comes after they were sent; the log has the same bytes' content."""
    one = bench("-p", "tf.parent_frame:=base_link", "-p", f"log.directory:={tmp_path}")
    received = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    one.peer.create_subscription(TFMessage, "/tf_static", received.append, latched)
    one.until(lambda: received, "the transforms")
    [transform] = received[0].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("base_link", "wheel_axle")
    assert transform.transform.rotation.w == 1.0
    [end] = one.peer.get_publishers_info_by_topic("/tf_static")
    assert str(end.topic_type_hash) == HASHES["tf2_msgs/msg/TFMessage"], "what is built here is not what ROS has"
    one.close()
    [log] = tmp_path.glob("tire_dynamics*")
    [(*_, data)] = BagReader(log).messages(["/tf_static"])
    store = get_typestore(Stores.ROS2_JAZZY)
    [logged] = store.deserialize_cdr(data, "tf2_msgs/msg/TFMessage").transforms
    assert (logged.header.frame_id, logged.child_frame_id) == ("base_link", "wheel_axle")


def test_a_stacks_own_message_can_be_had():
    """All wheels in one: what is built from its definition is what others read by the same definition."""
    message = FourWheels(speed_rpm=np.float32([1.5, 2.5, 3.5, 4.5]), load_kn=np.float32([1.0, 2.0, 3.0, 4.0]))
    text = (REPOSITORY / "test/interfaces/four_wheel_msgs/msg/FourWheels.msg").read_text(encoding="utf-8")
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(text, "four_wheel_msgs/msg/FourWheels"))
    read = store.deserialize_cdr(bytes(serialize_message(message)), "four_wheel_msgs/msg/FourWheels")
    assert read.speed_rpm.tolist() == [1.5, 2.5, 3.5, 4.5] and read.load_kn.tolist() == [1.0, 2.0, 3.0, 4.0]


