"""The load estimate against its bars, in one table: a car that others simulated, and seeded drives of our own car.

    python benchmarks/loads.py [--drives 100] [--seconds 20] [--seed 1] [--fullcar FOLDER] [--json FILE]

Two simulations that share nothing with the filter. *fullcar* is a minute of a car that others simulated, as CSV
files (left out where the folder is not there). The *drives* are of ``test/simulated_car.py``: each has a road (ISO
8608 classes A to C), a speed (8 to 28 m/s), brakes, curves and biases of its own, half of them a body whose weight
has a lever as it rolls and pitches. For each set of sources:

error          root mean square over the static load: of fullcar the worst wheel, of the drives over all
below f        the same of the error's part below the frequency up to which these sources are to make loads known
inside         share of the errors within two stated standard deviations; of the drives of all samples, of the median
               drive, of the drive that 5 % are below, and of the lowest
5 % heavier    the same with a car that is 5 % heavier than the filter is told
NEES           mean of the squared errors over the stated variances; 1 if these are right
NIS            mean of the squared normalised innovations of each source over the last ten seconds; 1 if equations and
               noise are right
cost           processor time per second of driving, a load asked for at 200 Hz
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from harness import parser, print_machine, print_table, write_json
from scipy.signal import butter, sosfiltfilt

from tire_dynamics import LoadFilter, VehicleParameters, read_vehicle

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "test"))
from simulated_car import Car, Drive, Recording, simulate_drives  # noqa: E402

CAR = read_vehicle(ROOT / "config" / "car.yaml")
FULLCAR = Path(os.environ.get("TIRE_DYNAMICS_FULLCAR", ROOT.parent / "shared" / "data" / "fullcar"))
SETS = {"imu": "imu wheel_speed", "travel": "imu wheel_speed travel", "hub": "imu wheel_speed travel hub"}
# error [%], frequency [Hz], error below it [%]
BARS = {"imu": (6.5, 2.0, 2.8), "travel": (6.0, 5.0, 1.2), "hub": (1.5, 20.0, 0.9)}
INSIDE, INSIDE_HEAVIER = (93.0, 98.0), 90.0


def drives(count: int, seconds: float, seed: int = 1) -> list[Drive]:
    """Always the same for a seed."""
    random = np.random.default_rng(seed)
    roughness = 8e-6 * 2.0 ** random.uniform(0.0, 4.0, count)
    targets = random.uniform(8.0, 28.0, count)
    return [
        Drive(duration=seconds, roughness=r, target=v, steering=0.7, speed=8.0, bump=0.0, tip=bool(k % 2))
        for k, (r, v) in enumerate(zip(roughness, targets, strict=True))
    ]


def read_fullcar(folder: Path) -> Recording:
    """What its files hold; the static loads are those of the car as it was told."""

    def read(name: str) -> np.ndarray:
        return np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1)

    imu, travel, hub, speed, truth = map(read, ("imu", "suspension", "hub", "wheel_speed", "truth"))
    return Recording(
        (imu[:, 0], imu[:, 1:4], imu[:, 4:]),
        (travel[:, 0], 1e-3 * travel[:, 1:]),
        (hub[:, 0], hub[:, 1:]),
        (speed[:, 0], speed[:, 1:]),
        truth[:, 0],
        truth[:, 1:5],
        np.array(CAR.static_loads),
        np.zeros(truth.shape[0]),
    )


def lighter(car: VehicleParameters) -> VehicleParameters:
    """As somebody tells it who forgot a passenger: the real one is 5 % heavier."""
    return replace(car, sprung_mass=car.sprung_mass / 1.05)


def follow(recording: Recording, names: str, below: float, told: VehicleParameters = CAR) -> dict[str, Any]:
    """One drive through a filter."""
    car, events = LoadFilter(told), []
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
    low = sosfiltfilt(butter(4, below, fs=200.0, output="sos"), error, axis=0)
    return {
        "error": _over(error, recording.static),
        "low": _over(low, recording.static),
        "inside": 100.0 * float((abs(error) < 2.0 * deviation).mean()),
        "nees": float(((error / deviation) ** 2).mean()),
        "mass": car.mass_error,
        "cost": cost,
        "nis": {name: value for name, value in car.consistency.items() if value == value},
    }


def _over(error: np.ndarray, static: np.ndarray) -> list[float]:
    """Root mean square of each wheel's error over its static load [%]."""
    wheels: list[float] = (100.0 * np.sqrt((error**2).mean(0)) / static).tolist()
    return wheels


