"""Compressed bytes by packages and by the system's libraries: each reads what the other writes, and refuses alike."""

from __future__ import annotations

import os
import random
from ctypes.util import find_library

import lz4.frame
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from tire_dynamics.bag import compression
from tire_dynamics.bag.compression import CompressionError

pytestmark = pytest.mark.skipif(
    find_library("zstd") is None or find_library("lz4") is None,
    reason="this system has not the libraries libzstd and liblz4",
)

DATA = st.one_of(
    st.binary(max_size=2000),
    st.builds(lambda piece, times: piece * times, st.binary(min_size=1, max_size=30), st.integers(0, 9000)),
)


@pytest.fixture(scope="module")
def zstd():
    return compression._library(compression._Zstd)


@pytest.fixture(scope="module")
def lz4_library():
    return compression._library(compression._Lz4)


@given(DATA)
def test_each_reads_zstd_of_the_other(zstd, data):
    theirs = zstandard.ZstdCompressor(level=1).compress(data)
    assert zstandard.ZstdDecompressor().decompress(zstd.compress(data)) == data
    assert zstd.data(theirs, len(data)) == data
    assert zstd.data(theirs + b"more", len(data)) == data  # the first frame, as the package takes it
    assert zstd.size(theirs) == zstandard.frame_content_size(theirs) == len(data)


@pytest.mark.parametrize("by", ["package", "library"])
@given(
    more=st.integers(-3, 3),
    pieces=st.integers(1, 4),
    kind=st.sampled_from([bytes, bytearray]),
    repeated=st.integers(1, 2000),
    seed=st.integers(0, 2**32),
)
def test_a_frame_made_in_pieces_is_one(zstd, by, more, pieces, kind, repeated, seed):
    """It tells its size, as one that is made at once does, and takes no more room but for its blocks' heads."""
    size = pieces * compression._PIECE + more
    data = kind((random.Random(seed).randbytes(997 * repeated) * (1 + size // (997 * repeated)))[:size])
    compressor = zstandard.ZstdCompressor(level=compression._LEVEL)
    frame = compression._in_pieces(compressor if by == "package" else zstd, data)
    assert zstandard.frame_content_size(frame) == compression.zstd_size(frame) == size
    assert zstandard.ZstdDecompressor().decompress(frame) == zstd.data(frame, size) == data
    assert len(frame) <= 1.01 * len(compressor.compress(data)) + 64


@given(DATA)
def test_each_reads_lz4_of_the_other(lz4_library, data):
    theirs = lz4.frame.compress(data)
    assert lz4.frame.decompress(lz4_library.compress(bytearray(data))) == data
    assert lz4_library.data(theirs, len(data)) == data
    assert lz4_library.data(theirs, len(data) // 2) == data[: len(data) // 2]
    assert compression.lz4_data(theirs, len(data)) == data


@given(DATA, st.integers(1, 3000))
def test_a_stream_takes_pieces_and_ends_where_the_frame_does(zstd, data, size):
    frame = zstandard.ZstdCompressor().compress(data)
    packed = frame + b"behind"
    stream, found, place = zstd.stream(), b"", 0
    while not stream.eof:
        assert place < len(packed)
        found += stream.decompress(packed[place : place + size])
        place += size
    assert found == data
    assert stream.unused_data == packed[len(frame) : place]


def test_a_frame_that_does_not_say_its_size(zstd):
    writer = zstandard.ZstdCompressor(write_content_size=False)
    frame = writer.compress(bytes(1000))
    assert zstd.size(frame) == zstandard.frame_content_size(frame) == -1
    assert zstd.data(frame, 1000) == bytes(1000)
    with pytest.raises(CompressionError):
        zstd.data(frame, 999)


def test_what_claims_more_than_it_may_is_not_allocated(zstd):
    frame = bytearray(zstandard.ZstdCompressor().compress(bytes(100_000)))
    with pytest.raises(CompressionError, match="more than it should"):
        zstd.data(bytes(frame), 99_999)


@pytest.mark.parametrize("bad", [b"", b"xx", bytes(40), bytes(range(100))], ids=["empty", "short", "zeros", "random"])
def test_bytes_that_are_no_frame(zstd, lz4_library, bad):
    for read in (zstd.size, lambda data: zstd.data(data, 10**6), lambda data: compression.zstd_data(data, 10**6)):
        with pytest.raises(CompressionError):
            read(bad)
    for read in (lz4_library.data, compression.lz4_data):
        if len(bad) > 4:  # of less than a head comes nothing, which no chunk claims to hold
            with pytest.raises(CompressionError):
                read(bad, 1000)


@pytest.mark.parametrize("place", [6, 20, -5])
def test_a_frame_that_is_damaged_or_cut_off(zstd, lz4_library, place):
    data = os.urandom(400)
    packed = bytearray(zstandard.ZstdCompressor(write_checksum=True).compress(data))
    cut = bytes(packed[:place])
    packed[place] ^= 0xFF
    for bad in (bytes(packed), cut):
        with pytest.raises(CompressionError):
            zstd.data(bad, len(data))
    packed = bytearray(lz4.frame.compress(data, content_checksum=True))
    packed[place] ^= 0xFF
    with pytest.raises(CompressionError):
        lz4_library.data(bytes(packed), len(data))
