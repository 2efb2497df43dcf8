"""Many messages at a time, in files and in bytes: exactly what one message at a time gives."""

from __future__ import annotations

import io
import shutil
import tracemalloc
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType
from mcap.writer import Writer as LibraryWriter
from rosbags.rosbag2 import Reader as RosbagsReader
from rosbags.typesys import Stores, get_typestore

from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.bag import reader as reader_module
from tire_dynamics.bag import records as records_module
from tire_dynamics.bag.chunks import ChunkWriter
from tire_dynamics.cdr import messages
from tire_dynamics.cdr.messages import (
    DeflectionEncoder,
    JointStateDecoder,
    MessageError,
    RingShapeEncoder,
    WrenchEncoder,
    encode_clock,
    encode_float64,
)
from tire_dynamics.files.errors import InputError

store = get_typestore(Stores.ROS2_JAZZY)
T = store.types

Messages = list[tuple[int, int, int, bytes]]  # topic (from 1), log time, publish time, data

message_lists = st.lists(
    st.tuples(
        st.integers(1, 3),
        st.integers(0, 40) | st.integers(0, 2**63 - 1),
        st.integers(0, 2**63 - 1),
        st.binary(max_size=60) | st.binary(min_size=250, max_size=400),  # longer than a chunk
    ),
    max_size=60,
)
blocks_of = st.lists(st.integers(1, 30), max_size=8)  # how many messages go into each call


def columns(some: Messages):
    topic, log_time, publish_time, data = zip(*some, strict=True)
    return np.array(topic), np.array(log_time, np.int64), np.array(publish_time, np.int64), list(data)


def mcap_of(folder: Path) -> Path:
    return folder / f"{folder.name}_0.mcap"


# --- the file that is written ---


def fill(writer, sent: Messages) -> None:
    """The same calls to the mcap library's writer and to ours; topics come when others have had messages."""
    writer.start("ros2", "library")
    writer.add_metadata("first", {"key": "value", "other": ""})
    schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data\n" * 5)
    known = 0
    for number, (topic, log_time, publish_time, data) in enumerate(sent):
        while known < topic:
            known = writer.register_channel(f"/t{known + 1}", "cdr", schema, {"offered_qos_profiles": "- 1"})
        writer.add_message(topic, log_time, data, publish_time)
        if number % 25 == 24:
            writer.flush()
    writer.add_metadata("last", {})
    writer.finish()


@settings(deadline=None)
@given(message_lists, st.integers(0, 1000), st.sampled_from(["", "lz4"]))
def test_the_file_is_the_mcap_librarys_byte_for_byte(sent, chunk_size, compression):
    """Chunks, indexes, statistics, summary, checksums. Of zstd our level is another: see the next test."""
    kind = {"": CompressionType.NONE, "lz4": CompressionType.LZ4}[compression]
    ours, theirs = io.BytesIO(), io.BytesIO()
    fill(ChunkWriter(ours, chunk_size, compression), sent)
    fill(LibraryWriter(theirs, chunk_size, kind), sent)
    assert ours.getvalue() == theirs.getvalue()


def test_zstd_chunks_hold_what_the_mcap_librarys_do(tmp_path):
    sent = [(1 + i % 3, i, i + 1, encode_float64(i)) for i in range(500)]
    ours, theirs = io.BytesIO(), io.BytesIO()
    fill(ChunkWriter(ours, 1000, "zstd"), sent)
    fill(LibraryWriter(theirs, 1000, CompressionType.ZSTD), sent)
    contents = []
    for stream in (ours, theirs):
        stream.seek(0)
        chunks = [record for record in StreamReader(stream, emit_chunks=True).records if isinstance(record, Chunk)]
        contents.append([(zstandard.decompress(c.data), c.uncompressed_crc, c.message_end_time) for c in chunks])
    assert contents[0] == contents[1] and len(contents[0]) > 10


