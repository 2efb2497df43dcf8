"""``tire-dynamics road --forces --plot``: the input bag is replayed at once, and its forces taken out of the log."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from ..files.errors import InputError
from ..files.outputs import aside, writable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..figures.road_drive import RoadForces

__all__ = ["START_NS", "Drive", "parameters", "places", "write"]

START_NS = 1_000_000_000  # of the bag; a stamp of 0 is none


@dataclass(frozen=True)
class Drive:
    """What the bag tells: times [s], distance [m] and speed of the wheels [rad/s], shape (N,); heights (N, W) [m]."""

    time: NDArray[np.float64]
    distance: NDArray[np.float64]
    speed: NDArray[np.float64]
    heights: NDArray[np.float64]


def parameters(options: argparse.Namespace, given: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the node for the replay: of ``--config``, but with the road in place of any other source of loads.

    Raises
    ------
    InputError
        They cannot be used, or an output cannot be written.
    """
    from ..replay.parameters import complete

    values = {name: value for name, value in given.items() if not name.startswith("inputs.")}
    if options.wheels != list(values.get("wheels", ())):
        for name in ("joint_names", "frame_ids", "tf.parent_frame", "tf.positions"):
            values.pop(name, None)
    values.update(wheels=options.wheels, load_source="road")
    count, loads = len(options.wheels), options.static_load
    if loads is None and "static_loads" not in given:
        raise InputError("forces need what the wheels carry at rest: --static-load, or static_loads in --config")
    if loads is not None:
        if len(loads) not in (1, count):
            raise InputError(
                f"--static-load has {len(loads)} values; it must have one, or one for each of {count} wheels"
            )
        values["static_loads"] = loads * count if len(loads) == 1 else loads
    try:
        complete(values)
    except ValueError as error:
        raise InputError(f"{options.config}: {error}" if options.config else str(error)) from None
    if options.plot is not None:
        if not options.plot.lower().endswith(".png"):
            raise InputError(f"--plot is {options.plot}; its name must end in .png")
        if find_spec("matplotlib") is None:
            raise InputError("the picture needs matplotlib: pip install 'tire_dynamics[plot]'; --forces does without")
        writable(Path(options.plot), force=options.force)
    if options.forces is not None and _is_table(options):
        writable(Path(options.forces), force=options.force)
    for folder in (options.output, None if _is_table(options) else options.forces):
        if folder is not None and os.path.lexists(folder) and not options.force:
            raise InputError(f"{folder}: exists already (--force replaces it)")
    named = [each for each in (options.output, options.forces, options.plot) if each is not None]
    if len({os.path.abspath(each) for each in named}) < len(named):
        raise InputError(f"{' and '.join(named)}: two outputs have one name")
    return values


def _is_table(options: argparse.Namespace) -> bool:
    return str(options.forces).lower().endswith(".csv")


@contextmanager
def places(options: argparse.Namespace) -> Iterator[tuple[str, str]]:
    """Where the input bag and the log go: where the options say, or into a folder that is gone afterwards."""
    with TemporaryDirectory(prefix="tire_dynamics_road_") as folder:
        log = None if options.forces is None or _is_table(options) else options.forces
        yield options.output or f"{folder}/road", log or f"{folder}/forces"


def write(
    options: argparse.Namespace, values: Mapping[str, Any], drive: Drive, bag: str, log: str
) -> tuple[dict[str, Any], list[str]]:
    """Replay the bag into the log, and write table and picture of it.

    Parameters
    ----------
    options : argparse.Namespace
    values : mapping
        As :func:`parameters` gives them.
    drive : Drive
        What the bag holds.
    bag, log : str

    Returns
    -------
    dict
        What ``--json`` says of it.
    list of str
        Lines for a reader.

    Raises
    ------
    InputError
        The road jumps by more than the node takes, or nothing came of it.
    """
    import numpy as np

    from ..replay.parameters import complete, unit_of
    from ..replay.replay import replay

    whole = complete(values)
    jump = float(np.abs(np.diff(drive.heights, axis=0)).max())
    if jump > whole["max_road_step_m"]:
        raise InputError(
            f"the road jumps by {jump:.4g} m from one sample to the next; the node refuses more than max_road_step_m, "
            f"{whole['max_road_step_m']:g}: raise it in --config, or give a higher --rate"
        )
    summary = replay(bag, log, config=values, force=options.force, quiet=options.quiet)
    forces = _read(log, options.wheels, drive, options.quiet)
    outputs = [] if options.forces is None else [options.forces]
    if outputs and _is_table(options):
        with aside(Path(options.forces)) as part:
            _write_table(part, forces)
    if options.plot is not None:
        from functools import partial

        from ..figures.drawings import save
        from ..figures.road_drive import draw

        fore_aft = bool(unit_of(whole).longitudinal_stiffness) or whole["contact_points"] > 1
        with aside(Path(options.plot)) as part:
            save(part, partial(draw, fore_aft=fore_aft), forces)
        outputs.append(options.plot)
    wheels = [_account(forces, k) for k, wheel in enumerate(options.wheels) if wheel not in summary.without]
    content = {"forces": options.forces, "plot": options.plot, "forces_of": wheels}
    content |= {"without": summary.without, "doubts": summary.doubts}
    lines = [f"{', '.join(outputs)}: {forces.time.size} times of {len(wheels)} wheels"]
    lines += [
        "{wheel}: contact {contact_least_n:.0f} to {contact_most_n:.0f} N, axle {axle_least_n:.0f} to "
        "{axle_most_n:.0f} N, off the road {off_the_road_s:.4g} s".format(**each)
        for each in wheels
    ]
    unit = unit_of(whole)
    left_out = [] if unit.vertical_stiffness else ["vertical_stiffness is 0: the tread is rigid"]
    left_out += [] if unit.sprung_mass else ["sprung_mass is 0: the body is held"]
    lines += [", ".join(left_out)] if left_out else []
    lines += [f"{wheel}: no output; {reason}" for wheel, reason in summary.without.items()]
    lines += [f"doubtful: {doubt}" for doubt in summary.doubts]
    return content, lines


