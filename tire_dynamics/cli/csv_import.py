"""``tire-dynamics import``: CSV recordings of wheel speeds and loads into an input bag.

numpy and bags are imported where they are needed: the command line loads this module for its options.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.csv_table import ROS_TIME_S, TIME_UNITS, Column, Table, is_unit, read_table, unit_named
from ..files.errors import InputError
from ..files.plausibility import GRAVITY, RECORD, Plausibility, acceleration_doubts
from ..files.progress import progress
from .answer import answer, printable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["RECORD", "add_arguments", "run"]


_ANGULAR = {"rad/s": (1.0, ""), "rpm": (math.pi / 30.0, " * pi/30"), "rev/s": (2.0 * math.pi, " * 2 pi")}
_ANGULAR["deg/s"] = (math.pi / 180.0, " * pi/180")
_ROLLING = {"m/s": (1.0, ""), "km/h": (1.0 / 3.6, " / 3.6"), "mph": (0.44704, " * 0.44704")}
_FORCES = {"N": (1.0, ""), "kN": (1e3, " * 1000"), "daN": (10.0, " * 10"), "lbf": (4.4482216152605, " * 4.44822")}
_FORCES["kgf"] = (GRAVITY, f" * {GRAVITY}")
_ACCELERATIONS = {"m/s^2": (1.0, ""), "g": (GRAVITY, f" * {GRAVITY}")}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options, but for those of ``answer``."""
    parser.description = (
        "Makes an input bag of /joint_states and /<wheel>/load from two CSV files, or from one given twice. The line "
        "with the columns' names is found behind whatever stands before it; commas, semicolons, tabs, decimal commas, "
        "a row of units, comments and dates are recognised, and what was is said. A blank cell is no sample; rows that "
        "cannot be used are left out and counted; rows out of order are sorted by time. Doubtful values, such as "
        "a load in kN, are named. With --forces the bag is replayed at once."
    )
    speed = parser.add_argument_group("wheel speeds")
    speed.add_argument("--speed", metavar="FILE", help="CSV file of the wheel speeds")
    speed.add_argument("--speed-columns", metavar="WHEEL=COLUMN", nargs="+", help="each wheel and its column")
    speed.add_argument(
        "--speed-unit",
        choices=(*_ANGULAR, *_ROLLING),
        help="default: what the header says, else rad/s",
    )
    speed.add_argument("--rolling-radius", metavar="M", type=float, help="[m], to make rad/s of m/s, km/h or mph")
    speed.add_argument("--speed-time-column", metavar="COLUMN", help="times of this file, if not --time-column")
    load = parser.add_argument_group("wheel loads")
    load.add_argument("--load", metavar="FILE", help="CSV file of the vertical loads")
    load.add_argument(
        "--load-columns",
        metavar="[WHEEL=]COLUMN",
        nargs="+",
        help="each wheel and its column, or one column for every wheel",
    )
    load.add_argument(
        "--load-unit",
        choices=(*_FORCES, *_ACCELERATIONS),
        help="a force, up positive, or with m/s^2 and g an acceleration: the load is estimated as corner mass times "
        "|acceleration|, gravity included; default: what the header says, else N",
    )
    load.add_argument(
        "--corner-mass",
        metavar="KG",
        type=float,
        help="[kg], to estimate N from an acceleration; where the loads are forces, to compare them with its weight",
    )
    load.add_argument("--load-time-column", metavar="COLUMN", help="times of this file, if not --time-column")
    time = parser.add_argument_group("time")
    time.add_argument(
        "--time-column", metavar="COLUMN", help="in both files; default: the first column, or the one called time"
    )
    time.add_argument(
        "--time-unit",
        choices=tuple(TIME_UNITS),
        help="of times that are numbers; default: what the header says, or what fits times since 1970, else s",
    )
    time.add_argument(
        "--start-time",
        metavar="S",
        help="move the first sample to this time, seconds since the epoch; default: times stay as recorded",
    )
    whole = parser.add_argument_group("any quantities")
    whole.add_argument(
        "--inputs",
        metavar="YAML",
        help="instead of all these: a field map, whose topics are CSV files beside it and whose fields are their "
        "columns; stamp is the column of time, with its unit behind it",
    )
    parser.add_argument("-o", "--output", metavar="OUT", required=True, help="the rosbag2 folder to write")
    parser.add_argument("--force", action="store_true", help="replace what exists of OUT and FORCES")
    forces = parser.add_argument_group("forces")
    forces.add_argument("--forces", metavar="FORCES", help="replay OUT into this rosbag2 folder")
    forces.add_argument("--config", metavar="YAML", help="with these tires: parameters of the node, or a unit's fields")


