"""The compiled loops, ready before they are needed: where Numba has not yet kept them on disk, that takes a while."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..estimator.motion import fastest_kernels
from ..estimator.vehicle import Events, Vehicle, VehicleSettings
from ..science import kernels
from ..science.unit import TireWheelUnit

__all__ = ["compile_kernels"]


def compile_kernels(stopping: Callable[[], bool] = lambda: False) -> None:
    """Run every loop once, so that none is compiled beside turning wheels.

    Half a second, and some twenty the first time after an installation; nothing where Numba is not installed.

    Parameters
    ----------
    stopping : callable
        Asked between two loops; whether to leave it.
    """
    if fastest_kernels() is kernels:
        return
    tire = TireWheelUnit.table_1()
    vehicle = Vehicle(VehicleSettings(unit=tire, ring_samples=3, n_max=2, ring_period=2_000_000))
    for tick in range(1, 4):
        if tick == 3:
            vehicle.set_unit(tire.replace(imbalance_mass=0.01))
        stamp = tick * 2_000_000
        vehicle.wheel_speed(0, stamp, 10.0 + tick)
        vehicle.load(0, stamp, stamp, 1000.0, 0.0)
        vehicle.tick(stamp)
        if stopping():
            return
        vehicle.belts()
        if stopping():
            return
    vehicle.set_unit(tire)
    ticks, none = np.arange(4, 7) * 2_000_000, np.empty(0, np.int64)
    speeds = [(np.zeros(1, np.int64), ticks[:1], np.array([20.0]))]
    vehicle.drive(Events(np.arange(1, 4), ticks, [], speeds, [(none, none, none, np.empty((0, 2)))]))
