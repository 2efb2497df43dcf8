# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Several wheels of one kind through time: what every sample and every tick does, live and in replay."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from ..science import contact, rotating_excitation, wheel
from ..science.unit import TireWheelUnit
from .settings import VehicleSettings, check_wheel

try:
    import cython
except ImportError:
    from ..science import cython_stand_in as cython
if cython.compiled:
    from cython.cimports.tire_dynamics.estimator.belt import BeltMotion
    from cython.cimports.tire_dynamics.estimator.motion import Motion
    from cython.cimports.tire_dynamics.estimator.road_motion import RoadMotion
    from cython.cimports.tire_dynamics.estimator.schedule import Schedule
else:
    from .belt import BeltMotion
    from .motion import Motion
    from .road_motion import RoadMotion
    from .schedule import Schedule

from .belt import ring_angles
from .road_constants import on_the_road, under_the_belt

__all__ = ["Wheels"]

_SPEED = cython.declare(cython.Py_ssize_t, 0)
_LOAD = cython.declare(cython.Py_ssize_t, 1)
_START = cython.declare(cython.int, 2)  # flags of Schedule.proceed
_STEP = cython.declare(cython.int, 1)
_ASK = cython.declare(cython.int, 4)
_DONE = cython.declare(cython.int, 8)
_OUTCOMES = cython.declare(cython.Py_ssize_t, 12)  # places in Schedule.counts
_ORDERS = cython.declare(cython.Py_ssize_t, 16384)  # samples of a wheel that may wait to be taken
_FULL_TURN = cython.declare(cython.double, 2.0 * math.pi)
_APART = cython.declare(cython.double, 2.0 * math.pi / 200.0)  # [rad] at least from one sample to the next
_NO_STAMP = cython.declare(cython.Py_ssize_t, 5)
_IN_THE_FUTURE = cython.declare(cython.Py_ssize_t, 6)
_SPEED_TOO_HIGH = cython.declare(cython.Py_ssize_t, 7)
_LOAD_TOO_HIGH = cython.declare(cython.Py_ssize_t, 8)
_OFF_THE_GROUND = cython.declare(cython.Py_ssize_t, 9)
_JOINT_TWICE = cython.declare(cython.Py_ssize_t, 10)
_ROAD_JUMPS = cython.declare(cython.Py_ssize_t, 11)
_HIGHEST_ROAD = cython.declare(cython.double, 1e5)  # [m], either way


@lru_cache(maxsize=1024)
def _is_unstable_on_the_road(unit: TireWheelUnit, speed: float, model: wheel.Model, n_max: int) -> bool:
    """By the rad/s: it takes some tens of milliseconds."""
    return contact.stability(unit, speed, model, n_max).verdict == "unstable"


def _or_none(values: Any) -> list[float | None]:
    return [None if math.isnan(value) else float(value) for value in values]


