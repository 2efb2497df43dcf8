"""What uncertain parameters leave certain: bands on transmissibility and critical speed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import wheel
from .unit import NUMBERS, TireWheelUnit

__all__ = ["SHARES", "UNCERTAIN", "Bands", "bands", "sample", "value_of", "with_values"]

FloatArray = NDArray[np.float64]

SHARES: Final = (0.05, 0.5, 0.95)
"""Of the samples that lie below the three numbers of a band."""

UNCERTAIN: Final = (
    "k_1",
    *NUMBERS,
)
"""What can have an error: ``k_1``, which moves radial and tangential stiffness together, and every field of numbers."""

_BELOW_1: Final = math.nextafter(1.0, 0.0)


def value_of(unit: TireWheelUnit, name: str) -> float:
    """The value of one of ``UNCERTAIN`` in a unit; a ``longitudinal_mass`` of 0 stands for the wheel's."""
    if name == "k_1":
        return unit.sidewall_stiffness
    return unit.fore_aft_mass if name == "longitudinal_mass" else float(getattr(unit, name))


def with_values(unit: TireWheelUnit, values: Mapping[str, float]) -> TireWheelUnit:
    """The unit with other values of some of ``UNCERTAIN``."""
    changes = dict(values)
    if "k_1" in changes:
        k_1 = changes.pop("k_1")
        whole = unit.replace(**changes) if changes else unit
        factor = k_1 / whole.sidewall_stiffness
        changes["radial_stiffness"] = whole.radial_stiffness * factor
        changes["tangential_stiffness"] = whole.tangential_stiffness * factor
    return unit.replace(**changes)


@dataclass(frozen=True, eq=False)
class Bands:
    """What samples of an uncertain unit have; of each band the values below which ``SHARES`` of the samples lie.

    Attributes
    ----------
    transmissibility : ndarray, shape (3,)
        At the speed [-].
    critical_speed : ndarray, shape (3,)
        The lowest speed at which stability is lost [rad/s]; infinite where so many samples never lose it.
    never : float
        Share of the samples that never lose stability.
    unstable : float
        Share of the samples that are unstable at the speed.
    transmissibilities, critical_speeds : ndarray, shape (N,)
        Of each sample; infinite where stability is never lost.
    """

    transmissibility: FloatArray
    critical_speed: FloatArray
    never: float
    unstable: float
    transmissibilities: FloatArray
    critical_speeds: FloatArray


def sample(
    unit: TireWheelUnit,
    errors: Mapping[str, float],
    correlation: ArrayLike | None = None,
    *,
    samples: int = 1000,
    seed: int = 0,
) -> list[TireWheelUnit]:
    """Units whose uncertain values are drawn around a unit's.

    Parameters
    ----------
    unit : TireWheelUnit
        Its values are the medians.
    errors : mapping of str to float
        Standard errors of the logarithms of some of ``UNCERTAIN``: 0.02 is 2 %. Values are log-normal, hence positive;
        damping ratios stop below 1.
    correlation : array_like, shape (P, P), optional
        Of the logarithms, in the order of ``errors``; without it they are independent.
    samples, seed : int

    Returns
    -------
    list of TireWheelUnit

    Raises
    ------
    ValueError
        A name or an error is out of bounds, a value is 0, or the correlation is none.
    """
    names: Sequence[str] = tuple(errors)
    if getattr(unit, "vertical_stiffness", 0.0):  # of no effect here, and bounded by what varies
        unit = unit.replace(vertical_stiffness=0.0)
    for name, error in errors.items():
        if name not in UNCERTAIN:
            raise ValueError(f"{name[:100]!r} cannot have an error; what can is {', '.join(UNCERTAIN)}")
        if not 0.0 <= error <= 3.0:
            raise ValueError(f"the error of {name} is {error!r} of its value; it must be from 0 to 3")
        if not value_of(unit, name) > 0.0:
            raise ValueError(f"{name} is 0; what has an error must be > 0")
    if "k_1" in errors and {"radial_stiffness", "tangential_stiffness"} & errors.keys():
        raise ValueError("k_1 and the stiffnesses that make it cannot both have errors")
    if not 1 <= samples <= 100_000:
        raise ValueError(f"samples is {samples}; it must be from 1 to 100000")
    C = np.eye(len(names)) if correlation is None else np.asarray(correlation, np.float64)
    if C.shape != (len(names), len(names)) or not np.isfinite(C).all() or not np.allclose(C, C.T, atol=1e-6):
        raise ValueError(f"correlation has shape {C.shape}; it must be symmetric, {len(names)} x {len(names)}")
    sizes, directions = np.linalg.eigh(C)
    if not np.allclose(np.diag(C), 1.0, atol=1e-6) or sizes.min(initial=0.0) < -1e-6:
        raise ValueError("correlation is none: its diagonal must be 1, and no combination may have a negative variance")
    root = directions * np.sqrt(np.maximum(sizes, 0.0))
    deviation = np.random.default_rng(seed).standard_normal((samples, len(names))) @ root.T
    values = np.array([value_of(unit, name) for name in names]) * np.exp(deviation * list(errors.values()))
    for k, name in enumerate(names):
        if name.startswith("zeta_") or name == "longitudinal_damping_ratio":
            values[:, k] = np.minimum(values[:, k], _BELOW_1)
    return [with_values(unit, dict(zip(names, row, strict=True))) for row in values.tolist()]


def bands(
    unit: TireWheelUnit,
    speed: float,
    errors: Mapping[str, float],
    correlation: ArrayLike | None = None,
    *,
    samples: int = 1000,
    seed: int = 0,
    model: wheel.Model = "inextensional",
) -> Bands:
    """Bands on transmissibility and critical speed, by samples through the exact formulas.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s].
    errors, correlation, samples, seed
        As :func:`sample` takes them.
    model : {"inextensional", "complete"}
        Of the critical speed; the transmissibility is that of the inextensional model.

    Returns
    -------
    Bands

    Raises
    ------
    ValueError
        As of :func:`sample`.

    Examples
    --------
    >>> found = bands(TireWheelUnit.table_1(), 209.4, {"zeta_1": 0.1}, samples=200)
    >>> bool(found.critical_speed[0] < wheel.critical_speed(TireWheelUnit.table_1()) < found.critical_speed[2])
    True
    """
    units = sample(unit, errors, correlation, samples=samples, seed=seed)
    K = np.array([wheel.transmissibility(each, speed) for each in units])
    # not critical_speed, which would remember each
    lost = (next((at for at, gone in wheel.crossings(each, model) if gone), math.inf) for each in units)
    critical = np.fromiter(lost, np.float64, len(units))
    unstable = np.mean([wheel.stability(each, speed, model).verdict == "unstable" for each in units])
    return Bands(_quantiles(K), _quantiles(critical), float(np.mean(np.isinf(critical))), float(unstable), K, critical)


def _quantiles(values: FloatArray) -> FloatArray:
    """The samples at ``SHARES``; no mean of two, of which one may be infinite."""
    found: FloatArray = np.quantile(values, SHARES, method="inverted_cdf")
    return found
