"""Does identification state its errors honestly? How often the truth is within two of them, over synthetic recordings.

    python benchmarks/identify_study.py [--runs 200] [--jobs 2] [--seconds 20] [--json FILE]

Each run draws a unit around a passenger car's corner, every fitted parameter by up to 20 % either way, and a drive: a
load of random phases with a spectrum that falls beyond 25 Hz, known exactly at every time, and a speed that drifts. The
force is computed in steps of 0.25 ms, sampled at another rate than the load, delayed, and given an offset, white noise
and noise that drifts. Twice all topics are missing for a while, once the force alone. The fit begins with every
parameter 30 % off.
"""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from harness import parser, print_machine, print_table, write_json
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter
from scipy.stats import binom

from tire_dynamics import TireWheelUnit, simulate
from tire_dynamics.estimator.identification import DEFAULT_FIT, Recording, identify
from tire_dynamics.science.uncertainty import value_of, with_values

BASE = TireWheelUnit.table_1(wheel_mass=35.0, suspension_stiffness=25e3, zeta_s=0.3, sidewall_damping="reaction")
FINE = 4000  # [Hz]
LOAD, SPEED = 500, 100  # [Hz]
FORCES = (400, 500, 800)  # [Hz], one of them
OFF = 0.3
CORNER = 25.0  # [Hz] of the load's spectrum
WHITE, DRIFTING = 3.0, 3.0  # rms [N]


def recording(seed: int, seconds: float = 20.0) -> tuple[Recording, TireWheelUnit, TireWheelUnit, float]:
    """A synthetic recording, the truth, the unit to begin with, and the delay [s]."""
    random = np.random.default_rng(seed)
    values = {name: value_of(BASE, name) * random.uniform(0.8, 1.2) for name in DEFAULT_FIT}
    truth = with_values(BASE, values)
    start = with_values(truth, {n: v * (1.0 + OFF * random.choice([-1.0, 1.0])) for n, v in values.items()})

    count = round(seconds * FINE)
    time = np.arange(count) / FINE
    f = np.fft.rfftfreq(count, 1.0 / FINE)
    spectrum = np.where((f > 0.0) & (f < 150.0), 1.0 / (1.0 + (f / CORNER) ** 2), 0.0)
    load = np.fft.irfft(np.sqrt(spectrum) * np.exp(2j * math.pi * random.random(f.size)), count)
    load = 4000.0 + 600.0 * load / load.std()
    speed = random.uniform(30.0, 90.0) + 5.0 * np.sin(2.0 * math.pi * (time / 17.0 + random.random()))
    force = simulate(truth, time, speed, load).axle_force

    delay = random.uniform(0.0, 0.03)
    rate = int(random.choice(FORCES))
    stamps = np.arange(math.ceil(delay * rate) + 1, math.floor(seconds * rate)) / rate
    seen = CubicSpline(time, force)(stamps - delay)
    for column in seen.T:
        drift = lfilter([math.sqrt(1.0 - 0.98**2)], [1.0, -0.98], random.standard_normal(stamps.size))
        column += random.uniform(-50.0, 50.0) + WHITE * random.standard_normal(stamps.size) + DRIFTING * drift

    begins = seconds * (np.array([0.2, 0.6, 0.8]) + random.uniform(0.0, 0.1, 3))
    lengths = random.uniform(0.05, 0.5, 3)

    def there(at: np.ndarray, some: slice) -> np.ndarray:
        gaps = list(zip(begins[some], lengths[some], strict=True))
        return np.all([(at < begin) | (at > begin + length) for begin, length in gaps], axis=0)

    whole = slice(0, 2)
    loads, speeds = time[:: FINE // LOAD], time[:: FINE // SPEED]
    keep, turn, felt = there(loads, whole), there(speeds, whole), there(stamps, slice(0, 3))
    record = Recording(
        speeds[turn],
        speed[:: FINE // SPEED][turn],
        loads[keep],
        load[:: FINE // LOAD][keep],
        np.zeros(keep.sum()),
        stamps[felt],
        seen[felt],
    )
    return record, truth, start, delay


def run(seed: int, seconds: float = 20.0) -> dict[str, tuple[float, float]]:
    """Of each parameter: how far the estimate is from the truth, in standard errors, and the standard error."""
    record, truth, start, delay = recording(seed, seconds)
    found = identify(record, start)
    miss = {
        name: (math.log(value / value_of(truth, name)) / error, float(error))
        for name, value, error in zip(found.names, found.values, found.errors, strict=True)
    }
    return {**miss, "delay": ((found.delay - delay) / found.delay_error, found.delay_error)}


def main() -> None:
    options = parser(__doc__.splitlines()[0], repeats=1)
    options.add_argument("--runs", type=int, default=200, help="(200)")
    options.add_argument("--jobs", type=int, default=2, help="processes (2)")
    options.add_argument("--seconds", type=float, default=20.0, help="of each drive (20)")
    options.add_argument("--seed", type=int, default=1992, help="of the first run (1992)")
    chosen = options.parse_args()
    print_machine()
    with ProcessPoolExecutor(chosen.jobs) as pool:
        seeds = range(chosen.seed, chosen.seed + chosen.runs)
        runs = list(pool.map(partial(run, seconds=chosen.seconds), seeds))
    figures: dict[str, Any] = {}
    low, high = binom.interval(0.99, chosen.runs, math.erf(math.sqrt(2.0)))
    for name in runs[0]:
        miss, error = np.array([each[name] for each in runs]).T
        figures[name] = {
            "within": int((np.abs(miss) <= 2.0).sum()),
            "error": float(np.median(error)),
            "rms": float(np.sqrt(np.mean(miss**2))),
            "mean": float(np.mean(miss)),
        }
    print_table(
        ("", "within 2 errors", "share", "median error", "miss: mean", "rms [errors]"),
        [
            (
                name,
                f"{row['within']} of {chosen.runs}",
                f"{row['within'] / chosen.runs:.1%}",
                f"{1e6 * row['error']:.3g} us" if name == "delay" else f"{row['error']:.2%}",
                f"{row['mean']:.2f}",
                f"{row['rms']:.2f}",
            )
            for name, row in figures.items()
        ],
    )
    print(f"of {chosen.runs} honest ones {low:.0f} to {high:.0f} are within, in 99 of 100 studies")
    write_json(chosen.json, "identify", figures)


if __name__ == "__main__":
    main()
