"""What the tests with others' software share: live runs that a Cyclone DDS participant drove, and Node.js."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from live_run import RUNS, Run, live
from test_live_log import PATIENCE

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def runs() -> dict[str, Run]:
    """The runs that there have been."""
    return {}


@pytest.fixture(params=RUNS)
def run(request, runs, ros_domain, tmp_path_factory) -> Run:
    """The node with a log of each compression, fed by Cyclone DDS; run once, looked at by every test."""
    if request.param not in runs:
        runs[request.param] = live(request.param, tmp_path_factory.mktemp(request.param))
    return runs[request.param]


@pytest.fixture(scope="session")
def read_log():
    """Reads MCAP files with Foxglove's readers under Node.js; what ``read_log.cjs`` says of each."""
    folder = Path(sys.prefix) / "interop"
    if not (folder / "node_modules" / "@mcap" / "core").is_dir():
        pytest.skip("Foxglove's readers are not there: npm could not install them; `make interop` tries it again")
    node = shutil.which("node", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))

    def read(*files: Path) -> list[dict[str, Any]]:
        done = subprocess.run(
            [node, str(HERE / "read_log.cjs"), *map(str, files)],
            env={**os.environ, "NODE_PATH": str(folder / "node_modules")},
            capture_output=True,
            text=True,
            timeout=2 * PATIENCE,
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return read
