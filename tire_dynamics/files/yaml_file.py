"""YAML files of parameters, read strictly."""

from __future__ import annotations

import os
import re
from os import PathLike
from typing import Any

import yaml

__all__ = ["read_yaml", "yaml_number", "yaml_value"]

_MAX_SIZE = 256 * 1024  # bytes; a vehicle's parameters take some thousand


def read_yaml(path: str | PathLike[str]) -> dict[str, Any]:
    """The mapping in a YAML file, its plain values read as YAML 1.2 reads them, and no key given twice.

    Aliases are refused, as ROS 2 refuses them in its parameter files: a few lines of them unfold to any size.

    YAML 1.1, which PyYAML follows, takes ``5.80e6`` for text, ``010`` for eight, ``1:30`` for ninety and ``no`` for
    false, and the last of two equal keys for both; each would change a tire without a word.
    """
    if os.stat(path).st_size > _MAX_SIZE:
        raise ValueError(f"{path} is too large to be a file of parameters")
    if not (os.path.isfile(path) or os.path.isdir(path)):  # of a folder, open() says so; a pipe may wait for ever
        raise ValueError(f"{path} is not a file")
    with open(path, encoding="utf-8") as file:
        try:
            content = yaml.load(file, Loader=_Loader)
        except _NOT_YAML as error:
            raise ValueError(f"{path} is not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(content, dict):
        raise ValueError(f"{path} holds no mapping of names to values")
    return content


def yaml_number(value: float) -> str:
    """A float as YAML 1.1 and 1.2 both read it back, exactly."""
    text = repr(value)
    if "e" in text:  # YAML 1.1 wants a dot and a signed exponent
        mantissa, exponent = text.split("e")
        text = f"{mantissa if '.' in mantissa else mantissa + '.0'}e{int(exponent):+03d}"
    return text


def yaml_value(value: Any) -> str:
    """A number, a name, or a list of them, in one line of YAML."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(yaml_value, value))}]"
    return yaml_number(value) if isinstance(value, float) else str(value)


# What PyYAML raises on text that is not what it is said to be, its constructors included.
_NOT_YAML = (yaml.YAMLError, ValueError, TypeError, AttributeError, LookupError, RecursionError)


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: dict[str, Any] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark
            raise yaml.composer.ComposerError(None, None, "aliases are not read", mark)
        return super().compose_node(parent, index)


def _construct_mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    mapping: dict[Any, Any] = {}
    for key_node, value_node in node.value:
        key = loader.construct_object(key_node, deep=True)
        if isinstance(key, (dict, list)):
            raise yaml.constructor.ConstructorError(None, None, "a key must be a name", key_node.start_mark)
        if key in mapping:
            raise yaml.constructor.ConstructorError(None, None, f"{key!r} is given twice", key_node.start_mark)
        mapping[key] = loader.construct_object(value_node, deep=True)
    return mapping


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _construct_mapping)
_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
for _tag, _pattern, _first in (
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("int", r"[-+]?(?:0|[1-9][0-9]*)", "-+0123456789"),
    ("float", rf"{_NUMBER}|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)", "-+.0123456789"),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(rf"(?:{_pattern})$"), list(_first))
