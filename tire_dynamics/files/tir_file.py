"""MF-Tyre/MF-Swift property files (.tir) and their kin: sections, keys, and values in SI units."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from os import PathLike
from typing import Any, Final, NamedTuple

__all__ = ["KEYS", "PRESSURES", "Entry", "TirFile", "read_tir"]

_MAX_SIZE = 4 * 1024 * 1024  # bytes; such files take some ten thousand


class Entry(NamedTuple):
    """A value as it stands in the file, without comment and quotes, and the number of its line; 0 if it was given."""

    text: str
    line: int


# -- the file -----------------------------------------------------------------------------------------------------

_SECTION = re.compile(r"\[\s*([^\[\]]+?)\s*\]")
_ENTRY = re.compile(r"([A-Za-z]\w*)\s*=\s*(.*)", re.DOTALL)
_LOOSE = re.compile(r"([A-Za-z]\w*)(?:\s*:\s*|\s+)(\S.*)", re.DOTALL)  # KEY: VALUE, KEY VALUE
_CODE = re.compile(r"""(?:[^$!'"]|'[^']*'|"[^"]*")*""")  # of a line, what stands before its comment


def read_tir(path: str | PathLike[str]) -> dict[str, dict[str, list[Entry]]]:
    """Sections, keys and values of a property file.

    Parameters
    ----------
    path : path
        Text in UTF-8, UTF-16 or Latin-1. ``$`` and ``!`` begin comments, ``&`` at the end of a line goes on in the
        next. Lines without ``key = value``, those of tables, are passed over.

    Returns
    -------
    dict of str to dict of str to list of Entry
        Names of sections and keys in capitals; what stands before the first section is in that of the empty name. A
        key has an entry for each time that it is given, so that it is for the reader of a key to refuse it: files
        repeat some that nobody needs.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no such file; the message names it.
    """
    return _read(path)[0]


def _read(path: str | PathLike[str]) -> tuple[dict[str, dict[str, list[Entry]]], dict[str, Entry]]:
    """Sections, and of the keys of ``KEYS`` the lines that have no equals sign, whole."""
    sections: dict[str, dict[str, list[Entry]]] = {}
    loose: dict[str, Entry] = {}
    name = ""
    lines = enumerate(re.split(r"\r\n|\r|\n", _text(path)), 1)  # splitlines() would cut at letters of Latin-1
    for number, line in lines:
        code = _code(line)
        while code.endswith("&"):
            code = f"{code[:-1]} {_code(next(lines, (0, ''))[1])}".rstrip()
        if code.startswith("["):
            header = _SECTION.fullmatch(code)
            if header is None:
                raise ValueError(f"{path}: line {number} is {code[:80]!r}; a section must be [NAME]")
            name = header[1].upper()
            sections.setdefault(name, {})
        elif entry := _ENTRY.fullmatch(code):
            sections.setdefault(name, {}).setdefault(entry[1].upper(), []).append(Entry(_unquoted(entry[2]), number))
        elif (entry := _LOOSE.fullmatch(code)) and entry[1].upper() in KEYS:
            loose.setdefault(entry[1].upper(), Entry(code, number))
    known = any(key in KEYS for key in sections.get("", {}))
    if not known and not any(keys for name, keys in sections.items() if name):
        such = [f"; line {entry.line} is {entry.text[:40]!r}" for entry in loose.values()][:1]
        raise ValueError(
            f"{path} is no tire property file; it has no [SECTION] with lines of KEY = value{''.join(such)}"
        )
    kind = [entry.text for name in _HEADERS for entry in sections.get(name, {}).get("FILE_TYPE", [])]
    if kind and kind[0].lower() != "tir":
        raise ValueError(f"{path}: FILE_TYPE is {kind[0][:80]!r}; it must be 'tir'")
    return sections, loose


def _text(path: str | PathLike[str]) -> str:
    if not (os.path.isfile(path) or os.path.isdir(path)) and os.path.exists(path):  # a pipe may wait for ever
        raise ValueError(f"{path} is not a file")
    with open(path, "rb") as file:
        content = file.read(_MAX_SIZE + 1)
    if len(content) > _MAX_SIZE:
        raise ValueError(f"{path} is too large for a tire property file; it must be at most {_MAX_SIZE} bytes")
    wide = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    for encoding in ("utf-16",) if wide else ("utf-8-sig", "latin-1"):
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise ValueError(f"{path} is not a text file")


def _code(line: str) -> str:
    match = _CODE.match(line)
    end = match.end() if match else 0
    return (line[:end] if line[end : end + 1] in ("$", "!") else line).strip()  # a quote that does not end is kept


def _unquoted(text: str) -> str:
    quoted = len(text) >= 2 and text[0] == text[-1] and text[0] in "'\""
    return text[1:-1].strip() if quoted else text


# -- values with their units --------------------------------------------------------------------------------------

_HEADERS = ("MDI_HEADER", "HEADER")
_POUND, _INCH, _G = 0.45359237, 0.0254, 9.80665
_PREFIXES = {
    **{"kilo": 1e3, "mega": 1e6, "centi": 1e-2, "milli": 1e-3, "micro": 1e-6, "nano": 1e-9},
    **{"k": 1e3, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9},
}


def _with_prefixes(unit: str, size: float, prefixes: str) -> dict[str, float]:
    return {prefix + unit: size * _PREFIXES[prefix] for prefix in prefixes.split()}


# The names that Adams documents for UNITS, those of MF-Tyre's manual, and how people abbreviate them: in the singular.
_UNITS: Final[dict[str, dict[str, float]]] = {
    "LENGTH": {
        **dict.fromkeys(("m", "meter", "metre"), 1.0),
        **_with_prefixes("m", 1.0, "k c m u n"),
        **_with_prefixes("meter", 1.0, "kilo centi milli micro nano"),
        **_with_prefixes("metre", 1.0, "kilo centi milli micro nano"),
        **dict.fromkeys(("in", "inch", "inche"), _INCH),
        **dict.fromkeys(("ft", "foot", "feet"), 12.0 * _INCH),
        **dict.fromkeys(("mil", "microinch", "microinche"), 1e-3 * _INCH),
        **{"yard": 36.0 * _INCH, "mile": 5280.0 * 12.0 * _INCH, "angstrom": 1e-10},
    },
    "MASS": {
        **dict.fromkeys(("kg", "kilogram"), 1.0),
        **dict.fromkeys(("g", "gram", "gramme"), 1e-3),
        **_with_prefixes("g", 1e-3, "m u n"),
        **_with_prefixes("gram", 1e-3, "milli micro nano mega"),
        **dict.fromkeys(("tonne", "ton", "metric_ton"), 1e3),
        **dict.fromkeys(("pound_mass", "lbm", "lb", "pound"), _POUND),
        **dict.fromkeys(("ounce_mass", "oz"), _POUND / 16.0),
        **{"kpound_mass": 1e3 * _POUND, "us_ton": 2e3 * _POUND},
        **{"slug": _POUND * _G / (12.0 * _INCH), "slinch": _POUND * _G / _INCH},
    },
    "FORCE": {
        **dict.fromkeys(("n", "newton"), 1.0),
        **_with_prefixes("n", 1.0, "k m u c"),
        **_with_prefixes("newton", 1.0, "k kilo mega centi milli micro nano"),
        **dict.fromkeys(("kg_force", "kilogram_force", "kgf", "kg_f", "kilopond", "kp"), _G),
        **dict.fromkeys(("pound_force", "lbf", "lb_force", "lb_f"), _POUND * _G),
        **dict.fromkeys(("kpound_force", "kip", "klbf"), 1e3 * _POUND * _G),
        **dict.fromkeys(("ounce_force", "ozf"), _POUND * _G / 16.0),
        **{"dyne": 1e-5, "poundal": _POUND * 12.0 * _INCH},
    },
    "TIME": {
        **dict.fromkeys(("s", "sec", "second"), 1.0),
        **_with_prefixes("s", 1.0, "m u n"),
        **_with_prefixes("sec", 1.0, "m milli micro nano"),
        **_with_prefixes("second", 1.0, "milli micro nano"),
        **dict.fromkeys(("milli",), 1e-3),
        **dict.fromkeys(("min", "minute"), 60.0),
        **dict.fromkeys(("h", "hour", "hr"), 3600.0),
        **{"day": 86400.0},
    },
    "PRESSURE": {
        **dict.fromkeys(("pa", "pascal", "newton/meter^2", "n/m^2", "newton/m^2"), 1.0),
        **dict.fromkeys(("mpa", "megapascal", "newton/mm^2", "n/mm^2"), 1e6),
        **dict.fromkeys(("psi", "pound_force/inch^2", "lbf/in^2"), _POUND * _G / _INCH**2),
        **{"kpa": 1e3, "kilopascal": 1e3, "bar": 1e5, "mbar": 1e2, "millibar": 1e2, "hpa": 1e2, "atm": 101325.0},
    },
}
_UNITS["LENGTH"]["microinch"] = _UNITS["LENGTH"]["microinche"] = 1e-6 * _INCH
_BY_CASE = {"Mg": 1e3, "MN": 1e6}  # a milligram and a millinewton in small letters


class _Key(NamedTuple):
    """Where a key stands, and between which bounds in SI units a tire's may be: from a bicycle's to a mine truck's."""

    sections: tuple[str, ...]  # empty where its name is unmistakable, which versions of the format put here and there
    quantity: str
    unit: str
    low: float
    high: float


PRESSURES: Final = ("INFLPRES", "IP", "NOMPRES", "IP_NOM")
"""The keys of an inflation pressure, the first that is there counts."""

KEYS: Final[Mapping[str, _Key]] = {
    "BELT_MASS": _Key((), "mass", "kg", 0.05, 5000.0),
    "BELT_IYY": _Key((), "inertia", "kg m^2", 1e-4, 2e4),
    "FREQ_LONG": _Key((), "frequency", "Hz", 1.0, 1000.0),
    "FREQ_WINDUP": _Key((), "frequency", "Hz", 1.0, 1000.0),
    "DAMP_LONG": _Key((), "ratio", "", 0.0, 1.0),
    "WIDTH": _Key(("DIMENSION",), "length", "m", 0.01, 2.0),
    "UNLOADED_RADIUS": _Key(("DIMENSION",), "length", "m", 0.05, 3.0),
    "RIM_RADIUS": _Key(("DIMENSION",), "length", "m", 0.02, 2.0),
    "ASPECT_RATIO": _Key(("DIMENSION",), "ratio", "", 0.05, 2.0),
    "MASS": _Key(("INERTIA",), "mass", "kg", 0.05, 1e4),
    "IYY": _Key(("INERTIA",), "inertia", "kg m^2", 1e-4, 5e4),
    "VERTICAL_STIFFNESS": _Key(("VERTICAL", "PARAMETER"), "stiffness", "N/m", 1e3, 1e8),
    **dict.fromkeys(PRESSURES, _Key((), "pressure", "Pa", 1e4, 5e6)),
}
"""The keys that are read: their values can be given in place of the file's."""

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?", re.ASCII)  # Fortran writes 1.0D+00
_LIKELY_PRESSURE = (5e4, 1.2e6)  # [Pa], of tires
_KINDS = ("PROPERTY_FILE_FORMAT", "FITTYP")


class TirFile:
    """A file's values by their keys, in SI units; every complaint names the file, the key and the line.

    Parameters
    ----------
    path : path
    keys : mapping of str to object, optional
        Values in place of the file's, in the file's units.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no property file, a unit is unknown, or a key cannot be given.

    Attributes
    ----------
    path : path
    kind : str
        What the file says it is, in words.
    without_unit : list of str
        The base quantities whose unit it does not say.
    given : frozenset of str
        The keys that were given.
    """

    def __init__(self, path: str | PathLike[str], keys: Mapping[str, Any] | None = None) -> None:
        self.path = path
        self._sections, self._loose = _read(path)
        self._given = {name.upper(): Entry(str(value).strip(), 0) for name, value in (keys or {}).items()}
        for name in self._given:
            if name not in KEYS:
                raise ValueError(f"key {name[:80]!r} cannot be given; those that are read are {', '.join(KEYS)}")
        self.given = frozenset(self._given)
        self.without_unit: list[str] = []
        length, mass, force, time = (self._unit(name, 1.0) for name in ("LENGTH", "MASS", "FORCE", "TIME"))
        self._factors = {
            "length": length,
            "mass": mass,
            "inertia": mass * length**2,
            "frequency": 1.0 / time,
            "stiffness": force / length,
            "pressure": self._unit("PRESSURE", force / length**2),
            "ratio": 1.0,
        }

    @property
    def kind(self) -> str:
        """What the file says it is: its format and the number of its formula."""
        said = []
        for key in _KINDS:
            entries = [entry for keys in self._sections.values() for entry in keys.get(key, []) if entry.text]
            said += [f"{key} = {entries[0].text[:40]}"] if entries else []
        return f"a file with {' and '.join(said)}" if said else "a file that does not say its format"

    def number(self, key: str) -> float | None:
        """The value of one of ``KEYS`` in SI units; None if it is not there, blank, or 0 where that means nothing."""
        place = KEYS[key]
        entry = self._entry(key, self._sections_of(key))
        if entry is None:
            return None
        if not _NUMBER.fullmatch(entry.text):
            raise ValueError(f"{self._named(key, entry)}; it must be a number")
        plain = float(re.sub("[dD]", "e", entry.text))
        if plain == 0.0 and key != "DAMP_LONG":
            return None
        value = float(f"{plain * self._factors[place.quantity]:.15g}")  # 205 mm are 0.205 m
        below = value < place.high if key == "DAMP_LONG" else value <= place.high
        if not (place.low <= value and below):
            converted = "" if self._factors[place.quantity] == 1.0 else f", {value:g} {place.unit}"
            bounds = "in [0, 1)" if key == "DAMP_LONG" else f"from {place.low:g} to {place.high:g} {place.unit}"
            raise ValueError(f"{self._named(key, entry)}{converted}; it must be {bounds}{self._other_unit(key, plain)}")
        return value

    def _sections_of(self, key: str) -> Iterable[str]:
        """The sections in which a key is the tire's."""
        named = KEYS[key].sections
        return (*named, "") if named else self._sections.keys() - {"UNITS", *_HEADERS}

    def usable(self, key: str) -> float | None:
        """The same; None also of a value that cannot be used."""
        try:
            return self.number(key)
        except ValueError:
            return None

    def pressure_doubt(self, key: str) -> str | None:
        """What is odd about a pressure that is within bounds, if something is."""
        value = self.number(key)
        if value is None or _LIKELY_PRESSURE[0] <= value <= _LIKELY_PRESSURE[1]:
            return None
        return f"{key} is {value / 1e5:g} bar{self._other_unit(key, value / self._factors['pressure'])}"

    def _other_unit(self, key: str, plain: float) -> str:
        """In which unit a pressure would be a tire's, and what it is in the file's."""
        if KEYS[key].quantity != "pressure":
            return ""
        for unit in ("bar", "kpa", "psi", "pa"):
            if _LIKELY_PRESSURE[0] <= (pascal := plain * _UNITS["PRESSURE"][unit]) <= _LIKELY_PRESSURE[1]:
                name = {"kpa": "kPa", "pa": "Pa"}.get(unit, unit)
                return f"; {plain:g} {name} would be {key} = {pascal / self._factors['pressure']:g} in the file's unit"
        return ""

    def absent(self, key: str) -> str:
        """A key that has no value, with what stands in its place."""
        if key in self._loose:
            entry = self._loose[key]
            return f"{key} (line {entry.line} is {entry.text[:40]!r}; it must be {key} = value)"
        entries = [entry for keys in self._sections.values() for entry in keys.get(key, [])]
        if entries and not self._given.get(key):
            return f"{key} ({'blank' if not entries[0].text else entries[0].text[:20]} in line {entries[0].line})"
        return key

    def passed_over(self) -> Iterator[str]:
        """Of each key that has no value but a line without an equals sign or in another section, that line in words."""
        for key, entry in self._loose.items():
            if not any(keys.get(key) for keys in self._sections.values()) and key not in self._given:
                yield f"line {entry.line} is {entry.text[:40]!r}, which is not read; it must be {key} = value"
        for key, (named, *_) in KEYS.items():
            if not named or key in self._given or any(self._sections.get(name, {}).get(key) for name in (*named, "")):
                continue
            where = " or ".join(f"[{name}]" for name in named)
            for name in self._sections.keys() - {"UNITS", *_HEADERS}:
                for entry in self._sections[name].get(key, [])[:1]:
                    if entry.text:
                        yield f"{key} in line {entry.line} is in [{name}], and not read; the tire's is in {where}"

    def _unit(self, name: str, default: float) -> float:
        entry = self._entry(name, ["UNITS"]) or self._entry(name, _HEADERS) or self._entry(name, [""], words=True)
        if entry is None:
            if name != "PRESSURE":
                self.without_unit.append(name)
            return default
        known = _UNITS[name]
        text = entry.text.lower()
        factor = _BY_CASE.get(entry.text) if name in ("MASS", "FORCE") else None
        factor = factor or known.get(text) or known.get(text.removesuffix("s"))
        if factor is None:
            raise ValueError(f"{self._named(name, entry)}; it must be one of {', '.join(known)}")
        return factor

    def _entry(self, key: str, sections: Iterable[str], *, words: bool = False) -> Entry | None:
        """The entry of a key, which may be given more than once if it is the same; blank ones are none.

        Of what stands before the first section, either ``words`` or the rest: MASS is a unit and a mass there.
        """
        if key in self._given and not words and key in KEYS and not set(sections) & {"UNITS", *_HEADERS}:
            return self._given[key]
        entries = sorted(
            (
                entry
                for name in sections
                for entry in self._sections.get(name, {}).get(key, [])
                if entry.text and (name or words == (entry.text[:1].isalpha() and key in _UNITS))
            ),
            key=lambda entry: entry.line,
        )
        for entry in entries[1:]:
            if entry.text.lower() != entries[0].text.lower():
                raise ValueError(
                    f"{self.path}: {key} is given twice, in lines {entries[0].line} and {entry.line}, as "
                    f"{entries[0].text[:40]} and {entry.text[:40]}"
                )
        return entries[0] if entries else None

    def _named(self, key: str, entry: Entry) -> str:
        where = f" in line {entry.line}" if entry.line else ", as given"
        return f"{self.path}: {key} is {entry.text[:80]!r}{where}"
