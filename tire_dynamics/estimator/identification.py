"""Parameters of a unit from a force that was measured at its axle: the frequency response first, then the time series.

The measured force is taken to be that of the unit a constant time ago, with a constant gain and offset and a noise of
any spectrum that does not change. Speed and traction are taken to be exact, the load but for white noise. Parameters
are positive and fitted by their logarithms, so that an error is a ratio; each has a Gaussian prior there, around the
starting unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from ..science import wheel
from ..science.uncertainty import value_of
from ..science.unit import ROAD, ROTATING, TireWheelUnit
from .identification_problem import (
    AXES,
    DEFAULT_FIT,
    FITTED,
    FORE_AFT,
    TOP_ZETA,
    Identification,
    Joined,
    Problem,
    Recording,
    Seen,
)
from .identification_series import from_time_series
from .identification_spectra import from_spectra

__all__ = ["AXES", "DEFAULT_FIT", "FITTED", "UNSEEN", "Identification", "Recording", "Seen", "identify"]

FloatArray = NDArray[np.float64]

_NOT_N_1: Final = "it has no part in n = 1, and a given load reaches the axle through nothing else"
_ONLY_K_1: Final = "it reaches the axle only within k_1 = pi a b (k_z + k_theta); fit k_1"
_ONLY_MASS: Final = "it reaches the axle only within the ring's mass and k_1; fit density and k_1"
UNSEEN: Final[Mapping[str, str]] = {
    "bending_stiffness": _NOT_N_1,
    "membrane_stiffness": _NOT_N_1,
    "inflation_pressure": _NOT_N_1,
    "zeta_n": _NOT_N_1,
    "radial_stiffness": _ONLY_K_1,
    "tangential_stiffness": _ONLY_K_1,
    "radius": _ONLY_MASS,
    "width": _ONLY_MASS,
    "thickness": _ONLY_MASS,
    "contact_half_angle": "the whole load reaches n = 1, however long the patch is",
    **dict.fromkeys(ROAD, "it matters on the road alone, and what is fitted is the response to a load"),
    **dict.fromkeys(ROTATING, "it turns with the tire, and what is fitted is the response of the mean tire"),
    "sidewall_damping": "it is a choice, not a number; compare the noise that two fits leave",
}
"""Why the other fields cannot be fitted."""
_WIDTH = 0.5  # of a prior


def identify(
    recording: Recording,
    start: TireWheelUnit,
    fit: Sequence[str] = DEFAULT_FIT,
    *,
    axes: Literal["z", "xz"] = "z",
    joined: Joined = "smooth",
    prior_width: float | Mapping[str, float] = 0.5,
    model: wheel.Model = "inextensional",
    gain_width: float = 0.01,
    load_noise: float | None = None,
) -> Identification:
    """Fit parameters of a unit to a force that was measured at its axle.

    Parameters
    ----------
    recording : Recording
    start : TireWheelUnit
        Where the fit begins, the middle of the priors, and the fields that are not fitted.
    fit : sequence of str
        Of ``FITTED``.
    axes : {"z", "xz"}
        What was measured: the force on the suspension, or force.x as well.
    joined : {"smooth", "lines", "zero-order-hold"}
        What the load was between its samples: a spline of degree 7, for a quantity that was sampled faster than it
        changes: it keeps the gain to 2e-5 at a fifth of the sampling rate, to 1e-3 at three tenths;
        straight lines, as :func:`.simulate` has them; or a zero-order hold, as the live estimator takes it.
    prior_width : float or mapping of str to float
        Standard deviation of the prior of each parameter's logarithm, of all or by their names; 0.5 of those that a
        mapping leaves out.
    model : {"inextensional", "complete"}
    gain_width : float
        Standard deviation of the prior of the gain of the force's channel over the load's, 0 to 1; 0 holds it at 1.
    load_noise : float, optional
        White noise of the load's channel [N rms], >= 0. If it is given, what it does to the estimates is taken out;
        else what there may be at the most, by what the model leaves and by the load near half its sampling rate; what
        that would do is added to the errors.

    Returns
    -------
    Identification

    Raises
    ------
    ValueError
        A name cannot be fitted, an option is out of bounds, the starting unit forgets nothing, or the recording has too
        little in common; the message says which.

    Notes
    -----
    1. Where the speed varies by less than 15 rad/s over 2 s, H1 from load to F' by Welch's method, for each speed; the
       traction's part is subtracted as the starting unit has it. Least squares on H(f) exp(-2 pi i f delay) -
       H1(f), over the standard deviation |H1| sqrt((1 - coherence)/(2 coherence segments)) of H1, give a first
       estimate, for several delays.
    2. Least squares on the force through :func:`.simulate`, at the times of measurement less the delay. The noise is
       whitened: an autoregression, of an order by Akaike's criterion, is fitted to what the model leaves, section by
       section, and its prediction errors are what is squared (generalised least squares). Fit and noise take turns
       until the estimates rest. After a gap the model begins in the steady state; what is measured before it has
       forgotten that is left out.

    The errors are those of (J^T J + 1/prior_width^2)^-1, J the whitened derivatives over the noise's standard
    deviation, a gain between the two channels being unknown as well. They are right if the model is: what a wrong model
    or a wrong fixed field does is not in them.

    Noise n of the load (errors in variables) moves the estimates by -(J^T J + ...)^-1 J_n^T r_n, to first order, r_n
    and J_n the model's whitened answer to it and its derivatives. White noise of that size is drawn once, from a seed.
    At no frequency is there more of it than what the model leaves there, over |H|^2.
    """
    _check(start, fit, axes, prior_width)
    if not 0.0 <= gain_width <= 1.0:
        raise ValueError(f"gain_width is {gain_width!r}; it must be from 0 to 1")
    if load_noise is not None and not 0.0 <= load_noise < math.inf:
        raise ValueError(f"load_noise is {load_noise!r}; it must be >= 0 and finite")
    problem = Problem(
        recording, start, tuple(fit), AXES[axes], joined, _widths(fit, prior_width), model, gain_width, load_noise
    )
    seen, first, delay = from_spectra(problem)
    return from_time_series(problem, seen, first, delay)


def _widths(fit: Sequence[str], prior_width: float | Mapping[str, float]) -> FloatArray:
    if isinstance(prior_width, Mapping):
        return np.array([prior_width.get(name, _WIDTH) for name in fit], np.float64)
    return np.full(len(fit), prior_width, np.float64)


def _check(start: TireWheelUnit, fit: Sequence[str], axes: str, prior_width: float | Mapping[str, float]) -> None:
    if not fit:
        raise ValueError("fit is empty; it must name at least one parameter")
    for name in fit:
        if name in UNSEEN:
            raise ValueError(f"{name} cannot be fitted: {UNSEEN[name]}")
        if name not in FITTED:
            raise ValueError(f"{name[:100]!r} is no parameter that can be fitted; those are {', '.join(FITTED)}")
        if name in FORE_AFT and start.is_longitudinally_rigid:
            raise ValueError(
                f"{name} cannot be fitted: the starting unit's longitudinal_stiffness is 0, which holds it"
            )
        if name in FORE_AFT and axes == "z":
            raise ValueError(f"{name} cannot be fitted without force.x")
        if not value_of(start, name) > 0.0:
            raise ValueError(f"{name} is 0 in the starting unit; to be fitted it must be > 0")
        if name.startswith(("zeta", "longitudinal_damping")) and not value_of(start, name) < TOP_ZETA:
            raise ValueError(f"{name} is {value_of(start, name)} in the starting unit; to be fitted it must be < 0.99")
    if len(set(fit)) < len(fit):
        raise ValueError(f"fit is {', '.join(fit)}; no parameter may stand twice")
    if axes not in AXES:
        raise ValueError(f"axes is {axes!r}; it must be one of {', '.join(AXES)}")
    for width in _widths(fit, prior_width).tolist():
        if not 1e-3 <= width <= 10.0:
            raise ValueError(f"prior_width is {width!r}; it must be from 0.001 to 10")
