"""Roots of a function of one variable between two places where its signs differ."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["root_between"]


def root_between(f: Callable[[float], float], a: float, b: float, f_a: float, f_b: float, tolerance: float) -> float:
    """Where f changes its sign between a and b, by the Illinois method, which keeps the root enclosed.

    Parameters
    ----------
    f : callable
    a, b : float
    f_a, f_b : float
        f there, of different signs; where one is zero, that is the root.
    tolerance : float
        How close to the root, absolute, > 0. What the numbers themselves resolve is enough in any case.

    Returns
    -------
    float
    """
    if f_a == 0.0:
        return a
    while f_b != 0.0 and abs(b - a) > tolerance:
        c = b - f_b * (b - a) / (f_b - f_a)
        if not min(a, b) < c < max(a, b):
            c = 0.5 * (a + b)
            if c in (a, b):
                break
        f_c = f(c)
        if (f_c < 0.0) != (f_b < 0.0):
            a, f_a = b, f_b
        else:
            f_a *= 0.5
        if abs(c - b) < 0.1 * tolerance:  # the root is this close, on one side or the other
            return c
        b, f_b = c, f_c
    return b
