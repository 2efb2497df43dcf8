"""`simulate` against direct integration of the ring-frame equations, written out here from docs/model.md, section 2."""

from __future__ import annotations

import math

import numpy as np
import pytest
import ring_frame
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from test_modes import Drive, Lagrangian, drives, units

from tire_dynamics import TireWheelUnit, ring, simulate, wheel
from tire_dynamics.science import rotating_excitation

MODAL, REACTION = "modal", "reaction"
both = pytest.mark.parametrize("damping", [MODAL, REACTION])


class Periodic:
    """(3.13) in the rotating axes, z = [alpha', beta', y', alpha, beta, y], with the wheel and any spin phi(t).

    From the energies for a spin that may change: r'' + 2 Omega J r' + Omega' J r - Omega^2 r = (f - S)/m and
    M y'' + c_s y' + k_s y = S . e, J = [[0, -1], [1, 0]], e = (sin phi, cos phi) the vertical in these axes and
    S the sidewall's force. Omega' is zero in the paper, where the spin is constant.
    """

    def __init__(self, unit, damping, phi, omega, acceleration):
        self.unit, self.damping = unit, damping
        self.phi, self.omega, self.acceleration = phi, omega, acceleration
        self.d = 2.0 * unit.zeta_1 * unit.rigid_mode_frequency

    def sidewall(self, t, z):
        """Forces on the wheel in the rotating axes: the one in its plane, and the one that is vertical."""
        velocity, position = z[:2], z[3:5]
        phi, W = self.phi(t), self.omega(t)
        e, e_dot = np.array([math.sin(phi), math.cos(phi)]), W * np.array([math.cos(phi), -math.sin(phi)])
        m, k = self.unit.ring_mass, self.unit.sidewall_stiffness
        spring = k * (position - z[5] * e)
        if self.damping == MODAL:  # the damping holds the ring and leaves the wheel alone
            return spring + m * self.d * velocity, spring
        S = spring + m * self.d * (velocity - z[2] * e - z[5] * e_dot)
        return S, S

    def slope(self, t, z, load, traction):
        unit, W = self.unit, self.omega(t)
        on_ring, on_wheel = self.sidewall(t, z)
        phi = self.phi(t)
        s, c = math.sin(phi), math.cos(phi)
        contact = 1.5 * math.pi - phi  # theta*
        f_r, f_t = -load, -traction
        f = np.array(
            [
                f_r * math.cos(contact) - f_t * math.sin(contact),
                f_r * math.sin(contact) + f_t * math.cos(contact),
            ]
        )
        (va, vb, vy), (a, b, y) = z[:3], z[3:]
        pull = (f - on_ring) / unit.ring_mass
        rate = self.acceleration(t)
        return np.array(
            [
                pull[0] + 2.0 * W * vb + rate * b + W * W * a,
                pull[1] - 2.0 * W * va - rate * a + W * W * b,
                (on_wheel[0] * s + on_wheel[1] * c - unit.suspension_damping * vy - unit.suspension_stiffness * y)
                / unit.wheel_mass,
                va,
                vb,
                vy,
            ]
        )

    def outputs(self, t, z):
        """x and z of the axle force, y, x and z of the ring's centre."""
        phi = self.phi(t)
        c, s = math.cos(phi), math.sin(phi)
        _, S = self.sidewall(t, z)
        return [
            -(S[0] * c - S[1] * s),
            self.unit.suspension_stiffness * z[5] + self.unit.suspension_damping * z[2],
            z[5],
            -(z[3] * c - z[4] * s),
            z[3] * s + z[4] * c,
        ]


