"""The table of parameters as the parameters of an rclpy node."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from ..replay.parameters import PARAMETERS, Parameter, complete, is_of_every_node, unit_of

__all__ = ["ROWS", "changed", "check", "declare", "declare_free", "given", "is_in_force", "meant", "whole"]

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
_NULL = ("null", "~", "None")  # YAML's, of which rcl makes texts; rclpy's parameter client writes the last


def given(node: Node) -> dict[str, Any]:
    """Values of the node's parameters, in the types of the table; without those that every node has.

    Null is left out: it is the default.
    """
    found: dict[str, RosParameter] = node.get_parameters_by_prefix("")
    values = {name: _plain(parameter.value) for name, parameter in found.items() if not is_of_every_node(name)}
    return {name: _as_chosen(name, value) for name, value in values.items() if value is not None}


def changed(changes: Iterable[RosParameter]) -> dict[str, Any]:
    """Values of those parameters among some that are in the table."""
    return {change.name: _plain(change.value) for change in changes if change.name in ROWS}


def meant(changes: Iterable[RosParameter]) -> list[RosParameter]:
    """Changes with the types of the table: an empty list has none of its own, and null is the default."""
    return [_typed(change.name, _meant(change)) if change.name in ROWS else change for change in changes]


def is_in_force(node: Node, wanted: Mapping[str, Any], change: RosParameter) -> bool:
    """Whether a parameter that cannot be set is what it is to be set to.

    Parameters
    ----------
    node : Node
    wanted : mapping
        All values of the table that are in force or soon to be.
    change : rclpy.parameter.Parameter
        As :func:`meant` returns it.
    """
    if not node.has_parameter(change.name):
        return False
    row = ROWS.get(change.name)
    if row is None:
        is_fixed = bool(node.describe_parameter(change.name).read_only)
        return is_fixed and bool(node.get_parameter(change.name).value == change.value)
    try:
        value = row.check(_plain(change.value))
        if value == wanted[row.name]:
            return True
        return row.read_only and complete({**wanted, row.name: value})[row.name] == wanted[row.name]
    except ValueError:
        return False


def check(node: Node, values: Mapping[str, Any]) -> None:
    """Check each of some values by its row, and the tire as a whole; ``ValueError`` says what is wrong.

    Nothing else is checked of one against another: they may be set one after the other.
    """
    for name, value in values.items():
        ROWS[name].check(value)
    if any(name.startswith("tire.") for name in values):
        unit_of({**given(node), **values})


def whole(node: Node) -> dict[str, Any]:
    """All parameters, checked; ``ValueError`` as :func:`~tire_dynamics.replay.parameters.complete` raises it."""
    values = given(node)
    complete({**values, **dict.fromkeys(name for name in values if name not in ROWS)})
    return complete(values)


def declare(node: Node, values: Mapping[str, Any], *, read_only: bool) -> None:
    """Declare every parameter with its type and range, and read-only if it is and ``read_only`` says so."""
    for name, row in ROWS.items():
        _declare(node, row, values[name], read_only=read_only and row.read_only)


def declare_free(node: Node) -> None:
    """Declare every parameter with what it has, such that it takes any value of its type and range.

    What was given that has another type or is out of range stays as it is until it is set.
    """
    values = given(node)
    for name, row in ROWS.items():
        value = values.get(name, row.default)
        try:
            row.check(value)
        except ValueError:
            _undeclare(node, name)
            node.declare_parameter(
                name, value, ParameterDescriptor(description=row.description, dynamic_typing=True), ignore_override=True
            )
        else:
            _declare(node, row, row.check(value), read_only=False)


def _declare(node: Node, row: Parameter, value: Any, *, read_only: bool) -> None:
    if not _undeclare(node, row.name):
        return  # it is what it was when it was declared
    if value != ():
        value = list(value) if isinstance(value, tuple) else value
        node.declare_parameter(row.name, value, _descriptor(row, read_only), ignore_override=True)
        return
    # An empty list would be taken for one of bytes: the type comes first, then the value, then whether it is fixed.
    node.declare_parameter(row.name, _TYPES[row.kind], _descriptor(row, False), ignore_override=True)
    node.set_parameters([_typed(row.name, value)])
    node.set_descriptor(row.name, _descriptor(row, read_only))


def _undeclare(node: Node, name: str) -> bool:
    """Take a parameter back, if it is there; whether it could be."""
    if node.has_parameter(name):
        if node.describe_parameter(name).read_only:
            return False
        node.undeclare_parameter(name)
    return True


def _typed(name: str, value: Any) -> RosParameter:
    """A parameter of the table's type if it is an empty list, else of the value's own, which is then checked."""
    value, kind = list(value) if isinstance(value, tuple) else value, ROWS[name].kind
    if "|" in kind and isinstance(value, (str, float)):  # one for all
        value = [] if value == "" else [value]
    return RosParameter(name, _TYPES[kind] if value == [] and kind.endswith("[]") else None, value)


def _meant(change: RosParameter) -> Any:
    value = _plain(change.value)
    return ROWS[change.name].default if value is None else value


def _as_chosen(name: str, value: Any) -> Any:
    """The unit N where rcl has read it as YAML's "no"; Python's YAML, which dumps it, does not quote it."""
    if isinstance(value, bool) and name in ROWS:
        for choice in ROWS[name].choices:
            if choice.lower() in (("y", "yes", "on") if value else ("n", "no", "off")):
                return choice
    return value


def _plain(value: Any) -> Any:
    """A value in the types of the table; None for null."""
    if value is None:
        return []  # of which rcl cannot tell the type, and makes a value that is not set
    if isinstance(value, str):
        return None if value in _NULL else value
    return value if isinstance(value, (bytes, bool, int, float)) else list(value)


def _descriptor(row: Parameter, read_only: bool) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        name=row.name,
        type=_TYPES[row.kind].value,
        description=row.description,
        read_only=read_only,
        additional_constraints=" | ".join(row.choices),
    )
    if row.low is not None and row.high is not None:
        if row.kind == "double":
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(row.low), to_value=float(row.high))]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(row.low), to_value=int(row.high), step=1)]
    return descriptor
