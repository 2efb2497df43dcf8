# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
# cython: auto_pickle=False
"""Wheels on the road through time: steps that are exact but for the contact force, which is linear over each.

:mod:`~tire_dynamics.science.contact` has the system. Over a step of length h the force on each contact point is
F(tau) = a (1 - tau) + b tau, which need not begin where that of the step before has ended; the residual spring is
obeyed at the step's end and in the mean over it, pressing only:

    0 <= b,  b/k - delta(h) >= 0,  one of them 0;      0 <= a,  (a + b)/(2 k) - mean(delta) >= 0,  one of them 0.

That is the discontinuous Galerkin method of degree 1 for the spring: of third order where contact lasts, and without
damping the energy, with k delta^2/2 of the spring while delta > 0, never grows but by what the road does, at any step
length. docs/model.md, section 11, derives it. All else is carried exactly: n = 1, the wheel and the sprung mass by the
Taylor series of their motion, the belt's harmonics by their eigenvalues mu, with x = mu h,
phi_k(x) = sum_j x^j/(j + k)!,

    w(h) = e^x w + h (phi_1 - phi_2) d a + h phi_2 d b,      mean(w) = phi_1 w + h (phi_2 - phi_3) d a + h phi_3 d b.

Where the sidewall's stiffness varies, what it pulls beyond its mean couples every harmonic with others, the wheel and
the contact. It is a line over the step too, from what it is at the begin to what it is at the end, where the motion
under it leads: found by taking the step two to four times.

The state is what it differs from the steady state under the static load at the present speed: at rest and on a flat
road all that is computed is zero, and not a bit moves. Where one patch leaves or finds the road, the moment is located
inside the step. Sums, products and quotients are taken in a fixed order, as in :mod:`.motion`.

The file is long because it is one compiled class: solving for the contact force takes what every part of the system
answers to it, so n = 1, harmonics, car, sidewall and run-out share one set of buffers, called as C functions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..science.stepping import TERMS, reaches
from ..science.unit import TireWheelUnit
from .buffers import zeros
from .road_constants import RoadConstants, on_the_road, under_the_belt

try:
    import cython
except ImportError:
    from ..science import cython_stand_in as cython
if cython.compiled:
    from cython.cimports.libc.math import ceil, fmod
    from cython.cimports.tire_dynamics.estimator.belt import BeltMotion
    from cython.cimports.tire_dynamics.estimator.motion import Motion
    from cython.cimports.tire_dynamics.science.eigensystem import stretch_at
    from cython.cimports.tire_dynamics.science.elementary import grow
else:
    from math import ceil, fmod

    from ..science.eigensystem import stretch_at
    from ..science.elementary import grow
    from .belt import BeltMotion
    from .motion import Motion

__all__ = ["RoadMotion"]

FloatArray = NDArray[np.float64]

_LONGEST_STEP = cython.declare(cython.double, 2.5e-3)  # [s] over which the contact force is a line
_LONGEST = cython.declare(cython.double, 3.0)  # norm times step of one series
_MOST_STEPS = cython.declare(cython.double, 1e7)  # of one call; a unit that needs more has nothing of a tire
_TERMS = cython.declare(cython.Py_ssize_t, TERMS)
_MOST_PARTS = cython.declare(cython.int, 4)  # of a step in which contact is lost and found
_MOST_TRIALS = cython.declare(cython.int, 30)
_SHARP = cython.declare(cython.double, 1e-9)  # of the step: how well the moment is located
_EXACT = cython.declare(cython.double, 1e-7)  # [N]: a force that is none
_KNOTS = cython.declare(cython.Py_ssize_t, 256)  # of the road under a patch; a power of two
_MOST_ROUNDS = cython.declare(cython.int, 8)  # of block pivoting, before the least index alone
_FULL_TURN = cython.declare(cython.double, 2.0 * math.pi)
_NAN = cython.declare(cython.double, math.nan)


@cython.cclass
class RoadMotion:
    """W wheels of one kind on the road.

    Parameters
    ----------
    unit : TireWheelUnit
        What of it is not the same all around acts: sidewall, run-out, imbalance.
    motion : Motion
        Of the same wheels. Its states and angles are what this class moves.
    belt : BeltMotion
        Of :func:`under_the_belt` of the unit, and the same wheels.
    static_loads : sequence of float
        What each tire carries at the start, > 0 [N].
    points : int
        Of the contact along the patch, P >= 1.
    coupled : int
        Highest harmonic up to which a sidewall that varies couples the belt's, 0 to leave it out; all of ``belt`` at
        the most.

    Raises
    ------
    ValueError
        A static load is not > 0, ``coupled`` is < 0, or the unit has no such contact.
    """

    def __init__(
        self,
        unit: TireWheelUnit,
        motion: Motion,
        belt: BeltMotion,
        static_loads: Sequence[float],
        points: int = 1,
        coupled: int = 0,
    ) -> None:
        for load in static_loads:
            if not (math.isfinite(load) and load > 0.0):
                raise ValueError(f"static_load is {load!r}; it must be > 0 and finite")
        if len(static_loads) != motion.wheels:
            raise ValueError(f"static_loads has {len(static_loads)} numbers; there are {motion.wheels} wheels")
        if coupled < 0:
            raise ValueError(f"coupled is {coupled!r}; it must be >= 0")
        self.motion, self.belt, self.most_coupled = motion, belt, min(coupled, 1_000_000)
        self.loads = tuple(float(load) for load in static_loads)
        self.wheels, self.points = motion.wheels, points
        self.N, self.K, self.M, self.complete = belt.N, belt.K, belt.M, belt.complete
        W, P, N, M = self.wheels, self.points, self.N, self.M
        self.own, self.rest_own = zeros(2 * W * M), zeros(2 * W * M)
        self.forces, self.before, self.road, self.base = (zeros(W * P) for _ in range(4))
        self.lift, self.first = zeros(W * P), zeros(W * P)
        self.weight, self.first_weight, self.origin, self.contact = (zeros(W) for _ in range(4))
        self.touching = np.zeros(W, dtype=np.int64).data
        slots = W + 1  # the last is for parts of a step
        self.table_length = np.full(slots, math.nan).data
        self.growth, self.phi_1, self.phi_2, self.phi_3, self.from_a, self.from_b, self.end_seen, self.mean_seen = (
            zeros(slots * 2 * M) for _ in range(8)
        )
        self.ends_a, self.ends_b, self.means_a, self.means_b = (zeros(slots * P * P) for _ in range(4))
        self.law, self.factored = zeros(slots * 4 * P * P), zeros(slots * 4 * P * P)
        self.order = np.zeros(slots * 2 * P, dtype=np.int64).data
        self.mean_a, self.mean_b = zeros(slots * 2 * M), zeros(slots * 2 * M)
        self.static = np.array(self.loads).data
        self.factorial = np.array([1.0 / math.factorial(k) for k in range(21)]).data
        self.whole_begin = self.whole_end = self.whole_mean = self.curve = 0.0
        self.real, self.imaginary = zeros(M), zeros(M)
        self.part_begin, self.part = 0.0, 1.0
        self.push_of = zeros(8)
        self.answer = zeros(8 * N)
        self.lags = zeros(4 * (2 * P - 1))
        self.moved_end, self.moved_mean = zeros(P), zeros(P)
        self.Z_end, self.Z_mean, self.felt = zeros(2 * N), zeros(2 * N), zeros(4 * N)
        self.reach = np.array(reaches()).data
        self.inverse = np.array([0.0, *(1.0 / k for k in range(1, _TERMS + 5))]).data
        self.end, self.mid, self.D_end, self.D_mean = (zeros(P) for _ in range(4))
        self.alpha, self.beta, self.slope, self.rises = (zeros(P) for _ in range(4))
        self.right_side, self.unknown, self.least = (zeros(2 * P) for _ in range(3))
        self.reduced = zeros(4 * P * P)
        self.reduced_order = np.zeros(2 * P, dtype=np.int64).data
        self.active = np.ones(2 * P, dtype=np.int64).data
        self.some = np.zeros(2 * P, dtype=np.int64).data
        self.z = zeros(0)
        self._set_unit(unit)
        self.z = zeros(W * 2 * self.H)
        self.rest = zeros(W * 2 * self.H)
        self.speed = np.full(W, math.nan).data
        self.way, self.edge_height = zeros(W), zeros(W)
        self.knots = zeros(2 * W * _KNOTS) if P > 1 else zeros(0)
        self.knot, self.known = (np.zeros(W, dtype=np.int64).data for _ in range(2))
        for w in range(W):
            self.put(w, 0.0, 0.0, 0.0)

    def _set_unit(self, unit: TireWheelUnit) -> None:
        """The constants of a unit, and room for what has its sizes."""
        n_max = int(self.belt.modes.numbers.max())
        made = RoadConstants(unit, self.motion.model, n_max, self.points, self.most_coupled)
        self.unit, self._angles = unit, made.contact.angles
        self.half, self.H, self.sprung, self.winding = made.half, made.H, made.sprung, made.winding
        self.varying, self.coupled, self.uneven, self.rounds = made.varying, made.coupled, made.uneven, made.rounds
        self.k_s, self.c_s, self.heft, self.heavy = made.k_s, made.c_s, made.heft, made.heavy
        self.system, self.spin, self.input, self.output = made.system, made.spin, made.input, made.output
        self.imbalance, self.size, self.size_spin = made.imbalance, made.size, made.size_spin
        self.tangents, self.share, self.cosines, self.ahead = made.tangents, made.share, made.cosines, made.ahead
        self.radius, self.reach_of_patch = unit.radius, made.reach_of_patch
        self.whole, self.turned, self.push, self.seen = made.whole, made.turned, made.push, made.seen
        self.lag, self.rigid, self.soft = made.lag, made.rigid, made.soft
        self.stiffness, self.damping, self.lagging = made.stiffness, made.damping, made.lagging
        self.runouts, self.runout, self.variation = made.runouts, made.runout, made.variation
        self.on_wheel, self.on_fore, self.held_mass = made.on_wheel, made.on_fore, made.held_mass
        H, slots, width = self.H, self.wheels + 1, 2 * self.coupled + 2
        self.matrix = zeros(2 * H * H)
        self.chain = zeros((_TERMS + 2) * 2 * H)
        self.moved, self.after, self.pushed = zeros(2 * H), zeros(2 * H), zeros(2 * H)
        self.forced, self.forced_mean = zeros(slots * 8 * H), zeros(slots * 8)
        self.small, self.gap = zeros(self.half * (self.half + 1)), zeros(2)
        angles = max(3 * self.runouts, 2)
        self.angles, self.none, self.c, self.s = zeros(angles), zeros(angles), zeros(angles), zeros(angles)
        self.wave, self.angle = zeros(4 * self.uneven + 4), zeros(1)
        self.net, self.pull = zeros(2 * width), zeros(2 * width)
        self.pull_begin, self.pull_end = zeros(2 * width), zeros(2 * width)
        self.kept = zeros(2 * self.M + 2 * H + 3 * self.points + 1)
        self.matrix_at = math.nan
        np.asarray(self.table_length)[:] = math.nan

    def set_unit(self, unit: TireWheelUnit) -> None:
        """Change the tire of every wheel from now on.

        Positions, velocities and how far each point is pressed go on as they are; a wheel or a body that comes free
        does so at rest.
        """
        W, P, half, H, was_sprung = self.wheels, self.points, self.half, self.H, bool(self.sprung)
        states = (np.asarray(self.z) + np.asarray(self.rest)).reshape(W, 2, H)
        own = (np.asarray(self.own) + np.asarray(self.rest_own)).reshape(W, -1)
        before = np.asarray(self.before).reshape(W, P)
        pressed = np.outer(self.loads, np.asarray(self.share) * np.asarray(self.soft)) + before
        for w in range(W):
            self._put_belt(w, own[w])
        self.motion.set_unit(on_the_road(unit))
        self.belt.set_unit(under_the_belt(unit))
        self._set_unit(unit)
        kept = min(half, self.half)
        after = np.zeros((W, 2, self.H))
        after[..., :kept] = states[..., :kept]
        if self.sprung and was_sprung:
            after[..., self.H - 1] = states[..., H - 1]
        self.z, self.rest = zeros(W * 2 * self.H), zeros(W * 2 * self.H)
        for w in range(W):
            self.rest_at(w)
        rest = np.asarray(self.rest).reshape(W, 2, self.H)
        np.asarray(self.z)[:] = after.reshape(-1)
        z = np.asarray(self.z).reshape(W, 2, self.H)
        z[..., : self.half] -= rest[..., : self.half]
        np.asarray(self.own)[:] = np.asarray(self.belt.own) - np.asarray(self.rest_own)
        wanted = pressed - np.outer(self.loads, np.asarray(self.share) * np.asarray(self.soft))
        first, lift = np.asarray(self.first).reshape(W, P), np.asarray(self.lift).reshape(W, P)
        for w in range(W):
            self.set_before(w)
            first[w] += before[w] - wanted[w]
            lift[w] -= before[w] - wanted[w]
            before[w] = wanted[w]
            self.publish_now(w)

    def _put_belt(self, wheel: int, own: FloatArray) -> None:
        self.belt.waiting[wheel] = 0
        np.asarray(self.belt.own)[2 * wheel * self.M : 2 * (wheel + 1) * self.M] = own

    def put(self, index: int, speed: float, angle: float, height: float) -> None:
        """Roll steadily at a speed [rad/s], under the static load, at the wheel's angle [rad], on a road this high [m].

        Run-out is there from the first moment, and not yet in the motion.
        """
        w, P = index, self.points
        here = slice(w * P, (w + 1) * P)
        self.belt.waiting[w] = 0
        if speed != self.belt.speed[w]:
            self.belt._eigensystem(w, speed)
        np.asarray(self.own)[2 * w * self.M : 2 * (w + 1) * self.M] = 0.0
        np.asarray(self.z)[2 * w * self.H : 2 * (w + 1) * self.H] = 0.0
        first, lift = np.asarray(self.first), np.asarray(self.lift)
        self.first_weight[w], first[here] = 0.0, 0.0
        self.speed[w] = speed
        self.rest_at(w)
        self.first_weight[w], self.weight[w] = self.weight[w], 0.0
        first[here], lift[here] = lift[here], 0.0
        np.asarray(self.forces)[here] = self.loads[w] * np.asarray(self.share)
        np.asarray(self.base)[here] = 0.0
        self.origin[w], self.way[w], self.edge_height[w] = height, 0.0, 0.0
        self.set_profile(w, [0.0], [0.0])
        self.motion.phase[w] = angle
        np.asarray(self.slope)[:] = 0.0
        self.set_road_and_runout(w, 0.0, 0.0)
        np.asarray(self.road)[here] = np.asarray(self.before)[here] = np.asarray(self.end) + 0.0
        self.contact[w] = self.loads[w]
        self.touching[w] = 1
        self.publish_now(w)

    # -- speeds ---------------------------------------------------------------------------------------------------

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def rest_at(self, wheel: cython.Py_ssize_t) -> cython.void:
        """What the static load leaves at the present speed, the belt's eigensystem being there: rest, lift, weight."""
        h: cython.Py_ssize_t = self.half
        H: cython.Py_ssize_t = self.H
        M: cython.Py_ssize_t = self.M
        N: cython.Py_ssize_t = self.N
        P: cython.Py_ssize_t = self.points
        first: cython.Py_ssize_t = wheel * 2 * H
        at: cython.Py_ssize_t = 4 * wheel * M
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        k: cython.Py_ssize_t
        e: cython.Py_ssize_t
        load: cython.double = self.static[wheel]
        speed: cython.double = self.speed[wheel]
        total: cython.double
        swap: cython.double
        for i in range(h):
            for j in range(h):
                self.small[i * (h + 1) + j] = -(self.system[i * 2 * H + H + j] + speed * self.spin[i * 2 * H + H + j])
            self.small[i * (h + 1) + h] = load * self.input[i]
        for k in range(h):
            i = k
            for j in range(k + 1, h):
                if abs(self.small[j * (h + 1) + k]) > abs(self.small[i * (h + 1) + k]):
                    i = j
            for j in range(k, h + 1):
                swap = self.small[i * (h + 1) + j]
                self.small[i * (h + 1) + j] = self.small[k * (h + 1) + j]
                self.small[k * (h + 1) + j] = swap
            swap = self.small[k * (h + 1) + k]
            swap = 1.0 / swap if swap != 0.0 else _NAN
            for i in range(k + 1, h):
                total = self.small[i * (h + 1) + k] * swap
                for j in range(k, h + 1):
                    self.small[i * (h + 1) + j] -= total * self.small[k * (h + 1) + j]
        for k in range(h - 1, -1, -1):
            total = self.small[k * (h + 1) + h]
            for j in range(k + 1, h):
                total -= self.small[k * (h + 1) + j] * self.rest[first + H + j]
            swap = self.small[k * (h + 1) + k]
            self.rest[first + H + k] = total / swap if swap != 0.0 else _NAN
        total = 0.0
        for k in range(h):
            total += (self.output[h + k] + speed * self.output[3 * h + k]) * self.rest[first + H + k]
        self.weight[wheel] = total - self.first_weight[wheel]
        # the belt's own coordinates: -load s_n of a force of 1 N outward
        for i in range(N):
            total = -load * self.whole[i]
            for e in range(self.K * i, self.K * (i + 1)):
                self.rest_own[2 * wheel * M + e] = total * self.belt.steady[at + e]
                self.rest_own[2 * wheel * M + M + e] = total * self.belt.steady[at + M + e]
        self.amplitudes(wheel, self.rest_own)
        self.displacements_at_points(False)
        for j in range(P):
            total = self.tangents[j] * self.rest[first + H] - self.rest[first + H + 1]
            total += self.moved_end[j]
            self.lift[wheel * P + j] = total - self.first[wheel * P + j]
        self.table_length[wheel] = _NAN

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def amplitudes(self, wheel: cython.Py_ssize_t, own: cython.double[::1]) -> cython.void:
        """Z_1 of the harmonics of own coordinates into ``Z_end``."""
        N: cython.Py_ssize_t = self.N
        M: cython.Py_ssize_t = self.M
        at: cython.Py_ssize_t = 2 * wheel * M
        right: cython.Py_ssize_t = 8 * wheel * M + 4 * M
        i: cython.Py_ssize_t
        e: cython.Py_ssize_t
        x: cython.double
        y: cython.double
        for i in range(N):
            x = y = 0.0
            if self.complete:
                for e in range(4 * i, 4 * i + 4):
                    x += self.belt.right[right + e] * own[at + e] - self.belt.right[right + M + e] * own[at + M + e]
                    y += self.belt.right[right + e] * own[at + M + e] + self.belt.right[right + M + e] * own[at + e]
            else:
                x = own[at + 2 * i] + own[at + 2 * i + 1]
                y = own[at + M + 2 * i] + own[at + M + 2 * i + 1]
            self.Z_end[i] = x
            self.Z_end[N + i] = y

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def displacements_at_points(self, mean: cython.bint) -> cython.void:
        """The harmonics' displacement at each point into ``moved_end``, of ``Z_end``; and of ``Z_mean``, if asked."""
        N: cython.Py_ssize_t = self.N
        P: cython.Py_ssize_t = self.points
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        x: cython.double
        y: cython.double
        u: cython.double
        v: cython.double
        if P == 1:
            x = y = u = v = 0.0
            for i in range(N):
                x += self.seen[i] * self.Z_end[i]
                y += self.seen[N + i] * self.Z_end[N + i]
                u += self.seen[i] * self.Z_mean[i]
                v += self.seen[N + i] * self.Z_mean[N + i]
            self.moved_end[0], self.moved_mean[0] = x + y, u + v
            return
        for j in range(P):
            self.moved_end[j] = self.moved_mean[j] = 0.0
        for i in range(N):
            x, y = self.Z_end[i], self.Z_end[N + i]
            u, v = self.Z_mean[i], self.Z_mean[N + i]
            for j in range(P):
                self.moved_end[j] += self.seen[i * P + j] * x + self.seen[(N + i) * P + j] * y
            if mean:
                for j in range(P):
                    self.moved_mean[j] += self.seen[i * P + j] * u + self.seen[(N + i) * P + j] * v

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def set_before(self, wheel: cython.Py_ssize_t) -> cython.void:
        """``before`` from the state."""
        P: cython.Py_ssize_t = self.points
        q: cython.Py_ssize_t = wheel * 2 * self.H + self.H
        j: cython.Py_ssize_t
        self.amplitudes(wheel, self.own)
        self.displacements_at_points(False)
        for j in range(P):
            self.before[wheel * P + j] = (
                (self.tangents[j] * self.z[q] - self.z[q + 1])
                + self.moved_end[j]
                + self.lift[wheel * P + j]
                + self.road[wheel * P + j]
            )

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def change_speed(self, wheel: cython.Py_ssize_t, speed: cython.double) -> cython.void:
        """Go on at another speed: the velocities jump by the Euler terms' integral."""
        M: cython.Py_ssize_t = self.M
        H: cython.Py_ssize_t = self.H
        at: cython.Py_ssize_t = 2 * wheel * M
        first: cython.Py_ssize_t = wheel * 2 * H
        k: cython.Py_ssize_t
        change: cython.double = speed - self.speed[wheel]
        radial: cython.double
        shear: cython.double
        if speed == self.speed[wheel]:
            return
        for k in range(2 * M):
            self.belt.own[at + k] = self.own[at + k] + self.rest_own[at + k]
        self.belt.waiting[wheel] = 0
        self.belt.change_speed(wheel, speed)
        for k in range(2 * H):
            self.z[first + k] += self.rest[first + k]
        if self.complete:
            radial = change * (self.z[first + H] + self.z[first + H + 3])
            shear = change * (self.z[first + H + 1] - self.z[first + H + 2])
            self.z[first] -= shear
            self.z[first + 1] += radial
            self.z[first + 2] -= radial
            self.z[first + 3] -= shear
        self.speed[wheel] = speed
        self.rest_at(wheel)
        for k in range(2 * H):
            self.z[first + k] -= self.rest[first + k]
        for k in range(2 * M):
            self.own[at + k] = self.belt.own[at + k] - self.rest_own[at + k]
        # no place has moved, and so how far each point is pressed stays as it is

    # -- tables of a step ----------------------------------------------------------------------------------------

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def tabulate_step(
        self, wheel: cython.Py_ssize_t, slot: cython.Py_ssize_t, length: cython.double
    ) -> cython.void:
        """What a step of a length [s] at the present speed does, into a slot."""
        M: cython.Py_ssize_t = self.M
        N: cython.Py_ssize_t = self.N
        P: cython.Py_ssize_t = self.points
        at: cython.Py_ssize_t = slot * 2 * M
        right: cython.Py_ssize_t = 8 * wheel * M + 4 * M
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        d: cython.Py_ssize_t
        k: cython.Py_ssize_t
        x: cython.double
        y: cython.double
        u: cython.double
        v: cython.double
        p: cython.double
        q: cython.double
        if slot < self.wheels and self.table_length[slot] == length:
            return
        self.table_length[slot] = length
        grow(
            M, wheel * M, self.belt.rate, self.belt.frequency, length, self.growth[at : at + M],
            self.growth[at + M : at + 2 * M],
        )  # fmt: skip
        _phi(
            M, wheel * M, self.belt.rate, self.belt.frequency, length, self.factorial, self.growth, at, self.phi_1,
            self.phi_2, self.phi_3,
        )  # fmt: skip
        _forced(
            M, wheel, self.belt.rate, self.belt.frequency, self.belt.steady, length, at, self.phi_1, self.phi_2,
            self.phi_3, self.from_a, self.from_b, self.mean_a, self.mean_b,
        )  # fmt: skip
        if self.complete:
            _times(M, self.belt.right, right, self.growth, self.end_seen, at)
            _times(M, self.belt.right, right, self.phi_1, self.mean_seen, at)
        _answers(
            N, self.K, self.complete, self.belt.right, right, at, self.from_a, self.from_b, self.mean_a, self.mean_b,
            self.turned, self.answer,
        )  # fmt: skip
        for d in range(2 * P - 1):
            x = y = u = v = 0.0  # side by side: a sum waits for itself
            for i in range(N):
                p, q = self.lag[d * N + i], self.lag[(2 * P - 1 + d) * N + i]
                x += p * self.answer[i] - q * self.answer[N + i]
                y += p * self.answer[2 * N + i] - q * self.answer[3 * N + i]
                u += p * self.answer[4 * N + i] - q * self.answer[5 * N + i]
                v += p * self.answer[6 * N + i] - q * self.answer[7 * N + i]
            self.lags[4 * d], self.lags[4 * d + 1], self.lags[4 * d + 2], self.lags[4 * d + 3] = x, y, u, v
        self.unit_responses(wheel, slot, length)
        for i in range(P):
            for j in range(P):
                k = slot * P * P + i * P + j
                d = 4 * (j - i + P - 1)
                u = 1.0 / (self.cosines[i] * self.cosines[j])
                self.ends_a[k] = self.lags[d] * u + self.end_response(slot, 0, i, j)
                self.ends_b[k] = self.lags[d + 1] * u + self.end_response(slot, 1, i, j)
                self.means_a[k] = self.lags[d + 2] * u + self.mean_response(slot, 0, i, j)
                self.means_b[k] = self.lags[d + 3] * u + self.mean_response(slot, 1, i, j)
        self.set_contact_conditions(slot, length)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def end_response(
        self, slot: cython.Py_ssize_t, which: cython.Py_ssize_t, i: cython.Py_ssize_t, j: cython.Py_ssize_t
    ) -> cython.double:
        """What n = 1 moves point i at the end, under a force a (0) or b (1) on point j."""
        v: cython.Py_ssize_t = slot * 8 * self.H + which * 2 * self.H + self.H
        x: cython.Py_ssize_t = v + 4 * self.H
        return (self.tangents[i] * self.forced[v] - self.forced[v + 1]) - self.tangents[j] * (
            self.tangents[i] * self.forced[x] - self.forced[x + 1]
        )

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def mean_response(
        self, slot: cython.Py_ssize_t, which: cython.Py_ssize_t, i: cython.Py_ssize_t, j: cython.Py_ssize_t
    ) -> cython.double:
        v: cython.Py_ssize_t = slot * 8 + 2 * which
        x: cython.Py_ssize_t = v + 4
        return (self.tangents[i] * self.forced_mean[v] - self.forced_mean[v + 1]) - self.tangents[j] * (
            self.tangents[i] * self.forced_mean[x] - self.forced_mean[x + 1]
        )

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def set_matrix(self, wheel: cython.Py_ssize_t) -> cython.void:
        k: cython.Py_ssize_t
        speed: cython.double = self.speed[wheel]
        if self.matrix_at == speed:
            return
        self.matrix_at = speed
        for k in range(2 * self.H * self.H):
            self.matrix[k] = self.system[k] + speed * self.spin[k]

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def order_of(self, wheel: cython.Py_ssize_t, length: cython.double) -> cython.Py_ssize_t:
        """The terms of a series over a length [s], such that what is left out is negligible."""
        k: cython.Py_ssize_t = 1
        reach: cython.double = (self.size + abs(self.speed[wheel]) * self.size_spin) * length
        while k < 39 and reach > self.reach[k]:
            k += 1
        return k

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def next_row(
        self, row: cython.Py_ssize_t, part: cython.double, force: cython.bint
    ) -> cython.void:
        """The next term of a series in ``chain``: part [A x + moved], and part v."""
        if self.H == 3:  # the usual ones: with a number, the compiler unrolls its loops
            _next_row(3, self.matrix, self.chain, row, part, self.moved, force)
        elif self.H == 4:
            _next_row(4, self.matrix, self.chain, row, part, self.moved, force)
        else:
            _next_row(self.H, self.matrix, self.chain, row, part, self.moved, force)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def unit_responses(
        self, wheel: cython.Py_ssize_t, slot: cython.Py_ssize_t, length: cython.double
    ) -> cython.void:
        """States at the end, and means of X and Y, under forces a and b of 1 N, up, and along X.

        With U_k = A^k B h^(k + 1)/(k + 1)!, a leaves sum U_k (k + 1)/(k + 2) and b sum U_k/(k + 2), in the mean
        sum U_k/(k + 3) and sum U_k/((k + 2) (k + 3)).
        """
        H: cython.Py_ssize_t = self.H
        order: cython.Py_ssize_t = self.order_of(wheel, length)
        at: cython.Py_ssize_t
        k: cython.Py_ssize_t
        r: cython.Py_ssize_t
        i: cython.Py_ssize_t
        a: cython.double
        b: cython.double
        c: cython.double
        self.set_matrix(wheel)
        for i in range(2 if self.points > 1 else 1):
            for r in range(H):
                self.chain[r] = length * self.input[i * H + r]
                self.chain[H + r] = 0.0
            for k in range(order):
                self.next_row(k * 2 * H, length * self.inverse[k + 2], False)
            at = slot * 8 * H + i * 4 * H
            for r in range(2 * H):
                a = b = 0.0
                for k in range(order, -1, -1):
                    c = self.chain[k * 2 * H + r]
                    a += c
                    b += c * self.inverse[k + 2]
                a = a - b  # sum U_k (k + 1)/(k + 2)
                self.forced[at + r] = a
                self.forced[at + 2 * H + r] = b
            at = slot * 8 + 4 * i
            for r in range(2):
                a = b = 0.0
                for k in range(order, -1, -1):
                    c = self.chain[k * 2 * H + H + r] * self.inverse[k + 3]
                    a += c
                    b += c * self.inverse[k + 2]
                self.forced_mean[at + r] = a
                self.forced_mean[at + 2 + r] = b

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def set_contact_conditions(self, slot: cython.Py_ssize_t, length: cython.double) -> cython.void:
        """The two conditions of each point as a matrix of [a, b], and its factors."""
        P: cython.Py_ssize_t = self.points
        at: cython.Py_ssize_t = slot * P * P
        row: cython.Py_ssize_t
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        k: cython.Py_ssize_t
        g: cython.double = self.lagging / length if length > 0.0 else 0.0
        for i in range(P):
            for j in range(P):
                k = at + i * P + j
                row = 4 * at + i * 2 * P + j
                self.law[row] = -(self.means_a[k] + g * self.ends_a[k])
                self.law[row + P] = -(self.means_b[k] + g * self.ends_b[k])
                if i == j:
                    self.law[row] += 0.5 * self.soft[i]
                    self.law[row + P] += 0.5 * self.soft[i]
                row = 4 * at + (P + i) * 2 * P + j
                self.law[row] = -(self.ends_a[k] + g * (4.0 * self.ends_a[k] - 6.0 * self.means_a[k]))
                self.law[row + P] = -(self.ends_b[k] + g * (4.0 * self.ends_b[k] - 6.0 * self.means_b[k]))
                if i == j:
                    self.law[row + P] += self.soft[i]
        if P > 1:
            for k in range(4 * P * P):
                self.factored[4 * at + k] = self.law[4 * at + k]
            _factor(self.factored, 4 * at, 2 * P, self.order, slot * 2 * P)

    # -- a step ---------------------------------------------------------------------------------------------------

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def free_deflection(
        self, wheel: cython.Py_ssize_t, slot: cython.Py_ssize_t, length: cython.double, phase: cython.double,
        traction: cython.double, traction_change: cython.double,
    ) -> cython.void:
        """delta beyond the static one, at the end and in the mean, were the forces the static ones; roads are there."""
        H: cython.Py_ssize_t = self.H
        M: cython.Py_ssize_t = self.M
        N: cython.Py_ssize_t = self.N
        P: cython.Py_ssize_t = self.points
        order: cython.Py_ssize_t = self.order_of(wheel, length)
        at: cython.Py_ssize_t = slot * 2 * M
        own: cython.Py_ssize_t = 2 * wheel * M
        k: cython.Py_ssize_t
        r: cython.Py_ssize_t
        j: cython.Py_ssize_t
        c: cython.double = 0.0
        s: cython.double = 0.0
        turned: cython.double
        square: cython.double = self.speed[wheel] * self.speed[wheel]
        x: cython.double
        self.set_matrix(wheel)
        for k in range(2 * H):
            self.chain[k] = self.z[wheel * 2 * H + k]
        if self.heavy:
            self.angles[0] = phase
            grow(1, 0, self.none, self.angles, 1.0, self.c, self.s)
            c, s = self.c[0], self.s[0]
        if self.varying:
            self.pull_on_first_mode()
        for k in range(order):
            if k < 2 or self.heavy:
                for r in range(H):
                    x = 0.0
                    if k == 0:
                        x = traction * self.input[2 * H + r]
                    elif k == 1:
                        x = traction_change * self.input[2 * H + r]
                    if self.varying:
                        if k == 0:
                            x += self.pushed[r]
                        elif k == 1:
                            x += self.pushed[H + r]
                    if self.heavy:
                        x += square * (c * self.imbalance[2 * r] + s * self.imbalance[2 * r + 1])
                    self.moved[r] = x
            if k == 0 and self.sprung:
                self.moved[H - 1] += self.weight[wheel] * self.heft
            self.next_row(k * 2 * H, length * self.inverse[k + 1], k < 2 or self.heavy)
            if self.heavy:
                turned = self.speed[wheel] * length / (k + 1)
                x = -turned * s
                s = turned * c
                c = x
        for r in range(2 * H):
            x = 0.0
            for k in range(order, -1, -1):
                x += self.chain[k * 2 * H + r]
            self.after[r] = x
        for r in range(2):
            x = 0.0
            for k in range(order, -1, -1):
                x += self.chain[k * 2 * H + H + r] * self.inverse[k + 1]
            self.gap[r] = x
        if self.complete:
            _ahead(N, 4, M, at, own, self.end_seen, self.mean_seen, self.own, self.Z_end, self.Z_mean)
        else:
            _ahead(N, 2, M, at, own, self.growth, self.phi_1, self.own, self.Z_end, self.Z_mean)
        for k in range(M):
            self.real[k] = self.imaginary[k] = 0.0
        if traction != 0.0 or traction_change != 0.0:
            self.traction_response(wheel, slot, length, traction, traction_change)
        if self.varying:
            self.pull_on_belt(wheel, slot, length)
        self.displacements_at_points(True)
        for j in range(P):
            k = wheel * P + j
            self.D_end[j] = (
                (self.tangents[j] * self.after[H] - self.after[H + 1])
                + self.moved_end[j] + self.lift[k] + self.end[j]
            )
            self.D_mean[j] = (
                (self.tangents[j] * self.gap[0] - self.gap[1])
                + self.moved_mean[j] + self.lift[k] + self.mid[j]
            )

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def traction_response(
        self, wheel: cython.Py_ssize_t, slot: cython.Py_ssize_t, length: cython.double, traction: cython.double,
        traction_change: cython.double,
    ) -> cython.void:
        """What a traction adds to the harmonics' amplitudes at the end and in the mean."""
        M: cython.Py_ssize_t = self.M
        N: cython.Py_ssize_t = self.N
        at: cython.Py_ssize_t = slot * 2 * M
        right: cython.Py_ssize_t = 8 * wheel * M + 4 * M
        steady: cython.Py_ssize_t = 4 * wheel * M
        i: cython.Py_ssize_t
        e: cython.Py_ssize_t
        x: cython.double
        y: cython.double
        u: cython.double
        v: cython.double
        p: cython.double
        q: cython.double
        for i in range(N):
            for e in range(self.K * i, self.K * (i + 1)):
                x, y = self.belt.rate[wheel * M + e], self.belt.frequency[wheel * M + e]
                p, q = self.belt.steady[steady + 2 * M + e], self.belt.steady[steady + 3 * M + e]
                u = self.whole[i] * length
                x, y = u * (x * p - y * q), u * (x * q + y * p)
                # a = T, b = T + change: phi_1 T + phi_2 change, in the mean phi_2 T + phi_3 change
                p = self.phi_1[at + e] * traction + self.phi_2[at + e] * traction_change
                q = self.phi_1[at + M + e] * traction + self.phi_2[at + M + e] * traction_change
                u, v = p * x - q * y, p * y + q * x
                self.real[e], self.imaginary[e] = u, v
                p = self.phi_2[at + e] * traction + self.phi_3[at + e] * traction_change
                q = self.phi_2[at + M + e] * traction + self.phi_3[at + M + e] * traction_change
                x, y = p * x - q * y, p * y + q * x
                if self.complete:
                    p, q = self.belt.right[right + e], self.belt.right[right + M + e]
                    u, v = u * p - v * q, u * q + v * p
                    x, y = x * p - y * q, x * q + y * p
                self.Z_end[i] += u
                self.Z_end[N + i] += v
                self.Z_mean[i] += x
                self.Z_mean[N + i] += y

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def solve_contact(self, wheel: cython.Py_ssize_t, slot: cython.Py_ssize_t, length: cython.double) -> cython.double:
        """Forces beyond the static ones into ``alpha`` and ``beta``; of one point, b if the contact could pull [N]."""
        P: cython.Py_ssize_t = self.points
        j: cython.Py_ssize_t
        m: cython.Py_ssize_t
        g: cython.double = self.lagging / length if length > 0.0 else 0.0
        least: cython.double
        lasting: cython.double
        a: cython.double
        b: cython.double
        det: cython.double
        for j in range(P):
            self.right_side[j] = self.D_mean[j]
            self.right_side[P + j] = self.D_end[j]
            if g != 0.0:
                self.right_side[j] += g * (self.D_end[j] - self.before[wheel * P + j])
                self.right_side[P + j] += g * (
                    4.0 * self.D_end[j] - 6.0 * self.D_mean[j] + 2.0 * self.before[wheel * P + j]
                )
            self.least[j] = self.least[P + j] = -(self.static[wheel] * self.share[j])
        if P > 1:
            self.solve_complementarity(slot)
            for j in range(P):
                self.alpha[j], self.beta[j] = self.unknown[j], self.unknown[P + j]
            return 0.0
        m = 4 * slot
        least = self.least[0]
        det = self.law[m] * self.law[m + 3] - self.law[m + 1] * self.law[m + 2]
        det = 1.0 / det if det != 0.0 else _NAN
        a = (self.right_side[0] * self.law[m + 3] - self.right_side[1] * self.law[m + 1]) * det
        b = (self.law[m] * self.right_side[1] - self.law[m + 2] * self.right_side[0]) * det
        lasting = b - least
        if a < least or b < least:
            a = least
            b = (self.right_side[1] - self.law[m + 2] * least) / self.law[m + 3] if self.law[m + 3] != 0.0 else _NAN
            if not (b >= least and self.law[m] * least + self.law[m + 1] * b >= self.right_side[0]):
                b = least
                a = (self.right_side[0] - self.law[m + 1] * least) / self.law[m] if self.law[m] != 0.0 else _NAN
                if not (a >= least and self.law[m + 2] * a + self.law[m + 3] * least >= self.right_side[1]):
                    a = least
        self.alpha[0], self.beta[0] = a, b
        return lasting

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def solve_complementarity(self, slot: cython.Py_ssize_t) -> cython.void:
        """x >= least with y = law x - right >= 0 and one of the two bounds met in every row, into ``unknown``.

        By block pivoting from all in contact, and by Murty's rule of the least index when that has gone on for long.
        """
        n: cython.Py_ssize_t = 2 * self.points
        law: cython.Py_ssize_t = slot * n * n
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        m: cython.Py_ssize_t
        trial: cython.int
        total: cython.double
        wrong: cython.bint
        flipped: cython.bint
        for i in range(n):
            self.unknown[i] = self.right_side[i]
            self.active[i] = 1
        _solve(self.factored, law, n, self.order, slot * n, self.unknown)
        for trial in range(4 * cython.cast(cython.int, n) + 20):
            flipped = False
            for i in range(n):
                total = -self.right_side[i]
                for j in range(n):
                    total += self.law[law + i * n + j] * self.unknown[j]
                wrong = self.unknown[i] < self.least[i] if self.active[i] else total < 0.0
                self.some[i] = 1 if wrong else 0
            for i in range(n):
                if self.some[i] and (trial < _MOST_ROUNDS or not flipped):
                    self.active[i] = 1 - self.active[i]
                    flipped = True
            if not flipped:
                break
            m = 0
            for i in range(n):
                if self.active[i]:
                    self.some[m] = i
                    m += 1
            for i in range(m):
                total = self.right_side[self.some[i]]
                for j in range(n):
                    if not self.active[j]:
                        total -= self.law[law + self.some[i] * n + j] * self.least[j]
                for j in range(m):
                    self.reduced[i * m + j] = self.law[law + self.some[i] * n + self.some[j]]
                self.unknown[i] = total
            if m > 0:
                _factor(self.reduced, 0, m, self.reduced_order, 0)
                _solve(self.reduced, 0, m, self.reduced_order, 0, self.unknown)
            for i in range(m - 1, -1, -1):  # to their places, which are not before
                self.unknown[self.some[i]] = self.unknown[i]
            for i in range(n):
                if not self.active[i]:
                    self.unknown[i] = self.least[i]
        for i in range(n):
            if self.unknown[i] < self.least[i]:
                self.unknown[i] = self.least[i]

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def finish_step(self, wheel: cython.Py_ssize_t, slot: cython.Py_ssize_t) -> cython.void:
        """Go to the end of a step whose forces are there."""
        H: cython.Py_ssize_t = self.H
        M: cython.Py_ssize_t = self.M
        N: cython.Py_ssize_t = self.N
        P: cython.Py_ssize_t = self.points
        at: cython.Py_ssize_t = slot * 2 * M
        own: cython.Py_ssize_t = 2 * wheel * M
        push: cython.Py_ssize_t = P * N
        f: cython.Py_ssize_t = slot * 8 * H
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        e: cython.Py_ssize_t
        r: cython.Py_ssize_t
        a: cython.double = 0.0
        b: cython.double = 0.0
        across_a: cython.double = 0.0
        across_b: cython.double = 0.0
        x: cython.double
        y: cython.double
        for j in range(P):
            a += self.alpha[j]
            b += self.beta[j]
            across_a -= self.tangents[j] * self.alpha[j]
            across_b -= self.tangents[j] * self.beta[j]
        for r in range(2 * H):
            x = self.after[r] + self.forced[f + r] * a + self.forced[f + 2 * H + r] * b
            if P > 1:
                x += self.forced[f + 4 * H + r] * across_a + self.forced[f + 6 * H + r] * across_b
            self.z[wheel * 2 * H + r] = x + 0.0
        for i in range(4 * N):
            self.felt[i] = 0.0
        for j in range(P):
            x, y = self.alpha[j], self.beta[j]
            for i in range(N):
                self.felt[i] += self.push[j * N + i] * x
                self.felt[N + i] += self.push[push + j * N + i] * x
                self.felt[2 * N + i] += self.push[j * N + i] * y
                self.felt[3 * N + i] += self.push[push + j * N + i] * y
        _go_on(
            N, self.K, M, at, own, self.growth, self.from_a, self.from_b, self.felt, self.real, self.imaginary, self.own
        )
        for i in range(P):
            x = self.D_end[i]
            for j in range(P):
                e = slot * P * P + i * P + j
                x += self.ends_a[e] * self.alpha[j] + self.ends_b[e] * self.beta[j]
            self.before[wheel * P + i] = x
            self.road[wheel * P + i] = self.end[i]
            self.forces[wheel * P + i] = self.static[wheel] * self.share[i] + self.beta[i]

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def try_part(
        self, wheel: cython.Py_ssize_t, done: cython.double, t: cython.double, touching: cython.bint,
        length: cython.double, phase: cython.double, traction: cython.double, traction_change: cython.double,
    ) -> cython.double:
        """The forces of a part of a step of one point, from ``done`` to t; how far beyond a change of contact [N]."""
        slot: cython.Py_ssize_t = wheel if done == 0.0 and t == 1.0 else self.wheels
        d: cython.double = t - done
        h: cython.double = d * length
        low: cython.double
        high: cython.double
        pressed: cython.double
        least: cython.double
        low = self.whole_begin + (self.whole_end - self.whole_begin) * done + self.curve * done * (1.0 - done)
        high = self.whole_begin + (self.whole_end - self.whole_begin) * t + self.curve * t * (1.0 - t)
        if slot == wheel:
            high = self.whole_end
        self.end[0] = high
        self.mid[0] = 0.5 * (low + high) + self.curve * d * d / 6.0
        if slot == wheel:
            self.mid[0] = self.whole_mean
        self.tabulate_step(wheel, slot, h)
        self.part_begin, self.part = done, d
        self.free_deflection(
            wheel, slot, h, phase + self.speed[wheel] * length * done, traction + traction_change * done,
            traction_change * d,
        )  # fmt: skip
        if touching:
            return -self.solve_contact(wheel, slot, h)
        least = -(self.static[wheel] * self.share[0])
        self.alpha[0] = self.beta[0] = least
        pressed = self.D_end[0] + (self.ends_a[slot] + self.ends_b[slot]) * least
        pressed = self.stiffness * pressed - least
        if self.damping != 0.0:
            pressed += self.damping * (
                self.rate(wheel, slot, least)
                + (self.whole_end - self.whole_begin + self.curve * (1.0 - 2.0 * t)) / length
            )
        return pressed

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def rate(self, wheel: cython.Py_ssize_t, slot: cython.Py_ssize_t, least: cython.double) -> cython.double:
        """u_c' at the end of a part without contact, of one point [m/s]."""
        H: cython.Py_ssize_t = self.H
        M: cython.Py_ssize_t = self.M
        N: cython.Py_ssize_t = self.N
        at: cython.Py_ssize_t = slot * 2 * M
        own: cython.Py_ssize_t = 2 * wheel * M
        right: cython.Py_ssize_t = 8 * wheel * M + 4 * M
        f: cython.Py_ssize_t = slot * 8 * H
        i: cython.Py_ssize_t
        e: cython.Py_ssize_t
        total: cython.double = -(self.after[1] + (self.forced[f + 1] + self.forced[f + 2 * H + 1]) * least)
        force: cython.double
        p: cython.double
        q: cython.double
        x: cython.double
        y: cython.double
        u: cython.double
        v: cython.double
        for i in range(N):
            x = y = 0.0
            force = self.whole[i] * least
            for e in range(self.K * i, self.K * (i + 1)):
                p = self.growth[at + e] * self.own[own + e] - self.growth[at + M + e] * self.own[own + M + e]
                q = self.growth[at + e] * self.own[own + M + e] + self.growth[at + M + e] * self.own[own + e]
                p += (self.from_a[at + e] + self.from_b[at + e]) * force + self.rest_own[own + e] + self.real[e]
                q += (self.from_a[at + M + e] + self.from_b[at + M + e]) * force + self.rest_own[own + M + e]
                q += self.imaginary[e]
                u, v = self.belt.rate[wheel * M + e], self.belt.frequency[wheel * M + e]
                p, q = u * p - v * q, u * q + v * p
                if self.complete:
                    u, v = self.belt.right[right + e], self.belt.right[right + M + e]
                    p, q = u * p - v * q, u * q + v * p
                x += p
                y += q
            total += self.seen[i] * x + self.seen[N + i] * y
        return total

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def parts(
        self, wheel: cython.Py_ssize_t, length: cython.double, phase: cython.double, traction: cython.double,
        traction_change: cython.double,
    ) -> cython.void:
        """A step of one patch on a spring, cut where contact is lost or found.

        The road is the parabola with the step's ends and mean. In contact the force at the end of a part that ends at t
        tells whether the contact lasts until t; without it, the force that contact would give there whether it has
        begun. Their roots are enclosed by the Illinois method.
        """
        part: cython.int
        side: cython.int
        done: cython.double = 0.0
        t: cython.double
        beyond: cython.double
        low: cython.double
        high: cython.double
        f_low: cython.double
        f_high: cython.double
        f: cython.double
        cut: cython.bint
        found: cython.bint
        touching: cython.bint = self.touching[wheel] != 0
        slot: cython.Py_ssize_t
        self.whole_begin, self.whole_end, self.whole_mean = self.road[wheel], self.end[0], self.mid[0]
        self.curve = 6.0 * (self.mid[0] - 0.5 * (self.whole_begin + self.whole_end))
        for part in range(_MOST_PARTS):
            t = 1.0
            beyond = self.try_part(wheel, done, t, touching, length, phase, traction, traction_change)
            cut = beyond > 0.0 and part < _MOST_PARTS - 1
            if cut:
                low, high, f_high, side, found = done, 1.0, beyond, 0, False
                if touching:
                    f_low = -self.forces[wheel] if self.forces[wheel] > 0.0 else 0.0
                else:
                    f_low = self.stiffness * self.before[wheel] + self.static[wheel] * self.share[0]
                    f_low = f_low if f_low < 0.0 else 0.0
                for _ in range(_MOST_TRIALS):
                    t = high - f_high * (high - low) / (f_high - f_low)
                    if not (low < t and t < high):
                        t = 0.5 * (low + high)
                    if not (low < t and t < high):
                        break
                    f = self.try_part(wheel, done, t, touching, length, phase, traction, traction_change)
                    if abs(f) <= _EXACT or t - done < _SHARP:
                        found = True
                        break
                    if f > 0.0:
                        high, f_high = t, f
                        if side > 0:
                            f_low = 0.5 * f_low
                        side = 1
                    else:
                        low, f_low = t, f
                        if side < 0:
                            f_high = 0.5 * f_high
                        side = -1
                if not found:
                    t = low
                    if low > done:
                        self.try_part(wheel, done, t, touching, length, phase, traction, traction_change)
            elif beyond > 0.0:
                slot = wheel if done == 0.0 else self.wheels
                self.solve_contact(wheel, slot, (1.0 - done) * length)
            if t > done:
                slot = wheel if done == 0.0 and t == 1.0 else self.wheels
                self.finish_step(wheel, slot)
            if not cut:
                break
            touching = not touching
            done = t
            self.forces[wheel] = 0.0
        self.touching[wheel] = 1 if self.forces[wheel] > 0.0 else 0

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def step(
        self, wheel: cython.Py_ssize_t, length: cython.double, traction: cython.double,
        traction_change: cython.double,
    ) -> cython.void:
        """One step at the present speed, to the heights ``end`` by way of the means ``mid``."""
        P: cython.Py_ssize_t = self.points
        j: cython.Py_ssize_t
        k: cython.Py_ssize_t
        total: cython.double = 0.0
        phase: cython.double = self.motion.phase[wheel]
        turned: cython.double = fmod(phase + self.speed[wheel] * length, _FULL_TURN)
        end: cython.double = 0.0
        mid: cython.double = 0.0
        if self.lagging != 0.0:  # of the parabola with the road's ends and mean, at the end
            for j in range(P):
                self.rises[j] = (4.0 * self.end[j] - 6.0 * self.mid[j] + 2.0 * self.road[wheel * P + j]) / length
        if self.varying:
            self.sidewall_pull(wheel, phase, self.pull_begin)
            for k in range(4 * self.coupled + 4):
                self.pull_end[k] = self.pull_begin[k]
            if P == 1:
                end, mid = self.end[0], self.mid[0]
            self.save_or_restore(wheel, False)
            for _ in range(self.rounds - 1):
                self.whole_step(wheel, length, phase, traction, traction_change)
                self.sidewall_pull(wheel, turned, self.pull_end)
                self.save_or_restore(wheel, True)
                if P == 1:
                    self.end[0], self.mid[0] = end, mid
        self.whole_step(wheel, length, phase, traction, traction_change)
        for j in range(P):
            total += self.forces[wheel * P + j]
        self.contact[wheel] = total
        if self.lagging != 0.0:
            self.press(wheel)
        self.motion.phase[wheel] = turned

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def press(self, wheel: cython.Py_ssize_t) -> cython.void:
        """The contact force that is published, of springs with dampers: of how fast they are pressed in this state.

        The force that acts to a step's end is that of a mean rate, and knows nothing of a speed that changes there.
        """
        H: cython.Py_ssize_t = self.H
        M: cython.Py_ssize_t = self.M
        N: cython.Py_ssize_t = self.N
        P: cython.Py_ssize_t = self.points
        own: cython.Py_ssize_t = 2 * wheel * M
        right: cython.Py_ssize_t = 8 * wheel * M + 4 * M
        first: cython.Py_ssize_t = wheel * 2 * H
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        e: cython.Py_ssize_t
        total: cython.double = 0.0
        force: cython.double
        p: cython.double
        q: cython.double
        x: cython.double
        y: cython.double
        u: cython.double
        v: cython.double
        for i in range(N):
            x = y = 0.0
            for e in range(self.K * i, self.K * (i + 1)):
                p, q = self.own[own + e], self.own[own + M + e]
                u, v = self.belt.rate[wheel * M + e], self.belt.frequency[wheel * M + e]
                p, q = u * p - v * q, u * q + v * p
                if self.complete:
                    u, v = self.belt.right[right + e], self.belt.right[right + M + e]
                    p, q = u * p - v * q, u * q + v * p
                x += p
                y += q
            self.Z_end[i], self.Z_end[N + i] = x, y
        self.displacements_at_points(False)
        for j in range(P):
            i = wheel * P + j
            if self.forces[i] > 0.0:
                force = self.tangents[j] * self.z[first] - self.z[first + 1] + self.moved_end[j] + self.rises[j]
                force = self.static[wheel] * self.share[j] + (self.before[i] + self.lagging * force) / self.soft[j]
                total += force if force > 0.0 else 0.0
        self.contact[wheel] = total

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def whole_step(
        self, wheel: cython.Py_ssize_t, length: cython.double, phase: cython.double, traction: cython.double,
        traction_change: cython.double,
    ) -> cython.void:
        """The same, under a sidewall's pull that is a line from ``pull_begin`` to ``pull_end``."""
        if self.points == 1 and not self.rigid:
            self.parts(wheel, length, phase, traction, traction_change)
            return
        self.part_begin, self.part = 0.0, 1.0
        self.tabulate_step(wheel, wheel, length)
        self.free_deflection(wheel, wheel, length, phase, traction, traction_change)
        self.solve_contact(wheel, wheel, length)
        self.finish_step(wheel, wheel)

    # -- a sidewall that varies ------------------------------------------------------------------------------------

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def save_or_restore(self, wheel: cython.Py_ssize_t, back: cython.bint) -> cython.void:
        """Put aside what a step changes of a wheel, or take it ``back``."""
        k: cython.Py_ssize_t
        at: cython.Py_ssize_t = 0
        if back:
            for k in range(2 * self.M):
                self.own[2 * wheel * self.M + k] = self.kept[at + k]
            at += 2 * self.M
            for k in range(2 * self.H):
                self.z[2 * wheel * self.H + k] = self.kept[at + k]
            at += 2 * self.H
            for k in range(self.points):
                self.forces[wheel * self.points + k] = self.kept[at + 3 * k]
                self.before[wheel * self.points + k] = self.kept[at + 3 * k + 1]
                self.road[wheel * self.points + k] = self.kept[at + 3 * k + 2]
            self.touching[wheel] = 1 if self.kept[at + 3 * self.points] != 0.0 else 0
            return
        for k in range(2 * self.M):
            self.kept[at + k] = self.own[2 * wheel * self.M + k]
        at += 2 * self.M
        for k in range(2 * self.H):
            self.kept[at + k] = self.z[2 * wheel * self.H + k]
        at += 2 * self.H
        for k in range(self.points):
            self.kept[at + 3 * k] = self.forces[wheel * self.points + k]
            self.kept[at + 3 * k + 1] = self.before[wheel * self.points + k]
            self.kept[at + 3 * k + 2] = self.road[wheel * self.points + k]
        self.kept[at + 3 * self.points] = 1.0 if self.touching[wheel] else 0.0

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def sidewall_pull(
        self, wheel: cython.Py_ssize_t, phase: cython.double, pull: cython.double[::1]
    ) -> cython.void:
        """What the sidewall pulls beyond its mean at the present state, the wheel being turned by an angle.

        Harmonic j of the stiffness is k_j Re[conj(P) exp(i j psi)], P = e exp(i j (phi + chi)), the net displacement
        sum_m Re[conj(Z_m) exp(i m psi)]. Of the force, which is minus their product, n has the amplitude

            -k/2 [P Z_(n - j) + P conj(Z_(j - n)) + conj(P) Z_(n + j)],  and where n - j = 0 twice that of the first,

        the last of them for m = 0 the real part of half of it. Over the belt's mass per area, [m/s^2].
        """
        N: cython.Py_ssize_t = self.coupled
        J: cython.Py_ssize_t = self.uneven
        side: cython.Py_ssize_t
        at: cython.Py_ssize_t
        of: cython.Py_ssize_t
        n: cython.Py_ssize_t
        j: cython.Py_ssize_t
        u: cython.double
        v: cython.double
        x: cython.double
        y: cython.double
        self.net_of(wheel)
        self.angle[0] = phase
        grow(1, 0, self.none, self.angle, 1.0, self.c, self.s)
        x, y = self.c[0], self.s[0]
        u, v = 1.0, 0.0
        for j in range(J + 1):  # exp(i j phi), and P
            for side in range(2):
                of = 2 * side * (J + 1) + j
                self.wave[of] = self.variation[of] * u - self.variation[of + J + 1] * v
                self.wave[of + J + 1] = self.variation[of] * v + self.variation[of + J + 1] * u
            u, v = u * x - v * y, u * y + v * x
        for side in range(2):
            at = side * (2 * N + 2)
            of = 2 * side * (J + 1)
            for n in range(2 * N + 2):
                pull[at + n] = 0.0
            for j in range(1, J + 1):
                x, y = self.wave[of + j], self.wave[of + J + 1 + j]
                if x == 0.0 and y == 0.0:
                    continue
                if j <= N:
                    u, v = self.net[at + 2 * j], self.net[at + 2 * j + 1]
                    pull[at] -= 0.5 * (x * u + y * v)
                    pull[at + 2 * j] -= x * self.net[at]
                    pull[at + 2 * j + 1] -= y * self.net[at]
                for n in range(1, N + 1):
                    if n > j:
                        u, v = self.net[at + 2 * (n - j)], self.net[at + 2 * (n - j) + 1]
                        pull[at + 2 * n] -= 0.5 * (x * u - y * v)
                        pull[at + 2 * n + 1] -= 0.5 * (x * v + y * u)
                    elif j > n and j - n <= N:
                        u, v = self.net[at + 2 * (j - n)], self.net[at + 2 * (j - n) + 1]
                        pull[at + 2 * n] -= 0.5 * (x * u + y * v)
                        pull[at + 2 * n + 1] -= 0.5 * (y * u - x * v)
                    if n + j <= N:
                        u, v = self.net[at + 2 * (n + j)], self.net[at + 2 * (n + j) + 1]
                        pull[at + 2 * n] -= 0.5 * (x * u + y * v)
                        pull[at + 2 * n + 1] -= 0.5 * (x * v - y * u)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def net_of(self, wheel: cython.Py_ssize_t) -> cython.void:
        """Amplitudes of the coupled harmonics, radial and tangential, net of the wheel, rest included, into ``net``.

        Without stretching the tangential one follows the radial one as at rest: -i A_n/C_n of it.
        """
        L: cython.Py_ssize_t = self.coupled
        M: cython.Py_ssize_t = self.M
        at: cython.Py_ssize_t = 2 * L + 2
        q: cython.Py_ssize_t = wheel * 2 * self.H + self.H
        first: cython.Py_ssize_t = 2 * wheel * M
        right: cython.Py_ssize_t = 8 * wheel * M + 4 * M
        n: cython.Py_ssize_t
        i: cython.Py_ssize_t
        e: cython.Py_ssize_t
        square: cython.double = self.speed[wheel] * self.speed[wheel]
        a: cython.double
        b: cython.double
        x: cython.double
        y: cython.double
        u: cython.double
        v: cython.double
        y = self.z[q + 4] + self.rest[q + 4] if self.complete else self.z[q + 2] + self.rest[q + 2]
        x = 0.0
        if self.on_fore != 0.0:
            x = self.z[q + 5] + self.rest[q + 5] if self.complete else self.z[q + 3] + self.rest[q + 3]
        self.net[2] = self.z[q] + self.rest[q] - x
        self.net[3] = self.z[q + 1] + self.rest[q + 1] - y
        self.net[0] = self.net[1] = self.net[at] = self.net[at + 1] = 0.0
        if self.complete:
            self.net[at + 2] = self.z[q + 2] + self.rest[q + 2] - y
            self.net[at + 3] = self.z[q + 3] + self.rest[q + 3] + x
        else:
            self.net[at + 2], self.net[at + 3] = self.net[3], -self.net[2]
            if self.winding:
                self.net[at] = self.z[q + self.half]
        for n in range(0 if self.complete else 2, L + 1):
            if n == 1:
                continue
            x = y = u = v = 0.0
            if self.complete:
                i = n - 1 if n else 0
                for e in range(4 * i, 4 * i + 4):
                    a = self.own[first + e] + self.rest_own[first + e]
                    b = self.own[first + M + e] + self.rest_own[first + M + e]
                    x += self.belt.right[right + e] * a - self.belt.right[right + M + e] * b
                    y += self.belt.right[right + e] * b + self.belt.right[right + M + e] * a
                    u += self.belt.right[right + 2 * M + e] * a - self.belt.right[right + 3 * M + e] * b
                    v += self.belt.right[right + 2 * M + e] * b + self.belt.right[right + 3 * M + e] * a
                if n == 0:
                    y = v = 0.0
            else:
                i = n - 2
                e = first + 2 * i
                x = (self.own[e] + self.rest_own[e]) + (self.own[e + 1] + self.rest_own[e + 1])
                e += M
                y = (self.own[e] + self.rest_own[e]) + (self.own[e + 1] + self.rest_own[e + 1])
                a = stretch_at(self.belt.table, i, square)
                u, v = a * y, -a * x
            self.net[2 * n], self.net[2 * n + 1] = x, y
            self.net[at + 2 * n], self.net[at + 2 * n + 1] = u, v

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def pull_on_first_mode(self) -> cython.void:
        """What the sidewall's pull does to n = 1, the wheel and the wind-up at a part's begin, and its change there."""
        at: cython.Py_ssize_t = 2 * self.coupled + 2
        to: cython.Py_ssize_t
        k: cython.int
        x: cython.double
        y: cython.double
        u: cython.double
        v: cython.double
        wound: cython.double
        here: cython.double
        for k in range(2):
            here = self.part_begin if k == 0 else self.part
            x, y = self.pull_of_part(2, here, k), self.pull_of_part(3, here, k)
            u, v = self.pull_of_part(at + 2, here, k), self.pull_of_part(at + 3, here, k)
            wound = self.pull_of_part(at, here, k)
            to = k * self.H
            if self.complete:
                self.pushed[to], self.pushed[to + 1], self.pushed[to + 2], self.pushed[to + 3] = x, y, u, v
                self.pushed[to + 4] = -self.on_wheel * (y + u)
                if self.on_fore != 0.0:
                    self.pushed[to + 5] = -self.on_fore * (x - v)
            else:  # halves: a mass of both kinds, for a motion of both
                x, y = 0.5 * (x - v), 0.5 * (y + u)
                self.pushed[to], self.pushed[to + 1], self.pushed[to + 2] = x, y, -self.on_wheel * y
                if self.on_fore != 0.0:
                    self.pushed[to + 3] = -self.on_fore * x
                if self.winding:
                    self.pushed[to + self.half] = wound

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def pull_of_part(self, k: cython.Py_ssize_t, here: cython.double, change: cython.bint) -> cython.double:
        """The line of a pull at a part of the step, or how much of its change lies in one."""
        more: cython.double = (self.pull_end[k] - self.pull_begin[k]) * here
        return more if change else self.pull_begin[k] + more

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def pull_on_belt(
        self, wheel: cython.Py_ssize_t, slot: cython.Py_ssize_t, length: cython.double
    ) -> cython.void:
        """What it adds to the other harmonics: own coordinates at the end, and amplitudes there and in the mean."""
        L: cython.Py_ssize_t = self.coupled
        M: cython.Py_ssize_t = self.M
        N: cython.Py_ssize_t = self.N
        at: cython.Py_ssize_t = slot * 2 * M
        right: cython.Py_ssize_t = 8 * wheel * M + 4 * M
        left: cython.Py_ssize_t = (8 if self.complete else 4) * wheel * M
        other: cython.Py_ssize_t = 2 * L + 2
        n: cython.Py_ssize_t
        i: cython.Py_ssize_t
        e: cython.Py_ssize_t
        k: cython.int
        square: cython.double = self.speed[wheel] * self.speed[wheel]
        ratio: cython.double
        here: cython.double
        x: cython.double
        y: cython.double
        u: cython.double
        v: cython.double
        p: cython.double
        q: cython.double
        a: cython.double
        b: cython.double
        for n in range(0 if self.complete else 2, L + 1):
            if n == 1:
                continue
            i = (n - 1 if n else 0) if self.complete else n - 2
            ratio = 0.0 if self.complete else stretch_at(self.belt.table, i, square)
            for k in range(2):
                here = self.part_begin if k == 0 else self.part
                x, y = self.pull_of_part(2 * n, here, k), self.pull_of_part(2 * n + 1, here, k)
                u, v = self.pull_of_part(other + 2 * n, here, k), self.pull_of_part(other + 2 * n + 1, here, k)
                if not self.complete:  # (G_r + i A/C G_t)/(1 + A/(n C))
                    a = 1.0 / (1.0 + ratio / n)
                    x, y = a * (x - ratio * v), a * (y + ratio * u)
                self.push_of[4 * k], self.push_of[4 * k + 1] = length * x, length * y
                self.push_of[4 * k + 2], self.push_of[4 * k + 3] = length * u, length * v
            for e in range(self.K * i, self.K * (i + 1)):
                p, q = self.belt.left[left + e], self.belt.left[left + M + e]
                x = p * self.push_of[0] - q * self.push_of[1]
                y = p * self.push_of[1] + q * self.push_of[0]
                u = p * self.push_of[4] - q * self.push_of[5]
                v = p * self.push_of[5] + q * self.push_of[4]
                if self.complete:
                    p, q = self.belt.left[left + 2 * M + e], self.belt.left[left + 3 * M + e]
                    x += p * self.push_of[2] - q * self.push_of[3]
                    y += p * self.push_of[3] + q * self.push_of[2]
                    u += p * self.push_of[6] - q * self.push_of[7]
                    v += p * self.push_of[7] + q * self.push_of[6]
                p, q = self.phi_1[at + e], self.phi_1[at + M + e]
                a, b = p * x - q * y, p * y + q * x
                p, q = self.phi_2[at + e], self.phi_2[at + M + e]
                a, b = a + (p * u - q * v), b + (p * v + q * u)
                self.real[e] += a
                self.imaginary[e] += b
                x, y = p * x - q * y, p * y + q * x
                p, q = self.phi_3[at + e], self.phi_3[at + M + e]
                x, y = x + (p * u - q * v), y + (p * v + q * u)
                if self.complete:
                    p, q = self.belt.right[right + e], self.belt.right[right + M + e]
                    a, b = a * p - b * q, a * q + b * p
                    x, y = x * p - y * q, x * q + y * p
                self.Z_end[i] += a
                self.Z_end[N + i] += b
                self.Z_mean[i] += x
                self.Z_mean[N + i] += y

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def set_road_and_runout(
        self, wheel: cython.Py_ssize_t, speed: cython.double, length: cython.double
    ) -> cython.void:
        """``end`` and ``mid`` from ``base`` and ``slope``, and run-out: at a step's end and in the mean over it."""
        P: cython.Py_ssize_t = self.points
        J: cython.Py_ssize_t = self.runouts
        j: cython.Py_ssize_t
        p: cython.Py_ssize_t
        y: cython.double
        mean: cython.double
        phase: cython.double = self.motion.phase[wheel]
        way: cython.double = speed * length
        for p in range(P):
            self.end[p] = self.base[wheel * P + p] + self.slope[p]
            self.mid[p] = self.base[wheel * P + p] + 0.5 * self.slope[p]
        if J == 0:
            return
        for j in range(J):
            self.angles[j] = (j + 1) * (phase + way)
            self.angles[J + j] = (j + 1) * (phase + 0.5 * way)
            self.angles[2 * J + j] = 0.5 * (j + 1) * way
        grow(3 * J, 0, self.none, self.angles, 1.0, self.c, self.s)
        for j in range(J):
            y = self.angles[2 * J + j]
            mean = 1.0 - y * y / 6.0 if abs(y) < 1e-4 else self.s[2 * J + j] / y  # sin(y)/y
            for p in range(P):
                self.end[p] += (
                    self.runout[2 * j * P + p] * self.c[j] + self.runout[(2 * j + 1) * P + p] * self.s[j]
                )
                self.mid[p] += mean * (
                    self.runout[2 * j * P + p] * self.c[J + j] + self.runout[(2 * j + 1) * P + p] * self.s[J + j]
                )

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def pieces_of(self, wheel: cython.Py_ssize_t, seconds: cython.double, speed: cython.double) -> cython.double:
        """Into how many equal steps a length of time is to be cut."""
        norm: cython.double = self.size + (abs(speed) + abs(self.speed[wheel])) * self.size_spin
        pieces: cython.double = ceil(seconds / _LONGEST_STEP - 1e-6)
        other: cython.double = ceil(norm * seconds / _LONGEST) if norm * seconds < 1e18 else 1e18
        pieces = other if other > pieces else pieces
        return pieces if pieces > 1.0 else 1.0

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def advance_wheel(
        self,
        wheel: cython.Py_ssize_t,
        seconds: cython.double,
        speed: cython.double,
        height: cython.double,
        angle: cython.double,
    ) -> cython.void:
        """Go on by a time at a speed, along a line to a height [m]; the angle is NaN where it is not known.

        With several points the height is that at the patch's foremost edge, and goes backward with the wheel's way.
        """
        P: cython.Py_ssize_t = self.points
        way: cython.double
        move: cython.double
        begin: cython.double
        j: cython.Py_ssize_t
        k: cython.Py_ssize_t
        count: cython.Py_ssize_t
        target: cython.double = height - self.origin[wheel]
        pieces: cython.double
        if angle == angle:
            self.motion.phase[wheel] = angle
        if speed != self.speed[wheel]:
            self.change_speed(wheel, speed)
        pieces = self.pieces_of(wheel, seconds, speed)
        if not pieces <= _MOST_STEPS:
            self.mark_diverged(wheel)
            return
        count = cython.cast(cython.Py_ssize_t, pieces)
        way = self.way[wheel]
        move = self.radius * speed * seconds
        if P > 1:
            self.extend_profile(wheel, move, target)
            self.edge_height[wheel] = target
        begin = self.base[wheel]
        for k in range(count):
            if P > 1:
                self.way[wheel] = way + move * ((k + 1) / pieces)
                for j in range(P):
                    self.slope[j] = self.height_at(wheel, self.way[wheel] + self.ahead[j]) - self.base[wheel * P + j]
            elif k == count - 1:
                self.slope[0] = target - self.base[wheel]
            else:
                self.slope[0] = (target - begin) / pieces
            self.set_road_and_runout(wheel, speed, seconds / pieces)
            for j in range(P):
                self.base[wheel * P + j] += self.slope[j]
            self.step(wheel, seconds / pieces, 0.0, 0.0)
        if P == 1:
            self.base[wheel] = target
        self.publish_now(wheel)

    # -- the road's profile under several points ------------------------------------------------------------------

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def extend_profile(self, wheel: cython.Py_ssize_t, move: cython.double, height: cython.double) -> cython.void:
        """Lay the road ahead of the patch's edge in the direction of a way [m], along a line to a height [m].

        Road heights that are received lie there. A wheel that stands is lifted as a whole by a road that moves.
        """
        at: cython.Py_ssize_t = 2 * wheel * _KNOTS
        k: cython.Py_ssize_t
        last: cython.Py_ssize_t
        forward: cython.bint = move > 0.0
        edge: cython.double
        there: cython.double
        if move == 0.0:
            there = height - self.edge_height[wheel]
            for k in range(_KNOTS):
                self.knots[at + _KNOTS + k] += there
            return
        edge = self.way[wheel] + (self.reach_of_patch if forward else -self.reach_of_patch)
        last = self.known[wheel] - 1
        k = at + ((self.knot[wheel] + (last if forward else 0)) & (_KNOTS - 1))
        if self.knots[k] != edge:  # the wheel has turned round: what lies beyond its edge is not known
            there = self.height_at(wheel, edge)
            while self.known[wheel] > 0:
                k = at + ((self.knot[wheel] + (self.known[wheel] - 1 if forward else 0)) & (_KNOTS - 1))
                if self.knots[k] < edge if forward else self.knots[k] > edge:
                    break
                if not forward:
                    self.knot[wheel] += 1
                self.known[wheel] -= 1
            self.add_knot(wheel, forward, edge, there)
        last = self.known[wheel] - 1
        if last > 0:  # close to the one before: in its place
            k = at + ((self.knot[wheel] + (last - 1 if forward else 1)) & (_KNOTS - 1))
            if abs(self.knots[k] - edge) < self.reach_of_patch / 64.0:
                if not forward:
                    self.knot[wheel] += 1
                self.known[wheel] -= 1
        self.add_knot(wheel, forward, edge + move, height)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def add_knot(
        self, wheel: cython.Py_ssize_t, forward: cython.bint, place: cython.double, height: cython.double
    ) -> cython.void:
        """One more knot of the profile, and without those that lie beyond the patch's other edge, but for one."""
        at: cython.Py_ssize_t = 2 * wheel * _KNOTS
        k: cython.Py_ssize_t
        if not forward:
            self.knot[wheel] -= 1
        self.known[wheel] += 1
        k = (self.knot[wheel] + (self.known[wheel] - 1 if forward else 0)) & (_KNOTS - 1)
        self.knots[at + k], self.knots[at + _KNOTS + k] = place, height
        while self.known[wheel] > 2:
            k = (self.knot[wheel] + (1 if forward else self.known[wheel] - 2)) & (_KNOTS - 1)
            place = self.knots[at + k] - self.way[wheel]
            if self.known[wheel] < _KNOTS and (
                place > -self.reach_of_patch if forward else place < self.reach_of_patch
            ):
                break
            if forward:
                self.knot[wheel] += 1
            self.known[wheel] -= 1

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def height_at(self, wheel: cython.Py_ssize_t, place: cython.double) -> cython.double:
        """The road's height [m] at a place on the wheel's way [m], level beyond what is known."""
        at: cython.Py_ssize_t = 2 * wheel * _KNOTS
        low: cython.Py_ssize_t = 0
        high: cython.Py_ssize_t = self.known[wheel] - 1
        k: cython.Py_ssize_t
        m: cython.Py_ssize_t
        k = at + (self.knot[wheel] & (_KNOTS - 1))
        if place <= self.knots[k]:
            return self.knots[k + _KNOTS]
        k = at + ((self.knot[wheel] + high) & (_KNOTS - 1))
        if place >= self.knots[k]:
            return self.knots[k + _KNOTS]
        while high - low > 1:
            m = (low + high) // 2
            if self.knots[at + ((self.knot[wheel] + m) & (_KNOTS - 1))] <= place:
                low = m
            else:
                high = m
        k = at + ((self.knot[wheel] + low) & (_KNOTS - 1))
        m = at + ((self.knot[wheel] + high) & (_KNOTS - 1))
        return self.knots[k + _KNOTS] + (self.knots[m + _KNOTS] - self.knots[k + _KNOTS]) * (
            (place - self.knots[k]) / (self.knots[m] - self.knots[k])
        )

    def set_profile(self, index: int, places: Sequence[float], heights: Sequence[float]) -> None:
        """Have these knots, ascending, as the profile under the points of a wheel."""
        if self.points == 1:
            return
        knots = np.asarray(self.knots).reshape(self.wheels, 2, _KNOTS)
        self.knot[index], self.known[index] = 0, len(places)
        knots[index, 0, : len(places)], knots[index, 1, : len(places)] = places, heights

    def _profile_snapshot(self, index: int) -> dict[str, Any]:
        """What is known of the road under several points: how far a wheel has come, and places and heights of knots."""
        if self.points == 1:
            return {}
        knots = np.asarray(self.knots).reshape(self.wheels, 2, _KNOTS)[index]
        profile = knots[:, (self.knot[index] + np.arange(self.known[index])) % _KNOTS].tolist()
        return {"way": float(self.way[index]), "edge_height": float(self.edge_height[index]), "profile": profile}

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def mark_diverged(self, wheel: cython.Py_ssize_t) -> cython.void:
        k: cython.Py_ssize_t
        for k in range(2 * self.H):
            self.z[wheel * 2 * self.H + k] = _NAN
        self.publish_now(wheel)

    # -- what can be read -----------------------------------------------------------------------------------------

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def publish_now(self, wheel: cython.Py_ssize_t) -> cython.void:
        """The whole state of n = 1 and the wheel into ``motion``."""
        h: cython.Py_ssize_t = self.half
        H: cython.Py_ssize_t = self.H
        k: cython.Py_ssize_t
        at: cython.Py_ssize_t = wheel * 2 * h
        first: cython.Py_ssize_t = wheel * 2 * H
        for k in range(h):
            self.motion.state[at + k] = self.z[first + k] + self.rest[first + k]
            self.motion.state[at + h + k] = self.z[first + H + k] + self.rest[first + H + k]
        self.motion.spin_speed[wheel] = self.speed[wheel]

    def publish(self, wheel: int) -> None:
        """The same, from Python."""
        self.publish_now(wheel)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def axle_force_and_norm(self, wheel: cython.Py_ssize_t, speed: cython.double) -> cython.bint:
        """Force on one axle into ``motion``'s ``force_x`` and ``force_z``; whether the state is bounded."""
        H: cython.Py_ssize_t = self.H
        bounded: cython.bint = self.motion.axle_force_and_norm(wheel, speed)
        first: cython.Py_ssize_t = wheel * 2 * H
        k: cython.Py_ssize_t
        value: cython.double
        if self.sprung:
            value = self.c_s * self.z[first + H - 1] + self.k_s * self.z[first + 2 * H - 1]
            self.motion.force_z -= value
        if self.varying and self.held_mass != 0.0:  # what holds the wheel feels the whole sidewall
            self.sidewall_pull(wheel, self.motion.phase[wheel], self.pull)
            k = 2 * self.coupled + 2
            self.motion.force_x += self.held_mass * (
                self.pull[2] - self.pull[k + 3] if self.complete else 0.5 * (self.pull[2] - self.pull[k + 3])
            )
        value = self.contact[wheel] + self.motion.force_z
        if not abs(value) < 1e12:
            bounded = False
        return bounded

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def set_belt(self, wheel: cython.Py_ssize_t) -> cython.void:
        """The belt's own coordinates into ``belt``, whose shape is wanted."""
        k: cython.Py_ssize_t
        at: cython.Py_ssize_t = 2 * wheel * self.M
        self.belt.waiting[wheel] = 0
        for k in range(2 * self.M):
            self.belt.own[at + k] = self.own[at + k] + self.rest_own[at + k]

    def advance(
        self, index: int, seconds: float, speed: float, height: float, angle: float = math.nan
    ) -> None:
        """Go on by a time [s] at a speed [rad/s], along a line to a height [m]; the angle [rad] if it is known."""
        self.advance_wheel(index, seconds, speed, height, angle)

    def angles_of_points(self) -> FloatArray:
        """beta of each contact point from the middle of the patch, along psi [rad], shape (P,); > 0 lies behind."""
        return self._angles.copy()

    def contact_of(self, index: int) -> float:
        """The contact force on one tire, up [N]."""
        return float(self.contact[index])

    def axle_force(self, index: int) -> tuple[float, float]:
        """Force on one axle (x, z), REP 103 axes [N]."""
        self.axle_force_and_norm(index, self.speed[index])
        return self.motion.force_x, self.motion.force_z

    def deflection(self, index: int) -> FloatArray:
        """Radial and tangential deflection of the belt relative to the wheel centre [m], shape (2, P)."""
        self.set_belt(index)
        return self.belt.deflection(index, self.motion)

    def follow_lines(
        self, time: FloatArray, speed: FloatArray, heights: FloatArray, traction: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Wheel 0 from sample to sample, from the state that it is in at the first.

        Parameters
        ----------
        time, speed, traction : ndarray, shape (N,)
            [s], ascending, [rad/s] and [N]; linear between samples.
        heights : ndarray, shape (N, P)
            Of the road under each point [m], linear between samples.

        Returns
        -------
        states : ndarray, shape (N, n)
        forces : ndarray, shape (N, 2)
            On the axle (x, z), REP 103 axes [N].
        contact, body : ndarray, shape (N,)
            Contact force, up [N], and displacement of the sprung mass, up [m].
        """
        count, n = len(time), self.motion.states
        states, forces = np.empty((count, n)), np.empty((count, 2))
        contact, body = np.empty(count), np.empty(count)
        columns = [np.ascontiguousarray(each).reshape(-1).data for each in (time, speed, heights, traction)]
        outputs = [each.reshape(-1).data for each in (states, forces, contact, body)]
        self._follow_lines(count, *columns, *outputs)
        return states, forces, contact, body

    def _follow_lines(
        self,
        count: cython.Py_ssize_t,
        time: cython.const[cython.double][::1],
        speed: cython.const[cython.double][::1],
        heights: cython.const[cython.double][::1],
        traction: cython.const[cython.double][::1],
        states: cython.double[::1],
        forces: cython.double[::1],
        contact: cython.double[::1],
        body: cython.double[::1],
    ) -> None:
        P: cython.Py_ssize_t = self.points
        i: cython.Py_ssize_t
        k: cython.Py_ssize_t
        j: cython.Py_ssize_t
        parts: cython.Py_ssize_t
        pieces: cython.double
        seconds: cython.double
        part: cython.double
        change: cython.double
        pull: cython.double
        with cython.nogil:
            for i in range(count):
                if i > 0:
                    seconds = time[i] - time[i - 1]
                    change = speed[i] - speed[i - 1]
                    pull = traction[i] - traction[i - 1]
                    pieces = self.pieces_of(0, seconds, speed[i])
                    if not pieces <= _MOST_STEPS:
                        self.mark_diverged(0)
                        pieces = 0.0
                    parts = cython.cast(cython.Py_ssize_t, pieces)
                    for k in range(parts):
                        part = k / pieces
                        self.change_speed(0, speed[i - 1] + change * ((k + 0.5) / pieces))
                        for j in range(P):
                            self.slope[j] = (heights[i * P + j] - heights[(i - 1) * P + j]) / pieces
                        self.set_road_and_runout(0, self.speed[0], seconds / pieces)
                        for j in range(P):
                            self.base[j] += self.slope[j]
                        self.step(0, seconds / pieces, traction[i - 1] + pull * part, pull / pieces)
                    self.change_speed(0, speed[i])
                    if self.lagging != 0.0 and parts > 0:
                        self.press(0)
                    for j in range(P):
                        self.base[j] = heights[i * P + j] - self.origin[0]
                    self.publish_now(0)
                self.axle_force_and_norm(0, speed[i])
                for k in range(self.motion.states):
                    states[i * self.motion.states + k] = self.motion.state[k]
                forces[2 * i], forces[2 * i + 1] = self.motion.force_x, self.motion.force_z
                contact[i] = self.contact[0]
                body[i] = self.z[2 * self.H - 1] if self.sprung else 0.0

    def snapshot(self, index: int) -> dict[str, Any]:
        """Everything of a wheel that later results depend on, in JSON's types; its angle is ``motion``'s."""
        w, P, H, M = index, self.points, self.H, self.M
        return {
            "speed": float(self.speed[w]),
            "own": np.asarray(self.own)[2 * w * M : 2 * (w + 1) * M].tolist(),
            "z": np.asarray(self.z)[2 * w * H : 2 * (w + 1) * H].tolist(),
            **{name: np.asarray(each)[w * P : (w + 1) * P].tolist() for name, each in self._by_point().items()},
            "first_weight": float(self.first_weight[w]),
            "origin": float(self.origin[w]),
            "touching": bool(self.touching[w]),
            **self._profile_snapshot(w),
        }

    def _by_point(self) -> dict[str, Any]:
        return {
            "forces": self.forces, "before": self.before, "road": self.road, "base": self.base, "first": self.first,
        }

    def restore(self, index: int, snapshot: Mapping[str, Any]) -> None:
        """Take over a :meth:`snapshot`, behind that of ``motion``."""
        w, P, H, M = index, self.points, self.H, self.M
        expected = {"own": 2 * M, "z": 2 * H, **dict.fromkeys(self._by_point(), P)}
        for name, size in expected.items():
            if len(snapshot[name]) != size:
                raise ValueError(f"{name} on the road has {len(snapshot[name])} numbers; it must have {size}")
        speed = float(snapshot["speed"])
        self.belt.waiting[w] = 0
        self.belt._eigensystem(w, speed)
        for name, values in self._by_point().items():
            np.asarray(values)[w * P : (w + 1) * P] = snapshot[name]
        self.first_weight[w], self.origin[w] = float(snapshot["first_weight"]), float(snapshot["origin"])
        if P > 1:
            height = snapshot.get("edge_height", snapshot.get("told"))  # "told" in logs of earlier builds
            self.way[w], self.edge_height[w] = float(snapshot["way"]), float(height)
            self.set_profile(w, *snapshot["profile"])
        self.speed[w] = speed
        self.rest_at(w)
        np.asarray(self.own)[2 * w * M : 2 * (w + 1) * M] = snapshot["own"]
        np.asarray(self.z)[2 * w * H : 2 * (w + 1) * H] = snapshot["z"]
        total = 0.0
        for force in snapshot["forces"]:
            total += float(force)
        self.contact[w] = total
        self.touching[w] = bool(snapshot["touching"])
        self.publish_now(w)


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _next_row(
    H: cython.Py_ssize_t,
    matrix: cython.double[::1],
    rows: cython.double[::1],
    row: cython.Py_ssize_t,
    part: cython.double,
    moved: cython.double[::1],
    force: cython.bint,
) -> cython.void:
    r: cython.Py_ssize_t
    c: cython.Py_ssize_t
    total: cython.double
    other: cython.double
    for r in range(H):
        total = other = 0.0  # two sums side by side, as each waits for itself
        for c in range(H):
            total += matrix[r * 2 * H + c] * rows[row + c]
            other += matrix[r * 2 * H + H + c] * rows[row + H + c]
        total += other
        if force:
            total += moved[r]
        rows[row + 2 * H + r] = total * part
        rows[row + 3 * H + r] = rows[row + r] * part


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _phi(
    M: cython.Py_ssize_t,
    first: cython.Py_ssize_t,
    rate: cython.double[::1],
    frequency: cython.double[::1],
    length: cython.double,
    factorial: cython.double[::1],
    growth: cython.double[::1],
    at: cython.Py_ssize_t,
    phi_1: cython.double[::1],
    phi_2: cython.double[::1],
    phi_3: cython.double[::1],
) -> cython.void:
    """phi_1 to phi_3 of mu h; where that is small phi_3 is its series, and the others follow without cancellation."""
    e: cython.Py_ssize_t
    j: cython.Py_ssize_t
    x: cython.double
    y: cython.double
    p: cython.double
    q: cython.double
    u: cython.double
    v: cython.double
    square: cython.double
    for e in range(M):
        x, y = rate[first + e] * length, frequency[first + e] * length
        square = x * x + y * y
        if square < 1.0:
            p, q = factorial[20], 0.0
            for j in range(16, -1, -1):
                u = p * x - q * y + factorial[j + 3]
                q = p * y + q * x
                p = u
            phi_3[at + e], phi_3[at + M + e] = p, q
            u = p * x - q * y + 0.5
            q = p * y + q * x
            p = u
            phi_2[at + e], phi_2[at + M + e] = p, q
            u = p * x - q * y + 1.0
            q = p * y + q * x
            phi_1[at + e], phi_1[at + M + e] = u, q
        else:
            square = 1.0 / square
            x, y = x * square, -y * square
            p, q = growth[at + e] - 1.0, growth[at + M + e]
            u, v = p * x - q * y, p * y + q * x
            phi_1[at + e], phi_1[at + M + e] = u, v
            u = u - 1.0
            p, q = u * x - v * y, u * y + v * x
            phi_2[at + e], phi_2[at + M + e] = p, q
            p = p - 0.5
            phi_3[at + e], phi_3[at + M + e] = p * x - q * y, p * y + q * x


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _forced(
    M: cython.Py_ssize_t,
    wheel: cython.Py_ssize_t,
    rate: cython.double[::1],
    frequency: cython.double[::1],
    steady: cython.double[::1],
    length: cython.double,
    at: cython.Py_ssize_t,
    phi_1: cython.double[::1],
    phi_2: cython.double[::1],
    phi_3: cython.double[::1],
    from_a: cython.double[::1],
    from_b: cython.double[::1],
    mean_a: cython.double[::1],
    mean_b: cython.double[::1],
) -> cython.void:
    """What forces a and b of 1 N, up, leave of own coordinates at the end and in the mean.

    Their drive is mu times what 1 N outward leaves in the end.
    """
    e: cython.Py_ssize_t
    g: cython.Py_ssize_t = wheel * M
    f: cython.Py_ssize_t = 4 * wheel * M
    x: cython.double
    y: cython.double
    p: cython.double
    q: cython.double
    u: cython.double
    v: cython.double
    a: cython.double
    b: cython.double
    for e in range(M):
        a, b = rate[g + e] * length, frequency[g + e] * length
        p, q = steady[f + e], steady[f + M + e]
        x, y = a * p - b * q, a * q + b * p
        u, v = phi_2[at + e], phi_2[at + M + e]
        from_b[at + e], from_b[at + M + e] = u * x - v * y, u * y + v * x
        p, q = phi_1[at + e] - u, phi_1[at + M + e] - v
        from_a[at + e], from_a[at + M + e] = p * x - q * y, p * y + q * x
        a, b = phi_3[at + e], phi_3[at + M + e]
        p, q = u - a, v - b
        mean_a[at + e], mean_a[at + M + e] = p * x - q * y, p * y + q * x
        mean_b[at + e], mean_b[at + M + e] = a * x - b * y, a * y + b * x


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _times(
    M: cython.Py_ssize_t,
    right: cython.double[::1],
    first: cython.Py_ssize_t,
    some: cython.double[::1],
    result: cython.double[::1],
    at: cython.Py_ssize_t,
) -> cython.void:
    """Products of complex numbers: ``result`` of ``right`` from a place on and ``some``, both at their own places."""
    e: cython.Py_ssize_t
    p: cython.double
    q: cython.double
    for e in range(M):
        p, q = right[first + e], right[first + M + e]
        result[at + e] = some[at + e] * p - some[at + M + e] * q
        result[at + M + e] = some[at + e] * q + some[at + M + e] * p


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _answers(
    N: cython.Py_ssize_t,
    K: cython.Py_ssize_t,
    complete: cython.bint,
    right: cython.double[::1],
    first: cython.Py_ssize_t,
    at: cython.Py_ssize_t,
    from_a: cython.double[::1],
    from_b: cython.double[::1],
    mean_a: cython.double[::1],
    mean_b: cython.double[::1],
    turned: cython.double[::1],
    answer: cython.double[::1],
) -> cython.void:
    """Z_1 of each harmonic under its own part of such forces, turned back: 8 rows, by force, time and part."""
    M: cython.Py_ssize_t = N * K
    i: cython.Py_ssize_t
    e: cython.Py_ssize_t
    k: cython.Py_ssize_t
    x: cython.double
    y: cython.double
    p: cython.double
    q: cython.double
    if not complete:  # whose eigenvectors end in one
        for i in range(N):
            x, y = turned[i], -turned[N + i]
            e = at + 2 * i
            p, q = from_a[e] + from_a[e + 1], from_a[M + e] + from_a[M + e + 1]
            answer[i], answer[N + i] = p * x - q * y, p * y + q * x
            p, q = from_b[e] + from_b[e + 1], from_b[M + e] + from_b[M + e + 1]
            answer[2 * N + i], answer[3 * N + i] = p * x - q * y, p * y + q * x
            p, q = mean_a[e] + mean_a[e + 1], mean_a[M + e] + mean_a[M + e + 1]
            answer[4 * N + i], answer[5 * N + i] = p * x - q * y, p * y + q * x
            p, q = mean_b[e] + mean_b[e + 1], mean_b[M + e] + mean_b[M + e + 1]
            answer[6 * N + i], answer[7 * N + i] = p * x - q * y, p * y + q * x
        return
    for i in range(8 * N):
        answer[i] = 0.0
    for i in range(N):
        for e in range(4 * i, 4 * i + 4):
            p, q = right[first + e], right[first + M + e]
            answer[i] += from_a[at + e] * p - from_a[at + M + e] * q
            answer[N + i] += from_a[at + e] * q + from_a[at + M + e] * p
            answer[2 * N + i] += from_b[at + e] * p - from_b[at + M + e] * q
            answer[3 * N + i] += from_b[at + e] * q + from_b[at + M + e] * p
            answer[4 * N + i] += mean_a[at + e] * p - mean_a[at + M + e] * q
            answer[5 * N + i] += mean_a[at + e] * q + mean_a[at + M + e] * p
            answer[6 * N + i] += mean_b[at + e] * p - mean_b[at + M + e] * q
            answer[7 * N + i] += mean_b[at + e] * q + mean_b[at + M + e] * p
        x, y = turned[i], -turned[N + i]
        for k in range(4):
            p, q = answer[2 * k * N + i], answer[(2 * k + 1) * N + i]
            answer[2 * k * N + i], answer[(2 * k + 1) * N + i] = p * x - q * y, p * y + q * x


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _ahead(
    N: cython.Py_ssize_t,
    K: cython.Py_ssize_t,
    M: cython.Py_ssize_t,
    at: cython.Py_ssize_t,
    first: cython.Py_ssize_t,
    end_seen: cython.double[::1],
    mean_seen: cython.double[::1],
    own: cython.double[::1],
    Z_end: cython.double[::1],
    Z_mean: cython.double[::1],
) -> cython.void:
    """Z_1 of each harmonic at a step's end and in the mean, were the forces the static ones."""
    i: cython.Py_ssize_t
    e: cython.Py_ssize_t
    x: cython.double
    y: cython.double
    u: cython.double
    v: cython.double
    p: cython.double
    q: cython.double
    for i in range(N):
        x = y = u = v = 0.0
        for e in range(K * i, K * (i + 1)):
            p, q = own[first + e], own[first + M + e]
            x += end_seen[at + e] * p - end_seen[at + M + e] * q
            y += end_seen[at + e] * q + end_seen[at + M + e] * p
            u += mean_seen[at + e] * p - mean_seen[at + M + e] * q
            v += mean_seen[at + e] * q + mean_seen[at + M + e] * p
        Z_end[i], Z_end[N + i] = x, y
        Z_mean[i], Z_mean[N + i] = u, v


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _go_on(
    N: cython.Py_ssize_t,
    K: cython.Py_ssize_t,
    M: cython.Py_ssize_t,
    at: cython.Py_ssize_t,
    first: cython.Py_ssize_t,
    growth: cython.double[::1],
    from_a: cython.double[::1],
    from_b: cython.double[::1],
    felt: cython.double[::1],
    real: cython.double[::1],
    imaginary: cython.double[::1],
    own: cython.double[::1],
) -> cython.void:
    """Own coordinates at a step's end, of the forces that each harmonic feels and of what a traction adds."""
    i: cython.Py_ssize_t
    e: cython.Py_ssize_t
    x: cython.double
    y: cython.double
    u: cython.double
    v: cython.double
    p: cython.double
    q: cython.double
    for i in range(N):
        x, y, u, v = felt[i], felt[N + i], felt[2 * N + i], felt[3 * N + i]
        for e in range(K * i, K * (i + 1)):
            p = growth[at + e] * own[first + e] - growth[at + M + e] * own[first + M + e]
            q = growth[at + e] * own[first + M + e] + growth[at + M + e] * own[first + e]
            p += from_a[at + e] * x - from_a[at + M + e] * y
            q += from_a[at + e] * y + from_a[at + M + e] * x
            p += from_b[at + e] * u - from_b[at + M + e] * v
            q += from_b[at + e] * v + from_b[at + M + e] * u
            own[first + e] = p + real[e] + 0.0
            own[first + M + e] = q + imaginary[e] + 0.0


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _factor(
    matrix: cython.double[::1],
    at: cython.Py_ssize_t,
    n: cython.Py_ssize_t,
    order: cython.longlong[::1],
    first: cython.Py_ssize_t,
) -> cython.void:
    """L and U of a matrix (n, n) in its place, rows exchanged as ``order`` says."""
    k: cython.Py_ssize_t
    i: cython.Py_ssize_t
    j: cython.Py_ssize_t
    pivot: cython.Py_ssize_t
    x: cython.double
    y: cython.double
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(matrix[at + i * n + k]) > abs(matrix[at + pivot * n + k]):
                pivot = i
        order[first + k] = pivot
        if pivot != k:
            for j in range(n):
                x = matrix[at + k * n + j]
                matrix[at + k * n + j] = matrix[at + pivot * n + j]
                matrix[at + pivot * n + j] = x
        x = matrix[at + k * n + k]
        x = 1.0 / x if x != 0.0 else _NAN
        matrix[at + k * n + k] = x  # its reciprocal is what is used
        for i in range(k + 1, n):
            matrix[at + i * n + k] *= x
            y = matrix[at + i * n + k]
            for j in range(k + 1, n):
                matrix[at + i * n + j] -= y * matrix[at + k * n + j]


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _solve(
    matrix: cython.double[::1],
    at: cython.Py_ssize_t,
    n: cython.Py_ssize_t,
    order: cython.longlong[::1],
    first: cython.Py_ssize_t,
    x: cython.double[::1],
) -> cython.void:
    """x, at first the right side, of a matrix that has been factored."""
    k: cython.Py_ssize_t
    j: cython.Py_ssize_t
    pivot: cython.Py_ssize_t
    total: cython.double
    for k in range(n):
        pivot = order[first + k]
        total = x[pivot]
        x[pivot] = x[k]
        x[k] = total
    for k in range(n):
        total = x[k]
        for j in range(k):
            total -= matrix[at + k * n + j] * x[j]
        x[k] = total
    for k in range(n - 1, -1, -1):
        total = x[k]
        for j in range(k + 1, n):
            total -= matrix[at + k * n + j] * x[j]
        x[k] = total * matrix[at + k * n + k]
