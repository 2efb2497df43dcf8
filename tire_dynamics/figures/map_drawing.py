"""A map's picture, drawn from its arrays."""

from __future__ import annotations

import json
import re
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from scipy import ndimage

from ..science.floquet import VERDICTS
from .drawings import WIDTH

__all__ = ["draw"]

# label, symbol, unit
FIELDS = {
    "density": ("Density of the belt", r"\rho", "kg/m³"),
    "bending_stiffness": ("Bending stiffness of the belt", "D", "N m"),
    "membrane_stiffness": ("Membrane stiffness of the belt", "K", "N/m"),
    "radius": ("Mean radius of the belt", "a", "m"),
    "width": ("Width of the belt", "b", "m"),
    "thickness": ("Thickness of the belt", "h", "m"),
    "radial_stiffness": ("Radial stiffness of the sidewall", "k_z", "N/m³"),
    "tangential_stiffness": ("Tangential stiffness of the sidewall", r"k_\theta", "N/m³"),
    "inflation_pressure": ("Inflation pressure", "p_0", "Pa"),
    "wheel_mass": ("Mass of the wheel", "M", "kg"),
    "suspension_stiffness": ("Stiffness of the suspension", "k_s", "N/m"),
    "zeta_1": ("Damping ratio of the ring's rigid mode", r"\zeta_1", ""),
    "zeta_s": ("Damping ratio of the suspension", r"\zeta_s", ""),
    "zeta_n": ("Damping ratio of the belt's other modes", r"\zeta_n", ""),
    "contact_half_angle": ("Half angle of the contact patch", r"\varphi_c", "rad"),
    "vertical_stiffness": ("Vertical stiffness of the tire", "K_v", "N/m"),
    "residual_damping": ("Damping of the tread", "c_c", "N s/m"),
    "sprung_mass": ("Sprung mass", "m_b", "kg"),
    "nonuniformity": ("Amplitudes of the sidewall, times the unit's own", "s", ""),
    "speed": ("Speed", r"\Omega", "rad/s"),
    "speed_rpm": ("Speed", r"\Omega", "rpm"),
}
# What a map does not depend on is not said to be held fixed.
NEVER = {"zeta_n", "contact_half_angle"}
COMPLETE_ONLY = {"bending_stiffness", "membrane_stiffness", "inflation_pressure"}
STABILITY_ONLY = {"zeta_s", "wheel_mass"}
PER_LINE = 5  # fields held fixed
NARROW = 0.02  # of the map's smaller side: a region with less room around any point has no name written into it


def draw(arrays: dict[str, Any]) -> Figure:
    """The picture of the arrays that ``tire-dynamics map`` writes."""
    figure = Figure(figsize=(WIDTH, 4.9))
    ax = figure.subplots()
    log = [bool(value) for value in arrays["log"]]
    ax.set(xscale="log" if log[0] else "linear", yscale="log" if log[1] else "linear")
    ax.set(xlabel=_label(str(arrays["x_name"])), ylabel=_label(str(arrays["y_name"])))
    ax.grid(False)
    if "transmissibility" in arrays:
        _transmissibility(figure, ax, arrays)
    else:
        _stability(figure, ax, arrays)
    ax.set(xlim=(arrays["x"][0], arrays["x"][-1]), ylim=(arrays["y"][0], arrays["y"][-1]))
    ax.set_title(_title(arrays), loc="left", linespacing=1.5)
    return figure


