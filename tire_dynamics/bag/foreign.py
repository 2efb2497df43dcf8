"""Bags of other storages, their messages as those of an MCAP file: rosbag2's sqlite3 and ROS 1's.

rosbag2's tables are read by Python's own sqlite3: the rosbags library refuses a whole file for one type whose
definition its recorder did not know. ROS 1's bags are read by rosbags, which also writes their messages anew as CDR.
"""

from __future__ import annotations

import bz2
import sqlite3
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Any

from ..files.errors import InputError
from .compression import ZSTD_MAGIC, lz4_data
from .fields import OTHER_FIELDS, has_other_fields
from .files import Found
from .record_types import DamageError
from .records import DAMAGE, MAX_CHUNK, one_line, unpacked_message

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["ForeignFile", "Ros1File", "SqliteFile"]

Row = tuple[str, int, bytes]
"""Topic, log time [ns], serialised message (CDR)."""

_NO_TIME = 2**63 - 1  # of a file without messages
_MAX_DEFINITION = 2**20  # characters
_MAX_TOPICS = 65_535  # as many as an MCAP file can have
_MAX_ROS1_INDEX = 50_000_000  # messages; the library keeps the place of each in memory


class ForeignFile:
    """What is known of a file before its messages are read; the attributes are those of an MCAP file in the reader.

    Attributes
    ----------
    path : Path
    channels : dict of int to (str, str, str)
        Id to topic, message type and encoding.
    count : int
        Messages.
    counts : dict of int to int
        Messages by channel.
    start, end : int
        Log time of the first and the last message [ns].
    qos : dict of int to str
        By channel, as YAML.
    damage : str
    metadata, chunks, kept
        Empty: there is none.
    """

    def __init__(self, found: Found) -> None:
        self.path, self._place, self.damage = found.path, found.place, found.damage
        self.channels: dict[int, tuple[str, str, str]] = {}
        self.count, self.start, self.end = 0, _NO_TIME, 0
        self.counts: dict[int, int] = {}
        self.qos: dict[int, str] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.chunks: Counter[str] = Counter()
        self.kept = 0
        self._definitions: dict[str, str] = {}

    def definition(self, msgtype: str) -> str | None:
        """The definition of a type, if the file carries it."""
        return self._definitions.get(msgtype)

    def messages(self, topics: Collection[str] | None, in_file_order: bool) -> Iterator[Row]:
        """The messages of some topics, or all, by log time or as they were written.

        Raises
        ------
        InputError
            A wanted topic is not CDR, or the file turns out to be damaged.
        """
        raise NotImplementedError

    def _wanted(self, topics: Collection[str] | None) -> dict[int, str]:
        """Topic by channel."""
        wanted = {}
        for channel, (topic, _, encoding) in self.channels.items():
            if topics is not None and topic not in topics:
                continue
            if encoding != "cdr" and topics is not None:
                raise InputError(f"{self.path}: {topic} is encoded as {encoding!r}; only cdr is read")
            if encoding == "cdr":
                wanted[channel] = topic
        return wanted


# -- rosbag2's sqlite3 ------------------------------------------------------------------------------------------------


