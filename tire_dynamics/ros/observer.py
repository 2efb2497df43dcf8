"""What can be seen of a running node from beside it: its diagnostics, its newest forces, its lines on /rosout."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from ..files.errors import InputError, first_line
from .journal import DIAGNOSTICS

__all__ = ["Observer", "Status"]

_NODE = "node"  # the status that every node of this package has beside those of its wheels
_HISTORY = 60  # forces that are kept of each wheel
_LINES = 200  # of /rosout
_PAUSE = 0.03  # [s]
_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # the others are left to the middleware
_LATCHED = QoSProfile(depth=_LINES, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Status(NamedTuple):
    """A diagnostic status: 0 for OK, 1 for WARN, 2 for ERROR, 3 for one that has not come for three seconds."""

    level: int
    message: str
    values: Mapping[str, str]


class Observer:
    """A ROS node that listens to a node of this package.

    Parameters
    ----------
    node : str or None
        Full name of the node; None for the one that is there.
    ros_arguments : sequence of str
        What stands behind ``--ros-args``.

    Raises
    ------
    InputError
        The ROS arguments cannot be used.
    """

    def __init__(self, node: str | None = None, ros_arguments: Sequence[str] = ()) -> None:
        self.name = node
        """Full name of the node; None before it is known."""
        self._lines: deque[tuple[str, int, str]] = deque(maxlen=_LINES)  # of all nodes, with the logger's name
        self._statuses: dict[str, Status] = {}  # by what stands behind the node's name
        self._heard = 0.0
        self._nodes: set[str] = set()
        self._forces: dict[str, deque[tuple[float, float]]] = {}
        self._context = rclpy.context.Context()
        try:
            arguments = ["tire_dynamics_watch", "--ros-args", *ros_arguments]
            rclpy.init(args=arguments, context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        except Exception as error:  # rcl reports bad arguments and files as RuntimeErrors of its own kinds
            raise InputError(f"--ros-args: {first_line(error)}") from None
        self._node = Node(
            "tire_dynamics_watch", context=self._context, start_parameter_services=False, enable_rosout=False
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._node.create_subscription(DiagnosticArray, DIAGNOSTICS, self._take_diagnostics, 10)
        self._node.create_subscription(Log, "/rosout", self._take_line, _LATCHED)

    def __enter__(self) -> Observer:
        return self

    def __exit__(self, *error: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def spin(self, seconds: float) -> None:
        """Take what comes for so long; of a wheel's forces only some, which is enough to look at."""
        over = time.monotonic() + seconds
        while (left := over - time.monotonic()) > 0.0:
            time.sleep(min(left, _PAUSE))
            for _ in range(len(self._forces) + 10):
                self._executor.spin_once(timeout_sec=0.0)

    @property
    def nodes(self) -> list[str]:
        """Full names of the nodes of this package that have been heard."""
        return sorted(self._nodes)

    @property
    def node(self) -> Status | None:
        """The node's own status; None before there is one."""
        return self._status(_NODE)

    @property
    def wheels(self) -> dict[str, Status]:
        """The status of each wheel."""
        return {name: status for name in self._statuses if name != _NODE and (status := self._status(name)) is not None}

    @property
    def lines(self) -> list[tuple[int, str]]:
        """Level (20 INFO, 30 WARN, 40 ERROR) and text of the node's newest lines."""
        mine = (self.name or "").strip("/").replace("/", ".")
        return [(level, text) for name, level, text in self._lines if name == mine]

    def forces(self, wheel: str) -> list[tuple[float, float]]:
        """Some of the last forces (x, z) on a wheel's axle [N], the newest last."""
        return list(self._forces.get(wheel, ()))

    def _status(self, name: str) -> Status | None:
        status = self._statuses.get(name)
        if status is not None and time.monotonic() > self._heard + 3.0:
            return Status(3, "nothing heard of it for some seconds", status.values)
        return status

    def _take_diagnostics(self, array: DiagnosticArray) -> None:
        mine: dict[str, Status] = {}
        for status in array.status:
            prefix, _, name = status.name.rpartition(": ")
            if prefix.rpartition("/")[2] and status.hardware_id == f"/{prefix}" and "ticks" in str(status.values):
                self._nodes.add(status.hardware_id)
            if self.name is None and name == _NODE and status.hardware_id in self._nodes:
                self.name = status.hardware_id
            if status.hardware_id == self.name:
                values = {item.key: item.value for item in status.values}
                mine[name] = Status(status.level[0], status.message, values)
        if mine:
            self._statuses, self._heard = mine, time.monotonic()
            self._listen()

    def _listen(self) -> None:
        """Subscribe to the forces of wheels that are new; whatever their topics are called now."""
        new = [wheel for wheel in self._statuses if wheel != _NODE and wheel not in self._forces]
        if not new or self.name is None:
            return
        namespace, _, name = self.name.rpartition("/")
        try:
            found = self._node.get_publisher_names_and_types_by_node(name, namespace or "/")
        except RuntimeError:  # its name is known before it is itself
            return
        topics = {topic for topic, _ in found}
        for wheel in new:
            topic = f"{namespace}/{wheel}/axle_wrench"
            if topic in topics:
                self._forces[wheel] = deque(maxlen=_HISTORY)
                self._node.create_subscription(WrenchStamped, topic, self._taker(wheel), _NEWEST)

    def _taker(self, wheel: str) -> Any:
        def take(message: WrenchStamped) -> None:
            self._forces[wheel].append((message.wrench.force.x, message.wrench.force.z))

        return take

    def _take_line(self, line: Log) -> None:
        self._lines.append((line.name, line.level if isinstance(line.level, int) else ord(line.level), line.msg))
