"""Floquet stability of a tire whose sidewall is not uniform."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from . import floquet
from .floquet import FloquetResult
from .nonuniform_matrices import (
    Nonuniformity,
    anisotropy,
    check_model,
    coordinates,
    coupling,
    periodic_frame,
    seen_by_the_sidewall,
    state_matrix,
    uniform_part,
)
from .periodic import Transition, Trigonometric, transition
from .unit import TireWheelUnit
from .wheel_matrices import Model, fixed_frame_matrix
from .wheel_stability import uniform_stability

__all__ = ["half_turn", "stability"]

FloatArray = NDArray[np.float64]


def stability(
    unit: TireWheelUnit,
    nonuniformity: Nonuniformity,
    speed: float,
    model: Model = "inextensional",
    n_max: int = 1,
) -> FloquetResult:
    """Floquet stability at a constant speed.

    Parameters
    ----------
    unit : TireWheelUnit
    nonuniformity : Nonuniformity
    speed : float
        Spin Omega [rad/s], either sign. At standstill there is no period; the verdict comes from the exponents.
    model : {"inextensional", "complete"}
    n_max : int
        As of :func:`state_matrix`.

    Returns
    -------
    FloquetResult
        Of one turn. :func:`.wheel.stability` itself where n_max is 1 and nothing varies that n = 1 could feel.

    Raises
    ------
    ValueError
        An argument is out of its bounds.
    ArithmeticError
        The speed is so low that a turn is too long to be integrated, or the solution overflows.

    Notes
    -----
    Half a turn is enough: it changes nothing in the ring's frame but the sign of y and x, so the monodromy matrix is
    the square of D Phi(pi), D the change of sign. For n = 1 in the fixed frame there is no such sign. The work grows
    as 1/Omega; see :func:`.periodic.transition` for where it ends.
    """
    if n_max == 1 and not any(anisotropy(unit, nonuniformity, check_model(model))):
        return uniform_stability(unit.mean, speed, model)
    if not abs(speed) > 1e-300:
        return floquet.analyze_constant(state_matrix(unit, nonuniformity, speed, 0.0, model, n_max))
    half = half_turn(unit, [nonuniformity], speed, model, n_max)
    period = 2.0 * math.pi / abs(speed)
    return floquet.judge(half.matrix[0], float(half.log_norm[0]), float(half.error[0]), period, 2)


def half_turn(unit: TireWheelUnit, several: list[Nonuniformity], speed: float, model: Model, n_max: int) -> Transition:
    """Matrices whose squares are those of a whole turn, one for each of several nonuniformities."""
    sign = None
    if n_max == 1:
        frames = [periodic_frame(unit, each, model) for each in several]
        system = Trigonometric(
            np.stack([fixed_frame_matrix(unit, speed, model)] * len(frames)),
            (2,),
            np.stack([frame.cosine for frame in frames])[None],
            np.stack([frame.sine for frame in frames])[None],
        )
    else:
        system = _stack([_trigonometric(unit, each, speed, model, n_max) for each in several])
        half = system.constant.shape[-1] // 2
        sign = np.ones(2 * half)
        ring_coordinates = len(coordinates(model, n_max))
        sign[ring_coordinates:half] = sign[half + ring_coordinates :] = -1.0
    result = transition(system, speed, 0.0, math.copysign(math.pi, speed))
    return result if sign is None else result._replace(matrix=sign[:, None] * result.matrix)


def _trigonometric(
    unit: TireWheelUnit, nonuniformity: Nonuniformity, speed: float, model: Model, n_max: int
) -> Trigonometric:
    """A(phi) in the ring's frame: the first harmonic is the wheel's, the second the sidewall's on the wheel."""
    quarter = 0.5 * math.pi / speed
    before, right, opposite = (uniform_part(unit, speed, k * quarter, model, n_max) for k in range(3))
    constant = 0.5 * (before + opposite)
    cosines, sines = np.stack([before - constant, 0.0 * constant]), np.stack([right - constant, 0.0 * constant])
    stiffness, mass = coupling(unit, nonuniformity.radial, nonuniformity.tangential, speed, model, n_max)
    still, s, c = seen_by_the_sidewall(unit, model, n_max)
    half = len(mass)

    def acts(left: FloatArray, right: FloatArray) -> FloatArray:
        product = left.T @ stiffness @ right
        return (product + product.T) / (2.0 * mass[:, None])

    place = np.s_[:half, half:]
    constant[place] -= acts(still, still) + 0.5 * (acts(s, s) + acts(c, c))
    sines[0][place] -= 2.0 * acts(still, s)
    cosines[0][place] -= 2.0 * acts(still, c)
    cosines[1][place] -= 0.5 * (acts(c, c) - acts(s, s))
    sines[1][place] -= acts(s, c)
    return Trigonometric(constant, (1, 2), cosines, sines)


def _stack(systems: list[Trigonometric]) -> Trigonometric:
    constants, harmonics, cosines, sines = zip(*systems, strict=True)
    return Trigonometric(np.stack(constants), harmonics[0], np.stack(cosines, axis=1), np.stack(sines, axis=1))
