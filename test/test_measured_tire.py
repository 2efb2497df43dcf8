"""docs/measured_tire.md: published measurements beside the model, every number of the page."""

from __future__ import annotations

import math
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from tire_dynamics import TireWheelUnit, ring, simulate, wheel
from tire_dynamics.figures import measured_tire
from tire_dynamics.science.nonuniform import Nonuniformity, state_matrix

PAGE = (Path(__file__).parents[1] / "docs" / "measured_tire.md").read_text(encoding="utf-8")
RPM = math.pi / 30.0
SPEED, RADIAL, TANGENTIAL = np.array(measured_tire.MEASURED).T
UNIT = TireWheelUnit.table_1()
fit = cache(measured_tire.fit)


def test_the_data_are_those_of_the_source():
    """Du et al. 2020, the table of speeds: H1RFV and H1TFV."""
    assert SPEED.tolist() == [120, 140, 160, 180, 200, 220, 240]
    assert RADIAL.tolist() == [152.9, 194.4, 247.1, 310.9, 388.5, 470.7, 553.4]
    assert TANGENTIAL.tolist() == [148.4, 232.2, 356.4, 503.2, 652.1, 757.0, 845.5]


def test_radial_within_3_percent_and_held_out_within_5():
    found = fit()
    off = found.radial / RADIAL - 1.0
    held_out = np.isin(SPEED, measured_tire.HELD_OUT)
    assert held_out.sum() == 2
    assert np.abs(off[~held_out]).max() < 0.03
    assert np.abs(off[held_out]).max() < 0.05


@pytest.mark.parametrize("held_out", [(180, 240), (120, 240), (140, 200), (120, 140)])
def test_any_two_speeds_can_be_held_out(held_out):
    """The two highest or the lowest among them, which asks for an extrapolation."""
    off = np.abs(fit(held_out).radial / RADIAL - 1.0)
    out = np.isin(SPEED, held_out)
    assert off[~out].max() < 0.03 and off[out].max() < 0.05


def test_the_page_has_these_numbers():
    found = fit()
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in PAGE.splitlines()
        if re.match(r"\| \d{3}", line)
    ]
    assert [int(row[0][:3]) for row in rows] == SPEED.tolist()
    assert ["held out" in row[0] for row in rows] == np.isin(SPEED, measured_tire.HELD_OUT).tolist()
    numbers = np.array([[float(cell.removesuffix(" %")) for cell in row[1:]] for row in rows]).T
    np.testing.assert_array_equal(numbers[[0, 3]], [RADIAL, TANGENTIAL])
    np.testing.assert_allclose(numbers[[1, 4]], [found.radial, found.tangential], atol=0.051)
    np.testing.assert_allclose(numbers[2], 100.0 * (found.radial / RADIAL - 1.0), atol=0.051)
    np.testing.assert_allclose(numbers[5], 100.0 * (found.tangential / TANGENTIAL - 1.0), atol=0.51)
    assert 1e3 * found.runout == pytest.approx(0.104, abs=6e-4)
    assert 1e3 * found.imbalance == pytest.approx(17.0, abs=0.06)
    assert math.degrees(found.angle) == pytest.approx(177.0, abs=0.6)
    for words in ("0.104 mm of run-out, 17.0 g on the belt, 177 degrees", "within 1.1 %", "12 % at 120", "39 % at 200"):
        assert words in PAGE


def test_a_rigid_tire_fits_as_well():
    """So the radial measurement says nothing of the ring; the page says so."""
    turns = SPEED / SPEED[-1]
    used = ~np.isin(SPEED, measured_tire.HELD_OUT)

    def rigid(x):
        return np.abs(x[0] + x[1] * turns**2 * np.exp(1j * x[2]))

    starts = ([50.0, 500.0, angle] for angle in (0.0, 1.5, 3.0))
    best = min((least_squares(lambda x: rigid(x)[used] / RADIAL[used] - 1.0, x) for x in starts), key=lambda f: f.cost)
    assert np.abs(rigid(best.x) / RADIAL - 1.0).max() < 0.011


def test_the_tangential_model_is_too_small_everywhere():
    off = fit().tangential / TANGENTIAL - 1.0
    assert -0.40 < off.min() and off.max() < -0.11


