"""``tire-dynamics import-tir``: the rigid ring of an MF-Tyre/MF-Swift property file as the YAML of a unit."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.errors import InputError
from ..files.outputs import aside, writable
from .answer import answer
from .identify import errors_file

if TYPE_CHECKING:
    from ..files.tir_unit import TirUnit

__all__ = ["add_arguments", "run", "yaml_of"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options, but for those of ``answer``.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Its namespace is what ``run`` takes.
    """
    parser.description = (
        "Takes the rigid ring of an MF-Tyre/MF-Swift property file (BELT_MASS, BELT_IYY, FREQ_LONG, FREQ_WINDUP, "
        "DAMP_LONG, with WIDTH, INFLPRES and VERTICAL_STIFFNESS where they are) and writes a unit for --config. What "
        "such a file does not hold is assumed, and marked in the YAML and in the summary; --set says it better. A file "
        "without a rigid ring needs --estimate: its ring is then made up from size, mass and stiffness, and how far it "
        "may be off is written beside YAML, as NAME.errors.json, for `stability --samples`, `report` and `identify "
        "--start`."
    )
    parser.add_argument("input", metavar="FILE", help="the property file (.tir)")
    parser.add_argument("-o", "--output", metavar="YAML", required=True, help="the unit's file to write")
    parser.add_argument(
        "--wheel-mass",
        metavar="M",
        type=float,
        required=True,
        help="mass that moves with the wheel, without the belt [kg]",
    )
    parser.add_argument(
        "--suspension-stiffness",
        metavar="K",
        type=float,
        required=True,
        help="vertical stiffness of the suspension [N/m]",
    )
    parser.add_argument(
        "--set",
        metavar="FIELD=VALUE",
        action="append",
        default=[],
        help="a field in place of what is assumed, as in sidewall_damping=reaction or radial_runout=[[1,0.001,0]]; may "
        "be repeated",
    )
    parser.add_argument(
        "--key",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="a key of the file in place of its own, in the file's unit, as in FREQ_LONG=77; may be repeated",
    )
    parser.add_argument("--estimate", action="store_true", help="make up what the file lacks of a rigid ring")
    parser.add_argument("--force", action="store_true", help="replace YAML if it exists")


