"""``tire-dynamics loads``: wheel loads from what a vehicle measured, as numbers and as a picture.

A folder holds a CSV file for each source; ``estimator.load_estimate`` does the rest.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.errors import InputError, missing
from ..files.outputs import aside
from .answer import answer
from .options import need_matplotlib

if TYPE_CHECKING:
    from ..estimator.load_estimate import LoadEstimate
    from ..estimator.vehicle_parameters import VehicleParameters

__all__ = ["FILES", "add_arguments", "read_vehicle", "recording", "run"]

WHEELS = ("fl", "fr", "rl", "rr")
NAMES = ("front left", "front right", "rear left", "rear right")
FILES = {  # of each source: the names that its file may have, and how many columns of values there are
    "imu": (("imu.csv",), 6),
    "travel": (("travel.csv", "suspension.csv"), 4),
    "hub": (("hub.csv",), 4),
    "wheel_speed": (("wheel_speed.csv",), 4),
}
UNITS: dict[str, dict[str, float]] = {  # by how a column's name ends; the first is taken where it ends otherwise
    "specific force": {"m_s2": 1.0, "g": 9.80665},
    "rate": {"rad_s": 1.0, "deg_s": math.pi / 180.0},
    "travel": {"m": 1.0, "mm": 1e-3},
    "hub": {"m_s2": 1.0, "g": 9.80665},
    "wheel_speed": {"rad_s": 1.0, "rpm": math.pi / 30.0, "m_s": math.nan, "km_h": math.nan},
}
_MOST_IN_PICTURE = 4000  # points of a line


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options, but for those of ``answer``."""
    parser.description = (
        "Estimates the load of each of four tires from an IMU, the springs' travel, hub accelerations and wheel "
        "speeds, or from those of them that IN has, and writes the loads with their standard deviations (loads.csv) "
        "and a picture (loads.png).\n\n"
        "IN is a folder with imu.csv (specific force x y z, then roll, pitch and yaw rate), travel.csv or "
        "suspension.csv (compression from rest), hub.csv (vertical specific force) and wheel_speed.csv: a line of "
        "names, times in seconds in the first column, wheels in the order front left, front right, rear left, rear "
        "right. A column whose name ends with _m_s2, _g, _rad_s, _deg_s, _mm, _m, _rpm, _m_s or _km_h is in that "
        "unit, else in SI."
    )
    parser.add_argument("input", metavar="IN", help="a folder of CSV files")
    parser.add_argument("-o", "--output", metavar="OUT", required=True, help="the folder to write")
    parser.add_argument("--vehicle", metavar="YAML", help="the car, as config/car.yaml has it; without it IN/car.yaml")
    parser.add_argument("--force", action="store_true", help="replace loads.csv and loads.png if OUT has them")


def run(options: argparse.Namespace) -> int:
    """Estimate the loads of a recording, and say on standard error what was made.

    ``InputError``: there is no such folder or nothing usable in it, the vehicle is not known, matplotlib is missing,
    or there is an output already.
    """
    from ..estimator.load_estimate import estimate_loads

    folder, output = Path(options.input), Path(options.output)
    if not folder.is_dir():
        raise missing(folder) if not os.path.lexists(folder) else InputError(f"{folder}: is not a folder of CSV files")
    need_matplotlib()
    files = _outputs(output, force=options.force)
    vehicle = read_vehicle(_vehicle_file(options.vehicle, folder))
    tables, remarks = recording(folder, vehicle)
    begin = min(int(times[0]) for times, _ in tables.values())
    sources: dict[str, Any] = {}
    for name, (times, values) in tables.items():
        t = (times - begin) * 1e-9
        sources[name] = (t, values[:, :3], values[:, 3:]) if name == "imu" else (t, values)
    estimate = estimate_loads(vehicle, **sources)
    output.mkdir(exist_ok=True)
    with aside(files[0]) as part:
        _write(part, estimate, begin)
    with aside(files[1]) as part:
        _draw(part, estimate, begin, list(sources))
    wheels = [_account(estimate, k, name) for k, name in enumerate(NAMES)]
    content = {
        "input": str(folder),
        "output": str(output),
        "sources": list(sources),
        "band_hz": estimate.band_hz,
        "begin_s": begin / 1e9,
        "samples": len(estimate.time),
        "wheels": wheels,
    }
    means = ", ".join(f"{each['mean_standard_deviation_n']:.0f}" for each in wheels)
    answer(
        options,
        content,
        *remarks,
        f"{output}: {len(estimate.time)} times of 4 loads from {', '.join(sources)}, "
        f"known up to {estimate.band_hz:g} Hz",
        f"standard deviations, on the mean: {means} N",
    )
    return 0


