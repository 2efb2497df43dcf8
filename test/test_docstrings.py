"""Docstrings of the public names: there is one, and what it says of parameters is what the signature has."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import tire_dynamics
from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.estimator.vehicle import Vehicle
from tire_dynamics.estimator.wheel_estimator import WheelEstimator
from tire_dynamics.replay.parameters import complete, read_config
from tire_dynamics.replay.pipeline import Pipeline
from tire_dynamics.replay.replay import replay

MODULES = [
    "science.unit",
    "estimator.simulate",
    "files.unit_file",
    "files.vehicle_file",
    "files.tir_unit",
    "estimator.vehicle_parameters",
    "estimator.load_filter",
    "estimator.load_estimate",
    "science.ring",
    "science.wheel",
    "science.floquet",
    "science.contact",
    "science.contact_points",
    "science.nonuniform",
    "science.rotating_excitation",
    "science.uniformity",
    "science.comparison",
]
INTEGRATORS = [replay, complete, read_config, BagReader, BagWriter, Pipeline, Vehicle, WheelEstimator]
PAGES = Path(__file__).parents[1] / "docs" / "api"
SHORT = 3  # lines, within which a docstring names what it takes by itself


def parts(name: str, thing: Any) -> Iterator[tuple[str, Any]]:
    """A function, or a class and its public methods and properties."""
    yield name, thing
    for part, value in vars(thing).items() if inspect.isclass(thing) else ():
        value = value.__func__ if isinstance(value, (classmethod, staticmethod)) else value
        if not part.startswith("_") and (inspect.isfunction(value) or isinstance(value, property)):
            yield f"{name}.{part}", value


def public() -> Iterator[tuple[str, Any]]:
    for path in MODULES:
        module = import_module(f"tire_dynamics.{path}")
        for name in module.__all__:
            thing = getattr(module, name)
            if callable(thing) and getattr(thing, "__module__", "").startswith("tire_dynamics"):
                yield from parts(f"{path}.{name}", thing)
    for thing in INTEGRATORS:
        yield from parts(thing.__name__, thing)


PUBLIC = dict(public())


def section(docstring: str, title: str) -> list[str] | None:
    """Names that a section of a numpydoc docstring describes; None if there is no such section."""
    found = re.search(rf"^{title}\n-{{{len(title)}}}\n(.*?)(?=^\w[^\n]*\n---|\Z)", docstring, re.MULTILINE | re.DOTALL)
    if found is None:
        return None
    heads = [line.split(" : ")[0] for line in found[1].splitlines() if line and not line.startswith(" ")]
    return [name.strip().lstrip("*") for head in heads for name in head.split(",")]


def arguments(thing: Any) -> list[str]:
    """What it is called with."""
    if isinstance(thing, property):
        return []
    return [name for name in inspect.signature(thing).parameters if name not in ("self", "cls")]


def faults(thing: Any) -> list[str]:
    """What is wrong with a docstring, one line each."""
    docstring = inspect.getdoc(thing)
    if not docstring or inspect.isclass(thing) and docstring.startswith(f"{thing.__name__}("):  # a dataclass's own
        return ["has no docstring"]
    summary = docstring.split("\n\n")[0]
    found = [] if summary.rstrip().endswith((".", ":")) else [f"begins with {summary!r}, which has no end"]
    underlined = re.findall(r"^(\w.*)\n(-{3,})$", docstring, re.MULTILINE)
    found += [f"{title!r} has a line of another length" for title, line in underlined if len(title) != len(line)]
    described, taken = section(docstring, "Parameters"), arguments(thing)
    if described is not None and described != taken:
        found.append(f"describes {described}; takes {taken}")
    if described is None and taken and len(docstring.splitlines()) > SHORT and not inspect.isclass(thing):
        found.append(f"is longer than {SHORT} lines and does not describe {taken}")
    return found


@pytest.mark.parametrize("name", PUBLIC)
def test_a_public_name_says_what_it_is_and_takes(name):
    assert faults(PUBLIC[name]) == []


def test_every_public_name_of_the_package_is_looked_at():
    homes = {name.rsplit(".", 1)[-1] for name in PUBLIC} | {path.rsplit(".", 1)[-1] for path in MODULES}
    assert set(tire_dynamics.__all__) <= homes
    assert len(PUBLIC) > 60


def test_a_fault_is_found():
    def silent(a):
        return a

    def other(a, b):
        """Sum.

        Parameters
        ----------
        a : float
        c : float
        """

    def long(a):
        """Sum.

        Notes
        -----
        Of one.
        """

    def crooked(a):
        """Sum

        Parameters
        -----
        a : float
        """

    def right(a, b, *rest, **named):
        """Sum.

        Parameters
        ----------
        a, b : float
            Two.
        *rest, **named
            More.

        Returns
        -------
        c : float
        """

    assert [bool(faults(each)) for each in (silent, other, long, crooked, right)] == [True] * 4 + [False]


def test_every_public_name_is_in_the_reference():
    """A page of docs/api asks for each; and each page asks for what exists."""
    asked = [
        path
        for page in PAGES.glob("*.md")
        for path in re.findall(r"^::: (\S+)$", page.read_text("utf-8"), re.MULTILINE)
    ]
    assert len(set(asked)) == len(asked)
    for path in asked:
        parent, name = path.rsplit(".", 1)
        assert hasattr(import_module(parent), name), path
    for path in MODULES:
        module = f"tire_dynamics.{path}"
        kept = {f"{module}.{name}" for name in import_module(module).__all__ if not name.isupper()}
        assert kept <= set(asked)
    assert {f"{thing.__module__}.{thing.__qualname__}" for thing in INTEGRATORS} <= set(asked)
