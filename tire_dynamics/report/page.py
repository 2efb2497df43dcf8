"""The page: figures for Plotly as plain mappings, tables, and the one template that holds them."""

from __future__ import annotations

import base64
import html
import json
import math
import re
from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import __version__
from ..cdr import messages
from ..science import wheel as tire_and_wheel
from ..science.uniformity import OrderSums
from .findings import Summary, critical_range, number, seconds, summary
from .gather import CURVES, ROLLING, Drive, Wheel
from .theory import RPM, Bands, Errors, bands, campbell, load_to_force, response_range, stability_around, steady

__all__ = [
    "belts",
    "campbell_figure",
    "coverage_figure",
    "force_figure",
    "page",
    "spectra_figure",
    "stability_figure",
    "steady_figure",
    "variation_figure",
]

Figure = dict[str, Any]

COLOURS = 8  # of wheels, in the template; more wheels take them again
IMAGES = 0.4  # of the rate: above, what is held between samples shows more images than response
COHERENT = 0.5  # below it an estimate of the response is not drawn
BARS = 400  # stretches of a wheel's outputs that are drawn

# A text that begins with $ is a colour of the template, which has a light and a dark scheme.
INK, SOFT, GRID, BAND, ERRORS = "$ink", "$soft", "$grid", "$band", "$errors"


def page(drive: Drive, known: Errors | None = None) -> tuple[str, str]:
    """The page of a drive as HTML, with bands if there are errors of the parameters, and its headline."""
    from plotly.offline import get_plotlyjs

    highest = max((wheel.highest_speed for wheel in drive.wheels), default=0.0)
    stability, of_map = stability_around(drive.unit, highest, drive.parameters["model"])
    critical = of_map
    if (modes := drive.contact_modes) is not None:
        critical = tire_and_wheel.critical_speed(drive.unit.mean, drive.parameters["model"], contact=True, n_max=modes)
    band = None if known is None else _bands(drive, known, highest)
    found = summary(drive, critical, known, band)
    belt, exaggeration = belts(drive)
    figures = {
        "forces": force_figure(drive),
        "spectra": spectra_figure(drive, band),
        "moment": moment_figure(drive),
        "campbell": campbell_figure(drive, highest),
        "stability": stability_figure(drive, stability, of_map, band),
        "coverage": coverage_figure(drive),
    }
    if band is not None and np.ptp(band.steady, axis=0).max() > 1e-6:  # reaction damping has K = 1, whatever the rest
        figures["steady"] = steady_figure(drive, band)
    told = [_told(wheel) for wheel in drive.wheels]
    if any(told):
        figures["variation"] = variation_figure(drive, told)
    data = {"figures": figures, "belts": belt, "exaggeration": exaggeration, "wheels": [w.name for w in drive.wheels]}
    values = {
        "title": html.escape(drive.name),
        "subtitle": _subtitle(drive),
        "level": found.level,
        "headline": html.escape(found.headline),
        "tiles": _tiles(drive, found, critical, band),
        "wheels": _chips(drive),
        "numbers": _numbers(drive, found),
        "findings": _findings(found),
        "topics": _topics(drive),
        "parameters": _parameters(drive),
        "inputs": _inputs(drive),
        "segments": _segments(drive),
        "closed_form": _closed_form(drive, band),
        "steady": _plot("steady") if "steady" in figures else "",
        "variation": _variation(drive, told),
        "exaggeration": number(exaggeration),
        "damping": html.escape(drive.parameters["tire.sidewall_damping"]),
        "zeta": f"{drive.unit.zeta_1:g}",
        "version": __version__,
        "data": json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "plotly": get_plotlyjs(),
    }
    template = files(__package__).joinpath("template.html").read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda found: values[found[1]], template), found.headline


# -- figures ------------------------------------------------------------------------------------------------------


def force_figure(drive: Drive) -> Figure:
    """Load, axle force and speed over time, one below the other with one axis of time."""
    titles = ("Load z [kN]", "Axle z [kN]", "Traction x [kN]", "Axle x [kN]", "Speed [rpm]")
    traces = []
    for row, curve in enumerate(CURVES):
        factor = 1.0 / RPM if curve == "speed" else 1e-3
        for index, wheel in enumerate(drive.wheels):
            time, value = _broken(*wheel.curves[curve].curve(), wheel)
            unit = "rpm" if curve == "speed" else "kN"
            traces.append(
                _line(time, value * factor, _colour(index), wheel.name, row=row, wheel=index)
                | {"hovertemplate": f"%{{y:.4g}} {unit} at %{{x:.3f}} s<extra>{wheel.name}</extra>"}
            )
    layout = _rows(titles, "Time since the beginning [s]") | {"height": 880, "showlegend": False}
    layout["xaxis"]["range"] = [0.0, drive.duration]
    return {"data": traces, "layout": layout}


