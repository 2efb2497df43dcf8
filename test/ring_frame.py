"""The equations seen from the rotating ring, integrated directly: the steps in the fixed frame are compared with it."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

from tire_dynamics.science import nonuniform, wheel
from tire_dynamics.science.nonuniform import Nonuniformity

STANDING = 1e-6  # rad/s; a slower spin is taken as this, for so short a time that nothing shows


def euler(unit, sidewall, model):
    """What a rate of the spin adds to the velocities' rates, over the rate, of whole states.

    Of Lagrange's equations 2 Omega P'N q' + Omega' P'N q are one and the same antisymmetric matrix: the Euler terms
    are half of what the Coriolis terms gain with the spin.
    """
    fast, slow = (nonuniform.state_matrix(unit, sidewall, speed, 0.0, model) for speed in (2.0, 1.0))
    half = len(fast) // 2
    matrix = np.zeros_like(fast)
    matrix[:half, half:] = 0.5 * (fast - slow)[:half, :half]
    return matrix


def integrate(unit, model, time, speed, force, start, phi=0.0, rtol=1e-13):
    """Fixed-frame states at some times, and the angles there; speed, load and traction are linear between them.

    Parameters
    ----------
    time, speed : shape (N,)
    force : shape (N, 2)
        Load and traction.
    start : shape (n,)
        The state at the first time, in the fixed frame.
    phi : float
        The wheel's angle there.

    DOP853 starts anew at each time, where the inputs have a kink.
    """
    held, sidewall = unit.is_longitudinally_rigid, Nonuniformity.of(unit)
    push, euler_terms = wheel.fixed_frame(unit, model).input, euler(unit, sidewall, model)
    centrifugal = np.zeros(start.size)
    share = unit.ring_mass if model == "inextensional" else 0.5 * unit.ring_mass  # the mass of Z_1
    size = unit.imbalance_mass * unit.radius / share
    centrifugal[:2] = size * math.cos(unit.imbalance_angle), size * math.sin(unit.imbalance_angle)
    scale = np.where(np.arange(start.size) < start.size // 2, 1e-1, 1e-4)
    states, angles = [start], [phi]
    for k in range(len(time) - 1):
        length, begin = time[k + 1] - time[k], angles[-1]
        rate = (speed[k + 1] - speed[k]) / length

        def slope(t, z, k=k, length=length, begin=begin, rate=rate):
            angle, spin = begin + (speed[k] + 0.5 * rate * t) * t, speed[k] + rate * t
            spin = math.copysign(max(abs(spin), STANDING), spin)
            load, traction = np.asarray(force[k]) + t / length * (np.asarray(force[k + 1]) - force[k])
            A = nonuniform.state_matrix(unit, sidewall, spin, angle / spin, model) + rate * euler_terms
            forces = push @ [load, traction]
            return A @ z + wheel.rotation(angle, spin, model, held) @ forces + centrifugal * spin**2

        z = wheel.rotation(begin, speed[k], model, held) @ states[-1]
        z = solve_ivp(slope, (0.0, length), z, method="DOP853", rtol=rtol, atol=1e-3 * rtol * scale).y[:, -1]
        angles.append(begin + 0.5 * (speed[k] + speed[k + 1]) * length)
        states.append(np.linalg.solve(wheel.rotation(angles[-1], speed[k + 1], model, held), z))
    return np.array(states), np.array(angles)


def pull_of_the_springs(unit, model, state, phi):
    """The undamped sidewall's force along x_ros on a held wheel, by quadrature of all springs around the ring [N]."""
    half = len(state) // 2
    q = state[half:]
    X, Y, U, V = q[:4] if model == "complete" else (q[0], q[1], q[1], -q[0])
    y = q[4] if model == "complete" else q[2]
    psi = 2.0 * math.pi * np.arange(64) / 64  # exact for a product of three harmonics
    u_z, u_t = X * np.cos(psi) + Y * np.sin(psi), U * np.cos(psi) + V * np.sin(psi)
    k_z, k_t = np.full_like(psi, unit.radial_stiffness), np.full_like(psi, unit.tangential_stiffness)
    for j, e, chi in unit.radial_nonuniformity:
        k_z += unit.radial_stiffness * e * np.cos(j * (psi - phi - chi))
    for j, e, chi in unit.tangential_nonuniformity:
        k_t += unit.tangential_stiffness * e * np.cos(j * (psi - phi - chi))
    # -dU/dx of U = a b/2 oint k_z (u_z - y sin psi - x cos psi)^2 + k_theta (u_theta - y cos psi + x sin psi)^2
    along = k_z * (u_z - y * np.sin(psi)) * np.cos(psi) - k_t * (u_t - y * np.cos(psi)) * np.sin(psi)
    return -unit.radius * unit.width * 2.0 * math.pi * along.mean()
