"""Many bags and maps over several processes: the same bytes as alone, what is refused, and what is lost on the way."""

from __future__ import annotations

import os
import pty
import re
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from test_cli import COMMAND, REPOSITORY, called, refused
from test_replay import constant, wild

from tire_dynamics.bag import BagReader
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay import jobs
from tire_dynamics.replay.jobs import Failure, workers
from tire_dynamics.replay.replay import replay

pytestmark = pytest.mark.slow

MAP = ("map", "--x", "zeta_1=0.05:0.5:120", "--y", "speed_rpm=0:20000:120")  # of two blocks of points


@pytest.fixture(scope="module")
def drives(tmp_path_factory) -> Path:
    """Three bags, one of them a file, and one that is none; ``alone`` has what each gives alone."""
    folder = tmp_path_factory.mktemp("drives")
    wild(folder / "wild")
    constant(folder / "four", 3.0, wheels=("a", "b", "c", "d"))
    constant(folder / "file", 2.0)
    (folder / "file" / "file_0.mcap").rename(folder / "single.mcap")
    (folder / "broken").mkdir()
    (folder / "broken" / "metadata.yaml").write_text("[")
    for name in ("wild", "four", "single.mcap"):
        replay(folder / name, folder / "alone" / name.removesuffix(".mcap"))
    return folder


@pytest.fixture(scope="module")
def long(tmp_path_factory) -> tuple[Path, Path]:
    """A bag that takes some seconds, with the parameters that make it so; beside it what it gives alone."""
    folder = tmp_path_factory.mktemp("long")
    constant(folder / "long", 20.0)
    config = folder / "slow.yaml"
    config.write_text(
        "/**:\n  ros__parameters:\n    rate_hz: 2000.0\n    ring_rate_hz: 2000.0\n    ring_samples: 360\n"
    )
    replay(folder / "long", folder / "alone" / "long", config=config)
    return folder / "long", config


def same_bytes(one: Path, other: Path) -> bool:
    files = sorted(file.name for file in one.iterdir())
    return files == sorted(file.name for file in other.iterdir()) and all(
        (one / name).read_bytes() == (other / name).read_bytes() for name in files
    )


def names(folder: Path) -> list[str]:
    """Of all that is there, hidden or not."""
    return sorted(entry.name for entry in folder.iterdir())


def started(*arguments, **options) -> subprocess.Popen:
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    options = {"stderr": subprocess.PIPE, **options}
    return subprocess.Popen([*COMMAND, *map(str, arguments)], env=environment, text=True, **options)


def until(condition, process: subprocess.Popen):
    """What the condition is as soon as it is true; fails if the process ends before."""
    deadline = time.monotonic() + 300.0
    while not (found := condition()):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.002)
    return found


# -- bags -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [(), ("--jobs", 2)])
def test_bags_are_replayed_as_alone_and_a_broken_one_is_named(drives, tmp_path, options):
    bags = [drives / name for name in ("wild", "broken", "four", "single.mcap", "nowhere")]
    done = called("replay", *bags, "-o", tmp_path / "out", *options)
    assert done.returncode == 2 and done.stdout == ""
    *lines, summary = done.stderr.splitlines()
    failed = [line for line in lines if ": doubtful: " not in line]
    assert summary == f"{tmp_path / 'out'}: 3 of 5 bags replayed"
    assert sorted(failed) == [
        f"tire-dynamics: {drives / 'broken'}: {drives / 'broken' / 'metadata.yaml'}: is not the description of a bag",
        f"tire-dynamics: {drives / 'nowhere'}: does not exist",
    ]
    assert names(tmp_path / "out") == ["four", "single", "wild"]
    for name in names(tmp_path / "out"):
        assert same_bytes(tmp_path / "out" / name, drives / "alone" / name)


