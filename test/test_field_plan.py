"""Fields read by plans of offsets, against rosbags' decoding of the same bytes."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tire_dynamics.cdr.definition import SIZES, parse_definition
from tire_dynamics.cdr.field_plan import PlanError, find_field, make_plan
from tire_dynamics.cdr.field_reader import FieldReader
from tire_dynamics.cdr.messages import MessageError

RULE = "=" * 80
CAR = f"""\
std_msgs/Header header
# a constant, a default and a comment are no fields of their own
uint8 OK=1
string<=20 label "car"
string[] notes
Wheel[] wheels
Wheel[2] spare
float32[4] loads
int16[<=8] shocks   # mm
builtin_interfaces/Time measured
uint64 since_us
{RULE}
MSG: car_msgs/Wheel
string name
float64 omega
bool flag
float32[3] temperatures
{RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
KIND = "car_msgs/msg/Car"
TYPES = parse_definition(CAR, KIND)


def store_of(text: str, kind: str):
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register({n: f for n, f in get_types_from_msg(text, kind).items() if n not in store.fielddefs})
    return store


STORE = store_of(CAR, KIND)


def wheel(name: str, omega: float, warm: float = 20.0):
    temperatures = np.array([warm, warm + 1.0, warm + 2.0], np.float32)
    return STORE.types["car_msgs/msg/Wheel"](name=name, omega=omega, flag=True, temperatures=temperatures)


def car(frame="base", label="c", notes=("a", "bcd"), omegas=(1.0, 2.0, 3.0, 4.0), stamp=(5, 7), little=True) -> bytes:
    time = STORE.types["builtin_interfaces/msg/Time"]
    message = STORE.types[KIND](
        header=STORE.types["std_msgs/msg/Header"](stamp=time(*stamp), frame_id=frame),
        label=label,
        notes=list(notes),
        wheels=[wheel("w" * k, omega) for k, omega in enumerate(omegas)],
        spare=[wheel("x", 8.0), wheel("yy", 9.0, 50.0)],
        loads=np.array([10.0, 20.0, 30.0, 40.5], np.float32),
        shocks=np.array([-1, 2, -3, 4], np.int16),
        measured=time(-3, 999_999_999),
        since_us=12_345_678,
    )
    return bytes(STORE.serialize_cdr(message, KIND, little_endian=little))


def read(wanted, data, stamp="", unit=0):
    reader = FieldReader([make_plan(TYPES, KIND, wanted, stamp, unit)])
    valid = reader.read(0, data)
    values = [value if there else None for value, there in zip(reader.values, reader.found, strict=True)]
    return valid, values[:-1], reader


@pytest.mark.parametrize("little", [True, False])
@pytest.mark.parametrize(
    ("frame", "label", "notes"), [("", "", ()), ("a", "bc", ("d",)), ("base_link", "x" * 7, ("", "é"))]
)
def test_fields_of_every_kind_behind_texts_of_every_length(little, frame, label, notes):
    wanted = [
        ("wheels.omega", [0, 1, 2, 3]), ("loads", [4, 5, 6, 7]), ("shocks[2]", [8]), ("spare[1].omega", [9]),
        ("spare[1].temperatures[2]", [10]), ("wheels[1].temperatures[0]", [11]), ("spare[0].flag", [12]),
    ]  # fmt: skip
    valid, values, reader = read(wanted, car(frame, label, notes, little=little), "measured")
    assert valid
    assert values == [1.0, 2.0, 3.0, 4.0, 10.0, 20.0, 30.0, 40.5, -3.0, 9.0, 52.0, 20.0, 1.0]
    assert reader.stamp == -3 * 10**9 + 999_999_999


def test_stamps():
    assert read([("loads[0]", [0])], car(), "header.stamp")[2].stamp == 5_000_000_007
    assert read([("loads[0]", [0])], car(), "since_us", 1000)[2].stamp == 12_345_678_000
    assert read([("loads[0]", [0])], car(), "since_us")[2].stamp == 12_345_678
    assert read([("loads[0]", [0])], car())[2].has_stamp is False
    assert not read([("loads[0]", [0])], car(stamp=(1, 10**9)), "header.stamp")[0]  # no time has so many nanoseconds


def test_a_field_may_be_read_twice():
    assert read([("loads[0]", [0]), ("loads[0]", [1]), ("shocks[1]", [2]), ("shocks[1]", [3])], car())[1] == [
        10.0, 10.0, 2.0, 2.0
    ]  # fmt: skip


def test_a_sequence_that_is_too_short_is_not_what_was_meant():
    assert not read([("wheels.omega", [0, 1, 2, 3])], car(omegas=(1.0, 2.0)))[0]
    assert not read([("wheels[3].omega", [0])], car(omegas=(1.0, 2.0)))[0]
    assert read([("wheels[1].omega", [0])], car(omegas=(1.0, 2.0)))[1] == [2.0]


@pytest.mark.parametrize("little", [True, False])
def test_every_beginning_of_a_message_is_refused_or_read_the_same(little):
    """Up to the last byte of what is wanted; and no byte beyond the given size is looked at."""
    whole = car(little=little)
    wanted = [("wheels[2].omega", [0]), ("shocks[3]", [1])]
    for size in range(len(whole)):
        valid, values, _ = read(wanted, whole[:size])
        assert values == [3.0, 4.0] if valid else size < len(whole) - 8  # what is left out stands behind the shocks


@given(st.binary(max_size=200))
@settings(max_examples=200)
def test_bytes_of_any_kind_end_without_an_error(data):
    for head in (b"\0\1\0\0", b"\0\0\0\0", b""):
        read([("wheels.omega", [0, 1]), ("shocks", [2, 3])], head + data, "measured")


def test_by_the_names_of_joints():
    text = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    kind = "sensor_msgs/msg/JointState"
    types, store = parse_definition(text, kind), STORE
    plan = make_plan(types, kind, [("velocity[b]", [0]), ("position[c]", [1]), ("velocity[c]", [2])], "header.stamp")
    reader = FieldReader([plan])
    header = store.types["std_msgs/msg/Header"](stamp=store.types["builtin_interfaces/msg/Time"](1, 0), frame_id="f")

    def state(names, positions, velocities, little=True):
        arrays = [np.array(some, np.float64) for some in (positions, velocities, [])]
        message = store.types[kind](header, list(names), *arrays)
        valid = reader.read(0, bytes(store.serialize_cdr(message, kind, little_endian=little)))
        return valid, [v if f else None for v, f in zip(reader.values, reader.found, strict=True)][:3]

    assert state("abc", [1, 2, 3], [4, 5, 6]) == (True, [5.0, 3.0, 6.0])
    assert state("cab", [1, 2, 3], [4, 5, 6]) == (True, [6.0, 1.0, 4.0])  # in another order, from another sender
    assert state("ab", [1, 2], [4, 5]) == (True, [5.0, None, None])  # of a sender that knows some of them
    assert state("xy", [1, 2], [4, 5]) == (True, [None, None, None])
    assert state("abc", [], [4, 5, 6]) == (True, [5.0, None, 6.0])  # without positions
    assert state("abc", [1, 2, 3], [4, 5, 6], little=False) == (True, [5.0, 3.0, 6.0])


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("speed", "'speed'; it has wheels[].omega"), ("wheels.speed", "wheels[].omega"), ("label", "no number"),
        ("wheels[x].omega", "looks up 'x'"), ("loads[4]", "element 4, but loads has 4"), ("header", "no number"),
        ("loads[", "is not a field's path"), ("wheels..omega", "path"), ("", "path"), ("loads.", "ends with a dot"),
        ("wheels.temperatures", "two arrays"), ("since_us[0]", "single one"), ("wheels", "no number"),
    ],
)  # fmt: skip
def test_a_path_that_is_wrong_is_refused_with_what_there_is(path, said):
    with pytest.raises(PlanError) as caught:
        make_plan(TYPES, KIND, [(path, [0])])
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_what_cannot_be_a_stamp():
    for path in ("label", "wheels.omega", "wheels[0].omega", "nothing"):
        with pytest.raises(PlanError):
            make_plan(TYPES, KIND, [("loads[0]", [0])], path)


