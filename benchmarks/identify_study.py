"""Does identification state its errors honestly? How often the truth is within two of them, over synthetic recordings.

    python benchmarks/identify_study.py [--runs 200] [--kinds all ...] [--jobs 2] [--seconds 20] [--json FILE]

Each run draws a unit around a passenger car's corner, every fitted parameter by up to 20 % either way, and a drive: a
load of random phases with a spectrum that falls beyond 25 Hz, known exactly at every time, and a speed that drifts. The
force is integrated by the classical Runge-Kutta method at 4 kHz, which takes the load as it is, also between its steps,
and the speed: nothing is joined by lines. It is sampled at another rate than the load, delayed, and given an offset,
white noise and noise that drifts. Twice all topics are missing for a while, once the force alone. The fit begins with
every parameter 30 % off.

Kinds: ``free`` fits all five parameters, ``held`` holds the wheel's mass, which is known. The others hold it too:
``gain`` has a load cell that is wrong by 1 % (one deviation), ``late`` a load channel that is up to 20 ms late,
``quantised`` speeds in steps of 0.5 rad/s, ``noisy`` 20 N rms of white noise on the load of which nobody says anything,
``noise-said`` the same, said to the fit.
"""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from harness import parser, print_machine, print_table, write_json
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter
from scipy.stats import binom

from tire_dynamics import TireWheelUnit
from tire_dynamics.estimator.identification import DEFAULT_FIT, Recording, identify
from tire_dynamics.science.uncertainty import value_of, with_values
from tire_dynamics.science.wheel import equilibrium
from tire_dynamics.science.wheel_matrices import fixed_frame

BASE = TireWheelUnit.table_1(wheel_mass=35.0, suspension_stiffness=25e3, zeta_s=0.3, sidewall_damping="reaction")
FINE = 4000  # [Hz]
LOAD, SPEED = 500, 100  # [Hz]
FORCES = (400, 500, 800)  # [Hz], one of them
OFF = 0.3
CORNER, HIGHEST = 25.0, 150.0  # [Hz] of the load's spectrum
WHITE, DRIFTING = 3.0, 3.0  # rms [N]
KINDS = ("free", "held", "gain", "late", "quantised", "noisy", "noise-said")
GAIN_ERROR, LATE, QUANTUM, LOAD_NOISE = 0.01, 0.02, 0.5, 20.0  # [-], [s], [rad/s], rms [N]


