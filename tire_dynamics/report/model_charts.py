"""Charts of what the model says about the tire: Campbell diagram and stability map, with what was driven."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from .findings import critical_range, number
from .gather import Drive, Wheel
from .theory import RPM, Bands, campbell
from .traces import BAND, INK, SOFT, Figure, line, log_axis, rows_layout, typed, wheel_colour

__all__ = ["campbell_figure", "stability_figure"]

_MODES = {
    "wheel_hop": ("wheel hop", "$line0", "solid"),
    "ring_fore_aft": ("ring fore-aft", "$line1", "solid"),
    "ring_vertical": ("ring vertical", "$line2", "solid"),
    "n_2_backward": ("n = 2 backward", "$line3", "dash"),
    "n_2_forward": ("n = 2 forward", "$line3", "dashdot"),
    "n_3_backward": ("n = 3 backward", "$line4", "dash"),
    "body": ("body", "$line5", "solid"),
    "wheel_fore_aft": ("wheel fore-aft", "$line6", "solid"),
    "n_3_forward": ("n = 3 forward", "$line4", "dashdot"),
}


def campbell_figure(drive: Drive, highest: float) -> Figure:
    """Frequencies and decay rates over speed, with the driven speeds."""
    fastest = max(1.5 * highest, 1000.0 * RPM)
    diagram = campbell(drive.unit, fastest, drive.parameters["model"], drive.contact_modes)
    rpm = diagram.speed / RPM
    top = 1.15 * max(float(np.nanmax(value)) for value in diagram.frequency.values())
    traces = []
    if diagram.every is not None:
        traces += _all_modes(rpm, *diagram.every, top)
    for name, frequency in diagram.frequency.items():
        label, colour, dash = _MODES[name]
        for row, (value, unit) in enumerate(((frequency, "Hz"), (diagram.decay[name], "1/s"))):
            traces.append(
                line(rpm, value, colour, label, row, group=name, width=2.0, dash=dash)
                | {"hovertemplate": f"%{{y:.1f}} {unit} at %{{x:.0f}} rpm<extra>{label}</extra>"}
                | {"showlegend": row == 0}
            )
    ends = rpm[[0, -1]]
    for order in (1, 2, 3, 4):
        traces.append(
            line(ends, order * ends / 60.0, SOFT, "orders 1 to 4 of the rotation", group="orders", width=0.8)
            | {"showlegend": order == 1, "hovertemplate": f"order {order}<extra></extra>"}
        )
    layout = rows_layout(("Frequency [Hz]", "Decay rate [1/s]"), "Speed [rpm]", heights=(2, 1)) | {"height": 640}
    layout["xaxis"]["range"] = [0.0, rpm[-1]]
    layout["yaxis"]["range"] = [0.0, top]
    layout["yaxis2"]["rangemode"] = "tozero"
    slow, fast = _driven(drive.wheels)
    layout["shapes"] = [
        {"type": "rect", "xref": "x", "yref": "paper", "x0": slow / RPM, "x1": fast / RPM, "y0": 0, "y1": 1}
        | {"fillcolor": BAND, "line": {"width": 0}, "layer": "below"}
    ]
    layout["annotations"] = [
        {"xref": "x", "yref": "paper", "x": 0.5 * (slow + fast) / RPM, "y": 1.0, "yanchor": "top", "showarrow": False}
        | {"text": "driven", "font": {"color": SOFT, "size": 12}}
    ]
    return {"data": traces, "layout": layout}


def _all_modes(rpm: Any, frequency: Any, decay: Any, top: float) -> list[Figure]:
    """All modes on the road as points."""
    row, mode = np.nonzero(frequency < top)
    look = {"mode": "markers", "marker": {"size": 2.5, "color": SOFT}, "hoverinfo": "skip"}
    return [
        line(rpm[row], values[row, mode], SOFT, "all modes", place, group="every") | look | {"showlegend": place == 0}
        for place, values in enumerate((frequency, decay))
    ]


def _driven(wheels: Iterable[Wheel]) -> tuple[float, float]:
    """Least and greatest speed of all wheels, either way [rad/s]."""
    found = [wheel.numbers["speed"] for wheel in wheels if wheel.numbers["speed"].count]
    fast = max((max(abs(each.low), abs(each.high)) for each in found), default=0.0)
    slow = min((max(each.low, -each.high, 0.0) for each in found), default=0.0)
    return slow, fast


def stability_figure(drive: Drive, grid: Any, critical: float | None, band: Bands | None = None) -> Figure:
    """How fast the slowest motion decays or grows over speed and zeta_1, where the drive was, and the limit."""
    least = float(grid.abscissa.min())
    size = max(-1.5 * least if least < 0.0 else float(np.quantile(grid.abscissa, 0.9)), 1e-9)
    line_x: list[float | None] = []
    line_y: list[float | None] = []
    for one, other in grid.segments.tolist():
        line_x += [grid.boundary[one, 0] / RPM, grid.boundary[other, 0] / RPM, None]
        line_y += [grid.boundary[one, 1], grid.boundary[other, 1], None]
    traces: list[Figure] = [
        {
            "type": "heatmap",
            "x": typed(grid.x / RPM),
            "y": typed(grid.y),
            "z": typed(np.clip(grid.abscissa, -size, size)) | {"shape": ",".join(map(str, grid.abscissa.shape))},
            "zsmooth": "best",
            "zmin": -size,
            "zmax": size,
            "colorscale": [[0.0, "$stable"], [0.5, "$paper"], [1.0, "$unstable"]],
            "colorbar": {"title": {"text": "growth rate of the slowest motion [1/s]", "side": "bottom"}, "len": 0.9}
            | {"orientation": "h", "thickness": 10, "y": -0.2, "yanchor": "top", "outlinewidth": 0},
            "hovertemplate": "%{x:.0f} rpm, zeta_1 = %{y:.3f}: %{z:.3g} 1/s<extra></extra>",
        },
        {"type": "scatter", "mode": "lines", "x": line_x, "y": line_y, "line": {"color": INK, "width": 2}}
        | {"name": "limit of stability", "hoverinfo": "skip"},
    ]
    zeta, rim = drive.unit.zeta_1, {"color": "$paper", "width": 1.5}
    for index, wheel in enumerate(drive.wheels):
        speed = wheel.numbers["speed"]
        if not speed.count:
            continue
        slow = max(60.0, speed.low / RPM, -speed.high / RPM)
        fast = max(wheel.highest_speed / RPM, slow)
        traces.append(
            line([slow, fast], [zeta, zeta], wheel_colour(index), wheel.name, wheel=index, width=5)
            | {"mode": "lines+markers", "marker": {"size": [0, 11], "color": wheel_colour(index), "line": rim}}
            | {"hovertemplate": f"{wheel.name}: up to {number(fast)} rpm<extra></extra>"}
        )
    marks: list[Figure] = []
    if band is not None and math.isfinite(band.whole.critical_speed[0]):
        low, high = np.minimum(band.whole.critical_speed[::2], grid.x[-1]) / RPM
        ends = {"symbol": "line-ns-open", "size": 18, "color": INK, "line": {"width": 2, "color": INK}}
        traces.append(
            line([low, high], [zeta, zeta], INK, "critical speed within the errors", width=3)
            | {"mode": "lines+markers", "marker": ends}
            | {"hovertemplate": f"critical speed, 5 to 95 %: {critical_range(band)}<extra></extra>"}
        )
    if critical is not None:
        traces.append(
            {"type": "scatter", "mode": "markers", "x": [critical / RPM], "y": [zeta], "name": "critical speed"}
            | {"marker": {"symbol": "diamond", "size": 12, "color": INK, "line": rim}}
            | {"hovertemplate": f"critical speed {number(critical / RPM)} rpm<extra></extra>"}
        )
        marks.append(
            {"x": math.log10(critical / RPM), "y": zeta, "text": f"critical: {number(critical / RPM)} rpm", "ax": -88}
            | {"ay": 22, "arrowcolor": INK, "arrowwidth": 1, "font": {"color": INK, "size": 12}, "bgcolor": "$paper"}
        )
    layout = rows_layout(("Damping ratio zeta_1 [-]",), "Speed [rpm]") | {"height": 540, "annotations": marks}
    layout["xaxis"] |= log_axis(60.0, float(grid.x[-1]) / RPM) | {"showgrid": False}
    layout["showlegend"] = False
    layout["yaxis"] |= {"range": [float(grid.y[0]), float(grid.y[-1])], "showgrid": False}
    layout["margin"] = layout["margin"] | {"b": 110}
    return {"data": traces, "layout": layout}
