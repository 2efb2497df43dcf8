"""Bags: what others read of ours, what we read of theirs, order, memory, files that are not what they say."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import struct
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import yaml
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from tire_dynamics.bag import BagReader, BagWriter, definitions
from tire_dynamics.cdr import messages
from tire_dynamics.cdr.messages import WrenchEncoder, encode_float64
from tire_dynamics.files.errors import InputError

store = get_typestore(Stores.ROS2_JAZZY)
OUR_TYPES = [
    messages.CLOCK,
    messages.FLOAT64,
    messages.FLOAT64_MULTI_ARRAY,
    messages.JOINT_STATE,
    messages.POINT_CLOUD,
    messages.WRENCH_STAMPED,
]


Written = list[tuple[int, bytes]]  # log time and message


def write_floats(folder: Path, log_times, *, topic="/speed", chunk_size=200, **options) -> Written:
    """A bag of Float64 messages numbered in the order of writing, in many small chunks."""
    written = []
    with BagWriter(folder, chunk_size=chunk_size, **options) as writer:
        handle = writer.add_topic(topic, messages.FLOAT64)
        for number, log_time in enumerate(log_times):
            written.append((log_time, encode_float64(float(number))))
            writer.write(handle, log_time, log_time, written[-1][1])
    return written


def read(path: Path) -> Written:
    return [(log_time, data) for _, _, log_time, _, data in BagReader(path).messages()]


@pytest.mark.parametrize("msgtype", definitions.HASHES)
def test_the_definitions_that_are_written_are_those_of_ros(msgtype):
    text, _ = store.generate_msgdef(msgtype, ros_version=2)
    assert definitions.definition(msgtype) == text
    assert definitions.HASHES[msgtype] == store.hash_rihs01(msgtype)


def test_other_types_of_the_common_interfaces_can_be_written_too(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/imu", "sensor_msgs/msg/Imu")
        with pytest.raises(InputError, match="'some_msgs/msg/Odd' is not known"):
            writer.add_topic("/odd", "some_msgs/msg/Odd")
    with Reader(tmp_path / "bag") as reader:
        [connection] = reader.connections
    assert connection.msgdef.data == store.generate_msgdef("sensor_msgs/msg/Imu", ros_version=2)[0]


def mcap_of(folder: Path) -> Path:
    return folder / f"{folder.name}_0.mcap"


# --- what others read of ours ---


@pytest.mark.slow
@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_rosbags_reads_the_same_values_and_qos(tmp_path, compression):
    encoder = WrenchEncoder("wheel_axle")
    sent = [(10**18 + 10**6 * i, encoder.encode(10**18 + i, 0.1 * i, -0.3 * i)) for i in range(100)]
    with BagWriter(tmp_path / "bag", compression=compression, chunk_size=1000) as writer:
        load = writer.add_topic("/wheel/load", messages.WRENCH_STAMPED)
        clock = writer.add_topic("/clock", messages.CLOCK, "default")
        for log_time, data in sent:
            writer.write(load, log_time, log_time - 5, data)
        writer.write(clock, sent[-1][0], sent[-1][0], messages.encode_clock(7))

    for path in (tmp_path / "bag", mcap_of(tmp_path / "bag")):
        with Reader(path) as reader:
            assert reader.message_count == 101
            # The end that rosbags gives is the nanosecond after the last message.
            assert (reader.start_time, reader.end_time) == (sent[0][0], sent[-1][0] + 1)
            offered = {c.topic: c.ext.offered_qos_profiles for c in reader.connections}
            forever = QosTime(9223372036, 854775807)
            for topic, depth, reliability in (
                ("/wheel/load", 5, QosReliability.BEST_EFFORT),
                ("/clock", 10, QosReliability.RELIABLE),
            ):
                last = (forever, forever, QosLiveliness.AUTOMATIC, forever, False)
                expected = Qos(QosHistory.KEEP_LAST, depth, reliability, QosDurability.VOLATILE, *last)
                assert offered[topic] == [expected]
            got = [(t, raw) for c, t, raw in reader.messages() if c.topic == "/wheel/load"]
            assert got == sent
            message = store.deserialize_cdr(got[7][1], messages.WRENCH_STAMPED)
            assert (message.wrench.force.x, message.wrench.force.z) == (0.1 * 7, -0.3 * 7)


def test_the_mcap_library_finds_what_rosbag2_needs(tmp_path):
    write_floats(tmp_path / "bag", range(50), metadata={"note": {"key": "value"}})
    with open(mcap_of(tmp_path / "bag"), "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        schema = summary.schemas[1]  # rosbag2 takes 0 as "no schema"
        assert (schema.name, schema.encoding) == ("std_msgs/msg/Float64", "ros2msg")
        (channel,) = summary.channels.values()
        assert (channel.topic, channel.message_encoding) == ("/speed", "cdr")
        (profile,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
        assert set(profile) == {
            "history",
            "depth",
            "reliability",
            "durability",
            "deadline",
            "lifespan",
            "liveliness",
            "liveliness_lease_duration",
            "avoid_ros_namespace_conventions",
        }
        assert channel.metadata["topic_type_hash"].startswith("RIHS01_")
        assert summary.statistics.message_count == 50
        assert len(summary.chunk_indexes) > 1
        assert all(1 in index.message_index_offsets for index in summary.chunk_indexes)
        records = {record.name: record.metadata for record in reader.iter_metadata()}
        assert records["note"] == {"key": "value"}
        times = [message.log_time for _, _, message in reader.iter_messages()]
        assert times == list(range(50))


def test_metadata_yaml_is_that_of_rosbag2_jazzy(tmp_path):
    """Keys and nesting as rosbag2_storage (Jazzy) encodes BagMetadata, version 9."""
    write_floats(tmp_path / "bag", [5, 20, 10])
    text = (tmp_path / "bag" / "metadata.yaml").read_text()
    information = yaml.safe_load(text)["rosbag2_bagfile_information"]
    (topic,) = information.pop("topics_with_message_count")
    assert set(topic) == {"topic_metadata", "message_count"} and topic["message_count"] == 3
    assert set(topic["topic_metadata"]) == {
        "name",
        "type",
        "serialization_format",
        "offered_qos_profiles",
        "type_description_hash",
    }
    assert isinstance(topic["topic_metadata"]["offered_qos_profiles"], list)  # text before version 9
    assert information == {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": 15},
        "starting_time": {"nanoseconds_since_epoch": 5},
        "message_count": 3,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": ["bag_0.mcap"],
        "files": [
            {
                "path": "bag_0.mcap",
                "starting_time": {"nanoseconds_since_epoch": 5},
                "duration": {"nanoseconds": 15},
                "message_count": 3,
            }
        ],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    inside = BagReader(tmp_path / "bag").metadata["rosbag2"]["serialized_metadata"]
    assert yaml.safe_load(inside) == information | {"topics_with_message_count": [topic]}


def test_every_schema_holds_every_type_it_uses(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for number, msgtype in enumerate(OUR_TYPES):
            writer.add_topic(f"/t{number}", msgtype)
    with open(mcap_of(tmp_path / "bag"), "rb") as file:
        schemas = make_reader(file).get_summary().schemas.values()
    assert {schema.name for schema in schemas} == set(OUR_TYPES)
    for schema in schemas:
        root, *dependencies = schema.data.decode().split("=" * 80 + "\nMSG: ")
        defined = {text.split("\n", 1)[0] for text in dependencies}
        used = set(re.findall(r"^(\w+/\w+)(?:\[.*?\])? ", "\n".join([root, *dependencies]), re.MULTILINE))
        assert used <= defined, schema.name


def test_type_hashes_are_those_of_ros(tmp_path):
    prefixes = [*filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(":")), sys.prefix]
    shares = [Path(p, "share") for p in prefixes if Path(p, "share/geometry_msgs/msg").is_dir()]
    if not shares:
        pytest.skip("needs ROS: pip install .[ros]")
    with BagWriter(tmp_path / "bag") as writer:
        for number, msgtype in enumerate(OUR_TYPES):
            writer.add_topic(f"/t{number}", msgtype)
    with Reader(tmp_path / "bag") as reader:
        for connection in reader.connections:
            description = json.loads((shares[0] / f"{connection.msgtype}.json").read_text())
            hashes = {entry["type_name"]: entry["hash_string"] for entry in description["type_hashes"]}
            assert connection.digest == hashes[connection.msgtype]


# --- what we read of others' ---


@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.STORAGE])
def test_we_read_what_rosbags_writes(tmp_path, mode):
    sent = [(10**18 + i, encode_float64(0.5 * i)) for i in range(1000)]
    writer = RosbagsWriter(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/speed", messages.FLOAT64, typestore=store)
        for log_time, data in sent:
            writer.write(connection, log_time, data)
    reader = BagReader(tmp_path / "bag")
    assert reader.topics == {"/speed": messages.FLOAT64}
    assert reader.complete and reader.message_count == 1000
    assert (reader.start_ns, reader.end_ns) == (10**18, 10**18 + 999)
    assert [(t, data) for _, _, t, _, data in reader.messages()] == sent


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.NONE, "enable_crcs": False},
        {"use_chunking": False},
        {"use_chunking": False, "use_statistics": False},
        {"index_types": IndexType.NONE},
        {"repeat_channels": False, "repeat_schemas": False},
        {"use_statistics": False, "use_summary_offsets": False},
    ],
    ids=str,
)
def test_every_way_to_lay_out_a_file_is_read(tmp_path, options):
    """MCAP leaves chunks, indexes, statistics and checksums to the recorder (`--storage-preset-profile`)."""
    path = tmp_path / "file.mcap"
    times = np.random.default_rng(1).permutation(300).tolist()
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=500, **options)
        writer.start("ros2")
        schema = writer.register_schema(messages.FLOAT64, "ros2msg", b"float64 data\n")
        channel = writer.register_channel("/speed", "cdr", schema)
        writer.add_metadata("note", {"key": "value"})
        for time in times:
            writer.add_message(channel, time + 1, encode_float64(time), time)
        writer.finish()
    reader = BagReader(path)
    assert reader.complete and reader.message_count == 300 and (reader.start_ns, reader.end_ns) == (1, 300)
    assert reader.metadata["note"] == {"key": "value"}
    expected = [("/speed", messages.FLOAT64, t + 1, t, encode_float64(t)) for t in range(300)]
    assert list(reader.messages()) == expected


# --- order and selection ---


@pytest.mark.slow
@settings(deadline=None)
@given(st.lists(st.lists(st.integers(0, 30), max_size=40), min_size=1, max_size=3), st.integers(50, 500))
def test_messages_come_in_order_of_log_time_then_of_the_files(tmp_path_factory, files, chunk_size):
    """Any times, any chunks, overlapping or not, one file or several: as a stable sort of the whole bag."""
    folder = tmp_path_factory.mktemp("order")
    names, expected = [], []
    for number, times in enumerate(files):
        one = folder / f"part{number}"
        expected += write_floats(one, times, topic=f"/t{number}", chunk_size=chunk_size)
        names.append(mcap_of(one).name)
        mcap_of(one).rename(folder / names[-1])
    text = yaml.safe_load((folder / "part0" / "metadata.yaml").read_text())
    text["rosbag2_bagfile_information"]["relative_file_paths"] = names
    (folder / "metadata.yaml").write_text(yaml.safe_dump(text))
    assert read(folder) == sorted(expected, key=lambda message: message[0])
    reader = BagReader(folder)
    assert reader.message_count == len(expected)
    assert [(t, data) for _, _, t, _, data in reader.messages(in_file_order=True)] == expected


def test_topics_select(tmp_path):
    with BagWriter(tmp_path / "bag", chunk_size=100) as writer:
        handles = [writer.add_topic(f"/t{i}", messages.FLOAT64) for i in range(3)]
        for time in range(60):
            writer.write(handles[time % 3], time, time, encode_float64(time))
    reader = BagReader(tmp_path / "bag")
    assert [m[2] for m in reader.messages(["/t1"])] == list(range(1, 60, 3))
    assert {m[0] for m in reader.messages(("/t0", "/t2"))} == {"/t0", "/t2"}
    assert list(reader.messages(["/other"])) == []
    assert len(list(reader.messages())) == 60  # as often as one likes


@pytest.mark.slow
@pytest.mark.parametrize("chunks", [True, False])
def test_memory_holds_a_few_chunks_and_not_the_bag(tmp_path, chunks):
    path = tmp_path / "file.mcap"
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=64 * 1024, use_chunking=chunks)
        writer.start("ros2")
        schema = writer.register_schema(messages.FLOAT64, "ros2msg", b"float64 data\n")
        channel = writer.register_channel("/speed", "cdr", schema)
        for time in range(50_000):
            writer.add_message(channel, time, encode_float64(time), time)
        writer.finish()
    tracemalloc.start()
    try:
        assert sum(1 for _ in BagReader(path).messages()) == 50_000
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # A message takes some 300 bytes as objects: 50 000 take 15 MB, the 1500 in 64 KiB half a megabyte.
    assert peak < 1.5e6


def test_an_empty_bag_is_a_bag(tmp_path):
    write_floats(tmp_path / "bag", [])
    reader = BagReader(tmp_path / "bag")
    assert reader.complete and reader.message_count == 0
    assert reader.start_ns is None and reader.end_ns is None
    assert reader.topics == {"/speed": messages.FLOAT64}
    assert list(reader.messages()) == []
    with Reader(tmp_path / "bag") as other:
        assert list(other.messages()) == []


# --- outputs that exist, and writers that do not reach their end ---


def test_an_output_that_exists_is_replaced_only_by_force_and_only_a_bag(tmp_path):
    write_floats(tmp_path / "bag", range(3))
    for aside in (False, True):
        with pytest.raises(InputError, match="exists already"):
            BagWriter(tmp_path / "bag", aside=aside)
        assert len(read(tmp_path / "bag")) == 3
    for length, aside in ((4, False), (5, True)):
        write_floats(tmp_path / "bag", range(length), force=True, aside=aside)
        assert len(read(tmp_path / "bag")) == length
    assert os.listdir(tmp_path) == ["bag"]


@pytest.mark.parametrize("aside", [False, True])
@pytest.mark.parametrize(
    "strangers", [[], ["notes.txt"], ["metadata.yaml", "notes.txt"], ["metadata.yaml", "folder.mcap/"]]
)
def test_force_never_removes_what_is_not_a_bag(tmp_path, aside, strangers):
    (tmp_path / "out").mkdir()
    for name in strangers:
        (tmp_path / "out" / name).mkdir() if name.endswith("/") else (tmp_path / "out" / name).touch()
    with pytest.raises(InputError, match="not replaced"):
        BagWriter(tmp_path / "out", force=True, aside=aside)
    assert sorted(os.listdir(tmp_path / "out")) == sorted(name.rstrip("/") for name in strangers)


def test_force_does_not_follow_links_or_replace_files(tmp_path):
    write_floats(tmp_path / "bag", range(3))
    (tmp_path / "link").symlink_to("bag")
    (tmp_path / "file").write_text("mine")
    for name in ("link", "file"):
        with pytest.raises(InputError, match="not replaced"):
            BagWriter(tmp_path / name, force=True)
    assert len(read(tmp_path / "bag")) == 3 and (tmp_path / "file").read_text() == "mine"


def test_a_bag_written_aside_is_whole_or_not_there(tmp_path):
    with pytest.raises(RuntimeError), BagWriter(tmp_path / "bag", aside=True) as writer:
        writer.write(writer.add_topic("/speed", messages.FLOAT64), 1, 1, encode_float64(1))
        assert not (tmp_path / "bag").exists()
        raise RuntimeError
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("aside", [False, True])
def test_a_full_disk_is_an_os_error_and_leaves_what_was_there(tmp_path, aside):
    write_floats(tmp_path / "old", range(3))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    try:
        for folder, force in (("new", False), ("old", True)) if aside else (("new", False),):
            with pytest.raises(OSError, match="too large"):
                write_floats(tmp_path / folder, range(10_000), compression="", aside=aside, force=force)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert len(read(tmp_path / "old")) == 3
    if aside:
        assert os.listdir(tmp_path) == ["old"]
    else:
        assert len(read(mcap_of(tmp_path / "new"))) > 100


def test_force_aside_keeps_the_old_bag_until_the_new_one_is_whole(tmp_path):
    write_floats(tmp_path / "bag", range(3))
    with pytest.raises(RuntimeError), BagWriter(tmp_path / "bag", aside=True, force=True):
        raise RuntimeError
    assert len(read(tmp_path / "bag")) == 3 and os.listdir(tmp_path) == ["bag"]


def test_a_bag_written_in_place_is_closed_when_its_block_raises(tmp_path):
    with pytest.raises(RuntimeError), BagWriter(tmp_path / "bag") as writer:
        writer.write(writer.add_topic("/speed", messages.FLOAT64), 1, 1, encode_float64(1))
        raise RuntimeError
    reader = BagReader(tmp_path / "bag")
    assert reader.complete and reader.message_count == 1


KILLED_WRITER = """
import os, signal, sys
from tire_dynamics.bag import BagWriter
from tire_dynamics.cdr.messages import FLOAT64, encode_float64

