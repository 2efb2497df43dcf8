"""Force variation for the diagnostics: a known series, at any speed, in bounded memory."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tire_dynamics import TireWheelUnit
from tire_dynamics.estimator.settings import VehicleSettings
from tire_dynamics.estimator.wheels import Wheels
from tire_dynamics.ros.uniformity_monitor import UniformityMonitor, variation_of


def force(phi):
    return 4000.0 + 30.0 * np.cos(phi - 0.5) + 8.0 * np.cos(3.0 * (phi - 1.0))


def driven(speed, seconds, *, drift=0.0):
    """The force variation in samples of a drive at 500 Hz: those of the last ten turns and some."""
    time = np.arange(round(500 * seconds)) / 500.0
    time = time[-max(2, math.ceil(500 * 11 * 2.0 * math.pi / abs(speed))) :]
    phi = np.fmod(speed * time, 2.0 * math.pi)
    return variation_of(np.stack([phi, force(phi) + drift * time], axis=1))


class Known(UniformityMonitor):
    """What the diagnostics say of a variation."""

    def __init__(self, found):
        self._found, self._samples = [None, None], [np.empty((0, 2)), np.empty((0, 2))]
        self.keep(1, found)


@pytest.mark.parametrize(("speed", "seconds"), [(100.0, 5.0), (-100.0, 5.0), (5.0, 30.0), (900.0, 3.0)])
def test_a_known_series(speed, seconds):
    """To the last printed digit; at 900 rad/s a turn has three or four ticks, and no third harmonic can be told."""
    values = Known(driven(speed, seconds)).values(1)
    sizes, phases = (values[f"RFV {what}"].split() for what in ("by harmonic [N]", "phase by harmonic [deg]"))
    assert len(sizes) == len(phases) == 10 and float(values["RFV over [turns]"]) >= 10.0
    if abs(speed) < 900.0:
        assert float(sizes[0]) == pytest.approx(60.0, abs=0.06) and float(sizes[2]) == pytest.approx(16.0, abs=0.06)
        assert float(phases[0]) == pytest.approx(math.degrees(0.5), abs=0.06)
        assert float(phases[2]) == pytest.approx(math.degrees(1.0), abs=0.06)
        assert float(sizes[1]) == pytest.approx(0.0, abs=0.06)
    else:
        assert sizes[2:] == ["-"] * 8


def test_a_load_that_rises_is_no_harmonic():
    """30 N with each turn would be 20 N of the first harmonic without the window (its sawtooth has 2 * 30/pi)."""
    values = Known(driven(100.0, 5.0, drift=30.0 * 100.0 / (2.0 * math.pi))).values(1)
    assert float(values["RFV by harmonic [N]"].split()[0]) == pytest.approx(60.0, abs=0.5)


@pytest.mark.parametrize(("speed", "most"), [(0.0, 1), (0.3, 70), (100.0, 500), (-100.0, 500)])
def test_what_is_kept_is_bounded(speed, most):
    """Each 200th of a turn, at 500 Hz: a wheel that stands keeps one sample, one that crawls few."""
    wheels = Wheels(VehicleSettings(TireWheelUnit.table_1(), ("left", "right"), ("left", "right")))
    found = UniformityMonitor(wheels)
    for tick in range(1, 2501):
        now = tick * 2_000_000
        if tick % 10 == 1:
            wheels.add_speed(1, now, now, speed)
            wheels.add_load(1, now, now, 4000.0)
        wheels.tick(now)
        if tick % 500 == 0:
            fresh = wheels.noted_orders(1)
            assert len(fresh) <= most
            turned = np.abs(np.mod(np.diff(fresh[:, 0]) + math.pi, 2.0 * math.pi) - math.pi)
            assert (turned >= 2.0 * math.pi / 200.0 * (1.0 - 1e-12)).all()
    assert len(found.taken(0)) == 0 and found.values(0) == {"RFV [N]": "-"}, "a wheel without inputs"
    found.keep(1, variation_of(found.taken(1)))
    assert len(found.taken(1)) <= 16384, "what finds no more room is left out"
