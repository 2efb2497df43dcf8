"""Files from strangers: one clear line and status 2, or a part with a warning. No traceback, hang, flood, stray write.

Every command that reads a file is called as the command line calls it, and what it says and leaves behind is
checked. Work and memory are guarded: 10 s of processor time for a call, on a machine that needs 0.1 s for a million
turns of a loop, and 500 MB for a process.
"""

from __future__ import annotations

import functools
import io
import json
import os
import shutil
import signal
import stat
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

import lz4.frame
import pytest
import yaml
import zstandard
from examples import spared
from hypothesis import given, seed, settings
from hypothesis import strategies as st

from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.cdr import messages
from tire_dynamics.cdr.messages import JointStateEncoder, WrenchEncoder, encode_float64, encode_string
from tire_dynamics.cli.main import main
from tire_dynamics.cli.recover import recover
from tire_dynamics.files.errors import InputError

pytestmark = pytest.mark.slow

REPOSITORY = Path(__file__).parents[1]
COMMAND = [sys.executable, "-m", "tire_dynamics.cli.main"]
BEGIN = 1_700_000_000 * 10**9
TURNS, MEMORY = 100e6, 500_000_000  # of a loop, bytes: what any file may cost
PATIENCE = 300  # [s] after which a call hangs
MAGIC = b"\x89MCAP0\r\n"


@functools.cache
def turn() -> float:
    """Processor time of one turn of a loop on this machine [s]."""
    begin = time.process_time()
    sum(number * number for number in range(1_000_000))
    return (time.process_time() - begin) * 1e-6


@contextmanager
def patience():
    """Fails if its block hangs."""

    def late(number, frame):
        raise AssertionError(f"took longer than {PATIENCE} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(PATIENCE)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def within():
    """Fails if its block hangs, or takes too much of the processor."""
    begin = time.process_time()
    with patience():
        yield
    assert time.process_time() - begin < TURNS * turn()


SERVANT = """
import io, json, os, resource, sys, time
from contextlib import redirect_stderr, redirect_stdout
from tire_dynamics.cli.main import main

resource.setrlimit(resource.RLIMIT_AS, (4 * 2**30, 4 * 2**30))  # so that a flood is our trouble, not the machine's

def peak():
    return next(1024 * int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM"))

for line in sys.stdin:
    folder, *arguments = json.loads(line)
    os.chdir(folder)
    try:
        with open("/proc/self/clear_refs", "w") as file:
            file.write("5")  # forget the peak
    except OSError:
        pass  # then it is that of all calls
    begin = time.process_time()
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
        status = main([os.fsdecode(bytes.fromhex(argument)) for argument in arguments])
    print(json.dumps([status, out.getvalue(), err.getvalue(), time.process_time() - begin, peak()]), flush=True)
"""


class Servant:
    """A process that does what it is asked, call by call, so that memory is its own and a hang can be ended."""

    def __init__(self) -> None:
        self._process: subprocess.Popen | None = None
        self.most = 0  # bytes that a call took

    def __call__(self, *arguments) -> tuple[int, str, str]:
        if self._process is None:
            environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "OPENBLAS_NUM_THREADS": "1"}
            command = [sys.executable, "-c", SERVANT]
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
            )
        request = [os.getcwd(), *(os.fsencode(str(argument)).hex() for argument in arguments)]
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        try:
            with patience():
                answer = self._process.stdout.readline()
        except BaseException:
            self.end()
            raise
        if not answer:  # its traceback is on our standard error
            self.end()
            raise AssertionError(f"no answer to {arguments}")
        status, out, err, seconds, used = json.loads(answer)
        assert seconds < TURNS * turn(), f"{seconds:.1f} s of the processor for {arguments}"
        assert used < MEMORY, f"{used} bytes for {arguments}"
        self.most = max(self.most, used)
        return status, out, err

    def end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


in_a_process = Servant()


@pytest.fixture(scope="module", autouse=True)
def servant():
    yield
    in_a_process.end()


def refused(*arguments) -> str:
    """The one line with which a command refuses."""
    status, out, err = in_a_process(*arguments)
    assert status == 2, (status, err)
    assert out == "" and err.startswith("tire-dynamics: ") and err.count("\n") == 1, err
    assert len(err) < 2100 and "Traceback" not in err
    return err


def refused_or_partial(*arguments) -> int:
    """A line and status 2, or status 0 with what was wrong in at most a line before the summary's."""
    status, _, err = in_a_process(*arguments)
    assert status in (0, 2) and "Traceback" not in err, err
    assert err.count("\n") <= (1 if status else 2), err
    return status


