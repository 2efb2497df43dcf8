"""The QoS that parameters ask for: ``qos_overrides./joint_states.subscription.reliability`` and so on."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import partial
from typing import Any

from rclpy.duration import Duration, Infinite
from rclpy.node import Node
from rclpy.qos import LivelinessPolicy, QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from ..files.errors import InputError, first_line

__all__ = ["QosOverrides", "as_recorded"]

_PREFIX = "qos_overrides."
_RCLPYS = ("/clock.subscription.",)  # declared by rclpy's time source
_POLICIES = {
    policy.name.lower(): policy
    for policy in (
        QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY,
        QoSPolicyKind.DEADLINE, QoSPolicyKind.LIFESPAN, QoSPolicyKind.LIVELINESS,
        QoSPolicyKind.LIVELINESS_LEASE_DURATION,
    )
}  # fmt: skip


def as_recorded(profile: QoSProfile) -> dict[str, Any]:
    """A QoS profile as a bag's ``metadata.yaml`` says it.

    Parameters
    ----------
    profile : rclpy.qos.QoSProfile

    Returns
    -------
    dict
        Every policy by its name, times in s and ns. What rclpy leaves to DDS is what DDS takes: a time of 0 is for
        ever, and a publisher is alive as long as its process.
    """
    liveliness = profile.liveliness
    return {
        "history": profile.history.name.lower(),
        "depth": profile.depth,
        "reliability": profile.reliability.name.lower(),
        "durability": profile.durability.name.lower(),
        "deadline": _time(profile.deadline),
        "lifespan": _time(profile.lifespan),
        "liveliness": "automatic" if liveliness == LivelinessPolicy.SYSTEM_DEFAULT else liveliness.name.lower(),
        "liveliness_lease_duration": _time(profile.liveliness_lease_duration),
        "avoid_ros_namespace_conventions": profile.avoid_ros_namespace_conventions,
    }


def _time(duration: Duration) -> dict[str, int]:
    sec, nsec = divmod(duration.nanoseconds or Infinite.nanoseconds, 10**9)
    return {"sec": sec, "nsec": nsec}


class QosOverrides:
    """The overrides that a node was given: each is applied when its topic is made, or refused.

    Parameters
    ----------
    node : rclpy.node.Node
        With the parameters from files and the command line declared.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        names = [name for name in node.get_parameters_by_prefix("") if name.startswith(_PREFIX)]
        self._given = {name for name in names if not name.removeprefix(_PREFIX).startswith(_RCLPYS)}
        self._unused = set(self._given)

    def publisher(self, kind: Any, topic: str, qos: int | QoSProfile) -> Any:
        """As the node's ``create_publisher``; :class:`InputError` if a value is none of its policy's."""
        return self._make(partial(self._node.create_publisher, kind, topic), "publisher", topic, qos)

    def subscription(
        self, kind: Any, topic: str, callback: Callable[[Any], None], qos: int | QoSProfile, *, raw: bool
    ) -> Any:
        """As the node's ``create_subscription``; :class:`InputError` if a value is none of its policy's."""
        make = partial(self._node.create_subscription, kind, topic, callback, raw=raw)
        return self._make(make, "subscription", topic, qos)

    def _make(self, make: Callable[..., Any], entity: str, topic: str, qos: int | QoSProfile) -> Any:
        start = f"{_PREFIX}{self._node.resolve_topic_name(topic)}.{entity}."
        policies = {name: _POLICIES.get(name.removeprefix(start)) for name in self._given if name.startswith(start)}
        asked = {name: policy for name, policy in policies.items() if policy is not None}
        if entity == "subscription":  # a lifespan is the publisher's
            asked = {name: policy for name, policy in asked.items() if policy != QoSPolicyKind.LIFESPAN}
        if not asked:
            return make(qos)
        self._unused -= asked.keys()
        for name in asked:  # rclpy declares it anew, with its type and for good
            if not self._node.describe_parameter(name).read_only:
                self._node.undeclare_parameter(name)
        profile = QoSProfile(depth=qos) if isinstance(qos, int) else copy(qos)  # which it changes
        try:
            return make(profile, qos_overriding_options=QoSOverridingOptions(tuple(asked.values())))
        except Exception as error:  # of a dozen kinds, by the policy and what is wrong with it
            raise InputError(f"{start}*: {first_line(error)}") from None

    def check(self) -> None:
        """Refuse what was given for a topic, or a policy, that the node does not have; when all topics are made.

        Raises
        ------
        InputError
        """
        for name in sorted(self._unused):
            raise InputError(
                f"{name} is not of a topic of this node: it must be {_PREFIX}<full topic name>.<publisher or "
                f"subscription>.<{', '.join(_POLICIES)}>"
            )
