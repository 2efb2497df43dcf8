"""``tire-dynamics identify``: parameters of a unit from a bag with a force that was measured at its axle."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.errors import InputError
from ..files.outputs import aside, writable
from .answer import answer, plain, printable
from .options import picture_file

if TYPE_CHECKING:
    from ..bag import BagReader
    from ..estimator.identification import Identification, Recording
    from ..replay.bag_setup import BagSetup
    from ..science.unit import TireWheelUnit

__all__ = ["add_arguments", "errors_file", "prior_widths", "read", "run", "statements", "yaml_of"]

LONGEST = 600.0  # [s] that are fitted: a minute or two of work
_LARGEST = 8 * 2**20  # bytes of a file of errors
LARGE = 0.3  # a standard error that is worth a word
TIED = 0.95  # a correlation that is
MOST_FORCE = 1e9  # [N] that was measured; beyond, a sensor has failed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options, but for those of ``answer`` and ``--remap``.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Its namespace is what ``run`` takes.
    """
    parser.description = (
        "Fits parameters of a unit to a force that was measured at its axle, and says how well the data know them: "
        "first to the frequency response from load to force, then to the time series, with an unknown delay and offset "
        "of the sensor. Writes the unit for --config, and beside it, as NAME.errors.json, the errors for `stability "
        "--samples`."
    )
    parser.add_argument("input", metavar="BAG", help="a rosbag2 folder or a .mcap file with the inputs and the force")
    parser.add_argument(
        "--measured",
        metavar="TOPIC",
        required=True,
        help="the force on the suspension, geometry_msgs/WrenchStamped: force.z, and force.x with --axes xz",
    )
    parser.add_argument("--wheel", metavar="NAME", help="which wheel's; needed of several")
    parser.add_argument(
        "--fit",
        metavar="NAMES",
        default="k_1,zeta_1,wheel_mass,suspension_stiffness,zeta_s",
        help="what to fit, with commas: also density, longitudinal_stiffness, longitudinal_damping_ratio, "
        "longitudinal_mass (all but these four)",
    )
    parser.add_argument(
        "--start",
        metavar="YAML",
        help="where to begin, and the middle of the priors: a unit, parameters of the node, or a .tir; "
        "else the log's own, or the paper's",
    )
    parser.add_argument("--wheel-mass", metavar="M", type=float, help="with a .tir: that moves with the wheel [kg]")
    parser.add_argument("--suspension-stiffness", metavar="K", type=float, help="with a .tir: vertical [N/m]")
    parser.add_argument("--axes", choices=("z", "xz"), default="z", help="of the force that was measured (z)")
    parser.add_argument(
        "--between",
        choices=("smooth", "lines", "zero-order-hold"),
        default="smooth",
        help="the load between its samples: a smooth curve, lines, or a zero-order hold as the node's (smooth)",
    )
    parser.add_argument(
        "--prior-width",
        metavar="W",
        type=float,
        default=0.5,
        help="of the priors, in the logarithm (0.5); those that import-tir --estimate wrote beside --start come first",
    )
    parser.add_argument(
        "--gain-error",
        metavar="E",
        type=float,
        default=0.01,
        help="standard error of the gain of the force's channel over the load's (0.01); 0 takes it for 1",
    )
    parser.add_argument(
        "--load-noise",
        metavar="N",
        type=float,
        help="white noise of the load's channel [N rms], whose effect is taken out; else the errors contain what there "
        "may be of it",
    )
    parser.add_argument("--model", choices=("inextensional", "complete"), help="of the belt; else that of --start")
    parser.add_argument("--from", dest="begin", metavar="S", type=float, default=0.0, help="leave out what is before")
    parser.add_argument("--to", dest="end", metavar="S", type=float, help="and what is after [s of the drive]")
    parser.add_argument("-o", "--output", metavar="YAML", required=True, help="the unit's file to write")
    parser.add_argument("--plot", metavar="PNG", help="draw coherence and frequency response, measured and fitted")
    parser.add_argument("--force", action="store_true", help="replace the files if they exist")


def errors_file(unit_file: Path) -> Path:
    """Where the errors of a unit's YAML are: ``unit.errors.json`` beside ``unit.yaml``."""
    return unit_file.with_suffix(".errors.json")


