"""The CDR layouts against two independent implementations: the rosbags library, and ROS's own rclpy."""

from __future__ import annotations

import re
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from tire_dynamics.cdr import messages
from tire_dynamics.cdr.messages import (
    DeflectionEncoder,
    JointStateDecoder,
    JointStateEncoder,
    MessageError,
    RingShapeEncoder,
    WrenchDecoder,
    WrenchEncoder,
    decode_clock,
    decode_float64,
    decode_multi_array,
    decode_string,
    decode_wrench,
    encode_clock,
    encode_float64,
    encode_string,
)

store = get_typestore(Stores.ROS2_JAZZY)
T = store.types

stamps = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)
floats = st.floats(width=64, allow_nan=False)
floats32 = st.floats(width=32, allow_nan=False)


def header(stamp_ns: int, frame_id: str):
    sec, nanosec = divmod(stamp_ns, 10**9)
    return T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](sec, nanosec), frame_id)


def vector(x, y, z):
    return T["geometry_msgs/msg/Vector3"](x, y, z)


def wrench(stamp_ns, frame_id, force, torque=(0.0, 0.0, 0.0)):
    value = T["geometry_msgs/msg/Wrench"](vector(*force), vector(*torque))
    return T[messages.WRENCH_STAMPED](header(stamp_ns, frame_id), value)


def joint_state(stamp_ns, frame_id, names, position, velocity, effort):
    arrays = (np.array(a, np.float64) for a in (position, velocity, effort))
    return T[messages.JOINT_STATE](header(stamp_ns, frame_id), names, *arrays)


def multi_array(dims, data):
    dimension = T["std_msgs/msg/MultiArrayDimension"]
    layout = T["std_msgs/msg/MultiArrayLayout"]([dimension(*dim) for dim in dims], 0)
    return T[messages.FLOAT64_MULTI_ARRAY](layout, np.asarray(data, np.float64))


def cdr(message, msgtype, little_endian=True) -> bytes:
    return bytes(store.serialize_cdr(message, msgtype, little_endian=little_endian))


# --- encoders: the bytes that rosbags writes, which zeroes the padding as we do ---


@given(stamps, texts, floats, floats)
def test_wrench_encodes_as_rosbags_does(stamp_ns, frame_id, fx, fz):
    expected = cdr(wrench(stamp_ns, frame_id, (fx, 0.0, fz)), messages.WRENCH_STAMPED)
    assert WrenchEncoder(frame_id).encode(stamp_ns, fx, fz) == expected


@given(stamps, st.lists(st.tuples(texts, floats), max_size=8))
def test_joint_state_encodes_as_rosbags_does(stamp_ns, joints):
    names, velocities = [name for name, _ in joints], [velocity for _, velocity in joints]
    expected = cdr(joint_state(stamp_ns, "", names, [], velocities, []), messages.JOINT_STATE)
    assert JointStateEncoder(names).encode(stamp_ns, velocities) == expected


@given(st.integers(1, 80), st.randoms(use_true_random=False))
def test_deflection_encodes_as_rosbags_does(points, random):
    deflection = np.array([[random.uniform(-1, 1) for _ in range(points)] for _ in range(2)])
    dims = [("component", 2, 2 * points), ("angle", points, points)]
    expected = cdr(multi_array(dims, deflection.ravel()), messages.FLOAT64_MULTI_ARRAY)
    encoder = DeflectionEncoder(points)
    assert encoder.encode(deflection) == expected
    assert encoder.encode(np.asfortranarray(deflection)) == expected  # values, not memory order


@given(stamps, texts, st.lists(st.tuples(*[floats32] * 5), min_size=1, max_size=20))
def test_ring_shape_encodes_as_rosbags_does(stamp_ns, frame_id, rows):
    field, cloud = T["sensor_msgs/msg/PointField"], T[messages.POINT_CLOUD]
    fields = [field(name, 4 * i, 7, 1) for i, name in enumerate(("x", "y", "z", "radial", "tangential"))]
    data = np.frombuffer(b"".join(struct.pack("<5f", *row) for row in rows), np.uint8)
    width = len(rows)
    message = cloud(header(stamp_ns, frame_id), 1, width, fields, False, 20, 20 * width, data, True)
    assert RingShapeEncoder(frame_id, width).encode(stamp_ns, rows) == cdr(message, messages.POINT_CLOUD)


