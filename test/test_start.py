"""How the node's process begins and ends: what it says, and a signal at any moment of the start."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from rcl_interfaces.msg import Log
from rclpy.qos import DurabilityPolicy, QoSProfile
from test_live_log import PATIENCE, end, live_node
from test_node import Bench

from tire_dynamics.build_state import is_compiled

REPOSITORY = Path(__file__).parents[1]
STEPS = ("loading", "starting", "configured", "active")
EARLY = ("_rclpy_pybind11", "_multiarray_umath", "_yaml")  # extension modules, as they are loaded one after the other
INFO = ord(Log.INFO) if isinstance(Log.INFO, bytes) else Log.INFO
LATE = "replay/stream"  # and the last of them, where the core is compiled


def steps(said: str) -> tuple[str, ...]:
    """The steps of the start of which a node's standard error tells, in its order."""
    return tuple(re.findall(rf"\[tire_dynamics\]: ({'|'.join(STEPS)})\b", said))


def read_to(step: str, node: subprocess.Popen) -> str:
    """What a node says up to a step of its start, and maybe more, past the buffers of this process."""
    said = b""
    while step not in steps(said.decode()):
        piece = os.read(node.stderr.fileno(), 65536)
        assert piece, said
        said += piece
    return said.decode()


def test_it_says_on_the_terminal_how_far_it_has_come(ros_domain, tmp_path):
    with live_node("-p", "wheels:=[left, right]", "-p", f"log.directory:={tmp_path / 'logs'}") as node:
        said = read_to("active", node)
        (log,) = (tmp_path / "logs").iterdir()
        assert f"active: 2 wheels, 500 Hz, log in {log}\n" in said
        said += end(node)
    assert steps(said) == STEPS
    assert re.search(rf"log closed: {re.escape(str(log))}, \d+ messages\n$", said)


def test_it_says_so_on_rosout_too(bench):
    one = bench("-p", "rate_hz:=250.0")
    heard: list[Log] = []
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    one.peer.create_subscription(Log, "/rosout", heard.append, latched)

    def said() -> list[str]:
        return [line.msg for line in heard if line.name == "tire_dynamics" and line.level == INFO]

    one.until(lambda: len(said()) >= 3, "the lines of the start")
    assert said()[0] == "starting as /tire_dynamics" and said()[-1] == "active: 1 wheel, 250 Hz, no log"


def told(one: Bench, number: int) -> None:
    """Ask for a transition."""
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    request = ChangeState.Request(transition=Transition(id=number))
    assert one.call(ChangeState, "/tire_dynamics/change_state", request).success


def test_a_managed_node_names_each_state_that_it_enters(bench, capfd):
    from lifecycle_msgs.msg import Transition

    one = bench("-p", "autostart:=false")
    for number in (
        Transition.TRANSITION_CONFIGURE,
        Transition.TRANSITION_ACTIVATE,
        Transition.TRANSITION_DEACTIVATE,
        Transition.TRANSITION_CLEANUP,
    ):
        told(one, number)
    entered = re.findall(r"\[tire_dynamics\]: (unconfigured|configured|active|inactive):", capfd.readouterr().err)
    assert entered == ["unconfigured", "configured", "active", "inactive", "unconfigured"]


def stopped_at(moment, number: signal.Signals) -> tuple[str, bool]:
    """Hold a node at a moment and tell it to end: what it said in all, and whether it was loading modules for sure.

    ``moment`` waits for it, and gives what it has read meanwhile. The node is held until the signal is there, however
    long this process waits for its turn.
    """
    with live_node() as node:
        maps = Path(f"/proc/{node.pid}/maps")
        if not maps.exists():
            pytest.skip("needs /proc to see how far the start has come")
        said = moment(node, maps)
        node.send_signal(signal.SIGSTOP)
        loading = is_compiled() and LATE not in maps.read_text()
        node.send_signal(number)
        node.send_signal(signal.SIGCONT)
        said += node.communicate(timeout=PATIENCE)[1]
        # -SIGALRM: a machine that is too busy to make a node in 1.5 s
        assert node.returncode in (0, -signal.SIGALRM), said
        assert "Traceback" not in said
        return said, loading


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("mapped", EARLY)
def test_a_signal_while_modules_are_loaded_ends_it_there(ros_domain, mapped, number):
    def moment(node: subprocess.Popen, maps: Path) -> str:
        limit = time.monotonic() + PATIENCE
        while mapped not in maps.read_text():
            assert node.poll() is None and time.monotonic() < limit
        return ""

    said, loading = stopped_at(moment, number)
    if loading:
        assert steps(said)[1:] == (), said


@pytest.mark.parametrize("step", STEPS)
def test_a_signal_at_each_line_of_the_start_ends_it(ros_domain, step):
    said, loading = stopped_at(lambda node, _: read_to(step, node), signal.SIGTERM)
    assert step in steps(said) and steps(said) == STEPS[: len(steps(said))]
    if loading:
        assert steps(said) == ("loading",)


STUCK = """
import time
from tire_dynamics.ros.stop import Stop

stop = Stop()
stop.listen()
stop.loaded()
{runs}
print("ready", flush=True)
while {condition}:
    time.sleep(0.01)
print("closed", flush=True)
time.sleep({closing})
"""


@pytest.mark.parametrize(
    ("runs", "condition", "closing", "status", "printed"),
    [
        ("", "True", 0.0, -signal.SIGALRM, ""),  # the start does not come to its end
        ("", "not stop()", 0.0, 0, "closed\n"),
        ("stop.runs()", "not stop()", 2.0, 0, "closed\n"),  # a log that takes longer to close than a start may
    ],
)
def test_a_start_that_hangs_is_cut_and_a_node_that_runs_is_not(runs, condition, closing, status, printed):
    text = STUCK.format(runs=runs, condition=condition, closing=closing)
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    process = subprocess.Popen([sys.executable, "-c", text], env=environment, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "ready\n"
        process.terminate()
        assert process.communicate(timeout=PATIENCE)[0] == printed
        assert process.returncode == status
    finally:
        process.kill()
        process.wait()
