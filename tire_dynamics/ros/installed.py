"""The message types that are installed: their classes, and their definitions as bags carry them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib import import_module
from typing import Any

from ..replay.input_map import MapError, mapped_types

__all__ = ["definition_of", "definitions_of", "message_class"]

_RULE = 80 * "="
_NAMES = {"boolean": "bool", "octet": "byte", "double": "float64", "float": "float32"}  # IDL's, by those of messages
_MANY = re.compile(r"sequence<(.*?)(?:, (\d+))?>|(.*)\[(\d+)\]")


def message_class(msgtype: str) -> Any:
    """The class of a message type; ``ModuleNotFoundError`` or ``AttributeError`` if it is not installed."""
    package, _, name = msgtype.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def definition_of(msgtype: str) -> str:
    """The definition of an installed type: its fields, then those of all types in it, as ``ros2msg`` has them.

    Constants and defaults are not in it: they are not in the bytes of a message either.
    """
    found: dict[str, str] = {}
    waiting = [msgtype]
    while waiting:
        name = waiting.pop(0)
        if name in found:
            continue
        lines = []
        for field, kind in message_class(name).get_fields_and_field_types().items():
            own, many = _split(kind)
            lines.append(f"{own}{many} {field}\n")
            if "/" in own:
                waiting.append(own.replace("/", "/msg/"))
        found[name] = "".join(lines)
    own, *others = found
    behind = [f"{_RULE}\nMSG: {other.replace('/msg/', '/')}\n{found[other]}" for other in others]
    return "".join([found[own], *behind])


def _split(kind: str) -> tuple[str, str]:
    """A field's type and what stands behind it: ``sequence<double, 3>`` is ``float64`` and ``[<=3]``."""
    many, match = "", _MANY.fullmatch(kind)
    if match is not None:
        inner, bound, other, length = match.groups()
        kind, many = inner or other, f"[{length}]" if length else f"[<={bound}]" if bound else "[]"
    own, _, bound = kind.partition("<")
    return _NAMES.get(own, own) + (f"<={bound.rstrip('>')}" if bound else ""), many


def definitions_of(values: Mapping[str, Any]) -> dict[str, str]:
    """The definitions of the types that the field map names, by type.

    Raises
    ------
    MapError
        A type is not given, or not installed.
    """
    found = {}
    for topic, msgtype in mapped_types(values).items():
        if not msgtype:
            raise MapError(f"inputs.*.type of {topic} is empty; it must name the type of its messages")
        try:
            found[msgtype] = definition_of(msgtype)
        except (ImportError, AttributeError):
            package = msgtype.split("/")[0]
            raise MapError(
                f"{topic} is {msgtype}, which is not installed; source the workspace that has {package}"
            ) from None
    return found