writer = BagWriter(sys.argv[1], chunk_size=1000, metadata={"note": {"key": "value"}})
handle = writer.add_topic("/speed", FLOAT64)
for number in range(150):
    writer.write(handle, number, number, encode_float64(number))
    if number == 99:
        writer.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_was_flushed_survives_sigkill(tmp_path):
    folder = tmp_path / "bag"
    done = subprocess.run([sys.executable, "-c", KILLED_WRITER, str(folder)], cwd=Path(__file__).parents[1])
    assert done.returncode == -signal.SIGKILL
    reader = BagReader(mcap_of(folder))
    assert not reader.complete and "bag_0.mcap" in reader.damage
    assert reader.topics == {"/speed": messages.FLOAT64} and reader.metadata["note"] == {"key": "value"}
    got = [m[2] for m in reader.messages()]
    assert got == list(range(len(got))) and len(got) >= 100
    assert reader.message_count == len(got)
    with pytest.raises(InputError, match=r"no metadata\.yaml; of a recording that was cut off"):
        BagReader(folder)


def test_names_types_and_times_are_checked(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for name in ("speed", "/speed/", "//speed", "/a b", "/1a", "", "/"):
            with pytest.raises(InputError, match="topic name"):
                writer.add_topic(name, messages.FLOAT64)
        with pytest.raises(InputError, match="not known"):
            writer.add_topic("/speed", "std_msgs/msg/Float65")
        handle = writer.add_topic("/_front_left/wheel_speed2", messages.FLOAT64)
        with pytest.raises(ValueError, match="below 0"):
            writer.write(handle, -1, 0, b"")
        writer.write(handle, 0, 0, encode_float64(0))
    assert len(read(tmp_path / "bag")) == 1


def test_a_folder_that_cannot_be_made_is_one_clear_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        BagWriter(tmp_path / "file" / "bag")


# --- files that are not what they say ---


def one_line(error: pytest.ExceptionInfo[InputError], path: Path) -> None:
    assert path.name in str(error.value) and "\n" not in str(error.value) and len(str(error.value)) < 500


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("missing.mcap", None, "does not exist"),
        ("empty.mcap", b"", "is empty"),
        ("text.mcap", b"time,speed\n0,1\n" * 100, "is not an MCAP file"),
        ("magic.mcap", b"\x89MC", "is not an MCAP file"),
    ],
)
def test_a_file_that_is_no_mcap(tmp_path, name, content, reason):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=reason) as error:
        BagReader(tmp_path / name)
    one_line(error, tmp_path / name)


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(InputError, match="is not a file"):
        BagReader(tmp_path / "pipe.mcap")