def test_relative_paths_and_one_bag_with_jobs(drives, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tire.yaml").write_text("zeta_1: 0.1\n")
    there = Path(os.path.relpath(drives / "four"))
    done = called("replay", there, "-o", "deep/out", "--jobs", 1, "--config", "tire.yaml")
    assert (done.returncode, done.stderr) == (0, "deep/out: 1 of 1 bags replayed\n")
    replay(drives / "four", tmp_path / "four", config="tire.yaml")
    assert same_bytes(tmp_path / "deep" / "out" / "four", tmp_path / "four")
    assert not same_bytes(tmp_path / "four", drives / "alone" / "four")  # the configuration has been read
    done = called("replay", "nowhere", "-o", "none", "--jobs", 1)
    assert done.stderr == "tire-dynamics: nowhere: does not exist\nnone: 0 of 1 bags replayed\n"
    assert names(tmp_path) == ["deep", "four", "tire.yaml"]


def test_damage_is_told(drives, tmp_path):
    whole = (drives / "single.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    assert BagReader(tmp_path / "cut.mcap").damage
    done = called("replay", tmp_path / "cut.mcap", drives / "four", "-o", tmp_path / "out")
    damage, summary = done.stderr.splitlines()
    assert done.returncode == 0 and summary == f"{tmp_path / 'out'}: 2 of 2 bags replayed"
    assert damage.startswith(f"{tmp_path / 'cut.mcap'} is damaged: ")
    assert damage.endswith("; what stands before was replayed")


def test_an_output_that_exists_is_replaced_only_by_force(drives, tmp_path):
    out = tmp_path / "out"
    replay(drives / "four", out / "wild")
    before = (out / "wild" / "wild_0.mcap").read_bytes()
    bags = drives / "four", drives / "wild"
    assert f"{out / 'wild'}: exists already (--force replaces a bag)" in refused("replay", *bags, "-o", out)
    assert names(out) == ["wild"] and (out / "wild" / "wild_0.mcap").read_bytes() == before
    (out / "four").mkdir()
    (out / "four" / "mine").write_text("")
    assert f"{out / 'four'}: exists and is not a bag" in refused("replay", *bags, "-o", out, "--force")
    assert (out / "wild" / "wild_0.mcap").read_bytes() == before
    (out / "four" / "mine").unlink()
    (out / "four").rmdir()
    assert called("replay", *bags, "-o", out, "--force").returncode == 0
    for name in ("four", "wild"):
        assert same_bytes(out / name, drives / "alone" / name)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["a", "./a"], "a and ./a are the same bag"),
        (["a", "link"], "a and link are the same bag"),
        (["a", "deep/a"], "a and deep/a would both be replayed into out/a"),
        (["a", "deep/a.mcap"], "a and deep/a.mcap would both be replayed into out/a"),
        (["/", "a"], "/: has no name that its output could have"),
        (["a", "b", "-o", "file"], "file: is not a folder"),
        (["a", "b", "-o", "file/deep"], "file/deep: cannot be written: Not a directory"),
        (["a", "b", "-o", ".", "--force"], "a: would replace the bag a, which is to be replayed"),
        (["a/a_0.mcap", "deep/a", "-o", ".", "--force"], "a: would replace the bag a/a_0.mcap"),
        (["a", "b", "--config", "nowhere.yaml"], "nowhere.yaml: No such file"),
        (["a", "--jobs", "0"], "--jobs is 0; it must be from 1 to 512"),
        (["a", "--jobs", "513"], "--jobs is 513; it must be from 1 to 512"),
        (["a", "--jobs", "2.0"], "--jobs is '2.0'; it must be a whole number"),
        (["a", "--jobs", "1", "--scheduler", "localhost:1"], "only one can be given"),
        (["a", "--scheduler", "localhost"], "--scheduler is localhost, where no Dask scheduler answers"),
    ],
)
def test_what_is_refused(tmp_path, monkeypatch, arguments, words):
    if "localhost" in arguments:
        pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        constant(tmp_path / name, 0.1)
    (tmp_path / "link").symlink_to("a")
    (tmp_path / "file").write_text("")
    before = names(tmp_path)
    assert words in refused("replay", "-o", "out", *arguments)
    assert names(tmp_path) == before and names(tmp_path / "a") == ["a_0.mcap", "metadata.yaml"]


