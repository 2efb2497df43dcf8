"""The node for minutes or hours, hurt in every way there is here, and looked at after each.

Four wheels, the log on and in files of some seconds. One fault at a time, in random order, every kind once before any
comes again. After each, the wrenches that the node sends are compared with `simulate` on the inputs that were sent to
it; files of the log that are finished are replayed and compared bit for bit, and then deleted. In the end the node's
memory, threads, file descriptors and shared memory have to be what they were in the beginning.

Then a quiet stretch, a third as long again: another node with one log as it is by default, to which nothing happens.
What its memory gains by the hour is what a log costs, which the faults' many logs would hide.

The last line is the verdict; the exit status is 1 if anything was not as it should be.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from harness import print_table, write_json
from null_node import SECOND, WHEELS
from numpy.typing import NDArray
from peer import Peer, our_node, own_domain
from rcl_interfaces.srv import SetParameters
from rclpy.executors import ExternalShutdownException
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

from tire_dynamics import TireWheelUnit, simulate
from tire_dynamics.bag import BagReader
from tire_dynamics.cdr import messages
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay.replay import replay

PATIENCE = 60.0  # [s]
SETTLE, WINDOW = 1.0, 1.0  # [s] until nothing is left of the start (12 1/s is the slowest decay), and compared
FILE = 15.0  # [s] of each file of the log
# The loads sway by 300 N at 1 Hz: what comes 20 ms late makes 40 N, 1 % of the load. On a machine that does more
# some come later: so that for most wrenches, and for all of them what the timeout, 0.2 s, lets pass: 380 N,
# and as much again for the motion that the next load then makes.
MOST, TOLERANCE, ANY = 0.9, 40.0, 760.0  # [], [N], [N]
# What must not grow, and what is within its noise. Memory: between the second and the last quarter of the run, since
# what a fault needs for the first time (another log, another client) stays with the process.
GROWTH = {"memory [MiB]": 16.0, "threads": 0.0, "descriptors": 0.0, "shared memory [MiB]": 0.1}
# Between the second and the last quarter of a quiet stretch: of ten minutes they are 5 apart. 20 MB a day would be
# 0.07; a node takes some 2 MiB in its first minutes, and a log whose thread gets no processor what then waits for it.
QUIET_GROWTH = 4.0  # [MiB]
UNIT = TireWheelUnit.table_1()
UNSTABLE = 6000.0  # [rad/s]: Table 1 loses its stability at 22 400 rpm, 2350 rad/s (docs/model.md, section 12)
ERROR = b"\x02"
OUTPUTS = ("axle_wrench", "ring_deflection", "ring_shape")

FloatArray = NDArray[np.float64]


def main() -> int:
    options = argparse.ArgumentParser(description="The node under faults for a long time.")
    options.add_argument("--minutes", type=float, default=30.0, help="how long (default 30)")
    options.add_argument("--quiet", type=float, help="minutes of the quiet stretch behind it (default a third of that)")
    options.add_argument("--rate", type=float, default=1000.0, help="of the node and of the loads [Hz] (default 1000)")
    options.add_argument("--seed", type=int, default=1, help="of the order of the faults and what is in them")
    options.add_argument("--only", metavar="FAULT", help="this kind alone")
    options.add_argument("--json", metavar="FILE", help="write the figures there as well")
    options.add_argument("--check", metavar="MCAP", help=argparse.SUPPRESS)
    options.add_argument("--listen", metavar="NAME", help=argparse.SUPPRESS)
    given = options.parse_args()
    if given.listen:
        return listen(given.listen)
    if given.check:
        return check(Path(given.check))
    os.environ["PYTHONWARNINGS"] = "error::RuntimeWarning"
    with own_domain() as folder:
        soak = Soak(folder, given.rate, random.Random(given.seed))
        with soak:
            try:
                soak.run_for(60.0 * given.minutes, given.only)
                soak.stay_quiet(60.0 * (given.minutes / 3.0 if given.quiet is None else given.quiet))
            except Failure as failure:
                soak.fail(str(failure))
        soak.afterwards()
        return soak.report(given.json)


class Done(NamedTuple):
    """A fault, when it came [s], how long until the outputs were right again [s], and the error then [N]."""

    name: str
    at: float
    recovered: float
    error: float


class Status(NamedTuple):
    """One of the diagnostics."""

    level: bytes
    message: str
    values: dict[str, str]


class Feeder(Peer):
    """Feeds smooth loads and speeds, remembers them, and can be told to send something else as well or nothing."""

    def __init__(self, rate: float) -> None:
        super().__init__(rate)
        self.silent: set[int] = set()  # wheels without loads
        self.no_speed = False
        self.speed = 80.0
        self.repeats = 1
        self.extra: Callable[[int], None] | None = None
        self.statuses: deque[dict[str, Status]] = deque(maxlen=20)

    def forget(self) -> None:
        super().forget()
        self.loads: list[list[tuple[int, float]]] = [[] for _ in WHEELS]
        self.speeds: list[tuple[int, float]] = []

    def _feed(self) -> None:
        now = time.time_ns()
        t = now % (1000 * SECOND) * 1e-9
        stamp = divmod(now, SECOND)
        if now >= self._speed_due and not self.no_speed:
            self._speed_due = now + SECOND // 100
            speed = self.speed + 2.0 * np.sin(np.pi * t)
            struct.pack_into("<iI", self._speed_message, 4, *stamp)
            struct.pack_into("<4d", self._speed_message, self._speed_place, *[speed] * 4)
            self._speed.publish(bytes(self._speed_message))
            self.speeds.append((now, speed))
        for _ in range(self.repeats):
            for wheel, (publisher, (message, place)) in enumerate(zip(self._loads, self._load_messages, strict=True)):
                if wheel in self.silent:
                    continue
                load = 4000.0 + 300.0 * np.sin(2.0 * np.pi * t + wheel)
                struct.pack_into("<iI", message, 4, *stamp)
                struct.pack_into("<d", message, place, load)
                publisher.publish(bytes(message))
                self.loads[wheel].append((now, load))
        self.sent.append(now)
        if self.extra is not None:
            self.extra(now)

    def _take_one_of_the_rest(self) -> None:
        rest = self._takes[len(WHEELS) :]
        self._next_rare = (self._next_rare + 1) % len(rest)
        _, kind, take = rest[self._next_rare]
        while (taken := take(kind, True)) is not None:
            if kind is DiagnosticArray:
                self.statuses.append(
                    {
                        status.name.removeprefix("tire_dynamics: "): Status(
                            status.level, status.message, {item.key: item.value for item in status.values}
                        )
                        for status in deserialize_message(taken[0], kind).status
                    }
                )

    @property
    def node(self) -> Any:
        return self._node

    def publish_load(self, wheel: int, data: Any) -> None:
        self._loads[wheel].publish(data)

    def publish_joints(self, data: Any) -> None:
        self._speed.publish(data)

    def call(self, client: Any, request: Any) -> Any:
        """Call a service while feeding; its response."""
        end = time.monotonic() + PATIENCE
        while not client.service_is_ready():
            self.run(0.01)
            if time.monotonic() > end:
                raise Failure(f"{client.srv_name} is not there")
        client.handle.send_request(request)
        while True:
            self.run(0.01)
            header, response = client.handle.take_response(client.srv_type.Response)
            if header is not None:
                return response
            if time.monotonic() > end:
                raise Failure(f"{client.srv_name} does not answer")

    def forces(self, wheel: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Stamps [ns] and forces x, z [N] of the wrenches heard."""
        found = [messages.decode_wrench(data) for data, _ in self.wrenches[wheel]]
        return np.array([one.stamp_ns for one in found], np.int64), np.array([[one.fx, one.fz] for one in found])


