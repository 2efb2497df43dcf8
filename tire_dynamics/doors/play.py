"""A bag's messages published live, for machines without ``ros2 bag``."""

from __future__ import annotations

import math
import signal
import struct
import time
from collections.abc import Iterator
from importlib import import_module
from os import PathLike
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from .bag import BagReader
from .errors import InputError

__all__ = ["play"]

_SECOND = 1_000_000_000


def play(
    source: str | PathLike[str],
    *,
    rate: float = 1.0,
    loop: bool = False,
    keep_stamps: bool = False,
    wait: float = 0.0,
    max_gap: float = 3600.0,
) -> int:
    """Publish a bag's messages at the pace at which they were recorded.

    Parameters
    ----------
    source : path
        A rosbag2 folder, or a .mcap, .db3 or ROS 1 .bag file.
    rate : float
        Speed of play; 2 is twice as fast as recorded.
    loop : bool
        Begin again at the end.
    keep_stamps : bool
        Publish header stamps as recorded. Without it they are moved to the present: a stamp keeps its distance
        to the moment at which its message was recorded, so that a live node takes it for a live one.
    wait : float
        Seconds to wait at most for a subscriber on every topic before beginning.
    max_gap : float
        A gap between two messages that is longer than so many seconds is skipped, and said on /rosout.

    Returns
    -------
    int
        Number of messages published.

    Raises
    ------
    InputError
        The bag cannot be read or has no message of a known type, or the rate is not a positive number.
    """
    if not 0.0 < rate < 1e6:
        raise InputError(f"--rate is {rate}; it must be > 0 and < 1e6")
    if not 0.0 < max_gap < 1e9:
        raise InputError(f"--max-gap is {max_gap}; it must be > 0 and < 1e9 s")
    reader = BagReader(source)
    if not reader.message_count:
        raise InputError(f"{reader.path}: has no message")
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda caught, frame: stopping.append(caught))
    context = rclpy.context.Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = Node("tire_dynamics_play", context=context, start_parameter_services=False, enable_rosout=False)
    try:
        publishers = _publishers(node, reader)
        if not publishers:
            raise InputError(
                f"{reader.path}: has no message of a type that this machine knows; install the packages of its types: "
                + ", ".join(sorted({kind.partition("/")[0] for kind in reader.topics.values()}))
            )
        _wait_for_subscribers([publisher for publisher, _ in publishers.values()], wait, stopping)
        count = 0
        while not stopping:
            for topic, data, stamped in _paced(node, reader, publishers, rate, max_gap, stopping):
                publisher, has_header = publishers[topic]
                publisher.publish(data if keep_stamps or not has_header else _restamped(data, stamped))
                count += 1
            if not loop or not count:
                break
        for publisher, _ in publishers.values():
            publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=1))
        return count
    finally:
        node.destroy_node()
        context.try_shutdown()


def _publishers(node: Node, reader: BagReader) -> dict[str, tuple[Any, bool]]:
    """Publisher by topic, and whether its messages begin with a header; types that are not known are said."""
    publishers = {}
    for topic, msgtype in reader.topics.items():
        if reader.encodings[topic] != "cdr":
            node.get_logger().warning(f"{topic} is not played: it is encoded as {reader.encodings[topic]!r}")
            continue
        try:
            package, kind_of, name = msgtype.split("/")
            kind = getattr(import_module(f"{package}.{kind_of}"), name)
            publisher = node.create_publisher(kind, topic, 100)
        except (ImportError, AttributeError, ValueError, TypeError, NameValidationException):
            node.get_logger().warning(f"{topic} is not played: {msgtype!r} is not known here")
            continue
        fields = list(kind.get_fields_and_field_types().values())
        publishers[topic] = publisher, fields[:1] == ["std_msgs/Header"]
    return publishers


def _wait_for_subscribers(publishers: list[Any], seconds: float, stopping: list[int]) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end and not stopping:
        if all(publisher.get_subscription_count() for publisher in publishers):
            return
        time.sleep(0.02)


def _paced(
    node: Node, reader: BagReader, publishers: dict[str, Any], rate: float, max_gap: float, stopping: list[int]
) -> Iterator[tuple[str, bytes, int]]:
    """Topic, message, and the distance from recorded time to the present, each message when it is due."""
    begin = recorded = last = None
    for topic, _, log_time, _, data in reader.messages(publishers):
        if begin is None or recorded is None or last is None:
            begin, recorded, last = time.monotonic(), log_time, log_time
        if log_time - last > max_gap * _SECOND:
            gap = (log_time - last) / _SECOND
            node.get_logger().warning(f"a gap of {_spoken(gap)} is skipped; --max-gap {math.ceil(gap)} keeps it")
            recorded += log_time - last
        last = log_time
        due = begin + (log_time - recorded) * 1e-9 / rate
        while (left := due - time.monotonic()) > 0.0 and not stopping:
            time.sleep(min(left, 0.2))  # to an absolute moment, so that delays do not add up
        if stopping:
            return
        yield topic, data, time.time_ns() - log_time


def _spoken(seconds: float) -> str:
    """A long time for people."""
    for name, length in (("years", 365.25 * 86400.0), ("days", 86400.0), ("hours", 3600.0)):
        if seconds >= 2.0 * length:
            return f"{seconds / length:.1f} {name}"
    return f"{seconds:.0f} s"


def _restamped(data: bytes, distance: int) -> bytes:
    """The message with its header's stamp moved; a stamp of zero stays, it says that there is none.

    So does one that cannot be moved: of a message that is too short, or beyond the range of ROS time.
    """
    if len(data) < 12:
        return data
    order = "<" if data[1] & 1 else ">"
    sec, nanosec = struct.unpack_from(order + "iI", data, 4)
    if sec == 0 and nanosec == 0:
        return data
    seconds, nanoseconds = divmod(sec * _SECOND + nanosec + distance, _SECOND)
    if not -(2**31) <= seconds < 2**31:
        return data
    return data[:4] + struct.pack(order + "iI", seconds, nanoseconds) + data[12:]
