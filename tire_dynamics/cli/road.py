"""``tire-dynamics road``: a road and a speed into an input bag, with the height under each wheel, or into forces.

numpy and bags are imported where they are needed: the command line loads this module for its options.
"""

from __future__ import annotations

import argparse
import csv
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.errors import InputError, missing
from ..files.progress import progress
from . import road_forces
from .answer import answer
from .road_forces import START_NS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..science.road import Profile

__all__ = ["RECORD", "add_arguments", "run"]

RECORD = "tire_dynamics.road"  # name of the metadata record that says what road it is
CAR = ("front_left", "front_right", "rear_left", "rear_right")
MOST_SAMPLES = 20_000_000
MOST_ROWS = 5_000_000
MAX_SPEED = 150.0  # [m/s]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options, but for those of ``answer``."""
    parser.description = (
        "Makes an input bag of /joint_states and /<wheel>/road_height [m]: a random road of a class of ISO 8608, "
        "cleats, steps, or a profile from a CSV file over distance, all of which add up, driven over at a speed. Rear "
        "wheels find the same tracks a wheelbase later; left and right go together as on an isotropic road. Or it "
        "replays that bag at once, into the forces on the axles and from the road, and into a picture of them."
    )
    output = parser.add_argument_group("what is written; one of these at least")
    output.add_argument("-o", "--output", metavar="OUT", help="the input bag: a rosbag2 folder")
    output.add_argument(
        "--forces", metavar="OUT", help="a table, if the name ends in .csv; else the log that replay makes of the bag"
    )
    output.add_argument("--plot", metavar="PNG", help="draw road, contact load and axle force of each wheel")
    output.add_argument("--force", action="store_true", help="replace what is to be written and exists")
    kind = parser.add_argument_group("the road; what is given adds up")
    kind.add_argument("--class", dest="road_class", metavar="CLASS", help="A (very good) to H of ISO 8608")
    kind.add_argument("--seed", metavar="N", type=int, default=0, help="of the random road (0)")
    kind.add_argument(
        "--cleat",
        metavar="HEIGHT:LENGTH@AT",
        action="append",
        default=[],
        help="[m], on both tracks; may be repeated, and HEIGHT may be negative",
    )
    kind.add_argument("--step", metavar="HEIGHT@AT", action="append", default=[], help="[m], likewise")
    kind.add_argument(
        "--profile", metavar="CSV", help="columns with names: distance and height [m], or distance, left and right"
    )
    drive = parser.add_argument_group("the drive")
    drive.add_argument("--speed-kmh", metavar="V", type=float, help="constant [km/h]")
    drive.add_argument("--speed", metavar="CSV", help="columns with names: time [s] and speed [m/s], joined by lines")
    drive.add_argument("--duration", metavar="S", type=float, default=20.0, help="with --speed-kmh [s] (20)")
    drive.add_argument("--rate", metavar="HZ", type=float, help="samples a second; else the node's rate_hz (500)")
    car = parser.add_argument_group("the car")
    car.add_argument(
        "--wheels",
        metavar="WHEEL",
        nargs="+",
        help="one, two (left and right) or four (front left, front right, rear left, rear right); else --config's",
    )
    car.add_argument("--wheelbase", metavar="M", type=float, default=2.7, help="[m] (2.7)")
    car.add_argument("--track", metavar="M", type=float, default=1.55, help="between left and right [m] (1.55)")
    car.add_argument("--rolling-radius", metavar="M", type=float, help="[m]; else the radius of the tire")
    car.add_argument(
        "--static-load",
        metavar="N",
        type=float,
        nargs="+",
        help="of every wheel, or of each; else the node's static_loads",
    )
    car.add_argument(
        "--config",
        metavar="YAML",
        help="parameters of the node, or the fields of one unit. The heights are a mean over its patch; without, the "
        "tire of the paper has a point",
    )