class Failure(Exception):
    """Something that is promised did not happen."""


class Soak:
    """The node, its feeder, and the faults."""

    def __init__(self, folder: Path, rate: float, noise: random.Random) -> None:
        self.folder, self.rate, self.noise = folder, rate, noise
        self.logs = folder / "logs"
        self.done: list[Done] = []
        self.failures: list[str] = []
        self.samples: list[tuple[float, dict[str, float]]] = []
        self.quiet: list[tuple[float, float]] = []  # time [s] and memory [MiB]
        self.checks: list[tuple[Path, subprocess.Popen[str]]] = []
        self.files = self.compared = 0
        self.beginning: dict[str, float] = {}
        self.end: dict[str, float] = {}
        self.node_files: dict[str, int] = {}
        self.litter: list[Path] = []  # what processes that were killed leave in shared memory
        self.ended_in = 0.0
        self.status_at_end = 0
        self.begun = time.monotonic()

    def __enter__(self) -> Soak:
        command = our_node(self.rate, self.logs)
        command += ["-p", f"log.max_duration_s:={FILE}", "-p", "max_speed_rad_s:=20000.0"]
        self.said = open(self.folder / "said", "w+", encoding="utf-8")
        self.process = subprocess.Popen(command, stderr=self.said)
        self.feeder = Feeder(self.rate)
        node = self.feeder.node
        self.set_parameters = node.create_client(SetParameters, "/tire_dynamics/set_parameters")
        self.set_logging = node.create_client(SetBool, "/tire_dynamics/set_logging")
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        try:
            self.stop()
        finally:
            self.feeder.__exit__(None, None, None)

    def stop(self) -> None:
        """End the node as a user does."""
        try:
            if self.process.poll() is None:
                self.process.send_signal(signal.SIGCONT)
                begin = time.monotonic()
                self.process.send_signal(signal.SIGINT)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self.process.wait(PATIENCE)
                self.ended_in = max(self.ended_in, time.monotonic() - begin)
        finally:
            if self.process.poll() is None:
                self.process.kill()
            self.status_at_end = self.process.wait() or self.status_at_end

    # -- the run --------------------------------------------------------------------------------------------

    def run_for(self, seconds: float, only: str | None) -> None:
        """Faults until the time is over; what goes wrong is kept in ``failures``."""
        kinds = FAULTS if only is None else [fault for fault in FAULTS if name_of(fault) == only]
        if not kinds:
            raise SystemExit(f"--only {only}: there is {', '.join(map(name_of, FAULTS))}")
        self.await_(lambda: bool(self.feeder.wrenches[0]) and self.feeder.connected(), "the node")
        self.begun = time.monotonic()
        self.feeder.run(3.0)
        self.recover("the start", time.time_ns())
        self.beginning = self.now()
        waiting: list[Callable[[Soak], None]] = []
        while time.monotonic() - self.begun < seconds and len(self.failures) < 5:
            if not waiting:
                waiting = self.noise.sample(kinds, len(kinds))
            fault = waiting.pop()
            self.feeder.forget()
            try:
                fault(self)
                self.recover(name_of(fault), time.time_ns())
            except Failure as failure:
                self.fail(f"{name_of(fault)}: {failure}")
            if self.process.poll() is not None:
                self.fail(f"the node ended with status {self.process.returncode}")
                return
            self.samples.append((time.monotonic() - self.begun, self.now()))
            self.look_at_files(False)
        # Nothing is hurt any more, and what was stopped or left has been noticed: then it is as in the beginning.
        quiet = time.monotonic() + 25.0  # a participant that died is forgotten after 20 s
        while time.monotonic() < quiet:
            self.feeder.run(1.0)
            self.feeder.forget()
        self.recover("the end", time.time_ns())
        self.end = self.now()
        self.node_files = shared_files(self.process.pid)

    def stay_quiet(self, seconds: float) -> None:
        """Feed another node, with one log, and look at its memory."""
        if seconds <= 0.0 or self.failures:
            return
        self.stop()
        self.process = subprocess.Popen(our_node(self.rate, self.folder / "quiet"), stderr=self.said)
        self.feeder.forget()
        self.await_(lambda: bool(self.feeder.wrenches[0]), "the node of the quiet stretch")
        begin = time.monotonic()
        while (at := time.monotonic() - begin) < seconds:
            self.feeder.run(1.0)
            self.feeder.forget()
            if self.process.poll() is not None:
                self.fail(f"the node of the quiet stretch ended with status {self.process.returncode}")
                return
            self.quiet.append((at, resident(self.process.pid)))
        over = time.monotonic() - self.begun
        print(f"{over:7.1f} s  {seconds / 60.0:.1f} quiet minutes, one log, {self.quiet[-1][1]:.0f} MiB", flush=True)

    def quiet_memory(self) -> tuple[float, float, float]:
        """Of the quiet stretch: memory in its second quarter [MiB], what the last has more, and MiB an hour."""
        at, memory = np.array(self.quiet).T
        quarter = len(at) // 4
        before, after = np.median(memory[quarter : 2 * quarter]), np.median(memory[-quarter:])
        slope = 3600.0 * np.polyfit(at[quarter:], memory[quarter:], 1)[0]
        return float(before), float(after - before), float(slope)

    def fail(self, text: str) -> None:
        self.failures.append(text)
        print(f"FAILED: {text}", flush=True)

    def await_(self, condition: Callable[[], bool], what: str) -> float:
        """Feed until something is so; after how many seconds it was."""
        begin = time.monotonic()
        while not condition():
            self.feeder.run(0.05)
            if self.process.poll() is not None:
                raise Failure(f"the node ended with status {self.process.returncode}")
            if time.monotonic() - begin > PATIENCE:
                raise Failure(f"waited {PATIENCE:g} s for {what}")
        return time.monotonic() - begin

    def recover(self, name: str, over: int) -> None:
        """Wait until the outputs are right again after a fault, and say how long that took."""
        self.feeder.forget()
        end = time.monotonic() + PATIENCE
        why = "no wrench"
        while time.monotonic() < end:
            self.feeder.run(SETTLE + WINDOW)
            result: list[Any] = []
            worker = threading.Thread(target=lambda into=result: into.append(self.judge()))
            worker.start()
            while worker.is_alive():
                self.feeder.run(0.02)
            first, error, why = result[0]
            if not why:
                one = Done(name, over * 1e-9, max(0.0, (first - over) * 1e-9), error)
                self.done.append(one)
                memory = resident(self.process.pid)
                at = time.monotonic() - self.begun
                figures = f"right after {one.recovered:5.2f} s, within {error:4.1f} N, {memory:.0f} MiB"
                print(f"{at:7.1f} s  {name:30} {figures}", flush=True)
                return
            self.feeder.forget()
        raise Failure(f"the outputs are not right again after {PATIENCE:g} s: {why}")

    def judge(self) -> tuple[int, float, str]:
        """When the outputs of all wheels were right for good, how far they are then from `simulate`, what is wrong."""
        latest, worst = 0, 0.0
        speeds = np.array(list(self.feeder.speeds))
        for wheel, name in enumerate(WHEELS):
            loads = np.array(list(self.feeder.loads[wheel]))
            stamps, forces = self.feeder.forces(wheel)
            if len(loads) < 100 or len(speeds) < 10 or stamps.size < 0.2 * self.rate * WINDOW:
                return 0, 0.0, f"{name}: {stamps.size} wrenches for {len(loads)} loads and {len(speeds)} speeds"
            if not np.isfinite(forces).all():
                raise Failure(f"{name}: a force is not finite")
            if not (np.diff(stamps) > 0).all():
                raise Failure(f"{name}: the stamps do not ascend")
            base = int(loads[0, 0])
            times = (loads[:, 0] - base) * 1e-9
            keep = np.concatenate([[True], np.diff(times) > 0])
            times, values = times[keep], loads[keep, 1]
            speed = np.interp(times, (speeds[:, 0] - base) * 1e-9, speeds[:, 1])
            expected = simulate(UNIT, times, speed, values, n_max=2).axle_force
            at = (stamps - base) * 1e-9
            known = (at >= times[0]) & (at <= times[-1])
            error = np.abs(
                forces[known] - np.stack([np.interp(at[known], times, column) for column in expected.T], axis=1)
            ).max(axis=1)
            late = at[known] > times[-1] - WINDOW
            if late.sum() < 0.2 * self.rate * WINDOW:
                return 0, 0.0, f"{name}: {late.sum()} wrenches in {WINDOW:g} s"
            most = float(np.quantile(error[late], MOST))
            if most > TOLERANCE or error[late].max() > ANY:
                return 0, 0.0, f"{name}: off by {most:.1f} N, {error[late].max():.1f} N at the most"
            right = error <= TOLERANCE
            share = np.cumsum(right[::-1])[::-1] / np.arange(right.size, 0, -1)  # of those from here on
            first = stamps[known][np.flatnonzero(right & (share >= MOST))[0]]
            latest, worst = max(latest, int(first)), max(worst, most)
        return latest, worst, ""

    def now(self) -> dict[str, float]:
        """What must not grow."""
        pid = self.process.pid
        return {
            "memory [MiB]": resident(pid),
            "threads": len(os.listdir(f"/proc/{pid}/task")),
            "descriptors": len(os.listdir(f"/proc/{pid}/fd")),
            "shared memory [MiB]": sum(shared_files(pid).values()) / 2**20,
        }

    # -- the log --------------------------------------------------------------------------------------------

    def look_at_files(self, all_of_them: bool) -> None:
        """Replay the files that are finished, one at a time and beside everything else, and delete them."""
        while True:
            for file, process in list(self.checks):
                if all_of_them or process.poll() is not None:
                    output, _ = process.communicate()
                    self.checks.remove((file, process))
                    if process.returncode:
                        said = output.strip().splitlines()
                        self.fail(f"{file.name}: {said[-1] if said else 'no answer'}")
                    else:
                        self.compared += int(output)
                        self.files += 1
                    file.unlink(missing_ok=True)
            if self.checks or not (files := self.finished_files(all_of_them)):
                return
            command = ["nice", "-n", "19", sys.executable, __file__, "--check", str(files[0])]
            process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
            self.checks.append((files[0], process))

    def finished_files(self, all_of_them: bool) -> list[Path]:
        """Files of logs that the node does not write to any more, the oldest first."""
        if not self.logs.is_dir():
            return []
        found = []
        folders = sorted(self.logs.iterdir(), key=lambda folder: (folder.name[:33], len(folder.name), folder.name))
        for folder in folders:
            files = sorted(folder.glob("*.mcap"), key=lambda path: int(path.stem.rsplit("_", 1)[1]))
            over = all_of_them or folder != folders[-1]
            found += files if over else files[:-1]
        return found

    @property
    def log_folder(self) -> Path | None:
        """The one that is written to, by the last diagnostics."""
        said = self.status().values.get("log", "off")
        return Path(said) if said != "off" else None

    def status(self, name: str = "node") -> Status:
        return self.feeder.statuses[-1][name] if self.feeder.statuses else Status(b"\0", "", {})

    def log_has_stopped(self) -> bool:
        """Whether the last diagnostics say so; other errors may be the machine's, which misses ticks."""
        return "the log stopped" in self.status().message

    def log_goes_on(self) -> None:
        """Wait for diagnostics that say that a log is being written."""
        self.feeder.statuses.clear()
        self.await_(lambda: self.log_folder is not None and not self.log_has_stopped(), "the log to go on")

    # -- afterwards -----------------------------------------------------------------------------------------

    def afterwards(self) -> None:
        """What can only be looked at when the node has ended."""
        self.look_at_files(True)
        for path in self.litter:
            path.unlink(missing_ok=True)
        # Ports belong to all who are there, and the tracing's files to the user.
        own = [name for name in self.node_files if "/fastrtps_" in name and "_port" not in name]
        left = [name for name in own if Path(name).exists()]
        if left:
            self.fail(f"{len(left)} files are left in shared memory: {', '.join(left[:4])}")
        if self.status_at_end:
            self.fail(f"the node ended with status {self.status_at_end}")
        self.said.seek(0)
        for line in self.said:
            if "Traceback" in line or "Warning" in line:
                self.fail(f"the node said: {line.strip()}")
        self.said.close()

    def report(self, file: str | None) -> int:
        """The table and the verdict; the exit status."""
        minutes = (self.samples[-1][0] if self.samples else 0.0) / 60.0
        rows = []
        figures: dict[str, Any] = {}
        at = np.array([moment for moment, _ in self.samples])
        for name, bound in GROWTH.items():
            if not self.end or not self.samples:  # it failed, or was over, before the first fault
                break
            series = np.array([sample[name] for _, sample in self.samples])
            growth = self.end[name] - self.beginning[name]
            if name.startswith("memory") and len(series) >= 8:
                quarter = len(series) // 4
                growth = float(np.median(series[-quarter:]) - np.median(series[quarter : 2 * quarter]))
            half = at > at[-1] / 2.0
            slope = 3600.0 * np.polyfit(at[half], series[half], 1)[0] if half.sum() > 2 else 0.0
            before, after = self.beginning[name], self.end[name]
            rows.append((name, *(f"{value:.1f}" for value in (before, after, growth)), f"<= {bound:g}"))
            figures[name] = {"beginning": before, "end": after, "growth": growth}
            figures[name]["per_hour"] = slope
            if growth > bound:
                self.fail(f"{name} grew by {growth:.1f}")
        print()
        by_kind: dict[str, list[float]] = {}
        for one in self.done:
            by_kind.setdefault(one.name, []).append(one.recovered)
        kinds = ((name, len(all_), f"{np.median(all_):.2f}", f"{max(all_):.2f}") for name, all_ in by_kind.items())
        print_table(("fault", "times", "right after [s]", "worst [s]"), kinds)
        print()
        print_table(("the node's", "beginning", "end", "growth", "bound"), rows)
        quiet = ""
        if len(self.quiet) >= 8:
            seconds, (before, growth, per_hour) = self.quiet[-1][0], self.quiet_memory()
            figures["quiet"] = {"seconds": seconds, "memory": before, "growth": growth, "per_hour": per_hour}
            stretch = f"{seconds / 60.0:.1f} quiet minutes with one log: {before:.1f} MiB"
            print(f"\n{stretch}, growth {growth:+.2f} (<= {QUIET_GROWTH:g}), {per_hour:+.1f} MiB/h")
            quiet = f" ({per_hour:+.1f} in the quiet stretch)"
            if growth > QUIET_GROWTH:
                self.fail(f"memory grew by {growth:.1f} MiB in the quiet stretch")
        recovered = [one.recovered for one in self.done] or [0.0]
        ticks = [int(self.status().values.get(key, 0)) for key in ("ticks", "ticks missed")]
        slope = figures.get("memory [MiB]", {}).get("per_hour", 0.0)
        figures.update(minutes=minutes, faults=len(self.done), recovered=recovered, compared=self.compared, ticks=ticks)
        figures.update(failures=self.failures, files=self.files)
        write_json(file, "soak", figures)
        print(
            f"\n{ticks[0]} ticks, {ticks[1]} missed; {self.files} files of the log replayed, {self.compared} outputs, "
            f"bit for bit; SIGINT answered in {self.ended_in:.2f} s"
        )
        verdict = "passed" if not self.failures else f"FAILED, {len(self.failures)} times: {self.failures[0]}"
        times = f"right again after {np.median(recovered):.2f} s (median), {max(recovered):.2f} s (worst)"
        what = f"{minutes:.1f} minutes, {len(self.done)} faults, {times}, memory {slope:+.1f} MiB/h{quiet}"
        print(f"soak: {what}: {verdict}", flush=True)
        return 1 if self.failures else 0


