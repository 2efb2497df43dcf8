"""Stability and transmissibility over two fields of the unit, or over one and the speed.

A map is computed point by point, and a point's numbers do not depend on which others are computed with it: blocks of
points may go anywhere, and the map has the same bits.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import contact as road
from .floquet import VERDICTS, constant_verdicts
from .nonuniform_matrices import is_irreducibly_periodic
from .response import transmissibility
from .unit import NUMBERS, ROAD, TireWheelUnit
from .wheel_matrices import Model, fixed_frame, stacked_frames
from .wheel_stability import crossings

__all__ = ["AXES", "ROAD_AXES", "StabilityMap", "TransmissibilityMap", "stability_map", "transmissibility_map"]

FloatArray = NDArray[np.float64]
Over = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
Axis = tuple[str, ArrayLike]

AXES: Final = (
    *NUMBERS,
    "speed",
)
ROAD_AXES: Final = (*AXES, *ROAD)  # of maps of stability on the road
UNSTABLE: Final = VERDICTS.index("unstable")
ROAD_BLOCK: Final = 16  # points on the road, a second of work about
BLOCK: Final = 8192  # points that are computed together: some 10 MB
LINES: Final = 32  # lines along the speed whose crossings are found together
CLEAR: Final = 1e-6  # of the largest exponent: as far from the axis as this one is on its side
SHARP: Final = 1e-6  # of a crossing's coordinate; the verdict itself knows it to 1e-10, about


@dataclass(frozen=True, slots=True, eq=False)
class StabilityMap:
    """Stability on a grid. SI units; "speed" is in rad/s.

    Attributes
    ----------
    x_name, y_name : str
        Of the two axes, from ``AXES``.
    x, y : ndarray, shapes (nx,) and (ny,)
    abscissa : ndarray, shape (ny, nx)
        The largest real part of the exponents [1/s]: how fast the slowest motion decays (< 0) or grows.
    spectral_radius : ndarray, shape (ny, nx)
        The largest modulus of the multipliers, which belong to one turn. NaN at standstill, where there is no turn;
        infinite where it is beyond what double precision holds.
    verdict : ndarray of int8, shape (ny, nx)
        Index into ``floquet.VERDICTS``, the verdict of :func:`.wheel.stability`.
    boundary : ndarray, shape (K, 2)
        Points (x, y) on lines of the grid where "unstable" begins or ends, to 1e-6 of the coordinate that runs
        along the line. Along the speed every such point is there, along a field one between any two neighbours of
        which one alone is unstable.
    segments : ndarray of int, shape (S, 2)
        Pairs of rows of ``boundary`` which a cell of the grid joins; drawn as lines they are the boundary.
    """

    x_name: str
    y_name: str
    x: FloatArray
    y: FloatArray
    abscissa: FloatArray
    spectral_radius: FloatArray
    verdict: NDArray[np.int8]
    boundary: FloatArray
    segments: NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class TransmissibilityMap:
    """Transmissibility on a grid: ``transmissibility`` (ny, nx), the rest as in :class:`StabilityMap`."""

    x_name: str
    y_name: str
    x: FloatArray
    y: FloatArray
    transmissibility: FloatArray


def stability_map(
    unit: TireWheelUnit,
    x: Axis,
    y: Axis,
    *,
    speed: float | None = None,
    model: Model = "inextensional",
    contact: bool = False,
    n_max: int = 30,
    over: Over = map,
) -> StabilityMap:
    """Floquet stability over two fields, or over one and the speed.

    Parameters
    ----------
    unit : TireWheelUnit
        What it has in other fields is held fixed.
    x, y : tuple of str and array_like
        Name and values of an axis: a field of numbers of the unit, or "speed" [rad/s], either sign. Values increase.
    speed : float
        Spin Omega [rad/s], where no axis is the speed.
    model : {"inextensional", "complete"}
    contact : bool
        On the road, without lift-off. A point then takes some 5 ms, and the boundary is found between points alone.
    n_max : int
        Highest belt harmonic on the road.
    over : callable
        Like the built-in ``map``, and may be an executor's: spreads the work, and does not change a bit.

    Returns
    -------
    StabilityMap

    Raises
    ------
    ValueError
        An axis is unknown, its values do not increase, or a value is out of its field's bounds: the message has the
        field, the value and the bound.

    Examples
    --------
    >>> unit = TireWheelUnit.table_1()
    >>> grid = stability_map(unit, ("zeta_1", [0.05, 0.5]), ("speed", [100.0, 1000.0]))
    >>> [[VERDICTS[code] for code in row] for row in grid.verdict]  # doctest: +NORMALIZE_WHITESPACE
    [['asymptotically stable', 'asymptotically stable'], ['asymptotically stable', 'unstable']]
    """
    fixed_frame(unit, model)  # says what is wrong with the model
    if is_irreducibly_periodic(unit, model) or contact and road.is_varying(unit):
        raise ValueError("the unit's sidewall is not uniform; it can be mapped over nonuniformity and the speed")
    grid = _grid(unit, x, y, speed, model, int(n_max) if contact else 0)
    nx, ny = grid.x.size, grid.y.size
    starts = range(0, nx * ny, ROAD_BLOCK if grid.n_max else BLOCK)
    abscissa, verdict = (
        np.concatenate(parts).reshape(ny, nx) for parts in zip(*over(partial(_block, grid), starts), strict=True)
    )
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        turns_per_second = np.broadcast_to(np.abs(_speeds(grid)), (ny, nx)) / (2.0 * math.pi)
        radius = np.where(turns_per_second > 1e-300, np.exp(abscissa / turns_per_second), math.nan)
    boundary, segments = _boundary(grid, abscissa, verdict == UNSTABLE, over)
    return StabilityMap(grid.x_name, grid.y_name, grid.x, grid.y, abscissa, radius, verdict, boundary, segments)


def transmissibility_map(unit: TireWheelUnit, x: Axis, y: Axis, *, speed: float | None = None) -> TransmissibilityMap:
    """:func:`.response.transmissibility` over two fields, or one and the speed; arguments as of `stability_map`."""
    grid = _grid(unit, x, y, speed, "inextensional")
    units = _Units(unit, **_fields(grid, grid.x, grid.y[:, None]))
    K = np.broadcast_to(transmissibility(units, _speeds(grid)), (grid.y.size, grid.x.size))
    return TransmissibilityMap(grid.x_name, grid.y_name, grid.x, grid.y, K.copy())


@dataclass(frozen=True, slots=True)
class _Grid:
    unit: TireWheelUnit
    x_name: str
    y_name: str
    x: FloatArray
    y: FloatArray
    speed: float | None
    model: Model
    n_max: int = 0  # of a tire on the road; 0: under a given load


class _Units(TireWheelUnit):
    """Many units as one whose fields may be arrays. Not validated: the corners of the grid are."""

    def __init__(self, unit: TireWheelUnit, **arrays: FloatArray) -> None:
        for name, value in {**unit.to_mapping(), **arrays}.items():
            object.__setattr__(self, name, value)

    def _sqrt(self, number: Any) -> Any:
        return np.sqrt(number)

    @property
    def is_longitudinally_rigid(self) -> bool:
        return not np.any(self.longitudinal_stiffness)  # all or none: the corners are looked at


def _grid(unit: TireWheelUnit, x: Axis, y: Axis, speed: float | None, model: Model, n_max: int = 0) -> _Grid:
    (x_name, x_values), (y_name, y_values) = (
        (name, _increasing(name, values, ROAD_AXES if n_max else AXES)) for name, values in (x, y)
    )
    if x_name == y_name:
        raise ValueError(f"both axes are {x_name!r}; they must be two")
    if "speed" in (x_name, y_name):
        if speed is not None:
            raise ValueError(f"speed is {speed!r}; it must not be given beside an axis that is the speed")
    elif speed is None:
        raise ValueError("speed is missing; it must be given, or be one of the axes")
    elif not math.isfinite(speed):
        raise ValueError(f"speed is {speed!r}; it must be finite")
    grid = _Grid(unit, x_name, y_name, x_values, y_values, speed, model, n_max)
    corners = ((i, j) for i in (0, -1) for j in (0, -1))  # bounds are intervals: what holds here holds between
    units = [unit.replace(**_fields(grid, float(x_values[i]), float(y_values[j]))) for i, j in corners]
    if len({each.is_longitudinally_rigid for each in units}) > 1:
        raise ValueError("longitudinal_stiffness is 0.0, which holds the wheel, beside others; it must be > 0")
    return grid


def _increasing(name: str, values: ArrayLike, axes: tuple[str, ...]) -> FloatArray:
    if name not in axes:
        where = " on the road alone, with contact" if name in ROAD_AXES else ""
        raise ValueError(f"{name!r} can{'' if where else 'not'} be an axis{where}; the axes are {', '.join(axes)}")
    array = np.array(values, dtype=np.float64)
    if array.ndim != 1 or not array.size:
        raise ValueError(f"{name} has values of shape {array.shape}; it must be (n,) with n >= 1")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} is {array[~np.isfinite(array)][0]}; it must be finite")
    if (np.diff(array) <= 0.0).any():
        before = int(np.argmax(np.diff(array) <= 0.0))
        raise ValueError(f"{name} is {array[before]} and then {array[before + 1]}; its values must increase")
    return array


def _fields(grid: _Grid, x: Any, y: Any) -> dict[str, Any]:
    """The unit's fields at x and y."""
    return {name: value for name, value in ((grid.x_name, x), (grid.y_name, y)) if name != "speed"}


