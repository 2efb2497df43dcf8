"""The ring's modes in motion, against Lagrange's equations of the ring's energies, integrated by DOP853."""

from __future__ import annotations

import math

import numpy as np
import pytest
from examples import examples
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from tire_dynamics import TireWheelUnit
from tire_dynamics.science.modes import CONTACT_ANGLE, RingModes
from tire_dynamics.science.stepping import Steps

TABLE_1 = TireWheelUnit.table_1()
MODELS = ("inextensional", "complete")
both = pytest.mark.parametrize("model", MODELS)


# -- the reference ----------------------------------------------------------------------------------------------


class Lagrangian:
    """The ring and the wheel in ring-fixed coordinates, from the energies of docs/model.md, section 2.

    Coordinates are alpha, beta, xi, eta of each wavenumber (alpha, xi of n = 0) and last y. Every energy is quadratic
    in the displacements, so each is integrated around the ring on evenly spaced points, exactly; Lagrange's equations
    are then read off for a spin that varies. With P q = (u_z, u_theta), N q = (-u_theta, u_z) and e = (0, 1):

        kinetic  rho h/2 int |P q' + Omega N q + a Omega e|^2 gives
                 P'P q'' + Omega (P'N - N'P) q' + Omega' (P'N q + a P'e) - Omega^2 N'N q, and - a Omega^2 N'e, which the
                 hoop stress carries
        strain   K of (u_theta' + u_z)/a, D of (u_theta' - u_z'')/a^2, sigma_0 h of (u_z' - u_theta)/a and
                 (u_theta' + u_z)/a, k_z and k_theta of E q = (u_z - y sin(theta + phi), u_theta - y cos(theta + phi))

    A model is a choice of motions and of the equations kept for them. The complete one keeps all. In the inextensional
    one u_z = -u_theta'; n = 1 keeps the equations of that constraint, n >= 2 keeps C times the radial minus A times the
    tangential one, (3.8)-(3.10).
    """

    def __init__(self, unit, numbers, model="complete"):
        self.unit, self.model, self.numbers = unit, model, list(numbers)
        labels = [(n, kind) for n in numbers for kind in ("alpha", "beta", "xi", "eta")]
        labels = [(n, kind) for n, kind in labels if n > 0 or kind in ("alpha", "xi")]
        self.place = {label: i for i, label in enumerate([*labels, "y"])}
        a, b, rho_h = unit.radius, unit.width, unit.density * unit.thickness
        points = 2 * max(numbers) + 8
        theta = 2.0 * math.pi * np.arange(points) / points
        area = 2.0 * math.pi * a * b / points  # of a point

        def form(left, right=None):
            return area * left.T @ (left if right is None else right)

        (u_z, u_theta), (z_1, t_1), (z_2, _) = (self.shapes(theta, derivative) for derivative in range(3))
        P, N = np.vstack([u_z, u_theta]), np.vstack([-u_theta, u_z])
        self.M, self.PN, self.NN = rho_h * form(P), rho_h * form(P, N), rho_h * form(N)
        self.Pe = rho_h * area * u_theta.sum(axis=0)
        self.M[-1, -1] = unit.wheel_mass
        hoop = form(z_1 - u_theta) + form(t_1 + u_z)  # times sigma_0 h/a^2 = rho h Omega^2 + p_0/a
        strain = unit.membrane_stiffness / a**2 * form(t_1 + u_z) + unit.bending_stiffness / a**4 * form(t_1 - z_2)
        self.K, self.K_spin = strain + unit.inflation_pressure / a * hoop, rho_h * hoop
        self.K[-1, -1] += unit.suspension_stiffness
        mass = unit.wheel_mass + 2.0 * math.pi * a * b * rho_h
        self.c_s = 2.0 * unit.zeta_s * math.sqrt(unit.suspension_stiffness * mass)
        # E = E_0 + sin(phi) E_s + cos(phi) E_c; a held wheel moved along X adds (-cos psi, sin psi) x to E q
        cos, sin = np.concatenate([np.cos(theta), -np.sin(theta)]), np.concatenate([np.sin(theta), np.cos(theta)])
        self.E = np.zeros((3, 2 * points, len(self.place)))
        self.E[0] = P
        self.E[1, :, -1], self.E[2, :, -1] = -cos, -sin
        self.along_X = np.array([0.0 * cos, sin, -cos])  # by the same three factors
        self.along_Y = np.array([0.0 * cos, -cos, -sin])
        springs = area * np.repeat([unit.radial_stiffness, unit.tangential_stiffness], points)
        self.springs = self._forms(self.E, springs)
        self.springs_X = np.einsum("ip,p,jpk->ijk", self.along_X, springs, self.E)
        # modal damping of every mode, but what the dashpots between belt and wheel do for n = 1
        self.damping = np.zeros_like(self.M)
        self.dashpots, self.dashpots_X = np.zeros_like(self.springs), np.zeros_like(self.springs_X)
        self.motions = self._motions()
        for n in numbers:
            rows = self._rows(n)
            d = 2.0 * (unit.zeta_1 if n == 1 else unit.zeta_n) * self._frequency_at_rest(n)
            if n == 1 and unit.sidewall_damping == "reaction":
                E = self.E.copy()
                E[:, :, [i for i in self.place.values() if i not in (*rows, len(self.place) - 1)]] = 0.0
                each = np.full(2 * points, area * rho_h * d)
                self.dashpots, self.dashpots_X = self._forms(E, each), np.einsum("ip,p,jpk->ijk", self.along_X, each, E)
            else:
                self.damping[rows] = d * self.M[rows]
        self.damping[-1, -1] = self.c_s

    @staticmethod
    def _forms(E, weights):
        return np.einsum("ipk,p,jpl->ijkl", E, weights, E)

    def _rows(self, n):
        return [i for label, i in self.place.items() if label[0] == n]

    def shapes(self, theta, derivative=0):
        """u_z and u_theta at some angles for each coordinate, or their derivatives with respect to theta."""
        u_z, u_theta = np.zeros((2, len(theta), len(self.place)))
        for (n, kind), i in list(self.place.items())[:-1]:
            phase = n * theta + 0.5 * math.pi * (derivative - (kind in ("beta", "eta")))
            (u_z if kind in ("alpha", "beta") else u_theta)[:, i] = float(n) ** derivative * np.cos(phase)
        return u_z, u_theta

    def _motions(self):
        """Columns: the model's own coordinates, alpha and beta of each n and y, in those of the complete model."""
        if self.model == "complete":
            return np.eye(len(self.place))
        motions = np.zeros((len(self.place), 2 * len(self.numbers) + 1))
        motions[-1, -1] = 1.0
        for i, n in enumerate(self.numbers):
            motions[[self.place[n, "alpha"], self.place[n, "eta"]], 2 * i] = 1.0, -1.0 / n
            motions[[self.place[n, "beta"], self.place[n, "xi"]], 2 * i + 1] = 1.0, 1.0 / n
        return motions

    def _kept(self, K):
        """Rows: the sums of the complete model's equations that are kept, K being its stiffness at the present spin."""
        kept = self.motions.T.copy()
        if self.model == "inextensional":
            for i, n in enumerate(self.numbers):
                if n > 1:
                    alpha, beta, xi, eta = (self.place[n, kind] for kind in ("alpha", "beta", "xi", "eta"))
                    ratio = K[alpha, eta] / K[eta, eta]  # A/C; the equation of beta has -A
                    kept[2 * i, eta], kept[2 * i + 1, xi] = -ratio, ratio
        return kept

    def _frequency_at_rest(self, n):
        """Of mode n with the wheel held; of the complete model's two, the lower."""
        rows = self._rows(n)
        K = self.K + self.springs[0, 0]
        kept, motions = self._kept(K)[:, rows], self.motions[rows]
        mine = motions.any(axis=0)
        K, M = (kept[mine] @ S[np.ix_(rows, rows)] @ motions[:, mine] for S in (K, self.M))
        return math.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.min())

    def push(self, phi, radial, tangential, angle):
        """Generalised forces of a force at an angle fixed in space, spread evenly over the unit's patch."""
        half = self.unit.contact_half_angle
        if half == 0.0:
            nodes, weights = np.zeros(1), np.array([2.0])
        else:
            nodes, weights = np.polynomial.legendre.leggauss(24)  # exact to rounding for n phi_c up to 15
            weights = weights * half / math.sin(half)  # the resultant of the pressure is the load
        u_z, u_theta = self.shapes(angle - phi + half * nodes)
        return 0.5 * weights @ (radial * u_z + tangential * u_theta)

    def slope(self, state, phi, W, W_dot, radial, tangential, angle, held):
        """Rate of [q', q] in the model's own coordinates."""
        half = state.size // 2
        rate, position = self.motions @ state[:half], self.motions @ state[half:]
        s, c = math.sin(phi), math.cos(phi)
        turn, turning = np.array([1.0, s, c]), W * np.array([0.0, c, -s])
        K = self.K + W * W * (self.K_spin - self.NN) + np.einsum("i,j,ijkl", turn, turn, self.springs)
        damping = self.damping + np.einsum("i,j,ijkl", turn, turn, self.dashpots) + W * (self.PN - self.PN.T)
        circulating = np.einsum("i,j,ijkl", turn, turning, self.dashpots)
        force = self.push(phi, radial, tangential, angle) - W_dot * self.unit.radius * self.Pe
        force -= damping @ rate + (K + circulating + W_dot * self.PN) @ position
        kept = self._kept(K)
        acceleration = np.linalg.solve(kept @ self.M @ self.motions, kept @ force)
        if held:
            acceleration[-1] = 0.0
        return np.concatenate([acceleration, state[:half]])

    def run(self, drive, angle=CONTACT_ANGLE, held=False):
        """States [q', q] at the drive's times, from rest; ``held`` keeps the wheel where it is."""
        own = self.motions.shape[1]
        # 1 kN moves the ring by some millimetres and metres per second; a part in 1e13 of that is nothing
        atol = np.repeat([1e-13, 1e-16], own)
        states = [np.zeros(2 * own)]
        for begin, end in zip(drive.t[:-1], drive.t[1:], strict=True):

            def rate(t, z, begin=begin):
                return self.slope(z, *drive.at(t, begin), angle, held)

            states.append(solve_ivp(rate, (begin, end), states[-1], method="DOP853", rtol=1e-12, atol=atol).y[:, -1])
        return np.array(states)

    def amplitudes(self, state, phi):
        """Z_1 and Z_2 = (alpha + i beta) exp(i n phi), (xi + i eta) exp(i n phi) of each mode."""
        position = self.motions @ state[state.size // 2 :]
        alpha, beta, xi, eta = (
            np.array([position[self.place[n, kind]] if (n, kind) in self.place else 0.0 for n in self.numbers])
            for kind in ("alpha", "beta", "xi", "eta")
        )
        turn = np.exp(1j * np.array(self.numbers) * phi)
        return (alpha + 1j * beta) * turn, (xi + 1j * eta) * turn

    def wheel(self, state, phi, W):
        """Axle force x, z (REP 103) [N], wheel displacement y, ring's centre x, z [m]."""
        half = state.size // 2
        rate, position = self.motions @ state[:half], self.motions @ state[half:]
        s, c = math.sin(phi), math.cos(phi)
        turn, turning = np.array([1.0, s, c]), W * np.array([0.0, c, -s])
        # the work of the sidewall's force on a held wheel: -x (X' k E q), and the same for the dashpots' rates
        force_X = -np.einsum("i,j,ijk,k", turn, turn, self.springs_X, position)
        force_X -= np.einsum("i,j,ijk,k", turn, turn, self.dashpots_X, rate)
        force_X -= np.einsum("i,j,ijk,k", turn, turning, self.dashpots_X, position)
        vertical = self.unit.suspension_stiffness * position[-1] + self.c_s * rate[-1]
        belt = self.E[0] @ position
        mean = -2.0 / belt.size  # (u_z cos psi - u_theta sin psi, u_z sin psi + u_theta cos psi) is -(X, Y) of E
        centre_X, centre_Y = (mean * (turn @ along) @ belt for along in (self.along_X, self.along_Y))
        return np.array([-force_X, vertical, position[-1], -centre_X, centre_Y])

    def belt(self, state, phi, psi):
        """u_z and u_theta at angles fixed in space, relative to the wheel centre."""
        position = self.motions @ state[state.size // 2 :]
        u_z, u_theta = self.shapes(np.asarray(psi) - phi)
        return u_z @ position - position[-1] * np.sin(psi), u_theta @ position - position[-1] * np.cos(psi)


class Drive:
    """Speed, radial and tangential force, each piecewise linear, and the angle turned."""

    def __init__(self, t, speed, radial, tangential):
        self.t, self.speed, self.radial, self.tangential = (
            np.array(np.broadcast_to(v, np.shape(t)), dtype=float) for v in (t, speed, radial, tangential)
        )
        self.turned = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(self.t) * (self.speed[1:] + self.speed[:-1]))])

    def at(self, time, begin=None):
        """phi, Omega, Omega', f_r, f_t; ``begin`` says which piece a knot belongs to."""
        k = int(np.searchsorted(self.t, time if begin is None else begin, side="right")) - 1
        k = min(max(k, 0), len(self.t) - 2)
        h, part = self.t[k + 1] - self.t[k], time - self.t[k]
        rate = (self.speed[k + 1] - self.speed[k]) / h
        return (
            self.turned[k] + part * (self.speed[k] + 0.5 * part * rate),
            self.speed[k] + part * rate,
            rate,
            self.radial[k] + part / h * (self.radial[k + 1] - self.radial[k]),
            self.tangential[k] + part / h * (self.tangential[k + 1] - self.tangential[k]),
        )

    def finer(self, parts):
        """The same inputs at more times: each piece in equal parts."""
        t = np.concatenate([np.linspace(a, b, parts, endpoint=False) for a, b in zip(self.t, self.t[1:], strict=False)])
        t = np.append(t, self.t[-1])
        return Drive(t, *(np.interp(t, self.t, v) for v in (self.speed, self.radial, self.tangential)))


