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
from numpy.typing import ArrayLike, NDArray

from . import wheel
from .coefficients import contact_patch_factor, residual_stiffness, static_compliance
from .contact import belt_numbers
from .modes import CONTACT_ANGLE, RingModes
from .stepping import ExactStepper
from .unit import TireWheelUnit

__all__ = ["ContactPoints", "ContactStepper", "phi"]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

MOST_PARTS: Final = 4  # of a step in which contact is lost and found
SHARP: Final = 1e-9  # of the step: how well the moment is located
EXACT: Final = 1e-12  # [m]: a gap or a compression that is none; a force of a millionth of a newton
MOST_TRIALS: Final = 30


class ContactPoints:
    """Where a tire touches the road: P points, each the middle of its share of the patch.

    Parameters
    ----------
    unit : TireWheelUnit
    count : int
        P >= 1. One is the whole patch, with the factors s_n.
    model : {"inextensional", "complete"}
    n_max : int

    Attributes
    ----------
    angles : ndarray, shape (P,)
        beta_j from the middle of the patch, along psi [rad].
    share : ndarray, shape (P,)
        Of the static load, even pressure: cos(beta_j) over their sum.
    stiffness : ndarray, shape (P,)
        Of the vertical springs, kappa cos^2 beta_j [N/m], kappa such that all of them, on a flat road, give the unit's
        ``vertical_stiffness``; infinite for a rigid tread.
    damping : ndarray, shape (P,)
        Shares of ``residual_damping`` [N s/m].
    factors : ndarray of complex, shape (P, N)
        s_n(phi_c/P) exp(i n beta_j)/cos(beta_j) of the belt harmonics.
    """

    def __init__(self, unit: TireWheelUnit, count: int, model: wheel.Model, n_max: int) -> None:
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < 1:
            raise ValueError(f"contact_points is {count!r}; it must be an integer >= 1")
        half = unit.contact_half_angle
        if count > 1 and half == 0.0:
            raise ValueError(f"contact_points is {count!r}; it must be 1 where contact_half_angle is 0.0")
        if half >= 0.5 * math.pi:
            raise ValueError(f"contact_half_angle is {half!r}; it must be < pi/2 on the road")
        self.angles = half * (2.0 * np.arange(count) + 1.0 - count) / count
        cosines = np.cos(self.angles)
        self.share = cosines / cosines.sum()
        self.numbers = belt_numbers(model, n_max)
        part = unit.replace(contact_half_angle=half / count, vertical_stiffness=0.0)
        self.factors = (
            contact_patch_factor(part, self.numbers) * np.exp(1j * np.outer(self.angles, self.numbers))
        ) / cosines[:, None]
        self.tangents = np.tan(self.angles)
        relative = cosines**2 / (cosines**2).sum()
        self.damping = unit.residual_damping * relative
        if count == 1:
            self.stiffness = np.array([residual_stiffness(unit, n_max, model)])
        else:
            compliance = self.compliance(unit, model, n_max)
            self.stiffness = relative * _calibrated(compliance, relative, unit.vertical_stiffness)

    def compliance(self, unit: TireWheelUnit, model: wheel.Model, n_max: int) -> FloatArray:
        """How far each point gives way under 1 N at each, wheel held, at rest, without the springs [m/N], (P, P)."""
        held = unit.replace(vertical_stiffness=0.0, longitudinal_stiffness=0.0, sprung_mass=0.0)
        modes = RingModes(held.replace(contact_half_angle=0.0), self.numbers, model)
        resting = modes.at(0.0)
        radial = modes.amplitudes(resting.steady(-1.0, 0.0))[0]  # of a point force at psi_0, 1 N inward
        about = radial * np.exp(-1j * self.numbers * CONTACT_ANGLE)
        belt = -np.real(self.factors * about @ np.conj(self.factors).T)
        point = held.replace(contact_half_angle=0.0)
        rigid = static_compliance(point, 1, model)
        if model == "complete":
            rigid -= static_compliance(point, 0, model)
        # n = 1 gives way alike in all directions, up and across
        matrix: FloatArray = belt + rigid * (1.0 + np.outer(self.tangents, self.tangents))
        return matrix


