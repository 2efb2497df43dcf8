"""The live node and a participant of another vendor's DDS: what either sends is what the other receives."""

from __future__ import annotations

import numpy as np
import pytest
from exact import exact
from live_run import WHEELS, WRENCHES
from rosbags.typesys import Stores, get_typestore
from test_live_log import SECOND, assert_replayed

from tire_dynamics.bag import BagReader
from tire_dynamics.cdr import messages

store = get_typestore(Stores.ROS2_JAZZY)


def logged(run, topic: str) -> list[bytes]:
    return [data for *_, data in BagReader(run.log).messages([topic], in_file_order=True)]


def of_stamp(stamp: list[int]) -> int:
    sec, nanosec = stamp
    return sec * SECOND + nanosec


def in_order(some: list, all_of_them: list) -> bool:
    """Whether ``some`` are among the others, each for itself and in their order."""
    rest = iter(all_of_them)
    return all(any(one == other for other in rest) for one in some)


def test_what_cyclone_sent_is_what_the_node_took(run):
    joints = messages.JointStateDecoder()
    taken = {}
    states = map(joints.decode, logged(run, "/joint_states"))
    taken["/joint_states"] = [[s.stamp_ns, list(s.names), list(s.velocities)] for s in states]
    loads = map(messages.decode_wrench, logged(run, "/left/load"))
    taken["/left/load"] = [[w.stamp_ns, w.fx, w.fy, w.fz] for w in loads]
    for topic in ("/right/wheel_speed", "/right/load_force"):
        taken[topic] = [[0, messages.decode_float64(data)] for data in logged(run, topic)]
    assert taken.keys() == run.sent.keys()
    for topic, rows in taken.items():
        assert in_order([*map(exact, rows)], [*map(exact, run.sent[topic])]), topic
        assert len(rows) > len(run.sent[topic]) / 10, topic  # best effort, five deep: a busy machine loses many


@pytest.mark.parametrize("wheel", WHEELS)
def test_the_wrenches_that_cyclone_heard_are_those_of_the_log(run, wheel):
    """The log begins with the node: every wrench is there."""
    log = {}
    for wrench in map(messages.decode_wrench, logged(run, f"/{wheel}/axle_wrench")):
        log[wrench.stamp_ns] = exact([wrench.frame_id, wrench.fx, wrench.fy, wrench.fz])
    stamps = []
    for (stamp, frame), (force, torque) in run.heard[f"/{wheel}/axle_wrench"]:
        stamps.append(of_stamp(stamp))
        assert exact([frame, *force]) == log[stamps[-1]]
        assert exact(torque) == exact([0.0] * 3)
    assert stamps == sorted(set(stamps)) and len(stamps) >= WRENCHES
    lost = sum(stamps[0] <= stamp <= stamps[-1] for stamp in log) - len(stamps)
    assert lost < len(stamps)  # reliable, but ten deep


@pytest.mark.parametrize("wheel", WHEELS)
def test_the_belts_that_cyclone_heard_are_those_of_the_log(run, wheel):
    arrays = map(messages.decode_multi_array, logged(run, f"/{wheel}/ring_deflection"))
    log = [exact([dimensions, values]) for dimensions, values in arrays]
    heard = [
        exact([[tuple(one) for one in layout[0]], np.array(data)])
        for layout, data in run.heard[f"/{wheel}/ring_deflection"]
    ]
    assert len(heard) > 30 and in_order(heard, log)

    clouds = [store.deserialize_cdr(data, messages.POINT_CLOUD) for data in logged(run, f"/{wheel}/ring_shape")]
    shapes = {of_stamp([one.header.stamp.sec, one.header.stamp.nanosec]): one for one in clouds}
    for (stamp, frame), height, width, fields, big, step, row, data, dense in run.heard[f"/{wheel}/ring_shape"]:
        cloud = shapes[of_stamp(stamp)]
        assert [frame, height, width] == [cloud.header.frame_id, cloud.height, cloud.width]
        assert fields == [[one.name, one.offset, one.datatype, one.count] for one in cloud.fields]
        assert [big, step, row, dense] == [cloud.is_bigendian, cloud.point_step, cloud.row_step, cloud.is_dense]
        assert bytes(data) == cloud.data.tobytes()


def test_the_diagnostics_that_cyclone_heard_are_those_of_the_log(run):
    log = []
    for data in logged(run, "/diagnostics"):
        array = store.deserialize_cdr(data, "diagnostic_msgs/msg/DiagnosticArray")
        values = [[[item.key, item.value] for item in one.values] for one in array.status]
        heads = [[one.level, one.name, one.message, one.hardware_id] for one in array.status]
        log.append([[*head, items] for head, items in zip(heads, values, strict=True)])
    heard = [status for _, status in run.heard["/diagnostics"]]
    assert heard and in_order(heard, log)
    assert heard[-1][0][1] == "tire_dynamics: node"


def test_the_log_of_that_run_replays_bit_for_bit(run):
    assert_replayed(run.log, run.again, WHEELS)
