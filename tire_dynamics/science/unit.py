"""The parameters of one tire-wheel-suspension unit."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from typing import Any, Final, Literal, cast

from .coefficients import static_compliance
from .harmonics import HIGHEST, Harmonic, check_factor, harmonics

__all__ = [
    "HARMONICS",
    "MODAL",
    "NOT_NEGATIVE",
    "NUMBERS",
    "RATIOS",
    "REACTION",
    "ROAD",
    "ROTATING",
    "TireWheelUnit",
    "UNBOUNDED",
    "WIDEST_CONTACT",
]

MODAL: Final = "modal"
REACTION: Final = "reaction"

HARMONICS: Final = ("radial_nonuniformity", "tangential_nonuniformity", "radial_runout")
"""The fields that are lists of (harmonic, amplitude, angle)."""

ROTATING: Final = (*HARMONICS, "imbalance_mass", "imbalance_angle")
"""The fields of what is not the same all around, and turns with the tire."""


ROAD: Final = ("vertical_stiffness", "residual_damping", "sprung_mass")
"""The fields that matter on the road alone, and not under a load that is given."""

NOT_NEGATIVE: Final = (
    *("longitudinal_stiffness", "longitudinal_mass", "imbalance_mass"),
    *ROAD,
)
"""The fields that must be >= 0."""

RATIOS: Final = ("zeta_1", "zeta_s", "zeta_n", "longitudinal_damping_ratio")
"""The fields that are damping ratios, in [0, 1)."""

UNBOUNDED: Final = ("imbalance_angle",)
"""The fields that may have any finite value. Every other number must be > 0, but for the contact's angle."""

WIDEST_CONTACT: Final = 0.5 * math.pi
"""The largest ``contact_half_angle`` [rad]; the smallest is 0."""


