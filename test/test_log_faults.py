"""The live log hurt on purpose: killed, without disk, without permission, stopped while it starts."""

from __future__ import annotations

import json
import os
import random
import resource
import shutil
import signal
import statistics
import subprocess
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader
from rosbags.highlevel import AnyReader

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64
from test_faults import ERROR, Rig, assert_ascending
from test_live_log import (
    COMMAND,
    ENVIRONMENT,
    PATIENCE,
    SECOND,
    Drive,
    Peer,
    assert_replayed,
    decoded,
    end,
    live_node,
    only_log,
    replay,
    store,
)
from test_node import MODAL, near, stamp_of, wrench

SIGNALS = 8


@pytest.fixture
def rig(ros_domain):
    with ExitStack() as stack:
        one = Rig(ros_domain)
        stack.callback(one.close)
        yield one


def run(*arguments: object) -> subprocess.CompletedProcess:
    return subprocess.run(
        [*COMMAND, *map(str, arguments)],
        env={**os.environ, **ENVIRONMENT},
        capture_output=True,
        text=True,
        timeout=300,
    )


# --- SIGKILL ---


class Lateness(threading.Thread):
    """How long this machine keeps a thread waiting at most that wants to wake, and write, every 50 ms [s]."""

    def __init__(self) -> None:
        super().__init__()
        self.worst = 0.0
        self._over = threading.Event()

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_) -> None:
        self._over.set()
        self.join()

    def run(self) -> None:
        due = time.monotonic()
        with tempfile.TemporaryFile() as file:
            while not self._over.is_set():
                due += 0.05
                time.sleep(max(0.0, due - time.monotonic()))
                file.write(bytes(4096))
                file.flush()
                self.worst = max(self.worst, time.monotonic() - due)
                due = max(due, time.monotonic())


