"""``tire-dynamics stability``: Floquet stability at a speed, as JSON."""

from __future__ import annotations

import argparse
import json
import math
from typing import TYPE_CHECKING, Any

from ..files.errors import InputError
from . import uncertainty
from .answer import plain
from .options import add_config

if TYPE_CHECKING:
    from ..science.unit import TireWheelUnit

__all__ = ["add_arguments", "run"]

_MAX_RPM = 1e7
_MOST_MODES = 12  # of the belt; more take minutes


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Declare the options of ``stability``."""
    command.add_argument("--speed-rpm", metavar="R", type=float, required=True, help="speed of the wheel [rpm]")
    add_config(command, "the fields of one unit, or parameters of the node")
    command.add_argument(
        "--n-max",
        metavar="N",
        type=int,
        help="with a sidewall that is not uniform: the modes n = 0 to N, which its harmonics couple (1: n = 1 alone)",
    )
    command.add_argument(
        "--contact",
        action="store_true",
        help="on the road, without lift-off, with the belt's harmonics to --n-max (30)",
    )
    command.add_argument(
        "--tongues",
        action="store_true",
        help="with a sidewall that is not uniform: every tongue of instability and what opens it; some seconds",
    )
    uncertainty.add_arguments(command)
    command.add_argument("--json", action="store_true", help="as it is anyway")


def run(options: argparse.Namespace) -> int:
    """Print the stability; exit status 0."""
    from ..estimator.vehicle import modes_on_the_road, stability_reply
    from ..replay.parameters import complete, read_config, unit_of

    if not abs(options.speed_rpm) <= _MAX_RPM:
        raise InputError(f"--speed-rpm is {options.speed_rpm}; it must be between -{_MAX_RPM:g} and {_MAX_RPM:g}")
    values = complete(read_config(options.config) if options.config else {})
    try:
        speed = options.speed_rpm * math.pi / 30.0
        unit = unit_of(values)
        most = 100 if options.contact and modes_on_the_road(unit, 100) == 100 else _MOST_MODES
        usual = modes_on_the_road(unit, 30) if options.contact else 1
        n_max = usual if options.n_max is None else options.n_max
        if not 1 <= n_max <= most:
            raise InputError(f"--n-max is {n_max}; it must be from 1 to {most}")
        if options.contact and options.samples is not None:
            raise InputError("--samples is for the tire under a given load; leave --contact out")
        if options.contact and options.tongues:
            raise InputError("--tongues is for the tire under a given load; leave --contact out")
        reply = stability_reply("wheel", unit, speed, values["model"], n_max, options.contact)
        if options.tongues:
            reply["tongues"] = _tongues(unit, values["model"])
    except (ArithmeticError, ValueError) as error:
        raise InputError(f"--speed-rpm is {options.speed_rpm}: {error}") from None
    if options.samples is not None:
        reply["uncertainty"] = plain(uncertainty.uncertainty(options, unit_of(values), speed, values["model"]))
    elif options.error:
        raise InputError("--error belongs to --samples, which is not given")
    print(json.dumps(reply, indent=2))
    return 0


def _tongues(unit: TireWheelUnit, model: Any) -> list[dict[str, Any]]:
    """Every tongue of a unit whose sidewall is not uniform: where it begins, and what opens it."""
    from ..science import nonuniform

    sidewall = nonuniform.Nonuniformity.of(unit)
    found = []
    for resonance in nonuniform.combination_resonances(unit, sidewall, model):
        threshold = nonuniform.tongue_threshold(unit, sidewall, resonance, model)
        found.append({
            "speed_rad_s": resonance.speed,
            "frequencies_rad_s": list(resonance.frequencies),
            "growth_1_s": resonance.growth,
            "scale": None if threshold is None else threshold.scale,
            "scale_at_rad_s": None if threshold is None else threshold.speed,
            "scale_first_order": None if math.isnan(resonance.threshold) else resonance.threshold,
        })  # fmt: skip
    return found

