"""Recover: what is kept of which damage, that it is said, and that others read the bag that comes out."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import tracemalloc
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import Reader

from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.bag import salvage as salvage_module
from tire_dynamics.bag.definitions import definition
from tire_dynamics.cdr import messages
from tire_dynamics.cdr.messages import WrenchEncoder, encode_float64
from tire_dynamics.cli.main import main
from tire_dynamics.cli.recover import recover
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay.replay import replay

REPOSITORY = Path(__file__).parents[1]
BEGIN = 1_700_000_000 * 10**9
ODD_TYPE = "odd_msgs/msg/Odd"  # of no package that anyone has
SCHEMAS = {
    ODD_TYPE: b"# mine\nuint8[] data\n",
    **{kind: f"# mine\n{definition(kind)}".encode() for kind in (messages.FLOAT64, messages.WRENCH_STAMPED)},
}
LATCHED = """\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""  # as recorders before Jazzy wrote it: numbers


class Sent(NamedTuple):
    """A message as the mcap library gives it back."""

    topic: str
    log_time: int
    publish_time: int
    sequence: int
    data: bytes


class Sample(NamedTuple):
    """A file's bytes, its messages by chunk, and where the chunks are."""

    content: bytes
    chunks: list[list[Sent]]
    places: list[tuple[int, int]]

    @property
    def sent(self) -> list[Sent]:
        return [message for chunk in self.chunks for message in chunk]


def make(count: int = 120, chunk_size: int = 700, **options) -> Sample:
    """A file of the mcap library: loads and speeds of a wheel, and messages of a type that nobody knows."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=chunk_size, **options)
    writer.start("ros2", "another recorder")
    writer.add_metadata("note", {"key": "value"})
    types = {"/w/wheel_speed": messages.FLOAT64, "/w/load": messages.WRENCH_STAMPED, "/odd": ODD_TYPE}
    channels = {}
    for topic, kind in types.items():
        schema = writer.register_schema(kind, "ros2msg", SCHEMAS[kind])
        channels[topic] = writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": LATCHED})
    wrench = WrenchEncoder("axle")
    for number in range(count):
        now = BEGIN + 10_000_000 * (number // 3)
        topic = ("/w/wheel_speed", "/w/load", "/odd")[number % 3]
        odd = number.to_bytes(4, "little") * (number % 20)
        data = {"/w/wheel_speed": encode_float64(50.0), "/w/load": wrench.encode(now, 0.0, 4000.0), "/odd": odd}[topic]
        writer.add_message(channels[topic], now, data, now - 7, sequence=number)
    writer.finish()
    stream.seek(0)
    summary = make_reader(stream).get_summary()
    indexes = sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset)
    places = [(i.chunk_start_offset, i.chunk_start_offset + i.chunk_length) for i in indexes]
    chunks = [[] for _ in places]
    for place, message in read_in_file_order(stream):
        chunks[[i for i, (first, last) in enumerate(places) if first <= place < last][0]].append(message)
    return Sample(stream.getvalue(), chunks, places)


def read_in_file_order(stream):
    """Place of the chunk and message, from the library's own reader of records."""
    from mcap import records
    from mcap.stream_reader import StreamReader, breakup_chunk

    stream.seek(0)
    topics = {}
    place = 0
    for record in StreamReader(stream, emit_chunks=True).records:
        parts = [record]
        if isinstance(record, records.Chunk):
            place = stream.tell() - 1  # within the chunk
            parts = breakup_chunk(record)
        for part in parts:
            if isinstance(part, records.Channel):
                topics[part.id] = part.topic
            elif isinstance(part, records.Message):
                yield place, Sent(topics[part.channel_id], part.log_time, part.publish_time, part.sequence, part.data)


def mcap_of(folder: Path) -> Path:
    return folder / f"{folder.name}_0.mcap"


def kept(folder: Path) -> list[Sent]:
    with open(mcap_of(folder), "rb") as stream:
        return [message for _, message in read_in_file_order(stream)]


