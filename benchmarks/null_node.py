"""The floor under the live node: all of its messages and none of its work.

    python benchmarks/null_node.py [--rate 500] [--ring-rate 50] [--pacing timer|deadline] [--log FOLDER]

The topics, types, sizes, QoS, rates, services, executor and timers of ``tire-dynamics node`` with four wheels.
Inputs come in as bytes and only the last of each is kept; outputs are ready-made bytes into which a stamp is put.
With ``--log`` the same messages as in the node's log go to a bag on a thread of its own, with the mcap library as
it comes. It imports nothing of the package that it is compared to.
"""

from __future__ import annotations

import argparse
import gc
import signal
import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock, ClockType
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import JointState, PointCloud2, PointField
from std_msgs.msg import Float64, Float64MultiArray, MultiArrayDimension
from std_srvs.srv import SetBool, Trigger

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
RING_SAMPLES = 72
SECOND = 1_000_000_000
PACINGS = ("timer", "deadline")
_VARIANTS = 53  # of each ready-made message; no multiple of the ticks between two rings
_NOISE = np.random.default_rng(1992).normal(size=(_VARIANTS, 5 * RING_SAMPLES))
_STAMP = struct.Struct("<iI")  # behind the four bytes of the encapsulation header
_TICK = "/tire_dynamics/tick"


