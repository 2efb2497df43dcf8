"""``tire-dynamics info``: what is in a bag, whether it is whole, and whether it can be replayed.

A bag that is whole is not read for it: its index says all but what a log's own records and the first messages of the
inputs say, and these are few.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timezone
from os import PathLike
from typing import Any

from ..bag import BagReader
from ..bag.files import MCAP
from ..bag.writer import offered_qos
from ..files.errors import InputError
from ..replay.bag_setup import bag_setup, check, joints_of, log_record, log_topic, pipeline_of, remaps_of
from ..replay.input_map import mapped_types
from ..replay.inputs import mapped_values
from ..replay.parameters import complete
from ..replay.pipeline import fixed_inputs
from .answer import plain, printable

__all__ = ["info", "run"]

_LONGEST = 100  # characters of a name that are shown
_FIRST_FILES = 5  # that are named


def info(
    path: str | PathLike[str],
    remaps: Mapping[str, str] | None = None,
    joints: Mapping[str, str] | None = None,
    clock: str | None = None,
    inputs: str | PathLike[str] | None = None,
    vehicle: str | PathLike[str] | None = None,
) -> dict[str, Any]:
    """What is in a bag, as JSON has it.

    Parameters
    ----------
    path : path
        A rosbag2 folder, or a .mcap, .db3 or ROS 1 .bag file.
    remaps, joints, clock, inputs, vehicle
        As :func:`~tire_dynamics.replay.replay.replay` takes them.

    Returns
    -------
    dict
        ``input``; ``files`` (name, bytes) and ``bytes``; ``begin``, ``end`` (ISO 8601, UTC), ``begin_ns``, ``end_ns``
        of the log times, ``duration_s``; ``storage``; ``messages``; ``chunks`` by compression; ``topics``: name,
        type, messages, rate_hz (their mean over the whole bag), qos; ``metadata``: its records. ``log`` is None
        unless it is a log of the node: node, wheels, rate_hz, parameters (those not at their defaults), dropped
        (messages that never came into it, by topic; None if that is not known), or error. ``damage`` and
        ``repair``: what is wrong, and the command that helps; None for a whole bag. ``replay``: possible, wheels,
        inputs (topic of the bag by input), without (why, by wheel, of those that will have no outputs, as far as
        their first messages say) and mapped (what a field map takes of its topics' first messages: topic, quantity,
        unit, looked_at, rate_hz, malformed, and of each wheel or component count, low and high), or why not. What is
        not known is None.

    Raises
    ------
    InputError
        It is not a bag, or not one that can be read.
    """
    reader = BagReader(path, clock)
    begin, end = reader.start_ns, reader.end_ns
    duration = None if begin is None or end is None else (end - begin) * 1e-9
    recoverable = reader.damage and reader.storage == MCAP
    sizes = {file: file.stat().st_size for file in reader.paths}
    return {
        "input": str(path),
        "files": [{"name": file.name, "bytes": size} for file, size in sizes.items()],
        "bytes": sum(sizes.values()),
        "begin": _iso(begin),
        "end": _iso(end),
        "begin_ns": begin,
        "end_ns": end,
        "duration_s": duration,
        "storage": reader.storage,
        "messages": reader.message_count,
        "chunks": {name or "none": count for name, count in reader.chunks.items()},
        "topics": [
            {
                "name": topic,
                "type": kind,
                "messages": (count := reader.counts[topic]),
                "rate_hz": (count - 1) / duration if count is not None and count > 1 and duration else None,
                "qos": _qos(reader.qos.get(topic, "")),
            }
            for topic, kind in sorted(reader.topics.items())
        ],
        # rosbag2's own record is metadata.yaml once more
        "metadata": {name: content for name, content in sorted(reader.metadata.items()) if name != "rosbag2"},
        "log": _log(reader),
        "damage": reader.damage or None,
        "repair": f"tire-dynamics recover {shlex.quote(str(path))} -o OUT" if recoverable else None,
        "replay": _replay(reader, remaps or {}, joints or {}, inputs, vehicle),
    }


def _iso(time: int | None) -> str | None:
    """A time [ns] in UTC to the nanosecond."""
    if time is None:
        return None
    seconds, rest = divmod(time, 10**9)
    return f"{datetime.fromtimestamp(seconds, timezone.utc):%Y-%m-%dT%H:%M:%S}.{rest:09d}Z"


def _qos(text: str) -> list[str]:
    """What a topic was offered with, once for each kind of publisher."""
    profiles = [", ".join(str(each[key]) for key in ("reliability", "durability")) for each in offered_qos(text)]
    return list(dict.fromkeys(profiles))


def _log(reader: BagReader) -> dict[str, Any] | None:
    """What the node says of its log."""
    try:
        topic = log_topic(reader)
    except InputError as error:  # logs of several nodes
        return {"error": _without_name(reader, error)}
    if topic is None or reader.counts[topic] == 0:
        return None
    first = last = None
    try:
        for _, data in reader.rare(topic):
            last = log_record(data)
            first = first or last
        if first is None or last is None:
            return None
        values = complete(first["parameters"])
    except (InputError, ValueError) as error:
        return {"node": topic.removesuffix("/log_record"), "error": _without_name(reader, error)}
    defaults = complete({"wheels": values["wheels"]})
    dropped = {name: count for name, count in last.get("dropped", {}).items() if type(count) is int}
    return {
        "node": topic.removesuffix("/log_record"),
        "wheels": values["wheels"],
        "rate_hz": values["rate_hz"],
        "parameters": {name: value for name, value in values.items() if value != defaults[name]},
        "dropped": dropped,
    }


def _replay(
    reader: BagReader,
    remaps: Mapping[str, str],
    joints: Mapping[str, str],
    inputs: str | PathLike[str] | None,
    vehicle: str | PathLike[str] | None,
) -> dict[str, Any]:
    """Whether it can be replayed as it is."""
    try:
        how = bag_setup(reader, remaps=remaps, joints=joints, inputs=inputs, vehicle=vehicle)
    except InputError as error:
        return {"possible": False, "why_not": _without_name(reader, error)}
    wanted = {*fixed_inputs(how.values), *mapped_types(how.values)}
    found = {topic: name for topic, name in how.names.items() if name in reader.topics and topic in wanted}
    if not any(reader.counts[name] != 0 for name in found.values()):
        return {"possible": False, "why_not": "there is no message on any of its inputs"}
    try:
        mapped = pipeline_of(reader, how).mapped
        taken = [*mapped_values(reader, how.values, how.names, mapped)]
        without = check(reader, how, mapped) if how.log is None else {}
    except InputError as error:
        return {"possible": False, "why_not": _without_name(reader, error)}
    return {"possible": True, "wheels": how.values["wheels"], "inputs": found, "without": without, "mapped": taken}


def _without_name(reader: BagReader, error: Exception) -> str:
    return " ".join(str(error).split()).removeprefix(f"{reader.path}: ")


# -- for people -------------------------------------------------------------------------------------------------------


def run(options: argparse.Namespace) -> int:
    """Print what the options ask for on standard output.

    Returns
    -------
    int
        Exit status 0, also for a bag that is damaged or cannot be replayed: that is an answer.
    """
    names = remaps_of(options.remap), joints_of(options.joint)
    content = info(options.input, *names, options.clock, options.inputs, options.vehicle)
    if options.json:
        print(json.dumps(plain(content), indent=2, allow_nan=False))
        return 0
    facts = list(_facts(content))
    rows = [list(_row(topic)) for topic in content["topics"] if topic["messages"] != 0]
    if sys.stdout.isatty():
        try:
            _draw(facts, rows)
            return 0
        except ImportError:  # rich is not there
            pass
    for line in _lines(facts, rows):
        print(line)
    return 0


_HEADS = ("topic", "type", "messages", "rate [Hz]", "QoS")
_NUMBERS = (2, 3)  # columns that stand to the right


def _facts(content: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Name, text and colour of each line."""
    files, log, replay = content["files"], content["log"], content["replay"]
    storage = "" if content["storage"] == MCAP else f", {content['storage']}"
    yield "bag", f"{_shown(content['input'])}, {_size(content['bytes'])}{storage}", "bold"
    if len(files) > 1:
        names = ", ".join(_shown(file["name"]) for file in files[:_FIRST_FILES])
        yield "files", f"{len(files)}: {names}{' ...' if len(files) > _FIRST_FILES else ''}", ""
    if content["begin"] is not None:
        yield "time", f"{_second(content['begin'])} to {_second(content['end'])}, {_span(content['duration_s'])}", ""
    empty = [topic["name"] for topic in content["topics"] if topic["messages"] == 0]
    chunks = ", ".join(f"{count:,} chunks ({_shown(name)})" for name, count in content["chunks"].items())
    yield (
        "messages",
        f"{content['messages']:,} on {len(content['topics']) - len(empty)} topics" + (f", {chunks}" if chunks else ""),
        "",
    )
    if empty:
        yield "no message", f"on {len(empty)} topics more: {_listed(empty)}", ""
    for name, record in list(content["metadata"].items())[:_FIRST_FILES]:
        said = "; ".join(f"{key}: {value}" for key, value in list(record.items())[:_FIRST_FILES])
        yield "record", f"{_shown(name)}: {_shown(said, 500)}", ""
    if log is not None and "error" in log:
        yield "log of", f"a node, but {_shown(log['error'], 500)}", "yellow"
    elif log is not None:
        yield "log of", f"{_shown(log['node'])}: {_listed(log['wheels'])} at {log['rate_hz']:g} Hz", ""
        changed = ", ".join(
            f"{name} = {_value(value)}" for name, value in log["parameters"].items() if name != "wheels"
        )
        yield "parameters", _shown(changed or "all at their defaults", 2000), ""
        lost = ", ".join(f"{_shown(name)} {count:,}" for name, count in list(log["dropped"].items())[:20])
        yield "dropped", lost or "none", "yellow" if lost else ""
    if content["damage"]:
        yield "damaged", _shown(content["damage"], 500), "red"
        yield "", f"what is whole: {_shown(content['repair'], 500)}", "red"
    else:
        yield "whole", "yes", "green"
    if replay["possible"]:
        wheels = [wheel for wheel in replay["wheels"] if wheel not in replay["without"]]
        yield "replay", f"yes: {_listed(wheels)}", "green"
        for wheel, reason in replay["without"].items():
            yield "", f"no output of {_shown(wheel)}: {_shown(reason, 1000)}", "yellow"
        for each in replay["mapped"]:
            yield "field map", _shown(_taken(each), 1000), "yellow" if each["malformed"] else ""
    else:
        yield "replay", f"no: {_shown(replay['why_not'], 1000)}", "yellow"


