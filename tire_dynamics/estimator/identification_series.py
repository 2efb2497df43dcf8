"""The parameters and the delay that fit the time series, with a noise of any spectrum that does not change."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize, signal

from ..science import wheel
from ..science.interpolation import smooth_curve
from ..science.spectra import Spectra, Transfer
from .identification_noise import LONGEST, Noise, autoregression, autoregression_with, power_of
from .identification_problem import DIFFERENCE, OUTPUT_DEGREE, Identification, Problem, Section, Seen, median

__all__ = [
    "from_time_series",
]

FloatArray = NDArray[np.float64]

_NEARBY = 0.02  # [s]: how far the time series may move the delay
_PASSED = 0.128  # [s] of the autoregression where noise of the load is a part of it: the wheel's hop stands in that
_MOST_GAIN = 2.0  # of its logarithm, either way
_BLOCK = 0.5  # [s] over which the residual's pull at the estimates is summed
_LINES = 4  # of a spectrum, taken together
_KNOWN_NOISE = 0.2  # share of its effect that remains unsure of a noise whose size was said, to a tenth
_CALLS = (6, 10, 25, 25, 25)  # of the model by turns of fit and noise: the first are for the noise's sake


class _Coordinates:
    """Logarithms x of the values as functions of q, in which the valley of equal fits is straighter.

    Where they are fitted, q has k_s/(M + m), the wheel's hop, for k_s, and k_1 (1/M + 1/m), of ring against wheel, for
    k_1: the data know these far better than the masses.
    """

    def __init__(self, problem: Problem) -> None:
        self._names, self._start = problem.names, problem.start

    def _shifts(self, x: FloatArray) -> tuple[FloatArray, float]:
        """x less q, and M/(M + m)."""
        fitted = dict(zip(self._names, x.tolist(), strict=True))
        M = math.exp(fitted["wheel_mass"]) if "wheel_mass" in fitted else self._start.wheel_mass
        m = self._start.ring_mass
        if "density" in fitted:
            m *= math.exp(fitted["density"]) / self._start.density
        shifts = {"suspension_stiffness": math.log(M + m), "k_1": -math.log(1.0 / M + 1.0 / m)}
        return np.array([shifts.get(name, 0.0) for name in self._names]), M / (M + m)

    def of(self, x: FloatArray) -> FloatArray:
        """q at x."""
        return x - self._shifts(x)[0]

    def logs(self, q: FloatArray) -> FloatArray:
        """x at q; the masses, which the shifts hang on, are the same in both."""
        return q + self._shifts(q)[0]

    def slope(self, x: FloatArray) -> FloatArray:
        """dx/dq, (P, P)."""
        T = np.eye(x.size)
        share = self._shifts(x)[1]
        parts = {("suspension_stiffness", "wheel_mass"): share, ("suspension_stiffness", "density"): 1.0 - share}
        parts |= {("k_1", "wheel_mass"): 1.0 - share, ("k_1", "density"): share}
        for i, one in enumerate(self._names):
            for j, other in enumerate(self._names):
                T[i, j] += parts.get((one, other), 0.0)
        return T


class _Series:
    """The measured samples that are used, and what the model says of them."""

    def __init__(self, problem: Problem, delay: float) -> None:
        self.problem = problem
        self.coordinates = _Coordinates(problem)
        record = problem.recording
        self.parts: list[slice] = []  # of the record, one for each section
        self.sections: list[Section] = []
        for section in problem.sections:
            first = section.time[0] + problem.settling + delay + _NEARBY
            part = slice(*np.searchsorted(record.force_time, [first, section.time[-1] + delay - _NEARBY]).tolist())
            if part.stop - part.start > 1:
                self.parts.append(part)
                self.sections.append(section)
        if not self.parts:
            raise ValueError("no measured force lies where speed, load and a settled motion are known")
        self.time = np.concatenate([record.force_time[part] for part in self.parts])
        self.force = np.concatenate([record.force[part] for part in self.parts])[:, list(problem.axes)]
        cuts = np.flatnonzero(np.diff(self.time) > 1.5 * problem.interval) + 1
        ends = np.cumsum([part.stop - part.start for part in self.parts])[:-1]
        edges = np.unique(np.concatenate([[0], cuts, ends, [self.time.size]]))
        self.runs = [slice(a, b) for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)]
        self.speed = float(np.mean(np.concatenate([each.speed for each in self.sections])))
        self._known: tuple[bytes, list[FloatArray]] = (b"", [])
        self._known_jacobian = (b"", np.empty(0))

    def curves(self, x: FloatArray) -> list[FloatArray]:
        """Axle forces (K, A) at the kept times of each section; the last are remembered."""
        if self._known[0] != x.tobytes():
            unit = self.problem.unit(x)
            found = [self.problem.forces(unit, each)[:, list(self.problem.axes)] for each in self.sections]
            self._known = (x.tobytes(), found)
        return self._known[1]

    def at(self, curves: Sequence[FloatArray], delay: float, derivative: int = 0) -> FloatArray:
        """Curves, or their derivatives to time, at the times of the measurement less the delay, shape (N, A)."""
        record = self.problem.recording
        values: list[FloatArray] = []
        for part, section, curve in zip(self.parts, self.sections, curves, strict=True):
            if not np.isfinite(curve).all():
                return np.full_like(self.force, math.nan)
            spline = smooth_curve(section.time[section.kept], curve, OUTPUT_DEGREE)
            values.append(spline(record.force_time[part] - delay, derivative))
        whole: FloatArray = np.concatenate(values)
        return whole

    def residual(self, z: FloatArray) -> FloatArray:
        """Model less measurement (N, A).

        z is q of :class:`_Coordinates`, the delay [ms], the logarithm of the gain and the offsets [N].
        """
        P = len(self.problem.names)
        offset: FloatArray = z[P + 2 :] - self.force
        return math.exp(z[P + 1]) * self.at(self.curves(self.coordinates.logs(z[:P])), 1e-3 * float(z[P])) + offset

    def jacobian(self, z: FloatArray) -> FloatArray:
        """Derivatives of the residual, (N, A, P + 2 + A); the last are remembered."""
        if self._known_jacobian[0] != z.tobytes():
            base = self.curves(self.coordinates.logs(z[: len(self.problem.names)]))
            self._known_jacobian = (z.tobytes(), self._jacobian(z, self.sections, base))
        return self._known_jacobian[1]

    def _jacobian(self, z: FloatArray, sections: Sequence[Section], base: Sequence[FloatArray]) -> FloatArray:
        """Of the forces that the model has under the inputs of these sections, ``base`` at z."""
        P, A = len(self.problem.names), self.force.shape[1]
        q, delay, gain = z[:P], 1e-3 * float(z[P]), math.exp(z[P + 1])
        x = self.coordinates.logs(q)
        J = np.zeros((*self.force.shape, z.size))
        for k in range(P):
            step = DIFFERENCE if x[k] + DIFFERENCE < self.problem.high[k] else -DIFFERENCE
            unit = self.problem.unit(self.coordinates.logs(q + step * (np.arange(P) == k)))
            moved = [self.problem.forces(unit, each)[:, list(self.problem.axes)] for each in sections]
            J[..., k] = gain * self.at([(one - other) / step for one, other in zip(moved, base, strict=True)], delay)
        J[..., P] = -1e-3 * gain * self.at(base, delay, 1)
        J[..., P + 1] = gain * self.at(base, delay)
        J[:, np.arange(A), P + 2 + np.arange(A)] = 1.0
        return J

    def pull(self, z: FloatArray, noise: Sequence[Noise], rms: float) -> FloatArray:
        """The slope of half the cost at the truth that white noise of the load [N rms] brings, (P + 2 + A,).

        The model answers to noise that never was: its answer, and its derivatives of it, whitened, over all samples.
        What the delay would make of it has no mean.
        """
        x = self.coordinates.logs(z[: len(self.problem.names)])
        kept = {section.time[0] for section in self.sections}
        sections = [each for each in self.problem.sections_of_noise(rms) if each.time[0] in kept]
        unit = self.problem.unit(x)
        base = [self.problem.forces(unit, each)[:, list(self.problem.axes)] for each in sections]
        J = self._jacobian(z, sections, base)
        J[..., len(self.problem.names)] = 0.0
        J[..., len(self.problem.names) + 2 :] = 0.0
        answer = J[..., len(self.problem.names) + 1]
        slope: FloatArray = self.whitened(J, noise).T @ self.whitened(answer, noise)
        return slope

    def prior_slope(self, z: FloatArray) -> FloatArray:
        """Derivatives of the priors' residuals, (x - origin)/width and that of the gain, (P + 1, P + 2 + A)."""
        P = len(self.problem.names)
        slope = np.zeros((P + 1, z.size))
        slope[:P, :P] = self.coordinates.slope(self.coordinates.logs(z[:P])) / self.problem.prior_width[:, None]
        slope[P, P + 1] = 1.0 / self.problem.gain_width
        return slope

    def noise(self, residual: FloatArray, x: FloatArray, rms: float) -> list[Noise]:
        """The autoregression of each column of a residual, with what is known of it.

        White noise of the load [N rms] passes the unit, and there is as much of it in the residual as |H|^2 says. An
        autoregression alone, of an order that suits a whole spectrum, does not show the few hertz around the wheel's
        hop, on which ``suspension_stiffness`` and the gain hang.
        """
        return [
            autoregression_with(passed, column, self.runs, max(LONGEST, round(_PASSED / self.problem.interval)))
            if passed.any()
            else autoregression(column, self.runs)
            for column, passed in zip(residual.T, self._passed(x, rms), strict=True)
        ]

    def _passed(self, x: FloatArray, rms: float) -> list[FloatArray]:
        """Power of what each column answers to white noise of the load, as it is sampled."""
        highest = 0.5 / median(self.problem.recording.load_time)
        f = np.linspace(0.0, highest, 1 + 8 * math.ceil(highest))
        H = wheel.frequency_response(self.problem.unit(x), self.speed, f, self.problem.model)[:, self.problem.axes, 0]
        return [power_of(f, rms**2 / highest * np.abs(each) ** 2, 1.0 / self.problem.interval) for each in H.T]

    def load_noise(self, residual: FloatArray, x: FloatArray) -> float:
        """White noise that the load's channel has [N rms], as it was said, or may have at the most."""
        if self.problem.given_noise is not None:
            return self.problem.given_noise
        return min(self.problem.load_noise(), _noise_that_passes(self, residual[:, -1], x))

    def whitened(self, values: FloatArray, noise: Sequence[Noise]) -> FloatArray:
        """Values (N, A, ...) as prediction errors over their deviation, one column after the other, (M, ...)."""
        rows = []
        for column, (coefficients, deviation) in enumerate(noise):
            p = coefficients.size
            taps = np.concatenate([[1.0], -coefficients]) / deviation
            for run in self.runs:
                if run.stop - run.start > p:
                    rows.append(signal.lfilter(taps, [1.0], values[run, column], axis=0)[p:])
        whole: FloatArray = np.concatenate(rows)
        return whole


