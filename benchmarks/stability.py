"""Stability maps against numerically integrated monodromy matrices, and single calls, in one run.

    python benchmarks/stability.py [--points 512] [--sample 40] [--repeats 5] [--json FILE]

The maps: zeta_1 from 0.01 to 0.5, the speed from 60 rpm to where Figures 7(a) and (b) of the paper end, Table 1; with
the boundary. The peer integrates Z' = A(t) Z, Z(0) = 1, over one turn (solve_ivp, DOP853, rtol 1e-9) at points of that
map, evenly spread over the speeds, all columns at once: once with A(t) from wheel.state_matrix, as in step.py, and once
with A(t) = A_0 + A_s sin(Omega t) + A_c cos(Omega t), of which the parts are prepared beforehand. A turn takes the
longer the slower it is, and so does its integration. A difference is that of the spectral radius, relative to the
larger of it and 0.001.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from harness import parser, print_machine, print_table, shown, spread, write_json
from scipy.integrate import solve_ivp

from tire_dynamics import TireWheelUnit, wheel

RPM = math.pi / 30.0
UNIT = TireWheelUnit.table_1()
MAPS: dict[str, tuple[wheel.Model, float]] = {
    "6 states, to 6000 rpm": ("inextensional", 6000.0),
    "to 60 000 rpm": ("inextensional", 60_000.0),
    "10 states, to 6000 rpm": ("complete", 6000.0),
}


def main() -> None:
    options = parser(__doc__.splitlines()[0], repeats=5)
    options.add_argument("--points", type=int, default=512, help="of the map, along each axis (default 512)")
    options.add_argument("--sample", type=int, default=40, help="points to be integrated (default 40)")
    chosen = options.parse_args()
    print_machine()
    N = chosen.points
    figures = {name: measured(*case, N, chosen.sample, chosen.repeats) for name, case in MAPS.items()}
    rows = [
        (f"{N} x {N} map with its boundary [s]", "map_s", ".2f", "<= 5 (6 states)"),
        ("its floor: LAPACK's eigenvalues of as many matrices [s]", "floor_s", ".2f", ""),
        ("points per second", "points_per_second", ".0f", ""),
        ("monodromy integrated, per point [ms]", "integrated_ms", ".2f", ""),
        ("the map against it, per point [x]", "ratio", ".0f", ">= 1000"),
        ("the same with A(t) in prepared parts [ms]", "prepared_ms", ".2f", ""),
        ("the map against it, per point [x]", "prepared_ratio", ".0f", ""),
        ("largest difference of the sample [-]", "difference", ".1e", ""),
        ("wheel.stability, one call [us]", "call_us", ".0f", ""),
        ("wheel.critical_speed, the first time [us]", "critical_us", ".0f", ""),
    ]
    print_table(
        ("", *MAPS, "target"),
        [(label, *(shown(figures[name][key], form) for name in MAPS), goal) for label, key, form, goal in rows],
    )
    print("median (lowest..highest) of the repeats; a repeat's call is the median of many")
    write_json(chosen.json, "stability", figures)


def measured(model: wheel.Model, highest: float, points: int, sample: int, repeats: int) -> dict[str, dict[str, Any]]:
    """All figures of one map; each repeat takes the map and its peer one after the other."""
    x, y = ("zeta_1", np.linspace(0.01, 0.5, points)), ("speed", np.linspace(60.0, highest, points) * RPM)
    columns = np.random.default_rng(1992).integers(0, points, sample)
    rows = np.arange(sample) * points // sample + points // (2 * sample)
    cases = [(UNIT.replace(zeta_1=float(x[1][i])), float(y[1][j])) for i, j in zip(columns, rows, strict=True)]
    found: dict[str, list[float]] = {}
    for _ in range(repeats):
        map_s, grid = timed(lambda: wheel.stability_map(UNIT, x, y, model=model))
        peer_s, integrated = timed(lambda: [spectral_radius(*case, model, prepared=False) for case in cases])
        prepared_s, _ = timed(lambda: [spectral_radius(*case, model, prepared=True) for case in cases])
        radius = grid.spectral_radius[rows, columns]
        calls = [timed(lambda: wheel.stability(UNIT, 200.0, model))[0] for _ in range(1000)]
        first = [timed(lambda: wheel.critical_speed.__wrapped__(UNIT, model))[0] for _ in range(20)]  # not remembered
        figures = {
            "map_s": map_s,
            "floor_s": floor(model, highest, points),
            "points_per_second": points**2 / map_s,
            "integrated_ms": 1e3 * peer_s / sample,
            "ratio": peer_s / sample * points**2 / map_s,
            "prepared_ms": 1e3 * prepared_s / sample,
            "prepared_ratio": prepared_s / sample * points**2 / map_s,
            "difference": float((np.abs(np.array(integrated) - radius) / np.maximum(radius, 1e-3)).max()),
            "call_us": 1e6 * float(np.median(calls)),
            "critical_us": 1e6 * float(np.median(first)),
        }
        for key, value in figures.items():
            found.setdefault(key, []).append(value)
    return {key: spread(values) for key, values in found.items()}


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    begin = time.perf_counter()
    result = work()
    return time.perf_counter() - begin, result


def floor(model: wheel.Model, highest: float, points: int) -> float:
    """Seconds for the eigenvalues of points^2 matrices, and nothing else."""
    block = 8192
    system = wheel.fixed_frame(UNIT, model)
    matrices = system.constant + np.linspace(60.0, highest, block)[:, None, None] * RPM * system.spin
    seconds, _ = timed(lambda: [np.linalg.eigvals(matrices) for _ in range(max(1, points**2 // block))])
    return seconds * max(1.0, points**2 / block) / max(1, points**2 // block)


def spectral_radius(unit: TireWheelUnit, speed: float, model: wheel.Model, *, prepared: bool) -> float:
    """The largest modulus of the multipliers, from the monodromy matrix as solve_ivp integrates it."""
    turn = 2.0 * math.pi / speed
    start, quarter, half = (wheel.state_matrix(unit, speed, part * turn, model) for part in (0.0, 0.25, 0.5))
    constant, cosine = 0.5 * (start + half), 0.5 * (start - half)
    sine = quarter - constant
    n = len(start)

    def slope(t: float, Z: np.ndarray) -> np.ndarray:
        if prepared:
            A = constant + math.sin(speed * t) * sine + math.cos(speed * t) * cosine
        else:
            A = wheel.state_matrix(unit, speed, t, model)
        return (A @ Z.reshape(n, n)).ravel()

    # A velocity is some 500 times its displacement: absolute errors are to be as small beside either.
    size = np.repeat([1.0, 1.0 / 500.0], n // 2)
    atol = 1e-12 * (size[:, None] / size).ravel()
    solution = solve_ivp(slope, (0.0, turn), np.eye(n).ravel(), method="DOP853", rtol=1e-9, atol=atol)
    return float(np.abs(np.linalg.eigvals(solution.y[:, -1].reshape(n, n))).max())


if __name__ == "__main__":
    main()
