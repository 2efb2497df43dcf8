"""Stability from another process: the same as here, its errors too, and one that is ended is made anew."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from tire_dynamics import TireWheelUnit
from tire_dynamics.estimator.vehicle import stability_reply
from tire_dynamics.ros.analyst import Analyst

VARYING = TireWheelUnit.table_1(radial_nonuniformity=[(2, 0.1, 0.4)])


@pytest.fixture
def analyst():
    made = Analyst()
    yield made
    made.close()


def children() -> list[int]:
    return [int(pid) for pid in Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split()]


def test_it_says_what_is_said_here(analyst):
    for unit in (TireWheelUnit.table_1(), VARYING):
        for speed, model in ((100.0, "inextensional"), (0.0, "inextensional"), (-300.0, "complete")):
            assert analyst.stability(unit, speed, model) == stability_reply("", unit, speed, model)


def test_what_cannot_be_judged_is_said(analyst):
    with pytest.raises(ArithmeticError, match="can be integrated"):
        analyst.stability(VARYING, 1e-6, "inextensional")
    assert analyst.stability(VARYING, 100.0, "inextensional")["verdict"]


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="the process is found by Linux's /proc")
def test_one_that_is_ended_is_made_anew_and_closing_ends_it(analyst):
    before = set(children())
    analyst.stability(VARYING, 100.0, "inextensional")
    [process] = set(children()) - before
    os.kill(process, signal.SIGKILL)
    with pytest.raises(ArithmeticError, match="has ended"):
        analyst.stability(VARYING, 101.0, "inextensional")
    assert analyst.stability(VARYING, 101.0, "inextensional")["speed_rad_s"] == 101.0
    assert set(children()) - before
    analyst.close()
    assert set(children()) == before
