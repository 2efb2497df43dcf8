"""Makes the sample input bag: twenty seconds of a passenger car on a straight road, four wheels.

The story: 2 s at a standstill, a launch to 20 m/s, a cruise in which first the front and then the rear
wheels run over a cleat, and a braking stop to standstill.

- *Road.* Two tracks of class B by ISO 8608:2016: displacement spectrum Gd(n) = Gd(n_0) (n/n_0)^-w over the
  spatial frequency n, with Gd(n_0) = 64e-6 m^3, the geometric mean of class B, at n_0 = 0.1 cycles/m, and
  waviness w = 2; harmonics of random phase from 0.01 to 10 cycles/m. The tracks' coherence is that of an
  isotropic surface (Dodds and Robson, J. Sound Vib. 31, 1973, 175-183; Kamash and Robson, J. Sound Vib. 57,
  1978, 89-100), which for w = 2 is gamma = kappa K_1(kappa), kappa = 2 pi n b, at track width b: long waves
  lift both sides together, short ones do not.
- *Tire on the road.* The contact patch averages the road over its length (fixed footprint: Captain, Boghani
  and Wormley, Vehicle System Dynamics 8, 1979, 1-32).
- *Vertical.* A quarter-car at each corner with the parameters of the "golden car" of the International
  Roughness Index (Sayers, Transportation Research Record 1501, 1995, 1-12) per sprung mass m_s: tire
  k_t/m_s = 653 1/s^2, spring k_s/m_s = 63.3 1/s^2, damper c_s/m_s = 6.0 1/s, unsprung m_u/m_s = 0.15. Its
  tire force is the contact load. Driving and braking shift m a h/(2 l) from axle to axle; that enters as a
  force on the sprung mass, so that the body pitches in its own time. The tire model of this package has no
  part in it.
- *Longitudinal.* The front wheels drive; brakes act on all. Air drag and rolling resistance are overcome.
  Wheel speeds carry the slip that the force needs.

Run it as ``python bags/make_sample.py [-o DIR] [--force]``. The values are the same on every run.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import lsim
from scipy.special import k1

from tire_dynamics.bag import BagWriter
from tire_dynamics.cdr.messages import JOINT_STATE, WRENCH_STAMPED, JointStateEncoder, WrenchEncoder
from tire_dynamics.files.errors import InputError

Array = NDArray[np.float64]

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
START = 1_767_225_600  # s: 2026-01-01
DURATION = 20.0  # s
RATE = 2000  # Hz, of the simulation
LOAD_RATE, SPEED_RATE = 500, 100  # Hz, of the messages
# What the instruments resolve, N and rad/s. It also frees the values from the last bits of the libraries.
FORCE_STEP, SPEED_STEP = 2.0**-4, 2.0**-12

# The car
MASS = 1520.0  # kg
FRONT_SHARE = 0.52  # of the weight
WHEELBASE, TRACK, CG_HEIGHT = 2.70, 1.55, 0.55  # m
ROLLING_RADIUS = 0.305  # m
DRAG = 0.5 * 1.2 * 0.65  # kg/m: half the air's density times c_d A
ROLLING_RESISTANCE = 0.012
BRAKE_FRONT_SHARE = 0.7
SLIP_STIFFNESS = 20.0  # force per slip, as a multiple of the load
CONTACT_LENGTH = 0.11  # m
GRAVITY = 9.81  # m/s^2
TIRE, SPRING, DAMPER, UNSPRUNG = 653.0, 63.3, 6.0, 0.15  # golden car, per sprung mass

# The road
GD0, N0, WAVINESS = 64e-6, 0.1, 2.0  # m^3, cycles/m, 1
ROAD_LENGTH, ROAD_STEP = 400.0, 0.01  # m
ROAD_BAND = (0.01, 10.0)  # cycles/m
CLEAT_HEIGHT, CLEAT_LENGTH = 0.020, 0.075  # m
SEED = 8608

# The drive
LAUNCH, BRAKING = (2.0, 10.0), (14.0, 18.6)  # s, begin and end
CRUISE = 20.0  # m/s
CLEAT_TIME = 12.0  # s, when the front wheels meet it


def road() -> tuple[Array, Array]:
    """The left and the right track.

    Returns
    -------
    left, right : (N,) ndarray
        Height [m] at steps of ``ROAD_STEP``, periodic over ``ROAD_LENGTH``.
    """
    count = round(ROAD_LENGTH / ROAD_STEP)
    n = np.arange(count // 2 + 1) / ROAD_LENGTH
    inside = (n >= ROAD_BAND[0]) & (n <= ROAD_BAND[1])
    amplitude = np.zeros_like(n)  # of the harmonics: a^2/2 is what the spectrum has between two of them
    amplitude[inside] = np.sqrt(2.0 * GD0 * (n[inside] / N0) ** -WAVINESS / ROAD_LENGTH)
    random = np.random.Generator(np.random.PCG64(SEED))
    first, second = np.exp(2j * np.pi * random.random((2, n.size)))
    kappa = 2.0 * np.pi * TRACK * n[inside]
    coherence = np.zeros_like(n)
    coherence[inside] = kappa * k1(kappa)
    other = coherence * first + np.sqrt(1.0 - coherence**2) * second
    left, right = (np.fft.irfft(count / 2.0 * amplitude * phasor, count) for phasor in (first, other))
    return left, right


class Drive(NamedTuple):
    """The car's motion along the road, (N,) arrays at ``RATE``: s, m/s^2, m/s, m."""

    time: Array
    acceleration: Array
    speed: Array
    distance: Array


