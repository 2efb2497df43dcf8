"""A four-wheel message that the wheels do not have, taken by the field map; replayed where its package is not.

``test_workspace`` runs these in an environment in which the packages are built, and ``make colcon`` in its workspace.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from four_wheel_msgs.msg import FourWheels
from geometry_msgs.msg import WrenchStamped
from rclpy.time import Time

from tire_dynamics.bag import BagReader
from tire_dynamics.cdr.definition import parse_definition
from tire_dynamics.ros.installed import definition_of

REPOSITORY = Path(__file__).parents[2]
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
KIND = "four_wheel_msgs/msg/FourWheels"
MAP = (
    "-p", f"wheels:=[{','.join(WHEELS)}]", "-p", "ring_samples:=8", "-p", "n_max:=5",
    *(f"-p inputs.speed.topic:=/bus/wheels -p inputs.speed.type:={KIND} -p inputs.speed.field:=speed_rpm".split()),
    *(f"-p inputs.load.topic:=/bus/wheels -p inputs.load.type:={KIND} -p inputs.load.field:=load_kn".split()),
    *("-p inputs.speed.unit:=rpm -p inputs.load.unit:=kN".split()),
    *("-p inputs.speed.order:=[rear_left,rear_right,front_left,front_right]".split()),
)  # fmt: skip
OUTPUTS = ("axle_wrench", "ring_deflection", "ring_shape")


def test_a_stacks_own_message_drives_the_wheels_and_its_log_replays_without_its_package(bench, tmp_path):
    one = bench(*MAP, "-p", f"log.directory:={tmp_path / 'logs'}")
    wrenches = one.messages(WrenchStamped, "/front_left/axle_wrench")
    publisher = one.publisher(FourWheels, "/bus/wheels")

    def send() -> None:
        message = FourWheels(
            speed_rpm=np.float32([500.0, 510.0, 520.0, 530.0]), load_kn=np.float32([4.0, 4.1, 3.5, 3.6])
        )
        message.header.stamp = Time(nanoseconds=one.now()).to_msg()
        publisher.publish(message)

    one.peer.create_timer(0.01, send)
    one.until(lambda: len(wrenches) > 500, "a second of forces")
    inputs = one.node._pipeline.vehicle.inputs
    rpm = [each.speed * 30.0 / np.pi for each in inputs]
    assert rpm == pytest.approx([520.0, 530.0, 500.0, 510.0], rel=1e-6)  # of the order of the map
    assert [each.load[0] for each in inputs] == pytest.approx([4000.0, 4100.0, 3500.0, 3600.0], rel=1e-6)
    one.close()
    [log] = (tmp_path / "logs").iterdir()
    without = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "LD_LIBRARY_PATH")}
    without["PYTHONPATH"] = str(REPOSITORY)
    code = (
        "import importlib.util, sys; assert importlib.util.find_spec('four_wheel_msgs') is None;"
        "from tire_dynamics.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, "replay", str(log), "-o", str(tmp_path / "again")],
        env=without, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    for topic in ("/bus/wheels", *(f"/{wheel}/{output}" for wheel in WHEELS for output in OUTPUTS)):
        was, now = (
            [(stamp, data) for _, _, _, stamp, data in BagReader(path).messages([topic])]
            for path in (log, tmp_path / "again")
        )
        assert was == now and len(was) > 40
    text = BagReader(log).definition(KIND)
    assert parse_definition(text, KIND) == parse_definition(definition_of(KIND), KIND)
    assert BagReader(tmp_path / "again").definition(KIND) == text
