"""The live node hurt on purpose, as a process of its own: inputs, clocks, instability, parameters, load.

The log under faults is in test_log_faults.py. docs/reliability.md lists what is promised and which test shows it.
"""

from __future__ import annotations

import math
import mmap
import os
import random
import shutil
import signal
import struct
import subprocess
import threading
import time
from collections import Counter
from contextlib import ExitStack

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.executors import ExternalShutdownException
from rclpy.parameter import Parameter
from rclpy.parameter import parameter_value_to_python as plain
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Float64, Float64MultiArray
from std_srvs.srv import Trigger
from test_live_log import SECOND, Peer, end, live_node, time_message
from test_node import MODAL, near, stamp_of, wrench
from test_parameters import unusable

from tire_dynamics.replay.parameters import PARAMETERS

ERROR, WARN, OK = b"\x02", b"\x01", b"\0"
DEEP = QoSProfile(depth=2000)


class Rig(Peer):
    """Feeds wheels, hears everything the node says, and reads its diagnostics."""

    def __init__(self, domain: int) -> None:
        super().__init__(domain)
        self.said: list[DiagnosticArray] = []
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self.said.append, DEEP)
        self._feed: dict[str, list] = {}
        self._made: dict[str, object] = {}

    def send(self, kind, topic: str, message, qos=DEEP) -> None:
        """Publish a message, or the bytes of one."""
        if topic not in self._made:
            self._made[topic] = self.publisher(kind, topic, qos)
        self._made[topic].publish(message)

    def feed(self, name: str = "wheel", *, speed: float | None = None, load: float | None = None) -> None:
        """Send a wheel this speed and this load, every 10 ms, from now on; None stops."""
        if not self._feed:
            self.node.create_timer(0.01, self._send)
        for kind, topic in ((Float64, f"/{name}/wheel_speed"), (WrenchStamped, f"/{name}/load")):
            if topic not in self._made:
                self._made[topic] = self.publisher(kind, topic, DEEP)
        self._feed[name] = [speed, load]

    def _send(self) -> None:
        for name, (speed, load) in self._feed.items():
            if speed is not None:
                self._made[f"/{name}/wheel_speed"].publish(Float64(data=speed))
            if load is not None:
                self._made[f"/{name}/load"].publish(wrench(self.now(), load))

    def now(self) -> int:
        return time.time_ns()

    def hear(self, topic: str, kind=WrenchStamped, raw: bool = False) -> list:
        """What is published on a topic from now on; the list grows."""
        self.heard[topic] = []
        self.node.create_subscription(kind, topic, self.heard[topic].append, DEEP, raw=raw)
        self.until(lambda: self.node.count_publishers(topic), f"a publisher on {topic}")
        return self.heard[topic]

    def more(self, heard: list, count: int, what: str) -> None:
        wanted = len(heard) + count
        self.until(lambda: len(heard) >= wanted, what)

    def wait(self, seconds: float) -> None:
        over = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > over, "the time to pass")

    def status(self, name: str = "node"):
        """The last diagnostic status of the node or of a wheel; None before there is one."""
        for array in reversed(self.said):
            for status in array.status:
                if status.name == f"tire_dynamics: {name}":
                    return status
        return None

    def level(self, name: str = "node") -> bytes | None:
        status = self.status(name)
        return status.level if status else None

    def values(self, name: str = "node") -> dict[str, str]:
        status = self.status(name)
        return {item.key: item.value for item in status.values} if status else {}

    def count(self, key: str, name: str = "node") -> int:
        return int(self.values(name).get(key, 0))

    def call(self, kind, name: str, request):
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready, f"the service {name}")
        future = client.call_async(request)
        self.until(future.done, f"the reply of {name}")
        self.node.destroy_client(client)
        return future.result()


@pytest.fixture
def rig(ros_domain):
    with ExitStack() as stack:
        one = Rig(ros_domain)
        stack.callback(one.close)
        yield one


def assert_ascending(messages) -> None:
    stamps = [stamp_of(message) for message in messages]
    assert all(after > before for before, after in zip(stamps, stamps[1:], strict=False))


def steady(messages, speed: float, load: float, tolerance: float = 1e-9) -> bool:
    return all(near(message.wrench.force, MODAL, speed, load, tolerance) for message in messages)


# --- no wrong number on a topic ---


