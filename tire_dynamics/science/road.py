"""Roads: random ones of the classes of ISO 8608, cleats and steps, and what each wheel of a car finds under it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["CLASSES", "Profile", "bump", "coherence", "random_tracks", "spectrum", "travelled"]

FloatArray = NDArray[np.float64]

CLASSES: Final = {name: 16e-6 * 4.0**k for k, name in enumerate("ABCDEFGH")}
"""Displacement PSD at 0.1 cycles/m [m^3], geometric means of the classes of ISO 8608:2016: 16e-6, then fourfold."""

_REFERENCE: Final = 0.1  # n_0 [cycles/m]
_WAVINESS: Final = 2.0  # of the standard's classes
_LONGEST: Final = 100.0  # [m]: of the waves; ISO 8608 reports from 0.01 cycles/m on
_EDGE: Final = 1e-3  # [m] that a step takes


def spectrum(road_class: str, wavenumbers: ArrayLike) -> FloatArray:
    """One-sided displacement PSD of a road, G_d(n) = G_d(n_0) (n/n_0)^-2, n_0 = 0.1 cycles/m.

    Parameters
    ----------
    road_class : {"A", ..., "H"}
        Of ISO 8608, from very good to impassable: the class's geometric mean.
    wavenumbers : array_like
        n > 0 [cycles/m].

    Returns
    -------
    ndarray
        [m^3], m^2 per cycle/m.

    Raises
    ------
    ValueError
        There is no such class.
    """
    if road_class not in CLASSES:
        raise ValueError(f"road_class is {road_class!r}; it must be one of {', '.join(CLASSES)}")
    n = np.asarray(wavenumbers, dtype=np.float64)
    return np.asarray(CLASSES[road_class] * (n / _REFERENCE) ** -_WAVINESS)


def coherence(wavenumbers: ArrayLike, track: float) -> FloatArray:
    """How far the left track goes with the right: cross spectrum over G_d, of an isotropic road of waviness 2.

    Parameters
    ----------
    wavenumbers : array_like
        n [cycles/m].
    track : float
        t >= 0, between the two [m].

    Returns
    -------
    ndarray
        x K_1(x), x = 2 pi n t, between 1 and 0. Its square is the ordinary coherence.

    Notes
    -----
    An isotropic surface has one spectrum in all directions, which is in the plane G ~ abs(k)^-(w + 1); integrated over
    the wavenumber across with exp(i k_y t), w = 2, it is x K_1(x) (Kamash & Robson, *J. Sound Vib.* 57(1), 1978).
    """
    from scipy.special import k1

    x = 2.0 * math.pi * np.abs(np.asarray(wavenumbers, dtype=np.float64)) * track
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(x < 1e-12, 1.0, x * k1(np.maximum(x, 1e-12))))


@dataclass(frozen=True, eq=False)
class Profile:
    """Heights along a track, joined by lines; before the first and after the last as there.

    Parameters
    ----------
    distance : array_like, shape (N,)
        Ascending [m].
    height : array_like, shape (N,)
        Up [m].
    """

    distance: FloatArray
    height: FloatArray

    def __post_init__(self) -> None:
        s, r = (np.asarray(values, dtype=np.float64) for values in (self.distance, self.height))
        if s.ndim != 1 or s.shape != r.shape or not s.size:
            raise ValueError(f"distance and height have shapes {s.shape} and {r.shape}; they must be (N,) each, N >= 1")
        if not (np.isfinite(s).all() and np.isfinite(r).all()):
            raise ValueError("distance and height have a number that is not finite; each must be")
        if not (np.diff(s) > 0.0).all():
            raise ValueError(f"distance does not increase after {s[:-1][np.diff(s) <= 0.0][0]!r} m; it must")
        object.__setattr__(self, "distance", s)
        object.__setattr__(self, "height", r)

    def at(self, distance: ArrayLike) -> FloatArray:
        """Heights [m] at distances [m]."""
        return np.asarray(np.interp(np.asarray(distance, dtype=np.float64), self.distance, self.height))

    def mean(self, begin: ArrayLike, end: ArrayLike) -> FloatArray:
        """Mean heights between distances, exactly; the height where the two are one.

        Parameters
        ----------
        begin, end : array_like
            [m], in either order.

        Returns
        -------
        ndarray
            [m]
        """
        s_0, s_1 = (np.asarray(values, dtype=np.float64) for values in (begin, end))
        length = s_1 - s_0
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(length == 0.0, self.at(s_0), (self._area(s_1) - self._area(s_0)) / length))

    def averaged(self, length: float) -> Profile:
        """What a patch of a length feels that takes the mean of the heights under it.

        Parameters
        ----------
        length : float
            > 0 [m].

        Returns
        -------
        Profile
            Exact at its points, which are those where a kink enters or leaves the patch, and four between any two.
        """
        half = 0.5 * length
        kinks = np.unique(np.concatenate([self.distance - half, self.distance + half]))
        between = kinks[:-1, None] + np.diff(kinks)[:, None] * np.array([0.0, 0.25, 0.5, 0.75])
        s = np.unique(np.append(between.reshape(-1), kinks[-1]))
        return Profile(s, self.mean(s - half, s + half))

    def _area(self, distance: FloatArray) -> FloatArray:
        """Integral of the height from the first point on [m^2]."""
        s, r = self.distance, self.height
        areas = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(s) * (r[1:] + r[:-1]))])
        k = np.clip(np.searchsorted(s, distance, side="right") - 1, 0, s.size - 1)
        inside = np.clip(distance, s[0], s[-1])
        total = areas[k] + 0.5 * (inside - s[k]) * (r[k] + self.at(inside))
        return np.asarray(total + np.minimum(distance - s[0], 0.0) * r[0] + np.maximum(distance - s[-1], 0.0) * r[-1])


def bump(height: float, at: float, length: float = math.inf) -> Profile:
    """A cleat with steep sides, or a step where its length is infinite.

    Parameters
    ----------
    height : float
        Up [m]; a pothole has a negative one.
    at : float
        Where it begins [m].
    length : float
        > 0 [m].

    Returns
    -------
    Profile
        Its sides take a millimetre each.

    Raises
    ------
    ValueError
        A number is not finite, or the length not longer than the sides.
    """
    for name, value in (("height", height), ("at", at)):
        if not math.isfinite(value):
            raise ValueError(f"{name} is {value!r}; it must be finite")
    if not length > 2.0 * _EDGE:
        raise ValueError(f"length is {length!r}; it must be > {2.0 * _EDGE} m")
    s, r = [at, at + _EDGE], [0.0, height]
    if math.isfinite(length):
        s, r = [*s, at + length - _EDGE, at + length], [*r, height, 0.0]
    return Profile(np.array(s), np.array(r))


def random_tracks(
    road_class: str, length: float, track: float = 0.0, *, spacing: float = 0.05, seed: int = 0
) -> tuple[Profile, Profile]:
    """The left and the right track of a random road.

    Parameters
    ----------
    road_class : {"A", ..., "H"}
        Of ISO 8608.
    length : float
        Of the road, > 0 [m].
    track : float
        Between the two [m]; 0: they are one.
    spacing : float
        Of the points, > 0 [m]. Waves have at least two of them, and are at most 100 m long.
    seed : int
        Of the random numbers: the same road for the same seed.

    Returns
    -------
    left, right : Profile
        Gaussian, with the spectrum of :func:`spectrum` and the cross spectrum of :func:`coherence`.

    Raises
    ------
    ValueError
        There is no such class, or a number is out of its bounds.
    """
    for name, value in (("length", length), ("spacing", spacing)):
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} is {value!r}; it must be > 0 and finite")
    if not (math.isfinite(track) and track >= 0.0):
        raise ValueError(f"track is {track!r}; it must be >= 0 and finite")
    period = max(length, _LONGEST)
    count = 2 * math.ceil(0.5 * period / spacing)
    if count > 2**26:
        raise ValueError(f"length over spacing is {count}; it must be at most {2**26}")
    n = np.arange(1, count // 2) / (count * spacing)
    n = n[n >= 1.0 / _LONGEST * (1.0 - 1e-9)]
    first = count // 2 - 1 - n.size + 1
    random = np.random.default_rng(seed)
    noise = random.standard_normal((4, n.size)) / math.sqrt(2.0)
    one, two = noise[0] + 1j * noise[1], noise[2] + 1j * noise[3]
    # a wave has the variance G_d dn: the mean square of 2 Re(c exp(..)) is 2 E|c|^2
    size = np.sqrt(0.5 * spectrum(road_class, n) / (count * spacing))
    share = coherence(n, track)
    waves = size * one, size * (share * one + np.sqrt(np.maximum(1.0 - share * share, 0.0)) * two)
    points = np.arange(math.ceil(length / spacing) + 1)
    tracks = []
    for wave in waves:
        lines = np.zeros(count // 2 + 1, dtype=np.complex128)
        lines[first : first + n.size] = wave
        height = np.fft.irfft(lines, count) * count
        tracks.append(Profile(np.asarray(points * spacing, dtype=np.float64), height[points % count]))
    return tracks[0], tracks[1]


def travelled(time: ArrayLike, speed: ArrayLike) -> FloatArray:
    """Distance at times, of a speed that is joined by lines.

    Parameters
    ----------
    time : array_like, shape (N,)
        Ascending [s].
    speed : array_like, shape (N,) or ()
        [m/s]

    Returns
    -------
    ndarray, shape (N,)
        From the first time on [m].
    """
    t = np.asarray(time, dtype=np.float64)
    v = np.broadcast_to(np.asarray(speed, dtype=np.float64), t.shape)
    return np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (v[1:] + v[:-1]))])
