"""A vehicle on another vendor's middleware: a Cyclone DDS participant that feeds the node and hears it.

A process of its own, with no ROS in it: types and topic names are written out as ROS maps them to DDS. What it sent
and heard goes to a file as JSON, by topic and in order: of what it sent ``[stamp in ns or 0, value, ...]``, of what it
heard the message's fields in their order. Python's JSON keeps every bit of a double.
"""

# The annotations below are looked at by cyclonedds when the classes are made: no `from __future__ import annotations`.

import json
import math
import os
import sys
import time
from dataclasses import astuple, dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import float64, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

PATIENCE = 30.0  # [s] after which what should have happened has not
SECOND = 10**9
STEER = 0.5  # [rad/s], of a joint that is no wheel


@dataclass
@final
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
@final
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
@final
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
@final
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    force: Vector3
    torque: Vector3


@dataclass
@final
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    header: Header
    wrench: Wrench


@dataclass
@final
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
@final
class Float64(IdlStruct, typename="std_msgs::msg::dds_::Float64_"):
    data: float64


@dataclass
@final
class MultiArrayDimension(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayDimension_"):
    label: str
    size: uint32
    stride: uint32


@dataclass
@final
class MultiArrayLayout(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayLayout_"):
    dim: sequence[MultiArrayDimension]
    data_offset: uint32


@dataclass
@final
class Float64MultiArray(IdlStruct, typename="std_msgs::msg::dds_::Float64MultiArray_"):
    layout: MultiArrayLayout
    data: sequence[float64]


@dataclass
@final
class PointField(IdlStruct, typename="sensor_msgs::msg::dds_::PointField_"):
    name: str
    offset: uint32
    datatype: uint8
    count: uint32


@dataclass
@final
class PointCloud2(IdlStruct, typename="sensor_msgs::msg::dds_::PointCloud2_"):
    header: Header
    height: uint32
    width: uint32
    fields: sequence[PointField]
    is_bigendian: bool
    point_step: uint32
    row_step: uint32
    data: sequence[uint8]
    is_dense: bool


@dataclass
@final
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    key: str
    value: str


@dataclass
@final
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
@final
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    header: Header
    status: sequence[DiagnosticStatus]


# Received in the layout that every ROS middleware sends, XCDR version 1.
PLAIN = Policy.DataRepresentation(use_cdrv0_representation=True)
RELIABLE = Qos(PLAIN, Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(4000))
BEST_EFFORT = Qos(PLAIN, Policy.Reliability.BestEffort, Policy.History.KeepLast(5))


class Vehicle:
    """Two wheels: the left one fed with joint states and wrenches, the right one with plain numbers."""

    def __init__(self) -> None:
        # lo alone, found by asking 127.0.0.1: neither needs multicast, neither leaves the machine
        os.environ["CYCLONEDDS_URI"] = (
            "<CycloneDDS><Domain Id='any'><General><Interfaces><NetworkInterface name='lo'/></Interfaces>"
            "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
            "<Peers><Peer address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>"
        )
        self.participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
        self.sent: dict[str, list] = {}
        self.heard: dict[str, list] = {}
        self.writers = {
            topic: DataWriter(self.participant, Topic(self.participant, f"rt{topic}", kind), qos=qos)
            for topic, kind, qos in (
                ("/joint_states", JointState, BEST_EFFORT),
                ("/left/load", WrenchStamped, RELIABLE),
                ("/right/wheel_speed", Float64, RELIABLE),
                ("/right/load_force", Float64, BEST_EFFORT),
            )
        }
        kinds = {"axle_wrench": WrenchStamped, "ring_deflection": Float64MultiArray, "ring_shape": PointCloud2}
        topics = {f"/{wheel}/{name}": kind for wheel in ("left", "right") for name, kind in kinds.items()}
        self.readers = {
            topic: DataReader(self.participant, Topic(self.participant, f"rt{topic}", kind), qos=RELIABLE)
            for topic, kind in (*topics.items(), ("/diagnostics", DiagnosticArray))
        }

    def connected(self) -> bool:
        writers = (writer.get_matched_subscriptions() for writer in self.writers.values())
        readers = (reader.get_matched_publications() for reader in self.readers.values())
        return all(map(len, writers)) and all(map(len, readers))

    def send(self, topic: str, message, *row) -> None:
        self.writers[topic].write(message)
        self.sent.setdefault(topic, []).append(row)

    def drive(self, number: int) -> None:
        """What is measured in the ``number``-th step of 2 ms."""
        stamp = time.time_ns()
        header = Header(Time(*divmod(stamp, SECOND)), "hub")
        t = 0.002 * number
        if number % 5 == 0:
            speed = 60.0 + 20.0 * math.sin(t)
            names = ["left", "steering"] if number % 10 else ["steering", "left"]
            velocity = [speed if name == "left" else STEER for name in names]
            self.send("/joint_states", JointState(header, names, [], velocity, []), stamp, names, velocity)
            self.send("/right/wheel_speed", Float64(-40.0 * math.cos(t)), 0, -40.0 * math.cos(t))
        force, traction = 4000.0 + 600.0 * math.sin(31.0 * t), 300.0 * math.sin(3.0 * t)
        wrench = Wrench(Vector3(traction, 0.0, force), Vector3(0.0, 0.0, 0.0))
        self.send("/left/load", WrenchStamped(header, wrench), stamp, traction, 0.0, force)
        force = 4000.0 + 600.0 * math.sin(31.0 * t + 1.0)
        self.send("/right/load_force", Float64(force), 0, force)

    def hear(self) -> None:
        for topic, reader in self.readers.items():
            for message in reader.take(N=1000):
                if isinstance(message, IdlStruct):  # not the notice that a publisher has gone
                    self.heard.setdefault(topic, []).append(astuple(message))


def main(target: str, wrenches: int) -> None:
    """Drive until so many wrenches of each wheel were heard, and diagnostics; then write everything to a file."""
    vehicle = Vehicle()
    limit = time.monotonic() + PATIENCE
    while not vehicle.connected():
        if time.monotonic() > limit:
            sys.exit("the node was not found")
        time.sleep(0.01)
    due, number = time.monotonic(), 0
    while (
        any(len(vehicle.heard.get(f"/{wheel}/axle_wrench", ())) < wrenches for wheel in ("left", "right"))
        or "/diagnostics" not in vehicle.heard
    ):
        if time.monotonic() > limit:
            sys.exit(f"too little was heard: {[(topic, len(rows)) for topic, rows in vehicle.heard.items()]}")
        vehicle.drive(number)
        vehicle.hear()
        number += 1
        due = max(due + 0.002, time.monotonic() - 0.05)
        time.sleep(max(0.0, due - time.monotonic()))
    time.sleep(0.1)
    vehicle.hear()  # what was still on its way
    with open(target, "w") as file:
        json.dump({"sent": vehicle.sent, "heard": vehicle.heard}, file)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