@pytest.mark.parametrize(
    "text",
    [
        "float64", "float64 1x", "Wheel wheel", "float64[ x", f"float64 x\n{RULE}\nfloat64 y", "float64 x;",
        "a/b/c/d e\n" * 600,
    ],
)  # fmt: skip
def test_a_text_that_is_no_definition_is_refused(text):
    with pytest.raises(MessageError):
        types = parse_definition(text, "a/msg/B")
        find_field(types, "a/msg/B", "x;")


def test_a_type_that_holds_itself_ends():
    types = parse_definition("B[] b\nB c\nfloat64 x", "a/msg/B")
    with pytest.raises(PlanError, match="nested too deep"):
        make_plan(types, "a/msg/B", [("x", [0])])


# -- any type ---------------------------------------------------------------------------------------------------------

NUMBERS = sorted(set(SIZES) - {"char", "byte"})
FORMS = ["", "[]", "[3]"]


@st.composite
def definitions(draw):
    """A type with fields before, between and behind two that are wanted, some in messages within."""
    field = st.tuples(st.sampled_from([*NUMBERS, "string", "Inner"]), st.sampled_from(FORMS))
    plain = st.tuples(st.sampled_from([*NUMBERS, "string"]), st.sampled_from(FORMS))
    inner = draw(st.lists(plain, min_size=1, max_size=4))
    outer = draw(st.lists(field, min_size=1, max_size=7))
    lines = [f"{kind}{form} f{k}" for k, (kind, form) in enumerate(outer)]
    within = [f"{kind}{form} g{k}" for k, (kind, form) in enumerate(inner)]
    text = "\n".join([*lines, "float64 last", RULE, "MSG: any_msgs/Inner", *within, ""])
    return outer, inner, text


