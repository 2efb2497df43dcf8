"""The tire on the road, at constant speed: docs/model.md, sections 11 and 12, and closed forms."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tire_dynamics import TireWheelUnit, floquet, ring, wheel, write_unit
from tire_dynamics.cli.main import main
from tire_dynamics.science import contact, maps, nonuniform
from tire_dynamics.science.coefficients import contact_patch_factor
from tire_dynamics.science.modes import RingModes

RPM = math.pi / 30.0

TABLE_1 = TireWheelUnit.table_1()
PATCH = TABLE_1.replace(contact_half_angle=0.15)
ROAD = PATCH.replace(vertical_stiffness=2e5, sidewall_damping="reaction")


# -- statics ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "n_max", "stiffness"),
    [
        *((TABLE_1, n_max, K) for n_max, K in ((1, 1431682.8), (10, 285074.5), (30, 261684.8), (100, 259877.8))),
        *((PATCH, n_max, K) for n_max, K in ((10, 319587.8), (30, 314183.8), (100, 314134.4))),
    ],
)
def test_the_tires_own_static_stiffness(unit, n_max, stiffness):
    """docs/model.md, section 12, to the last printed digit."""
    assert ring.static_stiffness(unit, n_max) == pytest.approx(stiffness, abs=0.05)


def test_the_residual_spring_makes_up_for_the_belt():
    """docs/model.md, section 12, to the last printed digit; and whatever n_max is, the whole is what was asked for."""
    assert wheel.residual_stiffness(ROAD, 30) == pytest.approx(550312.4, abs=0.05)
    assert wheel.residual_stiffness(ROAD, 10) == pytest.approx(534482.4, abs=0.05)
    for model in ("inextensional", "complete"):
        for n_max in (1, 4, 30):
            assert ring.static_stiffness(ROAD, n_max, model) == pytest.approx(2e5, rel=1e-12)
    assert wheel.residual_stiffness(PATCH) == math.inf


def test_what_is_asked_of_the_residual_spring_is_refused():
    stiff = ROAD.replace(vertical_stiffness=305e3)  # below the inextensional ring's own, above the complete one's
    own = ring.static_stiffness(stiff.replace(vertical_stiffness=0.0), 30, "complete")
    with pytest.raises(ValueError, match="vertical_stiffness is 305000.0.*< " + f"{own:.10g}".replace(".", "[.]")):
        wheel.residual_stiffness(stiff, 30, "complete")
    for n_max in (0, -3, 2.5, True):
        with pytest.raises(ValueError, match="n_max is"):
            wheel.residual_stiffness(ROAD, n_max)


@pytest.mark.parametrize("half_angle", [0.0, 1e-9, 0.15, 0.5 * math.pi])
def test_patch_factors_are_the_harmonics_of_an_even_pressure(half_angle):
    """By quadrature of cos n psi over the patch, over that of cos psi, which is the vertical part."""
    numbers = np.arange(31)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    each = np.array([weights @ np.cos(n * half_angle * nodes) for n in numbers]) / (
        weights @ np.cos(half_angle * nodes)
    )
    found = contact_patch_factor(TABLE_1.replace(contact_half_angle=half_angle), numbers)
    assert found == pytest.approx(each, abs=1e-14)  # rounding of 64 terms of size 1
    assert found[1] == 1.0


# -- the linear system in contact -----------------------------------------------------------------------------------


def lowest(unit, rpm_, **options):
    exponents = contact.oscillatory_exponents(unit, rpm_ * RPM, **options)[:3]
    return exponents.imag / (2.0 * math.pi), -exponents.real


@pytest.mark.parametrize(
    ("speed", "frequencies", "decay"),
    [
        (0.0, (20.9408, 78.4220, 91.7260), (2.8868, 24.6679, 11.5289)),
        (1000.0, (20.8769, 75.7161, 78.4645), (2.9983, 13.6873, 24.6516)),
    ],
)
def test_lowest_frequencies_in_contact(speed, frequencies, decay):
    """docs/model.md, section 12, to the last printed digit."""
    hertz, rates = lowest(ROAD, speed)
    assert hertz == pytest.approx(frequencies, abs=5e-5)
    assert rates == pytest.approx(decay, abs=5e-5)
    assert wheel.whirl_frequencies(ROAD, speed * RPM, contact=True)[:3] == pytest.approx(frequencies, abs=5e-5)


def test_lowest_frequencies_with_a_car_above():
    """docs/model.md, section 12, to the last printed digit: the body at 1.5 Hz, the wheel's hop at 21 Hz."""
    hertz, rates = lowest(ROAD.replace(sprung_mass=350.0, zeta_s=0.3), 60.0 / RPM)
    assert hertz == pytest.approx((1.4848, 20.7774, 78.4356), abs=5e-5)
    assert rates == pytest.approx((0.4471, 16.0993, 24.6567), abs=5e-5)