def reference(unit, damping, t, load, traction, phi, omega, acceleration=lambda t: 0.0, z=None):
    """Outputs at the times t from rest (or z), by DOP853 from sample to sample, the inputs linear between them."""
    system = Periodic(unit, damping, phi, omega, acceleration)
    z = np.zeros(6) if z is None else z
    # a displacement of 1e-12 m is 1e-6 N in the sidewall: nothing beside forces of 1e3 N at 1e-9
    atol = np.array([1e-13] * 3 + [1e-16] * 3)
    outputs = [system.outputs(t[0], z)]
    for k in range(len(t) - 1):
        h = t[k + 1] - t[k]

        def slope(time, z, k=k, h=h):
            part = (time - t[k]) / h
            F = load[k] + part * (load[k + 1] - load[k])
            T = traction[k] + part * (traction[k + 1] - traction[k])
            return system.slope(time, z, F, T)

        z = solve_ivp(slope, (t[k], t[k + 1]), z, method="DOP853", rtol=1e-12, atol=atol).y[:, -1]
        outputs.append(system.outputs(t[k + 1], z))
    return np.array(outputs)


def found(response):
    return np.column_stack([response.axle_force, response.wheel_displacement, response.ring_centre])


def sizes(expected):
    """The largest force, wheel displacement and ring displacement; x and z are components of one vector."""
    size = np.abs(expected).max(axis=0)
    size[:2], size[3:] = size[:2].max(), size[3:].max()
    return size


def error(response, expected):
    """Worst error of force, wheel and ring centre, each beside the largest of its kind."""
    return float((np.abs(found(response) - expected) / sizes(expected)).max())


def inputs(count, seed=3):
    rng = np.random.default_rng(seed)
    return 4000.0 + rng.uniform(-1500.0, 1500.0, count), rng.uniform(-800.0, 800.0, count)


# -- constant speed: exact --------------------------------------------------------------------------------------

# rtol 1e-12 per internal step of DOP853 leaves some 1e-11 at the end; what is asked of the exact step is 1e-9
EXACT = 1e-9


@both
@pytest.mark.parametrize("speed", [0.0, 80.0, -80.0, 350.0])
@pytest.mark.parametrize("step", [0.1e-3, 1e-3, 5e-3, 20e-3])
def test_constant_speed(damping, speed, step):
    unit = TireWheelUnit.table_1(sidewall_damping=damping)
    t = step * np.arange(13)
    load, traction = inputs(t.size)
    expected = reference(unit, damping, t, load, traction, lambda t: speed * t, lambda t: speed)
    response = simulate(unit, t, speed, load, traction, initial="rest")
    assert error(response, expected) < EXACT


@both
def test_uneven_times(damping):
    """Steps from 0.1 ms to 30 ms in one series."""
    unit, speed = TireWheelUnit.table_1(sidewall_damping=damping), -140.0
    t = np.concatenate([[0.0], np.cumsum(np.random.default_rng(5).permutation(np.geomspace(1e-4, 30e-3, 14)))])
    load, traction = inputs(t.size)
    expected = reference(unit, damping, t, load, traction, lambda t: speed * t, lambda t: speed)
    assert error(simulate(unit, t, speed, load, traction, initial="rest"), expected) < EXACT


def test_a_step_may_be_as_long_as_it_likes():
    """A ramp of the load over a whole second in one step, or in a thousand."""
    unit = TireWheelUnit.table_1()
    t = np.linspace(0.0, 1.0, 1001)
    fine = simulate(unit, t, 120.0, 3000.0 + 2000.0 * t, 100.0 * t, initial="rest")
    coarse = simulate(unit, [0.0, 1.0], 120.0, [3000.0, 5000.0], [0.0, 100.0], initial="rest")
    # a thousand roundings of 1e-16 each; motion decays, so they do not grow
    assert np.abs(found(fine)[-1] - found(coarse)[-1]).max() <= 1e-11 * np.abs(found(fine)).max()


