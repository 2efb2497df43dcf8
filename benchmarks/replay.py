"""Replay against the floor of its input and output, and against libraries that encode; and its peak memory.

    python benchmarks/replay.py [--seconds 120] [--repeats 3] [--json FILE]

The bag has four wheels: loads at 500 Hz with jittered stamps, joint states at 100 Hz with varying speeds. Replay
writes the inputs as they were, ticks and all outputs: wrenches at 500 Hz, rings of 72 points at 50 Hz. Each case is a
process of its own, which has loaded and compiled everything before it is measured; cases take turns.

floor      reads and decodes the same input, and writes as many messages of the same sizes, ready-made, with chunks
           of the same size and zstd: no model, nothing encoded. The messages are those of a real output of 10 s, over
           and over, with later times
libraries  the same, but message objects are encoded; on 10 s, scaled. mcap_ros2 encodes the inputs again as well
memory     the highest resident memory of the process, with everything it has loaded
TMPDIR     says where the bags are made; /dev/shm leaves the disk out
"""

from __future__ import annotations

import hashlib
import itertools
import json
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from harness import parser, peak_memory, print_machine, print_table, shown, spread, write_json
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.cdr import messages
from tire_dynamics.replay.replay import replay

SECOND = 10**9
BEGIN = 1_700_000_000 * SECOND
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
LOAD_RATE, JOINT_RATE = 500, 100  # [Hz]
SHORT = 10  # [s] of driving for ready-made messages and for the libraries
CHUNK = 2**20  # bytes, as replay has it
HOUR = 3600.0
RECORD = messages.STRING
SPEED_TARGET, FLOOR_TARGET, MEMORY_TARGET = 100.0, 1.3, 1.1

OURS = {"ours": "replay"}
FLOORS = {
    "floor": "floor: mcap library reads, struct decodes, mcap library writes",
    "floor reader": "floor: our reader and decoder, mcap library writes",
    "floor bulk": "floor: our reader and decoder, our writer",
}
LIBRARIES = {"rosbags": "rosbags decodes, encodes, writes", "mcap_ros2": "mcap_ros2 decodes, encodes, writes"}
NEEDED = {"rosbags": "rosbags", "mcap_ros2": "mcap_ros2"}
INSTALL = {"rosbags": "rosbags", "mcap_ros2": "mcap-ros2-support"}


def main() -> None:
    options = parser(__doc__.splitlines()[0], repeats=3)
    options.add_argument("--seconds", type=int, default=120, help="of driving, >= 10 (default 120)")
    options.add_argument("--longer", type=int, default=10, help="times longer bag for the memory; 0: none (default 10)")
    options.add_argument("--child", help="for this program itself: one case, on a folder")
    options.add_argument("--folder", type=Path)
    options.add_argument("--source", default="input")
    chosen = options.parse_args()
    if chosen.child:
        print(json.dumps(CHILDREN[chosen.child](chosen.folder, chosen.folder / chosen.source, chosen.child)))
        return
    if chosen.seconds < SHORT:
        options.error(f"--seconds is {chosen.seconds}; it must be at least {SHORT}")
    print_machine()
    with tempfile.TemporaryDirectory(prefix="replay_") as name:
        folder = Path(name)
        write_input(folder / "short", SHORT)
        write_input(folder / "input", chosen.seconds)
        replay(folder / "short", folder / "pool")
        replay(folder / "input", folder / "count")
        figures = measured(folder, chosen.seconds, chosen.repeats)
        if chosen.longer:
            write_input(folder / "longer", chosen.longer * chosen.seconds)
            figures["memory"] = memory(folder, chosen.seconds, chosen.longer)
    report(figures, chosen.seconds, chosen.repeats)
    write_json(chosen.json, "replay", figures)