def run(options: argparse.Namespace) -> int:
    """Make what the options ask for, and say on standard error what it is.

    ``InputError``: an option or a file cannot be used, or an output exists.
    """
    import numpy as np

    from ..replay.parameters import complete, read_config, unit_of
    from ..science.road import travelled

    given = read_config(options.config) if options.config else {}
    options.wheels = options.wheels or list(given.get("wheels", CAR))
    values = complete(given)
    options.rate = values["rate_hz"] if options.rate is None else options.rate
    _check(options)
    forces = options.forces is not None or options.plot is not None
    parameters = road_forces.parameters(options, given) if forces else {}
    unit = unit_of(values)
    radius = options.rolling_radius or unit.radius
    time, speed = _drive(options)
    distance = travelled(time, speed)
    points = values["contact_points"]
    half = unit.contact_half_angle / points
    patch, reach = 2.0 * unit.radius * math.sin(half), unit.radius * math.sin(half * (points - 1))
    left, right = _tracks(options, float(np.ptp(distance)) + options.wheelbase + 2.0 * reach)
    if patch:
        left, right = left.averaged(patch), right.averaged(patch)
    start = float(distance.min())
    behind = [0.0, 0.0, options.wheelbase, options.wheelbase]
    # the road begins under the rear axle: where the front one starts is a wheelbase further on
    offset = options.wheelbase if len(options.wheels) == 4 else 0.0
    told = distance - start + offset + reach * _directions(speed)
    columns = [(right if k % 2 else left).at(told - behind[k]) for k in range(len(options.wheels))]
    heights = np.stack(columns, axis=1)
    note = _note(options, patch, points)
    drive = road_forces.Drive(time, distance, speed / radius, heights)
    names = values["joint_names"] if options.wheels == list(values["wheels"]) else options.wheels
    content = {
        "output": options.output,
        "wheels": options.wheels,
        "samples": time.size,
        "duration_s": float(time[-1] - time[0]),
        "distance_m": float(distance[-1]),
        "patch_m": patch,
        "highest_m": heights.max(axis=0).tolist(),
        "lowest_m": heights.min(axis=0).tolist(),
        "rms_m": heights.std(axis=0).tolist(),
        "road": note,
    }
    what = (
        f"{len(options.wheels)} wheels, {time.size} samples, {distance[-1]:.4g} m in {time[-1] - time[0]:.4g} s, "
        f"heights from {heights.min():.4g} to {heights.max():.4g} m"
    )
    if not forces:
        _write(options.output, options, list(names), drive, note)
        answer(options, content, f"{options.output}: {what}")
        return 0
    with road_forces.places(options) as (bag, log):
        _write(bag, options, list(names), drive, note)
        more, lines = road_forces.write(options, parameters, drive, bag, log)
    answer(options, {**content, **more}, f"{options.output or 'road'}: {what}", *lines)
    return 0


