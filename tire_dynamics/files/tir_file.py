"""Units from MF-Tyre/MF-Swift property files (.tir): their rigid-ring block, and what it leaves open.

A rigid ring on the sidewall is what the inextensional n = 1 mode is, and n = 0 of the complete model when the ring
winds up. docs/model.md derives the relations and says what is assumed.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from os import PathLike
from typing import Any, Final, Literal, NamedTuple

from ..science.unit import TURNING, TireWheelUnit

__all__ = ["OPEN_FIELDS", "Entry", "Source", "TirUnit", "read_tir", "unit_from_tir"]

_MAX_SIZE = 4 * 1024 * 1024  # bytes; such files take some ten thousand

OPEN_FIELDS: Final = (
    *("bending_stiffness", "membrane_stiffness", "width", "thickness", "inflation_pressure"),
    *("zeta_s", "zeta_n", "contact_half_angle", "sidewall_damping"),
    *("longitudinal_stiffness", "longitudinal_damping_ratio", "longitudinal_mass"),
    *TURNING,
)
"""The fields that one may give beside the file: what it does not hold, or holds of another thing."""


class Entry(NamedTuple):
    """A value as it stands in the file, without comment and quotes, and the number of its line."""

    text: str
    line: int


class Source(NamedTuple):
    """Where a field comes from, and how."""

    kind: Literal["file", "given", "assumed"]
    reason: str


class TirUnit(NamedTuple):
    """What :func:`unit_from_tir` returns.

    Attributes
    ----------
    unit : TireWheelUnit
    sources : dict of str to Source
        Of every field, in the fields' order.
    notes : tuple of str
        What else is worth knowing, one line each.
    """

    unit: TireWheelUnit
    sources: dict[str, Source]
    notes: tuple[str, ...]


# -- the file -----------------------------------------------------------------------------------------------------

_SECTION = re.compile(r"\[\s*([^\[\]]+?)\s*\]")
_ENTRY = re.compile(r"([A-Za-z]\w*)\s*=\s*(.*)", re.DOTALL)
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
        Names of sections and keys in capitals. A key has an entry for each time that it is given, so that it is for
        the reader of a key to refuse it: files repeat some that nobody needs.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no such file; the message names it.
    """
    sections: dict[str, dict[str, list[Entry]]] = {}
    section: dict[str, list[Entry]] | None = None
    lines = enumerate(re.split(r"\r\n|\r|\n", _text(path)), 1)  # splitlines() would cut at letters of Latin-1
    for number, line in lines:
        code = _code(line)
        while code.endswith("&"):
            code = f"{code[:-1]} {_code(next(lines, (0, ''))[1])}".rstrip()
        if code.startswith("["):
            header = _SECTION.fullmatch(code)
            if header is None:
                raise ValueError(f"{path}: line {number} is {code[:80]!r}; a section must be [NAME]")
            section = sections.setdefault(header[1].upper(), {})
        elif section is not None and (entry := _ENTRY.fullmatch(code)):
            section.setdefault(entry[1].upper(), []).append(Entry(_unquoted(entry[2]), number))
    if not any(sections.values()):
        raise ValueError(f"{path} is no tire property file; it has no [SECTION] with lines of KEY = value")
    kind = [entry.text for name in _HEADERS for entry in sections.get(name, {}).get("FILE_TYPE", [])]
    if kind and kind[0].lower() != "tir":
        raise ValueError(f"{path}: FILE_TYPE is {kind[0][:80]!r}; it must be 'tir'")
    return sections


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
_UNITS: Final[dict[str, dict[str, float]]] = {
    "LENGTH": {
        **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0),
        **dict.fromkeys(("mm", "millimeter", "millimetre"), 1e-3),
        **dict.fromkeys(("cm", "centimeter", "centimetre"), 1e-2),
        **dict.fromkeys(("in", "inch", "inches"), _INCH),
        **dict.fromkeys(("ft", "foot", "feet"), 12.0 * _INCH),
        **{"km": 1e3, "mile": 5280.0 * 12.0 * _INCH},
    },
    "MASS": {
        **dict.fromkeys(("kg", "kilogram", "kilograms"), 1.0),
        **dict.fromkeys(("g", "gram", "grams"), 1e-3),
        **dict.fromkeys(("tonne", "megagram"), 1e3),
        **dict.fromkeys(("pound_mass", "lbm", "lb", "pound"), _POUND),
        **{"kpound_mass": 1e3 * _POUND, "ounce_mass": _POUND / 16.0},
        **{"slug": _POUND * _G / (12.0 * _INCH), "slinch": _POUND * _G / _INCH},
    },
    "FORCE": {
        **dict.fromkeys(("n", "newton", "newtons"), 1.0),
        **dict.fromkeys(("kn", "knewton", "kilonewton"), 1e3),
        **dict.fromkeys(("kg_force", "kgf"), _G),
        **dict.fromkeys(("pound_force", "lbf"), _POUND * _G),
        **{"kpound_force": 1e3 * _POUND * _G, "ounce_force": _POUND * _G / 16.0, "dyne": 1e-5},
    },
    "TIME": {
        **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
        **dict.fromkeys(("ms", "millisecond", "milliseconds"), 1e-3),
        **dict.fromkeys(("min", "minute", "minutes"), 60.0),
        **dict.fromkeys(("h", "hour", "hours"), 3600.0),
    },
    "PRESSURE": {
        **dict.fromkeys(("pa", "pascal"), 1.0),
        **dict.fromkeys(("kpa", "kilopascal"), 1e3),
        **dict.fromkeys(("mpa", "megapascal"), 1e6),
        **{"bar": 1e5, "psi": _POUND * _G / _INCH**2},
    },
}


