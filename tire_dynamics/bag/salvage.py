"""Finds what is whole in an MCAP file that is damaged.

A chunk is whole if its lengths fit, its checksum is right and its records fit into it; of any other nothing is
used. Records outside chunks have no checksum: they are whole if their lengths fit and what follows is a record.
What looks like such messages after damage may stand in a damaged chunk: a file that has chunks is not searched
for them. What the summary declares is used if the summary's checksum is right.
"""

from __future__ import annotations

import os
import zlib
from array import array
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .chunks import HEAD, heads_at
from .record_types import MAGIC, Channel, Header, Metadata, Opcode, Schema, Statistics
from .records import (
    CHUNK,
    DAMAGE,
    MAX_CHUNK,
    MAX_KEPT,
    MAX_RECORD,
    MESSAGE,
    RECORD,
    RUN,
    DamageError,
    chunk_records,
    exactly,
    message_records,
    one_line,
    reading,
)

__all__ = ["Declared", "Lost", "Messages", "Salvage"]

_WINDOW = 2**20  # bytes that are searched together
_CHAIN = 3  # records in a row that are believed where one could be chance
_MAX_NAME = 1000  # characters of a topic or type
_MOST_APPENDED = 1000  # bytes behind what is known of a chunk
_NAMES = (b"", b"lz4", b"zstd")  # of compressions
# Pieces. Unsure is what is not in a chunk and comes after damage; behind the end of the data only the index is lost.
_CHUNKED, _UNCHUNKED, _UNSURE, _LOST, _LOST_BEHIND = range(5)

_CHUNKLESS = (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL)  # what a chunk holds, and may stand outside
_KINDS: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
}
# The least and the greatest length of a record's content, by opcode.
_LIMITS = np.zeros((2, 256), np.int64)
_LIMITS[0] = 2**62
for _code in Opcode:
    _LIMITS[:, _code] = 4, MAX_RECORD
for _code, _least, _most in (
    (Opcode.MESSAGE, MESSAGE.size, MAX_CHUNK),
    (Opcode.CHUNK, CHUNK.size + 8, MAX_CHUNK + 100),
    (Opcode.MESSAGE_INDEX, 6, MAX_CHUNK),
    (Opcode.ATTACHMENT, 36, 2**62),
    (Opcode.FOOTER, 20, 20),
    (Opcode.DATA_END, 4, 4),
):
    _LIMITS[:, _code] = _least, _most


class Declared(NamedTuple):
    """What a file says of a channel."""

    topic: str
    msgtype: str
    schema_encoding: str
    schema: bytes
    encoding: str
    metadata: tuple[tuple[str, str], ...]


class Lost(NamedTuple):
    """A part of the file that cannot be used; ``messages`` if there may have been messages in it."""

    offset: int
    length: int
    messages: bool


class Messages(NamedTuple):
    """Messages as columns, (N,); message ``i`` is ``data[start[i] : start[i] + size[i]]``.

    ``channel`` is an index into ``Salvage.declared``, -1 for a channel that is not declared, or in two ways.
    """

    channel: NDArray[np.int64]
    sequence: NDArray[np.int64]
    log_time: NDArray[np.uint64]
    publish_time: NDArray[np.uint64]
    data: bytes
    start: NDArray[np.int64]
    size: NDArray[np.int64]


class _BadChunkError(DamageError):
    """A chunk whose lengths fit, and whose content is not to be used."""

    def __init__(self, text: str, end: int) -> None:
        super().__init__(text)
        self.end = end