def value_of(draw, store, kind, form, inner):
    def one():
        if kind == "string":
            return draw(st.text("ab", max_size=5))
        if kind == "Inner":
            parts = {f"g{k}": value_of(draw, store, *each, inner) for k, each in enumerate(inner)}
            return store.types["any_msgs/msg/Inner"](**parts)
        if kind == "bool":
            return draw(st.booleans())
        if kind.startswith("float"):
            return draw(st.floats(width=int(kind[5:]), allow_nan=False))
        low, high = (0, 2**53) if kind == "uint64" else (-(2**53), 2**53) if kind == "int64" else bounds(kind)
        return draw(st.integers(low, high))

    if not form:
        return one()
    some = [one() for _ in range(3 if form == "[3]" else draw(st.integers(0, 3)))]
    return some if kind in ("string", "Inner") else np.array(some, np.dtype(kind))


def bounds(kind):
    info = np.iinfo(kind)
    return int(info.min), int(info.max)


def leaves(outer, inner, message):
    """Paths of single numbers that are there, with what they are."""
    def walk(fields, letter, of, before):
        for k, (kind, form) in enumerate(fields):
            value = getattr(of, f"{letter}{k}")
            for index, one in enumerate(value) if form else [(None, value)]:
                path = f"{before}{letter}{k}" + ("" if index is None else f"[{index}]")
                if kind == "Inner":
                    yield from walk(inner, "g", one, f"{path}.")
                elif kind != "string":
                    yield path, float(one)

    yield from walk(outer, "f", message, "")
    yield "last", float(message.last)


@given(st.data())
def test_any_field_of_any_type_is_what_rosbags_reads(data):
    outer, inner, text = data.draw(definitions())
    store = store_of(text, "any_msgs/msg/Outer")
    parts = {f"f{k}": value_of(data.draw, store, *each, inner) for k, each in enumerate(outer)}
    message = store.types["any_msgs/msg/Outer"](**parts, last=data.draw(st.floats(allow_nan=False)))
    little = data.draw(st.booleans())
    raw = bytes(store.serialize_cdr(message, "any_msgs/msg/Outer", little_endian=little))
    told = dict(leaves(outer, inner, store.deserialize_cdr(raw, "any_msgs/msg/Outer")))
    types = parse_definition(text, "any_msgs/msg/Outer")
    readable = []
    for path in told:
        try:
            make_plan(types, "any_msgs/msg/Outer", [(path, [0])])
            readable.append(path)
        except PlanError as error:
            assert "two sequences" in str(error)
    chosen = data.draw(st.lists(st.sampled_from(readable), min_size=1, max_size=4))
    reader = FieldReader([make_plan(types, "any_msgs/msg/Outer", [(path, [k]) for k, path in enumerate(chosen)])])
    assert reader.read(0, raw)
    assert list(reader.values)[: len(chosen)] == [told[path] for path in chosen]


def test_numbers_at_their_ends():
    text = "int8 a\nint16 b\nint32 c\nint64 d\nuint64 e\nuint8 f\nuint16 g\nuint32 h\nfloat32 i\n"
    types = parse_definition(text, "a/msg/B")
    numbers = -128, -32768, -(2**31), -(2**63), 2**64 - 1, 255, 65535, 2**32 - 1, 1.5
    raw = b"\0\1\0\0" + struct.pack("<bxhiqQBxHIf", *numbers)
    reader = FieldReader([make_plan(types, "a/msg/B", [(name, [k]) for k, name in enumerate("abcdefghi")])])
    assert reader.read(0, raw)
    ends = [-128.0, -32768.0, -(2.0**31), -(2.0**63), 2.0**64, 255.0, 65535.0, 2.0**32 - 1, 1.5]
    assert list(reader.values)[:9] == ends