def run(options: argparse.Namespace) -> int:
    """Do the import that the options ask for, and say on standard error what was made and what was left out.

    ``InputError``: if the options contradict each other, a file or column cannot be used, or the output exists.
    """
    _check_forces(options)
    if options.inputs is not None:
        from . import map_import

        map_import.run(options)
        if options.forces is not None:
            _replayed(options)
        return 0
    absent = [name for name in ("speed", "speed_columns", "load", "load_columns") if getattr(options, name) is None]
    if absent:
        names = ", ".join(f"--{name.replace('_', '-')}" for name in absent)
        raise InputError(f"needs {names}, or --inputs (see tire-dynamics import --help)")
    speed_columns = _speed_columns(options.speed_columns)
    wheels = list(speed_columns)
    load_columns = _load_columns(options.load_columns, wheels)
    for value, option in ((options.rolling_radius, "--rolling-radius"), (options.corner_mass, "--corner-mass")):
        if value is not None and not 0.0 < value < math.inf:
            raise InputError(f"{option} is {value:g}; it must be > 0 and finite")

    clocks = options.speed_time_column or options.time_column, options.load_time_column or options.time_column
    speed = read_table(Path(options.speed), list(speed_columns.values()), clocks[0], options.time_unit)
    load = read_table(Path(options.load), list(load_columns.values()), clocks[1], options.time_unit)
    speed_unit, load_unit = _unit(options.speed_unit, speed, "speed"), _unit(options.load_unit, load, "load")
    speed_formula, load_formula = _formulas(options, speed_unit, load_unit)
    _move_to(options.start_time, speed, load)

    velocities = _angular_speeds(options, speed_unit, speed.values)
    forces = _forces(options, load_unit, load.values)
    doubts = [*speed.doubts, *load.doubts, *_doubts(options, wheels, speed, velocities, load, forces, load_unit)]
    note = {
        "speed": f"{speed_formula}; {speed.path.name}: {_listed(speed_columns)}",
        "load": f"{load_formula}; {load.path.name}: {_listed(load_columns)}",
    }
    if doubts:
        note["doubts"] = "; ".join(doubts)
    _write(options, wheels, (speed.times, velocities), (load.times, forces), note)

    replayed = _replayed(options) if options.forces is not None else None
    remarks = [*dict.fromkeys([*speed.notes, *load.notes]), *speed.remarks(), *load.remarks()]
    remarks += [f"doubtful: {doubt}" for doubt in doubts]
    if options.json or options.quiet:  # else they are part of what is said
        for remark in remarks:
            print(printable(remark), file=sys.stderr)
    answer(
        options,
        {
            "output": options.output,
            "wheels": wheels,
            "speed": {**_account(speed), "unit": speed_unit},
            "load": {**_account(load), "unit": load_unit},
            "formulas": {name: note[name] for name in ("speed", "load")},
            "doubts": doubts,
            "forces": options.forces,
        },
        *remarks,
        f"{options.output}: {len(wheels)} wheels, {len(speed.times)} speeds {_span(speed)}, "
        f"{len(load.times)} loads {_span(load)}",
        note["speed"],
        note["load"],
        *([] if replayed is None else [f"{options.forces}: {replayed} messages"]),
    )
    return 0