class Salvage:
    """Goes through a file twice: first to find what is whole and what is declared, then for the messages.

    Parameters
    ----------
    path : Path
    place : Path, optional
        Where its bytes are, if they have been unpacked.

    Attributes
    ----------
    size : int
        Bytes of the file.
    declared : list of Declared
        The channels, in the order of the file, as far as ``pieces`` has come.
    metadata : list of (str, dict of str to str)
        Metadata records.
    bytes_lost, chunks_lost : int
    reasons : Counter
        What is wrong with what is lost, and how often.
    attachments : int
    expected : int or None
        How many messages the file's own statistics count.
    closed : bool
        Whether the file has the record that ends its data.

    Raises
    ------
    InputError
        The file cannot be read, or has nothing of an MCAP file.
    """

    def __init__(self, path: Path, place: Path | None = None) -> None:
        self.path = path
        self._place = place or path
        self.declared: list[Declared] = []
        self.metadata: list[tuple[str, dict[str, str]]] = []
        self.bytes_lost = self.chunks_lost = self.attachments = 0
        self.reasons: Counter[str] = Counter()
        self.expected: int | None = None
        self.closed = False
        self._ended = False  # with what an MCAP file ends with
        self._data_end = 0  # where the summary begins
        self._sure = True  # not in what may be a damaged chunk
        self._chunked = False
        self._summary: list[tuple[int, bytes]] = []  # what it declares
        self._unsure: list[tuple[int, bytes]] = []  # what is declared where messages are unsure
        self._pieces = array("Q")  # kind, offset, length
        self._first: dict[tuple[int, int], bytes] = {}  # (opcode, id) to the first schema or channel record
        self._kept = 0
        self._candidates = (0, 0, np.empty(0, np.int64))  # where a record could begin, from and to a place
        with reading(path), open(self._place, "rb") as file:
            self.size = os.fstat(file.fileno()).st_size
            self._trials = 2**28 + 4 * self.size  # bytes of bad chunks in which to look for records
            self._survey(file)

    # -- the first time -------------------------------------------------------------------------------------

    def _survey(self, file: BinaryIO) -> None:
        position, lost = 0, None  # lost: since where
        while position < self.size:
            try:
                end = self._record(file, position, lost)
            except DAMAGE as error:
                if lost is None or isinstance(error, _BadChunkError):
                    self._note(one_line(error))
                lost = position if lost is None else lost
                self._sure = False
                position = self._behind(file, position, error)
                continue
            lost, position = None, end
        if lost is not None:
            self._lose(lost, self.size)
        if not self._ended:
            self._note("it has no end")
        self._settle()

    def _settle(self) -> None:
        """Decide on what is unsure."""
        if not self._chunked:
            self._remember(self._unsure)
            return
        for number in range(0, len(self._pieces), 3):
            if self._pieces[number] == _UNSURE:
                self._pieces[number] = _LOST
                self.bytes_lost += self._pieces[number + 2]

    def _note(self, reason: str) -> None:
        known = reason in self.reasons or len(self.reasons) < 10
        self.reasons[reason if known else "other damage"] += 1

    def _lose(self, start: int, end: int) -> None:
        """Give up a part of the file."""
        pieces = self._pieces
        if pieces and pieces[-3] in (_LOST, _LOST_BEHIND) and pieces[-2] == start:  # it goes on
            self.bytes_lost -= pieces[-1]
            del pieces[-3:]
        self.bytes_lost += end - start
        pieces.extend((_LOST_BEHIND if self.closed else _LOST, start, end - start))

    def _behind(self, file: BinaryIO, position: int, error: BaseException) -> int:
        """Where to go on after damage: behind a chunk whose lengths fit, else where the next record could begin."""
        if isinstance(error, _BadChunkError):
            self.chunks_lost += 1
            self._trials -= max(error.end - position, 2**16)
            if error.end <= self.size and (self._trials < 0 or self._follows(file, error.end, _CHAIN)):
                return error.end
        return self._next(file, position + 1)

    def _record(self, file: BinaryIO, position: int, lost: int | None) -> int:
        """Take in the record at a place, and where it ends; ``DAMAGE`` if it is not whole.

        ``lost`` is since where all was damaged before it, if it was.
        """
        head = _at(file, position, RECORD.size + CHUNK.size + 16)
        if head.startswith(MAGIC):
            self._ended = 0 < position == self.size - len(MAGIC)
            if lost is not None:
                self._lose(lost, position)
            return position + len(MAGIC)
        if position == 0:
            raise DamageError("it does not begin as an MCAP file")
        opcode, end = self._frame(head, position)
        length = end - position - RECORD.size
        if opcode == Opcode.CHUNK:
            self._chunk(file, position, end, head, lost)
            return end
        if end > self.size:
            raise DamageError("it ends in the middle of a record")
        if opcode == Opcode.ATTACHMENT:
            content = b""
        else:
            file.seek(position + RECORD.size)
            content = exactly(file, min(length, MESSAGE.size) if opcode == Opcode.MESSAGE else length)
        content = self._check(opcode, content)
        if not self._follows(file, end, 1 if lost is None else _CHAIN):
            raise DamageError("a record does not fit")
        if lost is not None:
            self._lose(lost, position)
        if opcode in _CHUNKLESS:
            self.closed = self.closed and opcode != Opcode.MESSAGE
            self._chunkless(opcode, content, position, end)
            return end
        self._sure = True
        if opcode == Opcode.METADATA:
            record = Metadata.read(content)
            self._keep(len(content))
            self.metadata.append((record.name, record.metadata))
        elif opcode == Opcode.STATISTICS:
            self.expected = Statistics.read(content).message_count
        elif opcode == Opcode.ATTACHMENT:
            self.attachments += 1
        elif opcode == Opcode.DATA_END:
            self.closed = True
            self._data_end = end
        elif opcode == Opcode.FOOTER:
            # From where the summary is, not from where it was: bytes may have come or gone before it.
            crc = int.from_bytes(content[16:], "little")
            if not crc or crc == _crc(file, self._data_end, position + RECORD.size + 16):
                self._remember(self._summary)
        return end

    def _chunkless(self, opcode: int, content: bytes, position: int, end: int) -> None:
        """Take in a message or a declaration that is not in a chunk."""
        if self.closed:
            self._summary.append((opcode, content))
            self._keep(len(content))
            return
        if opcode != Opcode.MESSAGE and self._sure:
            self._remember([(opcode, content)])
        elif opcode != Opcode.MESSAGE:
            self._unsure.append((opcode, content))
            self._keep(len(content))
        kind, pieces = _UNCHUNKED if self._sure else _UNSURE, self._pieces
        if pieces and pieces[-3] == kind and pieces[-2] + pieces[-1] == position and pieces[-1] < RUN:
            pieces[-1] += end - position
        else:
            pieces.extend((kind, position, end - position))

    def _frame(self, head: bytes, position: int) -> tuple[int, int]:
        """Opcode and end of the record that begins with these bytes."""
        if len(head) < RECORD.size:
            raise DamageError("it ends in the middle of a record")
        opcode, length = RECORD.unpack_from(head)
        if not _LIMITS[0, opcode] <= length <= _LIMITS[1, opcode]:
            raise DamageError("bytes that are no record")
        return opcode, position + RECORD.size + length

    def _chunk(self, file: BinaryIO, position: int, end: int, head: bytes, lost: int | None) -> None:
        """Take in a chunk, all of it or nothing."""
        content = head[RECORD.size :]
        name_length = CHUNK.unpack_from(content)[4] if len(content) >= CHUNK.size else 0
        fixed = CHUNK.size + name_length
        if len(content) < min(fixed + 8, CHUNK.size + 16) or name_length > 8:
            raise DamageError("bytes that are no record")
        stored = int.from_bytes(content[fixed : fixed + 8], "little")
        appended = end - position - RECORD.size - fixed - 8 - stored
        if appended and not (0 < appended <= _MOST_APPENDED and self._follows(file, end, _CHAIN)):
            raise DamageError("a chunk's lengths do not fit")
        if end > self.size:
            raise _BadChunkError("it ends in the middle of a chunk", end)
        found: list[tuple[int, bytes]] = []
        try:
            data = self._read(file, position, end - position)
            for _, others in message_records(data, True):
                for opcode, first, after in others:
                    found.append((opcode, self._check(opcode, data[first:after])))
            self._remember(found)
        except DAMAGE as error:
            raise _BadChunkError(one_line(error), end) from None
        if lost is not None:
            self._lose(lost, position)
        self.closed, self._sure, self._chunked = False, True, True
        self._pieces.extend((_CHUNKED, position, end - position))

    def _check(self, opcode: int, content: bytes) -> bytes:
        """A record's content without what a later format has appended; ``DAMAGE`` if it is not of its kind."""
        if opcode == Opcode.MESSAGE_INDEX:
            if int.from_bytes(content[2:6], "little") > len(content) - 6:
                raise DamageError("a record does not fit")
        return _known_part(opcode, content) if opcode in _KINDS else content

    def _remember(self, found: list[tuple[int, bytes]]) -> None:
        """Keep the first record that declares a schema or channel: damage may have taken it from where it is used."""
        for opcode, content in found:
            key = opcode, int.from_bytes(content[:2], "little")
            if key not in self._first:
                self._keep(len(content))
                self._first[key] = content

    def _keep(self, length: int) -> None:
        if self._kept + length + 100 > MAX_KEPT:
            raise DamageError("it declares more topics and metadata than a bag needs")
        self._kept += length + 100

    def _follows(self, file: BinaryIO, position: int, count: int) -> bool:
        """Whether at a place there are the heads of so many records, or the end of the file."""
        for _ in range(count):
            head = _at(file, position, RECORD.size)
            if position == self.size or head.startswith(MAGIC) or head == MAGIC[: len(head)]:
                return True
            try:
                _, position = self._frame(head, position)
            except DamageError:
                return False
            if position > self.size:  # the last record, cut off
                return count == 1
        return True

    def _next(self, file: BinaryIO, position: int) -> int:
        """The next place at which a record could begin, or the end of the file."""
        while position < self.size:
            first, last, places = self._candidates
            if not first <= position < last:
                first, last, places = self._candidates = self._search(file, position)
            index = int(np.searchsorted(places, position))
            if index < len(places):
                return int(places[index])
            position = last
        return self.size

    def _search(self, file: BinaryIO, first: int) -> tuple[int, int, NDArray[np.int64]]:
        octets = np.frombuffer(_at(file, first, _WINDOW + RECORD.size - 1), np.uint8)
        count = len(octets) - RECORD.size + 1
        if count <= 0:
            return first, self.size, np.empty(0, np.int64)
        lengths = np.ndarray(count, "<i8", octets[1:].copy(), strides=(1,))
        places = np.arange(first, first + count)
        least, most = _LIMITS[:, octets[:count]]
        fits = (least <= lengths) & (lengths <= np.minimum(most, self.size - RECORD.size - places))
        magic = np.frombuffer(MAGIC, np.uint8)
        fits |= (octets[:count] == magic[0]) & (octets[1 : count + 1] == magic[1]) & (octets[2 : count + 2] == magic[2])
        return first, first + count, places[fits]

    # -- the second time ------------------------------------------------------------------------------------

    @property
    def count(self) -> int:
        """How many pieces there are."""
        return len(self._pieces) // 3

    def pieces(self) -> Iterator[Lost | Messages]:
        """The file from its beginning to its end, a few megabytes at a time."""
        state = _State(self._first, self.declared)
        for number in range(0, len(self._pieces), 3):
            kind, offset, length = self._pieces[number : number + 3]
            if kind in (_LOST, _LOST_BEHIND):
                yield Lost(offset, length, kind == _LOST)
                continue
            try:
                with open(self._place, "rb") as file:
                    data = self._read(file, offset, length)
                found = list(self._messages(data, state))
            except (*DAMAGE, OSError):  # it is being written to, or the disk fails
                self.bytes_lost += length
                self._note("it changed while it was read")
                yield Lost(offset, length, True)
                continue
            yield from found
        state.finish()

    def _read(self, file: BinaryIO, offset: int, length: int) -> bytes:
        """The records of a chunk or a run."""
        file.seek(offset)
        data = exactly(file, length, MAX_CHUNK + 2 * RUN)
        return chunk_records(memoryview(data)[RECORD.size :]) if data[0] == Opcode.CHUNK else data

    def _messages(self, data: bytes, state: _State) -> Iterator[Messages]:
        for places, others in message_records(data, False):
            for opcode, first, after in others:
                if opcode in _KINDS:
                    state.declare(opcode, _known_part(opcode, data[first:after]))
            heads = heads_at(data, places)
            if len(heads):
                numbers, places_of = np.unique(heads["channel"], return_inverse=True)
                yield Messages(
                    np.array([state.route(number) for number in numbers.tolist()])[places_of.reshape(-1)],
                    heads["sequence"].astype(np.int64),
                    heads["log_time"],
                    heads["publish_time"],
                    data,
                    places + HEAD.itemsize,
                    heads["length"].astype(np.int64) - MESSAGE.size,
                )