def everything(folder: Path, but: str = "") -> dict[str, str]:
    """Every path below a folder, with what it holds."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if not (but and (name == but or name.startswith(f"{but}/"))):
            kind = stat.S_IFMT(path.lstat().st_mode)
            found[name] = path.read_bytes().hex() if kind == stat.S_IFREG and os.access(path, os.R_OK) else str(kind)
    return found


# --- files to begin with ---


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def chunk(data: bytes, compression: bytes = b"", size: int | None = None, crc: int | None = None) -> bytes:
    stored = {b"zstd": zstandard.compress, b"lz4": lz4.frame.compress}.get(compression, bytes)(data)
    size, crc = len(data) if size is None else size, zlib.crc32(data) if crc is None else crc
    head = struct.pack("<QQQI", BEGIN, BEGIN, size, crc) + text(compression)
    return record(6, head + struct.pack("<Q", len(stored)) + stored)


def schema(number: int, name: bytes, definition: bytes = b"") -> bytes:
    return record(3, struct.pack("<H", number) + text(name) + text(b"ros2msg") + text(definition))


def channel(number: int, schema_number: int, topic: bytes) -> bytes:
    return record(4, struct.pack("<HH", number, schema_number) + text(topic) + text(b"cdr") + text(b""))


def message(number: int, log_time: int, data: bytes) -> bytes:
    return record(5, struct.pack("<HIQQ", number, 0, log_time, log_time) + data)


def file_of(*parts: bytes) -> bytes:
    return MAGIC + record(1, text(b"ros2") + text(b"")) + b"".join(parts) + record(15, bytes(4))


LOAD, SPEED = messages.WRENCH_STAMPED.encode(), messages.FLOAT64.encode()
WHEEL = schema(1, LOAD) + schema(2, SPEED) + channel(1, 1, b"/w/load") + channel(2, 2, b"/w/wheel_speed")
wrench = WrenchEncoder("axle")


def driving(count: int = 20, begin: int = BEGIN) -> bytes:
    """Message records of a wheel that a replay has outputs for."""
    times = [begin + 10_000_000 * i for i in range(count)]
    return b"".join(message(2, t, encode_float64(50.0)) + message(1, t, wrench.encode(t, 0.0, 4e3)) for t in times)


def sent() -> Iterator[tuple[int, list[bytes]]]:
    """Times, and the speed and the load of each."""
    joints = JointStateEncoder(["wheel"])
    for number in range(200):
        now = BEGIN + 5_000_000 * number
        yield now, [joints.encode(now, [50.0 + number / 7]), wrench.encode(now, number / 3, 4000.0 + number**1.5)]


def small_bag(compression: str) -> bytes:
    """A bag of one wheel and one second in many chunks: 20 kB, or 60 kB not compressed."""
    with tempfile.TemporaryDirectory() as folder:
        with BagWriter(Path(folder, "bag"), chunk_size=4000, compression=compression) as bag:
            kinds = {"/joint_states": messages.JOINT_STATE, "/wheel/load": messages.WRENCH_STAMPED}
            handles = [bag.add_topic(topic, kind) for topic, kind in kinds.items()]
            for now, some in sent():
                for handle, data in zip(handles, some, strict=True):
                    bag.write(handle, now, now, data)
        return Path(folder, "bag", "bag_0.mcap").read_bytes()


BAG = {compression: small_bag(compression) for compression in ("zstd", "")}
SENT = {(now, data) for now, some in sent() for data in some}


def both(folder: Path, path: Path) -> tuple[int, int]:
    """Replay and recover: what they do, and that nothing but OUT is written."""
    before = everything(folder)
    results = []
    for name in ("replay", "recover"):
        shutil.rmtree(folder / "out", ignore_errors=True)
        if name == "recover":
            status, out, err = in_a_process("recover", path, "-o", folder / "out")
            assert status in (0, 2) and err.count("\n") == (status != 0) and "Traceback" not in err, err
        else:
            status = refused_or_partial("replay", path, "-o", folder / "out")
        results.append(status)
        assert (folder / "out").exists() == (status == 0)
        assert everything(folder, but="out") == before
    shutil.rmtree(folder / "out", ignore_errors=True)
    return results[0], results[1]


# --- truncated and damaged ---


@pytest.mark.parametrize("step", [10, pytest.param(1, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("compression", ["zstd", ""])
def test_truncated_at_every_percent(tmp_path, compression, step):
    whole = BAG[compression]
    path = tmp_path / "cut.mcap"
    results = Counter()
    for percent in range(0, 100, step):
        path.write_bytes(whole[: len(whole) * percent // 100])
        results[both(tmp_path, path)] += 1
    # What a first chunk holds beside the declarations may be too little for a replay to have outputs.
    assert set(results) <= {(2, 2), (2, 0), (0, 0)} and results[2, 0] < 10 and results[0, 0] >= 80 / step


def damages(size: int):
    """Bytes changed, put in, taken out or copied, here and there."""
    place = st.integers(0, size - 1)
    return st.lists(
        st.tuples(st.just("change"), place, st.binary(min_size=1, max_size=8))
        | st.tuples(st.just("flip"), place, st.integers(0, 7))
        | st.tuples(st.just("insert"), place, st.binary(min_size=1, max_size=64))
        | st.tuples(st.just("delete"), place, st.integers(1, 2000))
        | st.tuples(st.just("copy"), place, st.tuples(place, st.integers(1, 5000))),
        min_size=1,
        max_size=5,
    )


def damaged(content: bytes, some) -> bytes:
    result = bytearray(content)
    for kind, place, what in some:
        if kind == "change":
            result[place : place + len(what)] = what
        elif kind == "flip" and place < len(result):
            result[place] ^= 1 << what
        elif kind == "insert":
            result[place:place] = what
        elif kind == "delete":
            del result[place : place + what]
        elif kind == "copy":
            result[place:place] = content[what[0] : what[0] + what[1]]
    return bytes(result)


@pytest.mark.slow
@pytest.mark.parametrize("part", [0, *(pytest.param(part, marks=pytest.mark.nightly) for part in range(1, 12))])
def test_random_damage(tmp_path, part):
    """Whatever is read or recovered was in the file before: each chunk has a checksum.

    Twelve hundred files, the same every time, in twelve parts, go through the reader and through recover; every tenth
    through a replay, which takes four times as long. In each part some are refused by the reader, most are read, and
    nearly all give something to recover.
    """
    tried = Counter()

    @seed(part)
    @settings(max_examples=100)
    @given(st.sampled_from(["zstd", ""]), damages(len(BAG["zstd"])))
    def one(compression, some):
        content = BAG[compression]
        scale = len(content) / len(BAG["zstd"])
        some = [(kind, int(place * scale), what) for kind, place, what in some]
        check_damaged(tmp_path, damaged(content, some), tried)

    one()
    assert tried["files"] >= 100 and 0.2 < tried["read"] / tried["files"] < 1.0
    assert tried["recovered"] / tried["files"] > 0.9 and tried["replayed"] > 0


def check_damaged(folder: Path, content: bytes, tried: Counter[str]) -> None:
    path = folder / "damaged.mcap"
    path.write_bytes(content)
    tried["files"] += 1
    with within():
        try:
            for log_time, data in rows(path):
                assert (log_time, data) in SENT
            tried["read"] += 1
        except InputError as error:
            assert "damaged.mcap" in str(error) and "\n" not in str(error)
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    try:
        with within():
            recover(path, out)
        tried["recovered"] += 1
        assert BagReader(out).complete and all(row in SENT for row in rows(out))
    except InputError as error:
        assert "damaged.mcap" in str(error) and "\n" not in str(error) and not out.exists()
    assert path.read_bytes() == content
    if tried["files"] % 10 == 0:
        shutil.rmtree(out, ignore_errors=True)
        tried["replayed"] += not refused_or_partial("replay", path, "-o", out)
    assert set(os.listdir(folder)) <= {"damaged.mcap", "out"}


def rows(path: Path):
    for block in BagReader(path).blocks():
        for t, start, size in zip(block.log_time.tolist(), block.start.tolist(), block.size.tolist(), strict=True):
            yield t, block.data[start : start + size]


# --- chunks and records that lie ---


def many_bombs(compression: bytes, size: int) -> bytes:
    """As many bombs as make 50 kB, each as large as it may be, one after the other in time."""
    bombs = bytearray()
    for number in range(1000):
        bombs += chunk(message(1, BEGIN + 10**9 + number, bytes(size - 31)), compression)
        if len(bombs) > 50_000:
            break
    return chunk(WHEEL) + chunk(driving()) + bombs


def crowded(size: int) -> bytes:
    """Two chunks that overlap in time, on a topic that is wanted: of four messages each, of ``size`` bytes."""
    early, late = (
        b"".join(message(1, BEGIN + 10**9 + offset + 100 * i, bytes(size)) for i in range(4)) for offset in (0, 50)
    )
    return chunk(WHEEL + driving()) + chunk(early) + chunk(late) + chunk(driving(begin=BEGIN + 2 * 10**9))


LIES = {
    "wrong CRC": (lambda: chunk(WHEEL) + chunk(driving()) + chunk(driving(begin=BEGIN + 10**9), crc=1), (0, 0)),
    "claims 100 GB": (lambda: chunk(WHEEL + driving()) + chunk(b"", b"zstd", size=10**11), (0, 0)),
    "record of 100 GB": (lambda: chunk(WHEEL + driving()) + struct.pack("<BQ", 6, 10**11), (0, 0)),
    "unknown compression": (lambda: chunk(WHEEL + driving(), b"snappy"), (2, 2)),
    "zstd bomb": (lambda: chunk(WHEEL + driving()) + chunk(bytes(200 * 2**20), b"zstd"), (0, 0)),
    "zstd bomb that claims little": (
        lambda: chunk(WHEEL + driving()) + chunk(bytes(200 * 2**20), b"zstd", size=1000),
        (0, 0),
    ),
    "lz4 bomb": (lambda: chunk(WHEEL + driving()) + chunk(bytes(200 * 2**20), b"lz4"), (0, 0)),
    "lz4 bomb that claims little": (
        lambda: chunk(WHEEL + driving()) + chunk(bytes(200 * 2**20), b"lz4", size=1000),
        (0, 0),
    ),
    "zstd bombs below the limit": (lambda: many_bombs(b"zstd", 16 * 2**20), (0, 0)),
    "large zstd bombs": (lambda: many_bombs(b"zstd", 31 * 2**20), (0, 0)),
    "lz4 bombs below the limit": (lambda: many_bombs(b"lz4", 16 * 2**20), (0, 0)),
    "large lz4 bombs": (lambda: many_bombs(b"lz4", 31 * 2**20), (0, 0)),
    "large chunks that overlap in time": (lambda: crowded(7 * 2**19), (0, 0)),
    "too large chunks that overlap in time": (lambda: crowded(7 * 2**20), (2, 0)),
    "tiny records": (lambda: chunk(WHEEL + driving()) + chunk(bytes(9 * 10**6), b"zstd") * 20, (0, 0)),
    "tiny messages": (
        lambda: chunk(WHEEL + driving()) + chunk(message(1, BEGIN, b"") * 10**6, b"zstd") * 20,
        (0, 0),
    ),
    "the same declaration": (lambda: chunk(WHEEL + driving()) + chunk(WHEEL * 10**5, b"zstd") * 20, (0, 0)),
    "a million channels": (
        lambda: (
            chunk(WHEEL + driving())
            + chunk(b"".join(channel(i % 2**16, 1, b"/c%d" % i) for i in range(10**6)), b"zstd")
        ),
        (0, 0),
    ),
    "sixty thousand channels": (
        lambda: (
            chunk(WHEEL + driving()) + chunk(b"".join(channel(i, 1, b"/c%d" % i) for i in range(3, 2**16)), b"zstd")
        ),
        (0, 2),
    ),
    "four thousand wheels": (
        lambda: (
            chunk(schema(1, LOAD) + schema(2, SPEED) + channel(2, 2, b"/w/wheel_speed"))
            + chunk(b"".join(channel(i, 1, b"/w%d/load" % i) for i in range(3, 4000)))
            + chunk(channel(1, 1, b"/w/load") + driving())
        ),
        (2, 0),
    ),
    "long names": (
        lambda: (
            chunk(WHEEL + driving())
            + b"".join(
                chunk(b"".join(channel(i, 1, b"/%d" % i + b"x" * 10**6) for i in range(j, j + 10)), b"zstd")
                for j in range(3, 400, 10)
            )
        ),
        (0, 0),
    ),
    "long metadata": (
        lambda: (
            chunk(WHEEL + driving())
            + b"".join(record(12, text(b"%d" % i) + text(text(b"a") + text(b"b" * 10**6))) for i in range(100))
        ),
        (0, 0),
    ),
    "a channel used again": (
        lambda: chunk(WHEEL + driving()) + chunk(channel(1, 2, b"/other") + driving(begin=BEGIN + 10**9)),
        (0, 0),
    ),
    "a type used again": (
        lambda: chunk(WHEEL + driving()) + chunk(schema(1, b"a/msg/B") + driving(begin=BEGIN + 10**9)),
        (0, 0),
    ),
    "no channel": (lambda: chunk(driving()), (2, 2)),
    "no schema": (lambda: chunk(channel(1, 7, b"/w/load") + driving()), (2, 2)),
    "times after 2262": (lambda: chunk(WHEEL + message(1, 2**63, wrench.encode(1, 0.0, 1.0))), (2, 2)),
    "chunks in a chunk": (lambda: chunk(WHEEL + driving() + chunk(driving())), (2, 2)),
    "statistics of nothing": (lambda: chunk(WHEEL + driving()) + record(11, b""), (0, 0)),
    "nothing but zeros": (lambda: bytes(10**7), (2, 2)),
    "nothing but heads": (lambda: struct.pack("<BQ", 5, 22) * 200_000, (2, 2)),
    "nothing but heads of chunks": (
        lambda: (struct.pack("<BQQQQII", 6, 60, 0, 0, 20, 1, 0) + bytes(9)) * 10**5,
        (2, 2),
    ),
    "chunks that overlap": (lambda: overlapping(), (2, 2)),
}  # name to what stands in the file, and how replay and recover end


def overlapping() -> bytes:
    """Heads of chunks, each of which claims all that follows."""
    count, size = 20_000, 49 + 8
    parts = []
    for number in range(count):
        stored = (count - number) * size - size
        parts.append(struct.pack("<BQQQQIIQ", 6, 40 + stored, 0, 0, stored, 1, 0, stored))
        parts[-1] += bytes(size - len(parts[-1]))
    return b"".join(parts)


LONG = [
    "zstd bombs below the limit", "large zstd bombs", "long metadata", "a million channels", "sixty thousand channels",
    "four thousand wheels", "too large chunks that overlap in time", "nothing but zeros",
]  # fmt: skip


@pytest.mark.parametrize("name", spared(LIES, LONG))
def test_a_file_that_lies(tmp_path, name):
    make, expected = LIES[name]
    path = tmp_path / "lie.mcap"
    path.write_bytes(file_of(make()))
    assert both(tmp_path, path) == expected


def test_an_index_that_names_one_chunk_many_times(tmp_path):
    """Each time it is read would be paid for; the file is walked instead."""
    content = file_of(chunk(WHEEL + driving()), chunk(message(1, BEGIN, bytes(16 * 2**20 - 31)), b"zstd"))
    start = len(content)
    first = content.index(struct.pack("<B", 6), 30)
    bomb = content.rindex(b"zstd") - 4 - 28 - 9
    index = (
        struct.pack("<QQQQ", BEGIN, BEGIN, bomb, start - 13 - bomb) + text(b"") + bytes(8) + text(b"zstd") + bytes(16)
    )
    whole = struct.pack("<QQQQ", BEGIN, BEGIN, first, bomb - first) + text(b"") + bytes(8) + text(b"") + bytes(16)
    count = 10_001
    statistics = struct.pack("<QHIIIIQQ", 41, 2, 2, 0, 0, count, BEGIN, BEGIN) + text(b"")
    summary = WHEEL + record(11, statistics) + record(8, whole) + record(8, index) * (count - 1)
    path = tmp_path / "index.mcap"
    path.write_bytes(content + summary + record(2, struct.pack("<QQI", start, 0, 0)) + MAGIC)
    assert both(tmp_path, path) == (0, 0)


# --- types and messages that lie ---


def test_messages_that_are_not_of_their_type(tmp_path):
    """Bytes that do not fit are left out."""
    path = tmp_path / "lie.mcap"
    declared = schema(1, LOAD) + schema(2, SPEED) + channel(1, 1, b"/w/load") + channel(2, 2, b"/w/wheel_speed")
    garbage = b"".join(
        message(1, BEGIN + i, data)
        for i, data in enumerate([b"", b"\0", b"\0\1\0\0", encode_float64(1.0), b"\0\1\0\0" + b"\xff" * 500, bytes(70)])
    )
    path.write_bytes(file_of(chunk(declared + garbage)))
    assert "w: there is no message of its speed" in refused("replay", path, "-o", tmp_path / "out")
    speeds = b"".join(message(2, BEGIN + 10_000_000 * i, encode_float64(50.0)) for i in range(20))
    unfit = message(1, BEGIN, b"") + message(1, BEGIN + 1, b"\0\1\0\0" + b"\xff" * 500)
    path.write_bytes(file_of(chunk(declared + unfit + speeds)))
    assert "2 messages of its load are not what their type says" in refused("replay", path, "-o", tmp_path / "out")
    path.write_bytes(file_of(chunk(declared + garbage + driving())))
    assert both(tmp_path, path) == (0, 0)


@pytest.mark.parametrize("definition", [b"string[] names\n", b"float64 data\n", b"float64[5] x # what\nuint8 K = 3\n"])
def test_a_type_that_its_text_contradicts(tmp_path, definition):
    """Of such messages 70 zero bytes would be a load of 0 N, and bytes that fit by chance some other."""
    path = tmp_path / "lie.mcap"
    declared = schema(1, LOAD, definition) + schema(2, SPEED) + channel(1, 1, b"/w/load")
    zeros = b"".join(message(1, BEGIN + 10_000_000 * i, bytes(70)) for i in range(20))
    for messages_of_it in (zeros, driving()):
        path.write_bytes(file_of(chunk(declared + channel(2, 2, b"/w/wheel_speed") + driving() + messages_of_it)))
        words = refused("replay", path, "-o", tmp_path / "out")
        assert "/w/load is said to be geometry_msgs/msg/WrenchStamped, but the bag's own definition" in words


@pytest.mark.parametrize(
    "kind", ["std_msgs/msg/Float64", "", "../../etc/passwd", "a" * 10**6, "a\nb", "\0", "/", "x/y"]
)
def test_a_wrong_type_on_a_wanted_topic(tmp_path, kind):
    path = tmp_path / "type.mcap"
    path.write_bytes(file_of(chunk(WHEEL.replace(schema(1, LOAD), schema(1, kind.encode())) + driving())))
    assert "/load" in refused("replay", path, "-o", tmp_path / "out")
    both(tmp_path, path)


@pytest.mark.parametrize(
    "topic", ["/a\nb/load", "/w/../../load", "//load", "/load", "", "\x1b[2J/load", "/ü/load", "/w w/load"]
)
def test_names_of_topics(tmp_path, topic):
    path = tmp_path / "topic.mcap"
    declared = schema(1, LOAD) + schema(2, SPEED) + channel(1, 1, topic.encode())
    path.write_bytes(file_of(chunk(declared + channel(2, 2, topic.encode()[:-4] + b"wheel_speed") + driving())))
    status, out, _ = in_a_process("recover", path, "-o", tmp_path / "recovered")
    assert status == 0 and out.count("\n") == 5 and "\x1b" not in out  # one line for each topic
    assert topic in BagReader(tmp_path / "recovered").topics
    both(tmp_path, path)


def test_joint_states_of_a_million_names(tmp_path):
    names = b"".join(struct.pack("<I", 1) + bytes(4) for _ in range(10**6))
    state = b"\0\1\0\0" + bytes(8) + struct.pack("<I", 1) + bytes(4) + struct.pack("<I", 10**6) + names + bytes(12)
    declared = schema(3, messages.JOINT_STATE.encode()) + channel(3, 3, b"/joint_states")
    large = [chunk(message(3, BEGIN + i, state[:-1] + bytes([i])), b"zstd") for i in range(6)]
    path = tmp_path / "names.mcap"
    path.write_bytes(file_of(chunk(WHEEL + declared), *large, chunk(driving())))
    assert both(tmp_path, path) == (0, 0)


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        "{}",
        "[" * 10**6,
        "[" + "[]," * 4_000_000 + "[]]",
        '{"parameters": {"wheels": ["w"], "n_max": 1e9}, "topics": {}, "vehicle": {}}',
        '{"parameters": {"wheels": [[]]}, "topics": {}, "vehicle": {}}',
        '{"parameters": {"wheels": {"a": 1}}, "topics": {}, "vehicle": {}}',
        '{"parameters": {"log.directory": "/etc"}, "topics": {"w/load": "/x"}, "vehicle": {}}',
        '{"parameters": {"rate_hz": NaN}, "topics": {"a": {}}, "vehicle": {}}',
        '{"parameters": {"wheels": ["w"], "rate_hz": 500.0}, "topics": {}, "vehicle": {"time": "x", "wheels": 3}}',
        '{"parameters": {"wheels": ["w"], "tire.radius": -1.0}, "topics": {}, "vehicle": {}}',
        "1" * 10**6,
    ],
    ids=range(13),
)
def test_a_log_record_that_lies(tmp_path, content):
    declared = schema(3, messages.STRING.encode()) + channel(3, 3, b"/tire_dynamics/log_record")
    path = tmp_path / "log.mcap"
    path.write_bytes(file_of(chunk(WHEEL + declared + message(3, BEGIN, encode_string(content)) + driving(), b"zstd")))
    refused("replay", path, "-o", tmp_path / "out")
    assert os.listdir(tmp_path) == ["log.mcap"]


# --- descriptions and links ---


def laughs(depth: int = 40) -> str:
    lines = ["a0: &a0 [lol, lol]"] + [f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]" for i in range(1, depth)]
    return "\n".join(lines) + "\n"


def merges(depth: int = 40) -> str:
    lines = ["a0: &a0 {k: v}"] + [f"a{i}: &a{i} {{<<: [*a{i - 1}, *a{i - 1}]}}" for i in range(1, depth)]
    return "\n".join(lines) + "\n"


YAML = {
    "laughs": laughs() + "X: *a39\n",
    "laughs as key": laughs() + "? *a39\n: 1\nX: 1\n",
    "merges": merges() + "X: *a39\n",
    "recursive": "X: &a [*a]\n",
    "recursive mapping": "X: &a {b: *a}\n",
    "python": "X: !!python/object/apply:os.system ['touch stray']\n",
    "python at the root": "!!python/object/apply:os.system ['touch stray']\n",
    "deep": "X: " + "[" * 10**5,
    "deep blocks": "- " * 10**5 + "\n",
    "deep mappings": "".join(" " * i + f"a{i}:\n" for i in range(700)),
    "long": "X: [" + "a, " * 10**6 + "]\n",
    "sexagesimal": "X: 1" + ":1" * 500_000 + "\n",
    "digits": "X: " + "9" * 10**6 + "\n",
    "NUL": "X: \0\n",
    "not UTF-8": b"X: \xff\xfe\xfa\n",
    "UTF-16": "X: 1\n".encode("utf-16"),
    "two documents": "X: 1\n---\nX: 2\n",
    "empty": "",
    "tabs": "X:\n\t- 1\n",
}


def written(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("name", YAML)
@pytest.mark.parametrize("key", ["rosbag2_bagfile_information", "relative_file_paths", "storage_identifier"])
def test_a_description_that_explodes(tmp_path, monkeypatch, name, key):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bag").mkdir()
    written(tmp_path / "bag" / "bag_0.mcap", BAG["zstd"])
    content = YAML[name] if isinstance(YAML[name], bytes) else YAML[name].encode()
    if key != "rosbag2_bagfile_information" and b"X: " in content:
        known = b"{storage_identifier: mcap, relative_file_paths: [bag_0.mcap], KEY: X}"
        known = known.replace(b"KEY: X", key.encode() + b": " + content[content.index(b"X: ") + 3 :].rstrip())
        content = content[: content.index(b"X: ")] + b"rosbag2_bagfile_information: " + known + b"\n"
    else:
        content = content.replace(b"X:", key.encode() + b":")
    written(tmp_path / "bag" / "metadata.yaml", content)
    assert "bag" in refused("replay", "bag", "-o", "out")
    assert os.listdir(tmp_path) == ["bag"]
    assert in_a_process("recover", "bag", "-o", "out")[0] == 0  # it needs no description


@pytest.mark.parametrize("name", YAML)
@pytest.mark.parametrize("key", ["radius", "tire_dynamics"])
def test_parameters_that_explode(tmp_path, monkeypatch, name, key):
    monkeypatch.chdir(tmp_path)
    content = YAML[name] if isinstance(YAML[name], bytes) else YAML[name].encode()
    content = content.replace(b"X:", key.encode() + b":")
    written(tmp_path / "config.yaml", content)
    assert "config.yaml" in refused("stability", "--speed-rpm", 100, "--config", "config.yaml")
    written(tmp_path / "in.mcap", BAG["zstd"])
    assert "config.yaml" in refused("replay", "in.mcap", "-o", "out", "--config", "config.yaml")
    assert sorted(os.listdir(tmp_path)) == ["config.yaml", "in.mcap"]


@pytest.mark.parametrize(
    "names",
    [
        ["../secret.mcap"],
        ["{absolute}"],
        ["bag_0.mcap", "../secret.mcap"],
        ["sub/../../secret.mcap"],
        [".."],
        ["."],
        [""],
        ["bag_0.mcap\0"],
        ["bag_0.mcap\nx"],
        ["bag_0.mcap"] * 10**4,
        [["bag_0.mcap"]],
        [{"a": "b"}],
    ],
    ids=range(12),
)
def test_names_that_lead_out_of_the_folder(tmp_path, names):
    written(tmp_path / "secret.mcap", BAG["zstd"])
    (tmp_path / "bag").mkdir()
    written(tmp_path / "bag" / "bag_0.mcap", BAG["zstd"])
    if names == ["{absolute}"]:
        names = [str(tmp_path / "secret.mcap")]
    information = {"storage_identifier": "mcap", "compression_mode": "", "relative_file_paths": names}
    written(tmp_path / "bag" / "metadata.yaml", yaml.safe_dump({"rosbag2_bagfile_information": information}))
    refused("replay", tmp_path / "bag", "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_links_are_read_through_and_never_written_through(tmp_path):
    """Who keeps a bag's files elsewhere and links to them means them to be read; what stands behind OUT is not ours."""
    written(tmp_path / "store.mcap", BAG["zstd"])
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").symlink_to("../store.mcap")
    information = {"storage_identifier": "mcap", "relative_file_paths": ["bag_0.mcap"]}
    written(tmp_path / "bag" / "metadata.yaml", yaml.safe_dump({"rosbag2_bagfile_information": information}))
    assert both(tmp_path, tmp_path / "bag") == (0, 0)
    with BagWriter(tmp_path / "victim"):
        pass
    (tmp_path / "link").symlink_to("victim")
    (tmp_path / "dangling").symlink_to("nowhere")
    (tmp_path / "file").write_text("mine")
    (tmp_path / "to_file").symlink_to("file")
    before = everything(tmp_path)
    for name in ("replay", "recover"):
        for out in ("link", "dangling", "to_file", "file"):
            for force in ((), ("--force",)):
                refused(name, tmp_path / "store.mcap", "-o", tmp_path / out, *force)
    assert everything(tmp_path) == before
    (tmp_path / "out").mkdir()  # a bag with a link in it
    (tmp_path / "out" / "a.mcap").symlink_to("../store.mcap")
    written(tmp_path / "out" / "metadata.yaml", b"")
    for name in ("replay", "recover"):
        refused(name, tmp_path / "store.mcap", "-o", tmp_path / "out", "--force")
    assert (tmp_path / "store.mcap").read_bytes() == BAG["zstd"]


