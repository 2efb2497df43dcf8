"""Exact steps of several wheels against scipy.integrate.solve_ivp, on the same input, in one run.

    python benchmarks/step.py [--seconds 0.5] [--repeats 3] [--json FILE]

The input is a load that changes every 1 ms, at a constant speed, from rest. Ours holds it over each step, as the node
does, or has it linear in between (simulate); each stands beside solve_ivp on an input of the same kind.

solve_ivp integrates the equations in the rotating frame, which are periodic in time: (3.13) for n = 1 and the wheel,
(3.10), (3.11) for n = 2..30, all modes as one system. "restarted" is one call for each step, as somebody must do it
who does not know the next load yet; "one call" knows all loads beforehand, as simulate does. Restarted, no step
crosses a jump or a kink of the load.

Errors are at the samples (ours of modes: at the last one), relative to the largest value, against the same equations
with rtol 1e-13, restarted: of the wheel's displacement, or of the modes' amplitudes Z_1.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from harness import parser, print_machine, print_table, shown, spread, write_json
from scipy.integrate import solve_ivp

from tire_dynamics import TireWheelUnit, simulate
from tire_dynamics.estimator.belt import BeltMotion, ring_angles
from tire_dynamics.estimator.motion import Motion
from tire_dynamics.estimator.settings import VehicleSettings
from tire_dynamics.estimator.wheel_estimator import WheelEstimator
from tire_dynamics.estimator.wheels import Wheels
from tire_dynamics.science import coefficients, wheel

RATE = 1000  # [Hz]
PERIOD = 10**9 // RATE  # [ns]
SPEED = 150.0  # [rad/s], 165 km/h on the tire of Table 1
CHANGE = 300.0  # [rad/s^2], of the speed that changes
UNIT = TireWheelUnit.table_1()
SIDEWALL = {"radial_nonuniformity": [(2, 0.1, 0.4)], "tangential_nonuniformity": [(2, 0.05, 1.0)]}
FORCES = {"imbalance_mass": 0.05, "radial_runout": [(1, 5e-4, 0.3), (10, 1e-4, 1.0)]}
N_MAX = 30
RING_SAMPLES = 72
WHEELS = (1, 4, 16, 64, 256)
STEP_TARGET, CHANGE_TARGET = 300.0, 2.0
PEERS = {
    f"{method}, rtol 1e-9, {'restarted' if restart else 'one call'}": (method, 1e-9, restart)
    for method in ("DOP853", "LSODA")
    for restart in (False, True)
}

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
    figures["speeds"] = changing_speed(load, chosen.repeats)
    print_speeds(figures["speeds"])
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
    cases["ours, force asked for after each step"] = partial(stepped, load)
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
    cases["ours, force asked for after each step"] = partial(stepped, load, linear=True)
    return cases


def mode_cases(t: np.ndarray, load: np.ndarray) -> dict[str, Case]:
    """Modes 2..30, asked for after each step."""
    cases: dict[str, Case] = {name: lambda how=how: partial(modes, t, load, *how) for name, how in PEERS.items()}
    cases["ours, shape asked for after each step"] = partial(stepped_modes, load)
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


def stepped(load: np.ndarray, linear: bool = False) -> Work:
    """One step and one force after the other."""
    ours, forces = Motion(UNIT, "inextensional", 1), load.tolist()
    changes = np.diff(load).tolist() if linear else [0.0] * (load.size - 1)
    ours.put(0, np.zeros(6), SPEED, 0.0)

    def work() -> None:
        for force, change in zip(forces, changes, strict=False):
            ours.advance(0, 1.0 / RATE, SPEED, force, 0.0, 0.0, change)
            ours.axle_force(0, SPEED)

    def result() -> np.ndarray:
        """The displacements, by the same steps once more."""
        ours.put(0, np.zeros(6), SPEED, 0.0)
        y = [0.0]
        for force, change in zip(forces, changes, strict=False):
            ours.advance(0, 1.0 / RATE, SPEED, force, 0.0, 0.0, change)
            y.append(ours.state_of(0)[5])
        return np.array(y)

    return lambda: (work(), result)[1]


def stepped_modes(load: np.ndarray) -> Work:
    """The same with the belt, whose shape is put out after each step."""
    ours = Motion(UNIT, "inextensional", 1)
    belt = BeltMotion(UNIT, "inextensional", N_MAX, 1, ring_angles(RING_SAMPLES))
    forces = load[:-1].tolist()

    def work() -> Callable[[], np.ndarray]:
        for force in forces:
            ours.advance(0, 1.0 / RATE, SPEED, force)
            belt.advance(0, PERIOD, SPEED, force)
            belt.deflection(0, ours)
        return lambda: belt.state_of(0)[:, 1][None]  # Z_1 of n = 2..30 as it is now

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


# -- a speed that changes -----------------------------------------------------------------------------------------


def changing_speed(load: np.ndarray, repeats: int) -> dict[str, Any]:
    """us a sample of simulate at a constant speed and at one that changes, the same exactness; and their ratio."""
    t = np.arange(20_000) / RATE
    loads = np.array(list(cycled(load, t.size)))
    swing = SPEED + CHANGE / 3.0 * np.sin(3.0 * t)
    varying = UNIT.replace(**SIDEWALL, **FORCES)
    found: dict[str, Any] = {}
    for name, unit in (("uniform", UNIT), ("varying", varying)):
        cost: dict[str, list[float]] = {"constant": [], "changing": []}
        for repeat in range(-1, repeats):
            for key, speed in (("constant", np.full(t.size, SPEED)), ("changing", swing)):
                begin = time.perf_counter()
                simulate(unit, t, speed, loads)
                if repeat >= 0:
                    cost[key].append(1e6 * (time.perf_counter() - begin) / t.size)
        ratio = spread(a / b for a, b in zip(cost["changing"], cost["constant"], strict=True))
        found[name] = {**{key: spread(values) for key, values in cost.items()}, "ratio": ratio}
    return found


def print_speeds(figures: dict[str, Any]) -> None:
    rows = [
        (name, shown(row["constant"]), shown(row["changing"]), shown(row["ratio"]), f"<= {CHANGE_TARGET:g}")
        for name, row in figures.items()
    ]
    print()
    print_table(("simulate, us a sample at 1 kHz", "constant speed", f"{CHANGE:g} rad/s^2", "ratio", "target"), rows)


# -- several wheels ---------------------------------------------------------------------------------------------


def several_wheels(load: np.ndarray, repeats: int) -> dict[str, Any]:
    """us per tick and wheel with and without belts, by number of wheels; and 64 wheels' against one's."""
    cases = [(belts, W) for belts in (False, True) for W in WHEELS]
    cost: dict[tuple[bool, int], list[float]] = {case: [] for case in cases}
    for _ in range(repeats):
        for belts, W in cases:
            cost[belts, W].append(cost_of_wheels(load, belts, W))
    found: dict[str, Any] = {}
    for belts in (False, True):
        key = "with the belt's shape at each tick" if belts else "n = 1 and wheel"
        found[key] = {str(W): spread(cost[belts, W]) for W in WHEELS}
        pairs = zip(cost[belts, 1], cost[belts, 64], strict=True)
        found[key]["64_against_1"] = spread(many / one for one, many in pairs)
    return found


def cost_of_wheels(load: np.ndarray, belts: bool, wheels: int) -> float:
    """us per tick and wheel: a load sample for each, the tick, the forces, the belts."""
    names = tuple(f"wheel_{k}" for k in range(wheels))
    ours = Wheels(
        VehicleSettings(
            UNIT, names, names, period=PERIOD, ring_period=PERIOD, ring_samples=RING_SAMPLES, n_max=N_MAX,
            input_timeout=10**12,
        )
    )  # fmt: skip
    for index in range(wheels):
        ours.add_speed(index, 1, 1, SPEED)
    begin = 0.0
    ticks = 10 + max(40, 1000 // wheels)
    for k, force in enumerate(cycled(load, ticks), 1):
        if k == 11:
            begin = time.perf_counter()
        stamp = k * PERIOD
        for index in range(wheels):
            ours.add_load(index, stamp, stamp, force)
        outputs = ours.tick(stamp)
        if belts:
            ours.due_belts()
    cost = time.perf_counter() - begin
    if len({output[1:] for output in outputs}) != 1 or len(outputs) != wheels:
        raise SystemExit(f"{wheels} wheels of one input are not alike")
    return 1e6 * cost / (wheels * (ticks - 10))


# -- a tire that is not the same all around ---------------------------------------------------------------------


def varying_tire(repeats: int) -> dict[str, Any]:
    """us per tick of four wheels at 500 Hz, each input new: the uniform tire, and one of each kind."""
    tires = {
        "uniform": UNIT,
        "sidewall": UNIT.replace(**SIDEWALL),
        "imbalance, run-out to the tenth": UNIT.replace(**FORCES),
        "all of it": UNIT.replace(**SIDEWALL, **FORCES),
    }
    names = ("one", "two", "three", "four")
    cost: dict[str, list[float]] = {tire: [] for tire in tires}
    for repeat in range(-1, repeats):
        for tire, unit in tires.items():
            ours = Wheels(VehicleSettings(unit, names, names, ring_period=10**15))
            begin = time.perf_counter()
            for k in range(1, 301):
                stamp = k * 2 * PERIOD
                for index in range(4):
                    ours.add_speed(index, stamp, stamp, SPEED + 0.01 * k, 0.1 * k)
                    ours.add_load(index, stamp, stamp, 3500.0 + k)
                if len(ours.tick(stamp)) != 4:
                    raise SystemExit(f"{tire}: a wheel does not move")
            if repeat >= 0:
                cost[tire].append(1e6 * (time.perf_counter() - begin) / 300)
    return {
        tire: {
            "us": spread(values),
            "against_uniform": spread(a / b for a, b in zip(values, cost["uniform"], strict=True)),
        }
        for tire, values in cost.items()
    }


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
    print_table(("us per tick and wheel", *(f"{W} wheel{'s' * (W > 1)}" for W in WHEELS), "64 : 1"), rows)
    print("each with its own load sample, tick, and force")
    print(f"target where the force is asked for after each step: >= {STEP_TARGET:g} x DOP853, restarted")
    print("*  ours have n = 1 and the wheel as well, and put out the belt's shape at 72 points after each step")
    print("** with the belt's modes noted, not taken; a sample falls between two ticks: two steps")


if __name__ == "__main__":
    main()
