"""Tables of samples in CSV files, however loggers write them: preambles, units, decimal commas, clocks, blank cells.

numpy is imported where it is needed: the command line loads this module for its options.
"""

from __future__ import annotations

import csv
import difflib
import math
import re
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from typing import TYPE_CHECKING, NamedTuple, TextIO

from .csv_times import ROS_TIME_S, Clock
from .csv_units import TIME_UNITS, is_known_unit, is_unit, unit_named
from .errors import InputError, missing

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["ROS_TIME_S", "TIME_UNITS", "Column", "Table", "is_unit", "read_table", "unit_named"]

_MAX_LINE = 2**20  # characters
_HEAD, _HEAD_SIZE = 500, 2**24  # lines, and characters, in which the columns' names must stand
_DELIMITERS = (",", ";", "\t")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_NOTHING = ("", "nan", "na", "n/a", "null", "none", "-nan", "#n/a")

_TIME_NAME = re.compile(
    r"(?i)[#%_\s]*(elapsed[ _]*)?(time([ _]?stamps?)?|t|utc|stamp|date[ _]?time|interval|seconds)([ _]([mun]?s|sec))?"
)


class Column(NamedTuple):
    """A column as the file has it.

    Attributes
    ----------
    name : str
        As it was asked for.
    place : int
    unit : str
        What the header says in a cell of its own, in brackets, or as RaceCapture does; "" if nothing.
    """

    name: str
    place: int
    unit: str


@dataclass
class Table:
    """The usable rows of a file, in order of time.

    Attributes
    ----------
    path : Path
    columns : list of Column
        Those that were asked for.
    time : Column
    header : int
        The line in which their names stand.
    times : ndarray of int, shape (N,)
        [ns]
    values : ndarray, shape (N, columns)
        In the file's unit; NaN where a cell is blank.
    unsorted : int
        Rows earlier than the row above them.
    unusable : int
        Rows left out.
    first_unusable : str
        Where and why.
    others : int
        Rows in which all of these columns are blank: those of other topics.
    notes : list of str
        What was recognised and how it is taken.
    doubts : list of str
        Doubtful values, one line each.
    """

    path: Path
    columns: list[Column]
    time: Column
    header: int
    times: NDArray[np.int64]
    values: NDArray[np.float64]
    unsorted: int
    unusable: int
    first_unusable: str
    others: int
    notes: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)

    def remarks(self) -> Iterator[str]:
        """What was left out, and what blank, one line each."""
        import numpy as np

        name = self.path.name
        if self.unusable:
            yield f"{name}: {self.unusable} rows left out; the first is {self.first_unusable}"
        if self.unsorted:
            yield f"{name}: {self.unsorted} rows out of order, sorted by time"
        blank = np.isnan(self.values).sum(axis=0)
        some = [f"{column.name} {count}" for column, count in zip(self.columns, blank.tolist(), strict=True) if count]
        if some:
            yield f"{name}: cells without a value, beside which the rest of their rows is used: {', '.join(some)}"
        if self.others:
            yield f"{name}: {self.others} rows have none of these columns, and are passed over"


def read_table(path: Path, columns: Sequence[str], time_column: str | None, time_unit: str | None) -> Table:
    """Read some columns of a CSV file.

    Parameters
    ----------
    path : Path
    columns : list of str
        Their names, with or without the unit that stands in brackets behind.
    time_column : str or None
        None: the first, or the one that is called time if the first is not.
    time_unit : {"s", "ms", "us", "ns"} or None
        None: what the header says, or what fits times since 1970, or s.

    Returns
    -------
    Table

    Raises
    ------
    InputError
        The file cannot be used.
    """
    try:
        mode = path.stat().st_mode
        if not (S_ISREG(mode) or S_ISDIR(mode)):  # a pipe that nobody writes to would be waited for
            raise InputError(f"{path}: is not a file")
        with open(path, "rb") as raw:
            wide = raw.read(2) in (b"\xff\xfe", b"\xfe\xff")
        # Names of columns may be in any encoding; the numbers are the same bytes in all but UTF-16.
        encoding = "utf-16" if wide else "utf-8-sig"
        with open(path, encoding=encoding, errors="replace", newline="") as file:
            return _parse(path, file, columns, time_column, time_unit)
    except FileNotFoundError:
        raise missing(path) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (csv.Error, UnicodeError) as error:
        raise InputError(f"{path}: is not CSV: {error}") from None