def _directions(speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """1 forward, -1 backward; who stands keeps the one before."""
    import numpy as np

    moves = np.flatnonzero(speed)
    if not moves.size:
        return np.ones_like(speed)
    last = np.searchsorted(moves, np.arange(speed.size), side="right") - 1
    return np.asarray(np.sign(speed[moves[np.maximum(last, 0)]]))


def _check(options: argparse.Namespace) -> None:
    if options.output is None and options.forces is None and options.plot is None:
        raise InputError("needs an output: -o, --forces or --plot")
    if not (options.road_class or options.cleat or options.step or options.profile):
        raise InputError("needs a road: --class, --cleat, --step or --profile")
    if (options.speed_kmh is None) == (options.speed is None):
        raise InputError("needs one of --speed-kmh and --speed")
    if len(options.wheels) not in (1, 2, 4):
        raise InputError(f"there are {len(options.wheels)} wheels; --wheels must name 1, 2 or 4")
    for name in options.wheels:
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
            raise InputError(f"--wheels: {name[:80]!r} is no ROS name")
        if options.wheels.count(name) > 1:
            raise InputError(f"--wheels: {name} stands there twice")
    bounds = (
        ("--duration", options.duration, 0.01, 86400.0),
        ("--rate", options.rate, 1.0, 10_000.0),
        ("--wheelbase", options.wheelbase, 0.0, 100.0),
        ("--track", options.track, 0.0, 100.0),
        ("--rolling-radius", options.rolling_radius, 0.01, 10.0),
    )
    for option, value, low, high in bounds:
        if value is not None and not low <= value <= high:
            raise InputError(f"{option} is {value:g}; it must be from {low:g} to {high:g}")
    if options.seed < 0:
        raise InputError(f"--seed is {options.seed}; it must be >= 0")


def _drive(options: argparse.Namespace) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times [s], evenly from 0 on, and speeds [m/s]."""
    import numpy as np

    if options.speed is None:
        speed = options.speed_kmh / 3.6
        if not abs(speed) <= MAX_SPEED:
            raise InputError(
                f"--speed-kmh is {options.speed_kmh:g}; it must be from -{MAX_SPEED * 3.6:g} to {MAX_SPEED * 3.6:g}"
            )
        duration, given = options.duration, (np.array([0.0, options.duration]), np.array([speed, speed]))
    else:
        table = _read(Path(options.speed), ("time", "speed"))
        given = table["time"] - table["time"][0], table["speed"]
        if not np.abs(given[1]).max() <= MAX_SPEED:
            raise InputError(
                f"{options.speed}: has a speed of {np.abs(given[1]).max():g} m/s; up to {MAX_SPEED:g} are taken"
            )
        duration = float(given[0][-1])
    count = math.floor(duration * options.rate * (1.0 + 1e-12)) + 1
    if not 2 <= count <= MOST_SAMPLES:
        raise InputError(
            f"{duration:g} s at {options.rate:g} Hz are {count} samples; there must be from 2 to {MOST_SAMPLES}"
        )
    time = np.arange(count) / options.rate
    return time, np.interp(time, *given)


def _tracks(options: argparse.Namespace, length: float) -> tuple[Profile, Profile]:
    """The left and the right track, of all that is asked for."""
    import numpy as np

    from ..science.road import Profile, bump, random_tracks

    both: tuple[list[Profile], list[Profile]] = ([], [])
    try:
        if options.road_class:
            name = options.road_class.upper()
            for some, track in zip(
                both, random_tracks(name, max(length, 1.0), options.track, seed=options.seed), strict=True
            ):
                some.append(track)
        for option, texts in (("--cleat", options.cleat), ("--step", options.step)):
            for text in texts:
                cleat = bump(*_numbers(option, text))
                both[0].append(cleat)
                both[1].append(cleat)
        if options.profile:
            table = _read(Path(options.profile), ("distance",), (("height",), ("left", "right")))
            for some, column in zip(both, ("left", "right"), strict=True):
                some.append(Profile(table["distance"], table[column if column in table else "height"]))
    except ValueError as error:
        raise InputError(str(error)) from None
    if len(both[0]) == 1:
        return both[0][0], both[1][0]
    sums = []
    for some in both:
        s = np.unique(np.concatenate([each.distance for each in some]))
        sums.append(Profile(s, np.sum([each.at(s) for each in some], axis=0)))
    return sums[0], sums[1]


def _numbers(option: str, text: str) -> tuple[float, ...]:
    """Height, place and, of a cleat, length."""
    shape = "HEIGHT:LENGTH@AT" if option == "--cleat" else "HEIGHT@AT"
    size, at, place = text.partition("@")
    height, colon, length = size.partition(":")
    try:
        if not at or bool(colon) != (option == "--cleat"):
            raise ValueError
        return (float(height), float(place), float(length)) if colon else (float(height), float(place))
    except ValueError:
        raise InputError(
            f"{option} is {text[:80]!r}; it must be {shape}, such as 0.01{':0.02' * (':' in shape)}@5"
        ) from None


def _read(
    path: Path, needed: tuple[str, ...], either: tuple[tuple[str, ...], ...] = ()
) -> dict[str, NDArray[np.float64]]:
    """Columns of a CSV file by their names; the first column must increase."""
    import numpy as np

    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            rows = csv.reader(file)
            names = [name.strip() for name in next(rows, [])]
            wanted = [*needed]
            if either:
                kinds = [kind for kind in either if set(kind) <= set(names)]
                if not kinds:
                    choice = " or ".join(" and ".join(kind) for kind in either)
                    raise InputError(f"{path}: has no column {choice}; its columns are {', '.join(names)[:200]}")
                wanted += kinds[0]
            for name in wanted:
                if names.count(name) != 1:
                    raise InputError(
                        f"{path}: has {names.count(name)} columns {name!r}; its columns are {', '.join(names)[:200]}"
                    )
            places = [names.index(name) for name in wanted]
            values: list[list[float]] = []
            for row in rows:
                if not row:
                    continue
                try:
                    numbers = [float(row[place]) for place in places]
                except (ValueError, IndexError):
                    raise InputError(f"{path}: line {rows.line_num} has no number in {' or '.join(wanted)}") from None
                if not all(map(math.isfinite, numbers)):
                    raise InputError(f"{path}: line {rows.line_num} has a number that is not finite")
                if values and not numbers[0] > values[-1][0]:
                    was = f"{numbers[0]:g} after {values[-1][0]:g}"
                    raise InputError(f"{path}: line {rows.line_num}: {wanted[0]} is {was}; it must increase")
                values.append(numbers)
                if len(values) > MOST_ROWS:
                    raise InputError(f"{path}: has more than {MOST_ROWS} lines")
    except FileNotFoundError:
        raise missing(path) from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(values) < 2:
        raise InputError(f"{path}: has {len(values)} lines of numbers; it must have two at least")
    return dict(zip(wanted, np.array(values).T, strict=True))


def _note(options: argparse.Namespace, patch: float, points: int) -> dict[str, str]:
    """What road it is, in words."""
    note = {}
    if options.road_class:
        note["random"] = f"ISO 8608 class {options.road_class.upper()}, seed {options.seed}, track {options.track:g} m"
    for name, texts in (("cleats", options.cleat), ("steps", options.step)):
        if texts:
            note[name] = ", ".join(texts)
    if options.profile:
        note["profile"] = Path(options.profile).name
    note["patch"] = f"mean over {patch:g} m" if patch else "a point"
    if points > 1:
        note["patch"] += f", under the foremost of {points} points"
    return note


def _write(
    output: str,
    options: argparse.Namespace,
    joints: list[str],
    drive: road_forces.Drive,
    note: dict[str, str],
) -> None:
    import numpy as np

    from ..bag import BagWriter
    from ..cdr.messages import FLOAT64, JOINT_STATE, JointStateEncoder, encode_float64

    encoder = JointStateEncoder(joints)
    stamps = (START_NS + np.round(drive.time * 1e9).astype(np.int64)).tolist()
    with BagWriter(output, force=options.force, aside=True, chunk_size=2**20, metadata={RECORD: note}) as bag:
        states = bag.add_topic("/joint_states", JOINT_STATE)
        topics = [bag.add_topic(f"/{wheel}/road_height", FLOAT64) for wheel in options.wheels]
        rows: Any = zip(stamps, drive.speed.tolist(), drive.heights.tolist(), strict=True)
        for stamp, speed, row in progress(rows, len(stamps), "road", unit="samples", quiet=options.quiet):
            bag.write(states, stamp, stamp, encoder.encode(stamp, [speed] * len(joints)))
            for topic, height in zip(topics, row, strict=True):
                bag.write(topic, stamp, stamp, encode_float64(height))