class _Key(NamedTuple):
    """Where a key stands, and between which bounds in SI units a tire's may be: from a bicycle's to a mine truck's."""

    section: str  # "" where its name is unmistakable, which versions of the format put here and there
    quantity: str
    unit: str
    low: float
    high: float


_KEYS: Final = {
    "BELT_MASS": _Key("", "mass", "kg", 0.05, 5000.0),
    "BELT_IYY": _Key("", "inertia", "kg m^2", 1e-4, 2e4),
    "FREQ_LONG": _Key("", "frequency", "Hz", 1.0, 1000.0),
    "FREQ_WINDUP": _Key("", "frequency", "Hz", 1.0, 1000.0),
    "DAMP_LONG": _Key("", "ratio", "", 0.0, 1.0),
    "WIDTH": _Key("DIMENSION", "length", "m", 0.01, 2.0),
    "UNLOADED_RADIUS": _Key("DIMENSION", "length", "m", 0.05, 3.0),
    "MASS": _Key("INERTIA", "mass", "kg", 0.05, 1e4),
    **dict.fromkeys(("INFLPRES", "IP", "NOMPRES", "IP_NOM"), _Key("", "pressure", "Pa", 1e4, 5e6)),
}
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?", re.ASCII)  # Fortran writes 1.0D+00
_RADIUS = (0.05, 2.5)  # [m]


class _File:
    """A file's values by their keys, in SI units; every complaint names the file, the key and the line."""

    def __init__(self, path: str | PathLike[str]) -> None:
        self.path = path
        self.sections = read_tir(path)
        self.without_unit: list[str] = []
        length, mass, force, time = (self._unit(name, 1.0) for name in ("LENGTH", "MASS", "FORCE", "TIME"))
        self.factors = {
            "length": length,
            "mass": mass,
            "inertia": mass * length**2,
            "frequency": 1.0 / time,
            "pressure": self._unit("PRESSURE", force / length**2),
            "ratio": 1.0,
        }

    def number(self, key: str) -> float | None:
        """The value of a key of ``_KEYS`` in SI units, or None if it is not there."""
        place = _KEYS[key]
        entry = self._entry(key, [place.section] if place.section else set(self.sections) - {"UNITS", *_HEADERS})
        if entry is None:
            return None
        if not _NUMBER.fullmatch(entry.text):
            raise ValueError(f"{self._named(key, entry)}; it must be a number")
        value = float(re.sub("[dD]", "e", entry.text)) * self.factors[place.quantity]
        value = float(f"{value:.15g}")  # 205 mm are 0.205 m
        below = value < place.high if key == "DAMP_LONG" else value <= place.high
        if not (place.low <= value and below):
            converted = "" if self.factors[place.quantity] == 1.0 else f", {value:g} {place.unit}"
            bounds = "in [0, 1)" if key == "DAMP_LONG" else f"from {place.low:g} to {place.high:g} {place.unit}"
            raise ValueError(f"{self._named(key, entry)}{converted}; it must be {bounds}")
        return value

    def needed(self, key: str) -> float:
        """The same of a key that must be there."""
        value = self.number(key)
        if value is None:
            raise ValueError(f"{self.path}: {key} is missing; the rigid ring of MF-Swift needs {', '.join(_NEEDED)}")
        return value

    def _unit(self, name: str, default: float) -> float:
        entry = self._entry(name, ["UNITS"]) or self._entry(name, _HEADERS)
        if entry is None:
            if name != "PRESSURE":
                self.without_unit.append(name)
            return default
        known = _UNITS[name]
        factor = known.get(entry.text.lower())
        if factor is None:
            raise ValueError(f"{self._named(name, entry)}; it must be one of {', '.join(known)}")
        return factor

    def _entry(self, key: str, sections: Iterable[str]) -> Entry | None:
        entries = sorted(
            (entry for name in sections for entry in self.sections.get(name, {}).get(key, [])),
            key=lambda entry: entry.line,
        )
        if len(entries) > 1:
            raise ValueError(f"{self.path}: {key} is given twice, in lines {entries[0].line} and {entries[1].line}")
        return entries[0] if entries else None

    def _named(self, key: str, entry: Entry) -> str:
        return f"{self.path}: {key} is {entry.text[:80]!r} in line {entry.line}"