# -- one finished file of the log -------------------------------------------------------------------------------


def check(file: Path) -> int:
    """Replay one file; prints how many outputs have the same bits, or what is wrong."""
    with tempfile.TemporaryDirectory(dir=file.parent.parent.parent) as folder:
        logged = outputs_of(file)
        try:
            replay(file, Path(folder) / "again", quiet=True)
        except InputError as error:
            print(error if logged else 0)  # a file of a time in which no wheel was in motion
            return 1 if logged else 0
        again = outputs_of(Path(folder) / "again")
    for key, data in logged.items():
        if again.get(key) != data:
            print(f"{key[0]} of {key[1]} is {'another' if key in again else 'missing'} in the replay")
            return 1
    print(len(logged))
    return 0


def outputs_of(bag: Path) -> dict[tuple[str, int], bytes]:
    """By topic and time, the outputs of ticks that are in the file, behind its first record."""
    found: dict[tuple[str, int], bytes] = {}
    recorded, ticks = False, set()
    for topic, _, _, stamp, data in BagReader(bag).messages(in_file_order=True):
        if topic.endswith("/log_record"):
            recorded = True
        elif topic.endswith("/tick") and recorded:
            ticks.add(stamp)
        elif topic.endswith(OUTPUTS) and stamp in ticks:
            found[topic, stamp] = bytes(data)
    return found


