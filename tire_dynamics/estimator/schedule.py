# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""When which input is in force: the samples of all wheels, and the steps through time that they make."""

from __future__ import annotations

import math
import operator
from collections import Counter
from collections.abc import Mapping
from typing import Any, SupportsIndex

import numpy as np

from .settings import check_wheel

try:
    import cython
except ImportError:
    from ..science import cython_stand_in as cython
if cython.compiled:
    from cython.cimports.libc.math import fmod, isfinite
else:
    from math import fmod, isfinite

__all__ = ["FOREVER", "OUTCOMES", "Schedule"]

OUTCOMES = (
    "taken", "late", "repeated", "out of order", "not finite",
    "no stamp", "in the future", "speed too high", "load too high", "off the ground", "joint twice", "road jumps",
)  # fmt: skip
"""What becomes of a sample; those from ``no stamp`` on are counted by :class:`.vehicle.Vehicle`."""

_SPEED = cython.declare(cython.Py_ssize_t, 0)
_LOAD = cython.declare(cython.Py_ssize_t, 1)
_TAKEN = cython.declare(cython.int, 0)
_LATE = cython.declare(cython.int, 1)
_REPEATED = cython.declare(cython.int, 2)
_OUT_OF_ORDER = cython.declare(cython.int, 3)
_NOT_FINITE = cython.declare(cython.int, 4)
_KINDS = cython.declare(cython.Py_ssize_t, 12)  # of outcomes
_STEP = cython.declare(cython.int, 1)
_START = cython.declare(cython.int, 2)
_ASK = cython.declare(cython.int, 4)
_DONE = cython.declare(cython.int, 8)
_FULL_TURN = cython.declare(cython.double, 2.0 * math.pi)
_NAN = cython.declare(cython.double, math.nan)
_NEVER = cython.declare(cython.longlong, -(2**62))  # [ns]
FOREVER = 2**61
"""A timeout that never comes [ns]."""