# --- what is no file ---


@pytest.fixture
def no_files(tmp_path) -> dict[str, Path]:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "loop").symlink_to("loop")
    written(tmp_path / "empty", b"")
    written(tmp_path / "secret", b"x").chmod(0)
    return {
        **{name: tmp_path / name for name in ("pipe", "folder", "loop", "empty", "none")},
        "zero": Path("/dev/zero"),
        "null": Path("/dev/null"),
        "behind a file": tmp_path / "empty" / "x",
        "long": tmp_path / ("x" * 300),
        "new\nline": tmp_path / "new\nline",
    }


NO_FILES = ["pipe", "folder", "loop", "empty", "none", "zero", "null", "behind a file", "long", "new\nline"]


@pytest.mark.parametrize("name", NO_FILES)
def test_what_is_no_file(tmp_path, no_files, name):
    path = no_files[name]
    good = written(tmp_path / "good.csv", b"t,a\n0,1\n1,2\n")
    bag = written(tmp_path / "good.mcap", BAG["zstd"])
    out = ("-o", tmp_path / "out")
    columns = ("--speed-columns", "w=a", "--load-columns", "w=a")
    for arguments in (
        ("replay", path, *out),
        ("recover", path, *out),
        ("replay", bag, *out, "--config", path),
        ("stability", "--speed-rpm", 100, "--config", path),
        ("import", "--speed", path, "--load", good, *columns, *out),
        ("import", "--speed", good, "--load", path, *columns, *out),
    ):
        line = refused(*arguments)
        assert "new line" in line if name == "new\nline" else True
    assert not (tmp_path / "out").exists()