# -- the unit -----------------------------------------------------------------------------------------------------

_NEEDED = ("BELT_MASS", "BELT_IYY", "FREQ_LONG", "FREQ_WINDUP", "DAMP_LONG")
_TABLE_1 = TireWheelUnit.table_1()


def unit_from_tir(
    path: str | PathLike[str], *, wheel_mass: float, suspension_stiffness: float, **fields: Any
) -> TirUnit:
    """A unit with the rigid ring of a property file, and where each of its fields comes from.

    Parameters
    ----------
    path : path
        As of :func:`read_tir`. Of its numbers, BELT_MASS, BELT_IYY, FREQ_LONG, FREQ_WINDUP and DAMP_LONG are needed,
        WIDTH and the inflation pressure (INFLPRES, else IP, NOMPRES or IP_NOM) are used where they are.
    wheel_mass : float
        What moves with the wheel, without the belt, M [kg]: no property file knows it.
    suspension_stiffness : float
        k_s [N/m]; nor this.
    **fields
        Any of ``OPEN_FIELDS``, in place of what is assumed.

    Returns
    -------
    TirUnit

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no property file, or a value is missing, given twice or out of bounds: one line with the file, the key,
        the value and the bound. Or a field cannot be given, or is out of bounds.

    Notes
    -----
    a = sqrt(BELT_IYY/BELT_MASS), m = BELT_MASS, k_1 = BELT_MASS (2 pi FREQ_LONG)^2 = pi a b (k_z + k_theta),
    BELT_IYY (2 pi FREQ_WINDUP)^2 = 2 pi a^3 b k_theta, zeta_1 = DAMP_LONG.
    """
    file = _File(path)
    mass, inertia, long, windup, damping = map(file.needed, _NEEDED)
    a = math.sqrt(inertia / mass)
    if not _RADIUS[0] <= a <= _RADIUS[1]:
        raise ValueError(
            f"{path}: sqrt(BELT_IYY/BELT_MASS), the radius, is {a:g} m; it must be from {_RADIUS[0]} to {_RADIUS[1]} m"
        )
    free = file.number("UNLOADED_RADIUS")
    if free is not None and a > free:
        raise ValueError(
            f"{path}: sqrt(BELT_IYY/BELT_MASS), the radius, is {a:g} m; it must be at most UNLOADED_RADIUS = {free:g} m"
        )
    k_1 = mass * (2.0 * math.pi * long) ** 2
    k_theta = inertia * (2.0 * math.pi * windup) ** 2 / (2.0 * math.pi * a**3)  # times b, as k_z
    k_z = k_1 / (math.pi * a) - k_theta
    if not k_z > 0.0:
        raise ValueError(
            f"{path}: FREQ_WINDUP is {windup:g} Hz; it must be less than sqrt(2) FREQ_LONG = {2.0**0.5 * long:g} Hz, "
            "lest k_z be negative"
        )
    _check_given(a, {"wheel_mass": wheel_mass, "suspension_stiffness": suspension_stiffness, **fields})

    values: dict[str, Any] = {"wheel_mass": wheel_mass, "suspension_stiffness": suspension_stiffness, **fields}
    sources = dict.fromkeys(values, Source("given", "given"))

    def put(name: str, value: Any, kind: Literal["file", "assumed"], reason: str) -> None:
        if name not in values:
            values[name] = value
            sources[name] = Source(kind, reason)

    put("radius", a, "file", "sqrt(BELT_IYY/BELT_MASS)")
    width = None if "width" in values else file.number("WIDTH")
    if width is None:
        put("width", a * _TABLE_1.width / _TABLE_1.radius, "assumed", "b/a as in Table 1, WIDTH being absent")
    else:
        put("width", width, "file", "WIDTH, the nominal section's, which a belt may be narrower than")
    alike = "h/a as in Table 1; only rho h, K and D go into results"
    put("thickness", a * _TABLE_1.thickness / _TABLE_1.radius, "assumed", alike)
    b, h = values["width"], values["thickness"]
    ratio = h / _TABLE_1.thickness
    put("density", mass / (2.0 * math.pi * a * b * h), "file", "BELT_MASS/(2 pi a b h): the ring's mass is BELT_MASS")
    put("membrane_stiffness", _TABLE_1.membrane_stiffness * ratio, "assumed", "the material of Table 1, K ~ h")
    put("bending_stiffness", _TABLE_1.bending_stiffness * ratio**3, "assumed", "the material of Table 1, D ~ h^3")
    put("radial_stiffness", k_z / b, "file", "BELT_MASS (2 pi FREQ_LONG)^2 = k_1 = pi a b (k_z + k_theta)")
    put("tangential_stiffness", k_theta / b, "file", "BELT_IYY (2 pi FREQ_WINDUP)^2 = 2 pi a^3 b k_theta")
    for key in () if "inflation_pressure" in values else ("INFLPRES", "IP", "NOMPRES", "IP_NOM"):
        pressure = file.number(key)
        if pressure is not None:
            put("inflation_pressure", pressure, "file", key)
            break
    put("inflation_pressure", _TABLE_1.inflation_pressure, "assumed", "that of Table 1, INFLPRES being absent")
    put("zeta_1", damping, "file", "DAMP_LONG")
    put("zeta_s", _TABLE_1.zeta_s, "assumed", "the default; a tire's file knows no suspension")
    put("zeta_n", _TABLE_1.zeta_n, "assumed", "the default; a rigid ring has no other modes")
    put("contact_half_angle", _TABLE_1.contact_half_angle, "assumed", "the default, a point load")
    by_default = "the paper's; 'reaction' is how MF-Swift damps, and better for a vehicle"
    put("sidewall_damping", _TABLE_1.sidewall_damping, "assumed", by_default)
    put("longitudinal_stiffness", _TABLE_1.longitudinal_stiffness, "assumed", "the default, a wheel that is held")
    put("longitudinal_damping_ratio", _TABLE_1.longitudinal_damping_ratio, "assumed", "the default")
    put("longitudinal_mass", _TABLE_1.longitudinal_mass, "assumed", "the default, wheel_mass")
    for name in TURNING:
        put(name, getattr(_TABLE_1, name), "assumed", "the default, a tire that is the same all around")

    names = list(_TABLE_1.to_mapping())
    try:
        unit = TireWheelUnit.from_mapping({name: values[name] for name in names})
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return TirUnit(unit, {name: sources[name] for name in names}, tuple(_notes(file, mass)))


def _check_given(radius: float, given: Mapping[str, Any]) -> None:
    """What is given must be open, and a field of its own right."""
    for name in given:
        if name in _TABLE_1.to_mapping() and name not in (*OPEN_FIELDS, "wheel_mass", "suspension_stiffness"):
            raise ValueError(f"{name} cannot be given; the file says it. Fields that can are {', '.join(OPEN_FIELDS)}")
    checked = _TABLE_1.replace(**{"radius": radius, "thickness": 1e-3 * radius, **given})
    for name, low, high in (("width", 1e-3, 1e1), ("thickness", 1e-6, 1e1)):  # beyond them products leave the doubles
        value = getattr(checked, name)
        if name in given and not low <= value <= high:
            raise ValueError(f"{name} is {value!r}; it must be from {low:g} to {high:g} m")


def _notes(file: _File, belt: float) -> Iterator[str]:
    if file.without_unit:
        yield f"[UNITS] does not say {', '.join(file.without_unit)}; SI units are assumed"
    try:
        whole = file.number("MASS")
    except ValueError:  # nothing hangs on it, and some leave a 0 there
        return
    if whole is not None and whole >= belt:
        yield f"the tire is {whole:g} kg, of which {whole - belt:g} kg beside the belt belong to the wheel's mass"
