"""The topic and the service with fields of their own, where the package tire_dynamics_msgs is installed."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rclpy.type_support import check_for_type_support

from ..cdr.primitives import sec_nanosec
from ..estimator.vehicle import Vehicle
from ..files.errors import first_line

__all__ = ["SERVICE", "TOPIC", "WheelStates", "are_installed", "fill_stability"]

SERVICE = "stability"
"""Behind the wheel's name: tire_dynamics_msgs/srv/FloquetStability."""

TOPIC = "state"
"""Behind the wheel's name: tire_dynamics_msgs/msg/WheelState."""

_VERDICTS = ("unknown", "asymptotically stable", "marginally stable", "unstable")  # in the order of the constants


def are_installed() -> bool:
    """Whether there are the messages.

    Raises
    ------
    RuntimeError
        They are there, and cannot be used: their libraries are not found, or are another Python's.
    """
    try:
        from tire_dynamics_msgs.msg import WheelState
    except ImportError:
        return False
    try:
        check_for_type_support(WheelState)
    except Exception as error:  # rosidl's own
        raise RuntimeError(first_line(error)) from None
    return True


def fill_stability(message: Any, found: Mapping[str, Any]) -> None:
    """Put a stability reply into a message.

    Parameters
    ----------
    message : tire_dynamics_msgs.msg.Stability
        One that has not been filled.
    found : mapping
        As :func:`~tire_dynamics.estimator.vehicle.stability_reply` returns it; empty if nothing is known.
    """
    verdict = found.get("verdict", "unknown")
    message.verdict = _VERDICTS.index(verdict) if verdict in _VERDICTS else 0
    message.speed = float(found.get("speed_rad_s", 0.0))
    for field, key in (
        ("period", "period_s"),
        ("spectral_radius", "spectral_radius"),
        ("critical_speed", "critical_speed_rad_s"),
        ("nearest_tongue", "nearest_tongue_rad_s"),
    ):
        value = found.get(key)
        setattr(message, field, array("d", [] if value is None else [value]))
    message.multipliers = _complex_numbers(found.get("multipliers") or [])
    message.exponents = _complex_numbers(found.get("exponents_1_s") or [])
    message.irreducible = found.get("periodicity") == "irreducible"
    message.contact = bool(found.get("contact", False))


def _complex_numbers(parts: Sequence[Sequence[float]]) -> list[Any]:
    from tire_dynamics_msgs.msg import Complex

    return [Complex(real=float(real), imaginary=float(imaginary)) for real, imaginary in parts]


class WheelStates:
    """Publishes the state of each wheel, where somebody listens.

    Parameters
    ----------
    wheels, frames : sequence of str
        Names of the wheels and their axles' frames.
    publisher : callable
        Makes a publisher of a topic, given name, type and queue size.
    """

    def __init__(
        self, wheels: Sequence[str], frames: Sequence[str], publisher: Callable[[str, Any, int], Any]
    ) -> None:
        from tire_dynamics_msgs.msg import Stability, WheelState

        self._stability: Callable[[], Any] = Stability
        self._publishers = [publisher(f"{wheel}/{TOPIC}", WheelState, 10) for wheel in wheels]
        self._messages = [WheelState(wheel=wheel) for wheel in wheels]
        for message, frame in zip(self._messages, frames, strict=True):
            message.header.frame_id = frame
        self._shown: list[Mapping[str, Any] | None] = [None] * len(self._messages)  # the stability in each

    def publish(self, index: int, stamp: int, vehicle: Vehicle, stability: Mapping[str, Any]) -> None:
        """Publish the state of a wheel.

        Parameters
        ----------
        index : int
            Of the wheel.
        stamp : int
            The moment [ns].
        vehicle : Vehicle
        stability : mapping
            The last stability reply; empty before the first.
        """
        if not self._publishers[index].get_subscription_count():
            return
        message, inputs = self._messages[index], vehicle.inputs[index]
        message.header.stamp.sec, message.header.stamp.nanosec = sec_nanosec(stamp)
        message.speed = float(inputs.speed)
        message.force.x, message.force.z = map(float, vehicle.wheels.force_of(index))
        message.load, message.traction = map(float, inputs.load)
        if self._shown[index] is not stability:
            self._shown[index], message.stability = stability, self._stability()
            fill_stability(message.stability, stability)
        self._publishers[index].publish(message)
