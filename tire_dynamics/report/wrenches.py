"""Forces at an axle as arrays, wherever they were recorded: bags, CSV files, MDF4 files."""

from __future__ import annotations

import gc
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..bag import BagReader
from ..cdr import messages
from ..files.csv_table import read_table, unit_named
from ..files.errors import InputError, first_line, missing
from ..replay.bag_setup import bag_setup, log_topic
from ..replay.series import series_of

__all__ = ["Series", "Wrench", "columns_of", "read_bag", "read_columns"]

FloatArray = NDArray[np.float64]

TABLES: Final = (".csv", ".tsv", ".txt")
MDF: Final = (".mf4", ".mdf", ".dat")
MOST: Final = 1e9  # [N]; beyond, a sensor has failed
FASTEST: Final = 1e4  # [rad/s] of a wheel
DEFAULT_COLUMNS: Final = {"z": "force_z_n"}
_FORCES: Final = {"N": 1.0, "kN": 1e3, "daN": 10.0, "lbf": 4.4482216152605, "kgf": 9.80665}
_SPEEDS: Final = {"rad/s": 1.0, "rpm": np.pi / 30.0, "rev/s": 2.0 * np.pi, "deg/s": np.pi / 180.0}


@dataclass
class Series:
    """Samples whose times ascend strictly, from ``origin_ns`` on [s]."""

    origin_ns: int
    time: FloatArray
    values: FloatArray


@dataclass
class Wrench:
    """The force at one axle, REP 103 axes [N].

    Attributes
    ----------
    name : str
        Of the file and what of it was taken.
    force : Series
        values (N, 2), [x, z]; a column of NaN is an axis that was not recorded.
    speed : Series or None
        Of the wheel [rad/s], if it is in the same file.
    notes : list of str
        What was left out, and how times are taken.
    """

    name: str
    force: Series
    speed: Series | None = None
    notes: list[str] = field(default_factory=list)


def columns_of(pairs: list[str], option: str) -> dict[str, str]:
    """Names of columns by what they are, of NAME=COLUMN: x, z, time, speed.

    Raises
    ------
    InputError
        A pair is none, or of another name.
    """
    found = {}
    for pair in pairs:
        name, given, column = pair.partition("=")
        if not given or not column or name not in ("x", "z", "time", "speed"):
            raise InputError(f"{option} has {pair[:100]!r}; it must be x=NAME, z=NAME, time=NAME or speed=NAME")
        if name in found:
            raise InputError(f"{option} names {name} twice")
        found[name] = column
    if found and not {"x", "z"} & found.keys():
        raise InputError(f"{option} names neither x nor z; one of them is needed")
    return found or dict(DEFAULT_COLUMNS)


# -- bags ---------------------------------------------------------------------------------------------------------