SIZES = (
    "density", "bending_stiffness", "membrane_stiffness", "radius", "width", "thickness",
    "radial_stiffness", "tangential_stiffness", "inflation_pressure", "wheel_mass", "suspension_stiffness",
)  # fmt: skip
"""The stiffnesses, masses and lengths of a unit that a random tire has by another factor."""


@st.composite
def units(draw):
    """Tires around Table 1, every stiffness, mass and length by a factor of up to two either way; any patch."""
    factor = st.floats(-1.0, 1.0).map(lambda x: 2.0**x)
    changes = {
        name: getattr(TABLE_1, name) * draw(factor)
        for name in SIZES
    }
    damping = st.floats(0.0, 0.5)
    return TABLE_1.replace(
        **changes, zeta_1=draw(damping), zeta_s=draw(damping), zeta_n=draw(damping),
        contact_half_angle=draw(st.sampled_from([0.0, 0.1, 1.0])),
        sidewall_damping=draw(st.sampled_from(["modal", "reaction"])),
    )  # fmt: skip


@st.composite
def drives(draw, varying):
    """10 ms in four uneven pieces, forces up to 5 kN of either sign, speeds up to 300 rad/s of either sign."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(1e-3, 4e-3, 4))])
    speed = draw(st.floats(-300.0, 300.0))
    if varying:
        speed = speed + np.cumsum(rng.uniform(-30.0, 30.0, t.size))
    return Drive(t, speed, rng.uniform(-5000.0, 5000.0, t.size), rng.uniform(-5000.0, 5000.0, t.size))


# -- motion under any drive -------------------------------------------------------------------------------------


def motion(modes, drive, steady=False):
    """Z_1 and Z_2 at the drive's times, shape (2, N, modes)."""
    force = np.stack([drive.radial, drive.tangential], axis=1)
    return np.array(modes.amplitudes(modes.integrate(Steps(drive.t, drive.speed), force, steady=steady)))


