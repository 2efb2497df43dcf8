"""What Huang & Hsu (1992) say in words, as inequalities: Table 1 and its neighbourhood, no number of theirs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tire_dynamics import TireWheelUnit, ring, simulate, wheel
from tire_dynamics.science.modes import RingModes

UNIT = TireWheelUnit.table_1()
LOAD = 1961.33  # N: 200 kgf
RPM = math.pi / 30.0  # rad/s
FROM_CONTACT = np.linspace(0.05, math.pi, 40)
RIGHT, LEFT = ring.CONTACT_ANGLE + FROM_CONTACT, ring.CONTACT_ANGLE - FROM_CONTACT

models = pytest.mark.parametrize("model", ["inextensional", "complete"])
dampings = pytest.mark.parametrize("damping", ["modal", "reaction"])
speeds = st.floats(1.0, 400.0) | st.floats(-400.0, -1.0)


# -- the deflected shape ----------------------------------------------------------------------------------------


def skewness(unit, speed, model):
    """How far the belt's two sides differ, u_z even and u_theta odd about the load, beside its deflection."""
    response = simulate(unit, [0.0], speed, LOAD, psi=np.concatenate([RIGHT, LEFT]), model=model)
    (right, left), (along, against) = (np.split(u[0], 2) for u in (response.u_z, response.u_theta))
    return max(np.abs(right - left).max(), np.abs(along + against).max()) / np.abs(right).max()


@models
@dampings
@given(speed=speeds)
@settings(max_examples=10)
def test_symmetric_about_the_load_at_standstill_only(model, damping, speed):
    """All modes, n = 1 with the wheel among them. Damping skews the shape, by its ratio times n Omega over omega_n."""
    unit = UNIT.replace(sidewall_damping=damping)
    assert skewness(unit, 0.0, model) < 1e-12  # rounding of thirty cosines, and of 3 pi/2
    assert skewness(unit, speed, model) > 1e-5 * abs(speed)


@models
def test_the_skew_grows_with_speed_and_turns_with_it(model):
    skews = [skewness(UNIT, rpm * RPM, model) for rpm in (0.0, 800.0, 1600.0, 3600.0)]  # the speeds of Figure 3
    assert skews == sorted(skews)
    forward, backward = (simulate(UNIT, [0.0], side * 150.0, LOAD, psi=angles, model=model).u_z[0]
                         for side, angles in ((1.0, RIGHT), (-1.0, LEFT)))  # fmt: skip
    assert np.abs(forward - backward).max() <= 1e-12 * np.abs(forward).max()


@models
def test_without_damping_the_shape_is_symmetric_at_any_speed(model):
    """It is the damping that lags: I_n = d n Omega of (4.4)."""
    for zeta_n in (0.0, 0.02):
        modes = RingModes(UNIT.replace(zeta_n=zeta_n), [2, 3, 4], model)
        radial, _ = modes.amplitudes(modes.at(150.0).steady(-LOAD, 0.0))
        lag = np.abs(np.angle(-radial * np.exp(-1j * modes.numbers * ring.CONTACT_ANGLE)))
        assert (lag < 1e-12).all() if zeta_n == 0.0 else (lag > 1e-3).all()


# -- the ring's centre and the wheel ----------------------------------------------------------------------------


@models
@dampings
def test_the_centre_stays_above_the_contact_at_standstill_only(model, damping):
    """x_c = 0 at Omega = 0, in the steady state and on the way there; with modal damping x_c is not 0 otherwise."""
    unit, t = UNIT.replace(sidewall_damping=damping), np.linspace(0.0, 0.3, 301)
    response = simulate(unit, t, 0.0, LOAD, initial="rest", model=model)
    assert np.abs(response.ring_centre[:, 0]).max() == 0.0
    assert np.abs(response.ring_centre[:, 1]).max() > 1e-3
    for speed in (1.0, 100.0, -100.0):
        moving = simulate(unit, t, speed, LOAD, initial="rest", model=model).ring_centre[:, 0]
        assert np.abs(moving[1:]).max() > 1e-7 * abs(speed)
        steady = simulate(unit, [0.0], speed, LOAD, model=model).ring_centre[0, 0]
        if damping == "modal":
            # d Omega/kappa of the ring's height, which modal damping holds back: (2 zeta_1/omega_1) Omega y_c
            assert abs(steady) > 1e-6 * abs(speed)
        simulated = simulate(unit, t, -speed, LOAD, initial="rest", model=model).ring_centre[:, 0]
        assert np.abs(simulated + moving).max() <= 1e-12 * np.abs(moving).max()  # the other way, the other side


@models
@settings(max_examples=10)
@given(zeta_1=st.floats(0.01, 0.9))
def test_wheel_and_centre_sink_with_speed(model, zeta_1):
    """y and y_c, lifted by the load, fall with Omega (Figures 5 and 6), and alike whichever way it turns."""
    unit = UNIT.replace(zeta_1=zeta_1)
    responses = [simulate(unit, [0.0], rpm * RPM, LOAD, model=model) for rpm in np.linspace(0.0, 6000.0, 31)]
    y = np.array([response.wheel_displacement[0] for response in responses])
    y_c = np.array([response.ring_centre[0, 1] for response in responses])
    assert (np.diff(y) < 0.0).all() and (np.diff(y_c) < 0.0).all()
    assert (y > 0.0).all() and (y_c > 0.0).all()
    back = simulate(unit, [0.0], -6000.0 * RPM, LOAD, model=model)
    assert back.wheel_displacement[0] == pytest.approx(y[-1], rel=1e-12)


