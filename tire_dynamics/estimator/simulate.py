"""Whole time series at once: what the live estimator does, for inputs that are known beforehand."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..science import turning, wheel
from ..science.modes import RingModes
from ..science.stepping import Steps
from ..science.unit import TireWheelUnit
from .belt import BeltShape, belt_numbers
from .motion import fastest_kernels

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
    The step is exact for a load and a traction that are linear over it and a constant speed; a speed that
    changes is held at its middle value, which errs with the square of the step. That holds for the n = 1 motion
    with the wheel and for each other mode of the belt, n = 2..n_max, and n = 0 in the complete model; their sum
    is the deflection. What turns with a tire that is not the same all around acts on n = 1 and the wheel.
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
        start = turning.steady_state(unit, float(omega[0]), float(force[0, 0]), float(force[0, 1]), angle, model)
    elif initial == "rest":
        start = np.zeros(wheel.stepper(unit, model).states)
    else:
        raise ValueError(f"initial is {initial!r}; it must be 'equilibrium' or 'rest'")
    numbers = belt_numbers(n_max, model)
    shape = BeltShape(psi, numbers) if psi is not None else None

    steps = Steps(t, omega)
    parts = turning.turning(unit, model)
    system = wheel.fixed_frame(unit, model)
    if parts is None:
        states = _integrate(unit, steps, force, start, model)
    else:
        states, angles = _integrate_turning(parts, steps, force, start, angle, model)
    axle = states @ system.output.T + omega[:, None] * (states @ system.output_spin.T)
    if parts is not None and unit.is_held:
        axle[:, 0] += fastest_kernels().axle_pull(states, angles, parts.seen, parts.spring, parts.wheel_x)
    u_z = u_theta = None
    if shape is not None:
        modes = RingModes(unit, numbers, model)
        amplitudes = modes.amplitudes(modes.integrate(steps, -force, steady=initial == "equilibrium"))
        deflection = shape.deflection(wheel.belt_amplitudes(states, model), *amplitudes)
        u_z, u_theta = deflection[:, 0], deflection[:, 1]
    return Response(
        time=t,
        axle_force=axle,
        wheel_displacement=wheel.wheel_displacement(states, model)[0],
        ring_centre=wheel.ring_centre(states, model) * [-1.0, 1.0],  # the paper's X is -x_ros
        u_z=u_z,
        u_theta=u_theta,
    )


def _integrate(
    unit: TireWheelUnit, steps: Steps, force: FloatArray, start: FloatArray, model: wheel.Model
) -> FloatArray:
    """Fixed-frame states at the samples, shape (N, n)."""
    stepper = wheel.stepper(unit, model)
    n = stepper.states
    states = np.empty((steps.count + 1, n))
    states[0] = state = start
    speed = steps.first_speed
    jumps = model == "complete"
    for first in range(0, steps.count, _BLOCK):
        block = slice(first, min(first + _BLOCK, steps.count))
        following = slice(block.start + 1, block.stop + 1)
        transition = stepper.transitions(_single(steps.lengths[block]), _single(steps.speeds[block]))
        inputs = np.concatenate([force[block], force[following] - force[block]], axis=1)
        pushes = np.matmul(inputs[:, None, :], transition[:, n:])[:, 0, :]
        into = states[following]
        if len(transition) == 1:
            transition = np.broadcast_to(transition, (len(into), *transition.shape[1:]))
        for phi, push, held, out in zip(transition[:, :n], pushes, steps.speeds[block], into, strict=True):
            if jumps:
                state = wheel.change_speed(state, held - speed, model)
                speed = held
            np.dot(state, phi, out=out)
            out += push
            state = out
    return states


def _integrate_turning(
    parts: turning.Turning, steps: Steps, force: FloatArray, start: FloatArray, angle: float, model: wheel.Model
) -> tuple[FloatArray, FloatArray]:
    """The same of a tire that is not the same all around, and the wheel's angles (N,)."""
    count = steps.count
    state, phase = start[None].copy(), np.array([angle])
    before = np.concatenate([[steps.first_speed], steps.speeds[:-1]])[:count]
    jump = steps.speeds - before if model == "complete" else np.zeros(count)
    inputs = np.column_stack([steps.lengths, steps.speeds, force[:-1]])
    begin, stop = np.zeros(1, np.int64), np.arange(1, count + 1)[:, None]
    states, phases = fastest_kernels().advance_turning(
        state, phase, *parts[:9], inputs, np.diff(force, axis=0), jump, np.full(count, math.nan), begin, stop
    )
    return np.concatenate([start[None], states[:, 0]]), np.concatenate([[angle], phases[:, 0]])


def _single(values: FloatArray) -> FloatArray:
    """A row of equal values as one."""
    return np.asarray(values[0]) if (values == values[0]).all() else values


def _series(name: str, value: ArrayLike, size: int) -> FloatArray:
    array = np.asarray(value, dtype=np.float64)
    if array.ndim not in (0, 1) or array.ndim == 1 and array.size != size:
        raise ValueError(f"{name} has shape {array.shape}; it must be a number or have one value per time, ({size},)")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} holds a value that is not finite")
    return np.array(np.broadcast_to(array, (size,)))