def _speeds(grid: _Grid) -> FloatArray:
    """The speed of every point of the grid, in a shape to be broadcast to (ny, nx)."""
    if grid.y_name == "speed":
        return grid.y[:, None]
    return grid.x if grid.x_name == "speed" else np.array(grid.speed)


def _block(grid: _Grid, start: int) -> tuple[FloatArray, NDArray[np.int8]]:
    """Spectral abscissa and verdict at the points with number ``start`` and the next, counted along the rows."""
    points = np.arange(start, min(start + (ROAD_BLOCK if grid.n_max else BLOCK), grid.x.size * grid.y.size))
    rows, columns = np.divmod(points, grid.x.size)
    return _judge(grid, grid.x[columns], grid.y[rows])


def _judge(grid: _Grid, x: FloatArray, y: FloatArray) -> tuple[FloatArray, NDArray[np.int8]]:
    """Spectral abscissa [1/s] and verdict at N points (x, y)."""
    if grid.n_max:
        return _judge_on_the_road(grid, x, y)
    speed = y if grid.y_name == "speed" else x if grid.x_name == "speed" else np.array(grid.speed)
    system = stacked_frames(_Units(grid.unit, **_fields(grid, x, y)), x.shape, grid.model)
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is not accepted
        F = system.constant + speed[..., None, None] * system.spin
    half = F.shape[1] // 2
    sizes = np.ones(F.shape[:2])  # a velocity's; a displacement's is one over the highest frequency, about
    sizes[:, half:] = np.ldexp(1.0, -np.frexp(np.sqrt(np.abs(F[:, :half, half:]).max(axis=(1, 2))))[1])[:, None]
    exponents, verdict = constant_verdicts(F, sizes)
    return exponents.real.max(axis=1), verdict


