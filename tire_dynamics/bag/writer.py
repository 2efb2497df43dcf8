"""Writes rosbag2 bags."""

from __future__ import annotations

import os
import re
import shutil
from array import array
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from itertools import zip_longest
from pathlib import Path
from textwrap import indent
from types import TracebackType
from typing import Any, BinaryIO

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from ..files.errors import InputError
from .chunks import ChunkWriter
from .definitions import declaration, type_hash
from .reader import yaml_texts
from .salvage import Declared

__all__ = ["BagWriter", "check_replaceable", "keep_apart", "remove_bag"]

_FOREVER = {"sec": 9223372036, "nsec": 854775807}
_QOS: dict[str, dict[str, Any]] = {
    name: {
        "history": "keep_last",
        "depth": depth,
        "reliability": reliability,
        "durability": durability,
        "deadline": dict(_FOREVER),
        "lifespan": dict(_FOREVER),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(_FOREVER),
        "avoid_ros_namespace_conventions": False,
    }
    for name, depth, reliability, durability in (
        ("default", 10, "reliable", "volatile"),
        ("sensor_data", 5, "best_effort", "volatile"),
        ("latched", 1, "reliable", "transient_local"),
    )
}
_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_MAX_QOS = 2**16  # characters
_NO_TIME = 2**63 - 1  # rosbag2's starting time of a bag without messages


