"""A car's tire on a road of class C with a cleat, at 20 m/s: contact force, lift-off, and what the axle feels."""

import numpy as np

from tire_dynamics import TireWheelUnit, simulate, wheel
from tire_dynamics.science.road import bump, random_tracks

# The paper's unit as a vehicle has it: damped by its sidewall, standing on a patch, carrying a quarter of a car.
unit = TireWheelUnit.table_1(
    zeta_s=0.3, sidewall_damping="reaction", vertical_stiffness=2.0e5, contact_half_angle=0.15, sprung_mass=350.0
)
speed = 20.0 / unit.radius  # [rad/s]
time = np.arange(0.0, 4.0, 1e-3)
way = 20.0 * time

patch = 2.0 * unit.contact_half_angle * unit.radius  # [m], over which the patch takes the mean
road, _ = random_tracks("C", way[-1] + 1.0, seed=3)
cleat = bump(0.02, at=40.0, length=0.05)
for name, height in (("road", road.averaged(patch).at(way)), ("cleat", cleat.averaged(patch).at(way))):
    found = simulate(unit, time, speed, road=height, static_load=4000.0)
    force, axle = found.contact_force, found.axle_force[:, 1]
    print(f"{name}: contact force {force.min():.0f} to {force.max():.0f} N, of 4000 N at rest; rms {force.std():.0f} N")
    print(f"{name}: axle force {axle.min():.0f} to {axle.max():.0f} N; in the air for {np.sum(force == 0.0)} ms")

judged = wheel.stability(unit, speed, contact=True)
print(f"in contact it is {judged.verdict}; the slowest motion decays within {-1.0 / judged.exponents.real.max():.2f} s")
