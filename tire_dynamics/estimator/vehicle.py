"""The wheels of a vehicle by their names, and what is known of their stability."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..science import contact as on_road
from ..science import nonuniform, wheel
from ..science.floquet import FloquetResult
from ..science.unit import TireWheelUnit
from .settings import VehicleSettings
from .wheels import Wheels

__all__ = [
    "Belt",
    "Output",
    "Vehicle",
    "VehicleSettings",
    "WheelInputs",
    "joint_places",
    "modes_on_the_road",
    "stability_reply",
]

FloatArray = NDArray[np.float64]

_MOST_VARYING = 5


class Output(NamedTuple):
    """One wheel after a tick: its index and the axle force [N] (REP 103)."""

    wheel: int
    force_x: float
    force_z: float


class Belt(NamedTuple):
    """The belt of one wheel: radial and tangential deflection relative to the wheel centre [m], shape (2, P)."""

    wheel: int
    deflection: FloatArray


class WheelInputs:
    """What is known of the inputs of one wheel; times in ns."""

    def __init__(self, wheels: Wheels, index: int) -> None:
        self._wheels, self._schedule, self._index = wheels, wheels.schedule, index

    @property
    def running(self) -> bool:
        """Whether the wheel is in motion."""
        return self._schedule.is_running(self._index)

    @property
    def counts(self) -> Counter[str]:
        """Samples by outcome."""
        return self._schedule.counts_of(self._index)

    @property
    def stops(self) -> int:
        """How often the motion stopped for inputs that were too old."""
        return self._schedule.stops_of(self._index)

    @property
    def divergences(self) -> int:
        """How often the motion diverged."""
        return self._schedule.divergences_of(self._index)

    @property
    def speed(self) -> float:
        """Spin in force [rad/s]."""
        return self._schedule.speed_of(self._index)

    @property
    def load(self) -> tuple[float, float]:
        """Vertical load and traction [N]: in force, or on the road as the contact has them."""
        return self._wheels.load_of(self._index)

    @property
    def height(self) -> float | None:
        """The road's height in force [m]; None where loads are given."""
        return self._wheels.height_of(self._index)

    def ages(self) -> tuple[int | None, int | None]:
        """Ages [ns] of the speed and of the load in force, None where there is none."""
        return self._schedule.ages(self._index)


class Vehicle:
    """Several wheels of one kind, fed with messages' contents and ticks.

    Everything that decides an output comes in through the arguments: values, stamps and times of receipt, all
    in nanoseconds of one clock. The same calls in the same order give the same outputs, bit for bit; a replay
    repeats the calls of the live node.

    Parameters
    ----------
    settings : VehicleSettings

    Attributes
    ----------
    wheels : Wheels
        The compiled core, which says what happens to a sample.
    inputs : list of WheelInputs
    message_counts : Counter
        ``no velocity``: JointStates whose velocities are not one per name, which were refused.
    """

    def __init__(self, settings: VehicleSettings) -> None:
        self.settings = settings
        self.wheels = Wheels(settings)
        self.inputs = [WheelInputs(self.wheels, index) for index in range(len(settings.wheels))]
        self.message_counts: Counter[str] = Counter()
        self._places: dict[tuple[str, ...], list[tuple[int, int, bool]]] = {}

    def set_unit(self, unit: TireWheelUnit) -> None:
        """Change the tire of every wheel from now on; positions and velocities go on as they are."""
        self.wheels.set_unit(unit)

    @property
    def unit(self) -> TireWheelUnit:
        """The tire of every wheel."""
        return self.wheels.unit

    @property
    def time(self) -> int | None:
        """The last tick [ns]."""
        return self.wheels.time

    @property
    def clock_resets(self) -> int:
        """How often the clock was set back."""
        return self.wheels.clock_resets

    @property
    def angles(self) -> FloatArray:
        """How far every wheel has turned, modulo 2 pi [rad]: as measured last (joint_states), or since the start."""
        return np.array([self.wheels.motion.phase_of(index) for index in range(len(self.inputs))])

    # -- inputs ---------------------------------------------------------------------------------------------

    def joint_states(
        self,
        received: int,
        stamp: int,
        names: Sequence[str],
        velocities: Sequence[float],
        positions: Sequence[float] = (),
    ) -> None:
        """The spin [rad/s] and, where there is one per name, the angle [rad] of every wheel whose joint is named."""
        if len(velocities) != len(names):
            self.message_counts["no velocity"] += 1
            return
        known = self._places.get(tuple(names))
        if known is None:
            if len(self._places) >= 64:  # publishers repeat their names for ever
                self._places.clear()
            known = self._places[tuple(names)] = joint_places(self.settings.joint_names, names)
        angles = positions if len(positions) == len(names) else [math.nan] * len(names)
        for index, place, is_twice in known:
            if is_twice:
                self.wheels.count_joint_twice(index)
            self.wheels.add_speed(index, received, stamp, velocities[place], angles[place])

    def wheel_speed(self, index: int, received: int, speed: float) -> None:
        """The spin of one wheel [rad/s], as of its receipt."""
        self.wheels.add_speed(index, received, received, speed)

    def road_height(self, index: int, received: int, height: float) -> None:
        """The road's height under one wheel [m], as of its receipt."""
        self.wheels.add_height(index, received, received, height)

    def load(self, index: int, received: int, stamp: int, load: float, traction: float) -> None:
        """The contact force on one tire: vertical, up positive, and along x_ros [N]."""
        self.wheels.add_load(index, received, stamp, load, traction)

    # -- time -----------------------------------------------------------------------------------------------

    def tick(self, stamp: int) -> list[Output]:
        """Advance every wheel to the given time; one output for each that is in motion.

        A time before the last one means that the clock was set back: everything is forgotten, and the wheels
        start again from equilibrium with the inputs to come.

        Parameters
        ----------
        stamp : int
            [ns]
        """
        return [Output(*each) for each in self.wheels.tick(stamp)]

    def belts(self) -> list[Belt]:
        """The belts of wheels in motion that are due at the last tick and have not been asked for."""
        return [Belt(*each) for each in self.wheels.due_belts()]

    def snapshot(self) -> dict[str, Any]:
        """Everything that later outputs depend on, in JSON's types; :meth:`restore` continues from it bit for bit."""
        return self.wheels.snapshot()

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over the state of a :meth:`snapshot` of a vehicle with the same settings."""
        self.wheels.restore(snapshot)

    def stability(self, index: int, *, quick: bool = False) -> dict[str, Any]:
        """The stability reply for one wheel at its present speed; at standstill before there is a speed.

        Parameters
        ----------
        index : int
            Of the wheel.
        quick : bool
            Of a tire that is not uniform this takes some milliseconds, and longer the slower it turns. Whether to take
            the speed to 1 rad/s, and 20 rad/s for less, and to remember the reply.
        """
        name, speed = self.settings.wheels[index], self.inputs[index].speed
        if self.wheels.on_road:
            settings = self.settings
            n_max = modes_on_the_road(self.unit, settings.n_max)
            return stability_reply(name, self.unit, speed, settings.model, n_max, contact=True)
        if not quick or self.unit.is_uniform:
            return stability_reply(name, self.unit, speed, self.settings.model)
        if speed:
            speed = math.copysign(max(float(round(abs(speed))), 20.0), speed)
        return {**_remembered_reply(self.unit, speed, self.settings.model), "wheel": name}


def joint_places(joints: Sequence[str], names: Sequence[str]) -> list[tuple[int, int, bool]]:
    """Of every wheel whose joint is among some names: its index, the joint's first place, whether it is there twice."""
    names = list(names)
    return [
        (index, names.index(joint), names.count(joint) > 1) for index, joint in enumerate(joints) if joint in names
    ]