def expected_motion(reference, drive, **options):
    states = reference.run(drive, **options)
    each = [reference.amplitudes(state, drive.at(t)[0]) for state, t in zip(states, drive.t, strict=True)]
    return np.array(each).swapaxes(0, 1)


def error(found, expected):
    """Worst error of any mode, beside the largest that mode's Z_1 or Z_2 ever is."""
    size = np.abs(expected).max(axis=(0, 1))
    return float((np.abs(found - expected).max(axis=(0, 1)) / size).max())


def some_numbers(model, n):
    return [n] if model == "inextensional" else [0, n]


# What DOP853 leaves at rtol 1e-12 per step of its own is 1e-12 to 1e-11 after 10 ms; the steps themselves are exact.
EXACT = 1e-8


@pytest.mark.slow
@both
@examples(4, nightly=20)
@given(unit=units(), drive=drives(varying=False), n=st.integers(2, 6))
@example(unit=TABLE_1.replace(zeta_n=0.9999), drive=Drive([0.0, 0.01], 0.0, [1e3, 0.0], 300.0), n=2)
@example(unit=TABLE_1.replace(zeta_n=0.0), drive=Drive([0.0, 0.01], -300.0, 1e3, -500.0), n=6)
def test_constant_speed(model, unit, drive, n):
    numbers = some_numbers(model, n)
    expected = expected_motion(Lagrangian(unit, numbers, model), drive)
    assert error(motion(RingModes(unit, numbers, model), drive), expected) < EXACT


