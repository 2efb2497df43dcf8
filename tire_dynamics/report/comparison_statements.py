"""What a comparison of two forces comes to: in words, and as JSON has it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..science.comparison import Lines
from .comparison import COHERENT, Axis, Comparison

__all__ = ["content", "statements"]


def statements(found: Comparison) -> list[tuple[str, str]]:
    """What it comes to, in words: (level, sentence), of good, note, warning.

    Parameters
    ----------
    found : Comparison

    Returns
    -------
    list of (str, str)
    """
    said = []
    for axis in found.axes:
        name, whole = f"force.{axis.name}", axis.whole
        low, high = found.band
        if axis.explained < 0.02 or not np.any(axis.lines.coherence_interval[0] > 0.0):
            said.append(("warning", f"{name}: measurement and model have nothing in common that chance would not give"))
            continue
        said.append(
            (
                "note",
                f"{name}: the measurement is {whole.gain:.5g} +- {whole.gain_error:.2g} times the model, and "
                f"{1e3 * whole.delay:.5g} +- {1e3 * whole.delay_error:.2g} ms later; what follows the model, by "
                f"whatever filter, is {axis.explained:.1%} of the measured power from {low:.3g} to {high:.4g} Hz",
            )
        )
        if whole.gain < 0.0:
            said.append(("warning", f"{name}: measurement and model have opposite signs; --scale -1 turns it"))
        if not whole.gain_interval[0] <= 1.0 <= whole.gain_interval[1]:
            said.append(("note", f"{name}: the gain differs from 1 by more than its 95 % interval"))
        inside = axis.lines.frequency[axis.lines.coherence > COHERENT]
        if inside.size:
            said.append(("note", f"{name}: coherent (> 0.5) from {inside[0]:.3g} to {inside[-1]:.4g} Hz"))
        else:
            said.append(("warning", f"{name}: nowhere is the coherence above 0.5"))
        if whole.misfit > 2.0:
            said.append(
                (
                    "note",
                    f"{name}: one gain and one delay do not describe it (what they leave of the response is "
                    f"{math.sqrt(whole.misfit):.2g} times its errors): look at the gain by frequency",
                )
            )
        else:
            said.append(("good", f"{name}: one gain and one delay describe the response, within its errors"))
        mean, error = axis.offset
        if abs(mean) > 2.0 * error:
            said.append(("note", f"{name}: the means differ by {mean:.4g} +- {error:.2g} N"))
    if found.segments < 16:
        said.append(("warning", f"{found.segments} segments are few: intervals are wide, and the lowest lines crude"))
    return said


def content(found: Comparison) -> dict[str, Any]:
    """All of it as JSON has it, SI units, angles in rad.

    Parameters
    ----------
    found : Comparison

    Returns
    -------
    dict
    """
    return {
        "measured": found.measured,
        "model": found.model,
        "seconds": found.seconds,
        "sections": found.sections,
        "rate_Hz": found.rate,
        "segments": found.segments,
        "segment_s": found.segment,
        "band_Hz": list(found.band),
        "speed_rad_s": found.speed,
        "turns": found.turns,
        "confidence": 0.95,
        "axes": {axis.name: _axis_content(axis) for axis in found.axes},
        "statements": [text for _, text in statements(found)],
        "notes": found.notes,
    }


def _axis_content(axis: Axis) -> dict[str, Any]:
    whole = axis.whole
    return {
        "gain": whole.gain,
        "gain_error": whole.gain_error,
        "gain_interval": list(whole.gain_interval),
        "delay_s": whole.delay,
        "delay_error_s": whole.delay_error,
        "delay_interval_s": list(whole.delay_interval),
        "misfit": whole.misfit,
        "explained": axis.explained,
        "offset_N": axis.offset[0],
        "offset_error_N": axis.offset[1],
        "by_frequency": {"frequency_Hz": axis.lines.frequency.tolist(), **_lines_content(axis.lines)},
        "by_order": None
        if axis.orders is None
        else {"order": axis.orders.frequency.tolist(), **_lines_content(axis.orders)},
        "orders": [
            {"order": each.order, "model_rms_N": each.model, "measured_rms_N": each.measured}
            | _line_content(axis.orders, each.line)
            for each in axis.by_order
            if axis.orders is not None
        ],
        "bands": [
            {
                "from_Hz": each.low,
                "to_Hz": each.high,
                "coherence": each.coherence,
                "model_rms_N": list(each.x),
                "measured_rms_N": list(each.y),
                "error_rms_N": list(each.error),
                "aligned_error_rms_N": list(each.aligned),
                "unexplained_rms_N": list(each.unexplained),
                "gain": list(each.gain),
                "phase_rad": list(each.phase),
            }
            for each in axis.bands
        ],
    }


def _lines_content(lines: Lines) -> dict[str, Any]:
    return {
        "model_density": lines.x_density.tolist(),
        "measured_density": lines.y_density.tolist(),
        "coherence": lines.coherence.tolist(),
        "coherence_interval": lines.coherence_interval.tolist(),
        "gain": lines.gain.tolist(),
        "gain_error": lines.gain_error.tolist(),
        "gain_interval": lines.gain_interval.tolist(),
        "phase_rad": lines.phase.tolist(),
        "phase_error_rad": lines.phase_error.tolist(),
        "phase_interval_rad": lines.phase_interval.tolist(),
    }


def _line_content(lines: Lines, line: int) -> dict[str, Any]:
    return {
        "coherence": float(lines.coherence[line]),
        "coherence_interval": lines.coherence_interval[:, line].tolist(),
        "gain": float(lines.gain[line]),
        "gain_error": float(lines.gain_error[line]),
        "phase_rad": float(lines.phase[line]),
        "phase_error_rad": float(lines.phase_error[line]),
    }