def _stability(figure: Figure, ax: Axes, arrays: dict[str, Any]) -> None:
    abscissa = arrays["spectral_abscissa_1_s"]
    least, most = np.percentile(abscissa, [0.5, 99.5])
    some = max(1e-3 * max(abs(least), abs(most)), 1e-6)  # each side has its colours, which rounding does not reach
    low, high = float(min(least, -some)), float(max(most, some))
    colours = ax.pcolormesh(
        *(arrays["x"], arrays["y"], abscissa), cmap="RdBu_r", norm=TwoSlopeNorm(0.0, low, high), shading="nearest"
    )
    beyond = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}
    bar = figure.colorbar(colours, ax=ax, extend=beyond[bool(abscissa.min() < low), bool(abscissa.max() > high)])
    bar.set_label("Spectral abscissa [1/s]: decay below 0, growth above")
    sides = MaxNLocator(4).tick_values(low, 0.0), MaxNLocator(4).tick_values(0.0, high)  # of two scales
    bar.set_ticks([tick for tick in np.unique(np.concatenate(sides)) if low <= tick <= high])
    bar.minorticks_off()
    bar.ax.axhline(0.0, color="0", linewidth=1.2)
    lines = list(arrays["boundary"][arrays["segments"]])
    ax.add_collection(LineCollection(lines, colors="0", linewidths=1.3, capstyle="round"))
    for code, name in enumerate(VERDICTS):
        _name(ax, arrays, arrays["verdict"] == code, name)


def _transmissibility(figure: Figure, ax: Axes, arrays: dict[str, Any]) -> None:
    K = arrays["transmissibility"]
    light = ListedColormap(
        matplotlib.colormaps["YlGnBu_r"](np.linspace(0.4, 1.0, 256))
    )  # black can be read on all of it
    colours = ax.pcolormesh(arrays["x"], arrays["y"], K, cmap=light, vmin=0, vmax=1, shading="nearest")
    figure.colorbar(colours, ax=ax).set_label("Force on the suspension over load, $K = F'/F$ [-]")
    levels = [level for level in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99) if K.min() < level < K.max()]
    if levels:
        lines = ax.contour(arrays["x"], arrays["y"], K, levels=levels, colors="0", linewidths=0.7)
        ax.clabel(lines, fmt="%g", fontsize=7.0)


def _name(ax: Axes, arrays: dict[str, Any], region: Any, name: str) -> None:
    """Write a region's name where there is most room in it."""
    room = ndimage.distance_transform_edt(np.pad(region, 1))[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(room)), room.shape)
    if room[row, column] > NARROW * min(region.shape):
        text = ax.text(arrays["x"][column], arrays["y"][row], name, ha="center", va="center", fontsize=9.0)
        text.set_path_effects([withStroke(linewidth=2.5, foreground="white")])


def _label(name: str) -> str:
    label, symbol, unit = FIELDS[name]
    return f"{label}, ${symbol}$ [{unit or '-'}]"


def _title(arrays: dict[str, Any]) -> str:
    """What is drawn, and what is held fixed."""
    unit = json.loads(str(arrays["unit"]))
    complete = str(arrays["model"]) == "complete"
    road = int(arrays["contact_n_max"]) if "contact_n_max" in arrays else 0
    what = f"Stability{' on the road' if road else ''}, {'complete' if complete else 'inextensional'} model"
    ignored = set() if road else NEVER | {"vertical_stiffness", "residual_damping", "sprung_mass"}
    complete = complete or bool(road)
    without = ignored | (set() if complete else COMPLETE_ONLY) | {str(arrays["x_name"]), str(arrays["y_name"])}
    if "transmissibility" in arrays:
        what, without = "Transmissibility", without | STABILITY_ONLY
    held = [(name, value) for name, value in unit.items() if name in FIELDS and name not in without]
    if np.isfinite(arrays["speed_rad_s"]):
        held.append(("speed_rpm", float(arrays["speed_rad_s"]) * 30.0 / np.pi))
    texts = [f"${FIELDS[name][1]}$ = {_number(value)} {FIELDS[name][2]}".rstrip() for name, value in held]
    lines = [",  ".join(texts[k : k + PER_LINE]) for k in range(0, len(texts), PER_LINE)]
    return "\n".join([f"{what}, {unit['sidewall_damping']} damping of the sidewall", *lines])


def _number(value: float) -> str:
    """To six digits, with a power of ten where 'e' would stand."""
    return re.sub(r"e([+-])0*(\d+)", lambda m: rf"$\cdot 10^{{{m[1].strip('+')}{m[2]}}}$", f"{value:.6g}")
