"""Where a tire touches the road: points along the patch, each with its share of load, spring and damper.

A load that lies evenly on the patch of half-angle phi_c is cut into P parts, each a patch of its own of phi_c/P around
beta_j. A vertical force on a part has the radial one 1/cos(beta_j) times as large, and what lies across it,
tan(beta_j). Everything here has the same bits on every machine: no sum is NumPy's, and no equations LAPACK's to solve.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .coefficients import coefficients, contact_patch_factor, residual_stiffness
from .contact import belt_numbers
from .elementary import cos_sin
from .unit import TireWheelUnit
from .wheel_matrices import Model

__all__ = ["ContactPoints"]

FloatArray = NDArray[np.float64]


class ContactPoints:
    """P points, each the middle of its part of the patch.

    Parameters
    ----------
    unit : TireWheelUnit
    count : int
        P >= 1. One is the whole patch, with the factors s_n.
    model : {"inextensional", "complete"}
    n_max : int
        Highest belt harmonic, >= 1.

    Attributes
    ----------
    angles : ndarray, shape (P,)
        beta_j from the middle of the patch, along psi [rad].
    cosines, tangents : ndarray, shape (P,)
        Of the angles.
    share : ndarray, shape (P,)
        Of the static load, even pressure: cos(beta_j) over their sum.
    stiffness : ndarray, shape (P,)
        Of the vertical springs, kappa cos^2 beta_j [N/m], kappa such that all of them, on a flat road, give the unit's
        ``vertical_stiffness``; infinite for a rigid tread.
    damping : ndarray, shape (P,)
        Shares of ``residual_damping`` [N s/m].
    numbers : ndarray, shape (N,)
        Wavenumbers of the belt harmonics beside n = 1.
    spread : ndarray, shape (N,)
        s_n(phi_c/P) of them.

    Raises
    ------
    ValueError
        The count is none, or more than one where there is no patch; or ``vertical_stiffness`` is not below the tire's
        own with these points.
    """

    def __init__(self, unit: TireWheelUnit, count: int, model: Model, n_max: int) -> None:
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < 1:
            raise ValueError(f"contact_points is {count!r}; it must be an integer >= 1")
        half = unit.contact_half_angle
        if count > 1 and half == 0.0:
            raise ValueError(f"contact_points is {count!r}; it must be 1 where contact_half_angle is 0.0")
        if half >= 0.5 * math.pi:
            raise ValueError(f"contact_half_angle is {half!r}; it must be < pi/2 on the road")
        self.angles = half * (2.0 * np.arange(count) + 1.0 - count) / count
        self.cosines, sines = cos_sin(self.angles)
        self.tangents = sines / self.cosines
        self.share = self.cosines / _total(self.cosines)
        self.numbers = belt_numbers(model, n_max)
        self.part = unit.replace(contact_half_angle=half / count, vertical_stiffness=0.0)
        self.spread = contact_patch_factor(self.part, self.numbers)
        squares = self.cosines * self.cosines
        relative = squares / _total(squares)
        self.damping = unit.residual_damping * relative
        if count == 1:
            self.stiffness = np.array([residual_stiffness(unit, n_max, model)])
        else:
            compliance = self.compliance(unit, model)
            self.stiffness = relative * _calibrated(compliance, relative, unit.vertical_stiffness)

    def compliance(self, unit: TireWheelUnit, model: Model) -> FloatArray:
        """How far each point gives way under 1 N on each, wheel held, at rest, without the springs [m/N].

        Parameters
        ----------
        unit : TireWheelUnit
        model : {"inextensional", "complete"}

        Returns
        -------
        ndarray, shape (P, P)

        Notes
        -----
        A harmonic gives way by C_n/(m_n (B_n C_n - A_n^2)) cos n(beta_i - beta_j), m_n = pi a b rho h, and n = 0 by
        1/(2 m_n B_0); n = 1 by 1/k_1, or as the complete model's other harmonics do, alike in all directions, up and
        across.
        """
        mass = math.pi * unit.radius * unit.width * unit.surface_density
        apart = np.subtract.outer(self.angles, self.angles)
        across = self.tangents[:, None] * self.tangents
        if model == "complete":
            _, _, C, determinant = coefficients(unit, 1)
            matrix = float(C) / (mass * float(determinant)) * (1.0 + across)
        else:
            matrix = (1.0 + across) / unit.sidewall_stiffness
        both = self.cosines[:, None] * self.cosines
        _, B, C, determinant = coefficients(unit, self.numbers)
        for k, n in enumerate(self.numbers.tolist()):
            factor = float(self.spread[k] * self.spread[k])
            gives = float(C[k]) / (mass * float(determinant[k])) if n else 1.0 / (2.0 * mass * float(B[k]))
            matrix = matrix + (factor * gives) * cos_sin(n * apart)[0] / both
        return matrix


def _total(values: FloatArray) -> float:
    """The sum in order."""
    return float(sum(values.tolist()))


def _carried(compliance: FloatArray) -> float:
    """The force that one displacement of all points, 1 m, leaves on them together: 1 compliance^-1 1 [N].

    By elimination without exchanges, for the matrix is symmetric and positive; a row at a time, whose elements are
    products and differences.
    """
    matrix = np.concatenate([compliance, np.ones((len(compliance), 1))], axis=1)
    total = 0.0
    for k in range(len(matrix)):
        total += float(matrix[k, -1]) * float(matrix[k, -1]) / float(matrix[k, k])
        matrix[k + 1 :] -= matrix[k + 1 :, k : k + 1] / matrix[k, k] * matrix[k]
    return total


def _calibrated(compliance: FloatArray, relative: FloatArray, stiffness: float) -> float:
    """kappa for which springs kappa relative_j behind the compliance carry ``stiffness`` at one displacement of all."""
    if not stiffness:
        return math.inf
    softness = np.diag(1.0 / relative)
    own = _carried(compliance)
    if not own > stiffness:
        raise ValueError(
            f"vertical_stiffness is {stiffness!r}; it must be < {own:.10g} N/m, the tire's own with these points"
        )
    # 1/_carried() grows almost as a line with the springs' softness: the secant's steps shrink fast
    low, high = 0.0, 1.0 / stiffness - 1.0 / own
    miss_low, miss = 1.0 / own - 1.0 / stiffness, 1.0 / _carried(compliance + high * softness) - 1.0 / stiffness
    for _ in range(50):
        if miss == miss_low or abs(miss) <= 1e-15 / stiffness:
            break
        low, high, miss_low = high, high - miss * (high - low) / (miss - miss_low), miss
        miss = 1.0 / _carried(compliance + high * softness) - 1.0 / stiffness
    return 1.0 / high
