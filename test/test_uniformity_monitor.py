"""Force variation for the diagnostics: a known series, at any speed, in bounded memory."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tire_dynamics.estimator.vehicle import Output
from tire_dynamics.ros.uniformity_monitor import UniformityMonitor


def force(phi):
    return 4000.0 + 30.0 * np.cos(phi - 0.5) + 8.0 * np.cos(3.0 * (phi - 1.0))


def driven(speed, seconds, *, drift=0.0, wheels=(1,)):
    """After driving at 500 Hz, looked at as the node does: four times a second, one of two wheels each time."""
    found = UniformityMonitor(2)
    for tick in range(round(500 * seconds)):
        time = tick / 500.0
        phi = math.fmod(speed * time, 2.0 * math.pi)
        found.note(np.array([phi, phi]), [Output(index, 0.0, force(phi) + drift * time) for index in wheels])
        if tick % 125 == 0:
            found.update((tick // 125) % 2)
    return found


@pytest.mark.parametrize(("speed", "seconds"), [(100.0, 5.0), (-100.0, 5.0), (5.0, 30.0), (900.0, 3.0)])
def test_a_known_series(speed, seconds):
    """To the last printed digit; at 900 rad/s a turn has three or four ticks, and no third harmonic can be told."""
    values = driven(speed, seconds).values(1)
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
    values = driven(100.0, 5.0, drift=30.0 * 100.0 / (2.0 * math.pi)).values(1)
    assert float(values["RFV by harmonic [N]"].split()[0]) == pytest.approx(60.0, abs=0.5)


@pytest.mark.parametrize("speed", [0.0, 0.3, 100.0])
def test_what_is_kept_is_bounded(speed):
    """A wheel that stands or crawls keeps no more than ten turns' worth."""
    found = driven(speed, 60.0)
    assert len(found._samples[1]) <= 2300
    assert found._samples[0] == [] and found.values(0) == {"RFV [N]": "-"}
