"""A tick of four wheels on the road beside a tick of the same wheels with given loads, and a replay, in one run.

    python benchmarks/road.py [--repeats 5] [--json FILE]

The replay is of 60 s of four wheels on a random road (ISO 8608 class C, 80 km/h, heights at 500 Hz). Beside it
solve_ivp (DOP853, rtol 1e-9) integrates 0.1 s of one wheel of it, the same system, and the steps on that stand
against it.

n_max 30, 500 Hz, the inextensional belt; each tick comes with a speed and a load, or a height, for every wheel. "new
speed" changes the speed at every tick, "same speed" never. The road is a random walk that keeps the contact. The rows
of a sidewall that varies, in its first and second harmonic, couple the belt's harmonics up to a number.
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from harness import parser, print_machine, print_table, shown, spread, write_json
from scipy.integrate import solve_ivp

from tire_dynamics import TireWheelUnit, simulate
from tire_dynamics.cli.main import main as command
from tire_dynamics.estimator.belt import BeltMotion
from tire_dynamics.estimator.motion import Motion
from tire_dynamics.estimator.road_constants import under_the_belt
from tire_dynamics.estimator.road_motion import RoadMotion
from tire_dynamics.estimator.settings import VehicleSettings
from tire_dynamics.estimator.wheels import Wheels
from tire_dynamics.replay.replay import replay
from tire_dynamics.science import contact

WHEELS = ("fl", "fr", "rl", "rr")
LOADS = (4000.0, 4000.0, 3500.0, 3500.0)
PERIOD = 2_000_000
TICKS = 2000
UNIT = TireWheelUnit.table_1(
    contact_half_angle=0.15, vertical_stiffness=2e5, sidewall_damping="reaction", zeta_s=0.3, sprung_mass=350.0
)


VARYING = UNIT.replace(radial_nonuniformity=[(1, 0.02, 0.0), (2, 0.01, 0.5)])
COUPLED = (0, 10, 30)


def ticked(on_road: bool, same_speed: bool, coupled: int | None = None) -> float:
    """[us] of a tick: samples, steps, and the belts at 50 Hz; with ``coupled`` of a sidewall that varies."""
    settings = VehicleSettings(
        UNIT if coupled is None else VARYING,
        wheels=WHEELS,
        joint_names=WHEELS,
        static_loads=LOADS if on_road else None,
        coupled_harmonics=coupled or 0,
    )
    wheels = Wheels(settings)
    random = np.random.default_rng(1)
    speeds = 60.0 + (0.0 if same_speed else 1.0) * random.uniform(0.0, 1.0, TICKS)
    heights = np.cumsum(random.normal(0.0, 2e-4, TICKS))
    inputs = heights if on_road else 4000.0 + 1e5 * heights
    begin = time.perf_counter()
    for k, (speed, value) in enumerate(zip(speeds.tolist(), inputs.tolist(), strict=True)):
        now = (k + 1) * PERIOD
        for w in range(4):
            wheels.add_speed(w, now, now, speed)
            if on_road:
                wheels.add_height(w, now, now, value)
            else:
                wheels.add_load(w, now, now, value)
        wheels.tick(now)
        wheels.due_belts()
    return 1e6 * (time.perf_counter() - begin) / TICKS


def stepped(points: int, same_speed: bool) -> float:
    """[us] of a step of four wheels alone, without samples and belts."""
    motion = Motion(UNIT, "inextensional", 4)
    road = RoadMotion(UNIT, motion, BeltMotion(under_the_belt(UNIT), "inextensional", 30, 4, [0.0]), LOADS, points)
    random = np.random.default_rng(1)
    speeds = (60.0 + (0.0 if same_speed else 1.0) * random.uniform(0.0, 1.0, TICKS)).tolist()
    heights = np.cumsum(random.normal(0.0, 2e-4, TICKS)).tolist()
    for w in range(4):
        road.put(w, 60.0, 0.0, 0.0)
    begin = time.perf_counter()
    for speed, height in zip(speeds, heights, strict=True):
        for w in range(4):
            road.advance(w, 2e-3, speed, height)
    return 1e6 * (time.perf_counter() - begin) / TICKS


def replayed(folder: Path) -> float:
    """[s] for 60 s of four wheels."""
    bag, config, out = folder / "road", folder / "road.yaml", folder / "out"
    if not bag.exists():
        command(
            ["road", "--class", "C", "--speed-kmh", "80", "--duration", "60", "--wheels", *WHEELS, "-o", str(bag)]
        )
        fields = {f"tire.{name}": value for name, value in UNIT.to_mapping().items() if not isinstance(value, list)}
        values = {"wheels": list(WHEELS), "load_source": "road", "static_loads": list(LOADS), **fields}
        config.write_text(json.dumps({"/**": {"ros__parameters": values}}))
    begin = time.perf_counter()
    replay(bag, out, config=config, quiet=True, force=True)
    return time.perf_counter() - begin


def integrated() -> tuple[float, float, float]:
    """[s] for 0.1 s of one wheel by DOP853, for a minute of it by the steps, and their error over the force's range."""
    speed, time_of = 80.0 / 3.6 / UNIT.radius, 2e-3 * np.arange(51)
    heights = np.cumsum(np.random.default_rng(1).normal(0.0, 5e-4, time_of.size))
    heights -= heights[0]
    system = contact.open_system(UNIT, speed, n_max=30)
    start, compression, weight = contact.standing(system, LOADS[0])

    def force(t: float, z: Any) -> float:
        return max(0.0, system.stiffness * (compression + float(np.interp(t, time_of, heights) + system.contact @ z)))

    def slope(t: float, z: Any) -> Any:
        return system.matrix @ z + system.push * force(t, z) + system.weight * weight

    begin = time.perf_counter()
    options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-12, "t_eval": time_of}
    states = solve_ivp(slope, (0.0, time_of[-1]), start, **options).y.T
    one = time.perf_counter()
    found = simulate(UNIT, time_of, speed, road=heights, static_load=LOADS[0])
    minute = 2e-3 * np.arange(30001)
    rough = np.cumsum(np.random.default_rng(2).normal(0.0, 2e-4, minute.size))
    two = time.perf_counter()
    simulate(UNIT, minute, speed, road=rough, static_load=LOADS[0])
    three = time.perf_counter()
    expected = states @ system.output[1]
    error = np.abs(found.axle_force[:, 1] - expected).max() / np.ptp(expected)
    return one - begin, three - two, float(error)


