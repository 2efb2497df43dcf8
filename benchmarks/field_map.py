"""What the field map costs: processor time of the node with mapped inputs against the node with its own topics.

    python benchmarks/field_map.py [--seconds 10] [--repeats 3] [--json FILE]

Four wheels at 500 Hz, no log, nobody listens. Speeds and loads come at 500 Hz: in joint_states and four WrenchStamped,
in these five by a field map that says what they are anyway, and in one Float32MultiArray by a field map. The first two
have the same messages to receive: what differs is the reading.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable

import rclpy
from geometry_msgs.msg import WrenchStamped
from harness import parser, print_machine, print_table, shown, spread, write_json
from peer import cpu_while_fed, own_domain
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Float32MultiArray

WHEELS = ["front_left", "front_right", "rear_left", "rear_right"]
CASES = ("own topics", "the same, mapped", "one array, mapped")


def command(case: str) -> list[str]:
    """The node's command line."""
    values: dict[str, object] = {"wheels": WHEELS, "rate_hz": 500.0, "tire.zeta_s": 0.3}
    if case == CASES[1]:
        values |= {"inputs.speed.topic": "/joint_states", "inputs.speed.type": "sensor_msgs/msg/JointState"}
        values |= {"inputs.speed.field": "velocity", "inputs.load.topic": "/{wheel}/load"}
        values |= {"inputs.load.type": "geometry_msgs/msg/WrenchStamped", "inputs.load.field": "wrench.force.z"}
    elif case == CASES[2]:
        for quantity, first in (("speed", 0), ("load", 4)):
            values |= {f"inputs.{quantity}.topic": "/bus", f"inputs.{quantity}.type": "std_msgs/msg/Float32MultiArray"}
            values[f"inputs.{quantity}.field"] = [f"data[{k}]" for k in range(first, first + 4)]
    parameters = [text for name, value in values.items() for text in ("-p", f"{name}:={json.dumps(value)}")]
    return [sys.executable, "-m", "tire_dynamics.cli.main", "node", "--ros-args", *parameters, "--log-level", "warn"]


def sender(node: Node, case: str) -> Callable[[], None]:
    """What sends all inputs once."""

    def publisher(kind: type, topic: str) -> rclpy.publisher.Publisher:
        return node.create_publisher(kind, topic, qos_profile_sensor_data)

    if case == CASES[2]:
        bus, array = publisher(Float32MultiArray, "/bus"), Float32MultiArray(data=[60.0] * 4 + [3700.0] * 4)
        return lambda: bus.publish(array)
    joints, loads = publisher(JointState, "/joint_states"), [publisher(WrenchStamped, f"/{w}/load") for w in WHEELS]
    speeds, load = JointState(name=WHEELS, velocity=[60.0] * 4), WrenchStamped()
    load.wrench.force.z = 3700.0

    def send() -> None:
        speeds.header.stamp = load.header.stamp = node.get_clock().now().to_msg()
        joints.publish(speeds)
        for each in loads:
            each.publish(load)

    return send


def measured(case: str, seconds: float) -> float:
    """Processor time of the node [% of a core]."""
    node = Node("feeder")
    try:
        return cpu_while_fed(command(case), node, "front_left/axle_wrench", sender(node, case), seconds)
    finally:
        node.destroy_node()


def main() -> None:
    options = parser(__doc__.splitlines()[0], repeats=3)
    options.add_argument("--seconds", type=float, default=10.0, help="measured in each case (default 10)")
    chosen = options.parse_args()
    print_machine()
    with own_domain():
        rclpy.init(args=[])
        runs = [[measured(case, chosen.seconds) for case in CASES] for _ in range(chosen.repeats)]
        rclpy.shutdown()
    cpu = [spread(run[k] for run in runs) for k in range(3)]
    ratio = [spread(run[k] / run[0] for run in runs) for k in range(3)]
    header = (f"four wheels at 500 Hz, {chosen.seconds:g} s, x{chosen.repeats}", *CASES)
    rows = [("cpu [%]", *(shown(each, ".1f") for each in cpu)), ("over own topics", *map(shown, ratio))]
    print_table(header, rows)
    write_json(chosen.json, "field_map", dict(zip(CASES, cpu, strict=True)))


if __name__ == "__main__":
    main()
