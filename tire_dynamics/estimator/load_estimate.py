"""The loads on four wheels over a recording."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .load_filter import LoadFilter, SensorNoise
from .vehicle_parameters import VehicleParameters

__all__ = ["LoadEstimate", "estimate_loads"]

FloatArray = NDArray[np.float64]


class LoadEstimate(NamedTuple):
    """What :func:`estimate_loads` returns; wheels front left, front right, rear left, rear right.

    ``time`` (M,) is in seconds, ``load`` and ``standard_deviation`` (M, 4) in N: 95 % of the errors should be within
    two of them. ``band_hz`` is the frequency up to which the sources make the loads known, the lowest of any moment
    once each of them has come. NaN stands where there is no estimate.
    """

    time: FloatArray
    load: FloatArray
    standard_deviation: FloatArray
    band_hz: float


def estimate_loads(
    vehicle: VehicleParameters,
    imu: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
    travel: tuple[ArrayLike, ArrayLike] | None = None,
    hub: tuple[ArrayLike, ArrayLike] | None = None,
    wheel_speed: tuple[ArrayLike, ArrayLike] | None = None,
    *,
    at: ArrayLike | None = None,
    noise: SensorNoise | None = None,
) -> LoadEstimate:
    """Vertical loads of four tires from what the vehicle measured, each from what came before it.

    Every source may be None; each has times of its own [s], in any order. Wheels are front left, front right, rear
    left, rear right.

    Parameters
    ----------
    vehicle : VehicleParameters
    imu : (t, specific force, angular rate), optional
        (N,), (N, 3) [m/s^2], (N, 3) [rad/s] at the sprung mass's centre of gravity, REP 103 axes; at rest z is
        +9.80665.
    travel : (t, travel), optional
        (N,), (N, 4): compression of each spring from its position at rest [m].
    hub : (t, acceleration), optional
        (N,), (N, 4): vertical specific force of each unsprung mass [m/s^2], +9.80665 at rest.
    wheel_speed : (t, speed), optional
        (N,), (N, 4): spin [rad/s].
    at : array_like, shape (M,), optional
        Ascending times for which loads are wanted [s]. Without it, the times of the IMU, or else of the hubs, the
        travel or the wheel speeds.
    noise : SensorNoise, optional
        Of the sensors; its defaults are a car's usual ones.

    Returns
    -------
    LoadEstimate

    Raises
    ------
    ValueError
        There is no source, or one has arrays of the wrong shape or times that are not finite; it is named.

    Notes
    -----
    The samples go through :class:`~.load_filter.LoadFilter` one after the other, as in the live node: the same samples
    give the same bits.
    """
    given = {"wheel_speed": wheel_speed, "imu": imu, "travel": travel, "hub": hub}
    columns = {"wheel_speed": 4, "imu": 6, "travel": 4, "hub": 4}
    tables = {name: _table(name, source, columns[name]) for name, source in given.items() if source is not None}
    if not tables:
        raise ValueError("there is nothing to estimate loads from; give imu, travel, hub or wheel_speed")
    if at is None:
        main = next(name for name in ("imu", "hub", "travel", "wheel_speed") if name in tables)
        ticks = np.unique(tables[main][0])
    else:
        ticks = _stamps("at", np.asarray(at, dtype=np.float64))
        if (np.diff(ticks) < 0).any():
            raise ValueError("at does not ascend")
    car = LoadFilter(vehicle, noise)
    add = {
        "wheel_speed": car.add_wheel_speed,
        "imu": lambda stamp, values: car.add_imu(stamp, values[:3], values[3:]),
        "travel": car.add_travel,
        "hub": car.add_hub,
    }
    samples: list[tuple[int, int, str]] = []
    for name, (stamps, _) in tables.items():
        samples += [(stamp, row, name) for row, stamp in enumerate(stamps.tolist())]
    samples.sort(key=lambda sample: sample[0])
    rows = {name: values.tolist() for name, (_, values) in tables.items()}
    load = np.full((ticks.size, 4), math.nan)
    deviation = np.full((ticks.size, 4), math.nan)
    band, following = math.inf, 0
    for k, tick in enumerate(ticks.tolist()):
        while following < len(samples) and samples[following][0] <= tick:
            stamp, row, name = samples[following]
            add[name](stamp, rows[name][row])
            following += 1
        if car.advance(tick):
            load[k], deviation[k] = car.load, car.standard_deviation
        if all(sum(car.counts[name].values()) for name in tables):
            band = min(band, car.band_hz)
    time = ticks.astype(np.float64) * 1e-9
    return LoadEstimate(time, load, deviation, band if math.isfinite(band) else 0.0)


def _stamps(name: str, times: FloatArray) -> NDArray[np.int64]:
    """Times [s] in nanoseconds."""
    if times.ndim != 1 or not times.size:
        raise ValueError(f"the times of {name} have shape {times.shape}; they must be a list of numbers")
    if not (np.abs(times) < 9e9).all():
        worst = times[~(np.abs(times) < 9e9)][0]
        raise ValueError(f"a time of {name} is {worst!r}; it must be finite, and below 9e9 s")
    stamps: NDArray[np.int64] = np.rint(times * 1e9).astype(np.int64)
    return stamps


def _table(name: str, source: Any, columns: int) -> tuple[NDArray[np.int64], FloatArray]:
    parts = ("t", "specific_force", "angular_rate") if name == "imu" else ("t", name)
    if not isinstance(source, (tuple, list)) or len(source) != len(parts):
        raise ValueError(f"{name} must be ({', '.join(parts)})")
    stamps = _stamps(name, np.asarray(source[0], dtype=np.float64))
    values = []
    width = columns // (len(parts) - 1)
    for part, given in zip(parts[1:], source[1:], strict=True):
        array = np.asarray(given, dtype=np.float64)
        if array.shape != (stamps.size, width):
            wanted = (stamps.size, width)
            raise ValueError(f"{part} of {name} has shape {array.shape}; with {stamps.size} times it must be {wanted}")
        values.append(array)
    return stamps, np.concatenate(values, axis=1)
