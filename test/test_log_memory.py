"""What a live log keeps in memory, and what it has not yet handed to the operating system."""

from __future__ import annotations

import gc
import random
import sys
from pathlib import Path
from types import FunctionType, ModuleType

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader

from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.cdr import messages
from tire_dynamics.cdr.messages import encode_float64
from tire_dynamics.replay.parameters import complete
from tire_dynamics.ros.log import CHUNK_SIZE, FLUSH_INTERVAL, LogFiles

SECOND = 10**9
FOREVER = float("inf")
TOPICS = {f"/t{number}": (messages.FLOAT64, "sensor_data") for number in range(29)}  # four wheels have as many


def index_entry(channels: int) -> int:
    """Bytes of a chunk index record in an MCAP file (format 0), of a zstd chunk with messages on so many channels."""
    head = 1 + 8  # opcode and length
    times_and_place = 4 * 8  # first and last time, the chunk's place and length
    message_indexes = 4 + channels * (2 + 8) + 8
    return head + times_and_place + message_indexes + 4 + len("zstd") + 2 * 8


ENTRY = index_entry(len(TOPICS))


class Drive:
    """A log that is written in simulated time: every half second one message on each topic."""

    def __init__(self, folder: Path, max_size: float = FOREVER, max_duration: float = FOREVER) -> None:
        self.bag = BagWriter(folder, chunk_size=CHUNK_SIZE)
        self.files = LogFiles(self.bag, TOPICS, max_size, max_duration, 0.0)
        self.steps = 0

    def go_on(self, steps: int, times: int = 1) -> None:
        """So many chunks more, each of ``times`` messages on each topic."""
        for _ in range(steps):
            self.steps += 1
            now = self.steps * FLUSH_INTERVAL
            stamp = int(now * SECOND)
            flushed = self.files.write([(topic, stamp, stamp, encode_float64(now)) for topic in TOPICS] * times, now)
            assert flushed


def held(*roots: object) -> int:
    """Bytes of everything that these objects lead to, classes and modules aside."""
    found: dict[int, object] = {}
    waiting = list(roots)
    while waiting:
        one = waiting.pop()
        if id(one) not in found and not isinstance(one, (type, ModuleType, FunctionType)):
            found[id(one)] = one
            waiting += gc.get_referents(one)
    return sum(map(sys.getsizeof, found.values()))


def test_a_chunk_costs_its_entry_in_the_summary_and_no_more(tmp_path):
    """As bytes, with an eighth that a bytearray takes ahead, and what integers need to become larger."""
    drive = Drive(tmp_path / "log")
    with drive.bag:
        drive.go_on(20)
        before = held(drive.bag, drive.files)
        assert before > 20 * ENTRY
        drive.go_on(200)
        assert 180 * ENTRY <= held(drive.bag, drive.files) - before < 1.125 * 220 * ENTRY + 500
    with open(tmp_path / "log" / "log_0.mcap", "rb") as file:
        assert len(make_reader(file, validate_crcs=True).get_summary().chunk_indexes) == 220


def test_messages_cost_nothing(tmp_path):
    """As many chunks of three times as many messages: the same. (Python keeps the integers up to 256 for all.)"""
    kept = []
    for times in (5, 15):
        drive = Drive(tmp_path / f"log_{times}")
        with drive.bag:
            drive.go_on(60, times)
            kept.append(held(drive.bag, drive.files))
    assert abs(kept[1] - kept[0]) < 100  # 17 400 messages more


@pytest.mark.parametrize("limit", ["size", "duration"])
def test_another_file_begins_without_what_the_one_before_kept(tmp_path, limit):
    """Of each file three numbers remain, 24 bytes; with an array's sixteenth ahead."""
    drive = Drive(tmp_path / "log", **{"size": {"max_size": 20e3}, "duration": {"max_duration": 5.0}}[limit])
    kept = []
    with drive.bag:
        while drive.files.count < 12:
            count = drive.files.count
            drive.go_on(1)
            if drive.files.count > count:
                kept.append(held(drive.bag, drive.files))
    assert kept[-1] - kept[1] < 1.2 * 24 * 12 + 500
    reader = BagReader(tmp_path / "log")
    assert reader.message_count == drive.steps * len(TOPICS) and len(reader.paths) == 12


def test_by_default_a_file_ends_before_its_summary_takes_7_mb():
    """A third of what a day may cost. A file has a chunk for each flush, and one for each that is full meanwhile.

    The messages of a full chunk are at most four times as long as the chunk: `benchmarks/log_memory.py` has 1.8 times.
    """
    values = complete({})
    flushed = values["log.max_duration_s"] / FLUSH_INTERVAL
    full = 1e6 * values["log.max_size_mb"] / (CHUNK_SIZE / 4)
    assert 0.0 < 1.125 * (flushed + full) * ENTRY < 7e6


def readable(file: Path) -> list[int]:
    """The log times in a file that has no end, as the mcap library's reader finds them on the disk."""
    found = []
    with open(file, "rb") as stream:
        try:
            for _, _, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
                found.append(message.log_time)
        except EndOfFile:
            pass
    return found


def test_nothing_older_than_a_flush_is_in_memory_alone(tmp_path):
    """Whatever comes, and whenever the thread gets to run: what a SIGKILL can cost, beside the time of one look."""
    noise = random.Random(4)
    bag = BagWriter(tmp_path / "log", chunk_size=CHUNK_SIZE)
    with bag:
        files = LogFiles(bag, TOPICS, FOREVER, FOREVER, 0.0)
        written: list[int] = []
        now, flushes, waited = 0.0, 0, 0
        for _ in range(60):
            now += 0.02 * noise.choice([1, 1, 2, 5, 10, 40])
            stamp = int(now * SECOND)
            batch = [("/t0", stamp, stamp, b"\0\1\0\0" + bytes(8))] * noise.choice([0, 1, 10])
            flushed = files.write(batch, now)
            written += [stamp] * len(batch)
            found = readable(tmp_path / "log" / "log_0.mcap")
            assert found == written[: len(found)]
            assert len(found) == len(written) or not flushed
            assert all(stamp > int((now - FLUSH_INTERVAL) * SECOND) for stamp in written[len(found) :])
            flushes, waited = flushes + flushed, waited + (len(found) < len(written))
    assert flushes > 5 and waited > 5
