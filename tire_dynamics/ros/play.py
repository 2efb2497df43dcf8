"""A bag's messages published live, for machines without ``ros2 bag``."""

from __future__ import annotations

import math
import signal
import struct
import time
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from os import PathLike
from typing import Any

import rclpy
from rclpy.duration import Duration, Infinite
from rclpy.exceptions import NameValidationException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from ..bag import BagReader
from ..bag.writer import offered_qos
from ..files.errors import InputError, first_line

__all__ = ["play", "publisher_qos"]

_NAME = "tire_dynamics_play"
_SHARED = ("/clock", "/diagnostics", "/parameter_events", "/rosout", "/tf", "/tf_static")  # by cars in any namespace
_SECOND = 1_000_000_000
_DEPTH = 10  # of what is kept for those who come later, where the bag does not say: ROS's default
_LEAST_DEPTH, _MOST_DEPTH = 100, 10_000  # messages that may wait for their way out
_FOREVER = 2**31 - 1  # [s]: from here on recorders have meant without end, each its own number


def play(
    source: str | PathLike[str],
    *,
    rate: float = 1.0,
    loop: bool = False,
    keep_stamps: bool = False,
    wait: float = 0.0,
    max_gap: float = 3600.0,
    ros_arguments: Sequence[str] = (),
) -> int:
    """Publish a bag's messages at the pace at which they were recorded, each topic with the QoS that the bag says.

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
    ros_arguments : sequence of str
        What stands behind ``--ros-args``: remappings. With a namespace (``-r __ns:=/car``) every topic moves below it,
        but for those that all nodes share: /clock, /diagnostics, /tf, ...

    Returns
    -------
    int
        Number of messages published.

    Raises
    ------
    InputError
        The bag cannot be read or has no message of a known type, the rate is not a positive number, or the ROS
        arguments cannot be used.
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
    try:
        arguments = [_NAME, "--ros-args", *ros_arguments]
        rclpy.init(args=arguments, context=context, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rcl reports bad arguments and files as RuntimeErrors of its own kinds
        raise InputError(f"--ros-args: {first_line(error)}") from None
    node = Node(_NAME, context=context, start_parameter_services=False, enable_rosout=False)
    executor = EventsExecutor(context=context)  # says which subscribers get nothing, because they ask for another QoS
    executor.add_node(node)
    try:
        publishers = _publishers(node, reader)
        if not publishers:
            raise InputError(
                f"{reader.path}: has no message of a type that this machine knows; install the packages of its types: "
                + ", ".join(sorted({kind.partition("/")[0] for kind in reader.topics.values()}))
            )
        _wait_for_subscribers([publisher for publisher, _ in publishers.values()], wait, executor, stopping)
        count = 0
        while not stopping:
            for topic, data, stamped in _paced(node, reader, publishers, rate, max_gap, executor, stopping):
                publisher, has_header = publishers[topic]
                publisher.publish(data if keep_stamps or not has_header else _restamped(data, stamped))
                count += 1
            if not loop or not count:
                break
        for publisher, _ in publishers.values():
            publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=1))
        return count
    finally:
        executor.shutdown()
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
            name = topic if topic in _SHARED else f"{node.get_namespace().rstrip('/')}/{topic.removeprefix('/')}"
            publisher = node.create_publisher(kind, name, publisher_qos(offered_qos(reader.qos.get(topic, ""))))
        except (ImportError, AttributeError, ValueError, TypeError, NameValidationException):
            node.get_logger().warning(f"{topic} is not played: {msgtype!r} is not known here")
            continue
        fields = list(kind.get_fields_and_field_types().values())
        publishers[topic] = publisher, fields[:1] == ["std_msgs/Header"]
    return publishers


def publisher_qos(offered: Sequence[Mapping[str, Any]]) -> QoSProfile:
    """The QoS with which one publisher stands for those that were recorded.

    Parameters
    ----------
    offered : sequence of mapping
        The profile of each publisher of the topic, as ``metadata.yaml`` has it.

    Returns
    -------
    QoSProfile
        What all of them offered. Where they differ, of each policy what fits every subscriber that one of them fitted:
        reliable, transient local, the shortest deadline and lease. Where nothing is recorded, or what is no offer
        ("unknown", "system_default"), ROS's default: reliable, volatile. Those who come later get as many messages as
        all publishers together kept for them.
    """
    latched = [profile for profile in offered if profile["durability"] == "transient_local"]
    if latched:
        depth = sum(_kept(profile) for profile in latched)
    else:  # nobody sees it: it is what may wait for its way out
        depth = max(_LEAST_DEPTH, *(profile["depth"] for profile in offered), 0)
    best_effort = bool(offered) and all(profile["reliability"] == "best_effort" for profile in offered)
    manual = any(profile["liveliness"] == "manual_by_topic" for profile in offered)
    return QoSProfile(
        depth=min(depth, _MOST_DEPTH),
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        deadline=min((_duration(profile["deadline"]) for profile in offered), default=Infinite),
        lifespan=max((_duration(profile["lifespan"]) for profile in offered), default=Infinite),
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC if manual else LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=min(
            (_duration(profile["liveliness_lease_duration"]) for profile in offered), default=Infinite
        ),
        avoid_ros_namespace_conventions=any(profile["avoid_ros_namespace_conventions"] for profile in offered),
    )


def _kept(profile: Mapping[str, Any]) -> int:
    """How many messages a publisher kept for those who came later."""
    if profile["history"] == "keep_all":
        return _MOST_DEPTH
    return int(profile["depth"]) or _DEPTH  # DDS tells no recorder how deep a history is: then it says 0


def _duration(time: Mapping[str, int]) -> Duration:
    seconds, nanoseconds = time["sec"], time["nsec"]
    unlimited = seconds >= _FOREVER or seconds < 0 or seconds == nanoseconds == 0
    return Infinite if unlimited else Duration(seconds=seconds, nanoseconds=min(nanoseconds, _SECOND))


def _wait_for_subscribers(publishers: list[Any], seconds: float, executor: EventsExecutor, stopping: list[int]) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end and not stopping:
        if all(publisher.get_subscription_count() for publisher in publishers):
            return
        executor.spin_once(timeout_sec=0.02)


def _paced(
    node: Node,
    reader: BagReader,
    publishers: dict[str, Any],
    rate: float,
    max_gap: float,
    executor: EventsExecutor,
    stopping: list[int],
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
            executor.spin_once(timeout_sec=min(left, 0.2))  # to an absolute moment, so that delays do not add up
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