@settings(max_examples=20)
@given(
    speed=st.floats(-400.0, 400.0),
    damping=st.sampled_from([MODAL, REACTION]),
    cuts=st.lists(st.floats(0.01, 0.99), min_size=1, max_size=6, unique=True),
)
def test_more_samples_of_the_same_inputs_change_nothing(speed, damping, cuts):
    unit = TireWheelUnit.table_1(sidewall_damping=damping)
    t = np.array([0.0, *sorted(cuts), 1.0]) * 0.05
    load, traction = 4000.0 - 3e4 * t, 1e4 * t
    many = found(simulate(unit, t, speed, load, traction, initial="rest"))
    one = found(simulate(unit, t[[0, -1]], speed, load[[0, -1]], traction[[0, -1]], initial="rest"))
    scale = np.abs(many).max(axis=0) + 1e-300
    assert (np.abs(many[-1] - one[-1]) / scale).max() < 1e-10 or np.abs(many - 0.0).max() == 0.0


def test_a_start_elsewhere_is_forgotten():
    """The second half of a drive, started in its own steady state, comes to the motion that the whole drive has."""
    unit = TireWheelUnit.table_1()
    t = 1e-3 * np.arange(9001)
    load = 4000.0 + 500.0 * np.sin(40.0 * t)
    for speed in (90.0, 90.0 + 10.0 * np.sin(t)):
        whole = simulate(unit, t, speed, load)
        late = slice(4000, None)
        part = simulate(unit, t[late], speed if np.isscalar(speed) else speed[late], load[late])
        # the start is forgotten within 2 s: the slowest motion, the wheel on its suspension, decays by exp(-3 t)
        assert np.abs(found(whole)[8900:] - found(part)[4900:]).max() <= 1e-3 * np.abs(found(whole)).max()
        assert np.isfinite(found(whole)).all()


# -- a speed that changes: exact as well -------------------------------------------------------------------------


@both
@pytest.mark.parametrize(("start", "rate"), [(150.0, 400.0), (30.0, -400.0)], ids=["faster", "through zero"])
@pytest.mark.parametrize("finer", [1, 4, 16])
def test_speed_ramp(damping, start, rate, finer):
    """A speed that is linear over the step is exact, whatever the step, with its Euler term; no order of the step."""
    unit = TireWheelUnit.table_1(sidewall_damping=damping, zeta_1=0.2)
    end = 0.16
    t = np.linspace(0.0, end, 9)
    load, traction = 4000.0 + 1e4 * t, 2000.0 * t  # one straight line: cutting it finer changes nothing
    expected = reference(
        unit, damping, t, load, traction, lambda t: start * t + 0.5 * rate * t * t, lambda t: start + rate * t,
        lambda t: rate,
    )  # fmt: skip
    fine = np.linspace(0.0, end, 8 * finer + 1)
    response = simulate(unit, fine, start + rate * fine, 4000.0 + 1e4 * fine, 2000.0 * fine, initial="rest")
    assert (np.abs(found(response)[::finer] - expected).max(axis=0) / sizes(expected)).max() < EXACT


VARYING = {
    "radial_nonuniformity": [(1, 0.1, 0.3), (2, 0.3, 0.4)], "tangential_nonuniformity": [(2, 0.1, 1.7)],
    "imbalance_mass": 0.08, "imbalance_angle": 0.7,
    "radial_runout": [(1, 8e-4, 0.3), (3, 2e-4, -1.0)],
}  # fmt: skip
FORE_AFT = {"longitudinal_stiffness": 2.0e5, "longitudinal_damping_ratio": 0.1, "longitudinal_mass": 20.0}
TIRES = {"uniform": {}, "gives": FORE_AFT, "varying": VARYING, "varying, gives": {**VARYING, **FORE_AFT}}
RAMPS = {
    "faster": ([60.0, 75.0, 150.0], [0.02, 0.03]),
    "backward": ([-200.0, -260.0, -110.0], [0.01, 0.025]),
    "through zero": ([40.0, -25.0, 10.0], [0.03, 0.02]),
    "at once": ([300.0, -300.0, -300.0], [0.001, 0.02]),  # 6e5 rad/s^2
}


