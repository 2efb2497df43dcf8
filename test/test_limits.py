"""docs/limits.md: what the model leaves out is as large as the page says, and what it says of the model is so."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from tire_dynamics import TireWheelUnit, ring, wheel
from tire_dynamics.science.modes import RingModes
from tire_dynamics.science.nonuniform import Nonuniformity, stability

UNIT = TireWheelUnit.table_1()
RPM = math.pi / 30.0
MODELS = ("inextensional", "complete")
PAGE = (Path(__file__).parents[1] / "docs" / "limits.md").read_text(encoding="utf-8")


def test_the_complete_ring_has_the_same_static_shape_at_every_speed():
    """No critical speed, hence no standing wave: the page says so, and the verdict on a speed says nothing of it."""
    unit = UNIT.replace(zeta_n=0.0)
    modes = RingModes(unit, list(range(2, 11)), "complete")
    at_rest, _ = modes.amplitudes(modes.at(0.0).steady(-2000.0, 0.0))
    for rpm in (500.0, 1500.0, 6000.0, 30_000.0):
        turning, _ = modes.amplitudes(modes.at(rpm * RPM).steady(-2000.0, 0.0))
        # the membrane's stiffness, which cancels, is 1e3 times what is left, and the centrifugal one 1e2 times that
        np.testing.assert_allclose(turning, at_rest, rtol=1e-7)
    assert "**That a unit is stable at a speed says nothing about standing waves.**" in PAGE


def test_no_backward_wave_stands_still():
    """They run faster on the belt than the belt turns: with tension alone they would stand, n omega = n Omega."""
    for n in range(2, 31):
        for rpm in (1000.0, 10_000.0, 100_000.0):
            backward = ring.natural_frequencies(UNIT, n, rpm * RPM)[1]
            assert backward > n * rpm * RPM
    # 1e9 rpm: nothing but the tension counts
    assert ring.natural_frequencies(UNIT, 2, 1e8 * RPM)[1] == pytest.approx(2 * 1e8 * RPM, rel=1e-3)


def rows():
    for line in PAGE.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if re.fullmatch(r"\d+", cells[0]) and len(cells) == 7:
            yield float(cells[0]), [float(cell.removesuffix(" %")) for cell in cells[1:]]


def test_errors_of_the_inextensional_waves():
    """Forward and backward waves n = 2, 3, 4; (3.2) against (3.10)."""
    stated = list(rows())
    assert [rpm for rpm, _ in stated] == [0.0, 1000.0, 2000.0, 3000.0, 6000.0]
    for rpm, percent in stated:
        found = []
        for n in (2, 3, 4):
            # ascending: forward is the slower one on the ring, backward the faster; the complete ring's first two
            inextensional, complete = (ring.natural_frequencies(UNIT, n, rpm * RPM, model) for model in MODELS)
            found += [100.0 * (inextensional[k] / complete[k] - 1.0) for k in (0, 1)]
        np.testing.assert_allclose(percent, found, atol=0.0055 if rpm == 0.0 else 0.0501)
    at_1500 = [ring.natural_frequencies(UNIT, 2, 1500.0 * RPM, model)[0] for model in MODELS]
    assert 100.0 * (at_1500[0] / at_1500[1] - 1.0) == pytest.approx(2.5, abs=0.05)


def test_the_share_of_the_pressure():
    """Dead pressure adds p_0 (n^2 - 1)^2/(n^2 rho h a) to a ring that cannot stretch, one that follows n^2 - 1.

    Source of both: a ring under outside pressure buckles at n^2 D/a^3 if that keeps its direction, at (n^2 - 1) D/a^3
    if it follows (S. R. Bodner, J. Aeronautical Sciences 25, 1958), where it outdoes (n^2 - 1)^2 D/a^4 of bending.
    """
    stiff = UNIT.replace(membrane_stiffness=1e5 * UNIT.membrane_stiffness)
    inertia = UNIT.density * UNIT.thickness * UNIT.radius
    for n, percent in ((2, 3.0), (3, 2.7)):
        step = 1e4
        squares = [
            float(ring.natural_frequencies(stiff.replace(inflation_pressure=p), n, 0.0, "inextensional")[0]) ** 2
            for p in (UNIT.inflation_pressure, UNIT.inflation_pressure + step)
        ]
        dead = (n * n - 1.0) ** 2 / (n * n)
        assert (squares[1] - squares[0]) * (1.0 + 1.0 / n**2) == pytest.approx(step / inertia * dead, rel=1e-3)
        follower = n * n - 1.0
        assert follower / dead == pytest.approx(n * n / (n * n - 1.0))
        extra = UNIT.inflation_pressure / inertia * (follower - dead) / (1.0 + 1.0 / n**2)
        omega_2 = float(ring.natural_frequencies(UNIT, n, 0.0, "inextensional")[0]) ** 2
        assert 100.0 * (math.sqrt(1.0 + extra / omega_2) - 1.0) == pytest.approx(percent, abs=0.05)
    # n = 1: a rigid displacement of ring and pressure; nothing of either
    units = [UNIT.replace(inflation_pressure=p) for p in (1e5, 9e5)]
    frequencies = [ring.natural_frequencies(unit, 1, 0.0, "inextensional") for unit in units]
    np.testing.assert_allclose(*frequencies, rtol=1e-12)


@pytest.mark.parametrize(("n", "percent"), [(2, 0.01), (10, 0.7), (30, 5.9)])
def test_rotary_inertia_that_is_left_out(n, percent):
    """T gains rho h^3/12 (d/dt (u_z' - u_theta)/a)^2, over rho h (u_z^2 + u_theta^2), u_z = cos, u_theta = -sin/n."""
    theta = np.linspace(0.0, 2.0 * math.pi, 1000, endpoint=False)
    rotation = (-n + 1.0 / n) * np.sin(n * theta) / UNIT.radius
    moving = np.cos(n * theta) ** 2 + (np.sin(n * theta) / n) ** 2
    share = UNIT.thickness**2 / 12.0 * np.mean(rotation**2) / np.mean(moving)
    assert 100.0 * (1.0 - 1.0 / math.sqrt(1.0 + share)) == pytest.approx(percent, abs=0.06)


def test_the_air_inside():
    assert 343.0 / (2.0 * math.pi * UNIT.radius) == pytest.approx(179.0, abs=0.5)  # c of air at 20 degrees


def test_which_harmonics_of_a_sidewall_reach_the_wheel():
    """The second acts on n = 1 by itself; the third only through n = 2."""
    alone, coupled = (
        stability(UNIT, Nonuniformity(((j, 0.1, 0.0),)), 400.0, n_max=n_max).exponents.real.max()
        - stability(UNIT, Nonuniformity(), 400.0, n_max=n_max).exponents.real.max()
        for j, n_max in ((3, 1), (3, 2))
    )
    assert alone == 0.0 and coupled != 0.0
    second = stability(UNIT, Nonuniformity(((2, 0.1, 0.0),)), 400.0).multipliers
    assert np.abs(np.sort(np.abs(second)) - np.sort(np.abs(wheel.stability(UNIT, 400.0).multipliers))).max() > 1e-6