def test_progress_in_a_terminal_and_none_in_a_pipe(drives, tmp_path):
    arguments = ("replay", drives / "four", drives / "wild", "--jobs", 2, "-o")
    piped = started(*arguments, tmp_path / "piped")
    lines = piped.communicate(timeout=300)[1].splitlines()
    told = [line for line in lines if ": doubtful: " not in line]
    assert told == [f"{tmp_path / 'piped'}: 2 of 2 bags replayed"]
    ours, theirs = pty.openpty()
    process = started(*arguments, tmp_path / "shown", stderr=theirs)
    os.close(theirs)
    shown = b""
    with suppress(OSError):  # the end of a terminal, on Linux
        while piece := os.read(ours, 4096):
            shown += piece
    os.close(ours)
    assert process.wait(timeout=300) == 0
    pytest.importorskip("rich", reason="rich is not installed, and without it there is no bar")
    bars = re.findall(r"(\d+)%.*?(\d) bags", shown.decode())  # of all bags, none of single ones
    assert bars[0] == ("0", "0") and bars[-1] == ("100", "2")
    assert {count for _, count in bars} <= {"0", "1", "2"} and shown.count(b"replay") > 1


@pytest.mark.nightly
def test_interrupting_ends_all_and_leaves_nothing_behind(long, tmp_path):
    bag, config = long
    out = tmp_path / "out"
    bags = bag, tmp_path / "copy"
    bags[1].symlink_to(constant(tmp_path / "other", 20.0))
    process = started("replay", *bags, "-o", out, "--jobs", 2, "--config", config, start_new_session=True)
    try:
        until(lambda: len([*out.glob(".replay.*/*/.*/*.mcap")]) == 2, process)
        os.killpg(process.pid, signal.SIGINT)  # what a terminal does at Ctrl-C
        _, said = process.communicate(timeout=300)  # the pipe's end: no process has it any more
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode in (128 + signal.SIGINT, -signal.SIGINT)  # as in test_replay
    assert said == ""
    assert not out.exists()


# -- workers ----------------------------------------------------------------------------------------------------


def strange(item):
    """Does what the item says, in whatever process it comes to."""
    if item == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if item == "exit":
        os._exit(3)
    if item == "refuse":
        raise InputError("two\n lines")
    if item == "full":
        raise OSError(28, "No space left on device", "some/file")
    if item == "fault":
        raise RuntimeError("a fault")
    return item, os.getpid()


REASONS = {
    "refuse": "two lines",
    "full": "some/file: No space left on device",
    "fault": "RuntimeError: a fault",
    "die": "the process that worked on it ended by SIGKILL",
    "exit": "the process that worked on it ended with exit status 3",
}


def test_one_that_fails_does_not_hinder_the_others():
    items = ["a", "die", "b", "refuse", "full", "c", "fault", "exit", *"defg"]
    with workers(2, None) as pool:
        results = dict(pool.each(strange, items))
    assert sorted(results) == [*range(len(items))]
    for number, item in enumerate(items):
        expected = Failure(REASONS[item]) if item in REASONS else (item, results[number][1])
        assert results[number] == expected
    processes = {result[1] for result in results.values() if not isinstance(result, Failure)}
    assert os.getpid() not in processes and 1 <= len(processes) <= 4  # two had to be replaced


def unsendable(item):
    return item if item % 2 else lambda: item


def test_what_cannot_be_sent_between_processes_fails_alone():
    with workers(1, None) as pool:
        results = dict(pool.each(unsendable, [1, 2, 3, lambda: 4, 5]))
    assert [results[number] for number in (0, 2, 4)] == [1, 3, 5]
    assert all(isinstance(results[number], Failure) and "pickle" in results[number].reason for number in (1, 3))


ENDLESS = """
import os, sys, time
from tire_dynamics.replay.jobs import workers

def work(item):
    print(os.getpid(), flush=True)
    time.sleep(300)

if __name__ == "__main__":
    with workers(2, None) as pool:
        list(pool.each(work, [1, 2]))
"""


def test_no_process_outlives_one_that_is_killed(tmp_path):
    (tmp_path / "endless.py").write_text(ENDLESS)
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    command = [sys.executable, str(tmp_path / "endless.py")]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        at_work = [process.stdout.readline() for _ in range(2)]
        process.kill()
        assert process.stdout.read() == b""  # the pipe's end: no process has it any more
    assert all(int(line) != process.pid for line in at_work)


def test_a_map_is_in_order_and_keeps_its_processes():
    with workers(2, None) as pool:
        first = pool.map(strange, "abcdef")
        second = pool.map(strange, iter("gh"))
        assert pool.map(strange, []) == []
        with pytest.raises(InputError, match="^the process that worked on it ended by SIGKILL$"):
            pool.map(strange, ["die"])
    assert "".join(item for item, _ in [*first, *second]) == "abcdefgh"
    assert {process for _, process in second} <= {process for _, process in first}


