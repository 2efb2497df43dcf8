"""Whole time series at once: what the live estimator does, for inputs that are known beforehand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..science import rotating_excitation, wheel
from ..science.modes import RingModes
from ..science.stepping import Steps
from ..science.unit import TireWheelUnit
from .belt import BeltMotion, belt_numbers, shape_basis
from .motion import Motion
from .road_constants import on_the_road, under_the_belt
from .road_motion import RoadMotion

__all__ = ["Response", "simulate"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Response:
    """What :func:`simulate` returns; forces and positions in REP 103 axes (x forward, z up).

    Attributes
    ----------
    time : ndarray, shape (N,)
        As given [s].
    axle_force : ndarray, shape (N, 2)
        [x, z]: the ring's horizontal force on the held wheel, and the force on the suspension
        F' = k_s y + c_s y' [N].
    wheel_displacement : ndarray, shape (N,)
        y, up positive [m].
    ring_centre : ndarray, shape (N, 2)
        [x, z] of the ring's centre of mass from its unloaded place [m].
    u_z, u_theta : ndarray, shape (N, P), or None
        Radial and tangential deflection of the belt relative to the wheel centre at the angles psi [m].
    contact_force : ndarray, shape (N,)
        The vertical contact force on the tire, up: on the road the answer, under a given load that load [N].
    body_displacement : ndarray, shape (N,), or None
        Of the sprung mass from where it stands at the start, up [m]; None where the body is held.
    """

    time: FloatArray
    axle_force: FloatArray
    wheel_displacement: FloatArray
    ring_centre: FloatArray
    u_z: FloatArray | None = None
    u_theta: FloatArray | None = None
    contact_force: FloatArray | None = None
    body_displacement: FloatArray | None = None


def simulate(
    unit: TireWheelUnit,
    time: ArrayLike,
    speed: ArrayLike,
    load: ArrayLike | None = None,
    traction: ArrayLike | None = None,
    initial: Literal["equilibrium", "rest"] = "equilibrium",
    n_max: int = 30,
    psi: ArrayLike | None = None,
    model: wheel.Model = "inextensional",
    angle: float = 0.0,
    *,
    road: ArrayLike | None = None,
    static_load: float | None = None,
    contact_points: int = 1,
    coupled_harmonics: int | None = None,
) -> Response:
    """The unit's motion under given speed, load and traction, or on a road.

    Parameters
    ----------
    unit : TireWheelUnit
    time : array_like, shape (N,)
        Ascending times [s].
    speed : array_like, shape (N,) or scalar
        Spin Omega [rad/s], linear between samples.
    load, traction : array_like, shape (N,) or scalar
        Vertical contact load, up positive, and traction on the tire along x_ros [N], linear between samples.
    initial : {"equilibrium", "rest"}
        Start in the steady state of the first sample, or unloaded and at rest.
    n_max : int
        Highest wavenumber of the belt's deflection.
    psi : array_like, shape (P,), optional
        Angles fixed in space at which the belt's deflection is wanted [rad].
    model : {"inextensional", "complete"}
    angle : float
        Of the wheel at the first sample [rad]; only a tire that is not the same all around asks for it.
    road : array_like, shape (N,) or scalar, optional
        In place of ``load``: height of the road under the wheel, up positive, linear between samples [m]. Only what
        differs from the first one matters.
    static_load : float, optional
        With ``road``: what the tire carries at the first sample, at rest on the road or rolling steadily, > 0 [N].
    contact_points : int
        With ``road``: how many points along the patch touch it. Under each lies the height that the wheel has, or had,
        where it is itself, so that more than one ask for a speed that does not change its sign.
    coupled_harmonics : int, optional
        With ``road``: up to which of the belt's harmonics a sidewall that varies couples them with one another, the
        wheel and the contact; 0: it does not vary. All of them unless it is given.

    Returns
    -------
    Response

    Raises
    ------
    ValueError
        An argument has the wrong shape, is not finite, or the time does not ascend; the message names it.

    Notes
    -----
    The step is exact for a speed, a load and a traction that are linear over it. That holds for the n = 1 motion with
    the wheel and for each other mode of the belt, n = 2..n_max, and n = 0 in the complete model; their sum is the
    deflection. What turns with a tire that is not the same all around acts on n = 1 and the wheel.

    On the road the step is exact but for the contact force, linear over 2.5 ms at the most, and for the speed, held at
    its mean over these: third order, in a speed that varies second. Run-out and imbalance act there, and a sidewall
    that varies, whose forces are lines over the step too, which is of second order.
    """
    t = np.asarray(time, dtype=np.float64)
    if t.ndim != 1 or t.size == 0 or not np.isfinite(t).all():
        raise ValueError("time must be a row of at least one finite number")
    if not (np.diff(t) > 0.0).all():
        raise ValueError(f"time must ascend; it does not after sample {int(np.argmin(np.diff(t) > 0.0))}")
    omega = _series("speed", speed, t.size)
    if (load is None) == (road is None) or (road is None) != (static_load is None):
        raise ValueError("either load, or road and static_load must be given")
    if road is not None and static_load is not None:
        if initial != "equilibrium":
            raise ValueError(f"initial is {initial!r}; on the road it must be 'equilibrium'")
        pull = _series("traction", 0.0 if traction is None else traction, t.size)
        height = _series("road", road, t.size)
        coupled = n_max if coupled_harmonics is None else coupled_harmonics
        if isinstance(coupled, bool) or not isinstance(coupled, (int, np.integer)) or coupled < 0:
            raise ValueError(f"coupled_harmonics is {coupled!r}; it must be an integer >= 0")
        return _on_the_road(
            unit, t, omega, height, pull, float(static_load), contact_points, coupled, n_max, psi, model, angle
        )
    if contact_points != 1:
        raise ValueError(f"contact_points is {contact_points!r}; it must be 1 under a given load")
    if coupled_harmonics is not None:
        raise ValueError(f"coupled_harmonics is {coupled_harmonics!r}; it must not be given under a given load")
    assert load is not None
    force = np.stack(
        [_series("load", load, t.size), _series("traction", 0.0 if traction is None else traction, t.size)], axis=1
    )
    if initial == "equilibrium":
        load_at_first, traction_at_first = force[0].tolist()
        start = rotating_excitation.steady_state(
            unit, float(omega[0]), load_at_first, traction_at_first, angle, model
        )
    elif initial == "rest":
        start = np.zeros(wheel.states(unit, model))
    else:
        raise ValueError(f"initial is {initial!r}; it must be 'equilibrium' or 'rest'")
    numbers = belt_numbers(n_max, model)
    basis = shape_basis(psi, numbers) if psi is not None else None

    motion = Motion(unit, model, 1)
    motion.put(0, start, float(omega[0]), angle)
    states, axle = motion.follow_lines(t, omega, force)
    u_z = u_theta = None
    if basis is not None:
        modes = RingModes(unit, numbers, model)
        radial, tangential = modes.amplitudes(modes.integrate(Steps(t, omega), -force, steady=initial == "equilibrium"))
        first = wheel.belt_amplitudes(states, model)
        u_z = np.concatenate([first[:, :2], radial.real, radial.imag], axis=1) @ basis
        u_theta = np.concatenate([first[:, 2:], tangential.real, tangential.imag], axis=1) @ basis
    return Response(
        time=t,
        axle_force=axle,
        wheel_displacement=wheel.wheel_displacement(states, model)[0],
        ring_centre=wheel.ring_centre(states, model) * [-1.0, 1.0],  # the paper's X is -x_ros
        u_z=u_z,
        u_theta=u_theta,
        contact_force=force[:, 0].copy(),
    )


def _on_the_road(
    unit: TireWheelUnit,
    t: FloatArray,
    omega: FloatArray,
    height: FloatArray,
    pull: FloatArray,
    static_load: float,
    points: int,
    coupled: int,
    n_max: int,
    psi: ArrayLike | None,
    model: wheel.Model,
    angle: float,
) -> Response:
    """:func:`simulate` on the road."""
    motion = Motion(on_the_road(unit), model, 1)
    belt = BeltMotion(under_the_belt(unit), model, n_max, 1, [0.0] if psi is None else psi)
    road = RoadMotion(unit, motion, belt, [static_load], points, coupled)
    road.put(0, float(omega[0]), angle, float(height[0]))
    heights = _under_the_points(unit, road.angles_of_points(), t, omega, height)
    shapes: list[FloatArray] = []
    if psi is None:
        states, axle, contact, body = road.follow_lines(t, omega, heights, pull)
    else:
        rows = []
        for k in range(t.size):
            some = slice(max(k - 1, 0), k + 1)
            rows.append([each[-1] for each in road.follow_lines(t[some], omega[some], heights[some], pull[some])])
            shapes.append(road.deflection(0))
        states, axle, contact, body = (np.array(each) for each in zip(*rows, strict=True))
    return Response(
        time=t,
        axle_force=axle,
        wheel_displacement=wheel.wheel_displacement(states, model)[0],
        ring_centre=wheel.ring_centre(states, model) * [-1.0, 1.0],
        u_z=np.array([shape[0] for shape in shapes]) if shapes else None,
        u_theta=np.array([shape[1] for shape in shapes]) if shapes else None,
        contact_force=contact,
        body_displacement=body if unit.sprung_mass else None,
    )


def _under_the_points(
    unit: TireWheelUnit, angles: FloatArray, t: FloatArray, omega: FloatArray, height: FloatArray
) -> FloatArray:
    """The road's height under each point, shape (N, P); beta < 0 lies forward. Beyond the ends it goes on level."""
    if angles.size == 1:
        return height[:, None].copy()
    steps = 0.5 * unit.radius * (omega[1:] + omega[:-1]) * np.diff(t)
    if not ((omega >= 0.0).all() or (omega <= 0.0).all()):
        raise ValueError("speed changes its sign; with more than one of contact_points it must not")
    way = np.concatenate([[0.0], np.cumsum(steps)])
    forward = way[-1] >= 0.0
    known, heights = (way, height) if forward else (way[::-1], height[::-1])
    if not steps.any():
        return np.repeat(height[:, None], angles.size, axis=1)
    return np.stack([np.interp(way - unit.radius * np.sin(beta), known, heights) for beta in angles], axis=1)


def _series(name: str, value: ArrayLike, size: int) -> FloatArray:
    array = np.asarray(value, dtype=np.float64)
    if array.ndim not in (0, 1) or array.ndim == 1 and array.size != size:
        raise ValueError(f"{name} has shape {array.shape}; it must be a number or have one value per time, ({size},)")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} holds a value that is not finite")
    return np.array(np.broadcast_to(array, (size,)))
