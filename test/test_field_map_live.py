"""The field map on a real node: standard messages in, the log replayed, what is odd said, what is wrong refused."""

from __future__ import annotations

import math
import re

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import Log
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float32MultiArray, Float64

from tire_dynamics.bag import BagReader
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay.replay import replay
from tire_dynamics.ros.installed import definition_of

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
OUTPUTS = ("axle_wrench", "ring_deflection", "ring_shape")
STANDARD = {
    "wheels": list(WHEELS), "ring_samples": 8, "n_max": 5,
    "inputs.speed.topic": "/bus/speeds", "inputs.speed.type": "std_msgs/msg/Float32MultiArray",
    "inputs.speed.field": "data", "inputs.speed.unit": "rpm",
    "inputs.load.topic": "/bus/loads", "inputs.load.type": "std_msgs/Float32MultiArray",
    "inputs.load.field": "data", "inputs.load.unit": "kN",
    "inputs.load.order": ["front_right", "front_left", "rear_right", "rear_left"],
    "inputs.travel.topic": "joint_states", "inputs.travel.type": "sensor_msgs/msg/JointState",
    "inputs.travel.field": "position[{wheel}_suspension]", "inputs.travel.sign": -1.0,
    "inputs.imu.topic": "imu", "inputs.imu.type": "sensor_msgs/msg/Imu",
    "inputs.vehicle_speed.topic": "/vehicle/speed", "inputs.vehicle_speed.type": "std_msgs/msg/Float64",
    "inputs.vehicle_speed.field": "data",
}  # fmt: skip
RPM = 60.0 / 6.283185307179586


def arguments(values):
    """As ``-p`` takes them."""
    given = []
    for name, value in values.items():
        text = f"[{','.join(value)}]" if isinstance(value, list) else f"'{value}'" if isinstance(value, str) else value
        given += ["-p", f"{name}:={text}"]
    return given


class Car:
    """What a car publishes, every 10 ms."""

    def __init__(self, one, speeds=(30.0, 31.0, 32.0, 33.0), loads=(4000.0, 4100.0, 3500.0, 3600.0), vehicle=9.6):
        self.speeds, self.loads, self.vehicle = list(speeds), list(loads), vehicle
        self.one, self.count = one, 0
        self.publishers = [
            one.publisher(kind, topic)
            for kind, topic in (
                (Float32MultiArray, "/bus/speeds"), (Float32MultiArray, "/bus/loads"), (JointState, "/joint_states"),
                (Imu, "/imu"), (Float64, "/vehicle/speed"),
            )
        ]  # fmt: skip
        one.peer.create_timer(0.01, self.send)

    def send(self):
        self.count += 1
        wave = 1.0 + 1e-3 * (self.count % 7)  # a speed that does not change at all is odd
        speeds, loads, joints, imu, vehicle = self.publishers
        speeds.publish(Float32MultiArray(data=[RPM * speed * wave for speed in self.speeds]))
        front_left, front_right, rear_left, rear_right = self.loads
        loads.publish(Float32MultiArray(data=[1e-3 * n for n in (front_right, front_left, rear_right, rear_left)]))
        stamp = Time(nanoseconds=self.one.now()).to_msg()
        state = JointState(name=[f"{wheel}_suspension" for wheel in WHEELS], position=[-0.01, 0.02, 0.0, 0.03])
        state.header.stamp = stamp
        joints.publish(state)
        inertial = Imu()
        inertial.header.stamp = stamp
        inertial.linear_acceleration.z = 9.81
        imu.publish(inertial)
        vehicle.publish(Float64(data=self.vehicle))


