"""The order of a replay's events: messages and ticks, of a log as they were, of other bags made anew."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from ..bag import BagReader, Block
from ..cdr import messages
from ..files.progress import progress
from .doubts import InputDoubts
from .pipeline import LOG_RECORD, TICK, Events, Pipeline

__all__ = ["between_records", "received_events", "recorded_events"]

IntArray = NDArray[np.int64]

_LEAST = 4096  # messages that are taken together; more cost memory and save nothing


def between_records(blocks: Iterable[Events]) -> Iterator[Events]:
    """The events, :data:`LOG_RECORD` among them, cut such that each log record is one of its own."""
    for events in blocks:
        record = events.topics.index(LOG_RECORD) if LOG_RECORD in events.topics else -1
        records = np.flatnonzero(events.topic == record)
        edges = np.unique(np.concatenate([[0], records, records + 1, [events.topic.size]]))
        for first, last in itertools.pairwise(edges.tolist()):
            yield events.part(slice(first, last))


def recorded_events(reader: BagReader, names: Mapping[str, str], pipeline: Pipeline, quiet: bool) -> Iterator[Events]:
    """A log's own events, in the order in which they were written."""
    relative = {name: topic for topic, name in names.items()}
    wanted = {names[topic] for topic in (TICK, LOG_RECORD, *pipeline.inputs)}
    blocks = reader.blocks(wanted & reader.topics.keys(), in_file_order=True, least=_LEAST)
    for block in progress(blocks, reader.message_count, "replay", size=_size, unit="messages", quiet=quiet):
        topics = tuple(relative.get(name, "") for name in block.topics)
        ticks = np.flatnonzero(block.topic == topics.index(TICK)) if TICK in topics else np.empty(0, np.int64)
        valid, times = messages.decode_clocks(block.data, block.start[ticks], block.size[ticks])
        if not valid.all():
            start = block.start[ticks[~valid][0]]
            messages.decode_clock(block.data[start : start + block.size[ticks[~valid][0]]])  # says why
        tick, published = np.zeros_like(block.log_time), block.publish_time.copy()
        tick[ticks] = published[ticks] = times
        yield Events(topics, block.topic, block.log_time, published, tick, block.data, block.start, block.size)


def received_events(
    reader: BagReader, names: Mapping[str, str], pipeline: Pipeline, seen: InputDoubts | None, quiet: bool
) -> Iterator[Events]:
    """The inputs in the order of their receipt, and ticks between them, at the multiples of the period.

    Once nothing has been received for so long that every wheel has stopped, there are no ticks until something
    is: a pause of a year in the bag costs nothing.
    """
    period = pipeline.vehicle.settings.period
    silence = 2 * pipeline.vehicle.settings.input_timeout + period
    relative = {names[topic]: topic for topic in pipeline.inputs}
    due = last = None
    blocks = reader.blocks(relative.keys() & reader.topics.keys(), least=_LEAST)
    for block in progress(blocks, reader.message_count, "replay", size=_size, unit="messages", quiet=quiet):
        if seen is not None:
            seen.take(block)
        times = block.log_time
        if due is None or last is None:
            last = int(times[0])
            due = _up_to_multiple(last, period)
        ticks, due = _ticks_before(times, due, last, period, silence)
        last = int(times[-1])
        yield _with_ticks(block, tuple(relative.get(name, "") for name in block.topics), ticks)
    if due is not None and due == last:
        data = messages.encode_clock(due)
        moment, one = np.array([due]), np.zeros(1, np.int64)
        yield Events((TICK,), one, moment, moment, moment, data, one, one + len(data))


def _ticks_before(times: IntArray, due: int, last: int, period: int, silence: int) -> tuple[IntArray, int]:
    """The ticks before messages at ascending times, the next due and the last message before them given; the next."""
    pieces = []
    before = np.concatenate([[last], times[:-1]])
    pauses = np.flatnonzero(times - before > silence)
    for pause in [*pauses.tolist(), None]:
        end = int(times[-1] if pause is None else before[pause] + silence + 1)
        if end > due:
            piece = np.arange(due, end, period)
            pieces.append(piece)
            due = int(piece[-1]) + period
        if pause is not None:  # go on with the last tick before this message
            due = max(due, _up_to_multiple(int(times[pause]), period) - period)
    return np.concatenate([np.empty(0, np.int64), *pieces]), due


def _with_ticks(block: Block, topics: tuple[str, ...], ticks: IntArray) -> Events:
    """Messages and ticks in order; a tick is before the messages of later times."""
    encoded = messages.encode_clocks(ticks)
    size = len(encoded[0]) if encoded else 0
    place = np.searchsorted(block.log_time, ticks, side="right")
    start = len(block.data) + size * np.arange(ticks.size)
    columns = [
        np.insert(column, place, values)
        for column, values in (
            (block.topic, len(topics)), (block.log_time, ticks), (np.zeros_like(block.log_time), ticks),
            (block.start, start), (block.size, size), (block.publish_time, ticks),
        )
    ]  # fmt: skip
    data = block.data + b"".join(encoded)
    topic, received, tick, starts, sizes, published = columns
    return Events((*topics, TICK), topic, received, published, tick, data, starts, sizes)


def _size(block: Block) -> int:
    return block.topic.size


def _up_to_multiple(moment: int, period: int) -> int:
    return -(-moment // period) * period