def bad_inputs(noise: random.Random, now: int):
    """Every kind of bad message once: the count that must show it, type, topic, message. All are for wheel ``bad``."""
    load, speed = "/bad/load", "/bad/wheel_speed"
    high = 10.0 ** noise.uniform(7, 300)
    sign = noise.choice([-1.0, 1.0])
    for value in (math.nan, noise.choice([math.nan, -math.nan])):
        yield "samples not finite", WrenchStamped, load, wrench(now, value)
        yield "samples not finite", WrenchStamped, load, wrench(now, 3000.0, traction=value)
        yield "samples not finite", Float64, speed, Float64(data=value)
        yield "samples not finite", JointState, "/joint_states", joints(now, ["bad"], [value])
    for value in (math.inf * sign, high * sign):
        yield "samples load too high", WrenchStamped, load, wrench(now, value)
        yield "samples load too high", WrenchStamped, load, wrench(now, 3000.0, traction=value)
        yield "samples speed too high", Float64, speed, Float64(data=value)
        yield "samples speed too high", JointState, "/joint_states", joints(now, ["bad"], [value])
    ahead = int(10.0 ** noise.uniform(8.5, 17.5))
    yield "samples in the future", WrenchStamped, load, wrench(now + ahead, 3000.0)
    yield "samples in the future", JointState, "/joint_states", joints(now + ahead, ["bad"], [20.0])
    yield "samples no stamp", WrenchStamped, load, wrench(0, 3000.0)
    yield "samples no stamp", JointState, "/joint_states", joints(0, ["bad"], [20.0])
    yield "samples off the ground", WrenchStamped, load, wrench(now, -noise.uniform(1e-300, 1e4))
    yield "samples out of order", WrenchStamped, load, wrench(now - noise.randrange(10**8, now), 3000.0)
    yield "samples out of order", JointState, "/joint_states", joints(now - noise.randrange(10**8, now), ["bad"], [9.0])
    for count in ("", "samples repeated"):
        yield count, WrenchStamped, load, wrench(now + 10**8, 3000.0)  # waits for its time
    yield "samples joint twice", JointState, "/joint_states", joints(now, ["bad", "x", "bad"], [20.0, 1.0, math.nan])
    yield "joint_states: no velocity", JointState, "/joint_states", joints(now, ["bad"], [])
    yield "joint_states: no velocity", JointState, "/joint_states", joints(now, ["x", "bad"], [20.0])
    yield "", JointState, "/joint_states", joints(now, ["x"], [math.nan])  # a joint that is nobody's concern
    yield "", JointState, "/joint_states", joints(now, [], [])
    for kind, name, good in (
        (WrenchStamped, load, serialize_message(wrench(now, 3000.0))),
        (JointState, "/joint_states", serialize_message(joints(now, ["bad"], [20.0]))),
    ):
        count = f"{name[1:]}: malformed"
        yield count, kind, name, good[: noise.randrange(4, 20)]
        yield count, kind, name, good[:4] + struct.pack("<iII", 0, 0, 2**32 - 1) + good[16:]  # a name of 4 GB
        yield count, kind, name, b"\0\1\0\0" + noise.randbytes(3)
        yield count, kind, name, b"\xff" * 4 + good[4:]  # an encapsulation that there is not
    yield "bad/wheel_speed: malformed", Float64, speed, b"\0\1\0\0" + noise.randbytes(noise.randrange(1, 4))
    yield "bad/wheel_speed: malformed", Float64, speed, b"\xff" * 4 + struct.pack("<d", 20.0)


def joints(stamp: int, names: list[str], velocities: list[float]) -> JointState:
    message = JointState(name=names, velocity=velocities)
    message.header.stamp = time_message(stamp)
    return message