def _outputs(folder: Path, *, force: bool) -> tuple[Path, Path]:
    if os.path.lexists(folder) and not folder.is_dir():
        raise InputError(f"{folder}: exists already and is not a folder")
    if not folder.parent.is_dir():
        raise InputError(f"{folder.parent}: no such folder")
    files = folder / "loads.csv", folder / "loads.png"
    for file in files:
        if os.path.lexists(file) and not force:
            raise InputError(f"{file}: exists already (--force replaces it)")
        if os.path.lexists(file) and not file.is_file():
            raise InputError(f"{file}: exists already and is not a file")
    return files


def _vehicle_file(named: str | None, folder: Path) -> Path | None:
    if named is not None:
        return Path(named)
    beside = folder / "car.yaml"
    return beside if beside.is_file() else None


def read_vehicle(path: Path | None) -> VehicleParameters:
    """The car of a file.

    Parameters
    ----------
    path : path or None
        None where nobody named one.

    Raises
    ------
    InputError
        There is none, or the file is not one of a car: what is needed is listed.
    """
    from ..estimator.vehicle_parameters import VehicleParameters
    from ..files import vehicle_file

    try:
        if path is None:
            return VehicleParameters.from_mapping({})
        return vehicle_file.read_vehicle(path)
    except FileNotFoundError:
        assert path is not None
        raise missing(path) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{path or '--vehicle is not given'}: {error}; config/car.yaml is an example") from None


def recording(folder: Path, vehicle: VehicleParameters) -> tuple[dict[str, tuple[Any, Any]], list[str]]:
    """What a folder of CSV files holds.

    Parameters
    ----------
    folder : path
    vehicle : VehicleParameters
        For speeds in m/s or km/h.

    Returns
    -------
    tables : dict of str to (times [ns], values)
        By source, in SI units; IMU values are specific force and angular rates.
    remarks : list of str
        What was left out.

    Raises
    ------
    InputError
        There is none of the files, or one cannot be used.
    """
    tables: dict[str, tuple[Any, Any]] = {}
    remarks: list[str] = []
    for source, (names, count) in FILES.items():
        found = [folder / name for name in names if (folder / name).exists()]
        if len(found) > 1:
            raise InputError(f"{folder}: has {' and '.join(file.name for file in found)}, which are the same source")
        if found:
            tables[source] = _table(found[0], source, count, vehicle, remarks)
    if not tables:
        wanted = ", ".join(" or ".join(names) for names, _ in FILES.values())
        raise InputError(f"{folder}: has none of the files of sensors; they are {wanted}")
    return tables, remarks


def _table(path: Path, source: str, count: int, vehicle: VehicleParameters, remarks: list[str]) -> tuple[Any, Any]:
    import numpy as np

    from ..files.csv_table import read_table

    names = _names(path)
    if len(names) < count + 1:
        raise InputError(f"{path}: has {len(names)} columns; it must have a time and {count} values")
    columns = _ordered(names[1 : count + 1]) if count == 4 else names[1 : count + 1]
    table = read_table(path, columns, None, "s")
    remarks += table.remarks()
    factors = []
    for place, name in enumerate(columns):
        quantity = source if source != "imu" else ("specific force" if place < 3 else "rate")
        factors.append(_factor(name, quantity, vehicle.rolling_radius))
    return table.times, table.values * np.array(factors)