class NullNode(Node):
    """Subscribes, publishes, answers and logs as the node does, and computes nothing."""

    def __init__(self, rate: float, ring_rate: float, pacing: str, log: Log | None) -> None:
        super().__init__("tire_dynamics")
        self._log = log
        self._last: dict[str, bytes] = {}
        self._complete = False
        self._clock = self.get_clock()
        self._period = round(SECOND / rate)
        self._ring_period = round(SECOND / ring_rate)
        self._ring_turn = -1
        self._start = self._ticks = self._missed = 0
        self._tick_message = bytearray(serialize_message(ClockMessage()))
        self._every_tick = []
        self._every_ring = []
        self._subscribe(JointState, "joint_states")
        for wheel in WHEELS:
            self._subscribe(Float64, f"{wheel}/wheel_speed")
            self._subscribe(WrenchStamped, f"{wheel}/load")
            for kind, name, due, make in (
                (WrenchStamped, "axle_wrench", self._every_tick, _wrench),
                (Float64MultiArray, "ring_deflection", self._every_ring, _deflection),
                (PointCloud2, "ring_shape", self._every_ring, _shape),
            ):
                publisher = self.create_publisher(kind, f"{wheel}/{name}", 10)
                ready = [bytearray(serialize_message(make(f"{wheel}_axle", k))) for k in range(_VARIANTS)]
                due.append((publisher.topic_name, publisher.publish, ready, kind is not Float64MultiArray))
            self.create_service(Trigger, f"{wheel}/floquet_stability", self._stability)
        self.create_service(SetBool, "~/set_logging", self._set_logging)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        if pacing == "timer":
            self.create_timer(1.0 / rate, self.tick, clock=steady)
        self.create_timer(1.0, self._diagnose, clock=steady)

    def _subscribe(self, kind: type, topic: str) -> None:
        self.create_subscription(kind, topic, self._receiver(f"/{topic}"), qos_profile_sensor_data, raw=True)

    def _receiver(self, topic: str) -> Callable[[bytes], None]:
        last, log, clock = self._last, self._log, self._clock

        def keep(data: bytes) -> None:
            last[topic] = data

        def keep_and_log(data: bytes) -> None:
            now = clock.now().nanoseconds
            last[topic] = data
            log.put((topic, now, now, data))

        return keep if log is None else keep_and_log

    def tick(self) -> None:
        if not self._complete and not self._is_complete():
            return
        now = self._clock.now().nanoseconds
        stamp = divmod(now, SECOND)
        log = self._log
        if log is not None:
            _STAMP.pack_into(self._tick_message, 4, *stamp)
            log.put((_TICK, now, now, bytes(self._tick_message)))
        due = self._every_tick
        turn = now // self._ring_period
        if turn != self._ring_turn:
            self._ring_turn = turn
            due = due + self._every_ring
        sent = []
        variant = self._ticks % _VARIANTS
        for topic, publish, ready, stamped in due:
            message = ready[variant]
            if stamped:
                _STAMP.pack_into(message, 4, *stamp)
            data = bytes(message)
            publish(data)
            sent.append((topic, data))
        if log is not None:
            for topic, data in sent:
                log.put((topic, now, now, data))
        self._count(now)

    def _is_complete(self) -> bool:
        """Whether there is a speed and a load for every wheel; before that the node publishes no wrench."""
        needed = ("/joint_states", *(f"/{wheel}/load" for wheel in WHEELS))
        self._complete = all(topic in self._last for topic in needed)
        return self._complete

    def _count(self, now: int) -> None:
        """Ticks, and how many more there should have been by now."""
        if not self._ticks:
            self._start = now
        self._missed = max(self._missed, round((now - self._start) / self._period) - self._ticks)
        self._ticks += 1

    def _diagnose(self) -> None:
        array = DiagnosticArray()
        array.header.stamp = self._clock.now().to_msg()
        values = {"ticks": self._ticks, "ticks missed": self._missed, **{f"value {k}": "ready-made" for k in range(14)}}
        array.status = [_status("tire_dynamics: node", values)]
        for wheel in WHEELS:
            array.status.append(_status(f"tire_dynamics: {wheel}", {f"value {k}": "ready-made" for k in range(18)}))
        self._diagnostics.publish(array)
        if self._log is not None:
            now = self._clock.now().nanoseconds
            self._log.put(("/diagnostics", now, now, serialize_message(array)))

    def _stability(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = True, "{}".ljust(700)
        return response

    def _set_logging(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success = True
        return response


class Log:
    """An MCAP file behind a queue, flushed every second."""

    def __init__(self, folder: Path) -> None:
        from mcap.writer import CompressionType, Writer

        folder.mkdir(parents=True)
        self._file = open(folder / "null.mcap", "wb")
        self._writer = Writer(self._file, chunk_size=64 * 1024, compression=CompressionType.ZSTD)
        self._writer.start("ros2", "null_node")
        self._channels = {topic: self._channel(topic, kind) for topic, kind in _logged_topics().items()}
        queue: SimpleQueue[tuple[str, int, int, bytes] | None] = SimpleQueue()
        self.put = queue.put
        self._get = queue.get
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _channel(self, topic: str, kind: type) -> int:
        name = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
        schema = self._writer.register_schema(name, "ros2msg", b"")  # its text has no part in what is measured
        return self._writer.register_channel(topic, "cdr", schema)

    def _run(self) -> None:
        add, channels, get = self._writer.add_message, self._channels, self._get
        due = time.monotonic() + 1.0
        while True:
            try:
                entry = get(timeout=max(0.0, due - time.monotonic()))
            except Empty:
                entry = ()
            if entry is None:
                break
            if entry:
                topic, log_time, publish_time, data = entry
                add(channels[topic], log_time, data, publish_time)
            if time.monotonic() >= due:
                self._writer.flush()
                self._file.flush()
                due = time.monotonic() + 1.0
        self._writer.finish()
        self._file.close()

    def close(self) -> None:
        """Write what is waiting, and the end of the file."""
        self.put(None)
        self._thread.join()


def _logged_topics() -> dict[str, type]:
    topics = {"/joint_states": JointState, _TICK: ClockMessage, "/diagnostics": DiagnosticArray}
    for wheel in WHEELS:
        topics[f"/{wheel}/wheel_speed"] = Float64
        topics[f"/{wheel}/load"] = topics[f"/{wheel}/axle_wrench"] = WrenchStamped
        topics[f"/{wheel}/ring_deflection"] = Float64MultiArray
        topics[f"/{wheel}/ring_shape"] = PointCloud2
    return topics


# Digits as real ones have them, and not the same every time, lest the log compress nothing but repetitions.


def _wrench(frame: str, variant: int) -> WrenchStamped:
    message = WrenchStamped()
    message.header.frame_id = frame
    message.wrench.force.x, message.wrench.force.z = (3500.0 + 100.0 * _NOISE[variant, :2]).tolist()
    return message


def _deflection(frame: str, variant: int) -> Float64MultiArray:
    message = Float64MultiArray()
    message.layout.dim = [
        MultiArrayDimension(label="component", size=2, stride=2 * RING_SAMPLES),
        MultiArrayDimension(label="angle", size=RING_SAMPLES, stride=RING_SAMPLES),
    ]
    message.data = 1e-3 * _NOISE[variant, : 2 * RING_SAMPLES]
    return message


def _shape(frame: str, variant: int) -> PointCloud2:
    message = PointCloud2(height=1, width=RING_SAMPLES, point_step=20, row_step=20 * RING_SAMPLES, is_dense=True)
    message.header.frame_id = frame
    for number, name in enumerate(("x", "y", "z", "radial", "tangential")):
        message.fields.append(PointField(name=name, offset=4 * number, datatype=PointField.FLOAT32, count=1))
    message.data = _NOISE[variant].astype("<f4").tobytes()
    return message


def _status(name: str, values: dict[str, object]) -> DiagnosticStatus:
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticStatus(level=DiagnosticStatus.OK, name=name, message="ready-made", values=pairs)


def spin_between_ticks(executor: Any, node: NullNode, rate: float, stopping: list[int]) -> None:
    """Ticks at absolute deadlines and everything else in between, all on this thread; deadlines missed are left out."""
    period, never = 1.0 / rate, Future()
    due = time.monotonic() + period
    while not stopping:
        left = due - time.monotonic()
        if left > 0.0:
            executor.spin_until_future_complete(never, timeout_sec=left)
        else:
            node.tick()
            due += period * (1 + max(0, -left // period))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=float, default=500.0, help="wrenches per second and wheel (default 500)")
    parser.add_argument("--ring-rate", type=float, default=50.0, help="ring messages per second and wheel (default 50)")
    parser.add_argument(
        "--pacing", choices=PACINGS, default=PACINGS[0], help="who calls the ticks (default %(default)s)"
    )
    parser.add_argument("--log", metavar="FOLDER", type=Path, help="a folder to make, for the log")
    options = parser.parse_args()
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda caught, frame: stopping.append(caught))
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    log = Log(options.log) if options.log else None
    node = NullNode(options.rate, options.ring_rate, options.pacing, log)
    executor = EventsExecutor()
    executor.add_node(node)
    gc.collect()
    gc.freeze()
    if options.pacing == "timer":
        while not stopping:
            executor.spin_once(timeout_sec=0.2)
    else:
        spin_between_ticks(executor, node, options.rate, stopping)
    node.destroy_node()
    if log is not None:
        log.close()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