def from_time_series(problem: Problem, seen: tuple[Seen, ...], first: FloatArray, delay: float) -> Identification:
    series = _Series(problem, delay)
    P, A = len(problem.names), series.force.shape[1]
    if series.time.size < 20 * (P + 2 + A):
        raise ValueError(f"{series.time.size} samples of the measured force are left; {20 * (P + 2 + A)} are needed")
    if not np.isfinite(series.curves(first)[0]).all():
        first = problem.origin
    first = np.clip(first, problem.low + 1e-9, problem.high - 1e-9)
    z = np.concatenate([series.coordinates.of(first), [1e3 * delay, 0.0], np.zeros(A)])
    z[P + 2 :] = -series.residual(z).mean(axis=0)
    residual = series.residual(z)
    for calls in _CALLS:
        x = series.coordinates.logs(z[:P])
        noise = series.noise(residual, x, series.load_noise(residual, x))
        z, J, moved = _solve(series, noise, z, delay, calls)
        residual = series.residual(z)
        if moved < 0.3:
            break
    white = series.whitened(residual, noise)
    spare = max(white.size - z.size, 1)
    sure = spare / float(white @ white)  # what the noise turned out to be
    information = J.T @ J * sure
    prior = series.prior_slope(z)
    rms = series.load_noise(residual, series.coordinates.logs(z[:P]))
    bias = -_inverse(information + prior.T @ prior) @ (sure * series.pull(z, noise, rms)) if rms > 0.0 else 0.0 * z
    if problem.given_noise is not None:
        z = z - bias
    x = series.coordinates.logs(z[:P])
    to_logs = linalg.block_diag(series.coordinates.slope(x), np.eye(2 + A))
    # by the data alone: without the priors of the parameters, but with that of the gain, which is of the sensors
    shares = (np.ones(P + 1), np.append(np.full(P, 1e-4), 1.0))
    pulls = _pulls(series, J, white) * sure
    covariance, own = (
        to_logs @ _covariance(information, (prior.T * share) @ prior, pulls) @ to_logs.T for share in shares
    )
    bias = to_logs @ bias
    unsure = bias * (_KNOWN_NOISE if problem.given_noise is not None else 1.0)
    covariance, own = covariance + np.outer(unsure, unsure), own + np.outer(unsure, unsure)
    errors = np.sqrt(np.diag(covariance))
    at = [name for k, name in enumerate(problem.names) if min(x[k] - problem.low[k], problem.high[k] - x[k]) < 1e-3]
    power = np.var(series.force, axis=0)
    left = np.var(residual, axis=0)
    return Identification(
        unit=problem.unit(x),
        start=problem.start,
        names=problem.names,
        values=np.exp(x),
        errors=errors[:P],
        correlation=covariance[:P, :P] / np.outer(errors[:P], errors[:P]),
        from_data=np.sqrt(np.diag(own))[:P],
        at_bound=tuple(at),
        prior_width=problem.prior_width,
        delay=1e-3 * float(z[P]),
        delay_error=1e-3 * float(errors[P]),
        gain=math.exp(z[P + 1]),
        gain_error=float(errors[P + 1]),
        load_noise=rms,
        bias=bias[:P],
        axes=problem.axes,
        offset=z[P + 2 :],
        offset_error=errors[P + 2 :],
        noise=np.sqrt(left),
        explained=1.0 - np.divide(left, power, out=np.ones_like(left), where=power > 0.0),
        orders=tuple(each.coefficients.size for each in noise),
        unexplained=_unexplained(series, residual[:, -1], 1e-3 * float(z[P])),
        seconds=series.time.size * problem.interval,
        samples=series.time.size,
        sections=len(series.sections),
        seen=seen,
    )