@models
@settings(max_examples=10)
@given(zeta_s=st.floats(0.0, 0.9), rpm=st.floats(0.0, 4000.0))
def test_transmissibility_does_not_depend_on_the_suspension_damper(model, zeta_s, rpm):
    """In the steady state; the paper's K = F'/F, of the simulated force, in either model."""
    K = [
        simulate(UNIT.replace(zeta_s=zeta), [0.0], rpm * RPM, LOAD, model=model).axle_force[0, 1] / LOAD
        for zeta in (0.05, zeta_s)
    ]
    assert K[0] == K[1]  # c_s does not enter the equilibrium at all


@pytest.mark.parametrize("zeta_1", [0.05, 0.2])
def test_transmissibility_is_where_the_motion_settles(zeta_1):
    """From rest, whatever zeta_s: after 20 s of decay by exp(-2 t) at the least."""
    t = np.linspace(0.0, 20.0, 2001)
    for zeta_s in (0.05, 0.5):
        unit = UNIT.replace(zeta_1=zeta_1, zeta_s=zeta_s)
        settled = simulate(unit, t, 2000.0 * RPM, LOAD, initial="rest").axle_force[-1, 1] / LOAD
        assert settled == pytest.approx(wheel.transmissibility(UNIT.replace(zeta_1=zeta_1), 2000.0 * RPM), rel=1e-9)


def test_transmissibility_falls_with_speed_and_with_ring_damping():
    rpm = np.linspace(0.0, 4000.0, 81)
    curves = np.array([wheel.transmissibility(UNIT.replace(zeta_1=z), rpm * RPM) for z in (0.02, 0.05, 0.1, 0.2)])
    assert (np.diff(curves, axis=1) < 0.0).all()
    assert (np.diff(curves[:, 1:], axis=0) < 0.0).all()
    assert (curves[:, 0] == 1.0).all()


# -- stability --------------------------------------------------------------------------------------------------

PRACTICAL = [0.01, 0.02, 0.05, 0.1, 0.2]  # damping ratios of tires; 1500 rpm is some 170 km/h


@models
@pytest.mark.parametrize("zeta_1", PRACTICAL)
def test_the_threshold_lies_far_above_1500_rpm(model, zeta_1):
    """For practical damping, and for any damping above it."""
    critical = wheel.critical_speed(UNIT.replace(zeta_1=zeta_1), model)
    assert critical / RPM > 4.0 * 1500.0
    for heavy in (0.5, 0.9):
        assert wheel.critical_speed(UNIT.replace(zeta_1=heavy), model) / RPM > 1500.0
    for rpm in np.linspace(0.0, 1500.0, 16):
        assert wheel.stability(UNIT.replace(zeta_1=zeta_1), rpm * RPM, model).verdict == "asymptotically stable"


@models
def test_the_threshold_is_moved_by_ring_damping_and_hardly_by_the_suspensions(model):
    """Figure 7. Ten times the ring's damping brings it down several times over; ten times the suspension's, little."""
    by_ring = [wheel.critical_speed(UNIT.replace(zeta_1=z), model) for z in (0.02, 0.05, 0.1, 0.2)]
    assert by_ring == sorted(by_ring, reverse=True)
    assert by_ring[0] / by_ring[-1] > 5.0
    for zeta_1 in (0.05, 0.2):
        by_suspension = [
            wheel.critical_speed(UNIT.replace(zeta_1=zeta_1, zeta_s=z), model) for z in (0.02, 0.05, 0.1, 0.2)
        ]
        assert max(by_suspension) / min(by_suspension) < 1.25


# -- critical speeds of a load that is fixed in space -----------------------------------------------------------


def amplitude(model, n, speed, zeta_n):
    modes = RingModes(UNIT.replace(zeta_n=zeta_n), [n], model)
    return abs(modes.amplitudes(modes.at(speed).steady(-LOAD, 0.0))[0][0])


TO_30000_RPM = np.linspace(0.0, 30_000.0, 601) * RPM


@pytest.mark.slow
@models
@pytest.mark.parametrize("n", [2, 3, 4, 5, 10])
def test_no_critical_speed_in_the_full_model(model, n):
    """Coriolis and centrifugal terms, with their tension, cancel: the undamped amplitude hardly knows the speed."""
    amplitudes = np.array([amplitude(model, n, speed, 0.0) for speed in TO_30000_RPM])
    assert np.isfinite(amplitudes).all()
    assert amplitudes.max() < 1.2 * amplitudes[0]
    damped = np.array([amplitude(model, n, speed, 0.02) for speed in TO_30000_RPM])
    assert damped.max() < 1.2 * damped[0]  # no resonance either


@pytest.mark.slow
@pytest.mark.parametrize("n", [2, 3, 4, 5, 10])
def test_one_critical_speed_per_mode_in_the_hybrid(n):
    """Where g_n = n^2 Omega^2: the amplitude has one peak, and what limits it is the damping alone."""
    damped = np.array([amplitude("hybrid", n, speed, 0.02) for speed in TO_30000_RPM])
    rises = np.diff(damped) > 0.0
    peak = int(np.argmin(rises))
    assert 0 < peak and rises[:peak].all() and not rises[peak:].any()
    assert damped[peak] > 5.0 * damped[0]
    g_less = [float(ring.natural_frequencies(UNIT, n, w, "hybrid")[0] - n * w) for w in TO_30000_RPM]
    crossings = np.nonzero(np.diff(np.sign(g_less)))[0]
    assert crossings.size == 1 and abs(int(crossings[0]) - peak) <= 2  # damping pulls the peak forward a little
    lighter = max(amplitude("hybrid", n, w, 0.002) for w in np.linspace(0.9, 1.1, 2001) * TO_30000_RPM[peak])
    assert lighter > 8.0 * damped[peak]  # a tenth of the damping, ten times the peak, but for the grid
