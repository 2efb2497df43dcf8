"""``tire-dynamics response``: the axle forces per load and traction over frequency, as Bode plots and numbers.

The numbers come from ``science.response``; the picture is drawn from what goes into the CSV file, and from nothing else
but the whirl frequencies.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.errors import InputError
from ..files.outputs import aside
from .answer import answer
from .options import add_picture, picture_and_numbers

if TYPE_CHECKING:
    from ..figures.bode import Bode

__all__ = ["add_arguments", "compute", "run"]

MAX_RPM = 1e7
MAX_HZ = 1e6
MOST_POINTS = 20_000
MOST_SPEEDS = 20
RPM = math.pi / 30.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options, but for those of ``answer``."""
    parser.description = (
        "How a load or a traction that varies as a sine arrives at the axle of a wheel that turns at a constant "
        "speed: amplitude ratio and phase of both axle forces over frequency. Draws Bode plots as PNG and writes the "
        "numbers beside it as CSV; --json prints them."
    )
    parser.add_argument("--speed-rpm", metavar="R", type=float, nargs="+", required=True, help="speeds [rpm]")
    parser.add_argument("--from", dest="low", metavar="F", type=float, default=1.0, help="lowest frequency [Hz] (1)")
    parser.add_argument("--to", dest="high", metavar="F", type=float, default=300.0, help="highest [Hz] (300)")
    parser.add_argument("--points", metavar="N", type=int, default=600, help="frequencies, at equal ratios (600)")
    parser.add_argument("--config", metavar="YAML", help="the fields of one unit, or parameters of the node")
    parser.add_argument("--model", choices=("inextensional", "complete"), help="of the belt; else the one in YAML")
    parser.add_argument(
        "--contact", action="store_true", help="on the road: per its height in place of the load; contact force too"
    )
    parser.add_argument("--n-max", metavar="N", type=int, default=30, help="with --contact: highest belt harmonic (30)")
    add_picture(parser)


def run(options: argparse.Namespace) -> int:
    """Compute, draw and write what the options ask for.

    ``InputError``: an option is wrong, matplotlib is missing, a file exists already, or the response is not finite.
    """
    if options.output is None and not options.json:
        raise InputError("needs -o PNG or --json; such as tire-dynamics response --speed-rpm 0 2000 -o bode.png")
    if options.output is not None:
        picture, table = picture_and_numbers(
            options.output, ".csv", force=options.force, otherwise="--json does without"
        )
    bode = compute(options)
    lines = []
    if options.output is not None:
        _write(picture, bode)
        count = f"{len(bode.speeds)} speed{'s' * (len(bode.speeds) > 1)} x {len(bode.frequencies)} frequencies"
        lines.append(f"{options.output}: {count}, their numbers in {table.name}")
    for speed, verdict in zip(bode.speeds, bode.verdicts, strict=True):
        if verdict == "unstable":
            lines.append(f"at {speed:g} rpm the unit is unstable: nothing settles to this response")
    answer(options, _content(options.output, bode), *lines)
    return 0


def compute(options: argparse.Namespace) -> Bode:
    """The numbers that the options ask for; ``InputError`` says which option is wrong, and how."""
    import numpy as np

    from ..figures.bode import Bode
    from ..replay.parameters import complete, read_config, unit_of
    from ..science import wheel

    rpm = tuple(options.speed_rpm)
    for speed in rpm:
        if not abs(speed) <= MAX_RPM:
            raise InputError(f"--speed-rpm is {speed}; it must be between -{MAX_RPM:g} and {MAX_RPM:g}")
    if len(rpm) > MOST_SPEEDS:
        raise InputError(f"--speed-rpm has {len(rpm)} speeds; it must have at most {MOST_SPEEDS}")
    for name, value in (("--from", options.low), ("--to", options.high)):
        if not 1e-6 <= value <= MAX_HZ:
            raise InputError(f"{name} is {value}; it must be from 1e-06 to {MAX_HZ:g}")
    if not options.low < options.high:
        raise InputError(f"--from is {options.low}; it must be less than --to, which is {options.high}")
    if not 2 <= options.points <= MOST_POINTS:
        raise InputError(f"--points is {options.points}; it must be from 2 to {MOST_POINTS}")
    values = complete(read_config(options.config) if options.config else {})
    unit, model = unit_of(values), options.model or values["model"]
    road: dict[str, Any] = {"contact": True, "n_max": options.n_max} if options.contact else {}
    if not 1 <= options.n_max <= 100:
        raise InputError(f"--n-max is {options.n_max}; it must be from 1 to 100")
    frequencies = np.geomspace(options.low, options.high, options.points)
    speeds = [speed * RPM for speed in rpm]
    try:
        return Bode(
            unit,
            model,
            rpm,
            frequencies,
            wheel.frequency_response(
                unit, speeds, frequencies, model, input="road" if options.contact else "load", n_max=options.n_max
            ),
            tuple(wheel.whirl_frequencies(unit, speed, model, **road) for speed in speeds),
            tuple(wheel.stability(unit.mean if road else unit, speed, model, **road).verdict for speed in speeds),
            options.contact,
        )
    except (ArithmeticError, ValueError) as error:
        raise InputError(str(error)) from None


def _write(picture: Path, bode: Bode) -> None:
    """The CSV file, all frequencies of one speed after those of another, and the picture."""
    import numpy as np

    from ..figures.drawings import save
    from ..figures.response_drawing import draw
    from ..figures.tables import write_csv

    table = {
        "speed_rpm": np.repeat(bode.speeds, len(bode.frequencies)),
        "frequency_Hz": np.tile(bode.frequencies, len(bode.speeds)),
    }
    for name, (row, column) in bode.paths.items():
        values = bode.response[:, :, row, column].ravel()
        table |= {f"{name}_ratio": np.abs(values), f"{name}_phase_deg": np.degrees(np.angle(values))}
    with aside(picture.with_suffix(".csv")) as csv, aside(picture) as png:
        write_csv(csv, table)
        save(png, draw, bode)


def _content(output: str | None, bode: Bode) -> dict[str, Any]:
    import numpy as np

    speeds = []
    for k, speed in enumerate(bode.speeds):
        paths = {
            name: {
                "ratio": np.abs(bode.response[k, :, row, column]).tolist(),
                "phase_deg": np.degrees(np.angle(bode.response[k, :, row, column])).tolist(),
            }
            for name, (row, column) in bode.paths.items()
        }
        whirl = bode.whirl[k].tolist()
        speeds.append({"speed_rpm": speed, "verdict": bode.verdicts[k], "whirl_frequencies_Hz": whirl, **paths})
    return {
        "output": output,
        "model": bode.model,
        "contact": bode.contact,
        "unit": bode.unit.to_mapping(),
        "frequencies_Hz": bode.frequencies.tolist(),
        "speeds": speeds,
    }
