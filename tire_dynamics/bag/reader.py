"""Reads rosbag2 bags, and single files of a bag.

Files of other storages than MCAP are read by ``foreign``. Bags come from strangers and from nodes that were killed, so
every length is checked before it is believed, a file without its end is read as far as it goes, and memory holds a
chunk or a few, whatever the length of the bag.

A span is a piece of a file that holds whole records: a chunk, or a run of messages outside chunks.

The file is long because the reader of a bag, the walk through one MCAP file and the order of messages across chunks
share one state: what has been declared, where the spans are, and what was found damaged.
"""

from __future__ import annotations

import heapq
import os
import struct
import zlib
from array import array
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..files.errors import InputError
from .block import Block
from .chunks import HEAD, heads_at
from .clock import CLOCKS, begins_with_stamp, on_clock
from .fields import OTHER_FIELDS, has_other_fields
from .files import MCAP, SQLITE, Found, Unpacking, files_of, yaml_texts
from .record_types import MAGIC, Channel, Metadata, MetadataIndex, Opcode, Schema, Statistics
from .records import (
    CHUNK,
    DAMAGE,
    MAX_KEPT,
    MAX_RECORD,
    MESSAGE,
    RECORD,
    RUN,
    ZSTD_MAGIC,
    DamageError,
    chunk_records,
    exactly,
    message_records,
    one_line,
    reading,
    unpacked_message,
)

if TYPE_CHECKING:
    from .foreign import ForeignFile

__all__ = ["BagReader", "Block", "Message", "yaml_texts"]

_NO_TIME = 2**63 - 1  # of a file without messages
_MAX_PENDING = 32 * 2**20  # bytes held back because chunks overlap in time
_MAX_NAME = 20  # bytes of a compression's name
_MAX_QOS = 8 * 2**20  # characters of the texts about QoS in a file; what is beyond is not needed to read it
_MAX_UNPACKED = 32 * 2**20  # bytes of a chunk's messages that were compressed one by one
_FIRST_SPANS = 4  # chunks that are read for the first messages of a topic
_BLOCK = 4 * 2**20  # bytes of a block, beside what is held back

_CHUNK_OPCODE = bytes([Opcode.CHUNK])
_CHUNK_INDEX = struct.Struct("<QQQQI")  # start, end, offset, length, bytes of the message indexes' places
_INDEX_PLACE = np.dtype([("channel", "<u2"), ("offset", "<u8")])
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, summary start, summary offset start, CRC
_FOOTER_LENGTH = _FOOTER.size + len(MAGIC)

Message = tuple[str, str, int, int, bytes]
"""Topic, message type, log time and publish time [ns], serialised message."""

_Rows = NDArray[np.int64]  # (6, N), messages: place in the bag, topic, log time, publish time, start and size of data
_UNDECLARED, _UNWANTED = -2, -1  # instead of a topic