def test_what_may_not_be_read(tmp_path):
    """Files that can be used are, and may not be read then."""
    for name, content in (("in.mcap", BAG["zstd"]), ("c.yaml", b"radius: 0.3\n"), ("a.csv", b"t,a\n0,1\n")):
        written(tmp_path / name, content)
    columns = ("--speed-columns", "w=a", "--load-columns", "w=a")
    out = tmp_path / "out"
    identity = os.geteuid()
    for mode in (0o644, 0):
        for path in tmp_path.iterdir():
            path.chmod(mode)
        for arguments in (
            ("replay", tmp_path / "in.mcap", "-o", out),
            ("recover", tmp_path / "in.mcap", "-o", out),
            ("stability", "--speed-rpm", "1", "--config", tmp_path / "c.yaml"),
            ("import", "--speed", tmp_path / "a.csv", "--load", tmp_path / "a.csv", *columns, "-o", out),
        ):
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()) as err:
                try:
                    if identity == 0 and not mode:  # root may read everything
                        os.seteuid(65534)
                    status = main([*map(str, arguments)])
                finally:
                    os.seteuid(identity)
            if mode:
                assert status == 0
                shutil.rmtree(out, ignore_errors=True)
            else:
                assert status == 2 and "Permission denied" in err.getvalue() and err.getvalue().count("\n") == 1
                assert not out.exists()


