"""The Campbell diagram of one unit: its numbers as a table, and its picture, under a given load or on the road."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..science.campbell import campbell_exponents, contact_modes, jumps
from ..science.unit import TireWheelUnit
from ..science.wheel_matrices import Model

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["NAMES", "CampbellDiagram", "diagram", "draw", "from_table"]

RPM = 2.0 * np.pi / 60.0
WIDTH = 6.6  # [in]

# Each with its own dashes, and from dark to light, so that they differ without colour.
LINES: dict[str, dict[str, Any]] = {
    "body": {"color": "#b07cc6", "linestyle": (0, (7, 1.4, 1, 1.4, 1, 1.4))},
    "wheel_hop": {"color": "#000000", "linestyle": "-"},
    "wheel_fore_aft": {"color": "#1a9a78", "linestyle": (0, (1.2, 1.2))},
    "ring_fore_aft": {"color": "#0b4f9c", "linestyle": (0, (5, 1.6))},
    "ring_vertical": {"color": "#c2410c", "linestyle": (0, (5, 1.4, 1, 1.4))},
}
WAVE_LINES = ("#000000", "#0b4f9c", "#c2410c", "#1a9a78", "#b07cc6")
WAVE_DASHES = {"backward": (0, (5, 1.6)), "forward": "-"}
MARKERS: dict[str, Any] = {"linestyle": "none", "markersize": 3.0, "fillstyle": "none", "markeredgewidth": 0.8}
DOTS: dict[str, Any] = {"color": "0.72", "marker": ".", "markersize": 1.1, "linestyle": "none", "zorder": 1.6}
NAMES = {
    "body": "body",
    "wheel_hop": "wheel hop",
    "wheel_fore_aft": "wheel fore-aft",
    "ring_fore_aft": "ring fore-aft",
    "ring_vertical": "ring vertical",
}


class CampbellDiagram(NamedTuple):
    """Frequencies [Hz] in the fixed frame and decay rates [1/s] over the speed.

    Attributes
    ----------
    unit, model, contact, n_max
        Of what; ``n_max`` counts on the road.
    speed : ndarray, shape (S,)
        [rad/s]
    frequency, decay : dict of ndarray, shape (S,)
        By the motion's name: "wheel_hop", "n_2_backward" and so on.
    every : ndarray of complex, shape (S, K), or None
        On the road the exponents [1/s] of all modes there are, named or not.
    """

    unit: TireWheelUnit
    model: Model
    contact: bool
    n_max: int
    speed: NDArray[np.float64]
    frequency: dict[str, NDArray[np.float64]]
    decay: dict[str, NDArray[np.float64]]
    every: NDArray[np.complex128] | None

    @property
    def table(self) -> dict[str, NDArray[np.float64]]:
        """Columns for a CSV file; on the road the modes that are not named come last, from the slowest on."""
        columns = {"speed_rpm": self.speed / RPM}
        for name, values in self.frequency.items():
            columns |= {f"{name}_Hz": values, f"{name}_decay_1_s": self.decay[name]}
        if self.every is not None:
            for k, values in enumerate(self.every.T):
                columns |= {f"mode_{k}_Hz": values.imag / (2.0 * np.pi), f"mode_{k}_decay_1_s": -values.real}
        return columns

    def line(self, name: str, quantity: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Speeds [rpm] and values of "frequency" or "decay", with NaN where the name goes over to another mode."""
        rpm, values = self.speed / RPM, (self.frequency if quantity == "frequency" else self.decay)[name]
        if self.every is None:
            return rpm, values
        number = int(name.split("_")[1]) if _of_belt(name) else 1
        after = np.flatnonzero(jumps(self.speed, self.frequency[name], number)) + 1
        return np.insert(rpm, after, 0.5 * (rpm[after - 1] + rpm[after])), np.insert(values, after, np.nan)


def diagram(
    unit: TireWheelUnit,
    speed: NDArray[np.float64],
    numbers: Sequence[int],
    model: Model = "inextensional",
    *,
    contact: bool = False,
    n_max: int = 30,
) -> CampbellDiagram:
    """Compute a diagram; arguments as of :func:`.campbell.campbell_exponents`."""
    modes = contact_modes(unit, speed, model, n_max) if contact else None
    of_wheel, waves = campbell_exponents(unit, speed, numbers, model, contact=modes or False, n_max=n_max)
    exponents = of_wheel | {f"n_{n}_{wave}": column for (n, wave), column in waves.items()}
    return CampbellDiagram(
        unit,
        model,
        contact,
        n_max,
        speed,
        {name: np.abs(column.imag) / (2.0 * np.pi) for name, column in exponents.items()},
        {name: -column.real for name, column in exponents.items()},
        None if modes is None else modes.exponents,
    )


