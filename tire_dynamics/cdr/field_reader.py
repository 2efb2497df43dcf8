# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Fields of serialised messages of any type, read by the plans of ``field_plan``."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence

import numpy as np

from . import field_plan
from .field_plan import FieldPlan

try:
    import cython
except ImportError:
    from ..science import cython_stand_in as cython
if cython.compiled:
    from cython.cimports.libc.string import memcmp, memcpy

__all__ = ["FieldReader", "ends"]

_BODY = cython.declare(cython.Py_ssize_t, 4)  # the body, and with it all alignment, starts behind the encapsulation
_SECOND = cython.declare(cython.longlong, 1_000_000_000)
_LATEST = cython.declare(cython.longlong, 2**31 * 1_000_000_000)  # [ns], the end of ROS time
_SKIP = cython.declare(cython.longlong, field_plan.SKIP)
_READ = cython.declare(cython.longlong, field_plan.READ)
_TEXT = cython.declare(cython.longlong, field_plan.TEXT)
_OVER = cython.declare(cython.longlong, field_plan.OVER)
_SEQ = cython.declare(cython.longlong, field_plan.SEQ)
_LOOP = cython.declare(cython.longlong, field_plan.LOOP)
_NAMES = cython.declare(cython.longlong, field_plan.NAMES)
_BY_NAME = cython.declare(cython.longlong, field_plan.BY_NAME)
_TIME = cython.declare(cython.longlong, field_plan.TIME)
_MOST_LATE = cython.declare(cython.Py_ssize_t, 32)  # arrays of one message that are read by name