def axle_force_of(unit, model, speed, state, phi):
    """[x, z] of the axle in the fixed-frame state."""
    force = wheel.axle_force(unit.mean, speed, state, model)
    if unit.is_longitudinally_rigid and not unit.is_uniform:  # of the springs alone; the dashpots do not vary
        mean = unit.mean
        force[0] += ring_frame.pull_of_the_springs(unit, model, state, phi) - ring_frame.pull_of_the_springs(
            mean, model, state, phi
        )
    return force


@pytest.mark.slow
@pytest.mark.parametrize("model", ["inextensional", "complete"])
@both
@pytest.mark.parametrize("tire", TIRES)
@pytest.mark.parametrize("ramp", RAMPS)
def test_linear_speed_of_any_unit(model, damping, tire, ramp):
    """Force and state against DOP853 at rtol 1e-13 of the equations in the ring's frame, in steps of tens of ms.

    Thousands of its steps, each allowed 1e-13 of the state, lie between; asked for are 1e-9.
    """
    speed, lengths = RAMPS[ramp]
    unit = TireWheelUnit.table_1(sidewall_damping=damping, **TIRES[tire])
    t = np.concatenate([[0.0], np.cumsum(lengths)])
    load, traction, phi = np.array([3000.0, 5000.0, 2500.0]), np.array([0.0, 800.0, -400.0]), 1.1
    start = rotating_excitation.steady_state(unit, speed[0], load[0], traction[0], phi, model)
    states, angles = ring_frame.integrate(unit, model, t, speed, np.stack([load, traction], axis=1), start, phi)
    axle = [axle_force_of(unit, model, *row) for row in zip(speed, states, angles, strict=True)]
    response = simulate(unit, t, speed, load, traction, model=model, angle=phi)
    assert np.abs(response.axle_force - axle).max() < 1e-9 * np.abs(axle).max()
    centre = wheel.ring_centre(states, model) * [-1.0, 1.0]
    assert np.abs(response.ring_centre - centre).max() < 1e-9 * np.abs(centre).max()
    y = wheel.wheel_displacement(states, model)[0]
    assert np.abs(response.wheel_displacement - y).max() < 1e-9 * np.abs(y).max()


@pytest.mark.parametrize("model", ["inextensional", "complete"])
@pytest.mark.parametrize("tire", TIRES)
def test_steps_of_a_linear_speed_do_not_matter(model, tire):
    """The middle speed, held, would err with the square of the step: 6e-4 of the peak of x at 2 ms and 300 rad/s^2."""
    unit = TireWheelUnit.table_1(sidewall_damping="reaction", **TIRES[tire])
    ends = []
    for count in (1, 3, 100):
        t = np.linspace(0.0, 0.2, count + 1)
        response = simulate(unit, t, 50.0 - 300.0 * t, 3000.0 + 2e4 * t, 5e3 * t, model=model, angle=0.4)
        ends.append(np.concatenate([response.axle_force[-1], response.ring_centre[-1] * unit.sidewall_stiffness]))
    for end in ends[1:]:
        # rounding of a hundred steps, in forces 40 times as stiff as the suspension's
        assert np.abs(end - ends[0]).max() < 1e-10 * np.abs(end).max()


def test_speed_that_changes_its_sign_goes_on_smoothly():
    """Rolling to a stop and backward: no step is singular, and the mirrored drive gives mirrored forces."""
    unit = TireWheelUnit.table_1()
    t = np.linspace(0.0, 1.0, 501)
    there = simulate(unit, t, 100.0 - 200.0 * t, 4000.0, 300.0)
    back = simulate(unit, t, -100.0 + 200.0 * t, 4000.0, -300.0)
    assert np.isfinite(found(there)).all()
    mirror = np.array([-1.0, 1.0, 1.0, -1.0, 1.0])
    # exact symmetry of the equations; only the order of sums may differ
    assert np.abs(found(there) - mirror * found(back)).max() <= 1e-12 * np.abs(found(there)).max()


