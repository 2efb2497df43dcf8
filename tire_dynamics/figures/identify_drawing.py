"""Coherence and frequency response: what was measured at an axle, and what the fitted unit has."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MultipleLocator, NullFormatter

from ..estimator.identification import Identification
from ..science import wheel
from .drawings import LINES, REMARK, WIDTH

__all__ = ["draw"]


def draw(found: Identification) -> Figure:
    """Coherence, ratio and phase over frequency at the speed with the most segments; the delay is taken out."""
    figure = Figure(figsize=(WIDTH, 6.2))
    axes = figure.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": (0.8, 1.5, 1.2)})
    fitted = ", ".join(f"{name} ±{100.0 * error:.2g} %" for name, error in zip(found.names, found.errors, strict=True))
    speed, transfer = found.seen[0]
    f = transfer.frequency
    measured = transfer.response * np.exp(2j * math.pi * f * found.delay)
    seen = transfer.coherence > 0.5
    coherence, ratio, phase = axes
    coherence.plot(f, transfer.coherence, color="0.25", linewidth=1.0)
    coherence.axhline(0.5, color="0.6", linewidth=0.6)
    coherence.set(ylabel="Coherence [-]", ylim=(0, 1.03))
    dots: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 2.6, "markeredgewidth": 0.0, "zorder": 3}
    for some, colour, label in ((~seen, "0.8", "measured, coherence < 0.5"), (seen, LINES[1]["color"], "measured")):
        ratio.plot(f[some], np.abs(measured[some]), color=colour, label=label, **dots)
        phase.plot(f[some], np.degrees(np.angle(measured[some])), color=colour, **dots)
    for unit, name, line in ((found.start, "started from", LINES[2]), (found.unit, "fitted", LINES[0])):
        H = wheel.frequency_response(unit, speed, f)[:, 1, 0]
        ratio.plot(f, np.abs(H), label=name, **line)
        angle = np.degrees(np.angle(H))
        jumps = np.abs(np.diff(angle, append=angle[-1])) > 180.0
        phase.plot(f, np.where(jumps, np.nan, angle), **line)
    ratio.set(ylabel="Force on the suspension\nover load [-]", yscale="log", xscale="log", xlim=(f[0], f[-1]))
    ratio.legend(loc="lower left")
    phase.set(ylabel="Phase [deg]", xlabel="Frequency [Hz]", ylim=(-190.0, 190.0))
    phase.yaxis.set_major_locator(MultipleLocator(90.0))
    phase.text(0.01, 0.06, f"without the delay of {1e3 * found.delay:.4g} ms", transform=phase.transAxes, **REMARK)
    phase.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    phase.xaxis.set_minor_formatter(NullFormatter())
    figure.align_ylabels()
    title = f"Load to axle at {speed:.3g} rad/s, {transfer.segments} segments of {1.0 / f[0]:.2g} s"
    figure.suptitle(f"{title}\n{fitted}", fontsize=8.5)
    return figure
