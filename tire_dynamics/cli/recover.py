"""``tire-dynamics recover``: a whole bag of what a truncated or damaged one still holds, and what was lost."""

from __future__ import annotations

import argparse
import os
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from ..bag import BagWriter
from ..bag.files import MCAP, ROS1, SQLITE, Unpacking, absent
from ..bag.records import ZSTD_MAGIC, DamageError, unpacked_message
from ..bag.salvage import Messages, Salvage
from ..bag.writer import check_replaceable, keep_apart
from ..files.errors import InputError, missing
from ..files.progress import progress
from .answer import answer

__all__ = ["Account", "recover", "run"]

_MAX_TOPICS = 4096
_MAX_GAPS = 1000  # that are listed
_LAST = np.uint64(2**63 - 1)  # ns; rosbag2's times are int64


@dataclass
class Account:
    """What was kept and what was lost.

    Attributes
    ----------
    kept : dict
        Messages by topic; every topic that is declared is there.
    expected : int or None
        How many messages the bag's own statistics count; None if a file has none.
    dropped : dict
        Messages in whole chunks that could not be kept, by reason.
    bytes, bytes_skipped, chunks_skipped : int
        Of all files: their size, what of it could not be used, and how many chunks that were.
    reasons : dict
        What was wrong, and how often.
    gaps : list of (float or None, float or None)
        Between which log times [s] messages may be missing, in the order of the files; None is the beginning or
        the end. At most 1000.
    gaps_beyond : int
        How many more there are.
    missing : list of str
        Files that ``metadata.yaml`` lists and that are not there.
    """

    kept: dict[str, int] = field(default_factory=dict)
    expected: int | None = 0
    dropped: Counter[str] = field(default_factory=Counter)
    bytes: int = 0
    bytes_skipped: int = 0
    chunks_skipped: int = 0
    reasons: Counter[str] = field(default_factory=Counter)
    gaps: list[tuple[float | None, float | None]] = field(default_factory=list)
    gaps_beyond: int = 0
    missing: list[str] = field(default_factory=list)

    @property
    def whole(self) -> bool:
        """Whether nothing was wrong."""
        return not (self.reasons or self.dropped or self.missing)


def recover(
    source: str | os.PathLike[str], output: str | os.PathLike[str], *, force: bool = False, quiet: bool = False
) -> Account:
    """Make a whole bag of what a truncated or damaged one holds.

    Topics, types, QoS and messages are copied as they are, the messages in the order of the files, with nothing
    taken from a chunk whose checksum is wrong. What rosbag2 has compressed by message or by file is decompressed;
    chunks are compressed anew. Memory holds a chunk or two, whatever the length of the bag.

    Parameters
    ----------
    source : path
        A ``.mcap`` file, or a folder: every ``.mcap`` file in it (``.mcap.zstd`` too), in the order of the numbers
        in their names. ``metadata.yaml`` is not needed; where there is one, files that it lists and that are not
        there are named. It is never changed.
    output : path
        The rosbag2 folder to write, with one file.
    force : bool
        Replace an output that exists and is a bag.
    quiet : bool
        Show no progress, not even on a terminal.

    Returns
    -------
    Account

    Raises
    ------
    InputError
        There is nothing to recover, or the output cannot be used.
    """
    source, output = Path(source), Path(output)
    files = _files(source)
    keep_apart(source, files, output)
    check_replaceable(output, force)  # now, not after a long search
    unpacking = Unpacking()
    account = Account(missing=absent(source) if source.is_dir() else [])
    salvages = []
    for path in files:
        place, damage = _unpacked(path, unpacking) if path.stat().st_size else (path, "")
        salvages.append(Salvage(path, place))
        if damage:
            account.reasons[damage] += 1
    with BagWriter(output, force=force, aside=True, chunk_size=2**20) as writer:
        recorder = _Recorder(writer, account, quiet)
        for salvage in salvages:
            recorder.copy(salvage)
        recorder.end()
        if account.reasons and not sum(account.kept.values()):
            why = account.reasons.most_common(1)[0][0]
            raise InputError(f"{source}: holds no message that can be recovered: {why}")
    return account


