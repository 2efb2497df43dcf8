"""Steps on the road, against Lagrange's equations in ring axes, integrated by DOP853 with events."""

from __future__ import annotations

import math

import numpy as np
import pytest
from contact_reference import ContactStepper, phi
from scipy.integrate import solve_ivp
from test_modes import Drive, Lagrangian

from tire_dynamics import TireWheelUnit, ring, wheel
from tire_dynamics.science import contact
from tire_dynamics.science.contact_points import ContactPoints
from tire_dynamics.science.modes import CONTACT_ANGLE

TABLE_1 = TireWheelUnit.table_1()
CAR = TABLE_1.replace(
    contact_half_angle=0.15, vertical_stiffness=2e5, sidewall_damping="reaction", zeta_s=0.3, sprung_mass=350.0
)
LOAD = 4000.0
models = pytest.mark.parametrize("model", ["inextensional", "complete"])


class OnTheRoad:
    """The reference: ring axes, where the contact runs around, with lift-off and landing as events.

    Parameters
    ----------
    unit, model, n_max
        Of the tire, its wheel held fore and aft.
    drive : Drive
        Speed over time; its radial force is taken for the road's height beyond that at the start [m].
    """

    def __init__(self, unit, model, n_max, drive):
        self.unit, self.drive = unit, drive
        self.ring = Lagrangian(unit, range(0 if model == "complete" else 1, n_max + 1), model)
        self.k, self.c = wheel.residual_stiffness(unit, n_max, model), unit.residual_damping
        system = contact.open_system(unit, float(drive.speed[0]), model, n_max)
        state, self.height, self.weight = contact.standing(system, LOAD)
        self.start = self._in_ring_axes(state, float(drive.speed[0]), model, n_max)

    def _in_ring_axes(self, state, speed, model, n_max):
        """[q', q, b', b] at phi = 0, where the two frames' axes lie on one another."""
        one = wheel.states(self.unit, model)
        half = one // 2
        turned = wheel.rotation(0.0, speed, model) @ state[:one]
        kinds = ("alpha", "beta") if model == "inextensional" else ("alpha", "beta", "xi", "eta")
        values = {(1, kind): (turned[k], turned[half + k]) for k, kind in enumerate(kinds)}
        values["y"] = turned[len(kinds)], turned[half + len(kinds)]
        first = one + 2 * bool(self.unit.sprung_mass)
        if model == "complete":
            values[0, "alpha"], values[0, "xi"] = ((state[first + k], state[first + 2 + k]) for k in (0, 1))
            first += 4
        k = len(kinds) // 2
        for n in range(2, n_max + 1):
            for part, names in enumerate((("alpha", "xi"), ("beta", "eta"))):
                for i, name in enumerate(names[:k]):
                    place = first + 2 * k * part + i
                    values[n, name] = state[place], state[place + k]
            first += 4 * k
        if model == "complete":
            own = [values[label] for label in self.ring.place]
        else:
            own = [values[n, kind] for n in self.ring.numbers for kind in ("alpha", "beta")] + [values["y"]]
        return np.concatenate([np.array(own).T.reshape(-1), np.zeros(2 * bool(self.unit.sprung_mass))])

    def spring(self, t, state, begin):
        """k delta + c delta' [N], and delta's generalised direction."""
        turned, W, _, height, _ = self.drive.at(t, begin)
        own = self.ring.motions.shape[1]
        rate, position = self.ring.motions @ state[:own], self.ring.motions @ state[own : 2 * own]
        seen = self.ring.push(turned, 1.0, 0.0, CONTACT_ANGLE)
        delta = self.height + height + seen @ position
        if not self.c:
            return self.k * delta
        small = 1e-6
        turning = (
            self.ring.push(turned + small, 1.0, 0.0, CONTACT_ANGLE)
            - self.ring.push(turned - small, 1.0, 0.0, CONTACT_ANGLE)
        ) / (2.0 * small)
        rises = (self.drive.at(begin + 1e-4, begin)[3] - self.drive.at(begin, begin)[3]) / 1e-4
        return self.k * delta + self.c * (rises + seen @ rate + W * turning @ position)

    def slope(self, t, state, begin, touching):
        turned, W, W_dot, _, _ = self.drive.at(t, begin)
        own = self.ring.motions.shape[1]
        force = self.spring(t, state, begin) if touching else 0.0
        rates = self.ring.slope(state[: 2 * own], turned, W, W_dot, -force, 0.0, CONTACT_ANGLE, False)
        if not self.unit.sprung_mass:
            return rates
        b_rate, b = state[2 * own :]
        pull = self.unit.suspension_stiffness * b + self.ring.c_s * b_rate
        rates[own - 1] += pull / self.unit.wheel_mass
        axle = self.unit.suspension_stiffness * state[2 * own - 1] + self.ring.c_s * state[own - 1] - pull
        return np.concatenate([rates, [(axle - self.weight) / self.unit.sprung_mass, b_rate]])

    def run(self):
        """[axle x, axle z, contact force] at the drive's times, and how often contact was lost or found."""
        state, touching, events = self.start, True, 0
        own = self.ring.motions.shape[1]
        found = [[*self._seen(0.0, state, 0.0, touching)[:2], LOAD]]  # before the road begins to rise
        atol = np.repeat([1e-10, 1e-13], own)
        atol = np.concatenate([atol, [1e-10, 1e-13]]) if self.unit.sprung_mass else atol
        for begin, end in zip(self.drive.t[:-1], self.drive.t[1:], strict=True):
            t = begin
            if self.c:  # whose force jumps with the road's slope
                touching = self.spring(t, state, begin) > 0.0
            while t < end:

                def crossing(t, z, begin=begin):
                    return self.spring(t, z, begin)

                crossing.terminal, crossing.direction = True, -1.0 if touching else 1.0
                solution = solve_ivp(
                    lambda t, z, begin=begin, touching=touching: self.slope(t, z, begin, touching),
                    (t, end), state, method="DOP853", rtol=1e-10, atol=atol, events=crossing,
                )  # fmt: skip
                t, state = solution.t[-1], solution.y[:, -1]
                if solution.status == 1:
                    touching, events = not touching, events + 1
            found.append(self._seen(end, state, begin, touching))
        return np.array(found), events

    def _seen(self, t, state, begin, touching):
        turned, W, *_ = self.drive.at(t, begin)
        own = self.ring.motions.shape[1]
        force = self.ring.wheel(state[: 2 * own], turned, W)[:2]
        if self.unit.sprung_mass:
            force[1] -= self.unit.suspension_stiffness * state[-1] + self.ring.c_s * state[-2]
        return [*force, self.spring(t, state, begin) if touching else 0.0]


