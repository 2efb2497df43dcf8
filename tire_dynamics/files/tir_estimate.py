"""A rigid ring for property files that have none: stated rules, each with its source and its spread.

Most property files are of the Magic Formula alone (5.2, 6.1, PAC2002) or of Fiala's model. What they say of a tire's
size, mass and stiffness bounds its ring. docs/model.md has the sets of measured rings that the shares come from.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from .tir_file import PRESSURES, TirFile

__all__ = ["Estimate", "RULES", "Rule", "estimated", "stiffness_of_size", "tire_mass_of_size"]


class Rule(NamedTuple):
    """A number that many tires share more or less, with the standard deviation of its logarithm."""

    value: float
    spread: float
    source: str


class Estimate(NamedTuple):
    """A key's value that a rule gave.

    Attributes
    ----------
    value, low, high : float
        In SI units; one tire in ten is expected outside of low to high.
    rule : str
        By which rule, in words.
    """

    value: float
    low: float
    high: float
    rule: str


_RINGS = "four measured rings (Zegelaar 1998; MF-Swift's two of the same 205/60R15; a 13 inch racing tire)"

RULES: Final[Mapping[str, Rule]] = {
    "belt's share of MASS": Rule(0.77, 0.07, _RINGS),
    "belt's share of IYY": Rule(0.71, 0.17, _RINGS),
    "belt's radius over UNLOADED_RADIUS": Rule(0.87, 0.08, _RINGS),
    "k_1 over VERTICAL_STIFFNESS": Rule(7.4, 0.25, "three measured rings, MF-Swift's"),
    "FREQ_WINDUP over FREQ_LONG": Rule(0.83, 0.08, "three measured rings, MF-Swift's"),
    "DAMP_LONG": Rule(0.05, 0.2, "three measured rings, MF-Swift's"),
    "mass by size": Rule(11.7, 0.3, "9.3 kg of a 205/60R15; an 11R22.5 has 53 to 57 kg, and by this 55"),
    "stiffness by size": Rule(1.0, 0.15, "Rhyne, Tire Science and Technology 33 (2005) 136"),
    "pressure by stiffness": Rule(1.0, 0.3, "Rhyne's relation, solved for the pressure"),
    "pressure by size": Rule(1.0, 0.4, "2.2 bar of a car's tire, 8 bar of one larger than 0.42 m"),
    "rim by size": Rule(0.63, 0.1, "0.6 of a car's tire, 0.7 of a racing or motorcycle's"),
    "width by size": Rule(0.65, 0.2, "205 mm of a 205/60R15"),
}

_TENTH = 1.645  # standard deviations beyond which a normal variable is once in ten times, on either side
_NEARLY = 0.98


def tire_mass_of_size(radius: float, rim: float, width: float) -> float:
    """Mass of a tire of this size [kg], 11.7 kg/m^2 (R/0.3135 m)^1.5 over tread and sidewalls.

    Parameters
    ----------
    radius, rim, width : float
        Unloaded radius, rim's radius and section width [m].
    """
    area = 2.0 * math.pi * (radius * width + max(radius**2 - rim**2, 0.0))
    return RULES["mass by size"].value * area * math.pow(radius / 0.3135, 1.5)


def stiffness_of_size(radius: float, rim: float, width: float, pressure: float) -> float:
    """Vertical stiffness of a belted radial tire [N/m], after Rhyne (2005).

    Parameters
    ----------
    radius, rim, width : float
        Unloaded radius, rim's radius and section width [m].
    pressure : float
        [Pa]

    Notes
    -----
    K [kgf/mm] = 0.00028 p sqrt[(1.03 - 0.004 A) S (S A/50 + D)] + 3.45, p in kPa, section width S and rim diameter D
    in mm, A the section's height over its width in percent.
    """
    return (0.00028 * 1e-3 * pressure * _footprint(radius, rim, width) + 3.45) * 9806.65


def _footprint(radius: float, rim: float, width: float) -> float:
    aspect = min(max(100.0 * (radius - rim) / width, 20.0), 110.0)
    return 1e3 * math.sqrt((1.03 - 0.004 * aspect) * width * (2.0 * radius))


def _pressure_of(stiffness: float, radius: float, rim: float, width: float) -> float:
    found: float = (stiffness / 9806.65 - 3.45) / (0.00028 * 1e-3 * _footprint(radius, rim, width))
    return min(max(found, 8e4), 1.2e6)


def estimated(file: TirFile, off: Mapping[str, float] | None = None) -> dict[str, Estimate]:
    """What the rules make of a file for the keys that it lacks.

    Parameters
    ----------
    file : TirFile
    off : mapping of str to float, optional
        By how much the logarithms of some of ``RULES`` are off their value.

    Returns
    -------
    dict of str to Estimate
        By the keys of MF-Swift, those that the file lacks.

    Raises
    ------
    ValueError
        The file has no UNLOADED_RADIUS, or a value is out of bounds.
    """
    estimates: dict[str, Estimate] = {}
    variances: dict[str, float] = {}  # of the logarithms, by key

    def rule(name: str) -> float:
        return RULES[name].value * math.exp((off or {}).get(name, 0.0))

    def have(key: str, value: float, variance: float, words: str, most: float = math.inf) -> float:
        """The file's value, or this one in its place."""
        own = file.usable(key) if key in ("MASS", "RIM_RADIUS") else file.number(key)
        if own is not None:
            variances[key] = 0.0
            return own
        factor = math.exp(_TENTH * math.sqrt(variance))
        variances[key] = variance
        estimates[key] = Estimate(min(value, most), min(value, most) / factor, min(value * factor, most), words)
        return estimates[key].value

    radius = file.number("UNLOADED_RADIUS")
    if radius is None:
        raise ValueError(f"{file.path}: {file.absent('UNLOADED_RADIUS')} is missing; nothing can be estimated without")
    width, rim = _section(file, radius, rule, have, variances)

    by_size = rule("mass by size") / RULES["mass by size"].value * tire_mass_of_size(radius, rim, width)
    words = f"{_share('mass by size')} kg/m^2 (UNLOADED_RADIUS/0.3135 m)^1.5 over tread and sidewalls"
    mass = by_size if file.number("BELT_MASS") else have("MASS", by_size, _square("mass by size"), words)
    share = "belt's share of MASS"
    variance = _square(share) + variances.get("MASS", 0.0)
    belt = have("BELT_MASS", rule(share) * mass, variance, f"{_share(share)} MASS")

    IYY = file.usable("IYY")
    if IYY is not None:
        share = "belt's share of IYY"
        a, variance, words = math.sqrt(rule(share) * IYY / belt), _square(share), f"{_share(share)} IYY"
    else:
        share = "belt's radius over UNLOADED_RADIUS"
        a, variance = rule(share) * radius, 4.0 * _square(share) + variances["BELT_MASS"]
        words = f"BELT_MASS ({_share(share)} UNLOADED_RADIUS)^2"
    a = min(max(a, rim + 0.25 * (radius - rim)), _NEARLY * radius)
    have("BELT_IYY", belt * a**2, variance, words)

    stiffness = file.number("VERTICAL_STIFFNESS")
    key = next((key for key in PRESSURES if file.number(key) is not None), "INFLPRES")
    if stiffness is not None:
        share, words = "pressure by stiffness", "that with which Rhyne's relation has VERTICAL_STIFFNESS"
        pressure = have(key, rule(share) * _pressure_of(stiffness, radius, rim, width), _square(share), words)
    else:
        share, words = "pressure by size", "2.2 bar, 8 bar of a tire larger than 0.42 m"
        pressure = have(key, rule(share) * (8e5 if radius > 0.42 else 2.2e5), _square(share), words)
        if file.number("FREQ_LONG") is None:
            share, words = "stiffness by size", "Rhyne's relation, of size and pressure"
            by_size = rule(share) * stiffness_of_size(radius, rim, width, pressure)
            stiffness = have("VERTICAL_STIFFNESS", by_size, _square(share) + 0.7 * variances[key], words)

    share = "k_1 over VERTICAL_STIFFNESS"
    variance = (_square(share) + variances.get("VERTICAL_STIFFNESS", 0.0) + variances["BELT_MASS"]) / 4.0
    words = f"{_share(share)} VERTICAL_STIFFNESS = BELT_MASS (2 pi FREQ_LONG)^2"
    long = have("FREQ_LONG", math.sqrt(rule(share) * (stiffness or 0.0) / belt) / (2.0 * math.pi), variance, words)
    share = "FREQ_WINDUP over FREQ_LONG"
    variance = _square(share) + variances["FREQ_LONG"]
    have("FREQ_WINDUP", rule(share) * long, variance, f"{_share(share)} FREQ_LONG", most=1.35 * long)
    # A 0 beside a frequency that is not there is that of a tool, of which nothing was filled in.
    if file.number("DAMP_LONG") is None or (not file.number("DAMP_LONG") and "FREQ_LONG" in estimates):
        value, factor = rule("DAMP_LONG"), math.exp(_TENTH * RULES["DAMP_LONG"].spread)
        estimates["DAMP_LONG"] = Estimate(
            value, value / factor, value * factor, f"{_share('DAMP_LONG')} of measured rings"
        )
    return estimates


def _section(
    file: TirFile,
    radius: float,
    rule: Callable[[str], float],
    have: Callable[..., float],
    variances: Mapping[str, float],
) -> tuple[float, float]:
    """Width and rim radius [m]."""
    name = "width by size"
    width = have("WIDTH", rule(name) * radius, _square(name), f"{_share(name)} UNLOADED_RADIUS")
    aspect = file.usable("ASPECT_RATIO")
    if aspect is not None and 0.0 < radius - aspect * width:
        value, variance = radius - aspect * width, 0.02**2 + variances["WIDTH"] / 4.0
        words = "UNLOADED_RADIUS less ASPECT_RATIO times WIDTH"
    else:
        name = "rim by size"
        value, variance, words = rule(name) * radius, _square(name), f"{_share(name)} UNLOADED_RADIUS"
    rim = have("RIM_RADIUS", value, variance, words, most=_NEARLY * radius)
    return width, min(rim, _NEARLY * radius)


def _share(name: str) -> str:
    return f"{RULES[name].value:g}"


def _square(name: str) -> float:
    return RULES[name].spread ** 2
