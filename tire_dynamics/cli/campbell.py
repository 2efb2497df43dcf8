"""``tire-dynamics campbell``: frequencies and decay rates of a unit over its speed, as a picture and numbers."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from ..files.errors import InputError
from ..files.outputs import aside
from .answer import answer
from .options import add_picture, picture_and_numbers

if TYPE_CHECKING:
    from ..figures.campbell_diagram import CampbellDiagram

__all__ = ["add_arguments", "compute", "run"]

MAX_RPM = 1e5
MOST_POINTS = 2000
MOST_WAVES = 30
RPM = math.pi / 30.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options, but for those of ``answer``."""
    parser.description = (
        "The Campbell diagram: frequencies and decay rates of ring, wheel and belt over the speed, seen from the "
        "axle. Under a given load, or on the road, where the contact couples the belt's harmonics with one another "
        "and with the wheel. Names are those of the motions at standstill. Draws it as PNG and writes the numbers "
        "beside it as CSV; --json prints them."
    )
    parser.add_argument("--to-rpm", metavar="R", type=float, default=3000.0, help="highest speed [rpm] (3000)")
    parser.add_argument("--points", metavar="N", type=int, default=121, help="speeds, from standstill on (121)")
    parser.add_argument("--waves", metavar="N", type=int, default=4, help="highest wave of the belt that is named (4)")
    parser.add_argument("--config", metavar="YAML", help="the fields of one unit, or parameters of the node")
    parser.add_argument("--model", choices=("inextensional", "complete"), help="of the belt; else the one in YAML")
    parser.add_argument("--contact", action="store_true", help="of the tire on the road, without lift-off")
    parser.add_argument("--n-max", metavar="N", type=int, default=30, help="with --contact: highest belt harmonic (30)")
    add_picture(parser)


def run(options: argparse.Namespace) -> int:
    """Compute, draw and write what the options ask for.

    ``InputError``: an option is wrong, matplotlib is missing, or a file exists already.
    """
    if options.output is None and not options.json:
        raise InputError("needs -o PNG or --json; such as tire-dynamics campbell --contact -o campbell.png")
    if options.output is not None:
        picture, table = picture_and_numbers(
            options.output, ".csv", force=options.force, otherwise="--json does without"
        )
    shown = compute(options)
    lines = []
    if options.output is not None:
        _write(picture, shown)
        count = f"{len(shown.frequency)} motions at {len(shown.speed)} speeds"
        lines.append(f"{options.output}: {count}, their numbers in {table.name}")
    content = {
        "output": options.output,
        "model": shown.model,
        "contact": shown.contact,
        "n_max": shown.n_max if shown.contact else None,
        "unit": shown.unit.to_mapping(),
        **{name: values.tolist() for name, values in shown.table.items()},
    }
    answer(options, content, *lines)
    return 0


def compute(options: argparse.Namespace) -> CampbellDiagram:
    """The numbers that the options ask for; ``InputError`` says which option is wrong, and how."""
    import numpy as np

    from ..figures.campbell_diagram import diagram
    from ..replay.parameters import complete, read_config, unit_of

    if not 0.0 < options.to_rpm <= MAX_RPM:
        raise InputError(f"--to-rpm is {options.to_rpm}; it must be above 0 and at most {MAX_RPM:g}")
    if not 2 <= options.points <= MOST_POINTS:
        raise InputError(f"--points is {options.points}; it must be from 2 to {MOST_POINTS}")
    if not 1 <= options.n_max <= 100:
        raise InputError(f"--n-max is {options.n_max}; it must be from 1 to 100")
    most = min(MOST_WAVES, options.n_max) if options.contact else MOST_WAVES
    if not 2 <= options.waves <= most:
        raise InputError(f"--waves is {options.waves}; it must be from 2 to {most}")
    values = complete(read_config(options.config) if options.config else {})
    unit, model = unit_of(values), options.model or values["model"]
    speed = np.linspace(0.0, options.to_rpm * RPM, options.points)
    numbers = range(2, options.waves + 1)
    try:
        return diagram(unit.mean, speed, numbers, model, contact=options.contact, n_max=options.n_max)
    except (ArithmeticError, ValueError) as error:
        raise InputError(str(error)) from None


def _write(picture: Path, shown: CampbellDiagram) -> None:
    from ..figures.campbell_diagram import draw
    from ..figures.drawings import save
    from ..figures.tables import write_csv

    with aside(picture.with_suffix(".csv")) as csv, aside(picture) as png:
        write_csv(csv, shown.table)
        save(png, draw, shown)
