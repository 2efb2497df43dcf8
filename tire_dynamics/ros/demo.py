"""``make run``: the whole way once, on real ROS 2, with a table of what came out.

A node in a process of its own, a second process that plays the sample bag to it over DDS, this one asking every
wheel's stability on the way; then the log of it all replayed and compared bit for bit.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bag import BagReader
from ..build_state import how_to_compile, is_compiled
from ..cdr.messages import JointStateDecoder, decode_wrench
from ..replay.parameters import NODE_NAME, complete, read_config
from ..replay.replay import replay

__all__ = ["main"]

_ROOT = Path(__file__).resolve().parents[2]
_BAG = _ROOT / "bags" / "sample"
_CONFIG = _ROOT / "config" / "vehicle.yaml"
_ASK_AFTER = 10.0  # [s] into the bag: cruising
_PATIENCE = 600.0  # [s] for one step of all this, on a machine however slow; a process that has ended is seen at once
_SAY_EVERY = 5.0  # [s] between two lines about what is waited for
_ASK_AGAIN = 5.0  # [s] after a request that was not answered
_LAST_LINES = 20  # of a process that has failed
FloatArray = NDArray[np.float64]


class _FailureError(Exception):
    """Something that the demonstration is to show did not happen."""


def main() -> int:
    """Run the demonstration; 0 if everything in it worked."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))  # apart from whatever else runs here
    folder = Path.cwd() / "runs" / f"{datetime.now(timezone.utc):%Y-%m-%dT%H-%M-%S}"
    try:
        _demonstrate(folder)
    except _FailureError as failure:
        print(f"\nFAILED: {failure}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    return 0


def rates(compiled: bool) -> list[str]:
    """The ROS arguments for rates that the node can keep: none where its loops are compiled, the file's hold there."""
    slower = ("rate_hz:=50.0", "ring_rate_hz:=2.0", "n_max:=6")
    return [] if compiled else [part for each in slower for part in ("-p", each)]


def _demonstrate(folder: Path) -> None:
    if not _BAG.is_dir():
        raise _FailureError(f"{_BAG} is missing; this runs in a clone of the repository")
    folder.mkdir(parents=True)
    wheels = list(complete(read_config(_CONFIG))["wheels"])
    slower = rates(is_compiled())
    if slower:
        _say(how_to_compile())
    _say(f"1. A live node starts in a process of its own, with {_CONFIG.relative_to(_ROOT)} and a log.")
    arguments = ["--params-file", str(_CONFIG), "-p", f"log.directory:={folder / 'log'}", *slower]
    with _Process("node", "--ros-args", *arguments) as node, _Listener(wheels) as listener:
        listener.wait("the node to be active", listener.is_active, node)
        _say(f"2. A second process plays {_BAG.relative_to(_ROOT)} to it over DDS, in real time ({_length():.0f} s).")
        with _Process("play", str(_BAG), "--wait", str(_PATIENCE)) as player:
            replies = _ask_stability(listener, node, player)
            listener.wait("the player to reach the end of the bag", player.is_over, node)
            if player.status != 0:
                raise _FailureError(f"the player ended with status {player.status}{player.last_lines()}")
        _say("3. The node is stopped with SIGINT.")
        node.interrupt()
        listener.wait("the node to close its log", node.is_over)
        if node.status != 0:
            raise _FailureError(f"the node ended with status {node.status} after SIGINT{node.last_lines()}")
    (log,) = (folder / "log").iterdir()
    _say("4. The log's inputs are replayed, as fast as it goes, and the outputs compared bit for bit.")
    begin = time.perf_counter()
    replay(log, folder / "replay")
    seconds = time.perf_counter() - begin
    live, again = _messages(log), _messages(folder / "replay")
    count = _compare(live, again)
    rows = [_row(wheel, live, replies[wheel]) for wheel in wheels]
    _print_table(rows)
    _say(f"\n{count} outputs replayed in {seconds:.1f} s, every one equal to the live one, bit for bit.")
    picture = folder / "forces.png"
    _draw(rows, live, picture)
    _say(f"log      {log}")
    _say(f"picture  {picture}")


# -- processes --------------------------------------------------------------------------------------------------


def _say(text: str) -> None:
    print(text, flush=True)


class _Process:
    """A command in a process of its own; what it says is shown, and its last lines are kept."""

    def __init__(self, *arguments: str) -> None:
        self.name = arguments[0]
        self._lines: deque[str] = deque(maxlen=_LAST_LINES)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tire_dynamics.cli.main", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self._process.stdout or ():
            self._lines.append(line.rstrip())
            _say(f"   {self.name}: {line.rstrip()}")

    @property
    def status(self) -> int | None:
        """Of its exit; None while it runs."""
        return self._process.poll()

    def is_over(self) -> bool:
        return self.status is not None

    def last_lines(self) -> str:
        """What it said at last, to stand behind a message."""
        self._reader.join(1.0)
        return ". It said at last:\n" + "\n".join(self._lines) if self._lines else ", and had said nothing"

    def interrupt(self) -> None:
        self._process.send_signal(signal.SIGINT)

    def __enter__(self) -> _Process:
        return self

    def __exit__(self, *_: object) -> None:
        if not self.is_over():
            self._process.terminate()
            try:
                self._process.wait(10.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._reader.join()


def _length() -> float:
    reader = BagReader(_BAG)
    return ((reader.end_ns or 0) - (reader.start_ns or 0)) * 1e-9


class _Question:
    """A service that is asked until it answers: a reply may get lost while two processes are still finding each other.

    Attributes
    ----------
    last : Any
        The last answer.
    """

    def __init__(self, client: Any, request: Any) -> None:
        self.last: Any = None
        self._client, self._request = client, request
        self._asked: list[tuple[float, Any]] = []

    def answer(self) -> Any:
        """The answer, if one has come since the last one; else None."""
        for _, future in self._asked:
            if future.done():
                self._asked, self.last = [], future.result()
                return self.last
        now = time.monotonic()
        if self._client.service_is_ready() and (not self._asked or now - self._asked[-1][0] > _ASK_AGAIN):
            self._asked.append((now, self._client.call_async(self._request)))
        return None


class _Listener:
    """This process in the ROS graph: asks for the node's state and its wheels' stability, and hears joint states."""

    def __init__(self, wheels: Sequence[str]) -> None:
        import rclpy
        from lifecycle_msgs.srv import GetState
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import JointState
        from std_srvs.srv import Trigger

        self._context = rclpy.context.Context()
        rclpy.init(context=self._context)
        self._node = Node("tire_dynamics_demo", context=self._context, start_parameter_services=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._state = _Question(self._node.create_client(GetState, f"{NODE_NAME}/get_state"), GetState.Request())
        self.stability = {
            wheel: _Question(self._node.create_client(Trigger, f"{wheel}/floquet_stability"), Trigger.Request())
            for wheel in wheels
        }
        self._first = self._latest = 0.0
        self._node.create_subscription(JointState, "joint_states", self._note, qos_profile_sensor_data)

    def __enter__(self) -> _Listener:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _note(self, message: Any) -> None:
        self._latest = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        self._first = self._first or self._latest

    @property
    def played(self) -> float:
        """How much of the bag has come [s], by its stamps."""
        return self._latest - self._first

    def is_active(self) -> bool:
        """Whether the node has said that it is active; asks it."""
        from lifecycle_msgs.msg import State

        answer = self._state.answer()
        return answer is not None and bool(answer.current_state.id == State.PRIMARY_STATE_ACTIVE)

    def wait(self, what: str, is_so: Callable[[], bool], *needed: _Process) -> None:
        """Wait until something is so, and say what for; the processes that it needs may not end meanwhile."""
        begin = said = time.monotonic()
        while not is_so():
            for process in needed:
                if process.is_over() and not is_so():
                    waited = f"while the demonstration waited for {what}"
                    raise _FailureError(
                        f"{process.name} ended with status {process.status} {waited}{process.last_lines()}"
                    )
            now = time.monotonic()
            if now - begin > _PATIENCE:
                raise _FailureError(f"waited {_PATIENCE:.0f} s for {what}; is this machine that busy?")
            if now - said > _SAY_EVERY:
                said = now
                _say(f"   waiting for {what}, {now - begin:.0f} s so far")
            self._executor.spin_once(timeout_sec=0.1)


def _ask_stability(listener: _Listener, node: _Process, player: _Process) -> dict[str, dict[str, Any]]:
    """Every wheel's stability reply, asked while the vehicle cruises."""
    listener.wait("the first joint states", lambda: listener.played > 0.0, node, player)
    listener.wait(f"{_ASK_AFTER:.0f} s of the drive", lambda: listener.played >= _ASK_AFTER, node, player)
    replies = {}
    for wheel, question in listener.stability.items():
        what = f"the answer of {wheel}/floquet_stability"
        listener.wait(what, lambda question=question: question.answer() is not None, node)  # type: ignore[misc]
        reply = question.last
        if not reply.success:
            raise _FailureError(f"{what} is: {reply.message}")
        replies[wheel] = json.loads(reply.message)
    return replies


# -- what came out ----------------------------------------------------------------------------------------------


class _Logged(NamedTuple):
    log_time: int
    data: bytes


class _Row(NamedTuple):
    wheel: str
    speeds: int
    loads: int
    wrenches: int
    rings: int
    mean_force: float
    peak_force: float
    ratio: float
    peak_x: float
    speed: float
    radius: float
    verdict: str
    latency: tuple[float, float]


def _messages(folder: Path) -> dict[str, list[_Logged]]:
    topics = defaultdict(list)
    for topic, _, log_time, _, data in BagReader(folder).messages(in_file_order=True):
        topics[topic].append(_Logged(log_time, data))
    return topics


def _compare(live: Mapping[str, list[_Logged]], again: Mapping[str, list[_Logged]]) -> int:
    """The number of outputs, all of them equal."""
    count = 0
    for topic in live:
        if topic.endswith(("/axle_wrench", "/ring_deflection", "/ring_shape")):
            if [message.data for message in live[topic]] != [message.data for message in again.get(topic, [])]:
                raise _FailureError(f"{topic}: the replayed messages are not the live ones")
            count += len(live[topic])
    if not count:
        raise _FailureError("the log holds no output")
    return count


def _wrenches(messages: Sequence[_Logged]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stamps and log times [s from the epoch], and force x, z [N], shape (N, 2)."""
    decoded = [decode_wrench(message.data) for message in messages]
    stamps = np.array([wrench.stamp_ns for wrench in decoded]) * 1e-9
    times = np.array([message.log_time for message in messages]) * 1e-9
    return stamps, times, np.array([[wrench.fx, wrench.fz] for wrench in decoded])


def _row(wheel: str, live: Mapping[str, list[_Logged]], reply: Mapping[str, Any]) -> _Row:
    wrenches, loads = live[f"/{wheel}/axle_wrench"], live[f"/{wheel}/load"]
    if not wrenches or not loads:
        raise _FailureError(f"{wheel}: {len(loads)} loads came in and {len(wrenches)} wrenches went out")
    stamps, published, force = _wrenches(wrenches)
    sent, taken, load = _wrenches(loads)
    if not np.isfinite(force).all():
        raise _FailureError(f"{wheel}: a force is not finite")
    # the first wrench whose state knows this load: of its time or later, and computed after its receipt
    first = np.maximum(np.searchsorted(stamps, sent), np.searchsorted(published, taken, side="right"))
    known = first < len(stamps)
    latency = 1e3 * (published[first[known]] - sent[known])
    during = (sent >= stamps[0]) & (sent <= stamps[-1])
    return _Row(
        wheel=wheel,
        speeds=len(live["/joint_states"]),
        loads=len(loads),
        wrenches=len(wrenches),
        rings=len(live[f"/{wheel}/ring_deflection"]),
        mean_force=float(force[:, 1].mean()),
        peak_force=float(force[:, 1].max()),
        ratio=float(force[:, 1].mean() / load[during, 1].mean()),
        peak_x=float(np.abs(force[:, 0]).max()),
        speed=reply["speed_rad_s"],
        radius=reply["spectral_radius"],
        verdict=reply["verdict"],
        latency=(float(np.percentile(latency, 50)), float(np.percentile(latency, 99))),
    )


def _print_table(rows: Sequence[_Row]) -> None:
    titles = (
        ("", "speeds", "loads", "wrenches", "rings", "mean F'", "peak F'", "F'/F", "peak |Fx|", "speed", "spectral",
         "", "latency [ms]"),
        ("wheel", "in", "in", "out", "out", "[N]", "[N]", "mean", "[N]", "[rad/s]", "radius", "verdict", "p50   p99"),
    )  # fmt: skip
    body = [
        (row.wheel, str(row.speeds), str(row.loads), str(row.wrenches), str(row.rings), f"{row.mean_force:.1f}",
         f"{row.peak_force:.1f}", f"{row.ratio:.4f}", f"{row.peak_x:.1f}", f"{row.speed:.2f}", f"{row.radius:.4f}",
         row.verdict, f"{row.latency[0]:.2f}  {row.latency[1]:.2f}")
        for row in rows
    ]  # fmt: skip
    widths = [max(len(line[k]) for line in (*titles, *body)) for k in range(len(titles[0]))]
    print()
    for line in (*titles, tuple("-" * width for width in widths), *body):
        aligned = "<" + 10 * ">" + "<>"  # names and verdicts to the left, numbers to the right
        cells = [f"{cell:{side}{width}}" for cell, side, width in zip(line, aligned, widths, strict=True)]
        print("  ".join(cells).rstrip())
    print(
        "\nF is the vertical load on the tire, F' what the wheel passes to its suspension, Fx the horizontal force on\n"
        "the axle. A spectral radius below 1 means that the rotating tire is stable at the speed asked. Latency runs\n"
        "from the sending of a load to the publication of the first wrench that knows it, across both processes."
    )


def _draw(rows: Sequence[_Row], live: Mapping[str, list[_Logged]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    front, rear = rows[0].wheel, rows[-1].wheel
    decode = JointStateDecoder().decode
    states = [decode(message.data) for message in live["/joint_states"]]
    begin = states[0].stamp_ns * 1e-9
    figure, axes = plt.subplots(4, 1, figsize=(9.0, 10.0), constrained_layout=True)
    axes[0].plot(
        [state.stamp_ns * 1e-9 - begin for state in states], [state.velocities[0] for state in states], color="black"
    )
    axes[0].set_ylabel(f"speed, {front}\n[rad/s]")
    for axis, wheel in ((axes[1], front), (axes[2], rear)):
        _draw_forces(axis, wheel, live, begin)
    sent, _, load = _wrenches(live[f"/{front}/load"])
    moment = float(sent[np.argmax(load[:, 1])]) - begin
    _draw_forces(axes[3], front, live, begin)
    axes[3].set_xlim(moment - 0.1, moment + 0.4)
    axes[3].set_ylabel(f"{front}, at the\nhighest load [N]")
    axes[3].legend(loc="lower right", ncols=3, frameon=False)
    for axis in axes[:3]:
        axis.set_xlim(0.0, sent[-1] - begin)
    axes[3].set_xlabel("time [s]")
    axes[0].set_title("What the sample drive does to the axles (vertical up, horizontal forward)", loc="left")
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.margins(y=0.15)
    figure.savefig(path, dpi=110)


def _draw_forces(axis: Any, wheel: str, live: Mapping[str, list[_Logged]], begin: float) -> None:
    sent, _, load = _wrenches(live[f"/{wheel}/load"])
    stamps, _, force = _wrenches(live[f"/{wheel}/axle_wrench"])
    axis.plot(sent - begin, load[:, 1], color="0.65", linewidth=1.0, label="load F on the tire")
    axis.plot(stamps - begin, force[:, 1], color="tab:blue", linewidth=1.0, label="F' on the suspension")
    axis.plot(stamps - begin, force[:, 0], color="black", linewidth=0.8, linestyle="--", label="Fx on the axle")
    axis.set_ylabel(f"{wheel}\n[N]")


if __name__ == "__main__":
    sys.exit(main())