class SqliteFile(ForeignFile):
    """A file of rosbag2's sqlite3 storage, of any version.

    Parameters
    ----------
    found : Found

    Raises
    ------
    InputError
        It has not the tables of a bag, or cannot be read.
    """

    def __init__(self, found: Found) -> None:
        super().__init__(found)
        with self._reading() as database:
            for name in ("topics", "messages"):
                self._check_table(database, name)
            columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
            qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
            others = self._types_with_other_fields(database)
            rows = database.execute(f"SELECT id, name, type, serialization_format, {qos} FROM topics ORDER BY id")
            for channel, *texts in rows:
                if type(channel) is not int or not all(isinstance(text, str) for text in texts[:3]):
                    raise DamageError("its table of topics is not that of a bag")
                odd = texts[2] == "cdr" and texts[1] in others
                self.channels[channel] = texts[0], texts[1], OTHER_FIELDS if odd else texts[2]
                self.qos[channel] = texts[3] if isinstance(texts[3], str) else ""
                self.counts[channel] = 0
                if len(self.channels) > _MAX_TOPICS:
                    raise DamageError("it declares more topics than a bag needs")
            summary = "SELECT topic_id, count(*), min(timestamp), max(timestamp) FROM messages GROUP BY topic_id"
            for channel, count, first, last in database.execute(summary):
                if channel not in self.channels:
                    raise DamageError(f"topic {str(channel)[:20]} is not declared")
                if type(first) is not int or type(last) is not int or first < 0:
                    raise DamageError("a message has no time")
                self.counts[channel] = count
                self.count += count
                self.start, self.end = min(self.start, first), max(self.end, last)
            self._read_definitions(database)
        for ending in ("-wal", "-journal"):
            beside = self.path.with_name(self.path.name + ending)
            if beside.is_file() and beside.stat().st_size:
                self.damage = (
                    f"its recorder was stopped, and what is in {beside.name} is not read; "
                    f"sqlite3 {self.path.name} 'PRAGMA wal_checkpoint' puts it into the file"
                )

    def _types_with_other_fields(self, database: sqlite3.Connection) -> set[str]:
        """The types whose definition here, which recorders since Iron write, is not that of ROS."""
        name, columns = "message_definitions", ("topic_type", "encoding", "encoded_message_definition")
        if not {row[1] for row in database.execute(f"PRAGMA table_info({name})")}.issuperset(columns):
            return set()
        self._check_table(database, name)
        rows = database.execute(f"SELECT {', '.join(columns)} FROM {name} LIMIT 10000")
        texts = [(kind, text) for kind, how, text in rows if how == "ros2msg" and isinstance(text, str)]
        return {kind for kind, text in texts if isinstance(kind, str) and has_other_fields(kind, text)}

    def messages(self, topics: Collection[str] | None, in_file_order: bool) -> Iterator[Row]:
        """As of every file of a bag."""
        wanted = self._wanted(topics)
        if not wanted:
            return
        order = "id" if in_file_order else "timestamp, id"  # the index has them in this order
        places = ", ".join(map(str, wanted))
        query = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({places}) ORDER BY {order}"
        with self._reading() as database:
            for channel, time, data in database.execute(query):
                if type(time) is not int or time < 0 or not isinstance(data, bytes):
                    raise DamageError("a message has no time or no content")
                yield wanted[channel], time, unpacked_message(data) if data.startswith(ZSTD_MAGIC) else data

    def _read_definitions(self, database: sqlite3.Connection) -> None:
        """The definitions of messages, which recorders since Iron write."""
        if database.execute("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'").fetchone() is None:
            return
        self._check_table(database, "message_definitions")
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions LIMIT 10000"
        for name, encoding, text in database.execute(query):
            if (
                encoding == "ros2msg"
                and isinstance(name, str)
                and isinstance(text, str)
                and len(text) < _MAX_DEFINITION
            ):
                self._definitions.setdefault(name, text)

    @contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        """The database; errors become those of a bag. It is opened such that nothing is written beside it."""
        try:
            place = self._place.absolute().as_uri()
            with closing(sqlite3.connect(f"{place}?mode=ro&immutable=1", uri=True, check_same_thread=False)) as found:
                found.execute("PRAGMA trusted_schema = OFF")
                yield found
        except sqlite3.Error as error:
            raise InputError(f"{self.path}: damaged: {one_line(error)}") from None
        except DAMAGE as error:
            raise InputError(f"{self.path}: damaged: {one_line(error)}") from None

    def _check_table(self, database: sqlite3.Connection, name: str) -> None:
        """See that it is a plain table: a view may compute without an end."""
        row = database.execute("SELECT type, sql FROM sqlite_master WHERE name = ?", (name,)).fetchone()
        if row is None:
            raise InputError(f"{self.path}: is a SQLite file, but not a bag: it has no table of {name}")
        sql = f" {' '.join(str(row[1]).lower().split())} "
        if row[0] != "table" or not sql.startswith(" create table ") or " as " in sql.replace("(", " ("):
            raise InputError(f"{self.path}: is a SQLite file, but not a bag: {name} is no plain table")


# -- ROS 1 ------------------------------------------------------------------------------------------------------------


