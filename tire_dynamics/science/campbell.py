"""The Campbell diagram: exponents of the wheel's modes and the belt's waves over speed, seen from the fixed frame.

On the road the contact couples them all, and no mode is of one harmonic alone. There a mode is named after the harmonic
that has the largest share in it: left_i right_i summed over the harmonic's states, for the eigenvectors left and right
of A_contact with left right = 1, so that the shares of all harmonics in a mode sum to 1, and those of all modes in a
harmonic to the number of its states (participation factors: Perez-Arriaga, Verghese and Schweppe, *IEEE Transactions
on Power Apparatus and Systems* 101(9), 1982). Each harmonic lends its name to as many modes as it has
alone, such that all shares together are largest. Of n > 1 the backward and the forward wave lend theirs, and at rest,
where waves stand and are as much of the one as of the other, the lower is the backward one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import contact as road
from .coefficients import static_compliance
from .modes import RingModes
from .unit import TireWheelUnit
from .wheel_matrices import Model, fixed_frame, fixed_frame_matrix

__all__ = [
    "MOSTLY",
    "WAVES",
    "WHEEL_MODES",
    "ContactModes",
    "campbell_exponents",
    "contact_modes",
    "jumps",
    "wave_exponents",
    "wheel_exponents",
    "wheel_mode_names",
]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

WAVES: Final = ("backward", "forward")
"""Seen from the ring: against its spin and along it."""

BOTH: Final[tuple[Model, ...]] = ("inextensional", "complete")

WHEEL_MODES: Final = ("wheel_hop", "ring_fore_aft", "ring_vertical")
"""Of n = 1 with a wheel that is held fore and aft, by frequency, named as they are at rest."""

MOSTLY: Final = 1.0 / 3.0
"""The least share of a harmonic in a mode on the road that has its name in a diagram."""


class ContactModes(NamedTuple):
    """Modes of the tire on the road over S speeds, at each from the slowest on, shapes (S, K).

    Attributes
    ----------
    exponents : ndarray of complex
        [1/s], with a positive frequency; NaN of an overdamped motion.
    harmonic : ndarray of int
        The belt's harmonic after which it is named; 1 is the ring with the wheel.
    wave : ndarray of int
        -1 of a backward, 1 of a forward one; 0 of n = 0 and 1.
    share : ndarray of float
        Of that harmonic in it; a little above 1 is possible.
    """

    exponents: ComplexArray
    harmonic: NDArray[np.int64]
    wave: NDArray[np.int64]
    share: FloatArray


def campbell_exponents(
    unit: TireWheelUnit,
    speeds: ArrayLike,
    numbers: Sequence[int],
    model: Model = "inextensional",
    *,
    contact: bool | ContactModes = False,
    n_max: int = 30,
) -> tuple[dict[str, ComplexArray], dict[tuple[int, str], ComplexArray]]:
    """Exponents over speed.

    Parameters
    ----------
    unit : TireWheelUnit
        Of one that is not uniform, its mean's.
    speeds : array_like, shape (S,)
        Spin Omega [rad/s].
    numbers : sequence of int
        Wavenumbers n >= 2, on the road up to ``n_max``.
    model : {"inextensional", "complete"}
    contact : bool or ContactModes
        On the road, without lift-off; or the modes there at these speeds, if they are known.
    n_max : int
        Highest belt harmonic on the road.

    Returns
    -------
    wheel_modes : dict of ndarray of complex, shape (S,)
        Exponents [1/s] by the names of :func:`wheel_mode_names`; fewer where a motion is overdamped at a speed. On the
        road the sprung mass moves too, "body", and a mode is NaN where it is overdamped, or where the harmonic after
        which it is named has a share of less than ``MOSTLY``: no motion is this one then.
    waves : dict of ndarray of complex, shape (S,)
        Likewise by wavenumber and the names of ``WAVES``; of the complete model the slower two.

    Raises
    ------
    ValueError
        An argument is out of its bounds, or the unit's ``vertical_stiffness`` is not below the tire's own.
    """
    each = np.asarray(speeds, dtype=np.float64).tolist()
    if contact is not False:
        for n in numbers:
            if not 2 <= n <= n_max:
                raise ValueError(f"numbers has {n}; it must be from 2 to n_max, which is {n_max}")
        modes = contact_modes(unit, each, model, n_max) if contact is True else contact
        names = wheel_mode_names(unit, model, contact=True)
        of_wheel = dict(zip(names, _named(modes, 1, 0, len(names)).T, strict=True))
        signs = dict(zip(WAVES, (-1, 1), strict=True))
        return of_wheel, {(n, wave): _named(modes, n, signs[wave], 1)[:, 0] for n in numbers for wave in WAVES}
    rigid = [wheel_exponents(unit, speed, model) for speed in each]
    count = min((len(some) for some in rigid), default=0)
    names = wheel_mode_names(unit, model)[:count]
    wheel_modes = {name: np.array([some[k] for some in rigid]) for k, name in enumerate(names)}
    ring = RingModes(unit, numbers, model)
    both = np.array([wave_exponents(ring, speed) for speed in each])
    waves = {(n, wave): both[:, k, j] for k, n in enumerate(numbers) for j, wave in enumerate(WAVES)}
    return wheel_modes, waves


def wave_exponents(modes: RingModes, speed: float) -> ComplexArray:
    """Exponents [1/s], fixed frame, of each mode's slower two waves, shape (N, 2): backward, forward on the ring."""
    exponents = modes.at(speed).exponents
    order = np.argsort(exponents.imag, axis=1)
    middle = order.shape[1] // 2
    return np.take_along_axis(exponents, order[:, middle - 1 : middle + 1], axis=1)