# -- the faults -------------------------------------------------------------------------------------------------


def name_of(fault: Callable[[Soak], None]) -> str:
    return (fault.__doc__ or "").strip().rstrip(".")


def bad_numbers(soak: Soak) -> None:
    """numbers and stamps that cannot be"""

    def extra(now: int) -> None:
        noise = soak.noise
        if noise.random() > 0.3:
            return
        value = noise.choice([float("nan"), float("inf"), float("-inf"), -1e300, 1e9, -500.0, -0.0])
        stamp = noise.choice([now, now, 0, now - 10**noise.randrange(6, 18), now + 10**noise.randrange(6, 18)])
        if noise.random() < 0.7:
            message = WrenchStamped()
            message.wrench.force.z, message.wrench.force.x = (value, 0.0) if noise.random() < 0.5 else (4000.0, value)
            soak.feeder.publish_load(noise.randrange(4), with_stamp(message, stamp))
        else:
            names = noise.choices([*WHEELS, "arm"], k=noise.randrange(6))
            velocities = [noise.choice([value, 80.0]) for _ in range(noise.randrange(len(names) + 1))]
            soak.feeder.publish_joints(with_stamp(JointState(name=names, velocity=velocities), stamp))

    with during(soak, extra=extra):
        soak.feeder.run(1.5)


