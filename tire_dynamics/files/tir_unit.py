"""Units from MF-Tyre/MF-Swift property files (.tir): their rigid-ring block, what it leaves open, what is odd in it.

A rigid ring on the sidewall is what the inextensional n = 1 mode is, and n = 0 of the complete model when the ring
winds up. docs/model.md derives the relations and says what is assumed.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from ..science.coefficients import static_compliance
from ..science.uncertainty import UNCERTAIN, value_of
from ..science.unit import ROTATING, TireWheelUnit
from .tir_estimate import RULES, Estimate, estimated, stiffness_of_size
from .tir_file import KEYS, PRESSURES, TirFile

__all__ = ["OPEN_FIELDS", "Errors", "Source", "TirUnit", "read_tir_unit", "unit_from_tir"]

FloatArray = NDArray[np.float64]

_TABLE_1 = TireWheelUnit.table_1()
_OF_THE_FILE = ("density", "radius", "radial_stiffness", "tangential_stiffness", "zeta_1")
_ALWAYS_GIVEN = ("wheel_mass", "suspension_stiffness")

OPEN_FIELDS: Final = tuple(
    field.name for field in dataclasses.fields(TireWheelUnit) if field.name not in (*_OF_THE_FILE, *_ALWAYS_GIVEN)
)
"""The fields that one may give beside the file: what it does not hold, or holds of another thing."""


class Source(NamedTuple):
    """Where a field comes from, and how."""

    kind: Literal["file", "given", "assumed", "estimated"]
    reason: str


class Errors(NamedTuple):
    """How far the fields that hang on estimates may be off.

    Attributes
    ----------
    relative : dict of str to float
        Standard errors of the fields' logarithms.
    correlation : ndarray, shape (P, P)
        Of the logarithms, in this order.
    k_1 : float
        Standard error of ln k_1.
    """

    relative: dict[str, float]
    correlation: FloatArray
    k_1: float


class TirUnit(NamedTuple):
    """What :func:`unit_from_tir` returns.

    Attributes
    ----------
    unit : TireWheelUnit
    sources : dict of str to Source
        Of every field, in the fields' order.
    notes : tuple of str
        What else is worth knowing, one line each.
    doubts : tuple of str
        What does not fit together in the file, one line each: it is used all the same.
    estimates : dict of str to Estimate
        By the file's keys; empty unless they were asked for.
    errors : Errors or None
        Of a unit with estimates.
    """

    unit: TireWheelUnit
    sources: dict[str, Source]
    notes: tuple[str, ...]
    doubts: tuple[str, ...] = ()
    estimates: Mapping[str, Estimate] = {}
    errors: Errors | None = None


_NEEDED = ("BELT_MASS", "BELT_IYY", "FREQ_LONG", "FREQ_WINDUP", "DAMP_LONG")
_RADIUS = (0.05, 2.5)  # [m]


def read_tir_unit(
    path: str | PathLike[str], *, wheel_mass: float, suspension_stiffness: float, **fields: Any
) -> TireWheelUnit:
    """The unit of :func:`unit_from_tir` alone; what is doubtful about the file is a warning.

    Parameters
    ----------
    path : path
    wheel_mass, suspension_stiffness : float
        M [kg] and k_s [N/m], which no property file has.
    **fields
        As of :func:`unit_from_tir`, whose errors are raised too.

    Returns
    -------
    TireWheelUnit
    """
    whole = unit_from_tir(path, wheel_mass=wheel_mass, suspension_stiffness=suspension_stiffness, **fields)
    for doubt in whole.doubts:
        warnings.warn(f"{path}: {doubt}", stacklevel=2)
    return whole.unit


def unit_from_tir(
    path: str | PathLike[str],
    *,
    wheel_mass: float,
    suspension_stiffness: float,
    keys: Mapping[str, Any] | None = None,
    estimate: bool = False,
    **fields: Any,
) -> TirUnit:
    """A unit with the rigid ring of a property file, and where each of its fields comes from.

    Parameters
    ----------
    path : path
        As of :func:`.read_tir`. Of its numbers, BELT_MASS, BELT_IYY, FREQ_LONG, FREQ_WINDUP and DAMP_LONG are needed,
        WIDTH, VERTICAL_STIFFNESS and the inflation pressure (INFLPRES, else IP, NOMPRES or IP_NOM) are used where they
        are; MASS, IYY and the radii are compared. A value that is blank, or 0 where that means nothing, is absent.
    wheel_mass : float
        What moves with the wheel, without the belt, M [kg]: no property file knows it.
    suspension_stiffness : float
        k_s [N/m]; nor this.
    keys : mapping of str to object, optional
        Values of the file's keys, in its units, in place of its own.
    estimate : bool
        Whether what is needed and absent is estimated, by the rules of :mod:`.tir_estimate`.
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
        the value and the bound. Or a field or key cannot be given, or is out of bounds.

    Notes
    -----
    a = sqrt(BELT_IYY/BELT_MASS), m = BELT_MASS, k_1 = BELT_MASS (2 pi FREQ_LONG)^2 = pi a b (k_z + k_theta),
    BELT_IYY (2 pi FREQ_WINDUP)^2 = 2 pi a^3 b k_theta, zeta_1 = DAMP_LONG. Where the ring itself is softer at its
    contact than VERTICAL_STIFFNESS, its assumed bending stiffness is raised.
    """
    file = TirFile(path, keys)
    given = {"wheel_mass": wheel_mass, "suspension_stiffness": suspension_stiffness, **fields}
    missing = [key for key in _NEEDED if file.number(key) is None]
    if missing and not estimate:
        are = "is" if len(missing) == 1 else "are"
        raise ValueError(
            f"{path}: {', '.join(map(file.absent, missing))} {are} missing; it is {file.kind}, without the whole rigid "
            "ring of MF-Swift. import-tir --estimate (estimate=True) makes up what is missing from the tire's size, "
            "--key NAME=VALUE gives it"
        )
    made = _made(file, given, estimated(file) if missing else {})
    return made._replace(errors=_errors(file, given, made.unit)) if missing else made


def _made(file: TirFile, given: Mapping[str, Any], estimates: Mapping[str, Estimate]) -> TirUnit:
    path = file.path

    def number(key: str) -> float | None:
        return estimates[key].value if key in estimates else file.number(key)

    def ring(key: str) -> float:
        value = number(key)
        assert value is not None  # the caller has seen to it
        return value

    mass, inertia, long, windup, damping = map(ring, _NEEDED)
    a = math.sqrt(inertia / mass)
    if not _RADIUS[0] <= a <= _RADIUS[1]:
        raise ValueError(
            f"{path}: sqrt(BELT_IYY/BELT_MASS), the radius, is {a:g} m; it must be from {_RADIUS[0]} to {_RADIUS[1]} m"
        )
    k_1 = mass * (2.0 * math.pi * long) ** 2
    k_theta = inertia * (2.0 * math.pi * windup) ** 2 / (2.0 * math.pi * a**3)  # times b, as k_z
    k_z = k_1 / (math.pi * a) - k_theta
    if not k_z > 0.0:
        raise ValueError(
            f"{path}: FREQ_WINDUP is {windup:g} Hz; it must be less than sqrt(2) FREQ_LONG = {2.0**0.5 * long:g} Hz, "
            "lest k_z be negative"
        )
    _check_given(a, given)

    values: dict[str, Any] = dict(given)
    sources = dict.fromkeys(values, Source("given", "given"))

    def put(name: str, value: Any, keys: str, reason: str) -> None:
        """A field from the file's keys, or assumed, unless it is given."""
        if name in values:
            return
        values[name] = value
        made = [key for key in keys.split() if key in estimates]
        kind: Literal["file", "given", "assumed", "estimated"] = "file" if keys else "assumed"
        if made:
            kind, reason = "estimated", f"{reason}; {', '.join(f'{key} by {estimates[key].rule}' for key in made)}"
        elif given_keys := [key for key in keys.split() if key in file.given]:
            reason = f"{reason}; {' and '.join(given_keys)} given"
        sources[name] = Source(kind, reason)

    put("radius", a, "BELT_IYY BELT_MASS", "sqrt(BELT_IYY/BELT_MASS)")
    width = None if "width" in values else number("WIDTH")
    if width is None:
        put("width", a * _TABLE_1.width / _TABLE_1.radius, "", "b/a as in Table 1, WIDTH being absent")
    else:
        put("width", width, "WIDTH", "WIDTH, the nominal section's, which a belt may be narrower than")
    alike = "h/a as in Table 1; only rho h, K and D go into results"
    put("thickness", a * _TABLE_1.thickness / _TABLE_1.radius, "", alike)
    b, h = values["width"], values["thickness"]
    ratio = h / _TABLE_1.thickness
    density = mass / (2.0 * math.pi * a * b * h)
    put("density", density, "BELT_MASS", "BELT_MASS/(2 pi a b h): the ring's mass is BELT_MASS")
    put("membrane_stiffness", _TABLE_1.membrane_stiffness * ratio, "", "the material of Table 1, K ~ h")
    bends = "bending_stiffness" not in values
    put("bending_stiffness", _TABLE_1.bending_stiffness * ratio**3, "", "the material of Table 1, D ~ h^3")
    put("radial_stiffness", k_z / b, "FREQ_LONG", "BELT_MASS (2 pi FREQ_LONG)^2 = k_1 = pi a b (k_z + k_theta)")
    put("tangential_stiffness", k_theta / b, "FREQ_WINDUP", "BELT_IYY (2 pi FREQ_WINDUP)^2 = 2 pi a^3 b k_theta")
    for key in () if "inflation_pressure" in values else PRESSURES:
        pressure = number(key)
        if pressure is not None:
            put("inflation_pressure", pressure, key, key)
            break
    put("inflation_pressure", _TABLE_1.inflation_pressure, "", "that of Table 1, INFLPRES being absent")
    put("zeta_1", damping, "DAMP_LONG", "DAMP_LONG")
    put("zeta_s", _TABLE_1.zeta_s, "", "the default; a tire's file knows no suspension")
    put("zeta_n", _TABLE_1.zeta_n, "", "the default; a rigid ring has no other modes")
    put("contact_half_angle", _TABLE_1.contact_half_angle, "", "the default, a point load")
    by_default = "the paper's; 'reaction' is how MF-Swift damps, and better for a vehicle"
    put("sidewall_damping", _TABLE_1.sidewall_damping, "", by_default)
    put("longitudinal_stiffness", _TABLE_1.longitudinal_stiffness, "", "the default, a wheel that is held")
    put("longitudinal_mass", _TABLE_1.longitudinal_mass, "", "the default, wheel_mass")
    for name in ROTATING:
        put(name, getattr(_TABLE_1, name), "", "the default, a tire that is the same all around")

    notes = list(_notes(file, mass, estimates))
    names = list(_TABLE_1.to_mapping())
    wanted = values.get("vertical_stiffness", number("VERTICAL_STIFFNESS"))
    key = "" if "vertical_stiffness" in given else "VERTICAL_STIFFNESS"
    fits = True
    if wanted:
        raised, fits, words = _bent(values, float(wanted), bends)
        notes += [words] if words else []
        if raised is not None:
            values["bending_stiffness"] = raised
            sources["bending_stiffness"] = Source("assumed", "raised until the ring carries VERTICAL_STIFFNESS")
    if wanted and fits and "vertical_stiffness" in names:  # units know how they stand on the road
        put("vertical_stiffness", wanted, key, "VERTICAL_STIFFNESS")
    elif wanted:
        notes.append("vertical_stiffness is left at 0, a rigid tread on the road: it must be below the ring's own")
    for name in names:
        put(name, getattr(_TABLE_1, name), "", "the default")

    try:
        unit = TireWheelUnit.from_mapping({name: values[name] for name in names})
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    doubts = tuple(_doubts(file, a, estimates))
    return TirUnit(unit, {name: sources[name] for name in names}, tuple(notes), doubts, dict(estimates))