def run(options: argparse.Namespace) -> int:
    """Fit what the options ask for, write it, and say how well it is known.

    ``InputError``: the bag or an option cannot be used, or a file exists already.
    """
    output = Path(options.output)
    if output.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"--output is {options.output}; its name must end in .yaml")
    files = [output, errors_file(output)]
    if options.plot is not None:
        files.append(picture_file(options.plot, "--plot", otherwise="without --plot none"))
    for path in files:
        writable(path, force=options.force)
        if path.exists() and options.start and Path(options.start).exists() and path.samefile(options.start):
            raise InputError(f"{path}: is the file to begin with")

    from ..bag import BagReader
    from ..estimator.identification import identify
    from ..replay.bag_setup import bag_setup, joints_of, remaps_of

    is_tir = bool(options.start) and Path(options.start).suffix.lower() == ".tir"
    if not is_tir and (options.wheel_mass is not None or options.suspension_stiffness is not None):
        raise InputError("--wheel-mass and --suspension-stiffness belong to a --start that is a .tir")
    reader = BagReader(options.input, options.clock)
    how = bag_setup(reader, None if is_tir else options.start, remaps_of(options.remap), joints_of(options.joint))
    start = _start(options, how, is_tir)
    recording, notes = read(reader, how, options)
    try:
        found = identify(
            recording,
            start,
            tuple(name.strip() for name in options.fit.split(",") if name.strip()),
            axes=options.axes,
            joined=options.between,
            prior_width=prior_widths(options, is_tir),
            model=options.model or how.values["model"],
            gain_width=options.gain_error,
            load_noise=options.load_noise,
        )
    except (ArithmeticError, ValueError) as error:
        raise InputError(f"{options.input}: {error}") from None

    said = statements(found)
    content = {"output": options.output, **_content(found), "statements": said, "notes": notes}
    with aside(files[0]) as unit, aside(files[1]) as errors:
        unit.write_text(yaml_of(found, Path(options.input).name, files[1].name), encoding="utf-8")
        errors.write_text(json.dumps(plain(_content(found)), indent=1, allow_nan=False) + "\n", encoding="utf-8")
        if options.plot is not None:
            from ..figures.drawings import save
            from ..figures.identify_drawing import draw

            with aside(files[2]) as png:
                save(png, draw, found)
    answer(options, content, *_lines(options.output, found), *said, *(f"note: {note}" for note in notes))
    return 0


