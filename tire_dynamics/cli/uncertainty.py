"""``--samples`` of ``stability`` and ``report``: what errors of the parameters do."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.errors import InputError
from .identify import errors_file

if TYPE_CHECKING:
    from ..science.unit import TireWheelUnit

__all__ = ["add_arguments", "check_samples", "errors_file", "errors_of", "uncertainty"]

MOST = 100_000  # samples; some 0.6 ms each
LARGEST = 8 * 2**20  # bytes of a file of errors


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options that ask for bands."""
    parser.add_argument(
        "--samples", metavar="N", type=int, help="add what errors of the parameters do, by N samples of the unit"
    )
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of the samples (0)")
    parser.add_argument(
        "--error",
        metavar="FIELD=VALUE",
        action="append",
        default=[],
        help="standard error of a field, or of k_1, as in zeta_1=0.004 or zeta_1=10%%; may be repeated. Else those "
        "that identify wrote beside YAML",
    )


def uncertainty(options: argparse.Namespace, unit: TireWheelUnit, speed: float, model: Any) -> dict[str, Any]:
    """What ``--samples`` adds to the reply of ``stability``.

    Parameters
    ----------
    options : argparse.Namespace
        As ``add_arguments`` declares it; ``config`` is read too.
    unit : TireWheelUnit
    speed : float
        [rad/s]
    model : {"inextensional", "complete"}

    Returns
    -------
    dict

    Raises
    ------
    InputError
        There are no errors, or they are not those of this unit.
    """
    from ..science.uncertainty import SHARES, bands

    check_samples(options.samples, options.seed)
    path = errors_file(Path(options.config)) if options.config else None
    errors, correlation = errors_of(path, unit, options.error)
    try:
        found = bands(unit, speed, errors, correlation, samples=options.samples, seed=options.seed, model=model)
    except (ArithmeticError, ValueError) as error:
        raise InputError(str(error)) from None
    names = [f"{share:.0%}" for share in SHARES]
    return {
        "samples": options.samples,
        "seed": options.seed,
        "relative_errors": errors,
        "transmissibility": dict(zip(names, found.transmissibility.tolist(), strict=True)),
        "critical_speed_rad_s": dict(zip(names, found.critical_speed.tolist(), strict=True)),
        "share_without_critical_speed": found.never,
        "share_unstable": found.unstable,
    }


def check_samples(samples: int, seed: int) -> None:
    """``InputError`` unless both are in bounds."""
    if not 1 <= samples <= MOST:
        raise InputError(f"--samples is {samples}; it must be from 1 to {MOST}")
    if seed < 0:
        raise InputError(f"--seed is {seed}; it must be at least 0")


def errors_of(path: Path | None, unit: TireWheelUnit, given: Sequence[str]) -> tuple[dict[str, float], Any]:
    """Standard errors of logarithms, and their correlation or None.

    Parameters
    ----------
    path : Path or None
        Where a file of errors may be.
    unit : TireWheelUnit
    given : list of str
        FIELD=VALUE, in place of what the file says of the field, and independent of all else.
    """
    import numpy as np

    from ..science.uncertainty import UNCERTAIN, value_of

    errors: dict[str, float] = {}
    correlation: Any = None
    if path is not None and path.is_file():
        errors, correlation = _read(path, unit)
    for text in given:
        name, equals, value = text.partition("=")
        if not equals or name not in UNCERTAIN:
            raise InputError(f"--error is {text[:100]!r}; it must be FIELD=VALUE, FIELD one of {', '.join(UNCERTAIN)}")
        try:
            number = float(value.removesuffix("%"))
        except ValueError:
            raise InputError(f"--error is {text[:100]!r}; VALUE must be a number, or one with %") from None
        size = value_of(unit, name)
        if not size > 0.0:
            raise InputError(f"--error is {text[:100]!r}; {name} is 0 in this unit, and can have none")
        if correlation is not None and name in errors:
            k = list(errors).index(name)
            correlation[k] = correlation[:, k] = 0.0
            correlation[k, k] = 1.0
        elif correlation is not None:
            correlation = np.pad(correlation, (0, 1))
            correlation[-1, -1] = 1.0
        errors[name] = number / 100.0 if value.endswith("%") else number / size
        if not 0.0 <= errors[name] <= 3.0:
            raise InputError(f"--error is {text[:100]!r}; it must be from 0 to three times the value, {size:g}")
    if not errors:
        beside = f", or a {path.name} beside it, as identify writes one" if path is not None else ""
        raise InputError(f"--samples needs errors: --error zeta_1=10%{beside}")
    return errors, correlation


def _read(path: Path, unit: TireWheelUnit) -> tuple[dict[str, float], Any]:
    import numpy as np

    from ..science.uncertainty import value_of

    try:
        if path.stat().st_size > LARGEST:
            raise ValueError
        content = json.loads(path.read_text(encoding="utf-8"))
        names, values = [str(name) for name in content["fields"]], [float(value) for value in content["values"]]
        errors = [float(error) for error in content["relative_errors"]]
        correlation = np.array(content["correlation"], np.float64)
        whole = len(names) == len(values) == len(errors) == len(set(names)) and correlation.shape == (len(names),) * 2
        if not whole or not np.isfinite([*values, *errors, *correlation.flat]).all():
            raise ValueError
        here = [value_of(unit, name) for name in names]
    except (OSError, ValueError, TypeError, LookupError, AttributeError, RecursionError):
        raise InputError(f"{path}: is no file of errors, as identify writes one") from None
    for name, value, now in zip(names, values, here, strict=True):
        if not math.isclose(value, now, rel_tol=1e-9):
            raise InputError(f"{path}: its {name} is {value:.10g}, the unit's {now:.10g}; it belongs to another unit")
    return dict(zip(names, errors, strict=True)), correlation