def _files(source: Path) -> list[Path]:
    if not source.exists():
        raise missing(source)
    files = [source]
    if source.is_dir():
        there = {path.name: path for path in source.iterdir()}
        found = [
            path
            for name, path in there.items()
            if name.endswith(".mcap") or (name.endswith(".mcap.zstd") and name.removesuffix(".zstd") not in there)
        ]
        files = sorted(found, key=lambda path: [(not part.isdecimal(), part.zfill(20)) for part in _parts(path)])
        if not files:
            others = sorted(path for name, path in there.items() if name.endswith((".db3", ".db3.zstd", ".bag")))
            if others:
                _refuse_storage(others[0], ROS1 if others[0].suffix == ".bag" else SQLITE)
            raise InputError(f"{source}: has no .mcap file; of a bag in a folder below, name that folder")
    for file in files:
        if not file.is_file():
            raise InputError(f"{file}: is not a file")
        if not file.stat().st_size and len(files) == 1:
            raise InputError(f"{file}: is empty")
    return files


def _unpacked(path: Path, unpacking: Unpacking) -> tuple[Path, str]:
    """Where the bytes of a file are, and what is wrong with its compression; one of another storage is refused."""
    try:
        found = unpacking.find(path)
    except InputError as error:
        if " is not an MCAP file" in str(error):
            return path, ""  # its first bytes may be what is damaged
        raise
    if found.kind != MCAP:
        _refuse_storage(path, found.kind)
    return found.place, found.damage


def _refuse_storage(path: Path, storage: str) -> NoReturn:
    raise InputError(
        f"{path}: its storage is {storage}, and only mcap can be recovered; info says whether it can be read as it is"
    )


def _parts(path: Path) -> list[str]:
    return re.split(r"(\d+)", path.name)


