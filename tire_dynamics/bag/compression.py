"""zstd and LZ4 frames: by the packages zstandard and lz4, or where they are missing by the system's own libraries.

pip brings the packages. Among ROS's keys there are only those of the C libraries, which every Ubuntu has for itself.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from contextlib import contextmanager
from functools import cache, partial
from importlib import import_module
from typing import Any, Final

from ..files.errors import InputError

__all__ = ["ZSTD_MAGIC", "CompressionError", "ZstdStream", "compressor", "lz4_data", "zstd_data", "zstd_size"]

ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
"""How a zstd frame begins, and no serialised message does: the first byte of CDR is 0."""

_LEVEL = 1  # of zstd: on logs of the node 3, the usual one, saves another 1 % and takes half as long again or more
_UNKNOWN, _NONE = 2**64 - 1, 2**64 - 2  # sizes that a frame does not tell, or that there is no frame
_LZ4F_VERSION = 100
_PIECE = 128 * 1024  # [bytes] a block of zstd, 0.3 ms
_REST = 20e-6  # [s] behind each


class CompressionError(ValueError):
    """Bytes that are not what they should be compressed as."""


def compressor(name: str) -> Callable[[bytes | bytearray], bytes]:
    """What compresses chunks.

    Parameters
    ----------
    name : str
        "zstd", "lz4" or "" for none.

    Raises
    ------
    InputError
        There is no such library.
    """
    if name == "zstd":
        package = _package("zstandard")
        if package is not None:
            return partial(_in_pieces, package.ZstdCompressor(level=_LEVEL))
        return partial(_in_pieces, _library(_Zstd))
    if name == "lz4":
        package = _package("lz4.frame")
        if package is not None:
            compress: Callable[[bytes | bytearray], bytes] = package.compress
            return compress
        return _library(_Lz4).compress
    return bytes


def _in_pieces(compressor: Any, data: bytes | bytearray) -> bytes:
    """One frame of it all. Where that takes long, other threads have their turn in between: the one that ticks, say."""
    if len(data) <= _PIECE:
        whole: bytes = compressor.compress(data)
        return whole
    stream, view = compressor.compressobj(size=len(data)), memoryview(data)
    found = []
    for begin in range(0, len(data), _PIECE):
        found.append(stream.compress(view[begin : begin + _PIECE]))
        time.sleep(_REST)
    return b"".join([*found, stream.flush()])


def zstd_size(data: bytes | memoryview) -> int:
    """What the zstd frame at the beginning says it holds, in bytes; -1 if it does not say so."""
    package = _package("zstandard")
    if package is None:
        return _library(_Zstd).size(bytes(data))
    try:
        size: int = package.frame_content_size(data)
    except package.ZstdError as error:
        raise CompressionError(str(error)) from None
    return size


def zstd_data(data: bytes | memoryview, most: int) -> bytes:
    """What is in the zstd frame at the beginning; ``CompressionError`` if it is none, or it may hold more."""
    package = _package("zstandard")
    if package is None:
        return _library(_Zstd).data(bytes(data), most)
    try:
        found: bytes = package.ZstdDecompressor().decompress(data, max_output_size=most)
    except package.ZstdError as error:
        raise CompressionError(str(error)) from None
    return found


def lz4_data(data: bytes | memoryview, most: int) -> bytes:
    """What is in an LZ4 frame, of more than ``most`` bytes so many; ``CompressionError`` if it is none."""
    package = _package("lz4.frame")
    if package is None:
        return _library(_Lz4).data(bytes(data), most)
    try:
        found: bytes = package.LZ4FrameDecompressor().decompress(data, max_length=most)
    except RuntimeError as error:
        raise CompressionError(str(error)) from None
    return found


class ZstdStream:
    """Takes a zstd frame piece by piece.

    Attributes
    ----------
    eof : bool
        Whether the frame has ended.
    unused_data : bytes
        What of the last piece is behind its end.
    """

    def __init__(self) -> None:
        package = _package("zstandard")
        self._package = package
        self._stream: Any = _library(_Zstd).stream() if package is None else package.ZstdDecompressor().decompressobj()

    def decompress(self, piece: bytes) -> bytes:
        """What comes out of the next piece; ``CompressionError`` if it is damaged."""
        if self._package is None:
            out: bytes = self._stream.decompress(piece)
            return out
        try:
            out = self._stream.decompress(piece)
        except self._package.ZstdError as error:
            raise CompressionError(str(error)) from None
        return out

    @property
    def eof(self) -> bool:
        return bool(self._stream.eof)

    @property
    def unused_data(self) -> bytes:
        data: bytes = self._stream.unused_data
        return data


@cache
def _package(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        return None


# -- the system's libraries -------------------------------------------------------------------------------------------


@cache
def _library(kind: type[Any]) -> Any:
    try:
        return kind()
    except OSError:
        raise InputError(
            f"{kind.what} needs the package {kind.package} (pip install {kind.package}) or the library {kind.file}"
        ) from None


def _with_types(function: Any, result: Any, *arguments: Any) -> Any:
    function.restype, function.argtypes = result, arguments
    return function


_SIZE, _POINTER = ctypes.c_size_t, ctypes.c_void_p


class _Buffer(ctypes.Structure):
    """ZSTD_inBuffer and ZSTD_outBuffer."""

    _fields_ = [("data", _POINTER), ("size", _SIZE), ("position", _SIZE)]


class _Zstd:
    what, package, file = "zstd", "zstandard", "libzstd.so.1"

    def __init__(self) -> None:
        library = ctypes.CDLL(self.file)
        self._bound = _with_types(library.ZSTD_compressBound, _SIZE, _SIZE)
        self._compress = _with_types(library.ZSTD_compress, _SIZE, _POINTER, _SIZE, _POINTER, _SIZE, ctypes.c_int)
        self._decompress = _with_types(library.ZSTD_decompress, _SIZE, _POINTER, _SIZE, _POINTER, _SIZE)
        self._content_size = _with_types(library.ZSTD_getFrameContentSize, ctypes.c_ulonglong, _POINTER, _SIZE)
        self._frame_size = _with_types(library.ZSTD_findFrameCompressedSize, _SIZE, _POINTER, _SIZE)
        self._is_error = _with_types(library.ZSTD_isError, ctypes.c_uint, _SIZE)
        self._error = _with_types(library.ZSTD_getErrorName, ctypes.c_char_p, _SIZE)
        pointers = _POINTER, ctypes.POINTER(_Buffer), ctypes.POINTER(_Buffer)
        self.new_stream = _with_types(library.ZSTD_createDStream, _POINTER)
        self.free_stream = _with_types(library.ZSTD_freeDStream, _SIZE, _POINTER)
        self.step_stream = _with_types(library.ZSTD_decompressStream, _SIZE, *pointers)
        self.new_frame = _with_types(library.ZSTD_createCCtx, _POINTER)
        self.free_frame = _with_types(library.ZSTD_freeCCtx, _SIZE, _POINTER)
        self.set_parameter = _with_types(library.ZSTD_CCtx_setParameter, _SIZE, _POINTER, ctypes.c_int, ctypes.c_int)
        self.set_size = _with_types(library.ZSTD_CCtx_setPledgedSrcSize, _SIZE, _POINTER, ctypes.c_ulonglong)
        self.step_frame = _with_types(library.ZSTD_compressStream2, _SIZE, *pointers, ctypes.c_int)

    def checked(self, code: int) -> int:
        if self._is_error(code):
            raise CompressionError(self._error(code).decode())
        return code

    def compress(self, data: bytes | bytearray) -> bytes:
        source = bytes(data)
        out = ctypes.create_string_buffer(self._bound(len(source)))
        size = self.checked(self._compress(out, len(out), source, len(source), _LEVEL))
        return out.raw[:size]

    def compressobj(self, size: int) -> _ZstdLibraryFrame:
        return _ZstdLibraryFrame(self, size)

    def size(self, data: bytes) -> int:
        size: int = self._content_size(data, len(data))
        if size == _NONE:
            raise CompressionError("error when determining content size")
        return -1 if size == _UNKNOWN else size

    def data(self, data: bytes, most: int) -> bytes:
        length = self.checked(self._frame_size(data, len(data)))
        size = self.size(data)
        if size > most:
            raise CompressionError("it holds more than it should")
        out = ctypes.create_string_buffer(max(most if size < 0 else size, 1))
        written = self.checked(self._decompress(out, len(out), data, length))
        return out.raw[:written]

    def stream(self) -> _ZstdLibraryStream:
        return _ZstdLibraryStream(self)


class _ZstdLibraryFrame:
    """As zstandard's ``compressobj``."""

    _LEVEL_PARAMETER = 100  # ZSTD_c_compressionLevel
    _GO_ON, _END = 0, 2  # ZSTD_EndDirective

    def __init__(self, library: _Zstd, size: int) -> None:
        self._library = library
        self._frame = library.new_frame()
        self._out = ctypes.create_string_buffer(2**17)
        library.checked(library.set_parameter(self._frame, self._LEVEL_PARAMETER, _LEVEL))
        library.checked(library.set_size(self._frame, size))

    def compress(self, piece: bytes | memoryview) -> bytes:
        return self._step(bytes(piece), self._GO_ON)

    def flush(self) -> bytes:
        return self._step(b"", self._END)

    def _step(self, piece: bytes, directive: int) -> bytes:
        source = _Buffer(ctypes.cast(ctypes.c_char_p(piece), _POINTER), len(piece), 0)
        parts = []
        while True:
            out = _Buffer(ctypes.addressof(self._out), len(self._out), 0)
            step = self._library.step_frame(self._frame, ctypes.byref(out), ctypes.byref(source), directive)
            left = self._library.checked(step)
            parts.append(self._out.raw[: out.position])
            if source.position == len(piece) and (directive == self._GO_ON or not left):
                return b"".join(parts)

    def __del__(self) -> None:
        self._library.free_frame(self._frame)


