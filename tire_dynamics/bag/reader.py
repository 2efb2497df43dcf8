"""Reads rosbag2 bags, and single ``.mcap`` files.

The reader takes record layouts from the mcap library, but walks the file itself: bags come from strangers and
from nodes that were killed, so every length is checked before it is believed, a file without its end is read
as far as it goes, and memory holds a chunk or a few, whatever the length of the bag.

A span is a piece of a file that holds whole records: a chunk, or a run of messages outside chunks.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from array import array
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import repeat
from pathlib import Path, PurePath
from typing import Any, BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import yaml
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from ..files.errors import InputError, missing
from .chunks import HEAD, heads_at

__all__ = ["BagReader", "Block", "Message", "yaml_texts"]

_NO_TIME = 2**63 - 1  # of a file without messages
_MAX_CHUNK = 32 * 2**20  # bytes, uncompressed; recorders write some 1 MiB, and of one message what it takes
_MAX_CHUNK_RECORDS = 500_000
_LARGE_CHUNK, _MAX_RATIO = 16 * 2**20, 1000  # no recording of more than so many bytes is compressed so well
_MAX_PENDING = 32 * 2**20  # bytes held back because chunks overlap in time
_MAX_RECORD = 16 * 2**20  # bytes of a schema, channel, statistics or metadata record
_MAX_KEPT = 64 * 2**20  # bytes of names, types and metadata records of a bag
_MAX_METADATA_YAML = 2 * 2**20  # bytes; 300 topics take a tenth
_MAX_DEPTH = 30  # of metadata.yaml; rosbag2's is 6
_CONVERT = "rosbags-convert --src IN --dst OUT --dst-storage mcap makes a bag that is read"  # it comes with rosbags
_LONGEST_MAGIC = 16  # bytes, of the files that are told apart
_MAX_NAME = 20  # bytes of a compression's name
_MAX_QOS = 8 * 2**20  # characters of the texts about QoS in a file; what is beyond is not needed to read it
_RUN = 2**16  # bytes of messages outside chunks that are read together
_BLOCK = 4 * 2**20  # bytes of a block, beside what is held back
_STEP = 2**16  # records that are looked at together

_CHUNK_OPCODE = bytes([Opcode.CHUNK])
_RECORD = struct.Struct("<BQ")  # opcode, length of the content
_LENGTH = struct.Struct("<Q")
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK = struct.Struct("<QQQII")  # start, end, uncompressed size, CRC, length of the compression's name
_CHUNK_INDEX = struct.Struct("<QQQQI")  # start, end, offset, length, bytes of the message indexes' places
_INDEX_PLACE = np.dtype([("channel", "<u2"), ("offset", "<u8")])
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, summary start, summary offset start, CRC
_FOOTER_LENGTH = _FOOTER.size + len(MCAP0_MAGIC)

Message = tuple[str, str, int, int, bytes]
"""Topic, message type, log time and publish time [ns], serialised message."""

_Rows = NDArray[np.int64]  # (6, N), messages: place in the bag, topic, log time, publish time, start and size of data
_UNDECLARED, _UNWANTED = -2, -1  # instead of a topic


class Block(NamedTuple):
    """A stretch of a bag as columns; message ``i`` is ``data[start[i] : start[i] + size[i]]``.

    Attributes
    ----------
    topics : tuple of str
    topic : (N,) ndarray of int
        Index into ``topics``.
    log_time, publish_time : (N,) ndarray of int
        ns since the epoch.
    data : bytes
        The serialised messages (CDR), among other bytes.
    start, size : (N,) ndarray of int
    """

    topics: tuple[str, ...]
    topic: NDArray[np.int64]
    log_time: NDArray[np.int64]
    publish_time: NDArray[np.int64]
    data: bytes
    start: NDArray[np.int64]
    size: NDArray[np.int64]


class _DamageError(ValueError):
    """What is wrong with the bytes of a bag."""


# What the libraries raise on bytes that are not what they are said to be.
_DAMAGE = (
    ValueError,  # _DamageError and UnicodeDecodeError among them
    struct.error,
    McapError,
    MemoryError,
    OverflowError,
)


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except _DAMAGE as error:
        raise InputError(f"{path}: damaged: {_one_line(error)}") from None


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


class BagReader:
    """Reads a bag: a rosbag2 folder or a single ``.mcap`` file.

    Parameters
    ----------
    path : path
        The folder or the file.

    Attributes
    ----------
    topics : dict of str to str
        Topic to message type.
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

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._files: list[_BagFile] = []
        self.qos: dict[str, str] = {}
        for name in _files_of(self.path):
            self._files.append(file := _BagFile(name))
            for channel, text in file.qos.items():
                self.qos.setdefault(file.channels[channel][0], text)
            file.qos.clear()  # every file of a long bag says the same
        self.topics: dict[str, str] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        for file in self._files:
            self.metadata.update(file.metadata)
            for topic, msgtype, _ in file.channels.values():
                known = self.topics.setdefault(topic, msgtype)
                if msgtype != known:
                    raise InputError(f"{file.path}: {topic} has two types, {known} and {msgtype}")
        if sum(file.kept for file in self._files) > _MAX_KEPT:
            raise InputError(f"{self.path}: declares more topics and metadata than a bag needs")
        self.message_count = sum(file.count for file in self._files)
        self.counts: dict[str, int | None] = dict.fromkeys(self.topics, 0)
        self.chunks: Counter[str] = Counter()
        for file in self._files:
            self.chunks.update(file.chunks)
            for channel, (topic, _, _) in file.channels.items():
                before = self.counts[topic]
                if file.counts is None or before is None:
                    self.counts[topic] = None
                else:
                    self.counts[topic] = before + file.counts.get(channel, 0)
        filled = [file for file in self._files if file.count]
        self.start_ns = min((file.start for file in filled), default=None)
        self.end_ns = max((file.end for file in filled), default=None)
        self.damage = "; ".join(f"{file.path.name}: {file.damage}" for file in self._files if file.damage)

    @property
    def paths(self) -> list[Path]:
        """The bag's files."""
        return [file.path for file in self._files]

    @property
    def complete(self) -> bool:
        """Whether every file has its end."""
        return not self.damage

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
        for file in self._files:
            routes = file.routes({topic}, {topic: 0})
            for offset, length in file.places([c for c, (name, *_) in file.channels.items() if name == topic]):
                with _reading(file.path):
                    data, rows = file.read(offset, length, routes)
                    columns = zip(*(rows[k].tolist() for k in (2, 4, 5)), strict=True)
                    some = [(time, data[start : start + size]) for time, start, size in columns]
                yield from some

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
        wanted = None if topics is None else frozenset(topics)
        numbers = {topic: number for number, topic in enumerate(self.topics)}
        routes = [file.routes(wanted, numbers) for file in self._files]
        spans = np.concatenate([np.array(file.spans, np.uint64).reshape(-1, 3) for file in self._files])
        owner = np.repeat(np.arange(len(self._files)), [len(file.spans) // 3 for file in self._files])
        stretch = _Stretch(tuple(self.topics))
        for place in range(len(spans)) if in_file_order else np.argsort(spans[:, 0]):
            start, offset, length = (int(number) for number in spans[place])
            file = self._files[owner[place]]
            stretch.release(None if in_file_order else start)  # what is still to come begins at start or later
            if stretch.ready >= least or stretch.full:
                yield from stretch.take()
            try:
                with _reading(file.path):
                    data, rows = file.read(offset, length, routes[owner[place]])
                    stretch.add(data, rows, int(place))
                    if not in_file_order:
                        stretch.sort(start)
            except InputError as error:
                yield from stretch.take()
                raise InputError(f"{error}; tire-dynamics recover keeps what is whole") from None
        stretch.release(None)
        yield from stretch.take()


class _Stretch:
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
                raise _DamageError("its messages are too far out of order")
        self._held = np.concatenate([self._held, rows], axis=1) if overlap else rows
        self._data.append(data)
        self._length += len(data)

    def sort(self, start: int) -> None:
        """Sort what is held by log time and place in the bag; none may be from before ``start``."""
        place, _, times, *_ = self._held
        if (times[1:] < times[:-1]).any() or (place[1:] < place[:-1]).any():
            self._held = self._held[:, np.lexsort((place, times))]
        if self._held.shape[1] and int(self._held[2, 0]) < start:
            raise _DamageError("a chunk holds messages from before its beginning")

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


def _other_kind(begin: bytes) -> str:
    """What else a file may be, and how a bag is made of it."""
    if begin.startswith(b"SQLite format 3"):
        return f" but SQLite's; where IN is its folder, {_CONVERT}"
    if begin.startswith(b"#ROSBAG"):
        return f" but ROS 1's; {_CONVERT}"
    return "; a rosbag2 folder or a .mcap file is wanted"


def _files_of(path: Path) -> list[Path]:
    """The bag's ``.mcap`` files, in order."""
    if not path.exists():
        raise missing(path)
    if not path.is_dir():
        return [path]
    metadata = path / "metadata.yaml"
    if not metadata.is_file():
        raise InputError(
            f"{path}: has no metadata.yaml; of a recording that was cut off, name the .mcap file, or make it whole "
            "with tire-dynamics recover"
        )
    try:
        if metadata.stat().st_size > _MAX_METADATA_YAML:
            raise InputError(f"{metadata}: too large to be the description of a bag")
        information = yaml_texts(metadata.read_bytes())["rosbag2_bagfile_information"]
        storage = information["storage_identifier"]
        compression = information.get("compression_mode") or "none"
        names = information["relative_file_paths"]
        if not isinstance(names, list) or not all(isinstance(text, str) for text in (storage, compression, *names)):
            raise ValueError
    except OSError as error:
        raise InputError(f"{metadata}: cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError, RecursionError):
        raise InputError(f"{metadata}: is not the description of a bag") from None
    if storage != "mcap":
        raise InputError(f"{path}: its storage is {storage!r}; only mcap is read; {_CONVERT}")
    if compression.lower() not in ("none", "null", "~"):
        raise InputError(f"{path}: its compression_mode is {compression!r}; only chunk compression is read; {_CONVERT}")
    for name in names:
        if PurePath(name).name != name:
            raise InputError(f"{metadata}: {name!r} is not a file of this folder")
        if not (path / name).exists():
            raise InputError(
                f"{path / name}: does not exist, though metadata.yaml lists it; tire-dynamics recover makes a bag of "
                "the files that do"
            )
    if not names or len(set(names)) < len(names):
        raise InputError(f"{metadata}: lists {'a file twice' if names else 'no file'}")
    return [path / name for name in names]


def yaml_texts(text: bytes) -> Any:
    """YAML with every plain value a text: no tag means anything, no key is merged, no number is made.

    An alias stands for the same object, so that its size is that of the file; to print it may take forever.
    """
    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    depth = 0
    for event in yaml.parse(text, Loader=loader):  # first: nesting too deep ends a process in libyaml's composer
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _MAX_DEPTH:
            raise ValueError("nested too deep")
    return yaml.load(text, Loader=loader)


class _BagFile:
    """What is known of one ``.mcap`` file before its messages are read.

    It comes from the summary at the file's end if there is a whole one, and else from a walk over the file.
    The file is opened anew for each span, so that a bag of many files does not need many handles.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._clear()
        if not path.is_file():
            raise InputError(f"{path}: is not a file")
        with _reading(path), open(path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            if size == 0:
                raise InputError(f"{path}: is empty; its recorder wrote nothing")
            begin = file.read(_LONGEST_MAGIC)
            if not begin.startswith(MCAP0_MAGIC):
                raise InputError(f"{path}: is not an MCAP file{_other_kind(begin)}")
            try:
                self._read_summary(file, size)
            except (*_DAMAGE, OSError):  # OSError: an offset beyond any file
                self._clear()
                self._walk(file, size)

    def _clear(self) -> None:
        self.channels: dict[int, tuple[str, str, str]] = {}  # id to topic, message type, encoding
        self.metadata: dict[str, dict[str, str]] = {}
        self.count, self.start, self.end = 0, _NO_TIME, 0
        self.damage = ""
        self.counts: dict[int, int] | None = {}  # messages by channel, None if they are not told
        self.qos: dict[int, str] = {}  # by channel, if there is room
        self._room = _MAX_QOS
        self.chunks: Counter[str] = Counter()  # by compression
        self.kept = 0  # bytes, about, of names, types and metadata
        self._schemas = {0: ""}
        self._seen: dict[tuple[int, bytes], int] = {}  # schemas and channels: opcode and id to hash of the record
        # Log time of the first message, offset and length of each span, in the order of the file; plain
        # numbers, because an hour of driving has tens of thousands of spans.
        self.spans = array("Q")

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
        with open(self.path, "rb") as file:
            file.seek(offset)
            data = _exactly(file, length)
        in_chunk = data[:1] == _CHUNK_OPCODE
        if in_chunk:
            data = _chunk_records(memoryview(data)[_RECORD.size :])
        found: list[_Rows] = [np.empty((6, 0), np.int64)]
        for messages, _ in _records(data, in_chunk):
            heads = heads_at(data, messages)
            topics = routes[np.minimum(heads["channel"].astype(np.int64), len(routes) - 1)]
            if (topics == _UNDECLARED).any():
                raise _DamageError(f"channel {heads['channel'][topics == _UNDECLARED][0]} is not declared")
            take = topics != _UNWANTED
            heads = heads[take]
            rows = np.empty((6, len(heads)), np.int64)
            rows[1], rows[2], rows[3] = topics[take], heads["log_time"], heads["publish_time"]
            rows[4], rows[5] = messages[take] + HEAD.itemsize, heads["length"] - np.uint64(_MESSAGE.size)
            if (rows[2:4] < 0).any():
                raise _DamageError("a message is from after the year 2262")
            found.append(rows)
        return data, np.concatenate(found, axis=1)

    def _add_record(self, opcode: int, content: bytes) -> None:
        """Take in a record that describes messages, wherever it stands."""
        stream = ReadDataStream(io.BytesIO(content))
        if opcode == Opcode.SCHEMA or opcode == Opcode.CHANNEL:
            key, value = (opcode, content[:2]), hash(content)
            if self._seen.get(key) == value:
                return  # said again, as recorders may in every chunk
            self._seen[key] = value
        if opcode == Opcode.SCHEMA:
            schema = records.Schema.read(stream)
            name = self._schemas.setdefault(schema.id, schema.name)
            if name != schema.name:
                raise _DamageError(f"schema {schema.id} is declared twice, as {name[:100]} and {schema.name[:100]}")
            self._keep(len(name))
        elif opcode == Opcode.CHANNEL:
            channel = records.Channel.read(stream)
            if channel.schema_id not in self._schemas:
                raise _DamageError(f"{channel.topic[:100]} has no schema")
            new = channel.topic, self._schemas[channel.schema_id], channel.message_encoding
            old = self.channels.setdefault(channel.id, new)
            if old != new:
                raise _DamageError(f"channel {channel.id} is declared twice, as {old[0][:100]} and {new[0][:100]}")
            qos = channel.metadata.get("offered_qos_profiles", "")
            if channel.id not in self.qos and self._room >= len(qos):
                self._room -= len(qos)
                self.qos[channel.id] = qos
            self._keep(len(new[0]) + len(new[2]))
        elif opcode == Opcode.METADATA:
            self._keep(len(content))
            metadata = records.Metadata.read(stream)
            self.metadata[metadata.name] = metadata.metadata

    def _keep(self, length: int) -> None:
        if self.kept + length + 100 > _MAX_KEPT:
            raise _DamageError("it declares more topics and metadata than a bag needs")
        self.kept += length + 100

    def _read_summary(self, file: BinaryIO, size: int) -> None:
        """Take everything from the summary; ``_DAMAGE`` if it is not there or not whole."""
        statistics = None
        metadata_indexes = []
        for opcode, content in _summary(file, size):
            if opcode == Opcode.CHUNK_INDEX:
                start, _, offset, chunk_length, _ = _CHUNK_INDEX.unpack_from(content)
                if offset + chunk_length > size:
                    raise _DamageError("a chunk beyond the end")
                self.spans.extend((start, offset, chunk_length))
                self.chunks[_compression(content)] += 1
            elif opcode == Opcode.STATISTICS:
                statistics = records.Statistics.read(ReadDataStream(io.BytesIO(content)))
            elif opcode == Opcode.METADATA_INDEX:
                metadata_indexes.append(records.MetadataIndex.read(ReadDataStream(io.BytesIO(content))))
            else:
                self._add_record(opcode, content)
        if statistics is None or statistics.chunk_count != len(self.spans) // 3:
            raise _DamageError("no index of the chunks")
        places = np.array(self.spans, np.uint64).reshape(-1, 3)[:, 1:]
        offsets, lengths = places[np.argsort(places[:, 0])].T
        if (offsets[:-1] + lengths[:-1] > offsets[1:]).any():
            raise _DamageError("a chunk within another")
        if statistics.message_count and not statistics.chunk_count:
            raise _DamageError("messages outside chunks have no index")
        if statistics.channel_count != len(self.channels):
            raise _DamageError("no channels")
        for index in metadata_indexes:
            file.seek(index.offset)
            opcode, length = _RECORD.unpack(_exactly(file, _RECORD.size))
            self._add_record(opcode, _exactly(file, length, _MAX_RECORD))
        self.count = statistics.message_count
        counts = statistics.channel_message_counts
        self.counts = counts if sum(counts.values()) == self.count else None
        self.start, self.end = statistics.message_start_time, statistics.message_end_time

    def _walk(self, file: BinaryIO, size: int) -> None:
        """Go through the file from its beginning to the end of its data, or to the first damage."""
        position = after = len(MCAP0_MAGIC)
        file.seek(position)
        run: list[int] = []  # span of messages outside chunks
        try:
            while True:
                position = after
                opcode, length = _RECORD.unpack(_exactly(file, _RECORD.size))
                after = position + _RECORD.size + length
                if opcode == Opcode.CHUNK or opcode == Opcode.DATA_END or (run and run[2] > _RUN):
                    self.spans.extend(run)
                    run = []
                if opcode == Opcode.DATA_END:
                    return
                if after > size:
                    raise _DamageError("it ends in the middle of a record")
                if opcode == Opcode.CHUNK:
                    start = self._walk_chunk(memoryview(_exactly(file, length)))
                    self.spans.extend((start, position, after - position))
                elif opcode == Opcode.MESSAGE:
                    log_time = self._see_message(_exactly(file, min(length, _MESSAGE.size)))
                    run = run or [log_time, position, 0]
                    run = [min(run[0], log_time), run[1], after - run[1]]
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
                    self._add_record(opcode, _exactly(file, length, _MAX_RECORD))
                file.seek(after)
        except _DAMAGE as error:
            self.spans.extend(run)
            self.damage = f"{_one_line(error)} (at byte {position} of {size})"

    def _walk_chunk(self, content: memoryview) -> int:
        """Take in a chunk's channels and count its messages; the log time of the first."""
        data = _chunk_records(content)
        first, count, end = _NO_TIME, 0, self.end
        found: Counter[int] = Counter()
        for messages, others in _records(data, True):
            for opcode, position, after in others:
                self._add_record(opcode, data[position:after])
            heads = heads_at(data, messages)
            numbers, counts = np.unique(heads["channel"], return_counts=True)
            for channel, number in zip(numbers.tolist(), counts.tolist(), strict=True):
                if channel not in self.channels:
                    raise _DamageError(f"channel {channel} is not declared")
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
            with open(self.path, "rb") as file:
                for opcode, content in _summary(file, os.fstat(file.fileno()).st_size):
                    if opcode == Opcode.CHUNK_INDEX:
                        _, _, offset, length, size = _CHUNK_INDEX.unpack_from(content)
                        index = np.frombuffer(content[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size], _INDEX_PLACE)
                        if not size:  # not told
                            return everywhere
                        if np.isin(index["channel"], list(channels)).any():
                            found.append((offset, length))
        except (*_DAMAGE, OSError):
            return everywhere
        return found if len(set(found)) == len(found) and set(found) <= set(everywhere) else everywhere

    def _see_message(self, head: bytes) -> int:
        channel, _, log_time, _ = _MESSAGE.unpack(head)
        if channel not in self.channels:
            raise _DamageError(f"channel {channel} is not declared")
        self.count += 1
        self._count({channel: 1})
        self.start, self.end = min(self.start, log_time), max(self.end, log_time)
        return int(log_time)


def _summary(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """Opcode and content of the summary's records; ``_DAMAGE`` if it is not there or not whole."""
    file.seek(max(size - _FOOTER_LENGTH, 0))
    footer = file.read()
    opcode, _, position, _, crc = _FOOTER.unpack_from(footer)
    if opcode != Opcode.FOOTER or footer[_FOOTER.size :] != MCAP0_MAGIC or not position:
        raise _DamageError("no summary")
    actual_crc = 0
    file.seek(position)
    while position < size - _FOOTER_LENGTH:
        head = _exactly(file, _RECORD.size)
        opcode, length = _RECORD.unpack(head)
        content = _exactly(file, length, _MAX_RECORD)
        actual_crc = zlib.crc32(content, zlib.crc32(head, actual_crc))
        position += _RECORD.size + length
        yield opcode, content
    if crc and zlib.crc32(footer[: _FOOTER.size - 4], actual_crc) != crc:
        raise _DamageError("the summary does not match its checksum")


def _compression(index: bytes) -> str:
    """How the chunk of a chunk index is compressed."""
    position = _CHUNK_INDEX.size + _CHUNK_INDEX.unpack_from(index)[4] + 8
    length = int.from_bytes(index[position : position + 4], "little")
    return index[position + 4 : position + 4 + min(length, _MAX_NAME)].decode()


def _compression_of_chunk(content: memoryview) -> str:
    length = min(_CHUNK.unpack_from(content)[4], _MAX_NAME)
    return bytes(content[_CHUNK.size : _CHUNK.size + length]).decode()


def _exactly(file: BinaryIO, length: int, limit: int = _MAX_CHUNK) -> bytes:
    if length > limit:
        raise _DamageError(f"a record claims {length} bytes")
    data = file.read(length)
    if len(data) < length:
        raise _DamageError("it ends in the middle of a record")
    return data


def _records(data: bytes, in_chunk: bool) -> Iterator[tuple[NDArray[np.int64], list[tuple[int, int, int]]]]:
    """Where the message records are, and of every other record opcode, start and end of its content.

    They come in steps, so that a chunk of nothing but tiny records does not fill the memory.
    """
    count = 0
    octets = np.frombuffer(data, np.uint8)
    position, last = 0, len(data) - _RECORD.size
    length_at = _LENGTH.unpack_from
    while position < len(data):
        starts = []
        for _ in repeat(None, _STEP):
            if position > last:
                break
            starts.append(position)
            position += _RECORD.size + length_at(data, position + 1)[0]
        if position > len(data) or not starts:  # only the last record can reach beyond the data
            raise _DamageError("a record does not fit")
        bounds = np.array([*starts, position])
        places = bounds[:-1]
        opcodes = octets[places]
        is_message = opcodes == Opcode.MESSAGE
        if (np.diff(bounds)[is_message] < HEAD.itemsize).any():
            raise _DamageError("a record does not fit")
        if in_chunk and ((opcodes < Opcode.SCHEMA) | (opcodes > Opcode.MESSAGE)).any():
            raise _DamageError("a chunk holds more than messages and what declares them")
        count += len(places)
        if count > _MAX_CHUNK_RECORDS:
            raise _DamageError("a chunk holds too many records")
        others = np.flatnonzero(~is_message).tolist()
        yield places[is_message], [(data[starts[i]], starts[i] + _RECORD.size, int(bounds[i + 1])) for i in others]


def _chunk_records(content: memoryview) -> bytes:
    """The records in a chunk, given the chunk record's content."""
    _, _, size, crc, name_length = _CHUNK.unpack_from(content)
    if size > _MAX_CHUNK:
        raise _DamageError(f"a chunk claims {size} bytes")
    position = _CHUNK.size + name_length
    compression = bytes(content[_CHUNK.size : position])
    stored = content[position + 8 :]  # its length, 8 bytes, is the rest of the record
    if size > max(_LARGE_CHUNK, _MAX_RATIO * len(stored)):
        raise _DamageError(f"a chunk claims {size} bytes in {len(stored)}")
    try:
        if compression == b"":
            data = bytes(stored)
        elif compression == b"zstd":
            # The library would allocate what the frame claims.
            if zstandard.frame_content_size(stored) not in (size, -1):
                raise _DamageError("a chunk has another size than it claims")
            data = zstandard.ZstdDecompressor().decompress(stored, max_output_size=size)
        elif compression == b"lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(stored, max_length=size)
        else:
            raise _DamageError(f"a chunk's compression {compression[:20]!r} is not known")
    except (zstandard.ZstdError, RuntimeError) as error:  # RuntimeError: lz4's
        raise _DamageError(f"a chunk cannot be decompressed: {error}") from None
    if len(data) != size:
        raise _DamageError("a chunk has another size than it claims")
    if crc and zlib.crc32(data) != crc:
        raise _DamageError("a chunk does not match its checksum")
    return data
