"""A tire from an MF-Tyre/MF-Swift property file: python your_own_tire.py TIRE.tir WHEEL_MASS_KG SUSPENSION_N_M"""

import sys
from pathlib import Path

import numpy as np

from tire_dynamics import ring, wheel, write_unit
from tire_dynamics.files.tir_unit import unit_from_tir

file, mass, stiffness = sys.argv[1:] or [Path(__file__).with_name("my_tire.tir"), 12.0, 3.2e4]
read = unit_from_tir(file, wheel_mass=float(mass), suspension_stiffness=float(stiffness), sidewall_damping="reaction")
unit = read.unit
for field in ("ring_mass", "radius", "sidewall_stiffness", "vertical_stiffness"):
    print(f"{field}: {getattr(unit, field):.6g}")
for doubt in read.doubts:
    print("doubtful:", doubt)

rigid, waves = unit.rigid_mode_frequency / (2.0 * np.pi), ring.natural_frequencies(unit, 2)[:2] / (2.0 * np.pi)
print(f"rigid ring on its sidewall: {rigid:.1f} Hz; two waves around the belt: {waves[0]:.1f} Hz")
for kilometres_per_hour in (50, 100, 200):
    judged = wheel.stability(unit, kilometres_per_hour / 3.6 / unit.radius)
    print(f"{kilometres_per_hour} km/h: {judged.verdict}, spectral radius {judged.spectral_radius:.4f}")
critical = wheel.critical_speed(unit)
print("stable at every speed" if critical is None else f"stable up to {critical * unit.radius * 3.6:.0f} km/h")

write_unit(unit, "my_tire.yaml")  # for `tire-dynamics replay --config`, and the node's parameters
