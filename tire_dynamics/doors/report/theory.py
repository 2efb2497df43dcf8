"""What the model says about a tire, as arrays for the report's charts. Speeds in rad/s, frequencies in Hz."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...science import wheel
from ...science.floquet import VERDICTS, Verdict
from ...science.maps import StabilityMap
from ...science.modes import RingModes
from ...science.response import frequency_response
from ...science.unit import TireWheelUnit
from ..figures.tables import WHEEL_MODES, wave_exponents, wheel_exponents

__all__ = [
    "CAMPBELL_WAVES",
    "Campbell",
    "campbell",
    "load_to_force",
    "response_range",
    "stability_around",
    "steady",
    "verdict_of",
]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

CAMPBELL_WAVES = (2, 3)
RPM = math.pi / 30.0


def load_to_force(
    unit: TireWheelUnit, speed: FloatArray | float, frequency: FloatArray, model: wheel.Model = "inextensional"
) -> ComplexArray:
    """Vertical axle force over vertical load at constant speeds (...), shape (..., N); NaN if it has no bound."""
    try:
        return frequency_response(unit, speed, frequency, model)[..., 1, 0]
    except ValueError:  # undamped, and at a resonance
        return np.full((*np.shape(speed), frequency.size), math.nan + 0j)


def steady(unit: TireWheelUnit, speed: float, model: wheel.Model = "inextensional") -> float:
    """K = F'/F of a constant load: the closed form where it holds, else :func:`load_to_force` at 0 Hz."""
    if model == "inextensional" and unit.contact_half_angle == 0.0:
        return float(wheel.transmissibility(unit, speed))
    return float(np.abs(load_to_force(unit, speed, np.zeros(1), model))[0])


def response_range(
    unit: TireWheelUnit, low: float, high: float, frequency: FloatArray, model: wheel.Model = "inextensional"
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest modulus of :func:`load_to_force` at 17 speeds from low to high; shapes (N,)."""
    gain = np.abs(load_to_force(unit, np.linspace(low, high, 17), frequency, model))
    return gain.min(axis=0), gain.max(axis=0)


def verdict_of(
    unit: TireWheelUnit, speeds: Iterable[float], model: wheel.Model = "inextensional"
) -> tuple[Verdict, list[float]]:
    """The worst verdict at some speeds, and the speeds at which it is "unstable"."""
    each = {speed: wheel.stability(unit, speed, model).verdict for speed in speeds}
    worst = max(each.values(), key=VERDICTS.index, default=VERDICTS[0])
    return worst, [speed for speed, verdict in each.items() if verdict == "unstable"]


class Campbell(NamedTuple):
    """Frequencies [Hz] and decay rates [1/s] seen from the axle, over speeds (S,): arrays (S,) by the motion's name."""

    speed: FloatArray
    frequency: dict[str, FloatArray]
    decay: dict[str, FloatArray]


def campbell(unit: TireWheelUnit, highest: float, model: wheel.Model = "inextensional") -> Campbell:
    """Ring and wheel (n = 1) and the waves of ``CAMPBELL_WAVES``, from standstill to a speed."""
    speeds = np.linspace(0.0, highest, 161)
    exponents = {}
    rigid = np.array([wheel_exponents(unit, speed, model)[: len(WHEEL_MODES)] for speed in speeds.tolist()])
    for mode, column in zip(WHEEL_MODES, rigid.T, strict=False):
        exponents[mode] = column
    modes = RingModes(unit, CAMPBELL_WAVES, model)
    waves = np.array([wave_exponents(modes, speed) for speed in speeds.tolist()])
    for n, both in zip(CAMPBELL_WAVES, np.moveaxis(waves, 0, 2), strict=True):
        for direction, column in zip(("backward", "forward"), both, strict=True):
            exponents[f"n_{n}_{direction}"] = column
    frequency = {name: np.abs(column.imag) / (2.0 * math.pi) for name, column in exponents.items()}
    return Campbell(speeds, frequency, {name: -column.real for name, column in exponents.items()})


def stability_around(
    unit: TireWheelUnit, highest: float, model: wheel.Model = "inextensional"
) -> tuple[StabilityMap, float | None]:
    """A map over speed and zeta_1 around a unit and the highest speed driven, and its critical speed [rad/s]."""
    critical = wheel.critical_speed(unit, model)
    top = max(2.5 * highest, 3.0 * (critical or 0.0), 3000.0 * RPM)
    speeds = np.geomspace(60.0 * RPM, top, 140)
    damping = np.linspace(0.005, max(0.25, min(0.95, 2.0 * unit.zeta_1)), 70)
    return wheel.stability_map(unit, ("speed", speeds), ("zeta_1", damping), model=model), critical
