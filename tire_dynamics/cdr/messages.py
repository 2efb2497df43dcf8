"""The ROS messages of this package as CDR bytes: the names of the modules of this folder, and the types.

A serialised message is a 4-byte encapsulation header and a body in which every primitive is aligned to its
own size, counted from the start of the body (OMG CDR, "XCDR1", which every ROS 2 middleware reads and
writes). A string is its length with the closing NUL as uint32, then the characters and the NUL; a sequence
is its length as uint32, then its elements.

Encoders fix everything that stays the same from one message to the next when they are made, write little-
endian and zero the padding, so that equal values are equal bytes. Decoders take either byte order, check
every length against the bytes that are there before they use it, and raise ``MessageError`` where the two
disagree.

What takes many messages at a time (``encode_block``, ``decode_wrenches`` and the like) gives exactly what one at a time
gives; ``blocks.py`` says how.

Stamps are integer nanoseconds; forces N, torques N m, angular speeds rad/s.
"""

from __future__ import annotations

from .belt import DeflectionEncoder, RingShapeEncoder, decode_multi_array, ring_points
from .joint_state import JointState, JointStateDecoder, JointStateEncoder, joint_names
from .primitives import MessageError, check_time
from .scalars import (
    decode_clock,
    decode_clocks,
    decode_float64,
    decode_float64s,
    decode_string,
    encode_clock,
    encode_clocks,
    encode_float64,
    encode_string,
)
from .transforms import encode_static_transforms
from .wrench import CovarianceEncoder, WrenchDecoder, WrenchEncoder, WrenchStamped, decode_wrench, decode_wrenches

__all__ = [
    "CLOCK",
    "FLOAT64",
    "FLOAT64_MULTI_ARRAY",
    "JOINT_STATE",
    "POINT_CLOUD",
    "STRING",
    "TF",
    "WRENCH_STAMPED",
    "CovarianceEncoder",
    "DeflectionEncoder",
    "JointState",
    "JointStateDecoder",
    "JointStateEncoder",
    "MessageError",
    "RingShapeEncoder",
    "WrenchDecoder",
    "WrenchEncoder",
    "WrenchStamped",
    "check_time",
    "decode_clock",
    "decode_clocks",
    "decode_float64",
    "decode_float64s",
    "decode_multi_array",
    "decode_string",
    "decode_wrench",
    "decode_wrenches",
    "encode_clock",
    "encode_clocks",
    "encode_float64",
    "encode_static_transforms",
    "encode_string",
    "joint_names",
    "ring_points",
]

CLOCK = "rosgraph_msgs/msg/Clock"
FLOAT64 = "std_msgs/msg/Float64"
FLOAT64_MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
JOINT_STATE = "sensor_msgs/msg/JointState"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
STRING = "std_msgs/msg/String"
TF = "tf2_msgs/msg/TFMessage"
WRENCH_STAMPED = "geometry_msgs/msg/WrenchStamped"
