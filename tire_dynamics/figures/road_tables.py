"""The numbers of the figures of the tire on the road; as those of ``tables``, but for a car's tire."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..estimator.belt import BeltMotion
from ..estimator.motion import Motion
from ..estimator.road_constants import on_the_road, under_the_belt
from ..estimator.road_motion import RoadMotion
from ..science import contact, road, wheel
from ..science.unit import TireWheelUnit
from ..science.wheel_matrices import Model
from .campbell_diagram import diagram

__all__ = [
    "CAMPBELL_HIGHEST",
    "CAUSES",
    "CLEAT",
    "MOUNTS",
    "SNAPSHOTS",
    "campbell_contact",
    "cleat",
    "force_variation",
    "load_or_road",
    "road_unit",
]

FloatArray = NDArray[np.float64]
Table = dict[str, FloatArray]

LOAD: Final = 4000.0  # [N]
SPEED: Final = 60.0  # [rad/s]: of the response
CLEAT: Final = 0.01, 0.15, 0.02  # height, begin and length [m]
CLEAT_SPEED: Final = 20.0  # [rad/s]
SNAPSHOTS: Final = (15.0, 22.0, 25.0, 28.0, 40.0)  # [ms]
CAUSES: Final[dict[str, dict[str, Any]]] = {
    "stiffness": {"radial_nonuniformity": [(1, 0.02, 0.0)]},
    "run_out": {"radial_runout": [(1, 5e-4, 0.0)]},
    "imbalance": {"imbalance_mass": 0.02},
}
MOUNTS: Final = ("machine", "car")
CAMPBELL_HIGHEST: Final[dict[Model, int]] = {"inextensional": 30, "complete": 15}  # belt harmonics of the diagram


def road_unit() -> TireWheelUnit:
    """Table 1 with a patch, a tread of 200 kN/m in all, dashpots that react, a car's damper and a quarter of a car."""
    return TireWheelUnit.table_1(
        contact_half_angle=0.15, vertical_stiffness=2e5, sidewall_damping="reaction", zeta_s=0.3, sprung_mass=350.0
    )


def load_or_road() -> Table:
    """F' per load that is given, and per K_v times the road's height: what would come of it on an axle that is held."""
    unit = road_unit()
    frequency = np.geomspace(0.5, 300.0, 800)
    given = wheel.frequency_response(unit, SPEED, frequency)
    driven = wheel.frequency_response(unit, SPEED, frequency, input="road") / unit.vertical_stiffness
    return {
        "frequency_Hz": frequency,
        "axle_force_per_given_load": np.abs(given[:, 1, 0]),
        "axle_force_per_K_v_times_road": np.abs(driven[:, 1, 0]),
        "contact_force_per_K_v_times_road": np.abs(driven[:, 2, 0]),
    }


def cleat() -> Table:
    """A cleat of 20 x 10 mm: forces over time, of one patch that takes the mean height, of nine points; belt shapes."""
    unit, step = road_unit(), 2.5e-4
    height, begin, length = CLEAT
    profile = road.bump(height, begin, length)
    time = step * np.arange(321)
    table: Table = {"time_ms": np.asarray(1e3 * time, dtype=np.float64)}
    psi = np.linspace(0.0, 2.0 * math.pi, time.size)
    for points in (1, 9):
        motion = Motion(on_the_road(unit), "inextensional", 1)
        belt = BeltMotion(under_the_belt(unit), "inextensional", 30, 1, psi)
        stepper = RoadMotion(unit, motion, belt, [LOAD], points)
        stepper.put(0, CLEAT_SPEED, 0.0, 0.0)
        place = -unit.radius * np.sin(stepper.angles_of_points())  # ahead of the axle
        patch = 2.0 * unit.radius * math.sin(unit.contact_half_angle / points)
        felt = profile.averaged(patch)  # each point stands for its part
        heights = felt.at(CLEAT_SPEED * unit.radius * time[:, None] + place)
        rows = [[*stepper.axle_force(0), stepper.contact_of(0)]]
        shapes = []
        for k in range(1, time.size):
            both = slice(k - 1, k + 1)
            stepper.follow_lines(table["time_ms"][both] / 1e3, np.full(2, CLEAT_SPEED), heights[both], np.zeros(2))
            rows.append([*stepper.axle_force(0), stepper.contact_of(0)])
            if points == 9 and any(abs(1e3 * time[k] - at) < 1e-6 for at in SNAPSHOTS):
                shapes.append((stepper.deflection(0)[0], float(motion.state_of(0)[-1])))
        for name, column in zip(("axle_x", "axle_z", "contact"), np.array(rows).T, strict=True):
            table[f"{name}_{points}_points_N"] = column
    table["psi_deg"] = np.degrees(psi)
    compression = contact.standing(contact.open_system(unit, CLEAT_SPEED), LOAD)[1]
    for at, (shape, wheel_height) in zip(SNAPSHOTS, shapes, strict=True):
        under = CLEAT_SPEED * unit.radius * 1e-3 * at + unit.radius * np.linspace(-0.6, 0.6, time.size)
        table[f"u_z_{at:g}_ms_mm"] = 1e3 * shape
        table[f"road_above_free_belt_{at:g}_ms_mm"] = 1e3 * (compression + profile.at(under) - wheel_height)
    return table


def force_variation() -> Table:
    """First harmonic of the vertical axle force, peak to peak, of three causes, at a fixed height and on a car."""
    unit = road_unit()
    kmh = np.linspace(2.0, 200.0, 67)
    table = {"speed_km_h": kmh}
    for cause, fields in CAUSES.items():
        nonuniform = unit.replace(**fields)
        for mount in MOUNTS:
            some = [contact.force_variation(nonuniform, v / 3.6 / unit.radius, LOAD, n_max=8, mount=mount) for v in kmh]
            table[f"{cause}_{mount}_N"] = np.array([2.0 * abs(each.axle[0]) for each in some])
    return table


def campbell_contact() -> Table:
    """Damped frequencies in the fixed frame and decay rates over speed on the road, of both models.

    Named are motions of which one harmonic has a third or more; ``mode_k`` are all there are, from the slowest on.
    """
    speed = np.linspace(0.0, 3000.0, 181)
    table: Table = {"speed_rpm": speed}
    for model, n_max in CAMPBELL_HIGHEST.items():
        found = diagram(road_unit(), speed * math.pi / 30.0, (2, 3, 4), model, contact=True, n_max=n_max)
        table |= {f"{model}_{name}": column for name, column in found.table.items() if name != "speed_rpm"}
    return table