def test_a_map_has_the_same_bytes(tmp_path):
    assert called(*MAP, "-o", tmp_path / "a.png").returncode == 0
    done = called(*MAP, "-o", tmp_path / "b.png", "--jobs", 2)
    assert done.returncode == 0, done.stderr
    for suffix in ("png", "npz"):
        assert (tmp_path / f"a.{suffix}").read_bytes() == (tmp_path / f"b.{suffix}").read_bytes()
    assert "--jobs is 0" in refused(*MAP, "-o", tmp_path / "c.png", "--jobs", 0)


# -- a cluster --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cluster():
    """Two processes with a thread each, which are replaced when they die."""
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster


@pytest.mark.nightly
def test_a_worker_that_is_killed_halfway_is_made_up_for(cluster, drives, long, tmp_path):
    import distributed
    import psutil  # which distributed stands on

    bag, config = long
    with distributed.Client(cluster.scheduler_address, set_as_default=False) as client:
        processes = [*client.run(os.getpid).values()]
    assert len(set(processes) - {os.getpid()}) == 2
    out = tmp_path / "out"
    constant(tmp_path / "short", 0.2)
    bags = bag, tmp_path / "short", drives / "broken"
    process = started("replay", *bags, "-o", out, "--config", config, "--scheduler", cluster.scheduler_address)

    def at_work() -> list[int]:
        files = {pid: [Path(file.path) for file in psutil.Process(pid).open_files()] for pid in processes}
        return [pid for pid in processes if any(out in file.parents and "long" in file.name for file in files[pid])]

    try:
        [victim] = until(at_work, process)
        os.kill(victim, signal.SIGSTOP)
        assert at_work() == [victim]  # so that it cannot have come to the end
        os.kill(victim, signal.SIGKILL)
        _, said = process.communicate(timeout=300)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 2
    failed, summary = said.splitlines()
    assert failed.startswith(f"tire-dynamics: {drives / 'broken'}: ")
    assert summary == f"{out}: 2 of 3 bags replayed"
    assert names(out) == ["long", "short"]
    assert same_bytes(out / "long", bag.with_name("alone") / "long")
    replay(tmp_path / "short", tmp_path / "alone" / "short", config=config)
    assert same_bytes(out / "short", tmp_path / "alone" / "short")


@pytest.mark.nightly
def test_a_cluster_fails_as_processes_do(cluster):
    """Even where others wait behind the one that ends its worker, and Dask takes them for as bad as that."""
    cluster.scheduler.allowed_failures = 0  # the default is 3, which takes longer
    items = ["a", "die", "b", "refuse", "full", "c", "fault"]
    reasons = {**REASONS, "die": "the worker that worked on it was lost, and so was each that tried again"}
    with workers(None, cluster.scheduler_address) as pool:
        results = dict(pool.each(strange, items))
    for number, item in enumerate(items):
        expected = Failure(reasons[item]) if item in reasons else (item, results[number][1])
        assert results[number] == expected


@pytest.mark.nightly
def test_a_map_on_a_cluster_has_the_same_bytes(cluster, tmp_path):
    assert called(*MAP, "-o", tmp_path / "a.png").returncode == 0
    done = called(*MAP, "-o", tmp_path / "b.png", "--scheduler", cluster.scheduler_address)
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "a.npz") as one, np.load(tmp_path / "b.npz") as other:
        assert set(one) == set(other)
        assert all(one[name].tobytes() == other[name].tobytes() for name in one)


@pytest.mark.nightly
@pytest.mark.parametrize("silent", [False, True])
def test_a_scheduler_that_does_not_answer(drives, tmp_path, monkeypatch, silent):
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    monkeypatch.setattr(jobs, "PATIENCE", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        if not silent:
            server.close()
        words = refused("replay", drives / "four", "-o", tmp_path / "out", "--scheduler", address)
    assert f"--scheduler is {address}, where no Dask scheduler answers" in words
    assert names(tmp_path) == []


def test_without_dask_it_says_how_to_get_it(drives, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    words = refused("replay", drives / "four", "-o", tmp_path / "out", "--scheduler", "tcp://localhost:8786")
    assert "pip install 'tire_dynamics[cluster]'" in words
    assert names(tmp_path) == []
