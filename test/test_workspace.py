"""The node in a workspace with interface packages: ``test/interfaces``, in an environment that has them."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

import workspace

pytestmark = [pytest.mark.live, pytest.mark.slow]


def test_the_node_beside_interface_packages():
    folder = workspace.ROOT / "test" / "interfaces"
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-n", "0", folder],
        cwd=workspace.ROOT,
        env=workspace.sourced(workspace.built()),
        capture_output=True,
        text=True,
        timeout=workspace.PATIENCE,
    )
    last = run.stdout.strip().splitlines()[-1]
    assert run.returncode == 0, run.stdout[-8000:] + run.stderr[-2000:]
    assert re.search(r"\b\d+ passed", last) and "skipped" not in last