def integrate(unit: TireWheelUnit, speed: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Axle forces (N, 2) at steps of 1/FINE; speed and load (2 N,) are known at half steps, too.

    The classical Runge-Kutta method in the fixed frame. At 150 Hz a step is 0.24 rad: the forced response is right to
    (0.24)^4/2880, 1e-6, natural frequencies at 95 Hz to (0.15)^4/120, 4e-6, and next to one the response to 5e-5.
    """
    system = fixed_frame(unit)
    h, count, eye = 1.0 / FINE, load.size // 2, np.eye(len(system.constant))
    P = np.empty((count - 1, *eye.shape))
    q = np.empty((count - 1, len(eye)))
    for first in range(0, count - 1, 8192):
        rows = np.arange(first, min(first + 8192, count - 1))
        A = [system.constant + speed[2 * rows + k, None, None] * system.spin for k in range(3)]
        b = [load[2 * rows + k, None] * system.input[:, 0] for k in range(3)]
        K1 = A[0]
        K2 = A[1] @ (eye + 0.5 * h * K1)
        K3 = A[1] @ (eye + 0.5 * h * K2)
        K4 = A[2] @ (eye + h * K3)
        k1 = b[0]
        k2 = b[1] + 0.5 * h * np.einsum("nij,nj->ni", A[1], k1)
        k3 = b[1] + 0.5 * h * np.einsum("nij,nj->ni", A[1], k2)
        k4 = b[2] + h * np.einsum("nij,nj->ni", A[2], k3)
        P[rows] = eye + h / 6.0 * (K1 + 2.0 * K2 + 2.0 * K3 + K4)
        q[rows] = h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    states = np.empty((count, len(eye)))
    states[0] = equilibrium(unit, float(speed[0]), float(load[0]))
    for k in range(count - 1):
        states[k + 1] = P[k] @ states[k] + q[k]
    output = system.output + speed[::2, None, None] * system.output_spin
    return np.einsum("nij,nj->ni", output, states)


def recording(
    seed: int, seconds: float = 20.0, kind: str = "free"
) -> tuple[Recording, TireWheelUnit, TireWheelUnit, float]:
    """A synthetic recording, the truth, the unit to begin with, and the delay of the force after the load [s]."""
    random = np.random.default_rng(seed)
    values = {name: value_of(BASE, name) * random.uniform(0.8, 1.2) for name in DEFAULT_FIT}
    truth = with_values(BASE, values)
    fitted = fit_of(kind)
    start = with_values(truth, {n: values[n] * (1.0 + OFF * random.choice([-1.0, 1.0])) for n in fitted})

    count = 2 * round(seconds * FINE)  # with half steps
    time = np.arange(count) / (2.0 * FINE)
    f = np.fft.rfftfreq(count, 0.5 / FINE)
    spectrum = np.where((f > 0.0) & (f < HIGHEST), 1.0 / (1.0 + (f / CORNER) ** 2), 0.0)
    load = np.fft.irfft(np.sqrt(spectrum) * np.exp(2j * math.pi * random.random(f.size)), count)
    load = 4000.0 + 600.0 * load / load.std()
    speed = random.uniform(30.0, 90.0) + 5.0 * np.sin(2.0 * math.pi * (time / 17.0 + random.random()))
    force = integrate(truth, speed, load)
    time, speed, load = time[::2], speed[::2], load[::2]

    delay = random.uniform(0.0, 0.03)
    rate = int(random.choice(FORCES))
    stamps = np.arange(math.ceil(delay * rate) + 1, math.floor(seconds * rate)) / rate
    seen = make_interp_spline(time, force, 7)(stamps - delay)
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
    load_seen, speed_seen = load[:: FINE // LOAD].copy(), speed[:: FINE // SPEED].copy()
    if kind == "gain":
        load_seen *= math.exp(GAIN_ERROR * random.standard_normal())
    if kind in ("noisy", "noise-said"):
        load_seen += LOAD_NOISE * random.standard_normal(load_seen.size)
    if kind == "quantised":
        speed_seen = QUANTUM * np.round(speed_seen / QUANTUM)
    late = random.uniform(0.0, LATE) if kind == "late" else 0.0
    keep, turn, felt = there(loads, whole), there(speeds, whole), there(stamps, slice(0, 3))
    record = Recording(
        speeds[turn], speed_seen[turn], loads[keep] + late, load_seen[keep], np.zeros(keep.sum()), stamps[felt],
        seen[felt],
    )  # fmt: skip
    return record, truth, start, delay - late


def fit_of(kind: str) -> tuple[str, ...]:
    """What is fitted: all, or all but the wheel's mass."""
    return DEFAULT_FIT if kind == "free" else tuple(name for name in DEFAULT_FIT if name != "wheel_mass")


def run(seed: int, seconds: float = 20.0, kind: str = "free") -> dict[str, tuple[float, float]]:
    """Of each parameter: how far the estimate is from the truth, in standard errors, and the standard error."""
    record, truth, start, delay = recording(seed, seconds, kind)
    found = identify(record, start, fit_of(kind), load_noise=LOAD_NOISE if kind == "noise-said" else None)
    miss = {
        name: (math.log(value / value_of(truth, name)) / error, float(error))
        for name, value, error in zip(found.names, found.values, found.errors, strict=True)
    }
    return {**miss, "delay": ((found.delay - delay) / found.delay_error, found.delay_error)}


def main() -> None:
    options = parser(__doc__.splitlines()[0], repeats=1)
    options.add_argument("--runs", type=int, default=200, help="of each kind (200)")
    options.add_argument("--kinds", nargs="+", choices=(*KINDS, "all"), default=["free"], help="(free)")
    options.add_argument("--jobs", type=int, default=2, help="processes (2)")
    options.add_argument("--seconds", type=float, default=20.0, help="of each drive (20)")
    options.add_argument("--seed", type=int, default=1992, help="of the first run (1992)")
    chosen = options.parse_args()
    print_machine()
    figures: dict[str, Any] = {}
    low, high = binom.interval(0.99, chosen.runs, math.erf(math.sqrt(2.0)))
    with ProcessPoolExecutor(chosen.jobs) as pool:
        for kind in KINDS if "all" in chosen.kinds else chosen.kinds:
            seeds = range(chosen.seed, chosen.seed + chosen.runs)
            runs = list(pool.map(partial(run, seconds=chosen.seconds, kind=kind), seeds))
            figures[kind] = {}
            for name in runs[0]:
                miss, error = np.array([each[name] for each in runs]).T
                figures[kind][name] = {
                    "within": int((np.abs(miss) <= 2.0).sum()),
                    "error": float(np.median(error)),
                    "rms": float(np.sqrt(np.mean(miss**2))),
                    "mean": float(np.mean(miss)),
                }
            print_table(
                (kind, "within 2 errors", "share", "median error", "miss: mean", "rms [errors]"),
                [
                    (
                        name,
                        f"{row['within']} of {chosen.runs}",
                        f"{row['within'] / chosen.runs:.1%}",
                        f"{1e6 * row['error']:.3g} us" if name == "delay" else f"{row['error']:.2%}",
                        f"{row['mean']:.2f}",
                        f"{row['rms']:.2f}",
                    )
                    for name, row in figures[kind].items()
                ],
            )
            print(flush=True)
    print(f"of {chosen.runs} honest ones {low:.0f} to {high:.0f} are within, in 99 of 100 studies")
    write_json(chosen.json, "identify", figures)


if __name__ == "__main__":
    main()