class BagWriter:
    """Writes a rosbag2 folder: ``<folder>/<name of folder>_0.mcap`` and ``metadata.yaml``.

    A context manager. If its block raises, a bag written in place is closed with what it holds, and one
    written aside is thrown away.

    Parameters
    ----------
    folder : path
        The bag; its parents are made if missing.
    force : bool
        Replace ``folder`` if it exists and is a bag and nothing else. What else exists there is an error.
    aside : bool
        Write to a hidden folder beside ``folder`` and rename it when it is whole, so that ``folder`` is never
        half a bag. Without it the file grows in place, and what was flushed survives the process.
    chunk_size : int
        Bytes of messages that are compressed and written together. A small chunk is quickly done (well below
        1 ms for the default), a large one needs less index.
    compression : str
        "zstd", "lz4" or "" for none.
    metadata : mapping of str to mapping of str to str
        MCAP metadata records: name to content. They stand at the beginning of the file.

    Raises
    ------
    InputError
        If the folder exists (see ``force``) or cannot be made. Later, a disk that fails raises OSError.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        force: bool = False,
        aside: bool = False,
        chunk_size: int = 64 * 1024,
        compression: str = "zstd",
        metadata: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        self.folder = Path(folder)
        if self.folder.name in ("", ".."):
            self.folder = self.folder.resolve()
        self._force = force
        self._topics: dict[str, int] = {}
        self._topic_texts: list[str] = []  # what metadata.yaml says of each, made once: a file of a log begins quickly
        self._schemas: dict[str, int] = {}
        self._copied: dict[tuple[str, str, bytes], int] = {}
        self._declarations: list[tuple[str, tuple[Any, ...]]] = []  # for each further file
        self._counts: list[int] = []  # in the present file, as these
        self._start, self._end = _NO_TIME, 0
        self._finished = array("Q")  # of each file before: log times of its first and last message, number of messages
        self._finished_counts: list[int] = []  # in these, by topic
        self._options = chunk_size, compression

        name = self.folder.name
        if not name.isprintable():  # metadata.yaml must hold it, and its readers differ on the rest
            raise InputError(f"{self.folder}: a bag's name must be of letters that can be printed")
        check_replaceable(self.folder, force)
        self._work = self.folder.with_name(f".{name}.{os.urandom(4).hex()}") if aside else self.folder
        try:
            if not aside:
                remove_bag(self.folder)
            self._work.mkdir(parents=True)
            self._begin_file()
            for record, content in (metadata or {}).items():
                self._mcap.add_metadata(record, dict(content))
        except OSError as error:
            raise InputError(f"{self.folder}: cannot be written: {error.strerror}") from None
        except BaseException:  # an interrupt
            if aside:
                shutil.rmtree(self._work, ignore_errors=True)
            raise

    def _begin_file(self) -> None:
        self._file = open(self._work / self._file_name(len(self._finished) // 3), "xb")
        self._mcap = self._open_mcap(self._file, *self._options)
        self._mcap.start("ros2", "tire_dynamics")
        for method, arguments in self._declarations:
            getattr(self._mcap, method)(*arguments)

    def _file_name(self, number: int) -> str:
        return f"{self.folder.name}_{number}.mcap"

    def _declare(self, method: str, *arguments: Any) -> int:
        self._declarations.append((method, arguments))
        number: int = getattr(self._mcap, method)(*arguments)
        return number

    def _open_mcap(self, file: BinaryIO, chunk_size: int, compression: str) -> ChunkWriter:
        """What writes the MCAP file; the mcap library's ``Writer`` has the same methods, but for ``add_block``."""
        return ChunkWriter(file, chunk_size, compression)

    def add_topic(
        self, name: str, msgtype: str, qos: str | Mapping[str, Any] = "sensor_data", definition: str | None = None
    ) -> int:
        """Declare a topic.

        Parameters
        ----------
        name : str
            Absolute, such as "/front_left/load".
        msgtype : str
            Such as "geometry_msgs/msg/WrenchStamped"; any message of the ROS that is there, or that rosbags knows.
        qos : str or mapping
            The profile it is offered with: "sensor_data", "default" or "latched"; or every policy of it, as
            ``metadata.yaml`` has them.
        definition : str, optional
            Of a type that is not in the common interfaces, with those of all types in it.

        Returns
        -------
        int
            The topic's handle for ``write``.

        Raises
        ------
        InputError
            If the name is not a ROS topic name or the type is not known.
        """
        if not _TOPIC.fullmatch(name):
            raise InputError(f"{name!r} is not an absolute ROS topic name")
        if name in self._topics:
            raise ValueError(f"topic {name} is there already")
        declared = declaration(msgtype)
        if definition is not None:
            declared = definition.encode(), type_hash(msgtype, definition)
        if declared is None:
            raise InputError(f"{name}: message type {msgtype!r} is not known")
        text, description_hash = declared
        if msgtype not in self._schemas:
            self._schemas[msgtype] = self._declare("register_schema", msgtype, "ros2msg", text)
        profile = _QOS[qos] if isinstance(qos, str) else dict(qos)
        topic = {
            "name": name,
            "type": msgtype,
            "serialization_format": "cdr",
            "offered_qos_profiles": [profile],
            "type_description_hash": description_hash,
        }
        channel = {
            "offered_qos_profiles": _yaml([profile]),
            "topic_type_hash": topic["type_description_hash"],
        }
        self._topics[name] = self._declare("register_channel", name, "cdr", self._schemas[msgtype], channel)
        self._topic_texts.append(_yaml([{"topic_metadata": topic}]))
        self._counts.append(0)
        return self._topics[name]

    def copy_topic(self, declared: Declared) -> int:
        """Declare a topic as another file declares it, whatever its type; its handle for ``write_block``."""
        schema = declared.msgtype, declared.schema_encoding, declared.schema
        if schema not in self._copied:
            named = any(schema)  # a channel may have none, which is number 0
            self._copied[schema] = self._declare("register_schema", *schema) if named else 0
        metadata = dict(declared.metadata)
        handle = self._declare("register_channel", declared.topic, declared.encoding, self._copied[schema], metadata)
        topic = {
            "name": declared.topic,
            "type": declared.msgtype,
            "serialization_format": declared.encoding,
            "offered_qos_profiles": offered_qos(metadata.get("offered_qos_profiles", "")),
            "type_description_hash": metadata.get("topic_type_hash", ""),
        }
        self._topic_texts.append(_yaml([{"topic_metadata": topic}]))
        self._counts.append(0)
        return handle

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write an MCAP metadata record."""
        self._mcap.add_metadata(name, dict(content))

    def write(self, topic: int, log_time_ns: int, publish_time_ns: int, data: bytes) -> None:
        """Write one message.

        Parameters
        ----------
        topic : int
            What ``add_topic`` returned.
        log_time_ns, publish_time_ns : int
            When it was received and when it was sent, ns since the epoch, not negative.
        data : bytes
            The serialised message.
        """
        if log_time_ns < 0 or publish_time_ns < 0:
            raise ValueError(f"log_time_ns {log_time_ns}, publish_time_ns {publish_time_ns}: below 0")
        self._mcap.add_message(topic, log_time_ns, data, publish_time_ns)
        self._counts[topic - 1] += 1
        if log_time_ns < self._start:
            self._start = log_time_ns
        if log_time_ns > self._end:
            self._end = log_time_ns

    def write_block(
        self,
        topic: ArrayLike,
        log_time_ns: ArrayLike,
        publish_time_ns: ArrayLike,
        payloads: Sequence[bytes],
        sequence: ArrayLike = 0,
    ) -> None:
        """Write messages; the file is the same as if each had gone through ``write``, in a fraction of the time.

        Parameters
        ----------
        topic : (N,) or () array_like of int
            What ``add_topic`` returned.
        log_time_ns, publish_time_ns : (N,) or () array_like of int
            As for ``write``.
        payloads : sequence of N bytes
            The serialised messages.
        sequence : (N,) or () array_like of int
            The sender's numbers; 0 where it has none, as ``write`` has it.

        Raises
        ------
        ValueError
            If a time is negative, or a topic is none; nothing is written then.
        """
        if not payloads:
            return
        log_times, publish_times = np.asarray(log_time_ns, np.int64), np.asarray(publish_time_ns, np.int64)
        topics = np.broadcast_to(np.asarray(topic, np.int64), len(payloads))
        start, end = int(log_times.min()), int(log_times.max())
        if start < 0 or publish_times.min() < 0:
            raise ValueError(f"log_time_ns {start}, publish_time_ns {publish_times.min()}: below 0")
        counts = np.bincount(topics - 1, minlength=len(self._counts)).tolist()
        counts = [known + count for known, count in zip(self._counts, counts, strict=True)]
        self._mcap.add_block(topics, log_times, publish_times, payloads, np.asarray(sequence))
        self._counts = counts
        self._start, self._end = min(self._start, start), max(self._end, end)

    def write_records(
        self, records: bytes, starts: NDArray[np.int64], counts: Mapping[int, int], span: tuple[int, int]
    ) -> None:
        """Write messages that are records of an MCAP file already.

        Parameters
        ----------
        records : bytes
        starts : (N,) ndarray of int
            Where they are, one behind the other.
        counts : mapping
            How many there are of each topic, by what ``add_topic`` returned.
        span : tuple of int
            A log time [ns] that is not after any of theirs, and one that is not before any.
        """
        if span[0] < 0:
            raise ValueError(f"log_time_ns {span[0]}: below 0")
        if not starts.size:
            return
        self._mcap.add_records(records, starts)
        for topic, count in counts.items():
            self._counts[topic - 1] += count
        self._start, self._end = min(self._start, span[0]), max(self._end, span[1])

    def flush(self) -> None:
        """Finish the chunk and hand all that was written to the operating system.

        What is flushed is read again even if the process is killed. It does not wait for the disk (no fsync).
        """
        self._mcap.flush()

    @property
    def size(self) -> int:
        """Bytes in the present file, without those of the chunk in the making."""
        return self._file.tell()

    @property
    def in_place(self) -> bool:
        """Whether the present file still has its name, and has not been removed."""
        return os.fstat(self._file.fileno()).st_nlink > 0

    def split(self) -> None:
        """Go on in another file of the bag, ``<name of folder>_<number>.mcap``; the one before is whole."""
        self._finish_file()
        self._finished.extend((self._start, self._end, sum(self._counts)))
        self._finished_counts = self._all_counts()
        self._counts, self._start, self._end = [0] * len(self._counts), _NO_TIME, 0
        self._begin_file()

    def _all_counts(self) -> list[int]:
        return [before + now for before, now in zip_longest(self._finished_counts, self._counts, fillvalue=0)]

    def _finish_file(self) -> None:
        information = self._information(len(self._finished) // 3, self._counts)
        with self._file:
            self._mcap.add_metadata("rosbag2", {"serialized_metadata": information})
            self._mcap.finish()

    def close(self) -> None:
        """Write the index and ``metadata.yaml``, and put the folder in its place. Twice is harmless."""
        if self._file.closed:
            return
        self._finish_file()
        information = self._information(0, self._all_counts())
        text = "rosbag2_bagfile_information:\n" + indent(information, "  ")
        (self._work / "metadata.yaml").write_text(text, "utf-8")
        if self._work != self.folder:
            check_replaceable(self.folder, self._force)
            remove_bag(self.folder)
            self._work.rename(self.folder)

    def _information(self, first: int, counts: Sequence[int]) -> str:
        """``metadata.yaml``, version 9, keys in rosbag2's order: of the files from one on, with messages by topic."""
        spans = [*self._finished[3 * first :], self._start, self._end, sum(self._counts)]
        starts, ends, messages = spans[::3], spans[1::3], spans[2::3]
        names = [self._file_name(first + number) for number in range(len(starts))]
        files = [_span(*span) for span in zip(starts, ends, messages, strict=True)]
        head = {"version": 9, "storage_identifier": "mcap", **_span(min(starts), max(ends), sum(messages))}
        tail = {
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": names,
            "files": [{"path": name, **span} for name, span in zip(names, files, strict=True)],
            "custom_data": None,
            "ros_distro": "jazzy",
        }
        topics = "".join(
            f"{text}  message_count: {count}\n" for text, count in zip(self._topic_texts, counts, strict=True)
        )
        return f"{_yaml(head)}topics_with_message_count:{'' if topics else ' []'}\n{topics}{_yaml(tail)}"

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if error is None or self._work == self.folder:
                self.close()
        except OSError:
            if error is None:  # of two errors, the first is the one to report
                raise
        finally:
            if self._work != self.folder and self._work.exists():  # not in its place, so not whole
                with suppress(OSError):
                    self._file.close()
                shutil.rmtree(self._work, ignore_errors=True)


