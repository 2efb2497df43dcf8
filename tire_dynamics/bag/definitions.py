"""Definitions of the messages that are written to bags, as ROS 2 Jazzy has them.

They are data, so that nothing need be loaded or looked up to begin a log. Every other type is looked up where the ROS
that is there has its definitions, or else in rosbags' collection of them.
"""

from __future__ import annotations

import functools
import json
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from ..cdr.definition import parse_definition

__all__ = ["HASHES", "declaration", "definition", "known", "type_hash"]

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
    return _whole(msgtype, _FIELDS.__getitem__)


@functools.cache
def declaration(msgtype: str) -> tuple[bytes, str] | None:
    """The definition of a type and the hash of its description.

    Parameters
    ----------
    msgtype : str
        One of :data:`HASHES`; or any in the ROS that has been sourced (``AMENT_PREFIX_PATH``); or any that rosbags
        knows, if that is installed.

    Returns
    -------
    tuple of (bytes, str) or None
        As a bag wants them; None if the type is not known.
    """
    if msgtype in HASHES:
        return definition(msgtype).encode(), HASHES[msgtype]
    if not re.fullmatch(r"\w+/msg/\w+", msgtype):
        return None
    return _of_ros(msgtype) or _of_rosbags(msgtype)


def known(msgtype: str) -> str | None:
    """The definition of a type that :func:`declaration` knows."""
    declared = declaration(msgtype)
    return None if declared is None else declared[0].decode()


def type_hash(msgtype: str, text: str) -> str:
    """The hash of a type's description (REP 2016), of its definition; "" if it cannot be made out."""
    declared = declaration(msgtype)
    try:
        if declared and parse_definition(declared[0].decode(), msgtype) == parse_definition(text, msgtype):
            return declared[1]
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(text, msgtype))
        return store.hash_rihs01(msgtype)
    except Exception:  # whatever the library makes of a text that it cannot read, or that it is not there
        return ""


def _of_ros(msgtype: str) -> tuple[bytes, str] | None:
    try:
        described = json.loads(_shared(msgtype, ".json"))
        hashes = {each["type_name"]: each["hash_string"] for each in described["type_hashes"]}
        return _whole(msgtype, lambda name: _shared(name, ".msg")).encode(), str(hashes[msgtype])
    except (OSError, ValueError, KeyError, TypeError):  # not there, or not as rosidl installs it
        return None


def _shared(msgtype: str, ending: str) -> str:
    """A file that a message package has installed; OSError if there is none."""
    package, _, name = msgtype.split("/")
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        file = Path(prefix) / "share" / package / "msg" / f"{name}{ending}"
        if file.is_file():
            return file.read_text(encoding="utf-8")
    raise FileNotFoundError(msgtype)


def _of_rosbags(msgtype: str) -> tuple[bytes, str] | None:
    try:
        from rosbags.typesys import Stores, get_typestore  # a quarter of a second
    except ImportError:
        return None
    store = get_typestore(Stores.ROS2_JAZZY)
    if msgtype not in store.types:
        return None
    text, _ = store.generate_msgdef(msgtype, ros_version=2)
    return text.encode(), store.hash_rihs01(msgtype)


def _whole(msgtype: str, fields: Callable[[str], str]) -> str:
    own, *others = dict.fromkeys(_nested(msgtype, fields))
    behind = (f"{_RULE}\nMSG: {other.replace('/msg/', '/')}\n{fields(other)}" for other in others)
    return "".join([fields(own), *behind])


def _nested(msgtype: str, fields: Callable[[str], str]) -> Iterator[str]:
    """A type and those of its fields, each before its own."""
    yield msgtype
    package = msgtype.split("/")[0]
    for line in fields(msgtype).splitlines():
        words = line.partition("#")[0].split()
        kind = words[0].partition("[")[0] if len(words) > 1 else ""
        if "/" in kind:
            yield from _nested(kind.replace("/", "/msg/"), fields)
        elif kind[:1].isupper():  # of the same package
            yield from _nested(f"{package}/msg/{kind}", fields)