def stepped(unit, model, n_max, drive, parts, points=1):
    """The same of steps, each piece of the drive in equal parts."""
    stepper = ContactStepper(unit, LOAD, float(drive.speed[0]), model=model, n_max=n_max, points=points)
    found = [[*stepper.axle_force(), stepper.force.sum()]]
    for k in range(len(drive.t) - 1):
        length = (drive.t[k + 1] - drive.t[k]) / parts
        for i in range(parts):
            part = np.array([i, i + 0.5, i + 1.0]) / parts
            speeds = drive.speed[k] + part * (drive.speed[k + 1] - drive.speed[k])
            heights = drive.radial[k] + part * (drive.radial[k + 1] - drive.radial[k])
            stepper.turn(float(speeds[1]))
            stepper.step(length, float(heights[2]))
        stepper.turn(float(drive.speed[k + 1]))
        found.append([*stepper.axle_force(), stepper.force.sum()])
    return np.array(found)


def some_unit(random):
    """A tire on the road near a car's."""
    unit = TABLE_1.replace(
        contact_half_angle=random.choice([0.0, 0.15]),
        sidewall_damping=str(random.choice(["modal", "reaction"])),
        zeta_1=random.uniform(0.0, 0.2),
        zeta_n=random.uniform(0.0, 0.1),
        zeta_s=random.uniform(0.0, 0.5),
        suspension_stiffness=random.uniform(2e4, 1e5),
        sprung_mass=random.choice([0.0, 300.0]),
        residual_damping=random.choice([0.0, 0.0, 80.0]),
    )
    own = min(ring.static_stiffness(unit, 100), ring.static_stiffness(unit, 100, "complete"))
    return unit.replace(vertical_stiffness=random.uniform(0.3, 0.9) * own)


