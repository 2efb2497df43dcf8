"""The page of ``compare``: figures for Plotly as plain mappings, tables, and the template that holds them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import __version__
from ..science.comparison import Lines
from .comparison import Axis, Comparison
from .comparison_statements import statements
from .rendering import rendered
from .traces import typed

__all__ = ["page"]

Figure = dict[str, Any]

# A text that begins with $ is a colour of the template, which has a light and a dark scheme.
INK, SOFT, MODEL, MEASURED, ERROR, BAND = "$ink", "$soft", "$model", "$measured", "$error", "$band"
COHERENT = 0.05  # lower limit of the coherence below which gain and phase are not drawn


def page(found: Comparison) -> tuple[str, str]:
    """The page of a comparison, and its headline.

    Parameters
    ----------
    found : Comparison

    Returns
    -------
    tuple of str
        HTML that needs no network, and one sentence.
    """
    from plotly.offline import get_plotlyjs

    said = statements(found)
    figures: dict[str, Figure] = {}
    for axis in found.axes:
        figures[f"frequency-{axis.name}"] = _frequency(axis, found)
        figures[f"bands-{axis.name}"] = _bands(axis)
        figures[f"peak-{axis.name}"] = _peak(axis)
        if axis.orders is not None:
            figures[f"orders-{axis.name}"] = _orders(axis)
    levels = [level for level, _ in said]
    headline = said[0][1][:1].upper() + said[0][1][1:] + "."
    text = rendered(
        "comparison.html",
        found=found,
        tiles=[_tiles(axis) for axis in found.axes],
        bands={axis.name: _band_rows(axis) for axis in found.axes},
        orders={axis.name: _order_rows(axis) for axis in found.axes},
        said=said,
        level="warning" if "warning" in levels else "good",
        headline=headline,
        figures=figures,
        plotly=get_plotlyjs(),
        version=__version__,
    )
    return text, headline


# -- figures ------------------------------------------------------------------------------------------------------


def _frequency(axis: Axis, found: Comparison) -> Figure:
    lines = axis.lines
    f = lines.frequency
    clear = lines.coherence_interval[0] > COHERENT
    traces = [
        *_interval(f, lines.coherence_interval, "y"),
        _line(f, lines.coherence, MEASURED, "coherence", "y", "%{y:.3f} at %{x:.4g} Hz"),
        *_interval(f, np.where(clear, lines.gain_interval, math.nan), "y2"),
        _line(f, np.where(clear, lines.gain, math.nan), MEASURED, "gain", "y2", "%{y:.4g} at %{x:.4g} Hz"),
        _line(f[[0, -1]], np.abs([axis.whole.gain] * 2), INK, "one gain", "y2", "%{y:.5g}", dash="dash"),
        *_interval(f, np.degrees(np.where(clear, lines.phase_interval, math.nan)), "y3"),
        _line(f, _degrees(lines, clear), MEASURED, "phase", "y3", "%{y:.2f}° at %{x:.4g} Hz"),
        _line(f, lines.x_density, MODEL, "model", "y4", "%{y:.3g} N²/Hz at %{x:.4g} Hz", shown=True, dash="dot"),
        _line(f, lines.y_density, MEASURED, "measured", "y4", "%{y:.3g} N²/Hz at %{x:.4g} Hz", shown=True),
    ]  # fmt: skip
    titles = ("Coherence", "Gain", "Phase [deg]", "Density [N²/Hz]")
    layout = _layout(titles, "Frequency [Hz]", (1.0, 1.6, 1.2, 1.4), 860)
    layout["xaxis"] |= {
        "type": "log",
        "range": [math.log10(f[0]), math.log10(f[-1])],
        "dtick": "D2",
        "tickformat": "~g",
    }
    layout["yaxis"] |= {"range": [-0.02, 1.03]}
    layout["yaxis2"] |= {"range": _range(lines.gain_interval[:, clear], 0.0)}
    layout["yaxis3"] |= {"range": _range(np.degrees(lines.phase_interval[:, clear]), None)}
    layout["yaxis4"] |= _powers(lines.y_density, 1e-4)
    layout["shapes"] = [
        {"type": "line", "xref": "x", "yref": "paper", "x0": edge, "x1": edge, "y0": 0, "y1": 1}
        | {"line": {"color": SOFT, "width": 1, "dash": "dot"}}
        for edge in found.band
    ]
    return {"data": traces, "layout": layout}


def _orders(axis: Axis) -> Figure:
    lines = axis.orders
    assert lines is not None
    order = lines.frequency
    clear = lines.coherence_interval[0] > COHERENT
    traces = [
        *_interval(order, lines.coherence_interval, "y"),
        _line(order, lines.coherence, MEASURED, "coherence", "y", "%{y:.3f} at order %{x:.4g}"),
        *_interval(order, np.where(clear, lines.gain_interval, math.nan), "y2"),
        _line(order, np.where(clear, lines.gain, math.nan), MEASURED, "gain", "y2", "%{y:.4g} at order %{x:.4g}"),
        *_interval(order, np.degrees(np.where(clear, lines.phase_interval, math.nan)), "y3"),
        _line(order, _degrees(lines, clear), MEASURED, "phase", "y3", "%{y:.2f}° at order %{x:.4g}"),
        _line(order, lines.x_density, MODEL, "model", "y4", "%{y:.3g} N²/order at %{x:.4g}", shown=True, dash="dot"),
        _line(order, lines.y_density, MEASURED, "measured", "y4", "%{y:.3g} N²/order at %{x:.4g}", shown=True),
    ]  # fmt: skip
    titles = ("Coherence", "Gain", "Phase [deg]", "Density [N²/order]")
    layout = _layout(titles, "Order of the wheel (events per turn)", (1.0, 1.4, 1.1, 1.4), 780)
    layout["xaxis"] |= {"range": [0.0, float(order[-1])]}
    layout["yaxis"] |= {"range": [-0.02, 1.03]}
    layout["yaxis2"] |= {"range": _range(lines.gain_interval[:, clear], 0.0)}
    layout["yaxis3"] |= {"range": _range(np.degrees(lines.phase_interval[:, clear]), None)}
    layout["yaxis4"] |= _powers(lines.y_density, 1e-4)
    return {"data": traces, "layout": layout}


def _bands(axis: Axis) -> Figure:
    middle = np.array([math.sqrt(max(band.low, 1e-6) * band.high) for band in axis.bands])
    traces = []
    for name, colour, values, dash in (
        ("measured", MEASURED, [band.y for band in axis.bands], "solid"),
        ("model", MODEL, [band.x for band in axis.bands], "dot"),
        ("error, as it is", ERROR, [band.error for band in axis.bands], "solid"),
        ("error without gain and delay", ERROR, [band.aligned for band in axis.bands], "dash"),
        ("what no filter explains", SOFT, [band.unexplained for band in axis.bands], "dot"),
    ):
        table = np.array(values)
        trace = _line(middle, table[:, 0], colour, name, "y", f"%{{y:.4g}} N at %{{x:.4g}} Hz, {name}", True, dash)
        whiskers = {
            "type": "data",
            "symmetric": False,
            "array": typed(table[:, 2] - table[:, 0], "f8"),
            "arrayminus": typed(table[:, 0] - table[:, 1], "f8"),
            "color": colour,
            "thickness": 1,
            "width": 3,
        }
        traces.append(trace | {"mode": "lines+markers", "marker": {"size": 5, "color": colour}, "error_y": whiskers})
    layout = _layout(("Root mean square [N]",), "Frequency [Hz], third octaves", (1.0,), 440)
    layout["xaxis"] |= {"type": "log", "dtick": "D2", "tickformat": "~g"}
    sizes = np.array([band.y[0] for band in axis.bands])
    layout["yaxis"] |= _powers(sizes, 1e-2) | {"tickformat": "~g", "nticks": 8}
    return {"data": traces, "layout": layout}


def _peak(axis: Axis) -> Figure:
    peak = axis.peak
    traces = [
        _line(peak["time"], peak["model"], MODEL, "model", "y", "%{y:.5g} N at %{x:.4f} s", True, "dot"),
        _line(peak["measured_time"], peak["measured"], MEASURED, "measured", "y", "%{y:.5g} N at %{x:.4f} s", True),
    ]
    layout = _layout((f"force.{axis.name} [N]",), "Time since the model's beginning [s]", (1.0,), 380)
    return {"data": traces, "layout": layout}


def _powers(values: Any, below: float) -> Figure:
    """A logarithmic axis of measured values, and some room below them."""
    seen = values[values > 0.0]
    if not seen.size:
        return {"type": "log"}
    low, high = math.log10(float(seen.min()) * below), math.log10(float(seen.max()) * 3.0)
    return {"type": "log", "tickformat": ".0e", "nticks": 5, "range": [low, high]}


def _degrees(lines: Lines, clear: Any) -> Any:
    """The phase, where it is clear."""
    return np.degrees(np.where(clear, lines.phase, math.nan))


def _range(interval: Any, floor: float | None) -> list[float] | None:
    """Of an axis that shows most intervals and not the widest few."""
    seen = interval[:, np.isfinite(interval).all(axis=0)]
    if not seen.size:
        return None
    low, high = float(np.quantile(seen[0], 0.02)), float(np.quantile(seen[1], 0.98))
    room = 0.15 * (high - low) + 1e-3 * max(abs(high), 1e-9)
    return [low - room if floor is None else max(floor, low - room), high + room]


def _line(
    x: ArrayLike, y: ArrayLike, colour: str, name: str, axis: str, hover: str, shown: bool = False, dash: str = "solid"
) -> Figure:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": typed(x, "f8"),
        "y": typed(y, "f8"),
        "yaxis": axis,
        "name": name,
        "showlegend": shown,
        "line": {"color": colour, "width": 1.6, "dash": dash},
        "hovertemplate": f"{hover}<extra></extra>",
    }


def _interval(x: Any, interval: Any, axis: str) -> list[Figure]:
    """What lies between two curves, in pieces where it is known."""
    known = np.isfinite(interval).all(axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
    traces = []
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        some = slice(begin, end)
        around_x = np.concatenate([x[some], x[some][::-1]])
        around_y = np.concatenate([interval[1, some], interval[0, some][::-1]])
        trace = _line(around_x, around_y, BAND, "95 %", axis, "")
        trace["line"]["width"] = 0
        traces.append(trace | {"fill": "toself", "fillcolor": BAND, "hoverinfo": "skip", "hovertemplate": None})
    return traces


def _layout(titles: Sequence[str], along: str, heights: Sequence[float], height: int) -> Figure:
    space = 0.04 if len(titles) > 1 else 0.0
    shares = [each / sum(heights) * (1.0 - space * (len(titles) - 1)) for each in heights]
    layout: Figure = {
        "height": height,
        "margin": {"l": 70, "r": 14, "t": 30, "b": 48},
        "hovermode": "closest",
        "legend": {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom"},
        "xaxis": {"title": {"text": along}, "anchor": f"y{len(titles)}" if len(titles) > 1 else "y"},
    }
    top = 1.0
    for row, (title, share) in enumerate(zip(titles, shares, strict=True)):
        layout[f"yaxis{row + 1}" if row else "yaxis"] = {
            "title": {"text": title, "standoff": 6},
            "domain": [max(0.0, top - share), min(1.0, top)],
        }
        top -= share + space
    return layout


# -- tables -------------------------------------------------------------------------------------------------------


def _tiles(axis: Axis) -> dict[str, Any]:
    whole = axis.whole
    return {
        "axis": axis.name,
        "tiles": [
            ("Gain", f"{whole.gain:.5g}", f"± {whole.gain_error:.2g}; 95 %: {_span(whole.gain_interval, 1.0)}"),
            (
                "Delay",
                f"{1e3 * whole.delay:.4g} ms",
                f"± {1e3 * whole.delay_error:.2g} ms; 95 %: {_span(whole.delay_interval, 1e3)} ms",
            ),
            ("Follows the model", f"{axis.explained:.2%}", "of the measured power in the band"),
            ("Mean difference", f"{axis.offset[0]:.4g} N", f"± {axis.offset[1]:.2g} N"),
        ],
    }


def _span(interval: tuple[float, float], factor: float) -> str:
    return f"{factor * interval[0]:.5g} to {factor * interval[1]:.5g}"


def _band_rows(axis: Axis) -> list[list[str]]:
    rows = []
    for band in axis.bands:
        known = band.coherence > COHERENT
        rows.append(
            [
                f"{band.low:.3g} to {band.high:.3g}",
                _triple(band.y),
                _triple(band.x),
                _triple(band.error),
                f"{band.error[0] / band.y[0]:.1%}" if band.y[0] > 0.0 else "-",
                _triple(band.aligned),
                _triple(band.unexplained),
                f"{max(band.coherence, 0.0):.3f}",
                _triple(band.gain) if known else "-",
                _triple((math.degrees(band.phase[0]), math.degrees(band.phase[1]), math.degrees(band.phase[2])))
                if known
                else "-",
            ]
        )
    return rows


def _triple(value: tuple[float, float, float]) -> str:
    """A value, and below it its interval."""
    middle, low, high = value
    if not math.isfinite(middle):
        return "-"
    digits = ".4g"
    return f"{middle:{digits}}" + (f"\n{low:{digits}} to {high:{digits}}" if math.isfinite(low + high) else "")


def _order_rows(axis: Axis) -> list[list[str]]:
    lines = axis.orders
    if lines is None:
        return []
    rows = []
    for each in axis.by_order:
        low, high = lines.coherence_interval[:, each.line]
        known = low > COHERENT
        gain, phase = lines.gain[each.line], math.degrees(lines.phase[each.line])
        rows.append(
            [
                str(each.order),
                f"{each.measured:.4g}",
                f"{each.model:.4g}",
                f"{lines.coherence[each.line]:.3f}\n{low:.3f} to {high:.3f}",
                f"{gain:.4g}\n± {lines.gain_error[each.line]:.2g}" if known else "-",
                f"{phase:.2f}\n± {math.degrees(lines.phase_error[each.line]):.2g}" if known else "-",
            ]
        )
    return rows
