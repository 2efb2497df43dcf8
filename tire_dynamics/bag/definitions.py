"""Definitions of the messages that are written to bags, as ROS 2 Jazzy has them.

They are data, so that nothing need be loaded or looked up to begin a log. A test holds them against rosbags, whose
collection has every other type.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

__all__ = ["HASHES", "definition", "known", "type_hash"]

_FIELDS: Final = {
    "builtin_interfaces/msg/Time": """\
int32 sec
uint32 nanosec
""",
    "diagnostic_msgs/msg/DiagnosticArray": """\
std_msgs/Header header
diagnostic_msgs/DiagnosticStatus[] status
""",
    "diagnostic_msgs/msg/DiagnosticStatus": """\
byte OK=0
byte WARN=1
byte ERROR=2
byte STALE=3
byte level
string name
string message
string hardware_id
diagnostic_msgs/KeyValue[] values
""",
    "diagnostic_msgs/msg/KeyValue": """\
string key
string value
""",
    "geometry_msgs/msg/Quaternion": """\
float64 x
float64 y
float64 z
float64 w
""",
    "geometry_msgs/msg/Transform": """\
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
""",
    "geometry_msgs/msg/TransformStamped": """\
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
""",
    "geometry_msgs/msg/Vector3": """\
float64 x
float64 y
float64 z
""",
    "geometry_msgs/msg/Wrench": """\
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
""",
    "geometry_msgs/msg/WrenchStamped": """\
std_msgs/Header header
geometry_msgs/Wrench wrench
""",
    "rosgraph_msgs/msg/Clock": """\
builtin_interfaces/Time clock
""",
    "sensor_msgs/msg/JointState": """\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
""",
    "sensor_msgs/msg/PointCloud2": """\
std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense
""",
    "sensor_msgs/msg/PointField": """\
uint8 INT8=1
uint8 UINT8=2
uint8 INT16=3
uint8 UINT16=4
uint8 INT32=5
uint8 UINT32=6
uint8 FLOAT32=7
uint8 FLOAT64=8
string name
uint32 offset
uint8 datatype
uint32 count
""",
    "std_msgs/msg/Float64": """\
float64 data
""",
    "std_msgs/msg/Float64MultiArray": """\
std_msgs/MultiArrayLayout layout
float64[] data
""",
    "std_msgs/msg/Header": """\
builtin_interfaces/Time stamp
string frame_id
""",
    "std_msgs/msg/MultiArrayDimension": """\
string label
uint32 size
uint32 stride
""",
    "std_msgs/msg/MultiArrayLayout": """\
std_msgs/MultiArrayDimension[] dim
uint32 data_offset
""",
    "std_msgs/msg/String": """\
string data
""",
    "tf2_msgs/msg/TFMessage": """\
geometry_msgs/TransformStamped[] transforms
""",
}

HASHES: Final = {
    "diagnostic_msgs/msg/DiagnosticArray": "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    "geometry_msgs/msg/WrenchStamped": "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
    "rosgraph_msgs/msg/Clock": "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    "sensor_msgs/msg/JointState": "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    "sensor_msgs/msg/PointCloud2": "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    "std_msgs/msg/Float64": "RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a",
    "std_msgs/msg/Float64MultiArray": "RIHS01_1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f",
    "std_msgs/msg/String": "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "tf2_msgs/msg/TFMessage": "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
}
"""Type description hashes (REP 2016) of the types that are known here."""

_RULE: Final = 80 * "="


def definition(msgtype: str) -> str:
    """The definition of a type of :data:`HASHES` with those of all types in it, as MCAP's ``ros2msg`` wants it.

    Parameters
    ----------
    msgtype : str
        Such as "geometry_msgs/msg/WrenchStamped".

    Returns
    -------
    str
        Its fields; then, each once and behind a rule, those of the types of its fields, theirs behind them.
    """
    own, *others = dict.fromkeys(_nested(msgtype))
    behind = (f"{_RULE}\nMSG: {other.replace('/msg/', '/')}\n{_FIELDS[other]}" for other in others)
    return "".join([_FIELDS[own], *behind])


def known(msgtype: str) -> str | None:
    """The definition of a type as Jazzy's common interfaces have it; None of other packages' types."""
    if msgtype in HASHES:
        return definition(msgtype)
    from rosbags.typesys import Stores, get_typestore  # every type of the common interfaces; a quarter of a second

    store = get_typestore(Stores.ROS2_JAZZY)
    return str(store.generate_msgdef(msgtype, ros_version=2)[0]) if msgtype in store.types else None


def type_hash(msgtype: str, text: str) -> str:
    """The hash of a type's description (REP 2016), of its definition; "" if it cannot be made out."""
    if msgtype in HASHES:
        return HASHES[msgtype]
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    try:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(text, msgtype))
        return store.hash_rihs01(msgtype)
    except Exception:  # whatever the library makes of a text that it cannot read
        return ""


def _nested(msgtype: str) -> Iterator[str]:
    yield msgtype
    for line in _FIELDS[msgtype].splitlines():
        kind = line.split()[0].removesuffix("[]")
        if "/" in kind:
            yield from _nested(kind.replace("/", "/msg/"))
