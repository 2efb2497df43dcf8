"""Bags of other recorders: sqlite3, ROS 1, and what is compressed by message or by file."""

from __future__ import annotations

import os
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest
import yaml
import zstandard
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tire_dynamics.bag import BagReader
from tire_dynamics.bag.foreign import SqliteFile
from tire_dynamics.bag.records import MAX_CHUNK, DamageError, unpacked_message
from tire_dynamics.cdr import messages
from tire_dynamics.cli.info import info
from tire_dynamics.cli.main import main
from tire_dynamics.cli.recover import recover
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay.replay import replay

SECOND = 10**9
BEGIN = 1_700_000_000 * SECOND
JAZZY, NOETIC = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
KINDS = {
    "/car/joint_states": messages.JOINT_STATE,
    "/car/front_left/load": messages.WRENCH_STAMPED,
    "/car/front_left/load_force": messages.FLOAT64,
    "/chatter": messages.STRING,
    "/custom": "my_msgs/msg/Thing",  # a type of nobody's
}
for store, header in ((JAZZY, "std_msgs/Header header\n"), (NOETIC, "Header header\n")):
    store.register(get_types_from_msg(f"{header}int32 number\n", "my_msgs/msg/Thing"))


def rows(store=JAZZY) -> list[tuple[str, int, object]]:
    """Topic, log time and message: 0.3 s of one wheel, the load in both forms, and what is beside it."""
    types, first = store.types, store is NOETIC
    found = []
    for number in range(60):
        time = BEGIN + number * 5_000_000

        def stamp(of, number=number, time=time):
            when = types["builtin_interfaces/msg/Time"](of // SECOND, of % SECOND)
            return types["std_msgs/msg/Header"](*([number] if first else []), when, "axle")

        three = types["geometry_msgs/msg/Vector3"]
        force, torque = three(10.0, 0.0, 4000.0 + 5.0 * number), three(0.0, 0.0, 0.0)
        wrench = types["geometry_msgs/msg/Wrench"](force, torque)
        none = np.empty(0)
        joint = types[messages.JOINT_STATE](
            stamp(time - 1000), ["front_left", "é"], none, np.array([60.0, number]), none
        )
        found.append(("/car/joint_states", time, joint))
        found.append(("/car/front_left/load", time + 1, types[messages.WRENCH_STAMPED](stamp(time), wrench)))
        found.append(("/car/front_left/load_force", time + 2, types[messages.FLOAT64](force.z)))
        if number % 20 == 0:
            found.append(("/chatter", time + 2, types[messages.STRING](f"{number} ä")))
            found.append(("/custom", time + 3, types["my_msgs/msg/Thing"](stamp(time), number)))
    return found


def sent() -> list[tuple[str, str, int, bytes]]:
    return [(t, KINDS[t], time, bytes(JAZZY.serialize_cdr(message, KINDS[t]))) for t, time, message in rows()]


SENT = sent()


def ros2(folder: Path, storage: StoragePlugin, mode: CompressionMode | None = None, version: int = 9) -> Path:
    writer = Writer(folder, version=version, storage_plugin=storage)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        handles = {topic: writer.add_connection(topic, kind, typestore=JAZZY) for topic, kind in KINDS.items()}
        for topic, _, time, data in SENT:
            writer.write(handles[topic], time, data)
    return folder


def ros1(path: Path, compression: Ros1Writer.CompressionFormat | None = None) -> Path:
    writer = Ros1Writer(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        handles = {topic: writer.add_connection(topic, kind, typestore=NOETIC) for topic, kind in KINDS.items()}
        for topic, time, message in rows(NOETIC):
            writer.write(handles[topic], time, bytes(NOETIC.serialize_ros1(message, KINDS[topic])))
    return path


def first_schema(folder: Path) -> Path:
    """A .db3 of the first version of the storage: no QoS, no definitions, no index."""
    folder.mkdir()
    with sqlite3.connect(folder / "old.db3") as database:
        database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        numbers = {topic: number for number, topic in enumerate(KINDS, 7)}
        database.executemany(
            "INSERT INTO topics VALUES (?, ?, ?, 'cdr')", [(numbers[t], t, k) for t, k in KINDS.items()]
        )
        database.executemany(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)",
            [(numbers[topic], time, data) for topic, _, time, data in SENT],
        )
    database.close()
    return folder / "old.db3"


def unknown_type(folder: Path) -> Path:
    """A .db3 with a type whose definition its recorder did not know, as rosbag2 notes it."""
    ros2(folder, StoragePlugin.SQLITE3)
    with sqlite3.connect(folder / f"{folder.name}.db3") as database:
        database.execute("UPDATE message_definitions SET encoding = 'unknown' WHERE topic_type = 'my_msgs/msg/Thing'")
    database.close()
    return folder


def zstd_of(path: Path) -> Path:
    packed = path.with_name(f"{path.name}.zstd")
    packed.write_bytes(zstandard.ZstdCompressor().compress(path.read_bytes()))
    path.unlink()
    return packed


def no_storage_id(folder: Path, storage: StoragePlugin) -> Path:
    described = yaml.safe_load((ros2(folder, storage) / "metadata.yaml").read_text())
    described["rosbag2_bagfile_information"]["storage_identifier"] = ""
    (folder / "metadata.yaml").write_text(yaml.safe_dump(described))
    return folder


def old_paths(folder: Path) -> Path:
    """The first versions of rosbag2 name the files with their folder."""
    described = yaml.safe_load((ros2(folder, StoragePlugin.SQLITE3) / "metadata.yaml").read_text())
    described["rosbag2_bagfile_information"]["relative_file_paths"] = [f"{folder.name}/{folder.name}.db3"]
    (folder / "metadata.yaml").write_text(yaml.safe_dump(described))
    return folder


SQL, MCAP = StoragePlugin.SQLITE3, StoragePlugin.MCAP
MAKE = {
    "sqlite3": lambda path: ros2(path, SQL),
    "sqlite3, version 4": lambda path: ros2(path, SQL, version=8),
    "sqlite3, a single file": lambda path: ros2(path, SQL) / f"{path.name}.db3",
    "sqlite3, the first schema": first_schema,
    "sqlite3, a type nobody knows": unknown_type,
    "sqlite3, by message": lambda path: ros2(path, SQL, CompressionMode.MESSAGE),
    "sqlite3, by file": lambda path: ros2(path, SQL, CompressionMode.FILE),
    "sqlite3, .db3.zstd": lambda path: zstd_of(ros2(path, SQL) / f"{path.name}.db3"),
    "sqlite3, storage ''": lambda path: no_storage_id(path, SQL),
    "sqlite3, paths with the folder": old_paths,
    "mcap, by message": lambda path: ros2(path, MCAP, CompressionMode.MESSAGE),
    "mcap, by message, a single file": lambda path: ros2(path, MCAP, CompressionMode.MESSAGE) / f"{path.name}.mcap",
    "mcap, by file": lambda path: ros2(path, MCAP, CompressionMode.FILE),
    "mcap, .mcap.zstd": lambda path: zstd_of(ros2(path, MCAP) / f"{path.name}.mcap"),
    "mcap, storage ''": lambda path: no_storage_id(path, MCAP),
    "ROS 1": lambda path: ros1(path.with_suffix(".bag")),
    "ROS 1, bz2": lambda path: ros1(path.with_suffix(".bag"), Ros1Writer.CompressionFormat.BZ2),
    "ROS 1, lz4": lambda path: ros1(path.with_suffix(".bag"), Ros1Writer.CompressionFormat.LZ4),
}


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Each of them, made once."""
    folder, made = tmp_path_factory.mktemp("bags"), {}

    def bag(name: str) -> Path:
        if name not in made:
            made[name] = MAKE[name](folder / f"bag{len(made)}")
        return made[name]

    return bag


@pytest.fixture(scope="module")
def forces(tmp_path_factory) -> list[tuple[int, bytes]]:
    """What a replay of the same messages from a plain MCAP bag gives."""
    folder = tmp_path_factory.mktemp("plain")
    replay(ros2(folder / "in", MCAP), folder / "out")
    return wrenches(folder / "out")


def wrenches(folder: Path) -> list[tuple[int, bytes]]:
    found = [(time, data) for _, _, time, _, data in BagReader(folder).messages(["/car/front_left/axle_wrench"])]
    assert len(found) > 100
    return found


@pytest.mark.parametrize("name", MAKE)
def test_its_messages_are_those_that_were_written(bags, name):
    reader = BagReader(bags(name))
    assert reader.topics == KINDS and set(reader.encodings.values()) == {"cdr"}
    assert reader.message_count == len(SENT) and not reader.damage
    assert reader.counts == {topic: sum(row[0] == topic for row in SENT) for topic in KINDS}
    assert (reader.start_ns, reader.end_ns) == (SENT[0][2], max(time for _, _, time, _ in SENT))
    for in_file_order in (False, True):
        assert [(t, k, at, data) for t, k, at, _, data in reader.messages(in_file_order=in_file_order)] == SENT
    some = ["/car/joint_states", "/chatter"]
    assert [(t, at) for t, _, at, _, _ in reader.messages(some)] == [(t, at) for t, _, at, _ in SENT if t in some]
    assert [*reader.rare("/chatter")] == [(at, data) for t, _, at, data in SENT if t == "/chatter"]
    assert [len(block.topic) for block in reader.blocks(least=100)][:-1] == [100] * (len(SENT) // 100) or "mcap" in name


@pytest.mark.parametrize("name", MAKE)
def test_its_replay_is_that_of_an_mcap_bag(bags, name, forces, tmp_path):
    said = info(bags(name))
    assert said["replay"]["possible"] and said["replay"]["wheels"] == ("front_left",)
    assert said["bytes"] == sum(path.stat().st_size for path in BagReader(bags(name)).paths)
    replay(bags(name), tmp_path / "out")
    assert wrenches(tmp_path / "out") == forces


def test_nothing_is_left_or_written_beside_a_bag(bags, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    for name in ("sqlite3", "sqlite3, by file"):
        folder = bags(name)
        before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
        reader = BagReader(folder)
        assert len(list(reader.messages())) == len(SENT)
        del reader
        assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    assert not list(tmp_path.iterdir())


def test_a_types_definition_decides_whether_ros_1_is_read(tmp_path):
    """A type that ROS 2 has with other fields is not read as that, and refuses nothing else."""
    with Ros1Writer(tmp_path / "odd.bag") as writer:
        odd = writer.add_connection("/w/load_force", messages.FLOAT64, msgdef="int32 data\n", md5sum="0" * 32)
        good = writer.add_connection("speed", messages.FLOAT64, typestore=NOETIC)
        writer.write(odd, 1, bytes(4))
        writer.write(good, 2, np.float64(3.0).tobytes())
    reader = BagReader(tmp_path / "odd.bag")
    assert reader.encodings == {"/w/load_force": "ros1", "/speed": "cdr"}
    assert [(t, messages.decode_float64(data)) for t, _, _, _, data in reader.messages()] == [("/speed", 3.0)]
    with pytest.raises(InputError, match="/w/load_force is encoded as 'ros1'"):
        list(reader.messages(["/w/load_force"]))


# --- what is damaged or hostile ---


def test_what_a_killed_recorder_left_beside_its_database_is_said(tmp_path):
    folder = ros2(tmp_path / "bag", SQL)
    (folder / "bag.db3-wal").write_bytes(b"x" * 100)
    reader = BagReader(folder)
    assert "bag.db3-wal is not read" in reader.damage and reader.message_count == len(SENT)
    said = info(folder)
    assert said["damage"] and said["repair"] is None


@pytest.mark.parametrize(
    "name", ["sqlite3, a single file", "ROS 1", "ROS 1, bz2", "mcap, .mcap.zstd", "sqlite3, .db3.zstd"]
)
def test_a_file_cut_anywhere_is_refused_or_read_in_part(bags, name, tmp_path):
    whole = bags(name).read_bytes()
    path = tmp_path / bags(name).name
    for part in range(1, 20):
        path.write_bytes(whole[: len(whole) * part // 20])
        try:
            got = [(t, k, at, data) for t, k, at, _, data in BagReader(path).messages()]
        except InputError as error:
            assert "\n" not in str(error) and str(path) in str(error)
        else:
            assert got == SENT[: len(got)]


@pytest.mark.parametrize("name", ["sqlite3, a single file", "ROS 1", "ROS 1, lz4", "mcap, by message, a single file"])
def test_a_file_with_wrong_bytes_is_refused_or_read(bags, name, tmp_path):
    whole = bags(name).read_bytes()
    path = tmp_path / bags(name).name
    chance = np.random.default_rng(3)
    for _ in range(40):
        content = bytearray(whole)
        for place in chance.integers(0, len(content), 20):
            content[place] = chance.integers(0, 256)
        path.write_bytes(content)
        try:
            list(BagReader(path).messages())
        except InputError as error:
            assert "\n" not in str(error)


def test_a_view_that_computes_without_an_end_is_no_table(tmp_path):
    path = first_schema(tmp_path / "bag")
    with sqlite3.connect(path) as database:
        database.execute("DROP TABLE messages")
        database.execute(
            "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"
            " SELECT i AS id, 7 AS topic_id, i AS timestamp, x'00' AS data FROM n"
        )
    database.close()
    with pytest.raises(InputError, match="messages is no plain table"):
        BagReader(path)


def test_a_database_that_is_no_bag(tmp_path):
    with sqlite3.connect(tmp_path / "a.db3") as database:
        database.execute("CREATE TABLE people(name TEXT)")
    database.close()
    with pytest.raises(InputError, match="no table of topics"):
        BagReader(tmp_path / "a.db3")


def test_a_frame_that_claims_terabytes_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("tire_dynamics.bag.files._LARGE", 2**20)
    monkeypatch.setattr("tire_dynamics.bag.files._MAX_RATIO", 100)
    packed = zstandard.ZstdCompressor().compress(bytes(2**25))
    (tmp_path / "a.mcap.zstd").write_bytes(packed)
    with pytest.raises(InputError, match="more than 100 times its size"):
        BagReader(tmp_path / "a.mcap.zstd")


@pytest.mark.parametrize("name", ["ROS 1, bz2", "ROS 1, lz4"])
def test_a_ros_1_chunk_that_grows_without_an_end_is_refused(bags, name, monkeypatch):
    monkeypatch.setattr("tire_dynamics.bag.foreign.MAX_CHUNK", 100)
    with pytest.raises(InputError, match="a chunk claims more than 400 bytes"):
        list(BagReader(bags(name)).messages())


@pytest.mark.parametrize("claims", [True, False])
def test_a_message_that_grows_without_an_end_is_refused(claims):
    packer = zstandard.ZstdCompressor(write_content_size=claims)
    with pytest.raises(DamageError, match="a message (claims|cannot be decompressed)"):
        unpacked_message(packer.compress(bytes(2 * MAX_CHUNK)))


def test_a_pointer_of_git_lfs_says_what_fetches_it(tmp_path, capsys):
    text = "version https://git-lfs.github.com/spec/v1\noid sha256:" + "0" * 64 + "\nsize 123456\n"
    for name in ("a.mcap", "b.db3", "c.bag", "d.mcap.zstd"):
        (tmp_path / name).write_text(text)
        for command in (["info", str(tmp_path / name)], ["recover", str(tmp_path / name), "-o", str(tmp_path / "o")]):
            assert main(command) == 2
            assert "git lfs pull" in capsys.readouterr().err
    folder = ros2(tmp_path / "bag", SQL)
    (folder / "metadata.yaml").write_text(text)
    with pytest.raises(InputError, match="git lfs pull"):
        BagReader(folder)


# --- recover ---


@pytest.mark.parametrize("name", ["mcap, by message", "mcap, by file", "mcap, .mcap.zstd"])
def test_recover_decompresses(bags, name, tmp_path):
    account = recover(bags(name), tmp_path / "out", quiet=True)
    assert account.whole and account.kept == {topic: sum(row[0] == topic for row in SENT) for topic in KINDS}
    assert [(t, k, at, data) for t, k, at, _, data in BagReader(tmp_path / "out").messages()] == SENT
    described = yaml.safe_load((tmp_path / "out" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert described["compression_mode"] == ""
    [path] = (tmp_path / "out").glob("*.mcap")
    assert zstandard.FRAME_HEADER not in {data[:4] for *_, data in BagReader(path).messages()}


def test_a_message_whose_compression_is_damaged_is_told(tmp_path):
    from mcap.writer import Writer as McapWriter

    with open(tmp_path / "a.mcap", "wb") as file:
        writer = McapWriter(file)
        writer.start("ros2")
        topic = writer.register_channel("/t", "cdr", writer.register_schema(messages.FLOAT64, "ros2msg", b""))
        good = messages.encode_float64(2.0)
        for time, data in enumerate([zstandard.compress(good), zstandard.compress(good)[:-3], good], 1):
            writer.add_message(topic, time, data, time)
        writer.finish()
    account = recover(tmp_path / "a.mcap", tmp_path / "out", quiet=True)
    assert account.kept == {"/t": 2} and account.dropped == {"messages whose compression is damaged": 1}
    assert not account.whole
    with pytest.raises(InputError, match="cannot be decompressed"):
        list(BagReader(tmp_path / "a.mcap").messages())


def test_a_file_that_is_listed_and_not_there_is_named(tmp_path, capsys):
    folder = ros2(tmp_path / "bag", MCAP)
    described = yaml.safe_load((folder / "metadata.yaml").read_text())
    described["rosbag2_bagfile_information"]["relative_file_paths"] += ["bag_1.mcap"]
    (folder / "metadata.yaml").write_text(yaml.safe_dump(described))
    assert main(["recover", str(folder), "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "missing: bag_1.mcap" in said and "nothing was lost" not in said
    assert recover(folder, tmp_path / "out", force=True, quiet=True).missing == ["bag_1.mcap"]


@pytest.mark.parametrize("name", ["sqlite3", "sqlite3, a single file", "sqlite3, by file", "ROS 1"])
def test_a_bag_of_another_storage_says_which(bags, name, tmp_path):
    with pytest.raises(InputError, match="its storage is (sqlite3|ROS 1), and only mcap can be recovered"):
        recover(bags(name), tmp_path / "out")


def test_a_folder_without_metadata_names_the_file(bags, tmp_path):
    shutil.copy(bags("sqlite3") / os.listdir(bags("sqlite3"))[0], tmp_path)
    shutil.copy(bags("sqlite3, a single file"), tmp_path / "x.db3")
    (tmp_path / "metadata.yaml").unlink(missing_ok=True)
    with pytest.raises(InputError, match=r"name the file instead: .*\.db3"):
        BagReader(tmp_path)


def test_both_files_of_a_database_are_merged_by_time(bags, tmp_path):
    """Where two files overlap in time, the messages come in the order of their times."""
    from tire_dynamics.bag.files import Found

    path = bags("sqlite3, a single file")
    single = SqliteFile(Found(path, path, "sqlite3", ""))
    assert [row[1] for row in single.messages(None, False)] == [time for _, _, time, _ in SENT]
    folder = tmp_path / "two"
    folder.mkdir()
    for number in (0, 1):
        shutil.copy(path, folder / f"two_{number}.db3")
    names = [f"two_{number}.db3" for number in (0, 1)]
    (folder / "metadata.yaml").write_text(
        yaml.safe_dump({"rosbag2_bagfile_information": {"storage_identifier": "sqlite3", "relative_file_paths": names}})
    )
    times = [time for _, _, time, _, _ in BagReader(folder).messages()]
    assert times == sorted(2 * [time for _, _, time, _ in SENT])