@pytest.mark.slow
@both
@examples(4, nightly=20)
@given(unit=units(), drive=drives(varying=True), n=st.integers(2, 6))
@example(unit=TABLE_1, drive=Drive([0.0, 0.01], [-100.0, 100.0], 0.0, 500.0), n=3)
def test_varying_speed(model, unit, drive, n):
    """Exact too, Euler terms and all, in steps as long as the inputs' lines or shorter."""
    numbers = some_numbers(model, n)
    expected = expected_motion(Lagrangian(unit, numbers, model), drive)
    modes = RingModes(unit, numbers, model)
    for parts in (1, 16):
        assert error(motion(modes, drive.finer(parts))[:, ::parts], expected) < EXACT


@pytest.mark.slow
def test_every_mode_at_once():
    """n = 0 to 6 side by side, one of them with the wheel held: each moves as if alone."""
    drive = Drive([0.0, 0.004, 0.01], [-80.0, -80.0, -80.0], [0.0, 3e3, -1e3], [500.0, -2e3, 0.0])
    unit = TABLE_1.replace(contact_half_angle=0.3)
    for model, numbers in (("inextensional", [2, 3, 4, 5, 6]), ("complete", [0, 1, 2, 3, 4, 5, 6])):
        expected = expected_motion(Lagrangian(unit, numbers, model), drive, held=True)
        found = motion(RingModes(unit, numbers, model), drive)
        assert error(found, expected) < EXACT
        for i, n in enumerate(numbers):
            # the same numbers through arrays of another length: rounding
            alone = motion(RingModes(unit, [n], model), drive)[..., 0]
            assert np.abs(found[..., i] - alone).max() <= 1e-12 * np.abs(alone).max()