def bad_bytes(soak: Soak) -> None:
    """bytes that are no message"""
    load = bytes(soak.feeder._load_messages[0][0])
    joints = bytes(soak.feeder._speed_message)

    def extra(now: int) -> None:
        noise = soak.noise
        kind = noise.randrange(3)
        data = bytearray((load, joints)[kind % 2] if kind < 2 else noise.randbytes(noise.randrange(4, 300)))
        for _ in range(noise.randrange(1, 6)):
            data[noise.randrange(12, len(data)) if len(data) > 12 else 0] = noise.randrange(256)
        data = data[: noise.randrange(4, len(data) + 1)]
        if noise.random() < 0.5:
            soak.feeder.publish_load(noise.randrange(4), bytes(data))
        else:
            soak.feeder.publish_joints(bytes(data))

    with during(soak, extra=extra):
        soak.feeder.run(1.5)


def one_load_lost(soak: Soak) -> None:
    """one wheel's loads lost"""
    wheel = soak.noise.randrange(4)
    soak.feeder.run(0.3)
    with during(soak, silent={wheel}):
        soak.feeder.run(0.8)
        stopped(soak, [wheel])
        other = soak.feeder.wrenches[wheel - 1]
        known = len(other)
        soak.await_(lambda: len(other) > known, "wrenches of the other wheels")


