"""The parameters of the node: the one table that the node, the replay and the documentation read."""

from __future__ import annotations

import dataclasses
import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Any, Literal

from ..estimator.load_equations import SensorNoise
from ..estimator.vehicle import VehicleSettings
from ..estimator.vehicle_parameters import VehicleParameters
from ..files.errors import InputError
from ..files.vehicle_file import read_vehicle
from ..files.yaml_file import read_yaml
from ..science.contact_points import ContactPoints
from ..science.unit import HARMONICS, RATIOS, WIDEST_CONTACT, TireWheelUnit
from .input_map import QUANTITIES, sources

__all__ = [
    "CAR", "PARAMETERS", "Parameter", "car_of", "complete", "is_of_every_node", "noise_of", "read_car", "read_config",
    "read_inputs", "unit_of", "vehicle_settings",
]  # fmt: skip

NODE_NAME = "tire_dynamics"

CAR = ("front_left", "front_right", "rear_left", "rear_right")
"""The wheels of a field map, where nothing else names them."""

_MAX_WHEELS = 100  # each takes time at every tick, and a bag may name any number

Kind = Literal[
    "boolean", "double", "double[]", "double | double[]", "integer", "string", "string[]", "string | string[]"
]  # fmt: skip


@dataclass(frozen=True)
class Parameter:
    """One row of the table. ``low`` and ``high``, which every number has, are inclusive."""

    name: str
    kind: Kind
    default: Any
    description: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = True

    def check(self, value: Any) -> Any:
        """The value in its Python type; ``ValueError`` names the parameter, the value and the bound."""
        if self.kind == "string | string[]" and isinstance(value, str):
            return (value,) if value else ()
        if self.kind in ("string[]", "string | string[]"):
            if not isinstance(value, (list, tuple)) or not all(isinstance(item, str) for item in value):
                raise ValueError(f"{self.name} is {value!r}; it must be a list of names")
            return tuple(value)
        if self.kind == "double | double[]" and type(value) is float:
            value = (value,)
        if self.kind in ("double[]", "double | double[]"):
            if not isinstance(value, (list, tuple)) or not all(type(item) is float for item in value):
                raise ValueError(f"{self.name} is {value!r}; it must be a list of floating-point numbers")
            if not all(map(math.isfinite, value)):
                raise ValueError(f"{self.name} is {list(value)!r}; each must be finite")
            return tuple(value)
        if self.kind == "boolean":
            if not isinstance(value, bool):
                raise ValueError(f"{self.name} is {value!r}; it must be true or false")
            return value
        if self.kind == "string":
            if not isinstance(value, str):
                raise ValueError(f"{self.name} is {value!r}; it must be a text")
            if self.choices and value not in self.choices:
                raise ValueError(f"{self.name} is {value!r}; it must be {' or '.join(map(repr, self.choices))}")
            return value
        if self.kind == "integer":
            if isinstance(value, bool) or not isinstance(value, int):
                raise ValueError(f"{self.name} is {value!r}; it must be an integer")
        elif not isinstance(value, float):
            hint = f": write {float(value)}" if type(value) is int else ""
            raise ValueError(f"{self.name} is {value!r}; it must be a floating-point number{hint}")
        if not math.isfinite(value):
            raise ValueError(f"{self.name} is {value!r}; it must be finite")
        if self.low is not None and value < self.low:
            raise ValueError(f"{self.name} is {value!r}; it must be at least {self.low:g}")
        if self.high is not None and value > self.high:
            raise ValueError(f"{self.name} is {value!r}; it must be at most {self.high:g}")
        return value