# -- initial state ----------------------------------------------------------------------------------------------


@both
def test_equilibrium_stays(damping):
    unit = TireWheelUnit.table_1(sidewall_damping=damping)
    for speed in (0.0, 200.0, -60.0):
        values = found(simulate(unit, np.linspace(0.0, 2.0, 41), speed, 5000.0, 700.0))
        # rounding of the equilibrium, 1e-16 of forces k_1/k_s = 40 times as stiff, and of 40 steps
        assert np.abs(values - values[0]).max(axis=0).max() <= 1e-12 * np.abs(values).max()


def test_rest_comes_to_equilibrium():
    unit = TireWheelUnit.table_1(zeta_s=0.3)
    for speed in (0.0, 150.0):
        settled = found(simulate(unit, np.linspace(0.0, 10.0, 1001), speed, 5000.0, initial="rest"))
        assert np.abs(settled[0]).max() == 0.0
        at_once = found(simulate(unit, [0.0], speed, 5000.0))[0]
        # slowest decay about exp(-0.3 * 50 * 10)
        assert np.abs(settled[-1] - at_once).max() <= 1e-10 * np.abs(at_once).max()


def test_equilibrium_of_a_standing_wheel_by_hand():
    """Weights on springs: F on k_s, F on k_1 above it; traction on k_1 alone, which holds the ring back."""
    unit = TireWheelUnit.table_1()
    response = simulate(unit, [0.0], 0.0, 5000.0, 700.0)
    y = 5000.0 / unit.suspension_stiffness
    expected = [700.0, 5000.0, y, 700.0 / unit.sidewall_stiffness, y + 5000.0 / unit.sidewall_stiffness]
    assert found(response)[0] == pytest.approx(expected, rel=1e-13)  # a handful of roundings


@both
def test_traction_reaches_the_axle(damping):
    """Driven forward, the tire pushes the axle forward; with a reaction, by the whole traction at any speed."""
    unit = TireWheelUnit.table_1(sidewall_damping=damping)
    for speed in (0.0, 100.0, -100.0):
        bare = simulate(unit, [0.0], speed, 5000.0).axle_force[0]
        pulled = simulate(unit, [0.0], speed, 5000.0, 700.0).axle_force[0]
        if damping == REACTION:
            assert bare == pytest.approx([0.0, 5000.0], abs=1e-8)  # rounding of 5 kN through k_1/k_s = 40
            assert pulled == pytest.approx([700.0, 5000.0], abs=1e-8)
        else:
            assert pulled[0] > bare[0]


def test_linear():
    """Twice the load and traction, twice the response; and the responses to both add up."""
    unit = TireWheelUnit.table_1()
    t = np.linspace(0.0, 0.3, 61)
    load, traction = inputs(t.size)
    speed = 100.0 + 300.0 * t
    both_at_once = found(simulate(unit, t, speed, load, traction))
    apart = found(simulate(unit, t, speed, load)) + found(simulate(unit, t, speed, 0.0, traction))
    assert np.abs(both_at_once - apart).max() <= 1e-12 * np.abs(both_at_once).max()


def test_time_may_start_anywhere():
    """Seconds since 1970 have 2.4e-7 s of resolution: that much jitter in the steps, and no more, is forgiven."""
    unit = TireWheelUnit.table_1()
    t = 1e-3 * np.arange(200)
    load = 4000.0 + 1000.0 * np.sin(30.0 * t)
    near, far = (found(simulate(unit, t + start, 100.0, load)) for start in (0.0, 1.7e9))
    # 2.4e-7 s at 500 rad/s is 1e-4 of the fastest motion, itself a fraction of the response
    assert np.abs(near - far).max() <= 1e-4 * np.abs(near).max()


# -- the whole unit, both models, against Lagrange's equations --------------------------------------------------