def some_drive(random, varying):
    """Heights every 4 ms, up to what throws the tire off the road, and a speed that may change and turn around."""
    count = 4
    heights = random.choice([0.002, 0.02]) * random.uniform(-1.0, 1.0, count + 1)
    heights[0] = 0.0
    speed = random.uniform(-150.0, 150.0, count + 1)
    return Drive(0.004 * np.arange(count + 1), speed if varying else speed[0], heights, 0.0)


def errors_fall_at_constant_speed(steps, model, seed, damped=4.0):
    """Third order where contact lasts, and through lift-off and landing; asserted: at least second.

    ``damped`` is by how much the error of the contact force falls where the tread has a damper.
    """
    random = np.random.default_rng(seed)
    unit, drive = some_unit(random), some_drive(random, False)
    n_max = 3 if model == "inextensional" else 2
    expected, _ = OnTheRoad(unit, model, n_max, drive).run()
    coarse, fine = (np.abs(steps(unit, model, n_max, drive, parts) - expected).max(axis=0) for parts in (8, 16))
    close_in(coarse, fine, [4.0, 4.0, damped if unit.residual_damping else 4.0], 1e-6 * np.abs(expected).max())
    assert fine.max() < 1e-3 * np.abs(expected).max()


def errors_fall_at_varying_speed(steps, model, seed, damped=12.0):
    """Second order, for a speed that is held over each step; it changes its sign in one of the drives."""
    random = np.random.default_rng(seed)
    unit, drive = some_unit(random), some_drive(random, True)
    expected, _ = OnTheRoad(unit, model, 2, drive).run()
    coarse, fine = (np.abs(steps(unit, model, 2, drive, parts) - expected).max(axis=0) for parts in (8, 32))
    size = np.abs(expected).max()  # sixteen, but for the next order
    close_in(coarse, fine, [12.0, 12.0, damped if unit.residual_damping else 12.0], 1e-5 * size)
    assert fine[:2].max() < 1e-3 * size and fine[2] < 1e-2 * size


def close_in(coarse, fine, factors, floor):
    """Errors of [x, z, contact force] fall by these factors, to where DOP853 leaves some 1e-7 of the forces.

    The force that acts to a step's end is, with a damper, that of a mean rate, and of lower order.
    """
    assert (fine <= np.maximum(coarse / np.array(factors), floor)).all(), (coarse, fine)


def errors_fall_through_lift_off(steps, model, parts):
    """A kerb's edge taken so fast that the tire leaves the road and comes back, twice at least; three step lengths."""
    drive = Drive(0.004 * np.arange(9), 80.0, [0.0, 0.02, 0.04, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0], 0.0)
    expected, events = OnTheRoad(CAR, model, 2, drive).run()
    assert events >= 2 and (expected[:, 2] == 0.0).any()
    errors = [np.abs(steps(CAR, model, 2, drive, each) - expected).max(axis=0) for each in parts]
    for before, after in zip(errors, errors[1:], strict=False):
        assert (after < before / 4.0).all(), errors
    assert errors[-1].max() < 0.2  # N, of contact forces up to 9 kN


@pytest.mark.slow
@models
@pytest.mark.parametrize("seed", range(4))
def test_steps_at_constant_speed(model, seed):
    errors_fall_at_constant_speed(stepped, model, seed, damped=2.0)


@pytest.mark.slow
@models
@pytest.mark.parametrize("seed", range(2))
def test_steps_at_varying_speed(model, seed):
    errors_fall_at_varying_speed(stepped, model, seed, damped=4.0)


@pytest.mark.slow
@models
def test_lift_off_and_landing(model):
    errors_fall_through_lift_off(stepped, model, (4, 8, 16))


# -- the bumps of docs/model.md, section 12 ---------------------------------------------------------------------------


def bump(height):
    """A half sine of 30 ms from t = 10 ms on, and its mean over an interval, exactly."""

    def at(t):
        return height * math.sin(math.pi * min(max(t - 0.01, 0.0), 0.03) / 0.03)

    def mean(a, b):
        low, high = (min(max(t - 0.01, 0.0), 0.03) for t in (a, b))
        return height * 0.03 / math.pi * (math.cos(math.pi * low / 0.03) - math.cos(math.pi * high / 0.03)) / (b - a)

    return at, mean


