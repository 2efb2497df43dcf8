"""What the load estimate must know of a car."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any, Final, cast

__all__ = ["VehicleParameters"]

GRAVITY: Final = 9.80665  # standard gravity [m/s^2]
WHEEL_HOP: Final = 2.0 * math.pi * 12.0  # of a car whose tires' rate is not given [rad/s]: 10 to 15 Hz is usual

Pair = tuple[float, float]
Four = tuple[float, float, float, float]


def _field(unit: str, meaning: str, count: int = 1, bound: str = "> 0", default: Any = dataclasses.MISSING) -> Any:
    metadata = {"unit": unit, "meaning": meaning, "count": count, "bound": bound}
    return dataclasses.field(default=default, metadata=metadata)


@dataclass(frozen=True)
class VehicleParameters:
    """A car with four wheels, as the load estimate knows it; lists are front left, front right, rear left, rear right.

    Parameters
    ----------
    sprung_mass : float
        What the springs carry, people and luggage with it [kg].
    unsprung_masses : sequence of 4 floats
        What moves with each wheel: wheel, tire, hub, brake, half of the links [kg].
    wheelbase : float
        [m]
    front_axle_to_cg : float
        From the front axle back to the centre of gravity of the sprung mass [m].
    tracks : sequence of 2 floats
        Front and rear [m].
    cg_height : float
        Of the sprung mass's centre of gravity above the road [m].
    unsprung_height : float
        Of the unsprung masses' above the road [m].
    roll_inertia, pitch_inertia : float
        Of the sprung mass about its centre of gravity [kg m^2].
    roll_centre_heights : sequence of 2 floats
        Front and rear, above the road [m]; may be negative.
    spring_rates : sequence of 4 floats
        At the wheel: force over the wheel's way [N/m].
    damper_bump, damper_rebound : sequence of 4 floats
        Slopes at the wheel, in compression and in extension [N s/m].
    anti_roll_rates : sequence of 2 floats
        Front and rear: force of the bar at both wheels together over the difference of their ways [N/m]. Each wheel
        feels half of it. 0 where there is none.
    tire_rates : sequence of 4 floats, optional
        Vertical [N/m]. Without them, what gives a wheel hop of 12 Hz on the springs above.
    rolling_radius : float, optional
        From wheel speeds to the car's speed [m].

    Raises
    ------
    ValueError
        A field is no number or no list of the right length, or out of bounds; it is named with its bound.
    """

    sprung_mass: float = _field("kg", "mass on the springs")
    unsprung_masses: Four = _field("kg", "mass that moves with each wheel", 4)
    wheelbase: float = _field("m", "distance between the axles")
    front_axle_to_cg: float = _field("m", "distance from the front axle back to the centre of gravity")
    tracks: Pair = _field("m", "track, front and rear", 2)
    cg_height: float = _field("m", "height of the sprung mass's centre of gravity")
    unsprung_height: float = _field("m", "height of the unsprung masses' centre of gravity", bound=">= 0")
    roll_inertia: float = _field("kg m^2", "roll inertia of the sprung mass")
    pitch_inertia: float = _field("kg m^2", "pitch inertia of the sprung mass")
    roll_centre_heights: Pair = _field("m", "roll centre heights, front and rear", 2, "finite")
    spring_rates: Four = _field("N/m", "spring rate at each wheel", 4)
    damper_bump: Four = _field("N s/m", "damping at each wheel, in compression", 4, ">= 0")
    damper_rebound: Four = _field("N s/m", "damping at each wheel, in extension", 4, ">= 0")
    anti_roll_rates: Pair = _field("N/m", "anti-roll rate, force over difference of travel, front and rear", 2, ">= 0")
    tire_rates: tuple[float, ...] = _field("N/m", "vertical stiffness of each tire", 4, default=())
    rolling_radius: float = _field("m", "rolling radius, from wheel speeds to the car's speed", default=0.31)

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name == "tire_rates" and _is_list(value) and not len(value):
                continue
            object.__setattr__(self, field.name, _checked(field, value))
        if self.front_axle_to_cg >= self.wheelbase:
            raise ValueError(
                f"front_axle_to_cg is {self.front_axle_to_cg!r}; it must be < wheelbase = {self.wheelbase!r}"
            )
        if max(self.roll_centre_heights) >= self.cg_height:
            raise ValueError(
                f"roll_centre_heights are {list(self.roll_centre_heights)!r}; each must be < cg_height = "
                f"{self.cg_height!r}"
            )
        if not self.tire_rates:
            given = zip(self.unsprung_masses, self.spring_rates, strict=True)
            rates = tuple(max(mass * WHEEL_HOP * WHEEL_HOP - rate, rate) for mass, rate in given)
            object.__setattr__(self, "tire_rates", rates)

    @property
    def static_loads(self) -> Four:
        """Load of each tire on level ground at rest [N]."""
        behind = self.wheelbase - self.front_axle_to_cg
        shares = (behind, behind, self.front_axle_to_cg, self.front_axle_to_cg)
        first, second, third, fourth = (
            (self.sprung_mass * share / self.wheelbase / 2.0 + mass) * GRAVITY
            for share, mass in zip(shares, self.unsprung_masses, strict=True)
        )
        return first, second, third, fourth

    @property
    def hop_frequencies(self) -> Four:
        """At which each wheel hops between its spring and its tire [Hz]."""
        masses = zip(self.unsprung_masses, self.spring_rates, self.tire_rates, strict=True)
        found = [math.sqrt((spring + tire) / mass) / (2.0 * math.pi) for mass, spring, tire in masses]
        return found[0], found[1], found[2], found[3]

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> VehicleParameters:
        """A car from field names and values.

        Parameters
        ----------
        mapping : mapping

        Raises
        ------
        ValueError
            A field is unknown or out of bounds, or some are missing: all of these are listed, with their units.
        """
        fields = {field.name: field for field in dataclasses.fields(cls)}
        for name in mapping:
            if name not in fields:
                raise ValueError(f"{name!r} is no parameter of a vehicle; the parameters are {', '.join(fields)}")
        missing = [f for name, f in fields.items() if name not in mapping and f.default is dataclasses.MISSING]
        if missing:
            raise ValueError(
                "the load estimate needs to know more of the vehicle; missing: " + ", ".join(map(_described, missing))
            )
        return cls(**mapping)

    @classmethod
    def from_yaml(cls, path: Any) -> VehicleParameters:
        """A car from a YAML file, as :func:`tire_dynamics.read_vehicle` reads it."""
        return cast(VehicleParameters, __import__(__name__.partition(".")[0]).read_vehicle(path))

    def to_mapping(self) -> dict[str, Any]:
        """Field names and values, lists as lists."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}


