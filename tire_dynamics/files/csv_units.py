"""How CSV files spell units of time, speed and load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

__all__ = ["TIME_UNITS", "is_known_unit", "is_unit", "unit_named"]

TIME_UNITS: Final = {"s": 9, "ms": 6, "us": 3, "ns": 0}  # decimal places of the unit in ns

_SPELLINGS: Final[Mapping[str, Mapping[str, Sequence[str]]]] = {
    "time": {
        "s": ("s", "sec", "secs", "second", "seconds"),
        "ms": ("ms", "msec", "millisecond", "milliseconds"),
        "us": ("us", "usec", "µs", "μs", "microsecond", "microseconds"),
        "ns": ("ns", "nsec", "nanosecond", "nanoseconds"),
    },
    "speed": {
        "rad/s": ("rad/s", "rad/sec", "radian/s", "radians/s", "radian/sec", "radians/sec", "rad_s"),
        "rpm": ("rpm", "1/min", "r/min", "rev/min", "min-1", "u/min"),
        "rev/s": ("rev/s", "1/s", "hz", "rps", "r/s"),
        "deg/s": ("deg/s", "°/s", "degree/s", "degrees/s", "deg/sec", "deg_s"),
        "m/s": ("m/s", "mps", "m/sec", "meter/s", "m_s"),
        "km/h": ("km/h", "kph", "kmh", "kmph", "km/hr"),
        "mph": ("mph", "mi/h", "mile/h", "miles/h"),
    },
    "load": {
        "N": ("n", "newton", "newtons"),
        "kN": ("kn", "kilonewton", "kilonewtons"),
        "daN": ("dan",),
        "lbf": ("lbf", "lb", "lbs", "pound_force"),
        "kgf": ("kgf", "kg", "kp"),
        "m/s^2": ("m/s^2", "m/s2", "m/s²", "m/s/s", "m/sec^2", "m_s2", "ms2"),
        "g": ("g", "gee", "gs"),
    },
}
_UNIT_OF: Final = {
    quantity: {spelling: unit for unit, spellings in units.items() for spelling in spellings}
    for quantity, units in _SPELLINGS.items()
}
_OTHERS = frozenset("v mv a ma % bar kpa psi °c degc deg ° rad m mm km nm w kw".split())


def unit_named(quantity: str, text: str) -> str | None:
    """The unit of "time", "speed" or "load" that a text is a spelling of."""
    return _UNIT_OF[quantity].get(text.strip().strip("[]()").strip().lower())


def is_unit(text: str) -> bool:
    """Whether a text is a spelling of any unit that is known here."""
    return text.strip().lower() in _OTHERS or is_known_unit(text)


def is_known_unit(text: str) -> bool:
    """Whether a text is a spelling of a unit of time, speed or load."""
    return any(unit_named(quantity, text) for quantity in _UNIT_OF)
