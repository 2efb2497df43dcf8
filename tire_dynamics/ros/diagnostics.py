"""What the node says of itself and of its wheels on /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from ..estimator.vehicle import Vehicle
from ..files.errors import first_line

__all__ = ["Finding", "message", "of_idle_node", "of_node", "of_ticks", "of_wheel", "step_times"]

_SOME_MISSED, _MANY_MISSED = 0.01, 0.1  # shares of the ticks of a second: a warning, an error
_MANY_LATE = 0.25  # share of the samples of a second; on the way a good part of them passes a tick, at 500 Hz and more
_SOME_REFUSED = 0.05
_NOT_REFUSED = ("taken", "late", "repeated", "no stamp", "off the ground", "joint twice")

# Whose force variation that is: a machine that holds the wheel at a fixed height reads another.
_RFV_OF = {
    "road": "this vehicle on the road, whose axle gives way",
    "topic": "this vehicle under loads that are given",
    "estimate": "this vehicle under loads that are estimated",
}
_NO_RUNOUT = "radial_runout has no effect: the load is given; load_source road has it"


class Finding(NamedTuple):
    """Level, summary and values of a status."""

    level: bytes
    summary: str
    values: Mapping[str, Any]


def message(full_name: str, name: str, found: Finding) -> DiagnosticStatus:
    """A finding as ROS has it: of a node in a namespace too, no other status has its name."""
    return DiagnosticStatus(
        level=found.level,
        name=f"{full_name.lstrip('/')}: {name}",
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


def of_ticks(missed: int, ticks: int, rate: float, simulated: bool) -> tuple[bytes, str]:
    """Of the ticks of the last second: level, and what is wrong; nothing is if few were missed.

    Parameters
    ----------
    missed, ticks : int
    rate : float
        That is asked for [Hz].
    simulated : bool
        Whether /clock makes the ticks.
    """
    share = missed / max(missed + ticks, 1)
    if share < _SOME_MISSED:
        return DiagnosticStatus.OK, ""
    what = f"{100.0 * share:.0f} % of the ticks missed in the last second"
    if simulated:
        return DiagnosticStatus.WARN, f"{what}: /clock comes less often than rate_hz, {rate:g} Hz"
    level = DiagnosticStatus.WARN if share < _MANY_MISSED else DiagnosticStatus.ERROR
    return level, f"{what}: this machine is too slow or too busy for {rate:g} Hz"


def of_node(
    wheels: int,
    values: Mapping[str, Any],
    log: tuple[Mapping[str, Any], str, str],
    troubles: Sequence[tuple[bytes, str]],
) -> Finding:
    """Of an active node.

    Parameters
    ----------
    wheels : int
    values : mapping
        Its counters.
    log : tuple
        As :meth:`.Journal.account` returns it: counters, what is wrong, and what is missing.
    troubles : sequence of tuple
        What else may be wrong: a level and a summary each, empty for nothing.
    """
    logged, trouble, missing = log
    found = [(level, text) for level, text in troubles if text]
    if trouble:
        found.append((DiagnosticStatus.ERROR, trouble))
    elif missing:
        found.append((DiagnosticStatus.WARN, missing))
    level = max((level for level, _ in found), default=DiagnosticStatus.OK)
    summary = "; ".join(text for _, text in found) or f"{wheels} wheels"
    return Finding(level, summary, {**values, **logged})


def of_wheel(
    vehicle: Vehicle,
    index: int,
    stability: Mapping[str, Any],
    variation: Mapping[str, str],
    samples: Mapping[str, int],
    hint: str,
    load_source: str,
) -> Finding:
    """Of a wheel: its inputs and their ages, stability and force variation.

    Parameters
    ----------
    vehicle : Vehicle
    index : int
    stability : mapping
        The last reply of the stability analysis; empty before the first.
    variation : mapping
        Of the radial force, by harmonic.
    samples : mapping
        By outcome, those of the last second.
    hint : str
        Why there may be no speed; empty if that is not known.
    load_source : str
        As the parameter has it.
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
            stale.append(f"no {name} yet" + f" ({hint})" * (name == "speed" and bool(hint)))
        elif age > vehicle.settings.input_timeout:
            stale.append(f"{name} is {age * 1e-9:.3f} s old")
    if stale:
        level, summary = DiagnosticStatus.ERROR, "no output: " + ", ".join(stale)
    if doubt := _of_samples(samples):
        level, summary = max(level, DiagnosticStatus.WARN), f"{summary}; {doubt}"
    values = {
        "in motion": inputs.running,
        **{f"age of {name} [s]": "-" if age is None else f"{age * 1e-9:.4f}" for name, age in ages.items()},
        "speed [rad/s]": f"{inputs.speed:.4f}",
        "load source": load_source,
        "load [N]": f"{inputs.load[0]:.1f}",
        **({"road height [m]": _shown(inputs.height, ".4f")} if on_road else {}),
        **({"note": _NO_RUNOUT} if unit.radial_runout and not on_road else {}),
        "stability is of contact": stability.get("contact", on_road),
        "stability": verdict,
        "stability at speed [rad/s]": _shown(stability.get("speed_rad_s"), ".4f"),
        "spectral radius": _shown(stability.get("spectral_radius"), ".6f"),
        "critical speed [rad/s]": _shown(stability.get("critical_speed_rad_s"), ".2f"),
        "periodicity": stability.get("periodicity", "not yet known"),
        "nearest tongue [rad/s]": _shown(stability.get("nearest_tongue_rad_s"), ".2f"),
        **variation,
        **({"RFV is of": _RFV_OF[load_source]} if len(variation) > 1 else {}),
        "stops for stale inputs": inputs.stops,
        "stops for divergence": inputs.divergences,
        **{f"samples {outcome}": count for outcome, count in inputs.counts.items()},
    }
    return Finding(level, summary, values)


def _of_samples(samples: Mapping[str, int]) -> str:
    """What is wrong with the samples of a second."""
    count = sum(samples.values())
    worst = [
        f"{100.0 * number / count:.0f} % of its samples {outcome}"
        for outcome, number in samples.items()
        if number >= count * (_MANY_LATE if outcome == "late" else _SOME_REFUSED)
        and (outcome == "late" or outcome not in _NOT_REFUSED)
        and number > 0
    ]
    return ", ".join(worst)


def _shown(value: float | None, form: str) -> str:
    return "none" if value is None else format(value, form)