@both
def test_a_force_at_another_angle(model):
    drive, numbers = Drive([0.0, 0.005, 0.01], 150.0, [1e3, -2e3, 0.0], [-300.0, 0.0, 900.0]), some_numbers(model, 3)
    expected = expected_motion(Lagrangian(TABLE_1, numbers, model), drive, angle=0.7)
    assert error(motion(RingModes(TABLE_1, numbers, model, angle=0.7), drive), expected) < EXACT


def test_spinning_up_drags_the_belt_behind():
    """n = 0: without a force, the belt's own inertia a Omega' holds it back against the tangential sidewall."""
    unit, rate = TABLE_1.replace(zeta_n=0.5), 400.0
    drive = Drive(np.linspace(0.0, 0.2, 401), np.linspace(0.0, 80.0, 401), 0.0, 0.0)
    radial, tangential = motion(RingModes(unit, [0], "complete"), drive)
    # at the end, where the Coriolis terms 2 Omega z' are gone: (k_theta + p_0/a) z_2 = -rho h a Omega'
    stiffness = unit.tangential_stiffness + unit.inflation_pressure / unit.radius
    behind = -unit.surface_density * unit.radius * rate / stiffness
    # Omega' z_1, Omega' z_2 beside C z_2 and B z_1: rate/C = 1e-3 at most; decay exp(-0.2 * 0.5 * 480)
    assert tangential[-1, 0] == pytest.approx(behind, rel=5e-3)
    assert abs(radial[-1, 0]) < 1e-2 * abs(behind)


# -- steady state -----------------------------------------------------------------------------------------------


def paper_amplitude(unit, n, W, F, coriolis=True):
    """(4.3)-(4.5) without the stray factor 2, and (3.5): Z_1 exp(-i n psi_0) of a load F on a point."""
    a, rho_h = unit.radius, unit.density * unit.thickness
    D, K, p_0 = unit.bending_stiffness, unit.membrane_stiffness, unit.inflation_pressure

    def coefficients(W):
        sigma = W * W + p_0 / (rho_h * a)
        return (
            (n**3 * D / a**4 + n * K / a**2) / rho_h + 2 * n * sigma,
            (n**4 * D / a**4 + K / a**2 + unit.radial_stiffness + p_0 / a) / rho_h + n**2 * sigma,
            (n**2 * D / a**4 + n**2 * K / a**2 + unit.tangential_stiffness + p_0 / a) / rho_h + n**2 * sigma,
        )

    A, B, C = coefficients(0.0)
    d = 2.0 * unit.zeta_n * math.sqrt(n * (B * C - A * A) / (A + n * C))
    A, B, C = coefficients(W)
    g, D_c = n * (B * C - A * A) / (A + n * C), 2.0 * W * (C + n * A) / (A + n * C)
    R = g + n * W * (D_c if coriolis else 0.0) - n**2 * W**2
    I = d * n * W  # noqa: E741
    F_n = n * C * F / ((A + n * C) * math.pi * a * unit.width * rho_h)
    amplitude, phase = F_n / math.hypot(R, I), math.atan2(I, R)
    # Re[conj(Z) exp(i n (psi - psi_0))] = -amplitude cos(n (psi - psi_0) - phase)
    return -amplitude * complex(math.cos(phase), math.sin(phase))


