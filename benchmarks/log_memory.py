"""The memory that a log takes in a long drive: some hours of messages at full speed, resident memory after each.

The messages are one second of a live log, four wheels at 500 Hz with all their inputs and outputs, written again and
again with the times that follow. They go through what the log's thread writes with, which is told the time: 50 blocks
a second, flushes and files as in a drive. Files that are finished are deleted.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from pathlib import Path

import numpy as np
from harness import print_machine, print_table, write_json

from tire_dynamics.bag import BagWriter
from tire_dynamics.cdr import messages
from tire_dynamics.replay.parameters import complete
from tire_dynamics.replay.pipeline import TICK, Pipeline
from tire_dynamics.ros.log import CHUNK_SIZE, LogFiles

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
SECOND = 10**9
BLOCKS = 50  # a second: the log's thread looks every 20 ms
BEGIN = 1_700_000_000 * SECOND

Messages = list[tuple[str, int, bytes]]  # topic, ns since the second began, data


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--hours", type=float, default=4.0, help="of the drive (default 4)")
    options.add_argument("--rate", type=float, default=500.0, help="of the node and of the loads [Hz] (default 500)")
    options.add_argument("--max-size-mb", type=float, default=None, help="log.max_size_mb (default: the node's)")
    options.add_argument("--max-duration-s", type=float, default=None, help="log.max_duration_s (default: the node's)")
    options.add_argument("--json", metavar="FILE", help="write the figures there as well")
    given = options.parse_args()
    print_machine()
    values = complete({"wheels": list(WHEELS), "rate_hz": given.rate})
    size = values["log.max_size_mb"] if given.max_size_mb is None else given.max_size_mb
    duration = values["log.max_duration_s"] if given.max_duration_s is None else given.max_duration_s
    topics, second = one_second(values)
    blocks: list[Messages] = [[] for _ in range(BLOCKS)]
    for message in second:
        blocks[message[1] * BLOCKS // SECOND].append(message)
    rows = []
    written, begun = 0, time.process_time()
    with tempfile.TemporaryDirectory(prefix="tire_dynamics_log_") as folder:
        bag = BagWriter(Path(folder, "log"), chunk_size=CHUNK_SIZE)
        with bag:
            files = LogFiles(bag, topics, 1e6 * size or math.inf, duration or math.inf, 0.0)
            for number in range(round(3600 * given.hours)):
                if number == 60 or number % 3600 == 0 and number:
                    rows.append(row(number / 3600.0, files.count, written + bag.size, begun))
                    print(f"{rows[-1][0]} hours: {rows[-1][1]} MiB", flush=True)
                start = BEGIN + number * SECOND
                for block, some in enumerate(blocks):
                    batch = [(topic, start + after, start + after, data) for topic, after, data in some]
                    before = bag.size
                    files.write(batch, number + (block + 1) / BLOCKS)
                    if bag.size < before:
                        written += before
                        for old in Path(folder, "log").glob(f"log_{files.count - 2}.mcap"):
                            old.unlink()
            rows.append(row(given.hours, files.count, written + bag.size, begun))
    print_table(("hours", "resident [MiB]", "files", "written [MB]", "processor [s]"), rows)
    memory = [float(each[1]) for each in rows]
    rose, left = max(memory) - memory[0], memory[-1] - memory[0]
    print(
        f"{len(second)} messages a second, {sum(len(data) for _, _, data in second) / 1e6:.2f} MB of data\n"
        f"after the first minute resident memory rose by {rose:.1f} MiB at the most, by {left:.1f} in the end"
    )
    write_json(given.json, "log_memory", {"hours": [float(each[0]) for each in rows], "resident_mib": memory})


def row(hours: float, files: int, written: int, begun: float) -> tuple[str, ...]:
    used = time.process_time() - begun
    return f"{hours:.3f}", f"{resident():.1f}", str(files), f"{written / 1e6:.0f}", f"{used:.0f}"


def resident() -> float:
    """Resident memory [MiB]."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024.0
    return math.nan


def one_second(values: dict[str, object]) -> tuple[dict[str, tuple[str, str]], Messages]:
    """The topics of a log, and the messages of one second of it behind one in which the wheels start."""
    pipeline = Pipeline(values)
    topics = {f"/{name}": (msgtype, "sensor_data") for name, msgtype in pipeline.inputs.items()}
    topics |= {f"/{name}": (msgtype, "default") for name, msgtype in pipeline.outputs.items()}
    topics[TICK.replace("~", "/tire_dynamics")] = (messages.CLOCK, "default")
    joints = messages.JointStateEncoder(list(WHEELS))
    loads = messages.WrenchEncoder("wheel")
    noise = np.random.default_rng(1992)
    period = pipeline.vehicle.settings.period
    found: Messages = []
    for tick in range(2 * SECOND // period):
        now = BEGIN + tick * period
        taken: list[tuple[str, bytes]] = []
        if tick % max(1, SECOND // 100 // period) == 0:
            taken.append(("joint_states", joints.encode(now, (80.0 + noise.normal(size=4)).tolist())))
        taken += [(f"{wheel}/load", loads.encode(now, 0.0, 4000.0 + 300.0 * noise.normal())) for wheel in WHEELS]
        for topic, data in taken:
            pipeline.receive(topic, now, data)
        out = [(TICK.replace("~", "tire_dynamics"), messages.encode_clock(now)), *pipeline.tick(now), *pipeline.belts()]
        if now >= BEGIN + SECOND:
            found += [(f"/{topic}", now - BEGIN - SECOND, data) for topic, data in (*taken, *out)]
    return topics, found


if __name__ == "__main__":
    main()
