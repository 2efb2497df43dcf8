"""The numbers of the figures: one function per figure, all for the tire of Table 1.

A table is a dict of columns, all of one length, the first being the abscissa. A column's name says what it is,
for which case, and in which unit. Equation numbers are those of Huang & Hsu (1992).
"""

from __future__ import annotations

import csv
import math
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from ..estimator.simulate import simulate
from ..science import ring, wheel
from ..science.campbell import WAVES, WHEEL_MODES, campbell_exponents, wheel_exponents
from ..science.coefficients import Model
from ..science.nonuniform import (
    CombinationResonance,
    Nonuniformity,
    combination_resonances,
    tongue_map,
    tongue_threshold,
)
from ..science.unit import MODAL, REACTION, TireWheelUnit
from .measured_tire import table as measured_tire  # noqa: F401 - looked up here by name
from .road_tables import campbell_contact, cleat, force_variation, load_or_road  # noqa: F401 - looked up here by name

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Table = dict[str, FloatArray]

TURN = 2.0 * math.pi  # [rad]
RPM = TURN / 60.0  # [rad/s]
LOAD = 1961.33  # 200 kgf [N]

BELT_MODELS: tuple[Model, ...] = ("inextensional", "hybrid")  # the paper's "rotating" and "hybrid"
FIG3_RPM = (0, 800, 1600, 3600)
FIG3_ZETA_N = (0.02, 0.2)  # of the paper's caption; of its text
FIG4_MODES = (2, 3, 4)
FIG5_CASES = ((0, 0.05), (2000, 0.05), (2000, 0.5))  # speed [rpm], zeta_s
FIG6_ZETA_1 = (0.02, 0.05, 0.1, 0.2, 0.5)
FIG7_ZETA_S = (0.05, 0.5)
DAMPINGS = (MODAL, REACTION)
WHEEL_MODELS: tuple[wheel.Model, ...] = ("inextensional", "complete")
CAMPBELL_MODES = (2, 3, 4)
TONGUE_ZETA = (0.0, 0.05)  # zeta_1 and zeta_s
TONGUE_EPS = tuple(round(0.24 * k / 30, 6) for k in range(31))

SIDES = {"plus": 1.0, "minus": -1.0}  # what Omega adds to their frequencies on the ring


def fig3() -> Table:
    """Steady deflection of the belt by modes 2 to 30, the load standing at the contact (4.5), for both zeta_n."""
    angle = np.linspace(-180.0, 180.0, 721)
    table = {"angle_from_contact_deg": angle}
    for zeta_n, model, rpm in product(FIG3_ZETA_N, BELT_MODELS, FIG3_RPM):
        unit = TireWheelUnit.table_1(zeta_n=zeta_n)
        both = ring.steady_response(unit, rpm * RPM, LOAD, ring.CONTACT_ANGLE + np.radians(angle), model=model)
        for name, deflection in zip(("u_z", "u_theta"), both, strict=True):
            table[f"{name}_{model}_{rpm}_rpm_zeta_n_{zeta_n}_mm"] = 1e3 * deflection
    return table


def fig4() -> Table:
    """Amplitude of each mode over its static one, its lag angle, and the stiffness that it sets against the load.

    The stiffness is that of the undamped mode to a force fixed in space, R_n of (4.4) over the modal force. Where
    it is zero the speed is critical.
    """
    unit = TireWheelUnit.table_1(zeta_n=0.2)
    undamped = unit.replace(zeta_n=0.0)
    modes = np.array(FIG4_MODES)
    speed = np.linspace(0.0, 6000.0, 301)
    table = {"speed_rpm": speed}
    for model in BELT_MODELS:
        amplitudes = [ring.steady_amplitudes(unit, modes, rpm * RPM, LOAD, model=model) for rpm in speed]
        cosine, sine = np.moveaxis(np.array(amplitudes), 1, 0)  # (speeds, modes) each
        amplitude = np.hypot(cosine, sine)
        phase = np.arctan2(-sine, -cosine)  # the load pushes inward: u_z = -amplitude cos(n (psi - psi_0) - phase)
        amplitudes = [ring.steady_amplitudes(undamped, modes, rpm * RPM, LOAD, model=model) for rpm in speed]
        compliance = np.array(amplitudes)[:, 0]
        for column, n in enumerate(FIG4_MODES):
            table[f"amplitude_ratio_{model}_n_{n}"] = amplitude[:, column] / amplitude[0, column]
            table[f"lag_{model}_n_{n}_deg"] = np.degrees(phase[:, column]) / n
            table[f"stiffness_ratio_{model}_n_{n}"] = compliance[0, column] / compliance[:, column]
    return table