def write_records(writer: BagWriter, some: Messages) -> None:
    """Messages as the records of a file that they are in, made by the mcap library."""
    data, starts = RecordBuilder(), []
    for topic, log_time, publish_time, payload in some:
        starts.append(data.count)
        Message(topic, log_time, payload, publish_time, 0).write(data)
    counts = Counter(message[0] for message in some)
    times = [message[1] for message in some]
    writer.write_records(data.end(), np.array(starts, np.int64), counts, (min(times), max(times)))


def write_bag(
    folder: Path, sent: Messages, calls: list[int] | None = None, *, as_records: bool = False, **options
) -> bytes:
    """The bytes of a bag's file, written message by message or some at a time."""

    def write_some(some: Messages) -> None:
        if as_records:
            write_records(writer, some)
        else:
            writer.write_block(*columns(some))

    shutil.rmtree(folder, ignore_errors=True)
    with BagWriter(folder, **options) as writer:
        handles = [writer.add_topic(f"/t{i}", messages.FLOAT64) for i in range(3)]
        assert handles == [1, 2, 3]
        if calls is None:
            for message in sent:
                writer.write(*message)
        else:
            rest = sent
            for count in calls:
                if rest:
                    write_some(rest[:count])
                for message in rest[count : count + 1]:  # the two may take turns
                    writer.write(*message)
                rest = rest[count + 1 :]
            if rest:
                write_some(rest)
    return mcap_of(folder).read_bytes() + (folder / "metadata.yaml").read_bytes()


@pytest.mark.slow
@settings(deadline=None, max_examples=50)
@given(message_lists, blocks_of, st.booleans(), st.integers(0, 10_000), st.sampled_from(["", "lz4", "zstd"]))
def test_a_block_is_written_as_its_messages_are(tmp_path_factory, sent, calls, as_records, chunk_size, compression):
    """The same bytes, so the same chunks: also with topics whose declarations alone fill a chunk."""
    folder = tmp_path_factory.getbasetemp() / "block"
    options = {"chunk_size": chunk_size, "compression": compression}
    assert write_bag(folder, sent, calls, as_records=as_records, **options) == write_bag(folder, sent, **options)


@pytest.mark.parametrize("as_records", [False, True])
@pytest.mark.parametrize("chunk_size", [30, 31, 32, 61, 62, 63])
def test_a_block_ends_its_chunks_where_its_messages_do(tmp_path, chunk_size, as_records):
    sent = [(1, i, i, b"") for i in range(20)]  # of 31 bytes each
    found = write_bag(tmp_path / "bag", sent, [8], as_records=as_records, chunk_size=chunk_size)
    assert found == write_bag(tmp_path / "bag", sent, chunk_size=chunk_size)


