"""The live log: messages handed over to a thread of its own, which writes them to an MCAP bag."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path
from queue import Empty, SimpleQueue

from .bag import BagWriter
from .errors import InputError

__all__ = ["Log"]

_FLUSH_INTERVAL = 1.0  # [s]: what a killed process can lose
_PATIENCE = 30.0  # [s] that closing waits for the disk


class Log:
    """A bag that is written behind the node's back.

    :meth:`put` never waits: it hands a message over, or drops and counts it when ``queue_size`` messages are
    waiting already. Nothing that the disk does can delay the caller. What the disk refuses ends the log, with
    the reason in ``error``; the caller goes on.

    Parameters
    ----------
    directory : Path
        Where the bag's folder is made, named after the node and the time.
    topics : mapping
        Message type and QoS profile by full topic name.
    queue_size : int
    compression : {"zstd", "lz4", "none"}

    Raises
    ------
    InputError
        The directory cannot be written.
    """

    def __init__(
        self, directory: Path, topics: Mapping[str, tuple[str, str]], queue_size: int, compression: str
    ) -> None:
        self.error: str | None = None
        self.dropped: Counter[str] = Counter()
        self.written = 0
        self._queue_size = queue_size
        self._queue: SimpleQueue[tuple[str, int, int, bytes] | None] = SimpleQueue()
        self.folder = _new_folder(directory)
        try:
            self._writer = BagWriter(self.folder, compression="" if compression == "none" else compression)
            self._handles = {
                name: self._writer.add_topic(name, msgtype, qos=qos) for name, (msgtype, qos) in topics.items()
            }
        except OSError as error:
            raise InputError(f"{self.folder}: {error.strerror}") from None
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Messages handed over and not yet written."""
        return self._queue.qsize()

    def put(self, topic: str, log_time: int, publish_time: int, data: bytes) -> None:
        """Hand a message over, times in ns; never waits."""
        if self._queue.qsize() >= self._queue_size or self.error is not None:
            self.dropped[topic] += 1
        else:
            self._queue.put((topic, log_time, publish_time, data))

    def close(self) -> None:
        """Write what is waiting, and finish the bag."""
        self._queue.put(None)
        self._thread.join(_PATIENCE)
        if self._thread.is_alive():
            self.error = f"{self.folder}: the disk took longer than {_PATIENCE:g} s; the log is not complete"

    def _run(self) -> None:
        try:
            self._write()
        except OSError as error:
            self.error = f"{self.folder}: {error.strerror or error}"
        while self.error is not None and self._queue.get() is not None:
            pass  # what had been handed over before the error was seen

    def _write(self) -> None:
        due = time.monotonic() + _FLUSH_INTERVAL
        with self._writer as writer:
            while True:
                try:
                    entry = self._queue.get(timeout=max(0.0, due - time.monotonic()))
                except Empty:
                    writer.flush()
                    due = time.monotonic() + _FLUSH_INTERVAL
                    continue
                if entry is None:
                    return
                topic, log_time, publish_time, data = entry
                writer.write(self._handles[topic], log_time, publish_time, data)
                self.written += 1
                if time.monotonic() >= due:
                    writer.flush()
                    due = time.monotonic() + _FLUSH_INTERVAL


def _new_folder(directory: Path) -> Path:
    name = f"tire_dynamics_{datetime.now(timezone.utc):%Y_%m_%d-%H_%M_%S}"
    folder, count = directory / name, 1
    while folder.exists():
        folder, count = directory / f"{name}_{count}", count + 1
    return folder
