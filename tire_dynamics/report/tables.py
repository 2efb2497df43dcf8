"""The page's tables and short texts, as plain texts: the template makes HTML of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

from ..cdr import messages
from ..science.uniformity import OrderSums
from .findings import Summary, critical_range, number, seconds
from .gather import ROLLING, Drive, ForceHarmonics, WheelHarmonics
from .theory import RPM, Bands, steady

__all__ = [
    "Table",
    "closed_form",
    "harmonics_table",
    "input_table",
    "number_table",
    "parameter_table",
    "segments",
    "subtitle",
    "tiles",
    "topic_table",
    "without_angle",
    "without_harmonics",
]


@dataclass(frozen=True)
class Table:
    """A table of texts; a further line within a cell is small. The first cell of a row is its head."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    wheels: bool = False  # one row for each wheel, in the drive's order


def subtitle(drive: Drive) -> str:
    """When the drive was, how long, and where its outputs come from."""
    begun = datetime.fromtimestamp(drive.begin_ns / 1e9, timezone.utc)
    source = "replayed for this report" if drive.replayed else "a log, as it was recorded"
    return f"{begun:%Y-%m-%d %H:%M:%S} UTC \u00b7 {seconds(drive.duration)} \u00b7 {source}"


def tiles(drive: Drive, found: Summary, critical: float | None, band: Bands | None) -> list[tuple[str, str, str]]:
    """What, value and where, of the few numbers at the top."""
    loads = [(wheel.numbers["load_z"].high, wheel.name) for wheel in drive.wheels if wheel.numbers["load_z"].count]
    forces = [(wheel.numbers["axle_z"].peak, wheel.name) for wheel in drive.wheels if wheel.outputs]
    fastest = max((wheel.highest_speed for wheel in drive.wheels), default=0.0)
    return [
        ("Duration", seconds(drive.duration), f"{len(drive.wheels)} wheel{'s' * (len(drive.wheels) != 1)}"),
        ("Outputs cover", f"{math.floor(1000 * min(found.covered)) / 10:g} %", "of the drive"),
        ("Highest load", f"{number(max(loads)[0])} N" if loads else "-", max(loads)[1] if loads else ""),
        ("Highest axle force z", f"{number(max(forces)[0])} N" if forces else "-", max(forces)[1] if forces else ""),
        ("Top speed", f"{number(fastest / RPM)} rpm", f"{fastest:.1f} rad/s"),
        (
            "Critical speed",
            "none" if critical is None else f"{number(critical / RPM)} rpm",
            f"5 to 95 %: {critical_range(band)}"
            if band is not None
            else "stable at every speed"
            if critical is None
            else f"zeta_1 = {drive.unit.zeta_1:g}",
        ),
    ]


def number_table(drive: Drive, found: Summary) -> Table:
    """Mean, peak and rms of load and axle forces, top speed, outputs and stability, of each wheel.

    Of a load that is estimated its standard deviation too: the mean of what was stated, and the largest.
    """
    estimated = drive.load_source == "estimate"
    forces = (
        "load z mean", "load z peak", "load z rms", *(("load z sd",) if estimated else ()),
        "axle z mean", "axle z peak", "axle z rms", "axle x mean", "axle x peak", "axle x rms",
    )  # fmt: skip
    header = ("wheel", *forces, "top speed", "covered", "stability")
    units = ("", *("N",) * len(forces), "rpm", "%", "")
    rows = []
    for wheel, share, verdict in zip(drive.wheels, found.covered, found.verdicts, strict=True):
        row = [wheel.name]
        for curve in ("load_z", "axle_z", "axle_x"):
            of = wheel.numbers[curve]
            row += [number(value) for value in (of.mean, of.peak, of.deviation)] if of.count else ["-"] * 3
            if curve == "load_z" and estimated:
                sd = wheel.deviations
                row.append(f"{number(sd.mean)}\nto {number(sd.high)}" if sd.count else "-")
        row += [number(wheel.highest_speed / RPM), f"{math.floor(1e4 * share) / 100:g}", verdict or "-"]
        rows.append(row)
    heads = [f"{name} [{unit}]" if unit else name for name, unit in zip(header, units, strict=True)]
    return Table(heads, rows, wheels=True)


def topic_table(drive: Drive) -> Table:
    """What is in the bag."""
    rows = [
        [topic, kind, *(("-", "-") if count is None else (number(count), f"{count / drive.duration:.4g}"))]
        for topic, (kind, count) in sorted(drive.topics.items())
        if count != 0
    ]
    return Table(("topic", "type", "messages", "per second"), rows)


