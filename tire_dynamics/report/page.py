"""The page: what a drive's charts and tables say, put into the one template, which escapes every text."""

from __future__ import annotations

import math

import numpy as np

from .. import __version__
from .charts import (
    IMAGES,
    belts,
    coverage_figure,
    force_figure,
    moment_figure,
    spectra_figure,
    steady_figure,
    variation_figure,
)
from .findings import number, summary
from .gather import Drive
from .model_charts import campbell_figure, stability_figure
from .rendering import rendered
from .tables import (
    closed_form,
    harmonics_table,
    input_table,
    number_table,
    parameter_table,
    segments,
    subtitle,
    tiles,
    topic_table,
    without_angle,
    without_harmonics,
)
from .theory import DIAGRAM_MODES, RPM, Bands, Errors, bands, stability_around
from .traces import COLOURS

__all__ = ["page"]


def page(drive: Drive, known: Errors | None = None) -> tuple[str, str]:
    """The page of a drive as HTML, with bands if there are errors of the parameters, and its headline."""
    from plotly.offline import get_plotlyjs

    highest = max((wheel.highest_speed for wheel in drive.wheels), default=0.0)
    modes = drive.contact_modes
    stability, critical = stability_around(drive.unit, highest, drive.parameters["model"], modes)
    band = None if known is None else _bands(drive, known, highest)
    found = summary(drive, critical, known, band)
    belt, exaggeration = belts(drive)
    figures = {
        "forces": force_figure(drive),
        "spectra": spectra_figure(drive, band),
        "moment": moment_figure(drive),
        "campbell": campbell_figure(drive, highest),
        "stability": stability_figure(drive, stability, critical, band),
        "coverage": coverage_figure(drive),
    }
    if band is not None and np.ptp(band.steady, axis=0).max() > 1e-6:  # reaction damping has K = 1, whatever the rest
        figures["steady"] = steady_figure(drive, band)
    harmonics = [wheel.harmonics for wheel in drive.wheels]
    if any(harmonics):
        figures["variation"] = variation_figure(drive, harmonics)
    names = [wheel.name for wheel in drive.wheels]
    text = rendered(
        "template.html",
        title=drive.name,
        subtitle=subtitle(drive),
        found=found,
        tiles=tiles(drive, found, critical, band),
        wheels=names,
        colours=COLOURS,
        numbers=number_table(drive, found),
        topics=topic_table(drive),
        parameters=parameter_table(drive),
        inputs=input_table(drive),
        segments=segments(drive),
        closed_form=closed_form(drive, band),
        harmonics_z=harmonics_table(drive, [forces and forces.z for forces in harmonics]),
        harmonics_x=harmonics_table(drive, [forces and forces.x for forces in harmonics]),
        without_harmonics=without_harmonics(drive, harmonics),
        without_angle=without_angle(drive, harmonics),
        exaggeration=number(exaggeration),
        load_source=drive.load_source,
        band_hz=f"{drive.band_hz:g}",
        modes=modes,
        diagram_modes=None if modes is None else min(modes, DIAGRAM_MODES),
        damping=drive.parameters["tire.sidewall_damping"],
        zeta=f"{drive.unit.zeta_1:g}",
        version=__version__,
        figures=figures,
        data={"figures": figures, "belts": belt, "exaggeration": exaggeration, "wheels": names},
        plotly=get_plotlyjs(),
    )
    return text, found.headline


def _bands(drive: Drive, known: Errors, highest: float) -> Bands:
    """Bands on K from standstill on and at the wheels' mean speeds, which come last, and on the response there."""
    means = np.array([wheel.mean_speed for wheel in drive.wheels])
    speeds = np.concatenate([np.linspace(0.0, max(highest, 100.0 * RPM), 80), means])
    spectra = drive.wheels[0].spectra
    line = spectra.rate / spectra.length
    frequency = np.geomspace(line, line * math.floor(IMAGES * spectra.length), 200)
    return bands(drive.unit, known, highest, speeds, means, frequency, drive.parameters["model"])
