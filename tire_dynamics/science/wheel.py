"""n = 1 and the wheel: what is asked of a unit at a speed, and the names of all modules that answer.

``wheel_matrices`` has the equations, ``wheel_state`` what their states say, ``wheel_stability`` the closed form of a
uniform tire, ``response`` steady and periodic loads, ``maps`` grids. Here the unit decides which equations are
asked: those of a uniform tire, those of a sidewall that varies (``nonuniform``), or those of a tire on the road
(``contact``).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from . import contact as road
from . import nonuniform_matrices, nonuniform_stability
from .coefficients import residual_stiffness
from .floquet import FloquetResult
from .maps import StabilityMap, TransmissibilityMap, stability_map, transmissibility_map
from .nonuniform_matrices import Nonuniformity
from .response import frequency_response, transmissibility, whirl_frequencies
from .unit import TireWheelUnit
from .wheel_matrices import (
    FixedFrame,
    check_speed,
    fixed_frame,
    fixed_frame_matrix,
    rotation,
    stacked_frames,
    states,
    uniform_state_matrix,
)
from .wheel_matrices import Model as Model
from .wheel_stability import crossings, uniform_stability
from .wheel_state import (
    axle_force,
    axle_forces,
    belt_amplitudes,
    change_speed,
    equilibrium,
    output_matrices,
    reshaped,
    ring_centre,
    wheel_displacement,
)

__all__ = [
    "FixedFrame",
    "StabilityMap",
    "TransmissibilityMap",
    "axle_force",
    "axle_forces",
    "belt_amplitudes",
    "change_speed",
    "critical_speed",
    "crossings",
    "equilibrium",
    "fixed_frame",
    "fixed_frame_matrix",
    "frequency_response",
    "is_unstable",
    "judged_speed",
    "output_matrices",
    "residual_stiffness",
    "reshaped",
    "ring_centre",
    "rotation",
    "stability",
    "stability_map",
    "stacked_frames",
    "state_matrix",
    "states",
    "transmissibility",
    "transmissibility_map",
    "wheel_displacement",
    "whirl_frequencies",
]

FloatArray = NDArray[np.float64]


def state_matrix(unit: TireWheelUnit, speed: float, time: float, model: Model = "inextensional") -> FloatArray:
    """The periodic state matrix A(t) seen from the rotating ring, (3.13) or (3.4), phi = Omega t.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign; the period is 2 pi/abs(Omega).
    time : float
        Time [s].
    model : {"inextensional", "complete"}

    Returns
    -------
    ndarray, shape (n, n)
        With the unit's own non-uniformity: :func:`.nonuniform.state_matrix`.
    """
    if unit.is_uniform:
        return uniform_state_matrix(unit, speed, time, model)
    check_speed(speed)
    return nonuniform_matrices.state_matrix(unit, Nonuniformity.of(unit), speed, time, model)


def stability(
    unit: TireWheelUnit,
    speed: float,
    model: Model = "inextensional",
    *,
    contact: bool = False,
    n_max: int = 30,
) -> FloquetResult:
    """Floquet stability at a constant speed, of a uniform unit in closed form.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Spin Omega [rad/s], either sign. At standstill there is no period; the verdict comes from the exponents.
    model : {"inextensional", "complete"}
    contact : bool
        On the road, without lift-off (:func:`.contact.stability`), and not under a load that is given.
    n_max : int
        Highest belt harmonic on the road; under a given load, the sidewall being uniform, n = 1 alone reaches the
        wheel.

    Returns
    -------
    FloquetResult
        multipliers = exp(lambda T), lambda the eigenvalues of the fixed-frame matrix, T = 2 pi/abs(Omega). Of a unit
        whose sidewall is not uniform what :func:`.nonuniform.stability` says.
    """
    if contact:
        return road.stability(unit, speed, model, n_max)
    if unit.is_uniform:
        return uniform_stability(unit, speed, model)
    return nonuniform_stability.stability(unit, Nonuniformity.of(unit), speed, model)


def is_unstable(unit: TireWheelUnit, speed: float, model: Model = "inextensional") -> bool:
    """Whether the verdict of :func:`stability` at this speed is "unstable"; remembered.

    Of a unit that is not uniform, at this speed to 1 rad/s and above 20: what takes milliseconds is not done at each.
    """
    return _is_unstable(unit, judged_speed(unit, speed), model)


def judged_speed(unit: TireWheelUnit, speed: float) -> float:
    """The speed at which :func:`is_unstable` looks for one that it is asked about.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        [rad/s]

    Returns
    -------
    float
        Of a uniform unit the same; of another the next whole number of rad/s, at least 20, with the same sign.
    """
    if unit.is_uniform:
        return speed
    return math.copysign(max(float(round(abs(speed))), 20.0), speed)


@lru_cache(maxsize=1024)
def _is_unstable(unit: TireWheelUnit, speed: float, model: Model) -> bool:
    try:
        return stability(unit, speed, model).verdict == "unstable"
    except ArithmeticError:  # it grows beyond all numbers in a turn, or a turn is too long
        return bool(np.linalg.eigvals(fixed_frame_matrix(unit, speed, model)).real.max() > 0.0)


@lru_cache(maxsize=256)
def critical_speed(
    unit: TireWheelUnit, model: Model = "inextensional", *, contact: bool = False, n_max: int = 30
) -> float | None:
    """The lowest speed at which the unit loses stability [rad/s], or None if it never does.

    Of a unit that is not uniform it is its mean's: :func:`.nonuniform.combination_resonances` has what comes beside.

    Parameters
    ----------
    unit : TireWheelUnit
    model : {"inextensional", "complete"}
    contact, n_max
        As of :func:`stability`; on the road it is :func:`.contact.critical_speed`.

    Notes
    -----
    The lowest of the speeds of :func:`crossings` at which stability is lost. It is no limit for standing waves of the
    belt, which the model does not have (docs/limits.md).
    """
    if contact:
        return road.critical_speed(unit, model, n_max)
    return next((speed for speed, lost in crossings(unit, model) if lost), None)
