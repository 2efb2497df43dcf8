"""Exact steps of several wheels against scipy.integrate.solve_ivp, on the same input, in one run.

    python benchmarks/step.py [--seconds 0.5] [--repeats 3] [--json FILE]

The input is a load that changes every 1 ms, at a constant speed, from rest. Ours holds it over each step, as the node
does, or has it linear in between (simulate, stepper); each stands beside solve_ivp on an input of the same kind.

solve_ivp integrates the equations in the rotating frame, which are periodic in time: (3.13) for n = 1 and the wheel,
(3.10), (3.11) for n = 2..30, all modes as one system. "restarted" is one call for each step, as somebody must do it
who does not know the next load yet; "one call" knows all loads beforehand, as simulate and a replay's blocks do.
Restarted, no step crosses a jump or a kink of the load.

Errors are at the samples (ours of modes and of blocks: at the last one), relative to the largest value, against the
same equations with rtol 1e-13, restarted: of the wheel's displacement, or of the modes' amplitudes Z_1.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
from harness import parser, print_machine, print_table, shown, spread, write_json
from scipy.integrate import solve_ivp

from tire_dynamics import TireWheelUnit, simulate
from tire_dynamics.estimator.belt import BeltShape, belt_numbers, ring_angles
from tire_dynamics.estimator.motion import Motion
from tire_dynamics.estimator.schedule import Plan, Stretch
from tire_dynamics.estimator.wheel_estimator import WheelEstimator
from tire_dynamics.science import coefficients, kernels, wheel

RATE = 1000  # [Hz]
PERIOD = 10**9 // RATE  # [ns]
SPEED = 150.0  # [rad/s], 165 km/h on the tire of Table 1
UNIT = TireWheelUnit.table_1()
N_MAX = 30
RING_SAMPLES = 72
WHEELS = (1, 4, 16, 64, 256)
PEERS = {
    f"{method}, rtol 1e-9, {'restarted' if restart else 'one call'}": (method, 1e-9, restart)
    for method in ("DOP853", "LSODA")
    for restart in (False, True)
}
KERNELS: dict[str, ModuleType] = {"NumPy": kernels}
try:
    from tire_dynamics.science import compiled

    KERNELS["compiled"] = compiled
except ImportError:
    print("numba is not installed: no compiled kernels")

Result = np.ndarray | Callable[[], np.ndarray] | None  # at all samples, or at the last; if callable, it takes no time
Work = Callable[[], Result]
Case = Callable[[], Work]  # what comes before the first step is not measured


def main() -> None:
    options = parser(__doc__.splitlines()[0], repeats=3)
    options.add_argument("--seconds", type=float, default=0.5, help="of driving for n = 1 (default 0.5)")
    chosen = options.parse_args()
    print_machine()
    t = np.arange(round(chosen.seconds * RATE) + 1) / RATE
    load = 3500.0 + 400.0 * np.random.default_rng(1992).standard_normal(t.size)
    figures = {
        "held": against_peers(held_cases(t, load), periodic(t, load, held=True), t.size - 1, chosen.repeats),
        "linear": against_peers(linear_cases(t, load), periodic(t, load, held=False), t.size - 1, chosen.repeats),
    }
    fewer = slice(t.size // 5 + 1)  # for the peers' sake
    reference = modes(t[fewer], load[fewer])
    figures["modes"] = against_peers(mode_cases(t[fewer], load[fewer]), reference, t[fewer].size - 1, chosen.repeats)
    titles = {
        "held": "n = 1 and wheel, load held",
        "linear": "n = 1 and wheel, load linear",
        "modes": "modes 2..30, load held *",
    }
    for key, title in titles.items():
        print_peers(title, figures[key])
    figures["wheels"] = several_wheels(load, chosen.repeats)
    print_wheels(figures["wheels"])
    figures["varying"] = varying_tire(chosen.repeats)
    print_varying(figures["varying"])
    write_json(chosen.json, "step", figures)


# -- one wheel against its peers --------------------------------------------------------------------------------


def against_peers(cases: dict[str, Case], reference: np.ndarray, steps: int, repeats: int) -> dict[str, Any]:
    """Cost [us] of a step and error of each case; each repeat takes all cases one after the other."""
    cost: dict[str, list[float]] = {name: [] for name in cases}
    error: dict[str, float | None] = {}
    for repeat in range(-1, repeats):  # the first compiles and fills caches
        for name, case in cases.items():
            if repeat < 0 and name in PEERS:
                continue
            seconds, result = timed(case())
            if repeat >= 0:
                cost[name].append(1e6 * seconds / steps)
                error[name] = error_of(result, reference)
    rows = {}
    for name, values in cost.items():
        rows[name] = {"us": spread(values), "error": error[name]}
        for restart, key in ((False, "one_call"), (True, "restarted")):
            peer = cost[next(p for p, method in PEERS.items() if method == ("DOP853", 1e-9, restart))]
            rows[name][f"ratio_{key}"] = spread(a / b for a, b in zip(peer, values, strict=True))
    return rows


def error_of(result: np.ndarray | None, reference: np.ndarray) -> float | None:
    if result is None:
        return None
    return float(np.abs(result - reference[-len(result) :]).max() / np.abs(reference).max())


def print_peers(title: str, rows: dict[str, Any]) -> None:
    table = [
        (
            name,
            shown(row["us"]),
            shown(row["ratio_one_call"], ".1f"),
            shown(row["ratio_restarted"], ".1f"),
            "" if row["error"] is None else f"{row['error']:.1e}",
        )
        for name, row in rows.items()
    ]
    print()
    print_table((title, "us/step", "x one call", "x restarted", "error"), table)


def held_cases(t: np.ndarray, load: np.ndarray) -> dict[str, Case]:
    """n = 1 and wheel, the load held over each step."""
    cases: dict[str, Case] = {
        name: lambda how=how: partial(periodic, t, load, True, *how) for name, how in PEERS.items()
    }
    for name, module in KERNELS.items():
        cases[f"ours step by step, {name}"] = partial(followed, load, module)
        cases[f"ours in one block, {name}"] = partial(in_one_block, load, module)
    cases["estimator, sample and tick at 1 kHz **"] = partial(live, load)
    return cases


def linear_cases(t: np.ndarray, load: np.ndarray) -> dict[str, Case]:
    """n = 1 and wheel, the load linear between samples."""
    cases: dict[str, Case] = {
        name: lambda how=how: partial(periodic, t, load, False, *how) for name, how in PEERS.items()
    }
    cases["simulate: all steps known beforehand"] = lambda: (
        lambda: simulate(UNIT, t, SPEED, load, initial="rest").wheel_displacement
    )
    cases["stepper: step by step"] = partial(one_by_one, load)
    return cases


def mode_cases(t: np.ndarray, load: np.ndarray) -> dict[str, Case]:
    """Modes 2..30, asked for after each step."""
    cases: dict[str, Case] = {name: lambda how=how: partial(modes, t, load, *how) for name, how in PEERS.items()}
    for name, module in KERNELS.items():
        cases[f"ours step by step, {name}"] = partial(followed_modes, load, module)
        cases[f"ours in one block, {name}"] = partial(in_one_block, load, module, shown=True)
    return cases


def timed(work: Work) -> tuple[float, np.ndarray | None]:
    begin = time.perf_counter()
    result = work()
    seconds = time.perf_counter() - begin
    return seconds, result() if callable(result) else result


# -- the peers --------------------------------------------------------------------------------------------------


def periodic(
    t: np.ndarray, load: np.ndarray, held: bool, method: str = "DOP853", rtol: float = 1e-13, restart: bool = True
) -> np.ndarray:
    """The wheel's displacement from (3.13)."""
    m = UNIT.ring_mass

    def slope(time_: float, z: np.ndarray, force: float | None) -> np.ndarray:
        if force is None:
            force = load[min(int(time_ * RATE), t.size - 1)] if held else np.interp(time_, t, load)
        dz = wheel.state_matrix(UNIT, SPEED, time_) @ z
        dz[0] += force / m * math.sin(SPEED * time_)  # (4.6)
        dz[1] += force / m * math.cos(SPEED * time_)
        return dz

    return integrated(slope, t, load if held else None, np.zeros(6), method, rtol, restart)[:, 5]