models = pytest.mark.parametrize("model", ["inextensional", "complete"])
PSI = np.linspace(0.0, 2.0 * math.pi, 9)  # and one of them twice


def whole(reference, drive):
    """What :func:`found` and the belt show, of the reference started from rest."""
    states = reference.run(drive)
    at = [drive.at(t)[:2] for t in drive.t]
    unit = [reference.wheel(state, phi, W) for state, (phi, W) in zip(states, at, strict=True)]
    belt = [reference.belt(state, phi, PSI) for state, (phi, _) in zip(states, at, strict=True)]
    return np.array(unit), np.array(belt)


def errors(unit, drive, model, n_max, expected, parts=1):
    """Worst errors of force, wheel and ring centre, and of the belt, each beside the largest of its kind."""
    fine = drive.finer(parts) if parts > 1 else drive
    response = simulate(
        unit, fine.t, fine.speed, -fine.radial, -fine.tangential, initial="rest", n_max=n_max, psi=PSI, model=model
    )
    values, belt = found(response)[::parts], np.stack([response.u_z, response.u_theta], axis=1)[::parts]
    return (
        float((np.abs(values - expected[0]) / sizes(expected[0])).max()),
        float(np.abs(belt - expected[1]).max() / np.abs(expected[1]).max()),
    )


def modes_up_to(n_max, model):
    return range(0 if model == "complete" else 1, n_max + 1)


@pytest.mark.slow
@models
@examples(4, nightly=20)
@given(unit=units(), drive=drives(varying=False))
def test_whole_unit_at_constant_speed(model, unit, drive):
    """Periodic 6- and 10-state systems and the belt on them under random loads and tractions: exact.

    DOP853 at rtol 1e-12 leaves some 1e-11; x of the axle is a difference of springs that the membrane couples.
    """
    expected = whole(Lagrangian(unit, modes_up_to(3, model), model), drive)
    assert max(errors(unit, drive, model, 3, expected)) < 1e-8


@pytest.mark.slow
@models
@examples(4, nightly=20)
@given(unit=units(), drive=drives(varying=True))
def test_whole_unit_at_varying_speed(model, unit, drive):
    """Exact too, Euler terms and all, in steps as long as the inputs' lines or shorter."""
    expected = whole(Lagrangian(unit, modes_up_to(2, model), model), drive)
    for parts in (1, 16):
        assert max(errors(unit, drive, model, 2, expected, parts)) < 1e-8


@pytest.mark.slow
@models
@both
def test_whole_unit_with_six_modes(model, damping):
    """Every mode that the random units above leave out, with a patch, under a load, a traction and a varying speed."""
    unit = TireWheelUnit.table_1(sidewall_damping=damping, contact_half_angle=0.2)
    for speed in (-150.0, [-60.0, -20.0, 30.0, 60.0]):
        drive = Drive([0.0, 0.003, 0.006, 0.01], speed, [-4e3, -3e3, -6e3, -5e3], [0.0, -500.0, 800.0, 0.0])
        expected = whole(Lagrangian(unit, modes_up_to(6, model), model), drive)
        assert max(errors(unit, drive, model, 6, expected)) < 1e-8


# -- the belt's shape -------------------------------------------------------------------------------------------


