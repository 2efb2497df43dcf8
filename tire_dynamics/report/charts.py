"""Charts of what was recorded: forces, spectra, harmonics, the highest load, the belt, when there were outputs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cdr import messages
from ..replay.parameters import car_of
from ..science.uniformity import OrderSums
from .analysis import extremes
from .gather import CURVES, Drive, Wheel, WheelHarmonics
from .theory import RPM, Bands, deviation_of_force, load_to_force, response_range, road_to_force, steady
from .traces import (
    BAND,
    ERRORS,
    INK,
    SOFT,
    Figure,
    filled,
    legend_entry,
    line,
    log_axis,
    packed,
    rows_layout,
    typed,
    wheel_colour,
)

__all__ = [
    "IMAGES",
    "belts",
    "coverage_figure",
    "force_figure",
    "moment_figure",
    "spectra_figure",
    "steady_figure",
    "variation_figure",
]

IMAGES = 0.4  # of the rate: above, what is held between samples shows more images than response
COHERENT = 0.5  # below it an estimate of the response is not drawn
BARS = 400  # intervals of a wheel's outputs that are drawn
PIECES = 1500  # of a band around a curve


def force_figure(drive: Drive) -> Figure:
    """Load, axle force and speed over time, one below the other with one axis of time."""
    load = "Load z, estimated [kN]" if drive.load_source == "estimate" else "Load z [kN]"
    titles = (load, "Axle z [kN]", "Traction x [kN]", "Axle x [kN]", "Speed [rpm]")
    traces = _deviations(drive)
    for row, curve in enumerate(CURVES):
        factor = 1.0 / RPM if curve == "speed" else 1e-3
        for index, wheel in enumerate(drive.wheels):
            time, value = _broken(*wheel.curves[curve].curve(), wheel)
            unit = "rpm" if curve == "speed" else "kN"
            traces.append(
                line(time, value * factor, wheel_colour(index), wheel.name, row=row, wheel=index)
                | {"hovertemplate": f"%{{y:.4g}} {unit} at %{{x:.3f}} s<extra>{wheel.name}</extra>"}
            )
    layout = rows_layout(titles, "Time since the beginning [s]") | {"height": 880, "showlegend": False}
    layout["xaxis"]["range"] = [0.0, drive.duration]
    return {"data": traces, "layout": layout}


def _deviations(drive: Drive) -> list[Figure]:
    """Two standard deviations either side of estimated loads, and of what they make of the axle's force."""
    if drive.load_source != "estimate":
        return []
    traces = []
    for index, (wheel, hop) in enumerate(zip(drive.wheels, car_of(drive.parameters).hop_frequencies, strict=True)):
        at, deviation = wheel.deviation.curve()
        if not at.size or not wheel.numbers["speed"].count:
            continue
        share = deviation_of_force(drive.unit, wheel.mean_speed, hop, drive.parameters["model"])
        for row, (curve, factor) in enumerate((("load_z", 2.0), ("axle_z", 2.0 * share))):
            time, value = wheel.curves[curve].curve()
            cuts = np.searchsorted(time, [0.5 * (begin + end) for begin, end in wheel.gaps[:BARS]])
            for some in np.split(np.arange(time.size), np.unique(cuts)):
                if some.size < 2 or math.isnan(factor):
                    continue
                middle, low, high = extremes(time[some], value[some], PIECES)
                wide = factor * np.interp(middle, at, deviation)
                around = 1e-3 * np.stack([low - wide, high + wide])
                traces.append(filled(middle, around, ERRORS, wheel.name, index, "deviation", row))
    return traces


def _broken(time: NDArray[Any], value: NDArray[Any], wheel: Wheel) -> tuple[NDArray[Any], NDArray[Any]]:
    """A curve that is not drawn across the gaps in a wheel's outputs that can be seen."""
    if not wheel.gaps or not time.size:
        return time, value
    middle = np.array([0.5 * (begin + end) for begin, end in wheel.gaps])
    place = np.searchsorted(time, middle)
    alone = np.diff(place, prepend=-1) > 0
    return np.insert(time, place[alone], middle[alone]), np.insert(value, place[alone], math.nan)