@given(stamps, floats)
def test_clock_and_float64_encode_as_rosbags_does(stamp_ns, value):
    time = T["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    assert encode_clock(stamp_ns) == cdr(T[messages.CLOCK](time), messages.CLOCK)
    assert encode_float64(value) == cdr(T[messages.FLOAT64](value), messages.FLOAT64)


# --- decoders: what rosbags writes, in both byte orders ---


@given(stamps, texts, st.tuples(floats, floats, floats), st.booleans())
def test_wrench_decodes(stamp_ns, frame_id, force, little_endian):
    data = cdr(wrench(stamp_ns, frame_id, force, (1.0, 2.0, 3.0)), messages.WRENCH_STAMPED, little_endian)
    assert decode_wrench(data) == (stamp_ns, frame_id, *force)


joint_states = st.tuples(
    stamps,
    texts,
    st.lists(texts, max_size=6),
    st.lists(floats, max_size=6),
    st.lists(floats, max_size=6),
    st.lists(floats, max_size=6),
)


@given(st.lists(st.tuples(joint_states, st.booleans()), max_size=5), st.data())
def test_joint_states_decode_whatever_came_before(states, data):
    """The decoder keeps the names from message to message; they must never be another message's."""
    decoder = JointStateDecoder()
    for _ in range(2 * len(states)):
        state, little_endian = data.draw(st.sampled_from(states))
        stamp_ns, _, names, position, velocity, _ = state
        decoded = decoder.decode(cdr(joint_state(*state), messages.JOINT_STATE, little_endian))
        assert decoded == (stamp_ns, tuple(names), tuple(position), tuple(velocity))


@given(st.lists(st.tuples(texts, st.integers(0, 99), st.integers(0, 99)), max_size=4), st.lists(floats))
def test_multi_array_decodes(dims, values):
    for little_endian in (True, False):
        data = cdr(multi_array(dims, values), messages.FLOAT64_MULTI_ARRAY, little_endian)
        decoded_dims, decoded = decode_multi_array(data)
        assert decoded_dims == dims
        np.testing.assert_array_equal(decoded, values)


@given(texts)
def test_string_encodes_and_decodes(text):
    string = T[messages.STRING](text)
    assert encode_string(text) == cdr(string, messages.STRING)
    for little_endian in (True, False):
        assert decode_string(cdr(string, messages.STRING, little_endian)) == text


@given(stamps, floats)
def test_clock_and_float64_decode(stamp_ns, value):
    time = T["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    for little_endian in (True, False):
        assert decode_clock(cdr(T[messages.CLOCK](time), messages.CLOCK, little_endian)) == stamp_ns
        assert decode_float64(cdr(T[messages.FLOAT64](value), messages.FLOAT64, little_endian)) == value


def test_values_that_are_not_finite_pass_through():
    """What to do with them is for the estimator to say; the bytes must not change them."""
    decoded = decode_wrench(WrenchEncoder("a").encode(0, float("nan"), float("-inf")))
    assert np.isnan(decoded.fx) and decoded.fz == float("-inf")


# --- real ROS ---


@pytest.fixture
def ros():
    return pytest.importorskip("rclpy.serialization", reason="needs ROS: pip install .[ros]")


def test_rclpy_reads_what_we_encode(ros):
    from geometry_msgs.msg import WrenchStamped
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import JointState, PointCloud2
    from std_msgs.msg import Float64, Float64MultiArray

    stamp_ns = 1_700_000_000_123_456_789
    data = WrenchEncoder("rear_left_axle").encode(stamp_ns, -1.25, 3e3)
    message = ros.deserialize_message(data, WrenchStamped)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(stamp_ns, 10**9)
    assert message.header.frame_id == "rear_left_axle"
    force, torque = message.wrench.force, message.wrench.torque
    assert (force.x, force.y, force.z) == (-1.25, 0.0, 3e3)
    assert (torque.x, torque.y, torque.z) == (0.0, 0.0, 0.0)

    data = JointStateEncoder(["a", "wheel"]).encode(stamp_ns, (1.5, -2.0))
    message = ros.deserialize_message(data, JointState)
    assert list(message.name) == ["a", "wheel"] and list(message.velocity) == [1.5, -2.0]
    assert not message.position and not message.effort and message.header.frame_id == ""

    deflection = np.arange(6.0).reshape(2, 3)
    message = ros.deserialize_message(DeflectionEncoder(3).encode(deflection), Float64MultiArray)
    dims = [(dim.label, dim.size, dim.stride) for dim in message.layout.dim]
    assert dims == [("component", 2, 6), ("angle", 3, 3)] and message.layout.data_offset == 0
    assert list(message.data) == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]

    shape = np.arange(10.0).reshape(2, 5)
    message = ros.deserialize_message(RingShapeEncoder("axle", 2).encode(stamp_ns, shape), PointCloud2)
    assert (message.height, message.width, message.point_step, message.row_step) == (1, 2, 20, 40)
    assert message.is_dense and not message.is_bigendian and message.header.frame_id == "axle"
    names = [(field.name, field.offset, field.datatype, field.count) for field in message.fields]
    assert names == [(n, 4 * i, 7, 1) for i, n in enumerate(("x", "y", "z", "radial", "tangential"))]
    np.testing.assert_array_equal(np.frombuffer(bytes(message.data), "<f4").reshape(2, 5), shape)

    assert ros.deserialize_message(encode_float64(0.1), Float64).data == 0.1
    clock = ros.deserialize_message(encode_clock(stamp_ns), Clock).clock
    assert (clock.sec, clock.nanosec) == divmod(stamp_ns, 10**9)


def test_we_decode_what_rclpy_serialises(ros):
    from geometry_msgs.msg import WrenchStamped
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64, Float64MultiArray, MultiArrayDimension

    message = WrenchStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = -2, 999_999_999
    message.header.frame_id = "axle"
    message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = 0.1, 0.2, 0.3
    assert decode_wrench(ros.serialize_message(message)) == (-1_000_000_001, "axle", 0.1, 0.2, 0.3)

    decoder = JointStateDecoder()
    for names in (["front_left", "r"], [], ["one"]):
        message = JointState(name=names, position=[7.0], velocity=[0.5] * len(names))
        decoded = decoder.decode(ros.serialize_message(message))
        assert decoded == (0, tuple(names), (7.0,), (0.5,) * len(names))

    message = Float64MultiArray(data=[1.0, 2.0])
    message.layout.dim = [MultiArrayDimension(label="angle", size=2, stride=2)]
    dims, values = decode_multi_array(ros.serialize_message(message))
    assert dims == [("angle", 2, 2)] and values.tolist() == [1.0, 2.0]

    assert decode_float64(ros.serialize_message(Float64(data=-0.25))) == -0.25
    clock = Clock()
    clock.clock.sec, clock.clock.nanosec = 5, 6
    assert decode_clock(ros.serialize_message(clock)) == 5_000_000_006


# --- bytes that lie ---

SAMPLES = {
    "wrench": (decode_wrench, WrenchEncoder("axle").encode(1, 2.0, 3.0)),
    "joint_state": (
        lambda data: JointStateDecoder().decode(data),
        cdr(joint_state(1, "f", ["a", "bc"], [1.0], [2.0, 3.0], []), messages.JOINT_STATE),
    ),
    "multi_array": (decode_multi_array, DeflectionEncoder(3).encode(np.ones((2, 3)))),
    "float64": (decode_float64, encode_float64(1.0)),
    "clock": (decode_clock, encode_clock(1)),
    "string": (decode_string, encode_string("text")),
}


@pytest.mark.parametrize("name", SAMPLES)
def test_every_truncation_is_an_error(name):
    decode, data = SAMPLES[name]
    for length in range(len(data)):
        with pytest.raises(MessageError):
            decode(data[:length])


def test_a_truncated_message_is_an_error_when_its_names_are_known():
    decoder = JointStateDecoder()
    data = SAMPLES["joint_state"][1]
    decoder.decode(data)
    for length in range(len(data)):
        with pytest.raises(MessageError):
            decoder.decode(data[:length])


@given(st.sampled_from(sorted(SAMPLES)), st.data())
def test_damage_is_decoded_or_refused(name, data):
    """Whatever the bytes, the outcome is a value or a MessageError, never another exception."""
    decode, raw = SAMPLES[name]
    damaged = bytearray(raw)
    for _ in range(data.draw(st.integers(1, 6))):
        damaged[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    try:
        decode(bytes(damaged))
    except MessageError as error:
        assert str(error) and "\n" not in str(error)


@pytest.mark.parametrize("length", [2**32 - 1, 2**31, 2**20])
def test_a_length_beyond_the_message_is_refused_before_it_is_used(length):
    lie = struct.pack("<I", length)
    start = b"\0\1\0\0" + struct.pack("<iI", 0, 0)
    no_frame = start + struct.pack("<I", 1) + b"\0" * 4
    for data in (start + lie, no_frame + lie, no_frame + struct.pack("<I", 0) + lie):
        with pytest.raises(MessageError, match=str(length)):
            JointStateDecoder().decode(data + bytes(16))
    with pytest.raises(MessageError, match=str(length)):
        decode_wrench(start + lie + bytes(64))
    with pytest.raises(MessageError, match=str(length)):
        decode_multi_array(b"\0\1\0\0" + lie + bytes(64))


@pytest.mark.parametrize("encapsulation", [b"\x00\x03\x00\x00", b"\x00\x07\x00\x00", b"cdr:"])
def test_another_encapsulation_is_refused(encapsulation):
    with pytest.raises(MessageError, match="not plain CDR"):
        decode_float64(encapsulation + bytes(8))


def test_text_must_be_utf_8_and_end_in_nul():
    good = WrenchEncoder("axle").encode(0, 0.0, 0.0)
    with pytest.raises(MessageError, match="UTF-8"):
        decode_wrench(good.replace(b"axle", b"ax\xffe"))
    with pytest.raises(MessageError, match="NUL"):
        decode_wrench(good.replace(b"axle\0", b"axles"))


# --- stamps ---


@pytest.mark.parametrize("stamp_ns", [2**31 * 10**9, -(2**31) * 10**9 - 1, 2**63])
def test_a_stamp_outside_ros_time_is_refused(stamp_ns):
    encoders = (
        lambda: WrenchEncoder("a").encode(stamp_ns, 0.0, 0.0),
        lambda: JointStateEncoder(["a"]).encode(stamp_ns, [0.0]),
        lambda: RingShapeEncoder("a", 1).encode(stamp_ns, np.zeros((1, 5))),
        lambda: encode_clock(stamp_ns),
    )
    for encode in encoders:
        with pytest.raises(MessageError, match="outside the range"):
            encode()


def test_a_nanosec_of_a_second_or_more_is_refused():
    data = bytearray(WrenchEncoder("a").encode(0, 0.0, 0.0))
    data[8:12] = struct.pack("<I", 10**9)
    with pytest.raises(MessageError, match="nanosec"):
        decode_wrench(bytes(data))


def test_a_ring_of_the_wrong_size_is_refused():
    with pytest.raises(ValueError, match=r"\(2, 4\)"):
        DeflectionEncoder(4).encode(np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"\(4, 5\)"):
        RingShapeEncoder("a", 4).encode(0, np.zeros((4, 4)))


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["", "axle", "wheel", "front_left_axle"]), st.integers(0, 2**40), st.floats(), st.floats(),
            st.sampled_from(["whole", "whole", "cut", "big-endian", "bad nanosec", "noise"]), st.integers(0, 200),
        ),
        max_size=8,
    )
)  # fmt: skip
def test_wrench_decoder_remembers_nothing_but_the_frame(messages):
    """One decoder over any row of messages gives what each gives alone, refusals included."""
    decoder = WrenchDecoder()
    for frame_id, stamp, fx, fz, kind, place in messages:
        data = WrenchEncoder(frame_id).encode(stamp, fx, fz)
        if kind == "cut":
            data = data[: place % len(data)]
        elif kind == "big-endian":
            data = b"\0\0" + data[2:]
        elif kind == "bad nanosec":
            data = data[:8] + b"\xff\xff\xff\x7f" + data[12:]
        elif kind == "noise":
            data = data[: place % len(data)] + bytes([place]) + data[place % len(data) + 1 :]
        try:
            expected = decode_wrench(data)
        except MessageError as error:
            with pytest.raises(MessageError, match=re.escape(str(error))):
                decoder.decode(data)
        else:
            assert repr(decoder.decode(data)) == repr(expected)  # NaN equals itself there
