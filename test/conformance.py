"""The MCAP conformance suite, made anew from its public description.

Six contents times every combination of ten features that makes sense for them: 416 files. The description is that of
foxglove/mcap, tests/conformance; ``DIGEST`` is made of the SHA-256 sums that are published there for the files
(as Git LFS pointers, at commit 95d067356).
"""

from __future__ import annotations

import hashlib
import itertools
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

MAGIC = b"\x89MCAP0\r\n"
DIGEST = "eabcfbf8e6525dd4022cb979a3d1793443a31f427cc163be4ddb98e295cd8d01"
"""SHA-256 of the lines ``NAME SHA-256`` of all files in the order of their names."""

CHUNKS, MESSAGE_INDEX, STATISTICS, SCHEMAS, CHANNELS = "ch", "mx", "st", "rsh", "rch"
ATTACHMENT_INDEX, METADATA_INDEX, CHUNK_INDEX, SUMMARY_OFFSET, PAD = "ax", "mdx", "chx", "sum", "pad"
FEATURES = (
    CHUNKS, MESSAGE_INDEX, STATISTICS, SCHEMAS, CHANNELS,
    ATTACHMENT_INDEX, METADATA_INDEX, CHUNK_INDEX, SUMMARY_OFFSET, PAD,
)  # fmt: skip
PADDING = b"\x01\xff\xff"  # what a later version of the format might have appended
FIXED = (records.Footer, records.Message, records.Chunk, records.DataEnd)  # kinds that may never be extended

SCHEMA = records.Schema(1, bytes([4, 5, 6]), "c", "Example")
CHANNEL = records.Channel(1, "example", "a", {"foo": "bar"}, 1)


def _message(sequence: int, log_time: int, publish_time: int) -> records.Message:
    return records.Message(1, log_time, bytes([1, 2, 3]), publish_time, sequence)


CONTENTS: dict[str, list[records.McapRecord]] = {
    "NoData": [],
    "OneSchemalessMessage": [records.Channel(1, "example", "text", {}, 0), _message(10, 2, 1)],
    "OneMessage": [SCHEMA, CHANNEL, _message(10, 2, 1)],
    "OneAttachment": [records.Attachment(1, 2, "myFile", "application/octet-stream", bytes([1, 2, 3]))],
    "OneMetadata": [records.Metadata("myMetadata", {"foo": "bar"})],
    "TenMessages": [SCHEMA, CHANNEL, *(_message(k, t, t) for k, t in enumerate([0, 2, 1, 3, 3, 5, 4, 7, 8, 9]))],
}


class File(NamedTuple):
    """A file of the suite: its name, what it was made from, and its bytes."""

    name: str
    content: list[Any]
    features: frozenset[str]
    data: bytes

    def of(self, kind: type) -> list[Any]:
        """The records of a kind that the file was made from."""
        return [record for record in self.content if isinstance(record, kind)]


def files() -> Iterator[File]:
    """All 416, one by one."""
    for name, content in CONTENTS.items():
        for count in range(len(FEATURES) + 1):
            for some in itertools.combinations(FEATURES, count):
                features = frozenset(some)
                if _makes_sense(content, features):
                    yield File("-".join([name, *sorted(features)]), content, features, _file(content, features))


def digest(found: list[File]) -> str:
    """``DIGEST`` of these files."""
    lines = sorted(f"{file.name} {hashlib.sha256(file.data).hexdigest()}\n" for file in found)
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def _makes_sense(content: list[records.McapRecord], features: frozenset[str]) -> bool:
    kinds = {type(record) for record in content}
    needs = {
        ATTACHMENT_INDEX: records.Attachment,
        METADATA_INDEX: records.Metadata,
        SCHEMAS: records.Schema,
        CHANNELS: records.Channel,
        CHUNKS: records.Channel,
    }
    return (
        all(kind in kinds for feature, kind in needs.items() if feature in features)
        and (CHUNKS in features or not features & {CHUNK_INDEX, MESSAGE_INDEX})
        and (SUMMARY_OFFSET not in features or bool(features - {CHUNKS, MESSAGE_INDEX, SUMMARY_OFFSET, PAD}))
    )