@settings(max_examples=40)
@given(
    unit=units(), speed=st.floats(-300.0, 300.0), n=st.integers(2, 6),
    model=st.sampled_from(["inextensional", "hybrid"]),
)  # fmt: skip
def test_steady_state_is_the_papers(unit, speed, n, model):
    unit = unit.replace(zeta_n=max(unit.zeta_n, 1e-3), contact_half_angle=0.0)
    modes = RingModes(unit, [n], model)
    (found,), _ = modes.amplitudes(modes.at(speed).steady(-1000.0, 0.0))
    expected = paper_amplitude(unit, n, speed, 1000.0, coriolis=model == "inextensional")
    # at a hybrid resonance only the damping is left, of terms some 1e3 times as large that cancel to it
    assert abs(found * np.exp(-1j * n * CONTACT_ANGLE) - expected) <= 1e-9 * abs(expected)


@pytest.mark.slow
@both
@settings(max_examples=25)
@given(
    unit=units(), speed=st.floats(-300.0, 300.0), radial=st.floats(-5e3, 5e3), tangential=st.floats(-5e3, 5e3),
)  # fmt: skip
def test_steady_state_is_the_equations(model, unit, speed, radial, tangential):
    """Put into Lagrange's equations, it does not accelerate: seen from the ring it turns, z = Z exp(-i n Omega t)."""
    numbers = some_numbers(model, 2) + [3, 6]
    reference, modes = Lagrangian(unit, numbers, model), RingModes(unit, numbers, model)
    Z_1, Z_2 = modes.amplitudes(modes.at(speed).steady(radial, tangential))
    amplitudes = dict(zip(numbers, zip(Z_1, Z_2, strict=True), strict=True))
    position = np.zeros(len(reference.place), dtype=complex)  # as the real part of value exp(-i n Omega t), at t = 0
    spin = np.zeros(len(reference.place))
    for (n, kind), i in list(reference.place.items())[:-1]:
        Z = amplitudes[n][kind in ("xi", "eta")]
        position[i] = Z if kind in ("alpha", "xi") else -1j * Z
        spin[i] = n * speed
    own = np.linalg.pinv(reference.motions)
    state = np.concatenate([own @ (-1j * spin * position).real, own @ position.real])
    rate = reference.slope(state, 0.0, speed, 0.0, radial, tangential, CONTACT_ANGLE, False)
    acceleration = own @ (-(spin**2) * position).real
    size = np.abs(reference.K / np.diag(reference.M)[:, None]).max() * np.abs(position).max() + 1e-300
    # rounding beside the stiffest term, which cancels in part
    assert np.abs(rate[: acceleration.size] - acceleration).max() <= 1e-11 * size


@both
@pytest.mark.parametrize("speed", [0.0, 120.0, -250.0])
def test_motion_comes_to_the_steady_state(model, speed):
    """From rest under a constant force, in one long step and in many; what was is left by exp(-0.02 * 480 * 10)."""
    modes = RingModes(TABLE_1, [*some_numbers(model, 2), 3, 6, 30], model)
    spinning, force, no_change = modes.at(speed), np.array([-3000.0, 400.0]), np.zeros(2)
    steady = spinning.steady(*force)
    once = spinning.step(np.zeros_like(steady), 10.0, force, no_change)
    many = np.zeros_like(steady)
    for _ in range(1000):
        many = spinning.step(many, 10e-3, force, no_change)
    size = np.abs(steady).max(axis=1, keepdims=True)
    assert (np.abs(once - steady) <= 1e-9 * size).all() and (np.abs(many - steady) <= 1e-9 * size).all()
    stays = scaled(spinning.step(steady, 1e-3, force, no_change) - steady)
    assert (np.abs(stays) <= 1e-12 * 500.0 * size).all()  # rounding, times the eigenvectors' condition of some tens


