"""The logs of a node, one after the other: each with what lets a replay go on, and another after an error."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

from ..cdr import messages
from ..replay.pipeline import LOG_RECORD, TF_STATIC, TICK, Pipeline
from .log import Log

__all__ = ["DIAGNOSTICS", "DIAGNOSTICS_TYPE", "Journal"]

DIAGNOSTICS: Final = "/diagnostics"
DIAGNOSTICS_TYPE: Final = "diagnostic_msgs/msg/DiagnosticArray"

_RETRY, _LONGEST_RETRY = 2.0, 60.0  # [s] between two attempts to go on with a log after an error


class Journal:
    """What a node logs, and where.

    Parameters
    ----------
    logger : rclpy logger
        Hears what happens to logs.
    now : callable
        The time [ns]; 0 before the clock has begun.

    Attributes
    ----------
    log : Log or None
        The one that is written.
    pipeline : Pipeline
        Whose messages these are; set before the first log.
    names : dict
        Full names of topics by their relative ones; likewise.
    qos : dict
        The QoS that topics were subscribed to or are offered with, as a bag says it, by their relative names; likewise.
    """

    pipeline: Pipeline
    names: Mapping[str, str]
    qos: Mapping[str, Mapping[str, Any]]

    def __init__(self, logger: Any, now: Callable[[], int]) -> None:
        self.log: Log | None = None
        self._logger = logger
        self._now = now
        self._finishing: list[Log] = []
        self._record_due = False
        self._files = 1
        self._trouble = ""  # what ended the last log, until another has reached the disk
        self._retry = 0.0  # when to try again after an error, on the monotonic clock
        self._pause = _RETRY
        self._dropped: Counter[str] = Counter()  # by the logs before this one
        self._said: Log | None = None  # of which it was said that it is open
        self._failed: Log | None = None  # of which it was said that it failed

    def start(self) -> Log:
        """Begin a log."""
        types = {
            **self.pipeline.inputs,
            **self.pipeline.outputs,
            TICK: messages.CLOCK,
            LOG_RECORD: messages.STRING,
            DIAGNOSTICS: DIAGNOSTICS_TYPE,
        }
        values = self.pipeline.values
        if values["tf.parent_frame"]:
            types[TF_STATIC] = messages.TF
        without = {TF_STATIC: "latched"}  # of what is in the log alone
        self.log = Log(
            Path(os.path.expanduser(values["log.directory"])),  # no shell does it behind `:=`
            {
                self.names[topic]: (msgtype, self.qos.get(topic, without.get(topic, "default")))
                for topic, msgtype in types.items()
            },
            values["log.queue_size"],
            values["log.compression"],
            1e6 * values["log.max_size_mb"],
            values["log.max_duration_s"],
            self.pipeline.definitions,
        )
        self._files = 1
        self.record()
        return self.log

    def record(self) -> None:
        """Log what a replay needs to go on from here; later, if the clock has not begun or there is no room."""
        now = self._now()
        self._record_due = True
        if self.log is not None and self.log.has_room and now:
            record = self.pipeline.record(self.names, self._dropped + self.log.dropped)
            self._record_due = not self.log.put(self.names[LOG_RECORD], now, now, record)
            if (transforms := self.pipeline.transforms(now)) is not None:
                self.log.put(TF_STATIC, now, now, transforms)

    def put(self, topic: str, log_time: int, publish_time: int, data: bytes) -> bool:
        """Log a message, whether it was taken; behind a gap, what a replay needs to go on first."""
        if self.log is None:
            return False
        name = self.names[topic]
        if self.log.files != self._files:  # each file can be replayed for itself
            self._files = self.log.files
            self._record_due = True
        if self._record_due:
            self.record()
        if self._record_due:
            self.log.drop(name)
        elif not self.log.put(name, log_time, publish_time, data):
            self._record_due = True  # a replay has to take up the thread behind the gap
        return not self._record_due

    def drop(self, topic: str) -> None:
        """Count a message that is not logged."""
        if self.log is not None:
            self.log.drop(self.names[topic])

    def update(self) -> None:
        """Say what has become of logs, and begin another one when the disk has refused one."""
        for log in [log for log in self._finishing if not log.alive]:
            self._finishing.remove(log)
            self._say_end(log)
        if self.log is not None and self.log.error is not None:
            self._say_end(self.log)
        elif self.log is not None and self.log.is_open and self.log is not self._said:
            self._said = self.log
            self._logger.info(f"log opened: {self.log.folder}")
        self._retry_if_due()

    def _say_end(self, log: Log) -> None:
        if log.error and log is not self._failed:
            self._failed = log
            self._logger.error(f"log failed: {log.error}")
        elif not log.error:
            self._logger.info(f"log closed: {log.folder}, {log.written} messages")

    def _retry_if_due(self) -> None:
        if self.log is None or self.log.error is None:
            if self.log is None or self.log.kept:
                self._pause, self._trouble = _RETRY, ""
            self._retry = time.monotonic() + self._pause
        elif not self.pipeline.values["log.directory"]:
            self.finish()
            self._logger.info("log.directory is empty: no other log is tried")
        elif time.monotonic() >= self._retry:
            self._trouble = self.log.error
            self.finish()
            self._logger.info(f"trying {self.start().folder}")
            self._pause = min(2.0 * self._pause, _LONGEST_RETRY)
            self._retry = time.monotonic() + self._pause

    def finish(self) -> None:
        """Let the log be closed, without waiting."""
        if self.log is not None:
            self._dropped += self.log.dropped
            self.log.finish()
            self._finishing.append(self.log)
            self.log = None

    def end(self) -> list[Log]:
        """Wait for all logs to be closed; those that were."""
        self.finish()
        ended, self._finishing = self._finishing, []
        for log in ended:
            log.join()
        return ended

    def close(self) -> None:
        """Wait for all logs to be closed, and say which were."""
        for log in self.end():
            self._say_end(log)

    def switch(self, on: bool) -> Callable[[], tuple[bool, str] | None]:
        """Start or stop logging; what tells whether that is done, and what was, or None as long as the disk works."""
        if not on:
            message = f"closing {self.log.folder}" if self.log is not None else "there was no log"
            self.finish()
            return lambda: (True, message)
        if self.log is not None and self.log.error is None:
            return partial(self._opened, self.log, "logging to {} already")
        if not self.pipeline.values["log.directory"]:
            return lambda: (False, "log.directory is empty; set it to say where logs are to be written")
        self.finish()
        return partial(self._opened, self.start(), "logging to {}")

    def _opened(self, log: Log, message: str) -> tuple[bool, str] | None:
        if log.is_open:
            return True, message.format(log.folder)
        if log.error is None and log is self.log:
            return None
        reason = log.error or f"{log.folder}: was to be closed before it was open"
        if log is self.log:  # who asked knows of it, and asks again
            self._say_end(log)
            self.finish()
        return False, reason

    def account(self) -> tuple[dict[str, Any], str, str]:
        """For the diagnostics: values, what ended the log, and what is missing in it."""
        log = self.log
        if log is None:
            return {"log": "off"}, "", ""
        dropped = self._dropped + log.dropped
        values = {
            "log": str(log.folder),
            "log: written": log.written,
            "log: waiting": log.waiting,
            "log: files": log.files,
            "log: dropped": sum(dropped.values()),
            **{f"log: dropped {topic}": count for topic, count in dropped.items()},
        }
        trouble = log.error or self._trouble
        missing = f"{sum(dropped.values())} messages not logged" if dropped else ""
        return values, f"the log stopped: {trouble}" if trouble else "", missing