def drive() -> Drive:
    """Standstill, launch, cruise, braking, standstill."""
    time = np.arange(round(DURATION * RATE)) / RATE
    acceleration, speed = np.zeros_like(time), np.zeros_like(time)
    for sign, (begin, end), edge in ((1.0, LAUNCH, 0.4), (-1.0, BRAKING, 0.2)):
        # A pulse with cosine edges of so many seconds: nobody steps on a pedal in no time.
        inside = np.clip(np.minimum(time - begin, end - time) / edge, 0.0, 1.0)
        pulse = 0.5 - 0.5 * np.cos(np.pi * inside)
        change = np.cumsum(pulse)
        acceleration += sign * CRUISE * pulse / change[-1] * RATE
        speed += sign * CRUISE * (change / change[-1])  # begins and ends at a standstill exactly
    return Drive(time, acceleration, speed, np.cumsum(speed) / RATE)


def contact_loads(motion: Drive) -> Array:
    """Vertical contact load of each wheel.

    Returns
    -------
    (N, 4) ndarray
        N, up on the tire; wheels as in ``WHEELS``.
    """
    cleat_at = np.interp(CLEAT_TIME, motion.time, motion.distance)
    place = np.arange(round(ROAD_LENGTH / ROAD_STEP)) * ROAD_STEP
    cleat = np.where(np.abs(place - cleat_at) <= CLEAT_LENGTH / 2.0, CLEAT_HEIGHT, 0.0)
    patch = round(CONTACT_LENGTH / ROAD_STEP)
    tracks = [uniform_filter1d(track + cleat, patch, mode="wrap") for track in road()]
    loads = []
    for axle, behind in (("front", 0.0), ("rear", WHEELBASE)):
        static, transfer = _axle_load(axle, motion.acceleration)
        for track in tracks:
            height = np.interp(motion.distance - behind, place, track, period=ROAD_LENGTH)
            loads.append(quarter_car(motion.time, height - height[0], static, transfer))
    return np.column_stack(loads)


def _axle_load(axle: str, acceleration: Array) -> tuple[float, Array]:
    """A wheel's static load, and what acceleration adds to it without any dynamics [N]."""
    share, sign = (FRONT_SHARE, -1.0) if axle == "front" else (1.0 - FRONT_SHARE, 1.0)
    return MASS * GRAVITY * share / 2.0, sign * MASS * acceleration * CG_HEIGHT / (2.0 * WHEELBASE)