@cython.cclass
class FieldReader:
    """Reads the messages of some topics, each by its plan.

    Parameters
    ----------
    plans : sequence of FieldPlan
        Their slots are of one row of numbers for all: no two have one in common.

    Attributes
    ----------
    count : int
        How many plans.
    values : memoryview of double
        By slot, what the last message had there.
    found : memoryview of unsigned char
        By slot, whether it had anything there.
    stamp : int
        Of the last message [ns], if it ``has_stamp``.
    read_count : int
        Values that the last message had.
    """

    def __init__(self, plans: Sequence[FieldPlan]) -> None:
        self.count = len(plans)
        slots = max((plan.slots for plan in plans), default=0)
        self.values, self.found = np.zeros(slots + 1).data, np.zeros(slots + 1, dtype=np.uint8).data
        rows = [row for plan in plans for row in plan.steps]
        self.begin = ends([len(plan.steps) for plan in plans])
        # rows refer to places in tables that now lie one behind the other
        moved, table, end = [], list[int](), 0
        for plan in plans:
            for op, a, b, c in plan.steps:
                if op in (field_plan.READ, field_plan.SEQ, field_plan.BY_NAME):
                    b += len(table)
                elif op == field_plan.LOOP:
                    b += end
                moved.append((op, a, b, c))
            table += plan.table
            end += len(plan.steps)
        assert len(moved) == len(rows)
        self.steps = np.array(moved or [(0, 0, 0, 0)], dtype=np.int64).reshape(-1).data
        self.table = np.array(table or [0], dtype=np.int64).data
        self.required = np.array([plan.required for plan in plans] or [0], dtype=np.int64).data
        own = [sorted(set(plan.table[1::2])) for plan in plans]
        self.slots = np.array(
            [bound for some in own for bound in ((min(some), max(some) + 1) if some else (0, 0))] or [0], dtype=np.int64
        ).data
        self._names = [tuple(plan.names) for plan in plans]
        self.name_begin = ends([len(names) for names in self._names])
        self.place = np.full(max(self.name_begin[len(plans)], 1), -1, dtype=np.int64).data
        self._blocks = [b""] * len(plans)  # the bytes of the names that are known
        self.counts = np.zeros(max(len(plans), 1), dtype=np.int64).data
        self.late = np.zeros(4 * 32, dtype=np.int64).data
        self._join()
        self.stamp, self.has_stamp, self.read_count = 0, False, 0
        self.swap, self.message, self.late_count, self.names_count, self.required_found = False, 0, 0, 0, 0

    def _join(self) -> None:
        self.known = memoryview(bytearray(b"".join(self._blocks) + b"\0"))
        self.known_begin = ends([len(block) for block in self._blocks])

    def read(self, number: int, data: bytes) -> bool:
        """Read a serialised message by a plan; whether it is what the plan is for."""
        if not 0 <= number < self.count:
            raise IndexError(f"number is {number}; it must be from 0 to {self.count - 1}")
        return self.take(number, data, 0, len(data)) > 0

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def take(
        self,
        number: cython.Py_ssize_t,
        data: cython.const[cython.uchar][::1],
        first: cython.Py_ssize_t,
        size: cython.Py_ssize_t,
    ) -> cython.int:
        """Read the message ``data[first : first + size]``; 0 if it is not what the plan is for."""
        k: cython.Py_ssize_t
        p: cython.Py_ssize_t
        at: cython.Py_ssize_t
        length: cython.Py_ssize_t
        place: cython.longlong
        kind: cython.longlong
        if size < _BODY or data[first] != 0 or data[first + 1] > 1:
            return 0
        self.swap = data[first + 1] == 0
        self.message = number
        self.has_stamp = False
        self.late_count = self.required_found = self.read_count = 0
        self.names_count = 0
        for k in range(self.slots[2 * number], self.slots[2 * number + 1]):
            self.found[k] = 0
        if self.run(self.begin[number], self.begin[number + 1], 0, data, first, _BODY, size) < 0:
            return 0
        for k in range(self.late_count):
            if self.late[4 * k + 1] != self.names_count:  # not one for each name
                continue
            at, kind = self.late[4 * k], self.steps[4 * self.late[4 * k + 2] + 1]
            length = _size_of(kind)
            for p in range(self.steps[4 * self.late[4 * k + 2] + 3]):
                place = self.table[self.steps[4 * self.late[4 * k + 2] + 2] + 2 * p]
                place = self.place[self.name_begin[number] + place]
                if place >= 0:
                    self.put(
                        self.table[self.steps[4 * self.late[4 * k + 2] + 2] + 2 * p + 1],
                        self.number(kind, data, at + length * place),
                        False,
                    )
        return self.required_found >= self.required[number]

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def put(self, slot: cython.longlong, value: cython.double, is_required: cython.bint) -> cython.void:
        self.values[slot] = value
        self.found[slot] = 1
        self.read_count += 1
        if is_required:
            self.required_found += 1

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def run(
        self,
        row: cython.Py_ssize_t,
        end: cython.Py_ssize_t,
        element: cython.longlong,
        data: cython.const[cython.uchar][::1],
        first: cython.Py_ssize_t,
        at: cython.Py_ssize_t,
        size: cython.Py_ssize_t,
    ) -> cython.Py_ssize_t:
        """Follow some rows from a place in the message on; the place behind them, -1 if it does not reach so far."""
        op: cython.longlong
        a: cython.longlong
        b: cython.longlong
        c: cython.longlong
        k: cython.longlong
        _: cython.longlong
        count: cython.longlong
        length: cython.longlong
        p: cython.Py_ssize_t
        value: cython.double
        while row < end:
            op, a = self.steps[4 * row], self.steps[4 * row + 1]
            b, c = self.steps[4 * row + 2], self.steps[4 * row + 3]
            if op == _SKIP:
                at += (_BODY - at) & (a - 1)
                at += b
                if at > size:
                    return -1
            elif op == _READ:
                length = _size_of(a)
                at += (_BODY - at) & (length - 1)
                if at + length > size:
                    return -1
                for p in range(c):
                    if self.table[b + 2 * p] == element:
                        self.put(self.table[b + 2 * p + 1], self.number(a, data, first + at), True)
                at += length
            elif op == _TEXT:
                count = a if a > 0 else 1
                if a < 0:
                    at += (_BODY - at) & 3
                    if at + 4 > size:
                        return -1
                    count = self.integer(4, False, data, first + at)
                    at += 4
                for _ in range(count):
                    at += (_BODY - at) & 3
                    if at + 4 > size:
                        return -1
                    length = self.integer(4, False, data, first + at)
                    if length > size - at - 4:
                        return -1
                    at += 4 + length
            elif op == _OVER or op == _SEQ or op == _BY_NAME:
                length = a if op == _OVER else _size_of(a)
                at += (_BODY - at) & 3
                if at + 4 > size:
                    return -1
                count = self.integer(4, False, data, first + at)
                at += 4
                if count > 0:  # an empty sequence has no first element to align
                    at += (_BODY - at) & (length - 1)
                if count * length > size - at:
                    return -1
                if op == _SEQ:
                    for p in range(c):
                        k = self.table[b + 2 * p]
                        if k < count:
                            self.put(self.table[b + 2 * p + 1], self.number(a, data, first + at + length * k), True)
                elif op == _BY_NAME and self.late_count < _MOST_LATE:
                    self.late[4 * self.late_count] = first + at
                    self.late[4 * self.late_count + 1] = count
                    self.late[4 * self.late_count + 2] = row
                    self.late_count += 1
                at += count * length
            elif op == _LOOP:
                count = a
                if a < 0:
                    at += (_BODY - at) & 3
                    if at + 4 > size:
                        return -1
                    count = self.integer(4, False, data, first + at)
                    at += 4
                if count > size - at:  # each takes a byte at least
                    return -1
                for k in range(count):
                    at = self.run(row + 1, b, k, data, first, at, size)
                    if at < 0:
                        return -1
                row = b - 1
            elif op == _NAMES:
                at = self.over_names(data, first, at, size, a)
                if at < 0:
                    return -1
            elif op == _TIME:
                at += (_BODY - at) & 3
                if at + 8 > size:
                    return -1
                k = self.integer(4, False, data, first + at + 4)
                if k >= _SECOND:
                    return -1
                self.stamp = self.integer(4, True, data, first + at) * _SECOND + k
                self.has_stamp = True
                at += 8
            else:  # the stamp, as a number
                length = _size_of(a)
                at += (_BODY - at) & (length - 1)
                if at + length > size:
                    return -1
                if c:
                    value = self.number(a, data, first + at) * b
                    if not -_LATEST < value < _LATEST:
                        return -1
                    self.stamp = cython.cast(cython.longlong, value) if cython.compiled else int(value)
                else:
                    k = self.integer(length, a == 1 or a == 2 or a == 4 or a == 6, data, first + at)
                    if k > _LATEST // b or k < -(_LATEST // b):
                        return -1
                    self.stamp = k * b
                self.has_stamp = True
                at += length
            row += 1
        return at

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def over_names(
        self,
        data: cython.const[cython.uchar][::1],
        first: cython.Py_ssize_t,
        at: cython.Py_ssize_t,
        size: cython.Py_ssize_t,
        count: cython.longlong,
    ) -> cython.Py_ssize_t:
        """Go over names; a sender sends the same every time: their bytes are kept, and read when they differ."""
        length: cython.Py_ssize_t
        known: cython.Py_ssize_t = self.known_begin[self.message]
        at += (_BODY - at) & 3
        length = self.known_begin[self.message + 1] - known
        if at + length > size or not same_bytes(data, first + at, self.known, known, length):
            with cython.gil:
                if not self._learn(bytes(data[first + at : first + size]), count):
                    return -1
            length = self.known_begin[self.message + 1] - self.known_begin[self.message]
        self.names_count = self.counts[self.message]
        return at + length

    def _learn(self, data: bytes, count: int) -> bool:
        """Names at the beginning of some bytes, which are aligned; whether they can be read."""
        order = ">" if self.swap else "<"
        end = 0
        if count < 0:
            if len(data) < 4:
                return False
            count, end = struct.unpack_from(f"{order}I", data)[0], 4
        names = []
        if count > len(data):
            return False
        for _ in range(count):
            end += -end & 3
            if end + 4 > len(data):
                return False
            (length,) = struct.unpack_from(f"{order}I", data, end)
            end += 4
            if length > len(data) - end:
                return False
            names.append(data[end : end + length].rstrip(b"\0").decode("utf-8", "replace"))
            end += length
        self._blocks[self.message], self.counts[self.message] = data[:end], len(names)
        for k, name in enumerate(self._names[self.message]):
            self.place[self.name_begin[self.message] + k] = names.index(name) if name in names else -1
        self._join()
        return True

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def integer(
        self,
        size: cython.Py_ssize_t,
        is_signed: cython.bint,
        data: cython.const[cython.uchar][::1],
        at: cython.Py_ssize_t,
    ) -> cython.longlong:
        """An integer; of uint64, those beyond int64 are negative."""
        if cython.compiled:
            value: cython.ulonglong = 0
            k: cython.Py_ssize_t
            if self.swap:
                for k in range(size):
                    value = (value << 8) | data[at + k]
            else:
                for k in range(size):
                    value = value | (cython.cast(cython.ulonglong, data[at + k]) << (8 * k))
            if is_signed and size < 8 and value >> (8 * size - 1):
                value = value - (cython.cast(cython.ulonglong, 1) << (8 * size))
            return cython.cast(cython.longlong, value)
        else:
            number = int.from_bytes(data[at : at + size], "big" if self.swap else "little", signed=is_signed)
            return number - 2**64 if number >= 2**63 else number

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def number(
        self, kind: cython.longlong, data: cython.const[cython.uchar][::1], at: cython.Py_ssize_t
    ) -> cython.double:
        """A number of any kind."""
        if cython.compiled:
            whole: cython.longlong
            bits: cython.uint
            single: cython.float = 0.0
            value: cython.double = 0.0
            whole = self.integer(_size_of(kind), kind == 1 or kind == 2 or kind == 4 or kind == 6, data, at)
            if kind == 9:
                memcpy(cython.address(value), cython.address(whole), 8)
                return value
            if kind == 8:
                bits = cython.cast(cython.uint, whole)
                memcpy(cython.address(single), cython.address(bits), 4)
                return single
            if kind == 7:
                return cython.cast(cython.double, cython.cast(cython.ulonglong, whole))
            return cython.cast(cython.double, whole)
        else:
            form = "BbhHiIqQfd"[kind]
            return float(struct.unpack_from(f"{'>' if self.swap else '<'}{form}", data, at)[0])


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _size_of(kind: cython.longlong) -> cython.Py_ssize_t:
    """Bytes of a number, by the numbers of ``field_plan.KINDS``."""
    if kind < 2:
        return 1
    if kind < 4:
        return 2
    if kind < 6 or kind == 8:
        return 4
    return 8


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def same_bytes(
    data: cython.const[cython.uchar][::1],
    first: cython.Py_ssize_t,
    known: cython.uchar[::1],
    begin: cython.Py_ssize_t,
    size: cython.Py_ssize_t,
) -> cython.bint:
    """Whether bytes are those that are known; none are where none are known."""
    if size <= 0:
        return False
    if cython.compiled:
        return memcmp(cython.address(data[first]), cython.address(known[begin]), size) == 0
    else:
        return bool(data[first : first + size] == known[begin : begin + size])


def ends(sizes: Iterable[int]) -> memoryview:
    """Where each of some parts that lie one behind the other begins, and where the last ends."""
    return np.cumsum([0, *sizes]).astype(np.int64).data