def main() -> None:
    chosen = parser(__doc__.splitlines()[0], repeats=5).parse_args()
    print_machine()
    rows, figures = [], dict[str, Any]()
    for same in (True, False):
        name = "same speed" if same else "new speed"
        given, road, one, nine = ([] for _ in range(4))
        varying: dict[int, list[float]] = {coupled: [] for coupled in COUPLED}
        for _ in range(chosen.repeats):  # in turn, for the machine's sake
            given.append(ticked(False, same))
            road.append(ticked(True, same))
            for coupled, values in varying.items():
                values.append(ticked(True, same, coupled))
            one.append(stepped(1, same))
            nine.append(stepped(9, same))
        # several points are not the node's: their step's excess over one point's, on the tick
        several = [tick + more - less for tick, more, less in zip(road, nine, one, strict=True)]
        of_sidewall = [(f"road, varying sidewall, coupled to {coupled}", some) for coupled, some in varying.items()]
        for what, values in (
            ("load given", given), ("road, 1 point", road), ("road, 9 points", several), *of_sidewall
        ):  # fmt: skip
            figures[f"{name}, {what}"] = figure = spread(values)
            rows.append((f"{name}, {what}", shown(figure, ".1f"), f"{min(values) / min(given):.2f}"))
    print_table(("tick of 4 wheels", "us", "of the tick with a given load"), rows)
    with tempfile.TemporaryDirectory() as folder:
        figures["replay [s]"] = whole = spread(replayed(Path(folder)) for _ in range(min(chosen.repeats, 3)))
    direct, steps, error = integrated()
    figures["direct [s]"], figures["steps [s]"], figures["error"] = direct, steps, error
    print()
    print_table(
        ("60 s of 4 wheels", "s", "x real time"),
        [
            ("replay, bag to bag", shown(whole, ".2f"), f"{60.0 / whole['median']:.0f}"),
            ("solve_ivp, from 0.1 s of one", f"{2400.0 * direct:.0f}", f"{60.0 / (2400.0 * direct):.2g}"),
            ("simulate, from 60 s of one", f"{4.0 * steps:.2f}", f"{60.0 / (4.0 * steps):.0f}"),
        ],
    )
    print(f"axle force of simulate against solve_ivp: {error:.1e} of its range, steps of 2 ms")
    write_json(chosen.json, "road", figures)


if __name__ == "__main__":
    main()
