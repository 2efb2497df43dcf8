"""Whole time series at once: what the live estimator does, for inputs that are known beforehand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..science import wheel
from ..science.unit import TireWheelUnit
from .belt import Belt

__all__ = ["Response", "simulate"]

FloatArray = NDArray[np.float64]

_BLOCK = 4096  # steps whose transitions are held at once: a few MB


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
        [x, z] of the ring's centre from its unloaded place [m].
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
    model : {"inextensional"}

    Returns
    -------
    Response

    Raises
    ------
    ValueError
        An argument has the wrong shape, is not finite, or the time does not ascend; the message names it.

    Notes
    -----
    The step is exact for a load and a traction that are linear over it and a constant speed; a speed that
    changes is held at its middle value, which errs with the square of the step. The deflection is the n = 1
    motion of the state plus the steady response (4.5) of modes 2..n_max to each sample's load and speed.
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
        start = wheel.equilibrium(unit, float(omega[0]), float(force[0, 0]), float(force[0, 1]), model)
    elif initial == "rest":
        start = np.zeros(wheel.stepper(unit, model).states)
    else:
        raise ValueError(f"initial is {initial!r}; it must be 'equilibrium' or 'rest'")
    belt = Belt(unit, psi, n_max) if psi is not None else None

    states = _integrate(unit, t, omega, force, start, model)
    system = wheel.fixed_frame(unit, model)
    half = states.shape[1] // 2
    axle = states @ system.output.T + omega[:, None] * (states @ system.output_spin.T)
    response = Response(
        time=t,
        axle_force=axle,
        wheel_displacement=states[:, -1],
        ring_centre=states[:, half : half + 2] * [-1.0, 1.0],  # the paper's X is -x_ros
    )
    if belt is None:
        return response
    shapes = np.array([belt.deflection(z, w, f[0], f[1]) for z, w, f in zip(states, omega, force, strict=True)])
    return Response(response.time, axle, response.wheel_displacement, response.ring_centre, shapes[:, 0], shapes[:, 1])


def _integrate(
    unit: TireWheelUnit, t: FloatArray, omega: FloatArray, force: FloatArray, start: FloatArray, model: wheel.Model
) -> FloatArray:
    """Fixed-frame states at the samples, shape (N, n)."""
    stepper = wheel.stepper(unit, model)
    n = stepper.states
    states = np.empty((t.size, n))
    states[0] = state = start
    steps = np.diff(t)
    speeds = 0.5 * (omega[:-1] + omega[1:])
    mean = (t[-1] - t[0]) / max(t.size - 1, 1)
    uniform = t.size > 1 and np.abs(steps - mean).max() <= 4.0 * np.spacing(np.abs(t).max())
    for first in range(0, t.size - 1, _BLOCK):
        block = slice(first, min(first + _BLOCK, t.size - 1))
        following = slice(block.start + 1, block.stop + 1)
        h: FloatArray = np.asarray(mean) if uniform else steps[block]
        w: FloatArray = speeds[block] if np.ptp(speeds[block]) > 0.0 else np.asarray(speeds[first])
        transition = stepper.transitions(h, w)
        inputs = np.concatenate([force[block], force[following] - force[block]], axis=1)
        pushes = np.matmul(inputs[:, None, :], transition[:, n:])[:, 0, :]
        into = states[following]
        if len(transition) == 1:
            transition = np.broadcast_to(transition, (len(into), *transition.shape[1:]))
        for phi, push, out in zip(transition[:, :n], pushes, into, strict=True):
            np.dot(state, phi, out=out)
            out += push
            state = out
    return states


def _series(name: str, value: ArrayLike, size: int) -> FloatArray:
    array = np.asarray(value, dtype=np.float64)
    if array.ndim not in (0, 1) or array.ndim == 1 and array.size != size:
        raise ValueError(f"{name} has shape {array.shape}; it must be a number or have one value per time, ({size},)")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} holds a value that is not finite")
    return np.array(np.broadcast_to(array, (size,)))
