"""The live log: messages handed over to a thread of its own, which writes them to an MCAP bag."""

from __future__ import annotations

import errno
import math
import threading
import time
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from ..bag import BagWriter
from ..files.errors import InputError

__all__ = ["CHUNK_SIZE", "FLUSH_INTERVAL", "Log", "LogFiles", "Topics"]

FLUSH_INTERVAL = 0.5
"""Seconds between two flushes: with the time that one takes, what a killed process can lose."""

CHUNK_SIZE = 512 * 1024
"""Bytes of messages in a chunk at most, half a second of four wheels at 500 Hz: each costs the summary an entry."""

Topics = Mapping[str, tuple[str, str | Mapping[str, Any]]]
"""Message type and QoS profile, as :meth:`BagWriter.add_topic` takes it, by full topic name."""

_Message = tuple[str, int, int, bytes]  # topic, log time and publish time [ns], data

_PAUSE = 0.02  # [s] between two looks at what is waiting; to be woken by each message would cost more than to write it
_NOTHING = 100_000  # [bytes] of a file: declarations without messages
_PATIENCE = 30.0  # [s] that closing waits for the disk


class LogFiles:
    """What a live log writes: files of one bag, flushed every so often.

    It is told the time and reads no clock. What it keeps does not grow from file to file, and within a file by an entry
    of the summary for each chunk.

    Parameters
    ----------
    bag : BagWriter
        New, and in place.
    topics : mapping
        Message type and QoS profile by full topic name.
    max_size, max_duration : float
        Bytes and seconds after which the bag goes on in another file; infinite for never.
    now : float
        The time [s].
    definitions : mapping, optional
        Definitions of message types that are not in the common interfaces.

    Attributes
    ----------
    count : int
        How many files there are by now.
    """

    def __init__(
        self,
        bag: BagWriter,
        topics: Topics,
        max_size: float,
        max_duration: float,
        now: float,
        definitions: Mapping[str, str] | None = None,
    ) -> None:
        self.count = 1
        self._bag = bag
        texts = definitions or {}
        self._handles = {name: bag.add_topic(name, kind, qos, texts.get(kind)) for name, (kind, qos) in topics.items()}
        self._max_size, self._max_duration = max_size, max_duration
        self._full, self._due = now + max_duration, now + FLUSH_INTERVAL

    def write(self, batch: Sequence[_Message], now: float) -> bool:
        """Write messages, in another file if the present one is full; flush if it is time.

        Parameters
        ----------
        batch : sequence of tuple
            Full topic name, log time and publish time [ns], and the serialised message.
        now : float
            The time [s].

        Returns
        -------
        bool
            Whether these and all before have been flushed: they are read again even if the process is killed.

        Raises
        ------
        OSError
            The disk refuses them, or the file has been removed.
        """
        if batch:
            if now >= self._full or self._bag.size >= self._max_size:
                self._bag.split()
                self.count += 1
                self._full = now + self._max_duration
            topics, log_times, publish_times, payloads = zip(*batch, strict=True)
            self._bag.write_block([self._handles[topic] for topic in topics], log_times, publish_times, payloads)
        if now < self._due:
            return False
        self._bag.flush()
        if not self._bag.in_place:
            raise OSError(errno.ENOENT, "the file has been removed")
        self._due = now + FLUSH_INTERVAL
        return True