@pytest.mark.slow
def test_the_steps_give_the_fitted_forces():
    """`simulate` on a flat road, the wheel on a support a thousand times the sidewall: 200 km/h, over ten turns."""
    found = fit()
    unit = measured_tire.measured_unit().replace(
        suspension_stiffness=1e3 * UNIT.sidewall_stiffness, zeta_s=0.0, wheel_mass=1.0,
        radial_runout=[(1, found.runout, 0.0)], imbalance_mass=found.imbalance, imbalance_angle=found.angle,
    )  # fmt: skip
    speed = 200.0 / 3.6 / unit.radius
    t = 2.5e-4 * np.arange(2400)
    forces = simulate(unit, t, speed, road=0.0, static_load=4000.0, n_max=30, model="complete").axle_force
    last = t > 0.3
    wave = np.exp(1j * speed * t[last])
    columns = np.column_stack([wave.real, wave.imag, np.ones(last.sum())])
    sizes = [2.0 * math.hypot(*np.linalg.lstsq(columns, forces[last, k], rcond=None)[0][:2]) for k in (1, 0)]
    k = SPEED.tolist().index(200)
    assert sizes == pytest.approx([found.radial[k], found.tangential[k]], rel=0.01)


# -- statements -----------------------------------------------------------------------------------------------------


def frequencies(unit, n_max, model):
    """Of all modes to n_max with the wheel, undamped, at rest [Hz], each once."""
    A = state_matrix(unit, Nonuniformity(), 1e-9, 0.0, model, n_max)
    return np.sort(np.abs(np.linalg.eigvals(A).imag))[::2] / (2.0 * math.pi)


@pytest.mark.parametrize("model", ["inextensional", "complete"])
def test_freeing_the_wheel_changes_only_n_1(model):
    """Kung, Soedel & Yang 1987: of the whole system's frequencies those of n = 1 move, and no other."""
    unit = UNIT.replace(zeta_1=0.0, zeta_n=0.0, zeta_s=0.0)
    held = unit.replace(wheel_mass=1e9, suspension_stiffness=1e9)
    waves = [f for n in range(2, 7) for f in ring.natural_frequencies(unit, n, 0.0, model) / (2.0 * math.pi)]
    for each in (unit, held):
        found = frequencies(each, 6, model)
        for f in waves:
            assert np.abs(found - f).min() < 1e-5 * f
    free, fixed = (np.sort(frequencies(each, 1, model)) for each in (unit, held))
    assert np.abs(fixed - 78.4).min() < 0.15 and np.abs(free - 101.4).min() < (0.05 if model == "complete" else 0.4)
    assert np.abs(free - 7.9).min() < 0.05 and np.abs(fixed - 101.4).min() > 20.0


@pytest.mark.parametrize("model", ["inextensional", "complete"])
@pytest.mark.parametrize("n", [2, 3, 5])
def test_rotation_splits_forward_and_backward_waves(model, n):
    """One frequency at rest; turning, the forward wave's is lower on the ring, the more the faster."""
    splits = []
    for rpm in (0.0, 200.0, 400.0):
        forward, backward = ring.natural_frequencies(UNIT, n, rpm * RPM, model)[:2]
        splits.append(backward - forward)
        turned = ring.natural_frequencies(UNIT, n, -rpm * RPM, model)[:2]
        np.testing.assert_allclose(turned, [forward, backward], rtol=1e-9)
    assert abs(splits[0]) < 1e-4 and splits[2] == pytest.approx(2.0 * splits[1], rel=0.05) and splits[1] > 1.0


def test_the_split_that_the_page_gives():
    at_rest, turning = (ring.natural_frequencies(UNIT, 2, rpm * RPM)[:2] / (2.0 * math.pi) for rpm in (0.0, 1000.0))
    assert at_rest == pytest.approx([91.2, 91.2], abs=0.05) and turning == pytest.approx([79.2, 107.0], abs=0.05)
    values = np.linalg.eigvals(wheel.fixed_frame_matrix(UNIT.replace(zeta_1=0.0, zeta_s=0.0), 0.0, "complete"))
    for f in (7.9, 78.4, 101.4):
        assert np.abs(np.abs(values.imag) / (2.0 * math.pi) - f).min() < 0.05