def _check_forces(options: argparse.Namespace) -> None:
    """That what the replay takes can be used, before anything is written."""
    from ..files.outputs import writable
    from ..replay.parameters import read_config

    if options.config is not None:
        if options.forces is None:
            raise InputError("--config belongs to --forces, which is not given")
        read_config(options.config)
    if options.forces is None:
        return
    if Path(options.forces).resolve() == Path(options.output).resolve():
        raise InputError(f"--forces is {options.forces}, which is also the output of the import")
    writable(Path(options.forces), force=options.force)


def _replayed(options: argparse.Namespace) -> int:
    """How many messages the replay of the bag wrote."""
    from ..replay.replay import replay

    done = replay(options.output, options.forces, config=options.config, force=options.force, quiet=options.quiet)
    return sum(done.written.values())


def _unit(option: str | None, table: Table, quantity: str) -> str:
    """The unit of a table's values: that of the option, else of the header, else rad/s or N."""
    said: dict[str, list[str]] = {}
    for column in table.columns:
        if column.unit:
            said.setdefault(unit_named(quantity, column.unit) or column.unit, []).append(column.name)
    name = table.path.name
    known = [unit for unit in said if unit_named(quantity, unit) is not None]
    # What stands in brackets may be anything, a wheel's name too.
    strange = [unit for unit in said if unit not in known and is_unit(unit)]
    foreign = [f"{unit!r} of {', '.join(dict.fromkeys(said[unit]))}" for unit in strange]
    if foreign:
        table.doubts.append(f"{name}: the header's unit {' and '.join(foreign)} is none of a {quantity} that is known")
    if option is None and len(known) > 1:
        listed = "; ".join(f"{unit}: {', '.join(dict.fromkeys(said[unit]))}" for unit in known)
        raise InputError(
            f"{table.path}: the columns have different units ({listed}); convert one, or import them apart"
        )
    chosen = option or next(iter(known), "rad/s" if quantity == "speed" else "N")
    if option is None and known and known != ["rad/s"] and known != ["N"]:
        table.notes.append(f"{name}: the {quantity} is in {known[0]}, as its header says")
    for unit in known:
        if unit != chosen:
            table.doubts.append(f"{name}: the header says {unit}, and --{quantity}-unit {chosen}, which counts")
    sounds = {column.name: _unit_in_name(column, quantity) for column in ([] if said else table.columns)}
    other = [f"{column!r}" for column, unit in sounds.items() if unit not in (None, chosen)]
    if other:
        table.doubts.append(f"{name}: by their names {', '.join(other)} have another unit than {chosen}, which counts")
    return chosen


_TAIL = re.compile(r"(?i)_(rad_s|rpm|rps|deg_s|kmh|kph|mph|m_s|mps|kn|n|lbf|kgf|g|m_s2|ms2)")


def _unit_in_name(column: Column, quantity: str) -> str | None:
    """Of ``speed_rad_s``, which says so in its last letters."""
    tail = next((match[1] for k in range(len(column.name)) if (match := _TAIL.fullmatch(column.name, k))), None)
    return unit_named(quantity, tail) if tail else None


def _doubts(
    options: argparse.Namespace,
    wheels: Sequence[str],
    speed: Table,
    velocities: NDArray[np.float64],
    load: Table,
    forces: NDArray[np.float64],
    load_unit: str,
) -> list[str]:
    estimated = load_unit in _ACCELERATIONS
    found = []
    if estimated:
        for place, name in enumerate(dict.fromkeys(column.name for column in load.columns)):
            found += acceleration_doubts(name, load.values[:, place], GRAVITY / _ACCELERATIONS[load_unit][0])
    seen = Plausibility(None if options.corner_mass is None or found else options.corner_mass * GRAVITY)
    for place, wheel in enumerate(wheels):
        seen.speeds(wheel, speed.times, velocities[:, place])
        seen.loads(wheel, load.times, forces[:, place])
    return found + (seen.doubts() if not found else [each for each in seen.doubts() if "load" not in each])