def test_names_that_are_not_plain(tmp_path):
    """A new line, bytes that are no UTF-8, control characters: read under any name, written under none of these."""
    for number, name in enumerate([b"a\nb", b"\xff\xfe", b"\x1b[31m", "\u00fc".encode(), b" "]):
        folder = tmp_path / str(number)
        folder.mkdir()
        path = folder / os.fsdecode(name + b".mcap")
        path.write_bytes(BAG["zstd"][:-30])
        assert both(folder, path) == (0, 0)
        for command in ("replay", "recover"):
            out = folder / os.fsdecode(command.encode() + name)
            if number < 3:
                assert "can be printed" in refused(command, path, "-o", out)
            else:
                assert in_a_process(command, path, "-o", out)[0] == 0
                assert len(list(BagReader(out).messages())) > 100
                shutil.rmtree(out)
        assert os.listdir(folder) == [path.name]


@pytest.mark.parametrize("out", [".", "..", "/", "", "/dev/null", "/dev/null/x", "/proc/x", "x" * 300, "file/x"])
def test_outputs_that_cannot_be(tmp_path, monkeypatch, out):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    written(tmp_path / "in.mcap", BAG["zstd"])
    written(tmp_path / "here" / "file", b"")
    before = everything(tmp_path)
    for name in ("replay", "recover"):
        for force in ((), ("--force",)):
            refused(name, tmp_path / "in.mcap", "-o", out, *force)
    assert everything(tmp_path) == before