GOOD = {"storage_identifier": "mcap", "compression_mode": "", "relative_file_paths": ["bag_0.mcap"]}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"relative_file_paths": ["../other.mcap"]}, "not a file of this folder"),
        ({"relative_file_paths": ["/etc/passwd"]}, "not a file of this folder"),
        ({"relative_file_paths": [".."]}, "not a file of this folder|is not a file"),
        ({"relative_file_paths": ["gone_0.mcap"]}, "does not exist"),
        ({"relative_file_paths": []}, "lists no file"),
        ({"relative_file_paths": 3}, "is not the description of a bag"),
        ({"storage_identifier": "rocksdb"}, "its storage is 'rocksdb'"),
        ({"compression_mode": "odd", "compression_format": "zstd"}, "its compression_mode is 'odd'"),
        ({"compression_mode": "message", "compression_format": "lz5"}, "its compression_format is 'lz5'"),
    ],
)
def test_a_folder_whose_description_cannot_be_used(tmp_path, change, reason):
    write_floats(tmp_path / "bag", range(3))
    text = yaml.safe_dump({"rosbag2_bagfile_information": GOOD | change})
    (tmp_path / "bag" / "metadata.yaml").write_text(text)
    with pytest.raises(InputError, match=reason) as error:
        BagReader(tmp_path / "bag")
    one_line(error, tmp_path / "bag")


