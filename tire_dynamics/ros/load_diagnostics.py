"""What the node says of the loads that it estimates, on /diagnostics and in its log."""

from __future__ import annotations

import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from ..replay.load_source import LoadSource
from .diagnostics import Finding

__all__ = ["change_of", "of_loads"]


def of_loads(loads: LoadSource) -> Finding:
    """Sources in use and those that are missing, the band, standard deviations, and what was learnt.

    Parameters
    ----------
    loads : LoadSource
    """
    found, used, missing = loads.filter, loads.filter.sources, loads.missing
    level, summary = DiagnosticStatus.OK, f"from {', '.join(used)}, up to {found.band_hz:g} Hz"
    if not found.running:
        level, summary = DiagnosticStatus.ERROR, "no estimate: no sample has come within the last 500 ms"
    elif missing:
        level, summary = DiagnosticStatus.WARN, f"degraded, without {', '.join(missing)}: {summary}"
    error, deviation = found.mass_error
    values: dict[str, Any] = {
        "sources in use": ", ".join(used) or "none",
        "degraded sources": ", ".join(missing) or "none",
        "band [Hz]": f"{found.band_hz:g}",
    }
    if found.running:
        each = zip(loads.wheels, found.load.tolist(), found.standard_deviation.tolist(), strict=True)
        for wheel, load, spread in each:
            values[f"{wheel}: load [N]"] = f"{load:.1f}"
            values[f"{wheel}: standard deviation [N]"] = f"{spread:.1f}"
    values |= {
        "sprung mass beyond what was told [%]": f"{100.0 * error:.2f} +- {100.0 * deviation:.2f}",
        "roughness of the road, Gd(0.1 cycles/m) [m^3]": f"{found.roughness:.2e}",
        "times begun anew": found.restarts,
    }
    for name, mean in found.consistency.items():
        if not math.isnan(mean):
            values[f"{name}: mean squared normalised innovation"] = f"{mean:.2f}"
    for name, counts in found.counts.items():
        values |= {f"{name}: {outcome}": count for outcome, count in counts.items()}
    values |= {f"{name}: in the future": count for name, count in loads.in_the_future.items()}
    return Finding(level, summary, values)


def change_of(before: tuple[str, ...] | None, loads: LoadSource) -> str:
    """A line for the log if other sources are missing than ``before``; empty if not."""
    missing = loads.missing
    if before is None or missing == before:
        return ""
    gone, back = ([name for name in a if name not in b] for a, b in ((missing, before), (before, missing)))
    parts = [f"without {', '.join(gone)}"] if gone else []
    parts += [f"with {', '.join(back)} again"] if back else []
    return f"load estimate: {', '.join(parts)}; loads are known up to {loads.filter.band_hz:g} Hz"