def _listed(columns: Mapping[str, str]) -> str:
    return ", ".join(dict.fromkeys(columns.values()))


def _speed_columns(pairs: Sequence[str]) -> dict[str, str]:
    columns: dict[str, str] = {}
    for pair in pairs:
        wheel, equals, column = pair.partition("=")
        if not equals or not column or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", wheel):
            raise InputError(f"--speed-columns: {pair!r} is not WHEEL=COLUMN with a ROS name for the wheel")
        if wheel in columns:
            raise InputError(f"--speed-columns: {wheel} stands there twice")
        columns[wheel] = column
    return columns


def _load_columns(pairs: Sequence[str], wheels: Sequence[str]) -> dict[str, str]:
    """Column by wheel; a single bare column is every wheel's."""
    if len(pairs) == 1 and "=" not in pairs[0]:
        return dict.fromkeys(wheels, pairs[0])
    columns: dict[str, str] = {}
    for pair in pairs:
        wheel, equals, column = pair.partition("=")
        if not equals or not column:
            raise InputError(f"--load-columns: {pair!r} is not WHEEL=COLUMN; without WHEEL= it must be alone")
        if wheel in columns:
            raise InputError(f"--load-columns: {wheel} stands there twice")
        columns[wheel] = column
    if set(columns) != set(wheels):
        raise InputError(f"--load-columns: has {', '.join(columns)}, but --speed-columns has {', '.join(wheels)}")
    return columns