def test_every_bad_input_is_counted_by_its_cause_and_no_output_is_wrong(rig):
    """Every kind of bad input at wheel ``bad`` in a random order for some seconds, among good ones.

    Its own outputs stay finite and in order. Wheel ``good``, whose inputs are in order, is steady to the last digit
    in every message.
    """
    noise = random.Random(20260105)
    with live_node("-p", "wheels:=[bad, good]") as node:
        rig.feed("good", speed=50.0, load=4000.0)
        rig.feed("bad", speed=20.0, load=3000.0)
        good, bad = (rig.hear(f"/{wheel}/axle_wrench") for wheel in ("good", "bad"))
        rings = rig.hear("/bad/ring_deflection", Float64MultiArray), rig.hear("/bad/ring_shape", PointCloud2)
        rig.send(JointState, "/joint_states", joints(rig.now(), ["x"], [0.0]))
        rig.more(bad, 50, "axle wrenches")
        sent: dict[str, int] = {}
        for _ in range(25):
            inputs = [*bad_inputs(noise, rig.now())]
            noise.shuffle(inputs)
            for count, kind, topic, message in inputs:
                sent[count] = sent.get(count, 0) + 1
                rig.send(kind, topic, message)
                rig.executor.spin_once(timeout_sec=0.0005)
            rig.wait(0.05)  # the wheel's own stream goes on in between
        sent.pop("")
        rig.more(rig.said, 3, "diagnostics of all that")
        rig.more(good, 100, "axle wrenches after all that")
        rig.until(lambda: near(bad[-1].wrench.force, MODAL, 20.0, 3000.0, 1e-6), "the steady force of the bad wheel")
        # Subscriptions are best effort with a depth of 5: a busy machine loses much, but not 25 of 25. The counts in
        # the good stream's way (late, repeated, out of order) have no upper bound; the others cannot exceed what was
        # sent.
        for key, number in sent.items():
            found = rig.count(key, "bad") if key.startswith("samples") else rig.count(key)
            assert found > 0, (key, found, number)
            if key not in ("samples out of order", "samples repeated"):
                assert found <= number, (key, found, number)
        assert {key for key in rig.values("good") if "samples" in key} <= {"samples taken", "samples late"}
        end(node)
    assert steady(good, 50.0, 4000.0)
    for messages in (good, bad):
        assert_ascending(messages)
        assert np.isfinite([[m.wrench.force.x, m.wrench.force.y, m.wrench.force.z] for m in messages]).all()
    # What a load within the bounds can do: some multiples of max_load, 200 kN, when it jumps there and back.
    assert max(abs(message.wrench.force.z) for message in bad) < 2e6
    deflections, shapes = rings
    assert len(deflections) > 50 and np.isfinite([message.data for message in deflections]).all()
    assert_ascending(shapes)
    assert all(np.isfinite(np.frombuffer(bytes(message.data), "<f4")).all() for message in shapes)


def test_noise_for_bytes_never_reaches_another_wheel(rig):
    """Good messages with random bytes changed: what decodes may be a load like another, and the rest is refused."""
    noise = random.Random(77)
    with live_node("-p", "wheels:=[bad, good]") as node:
        rig.feed("good", speed=50.0, load=4000.0)
        good = rig.hear("/good/axle_wrench")
        bad = rig.hear("/bad/axle_wrench")
        rig.feed("bad", speed=20.0, load=3000.0)
        rig.more(bad, 20, "axle wrenches")
        for _ in range(1500):
            now = rig.now()
            kind, topic, message = noise.choice([
                (WrenchStamped, "/bad/load", wrench(now, 3000.0)),
                (JointState, "/joint_states", joints(now, ["bad", "x"], [20.0, 1.0])),
                (Float64, "/bad/wheel_speed", Float64(data=20.0)),
            ])  # fmt: skip
            data = bytearray(serialize_message(message))
            for _ in range(noise.randrange(1, 5)):
                data[noise.randrange(len(data))] = noise.randrange(256)
            rig.send(kind, topic, bytes(data[: len(data) if noise.random() < 0.5 else noise.randrange(4, len(data))]))
            rig.executor.spin_once(timeout_sec=0.0005)
        rig.more(good, 100, "axle wrenches after the noise")
        assert end(node) is not None
    assert steady(good, 50.0, 4000.0)
    for messages in (good, bad):
        assert_ascending(messages)
        assert np.isfinite([[m.wrench.force.x, m.wrench.force.z] for m in messages]).all()


# --- stale inputs ---


def test_one_wheel_without_load_stops_alone_and_starts_from_equilibrium(rig):
    wheels = ["a", "b", "c", "d"]
    with live_node("-p", f"wheels:=[{', '.join(wheels)}]") as node:
        for number, wheel in enumerate(wheels):
            rig.feed(wheel, speed=50.0 + number, load=4000.0)
        forces = {wheel: rig.hear(f"/{wheel}/axle_wrench") for wheel in wheels}
        rig.more(forces["d"], 100, "axle wrenches")
        rig.feed("c", speed=52.0)  # from now on no load
        last_load = rig.now()
        rig.until(lambda: rig.level("c") == ERROR, "an error in the diagnostics of the wheel")

        def only_the_load() -> bool:  # on a busy machine, another input may be old for a moment too
            ages = {name: float(rig.values("c")[f"age of {name} [s]"]) for name in ("speed", "load")}
            others = [rig.level(wheel) for wheel in "abd"] == [OK] * 3
            return others and ages["speed"] < 0.2 < ages["load"] and "speed" not in rig.status("c").message

        rig.until(only_the_load, "diagnostics in which nothing but that load is old")
        assert "load is" in rig.status("c").message
        assert rig.count("stops for stale inputs", "c") >= 1
        stopped = len(forces["c"])
        # the last load was sent before ``last_load``; the timeout is 0.2 s
        assert stamp_of(forces["c"][-1]) <= last_load + SECOND // 5
        rig.feed("c", speed=52.0, load=2000.0)
        rig.more(forces["c"], 100, "axle wrenches again")
        rig.until(lambda: rig.level("c") == OK, "no error any more")
        end(node)
    # At once that of the new load, no motion from one to the other: it starts from equilibrium.
    assert steady(forces["c"][:stopped], 52.0, 4000.0) and steady(forces["c"][stopped:], 52.0, 2000.0)
    for number, wheel in enumerate("ab"):
        assert steady(forces[wheel], 50.0 + number, 4000.0)
        assert_ascending(forces[wheel])