_TIRE_UNITS = {
    "density": "density of the belt, rho [kg/m^3]",
    "bending_stiffness": "bending stiffness of the belt, D [N m]",
    "membrane_stiffness": "membrane stiffness of the belt, K [N/m]",
    "radius": "mean radius of the belt, a [m]",
    "width": "width of the belt, b [m]",
    "thickness": "thickness of the belt, h [m]; less than the radius",
    "radial_stiffness": "radial stiffness of the sidewall per belt area, k_z [N/m^3]",
    "tangential_stiffness": "tangential stiffness of the sidewall per belt area, k_theta [N/m^3]",
    "inflation_pressure": "inflation pressure, p_0 [Pa]",
    "wheel_mass": "mass that moves with the wheel, without the belt, M [kg]",
    "suspension_stiffness": "vertical stiffness of the suspension, k_s [N/m]",
    "zeta_1": "damping ratio of the n = 1 mode, in [0, 1)",
    "zeta_s": "damping ratio of the suspension, in [0, 1)",
    "zeta_n": "damping ratio of every other mode of the belt, in [0, 1)",
    "contact_half_angle": "half the angle of the contact patch, phi_c [rad]; 0 is a point load",
    "longitudinal_stiffness": "fore-aft stiffness between wheel and vehicle, k_x [N/m]; 0: longitudinally rigid",
    "longitudinal_damping_ratio": "damping ratio of the fore-aft suspension, zeta_x, in [0, 1)",
    "longitudinal_mass": "mass that moves fore and aft with the wheel, without the belt [kg]; 0: wheel_mass",
    "radial_nonuniformity": "variation of k_z around the tire: order, amplitude [-], phase [rad] by harmonic",
    "tangential_nonuniformity": "variation of k_theta around the tire: order, amplitude [-], phase [rad] by harmonic",
    "imbalance_mass": "unbalance mass, at the belt's radius [kg]",
    "imbalance_angle": "angle of the unbalance mass on the tire [rad]",
    "radial_runout": "radial run-out of the tread, on the road: number, amplitude [m] and phase [rad] of each harmonic",
    "vertical_stiffness": "static vertical stiffness of the tire on the road, wheel held, K_v [N/m]; 0: rigid tread",
    "residual_damping": "damping of the tread's residual spring, c_c [N s/m]",
    "sprung_mass": "sprung mass on this wheel, on the road [kg]; 0: the body is fixed",
    "sidewall_damping": "sidewall damping: 'modal', as in the paper, or 'reaction', dampers between belt and wheel",
}


# What a description of a tire can hold, from a model car's to an earthmover's and an aircraft's with much to spare: a
# slip of the decimal point by many places, or of the unit, is refused.
_TIRE_BOUNDS = {
    "density": (1.0, 1e5),
    "bending_stiffness": (1e-6, 1e6),
    "membrane_stiffness": (1e2, 1e10),
    "radius": (1e-3, 10.0),
    "width": (1e-3, 10.0),
    "thickness": (1e-5, 1.0),
    "radial_stiffness": (1e2, 1e10),
    "tangential_stiffness": (1e2, 1e10),
    "inflation_pressure": (1.0, 1e8),
    "wheel_mass": (1e-3, 1e5),
    "suspension_stiffness": (1.0, 1e10),
    "contact_half_angle": (0.0, WIDEST_CONTACT),
    "longitudinal_stiffness": (0.0, 1e10),
    "longitudinal_mass": (0.0, 1e5),
    "imbalance_mass": (0.0, 1e3),
    "imbalance_angle": (-1e3, 1e3),
    "vertical_stiffness": (0.0, 1e10),
    "residual_damping": (0.0, 1e8),
    "sprung_mass": (0.0, 1e6),
    **dict.fromkeys(RATIOS, (0.0, 1.0)),
}


def _tire_parameters() -> tuple[Parameter, ...]:
    rows = []
    for name, default in TireWheelUnit.table_1().to_mapping().items():
        row = Parameter(f"tire.{name}", "double", default, _TIRE_UNITS[name], read_only=False)
        if name in _TIRE_BOUNDS:
            row = dataclasses.replace(row, low=_TIRE_BOUNDS[name][0], high=_TIRE_BOUNDS[name][1])
        elif name in HARMONICS:
            row = dataclasses.replace(row, kind="double[]", default=())
        elif name == "sidewall_damping":
            row = dataclasses.replace(row, kind="string", choices=("modal", "reaction"))
        rows.append(row)
    return tuple(rows)