# -- the header ---------------------------------------------------------------------------------------------------


def _head_of(path: Path, file: TextIO) -> list[str]:
    """The first lines, in which the names must stand."""
    head: list[str] = []
    size = 0
    while len(head) < _HEAD and size < _HEAD_SIZE and (line := file.readline(_MAX_LINE)):
        if len(line) == _MAX_LINE or "\0" in line:
            raise InputError(f"{path}: is not a text file with lines of columns")
        head.append(line)
        size += len(line)
    if not head:
        raise InputError(f"{path}: is empty")
    return head


class _Header(NamedTuple):
    line: int  # that of the names, from 1
    delimiter: str
    cells: list[str]


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:
        return []


def _name_and_unit(cell: str) -> tuple[str, str]:
    """``Speed|"km/h"|0|200|50``, ``Speed [km/h]``, ``Speed (km/h)`` and ``# Speed`` without what is not the name."""
    if '|"' in cell:
        name, unit, *_ = cell.split("|")
        return name.strip('" '), unit.strip('" ')
    match = re.fullmatch(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]", cell)
    name, unit = (match[1], match[2]) if match and match[1] else (cell, "")
    return re.sub(r"^[#%]\s*", "", name), unit.strip()


def _places(cells: Sequence[str], name: str) -> list[int]:
    exact = [place for place, cell in enumerate(cells) if cell == name]
    return exact or [place for place, cell in enumerate(cells) if _name_and_unit(cell)[0] == name]


