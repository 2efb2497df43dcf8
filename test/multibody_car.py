"""A car that others wrote: the multi-body model of commonroad-vehicle-models (29 states), with sensors and truth.

Its axes are x forward, y right, z down; what is handed out has those of REP 103. Its road is flat: what moves it are
brakes and curves. g is 9.81 m/s^2 there.
"""

from __future__ import annotations

import math

import numpy as np
from simulated_car import GRAVITY, Recording
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from tire_dynamics import VehicleParameters

STEP = 1e-3  # [s]
G = 9.81


def parameters():
    """The model's own, and the car as the estimate takes it."""
    p = parameters_vehicle2()
    car = VehicleParameters(
        sprung_mass=p.m_s,
        unsprung_masses=[p.m_uf / 2.0] * 2 + [p.m_ur / 2.0] * 2,
        wheelbase=p.a + p.b,
        front_axle_to_cg=p.a,
        tracks=[p.T_f, p.T_r],
        cg_height=p.h_s,
        unsprung_height=p.R_w,
        roll_inertia=p.I_Phi_s,
        pitch_inertia=p.I_y_s,
        roll_centre_heights=[p.h_raf, p.h_rar],
        spring_rates=[p.K_sf] * 2 + [p.K_sr] * 2,
        damper_bump=[p.K_sdf] * 2 + [p.K_sdr] * 2,
        damper_rebound=[p.K_sdf] * 2 + [p.K_sdr] * 2,
        # a moment per angle, shared between the wheels, as a force per difference of their ways
        anti_roll_rates=[2.0 * abs(p.K_tsf) / p.T_f**2, 2.0 * abs(p.K_tsr) / p.T_r**2],
        tire_rates=[p.K_zt] * 4,
        rolling_radius=p.R_w,
    )
    return p, car


MANOEUVRES = {
    # time [s] to rate of the steering angle [rad/s] and acceleration [m/s^2]
    "braking": lambda t: (0.0, -6.0 if 1.0 <= t < 3.0 else 0.0),
    "step steer": lambda t: (0.15 if 1.0 <= t < 1.25 else 0.0, 0.0),
    "slalom and throttle": lambda t: (0.12 * math.cos(2.0 * math.pi * 0.5 * t) if t >= 1.0 else 0.0, 1.5),
}


def _loads(x, p):
    """The model's own formula for the vertical forces of its tires [N]."""
    found = []
    for height, roll, track in ((x[16], x[13], p.T_f), (x[21], x[18], p.T_r)):
        lift = p.R_w * (math.cos(roll) - 1.0)
        found += [(height + lift - 0.5 * side * track * math.sin(roll)) * p.K_zt for side in (1.0, -1.0)]
    return found


def _ways(x, p):
    """The model's own formula for the extension of its springs [m]."""
    found = []
    for height, roll, track, arm in ((x[16], x[13], p.T_f, p.a), (x[21], x[18], p.T_r, -p.b)):
        mean = (p.h_s - p.R_w + height - x[11]) / math.cos(x[6]) - p.h_s + p.R_w + arm * x[8]
        found += [mean + 0.5 * side * (x[6] - roll) * track for side in (1.0, -1.0)]
    return found


def _rates(x, u, p):
    return np.array(vehicle_dynamics_mb(list(x), u, p))


def record(name, duration=4.0, speed=22.0, seed=1):
    """A manoeuvre, after a second and a half in which the car settles; sensors with noise, no biases."""
    p, car = parameters()
    x = np.array(init_mb([0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0], p))
    control = MANOEUVRES[name]
    kept = {each: [] for each in ("imu", "travel", "hub", "wheel_speed", "load")}
    settle = round(1.5 / STEP)
    for step in range(-settle, round(duration / STEP)):
        t = step * STEP
        u = list(control(t)) if step >= 0 else [0.0, 0.0]
        f = _rates(x, u, p)
        if step >= 0 and step % 2 == 0:
            # specific force of the sprung mass along its own axes, y left and z up
            along, across, down = f[3] - x[5] * x[10], f[10] + x[5] * x[3], f[12] - G
            roll, pitch = x[6], x[8]
            side = math.cos(roll) * across + math.sin(roll) * down
            up = -(math.cos(roll) * down - math.sin(roll) * across)
            kept["imu"].append([along - math.sin(pitch) * down, -side, up, x[7], -x[9], -x[5]])
            kept["travel"].append([-way for way in _ways(x, p)])
            axles = ((17, 14, p.T_f), (22, 19, p.T_r))
            kept["hub"].append([G - f[z] + 0.5 * s * track * f[r] for z, r, track in axles for s in (1.0, -1.0)])
            kept["wheel_speed"].append(x[23:27].copy())
            kept["load"].append(_loads(x, p))
        half = x + 0.5 * STEP * f
        second = _rates(half, u, p)
        third = _rates(x + 0.5 * STEP * second, u, p)
        fourth = _rates(x + STEP * third, u, p)
        x = x + STEP / 6.0 * (f + 2.0 * second + 2.0 * third + fourth)
    random = np.random.default_rng(seed)
    time = np.arange(len(kept["load"])) * 2.0 * STEP
    imu, travel, hub, spin, load = (np.array(kept[each]) for each in ("imu", "travel", "hub", "wheel_speed", "load"))
    imu = imu + random.standard_normal(imu.shape) * ([0.08] * 3 + [0.0024] * 3)
    imu[:, 2] += GRAVITY - G
    travel = travel + 0.3e-3 * random.standard_normal(travel.shape)
    hub = hub + 0.3 * random.standard_normal(hub.shape) + (GRAVITY - G)
    spin = np.round(spin / 0.02) * 0.02
    slow = slice(None, None, 5)
    return car, Recording(
        (time[slow], imu[slow, :3], imu[slow, 3:]),
        (time[slow], travel[slow]),
        (time, hub),
        (time[slow], spin[slow]),
        time[slow],
        load[slow],
        np.array(car.static_loads),
        spin[slow].mean(1) * p.R_w,
    )
