"""The figures drawn from their tables: one function per figure, one style for all, readable without colour."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any, TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..science.campbell import WAVES, WHEEL_MODES
from ..science.nonuniform import CombinationResonance
from ..science.ring import CONTACT_ANGLE
from ..science.unit import MODAL, REACTION, TireWheelUnit
from .measured_tire import draw as measured_tire  # noqa: F401 - looked up here by name
from .road_drawings import campbell_contact, cleat, force_variation, load_or_road  # noqa: F401 - looked up here by name
from .tables import (
    BELT_MODELS,
    CAMPBELL_MODES,
    DAMPINGS,
    FIG3_RPM,
    FIG3_ZETA_N,
    FIG4_MODES,
    FIG5_CASES,
    FIG6_ZETA_1,
    FIG7_ZETA_S,
    RPM,
    SIDES,
    TONGUE_EPS,
    TONGUE_ZETA,
    WHEEL_MODELS,
    FloatArray,
    Table,
    hybrid_critical_speed,
    tongue_thresholds,
    tongue_unit,
)

T = TypeVar("T")  # a table, or what else is drawn
WIDTH = 6.6  # of every figure [in]
STYLE: dict[Any, Any] = {
    "figure.constrained_layout.use": True,
    "figure.constrained_layout.w_pad": 0.06,
    "savefig.dpi": 200,
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.titlesize": 8.5,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "legend.handlelength": 3.0,
    "legend.title_fontsize": 8.0,
    "hatch.linewidth": 0.4,
}

# Each with its own dashes, and from dark to light, so that they differ without colour.
LINES: tuple[dict[str, Any], ...] = (
    {"color": "#000000", "linestyle": "-"},
    {"color": "#0b4f9c", "linestyle": (0, (5, 1.6))},
    {"color": "#c2410c", "linestyle": (0, (5, 1.4, 1, 1.4))},
    {"color": "#1a9a78", "linestyle": (0, (1.2, 1.2))},
    {"color": "#b07cc6", "linestyle": (0, (7, 1.4, 1, 1.4, 1, 1.4))},
)
REMARK: dict[str, Any] = {"color": "0.25", "bbox": {"facecolor": "white", "edgecolor": "none", "pad": 1.5}}
MARKERS: dict[str, Any] = {"linestyle": "none", "markersize": 3.4, "markerfacecolor": "white", "markeredgewidth": 0.8}
DAMPING_TITLES = {MODAL: "Modal damping, as in the paper", REACTION: "Damping with a reaction on the wheel"}
FIG3_LARGER = 8.0  # deflections beside the belt's radius
MODE_NAMES = dict(zip(WHEEL_MODES, ("wheel hop", "ring fore-aft", "ring vertical"), strict=True))


def save(path: Path, draw: Callable[[T], Figure], table: T) -> None:
    """Draw a table and write the figure as PNG."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()  # whatever the user's own style is
        matplotlib.rcParams.update(STYLE)
        draw(table).savefig(path, format="png", metadata={"Software": None}, pil_kwargs={"optimize": True})


def fig3(table: Table) -> Figure:
    """The deflected belt around the wheel."""
    figure = Figure(figsize=(WIDTH, 6.9))
    axes = figure.subplots(2, 2, squeeze=False)
    titles = ("Rotating", "Hybrid: without the Coriolis terms")
    radius = 1e3 * TireWheelUnit.table_1().radius
    psi = CONTACT_ANGLE + np.radians(table["angle_from_contact_deg"])
    for (row, zeta_n), (column, model) in product(enumerate(FIG3_ZETA_N), enumerate(BELT_MODELS)):
        ax = axes[row, column]
        ax.plot(radius * np.cos(psi), radius * np.sin(psi), color="0.7", linewidth=0.7)
        for rpm, line in zip(FIG3_RPM, LINES, strict=False):
            u_z, u_theta = (
                FIG3_LARGER * table[f"{name}_{model}_{rpm}_rpm_zeta_n_{zeta_n}_mm"] for name in ("u_z", "u_theta")
            )
            X = (radius + u_z) * np.cos(psi) - u_theta * np.sin(psi)
            up = (radius + u_z) * np.sin(psi) + u_theta * np.cos(psi)
            ax.plot(X, up, label=f"{rpm} rpm", **{**line, "linewidth": 1.0})
        ax.annotate("", (0.0, -radius + 40.0), (0.0, -radius - 60.0), arrowprops={"arrowstyle": "->", "linewidth": 0.8})
        ax.text(12.0, -radius - 55.0, "$F$")
        turn = np.radians(np.linspace(60.0, 120.0, 31))
        ax.plot(0.35 * radius * np.cos(turn), 0.35 * radius * np.sin(turn), color="0.3", linewidth=0.8)
        ax.annotate(
            "", (0.35 * radius * np.cos(turn[-1]), 0.35 * radius * np.sin(turn[-1])),
            (0.35 * radius * np.cos(turn[-2]), 0.35 * radius * np.sin(turn[-2])),
            arrowprops={"arrowstyle": "->", "linewidth": 0.8, "color": "0.3"},
        )  # fmt: skip
        ax.text(0.0, 0.4 * radius, r"$\Omega$", ha="center")
        ax.set(aspect="equal", xlim=(-395, 395), ylim=(-430, 370), xticks=[], yticks=[])
        ax.set_title(rf"{titles[column]}, $\zeta_n = {zeta_n}$")
        ax.grid(False)
        for side in ("left", "bottom"):
            ax.spines[side].set_visible(False)
    axes[0, 0].legend(loc="center", bbox_to_anchor=(0.5, 0.5), handlelength=2.4)
    figure.supxlabel(
        rf"Modes $n \geq 2$ under $F = 1961$ N, deflections {FIG3_LARGER:g} times as large; grey: without load",
        fontsize=8.0,
    )
    return figure