def recovered(folder: Path, content: bytes):
    """The account, and the messages of the bag that comes out; the damaged file stays as it is."""
    path = folder / "damaged.mcap"
    path.write_bytes(content)
    shutil.rmtree(folder / "out", ignore_errors=True)
    account = recover(path, folder / "out")
    assert path.read_bytes() == content
    got = kept(folder / "out")
    assert len(got) == sum(account.kept.values())
    return account, got


def hit(content: bytes, *places: int) -> bytes:
    damaged = bytearray(content)
    for place in places:
        damaged[place] ^= 0xFF
    return bytes(damaged)


# --- what comes out ---


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.NONE, "enable_crcs": False},
        {"repeat_channels": False, "repeat_schemas": False},
        {"use_statistics": False, "use_summary_offsets": False},
    ],
    ids=str,
)
def test_of_a_whole_file_nothing_is_lost(tmp_path, options):
    sample = make(**options)
    account, got = recovered(tmp_path, sample.content)
    assert got == sample.sent and len(got) == 120
    assert account.whole and not account.gaps and account.bytes_skipped == 0
    assert account.expected == (None if options.get("use_statistics") is False else 120)


def test_others_read_what_comes_out(tmp_path):
    sample = make()
    place = sample.places[5][0] + 100
    account, got = recovered(tmp_path, hit(sample.content, place)[: sample.places[-2][1]])
    out = tmp_path / "out"
    types = {"/w/wheel_speed": messages.FLOAT64, "/w/load": messages.WRENCH_STAMPED, "/odd": ODD_TYPE}
    with open(mcap_of(out), "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2" and summary.statistics.message_count == len(got)
        assert {(s.name, s.encoding, s.data) for s in summary.schemas.values()} == {
            (kind, "ros2msg", SCHEMAS[kind]) for kind in types.values()
        }
        assert all(c.metadata == {"offered_qos_profiles": LATCHED} for c in summary.channels.values())
        assert {record.name: record.metadata for record in reader.iter_metadata()}["note"] == {"key": "value"}
        assert [m.data for _, _, m in reader.iter_messages()] == [m.data for m in got]
    with Reader(out) as reader:
        assert {c.topic: (c.msgtype, c.msgcount) for c in reader.connections} == {
            topic: (kind, account.kept[topic]) for topic, kind in types.items()
        }
        for connection in reader.connections:  # the numbers' names
            (profile,) = connection.ext.offered_qos_profiles
            assert (profile.depth, profile.reliability.name, profile.durability.name) == (
                1,
                "RELIABLE",
                "TRANSIENT_LOCAL",
            )
        assert [(c.topic, t, raw) for c, t, raw in reader.messages()] == [(m.topic, m.log_time, m.data) for m in got]
    ours = BagReader(out)
    assert ours.complete and ours.topics == types
    summary = replay(out, tmp_path / "replayed")
    assert summary.received["w/load"] == account.kept["/w/load"] and summary.written["w/axle_wrench"] > 0


def test_a_bag_of_ours_comes_out_as_it_was(tmp_path):
    """Every type and QoS that BagWriter knows: metadata.yaml and all."""
    with BagWriter(tmp_path / "bag", metadata={"origin": {"a": "b"}}) as writer:
        for number, kind in enumerate((messages.CLOCK, messages.FLOAT64, messages.JOINT_STATE, messages.STRING)):
            handle = writer.add_topic(f"/t{number}", kind, ("default", "sensor_data")[number % 2])
            writer.write(handle, number, number, b"\0\1\0\0" + bytes(100))
    (tmp_path / "again").mkdir()
    assert recover(tmp_path / "bag", tmp_path / "again" / "bag").whole
    before, after = (tmp_path / name / "metadata.yaml" for name in ("bag", "again/bag"))
    assert before.read_text() == after.read_text()
    assert BagReader(tmp_path / "again" / "bag").metadata == BagReader(tmp_path / "bag").metadata


def test_qos_that_cannot_be_made_out_is_left_out_of_the_description_only(tmp_path):
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start("ros2")
    schema = writer.register_schema(messages.FLOAT64, "ros2msg", b"float64 data\n")
    texts = ["", "[", "- history: 9\n", "- {}\n", "- &a [*a]\n", "!!python/object/apply:os.getcwd []", "[" * 9999]
    for number, text in enumerate(texts):
        channel = writer.register_channel(f"/t{number}", "cdr", schema, {"offered_qos_profiles": text})
        writer.add_message(channel, number, encode_float64(0.0), number)
    writer.finish()
    recovered(tmp_path, stream.getvalue())
    information = yaml.safe_load((tmp_path / "out" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    topics = information["topics_with_message_count"]
    assert [topic["topic_metadata"]["offered_qos_profiles"] for topic in topics] == [[]] * len(texts)
    with open(mcap_of(tmp_path / "out"), "rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    assert [channel.metadata["offered_qos_profiles"] for channel in channels] == texts


# --- what is lost ---


@pytest.mark.slow
def test_a_file_cut_off_anywhere_keeps_every_whole_chunk(tmp_path):
    sample = make()
    size = len(sample.content)
    for percent in range(100):
        length = size * percent // 100
        whole = [chunk for chunk, (_, end) in zip(sample.chunks, sample.places, strict=True) if end <= length]
        if not whole:
            (tmp_path / "damaged.mcap").write_bytes(sample.content[:length])
            with pytest.raises(InputError, match="damaged.mcap"):
                recover(tmp_path / "damaged.mcap", tmp_path / "none")
            assert not (tmp_path / "none").exists()
            continue
        account, got = recovered(tmp_path, sample.content[:length])
        assert got == [message for chunk in whole for message in chunk]
        assert not account.whole
        if length < sample.places[-1][1]:
            assert account.gaps == [(got[-1].log_time / 1e9, None)]


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"compression": CompressionType.NONE}, {"compression": CompressionType.LZ4}])
def test_a_damaged_chunk_costs_that_chunk_and_no_more(tmp_path, options):
    """Its opcode, its length, its other lengths, its checksum, its content; the first declares every topic."""
    sample = make(**options)
    for number, (start, end) in enumerate(sample.places):
        for place in (start, start + 1, start + 3, start + 9 + 16, start + 9 + 24, start + 9 + 28, start + 70, end - 1):
            account, got = recovered(tmp_path, hit(sample.content, place))
            rest = [message for i, chunk in enumerate(sample.chunks) if i != number for message in chunk]
            assert got == rest, (number, place - start)
            assert account.expected == 120 and not account.whole
            before = sample.chunks[number - 1][-1].log_time / 1e9 if number else None
            after = sample.chunks[number + 1][0].log_time / 1e9 if number + 1 < len(sample.chunks) else None
            assert account.gaps == [(before, after)]
            if place >= start + 9 + 24:
                assert account.chunks_skipped == 1 and account.bytes_skipped == end - start or place == start + 9 + 28


@pytest.mark.slow
@examples(30, nightly=150)
@given(st.data())
def test_what_is_not_hit_is_kept_and_nothing_is_made_up(tmp_path_factory, data):
    """Bytes changed, put in and taken out anywhere: every chunk that was not hit is there, in order, as it was."""
    sample, folder = SAMPLE, tmp_path_factory.getbasetemp() / "hit"
    folder.mkdir(exist_ok=True)
    content = bytearray(sample.content)
    ends = [0]  # of what was hit, in the old file
    hits = []
    places = data.draw(st.lists(st.integers(8, len(content) - 1), min_size=1, max_size=4, unique=True))
    for place in sorted(places, reverse=True):  # from behind, so that the places before stay
        kind = data.draw(st.sampled_from(["change", "insert", "delete"]))
        some = data.draw(st.binary(min_size=1, max_size=40))
        if kind == "change":
            some = some[: len(content) - place]
            content[place : place + len(some)] = some
            hits.append((place, place + len(some)))
        elif kind == "insert":
            content[place:place] = some
            hits.append((place, place))
        else:
            del content[place : place + len(some)]
            hits.append((place, place + len(some)))
    ends = [
        number
        for number, (start, end) in enumerate(sample.places)
        if all(last < start or first > end or (first == last and first in (start, end)) for first, last in hits)
    ]
    whole = [message for number in ends for message in sample.chunks[number]]
    try:
        _, got = recovered(folder, bytes(content))
    except InputError:
        got = []
    if 0 in ends or min(place for place, _ in hits) > sample.places[-1][1] or not_in_summary(hits, sample):
        assert [m for m in got if m in set(whole)] == whole
    assert set(got) <= set(sample.sent) and len(set(got)) == len(got)


def not_in_summary(hits, sample: Sample) -> bool:
    """Whether the index is as it was: what the first chunk declares stands there again."""
    return all(last <= sample.places[-1][1] for _, last in hits)


SAMPLE = make(count=300, chunk_size=1500)


def test_garbage_between_records_costs_nothing(tmp_path):
    sample = make()
    content = sample.content
    for place in sorted({start for start, _ in sample.places} | {end for _, end in sample.places}, reverse=True):
        # What looks like records: a chunk, a message, zeros.
        content = content[:place] + struct.pack("<BQ", 6, 200) + bytes(90) + b"\5\x30" + bytes(60) + content[place:]
    account, got = recovered(tmp_path, content)
    assert got == sample.sent and not account.whole


def test_a_chunk_within_a_damaged_chunk_is_found(tmp_path):
    """Bytes were lost in a chunk: its length now reaches into the next."""
    sample = make(compression=CompressionType.NONE)
    start, end = sample.places[3]
    content = sample.content[: start + 60] + sample.content[start + 260 :]
    _, got = recovered(tmp_path, content)
    assert got == [message for i, chunk in enumerate(sample.chunks) if i != 3 for message in chunk]


@pytest.mark.parametrize("name", ["chunk index", "statistics", "footer"])
def test_an_index_that_lies_is_not_believed(tmp_path, name):
    sample = make()
    summary_start = sample.content.rindex(struct.pack("<BQ", 15, 4)) + 13
    opcode = {"chunk index": 8, "statistics": 11, "footer": 2}[name]
    content, position = bytearray(sample.content), summary_start
    while position < len(content) - 8:
        kind, length = struct.unpack_from("<BQ", content, position)
        if kind == opcode:
            content[position + 9 : position + 17] = struct.pack("<Q", 12345)
        position += 9 + length
    account, got = recovered(tmp_path, bytes(content))
    assert got == sample.sent
    assert account.expected == (12345 if name == "statistics" else 120)  # the file's word, beside what was kept


def test_declarations_that_are_lost_everywhere_are_said(tmp_path):
    sample = make(repeat_channels=False, repeat_schemas=False)
    with pytest.raises(InputError, match="no message that can be recovered: a chunk"):
        recovered(tmp_path, hit(sample.content, sample.places[0][0] + 100))
    assert not (tmp_path / "out").exists()


def test_messages_outside_chunks(tmp_path):
    stream = io.BytesIO()
    writer = Writer(stream, use_chunking=False)
    writer.start("ros2")
    schema = writer.register_schema(messages.FLOAT64, "ros2msg", b"float64 data\n")
    channel = writer.register_channel("/speed", "cdr", schema)
    places = []
    for time in range(200):
        places.append(stream.tell())
        writer.add_message(channel, time, encode_float64(time), time)
    writer.finish()
    content = stream.getvalue()
    assert [m.log_time for m in recovered(tmp_path, content)[1]] == [*range(200)]
    # A length that is wrong: that message is lost; garbage between two may cost the one before it.
    times = [m.log_time for m in recovered(tmp_path, hit(content, places[50] + 1))[1]]
    assert times == [*range(50), *range(51, 200)]
    damaged = content[: places[80]] + bytes(range(100, 200)) + content[places[80] :]
    times = [m.log_time for m in recovered(tmp_path, damaged)[1]]
    assert times in ([*range(79), *range(80, 200)], [*range(200)])
    times = [m.log_time for m in recovered(tmp_path, content[: places[150] + 10])[1]]
    assert times == [*range(150)]


KILLED = """
import os, signal, sys
from tire_dynamics.bag import BagWriter
from tire_dynamics.cdr.messages import FLOAT64, encode_float64

writer = BagWriter(sys.argv[1], chunk_size=1000)
handle = writer.add_topic("/speed", FLOAT64)
for number in range(150):
    writer.write(handle, number, number, encode_float64(number))
    if number == 99:
        writer.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.slow
def test_a_recording_that_was_killed(tmp_path):
    done = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "bag")], cwd=REPOSITORY)
    assert done.returncode == -signal.SIGKILL and not (tmp_path / "bag" / "metadata.yaml").exists()
    account = recover(tmp_path / "bag", tmp_path / "out")
    assert account.kept["/speed"] >= 100 and list(account.reasons)[-1] == "it has no end"
    with Reader(tmp_path / "out") as reader:
        assert reader.message_count == account.kept["/speed"]


# --- declarations that contradict ---


def two_types(same_channel: bool) -> bytes:
    """A file whose second part says other things of a channel, or of its topic."""
    parts = []
    for number, kind in ((0, messages.FLOAT64), (1, messages.STRING)):
        stream = io.BytesIO()
        writer = Writer(stream, chunk_size=100_000)
        writer.start("ros2")
        for _ in range(1 if same_channel else 1 + number):
            schema = writer.register_schema(kind if same_channel else f"{kind}{_ or ''}", "ros2msg", b"")
            channel = writer.register_channel(f"/t{number}" if same_channel else f"/t{_ or ''}", "cdr", schema)
        writer.add_message(channel, number, encode_float64(number), number)
        writer.finish()
        parts.append(stream.getvalue())
    return parts[0] + parts[1]


def test_a_channel_that_is_declared_in_two_ways_is_not_guessed_at(tmp_path):
    account, got = recovered(tmp_path, two_types(same_channel=True))
    assert [(m.topic, m.log_time) for m in got] == [("/t0", 0)]
    assert account.dropped == {"messages of channels that are not declared, or in two ways": 1}


def test_a_topic_has_one_type(tmp_path):
    for number, kind in enumerate((messages.FLOAT64, messages.STRING)):
        with BagWriter(tmp_path / f"b{number}") as writer:
            writer.write(writer.add_topic("/t", kind), number, number, encode_float64(0.0))
    (tmp_path / "in").mkdir()
    for number in (0, 1):
        mcap_of(tmp_path / f"b{number}").rename(tmp_path / "in" / f"x_{number}.mcap")
    account = recover(tmp_path / "in", tmp_path / "out")
    assert account.kept == {"/t": 1} and BagReader(tmp_path / "out").topics == {"/t": messages.FLOAT64}
    assert account.dropped == {"messages of another type than their topic had before": 1}


# --- folders, and where it is written ---


def test_the_files_of_a_folder_become_one_in_the_order_of_their_numbers(tmp_path):
    (tmp_path / "in").mkdir()
    numbers = (0, 1, 2, 9, 10, 11)
    for number in numbers:
        folder = tmp_path / "part" / "in"
        with BagWriter(folder) as writer:
            # Each has its topics in another order, and so other channels.
            topics = [f"/t{(number + i) % 3}" for i in range(3)]
            handles = {topic: writer.add_topic(topic, messages.FLOAT64) for topic in topics}
            for topic in sorted(topics):
                writer.write(handles[topic], number, number, encode_float64(number))
        shutil.move(mcap_of(folder), tmp_path / "in" / f"in_{number}.mcap")
        shutil.rmtree(folder)
    (tmp_path / "in" / "in_12.mcap").touch()  # was just begun when the power failed
    (tmp_path / "in" / "metadata.yaml").write_text("[" * 10**6)  # is not looked at
    before = {path.name: path.read_bytes() for path in (tmp_path / "in").iterdir()}
    account = recover(tmp_path / "in", tmp_path / "out")
    assert [(m.topic, m.log_time) for m in kept(tmp_path / "out")] == [(f"/t{i}", n) for n in numbers for i in range(3)]
    assert account.reasons == {"it has no end": 1} and account.gaps == [(11e-9, None)]
    assert {path.name: path.read_bytes() for path in (tmp_path / "in").iterdir()} == before


def test_what_is_read_is_never_written_over(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.write(writer.add_topic("/speed", messages.FLOAT64), 1, 1, encode_float64(1))
    (tmp_path / "link").symlink_to("bag")
    (tmp_path / "linked").mkdir()
    (tmp_path / "linked" / "a.mcap").symlink_to(mcap_of(tmp_path / "bag"))
    before = mcap_of(tmp_path / "bag").read_bytes()
    for source, out in (
        ("bag", "bag"),
        ("bag/bag_0.mcap", "bag"),
        ("bag", "bag/out"),
        ("bag", "link"),
        ("link", "bag"),
        ("linked", "bag"),
        ("bag/../bag", "bag/."),
    ):
        with pytest.raises(InputError, match="is never changed"):
            recover(tmp_path / source, tmp_path / out, force=True)
    assert os.listdir(tmp_path / "bag") == ["bag_0.mcap", "metadata.yaml"] or len(os.listdir(tmp_path / "bag")) == 2
    assert mcap_of(tmp_path / "bag").read_bytes() == before
    assert recover(tmp_path / "linked", tmp_path / "out").kept == {"/speed": 1}  # a link is read through


def test_an_output_that_exists_is_replaced_only_by_force(tmp_path):
    sample = make()
    recovered(tmp_path, sample.content)
    with pytest.raises(InputError, match="exists already"):
        recover(tmp_path / "damaged.mcap", tmp_path / "out")
    assert recover(tmp_path / "damaged.mcap", tmp_path / "out", force=True).whole
    (tmp_path / "damaged.mcap").write_bytes(sample.content[:200])
    with pytest.raises(InputError, match="no message that can be recovered"):
        recover(tmp_path / "damaged.mcap", tmp_path / "out", force=True)
    assert len(kept(tmp_path / "out")) == 120 and sorted(os.listdir(tmp_path)) == ["damaged.mcap", "out"]


# --- what it says ---


def test_the_account_in_words_and_as_json(tmp_path, capsys):
    sample = make()
    start, end = sample.places[4]
    (tmp_path / "in.mcap").write_bytes(hit(sample.content, start + 70))
    assert main(["recover", str(tmp_path / "in.mcap"), "-o", str(tmp_path / "a")]) == 0
    text = capsys.readouterr()
    lost = len(sample.chunks[4])
    for said in (
        f"{120 - lost} of 120 messages, 3 topics",
        f"skipped: {end - start} of {len(sample.content)} bytes, 1 chunks",
        "/w/load",
        f"missing from {sample.chunks[3][-1].log_time / 1e9:.6f} s to {sample.chunks[5][0].log_time / 1e9:.6f} s",
    ):
        assert said in text.out
    assert text.err == ""
    assert main(["recover", str(tmp_path / "in.mcap"), "-o", str(tmp_path / "b"), "--json"]) == 0
    account = json.loads(capsys.readouterr().out)
    assert account["whole"] is False and account["expected"] == 120 and account["chunks_skipped"] == 1
    assert account["bytes_skipped"] == end - start and sum(account["kept"].values()) == 120 - lost
    assert len(account["gaps"]) == 1 and account["gaps_beyond"] == 0


@pytest.mark.slow
def test_memory_does_not_grow_with_the_bag(tmp_path):
    path = tmp_path / "long.mcap"
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=64 * 1024, compression=CompressionType.NONE)
        writer.start("ros2")
        schema = writer.register_schema(messages.FLOAT64, "ros2msg", b"float64 data\n")
        channel = writer.register_channel("/speed", "cdr", schema)
        for time in range(40_000):
            writer.add_message(channel, time, bytes(1000), time)
        writer.finish()
    content = path.read_bytes()
    path.write_bytes(hit(content, len(content) // 2)[:-1000])
    del content
    salvage_module.Salvage(path)  # what is loaded once
    tracemalloc.start()
    try:
        assert 39_800 < recover(path, tmp_path / "out").kept["/speed"] < 40_000
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 15e6  # of 40 MB: the writer's chunk of 1 MiB a few times over, windows of 1 MiB, one chunk