def test_records_before_all_times_or_of_no_messages(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/t0", messages.FLOAT64)
        with pytest.raises(ValueError, match="below 0"):
            writer.write_records(bytes(31), np.zeros(1, np.int64), {1: 1}, (-1, 5))
        writer.write_records(b"", np.zeros(0, np.int64), {}, (0, 0))
        write_records(writer, [(1, 7, 8, b"x")])
    reader = BagReader(tmp_path / "bag")
    assert [message[2:] for message in reader.messages()] == [(7, 8, b"x")]
    assert reader.message_count == 1


def test_one_topic_and_time_for_all_of_a_block(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/t0", messages.FLOAT64)
        writer.write_block(1, 5, 6, [b"a", b"b"])
        writer.write_block([], [], [], [])
    got = [message[2:] for message in BagReader(tmp_path / "bag").messages()]
    assert got == [(5, 6, b"a"), (5, 6, b"b")]


def test_a_block_that_cannot_be_written_leaves_no_trace(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/t0", messages.FLOAT64)
        for topic, log_time, publish_time in ((1, -1, 0), (1, 0, -1), (2, 0, 0), (0, 0, 0), ([1, 1, 1], 0, 0)):
            with pytest.raises(ValueError):
                writer.write_block(topic, log_time, publish_time, [b"a", b"b"])
        with pytest.raises(TypeError):
            writer.write(1, 0, 0, [1, 2])
        writer.write_block(1, 0, 0, [b"c"])
    reader = BagReader(tmp_path / "bag")
    assert reader.message_count == 1 and [message[4] for message in reader.messages()] == [b"c"]


SENT = [(1 + i % 3, 10**18 + 1000 * (i - i % 4), 10**18 + i, encode_float64(i)) for i in range(200)]


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
@pytest.mark.parametrize("chunk_size", [0, 500, 10**6])
def test_every_reader_finds_the_messages_of_blocks(tmp_path, compression, chunk_size):
    write_bag(tmp_path / "bag", SENT, [70, 1, 60], compression=compression, chunk_size=chunk_size)
    path = mcap_of(tmp_path / "bag")
    expected = [(f"/t{topic - 1}", *rest) for topic, *rest in SENT]
    for make in (make_reader, NonSeekingReader):
        with open(path, "rb") as file:
            stream = make(file, validate_crcs=True).iter_messages()
            assert [(c.topic, m.log_time, m.publish_time, m.data) for _, c, m in stream] == expected
    with open(path, "rb") as file:  # by the message index
        found = make_reader(file).iter_messages(["/t1"])
        assert [message.data for _, _, message in found] == [message[3] for message in SENT if message[0] == 2]
    with RosbagsReader(tmp_path / "bag") as reader:
        assert [(c.topic, t, raw) for c, t, raw in reader.messages()] == [
            (t, log, data) for t, log, _, data in expected
        ]
    got = BagReader(path).messages()
    assert [(topic, log, publish, data) for topic, _, log, publish, data in got] == expected


# --- the file that is read ---


def rows_of(blocks) -> list[tuple[str, int, int, bytes]]:
    rows = []
    for block in blocks:
        assert len(block.topic)
        for topic, *times, start, size in zip(
            block.topic, block.log_time, block.publish_time, block.start, block.size, strict=True
        ):
            rows.append((block.topics[topic], *times, block.data[start : start + size]))
    return rows


@pytest.mark.slow
@settings(deadline=None)
@given(
    st.lists(st.tuples(st.integers(1, 3), st.integers(0, 30), st.integers(0, 9), st.binary(max_size=40)), max_size=80),
    st.integers(0, 800),
    st.sampled_from([1, 2, 7, 1000]),
    st.sampled_from([0, 300, 10**6]),
    st.sampled_from([3, 10**6]),
)
def test_blocks_hold_the_messages_in_order(tmp_path_factory, sent, chunk_size, least, block, step):
    """Any times, any chunks, overlapping or not, also where blocks end by their bytes and walks by their steps."""
    folder = tmp_path_factory.getbasetemp() / "order"
    write_bag(folder, sent, chunk_size=chunk_size)
    expected = [(f"/t{topic - 1}", *rest) for topic, *rest in sent]
    in_order = sorted(expected, key=lambda message: message[1])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reader_module, "_BLOCK", block)
        patch.setattr(records_module, "_STEP", step)
        for path in (folder, mcap_of(folder)):
            reader = BagReader(path)
            assert rows_of(reader.blocks(least=least)) == in_order
            assert rows_of(reader.blocks(least=least, in_file_order=True)) == expected
            some = [message for message in in_order if message[0] != "/t1"]
            assert rows_of(reader.blocks(("/t0", "/t2"), least=least)) == some
        mcap_of(folder).write_bytes(mcap_of(folder).read_bytes()[:-40])  # no summary: found by a walk
        assert rows_of(BagReader(mcap_of(folder)).blocks(least=least)) == in_order


def test_blocks_have_as_many_messages_as_asked_for(tmp_path):
    write_bag(tmp_path / "bag", [(1, i, i, bytes(20)) for i in range(1000)], chunk_size=500)
    sizes = [len(block.topic) for block in BagReader(tmp_path / "bag").blocks(least=100)]
    # A chunk has 10 messages, the first fewer; the last that was read is held back.
    assert sum(sizes) == 1000 and all(100 <= size <= 120 for size in sizes[:-1])
    (block,) = BagReader(tmp_path / "bag").blocks()
    assert len(block.topic) == 1000


def test_a_block_ends_before_it_fills_the_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(reader_module, "_BLOCK", 5000)
    write_bag(tmp_path / "bag", [(1 + i % 3, i, i, bytes(20)) for i in range(1000)], chunk_size=500)
    for topics in (None, ["/t1"]):
        assert all(len(block.data) < 8000 for block in BagReader(tmp_path / "bag").blocks(topics))


def test_memory_does_not_grow_with_the_bag(tmp_path):
    peaks = []
    for count in (6_000, 60_000):
        write_bag(tmp_path / "bag", [(1, i - i % 7, i, bytes(40)) for i in range(count)])
        reader = BagReader(tmp_path / "bag")
        tracemalloc.start()
        try:
            assert sum(len(block.topic) for block in reader.blocks(least=1000)) == count
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert peaks[1] <= 1.1 * peaks[0]


@pytest.mark.parametrize("least", [1, 10**6])
def test_what_stands_before_the_damage_is_read(tmp_path, least):
    write_bag(tmp_path / "bag", [(1, i, i, b"%05d" % i) for i in range(100)], chunk_size=200, compression="")
    path = mcap_of(tmp_path / "bag")
    path.write_bytes(path.read_bytes().replace(b"00050", b"0005x"))
    read = []
    with pytest.raises(InputError, match="does not match its checksum"):
        for block in BagReader(path).blocks(least=least):
            read += rows_of([block])
    assert [message[1] for message in read] == list(range(len(read))) and 40 < len(read) <= 50


@pytest.mark.parametrize("times", [(2**63, 0), (0, 2**64 - 1)])
def test_a_time_that_is_none_is_refused(tmp_path, times):
    path = tmp_path / "file.mcap"
    with open(path, "wb") as file:
        writer = LibraryWriter(file)
        writer.start("ros2")
        channel = writer.register_channel("/t", "cdr", writer.register_schema(messages.FLOAT64, "ros2msg", b""))
        writer.add_message(channel, times[0], b"", times[1])
        writer.finish()
    with pytest.raises(InputError, match="after the year 2262"):
        list(BagReader(path).blocks())


# --- messages as bytes ---


def cdr(message, msgtype, little_endian) -> bytes:
    return bytes(store.serialize_cdr(message, msgtype, little_endian=little_endian))


def time(stamp_ns):
    return T["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))


def wrench(stamp_ns, frame_id, force, little_endian):
    vector = T["geometry_msgs/msg/Vector3"]
    value = T["geometry_msgs/msg/Wrench"](vector(*force), vector(1.0, 2.0, 3.0))
    message = T[messages.WRENCH_STAMPED](T["std_msgs/msg/Header"](time(stamp_ns), frame_id), value)
    return cdr(message, messages.WRENCH_STAMPED, little_endian)


def joint_state(stamp_ns, frame_id, names, positions, velocities, efforts, little_endian):
    arrays = (np.array(values, np.float64) for values in (positions, velocities, efforts))
    message = T[messages.JOINT_STATE](T["std_msgs/msg/Header"](time(stamp_ns), frame_id), names, *arrays)
    return cdr(message, messages.JOINT_STATE, little_endian)


# Few different ones, so that many have the same layout and many nearly the same.
stamps = st.sampled_from([0, 1, -1, 10**18 + 1, 2**31 * 10**9 - 1, -(2**31) * 10**9])
frames = st.sampled_from(["", "axle", "axlf", "rear_axle"])
floats = st.sampled_from([0.0, -2.5, 1e300, float("nan")])
lists = st.lists(floats, max_size=2)
names = st.sampled_from([[], ["a"], ["b"], ["a", "bc"], ["bc", "a"]])
MESSAGES = {
    "wrench": st.builds(wrench, stamps, frames, st.tuples(floats, floats, floats), st.booleans()),
    "joint_state": st.builds(joint_state, stamps, frames, names, lists, lists, lists, st.booleans()),
    "float64": st.builds(
        lambda x, little: cdr(T[messages.FLOAT64](x), messages.FLOAT64, little), floats, st.booleans()
    ),
    "clock": st.builds(
        lambda t, little: cdr(T[messages.CLOCK](time(t)), messages.CLOCK, little), stamps, st.booleans()
    ),
}


@st.composite
def payloads(draw, kind: str) -> list[bytes]:
    """Messages of a few layouts or of more than are told apart, and some that are none."""
    some = draw(st.lists(MESSAGES[kind], min_size=1, max_size=4) | st.lists(MESSAGES[kind], min_size=9, max_size=15))
    result = []
    for message, damage in draw(st.lists(st.tuples(st.sampled_from(some), st.integers(0, 9)), max_size=40)):
        if damage == 0:
            message = message[: draw(st.integers(0, len(message)))]
        elif damage == 1:
            message += bytes(draw(st.integers(1, 8)))
        elif damage == 2:
            message = message[:8] + b"\xff\xff\xff\xff" + message[12:]  # nanosec, if it has one
        elif damage == 3:
            place = draw(st.integers(0, len(message) - 1))
            message = message[:place] + bytes([draw(st.integers(0, 255))]) + message[place + 1 :]
        result.append(message)
    return result


def stretch_of(some: list[bytes]):
    """The messages among other bytes, as in a chunk: data, start, size."""
    size = np.array([len(payload) for payload in some], np.int64)
    return b"".join(b"\xff" * (i % 3) + p for i, p in enumerate(some)), _starts(size), size


def _starts(size):
    return np.cumsum(size + np.arange(len(size)) % 3) - size


def one_by_one(decode, some: list[bytes]) -> list:
    decoded = []
    for payload in some:
        try:
            decoded.append(decode(payload))
        except MessageError:
            decoded.append(None)
    return decoded


def same(block, expected: list, *nothing) -> None:
    """Columns ``valid`` and the rest against rows, None where not valid: ``nothing`` there."""
    rows = [nothing if row is None else row for row in expected]
    assert block[0].tolist() == [row is not None for row in expected]
    for number, column in enumerate(block[1:]):
        np.testing.assert_array_equal(column, np.array([row[number] for row in rows], column.dtype))


@given(payloads("wrench"))
def test_wrenches_decode_as_each_does(some):
    expected = one_by_one(
        lambda data: [getattr(messages.decode_wrench(data), f) for f in ("stamp_ns", "fx", "fz")], some
    )
    same(messages.decode_wrenches(*stretch_of(some)), expected, 0, np.nan, np.nan)


@given(payloads("float64"))
def test_float64s_decode_as_each_does(some):
    expected = one_by_one(lambda data: [messages.decode_float64(data)], some)
    same(messages.decode_float64s(*stretch_of(some)), expected, np.nan)


@given(payloads("clock"))
def test_clocks_decode_as_each_does(some):
    expected = one_by_one(lambda data: [messages.decode_clock(data)], some)
    same(messages.decode_clocks(*stretch_of(some)), expected, 0)


@given(payloads("joint_state"), payloads("joint_state"))
def test_joint_states_decode_as_each_does(before, some):
    """Whatever came before; in groups of equal names and equally many velocities, with as many positions or not."""
    decoder = JointStateDecoder()
    for payload in before:
        one_by_one(decoder.decode, [payload])
    expected = one_by_one(JointStateDecoder().decode, some)
    valid, stamp_ns, groups = decoder.decode_block(*stretch_of(some))
    same((valid, stamp_ns), [state and [state.stamp_ns] for state in expected], 0)
    grouped: dict = {}
    for number, state in enumerate(expected):
        if state is not None:
            as_many = len(state.positions) == len(state.velocities)
            members = grouped.setdefault((state.names, len(state.velocities), as_many), [])
            members.append((number, state.velocities, state.positions))
    assert [(tuple(g[1]), g[2].shape[1], g[3] is not None) for g in groups] == list(grouped)
    for (indices, _, velocities, positions), members in zip(groups, grouped.values(), strict=True):
        assert indices.tolist() == [member[0] for member in members]
        np.testing.assert_array_equal(velocities, np.reshape([member[1] for member in members], velocities.shape))
        if positions is not None:
            np.testing.assert_array_equal(positions, np.reshape([member[2] for member in members], positions.shape))


def test_joint_states_of_one_length_need_not_have_one_layout():
    lengths = ((1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 0))
    some = [joint_state(0, "", ["a"], *([0.5] * n for n in of), True) for of in lengths]
    size = max(len(payload) for payload in some)  # of equal size with the bytes that may follow
    some = [payload + bytes(size - len(payload)) for payload in some]
    _, _, groups = JointStateDecoder().decode_block(*stretch_of(some))
    found = [(g[0].tolist(), g[2].tolist(), g[3] if g[3] is None else g[3].tolist()) for g in groups]
    assert found == [([0, 3], [[0.5]] * 2, [[0.5]] * 2), ([1], [[]], None), ([2], [[0.5]], None)]


@pytest.mark.parametrize("kind", MESSAGES)
def test_a_block_of_no_messages(kind):
    decode = {
        "wrench": messages.decode_wrenches,
        "joint_state": JointStateDecoder().decode_block,
        "float64": messages.decode_float64s,
        "clock": messages.decode_clocks,
    }[kind]
    assert all(len(column) == 0 for column in decode(b"", *np.zeros((2, 0), np.int64)))


@given(st.lists(st.tuples(stamps, floats, floats), max_size=10), frames)
def test_messages_encode_as_each_does(rows, frame_id):
    times = np.array([row[0] for row in rows], np.int64)
    fx, fz = (np.array([row[i] for row in rows]) for i in (1, 2))
    encoder = WrenchEncoder(frame_id)
    assert encoder.encode_block(times, fx, fz) == [encoder.encode(*row) for row in rows]
    assert messages.encode_clocks(times) == [encode_clock(row[0]) for row in rows]
    random = np.random.default_rng(len(rows))
    deflections, shapes = random.normal(size=(len(rows), 2, 7)), random.normal(size=(len(rows), 7, 5))
    ring, shape = DeflectionEncoder(7), RingShapeEncoder(frame_id, 7)
    assert ring.encode_block(deflections) == [ring.encode(one) for one in deflections]
    swapped = np.asfortranarray(shapes)  # values, not memory order
    assert shape.encode_block(times, swapped) == [
        shape.encode(int(t), one) for t, one in zip(times, shapes, strict=True)
    ]


@pytest.mark.parametrize("stamp_ns", [2**31 * 10**9, -(2**31) * 10**9 - 1])
def test_a_stamp_outside_ros_time_is_refused(stamp_ns):
    encoders = (
        lambda: WrenchEncoder("a").encode_block([0, stamp_ns], [0.0, 0.0], [0.0, 0.0]),
        lambda: RingShapeEncoder("a", 1).encode_block([0, stamp_ns], np.zeros((2, 1, 5))),
        lambda: messages.encode_clocks([0, stamp_ns]),
    )
    for encode in encoders:
        with pytest.raises(MessageError, match=f"{stamp_ns} ns is outside the range"):
            encode()


def test_a_ring_of_the_wrong_size_is_refused():
    with pytest.raises(ValueError, match=r"N x \(2, 4\)"):
        DeflectionEncoder(4).encode_block(np.zeros((2, 4)))
    with pytest.raises(ValueError, match=r"N x \(4, 5\)"):
        RingShapeEncoder("a", 4).encode_block([0], np.zeros((1, 5, 4)))
    with pytest.raises(ValueError):
        WrenchEncoder("a").encode_block([0, 1], np.zeros(4), np.zeros(2))