@pytest.mark.parametrize(("damping", "rpm_"), [("modal", 28167.7), ("reaction", 17384.9)])
def test_loss_of_stability_in_contact(damping, rpm_):
    """docs/model.md, section 12, to the last printed digit; and the verdict changes there."""
    unit = ROAD.replace(sidewall_damping=damping)
    critical = wheel.critical_speed(unit, contact=True)
    assert critical / RPM == pytest.approx(rpm_, abs=0.05)
    verdicts = [wheel.stability(unit, w * critical, contact=True).verdict for w in (-0.999, 0.999, 1.001, -1.001)]
    assert verdicts == ["asymptotically stable"] * 2 + ["unstable"] * 2


def test_axle_force_per_metre_of_road():
    """docs/model.md, section 12, to the last printed digit."""
    H = wheel.frequency_response(ROAD, 1000.0 * RPM, [1.0, 5.0, 10.0, 20.0, 40.0, 80.0, 120.0], input="road")
    expected = [30583.2, 32456.4, 40028.4, 340959.8, 13444.1, 4759.2, 8492.5]
    assert np.abs(H[:, 1, 0]) == pytest.approx(expected, abs=0.05)


def test_a_road_that_rises_slowly_presses_with_all_springs_in_a_row():
    """At 0 Hz and at rest: 1/K_v and 1/k_s, and no horizontal force; with a car above the body just follows."""
    H = wheel.frequency_response(ROAD, 0.0, 0.0, input="road")
    series = 1.0 / (1.0 / 2e5 + 1.0 / ROAD.suspension_stiffness)
    assert H[:, 0] == pytest.approx([0.0, series, series], abs=1e-9 * series)
    H = wheel.frequency_response(ROAD.replace(sprung_mass=350.0), 0.0, 1e-4, input="road")
    assert np.abs(H[:, 0]).max() < 1e-3


@st.composite
def units(draw):
    """Any tire on the road, near a car's; both dampings, a fore-aft support or none, a body or none."""
    half_angle = draw(st.sampled_from([0.0, 0.1, 0.4]))
    unit = TABLE_1.replace(
        contact_half_angle=half_angle,
        sidewall_damping=draw(st.sampled_from(["modal", "reaction"])),
        zeta_1=draw(st.floats(0.01, 0.3)),
        zeta_n=draw(st.floats(0.01, 0.2)),
        zeta_s=draw(st.floats(0.01, 0.5)),
        tangential_stiffness=draw(st.floats(1e6, 1e7)),
        longitudinal_stiffness=draw(st.sampled_from([0.0, 3e5])),
        longitudinal_damping_ratio=0.1,
        sprung_mass=draw(st.sampled_from([0.0, 300.0])),
    )
    own = min(ring.static_stiffness(unit, 100), ring.static_stiffness(unit, 100, "complete"))
    stiffness = draw(st.sampled_from([0.0, 0.5, 0.9])) * own
    return unit.replace(vertical_stiffness=stiffness, residual_damping=draw(st.sampled_from([0.0, 100.0])))


models = st.sampled_from(["inextensional", "complete"])
speeds = st.floats(-250.0, 250.0)