def _input_parameters() -> Iterator[Parameter]:
    """The field map: rows for each quantity."""
    for name, quantity in QUANTITIES.items():
        prefix, units = f"inputs.{name}", (*quantity.units, *quantity.linear)
        yield Parameter(
            f"{prefix}.topic", "string | string[]", (), f"where it comes from: {quantity.what}; empty: not mapped"
        )
        yield Parameter(f"{prefix}.type", "string", "", "type of its messages, such as std_msgs/msg/Float32MultiArray")
        yield Parameter(
            f"{prefix}.field", "string | string[]", (), "path of the field in the message, such as wheels[2].omega"
        )
        yield Parameter(f"{prefix}.unit", "string", units[0], "unit of the field", choices=units)
        if not quantity.size:
            yield Parameter(
                f"{prefix}.order", "string | string[]", (), "wheels in the order of its values; default: wheels"
            )
        yield Parameter(
            f"{prefix}.stamp", "string", "", "field of the time stamp, or receipt; default: header.stamp if there"
        )
        yield Parameter(
            f"{prefix}.sign", "double | double[]", (), "factor on its values: 1.0 or -1.0, for all or for each"
        )
        yield Parameter(
            f"{prefix}.zero", "double | double[]", (), "what its values are where the quantity is zero, in their unit"
        )
        if quantity.linear:
            yield Parameter(
                f"{prefix}.radius", "double", 0.0, "rolling radius, to make rad/s of m/s, km/h or mph [m]", 0.0, 10.0
            )


def _car_parameters() -> Iterator[Parameter]:
    """A car, and the noise of its sensors, for loads that are estimated."""
    for field in dataclasses.fields(VehicleParameters):
        what = f"with load_source estimate: {field.metadata['meaning']} [{field.metadata['unit']}]"
        if field.metadata["count"] == 1:
            yield Parameter(f"vehicle.{field.name}", "double", 0.0, f"{what}; 0: not given", 0.0, 1e9)
        else:
            many = f"{field.metadata['count']} numbers"
            yield Parameter(f"vehicle.{field.name}", "double[]", (), f"{what}; {many}")
    for name, default in vars(SensorNoise()).items():
        what = f"with load_source estimate: {_NOISE[name]}, one standard deviation"
        yield Parameter(f"sensor_noise.{name}", "double", default, what, 1e-9, 1e3)


_NOISE = {
    "acceleration": "white noise of the IMU's accelerations [m/s^2]",
    "angular_rate": "white noise of the IMU's rates [rad/s]",
    "acceleration_bias": "constant error of the IMU's accelerations [m/s^2]",
    "angular_rate_bias": "constant error of the IMU's rates [rad/s]",
    "travel": "noise of a travel [m]",
    "hub_acceleration": "noise of a hub's acceleration [m/s^2]",
    "speed_slope": "acceleration by slope and bank, which wheel speeds without an IMU do not show [m/s^2]",
    "mass": "error of the sprung mass, over the mass",
    "tip": "error of the lever of the body's weight as it leans, over the lever",
    "inertia": "error of the body's inertias, over them",
    "height": "error of the heights that give specific forces their moments, over them",
    "links": "share of these moments that links carry past the springs, and of specific forces by which they lift",
}

_SCALE = "factor on the deflection in ring_shape's x y z and in the markers; its other fields stay true"

