"""One live node that estimates its loads, from standard messages: outputs, diagnostics, its log replayed."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import Imu, JointState
from simulated_car import Car, Drive, simulate_drives
from std_msgs.msg import Float32MultiArray, Float64, Float64MultiArray
from test_load_source import CAR, PARAMETERS, WHEELS, written

from tire_dynamics import LoadFilter
from tire_dynamics.bag import BagReader
from tire_dynamics.cdr import messages
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay.replay import replay


def arguments_of(parameters):
    return [text for name, value in parameters.items() for text in ("-p", f"{name}:={json.dumps(value)}")]


class Sensors:
    """Publishes a recorded drive as time goes on; those in ``gone`` are silent."""

    def __init__(self, one):
        self.recording = simulate_drives(Car(), [Drive(duration=4.0, bump=0.0)], [3])[0]
        self.clock, self.step, self.gone = one.peer.get_clock(), 0, set()
        self.imu = one.publisher(Imu, "/imu")
        self.travel, self.hub = (one.publisher(Float32MultiArray, f"/{name}") for name in ("travel", "hubs"))
        self.joints = one.publisher(JointState, "/joint_states")
        one.peer.create_timer(0.01, self.send)

    def send(self):
        row = self.step % 400
        self.step += 1
        now = self.clock.now().to_msg()
        message = Imu()
        message.header.stamp = now
        force, rate = (values[2 * row].tolist() for values in self.recording.imu[1:])
        for vector, values in ((message.linear_acceleration, force), (message.angular_velocity, rate)):
            vector.x, vector.y, vector.z = values
        self.imu.publish(message)
        speeds = self.recording.wheel_speed[1][row].tolist()
        joints = JointState(name=WHEELS, velocity=speeds)
        joints.header.stamp = now
        self.joints.publish(joints)
        if "travel" not in self.gone:
            self.travel.publish(Float32MultiArray(data=(1e3 * self.recording.travel[1][row]).tolist()))
        self.hub.publish(Float32MultiArray(data=self.recording.hub[1][5 * row].tolist()))


def test_a_live_estimate_its_diagnostics_and_its_log(bench, tmp_path):
    parameters = {**PARAMETERS, "axle_wrench_covariance": True, "log.directory": str(tmp_path / "logs")}
    one = bench(*arguments_of(parameters))
    loads = one.messages(WrenchStamped, "/front_left/load_estimate")
    deviations = one.messages(Float64, "/front_left/load_standard_deviation")
    covariances = one.messages(Float64MultiArray, "/front_left/axle_wrench_covariance")
    forces = one.messages(WrenchStamped, "/front_left/axle_wrench")
    heard = one.messages(DiagnosticArray, "/diagnostics")
    sensors = Sensors(one)

    def said(degraded):
        found = [status for array in heard for status in array.status if status.name.endswith(": load estimate")]
        values = {item.key: item.value for item in found[-1].values} if found else {}
        return (found[-1], values) if values.get("degraded sources") == degraded else None

    one.until(lambda: min(map(len, (loads, deviations, covariances, forces))) > 200, "loads and forces")
    status, values = one.until(lambda: said("none"), "a diagnosis")
    assert status.level == b"\0" and values["band [Hz]"] == "20"
    assert values["sources in use"] == "wheel_speed, imu, travel, hub"
    assert float(values["front_left: standard deviation [N]"]) > 10.0
    assert covariances[-1].data[14] > 0.0
    sensors.gone.add("travel")
    status, values = one.until(lambda: said("travel"), "a degraded estimate")
    assert status.level == b"\1" and "without travel" in status.message
    sensors.gone.clear()
    one.until(lambda: said("none"), "a recovered estimate")
    one.close()

    (log,) = (tmp_path / "logs").iterdir()
    replay(log, tmp_path / "again", quiet=True)
    names = [
        f"{wheel}/{name}"
        for wheel in WHEELS
        for name in ("axle_wrench", "load_estimate", "load_standard_deviation", "axle_wrench_covariance")
    ]
    first = written(log, names)
    assert all(len(data) > 200 for data in first.values())
    assert written(tmp_path / "again", names) == first
    assert loads_by_hand(log) == [
        [messages.WrenchDecoder().decode(data).fz for data in first[f"{wheel}/load_estimate"]] for wheel in WHEELS
    ]


def loads_by_hand(log):
    """The loads of a filter that is given the log's samples in the order in which they came, and asked at its ticks."""
    from rosbags.typesys import Stores, get_typestore

    store, car, found = get_typestore(Stores.ROS2_JAZZY), LoadFilter(CAR), []
    reader = BagReader(log)
    topics = ["/imu", "/travel", "/hubs", "/joint_states", "/tire_dynamics/tick"]
    for topic, received, _, _, data in ordered(reader, topics):
        if topic == "/tire_dynamics/tick":
            if car.advance(messages.decode_clock(data)):
                found.append(car.load.tolist())
            continue
        message = store.deserialize_cdr(data, reader.topics[topic])
        if topic in ("/imu", "/joint_states"):
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        if topic == "/imu":
            vectors = message.linear_acceleration, message.angular_velocity
            car.add_imu(stamp, *([each.x, each.y, each.z] for each in vectors))
        elif topic == "/joint_states":
            car.add_wheel_speed(stamp, message.velocity)
        elif topic == "/travel":
            car.add_travel(received, [1e-3 * float(value) for value in message.data])
        else:
            car.add_hub(received, message.data)
    return np.array(found).T.tolist()


def ordered(reader, topics):
    """Messages in the order in which they were written."""
    for block in reader.blocks(set(topics), in_file_order=True, least=4096):
        for topic, received, published, start, size in zip(
            block.topic, block.log_time, block.publish_time, block.start, block.size, strict=True
        ):
            yield block.topics[topic], int(received), int(published), None, block.data[start : start + size]


def test_without_a_car_the_node_says_what_it_needs(bench):
    parameters = {name: value for name, value in PARAMETERS.items() if not name.startswith("vehicle.")}
    with pytest.raises(InputError, match=r"missing: sprung_mass \[kg\], unsprung_masses"):
        bench(*arguments_of(parameters))
