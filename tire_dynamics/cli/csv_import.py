"""``tire-dynamics import``: CSV recordings of wheel speeds and loads into an input bag.

numpy and bags are imported where they are needed: the command line loads this module for its options.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import math
import re
import sys
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from typing import TYPE_CHECKING, Any, TextIO

from ..files.errors import InputError, missing
from ..files.progress import progress
from .answer import answer, printable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["add_arguments", "run"]

RECORD = "tire_dynamics.import"  # name of the metadata record that says where the numbers come from

_TIME_UNITS = {"s": 9, "ms": 6, "us": 3, "ns": 0}  # decimal places of the unit in ns
_ROS_TIME_S = 2**31  # builtin_interfaces/Time holds an int32 of seconds
_MAX_LINE = 2**20  # characters
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options, but for those of ``answer``.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Its namespace is what ``run`` takes.
    """
    parser.description = (
        "Makes an input bag of /joint_states and /<wheel>/load from two CSV files that begin with a line of "
        "column names. Columns are separated by commas, semicolons or tabs; between semicolons or tabs, a "
        "comma in a number is its decimal point. Rows that cannot be used are left out and counted; rows out "
        "of order are sorted by time."
    )
    speed = parser.add_argument_group("wheel speeds")
    speed.add_argument("--speed", metavar="FILE", required=True, help="CSV file of the wheel speeds")
    speed.add_argument(
        "--speed-columns", metavar="WHEEL=COLUMN", nargs="+", required=True, help="each wheel and its column"
    )
    speed.add_argument("--speed-unit", choices=("rad/s", "rpm", "m/s"), default="rad/s", help="default rad/s")
    speed.add_argument("--rolling-radius", metavar="M", type=float, help="[m], to make rad/s of m/s")
    load = parser.add_argument_group("wheel loads")
    load.add_argument("--load", metavar="FILE", required=True, help="CSV file of the vertical loads")
    load.add_argument(
        "--load-columns",
        metavar="[WHEEL=]COLUMN",
        nargs="+",
        required=True,
        help="each wheel and its column, or one column for every wheel",
    )
    load.add_argument(
        "--load-unit",
        choices=("N", "m/s^2"),
        default="N",
        help="N, up positive (default), or m/s^2: the load is estimated as corner mass times |acceleration|, "
        "gravity included",
    )
    load.add_argument("--corner-mass", metavar="KG", type=float, help="[kg], to estimate N from m/s^2")
    time = parser.add_argument_group("time")
    time.add_argument("--time-column", metavar="COLUMN", help="in both files; default: the first column")
    time.add_argument("--time-unit", choices=tuple(_TIME_UNITS), default="s", help="default s")
    time.add_argument(
        "--start-time",
        metavar="S",
        help="move the first sample to this time, seconds since the epoch; default: times stay as recorded",
    )
    parser.add_argument("-o", "--output", metavar="OUT", required=True, help="the rosbag2 folder to write")
    parser.add_argument("--force", action="store_true", help="replace OUT if it exists")


def run(options: argparse.Namespace) -> int:
    """Do the import that the options ask for, and say on standard error what was made and what was left out.

    Parameters
    ----------
    options : argparse.Namespace
        As ``add_arguments`` declares it, and that of ``answer``.

    Returns
    -------
    int
        Exit status 0.

    Raises
    ------
    InputError
        If the options contradict each other, a file or column cannot be used, or the output exists.
    """
    speed_columns = _speed_columns(options.speed_columns)
    wheels = list(speed_columns)
    load_columns = _load_columns(options.load_columns, wheels)
    speed_formula, load_formula = _formulas(options)

    time = options.time_column, options.time_unit
    speed = _read(Path(options.speed), list(speed_columns.values()), *time)
    load = _read(Path(options.load), list(load_columns.values()), *time)
    _move_to(options.start_time, speed, load)

    note = {
        "speed": f"{speed_formula}; {speed.path.name}: {_listed(speed_columns)}",
        "load": f"{load_formula}; {load.path.name}: {_listed(load_columns)}",
    }
    _write(options, wheels, speed, load, note)

    remarks = [remark for table in (speed, load) for remark in table.remarks()]
    if options.json or options.quiet:  # else they are part of what is said
        for remark in remarks:
            print(printable(remark), file=sys.stderr)
    answer(
        options,
        {
            "output": options.output,
            "wheels": wheels,
            "speed": _account(speed),
            "load": _account(load),
            "formulas": note,
        },
        *remarks,
        f"{options.output}: {len(wheels)} wheels, {len(speed.times)} speeds {_span(speed)}, "
        f"{len(load.times)} loads {_span(load)}",
        *note.values(),
    )
    return 0


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