_COUPLED = "on the road: highest belt harmonic that a varying sidewall couples with the others"

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("wheels", "string[]", ("wheel",), "names of the wheels; each is the first part of its topics"),
    Parameter("joint_names", "string[]", (), "joint of each wheel in joint_states; default: the wheel's name"),
    Parameter("frame_ids", "string[]", (), "frame of each wheel's outputs; default: <wheel>_axle"),
    Parameter("rate_hz", "double", 500.0, "steps of the model and axle_wrench messages per second [Hz]", 1.0, 10e3),
    Parameter("ring_rate_hz", "double", 50.0, "ring messages per second [Hz]; at most rate_hz", 0.1, 10e3),
    Parameter("ring_samples", "integer", 72, "angles around the belt in the ring messages", 3, 10_000),
    Parameter("n_max", "integer", 30, "highest circumferential wavenumber of the belt", 2, 1000),
    Parameter("model", "string", "inextensional", "model of the belt", choices=("inextensional", "complete")),
    Parameter("load_source", "string", "topic", "source of the wheel loads", choices=("topic", "road", "estimate")),
    Parameter("static_loads", "double[]", (), "with load_source road: what each tire carries at rest, > 0 [N]"),
    Parameter("max_road_step_m", "double", 0.25, "road heights that differ by more are refused [m]", 0.0, 1e5),
    Parameter("contact_points", "integer", 1, "on the road: points of the contact along the patch", 1, 50),
    Parameter("coupled_harmonics", "integer", 30, _COUPLED, 0, 1000),
    Parameter("input_timeout_s", "double", 0.2, "age of an input beyond which it is stale [s]", 1e-3, 3600.0),
    Parameter("max_speed_rad_s", "double", 1000.0, "speeds beyond this are refused [rad/s]", 0.0, 1e5),
    Parameter("max_load_n", "double", 200e3, "loads and tractions beyond this are refused [N]", 0.0, 1e9),
    Parameter("ring_shape_scale", "double", 1.0, _SCALE, 0.0, 1e6, read_only=False),
    Parameter("marker_force_scale", "double", 1e-4, "length of the arrows of forces [m/N]", 0.0, 1.0, read_only=False),
    Parameter("tf.parent_frame", "string", "", "frame of which the axles' frames are children in TF; empty: no TF"),
    Parameter("tf.positions", "double[]", (), "x y z of each axle's frame in it [m], wheel after wheel; default: 0"),
    Parameter("autostart", "boolean", True, "start at once; false: wait for a lifecycle manager"),
    *_tire_parameters(),
    *_car_parameters(),
    Parameter("axle_wrench_covariance", "boolean", False, "publish the covariances of estimated axle forces"),
    Parameter("log.directory", "string", "", "where logs are written; empty: no log", read_only=False),
    Parameter("log.queue_size", "integer", 20_000, "messages that may wait for the disk", 100, 10_000_000),
    Parameter("log.max_size_mb", "double", 1e3, "size at which a log goes on in another file [MB]; 0: never", 0.0, 1e9),
    Parameter("log.max_duration_s", "double", 3600.0, "time after which a log does so [s]; 0: never", 0.0, 1e9),
    Parameter("log.compression", "string", "zstd", "compression of the log's chunks", choices=("zstd", "lz4", "none")),
    *_input_parameters(),
)

_MOST_OF_A_BELT = 1_000_000  # samples times modes: what is summed for one shape

_BY_NAME = {parameter.name: parameter for parameter in PARAMETERS}


