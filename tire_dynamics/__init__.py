"""Real-time rotating-ring tire dynamics: what the tires do to the axles, and whether they are stable.

The public names are loaded on first use, so that importing the package costs nothing and never touches ROS.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .estimator.load_estimate import LoadEstimate, estimate_loads
    from .estimator.load_filter import LoadFilter, SensorNoise
    from .estimator.simulate import Response, simulate
    from .estimator.vehicle_parameters import VehicleParameters
    from .files.tir_unit import read_tir_unit
    from .files.unit_file import read_unit, write_unit
    from .files.vehicle_file import read_vehicle
    from .science import floquet, ring, wheel
    from .science.unit import TireWheelUnit

__version__ = "0.1.0"
__all__ = [
    "LoadEstimate",
    "LoadFilter",
    "Response",
    "SensorNoise",
    "TireWheelUnit",
    "VehicleParameters",
    "estimate_loads",
    "floquet",
    "read_tir_unit",
    "read_unit",
    "read_vehicle",
    "ring",
    "simulate",
    "wheel",
    "write_unit",
]

_HOMES = {
    "TireWheelUnit": ".science.unit",
    "Response": ".estimator.simulate",
    "simulate": ".estimator.simulate",
    "LoadEstimate": ".estimator.load_estimate",
    "LoadFilter": ".estimator.load_filter",
    "SensorNoise": ".estimator.load_filter",
    "VehicleParameters": ".estimator.vehicle_parameters",
    "estimate_loads": ".estimator.load_estimate",
    "read_tir_unit": ".files.tir_unit",
    "read_unit": ".files.unit_file",
    "read_vehicle": ".files.vehicle_file",
    "write_unit": ".files.unit_file",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(import_module(_HOMES[name], __name__), name)
    elif name in __all__:
        value = import_module(f".science.{name}", __name__)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
