"""What several test files share: the recorded drive, a ROS domain of a test's own, how hypothesis runs."""

import os

# Read when a message module is first imported: without it, an int in a float64 field serialises as garbage.
os.environ.setdefault("ROS_PYTHON_CHECK_FIELDS", "1")

import fcntl
import gc
import signal
import tempfile
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import settings

REPOSITORY = Path(__file__).parents[1]

# Where the shell ran this in the background, SIGINT is ignored, and would be in every process that a test starts.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# How properties run. No deadline: how long an example takes says more about the machine than about the code. The
# examples are the same every time, whatever the environment says, so that a red run is the change's fault; nothing is
# kept from run to run. `make nightly` looks for new ones: it gives --hypothesis-profile and --hypothesis-seed, and
# prints the seed.
_ALWAYS = {"deadline": None, "database": None}
settings.register_profile("fixed", derandomize=True, max_examples=50, **_ALWAYS)
settings.register_profile("few", derandomize=True, max_examples=5, **_ALWAYS)
settings.register_profile("random", max_examples=200, print_blob=True, **_ALWAYS)
settings.load_profile("fixed")


def pytest_collection_modifyitems(items):
    """Marks what runs a real node: `make test` gives it the machine to itself, one after the other."""
    for item in items:
        if "ros_domain" in item.fixturenames:
            item.add_marker(pytest.mark.live)


@pytest.fixture(scope="session")
def drive():
    """The folder with the recordings of a real drive (comma2k19), which are not part of this repository."""
    folder = Path(os.environ.get("TIRE_DYNAMICS_DATA", REPOSITORY.parent / "shared" / "data" / "comma2k19"))
    if not (folder / "wheel_speed.csv").is_file():
        pytest.skip(f"no recorded drive in {folder}: TIRE_DYNAMICS_DATA names the folder of wheel_speed.csv")
    return folder


def _rested(lock: Path) -> float:
    """When a domain was left; 0 if never. A process that was killed in it is seen by others for some 20 s more."""
    try:
        return lock.stat().st_mtime
    except FileNotFoundError:
        return 0.0


@pytest.fixture(scope="session")
def fullcar():
    """The folder with a simulated car's sensors and loads, made by another program; not part of this repository."""
    folder = Path(os.environ.get("TIRE_DYNAMICS_FULLCAR", REPOSITORY.parent / "shared" / "data" / "fullcar"))
    if not (folder / "truth.csv").is_file():
        pytest.skip(f"no simulated car in {folder}: TIRE_DYNAMICS_FULLCAR names the folder of truth.csv")
    return folder


@pytest.fixture
def ros_domain(monkeypatch, tmp_path):
    """A ROS domain id that no other test on this machine has while this one runs.

    It is in the environment for processes that the test starts; for a context in this process, give it to
    ``rclpy.context.Context.init(domain_id=...)``. Discovery stays on this machine, and ROS logs go to
    ``tmp_path``.
    """
    if find_spec("rclpy") is None:
        pytest.skip("rclpy is not installed: the extra `ros` brings it where there are wheels, else ROS does")
    folder = Path(tempfile.gettempdir())
    locks = {folder / f"tire_dynamics_domain_{n}.lock": n for n in range(1, 102)}  # 0 is everyone's; then Linux's ports
    for path in sorted(locks, key=_rested):
        try:
            lock = open(path, "a")
        except PermissionError:  # another user's
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # ends with the process, however that ends
            os.utime(path)
            domain = locks[path]
            break
        except BlockingIOError:
            lock.close()
    else:
        pytest.fail("every ROS domain from 1 to 101 is taken by another test")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "ros_log"))
    with lock:
        yield domain
        os.utime(path)


@pytest.fixture
def bench(ros_domain):
    """Starts the node with ROS arguments; once or more, all in one domain."""
    from test_node import Bench

    benches = []

    def start(*arguments: str):
        benches.append(Bench(ros_domain, *arguments))
        return benches[-1]

    try:
        yield start
    finally:
        with ExitStack() as stack:
            stack.callback(gc.collect)  # the next node's /rosout is not made while a node of its name is left
            for one in benches:
                stack.callback(one.close)