def _broken(time: NDArray[Any], value: NDArray[Any], wheel: Wheel) -> tuple[NDArray[Any], NDArray[Any]]:
    """A curve that is not drawn across the gaps in a wheel's outputs that can be seen."""
    if not wheel.gaps or not time.size:
        return time, value
    middle = np.array([0.5 * (begin + end) for begin, end in wheel.gaps])
    place = np.searchsorted(time, middle)
    alone = np.diff(place, prepend=-1) > 0
    return np.insert(time, place[alone], middle[alone]), np.insert(value, place[alone], math.nan)


def _bands(drive: Drive, known: Errors, highest: float) -> Bands:
    """Bands on K from standstill on and at the wheels' mean speeds, which come last, and on the response there."""
    means = np.array([_mean_speed(wheel) for wheel in drive.wheels])
    speeds = np.concatenate([np.linspace(0.0, max(highest, 100.0 * RPM), 80), means])
    spectra = drive.wheels[0].spectra
    line = spectra.rate / spectra.length
    frequency = np.geomspace(line, line * math.floor(IMAGES * spectra.length), 200)
    return bands(drive.unit, known, highest, speeds, means, frequency, drive.parameters["model"])


def spectra_figure(drive: Drive, band: Bands | None = None) -> Figure:
    """The force on the axle over the load, seen and computed; its phase, the coherence, and both spectra."""
    model, unit = drive.parameters["model"], drive.unit
    titles = ("F' over load [-]", "Phase [deg]", "Coherence [-]", "Density [N\u00b2/Hz]")
    models: list[Figure] = []  # on top of what was seen
    traces = [
        _key("seen in the data", "data", "solid", 2.2),
        _key("linear response at the mean speed", "model", "dash", 1.4),
        _key("its range over the driven speeds", "range", "solid", 9, BAND),
        _key("K, steady, closed form", "K", "dot", 1.4),
        _key("spectrum of the load", "load", "dot", 1.4),
        _key("spectrum of the axle force", "data", "solid", 2.2, shown=False),
    ]
    if band is not None:
        traces.insert(3, _key("5 to 95 % within the errors of the parameters", "errors", "solid", 9, ERRORS))
    lowest, highest = math.inf, 0.0
    for index, wheel in enumerate(drive.wheels):
        seen = wheel.spectra.transfer()
        if seen is None:
            continue
        colour, below = _colour(index), seen.frequency <= IMAGES * wheel.spectra.rate
        f, gain, phase, coherence = (
            each[below] for each in (seen.frequency, np.abs(seen.response), np.angle(seen.response), seen.coherence)
        )
        f_line = np.geomspace(f[0], f[-1], 300)
        mean, wide = _mean_speed(wheel), wheel.numbers["speed"]
        computed = load_to_force(unit, mean, f_line, model)
        low, high = response_range(unit, wide.low, wide.high, f_line, model)
        gain = np.where(coherence >= COHERENT, gain, math.nan)
        phase = np.where(coherence >= COHERENT, np.degrees(phase), math.nan)
        K = steady(unit, mean, model)
        hidden = {"hoverinfo": "skip"}
        traces.append(_filled(f_line, (low, high), BAND, wheel.name, index, "range"))
        if band is not None:
            traces.append(_filled(band.frequency, band.response[::2, index], ERRORS, wheel.name, index))
        traces += [
            _line(f[[0, -1]], [K, K], colour, wheel.name, wheel=index, group="K", width=1.2, dash="dot")
            | {"hovertemplate": f"K = %{{y:.4f}}<extra>{wheel.name}</extra>"},
            _line(f, gain, colour, wheel.name, wheel=index, group="data", width=2.6)
            | {"hovertemplate": f"%{{y:.3g}} at %{{x:.3g}} Hz<extra>{wheel.name}</extra>"},
            _line(f, phase, colour, wheel.name, 1, index, "data", 2.6)
            | {"hovertemplate": f"%{{y:.0f}} deg at %{{x:.3g}} Hz<extra>{wheel.name}</extra>"},
            _line(f, coherence, colour, wheel.name, 2, index, "data", 2.0)
            | {"hovertemplate": f"%{{y:.3f}} at %{{x:.3g}} Hz<extra>{wheel.name}</extra>"},
            _line(f, seen.input[below], colour, wheel.name, 3, index, "load", 1.3, "dot")
            | {"hovertemplate": f"%{{y:.3g}} N\u00b2/Hz at %{{x:.3g}} Hz<extra>{wheel.name}, load</extra>"},
            _line(f, seen.output[below], colour, wheel.name, 3, index, "data", 2.0)
            | {"hovertemplate": f"%{{y:.3g}} N\u00b2/Hz at %{{x:.3g}} Hz<extra>{wheel.name}, axle</extra>"},
        ]  # fmt: skip
        models += [
            _line(f_line, np.abs(computed), INK, wheel.name, 0, index, "model", 1.3, "dash") | hidden,
            _line(f_line, np.degrees(np.angle(computed)), INK, wheel.name, 1, index, "model", 1.3, "dash") | hidden,
        ]
        lowest, highest = min(lowest, f[0]), max(highest, f[-1])
    layout = _rows(titles, "Frequency [Hz]", heights=(3, 1.6, 1.2, 2)) | {"height": 900}
    if highest:
        layout["xaxis"] |= _log(lowest, highest)
    layout["yaxis"] |= {"type": "log", "dtick": 1, "tickformat": "~g"}
    layout["yaxis2"] |= {"range": [-190, 190], "dtick": 90}
    layout["yaxis3"] |= {"range": [-0.02, 1.04], "dtick": 0.5}
    layout["yaxis4"] |= {"type": "log", "dtick": 2, "tickformat": ".0e"}
    return {"data": traces + models, "layout": layout}