def _mean(found: list[dict[str, Any]], name: str) -> float:
    return float(np.mean([each[name] for each in found]))


def of_drives(found: list[dict[str, Any]]) -> dict[str, float]:
    """Of all drives together; quantiles of the shares inside."""
    inside = [each["inside"] for each in found]
    return {
        "error": float(np.sqrt(np.mean(np.square([each["error"] for each in found])))),
        "low": float(np.sqrt(np.mean(np.square([each["low"] for each in found])))),
        "inside": float(np.mean(inside)),
        "median": float(np.median(inside)),
        "fifth": float(np.quantile(inside, 0.05)),
        "lowest": min(inside),
        "nees": _mean(found, "nees"),
        "cost": _mean(found, "cost"),
        **{f"nis {name}": float(np.mean([each["nis"][name] for each in found])) for name in found[0]["nis"]},
    }


def main() -> None:
    options = parser(__doc__.splitlines()[0], repeats=1)
    options.add_argument("--drives", type=int, default=100, help="how many (default 100)")
    options.add_argument("--seconds", type=float, default=20.0, help="of each (default 20)")
    options.add_argument("--seed", type=int, default=1, help="of roads and speeds (default 1)")
    options.add_argument("--fullcar", type=Path, default=FULLCAR, help="the folder of its files")
    chosen = options.parse_args()
    print_machine()
    other = read_fullcar(chosen.fullcar) if chosen.fullcar.is_dir() else None
    some = drives(chosen.drives, chosen.seconds, chosen.seed)
    seeds = [1000 * (chosen.seed - 1) + k for k in range(len(some))]
    ours = [simulate_drives(car, some, seeds) if some else [] for car in (Car(), Car().heavier(1.05))]
    figures: dict[str, Any] = {}
    rows = []
    for name, names in SETS.items():
        figures[name] = found = {}
        error, below, low = BARS[name]
        if other is not None:
            found["fullcar"], found["fullcar, 5 % heavier"] = (
                follow(other, names, below, told) for told in (CAR, lighter(CAR))
            )
            for case in ("fullcar", "fullcar, 5 % heavier"):
                its = found[case]
                cells = [f"{max(its['error']):.2f}", f"{max(its['low']):.2f}", f"{its['inside']:.1f}"]
                cells += ["", "", "", f"{its['nees']:.2f}", _shown(its["nis"]), f"{its['cost']:.3f}"]
                rows.append((f"{name}: {case}", *cells))
        for case, recordings in zip(("drives", "drives, 5 % heavier"), ours, strict=True):
            if not recordings:
                continue
            each = [follow(recording, names, below) for recording in recordings]
            found[case] = {**(its := of_drives(each)), "of each": each}
            quantiles = [f"{its[key]:.1f}" for key in ("inside", "median", "fifth", "lowest")]
            nis = {key.removeprefix("nis "): value for key, value in its.items() if key.startswith("nis ")}
            cells = [f"{its['error']:.2f}", f"{its['low']:.2f}", *quantiles, f"{its['nees']:.2f}", _shown(nis)]
            rows.append((f"{name}: {case}", *cells, f"{its['cost']:.3f}"))
        inside = "{:g}..{:g}".format(*INSIDE) + f", heavier >= {INSIDE_HEAVIER:g}"
        rows.append((f"{name}: bar", f"<= {error}", f"<= {low}", inside, *[""] * 6))
    header = ("of the static load [%]", "error", "below f", "inside", "median", "5 %", "lowest", "NEES", "NIS", "cost")
    print_table(header, rows)
    write_json(chosen.json, "loads", figures)


def _shown(nis: dict[str, float]) -> str:
    return " ".join(f"{name} {value:.2f}" for name, value in nis.items())


if __name__ == "__main__":
    main()