# --- clocks ---


class SimulatedClock:
    """Gives a node /clock, and inputs that are stamped with it."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        for kind, topic in ((Clock, "/clock"), (Float64, "/wheel/wheel_speed"), (WrenchStamped, "/wheel/load")):
            rig._made[topic] = rig.publisher(kind, topic, DEEP)
        self.forces = rig.hear("/wheel/axle_wrench")
        self.time = 0

    def to(self, time: int, load: float = 4000.0) -> None:
        self.time = time
        self._rig.send(Clock, "/clock", Clock(clock=time_message(time)))
        self._rig.send(Float64, "/wheel/wheel_speed", Float64(data=50.0))
        self._rig.send(WrenchStamped, "/wheel/load", wrench(time, load))

    def start(self, time: int) -> None:
        """Run from a time on until the node has heard of it: who has just been found may miss what comes first."""
        self.time = time

        def heard() -> bool:
            self.run(0.1)
            return len(self.forces) > 3

        self._rig.until(heard, "axle wrenches in simulated time")

    def run(self, seconds: float, factor: float = 1.0) -> None:
        """Let it run by some of its seconds, this many times as fast as real time."""
        begin, real = self.time, time.monotonic()
        while (gone := (time.monotonic() - real) * factor) < seconds:
            self.to(begin + round(gone * SECOND))
            self._rig.wait(0.004)
        self.to(begin + round(seconds * SECOND))
        self._rig.wait(0.1)

    def run_until(self, count: int, seconds: float, factor: float = 1.0) -> None:
        """Let it run by some seconds, and on, each time by as much, until there are more than ``count`` outputs."""

        def enough() -> bool:
            self.run(seconds, factor)
            return len(self.forces) > count

        self._rig.until(enough, f"more than {count} axle wrenches in simulated time")


@pytest.fixture
def simulated(rig):
    """A node in simulated time at 100 Hz, with a timeout that a fast clock's steps stay below, and its clock."""
    arguments = ("-p", "use_sim_time:=true", "-p", "rate_hz:=100.0", "-p", "input_timeout_s:=1.0")
    with live_node(*arguments) as node:
        yield SimulatedClock(rig)
        end(node)


def test_a_clock_at_zero_that_starts_to_run(rig, simulated):
    """A simulation begins at time 0; that is no time yet for ROS, and nothing may be stamped with it."""

    def counted() -> bool:
        simulated.to(0)
        return rig.count("messages before the clock") > 10

    rig.until(counted, "the messages before the clock in the diagnostics")
    assert not simulated.forces
    simulated.run_until(3, 1.0)
    assert 0 < stamp_of(simulated.forces[0]) and stamp_of(simulated.forces[-1]) <= simulated.time
    assert_ascending(simulated.forces)
    assert steady(simulated.forces, 50.0, 4000.0)


def test_a_pause_is_followed_by_no_burst(rig, simulated):
    """However long it stood and however far it leaps, there are no more ticks than periods that the clock went on."""
    simulated.start(1000 * SECOND)
    count, at = len(simulated.forces), simulated.time
    for _ in range(100):
        simulated.to(at)  # it stands
        rig.wait(0.005)
    assert len(simulated.forces) <= count + 1
    count = len(simulated.forces)
    simulated.run_until(count + 1, 0.5)
    assert len(simulated.forces) - count <= (simulated.time - at) // 10_000_000 + 1
    count = len(simulated.forces)
    for _ in range(30):
        simulated.to(at + 20 * SECOND)  # a leap of two thousand periods, as after a stop in a debugger
        rig.wait(0.005)
    assert len(simulated.forces) - count <= 2  # the tick may come before the inputs of that time do, and stop the wheel
    leapt = simulated.time
    simulated.run_until(count + 1, 0.5)
    assert len(simulated.forces) - count <= (simulated.time - leapt) // 10_000_000 + 2
    assert_ascending(simulated.forces)
    assert steady(simulated.forces, 50.0, 4000.0)