def steady_figure(drive: Drive, band: Bands) -> Figure:
    """K over speed with its band, and the wheels at their mean speeds."""
    count = band.speed.size - len(drive.wheels)
    rpm = band.speed[:count] / RPM
    K = np.broadcast_to(steady(drive.unit, band.speed, drive.parameters["model"]), band.speed.shape)
    within = "5 to 95 % within the errors of the parameters"
    traces = [
        _filled(rpm, band.steady[::2, :count], ERRORS, within) | {"showlegend": True},
        _line(rpm, K[:count], INK, "K", width=1.8) | {"hovertemplate": "K = %{y:.4f} at %{x:.0f} rpm<extra></extra>"},
    ]
    for index, wheel in enumerate(drive.wheels):
        if wheel.numbers["speed"].count:
            low, _, high = band.steady[:, count + index]
            shown = {"mode": "markers", "marker": {"size": 10, "color": _colour(index)}}
            said = f"K = %{{y:.4f}}, {low:.4f} to {high:.4f}, at %{{x:.0f}} rpm<extra>{wheel.name}</extra>"
            x, y = band.speed[[count + index]] / RPM, K[[count + index]]
            traces.append(_line(x, y, _colour(index), wheel.name, wheel=index) | shown | {"hovertemplate": said})
    layout = _rows(("K [-]",), "Speed [rpm]") | {"height": 320}
    layout["xaxis"]["range"] = [0.0, rpm[-1]]
    return {"data": traces, "layout": layout}


Told = tuple[Any, NDArray[Any]]  # the harmonics of one force of a wheel, and their standard errors


def _told(wheel: Wheel) -> tuple[Told, Told] | None:
    """The harmonics of axle force x and z, if they can be told."""
    if wheel.orders is None:
        return None
    x, z = (orders.variation() for orders in wheel.orders)
    return None if x[0] is None or z[0] is None else (x, z)


def variation_figure(drive: Drive, told: Sequence[tuple[Told, Told] | None]) -> Figure:
    """Peak to peak of each harmonic of the turn, with standard errors, of axle force z and x."""
    traces = []
    for index, (wheel, forces) in enumerate(zip(drive.wheels, told, strict=True)):
        for row, (variation, error) in enumerate(forces[::-1] if forces else ()):
            size = variation.peak_to_peak
            place = {"x": list(range(1, size.size + 1)), "y": _typed(size), "yaxis": "y2" if row else "y"}
            look = {"marker": {"color": _colour(index)}, "name": wheel.name, "offsetgroup": str(index)}
            bar = {"type": "bar", "showlegend": False, "meta": {"wheel": index, "group": ""}} | place | look
            bar["hovertemplate"] = f"harmonic %{{x}}: %{{y:.3g}} N peak to peak<extra>{wheel.name}</extra>"
            if np.isfinite(error).any():
                bar["error_y"] = {"type": "data", "array": _typed(error), "color": SOFT, "thickness": 1, "width": 2}
            traces.append(bar)
    layout = _rows(("Axle z, peak to peak [N]", "Axle x, peak to peak [N]"), "Harmonic of the wheel's turn")
    layout |= {"height": 460, "barmode": "group", "bargap": 0.25}
    layout["xaxis"] |= {"dtick": 1, "tick0": 1, "range": [0.4, OrderSums().harmonics + 0.6], "fixedrange": True}
    for axis in ("yaxis", "yaxis2"):
        layout[axis] |= {"rangemode": "nonnegative"}
    return {"data": traces, "layout": layout}