@settings(max_examples=20)
@given(unit=units(), speed=speeds, model=models, n_max=st.integers(1, 6))
def test_the_open_system_is_the_wheels_and_the_modes(unit, speed, model, n_max):
    """Without the contact's spring its exponents are those of ``wheel`` and of every mode, each with its conjugate."""
    system = contact.open_system(unit.replace(sprung_mass=0.0), speed, model, n_max)
    found = np.linalg.eigvals(system.matrix)
    expected = [np.linalg.eigvals(wheel.fixed_frame_matrix(unit, speed, model))]
    for n in contact.belt_numbers(model, n_max):
        exponents = RingModes(unit, [n], model).at(speed).exponents[0]
        expected += [exponents, np.conj(exponents)] if n else [exponents]
    expected = np.concatenate(expected)
    assert found.size == expected.size
    size = np.abs(expected).max()
    # a double eigenvalue without its eigenvectors, as a mode at rest nearly is, moves by the root of the rounding
    assert max(np.abs(found - value).min() for value in expected) < 1e-7 * size


@settings(max_examples=20)
@given(unit=units(), speed=speeds, model=models, n_max=st.integers(1, 6), frequency=st.floats(0.5, 300.0))
def test_frequency_response_against_the_whole_system(unit, speed, model, n_max, frequency):
    """The closed form against (s - A_contact)^-1 of all states at once; of a rigid tread one 1e6 times as stiff.

    What that leaves is some 1e-6, and more beside a resonance.
    """
    system = contact.open_system(unit, speed, model, n_max)
    if not math.isfinite(system.stiffness):
        system = system._replace(stiffness=1e12)
    s = 2j * math.pi * frequency
    spring = system.stiffness + s * system.damping
    A = system.matrix + np.outer(system.push, system.stiffness * system.contact + system.damping * system.rate)
    z = np.linalg.solve(s * np.eye(len(A)) - A, np.stack([spring * system.push, system.traction], axis=1))
    force = spring * (np.array([1.0, 0.0]) + system.contact @ z)
    H = wheel.frequency_response(unit, speed, frequency, model, input="road", n_max=n_max)
    whole = np.concatenate([system.output @ z, force[None]])
    for column in (0, 1):  # metres of road, newtons of traction
        assert H[:, column] == pytest.approx(whole[:, column], abs=1e-5 * np.abs(whole[:, column]).max())


SIDEWALLS = [
    {},
    {"radial_nonuniformity": [(2, 0.3, 0.4)]},
    {"radial_nonuniformity": [(1, 0.2, 0.3), (3, 0.1, 1.0)], "tangential_nonuniformity": [(2, 0.3, -0.5)]},
]


@settings(max_examples=15)
@given(
    unit=units(), speed=st.sampled_from([-200.0, -30.0, 1.0, 240.0]), phi=st.floats(0.1, 3.0), model=models,
    n_max=st.integers(2, 4),
    sidewall=st.sampled_from(SIDEWALLS),
)  # fmt: skip
def test_the_ring_frame_agrees(unit, speed, phi, model, n_max, sidewall):
    """A_ring T = T' + T A_fixed, A_ring from the paper's equations in ring axes, where the contact runs around."""
    unit = unit.replace(**sidewall, sprung_mass=0.0, residual_damping=0.0)
    if unit.vertical_stiffness == 0.0:
        unit = unit.replace(vertical_stiffness=0.5 * ring.static_stiffness(unit, 100, model))
    parts, system = contact.periodic_system(unit, speed, model, n_max)
    fixed = parts.at(phi)
    T, slope = rotating_excitation(unit, speed, phi, model, n_max)
    turned = ring_frame(unit, speed, phi, model, n_max)
    rest = turned @ T - speed * slope - T @ fixed
    # rounding of the stiffest terms
    assert np.abs(rest).max() <= 1e-11 * (np.abs(turned) @ np.abs(T) + np.abs(T) @ np.abs(fixed)).max()