def _read(log: str, wheels: list[str], drive: Drive, quiet: bool) -> RoadForces:
    """The forces of a log, at all times at which a wheel has any; NaN where another has none."""
    import numpy as np

    from ..bag import BagReader
    from ..cdr import messages
    from ..figures.road_drive import RoadForces
    from ..files.progress import progress

    reader = BagReader(log)
    places = {
        f"/{wheel}/{name}": (k, name) for k, wheel in enumerate(wheels) for name in ("axle_wrench", "contact_load")
    }
    parts: dict[str, list[Any]] = {name: [np.empty((0, 2))] for name in places}
    stamps: dict[str, list[Any]] = {name: [np.empty(0, np.int64)] for name in places}
    count = sum(reader.counts.get(name) or 0 for name in places)
    blocks = reader.blocks(places.keys())
    for block in progress(blocks, count, "forces", size=lambda block: block.topic.size, unit="messages", quiet=quiet):
        for number, topic in enumerate(block.topics):
            some = np.flatnonzero(block.topic == number)
            if topic in places and some.size:
                _, stamp, x, z = messages.decode_wrenches(block.data, block.start[some], block.size[some])
                stamps[topic].append(stamp)
                parts[topic].append(np.column_stack([x, z]))
    known = {name: np.concatenate(each) for name, each in stamps.items()}
    every = np.unique(np.concatenate(list(known.values())))
    axle = np.full((every.size, len(wheels), 2), np.nan)
    contact = np.full((every.size, len(wheels)), np.nan)
    for name, (k, what) in places.items():
        rows = np.searchsorted(every, known[name])
        values = np.concatenate(parts[name])
        if what == "axle_wrench":
            axle[rows, k] = values
        else:
            contact[rows, k] = values[:, 1]
    row = np.searchsorted(START_NS + np.round(drive.time * 1e9).astype(np.int64), every, side="right") - 1
    return RoadForces(
        wheels=tuple(wheels),
        time=(every - START_NS) * 1e-9,
        distance=drive.distance[row],
        speed=drive.speed[row],
        height=drive.heights[row],
        axle=axle,
        contact=contact,
    )


def _account(forces: RoadForces, k: int) -> dict[str, Any]:
    import numpy as np

    contact, axle = forces.contact[:, k], forces.axle[:, k, 1]
    step = float(np.median(np.diff(forces.time))) if forces.time.size > 1 else 0.0
    return {
        "wheel": forces.wheels[k],
        "contact_least_n": float(np.nanmin(contact)),
        "contact_most_n": float(np.nanmax(contact)),
        "axle_least_n": float(np.nanmin(axle)),
        "axle_most_n": float(np.nanmax(axle)),
        "off_the_road_s": step * int((contact == 0.0).sum()),
    }


def _write_table(path: Path, forces: RoadForces) -> None:
    """Time, distance and speed, then height, contact and axle forces of each wheel; numbers as they are, in full."""
    import numpy as np

    heads = ["time_s", "distance_m", "speed_rad_s"]
    columns = [forces.time, forces.distance, forces.speed]
    for k, wheel in enumerate(forces.wheels):
        heads += [f"{wheel}_{name}" for name in ("road_height_m", "contact_load_n", "force_x_n", "force_z_n")]
        columns += [forces.height[:, k], forces.contact[:, k], forces.axle[:, k, 0], forces.axle[:, k, 1]]
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(heads) + "\n")
        for row in np.column_stack(columns).tolist():
            file.write(",".join("" if value != value else repr(value) for value in row) + "\n")