@pytest.mark.parametrize(
    "text", ["", "3", "a: b: c", "[" * 100_000, "!!python/object/apply:os.getcwd []", "\x00"], ids=range(6)
)
def test_a_folder_whose_description_is_none(tmp_path, text):
    write_floats(tmp_path / "bag", range(3))
    (tmp_path / "bag" / "metadata.yaml").write_text(text)
    with pytest.raises(InputError, match="is not the description of a bag") as error:
        BagReader(tmp_path / "bag")
    one_line(error, tmp_path / "bag")


def test_a_folder_without_description(tmp_path):
    with pytest.raises(InputError, match=r"no metadata\.yaml"):
        BagReader(tmp_path)


def test_another_encoding_is_refused_when_it_is_wanted(tmp_path):
    path = tmp_path / "file.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        cdr = writer.register_channel("/speed", "cdr", writer.register_schema("a/msg/A", "ros2msg", b""))
        writer.register_channel("/text", "json", 0)
        writer.add_message(cdr, 1, b"", 1)
        writer.finish()
    assert len(list(BagReader(path).messages(["/speed"]))) == 1
    for topics in (["/text"], None):
        with pytest.raises(InputError, match="/text is encoded as 'json'"):
            list(BagReader(path).messages(topics))


def test_a_topic_of_two_types_says_both(tmp_path):
    path = tmp_path / "file.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        for name in ("a/msg/A", "a/msg/B"):
            writer.register_channel("/speed", "cdr", writer.register_schema(name, "ros2msg", b""))
        writer.finish()
    assert BagReader(path).topics == {"/speed": "a/msg/A, a/msg/B"}


