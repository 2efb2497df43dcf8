"""The markers against ROS's own classes and against values worked out by hand from the axes of the model."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from tire_dynamics.cdr import messages
from tire_dynamics.cdr.messages import MessageError
from tire_dynamics.replay.pipeline import Pipeline
from tire_dynamics.ros.markers import MARKER_ARRAY, MarkerBuilder

pytest.importorskip("visualization_msgs", reason="ROS's own message classes: the extra `ros`, or a ROS installation")
pytest.importorskip("rclpy", reason="ROS's own serialisation: the extra `ros`, or a ROS installation")

from geometry_msgs.msg import Point
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

store = get_typestore(Stores.ROS2_JAZZY)

SECOND = 10**9
SCALE = 1e-4  # [m/N]

stamps = st.integers(-(2**31) * SECOND, 2**31 * SECOND - 1)
texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)
forces = st.tuples(*[st.floats(-1e6, 1e6)] * 2)


def read(message: bytes) -> list[Marker]:
    return deserialize_message(message, MarkerArray).markers


def coordinates(marker: Marker) -> np.ndarray:
    return np.array([(point.x, point.y, point.z) for point in marker.points])


def circle(points: int, radius: float = 0.3) -> np.ndarray:
    """An undeformed belt: psi from the rear (x = -radius) over the top; see `ring_deflection` in the README."""
    psi = 2 * np.pi * np.arange(points) / points
    return radius * np.stack([-np.cos(psi), np.zeros(points), np.sin(psi)], axis=1)


def test_what_is_drawn():
    belt, axle, contact = read(
        MarkerBuilder("axle", 4, number=3, lifetime=0.25).build(
            12 * SECOND + 34, circle(4), (200.0, 3000.0), (-500.0, 4000.0), SCALE
        )
    )
    assert [marker.ns for marker in (belt, axle, contact)] == ["belt", "axle_force", "contact_load"]
    for marker in (belt, axle, contact):
        assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == (12, 34)
        assert (marker.header.frame_id, marker.id, marker.action) == ("axle", 3, Marker.ADD)
        assert (marker.lifetime.sec, marker.lifetime.nanosec) == (0, SECOND // 4)
        assert marker.color.a == 1.0 and marker.scale.x > 0.0
        place, turn = marker.pose.position, marker.pose.orientation  # none: the points are in the frame itself
        assert (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w) == (0, 0, 0, 0, 0, 0, 1)
    assert (belt.type, axle.type, contact.type) == (Marker.LINE_STRIP, Marker.ARROW, Marker.ARROW)
    # 4 points rearward, up, forward, down, and the first again; the tolerance is rounding of cos and sin
    down, up = (0.0, 0.0, -0.3), (0.0, 0.0, 0.3)
    expected = [(-0.3, 0.0, 0.0), up, (0.3, 0.0, 0.0), down, (-0.3, 0.0, 0.0)]
    np.testing.assert_allclose(coordinates(belt), expected, rtol=0, atol=1e-15)
    # 1e-4 m/N: 200 N forward and 3000 N up from the axle; the road pushes 500 N rearward and 4000 N up
    np.testing.assert_allclose(coordinates(axle), [(0, 0, 0), (0.02, 0.0, 0.3)], rtol=0, atol=1e-15)
    np.testing.assert_allclose(coordinates(contact), [(0.05, 0.0, -0.7), down], rtol=0, atol=1e-15)


@pytest.mark.slow
@examples(10, nightly=100)
@given(stamps, texts, st.integers(3, 100), forces, forces, st.floats(0.0, 1e-2))
def test_others_write_the_same_bytes(stamp_ns, frame_id, points, axle_force, load, scale):
    """What rosbags and ROS read is, written again, what was built: there is no byte that only we see."""
    builder = MarkerBuilder(frame_id, points)
    message = builder.build(stamp_ns, circle(points), axle_force, load, scale)
    assert bytes(store.serialize_cdr(store.deserialize_cdr(message, MARKER_ARRAY), MARKER_ARRAY)) == message
    array = deserialize_message(message, MarkerArray)
    again = bytes(serialize_message(array))  # the padding in it is whatever was there: only its length counts
    assert len(again) == len(message) and deserialize_message(again, MarkerArray) == array
    for marker in array.markers:
        assert divmod(stamp_ns, SECOND) == (marker.header.stamp.sec, marker.header.stamp.nanosec)
        assert marker.header.frame_id == frame_id
        assert np.isfinite(coordinates(marker)).all()


def test_the_array_as_ros_builds_it():
    """Field by field from ROS's classes, so that no field can be at another's place."""
    theirs = MarkerArray()
    belt = circle(5)
    theirs.markers = read(MarkerBuilder("a", 5).build(7, belt, (0.0, 0.0), (0.0, 0.0), SCALE))
    for marker in theirs.markers:
        anew = Marker(ns=marker.ns, type=marker.type)
        anew.header.frame_id = "a"
        anew.header.stamp.nanosec = 7
        anew.pose.orientation.w = 1.0
        anew.scale = marker.scale
        anew.color = ColorRGBA(r=marker.color.r, g=marker.color.g, b=marker.color.b, a=1.0)
        anew.lifetime.nanosec = SECOND // 2
        anew.points = [Point(x=x, y=y, z=z) for x, y, z in coordinates(marker)]
        assert anew == marker


def test_the_road_is_where_the_models_contact_is():
    """The arrow's head at the belt's lowest point also where no sample is at 3 pi/2 exactly."""
    for points in range(3, 80):
        belt = circle(points)
        contact = coordinates(read(MarkerBuilder("a", points).build(0, belt, (0, 0), (0, 100), SCALE))[2])
        assert contact[1, 2] == pytest.approx(belt[:, 2].min(), rel=1e-15)  # two points may be equally low
        assert contact[0, 2] < contact[1, 2] and contact[0, 0] == contact[1, 0]  # pushes up


def test_the_belt_is_the_pipelines():
    """The points of `ring_shape`, with the two columns of deflection behind them, are drawn as they are."""
    pipeline = Pipeline({"ring_samples": 8})
    pipeline.receive("wheel/wheel_speed", 1, messages.encode_float64(0.0))
    pipeline.receive("wheel/load_force", 1, messages.encode_float64(4000.0))
    pipeline.tick(1)
    shape = dict(pipeline.belts())["wheel/ring_shape"]
    points = messages.ring_points(shape, 8)
    belt, _, contact = read(MarkerBuilder("a", 8).build(0, points, (0, 0), (0, 4000), SCALE))
    np.testing.assert_array_equal(coordinates(belt)[:-1], points[:, :3])
    # the contact is where the belt is at psi = 3 pi/2, pressed in; x is rounding of cos(3 pi/2)
    pressed = points[6, 3]
    assert pressed < -0.005
    np.testing.assert_allclose(coordinates(contact)[1], (0, 0, -pipeline.vehicle.unit.radius - pressed), atol=1e-7)


def test_nothing_is_left_from_the_message_before():
    builder, fresh = MarkerBuilder("a", 6), MarkerBuilder("a", 6)
    first = builder.build(5 * SECOND, circle(6, 0.5), (1e3, 2e3), (3e3, 4e3), SCALE)
    kept = bytes(first)
    arguments = (6 * SECOND, circle(6), (1.0, 2.0), (3.0, 4.0), SCALE)
    assert builder.build(*arguments) == fresh.build(*arguments)
    assert first == kept  # a message that was handed out stays what it was


def test_wrong_points_and_stamps_are_refused():
    builder = MarkerBuilder("axle", 4)
    with pytest.raises(ValueError, match="points"):
        builder.build(0, circle(5), (0, 0), (0, 0), SCALE)
    with pytest.raises(MessageError):
        builder.build(2**31 * SECOND, circle(4), (0, 0), (0, 0), SCALE)


def test_the_type_is_known_to_ros():
    package, kind, name = MARKER_ARRAY.split("/")
    assert getattr(sys.modules[f"{package}.{kind}"], name) is MarkerArray
