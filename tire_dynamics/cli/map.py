"""``tire-dynamics map``: stability or transmissibility over two fields of the unit, or one and the speed.

The numbers come from ``science.maps``; the picture is drawn from what goes into the .npz file, and from nothing else.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.errors import InputError
from ..files.progress import progress
from ..replay import jobs
from .answer import answer
from .options import picture_and_numbers

if TYPE_CHECKING:
    from ..science.unit import TireWheelUnit

__all__ = ["MapRequest", "QUANTITIES", "add_arguments", "compute", "request_of", "run", "write"]

QUANTITIES = ("stability", "transmissibility")
POINTS = 256  # along an axis by default
MOST_POINTS = 4096
MAX_RPM = 1e7
RPM = math.pi / 30.0
_SCALE = "nonuniformity"


@dataclass(frozen=True)
class MapRequest:
    """What is to be mapped: names and values of the axes as the user has them ("speed_rpm" in rpm), the rest in SI."""

    unit: TireWheelUnit
    x: tuple[str, Any]
    y: tuple[str, Any]
    quantity: str
    model: Any
    speed: float | None
    log: tuple[bool, bool]
    n_max: int = 0  # of a tire on the road; 0: under a given load


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options, but for those of ``answer``."""
    parser.description = (
        "Draws a map over two fields of the unit, or over one and the speed, as PNG, and writes its numbers beside it "
        "as .npz. FIELD is a field of a unit that is a number (see config/table_1.yaml), speed [rad/s] or speed_rpm; "
        "beside the speed also nonuniformity, a factor of the amplitudes that the unit's sidewall has."
    )
    for axis in "xy":
        parser.add_argument(
            f"--{axis}",
            metavar="FIELD=LOW:HIGH[:N]",
            required=True,
            help=f"what runs along {axis}, from where to where, and in how many points (default {POINTS})",
        )
        parser.add_argument(f"--log-{axis}", action="store_true", help=f"the points along {axis} at equal ratios")
    parser.add_argument("--quantity", choices=QUANTITIES, default=QUANTITIES[0], help=f"default {QUANTITIES[0]}")
    parser.add_argument("--speed-rpm", metavar="R", type=float, help="the speed [rpm], where it is no axis")
    parser.add_argument("--config", metavar="YAML", help="the fields of one unit, or parameters of the node")
    parser.add_argument("--model", choices=("inextensional", "complete"), help="of the belt; else the one in YAML")
    parser.add_argument("--contact", action="store_true", help="on the road, without lift-off; some 5 ms a point")
    parser.add_argument("--n-max", metavar="N", type=int, default=30, help="with --contact: highest belt harmonic (30)")
    parser.add_argument("-o", "--output", metavar="PNG", required=True, help="the picture to write")
    parser.add_argument("--force", action="store_true", help="replace the two files if they exist")
    jobs.add_arguments(parser, "the points")


def run(options: argparse.Namespace) -> int:
    """Draw the map that the options ask for, and say on standard error what was made.

    ``InputError``: an option is wrong, matplotlib or Dask is missing, a file exists already, or a process that
    computes ends.
    """
    picture = picture_and_numbers(options.output, ".npz", force=options.force, needs="maps need")[0]
    request = request_of(options)

    def shown(function: Callable[[Any], Any], items: Iterable[Any]) -> Iterable[Any]:
        items = list(items)
        return map(function, progress(items, len(items), "map", quiet=options.quiet))

    if options.jobs is None and options.scheduler is None:
        arrays = compute(request, shown)
    else:
        with jobs.workers(options.jobs, options.scheduler) as pool:
            arrays = compute(request, partial(pool.map, what="map", quiet=options.quiet))
    write(picture, arrays)
    ny, nx = arrays[_shown(arrays)].shape
    numbers = picture.with_suffix(".npz")
    answer(
        options,
        {"output": str(picture), "numbers": str(numbers), **_account(arrays)},
        f"{picture}: {nx} x {ny} points, their numbers in {numbers.name}",
    )
    return 0


