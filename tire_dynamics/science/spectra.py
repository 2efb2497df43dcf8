"""Spectra of what was recorded: Welch's estimates, and the frequency response H1 from input to output."""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

__all__ = ["Spectra", "Transfer", "segment_length"]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


class Transfer(NamedTuple):
    """What was seen of a linear system, at frequencies [Hz].

    Attributes
    ----------
    frequency : (N,) ndarray
        Without zero, which the segments' means were taken from.
    input, output : (N,) ndarray
        One-sided spectral densities [unit^2/Hz].
    response : (N,) complex ndarray
        The estimate H1: cross spectrum over input spectrum.
    coherence : (N,) ndarray
        How much of the output the input explains, 0 to 1.
    segments : int
        How many were averaged; they overlap by half.
    """

    frequency: FloatArray
    input: FloatArray
    output: FloatArray
    response: ComplexArray
    coherence: FloatArray
    segments: int


class Spectra:
    """Welch's estimates of spectra and H1 of an input and an output.

    Parameters
    ----------
    rate : float
        Of the samples [Hz].
    length : int
        Samples of a segment; Hann's window, half overlapping, each without its mean.
    hold : int or None
        Order of the hold of the input between the samples of the output: 0 of one that is held, and given as its mean
        over that time; 1 of one that goes along lines between samples at the times of the output's; None of samples of
        a smooth curve.
    """

    def __init__(self, rate: float, length: int, *, hold: Literal[0, 1] | None = 0) -> None:
        self.rate, self.length, self.hold = rate, length, hold
        self._u, self._y = np.empty(0), np.empty(0)
        self._time: float | None = None  # of the last sample
        self._sums = np.zeros((4, length // 2 + 1), np.complex128)
        self.segments = 0

    def add(self, time: FloatArray, u: FloatArray, y: FloatArray) -> None:
        """Take samples in order of time: y is the output at each, u the input (held: its mean until the next).

        Where more than two samples are missing a new segment begins; fewer are filled in by straight lines.
        """
        if not time.size:
            return
        step = 1.0 / self.rate
        before = time[0] - step if self._time is None else self._time
        jumps = np.diff(time, prepend=before)
        cuts = np.flatnonzero((jumps > 3.5 * step) | (jumps <= 0.0)).tolist()
        for first, last in zip([0, *cuts], [*cuts, time.size], strict=True):
            if first in cuts:
                self._stop()
            if last > first:
                self._go_on(time[first:last], u[first:last], y[first:last])
        if self._u.size > 16 * self.length:
            self._average()

    def _go_on(self, time: FloatArray, u: FloatArray, y: FloatArray) -> None:
        step = 1.0 / self.rate
        if self._time is not None and self._u.size:
            time = np.concatenate([[self._time], time])
            u, y = np.concatenate([self._u[-1:], u]), np.concatenate([self._y[-1:], y])
            self._u, self._y = self._u[:-1], self._y[:-1]
        if np.abs(np.diff(time) - step).max(initial=0.0) > 0.01 * step:
            even = time[0] + step * np.arange(round((time[-1] - time[0]) / step) + 1)
            u, y = np.interp(even, time, u), np.interp(even, time, y)
        self._u, self._y = np.concatenate([self._u, u]), np.concatenate([self._y, y])
        self._time = float(time[-1])

    def _stop(self) -> None:
        self._average()
        self._u, self._y, self._time = np.empty(0), np.empty(0), None

    def _average(self) -> None:
        step = self.length - self.length // 2
        count = (self._u.size - self.length) // step + 1
        if count < 1:
            return
        options: dict[str, Any] = {"fs": self.rate, "nperseg": self.length, "noverlap": self.length // 2}
        used = slice(0, self.length + (count - 1) * step)
        u, y = self._u[used], self._y[used]
        for row, (one, other) in enumerate(((u, u), (y, y), (u, y))):
            self._sums[row] += count * signal.csd(one, other, **options)[1]
        self.segments += count
        self._u, self._y = self._u[count * step :], self._y[count * step :]

    def transfer(self) -> Transfer | None:
        """The estimates; None if there was no whole segment.

        Notes
        -----
        An input that is held from sample to sample reaches the system through a filter of its own, sinc(f/rate)
        exp(-i pi f/rate), and so does its mean between samples, to within the images above half the rate; one that goes
        along lines through sinc^2(f/rate). The response is divided by it. Samples of a smooth curve need nothing.
        """
        self._average()
        if not self.segments:
            return None
        frequency = np.arange(1, self.length // 2 + 1, dtype=np.float64) * (self.rate / self.length)
        uu, yy, uy = (row[1:] / self.segments for row in self._sums[:3])
        uu, yy = uu.real, yy.real
        hold: ComplexArray = np.ones(1, dtype=np.complex128)
        if self.hold == 0:
            hold = np.sinc(frequency / self.rate) * np.exp(-1j * math.pi * frequency / self.rate)
        elif self.hold == 1:
            hold = np.asarray(np.sinc(frequency / self.rate) ** 2, dtype=np.complex128)
        with np.errstate(divide="ignore", invalid="ignore"):
            response = np.where(uu > 0.0, uy / uu, math.nan) / hold
            coherence = np.where(uu * yy > 0.0, np.abs(uy) ** 2 / (uu * yy), 0.0)
        return Transfer(frequency, uu, yy, response, np.minimum(coherence, 1.0), self.segments)


def segment_length(rate: float, seconds: float) -> int:
    """Samples of a segment for a drive of some seconds: 2 s, less for a short one, a power of two."""
    wanted = min(2.0, seconds / 8.0) * rate
    return int(2 ** max(6, math.floor(math.log2(max(wanted, 1.0)) + 0.5)))