def _pulls(series: _Series, J: FloatArray, white: FloatArray) -> FloatArray:
    """Sums of the derivatives times the residual, both whitened, over half a second each, shape (B, P + 2 + A)."""
    length = max(1, round(_BLOCK / series.problem.interval))
    firsts = np.arange(0, max(white.size - length // 2, 1), length)
    sums: FloatArray = np.add.reduceat(J * white[:, None], firsts, axis=0)
    return sums


def _covariance(information: FloatArray, prior: FloatArray, pulls: FloatArray) -> FloatArray:
    """Of the estimates, with errors no smaller than what the residual shows when its whitening was not perfect.

    The second are the "sandwich" of P. J. Huber, 1967: the scatter of what pulls at the estimates, block by block,
    between two inverses. It is known to one in ten, and counts where it is the larger.
    """
    inverse = _inverse(information + prior)
    seen = inverse @ (pulls.T @ pulls + prior) @ inverse
    grown = np.sqrt(np.maximum(np.diag(seen) / np.diag(inverse), 1.0))
    found: FloatArray = inverse * np.outer(grown, grown)
    return found


def _inverse(information: FloatArray) -> FloatArray:
    """Of a symmetric matrix whose rows have units of their own."""
    size = 1.0 / np.sqrt(np.diag(information))
    inverse: FloatArray = np.linalg.inv(information * np.outer(size, size)) * np.outer(size, size)
    return inverse


def _solve(
    series: _Series, noise: Sequence[Noise], z: FloatArray, delay: float, calls: int
) -> tuple[FloatArray, FloatArray, float]:
    """Least squares with this noise: z, whitened Jacobian, and how far z moved, in standard errors.

    Solved in coordinates in which the first Jacobian is 0.01: parameters that the data hardly tell apart then cost no
    more steps than others.
    """
    problem, P = series.problem, len(series.problem.names)
    whole = P + 1 + series.whitened(series.force, noise).shape[0]

    def whitened(z: FloatArray) -> FloatArray:
        return np.concatenate([series.whitened(series.jacobian(z), noise), series.prior_slope(z)])

    triangle = np.linalg.qr(whitened(z), mode="r")
    across = 100.0 * linalg.solve_triangular(triangle, np.eye(z.size))

    def residual(w: FloatArray) -> FloatArray:
        at = z + across @ w
        with np.errstate(over="ignore"):
            x = series.coordinates.logs(at[:P]) if np.abs(at[:P]).max() < 600.0 else np.full(P, math.inf)
        inside = ((x >= problem.low) & (x <= problem.high)).all() and abs(1e-3 * at[P] - delay) < 0.9 * _NEARBY
        inside = inside and abs(at[P + 1]) < _MOST_GAIN
        if not inside:
            return np.full(whole, math.inf)  # a shorter step is tried
        priors = np.append((x - problem.origin) / problem.prior_width, at[P + 1] / problem.gain_width)
        return np.concatenate([series.whitened(series.residual(at), noise), priors])

    solver: Callable[..., optimize.OptimizeResult] = optimize.least_squares
    found = solver(
        residual,
        np.zeros(z.size),
        jac=lambda w: whitened(z + across @ w) @ across,
        ftol=1e-7,
        xtol=1e-6,
        max_nfev=calls,
    )
    at = z + across @ found.x
    return at, whitened(at)[: -P - 1], float(np.linalg.norm(triangle @ (at - z)))


def _transfer(series: _Series, load: FloatArray, residual: FloatArray) -> Transfer | None:
    """What is seen from the load to the residual; None of less than 8 segments."""
    longest = max(run.stop - run.start for run in series.runs)
    length = 2 ** int(math.log2(max(min(1.0 / series.problem.interval, longest, residual.size / 6.0), 8.0)))
    spectra = Spectra(1.0 / series.problem.interval, length, hold=None)
    for run in series.runs:
        spectra.add(series.time[run], load[run], residual[run])
    transfer = spectra.transfer()
    return None if transfer is None or transfer.segments < 8 else transfer


def _noise_that_passes(series: _Series, residual: FloatArray, x: FloatArray) -> float:
    """How much white noise the load's channel has at the most [N rms], by what the model leaves.

    The model answers to noise of the load as to the load: at no frequency is there more of it than what is left there
    over |H|^2.
    """
    problem = series.problem
    transfer = _transfer(series, np.zeros_like(residual), residual)
    if transfer is None:
        return math.inf
    whole = wheel.frequency_response(problem.unit(x), series.speed, transfer.frequency, problem.model)
    H = whole[:, problem.axes[-1], 0]
    count = transfer.frequency.size // _LINES * _LINES
    left = transfer.output[:count].reshape(-1, _LINES).mean(axis=1)
    passes = (np.abs(H[:count]) ** 2).reshape(-1, _LINES).mean(axis=1)
    if not left.size:
        return math.inf
    # two deviations above the least: of many, each of a few segments, that is too low
    sure = 1.0 + 2.0 / math.sqrt(0.5 * _LINES * transfer.segments)
    density = float((left / np.maximum(passes, 1e-30)).min()) * sure
    return math.sqrt(density * 0.5 / median(problem.recording.load_time))


def _unexplained(series: _Series, residual: FloatArray, delay: float) -> float:
    """Share of the residual's power that is coherent with the load, less what chance gives."""
    load = np.concatenate(
        [
            np.interp(series.problem.recording.force_time[part] - delay, each.time, each.load)
            for part, each in zip(series.parts, series.sections, strict=True)
        ]
    )
    transfer = _transfer(series, load, residual)
    if transfer is None:
        return 0.0
    by_chance = 1.2 / transfer.segments  # segments that overlap by half are not quite independent
    share = np.sum(transfer.output * (transfer.coherence - by_chance)) / max(float(np.sum(transfer.output)), 1e-300)
    return float(np.clip(share, 0.0, 1.0))