def test_a_clock_ten_times_as_fast(rig, simulated):
    """Ten periods of the model's for one of the watch: outputs may be left out, and none is too many or between."""
    simulated.start(1000 * SECOND)
    simulated.run_until(3, 20.0, factor=10.0)
    stamps = [stamp_of(message) for message in simulated.forces]
    assert 3 < len(stamps) <= (simulated.time - 1000 * SECOND) // 10_000_000 + 1
    assert set(np.diff(stamps) % 10_000_000) == {0}  # at the instants of 100 Hz
    assert_ascending(simulated.forces)
    assert steady(simulated.forces, 50.0, 4000.0)


def test_a_bag_that_loops(rig, simulated):
    """Each time the clock goes back, the wheel starts from there and nothing is left of the loop before."""
    simulated.start(500 * SECOND)
    rig.wait(0.3)
    for loop in range(3):
        simulated.time = 1000 * SECOND
        first = len(simulated.forces)
        simulated.run_until(first + 3, 1.0)
        forces = simulated.forces[first:]
        rig.until(lambda loop=loop: rig.count("clock set back") == loop, "the jump in the diagnostics")
        assert_ascending(forces)
        assert len(forces) <= (simulated.time - 1000 * SECOND) // 10_000_000 + 1
        # One tick may fall between the first /clock of a loop and the message that is sent behind it.
        assert all(1000 * SECOND <= stamp_of(message) <= simulated.time for message in forces)
        assert steady(forces, 50.0, 4000.0)


STEPPED_CLOCK = """
/* The system's time, set by a file's eight bytes [ns]. Waits for a moment of that time follow it as the kernel's do. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

static const volatile long long *step;
static int (*real_gettime)(clockid_t, struct timespec *);
static int (*real_cond_timedwait)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
static int (*real_sem_timedwait)(sem_t *, const struct timespec *);

__attribute__((constructor)) static void begin(void) {
  real_gettime = dlsym(RTLD_NEXT, "clock_gettime");
  real_cond_timedwait = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
  if (!real_cond_timedwait) real_cond_timedwait = dlsym(RTLD_NEXT, "pthread_cond_timedwait");
  real_sem_timedwait = dlsym(RTLD_NEXT, "sem_timedwait");
  int file = open(getenv("STEPPED_CLOCK_FILE"), O_RDONLY);
  if (file < 0) return;
  void *place = mmap(0, 8, PROT_READ, MAP_SHARED, file, 0);
  if (place != MAP_FAILED) step = place;
  close(file);
}

static long long of(const struct timespec *time) { return time->tv_sec * 1000000000LL + time->tv_nsec; }

static struct timespec at(long long time) {
  struct timespec result = {time / 1000000000LL, time % 1000000000LL};
  return result;
}

int clock_gettime(clockid_t clock, struct timespec *time) {
  if (!real_gettime) real_gettime = dlsym(RTLD_NEXT, "clock_gettime");
  int result = real_gettime(clock, time);
  if (!result && clock == CLOCK_REALTIME && step) *time = at(of(time) + *step);
  return result;
}

/* The real moment of a slice of the wait, 5 ms at most; 0 when the wait is over. */
static int slice(const struct timespec *until, struct timespec *moment) {
  struct timespec now;
  real_gettime(CLOCK_REALTIME, &now);
  long long left = of(until) - (of(&now) + *step);
  *moment = at(of(&now) + (left < 5000000 ? left : 5000000));
  return left > 0;
}

static int is_system_time(const struct timespec *time) { return step && time->tv_sec > 1000000000; }

int pthread_cond_timedwait(pthread_cond_t *cond, pthread_mutex_t *mutex, const struct timespec *until) {
  if (!is_system_time(until)) return real_cond_timedwait(cond, mutex, until);
  struct timespec moment;
  while (slice(until, &moment)) {
    int result = real_cond_timedwait(cond, mutex, &moment);
    if (result != ETIMEDOUT) return result;
  }
  return ETIMEDOUT;
}

int sem_timedwait(sem_t *semaphore, const struct timespec *until) {
  if (!is_system_time(until)) return real_sem_timedwait(semaphore, until);
  struct timespec moment;
  while (slice(until, &moment)) {
    int result = real_sem_timedwait(semaphore, &moment);
    if (!result || errno != ETIMEDOUT) return result;
  }
  errno = ETIMEDOUT;
  return -1;
}
"""