def wheel_exponents(unit: TireWheelUnit, speed: float, model: Model = "inextensional") -> ComplexArray:
    """Exponents [1/s] of n = 1 with the wheel, fixed frame, positive frequency: the slowest ones, ascending.

    Three, or four of a wheel that gives fore and aft: those of :func:`wheel_mode_names`.
    """
    exponents = np.linalg.eigvals(fixed_frame_matrix(unit, speed, model))
    exponents = exponents[exponents.imag > 0.0]
    count = len(WHEEL_MODES) + (not unit.is_longitudinally_rigid)
    return np.asarray(exponents[np.argsort(exponents.imag)][:count], dtype=np.complex128)


def wheel_mode_names(
    unit: TireWheelUnit, model: Model = "inextensional", *, contact: bool = False
) -> tuple[str, ...]:
    """Names of the modes of n = 1 with the wheel, in the order of their frequencies at rest.

    Parameters
    ----------
    unit : TireWheelUnit
    model : {"inextensional", "complete"}
    contact : bool
        On the road. All of the tire's stiffness but that of n = 1 is one spring for this.

    Returns
    -------
    tuple of str
        Those of ``WHEEL_MODES``, "wheel_fore_aft" of a wheel that gives, and on the road "body" of a sprung mass. At
        rest and without damping the mirror about the vertical turns the motions fore and aft into their opposites, and
        leaves the others as they are.
    """
    if not contact and unit.is_longitudinally_rigid:
        return WHEEL_MODES
    still = ("zeta_1", "zeta_n", "zeta_s", "longitudinal_damping_ratio", "residual_damping")
    tire = unit.mean.replace(**dict.fromkeys(still, 0.0))
    if contact and not tire.vertical_stiffness:  # of a rigid tread; a little less, that there be a spring
        tire = tire.replace(vertical_stiffness=0.99 / max(static_compliance(tire, 100, each) for each in BOTH))
    if not contact:
        tire = tire.replace(sprung_mass=0.0)
    one = len(fixed_frame(tire, model).constant) + 2 * bool(tire.sprung_mass)
    system = road.open_system(tire, 0.0, model, 1)
    upright = _coupled(system.matrix[:one, :one], system.contact[:one] != 0.0)
    matrix = (system.closed() if contact else system.matrix)[:one, :one]
    vertical = [*(["body"] if tire.sprung_mass else []), "wheel_hop", "ring_vertical"]
    along = [*([] if tire.is_longitudinally_rigid else ["wheel_fore_aft"]), "ring_fore_aft"]
    found = [
        (float(frequency), name)
        for some, names in ((upright, vertical), (~upright, along))
        for frequency, name in zip(_frequencies(matrix[np.ix_(some, some)]), names, strict=False)
    ]
    return tuple(name for _, name in sorted(found))


