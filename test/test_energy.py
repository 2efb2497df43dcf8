"""Energy seen from the fixed frame: kept at any speed where nothing damps, never gained at standstill."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tire_dynamics import TireWheelUnit, wheel
from tire_dynamics.estimator.motion import Motion

UNDAMPED = TireWheelUnit.table_1(zeta_1=0.0, zeta_s=0.0, zeta_n=0.0)


def energy(unit, states):
    """m R'^2/2 + M y'^2/2 + k_1 |R - y e_Y|^2/2 + k_s y^2/2 of fixed-frame states [J], section 2.3."""
    X_dot, Y_dot, y_dot, X, Y, y = np.moveaxis(states, -1, 0)
    k_1 = math.pi * unit.radius * unit.width * (unit.radial_stiffness + unit.tangential_stiffness)
    m = 2.0 * math.pi * unit.radius * unit.width * unit.density * unit.thickness
    kinetic = 0.5 * m * (X_dot**2 + Y_dot**2) + 0.5 * unit.wheel_mass * y_dot**2
    return kinetic + 0.5 * k_1 * (X**2 + (Y - y) ** 2) + 0.5 * unit.suspension_stiffness * y**2


def states_along(unit, speeds, step, start):
    """Fixed-frame states after each of many steps [s] without a load, at a speed [rad/s] each."""
    motion, states = Motion(unit, "inextensional", 1), np.empty((len(speeds) + 1, 6))
    motion.put(0, start, speeds[0], 0.0)
    states[0] = start
    for k, speed in enumerate(speeds.tolist()):
        motion.advance(0, step, speed, 0.0)
        states[k + 1] = motion.state_of(0)
    return states


START = np.array([0.7, -1.1, 0.4, 2e-3, -1e-3, 3e-3])  # every motion in it: 3 J in kinetic, 7 J in springs


@pytest.mark.parametrize("damping", ["modal", "reaction"])
@pytest.mark.parametrize("speed", [0.0, 209.4, -480.0, 5000.0])
def test_energy_is_kept_without_damping(damping, speed):
    """1e5 steps at a constant speed, each rounded by 2^-53 or so: all of one sign they would add up to 1e-11."""
    unit = UNDAMPED.replace(sidewall_damping=damping)
    E = energy(unit, states_along(unit, np.full(100_000, speed), 1e-3, START))
    assert np.abs(E / E[0] - 1.0).max() < 1e-10


@pytest.mark.parametrize("step", [1e-4, 20e-3])
def test_energy_is_kept_whatever_the_step(step):
    """A step of 20 ms is taken in several pieces, with as many roundings more."""
    E = energy(UNDAMPED, states_along(UNDAMPED, np.full(20_000, 100.0), step, START))
    assert np.abs(E / E[0] - 1.0).max() < 1e-10


def test_energy_is_kept_while_the_speed_changes():
    """No Euler term is lost, and none is gained: of a spin that varies the fixed frame sees nothing."""
    speeds = np.repeat(400.0 * np.sin(np.arange(1000)), 20)
    E = energy(UNDAMPED, states_along(UNDAMPED, speeds, 1e-3, START))
    assert np.abs(E / E[0] - 1.0).max() < 1e-10
    motion = Motion(UNDAMPED, "inextensional", 1)
    motion.put(0, START, 0.0, 0.0)
    time = 1e-3 * np.arange(20_001)
    states, _ = motion.follow_lines(time, 400.0 * np.sin(50.0 * time), np.zeros((time.size, 2)))
    E = energy(UNDAMPED, states)
    assert np.abs(E / E[0] - 1.0).max() < 1e-10


DAMPED = [(0.05, 0.05), (0.5, 0.0), (0.0, 0.3), (0.9, 0.9)]


@pytest.mark.parametrize("damping", ["modal", "reaction"])
@pytest.mark.parametrize(("zeta_1", "zeta_s"), DAMPED)
def test_energy_never_grows_at_standstill(damping, zeta_1, zeta_s):
    """Every damper takes; an ulp or two of rounding apart, each step ends with less than it began with."""
    unit = UNDAMPED.replace(sidewall_damping=damping, zeta_1=zeta_1, zeta_s=zeta_s)
    rng = np.random.default_rng(8)
    for start in (START, *(rng.normal(size=(5, 6)) * np.repeat([1.0, 2e-3], 3))):
        E = energy(unit, states_along(unit, np.zeros(2000), 1e-3, start))
        assert (np.diff(E) <= 1e-14 * E[:-1]).all()
        assert E[-1] < 0.9 * E[0]


@pytest.mark.parametrize("damping", ["modal", "reaction"])
def test_energy_grows_beyond_the_critical_speed(damping):
    """A damper that turns with the ring feeds the motion: the same sum, at a speed at which the unit is unstable."""
    unit = TireWheelUnit.table_1(zeta_1=0.5, sidewall_damping=damping)
    critical = wheel.critical_speed(unit)
    for factor, grows in ((0.9, False), (1.1, True)):
        E = energy(unit, states_along(unit, np.full(5000, factor * critical), 1e-3, START))
        assert (E[-1] > E[0]) == grows