def modes(
    t: np.ndarray, load: np.ndarray, method: str = "DOP853", rtol: float = 1e-13, restart: bool = True
) -> np.ndarray:
    """Z_1 of n = 2..30 from (3.10), (3.11), as w = alpha + i beta; shape (N, 29)."""
    n = np.arange(2, N_MAX + 1)
    A, _, C, determinant = coefficients.coefficients(UNIT, n, SPEED)
    through = A + n * C
    velocity = coefficients.mode_damping(UNIT, n) + 2j * SPEED * (C + n * A) / through
    stiffness = n * determinant / through
    mass = math.pi * UNIT.radius * UNIT.width * UNIT.thickness * UNIT.density
    drive = -n * C / through / mass * np.exp(1.5j * math.pi * n)  # f_r = -F at psi_0 = 3 pi/2 (4.1)

    def slope(time_: float, z: np.ndarray, force: float | None) -> np.ndarray:
        if force is None:
            force = load[min(int(time_ * RATE), t.size - 1)]
        speed, place = z.view(np.complex128).reshape(2, -1)
        push = force * drive * np.exp(-1j * SPEED * time_ * n)
        return np.concatenate([push - velocity * speed - stiffness * place, speed]).view(np.float64)

    z = integrated(slope, t, load, np.zeros(4 * n.size), method, rtol, restart)
    rotating = np.ascontiguousarray(z[:, 2 * n.size :]).view(np.complex128)
    return rotating * np.exp(1j * SPEED * np.outer(t, n))