@pytest.mark.slow
@pytest.mark.parametrize("compression", ["", "zstd"])
def test_a_truncated_file_is_read_as_far_as_it_goes(tmp_path, compression):
    whole = write_floats(tmp_path / "bag", range(40), compression=compression)
    content = mcap_of(tmp_path / "bag").read_bytes()
    path = tmp_path / "cut.mcap"
    most = 0
    for length in range(1, len(content), 7):
        path.write_bytes(content[:length])
        if length < 8:
            with pytest.raises(InputError, match="is not an MCAP file"):
                BagReader(path)
            continue
        got = read(path)
        assert got == whole[: len(got)] and len(got) >= most
        most = len(got)
    assert most == len(whole)  # the summary at the end is not needed


@pytest.mark.slow
@settings(deadline=None, max_examples=200)
@given(data=st.data())
def test_a_damaged_file_is_read_or_refused(tmp_path_factory, data):
    """No other exception, and no message that was not written: every chunk has a checksum."""
    folder = tmp_path_factory.getbasetemp() / "damage"
    if not folder.exists():
        write_floats(folder, range(40))
    content = bytearray(mcap_of(folder).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    path = folder.parent / "damaged.mcap"
    path.write_bytes(content)
    try:
        reader = BagReader(path)
        for message in reader.messages():
            assert message[4] == encode_float64(message[2])
    except InputError as error:
        assert "damaged.mcap" in str(error) and "\n" not in str(error)


def chunk_file(path: Path, compression: bytes, size: int, stored: bytes, crc: int = 0) -> None:
    """A file whose only chunk says of itself what it is told to."""
    chunk = struct.pack("<QQQII", 0, 0, size, crc, len(compression)) + compression
    chunk += struct.pack("<Q", len(stored)) + stored
    header = struct.pack("<I4sI", 4, b"ros2", 0)
    data_end = struct.pack("<I", 0)
    content = b"\x89MCAP0\r\n"
    for opcode, record in ((1, header), (6, chunk), (15, data_end)):
        content += struct.pack("<BQ", opcode, len(record)) + record
    path.write_bytes(content)


BOMB = 64 * 2**20
ZEROS = bytes(BOMB)


def bomb_without_size() -> bytes:
    """zstd frames may leave out the size of their content."""
    compressor = zstandard.ZstdCompressor(write_content_size=False).compressobj()
    return compressor.compress(ZEROS) + compressor.flush()


@pytest.mark.parametrize(
    ("compression", "size", "stored", "reason"),
    [
        (b"zstd", 10**11, zstandard.compress(b"abc"), "claims 100000000000 bytes"),
        (b"zstd", 1000, zstandard.compress(ZEROS), "another size"),
        (b"zstd", 1000, bomb_without_size(), "cannot be decompressed"),
        (b"zstd", 3, b"not zstd", "cannot be decompressed"),
        (b"lz4", 3, b"not lz4!", "cannot be decompressed"),
        (b"lz4", 10**11, b"", "claims 100000000000 bytes"),
        (b"snappy", 3, b"abc", "snappy"),
        (b"", 1000, b"abc", "another size"),
        (b"", 31, struct.pack("<BQ", 5, 2**60) + bytes(22), "does not fit"),
        (b"", 9, struct.pack("<BQ", 5, 0), "does not fit"),
        (b"", 31, struct.pack("<BQ", 5, 22) + bytes(22), "channel 0 is not declared"),
    ],
)
def test_a_chunk_that_lies_costs_nothing(tmp_path, compression, size, stored, reason):
    path = tmp_path / "lie.mcap"
    chunk_file(path, compression, size, stored)
    tracemalloc.start()
    try:
        reader = BagReader(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert re.search(reason, reader.damage) and list(reader.messages()) == []
    assert peak < BOMB / 10  # far from what the bomb holds


def test_a_record_that_lies_about_its_length_costs_nothing(tmp_path):
    for length in (2**63, 2**40, 100):
        path = tmp_path / "lie.mcap"
        path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 3, length) + bytes(50))
        assert "in the middle of a record" in BagReader(path).damage


def test_messages_far_out_of_order_are_refused_before_they_fill_the_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("tire_dynamics.bag.reader._MAX_PENDING", 100_000)
    folder = tmp_path / "bag"
    write_floats(folder, [t for start in range(100) for t in range(start, 100_000, 1000)], chunk_size=3000)
    with pytest.raises(InputError, match="too far out of order"):
        list(BagReader(folder).messages())
