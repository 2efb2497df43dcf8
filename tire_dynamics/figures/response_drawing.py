"""Bode plots of a frequency response."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MultipleLocator, NullFormatter

from .bode import Bode
from .drawings import LINES, MARKERS, WIDTH

__all__ = ["draw"]

# output and input, as indices of the response, where each stands
OUTPUTS = ((1, "Vertical: $F'$, up, on the suspension"), (0, "Horizontal: force.x, forward, on the axle"))
INPUTS = ((0, "load"), (1, "traction"))
NOTHING = 1e-12  # a ratio below it is rounding, and has no phase: the cross terms at standstill or without damping


def draw(bode: Bode) -> Figure:
    """Amplitude ratio and phase of both axle forces per load and per traction, a line for each speed."""
    figure = Figure(figsize=(WIDTH, 7.4))
    axes = figure.subplots(4, 2, sharex=True, gridspec_kw={"height_ratios": (1.5, 1.0, 1.5, 1.0)})
    lines = [_line(k, len(bode.speeds)) for k in range(len(bode.speeds))]
    for column, (output, title) in enumerate(OUTPUTS):
        axes[0, column].set_title(title)
        for number, (entry, name) in enumerate(INPUTS):
            ratio, phase = axes[2 * number : 2 * number + 2, column]
            _panel(ratio, phase, bode, output, entry, lines)
            road = bode.contact and entry == 0
            name = "road's height" if road else name
            if column == 0:
                ratio.set_ylabel(f"Ratio to the {name} [{'N/m' if road else '-'}]")
                phase.set_ylabel(f"Phase to the\n{name} [deg]")
        axes[-1, column].set_xlabel("Frequency [Hz]")
    axes[0, 0].set(xscale="log", xlim=(bode.frequencies[0], bode.frequencies[-1]))
    axes[0, 0].xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes[0, 0].xaxis.set_minor_formatter(NullFormatter())
    figure.align_ylabels()
    unit = bode.unit
    fixed = rf"$\zeta_1$ = {unit.zeta_1:.4g}, $\zeta_s$ = {unit.zeta_s:.4g}, $M$ = {unit.wheel_mass:.4g} kg, "
    fixed += rf"$m$ = {unit.ring_mass:.4g} kg, $k_1$ = {unit.sidewall_stiffness / 1e6:.4g} MN/m, "
    fixed += rf"$k_s$ = {unit.suspension_stiffness / 1e3:.4g} kN/m"
    model = f"{bode.model} model, {unit.sidewall_damping} damping of the sidewall"
    given = "road height" if bode.contact else "load"
    figure.suptitle(f"Axle force per {given} and traction, sines; {model}\n{fixed}", fontsize=8.5)
    handles = [
        Line2D([], [], label=f"{speed:g} rpm{', unstable' if verdict == 'unstable' else ''}", **line)
        for speed, verdict, line in zip(bode.speeds, bode.verdicts, lines, strict=True)
    ]
    whirl = "whirl" if bode.contact else "whirl, $n = 1$"
    handles.append(Line2D([], [], color="0", marker="o", label=whirl, **MARKERS))
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 4))
    return figure


def _line(k: int, count: int) -> dict[str, Any]:
    """Of a speed: one of the package's lines, or of many speeds a colour between dark and light."""
    if count <= len(LINES):
        return LINES[k]
    return {"color": matplotlib.colormaps["viridis"](0.92 * k / (count - 1)), "linestyle": "-"}


def _panel(ratio: Axes, phase: Axes, bode: Bode, output: int, entry: int, lines: list[dict[str, Any]]) -> None:
    f = bode.frequencies
    extremes = []
    for k, line in enumerate(lines):
        H = bode.response[k, :, output, entry]
        size = np.where(np.abs(H) > NOTHING, np.abs(H), np.nan)
        angle = np.where(np.isnan(size), np.nan, _degrees(H))
        if np.isnan(size).all():
            continue
        extremes += [np.nanmin(angle), np.nanmax(angle)]
        marks = bode.whirl[k][(bode.whirl[k] >= f[0]) & (bode.whirl[k] <= f[-1])]
        for ax, values in ((ratio, size), (phase, angle)):
            ax.plot(f, values, **line)
            at = np.interp(np.log(marks), np.log(f), values)
            ax.plot(marks, at, color=line["color"], marker="o", zorder=3, **MARKERS)
    if not extremes:
        ratio.text(0.5, 0.5, "none", transform=ratio.transAxes, ha="center", color="0.25")
        for ax in (ratio, phase):
            ax.set_yticks([])
    else:
        ratio.set_yscale("log")
        low, high = 90.0 * np.floor(min(extremes) / 90.0), 90.0 * np.ceil(max(extremes) / 90.0)
        phase.set_ylim(low - 15.0, max(high, low + 90.0) + 15.0)
        phase.yaxis.set_major_locator(
            MultipleLocator(720.0 if high - low > 1440.0 else 180.0 if high - low > 360.0 else 90.0)
        )


def _degrees(H: Any) -> Any:
    """The phase without jumps, from between -179 and 181 degrees on."""
    angle = np.degrees(np.unwrap(np.angle(H)))
    return angle - 360.0 * np.round((angle[0] - 1.0) / 360.0)
