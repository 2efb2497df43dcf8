"""A tick of four wheels on the road beside a tick of the same wheels with given loads, in one run.

    python benchmarks/road.py [--repeats 5] [--json FILE]

n_max 30, 500 Hz, the inextensional belt; each tick comes with a speed and a load, or a height, for every wheel. "new
speed" changes the speed at every tick, "same speed" never. The road is a random walk that keeps the contact.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from harness import parser, print_machine, print_table, shown, spread, write_json

from tire_dynamics import TireWheelUnit
from tire_dynamics.estimator.belt import BeltMotion
from tire_dynamics.estimator.motion import Motion
from tire_dynamics.estimator.road_constants import under_the_belt
from tire_dynamics.estimator.road_motion import RoadMotion
from tire_dynamics.estimator.settings import VehicleSettings
from tire_dynamics.estimator.wheels import Wheels

WHEELS = ("fl", "fr", "rl", "rr")
LOADS = (4000.0, 4000.0, 3500.0, 3500.0)
PERIOD = 2_000_000
TICKS = 2000
UNIT = TireWheelUnit.table_1(
    contact_half_angle=0.15, vertical_stiffness=2e5, sidewall_damping="reaction", zeta_s=0.3, sprung_mass=350.0
)


def ticked(on_road: bool, same_speed: bool) -> float:
    """[us] of a tick: samples, steps, and the belts at 50 Hz."""
    settings = VehicleSettings(UNIT, wheels=WHEELS, joint_names=WHEELS, static_loads=LOADS if on_road else None)
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


def main() -> None:
    chosen = parser(__doc__.splitlines()[0], repeats=5).parse_args()
    print_machine()
    rows, figures = [], dict[str, Any]()
    for same in (True, False):
        name = "same speed" if same else "new speed"
        given, road, one, nine = ([] for _ in range(4))
        for _ in range(chosen.repeats):  # in turn, for the machine's sake
            given.append(ticked(False, same))
            road.append(ticked(True, same))
            one.append(stepped(1, same))
            nine.append(stepped(9, same))
        # several points are not the node's: their step's excess over one point's, on the tick
        several = [tick + more - less for tick, more, less in zip(road, nine, one, strict=True)]
        for what, values in (("load given", given), ("road, 1 point", road), ("road, 9 points", several)):
            figures[f"{name}, {what}"] = figure = spread(values)
            rows.append((f"{name}, {what}", shown(figure, ".1f"), f"{min(values) / min(given):.2f}"))
    print_table(("tick of 4 wheels", "us", "of the tick with a given load"), rows)
    write_json(chosen.json, "road", figures)


if __name__ == "__main__":
    main()