def _judge_on_the_road(grid: _Grid, x: FloatArray, y: FloatArray) -> tuple[FloatArray, NDArray[np.int8]]:
    """The same, a point at a time.

    Where no exponent is near the axis, eigenvalues alone tell: rounding would need a condition number of 1e9 to get
    there. Elsewhere :func:`.contact.stability` does, in four times the time.
    """
    abscissa, verdict = np.empty(x.size), np.empty(x.size, dtype=np.int8)
    for k, (a, b) in enumerate(zip(x.tolist(), y.tolist(), strict=True)):
        unit = grid.unit.replace(**_fields(grid, a, b))
        speed = b if grid.y_name == "speed" else a if grid.x_name == "speed" else grid.speed
        assert speed is not None
        exponents = np.linalg.eigvals(road.open_system(unit.mean, speed, grid.model, grid.n_max).closed())
        if np.abs(exponents.real).min() > CLEAR * np.abs(exponents).max():
            abscissa[k] = exponents.real.max()
            verdict[k] = UNSTABLE if abscissa[k] > 0.0 else 0
            continue
        found = road.stability(unit, speed, grid.model, grid.n_max, turn=False)
        abscissa[k], verdict[k] = found.exponents.real.max(), VERDICTS.index(found.verdict)
    return abscissa, verdict


# -- the boundary -------------------------------------------------------------------------------------------------