class Victim:
    """A node in a namespace of its own, with its log, and what a listener heard of it until it was killed."""

    def __init__(self, domain: int, number: int, directory: Path, noise: random.Random) -> None:
        space = f"v{number}"
        self.directory = directory / space
        self.heard: list[tuple[int, bytes]] = []  # stamp and message
        arguments = ["-r", f"__ns:=/{space}", "-p", f"log.directory:={self.directory}", "--log-level", "error"]
        if number % 2:  # so little that no chunk is ever full: only what is flushed every so often is on the disk
            arguments += ["-p", "rate_hz:=50.0"]
        self.lived = noise.uniform(0.5, 3.0)
        with live_node(*arguments) as node, ExitStack() as stack:
            self.machine = stack.enter_context(Lateness())
            peer = Peer(domain)
            stack.callback(peer.close)
            peer.node.create_subscription(
                WrenchStamped, f"/{space}/wheel/axle_wrench", self._take, QoSProfile(depth=1000), raw=True
            )
            speeds = peer.publisher(Float64, f"/{space}/wheel/wheel_speed", QoSProfile(depth=10))
            loads = peer.publisher(WrenchStamped, f"/{space}/wheel/load", QoSProfile(depth=10))

            def send() -> None:
                now = time.time_ns()
                speeds.publish(Float64(data=50.0 + (now // 10**7) % 7))
                loads.publish(wrench(now, 4000.0 + (now // 10**6) % 997))

            peer.node.create_timer(0.005, send)
            peer.until(lambda: self.heard, "an axle wrench")
            over = time.monotonic() + self.lived
            peer.until(lambda: time.monotonic() > over, "the end")
            node.kill()
            node.wait()
            settled = time.monotonic() + 0.3
            peer.until(lambda: time.monotonic() > settled, "what was on its way")

    def _take(self, data: bytes) -> None:
        message = store.deserialize_cdr(bytes(data), "geometry_msgs/msg/WrenchStamped")
        self.heard.append((stamp_of(message), message.wrench.force.x, message.wrench.force.z))

    @property
    def log(self) -> Path:
        return only_log(self.directory)


def wrenches(messages) -> list[tuple[int, float, float]]:
    """Stamp and force of each."""
    return [(stamp_of(m), m.wrench.force.x, m.wrench.force.z) for m in messages]


def by_mcap(file: Path, topic: str) -> list[tuple[int, float, float]]:
    """What the mcap library's own reader finds in a file that has no end."""
    found = []
    with open(file, "rb") as stream, suppress(EndOfFile):
        for _, channel, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
            if channel.topic == topic:
                found.append(store.deserialize_cdr(message.data, "geometry_msgs/msg/WrenchStamped"))
    return wrenches(found)


def by_rosbags(folder: Path, topic: str) -> list[tuple[int, float, float]]:
    return wrenches(decoded(folder).get(topic, []))


@pytest.mark.parametrize("kills", [4, pytest.param(50, marks=pytest.mark.nightly)])
def test_sigkill_at_a_random_moment_costs_the_last_second_at_most(ros_domain, tmp_path, kills):
    """What was published until a second before is in the log, without a gap, and three readers agree on it."""
    noise = random.Random(5)
    seeds = [random.Random(noise.random()) for _ in range(kills)]
    with ThreadPoolExecutor(2) as pool:
        lost = list(pool.map(lambda number: killed(ros_domain, number, tmp_path, seeds[number]), range(kills)))
    messages, seconds = zip(*lost, strict=True)
    print(
        f"\n{kills} times SIGKILL: lost {statistics.median(messages):.0f} wrenches (median), {max(messages)} (worst), "
        f"of the last {statistics.median(seconds):.2f} s (median), {max(seconds):.2f} s (worst)"
    )


def killed(domain: int, number: int, directory: Path, noise: random.Random) -> tuple[int, float]:
    """Kill one; the wrenches lost, and the time from the last in the log to the last that was published [s]."""
    victim = Victim(domain, number, directory, noise)
    topic = f"/v{number}/wheel/axle_wrench"
    (file,) = victim.log.glob("*.mcap")
    kept = by_mcap(file, topic)
    # Outputs are published before they are logged, and logged in order: what is in the log was heard.
    last = kept[-1][0] if kept else victim.heard[0][0]
    before = [one for one in victim.heard if one[0] <= last]
    assert kept[-len(before) :] == before or not kept, "a gap, or other numbers"
    lost, seconds = len(victim.heard) - len(before), (victim.heard[-1][0] - last) / SECOND
    # 1 s of promise, and what the machine keeps the log's thread waiting for its turns at the processor and the disk:
    # half a second, or a few times as long as it kept a thread beside it
    late = victim.machine.worst
    assert seconds < 1.0 + max(0.5, 4.0 * late), f"lost {lost} wrenches of {seconds:.2f} s; others {late:.2f} s late"

    again = directory / f"again_{number}"
    done = run("replay", file, "-o", again)
    if kept:
        assert done.returncode == 0, done.stderr
        assert file.name in done.stderr and "Traceback" not in done.stderr
        assert by_rosbags(again, topic)[: len(kept)] == kept
    else:  # killed before a first flush: nothing to replay, and that is said in a line
        assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    whole = directory / f"whole_{number}"
    done = run("recover", victim.log, "-o", whole)
    if kept:
        assert done.returncode == 0, done.stderr
        assert by_rosbags(whole, topic) == kept
    assert "Traceback" not in done.stderr
    for folder in (again, whole, victim.directory):
        shutil.rmtree(folder, ignore_errors=True)
    return lost, seconds


# --- no disk ---


class Trouble:
    """A place for logs, what takes it away, and what gives it back."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.prefix: list[str] = []  # of the node's command line
        self.arguments: list[str] = []

    def begin(self, pid: int) -> None: ...

    def end(self, pid: int) -> None: ...

    def close(self) -> None: ...


class FullDisk(Trouble):
    """A tmpfs of 4 MB, filled up by something else."""

    def __init__(self, directory: Path) -> None:
        super().__init__(directory / "disk")
        self.directory.mkdir(parents=True)
        done = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "none", self.directory], capture_output=True)
        if done.returncode:
            pytest.skip("needs the right to mount a small disk")
        self._mounted = True

    def begin(self, pid: int) -> None:
        with open(self.directory / "other", "wb", buffering=0) as file, suppress(OSError):
            while True:
                file.write(bytes(4096))

    def end(self, pid: int) -> None:
        (self.directory / "other").unlink()

    def close(self) -> None:
        subprocess.run(["umount", "-l", self.directory], check=True)


class Quota(Trouble):
    """No file may grow: a limit on the process, which gives EFBIG."""

    def begin(self, pid: int) -> None:
        self._usual = resource.prlimit(pid, resource.RLIMIT_FSIZE)
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (1, self._usual[1]))

    def end(self, pid: int) -> None:
        resource.prlimit(pid, resource.RLIMIT_FSIZE, self._usual)


class Removed(Trouble):
    """The folder goes away under the open file, and a file stands in the directory's place."""

    def begin(self, pid: int) -> None:
        shutil.rmtree(self.directory)
        self.directory.write_text("")

    def end(self, pid: int) -> None:
        self.directory.unlink()


class Forbidden(Trouble):
    """Nothing may be made in the directory or in the log's folder any more; the log has to go on in another file."""

    def __init__(self, directory: Path) -> None:
        super().__init__(directory)
        if os.geteuid() == 0:  # root may do everything, unless it is told not to
            if shutil.which("setpriv") is None:
                pytest.skip("runs as root, and there is no setpriv to take its rights from it")
            self.prefix = ["setpriv", "--inh-caps=-all", "--bounding-set=-all", "--"]
        self.arguments = ["-p", "log.max_duration_s:=2.0"]

    def begin(self, pid: int) -> None:
        for folder in (self.directory, *self.directory.iterdir()):
            folder.chmod(0o500)

    def end(self, pid: int) -> None:
        for folder in (self.directory, *self.directory.iterdir()):
            folder.chmod(0o700)

    def close(self) -> None:
        if self.directory.is_dir():
            self.end(0)


@contextmanager
def trouble(kind: type[Trouble], tmp_path: Path):
    one = kind(tmp_path / "logs")
    try:
        yield one
    finally:
        one.close()


@pytest.mark.parametrize("kind", [FullDisk, Quota, Removed, Forbidden])
def test_a_disk_that_fails_and_comes_back(rig, tmp_path, kind, monkeypatch):
    """The node goes on publishing, says so, and the log goes on in a new folder that says what is missing."""
    def has_stopped(status=None) -> bool:  # other errors may be the machine's, which misses ticks
        status = status or rig.status()
        return status is not None and status.level == ERROR and "the log stopped" in status.message

    with trouble(kind, tmp_path) as disk:
        monkeypatch.setattr("test_live_log.COMMAND", [*disk.prefix, *COMMAND])
        with live_node("-p", f"log.directory:={disk.directory}", *disk.arguments) as node:
            monkeypatch.undo()
            rig.feed(speed=50.0, load=4000.0)
            forces = rig.hear("/wheel/axle_wrench")
            rig.more(forces, 600, "more than a second of axle wrenches")
            first = sorted(disk.directory.iterdir())
            assert len(first) == 1
            began = rig.now()
            disk.begin(node.pid)
            rig.until(has_stopped, "the error in the diagnostics")
            assert rig.level() == ERROR and str(disk.directory) in rig.status().message
            # in one case long enough for an attempt that fails: it stays an error all the time
            rig.more(forces, 1500 if kind is FullDisk else 100, "axle wrenches without a disk")
            since = len(rig.said)
            rig.more(rig.said, 1, "diagnostics")
            assert all(has_stopped(array.status[0]) for array in rig.said[since:])
            assert rig.count("log: dropped") > 0 and rig.count("log: dropped /wheel/axle_wrench") > 0
            disk.end(node.pid)
            ended = rig.now()
            rig.until(lambda: not has_stopped(), "the log, which tries again")
            again = rig.now()
            rig.more(forces, 600, "axle wrenches with a log again")
            (second,) = [folder for folder in disk.directory.iterdir() if folder not in first]
            end(node)
        assert steady_all(forces)
        assert_ascending(forces)
        # The new log is whole, begins with what was lost, and replays for itself.
        records = decoded(second)["/tire_dynamics/log_record"]
        dropped = json.loads(records[0].data)["dropped"]
        mine = wrenches(decoded(second)["/wheel/axle_wrench"])
        replay(second, tmp_path / "again")
        assert_replayed(second, tmp_path / "again", ["wheel"])
        # What was published is in the first log or in the second, or counted as missing.
        kept: set[int] = {stamp for stamp, _, _ in mine}
        if first[0].exists():
            for file in first[0].glob("*.mcap"):
                kept |= {stamp for stamp, _, _ in by_mcap(file, "/wheel/axle_wrench")}
        missing = [stamp for stamp in map(stamp_of, forces) if stamp not in kept]
        if kind is not Removed:  # which takes what was there as well
            assert all(began - 10 * SECOND < stamp < again for stamp in missing)  # of the last flush, a second before
            count = dropped["/wheel/axle_wrench"]
            took = (again - ended) / SECOND
            print(f"\n{kind.__name__}: {len(missing)} wrenches missing, {count} counted, resumed in {took:.1f} s")
            # more than what is missing, by what was written since the last flush of the log that failed: 500 a second
            assert len(missing) <= count <= len(missing) + 5000


def steady_all(messages) -> bool:
    return all(near(message.wrench.force, MODAL, 50.0, 4000.0) for message in messages)


def test_a_queue_that_is_too_short_is_counted_by_topic_and_the_log_replays(rig, tmp_path):
    """A disk that is too slow: here the queue is too short for what comes in a fiftieth of a second."""
    wheels = ["left", "right"]
    arguments = ["-p", f"wheels:=[{', '.join(wheels)}]", "-p", f"log.directory:={tmp_path / 'logs'}"]
    with live_node(*arguments, "-p", "log.queue_size:=100", "-p", "rate_hz:=2000.0") as node:
        heard = rig.hear("/right/axle_wrench")
        drive = Drive(rig, wheels, seed=7)
        drive.start()
        try:
            rig.more(heard, 2000, "axle wrenches")
            rig.until(lambda: rig.count("log: dropped") > 100, "messages that are not logged")
            assert rig.count("log: waiting") <= 100
            dropped = {key: int(value) for key, value in rig.values().items() if key.startswith("log: dropped /")}
            assert sum(dropped.values()) == rig.count("log: dropped")
            assert len(dropped) > 1
            rig.more(rig.said, 2, "diagnostics")
        finally:
            drive.stop()
        end(node)
    log = only_log(tmp_path / "logs")
    records = [json.loads(record.data)["dropped"] for record in decoded(log)["/tire_dynamics/log_record"]]
    assert len(records) > 2 and records[0] == {}
    counts = [sum(record.values()) for record in records]
    assert counts == sorted(counts) and counts[-1] > 100
    replay(log, tmp_path / "again")
    assert_the_rest_replayed(log, tmp_path / "again", wheels)


def assert_the_rest_replayed(log: Path, again: Path, wheels: list[str]) -> None:
    """Every wrench in the log is in the replay with the same numbers; the replay also has those that were dropped."""
    ours, theirs = decoded(log), decoded(again)
    for wheel in wheels:
        topic = f"/{wheel}/axle_wrench"
        wanted = wrenches(ours[topic])
        assert len(wanted) > 100
        assert {*wanted} <= {*wrenches(theirs[topic])}


# --- signals at any moment ---


def test_sigint_and_sigterm_at_any_moment_close_the_log_and_exit_0(ros_domain, tmp_path):
    """From the moment that the command has taken over the signals; until then it is Python that starts, and ends."""
    noise = random.Random(11)
    cases = [(noise.choice([signal.SIGINT, signal.SIGTERM]), noise.uniform(0.0, 1.5)) for _ in range(SIGNALS)]
    with ThreadPoolExecutor(2) as pool:
        begun = list(pool.map(lambda number: stopped(tmp_path, number, *cases[number]), range(SIGNALS)))
    print(f"\n{SIGNALS} signals: {sum(begun)} after the log had begun, {SIGNALS - sum(begun)} before")


def stopped(directory: Path, number: int, sent: signal.Signals, delay: float) -> bool:
    """End one node at a moment; whether it had begun a log."""
    logs = directory / f"s{number}"
    with live_node("-r", f"__ns:=/s{number}", "-p", f"log.directory:={logs}") as node:
        limit = time.monotonic() + PATIENCE
        while not handles(node.pid, signal.SIGTERM):
            assert node.poll() is None and time.monotonic() < limit
            time.sleep(0.002)
        time.sleep(delay)
        node.send_signal(sent)
        _, said = node.communicate(timeout=PATIENCE)
        assert "Traceback" not in said
        if node.returncode == -signal.SIGALRM:  # too busy a machine for a start that has 1.5 s to end
            return False
        assert node.returncode == 0, said
    if not logs.exists():
        return False
    for log in logs.iterdir():
        assert (log / "metadata.yaml").exists(), [*log.iterdir()]
        with AnyReader([log]) as reader:
            assert reader.message_count == sum(1 for _ in reader.messages())
    return any(logs.iterdir())


def handles(pid: int, number: int) -> bool:
    """Whether a process has a handler for a signal."""
    status = Path(f"/proc/{pid}/status")
    if not Path("/proc/self/status").exists():
        pytest.skip("needs /proc to see when the node has taken over the signals")
    with suppress(OSError):
        for line in status.read_text().splitlines():
            if line.startswith("SigCgt:"):
                return bool(int(line.split()[1], 16) >> (number - 1) & 1)
    return False
