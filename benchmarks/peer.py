"""The other side of a node under test: one process that feeds it and listens to it, as lightly as rclpy allows."""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from null_node import PACINGS, RING_SAMPLES, SECOND, WHEELS
from numpy.typing import NDArray
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

__all__ = ["Peer", "cpu_of", "cpu_while_fed", "null_node", "our_node", "own_domain", "running"]

_JOINT_STATE_PERIOD = SECOND // 100
_STAMP = struct.Struct("<iI")
_DOUBLE = struct.Struct("<d")
_STAMPED = 4  # the stamp's place behind the encapsulation header
_MARK = 1234.5678  # a value whose place in a serialised message is looked for
_VARIANTS = 1009
_HERE = Path(__file__).resolve().parent


# -- processes --------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def own_domain() -> Iterator[Path]:
    """A ROS domain that nothing else here uses, local discovery only, and a folder for ROS's logs and ours."""
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="tire_dynamics_bench_")))
        for domain in itertools.chain(range(1 + os.getpid() % 101, 102), range(1, 102)):
            # the tests' locks: neither gets into the other's domain
            lock = stack.enter_context(open(Path(tempfile.gettempdir()) / f"tire_dynamics_domain_{domain}.lock", "a"))
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                continue
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        os.environ["ROS_LOG_DIR"] = str(folder / "ros")
        yield folder


VARYING = {
    "radial_nonuniformity": "[2.0,0.1,0.4]",
    "tangential_nonuniformity": "[2.0,0.05,1.0]",
    "radial_runout": "[1.0,0.0005,0.3,10.0,0.0001,1.0]",
    "imbalance_mass": "0.05",
}


def our_node(rate: float, log: Path | None, varying: bool = False, model: str = "inextensional") -> list[str]:
    """The command line of the node with four wheels, whose tires may be not the same all around."""
    values = {
        "wheels": f"[{','.join(WHEELS)}]",
        "rate_hz": f"{rate:.1f}",
        "ring_rate_hz": "50.0",
        "ring_samples": str(RING_SAMPLES),
        "n_max": "30",
        "model": model,
        **({"log.directory": str(log)} if log else {}),
        **({f"tire.{name}": value for name, value in VARYING.items()} if varying else {}),
    }
    parameters = [part for name, value in values.items() for part in ("-p", f"{name}:={value}")]
    return [sys.executable, "-m", "tire_dynamics.cli.main", "node", "--ros-args", *parameters, "--log-level", "warn"]


def null_node(rate: float, log: Path | None, pacing: str = PACINGS[0]) -> list[str]:
    """The command line of the null node."""
    return [
        *(sys.executable, str(_HERE / "null_node.py"), "--rate", str(rate), "--pacing", pacing),
        *(("--log", str(log)) if log else ()),
    ]