@pytest.fixture
def stepped_clock(tmp_path, monkeypatch):
    """Steps the system's time in processes that the test starts, and in no other; a function of the step in ns.

    A library before libc: the machine's own clock is never touched.
    """
    if shutil.which("cc") is None:
        pytest.skip("needs a C compiler to put a clock in front of libc's")
    source, library, file = tmp_path / "clock.c", tmp_path / "clock.so", tmp_path / "step"
    source.write_text(STEPPED_CLOCK)
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"], check=True)
    file.write_bytes(bytes(8))
    monkeypatch.setenv("STEPPED_CLOCK_FILE", str(file))
    monkeypatch.setenv("LD_PRELOAD", str(library))
    with open(file, "r+b") as stream, mmap.mmap(stream.fileno(), 8) as place:

        def to(value: int) -> None:
            place[:] = struct.pack("<q", value)

        yield to


def test_a_system_time_that_is_set_back_and_forth(rig, stepped_clock, monkeypatch):
    """By an hour, by a second and by less than a period, both ways; the vehicle's other computers step along."""
    offset = 0
    with live_node() as node:
        monkeypatch.delenv("LD_PRELOAD")
        rig.now = lambda: time.time_ns() + offset
        rig.feed(speed=50.0, load=4000.0)
        forces = rig.hear("/wheel/axle_wrench")
        rig.more(forces, 100, "axle wrenches")
        stretches = []
        for step in (3600 * SECOND, -3600 * SECOND, -SECOND, SECOND, 1_000_000, -1_000_000, -10 * SECOND):
            before, resets = len(forces), rig.count("clock set back")
            offset += step
            stepped_clock(offset)
            real = time.monotonic()
            # The feed's own messages of before the step may still be on their way: the first ones after it are late.
            rig.until(lambda b=before: len(forces) > b + 250, f"axle wrenches after a step of {step} ns")
            elapsed = time.monotonic() - real
            rig.until(lambda: near(forces[-1].wrench.force, MODAL, 50.0, 4000.0), "the steady force")
            rig.until(lambda: abs(stamp_of(forces[-1]) - rig.now()) < SECOND, "stamps of the new time")
            assert len(forces) - before < elapsed * 500 + 100, "a burst of ticks"
            if step <= -SECOND:
                rig.until(lambda r=resets: rig.count("clock set back") == r + 1, "the step back in the diagnostics")
            stretches.append(forces[before:])
        assert rig.count("clock set back") <= 4  # the three large ones; that by less than a period is a matter of luck
        end(node)
    back = sum(
        after <= before
        for before, after in zip([*map(stamp_of, forces)], [*map(stamp_of, forces[1:])], strict=False)
    )
    assert 3 <= back <= 4  # stamps descend where the time does, and nowhere else
    assert np.isfinite([[m.wrench.force.x, m.wrench.force.z] for m in forces]).all()
    assert steady(forces, 50.0, 4000.0, 1e-6)


# --- instability ---


def test_instability_is_said_before_the_output_stops_at_its_bound(rig):
    # At zeta_1 = 0.5 stability is lost at 457 rad/s (docs/model.md, section 12: near 4350 rpm). 5 % above, motion grows
    # with 5.2 1/s; from a load that sways by 10 N it takes some seconds to 1e6 m/s.
    with live_node("-p", "tire.zeta_1:=0.5", "-p", "max_speed_rad_s:=100000.0") as node:
        unit = MODAL.replace(zeta_1=0.5)
        rig.feed(speed=480.0)
        forces = rig.hear("/wheel/axle_wrench")
        begin = rig.now()
        rig.node.create_timer(
            0.01,
            lambda: rig.send(
                WrenchStamped, "/wheel/load", wrench(now := rig.now(), 4000.0 + 10.0 * math.sin((now - begin) * 1e-7))
            ),
        )
        rig.until(lambda: rig.count("stops for divergence", "wheel") > 0, "the stop")
        unstable = [
            {item.key: item.value for item in status.values}
            for array in rig.said
            for status in array.status
            if status.name == "tire_dynamics: wheel"
            and status.level == ERROR
            and status.message.startswith("unstable")  # samples that are late on a busy machine are said behind it
        ]
        assert unstable and unstable[0]["stops for divergence"] == "0", "it was said only when it had happened"
        assert float(unstable[0]["spectral radius"]) > 1.0
        count = len(forces)
        rig.wait(1.5)
        assert len(forces) == count  # it stays at rest while the point is unstable
        rig.feed(speed=5000.0)  # here it would take milliseconds
        rig.wait(1.0)
        assert len(forces) == count
        rig.feed(speed=50.0)
        rig.more(forces, 200, "axle wrenches at a stable speed")
        rig.until(lambda: rig.level("wheel") == OK, "stable in the diagnostics")
        assert rig.count("stops for divergence", "wheel") == 1
        end(node)  # PYTHONWARNINGS makes a RuntimeWarning an error: there was none
    found = np.array([[m.wrench.force.x, m.wrench.force.z] for m in forces])
    assert np.isfinite(found).all()
    # Displacements below 1e6 m and velocities below 1e6 m/s: F' = k_s y + c_s y', Fx = -k_1 X.
    assert np.abs(found[:, 0]).max() < 1e6 * unit.sidewall_stiffness
    assert np.abs(found[:, 1]).max() < 1e6 * (unit.suspension_stiffness + unit.suspension_damping)
    assert np.abs(found[:count]).max() > 1e6  # it did grow
    assert np.abs(found[count:]).max() < 1e5
    assert_ascending(forces)


