"""Exact transitions of any linear system from tables: the steps of ``contact_reference``, and not those of the loop."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["ExactStepper"]

FloatArray = NDArray[np.float64]

_NEGLIGIBLE = 2.0**-57  # beside Phi, whose size is 1 and whose rounding is 2^-53
_LONGEST = 2.5  # norm of h F that is summed directly; the largest term, 2.5^2/2!, costs two bits at the most


class ExactStepper:
    """The exact transition of a linear system over one step, from tables that are built once.

    Parameters
    ----------
    terms : sequence of ndarray, shape (n, n)
        F_0, F_1, ... of F(Omega) = F_0 + Omega F_1 + Omega^2 F_2 + ...
    inputs : ndarray, shape (n, m)
        B.
    scale : ndarray, shape (n,)
        The states' sizes beside one another (1 for a velocity, 1/omega for its displacement); what is
        negligible is judged by them.
    top_speed : float
        Speeds up to this one [rad/s] are evaluated directly, faster ones by doubling more often.
    """

    def __init__(
        self, terms: Sequence[FloatArray], inputs: FloatArray, scale: FloatArray, top_speed: float = 512.0
    ) -> None:
        self.states, self.inputs = inputs.shape
        self.top_speed = top_speed
        self.order = len(terms) - 1  # in the speed
        balance = scale / scale[:, None]
        norm = sum(float((np.abs(term) * balance).sum(axis=1).max()) * top_speed**k for k, term in enumerate(terms))
        self.longest_step = 2.0 ** (math.frexp(_LONGEST / norm)[1] - 1)  # [s]; a power of two scales exactly
        drive = float((np.abs(inputs) / scale[:, None]).max()) * self.longest_step or 1.0
        forced = np.repeat(1.0 / (scale[:, None] * drive), 2 * self.inputs, axis=1)
        self.table = self._tabulate(terms, inputs, np.concatenate([balance, forced], axis=1))

    def _tabulate(self, terms: Sequence[FloatArray], inputs: FloatArray, weight: FloatArray) -> FloatArray:
        """Coefficients of (h/longest_step)^j (Omega/top_speed)^k of [Phi G_0 G_1], transposed: (J, K, n+2m, n)."""
        n, m = self.states, self.inputs
        scaled = [self.longest_step * self.top_speed**k * term for k, term in enumerate(terms)]
        start = np.concatenate([np.eye(n), np.zeros((n, 2 * m))], axis=1)
        orders = [[start]]
        negligible = 0
        while negligible < 2:  # two in a row, lest a vanishing odd or even order end the series
            before, j = orders[-1], len(orders)
            after = [np.zeros_like(start) for _ in range(len(before) + len(terms) - 1)]
            for k, coefficient in enumerate(before):
                for i, term in enumerate(scaled):
                    after[k + i] += _product(term, coefficient)
            for coefficient in after:
                coefficient[:, : n + m] /= j
                coefficient[:, n + m :] /= j + 1
            if j == 1:
                after[0][:, n : n + m] = self.longest_step * inputs
                after[0][:, n + m :] = 0.5 * self.longest_step * inputs
            orders.append(after)
            largest = max(float(np.abs(coefficient * weight).max()) for coefficient in after)
            negligible = negligible + 1 if largest < _NEGLIGIBLE else 0
        width = max(
            k + 1
            for order in orders
            for k, coefficient in enumerate(order)
            if float(np.abs(coefficient * weight).max()) >= _NEGLIGIBLE
        )
        table = np.zeros((len(orders), width, n + 2 * m, n))
        for j, order in enumerate(orders):
            for k, coefficient in enumerate(order[:width]):
                table[j, k] = coefficient.T
        return table

    def limit(self, speed: float) -> float:
        """The longest step [s] that is evaluated directly at a speed >= 0: no term outgrows its size in the table."""
        limit = self.longest_step
        for _ in range(self.order):
            limit *= self.top_speed / max(speed, self.top_speed)
        return limit

    def transitions(self, steps: FloatArray, speeds: FloatArray) -> FloatArray:
        """Transitions of many steps at once, transposed [Phi G_0 G_1].

        Parameters
        ----------
        steps : ndarray, shape () or (N,)
            Lengths of the steps [s]; a scalar means that all are equal.
        speeds : ndarray, shape () or (N,)
            Speeds during the steps [rad/s]; a scalar means that all are equal.

        Returns
        -------
        ndarray, shape (N, n + 2 m, n)
        """
        J, K, rows, n = self.table.shape
        doublings = _doublings(float(np.max(steps)), self.limit(float(np.abs(speeds).max())))
        eta = np.asarray(steps)[..., None] / (self.longest_step * 2.0**doublings)
        omega = np.asarray(speeds)[..., None] / self.top_speed
        in_step, in_speed = eta ** np.arange(J), omega ** np.arange(K)
        if in_step.ndim == 1:
            result = in_speed @ (in_step @ self.table.reshape(J, -1)).reshape(K, -1)
        elif in_speed.ndim == 1:
            result = in_step @ np.einsum("k,jkm->jm", in_speed, self.table.reshape(J, K, -1))
        else:
            at_speed = (in_speed @ self.table.reshape(J, K, -1)).swapaxes(0, 1)
            result = (in_step[:, None, :] @ at_speed)[:, 0, :]
        result = np.broadcast_to(result, (max(np.size(steps), np.size(speeds)), rows * n))
        result = result.reshape(-1, rows, n)
        for _ in range(doublings):
            result = _double(result, result @ result[:, :n], n, self.inputs)
        return result


def _doublings(length: float, limit: float) -> int:
    mantissa, exponent = math.frexp(length / limit)
    return max(0, exponent - (mantissa == 0.5))


def _double(transition: FloatArray, squared: FloatArray, n: int, m: int) -> FloatArray:
    """The transition over two steps from that over one and its product with its own Phi; inputs stay linear."""
    start, change = slice(n, n + m), slice(n + m, n + 2 * m)
    squared[..., start, :] += transition[..., start, :]
    squared[..., change, :] += transition[..., start, :]
    squared[..., change, :] += transition[..., change, :]
    squared[..., change, :] *= 0.5
    return squared


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """a b with its sums taken in order: numpy's reduction over an axis that is not the last adds row by row."""
    total: FloatArray = np.add.reduce(a[:, :, None] * b[None, :, :], axis=1)
    return total
