"""The load estimate on seeded drives of a simulation that shares nothing with the filter: is it consistent?

    python benchmarks/loads.py [--drives 100] [--seconds 20] [--heavier 1.0] [--json FILE]

Each drive has a road (ISO 8608 classes A to C), a speed (8 to 28 m/s), brakes, curves and biases of its own. For each
set of sources, over all drives:

error     root mean square over the static load
inside    share of the errors within two stated standard deviations; the lowest of a drive beside it
NEES      mean of the squared errors over the stated variances; 1 if these are right
NIS       mean of the squared normalised innovations of each source over the last ten seconds of a drive; 1 if equations
          and noise are right
cost      processor time per second of driving, a load asked for at 200 Hz
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from harness import parser, print_machine, print_table, write_json

from tire_dynamics import LoadFilter, read_vehicle

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "test"))
from simulated_car import Car, Drive, Recording, simulate_drives  # noqa: E402

CAR = read_vehicle(ROOT / "config" / "car.yaml")
SETS = {"imu": "imu wheel_speed", "travel": "imu wheel_speed travel", "hub": "imu wheel_speed travel hub"}


def drives(count: int, seconds: float) -> list[Drive]:
    """Always the same."""
    random = np.random.default_rng(1)
    roughness = 8e-6 * 2.0 ** random.uniform(0.0, 4.0, count)
    targets = random.uniform(8.0, 28.0, count)
    return [
        Drive(duration=seconds, roughness=r, target=v, steering=0.7, speed=8.0, bump=0.0, tip=bool(k % 2))
        for k, (r, v) in enumerate(zip(roughness, targets, strict=True))
    ]


def follow(recording: Recording, names: str) -> dict[str, float]:
    """One drive through a filter."""
    car, events = LoadFilter(CAR), []
    for name in names.split():
        times, *columns = getattr(recording, name)
        rows = [column.tolist() for column in columns]
        events += [(round(1e9 * t), name, [row[k] for row in rows]) for k, t in enumerate(times)]
    events.sort(key=lambda event: event[0])
    load, deviation = np.empty_like(recording.load), np.empty_like(recording.load)
    following, started = 0, time.process_time()
    for k, moment in enumerate(np.rint(1e9 * recording.time).astype(np.int64).tolist()):
        while following < len(events) and events[following][0] <= moment:
            stamp, name, values = events[following]
            getattr(car, f"add_{name}")(stamp, *values)
            following += 1
        car.advance(moment)
        load[k], deviation[k] = car.load, car.standard_deviation
    cost = (time.process_time() - started) / (recording.time[-1] - recording.time[0])
    error = load - recording.load
    return {
        "error": float(np.sqrt(((error / recording.static) ** 2).mean())),
        "inside": float((abs(error) < 2.0 * deviation).mean()),
        "nees": float(((error / deviation) ** 2).mean()),
        "cost": cost,
        **{f"nis {name}": value for name, value in car.consistency.items() if value == value},
    }


def main() -> None:
    options = parser(__doc__.splitlines()[0], repeats=1)
    options.add_argument("--drives", type=int, default=100, help="how many (default 100)")
    options.add_argument("--seconds", type=float, default=20.0, help="of each (default 20)")
    options.add_argument("--heavier", type=float, default=1.0, help="the car over what was told (default 1.0)")
    chosen = options.parse_args()
    print_machine()
    some = drives(chosen.drives, chosen.seconds)
    recordings = simulate_drives(Car().heavier(chosen.heavier), some, list(range(len(some))))
    figures, rows = {}, []
    for name, names in SETS.items():
        found = [follow(recording, names) for recording in recordings]
        figures[name] = found
        mean = {key: float(np.mean([each[key] for each in found])) for key in found[0]}
        nis = ", ".join(f"{key.removeprefix('nis ')} {value:.2f}" for key, value in mean.items() if "nis" in key)
        inside = f"{100 * mean['inside']:.1f} % ({100 * min(each['inside'] for each in found):.1f})"
        cells = (name, f"{100 * mean['error']:.2f} %", inside, f"{mean['nees']:.2f}", nis, f"{mean['cost']:.3f}")
        rows.append(cells)
        print("  ".join(cells), flush=True)
    header = (f"{chosen.drives} drives, {chosen.seconds:g} s", "error", "inside (lowest)", "NEES", "NIS", "cost [s/s]")
    print_table(header, rows)
    write_json(chosen.json, "loads", figures)


if __name__ == "__main__":
    main()