def spectra_figure(drive: Drive, band: Bands | None = None) -> Figure:
    """The force on the axle over the load, or the road, seen and computed; its phase, the coherence, and spectra."""
    model, unit, modes = drive.parameters["model"], drive.unit, drive.contact_modes
    what = "F' over load [-]" if modes is None else "F' over road [N/m]"
    titles = (what, "Phase [deg]", "Coherence [-]", "Density [N\u00b2/Hz]")
    models: list[Figure] = []  # on top of what was seen
    traces = [
        legend_entry("seen in the data", "data", "solid", 2.2),
        legend_entry("linear response at the mean speed", "model", "dash", 1.4),
        legend_entry("its range over the driven speeds", "range", "solid", 9, BAND),
        *([legend_entry("K, steady, closed form", "K", "dot", 1.4)] if modes is None else []),
        legend_entry("spectrum of the load" if modes is None else "spectrum of the contact force", "load", "dot", 1.4),
        legend_entry("spectrum of the axle force", "data", "solid", 2.2, shown=False),
    ]
    if band is not None:
        traces.insert(3, legend_entry("5 to 95 % within the errors of the parameters", "errors", "solid", 9, ERRORS))
    lowest, highest = math.inf, 0.0
    for index, wheel in enumerate(drive.wheels):
        seen, load = wheel.spectra.transfer(), wheel.of_load.transfer()
        if seen is None or load is None:
            continue
        colour, below = wheel_colour(index), seen.frequency <= IMAGES * wheel.spectra.rate
        f, gain, phase, coherence = (
            each[below] for each in (seen.frequency, np.abs(seen.response), np.angle(seen.response), seen.coherence)
        )
        f_line = np.geomspace(f[0], f[-1], 300)
        mean, wide = wheel.mean_speed, wheel.numbers["speed"]

        def response(speed: Any, f: Any = f_line) -> Any:
            if modes is None:
                return load_to_force(unit, speed, f, model)
            return road_to_force(unit, speed, f, model, modes, drive.parameters["contact_points"])

        computed = response(mean)
        low, high = response_range(response, wide.low, wide.high)
        gain = np.where(coherence >= COHERENT, gain, math.nan)
        phase = np.where(coherence >= COHERENT, np.degrees(phase), math.nan)
        hidden = {"hoverinfo": "skip"}
        traces.append(filled(f_line, (low, high), BAND, wheel.name, index, "range"))
        if band is not None:
            traces.append(filled(band.frequency, band.response[::2, index], ERRORS, wheel.name, index))
        if modes is None:
            K = steady(unit, mean, model)
            traces.append(
                line(f[[0, -1]], [K, K], colour, wheel.name, wheel=index, group="K", width=1.2, dash="dot")
                | {"hovertemplate": f"K = %{{y:.4f}}<extra>{wheel.name}</extra>"}
            )
        below_load = load.frequency <= IMAGES * wheel.spectra.rate
        traces += [
            line(f, gain, colour, wheel.name, wheel=index, group="data", width=2.6)
            | {"hovertemplate": f"%{{y:.3g}} at %{{x:.3g}} Hz<extra>{wheel.name}</extra>"},
            line(f, phase, colour, wheel.name, 1, index, "data", 2.6)
            | {"hovertemplate": f"%{{y:.0f}} deg at %{{x:.3g}} Hz<extra>{wheel.name}</extra>"},
            line(f, coherence, colour, wheel.name, 2, index, "data", 2.0)
            | {"hovertemplate": f"%{{y:.3f}} at %{{x:.3g}} Hz<extra>{wheel.name}</extra>"},
            line(load.frequency[below_load], load.input[below_load], colour, wheel.name, 3, index, "load", 1.3, "dot")
            | {"hovertemplate": f"%{{y:.3g}} N\u00b2/Hz at %{{x:.3g}} Hz<extra>{wheel.name}, load</extra>"},
            line(f, seen.output[below], colour, wheel.name, 3, index, "data", 2.0)
            | {"hovertemplate": f"%{{y:.3g}} N\u00b2/Hz at %{{x:.3g}} Hz<extra>{wheel.name}, axle</extra>"},
        ]  # fmt: skip
        models += [
            line(f_line, np.abs(computed), INK, wheel.name, 0, index, "model", 1.3, "dash") | hidden,
            line(f_line, np.degrees(np.angle(computed)), INK, wheel.name, 1, index, "model", 1.3, "dash") | hidden,
        ]
        lowest, highest = min(lowest, f[0]), max(highest, f[-1])
    layout = rows_layout(titles, "Frequency [Hz]", heights=(3, 1.6, 1.2, 2)) | {"height": 900}
    if highest:
        layout["xaxis"] |= log_axis(lowest, highest)
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
        filled(rpm, band.steady[::2, :count], ERRORS, within) | {"showlegend": True},
        line(rpm, K[:count], INK, "K", width=1.8) | {"hovertemplate": "K = %{y:.4f} at %{x:.0f} rpm<extra></extra>"},
    ]
    for index, wheel in enumerate(drive.wheels):
        if wheel.numbers["speed"].count:
            low, _, high = band.steady[:, count + index]
            shown = {"mode": "markers", "marker": {"size": 10, "color": wheel_colour(index)}}
            said = f"K = %{{y:.4f}}, {low:.4f} to {high:.4f}, at %{{x:.0f}} rpm<extra>{wheel.name}</extra>"
            x, y = band.speed[[count + index]] / RPM, K[[count + index]]
            traces.append(line(x, y, wheel_colour(index), wheel.name, wheel=index) | shown | {"hovertemplate": said})
    layout = rows_layout(("K [-]",), "Speed [rpm]") | {"height": 320}
    layout["xaxis"]["range"] = [0.0, rpm[-1]]
    return {"data": traces, "layout": layout}


