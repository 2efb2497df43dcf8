"""The tire on the road through time: steps that are exact but for the contact force, which is linear over each.

Over a step of length h the contact force is F(tau) = a (1 - tau) + b tau, 0 <= tau <= 1, and need not be what it was at
the end of the step before. Under such a force the linear system of ``contact`` is carried exactly. The residual spring
is obeyed at the step's end and in the mean over it, and both as complementarity, for the contact can only press:

    0 <= b  and  b/k - delta(h) >= 0,  one of them 0;
    0 <= a  and  (a + b)/(2 k) - mean(delta) >= 0,  one of them 0.

That is the discontinuous Galerkin method of degree 1 for the spring, the rest being exact. It is of third order where
contact lasts. Without damping the energy, with k delta^2/2 of the spring while delta > 0, never grows but by what the
road does, at any step length: the four cases of the two conditions give

    int F delta' dt - [k delta^2/2] = (a - k delta(0))^2/(2 k) >= 0    (contact before and after; else likewise),

so that motions which the step is too long for lose energy in the contact, and none gain. Where one patch loses or finds
the road, the moment is located inside the step (:meth:`ContactStepper._parts`), lest the order fall to one.

The state is kept as what it differs from the steady state under the static load at the present speed: at rest and on
a flat road everything that is computed is zero, and not a bit moves. docs/model.md, section 11, derives all of this. It
is the reference of the compiled loop, not the loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from exact_stepper import ExactStepper
from numpy.typing import ArrayLike, NDArray

from tire_dynamics import TireWheelUnit, wheel
from tire_dynamics.science.contact_points import ContactPoints
from tire_dynamics.science.modes import RingModes
from tire_dynamics.science.nonuniform import coordinates, coupling

__all__ = ["ContactStepper", "phi"]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

MOST_PARTS: Final = 4  # of a step in which contact is lost and found
SHARP: Final = 1e-9  # of the step: how well the moment is located
EXACT: Final = 1e-7  # [N]: a force that is none
MOST_TRIALS: Final = 30
ROUNDS: Final = 4

_NET: Final = {"alpha": (0.0, -1.0), "beta": (-1.0, 0.0), "xi": (-1.0, 0.0), "eta": (0.0, 1.0)}
"""What the sidewall sees of y and x beside each coordinate of n = 1: X - x, Y - y, U - y, V + x."""


def phi(x: ComplexArray) -> tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]:
    """exp(x) and phi_k(x) = sum_j x^j/(j + k)!, k = 1, 2, 3, without cancellation.

    Parameters
    ----------
    x : ndarray of complex

    Returns
    -------
    exponential, first, second, third : ndarray of complex, the shape of x

    Notes
    -----
    phi_(k + 1) = (phi_k - 1/k!)/x. Where abs(x) < 1, phi_3 is its series.
    """
    small = np.abs(x) < 1.0
    near, far = np.where(small, x, 0.5), np.where(small, 1.0, x)
    series = np.full_like(near, 1.0 / math.factorial(20))
    for j in reversed(range(17)):
        series = series * near + 1.0 / math.factorial(j + 3)
    near_2 = near * series + 0.5
    near_1 = near * near_2 + 1.0
    growth = np.exp(far)
    far_1 = (growth - 1.0) / far
    far_2 = (far_1 - 1.0) / far
    far_3 = (far_2 - 0.5) / far
    pairs = ((near * near_1 + 1.0, growth), (near_1, far_1), (near_2, far_2), (series, far_3))
    exponential, first, second, third = (np.where(small, one, other) for one, other in pairs)
    return exponential, first, second, third


class _Spin(NamedTuple):
    """What is constant at one speed; N harmonics with k coordinates, P points, n states of n = 1, G other forces."""

    exponents: ComplexArray  # mu, (N, k)
    seen: ComplexArray  # u_j = Re sum seen w, (P, N, k)
    driven: ComplexArray  # w' = mu w + driven F, (P, N, k)
    pulled: ComplexArray  # by the other forces of 1 each, (G, N, k)
    right: ComplexArray
    left: ComplexArray
    rest: ComplexArray  # own coordinates under the static load, (N, k)
    rest_one: FloatArray  # state of n = 1 under it, (n,)
    lift: FloatArray  # what the contact's displacements under the static load differ by from the first speed's, (P,)
    weight: float  # what the sprung mass is short of its weight by under the static load [N]
    sidewall: dict[int, tuple[FloatArray, FloatArray]]  # stiffness over cos j phi and sin j phi, (L, L)


class _Table(NamedTuple):
    """What is constant at one speed and length of a step."""

    growth: ComplexArray  # exp(mu h), (N, k)
    end_seen: ComplexArray  # u_j at the end and in the mean, of w at the start, (P, N, k)
    mean_seen: ComplexArray
    from_a: ComplexArray  # w at the end of forces a and b, (P, N, k)
    from_b: ComplexArray
    pulled_a: ComplexArray  # and of the other forces', (G, N, k)
    pulled_b: ComplexArray
    one: FloatArray  # [Phi G_0 G_1] of n = 1, transposed, its last states being the integrals
    end: FloatArray  # of delta at the end to [a, b], (P, 2 P); the same in the mean
    mean: FloatArray


class ContactStepper:
    """One wheel on the road, from step to step.

    Parameters
    ----------
    unit : TireWheelUnit
    static_load : float
        What the tire carries at the start, > 0 [N].
    speed : float
        At the start [rad/s]: the mean tire rolls steadily with it, on a flat road.
    model : {"inextensional", "complete"}
    n_max : int
    points : int
        Of the contact along the patch, P >= 1.
    coupled : int
        Highest harmonic up to which a sidewall that varies couples the belt's; 0: it does not.

    Attributes
    ----------
    force : ndarray, shape (P,)
        Vertical contact forces now [N].
    phase : float
        phi, the angle that the wheel has turned [rad].
    """

    def __init__(
        self,
        unit: TireWheelUnit,
        static_load: float,
        speed: float,
        *,
        model: wheel.Model = "inextensional",
        n_max: int = 30,
        points: int = 1,
        coupled: int = 0,
    ) -> None:
        if not (math.isfinite(static_load) and static_load > 0.0):
            raise ValueError(f"static_load is {static_load!r}; it must be > 0 and finite")
        self.whole, self.unit, self.model = unit, unit.mean, model
        self.points = ContactPoints(unit, points, model, n_max)
        turned = np.exp(1j * np.outer(self.points.angles, self.points.numbers))
        self.factors = self.points.spread * turned / self.points.cosines[:, None]
        self.static = static_load * self.points.share
        self._modes = RingModes(self.unit.replace(contact_half_angle=0.0), self.points.numbers, model)
        self._frame = wheel.fixed_frame(self.unit, model)
        self._half = len(self._frame.constant) // 2
        self._labels: list[tuple[int, str]] = []
        if coupled and (unit.radial_nonuniformity or unit.tangential_nonuniformity):
            count = min(coupled, n_max)
            every = coordinates(model, max(count, 2))
            kept = (0, 1, *range(2, count + 1)) if model == "complete" else range(1, count + 1)
            self._labels = [label for label in every if label[0] in kept]
        self._turns = bool(self._labels) or unit.imbalance_mass > 0.0
        self._one = self._stepper()
        self._spins: dict[float, _Spin] = {}
        self._tables: dict[tuple[float, float], _Table] = {}
        self._first: tuple[FloatArray, float] | None = None
        self.speed, self.phase = float(speed), 0.0
        self.spin = self._at(self.speed)
        self.own = np.zeros_like(self.spin.exponents)
        self.state = np.zeros(self._one.states)  # of n = 1, [b', b], and the integrals of its displacements
        self.force = self.static.copy()
        self.touching = np.ones(points, dtype=np.bool_)
        self._before = np.zeros(points)  # delta beyond the static one [m]
        self._road = np.zeros(points)
        self._side = np.zeros(len(self._labels))  # forces of the varying sidewall at the last step's end

    # -- tables ---------------------------------------------------------------------------------------------------

    def _stepper(self) -> ExactStepper:
        """n = 1, the wheel, the sprung mass and the integrals of the displacements of n = 1.

        Inputs: F, its part along X, what the sprung mass is short of; then F_x, the imbalance along X and Y, and the
        sidewall's forces on the coordinates of n = 1, with what they do to the wheel.
        """
        frame, unit = self._frame, self.unit
        n, half = len(frame.constant), self._half
        body, total = n, n + 2 * bool(unit.sprung_mass) + half
        constant, spin = np.zeros((2, total, total))
        kinds = ("alpha", "beta") if self.model == "inextensional" else ("alpha", "beta", "xi", "eta")
        inputs = np.zeros((total, 6 + len(self._labels)))
        constant[:n, :n], spin[:n, :n] = frame.constant, frame.spin
        inputs[:n, [0, 3]] = frame.input
        inputs[0, 1] = inputs[0, 4] = inputs[1, 5] = frame.input[1, 0]
        y = half + len(kinds)
        stiffest = math.sqrt(float(np.abs(frame.constant[:half, half:]).max()))
        scale = np.concatenate([np.repeat([1.0, 1.0 / stiffest], half), np.ones(total - n)])
        if unit.sprung_mass:
            k_s, c_s, M, m_b = unit.suspension_stiffness, unit.suspension_damping, unit.wheel_mass, unit.sprung_mass
            constant[y - half, [body, body + 1]] = c_s / M, k_s / M
            constant[body, [y - half, y, body, body + 1]] = c_s / m_b, k_s / m_b, -c_s / m_b, -k_s / m_b
            constant[body + 1, body] = 1.0
            inputs[body, 2] = 1.0 / m_b
            scale[[body, body + 1]] = 1.0, 1.0 / stiffest
        for k, label in enumerate(self._labels):
            if label[0] == 1:
                place = kinds.index(label[1])
                inputs[place, 6 + k] = frame.input[1, 0]
                up, along = _NET[label[1]]
                inputs[y - half, 6 + k] = up / unit.wheel_mass
                if not unit.is_longitudinally_rigid:
                    inputs[y - half + 1, 6 + k] = along / unit.fore_aft_mass
        constant[total - half :, half:n] = np.eye(half)
        scale[-half:] = stiffest**-2
        return ExactStepper([constant, spin], inputs, scale)

    def _at(self, speed: float) -> _Spin:
        if speed not in self._spins:
            modes, points = self._modes, self.points
            spinning = modes.at(speed)
            own = -spinning.steady_shapes() * spinning.exponents[..., None]
            row = 2 if self.model == "complete" else 1
            turned = np.array([1.0, -1.0j, -1.0, 1.0j])[np.mod(points.numbers, 4.0).astype(int)]
            seen = np.conj(turned * self.factors)[..., None] * spinning.right[:, row, :]
            driven = -self.factors[..., None] * own[..., 0]
            rest = np.tensordot(self.static, -driven / spinning.exponents, axes=1)
            load, across = float(self.static.sum()), float(self.static @ points.tangents)
            one = np.zeros(self._one.states)
            n = len(self._frame.constant)
            one[:n] = wheel.equilibrium(self.unit, speed, load, 0.0, self.model)
            one[:n] += across * self._across(speed)
            lift = self._contact_of(one) + np.real(np.tensordot(seen, rest, axes=2))
            carried = float((self._frame.output + speed * self._frame.output_spin)[1] @ one[:n])
            if self._first is None:
                self._first = lift, carried
            sidewall, masses = self._sidewall(speed)
            pulled = np.zeros((3 + len(self._labels), *own.shape[:2]), dtype=np.complex128)
            pulled[0] = -own[..., 1]
            numbers = points.numbers.tolist()
            for k, (number, kind) in enumerate(self._labels):
                if number != 1:
                    mode = numbers.index(float(number))
                    velocity = 1 if kind in ("xi", "eta") else 0
                    unit_force = 1j if kind in ("beta", "eta") else 1.0
                    pulled[3 + k, mode] = spinning.left[mode, :, velocity] * unit_force / masses[k]
            self._spins[speed] = _Spin(
                spinning.exponents, seen, driven, pulled, spinning.right, spinning.left, rest, one,
                lift - self._first[0], carried - self._first[1], sidewall,
            )  # fmt: skip
        return self._spins[speed]

    def _sidewall(self, speed: float) -> tuple[dict[int, tuple[FloatArray, FloatArray]], FloatArray]:
        """Stiffness [N/m] of each harmonic over cos j phi and sin j phi, between coupled coordinates; their masses."""
        found: dict[int, tuple[FloatArray, FloatArray]] = {}
        if not self._labels:
            return found, np.zeros(0)
        most = max(2, max(number for number, _ in self._labels))
        every = coordinates(self.model, most)
        kept = np.array([every.index(label) for label in self._labels])
        some = self.whole.radial_nonuniformity, self.whole.tangential_nonuniformity
        masses = np.zeros(len(every))
        for j in sorted({j for each in some for j, _, _ in each}):
            both = []
            for turn in (0.0, 0.5 * math.pi / j):
                radial, tangential = (tuple((i, e, chi + turn) for i, e, chi in each if i == j) for each in some)
                stiffness, masses = coupling(self.unit, radial, tangential, speed, self.model, most)
                both.append(stiffness[np.ix_(kept, kept)])
            found[j] = both[0], both[1]
        return found, masses[kept]

    def _across(self, speed: float) -> FloatArray:
        """The state of n = 1 under 1 N of radial force along -X."""
        F = self._frame.constant + speed * self._frame.spin
        half = len(F) // 2
        state = np.zeros(len(F))
        state[half:] = np.linalg.solve(-F[:half, half:], np.eye(half)[0] * self._frame.input[1, 0])
        return -state

    def _contact_of(self, state: FloatArray) -> FloatArray:
        """What n = 1 adds to the displacements of the points."""
        return np.asarray(state[self._half] * self.points.tangents - state[self._half + 1])

    def _mean_of(self, state: FloatArray, length: float) -> FloatArray:
        """And to their mean over a step."""
        X, Y = state[-self._half : -self._half + 2 or None] / length
        return np.asarray(X * self.points.tangents - Y)

    def _table(self, length: float) -> _Table:
        key = (self.speed, length)
        if key not in self._tables:
            if len(self._tables) > 64:
                self._tables.clear()
            self._tables[key] = self._tabulated(length)
        return self._tables[key]

    def _tabulated(self, length: float) -> _Table:
        spin, n, h = self.spin, self._one.states, length
        growth, first, second, third = phi(spin.exponents * h)
        into_a, into_b = h * (first - second), h * second
        mean_a, mean_b = h * (second - third), h * third
        one = self._one.transitions(np.array([h]), np.array([self.speed]))[0]
        start, change = one[n : n + self._one.inputs], one[n + self._one.inputs :]
        P = len(self.static)
        end, mean = np.empty((2, P, 2, P))
        belts = ((into_a, mean_a), (into_b, mean_b))
        for k, forced in enumerate((start - change, change)):
            for j, tangent in enumerate(self.points.tangents):
                state = forced[0] - tangent * forced[1]
                end[:, k, j] = self._contact_of(state) + _seen(spin.seen, belts[k][0] * spin.driven[j])
                mean[:, k, j] = self._mean_of(state, h) + _seen(spin.seen, belts[k][1] * spin.driven[j])
        return _Table(
            growth, spin.seen * growth, spin.seen * first, into_a * spin.driven, into_b * spin.driven,
            into_a * spin.pulled, into_b * spin.pulled, one, end.reshape(P, 2 * P), mean.reshape(P, 2 * P),
        )  # fmt: skip

    # -- steps ----------------------------------------------------------------------------------------------------

    def turn(self, speed: float) -> None:
        """Go on at another speed: the belt's velocities jump by the Euler terms' integral."""
        if speed == self.speed:
            return
        old, before, self.speed = self.spin, self.speed, float(speed)
        self.spin = new = self._at(self.speed)
        whole = (old.right @ (self.own + old.rest)[..., None])[..., 0]
        jumped = self._modes.change_speed(whole, before, self.speed)
        self.own = (new.left @ jumped[..., None])[..., 0] - new.rest
        n = len(self._frame.constant)
        one = wheel.change_speed(self.state[:n] + old.rest_one[:n], self.speed - before, self.model)
        self.state[:n] = one - new.rest_one[:n]
        self._before = self._deflection() + self._road

    def _deflection(self) -> FloatArray:
        """delta beyond the static one, but for the road's height."""
        return self._contact_of(self.state) + _seen(self.spin.seen, self.own) + self.spin.lift

    def step(
        self,
        length: float,
        road: ArrayLike,
        mean_road: ArrayLike | None = None,
        traction: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Go on by a step.

        Parameters
        ----------
        length : float
            h > 0 [s].
        road : array_like, shape () or (P,)
            Height at the step's end, beyond that of the start [m]; with run-out added.
        mean_road : array_like, shape () or (P,)
            Its mean over the step; without it the road is a line.
        traction : (float, float)
            On the tire, forward, at the start and the end, a line between them [N].
        """
        end = np.broadcast_to(np.asarray(road, dtype=np.float64), self.force.shape)
        mean = 0.5 * (self._road + end) if mean_road is None else np.broadcast_to(mean_road, self.force.shape)
        pulls = np.zeros((2, 3 + len(self._labels)))
        pulls[:, 0] = traction
        turned = self.phase + self.speed * length
        if self.whole.imbalance_mass:
            pulls[:, 1:3] = self._imbalance(turned)
        if not self._labels:
            self._take(length, end, mean, pulls)
            self.phase = turned
            return
        # The sidewall's forces are lines too, which meet the springs' law at the end and in the mean; they are a few
        # hundredths of what moves the belt, and three rounds leave a millionth of themselves
        pulls[:, 3:] = self._side
        state, own, force, touching, before, road_before = (
            self.state, self.own, self.force, self.touching.copy(), self._before, self._road
        )  # fmt: skip
        for _ in range(ROUNDS):
            self.state, self.own, self.force, self.touching = state.copy(), own.copy(), force.copy(), touching.copy()
            self._before, self._road = before, road_before
            mean_own, integrals = self._take(length, end, mean, pulls)
            self._pull_of_sidewall(pulls, turned, mean_own, integrals / length)
        self._side = pulls[1, 3:].copy()
        self.phase = turned

    def _imbalance(self, turned: float) -> FloatArray:
        """Lines along X and Y, (2, 2): the true end, and a begin such that the mean is true [N]."""
        unit = self.whole
        size = unit.imbalance_mass * unit.radius * self.speed * self.speed
        along = size * np.exp(1j * (unit.imbalance_angle + self.phase))
        x = 1j * (turned - self.phase)
        exponential, first, _, _ = phi(np.array([x]))
        end, mean = along * exponential[0], along * first[0]
        begin = 2.0 * mean - end
        return np.array([[begin.real, begin.imag], [end.real, end.imag]])

    def _pull_of_sidewall(self, pulls: FloatArray, turned: float, mean_own: ComplexArray, mean_one: FloatArray) -> None:
        """Put the lines of the sidewall's forces into ``pulls``, from the motion at the end and in the mean."""
        end, mean = self._net(self.own, self.state[self._half : 2 * self._half]), self._net(mean_own, mean_one)
        begin = 2.0 * mean - end
        last, middle = np.zeros((2, len(self._labels)))
        for j, (cosine, sine) in self.spin.sidewall.items():
            x = np.array([1j * j * (turned - self.phase)])
            exponential, first, second, _ = phi(x)
            at = np.exp(1j * j * self.phase)
            now, whole, falling = at * exponential[0], at * first[0], at * second[0]
            rising = whole - falling
            last -= now.real * (cosine @ end) + now.imag * (sine @ end)
            middle -= cosine @ (falling.real * begin + rising.real * end)
            middle -= sine @ (falling.imag * begin + rising.imag * end)
        pulls[0, 3:], pulls[1, 3:] = 2.0 * middle - last, last

    def _net(self, own: ComplexArray, one: FloatArray) -> FloatArray:
        """Coordinates that the sidewall couples, net of the wheel, rest included; of deviations from rest."""
        state = (self.spin.right @ (own + self.spin.rest)[..., None])[..., 0]
        amplitudes = self._modes.amplitudes(state)
        half = self._half
        q = one + self.spin.rest_one[half : 2 * half]
        kinds = ("alpha", "beta") if self.model == "inextensional" else ("alpha", "beta", "xi", "eta")
        y, x = q[len(kinds)], 0.0 if self.unit.is_longitudinally_rigid else q[len(kinds) + 1]
        numbers = self.points.numbers.tolist()
        net = np.empty(len(self._labels))
        for k, (number, kind) in enumerate(self._labels):
            if number == 1:
                up, along = _NET[kind]
                net[k] = q[kinds.index(kind)] + up * y + along * x
            else:
                amplitude = amplitudes[1 if kind in ("xi", "eta") else 0][numbers.index(float(number))]
                net[k] = amplitude.imag if kind in ("beta", "eta") else amplitude.real
        return net

    def _take(
        self, length: float, end: FloatArray, mean: FloatArray, pulls: FloatArray
    ) -> tuple[ComplexArray, FloatArray]:
        """A step under other forces that are lines; the mean of own coordinates, the integrals of those of n = 1."""
        if len(self.force) == 1 and math.isfinite(self.points.stiffness[0]):
            return self._parts(length, end, mean, pulls)
        forces, _ = self._forces(length, end, mean, pulls)
        return self._advance(length, forces, end, pulls)

    def _free(
        self, table: _Table, end: FloatArray, mean: FloatArray, pulls: FloatArray, length: float
    ) -> tuple[FloatArray, FloatArray]:
        """delta at the end and in the mean beyond the static one, were the forces the static ones."""
        state = self._driven(table, np.zeros((2, len(self.force))), pulls)
        at_end = self._contact_of(state) + _seen(table.end_seen, self.own) + self.spin.lift + end
        in_mean = self._mean_of(state, length) + _seen(table.mean_seen, self.own) + self.spin.lift + mean
        if pulls.any():
            at_end = at_end + _seen(self.spin.seen, _sum(pulls[0], table.pulled_a) + _sum(pulls[1], table.pulled_b))
            _, _, second, third = phi(self.spin.exponents * length)
            moved = (second - third) * _sum(pulls[0], self.spin.pulled) + third * _sum(pulls[1], self.spin.pulled)
            in_mean = in_mean + _seen(self.spin.seen, length * moved)
        return at_end, in_mean

    def _driven(self, table: _Table, forces: FloatArray, pulls: FloatArray) -> FloatArray:
        """n = 1 at the end, of forces [a, b] beyond the static ones, (2, P)."""
        a, b = forces.sum(axis=1)
        across = -forces @ self.points.tangents
        inputs = np.concatenate([[a, across[0], self.spin.weight], pulls[0]])
        changes = np.concatenate([[b - a, across[1] - across[0], 0.0], pulls[1] - pulls[0]])
        return np.asarray(np.concatenate([self.state, inputs, changes]) @ table.one)

    def _forces(
        self, length: float, end: FloatArray, mean: FloatArray, pulls: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """[a, b] beyond the static forces, (2, P): of the complementarity problem; if the contact could pull, too."""
        table = self._table(length)
        at_end, in_mean = self._free(table, end, mean, pulls, length)
        P = len(self.force)
        soft = np.diag(1.0 / self.points.stiffness)
        ends = np.concatenate([np.zeros((P, P)), soft], axis=1) - table.end
        means = np.concatenate([0.5 * soft, 0.5 * soft], axis=1) - table.mean
        damp = self.points.damping / length * np.diag(soft)
        if damp.any():
            c = damp[:, None]
            ends = ends - c * (4.0 * table.end - 6.0 * table.mean)
            means = means - c * table.end
            at_end, in_mean = (
                at_end + damp * (4.0 * at_end - 6.0 * in_mean + 2.0 * self._before),
                in_mean + damp * (at_end - self._before),
            )
        matrix = np.concatenate([means, ends])
        right = np.concatenate([in_mean, at_end])
        least = -np.concatenate([self.static] * 2)
        lasting = np.linalg.solve(matrix, right)
        forces = lasting if (lasting >= least).all() else _complementary(matrix, right, least)
        return forces.reshape(2, P), lasting.reshape(2, P)

    def _advance(
        self, length: float, forces: FloatArray, end: FloatArray, pulls: FloatArray
    ) -> tuple[ComplexArray, FloatArray]:
        table = self._table(length)
        state = self._driven(table, forces, pulls)
        integrals = state[-self._half :].copy()
        state[-self._half :] = 0.0
        mean = np.zeros_like(self.own)
        if self._labels:
            _, first, second, third = phi(self.spin.exponents * length)
            all_a, all_b = (_sum(forces[k], self.spin.driven) + _sum(pulls[k], self.spin.pulled) for k in (0, 1))
            mean = first * self.own + length * ((second - third) * all_a + third * all_b)
        own = table.growth * self.own + _sum(forces[0], table.from_a) + _sum(forces[1], table.from_b)
        if pulls.any():
            own = own + _sum(pulls[0], table.pulled_a) + _sum(pulls[1], table.pulled_b)
        self.own, self.state = own, state
        self.force = self.static + forces[1]
        self._road = np.array(end)
        self._before = self._deflection() + self._road
        self.touching = self.force > 0.0
        return mean, integrals

    def _parts(
        self, length: float, end: FloatArray, mean: FloatArray, pulls: FloatArray
    ) -> tuple[ComplexArray, FloatArray]:
        """A step of one patch, cut where contact is lost or found.

        The road is the parabola with the step's ends and mean. In contact the force b at the end of a part that ends at
        t tells whether contact lasts until t; without contact k delta + c delta' at t tells whether it has begun. Their
        roots are enclosed.
        """
        k, c = float(self.points.stiffness[0]), float(self.points.damping[0])
        done, bare = 0.0, -self.static
        first = self._road.copy()
        curve = 6.0 * (mean - 0.5 * (first + end))  # r = first + (end - first) t + curve t (1 - t)
        mean_own, integrals = np.zeros_like(self.own), np.zeros(self._half)

        def height(t: float) -> FloatArray:
            return np.asarray(first + (end - first) * t + curve * t * (1.0 - t))

        def between(t_0: float, t_1: float) -> FloatArray:
            d = t_1 - t_0
            return np.asarray(0.5 * (height(t_0) + height(t_1)) + curve * d * d / 6.0)

        def pulled(t_0: float, t_1: float) -> FloatArray:
            return np.asarray(pulls[0] + np.array([[t_0], [t_1]]) * (pulls[1] - pulls[0]))

        touching = bool(self.touching[0])
        for part in range(MOST_PARTS):

            def trial(t: float, touching: bool = touching, done: float = done) -> tuple[FloatArray, float]:
                """Forces of a part from ``done`` to t; how far beyond the loss or the find of contact its end is."""
                h, others = (t - done) * length, pulled(done, t)
                if touching:
                    forces, lasting = self._forces(h, height(t), between(done, t), others)
                    return forces, -float(lasting[1, 0] + self.static[0])
                forces = np.stack([bare, bare])
                free, _ = self._free(self._table(h), height(t), between(done, t), others, h)
                pressed = k * float(free[0] + (self._table(h).end @ forces.reshape(-1))[0]) + float(self.static[0])
                if c:
                    slope = float((end - first + curve * (1.0 - 2.0 * t))[0]) / length
                    pressed += c * (slope + self._rate(h, forces, others))
                return forces, pressed

            t = 1.0
            forces, beyond = trial(t)
            cut = beyond > 0.0 and part < MOST_PARTS - 1
            if cut:
                t, forces = _enclosed(trial, done, self._gap(touching), beyond)
            elif beyond > 0.0:
                forces, _ = self._forces((1.0 - done) * length, end, between(done, 1.0), pulled(done, 1.0))
            if t > done:
                some, integral = self._advance((t - done) * length, forces, height(t), pulled(done, t))
                mean_own, integrals = mean_own + (t - done) * some, integrals + integral
            if not cut:
                self.touching[:] = self.force > 0.0
                break
            touching, done = not touching, t
            self.force[:] = 0.0
        return mean_own, integrals

    def _gap(self, touching: bool) -> float:
        """How far before the loss or the find of contact the start is, <= 0 [N]."""
        if touching:
            return -max(0.0, float(self.force[0]))
        return min(0.0, float((self.points.stiffness * self._before + self.static)[0]))

    def _rate(self, length: float, forces: FloatArray, pulls: FloatArray) -> float:
        """u_c' at the end of a part [m/s]."""
        table = self._table(length)
        own = table.growth * self.own + _sum(forces[0], table.from_a) + _sum(forces[1], table.from_b)
        own = own + _sum(pulls[0], table.pulled_a) + _sum(pulls[1], table.pulled_b)
        slope = self.spin.exponents * own + _sum(forces[1], self.spin.driven) + _sum(pulls[1], self.spin.pulled)
        state = self._driven(table, forces, pulls)
        return float(_seen(self.spin.seen, slope)[0] - state[1])

    # -- what is seen ---------------------------------------------------------------------------------------------

    def axle_force(self) -> FloatArray:
        """[x, z] on the axle, REP 103 [N]."""
        n = len(self._frame.constant)
        whole = self.state[:n] + self.spin.rest_one[:n]
        force = np.asarray((self._frame.output + self.speed * self._frame.output_spin) @ whole)
        if self.unit.sprung_mass:
            unit = self.unit
            force[1] -= unit.suspension_damping * self.state[n] + unit.suspension_stiffness * self.state[n + 1]
        return force

    def wheel_height(self) -> float:
        """How far the wheel's centre has moved from where it is without load, y, up [m]."""
        q = self.state[self._half : 2 * self._half] + self.spin.rest_one[self._half : 2 * self._half]
        return float(q[2 if self.model == "inextensional" else 4])

    def belt(self, psi: ArrayLike) -> FloatArray:
        """Radial deflection of the belt at angles fixed in space [rad], outward, relative to the wheel's centre [m]."""
        angles = np.asarray(psi, dtype=np.float64)
        half = self._half
        q = self.state[half : 2 * half] + self.spin.rest_one[half : 2 * half]
        x = 0.0 if self.unit.is_longitudinally_rigid else float(q[-1])
        state = (self.spin.right @ (self.own + self.spin.rest)[..., None])[..., 0]
        radial, _ = self._modes.amplitudes(state)
        waves = np.exp(1j * np.multiply.outer(angles, self.points.numbers))
        one = (q[0] - x) * np.cos(angles) + (q[1] - self.wheel_height()) * np.sin(angles)
        return np.asarray(one + (waves @ np.conj(radial)).real)


def _sum(weights: FloatArray, each: ComplexArray) -> ComplexArray:
    """sum_j weights_j each_j."""
    return np.asarray(np.tensordot(weights, each, axes=1), dtype=np.complex128)


def _seen(seen: ComplexArray, own: ComplexArray) -> FloatArray:
    """Displacements of the points, shape (P,), of coordinates (N, k)."""
    return np.asarray(np.tensordot(seen, own, axes=2).real)


def _enclosed(
    trial: Callable[[float], tuple[FloatArray, float]], start: float, f_start: float, f_end: float
) -> tuple[float, FloatArray]:
    """Where trial()[1] changes its sign between start and 1, by the Illinois method, and the forces until there."""
    low, high, f_low, f_high = start, 1.0, f_start, f_end
    side = 0
    for _ in range(MOST_TRIALS):
        t = high - f_high * (high - low) / (f_high - f_low)
        if not low < t < high:
            t = 0.5 * (low + high)
        if not low < t < high:
            break
        forces, f = trial(t)
        if abs(f) <= EXACT or t - start < SHARP:
            return t, forces
        if f > 0.0:
            high, f_high = t, f
            f_low *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, f_low = t, f
            f_high *= 0.5 if side < 0 else 1.0
            side = -1
    return (low, trial(low)[0]) if low > start else (start, np.zeros((2, 1)))


def _complementary(matrix: FloatArray, right: FloatArray, least: FloatArray) -> FloatArray:
    """x >= least with y = matrix x - right >= 0 and one of the two bounds met in every row.

    By block pivoting, and Murty's rule of the least index when that has gone on for long (Murty, *Linear
    Complementarity*, 1988): it ends for any matrix whose principal minors are positive, as those of a contact are.
    """
    size = len(right)
    active = np.ones(size, dtype=np.bool_)
    x = least.copy()
    for trial in range(4 * size + 20):
        x = least.copy()
        if active.any():
            rest = right[active] - matrix[np.ix_(active, ~active)] @ least[~active]
            x[active] = np.linalg.solve(matrix[np.ix_(active, active)], rest)
        y = matrix @ x - right
        wrong = np.where(active, x < least, y < 0.0)
        if not wrong.any():
            break
        if trial < 8:
            active ^= wrong
        else:
            k = int(np.flatnonzero(wrong)[0])
            active[k] = ~active[k]
    return np.maximum(x, least)