def integrated(
    slope: Callable[..., np.ndarray],
    t: np.ndarray,
    held: np.ndarray | None,
    start: np.ndarray,
    method: str,
    rtol: float,
    restart: bool,
) -> np.ndarray:
    """The states at all samples, (N, n)."""
    options: dict[str, Any] = {"method": method, "rtol": rtol, "atol": 1e-3 * rtol}
    if not restart:
        return solve_ivp(slope, (t[0], t[-1]), start, t_eval=t, args=(None,), **options).y.T
    states = [start]
    for k, (begin, end) in enumerate(zip(t[:-1], t[1:], strict=True)):
        force = None if held is None else held[k]
        states.append(solve_ivp(slope, (begin, end), states[-1], args=(force,), **options).y[:, -1])
    return np.array(states)


# -- ours -------------------------------------------------------------------------------------------------------


def motion(wheels: int, module: ModuleType) -> Motion:
    return Motion(UNIT, "inextensional", N_MAX, wheels, module)


def belt_shape() -> BeltShape:
    return BeltShape(ring_angles(RING_SAMPLES), belt_numbers(N_MAX, "inextensional"))


def plan(force: float) -> Plan:
    return Plan(None, [(PERIOD, SPEED, force, 0.0)], [math.nan])


def followed(load: np.ndarray, module: ModuleType) -> Work:
    """What the node calls at each tick for the forces; the belt's steps are noted, and not taken."""
    ours, forces = motion(1, module), load[:-1].tolist()

    def work() -> np.ndarray:
        y = [0.0]
        for force in forces:
            ours.follow([plan(force)])
            y.append(ours.state[0, 5])
        return np.array(y)

    return work


def followed_modes(load: np.ndarray, module: ModuleType) -> Work:
    """The same, with what the node calls for the belt's shape at each tick."""
    ours, shape, forces = motion(1, module), belt_shape(), load[:-1].tolist()

    def work() -> Callable[[], np.ndarray]:
        for force in forces:
            ours.follow([plan(force)])
            ours.deflections([0], shape)
        return partial(amplitudes, ours)

    return work


def in_one_block(load: np.ndarray, module: ModuleType, shown: bool = False) -> Work:
    """What the replay calls: all steps in one go; the belt is taken along where it is shown, at all ticks then."""
    steps = load.size - 1
    speed, force = np.full(steps, SPEED), np.stack([load[:-1], np.zeros(steps)], axis=1)
    none = np.full(steps, math.nan)
    stretch = Stretch(np.full(steps, PERIOD), speed, force, none, np.arange(1, steps + 1), speed)
    ours, shape = motion(1, module), belt_shape()
    at = {0: np.arange(steps if shown else 0)}

    def work() -> Callable[[], np.ndarray]:
        ours.follow_stretches({0: stretch}, steps, at, shape)
        return partial(amplitudes, ours) if shown else lambda: ours.state[:, 5]

    return work


def amplitudes(ours: Motion) -> np.ndarray:
    """Z_1 of n = 2..30 as it is now, (1, 29)."""
    real, imaginary = ours.belt.amplitudes([0])[:, :, 0]
    return real + 1j * imaginary


def one_by_one(load: np.ndarray) -> Work:
    def work() -> np.ndarray:
        stepper = wheel.stepper(UNIT).at(SPEED)
        z = np.zeros(10)
        y = [0.0]
        for k in range(load.size - 1):
            z[6], z[8] = load[k], load[k + 1] - load[k]
            z[:6] = stepper.step(1.0 / RATE, z)
            y.append(z[5])
        return np.array(y)

    return work


def live(load: np.ndarray) -> Work:
    """A whole estimator: each sample waits for its stamp's turn and falls between two ticks, which makes two steps."""
    estimator, forces = WheelEstimator(UNIT), load[:-1].tolist()
    estimator.add_speed(0, SPEED)

    def work() -> None:
        for k, force in enumerate(forces):
            estimator.add_load(k * PERIOD + 300_000 + 7 * (k % 100), force)
            estimator.advance((k + 1) * PERIOD)
            _ = estimator.axle_force

    return work


# -- several wheels ---------------------------------------------------------------------------------------------


