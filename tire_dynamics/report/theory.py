"""What the model says about a tire, as arrays for the report's charts. Speeds in rad/s, frequencies in Hz.

Of a tire that is not uniform all but the verdict is its mean's. On the road, without lift-off, where a highest belt
harmonic is given.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..files.errors import InputError
from ..science import uncertainty, wheel
from ..science.axle_variance import axle_force_covariance
from ..science.campbell import campbell_exponents, contact_modes, jumps
from ..science.contact_points import ContactPoints
from ..science.floquet import VERDICTS, Verdict
from ..science.maps import StabilityMap
from ..science.response import frequency_response
from ..science.unit import TireWheelUnit

__all__ = [
    "DIAGRAM_MODES",
    "CAMPBELL_WAVES",
    "Bands",
    "Campbell",
    "Errors",
    "bands",
    "campbell",
    "deviation_of_force",
    "load_to_force",
    "response_range",
    "road_to_force",
    "stability_around",
    "steady",
    "verdict_of",
]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

Range = tuple[FloatArray, FloatArray]

CAMPBELL_WAVES = (2, 3)
DIAGRAM_MODES = 15  # belt harmonics of diagram and map on the road, at most: 30 move the critical speed by 0.1 %
RPM = math.pi / 30.0


def load_to_force(
    unit: TireWheelUnit, speed: FloatArray | float, frequency: FloatArray, model: wheel.Model = "inextensional"
) -> ComplexArray:
    """Vertical axle force over vertical load at constant speeds (...), shape (..., N); NaN if it has no bound."""
    try:
        return frequency_response(unit, speed, frequency, model)[..., 1, 0]
    except ValueError:  # undamped, and at a resonance
        return np.full((*np.shape(speed), frequency.size), math.nan + 0j)


def deviation_of_force(unit: TireWheelUnit, speed: float, hop_hz: float, model: wheel.Model = "inextensional") -> float:
    """Standard deviation of the axle's force z per one of an estimated load, as ``axle_wrench_covariance`` has it.

    NaN where the unit is not stable.
    """
    return math.sqrt(float(axle_force_covariance(unit, speed, hop_hz, model)[1, 1]))


def road_to_force(
    unit: TireWheelUnit,
    speed: FloatArray | float,
    frequency: FloatArray,
    model: wheel.Model = "inextensional",
    n_max: int = 30,
    points: int = 1,
) -> ComplexArray:
    """Vertical axle force per metre of road at constant speeds (...), shape (..., N); NaN if it has no bound.

    With several points the height is that under the foremost one, and each has it when the wheel has brought it there:
    the response of one patch times the mean of the delays. That is right where waves are longer than the patch; the
    belt itself evens out shorter ones.
    """
    try:
        response = frequency_response(unit, speed, frequency, model, input="road", n_max=n_max)[..., 1, 0]
    except ValueError:
        return np.full((*np.shape(speed), frequency.size), math.nan + 0j)
    if points > 1:
        places = ContactPoints(unit.mean, points, model, n_max)
        edge = math.sin(float(places.angles.max()))
        spin = np.abs(np.asarray(speed, dtype=np.float64))[..., None]
        felt = np.zeros(np.broadcast_shapes(spin.shape, frequency.shape), dtype=np.complex128)
        for angle, share in zip(places.angles.tolist(), places.share.tolist(), strict=True):
            behind = np.divide(edge - math.sin(angle), spin, out=np.zeros_like(spin), where=spin > 0.0)
            felt += share * np.exp(-2j * math.pi * frequency * behind)
        response = response * felt
    return response


def steady(unit: TireWheelUnit, speed: FloatArray | float, model: wheel.Model = "inextensional") -> Any:
    """K = F'/F of a constant load at speeds: the closed form where it holds, else :func:`load_to_force` at 0 Hz."""
    if model == "inextensional" and unit.contact_half_angle == 0.0:
        return wheel.transmissibility(unit, speed)
    return np.abs(load_to_force(unit, speed, np.zeros(1), model))[..., 0]


def response_range(response: Callable[[FloatArray], ComplexArray], low: float, high: float) -> Range:
    """Least and greatest modulus of a response of speeds at 17 speeds from low to high; shapes (N,)."""
    gain = np.abs(response(np.linspace(low, high, 17)))
    return gain.min(axis=0), gain.max(axis=0)


class Errors(NamedTuple):
    """Standard errors of a unit's parameters, as ``science.uncertainty.sample`` takes them."""

    errors: dict[str, float]
    correlation: FloatArray | None
    samples: int
    seed: int


class Bands(NamedTuple):
    """What 5, 50 and 95 % of samples of a tire lie below; ``whole`` has the critical speed [rad/s].

    ``steady`` is K at the speeds asked for, (3, S); ``response`` the modulus of the response at the wheels' mean speeds
    and the frequencies, (3, W, N).
    """

    whole: uncertainty.Bands
    speed: FloatArray
    steady: FloatArray
    frequency: FloatArray
    response: FloatArray


