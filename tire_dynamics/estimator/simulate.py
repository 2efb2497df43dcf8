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
from .belt import belt_numbers, shape_basis
from .motion import Motion

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
    """

    time: FloatArray
    axle_force: FloatArray
    wheel_displacement: FloatArray
    ring_centre: FloatArray
    u_z: FloatArray | None = None
    u_theta: FloatArray | None = None


def simulate(
    unit: TireWheelUnit,
    time: ArrayLike,
    speed: ArrayLike,
    load: ArrayLike,
    traction: ArrayLike | None = None,
    initial: Literal["equilibrium", "rest"] = "equilibrium",
    n_max: int = 30,
    psi: ArrayLike | None = None,
    model: wheel.Model = "inextensional",
    angle: float = 0.0,
) -> Response:
    """The unit's motion under given speed, load and traction.

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
    """
    t = np.asarray(time, dtype=np.float64)
    if t.ndim != 1 or t.size == 0 or not np.isfinite(t).all():
        raise ValueError("time must be a row of at least one finite number")
    if not (np.diff(t) > 0.0).all():
        raise ValueError(f"time must ascend; it does not after sample {int(np.argmin(np.diff(t) > 0.0))}")
    omega = _series("speed", speed, t.size)
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
    )


def _series(name: str, value: ArrayLike, size: int) -> FloatArray:
    array = np.asarray(value, dtype=np.float64)
    if array.ndim not in (0, 1) or array.ndim == 1 and array.size != size:
        raise ValueError(f"{name} has shape {array.shape}; it must be a number or have one value per time, ({size},)")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} holds a value that is not finite")
    return np.array(np.broadcast_to(array, (size,)))
