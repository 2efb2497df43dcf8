"""The scripts in examples/, run as they stand."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tire_dynamics import read_unit

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"

pytestmark = pytest.mark.slow  # a process each, and SciPy


def said_by(script: str, folder: Path, *arguments: str) -> str:
    command = [sys.executable, "-W", "error", EXAMPLES / script, *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_the_paper(tmp_path):
    said = said_by("the_paper_in_ten_lines.py", tmp_path)
    assert "0.687992 0.687992 0.613536 0.613536 0.476304 0.476304" in said  # as test_reference_values has them
    assert 22_350 < int(re.search(r"critical speed \[rpm\]: (\d+)", said)[1]) < 22_450  # Figure 7: near 22 400
    assert "0.931556" in said
    lines = (EXAMPLES / "the_paper_in_ten_lines.py").read_text(encoding="utf-8").rpartition("import")[2].splitlines()
    assert len([line for line in lines[1:] if line]) <= 10


def test_a_road_and_a_cleat(tmp_path):
    said = said_by("a_road_and_a_cleat.py", tmp_path)
    assert "asymptotically stable" in said
    for name in ("road", "cleat"):
        least, most = map(int, re.search(rf"{name}: contact force (-?\d+) to (\d+) N", said).groups())
        assert 0 <= least < 4000 < most, "a road pushes, and does not pull"
        low, high = map(int, re.search(rf"{name}: axle force (-?\d+) to (\d+) N", said).groups())
        assert least < low < 4000 < high < most, "the suspension softens what the road does"


def test_ones_own_tire(tmp_path):
    said = said_by("your_own_tire.py", tmp_path)
    unit = read_unit(tmp_path / "my_tire.yaml")
    assert (unit.wheel_mass, unit.suspension_stiffness, unit.vertical_stiffness) == (12.0, 3.2e4, 2e5)
    assert "rigid ring on its sidewall: 77.2 Hz" in said  # FREQ_LONG of the file is 77.17
    assert unit.ring_mass == pytest.approx(7.247, rel=1e-12)  # BELT_MASS
    again = said_by("your_own_tire.py", tmp_path, str(EXAMPLES / "my_tire.tir"), "20", "3e4")
    assert read_unit(tmp_path / "my_tire.yaml").wheel_mass == 20.0 and again != said


def test_each_example_is_run_here():
    names = {file.stem for file in EXAMPLES.glob("*.py")}
    assert names == {"the_paper_in_ten_lines", "a_road_and_a_cleat", "your_own_tire"}
