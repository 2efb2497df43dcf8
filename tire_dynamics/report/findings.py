"""What a drive amounts to in words: the headline, and what is to be said about inputs, outputs and stability."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from ..cdr import messages
from ..estimator.load_filter import USUAL_TIMEOUT
from ..science import nonuniform
from .gather import Drive, Input
from .theory import RPM, Bands, Errors, verdict_of

__all__ = ["Finding", "Summary", "critical_range", "number", "seconds", "summary"]

Level = Literal["good", "note", "warning", "bad"]
LEVELS: tuple[Level, ...] = ("good", "note", "warning", "bad")

_REASONS = {
    "late": "came after the moment they describe had been computed, and count from their receipt",
    "repeated": "have the stamp of one before, and replace it",
    "out of order": "are older than one received before, and are left out",
    "no stamp": "have no stamp: the time of receipt is taken",
    "in the future": "have a stamp beyond the input timeout after their receipt, and are left out",
    "not finite": "are not finite, and are left out",
    "speed too high": "are beyond max_speed_rad_s, and are left out",
    "load too high": "are beyond max_load_n, and are left out",
    "off the ground": "are negative loads, which count as zero: the road cannot pull",
    "no velocity": "have not one velocity for each joint, and are left out",
    "malformed": "are not what their type says, and are left out",
}
_SOURCES = {"hub": "hub accelerations", "travel": "travel", "imu": "the IMU", "wheel_speed": "wheel speeds"}
_HARMLESS = 0.01  # share of messages of which it is only noted
_LIKELY = 0.05  # share of tires within the errors of which it is only noted


class Finding(NamedTuple):
    """One thing to know, and how much it matters."""

    level: Level
    text: str


class Summary(NamedTuple):
    """The headline with its level, everything found, and what stability depends on.

    ``covered`` and ``verdict`` are those of each wheel; ``verdict`` None where it has no speed.
    """

    level: Level
    headline: str
    findings: list[Finding]
    covered: list[float]
    verdicts: list[str | None]


def summary(drive: Drive, critical: float | None, known: Errors | None = None, band: Bands | None = None) -> Summary:
    """Look at a drive; ``critical`` is the speed at which its tire loses stability [rad/s], if it does."""
    covered = [1.0 - min(1.0, _uncovered(drive, k) / drive.duration) for k in range(len(drive.wheels))]
    verdicts, stability = _stability(drive, critical)
    findings = [stability, *_uncertain(drive, known, band), *_outputs(drive, covered), *_bag(drive)]
    findings += [Finding("warning", f"The inputs are doubtful: {doubt}") for doubt in drive.doubts]
    for each in drive.inputs:
        findings += _input(drive, each)
    findings += _setting(drive)
    findings.sort(key=lambda finding: -LEVELS.index(finding.level))
    level: Level = max((finding.level for finding in findings), key=LEVELS.index)
    concerns = sum(finding.level in ("warning", "bad") for finding in findings)
    share = math.floor(1000.0 * min(covered)) / 10.0  # 100 % is nothing less
    least = "outputs cover the whole drive"
    if share <= 0.0:
        least = "the wheel has no outputs" if len(covered) == 1 else "there is a wheel without outputs"
    elif share < 99.9:
        least = f"outputs cover {'' if len(covered) == 1 else 'at least '}{share:g} % of the drive"
    remark = {0: "no concerns", 1: "one thing to look at"}.get(concerns, f"{concerns} things to look at")
    headline = f"{stability.text.split(':')[0]}; {least}; {remark}."
    return Summary(level, headline, findings, covered, verdicts)


def _uncovered(drive: Drive, index: int) -> float:
    """Time without outputs [s], beginning and end included; a step less than a period is none."""
    wheel = drive.wheels[index]
    if not wheel.outputs:
        return drive.duration
    period = 1.0 / wheel.spectra.rate
    ends = (wheel.first, drive.duration - wheel.last)
    return wheel.missing + sum(end for end in ends if end > 1.5 * period)


def _stability(drive: Drive, critical: float | None) -> tuple[list[str | None], Finding]:
    verdicts: list[str | None] = []
    unstable: dict[str, float] = {}
    for wheel in drive.wheels:
        if not wheel.speeds:
            verdicts.append(None)
            continue
        speeds = {*map(float, wheel.speeds), wheel.highest_speed}
        verdict, bad = verdict_of(drive.unit, speeds, drive.parameters["model"], drive.contact_modes)
        verdicts.append(verdict)
        if bad:
            unstable[wheel.name] = min(bad)
    highest = max((wheel.highest_speed for wheel in drive.wheels), default=0.0)
    limit = "it has no critical speed"
    if critical is not None:
        limit = f"its critical speed is {number(critical / RPM)} rpm"
        if highest > 0.0:
            limit += f", {critical / highest:.3g} times the highest driven ({number(highest / RPM)} rpm)"
    if not any(verdicts):
        return verdicts, Finding("note", f"No speed is known, and so not whether the tire was stable: {limit}.")
    if unstable:
        names = ", ".join(f"{name} from {number(speed / RPM)} rpm on" for name, speed in unstable.items())
        return verdicts, Finding("bad", f"The rotating tire was unstable: {names}; {limit}.")
    if "marginally stable" in verdicts:
        return verdicts, Finding("warning", f"The rotating tire was only marginally stable: {limit}.")
    return verdicts, Finding("good", f"The rotating tire was stable at every speed driven: {limit}.")


def _uncertain(drive: Drive, known: Errors | None, band: Bands | None) -> list[Finding]:
    """What the errors of the parameters leave of the verdict."""
    if known is None or band is None:
        return []
    unstable, never = band.whole.unstable, band.whole.never
    highest = max((wheel.highest_speed for wheel in drive.wheels), default=0.0)
    level: Level = "good" if unstable == 0.0 else "note" if unstable <= _LIKELY else "warning"
    errors = ", ".join(f"{name} {100.0 * error:.3g} %" for name, error in known.errors.items())
    text = f"With errors of {errors} the critical speed is {critical_range(band)}, 5 to 95 % of {known.samples} tires"
    text += f"; {100.0 * never:.3g} % have none" if never else ""
    share = "none" if unstable == 0.0 else f"{100.0 * unstable:.3g} %"
    return [
        Finding(
            level, f"{text}; {share} of them is unstable at the highest speed driven ({number(highest / RPM)} rpm)."
        )
    ]


def critical_range(band: Bands) -> str:
    """The critical speed, 5 to 95 %, in words."""
    low, _, high = (band.whole.critical_speed / RPM).tolist()
    if math.isinf(low):
        return "none"
    return f"{number(low)} rpm to none" if math.isinf(high) else f"{number(low)} to {number(high)} rpm"


def _outputs(drive: Drive, covered: list[float]) -> list[Finding]:
    found = []
    for wheel, share in zip(drive.wheels, covered, strict=True):
        missing = (1.0 - share) * drive.duration
        if wheel.unusable:
            text = f"{wheel.name}: {number(wheel.unusable)} axle forces are malformed or not finite, and are left out."
            found.append(Finding("bad", text))
        if not wheel.outputs:
            why = drive.without.get(wheel.name) or "it never had a fresh speed and a fresh load"
            found.append(Finding("bad", f"{wheel.name} has no outputs: {why}."))
        elif share < 0.999:
            level: Level = "warning" if share > 0.5 else "bad"
            longest = max((end - begin for begin, end in wheel.gaps), default=0.0)
            where = f", the longest gap within {seconds(longest)}" if wheel.gaps else ", at the beginning or the end"
            text = f"{wheel.name} has no outputs for {seconds(missing)} ({100 * missing / drive.duration:.3g} %){where}"
            found.append(Finding(level, f"{text}: its inputs were stale, or ticks were missed."))
    return found


def _bag(drive: Drive) -> list[Finding]:
    found = []
    if drive.damage:
        found.append(Finding("bad", f"The bag is damaged: {drive.damage}; the report is of what stands before."))
    if drive.dropped:
        what = ", ".join(f"{count} on {topic}" for topic, count in drive.dropped.items())
        found.append(Finding("warning", f"The log lacks messages that were dropped when the disk was slow: {what}."))
    if drive.clock_resets:
        text = f"The clock was set back {_times(drive.clock_resets)}; every wheel started anew from equilibrium."
        found.append(Finding("warning", text))
    if drive.changes:
        text = f"The tire was changed {_times(drive.changes)}; the model's curves are those of the first."
        found.append(Finding("warning", text))
    return found


def _input(drive: Drive, each: Input) -> list[Finding]:
    found = []
    for reason, count in each.counts.items():
        if count:
            share = count / each.messages
            level: Level = "note" if share <= _HARMLESS or reason in ("late", "no stamp") else "warning"
            text = f"{each.topic}: {number(count)} of {number(each.messages)} messages {_REASONS[reason]}."
            found.append(Finding(level, text))
    timeout = drive.parameters["input_timeout_s"]
    if each.is_sensor:
        if each.intervals.longest > 1e-9 * USUAL_TIMEOUT:
            text = f"{each.topic}: no message for {seconds(each.intervals.longest)}: meanwhile the loads were estimated"
            found.append(Finding("warning", f"{text} without it."))
    elif each.intervals.longest > timeout:
        text = f"{each.topic}: no message for {seconds(each.intervals.longest)}, longer than the input timeout of"
        found.append(Finding("warning", f"{text} {seconds(timeout)}: the wheel stops until it returns."))
    rate = drive.parameters["rate_hz"]
    if each.topic.endswith(("/load", "/load_force")) and each.rate < 0.45 * rate:
        text = f"{each.topic} comes at {each.rate:.4g} Hz, and is held between samples: what the road does above"
        found.append(Finding("note", f"{text} {0.5 * each.rate:.3g} Hz is not in it, at {rate:g} steps a second."))
    middle, spread = each.intervals.quantile(0.5), each.intervals.quantile(0.99) - each.intervals.quantile(0.01)
    if spread > 0.5 * middle:
        text = f"{each.topic}: the time between messages varies by {seconds(spread)} around {seconds(middle)}."
        found.append(Finding("note", text))
    if each.kind != messages.FLOAT64 and each.delay.count and each.delay.high > timeout:
        text = f"{each.topic}: a message was {seconds(each.delay.high)} old when it came, older than the input timeout."
        found.append(Finding("warning", text))
    return found


def _setting(drive: Drive) -> list[Finding]:
    found = []
    if drive.parameters["tire.sidewall_damping"] == "modal":
        text = (
            "tire.sidewall_damping is modal, the paper's: a rotating tire passes on less than the load, and pushes the "
        )
        text += "axle forward with no traction at all. For a vehicle use reaction."
        found.append(Finding("note", text))
    if drive.on_road:
        text = "The tires stand on a road: loads are the contact's, an outcome. Verdict, critical speed, response, "
        text += "Campbell diagram and map are those in contact, without lift-off, with the belt's harmonics to "
        text += f"{drive.contact_modes}."
        found.append(Finding("note", text))
    if drive.load_source == "estimate":
        words = [_SOURCES[name] for name in reversed(drive.sources)]
        listed = " and ".join(filter(None, (", ".join(words[:-1]), words[-1]))) if words else "no source at all"
        text = f"The loads are estimated, from {listed}, and known up to {drive.band_hz:g} Hz: forces above, and what "
        text += "the spectra and the harmonics have there, are not the drive's."
        deviations = [wheel.deviations.mean for wheel in drive.wheels if wheel.deviations.count]
        if deviations:
            text += f" Their standard deviation is {number(min(deviations))} to {number(max(deviations))} N on average."
        found.append(Finding("note", text))
    if not drive.unit.is_uniform:
        text = "The tire is not uniform: response, Campbell diagram, map and critical speed are its mean's"
        highest = max((wheel.highest_speed for wheel in drive.wheels), default=0.0)
        sidewall = nonuniform.Nonuniformity.of(drive.unit)
        model = drive.parameters["model"]
        tongue = nonuniform.nearest_resonance(drive.unit, sidewall, highest, model)
        if tongue is not None and not drive.on_road:
            threshold = nonuniform.tongue_threshold(drive.unit, sidewall, tongue, model)
            text += "; the tongue of instability nearest to the highest speed driven begins at "
            text += f"{number(tongue.speed / RPM)} rpm"
            if threshold is None:
                text += ", which damping or a wider tongue beside it keeps from opening by itself at any amplitude"
            elif threshold.scale > 0.0:
                text += f", where the sidewall must vary {threshold.scale:.3g} times as much as it does to open it"
        found.append(Finding("note", f"{text}."))
    return found


def number(value: float) -> str:
    """A number with its thousands apart."""
    if not math.isfinite(value):
        return "-"
    return f"{round(value):,}".replace(",", "\u202f")


def seconds(value: float) -> str:
    """A time with its unit, to three digits."""
    if not math.isfinite(value):
        return "-"
    for limit, factor, unit in ((1e-3, 1e6, "\u00b5s"), (1.0, 1e3, "ms"), (120.0, 1.0, "s"), (7200.0, 1 / 60, "min")):
        if abs(value) < limit:
            return f"{value * factor:.3g} {unit}"
    return f"{value / 3600.0:.3g} h"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
