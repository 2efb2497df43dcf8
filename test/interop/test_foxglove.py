"""Logs read by what Foxglove itself is made of, under Node.js: the same messages, the same numbers in every bit."""

from __future__ import annotations

import hashlib
from collections import Counter

import yaml
from exact import exact
from live_run import WRENCHES
from rosbags.typesys import Stores, get_typestore
from test_live_log import replay

from tire_dynamics.bag import BagReader
from tire_dynamics.cli.recover import recover

store = get_typestore(Stores.ROS2_JAZZY)


def mcap_files(folder):
    return sorted(folder.glob("*.mcap"), key=lambda file: (len(file.name), file.name))


def assert_read_alike(file, found) -> None:
    """Every message as our reader has it, by the index and as a stream; names as Foxglove looks for them."""
    reader = BagReader(file)
    rows = [
        [topic, str(log_time), str(published), hashlib.sha256(data).hexdigest(), kind, data]
        for topic, kind, log_time, published, data in reader.messages()
    ]
    assert [row[:4] for row in found["messages"]] == [row[:4] for row in rows]
    for (*_, kind, data), (topic, *_, message) in zip(rows, found["messages"], strict=True):
        assert message == exact(store.deserialize_cdr(data, kind)), topic
    written = [
        [topic, str(log_time), str(published), hashlib.sha256(data).hexdigest()]
        for topic, _, log_time, published, data in reader.messages(in_file_order=True)
    ]
    assert found["streamed"] == {"messages": written, "done": True}

    assert found["profile"] == "ros2"
    counts = Counter(row[0] for row in rows)
    assert {topic: one["schema"] for topic, one in found["channels"].items()} == reader.topics
    for topic, channel in found["channels"].items():
        assert channel["encoding"] == "cdr"
        assert channel["count"] == counts[topic]
        (qos,) = yaml.safe_load(channel["metadata"]["offered_qos_profiles"])
        assert qos["reliability"] in ("reliable", "best_effort")
    # Foxglove reads messages by the schemas in the file; field for field they are those that it has of Jazzy itself.
    assert found["schemas"]
    assert all(schema == {"encoding": "ros2msg", "unlikeJazzy": []} for schema in found["schemas"].values())


def test_a_log_and_its_replay(run, read_log):
    """The log with zstd is one of several files; each opens for itself."""
    files = mcap_files(run.log)
    assert len(files) > 1 if run.compression == "zstd" else len(files) == 1
    count = 0
    for file, found in zip(files, read_log(*files), strict=True):
        assert_read_alike(file, found)
        count += len(found["messages"])
        assert found["compressions"] == [run.compression.removesuffix("none")]
    assert count > 2 * WRENCHES
    (again,) = mcap_files(run.again)
    assert_read_alike(again, *read_log(again))


def test_a_log_that_was_cut_off_and_recovered(run, read_log, tmp_path):
    file = max(mcap_files(run.log), key=lambda file: file.stat().st_size)  # most of the drive, where there are several
    broken = tmp_path / "broken.mcap"
    data = file.read_bytes()
    broken.write_bytes(data[: len(data) * 3 // 4])
    recover(broken, tmp_path / "whole")
    (whole,) = mcap_files(tmp_path / "whole")
    before, found = read_log(file, whole)
    assert_read_alike(whole, found)
    saved = found["streamed"]["messages"]
    assert len(saved) > len(before["streamed"]["messages"]) / 3
    assert saved == before["streamed"]["messages"][: len(saved)]

    replay(tmp_path / "whole", tmp_path / "again")
    (again,) = read_log(*mcap_files(tmp_path / "again"))
    begin = min(stamp for topic, _, stamp, *_ in found["messages"] if topic == "/tire_dynamics/log_record")
    for name in ("/left/axle_wrench", "/right/axle_wrench"):
        live, replayed = (
            [rest for topic, _, *rest in one["messages"] if topic == name and rest[0] > begin] for one in (found, again)
        )
        assert len(live) > 50
        assert replayed[: len(live)] == live
        assert len(replayed) - len(live) <= 1  # a tick that was saved, and its wrenches not