def test_an_output_that_is_the_present_folder(tmp_path, monkeypatch):
    """It is a bag and may be replaced: refused or done, and never half."""
    written(tmp_path / "in.mcap", BAG["zstd"])
    with BagWriter(tmp_path / "here"):
        pass
    monkeypatch.chdir(tmp_path / "here")
    for name in ("replay", "recover"):
        refused_or_partial(name, tmp_path / "in.mcap", "-o", ".", "--force")
        assert sorted(os.listdir(tmp_path)) == ["here", "in.mcap"]
        BagReader(tmp_path / "here")
        os.chdir(tmp_path / "here")


# --- CSV ---

CSV = {
    "NUL in the head": b"t,a\0\n0,1\n",
    "NUL in a row": b"t,a\n0,1\n1,\0\n\0\0\0\n2,3\n",
    "nothing but NUL": bytes(10**6),
    "a huge field": b"t,a\n0," + b"1" * 10**7 + b"\n1,2\n",
    "a huge head": b"t," + b"a" * 10**7 + b"\n0,1\n",
    "a quote that never ends": b't,a\n0,"' + b"1\n" * 10**6,
    "digits": b"t,a\n" + b"9" * 10**5 + b",1\n0,1\n",
    "an exponent": b"t,a\n1e999999999,1\n-1e999999999,1\n0e999999999,1\n1e-999999999,1\n0,1\n",
    "a value's exponent": b"t,a\n0,1e999999999\n1,nan\n2,inf\n3,1\n",
    "many blank lines": b"t,a\n" + b"\n" * 10**6 + b"0,1\n",
    "many rows that are none": b"t,a\n" + b"x\n" * 300_000,
    "many rows": b"t,a\n" + b"".join(b"%d,1\n" % i for i in range(150_000)),
    "many columns": b"t,a" + b",b" * 400_000 + b"\n0,1\n",
    "not UTF-8": b"t,a\n\xff,\xfe\n0,1\n",
    "no rows": b"t,a\n",
    "carriage returns": b"t,a\r0,1\r1,2\r",
}