@contextlib.contextmanager
def running(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    """A process, with the options of Popen, that ends with the block, whatever ends that."""
    process = subprocess.Popen(command, **options)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(20.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def cpu_of(pid: int) -> float:
    """Processor time of a process and all of its threads [s]."""
    after_name = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(after_name[11]) + int(after_name[12])) / os.sysconf("SC_CLK_TCK")


def cpu_while_fed(command: Sequence[str], node: Node, topic: str, send: Callable[[], None], seconds: float) -> float:
    """Processor time [% of a core] of a node that runs the command, while ``send`` is called 500 times a second.

    It is measured from 2 s after the node publishes the topic on.
    """

    def feed(seconds: float) -> None:
        begin = time.monotonic()
        for k in range(round(seconds * 500.0)):
            left = begin + k * 0.002 - time.monotonic()
            if left > 0.0:
                time.sleep(left)
            send()

    with running(command) as process:
        end = time.monotonic() + 60.0
        while not node.count_publishers(topic):
            feed(0.2)
            if process.poll() is not None or time.monotonic() > end:
                raise SystemExit("the node did not start")
        feed(2.0)
        before, begin = cpu_of(process.pid), time.monotonic()
        feed(seconds)
        return 100.0 * (cpu_of(process.pid) - before) / (time.monotonic() - begin)


# -- feeding and listening --------------------------------------------------------------------------------------


class Peer:
    """Feeds loads and joint states, and takes what comes back.

    Loads go to all four wheels at once, at ``rate`` and one more in a second: so the loads' place within
    the node's period passes through all of it every second, and no figure hangs on where it happened to be.
    Nothing waits in an executor here: what has come is taken between two loads, and DDS says when it came.

    Parameters
    ----------
    rate : float
        Of the node [Hz].
    speed : float
        Of the wheels, about [rad/s].
    """

    def __init__(self, rate: float, speed: float = 80.0) -> None:
        self.rate = rate
        self._context = rclpy.context.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node("bench_peer", context=self._context, start_parameter_services=False, enable_rosout=False)
        create = self._node.create_publisher
        self._speed = create(JointState, "joint_states", qos_profile_sensor_data)
        self._loads = [create(WrenchStamped, f"{wheel}/load", qos_profile_sensor_data) for wheel in WHEELS]
        random = np.random.default_rng(1992)
        self._forces = random.normal(3500.0, 400.0, _VARIANTS).tolist()
        self._speeds = (speed + speed / 80.0 * np.cumsum(random.normal(0.0, 0.02, _VARIANTS))).tolist()
        self._load_messages = [_ready_made(_load(wheel), [_MARK]) for wheel in WHEELS]
        self._speed_message, self._speed_place = _ready_made(_joint_state(), [_MARK] * len(WHEELS))
        self._count = 0
        self._speed_due = 0
        self._changes = 0
        deep = QoSProfile(depth=4000)
        outputs = [(WrenchStamped, f"{wheel}/axle_wrench") for wheel in WHEELS]
        outputs += [(Float64MultiArray, f"{wheel}/ring_deflection") for wheel in WHEELS]
        outputs += [(PointCloud2, f"{wheel}/ring_shape") for wheel in WHEELS]
        outputs += [(DiagnosticArray, "/diagnostics")]
        subscriptions = [
            (topic, kind, self._node.create_subscription(kind, topic, _never, deep, raw=True))
            for kind, topic in outputs
        ]
        self._takes = [(topic, kind, item.handle.take_message) for topic, kind, item in subscriptions]
        self._subscriptions = [item for _, _, item in subscriptions]
        self._next_rare = 0
        self._clients = [self._node.create_client(Trigger, f"{wheel}/floquet_stability") for wheel in WHEELS]
        self._setter = self._node.create_client(SetParameters, "tire_dynamics/set_parameters")
        self.forget()

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, *_: object) -> None:
        self._node.destroy_node()
        self._context.try_shutdown()

    def forget(self) -> None:
        """Begin to gather anew."""
        self.sent: list[int] = []  # [ns], of each round of loads
        self.wrenches: list[list[tuple[bytes, int]]] = [[] for _ in WHEELS]  # message, time of receipt [ns]
        self.sizes: dict[str, set[int]] = {}
        self.counts: dict[str, int] = {}
        self.diagnostics: list[dict[str, str]] = []
        self.replies: list[int] = []  # [ns] from request to receipt
        self.late = 0

    def connected(self) -> bool:
        """Whether the node under test hears every input and is heard."""
        return all(publisher.get_subscription_count() for publisher in (*self._loads, self._speed)) and all(
            self._node.count_publishers(item.topic_name) for item in self._subscriptions
        )

    def run(
        self, seconds: float, *, until_wrench: bool = False, calls_per_second: float = 0.0, changes: float = 0.0
    ) -> None:
        """Feed and listen for a time, or until the first wrench; call the stability services meanwhile.

        ``changes`` is how often in a second a parameter of the tire changes.
        """
        period = 1.0 / (self.rate + 1.0)
        begin = due = time.monotonic()
        end = begin + seconds
        change_due = begin
        ask = _Caller(self._clients, calls_per_second, self.replies) if calls_per_second else None
        while due < end:
            time.sleep(max(0.0, due - time.monotonic()))
            self._feed()
            self._take_wrenches()
            self._take_one_of_the_rest()
            if ask is not None:
                ask.go_on()
            if changes and time.monotonic() >= change_due:
                change_due += 1.0 / changes
                self._change_the_tire()
            if until_wrench and self.wrenches[0]:
                return
            due += period
            now = time.monotonic()
            if now - due > 10.0 * period:  # this machine stood still: go on from here, no burst
                self.late += int((now - due) / period)
                due = now

    def _change_the_tire(self) -> None:
        self._changes += 1
        damping = 0.05 + 1e-6 * self._changes
        value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=damping)
        while self._setter.handle.take_response(SetParameters.Response)[0] is not None:
            pass  # of the changes before
        self._setter.handle.send_request(SetParameters.Request(parameters=[Parameter(name="tire.zeta_1", value=value)]))

    def settle(self) -> None:
        """Take what is still on its way."""
        time.sleep(0.1)
        for _ in range(4 * len(self._takes)):
            self._take_wrenches()
            self._take_one_of_the_rest()

    def _feed(self) -> None:
        variant = self._count % _VARIANTS
        self._count += 1
        now = time.time_ns()
        stamp = divmod(now, SECOND)
        if now >= self._speed_due:
            self._speed_due = max(self._speed_due + _JOINT_STATE_PERIOD, now - _JOINT_STATE_PERIOD)
            message = self._speed_message
            _STAMP.pack_into(message, _STAMPED, *stamp)
            struct.pack_into("<4d", message, self._speed_place, *[self._speeds[variant]] * 4)
            self._speed.publish(bytes(message))
        force = self._forces[variant]
        for publisher, (message, place) in zip(self._loads, self._load_messages, strict=True):
            _STAMP.pack_into(message, _STAMPED, *stamp)
            _DOUBLE.pack_into(message, place, force)
            publisher.publish(bytes(message))
        self.sent.append(now)

    def _take_wrenches(self) -> None:
        for wheel, (_, kind, take) in enumerate(self._takes[: len(WHEELS)]):
            while (taken := take(kind, True)) is not None:
                self.wrenches[wheel].append((taken[0], taken[1]["received_timestamp"]))

    def _take_one_of_the_rest(self) -> None:
        rest = self._takes[len(WHEELS) :]
        self._next_rare = (self._next_rare + 1) % len(rest)
        topic, kind, take = rest[self._next_rare]
        while (taken := take(kind, True)) is not None:
            data = taken[0]
            self.counts[topic] = self.counts.get(topic, 0) + 1
            if kind is DiagnosticArray:
                status = deserialize_message(data, kind).status[0]
                self.diagnostics.append({item.key: item.value for item in status.values})
            else:
                self.sizes.setdefault(topic, set()).add(len(data))

    # -- what was gathered ----------------------------------------------------------------------------------

    def wrench_times(self, wheel: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Stamps and times of receipt [ns] of one wheel's wrenches."""
        stamps = [_STAMP.unpack_from(data, _STAMPED) for data, _ in self.wrenches[wheel]]
        received = [moment for _, moment in self.wrenches[wheel]]
        seconds, nanoseconds = np.array(stamps, dtype=np.int64).reshape(-1, 2).T
        return seconds * SECOND + nanoseconds, np.array(received, dtype=np.int64)

    def latencies(self) -> NDArray[np.float64]:
        """From each load's stamp to the receipt of its wheel's first wrench of that time or later [s]."""
        sent = np.array(self.sent, dtype=np.int64)
        found = []
        for wheel in range(len(WHEELS)):
            stamps, received = self.wrench_times(wheel)
            first = np.searchsorted(stamps, sent)
            known = first < stamps.size
            found.append((received[first[known]] - sent[known]) * 1e-9)
        return np.concatenate(found)

    def wrench_sizes(self) -> dict[str, set[int]]:
        """Sizes of all kinds of output seen [bytes], for a check that two nodes send the same."""
        sizes = {f"{wheel}/axle_wrench": {len(data) for data, _ in self.wrenches[k]} for k, wheel in enumerate(WHEELS)}
        return sizes | self.sizes


class _Caller:
    """Calls the wheels' services in turn, one call at a time, at a rate or as soon as the last is answered."""

    def __init__(self, clients: Sequence[Any], rate: float, replies: list[int]) -> None:
        self._clients = itertools.cycle(clients)
        self._period = 1.0 / rate
        self._replies = replies
        self._due = time.monotonic()
        self._waiting: Any = None
        self._asked = 0

    def go_on(self) -> None:
        if self._waiting is not None:
            header, response = self._waiting.handle.take_response(Trigger.Response)
            if header is None:
                return
            if not response.success:
                raise RuntimeError(f"no stability: {response.message}")
            self._replies.append(header.received_timestamp - self._asked)
            self._waiting = None
        now = time.monotonic()
        if now >= self._due:
            self._due = max(self._due + self._period, now)
            self._waiting = next(self._clients)
            self._asked = time.time_ns()
            self._waiting.handle.send_request(Trigger.Request())


def _never(data: bytes) -> None:
    """Callbacks are not used: nothing spins here."""


def _load(wheel: str) -> WrenchStamped:
    message = WrenchStamped()
    message.header.frame_id = wheel
    message.wrench.force.z = _MARK
    return message


def _joint_state() -> JointState:
    message = JointState()
    message.name = list(WHEELS)
    message.velocity = [_MARK] * len(WHEELS)
    return message


def _ready_made(message: Any, values: Sequence[float]) -> tuple[bytearray, int]:
    """A serialised message, and where in it these values stand."""
    data = serialize_message(message)
    return bytearray(data), data.index(struct.pack(f"<{len(values)}d", *values))