def _angular_speeds(options: argparse.Namespace, unit: str, speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Speeds [rad/s] of speeds in the file's unit."""
    if unit in _ANGULAR:
        return speeds if unit == "rad/s" else speeds * _ANGULAR[unit][0]
    return (speeds if unit == "m/s" else speeds * _ROLLING[unit][0]) / options.rolling_radius


def _forces(options: argparse.Namespace, unit: str, loads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Loads [N] of loads in the file's unit."""
    if unit in _FORCES:
        return loads if unit == "N" else loads * _FORCES[unit][0]
    return options.corner_mass * abs(loads if unit == "m/s^2" else loads * _ACCELERATIONS[unit][0])


def _formulas(options: argparse.Namespace, speed_unit: str, load_unit: str) -> tuple[str, str]:
    """What is done to speeds and loads, in words; ``InputError`` if the options do not fit together."""
    radius, mass = options.rolling_radius, options.corner_mass
    _check_factor(radius, "--rolling-radius", "speed", speed_unit, _ROLLING)
    if load_unit in _ACCELERATIONS:  # beside forces, it is only what they are compared with
        _check_factor(mass, "--corner-mass", "load", load_unit, _ACCELERATIONS)
    if radius is not None:
        speed = f"speed [{speed_unit}]{_ROLLING[speed_unit][1]} / {radius:g} m, the rolling radius"
    else:
        speed = f"speed [{speed_unit}]{_ANGULAR[speed_unit][1]}"
    if load_unit in _ACCELERATIONS:
        acceleration = f"|acceleration [{load_unit}]|{_ACCELERATIONS[load_unit][1]}"
        load = f"{mass:g} kg * {acceleration}, an estimate from the mass that the corner carries"
    else:
        load = f"load [{load_unit}]{_FORCES[load_unit][1]}"
    return f"velocity [rad/s] = {speed}", f"force.z [N] = {load}"


def _check_factor(value: float | None, option: str, quantity: str, unit: str, units: Iterable[str]) -> None:
    if unit in units and value is None:
        raise InputError(f"--{quantity}-unit {unit} needs {option}")
    if value is not None and unit not in units:
        raise InputError(f"{option} goes with --{quantity}-unit {' or '.join(units)}; the {quantity} is in {unit}")


def _move_to(start_time: str | None, speed: Table, load: Table) -> None:
    """Let the recording begin at its start time; see that ROS has its times and that the files overlap."""
    first = min(speed.times[0], load.times[0])
    if start_time is not None:
        try:
            start = Decimal(start_time)
            if not 0 <= start < ROS_TIME_S:
                raise ValueError
        except (ArithmeticError, ValueError):
            raise InputError(
                f"--start-time is {start_time!r}; it must be seconds since the epoch, below {ROS_TIME_S}"
            ) from None
        for table in (speed, load):
            table.times += int(start.scaleb(9).to_integral_value()) - first
    for table in (speed, load):
        if table.times[0] < 0 or table.times[-1] >= ROS_TIME_S * 10**9:
            raise InputError(
                f"{table.path}: times run {_span(table)}; ROS has 0 s to {ROS_TIME_S} s "
                "(--start-time moves them, --time-unit is their unit)"
            )
    if speed.times[0] > load.times[-1] or load.times[0] > speed.times[-1]:
        raise InputError(f"{speed.path} runs {_span(speed)}, {load.path} {_span(load)}: they have no time in common")


def _account(table: Table) -> dict[str, Any]:
    """What came of a file."""
    begin, end = table.times[[0, -1]].tolist()
    return {
        "file": str(table.path),
        "rows": len(table.times),
        "begin_s": begin / 1e9,
        "end_s": end / 1e9,
        "columns_in_line": table.header,
        "time_column": table.time.name,
        "left_out": table.unusable,
        "first_left_out": table.first_unusable or None,
        "out_of_order": table.unsorted,
        "rows_of_others": table.others,
        "notes": table.notes,
    }


def _span(table: Table) -> str:
    return f"from {table.times[0] / 1e9:.3f} s to {table.times[-1] / 1e9:.3f} s"


def _write(
    options: argparse.Namespace,
    wheels: Sequence[str],
    speed: tuple[NDArray[np.int64], NDArray[np.float64]],
    load: tuple[NDArray[np.int64], NDArray[np.float64]],
    note: dict[str, str],
) -> None:
    """The bag: a message per row and topic, all its times those of the row, in order of time; none of a blank cell."""
    import numpy as np

    from ..bag import BagWriter
    from ..cdr.messages import JOINT_STATE, WRENCH_STAMPED, JointStateEncoder, WrenchEncoder

    (speed_times, speeds), (load_times, forces) = speed, load
    encoders: dict[bytes, JointStateEncoder] = {}
    there = ~np.isnan(speeds)
    wrenches = [WrenchEncoder(f"{wheel}_axle") for wheel in wheels]
    times = np.concatenate([speed_times, load_times])
    rows = np.argsort(times, kind="stable")  # of equal times, the speed first
    record = {RECORD: note}
    with BagWriter(options.output, force=options.force, aside=True, chunk_size=2**20, metadata=record) as bag:
        speed_topic = bag.add_topic("/joint_states", JOINT_STATE)
        load_topics = [bag.add_topic(f"/{wheel}/load", WRENCH_STAMPED) for wheel in wheels]
        for row in progress(rows.tolist(), len(rows), "import", unit="rows", quiet=options.quiet):
            t = int(times[row])
            if row < len(speeds):
                key = there[row].tobytes()
                if key not in encoders:
                    encoders[key] = JointStateEncoder(
                        [wheel for wheel, is_there in zip(wheels, there[row], strict=True) if is_there]
                    )
                bag.write(speed_topic, t, t, encoders[key].encode(t, speeds[row][there[row]].tolist()))
            else:
                loads = zip(load_topics, wrenches, forces[row - len(speeds)].tolist(), strict=True)
                for topic, wrench, force in loads:
                    if not math.isnan(force):
                        bag.write(topic, t, t, wrench.encode(t, 0.0, force))