@cython.cclass
class Wheels:
    """W wheels with their inputs, motions and belts.

    Everything that decides an output comes in through the arguments: values, stamps and times of receipt, in
    nanoseconds of one clock. The same calls in the same order give the same outputs, bit for bit.

    Parameters
    ----------
    settings : VehicleSettings

    Notes
    -----
    Outcomes beyond those of :class:`.schedule.Schedule`, counted by the same counters:

    =====================  ==================================================================================
    ``no stamp``           a stamp of zero: the time of receipt is taken for it
    ``in the future``      the stamp lies more than the input timeout after the receipt: refused
    ``speed too high``     beyond ``max_speed``: refused
    ``load too high``      load or traction beyond ``max_load``: refused
    ``off the ground``     a negative load: taken as zero, the road cannot pull
    ``joint twice``        a joint that one JointState lists twice: the first is taken
    ``road jumps``         a height that differs from the one before by more than ``max_road_step`` while the wheel
                           is in motion, or is beyond 1e5 m: left out. When no other has come for the timeout the
                           wheel stops, and starts again, at rest, on the road as it then is
    =====================  ==================================================================================

    A unit that is driven beyond its stability limit grows without bound. Once any velocity or displacement exceeds
    1e6 m/s or m, the motion has diverged, is counted, and starts again from equilibrium when the unit is no longer
    unstable at the speed in force. Where that takes long, which is on the road and of a tire that is not the same all
    around, who calls may set ``judged_elsewhere``: then :meth:`questions` are asked, and :meth:`answer` lets go on.
    """

    def __init__(self, settings: VehicleSettings) -> None:
        count = len(settings.wheels)
        self.count, self.model = count, settings.model
        self.schedule = Schedule(count, settings.input_timeout)
        psi = ring_angles(settings.ring_samples)
        self.on_road = settings.static_loads is not None
        road: Any = None
        if settings.static_loads is not None:
            self.motion = Motion(on_the_road(settings.unit), settings.model, count)
            self.belt = BeltMotion(under_the_belt(settings.unit), settings.model, settings.n_max, count, psi)
            road = RoadMotion(
                settings.unit, self.motion, self.belt, settings.static_loads, settings.contact_points,
                settings.coupled_harmonics,
            )  # fmt: skip
        else:
            self.motion = Motion(settings.unit, settings.model, count)
            self.belt = BeltMotion(settings.unit, settings.model, settings.n_max, count, psi)
        self.road = road
        self.n_max = settings.n_max
        self.max_road_step = settings.max_road_step
        self.clock_resets = 0
        self.has_time, self.now = False, 0
        self.input_timeout = self.schedule.timeout
        self.max_speed, self.max_load = settings.max_speed, settings.max_load
        self.ring_period = settings.ring_period
        # Each wheel's belt has its own part of the period: all at one tick would take longer than the others.
        self.offset = np.array([k * settings.ring_period // count for k in range(count)], dtype=np.int64).data
        self.turn, self.has_turn, self.due = (np.zeros(count, dtype=np.int64).data for _ in range(3))
        self.force = np.zeros(2 * count).data
        self.is_noting = False
        self.noted = np.zeros(count, dtype=np.int64).data
        self.last_angle = np.full(count, np.inf).data
        self.orders = np.zeros(1).data
        self.judged_elsewhere = False
        self.asked_at, self.stable_at = (np.full(count, math.nan).data for _ in range(2))  # [rad/s]

    @property
    def unit(self) -> TireWheelUnit:
        """The tire of every wheel."""
        return self.motion.unit if self.road is None else self.road.unit

    def set_unit(self, unit: TireWheelUnit) -> None:
        """Change the tire of every wheel from now on; positions and velocities go on as they are."""
        for w in range(self.count):  # what was asked and answered was of another
            self.asked_at[w] = self.stable_at[w] = math.nan
        if self.road is not None:
            self.road.set_unit(unit)
            return
        self.motion.set_unit(unit)
        self.belt.set_unit(unit)

    def reset(self) -> None:
        """Forget every sample, every state and the time."""
        self._forget()
        for w in range(self.count):
            self.has_turn[w] = self.due[w] = 0
        self.has_time = False

    def _forget(self) -> None:
        for w in range(self.count):
            self.asked_at[w] = self.stable_at[w] = math.nan
            self.schedule.forget(w)
            if self.road is not None:
                self.road.put(w, 0.0, 0.0, 0.0)
            else:
                self.motion.reset(w)
                self.belt.reset(w)

    # -- samples --------------------------------------------------------------------------------------------

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def stamped(
        self, wheel: cython.Py_ssize_t, received: cython.longlong, stamp: cython.longlong
    ) -> cython.bint:
        """Whether a stamp can be used; counts those that cannot, and those that are none."""
        if stamp == 0:
            self.schedule.counts[wheel * _OUTCOMES + _NO_STAMP] += 1
        elif stamp > received + self.input_timeout:
            self.schedule.counts[wheel * _OUTCOMES + _IN_THE_FUTURE] += 1
            return False
        return True

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def take_speed(
        self,
        wheel: cython.Py_ssize_t,
        received: cython.longlong,
        stamp: cython.longlong,
        speed: cython.double,
        angle: cython.double,
    ) -> cython.void:
        """A sample of the spin [rad/s] and, where it is known, of the wheel's angle [rad]."""
        outcome: cython.int
        if not self.stamped(wheel, received, stamp):
            return
        if abs(speed) > self.max_speed:
            self.schedule.counts[wheel * _OUTCOMES + _SPEED_TOO_HIGH] += 1
            return
        if self.schedule.is_full(wheel, _SPEED):
            with cython.gil:
                self.schedule.grow()
        outcome = self.schedule.put_speed(wheel, stamp if stamp != 0 else received, speed, angle)
        self.schedule.counts[wheel * _OUTCOMES + outcome] += 1

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def take_load(
        self,
        wheel: cython.Py_ssize_t,
        received: cython.longlong,
        stamp: cython.longlong,
        load: cython.double,
        traction: cython.double,
    ) -> cython.void:
        """A sample of the contact force on the tire: vertical, up positive, and along x_ros [N]."""
        outcome: cython.int
        if not self.stamped(wheel, received, stamp):
            return
        if abs(load) > self.max_load or abs(traction) > self.max_load:
            self.schedule.counts[wheel * _OUTCOMES + _LOAD_TOO_HIGH] += 1
            return
        if load < 0.0:
            self.schedule.counts[wheel * _OUTCOMES + _OFF_THE_GROUND] += 1
            load = 0.0
        if self.schedule.is_full(wheel, _LOAD):
            with cython.gil:
                self.schedule.grow()
        outcome = self.schedule.put(wheel, _LOAD, stamp if stamp != 0 else received, load, traction)
        self.schedule.counts[wheel * _OUTCOMES + outcome] += 1

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def take_height(
        self, wheel: cython.Py_ssize_t, received: cython.longlong, stamp: cython.longlong, height: cython.double
    ) -> cython.void:
        """A sample of the road's height under the wheel, up positive [m]."""
        outcome: cython.int
        before: cython.double = self.schedule.newest_load(wheel)
        if not self.stamped(wheel, received, stamp):
            return
        if abs(height) > _HIGHEST_ROAD or (
            self.schedule.running[wheel] and abs(height - before) > self.max_road_step
        ):
            self.schedule.counts[wheel * _OUTCOMES + _ROAD_JUMPS] += 1
            return
        if self.schedule.is_full(wheel, _LOAD):
            with cython.gil:
                self.schedule.grow()
        outcome = self.schedule.put(wheel, _LOAD, stamp if stamp != 0 else received, height, 0.0)
        self.schedule.counts[wheel * _OUTCOMES + outcome] += 1

    def add_height(self, wheel: int, received: SupportsIndex, stamp: SupportsIndex, height: float) -> None:
        """Take a sample of the road's height under the wheel, up positive [m]; times in ns."""
        self.take_height(wheel, received, stamp, height)

    def add_speed(
        self, wheel: int, received: SupportsIndex, stamp: SupportsIndex, speed: float, angle: float = math.nan
    ) -> None:
        """Take a sample of the spin [rad/s] and of the wheel's angle [rad]; times in ns."""
        check_wheel(wheel, self.count)
        self.take_speed(wheel, operator.index(received), operator.index(stamp), speed, angle)

    def add_load(
        self, wheel: int, received: SupportsIndex, stamp: SupportsIndex, load: float, traction: float = 0.0
    ) -> None:
        """Take a sample of the load, up positive, and of the traction along x_ros, on the tire [N]; times in ns."""
        check_wheel(wheel, self.count)
        self.take_load(wheel, operator.index(received), operator.index(stamp), load, traction)

    def count_joint_twice(self, wheel: int) -> None:
        """Count a joint that one JointState lists twice; the first is taken."""
        check_wheel(wheel, self.count)
        self.schedule.counts[wheel * _OUTCOMES + _JOINT_TWICE] += 1

    # -- time -----------------------------------------------------------------------------------------------

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def start_if(self, wheel: cython.Py_ssize_t, flags: cython.int) -> cython.void:
        """Set a wheel in motion if the schedule says so and, behind a divergence, the unit is no longer unstable."""
        if flags & (_START | _ASK):
            with cython.gil:
                self._start(wheel, bool(flags & _ASK))

    def _start(self, index: int, has_diverged: bool) -> None:
        if has_diverged and not self._may_start_again(index):
            return
        self.schedule.start(index)
        speed, load, traction = self.schedule.speed, self.schedule.load, self.schedule.traction
        angle = 0.0 if math.isnan(self.schedule.angle) else self.schedule.angle
        if self.road is not None:
            self.road.put(index, speed, angle, load)
            return
        with np.errstate(all="ignore"):  # a unit that is no tire may have no finite state, and has diverged then
            state = rotating_excitation.steady_state(self.unit, speed, load, traction, angle, self.model)
        self.motion.put(index, state, speed, angle)
        self.belt.start(index, speed, load, traction)

    def _may_start_again(self, index: int) -> bool:
        """Whether a wheel that has diverged is stable at its speed, as far as is known now."""
        speed = self._judged_speed(self.schedule.speed_of(index))
        if self.judged_elsewhere and (self.road is not None or not self.unit.is_uniform):
            is_stable = bool(self.stable_at[index] == speed)
            self.asked_at[index], self.stable_at[index] = math.nan if is_stable else speed, math.nan
            return is_stable
        if self.road is None:
            return not wheel.is_unstable(self.unit, speed, self.model)
        return not _is_unstable_on_the_road(self.unit.mean, speed, self.model, self.n_max)

    def _judged_speed(self, speed: float) -> float:
        return wheel.judged_speed(self.unit, speed) if self.road is None else float(round(speed))

    def questions(self) -> list[tuple[int, float]]:
        """Wheels that have diverged, each with the speed [rad/s] of which they want to know whether it is stable."""
        return [(w, self.asked_at[w]) for w in range(self.count) if not math.isnan(self.asked_at[w])]

    def answer(self, wheel: int, speed: float) -> None:
        """Say that the unit is not unstable at a speed [rad/s] that a wheel has asked about: at it, it starts again."""
        check_wheel(wheel, self.count)
        self.stable_at[wheel] = speed

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def follow(self, wheel: cython.Py_ssize_t, stamp: cython.longlong) -> cython.void:
        """Take one wheel to a time [ns], which is none before that reached."""
        flags: cython.int = self.schedule.begin(wheel, stamp)
        self.start_if(wheel, flags)
        while True:
            flags = self.schedule.proceed(wheel, stamp)
            if flags & _STEP and self.on_road:
                self.road.advance_wheel(
                    wheel, self.schedule.length * 1e-9, self.schedule.speed, self.schedule.load_after,
                    self.schedule.angle,
                )  # fmt: skip
            elif flags & _STEP:
                self.motion.step(
                    wheel, self.schedule.length * 1e-9, self.schedule.speed, 0.0, self.schedule.load,
                    self.schedule.traction, 0.0, 0.0, self.schedule.angle,
                )  # fmt: skip
                self.belt.enqueue(
                    wheel, self.schedule.length, self.schedule.speed, self.schedule.load, self.schedule.traction
                )
            self.start_if(wheel, flags)
            if flags & _DONE:
                break

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def go_to(self, stamp: cython.longlong) -> cython.void:
        """Take every wheel to a time [ns], and put their axle forces into ``force``.

        A time before the last one means that the clock was set back: everything is forgotten, and the wheels start
        again from equilibrium with the inputs to come.
        """
        w: cython.Py_ssize_t
        moment: cython.longlong
        turn: cython.longlong
        if self.has_time and stamp < self.now:
            self.clock_resets += 1
            with cython.gil:
                self._forget()
        self.has_time, self.now = True, stamp
        for w in range(self.count):
            moment = stamp + self.offset[w]
            turn = moment // self.ring_period
            if moment < 0 and turn * self.ring_period > moment:  # C rounds towards zero
                turn -= 1
            self.due[w] = not (self.has_turn[w] and turn == self.turn[w])
            self.turn[w] = turn
            self.has_turn[w] = 1
            self.follow(w, stamp)
            if not self.axle_force_and_norm(w, self.schedule.values[4 * w] if self.schedule.has[2 * w] else 0.0):
                if self.schedule.running[w]:
                    self.schedule.running[w] = 0
                    self.schedule.diverged[w] = 1
                    self.schedule.divergences[w] += 1
            self.force[2 * w], self.force[2 * w + 1] = self.motion.force_x, self.motion.force_z
            if self.is_noting and self.schedule.running[w]:
                self.note_order(w)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def axle_force_and_norm(self, wheel: cython.Py_ssize_t, speed: cython.double) -> cython.bint:
        """The axle's force into ``motion``; whether the state is bounded."""
        if self.on_road:
            return self.road.axle_force_and_norm(wheel, speed)
        return self.motion.axle_force_and_norm(wheel, speed)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def deflect(self, wheel: cython.Py_ssize_t) -> cython.void:
        """A belt's deflection into ``belt.shape``."""
        if self.on_road:
            self.road.set_belt(wheel)
        self.belt.deflect(wheel, self.motion)

    def _deflection(self, wheel: int) -> NDArray[np.float64]:
        self.deflect(wheel)
        return np.array(self.belt.shape).reshape(2, -1)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def note_order(self, wheel: cython.Py_ssize_t) -> cython.void:
        """Keep the wheel's angle and its vertical force, each so much of a turn: a wheel that stands keeps none."""
        at: cython.Py_ssize_t = 2 * (wheel * _ORDERS + self.noted[wheel])
        way: cython.double = abs(self.motion.phase[wheel] - self.last_angle[wheel])
        if self.noted[wheel] < _ORDERS and not (way < _APART or abs(way - _FULL_TURN) < _APART):
            self.last_angle[wheel] = self.motion.phase[wheel]
            self.orders[at] = self.motion.phase[wheel]
            self.orders[at + 1] = self.motion.force_z
            self.noted[wheel] += 1

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def is_due(self, wheel: cython.Py_ssize_t) -> cython.bint:
        """Whether the belt of a wheel in motion is due at the last tick, and has not been asked for."""
        if not (self.due[wheel] and self.schedule.running[wheel]):
            self.due[wheel] = 0
            return False
        self.due[wheel] = 0
        return True

    def tick(self, stamp: SupportsIndex) -> list[tuple[int, float, float]]:
        """Advance every wheel to a time [ns]; index and axle force (x, z) [N] of each that is in motion."""
        self.go_to(operator.index(stamp))
        return [
            (w, self.force[2 * w], self.force[2 * w + 1]) for w in range(self.count) if self.schedule.running[w]
        ]

    def due_belts(self) -> list[tuple[int, Any]]:
        """Index and deflection (2, P) [m] of belts that are due at the last tick and have not been asked for."""
        return [(w, self._deflection(w)) for w in range(self.count) if self.is_due(w)]

    def note_orders(self) -> None:
        """Keep, from now on, the angle and the vertical force of wheels that turn; :meth:`noted_orders` takes them."""
        self.orders = np.zeros(2 * self.count * _ORDERS).data
        self.is_noting = True

    def noted_orders(self, wheel: int) -> NDArray[np.float64]:
        """Angles [rad] and forces [N] since the last call, shape (M, 2); what finds no more room is left out."""
        check_wheel(wheel, self.count)
        first, count = 2 * wheel * _ORDERS, int(self.noted[wheel])
        self.noted[wheel] = 0
        return np.array(self.orders[first : first + 2 * count]).reshape(-1, 2)

    # -- what can be read -----------------------------------------------------------------------------------

    def force_of(self, wheel: int) -> tuple[float, float]:
        """Axle force (x, z) at the last tick [N]."""
        check_wheel(wheel, self.count)
        return self.force[2 * wheel], self.force[2 * wheel + 1]

    def load_of(self, wheel: int) -> tuple[float, float]:
        """The contact force on the tire (z, x) [N]: as it was given, or on the road at the last tick."""
        if self.road is None:
            return self.schedule.load_of(wheel)
        return self.road.contact_of(wheel), 0.0

    def height_of(self, wheel: int) -> float | None:
        """The road's height in force under a wheel [m]; None where loads are given or before there is one."""
        if self.road is None or not self.schedule.has[2 * wheel + 1]:
            return None
        return self.schedule.load_of(wheel)[0]

    @property
    def time(self) -> int | None:
        """The last tick [ns]."""
        return self.now if self.has_time else None

    def snapshot(self) -> dict[str, Any]:
        """Everything that later outputs depend on, in JSON's types."""
        turns = [self.turn[w] if self.has_turn[w] else None for w in range(self.count)]
        wheels = [
            {**self.schedule.snapshot(w), **self.motion.snapshot(w), **self._belt_snapshot(w)}
            for w in range(self.count)
        ]
        judged = {"elsewhere": bool(self.judged_elsewhere), "stable_at": _or_none(self.stable_at)}
        return {"time": self.time, "ring_turns": turns, "wheels": wheels, "judged": judged}

    def _belt_snapshot(self, wheel: int) -> dict[str, Any]:
        if self.road is not None:
            return {"road": self.road.snapshot(wheel)}
        return {"belt": self.belt.snapshot(wheel)}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over a :meth:`snapshot` of wheels with the same settings."""
        time, states, turns = snapshot["time"], snapshot["wheels"], snapshot["ring_turns"]
        if not len(states) == len(turns) == self.count:
            found = f"{len(states)} wheels and {len(turns)} turns"
            raise ValueError(f"the snapshot has {found}; there are {self.count} wheels")
        judged = snapshot.get("judged", {"elsewhere": False, "stable_at": [None] * self.count})  # logs of before
        if len(judged["stable_at"]) != self.count:
            raise ValueError(f"the snapshot has stability of {len(judged['stable_at'])} wheels; there are {self.count}")
        self.judged_elsewhere = bool(judged["elsewhere"])
        self.stable_at = np.array([math.nan if each is None else float(each) for each in judged["stable_at"]]).data
        self.asked_at = np.full(self.count, math.nan).data
        self.has_time, self.now = time is not None, 0 if time is None else operator.index(time)
        for w, turn in enumerate(turns):
            self.has_turn[w], self.turn[w] = turn is not None, 0 if turn is None else operator.index(turn)
        for w, state in enumerate(states):
            self.schedule.restore(w, state)
            self.motion.restore(w, state)
            if self.road is not None:
                self.road.restore(w, state["road"])
            else:
                self.belt.restore(w, state["belt"])