def request_of(options: argparse.Namespace) -> MapRequest:
    """The request that the options are; ``InputError`` says which of them is wrong, and how."""
    from ..replay.parameters import complete, read_config, unit_of

    values = complete(read_config(options.config) if options.config else {})
    x, y = (_axis(f"--{axis}", getattr(options, axis), getattr(options, f"log_{axis}")) for axis in "xy")
    rpm = options.speed_rpm
    if rpm is not None and not abs(rpm) <= MAX_RPM:
        raise InputError(f"--speed-rpm is {rpm}; it must be between -{MAX_RPM:g} and {MAX_RPM:g}")
    moving = [name for name, _ in (x, y) if name.startswith("speed")]
    if len(moving) + (rpm is not None) != 1:
        count = "none" if rpm is None and not moving else "more than one"
        raise InputError(f"one of --x, --y and --speed-rpm must say the speed; {count} does")
    model = options.model or values["model"]
    if options.quantity == "transmissibility" and model != "inextensional":
        raise InputError(f"--quantity transmissibility is for --model inextensional; the model is {model}")
    if options.contact and options.quantity != "stability":
        raise InputError(f"--contact is for --quantity stability; the quantity is {options.quantity}")
    if not 1 <= options.n_max <= 100:
        raise InputError(f"--n-max is {options.n_max}; it must be from 1 to 100")
    return MapRequest(
        unit_of(values),
        x,
        y,
        options.quantity,
        model,
        None if rpm is None else rpm * RPM,
        (options.log_x, options.log_y),
        options.n_max if options.contact else 0,
    )


def _axis(option: str, text: str, log: bool) -> tuple[str, Any]:
    """Name and values of an axis."""
    import numpy as np

    from ..science.maps import ROAD_AXES

    name, _, interval = text.partition("=")
    low_high_count = interval.split(":")
    try:
        low, high = map(float, low_high_count[:2])
        count = int(low_high_count[2]) if len(low_high_count) == 3 else POINTS
    except ValueError:
        low_high_count = []
    if len(low_high_count) not in (2, 3):
        raise InputError(f"{option} is {text!r}; it must be FIELD=LOW:HIGH or FIELD=LOW:HIGH:N, N a whole number")
    names = (*ROAD_AXES, "speed_rpm", _SCALE)
    if name not in names:
        raise InputError(f"{option}: {name!r} cannot be an axis; the axes are {', '.join(names)}")
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise InputError(f"{option}: {name} runs from {low} to {high}; LOW must be less than HIGH")
    if not 2 <= count <= MOST_POINTS:
        raise InputError(f"{option}: N is {count}; it must be from 2 to {MOST_POINTS}")
    limit = MAX_RPM * {"speed_rpm": 1.0, "speed": RPM}.get(name, math.inf)
    if max(abs(low), abs(high)) > limit:
        raise InputError(f"{option}: {name} runs from {low} to {high}; it must be between -{limit:g} and {limit:g}")
    if name == _SCALE and low < 0.0:
        raise InputError(f"{option}: {name} runs from {low}; it must be >= 0")
    if log and low <= 0.0:
        raise InputError(f"{option}: LOW is {low}; for equal ratios it must be > 0")
    return name, (np.geomspace if log else np.linspace)(low, high, count)


def compute(
    request: MapRequest, over: Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]] = map
) -> dict[str, Any]:
    """The arrays of the .npz file.

    Parameters
    ----------
    request : MapRequest
    over : callable
        As of ``science.maps.stability_map``: what spreads the work, without a change of a bit.

    Raises
    ------
    InputError
        A value is out of its field's bounds.
    """
    import numpy as np

    from ..science.floquet import VERDICTS
    from ..science.maps import stability_map, transmissibility_map

    factors = [RPM if name == "speed_rpm" else 1.0 for name, _ in (request.x, request.y)]
    x, y = (
        (name.removesuffix("_rpm"), values * factor)
        for (name, values), factor in zip((request.x, request.y), factors, strict=True)
    )
    arrays: dict[str, Any] = {
        "x_name": request.x[0],
        "y_name": request.y[0],
        "x": request.x[1],
        "y": request.y[1],
        "log": request.log,
        "unit": json.dumps(request.unit.to_mapping()),
        "model": request.model,
        "contact_n_max": request.n_max,
        "speed_rad_s": math.nan if request.speed is None else request.speed,
    }
    try:
        if _SCALE in (x[0], y[0]) and request.n_max:
            raise ValueError(f"{_SCALE} cannot be an axis with --contact")
        if _SCALE in (x[0], y[0]):
            arrays |= _tongues(request, x, y, over)
        elif request.quantity == "transmissibility":
            arrays["transmissibility"] = transmissibility_map(request.unit, x, y, speed=request.speed).transmissibility
        else:
            road: dict[str, Any] = {"contact": True, "n_max": request.n_max} if request.n_max else {}
            result = stability_map(request.unit, x, y, speed=request.speed, model=request.model, **road, over=over)
            arrays |= {
                "spectral_abscissa_1_s": result.abscissa,
                "spectral_radius": result.spectral_radius,
                "verdict": result.verdict,
                "verdicts": VERDICTS,
                "boundary": result.boundary / factors,
                "segments": result.segments,
            }
    except (ArithmeticError, ValueError) as error:
        raise InputError(str(error)) from None
    return {name: np.asarray(value) for name, value in arrays.items()}