def all_loads_lost(soak: Soak) -> None:
    """all loads lost"""
    soak.feeder.run(0.3)
    with during(soak, silent={0, 1, 2, 3}):
        soak.feeder.run(0.8)
        stopped(soak, range(4))


def speeds_lost(soak: Soak) -> None:
    """speeds lost"""
    with during(soak, no_speed=True):
        soak.feeder.run(0.8)


def flood(soak: Soak) -> None:
    """inputs at ten times the rate"""
    with during(soak, repeats=10):
        soak.feeder.run(1.5)


def unstable(soak: Soak) -> None:
    """a speed beyond stability"""

    def divergences() -> int:
        return int(soak.status(WHEELS[0]).values.get("stops for divergence", 0))

    soak.await_(lambda: bool(soak.feeder.statuses), "diagnostics")
    before = divergences()
    with during(soak, speed=UNSTABLE):
        soak.await_(lambda: divergences() > before, "the stop in the diagnostics")
    for wheel in range(4):
        _, forces = soak.feeder.forces(wheel)
        if not np.isfinite(forces).all():
            raise Failure("a force is not finite")


def stalled(soak: Soak) -> None:
    """the process stopped for a second"""
    soak.process.send_signal(signal.SIGSTOP)
    soak.feeder.run(soak.noise.uniform(0.3, 1.5))
    soak.feeder.settle()
    soak.feeder.forget()
    soak.process.send_signal(signal.SIGCONT)
    begin = time.monotonic()
    soak.feeder.run(0.5)
    count, elapsed = len(soak.feeder.wrenches[0]), time.monotonic() - begin
    if count > soak.rate * elapsed * 1.2 + 10:
        raise Failure(f"a burst of {count} wrenches in {elapsed:.2f} s")