def from_table(
    table: Mapping[str, NDArray[np.float64]], unit: TireWheelUnit, model: Model, n_max: int, prefix: str
) -> CampbellDiagram:
    """A diagram on the road from the columns of its ``table``, whose names but the speed's have a prefix."""
    columns = {name.removeprefix(prefix): values for name, values in table.items() if name.startswith(prefix)}
    names = [name.removesuffix("_decay_1_s") for name in columns if name.endswith("_decay_1_s")]
    named = [name for name in names if not name.startswith("mode_")]
    modes = [name for name in names if name.startswith("mode_")]
    every = [2j * np.pi * columns[f"{name}_Hz"] - columns[f"{name}_decay_1_s"] for name in modes]
    frequency = {name: columns[f"{name}_Hz"] for name in named}
    decay = {name: columns[f"{name}_decay_1_s"] for name in named}
    speed = RPM * table["speed_rpm"]
    return CampbellDiagram(unit, model, True, n_max, speed, frequency, decay, np.stack(every, axis=1))


def label(name: str) -> str:
    """A motion's name in words."""
    wave = re.fullmatch(r"n_(\d+)_(\w+)", name)
    return f"$n = {wave[1]}$ {wave[2]}" if wave else NAMES[name]


def draw(shown: CampbellDiagram | Sequence[CampbellDiagram]) -> Figure:
    """The picture; of a second diagram, of the same motions, marks on the lines of the first."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    first, *others = [shown] if isinstance(shown, CampbellDiagram) else shown
    figure = Figure(figsize=(WIDTH, 6.0))
    axes = figure.subplots(2, 2, sharex=True, sharey="row", gridspec_kw={"height_ratios": (1.7, 1.0)})
    columns = ([name for name in first.frequency if not _of_belt(name)], [*filter(_of_belt, first.frequency)])
    top = 1.12 * max(float(np.nanmax(first.frequency[name][:1])) for name in first.frequency)
    for column, names in zip(axes.T, columns, strict=True):
        if (each := first.every) is not None:
            for ax, values in zip(column, (each.imag / (2.0 * np.pi), -each.real), strict=True):
                below = np.where(each.imag < 2.0 * np.pi * top, values, np.nan)
                ax.plot(first.speed / RPM, below, **DOTS)
        for name in names:
            for ax, quantity in zip(column, ("frequency", "decay"), strict=True):
                _line(ax, name, first, others, quantity, top)
        handles = [Line2D([], [], label=label(name), **_look(name)) for name in names]
        place = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.3)}  # below, where it hides no line
        column[1].legend(handles=handles, fontsize=7.0, ncols=2, columnspacing=1.2, handlelength=2.4, **place)
        column[1].set_xlabel("Speed [rpm]")
    rpm = first.speed[[0, -1]] / RPM
    for ax in axes[0]:
        for order in (1, 2, 3, 4):
            ax.plot(rpm, order * rpm / 60.0, color="0.55", linewidth=0.6, zorder=0)
            if order * rpm[1] / 60.0 < top:
                ax.annotate(f"{order}", (rpm[1], order * rpm[1] / 60.0), color="0.4", fontsize=6.5, va="center")
        ax.set(ylim=(0.0, top), xlim=rpm)
    axes[0, 0].set(ylabel="Frequency in the fixed frame [Hz]")
    axes[1, 0].set(ylabel="Decay rate [1/s]")
    drawn = np.concatenate([values[np.isfinite(values)] for values in first.decay.values()])
    low, high = float(drawn.min()), float(np.quantile(drawn, 0.98))
    axes[1, 0].set_ylim(min(0.0, 1.1 * low), 1.25 * high)
    if low < 0.0:
        for ax in axes[1]:
            ax.axhline(0.0, color="0", linewidth=0.6)
    axes[0, 0].set_title("Ring and wheel, $n = 1$", loc="left")
    axes[0, 1].set_title("Waves of the belt", loc="left")
    where = f"on the road, belt harmonics to {first.n_max}" if first.contact else "under a given load"
    models = " (lines), ".join([f"{first.model} model", *(f"{other.model} (circles)" for other in others)])
    title = f"Campbell diagram {where}\n{models}; {first.unit.sidewall_damping} damping of the sidewall"
    figure.suptitle(title, fontsize=8.5)
    note = "Thin: orders 1 to 4 of the rotation."
    if first.contact:
        note += " Grey: all modes; a line is where one harmonic has a third of the mode."
    figure.supxlabel(note, fontsize=7.0, x=0.01, ha="left")
    figure.align_ylabels()
    return figure


def _of_belt(name: str) -> bool:
    return name.startswith("n_")


def _look(name: str) -> dict[str, Any]:
    if not _of_belt(name):
        return LINES[name]
    _, number, wave = name.split("_")
    return {"color": WAVE_LINES[(int(number) - 2) % len(WAVE_LINES)], "linestyle": WAVE_DASHES[wave]}


def _line(
    ax: Axes, name: str, first: CampbellDiagram, others: Sequence[CampbellDiagram], quantity: str, top: float
) -> None:
    rpm, values = first.line(name, quantity)
    ax.plot(rpm, np.where(first.line(name, "frequency")[1] < top, values, np.nan), zorder=2, **_look(name))
    for other in others:
        some = slice(None, None, max(1, len(other.speed) // 12))
        marks = np.where(other.frequency[name] < top, getattr(other, quantity)[name], np.nan)[some]
        ax.plot(other.speed[some] / RPM, marks, color=_look(name)["color"], marker="o", zorder=3, **MARKERS)
