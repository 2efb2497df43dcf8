"""Definitions that bags carry, against those that ROS gives the types; the texts are those of rosbags' collections."""

from __future__ import annotations

import sqlite3

import pytest
from rosbags.typesys import Stores, get_typestore
from test_cli import refused
from test_foreign import SQL, ros2

from tire_dynamics.bag import BagReader
from tire_dynamics.bag.definitions import HASHES, definition
from tire_dynamics.bag.fields import OTHER_FIELDS, has_other_fields
from tire_dynamics.cdr.messages import WRENCH_STAMPED

STORES = [store for store in Stores if store is not Stores.EMPTY]


@pytest.mark.parametrize("store", STORES)
def test_no_distribution_has_other_fields(store):
    """Of ROS 2; a definition of ROS 1 has a header with a sequence number, which says nothing about the bytes."""
    types = get_typestore(store)
    for kind in HASHES.keys() & types.types.keys():
        text, _ = types.generate_msgdef(kind, ros_version=2)
        if store is not Stores.ROS1_NOETIC or "uint32 seq" in text:
            assert not has_other_fields(kind, text), text


def test_a_definition_of_another_type_has_other_fields():
    for kind in HASHES:
        for other in HASHES:
            assert has_other_fields(kind, definition(other)) == (kind != other)


TWIST = """\
std_msgs/Header header
geometry_msgs/Twist twist
===
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
===
MSG: geometry_msgs/Twist
Vector3 linear
Vector3 angular
===
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
OWN = definition(WRENCH_STAMPED)


@pytest.mark.parametrize(
    ("text", "other"),
    [
        (TWIST, True),  # the same bytes, but m/s where newtons should be
        (OWN.replace("float64 z", "float32 z"), True),
        (OWN.replace("geometry_msgs/Vector3 torque", "geometry_msgs/Vector3[2] torque"), True),
        (OWN.replace("float64 x\nfloat64 y", "float64 y\nfloat64 x"), True),
        ("float64 data\n", True),
        ("# a comment\n\n" + OWN.replace("float64 x", "  float64   x   # of it"), False),
        (OWN.replace("string frame_id", "uint8 K=3\nstring NAME = 'a b'\nstring frame_id"), False),
        (OWN.replace("builtin_interfaces/Time stamp", "time stamp"), False),
        # nothing is known: no text, one that is none, one that lacks a type, one without an end
        ("", False),
        ("# nothing\n", False),
        ("struct WrenchStamped { double x; };", False),
        ("std_msgs/Header header\na_msgs/B wrench\n", False),
        ("geometry_msgs/WrenchStamped wrench\n===\nMSG: geometry_msgs/WrenchStamped\nWrenchStamped again\n", False),
        ("float64 x\n" * 100_000, False),
    ],
)
def test_names_types_and_order_count(text, other):
    assert has_other_fields(WRENCH_STAMPED, text) is other


def test_a_type_that_is_not_known_has_no_other_fields():
    assert not has_other_fields("my_msgs/msg/Load", "float64 data\n")


@pytest.mark.slow
def test_of_a_sqlite_bag(tmp_path):
    """Recorders since Iron write the definitions into a table."""
    path = ros2(tmp_path / "bag", SQL) / "bag.db3"
    assert set(BagReader(path).encodings.values()) == {"cdr"}
    with sqlite3.connect(path) as database:
        row = "UPDATE message_definitions SET encoded_message_definition = ? WHERE topic_type = ?"
        assert database.execute(row, (TWIST, WRENCH_STAMPED)).rowcount == 1
    encodings = BagReader(path).encodings
    assert {topic for topic, encoding in encodings.items() if encoding == OTHER_FIELDS} == {"/car/front_left/load"}
    words = refused("replay", path, "-o", tmp_path / "out")
    assert "/car/front_left/load is said to be geometry_msgs/msg/WrenchStamped, but the bag's own definition" in words
