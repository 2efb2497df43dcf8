"""The figures of the tire on the road, drawn from their tables."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from .campbell_diagram import draw, from_table
from .road_tables import CAMPBELL_HIGHEST, CAUSES, CLEAT, CLEAT_SPEED, MOUNTS, SNAPSHOTS, Table, road_unit

__all__ = ["campbell_contact", "cleat", "force_variation", "load_or_road"]

WIDTH = 6.6  # of every figure [in]
BLACK, BLUE, ORANGE = "0", "#0b4f9e", "#c85200"
LARGER = 4.0  # deflections beside the belt's radius
TREAD = 14.0  # [mm] that is left blank between the belt and the road


def load_or_road(table: Table) -> Figure:
    """What arrives at the axle of a load that is given, and of a road."""
    figure = Figure(figsize=(WIDTH, 3.6))
    ax = figure.subplots()
    f = table["frequency_Hz"]
    ax.loglog(f, table["axle_force_per_given_load"], color=BLACK, label="given load: $F'/F$")
    ax.loglog(f, table["axle_force_per_K_v_times_road"], color=BLUE, linestyle="--", label="road: $F'/(K_v r)$")
    ax.loglog(
        f, table["contact_force_per_K_v_times_road"], color=ORANGE, linestyle=":", label="road: $F/(K_v r)$, contact"
    )
    ax.set(xlabel="Frequency [Hz]", ylabel="Force ratio [-]", xlim=(f[0], f[-1]), ylim=(1e-3, 20.0))
    ax.set_title(
        "A load that is given meets a wheel that is free: it hops at 8 Hz. On the road it hops at 21 Hz", loc="left"
    )
    ax.legend(loc="lower left")
    return figure


def cleat(table: Table) -> Figure:
    """Forces and belt while a wheel rolls over a cleat."""
    figure = Figure(figsize=(WIDTH, 4.9))
    grid = figure.add_gridspec(2, len(SNAPSHOTS), height_ratios=(1.25, 1.0))
    forces = figure.add_subplot(grid[0, :])
    t = table["time_ms"]
    for points, style in ((1, "--"), (9, "-")):
        name = "one patch" if points == 1 else "nine points"
        for quantity, color, label in (
            ("contact", ORANGE, "contact"), ("axle_z", BLACK, "axle, vertical"), ("axle_x", BLUE, "axle, horizontal"),
        ):  # fmt: skip
            column = table[f"{quantity}_{points}_points_N"]
            forces.plot(t, column, color=color, linestyle=style, label=f"{label}, {name}")
    for at in SNAPSHOTS:
        forces.axvline(at, color="0.8", linewidth=0.7, zorder=0)
    height, _, length = (1e3 * value for value in CLEAT)
    unit = road_unit()
    forces.set(xlabel="Time [ms]", ylabel="Force [N]", xlim=(t[0], t[-1]))
    forces.set_title(
        f"Cleat {length:g} x {height:g} mm at {CLEAT_SPEED * unit.radius * 3.6:.0f} km/h; grey: the belts below",
        loc="left",
    )
    forces.legend(loc="center right", ncols=2, fontsize=7.0)
    a, psi = 1e3 * unit.radius, np.radians(table["psi_deg"])
    for k, at in enumerate(SNAPSHOTS):
        ax = figure.add_subplot(grid[1, k])
        radius = a + LARGER * (table[f"u_z_{at:g}_ms_mm"] - TREAD)
        ax.plot(-radius * np.cos(psi), radius * np.sin(psi), color=BLACK)  # forward to the right
        x = a * np.linspace(-0.6, 0.6, t.size)
        ax.plot(x, -a + LARGER * table[f"road_above_free_belt_{at:g}_ms_mm"], color=ORANGE)
        ax.plot(0.0, 0.0, color=BLACK, marker="+")
        ax.set(aspect="equal", xlim=(-1.15 * a, 1.15 * a), ylim=(-1.2 * a, 1.15 * a), xticks=[], yticks=[])
        ax.set_title(f"{at:g} ms")
        ax.grid(False)
        for side in ("left", "bottom"):
            ax.spines[side].set_visible(False)
    note = f"Forward is right. Deflections, cleat and tread (blank, belt to road) are drawn {LARGER:g} times as large."
    figure.text(0.01, 0.015, note, fontsize=7.0)
    return figure


def force_variation(table: Table) -> Figure:
    """Radial force variation over speed, as a machine and as a car has it."""
    figure = Figure(figsize=(WIDTH, 3.2))
    axes = figure.subplots(1, len(CAUSES), sharex=True)
    titles = ("$k_z$ varies by 2 %", "0.5 mm of run-out", "20 g on the belt")
    for ax, cause, title in zip(axes, CAUSES, titles, strict=True):
        for mount, color, style in zip(MOUNTS, (BLACK, BLUE), ("-", "--"), strict=True):
            label = "fixed height (machine)" if mount == "machine" else "on a car"
            ax.plot(table["speed_km_h"], table[f"{cause}_{mount}_N"], color=color, linestyle=style, label=label)
        ax.set(xlabel="Speed [km/h]", xlim=(0, 200), ylim=(0, None))
        ax.set_title(title)
    axes[0].set_ylabel("First harmonic of the\naxle force, peak to peak [N]")
    axes[-1].legend(loc="upper left", fontsize=7.0, handlelength=2.2)
    return figure


def campbell_contact(table: Table) -> Figure:
    """Frequencies and decay rates over speed of the tire on the road."""
    unit = road_unit()
    return draw([from_table(table, unit, model, n_max, f"{model}_") for model, n_max in CAMPBELL_HIGHEST.items()])