def _find_header(path: Path, head: Sequence[str], wanted: Sequence[str]) -> _Header:
    """The first line that has all the names, between whatever separates them."""
    delimiters: Sequence[str] = _DELIMITERS
    first = 0
    if declared := re.fullmatch(r'"?sep=(.)"?\s*', head[0]):
        delimiters, first = (declared[1],), 1
    best, most = None, 0
    for number, line in enumerate(head[first:], first + 1):
        for delimiter in delimiters:
            cells = _cells(line, delimiter)
            found = sum(bool(_places(cells, name)) for name in wanted)
            if found == len(wanted) and len(cells) > 1:
                return _Header(number, delimiter, cells)
            if found > most:
                best, most = _Header(number, delimiter, cells), found
    likely = best or _likely_header(head, first, delimiters, wanted)
    if likely is None:
        begins = head[first].strip() if first < len(head) else ""
        raise InputError(f"{path}: no line has the columns' names; it begins with {begins[:60]!r}")
    name = next(name for name in wanted if not _places(likely.cells, name))
    bare = [_name_and_unit(cell)[0] for cell in likely.cells if cell]
    close = difflib.get_close_matches(name, bare, 1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    raise InputError(f"{path}: column {name[:60]!r} is not there{hint}; the columns are {str(likely.cells)[:200]}")


def _likely_header(head: Sequence[str], first: int, delimiters: Sequence[str], wanted: Sequence[str]) -> _Header | None:
    """Of the lines without numbers the one with the most names that are nearly wanted, else with the most cells."""
    found, most = None, (0, 1)
    for number, line in enumerate(head[first:], first + 1):
        for delimiter in delimiters:
            cells = _cells(line, delimiter)
            if len(cells) < 2 or any(map(_is_number, cells)):
                continue
            bare = [_name_and_unit(cell)[0] for cell in cells]
            score = sum(bool(difflib.get_close_matches(name, bare, 1)) for name in wanted), len(cells)
            if score > most:
                found, most = _Header(number, delimiter, cells), score
    return found


def _is_number(cell: str) -> bool:
    return bool(_NUMBER.fullmatch(cell) or _NUMBER.fullmatch(cell.replace(",", ".")))


def _column(path: Path, header: _Header, name: str) -> Column:
    places = _places(header.cells, name)
    if len(places) > 1:
        raise InputError(f"{path}: column {name!r} stands twice; the columns are {str(header.cells)[:200]}")
    return Column(name, places[0], _name_and_unit(header.cells[places[0]])[1])


def _time_column(header: _Header, notes: list[str], name: str) -> int:
    """The first, or the only one that is called so if the first is not."""
    bare = [_name_and_unit(cell)[0] for cell in header.cells]
    called = [place for place, cell in enumerate(bare) if _TIME_NAME.fullmatch(cell)]
    is_time = "time" in bare[0].lower() or unit_named("time", _name_and_unit(header.cells[0])[1]) is not None
    if called and 0 not in called and not is_time:
        notes.append(f"{name}: times are column {header.cells[called[0]]!r}; the first is {header.cells[0][:40]!r}")
        return called[0]
    return 0


# -- the rows -----------------------------------------------------------------------------------------------------


def _decimal_of(samples: Sequence[Sequence[str]], delimiter: str) -> tuple[Callable[[str], str], str]:
    """How a number's commas and points are read, and what is to be said about it."""
    cells = [cell for row in samples for cell in row]
    commas = any(re.fullmatch(r"\s*[+-]?\d*,\d+(e[+-]?\d+)?\s*", cell, re.IGNORECASE) for cell in cells)
    points = any(re.fullmatch(r"\s*[+-]?\d*\.\d+(e[+-]?\d+)?\s*", cell, re.IGNORECASE) for cell in cells)
    both = [cell for cell in cells if re.fullmatch(r"\s*[+-]?[\d.,]*\d\s*", cell) and "," in cell and "." in cell]
    if any(cell.rindex(",") > cell.rindex(".") for cell in both):  # 1.234,5
        return lambda cell: cell.replace(".", "").replace(",", "."), "points in numbers part thousands"
    if both or (commas and points and delimiter == ","):
        return lambda cell: cell.replace(",", ""), "commas in numbers part thousands"
    if commas or delimiter != ",":
        return lambda cell: cell.replace(",", "."), "commas in numbers are decimal points" if commas else ""
    return lambda cell: cell, ""


def _parse(path: Path, file: TextIO, columns: Sequence[str], time_column: str | None, time_unit: str | None) -> Table:
    import numpy as np

    head = _head_of(path, file)
    head[0] = head[0].removeprefix("\ufeff")
    wanted = [*columns, *([time_column] if time_column is not None else [])]
    header = _find_header(path, head, wanted)
    notes: list[str] = []
    if header.line > 1:
        notes.append(f"{path.name}: the columns' names are in line {header.line}")
    found = [_column(path, header, name) for name in columns]
    if time_column is not None:
        clock_column = _column(path, header, time_column)
    else:
        place = _time_column(header, notes, path.name)
        clock_column = Column(header.cells[place], place, _name_and_unit(header.cells[place])[1])
    places = [clock_column.place, *(column.place for column in found)]

    rows = csv.reader(chain(head[header.line :], file), delimiter=header.delimiter, skipinitialspace=True)
    first, units, words_in = _first_rows(rows, places, header.line)
    if words_in:
        notes.append(f"{path.name}: line {words_in} has words where numbers are, and is passed over")
    if units is not None:
        clock_column, *found = [column._replace(unit=_unit_cell(units, column)) for column in (clock_column, *found)]
    picked = [[row[place] for place in places[1:] if place < len(row)] for _, row in first]
    decimal, words = _decimal_of(
        [*picked, *([row[places[0]]] for _, row in first if places[0] < len(row) and _is_number(row[places[0]]))],
        header.delimiter,
    )
    notes += [f"{path.name}: {words}"] if words and (header.delimiter == "," or "thousands" in words) else []

    clock: Clock | None = None
    times, values = array("q"), array("d")
    unusable, first_unusable, others = 0, "", 0
    width = max(places)
    for number, row in chain(first, ((header.line + rows.line_num, row) for row in rows)):
        if not any(row) or row[0].startswith("#"):
            continue  # a blank line, a comment
        why = ""
        if len(row) <= width:
            why = f"it has {len(row)} columns of {len(header.cells)}"
        elif all(row[place].strip().lower() in _NOTHING[:1] for place in places[1:]):
            others += 1
            continue
        else:
            if clock is None:
                clock = Clock(path.name, row[places[0]], time_unit, clock_column.unit, decimal)
            time, sample, why = _read_row(row, places, header, clock, decimal)
        if why:
            unusable += 1
            first_unusable = first_unusable or f"line {number}: {why}"
        else:
            times.append(time)
            values.extend(sample)
    if not times:
        reason = f"; the first is {first_unusable}" if unusable else ""
        reason = reason or ("; all of these columns are blank" if others else "")
        raise InputError(f"{path}: has no usable row{reason}")
    t = np.array(times, np.int64)
    order = np.argsort(t, kind="stable")
    x = np.array(values).reshape(len(t), len(columns))
    notes += clock.notes if clock else []
    return Table(
        path,
        found,
        clock_column,
        header.line,
        t[order],
        x[order],
        int(np.count_nonzero(np.diff(t) < 0)),
        unusable,
        first_unusable,
        others,
        notes,
        [*_time_doubts(path.name, clock_column), *(clock.doubts if clock else [])],
    )


def _time_doubts(name: str, column: Column) -> Iterator[str]:
    bare = _name_and_unit(column.name)[0]
    is_length = column.unit.lower() in ("m", "km", "mile", "miles", "ft", "feet", "mi")
    if is_length or re.search(r"(?i)dist|position|odometer", bare):
        unit = f" in {column.unit}" if column.unit else ""
        yield f"{name}: column {bare!r}{unit} is taken for the time: is it a distance? --time-column names another"


def _unit_cell(units: Sequence[str], column: Column) -> str:
    return (units[column.place].strip().strip("[]()") if column.place < len(units) else "") or column.unit


def _first_rows(
    rows: Iterator[list[str]], places: Sequence[int], line: int
) -> tuple[list[tuple[int, list[str]]], list[str] | None, int]:
    """The first rows of samples with their lines; the row of units before them; the line of another one of words."""
    first: list[tuple[int, list[str]]] = []
    units: list[str] | None = None
    words = 0
    for row in islice(rows, 200):
        number = line + rows.line_num  # type: ignore[attr-defined]
        cells = [row[place].strip() for place in places if place < len(row)]
        if not first and len(cells) == len(places) and units is None and _is_units(cells):
            units = row
        elif not first and len(cells) == len(places) and all(cells) and not any(map(_has_digit, cells)):
            words = words or number
        else:
            first += [(number, row)] if any(row) else []
    return first, units, words


def _has_digit(cell: str) -> bool:
    return any(map(str.isdigit, cell))


def _is_units(cells: Sequence[str]) -> bool:
    """Whether a row has nothing but units, at least one of them of a time, speed or load."""
    known = [is_known_unit(cell) for cell in cells]
    return any(known) and not any(map(_is_number, cells))


def _read_row(
    row: Sequence[str], places: Sequence[int], header: _Header, clock: Clock, decimal: Callable[[str], str]
) -> tuple[int, list[float], str]:
    """Time [ns], values, and what is wrong with the row."""
    names = header.cells

    def named(place: int) -> str:
        return f"{names[place] if place < len(names) else place!s:.60}"

    sample: list[float] = []
    for place in places[1:]:
        cell = row[place].strip()
        if cell.lower() in _NOTHING:
            sample.append(math.nan)
            continue
        text = decimal(cell)
        if not _NUMBER.fullmatch(text) or not math.isfinite(value := float(text)):
            return 0, [], f"{named(place)!r} is {cell[:40]!r}"
        sample.append(value)
    cell = row[places[0]]
    try:
        time = clock.read(cell)
    except (ValueError, ArithmeticError):
        return 0, [], f"{named(places[0])!r} is {cell[:40]!r}"
    if time is None or not abs(time) < ROS_TIME_S * 10**9:
        return 0, [], f"{named(places[0])!r} is {cell[:40]!r}, beyond the range of ROS time"
    if all(map(math.isnan, sample)):
        return 0, [], f"{named(places[1])!r} is {row[places[1]][:40]!r}"
    return time, sample, ""