def over_the_bump(height, step):
    """[axle z, contact force] every millisecond to 120 ms, n_max 10, 60 rad/s, on a body that is held."""
    at, mean = bump(height)
    stepper = ContactStepper(CAR.replace(sprung_mass=0.0), LOAD, 60.0, n_max=10)
    every = round(1e-3 / step)
    found = [[stepper.axle_force()[1], stepper.force[0]]]
    for k in range(round(0.12 / step)):
        stepper.step(step, at((k + 1) * step), mean(k * step, (k + 1) * step))
        if (k + 1) % every == 0:
            found.append([stepper.axle_force()[1], stepper.force[0]])
    return np.array(found)


bumps = pytest.mark.parametrize(
    ("height", "force", "axle", "lost"),
    [(0.01, (5764.85, 1609.14), (4672.66, 3382.79), 0), (0.06, (12208.9, 0.0), (8035.97, 1426.48), 37)],
)


def meets_the_bump(found, height, force, axle, lost):
    """Of [axle z, contact force]: to the errors that docs/model.md gives its numbers at steps of 1 ms."""
    of_axle, of_force = (0.97, 20.0) if height < 0.05 else (16.0, 150.0)
    assert [found[:, 1].max(), found[:, 1].min()] == pytest.approx(force, abs=of_force)
    assert [found[:, 0].max(), found[:, 0].min()] == pytest.approx(axle, abs=of_axle)
    assert abs(int((found[:, 1] == 0.0).sum()) - lost) <= 1


@bumps
def test_bumps(height, force, axle, lost):
    meets_the_bump(over_the_bump(height, 5e-4), height, force, axle, lost)


@pytest.mark.parametrize(("height", "errors"), [(0.01, (0.97, 0.25)), (0.06, (16.0, 2.7))])
def test_bumps_are_far_closer_than_with_a_force_that_is_continuous(height, errors):
    """Its errors at 1 and 0.5 ms; against steps of 1/16 ms of the same scheme, whose own limit DOP853 has above."""
    fine = over_the_bump(height, 1.0 / 16e3)
    for step, most in zip((1e-3, 5e-4), errors, strict=True):
        assert np.abs(over_the_bump(height, step) - fine)[:, 0].max() < most / 8.0


# -- energy, rest, symmetry ---------------------------------------------------------------------------------------


def energy(stepper):
    """Of n = 1, the wheel on a body that is held, the belt's harmonics and the springs of the contact [J]."""
    unit, points = stepper.unit, stepper.points
    X_, Y_, y_, X, Y, y = (stepper.state[:6] + stepper.spin.rest_one[:6]).tolist()
    kinetic = unit.ring_mass * (X_**2 + Y_**2) + unit.wheel_mass * y_**2
    elastic = unit.sidewall_stiffness * (X**2 + (Y - y) ** 2) + unit.suspension_stiffness * y**2
    V, Z = np.moveaxis((stepper.spin.right @ (stepper.own + stepper.spin.rest)[..., None])[..., 0], -1, 0)
    A, _, C, determinant = ring.coefficients(unit, points.numbers)
    n, area = points.numbers, math.pi * unit.radius * unit.width * unit.surface_density
    mass, square = area * (A + n * C) / (n * C), n * determinant / (A + n * C)
    belt = (mass * (np.abs(V) ** 2 + square * np.abs(Z) ** 2)).sum()
    u = stepper._deflection() + stepper._road + stepper.static / points.stiffness
    return 0.5 * (kinetic + elastic + belt + (points.stiffness * np.maximum(u, 0.0) ** 2).sum())


@pytest.mark.parametrize("points", [1, 5])
@pytest.mark.parametrize("step", [5e-4, 2e-3, 1e-2])
def test_energy_never_grows(points, step):
    """No damping, n_max 30, whose highest is 1.6 kHz, thrown up by a rough road and left to hop on a flat one."""
    unit = CAR.replace(zeta_1=0.0, zeta_n=0.0, zeta_s=0.0, sprung_mass=0.0)
    stepper = ContactStepper(unit, LOAD, 0.0, n_max=30, points=points)
    heights = np.random.default_rng(0).normal(0.0, 0.02, (10, points))
    for height in heights:
        stepper.step(step, height)
    energies, lost = [energy(stepper)], 0
    for _ in range(150):
        stepper.step(step, heights[-1])
        energies.append(energy(stepper))
        lost += bool((stepper.force == 0.0).any())
    assert lost > 20
    assert np.diff(energies).max() <= 1e-13 * energies[0]  # rounding
    if points == 1 and step < 1e-3:  # and what the steps resolve is hardly touched
        assert energies[-1] > 0.95 * energies[0]


