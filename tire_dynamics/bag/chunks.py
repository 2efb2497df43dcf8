"""Writes MCAP files chunk by chunk; messages come one by one or many at a time.

The file is the one that the mcap library's ``Writer`` makes, without what each message costs there: a chunk's
index is made from its bytes, by NumPy, when the chunk is finished.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Mapping, Sequence
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from .compression import compressor
from .record_types import (
    MAGIC,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Opcode,
    Schema,
    Statistics,
    SummaryOffset,
    bytes_of,
)  # fmt: skip

__all__ = ["HEAD", "ChunkWriter", "heads_at"]

# A message record up to its data: opcode and length of the content, then the content's fixed part.
HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
_HEAD = struct.Struct("<BQHIQQ")
_FIXED = HEAD.itemsize - 9  # bytes of the content before the data
_INDEX_ENTRY = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
_INDEX = struct.Struct("<BQHI")  # opcode, length, channel, bytes of entries
_FOOTER = struct.Struct("<BQQQ")  # opcode, length, summary start, summary offset start: what its CRC covers


def heads_at(data: bytes | bytearray, starts: NDArray[np.int64]) -> NDArray[np.void]:
    """The heads (``HEAD``) of the message records at ``starts``; each must fit."""
    if not len(starts):
        return np.empty(0, HEAD)
    everywhere = np.ndarray(len(data) - HEAD.itemsize + 1, f"V{HEAD.itemsize}", data, strides=(1,))
    return everywhere[starts].view(HEAD)


class ChunkWriter:
    """Writes one MCAP file; its methods are those of ``mcap.writer.Writer``, but for ``add_block``.

    Parameters
    ----------
    stream : binary file
        Where to write; it is not closed.
    chunk_size : int
        A chunk is finished by the message that makes it longer than this, in bytes.
    compression : str
        "zstd", "lz4" or "" for none.

    Once the disk has failed, nothing more is written: every call that would write raises its OSError again.
    """

    def __init__(self, stream: BinaryIO, chunk_size: int, compression: str) -> None:
        self._stream = stream
        self._chunk_size = chunk_size
        self._compression = compression
        self._compress = compressor(compression)
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        # What the summary says of each chunk and metadata record, as the bytes that it will be: they are many.
        self._chunk_indexes, self._metadata_indexes = bytearray(), bytearray()
        self._metadata_count = self._chunk_count = self._message_count = 0
        self._start_time = self._end_time = 0
        self._channel_counts: dict[int, int] = {}
        self._records = bytearray()  # of the chunk in the making
        self._starts = array("q")  # where its messages are
        self._failure: OSError | None = None

    def start(self, profile: str, library: str) -> None:
        """Begin the file."""
        self._stream.write(MAGIC + bytes_of(Header(profile, library)))

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Write a metadata record, before the chunk in the making."""
        record = bytes_of(Metadata(name, dict(data)))
        index = bytes_of(MetadataIndex(self._stream.tell(), len(record), name))
        self._stream.write(record)
        self._metadata_indexes += index
        self._metadata_count += 1

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a schema; its id, from 1."""
        schema = Schema(len(self._schemas) + 1, name, encoding, data)
        self._schemas.append(schema)
        self._records += bytes_of(schema)
        self._finish_full_chunk()
        return schema.id

    def register_channel(self, topic: str, message_encoding: str, schema_id: int, metadata: Mapping[str, str]) -> int:
        """Declare a channel; its id, from 1."""
        channel = Channel(len(self._channels) + 1, schema_id, topic, message_encoding, dict(metadata))
        self._channels.append(channel)
        self._records += bytes_of(channel)
        self._finish_full_chunk()
        return channel.id

    def add_message(self, channel_id: int, log_time: int, data: bytes, publish_time: int) -> None:
        """Write a message."""
        written = self._records
        start = len(written)
        # In one piece, so that an interrupt leaves no half of a record.
        written += _HEAD.pack(Opcode.MESSAGE, _FIXED + len(data), channel_id, 0, log_time, publish_time) + data
        self._starts.append(start)
        if len(written) > self._chunk_size:
            self._finish_chunk()

    def add_block(
        self,
        channels: NDArray[np.integer],
        log_times: NDArray[np.integer],
        publish_times: NDArray[np.integer],
        payloads: Sequence[bytes],
        sequences: NDArray[np.integer] | int = 0,
    ) -> None:
        """Write messages; with ``sequences`` 0 the file is the same as if each had gone through ``add_message``."""
        count = len(payloads)
        sizes = np.fromiter(map(len, payloads), np.int64, count)
        heads = np.zeros(count, HEAD)
        heads["opcode"], heads["length"] = Opcode.MESSAGE, _FIXED + sizes
        heads["channel"], heads["sequence"] = channels, sequences
        heads["log_time"], heads["publish_time"] = log_times, publish_times
        parts = [b""] * (2 * count)
        parts[::2] = heads.view(f"V{HEAD.itemsize}").tolist()
        parts[1::2] = payloads
        ends = np.cumsum(HEAD.itemsize + sizes)
        starts = ends - sizes - HEAD.itemsize
        first = 0
        while first < count:
            shift = len(self._records) - int(starts[first])  # from places in the block to places in the chunk
            last = int(np.searchsorted(ends, self._chunk_size - shift, "right")) + 1
            for part in parts[2 * first : 2 * last]:  # not joined first: one may be large
                self._records += part
            self._starts.frombytes((starts[first:last] + shift).tobytes())
            self._finish_full_chunk()
            first = last

    def add_records(self, records: bytes, starts: NDArray[np.int64]) -> None:
        """Write message records that lie one behind the other at ``starts``."""
        ends = np.append(starts[1:], len(records))
        view = memoryview(records)
        first = 0
        while first < len(starts):
            shift = len(self._records) - int(starts[first])  # from places among these to places in the chunk
            last = min(int(np.searchsorted(ends, self._chunk_size - shift, "right")) + 1, len(starts))
            self._records += view[int(starts[first]) : int(ends[last - 1])]
            self._starts.frombytes((starts[first:last] + shift).tobytes())
            self._finish_full_chunk()
            first = last

    def flush(self) -> None:
        """Finish the chunk and hand everything to the operating system. A chunk without messages waits."""
        self._finish_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Write the end of the file."""
        self._finish_chunk()
        self._stream.write(bytes_of(DataEnd(0)))
        start = self._stream.tell()
        statistics = Statistics(
            self._message_count, len(self._schemas), len(self._channels), 0, self._metadata_count, self._chunk_count,
            self._start_time, self._end_time, self._channel_counts,
        )  # fmt: skip
        groups: tuple[tuple[Opcode, bytes | bytearray], ...] = (
            (Opcode.SCHEMA, bytes_of(*self._schemas)),
            (Opcode.CHANNEL, bytes_of(*self._channels)),
            (Opcode.STATISTICS, bytes_of(statistics)),
            (Opcode.CHUNK_INDEX, self._chunk_indexes),
            (Opcode.ATTACHMENT_INDEX, b""),
            (Opcode.METADATA_INDEX, self._metadata_indexes),
        )
        place, crc = start, 0
        offsets = []
        for opcode, group in groups:
            offsets.append(SummaryOffset(opcode, place, len(group)))
            place += len(group)
            crc = zlib.crc32(group, crc)
            self._stream.write(group)
        end = bytes_of(*offsets)
        crc = zlib.crc32(_FOOTER.pack(Opcode.FOOTER, 8 + 8 + 4, start, place), zlib.crc32(end, crc))
        self._stream.write(end + bytes_of(Footer(start, place, crc)) + MAGIC)

    def _finish_full_chunk(self) -> None:
        if len(self._records) > self._chunk_size:
            self._finish_chunk()

    def _finish_chunk(self) -> None:
        if self._failure is not None:
            raise self._failure
        if not self._starts:
            return
        data, starts = self._records, np.frombuffer(self._starts, np.int64)
        self._records, self._starts = bytearray(), array("q")
        try:
            self._write_chunk(data, starts)
        except OSError as error:
            self._failure = error
            raise

    def _write_chunk(self, data: bytearray, starts: NDArray[np.int64]) -> None:
        heads = heads_at(data, starts)
        times = heads["log_time"]
        start, end = int(times.min()), int(times.max())
        stored = self._compress(data)
        chunk = bytes_of(Chunk(start, end, len(data), zlib.crc32(data), self._compression, stored))
        position = self._stream.tell()
        offsets, index, counts = _message_index(heads["channel"], times, starts, position + len(chunk))
        self._stream.write(chunk)
        self._stream.write(index)
        self._chunk_indexes += bytes_of(
            ChunkIndex(
                start, end, position, len(chunk), offsets, len(index), self._compression, len(stored), len(data)
            )
        )
        self._chunk_count += 1
        self._start_time = min(start, self._start_time) if self._message_count else start
        self._end_time = max(end, self._end_time)
        self._message_count += len(starts)
        for channel, count in counts.items():
            self._channel_counts[channel] = self._channel_counts.get(channel, 0) + count


def _message_index(
    channels: NDArray[Any], times: NDArray[Any], starts: NDArray[np.int64], position: int
) -> tuple[dict[int, int], bytes, dict[int, int]]:
    """A chunk's message index records, to stand at ``position``: where each channel's is, their bytes, its messages.

    The channels come in the order of their first messages.
    """
    order = np.argsort(channels, kind="stable")
    entries = np.empty(len(starts), _INDEX_ENTRY)
    entries["log_time"], entries["offset"] = times[order], starts[order]
    raw = memoryview(entries.tobytes())
    counts = np.bincount(channels)
    ends = _INDEX_ENTRY.itemsize * np.cumsum(counts)
    index = bytearray()
    offsets, messages = {}, {}
    for channel in dict.fromkeys(channels.tolist()):
        offsets[channel], messages[channel] = position + len(index), int(counts[channel])
        size = _INDEX_ENTRY.itemsize * messages[channel]
        end = int(ends[channel])
        index += _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size) + raw[end - size : end]
    return offsets, bytes(index), messages
