"""``tire-dynamics import-tir``: the rigid ring of an MF-Tyre/MF-Swift property file as the YAML of a unit."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.errors import InputError
from ..files.outputs import aside, writable
from .answer import answer

if TYPE_CHECKING:
    from ..files.tir_file import TirUnit

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
        "DAMP_LONG, with WIDTH and INFLPRES where they are) and writes a unit for --config. What such a file does not "
        "hold is assumed, and marked in the YAML and in the summary; --set says it better."
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
        help="a field in place of what is assumed, as in sidewall_damping=reaction; may be repeated",
    )
    parser.add_argument("--force", action="store_true", help="replace YAML if it exists")


def run(options: argparse.Namespace) -> int:
    """Write the unit that the options ask for, and say what was taken and what assumed.

    Parameters
    ----------
    options : argparse.Namespace
        As ``add_arguments`` declares it.

    Returns
    -------
    int
        Exit status 0.

    Raises
    ------
    InputError
        The file cannot be used, an option is wrong, or YAML exists already.
    """
    from ..files.tir_file import unit_from_tir

    output = writable(Path(options.output), force=options.force)
    if output.exists() and Path(options.input).exists() and output.samefile(options.input):
        raise InputError(f"{output}: is the file that is read")
    given = dict(map(_field, options.set))
    if len(given) < len(options.set):
        raise InputError(f"--set has {', '.join(options.set)}; no field may be given twice")
    try:
        result = unit_from_tir(
            options.input, wheel_mass=options.wheel_mass, suspension_stiffness=options.suspension_stiffness, **given
        )
    except OSError as error:
        raise InputError(f"{options.input}: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(str(error)) from None
    with aside(output) as part:
        part.write_text(yaml_of(result, Path(options.input).name), encoding="utf-8")

    unit, sources = result.unit, result.sources
    content = {
        "output": options.output,
        "unit": unit.to_mapping(),
        "sources": {name: source._asdict() for name, source in sources.items()},
        "ring_mass_kg": unit.ring_mass,
        "sidewall_stiffness_N_m": unit.sidewall_stiffness,
        "notes": result.notes,
    }
    counts = [sum(source.kind == kind for source in sources.values()) for kind in ("file", "given", "assumed")]
    lines = [f"{options.output}: {counts[0]} fields from the file, {counts[1]} given, {counts[2]} assumed:"]
    for name, source in sources.items():
        if source.kind == "assumed":
            lines.append(f"  {name:20} {_short(getattr(unit, name)):10} {source.reason}")
    answer(options, content, *lines, *(f"note: {note}" for note in result.notes))
    return 0


def _field(text: str) -> tuple[str, Any]:
    from ..files.tir_file import OPEN_FIELDS

    name, equals, value = text.partition("=")
    if not equals or name not in OPEN_FIELDS:
        raise InputError(f"--set is {text[:100]!r}; it must be FIELD=VALUE, FIELD one of {', '.join(OPEN_FIELDS)}")
    if name == "sidewall_damping":
        return name, value
    try:
        return name, float(value)
    except ValueError:
        raise InputError(f"--set is {text[:100]!r}; VALUE must be a number") from None


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def yaml_of(result: TirUnit, name: str) -> str:
    """The unit as ``TireWheelUnit.from_yaml`` reads it, each field with a comment that says where it comes from."""
    from ..files.yaml_file import yaml_value

    title = name if name.isprintable() else ascii(name)
    lines = [f"# The rigid ring of {title}, by `tire-dynamics import-tir`. SI units; config/table_1.yaml"]
    lines += ["# explains the fields, docs/model.md the relations."]
    lines += [f"# Note: {note}." for note in result.notes]
    for field, source in result.sources.items():
        value = getattr(result.unit, field)
        text = f"{field}: {yaml_value(value)}"
        why = source.reason if source.kind == "given" else f"{source.kind}: {source.reason}"
        lines.append(f"{text:44} # {why}")
    return "\n".join(lines) + "\n"