def bands(
    unit: TireWheelUnit,
    known: Errors,
    highest: float,
    speed: FloatArray,
    means: FloatArray,
    frequency: FloatArray,
    model: wheel.Model = "inextensional",
) -> Bands:
    """What errors of the parameters do, up to the highest speed driven; ``InputError`` if they are none."""
    unit = unit.mean
    options: Any = {"samples": known.samples, "seed": known.seed}
    try:
        whole = uncertainty.bands(unit, highest, known.errors, known.correlation, model=model, **options)
        units = uncertainty.sample(unit, known.errors, known.correlation, **options)
    except (ArithmeticError, ValueError) as error:
        raise InputError(str(error)) from None
    K = np.array([steady(each, speed, model) for each in units])
    gain = np.array([np.abs(load_to_force(each, means, frequency, model)) for each in units])
    quantiles = [np.quantile(each, uncertainty.SHARES, axis=0) for each in (K, gain)]
    return Bands(whole, speed, quantiles[0], frequency, quantiles[1])


def verdict_of(
    unit: TireWheelUnit, speeds: Iterable[float], model: wheel.Model = "inextensional", contact: int | None = None
) -> tuple[Verdict, list[float]]:
    """The worst verdict at some speeds, and the speeds at which it is "unstable".

    With ``contact``, the highest harmonic, of the mean tire on the road.
    """
    each = {speed: _verdict(unit, speed, model, contact) for speed in speeds}
    worst = max(each.values(), key=VERDICTS.index, default=VERDICTS[0])
    return worst, [speed for speed, verdict in each.items() if verdict == "unstable"]


@lru_cache(maxsize=4096)
def _verdict(unit: TireWheelUnit, speed: float, model: wheel.Model, contact: int | None) -> Verdict:
    if contact is not None:
        return wheel.stability(unit.mean, speed, model, contact=True, n_max=contact).verdict
    if not unit.is_uniform:
        speed = max(abs(speed), 20.0)  # as wheel.is_unstable has it: slower takes long, and tells no more
    return wheel.stability(unit, speed, model).verdict


class Campbell(NamedTuple):
    """Frequencies [Hz] and decay rates [1/s] seen from the axle, over speeds (S,): arrays (S,) by the motion's name.

    A motion is NaN where it is none, on the road, and after each place where its name goes over to another mode.
    ``every`` has frequencies and decay rates of all modes there (S, K).
    """

    speed: FloatArray
    frequency: dict[str, FloatArray]
    decay: dict[str, FloatArray]
    every: tuple[FloatArray, FloatArray] | None


def campbell(
    unit: TireWheelUnit, highest: float, model: wheel.Model = "inextensional", n_max: int | None = None
) -> Campbell:
    """Ring and wheel (n = 1) and the waves of ``CAMPBELL_WAVES``, from standstill to a speed."""
    speeds = np.linspace(0.0, highest, 161)
    every, modes = None, None
    numbers: tuple[int, ...] = CAMPBELL_WAVES
    if n_max is not None:
        n_max = min(n_max, DIAGRAM_MODES)
        modes = contact_modes(unit, speeds, model, n_max)
        every = modes.exponents.imag / (2.0 * math.pi), -modes.exponents.real
        numbers = tuple(n for n in CAMPBELL_WAVES if n <= n_max)
    contact: Any = {} if modes is None else {"contact": modes, "n_max": n_max}
    wheel_modes, waves = campbell_exponents(unit, speeds, numbers, model, **contact)
    exponents = wheel_modes | {f"n_{n}_{wave}": column for (n, wave), column in waves.items()}
    frequency = {name: np.abs(column.imag) / (2.0 * math.pi) for name, column in exponents.items()}
    decay = {name: -column.real for name, column in exponents.items()}
    if modes is not None:
        for name in frequency:
            number = int(name.split("_")[1]) if name.startswith("n_") else 1
            broken = np.append(jumps(speeds, frequency[name], number), False)
            frequency[name], decay[name] = (np.where(broken, math.nan, some[name]) for some in (frequency, decay))
    return Campbell(speeds, frequency, decay, every)


def stability_around(
    unit: TireWheelUnit, highest: float, model: wheel.Model = "inextensional", n_max: int | None = None
) -> tuple[StabilityMap, float | None]:
    """A map over speed and zeta_1 around a unit and the highest speed driven, and its critical speed [rad/s]."""
    unit = unit.mean
    contact: Any = {} if n_max is None else {"contact": True, "n_max": n_max}
    critical = wheel.critical_speed(unit, model, **contact)
    top = max(2.5 * highest, 3.0 * (critical or 0.0), 3000.0 * RPM)
    points = (140, 70) if n_max is None else (64, 32)  # on the road each takes 1.5 ms
    speeds = np.geomspace(60.0 * RPM, top, points[0])
    damping = np.linspace(0.005, max(0.25, min(0.95, 2.0 * unit.zeta_1)), points[1])
    if n_max is not None:
        contact["n_max"] = min(n_max, DIAGRAM_MODES)
    return wheel.stability_map(unit, ("speed", speeds), ("zeta_1", damping), model=model, **contact), critical