def read_bag(
    path: str | Path, topic: str | None, option: str, wheel: str | None, joints: Mapping[str, str], *, quiet: bool
) -> Wrench:
    """A wrench's topic of a bag, and the speed of its wheel.

    Parameters
    ----------
    path : path
    topic : str, optional
        Of geometry_msgs/WrenchStamped; None: of a log of the node, the wheel's axle_wrench.
    option : str
        That which names the topic, for errors.
    wheel : str, optional
        Needed of a log with several.
    joints : mapping of str to str
        Names in joint states by wheel.
    quiet : bool

    Raises
    ------
    InputError
        The bag, the topic or the wheel is not there, or has too few samples.
    """
    reader = BagReader(path)
    wrenches = sorted(name for name, kind in reader.topics.items() if kind == messages.WRENCH_STAMPED)
    known = f"topics of {messages.WRENCH_STAMPED}: {', '.join(wrenches) or 'none'}"
    is_log = log_topic(reader) is not None
    if topic is None and not is_log:
        raise InputError(f"{reader.path}: is no log of the node; {option} must say which force is meant; {known}")
    speeds: dict[str, str] = {}
    joint = ""
    if is_log:
        how = bag_setup(reader, joints=joints)
        wheels = how.values["wheels"]
        axles = {how.names[f"{name}/axle_wrench"]: name for name in wheels}
        wheel = wheel or (axles.get(_full(topic)) if topic else None) or (wheels[0] if len(wheels) == 1 else None)
        if topic is None or wheel is not None:
            if wheel not in wheels:
                which = "is needed, for there are several" if wheel is None else f"is {wheel[:100]!r}"
                raise InputError(f"--wheel {which}; it must be one of {', '.join(wheels)}")
            topic = topic or how.names[f"{wheel}/axle_wrench"]
            speeds = {how.names[f"{wheel}/wheel_speed"]: "wheel_speed", how.names["joint_states"]: "joint_states"}
            joint = how.values["joint_names"][wheels.index(wheel)]
    assert topic is not None
    topic = _full(topic)
    if not speeds:
        wheel = wheel or topic.rpartition("/")[0].rpartition("/")[2]
        prefix = f"/{wheel}" if not topic.endswith(f"/{wheel}/axle_wrench") else topic.removesuffix("/axle_wrench")
        speeds = {f"{prefix}/wheel_speed": "wheel_speed", "/joint_states": "joint_states"}
        joint = joints.get(wheel, wheel)
    if reader.topics.get(topic) != messages.WRENCH_STAMPED:
        what = f"is {reader.topics[topic]}" if topic in reader.topics else "is not there"
        raise InputError(f"{reader.path}: {topic} {what}; {known}")
    kinds = {messages.FLOAT64: "wheel_speed", messages.JOINT_STATE: "joint_states"}
    speeds = {name: kind for name, kind in speeds.items() if kinds.get(reader.topics.get(name, "")) == kind}
    rows, unreadable = series_of(reader, {**speeds, topic: "measured"}, joint, quiet, "compare")
    notes = [f"{name}: {count} messages are not what their type says" for name, count in unreadable.items() if count]
    if reader.damage:
        notes.append(f"{reader.path}: is damaged: {reader.damage}; what stands before was taken")
    begin = reader.start_ns or 0
    values, stamped = rows["force"]
    if not stamped:
        notes.append(f"{topic}: has no stamps; its samples count from their receipt")
    force = _series(f"{reader.path}: {topic}", begin, values[:, 0], values[:, 2:], MOST, notes)
    turning = rows["speed"][0]
    speed = None
    if len(turning) > 1:
        speed = _series(f"{reader.path}: the wheel's speed", begin, turning[:, 0], turning[:, 2], FASTEST, notes)
    return Wrench(f"{Path(path).name}: {topic}", force, speed, notes)


def _full(topic: str) -> str:
    return f"/{topic.lstrip('/')}"


# -- tables -------------------------------------------------------------------------------------------------------


def read_columns(path: str | Path, columns: Mapping[str, str]) -> Wrench:
    """Columns of a CSV file, or channels of an MDF4 file.

    Parameters
    ----------
    path : path
        ``.csv``, ``.tsv``, ``.txt``; ``.mf4``, ``.mdf``, ``.dat``.
    columns : mapping of str to str
        As :func:`columns_of` gives them. Units are those that the file says, N and rad/s where it says none.

    Raises
    ------
    InputError
        The file or a column cannot be used, or asammdf is missing.
    """
    path = Path(path)
    wanted = [name for name in ("x", "z", "speed") if name in columns]
    if path.suffix.lower() in MDF:
        series, notes = _channels(path, columns, wanted)
    else:
        table = read_table(path, [columns[name] for name in wanted], columns.get("time"), None)
        notes = [*table.notes, *table.doubts, *table.remarks()]
        origin = int(table.times[0])
        time = np.asarray((table.times - origin) * 1e-9, np.float64)
        series = {
            name: (origin, time, table.values[:, place] * _factor(path, name, column.name, column.unit))
            for place, (name, column) in enumerate(zip(wanted, table.columns, strict=True))
        }
    origin, time, first = series["z" if "z" in series else "x"]
    values = np.full((time.size, 2), np.nan)
    values[:, 1 if "z" in series else 0] = first
    if "z" in series and "x" in series:
        other, at, x = series["x"]
        if other != origin or at.shape != time.shape or not (at == time).all():
            raise InputError(f"{path}: {columns['x']} and {columns['z']} have other times; compare them one by one")
        values[:, 0] = x
    taken = [place for place, name in enumerate("xz") if name in series]
    force = _series(f"{path}: the force", origin, time, values, MOST, notes, taken)
    speed = None
    if "speed" in series:
        speed = _series(f"{path}: {columns['speed']}", *series["speed"], FASTEST, notes)
    return Wrench(f"{path.name}: {', '.join(columns[name] for name in wanted if name != 'speed')}", force, speed, notes)