def parameter_table(drive: Drive) -> Table:
    """Of the tire and the model."""
    rows = [[name, _shown(value)] for name, value in drive.parameters.items() if not name.startswith("log.")]
    return Table(("parameter", "value"), rows)


def _shown(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return ", ".join(map(str, value)) or "-"
    return f"{value:g}" if isinstance(value, float) else str(value)


def input_table(drive: Drive) -> Table:
    """Rate, intervals, age and faults of each input."""
    header = ("topic", "messages", "rate [Hz]", "interval", "1 to 99 %", "longest", "age mean", "age max", "remarks")
    rows = []
    for each in drive.inputs:
        intervals = [each.intervals.quantile(share) for share in (0.5, 0.01, 0.99)]
        stamped = each.kind != messages.FLOAT64 and each.delay.count
        remarks = ", ".join(f"{number(count)} {reason}" for reason, count in each.counts.items() if count)
        rows.append(
            [
                each.topic,
                number(each.messages),
                f"{each.rate:.4g}" if math.isfinite(each.rate) else "-",
                seconds(intervals[0]),
                f"{seconds(intervals[1])} to {seconds(intervals[2])}",
                seconds(each.intervals.longest),
                seconds(each.delay.mean) if stamped else "-",
                seconds(each.delay.high) if stamped else "-",
                remarks or "none",
            ]
        )
    return Table(header, rows)


def segments(drive: Drive) -> str:
    """How the spectra were estimated."""
    spectra = [wheel.spectra for wheel in drive.wheels if wheel.spectra.segments]
    if not spectra:
        return "No segment of outputs is long enough for a spectrum."
    most = max(each.segments for each in spectra)
    length = spectra[0].length / spectra[0].rate
    few = "; of so few, trust only what is smooth" if most < 8 else ""
    return f"Welch, Hann, {number(most)} segments of {seconds(length)}, half overlapping{few}."


def closed_form(drive: Drive, band: Bands | None) -> str:
    """K of each wheel at its mean speed."""
    words = []
    for index, wheel in enumerate(drive.wheels):
        if wheel.numbers["speed"].count:
            mean = wheel.mean_speed
            K = steady(drive.unit, mean, drive.parameters["model"])
            within = ""
            if band is not None:
                low, _, high = (f"{value:.4f}" for value in band.steady[:, index - len(drive.wheels)])
                within = f" ({low} to {high})" if low != high else ""
            words.append(f"{wheel.name} {K:.4f}{within} at {number(mean / RPM)} rpm")
    text = ", ".join(words) or "-"
    return f"{text}; in brackets 5 to 95 % within the errors of the parameters" if "(" in text else text


def without_harmonics(drive: Drive, harmonics: Sequence[WheelHarmonics | None]) -> list[str]:
    """A sentence for each wheel whose harmonics are not known."""
    sentences = []
    for wheel, forces in zip(drive.wheels, harmonics, strict=True):
        if forces is None:
            turns = 0.0 if wheel.orders is None else wheel.orders[0].turns
            reason = f"{turns:.2g} turns above {ROLLING / RPM:.0f} rpm with a force, too few or too uneven to tell"
            sentences.append(f"{wheel.name}: {reason} harmonics.")
    return sentences


def without_angle(drive: Drive, harmonics: Sequence[WheelHarmonics | None]) -> str:
    """The wheels with harmonics whose angle comes from their speed alone."""
    relative = [wheel.name for wheel, some in zip(drive.wheels, harmonics, strict=True) if some and not wheel.measured]
    return "all wheels" if len(relative) == len(drive.wheels) else ", ".join(relative)


def harmonics_table(drive: Drive, forces: Sequence[ForceHarmonics | None]) -> Table:
    """Of each harmonic N peak to peak with its error, and below it the phase, where the error leaves it clear."""
    rows = []
    for wheel, force in zip(drive.wheels, forces, strict=True):
        if force is None:
            rows.append([wheel.name, *["-"] * (2 + OrderSums().harmonics)])
            continue
        variation, error = force
        cells = []
        for size, phase, deviation in zip(variation.peak_to_peak, variation.phase, error, strict=True):
            known = "" if math.isnan(deviation) else f" \u00b1 {_newton(deviation)}"
            clear = not size < 2.0 * deviation
            at = f"{math.degrees(phase):.0f}\u00b0" if clear else "-"
            cells.append("-" if math.isnan(size) else f"{_newton(size)}{known}\n{at}")
        rows.append([wheel.name, f"{variation.turns:.1f}", _newton(variation.whole), *cells])
    header = ("wheel", "turns", "all", *map(str, range(1, OrderSums().harmonics + 1)))
    return Table(header, rows, wheels=True)


def _newton(value: float) -> str:
    return f"{value:.1f}" if value < 9.95 else number(value)
