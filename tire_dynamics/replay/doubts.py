"""What is odd about a bag's speeds and loads, by the beginnings of its blocks, as they pass."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bag import BagReader, Block
from ..cdr import messages
from ..files.plausibility import GRAVITY, RECORD, Plausibility
from .parameters import unit_of

__all__ = ["InputDoubts"]

_MOST = 512  # inputs of every other block that are looked at: to decode all would make a replay 7 % slower

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class InputDoubts:
    """Looks at the inputs in blocks of messages.

    Parameters
    ----------
    reader : BagReader
        Of the bag that the inputs come from: what its import found doubtful stands in it.
    values, names : mapping
        As of a :class:`~tire_dynamics.replay.replay.Plan`. What a wheel carries at rest is known by a
        ``tire.sprung_mass``; without, it is more than wheel and tire weigh.
    """

    def __init__(self, reader: BagReader, values: Mapping[str, Any], names: Mapping[str, str]) -> None:
        unit = unit_of(values)
        unsprung = (unit.wheel_mass + unit.ring_mass) * GRAVITY
        weight = unsprung + unit.sprung_mass * GRAVITY if unit.sprung_mass else None
        self._seen = Plausibility(weight, unsprung)
        self._recorded = reader.metadata.get(RECORD, {}).get("doubts", "")
        self._joints = dict(zip(values["wheels"], values["joint_names"], strict=True))
        self._inputs = {names["joint_states"]: ("joint_states", "")} if "joint_states" in names else {}
        for wheel in values["wheels"]:
            given = values["load_source"] == "topic"  # of a road's heights nothing is odd
            for what in ("wheel_speed", "load", "load_force") if given else ("wheel_speed",):
                if (topic := f"{wheel}/{what}") in names:
                    self._inputs[names[topic]] = what, wheel
        self._decoder = messages.JointStateDecoder()
        self._skip = True  # was the block before
        self._source: dict[tuple[str, str], str] = {}  # the kind of topic by quantity and wheel: the first to come

    def take(self, block: Block) -> None:
        """Take a block, later than those taken before; of every other one the first 512 inputs are looked at."""
        self._skip = not self._skip
        if self._skip:
            self._seen.partial = True
            return
        inputs = np.flatnonzero(np.array([topic in self._inputs for topic in block.topics])[block.topic])
        self._seen.partial |= inputs.size > _MOST
        inputs = inputs[:_MOST]
        topics = block.topic[inputs]
        for number in np.unique(topics).tolist():
            what, wheel = self._inputs[block.topics[number]]
            some = inputs[topics == number]
            received, where = block.log_time[some], (block.data, block.start[some], block.size[some])
            if what == "joint_states":
                self._joint_states(received, *where)
            elif what == "load":
                _, stamp, _, force = messages.decode_wrenches(*where)
                self._add("load", wheel, what, np.where(stamp == 0, received, stamp), force)
            else:
                _, values = messages.decode_float64s(*where)
                self._add("speed" if what == "wheel_speed" else "load", wheel, what, received, values)

    def _joint_states(self, received: IntArray, data: bytes, start: IntArray, size: IntArray) -> None:
        _, stamp, groups = self._decoder.decode_block(data, start, size)
        times = np.where(stamp == 0, received, stamp)
        for wheel, joint in self._joints.items():
            values = np.full(times.size, np.nan)  # of messages without this joint
            for some, names, velocities, _ in groups:
                if joint in names and velocities.shape[1] == len(names):
                    values[some] = velocities[:, names.index(joint)]
            if np.isfinite(values).any():
                self._add("speed", wheel, "joint_states", times, values)

    def _add(self, quantity: str, wheel: str, what: str, times: IntArray, values: FloatArray) -> None:
        if self._source.setdefault((quantity, wheel), what) != what:
            return
        (self._seen.speeds if quantity == "speed" else self._seen.loads)(wheel, times, values)

    def doubts(self) -> list[str]:
        """What is odd so far, one line each, and what the bag's import found so."""
        seen = [doubt for doubt in self._seen.doubts() if doubt not in self._recorded]
        return [*seen, *([f"said at import: {self._recorded}"] if self._recorded else [])]