def _calibrated(compliance: FloatArray, relative: FloatArray, stiffness: float) -> float:
    """kappa for which springs kappa relative_j behind the compliance carry ``stiffness`` at one displacement of all."""
    if not stiffness:
        return math.inf
    ones = np.ones(len(relative))

    def whole(soft: float) -> float:
        return float(ones @ np.linalg.solve(compliance + np.diag(soft / relative), ones))

    if not whole(0.0) > stiffness:
        raise ValueError(
            f"vertical_stiffness is {stiffness!r}; it must be < {whole(0.0):.10g} N/m, the tire's own with these points"
        )
    low, high = 0.0, 1.0 / stiffness
    for _ in range(200):  # whole() falls with soft
        middle = 0.5 * (low + high)
        low, high = (middle, high) if whole(middle) > stiffness else (low, middle)
    return 1.0 / (0.5 * (low + high))


def phi(x: ComplexArray) -> tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]:
    """exp(x) and phi_k(x) = sum_j x^j/(j + k)!, k = 1, 2, 3, without cancellation: small ones from phi_3 up.

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
    """What is constant at one speed; N harmonics with k coordinates each, P points, n states of n = 1."""

    exponents: ComplexArray  # mu, (N, k)
    seen: ComplexArray  # u_j = Re sum seen w, (P, N, k)
    driven: ComplexArray  # w' = mu w + driven F, (P, N, k)
    pulled: ComplexArray  # by a traction of 1 N, (N, k)
    right: ComplexArray
    left: ComplexArray
    rest: ComplexArray  # own coordinates under the static load, (N, k)
    rest_one: FloatArray  # state of n = 1 under it, (n,)
    lift: FloatArray  # what the contact's displacements under the static load differ by from the first speed's, (P,)
    weight: float  # what the sprung mass is short of its weight by under the static load [N]


class _Table(NamedTuple):
    """What is constant at one speed and length of a step."""

    growth: ComplexArray  # exp(mu h), (N, k)
    end_seen: ComplexArray  # u_j at the end and in the mean, of w at the start, (P, N, k)
    mean_seen: ComplexArray
    from_a: ComplexArray  # w at the end of forces a and b, (P, N, k)
    from_b: ComplexArray
    pulled_a: ComplexArray  # and of a traction's, (N, k)
    pulled_b: ComplexArray
    one: FloatArray  # [Phi G_0 G_1] of n = 1, transposed, its last two states being the integrals
    end: FloatArray  # of delta at the end to [a, b], (P, 2 P); the same in the mean
    mean: FloatArray
    end_pulled: FloatArray  # and to a traction's, (P, 2)
    mean_pulled: FloatArray


class ContactStepper:
    """One wheel on the road, from step to step.

    Parameters
    ----------
    unit : TireWheelUnit
        Of one that is not uniform, the mean.
    static_load : float
        What the tire carries at the start, > 0 [N].
    speed : float
        At the start [rad/s]: the tire rolls steadily with it, on a flat road.
    model : {"inextensional", "complete"}
    n_max : int
    points : int
        Of the contact along the patch, P >= 1.

    Attributes
    ----------
    force : ndarray, shape (P,)
        Vertical contact forces now [N].
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
    ) -> None:
        if not (math.isfinite(static_load) and static_load > 0.0):
            raise ValueError(f"static_load is {static_load!r}; it must be > 0 and finite")
        self.unit, self.model = unit.mean, model
        self.points = ContactPoints(unit, points, model, n_max)
        self.static = static_load * self.points.share
        self._modes = RingModes(self.unit.replace(contact_half_angle=0.0), self.points.numbers, model)
        self._frame = wheel.fixed_frame(self.unit, model)
        self._one = self._stepper()
        self._spins: dict[float, _Spin] = {}
        self._tables: dict[tuple[float, float], _Table] = {}
        self._first: tuple[FloatArray, float] | None = None
        self.speed = float(speed)
        self.spin = self._at(self.speed)
        self.own = np.zeros_like(self.spin.exponents)
        self.state = np.zeros(self._one.states)  # of n = 1, [b', b] and the integrals of X and -Y
        self.force = self.static.copy()
        self.touching = np.ones(points, dtype=np.bool_)
        self._before = np.zeros(points)  # delta beyond the static one [m]
        self._road = np.zeros(points)

    # -- tables ---------------------------------------------------------------------------------------------------

    def _stepper(self) -> ExactStepper:
        """n = 1, the wheel, the sprung mass and the integrals of X and -Y; inputs: F, its part along X, F_x, weight."""
        frame, unit = self._frame, self.unit
        n, half = len(frame.constant), len(frame.constant) // 2
        body, total = n, n + 2 * bool(unit.sprung_mass) + 2
        constant, spin = np.zeros((2, total, total))
        inputs = np.zeros((total, 4))
        constant[:n, :n], spin[:n, :n] = frame.constant, frame.spin
        inputs[:n, [0, 2]] = frame.input
        inputs[0, 1] = frame.input[1, 0]
        y = half + (2 if self.model == "inextensional" else 4)
        stiffest = math.sqrt(float(np.abs(frame.constant[:half, half:]).max()))
        scale = np.concatenate([np.repeat([1.0, 1.0 / stiffest], half), np.ones(total - n)])
        if unit.sprung_mass:
            k_s, c_s, M, m_b = unit.suspension_stiffness, unit.suspension_damping, unit.wheel_mass, unit.sprung_mass
            constant[y - half, [body, body + 1]] = c_s / M, k_s / M
            constant[body, [y - half, y, body, body + 1]] = c_s / m_b, k_s / m_b, -c_s / m_b, -k_s / m_b
            constant[body + 1, body] = 1.0
            inputs[body, 3] = 1.0 / m_b
            scale[[body, body + 1]] = 1.0, 1.0 / stiffest
        constant[total - 2, half], constant[total - 1, half + 1] = 1.0, -1.0
        scale[-2:] = stiffest**-2
        return ExactStepper([constant, spin], inputs, scale)

    def _at(self, speed: float) -> _Spin:
        if speed not in self._spins:
            modes, points = self._modes, self.points
            spinning = modes.at(speed)
            shapes = spinning.steady_shapes()
            own = -shapes * spinning.exponents[..., None]
            row = 2 if self.model == "complete" else 1
            turned = np.array([1.0, -1.0j, -1.0, 1.0j])[np.mod(points.numbers, 4.0).astype(int)]
            seen = np.conj(turned * points.factors)[..., None] * spinning.right[:, row, :]
            driven = -points.factors[..., None] * own[..., 0]
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
            pulled = -own[..., 1]
            self._spins[speed] = _Spin(
                spinning.exponents, seen, driven, pulled, spinning.right, spinning.left, rest, one,
                lift - self._first[0], carried - self._first[1],
            )  # fmt: skip
        return self._spins[speed]

    def _across(self, speed: float) -> FloatArray:
        """The state of n = 1 under 1 N of radial force along -X."""
        F = self._frame.constant + speed * self._frame.spin
        half = len(F) // 2
        state = np.zeros(len(F))
        state[half:] = np.linalg.solve(-F[:half, half:], np.eye(half)[0] * self._frame.input[1, 0])
        return -state

    def _contact_of(self, state: FloatArray) -> FloatArray:
        """What n = 1 adds to the displacements of the points."""
        half = len(self._frame.constant) // 2
        return np.asarray(state[half] * self.points.tangents - state[half + 1])

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
        start, change = one[n : n + 4], one[n + 4 :]
        end, mean = np.empty((2, len(self.static), 2, len(self.static)))
        end_pulled, mean_pulled = np.empty((2, len(self.static), 2))
        belts = ((into_a, mean_a), (into_b, mean_b))
        for k, forced in enumerate((start - change, change)):
            for j, tangent in enumerate(self.points.tangents):
                state = forced[0] - tangent * forced[1]
                end[:, k, j] = self._contact_of(state) + _seen(spin.seen, belts[k][0] * spin.driven[j])
                mean[:, k, j] = self._mean_of(state, h) + _seen(spin.seen, belts[k][1] * spin.driven[j])
            end_pulled[:, k] = self._contact_of(forced[2]) + _seen(spin.seen, belts[k][0] * spin.pulled)
            mean_pulled[:, k] = self._mean_of(forced[2], h) + _seen(spin.seen, belts[k][1] * spin.pulled)
        P = len(self.static)
        return _Table(
            growth, spin.seen * growth, spin.seen * first, into_a * spin.driven, into_b * spin.driven,
            into_a * spin.pulled, into_b * spin.pulled, one, end.reshape(P, 2 * P), mean.reshape(P, 2 * P),
            end_pulled, mean_pulled,
        )  # fmt: skip

    def _mean_of(self, state: FloatArray, length: float) -> FloatArray:
        return np.asarray((state[-2] * self.points.tangents + state[-1]) / length)

    # -- steps ----------------------------------------------------------------------------------------------------

    def turn(self, speed: float) -> None:
        """Go on at another speed: the belt's velocities jump by the Euler terms' integral."""
        if speed == self.speed:
            return
        old, before, self.speed = self.spin, self.speed, float(speed)
        self.spin = new = self._at(self.speed)
        whole = (old.right @ (self.own + old.rest)[..., None])[..., 0]
        jumped = self._modes.change_speed(whole, before, self.speed)
        if self.model == "complete":  # the spin itself is no deflection: n = 0 is pushed by its change
            pass
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
        if len(self.force) == 1 and math.isfinite(self.points.stiffness[0]):
            self._parts(length, end, mean, traction)
        else:
            self._advance(length, self._forces(length, end, mean, traction), end, traction)

    def _free(
        self, table: _Table, end: FloatArray, mean: FloatArray, traction: tuple[float, float], length: float
    ) -> tuple[FloatArray, FloatArray]:
        """delta at the end and in the mean beyond the static one, were the forces the static ones."""
        state = self._driven(table, np.zeros((2, len(self.force))), traction)
        pull = np.array(traction)
        belt = (_seen(table.end_seen, self.own), _seen(table.mean_seen, self.own))
        at_end = self._contact_of(state) + belt[0] + self.spin.lift + end
        in_mean = self._mean_of(state, length) + belt[1] + self.spin.lift + mean
        # n = 1 has its share of the traction in its state
        at_end += _seen(self.spin.seen, table.pulled_a * pull[0] + table.pulled_b * pull[1])
        in_mean += table.mean_pulled @ pull - self._mean_of(self._pulled(table, traction), length)
        return at_end, in_mean

    def _pulled(self, table: _Table, traction: tuple[float, float]) -> FloatArray:
        n = self._one.states
        return np.asarray(table.one[n + 2] * traction[0] + table.one[n + 6] * (traction[1] - traction[0]))

    def _driven(self, table: _Table, forces: FloatArray, traction: tuple[float, float]) -> FloatArray:
        """n = 1 at the end, of forces [a, b] beyond the static ones, (2, P)."""
        a, b = forces.sum(axis=1)
        across = -forces @ self.points.tangents
        inputs = np.array([a, across[0], traction[0], self.spin.weight])
        changes = np.array([b - a, across[1] - across[0], traction[1] - traction[0], 0.0])
        return np.asarray(np.concatenate([self.state, inputs, changes]) @ table.one)

    def _forces(self, length: float, end: FloatArray, mean: FloatArray, traction: tuple[float, float]) -> FloatArray:
        """[a, b] beyond the static forces, shape (2, P): the complementarity problem of the module's notes."""
        table = self._table(length)
        at_end, in_mean = self._free(table, end, mean, traction, length)
        P = len(self.force)
        soft = np.diag(1.0 / self.points.stiffness)
        with np.errstate(invalid="ignore"):
            damp = np.where(soft.any(axis=1), self.points.damping / length, 0.0) @ soft if P else 0.0
        zero = np.zeros((P, P))
        ends = np.concatenate([zero, soft], axis=1) - table.end
        means = np.concatenate([0.5 * soft, 0.5 * soft], axis=1) - table.mean
        if np.any(damp):
            c = np.asarray(damp)[:, None]
            ends = ends - c * (4.0 * table.end - 6.0 * table.mean)
            means = means - c * table.end
            at_end, in_mean = (
                at_end + c[:, 0] * (4.0 * at_end - 6.0 * in_mean + 2.0 * self._before),
                in_mean + c[:, 0] * (at_end - self._before),
            )
        matrix = np.concatenate([means, ends])
        right = np.concatenate([in_mean, at_end])
        return _complementary(matrix, right, -np.concatenate([self.static] * 2)).reshape(2, P)

    def _advance(self, length: float, forces: FloatArray, end: FloatArray, traction: tuple[float, float]) -> None:
        table = self._table(length)
        state = self._driven(table, forces, traction)
        state[-2:] = 0.0
        self.own = (
            table.growth * self.own
            + np.tensordot(forces[0], table.from_a, axes=1)
            + np.tensordot(forces[1], table.from_b, axes=1)
            + table.pulled_a * traction[0]
            + table.pulled_b * traction[1]
        )
        self.state = state
        self.force = self.static + forces[1]
        self._road = np.array(end)
        self._before = self._deflection() + self._road
        self.touching = self.force > 0.0

    def _parts(self, length: float, end: FloatArray, mean: FloatArray, traction: tuple[float, float]) -> None:
        """A step of one patch, cut where contact is lost or found.

        The road is the parabola with the step's ends and mean. In contact b of a part that ends at t tells whether the
        contact lasts until t; without contact delta(t) tells whether it has begun. Their roots are enclosed.
        """
        done, bare = 0.0, -self.static
        first, pull = self._road.copy(), traction
        curve = 6.0 * (mean - 0.5 * (first + end))  # r = first + (end - first) t + curve t (1 - t)

        def height(t: float) -> FloatArray:
            return np.asarray(first + (end - first) * t + curve * t * (1.0 - t))

        def between(t_0: float, t_1: float) -> FloatArray:
            d = t_1 - t_0
            return np.asarray(0.5 * (height(t_0) + height(t_1)) + curve * d * d / 6.0)

        def traction_at(t: float) -> float:
            return pull[0] + (pull[1] - pull[0]) * t

        touching = bool(self.touching[0])
        for part in range(MOST_PARTS):

            def trial(t: float, touching: bool = touching, done: float = done) -> tuple[FloatArray, float]:
                """Forces of a part from ``done`` to t; how far beyond the loss or the find of contact its end is."""
                h, pulls = (t - done) * length, (traction_at(done), traction_at(t))
                if touching:
                    forces = self._forces(h, height(t), between(done, t), pulls)
                    free, _ = self._free(self._table(h), height(t), between(done, t), pulls, h)
                    delta = free + self._table(h).end @ forces.reshape(-1)
                    return forces, float(-(delta + self.static / self.points.stiffness)[0])
                forces = np.stack([bare, bare])
                free, _ = self._free(self._table(h), height(t), between(done, t), pulls, h)
                return forces, float(
                    (free + self._table(h).end @ forces.reshape(-1) + self.static / self.points.stiffness)[0]
                )

            t = 1.0
            forces, beyond = trial(t)
            cut = beyond > 0.0 and part < MOST_PARTS - 1
            if cut:
                t, forces = _enclosed(trial, done, self._gap(touching), beyond)
            elif beyond > 0.0:
                forces = self._forces((1.0 - done) * length, end, between(done, 1.0), (traction_at(done), pull[1]))
            if t > done:
                self._advance((t - done) * length, forces, height(t), (traction_at(done), traction_at(t)))
            if not cut:
                self.touching[:] = self.force > 0.0
                return
            touching, done = not touching, t
            self.force[:] = 0.0

    def _gap(self, touching: bool) -> float:
        """How far before the loss or the find of contact the start is, <= 0 [m]."""
        delta = float((self._before + self.static / self.points.stiffness)[0])
        return min(0.0, -delta if touching else delta)

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