# -- the contact patch ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["inextensional", "hybrid", "complete"])
@pytest.mark.parametrize("half_angle", [1e-8, 0.1, 0.7, 0.5 * math.pi])
def test_contact_patch(model, half_angle):
    """Section 4: s_n = sin(n phi_c)/(n sin phi_c) of a pressure even over +-phi_c whose resultant is the load."""
    numbers = np.arange(2, 31) if model != "complete" else np.arange(31)
    point, patch = (RingModes(TABLE_1.replace(contact_half_angle=a), numbers, model) for a in (0.0, half_angle))
    # an even pressure p: p a b 2 sin(phi_c) is the load, and its harmonic n is p a b (2/n) sin(n phi_c)
    integral = np.array([2.0 * math.sin(n * half_angle) / n if n else 2.0 * half_angle for n in numbers])
    share = integral / (2.0 * math.sin(half_angle))
    for speed in (0.0, 150.0):
        whole, spread = (modes.amplitudes(modes.at(speed).steady(-2000.0, 300.0)) for modes in (point, patch))
        for Z, Z_spread in zip(whole, spread, strict=True):
            # n phi_c of up to 47, rounded; at pi/2 every even harmonic is gone but for that
            assert np.abs(Z_spread - share * Z).max() <= 1e-14 * np.abs(Z).max()


# -- symmetries and steps ---------------------------------------------------------------------------------------


@both
@settings(max_examples=15)
@given(unit=units(), drive=drives(varying=True))
def test_backward_is_the_mirror_image(model, unit, drive):
    """About the contact: psi - psi_0 -> psi_0 - psi, spin and tangential force the other way."""
    numbers = [*some_numbers(model, 2), 3, 5]
    modes = RingModes(unit, numbers, model)
    about = np.exp(-1j * np.array(numbers) * CONTACT_ANGLE)
    there = motion(modes, drive.finer(4)) * about
    back = motion(modes, Drive(drive.t, -drive.speed, drive.radial, -drive.tangential).finer(4)) * about
    size = np.abs(there).max(axis=(0, 1))
    # the same arithmetic but for the order of eigenvalues; their vectors err by 1e-16 over their distance
    assert (np.abs(there[0] - np.conj(back[0])) <= 1e-10 * size).all()
    assert (np.abs(there[1] + np.conj(back[1])) <= 1e-10 * size).all()