def _tongues(
    request: MapRequest,
    x: tuple[str, Any],
    y: tuple[str, Any],
    over: Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]],
) -> dict[str, Any]:
    """The arrays of a map over the speed and the amplitudes of a sidewall that is not uniform.

    The boundary is that of the grid, the growth being joined by lines between its points.
    """
    import numpy as np
    from matplotlib.figure import Figure

    from ..science.floquet import VERDICTS
    from ..science.nonuniform import Nonuniformity, is_irreducibly_periodic

    if "speed" not in (x[0], y[0]) or request.quantity != "stability":
        raise ValueError(f"{_SCALE} can be an axis of a map of stability, beside speed or speed_rpm")
    if not is_irreducibly_periodic(request.unit, request.model):
        raise ValueError(f"{_SCALE} cannot be an axis: the unit's sidewall is uniform as far as n = 1 feels it")
    speeds, scales = (x[1], y[1]) if x[0] == "speed" else (y[1], x[1])
    columns = over(partial(_column, request.unit.mean, Nonuniformity.of(request.unit), scales, request.model), speeds)
    growth, radius, verdict = (np.stack(parts, axis=1) for parts in zip(*columns, strict=True))
    if x[0] != "speed":
        growth, radius, verdict = growth.T, radius.T, verdict.T
    unstable = verdict == VERDICTS.index("unstable")
    height = np.where(unstable, growth, -np.maximum(np.abs(growth), 1e-9 * np.abs(growth).max()))
    boundary: list[Any] = [np.empty((0, 2))]
    segments, count = [np.empty((0, 2), np.int64)], 0
    both = unstable.any() and not unstable.all()
    lines = Figure().subplots().contour(request.x[1], request.y[1], height, [0.0]).allsegs[0] if both else []
    for line in lines:
        boundary.append(np.asarray(line))
        place = count + np.arange(len(line))
        segments.append(np.stack([place[:-1], place[1:]], axis=1))
        count += len(line)
    return {
        "spectral_abscissa_1_s": growth,
        "spectral_radius": radius,
        "verdict": verdict,
        "verdicts": VERDICTS,
        "boundary": np.concatenate(boundary),
        "segments": np.concatenate(segments),
    }


def _column(unit: TireWheelUnit, sidewall: Any, scales: Any, model: Any, speed: float) -> tuple[Any, Any, Any]:
    """Growth, spectral radius and verdict at one speed."""
    from ..science.nonuniform import tongue_map

    found = tongue_map(unit, sidewall, [speed], scales, model)
    return found.growth[:, 0], found.spectral_radius[:, 0], found.verdict[:, 0]


def _account(arrays: dict[str, Any]) -> dict[str, Any]:
    """What the map shows, in few numbers: its axes, how many points have which verdict, and where the boundary is."""
    values = arrays[_shown(arrays)]
    account: dict[str, Any] = {
        axis: {
            "name": str(arrays[f"{axis}_name"]),
            "from": float(arrays[axis][0]),
            "to": float(arrays[axis][-1]),
            "points": arrays[axis].size,
        }
        for axis in "xy"
    }
    account |= {"quantity": _shown(arrays), "least": float(values.min()), "most": float(values.max())}
    if "verdict" in arrays:
        names = [str(name) for name in arrays["verdicts"]]
        account["verdicts"] = {name: int((arrays["verdict"] == code).sum()) for code, name in enumerate(names)}
        account["boundary"] = arrays["boundary"].tolist()
    return account


def _shown(arrays: dict[str, Any]) -> str:
    return "transmissibility" if "transmissibility" in arrays else "spectral_abscissa_1_s"


def write(picture: Path, arrays: dict[str, Any]) -> None:
    """Write the arrays as .npz and the picture that is drawn from them beside it."""
    import numpy as np

    from ..figures.drawings import save
    from ..figures.map_drawing import draw

    np.savez_compressed(picture.with_suffix(".npz"), **arrays)
    save(picture, draw, arrays)
