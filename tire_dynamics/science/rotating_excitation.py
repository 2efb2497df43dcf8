"""What turns with a tire that is not the same all around: its forces on n = 1 and the wheel, as stepping needs them.

In the fixed frame, phi the wheel's angle, z the states of ``wheel.fixed_frame``,

    z' = (C + Omega S) z + B [load, traction] + imbalance - M^-1 N^T kappa exp(2 i phi) conj(R),   R = N q,

where R is what the sidewall sees, one complex number for each kind of spring, and kappa = k e exp(2 i chi) how much its
stiffness differs along and across (``nonuniform``). The imbalance is m_u a Omega^2 at the angle theta_u + phi. Run-out
acts on the road alone, where it is a road that turns with the tire: a load that is given does not ask for it.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import wheel
from .elementary import cos_sin
from .nonuniform import Nonuniformity, sidewall
from .stepping import solve_in_order
from .unit import TireWheelUnit

__all__ = ["RotatingExcitation", "rotating_excitation", "steady_state"]

FloatArray = NDArray[np.float64]

_FOURTH = 4  # harmonic of the spin that a stiffness of the second makes of its own response


class RotatingExcitation(NamedTuple):
    """The parts of the system in the module's notes, for a unit with n states and p kinds of springs.

    Attributes
    ----------
    system : ndarray, shape (n + 2 p, n + 2 p)
        C, with R behind z: [v', q', R'] from [v, q, g], g the springs' force beyond their mean, [re, im] each.
    spin : ndarray, shape (n + 2 p, n + 2 p)
        S, likewise.
    input : ndarray, shape (n + 2 p, 2)
        B.
    seen : ndarray, shape (2 p, n)
        N, of whole states.
    spring : ndarray, shape (p, 2)
        kappa, [re, im] [N/m].
    imbalance : ndarray, shape (n + 2 p, 2)
        What cos phi and sin phi bring, over Omega^2.
    sizes : ndarray, shape (4,)
        Norms of C, S, kappa's part and E, displacements times the highest frequency beside velocities [1/s].
    highest : int
        Of the harmonics of the spin that are summed.
    wheel_x : ndarray, shape (2 p,)
        The force on the wheel along the paper's X is this times g.
    is_rotating : bool
        Whether there are springs or an imbalance that rotate; of a uniform unit p is zero.
    """

    system: FloatArray
    spin: FloatArray
    input: FloatArray
    seen: FloatArray
    spring: FloatArray
    imbalance: FloatArray
    sizes: FloatArray
    highest: int
    wheel_x: FloatArray
    is_rotating: bool


@lru_cache(maxsize=256)
def rotating_excitation(unit: TireWheelUnit, model: wheel.Model = "inextensional") -> RotatingExcitation:
    """The system as stepping needs it, with what turns with a unit that n = 1 could feel.

    Parameters
    ----------
    unit : TireWheelUnit
    model : {"inextensional", "complete"}

    Returns
    -------
    RotatingExcitation
        Its arrays are shared, and cannot be written to.
    """
    mean = wheel.fixed_frame(unit, model)
    n, half = len(mean.constant), len(mean.constant) // 2
    net, masses, along_x, strengths = sidewall(unit, Nonuniformity.of(unit), model)
    spring = np.array([[each.real, each.imag] for each in strengths]).reshape(-1, 2)
    if not spring.any():
        net, along_x, spring = np.empty((0, half)), np.empty(0), np.empty((0, 2))
    imbalance = np.zeros((2, n))
    size = unit.imbalance_mass * unit.radius
    cosine, sine = (float(value) for value in cos_sin(unit.imbalance_angle))
    for row, column in ((0, (cosine, -sine)), (1, (sine, cosine))):  # on X and on Y, cos(theta + phi) and sin
        imbalance[:, row] = size * np.array(column) / masses[row]
    wide = n + len(net)
    seen = np.zeros((len(net), n))
    seen[:, half:] = net
    system, spin, forces, rotating = (np.zeros((wide, columns)) for columns in (wide, wide, 2, 2))
    system[:n, :n], spin[:n, :n], forces[:n] = mean.constant, mean.spin, mean.input
    system[:half, n:] = -net.T / masses[:, None]
    system[n:, :half] = net
    rotating[:n] = imbalance.T
    stiffest = math.sqrt(float(np.abs(mean.constant[:half, half:]).max()))
    scale = np.repeat([1.0, stiffest], half)
    balance = scale[:, None] / scale
    pull = np.abs(system[:half, n:]) @ np.repeat(np.abs(spring).sum(axis=1), 2)
    sizes = [
        _rounded_up(float((np.abs(mean.constant) * balance).sum(axis=1).max())),
        _rounded_up(float((np.abs(mean.spin) * balance).sum(axis=1).max())),
        _rounded_up(float(pull.max(initial=0.0) * np.abs(net).sum(axis=1).max(initial=0.0) / scale[-1])),
        _rounded_up(2.0 / stiffest),
    ]
    highest = max(_FOURTH * bool(spring.size), int(imbalance.any()))
    is_rotating = bool(spring.size or imbalance.any())
    arrays = [system, spin, forces, seen, spring, rotating, norms := np.array(sizes), along_x]
    for array in arrays:
        array.setflags(write=False)
    return RotatingExcitation(system, spin, forces, seen, spring, rotating, norms, highest, along_x, is_rotating)


def _rounded_up(size: float) -> float:
    """To ten bits: in which order sums are taken, which is not the same on every machine, then does not matter."""
    mantissa, exponent = math.frexp(size)
    return math.ldexp(math.ceil(1024.0 * mantissa), exponent - 10) if math.isfinite(size) else size


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Their product with its sums in order."""
    total: FloatArray = np.add.reduce(np.ascontiguousarray(matrix.T) * vector[:, None], axis=0)
    return total


def steady_state(
    unit: TireWheelUnit,
    speed: float,
    load: float,
    traction: float = 0.0,
    phase: float = 0.0,
    model: wheel.Model = "inextensional",
) -> FloatArray:
    """The fixed-frame state that a constant load at constant speed leaves, to first order in what turns.

    Parameters
    ----------
    unit : TireWheelUnit
    speed : float
        Omega [rad/s].
    load, traction : float
        [N]
    phase : float
        phi [rad].
    model : {"inextensional", "complete"}

    Returns
    -------
    ndarray, shape (n,)
        Of a uniform unit :func:`.wheel.equilibrium`; beside it the answers x cos j phi + y sin j phi to what turns j
        times as fast as the wheel. Where one has none, being in resonance without damping, they are left out.
    """
    mean = wheel.equilibrium(unit, speed, load, traction, model)
    parts = rotating_excitation(unit, model)
    if not parts.is_rotating:
        return mean
    n = mean.size
    forcing = np.zeros((max(parts.highest, 2), 2, n))  # of cos j phi and of sin j phi
    forcing[0] = speed * speed * parts.imbalance[:n].T
    R = _times(parts.seen, mean).reshape(-1, 2)
    a, b = parts.spring[:, 0], parts.spring[:, 1]
    g = np.stack([a * R[:, 0] + b * R[:, 1], b * R[:, 0] - a * R[:, 1]], axis=1)  # kappa conj(R)
    pull = parts.system[:n, n:]
    # g exp(2 i phi) is g_re cos - g_im sin, g_im cos + g_re sin
    forcing[1, 0] += _times(pull, g.reshape(-1))
    forcing[1, 1] += _times(pull, np.stack([-g[:, 1], g[:, 0]], axis=1).reshape(-1))
    F = parts.system[:n, :n] + speed * parts.spin[:n, :n]
    total = mean.copy()
    for j in np.flatnonzero(forcing.any(axis=(1, 2))).tolist():
        turn = (j + 1) * speed * np.eye(n)
        with np.errstate(all="ignore"):
            xy = solve_in_order(np.block([[-F, turn], [-turn, -F]]), forcing[j].reshape(-1))
        cosine, sine = cos_sin((j + 1) * phase)
        total += float(cosine) * xy[:n] + float(sine) * xy[n:]
    return total if np.isfinite(total).all() else mean