def _names(path: Path) -> list[str]:
    try:
        if not path.is_file():
            raise InputError(f"{path}: is not a file")
        with open(path, encoding="utf-8-sig", errors="replace", newline="") as file:
            head = file.readline(10_000)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    return [name.strip().strip('"') for name in head.split(max(",;\t", key=head.count))]


def _ordered(names: Sequence[str]) -> list[str]:
    """The columns front left, front right, rear left, rear right, if their names say so; else as they are."""
    parts = [name.lower().split("_") for name in names]
    places = [[k for k, words in enumerate(parts) if wheel in words] for wheel in WHEELS]
    if all(len(place) == 1 for place in places):
        return [names[place[0]] for place in places]
    return list(names)


def _factor(name: str, quantity: str, radius: float) -> float:
    units: Mapping[str, float] = UNITS[quantity]
    for unit in sorted(units, key=len, reverse=True):
        if name.lower().endswith(f"_{unit}"):
            if unit in ("m_s", "km_h"):
                return (1.0 if unit == "m_s" else 1.0 / 3.6) / radius
            return units[unit]
    return 1.0


def _account(estimate: LoadEstimate, wheel: int, name: str) -> dict[str, Any]:
    import numpy as np

    load, deviation = estimate.load[:, wheel], estimate.standard_deviation[:, wheel]
    return {
        "wheel": name,
        "mean_n": float(np.nanmean(load)),
        "least_n": float(np.nanmin(load)),
        "most_n": float(np.nanmax(load)),
        "mean_standard_deviation_n": float(np.nanmean(deviation)),
    }


def _write(path: Path, estimate: LoadEstimate, begin: int) -> None:
    heads = ["time_s", *(f"load_{w}_n" for w in WHEELS), *(f"standard_deviation_{w}_n" for w in WHEELS)]
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(heads) + "\n")
        rows = zip(estimate.time.tolist(), estimate.load.tolist(), estimate.standard_deviation.tolist(), strict=True)
        for time, loads, deviations in rows:
            stamp = begin + round(time * 1e9)
            cells = [f"{stamp // 10**9}.{stamp % 10**9:09d}" if stamp >= 0 else f"{stamp / 1e9:.9f}"]
            cells += ["" if value != value else f"{value:.2f}" for value in (*loads, *deviations)]
            file.write(",".join(cells) + "\n")


def _draw(path: Path, estimate: LoadEstimate, begin: int, sources: Sequence[str]) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 7.2), layout="constrained")
    axes = figure.subplots(4, 1, sharex=True)
    every = max(1, len(estimate.time) // _MOST_IN_PICTURE)
    time = estimate.time[::every]
    for wheel, (ax, name) in enumerate(zip(axes, NAMES, strict=True)):
        load, deviation = (each[::every, wheel] / 1e3 for each in (estimate.load, estimate.standard_deviation))
        ax.fill_between(
            time, load - 2.0 * deviation, load + 2.0 * deviation, color="tab:orange", alpha=0.6, linewidth=0.0, zorder=3
        )
        ax.plot(time, load, color="0.2", linewidth=0.5)
        ax.set_ylabel(f"{name}\n[kN]")
        ax.grid(alpha=0.3)
        ax.margins(x=0.0)
    axes[-1].set_xlabel(f"Time from {begin / 1e9:.3f} s [s]")
    words = {"imu": "IMU", "travel": "travel", "hub": "hub accelerations", "wheel_speed": "wheel speeds"}
    known = ", ".join(words[name] for name in sources)
    figure.suptitle(
        f"Wheel loads, estimated from {known}; in orange two standard deviations\n"
        f"Known up to some {estimate.band_hz:g} Hz",
        fontsize=10,
    )
    figure.savefig(path, dpi=130, format="png")