class Log:
    """A bag that is written behind the node's back.

    :meth:`put` never waits: it hands a message over, or drops and counts it when ``queue_size`` messages are
    waiting already. Everything that touches the disk, making the bag and finishing it included, happens on the
    log's own thread; nothing that the disk does can delay the caller. What the disk refuses ends the log, with
    the reason in ``error``; the caller goes on.

    Parameters
    ----------
    directory : Path
        Where the bag's folder is made, named after the time.
    topics : mapping
        Message type and QoS profile by full topic name.
    queue_size : int
    compression : {"zstd", "lz4", "none"}
    max_size, max_duration : float
        Bytes and seconds after which the bag goes on in another file; 0 for never.
    definitions : mapping, optional
        Definitions of message types that are not in the common interfaces.

    Attributes
    ----------
    folder : Path
        The bag.
    error : str or None
        Why the log ended, if it did.
    kept : bool
        Whether anything has reached the disk.
    files : int
        How many files there are by now.
    """

    def __init__(
        self,
        directory: Path,
        topics: Topics,
        queue_size: int,
        compression: str,
        max_size: float = 0.0,
        max_duration: float = 0.0,
        definitions: Mapping[str, str] | None = None,
    ) -> None:
        self.folder = directory / f"tire_dynamics_{datetime.now(timezone.utc):%Y_%m_%d-%H_%M_%S}"
        self.error: str | None = None
        self.written = 0
        self.kept = self._is_open = False
        self.files = 1
        self._max_size, self._max_duration = max_size or math.inf, max_duration or math.inf
        self._topics, self._definitions = dict(topics), dict(definitions or {})
        self._queue_size = queue_size
        self._compression = "" if compression == "none" else compression
        self._queue: deque[_Message] = deque()
        self._refused: Counter[str] = Counter()
        self._unsure: Counter[str] = Counter()  # handed to the bag since its last flush
        self._ending = threading.Event()
        self._opened = threading.Event()
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Messages handed over and not yet written."""
        return len(self._queue)

    @property
    def dropped(self) -> Counter[str]:
        """Messages that were not logged, by topic; of a log that has ended with an error, also those since the last
        flush, of which some may be in the file."""
        if self.error is None:
            return self._refused.copy()
        return self._refused + self._unsure + Counter(topic for topic, *_ in self._queue)

    def put(self, topic: str, log_time: int, publish_time: int, data: bytes) -> bool:
        """Hand a message over, times in ns; whether it was taken. Never waits."""
        if len(self._queue) >= self._queue_size or self.error is not None:
            self.drop(topic)
            return False
        self._queue.append((topic, log_time, publish_time, data))
        return True

    def drop(self, topic: str) -> None:
        """Count a message that is not logged."""
        self._refused[topic] += 1

    @property
    def has_room(self) -> bool:
        """Whether the queue has at least half of its places free, and the log goes on."""
        return self.error is None and len(self._queue) <= self._queue_size // 2

    def wait_until_open(self) -> None:
        """Wait for the bag to be made; ``InputError`` if it cannot be."""
        if not self._opened.wait(_PATIENCE):
            raise InputError(f"{self.folder}: the log could not be made within {_PATIENCE:g} s")
        if self.error is not None:
            raise InputError(self.error)

    @property
    def is_open(self) -> bool:
        """Whether the bag has been made; False as long as that goes on, and where it could not be."""
        return self._is_open

    def finish(self) -> None:
        """Ask the thread to write what is waiting and to finish the bag. Does not wait; no message may follow."""
        self._ending.set()

    @property
    def alive(self) -> bool:
        """Whether the thread still writes."""
        return self._thread.is_alive()

    def join(self) -> None:
        """Wait for the thread to end after :meth:`finish`."""
        self._thread.join(_PATIENCE)
        if self._thread.is_alive():
            self.error = f"{self.folder}: the disk took longer than {_PATIENCE:g} s; the log is not complete"

    def _run(self) -> None:
        try:
            self._writer = self._open()
            self._is_open = True
            self._opened.set()
            self._write(self._writer)
        except InputError as error:
            self.error = str(error)
        except OSError as error:
            self.error = f"{self.folder}: {error.strerror or error}"
        except Exception as error:  # a log that ends must say why, whatever it was
            self.error = " ".join(f"{self.folder}: {error}".split())
        finally:
            self._opened.set()
            if self.error is not None and not self.kept:
                self._remove_what_is_empty()

    def _remove_what_is_empty(self) -> None:
        """Take away the bag that was begun and has no message, lest a full disk be filled with such."""
        with suppress(OSError):
            for entry in list(self.folder.iterdir()):
                if entry.name.endswith(".mcap") and entry.stat().st_size < _NOTHING:
                    entry.unlink()
            self.folder.rmdir()

    def _open(self) -> BagWriter:
        wanted = self.folder
        for count in range(1, 1000):
            try:
                return BagWriter(self.folder, chunk_size=CHUNK_SIZE, compression=self._compression)
            except InputError:
                if not self.folder.exists():
                    raise
            self.folder = wanted.with_name(f"{wanted.name}_{count}")  # another log of the same second
        raise InputError(f"{wanted}: exists already, a thousand times")

    def _write(self, writer: BagWriter) -> None:
        with writer:
            files = LogFiles(
                writer, self._topics, self._max_size, self._max_duration, time.monotonic(), self._definitions
            )
            ending = False
            while not ending:
                ending = self._ending.wait(_PAUSE)  # asked before the last look: nothing is put behind it
                batch = [self._queue.popleft() for _ in range(len(self._queue))]
                self._unsure.update(topic for topic, *_ in batch)
                if files.write(batch, time.monotonic()):
                    self.kept = True
                    self._unsure.clear()
                self.written += len(batch)
                self.files = files.count
