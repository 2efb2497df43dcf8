"""The records of an MCAP file, but for chunks' messages and their indexes, which ``chunks`` lays out by NumPy.

After the format's specification, version 0 (https://mcap.dev/spec): numbers are little-endian, a text stands behind its
length, and what follows the fields that are known here has been appended by a later version.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from enum import IntEnum
from typing import Final, NamedTuple

__all__ = [
    "MAGIC", "Channel", "Chunk", "ChunkIndex", "DamageError", "DataEnd", "Footer", "Header", "Metadata",
    "MetadataIndex", "Opcode", "RecordType", "Schema", "Statistics", "SummaryOffset", "bytes_of",
]  # fmt: skip

MAGIC: Final = b"\x89MCAP0\r\n"
"""At both ends of a file."""


class Opcode(IntEnum):
    """What kind of record follows."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    ATTACHMENT = 0x09
    ATTACHMENT_INDEX = 0x0A
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    SUMMARY_OFFSET = 0x0E
    DATA_END = 0x0F


class DamageError(ValueError):
    """What is wrong with the bytes of a bag."""


class _Fields:
    """Takes the fields of a record's content, one after the other; ``DamageError`` where it ends before them."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._position = 0

    def numbers(self, layout: struct.Struct) -> tuple[int, ...]:
        place = self._take(layout.size)
        return layout.unpack_from(self._content, place)

    def data(self) -> bytes:
        length = self.numbers(_U4)[0]
        place = self._take(length)
        return self._content[place : place + length]

    def text(self) -> str:
        return self.data().decode()

    def texts(self) -> dict[str, str]:
        end = self.numbers(_U4)[0] + self._position
        found = {}
        while self._position < end:
            key = self.text()
            found[key] = self.text()
        self._end_at(end)
        return found

    def counts(self) -> dict[int, int]:
        end = self.numbers(_U4)[0] + self._position
        found = {}
        while self._position < end:
            key, value = self.numbers(_COUNT)
            found[key] = value
        self._end_at(end)
        return found

    def _take(self, length: int) -> int:
        place = self._position
        self._position += length
        if self._position > len(self._content):
            raise DamageError("a record does not fit")
        return place

    def _end_at(self, end: int) -> None:
        if self._position != end:
            raise DamageError("a record does not fit")


_RECORD = struct.Struct("<BQ")
_U4, _U8 = struct.Struct("<I"), struct.Struct("<Q")
_COUNT = struct.Struct("<HQ")
_ID_AND_SCHEMA = struct.Struct("<HH")
_ID = struct.Struct("<H")
_STATISTICS = struct.Struct("<QHIIIIQQ")
_PLACE = struct.Struct("<QQ")
_CHUNK = struct.Struct("<QQQI")
_CHUNK_INDEX = struct.Struct("<QQQQ")
_GROUP = struct.Struct("<BQQ")
_FOOTER = struct.Struct("<QQI")


def _data(data: bytes) -> bytes:
    return _U4.pack(len(data)) + data


def _text(text: str) -> bytes:
    return _data(text.encode())


def _texts(texts: Mapping[str, str]) -> bytes:
    return _data(b"".join(_text(key) + _text(value) for key, value in texts.items()))


def _counts(counts: Mapping[int, int]) -> bytes:
    return _data(b"".join(_COUNT.pack(key, value) for key, value in counts.items()))


class Header(NamedTuple):
    """The first record."""

    profile: str
    library: str

    def content(self) -> bytes:
        """As it stands in a file."""
        return _text(self.profile) + _text(self.library)

    @classmethod
    def read(cls, content: bytes) -> Header:
        """From a record's content; ``DamageError`` if it is not one."""
        fields = _Fields(content)
        return cls(fields.text(), fields.text())


class Schema(NamedTuple):
    """A message type and its definition."""

    id: int
    name: str
    encoding: str
    data: bytes

    def content(self) -> bytes:
        """As it stands in a file."""
        return _ID.pack(self.id) + _text(self.name) + _text(self.encoding) + _data(self.data)

    @classmethod
    def read(cls, content: bytes) -> Schema:
        """From a record's content; ``DamageError`` if it is not one."""
        fields = _Fields(content)
        return cls(fields.numbers(_ID)[0], fields.text(), fields.text(), fields.data())


class Channel(NamedTuple):
    """A topic; of no schema if ``schema_id`` is 0."""

    id: int
    schema_id: int
    topic: str
    message_encoding: str
    metadata: dict[str, str]

    def content(self) -> bytes:
        """As it stands in a file."""
        numbers = _ID_AND_SCHEMA.pack(self.id, self.schema_id)
        return numbers + _text(self.topic) + _text(self.message_encoding) + _texts(self.metadata)

    @classmethod
    def read(cls, content: bytes) -> Channel:
        """From a record's content; ``DamageError`` if it is not one."""
        fields = _Fields(content)
        number, schema = fields.numbers(_ID_AND_SCHEMA)
        return cls(number, schema, fields.text(), fields.text(), fields.texts())