# --- parameters ---


def test_every_parameter_refuses_at_run_time_what_it_cannot_be(rig):
    """Out of range, of a wrong type, in contradiction to another, read-only: a reason each, and the old value stays."""
    rows = {row.name: row for row in PARAMETERS}
    tried = [(name, value) for name, value, _ in unusable() if value is not None and not _mixed(value)]
    tried += [("tire.thickness", 0.4), ("tire.radius", 0.01), ("tire.density", 1e-300), ("wheels", ["a", "a"])]
    tried += [(row.name, _another(row)) for row in PARAMETERS if row.read_only]
    assert {name for name, _ in tried} == set(rows)
    with live_node() as node:
        rig.feed(speed=50.0, load=4000.0)
        forces = rig.hear("/wheel/axle_wrench")
        rig.more(forces, 20, "axle wrenches")
        names = list(rows)

        def present() -> list:
            reply = rig.call(GetParameters, "/tire_dynamics/get_parameters", GetParameters.Request(names=names))
            return [plain(value) for value in reply.values]

        before = present()
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg() for name, value in tried]
        )
        results = rig.call(SetParameters, "/tire_dynamics/set_parameters", request).results
        for (name, value), result in zip(tried, results, strict=True):
            assert not result.successful, f"{name} took {value!r}"
            assert result.reason.strip() and "\n" not in result.reason, f"{name} = {value!r}: no reason"
            rclpys = "read-only" in result.reason or "Wrong parameter type" in result.reason  # without the name
            together = name.startswith("tire.") and "tire." in result.reason  # in contradiction to another
            assert name in result.reason or rclpys or together, (name, value, result.reason)
        assert present() == before

        # Two that contradict each other are refused together, though each alone could be taken.
        pair = [Parameter("tire.radius", value=0.2), Parameter("tire.thickness", value=0.25)]
        atomic = SetParametersAtomically.Request(parameters=[one.to_parameter_msg() for one in pair])
        reply = rig.call(SetParametersAtomically, "/tire_dynamics/set_parameters_atomically", atomic)
        assert not reply.result.successful and "thickness" in reply.result.reason
        assert present() == before
        rig.more(forces, 100, "axle wrenches after all that")
        end(node)
    assert steady(forces, 50.0, 4000.0)


def _mixed(value) -> bool:
    """Whether ROS has no parameter of this type."""
    return isinstance(value, dict) or isinstance(value, list) and len({*map(type, value)}) > 1


def _another(row):
    """A value that the row allows, but for being read-only."""
    if row.kind in ("string[]", "string | string[]"):
        return ["other"]
    if row.kind in ("double[]", "double | double[]"):
        return [1.0, 2.0, 3.0]
    if row.kind == "boolean":
        return not row.default
    if row.choices:
        return next(choice for choice in row.choices if choice != row.default)
    if row.kind == "string":
        return "other"
    low = row.low if row.low is not None else 0
    middle = 0.5 * (low + row.default) if row.default > low else row.default + 1.0
    return int(row.default + 1) if row.kind == "integer" else float(middle)


# --- load ---


def resident(pid: int) -> float:
    """Resident memory of a process [MiB]."""
    with open(f"/proc/{pid}/status", encoding="utf-8") as file:
        return next(int(line.split()[1]) / 1024.0 for line in file if line.startswith("VmRSS:"))