def _is_list(value: Any) -> bool:
    return hasattr(value, "__len__") and hasattr(value, "__iter__") and not isinstance(value, (str, bytes, Mapping))


def _described(field: dataclasses.Field[Any]) -> str:
    count = field.metadata["count"]
    unit = field.metadata["unit"]
    return f"{field.name} [{unit if count == 1 else f'{count} x {unit}'}]"


def _checked(field: dataclasses.Field[Any], value: Any) -> Any:
    count = field.metadata["count"]
    if count == 1:
        return _number(field, value, field.name)
    if not _is_list(value) or len(value) != count:
        order = "front left, front right, rear left, rear right" if count == 4 else "front, rear"
        raise ValueError(f"{field.name} is {value!r}; it must be a list of {count} numbers: {order}")
    return tuple(_number(field, each, f"{field.name}[{k}]") for k, each in enumerate(value))


def _number(field: dataclasses.Field[Any], value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ValueError(f"{name} is {value!r}; it must be a number")
    try:
        number = float(value) + 0.0
    except OverflowError:
        number = math.inf
    bound = field.metadata["bound"]
    if not 1e-6 <= abs(number) <= 1e9 and number != 0.0 or not math.isfinite(number):
        raise ValueError(f"{name} is {number!r}; no vehicle has that: its size must be between 1e-06 and 1e+09")
    if bound == "> 0" and number <= 0.0 or bound == ">= 0" and number < 0.0:
        raise ValueError(f"{name} is {number!r}; it must be {bound}")
    return number