def rotating_excitation(unit, speed, phi, model, n_max):
    """T, which takes states of ``ContactSystem`` to those of ``nonuniform.state_matrix``, and its slope over phi."""
    labels = nonuniform.coordinates(model, n_max)
    held = unit.is_longitudinally_rigid
    one = wheel.states(unit, model)
    half, total = len(labels) + (1 if held else 2), 2 * len(labels) + (2 if held else 4)
    T, slope = np.zeros((2, total, total))
    ones = [k for k, (n, _) in enumerate(labels) if n == 1] + list(range(len(labels), half))
    rows = np.array(ones + [half + k for k in ones])
    turn = wheel.rotation(phi, speed, model, held)
    T[rows, :one] = turn
    quarter = wheel.rotation(phi + 0.5 * math.pi, speed, model, held)
    quarter[np.abs(quarter - turn) == 0.0] = 0.0  # what does not turn
    slope[rows, :one] = quarter
    first = one
    kinds = [("alpha", "beta")] if model == "inextensional" else [("alpha", "beta"), ("xi", "eta")]
    k = len(kinds)
    for n in [0, *range(2, n_max + 1)]:
        wave, imaginary = np.exp(-1j * n * phi), first + 2 * k
        for velocity in (True, False):
            for i, pair in enumerate([("xi",)] if n == 0 and k == 1 else kinds):
                column = first + (0 if velocity else k) + i
                for part, kind in enumerate(pair[: 1 if n == 0 else 2]):
                    row = labels.index((n, kind)) + (0 if velocity else half)
                    for matrix, value in ((T, wave), (slope, -1j * n * wave)):
                        matrix[row, column] = (value.real, value.imag)[part]
                        if n:
                            matrix[row, column + imaginary - first] = (-value.imag, value.real)[part]
        first += 2 * k if n == 0 else 4 * k
    return T, slope


@pytest.mark.parametrize("sidewall", SIDEWALLS)
def test_multipliers_of_a_tire_on_the_road(sidewall):
    """Of one turn, by ``floquet.analyze`` of the system that an observer on the ring has."""
    unit = ROAD.replace(**sidewall)
    found = wheel.stability(unit, -250.0, contact=True, n_max=2)
    other = floquet.analyze(lambda t: ring_frame(unit, -250.0, -250.0 * t, "inextensional", 2), 2.0 * math.pi / 250.0)
    assert found.verdict == other.verdict == "asymptotically stable"
    for value in found.multipliers:  # the ring frame has the wind-up too
        assert np.abs(other.multipliers - value).min() < 1e-8 + other.error_estimate


def ring_frame(unit, speed, phi, model, n_max):
    """A at phi from the paper's own equations in ring axes, with the contact's spring at theta* = psi_0 - phi."""
    sidewall = nonuniform.Nonuniformity.of(unit)
    A = nonuniform.state_matrix(unit.mean, sidewall, speed, phi / speed, model, n_max)
    labels = nonuniform.coordinates(model, n_max)
    half = len(A) // 2
    area = math.pi * unit.radius * unit.width * unit.surface_density
    factors = contact_patch_factor(unit, [n for n, _ in labels])
    seen, driven = np.zeros((2, half))
    for k, (n, kind) in enumerate(labels):
        theta = n * (1.5 * math.pi - phi)
        wave = {"alpha": math.cos(theta), "beta": math.sin(theta)}.get(kind, 0.0) * factors[k]
        seen[k] = wave
        mass = area * (2.0 if n == 0 else 1.0)
        if model == "inextensional" and n == 1:
            mass = 2.0 * area  # the whole ring's
        elif model == "inextensional" and n:
            C_n = ring.coefficients(unit, n, speed)
            mass = area * float((C_n.coupling + n * C_n.tangential) / (n * C_n.tangential))
        driven[k] = -wave / mass
    k_c = wheel.residual_stiffness(unit, n_max, model)
    A[:half, half:] += k_c * np.outer(driven, seen)
    return A


def test_a_rigid_tread_is_the_limit_of_a_stiff_one():
    unit = ROAD.replace(vertical_stiffness=0.0)
    system = contact.open_system(unit, 60.0)
    rigid = contact.oscillatory_exponents(unit, 60.0)
    stiff = np.linalg.eigvals(system._replace(stiffness=1e11).closed())
    assert len(system.closed()) == len(system.matrix) - 2
    for value in rigid[:8]:
        assert np.abs(stiff - value).min() < 1e-4 * abs(value)  # the shift is of the order of K/k