def test_standard_messages_are_taken_logged_raw_and_replayed_bit_for_bit(bench, tmp_path):
    one = bench(*arguments({**STANDARD, "log.directory": str(tmp_path / "logs")}))
    got = {}
    one.node._pipeline.set_sink(lambda quantity, wheel, stamp, received, values: got.update({quantity: values}))
    wrenches = one.messages(WrenchStamped, "/rear_right/axle_wrench")
    Car(one)
    one.until(lambda: len(wrenches) > 500 and len(got) == 4, "a second of forces, and every source")
    assert got["travel"] == pytest.approx((0.01, -0.02, 0.0, -0.03))
    assert got["imu"] == (0.0, 0.0, 9.81, 0.0, 0.0, 0.0) and got["vehicle_speed"] == (9.6,)
    inputs = one.node._pipeline.vehicle.inputs
    assert [each.speed for each in inputs] == pytest.approx([30.0, 31.0, 32.0, 33.0], abs=0.31)
    assert [each.load[0] for each in inputs] == pytest.approx([4000.0, 4100.0, 3500.0, 3600.0], rel=1e-6)
    assert sorted(one.node._pipeline.inputs) == ["/bus/loads", "/bus/speeds", "/vehicle/speed", "imu", "joint_states"]
    one.close()
    [log] = (tmp_path / "logs").iterdir()
    replay(log, tmp_path / "again")
    for wheel in WHEELS:
        for output in OUTPUTS:
            was, now = (
                [(stamp, data) for _, _, _, stamp, data in BagReader(path).messages([f"/{wheel}/{output}"])]
                for path in (log, tmp_path / "again")
            )
            assert was == now and len(was) > 40
    for topic in ("/bus/speeds", "/imu", "/joint_states"):  # the messages themselves
        assert [*BagReader(log).messages([topic])] == [*BagReader(tmp_path / "again").messages([topic])]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"speeds": (30.0, 31.0, 108.0, 33.0)}, r"rear_left turns 3\.[0-9]+ times as fast as the others"),
        ({"speeds": (30.0, 31.0, 0.0, 33.0)}, r"the speed of rear_left is 0 all the time"),
        ({"speeds": (30.0, -31.0, 32.0, 33.0)}, r"front_right turns the other way than the rest"),
        ({"speeds": [3.6 * 9.6 / RPM] * 4}, r"are the speeds in km/h, and not in rpm\?"),  # of 9.6 m/s
        ({"loads": (4.0, 4.1, 3.5, 3.6)}, r"is it in kN\?"),
    ],
    ids=["km/h", "dead", "sign", "all in km/h", "kN"],
)
def test_a_field_that_contradicts_is_said(bench, change, said):
    """In the diagnostics and on /rosout, within a few looks of a second; once on /rosout, not each second."""
    one = bench(*arguments({**STANDARD, "input_timeout_s": 5.0}))
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    heard: list[Log] = []
    one.peer.create_subscription(Log, "/rosout", heard.append, latched)
    arrays = one.messages(DiagnosticArray, "/diagnostics")
    Car(one, **change)

    def statuses():
        """What each second has said; on a busy machine missed ticks may stand first."""
        nodes = [status for array in arrays for status in array.status if status.name.endswith(": node")]
        return [" ".join([status.message, *(value.value for value in status.values)]) for status in nodes]

    one.until(lambda: any(re.search(said, status) for status in statuses()), "the diagnostics")
    with_it = [re.search(said, status) is not None for status in statuses()].index(True)
    assert with_it <= 5 + 2  # looks of a second; two more before the car began
    one.until(lambda: any(re.search(said, log.msg) for log in heard), "/rosout")
    seen = len(statuses())
    one.until(lambda: len(statuses()) > seen + 2, "three more seconds")
    assert sum(re.search(said, log.msg) is not None for log in heard) == 1


@pytest.mark.slow
def test_a_unit_that_all_wheels_have_is_told_by_an_imu(bench):
    """Speeds in km/h where rpm are said, of a vehicle that speeds up and brakes; no other speed is published."""
    without = {name: value for name, value in STANDARD.items() if "vehicle_speed" not in name}
    one = bench(*arguments({**without, "input_timeout_s": 5.0}))
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    heard: list[Log] = []
    one.peer.create_subscription(Log, "/rosout", heard.append, latched)
    arrays = one.messages(DiagnosticArray, "/diagnostics")
    speeds, imu = one.publisher(Float32MultiArray, "/bus/speeds"), one.publisher(Imu, "/imu")

    def send():
        now = one.now()
        t = 1e-9 * (now % 10**12)
        speeds.publish(Float32MultiArray(data=[3.6 * (15.0 + 4.0 * math.sin(1.5 * t))] * 4))
        inertial = Imu()
        inertial.header.stamp = Time(nanoseconds=now).to_msg()
        inertial.linear_acceleration.x, inertial.linear_acceleration.z = 6.0 * math.cos(1.5 * t), 9.81
        inertial.angular_velocity.y = 1e-3 * math.sin(40.0 * t)  # a sensor that lives
        imu.publish(inertial)

    one.peer.create_timer(0.02, send)
    said = r"as by the imu, .*: are the speeds in km/h, and not in rpm\?"
    one.until(lambda: any(re.search(said, log.msg) for log in heard), "/rosout")
    one.until(
        lambda: any(re.search(said, value.value) for a in arrays for status in a.status for value in status.values),
        "the diagnostics",
    )


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"inputs.speed.type": "absent_msgs/Wheels"}, "/bus/speeds is absent_msgs/msg/Wheels, which is not installed"),
        ({"inputs.speed.field": "speeds"}, "/bus/speeds: std_msgs/msg/Float32MultiArray has no field 'speeds'"),
        ({"inputs.speed.type": ""}, "type of /bus/speeds is empty"),
        ({"inputs.load.order": ["front_left", "spare"]}, "inputs.load.order has 'spare', which is no wheel"),
        ({"inputs.speed.unit": "km/h"}, "inputs.speed.radius is 0"),
        ({"inputs.imu.topic": "/joint_states"}, "is /joint_states, an input already; write both in the same way"),
    ],
)
def test_a_map_that_is_wrong_is_refused_in_one_line(bench, changed, said):
    with pytest.raises(InputError) as caught:
        bench(*arguments({**STANDARD, **changed}))
    assert said in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "kind", ["sensor_msgs/msg/Imu", "sensor_msgs/msg/JointState", "diagnostic_msgs/msg/DiagnosticArray"]
)
def test_the_definition_of_an_installed_type_is_that_of_the_common_interfaces(kind):
    from tire_dynamics.bag.definitions import known
    from tire_dynamics.cdr.definition import parse_definition

    assert parse_definition(definition_of(kind), kind) == parse_definition(known(kind), kind)
