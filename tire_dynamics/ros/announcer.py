"""What the node says on /rosout while it runs: inputs that have come, are lost or do not fit, and missed ticks."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from ..cdr import messages
from ..replay.pipeline import Pipeline

__all__ = ["Announcer"]

_JOINT_STATES = "joint_states"
_PATIENCE = 5.0  # [s] without an input before its absence is said; for joints that do not fit, behind the first message
_AGAIN = 60.0  # [s] before it is said again
_APART = 10.0  # [s] between two lines about the same wheel, or about ticks
_MOST_NAMES = 12  # of joints in a line


class _Throttle:
    """Whether something is to be said again, and how often it was not."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._next = -1.0
        self.held_back = 0

    def __call__(self) -> bool:
        now = time.monotonic()
        if now < self._next:
            self.held_back += 1
            return False
        self._next = now + self._seconds
        return True

    def more(self) -> str:
        """How often nothing was said since the last time; forgotten then."""
        count, self.held_back = self.held_back, 0
        return f" ({count} more times since the last line)" if count else ""


class _Wheel:
    """What was said of a wheel."""

    def __init__(self) -> None:
        self.known = (False, False)
        self.stops = self.divergences = 0
        self.lost_at: float | None = None
        self.throttle = _Throttle(_APART)


class Announcer:
    """Watches the inputs from one activation of the node to the next.

    Parameters
    ----------
    logger : rclpy logger
    pipeline : Pipeline
    names : mapping
        Full names of the inputs by their relative ones.
    waits_for_clock : callable
        Whether the node's time has not begun: it is simulated, and no /clock has come.
    """

    def __init__(
        self, logger: Any, pipeline: Pipeline, names: Mapping[str, str], waits_for_clock: Callable[[], bool]
    ) -> None:
        self.joint_states: bytes | None = None
        """The newest message on joint_states."""
        self._logger, self._names, self._waits_for_clock = logger, names, waits_for_clock
        self._vehicle, self._inputs = pipeline.vehicle, pipeline.inputs
        estimated = pipeline.values["load_source"] == "estimate"
        loads = ("imu", "travel", "hub_acceleration") if estimated else ("load", "road_height")
        self._mapped = {  # topics of the field map, by what they have of a wheel's two inputs
            kind: [topic.topic for topic in pipeline.mapped if any(each.quantity in of for each in topic.values)]
            for kind, of in enumerate((("speed",), loads))
        }
        self._quantities = ("speed", "road height" if self._vehicle.wheels.on_road else "load")
        self._wheels = [_Wheel() for _ in self._vehicle.inputs]
        self._began = time.monotonic()
        self._joints: dict[str, None] = {}
        self._joints_since: float | None = None
        self._ticks, self._missing, self._misfits = _Throttle(_APART), _Throttle(_AGAIN), _Throttle(_AGAIN)
        self._clock = _Throttle(_AGAIN)

    def update(self) -> None:
        """Say what has changed since the last call."""
        if self.no_clock:
            if self._clock():
                self._logger.warning(f"{self.no_clock}; nothing is computed before it does")
            return
        lost: dict[str, list[str]] = {}  # wheels by what is wrong: where a publisher ends, it is of all
        back: list[tuple[str, float]] = []
        for index, said in enumerate(self._wheels):
            self._update_wheel(index, said, lost, back)
        for why, wheels in lost.items():
            self._logger.warning(f"no output of {', '.join(wheels)}: {why}")
        if back:
            wheels, pause = [name for name, _ in back], max(seconds for _, seconds in back)
            self._logger.info(f"inputs of {', '.join(wheels)} are back after {pause:.1f} s")
        if not all(said.known[0] for said in self._wheels):
            self._learn_joints()
        now = time.monotonic()
        if self.misfit and self._joints_since is not None and now > self._joints_since + _PATIENCE and self._misfits():
            self._logger.warning(f"{self.misfit}; the parameter joint_names says which joint is which wheel's")
        missing = [text for kind, quantity in enumerate(self._quantities) if (text := self._absence(kind, quantity))]
        if missing and now > self._began + _PATIENCE and self._missing():
            self._logger.warning("; ".join(missing))

    @property
    def no_clock(self) -> str:
        """That simulated time has not begun; empty if it has."""
        late = time.monotonic() > self._began + _PATIENCE / 2.0
        return "use_sim_time is set and no /clock comes" if late and self._waits_for_clock() else ""

    @property
    def misfit(self) -> str:
        """That joint_states has no joint of some wheels that have no speed; empty if nothing is known of that."""
        joints = [
            joint
            for joint, said in zip(self._vehicle.settings.joint_names, self._wheels, strict=True)
            if not said.known[0] and joint not in self._joints
        ]
        if not joints or not self._joints:
            return ""
        names = [*self._joints]
        heard = ", ".join(names[:_MOST_NAMES]) + (", ..." if len(names) > _MOST_NAMES else "")
        return f"joint_states has joints {heard}; none is {', '.join(joints)}"

    def _update_wheel(
        self, index: int, said: _Wheel, lost: dict[str, list[str]], back: list[tuple[str, float]]
    ) -> None:
        wheel, inputs = self._vehicle.settings.wheels[index], self._vehicle.inputs[index]
        ages = inputs.ages()
        first = [
            value
            for value, was_known, age in zip(self._values(index), said.known, ages, strict=True)
            if age is not None and not was_known
        ]
        if first:
            said.known = ages[0] is not None or said.known[0], ages[1] is not None or said.known[1]
            self._logger.info(f"{wheel}: first {' and '.join(first)}")
        if inputs.divergences > said.divergences:
            said.divergences = inputs.divergences
            if said.throttle():
                self._logger.error(
                    f"{wheel}: its motion grew beyond all bounds at {inputs.speed:.4g} rad/s, and begins again where "
                    f"the tire is not unstable{said.throttle.more()}"
                )
        if inputs.stops > said.stops:
            said.stops = inputs.stops
            if said.throttle():
                said.lost_at = time.monotonic()
                lost.setdefault(f"{self._too_old(ages)}{said.throttle.more()}", []).append(wheel)
        elif said.lost_at is not None and inputs.running:
            back.append((wheel, time.monotonic() - said.lost_at))
            said.lost_at = None

    def _values(self, index: int) -> tuple[str, str]:
        inputs = self._vehicle.inputs[index]
        speed = f"speed {inputs.speed:.4g} rad/s"
        if inputs.height is not None:
            return speed, f"road height {inputs.height:.4g} m"
        return speed, f"load {inputs.load[0]:.4g} N"

    def _too_old(self, ages: tuple[int | None, int | None]) -> str:
        timeout = self._vehicle.settings.input_timeout
        old = [name for name, age in zip(self._quantities, ages, strict=True) if age is not None and age > timeout]
        what = f"{' and '.join(old)} older than" if old else "an input came later than"
        return f"{what} input_timeout_s, {timeout * 1e-9:g} s"

    def _absence(self, kind: int, quantity: str) -> str:
        """That a quantity is missing of some wheels, and where it would come from."""
        settings = self._vehicle.settings
        wheels = [name for name, said in zip(settings.wheels, self._wheels, strict=True) if not said.known[kind]]
        if not wheels or (kind == 0 and self.misfit):
            return ""
        topics = [
            self._names[topic]
            for topic in self._inputs
            if topic in self._mapped[kind]
            or (topic == _JOINT_STATES and kind == 0 and not self._mapped[0])
            or (topic.partition("/")[0] == wheels[0] and topic.endswith("/wheel_speed") == (kind == 0))
        ]
        more = ", ..." if len(wheels) > 1 else ""
        return f"no {quantity} yet of {', '.join(wheels)}: nothing that can be used on {', '.join(topics)}{more}"

    def _learn_joints(self) -> None:
        data, self.joint_states = self.joint_states, None
        if data is None or len(self._joints) > 1000:
            return
        try:
            names = messages.joint_names(data)[0]
        except messages.MessageError:
            return
        self._joints.update(dict.fromkeys(names))
        if self._joints_since is None:
            self._joints_since = time.monotonic()

    def warn_of_ticks(self, trouble: str) -> None:
        """Say what is wrong with the ticks, if something is."""
        if trouble and self._ticks():
            self._logger.warning(f"{trouble}{self._ticks.more()}")
