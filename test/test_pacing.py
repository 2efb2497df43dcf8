"""When ticks and duties are due: what a stall costs, what is made up for, what waits for what."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tire_dynamics.ros.deadlines import MADE_UP, Deadlines
from tire_dynamics.ros.duties import PATIENCE, ROOM, Duties, do_all
from tire_dynamics.ros.scheduling import run_in_time

PERIOD = 1_000_000  # [ns]


def run(deadlines: Deadlines, begin: int, end: int, cost: int) -> tuple[list[int], int, int]:
    """Ticks that take ``cost`` each, from one time to another: their deadlines, those left out, and the time then."""
    made, left_out, now = [], 0, begin
    while now < end:
        if (tick := deadlines.take(now)) is None:
            now = deadlines.due
            continue
        made.append(tick.deadline)
        left_out += tick.left_out
        now += cost
    return made, left_out, now


# -- deadlines --------------------------------------------------------------------------------------------------


def test_nothing_is_due_before_its_time():
    deadlines = Deadlines(1000, PERIOD)
    assert deadlines.take(999) is None
    assert deadlines.take(1000) == (1000, 0)
    assert deadlines.due == 1000 + PERIOD
    assert deadlines.take(1001) is None


@pytest.mark.parametrize("missed", range(MADE_UP + 1))
def test_a_stall_leaves_no_gap(missed):
    deadlines = Deadlines(0, PERIOD)
    made, left_out, now = run(deadlines, missed * PERIOD + 1, missed * PERIOD + 2 * PERIOD, PERIOD // 20)
    assert left_out == 0
    assert made == [k * PERIOD for k in range(missed + 2)]
    assert deadlines.due > now - PERIOD


def test_of_a_long_stall_the_last_are_made():
    deadlines = Deadlines(0, PERIOD)
    tick = deadlines.take(100 * PERIOD)
    assert tick == ((100 - MADE_UP) * PERIOD, 100 - MADE_UP)
    made = [deadlines.take(100 * PERIOD).deadline for _ in range(MADE_UP)]
    assert made[-1] == 100 * PERIOD and deadlines.take(100 * PERIOD) is None


def test_what_is_made_up_for_has_to_be_earned():
    deadlines = Deadlines(0, PERIOD)
    run(deadlines, MADE_UP * PERIOD, MADE_UP * PERIOD + 1, 0)
    while deadlines.due <= MADE_UP * PERIOD:
        deadlines.take(MADE_UP * PERIOD)
    now = deadlines.due + 5 * PERIOD
    assert deadlines.take(now).left_out == 5, "nothing is left of it"
    for _ in range(16 * MADE_UP):
        assert deadlines.take(deadlines.due).left_out == 0
    assert deadlines.take(deadlines.due + MADE_UP * PERIOD).left_out == 0


@given(cost=st.integers(PERIOD + 1, 5 * PERIOD))
def test_a_machine_that_is_too_slow_has_no_backlog(cost):
    """A tick is at most as late as one takes, but for the stalls that are made up for at the beginning."""
    deadlines = Deadlines(0, PERIOD)
    _, _, now = run(deadlines, 0, 200 * MADE_UP * PERIOD, cost)
    late = []
    for _ in range(200):
        tick = deadlines.take(now)
        if tick is None:
            now = deadlines.due
            continue
        late.append(now - tick.deadline)
        now += cost
    assert max(late) <= cost + PERIOD


@given(
    waits=st.lists(st.integers(0, 30 * PERIOD), min_size=1, max_size=60),
    begin=st.integers(-(2**60), 2**60),
)
def test_every_deadline_is_made_or_left_out(waits, begin):
    """Deadlines are made in their order, none twice, none ahead of the time, and those between are counted."""
    deadlines, now = Deadlines(begin, PERIOD), begin
    last, credit = begin - PERIOD, float(MADE_UP)
    for wait in waits:
        now += wait
        late = 0
        while (tick := deadlines.take(now)) is not None:
            assert begin <= tick.deadline <= now
            assert tick.deadline == last + (1 + tick.left_out) * PERIOD
            last = tick.deadline
            late += tick.deadline <= now - PERIOD
        assert last > now - PERIOD  # of all that have passed the last is made
        assert late <= credit + 1e-9
        credit = min(credit - late + 1.0, MADE_UP)  # more than one tick can earn


# -- duties -----------------------------------------------------------------------------------------------------


class Clock:
    def __init__(self) -> None:
        self.now = 0

    def __call__(self) -> int:
        return self.now


def in_pieces(clock: Clock, done: list, name: str, pieces: int, cost: int):
    def call():
        for piece in range(pieces):
            if piece:
                yield
            clock.now += cost
            done.append((name, piece))

    return call


def test_a_tick_waits_for_one_piece():
    clock, done = Clock(), []
    duties = Duties(clock)
    duties.add(1.0, in_pieces(clock, done, "a", 3, 100_000))
    duties.add(1.0, in_pieces(clock, done, "b", 2, 100_000))
    clock.now = 1_000_000_000
    counts = []
    for _ in range(7):
        before = len(done)
        duties.do(clock.now + PERIOD)
        counts.append(len(done) - before)
        clock.now += PERIOD
    assert max(counts) == 1
    assert done == [("a", 0), ("a", 1), ("a", 2), ("b", 0), ("b", 1)]


def test_at_low_rates_all_is_done_between_two_ticks():
    clock, done = Clock(), []
    duties = Duties(clock)
    for name in "ab":
        duties.add(1.0, in_pieces(clock, done, name, 4, 100_000))
    clock.now = 1_000_000_000
    duties.do(clock.now + ROOM + 10_000_000)
    assert len(done) == 8


def test_ticks_that_are_always_late_do_not_starve_a_duty():
    clock, done = Clock(), []
    duties = Duties(clock)
    duties.add(1.0, in_pieces(clock, done, "a", 50, 10_000))
    clock.now = 1_000_000_000
    duties.do(clock.now)
    assert len(done) == 1
    clock.now += PATIENCE + 1
    duties.do(clock.now)
    assert len(done) == 50


@given(
    rate=st.sampled_from([1.0, 10.0, 100.0, 500.0, 1000.0]),
    tick=st.floats(0.01, 3.0),  # of a period
    periods=st.lists(st.sampled_from([0.05, 0.25, 1.0]), min_size=1, max_size=5),
)
def test_every_duty_is_done_as_often_as_it_should_be(rate, tick, periods):
    """Whatever the ticks take: but for those that come less often than the duty."""
    clock, done = Clock(), []
    duties = Duties(clock)
    for number, period in enumerate(periods):
        duties.add(period, in_pieces(clock, done, str(number), 5, 10_000))
    step = 1.0 / rate
    while clock.now < 10_000_000_000:
        clock.now += round(1e9 * step * tick)
        due = clock.now + max(0, round(1e9 * step * (1.0 - tick)))
        duties.do(due)
        clock.now = max(clock.now, due)
    turn = max(1.0, tick) * step
    for number, period in enumerate(periods):
        count = sum(1 for name, piece in done if name == str(number) and piece == 4)
        assert count >= 10.0 / max(period + turn, 2.0 * turn) - 3.0


def test_the_rest_of_what_was_begun_can_be_left_out():
    clock, done = Clock(), []
    duties = Duties(clock)
    duty = duties.add(1.0, in_pieces(clock, done, "a", 3, 0))
    clock.now = 1_000_000_000
    duties.do(clock.now)
    duties.drop()
    duties.do(clock.now)
    assert done == [("a", 0)]
    clock.now = 2_000_000_000
    duties.remove(duty)
    duties.do(clock.now)
    assert len(done) == 1


def test_without_pieces():
    clock, done = Clock(), []
    duties = Duties(clock)
    duties.add(0.5, lambda: done.append(clock.now))
    for now in range(0, 2_000_000_001, 100_000_000):
        clock.now = now
        duties.do(now)
    assert done == [500_000_000, 1_000_000_000, 1_500_000_000, 2_000_000_000]
    do_all(lambda: done.append(0))
    do_all(in_pieces(clock, done, "a", 2, 0))
    assert done[4:] == [0, ("a", 0), ("a", 1)]


# -- the scheduler ----------------------------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux for it")
def test_the_thread_that_ticks_has_short_slices_and_nobody_else():
    """No more of the processor than before, and not for the threads that it makes."""
    found = {}

    def look(name: str) -> None:
        own = Path(f"/proc/self/task/{threading.get_native_id()}/sched")
        lines = own.read_text().splitlines() if own.exists() else []
        slices = [int(line.split(":")[1]) for line in lines if line.startswith("se.slice")]
        found[name] = os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0), slices

    def ticking() -> None:
        look("before")
        run_in_time()
        run_in_time()  # again, it does nothing else
        look("ticking")
        child = threading.Thread(target=look, args=("child",))
        child.start()
        child.join()

    thread = threading.Thread(target=ticking)
    thread.start()
    thread.join()
    (policy, nice, usual), ticking_has, child_has = found["before"], found["ticking"], found["child"]
    assert child_has == (policy, nice, usual)
    assert ticking_has[0] & ~os.SCHED_RESET_ON_FORK == policy and ticking_has[1] == nice
    if usual and tuple(map(int, os.uname().release.split(".")[:2])) >= (6, 12):  # says what its slices are
        assert ticking_has[2] == [700_000] and usual != [700_000]