@settings(max_examples=20)
@given(unit=units(), speed=speeds, model=models, n_max=st.integers(1, 6), load=st.floats(100.0, 1e4))
def test_standing_is_an_equilibrium(unit, speed, model, n_max, load):
    """All forces balance, the spring carries the load, and the body its weight."""
    system = contact.open_system(unit, speed, model, n_max)
    state, compression, weight = contact.standing(system, load)
    rate = system.matrix @ state + load * system.push + weight * system.weight
    # rounding beside the stiffest terms, K/(a^2 rho h) z
    assert np.abs(rate).max() <= 1e-10 * (np.abs(system.matrix) @ np.abs(state)).max()
    if math.isfinite(system.stiffness):
        assert system.stiffness * (compression + system.contact @ state) == pytest.approx(load, rel=1e-9)
    if unit.sidewall_damping == "reaction":
        assert weight == pytest.approx(load, rel=1e-9)


# -- what turns -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("harmonic", "variation"), [(1, 62.902), (2, 57.602)])
def test_force_variation_at_a_fixed_height(harmonic, variation):
    """docs/model.md, section 12: complete ring, point contact, rigid tread; what a uniformity machine reads."""
    unit = TABLE_1.replace(radial_nonuniformity=[(harmonic, 0.02, 0.3)])
    first = contact.force_variation(unit, 0.01, 4000.0, "complete", mount="machine")
    assert first.harmonics.tolist() == [harmonic]
    assert 2.0 * np.abs(first.axle) == pytest.approx([variation], abs=5e-4)
    assert first.contact == pytest.approx(first.axle, rel=1e-5)  # 2 zeta_1 Omega/omega_1 is 2e-6
    angles = 2.0 * math.pi * np.arange(720) / 720
    force = contact.fixed_height_force(unit, 4000.0, angles)
    assert force.mean() == pytest.approx(4000.0, rel=1e-12)
    assert np.ptp(force) == pytest.approx(variation, abs=1e-3)  # of second order in 2 %
    wave = 4000.0 + (first.axle[0] * np.exp(1j * harmonic * angles)).real
    assert np.abs(force - wave).max() < 0.6  # 1 % of it


@pytest.mark.parametrize(("kmh", "variation"), [(2, 30.52), (33, 34.23), (154, 202.99)])
def test_run_out_on_a_car(kmh, variation):
    """docs/model.md, section 12, to the last printed digit: 0.5 mm of run-out on a body that is held."""
    unit = ROAD.replace(radial_runout=[(1, 5e-4, 0.2)], zeta_s=0.3)
    found = contact.force_variation(unit, kmh / 3.6 / unit.radius, 4000.0)
    assert 2.0 * np.abs(found.axle) == pytest.approx([variation], abs=5e-3)


@settings(max_examples=10)
@given(unit=units(), speed=st.floats(20.0, 200.0), model=models, mount=st.sampled_from(["car", "machine"]))
def test_force_variation_is_the_first_order_of_the_periodic_solution(unit, speed, model, mount):
    """Against harmonic balance of the whole equations, exp(i m phi) for m = -4 to 4, at small amplitudes."""
    n_max, load, size = 4, 3000.0, 1e-5
    unit = unit.replace(
        radial_nonuniformity=[(1, 3 * size, 0.2), (2, size, 1.0)], tangential_nonuniformity=[(2, 2 * size, 0.5)],
        radial_runout=[(1, 0.01 * size, 0.3), (3, 0.01 * size, 1.3)], imbalance_mass=size, imbalance_angle=0.7,
    )  # fmt: skip
    parts, system = contact.periodic_system(unit, speed, model, n_max, contact=False)
    found = contact.force_variation(unit, speed, load, model, n_max, mount=mount)
    expected = harmonic_balance(unit, parts, system, speed, load, model, mount)
    for j, axle, force in zip(found.harmonics.tolist(), found.axle, found.contact, strict=True):
        scale = np.abs(found.axle).max() + np.abs(found.contact).max()
        assert [axle, force] == pytest.approx(expected[j], abs=1e-3 * scale)  # second order: 1e-5 of resonances