def bad_parameters(soak: Soak) -> None:
    """parameters that are refused"""
    bad: list[tuple[str, Any]] = [
        ("tire.radius", -1.0), ("tire.radius", 1), ("tire.thickness", 0.4), ("tire.zeta_1", float("nan")),
        ("rate_hz", 100.0), ("wheels", ["x"]), ("model", "none"), ("log.queue_size", 5), ("no_such", 1.0),
    ]  # fmt: skip
    parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in bad]
    response = soak.feeder.call(soak.set_parameters, SetParameters.Request(parameters=parameters))
    taken = [name for (name, _), result in zip(bad, response.results, strict=True) if result.successful]
    if taken:
        raise Failure(f"{', '.join(taken)} took a value that it must refuse")


def another_tire(soak: Soak) -> None:
    """another tire for a while"""
    for value in (soak.noise.uniform(0.02, 0.4), UNIT.zeta_1):
        parameters = [Parameter("tire.zeta_1", value=value).to_parameter_msg()]
        response = soak.feeder.call(soak.set_parameters, SetParameters.Request(parameters=parameters))
        if not response.results[0].successful:
            raise Failure(response.results[0].reason)
        soak.feeder.run(0.3)


def many_calls(soak: Soak) -> None:
    """stability asked without pause"""
    soak.feeder.run(1.5, calls_per_second=1e6)


def log_stopped(soak: Soak) -> None:
    """the log stopped and started"""
    for on in (False, True):
        if not soak.feeder.call(soak.set_logging, SetBool.Request(data=on)).success:
            raise Failure(f"logging could not be set to {on}")
        soak.feeder.run(0.5)
    soak.log_goes_on()