def _check_given(radius: float, given: Mapping[str, Any]) -> None:
    """What is given must be open, and a field of its own right."""
    for name in given:
        if name in _TABLE_1.to_mapping() and name not in (*OPEN_FIELDS, *_ALWAYS_GIVEN):
            raise ValueError(f"{name} cannot be given; the file says it. Fields that can are {', '.join(OPEN_FIELDS)}")
    whole = "vertical_stiffness" if "vertical_stiffness" in _TABLE_1.to_mapping() else ""  # bounded by the whole unit
    own = {name: value for name, value in given.items() if name != whole}
    checked = _TABLE_1.replace(**{"radius": radius, "thickness": 1e-3 * radius, **own})
    for name, low, high in (("width", 1e-3, 1e1), ("thickness", 1e-6, 1e1)):  # beyond them products leave the doubles
        value = getattr(checked, name)
        if name in given and not low <= value <= high:
            raise ValueError(f"{name} is {value!r}; it must be from {low:g} to {high:g} m")


# -- how the ring stands on its contact ---------------------------------------------------------------------------

_MODES = 100
_LEFT = 1.01  # own stiffness over VERTICAL_STIFFNESS, so that a residual spring is left to any number of modes


def _bent(values: Mapping[str, Any], wanted: float, may: bool) -> tuple[float | None, bool, str]:
    """The bending stiffness with which the ring is as stiff as is wanted, if it is raised; whether it is; in words."""
    names = [name for name in _TABLE_1.to_mapping() if name in values and name != "vertical_stiffness"]
    unit = _TABLE_1.replace(**{name: values[name] for name in names})

    def own(bending: float) -> float:
        return 1.0 / static_compliance(unit.replace(bending_stiffness=bending), _MODES)

    now = own(unit.bending_stiffness)
    if now >= _LEFT * wanted:
        return None, True, ""
    soft = f"the ring's own static stiffness is {now:.4g} N/m, below VERTICAL_STIFFNESS = {wanted:.4g} N/m"
    if not may:
        return None, now > wanted, f"{soft}; bending_stiffness is given, and stays"
    stiffest = 1e6 * unit.bending_stiffness
    if own(stiffest) <= _LEFT * wanted:
        return None, False, f"{soft}; no bending stiffness mends that, for k_1 is {unit.sidewall_stiffness:.4g} N/m"
    found: float = optimize.brentq(
        lambda x: math.log(own(math.exp(x)) / (_LEFT * wanted)), math.log(unit.bending_stiffness), math.log(stiffest)
    )
    raised = max(math.exp(found), unit.bending_stiffness)
    words = f"{soft}; the assumed bending_stiffness is raised from {unit.bending_stiffness:.4g} to {raised:.4g} N m"
    return raised, True, words