def variation_figure(drive: Drive, harmonics: Sequence[WheelHarmonics | None]) -> Figure:
    """Peak to peak of each harmonic of a revolution, with standard errors, of axle force z and x."""
    traces = []
    for index, (wheel, forces) in enumerate(zip(drive.wheels, harmonics, strict=True)):
        for row, (variation, error) in enumerate((forces.z, forces.x) if forces else ()):
            size = variation.peak_to_peak
            place = {"x": list(range(1, size.size + 1)), "y": typed(size), "yaxis": "y2" if row else "y"}
            look = {"marker": {"color": wheel_colour(index)}, "name": wheel.name, "offsetgroup": str(index)}
            bar = {"type": "bar", "showlegend": False, "meta": {"wheel": index, "group": ""}} | place | look
            bar["hovertemplate"] = f"harmonic %{{x}}: %{{y:.3g}} N peak to peak<extra>{wheel.name}</extra>"
            if np.isfinite(error).any():
                bar["error_y"] = {"type": "data", "array": typed(error), "color": SOFT, "thickness": 1, "width": 2}
            traces.append(bar)
    layout = rows_layout(("Axle z, peak to peak [N]", "Axle x, peak to peak [N]"), "Harmonic of the wheel's rotation")
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
        colour = wheel_colour(index)
        for time, value, dash, what in ((t_load, load, "dot", "load"), (t_axle, axle, "solid", "axle force")):
            order = np.argsort(time, kind="stable")
            traces.append(
                line(time[order], value[order] * 1e-3, colour, what, wheel=index, dash=dash, width=1.8)
                | {"hovertemplate": f"%{{y:.3f}} kN at %{{x:.3f}} s<extra>{what}</extra>", "showlegend": True}
            )
    layout = rows_layout(("Force z [kN]",), "Time since the beginning [s]") | {"height": 420}
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
                "frames": packed(np.array(frames)),
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
            | {"line": {"color": wheel_colour(index), "width": 14}, "meta": {"wheel": index}, "name": wheel.name}
            | {"hovertemplate": "%{x:.3f} s<extra>%{y}</extra>", "showlegend": False, "connectgaps": False}
        )
    layout = rows_layout(("",), "Time since the beginning [s]") | {"height": 110 + 34 * len(drive.wheels)}
    layout["xaxis"]["range"] = [0.0, drive.duration]
    layout["yaxis"] |= {"type": "category", "fixedrange": True, "showgrid": False, "automargin": True}
    layout["yaxis"] |= {"categoryorder": "array", "categoryarray": [wheel.name for wheel in reversed(drive.wheels)]}
    layout["yaxis"]["range"] = [-0.7, len(drive.wheels) - 0.3]
    return {"data": traces, "layout": layout}