def measured(folder: Path, seconds: int, repeats: int) -> dict[str, Any]:
    """All cases in turn."""
    skipped = {
        case: f"{module} is not installed (pip install {INSTALL[module]})"
        for case, module in NEEDED.items()
        if find_spec(module) is None
    }
    cases = [case for case in CHILDREN if case not in skipped]
    runs: dict[str, list[dict[str, Any]]] = {case: [] for case in cases}
    for repeat in range(repeats):
        for case in cases if repeat % 2 == 0 else reversed(cases):
            runs[case].append(child(folder, case, "short" if case in LIBRARIES else "input"))
    figures: dict[str, Any] = {"skipped": skipped, "cases": {}}
    for case, found in runs.items():
        scale = HOUR / (SHORT if case in LIBRARIES else seconds)
        rows: dict[str, Any] = {key: spread(run[key] * scale for run in found) for key in ("wall", "cpu")}
        rows["parts"] = {key: spread(run["parts"][key] * scale for run in found) for key in found[0]["parts"]}
        rows["real_time"] = spread(HOUR / (run["wall"] * scale) for run in found)
        rows["messages"] = found[0]["messages"]
        for floor in ("floor", "floor reader", "floor bulk"):
            other = [run["wall"] * HOUR / seconds for run in runs[floor]]
            rows[f"against_{floor}"] = spread(run["wall"] * scale / f for run, f in zip(found, other, strict=True))
        figures["cases"][case] = rows
    digests = {case: {run["digest"] for run in found} for case, found in runs.items() if case in OURS}
    if len(digests["ours"]) != 1:
        raise SystemExit("replays of one bag are not the same bytes")
    if len({runs[case][0]["messages"] for case in cases if case not in LIBRARIES}) != 1:
        raise SystemExit("the floor does not write as many messages as replay")
    return figures


def memory(folder: Path, seconds: int, longer: int) -> dict[str, Any]:
    """Peak memory [MiB] and x real time for the bag and a longer one."""
    short, long = (child(folder, "ours", source) for source in ("input", "longer"))
    return {
        "seconds": [seconds, longer * seconds],
        "mib": [short["memory"], long["memory"]],
        "ratio": long["memory"] / short["memory"],
        "real_time": [seconds / short["wall"], longer * seconds / long["wall"]],
    }


def child(folder: Path, case: str, source: str) -> dict[str, Any]:
    """One case in a process of its own."""
    command = [sys.executable, __file__, "--child", case, "--folder", str(folder), "--source", source]
    result: dict[str, Any] = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)
    return result


def report(figures: dict[str, Any], seconds: int, repeats: int) -> None:
    names = {**OURS, **FLOORS, **LIBRARIES}
    rows = []
    for case, row in figures["cases"].items():
        against = [shown(row[f"against_{floor}"]) for floor in FLOORS]
        goal = {"ours": f">= {SPEED_TARGET:g} x, / in bulk <= {FLOOR_TARGET}"}
        rows.append(
            (names[case], shown(row["wall"], ".1f"), shown(row["cpu"], ".1f"), shown(row["real_time"], ".1f"))
            + (*against, goal.get(case, ""))
        )
    header = (f"four wheels, {seconds} s of driving, x{repeats}", "s/hour", "CPU s/hour", "x real time")
    print_table((*header, "/ floor", "/ with our reader", "/ in bulk", "target"), rows)
    for case, row in figures["cases"].items():
        if row["parts"]:
            parts = ", ".join(f"{name} {shown(part, '.1f')}" for name, part in row["parts"].items())
            print(f"{names[case]} [s/hour]: {parts}")
    for case, why in figures["skipped"].items():
        print(f"{names[case]}: left out, {why}")
    if "memory" in figures:
        found = figures["memory"]
        for length, mib, speed in zip(found["seconds"], found["mib"], found["real_time"], strict=True):
            print(f"{length} s of driving: {mib:.1f} MiB at the peak, {speed:.1f} x real time")
        print(f"peak memory: {found['ratio']:.3f} x, target <= {MEMORY_TARGET}")


# -- the input --------------------------------------------------------------------------------------------------


def write_input(folder: Path, seconds: int) -> None:
    """A bag of four wheels' loads and joint states."""
    chance = np.random.default_rng(1992)
    wrench = messages.WrenchEncoder("contact")
    joints = messages.JointStateEncoder(WHEELS)
    with BagWriter(folder, chunk_size=CHUNK) as writer:
        loads = [writer.add_topic(f"/{wheel}/load", messages.WRENCH_STAMPED) for wheel in WHEELS]
        states = writer.add_topic("/joint_states", messages.JOINT_STATE)
        for first in range(0, seconds, SHORT):
            length = min(SHORT, seconds - first)
            topics, stamps, delays, payloads = [], [], [], []
            for index, topic in enumerate(loads):
                t = first + np.arange(length * LOAD_RATE) / LOAD_RATE
                stamp = BEGIN + (t * SECOND).astype(np.int64) + chance.integers(0, 600_000, t.size)
                force = 4000.0 + 600.0 * np.sin(3.0 * t + index) + chance.normal(0.0, 150.0, t.size)
                payloads += wrench.encode_block(stamp, chance.normal(0.0, 80.0, t.size), force)
                topics.append(np.full(t.size, topic))
                stamps.append(stamp)
                delays.append(chance.integers(100_000, 500_000, t.size))
            t = first + np.arange(length * JOINT_RATE) / JOINT_RATE
            stamp = BEGIN + (t * SECOND).astype(np.int64) + chance.integers(0, 600_000, t.size)
            speeds = 80.0 + 30.0 * np.sin(0.2 * t)[:, None] + np.array([0.0, 0.3, -0.2, 0.1])
            payloads += [joints.encode(*each) for each in zip(stamp.tolist(), speeds.tolist(), strict=True)]
            topics.append(np.full(t.size, states))
            stamps.append(stamp)
            delays.append(chance.integers(100_000, 500_000, t.size))
            topic, stamp = np.concatenate(topics), np.concatenate(stamps)
            received = stamp + np.concatenate(delays)
            order = np.argsort(received, kind="stable")
            writer.write_block(topic[order], received[order], stamp[order], [payloads[k] for k in order.tolist()])