@settings(max_examples=10)
@given(unit=units(), speed=st.floats(20.0, 200.0), model=models)
def test_the_forward_variation_is_that_of_supports_that_hardly_give(unit, speed, model):
    """Bushing and suspension a million times the sidewall: a wheel that is held, by the bushing's own equations."""
    unit = unit.replace(
        radial_nonuniformity=[(1, 0.03, 0.2), (2, 0.01, 1.0)], tangential_nonuniformity=[(2, 0.02, 0.5)],
        radial_runout=[(1, 1e-4, 0.3), (3, 2e-4, 1.3)], imbalance_mass=0.01, imbalance_angle=0.7,
        longitudinal_stiffness=0.0, sprung_mass=0.0,
    )  # fmt: skip
    stiff = {"longitudinal_stiffness": 1e6 * unit.sidewall_stiffness}
    held = {"suspension_stiffness": 1e6 * unit.sidewall_stiffness, **stiff}
    for mount, changes in (("car", stiff), ("machine", held)):
        found = contact.force_variation(unit, speed, 3000.0, model, 4, mount=mount)
        near = contact.force_variation(unit.replace(**changes), speed, 3000.0, model, 4)
        scale = max(np.abs(found.forward).max(), np.abs(found.axle).max())
        assert near.forward == pytest.approx(found.forward, abs=1e-4 * scale)


def test_run_out_pushes_forward_as_a_road_does():
    """To the contact it is a road that turns with the tire."""
    unit = ROAD.replace(radial_runout=[(1, 5e-4, 0.2)])
    speed = 80.0
    road = contact.frequency_response(unit, speed, speed / (2.0 * math.pi))[:, 0]
    runout = 5e-4 * np.exp(-1j * (1.5 * math.pi - 0.2))
    found = contact.force_variation(unit, speed, 4000.0)
    assert [found.forward[0], found.axle[0], found.contact[0]] == pytest.approx(road * runout, rel=1e-9)


def harmonic_balance(unit, parts, system, speed, load, model, mount):
    """Axle and contact force over exp(i j phi), of the steady answer to the load, the weight and what turns."""
    n, half = len(system.matrix), len(wheel.fixed_frame(unit.mean, model).constant) // 2
    y = half + (2 if model == "inextensional" else 4)
    orders = np.arange(-4, 5)
    along = [] if unit.is_longitudinally_rigid else [y - half + 1, y + 1]
    stuck = [] if mount == "car" else [y - half, y, *along]
    stuck += [2 * half, 2 * half + 1] if unit.sprung_mass and mount == "machine" else []
    kept = np.array([k for k in range(n) if k not in stuck])
    blocks = {m: system.matrix.astype(complex) * (m == 0) for m in range(-8, 9)}
    for j, cosine, sine in zip(parts.harmonics, parts.cosines, parts.sines, strict=True):
        blocks[j] = blocks[j] + 0.5 * (cosine - 1j * sine)
        blocks[-j] = blocks[-j] + 0.5 * (cosine + 1j * sine)
    rigid = not math.isfinite(system.stiffness)
    if mount == "machine":
        state = np.zeros(n)
        state[kept] = np.linalg.solve(system.matrix[np.ix_(kept, kept)], -load * system.push[kept])
        height, weight = (0.0 if rigid else load / system.stiffness) - system.contact @ state, 0.0
    else:
        _, height, weight = contact.standing(system, load)
    size, count = len(kept), len(orders)
    whole, right = np.zeros((count * (size + 1),) * 2, complex), np.zeros(count * (size + 1), complex)
    for p, m in enumerate(orders):
        rows, spring = slice(p * size, (p + 1) * size), count * size + p
        for q, k in enumerate(orders):
            whole[rows, q * size : (q + 1) * size] = -blocks[m - k][np.ix_(kept, kept)] + (
                1j * m * speed * np.eye(size) if m == k else 0.0
            )
        whole[rows, spring] = -system.push[kept]
        s = 1j * m * speed
        soft = 0.0 if rigid else 1.0 / (system.stiffness + s * system.damping)
        whole[spring, spring], whole[spring, rows] = soft, -system.contact[kept]
        right[spring] = height if m == 0 else 0.0
        for j, e, chi in unit.radial_runout:
            if abs(m) == j:
                right[spring] += 0.5 * e * contact_patch_factor(unit, j) * np.exp(-1j * m * (1.5 * math.pi - chi))
        pushed = np.zeros(n, complex)
        if m == 0:
            pushed += weight * system.weight
        if abs(m) == 1:
            ring_mass = unit.ring_mass * (1.0 if model == "inextensional" else 0.5)
            one = 0.5 * unit.imbalance_mass * unit.radius * speed**2 * np.exp(1j * m * unit.imbalance_angle) / ring_mass
            pushed[0] += one
            pushed[1] += one / (1j * m)
        right[rows] = pushed[kept]
    solved = np.linalg.solve(whole, right)
    answers = {}
    for j in (1, 2, 3):
        axle = 0.0
        for q, k in enumerate(orders):
            state = np.zeros(n, complex)
            state[kept] = solved[q * size : (q + 1) * size]
            if mount == "machine":
                axle += unit.wheel_mass * (blocks[j - k] @ state)[y - half]
            elif j == k:
                axle += system.output[1] @ state
        answers[j] = [2.0 * axle, 2.0 * solved[count * size + int(np.flatnonzero(orders == j)[0])]]
    return answers


