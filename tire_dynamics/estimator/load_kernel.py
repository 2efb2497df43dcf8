# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""The arithmetic of the load estimate: the Kalman filter over a car's equations of motion.

Everything that later results depend on is one array of numbers, :attr:`CarFilter.buffer`; its copy is the filter's
whole state. Every sum is taken in one order, and nothing calls LAPACK, BLAS or the C library's exponential: the same
calls give the same bits on every machine. Where this file runs interpreted the products of matrices are NumPy's, which
adds in the same order.

The file is long because it is one compiled class: prediction, corrections by each sensor and what is learnt on the way
share the filter's buffers, called as C functions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .load_equations import CarEquations, SensorNoise
from .vehicle_parameters import VehicleParameters

try:
    import cython
except ImportError:
    from ..science import cython_stand_in as cython
if cython.compiled:
    from cython.cimports.libc.math import sqrt
else:
    from math import sqrt

__all__ = ["CarFilter"]

FloatArray = NDArray[np.float64]

# places in the state, as load_equations has them
_N = cython.declare(cython.Py_ssize_t, 29)
_M = cython.declare(cython.Py_ssize_t, 18)  # those that change but by noise
_TIRE = cython.declare(cython.Py_ssize_t, 4)
_VELOCITY = cython.declare(cython.Py_ssize_t, 8)
_ROLL = cython.declare(cython.Py_ssize_t, 9)
_PITCH = cython.declare(cython.Py_ssize_t, 10)
_WHEEL = cython.declare(cython.Py_ssize_t, 11)
_ALONG = cython.declare(cython.Py_ssize_t, 15)
_ACROSS = cython.declare(cython.Py_ssize_t, 16)
_LIFT = cython.declare(cython.Py_ssize_t, 17)
_BIAS_Z = cython.declare(cython.Py_ssize_t, 18)
_BIAS_Y = cython.declare(cython.Py_ssize_t, 22)
_MASS = cython.declare(cython.Py_ssize_t, 23)
_MOMENT_ROLL = cython.declare(cython.Py_ssize_t, 24)
_MOMENT_PITCH = cython.declare(cython.Py_ssize_t, 25)
_INERTIA_ROLL = cython.declare(cython.Py_ssize_t, 26)
_INERTIA_PITCH = cython.declare(cython.Py_ssize_t, 27)
_TIP = cython.declare(cython.Py_ssize_t, 28)