# -- cases, each in a process of its own ------------------------------------------------------------------------


class Clock:
    """Wall and processor time from its making on."""

    def __init__(self) -> None:
        self._wall, self._cpu = time.perf_counter(), time.process_time()
        self._last = self._wall
        self.parts: dict[str, float] = {}

    def part(self, name: str) -> None:
        now = time.perf_counter()
        self.parts[name] = now - self._last
        self._last = now

    def figures(self) -> dict[str, Any]:
        wall, cpu = time.perf_counter() - self._wall, time.process_time() - self._cpu
        return {"wall": wall, "cpu": cpu, "parts": self.parts, "memory": peak_memory()}


class LibraryWriter(Writer):
    """The mcap library's writer behind the interface of ours."""

    def add_block(self, *columns: Any) -> None:
        topics, log_times, publish_times, payloads, *_ = columns
        numbers = (np.broadcast_to(each, len(payloads)).tolist() for each in (topics, log_times, publish_times))
        for topic, log_time, publish_time, data in zip(*numbers, payloads, strict=True):
            self.add_message(topic, log_time, data, publish_time)


class LibraryBag(BagWriter):
    def _open_mcap(self, file: BinaryIO, chunk_size: int, compression: str) -> Any:
        return LibraryWriter(file, chunk_size, CompressionType(CompressionType[compression.upper()]))


def ours(folder: Path, source: Path, case: str) -> dict[str, Any]:
    """A replay."""
    output = folder / "output"
    replay(folder / "short", output, force=True)
    clock = Clock()
    replay(source, output, force=True)
    figures = clock.figures()
    with open(output / "output_0.mcap", "rb") as file:
        figures["digest"] = hashlib.sha256(file.read()).hexdigest() if source.name == "input" else ""
    figures["messages"] = BagReader(output).message_count
    return figures


def floor(folder: Path, source: Path, case: str) -> dict[str, Any]:
    """The same input read, as many ready-made messages written, one by one, with the mcap library."""
    writer = LibraryBag(folder / "output", force=True, chunk_size=CHUNK)
    handles = {topic: writer.add_topic(topic, kind) for topic, kind in BagReader(folder / "pool").topics.items()}
    rows = [(handles[topic], log_time, published, data) for topic, log_time, published, data in ready_made(folder)]
    clock = Clock()
    if case == "floor":
        read_with_library(source)
    else:
        read_with_ours(source)
    clock.part("read")
    add_message = writer._mcap.add_message
    for later, count in laps(folder, len(rows)):
        for topic, log_time, published, data in rows[:count]:
            add_message(topic, log_time + later, data, published + later)
    writer.close()
    clock.part("write")
    figures = clock.figures()
    return {**figures, "messages": BagReader(folder / "output").message_count}


def floor_in_bulk(folder: Path, source: Path, case: str) -> dict[str, Any]:
    """The same with our writer, in blocks."""
    pool = ready_made(folder)
    writer = BagWriter(folder / "output", force=True, chunk_size=CHUNK)
    handles = {topic: writer.add_topic(topic, kind) for topic, kind in BagReader(folder / "pool").topics.items()}
    blocks = {}
    for first in range(0, len(pool), 8192):
        topics, log_times, published, data = zip(*pool[first : first + 8192], strict=True)
        blocks[first] = (np.array([handles[t] for t in topics]), np.array(log_times), np.array(published), data)
    clock = Clock()
    read_with_ours(source)
    clock.part("read")
    for later, count in laps(folder, len(pool)):
        for first, (topic, log_time, published_at, payloads) in blocks.items():
            some = slice(max(0, count - first))
            writer.write_block(topic[some], log_time[some] + later, published_at[some] + later, payloads[some])
    writer.close()
    clock.part("write")
    figures = clock.figures()
    return {**figures, "messages": BagReader(folder / "output").message_count}


