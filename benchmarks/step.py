"""One exact step of one wheel against scipy.integrate.solve_ivp, on the same input, in one run.

    python benchmarks/step.py [--seconds 10]

The input is a load that changes at 1 kHz, linear between its samples, at a constant speed. solve_ivp (DOP853, rtol
1e-9) integrates the periodic equations (3.13), once in a single call and once restarted at every sample, where
the load has its kinks. Errors are those of the wheel's displacement at the samples, relative to its largest value,
against the same equations with rtol 1e-13, restarted at every sample.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from tire_dynamics import TireWheelUnit, simulate
from tire_dynamics.estimator.wheel_estimator import WheelEstimator
from tire_dynamics.science import stepping, wheel

RATE = 1000
SPEED = 150.0  # [rad/s], 165 km/h on the tire of Table 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    unit = TireWheelUnit.table_1()
    t = np.arange(round(seconds * RATE) + 1) / RATE
    load = 3500.0 + 400.0 * np.random.default_rng(1992).standard_normal(t.size)

    reference, _ = timed(lambda: periodic(unit, t, load, rtol=1e-13, restart=True))
    rows = []
    for name, rtol, restart in (("one call", 1e-9, False), ("restarted", 1e-9, True)):
        y, cost = timed(lambda rtol=rtol, restart=restart: periodic(unit, t, load, rtol=rtol, restart=restart))
        rows.append((f"solve_ivp DOP853, rtol 1e-9, {name}", cost, y))
    peers = [cost for _, cost, _ in rows]
    y, cost = timed(lambda: simulate(unit, t, SPEED, load, initial="rest").wheel_displacement)
    rows.append(("simulate: all steps known beforehand", cost, y))
    y, cost = timed(lambda: one_by_one(unit, t, load))
    rows.append(("stepper: step by step", cost, y))
    print(f"{t.size - 1} steps of 1 ms, one wheel, n = 1 and wheel")
    print(f"{'':44}{'us/step':>10}{'x one call':>12}{'x restarted':>12}{'error':>10}")
    for name, cost, y in rows:
        error = np.abs(y - reference).max() / np.abs(reference).max()
        print(f"{line(name, cost, t.size - 1, peers)}{error:10.1e}")
    _, cost = timed(lambda: live(unit, t, load))
    print(line("live estimator, sample and tick at 1 kHz *", cost, t.size - 1, peers))
    print("* with the belt's modes 2..30, each load held until the next; a sample falls between two ticks: two steps")


def line(name: str, cost: float, steps: int, peers: list[float]) -> str:
    return f"{name:44}{1e6 * cost / steps:10.2f}" + "".join(f"{peer / cost:12.1f}" for peer in peers)


def timed(work: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    begin = time.perf_counter()
    result = work()
    return result, time.perf_counter() - begin


def periodic(unit: TireWheelUnit, t: np.ndarray, load: np.ndarray, *, rtol: float, restart: bool) -> np.ndarray:
    """The wheel's displacement by solve_ivp on the periodic equations in the rotating frame."""
    m = unit.ring_mass

    def slope(time_: float, z: np.ndarray) -> np.ndarray:
        force = np.interp(time_, t, load) / m
        dz = wheel.state_matrix(unit, SPEED, time_) @ z
        dz[0] += force * math.sin(SPEED * time_)  # (4.6)
        dz[1] += force * math.cos(SPEED * time_)
        return dz

    options = {"method": "DOP853", "rtol": rtol, "atol": 1e-3 * rtol}
    if not restart:
        return solve_ivp(slope, (t[0], t[-1]), np.zeros(6), t_eval=t, **options).y[5]
    z, y = np.zeros(6), [0.0]
    for begin, end in zip(t[:-1], t[1:], strict=True):
        z = solve_ivp(slope, (begin, end), z, **options).y[:, -1]
        y.append(z[5])
    return np.array(y)


def one_by_one(unit: TireWheelUnit, t: np.ndarray, load: np.ndarray) -> np.ndarray:
    stepper: stepping.SpinningStepper = wheel.stepper(unit).at(SPEED)
    z = np.zeros(10)
    y = [0.0]
    for k in range(t.size - 1):
        z[6], z[8] = load[k], load[k + 1] - load[k]
        z[:6] = stepper.step(1.0 / RATE, z)
        y.append(z[5])
    return np.array(y)


def live(unit: TireWheelUnit, t: np.ndarray, load: np.ndarray) -> np.ndarray:
    estimator = WheelEstimator(unit)
    estimator.add_speed(0, SPEED)
    period = 10**9 // RATE
    for k, force in enumerate(load):
        estimator.add_load(k * period + 300_000 + 7 * (k % 100), force)
        estimator.advance((k + 1) * period)
    return np.array(estimator.axle_force)


if __name__ == "__main__":
    main()