def fig4(table: Table) -> Figure:
    """Amplitude, lag and stiffness of modes 2 to 4 under a load that stands in space."""
    figure, axes = _panels(3, 2, 6.2, sharex=True, sharey="row")
    rows = (
        ("amplitude_ratio_{}_n_{}", "Amplitude over\nstatic amplitude [-]"),
        ("lag_{}_n_{}_deg", "Lag angle $\\varphi_n$ [deg]"),
        ("stiffness_ratio_{}_n_{}", "Undamped stiffness to the\nload over static stiffness [-]"),
    )
    titles = ("Rotating", "Hybrid: without the Coriolis terms")
    for (row, (name, label)), (column, model) in product(enumerate(rows), enumerate(BELT_MODELS)):
        ax = axes[row, column]
        for n, line in zip(FIG4_MODES, LINES, strict=False):
            ax.plot(table["speed_rpm"], table[name.format(model, n)], label=f"$n = {n}$", **line)
        if row == 0:
            ax.set(title=titles[column], ylim=(0, 2.5))
        if row == 1:
            ax.set(ylim=(0, 90), yticks=np.arange(0, 91, 30))
        if row == 2:
            ax.set(xlabel="Speed [rpm]", xlim=(0, 6000), ylim=(-3.5, 1.4))
            ax.axhline(0.0, color="0.4", linewidth=0.6)
        if column == 0:
            ax.set_ylabel(label)
    axes[0, 0].legend(loc="upper left", title=r"$\zeta_n = 0.2$")
    axes[2, 0].text(150, -1.2, "near 1, never zero:\nno critical speed", **REMARK)
    unit = TireWheelUnit.table_1()
    critical = [hybrid_critical_speed(unit, n) / RPM for n in FIG4_MODES]
    for speed, line in zip(critical, LINES, strict=False):
        axes[2, 1].plot(speed, 0.0, color=line["color"], marker="o", **MARKERS)
    speeds = ", ".join(f"{speed:.0f}" for speed in critical)
    axes[2, 1].text(150, -2.0, f"zero at the critical\nspeeds {speeds} rpm", **REMARK)
    figure.align_ylabels()
    return figure


def fig5(table: Table) -> Figure:
    """Wheel and ring centre after a step of the load."""
    figure, axes = _panels(3, 1, 5.8, sharex=True)
    rows = (
        ("y", "Wheel $y$, up [mm]"),
        ("x_c", "Ring centre $x_c$, rearward [mm]"),
        ("y_c", "Ring centre $y_c$, up [mm]"),
    )
    for ax, (name, label) in zip(axes.flat, rows, strict=True):
        for (rpm, zeta_s), line in zip(FIG5_CASES, LINES, strict=False):
            case = f"{rpm}_rpm_zeta_s_{zeta_s}_mm"
            ax.plot(table["time_s"], table[f"{name}_{case}"], label=rf"{rpm} rpm, $\zeta_s = {zeta_s}$", **line)
        ax.set_ylabel(label)
    axes[1, 0].legend(loc="lower right", ncols=3, title=r"$F = 1961$ N from time 0 on, $\zeta_1 = 0.05$")
    ax.set(xlabel="Time [s]", xlim=(0, 1))
    figure.align_ylabels()
    return figure