# -- notes and doubts ---------------------------------------------------------------------------------------------


def _notes(file: TirFile, belt: float, estimates: Mapping[str, Estimate]) -> Iterator[str]:
    if file.without_unit:
        yield f"[UNITS] does not say {', '.join(file.without_unit)}; SI units are assumed"
    yield from file.passed_over()
    for key, (value, low, high, rule) in estimates.items():
        unit = f" {KEYS[key].unit}".rstrip()
        yield f"{key} is estimated, {value:.3g}{unit} ({low:.3g} to {high:.3g}): {rule}"
    whole = file.usable("MASS")
    if whole is not None and whole >= belt:
        yield f"the tire is {whole:g} kg, of which {whole - belt:.4g} kg beside the belt belong to the wheel's mass"


# What tools write that know nothing of the belt, in SI units.
_DEFAULTS = {"BELT_MASS": 7.0, "BELT_IYY": 0.6, "FREQ_LONG": 80.0, "FREQ_WINDUP": 70.0, "DAMP_LONG": 0.04}
_SHARES: Sequence[tuple[str, str, float]] = (("BELT_MASS", "MASS", 0.5), ("BELT_IYY", "IYY", 0.4))


def _doubts(file: TirFile, a: float, estimates: Mapping[str, Estimate]) -> Iterator[str]:
    """Where the belt is hardly this tire's, or a value hardly in the file's unit."""
    free, rim = file.usable("UNLOADED_RADIUS"), file.usable("RIM_RADIUS")
    own = not {"BELT_MASS", "BELT_IYY"} & estimates.keys()
    for key in ("UNLOADED_RADIUS", "RIM_RADIUS", "MASS", "IYY", "VERTICAL_STIFFNESS"):
        try:
            file.number(key)
        except ValueError as error:
            yield str(error).removeprefix(f"{file.path}: ")
    if free is not None and rim is not None and rim >= free:
        yield f"RIM_RADIUS = {rim:g} m is not less than UNLOADED_RADIUS = {free:g} m"
    elif own and free is not None and a > free:
        yield f"the belt's radius, sqrt(BELT_IYY/BELT_MASS) = {a:.4g} m, is more than UNLOADED_RADIUS = {free:g} m"
    elif own and rim is not None and a <= rim:
        yield f"the belt's radius, sqrt(BELT_IYY/BELT_MASS) = {a:.4g} m, is within RIM_RADIUS = {rim:g} m"
    elif own and free is not None and rim is not None and a < rim + 0.2 * (free - rim):
        yield (
            f"the belt's radius, sqrt(BELT_IYY/BELT_MASS) = {a:.4g} m, is nearer to RIM_RADIUS = {rim:g} m than a "
            f"belt's under UNLOADED_RADIUS = {free:g} m"
        )
    for part, whole, least in _SHARES:
        value, total = (None if part in estimates else file.number(part)), file.usable(whole)
        if value is None or total is None:
            continue
        if value >= total:
            yield f"{part} = {value:g} is not less than {whole} = {total:g}, of which it is a part"
        elif value < least * total:
            yield f"{part} = {value:g} is {value / total:.0%} of {whole} = {total:g}; of measured tires 58 to 86 %"
    at = [key for key, value in _DEFAULTS.items() if key not in estimates and file.number(key) == value]
    if len(at) >= 4:
        yield (
            f"{', '.join(f'{key} = {_DEFAULTS[key]:g}' for key in at)} are what tools write by default, whatever the "
            "tire's size"
        )
    pressures = [key for key in PRESSURES if key not in estimates and file.usable(key) is not None][:1]
    for key in pressures:
        doubt = file.pressure_doubt(key)
        if doubt is not None:
            yield doubt
    width, pressure = file.usable("WIDTH"), file.usable(pressures[0]) if pressures else None
    stiffness = None if "VERTICAL_STIFFNESS" in estimates else file.usable("VERTICAL_STIFFNESS")
    if None not in (free, rim, width, stiffness) and rim < free:  # type: ignore[operator]
        likely = stiffness_of_size(free, rim, width, pressure or 2.2e5)  # type: ignore[arg-type]
        if not (0.33 if pressure else 0.2) < stiffness / likely < (3.0 if pressure else 6.0):  # type: ignore[operator]
            yield f"VERTICAL_STIFFNESS is {stiffness:.3g} N/m; a tire of this size and pressure has about {likely:.2g}"


# -- how far estimates may be off ---------------------------------------------------------------------------------

_STEP = 1e-3


def _errors(file: TirFile, given: Mapping[str, Any], unit: TireWheelUnit) -> Errors:
    """To first order: the logarithms of the fields from those of the rules, which are independent."""
    names = [name for name in UNCERTAIN if value_of(unit, name) > 0.0]

    def logs(name: str, step: float) -> FloatArray:
        moved = _made(file, given, estimated(file, {name: step})).unit
        return np.log([value_of(moved, each) for each in names])

    slopes = [(logs(name, _STEP) - logs(name, -_STEP)) / (2.0 * _STEP) * rule.spread for name, rule in RULES.items()]
    J = np.column_stack(slopes)
    size = np.sqrt(np.sum(J * J, axis=1))
    k_1 = float(size[names.index("k_1")])
    kept = [k for k, name in enumerate(names) if size[k] > 1e-6 and name != "k_1"]  # its stiffnesses have it
    correlation = J[kept] @ J[kept].T / np.outer(size[kept], size[kept])
    return Errors({names[k]: float(size[k]) for k in kept}, correlation, k_1)