class _ZstdLibraryStream:
    """As zstandard's ``decompressobj``."""

    def __init__(self, library: _Zstd) -> None:
        self._library = library
        self._stream = library.new_stream()
        self._out = ctypes.create_string_buffer(2**17)
        self.eof, self.unused_data = False, b""

    def decompress(self, piece: bytes) -> bytes:
        source = _Buffer(ctypes.cast(ctypes.c_char_p(piece), _POINTER), len(piece), 0)
        parts = []
        while not self.eof:
            out = _Buffer(ctypes.addressof(self._out), len(self._out), 0)
            step = self._library.step_stream(self._stream, ctypes.byref(out), ctypes.byref(source))
            left = self._library.checked(step)
            parts.append(self._out.raw[: out.position])
            self.eof = left == 0
            if source.position == len(piece) and out.position < len(self._out):
                break
        self.unused_data = piece[source.position :] if self.eof else b""
        return b"".join(parts)

    def __del__(self) -> None:
        self._library.free_stream(self._stream)


class _Lz4:
    what, package, file = "LZ4", "lz4", "liblz4.so.1"

    def __init__(self) -> None:
        library = ctypes.CDLL(self.file)
        self._bound = _with_types(library.LZ4F_compressFrameBound, _SIZE, _SIZE, _POINTER)
        self._compress = _with_types(library.LZ4F_compressFrame, _SIZE, _POINTER, _SIZE, _POINTER, _SIZE, _POINTER)
        self._is_error = _with_types(library.LZ4F_isError, ctypes.c_uint, _SIZE)
        self._error = _with_types(library.LZ4F_getErrorName, ctypes.c_char_p, _SIZE)
        make = library.LZ4F_createDecompressionContext
        self._new = _with_types(make, _SIZE, ctypes.POINTER(_POINTER), ctypes.c_uint)
        self._free = _with_types(library.LZ4F_freeDecompressionContext, _SIZE, _POINTER)
        sizes = ctypes.POINTER(_SIZE)
        self._step = _with_types(library.LZ4F_decompress, _SIZE, _POINTER, _POINTER, sizes, _POINTER, sizes, _POINTER)

    def _checked(self, code: int) -> int:
        if self._is_error(code):
            raise CompressionError(self._error(code).decode())
        return code

    def compress(self, data: bytes | bytearray) -> bytes:
        source = bytes(data)
        out = ctypes.create_string_buffer(self._bound(len(source), None))
        written = self._checked(self._compress(out, len(out), source, len(source), None))
        return out.raw[:written]

    @contextmanager
    def _context(self) -> Any:
        context = _POINTER()
        self._checked(self._new(ctypes.byref(context), _LZ4F_VERSION))
        try:
            yield context
        finally:
            self._free(context)

    def data(self, data: bytes, most: int) -> bytes:
        out = ctypes.create_string_buffer(max(most, 1))
        read = written = 0
        with self._context() as context:
            while read < len(data) and written < most:
                room, rest = _SIZE(most - written), _SIZE(len(data) - read)
                target = ctypes.addressof(out) + written
                source = ctypes.cast(ctypes.c_char_p(data[read:] if read else data), _POINTER)
                left = self._checked(self._step(context, target, room, source, rest, None))
                read, written = read + rest.value, written + room.value
                if not left:
                    break
        return out.raw[:written]
