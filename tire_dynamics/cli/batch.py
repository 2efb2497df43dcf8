"""Many bags through :func:`~tire_dynamics.replay.replay.replay`, each into a bag of its own, side by side."""

from __future__ import annotations

import argparse
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from ..bag.writer import check_replaceable, remove_bag
from ..files.errors import InputError
from ..files.progress import Progress
from ..replay.jobs import Failure, workers
from ..replay.parameters import read_car, read_config, read_inputs
from ..replay.replay import joints_of, remaps_of, replay
from .answer import answer, printable

__all__ = ["run"]


class _Task(NamedTuple):
    """A bag to replay into a new folder within ``staging``; absolute paths, which hold for every process."""

    source: str
    name: str
    staging: str
    config: str | None
    inputs: str | None
    vehicle: str | None
    remaps: dict[str, str]
    joints: dict[str, str]
    clock: str | None


class _Done(NamedTuple):
    """The bag as it was written, its messages in and out, and what there is to say about it."""

    folder: str
    received: int
    written: int
    damage: str
    without: dict[str, str]
    doubts: list[str]


def run(options: argparse.Namespace) -> int:
    """Replay every bag of ``options.input`` into the folder ``options.output``, and say which could not be.

    How many bags could not be replayed, or have a wheel without outputs; all others have been. ``InputError``:
    nothing has been replayed: two bags are one or have one name, an output exists, or an option is wrong.
    """
    directory = Path(options.output)
    outputs = _outputs(options.input, directory, force=options.force)
    if options.config:
        read_config(options.config)  # what is wrong with it is said once
    if options.inputs:
        read_inputs(options.inputs)
    if options.vehicle:
        read_car(options.vehicle)
    remaps, joints = remaps_of(options.remap), joints_of(options.joint)
    with workers(options.jobs, options.scheduler) as pool, _staging(directory) as staging:
        files = (options.config, options.inputs, options.vehicle)
        config, inputs, vehicle = (os.path.abspath(path) if path else None for path in files)
        tasks = [
            _Task(os.path.abspath(source), output.name, staging, config, inputs, vehicle, remaps, joints, options.clock)
            for source, output in outputs
        ]
        with closing(pool.each(_replay_one, tasks)) as results:
            bags = _collect(results, outputs, force=options.force, quiet=options.quiet)
    done = sum(bag["error"] is None for bag in bags)
    summary = f"{directory}: {done} of {len(outputs)} bags replayed"
    answer(options, {"output": str(directory), "replayed": done, "failed": len(bags) - done, "bags": bags}, summary)
    return len(outputs) - done + sum(bool(bag["without"]) for bag in bags)


def _outputs(sources: Sequence[str], directory: Path, *, force: bool) -> list[tuple[str, Path]]:
    """Each bag with the folder it is replayed into, if that may be done with all."""
    given: dict[Path, str] = {}
    outputs: dict[Path, str] = {}
    for source in sources:
        if (place := Path(source).resolve()) in given:
            raise InputError(f"{given[place]} and {source} are the same bag")
        name = re.sub(r"(\.mcap|\.db3|\.bag)?(\.zstd?)?$", "", Path(os.path.abspath(source)).name, count=1)
        if not name:
            raise InputError(f"{source}: has no name that its output could have")
        if (output := directory / name) in outputs:
            raise InputError(f"{outputs[output]} and {source} would both be replayed into {output}")
        given[place], outputs[output] = source, source
    if directory.exists() and not directory.is_dir():
        raise InputError(f"{directory}: is not a folder, which several bags need")
    for output in outputs:
        check_replaceable(output, force)
        for place, bag in given.items():
            if output.resolve() in (place, *place.parents):
                raise InputError(f"{output}: would replace the bag {bag}, which is to be replayed")
    return [(source, output) for output, source in outputs.items()]


@contextmanager
def _staging(directory: Path) -> Iterator[str]:
    """A hidden folder in the directory for bags that are not whole yet; with what is left in it, it goes."""
    try:
        existed = directory.is_dir()
        directory.mkdir(parents=True, exist_ok=True)
        staging = tempfile.mkdtemp(prefix=".replay.", dir=os.path.abspath(directory))
    except OSError as error:
        raise InputError(f"{directory}: cannot be written: {error.strerror}") from None
    try:
        yield staging
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        if not existed:
            with suppress(OSError):  # it is not empty, as a rule
                directory.rmdir()


def _replay_one(task: _Task) -> _Done:
    """Replay into a new folder within the staging; a second attempt, where the first was lost, has another."""
    own = tempfile.mkdtemp(dir=task.staging)
    summary = replay(
        task.source,
        Path(own) / task.name,
        config=task.config,
        inputs=task.inputs,
        vehicle=task.vehicle,
        quiet=True,
        remaps=task.remaps,
        joints=task.joints,
        clock=task.clock,
    )
    received, written = (sum(counts.values()) for counts in (summary.received, summary.written))
    return _Done(str(Path(own) / task.name), received, written, summary.damage, summary.without, summary.doubts)


def _collect(
    results: Iterator[tuple[int, _Done | Failure]], outputs: Sequence[tuple[str, Path]], *, force: bool, quiet: bool
) -> list[dict[str, Any]]:
    """Put whole bags into their places and say what is wrong with the others; what became of each, in order."""
    bags: dict[int, dict[str, Any]] = {}
    messages = 0
    with Progress(len(outputs), "replay", unit="bags", quiet=quiet, at_once=True) as shown:
        for number, result in results:
            source, output = outputs[number]
            if isinstance(result, _Done):
                result = _place(result, output, force=force)
            bag: dict[str, Any] = {"input": source, "output": str(output), "received": 0, "written": 0}
            if isinstance(result, Failure):
                reason = result.reason.replace(os.path.abspath(source), source).removeprefix(f"{source}: ")
                reason = reason.replace(os.path.join(os.getcwd(), ""), "")  # of what stands beside it
                print(printable(f"tire-dynamics: {source}: {reason}"), file=sys.stderr)
                bags[number] = {**bag, "output": None, "damage": None, "without": {}, "doubts": [], "error": reason}
            else:
                messages += result.received + result.written
                if result.damage:
                    print(
                        printable(f"{source} is damaged: {result.damage}; what stands before was replayed"),
                        file=sys.stderr,
                    )
                for wheel, reason in result.without.items():
                    print(printable(f"{source}: {wheel}: no output; {reason}"), file=sys.stderr)
                for doubt in result.doubts:
                    print(printable(f"{source}: doubtful: {doubt}"), file=sys.stderr)
                counts = {"received": result.received, "written": result.written}
                said = {"damage": result.damage or None, "without": result.without, "doubts": result.doubts}
                bags[number] = {**bag, **counts, **said, "error": None}
            shown.advance(1, messages)
    return [bags[number] for number in sorted(bags)]


def _place(result: _Done, output: Path, *, force: bool) -> _Done | Failure:
    """Put a bag into its place, or say why that cannot be."""
    try:
        check_replaceable(output, force)  # a second time: something may be there by now
        remove_bag(output)
        os.rename(result.folder, output)
    except InputError as error:
        return Failure(str(error))
    except OSError as error:
        return Failure(f"{output}: {error.strerror}")
    return result