def moment_figure(drive: Drive) -> Figure:
    """Load and axle force around the highest load, in full."""
    traces = []
    for index, wheel in enumerate(drive.wheels):
        if not wheel.moment.curves()[0][0].size:
            continue
        (t_load, load), (t_axle, axle), _ = wheel.moment.curves()
        colour = _colour(index)
        for time, value, dash, what in ((t_load, load, "dot", "load"), (t_axle, axle, "solid", "axle force")):
            order = np.argsort(time, kind="stable")
            traces.append(
                _line(time[order], value[order] * 1e-3, colour, what, wheel=index, dash=dash, width=1.8)
                | {"hovertemplate": f"%{{y:.3f}} kN at %{{x:.3f}} s<extra>{what}</extra>", "showlegend": True}
            )
    layout = _rows(("Force z [kN]",), "Time since the beginning [s]") | {"height": 420}
    return {"data": traces, "layout": layout}


def belts(drive: Drive) -> tuple[list[dict[str, Any] | None], float]:
    """The deflections of each wheel's belt around its highest load, and by how much to exaggerate them all."""
    shown: list[dict[str, Any] | None] = []
    largest = 0.0
    for wheel in drive.wheels:
        times, frames = [], []
        for time, data in zip(*wheel.moment.curves()[2], strict=True):
            try:
                values = messages.decode_multi_array(data)[1]
            except messages.MessageError:
                continue
            points = drive.parameters["ring_samples"]
            if values.size == 2 * points and np.isfinite(values).all():
                times.append(time)
                frames.append(values.reshape(2, points))
        if not frames:
            shown.append(None)
            continue
        largest = max(largest, float(np.abs(frames).max()))
        (t_load, load), (t_axle, axle), _ = wheel.moment.curves()
        shown.append(
            {
                "time": [round(time, 4) for time in times],
                "load": [round(value) for value in _held(times, t_load, load)],
                "axle": [round(value) for value in _held(times, t_axle, axle)],
                "points": frames[0].shape[1],
                "frames": _packed(np.array(frames)),
                "peak": int(np.argmin(np.abs(np.array(times) - wheel.moment.time))),
                "radius": drive.unit.radius,
            }
        )
    factor = 0.2 * drive.unit.radius / largest if largest > 0.0 else 1.0
    step = 10.0 ** math.floor(math.log10(factor))
    return shown, max(1.0, math.floor(factor / step) * step)


def _held(times: Sequence[float], knots: NDArray[Any], values: NDArray[Any]) -> list[float]:
    place = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, None)
    return [float(value) for value in values[place]] if knots.size else [0.0] * len(times)


_MODES = {
    "wheel_hop": ("wheel hop", "$line0", "solid"),
    "ring_fore_aft": ("ring fore-aft", "$line1", "solid"),
    "ring_vertical": ("ring vertical", "$line2", "solid"),
    "n_2_backward": ("n = 2 backward", "$line3", "dash"),
    "n_2_forward": ("n = 2 forward", "$line3", "dashdot"),
    "n_3_backward": ("n = 3 backward", "$line4", "dash"),
    "n_3_forward": ("n = 3 forward", "$line4", "dashdot"),
}


