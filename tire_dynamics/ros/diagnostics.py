"""What the node says of itself and of its wheels on /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from ..estimator.vehicle import Vehicle
from ..files.errors import first_line

__all__ = ["Finding", "message", "of_idle_node", "of_node", "of_wheel", "step_times"]


_NO_RUNOUT = "radial_runout has no effect: the load is given; load_source road has it"
_NO_VARIATION = "radial_nonuniformity and tangential_nonuniformity have no effect on the road"


class Finding(NamedTuple):
    """Level, summary and values of a status."""

    level: bytes
    summary: str
    values: Mapping[str, Any]


def message(node: str, full_name: str, name: str, found: Finding) -> DiagnosticStatus:
    """A finding as ROS has it."""
    return DiagnosticStatus(
        level=found.level,
        name=f"{node}: {name}",
        message=found.summary,
        hardware_id=full_name,
        values=[KeyValue(key=key, value=str(value)) for key, value in found.values.items()],
    )


def step_times(times: Sequence[float]) -> dict[str, str]:
    """Median and longest of step times [s]."""
    ordered = sorted(times) or [0.0]
    return {
        "step time, median [us]": f"{1e6 * ordered[len(ordered) // 2]:.0f}",
        "step time, longest [us]": f"{1e6 * ordered[-1]:.0f}",
    }


def of_idle_node(state: str, refusal: Exception | None) -> Finding:
    """Of a node that waits for its lifecycle manager."""
    if refusal is None:
        return Finding(DiagnosticStatus.OK, state, {"state": state})
    return Finding(DiagnosticStatus.ERROR, f"{state}: {first_line(refusal)}", {"state": state})


def of_node(
    wheels: int, values: Mapping[str, Any], log: tuple[Mapping[str, Any], str, str], namesakes: int, full_name: str
) -> Finding:
    """Of an active node.

    Parameters
    ----------
    wheels : int
    values : mapping
        Its counters.
    log : tuple
        As :meth:`.Journal.account` returns it: counters, what is wrong, and what is missing.
    namesakes : int
        Other nodes of the same full name.
    full_name : str
    """
    logged, trouble, missing = log
    level, summary = DiagnosticStatus.OK, f"{wheels} wheels"
    if trouble:
        level, summary = DiagnosticStatus.ERROR, trouble
    elif missing:
        level, summary = DiagnosticStatus.WARN, missing
    if namesakes > 0:
        level = max(level, DiagnosticStatus.WARN)
        summary = f"{namesakes} other nodes are called {full_name}; {summary}"
    return Finding(level, summary, {**values, **logged})


def of_wheel(vehicle: Vehicle, index: int, stability: Mapping[str, Any], variation: Mapping[str, str]) -> Finding:
    """Of a wheel: its inputs and their ages, stability and force variation.

    Parameters
    ----------
    vehicle : Vehicle
    index : int
    stability : mapping
        The last reply of the stability analysis; empty before the first.
    variation : mapping
        Of the radial force, by harmonic.
    """
    inputs = vehicle.inputs[index]
    verdict = stability.get("verdict", "not yet known")
    level, summary = DiagnosticStatus.OK, verdict
    if verdict == "unstable":
        level = DiagnosticStatus.ERROR
    elif stability and verdict != "asymptotically stable":
        level = DiagnosticStatus.WARN
    on_road, unit = vehicle.wheels.on_road, vehicle.unit
    ages = dict(zip(("speed", "road" if on_road else "load"), inputs.ages(), strict=True))
    stale = []
    for name, age in ages.items():
        if age is None:
            stale.append(f"no {name} yet")
        elif age > vehicle.settings.input_timeout:
            stale.append(f"{name} is {age * 1e-9:.3f} s old")
    if stale:
        level, summary = DiagnosticStatus.ERROR, "no output: " + ", ".join(stale)
    values = {
        "in motion": inputs.running,
        **{f"age of {name} [s]": "-" if age is None else f"{age * 1e-9:.4f}" for name, age in ages.items()},
        "speed [rad/s]": f"{inputs.speed:.4f}",
        "load source": "road" if on_road else "topic",
        "load [N]": f"{inputs.load[0]:.1f}",
        **({"road height [m]": _shown(inputs.height, ".4f")} if on_road else {}),
        **({"note": _NO_RUNOUT} if unit.radial_runout and not on_road else {}),
        **({"note": _NO_VARIATION} if on_road and (unit.radial_nonuniformity or unit.tangential_nonuniformity) else {}),
        "stability is of contact": stability.get("contact", on_road),
        "stability": verdict,
        "stability at speed [rad/s]": _shown(stability.get("speed_rad_s"), ".4f"),
        "spectral radius": _shown(stability.get("spectral_radius"), ".6f"),
        "critical speed [rad/s]": _shown(stability.get("critical_speed_rad_s"), ".2f"),
        "periodicity": stability.get("periodicity", "not yet known"),
        "nearest tongue [rad/s]": _shown(stability.get("nearest_tongue_rad_s"), ".2f"),
        **variation,
        "stops for stale inputs": inputs.stops,
        "stops for divergence": inputs.divergences,
        **{f"samples {outcome}": count for outcome, count in inputs.counts.items()},
    }
    return Finding(level, summary, values)


def _shown(value: float | None, form: str) -> str:
    return "none" if value is None else format(value, form)
