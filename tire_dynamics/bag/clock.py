"""One clock for a bag's log times and its stamps, where its recorder had two.

A recorder that runs on wall time beside a simulation notes the receipt of each message by the wall's clock, while its
stamp is of simulated time. A wheel needs both on one clock.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from ..cdr.definition import SINGLE, full_name, parse_definition
from ..cdr.messages import JOINT_STATE, WRENCH_STAMPED, MessageError
from .block import Block

__all__ = ["CLOCKS", "begins_with_stamp", "on_clock", "stamps_of"]

IntArray = NDArray[np.int64]

CLOCKS = ("stamp", "log")
"""``stamp``: messages count as received when the stamps say so; ``log``: stamps are those of the receipt."""

_STAMPED = (JOINT_STATE, WRENCH_STAMPED)
_STAMPS = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
_HEAD = 12  # bytes: the encapsulation's four, seconds, nanoseconds
_SECOND = 10**9
_LEAP = 60 * _SECOND  # a stamp that is so far ahead of all before it is wrong, unless as much time has passed
_FASTEST = 100  # times wall time, of a simulation


def begins_with_stamp(msgtype: str, definition: str | None) -> bool:
    """Whether messages of a type begin with a header or a stamp, by its definition if it is not an input's own."""
    if msgtype in _STAMPED:
        return True
    try:
        first = parse_definition(definition or "", msgtype)[full_name(msgtype)][0]
    except (MessageError, LookupError):
        return False
    return first.kind in _STAMPS and first.length == SINGLE


def on_clock(blocks: Iterable[Block], stamped: Iterable[bool], clock: str) -> Iterator[Block]:
    """The blocks of a bag with one clock.

    With ``stamp`` the log time of every message is the latest stamp so far, as a live node with simulated time would
    have seen it; what is before the first stamp counts from that. Stamps that leap ahead of the others by more than
    a minute, and faster than time passes, are not followed. With ``log`` every stamp but zero is the log time.

    Parameters
    ----------
    blocks : iterable of Block
    stamped : iterable of bool
        By the topic's number, whether its messages begin with a stamp.
    clock : {"stamp", "log"}
    """
    has_stamp = np.array(list(stamped), bool)
    now = before = None  # the stamps' clock, and the log time of the last message
    for block in blocks:
        some = np.flatnonzero(has_stamp[block.topic] & (block.size >= _HEAD))
        stamps = stamps_of(block.data, block.start[some])
        some, stamps = some[stamps > 0], stamps[stamps > 0]
        if clock == "log":
            yield block._replace(data=_restamped(block, some))
            continue
        if now is None:
            now, before = int(stamps[0]) if stamps.size else 0, int(block.log_time[0])
        times = np.full(block.topic.size, now, np.int64)
        times[some] = stamps
        if (np.diff(np.maximum.accumulate(np.maximum(times, now)), prepend=now) > _LEAP).any():
            times = _without_leaps(times, block.log_time, now, int(before or 0))
        times = np.maximum.accumulate(np.maximum(times, now))
        now, before = int(times[-1]), int(block.log_time[-1])
        yield block._replace(log_time=times, publish_time=times.copy())


def _without_leaps(times: IntArray, log_time: IntArray, now: int, before: int) -> IntArray:
    kept = times.copy()
    for place, (time, received) in enumerate(zip(times.tolist(), log_time.tolist(), strict=True)):
        if time - now > _LEAP + _FASTEST * max(received - before, 0):
            kept[place] = now
        else:
            now, before = max(now, time), received
    return kept


def stamps_of(data: bytes, start: IntArray) -> IntArray:
    """Stamps [ns] of messages that begin with one, which must fit."""
    octets = np.frombuffer(data, np.uint8)
    words = octets[start[:, None] + np.arange(4, _HEAD)]
    big = octets[start + 1] & 1 == 0
    words[big] = words[big].reshape(-1, 2, 4)[:, :, ::-1].reshape(-1, 8)
    parts = words.reshape(-1).view(np.dtype([("sec", "<i4"), ("nanosec", "<u4")]))
    return parts["sec"].astype(np.int64) * _SECOND + parts["nanosec"].astype(np.int64)


def _restamped(block: Block, some: IntArray) -> bytes:
    """The data with the log times as the stamps of some messages; those beyond ROS time (2038) stay."""
    some = some[block.log_time[some] < 2**31 * _SECOND]
    octets = np.frombuffer(block.data, np.uint8).copy()
    parts = np.empty(some.size, np.dtype([("sec", "<i4"), ("nanosec", "<u4")]))
    parts["sec"], parts["nanosec"] = np.divmod(block.log_time[some], _SECOND)
    words = parts.view(np.uint8).reshape(-1, 8)
    start = block.start[some]
    big = octets[start + 1] & 1 == 0
    words[big] = words[big].reshape(-1, 2, 4)[:, :, ::-1].reshape(-1, 8)
    octets[start[:, None] + np.arange(4, _HEAD)] = words
    return octets.tobytes()
