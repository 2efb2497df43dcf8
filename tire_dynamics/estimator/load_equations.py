"""The car as the load estimate knows it: its equations of motion and its sensors, as constant arrays.

Sums have one order, and nothing calls LAPACK, BLAS or the C library's exponential: the same bits on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .vehicle_parameters import GRAVITY, VehicleParameters

__all__ = ["CarEquations", "SensorNoise"]

FloatArray = NDArray[np.float64]

# The state: way of each spring, deflection of each tire (from rest, compression positive), velocities of the body
# (heave, roll, pitch) and of the wheels, specific force in the road's plane, biases of the IMU; relative errors of the
# mass, of the moments that specific forces have about the roll and the pitch axis, and of these inertias; and how much
# of a lever the body's weight has when it rolls and pitches: none is 0, all of it 1.
TRAVEL, TIRE, WHEEL = slice(0, 4), slice(4, 8), slice(11, 15)
VELOCITY: Final = slice(8, 15)
HEAVE, ROLL, PITCH, ALONG, ACROSS, LIFT = 8, 9, 10, 15, 16, 17
BIAS_Z, BIAS_ROLL, BIAS_PITCH, BIAS_X, BIAS_Y, MASS = 18, 19, 20, 21, 22, 23
MOMENT, INERTIA, TIP = slice(24, 26), slice(26, 28), 28
SIZE, MOVING = 29, 18  # states, and those that change but by noise

START: Final = (
    *([0.01] * 4 + [0.005] * 4),  # [m] each tire's load within some 1 kN
    *([0.1] * 3 + [0.1] * 4),  # [m/s, rad/s]
    *([3.0] * 2),  # [m/s^2] a slope, a curve, the brake
    0.01,  # [m/s^2] what links lift
)
MANOEUVRE_TIME: Final = 3.0  # how long a specific force lasts [s]
LIFT_TIME: Final = 1.0  # and by how much links lift the body meanwhile [s]
ALIKE: Final = 0.5  # correlation of the road under left and right wheels


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
        How far the lever that the body's weight has as it rolls and pitches may be from half of it: a real car's is
        1, that of many simulations 0.
    inertia : float
        How far off the inertias of the body may be, over them.
    height : float
        How far off the heights may be that give specific forces their moments, over them. The default is that of a car
        whose geometry is measured; of a data sheet it is 0.03 to 0.05.
    links : float
        How much of these moments links may carry past the springs, beyond what roll centres say: no parameter says how
        they hold against dive. It is also how much of a specific force they may make lift the body.

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
    inertia: float = 0.1
    height: float = 0.01
    links: float = 0.05

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 1e-9 <= value <= 1e3:
                raise ValueError(f"{name} is {value!r}; it must be a number from 1e-9 to 1000")


def _sum(terms: FloatArray) -> FloatArray:
    """Over the first axis, one after the other."""
    total: FloatArray = np.add.reduce(terms, axis=0)
    return total


class CarEquations:
    """The constant parts of the equations of a car, and of what its sensors see.

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
    - The load is F_i = F_i0 + k_t d_i.
    - m, the moments of the specific forces and the inertias each have a relative error, which is a state. A moment is
      one of the mass, so their errors are correlated. What the springs do not have of the mass's moment in pitch is
      carried past them by links.
    - Links lift the body when it is pulled along or across: by m z, z' = -z / 1 s + noise, a quarter at each wheel.
    - After hubs were seen the road's noise comes back as 1 - exp(-2 pi v t / 0.1 m): no wave is shorter than 0.1 m, so
      that what a first-order rate adds is less in the beginning.

    Matrices of equations are transposed: column i has what drives state i.
    """

    def __init__(self, vehicle: VehicleParameters, noise: SensorNoise) -> None:
        car = vehicle
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
        rate = np.zeros((7, 4))
        rate[0], rate[1], rate[2] = -1.0, -y, x
        rate[3:] = np.eye(4)
        push = np.zeros((4, 7))
        push[:, 0], push[:, 1], push[:, 2] = 1.0 / inertia[0], y / inertia[1], -x / inertia[2]
        push[:, 3:] = -np.diag(1.0 / masses)
        self.rate, self.push = rate, push
        self.damp = push[:, None, :] * rate.T[:, :, None]  # (wheel, velocity from, velocity to)
        self.damper_half = (np.array(car.damper_bump) - np.array(car.damper_rebound)) / 2.0
        self.damper_mean = (np.array(car.damper_bump) + np.array(car.damper_rebound)) / 2.0

        a = np.zeros((SIZE, MOVING))
        a[VELOCITY, TRAVEL] = rate
        a[WHEEL, TIRE] = -np.eye(4)
        springs = np.diag(np.array(car.spring_rates) + bar)
        springs[range(4), other] = -bar
        a[TRAVEL, VELOCITY] = _sum(springs.T[:, :, None] * push[:, None, :])
        a[TIRE, WHEEL] = np.diag(tire / masses)
        a[ACROSS, ROLL], a[ALONG, PITCH] = moment
        a[ACROSS, WHEEL], a[ALONG, WHEEL] = -past_y / masses, -past_x / masses
        a[ALONG, ALONG] = a[ACROSS, ACROSS] = -1.0 / MANOEUVRE_TIME
        a[LIFT, HEAVE] = 1.0
        a[LIFT, WHEEL] = -car.sprung_mass / 4.0 / masses
        a[LIFT, LIFT] = -1.0 / LIFT_TIME
        self.lift = 2.0 / LIFT_TIME * noise.links**2  # intensity, per square of a specific force
        self.constant, self.moment = a, moment
        warp = np.array([0.25, -0.25, -0.25, 0.25])
        self.warp = np.concatenate([warp, warp])[:, None] * (4.0 * warp) / car.wheelbase

        self.masses, self.tire = masses, tire
        self.static = np.array(car.static_loads)
        self.carried = car.sprung_mass * share * GRAVITY
        # what of each wheel's load would pass the springs if links carried all of a specific force's moment: along; and
        # how much more they may carry than roll centres say: across
        self.past = -np.sign(x) * car.sprung_mass * car.cg_height / (2.0 * car.wheelbase)
        self.links = noise.links * car.sprung_mass * 2.0 * arm * share / track
        self.road = np.eye(4)
        self.road[[0, 1, 2, 3], other] = ALIKE
        drift = np.zeros(SIZE)
        drift[BIAS_Z], drift[BIAS_ROLL : BIAS_PITCH + 1] = (3e-4) ** 2, (6e-6) ** 2
        drift[BIAS_X : BIAS_Y + 1] = (3e-4) ** 2
        drift[MASS], drift[MOMENT], drift[INERTIA], drift[TIP] = (3e-4) ** 2, (3e-4) ** 2, (3e-4) ** 2, (1e-3) ** 2
        self.drift = drift
        # the road's bank, which tips gravity into a_y and goes its own way: per intensity of the road
        self.bank = 2.0 * (1.0 - ALIKE) * (2.0 * GRAVITY / (car.tracks[0] + car.tracks[1])) ** 2

        # what the sensors see, as columns; those of accelerations are filled in when they are needed
        self.see_imu = see = np.zeros((SIZE, 5))  # a_z, a_x, a_y, roll rate, pitch rate
        nose = np.array([1.0, 1.0, -1.0, -1.0]) / (2.0 * car.wheelbase)  # nose down, of the springs' ways
        lean = np.array([-1.0, 1.0, -1.0, 1.0]) / (2.0 * track)  # left side up
        see[TRAVEL, 1] = see[TIRE, 1] = -GRAVITY * nose
        see[TRAVEL, 2] = see[TIRE, 2] = GRAVITY * lean
        see[ALONG, 1] = see[BIAS_X, 1] = see[ACROSS, 2] = see[BIAS_Y, 2] = 1.0
        see[ROLL, 3] = see[BIAS_ROLL, 3] = see[PITCH, 4] = see[BIAS_PITCH, 4] = 1.0
        self.tilt = np.stack([np.concatenate([lean, lean]), np.concatenate([nose, nose])], axis=1)
        stiffness = _sum(springs * y[:, None]) * y, _sum(springs * x[:, None]) * x
        roll_stiffness, pitch_stiffness = (float(_sum(each)) for each in stiffness)
        self.leans = GRAVITY * car.sprung_mass * arm / roll_stiffness  # per specific force, in the long run
        self.dives = GRAVITY * car.sprung_mass * car.cg_height / pitch_stiffness
        self.see_travel = np.zeros((SIZE, 4))
        self.see_travel[TRAVEL] = np.eye(4)
        self.see_force = np.zeros((SIZE, 2))
        self.see_force[ALONG, 0] = self.see_force[ACROSS, 1] = 1.0
        n = noise
        biases = [n.acceleration_bias, *[n.angular_rate_bias] * 2, *[n.acceleration_bias] * 2]
        errors = [0.0, n.height, n.height, n.inertia, n.inertia, n.tip]
        self.start = np.diag(np.array([*START, *biases, *errors]) ** 2)
        self.start[MOMENT.stop - 1, MOMENT.stop - 1] += n.links**2
        self.start[MASS : MOMENT.stop, MASS : MOMENT.stop] += n.mass**2  # a moment is one of the mass
        self.noise = {
            "imu": [n.acceleration**2] * 3 + [n.angular_rate**2] * 2,
            "travel": [n.travel**2] * 4,
            "hub": [n.hub_acceleration**2] * 4,
            "force": [n.speed_slope**2] * 2,
        }
