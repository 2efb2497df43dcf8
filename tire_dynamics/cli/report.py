"""``tire-dynamics report``: a log, or the replay of a bag, as one page that opens from disk with no network.

``gather`` reads the bag once, in blocks; ``analysis`` has what is computed on the way, as functions and small classes
of arrays; ``theory`` has what the model says to hold against it, ``findings`` what it comes to in words; charts and
tables go into the template in ``page``.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from ..files.errors import InputError
from ..files.outputs import aside, writable

__all__ = ["add_arguments", "report", "run"]

SAMPLES = 500  # of the tire, if nobody says how many: a second of work


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    from . import uncertainty

    parser.description = (
        "Writes one HTML page about a drive: forces over time, spectra against the model, force variation by harmonic "
        "of the turn, the belt at the highest load, Campbell diagram, stability map and the quality of the inputs. The "
        "page needs no network. BAG is a log of the node or the output of a replay; any other bag is replayed first, "
        "into a temporary folder. With errors of the parameters it has bands on transmissibility and critical speed."
    )
    parser.add_argument("input", metavar="BAG", help="a rosbag2 folder or a .mcap file: a log, or inputs")
    parser.add_argument("-o", "--output", metavar="HTML", required=True, help="the page to write")
    parser.add_argument(
        "--config", metavar="YAML", help="replay BAG with these parameters of the node, or fields of one unit"
    )
    parser.add_argument(
        "--errors", metavar="FILE", help="errors of the parameters, as identify writes them; else those beside YAML"
    )
    uncertainty.add_arguments(parser)
    parser.add_argument("--force", action="store_true", help="replace HTML if it exists")


def run(options: argparse.Namespace) -> int:
    """Write the page that the options ask for, and say on standard error what was made.

    ``InputError``: as :func:`report` does.
    """
    from ..replay.replay import joints_of, remaps_of
    from .answer import answer

    quiet = options.quiet or options.json
    headline = report(
        options.input,
        options.output,
        config=options.config,
        errors=options.errors,
        error=options.error,
        samples=options.samples,
        seed=options.seed,
        force=options.force,
        remaps=remaps_of(options.remap),
        joints=joints_of(options.joint),
        clock=options.clock,
        inputs=options.inputs,
        quiet=quiet,
    )
    size = Path(options.output).stat().st_size
    content = {"output": options.output, "bytes": size, "headline": headline}
    answer(options, content, f"{options.output}: {headline} ({size / 1e6:.1f} MB)")
    return 0


def report(
    source: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    config: str | os.PathLike[str] | None = None,
    errors: str | os.PathLike[str] | None = None,
    error: Sequence[str] = (),
    samples: int | None = None,
    seed: int = 0,
    force: bool = False,
    remaps: Mapping[str, str] | None = None,
    joints: Mapping[str, str] | None = None,
    clock: str | None = None,
    inputs: str | os.PathLike[str] | None = None,
    quiet: bool = False,
) -> str:
    """Write the page about a bag.

    Parameters
    ----------
    source : path
        A log of the node or of a replay, which is taken as it is; or any bag that can be replayed.
    output : path
        The page, ``.html``.
    config : path, optional
        Parameters for a replay; with them a log is replayed as well.
    errors : path, optional
        Standard errors of the tire's parameters, as ``identify`` writes them.
    error : sequence of str
        Errors as FIELD=VALUE, beside those of the file or instead of them.
    samples : int, optional
        Of the tire within its errors. Any of these three asks for bands; without ``errors`` those beside ``config`` are
        taken. 500 if left out.
    seed : int
        Of the samples.
    force : bool
        Replace a page that exists.
    remaps : mapping, optional
        Topics of the bag by the inputs that they are to be, for a replay; with them a log is replayed as well.
    joints, clock, inputs
        As :func:`~tire_dynamics.replay.replay.replay` takes them; with them, too, a log is replayed.
    quiet : bool
        Show no progress, not even on a terminal.

    Returns
    -------
    str
        The page's headline.

    Raises
    ------
    InputError
        The bag, the parameters, their errors or the output cannot be used, or plotly or Jinja2 is missing.
    """
    from tempfile import TemporaryDirectory

    from ..bag import BagReader
    from ..bag.writer import keep_apart
    from ..replay.replay import replay
    from . import uncertainty

    target = Path(output)
    _check_output(target, force=force)
    uncertain = errors is not None or bool(error) or samples is not None
    samples = SAMPLES if samples is None else samples
    if uncertain:
        uncertainty.check_samples(samples, seed)
    if errors is not None and not Path(errors).is_file():
        raise InputError(f"--errors is {errors}; there is no such file")
    bag = reader = BagReader(source)
    keep_apart(bag.path, bag.paths, target)
    from ..report import gather, page, theory

    with TemporaryDirectory(prefix="tire_dynamics_") as folder:
        replayed = config is not None or bool(remaps or joints or clock or inputs) or not gather.has_outputs(bag)
        if replayed:
            log = Path(folder) / "replay"
            replay(
                bag.path, log, config=config, quiet=quiet, remaps=remaps, joints=joints, clock=clock, inputs=inputs
            )
            reader = BagReader(log)
        drive = gather.gather(reader, bag, replayed=replayed, quiet=quiet)
    if uncertain and drive.on_road:
        raise InputError(f"{bag.path}: its tires stand on a road; errors of parameters are for tires under given loads")
    known = None
    if uncertain:
        beside = None if config is None else uncertainty.errors_file(Path(config))
        some = uncertainty.errors_of(beside if errors is None else Path(errors), drive.unit, error)
        known = theory.Errors(*some, samples, seed)
    text, headline = page.page(drive, known)
    with aside(target) as part:
        part.write_text(text, encoding="utf-8")
    return headline


def _check_output(target: Path, *, force: bool) -> None:
    """Whether the page may be written: what cannot be is better known before the work."""
    if target.suffix.lower() != ".html":
        raise InputError(f"--output is {target}; its name must end in .html")
    if find_spec("plotly") is None or find_spec("jinja2") is None:
        raise InputError("reports need plotly and Jinja2: pip install 'tire_dynamics[report]'")
    writable(target, force=force)