def rosbags(folder: Path, source: Path, case: str) -> dict[str, Any]:
    """rosbags decodes the inputs, encodes message objects that exist already, and writes; inputs as they were."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kinds = BagReader(folder / "pool").topics
    with tempfile.TemporaryDirectory(dir=folder) as name, Reader(source) as reader:
        writer = Writer(Path(name) / "output", version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            connections = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()}
            rows = [
                (connections[topic], log_time, data if is_input(topic) else store.deserialize_cdr(data, kinds[topic]))
                for topic, log_time, _, data in ready_made(folder)
            ]
            for connection, _, message in rows[:10_000]:  # the codecs are made
                if not isinstance(message, bytes):
                    store.serialize_cdr(message, connection.msgtype)
            clock = Clock()
            for connection, _, data in reader.messages():
                store.deserialize_cdr(data, connection.msgtype)
            clock.part("read")
            for connection, log_time, message in rows:
                if not isinstance(message, bytes):
                    message = store.serialize_cdr(message, connection.msgtype)
                writer.write(connection, log_time, message)
        clock.part("write")
        return {**clock.figures(), "messages": len(rows)}


def mcap_ros2(folder: Path, source: Path, case: str) -> dict[str, Any]:
    """mcap_ros2 decodes the inputs, encodes message objects that exist already, and writes."""
    from mcap_ros2.decoder import DecoderFactory
    from mcap_ros2.writer import Writer

    def decoded(path: Path) -> Iterator[Any]:
        with open(path, "rb") as file:
            yield from make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()

    rows = list(decoded(folder / "pool" / "pool_0.mcap"))
    with open(folder / "output.mcap", "wb") as file:
        writer = Writer(file, chunk_size=CHUNK)
        schemas = {row[0].name: writer.register_msgdef(row[0].name, row[0].data.decode()) for row in rows}
        clock = Clock()
        for _ in decoded(next(source.glob("*.mcap"))):
            pass
        clock.part("read")
        for schema, channel, message, content in rows:
            writer.write_message(channel.topic, schemas[schema.name], content, message.log_time, message.publish_time)
        writer.finish()
        clock.part("write")
        return {**clock.figures(), "messages": len(rows)}


CHILDREN: dict[str, Callable[[Path, Path, str], dict[str, Any]]] = {
    **dict.fromkeys(OURS, ours), "floor": floor, "floor reader": floor, "floor bulk": floor_in_bulk,
    "rosbags": rosbags, "mcap_ros2": mcap_ros2,
}  # fmt: skip


# -- the floor's parts ------------------------------------------------------------------------------------------


def is_input(topic: str) -> bool:
    return topic.endswith(("/load", "/joint_states"))


def ready_made(folder: Path) -> list[tuple[str, int, int, bytes]]:
    """Topic, times and data of each message of the output of 10 s, without the record at its beginning."""
    found = BagReader(folder / "pool").messages(in_file_order=True)
    return [(topic, log_time, published, data) for topic, kind, log_time, published, data in found if kind != RECORD]


def laps(folder: Path, pool: int) -> Iterator[tuple[int, int]]:
    """How much later [ns], and how many of the pool, until there are as many messages as replay writes."""
    left = BagReader(folder / "count").message_count
    for later in itertools.count(0, SHORT * SECOND):
        yield later, min(left, pool)
        left -= pool
        if left <= 0:
            return


def read_with_library(source: Path) -> None:
    """Read and decode all inputs, one by one."""
    stamp, wrench, velocities = struct.Struct("<4xiI"), struct.Struct("<4xiI4x8s4x6d"), struct.Struct("<4d")
    with open(next(source.glob("*.mcap")), "rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            data = message.data
            if channel.topic == "/joint_states":
                stamp.unpack_from(data)
                velocities.unpack_from(data, len(data) - 36)  # an empty effort's length is behind them
            else:
                wrench.unpack_from(data)


def read_with_ours(source: Path) -> None:
    """Read and decode all inputs, in blocks."""
    decoder = messages.JointStateDecoder()
    for block in BagReader(source).blocks(least=4096):
        joints = block.topic == block.topics.index("/joint_states")
        decoder.decode_block(block.data, block.start[joints], block.size[joints])
        messages.decode_wrenches(block.data, block.start[~joints], block.size[~joints])


if __name__ == "__main__":
    main()
