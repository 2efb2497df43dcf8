"""Cars that drive over rough roads, with sensors and truth: what the load estimator is tried on.

Nothing of it comes from the package: the equations are written anew in absolute coordinates (heave, pitch, roll and
four wheels above a road of four tracks), so that a mistake in the estimator's is not repeated here. Several drives are
simulated at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

GRAVITY = 9.80665
RATE = 2000  # steps of the simulation [1/s]


@dataclass(frozen=True)
class Car:
    """As its maker would know it; order front left, front right, rear left, rear right."""

    sprung_mass: float = 1320.0
    unsprung_masses: tuple[float, ...] = (42.0, 42.0, 38.0, 38.0)
    wheelbase: float = 2.7
    front_axle_to_cg: float = 1.25
    tracks: tuple[float, float] = (1.54, 1.54)
    cg_height: float = 0.54
    unsprung_height: float = 0.31
    roll_inertia: float = 480.0
    pitch_inertia: float = 2100.0
    roll_centre_heights: tuple[float, float] = (0.06, 0.11)
    spring_rates: tuple[float, ...] = (26e3, 26e3, 28e3, 28e3)
    damper_bump: tuple[float, ...] = (1500.0, 1500.0, 1400.0, 1400.0)
    damper_rebound: tuple[float, ...] = (2600.0, 2600.0, 2400.0, 2400.0)
    anti_roll_rates: tuple[float, float] = (14e3, 7e3)
    tire_rate: float = 215e3
    tire_damping: float = 60.0
    rolling_radius: float = 0.305

    def heavier(self, factor: float) -> Car:
        """With more in it: mass and inertia of the body grow alike."""
        return replace(
            self,
            sprung_mass=self.sprung_mass * factor,
            roll_inertia=self.roll_inertia * factor,
            pitch_inertia=self.pitch_inertia * factor,
        )


@dataclass(frozen=True)
class Drive:
    """How a car is driven, and over what."""

    duration: float = 60.0  # [s]
    roughness: float = 32e-6  # Gd(0.1 cycles/m) of ISO 8608 [m^3], waviness 2
    coherence: float = 0.5  # of left and right, as a correlation
    speed: float = 8.0  # at the start [m/s]
    target: float = 20.0  # speed that the driver makes for [m/s]
    steering: float = 1.0  # how hard it is steered: 1 reaches some 5 m/s^2
    slope: float = 0.0  # of the road, uphill [rad]
    bank: float = 0.0  # of the road, left side up [rad]
    bump: float = 0.025  # height of a bump of a metre, at a third of the way through [m]
    tip: bool = False  # whether the body's weight has a lever when it leans, and the IMU's vertical axis leans with it


@dataclass
class Recording:
    """What the sensors of one drive said, and the truth."""

    imu: tuple[np.ndarray, np.ndarray, np.ndarray]
    travel: tuple[np.ndarray, np.ndarray]
    hub: tuple[np.ndarray, np.ndarray]
    wheel_speed: tuple[np.ndarray, np.ndarray]
    time: np.ndarray  # (M,), 200 Hz
    load: np.ndarray  # (M, 4)
    static: np.ndarray  # (4,)
    speed: np.ndarray  # (M,)

    def sources(self, names: str) -> dict[str, Any]:
        """Those named, as ``estimate_loads`` takes them."""
        return {name: getattr(self, name) for name in names.split()}


@dataclass(frozen=True)
class Sensors:
    """Noise (one standard deviation) and rates."""

    acceleration: float = 0.08
    rate: float = 0.0024
    travel: float = 0.3e-3
    hub: float = 0.3
    step: float = 0.02  # of the wheel speeds [rad/s]
    acceleration_bias: float = 0.05
    rate_bias: float = 0.002
    rates: dict[str, int] = field(default_factory=lambda: {"imu": 200, "travel": 100, "hub": 500, "wheel_speed": 100})


def _road(drive: Drive, random: np.random.Generator, wheelbase: float) -> tuple[np.ndarray, float]:
    """Height of the left and the right track over the distance, every 2 cm; distance 0 lies a wheelbase behind."""
    spacing = 0.02
    length = max(drive.speed, drive.target) * 1.3 * drive.duration + 4.0 * wheelbase
    count = int(length / spacing)
    wavenumber = np.fft.rfftfreq(count, spacing)
    density = np.zeros_like(wavenumber)
    used = (wavenumber > 0.005) & (wavenumber < 10.0)
    density[used] = drive.roughness * (wavenumber[used] / 0.1) ** -2.0
    amplitude = np.sqrt(density * count / spacing / 2.0)
    white = random.standard_normal((3, wavenumber.size, 2)) @ np.array([1.0, 1j]) / np.sqrt(2.0)
    c = drive.coherence
    tracks = [np.sqrt(c) * white[0] + np.sqrt(1.0 - c) * own for own in white[1:]]
    height = np.array([np.fft.irfft(amplitude * each, count) for each in tracks])
    return height - height[:, :1], spacing


def _driver(drive: Drive, random: np.random.Generator, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Longitudinal acceleration, speed and yaw rate at every step."""
    dt = 1.0 / RATE
    time = np.arange(steps) * dt
    change = np.zeros(steps)  # throttle and brake, smoothed over 0.15 s
    begin = 1.5
    while begin < drive.duration:
        length = random.uniform(1.0, 4.0)
        change[(time >= begin) & (time < begin + length)] = random.choice([-3.8, -1.5, 0.0, 1.5, 2.5, 3.0])
        begin += length + random.uniform(0.0, 1.5)
    force = _lag(change, 0.15)
    speed, acceleration = np.empty(steps), np.empty(steps)
    v = drive.speed
    for k in range(steps):
        a = force[k]
        if drive.target == 0.0:
            a = -v
        elif v > drive.target and a > 0.0 or v < 0.3 * drive.target and a < 0.0:
            a = 0.5 * (drive.target - v) if v < 0.3 * drive.target else 0.0
        v = max(v + a * dt, 0.0)
        speed[k], acceleration[k] = v, a if v > 0.0 else 0.0
    acceleration = _lag(acceleration, 0.08)
    lateral = np.zeros(steps)
    begin = 2.0
    while begin < drive.duration:
        length = random.uniform(0.8, 3.0)
        size = drive.steering * random.uniform(1.5, 5.0) * random.choice([-1.0, 1.0])
        lateral[(time >= begin) & (time < begin + length)] = size
        begin += length + random.uniform(0.0, 3.0)
    lateral = _lag(_lag(lateral, 0.12), 0.12) * np.minimum(1.0, (speed / 8.0) ** 2)
    return acceleration, speed, lateral / np.maximum(speed, 1.0)


