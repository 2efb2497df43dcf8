"""``tire-dynamics info`` against other readers of the same bags, and against bags that are damaged or hostile."""

from __future__ import annotations

import json
import os
import pty
import re
import shlex
import struct
import subprocess
import sys
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path

import pytest
from examples import spared
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from test_cli import BEGIN, COMMAND, REPOSITORY, called, refused, write_bag
from test_hostile import BAG, LIES, LONG, NO_FILES, file_of, in_a_process, no_files, servant, written  # noqa: F401

from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.cdr import messages
from tire_dynamics.cdr.messages import WrenchEncoder, encode_float64, encode_string
from tire_dynamics.cli.info import info

SAMPLE = REPOSITORY / "bags" / "sample"


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    """A log of two wheels, with a tire of its own."""
    folder = tmp_path_factory.mktemp("log")
    config = folder / "config.yaml"
    config.write_text(
        "/**:\n  ros__parameters:\n    wheels: [left, right]\n    rate_hz: 250.0\n    tire: {radius: 0.31}\n"
    )
    assert called("replay", write_bag(folder / "input"), "-o", folder / "log", "--config", config).returncode == 0
    return folder / "log"


# --- what it says is so ---


def _reliability(connection) -> list[str]:
    return [profile.reliability.name.lower() for profile in connection.ext.offered_qos_profiles]


@pytest.mark.parametrize("which", ["sample", "log"])
def test_it_agrees_with_another_reader(which, log):
    path = SAMPLE if which == "sample" else log
    content = info(path)
    with Reader(path) as reader:
        theirs = {each.topic: (each.msgtype, each.msgcount, _reliability(each)) for each in reader.connections}
        ours = {
            each["name"]: (each["type"], each["messages"], [text.partition(",")[0] for text in each["qos"]])
            for each in content["topics"]
        }
        assert ours == theirs
        assert content["messages"] == reader.message_count
        assert content["begin_ns"] == reader.start_time
        assert content["end_ns"] == reader.end_time - 1  # rosbags counts the end as not included
    (file,) = path.glob("*.mcap")
    assert content["files"] == [{"name": file.name, "bytes": file.stat().st_size}]
    with open(file, "rb") as stream:
        summary = make_reader(stream).get_summary()
    assert content["chunks"] == {"zstd": len(summary.chunk_indexes)}