def _channels(
    path: Path, columns: Mapping[str, str], wanted: list[str]
) -> tuple[dict[str, tuple[int, FloatArray, FloatArray]], list[str]]:
    if not path.is_file():
        raise missing(path)
    if find_spec("asammdf") is None:
        raise InputError(f"{path}: MDF4 files need asammdf: pip install 'tire_dynamics[mdf]'")
    from asammdf import MDF as File

    if "time" in columns:
        raise InputError(f"{path}: an MDF4 file has times of its own; leave time={columns['time']} out")
    hook, wrong = sys.unraisablehook, ""
    sys.unraisablehook = lambda _: None  # asammdf leaves half an object of a file that is none; it complains at its end
    try:
        with File(path) as file:
            known = file.channels_db
            for name in wanted:
                if columns[name] not in known:
                    raise InputError(f"{path}: has no channel {columns[name]!r}{_near(columns[name], known)}")
                if len(known[columns[name]]) > 1:
                    raise InputError(f"{path}: has several channels {columns[name]!r}; names must tell them apart")
            found = {name: file.get(columns[name]) for name in wanted}
            header = file.header
            # MDF 4 has whole nanoseconds
            origin = int(header.abs_time) if hasattr(header, "abs_time") else round(header.start_time.timestamp() * 1e9)
            local = header.start_time.tzinfo is None
    except InputError:
        raise
    except Exception as error:  # of a stranger's file asammdf raises whatever comes up
        wrong = first_line(error)
    finally:
        gc.collect()
        sys.unraisablehook = hook
    if wrong:
        raise InputError(f"{path}: is no MDF file that can be read: {wrong}")
    notes = [f"{path.name}: its times are of no time zone, and taken for UTC"] if local else []
    series = {}
    for name, channel in found.items():
        samples = np.asarray(channel.samples)
        if samples.ndim != 1 or samples.dtype.kind not in "iuf":
            raise InputError(f"{path}: {columns[name]} has no plain numbers")
        factor = _factor(path, name, columns[name], channel.unit or "")
        series[name] = origin, np.asarray(channel.timestamps, np.float64), samples.astype(np.float64) * factor
    return series, notes


def _near(name: str, known: Any) -> str:
    import difflib

    close = difflib.get_close_matches(name, list(known), n=1, cutoff=0.6)
    return f"; did you mean {close[0]!r}?" if close else f"; it has {', '.join(list(known)[:20])}"


def _factor(path: Path, name: str, column: str, text: str) -> float:
    quantity, factors = ("speed", _SPEEDS) if name == "speed" else ("load", _FORCES)
    if not text.strip():
        return 1.0
    unit = unit_named(quantity, text)
    if unit not in factors:
        raise InputError(f"{path}: {column} is in {text!r}; it must be in {', '.join(factors)}")
    return float(factors[unit])


def _series(
    what: str, origin: int, time: FloatArray, values: FloatArray, most: float, notes: list[str],
    taken: list[int] | None = None,
) -> Series:  # fmt: skip
    """What is finite and believable of samples, each time once."""
    seen = values.reshape(len(values), -1)
    seen = seen if taken is None else seen[:, taken]
    good = np.isfinite(time) & np.isfinite(seen).all(axis=1) & (np.abs(seen) <= most).all(axis=1)
    if not good.all():
        notes.append(f"{what}: {int((~good).sum())} samples are not finite or beyond {most:g}, and left out")
    if good.sum() < 2:
        raise InputError(f"{what} has {int(good.sum())} samples that can be used; that is too few")
    time, values = time[good], values[good]
    if not (np.diff(time) > 0.0).all():
        again = time.size
        time, first = np.unique(time, return_index=True)
        values = values[first]
        if time.size < again:
            notes.append(f"{what}: {again - time.size} samples have the time of another, and are left out")
    if time.size < 2:
        raise InputError(f"{what} has samples of one time only")
    return Series(origin, time, values)
