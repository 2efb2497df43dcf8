"""A tire that was measured: force variation over speed on a uniformity machine, and the model beside it."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..science import contact
from ..science.unit import TireWheelUnit

__all__ = ["HELD_OUT", "MEASURED", "Fit", "draw", "fit", "table"]

FloatArray = NDArray[np.float64]
Table = dict[str, FloatArray]

# M. Du, P. Sun, S. Zhou, H. Huang, J. Zhu, Vehicles 2(3) 31 (2020), doi 10.3390/vehicles2030031: speed [km/h], first
# harmonic of the radial and of the tangential force [N]; taken as peak to peak.
MEASURED: Final = (
    (120, 152.9, 148.4),
    (140, 194.4, 232.2),
    (160, 247.1, 356.4),
    (180, 310.9, 503.2),
    (200, 388.5, 652.1),
    (220, 470.7, 757.0),
    (240, 553.4, 845.5),
)
HELD_OUT: Final = (160, 220)  # [km/h], not fitted
LOAD: Final = 4000.0  # [N]; run-out and imbalance do not ask for it
_RUNOUT, _IMBALANCE = 1e-4, 1e-2  # of the answers that are added up [m], [kg]


class Fit(NamedTuple):
    """Three numbers that were fitted, and what the model gives with them at every speed, peak to peak [N].

    Attributes
    ----------
    runout, imbalance, angle : float
        [m], [kg]; of the imbalance from the run-out's peak, in the sense of rotation [rad], either sign: the forces'
        sizes do not tell them apart.
    radial, tangential : ndarray, shape (7,)
    """

    runout: float
    imbalance: float
    angle: float
    radial: FloatArray
    tangential: FloatArray


def measured_unit() -> TireWheelUnit:
    """Table 1 on the road: of the tire that was measured nothing is known that the model could use."""
    return TireWheelUnit.table_1(contact_half_angle=0.15, vertical_stiffness=2e5, sidewall_damping="reaction")


def fit(held_out: tuple[int, ...] = HELD_OUT) -> Fit:
    """Fit run-out, imbalance and its angle to the radial force at the speeds that are not held out, in relative terms.

    Parameters
    ----------
    held_out : tuple of int
        Speeds [km/h].

    Returns
    -------
    Fit
    """
    unit = measured_unit()
    causes = unit.replace(radial_runout=[(1, _RUNOUT, 0.0)]), unit.replace(imbalance_mass=_IMBALANCE)
    speed, measured = (np.array([row[k] for row in MEASURED]) for k in (0, 1))
    answers = [
        [contact.force_variation(each, v / 3.6 / unit.radius, LOAD, "complete", mount="machine") for each in causes]
        for v in speed
    ]
    up, along = (
        np.array([[getattr(each, name)[0] for each in row] for row in answers]) for name in ("axle", "forward")
    )
    used = ~np.isin(speed, held_out)

    def size(response: NDArray[np.complex128], x: FloatArray) -> FloatArray:
        return np.asarray(2.0 * np.abs(response[:, 0] * x[0] + response[:, 1] * x[1] * np.exp(1j * x[2])))

    def off(x: FloatArray) -> FloatArray:
        return np.asarray(size(up, x)[used] / measured[used] - 1.0)

    starts = ([1.0, 1.0, angle] for angle in (0.0, 1.5, 3.0))
    best = min((least_squares(off, start) for start in starts), key=lambda found: float(found.cost)).x
    turned = best[2] + np.pi * ((best[0] < 0.0) != (best[1] < 0.0))
    angle = abs(float(np.angle(np.exp(1j * turned))))
    runout, imbalance = (abs(float(x)) * of for x, of in zip(best, (_RUNOUT, _IMBALANCE), strict=False))
    return Fit(runout, imbalance, angle, size(up, best), size(along, best))


def table() -> Table:
    """Measured and modelled first harmonics over speed."""
    found = fit()
    speed, radial, tangential = np.array(MEASURED, dtype=np.float64).T
    return {
        "speed_km_h": speed,
        "radial_measured_N": radial,
        "radial_model_N": found.radial,
        "tangential_measured_N": tangential,
        "tangential_model_N": found.tangential,
    }


def draw(table: Table) -> Figure:
    """Measured first harmonics, fitted ones, and those that nothing was fitted to."""
    figure = Figure(figsize=(6.6, 3.3))
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    speed = table["speed_km_h"]
    out = np.isin(speed, HELD_OUT)
    titles = ("Radial: three numbers fitted", "Tangential: nothing fitted")
    for ax, name, title in zip(axes, ("radial", "tangential"), titles, strict=True):
        measured = table[f"{name}_measured_N"]
        ax.plot(speed, table[f"{name}_model_N"], color="0", label="model")
        fitted = ~out if name == "radial" else np.zeros_like(out)
        rest = "measured, held out" if name == "radial" else "measured, not fitted"
        if fitted.any():
            ax.plot(speed[fitted], measured[fitted], "o", color="#0b4f9e", markersize=5.0, label="measured, fitted")
        ax.plot(
            speed[~fitted], measured[~fitted], "o", color="#0b4f9e", markerfacecolor="white", markersize=5.0, label=rest
        )
        ax.set(xlabel="Speed [km/h]", xlim=(110, 250), ylim=(0, 900))
        ax.set_title(title)
        ax.legend(loc="upper left")
    axes[0].set_ylabel("First harmonic of the force\non the axle, peak to peak [N]")
    return figure
