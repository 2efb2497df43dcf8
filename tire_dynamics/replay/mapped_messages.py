"""Messages of mapped topics as arrays, for who looks at a bag and does not replay it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..cdr.field_reader import FieldReader
from .input_map import QUANTITIES, MappedTopic

__all__ = ["MappedMessages", "Samples"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Samples(NamedTuple):
    """N messages: whether each was what the map is for, its stamp [ns], and SI values by quantity.

    Those are (N, W) for W wheels or components; NaN where a message has none.
    """

    valid: NDArray[np.bool_]
    stamp: IntArray
    values: Mapping[str, FloatArray]


class MappedMessages:
    """Reads messages of mapped topics by their plans.

    Parameters
    ----------
    topics : sequence of MappedTopic
        As a pipeline has them.
    wheels : int
    """

    def __init__(self, topics: list[MappedTopic], wheels: int) -> None:
        self._topics = {topic.topic: (number, topic) for number, topic in enumerate(topics)}
        self._reader = FieldReader([topic.plan for topic in topics])
        self._wheels = wheels

    @property
    def mapped(self) -> list[MappedTopic]:
        """As they were given."""
        return [topic for _, topic in self._topics.values()]

    @property
    def topics(self) -> dict[str, str]:
        """Message type by topic."""
        return {name: topic.msgtype for name, (_, topic) in self._topics.items()}

    def read(self, topic: str, received: IntArray, data: bytes, start: IntArray, size: IntArray) -> Samples:
        """The messages ``data[start[i] : start[i] + size[i]]`` of a topic, received at some times [ns]."""
        number, mapped = self._topics[topic]
        reader, count = self._reader, len(start)
        valid, stamp = np.zeros(count, np.bool_), received.copy()
        values = {
            group.quantity: np.full((count, QUANTITIES[group.quantity].size or self._wheels), np.nan)
            for group in mapped.values
        }
        raw, found = np.asarray(reader.values), np.asarray(reader.found)
        for k, (begin, length) in enumerate(zip(start.tolist(), size.tolist(), strict=True)):
            if not reader.read(number, data[begin : begin + length]):
                continue
            valid[k] = True
            if reader.has_stamp and reader.stamp:
                stamp[k] = reader.stamp
            for group in mapped.values:
                slots = np.arange(group.first, group.first + len(group.scales))
                there = found[slots] > 0
                place = np.array(group.wheels or range(len(slots)))
                si = raw[slots] * np.array(group.scales) + np.array(group.shifts)
                values[group.quantity][k, place[there]] = si[there]
        return Samples(valid, stamp, values)