def test_times_and_rates(tmp_path):
    """100 messages, one every 10 ms: 0.99 s from the first to the last."""
    content = info(write_bag(tmp_path / "bag"))
    assert content["duration_s"] == pytest.approx(0.99, rel=1e-12)  # of two integers; the product is rounded
    assert all(topic["rate_hz"] == pytest.approx(100.0, rel=1e-12) for topic in content["topics"])
    begin = datetime.fromtimestamp(BEGIN // 10**9, timezone.utc)
    assert content["begin"] == f"{begin:%Y-%m-%dT%H:%M:%S}.000000000Z"
    assert content["end"].endswith(".990000000Z")


def test_a_log_says_whose_it_is_and_with_which_parameters(log):
    assert info(log)["log"] == {
        "node": "/tire_dynamics",
        "wheels": ("left", "right"),
        "rate_hz": 250.0,
        "parameters": {"rate_hz": 250.0, "tire.radius": 0.31},
        "dropped": {},
    }
    assert info(SAMPLE)["log"] is None


def many_chunks(path: Path, record: str, dropped: dict[str, int]) -> Path:
    """A log whose first and last message is a record, with many chunks between."""
    content = json.loads(record)
    with BagWriter(path, chunk_size=1000) as bag:
        notes = bag.add_topic("/tire_dynamics/log_record", messages.STRING)
        speed = bag.add_topic("/left/wheel_speed", messages.FLOAT64)
        load = bag.add_topic("/left/load", messages.WRENCH_STAMPED)
        bag.write(notes, BEGIN, BEGIN, encode_string(json.dumps(content)))
        for now in range(BEGIN + 1, BEGIN + 1000):
            bag.write(speed, now, now, encode_float64(50.0))
            bag.write(load, now, now, WrenchEncoder("axle").encode(now, 0.0, 4000.0))
        bag.write(notes, now, now, encode_string(json.dumps({**content, "dropped": dropped})))
    return path


@pytest.fixture
def lossy(tmp_path, log) -> Path:
    record = next(data for *_, data in BagReader(log).messages(["/tire_dynamics/log_record"]))
    return many_chunks(tmp_path / "lossy", messages.decode_string(record), {"/left/load": 3})


def test_what_the_log_lost_stands_in_its_last_record(lossy):
    assert info(lossy)["log"]["dropped"] == {"/left/load": 3}
    assert re.search(r"^dropped +/left/load 3$", called("info", lossy).stdout, re.MULTILINE)


def test_only_the_chunks_that_matter_are_read(lossy):
    """All others may be broken without a change in what is said, so a long bag is not read."""
    expected = info(lossy)
    assert expected["chunks"]["zstd"] > 50
    path = lossy / "lossy_0.mcap"
    with open(path, "rb") as stream:
        summary = make_reader(stream).get_summary()
    (notes,) = (number for number, channel in summary.channels.items() if channel.topic.endswith("/log_record"))
    content = bytearray(path.read_bytes())
    broken = 0
    for index in summary.chunk_indexes:
        if notes not in index.message_index_offsets:
            end = index.chunk_start_offset + index.chunk_length
            content[end - 20 : end] = bytes(20)
            broken += 1
    assert broken == expected["chunks"]["zstd"] - 2
    path.write_bytes(content)
    with pytest.raises(Exception, match="damaged"):
        list(BagReader(lossy).messages())
    assert info(lossy) == expected


def test_a_bag_of_several_files(tmp_path, lossy):
    """Files that go on after another, as a log has them that is split."""
    bag = write_bag(tmp_path / "bag")
    (lossy / "lossy_0.mcap").rename(bag / "bag_1.mcap")
    description = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(re.sub(r"(\n *- )bag_0.mcap", r"\1bag_0.mcap\1bag_1.mcap", description, count=1))
    content = info(bag)
    assert [file["name"] for file in content["files"]] == ["bag_0.mcap", "bag_1.mcap"]
    counts = {topic["name"]: topic["messages"] for topic in content["topics"]}
    assert counts == {
        "/left/load": 100 + 999, "/left/wheel_speed": 100 + 999, "/right/load": 100, "/right/wheel_speed": 100,
        "/tire_dynamics/log_record": 2,
    }  # fmt: skip
    assert content["log"]["dropped"] == {"/left/load": 3}


# --- damaged, or not to be replayed ---


@pytest.mark.parametrize("percent", [30, 60, 80])
def test_a_truncated_bag_is_counted_and_what_helps_helps(tmp_path, percent):
    path = written(tmp_path / "cut 1.mcap", BAG["zstd"][: len(BAG["zstd"]) * percent // 100])
    content = info(path)
    assert "byte" in content["damage"]
    counts = {topic["name"]: topic["messages"] for topic in content["topics"]}
    found = [topic for topic, *_ in BagReader(path).messages()]
    assert counts == {topic: found.count(topic) for topic in counts} and sum(counts.values()) == content["messages"] > 0
    done = subprocess.run(
        [*COMMAND, *shlex.split(content["repair"].replace("OUT", "whole"))[1:]],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(REPOSITORY)}, capture_output=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0
    assert info(tmp_path / "whole")["damage"] is None and info(tmp_path / "whole")["messages"] >= content["messages"]


@pytest.mark.slow
def test_whether_it_can_be_replayed_is_what_replay_finds(tmp_path, log):
    with BagWriter(tmp_path / "other") as bag:
        bag.write(
            bag.add_topic("/fl/force", messages.WRENCH_STAMPED),
            BEGIN,
            BEGIN,
            WrenchEncoder("a").encode(BEGIN, 0.0, 1.0),
        )
        bag.write(bag.add_topic("/fl/omega", messages.FLOAT64), BEGIN, BEGIN, encode_float64(1.0))
    with BagWriter(tmp_path / "speeds") as bag:
        bag.add_topic("/w/load", messages.WRENCH_STAMPED)
    with BagWriter(tmp_path / "silent") as bag:
        bag.add_topic("/w/load", messages.WRENCH_STAMPED)
        bag.add_topic("/w/wheel_speed", messages.FLOAT64)
    for path in (SAMPLE, log, *(tmp_path / name for name in ("other", "speeds", "silent"))):
        replay = info(path)["replay"]
        done = called("replay", path, "-o", tmp_path / "out", "--force")
        assert replay["possible"] == (done.returncode == 0), done.stderr
        if not replay["possible"] and path.name != "silent":
            assert replay["why_not"] in done.stderr
    assert info(log)["replay"]["inputs"]["left/load"] == "/left/load"
    why = info(tmp_path / "other")["replay"]["why_not"]
    assert "--remap wheel/load:=/fl/force" in why
    remaps = {"wheel/load": "/fl/force", "wheel/wheel_speed": "/fl/omega"}
    replay = info(tmp_path / "other", remaps)["replay"]
    assert replay == {"possible": True, "wheels": ("wheel",), "inputs": remaps, "without": {}, "mapped": []}


def test_counts_that_do_not_add_up_are_not_believed(tmp_path):
    """Without an index of its own a bag is counted; with one that contradicts itself the counts are not known."""
    content = bytearray(BAG["zstd"])
    with open(written(tmp_path / "bag.mcap", bytes(content)), "rb") as stream:
        counts = make_reader(stream).get_summary().statistics.channel_message_counts
    told = b"".join(struct.pack("<HQ", *item) for item in counts.items())
    place = content.rindex(told)
    content[place : place + len(told)] = b"".join(struct.pack("<HQ", channel, 7) for channel in counts)
    footer = content.rindex(struct.pack("<BQ", 2, 20))
    content[footer + 9 + 16 : footer + 9 + 20] = bytes(4)  # no checksum
    path = written(tmp_path / "lie.mcap", bytes(content))
    assert {topic["messages"] for topic in info(path)["topics"]} == {None}
    assert info(path)["messages"] == 400
    assert re.search(r"/wheel/load .* \?", called("info", path).stdout)


# --- how it is shown ---


def test_in_a_pipe_it_is_plain_and_in_columns():
    done = called("info", SAMPLE)
    assert done.stderr == "" and done.stdout.isascii() and "\x1b" not in done.stdout
    *_, table = done.stdout.split("\n\n")
    head, *rows = table.splitlines()
    assert len(rows) == 5
    place = head.index("messages") + len("messages")
    for row in rows:  # the column of numbers ends where its head does
        assert row[:place].endswith("000") and row[place : place + 2] == "  "


def terminal(*arguments, **environment) -> str:
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY), "TERM": "xterm", "COLUMNS": "80", **environment},
        stdout=theirs,
    )
    os.close(theirs)
    shown = b""
    with suppress(OSError):  # the end of a terminal, on Linux
        while block := os.read(ours, 4096):
            shown += block
    os.close(ours)
    assert process.wait(timeout=300) == 0
    return shown.decode().replace("\r\n", "\n")