@models
@pytest.mark.parametrize("points", [1, 4])
@pytest.mark.parametrize("speed", [0.0, 60.0, -200.0])
def test_at_rest_and_on_a_flat_road_not_a_bit_moves(model, points, speed):
    for unit in (CAR, CAR.replace(sprung_mass=0.0, vertical_stiffness=0.0)):
        stepper = ContactStepper(unit, LOAD, speed, model=model, n_max=5, points=points)
        before = [array.tobytes() for array in (stepper.state, stepper.own, stepper.force, stepper.axle_force())]
        for _ in range(50):
            stepper.step(2e-3, 0.0)
        after = [array.tobytes() for array in (stepper.state, stepper.own, stepper.force, stepper.axle_force())]
        assert before == after
        assert stepper.force.sum() == pytest.approx(LOAD, rel=1e-15)
        assert stepper.axle_force()[1] == pytest.approx(LOAD, rel=1e-9)  # K = 1


def test_a_slow_rise_is_carried_by_all_springs():
    """Onto a road that is 10 mm higher, wheel held by a stiff suspension: K_v times that, for any number of points."""
    unit = CAR.replace(sprung_mass=0.0, suspension_stiffness=1e9, zeta_s=0.9, zeta_1=0.2, zeta_n=0.5)
    for points in (1, 2, 9):
        stepper = ContactStepper(unit, LOAD, 0.0, n_max=12, points=points)
        for k in range(400):
            stepper.step(1e-3, 0.01 * min(1.0, k / 100))
        assert stepper.force.sum() - LOAD == pytest.approx(0.01 * unit.vertical_stiffness, rel=1e-3)  # 1/k_s: 2e-4


@pytest.mark.parametrize("count", [1, 2, 3, 9])
def test_points_together_are_the_patch(count):
    """Even pressure on the parts adds up to the factors s_n, and the static load is carried by all."""
    points = ContactPoints(CAR, count, "inextensional", 20)
    one = ContactPoints(CAR, 1, "inextensional", 20)
    waves = np.exp(1j * np.outer(points.angles, points.numbers)) / points.cosines[:, None]
    assert points.share @ (points.spread * waves) == pytest.approx(one.spread, abs=1e-14)
    assert points.share.sum() == pytest.approx(1.0, rel=1e-15)
    assert points.share @ points.tangents == pytest.approx(0.0, abs=1e-16)
    springs = points.compliance(CAR, "inextensional") + np.diag(1.0 / points.stiffness)
    assert np.linalg.inv(springs).sum() == pytest.approx(CAR.vertical_stiffness, rel=1e-9)


def test_points_envelop_a_cleat_shorter_than_the_patch():
    """10 mm by 20 mm: one patch is lifted by it as a whole for as long as it is told, points feel it one by one."""
    peaks = {}
    for points in (1, 9):
        stepper = ContactStepper(CAR, LOAD, 10.0, n_max=20, points=points)
        place = -CAR.radius * np.sin(stepper.points.angles)  # ahead of the axle
        forces = []
        for k in range(120):
            travelled = 10.0 * CAR.radius * 5e-4 * (k + 1)
            under = travelled + place
            stepper.step(5e-4, np.where((under > 0.05) & (under < 0.07), 0.01, 0.0))
            forces.append([*stepper.axle_force(), stepper.force.sum()])
        peaks[points] = np.abs(np.array(forces) - [0.0, LOAD, LOAD]).max(axis=0)
    assert peaks[9][2] < 0.8 * peaks[1][2]
    assert peaks[9][0] > 5.0 * peaks[1][0]  # what stands in front of the axle pushes backward


