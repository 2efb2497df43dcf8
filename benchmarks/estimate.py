"""What the load estimate costs: processor time of the node with loads estimated against the node with loads given.

    python benchmarks/estimate.py [--seconds 10] [--repeats 3] [--json FILE]

Four wheels at 500 Hz, no log, nobody listens. With loads given, this process sends each wheel's at 500 Hz; where they
are estimated, an IMU at 250 Hz, travel at 100 Hz and hub accelerations at 500 Hz, each in one message. Wheel speeds
come at 100 Hz in both. The ratio is to be at most 1.5.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import rclpy
from geometry_msgs.msg import WrenchStamped
from harness import parser, print_machine, print_table, shown, spread, write_json
from peer import cpu_while_fed, own_domain
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float32MultiArray

from tire_dynamics import read_vehicle

ROOT = Path(__file__).parents[1]
WHEELS = ["front_left", "front_right", "rear_left", "rear_right"]
TARGET = 1.5


def command(estimated: bool) -> list[str]:
    """The node's command line."""
    values: dict[str, object] = {"wheels": WHEELS, "rate_hz": 500.0, "tire.zeta_s": 0.3}
    if estimated:
        car = read_vehicle(ROOT / "config" / "car.yaml").to_mapping()
        values |= {"load_source": "estimate", **{f"vehicle.{name}": value for name, value in car.items()}}
        values |= {"inputs.imu.topic": "imu", "inputs.imu.type": "sensor_msgs/msg/Imu"}
        for quantity, topic in (("travel", "travel"), ("hub_acceleration", "hubs")):
            values |= {f"inputs.{quantity}.topic": topic, f"inputs.{quantity}.field": "data"}
            values[f"inputs.{quantity}.type"] = "std_msgs/msg/Float32MultiArray"
    parameters = [text for name, value in values.items() for text in ("-p", f"{name}:={json.dumps(value)}")]
    return [sys.executable, "-m", "tire_dynamics.cli.main", "node", "--ros-args", *parameters, "--log-level", "warn"]


class Feeder:
    """Sends what the node needs, at its times."""

    def __init__(self, estimated: bool) -> None:
        self.node = Node("feeder")
        self.clock = self.node.get_clock()
        self.step = 0
        self.joints = self.publisher(JointState, "joint_states")
        self.speeds = JointState(name=WHEELS, velocity=[60.0] * 4)
        self.sends: list[tuple[int, Callable[[], None]]] = [(5, self.send_speeds)]
        if estimated:
            self.imu, self.travel = self.publisher(Imu, "imu"), self.publisher(Float32MultiArray, "travel")
            self.hubs, self.force = self.publisher(Float32MultiArray, "hubs"), Imu()
            ways, accelerations = (Float32MultiArray(data=[value] * 4) for value in (0.002, 9.9))
            self.sends += [
                (5, lambda: self.travel.publish(ways)),
                (1, lambda: self.hubs.publish(accelerations)),
                (2, self.send_imu),  # 250 Hz: what divides 500
            ]
        else:
            self.loads = [self.publisher(WrenchStamped, f"{wheel}/load") for wheel in WHEELS]
            self.load = WrenchStamped()
            self.load.wrench.force.z = 3700.0
            self.sends.append((1, self.send_loads))

    def publisher(self, kind: type, topic: str) -> rclpy.publisher.Publisher:
        return self.node.create_publisher(kind, topic, qos_profile_sensor_data)

    def send_speeds(self) -> None:
        self.speeds.header.stamp = self.clock.now().to_msg()
        self.joints.publish(self.speeds)

    def send_imu(self) -> None:
        self.force.header.stamp = self.clock.now().to_msg()
        self.force.linear_acceleration.x = 0.5 if self.step % 1000 < 500 else -0.5
        self.force.linear_acceleration.z = 9.80665
        self.imu.publish(self.force)

    def send_loads(self) -> None:
        self.load.header.stamp = self.clock.now().to_msg()
        for publisher in self.loads:
            publisher.publish(self.load)

    def send(self) -> None:
        """What is due in this 500th of a second."""
        self.step += 1
        for every, send in self.sends:
            if self.step % every == 0:
                send()


def measured(estimated: bool, seconds: float) -> float:
    """Processor time of the node [% of a core]."""
    feeder = Feeder(estimated)
    try:
        topic = "front_left/load_estimate" if estimated else "front_left/axle_wrench"
        return cpu_while_fed(command(estimated), feeder.node, topic, feeder.send, seconds)
    finally:
        feeder.node.destroy_node()


def main() -> None:
    options = parser(__doc__.splitlines()[0], repeats=3)
    options.add_argument("--seconds", type=float, default=10.0, help="measured in each case (default 10)")
    chosen = options.parse_args()
    print_machine()
    with own_domain():
        rclpy.init(args=[])
        runs = [[measured(estimated, chosen.seconds) for estimated in (False, True)] for _ in range(chosen.repeats)]
        rclpy.shutdown()
    given, estimated = (spread(run[k] for run in runs) for k in (0, 1))
    ratio = spread(run[1] / run[0] for run in runs)
    header = (
        f"four wheels at 500 Hz, {chosen.seconds:g} s, x{chosen.repeats}",
        "given",
        "estimated",
        "ratio",
        "target",
    )
    print_table(header, [("cpu [%]", shown(given, ".1f"), shown(estimated, ".1f"), shown(ratio), f"<= {TARGET}")])
    write_json(chosen.json, "estimate", {"given": given, "estimated": estimated, "ratio": ratio})


if __name__ == "__main__":
    main()