class Ros1File(ForeignFile):
    """A bag of ROS 1, its messages converted to CDR.

    A topic whose type ROS 2 has with other fields has the encoding ``ros1``, and is not read; so has one whose type
    cannot be made out.

    Parameters
    ----------
    found : Found

    Raises
    ------
    InputError
        It is damaged, or has no index.
    """

    def __init__(self, found: Found) -> None:
        super().__init__(found)
        self._store: Typestore | None = None
        with self._reading() as reader:
            if not reader.chunk_infos and self._place.stat().st_size > 2**14:
                raise DamageError("it has no index; rosbag reindex makes it readable")
            told: Counter[int] = Counter()
            for info in reader.chunk_infos:
                told.update(info.connection_counts)
                if info.connection_counts:
                    self.start, self.end = min(self.start, info.start_time), max(self.end, info.end_time - 1)
            store, known = _jazzy(), dict[tuple[str, str], bool]()
            for connection in reader.connections:
                kind, definition = connection.msgtype, connection.msgdef.data
                if (kind, definition) not in known:
                    known[kind, definition] = _has_layout(store, kind, definition)
                topic = f"/{connection.topic.lstrip('/')}"
                if known[kind, definition] and kind not in self._definitions:
                    self._definitions[kind] = store.generate_msgdef(kind, ros_version=2)[0]
                self.channels[connection.id] = topic, kind, "cdr" if known[kind, definition] else "ros1"
                self.counts[connection.id] = told[connection.id]
                latched = getattr(connection.ext, "latching", None)
                self.qos[connection.id] = _LATCHED if latched else ""
            self._store = store
        self.count = sum(self.counts.values())

    def messages(self, topics: Collection[str] | None, in_file_order: bool) -> Iterator[Row]:
        """As of every file of a bag; its order is that of log time in any case."""
        wanted = self._wanted(topics)
        if not wanted:
            return
        assert self._store is not None
        convert, kinds = self._store.ros1_to_cdr, {channel: kind for channel, (_, kind, _) in self.channels.items()}
        with self._reading() as reader:
            connections = [each for each in reader.connections if each.id in wanted]
            for connection, time, data in reader.messages(connections):
                yield wanted[connection.id], time, bytes(convert(data, kinds[connection.id]))

    @contextmanager
    def _reading(self) -> Iterator[Any]:
        try:
            from rosbags.rosbag1 import Reader
        except ImportError:
            raise InputError(f"{self.path}: a bag of ROS 1, which needs a package: pip install rosbags") from None

        class Bounded(Reader):
            """The library's reader, whose chunks may not become larger than a bag's."""

            def read_chunk(self) -> Any:
                chunk = super().read_chunk()
                return chunk._replace(decompressor=_bounded(chunk.decompressor))

        try:
            with Bounded(self._place) as reader:
                yield reader
        except (InputError, GeneratorExit):
            raise
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read: {error.strerror or error}") from None
        except Exception as error:  # whatever the library makes of bytes that are not what they are said to be
            said = one_line(error)
            if "reindex" in said:
                said = "it has no index, for its recorder was stopped; rosbag reindex makes it readable"
            raise InputError(f"{self.path}: damaged: {said}") from None


_LATCHED = (
    "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n  deadline: {sec: 0, nsec: 0}\n"
    "  lifespan: {sec: 0, nsec: 0}\n  liveliness: 1\n  liveliness_lease_duration: {sec: 0, nsec: 0}\n"
    "  avoid_ros_namespace_conventions: false\n"
)  # keep last 1, reliable, transient local: what ROS 2 has for a latched topic


def _bounded(decompress: Callable[[bytes], bytes]) -> Callable[[bytes], bytes]:
    """The same with an end to what a few bytes may become."""

    def bounded(data: bytes) -> bytes:
        most = 4 * MAX_CHUNK
        if decompress is bz2.decompress:
            result = bz2.BZ2Decompressor().decompress(data, most + 1)
        elif decompress.__module__.partition(".")[0] == "lz4":
            result = lz4_data(data, most + 1)
        else:
            return decompress(data)
        if len(result) > most:
            raise DamageError(f"a chunk claims more than {most} bytes")
        return result

    return bounded


def _jazzy() -> Typestore:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def _has_layout(store: Typestore, kind: str, definition: str) -> bool:
    """Whether a ROS 1 type has in ROS 2 the fields that its definition says, once what is new has been learnt."""
    from rosbags.typesys import get_types_from_msg

    try:
        types = get_types_from_msg(definition, kind)
        new = {name: fields for name, fields in types.items() if name not in store.fielddefs}
        for name, (_, fields) in types.items():
            # The header's sequence number is gone in ROS 2, which the library knows.
            if name not in new and name != "std_msgs/msg/Header":
                if [what for _, what in fields] != [what for _, what in store.fielddefs[name][1]]:
                    return False
        if new:
            store.register(new)
        store.get_msgdef(kind)
    except Exception:  # a definition that is none
        return False
    return kind in store.fielddefs