class _State:
    """The declarations in force: those that came before, else the first that is to come."""

    def __init__(self, first: dict[tuple[int, int], bytes], declared: list[Declared]) -> None:
        self._first = first
        self._declared = declared
        self._indices: dict[Declared, int] = {}
        self._parsed: dict[bytes, Schema] = {b"": Schema(0, "", "", b"")}
        self._schemas: dict[int, bytes | None] = {0: b""}
        self._channels: dict[int, tuple[int, int]] = {}  # id to index of what is declared, hash of the record

    def declare(self, opcode: int, content: bytes) -> None:
        number = int.from_bytes(content[:2], "little")
        if opcode == Opcode.SCHEMA:
            if self._schemas.setdefault(number, content) != content:
                self._schemas[number] = None  # declared in two ways: which is meant, nobody knows
        elif opcode == Opcode.CHANNEL:
            known = self._channels.get(number)
            if known is None:
                self._channels[number] = self._index(content), hash(content)
            elif known[1] != hash(content) and self._index(content) != known[0]:
                self._channels[number] = -1, 0

    def route(self, number: int) -> int:
        """The index of what a channel is declared as; -1 for none."""
        known = self._channels.get(number)
        if known is None:
            content = self._first.get((Opcode.CHANNEL, number))
            if content is None:
                return -1
            known = self._channels[number] = self._index(content), hash(content)
        return known[0]

    def finish(self) -> None:
        """Add the channels of which there is no message."""
        for opcode, number in self._first:
            if opcode == Opcode.CHANNEL:
                self.route(number)

    def _index(self, content: bytes) -> int:
        channel = Channel.read(content)
        data = self._schemas.get(channel.schema_id, self._first.get((Opcode.SCHEMA, channel.schema_id)))
        if data is None:
            return -1
        schema = self._parsed.get(data)
        if schema is None:
            schema = self._parsed[data] = Schema.read(data)
        if max(len(channel.topic), len(schema.name)) > _MAX_NAME:
            return -1
        new = Declared(
            channel.topic,
            schema.name,
            schema.encoding,
            schema.data,
            channel.message_encoding,
            tuple(channel.metadata.items()),
        )
        if new not in self._indices:
            self._indices[new] = len(self._declared)
            self._declared.append(new)
        return self._indices[new]


def _known_part(opcode: int, content: bytes) -> bytes:
    """The content of a record up to the last field that is known: others may be appended, and are to be ignored."""
    known: bytes = _KINDS[opcode].read(content).content()
    if not content.startswith(known):
        raise DamageError("a record does not fit")
    return known


def _crc(file: BinaryIO, start: int, end: int) -> int:
    crc = 0
    for position in range(start, end, _WINDOW):
        crc = zlib.crc32(_at(file, position, min(_WINDOW, end - position)), crc)
    return crc


def _at(file: BinaryIO, position: int, length: int) -> bytes:
    """What stands at a place, as far as the file goes."""
    file.seek(position)
    return file.read(length)