def _coupled(matrix: FloatArray, some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The states that are coupled with some, by whatever way."""
    each = (matrix != 0.0) | (matrix != 0.0).T
    while (more := some | each[some].any(axis=0)).sum() > some.sum():
        some = more
    return some


def _frequencies(matrix: FloatArray) -> FloatArray:
    """Of a system without damping [rad/s], ascending."""
    return np.asarray(np.sort(np.abs(np.linalg.eigvals(matrix)))[::2])


# -- on the road --------------------------------------------------------------------------------------------------


def contact_modes(
    unit: TireWheelUnit, speeds: ArrayLike, model: Model = "inextensional", n_max: int = 30
) -> ContactModes:
    """All modes over speed of the tire that stands on the road, without lift-off.

    Parameters
    ----------
    unit : TireWheelUnit
        Of one that is not uniform, its mean's.
    speeds : array_like, shape (S,)
        Spin Omega [rad/s], either sign.
    model : {"inextensional", "complete"}
    n_max : int
        Highest belt harmonic.

    Returns
    -------
    ContactModes

    Raises
    ------
    ValueError
        An argument is out of its bounds, or the unit's ``vertical_stiffness`` is not below the tire's own.
    """
    unit = unit.mean
    k = 4 if model == "complete" else 2
    one = len(fixed_frame(unit, model).constant) + 2 * bool(unit.sprung_mass)
    parts = [(1, one), *((n, k if n == 0 else 2 * k) for n in road.belt_numbers(model, n_max).astype(int).tolist())]
    kinds = _Kinds.of(parts)
    each = [_modes(road.open_system(unit, speed, model, n_max), kinds) for speed in np.asarray(speeds).tolist()]
    exponents, names, share = (np.stack(some) for some in zip(*each, strict=True))
    return ContactModes(exponents, names[:, 0], names[:, 1], share)


class _Kinds(NamedTuple):
    """Of which harmonic and of which wave each of n states is, as V and Z of n > 1 and their conjugates."""

    harmonic: NDArray[np.int64]
    wave: NDArray[np.int64]
    turn: ComplexArray  # (n, n), of states as ``contact`` has them: real parts, imaginary ones

    @classmethod
    def of(cls, parts: Sequence[tuple[int, int]]) -> _Kinds:
        harmonic = np.repeat([n for n, _ in parts], [size for _, size in parts])
        wave = np.zeros_like(harmonic)
        turn = np.eye(harmonic.size, dtype=np.complex128)
        first = 0
        for n, size in parts:
            if n > 1:
                real, imaginary = (first + j * size // 2 + np.arange(size // 2) for j in (0, 1))
                wave[real], wave[imaginary] = 1, -1
                turn[real, imaginary], turn[imaginary, real], turn[imaginary, imaginary] = 1j, 1.0, -1j
            first += size
        return cls(harmonic, wave, turn)


def _modes(system: road.ContactSystem, kinds: _Kinds) -> tuple[ComplexArray, NDArray[np.int64], FloatArray]:
    """Exponents, harmonics with waves (2, K), and shares at one speed."""
    from scipy.optimize import linear_sum_assignment

    exponents, right = np.linalg.eig(system.closed())
    left = np.linalg.inv(right)
    if len(exponents) < len(kinds.harmonic):  # a rigid tread
        right, left = system.basis @ right, left @ system.basis.T
    each = ((left @ np.linalg.inv(kinds.turn)) * (kinds.turn @ right).T).real  # of each state in each mode
    names, of_state = np.unique(np.stack([kinds.harmonic, kinds.wave]), axis=1, return_inverse=True)
    of_state = of_state.reshape(-1)
    shares = each @ np.eye(names.shape[1])[of_state]
    slots = np.repeat(np.arange(names.shape[1]), np.bincount(of_state) // 2)[: len(exponents) // 2]
    moving, still = np.flatnonzero(exponents.imag > 0.0), np.flatnonzero(exponents.imag == 0.0)
    still = still[np.argsort(exponents[still].real)]  # two and two for a motion
    one, other = np.concatenate([moving, still[::2]]), np.concatenate([moving, still[1::2]])
    order = np.argsort(np.sqrt(np.abs(exponents[one] * exponents[other])))
    one, other = one[order], other[order]
    rows, columns = linear_sum_assignment(-(shares[one] + shares[other])[:, slots])
    found = names[:, slots[columns[np.argsort(rows)]]]
    for n in np.unique(found[0][found[0] > 1]).tolist():  # standing waves are as much of one as of the other
        pair = [int(np.flatnonzero((found[0] == n) & (found[1] == wave))[:1].sum()) for wave in (-1, 1)]
        if pair[0] > pair[1] and (found[:, pair] == [[n, n], [-1, 1]]).all():
            found[1, pair] = 1, -1
    whole = each @ (kinds.harmonic[:, None] == found[0])
    share = 0.5 * (whole[one, np.arange(one.size)] + whole[other, np.arange(one.size)])
    return np.where(exponents[one].imag > 0.0, exponents[one], complex(math.nan, math.nan)), found, share


def _named(modes: ContactModes, harmonic: int, wave: int, count: int) -> ComplexArray:
    """The slowest modes of a harmonic, shape (S, count)."""
    found = np.full((len(modes.exponents), count), complex(math.nan, math.nan))
    for row, (exponents, of, waves, share) in enumerate(zip(*modes, strict=True)):
        some = np.flatnonzero((of == harmonic) & (waves == wave))[:count]
        found[row, : some.size] = np.where(share[some] >= MOSTLY, exponents[some], complex(math.nan, math.nan))
    return found


def jumps(speeds: ArrayLike, frequency: ArrayLike, harmonic: int) -> NDArray[np.bool_]:
    """Where a name goes over to another mode between two speeds: its line in a diagram is to be broken there.

    Parameters
    ----------
    speeds : array_like, shape (S,)
        Spin Omega [rad/s], ascending.
    frequency : array_like, shape (S,)
        Of one name on the road [Hz].
    harmonic : int
        Of the name.

    Returns
    -------
    ndarray of bool, shape (S - 1,)
        Where the frequency changes by more than that of any wave would, n Omega, and 1 Hz.
    """
    most = harmonic * np.diff(np.asarray(speeds, dtype=np.float64)) / (2.0 * math.pi) + 1.0
    return np.asarray(np.abs(np.diff(np.asarray(frequency, dtype=np.float64))) > most)