@cython.cclass
class Schedule:
    """The inputs of W wheels through time.

    Parameters
    ----------
    wheels : int
    timeout : int
        Age [ns] beyond which an input is no longer believed.

    Notes
    -----
    What happens to a sample, by its stamp s, the stamp k of the newest sample of its kind in force, and the
    time t that has been reached:

    ==================  ================  ===================================================================
    case                outcome           effect
    ==================  ================  ===================================================================
    s > t               ``taken``         in force from s on, whatever order the samples came in
    k < s <= t          ``late``          in force from t on, the moment it is known; the past is not redone
    s = k, or s waits   ``repeated``      replaces that sample: from t on, or from s on if s > t
    s < k               ``out of order``  none: something newer is in force
    NaN or infinite     ``not finite``    none
    ==================  ================  ===================================================================

    Between samples the newest speed and load whose stamps are not after t are held: nothing is waited for and
    nothing extrapolated. A wheel is set in motion, from equilibrium, at the first moment at which both are known and
    neither is older than the timeout. When one of them becomes older it stops; it starts again by the same rule.

    On the road the height under the wheel [m] stands in the place of the load, and goes along a line: from what it was
    at the beginning of a step to the sample in force at its end. A wheel starts on a road of the height that it then
    has; only what changes from there on acts.

    Times are int64 nanoseconds; speeds [rad/s] and angles [rad], loads and tractions [N].
    """

    # A parameter that is an ``int`` takes floats when compiled, and cuts them; SupportsIndex does not.
    # Of kind 0 (speed, angle) and 1 (load, traction): per wheel and kind, the sample in force and those that wait for
    # their time, in ascending stamps; the second value of a speed is NaN where no angle came with it.

    def __init__(self, wheels: int, timeout: SupportsIndex) -> None:
        self.wheels = wheels
        self.timeout = operator.index(timeout)
        self.time, self.has_time, self.running, self.diverged, self.stops, self.divergences, self.angle_used = (
            _integers(wheels) for _ in range(7)
        )
        self.cursor = _integers(wheels)
        self.counts = _integers(wheels * len(OUTCOMES))
        self.measured_angle = np.full(wheels, math.nan).data
        self.has, self.stamp, self.waiting = (_integers(2 * wheels) for _ in range(3))
        self.values = np.zeros(4 * wheels).data
        self.room = 16
        self.waiting_stamp = _integers(2 * wheels * self.room)
        self.waiting_values = np.zeros(4 * wheels * self.room).data
        self.length = 0
        self.speed = self.load = self.traction = self.load_after = 0.0
        self.angle = math.nan

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def forget(self, wheel: cython.Py_ssize_t) -> cython.void:
        """Forget every sample and the time."""
        kind: cython.Py_ssize_t
        self.has_time[wheel] = self.running[wheel] = self.diverged[wheel] = self.angle_used[wheel] = 0
        self.measured_angle[wheel] = _NAN
        for kind in range(2):
            self.has[2 * wheel + kind] = self.waiting[2 * wheel + kind] = 0

    # -- samples --------------------------------------------------------------------------------------------

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def is_full(self, wheel: cython.Py_ssize_t, kind: cython.Py_ssize_t) -> cython.bint:
        """Whether no further sample can wait before :meth:`grow`."""
        return self.waiting[2 * wheel + kind] >= self.room

    def grow(self) -> None:
        """Make room for twice as many samples that wait."""
        pairs, room = 2 * self.wheels, self.room
        stamps = np.array(self.waiting_stamp).reshape(pairs, room)
        values = np.array(self.waiting_values).reshape(pairs, room, 2)
        self.waiting_stamp = np.concatenate([stamps, np.zeros_like(stamps)], axis=1).reshape(-1).data
        self.waiting_values = np.concatenate([values, np.zeros_like(values)], axis=1).reshape(-1).data
        self.room = 2 * room

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def put(
        self,
        wheel: cython.Py_ssize_t,
        kind: cython.Py_ssize_t,
        stamp: cython.longlong,
        first: cython.double,
        second: cython.double,
    ) -> cython.int:
        """Take a sample, for which there is room; its outcome."""
        at: cython.Py_ssize_t = 2 * wheel + kind
        row: cython.Py_ssize_t = at * self.room
        count: cython.Py_ssize_t = self.waiting[at]
        place: cython.Py_ssize_t
        k: cython.Py_ssize_t
        outcome: cython.int
        if not (isfinite(first) and (kind == _SPEED or isfinite(second))):
            return _NOT_FINITE
        first = first + 0.0  # a negative zero becomes a positive one, lest equal inputs differ in their bits
        second = second + 0.0
        if not self.has_time[wheel] or stamp > self.time[wheel]:
            place = count
            while place > 0 and self.waiting_stamp[row + place - 1] >= stamp:
                place -= 1
            outcome = _TAKEN
            if place < count and self.waiting_stamp[row + place] == stamp:
                outcome = _REPEATED
            else:
                k = count
                while k > place:
                    self.waiting_stamp[row + k] = self.waiting_stamp[row + k - 1]
                    self.waiting_values[2 * (row + k)] = self.waiting_values[2 * (row + k - 1)]
                    self.waiting_values[2 * (row + k) + 1] = self.waiting_values[2 * (row + k - 1) + 1]
                    k -= 1
                self.waiting[at] = count + 1
            self.waiting_stamp[row + place] = stamp
            self.waiting_values[2 * (row + place)] = first
            self.waiting_values[2 * (row + place) + 1] = second
            return outcome
        if self.has[at] and stamp < self.stamp[at]:
            return _OUT_OF_ORDER
        outcome = _REPEATED if self.has[at] and stamp == self.stamp[at] else _LATE
        self.has[at] = 1
        self.stamp[at] = stamp
        self.values[2 * at] = first
        self.values[2 * at + 1] = second
        if kind == _SPEED:
            self.angle_used[wheel] = 0
        return outcome

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def put_speed(
        self, wheel: cython.Py_ssize_t, stamp: cython.longlong, speed: cython.double, angle: cython.double
    ) -> cython.int:
        """Take a sample of the spin and, where it is known, of the wheel's angle.

        An angle that is the last one again is none: who publishes no positions may publish zeros.
        """
        if isfinite(angle) and angle != self.measured_angle[wheel] and isfinite(speed):
            self.measured_angle[wheel] = angle + 0.0
        else:
            angle = _NAN
        return self.put(wheel, _SPEED, stamp, speed, angle)

    def add_speed(self, wheel: int, stamp: SupportsIndex, speed: float, angle: float = math.nan) -> str:
        """Take a sample of the spin [rad/s] and of the wheel's angle [rad], stamped in ns; its outcome."""
        check_wheel(wheel, self.wheels)
        if self.is_full(wheel, _SPEED):
            self.grow()
        return self._counted(wheel, self.put_speed(wheel, operator.index(stamp), speed, angle))

    def add_load(self, wheel: int, stamp: SupportsIndex, load: float, traction: float = 0.0) -> str:
        """Take a sample of the load and the traction [N], stamped in ns; its outcome."""
        check_wheel(wheel, self.wheels)
        if self.is_full(wheel, _LOAD):
            self.grow()
        return self._counted(wheel, self.put(wheel, _LOAD, operator.index(stamp), load, traction))

    def _counted(self, wheel: int, outcome: int) -> str:
        self.counts[wheel * _KINDS + outcome] += 1
        return OUTCOMES[outcome]

    # -- time -----------------------------------------------------------------------------------------------

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def let_in(self, wheel: cython.Py_ssize_t, kind: cython.Py_ssize_t) -> cython.void:
        """Put the first sample that waits in force."""
        at: cython.Py_ssize_t = 2 * wheel + kind
        row: cython.Py_ssize_t = at * self.room
        k: cython.Py_ssize_t
        self.has[at] = 1
        self.stamp[at] = self.waiting_stamp[row]
        self.values[2 * at] = self.waiting_values[2 * row]
        self.values[2 * at + 1] = self.waiting_values[2 * row + 1]
        self.waiting[at] -= 1
        for k in range(self.waiting[at]):
            self.waiting_stamp[row + k] = self.waiting_stamp[row + k + 1]
            self.waiting_values[2 * (row + k)] = self.waiting_values[2 * (row + k + 1)]
            self.waiting_values[2 * (row + k) + 1] = self.waiting_values[2 * (row + k + 1) + 1]
        if kind == _SPEED:
            self.angle_used[wheel] = 0

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def expiry(self, wheel: cython.Py_ssize_t) -> cython.longlong:
        """The last moment at which both inputs are believed; before all times while one is missing."""
        if not (self.has[2 * wheel] and self.has[2 * wheel + 1]):
            return _NEVER
        if self.stamp[2 * wheel] < self.stamp[2 * wheel + 1]:
            return self.stamp[2 * wheel] + self.timeout
        return self.stamp[2 * wheel + 1] + self.timeout

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def may_start(self, wheel: cython.Py_ssize_t, moment: cython.longlong) -> cython.int:
        """START, or ASK behind a divergence: only the caller knows whether the unit is stable at the speed in force."""
        if self.expiry(wheel) == _NEVER or moment > self.expiry(wheel):
            return 0
        return _ASK if self.diverged[wheel] else _START

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def start(self, wheel: cython.Py_ssize_t) -> cython.void:
        """Set a wheel in motion at the time that :meth:`proceed` has come to: ``speed`` and the rest say from where."""
        self.diverged[wheel] = 0
        self.running[wheel] = 1
        self.speed = self.values[4 * wheel]
        self.load = self.values[4 * wheel + 2]
        self.traction = self.values[4 * wheel + 3]
        self.angle = self.angle_at(wheel, self.cursor[wheel], True)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def angle_at(
        self, wheel: cython.Py_ssize_t, moment: cython.longlong, again: cython.bint
    ) -> cython.double:
        """The wheel's angle at a moment [rad] if the speed in force brought one; NaN from the second time on."""
        if not self.has[2 * wheel] or (self.angle_used[wheel] and not again):
            return _NAN
        self.angle_used[wheel] = 1
        if self.values[4 * wheel + 1] != self.values[4 * wheel + 1]:
            return _NAN
        return fmod(
            self.values[4 * wheel + 1] + self.values[4 * wheel] * ((moment - self.stamp[2 * wheel]) * 1e-9), _FULL_TURN
        )

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def begin(self, wheel: cython.Py_ssize_t, stamp: cython.longlong) -> cython.int:
        """Prepare to go on to a time, which is none before that reached; what :meth:`proceed` returns."""
        self.cursor[wheel] = self.time[wheel] if self.has_time[wheel] else stamp
        if self.has_time[wheel] and not self.running[wheel]:
            return self.may_start(wheel, self.cursor[wheel])  # with what came late
        return 0

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def proceed(self, wheel: cython.Py_ssize_t, stamp: cython.longlong) -> cython.int:
        """Go on to the next moment at which something happens, not beyond a time.

        Returns
        -------
        int
            Flags, in this order: STEP, the wheel is to be moved by ``length`` [ns] under ``speed``, ``load`` and
            ``traction``, at whose beginning its angle is ``angle`` unless that is NaN, and at whose end the load in
            force is ``load_after``; START (or ASK), it is to be set in motion by :meth:`start`; DONE, the time has
            been reached.
        """
        at: cython.Py_ssize_t = 2 * wheel
        moment: cython.longlong = stamp
        flags: cython.int = 0
        comes: cython.bint = False
        if self.waiting[at] and self.waiting_stamp[at * self.room] < moment:
            moment = self.waiting_stamp[at * self.room]
        if self.waiting[at + 1] and self.waiting_stamp[(at + 1) * self.room] < moment:
            moment = self.waiting_stamp[(at + 1) * self.room]
        if self.running[wheel]:
            if moment > self.expiry(wheel):
                self.running[wheel] = 0
                self.stops[wheel] += 1
            elif moment > self.cursor[wheel]:
                self.length = moment - self.cursor[wheel]
                self.speed = self.values[2 * at]
                self.load = self.values[2 * at + 2]
                self.traction = self.values[2 * at + 3]
                self.load_after = self.load
                if self.waiting[at + 1] and self.waiting_stamp[(at + 1) * self.room] == moment:
                    self.load_after = self.waiting_values[2 * (at + 1) * self.room]
                self.angle = self.angle_at(wheel, self.cursor[wheel], False)
                flags = _STEP
        self.cursor[wheel] = moment
        if self.waiting[at] and self.waiting_stamp[at * self.room] == moment:
            self.let_in(wheel, _SPEED)
            comes = True
        if self.waiting[at + 1] and self.waiting_stamp[(at + 1) * self.room] == moment:
            self.let_in(wheel, _LOAD)
            comes = True
        if not comes:
            self.time[wheel] = moment
            self.has_time[wheel] = 1
            return flags | _DONE
        if not self.running[wheel]:
            flags |= self.may_start(wheel, moment)
        return flags

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def newest_load(self, wheel: cython.Py_ssize_t) -> cython.double:
        """The load of the newest sample, in force or waiting; NaN before there is one."""
        at: cython.Py_ssize_t = 2 * wheel + 1
        if self.waiting[at]:
            return self.waiting_values[2 * (at * self.room + self.waiting[at] - 1)]
        return self.values[2 * at] if self.has[at] else _NAN

    # -- what can be read -----------------------------------------------------------------------------------

    def is_running(self, wheel: int) -> bool:
        """Whether a wheel is in motion."""
        check_wheel(wheel, self.wheels)
        return bool(self.running[wheel])

    def time_of(self, wheel: int) -> int | None:
        """The time that a wheel has reached [ns]."""
        check_wheel(wheel, self.wheels)
        return int(self.time[wheel]) if self.has_time[wheel] else None

    def ages(self, wheel: int) -> tuple[int | None, int | None]:
        """Ages [ns] of the speed and of the load in force, None where there is none."""
        check_wheel(wheel, self.wheels)
        ages: list[int | None] = []
        for at in (2 * wheel, 2 * wheel + 1):
            known = self.has[at] and self.has_time[wheel]
            ages.append(int(self.time[wheel] - self.stamp[at]) if known else None)
        return ages[0], ages[1]

    def speed_of(self, wheel: int) -> float:
        """Spin in force [rad/s], 0 before there is one."""
        check_wheel(wheel, self.wheels)
        return float(self.values[4 * wheel]) if self.has[2 * wheel] else 0.0

    def load_of(self, wheel: int) -> tuple[float, float]:
        """Vertical load and traction in force [N], 0 before there are any."""
        check_wheel(wheel, self.wheels)
        if not self.has[2 * wheel + 1]:
            return 0.0, 0.0
        return float(self.values[4 * wheel + 2]), float(self.values[4 * wheel + 3])

    def counts_of(self, wheel: int) -> Counter[str]:
        """Samples of a wheel by outcome, those that occurred."""
        check_wheel(wheel, self.wheels)
        row = [int(self.counts[wheel * _KINDS + k]) for k in range(_KINDS)]
        return Counter({name: count for name, count in zip(OUTCOMES, row, strict=True) if count})

    def stops_of(self, wheel: int) -> int:
        """How often a wheel stopped for inputs that were too old."""
        check_wheel(wheel, self.wheels)
        return int(self.stops[wheel])

    def divergences_of(self, wheel: int) -> int:
        """How often a wheel's motion diverged."""
        check_wheel(wheel, self.wheels)
        return int(self.divergences[wheel])

    def snapshot(self, wheel: int) -> dict[str, Any]:
        """Everything of a wheel that later results depend on, in JSON's types."""
        check_wheel(wheel, self.wheels)
        angle = float(self.measured_angle[wheel])
        return {
            "time": self.time_of(wheel),
            "running": bool(self.running[wheel]),
            "diverged": bool(self.diverged[wheel]),
            "measured_angle": None if math.isnan(angle) else angle,
            "angle_used": bool(self.angle_used[wheel]),
            **{name: self._samples(2 * wheel + kind) for kind, name in enumerate(("speed", "load"))},
        }

    def _samples(self, at: int) -> list[Any]:
        """The sample in force or None, and those that wait, of [stamp, value, value or None]."""
        def sample(stamp: int, first: float, second: float) -> list[Any]:
            return [int(stamp), float(first), None if math.isnan(second) else float(second)]

        known = sample(self.stamp[at], self.values[2 * at], self.values[2 * at + 1]) if self.has[at] else None
        places = [at * self.room + k for k in range(self.waiting[at])]
        stamps, values = self.waiting_stamp, self.waiting_values
        return [known, [sample(stamps[k], values[2 * k], values[2 * k + 1]) for k in places]]

    def restore(self, wheel: int, snapshot: Mapping[str, Any]) -> None:
        """Take over a :meth:`snapshot`."""
        check_wheel(wheel, self.wheels)
        self.forget(wheel)
        if snapshot["time"] is not None:
            self.time[wheel], self.has_time[wheel] = operator.index(snapshot["time"]), 1
        self.running[wheel] = bool(snapshot["running"])
        self.diverged[wheel] = bool(snapshot["diverged"])
        if snapshot["measured_angle"] is not None:
            self.measured_angle[wheel] = float(snapshot["measured_angle"])
        for kind, name in enumerate(("speed", "load")):
            known, waiting = snapshot[name]
            at = 2 * wheel + kind
            while len(waiting) > self.room:
                self.grow()
            if known is not None:
                self.stamp[at], self.values[2 * at], self.values[2 * at + 1] = _sample(known)
                self.has[at] = 1
            for k, sample in enumerate(waiting, at * self.room):
                self.waiting_stamp[k], self.waiting_values[2 * k], self.waiting_values[2 * k + 1] = _sample(sample)
            self.waiting[at] = len(waiting)
        self.angle_used[wheel] = bool(snapshot["angle_used"])


def _integers(count: int) -> memoryview:
    return np.zeros(count, dtype=np.int64).data


def _sample(sample: list[Any]) -> tuple[int, float, float]:
    """Unpacked, not indexed: nothing here looks whether an index is within a list."""
    stamp, first, second = sample
    return operator.index(stamp), float(first), math.nan if second is None else float(second)