def fig6(table: Table) -> Figure:
    """Steady transmissibility over speed."""
    figure, axes = _panels(1, 1, 3.4)
    [[ax]] = axes
    _over_speed(ax, table, "K_zeta_1_{}")
    ax.set(ylabel="Force on the suspension over load, $K = F'/F$ [-]", ylim=(0, 1.05))
    ax.legend(loc="lower left")
    return figure


def fig7a(table: Table) -> Figure:
    """Stable region up to 6 000 rpm."""
    figure = _fig7(table, 6000)
    [ax] = figure.axes
    ax.legend(loc="lower left")
    ax.text(2600, 0.25, "stable", **REMARK)
    ax.text(5300, 0.46, r"unstable, $\zeta_s = 0.05$", ha="center", color="0.25")
    return figure


def fig7b(table: Table) -> Figure:
    """Stable region up to 60 000 rpm."""
    figure = _fig7(table, 60000)
    [ax] = figure.axes
    ax.legend(loc="upper right")
    ax.text(3000, 0.03, "stable", **REMARK)
    ax.text(30000, 0.25, "unstable", ha="center", color="0.25")
    return figure


def _fig7(table: Table, highest: int) -> Figure:
    """As the paper draws it: the speed along, the damping ratio up."""
    figure, axes = _panels(1, 1, 3.4)
    [[ax]] = axes
    boundaries = [table[f"critical_speed_zeta_s_{zeta_s}_rpm"] for zeta_s in FIG7_ZETA_S]
    _stable_region(ax, table["zeta_1"], boundaries[0], highest)
    for boundary, zeta_s, line in zip(boundaries, FIG7_ZETA_S, LINES, strict=False):
        ax.plot(boundary, table["zeta_1"], label=rf"loss of stability, $\zeta_s = {zeta_s}$", **line)
    return figure


def fig6_damping(table: Table) -> Figure:
    """Both components of the steady axle force, for both kinds of sidewall damping."""
    figure, axes = _panels(1, 2, 3.6)
    labels = ("Vertical axle force over load, $K$ [-]", "Forward axle force over load, no traction [-]")
    for ax, name, label in zip(axes.flat, ("K", "force_x_over_load"), labels, strict=True):
        _over_speed(ax, table, f"{name}_{MODAL}_zeta_1_{{}}", "modal, ")
        for zeta_1 in FIG6_ZETA_1:  # they coincide
            reaction = table[f"{name}_{REACTION}_zeta_1_{zeta_1}"]
            [line] = ax.plot(table["speed_rpm"], reaction, color="0.75", linewidth=4.0, zorder=1.5)
        line.set_label(r"reaction, any $\zeta_1$")
        ax.set_ylabel(label)
    axes[0, 0].set_ylim(0, 1.05)
    axes[0, 1].set_ylim(-0.1, 4.6)
    axes[0, 1].legend(loc="upper left", ncols=2, handlelength=2.2, handletextpad=0.5, columnspacing=1.0)
    return figure


def fig7_damping(table: Table) -> Figure:
    """Stable regions for both kinds of sidewall damping and both models of n = 1."""
    figure, axes = _panels(1, 2, 3.4, sharey=True)
    for ax, damping in zip(axes.flat, DAMPINGS, strict=True):
        inextensional, complete = (table[f"critical_speed_{damping}_{model}_rpm"] for model in WHEEL_MODELS)
        _stable_region(ax, table["zeta_1"], inextensional, 60000)
        ax.plot(inextensional, table["zeta_1"], label="inextensional, 6 states", **LINES[0])
        ax.plot(complete[::4], table["zeta_1"][::4], label="complete, 10 states", color="0", marker="o", **MARKERS)
        ax.text(2000, 0.02, "stable", **REMARK)
        ax.text(30000, 0.25, "unstable", ha="center", color="0.25")
        ax.set_title(DAMPING_TITLES[damping])
    axes[0, 0].legend(loc="upper right", title=r"$\zeta_s = 0.05$")
    axes[0, 1].set_ylabel("")
    return figure


