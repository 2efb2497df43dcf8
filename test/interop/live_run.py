"""The real node in its process, and a Cyclone DDS participant in another one that drives it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from test_live_log import PATIENCE, end, live_node, only_log, replay

__all__ = ["RUNS", "WHEELS", "WRENCHES", "Run", "live"]

WHEELS = ["left", "right"]
WRENCHES = 700  # of each wheel that Cyclone waits for: 1.4 s
RUNS = {
    "zstd": ["log.max_duration_s:=0.7"],  # goes on in another file: the log is a folder of several
    "lz4": [],
    "none": [],
}
"""By compression of the log, the other parameters of the run."""


@dataclass(frozen=True)
class Run:
    """A live run: the log's compression, log and replay, and what Cyclone sent and heard, by topic."""

    compression: str
    log: Path
    again: Path
    sent: dict[str, list[Any]] = field(repr=False)
    heard: dict[str, list[Any]] = field(repr=False)


def live(compression: str, folder: Path) -> Run:
    """The node with a log, fed until Cyclone has heard enough; and the replay of that log."""
    values = (f"wheels:=[{', '.join(WHEELS)}]", f"log.directory:={folder / 'logs'}", f"log.compression:={compression}")
    arguments = [part for value in (*values, *RUNS[compression]) for part in ("-p", value)]
    said = folder / "said.json"
    with live_node(*arguments) as node:
        peer = [sys.executable, str(Path(__file__).with_name("cyclone_peer.py")), str(said), str(WRENCHES)]
        done = subprocess.run(peer, capture_output=True, text=True, timeout=3 * PATIENCE)
        assert done.returncode == 0, done.stderr
        end(node, signal.SIGTERM)
    log = only_log(folder / "logs")
    replay(log, folder / "again")
    return Run(compression, log, folder / "again", **json.loads(said.read_text()))