def _span(start: int, end: int, messages: int) -> dict[str, Any]:
    """What ``metadata.yaml`` says of a file or of the whole: log times of its first and last message, how many."""
    return {
        "duration": {"nanoseconds": max(0, end - start)},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": messages,
    }


class _PlainDumper(yaml.SafeDumper):
    """Writes no anchors: rosbag2's parser would read them, people would not."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _yaml(data: Any) -> str:
    return yaml.dump(data, Dumper=_PlainDumper, sort_keys=False)


# Of a QoS profile, in rosbag2's order: names by the numbers that recorders before Jazzy wrote.
_POLICIES = {
    "history": ("system_default", "keep_last", "keep_all", "unknown"),
    "reliability": ("system_default", "reliable", "best_effort", "unknown", "best_available"),
    "durability": ("system_default", "transient_local", "volatile", "unknown", "best_available"),
    "liveliness": ("system_default", "automatic", "manual_by_node", "manual_by_topic", "unknown", "best_available"),
}


def offered_qos(text: str) -> list[dict[str, Any]]:
    """The QoS profiles of a channel, as ``metadata.yaml`` has them; none if they cannot be made out.

    Parameters
    ----------
    text : str
        What a recorder wrote into the channel's metadata.
    """
    try:
        return [_qos_profile(profile) for profile in yaml_texts(text.encode())] if len(text) < _MAX_QOS else []
    except (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError):
        return []


def _qos_profile(profile: Mapping[str, Any]) -> dict[str, Any]:
    known: dict[str, Any] = {}
    for key in _QOS["default"]:
        value = profile[key]
        if key in _POLICIES:
            known[key] = _POLICIES[key][int(value)] if value.isdecimal() else value
            if known[key] not in _POLICIES[key]:
                raise ValueError
        elif key == "depth":
            known[key] = int(value)
        elif key == "avoid_ros_namespace_conventions":
            known[key] = {"true": True, "false": False}[value]
        else:
            known[key] = {part: int(value[part]) for part in ("sec", "nsec")}
    return known


def keep_apart(source: Path, files: Iterable[Path], output: Path) -> None:
    """See that nothing is written over what is read, or into it; ``InputError`` if it would be."""
    target = output.resolve()
    places = [path.resolve() for path in (source, *files)]
    if any(place == target or target in place.parents or place in target.parents for place in places):
        raise InputError(f"{output}: is where {source} is, and what is read is never changed; choose another output")


def check_replaceable(folder: Path, force: bool) -> None:
    """An output that exists is left alone, unless it may be replaced and is a bag and nothing else."""
    if not os.path.lexists(folder):
        return
    if not force:
        raise InputError(f"{folder}: exists already (--force replaces a bag)")
    if folder.is_symlink() or not (folder / "metadata.yaml").is_file():
        raise InputError(f"{folder}: exists and is not a bag, so it is not replaced; choose another output")
    for entry in os.scandir(folder):
        if not (entry.is_file(follow_symlinks=False) and _belongs_to_a_bag(entry.name)):
            raise InputError(
                f"{folder}: holds more than a bag ({entry.name}), so it is not replaced; choose another output"
            )


def _belongs_to_a_bag(name: str) -> bool:
    return name == "metadata.yaml" or name.endswith(".mcap")


def remove_bag(folder: Path) -> None:
    """Remove a folder that ``check_replaceable`` has passed, file by file: what it does not know stays."""
    if folder.is_dir():
        for name in os.listdir(folder):
            if _belongs_to_a_bag(name):
                (folder / name).unlink()
        folder.rmdir()