def test_on_a_terminal_it_is_a_table_in_colour():
    pytest.importorskip("rich", reason="rich is not installed, and without it there is no table")
    shown = terminal("info", SAMPLE)
    assert "\x1b[" in shown and "\u2500" in shown
    plain = re.sub(r"\x1b\[[0-9;]*m", "", shown)
    for topic in ("/front_left/load", "/joint_states"):
        assert re.search(rf"^ *{topic} .*[\d,]+ ", plain, re.MULTILINE)  # not folded, in 80 columns
    assert max(map(len, plain.splitlines())) <= 80
    assert "\x1b[3" not in terminal("info", SAMPLE, NO_COLOR="1")


@pytest.mark.parametrize("path", [SAMPLE, "cut"])
def test_json_is_the_same_on_standard_output(tmp_path, path):
    if path == "cut":
        path = written(tmp_path / "cut.mcap", BAG["zstd"][:5000])
    done = called("info", path, "--json")
    answer = json.loads(done.stdout, parse_constant=lambda text: pytest.fail(f"{text} is not JSON"))
    assert done.stderr == "" and answer == json.loads(json.dumps(info(path)))


# --- strangers' files ---


@pytest.mark.slow
@pytest.mark.parametrize("name", spared(LIES, LONG))
def test_a_file_that_lies(tmp_path, name):
    """An answer on standard output or one line and status 2; always within the limits of time and memory."""
    path = written(tmp_path / "lie.mcap", file_of(LIES[name][0]()))
    status, out, err = in_a_process("info", path)
    assert (status, err.count("\n")) in ((0, 0), (2, 1)) and "Traceback" not in err
    assert (out == "") == (status == 2)
    assert all(line.isprintable() for line in out.split("\n"))
    assert os.listdir(tmp_path) == ["lie.mcap"]


@pytest.mark.slow
@pytest.mark.parametrize("name", NO_FILES)
def test_what_is_no_file(no_files, name):  # noqa: F811
    status, out, err = in_a_process("info", no_files[name])
    assert status == 2 and out == "" and err.count("\n") == 1 and err.startswith("tire-dynamics: ")


@pytest.mark.parametrize(
    "content", ["", "[]", "1" * 10**6, '{"parameters": {"wheels": [[]]}, "topics": {}, "vehicle": {}}']
)
def test_a_log_record_that_lies(tmp_path, content):
    with BagWriter(tmp_path / "bag") as bag:
        bag.write(bag.add_topic("/n/log_record", messages.STRING), BEGIN, BEGIN, encode_string(content))
    answer = info(tmp_path / "bag")
    assert answer["log"]["error"] and not answer["replay"]["possible"]
    assert called("info", tmp_path / "bag").returncode == 0


def test_names_that_a_terminal_would_obey(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_metadata("a\x1b[2Jb", {"\x1b]0;x\x07": "\n\n\x1b[31m"})
        bag.write(bag.add_topic("/chatter", messages.STRING), 1, 1, encode_string("hello"))
    done = called("info", tmp_path / "bag")
    assert done.returncode == 0 and "\x1b" not in done.stdout and "\x07" not in done.stdout
    if sys.stdout is not None:
        assert "\x1b[2J" not in terminal("info", tmp_path / "bag")


def test_what_is_no_bag_says_what_is(tmp_path):
    said = refused("info", written(tmp_path / "a.mcap", "no bag"))
    assert "a rosbag2 folder, or a .mcap, .db3 or .bag file is wanted" in said
