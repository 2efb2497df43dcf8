"""The fields of a unit as a YAML file, such as ``config/table_1.yaml``."""

from __future__ import annotations

from os import PathLike

from ..science.unit import TireWheelUnit
from .yaml_file import read_yaml, yaml_value

__all__ = ["read_unit", "write_unit"]


def read_unit(path: str | PathLike[str]) -> TireWheelUnit:
    """A unit from a YAML file of field names and values.

    Parameters
    ----------
    path : path

    Returns
    -------
    TireWheelUnit

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is not such a mapping, or a field is unknown, missing or out of bounds.
    """
    return TireWheelUnit.from_mapping(read_yaml(path))


def write_unit(unit: TireWheelUnit, path: str | PathLike[str]) -> None:
    """Write the fields of a unit such that :func:`read_unit` gives an equal one.

    Parameters
    ----------
    unit : TireWheelUnit
    path : path
        What is there already is replaced.
    """
    with open(path, "w", encoding="utf-8") as file:
        for name, value in unit.to_mapping().items():
            file.write(f"{name}: {yaml_value(value)}\n")
