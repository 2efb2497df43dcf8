"""What a unit is to the steps on the road: their constants, made once for each unit, and not compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..science import wheel
from ..science.coefficients import coefficients, contact_patch_factor
from ..science.contact_points import ContactPoints
from ..science.elementary import cos_sin
from ..science.modes import CONTACT_ANGLE
from ..science.rotating_excitation import rotating_excitation
from ..science.unit import TireWheelUnit
from .buffers import flat

__all__ = ["RoadConstants", "on_the_road", "under_the_belt"]

FloatArray = NDArray[np.float64]


def on_the_road(unit: TireWheelUnit) -> TireWheelUnit:
    """The unit that a :class:`.motion.Motion` on the road is to have, without what varies and turns."""
    return unit.replace(radial_nonuniformity=(), tangential_nonuniformity=(), radial_runout=())


def under_the_belt(unit: TireWheelUnit) -> TireWheelUnit:
    """The unit that the belt's harmonics are to have under a :class:`.RoadMotion`, which spreads the force itself."""
    return unit.mean.replace(contact_half_angle=0.0, vertical_stiffness=0.0)


class RoadConstants:
    """Constants of one unit, arrays as flat buffers in rows.

    Parameters
    ----------
    unit : TireWheelUnit
    model : {"inextensional", "complete"}
    n_max, points : int
        Highest belt harmonic; points of the contact, P.
    coupled : int
        Highest harmonic that a sidewall that varies couples.

    Attributes
    ----------
    half, H : int
        Coordinates of n = 1 and the wheel; with the wind-up xi_0, where a sidewall that varies meets it, and the sprung
        mass behind. States are [velocities, coordinates], 2 H.
    system, spin : buffer, shape (H, 2 H)
        Accelerations per state, and what of them the spin multiplies.
    input : buffer, shape (3, H)
        Accelerations per contact force of 1 N up, along X, and per traction of 1 N.
    imbalance : buffer, shape (H, 2)
        By cos and sin of the wheel's angle, over Omega^2.
    size, size_spin : float
        Norm of the motion's matrix, and of what the spin multiplies, with displacements in units of the stiffest [1/s].
    push : buffer, shape (2, P, N)
        What each harmonic feels of a force on a point, real and imaginary part.
    seen : buffer, shape (2, N, P)
        What a point sees of a harmonic.
    lag : buffer, shape (2, 2 P - 1, N)
        The same of two points, by how far they are apart.
    runout : buffer, shape (J, 2, P)
        Heights by cos j phi and sin j phi.
    variation : buffer, shape (2, 2, J + 1)
        k e exp(i j chi)/(rho h) of the radial springs and of the tangential ones, real and imaginary part [1/s^2].
    """

    def __init__(self, unit: TireWheelUnit, model: wheel.Model, n_max: int, points: int, coupled: int) -> None:
        self.complete = model == "complete"
        self.contact = ContactPoints(unit, points, model, n_max)
        frame, parts = wheel.fixed_frame(unit.mean, model), rotating_excitation(unit.mean, model)
        half = len(frame.constant) // 2
        self.half, self.sprung = half, unit.sprung_mass > 0.0
        self._set_sidewall(unit, min(coupled, n_max))
        H = self.H = half + int(self.winding) + int(self.sprung)
        y = 4 if self.complete else 2
        where = [*range(half), *range(H, H + half)]
        constant, spin = np.zeros((H, 2 * H)), np.zeros((H, 2 * H))
        constant[:half, where], spin[:half, where] = frame.constant[:half], frame.spin[:half]
        self.k_s, self.c_s = unit.suspension_stiffness, unit.suspension_damping
        if self.sprung:
            k_s, c_s, M, m_b = self.k_s, self.c_s, unit.wheel_mass, unit.sprung_mass
            constant[y, [H - 1, 2 * H - 1]] = c_s / M, k_s / M
            constant[H - 1, [y, H + y, H - 1, 2 * H - 1]] = c_s / m_b, k_s / m_b, -c_s / m_b, -k_s / m_b
        self.heft = 1.0 / unit.sprung_mass if self.sprung else 0.0
        wound = 0.0
        if self.winding:  # u_theta = xi_0 all around, which the inextensional model's other harmonics leave alone
            square = float(coefficients(unit, 0).tangential)
            constant[half, [half, H + half]] = -2.0 * unit.zeta_n * math.sqrt(square), -square
            wound = math.sqrt(square) * (1.0 + 2.0 * unit.zeta_n)
        self.system, self.spin = flat(constant), flat(spin)
        inputs = np.zeros((3, H))
        inputs[0, :half], inputs[2, :half] = frame.input[:half, 0], frame.input[:half, 1]
        inputs[1, 0] = frame.input[1, 0]  # along X
        if self.winding:
            breathing = float(contact_patch_factor(unit.replace(vertical_stiffness=0.0), 0))
            inputs[2, half] = -breathing / (2.0 * math.pi * unit.radius * unit.width * unit.surface_density)
        self.input = flat(inputs)
        imbalance = np.zeros((H, 2))
        uneven = unit.mean.replace(imbalance_mass=unit.imbalance_mass, imbalance_angle=unit.imbalance_angle)
        imbalance[:half] = rotating_excitation(uneven, model).imbalance[:half]
        self.imbalance, self.heavy = flat(imbalance), bool(imbalance.any())
        self.size = float(parts.sizes[0])
        if self.sprung:  # of the displacements' size, as the rows of a stiffest coordinate have it
            stiffest = math.sqrt(float(np.abs(frame.constant[:half, half:]).max()))
            self.size += self.c_s * self.heft + self.k_s * self.heft / stiffest
            self.size += self.c_s / unit.wheel_mass + self.k_s / unit.wheel_mass / stiffest
        self.size = max(self.size, wound)
        self.size_spin = float(parts.sizes[1]) + (1.0 if self.heavy else 0.0)
        self.output = flat(np.concatenate([frame.output[1], frame.output_spin[1]]))
        # the contact's geometry
        cosine, spread = self.contact.cosines, self.contact.spread
        self.tangents, self.share = flat(self.contact.tangents), flat(self.contact.share)
        self.ahead = flat(-unit.radius * self.contact.tangents * self.contact.cosines)
        self.reach_of_patch = float(self.ahead[0])
        self.cosines = flat(cosine)
        self.whole = flat(contact_patch_factor(unit, self.contact.numbers))
        angle = np.multiply.outer(self.contact.angles, self.contact.numbers)
        c, s = cos_sin(angle)
        factor = (spread / cosine[:, None]) * np.stack([c, s])  # (2, P, N)
        quarter = np.mod(self.contact.numbers, 4.0).astype(int)
        turned = np.stack([np.array([1.0, 0.0, -1.0, 0.0])[quarter], np.array([0.0, -1.0, 0.0, 1.0])[quarter]])
        self.turned = flat(turned)
        self.push = flat(factor)
        seen = np.stack([factor[0] * turned[0] - factor[1] * turned[1], factor[0] * turned[1] + factor[1] * turned[0]])
        self.seen = flat(seen.transpose(0, 2, 1))  # (2, N, P)
        step = 2.0 * unit.contact_half_angle / points
        apart = np.multiply.outer(step * (np.arange(2 * points - 1) - (points - 1)), self.contact.numbers)
        c, s = cos_sin(apart)
        self.lag = flat(spread * spread * np.stack([c, s]))  # (2, 2 P - 1, N)
        self.rigid = not math.isfinite(float(self.contact.stiffness[0]))
        self.soft = flat(np.zeros(points) if self.rigid else 1.0 / self.contact.stiffness)
        self.stiffness = 0.0 if self.rigid else float(self.contact.stiffness[0])
        self.damping = 0.0 if self.rigid else float(self.contact.damping[0])
        self.lagging = 0.0 if self.rigid else float(self.contact.damping[0] / self.contact.stiffness[0])
        # run-out: what cos j phi and sin j phi bring to the heights of the points
        J = max((j for j, _, _ in unit.radial_runout), default=0)
        runout = np.zeros((J, 2, points))
        for j, size, chi in unit.radial_runout:
            c, s = cos_sin(j * (CONTACT_ANGLE + self.contact.angles - chi))
            patch = float(contact_patch_factor(self.contact.part, j))
            runout[j - 1] += size * patch * np.stack([c, s]) / cosine
        self.runouts, self.runout = J, flat(runout)

    def _set_sidewall(self, unit: TireWheelUnit, L: int) -> None:
        """What of a sidewall varies, with harmonics of the belt coupled to L."""
        kinds = (unit.radial_nonuniformity, unit.tangential_nonuniformity)
        J = max((j for each in kinds for j, _, _ in each), default=0)
        self.varying = L > 0 and J > 0
        self.coupled, self.uneven = (L, J) if self.varying else (0, 0)
        # the wind-up meets the others through the tangential springs alone
        self.winding = self.varying and not self.complete and bool(unit.tangential_nonuniformity)
        parts = np.zeros((2, 2, self.uneven + 1))
        largest = 0.0
        if self.varying:
            stiffness = (unit.radial_stiffness, unit.tangential_stiffness)
            for k, each in enumerate(kinds):
                for j, size, chi in each:
                    cosine, sine = cos_sin(j * chi)
                    parts[k, 0, j] += size * stiffness[k] / unit.surface_density * float(cosine)
                    parts[k, 1, j] += size * stiffness[k] / unit.surface_density * float(sine)
                largest = max(largest, sum(size for _, size, _ in each))
        self.variation = flat(parts)
        self.rounds = 2 + int(largest > 0.05) + int(largest > 0.2)
        mass = unit.ring_mass if not self.complete else 0.5 * unit.ring_mass
        self.on_wheel, self.on_fore = mass / unit.wheel_mass, 0.0
        if not unit.is_longitudinally_rigid:
            self.on_fore = mass / unit.fore_aft_mass
        self.held_mass = mass if unit.is_longitudinally_rigid else 0.0