def _start(options: argparse.Namespace, how: BagSetup, is_tir: bool) -> TireWheelUnit:
    from ..replay.parameters import unit_of

    if not is_tir:
        return unit_of(how.values)
    if options.wheel_mass is None or options.suspension_stiffness is None:
        raise InputError(f"{options.start}: no .tir has them; give --wheel-mass and --suspension-stiffness")
    from ..files.tir_unit import unit_from_tir

    try:
        made = unit_from_tir(
            options.start, wheel_mass=options.wheel_mass, suspension_stiffness=options.suspension_stiffness
        )
        for doubt in made.doubts:
            print(printable(f"{options.start}: {doubt}"), file=sys.stderr)
        return made.unit
    except OSError as error:
        raise InputError(f"{options.start}: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(str(error)) from None


def prior_widths(options: argparse.Namespace, is_tir: bool) -> float | dict[str, float]:
    """Of the priors, by name where the unit to begin with is estimated: ``import-tir`` wrote its errors beside it.

    Parameters
    ----------
    options : argparse.Namespace
        ``start``, ``fit`` and ``prior_width`` are read.
    is_tir : bool
        Whether ``start`` is a tire property file.

    Raises
    ------
    InputError
        What is beside it is no file of errors.
    """
    beside = errors_file(Path(options.start)) if options.start and not is_tir else None
    if beside is None or not beside.is_file():
        return float(options.prior_width)
    try:
        if beside.stat().st_size > _LARGEST:
            raise ValueError
        content = json.loads(beside.read_text(encoding="utf-8"))
        widths = {str(name): float(width) for name, width in content.get("prior_widths", {}).items()}
        if not all(0.0 < width < math.inf for width in widths.values()):
            raise ValueError
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        raise InputError(f"{beside}: is no file of errors, as import-tir or identify write one") from None
    return {**{name.strip(): float(options.prior_width) for name in options.fit.split(",")}, **widths}


# -- the bag ------------------------------------------------------------------------------------------------------


def read(reader: BagReader, how: BagSetup, options: argparse.Namespace) -> tuple[Recording, list[str]]:
    """The samples of one wheel, and what is to be said about them.

    Parameters
    ----------
    reader : BagReader
    how : BagSetup
        As :func:`.bag_setup.bag_setup` gives it.
    options : argparse.Namespace
        ``measured``, ``wheel``, ``begin``, ``end`` and ``quiet`` are read.

    Raises
    ------
    InputError
        The bag lacks a topic, or it has too little on it.
    """
    import numpy as np

    from ..cdr import messages
    from ..estimator.identification import Recording
    from ..replay.input_map import sources
    from ..replay.series import series_of

    wheels = how.values["wheels"]
    wheel = options.wheel or (wheels[0] if len(wheels) == 1 else None)
    if wheel not in wheels:
        which = "is needed, for there are several" if wheel is None else f"is {wheel[:100]!r}"
        raise InputError(f"--wheel {which}; it must be one of {', '.join(wheels)}")
    topic = f"/{options.measured.lstrip('/')}"
    if reader.topics.get(topic) != messages.WRENCH_STAMPED:
        what = f"is {reader.topics[topic]}" if topic in reader.topics else "is not there"
        wrenches = [name for name, kind in reader.topics.items() if kind == messages.WRENCH_STAMPED]
        known = ", ".join(sorted(wrenches)) or "none"
        raise InputError(f"{reader.path}: {topic} {what}; topics of {messages.WRENCH_STAMPED}: {known}")
    if how.values["load_source"] == "road":
        raise InputError(
            f"{reader.path}: its tires stand on a road, and their loads are the model's own answer; "
            "identify takes bags whose loads were measured"
        )
    if how.values["load_source"] == "estimate":
        raise InputError(
            f"{reader.path}: its loads are estimated, and known up to some 20 Hz at best, too low to tell a tire by; "
            f"measure the load, record it as {wheel}/load, and give a bag with that and load_source: topic"
        )
    mapped = {source.quantity for source in sources(how.values)}
    if mapped & {"speed", "load"}:
        raise InputError(
            f"{reader.path}: {' and '.join(name for name in ('speed', 'load') if name in mapped)} come by a field map, "
            f"which identify does not read; record joint_states or {wheel}/wheel_speed, and {wheel}/load"
        )
    names = {how.names[f"{wheel}/{name}"]: name for name in ("wheel_speed", "load", "load_force")}
    names |= {how.names["joint_states"]: "joint_states", topic: "measured"}
    joint = how.values["joint_names"][wheels.index(wheel)]
    columns, unreadable = series_of(reader, names, joint, options.quiet)
    notes = [f"{name}: {count} messages are not what their type says" for name, count in unreadable.items() if count]
    bounds = {"speed": how.values["max_speed_rad_s"], "load": how.values["max_load_n"], "force": MOST_FORCE}
    series: dict[str, Any] = {}
    for name, bound in bounds.items():
        rows, stamped = columns[name]
        good = np.isfinite(rows).all(axis=1) & (np.abs(rows[:, 2:]) <= bound).all(axis=1)
        if not good.all():
            notes.append(f"{name}: {int((~good).sum())} samples are not finite or beyond {bound:g}, and left out")
        if good.sum() < 2:
            raise InputError(
                f"{reader.path}: the {name} has {int(good.sum())} samples that can be used; that is too few"
            )
        if not stamped:
            notes.append(f"{name}: has no stamps; its samples count from their receipt")
        rows = rows[good]
        _, first = np.unique(rows[:, 0], return_index=True)
        series[name] = rows[first]
    origin = max(float(rows[0, 0]) for rows in series.values())
    last = min(float(rows[-1, 0]) for rows in series.values())
    if not origin < last:
        raise InputError(f"{reader.path}: speed, load and force are never there at the same time; look at their stamps")
    begin = options.begin
    end = last - origin if options.end is None else options.end
    if not 0.0 <= begin < end:
        raise InputError(f"--from is {begin:g} and --to {end:g}; the drive has speed, load and force for {end:g} s")
    if min(end, last - origin) - begin > LONGEST:
        raise InputError(
            f"{reader.path}: has {last - origin:.0f} s to fit; --from and --to must leave at most {LONGEST:.0f} s"
        )
    for name, rows in series.items():
        rows = rows[(rows[:, 0] >= origin + begin - 0.5) & (rows[:, 0] <= origin + end + 0.5)]
        if len(rows) < 2:
            raise InputError(f"{reader.path}: the {name} has {len(rows)} samples in that time; that is too few")
        series[name] = rows
    speed, load, force = series["speed"], series["load"], series["force"]
    record = Recording(
        speed[:, 0] - origin,
        speed[:, 2],
        load[:, 0] - origin,
        load[:, 2],
        load[:, 3],
        force[:, 0] - origin,
        force[:, 2:],
    )
    return record, notes


# -- what is said -------------------------------------------------------------------------------------------------


def statements(found: Identification) -> list[str]:
    """What the data cannot tell, in words.

    Parameters
    ----------
    found : Identification

    Returns
    -------
    list of str
        A sentence each.
    """
    said = []
    for name, error in zip(found.names, found.errors, strict=True):
        if name in found.at_bound:
            said.append(f"{name} ended at the end of its range: no value fits, or the unit is not of this kind")
        elif name in found.priors:
            said.append(f"{name} is the prior's: the data say next to nothing about it")
        elif error > LARGE:
            said.append(f"{name} is known no better than to {error:.0%}")
    scale = {"density", "k_1", "wheel_mass", "suspension_stiffness"}
    if scale <= set(found.names):
        said.append(
            "density, k_1, wheel_mass and suspension_stiffness are known but for a common factor, which is the "
            "prior's: forces over forces show ratios; hold one of them"
        )
    for group, least in _tied(found):
        said.append(
            f"{', '.join(group[:-1])} and {group[-1]} are tied (correlation {least:.3f}): the data know a combination "
            "of them far better than each; hold one that is known otherwise"
        )
    for name, error, bias in zip(found.names, found.errors, found.bias, strict=True):
        if abs(bias) > 0.5 * error:
            said.append(
                f"{name}: the load may have {found.load_noise:.2g} N rms of white noise, which would move it by "
                f"{bias:+.1%}: that is in the error; --load-noise says what it has"
            )
    band = _band(found)
    if band is not None:
        said.append(
            f"load and force are coherent (> 0.5) from {band[0]:.3g} to {band[1]:.3g} Hz; the rest tells little"
        )
    if min(found.explained) < 0.5:
        said.append("the model explains less than half of the force: the errors mean nothing")
    if found.unexplained > 0.1:
        said.append(
            f"{found.unexplained:.0%} of what the model leaves follows the load: the model, a fixed field or --between "
            "is not the vehicle's, and the errors leave that out"
        )
    return said


def _tied(found: Identification) -> list[tuple[list[str], float]]:
    """Groups of parameters that hang together by correlations beyond ``TIED``, and the highest of each."""
    import numpy as np

    size = np.abs(found.correlation) * (1.0 - np.eye(len(found.names)))
    groups: list[set[int]] = []
    for i, j in zip(*np.nonzero(np.triu(size > TIED)), strict=True):
        joined = {int(i), int(j)}.union(*(group for group in groups if group & {int(i), int(j)}))
        groups = [group for group in groups if not group & joined] + [joined]
    return [
        ([found.names[k] for k in sorted(group)], float(size[np.ix_(sorted(group), sorted(group))].max()))
        for group in groups
    ]


def _band(found: Identification) -> tuple[float, float] | None:
    import numpy as np

    transfer = found.seen[0].transfer
    inside = np.flatnonzero(transfer.coherence > 0.5)
    if not inside.size:
        return None
    return float(transfer.frequency[inside[0]]), float(transfer.frequency[inside[-1]])


def _lines(output: str, found: Identification) -> list[str]:
    from ..science.uncertainty import value_of

    explained = ", ".join(
        f"{share:.2%} of force.{'xz'[axis]}" for axis, share in zip(found.axes, found.explained, strict=True)
    )
    pieces = f"{found.sections} piece{'s' * (found.sections > 1)}"
    lines = [f"{output}: {found.seconds:.1f} s in {pieces}; the model explains {explained}"]
    lines.append(f"  {'':26} {'estimate':>12} {'error':>8}   {'started from':>12}")
    for name, value, error in zip(found.names, found.values, found.errors, strict=True):
        lines.append(f"  {name:26} {value:12.5g} {100.0 * error:6.2g} %   {value_of(found.start, name):12.5g}")
    lines.append(f"  {'delay after the load [ms]':26} {1e3 * found.delay:12.4g} +- {1e3 * found.delay_error:.2g}")
    lines.append(f"  {'gain over the load':26} {found.gain:12.5g} +- {found.gain_error:.2g}")
    for axis, offset, error, noise in zip(found.axes, found.offset, found.offset_error, found.noise, strict=True):
        name = f"offset of force.{'xz'[axis]} [N]"
        lines.append(f"  {name:26} {offset:12.4g} +- {error:.2g}   noise {noise:.3g} N rms")
    return lines


def _content(found: Identification) -> dict[str, Any]:
    band = _band(found)
    return {
        "unit": found.unit.to_mapping(),
        "start": found.start.to_mapping(),
        "fields": list(found.names),
        "values": found.values.tolist(),
        "relative_errors": found.errors.tolist(),
        "relative_errors_without_prior": found.from_data.tolist(),
        "correlation": found.correlation.tolist(),
        "prior_width": found.prior_width.tolist(),
        "of_the_prior": list(found.priors),
        "at_bound": list(found.at_bound),
        "delay_of": "the measured force after the load's channel",
        "delay_s": found.delay,
        "delay_error_s": found.delay_error,
        "gain": found.gain,
        "gain_error": found.gain_error,
        "load_noise_rms_N": found.load_noise,
        "relative_bias_of_load_noise": found.bias.tolist(),
        "axes": ["xz"[axis] for axis in found.axes],
        "offset_N": found.offset.tolist(),
        "offset_error_N": found.offset_error.tolist(),
        "noise_rms_N": found.noise.tolist(),
        "explained": found.explained.tolist(),
        "unexplained_coherent": found.unexplained,
        "seconds": found.seconds,
        "samples": found.samples,
        "sections": found.sections,
        "coherent_band_Hz": None if band is None else list(band),
        "spectra": [
            {
                "speed_rad_s": each.speed,
                "segments": each.transfer.segments,
                "frequency_Hz": each.transfer.frequency.tolist(),
                "coherence": each.transfer.coherence.tolist(),
                "ratio": abs(each.transfer.response).tolist(),
            }
            for each in found.seen
        ],
    }


def yaml_of(found: Identification, name: str, errors: str) -> str:
    """The unit as ``read_unit`` reads it; what was fitted has a comment with its error."""
    from ..files.yaml_file import yaml_value
    from ..science.uncertainty import value_of

    title = name if name.isprintable() else ascii(name)
    lines = [f"# A unit by `tire-dynamics identify`, from {title}. SI units; config/table_1.yaml explains the fields."]
    lines += [f"# Errors are standard errors. {errors} has them with their correlation, for `stability --samples`."]
    comments = {
        field: f"fitted, +- {100.0 * error:.2g} %, from {value_of(found.start, field):.6g}"
        for field, error in zip(found.names, found.errors, strict=True)
    }
    if "k_1" in comments:
        whole = (
            f"fitted by k_1 = {found.unit.sidewall_stiffness:.6g} N/m, {comments.pop('k_1').removeprefix('fitted, ')}"
        )
        comments |= {"radial_stiffness": whole, "tangential_stiffness": whole}
    for field, value in found.unit.to_mapping().items():
        text = f"{field}: {yaml_value(value)}"
        lines.append(f"{text:44} # {comments[field]}" if field in comments else text)
    return "\n".join(lines) + "\n"
