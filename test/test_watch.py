"""`tire-dynamics watch` beside a real node: what it shows is what the node says."""

from __future__ import annotations

import io
import os
import pty
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from rich.console import Console

from tire_dynamics.cli.watch import bars, view
from tire_dynamics.ros.observer import Observer

REPOSITORY = Path(__file__).parents[1]
PATIENCE = 180.0


def drawn(observer: Observer, width: int = 110, height: int = 40) -> str:
    console = Console(width=width, file=io.StringIO(), force_terminal=False)
    console.print(view(observer, width, height))
    return console.file.getvalue()


@pytest.fixture
def observed(ros_domain, bench):
    """A node with two wheels, one of them fed, and its observer; the node's name is asked for."""
    one = bench("-p", "wheels:=[left, right]", "-p", "tire.sidewall_damping:=reaction", "-r", "__ns:=/car")
    for topic, value in (("wheel_speed", 50.0), ("load_force", 4000.0)):
        send(one, f"/car/left/{topic}", value)
    with Observer() as observer:
        yield one, observer


def send(one, topic: str, value: float) -> None:
    from std_msgs.msg import Float64

    publisher = one.publisher(Float64, topic)
    one.peer.create_timer(0.01, lambda: publisher.publish(Float64(data=value)))


def watch(one, observer: Observer, condition, what: str):
    def looked():
        observer.spin(0.05)
        return observer.node is not None and condition()

    return one.until(looked, what)


def test_it_shows_forces_stability_and_what_the_node_says(observed):
    one, observer = observed
    watch(one, observer, lambda: observer.forces("left"), "forces")
    watch(one, observer, lambda: observer.wheels["left"].values["stability"] == "asymptotically stable", "a verdict")
    watch(one, observer, lambda: any("left: first" in text for _, text in observer.lines), "a line")
    assert observer.name == "/car/tire_dynamics" and observer.nodes == [observer.name]
    text = drawn(observer)
    (row,) = re.findall(r"^ *left .*", text, re.M)
    # `reaction` gives the axle the whole load (docs/model.md); lost at 13 035 rpm with Table 1 (docs/parameters.md)
    assert re.findall(r"-?\d+(?:\.\d+)?", row)[:4] == ["50.00", "4000", "0", "4000"]
    assert " stable " in row and " 1365" in row
    assert "ERROR right: no output: no speed yet" in text
    assert "active: 2 wheels, 500 Hz, no log" in text and "/car/tire_dynamics" in text
    assert max(map(len, text.splitlines())) <= 110
    assert max(map(len, drawn(observer, 80, 24).splitlines())) <= 80


def test_a_node_that_has_gone_is_said(observed):
    one, observer = observed
    watch(one, observer, lambda: observer.wheels, "the node")
    one.close()
    limit = time.monotonic() + PATIENCE
    while observer.node.level != 3:
        assert time.monotonic() < limit
        observer.spin(0.1)
    assert "gone" in drawn(observer)


def command(*arguments: str, **options) -> subprocess.Popen:
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "COLUMNS": "120", "LINES": "40"}
    call = [sys.executable, "-m", "tire_dynamics.cli.main", "watch", *arguments]
    return subprocess.Popen(call, env=environment, **options)


def test_in_a_pipe_it_is_one_view(bench):
    one = bench("-r", "__ns:=/red")
    other = bench("-r", "__ns:=/blue")
    process = command("--node", "red/tire_dynamics", "--wait", "120", stdout=subprocess.PIPE, text=True)
    other.until(lambda: process.poll() is not None, "its end")
    text = process.communicate()[0]
    assert process.returncode == 0 and "/red/tire_dynamics" in text and " wheel " in text
    assert "\x1b" not in text
    assert one.node is not None


def test_on_a_terminal_it_goes_on_until_a_signal(bench):
    one = bench()
    ours, theirs = pty.openpty()
    process = command("--wait", "120", stdout=theirs, stdin=theirs)
    os.close(theirs)
    seen = b""
    while seen.count(b"/tire_dynamics") < 3:
        one.until(lambda: True, "a turn")
        seen += os.read(ours, 65536)
    process.send_signal(signal.SIGINT)
    try:
        while os.read(ours, 65536):
            pass
    except OSError:  # Linux's way to say that the other end is closed
        pass
    assert process.wait(PATIENCE) == 0 and b"Traceback" not in seen
    os.close(ours)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--wait", "0.2"], "a node of tire_dynamics is not heard on /diagnostics within 0.2 s"),
        (["--wait", "0.2", "--node", "/red/tires"], "/red/tires is not heard"),
        (["--wait", "-1"], "--wait is -1.0; it must be > 0"),
        (["--ros-args", "-r", "no rule"], "no rule"),
    ],
)
def test_what_it_cannot_do_is_a_line(ros_domain, arguments, said):
    process = command(*arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    error = process.communicate(timeout=PATIENCE)[1]
    assert process.returncode == 2 and said in error and "Traceback" not in error


@pytest.mark.parametrize(
    ("values", "shown"), [([], ""), ([1.0], "▄"), ([0.0, 7.0], "▁█"), ([7.0, 0.0, 3.5], "█▁▅"), ([5.0] * 99, "▄" * 24)]
)
def test_bars_go_from_the_least_to_the_greatest(values, shown):
    assert bars(values, 24) == shown
