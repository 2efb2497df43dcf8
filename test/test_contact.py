"""The tire on the road, at constant speed: what MODEL.md section 6 states, and the closed forms behind it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tire_dynamics import TireWheelUnit, ring, wheel
from tire_dynamics.science.coefficients import contact_patch_factor

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
    """MODEL 6, to the last printed digit."""
    assert ring.static_stiffness(unit, n_max) == pytest.approx(stiffness, abs=0.05)


def test_the_residual_spring_makes_up_for_the_belt():
    """MODEL 6, to the last printed digit; and whatever n_max is, the whole is what was asked for."""
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