class _Recorder:
    """Copies files into a bag and keeps the account."""

    def __init__(self, writer: BagWriter, account: Account, quiet: bool) -> None:
        self._writer = writer
        self._quiet = quiet
        self._account = account
        self._topics: dict[str, tuple[tuple[str, str], int]] = {}  # to type and encoding, and handle
        self._cdr: dict[int, bool] = {}  # by handle
        self._metadata: list[tuple[str, dict[str, str]]] = []
        self._last: int | None = None  # log time of the last message that was kept
        self._gap: int | None = None  # log time before the loss that is being counted
        self._in_gap = False

    def copy(self, salvage: Salvage) -> None:
        """Everything that a file holds."""
        for name, content in salvage.metadata:
            if name != "rosbag2" and (name, content) not in self._metadata:  # rosbag2's describes the old file
                self._metadata.append((name, content))
                self._writer.add_metadata(name, content)
        handles: list[int] = []  # by the index of what is declared; 0 for what cannot be kept
        for piece in progress(salvage.pieces(), salvage.count, "recover", unit="chunks", quiet=self._quiet):
            if isinstance(piece, Messages):
                handles += [self._handle(salvage, index) for index in range(len(handles), len(salvage.declared))]
                self._write(piece, np.array([*handles, -1]))
            elif piece.messages:
                self._lose()
        for index in range(len(handles), len(salvage.declared)):  # topics without messages
            self._handle(salvage, index)
        if not salvage.closed:
            self._lose()
        account = self._account
        account.bytes += salvage.size
        account.bytes_skipped += salvage.bytes_lost
        account.chunks_skipped += salvage.chunks_lost
        account.reasons.update(salvage.reasons)
        if salvage.attachments:
            account.dropped["attachments, which are not copied"] += salvage.attachments
        known = account.expected is not None and salvage.expected is not None
        account.expected = (account.expected or 0) + (salvage.expected or 0) if known else None

    def end(self) -> None:
        """Close the account."""
        if self._in_gap:
            self._close_gap(None)

    def _handle(self, salvage: Salvage, index: int) -> int:
        declared = salvage.declared[index]
        kind = declared.msgtype, declared.encoding
        if declared.topic not in self._topics:
            if len(self._topics) == _MAX_TOPICS:
                raise InputError(f"{salvage.path}: declares more than {_MAX_TOPICS} topics")
            self._topics[declared.topic] = kind, (handle := self._writer.copy_topic(declared))
            self._cdr[handle] = declared.encoding == "cdr"
            self._account.kept[declared.topic] = 0
        known, handle = self._topics[declared.topic]
        return handle if known == kind else 0

    def _write(self, some: Messages, handles: NDArray[np.int64]) -> None:
        handle = handles[some.channel]
        late = (some.log_time > _LAST) | (some.publish_time > _LAST)
        for reason, places in (
            ("messages of channels that are not declared, or in two ways", handle == -1),
            ("messages of another type than their topic had before", handle == 0),
            ("messages from after the year 2262", (handle > 0) & late),
        ):
            if places.any():
                self._account.dropped[reason] += int(places.sum())
        keep = (handle > 0) & ~late
        bounds = zip(some.start.tolist(), (some.start + some.size).tolist(), keep.tolist(), strict=True)
        contents = [some.data[start:end] if kept else b"" for start, end, kept in bounds]
        for place, content in enumerate(contents):
            if content.startswith(ZSTD_MAGIC) and self._cdr[handle[place]]:
                try:
                    contents[place] = unpacked_message(content)
                except DamageError:
                    keep[place] = False
                    self._account.dropped["messages whose compression is damaged"] += 1
        if not keep.any():
            return
        log_time = some.log_time[keep].astype(np.int64)
        if self._in_gap:
            self._close_gap(int(log_time[0]))
        self._last = int(log_time[-1])
        payloads = [contents[place] for place in np.flatnonzero(keep).tolist()]
        publish_time = some.publish_time[keep].astype(np.int64)
        self._writer.write_block(handle[keep], log_time, publish_time, payloads, some.sequence[keep])
        counts = np.bincount(handle[keep], minlength=len(self._topics) + 1)
        for topic, (_, number) in self._topics.items():
            self._account.kept[topic] += int(counts[number])

    def _lose(self) -> None:
        if not self._in_gap:
            self._in_gap, self._gap = True, self._last

    def _close_gap(self, end: int | None) -> None:
        self._in_gap = False
        if len(self._account.gaps) == _MAX_GAPS:
            self._account.gaps_beyond += 1
        else:
            seconds = [None if time is None else time / 1e9 for time in (self._gap, end)]
            self._account.gaps.append((seconds[0], seconds[1]))


def run(options: argparse.Namespace) -> int:
    """Do what the command line asks for, and say on standard output what was kept and what was lost."""
    account = recover(options.input, options.output, force=options.force, quiet=options.quiet)
    if options.json:
        answer(options, {"input": options.input, "output": options.output, "whole": account.whole, **vars(account)})
    elif not options.quiet:
        for line in _lines(_printable(options.output), account):
            print(line)
    return 0


def _printable(text: str) -> str:
    return text if text.isprintable() and text.isascii() else ascii(text)


def _lines(output: str, account: Account) -> Iterator[str]:
    total = sum(account.kept.values())
    expected = "" if account.expected is None else f" of {account.expected}"
    yield f"{output}: {total}{expected} messages, {len(account.kept)} topics"
    for topic, count in account.kept.items():
        yield f"{count:>10} {_printable(topic)}"
    if account.whole:
        yield "nothing was lost"
        return
    for name in account.missing:
        yield f"missing: {_printable(name)}, which metadata.yaml lists"
    yield f"skipped: {account.bytes_skipped} of {account.bytes} bytes, {account.chunks_skipped} chunks"
    for what in (account.reasons, account.dropped):
        for reason, count in what.items():
            yield f"{count:>10} x {reason}"
    for start, end in account.gaps:
        begin = "the beginning" if start is None else f"{start:.6f} s"
        finish = "the end" if end is None else f"{end:.6f} s"
        yield f"messages may be missing from {begin} to {finish}"
    if account.gaps_beyond:
        yield f"and in {account.gaps_beyond} more places"
