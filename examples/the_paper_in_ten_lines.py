"""Huang & Hsu (1992) in ten lines: natural frequencies, multipliers, critical speed, and the response to a cleat."""

import numpy as np

from tire_dynamics import TireWheelUnit, ring, simulate, wheel

unit, rpm = TireWheelUnit.table_1(), np.pi / 30.0
print("natural frequencies, n = 2 [rad/s]:", ring.natural_frequencies(unit, 2).round(2))
print("Floquet multipliers at 2000 rpm:", np.abs(wheel.stability(unit, 2000 * rpm).multipliers).round(6))
print("critical speed [rpm]:", round(wheel.critical_speed(unit) / rpm))
print("transmissibility at 2000 rpm:", round(wheel.transmissibility(unit, 2000 * rpm), 6))
time = np.arange(0.0, 0.5, 1e-3)
load = 4000.0 + 2500.0 * np.exp(-(((time - 0.1) / 0.004) ** 2))  # of a cleat at 0.1 s
force = simulate(unit, time, 2000 * rpm, load).axle_force[:, 1]
print(f"axle force [N]: from {force.min():.0f} to {force.max():.0f}")