def _taken(each: Mapping[str, Any]) -> str:
    """What the map takes of a quantity."""
    parts = []
    for name, of in each["values"].items():
        parts.append(f"{name} {of['low']:.4g} to {of['high']:.4g}" if of["count"] else f"{name} none")
    rate = "" if each["rate_hz"] is None else f" at {each['rate_hz']:.4g} Hz"
    bad = f", {each['malformed']:,} of them malformed" if each["malformed"] else ""
    head = f"{each['quantity']} [{each['unit']}] of {each['topic']}: "
    return f"{head}{', '.join(parts)}; first {each['looked_at']:,} messages{rate}{bad}"


def _row(topic: Mapping[str, Any]) -> Iterator[str]:
    count, rate = topic["messages"], topic["rate_hz"]
    yield _shown(topic["name"])
    yield _shown(topic["type"].replace("/msg/", "/"))
    yield "?" if count is None else f"{count:,}"
    yield "" if rate is None else f"{rate:.4g}" if rate < 1000 else f"{rate:.0f}"
    yield _shown(" | ".join(text.removesuffix(", volatile") for text in topic["qos"]))


def _lines(facts: Sequence[tuple[str, str, str]], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Plain text in columns."""
    for name, text, _ in facts:
        yield f"{name:12}{text}"
    if rows:
        yield ""
        widths = [max(map(len, column)) for column in zip(_HEADS, *rows, strict=True)]
        for row in [_HEADS, *rows]:
            cells = zip(row, widths, range(len(row)), strict=True)
            yield "  ".join(
                f"{cell:{'>' if place in _NUMBERS else '<'}{width}}" for cell, width, place in cells
            ).rstrip()


def _draw(facts: Sequence[tuple[str, str, str]], rows: Sequence[Sequence[str]]) -> None:
    """The same on a terminal, as wide as that is."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    grid = Table.grid(padding=(0, 2))
    for name, text, style in facts:
        grid.add_row(Text(name, "cyan"), Text(text, style))
    console.print(grid)
    if rows:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="cyan")
        for place, head in enumerate(_HEADS):
            table.add_column(head, justify="right" if place in _NUMBERS else "left", overflow="fold")
        # On a narrow terminal the package of a type is what is missed least.
        narrow = sum(max(map(len, column)) + 3 for column in zip(_HEADS, *rows, strict=True)) > console.width
        for topic, kind, *others in rows:
            table.add_row(*map(Text, [topic, kind.rpartition("/")[2] if narrow else kind, *others]))
        console.print(table)


def _shown(text: str, most: int = _LONGEST) -> str:
    text = printable(text)
    return text if len(text) <= most else f"{text[:most]} ..."


def _listed(names: Sequence[str]) -> str:
    return ", ".join(map(_shown, names[:20])) + (" ..." if len(names) > 20 else "")


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_value, value))}]"
    return f"{value:g}" if type(value) is float else str(value)


def _second(iso: str) -> str:
    """A time for people, to the millisecond."""
    return f"{iso[:10]} {iso[11:23]}"


def _size(count: float) -> str:
    for unit in ("B", "kB", "MB", "GB"):
        if count < 999.5:
            return f"{count:.3g} {unit}"
        count /= 1000.0
    return f"{count:.3g} TB"


def _span(seconds: float) -> str:
    hours, rest = divmod(seconds, 3600.0)
    minutes, rest = divmod(rest, 60.0)
    parts = [f"{hours:.0f} h"] * (hours > 0) + [f"{minutes:.0f} min"] * (seconds >= 60.0) + [f"{rest:.3f} s"]
    return " ".join(parts)