def hybrid_critical_speed(unit: TireWheelUnit, n: int) -> float:
    """Where the hybrid's mode n resonates with a force fixed in space, R_n = 0 of (4.4) [rad/s].

    Notes
    -----
    There the mode's wave runs backward around the ring as fast as the ring turns, so that it stands in space. In
    the limit of large K, g_n = omega_n^2 + n^2 Omega^2 (n^2 - 3)/(n^2 + 1) and this is at
    (omega_n/2) sqrt(1 + 1/n^2), well below omega_n.
    """

    def excess(speed: float) -> float:
        return float(ring.natural_frequencies(unit, n, speed, "hybrid")[0]) - n * speed

    return float(optimize.brentq(excess, 0.0, float(ring.rest_frequency(unit, n))))


def fig5() -> Table:
    """Wheel and ring centre after the load is put on at once; x_c and y_c in the paper's axes, X = -x_ros."""
    time = np.linspace(0.0, 1.0, 2001)
    table = {"time_s": time}
    for rpm, zeta_s in FIG5_CASES:
        unit = TireWheelUnit.table_1(zeta_1=0.05, zeta_s=zeta_s)
        response = simulate(unit, time, rpm * RPM, LOAD, initial="rest")
        case = f"{rpm}_rpm_zeta_s_{zeta_s}_mm"
        table[f"y_{case}"] = 1e3 * response.wheel_displacement
        table[f"x_c_{case}"] = -1e3 * response.ring_centre[:, 0]
        table[f"y_c_{case}"] = 1e3 * response.ring_centre[:, 1]
    return table


def fig6() -> Table:
    """Steady force on the suspension over the load, K = F'/F."""
    speed = np.linspace(0.0, 4000.0, 201)
    table = {"speed_rpm": speed}
    for zeta_1 in FIG6_ZETA_1:
        table[f"K_zeta_1_{zeta_1}"] = np.asarray(
            wheel.transmissibility(TireWheelUnit.table_1(zeta_1=zeta_1), speed * RPM)
        )
    return table


def fig7a() -> Table:
    """The speed at which stability is lost, by zeta_1; drawn along the horizontal axis up to 6 000 rpm."""
    zeta_1 = _damping_ratios()
    table = {"zeta_1": zeta_1}
    for zeta_s in FIG7_ZETA_S:
        table[f"critical_speed_zeta_s_{zeta_s}_rpm"] = _critical_rpm(zeta_1, TireWheelUnit.table_1(zeta_s=zeta_s))
    return table


fig7b = fig7a  # drawn up to 60 000 rpm


def fig6_damping() -> Table:
    """Both components of the steady axle force over the load, x forward, for both kinds of sidewall damping."""
    speed = np.linspace(0.0, 4000.0, 201)
    table = {"speed_rpm": speed}
    for damping in DAMPINGS:
        for zeta_1 in FIG6_ZETA_1:
            unit = TireWheelUnit.table_1(zeta_1=zeta_1, sidewall_damping=damping)
            states = [wheel.equilibrium(unit, rpm * RPM, LOAD) for rpm in speed]
            force = np.array([wheel.axle_force(unit, rpm * RPM, z) for rpm, z in zip(speed, states, strict=True)])
            table[f"K_{damping}_zeta_1_{zeta_1}"] = force[:, 1] / LOAD
            table[f"force_x_over_load_{damping}_zeta_1_{zeta_1}"] = force[:, 0] / LOAD
    return table


def fig7_damping() -> Table:
    """The speed at which stability is lost over zeta_1, for both kinds of sidewall damping and both models."""
    zeta_1 = _damping_ratios()
    table = {"zeta_1": zeta_1}
    for damping in DAMPINGS:
        unit = TireWheelUnit.table_1(sidewall_damping=damping)
        for model in WHEEL_MODELS:
            table[f"critical_speed_{damping}_{model}_rpm"] = _critical_rpm(zeta_1, unit, model)
    return table


