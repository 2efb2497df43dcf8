"""The rosbags library reads what the node and a replay write, and writes what a replay takes."""

from __future__ import annotations

import numpy as np
import pytest
from exact import exact
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from test_live_log import SECOND, replay

from tire_dynamics import TireWheelUnit, simulate
from tire_dynamics.bag import BagReader
from tire_dynamics.cdr import messages

store = get_typestore(Stores.ROS2_JAZZY)
BEGIN = 1_700_000_000 * SECOND
INPUTS = ("/joint_states", "/wheel_speed", "/load", "/load_force")


def ours(kind: str, data: bytes):
    """A message as this package decodes it; None for a type that it only writes."""
    if kind == messages.WRENCH_STAMPED:
        return [*messages.decode_wrench(data)]
    if kind == messages.JOINT_STATE:
        return [*messages.JointStateDecoder().decode(data)]
    if kind == messages.FLOAT64:
        return messages.decode_float64(data)
    if kind == messages.CLOCK:
        return messages.decode_clock(data)
    if kind == messages.STRING:
        return messages.decode_string(data)
    if kind == messages.FLOAT64_MULTI_ARRAY:
        return [*messages.decode_multi_array(data)]
    return None


def theirs(kind: str, message):
    """The same of a message that rosbags has decoded."""

    def nanoseconds(stamp) -> int:
        return stamp.sec * SECOND + stamp.nanosec

    if kind == messages.WRENCH_STAMPED:
        force = message.wrench.force
        return [nanoseconds(message.header.stamp), message.header.frame_id, force.x, force.y, force.z]
    if kind == messages.JOINT_STATE:
        rows = [list(message.name), message.position.tolist(), message.velocity.tolist()]
        return [nanoseconds(message.header.stamp), *rows]
    if kind == messages.CLOCK:
        return nanoseconds(message.clock)
    if kind == messages.FLOAT64_MULTI_ARRAY:
        return [[(one.label, one.size, one.stride) for one in message.layout.dim], message.data]
    return message.data


@pytest.mark.parametrize("which", ["log", "again"])
def test_it_reads_the_same_from_a_log_and_a_replay(run, which):
    folder = getattr(run, which)
    own = BagReader(folder)
    with Reader(folder) as reader:
        rows = [(connection.topic, connection.msgtype, time, data) for connection, time, data in reader.messages()]
        assert reader.message_count == own.message_count == len(rows)
        assert (reader.start_time, reader.end_time) == (own.start_ns, own.end_ns + 1)  # its end is the first not in it
        assert {connection.topic: connection.msgtype for connection in reader.connections} == own.topics
        for connection in reader.connections:
            assert connection.digest == store.hash_rihs01(connection.msgtype), connection.topic
            assert connection.msgcount == sum(topic == connection.topic for topic, *_ in rows)
            (qos,) = connection.ext.offered_qos_profiles
            depth, reliability = (5, "BEST_EFFORT") if connection.topic.endswith(INPUTS) else (10, "RELIABLE")
            said = (qos.history.name, qos.depth, qos.reliability.name, qos.durability.name)
            assert said == ("KEEP_LAST", depth, reliability, "VOLATILE"), connection.topic
    assert sorted(rows) == sorted((topic, kind, time, data) for topic, kind, time, _, data in own.messages())
    compared = 0
    for topic, kind, _, data in rows:
        value = ours(kind, data)
        if value is not None:
            assert exact(value) == exact(theirs(kind, store.deserialize_cdr(data, kind))), topic
            compared += 1
    assert compared > len(rows) * 0.9


def test_the_belt_in_a_point_cloud_is_that_of_the_array(run):
    """rosbags takes the cloud apart as its fields say: what is in it is the deflection, in single precision."""
    found = {"ring_deflection": [], "ring_shape": []}
    with Reader(run.log) as reader:
        connections = [one for one in reader.connections if one.topic in ("/left/ring_deflection", "/left/ring_shape")]
        for connection, _, data in reader.messages(connections):
            message = store.deserialize_cdr(data, connection.msgtype)
            found[connection.topic.removeprefix("/left/")].append(message)
    assert len(found["ring_shape"]) == len(found["ring_deflection"]) > 30
    for array, cloud in zip(found["ring_deflection"], found["ring_shape"], strict=True):
        assert {one.datatype for one in cloud.fields} == {7}  # FLOAT32
        layout = np.dtype(
            {
                "names": [one.name for one in cloud.fields],
                "formats": ["<f4"] * len(cloud.fields),
                "offsets": [one.offset for one in cloud.fields],
                "itemsize": cloud.point_step,
            }
        )
        points = np.frombuffer(cloud.data.tobytes(), layout)
        radial, tangential = array.data.reshape(2, -1).astype("<f4")
        assert points["radial"].tobytes() == radial.tobytes()
        assert points["tangential"].tobytes() == tangential.tobytes()


def test_a_replay_takes_a_bag_that_it_wrote(tmp_path):
    """Under constant inputs the outputs are what simulate gives from equilibrium."""
    types, now = store.types, BEGIN

    def header():
        stamp = types["builtin_interfaces/msg/Time"](sec=now // SECOND, nanosec=now % SECOND)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="hub")

    vector = types["geometry_msgs/msg/Vector3"]
    nothing = np.empty(0)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        joints = writer.add_connection("/joint_states", messages.JOINT_STATE, typestore=store)
        load = writer.add_connection("/wheel/load", messages.WRENCH_STAMPED, typestore=store)
        for number in range(100):
            now = BEGIN + number * 10_000_000
            speeds = np.array([0.1, 100.0])
            state = types[messages.JOINT_STATE](header(), ["steering", "wheel"], nothing, speeds, nothing)
            writer.write(joints, now, store.serialize_cdr(state, messages.JOINT_STATE))
            wrench = types["geometry_msgs/msg/Wrench"](vector(150.0, 0.0, 4000.0), vector(0.0, 0.0, 0.0))
            message = types[messages.WRENCH_STAMPED](header(), wrench)
            writer.write(load, now, store.serialize_cdr(message, messages.WRENCH_STAMPED))
    replay(tmp_path / "bag", tmp_path / "log")
    with Reader(tmp_path / "log") as reader:
        (connection,) = (one for one in reader.connections if one.topic == "/wheel/axle_wrench")
        outputs = [store.deserialize_cdr(data, messages.WRENCH_STAMPED) for _, _, data in reader.messages([connection])]
    force = np.array([[one.wrench.force.x, one.wrench.force.z] for one in outputs])
    assert len(force) == 496  # 500 Hz from BEGIN, which is a multiple of the period, to the last input at 0.99 s
    time = 2e-3 * np.arange(len(force))
    expected = simulate(TireWheelUnit.table_1(), time, 100.0, 4000.0, traction=150.0).axle_force
    # Both exact but for rounding, of 500 steps among forces of some kN.
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-6)