@pytest.mark.parametrize("name", CSV)
def test_recordings_from_strangers(tmp_path, name):
    hostile = written(tmp_path / "x.csv", CSV[name])
    good = written(tmp_path / "good.csv", b"t,a\n0,1\n1,2\n")
    before = everything(tmp_path)
    columns = ("--speed-columns", "w=a", "--load-columns", "w=a")
    status, _, err = in_a_process("import", "--speed", hostile, "--load", good, *columns, "-o", tmp_path / "out")
    assert status in (0, 2) and "Traceback" not in err and (tmp_path / "out").exists() == (status == 0), err
    assert err.count("\n") == 1 if status else err.count("\n") < 8
    assert everything(tmp_path, but="out") == before


# --- play ---


@pytest.mark.parametrize("name", ["truncated", "wrong CRC", "zstd bomb", "text"])
def test_play(tmp_path, ros_domain, name):
    path = tmp_path / "in.mcap"
    content = {"truncated": BAG["zstd"][:200], "text": b"This is no bag.\n"}.get(name)
    path.write_bytes(file_of(LIES[name][0]()) if content is None else content)
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run(
        [*COMMAND, "play", str(path), "--rate", "100"], capture_output=True, text=True, timeout=300, env=environment
    )
    assert done.returncode in (0, 2) and "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