def _bytes(record: records.McapRecord, pad: bool = False) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    if pad and not isinstance(record, FIXED):
        data = data[:1] + struct.pack("<Q", len(data) - 9 + len(PADDING)) + data[9:] + PADDING
    return data


def _file(content: list[Any], features: frozenset[str]) -> bytes:
    pad = PAD in features
    out = bytearray(MAGIC + _bytes(records.Header("", ""), pad))
    summary: dict[Opcode, list[Any]] = {
        Opcode.SCHEMA: [r for r in content if isinstance(r, records.Schema)] if SCHEMAS in features else [],
        Opcode.CHANNEL: [r for r in content if isinstance(r, records.Channel)] if CHANNELS in features else [],
    }
    indexes: dict[Opcode, list[Any]] = {Opcode.METADATA_INDEX: [], Opcode.ATTACHMENT_INDEX: [], Opcode.CHUNK_INDEX: []}
    chunk, places = bytearray(), {}
    for record in content:
        if isinstance(record, records.Attachment):
            start = len(out)
            out += _bytes(record, pad)
            if ATTACHMENT_INDEX in features:
                index = records.AttachmentIndex(
                    offset=start,
                    length=len(out) - start,
                    log_time=record.log_time,
                    create_time=record.create_time,
                    data_size=len(record.data),
                    name=record.name,
                    media_type=record.media_type,
                )
                indexes[Opcode.ATTACHMENT_INDEX].append(index)
        elif isinstance(record, records.Metadata):
            start = len(out)
            out += _bytes(record, pad)
            if METADATA_INDEX in features:
                indexes[Opcode.METADATA_INDEX].append(records.MetadataIndex(start, len(out) - start, record.name))
        elif CHUNKS in features:
            if isinstance(record, records.Channel):
                places[record.id] = []
            elif isinstance(record, records.Message):
                places[record.channel_id].append((record.log_time, len(chunk)))
            chunk += _bytes(record)
        else:
            out += _bytes(record, pad)
    times = [record.log_time for record in content if isinstance(record, records.Message)]
    first, last = (min(times), max(times)) if times else (0, 0)
    if CHUNKS in features:
        start = len(out)
        data = bytes(chunk)
        out += _bytes(records.Chunk("", data, last, first, zlib.crc32(data), len(data)))
        after, offsets = len(out), {}
        for channel, entries in places.items() if MESSAGE_INDEX in features else ():
            offsets[channel] = len(out)
            out += _bytes(records.MessageIndex(channel, entries), pad)
        if CHUNK_INDEX in features:
            sizes = len(data), last, len(out) - after, offsets, first, len(data)
            indexes[Opcode.CHUNK_INDEX].append(records.ChunkIndex(after - start, start, "", *sizes))
    out += _bytes(records.DataEnd(zlib.crc32(out)))

    begin = len(out)
    if STATISTICS in features:
        kinds = Counter(type(record) for record in content)
        counts = Counter(record.channel_id for record in content if isinstance(record, records.Message))
        summary[Opcode.STATISTICS] = [
            records.Statistics(
                kinds[records.Attachment], kinds[records.Channel], dict(counts), int(CHUNKS in features),
                len(times), last, first, kinds[records.Metadata], kinds[records.Schema],
            )
        ]  # fmt: skip
    offsets_of = []
    for opcode, group in {**summary, **indexes}.items():
        start = len(out)
        for record in group:
            out += _bytes(record, pad)
        if group and SUMMARY_OFFSET in features:
            offsets_of.append(records.SummaryOffset(opcode, start, len(out) - start))
    start, offset_start = begin if len(out) > begin else 0, len(out) if SUMMARY_OFFSET in features else 0
    for offset in offsets_of:
        out += _bytes(offset, pad)
    head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start)
    out += _bytes(records.Footer(start, offset_start, zlib.crc32(head, zlib.crc32(out[begin:])))) + MAGIC
    return bytes(out)