def test_bad_arguments():
    for call in (
        lambda: contact.force_variation(ROAD, 0.0, 4000.0),
        lambda: contact.force_variation(ROAD, 10.0, 4000.0, mount="truck"),
        lambda: contact.open_system(ROAD, math.nan),
        lambda: wheel.frequency_response(ROAD, 10.0, math.inf, input="road"),
        lambda: wheel.frequency_response(ROAD, 10.0, 1.0, input="street"),
    ):
        with pytest.raises(ValueError, match="must be"):
            call()


# -- maps and commands --------------------------------------------------------------------------------------------


def test_a_map_on_the_road_is_of_the_stability_at_each_point():
    """Speeds about those of the two losses of stability, a softer tread among them."""
    speeds, stiffnesses = np.array([100.0, 1000.0, 2500.0]), np.array([1.5e5, 2e5])
    grid = maps.stability_map(ROAD, ("vertical_stiffness", stiffnesses), ("speed", speeds), contact=True, n_max=3)
    for row, speed in enumerate(speeds.tolist()):
        for column, stiffness in enumerate(stiffnesses.tolist()):
            unit = ROAD.replace(vertical_stiffness=stiffness)
            found = wheel.stability(unit, speed, contact=True, n_max=3)
            assert maps.VERDICTS[grid.verdict[row, column]] == found.verdict
            assert grid.abscissa[row, column] == pytest.approx(found.exponents.real.max(), rel=1e-9)
    assert {maps.VERDICTS[code] for code in grid.verdict.ravel()} == {"asymptotically stable", "unstable"}


def test_the_commands_on_the_road(tmp_path, capsys):
    """``map`` and ``response`` with ``--contact``: the library's numbers."""
    write_unit(ROAD, tmp_path / "unit.yaml")
    tire = ["--config", str(tmp_path / "unit.yaml"), "--contact", "--n-max", "3", "--json"]
    assert main(["response", "--speed-rpm", "1000", "--points", "3", *tire]) == 0
    said = json.loads(capsys.readouterr().out)
    H = wheel.frequency_response(ROAD, 1000.0 * RPM, said["frequencies_Hz"], input="road", n_max=3)
    [one] = said["speeds"]
    for name, row in (("road_to_force_z", 1), ("road_to_contact_force", 2)):
        assert one[name]["ratio"] == pytest.approx(np.abs(H[:, row, 0]), rel=1e-12)
    axes = ["--x", "speed_rpm=1000:40000:3", "--y", "zeta_1=0.05:0.1:2"]
    assert main(["map", *axes, *tire, "-o", str(tmp_path / "map.png"), "--quiet"]) == 0
    said = json.loads(capsys.readouterr().out)
    with np.load(said["numbers"]) as drawn:
        assert drawn["contact_n_max"] == 3
        speeds, zetas = drawn["x"] * RPM, drawn["y"]
        grid = maps.stability_map(ROAD, ("speed", speeds), ("zeta_1", zetas), contact=True, n_max=3)
        assert drawn["verdict"].tolist() == grid.verdict.tolist()