def campbell() -> Table:
    """Damped frequencies and decay rates over speed: waves n >= 2 on the ring, and n = 1 with the wheel.

    A wave's frequency in the fixed frame differs from that on the ring by n Omega, its decay rate does not. The
    ring's centre moves along an ellipse, two opposite circles, whose frequency on the ring is Omega more or less.
    Of the complete model's frequencies those are given that the inextensional model has too.
    """
    unit = TireWheelUnit.table_1()
    speed = np.linspace(0.0, 6000.0, 121)
    table = {"speed_rpm": speed}
    for model in WHEEL_MODELS:
        wheel_modes, waves = campbell_exponents(unit, speed * RPM, CAMPBELL_MODES, model)
        for n in CAMPBELL_MODES:
            for wave in WAVES:
                exponent = waves[n, wave]
                case = f"{model}_n_{n}_{wave}"
                table[f"ring_frame_{case}_Hz"] = np.abs(exponent.imag - n * speed * RPM) / TURN
                table[f"fixed_frame_{case}_Hz"] = np.abs(exponent.imag) / TURN
                table[f"decay_rate_{case}_1_s"] = -exponent.real
        for mode, exponent in wheel_modes.items():
            table[f"fixed_frame_{model}_{mode}_Hz"] = exponent.imag / TURN
            for side, sign in SIDES.items():
                table[f"ring_frame_{model}_{mode}_{side}_Hz"] = np.abs(exponent.imag + sign * speed * RPM) / TURN
            table[f"decay_rate_{model}_{mode}_1_s"] = -exponent.real
    return table


def multipliers() -> Table:
    """Floquet multipliers exp(lambda 2 pi/Omega) of the 6-state system with positive frequency in the fixed frame.

    The other three are their complex conjugates.
    """
    unit = TireWheelUnit.table_1(zeta_1=0.05, zeta_s=0.05)
    speed = np.linspace(2000.0, 27000.0, 2501)
    table = {"speed_rpm": speed}
    exponents = np.array([wheel_exponents(unit, rpm * RPM) for rpm in speed])
    values = np.exp(exponents * (TURN / (speed * RPM))[:, None])
    for mode, value in zip(WHEEL_MODES, values.T, strict=True):
        table[f"{mode}_real"] = value.real
        table[f"{mode}_imag"] = value.imag
        table[f"{mode}_modulus"] = np.abs(value)
    return table


def tongues() -> Table:
    """Largest modulus of the multipliers with a sidewall whose stiffness for n = 1 is k_1 (1 +- eps)."""
    speed = np.concatenate([np.linspace(300.0, 4200.0, 40), np.linspace(4225.0, 6500.0, 92), [6600.0, 6800.0, 7000.0]])
    table = {"speed_rpm": speed}
    for zeta in TONGUE_ZETA:
        unit, _ = tongue_unit(zeta)
        grid = tongue_map(unit, sidewall(TONGUE_EPS[-1]), speed * RPM, np.array(TONGUE_EPS) / TONGUE_EPS[-1])
        for eps, radius in zip(TONGUE_EPS, grid.spectral_radius, strict=True):
            table[f"spectral_radius_zeta_{zeta}_eps_{eps:.4f}"] = radius
    return table


def sidewall(eps: float) -> Nonuniformity:
    """k_z strongest where k_theta is weakest, by 2 eps each."""
    return Nonuniformity(((2, 2.0 * eps, 0.0),), ((2, 2.0 * eps, 0.5 * math.pi),))


def tongue_unit(zeta: float) -> tuple[TireWheelUnit, tuple[CombinationResonance, ...]]:
    """Table 1 with this damping, and where its tongues begin; growth per eps [1/s], thresholds as eps."""
    unit = TireWheelUnit.table_1(zeta_1=zeta, zeta_s=zeta)
    some = 0.01
    resonances = combination_resonances(unit, sidewall(some))
    return unit, tuple(
        resonance._replace(growth=resonance.growth / some, threshold=resonance.threshold * some)
        for resonance in resonances
    )


def tongue_thresholds(zeta: float) -> list[tuple[float, float]]:
    """Speeds [rad/s] and eps of the lowest points of the tongues, of the verdict; of those that damping leaves."""
    some = 0.01
    unit, _ = tongue_unit(zeta)
    each = combination_resonances(unit, sidewall(some))
    found = [
        tongue_threshold(unit, sidewall(some), resonance) for resonance in each if resonance.threshold * some < 0.5
    ]
    return [(lowest.speed, lowest.scale * some) for lowest in found if lowest is not None]


def write_csv(path: Path, table: Table) -> None:
    """A line of column names and the numbers, to ten digits."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(table)
        writer.writerows([f"{value:.10g}" for value in row] for row in zip(*table.values(), strict=True))


def _damping_ratios() -> FloatArray:
    """Up to 0.5, closer where the boundary is steep; at 0 there is no boundary."""
    return np.concatenate([np.linspace(0.0050, 0.0975, 38), np.linspace(0.100, 0.500, 81)])


def _critical_rpm(zeta_1: FloatArray, unit: TireWheelUnit, model: wheel.Model = "inextensional") -> FloatArray:
    speeds = [wheel.critical_speed(unit.replace(zeta_1=float(z)), model) for z in zeta_1]
    return np.array([math.nan if speed is None else speed / RPM for speed in speeds])
