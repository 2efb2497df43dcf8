"""A drive over a road: height, contact load and axle force of each wheel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["RoadForces", "draw"]

FloatArray = NDArray[np.float64]

_MOST = 4000  # points of a line; of more the least and the most of each part are drawn


@dataclass(frozen=True)
class RoadForces:
    """What a road did to wheels, forces in REP 103 axes.

    Attributes
    ----------
    wheels : tuple of str
    time, distance, speed : ndarray, shape (N,)
        [s], [m], [rad/s].
    height, contact : ndarray, shape (N, W)
        Of the road as the wheels were told it [m]; vertical force of the road on the tire [N].
    axle : ndarray, shape (N, W, 2)
        [x, z] on the suspension [N].
    """

    wheels: tuple[str, ...]
    time: FloatArray
    distance: FloatArray
    speed: FloatArray
    height: FloatArray
    contact: FloatArray
    axle: FloatArray


def draw(forces: RoadForces, *, fore_aft: bool) -> Figure:
    """Rows of quantities, over the distance, or over the time where the wheels stand or turn round.

    Parameters
    ----------
    forces : RoadForces
    fore_aft : bool
        Draw the axle force x, too.

    Returns
    -------
    matplotlib.figure.Figure
        The wheels of an axle share a column: left and right.
    """
    from matplotlib.figure import Figure

    from .drawings import LINES, WIDTH

    rows = [
        ("Road [mm]", 1e3 * forces.height), ("Contact load\n[kN]", 1e-3 * forces.contact),
        ("Axle force z\n[kN]", 1e-3 * forces.axle[:, :, 1]),
    ]  # fmt: skip
    if fore_aft:
        rows.append(("Axle force x\n[kN]", 1e-3 * forces.axle[:, :, 0]))
    count = len(forces.wheels)
    columns = [list(range(count))[k : k + 2] for k in range(0, count, 2)]
    figure = Figure(figsize=(WIDTH * (1.0 if len(columns) == 1 else 1.6), 0.6 + 1.5 * len(rows)))
    axes = figure.subplots(len(rows), len(columns), sharex=True, sharey="row", squeeze=False)
    way = np.diff(forces.distance)
    onward = bool(way.size and ((way > 0.0).all() or (way < 0.0).all()))
    x = forces.distance if onward else forces.time
    for column, wheels in enumerate(columns):
        for row, (name, values) in enumerate(rows):
            ax = axes[row, column]
            for line, k in enumerate(wheels):
                style = {**LINES[line], "linewidth": 0.9, "label": forces.wheels[k]}
                ax.plot(*_thinned(x, values[:, k]), **style)
            if column == 0:
                ax.set_ylabel(name)
            ax.margins(x=0.0)
        axes[1, column].axhline(0.0, color="0.6", linewidth=0.6, zorder=0)
        axes[-1, column].set_xlabel("Distance driven [m]" if onward else "Time [s]")
        axes[0, column].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.1)
    figure.align_ylabels()
    return figure


def _thinned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A line of many points by the least and the most of each part, so that no peak is lost."""
    each = -(-2 * x.size // _MOST)
    if each <= 2:
        return x, y
    whole = x.size // each * each
    parts = np.where(np.isnan(y[:whole]), np.inf, y[:whole]).reshape(-1, each)
    least = parts.argmin(axis=1)
    most = np.where(np.isnan(y[:whole]), -np.inf, y[:whole]).reshape(-1, each).argmax(axis=1)
    rows = np.sort(np.stack([least, most], axis=1), axis=1) + each * np.arange(len(parts))[:, None]
    some = np.concatenate([rows.ravel(), np.arange(whole, x.size)])
    return x[some], y[some]
