"""Topics of a running system, listened to for a while and written into a bag."""

from __future__ import annotations

import signal
import time
from collections.abc import Mapping
from functools import partial
from importlib import import_module
from pathlib import Path

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions

from ..bag import BagWriter
from ..files.errors import InputError

__all__ = ["record"]


def record(topics: Mapping[str, str], folder: Path, seconds: float) -> dict[str, int]:
    """Write what comes on some topics into a rosbag2 folder, until the time is over, or SIGINT or SIGTERM.

    Parameters
    ----------
    topics : mapping of str to str
        Types by topic, as ``geometry_msgs/msg/WrenchStamped``.
    folder : Path
        The bag.
    seconds : float
        From the first message on any of them.

    Returns
    -------
    dict of str to int
        Messages by topic.

    Raises
    ------
    InputError
        A name is no topic.
    """
    stopping: list[int] = []
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number in before:
        signal.signal(number, lambda caught, frame: stopping.append(caught))
    context = rclpy.context.Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = Node("tire_dynamics_compare", context=context, start_parameter_services=False, enable_rosout=False)
    executor = EventsExecutor(context=context)
    executor.add_node(node)
    heard = dict.fromkeys(topics, 0)
    try:
        with BagWriter(folder) as bag:

            def take(topic: str, number: int, data: bytes) -> None:
                now = time.time_ns()
                bag.write(number, now, now, data)
                heard[topic] += 1

            for topic, kind in topics.items():
                package, kind_of, name = kind.split("/")
                numbered = partial(take, topic, bag.add_topic(topic, kind))
                type_ = getattr(import_module(f"{package}.{kind_of}"), name)
                try:
                    node.create_subscription(type_, topic, numbered, qos_profile_sensor_data, raw=True)
                except (NameValidationException, ValueError) as error:
                    raise InputError(f"{topic!r} is no name of a topic: {str(error).splitlines()[0]}") from None
            end = None
            while not stopping and (end is None or time.monotonic() < end):
                executor.spin_once(timeout_sec=0.1)
                if end is None and any(heard.values()):
                    end = time.monotonic() + seconds
        return heard
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
        for number, handler in before.items():
            signal.signal(number, handler)