@models
@both
def test_belt_is_the_sum_over_its_modes(model, damping):
    """n = 1 relative to the wheel, and what more of n_max adds is that one harmonic."""
    unit = TireWheelUnit.table_1(sidewall_damping=damping)
    t = np.linspace(0.0, 0.05, 26)
    load, traction = inputs(t.size)
    psi = 2.0 * math.pi * np.arange(16) / 16
    response, shorter = (
        simulate(unit, t, 90.0 + 500.0 * t, load, traction, psi=psi, n_max=n_max, model=model) for n_max in (5, 4)
    )
    assert response.u_z.shape == response.u_theta.shape == (26, 16)
    scale = np.abs(response.u_z).max()
    u_z, u_theta = (np.fft.rfft(u, axis=1) / 8.0 for u in (response.u_z, response.u_theta))
    # conj of a - i b: u = Re[c exp(i n psi)], c = 2 rfft/16
    for beyond in (u_z[:, 6:], u_theta[:, 6:]):
        assert np.abs(beyond).max() <= 1e-14 * scale  # rounding of the transform
    for more, less in ((response.u_z, shorter.u_z), (response.u_theta, shorter.u_theta)):
        harmonics = np.abs(np.fft.rfft(more - less, axis=1))
        assert np.abs(np.delete(harmonics, 5, axis=1)).max() <= 1e-14 * harmonics[:, 5].max() * 16.0
    if model == "inextensional":
        assert np.abs(u_z[:, 0]).max() <= 1e-14 * scale  # it cannot breathe
        X = -response.ring_centre[:, 0]
        Y = response.ring_centre[:, 1] - response.wheel_displacement
        assert u_z[:, 1] == pytest.approx(X - 1j * Y, abs=1e-14 * scale)
        assert u_theta[:, 1] == pytest.approx(Y + 1j * X, abs=1e-14 * scale)
        for n in range(2, 6):  # u_z = -d u_theta/d psi
            assert u_z[:, n] == pytest.approx(-1j * n * u_theta[:, n], abs=1e-14 * scale)
    else:
        assert np.abs(u_z[:, 0]).max() > 1e-3 * scale
        # the ring's centre is half of what both components say of it
        X = 0.5 * (u_z[:, 1].real + u_theta[:, 1].imag)
        assert X == pytest.approx(-response.ring_centre[:, 0], abs=1e-14 * scale)


@models
@both
def test_belt_does_not_change_the_forces(model, damping):
    """Under a given load n = 1 alone reaches the wheel, however many modes are asked for, or none."""
    unit, t = TireWheelUnit.table_1(sidewall_damping=damping), np.linspace(0.0, 0.05, 26)
    load, traction = inputs(t.size)
    bare = simulate(unit, t, 90.0 + 500.0 * t, load, traction, model=model)
    for n_max in (2, 9):
        with_belt = simulate(unit, t, 90.0 + 500.0 * t, load, traction, psi=[0.0], n_max=n_max, model=model)
        assert np.array_equal(found(with_belt), found(bare))


@models
def test_belt_of_equilibrium_stays(model):
    unit = TireWheelUnit.table_1()
    for speed in (0.0, 150.0, -60.0):
        response = simulate(unit, np.linspace(0.0, 1.0, 21), speed, 5000.0, 700.0, psi=PSI, n_max=12, model=model)
        for u in (response.u_z, response.u_theta):
            # rounding of the steady state, and of 20 steps
            assert np.abs(u - u[0]).max() <= 1e-12 * np.abs(u).max()


def test_belt_under_traction():
    """Each harmonic of a standing belt under traction alone, from statics: K x = Q with all four coordinates."""
    unit = TireWheelUnit.table_1()
    psi = 2.0 * math.pi * np.arange(24) / 24
    with_it, without = (simulate(unit, [0.0], 0.0, 0.0, T, psi=psi, n_max=4) for T in (500.0, 0.0))
    assert not np.any(without.u_z)
    mass = math.pi * unit.radius * unit.width * unit.surface_density
    for n in (2, 3, 4):
        A, B, C, _ = (float(value) for value in ring.coefficients(unit, n))
        # u_z = beta sin n psi', u_theta = xi cos n psi', psi' from the contact; f_t = -T on xi alone:
        # B beta - A xi = 0 and -A beta + C xi = -T/mass, whose radial part the elimination keeps
        beta = -500.0 / mass * A / (B * C - A * A)
        found_beta = 2.0 * np.mean(with_it.u_z[0] * np.sin(n * (psi - 1.5 * math.pi)))
        assert found_beta == pytest.approx(beta, rel=1e-12)
        assert 2.0 * np.mean(with_it.u_z[0] * np.cos(n * (psi - 1.5 * math.pi))) == pytest.approx(0.0, abs=1e-18)


