"""``tire-dynamics import --inputs``: CSV files by a field map, whose topics are files and whose fields are columns."""

from __future__ import annotations

import argparse
import json
import struct
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.csv_table import TIME_UNITS, Table, read_table
from ..files.errors import InputError
from ..files.progress import progress
from .answer import answer, printable

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["run"]

_ARRAY = "std_msgs/msg/Float64MultiArray"
_WHEEL = "{wheel}"
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"


def run(options: argparse.Namespace) -> int:
    """Make a bag of the files that the map names: a topic for each, with a message for each row.

    The numbers stay as they are in the files. What they are stands in a record of the bag, the map with the bag's own
    topics, by which it is replayed.

    ``InputError``: the map, a file or a column cannot be used, or the output exists.
    """
    from ..replay.input_map import QUANTITIES
    from ..replay.parameters import CAR, read_inputs
    from ..replay.pipeline import Pipeline

    for option in ("speed", "load", "speed_columns", "load_columns"):
        if getattr(options, option) is not None:
            raise InputError(f"--{option.replace('_', '-')} and --inputs are given; the map names files and columns")
    given = read_inputs(options.inputs)
    wheels = given.get("wheels", CAR)
    columns: dict[str, list[str]] = {}  # by file
    clocks: dict[str, str] = {}
    made: dict[str, Any] = {"wheels": list(wheels)}
    for quantity in QUANTITIES:
        prefix = f"inputs.{quantity}"
        topic = given.get(f"{prefix}.topic", ())
        if not topic:
            continue
        [file] = [topic] if isinstance(topic, str) else topic if len(topic) == 1 else [""]
        if not file or _WHEEL in file:
            raise InputError(f"{options.inputs}: {prefix}.topic is {topic!r}; of an import it must be one CSV file")
        fields = given.get(f"{prefix}.field", ())
        order = given.get(f"{prefix}.order") or wheels
        names = [fields] if isinstance(fields, str) else list(fields)
        if len(names) == 1 and _WHEEL in names[0]:
            names = [names[0].replace(_WHEEL, wheel) for wheel in ([order] if isinstance(order, str) else order)]
        if not names:
            raise InputError(f"{options.inputs}: {prefix}.field is empty; it must name the columns of {file}")
        known = columns.setdefault(file, [])
        known += [name for name in names if name not in known]
        clock = given.get(f"{prefix}.stamp", "")
        if clocks.setdefault(file, clock) != clock:
            raise InputError(f"{options.inputs}: {file} has several columns of time, {clocks[file]!r} and {clock!r}")
        made |= {name: value for name, value in given.items() if name.startswith(f"{prefix}.")}
        made |= {f"{prefix}.topic": _topic(file), f"{prefix}.type": _ARRAY, f"{prefix}.stamp": "receipt"}
        made[f"{prefix}.field"] = [f"data[{known.index(name)}]" for name in names]
    if not columns:
        raise InputError(f"{options.inputs}: maps nothing")
    try:
        Pipeline(made)
    except ValueError as error:
        raise InputError(f"{options.inputs}: {error}") from None
    beside = Path(options.inputs).parent
    tables = {file: _table(beside / file, names, clocks[file]) for file, names in columns.items()}
    _write(options, tables, made)
    remarks = [remark for table in tables.values() for remark in (*table.notes, *table.remarks())]
    remarks += [f"doubtful: {doubt}" for table in tables.values() for doubt in table.doubts]
    if options.json or options.quiet:  # else they are part of what is said
        for remark in remarks:
            print(printable(remark), file=sys.stderr)
    rows = {_topic(file): len(table.times) for file, table in tables.items()}
    said = ", ".join(f"{topic} {count}" for topic, count in rows.items())
    content = {"output": options.output, "wheels": list(wheels), "rows": rows, "parameters": made}
    answer(options, content, *remarks, f"{options.output}: {said}")
    return 0


def _topic(file: str) -> str:
    name = "".join(letter if letter.isalnum() and letter.isascii() else "_" for letter in Path(file).stem)
    return f"/{name if name[:1].isalpha() else f'file_{name}'}"


def _table(path: Path, names: Sequence[str], clock: str) -> Table:
    column, _, unit = clock.rpartition(" ") if clock.rpartition(" ")[2] in TIME_UNITS else (clock, "", "")
    return read_table(path, list(names), column or None, unit or None)


def _write(options: argparse.Namespace, tables: Mapping[str, Table], made: Mapping[str, Any]) -> None:
    import numpy as np

    from ..bag import BagWriter
    from ..replay.bag_setup import MAP_RECORD

    record = {MAP_RECORD: {"parameters": json.dumps(made)}}
    times = np.concatenate([table.times for table in tables.values()])
    place = np.concatenate([np.full(len(table.times), k) for k, table in enumerate(tables.values())])
    row = np.concatenate([np.arange(len(table.times)) for table in tables.values()])
    with BagWriter(options.output, force=options.force, aside=True, chunk_size=2**20, metadata=record) as bag:
        topics = [bag.add_topic(_topic(file), _ARRAY) for file in tables]
        values = [table.values for table in tables.values()]
        order = np.argsort(times, kind="stable").tolist()
        for k in progress(order, len(order), "import", unit="rows", quiet=options.quiet):
            numbers = values[place[k]][row[k]].tolist()
            head = struct.pack("<4s3I", _LITTLE_ENDIAN, 0, 0, len(numbers))  # no dimensions, no offset
            data = head + struct.pack(f"<4x{len(numbers)}d", *numbers)
            bag.write(topics[place[k]], int(times[k]), int(times[k]), data)