class BagReader:
    """Reads a bag: a rosbag2 folder, or a single ``.mcap``, ``.db3`` or ROS 1 ``.bag`` file.

    What is compressed, by message, by chunk or as a file (``.zstd``), is decompressed.

    Parameters
    ----------
    path : path
        The folder or the file.
    clock : {"stamp", "log"}, optional
        One clock for log times and stamps in ``messages`` and ``blocks``, as :func:`.clock.on_clock` has it; default
        both as they were recorded.

    Attributes
    ----------
    topics : dict of str to str
        Topic to message type; of a topic that is declared with several, all of them, with commas.
    encodings : dict of str to str
        Topic to how its messages are encoded, "cdr" if they can be read.
    storage : str
        "mcap", "sqlite3" or "ROS 1".
    metadata : dict of str to dict of str to str
        MCAP metadata records by name.
    message_count : int
    start_ns, end_ns : int or None
        Log time of the first and the last message; None if there is no message.
    damage : str
        What is wrong with a file that ends early, for instance because its recorder was killed; empty for a
        whole bag. All that stands before the damage is read.
    counts : dict of str to (int or None)
        Messages by topic; None where the bag does not say.
    qos : dict of str to str
        What the recorder wrote of each topic's QoS, as YAML.
    chunks : Counter
        How many chunks there are by compression; "" is none.

    Raises
    ------
    InputError
        If it is not a bag, or not one that can be read.
    """

    def __init__(self, path: str | os.PathLike[str], clock: str | None = None) -> None:
        if clock not in (None, *CLOCKS):
            raise InputError(f"--clock is {clock!r}; it must be {' or '.join(CLOCKS)}")
        self.path, self.clock = Path(path), clock
        self._files: list[_BagFile] = []
        self._foreign: list[ForeignFile] = []
        self.qos: dict[str, str] = {}
        self._unpacking = Unpacking()
        found = [self._unpacking.find(name) for name in files_of(self.path)]
        self.storage = found[0].kind
        if any(one.kind != self.storage for one in found):
            raise InputError(f"{self.path}: its files are of several storages: {', '.join({f.kind for f in found})}")
        for one in found:
            file = self._open(one)
            for channel, text in file.qos.items():
                self.qos.setdefault(file.channels[channel][0], text)
            file.qos.clear()  # every file of a long bag says the same
        files = self._all
        self.metadata: dict[str, dict[str, str]] = {}
        kinds: dict[str, tuple[dict[str, None], dict[str, None]]] = {}  # types and encodings in their order
        for file in files:
            self.metadata.update(file.metadata)
            for topic, msgtype, encoding in file.channels.values():
                types, encodings = kinds.setdefault(topic, ({}, {}))
                types[msgtype], encodings[encoding] = None, None
        self.topics = {topic: ", ".join(types) for topic, (types, _) in kinds.items()}
        self.encodings = {topic: ", ".join(encodings) for topic, (_, encodings) in kinds.items()}
        if sum(file.kept for file in files) > MAX_KEPT:
            raise InputError(f"{self.path}: declares more topics and metadata than a bag needs")
        self.message_count = sum(file.count for file in files)
        self.counts: dict[str, int | None] = dict.fromkeys(self.topics, 0)
        self.chunks: Counter[str] = Counter()
        for file in files:
            self.chunks.update(file.chunks)
            for channel, (topic, _, _) in file.channels.items():
                before = self.counts[topic]
                if file.counts is None or before is None:
                    self.counts[topic] = None
                else:
                    self.counts[topic] = before + file.counts.get(channel, 0)
        filled = [file for file in files if file.count]
        self.start_ns = min((file.start for file in filled), default=None)
        self.end_ns = max((file.end for file in filled), default=None)
        self.damage = "; ".join(f"{file.path.name}: {file.damage}" for file in files if file.damage)

    def _open(self, found: Found) -> _BagFile | ForeignFile:
        """Take in what a file says before its messages are read."""
        if found.kind == MCAP:
            file = _BagFile(found)
            self._files.append(file)
            return file
        from .foreign import Ros1File, SqliteFile  # what they are read by is loaded only where it is needed

        foreign = SqliteFile(found) if found.kind == SQLITE else Ros1File(found)
        self._foreign.append(foreign)
        return foreign

    @property
    def _all(self) -> Sequence[_BagFile | ForeignFile]:
        return [*self._files, *self._foreign]

    @property
    def paths(self) -> list[Path]:
        """The bag's files."""
        return [file.path for file in self._all]

    @property
    def complete(self) -> bool:
        """Whether every file has its end."""
        return not self.damage

    def definition(self, msgtype: str) -> str | None:
        """The definition of a message type that the bag carries, as ``ros2msg`` has it; None if it carries none."""
        for file in self._all:
            if (text := file.definition(msgtype)) is not None:
                return text
        return None

    def has_stamp(self, topic: str) -> bool:
        """Whether the messages of a topic begin with a stamp, as far as the bag says."""
        return begins_with_stamp(self.topics[topic], self.definition(self.topics[topic]))

    def rare(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Log time and content of the messages of a topic of few, in the order of the files.

        Where a file's index says which chunks have some, no other is read: of a long bag only these.

        Parameters
        ----------
        topic : str

        Raises
        ------
        InputError
            As ``messages`` does.
        """
        yield from self._rare(topic, None)

    def _rare(self, topic: str, most_spans: int | None) -> Iterator[tuple[int, bytes]]:
        for foreign in self._foreign:
            yield from ((time, data) for _, time, data in foreign.messages({topic}, True))
        for file in self._files:
            routes = file.routes({topic}, {topic: 0})
            places = file.places([c for c, (name, *_) in file.channels.items() if name == topic])
            for offset, length in places[:most_spans]:
                with reading(file.path):
                    data, rows = file.read(offset, length, routes)
                    columns = zip(*(rows[k].tolist() for k in (2, 4, 5)), strict=True)
                    some = [(time, data[start : start + size]) for time, start, size in columns]
                yield from some
            if places and most_spans is not None:
                return

    def first(self, topic: str, most: int) -> list[tuple[int, bytes]]:
        """Log time and content of a topic's first messages, as far as a few chunks have them; no more is read.

        Parameters
        ----------
        topic : str
        most : int

        Raises
        ------
        InputError
            As ``messages`` does.
        """
        return list(islice(self._rare(topic, _FIRST_SPANS), most))

    def messages(self, topics: Iterable[str] | None = None, *, in_file_order: bool = False) -> Iterator[Message]:
        """All messages, in order of log time; of equal times, in the order of the files.

        Parameters
        ----------
        topics : iterable of str, optional
            Only these topics; default all.
        in_file_order : bool
            As they were written instead, whatever their times: a clock that is set back puts the two at odds.

        Yields
        ------
        topic, msgtype : str
        log_time_ns, publish_time_ns : int
        data : bytes
            The serialised message (CDR).

        Raises
        ------
        InputError
            If a wanted topic is not CDR, or the file turns out to be damaged.
        """
        for block in self.blocks(topics, in_file_order=in_file_order, least=1):
            kinds = [(topic, self.topics[topic]) for topic in block.topics]
            data = block.data
            columns = (block.topic, block.log_time, block.publish_time, block.start, block.start + block.size)
            for topic, log_time, publish_time, start, end in zip(*(c.tolist() for c in columns), strict=True):
                yield *kinds[topic], log_time, publish_time, data[start:end]

    def blocks(
        self, topics: Iterable[str] | None = None, *, in_file_order: bool = False, least: int = 16384
    ) -> Iterator[Block]:
        """The same messages in the same order, many at a time.

        Parameters
        ----------
        topics, in_file_order
            As for ``messages``.
        least : int
            A block ends when it has so many messages, or some 4 MiB.

        Yields
        ------
        Block
            Never empty.

        Raises
        ------
        InputError
            As ``messages`` does, after all that stands before the damage.
        """
        blocks = self._blocks(topics, in_file_order, least)
        if self.clock is None:
            yield from blocks
        else:
            yield from on_clock(blocks, map(self.has_stamp, self.topics), self.clock)

    def _blocks(self, topics: Iterable[str] | None, in_file_order: bool, least: int) -> Iterator[Block]:
        wanted = None if topics is None else frozenset(topics)
        numbers = {topic: number for number, topic in enumerate(self.topics)}
        if self._foreign:
            yield from self._foreign_blocks(wanted, numbers, in_file_order, least)
            return
        routes = [file.routes(wanted, numbers) for file in self._files]
        spans = np.concatenate([np.array(file.spans, np.uint64).reshape(-1, 3) for file in self._files])
        owner = np.repeat(np.arange(len(self._files)), [len(file.spans) // 3 for file in self._files])
        pending = _Pending(tuple(self.topics))
        for place in range(len(spans)) if in_file_order else np.argsort(spans[:, 0]):
            start, offset, length = (int(number) for number in spans[place])
            file = self._files[owner[place]]
            pending.release(None if in_file_order else start)  # what is still to come begins at start or later
            if pending.ready >= least or pending.full:
                yield from pending.take()
            try:
                with reading(file.path):
                    data, rows = file.read(offset, length, routes[owner[place]])
                    pending.add(data, rows, int(place))
                    if not in_file_order:
                        pending.sort(start)
            except InputError as error:
                yield from pending.take()
                raise InputError(f"{error}; tire-dynamics recover keeps what is whole") from None
        pending.release(None)
        yield from pending.take()

    def _foreign_blocks(
        self, wanted: Collection[str] | None, numbers: Mapping[str, int], in_file_order: bool, least: int
    ) -> Iterator[Block]:
        files = [file.messages(wanted, in_file_order) for file in self._foreign]
        rows = chain(*files) if in_file_order else heapq.merge(*files, key=lambda row: row[1])
        some: list[tuple[str, int, bytes]] = []
        size = 0
        try:
            for row in rows:
                some.append(row)
                size += len(row[2])
                if len(some) >= least or size > _BLOCK:
                    yield _block(some, self.topics, numbers)
                    some, size = [], 0
        except InputError:
            if some:
                yield _block(some, self.topics, numbers)
            raise
        if some:
            yield _block(some, self.topics, numbers)


def _block(rows: Sequence[tuple[str, int, bytes]], topics: Iterable[str], numbers: Mapping[str, int]) -> Block:
    names, times, data = zip(*rows, strict=True)
    size = np.fromiter(map(len, data), np.int64, len(data))
    log_time = np.array(times, np.int64)
    topic = np.array([numbers[name] for name in names], np.int64)
    return Block(tuple(topics), topic, log_time, log_time.copy(), b"".join(data), np.cumsum(size) - size, size)


class _Pending:
    """Messages that have been read: those of the next block, and those held back until their turn is known."""

    def __init__(self, topics: tuple[str, ...]) -> None:
        self._topics = topics
        self._done: list[_Rows] = []
        self._held: _Rows = np.empty((6, 0), np.int64)
        self._data: list[bytes] = []
        self._length = 0  # of the data
        self._limit = _BLOCK
        self.ready = 0  # messages of the next block

    @property
    def full(self) -> bool:
        return self._length > self._limit

    def add(self, data: bytes, rows: _Rows, place: int) -> None:
        """Hold the messages of a span."""
        rows[0] = place
        rows[4] += self._length
        overlap = self._held.shape[1] > 0
        if overlap:
            count, size = self._held.shape[1] + rows.shape[1], self._held[5].sum() + rows[5].sum()
            if 200 * count + int(size) > _MAX_PENDING:
                raise DamageError("its messages are too far out of order")
        self._held = np.concatenate([self._held, rows], axis=1) if overlap else rows
        self._data.append(data)
        self._length += len(data)

    def sort(self, start: int) -> None:
        """Sort what is held by log time and place in the bag; none may be from before ``start``."""
        place, _, times, *_ = self._held
        if (times[1:] < times[:-1]).any() or (place[1:] < place[:-1]).any():
            self._held = self._held[:, np.lexsort((place, times))]
        if self._held.shape[1] and int(self._held[2, 0]) < start:
            raise DamageError("a chunk holds messages from before its beginning")

    def release(self, end: int | None) -> None:
        """Add to the next block what is held from before a log time; None: all."""
        count = self._held.shape[1] if end is None else int(np.searchsorted(self._held[2], min(end, _NO_TIME)))
        if count:
            self._done.append(self._held[:, :count])
            self._held = self._held[:, count:]
            self.ready += count

    def take(self) -> Iterator[Block]:
        """The next block, if it has messages; of its data only what is held is kept."""
        data = b"".join(self._data)
        held = self._held.copy()
        if self.ready:
            _, topic, log_time, publish_time, start, size = np.concatenate(self._done, axis=1)
            block = Block(self._topics, topic, log_time, publish_time, data, start, size)
        spans = zip(held[4].tolist(), (held[4] + held[5]).tolist(), strict=True)
        self._data = [b"".join([data[start:end] for start, end in spans])]
        held[4] = np.cumsum(held[5]) - held[5]
        self._held, self._done = held, []
        self._length = len(self._data[0])
        self._limit = _BLOCK + 2 * self._length  # so that what is held for long is not copied all the time
        if self.ready:
            self.ready = 0
            yield block


class _BagFile:
    """What is known of one ``.mcap`` file before its messages are read.

    It comes from the summary at the file's end if there is a whole one, and else from a walk over the file.
    The file is opened anew for each span, so that a bag of many files does not need many handles.
    """

    damage: str

    def __init__(self, found: Found) -> None:
        self.path, self._place = found.path, found.place
        self._clear()
        with reading(self.path), open(self._place, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            try:
                self._read_summary(file, size)
            except (*DAMAGE, OSError):  # OSError: an offset beyond any file
                self._clear()
                self._walk(file, size)
        if found.damage:
            self.damage = f"{found.damage}; {self.damage}".removesuffix("; ")

    def _clear(self) -> None:
        self.channels: dict[int, tuple[str, str, str]] = {}  # id to topic, message type, encoding
        self.metadata: dict[str, dict[str, str]] = {}
        self.count, self.start, self.end = 0, _NO_TIME, 0
        self.damage = ""
        self.counts: dict[int, int] | None = {}  # messages by channel, None if they are not known
        self.qos: dict[int, str] = {}  # by channel, if there is room
        self._room = _MAX_QOS
        self.chunks: Counter[str] = Counter()  # by compression
        self.kept: int = 0  # bytes, about, of names, types and metadata
        self._schemas = {0: ""}
        self._others: set[int] = set()  # schemas whose text is not that of their type
        self._definitions: dict[str, bytes] = {}  # by type, those in ros2msg
        self._seen: dict[tuple[int, bytes], int] = {}  # schemas and channels: opcode and id to hash of the record
        # Log time of the first message, offset and length of each span, in the order of the file; plain
        # numbers, because an hour of driving has tens of thousands of spans.
        self.spans = array("Q")

    def definition(self, msgtype: str) -> str | None:
        """The definition of a type, if the file carries it."""
        text = self._definitions.get(msgtype)
        return None if text is None else text.decode("utf-8", "replace")

    def routes(self, wanted: Collection[str] | None, numbers: Mapping[str, int]) -> NDArray[np.int64]:
        """The number of the topic by channel; the last is for all channels beyond."""
        routes = np.full(max(self.channels, default=-1) + 2, _UNDECLARED)
        for channel, (topic, _, encoding) in self.channels.items():
            routes[channel] = numbers[topic] if wanted is None or topic in wanted else _UNWANTED
            if routes[channel] != _UNWANTED and encoding != "cdr":
                raise InputError(f"{self.path}: {topic} is encoded as {encoding!r}; only cdr is read")
        return routes

    def read(self, offset: int, length: int, routes: NDArray[np.int64]) -> tuple[bytes, _Rows]:
        """The messages of one span."""
        with open(self._place, "rb") as file:
            file.seek(offset)
            data = exactly(file, length)
        in_chunk = data[:1] == _CHUNK_OPCODE
        if in_chunk:
            data = chunk_records(memoryview(data)[RECORD.size :])
        found: list[_Rows] = [np.empty((6, 0), np.int64)]
        for messages, _ in message_records(data, in_chunk):
            heads = heads_at(data, messages)
            topics = routes[np.minimum(heads["channel"].astype(np.int64), len(routes) - 1)]
            if (topics == _UNDECLARED).any():
                raise DamageError(f"channel {heads['channel'][topics == _UNDECLARED][0]} is not declared")
            take = topics != _UNWANTED
            heads = heads[take]
            rows = np.empty((6, len(heads)), np.int64)
            rows[1], rows[2], rows[3] = topics[take], heads["log_time"], heads["publish_time"]
            rows[4], rows[5] = messages[take] + HEAD.itemsize, heads["length"] - np.uint64(MESSAGE.size)
            if (rows[2:4] < 0).any():
                raise DamageError("a message is from after the year 2262")
            found.append(rows)
        return _unpacked(data, np.concatenate(found, axis=1))

    def _add_record(self, opcode: int, content: bytes) -> None:
        """Take in a record that describes messages, wherever it stands."""
        if opcode == Opcode.SCHEMA or opcode == Opcode.CHANNEL:
            key, value = (opcode, content[:2]), hash(content)
            if self._seen.get(key) == value:
                return  # said again, as recorders may in every chunk
            self._seen[key] = value
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(content)
            name = self._schemas.setdefault(schema.id, schema.name)
            if name != schema.name:
                raise DamageError(f"schema {schema.id} is declared twice, as {name[:100]} and {schema.name[:100]}")
            self._keep(len(name))
            if schema.encoding == "ros2msg" and has_other_fields(name, schema.data.decode("utf-8", "replace")):
                self._others.add(schema.id)
            if schema.encoding == "ros2msg" and name not in self._definitions:
                self._keep(len(schema.data))
                self._definitions[name] = schema.data
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(content)
            if channel.schema_id not in self._schemas:
                raise DamageError(f"{channel.topic[:100]} has no schema")
            odd = channel.message_encoding == "cdr" and channel.schema_id in self._others
            new = channel.topic, self._schemas[channel.schema_id], OTHER_FIELDS if odd else channel.message_encoding
            old = self.channels.setdefault(channel.id, new)
            if old != new:
                raise DamageError(f"channel {channel.id} is declared twice, as {old[0][:100]} and {new[0][:100]}")
            qos = channel.metadata.get("offered_qos_profiles", "")
            if channel.id not in self.qos and self._room >= len(qos):
                self._room -= len(qos)
                self.qos[channel.id] = qos
            self._keep(len(new[0]) + len(new[2]))
        elif opcode == Opcode.METADATA:
            self._keep(len(content))
            metadata = Metadata.read(content)
            self.metadata[metadata.name] = metadata.metadata

    def _keep(self, length: int) -> None:
        if self.kept + length + 100 > MAX_KEPT:
            raise DamageError("it declares more topics and metadata than a bag needs")
        self.kept += length + 100

    def _read_summary(self, file: BinaryIO, size: int) -> None:
        """Take everything from the summary; ``DAMAGE`` if it is not there or not whole."""
        statistics = None
        metadata_indexes = []
        for opcode, content in _summary(file, size):
            if opcode == Opcode.CHUNK_INDEX:
                start, _, offset, chunk_length, _ = _CHUNK_INDEX.unpack_from(content)
                if offset + chunk_length > size:
                    raise DamageError("a chunk beyond the end")
                self.spans.extend((start, offset, chunk_length))
                self.chunks[_compression(content)] += 1
            elif opcode == Opcode.STATISTICS:
                statistics = Statistics.read(content)
            elif opcode == Opcode.METADATA_INDEX:
                metadata_indexes.append(MetadataIndex.read(content))
            else:
                self._add_record(opcode, content)
        if statistics is None or statistics.chunk_count != len(self.spans) // 3:
            raise DamageError("no index of the chunks")
        places = np.array(self.spans, np.uint64).reshape(-1, 3)[:, 1:]
        offsets, lengths = places[np.argsort(places[:, 0])].T
        if (offsets[:-1] + lengths[:-1] > offsets[1:]).any():
            raise DamageError("a chunk within another")
        if statistics.message_count and not statistics.chunk_count:
            raise DamageError("messages outside chunks have no index")
        if statistics.channel_count != len(self.channels):
            raise DamageError("no channels")
        for index in metadata_indexes:
            file.seek(index.offset)
            opcode, length = RECORD.unpack(exactly(file, RECORD.size))
            self._add_record(opcode, exactly(file, length, MAX_RECORD))
        self.count = statistics.message_count
        counts = statistics.channel_message_counts
        self.counts = counts if sum(counts.values()) == self.count else None
        self.start, self.end = statistics.message_start_time, statistics.message_end_time

    def _walk(self, file: BinaryIO, size: int) -> None:
        """Go through the file from its beginning to the end of its data, or to the first damage."""
        position = after = len(MAGIC)
        file.seek(position)
        run: list[int] = []  # span of messages outside chunks
        try:
            while True:
                position = after
                opcode, length = RECORD.unpack(exactly(file, RECORD.size))
                after = position + RECORD.size + length
                if opcode == Opcode.CHUNK or opcode == Opcode.DATA_END or (run and run[2] > RUN):
                    self.spans.extend(run)
                    run = []
                if opcode == Opcode.DATA_END:
                    return
                if after > size:
                    raise DamageError("it ends in the middle of a record")
                if opcode == Opcode.CHUNK:
                    start = self._walk_chunk(memoryview(exactly(file, length)))
                    self.spans.extend((start, position, after - position))
                elif opcode == Opcode.MESSAGE:
                    log_time = self._see_message(exactly(file, min(length, MESSAGE.size)))
                    run = run or [log_time, position, 0]
                    run = [min(run[0], log_time), run[1], after - run[1]]
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
                    self._add_record(opcode, exactly(file, length, MAX_RECORD))
                file.seek(after)
        except DAMAGE as error:
            self.spans.extend(run)
            self.damage = f"{one_line(error)} (at byte {position} of {size})"

    def _walk_chunk(self, content: memoryview) -> int:
        """Take in a chunk's channels and count its messages; the log time of the first."""
        data = chunk_records(content)
        first, count, end = _NO_TIME, 0, self.end
        found: Counter[int] = Counter()
        for messages, others in message_records(data, True):
            for opcode, position, after in others:
                self._add_record(opcode, data[position:after])
            heads = heads_at(data, messages)
            numbers, counts = np.unique(heads["channel"], return_counts=True)
            for channel, number in zip(numbers.tolist(), counts.tolist(), strict=True):
                if channel not in self.channels:
                    raise DamageError(f"channel {channel} is not declared")
                found[channel] += number
            if len(heads):
                first, end = min(first, int(heads["log_time"].min())), max(end, int(heads["log_time"].max()))
                count += len(heads)
        self.count += count
        self._count(found)
        self.chunks[_compression_of_chunk(content)] += 1
        self.start, self.end = min(self.start, first), end
        return first

    def _count(self, found: Mapping[int, int]) -> None:
        if self.counts is not None:
            for channel, number in found.items():
                self.counts[channel] = self.counts.get(channel, 0) + number

    def places(self, channels: Collection[int]) -> list[tuple[int, int]]:
        """Offset and length of the spans in which messages of these channels may be."""
        everywhere = [(self.spans[k + 1], self.spans[k + 2]) for k in range(0, len(self.spans), 3)]
        if not channels or not self.count:
            return []
        try:
            found = []
            with open(self._place, "rb") as file:
                for opcode, content in _summary(file, os.fstat(file.fileno()).st_size):
                    if opcode == Opcode.CHUNK_INDEX:
                        _, _, offset, length, size = _CHUNK_INDEX.unpack_from(content)
                        index = np.frombuffer(content[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size], _INDEX_PLACE)
                        if not size:  # not known
                            return everywhere
                        if np.isin(index["channel"], list(channels)).any():
                            found.append((offset, length))
        except (*DAMAGE, OSError):
            return everywhere
        return found if len(set(found)) == len(found) and set(found) <= set(everywhere) else everywhere

    def _see_message(self, head: bytes) -> int:
        channel, _, log_time, _ = MESSAGE.unpack(head)
        if channel not in self.channels:
            raise DamageError(f"channel {channel} is not declared")
        self.count += 1
        self._count({channel: 1})
        self.start, self.end = min(self.start, log_time), max(self.end, log_time)
        return int(log_time)


def _unpacked(data: bytes, rows: _Rows) -> tuple[bytes, _Rows]:
    """The same with messages decompressed that rosbag2 has compressed one by one."""
    first = np.frombuffer(data, np.uint8)[np.minimum(rows[4], len(data) - 1)] if rows.size else np.empty(0, np.uint8)
    packed = np.flatnonzero((first == ZSTD_MAGIC[0]) & (rows[5] > len(ZSTD_MAGIC)))
    parts, length = [data], len(data)
    for place in packed.tolist():
        start, size = int(rows[4, place]), int(rows[5, place])
        if data.startswith(ZSTD_MAGIC, start):
            parts.append(unpacked_message(data[start : start + size]))
            rows[4, place], rows[5, place] = length, len(parts[-1])
            length += len(parts[-1])
            if length - len(data) > _MAX_UNPACKED:
                raise DamageError(f"a chunk's messages claim more than {_MAX_UNPACKED} bytes")
    return b"".join(parts) if len(parts) > 1 else data, rows


def _summary(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """Opcode and content of the summary's records; ``DAMAGE`` if it is not there or not whole."""
    file.seek(max(size - _FOOTER_LENGTH, 0))
    footer = file.read()
    opcode, _, position, _, crc = _FOOTER.unpack_from(footer)
    if opcode != Opcode.FOOTER or footer[_FOOTER.size :] != MAGIC or not position:
        raise DamageError("no summary")
    actual_crc = 0
    file.seek(position)
    while position < size - _FOOTER_LENGTH:
        head = exactly(file, RECORD.size)
        opcode, length = RECORD.unpack(head)
        content = exactly(file, length, MAX_RECORD)
        actual_crc = zlib.crc32(content, zlib.crc32(head, actual_crc))
        position += RECORD.size + length
        yield opcode, content
    if crc and zlib.crc32(footer[: _FOOTER.size - 4], actual_crc) != crc:
        raise DamageError("the summary does not match its checksum")


def _compression(index: bytes) -> str:
    """How the chunk of a chunk index is compressed."""
    position = _CHUNK_INDEX.size + _CHUNK_INDEX.unpack_from(index)[4] + 8
    length = int.from_bytes(index[position : position + 4], "little")
    return index[position + 4 : position + 4 + min(length, _MAX_NAME)].decode()


def _compression_of_chunk(content: memoryview) -> str:
    length = min(CHUNK.unpack_from(content)[4], _MAX_NAME)
    return bytes(content[CHUNK.size : CHUNK.size + length]).decode()