def test_no_belt_unless_asked():
    response = simulate(TireWheelUnit.table_1(), [0.0, 1.0], 0.0, 1.0)
    assert response.u_z is None and response.u_theta is None


def test_static_belt_of_the_complete_model():
    """Each harmonic of a standing belt from statics: K x = Q with all four coordinates, n = 0 with twice the mass."""
    unit = TireWheelUnit.table_1()
    psi = 2.0 * math.pi * np.arange(24) / 24
    response = simulate(unit, [0.0], 0.0, 1000.0, 500.0, psi=psi, n_max=4, model="complete")
    mass = math.pi * unit.radius * unit.width * unit.surface_density
    contact = psi - 1.5 * math.pi
    for n in (0, 2, 3, 4):
        A, B, C, _ = (float(value) for value in ring.coefficients(unit, n))
        share = mass * (2.0 if n == 0 else 1.0)
        # about the contact: u_z = alpha cos + beta sin, u_theta = xi cos + eta sin; f_r on alpha, f_t on xi
        alpha, eta = np.linalg.solve([[B, A], [A, C]], [-1000.0 / share, 0.0])
        beta, xi = np.linalg.solve([[B, -A], [-A, C]], [0.0, -500.0 / share])
        for u, cosine, sine in ((response.u_z[0], alpha, beta), (response.u_theta[0], xi, eta)):
            half = 1.0 if n == 0 else 2.0
            # eigenvectors of the modes; the determinant B C - A^2 cancels one digit or two
            assert half * np.mean(u * np.cos(n * contact)) == pytest.approx(cosine, rel=1e-12, abs=1e-18)
            if n:
                assert half * np.mean(u * np.sin(n * contact)) == pytest.approx(sine, rel=1e-12, abs=1e-18)


# -- arguments --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"time": [[0.0, 1.0]]}, "time"),
        ({"time": []}, "time"),
        ({"time": [0.0, math.nan]}, "time"),
        ({"time": [0.0, 0.0]}, "time must ascend; it does not after sample 0"),
        ({"time": [0.0, 2.0, 1.0]}, "time must ascend; it does not after sample 1"),
        ({"speed": [1.0, 2.0, 3.0]}, r"speed has shape \(3,\)"),
        ({"speed": math.inf}, "speed"),
        ({"load": [1.0]}, r"load has shape \(1,\)"),
        ({"load": math.nan}, "load"),
        ({"load": [[1.0, 2.0]]}, r"load has shape \(1, 2\)"),
        ({"traction": [0.0, math.nan]}, "traction"),
        ({"initial": "middle"}, "initial is 'middle'"),
        ({"model": "hybrid"}, "model is 'hybrid'"),
        ({"psi": 0.0}, "psi"),
        ({"psi": [math.nan]}, "psi"),
        ({"psi": [0.0], "n_max": 1}, "n_max is 1"),
        ({"psi": [0.0], "n_max": 2.5}, "n_max is 2.5"),
    ],
    ids=str,
)
def test_wrong_arguments(changes, words):
    arguments = {"time": [0.0, 1.0], "speed": 1.0, "load": 1.0} | changes
    with pytest.raises(ValueError, match=words):
        simulate(TireWheelUnit.table_1(), **arguments)


def test_arguments_are_not_changed():
    t, load = np.linspace(0.0, 1.0, 5), np.ones(5)
    response = simulate(TireWheelUnit.table_1(), t, 1.0, load)
    response.axle_force[:] = 0.0
    assert np.array_equal(t, np.linspace(0.0, 1.0, 5)) and np.array_equal(load, np.ones(5))
    assert np.array_equal(response.time, t)