def campbell_figure(drive: Drive, highest: float) -> Figure:
    """Frequencies and decay rates over speed, with the driven speeds."""
    diagram = campbell(drive.unit, max(1.5 * highest, 1000.0 * RPM), drive.parameters["model"])
    rpm = diagram.speed / RPM
    traces = []
    for name, frequency in diagram.frequency.items():
        label, colour, dash = _MODES[name]
        for row, (value, unit) in enumerate(((frequency, "Hz"), (diagram.decay[name], "1/s"))):
            traces.append(
                _line(rpm, value, colour, label, row, group=name, width=2.0, dash=dash)
                | {"hovertemplate": f"%{{y:.1f}} {unit} at %{{x:.0f}} rpm<extra>{label}</extra>"}
                | {"showlegend": row == 0}
            )
    top = 1.15 * max(float(value.max()) for value in diagram.frequency.values())
    ends = rpm[[0, -1]]
    for order in (1, 2, 3, 4):
        traces.append(
            _line(ends, order * ends / 60.0, SOFT, "orders 1 to 4 of the turning", group="orders", width=0.8)
            | {"showlegend": order == 1, "hovertemplate": f"order {order}<extra></extra>"}
        )
    layout = _rows(("Frequency [Hz]", "Decay rate [1/s]"), "Speed [rpm]", heights=(2, 1)) | {"height": 640}
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
            "x": _typed(grid.x / RPM),
            "y": _typed(grid.y),
            "z": _typed(np.clip(grid.abscissa, -size, size)) | {"shape": ",".join(map(str, grid.abscissa.shape))},
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
            _line([slow, fast], [zeta, zeta], _colour(index), wheel.name, wheel=index, width=5)
            | {"mode": "lines+markers", "marker": {"size": [0, 11], "color": _colour(index), "line": rim}}
            | {"hovertemplate": f"{wheel.name}: up to {number(fast)} rpm<extra></extra>"}
        )
    marks: list[Figure] = []
    if band is not None and math.isfinite(band.whole.critical_speed[0]):
        low, high = np.minimum(band.whole.critical_speed[::2], grid.x[-1]) / RPM
        ends = {"symbol": "line-ns-open", "size": 18, "color": INK, "line": {"width": 2, "color": INK}}
        traces.append(
            _line([low, high], [zeta, zeta], INK, "critical speed within the errors", width=3)
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
    layout = _rows(("Damping ratio zeta_1 [-]",), "Speed [rpm]") | {"height": 540, "annotations": marks}
    layout["xaxis"] |= _log(60.0, float(grid.x[-1]) / RPM) | {"showgrid": False}
    layout["showlegend"] = False
    layout["yaxis"] |= {"range": [float(grid.y[0]), float(grid.y[-1])], "showgrid": False}
    layout["margin"] = layout["margin"] | {"b": 110}
    return {"data": traces, "layout": layout}


def coverage_figure(drive: Drive) -> Figure:
    """When each wheel had outputs."""
    traces = []
    for index, wheel in enumerate(drive.wheels):
        if not wheel.outputs:
            continue
        cuts = sorted(sorted(wheel.gaps, key=lambda gap: gap[0] - gap[1])[:BARS])
        edges = [wheel.first, *(edge for gap in cuts for edge in gap), wheel.last]
        time: list[float | None] = []
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            time += [round(begin, 4), round(end, 4), None]
        traces.append(
            {"type": "scatter", "mode": "lines", "x": time, "y": [None if t is None else wheel.name for t in time]}
            | {"line": {"color": _colour(index), "width": 14}, "meta": {"wheel": index}, "name": wheel.name}
            | {"hovertemplate": "%{x:.3f} s<extra>%{y}</extra>", "showlegend": False, "connectgaps": False}
        )
    layout = _rows(("",), "Time since the beginning [s]") | {"height": 110 + 34 * len(drive.wheels)}
    layout["xaxis"]["range"] = [0.0, drive.duration]
    layout["yaxis"] |= {"type": "category", "fixedrange": True, "showgrid": False, "automargin": True}
    layout["yaxis"] |= {"categoryorder": "array", "categoryarray": [wheel.name for wheel in reversed(drive.wheels)]}
    layout["yaxis"]["range"] = [-0.7, len(drive.wheels) - 0.3]
    return {"data": traces, "layout": layout}


def _mean_speed(wheel: Wheel) -> float:
    return wheel.numbers["speed"].mean


def _driven(wheels: Iterable[Wheel]) -> tuple[float, float]:
    """Least and greatest speed of all wheels, either way [rad/s]."""
    found = [wheel.numbers["speed"] for wheel in wheels if wheel.numbers["speed"].count]
    fast = max((max(abs(each.low), abs(each.high)) for each in found), default=0.0)
    slow = min((max(each.low, -each.high, 0.0) for each in found), default=0.0)
    return slow, fast


def _colour(wheel: int) -> str:
    return f"$wheel{wheel % COLOURS}"


def _line(
    x: ArrayLike, y: ArrayLike, colour: str, name: str, row: int = 0, wheel: int | None = None, group: str = "",
    width: float = 1.4, dash: str = "solid",
) -> Figure:  # fmt: skip
    """A trace; ``meta`` tells the page's controls which wheel and group it belongs to."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": _typed(x),
        "y": _typed(y),
        "yaxis": f"y{row + 1}" if row else "y",
        "name": name,
        "legendgroup": group or name,
        "showlegend": False,
        "line": {"color": colour, "width": width, "dash": dash},
        "meta": {"wheel": wheel, "group": group},
    }


def _filled(
    x: NDArray[Any], y: Any, colour: str, name: str, wheel: int | None = None, group: str = "errors"
) -> Figure:  # fmt: skip
    """A trace that fills what lies between two curves, (2, N)."""
    around = _line(np.concatenate([x, x[::-1]]), np.concatenate([y[1], y[0][::-1]]), colour, name, 0, wheel, group, 0)
    return around | {"fill": "toself", "fillcolor": colour, "hoverinfo": "skip"}


def _key(name: str, group: str, dash: str, width: float, colour: str = INK, shown: bool = True) -> Figure:
    """An entry of the legend without a curve of its own."""
    line = {"color": colour, "width": width, "dash": dash}
    return {"type": "scatter", "mode": "lines", "x": [None], "y": [None], "name": name, "legendgroup": group} | {
        "showlegend": shown, "line": line, "meta": {"wheel": None, "group": group, "key": True}, "hoverinfo": "skip"
    }  # fmt: skip


def _rows(titles: Sequence[str], time: str, heights: Sequence[float] | None = None) -> Figure:
    """A layout of charts above one another, which have one axis along."""
    shares = np.array(heights or [1.0] * len(titles))
    space = 0.045 if len(titles) > 1 else 0.0
    shares = shares / shares.sum() * (1.0 - space * (len(titles) - 1))
    layout: Figure = {
        "margin": {"l": 64, "r": 12, "t": 28, "b": 48},
        "hovermode": "closest",
        "dragmode": "zoom",
        "legend": {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom", "font": {"size": 12}},
        "xaxis": {"title": {"text": time}, "anchor": f"y{len(titles)}" if len(titles) > 1 else "y"},
    }
    top = 1.0
    for row, (title, share) in enumerate(zip(titles, shares.tolist(), strict=True)):
        axis = {"title": {"text": title, "standoff": 6}, "domain": [max(0.0, top - share), top], "automargin": False}
        layout[f"yaxis{row + 1}" if row else "yaxis"] = axis
        top -= share + space
    return layout


def _log(low: float, high: float) -> Figure:
    """An axis of equal ratios with round numbers."""
    ticks = [digit * 10.0**k for k in range(-3, 7) for digit in (1, 2, 5) if low <= digit * 10.0**k <= high]
    text = [f"{tick / 1000:g}k" if tick >= 10_000 else f"{tick:g}" for tick in ticks]
    bounds = [math.log10(low), math.log10(high)]
    return {"type": "log", "range": bounds, "tickmode": "array", "tickvals": ticks, "ticktext": text}


def _typed(values: ArrayLike) -> dict[str, str]:
    """Numbers as Plotly takes them in a few bytes each; NaN, which is a gap in a line, among them."""
    return {"dtype": "f4", "bdata": _packed(values)}


def _packed(values: ArrayLike) -> str:
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode("ascii")


# -- tables -------------------------------------------------------------------------------------------------------


def _subtitle(drive: Drive) -> str:
    begun = datetime.fromtimestamp(drive.begin_ns / 1e9, timezone.utc)
    source = "replayed for this report" if drive.replayed else "a log, as it was recorded"
    return html.escape(f"{begun:%Y-%m-%d %H:%M:%S} UTC \u00b7 {seconds(drive.duration)} \u00b7 {source}")


def _tiles(drive: Drive, found: Summary, critical: float | None, band: Bands | None) -> str:
    loads = [(wheel.numbers["load_z"].high, wheel.name) for wheel in drive.wheels if wheel.numbers["load_z"].count]
    forces = [(wheel.numbers["axle_z"].peak, wheel.name) for wheel in drive.wheels if wheel.outputs]
    fastest = max((wheel.highest_speed for wheel in drive.wheels), default=0.0)
    tiles = [
        ("Duration", seconds(drive.duration), f"{len(drive.wheels)} wheel{'s' * (len(drive.wheels) != 1)}"),
        ("Outputs cover", f"{math.floor(1000 * min(found.covered)) / 10:g} %", "of the drive"),
        ("Highest load", f"{number(max(loads)[0])} N" if loads else "-", max(loads)[1] if loads else ""),
        ("Highest axle force z", f"{number(max(forces)[0])} N" if forces else "-", max(forces)[1] if forces else ""),
        ("Top speed", f"{number(fastest / RPM)} rpm", f"{fastest:.1f} rad/s"),
        (
            "Critical speed",
            "none" if critical is None else f"{number(critical / RPM)} rpm",
            f"5 to 95 %: {critical_range(band)}"
            if band is not None
            else "stable at every speed"
            if critical is None
            else f"zeta_1 = {drive.unit.zeta_1:g}",
        ),
    ]
    return "".join(
        f'<div class="tile"><span>{what}</span><b>{value}</b><i>{where}</i></div>'
        for what, value, where in (map(html.escape, tile) for tile in tiles)
    )


def _chips(drive: Drive) -> str:
    return "".join(
        f'<button type="button" class="chip" data-wheel="{index}" aria-pressed="true" '
        f'style="--c:var(--wheel{index % COLOURS})">{html.escape(wheel.name)}</button>'
        for index, wheel in enumerate(drive.wheels)
    )


def _numbers(drive: Drive, found: Summary) -> str:
    header = (
        "wheel", "load z mean", "load z peak", "load z rms", "axle z mean", "axle z peak", "axle z rms",
        "axle x mean", "axle x peak", "axle x rms", "top speed", "covered", "stability",
    )  # fmt: skip
    units = ("", *("N",) * 9, "rpm", "%", "")
    rows = []
    for wheel, share, verdict in zip(drive.wheels, found.covered, found.verdicts, strict=True):
        row = [wheel.name]
        for curve in ("load_z", "axle_z", "axle_x"):
            of = wheel.numbers[curve]
            row += [number(value) for value in (of.mean, of.peak, of.deviation)] if of.count else ["-"] * 3
        row += [number(wheel.highest_speed / RPM), f"{math.floor(1e4 * share) / 100:g}", verdict or "-"]
        rows.append(row)
    heads = [f"{name} [{unit}]" if unit else name for name, unit in zip(header, units, strict=True)]
    return _table(heads, rows, wheels=True)


def _findings(found: Summary) -> str:
    words = {"good": "good", "note": "note", "warning": "look", "bad": "act"}
    return "".join(
        f'<li class="{each.level}"><b>{words[each.level]}</b><span>{html.escape(each.text)}</span></li>'
        for each in found.findings
    )


def _topics(drive: Drive) -> str:
    rows = [
        [topic, kind, *(("-", "-") if count is None else (number(count), f"{count / drive.duration:.4g}"))]
        for topic, (kind, count) in sorted(drive.topics.items())
        if count != 0
    ]
    return _table(("topic", "type", "messages", "per second"), rows)


def _parameters(drive: Drive) -> str:
    rows = [[name, _shown(value)] for name, value in drive.parameters.items() if not name.startswith("log.")]
    return _table(("parameter", "value"), rows)


def _shown(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return ", ".join(map(str, value)) or "-"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _inputs(drive: Drive) -> str:
    header = ("topic", "messages", "rate [Hz]", "interval", "1 to 99 %", "longest", "age mean", "age max", "remarks")
    rows = []
    for each in drive.inputs:
        intervals = [each.intervals.quantile(share) for share in (0.5, 0.01, 0.99)]
        stamped = each.kind != messages.FLOAT64 and each.delay.count
        remarks = ", ".join(f"{number(count)} {reason}" for reason, count in each.counts.items() if count)
        rows.append(
            [
                each.topic,
                number(each.messages),
                f"{each.rate:.4g}" if math.isfinite(each.rate) else "-",
                seconds(intervals[0]),
                f"{seconds(intervals[1])} to {seconds(intervals[2])}",
                seconds(each.intervals.longest),
                seconds(each.delay.mean) if stamped else "-",
                seconds(each.delay.high) if stamped else "-",
                remarks or "none",
            ]
        )
    return _table(header, rows)


def _segments(drive: Drive) -> str:
    spectra = [wheel.spectra for wheel in drive.wheels if wheel.spectra.segments]
    if not spectra:
        return "No stretch of outputs is long enough for a spectrum."
    most = max(each.segments for each in spectra)
    length = spectra[0].length / spectra[0].rate
    few = "; of so few, trust only what is smooth" if most < 8 else ""
    return f"Welch, Hann, {number(most)} segments of {seconds(length)}, half overlapping{few}."


def _closed_form(drive: Drive, band: Bands | None) -> str:
    words = []
    for index, wheel in enumerate(drive.wheels):
        if wheel.numbers["speed"].count:
            mean = _mean_speed(wheel)
            K = steady(drive.unit, mean, drive.parameters["model"])
            within = ""
            if band is not None:
                low, _, high = (f"{value:.4f}" for value in band.steady[:, index - len(drive.wheels)])
                within = f" ({low} to {high})" if low != high else ""
            words.append(f"{wheel.name} {K:.4f}{within} at {number(mean / RPM)} rpm")
    text = ", ".join(words) or "-"
    return html.escape(f"{text}; in brackets 5 to 95 % within the errors of the parameters" if "(" in text else text)


def _plot(name: str) -> str:
    return f'<div class="plot" id="plot-{name}" data-figure="{name}"></div>'


def _variation(drive: Drive, told: Sequence[tuple[Told, Told] | None]) -> str:
    """Chart and tables of the harmonics, and a line for each wheel that has none."""
    parts, silent = [], []
    for wheel, forces in zip(drive.wheels, told, strict=True):
        if forces is None:
            turns = 0.0 if wheel.orders is None else wheel.orders[0].turns
            reason = f"{turns:.2g} turns above {ROLLING / RPM:.0f} rpm with a force, too few or too uneven to tell"
            silent.append(f"<p>{html.escape(wheel.name)}: {reason} harmonics.</p>")
    state = "on the road, in this car: its axle gives way, and the contact's load with it"
    if not drive.on_road:
        state = "under loads that were given, which do not answer to what the axle does"
    how = f'<p class="how">These are forces {state}. A machine that holds the wheel at a fixed height reads others.</p>'
    if any(told):
        parts = [
            how,
            _plot("variation"),
            "<h3>Axle force z, N peak to peak and phase of each harmonic</h3>",
            _harmonics(drive, told, 1),
        ]
        parts += ["<details><summary>Fore and aft: axle force x</summary>", _harmonics(drive, told, 0), "</details>"]
        relative = [wheel.name for wheel, some in zip(drive.wheels, told, strict=True) if some and not wheel.measured]
        if relative:
            names = "all wheels" if len(relative) == len(drive.wheels) else ", ".join(relative)
            parts.append(
                f'<p class="how">Of {html.escape(names)} the log has no angle: it is integrated from the speed, and 0 '
                "at the beginning of the longest stretch without a gap. Phases are relative to that.</p>"
            )
    return "".join([*parts, *silent])


def _harmonics(drive: Drive, told: Sequence[tuple[Told, Told] | None], force: int) -> str:
    """A table: of each harmonic N peak to peak with its error, and below it the phase, if the error lets it be told."""
    rows = []
    for wheel, forces in zip(drive.wheels, told, strict=True):
        if forces is None:
            rows.append([wheel.name, *["-"] * (2 + OrderSums().harmonics)])
            continue
        variation, error = forces[force]
        cells = []
        for size, phase, deviation in zip(variation.peak_to_peak, variation.phase, error, strict=True):
            known = "" if math.isnan(deviation) else f" \u00b1 {_newton(deviation)}"
            clear = not size < 2.0 * deviation
            at = f"{math.degrees(phase):.0f}\u00b0" if clear else "-"
            cells.append("-" if math.isnan(size) else f"{_newton(size)}{known}\n{at}")
        rows.append([wheel.name, f"{variation.turns:.1f}", _newton(variation.whole), *cells])
    header = ("wheel", "turns", "all", *map(str, range(1, OrderSums().harmonics + 1)))
    return _table(header, rows, wheels=True)


def _newton(value: float) -> str:
    return f"{value:.1f}" if value < 9.95 else number(value)


def _table(header: Sequence[str], rows: Iterable[Sequence[str]], *, wheels: bool = False) -> str:
    """A table that scrolls by itself where it is too wide."""
    head = "".join(f"<th scope='col'>{html.escape(cell)}</th>" for cell in header)
    body = ""
    for index, (first, *rest) in enumerate(rows):
        mark = f' data-wheel="{index}"' if wheels else ""
        dot = f'<i class="dot" style="--c:var(--wheel{index % COLOURS})"></i>' if wheels else ""
        cells = "".join(f"<td>{_cell(cell)}</td>" for cell in rest)
        body += f"<tr{mark}><th scope='row'>{dot}{html.escape(first)}</th>{cells}</tr>"
    return f"<div class='scroll' tabindex='0'><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"


def _cell(text: str) -> str:
    """Further lines are small."""
    first, *more = html.escape(text).split("\n")
    return first + "".join(f"<small>{line}</small>" for line in more)
