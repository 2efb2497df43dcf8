"""Records of MCAP files: their layouts, and what may be believed of their lengths.

Every length is checked before it is believed.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import repeat
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..files.errors import InputError
from .chunks import HEAD
from .compression import ZSTD_MAGIC, CompressionError, lz4_data, zstd_data, zstd_size
from .record_types import DamageError, Opcode

__all__ = [
    "CHUNK", "DAMAGE", "DamageError", "MAX_CHUNK", "MAX_KEPT", "MAX_RECORD", "MESSAGE", "RECORD", "RUN", "ZSTD_MAGIC",
    "chunk_records", "exactly", "message_records", "one_line", "reading", "unpacked_message",
]  # fmt: skip

MAX_CHUNK = 32 * 2**20
"""Bytes of a chunk, uncompressed; recorders write some 1 MiB, and of one message what it takes."""

MAX_RECORD = 16 * 2**20
"""Bytes of a schema, channel, statistics or metadata record."""

MAX_KEPT = 64 * 2**20
"""Bytes of names, types and metadata records of a bag."""

RUN = 2**16
"""Bytes of messages outside chunks that are read together."""

RECORD = struct.Struct("<BQ")
"""Opcode, length of the content."""

MESSAGE = struct.Struct("<HIQQ")
"""Channel, sequence, log time, publish time."""

CHUNK = struct.Struct("<QQQII")
"""Start, end, uncompressed size, CRC, length of the compression's name."""

_MAX_CHUNK_RECORDS = 500_000
_LARGE_CHUNK, _MAX_RATIO = 16 * 2**20, 1000  # no recording of more than so many bytes is compressed so well
_STEP = 2**16  # records that are looked at together
_LENGTH = struct.Struct("<Q")


# What the libraries raise on bytes that are not what they are said to be.
DAMAGE = (
    ValueError,  # DamageError and UnicodeDecodeError among them
    struct.error,
    MemoryError,
    OverflowError,
)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except DAMAGE as error:
        raise InputError(f"{path}: damaged: {one_line(error)}") from None


def one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def exactly(file: BinaryIO, length: int, limit: int = MAX_CHUNK) -> bytes:
    if length > limit:
        raise DamageError(f"a record claims {length} bytes")
    data = file.read(length)
    if len(data) < length:
        raise DamageError("it ends in the middle of a record")
    return data


def message_records(data: bytes, in_chunk: bool) -> Iterator[tuple[NDArray[np.int64], list[tuple[int, int, int]]]]:
    """Where the message records are, and of every other record opcode, start and end of its content.

    They come in steps, so that a chunk of nothing but tiny records does not fill the memory.
    """
    count = 0
    octets = np.frombuffer(data, np.uint8)
    position, last = 0, len(data) - RECORD.size
    length_at = _LENGTH.unpack_from
    while position < len(data):
        starts = []
        for _ in repeat(None, _STEP):
            if position > last:
                break
            starts.append(position)
            position += RECORD.size + length_at(data, position + 1)[0]
        if position > len(data) or not starts:  # only the last record can reach beyond the data
            raise DamageError("a record does not fit")
        bounds = np.array([*starts, position])
        places = bounds[:-1]
        opcodes = octets[places]
        is_message = opcodes == Opcode.MESSAGE
        if (np.diff(bounds)[is_message] < HEAD.itemsize).any():
            raise DamageError("a record does not fit")
        if in_chunk and ((opcodes < Opcode.SCHEMA) | (opcodes > Opcode.MESSAGE)).any():
            raise DamageError("a chunk holds more than messages and what declares them")
        count += len(places)
        if count > _MAX_CHUNK_RECORDS:
            raise DamageError("a chunk holds too many records")
        others = np.flatnonzero(~is_message).tolist()
        yield places[is_message], [(data[starts[i]], starts[i] + RECORD.size, int(bounds[i + 1])) for i in others]


def chunk_records(content: memoryview) -> bytes:
    """The records in a chunk, given the chunk record's content."""
    _, _, size, crc, name_length = CHUNK.unpack_from(content)
    if size > MAX_CHUNK:
        raise DamageError(f"a chunk claims {size} bytes")
    position = CHUNK.size + name_length
    compression = bytes(content[CHUNK.size : position])
    length = int.from_bytes(content[position : position + 8], "little")
    stored = content[position + 8 : position + 8 + length]  # what is behind it, a later format may have appended
    if len(stored) < length:
        raise DamageError("a record does not fit")
    if size > max(_LARGE_CHUNK, _MAX_RATIO * len(stored)):
        raise DamageError(f"a chunk claims {size} bytes in {len(stored)}")
    try:
        if compression == b"":
            data = bytes(stored)
        elif compression == b"zstd":
            # The library would allocate what the frame claims.
            if zstd_size(stored) not in (size, -1):
                raise DamageError("a chunk has another size than it claims")
            data = zstd_data(stored, size)
        elif compression == b"lz4":
            data = lz4_data(stored, size)
        else:
            raise DamageError(f"a chunk's compression {compression[:20]!r} is not known")
    except CompressionError as error:
        raise DamageError(f"a chunk cannot be decompressed: {error}") from None
    if len(data) != size:
        raise DamageError("a chunk has another size than it claims")
    if crc and zlib.crc32(data) != crc:
        raise DamageError("a chunk does not match its checksum")
    return data


def unpacked_message(data: bytes) -> bytes:
    """A message that rosbag2 has compressed by itself (``compression_mode: message``); ``DamageError`` if it cannot."""
    try:
        size = zstd_size(data)
    except CompressionError as error:
        raise DamageError(f"a message cannot be decompressed: {one_line(error)}") from None
    if size > max(_LARGE_CHUNK, _MAX_RATIO * len(data)) or size > MAX_CHUNK:
        raise DamageError(f"a message claims {size} bytes in {len(data)}")
    try:
        return zstd_data(data, size if size >= 0 else MAX_CHUNK)
    except CompressionError as error:
        raise DamageError(f"a message cannot be decompressed: {one_line(error)}") from None
