"""The arithmetic of the load estimate: a car's equations of motion and the Kalman filter over them.

Everything that later results depend on is one array of numbers, :attr:`CarFilter.buffer`; its copy is the filter's
whole state. Every sum is taken in one order, over an axis that is not the last, and nothing calls LAPACK, BLAS or the C
library's exponential: the same calls give the same bits on every machine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .vehicle_parameters import GRAVITY, VehicleParameters

__all__ = ["CarFilter", "SensorNoise"]

FloatArray = NDArray[np.float64]

# The state: way of each spring, deflection of each tire (from rest, compression positive), velocities of the body
# (heave, roll, pitch) and of the wheels, specific force in the road's plane, biases of the IMU, relative error of the
# mass, and how much of a lever the body's weight has when it rolls and pitches: none is 0, all of it 1.
TRAVEL, TIRE, BODY, WHEEL = slice(0, 4), slice(4, 8), slice(8, 11), slice(11, 15)
VELOCITY: Final = slice(8, 15)
HEAVE, ROLL, PITCH, ALONG, ACROSS = 8, 9, 10, 15, 16
BIAS_Z, BIAS_ROLL, BIAS_PITCH, BIAS_X, BIAS_Y, MASS, TIP = 17, 18, 19, 20, 21, 22, 23
SIZE, MOVING = 24, 17  # states, and those that change but by noise

START: Final = (
    *([0.01] * 4 + [0.005] * 4),  # [m] each tire's load within some 1 kN
    *([0.1] * 3 + [0.1] * 4),  # [m/s, rad/s]
    *([3.0] * 2),  # [m/s^2] a slope, a curve, the brake
)
MANOEUVRE_TIME: Final = 3.0  # how long a specific force lasts [s]
MANOEUVRE: Final = 2.0  # its intensity while nothing measures it [m/s^2 per sqrt s]: it stays within some 2.4 m/s^2
ROUGHNESS: Final = 32e-6  # Gd(0.1 cycles/m) before anything is learnt: an ISO 8608 road between A and B [m^3]
LEAST_ROUGHNESS, MOST_ROUGHNESS = 1e-8, 1e-2
ALIKE: Final = 0.5  # correlation of the road under left and right wheels
CREEP: Final = 0.05  # a car that stands may still be loaded: as much as at this speed [m/s]
USUAL_SPEED: Final = 15.0  # where nothing tells the speed [m/s]
LEARNING_TIME: Final = 10.0  # within which roughness and intensity of manoeuvres are forgotten [s]
MASS_DRIFT: Final = 2.5e-3  # so that the springs' ways, whose rates are told, do not settle the mass [1 per sqrt s]
UNMODELLED: Final = 0.0045  # of the load at rest, one standard deviation: what the equations do not have
BALANCE: Final = 60.0  # below which the wheels' momentum is balanced [rad/s]
OUTLIER: Final = 9.0  # a squared normalised innovation beyond is taken as this one when the roughness is learnt


@dataclass(frozen=True)
class SensorNoise:
    """Errors of the sensors, as one standard deviation of a sample.

    Parameters
    ----------
    acceleration, angular_rate : float
        White noise of the IMU [m/s^2, rad/s].
    acceleration_bias, angular_rate_bias : float
        What its constant errors may be [m/s^2, rad/s].
    travel : float
        [m]
    hub_acceleration : float
        [m/s^2]
    speed_slope : float
        How far the specific force may be from what wheel speeds say: slope and bank of the road [m/s^2]. Used only
        while there is no IMU.
    mass : float
        How far off the sprung mass may be, over the mass.
    tip : float
        How far the body's weight may be from having no lever as it rolls and pitches; a real one has all of it, 1.

    Raises
    ------
    ValueError
        One is not a number above 0.
    """

    acceleration: float = 0.08
    angular_rate: float = 0.0024
    acceleration_bias: float = 0.05
    angular_rate_bias: float = 0.002
    travel: float = 0.3e-3
    hub_acceleration: float = 0.3
    speed_slope: float = 0.5
    mass: float = 0.03
    tip: float = 0.5

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 1e-9 <= value <= 1e3:
                raise ValueError(f"{name} is {value!r}; it must be a number from 1e-9 to 1000")


def _sum(terms: FloatArray) -> FloatArray:
    """Over the first axis, one after the other."""
    total: FloatArray = np.add.reduce(terms, axis=0)
    return total


def _decay(exponent: float) -> float:
    """exp(-exponent) within 1e-6 for exponents up to 0.3, without the C library."""
    even, odd = 1.0 + exponent * exponent / 12.0, exponent / 2.0
    return (even - odd) / (even + odd)


class CarFilter:
    """One Kalman filter over heave, pitch, roll and four wheels on a road that is integrated white noise.

    Parameters
    ----------
    vehicle : VehicleParameters
    noise : SensorNoise

    Notes
    -----
    Ways and loads are counted from rest, so that gravity is left out; i is the wheel, at (x_i, y_i) from the centre of
    gravity. With q the ways of the springs and d the deflections of the tires:

    - q_i' = u_i - (v_z + y_i p - x_i w), d_i' = s_i' - u_i; the road's s_i' is white, 2 (pi n_0)^2 Gd(n_0) v per unit
      of time (ISO 8608, waviness 2), correlated left to right; over the wheelbase its warp is forgotten.
    - F'_i = k_i q_i + c_i(q_i') q_i' + bar; m v_z' = sum F'_i; I_x p' = sum y_i F'_i + m (h - h_r) a_y;
      I_y w' = -sum x_i F'_i - m h a_x; m_i u_i' = k_t d_i - F'_i - G_i, with G_i what passes the springs.
    - The load is F_i = F_i0 + k_t d_i. What updates add to a wheel's momentum was load as well; below ``BALANCE`` it is
      counted as such, and its variance with it. It does not depend on the present error, as innovations are white.

    A damper of two slopes is taken at the mean and the variance of its speed, as the best line through it: with r the
    speed, c (r) r ~ c_mean r + c_half sqrt(r^2 + 2 var/pi).
    """

    def __init__(self, vehicle: VehicleParameters, noise: SensorNoise) -> None:
        self.noise = noise
        sizes = {"x": SIZE, "p": SIZE * SIZE, "a": SIZE * MOVING, "b": 7, "balance": 4, "spread": 4, "learnt": 6}
        self.buffer = np.zeros(sum(sizes.values()))
        views, begin = {}, 0
        for name, size in sizes.items():
            views[name] = self.buffer[begin : begin + size]
            begin += size
        self.x = views["x"]
        self.p = views["p"].reshape(SIZE, SIZE)
        self._a = views["a"].reshape(SIZE, MOVING)  # transposed: column i has what drives state i
        self._b = views["b"]
        self._balance, self._spread = views["balance"], views["spread"]
        self._learnt = views["learnt"]  # roughness, its information, manoeuvres^2, its information, speed, is it known
        self._describe(vehicle)
        m = MOVING
        self._terms_square = np.empty((m, SIZE, m))
        self._terms_left = np.empty((SIZE, m, SIZE))
        self._terms_right = np.empty((SIZE, m, m))
        self.reset()

    def _describe(self, car: VehicleParameters) -> None:
        """The constant parts of the equations."""
        behind = car.wheelbase - car.front_axle_to_cg
        x = np.array([car.front_axle_to_cg] * 2 + [-behind] * 2)
        track = np.repeat(car.tracks, 2)
        side = np.array([1.0, -1.0, 1.0, -1.0])
        y = side * track / 2.0
        share = np.array([behind, behind, car.front_axle_to_cg, car.front_axle_to_cg]) / (2.0 * car.wheelbase)
        masses = np.array(car.unsprung_masses)
        axle = np.array([masses[0] + masses[1]] * 2 + [masses[2] + masses[3]] * 2)
        centre = np.repeat(car.roll_centre_heights, 2)
        bar = np.repeat(car.anti_roll_rates, 2) / 2.0
        other = [1, 0, 3, 2]
        tire = np.array(car.tire_rates)
        inertia = (car.sprung_mass, car.roll_inertia, car.pitch_inertia)
        arm = car.cg_height - float(share[0] * 2.0 * centre[0] + share[2] * 2.0 * centre[2])
        moment = (car.sprung_mass * arm / car.roll_inertia, -car.sprung_mass * car.cg_height / car.pitch_inertia)
        past_y = -side * (2.0 * share * car.sprung_mass * centre + axle * car.unsprung_height) / track
        total = masses[0] + masses[1] + masses[2] + masses[3]
        past_x = -np.sign(x) * total * car.unsprung_height / (2.0 * car.wheelbase)

        # rate of travel from the seven velocities, and what a force in a suspension does to these
        self._rate = np.zeros((7, 4))
        self._rate[0], self._rate[1], self._rate[2] = -1.0, -y, x
        self._rate[3:] = np.eye(4)
        push = np.zeros((4, 7))
        push[:, 0], push[:, 1], push[:, 2] = 1.0 / inertia[0], y / inertia[1], -x / inertia[2]
        push[:, 3:] = -np.diag(1.0 / masses)
        self._push = push
        self._damp = push[:, None, :] * self._rate.T[:, :, None]  # (wheel, velocity from, velocity to)
        self._half = (np.array(car.damper_bump) - np.array(car.damper_rebound)) / 2.0
        self._mean = (np.array(car.damper_bump) + np.array(car.damper_rebound)) / 2.0

        a = np.zeros((SIZE, MOVING))
        a[VELOCITY, TRAVEL] = self._rate
        a[WHEEL, TIRE] = -np.eye(4)
        springs = np.diag(np.array(car.spring_rates) + bar)
        springs[range(4), other] = -bar
        a[TRAVEL, VELOCITY] = _sum(springs.T[:, :, None] * push[:, None, :])
        a[TIRE, WHEEL] = np.diag(tire / masses)
        a[ACROSS, ROLL], a[ALONG, PITCH] = moment
        a[ACROSS, WHEEL], a[ALONG, WHEEL] = -past_y / masses, -past_x / masses
        a[ALONG, ALONG] = a[ACROSS, ACROSS] = -1.0 / MANOEUVRE_TIME
        self._constant = a
        self._moment = moment
        warp = np.array([0.25, -0.25, -0.25, 0.25])
        self._warp = np.concatenate([warp, warp])[:, None] * (4.0 * warp) / car.wheelbase

        self._hub_mass = masses * BALANCE
        self._tire = tire
        self.static = np.array(car.static_loads)
        self._unmodelled = (UNMODELLED * self.static) ** 2
        self._carried = car.sprung_mass * share * GRAVITY
        self.radius, self.rear_track = car.rolling_radius, car.tracks[1]
        self._road = np.eye(4)
        self._road[[0, 1, 2, 3], other] = ALIKE
        drift = np.zeros(SIZE)
        drift[BIAS_Z], drift[BIAS_ROLL : BIAS_PITCH + 1] = (3e-4) ** 2, (6e-6) ** 2
        drift[BIAS_X : BIAS_Y + 1] = (3e-4) ** 2
        drift[MASS], drift[TIP] = (3e-4) ** 2, (1e-3) ** 2
        self._drift = drift

        # what the sensors see, as columns; those of accelerations are filled in when they are needed
        self._see_imu = np.zeros((SIZE, 5))  # a_z, a_x, a_y, roll rate, pitch rate
        see = self._see_imu
        nose = np.array([1.0, 1.0, -1.0, -1.0]) / (2.0 * car.wheelbase)  # nose down, of the springs' ways
        lean = np.array([-1.0, 1.0, -1.0, 1.0]) / (2.0 * track)  # left side up
        see[TRAVEL, 1] = see[TIRE, 1] = -GRAVITY * nose
        see[TRAVEL, 2] = see[TIRE, 2] = GRAVITY * lean
        see[ALONG, 1] = see[BIAS_X, 1] = see[ACROSS, 2] = see[BIAS_Y, 2] = 1.0
        see[ROLL, 3] = see[BIAS_ROLL, 3] = see[PITCH, 4] = see[BIAS_PITCH, 4] = 1.0
        see[BIAS_Z, 0] = 1.0
        self._tilt = np.stack([np.concatenate([lean, lean]), np.concatenate([nose, nose])], axis=1)
        stiffness = _sum(springs * y[:, None]) * y, _sum(springs * x[:, None]) * x
        roll_stiffness, pitch_stiffness = (float(_sum(each)) for each in stiffness)
        self._leans = GRAVITY * car.sprung_mass * arm / roll_stiffness  # per specific force, in the long run
        self._dives = GRAVITY * car.sprung_mass * car.cg_height / pitch_stiffness
        self._see_travel = np.zeros((SIZE, 4))
        self._see_travel[TRAVEL] = np.eye(4)
        self._see_hub = np.zeros((SIZE, 4))
        self._see_force = np.zeros((SIZE, 2))
        self._see_force[ALONG, 0] = self._see_force[ACROSS, 1] = 1.0
        n = self.noise
        self._noise_imu = [n.acceleration**2] * 3 + [n.angular_rate**2] * 2

    # -- beginnings -----------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Forget everything."""
        self.buffer[:] = 0.0
        n = self.noise
        biases = [n.acceleration_bias, *[n.angular_rate_bias] * 2, *[n.acceleration_bias] * 2, n.mass, n.tip]
        self.p[range(SIZE), range(SIZE)] = np.array([*START, *biases]) ** 2
        self._learnt[:] = (ROUGHNESS, 10.0, MANOEUVRE**2, 10.0, USUAL_SPEED, 0.0)
        self._linearise(True)

    def restart(self) -> None:
        """Forget the motion; what was learnt of mass, biases and road is kept."""
        self.x[:MOVING] = 0.0
        self.p[:MOVING, :] = 0.0
        self.p[:, :MOVING] = 0.0
        self.p[range(MOVING), range(MOVING)] = np.array(START) ** 2
        self._balance[:] = 0.0
        self._spread[:] = 0.0
        self._linearise(True)

    # -- through time ---------------------------------------------------------------------------------------

    @property
    def speed(self) -> float:
        """The car's speed [m/s], a usual one while nothing tells it."""
        return float(self._learnt[4])

    def set_speed(self, speed: float) -> None:
        """Say the car's speed [m/s]."""
        self._learnt[4:] = (speed, 1.0)

    @property
    def roughness(self) -> float:
        """Gd(0.1 cycles/m) of the road, as learnt [m^3]."""
        return float(self._learnt[0])

    def _linearise(self, weighs: bool) -> None:
        """The equations at the present state; ``weighs``: whether the motion of the body tells its mass."""
        x, a = self.x, self._a
        r = _sum(self._rate * x[VELOCITY, None])
        spread = _sum(self._rate[:, None, :] * self.p[VELOCITY, VELOCITY, None])
        variance = np.maximum(_sum(spread * self._rate), 0.0)
        size = np.sqrt(r * r + variance * (2.0 / math.pi) + 1e-8)
        slope = r / size
        rate = self._mean + self._half * slope
        b = _sum(self._push * (self._half * (size - slope * r))[:, None])
        a[:] = self._constant
        a[VELOCITY, VELOCITY] += _sum(self._damp * rate[:, None, None])
        a[:8, TIRE] -= self._warp * self.speed
        along, across, tip = x[[ALONG, ACROSS, TIP]].tolist()
        a[MASS, ROLL], a[MASS, PITCH] = self._moment[0] * across, self._moment[1] * along
        if weighs:
            lean, dive = _sum(self._tilt * x[:8, None]).tolist()
            a[:8, ROLL] += self._tilt[:, 0] * (self._moment[0] * GRAVITY * tip)
            a[:8, PITCH] -= self._tilt[:, 1] * (self._moment[1] * GRAVITY * tip)
            a[TIP, ROLL], a[TIP, PITCH] = self._moment[0] * GRAVITY * lean, -self._moment[1] * GRAVITY * dive
            b[1] -= tip * a[TIP, ROLL]
            b[2] -= tip * a[TIP, PITCH]
        else:
            a[TIP, ROLL], a[TIP, PITCH] = a[MASS, ROLL] * self._leans, a[MASS, PITCH] * self._dives
        self._b[:] = b

    def predict(self, step: float, measured: bool, weighs: bool) -> None:
        """Go on in time.

        Parameters
        ----------
        step : float
            [s], at most some 3 ms.
        measured : bool
            Whether an IMU tells the specific forces.
        weighs : bool
            Whether the ways of the springs are measured, so that the motion of the body tells its mass.
        """
        self._linearise(weighs)
        x, p, a = self.x, self.p, self._a
        half = step * step / 2.0
        rate = _sum(a * x[:, None])
        rate[VELOCITY] += self._b
        x[:MOVING] += step * rate + half * _sum(a[:MOVING] * rate[:, None])
        np.multiply(a.T[:, :, None], a[:MOVING, None, :], out=self._terms_square)
        change = _sum(self._terms_square)
        change *= half
        change += step * a
        np.multiply(change[:, :, None], p[:, None, :], out=self._terms_left)
        left = _sum(self._terms_left)
        np.multiply(left.T[:, :, None], change[:, None, :], out=self._terms_right)
        both = _sum(self._terms_right)
        p[:MOVING] += left
        p[:, :MOVING] += left.T
        p[:MOVING, :MOVING] += both
        p += p.T  # what rounding makes of its two halves would grow apart
        p *= 0.5
        learnt = self._learnt
        roughness, _, manoeuvre, _, speed, _ = learnt.tolist()
        p[TIRE, TIRE] += self._road * (2.0 * (math.pi * 0.1) ** 2 * roughness * (speed + CREEP) * step)
        intensity = manoeuvre if measured else MANOEUVRE**2
        diagonal = p.reshape(-1)[:: SIZE + 1]
        diagonal += self._drift * step
        diagonal[ALONG : ACROSS + 1] += intensity * step
        if weighs:
            diagonal[MASS] += MASS_DRIFT**2 * step
        fade = _decay(BALANCE * step)
        self._balance *= fade
        self._spread *= fade * fade
        forget = _decay(step / LEARNING_TIME)
        learnt[1] *= forget
        learnt[3] *= forget

    # -- what is measured -----------------------------------------------------------------------------------

    def take_imu(self, values: Sequence[float]) -> None:
        """Specific force x, y, z [m/s^2], roll rate and pitch rate [rad/s]; NaN where one is not known."""
        see, x = self._see_imu, self.x
        see[:, 0] = self._a[:, HEAVE]
        see[BIAS_Z, 0] = 1.0
        seen = _sum(see * x[:, None]).tolist()
        along, across, up, roll, pitch = values
        told = (up - GRAVITY - float(self._b[0]), along, across, roll, pitch)
        self._update(see, [t - s for t, s in zip(told, seen, strict=True)], self._noise_imu, (0, 1, 1, 0, 0))

    def take_travel(self, values: Sequence[float]) -> None:
        """Ways of the springs from rest, compression positive [m]; NaN where one is not known."""
        seen = self.x[TRAVEL].tolist()
        rest = [t - s for t, s in zip(values, seen, strict=True)]
        self._update(self._see_travel, rest, [self.noise.travel**2] * 4, (0,) * 4)

    def take_hub(self, values: Sequence[float]) -> None:
        """Vertical specific force of the unsprung masses [m/s^2]; NaN where one is not known."""
        see = self._see_hub
        see[:] = self._a[:, WHEEL]
        seen = (_sum(see * self.x[:, None]) + self._b[3:]).tolist()
        rest = [t - GRAVITY - s for t, s in zip(values, seen, strict=True)]
        self._update(see, rest, [self.noise.hub_acceleration**2] * 4, (0,) * 4)

    def take_force(self, along: float, across: float) -> None:
        """Specific force in the road's plane [m/s^2], as wheel speeds tell it."""
        rest = [along - float(self.x[ALONG]), across - float(self.x[ACROSS])]
        self._update(self._see_force, rest, [self.noise.speed_slope**2] * 2, (2, 2))

    def _update(self, see: FloatArray, innovation: list[float], noise: Sequence[float], tells: Sequence[int]) -> None:
        """Take measurements at once, each after those before it; ``tells``: of the road (0), manoeuvre (1), or none."""
        known = [k for k, value in enumerate(innovation) if value == value]
        if not known:
            return
        if len(known) < len(innovation):
            see = see[:, known]
            innovation = [innovation[k] for k in known]
            noise = [noise[k] for k in known]
            tells = [tells[k] for k in known]
        count = len(known)
        p = self.p
        seen = _sum(see[:, :, None] * p[:, None, :])
        covariance = _sum(seen.T[:, :, None] * see[:, None, :]).tolist()
        # L D L' of the innovations' covariance: D and e are those of each measurement after the ones before
        lower: list[list[float]] = []
        inverse: list[list[float]] = []
        variance: list[float] = []
        fresh: list[float] = []
        for i in range(count):
            mine: list[float] = []
            row, e = covariance[i], innovation[i]
            prior = row[i]
            for j in range(i):
                value = row[j]
                for k in range(j):
                    value -= mine[k] * lower[j][k] * variance[k]
                value /= variance[j]
                mine.append(value)
                prior -= value * value * variance[j]
                e -= value * fresh[j]
            prior = max(prior, 0.0)
            lower.append(mine)
            variance.append(prior + noise[i])
            fresh.append(e)
            back = [0.0] * count
            back[i] = 1.0
            for j in range(i):
                for k in range(j + 1):
                    back[k] -= mine[j] * inverse[j][k]
            inverse.append(back)
            if tells[i] < 2:
                self._learn(2 * tells[i], e * e / variance[i], prior / variance[i])
        scale = [1.0 / math.sqrt(each) for each in variance]
        white = np.array([e * s for e, s in zip(fresh, scale, strict=True)])
        whiten = np.array([[inverse[i][k] * scale[i] for i in range(count)] for k in range(count)])
        gain = _sum(whiten[:, :, None] * seen[:, None, :])  # (measurement, state), each of unit variance
        self.x += _sum(gain * white[:, None])
        p -= _sum(gain[:, :, None] * gain[:, None, :])
        jump = gain[:, WHEEL] * self._hub_mass
        self._balance += _sum(jump * white[:, None])
        self._spread += _sum(jump * jump)

    def _learn(self, place: int, square: float, share: float) -> None:
        """An intensity of noise from an innovation: its normalised square, and the share of the process in its
        variance.

        A step of Newton's method on the likelihood, with the information of the last ten seconds.
        """
        learnt = self._learnt
        information = float(learnt[place + 1]) + 0.5 * share * share
        learnt[place + 1] = information
        step = 0.5 * share * (min(square, OUTLIER) - 0.99) / information
        intensity = float(learnt[place]) * (_decay(-step) if step < 0.3 else 1.35)
        least, most = (LEAST_ROUGHNESS, MOST_ROUGHNESS) if place == 0 else (1e-4, 100.0)
        learnt[place] = min(max(intensity, least), most)

    # -- what is asked --------------------------------------------------------------------------------------

    def loads(self) -> tuple[FloatArray, FloatArray]:
        """Load of each tire and its standard deviation [N]."""
        x, p = self.x, self.p
        load = self.static + self._carried * x[MASS] + self._tire * x[TIRE] + self._balance
        index = np.arange(4, 8)
        variance = self._tire * self._tire * p[index, index] + self._carried * self._carried * p[MASS, MASS]
        variance = variance + 2.0 * self._tire * self._carried * p[TIRE, MASS] + self._spread + self._unmodelled
        return np.maximum(load, 0.0), np.sqrt(np.maximum(variance, 0.0))

    def mass_error(self) -> tuple[float, float]:
        """Relative error of the mass and its standard deviation."""
        return float(self.x[MASS]), math.sqrt(max(float(self.p[MASS, MASS]), 0.0))