def _lag(signal: np.ndarray, time_constant: float) -> np.ndarray:
    from scipy.signal import lfilter

    a = 1.0 / (RATE * time_constant)
    return lfilter([a], [1.0, a - 1.0], signal)


def simulate_drives(car: Car, drives: list[Drive], seeds: list[int], sensors: Sensors | None = None) -> list[Recording]:
    """Drive the car; one recording for each drive, whose durations must be the same."""
    sensors = sensors or Sensors()
    many, duration = len(drives), drives[0].duration
    steps = int(duration * RATE)
    dt = 1.0 / RATE
    g = GRAVITY
    a, length = car.front_axle_to_cg, car.wheelbase
    x = np.array([a, a, a - length, a - length])
    y = np.array([0.5, -0.5, 0.5, -0.5]) * np.repeat(car.tracks, 2)
    side = np.sign(y)
    m, mu = car.sprung_mass, np.array(car.unsprung_masses)
    k, bump, rebound = (np.array(each) for each in (car.spring_rates, car.damper_bump, car.damper_rebound))
    bar = np.repeat(car.anti_roll_rates, 2) / 2.0
    carried = m * np.array([length - a, length - a, a, a]) / length / 2.0  # mass on each spring at rest
    centre = np.repeat(car.roll_centre_heights, 2)
    axle_masses = np.repeat([mu[:2].sum(), mu[2:].sum()], 2)
    over = np.repeat(car.tracks, 2)
    direct_y = (2.0 * carried * centre + axle_masses * car.unsprung_height) / over  # to the road past the springs
    direct_x = mu.sum() * car.unsprung_height / (2.0 * length)
    roll_arm = car.cg_height - (carried * 2.0 * centre).sum() / 2.0 / m
    static = (carried + mu) * g

    random = [np.random.default_rng(seed) for seed in seeds]
    acceleration, speed, yaw = (
        np.array(each)
        for each in zip(*(_driver(d, r, steps) for d, r in zip(drives, random, strict=True)), strict=True)
    )
    heights = np.zeros((steps, many, 4))
    for n, (drive, source) in enumerate(zip(drives, random, strict=True)):
        track, spacing = _road(drive, source, length)
        distance = np.cumsum(speed[n]) * dt
        at = (np.arange(track.shape[1])) * spacing - length
        middle = distance[steps // 3] + 2.0
        if drive.bump:
            inside = abs(at - middle) < 0.5
            track[:, inside] += drive.bump * 0.5 * (1.0 + np.cos(2.0 * np.pi * (at[inside] - middle)))
        for wheel in range(4):
            back = 0.0 if wheel < 2 else length
            heights[:, n, wheel] = np.interp(distance - back, at, track[wheel % 2])
    slope, bank = (np.array([[getattr(d, name)] for d in drives]) for name in ("slope", "bank"))
    tip = np.array([[float(d.tip)] for d in drives])

    z, roll, pitch = (np.zeros((many, 1)) for _ in range(3))
    vz, p, q = (np.zeros((many, 1)) for _ in range(3))
    begin = heights[0]
    zu = begin.copy()
    z = begin.mean(1, keepdims=True)
    vu = np.zeros((many, 4))
    # the body starts on the plane of its wheels, so that it begins at rest but for what the road's warp does
    pitch = -((zu[:, :2].mean(1) - zu[:, 2:].mean(1)) / length)[:, None]
    roll = ((zu[:, ::2].mean(1) - zu[:, 1::2].mean(1)) / car.tracks[0])[:, None]
    z = (zu - y * roll + x * pitch).mean(1, keepdims=True)
    other = np.array([1, 0, 3, 2])
    kept: dict[str, list[Any]] = {name: [] for name in ("load", "imu", "travel", "hub", "speeds")}
    every = {name: RATE // rate for name, rate in sensors.rates.items()}
    # Leapfrog: velocities are those of half a step before. Forces and sensors take them half a step on, by the last
    # acceleration: dampers that lag behind the springs by half a step of 1/2000 s make the body seem 0.3 % lighter.
    az, ap, aq, au = (np.zeros_like(each) for each in (vz, p, q, vu))
    level_roll, level_pitch = roll.copy(), pitch.copy()
    for step in range(steps):
        road = heights[step]
        road_rate = (heights[min(step + 1, steps - 1)] - heights[max(step - 1, 0)]) * (RATE / 2.0)
        vz_now, p_now, q_now, vu_now = (v + a * (dt / 2.0) for v, a in ((vz, az), (p, ap), (q, aq), (vu, au)))
        corner = z + y * roll - x * pitch
        corner_rate = vz_now + y * p_now - x * q_now
        travel = zu - corner
        rate = vu_now - corner_rate
        spring = k * travel + np.where(rate > 0.0, bump, rebound) * rate + bar * (travel - travel[:, other])
        on_body = carried * g + spring
        # in the road's plane: what moves the car, and what slope and bank add to it
        ax = acceleration[:, step, None] + g * slope
        ay = (speed[:, step] * yaw[:, step])[:, None] + g * bank
        direct = -side * direct_y * ay - np.sign(x) * direct_x * ax
        load = np.maximum(static + car.tire_rate * (road - zu) + car.tire_damping * (road_rate - vu_now), 0.0)
        az = (on_body.sum(1, keepdims=True) - m * g) / m
        lean, dive = roll - level_roll, pitch - level_pitch
        roll_moment = m * roll_arm * (ay + tip * g * lean)
        pitch_moment = -m * car.cg_height * (ax - tip * g * dive)
        ap = ((y * on_body).sum(1, keepdims=True) + roll_moment) / car.roll_inertia
        aq = (-(x * on_body).sum(1, keepdims=True) + pitch_moment) / car.pitch_inertia
        au = (load - on_body - direct - mu * g) / mu
        if step % (RATE // 200) == 0:
            kept["load"].append(load)
        if step % every["imu"] == 0:
            up = az + g + tip * (ax * dive - ay * lean)
            kept["imu"].append(np.hstack([ax - g * dive, ay + g * lean, up, p_now, q_now, yaw[:, step, None]]))
        if step % every["travel"] == 0:
            kept["travel"].append(travel)
        if step % every["hub"] == 0:
            kept["hub"].append(au + g)
        if step % every["wheel_speed"] == 0:
            omega = (speed[:, step, None] - y * yaw[:, step, None]) / car.rolling_radius
            kept["speeds"].append(omega)
        vz, p, q, vu = vz + az * dt, p + ap * dt, q + aq * dt, vu + au * dt
        z, roll, pitch, zu = z + vz * dt, roll + p * dt, pitch + q * dt, zu + vu * dt
    arrays = {name: np.array(values).swapaxes(0, 1) for name, values in kept.items()}
    recordings = []
    for n, source in enumerate(random):
        noise = source.standard_normal
        imu = arrays["imu"][n]
        size = np.array([sensors.acceleration] * 3 + [sensors.rate] * 3)
        bias = np.array([sensors.acceleration_bias] * 3 + [sensors.rate_bias] * 3) * noise(6)
        imu = imu + bias + size * noise(imu.shape)
        travel = arrays["travel"][n] + sensors.travel * noise(arrays["travel"][n].shape)
        hub = arrays["hub"][n] + sensors.hub * noise(arrays["hub"][n].shape)
        speeds = np.round(arrays["speeds"][n] / sensors.step) * sensors.step
        t = {name: np.arange(round(duration * rate)) / rate for name, rate in sensors.rates.items()}
        time = np.arange(arrays["load"].shape[1]) / 200.0
        recordings.append(
            Recording(
                (t["imu"], imu[:, :3], imu[:, 3:]),
                (t["travel"], travel),
                (t["hub"], hub),
                (t["wheel_speed"], speeds),
                time,
                arrays["load"][n],
                static,
                speed[n][:: RATE // 200],
            )
        )
    return recordings