def complete(values: Mapping[str, Any]) -> dict[str, Any]:
    """All parameters, the given ones checked one by one and against each other, the rest at their defaults.

    Parameters
    ----------
    values : mapping
        Values by the names of ``PARAMETERS``.

    Returns
    -------
    dict
        A value for every name.

    Raises
    ------
    ValueError
        A name is unknown, or a value out of its bounds or in contradiction to another; the message says which.
    """
    for name in values:
        if name not in _BY_NAME:
            raise ValueError(f"{name!r} is not a parameter of {NODE_NAME}{_suggestion(name)}")
    whole = {name: row.check(values.get(name, row.default)) for name, row in _BY_NAME.items()}
    wheels = whole["wheels"]
    whole["joint_names"] = whole["joint_names"] or wheels
    whole["frame_ids"] = whole["frame_ids"] or tuple(f"{wheel}_axle" for wheel in wheels)
    if not wheels:
        raise ValueError("wheels is []; it must name at least one wheel")
    if len(wheels) > _MAX_WHEELS:
        raise ValueError(f"wheels has {len(wheels)} names; it must have at most {_MAX_WHEELS}")
    for wheel in wheels:
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,99}", wheel) or "__" in wheel or wheel.endswith("_"):
            raise ValueError(
                f"wheels has {wheel[:120]!r}; a wheel's name must be letters, digits and single _ between them, a"
                " letter first, 100 at most"
            )
    for name in ("wheels", "joint_names"):
        if len(set(whole[name])) != len(whole[name]):
            raise ValueError(f"{name} is {list(whole[name])}; no name may stand twice")
    for name in ("joint_names", "frame_ids"):
        if len(whole[name]) != len(wheels):
            raise ValueError(f"{name} has {len(whole[name])} entries; wheels has {len(wheels)}")
        if not all(whole[name]):
            raise ValueError(f"{name} is {list(whole[name])}; no name may be empty")
    whole["tf.positions"] = whole["tf.positions"] or (0.0,) * (3 * len(wheels))
    if len(whole["tf.positions"]) != 3 * len(wheels):
        raise ValueError(
            f"tf.positions is {list(whole['tf.positions'])}; it must have x y z for each of {len(wheels)} wheels"
        )
    if (parent := whole["tf.parent_frame"]) in whole["frame_ids"]:
        raise ValueError(f"tf.parent_frame is {parent!r}; it must not be one of frame_ids")
    if whole["ring_samples"] * whole["n_max"] > _MOST_OF_A_BELT:
        raise ValueError(
            f"ring_samples is {whole['ring_samples']} and n_max {whole['n_max']}; their product must be at most"
            f" {_MOST_OF_A_BELT}"
        )
    if whole["ring_rate_hz"] > whole["rate_hz"]:
        raise ValueError(f"ring_rate_hz is {whole['ring_rate_hz']}; it must be at most rate_hz = {whole['rate_hz']}")
    sources(whole)
    unit = unit_of(whole)
    if whole["load_source"] == "road":
        _check_road(whole, unit)
    if whole["load_source"] == "estimate":
        _check_estimate(whole)
    for name in HARMONICS:  # without those of no amplitude
        whole[f"tire.{name}"] = tuple(float(number) for each in getattr(unit, name) for number in each)
    return whole


def _check_road(values: Mapping[str, Any], unit: TireWheelUnit) -> None:
    loads = values["static_loads"]
    if len(loads) != len(values["wheels"]):
        raise ValueError(
            f"static_loads has {len(loads)} entries; with load_source 'road' it must have one for each of"
            f" {len(values['wheels'])} wheels"
        )
    for load in loads:
        if not 0.0 < load <= values["max_load_n"]:
            raise ValueError(f"static_loads has {load!r}; each must be > 0 and at most max_load_n")
    try:
        ContactPoints(unit, values["contact_points"], values["model"], values["n_max"])
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith("contact_points") else f"tire.{error}") from None


def _check_estimate(values: Mapping[str, Any]) -> None:
    if len(values["wheels"]) != 4:
        raise ValueError(
            f"wheels has {len(values['wheels'])} names; with load_source 'estimate' it must have those of a car: front "
            "left, front right, rear left, rear right"
        )
    for name in ("load", "road_height"):
        if values[f"inputs.{name}.topic"]:
            raise ValueError(f"inputs.{name}.topic is given; with load_source 'estimate' the loads are estimated")
    car_of(values)