_GRAVITY = cython.declare(cython.double, 9.80665)
_MANOEUVRE = cython.declare(cython.double, 2.0)  # intensity while nothing measures it [m/s^2 per sqrt s]: it stays
# within some 2.4 m/s^2
_ROUGHNESS = cython.declare(cython.double, 32e-6)  # Gd(0.1 cycles/m) before anything is learnt: between A and B [m^3]
_LEAST_ROUGHNESS = cython.declare(cython.double, 1e-8)
_MOST_ROUGHNESS = cython.declare(cython.double, 1e-2)
_EXCITES = cython.declare(cython.double, 2.0 * (math.pi * 0.1) ** 2)  # of the road: intensity per roughness and speed
_SHORTEST = cython.declare(cython.double, 0.1 / (2.0 * math.pi))  # a road has no waves below 0.1 m, a tire's contact:
# their inverse wavenumber [m]
_CREEP = cython.declare(cython.double, 0.05)  # a car that stands may still be loaded: as much as at this speed [m/s]
_USUAL_SPEED = cython.declare(cython.double, 15.0)  # where nothing tells the speed [m/s]
_LEARNING_TIME = cython.declare(cython.double, 10.0)  # within which what was learnt is forgotten [s]
_CLIPPED = cython.declare(cython.double, 0.08)  # how long a damper is off its line [s]: while a wheel hops, 4 m/c
_BALANCE = cython.declare(cython.double, 60.0)  # below which the wheels' momentum is balanced [rad/s]
_OUTLIER = cython.declare(cython.double, 9.0)  # a squared normalised innovation beyond is taken as this one when the
# roughness is learnt
_HALF_LINE = cython.declare(cython.double, 2.0 / math.pi)
_MOST = cython.declare(cython.Py_ssize_t, 5)  # measurements at once


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _decay(exponent: cython.double) -> cython.double:
    """exp(-exponent) within 1e-6 for exponents up to 0.3, without the C library."""
    even: cython.double = 1.0 + exponent * exponent / 12.0
    odd: cython.double = exponent / 2.0
    return (even - odd) / (even + odd)


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _vanish(exponent: cython.double) -> cython.double:
    """exp(-exponent) for exponents up to 4, as (exp(-exponent/16))^16."""
    value: cython.double = _decay(exponent / 16.0)
    value *= value
    value *= value
    value *= value
    return value * value


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _beyond(value: cython.double, variance: cython.double) -> cython.double:
    """The share of a value's square that is beyond that of two standard deviations."""
    square: cython.double = value * value
    if square <= 4.0 * variance:
        return 0.0
    return 1.0 - 4.0 * variance / square


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _product(
    out: cython.double[::1],
    left: cython.double[::1],
    along: cython.Py_ssize_t,
    down: cython.Py_ssize_t,
    right: cython.double[::1],
    inner: cython.Py_ssize_t,
    rows: cython.Py_ssize_t,
    columns: cython.Py_ssize_t,
) -> cython.void:
    """out_ij = sum_k left[k along + i down] right_kj, over k in its order; rows of ``out`` and ``right`` are whole."""
    if cython.compiled:
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        k: cython.Py_ssize_t
        factor: cython.double
        for i in range(rows):
            factor = left[i * down]
            for j in range(columns):
                out[i * columns + j] = factor * right[j]
            for k in range(1, inner):
                factor = left[k * along + i * down]
                if factor != 0.0:  # as half of the equations' are
                    for j in range(columns):
                        out[i * columns + j] += factor * right[k * columns + j]
    elif rows * columns < 8:  # one behind the other, where NumPy would add in pairs
        for i in range(rows):
            for j in range(columns):
                total = left[i * down] * right[j]
                for k in range(1, inner):
                    total += left[k * along + i * down] * right[k * columns + j]
                out[i * columns + j] = total
    else:
        places = np.arange(inner)[:, None] * along + np.arange(rows) * down
        factors = np.asarray(left)[places]
        terms = factors[:, :, None] * np.asarray(right)[: inner * columns].reshape(inner, 1, columns)
        np.add.reduce(terms, axis=0, out=np.asarray(out)[: rows * columns].reshape(rows, columns))


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _carry(p: cython.double[::1], left: cython.double[::1], both: cython.double[::1]) -> cython.void:
    """P of (1 + F) P (1 + F'), with F P and F P F' given; both its halves the same."""
    if cython.compiled:
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        for i in range(_M):
            for j in range(_N):
                p[i * _N + j] += left[i * _N + j]
        for i in range(_M):
            for j in range(_N):
                p[j * _N + i] += left[i * _N + j]
        for i in range(_M):
            for j in range(_M):
                p[i * _N + j] += both[i * _M + j]
        for i in range(_N):
            for j in range(i):  # what rounding makes of the two would grow apart
                p[i * _N + j] = (p[i * _N + j] + p[j * _N + i]) * 0.5
                p[j * _N + i] = p[i * _N + j]
    else:
        matrix, change = np.asarray(p).reshape(_N, _N), np.asarray(left).reshape(_M, _N)
        matrix[:_M] += change
        matrix[:, :_M] += change.T
        matrix[:_M, :_M] += np.asarray(both).reshape(_M, _M)
        matrix += matrix.T
        matrix *= 0.5


