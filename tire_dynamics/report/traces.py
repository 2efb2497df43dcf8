"""Pieces of Plotly charts as plain mappings: curves, axes, numbers packed into bytes.

A text that begins with $ is a colour of the template, which has a light and a dark scheme.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "BAND", "COLOURS", "ERRORS", "INK", "SOFT", "Figure", "filled", "legend_entry", "line", "log_axis", "packed",
    "rows_layout", "typed", "wheel_colour",
]  # fmt: skip

Figure = dict[str, Any]

COLOURS = 8  # of wheels, in the template; more wheels take them again
INK, SOFT, BAND, ERRORS = "$ink", "$soft", "$band", "$errors"


def line(
    x: ArrayLike, y: ArrayLike, colour: str, name: str, row: int = 0, wheel: int | None = None, group: str = "",
    width: float = 1.4, dash: str = "solid",
) -> Figure:  # fmt: skip
    """A trace; ``meta`` tells the page's controls which wheel and group it belongs to."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": typed(x),
        "y": typed(y),
        "yaxis": f"y{row + 1}" if row else "y",
        "name": name,
        "legendgroup": group or name,
        "showlegend": False,
        "line": {"color": colour, "width": width, "dash": dash},
        "meta": {"wheel": wheel, "group": group},
    }


def filled(
    x: NDArray[Any], y: Any, colour: str, name: str, wheel: int | None = None, group: str = "errors", row: int = 0
) -> Figure:  # fmt: skip
    """A trace that fills what lies between two curves, (2, N)."""
    around = line(np.concatenate([x, x[::-1]]), np.concatenate([y[1], y[0][::-1]]), colour, name, row, wheel, group, 0)
    return around | {"fill": "toself", "fillcolor": colour, "hoverinfo": "skip"}


def legend_entry(name: str, group: str, dash: str, width: float, colour: str = INK, shown: bool = True) -> Figure:
    """An entry of the legend without a curve of its own."""
    line = {"color": colour, "width": width, "dash": dash}
    return {"type": "scatter", "mode": "lines", "x": [None], "y": [None], "name": name, "legendgroup": group} | {
        "showlegend": shown, "line": line, "meta": {"wheel": None, "group": group, "key": True}, "hoverinfo": "skip"
    }  # fmt: skip


def rows_layout(titles: Sequence[str], time: str, heights: Sequence[float] | None = None) -> Figure:
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


def log_axis(low: float, high: float) -> Figure:
    """An axis of equal ratios with round numbers."""
    ticks = [digit * 10.0**k for k in range(-3, 7) for digit in (1, 2, 5) if low <= digit * 10.0**k <= high]
    text = [f"{tick / 1000:g}k" if tick >= 10_000 else f"{tick:g}" for tick in ticks]
    bounds = [math.log10(low), math.log10(high)]
    return {"type": "log", "range": bounds, "tickmode": "array", "tickvals": ticks, "ticktext": text}


def typed(values: ArrayLike, kind: str = "f4") -> dict[str, str]:
    """Numbers as Plotly takes them in a few bytes each; NaN, which is a gap in a line, among them."""
    return {"dtype": kind, "bdata": packed(values, kind)}


def packed(values: ArrayLike, kind: str = "f4") -> str:
    """The bytes of numbers, of float32 or another kind, as text."""
    return base64.b64encode(np.ascontiguousarray(values, f"<{kind}").tobytes()).decode("ascii")


def wheel_colour(wheel: int) -> str:
    return f"$wheel{wheel % COLOURS}"