def _boundary(
    grid: _Grid, abscissa: FloatArray, unstable: NDArray[np.bool_], over: Over
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Points on lines of the grid, those along x first, and the pairs of them that a cell joins."""
    along_x, on_x = _crossings(grid, unstable, over)
    flipped = dataclasses.replace(grid, x_name=grid.y_name, y_name=grid.x_name, x=grid.y, y=grid.x)
    along_y, on_y = _crossings(flipped, unstable.T, over)
    boundary = np.concatenate([along_x, along_y[:, ::-1]])
    across = np.where(on_y.T < 0, -1, on_y.T + len(along_x))
    # edges of a cell, in turn: below, right, above, left
    edges = np.stack([on_x[:-1], across[:, 1:], on_x[1:], across[:, :-1]], axis=-1)
    crossed = (edges >= 0).sum(axis=-1)
    two = edges[crossed == 2]
    four = edges[crossed == 4]
    # Two opposite corners are unstable: whether they are joined, the middle says.
    middle = 0.25 * (abscissa[:-1, :-1] + abscissa[1:, :-1] + abscissa[:-1, 1:] + abscissa[1:, 1:])[crossed == 4]
    joined = (middle > 0.0) == unstable[:-1, :-1][crossed == 4]
    pairs = np.where(joined[:, None], four, np.roll(four, 1, axis=1))
    return boundary, np.concatenate([two[two >= 0].reshape(-1, 2), pairs.reshape(-1, 2)])


def _crossings(grid: _Grid, unstable: NDArray[np.bool_], over: Over) -> tuple[FloatArray, NDArray[np.intp]]:
    """Crossings (K, 2) of the boundary with the lines along x; which of them is on which edge, (ny, nx - 1), or -1."""
    number = np.full((grid.y.size, max(grid.x.size - 1, 0)), -1)
    changes = unstable[:, 1:] != unstable[:, :-1]
    found = np.zeros((0, 2))
    if grid.x_name == "speed" and not grid.n_max:
        starts = range(0, grid.y.size, LINES)
        parts = list(over(partial(_along_speed, grid), starts))
        points, rows = (np.concatenate(part) for part in zip(*parts, strict=True))
        columns = np.searchsorted(grid.x, points[:, 0]) - 1
        inside = (columns >= 0) & (columns < grid.x.size - 1)
        found, rows, columns = points[inside], rows[inside], columns[inside]
        number[rows[::-1], columns[::-1]] = np.arange(len(found))[::-1]  # of several, the first
        number[~changes] = -1
    rows, columns = np.nonzero(changes & (number < 0))
    low, high, y = grid.x[columns], grid.x[columns + 1], grid.y[rows]
    below = unstable[rows, columns]
    wide = np.arange(low.size)
    if grid.n_max:  # where the abscissa changes its sign, in a third of the points that halving takes
        for k in wide.tolist():
            low[k], high[k] = _zero(grid, float(low[k]), float(high[k]), float(y[k]))
    while wide.size:
        middle = 0.5 * (low[wide] + high[wide])
        same = (_judge(grid, middle, y[wide])[1] == UNSTABLE) == below[wide]
        low[wide] = np.where(same, middle, low[wide])
        high[wide] = np.where(same, high[wide], middle)
        middle = 0.5 * (low[wide] + high[wide])
        sharp = high[wide] - low[wide] <= SHARP * np.maximum(np.abs(low[wide]), np.abs(high[wide]))
        wide = wide[~sharp & (low[wide] < middle) & (middle < high[wide])]
    number[rows, columns] = len(found) + np.arange(low.size)
    return np.concatenate([found, np.stack([0.5 * (low + high), y], axis=1)]), number


def _zero(grid: _Grid, low: float, high: float, y: float) -> tuple[float, float]:
    """Twice where the abscissa is zero between two points of a line along x; the two, if it changes no sign."""
    from scipy.optimize import brentq

    def abscissa(x: float) -> float:
        return float(_judge_on_the_road(grid, np.array([x]), np.array([y]))[0][0])

    if not abscissa(low) * abscissa(high) < 0.0:
        return low, high
    sharp = SHARP * max(abs(low), abs(high))
    return (float(brentq(abscissa, low, high, xtol=0.5 * sharp, rtol=1e-15 * 8)),) * 2


def _along_speed(grid: _Grid, start: int) -> tuple[FloatArray, NDArray[np.intp]]:
    """All crossings of the lines along x, the speed, from line ``start`` on: points (K, 2) and the line of each."""
    points, rows = [], []
    for row in range(start, min(start + LINES, grid.y.size)):
        value = float(grid.y[row])
        speeds = [speed for speed, _ in crossings(grid.unit.replace(**_fields(grid, None, value)), grid.model)]
        speeds = sorted([-speed for speed in speeds] + speeds)  # they are the same backward
        points += [(speed, value) for speed in speeds]
        rows += [row] * len(speeds)
    return np.array(points).reshape(-1, 2), np.array(rows, dtype=np.intp)