@lru_cache(maxsize=256)
def _remembered_reply(unit: TireWheelUnit, speed: float, model: wheel.Model) -> dict[str, Any]:
    return stability_reply("", unit, speed, model)


def modes_on_the_road(unit: TireWheelUnit, n_max: int) -> int:
    """The belt harmonics whose stability on the road is looked at: all, and of a varying sidewall's, coupled, five.

    Five take half a second at 20 rad/s, and the work grows as their cube.
    """
    return min(n_max, _MOST_VARYING) if on_road.is_varying(unit) else n_max


def stability_reply(
    name: str,
    unit: TireWheelUnit,
    speed: float,
    model: wheel.Model = "inextensional",
    n_max: int = 1,
    contact: bool = False,
) -> dict[str, Any]:
    """The Floquet stability of a unit at a speed [rad/s], as the service's JSON and the command have it.

    Parameters
    ----------
    name : str
        Of the wheel.
    unit : TireWheelUnit
    speed : float
        [rad/s]
    model : {"inextensional", "complete"}
    n_max : int
        Highest belt harmonic. On the road :func:`modes_on_the_road` says how many are looked at.
    contact : bool
        On the road, without lift-off, or under a given load.

    Returns
    -------
    dict
        The same keys in both states. The critical speed is the mean tire's; where the nearest tongue begins is not
        known on the road.
    """
    if contact:
        found = wheel.stability(unit, speed, model, contact=True, n_max=n_max)
        critical = wheel.critical_speed(unit.mean, model, contact=True, n_max=n_max)
        periodicity = "irreducible" if on_road.is_varying(unit) else "reducible"
        return _reply(name, speed, found, critical, n_max, contact=True, periodicity=periodicity, tongue=None)
    sidewall = nonuniform.Nonuniformity.of(unit)
    result = nonuniform.stability(unit, sidewall, speed, model, n_max)
    return _reply(
        name, speed, result, wheel.critical_speed(unit, model), n_max, contact=False,
        periodicity="irreducible" if nonuniform.is_irreducibly_periodic(unit, model, n_max) else "reducible",
        tongue=nonuniform.nearest_tongue(unit, sidewall, speed, model),
    )  # fmt: skip


def _reply(
    name: str,
    speed: float,
    result: FloquetResult,
    critical: float | None,
    n_max: int,
    *,
    contact: bool,
    periodicity: str,
    tongue: float | None,
) -> dict[str, Any]:
    multipliers = result.multipliers
    return {
        "wheel": name,
        "speed_rad_s": speed,
        "period_s": result.period,
        "verdict": result.verdict,
        "spectral_radius": result.spectral_radius,
        "multipliers": None if multipliers is None else [[mu.real, mu.imag] for mu in multipliers.tolist()],
        "exponents_1_s": [[value.real, value.imag] for value in result.exponents.tolist()],
        "critical_speed_rad_s": critical,
        "periodicity": periodicity,
        "nearest_tongue_rad_s": tongue,
        "contact": contact,
        "n_max": n_max,
    }