def run(options: argparse.Namespace) -> int:
    """Write the unit that the options ask for, and say what was taken and what assumed.

    ``InputError``: the file cannot be used, an option is wrong, or YAML exists already.
    """
    from ..files.tir_unit import unit_from_tir

    output = writable(Path(options.output), force=options.force)
    files = [output, errors_file(output)] if options.estimate else [output]
    for path in files:
        writable(path, force=options.force)
        if path.exists() and Path(options.input).exists() and path.samefile(options.input):
            raise InputError(f"{path}: is the file that is read")
    if not options.estimate and errors_file(output).exists():
        raise InputError(f"{errors_file(output)}: holds errors of another unit, and would be taken for this one's")
    given = dict(map(_field, options.set))
    if len(given) < len(options.set):
        raise InputError(f"--set has {', '.join(options.set)}; no field may be given twice")
    keys = dict(map(_key, options.key))
    if len(keys) < len(options.key):
        raise InputError(f"--key has {', '.join(options.key)}; no key may be given twice")
    try:
        result = unit_from_tir(
            options.input,
            wheel_mass=options.wheel_mass,
            suspension_stiffness=options.suspension_stiffness,
            keys=keys,
            estimate=options.estimate,
            **given,
        )
    except OSError as error:
        raise InputError(f"{options.input}: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(str(error)) from None
    with aside(output) as part:
        part.write_text(yaml_of(result, Path(options.input).name), encoding="utf-8")
    if result.errors is not None:
        with aside(files[1]) as part:
            part.write_text(json.dumps(_errors_of(result), indent=1, allow_nan=False) + "\n", encoding="utf-8")

    unit, sources = result.unit, result.sources
    content = {
        "output": options.output,
        "unit": unit.to_mapping(),
        "sources": {name: source._asdict() for name, source in sources.items()},
        "ring_mass_kg": unit.ring_mass,
        "sidewall_stiffness_N_m": unit.sidewall_stiffness,
        "notes": result.notes,
        "doubts": result.doubts,
        "estimates": {key: each._asdict() for key, each in result.estimates.items()},
        "errors": None if result.errors is None else result.errors.relative,
    }
    count = {kind: sum(source.kind == kind for source in sources.values()) for kind in ("file", "given", "assumed")}
    made_up = f"{sum(source.kind == 'estimated' for source in sources.values())} estimated, " * bool(result.estimates)
    lines = [
        f"{options.output}: {count['file']} fields from the file, {count['given']} given, {made_up}{count['assumed']} "
        "assumed:"
    ]
    for name, source in sources.items():
        if source.kind in ("assumed", "estimated"):
            lines.append(f"  {name:20} {_short(getattr(unit, name)):10} {source.reason}")
    lines += [f"note: {note}" for note in result.notes]
    if result.errors is not None:
        lines.append(f"note: how far the estimates may be off is in {files[1]}, which --samples and --start read")
    answer(options, content, *lines, *(f"doubtful: {doubt}" for doubt in result.doubts))
    return 0


def _errors_of(result: TirUnit) -> dict[str, Any]:
    """What ``identify`` writes of a unit's errors, as far as rules know it."""
    from ..science.uncertainty import value_of

    errors = result.errors
    assert errors is not None
    names = list(errors.relative)
    widths = {"k_1": errors.k_1, **{name: errors.relative[name] for name in names if name in ("density", "zeta_1")}}
    return {
        "fields": names,
        "values": [value_of(result.unit, name) for name in names],
        "relative_errors": list(errors.relative.values()),
        "correlation": errors.correlation.tolist(),
        "prior_widths": widths,
    }


def _key(text: str) -> tuple[str, str]:
    from ..files.tir_file import KEYS

    name, equals, value = text.partition("=")
    name = name.strip().upper()
    if not equals or name not in KEYS:
        raise InputError(f"--key is {text[:100]!r}; it must be KEY=VALUE, KEY one of {', '.join(KEYS)}")
    return name, value.strip()


def _field(text: str) -> tuple[str, Any]:
    from ..files.tir_unit import OPEN_FIELDS
    from ..science.unit import HARMONICS

    name, equals, value = text.partition("=")
    if not equals or name not in OPEN_FIELDS:
        raise InputError(f"--set is {text[:100]!r}; it must be FIELD=VALUE, FIELD one of {', '.join(OPEN_FIELDS)}")
    if name == "sidewall_damping":
        return name, value
    if name in HARMONICS:
        try:
            return name, json.loads(value)
        except (ValueError, RecursionError):
            raise InputError(f"--set is {text[:100]!r}; VALUE must be a list as in [[1,0.001,0]]") from None
    try:
        return name, float(value)
    except ValueError:
        raise InputError(f"--set is {text[:100]!r}; VALUE must be a number") from None


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def yaml_of(result: TirUnit, name: str) -> str:
    """The unit as ``read_unit`` reads it, each field with a comment that says where it comes from."""
    from ..files.yaml_file import yaml_value

    title = name if name.isprintable() else ascii(name)
    lines = [f"# The rigid ring of {title}, by `tire-dynamics import-tir`. SI units; config/table_1.yaml"]
    lines += ["# explains the fields, docs/model.md the relations."]
    lines += [f"# Note: {note}." for note in result.notes]
    lines += [f"# Doubtful: {doubt}." for doubt in result.doubts]
    for field, source in result.sources.items():
        value = getattr(result.unit, field)
        text = f"{field}: {yaml_value(value)}"
        why = source.reason if source.kind == "given" else f"{source.kind}: {source.reason}"
        lines.append(f"{text:44} # {why}")
    return "\n".join(lines) + "\n"
