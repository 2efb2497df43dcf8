"""The thread beside the ticks: who shares what, in which order, what is bounded, what is forgotten."""

from __future__ import annotations

import os
import threading

import pytest

from tire_dynamics.ros.worker import Worker


class Gate:
    """Work that ends when it may, and says where it was done."""

    def __init__(self, result=None) -> None:
        self._open, self._begun, self._result = threading.Event(), threading.Event(), result
        self.threads: list[int] = []

    def __call__(self):
        self.threads.append(threading.get_ident())
        self._begun.set()
        assert self._open.wait(30.0)
        return self._result

    def let_go(self) -> None:
        self._open.set()

    def wait(self) -> None:
        assert self._begun.wait(30.0)


@pytest.fixture
def worker():
    made = Worker(most=4)
    yield made
    made.close()


def deliver(worker: Worker, heard: list, count: int) -> None:
    while len(heard) < count:
        worker.deliver(1)
        os.sched_yield()


def test_work_is_done_elsewhere_and_heard_of_here(worker):
    gate, heard = Gate(7), []
    assert worker.ask("a", gate, lambda result, error: heard.append((result, error, threading.get_ident())))
    worker.deliver(8)
    assert heard == [] and worker.waiting == 1
    gate.let_go()
    deliver(worker, heard, 1)
    assert heard == [(7, None, threading.get_ident())] and worker.waiting == 0
    assert len(gate.threads) == 1 and gate.threads[0] != threading.get_ident()


def test_of_one_key_one_is_done_for_all(worker):
    gate, heard = Gate(7), []
    for k in range(3):
        assert worker.ask("a", gate, lambda result, error, k=k: heard.append((k, result)))
    gate.let_go()
    deliver(worker, heard, 3)
    assert heard == [(0, 7), (1, 7), (2, 7)] and len(gate.threads) == 1
    assert worker.ask("a", gate, lambda result, error: heard.append("again"))  # what is done is not kept
    deliver(worker, heard, 4)
    assert len(gate.threads) == 2


def test_so_many_wait_and_no_more(worker):
    gate, heard = Gate(), []
    results = [worker.ask(k % 2, gate, lambda *_: heard.append(1)) for k in range(6)]
    assert results == [True] * 4 + [False] * 2
    assert worker.ask("urgent", gate, lambda *_: heard.append(1), urgent=True)
    gate.let_go()
    deliver(worker, heard, 5)
    assert worker.waiting == 0 and worker.ask(0, gate, lambda *_: heard.append(1))
    deliver(worker, heard, 6)


def test_what_is_urgent_comes_before_what_waits(worker):
    gate, heard = Gate(), []
    worker.ask("running", gate, lambda *_: heard.append("running"))
    gate.wait()
    worker.ask("waiting", gate, lambda *_: heard.append("waiting"))
    worker.ask("urgent", gate, lambda *_: heard.append("urgent"), urgent=True)
    gate.let_go()
    deliver(worker, heard, 3)
    assert heard == ["running", "urgent", "waiting"]


def test_what_work_raises_is_heard_of(worker):
    heard = []
    worker.ask("a", lambda: 1 // 0, lambda result, error: heard.append((result, type(error))))
    worker.ask("b", lambda: 2, lambda result, error: heard.append((result, error)))
    deliver(worker, heard, 2)
    assert heard == [(None, ZeroDivisionError), (2, None)]


def test_who_hears_may_ask_for_the_same_again(worker):
    heard = []

    def again(result, error):
        heard.append(result)
        if len(heard) < 3:
            worker.ask("a", lambda: len(heard), again)

    worker.ask("a", lambda: 0, again)
    deliver(worker, heard, 3)
    assert heard == [0, 1, 2]


def test_nothing_is_heard_of_what_was_forgotten(worker):
    running, waiting, heard = Gate("old"), Gate("old"), []
    worker.ask("a", running, lambda result, error: heard.append(result))
    running.wait()
    worker.ask("b", waiting, lambda result, error: heard.append(result))
    worker.forget()
    assert worker.waiting == 0
    worker.ask("a", lambda: "new", lambda result, error: heard.append(result))  # the same key, and not the same work
    running.let_go()
    deliver(worker, heard, 1)
    assert heard == ["new"] and waiting.threads == []