def test_mirror():
    """Turned around, the same road gives the same forces, but for the sign of x."""
    for model in ("inextensional", "complete"):
        drive = Drive(0.004 * np.arange(6), 70.0, [0.0, 0.01, -0.01, 0.02, 0.0, 0.0], 0.0)
        back = Drive(drive.t, -70.0, drive.radial, 0.0)
        there, here = (stepped(CAR, model, 4, each, 2) for each in (drive, back))
        assert here == pytest.approx(there * [-1.0, 1.0, 1.0], abs=1e-8 * LOAD)


# -- what turns -----------------------------------------------------------------------------------------------------


ROTATING = {
    "radial_nonuniformity": [(1, 0.02, 0.3), (2, 0.03, 1.0), (3, 0.02, 0.5)],
    "tangential_nonuniformity": [(2, 0.02, 0.1)],
    "imbalance_mass": 0.05,
    "imbalance_angle": 0.4,
}


@models
@pytest.mark.parametrize("speed", [60.0, -150.0])
def test_a_varying_sidewall_and_imbalance(model, speed):
    """Every harmonic coupled with every other, the wheel and the contact, against DOP853 of the periodic system."""
    unit, n_max, stop = CAR.replace(sprung_mass=0.0, **ROTATING), 3, 0.03
    parts, system = contact.periodic_system(unit, speed, model, n_max)
    state, height, _ = contact.standing(system, LOAD)
    ring_mass = unit.ring_mass * (1.0 if model == "inextensional" else 0.5)
    size = unit.imbalance_mass * unit.radius * speed**2 / ring_mass

    def road(t):
        return 5e-3 * math.sin(60.0 * t) ** 2

    def slope(t, z):
        rates = parts.at(speed * t) @ z + system.push * (system.stiffness * (height + road(t)))
        rates[0] += size * math.cos(0.4 + speed * t)
        rates[1] += size * math.sin(0.4 + speed * t)
        return rates

    times = 2e-3 * np.arange(round(stop / 2e-3) + 1)
    motion = solve_ivp(slope, (0.0, stop), state, method="DOP853", rtol=1e-9, atol=1e-12, t_eval=times).y.T
    expected = motion @ system.output[1]
    nodes, weights = np.polynomial.legendre.leggauss(6)
    errors = []
    for every in (1, 2):
        h = 2e-3 / every
        stepper = ContactStepper(unit, LOAD, speed, model=model, n_max=n_max, coupled=n_max)
        found = [stepper.axle_force()[1]]
        for k in range(round(stop / h)):
            mean = 0.5 * weights @ [road(h * (k + 0.5 + 0.5 * x)) for x in nodes]
            stepper.step(h, road(h * (k + 1)), mean)
            if (k + 1) % every == 0:
                found.append(stepper.axle_force()[1])
        errors.append(np.abs(np.array(found) - expected).max())
    if model == "complete":  # third order
        assert errors[1] < errors[0] / 5.0
    # the inextensional steps leave the wind-up out, which the sidewall drives with the square of its amplitudes
    assert errors[1] < 2e-4 * np.ptp(expected)


# -- functions and arguments --------------------------------------------------------------------------------------


def test_phi_against_its_integral():
    """phi_k(x) = int_0^1 exp((1 - t) x) t^(k - 1)/(k - 1)! dt, by quadrature."""
    t, weights = np.polynomial.legendre.leggauss(60)
    t, weights = 0.5 + 0.5 * t, 0.5 * weights
    x = np.array([0.0, 1e-9, 0.1 + 0.3j, -0.7 + 0.7j, 1.2j, -3.0 + 5.0j, -0.1 - 20.0j, -12.0])
    exponential, *found = phi(x.astype(complex))
    assert exponential == pytest.approx(np.exp(x), rel=1e-14)
    for k, values in enumerate(found, 1):
        each = np.exp(np.outer(x, 1.0 - t)) * t ** (k - 1) / math.factorial(k - 1)
        assert values == pytest.approx(each @ weights, rel=1e-13)


def test_bad_arguments():
    for call, word in (
        (lambda: ContactStepper(CAR, 0.0, 10.0), "static_load is 0.0"),
        (lambda: ContactStepper(CAR, math.nan, 10.0), "static_load is nan"),
        (lambda: ContactStepper(CAR, LOAD, 10.0, points=0), "contact_points is 0"),
        (lambda: ContactStepper(TABLE_1, LOAD, 10.0, points=3), "contact_points is 3"),
    ):
        with pytest.raises(ValueError, match=word):
            call()