class Clients(threading.Thread):
    """Eight clients that call the stability services without pause."""

    def __init__(self, domain: int, wheels: list[str]) -> None:
        super().__init__()
        self.peers = [Peer(domain) for _ in range(2)]
        self.replies: Counter[int] = Counter()
        self._over = threading.Event()
        self._clients = [
            peer.node.create_client(Trigger, f"/{wheel}/floquet_stability")
            for peer, wheel in zip(self.peers * 4, wheels, strict=False)
        ]
        for client, peer in zip(self._clients, self.peers * 4, strict=True):
            peer.until(client.service_is_ready, "the stability service")

    def run(self) -> None:
        waiting = [client.call_async(Trigger.Request()) for client in self._clients]
        try:
            while not self._over.is_set():
                for peer in self.peers:
                    peer.executor.spin_once(timeout_sec=0.001)
                for number, future in enumerate(waiting):
                    if future.done():
                        assert future.result().success
                        self.replies[number] += 1
                        waiting[number] = self._clients[number].call_async(Trigger.Request())
        except ExternalShutdownException:
            pass

    def stop(self) -> None:
        self._over.set()
        self.join()
        for peer in self.peers:
            peer.close()


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="needs /proc to see the node's memory")
def test_far_too_much_of_everything(rig, ros_domain, tmp_path):
    """Forty wheels, loads as fast as this machine can send them, eight clients, a log: ticks may be missed, and are
    counted; memory stays, and the end comes when it is asked for."""
    wheels = [f"w{number}" for number in range(40)]
    arguments = ["-p", f"wheels:=[{', '.join(wheels)}]", "-p", f"log.directory:={tmp_path / 'logs'}"]
    with live_node(*arguments) as node, ExitStack() as stack:
        forces = rig.hear("/w0/axle_wrench", raw=True)
        loads = [rig.publisher(WrenchStamped, f"/{wheel}/load", qos_profile_sensor_data) for wheel in wheels]
        states = rig.publisher(JointState, "/joint_states", qos_profile_sensor_data)
        over, sent = threading.Event(), [0]

        def flood() -> None:
            while not over.wait(0.002):  # 500 rounds a second, or what the machine can: ten times what 50 Hz would be
                now = time.time_ns()
                states.publish(joints(now, wheels, [50.0] * 40))
                data = serialize_message(wrench(now, 4000.0))
                for publisher in loads:
                    publisher.publish(data)
                sent[0] += len(loads)

        clients = Clients(ros_domain, wheels[:8])
        threads = [threading.Thread(target=flood), clients]
        for thread in threads:
            thread.start()
        stack.callback(clients.stop)
        stack.callback(over.set)
        rig.more(forces, 50, "axle wrenches under load")
        rig.wait(4.0)  # start-up, first allocations, the log's queue
        samples = []
        for _ in range(14):
            samples.append(resident(node.pid))
            rig.wait(0.5)
        rig.until(lambda: len(rig.said) > 2 and rig.count("ticks") > 100, "diagnostics of a hundred ticks under load")
        asked = dict(clients.replies)  # none of them starves: each is answered again, however busy the node
        rig.until(lambda: all(clients.replies[each] > asked.get(each, 0) for each in range(8)), "a reply for each")
        replies, missed, ticks = sum(clients.replies.values()), rig.count("ticks missed"), rig.count("ticks")
        dropped = rig.count("log: dropped")
        begin = time.monotonic()
        end(node)  # within PATIENCE; the figure is printed
        took = time.monotonic() - begin
    first, last = np.median(samples[:5]), np.median(samples[-5:])
    print(
        f"\n40 wheels: {sent[0]} loads sent, {replies} stability replies, {ticks} ticks, {missed} missed, "
        f"{dropped} not logged, memory {first:.0f} -> {last:.0f} MiB, SIGINT answered in {took:.2f} s"
    )
    assert last - first < 16.0  # MiB in 5 s: some 60 000 messages, of which each would leave 270 bytes behind


def test_two_nodes_of_the_same_name_are_said(rig):
    with live_node() as node:
        others = "other nodes are called /tire_dynamics"
        rig.until(lambda: rig.values().get("log") == "off" and others not in rig.status().message, "one node")
        with live_node() as second:
            rig.until(lambda: others in rig.status().message, "the second node in the diagnostics")
            assert rig.level() >= WARN
            end(second)
        rig.until(lambda: others not in rig.status().message, "the warning's end")
        end(node, signal.SIGTERM)