def disk_full(soak: Soak) -> None:
    """no file may grow, for a second"""
    usual = resource.prlimit(soak.process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(soak.process.pid, resource.RLIMIT_FSIZE, (1, usual[1]))
    try:
        soak.feeder.statuses.clear()
        soak.await_(soak.log_has_stopped, "the error in the diagnostics")
        soak.feeder.run(1.0)
    finally:
        resource.prlimit(soak.process.pid, resource.RLIMIT_FSIZE, usual)
    soak.log_goes_on()


def log_removed(soak: Soak) -> None:
    """the log's folder removed"""
    soak.log_goes_on()
    while soak.checks:  # it is read there
        soak.feeder.run(0.2)
        soak.look_at_files(False)
    folder = soak.log_folder
    if folder is None:
        raise Failure("there is no log")
    shutil.rmtree(folder, ignore_errors=True)
    soak.feeder.statuses.clear()
    soak.await_(soak.log_has_stopped, "the error in the diagnostics")
    soak.log_goes_on()


def namesake(soak: Soak) -> None:
    """another node of the same name"""
    command = [sys.executable, "-m", "tire_dynamics.cli.main", "node", "--ros-args", "--log-level", "error"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as other:
        try:
            soak.await_(lambda: "are called" in soak.status().message, "the other node in the diagnostics")
        finally:
            other.send_signal(signal.SIGINT)
            soak.await_(lambda: other.poll() is not None, "the other node's end")
    soak.feeder.statuses.clear()
    soak.await_(lambda: soak.feeder.statuses and "are called" not in soak.status().message, "the warning's end")


def listen(name: str) -> int:
    """Hear the wrenches until a signal: what runs in a process of its own for the two faults below."""
    rclpy.init()
    node = rclpy.create_node(name)
    for wheel in WHEELS:
        node.create_subscription(WrenchStamped, f"{wheel}/axle_wrench", lambda message: None, 10)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)
    return 0


def listener_gone(soak: Soak) -> None:
    """a listener that comes and goes"""
    listener(soak, signal.SIGINT)


def listener_killed(soak: Soak) -> None:
    """a listener that is killed"""
    listener(soak, signal.SIGKILL)


def listener(soak: Soak, number: signal.Signals) -> None:
    before = {str(path) for path in Path("/dev/shm").glob("*")}
    name = f"listener_{len(soak.done)}"
    with subprocess.Popen([sys.executable, __file__, "--listen", name], stderr=subprocess.DEVNULL) as other:
        try:
            soak.await_(lambda: name in soak.feeder.node.get_node_names(), "the listener")
            soak.feeder.run(0.5)
            if number == signal.SIGKILL:  # leaves its part of the shared memory to whoever cleans up
                soak.litter += [Path(name) for name in shared_files(other.pid) if name not in before]
        finally:
            other.send_signal(number)
            soak.await_(lambda: other.poll() is not None, "the listener's end")


FAULTS: list[Callable[[Soak], None]] = [
    bad_numbers, bad_bytes, one_load_lost, all_loads_lost, speeds_lost, flood, unstable, stalled, bad_parameters,
    another_tire, many_calls, log_stopped, disk_full, log_removed, namesake, listener_gone, listener_killed,
]  # fmt: skip


@contextlib.contextmanager
def during(soak: Soak, **changes: Any) -> Iterator[None]:
    """Feed otherwise in the block."""
    usual = {name: getattr(soak.feeder, name) for name in changes}
    for name, value in changes.items():
        setattr(soak.feeder, name, value)
    try:
        yield
    finally:
        for name, value in usual.items():
            setattr(soak.feeder, name, value)


def stopped(soak: Soak, wheels: Iterable[int]) -> None:
    """No wrench beyond the last load's stamp and the timeout, 0.2 s."""
    for wheel in wheels:
        stamps, _ = soak.feeder.forces(wheel)
        last = soak.feeder.loads[wheel][-1][0]
        if stamps.size and stamps[-1] > last + SECOND // 5:
            raise Failure(f"{WHEELS[wheel]}: a wrench {(stamps[-1] - last) * 1e-9:.2f} s after its last load")


def with_stamp(message: Any, stamp: int) -> Any:
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(min(max(stamp, 0), 2**31 * SECOND - 1), SECOND)
    return message


# -- what a process holds ---------------------------------------------------------------------------------------


def resident(pid: int) -> float:
    """Resident memory [MiB]."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024.0
    return 0.0


def shared_files(pid: int) -> dict[str, int]:
    """Sizes [bytes] of the files in shared memory that a process has mapped."""
    found: dict[str, int] = {}
    for line in Path(f"/proc/{pid}/maps").read_text().splitlines():
        parts = line.split(maxsplit=5)
        if len(parts) == 6 and parts[5].startswith("/dev/shm/"):
            low, high = (int(part, 16) for part in parts[0].split("-"))
            name = parts[5].removesuffix(" (deleted)")
            found[name] = found.get(name, 0) + high - low
    return found


if __name__ == "__main__":
    sys.exit(main())
