"""``tire-dynamics compare``: a measured force at an axle against the model's."""

from __future__ import annotations

import argparse
import math
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from ..files.errors import InputError
from ..files.outputs import aside, writable
from .answer import answer

if TYPE_CHECKING:
    from ..report.wrenches import Wrench

__all__ = ["add_arguments", "run"]

_LONGEST = 86400.0  # [s] that is listened to


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options, but for those of ``answer`` and ``--joint``.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Its namespace is what ``run`` takes.
    """
    parser.description = (
        "Holds a force that was measured at a hub against the axle force of the model: coherence, gain and phase by "
        "frequency and by order of the wheel, delay, and the error by band, each with its 95 % interval, on one HTML "
        "page that needs no network. MEASURED is a bag, a CSV file or an MDF4 file (.mf4, by asammdf); MODEL is a log "
        "of the node, the output of a replay, or a CSV file. With --live both are topics of a running system."
    )
    parser.add_argument("measured", metavar="MEASURED", help="a bag, a .csv or a .mf4 file; with --live a topic")
    parser.add_argument("model", metavar="MODEL", help="a log, a replay's output, or a .csv file; with --live a topic")
    parser.add_argument("-o", "--output", metavar="HTML", required=True, help="the page to write")
    parser.add_argument("--topic", metavar="TOPIC", help="of a bag MEASURED: the force, geometry_msgs/WrenchStamped")
    parser.add_argument("--wheel", metavar="NAME", help="which wheel's axle_wrench of the log; needed of several")
    parser.add_argument(
        "--model-topic", metavar="TOPIC", help="of a bag MODEL: another force than the wheel's axle_wrench"
    )
    parser.add_argument(
        "--columns",
        metavar="NAME=COLUMN",
        nargs="+",
        default=[],
        help="of a CSV or MDF4 file MEASURED: x=, z=, speed= and, of a CSV, time= (z=force_z_n); in N and rad/s, or as "
        "the file says",
    )
    parser.add_argument(
        "--model-columns", metavar="NAME=COLUMN", nargs="+", default=[], help="the same of MODEL, if it is a CSV file"
    )
    parser.add_argument("--axes", choices=("z", "x", "xz"), default="xz", help="which forces (xz: what is there)")
    parser.add_argument("--scale", metavar="G", type=float, default=1.0, help="multiply the measured force (1)")
    parser.add_argument("--shift", metavar="S", type=float, default=0.0, help="add S seconds to the measured times (0)")
    parser.add_argument(
        "--align", action="store_true", help="take both files to begin together, whatever their clocks say"
    )
    parser.add_argument(
        "--max-delay", metavar="S", type=float, default=0.5, help="look for delays of at most S seconds (0.5)"
    )
    parser.add_argument("--segment", metavar="S", type=float, help="of the spectra (2 s, or a sixteenth of the whole)")
    parser.add_argument("--low", metavar="HZ", type=float, help="lowest frequency of the one gain and delay")
    parser.add_argument("--high", metavar="HZ", type=float, help="and the highest; else what can be seen")
    parser.add_argument(
        "--live", metavar="S", type=float, help="listen to the topics MEASURED and MODEL for S seconds, or to Ctrl-C"
    )
    parser.add_argument("--force", action="store_true", help="replace HTML if it exists")


def run(options: argparse.Namespace) -> int:
    """Compare what the options name, write the page, and say what was found.

    ``InputError``: a file or an option cannot be used.
    """
    output = Path(options.output)
    _check(options, output)
    from ..replay.bag_setup import joints_of
    from ..report import comparison, comparison_page, comparison_statements
    from ..report.wrenches import columns_of

    columns = columns_of(options.columns, "--columns")
    model_columns = columns_of(options.model_columns, "--model-columns")
    joints = joints_of(options.joint)
    if options.live is not None:
        measured, model = _listen(options, joints)
    else:
        measured = _read(options, options.measured, options.topic, "--topic", columns, joints)
        model = _read(options, options.model, options.model_topic, "--model-topic", model_columns, joints)
    found = comparison.compare(
        measured,
        model,
        axes=options.axes,
        shift=options.shift,
        align=options.align,
        scale=options.scale,
        most_delay=options.max_delay,
        segment=options.segment,
        low=options.low,
        high=options.high,
    )
    text, headline = comparison_page.page(found)
    with aside(output) as part:
        part.write_text(text, encoding="utf-8")
    said = [text for _, text in comparison_statements.statements(found)]
    lines = [f"{options.output}: {found.seconds:.4g} s in common, {found.segments} segments of {found.segment:.3g} s"]
    content = {"output": options.output, "headline": headline, **comparison_statements.content(found)}
    answer(options, content, *lines, *said, *(f"note: {note}" for note in found.notes))
    return 0


def _check(options: argparse.Namespace, output: Path) -> None:
    """What cannot be is better known before the work."""
    if output.suffix.lower() != ".html":
        raise InputError(f"--output is {output}; its name must end in .html")
    for package in ("plotly", "jinja2"):
        if find_spec(package) is None:
            raise InputError(f"the page needs {package}: pip install 'tire_dynamics[report]'")
    bounds = {
        "scale": (-1e6, 1e6, "a number other than 0, at most 1e6"),
        "shift": (-1e10, 1e10, "from -1e10 to 1e10 s"),
        "max_delay": (0.0, 600.0, "from 0 to 600 s"),
        "segment": (0.01, 600.0, "from 0.01 to 600 s"),
        "low": (0.0, 1e6, "from 0 to 1e6 Hz"),
        "high": (0.0, 1e6, "from 0 to 1e6 Hz"),
        "live": (0.1, _LONGEST, f"from 0.1 to {_LONGEST:g} s"),
    }
    for name, (least, most, said) in bounds.items():
        value = getattr(options, name)
        if value is not None and (math.isnan(value) or not least <= value <= most or name == "scale" and value == 0.0):
            raise InputError(f"--{name.replace('_', '-')} is {value:g}; it must be {said}")
    writable(output, force=options.force)
    for path in () if options.live is not None else (Path(options.measured), Path(options.model)):
        if output.exists() and path.exists() and output.samefile(path):
            raise InputError(f"{output}: is an input of this comparison")


def _read(
    options: argparse.Namespace, path: str, topic: str | None, option: str, columns: dict[str, str],
    joints: dict[str, str],
) -> Wrench:  # fmt: skip
    from ..report.wrenches import MDF, TABLES, read_bag, read_columns

    if Path(path).suffix.lower() in (*TABLES, *MDF):
        return read_columns(path, columns)
    wheel = options.wheel if option == "--model-topic" else None
    return read_bag(path, topic, option, wheel, joints, quiet=options.quiet or options.json)


def _listen(options: argparse.Namespace, joints: dict[str, str]) -> tuple[Wrench, Wrench]:
    """Both forces, and what there is of the wheel's speed, from topics."""
    from tempfile import TemporaryDirectory

    from ..cdr import messages
    from ..report.wrenches import read_bag

    if find_spec("rclpy") is None:
        raise InputError(
            "--live needs rclpy: source a ROS 2 installation, or pip install 'tire_dynamics[ros]' (Linux, x86-64)"
        )
    from ..ros.record import record

    names = [f"/{name.lstrip('/')}" for name in (options.measured, options.model)]
    if names[0] == names[1]:
        raise InputError(f"{names[0]}: is both MEASURED and MODEL; one of them must be another topic")
    prefix = names[1].rpartition("/")[0]
    topics = dict.fromkeys(names, messages.WRENCH_STAMPED)
    topics |= {f"{prefix}/wheel_speed": messages.FLOAT64, "/joint_states": messages.JOINT_STATE}
    with TemporaryDirectory(prefix="tire_dynamics_") as folder:
        bag = Path(folder) / "heard"
        heard = record(topics, bag, options.live)
        for name in names:
            if heard[name] < 2:
                raise InputError(f"{name}: {heard[name]} messages came; look at `ros2 topic list -t` and its QoS")
        return (
            read_bag(bag, names[0], "MEASURED", None, joints, quiet=True),
            read_bag(bag, names[1], "MODEL", options.wheel, joints, quiet=True),
        )