def random_state(modes, seed, displacement=1e-3):
    rng = np.random.default_rng(seed)
    shape = modes.at(0.0).exponents.shape
    state = displacement * (rng.normal(size=shape) + 1j * rng.normal(size=shape))
    state[:, : shape[1] // 2] *= 500.0
    return state


def scaled(state):
    """Velocities beside displacements times a frequency."""
    return state * np.repeat([1.0, 500.0], state.shape[1] // 2)


@settings(max_examples=50)
@given(
    model=st.sampled_from(MODELS), speed=st.floats(-300.0, 300.0), seed=st.integers(0, 999),
    length=st.floats(-9.0, 1.0).map(lambda x: 10.0**x), part=st.floats(0.01, 0.99),
)  # fmt: skip
def test_a_step_in_two(model, speed, seed, length, part):
    """From a nanosecond to ten seconds, a linear force over it: one step is two, wherever it is cut."""
    modes = RingModes(TABLE_1, [*some_numbers(model, 2), 5, 30], model)
    spinning, state = modes.at(speed), random_state(modes, seed)
    force, change = np.array([-3000.0, 200.0]), np.array([2500.0, -900.0])
    first, second = part * length, length - part * length
    # first == second would take the same factors twice
    two = spinning.step(state, first, force, part * change)
    two = spinning.step(two, second, force + part * change, (1.0 - part) * change)
    one = spinning.step(state, length, force, change)
    # eigenvectors times their inverses, 1e-15 of the state before and after; part is rounded as well, |mu h| 2^-53
    size = max(np.abs(scaled(state)).max(), np.abs(scaled(one)).max())
    assert np.abs(scaled(one - two)).max() <= 1e-11 * size


@both
def test_no_seam_where_the_series_takes_over(model):
    """Below |mu h| = 0.5 phi_1 and phi_2 are summed as series: both sides of that length give the same step."""
    modes = RingModes(TABLE_1, [*some_numbers(model, 2), 5], model)
    for speed in (0.0, 200.0):
        spinning, state = modes.at(speed), random_state(modes, 1)
        for mu in np.abs(spinning.exponents).ravel():
            sides = [
                scaled(spinning.step(state, 0.5 / mu * side, np.array([4e3, 1e3]), np.array([-9e3, 3e3])))
                for side in (1.0 - 1e-15, 1.0 + 1e-15)
            ]
            # 1e-15 of |mu h| up to 10, and the closed form's cancellation of two or three bits
            assert np.abs(sides[0] - sides[1]).max() <= 1e-13 * np.abs(sides[0]).max()


@both
def test_a_step_of_no_length_changes_nothing(model):
    modes = RingModes(TABLE_1, some_numbers(model, 4), model)
    state, spinning = random_state(modes, 3), modes.at(77.0)
    found = spinning.step(state, 0.0, np.array([1e3, 1e3]), np.array([1e3, 0.0]))
    assert np.abs(scaled(found - state)).max() <= 1e-14 * np.abs(scaled(state)).max()  # left times right


@settings(max_examples=40)
@given(
    unit=units(), model=st.sampled_from([*MODELS, "hybrid"]), seed=st.integers(0, 999),
    before=st.floats(-300.0, 300.0), after=st.floats(-300.0, 300.0),
)  # fmt: skip
def test_change_speed_there_and_back(unit, model, seed, before, after):
    modes = RingModes(unit, [2, 3, 7] if model != "complete" else [0, 1, 2, 7], model)
    state = random_state(modes, seed)
    copy = state.copy()
    there = modes.change_speed(state, before, after)
    back = modes.change_speed(there, after, before)
    # a jump by 600 rad/s of 1e-3 m, and for n = 0 of the radius, there and back, each rounded once
    assert np.abs(back - state).max() <= 1e-15 * (np.abs(state).max() + np.abs(there).max())
    assert np.array_equal(state, copy)  # the caller's own is left alone
    k = state.shape[1] // 2
    assert np.array_equal(there[:, k:], state[:, k:])  # positions do not jump


@settings(max_examples=20)
@given(
    unit=units(), model=st.sampled_from(MODELS), before=st.floats(-300.0, 300.0), change=st.floats(-1.0, 1.0),
    seed=st.integers(0, 999),
)  # fmt: skip
def test_change_speed_is_the_integral_of_the_euler_terms(unit, model, before, change, seed):
    """Omega' times what Lagrange's equations have of it, for a small change that lasts no time."""
    numbers = [*some_numbers(model, 2), 3]
    modes, reference = RingModes(unit, numbers, model), Lagrangian(unit, numbers, model)
    state = random_state(modes, seed)
    Z_1, Z_2 = modes.amplitudes(state)
    values = {"alpha": Z_1.real, "beta": Z_1.imag, "xi": Z_2.real, "eta": Z_2.imag}  # at phi = 0
    full = np.zeros(len(reference.place))
    for (n, kind), i in list(reference.place.items())[:-1]:
        full[i] = values[kind][numbers.index(n)]
    motions, own = reference.motions, reference.motions.shape[1]
    still = np.concatenate([np.zeros(own), np.linalg.pinv(motions) @ full])
    euler = [reference.slope(still, 0.0, before, rate, 0.0, 0.0, CONTACT_ANGLE, False) for rate in (change, 0.0)]
    jumps = dict(zip(reference.place, motions @ (euler[0] - euler[1])[:own], strict=True))
    found = modes.change_speed(state, before, before + change) - state
    for i, n in enumerate(numbers):
        expected = [jumps[n, "alpha"] + 1j * jumps.get((n, "beta"), found[i, 0].imag)]
        if model == "complete":
            expected.append(jumps[n, "xi"] + 1j * jumps.get((n, "eta"), found[i, 1].imag))
        # the reference's come as a difference of accelerations of 1e7 times as much; gamma moves by 1e-4 of itself
        size = abs(change) * (np.abs(state[i]).max() + (unit.radius if n == 0 else 0.0))
        assert np.abs(found[i, : len(expected)] - expected).max() <= 1e-4 * size + 1e-8


# -- arguments --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("numbers", "model", "words"),
    [
        ([1, 2], "inextensional", "needs integers >= 2"),
        ([0], "hybrid", "needs integers >= 2"),
        ([-1], "complete", "needs integers >= 0"),
        ([2.5], "complete", "needs integers"),
        ([math.nan], "inextensional", "needs integers"),
        ([2], "rigid", "model is 'rigid'"),
    ],
)
def test_wrong_arguments(numbers, model, words):
    with pytest.raises(ValueError, match=words):
        RingModes(TABLE_1, numbers, model)