def _angular_speeds(options: argparse.Namespace, speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Speeds [rad/s] of speeds in the file's unit."""
    if options.speed_unit == "m/s":
        return speeds / options.rolling_radius
    if options.speed_unit == "rpm":
        return speeds * (math.pi / 30.0)
    return speeds


def _forces(options: argparse.Namespace, loads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Loads [N] of loads in the file's unit."""
    if options.load_unit == "m/s^2":
        return options.corner_mass * abs(loads)
    return loads


def _formulas(options: argparse.Namespace) -> tuple[str, str]:
    """What is done to speeds and loads, in words; ``InputError`` if the options do not fit together."""
    radius, mass = options.rolling_radius, options.corner_mass
    _check_factor(radius, "--rolling-radius", "--speed-unit m/s", options.speed_unit == "m/s")
    _check_factor(mass, "--corner-mass", "--load-unit m/s^2", options.load_unit == "m/s^2")
    if radius is not None:
        speed = f"speed [m/s] / {radius:g} m, the rolling radius"
    else:
        speed = "speed [rpm] * pi/30" if options.speed_unit == "rpm" else "speed [rad/s]"
    if mass is not None:
        load = f"{mass:g} kg * |acceleration [m/s^2]|, an estimate from the mass that the corner carries"
    else:
        load = "load [N]"
    return f"velocity [rad/s] = {speed}", f"force.z [N] = {load}"


def _check_factor(value: float | None, option: str, unit: str, needed: bool) -> None:
    if needed and value is None:
        raise InputError(f"{unit} needs {option}")
    if value is not None and not needed:
        raise InputError(f"{option} goes with {unit} only")
    if value is not None and not 0.0 < value < math.inf:
        raise InputError(f"{option} is {value:g}; it must be > 0 and finite")


@dataclass
class _Table:
    """The usable rows of a file, in order of time."""

    path: Path
    times: NDArray[np.int64]  # (N,), ns
    values: NDArray[np.float64]  # (N, columns), in the file's unit
    unsorted: int  # rows earlier than the row above them
    unusable: int  # rows left out
    first_unusable: str  # where and why

    def remarks(self) -> Iterator[str]:
        if self.unusable:
            yield f"{self.path.name}: {self.unusable} rows left out; the first is {self.first_unusable}"
        if self.unsorted:
            yield f"{self.path.name}: {self.unsorted} rows out of order, sorted by time"


def _read(path: Path, columns: Sequence[str], time_column: str | None, time_unit: str) -> _Table:
    try:
        mode = path.stat().st_mode
        if not (S_ISREG(mode) or S_ISDIR(mode)):  # a pipe that nobody writes to would be waited for
            raise InputError(f"{path}: is not a file")
        # Names of columns may be in any encoding; the numbers are the same bytes in all of them.
        with open(path, encoding="utf-8-sig", errors="replace", newline="") as file:
            return _parse(path, file, columns, time_column, time_unit)
    except FileNotFoundError:
        raise missing(path) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except csv.Error as error:
        raise InputError(f"{path}: is not CSV: {error}") from None


def _parse(path: Path, file: TextIO, columns: Sequence[str], time_column: str | None, time_unit: str) -> _Table:
    import numpy as np

    head = file.readline(_MAX_LINE)
    if not head:
        raise InputError(f"{path}: is empty")
    if len(head) == _MAX_LINE or "\0" in head:
        raise InputError(f"{path}: is not a text file with lines of columns")
    delimiter = max(",;\t", key=head.count)
    rows = csv.reader(itertools.chain([head], file), delimiter=delimiter, skipinitialspace=True)
    names = [name.strip() for name in next(rows)]
    if all(_NUMBER.fullmatch(name) for name in names):
        raise InputError(f"{path}: its first line must be the columns' names; it is {head.strip()[:60]!r}")
    places = [0 if time_column is None else _place(path, names, time_column)]
    places += [_place(path, names, name) for name in columns]

    decimals = _TIME_UNITS[time_unit]
    latest = Decimal(_ROS_TIME_S).scaleb(9 - decimals)
    times, values = array("q"), array("d")
    unusable, first_unusable = 0, ""
    for row in rows:
        if not row:
            continue  # a blank line
        if delimiter != ",":
            row = [cell.replace(",", ".") for cell in row]
        try:
            time = Decimal(row[places[0]])
            sample = [float(row[place]) for place in places[1:]]
            usable = time.is_finite() and abs(time) < latest and all(map(math.isfinite, sample))
        except (ValueError, ArithmeticError, IndexError):
            usable = False
        if usable:
            # In decimals to the last digit: seconds since the epoch have more of them than a float has.
            times.append(int(time.scaleb(decimals).to_integral_value()))
            values.extend(sample)
        else:
            unusable += 1
            first_unusable = first_unusable or f"line {rows.line_num}: {_why_unusable(row, places, names)}"
    if not times:
        why = f"; the first is {first_unusable}" if unusable else ""
        raise InputError(f"{path}: has no usable row{why}")
    t = np.array(times, np.int64)
    order = np.argsort(t, kind="stable")
    x = np.array(values).reshape(len(t), len(columns))
    unsorted = int(np.count_nonzero(np.diff(t) < 0))
    return _Table(path, t[order], x[order], unsorted, unusable, first_unusable)


def _place(path: Path, names: Sequence[str], name: str) -> int:
    if names.count(name) != 1:
        problem = "stands twice" if name in names else "is not there"
        raise InputError(f"{path}: column {name!r} {problem}; the columns are {str(list(names))[:200]}")
    return names.index(name)


def _why_unusable(row: Sequence[str], places: Sequence[int], names: Sequence[str]) -> str:
    if len(row) <= max(places):
        return f"it has {len(row)} columns of {len(names)}"
    for place in places:
        if not (_NUMBER.fullmatch(row[place].strip()) and math.isfinite(float(row[place]))):
            return f"{names[place]!r} is {row[place][:40]!r}"
    return f"{names[places[0]]!r} is {row[places[0]][:40]!r}, beyond the range of ROS time"


def _move_to(start_time: str | None, speed: _Table, load: _Table) -> None:
    """Let the recording begin at its start time; see that ROS has its times and that the files overlap."""
    first = min(speed.times[0], load.times[0])
    if start_time is not None:
        try:
            start = Decimal(start_time)
            if not 0 <= start < _ROS_TIME_S:
                raise ValueError
        except (ArithmeticError, ValueError):
            raise InputError(
                f"--start-time is {start_time!r}; it must be seconds since the epoch, below {_ROS_TIME_S}"
            ) from None
        for table in (speed, load):
            table.times += int(start.scaleb(9).to_integral_value()) - first
    for table in (speed, load):
        if table.times[0] < 0 or table.times[-1] >= _ROS_TIME_S * 10**9:
            raise InputError(
                f"{table.path}: times run {_span(table)}; ROS has 0 s to {_ROS_TIME_S} s "
                "(--start-time moves them, --time-unit is their unit)"
            )
    if speed.times[0] > load.times[-1] or load.times[0] > speed.times[-1]:
        raise InputError(f"{speed.path} runs {_span(speed)}, {load.path} {_span(load)}: they have no time in common")


def _account(table: _Table) -> dict[str, Any]:
    """What came of a file."""
    begin, end = table.times[[0, -1]].tolist()
    return {
        "file": str(table.path),
        "rows": len(table.times),
        "begin_s": begin / 1e9,
        "end_s": end / 1e9,
        "left_out": table.unusable,
        "first_left_out": table.first_unusable or None,
        "out_of_order": table.unsorted,
    }


def _span(table: _Table) -> str:
    return f"from {table.times[0] / 1e9:.3f} s to {table.times[-1] / 1e9:.3f} s"


def _write(
    options: argparse.Namespace, wheels: Sequence[str], speed: _Table, load: _Table, note: dict[str, str]
) -> None:
    """The bag: one message per row and topic, all its times those of the row, in order of time."""
    import numpy as np

    from ..bag import BagWriter
    from ..cdr.messages import JOINT_STATE, WRENCH_STAMPED, JointStateEncoder, WrenchEncoder

    speeds, forces = _angular_speeds(options, speed.values), _forces(options, load.values)
    joint_states = JointStateEncoder(wheels)
    wrenches = [WrenchEncoder(f"{wheel}_axle") for wheel in wheels]
    times = np.concatenate([speed.times, load.times])
    rows = np.argsort(times, kind="stable")  # of equal times, the speed first
    record = {RECORD: note}
    with BagWriter(options.output, force=options.force, aside=True, chunk_size=2**20, metadata=record) as bag:
        speed_topic = bag.add_topic("/joint_states", JOINT_STATE)
        load_topics = [bag.add_topic(f"/{wheel}/load", WRENCH_STAMPED) for wheel in wheels]
        for row in progress(rows.tolist(), len(rows), "import", unit="rows", quiet=options.quiet):
            t = int(times[row])
            if row < len(speeds):
                bag.write(speed_topic, t, t, joint_states.encode(t, speeds[row].tolist()))
            else:
                loads = zip(load_topics, wrenches, forces[row - len(speeds)], strict=True)
                for topic, wrench, force in loads:
                    bag.write(topic, t, t, wrench.encode(t, 0.0, force))
