"""What rosdep and colcon install, which is without mcap, rosbags, zstandard and lz4: commands on bags work there."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from ctypes.util import find_library
from pathlib import Path

import pytest

from tire_dynamics.bag import BagReader, BagWriter, definitions
from tire_dynamics.replay.replay import replay

ROOT = Path(__file__).parents[1]
SAMPLE = ROOT / "bags" / "sample"
COMMAND = [sys.executable, str(ROOT / "test" / "without_packages.py")]
PATIENCE = 600.0

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        find_library("zstd") is None or find_library("lz4") is None,
        reason="this system has not the libraries libzstd and liblz4",
    ),
]


def without(*arguments: str | Path, status: int = 0) -> str:
    """What a command says on standard output, or on standard error if it fails."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [*COMMAND, *map(str, arguments)], env=environment, capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr if status else done.stdout


def messages(bag: Path) -> list[tuple]:
    return [tuple(message) for message in BagReader(bag).messages()]


@pytest.fixture(scope="module")
def short(tmp_path_factory) -> Path:
    """The beginning of the sample: 2 s."""
    reader, folder = BagReader(SAMPLE), tmp_path_factory.mktemp("short") / "short"
    with BagWriter(folder, compression="lz4") as writer:
        handles = {topic: writer.add_topic(topic, kind) for topic, kind in reader.topics.items()}
        for topic, _, received, published, data in reader.messages():
            if received > reader.start_ns + 2 * 10**9:
                break
            writer.write(handles[topic], received, published, data)
    return folder


def test_a_replay_is_the_same(short, tmp_path):
    without("replay", short, "-o", tmp_path / "there")
    replay(short, tmp_path / "here")
    assert messages(tmp_path / "there") == messages(tmp_path / "here")
    assert (tmp_path / "there/metadata.yaml").read_text().replace("there", "here") == (
        tmp_path / "here/metadata.yaml"
    ).read_text()


def test_info_says_the_same(short):
    with_packages = subprocess.run(
        [sys.executable, "-m", "tire_dynamics.cli.main", "info", str(short), "--json"], capture_output=True, text=True
    )
    assert json.loads(without("info", short, "--json")) == json.loads(with_packages.stdout)


def test_recover_finds_the_same(tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes((SAMPLE / "sample_0.mcap").read_bytes()[:300_000])
    without("recover", cut, "-o", tmp_path / "there")
    subprocess.run(
        [sys.executable, "-m", "tire_dynamics.cli.main", "recover", str(cut), "-o", str(tmp_path / "here")], check=True,
        capture_output=True,
    )  # fmt: skip
    assert messages(tmp_path / "there") == messages(tmp_path / "here") != []


def test_a_bag_of_ros_1_says_what_it_needs(tmp_path):
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    assert "pip install rosbags" in without("info", tmp_path / "old.bag", status=2)


@pytest.mark.live
def test_the_node_logs_and_its_log_replays(ros_domain, tmp_path):
    pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")
    node = subprocess.Popen(
        [*COMMAND, "node", "--ros-args", "--params-file", str(ROOT / "config/vehicle.yaml"),
         "-p", f"log.directory:={tmp_path / 'logs'}"],
        env={**os.environ, "PYTHONPATH": str(ROOT)}, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        said = []
        for line in node.stderr:
            said.append(line)
            if "active:" in line:
                break
        else:
            pytest.fail("".join(said))
        played = ["play", SAMPLE, "--rate", "10", "--wait", str(PATIENCE)]
        without(*played)
        node.send_signal(2)
        rest = node.communicate(timeout=PATIENCE)[1]
    finally:
        node.kill()
    assert node.returncode == 0, rest
    [log] = (tmp_path / "logs").iterdir()
    without("replay", log, "-o", tmp_path / "again")
    outputs = [topic for topic in BagReader(log).topics if topic.endswith(("axle_wrench", "ring_deflection"))]
    first = [message for message in messages(log) if message[0] in outputs]
    again = [message for message in messages(tmp_path / "again") if message[0] in outputs]
    assert len(first) > 100
    assert sorted((each[0], each[-1]) for each in first) == sorted((each[0], each[-1]) for each in again)


# -- definitions of messages --

TYPES = ("geometry_msgs/msg/TwistStamped", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu")


@pytest.fixture
def ros(monkeypatch):
    """A ROS whose message packages lie in its share folder: that of the wheels will do."""
    prefix = Path(os.environ.get("AMENT_PREFIX_PATH", sys.prefix).split(os.pathsep)[0])
    if not (prefix / "share" / "std_msgs" / "msg").is_dir():
        pytest.skip("there is no ROS: the extra `ros` brings one")
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(["/nowhere", str(prefix)]))
    return prefix


@pytest.mark.parametrize("msgtype", [*definitions.HASHES, *TYPES])
def test_the_definitions_of_the_ros_that_is_there(ros, msgtype):
    """Fields, and hash, are those that rosbags has of the same type; tf2_msgs is not among the wheels."""
    from rosbags.typesys import get_types_from_msg

    if not (ros / "share" / msgtype.split("/")[0]).is_dir():
        pytest.skip(f"{msgtype.split('/')[0]} is not installed")
    text, type_hash = definitions._of_ros(msgtype)
    theirs, their_hash = definitions._of_rosbags(msgtype)
    assert type_hash == their_hash
    assert fields(get_types_from_msg(text.decode(), msgtype)) == fields(get_types_from_msg(theirs.decode(), msgtype))


def fields(types: dict) -> dict:
    return {name: what for name, (_, what) in types.items()}


def test_a_type_that_nobody_knows(ros):
    for name in ("std_msgs/msg/Nothing", "nobody/msg/Nothing", "std_msgs/Float64", "../../etc/msg/passwd", ""):
        assert definitions.declaration(name) is None


def test_what_is_damaged_in_a_share_folder_is_not_taken(tmp_path, monkeypatch):
    folder = tmp_path / "share" / "my_msgs" / "msg"
    folder.mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    (folder / "One.msg").write_text("Two two # ours\nfloat64[<=3] some\n")
    (folder / "Two.msg").write_text("float64 value\n")
    for described in ("", "{}", "[]", '{"type_hashes": []}', '{"type_hashes": [{}]}', '{"type_hashes": 3}'):
        (folder / "One.json").write_text(described)
        assert definitions._of_ros("my_msgs/msg/One") is None
    (folder / "One.json").write_text(
        '{"type_hashes": [{"type_name": "my_msgs/msg/One", "hash_string": "RIHS01_1"}]}'
    )
    text, type_hash = definitions._of_ros("my_msgs/msg/One")
    assert type_hash == "RIHS01_1" and b"MSG: my_msgs/Two\nfloat64 value" in text
    (folder / "Two.msg").unlink()
    assert definitions._of_ros("my_msgs/msg/One") is None
    shutil.rmtree(folder)