def campbell(table: Table) -> Figure:
    """Damped frequencies seen from the ring and from the road, and decay rates."""
    figure, axes = _panels(3, 2, 7.0, sharex=True)
    waves, centre = axes.T
    quantities = ("ring_frame_{}_{}_Hz", "fixed_frame_{}_{}_Hz", "decay_rate_{}_{}_1_s")
    for row, quantity in enumerate(quantities):
        for n, line in zip(CAMPBELL_MODES, LINES, strict=False):
            for wave, marker in zip(WAVES, "v^", strict=True):
                _both_models(waves[row], table, quantity, f"n_{n}_{wave}", line, marker)
        for mode, line in zip(WHEEL_MODES, LINES, strict=False):
            for motion in [f"{mode}_{side}" for side in SIDES] if row == 0 else [mode]:
                _both_models(centre[row], table, quantity, motion, line, "o")
    for n, line in zip(CAMPBELL_MODES, LINES, strict=False):
        waves[0].plot(table["speed_rpm"], n * table["speed_rpm"] / 60.0, **{**line, "color": "0.6", "linewidth": 0.8})
    labels = ("Frequency on the ring [Hz]", "Frequency in the fixed frame [Hz]", "Decay rate, in both frames [1/s]")
    for column, highest in zip(axes.T, ((450, 750, 30), (300, 120, 30)), strict=True):
        for ax, limit in zip(column, highest, strict=True):
            ax.set(ylim=(0, limit))
        ax.set(xlabel="Speed [rpm]", xlim=(0, 6000))
    for ax, label in zip(waves, labels, strict=True):
        ax.set_ylabel(label)
    waves[0].set_title("Waves $n = 2, 3, 4$")
    centre[0].set_title("Ring centre and wheel, $n = 1$")
    modes = [Line2D([], [], label=f"$n = {n}$", **line) for n, line in zip(CAMPBELL_MODES, LINES, strict=False)]
    load = Line2D([], [], color="0.6", linewidth=0.8, label=r"fixed load, $n\Omega/2\pi$")
    waves[0].legend(handles=[*modes, load], loc="upper left")
    waves[1].legend(handles=[_mark("v", "complete, backward"), _mark("^", "complete, forward")], loc="upper left")
    names = [Line2D([], [], label=MODE_NAMES[mode], **line) for mode, line in zip(WHEEL_MODES, LINES, strict=False)]
    centre[0].legend(handles=[*names, _mark("o", "complete; lines: inextensional")], loc="upper left")
    figure.align_ylabels()
    return figure


def _both_models(ax: Axes, table: Table, quantity: str, motion: str, line: dict[str, Any], marker: str) -> None:
    """The inextensional model's line and the complete model's marks on it."""
    inextensional, complete = (table[quantity.format(model, motion)] for model in WHEEL_MODELS)
    ax.plot(table["speed_rpm"], inextensional, **line)
    some = slice(10, None, 20)
    ax.plot(table["speed_rpm"][some], complete[some], color=line["color"], marker=marker, **MARKERS)


def _mark(marker: str, label: str) -> Line2D:
    return Line2D([], [], color="0", marker=marker, label=label, **MARKERS)


def multipliers(table: Table) -> Figure:
    """Paths of the multipliers in the complex plane, and their moduli."""
    figure, axes = _panels(1, 2, 3.5)
    plane, modulus = axes[0]
    speed = table["speed_rpm"]
    some = slice(None, None, 500)
    for mode, line in zip(WHEEL_MODES, LINES, strict=False):
        real, imag, size = (table[f"{mode}_{part}"] for part in ("real", "imag", "modulus"))
        for ax, x, y in ((plane, real, imag), (modulus, speed, size)):
            ax.plot(x, y, label=MODE_NAMES[mode], **line)
            ax.plot(x[some], y[some], color=line["color"], marker="o", **MARKERS)
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    plane.plot(np.cos(turn), np.sin(turn), color="0.4", linewidth=0.8)
    low, high = speed[[0, -1]]
    plane.set_title("Circles at the same speeds as on the right;\nthe complex conjugates are not drawn")
    plane.set(xlabel=r"Real part of $\mu$ [-]", ylabel=r"Imaginary part of $\mu$ [-]", aspect="equal")
    plane.set(xlim=(-1.1, 1.1), ylim=(-1.1, 1.1), xticks=np.arange(-1.0, 1.1, 0.5), yticks=np.arange(-1.0, 1.1, 0.5))
    critical = np.interp(1.0, table["ring_vertical_modulus"], speed)
    modulus.plot([low, high], [1.0, 1.0], color="0.4", linewidth=0.8)
    modulus.axvline(critical, color="0.4", linewidth=0.8)
    modulus.text(critical - 500.0, 0.74, f"stability is lost\nat {critical:.0f} rpm", ha="right", **REMARK)
    modulus.set(xlabel="Speed [rpm]", ylabel=r"Modulus $|\mu|$ [-]")
    modulus.legend(loc="lower center", bbox_to_anchor=(0.5, 0.0))
    return figure