def several_wheels(load: np.ndarray, repeats: int) -> dict[str, Any]:
    """us per step and wheel, step by step, by kernels, modes and number of wheels; and 64 wheels' against one's."""
    cases = [(name, shown_modes, W) for name in KERNELS for shown_modes in (False, True) for W in WHEELS]
    cost: dict[tuple[str, bool, int], list[float]] = {case: [] for case in cases}
    for _ in range(repeats):
        for name, shown_modes, W in cases:
            cost[name, shown_modes, W].append(cost_of_wheels(load, KERNELS[name], shown_modes, W))
    found: dict[str, Any] = {}
    for name in KERNELS:
        for shown_modes in (False, True):
            key = f"{name}, {'with modes 2..30' if shown_modes else 'n = 1 and wheel'}"
            one, many = cost[name, shown_modes, 1], cost[name, shown_modes, 64]
            found[key] = {str(W): spread(cost[name, shown_modes, W]) for W in WHEELS}
            found[key]["64_against_1"] = spread(b / a for a, b in zip(one, many, strict=True))
    return found


def cost_of_wheels(load: np.ndarray, module: ModuleType, shown_modes: bool, wheels: int) -> float:
    """us per step and wheel."""
    ours, shape, everyone = motion(wheels, module), belt_shape(), list(range(wheels))
    plans = [[plan(force)] * wheels for force in cycled(load, 10 + max(40, 1000 // wheels))]
    begin = 0.0
    for k, each in enumerate(plans):
        if k == 10:
            begin = time.perf_counter()
        ours.follow(each)
        if shown_modes:
            ours.deflections(everyone, shape)
    cost = time.perf_counter() - begin
    if not (ours.state == ours.state[0]).all():
        raise SystemExit(f"{wheels} wheels of one input are not alike")
    return 1e6 * cost / (wheels * (len(plans) - 10))


# -- a tire that is not the same all around ---------------------------------------------------------------------


def varying_tire(repeats: int) -> dict[str, Any]:
    """us per tick of four wheels at 500 Hz, forces read: the uniform tire, and one of each kind, in turn."""
    sidewall = {"radial_nonuniformity": [(2, 0.1, 0.4)], "tangential_nonuniformity": [(2, 0.05, 1.0)]}
    forces = {"imbalance_mass": 0.05, "radial_runout": [(1, 5e-4, 0.3), (10, 1e-4, 1.0)]}
    tires = {
        "uniform": UNIT,
        "sidewall": UNIT.replace(**sidewall),
        "imbalance, run-out to the tenth": UNIT.replace(**forces),
        "all of it": UNIT.replace(**sidewall, **forces),
    }
    cost: dict[str, list[float]] = {f"{tire}, {name}": [] for name in KERNELS for tire in tires}
    for repeat in range(-1, repeats):
        for name, module in KERNELS.items():
            for tire, unit in tires.items():
                ours = Motion(unit, "inextensional", N_MAX, 4, module)
                steps = [(2 * PERIOD, SPEED + 0.01 * k, 3500.0 + k, 0.0) for k in range(300)]
                ticks = [[Plan(None, [step], [0.1 * k])] * 4 for k, step in enumerate(steps)]
                begin = time.perf_counter()
                for k, plans in enumerate(ticks):
                    ours.follow(plans)
                    ours.read([SPEED + 0.01 * k] * 4)
                if repeat >= 0:
                    cost[f"{tire}, {name}"].append(1e6 * (time.perf_counter() - begin) / len(ticks))
    found = {}
    for name in KERNELS:
        for tire in tires:
            values, base = cost[f"{tire}, {name}"], cost[f"uniform, {name}"]
            ratio = spread(a / b for a, b in zip(values, base, strict=True))
            found[f"{tire}, {name}"] = {"us": spread(values), "against_uniform": ratio}
    return found


def print_varying(figures: dict[str, Any]) -> None:
    rows = [
        (name, shown(row["us"]), shown(row["against_uniform"], ".2f"), f"{row['us']['median'] / 20.0:.1f} %")
        for name, row in figures.items()
    ]
    print()
    print_table(("four wheels, speed changes at each tick", "us per tick", "x uniform", "of 2 ms"), rows)


def cycled(load: np.ndarray, count: int) -> Iterator[float]:
    return (float(load[k % load.size]) for k in range(count))


def print_wheels(figures: dict[str, Any]) -> None:
    rows = [
        (name, *(shown(row[str(W)]) for W in WHEELS), f"1/{1.0 / row['64_against_1']['median']:.1f}")
        for name, row in figures.items()
    ]
    print()
    print_table(("us per step and wheel", *(f"{W} wheel{'s' * (W > 1)}" for W in WHEELS), "64 : 1"), rows)
    print("target for 64 : 1 with modes: 1/8. Step by step, the result asked for after each.")
    print("*  ours have n = 1 and the wheel as well, and put out the belt's shape at 72 points after each step")
    print("** with the belt's modes noted, not taken; a sample falls between two ticks: two steps")


if __name__ == "__main__":
    main()