def car_of(values: Mapping[str, Any]) -> VehicleParameters:
    """The car that the ``vehicle.*`` parameters describe; ``ValueError`` names what is wrong, or what is missing."""
    fields = {name.removeprefix("vehicle."): value for name, value in values.items() if name.startswith("vehicle.")}
    given = {name: value for name, value in fields.items() if value not in (0.0, ())}
    try:
        return VehicleParameters.from_mapping(given)
    except ValueError as error:
        named = str(error).split(" ")[0].split("[")[0] in fields
        raise ValueError(f"vehicle.{error}" if named else f"vehicle.*: {error}") from None


def noise_of(values: Mapping[str, Any]) -> SensorNoise:
    """The noise of the sensors that the ``sensor_noise.*`` parameters describe."""
    names = [name for name in values if name.startswith("sensor_noise.")]
    return SensorNoise(**{name.removeprefix("sensor_noise."): values[name] for name in names})


def _suggestion(name: str) -> str:
    import difflib

    close = difflib.get_close_matches(name, _BY_NAME, n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


def unit_of(values: Mapping[str, Any]) -> TireWheelUnit:
    """The unit that the ``tire.*`` parameters describe; ``ValueError`` names the parameter that is wrong."""
    fields = {name.removeprefix("tire."): value for name, value in values.items() if name.startswith("tire.")}
    try:
        return TireWheelUnit.from_mapping(fields)
    except ValueError as error:
        named = str(error).split(" ")[0] in fields
        raise ValueError(f"tire.{error}" if named else f"tire.*: {error}") from None


def vehicle_settings(values: Mapping[str, Any]) -> VehicleSettings:
    """What the estimator needs of a complete set of parameters."""
    return VehicleSettings(
        unit=unit_of(values),
        wheels=tuple(values["wheels"]),
        joint_names=tuple(values["joint_names"]),
        period=round(1e9 / values["rate_hz"]),
        ring_period=round(1e9 / values["ring_rate_hz"]),
        ring_samples=values["ring_samples"],
        n_max=values["n_max"],
        model=values["model"],
        input_timeout=round(1e9 * values["input_timeout_s"]),
        max_speed=values["max_speed_rad_s"],
        max_load=values["max_load_n"],
        static_loads=tuple(values["static_loads"]) if values["load_source"] == "road" else None,
        max_road_step=values["max_road_step_m"],
        contact_points=values["contact_points"],
        coupled_harmonics=values["coupled_harmonics"],
    )


def read_config(path: str | PathLike[str], node: str | None = None) -> dict[str, Any]:
    """Parameters from a YAML file: a ROS 2 parameter file, or the fields of one unit.

    Parameters
    ----------
    path : path
        A file like ``config/vehicle.yaml``, or as ``ros2 param dump`` writes it, of which the sections for any node
        (``/**``) and for a node named ``tire_dynamics`` are read, or like ``config/table_1.yaml``. In a ROS file null
        is the default, and parameters that every node has are left out.
    node : str, optional
        Full name of the node that is meant, such as ``/car/tire_dynamics``: then what is for it alone is read, as ROS
        does. Without it, parameters for two nodes named ``tire_dynamics`` are refused.

    Returns
    -------
    dict
        Parameter names and values, only those given.

    Raises
    ------
    InputError
        The file cannot be read, or holds something else; :func:`complete` checks the values.
    """
    values = _read(path, node)
    try:
        complete(values)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    return values


def read_inputs(path: str | PathLike[str]) -> dict[str, Any]:
    """A field map from a YAML file like those in ``config/inputs``.

    Parameters
    ----------
    path : path
        A ROS 2 parameter file, with parameters ``inputs.*`` and perhaps ``wheels`` and ``joint_names``.

    Returns
    -------
    dict
        Parameter names and values, only those given. What they make together :func:`complete` checks, for the wheels
        that there are.

    Raises
    ------
    InputError
        The file cannot be read, or holds something else.
    """
    values = _read(path)
    try:
        for name, value in values.items():
            if name in _BY_NAME and not name.startswith("inputs.") and name not in ("wheels", "joint_names"):
                raise ValueError(f"{name} is no part of a field map, which has inputs.*, wheels and joint_names")
            if name not in _BY_NAME:
                raise ValueError(f"{name!r} is not a parameter of {NODE_NAME}{_suggestion(name)}")
            _BY_NAME[name].check(value)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    return values


def read_car(path: str | PathLike[str]) -> dict[str, Any]:
    """Parameters that have loads estimated, with the car of a YAML file such as ``config/car.yaml``.

    Parameters
    ----------
    path : path

    Returns
    -------
    dict
        ``load_source`` and ``vehicle.*``.

    Raises
    ------
    InputError
        The file cannot be read, or a field is unknown, missing or out of bounds.
    """
    try:
        car = read_vehicle(path).to_mapping()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    return {"load_source": "estimate", **{f"vehicle.{name}": value for name, value in car.items()}}


def _read(path: str | PathLike[str], node: str | None = None) -> dict[str, Any]:
    if os.fspath(path).lower().endswith(".tir") and os.path.isfile(path):
        raise InputError(f"{path}: is a tire property file; tire-dynamics import-tir makes the YAML of a unit of it")
    try:
        content = read_yaml(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except ValueError as error:
        raise InputError(str(error)) from None
    sections = list(_ros_sections(content))
    if sections:
        values: dict[str, Any] = {}
        full_names = {f"/{node.strip('/')}" for node, _ in sections if "*" not in node}
        namesakes = {name for name in full_names if name.split("/")[-1] == NODE_NAME}
        if len(namesakes) > 1 and node is None:
            raise InputError(f"{path}: has parameters for {' and '.join(sorted(namesakes))}; leave those of one")
        for name, section in sections:
            if _is_for(name, node):
                if not isinstance(section, dict):
                    raise InputError(f"{path}: ros__parameters of {name} is not a mapping")
                values.update(_flat(section))
        if not values:
            names = ", ".join(name for name, _ in sections)
            raise InputError(f"{path}: has parameters for {names}, and none for {node or NODE_NAME}")
        values = {name: value for name, value in values.items() if value is not None and not is_of_every_node(name)}
    else:
        values = {f"tire.{name}": _as_parameter(value) for name, value in content.items()}
    return values


def is_of_every_node(name: str) -> bool:
    """Whether a parameter is one that rclpy gives to every node: not of this table, and in every dump."""
    return name in ("use_sim_time", "start_type_description_service") or name.startswith("qos_overrides.")


def _as_parameter(value: Any) -> Any:
    """A unit's value as a ROS parameter has it: numbers with a point, lists of lists as one list."""
    if isinstance(value, list):
        flat = [item for each in value for item in (each if isinstance(each, list) else [each])]
        return [_as_parameter(item) for item in flat]
    return float(value) if type(value) is int else value


def _ros_sections(tree: Mapping[Any, Any], name: str = "") -> Iterator[tuple[str, Any]]:
    """Node and content of every ``ros__parameters``; namespaces may be levels of their own."""
    for key, value in tree.items():
        if key == "ros__parameters":
            yield name, value
        elif isinstance(value, dict):
            yield from _ros_sections(value, f"{name}/{str(key).strip('/')}")


def _is_for(name: str, node: str | None) -> bool:
    """Whether a section's name means a node: by its full name, or by any that is called as this package's is."""
    if node is None:
        return name.split("/")[-1] in ("**", "*", NODE_NAME)
    parts = [{"**": "(/[^/]+)*", "*": "/[^/]+"}.get(part, "/" + re.escape(part)) for part in name.strip("/").split("/")]
    return re.fullmatch("".join(parts), node) is not None


def _flat(tree: Mapping[Any, Any], prefix: str = "") -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name, value in tree.items():
        if isinstance(value, dict):
            values.update(_flat(value, f"{prefix}{name}."))
        else:
            values[f"{prefix}{name}"] = value
    return values