class Chunk(NamedTuple):
    """Records that are compressed together; times in ns."""

    start_time: int
    end_time: int
    uncompressed_size: int
    uncompressed_crc: int
    compression: str
    data: bytes

    def content(self) -> bytes:
        """As it stands in a file."""
        head = _CHUNK.pack(self.start_time, self.end_time, self.uncompressed_size, self.uncompressed_crc)
        return head + _text(self.compression) + _U8.pack(len(self.data)) + self.data


class ChunkIndex(NamedTuple):
    """Where a chunk is, and for each channel the index of its messages there; times in ns."""

    start_time: int
    end_time: int
    chunk_start: int
    chunk_length: int
    message_index_offsets: dict[int, int]
    message_index_length: int
    compression: str
    compressed_size: int
    uncompressed_size: int

    def content(self) -> bytes:
        """As it stands in a file."""
        head = _CHUNK_INDEX.pack(self.start_time, self.end_time, self.chunk_start, self.chunk_length)
        places = _counts(self.message_index_offsets) + _U8.pack(self.message_index_length)
        return head + places + _text(self.compression) + _PLACE.pack(self.compressed_size, self.uncompressed_size)


class Metadata(NamedTuple):
    """Texts by their names."""

    name: str
    metadata: dict[str, str]

    def content(self) -> bytes:
        """As it stands in a file."""
        return _text(self.name) + _texts(self.metadata)

    @classmethod
    def read(cls, content: bytes) -> Metadata:
        """From a record's content; ``DamageError`` if it is not one."""
        fields = _Fields(content)
        return cls(fields.text(), fields.texts())


class MetadataIndex(NamedTuple):
    """Where a metadata record is."""

    offset: int
    length: int
    name: str

    def content(self) -> bytes:
        """As it stands in a file."""
        return _PLACE.pack(self.offset, self.length) + _text(self.name)

    @classmethod
    def read(cls, content: bytes) -> MetadataIndex:
        """From a record's content; ``DamageError`` if it is not one."""
        fields = _Fields(content)
        offset, length = fields.numbers(_PLACE)
        return cls(offset, length, fields.text())


class Statistics(NamedTuple):
    """How much of what there is in a file; times in ns."""

    message_count: int
    schema_count: int
    channel_count: int
    attachment_count: int
    metadata_count: int
    chunk_count: int
    message_start_time: int
    message_end_time: int
    channel_message_counts: dict[int, int]

    def content(self) -> bytes:
        """As it stands in a file."""
        numbers = _STATISTICS.pack(
            self.message_count, self.schema_count, self.channel_count, self.attachment_count, self.metadata_count,
            self.chunk_count, self.message_start_time, self.message_end_time,
        )  # fmt: skip
        return numbers + _counts(self.channel_message_counts)

    @classmethod
    def read(cls, content: bytes) -> Statistics:
        """From a record's content; ``DamageError`` if it is not one."""
        fields = _Fields(content)
        messages, schemas, channels, attachments, metadata, chunks, start, end = fields.numbers(_STATISTICS)
        return cls(messages, schemas, channels, attachments, metadata, chunks, start, end, fields.counts())


class SummaryOffset(NamedTuple):
    """Where in the summary the records of a kind are."""

    group_opcode: int
    group_start: int
    group_length: int

    def content(self) -> bytes:
        """As it stands in a file."""
        return _GROUP.pack(*self)


class DataEnd(NamedTuple):
    """Behind it comes the summary."""

    crc: int

    def content(self) -> bytes:
        """As it stands in a file."""
        return _U4.pack(self.crc)


class Footer(NamedTuple):
    """The last record."""

    summary_start: int
    summary_offset_start: int
    summary_crc: int

    def content(self) -> bytes:
        """As it stands in a file."""
        return _FOOTER.pack(*self)


RecordType = (
    Header | Schema | Channel | Chunk | ChunkIndex | Metadata | MetadataIndex | Statistics | SummaryOffset | DataEnd
    | Footer
)  # fmt: skip

_OPCODES: Final[dict[type[RecordType], Opcode]] = {
    Header: Opcode.HEADER,
    Schema: Opcode.SCHEMA,
    Channel: Opcode.CHANNEL,
    Chunk: Opcode.CHUNK,
    ChunkIndex: Opcode.CHUNK_INDEX,
    Metadata: Opcode.METADATA,
    MetadataIndex: Opcode.METADATA_INDEX,
    Statistics: Opcode.STATISTICS,
    SummaryOffset: Opcode.SUMMARY_OFFSET,
    DataEnd: Opcode.DATA_END,
    Footer: Opcode.FOOTER,
}


def bytes_of(*some: RecordType) -> bytes:
    """Records as they stand in a file, one behind the other."""
    parts = []
    for record in some:
        content = record.content()
        parts += [_RECORD.pack(_OPCODES[type(record)], len(content)), content]
    return b"".join(parts)
