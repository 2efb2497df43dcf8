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
from bisect import bisect_left
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import yaml
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from ..errors import InputError

__all__ = ["BagReader", "Message"]

_NO_TIME = 2**63 - 1  # of a file without messages
_MAX_CHUNK = 128 * 2**20  # bytes, uncompressed; recorders write some 1 MiB
_MAX_CHUNK_MESSAGES = 500_000
_MAX_PENDING = 128 * 2**20  # bytes held back because chunks overlap in time
_MAX_RECORD = 16 * 2**20  # bytes of a schema, channel, statistics or metadata record
_MAX_METADATA_YAML = 2 * 2**20  # bytes; 300 topics take a tenth
_RUN = 2**16  # bytes of messages outside chunks that are read together

_CHUNK_OPCODE = bytes([Opcode.CHUNK])
_RECORD = struct.Struct("<BQ")  # opcode, length of the content
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK = struct.Struct("<QQQII")  # start, end, uncompressed size, CRC, length of the compression's name
_CHUNK_INDEX = struct.Struct("<QQQQ")  # start, end, offset, length
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, summary start, summary offset start, CRC
_FOOTER_LENGTH = _FOOTER.size + len(MCAP0_MAGIC)

Message = tuple[str, str, int, int, bytes]
_Pending = tuple[int, int, Message]  # log time, place in the bag, message


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

    Raises
    ------
    InputError
        If it is not a bag, or not one that can be read.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._files = [_BagFile(file) for file in _files_of(self.path)]
        self.topics: dict[str, str] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        for file in self._files:
            self.metadata.update(file.metadata)
            for topic, msgtype, _ in file.channels.values():
                known = self.topics.setdefault(topic, msgtype)
                if msgtype != known:
                    raise InputError(f"{file.path}: {topic} has two types, {known} and {msgtype}")
        self.message_count = sum(file.count for file in self._files)
        filled = [file for file in self._files if file.count]
        self.start_ns = min((file.start for file in filled), default=None)
        self.end_ns = max((file.end for file in filled), default=None)
        self.damage = "; ".join(f"{file.path.name}: {file.damage}" for file in self._files if file.damage)

    @property
    def complete(self) -> bool:
        """Whether every file has its end."""
        return not self.damage

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
        wanted = None if topics is None else frozenset(topics)
        routes = [file.routes(wanted) for file in self._files]
        spans = np.concatenate([np.array(file.spans, np.uint64).reshape(-1, 3) for file in self._files])
        owner = np.repeat(np.arange(len(self._files)), [len(file.spans) // 3 for file in self._files])
        pending: list[_Pending] = []
        if in_file_order:
            for place, (_, offset, length) in enumerate(spans.tolist()):
                number = owner[place]
                with _reading(self._files[number].path):
                    pending = self._files[number].read(offset, length, routes[number], 0)
                for _, _, message in pending:
                    yield message
            return
        for place in np.argsort(spans[:, 0]):
            start, offset, length = (int(number) for number in spans[place])
            number = owner[place]
            ready = bisect_left(pending, (start,))  # what is still to come begins at start or later
            for _, _, message in pending[:ready]:
                yield message
            del pending[:ready]
            with _reading(self._files[number].path):
                held = len(pending)
                pending += self._files[number].read(offset, length, routes[number], int(place) << 32)
                pending.sort()
                if pending and pending[0][0] < start:
                    raise _DamageError("a chunk holds messages from before its beginning")
                if held and sum(200 + len(message[4]) for _, _, message in pending) > _MAX_PENDING:
                    raise _DamageError("its messages are too far out of order")
        for _, _, message in pending:
            yield message


def _files_of(path: Path) -> list[Path]:
    """The bag's ``.mcap`` files, in order."""
    if not path.exists():
        raise InputError(f"{path}: does not exist")
    if not path.is_dir():
        return [path]
    metadata = path / "metadata.yaml"
    if not metadata.is_file():
        raise InputError(f"{path}: has no metadata.yaml; of a recording that was cut off, name the .mcap file")
    try:
        if metadata.stat().st_size > _MAX_METADATA_YAML:
            raise InputError(f"{metadata}: too large to be the description of a bag")
        # Not PyYAML's loader in C: deep nesting overflows its stack and ends the process.
        information = yaml.safe_load(metadata.read_bytes())["rosbag2_bagfile_information"]
        storage = information["storage_identifier"]
        compression = information.get("compression_mode") or "none"
        names = [str(name) for name in information["relative_file_paths"]]
    except OSError as error:
        raise InputError(f"{metadata}: cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError, RecursionError):
        raise InputError(f"{metadata}: is not the description of a bag") from None
    if storage != "mcap":
        raise InputError(f"{path}: its storage is {storage!r}; only mcap is read (ros2 bag convert makes it)")
    if str(compression).lower() != "none":
        raise InputError(f"{path}: its compression_mode is {compression!r}; only chunk compression is read")
    for name in names:
        if PurePath(name).name != name:
            raise InputError(f"{metadata}: {name!r} is not a file of this folder")
        if not (path / name).exists():
            raise InputError(f"{path / name}: does not exist, though metadata.yaml lists it")
    if not names:
        raise InputError(f"{metadata}: lists no file")
    return [path / name for name in names]


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
                raise InputError(f"{path}: is empty")
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise InputError(f"{path}: is not an MCAP file")
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
        self._schemas = {0: ""}
        # Log time of the first message, offset and length of each span, in the order of the file; plain
        # numbers, because an hour of driving has tens of thousands of spans.
        self.spans = array("Q")

    def routes(self, wanted: Collection[str] | None) -> dict[int, tuple[str, str] | None]:
        """Channel to topic and message type; to None for a topic that is not wanted."""
        routes: dict[int, tuple[str, str] | None] = {}
        for channel, (topic, msgtype, encoding) in self.channels.items():
            routes[channel] = (topic, msgtype) if wanted is None or topic in wanted else None
            if routes[channel] and encoding != "cdr":
                raise InputError(f"{self.path}: {topic} is encoded as {encoding!r}; only cdr is read")
        return routes

    def read(
        self, offset: int, length: int, routes: Mapping[int, tuple[str, str] | None], place: int
    ) -> list[_Pending]:
        """The messages of one span, each with its place in the bag."""
        with open(self.path, "rb") as file:
            file.seek(offset)
            data = _exactly(file, length)
        if data[:1] == _CHUNK_OPCODE:
            data = _chunk_records(memoryview(data)[_RECORD.size :])
        pending: list[_Pending] = []
        for opcode, position, end in _records(data):
            if opcode == Opcode.MESSAGE:
                channel, _, log_time, publish_time = _MESSAGE.unpack_from(data, position)
                try:
                    route = routes[channel]
                except KeyError:
                    raise _DamageError(f"channel {channel} is not declared") from None
                if route:
                    message = *route, log_time, publish_time, data[position + _MESSAGE.size : end]
                    pending.append((log_time, place + len(pending), message))
                    if len(pending) > _MAX_CHUNK_MESSAGES:
                        raise _DamageError("a chunk holds too many messages")
        return pending

    def _add_record(self, opcode: int, content: bytes) -> None:
        """Take in a record that describes messages, wherever it stands."""
        stream = ReadDataStream(io.BytesIO(content))
        if opcode == Opcode.SCHEMA:
            schema = records.Schema.read(stream)
            self._schemas[schema.id] = schema.name
        elif opcode == Opcode.CHANNEL:
            channel = records.Channel.read(stream)
            if channel.schema_id not in self._schemas:
                raise _DamageError(f"{channel.topic} has no schema")
            msgtype = self._schemas[channel.schema_id]
            self.channels[channel.id] = channel.topic, msgtype, channel.message_encoding
        elif opcode == Opcode.METADATA:
            metadata = records.Metadata.read(stream)
            self.metadata[metadata.name] = metadata.metadata

    def _read_summary(self, file: BinaryIO, size: int) -> None:
        """Take everything from the summary; ``_DAMAGE`` if it is not there or not whole."""
        file.seek(max(size - _FOOTER_LENGTH, 0))
        footer = file.read()
        opcode, _, position, _, crc = _FOOTER.unpack_from(footer)
        if opcode != Opcode.FOOTER or footer[_FOOTER.size :] != MCAP0_MAGIC or not position:
            raise _DamageError("no summary")
        statistics = None
        metadata_indexes = []
        actual_crc = 0
        file.seek(position)
        while position < size - _FOOTER_LENGTH:
            head = _exactly(file, _RECORD.size)
            opcode, length = _RECORD.unpack(head)
            content = _exactly(file, length, _MAX_RECORD)
            actual_crc = zlib.crc32(content, zlib.crc32(head, actual_crc))
            position += _RECORD.size + length
            if opcode == Opcode.CHUNK_INDEX:
                start, _, offset, chunk_length = _CHUNK_INDEX.unpack_from(content)
                if offset + chunk_length > size:
                    raise _DamageError("a chunk beyond the end")
                self.spans.extend((start, offset, chunk_length))
            elif opcode == Opcode.STATISTICS:
                statistics = records.Statistics.read(ReadDataStream(io.BytesIO(content)))
            elif opcode == Opcode.METADATA_INDEX:
                metadata_indexes.append(records.MetadataIndex.read(ReadDataStream(io.BytesIO(content))))
            else:
                self._add_record(opcode, content)
        if crc and zlib.crc32(footer[: _FOOTER.size - 4], actual_crc) != crc:
            raise _DamageError("the summary does not match its checksum")
        if statistics is None or statistics.chunk_count != len(self.spans) // 3:
            raise _DamageError("no index of the chunks")
        if statistics.message_count and not statistics.chunk_count:
            raise _DamageError("messages outside chunks have no index")
        if statistics.channel_count != len(self.channels):
            raise _DamageError("no channels")
        for index in metadata_indexes:
            file.seek(index.offset)
            opcode, length = _RECORD.unpack(_exactly(file, _RECORD.size))
            self._add_record(opcode, _exactly(file, length, _MAX_RECORD))
        self.count = statistics.message_count
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
        start = _NO_TIME
        for opcode, position, end in _records(data):
            if opcode == Opcode.MESSAGE:
                start = min(start, self._see_message(data[position : position + _MESSAGE.size]))
            else:
                self._add_record(opcode, data[position:end])
        return start

    def _see_message(self, head: bytes) -> int:
        channel, _, log_time, _ = _MESSAGE.unpack(head)
        if channel not in self.channels:
            raise _DamageError(f"channel {channel} is not declared")
        self.count += 1
        self.start, self.end = min(self.start, log_time), max(self.end, log_time)
        return int(log_time)


def _exactly(file: BinaryIO, length: int, limit: int = _MAX_CHUNK) -> bytes:
    if length > limit:
        raise _DamageError(f"a record claims {length} bytes")
    data = file.read(length)
    if len(data) < length:
        raise _DamageError("it ends in the middle of a record")
    return data


def _records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, position and end of the content of each record."""
    position = 0
    while position < len(data):
        opcode, length = _RECORD.unpack_from(data, position)
        position += _RECORD.size
        end = position + length
        if end > len(data) or (opcode == Opcode.MESSAGE and length < _MESSAGE.size):
            raise _DamageError("a record does not fit")
        yield opcode, position, end
        position = end


def _chunk_records(content: memoryview) -> bytes:
    """The records in a chunk, given the chunk record's content."""
    _, _, size, crc, name_length = _CHUNK.unpack_from(content)
    if size > _MAX_CHUNK:
        raise _DamageError(f"a chunk claims {size} bytes")
    position = _CHUNK.size + name_length
    compression = bytes(content[_CHUNK.size : position])
    stored = content[position + 8 :]  # its length, 8 bytes, is the rest of the record
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