@cython.cclass
class CarFilter:
    """One Kalman filter over heave, pitch, roll and four wheels on a road that is integrated white noise.

    Parameters
    ----------
    vehicle : VehicleParameters
    noise : SensorNoise

    Attributes
    ----------
    buffer : ndarray
        The whole state.

    Notes
    -----
    The equations are those of :class:`.load_equations.CarEquations`. What updates add to a wheel's momentum was load
    as well; below ``_BALANCE`` it is counted as such, and its variance with it. It does not depend on the present
    error, as innovations are white.

    A damper of two slopes is taken at the mean and the variance of its speed, as the best line through it: with r the
    speed, c (r) r ~ c_mean r + c_half sqrt(r^2 + 2 var/pi). What it is off that line, c_half^2 var (1 - 2/pi) where r
    is 0, is noise of the forces, and of the accelerations that are measured.

    An accelerometer on the body leans with it, so that its vertical axis sees some of the specific forces along and
    across; like the lever of the body's weight this is as much as ``_TIP`` says.
    """

    buffer = cython.declare(object, visibility="readonly")
    x: cython.double[::1]
    p: cython.double[::1]
    a: cython.double[::1]
    b: cython.double[::1]
    balance: cython.double[::1]
    spread: cython.double[::1]
    clipped: cython.double[::1]
    learnt: cython.double[::1]
    innovations: cython.double[::1]
    constant: cython.double[::1]
    rate: cython.double[::1]
    push: cython.double[::1]
    damp: cython.double[::1]
    half: cython.double[::1]
    mean: cython.double[::1]
    warp: cython.double[::1]
    tilt: cython.double[::1]
    drift: cython.double[::1]
    start: cython.double[::1]
    road: cython.double[::1]
    masses: cython.double[::1]
    see_imu: cython.double[::1]
    see_travel: cython.double[::1]
    see_hub: cython.double[::1]
    see_force: cython.double[::1]
    noise_imu: cython.double[::1]
    noise_travel: cython.double[::1]
    noise_hub: cython.double[::1]
    noise_force: cython.double[::1]
    change: cython.double[::1]
    left: cython.double[::1]
    both: cython.double[::1]
    few: cython.double[::1]
    innovation: cython.double[::1]
    noise: cython.double[::1]
    see: cython.double[::1]
    seen: cython.double[::1]
    covariance: cython.double[::1]
    lower: cython.double[::1]
    inverse: cython.double[::1]
    variance: cython.double[::1]
    fresh: cython.double[::1]
    white: cython.double[::1]
    gain: cython.double[::1]
    acceleration: cython.double
    acceleration_hub: cython.double
    moment_roll: cython.double
    moment_pitch: cython.double
    leans: cython.double
    dives: cython.double
    bank: cython.double
    static: cython.double[::1]
    tire: cython.double[::1]
    carried: cython.double[::1]
    links: cython.double[::1]
    past: cython.double[::1]
    height: cython.double
    lift: cython.double

    def __init__(self, vehicle: VehicleParameters, noise: SensorNoise) -> None:
        car = CarEquations(vehicle, noise)
        sizes = {"x": _N, "p": _N * _N, "a": _N * _M, "b": 7, "balance": 4, "spread": 4, "clipped": 4}
        sizes |= {"learnt": 7, "innovations": 8}
        self.buffer = np.zeros(sum(sizes.values()))
        views, begin = {}, 0
        for name, size in sizes.items():
            views[name] = self.buffer.data[begin : begin + size]
            begin += size
        self.x, self.p = views["x"], views["p"]
        self.a = views["a"]  # transposed: column i has what drives state i
        self.b = views["b"]
        self.balance, self.spread = views["balance"], views["spread"]
        self.clipped = views["clipped"]  # variance of what each damper's force is off its line [N^2]
        self.learnt = views["learnt"]  # roughness, its information, manoeuvres^2, its information, speed, is
        # it known, time since the hubs were seen [s]
        self.innovations = views["innovations"]  # each source's sum and number of squares, fading
        self.constant, self.rate, self.push = _flat(car.constant), _flat(car.rate), _flat(car.push)
        self.damp, self.half, self.mean = _flat(car.damp), _flat(car.damper_half), _flat(car.damper_mean)
        self.warp, self.tilt, self.drift, self.start = map(_flat, (car.warp, car.tilt, car.drift, car.start))
        self.road, self.masses = _flat(car.road), _flat(car.masses)
        self.see_imu, self.see_travel, self.see_force = map(_flat, (car.see_imu, car.see_travel, car.see_force))
        self.see_hub = np.zeros(_N * 4).data
        self.noise_imu, self.noise_travel = np.array(car.noise["imu"]).data, np.array(car.noise["travel"]).data
        self.noise_hub, self.noise_force = np.array(car.noise["hub"]).data, np.array(car.noise["force"]).data
        self.acceleration, self.acceleration_hub = car.noise["imu"][0], car.noise["hub"][0]
        self.moment_roll, self.moment_pitch = car.moment
        self.leans, self.dives = car.leans, car.dives
        self.bank = car.bank
        self.static, self.tire, self.carried = _flat(car.static), _flat(car.tire), _flat(car.carried)
        self.links, self.past, self.height = _flat(car.links), _flat(car.past), noise.height
        self.lift = car.lift
        self.change, self.left, self.both = np.zeros(_N * _M).data, np.zeros(_M * _N).data, np.zeros(_M * _M).data
        self.few = np.zeros(64).data
        self.innovation, self.noise = np.zeros(5).data, np.zeros(5).data
        self.see, self.seen, self.gain = np.zeros(_N * 5).data, np.zeros(5 * _N).data, np.zeros(5 * _N).data
        self.covariance, self.lower, self.inverse = np.zeros(25).data, np.zeros(25).data, np.zeros(25).data
        self.variance, self.fresh, self.white = np.zeros(5).data, np.zeros(5).data, np.zeros(5).data
        self.reset()

    # -- beginnings -----------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Forget everything."""
        i: cython.Py_ssize_t
        self.buffer[:] = 0.0
        for i in range(_N * _N):
            self.p[i] = self.start[i]
        self.x[_TIP] = 0.5  # between none and all of it
        self.learnt[0], self.learnt[1] = _ROUGHNESS, 10.0
        self.learnt[2], self.learnt[3] = _MANOEUVRE * _MANOEUVRE, 10.0
        self.learnt[4], self.learnt[5], self.learnt[6] = _USUAL_SPEED, 0.0, 1.0
        self.linearise(True)

    def restart(self) -> None:
        """Forget the motion; what was learnt of mass, biases and road is kept."""
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        for i in range(_M):
            self.x[i] = 0.0
            for j in range(_N):
                self.p[i * _N + j] = self.p[j * _N + i] = 0.0
        for i in range(_M):
            self.p[i * _N + i] = self.start[i * _N + i]
        for i in range(4):
            self.balance[i] = self.spread[i] = 0.0
        self.learnt[6] = 1.0
        self.linearise(True)

    # -- through time ---------------------------------------------------------------------------------------

    @property
    def speed(self) -> float:
        """The car's speed [m/s], a usual one while nothing tells it."""
        return self.learnt[4]

    def set_speed(self, speed: float) -> None:
        """Say the car's speed [m/s]."""
        self.learnt[4], self.learnt[5] = speed, 1.0

    @property
    def roughness(self) -> float:
        """Gd(0.1 cycles/m) of the road, as learnt [m^3]."""
        return self.learnt[0]

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def linearise(self, weighs: cython.bint) -> cython.void:
        """The equations at the present state; ``weighs``: whether the motion of the body tells its mass."""
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        w: cython.Py_ssize_t
        r: cython.double
        total: cython.double
        size: cython.double
        slope: cython.double
        along: cython.double = self.x[_ALONG]
        across: cython.double = self.x[_ACROSS]
        tip: cython.double = self.x[_TIP]
        lean: cython.double
        dive: cython.double
        # few: spread of the ways' rates (7, 4) from 0, damping in force (4) from 28, what is left of its force from 32
        for j in range(7):
            for w in range(4):
                total = self.rate[w] * self.p[_VELOCITY * _N + _VELOCITY + j]
                for i in range(1, 7):
                    total += self.rate[i * 4 + w] * self.p[(_VELOCITY + i) * _N + _VELOCITY + j]
                self.few[j * 4 + w] = total
        for w in range(4):
            r = self.rate[w] * self.x[_VELOCITY]
            total = self.few[w] * self.rate[w]
            for i in range(1, 7):
                r += self.rate[i * 4 + w] * self.x[_VELOCITY + i]
                total += self.few[i * 4 + w] * self.rate[i * 4 + w]
            size = sqrt(r * r + max(total, 0.0) * _HALF_LINE + 1e-8)
            slope = r / size
            self.few[28 + w] = self.mean[w] + self.half[w] * slope
            self.few[32 + w] = self.half[w] * (size - slope * r)
            size = self.half[w] * self.half[w] * (1.0 - _HALF_LINE) * max(total, 0.0)
            self.clipped[w] = (1.0 - slope * slope) * size
        for j in range(7):
            total = self.push[j] * self.few[32]
            for w in range(1, 4):
                total += self.push[w * 7 + j] * self.few[32 + w]
            self.b[j] = total
        for i in range(_N * _M):
            self.a[i] = self.constant[i]
        for i in range(7):
            for j in range(7):
                total = self.damp[i * 7 + j] * self.few[28]
                for w in range(1, 4):
                    total += self.damp[(w * 7 + i) * 7 + j] * self.few[28 + w]
                self.a[(_VELOCITY + i) * _M + _VELOCITY + j] += total
        for i in range(8):
            for w in range(4):
                self.a[i * _M + _TIRE + w] -= self.warp[i * 4 + w] * self.learnt[4]
        # A specific force tells of its moment as far as it is more than its error: the one that explains best why noise
        # moves no body is none.
        clear_across: cython.double = _beyond(across, self.p[_ACROSS * _N + _ACROSS])
        clear_along: cython.double = _beyond(along, self.p[_ALONG * _N + _ALONG])
        moment_roll: cython.double = self.moment_roll * (1.0 + self.x[_MOMENT_ROLL])
        moment_pitch: cython.double = self.moment_pitch * (1.0 + self.x[_MOMENT_PITCH])
        self.a[_ACROSS * _M + _ROLL] = moment_roll
        self.a[_ALONG * _M + _PITCH] = moment_pitch
        if weighs:
            lean, dive = self.tilt[0] * self.x[0], self.tilt[1] * self.x[0]
            for i in range(1, 8):
                lean += self.tilt[2 * i] * self.x[i]
                dive += self.tilt[2 * i + 1] * self.x[i]
            for i in range(8):
                self.a[i * _M + _ROLL] += self.tilt[2 * i] * (moment_roll * _GRAVITY * tip)
                self.a[i * _M + _PITCH] -= self.tilt[2 * i + 1] * (moment_pitch * _GRAVITY * tip)
        else:
            lean, dive = across * self.leans / _GRAVITY, -along * self.dives / _GRAVITY
            moment_roll *= tip * self.leans
            moment_pitch *= tip * self.dives
            self.a[_ACROSS * _M + _ROLL] += moment_roll
            self.a[_ALONG * _M + _PITCH] += moment_pitch
        for j in range(3):
            i = _VELOCITY + j
            inverse: cython.double = 1.0 / max(1.0 + self.x[_MASS if j == 0 else _INERTIA_ROLL - 1 + j], 0.5)
            total = 0.0
            for w in range(_M):
                self.a[w * _M + i] *= inverse
                total += self.a[w * _M + i] * self.x[w]
            self.b[j] *= inverse
            # the acceleration: errors are linear about it
            rate: cython.double = -(total + self.b[j]) * inverse if weighs else 0.0
            if j == 0:
                self.a[_MASS * _M + i] = rate
                self.b[j] -= rate * self.x[_MASS]
            else:
                slope = (self.moment_roll if j == 1 else self.moment_pitch) * inverse
                slope *= clear_across if j == 1 else clear_along
                r = across + _GRAVITY * tip * lean if j == 1 else along - _GRAVITY * tip * dive
                total = lean if j == 1 else -dive
                total *= (1.0 + self.x[_MOMENT_ROLL - 1 + j]) * _GRAVITY
                self.a[(_MOMENT_ROLL - 1 + j) * _M + i] = slope * r
                self.a[_TIP * _M + i] = slope * total
                self.a[(_INERTIA_ROLL - 1 + j) * _M + i] = rate
                self.b[j] -= slope * r * self.x[_MOMENT_ROLL - 1 + j] + slope * total * tip
                self.b[j] -= rate * self.x[_INERTIA_ROLL - 1 + j]

    def predict(
        self, step: cython.double, count: cython.Py_ssize_t, measured: cython.bint, weighs: cython.bint
    ) -> None:
        """Go on in time.

        Parameters
        ----------
        step : float
            [s], at most some 3 ms.
        count : int
            Of steps.
        measured : bool
            Whether an IMU tells the specific forces.
        weighs : bool
            Whether the ways of the springs are measured, so that the motion of the body tells its mass.
        """
        _: cython.Py_ssize_t
        for _ in range(count):
            self.go_on(step, measured, weighs)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def go_on(self, step: cython.double, measured: cython.bint, weighs: cython.bint) -> cython.void:
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        half: cython.double = step * step / 2.0
        intensity: cython.double
        spread: cython.double
        pull: cython.double
        fade: cython.double
        w: cython.Py_ssize_t
        self.linearise(weighs)
        # few: the state's rate (18); left: the rate of that (18)
        _product(self.few, self.x, 1, 0, self.a, _N, 1, _M)
        for i in range(7):
            self.few[_VELOCITY + i] += self.b[i]
        _product(self.left, self.few, 1, 0, self.a, _M, 1, _M)
        for i in range(_M):
            self.x[i] += step * self.few[i] + half * self.left[i]
        _product(self.change, self.a, 1, _M, self.a, _M, _N, _M)
        for i in range(_N * _M):
            self.change[i] = self.change[i] * half + step * self.a[i]
        _product(self.left, self.change, _M, 1, self.p, _N, _M, _N)
        _product(self.both, self.left, 1, _N, self.change, _N, _M, _M)
        _carry(self.p, self.left, self.both)
        intensity = _EXCITES * self.learnt[0] * (self.learnt[4] + _CREEP) * step
        # mean of 1 - exp(-w t) over the step, t since the hubs were seen
        fade = (self.learnt[4] + _CREEP) / _SHORTEST * (self.learnt[6] + 0.5 * step)
        if fade < 4.0:
            intensity *= 1.0 - _vanish(fade)
        self.learnt[6] = min(self.learnt[6] + step, 1.0)
        # white noise that is integrated twice within the step: h, h^2/2 and h^3/3 of it, if a tire's force is all that
        # moves a wheel within a step
        for i in range(4):
            for j in range(4):
                spread = self.road[i * 4 + j] * intensity
                self.p[(_TIRE + i) * _N + _TIRE + j] += spread
                pull = self.tire[j] / self.masses[j] * step
                self.p[(_TIRE + i) * _N + _WHEEL + j] += spread * pull / 2.0
                self.p[(_WHEEL + j) * _N + _TIRE + i] += spread * pull / 2.0
                pull *= self.tire[i] / self.masses[i] * step
                self.p[(_WHEEL + i) * _N + _WHEEL + j] += spread * pull / 3.0
        for i in range(_N):
            self.p[i * _N + i] += self.drift[i] * step
        for w in range(4):
            spread = self.clipped[w] * _CLIPPED * step
            for i in range(7):
                for j in range(7):
                    self.p[(_VELOCITY + i) * _N + _VELOCITY + j] += spread * self.push[w * 7 + i] * self.push[w * 7 + j]
        self.p[_BIAS_Y * _N + _BIAS_Y] += self.bank * intensity
        intensity = self.learnt[2] if measured else _MANOEUVRE * _MANOEUVRE
        for i in range(_ALONG, _ACROSS + 1):
            self.p[i * _N + i] += intensity * step
            spread = self.x[i] * self.x[i]
            self.p[_LIFT * _N + _LIFT] += self.lift * spread * step
        fade = _decay(_BALANCE * step)
        for i in range(4):
            self.balance[i] *= fade
            self.spread[i] *= fade * fade
        fade = _decay(step / _LEARNING_TIME)
        self.learnt[1] *= fade
        self.learnt[3] *= fade
        for i in range(8):
            self.innovations[i] *= fade

    # -- what is measured -----------------------------------------------------------------------------------

    def take_imu(self, values: Sequence[float]) -> None:
        """Specific force x, y, z [m/s^2], roll rate and pitch rate [rad/s]; NaN where one is not known."""
        i: cython.Py_ssize_t
        # the body leans, and its vertical axis sees some of what acts along and across
        lean: cython.double = self.tilt[0] * self.x[0]
        dive: cython.double = self.tilt[1] * self.x[0]
        tip: cython.double = self.x[_TIP]
        along: cython.double = self.x[_ALONG]
        across: cython.double = self.x[_ACROSS]
        for i in range(1, 8):
            lean += self.tilt[2 * i] * self.x[i]
            dive += self.tilt[2 * i + 1] * self.x[i]
        for i in range(_N):
            self.see_imu[i * 5] = self.a[i * _M + _VELOCITY]
        _product(self.few, self.x, 1, 0, self.see_imu, _N, 1, 5)
        self.innovation[0] = values[2] - _GRAVITY - self.b[0] - self.few[0] - self.x[_BIAS_Z]
        self.innovation[0] -= tip * (along * dive - across * lean)
        for i in range(8):
            self.see_imu[i * 5] += tip * (along * self.tilt[2 * i + 1] - across * self.tilt[2 * i])
        self.see_imu[_ALONG * 5] += tip * dive
        self.see_imu[_ACROSS * 5] -= tip * lean
        self.see_imu[_TIP * 5] += along * dive - across * lean
        self.see_imu[_BIAS_Z * 5] = 1.0
        self.innovation[1] = values[0] - self.few[1]
        self.innovation[2] = values[1] - self.few[2]
        self.innovation[3] = values[3] - self.few[3]
        self.innovation[4] = values[4] - self.few[4]
        self.noise_imu[0] = self.acceleration
        for i in range(4):
            self.noise_imu[0] += self.clipped[i] * self.push[i * 7] * self.push[i * 7]
        self.update(1, 5, self.see_imu, self.noise_imu)

    def take_travel(self, values: Sequence[float]) -> None:
        """Ways of the springs from rest, compression positive [m]; NaN where one is not known."""
        i: cython.Py_ssize_t
        for i in range(4):
            self.innovation[i] = values[i] - self.x[i]
        self.update(2, 4, self.see_travel, self.noise_travel)

    def take_hub(self, values: Sequence[float]) -> None:
        """Vertical specific force of the unsprung masses [m/s^2]; NaN where one is not known."""
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        for i in range(_N):
            for j in range(4):
                self.see_hub[i * 4 + j] = self.a[i * _M + _WHEEL + j]
        _product(self.few, self.x, 1, 0, self.see_hub, _N, 1, 4)
        for i in range(4):
            self.innovation[i] = values[i] - _GRAVITY - (self.few[i] + self.b[3 + i])
            self.noise_hub[i] = self.acceleration_hub + self.clipped[i] / (self.masses[i] * self.masses[i])
        self.update(3, 4, self.see_hub, self.noise_hub)
        self.learnt[6] = 0.0

    def take_force(self, along: cython.double, across: cython.double) -> None:
        """Specific force in the road's plane [m/s^2], as wheel speeds tell it."""
        self.innovation[0] = along - self.x[_ALONG]
        self.innovation[1] = across - self.x[_ACROSS]
        self.update(0, 2, self.see_force, self.noise_force)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def update(
        self,
        source: cython.Py_ssize_t,
        width: cython.Py_ssize_t,
        see: cython.double[::1],
        noise: cython.double[::1],
    ) -> cython.void:
        """Take the measurements of a source at once, each after those before it, those left out that are not known.

        All but specific forces tell the road's roughness, those of an IMU how strong manoeuvres are.
        """
        i: cython.Py_ssize_t
        j: cython.Py_ssize_t
        k: cython.Py_ssize_t
        count: cython.Py_ssize_t = 0
        place: cython.Py_ssize_t
        value: cython.double
        prior: cython.double
        e: cython.double
        for k in range(width):
            if self.innovation[k] == self.innovation[k]:
                count += 1
        if count == 0:
            return
        j = 0
        for k in range(width):
            if self.innovation[k] == self.innovation[k]:
                self.innovation[j], self.noise[j] = self.innovation[k], noise[k]
                self.white[j] = k
                for i in range(_N):
                    self.see[i * count + j] = see[i * width + k]
                j += 1
        _product(self.seen, self.see, count, 1, self.p, _N, count, _N)
        _product(self.covariance, self.seen, 1, _N, self.see, _N, count, count)
        # L D L' of the innovations' covariance: D and e are those of each measurement after the ones before
        for i in range(count):
            prior, e = self.covariance[i * count + i], self.innovation[i]
            for j in range(i):
                value = self.covariance[i * count + j]
                for k in range(j):
                    value -= self.lower[i * _MOST + k] * self.lower[j * _MOST + k] * self.variance[k]
                value /= self.variance[j]
                self.lower[i * _MOST + j] = value
                prior -= value * value * self.variance[j]
                e -= value * self.fresh[j]
            prior = max(prior, 0.0)
            self.variance[i] = prior + self.noise[i]
            self.fresh[i] = e
            for k in range(count):
                self.inverse[i * _MOST + k] = 1.0 if k == i else 0.0
            for j in range(i):
                for k in range(j + 1):
                    self.inverse[i * _MOST + k] -= self.lower[i * _MOST + j] * self.inverse[j * _MOST + k]
            value = e * e / self.variance[i]
            self.innovations[2 * source] += value
            self.innovations[2 * source + 1] += 1.0
            if source > 0:
                place = 2 if source == 1 and (self.white[i] == 1.0 or self.white[i] == 2.0) else 0
                self.learn(place, value, prior / self.variance[i])
        for i in range(count):
            value = 1.0 / sqrt(self.variance[i])
            self.white[i] = self.fresh[i] * value
            for k in range(count):
                self.covariance[k * count + i] = self.inverse[i * _MOST + k] * value
        _product(self.gain, self.covariance, count, 1, self.seen, count, count, _N)
        # few: what the measurements add to the state (29)
        _product(self.few, self.white, 1, 0, self.gain, count, 1, _N)
        for i in range(_N):
            self.x[i] += self.few[i]
        self.lessen(count)
        for i in range(4):
            value, e = 0.0, 0.0
            for k in range(count):
                prior = self.gain[k * _N + _WHEEL + i] * (self.masses[i] * _BALANCE)
                value += prior * self.white[k]
                e += prior * prior
            self.balance[i] += value
            self.spread[i] += e

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def lessen(self, count: cython.Py_ssize_t) -> cython.void:
        """P - G' G, with a row of G for each measurement."""
        if cython.compiled:
            i: cython.Py_ssize_t
            j: cython.Py_ssize_t
            k: cython.Py_ssize_t
            for i in range(_N):
                for j in range(_N):
                    self.few[j] = self.gain[i] * self.gain[j]
                for k in range(1, count):
                    for j in range(_N):
                        self.few[j] += self.gain[k * _N + i] * self.gain[k * _N + j]
                for j in range(_N):
                    self.p[i * _N + j] -= self.few[j]
        else:
            gain = np.asarray(self.gain)[: count * _N].reshape(count, _N)
            matrix = np.asarray(self.p).reshape(_N, _N)
            matrix -= np.add.reduce(gain[:, :, None] * gain[:, None, :], axis=0)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def learn(self, place: cython.Py_ssize_t, square: cython.double, share: cython.double) -> cython.void:
        """An intensity of noise from an innovation: its normalised square, and the share of the process in its
        variance.

        A step of Newton's method on the likelihood, with the information of the last ten seconds.
        """
        information: cython.double = self.learnt[place + 1] + 0.5 * share * share
        step: cython.double = 0.5 * share * (min(square, _OUTLIER) - 0.99) / information
        intensity: cython.double = self.learnt[place] * (_decay(-step) if step < 0.3 else 1.35)
        self.learnt[place + 1] = information
        if place == 0:
            self.learnt[0] = min(max(intensity, _LEAST_ROUGHNESS), _MOST_ROUGHNESS)
        else:
            self.learnt[2] = min(max(intensity, 1e-4), 100.0)

    # -- what is asked --------------------------------------------------------------------------------------

    def loads(self) -> tuple[list[float], list[float]]:
        """Load of each tire and its standard deviation [N]."""
        i: cython.Py_ssize_t
        load: cython.double
        variance: cython.double
        # Links carry past the springs what these do not have of the mass's moment. Its heights are parameters.
        share: cython.double = self.x[_MASS] - self.x[_MOMENT_PITCH]
        doubt: cython.double = self.height * self.height + self.p[_MASS * _N + _MASS]
        doubt += self.p[_MOMENT_PITCH * _N + _MOMENT_PITCH] - 2.0 * self.p[_MASS * _N + _MOMENT_PITCH]
        loads: list[float] = [0.0, 0.0, 0.0, 0.0]
        deviations: list[float] = [0.0, 0.0, 0.0, 0.0]
        for i in range(4):
            load = self.static[i] + self.carried[i] * self.x[_MASS] + self.tire[i] * self.x[_TIRE + i]
            load += self.balance[i]
            variance = self.tire[i] * self.tire[i] * self.p[(_TIRE + i) * _N + _TIRE + i]
            variance += self.carried[i] * self.carried[i] * self.p[_MASS * _N + _MASS]
            variance += 2.0 * self.tire[i] * self.carried[i] * self.p[(_TIRE + i) * _N + _MASS]
            along, across = self.past[i] * self.x[_ALONG], self.links[i] * self.x[_ACROSS]
            load += along * share
            variance += self.spread[i] + along * along * doubt + across * across
            loads[i] = max(load, 0.0)
            deviations[i] = sqrt(max(variance, 0.0))
        return loads, deviations

    def mass_error(self) -> tuple[float, float]:
        """Relative error of the mass and its standard deviation."""
        return self.x[_MASS], math.sqrt(max(self.p[_MASS * _N + _MASS], 0.0))

    def consistency(self) -> list[float]:
        """Mean of the squared normalised innovations of wheel speeds, IMU, travel and hubs, over some ten seconds.

        1 where equations and noise are as the parameters say; NaN of a source without samples.
        """
        each = [(self.innovations[2 * k], self.innovations[2 * k + 1]) for k in range(4)]
        return [total / number if number > 0.5 else math.nan for total, number in each]


def _flat(array: FloatArray) -> memoryview:
    return array.reshape(-1).data