def tongues(table: Table) -> Figure:
    """Spectral radius over speed and non-uniformity, and where it was predicted to leave 1."""
    figure, axes = _panels(len(TONGUE_ZETA), 1, 5.4, sharex=True)
    speed, eps = table["speed_rpm"], np.array(TONGUE_EPS)
    levels = np.linspace(1.0, 1.3, 16)
    levels[0] = 1.01  # nearer to 1 the points of the grid would show
    for ax, zeta in zip(axes.flat, TONGUE_ZETA, strict=True):
        radius = np.array([table[f"spectral_radius_zeta_{zeta}_eps_{value:.4f}"] for value in TONGUE_EPS])
        shade = ax.contourf(speed, eps, radius, levels=levels, cmap="YlOrRd", extend="max")
        for resonance in tongue_unit(zeta)[1]:
            if resonance.threshold < eps[-1]:
                _draw_resonance(ax, resonance, eps)
        if zeta:
            lowest = np.array([each for each in tongue_thresholds(zeta) if each[1] < eps[-1]])
            ax.plot(lowest[:, 0] / RPM, lowest[:, 1], color="0", marker="x", linestyle="none", markersize=4.5, zorder=5)
        ax.grid(False)
        ax.set(xlim=(0, 7000), ylim=(0.0, eps[-1]), ylabel=r"Stiffness $k_1(1 \pm \varepsilon)$: $\varepsilon$ [-]")
        ax.set_title("Without damping" if zeta == 0.0 else rf"$\zeta_1 = \zeta_s = {zeta}$", loc="left")
    modes = dict(
        zip(np.unique([resonance.frequencies for resonance in tongue_unit(0.0)[1]]), MODE_NAMES.values(), strict=True)
    )
    for resonance in tongue_unit(0.0)[1]:
        text = " + ".join(modes[frequency].removeprefix("ring ") for frequency in resonance.frequencies)
        axes[0, 0].text(resonance.speed / RPM - 235.0, 0.006, text, rotation=90, ha="center", va="bottom", fontsize=7.0)
    axes[-1, 0].set_xlabel("Speed [rpm]")
    bar = figure.colorbar(shade, ax=list(axes.flat), aspect=40, pad=0.02, ticks=levels[::5])
    bar.set_label(r"Largest multiplier of a turn, $|\mu|$ [-]")
    return figure


def _draw_resonance(ax: Axes, resonance: CombinationResonance, eps: FloatArray) -> None:
    """Where a tongue is predicted to begin, and its sides."""
    ax.plot(resonance.speed / RPM, resonance.threshold, color="0", marker="o", clip_on=False, zorder=4, **MARKERS)
    above = np.append(resonance.threshold, eps[eps > resonance.threshold])
    reach = resonance.growth * np.sqrt(above**2 - resonance.threshold**2) / RPM
    for side in (-reach, reach):
        ax.plot(resonance.speed / RPM + side, above, color="0.2", linewidth=0.7, linestyle="--")


def _panels(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, Any]:
    figure = Figure(figsize=(WIDTH, height))
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def _over_speed(ax: Axes, table: Table, name: str, label: str = "") -> None:
    for zeta_1, line in zip(FIG6_ZETA_1, LINES, strict=True):
        ax.plot(table["speed_rpm"], table[name.format(zeta_1)], label=rf"{label}$\zeta_1 = {zeta_1}$", **line)
    ax.set(xlabel="Speed [rpm]", xlim=(0, 4000))


def _stable_region(ax: Axes, zeta_1: FloatArray, boundary: FloatArray, highest: int) -> None:
    """The region at speeds below the boundary, which goes away without bound towards zeta_1 = 0, hatched."""
    damping, speed = np.append(0.0, zeta_1), np.append(max(boundary[0], highest), boundary)
    ax.fill_betweenx(damping, 0.0, speed, facecolor="0.95", edgecolor="0.75", hatch="////", linewidth=0.0)
    ax.set(xlabel="Speed [rpm]", xlim=(0, highest))
    ax.set(ylabel=r"Damping ratio of the ring's rigid mode, $\zeta_1$ [-]", ylim=(0, 0.5))