def quarter_car(time: Array, road_height: Array, static_load: float, body_load: Array) -> Array:
    """Contact load under a quarter-car.

    Parameters
    ----------
    time : (N,) ndarray
        s, evenly spaced.
    road_height : (N,) ndarray
        Under the wheel, m, 0 at the start.
    static_load : float
        N.
    body_load : (N,) ndarray
        Further force on the sprung mass, downward, N.

    Returns
    -------
    (N,) ndarray
        N. The solution is exact for inputs that are linear between the samples.
    """
    sprung = static_load / GRAVITY / (1.0 + UNSPRUNG)
    # States: heights of body and wheel about static equilibrium, then their velocities.
    a = [
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
        [-SPRING, SPRING, -DAMPER, DAMPER],
        [SPRING / UNSPRUNG, -(SPRING + TIRE) / UNSPRUNG, DAMPER / UNSPRUNG, -DAMPER / UNSPRUNG],
    ]
    b = [[0.0, 0.0], [0.0, 0.0], [0.0, -1.0], [TIRE / UNSPRUNG, 0.0]]
    c, d = [[0.0, -TIRE, 0.0, 0.0]], [[TIRE, 0.0]]
    inputs = np.column_stack([road_height, body_load / sprung])
    _, output, _ = lsim((a, b, c, d), inputs, time)
    load: Array = static_load + sprung * output
    return load


def tractions(motion: Drive, loads: Array) -> Array:
    """Longitudinal contact force of each wheel on its tire [N], (N, 4).

    Their sum is what accelerates the car and overcomes the air.
    """
    rolling = ROLLING_RESISTANCE * loads * np.minimum(motion.speed, 1.0)[:, None]
    wanted = MASS * motion.acceleration + DRAG * motion.speed**2 + rolling.sum(axis=1)
    driven = [0.5, 0.5, 0.0, 0.0]
    front, rear = BRAKE_FRONT_SHARE / 2.0, (1.0 - BRAKE_FRONT_SHARE) / 2.0
    braked = [front, front, rear, rear]
    return np.outer(np.maximum(wanted, 0.0), driven) + np.outer(np.minimum(wanted, 0.0), braked) - rolling


def wheel_speeds(motion: Drive, traction: Array) -> Array:
    """Speed of each wheel with the slip that its force needs [rad/s], (N, 4)."""
    static = [_axle_load(axle, motion.acceleration)[0] for axle in ("front", "front", "rear", "rear")]
    slip = traction / (SLIP_STIFFNESS * np.array(static))
    return motion.speed[:, None] / ROLLING_RADIUS * (1.0 + slip)


def make(folder: Path, force: bool = False) -> None:
    """Write the bag."""
    motion = drive()
    loads = contact_loads(motion)
    if loads.min() <= 0.0:
        raise AssertionError("a wheel leaves the ground; the quarter-car holds it there")
    traction = tractions(motion, loads)
    speeds = wheel_speeds(motion, traction)
    loads, traction = (np.round(forces / FORCE_STEP) * FORCE_STEP for forces in (loads, traction))
    speeds = np.round(speeds / SPEED_STEP) * SPEED_STEP

    story = {
        "road": "ISO 8608 class B, Gd(0.1 cycles/m) = 64e-6 m^3, waviness 2; a cleat of 20 mm by 75 mm",
        "load": "golden-car quarter-car at each corner; nothing here was measured",
    }
    joint_states = JointStateEncoder(WHEELS)
    wrenches = [WrenchEncoder(f"{wheel}_axle") for wheel in WHEELS]
    record = {"tire_dynamics.sample": story}
    with BagWriter(folder, force=force, aside=True, chunk_size=2**20, metadata=record) as bag:
        speed_topic = bag.add_topic("/joint_states", JOINT_STATE)
        load_topics = [bag.add_topic(f"/{wheel}/load", WRENCH_STAMPED) for wheel in WHEELS]
        for step in range(0, motion.time.size, RATE // LOAD_RATE):
            stamp = START * 10**9 + step * (10**9 // RATE)
            if step % (RATE // SPEED_RATE) == 0:
                bag.write(speed_topic, stamp, stamp, joint_states.encode(stamp, speeds[step].tolist()))
            for corner, topic in enumerate(load_topics):
                data = wrenches[corner].encode(stamp, traction[step, corner], loads[step, corner])
                bag.write(topic, stamp, stamp, data)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(description="Makes the sample input bag.")
    default = Path(__file__).parent / "sample"
    parser.add_argument("-o", "--output", type=Path, default=default, help="the rosbag2 folder to write")
    parser.add_argument("--force", action="store_true", help="replace it if it exists")
    options = parser.parse_args(arguments)
    try:
        make(options.output, options.force)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