@dataclass(frozen=True)
class TireWheelUnit:
    """A thin rotating ring on an elastic sidewall, its wheel and its suspension (Huang & Hsu 1992).

    Every field is validated on construction; a bad one raises ``ValueError`` with the field's name, its
    value and its bound.

    Parameters
    ----------
    density : float
        Density of the ring, rho [kg/m^3].
    bending_stiffness : float
        Bending stiffness of the ring, D = E h^3 / 12 (1 - nu^2) [N m].
    membrane_stiffness : float
        Membrane stiffness of the ring, K = E h / (1 - nu^2) [N/m].
    radius, width, thickness : float
        Mean radius a, width b and thickness h of the ring [m]; h < a (thin ring).
    radial_stiffness, tangential_stiffness : float
        Sidewall stiffness per belt area, k_z and k_theta [N/m^3].
    inflation_pressure : float
        Inflation pressure p_0 [Pa].
    wheel_mass : float
        Mass of the wheel that moves with the axle, M [kg].
    suspension_stiffness : float
        Suspension stiffness k_s [N/m].
    zeta_1, zeta_s, zeta_n : float
        Damping ratios in [0, 1): of the n = 1 mode, of the suspension, and of every other mode.
    contact_half_angle : float
        Half the angle of the contact patch, phi_c [rad], in [0, pi/2]; the contact force is spread evenly over it, its
        vertical resultant being the load. 0 is the paper's point load.
    sidewall_damping : {"modal", "reaction"}
        "modal" is the paper's: damping of the ring's motion as seen from the rotating axes, with no reaction
        on the wheel. "reaction" puts the dashpots beside the sidewall springs, between belt and wheel.
    longitudinal_stiffness : float
        Fore-aft stiffness between wheel and vehicle, k_x [N/m]; 0, the paper's case, holds the wheel.
    longitudinal_damping_ratio : float
        Its damping ratio zeta_x, in [0, 1).
    longitudinal_mass : float
        Mass that moves fore and aft with the wheel, without the belt, m_x [kg]; 0: the wheel's, M.
    radial_nonuniformity, tangential_nonuniformity : sequence of (int, float, float)
        How the sidewall's stiffness varies around the ring: harmonics j, amplitudes e_j >= 0 and angles chi_j [rad] of
        k_z(theta) = k_z [1 + sum_j e_j cos j(theta - chi_j)], which must be > 0, and likewise of k_theta. theta is the
        angle on the ring, counted as psi is when the wheel's angle is 0.
    imbalance_mass, imbalance_angle : float
        A mass on the belt, m_u >= 0 [kg], and where, theta_u [rad]; beyond the centrifugal force it is left out.
    radial_runout : sequence of (int, float, float)
        How much farther out than its mean the tread is, sum_j r_j cos j(theta - chi_j) [m]. It acts on the road alone,
        as a road that turns; a load that is given has it, or has not.
    vertical_stiffness : float
        Of the whole tire on the road, wheel held, at rest, K_v >= 0 [N/m]: load over displacement. What the belt and
        its sidewall do not give of it, the residual spring of the tread does. It must be below their own stiffness, to
        n = 100. 0: the tread is rigid.
    residual_damping : float
        Damper beside the residual spring, c_c >= 0 [N s/m]; of no effect where the tread is rigid.
    sprung_mass : float
        What stands on the suspension of this wheel on the road, m_b >= 0 [kg]; 0: the body is held, as in the paper and
        always under a load that is given.

    Notes
    -----
    Damping: lambda_n/(rho h) = 2 zeta_n omega_n, omega_n the frequency of mode n at rest with the wheel held.
    """

    density: float
    bending_stiffness: float
    membrane_stiffness: float
    radius: float
    width: float
    thickness: float
    radial_stiffness: float
    tangential_stiffness: float
    inflation_pressure: float
    wheel_mass: float
    suspension_stiffness: float
    zeta_1: float = 0.05
    zeta_s: float = 0.05
    zeta_n: float = 0.02
    contact_half_angle: float = 0.0
    sidewall_damping: Literal["modal", "reaction"] = MODAL
    longitudinal_stiffness: float = 0.0
    longitudinal_damping_ratio: float = 0.0
    longitudinal_mass: float = 0.0
    radial_nonuniformity: tuple[Harmonic, ...] = ()
    tangential_nonuniformity: tuple[Harmonic, ...] = ()
    imbalance_mass: float = 0.0
    imbalance_angle: float = 0.0
    radial_runout: tuple[Harmonic, ...] = ()
    vertical_stiffness: float = 0.0
    residual_damping: float = 0.0
    sprung_mass: float = 0.0

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name == "sidewall_damping":
                if value not in (MODAL, REACTION):
                    raise ValueError(f"sidewall_damping is {value!r}; it must be 'modal' or 'reaction'")
                continue
            if field.name in HARMONICS:
                some = harmonics(field.name, value)
                if field.name != "radial_runout":
                    check_factor(field.name, some)
                object.__setattr__(self, field.name, tuple(each for each in some if each[1]))
                continue
            if isinstance(value, bool) or not isinstance(value, Real):
                raise ValueError(f"{field.name} is {value!r}; it must be a number")
            try:
                number = float(value)
            except OverflowError:
                number = math.inf
            if not math.isfinite(number):
                raise ValueError(f"{field.name} is {number!r}; it must be finite")
            if field.name in RATIOS:
                if not 0.0 <= number < 1.0:
                    raise ValueError(f"{field.name} is {number!r}; a damping ratio must be in [0, 1)")
            elif field.name == "contact_half_angle":
                if not 0.0 <= number <= WIDEST_CONTACT:
                    raise ValueError(f"{field.name} is {number!r}; it must be in [0, pi/2]")
            elif field.name in UNBOUNDED:
                pass
            elif field.name in NOT_NEGATIVE:
                if number < 0.0:
                    raise ValueError(f"{field.name} is {number!r}; it must be >= 0")
            elif number <= 0.0:
                raise ValueError(f"{field.name} is {number!r}; it must be > 0")
            object.__setattr__(self, field.name, number)
        if (most := sum(r for _, r, _ in self.radial_runout)) >= self.radius:
            raise ValueError(f"radial_runout adds up to {most!r}; it must be < radius = {self.radius!r}")
        if self.thickness >= self.radius:
            raise ValueError(f"thickness is {self.thickness!r}; a thin ring needs thickness < radius = {self.radius!r}")

        if not all(0.0 < size < math.inf for size in self._sizes()):
            raise ValueError("the fields are each in bounds, but together beyond what numbers of double precision hold")
        if self.vertical_stiffness and self.vertical_stiffness >= (own := 1.0 / static_compliance(self, HIGHEST)):
            raise ValueError(
                f"vertical_stiffness is {self.vertical_stiffness!r}; it must be < {own:.10g} N/m, the tire's own "
                "with a rigid tread, or 0 for a rigid tread"
            )

    def _sizes(self) -> tuple[float, ...]:
        try:
            return (
                self.ring_mass,
                self.sidewall_stiffness,
                self.rigid_mode_frequency,
                self.bending_stiffness / self.radius**4 / self.surface_density,
                self.membrane_stiffness / self.radius**2 / self.surface_density,
                self.sidewall_stiffness / self.wheel_mass,
                self.suspension_stiffness / self.wheel_mass,
                self.sidewall_stiffness / self.fore_aft_mass,
                1.0 if self.is_longitudinally_rigid else self.longitudinal_stiffness / self.fore_aft_mass,
            )
        except (ZeroDivisionError, OverflowError):
            return (math.inf,)

    # -- derived quantities ---------------------------------------------------------------------------------

    @property
    def surface_density(self) -> float:
        """Mass of the ring per belt area, rho h [kg/m^2]."""
        return self.density * self.thickness

    @property
    def ring_mass(self) -> float:
        """Mass of the ring, m = 2 pi a b rho h [kg]."""
        return 2.0 * math.pi * self.radius * self.width * self.surface_density

    @property
    def sidewall_stiffness(self) -> float:
        """Stiffness between the rigid ring and the wheel, k_1 = pi a b (k_z + k_theta) [N/m]."""
        return math.pi * self.radius * self.width * (self.radial_stiffness + self.tangential_stiffness)

    @property
    def rigid_mode_frequency(self) -> float:
        """Frequency of the rigid ring on the sidewall, omega_1 = sqrt(k_1/m) [rad/s]."""
        return self._sqrt(self.sidewall_stiffness / self.ring_mass)

    @property
    def suspension_damping(self) -> float:
        """Damping of the suspension, c_s = 2 zeta_s sqrt(k_s (M + m)) [N s/m]."""
        return 2.0 * self.zeta_s * self._sqrt(self.suspension_stiffness * (self.wheel_mass + self.ring_mass))

    @property
    def is_longitudinally_rigid(self) -> bool:
        """Whether the wheel cannot move fore and aft."""
        return self.longitudinal_stiffness == 0.0

    @cached_property
    def is_uniform(self) -> bool:
        """Whether it is the same all around: nothing of it turns with it."""
        varying = (self.radial_nonuniformity, self.tangential_nonuniformity, self.radial_runout)
        return not (self.imbalance_mass or any(size for some in varying for _, size, _ in some))

    @cached_property
    def mean(self) -> TireWheelUnit:
        """The unit without what turns with it; itself if it is uniform."""
        if self.is_uniform:
            return self
        return self.replace(**dict.fromkeys(HARMONICS, ()), imbalance_mass=0.0)

    @property
    def fore_aft_mass(self) -> float:
        """What moves fore and aft with the wheel, m_x or M [kg]."""
        return self.longitudinal_mass + (self.longitudinal_mass == 0.0) * self.wheel_mass

    @property
    def longitudinal_damping(self) -> float:
        """Fore-aft damping, c_x = 2 zeta_x sqrt(k_x (m_x + m)) [N s/m]."""
        mass = self.fore_aft_mass + self.ring_mass
        return 2.0 * self.longitudinal_damping_ratio * self._sqrt(self.longitudinal_stiffness * mass)

    def _sqrt(self, number: float) -> float:  # maps.py has units whose numbers are arrays
        return math.sqrt(number)

    # -- making units ---------------------------------------------------------------------------------------

    @classmethod
    def table_1(cls, **changes: Any) -> TireWheelUnit:
        """The tire of the paper's Table 1, with any fields changed: ``table_1(zeta_1=0.1)``."""
        return cls(
            density=1.59e3,
            bending_stiffness=2.175e1,
            membrane_stiffness=1.618e6,
            radius=0.305,
            width=0.152,
            thickness=0.0127,
            radial_stiffness=5.80e6,
            tangential_stiffness=4.03e6,
            inflation_pressure=2.07e5,
            wheel_mass=8.78,
            suspension_stiffness=3.60e4,
        ).replace(**changes)

    def replace(self, **changes: Any) -> TireWheelUnit:
        """A copy with some fields changed, validated like a new unit."""
        return type(self).from_mapping({**self.to_mapping(), **changes})

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> TireWheelUnit:
        """A unit from field names and values. A field that is unknown or missing raises ``ValueError``."""
        names = [field.name for field in dataclasses.fields(cls)]
        for name in mapping:
            if name not in names:
                raise ValueError(f"{name!r} is not a field of TireWheelUnit; the fields are {', '.join(names)}")
        for field in dataclasses.fields(cls):
            if field.name not in mapping and field.default is dataclasses.MISSING:
                raise ValueError(f"{field.name} is missing; it has no default")
        return cls(**mapping)

    @classmethod
    def from_yaml(cls, path: Any) -> TireWheelUnit:
        """A unit from a YAML file, as :func:`tire_dynamics.read_unit` reads it."""
        return cast(TireWheelUnit, _package().read_unit(path))

    def to_yaml(self, path: Any) -> None:
        """Write the fields to a YAML file, as :func:`tire_dynamics.write_unit` does."""
        _package().write_unit(self, path)

    @classmethod
    def from_tir(
        cls, path: Any, *, wheel_mass: float, suspension_stiffness: float, **fields: Any
    ) -> TireWheelUnit:
        """A unit with a property file's rigid ring, as :func:`tire_dynamics.read_tir_unit` reads it."""
        given = {"wheel_mass": wheel_mass, "suspension_stiffness": suspension_stiffness, **fields}
        return cast(TireWheelUnit, _package().read_tir_unit(path, **given))

    def to_mapping(self) -> dict[str, Any]:
        """Field names and values; harmonics as lists of lists."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return values | {name: [list(each) for each in values[name]] for name in HARMONICS}


NUMBERS: Final = tuple(
    field.name
    for field in dataclasses.fields(TireWheelUnit)
    if field.name not in (*ROTATING, *ROAD, "sidewall_damping")
)
"""The fields of numbers that the uniform tire has, on the road or not."""


def _package() -> Any:
    """The package, whose public functions meet files; no module of science opens one."""
    return __import__(__name__.partition(".")[0])
