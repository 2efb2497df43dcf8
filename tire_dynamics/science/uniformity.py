"""Force variation by harmonic of the wheel's angle, as tire uniformity has it (RFV), from samples at any angles."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .harmonics import HIGHEST

__all__ = ["OrderSums", "Variation"]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_BLOCK: Final = 4096  # samples whose powers are held at once: 1.4 MB
_LARGEST: Final = 100.0  # condition of the normal equations, 2 where the angles are even: noise grows by its root
_FINE: Final = 512  # points on a turn for each harmonic, for the extremes of their sum


class Variation(NamedTuple):
    """How a force varies over the turn of a wheel: mean + sum_j peak_to_peak_j/2 cos j(phi - phase_j).

    Attributes
    ----------
    turns : float
        Through which the wheel went, either way.
    mean : float
        Over the angle [N].
    peak_to_peak : ndarray, shape (H,)
        Of harmonics 1 to H [N]; NaN from the first that the samples do not determine on.
    phase : ndarray, shape (H,)
        The least wheel angle at which the harmonic is highest, in [0, 2 pi/j) [rad]; NaN likewise.
    whole : float
        Peak to peak of the sum of all known harmonics [N], to 2e-5 of their own.
    """

    turns: float
    mean: float
    peak_to_peak: FloatArray
    phase: FloatArray
    whole: float


class OrderSums:
    """The harmonics of a force over the wheel's angle, from samples that come in blocks, in bounded memory.

    Parameters
    ----------
    harmonics : int
        Highest harmonic, 1 to 100.

    Raises
    ------
    ValueError
        ``harmonics`` is out of bounds.

    Notes
    -----
    Least squares of the force on 1, cos j phi, sin j phi. Products of these are sums of cosines and sines of (j + k)
    phi and (j - k) phi, so that the normal equations are made of S_m = sum exp(i m phi), m = 0..2 H, and the right side
    of b_j = sum F exp(i j phi), j = 0..H: running sums are all that is kept. Angles may be uneven, turns broken off; a
    force that is such a series is found to rounding. Without weights every sample has the same: where the wheel turns
    slowly there are more of them. What does not repeat with the turn (the road, a load that changes) averages out with
    the root of the turns.

    A harmonic j is known if the mean step of the angle times j is at most pi, and if the normal equations up to j
    have a condition of at most 100: their angles then leave no large part of the turn out. Names as in M. G. Pottinger,
    Uniformity: A crucial attribute of tire/wheel assemblies, Tire Science and Technology 38 (2010), 24-46; this is the
    force on the axle of a wheel that moves, not that of a test machine, which holds it.

    Examples
    --------
    >>> phi = np.linspace(0.0, 40.0, 1000)
    >>> sums = OrderSums()
    >>> sums.add(phi, 4000.0 + 30.0 * np.cos(phi - 0.5) + 8.0 * np.cos(3.0 * (phi - 1.0)))
    >>> found = sums.variation()
    >>> found.peak_to_peak[[0, 2]].round(6).tolist(), found.phase[[0, 2]].round(6).tolist()
    ([60.0, 16.0], [0.5, 1.0])
    """

    def __init__(self, harmonics: int = 10) -> None:
        if not 1 <= harmonics <= HIGHEST:
            raise ValueError(f"harmonics is {harmonics}; it must be from 1 to {HIGHEST}")
        self.harmonics = harmonics
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        self._count = 0
        self._angles = np.zeros(2 * self.harmonics + 1, np.complex128)  # S_m
        self._forces = np.zeros(self.harmonics + 1, np.complex128)  # b_j
        self._swept = 0.0  # [rad]
        self._steps = 0
        self._last = math.nan  # angle

    def add(self, angle: ArrayLike, force: ArrayLike, weight: ArrayLike | None = None) -> None:
        """Take samples.

        Parameters
        ----------
        angle : array_like, shape (N,)
            Of the wheel, phi [rad], forward rolling positive; wrapped or not.
        force : array_like, shape (N,)
            [N]. A sample of which anything is not finite is left out.
        weight : array_like, shape (N,), optional
            Of the squares, >= 0; 1 if left out.

        Raises
        ------
        ValueError
            They are not rows of the same length.
        """
        angles, forces = np.asarray(angle, np.float64), np.asarray(force, np.float64)
        weights = np.ones(angles.shape) if weight is None else np.asarray(weight, np.float64)
        if angles.ndim != 1 or not angles.shape == forces.shape == weights.shape:
            shapes = f"angle has shape {angles.shape}, force {forces.shape}, weight {weights.shape}"
            raise ValueError(f"{shapes}; they must be rows of one length")
        finite = np.isfinite(angles) & np.isfinite(forces) & np.isfinite(weights)
        if not finite.all():
            angles, forces, weights = angles[finite], forces[finite], weights[finite]
        for first in range(0, angles.size, _BLOCK):
            block = slice(first, first + _BLOCK)
            self._add(angles[block], forces[block], weights[block])

    def _add(self, angles: FloatArray, forces: FloatArray, weights: FloatArray) -> None:
        powers = np.empty((2 * self.harmonics + 1, angles.size), np.complex128)
        powers[0] = weights
        turned = np.exp(1j * angles)
        for m in range(2 * self.harmonics):
            np.multiply(powers[m], turned, out=powers[m + 1])
        self._count += angles.size
        self._angles += powers.sum(axis=1)
        self._forces += (powers[: self.harmonics + 1] * forces).sum(axis=1)
        steps = np.diff(angles, prepend=self._last)
        steps = steps[np.isfinite(steps)]  # the very first is none
        self._swept += float(np.abs(np.mod(steps + math.pi, 2.0 * math.pi) - math.pi).sum())
        self._steps += steps.size
        self._last = float(angles[-1])

    def merge(self, other: OrderSums) -> None:
        """Take the samples of another, of as many harmonics; the angle between the two is not counted."""
        if other.harmonics != self.harmonics:
            raise ValueError(f"other has {other.harmonics} harmonics; it must have {self.harmonics}")
        self._count += other._count
        self._angles += other._angles
        self._forces += other._forces
        self._swept += other._swept
        self._steps += other._steps
        self._last = other._last

    @property
    def turns(self) -> float:
        """Turns of the wheel, either way; each step of the angle is the shorter way round."""
        return self._swept / (2.0 * math.pi)

    def variation(self) -> Variation | None:
        """The harmonics; None of less than a whole turn, or if not even the first is known."""
        fit = self._fit()
        if fit is None:
            return None
        mean, phasors = fit
        j = np.arange(1, self.harmonics + 1)
        phase = np.mod(-np.angle(phasors) / j, 2.0 * math.pi / j)
        phase[phase >= 2.0 * math.pi / j] = 0.0  # of the least below 0, rounding makes a whole one
        known = phasors[np.isfinite(phasors)]
        points = _FINE * known.size
        wave = np.fft.irfft(np.concatenate([[0.0], known]), points) * (0.5 * points)
        return Variation(self.turns, mean, 2.0 * np.abs(phasors), phase, float(np.ptp(wave)))

    def phasors(self) -> ComplexArray | None:
        """Half the peak to peak times exp(-i j phase), shape (H,) [N], where :meth:`variation` has one."""
        fit = self._fit()
        return None if fit is None else fit[1]

    def _fit(self) -> tuple[float, ComplexArray] | None:
        if self._count < 3 or self.turns < 1.0 - 1e-9 or not self._angles[0].real > 0.0:
            return None
        step = self._swept / self._steps
        highest = min(self.harmonics, math.floor(math.pi / step * (1.0 + 1e-9)))
        normal, right = self._normal_equations()
        for last in range(highest, 0, -1):
            kept = slice(0, 2 * last + 1)
            sizes = np.linalg.eigvalsh(normal[kept, kept])
            if sizes[0] * _LARGEST >= sizes[-1]:
                break
        else:
            return None
        solution = np.linalg.solve(normal[kept, kept], right[kept])
        phasors = np.full(self.harmonics, math.nan + 0j)
        phasors[:last] = solution[1::2] - 1j * solution[2::2]
        return float(solution[0]), phasors

    def _normal_equations(self) -> tuple[FloatArray, FloatArray]:
        """For the coefficients of 1, cos phi, sin phi, cos 2 phi ..., over the sum of the weights."""
        weight, H = self._angles[0].real, self.harmonics
        j = np.arange(H + 1)
        S = np.concatenate([self._angles[:0:-1].conj(), self._angles]) / weight  # from -2 H on
        plus, minus = S[np.add.outer(j, j) + 2 * H], S[np.subtract.outer(j, j) + 2 * H]
        normal = np.empty((H + 1, 2, H + 1, 2))
        normal[:, 0, :, 0] = 0.5 * (minus.real + plus.real)
        normal[:, 1, :, 1] = 0.5 * (minus.real - plus.real)
        normal[:, 0, :, 1] = 0.5 * (plus.imag - minus.imag)
        normal[:, 1, :, 0] = normal[:, 0, :, 1].T
        right = np.stack([self._forces.real, self._forces.imag], axis=1) / weight
        whole = np.delete(np.arange(2 * H + 2), 1)  # without sin 0
        return normal.reshape(2 * H + 2, -1)[np.ix_(whole, whole)], right.reshape(-1)[whole]
