"""What the load estimate must know of a car, as a YAML file such as ``config/car.yaml``."""

from __future__ import annotations

from os import PathLike

from ..estimator.vehicle_parameters import VehicleParameters
from .yaml_file import read_yaml

__all__ = ["read_vehicle"]


def read_vehicle(path: str | PathLike[str]) -> VehicleParameters:
    """A car from a YAML file of field names and values.

    Parameters
    ----------
    path : path

    Returns
    -------
    VehicleParameters

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is not such a mapping, or a field is unknown, missing or out of bounds.
    """
    return VehicleParameters.from_mapping(read_yaml(path))
