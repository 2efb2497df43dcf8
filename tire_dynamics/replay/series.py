"""Speeds, loads and wrenches of one wheel as arrays, out of a bag."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..bag import BagReader
from ..cdr import messages
from ..files.progress import progress

__all__ = ["series_of"]


def series_of(
    reader: BagReader, names: Mapping[str, str], joint: str, quiet: bool, label: str = "identify"
) -> tuple[dict[str, tuple[Any, bool]], dict[str, int]]:
    """Rows (time [s since the bag's first message], receipt, values) of speed, load and force.

    Parameters
    ----------
    reader : BagReader
    names : mapping of str to str
        Of topics, to what they are: wheel_speed, joint_states, load, load_force, or measured, a wrench.
    joint : str
        Of the wheel, in joint states.
    quiet : bool
        No progress.
    label : str
        What the progress is of.

    Returns
    -------
    dict
        Of "speed" (one value), "load" (force.z, force.x) and "force" (force.x, force.z): the rows in order of receipt,
        and whether all have stamps; without, the time is that of receipt.
    dict
        By topic, how many messages could not be read.
    """
    joints = messages.JointStateDecoder()
    width = {"speed": 1, "load": 2, "force": 2}
    pieces: dict[str, list[Any]] = {name: [np.empty((0, 2 + count))] for name, count in width.items()}
    unreadable = dict.fromkeys(names, 0)
    begin = reader.start_ns or 0
    blocks = reader.blocks(names.keys() & reader.topics.keys())
    for block in progress(
        blocks, reader.message_count, label, size=lambda block: block.topic.size, unit="messages", quiet=quiet
    ):
        for number, topic in enumerate(block.topics):
            some = np.flatnonzero(block.topic == number)
            if topic not in names or not some.size:
                continue
            where = block.data, block.start[some], block.size[some]
            received = block.log_time[some]
            kind = names[topic]
            if kind in ("load", "measured"):
                valid, stamp, fx, fz = messages.decode_wrenches(*where)
                values = np.column_stack([fz, fx] if kind == "load" else [fx, fz])
            elif kind == "joint_states":
                valid, stamp, groups = joints.decode_block(*where)
                values = np.full((some.size, 1), math.nan)
                for indices, joint_names, velocities, _ in groups:
                    if joint in joint_names and joint_names.index(joint) < velocities.shape[1]:
                        values[indices, 0] = velocities[:, joint_names.index(joint)]
                    else:
                        valid[indices] = True
                has = np.isfinite(values[:, 0]) | ~valid  # others' joints are nothing wrong
                valid, stamp, values, received = valid[has], stamp[has], values[has], received[has]
            else:
                valid, number_ = messages.decode_float64s(*where)
                stamp = received
                values = np.column_stack([number_, np.zeros(some.size)][: 2 if kind == "load_force" else 1])
            unreadable[topic] += int((~valid).sum())
            target = {"measured": "force", "load": "load", "load_force": "load"}.get(kind, "speed")
            rows = np.column_stack([(stamp - begin) * 1e-9, (received - begin) * 1e-9, values])
            rows[stamp == 0, 0] = math.nan
            pieces[target].append(rows[valid])
    found: dict[str, tuple[Any, bool]] = {}
    for name, parts in pieces.items():
        rows = np.concatenate(parts)
        stamped = not np.isnan(rows[:, 0]).any()
        if not stamped:
            rows[:, 0] = rows[:, 1]
        found[name] = rows, stamped
    return found, unreadable
