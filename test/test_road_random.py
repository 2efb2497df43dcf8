"""Random tires on random roads, speeds of either sign, lift-off: steps against DOP853 with events.

At speeds that vary in ring axes (``test_contact_step.OnTheRoad``), where the contact runs around; with a wheel that
gives fore and aft in the fixed frame, at a constant speed. What is asserted is that the error falls with the square of
the step.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from test_contact_step import LOAD, OnTheRoad, some_drive, some_unit
from test_road_motion import driven

from tire_dynamics.science import contact

SEEDS = st.integers(0, 2**32 - 1)


class InTheFixedFrame:
    """At a constant speed: z' = A z + push F + weight W, F from the spring while it presses."""

    def __init__(self, unit, model, n_max, drive):
        self.drive = drive
        self.system = contact.open_system(unit, float(drive.speed[0]), model, n_max)
        self.start, self.height, self.weight = contact.standing(self.system, LOAD)

    def spring(self, t, z, begin):
        _, _, _, height, _ = self.drive.at(t, begin)
        rises = (self.drive.at(begin + 1e-4, begin)[3] - self.drive.at(begin, begin)[3]) / 1e-4
        system = self.system
        pressed = system.stiffness * (self.height + height + system.contact @ z)
        return pressed + system.damping * (rises + system.rate @ z)

    def run(self):
        """[axle x, axle z, contact force] at the drive's times, and how often contact was lost or found."""
        system, z, touching, events = self.system, self.start, True, 0
        found = [[*system.output @ z, LOAD]]
        for begin, end in zip(self.drive.t[:-1], self.drive.t[1:], strict=True):
            t = begin
            if system.damping:  # whose force jumps with the road's slope
                touching = self.spring(t, z, begin) > 0.0
            while t < end:

                def slope(t, z, begin=begin, touching=touching):
                    force = self.spring(t, z, begin) if touching else 0.0
                    return system.matrix @ z + system.push * force + system.weight * self.weight

                def crossing(t, z, begin=begin):
                    return self.spring(t, z, begin)

                crossing.terminal, crossing.direction = True, -1.0 if touching else 1.0
                part = solve_ivp(slope, (t, end), z, method="DOP853", rtol=1e-10, atol=1e-13, events=crossing)
                t, z = part.t[-1], part.y[:, -1]
                if part.status == 1:
                    touching, events = not touching, events + 1
            found.append([*system.output @ z, self.spring(end, z, begin) if touching else 0.0])
        return np.array(found), events


def check(oracle, seed, varying, changes):
    random = np.random.default_rng(seed)
    unit, drive = some_unit(random).replace(**changes(random)), some_drive(random, varying)
    model = str(random.choice(["inextensional", "complete"]))
    n_max = int(random.integers(2, 4))
    if model == "complete" and not varying:
        n_max = 2
    expected, _ = oracle(unit, model, n_max, drive).run()
    errors = [
        np.sqrt(((driven(unit, model, n_max, drive, parts) - expected) ** 2).mean(axis=0)) for parts in (8, 32)
    ]
    # sixteen, but for the next order; a damper's force at a step's end is of the first, that of a mean rate
    factors = np.array([12.0, 12.0, 3.5 if unit.residual_damping else 12.0])
    floor = 1e-6 * np.abs(expected).max()  # what DOP853 leaves, some 1e-7
    assert (errors[1] <= np.maximum(errors[0] / factors, floor)).all(), (errors, unit, drive.speed, drive.radial)
    assert errors[1].max() < 5e-3 * np.abs(expected).max()


def fore_and_aft(random):
    return {
        "longitudinal_stiffness": random.uniform(5e4, 1e6),
        "longitudinal_damping_ratio": random.uniform(0.0, 0.5),
        "longitudinal_mass": random.choice([0.0, 30.0]),
    }


def as_it_is(random):
    return {}


@pytest.mark.slow
@given(seed=SEEDS)
@settings(max_examples=2)
def test_speeds_that_vary_and_turn_around(seed):
    check(OnTheRoad, seed, True, as_it_is)


@pytest.mark.slow
@given(seed=SEEDS)
@settings(max_examples=4)
def test_a_wheel_that_gives_fore_and_aft(seed):
    check(InTheFixedFrame, seed, False, fore_and_aft)


@pytest.mark.nightly
@pytest.mark.slow
@given(seed=SEEDS)
@settings(max_examples=40)
def test_many_of_both(seed):
    check(OnTheRoad, seed, True, as_it_is)
    check(OnTheRoad, seed, False, as_it_is)
    check(InTheFixedFrame, seed, False, fore_and_aft)
