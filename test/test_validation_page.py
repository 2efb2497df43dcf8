"""docs/validation.md: every row says what it was held against, and names tests that there are."""

from __future__ import annotations

import re
from pathlib import Path

TESTS = Path(__file__).parent
PAGE = (TESTS.parent / "docs" / "validation.md").read_text(encoding="utf-8")
KINDS = {"measurement", "paper", "mathematics", "software", "itself"}


def rows():
    """Cells of each row of the tables whose second column is what a claim was held against."""
    held = False
    for line in PAGE.splitlines():
        if not line.startswith("|"):
            held = False
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip("|"))] if line.startswith("|") else [""]
        if cells[:1] in (["claim"], ["statement"]):
            assert cells[1] == "held against", line
            held = True
        elif held and not cells[0].startswith("---"):
            yield cells


def test_every_row_says_what_it_was_held_against():
    found = list(rows())
    assert len(found) > 100
    used = set()
    for cells in found:
        kinds = re.findall(r"\*\*(\w+)\*\*", cells[1])
        assert re.match(r"\*\*\w+\*\*(, \*\*\w+\*\*)*: \S", cells[1]), cells
        assert kinds and set(kinds) <= KINDS, cells
        used |= set(kinds)
    assert used == KINDS
    assert set(re.findall(r"^- \*\*(\w+)\*\*:", PAGE, re.MULTILINE)) == KINDS


def test_every_row_names_a_test_that_there_is():
    there = {path.stem for path in TESTS.glob("test_*.py")}
    for cells in rows():
        named = re.findall(r"`(test_\w+)`", " ".join(cells[2:]))
        assert named and set(named) <= there, cells


def test_what_was_measured_stands_at_the_top():
    top = PAGE[: PAGE.index("## How to read the tables")]
    assert "Measured, on a real tire" in top and "Never measured against" in top
    assert len(top.split()) < 240  # a minute
    measured = [cells[2] for cells in rows() if "**measurement**" in cells[1]]
    assert {name for text in measured for name in re.findall(r"test_\w+", text)} == {
        "test_measured_tire",
        "test_tir_estimate",
    }
