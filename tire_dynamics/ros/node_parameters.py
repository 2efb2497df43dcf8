"""The table of parameters as the parameters of an rclpy node."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from ..replay.parameters import PARAMETERS, Parameter, complete

__all__ = ["ROWS", "changed", "declare", "declare_loosely", "given", "whole"]

ROWS = {row.name: row for row in PARAMETERS}
"""The rows of the table by their names."""

_TYPES = {
    "boolean": RosParameter.Type.BOOL,
    "double": RosParameter.Type.DOUBLE,
    "double[]": RosParameter.Type.DOUBLE_ARRAY,
    "double | double[]": RosParameter.Type.DOUBLE_ARRAY,
    "integer": RosParameter.Type.INTEGER,
    "string": RosParameter.Type.STRING,
    "string[]": RosParameter.Type.STRING_ARRAY,
    "string | string[]": RosParameter.Type.STRING_ARRAY,
}


def given(node: Node) -> dict[str, Any]:
    """Values of the node's parameters, in the types of the table; without those that every node has."""
    found: dict[str, RosParameter] = node.get_parameters_by_prefix("")
    return {
        name: _plain(parameter.value)
        for name, parameter in found.items()
        if parameter.value is not None and not _is_rclpys(name)
    }


def changed(changes: Iterable[RosParameter]) -> dict[str, Any]:
    """Values of those parameters among some that are in the table."""
    return {change.name: _plain(change.value) for change in changes if change.name in ROWS}


def whole(node: Node) -> dict[str, Any]:
    """All parameters, checked; ``ValueError`` as :func:`~tire_dynamics.replay.parameters.complete` raises it."""
    values = given(node)
    complete({**values, **dict.fromkeys(name for name in values if name not in ROWS)})
    return complete(values)


def declare(node: Node, values: Mapping[str, Any], *, read_only: bool) -> None:
    """Declare every parameter with its type and range, and read-only if it is and ``read_only`` says so."""
    for name, row in ROWS.items():
        _declare(node, name, values[name], _descriptor(row, read_only, values[name]))


def declare_loosely(node: Node) -> None:
    """Declare every parameter with what it has, such that it takes any value: nothing is checked yet."""
    values = given(node)
    for name in {**ROWS, **values}:
        row = ROWS.get(name)
        value = values.get(name, row.default if row else None)
        descriptor = ParameterDescriptor(description=row.description if row else "", dynamic_typing=True)
        _declare(node, name, value, descriptor)


def _declare(node: Node, name: str, value: Any, descriptor: ParameterDescriptor) -> None:
    if node.has_parameter(name):
        if node.describe_parameter(name).read_only:
            return  # it is what it was when it was declared, and cannot be taken back
        node.undeclare_parameter(name)
    value = (list(value) or None) if isinstance(value, tuple) else value  # rclpy takes an empty list for one of bytes
    node.declare_parameter(name, value, descriptor, ignore_override=True)


def _is_rclpys(name: str) -> bool:
    """Whether a parameter belongs to every node and not to the table."""
    return name in ("use_sim_time", "start_type_description_service") or name.startswith("qos_overrides.")


def _plain(value: Any) -> Any:
    return list(value) if not isinstance(value, (str, bytes, bool, int, float)) and value is not None else value


def _descriptor(row: Parameter, read_only: bool, value: Any) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        name=row.name,
        type=_TYPES[row.kind].value,
        description=row.description,
        read_only=row.read_only and read_only,
        additional_constraints=" | ".join(row.choices),
        # it may be empty; our own check knows its type
        dynamic_typing="|" in row.kind or row.kind == "double[]" and (not row.read_only or not value),
    )
    low = row.low if row.low is not None else math.ulp(0.0) if row.positive else None
    if low is not None:
        high = row.high if row.high is not None else float("1e300")
        if row.kind == "double":
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return descriptor
