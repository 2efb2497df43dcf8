"""Times as CSV files write them: dates, times of the day, numbers in some unit."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import date
from decimal import Decimal
from typing import Final

from .csv_units import TIME_UNITS, unit_named

__all__ = ["ROS_TIME_S", "Clock"]

ROS_TIME_S: Final = 2**31  # builtin_interfaces/Time holds an int32 of seconds

_CLOCK = r"(\d{1,2}):(\d{2})(?::(\d{2})(?:[.,](\d+))?)?\s*([AaPp][Mm])?"
_DATES = (
    re.compile(rf"(?P<y>\d{{4}})[-/.](?P<m>\d{{1,2}})[-/.](?P<d>\d{{1,2}})[T\s]+{_CLOCK}\s*(?P<zone>\S*)"),
    re.compile(rf"(?P<d>\d{{1,2}})[-\s](?P<m>[A-Za-z]{{3}})[a-z]*[-,\s]+(?P<y>\d{{4}})[T\s]+{_CLOCK}\s*(?P<zone>\S*)"),
)
_OF_DAY = re.compile(rf"{_CLOCK}")
_MONTHS = "jan feb mar apr may jun jul aug sep oct nov dec".split()
_ZONE = re.compile(r"([+-])(\d{2}):?(\d{2})?")
_WITH_UNIT = re.compile(r"(\S+)\s*(s|sec|secs|seconds|ms|us|ns)")
_DAY = 86400 * 10**9
_EPOCH = date(1970, 1, 1).toordinal()


def _of_day(hours: str, minutes: str, seconds: str | None, fraction: str | None, half: str | None) -> int:
    hour = int(hours)
    if half:
        hour = hour % 12 + (12 if half.lower() == "pm" else 0)
    if hour > 23 or int(minutes) > 59 or int(seconds or 0) > 60:
        raise ValueError
    return (hour * 3600 + int(minutes) * 60 + int(seconds or 0)) * 10**9 + int((fraction or "")[:9].ljust(9, "0"))


def _date(cell: str) -> tuple[int, bool]:
    """Time since 1970 [ns], and whether its zone was said."""
    for pattern in _DATES:
        match = pattern.fullmatch(cell)
        if match is None:
            continue
        *clock, _ = [part for k, part in enumerate(match.groups()) if k >= 3]
        month = match["m"]
        number = int(month) if month.isdigit() else _MONTHS.index(month.lower()) + 1
        day = date(int(match["y"]), number, int(match["d"])).toordinal() - _EPOCH
        at = day * _DAY + _of_day(*clock)
        zone = match["zone"]
        if zone in ("", "Z", "z", "UTC", "GMT"):
            return at, bool(zone)
        offset = _ZONE.fullmatch(zone)
        if offset is None:
            raise ValueError
        minutes = int(offset[2]) * 60 + int(offset[3] or 0)
        return at - (minutes if offset[1] == "+" else -minutes) * 60 * 10**9, True
    raise ValueError


class Clock:
    """Reads a file's times, all in the manner of the first."""

    def __init__(self, name: str, cell: str, unit: str | None, said: str, decimal: Callable[[str], str]) -> None:
        self.notes: list[str] = []
        self.doubts: list[str] = []
        self._decimal = decimal
        self._last, self._days = -1, 0
        text = cell.strip()
        try:
            _, zoned = _date(text)
        except ValueError:
            pass
        else:
            self.read: Callable[[str], int | None] = self._of_date
            self.notes.append(f"{name}: times are dates" + ("" if zoned else " without a zone, taken for UTC"))
            return
        match = _OF_DAY.fullmatch(text)
        if match and (match[3] is not None or match[4] is not None):
            self.read = self._of_clock
            self.notes.append(f"{name}: times are of the day, hh:mm:ss")
            return
        self.read = self._of_number
        header = unit_named("time", said) if said else None
        if unit is None and header is not None and header != "s":
            self.notes.append(f"{name}: times are in {header}, as its header says")
        elif unit is not None and header is not None and unit != header:
            self.doubts.append(
                f"{name}: the header says that times are in {header}, and --time-unit that they are {unit}"
            )
        chosen = unit or header
        if chosen is None:
            chosen = self._by_size(text)
            if chosen != "s":
                self.notes.append(f"{name}: times are taken for {chosen} since 1970, {text[:30]} being the first")
        self._decimals = TIME_UNITS[chosen]
        self._latest = Decimal(ROS_TIME_S).scaleb(9 - self._decimals)

    def _by_size(self, text: str) -> str:
        try:
            size = abs(Decimal(self._decimal(text)))
            for unit, low in (("ns", 10**17), ("us", 10**14), ("ms", 10**11)):
                if low <= size < ROS_TIME_S * 10 ** (9 - TIME_UNITS[unit]):
                    return unit
        except ArithmeticError:
            pass
        return "s"

    def _of_date(self, cell: str) -> int | None:
        return _date(cell.strip())[0]

    def _of_clock(self, cell: str) -> int | None:
        match = _OF_DAY.fullmatch(cell.strip())
        if match is None:
            raise ValueError
        at = _of_day(*match.groups())
        if at < self._last - _DAY // 2:
            self._days += 1  # past midnight
        self._last = at
        return at + self._days * _DAY

    def _of_number(self, cell: str) -> int | None:
        """[ns]; None beyond the range of ROS time."""
        text = self._decimal(cell.strip())
        try:
            time = Decimal(text)
        except ArithmeticError:
            match = _WITH_UNIT.fullmatch(text)  # MATLAB's durations
            if match is None:
                raise
            time = Decimal(match[1])
        if not time.is_finite():
            raise ValueError
        if abs(time) >= self._latest:
            return None
        # In decimals to the last digit: seconds since the epoch have more of them than a float has.
        return int(time.scaleb(self._decimals).to_integral_value())
