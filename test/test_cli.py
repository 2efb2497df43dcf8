"""The command line as its own process: exit statuses, one line for what cannot be used, no ROS where none is needed."""

from __future__ import annotations

import io
import json
import math
import os
import pty
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest

from tire_dynamics import TireWheelUnit, wheel
from tire_dynamics.doors import messages
from tire_dynamics.doors.bag import BagWriter
from tire_dynamics.doors.cli import main
from tire_dynamics.doors.messages import WrenchEncoder, encode_float64

REPOSITORY = Path(__file__).parents[1]
COMMAND = [sys.executable, "-m", "tire_dynamics.doors.cli"]
BEGIN = 1_700_000_000_000_000_000


def command(*arguments, **options) -> subprocess.CompletedProcess:
    """The command as its own process."""
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    return subprocess.run(
        [*COMMAND, *map(str, arguments)], env=environment, capture_output=True, text=True, timeout=60, **options
    )


def called(*arguments) -> subprocess.CompletedProcess:
    """The same within this process, which is faster; what would be a traceback fails the test."""
    with redirect_stdout(io.StringIO()) as stdout, redirect_stderr(io.StringIO()) as stderr:
        status = main([*map(str, arguments)])
    return subprocess.CompletedProcess(arguments, status, stdout.getvalue(), stderr.getvalue())


def refused(*arguments, run=called, **options) -> str:
    """The one line with which the command refuses; fails if it does anything else."""
    done = run(*arguments, **options)
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    # The ROS client library says a line of its own, before ours, of arguments that it cannot parse.
    lines = [line for line in done.stderr.splitlines() if "[rcl]" not in line]
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("tire-dynamics: ")
    return lines[0]


def write_bag(folder: Path, *, seconds: float = 1.0, wheels=("left", "right"), load: float = 4000.0) -> Path:
    """Constant speed and load at 100 Hz."""
    encoder = WrenchEncoder("axle")
    with BagWriter(folder) as writer:
        speeds = [writer.add_topic(f"/{name}/wheel_speed", messages.FLOAT64) for name in wheels]
        loads = [writer.add_topic(f"/{name}/load", messages.WRENCH_STAMPED) for name in wheels]
        for number in range(int(100 * seconds)):
            now = BEGIN + number * 10_000_000
            for speed, force in zip(speeds, loads, strict=True):
                writer.write(speed, now, now, encode_float64(50.0))
                writer.write(force, now, now, encoder.encode(now, 0.0, load))
    return folder


@pytest.fixture
def bag(tmp_path) -> Path:
    return write_bag(tmp_path / "input")


@pytest.fixture
def config(tmp_path):
    def write(text: str) -> Path:
        path = tmp_path / "config.yaml"
        path.write_text(text)
        return path

    return write


# --- input that cannot be used ---


def test_each_kind_of_wrong_input_in_a_process_of_its_own(tmp_path, bag, config):
    out = tmp_path / "out"
    (tmp_path / "text.mcap").write_text("This is no bag.\n" * 1000)
    with BagWriter(tmp_path / "other") as writer:
        writer.write(writer.add_topic("/chatter", messages.STRING), 1, 1, messages.encode_string("hello"))
    assert "does not exist" in refused("replay", tmp_path / "none", "-o", out, run=command)
    assert "not an MCAP file" in refused("replay", tmp_path / "text.mcap", "-o", out, run=command)
    assert "/chatter" in refused("replay", tmp_path / "other", "-o", out, run=command)
    assert "radus" in refused("replay", bag, "-o", out, "--config", config("radus: 0.3\n"), run=command)
    assert "-1" in refused("stability", "--speed-rpm", 100, "--config", config("radius: -1\n"), run=command)
    negative_rate = config("/**:\n  ros__parameters:\n    rate_hz: -5.0\n")
    assert "rate_hz" in refused("replay", bag, "-o", out, "--config", negative_rate, run=command)


def test_missing_files(tmp_path, bag):
    assert str(tmp_path / "none") in refused("replay", tmp_path / "none", "-o", tmp_path / "out")
    assert str(tmp_path / "none") in refused("replay", bag, "-o", tmp_path / "out", "--config", tmp_path / "none")
    assert str(tmp_path / "none") in refused("stability", "--speed-rpm", 100, "--config", tmp_path / "none")
    assert str(tmp_path / "none") in refused("import", "--speed", tmp_path / "none", "--speed-columns", "w=a",
                                             "--load", tmp_path / "none", "--load-columns", "b",
                                             "-o", tmp_path / "out")  # fmt: skip
    assert not (tmp_path / "out").exists()


def test_a_text_file_named_mcap(tmp_path):
    (tmp_path / "text.mcap").write_text("This is no bag.\n" * 1000)
    assert "not an MCAP file" in refused("replay", tmp_path / "text.mcap", "-o", tmp_path / "out")


def test_a_bag_without_the_topics_names_those_it_has(tmp_path):
    with BagWriter(tmp_path / "other") as writer:
        writer.write(writer.add_topic("/chatter", messages.STRING), 1, 1, messages.encode_string("hello"))
    line = refused("replay", tmp_path / "other", "-o", tmp_path / "out")
    assert "/load" in line and "/chatter" in line
    assert not (tmp_path / "out").exists()


def test_a_bag_that_is_empty(tmp_path):
    with BagWriter(tmp_path / "empty"):
        pass
    assert "/load" in refused("replay", tmp_path / "empty", "-o", tmp_path / "out")


def test_a_bag_with_times_beyond_those_of_ros(tmp_path):
    encoder = WrenchEncoder("axle")
    with BagWriter(tmp_path / "late") as writer:
        speed = writer.add_topic("/w/wheel_speed", messages.FLOAT64)
        load = writer.add_topic("/w/load", messages.WRENCH_STAMPED)
        for number in range(10):
            now = 2**62 + number * 10_000_000
            writer.write(speed, now, now, encode_float64(1.0))
            writer.write(load, now, now, encoder.encode(BEGIN, 0.0, 1.0))
    refused("replay", tmp_path / "late", "-o", tmp_path / "out")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("radius: -1\n", ["tire.radius", "-1", "> 0"]),
        ("radus: 0.3\n", ["radus", "radius"]),
        ("radius: wide\n", ["tire.radius", "wide"]),
        ("/**:\n  ros__parameters:\n    rate_hz: -5.0\n", ["rate_hz", "-5"]),
        ("/**:\n  ros__parameters:\n    rate_hertz: 5.0\n", ["rate_hertz", "rate_hz"]),
        ("/**:\n  ros__parameters:\n    wheels: [left, left]\n", ["wheels", "twice"]),
        ("/**:\n  ros__parameters:\n    tire: {radus: 0.3}\n", ["tire.radus", "tire.radius"]),
        ("[1, 2]\n", ["config.yaml"]),
        ("a: [\n", ["config.yaml", "YAML"]),
        ("", ["config.yaml"]),
        ("density: 1.0e-300\n", ["together"]),
    ],
)
def test_a_config_that_cannot_be_used(tmp_path, bag, config, text, named):
    path = config(text)
    for line in (
        refused("replay", bag, "-o", tmp_path / "out", "--config", path),
        refused("stability", "--speed-rpm", 1000, "--config", path),
    ):
        for part in named:
            assert part in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--ros-args", "-p", "rate_hz:=-1.0"], ["rate_hz", "-1.0"]),
        (["--ros-args", "-p", "tire.radius:=-1.0"], ["tire.radius", "-1.0", "> 0"]),
        (["--ros-args", "-p", "tire.radius:=-1"], ["tire.radius", "-1"]),
        (["--ros-args", "-p", "tire.radus:=1.0"], ["tire.radus", "tire.radius"]),
        (["--ros-args", "-p", "wheels:=[]"], ["wheels"]),
        (["--ros-args", "-p", "log.directory:=/proc/nowhere"], ["/proc/nowhere"]),
        (["--ros-args", "--params-file", "/nowhere.yaml"], ["/nowhere.yaml"]),
        (["--ros-args", "-p", "rate_hz"], ["rate_hz"]),
        (["--rate", "3"], ["--rate"]),
    ],
)
def test_the_node_too_refuses_with_one_line(ros_domain, arguments, named):
    line = refused("node", *arguments, run=command)
    for part in named:
        assert part in line


def test_the_node_names_the_bad_line_of_a_parameter_file(ros_domain, config):
    path = config("/**:\n  ros__parameters:\n    tire:\n      radus: 0.3\n")
    assert "radus" in refused("node", "--ros-args", "--params-file", path, run=command)
    path = config("/**:\n  ros__parameters:\n    tire: [\n")
    assert path.name in refused("node", "--ros-args", "--params-file", path, run=command)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "COMMAND"),
        (["figure"], "figure"),
        (["replay"], "IN"),
        (["replay", "x"], "--output"),
        (["play", "x", "--rate", "fast"], "fast"),
        (["stability"], "--speed-rpm"),
        (["stability", "--speed-rpm", "nan"], "nan"),
        (["stability", "--speed-rpm", "1e400"], "inf"),
    ],
)
def test_wrong_usage(arguments, named):
    assert named in refused(*arguments)


@pytest.mark.parametrize("rate", ["0", "nan"])
def test_play_refuses_a_rate_that_is_none(ros_domain, bag, rate):
    assert "--rate" in refused("play", bag, "--rate", rate, run=command)


def test_play_refuses_what_is_no_bag(ros_domain, tmp_path):
    (tmp_path / "text.mcap").write_text("This is no bag.\n" * 1000)
    assert "not an MCAP file" in refused("play", tmp_path / "text.mcap", run=command)
    assert str(tmp_path / "none") in refused("play", tmp_path / "none", run=command)


def test_an_output_that_exists_is_kept_unless_forced(tmp_path, bag):
    out = tmp_path / "out"
    assert called("replay", bag, "-o", out).returncode == 0
    before = {path: path.read_bytes() for path in out.iterdir()}
    assert "--force" in refused("replay", bag, "-o", out)
    assert {path: path.read_bytes() for path in out.iterdir()} == before
    assert called("replay", bag, "-o", out, "--force").returncode == 0
    assert {path: path.read_bytes() for path in out.iterdir()} == before  # the same input, the same bytes
    refused("replay", bag, "-o", bag)  # the input itself
    (tmp_path / "file").write_text("mine")
    refused("replay", bag, "-o", tmp_path / "file", "--force")
    assert (tmp_path / "file").read_text() == "mine"


def test_forcing_the_output_over_the_input_does_not_destroy_it(tmp_path, bag):
    done = called("replay", bag, "-o", bag, "--force")
    assert done.returncode in (0, 2)
    from rosbags.rosbag2 import Reader

    with Reader(bag) as reader:  # either refused, or replaced once the whole replay was there
        assert {c.topic for c in reader.connections} >= {"/left/load", "/left/wheel_speed"}


def test_a_disk_that_is_full_is_one_line(tmp_path):
    import resource

    bag = write_bag(tmp_path / "input", seconds=20.0)
    limit = 100_000  # bytes a file may have; to the process it is as if the disk were full

    def fill_up() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    line = refused("replay", bag, "-o", tmp_path / "out", run=command, preexec_fn=fill_up)
    assert str(tmp_path / "out") in line
    assert [path.name for path in tmp_path.iterdir()] == ["input"]


def test_a_bag_whose_inputs_are_never_fresh_says_why(tmp_path):
    encoder = WrenchEncoder("axle")
    with BagWriter(tmp_path / "stale") as writer:
        speed = writer.add_topic("/w/wheel_speed", messages.FLOAT64)
        load = writer.add_topic("/w/load", messages.WRENCH_STAMPED)
        for number in range(100):
            now = BEGIN + number * 10_000_000
            writer.write(speed, now, now, encode_float64(1.0))
            writer.write(load, now, now, encoder.encode(number + 1, 0.0, 4000.0))  # stamps of 1970
    line = refused("replay", tmp_path / "stale", "-o", tmp_path / "out")
    assert "fresh" in line and "w/load 100" in line


# --- stability ---


def test_stability_prints_the_reply_of_the_service():
    done = command("stability", "--speed-rpm", 2000)
    assert (done.returncode, done.stderr) == (0, "")
    reply = json.loads(done.stdout, parse_constant=lambda text: pytest.fail(f"{text} is not JSON"))
    assert list(reply) == [
        "wheel", "speed_rad_s", "period_s", "verdict", "spectral_radius", "multipliers", "exponents_1_s",
        "critical_speed_rad_s",
    ]  # fmt: skip
    assert reply["speed_rad_s"] == pytest.approx(2000.0 * math.pi / 30.0, rel=1e-15)
    assert reply["period_s"] == pytest.approx(0.03, rel=1e-15)
    assert reply["verdict"] == "asymptotically stable"
    moduli = sorted(abs(complex(*pair)) for pair in reply["multipliers"])
    # MODEL.md section 5, six decimals
    assert moduli == pytest.approx([0.476304, 0.476304, 0.613536, 0.613536, 0.687992, 0.687992], abs=5e-7)
    assert reply["spectral_radius"] == max(moduli)
    # mu = exp(lambda T); rounding of exp and of the product
    for exponent, multiplier in zip(reply["exponents_1_s"], reply["multipliers"], strict=True):
        assert abs(np.exp(complex(*exponent) * 0.03) - complex(*multiplier)) < 1e-12
    assert reply["critical_speed_rad_s"] * 30.0 / math.pi == pytest.approx(22_400, abs=50)  # Figure 7


def test_stability_at_standstill_and_backwards():
    still = json.loads(called("stability", "--speed-rpm", 0).stdout)
    assert still["period_s"] is still["multipliers"] is still["spectral_radius"] is None
    assert still["verdict"] == "asymptotically stable"
    assert all(real < 0.0 for real, _ in still["exponents_1_s"])
    back = json.loads(called("stability", "--speed-rpm", "-2000").stdout)
    assert back["spectral_radius"] == pytest.approx(0.687992, abs=5e-7)


def test_stability_takes_either_kind_of_config(config):
    rpm = 8000.0
    # MODEL.md section 4: reaction at zeta_1 = 0.1 loses its stability at 7 986 rpm; section 5: modal at 12 100 rpm.
    path = config("zeta_1: 0.1\nsidewall_damping: reaction\n")
    reply = json.loads(called("stability", "--speed-rpm", rpm, "--config", path).stdout)
    assert reply["verdict"] == "unstable"
    assert reply["critical_speed_rad_s"] * 30.0 / math.pi == pytest.approx(7986, abs=1)
    path = config("/**:\n  ros__parameters:\n    tire: {zeta_1: 0.1}\n    wheels: [a, b]\n")
    reply = json.loads(called("stability", "--speed-rpm", rpm, "--config", path).stdout)
    assert reply["verdict"] == "asymptotically stable"
    unit = TireWheelUnit.table_1(zeta_1=0.1)
    assert reply["spectral_radius"] == wheel.stability(unit, rpm * math.pi / 30.0).spectral_radius


@pytest.mark.parametrize("rpm", ["1e-320", "1e-300", "1e300"])
def test_stability_at_absurd_speeds_is_an_answer_or_a_refusal(rpm):
    done = called("stability", "--speed-rpm", rpm)
    assert done.returncode in (0, 2)
    if done.returncode == 0:
        json.loads(done.stdout, parse_constant=lambda text: pytest.fail(f"{text} is not JSON"))


def test_a_reader_that_goes_away_is_no_error_of_ours():
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [*COMMAND, "stability", "--speed-rpm", "100"],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        stdout=write,
        stderr=subprocess.PIPE,
        text=True,
        timeout=60,
    )
    os.close(write)
    assert "Traceback" not in done.stderr and "Exception" not in done.stderr


# --- what needs no ROS ---

WITHOUT_ROS = """
import sys
from importlib.machinery import PathFinder

class NoRos:  # a machine with no ROS: its packages cannot be found
    @staticmethod
    def find_spec(name, path=None, target=None):
        ros = name.partition(".")[0] in ("rclpy", "rosidl_parser", "rpyutils") or name.split(".")[0].endswith("_msgs")
        return None if ros else PathFinder.find_spec(name, path, target)

sys.meta_path[:] = [NoRos if finder is PathFinder else finder for finder in sys.meta_path]
sys.argv[0] = "tire-dynamics"
from tire_dynamics.doors.cli import main
status = main()
assert "rclpy" not in sys.modules
sys.exit(status)
"""


def without_ros(*arguments) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS, *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        timeout=60,
    )


@pytest.mark.parametrize("name", [None, "replay", "play", "node", "import", "stability"])
def test_help_works_without_ros(name):
    done = without_ros(*([name] if name else []), "--help")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert done.stdout.startswith("usage: tire-dynamics")
    if name is None:
        for listed in ("replay", "play", "node", "import", "stability"):
            assert listed in done.stdout
    if name == "node":
        for parameter in ("rate_hz", "tire.radius", "log.directory"):
            assert parameter in done.stdout


def test_replay_and_stability_work_without_ros(tmp_path, bag):
    done = without_ros("replay", bag, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "metadata.yaml").is_file()
    assert json.loads(without_ros("stability", "--speed-rpm", 100).stdout)["verdict"] == "asymptotically stable"


@pytest.mark.parametrize("arguments", [["node"], ["play", "bag"]])
def test_what_needs_ros_says_so(arguments):
    done = without_ros(*arguments)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "rclpy" in line


# --- progress ---


def test_progress_in_a_terminal_and_none_in_a_pipe(tmp_path):
    bag = write_bag(tmp_path / "input", seconds=12.0)
    piped = command("replay", bag, "-o", tmp_path / "piped")
    assert "%" not in piped.stderr and "\r" not in piped.stderr
    assert len(piped.stderr.splitlines()) <= 1

    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, "replay", str(bag), "-o", str(tmp_path / "shown")],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        stdout=subprocess.PIPE,
        stderr=theirs,
    )
    os.close(theirs)
    shown = b""
    try:
        while block := os.read(ours, 4096):
            shown += block
    except OSError:  # Linux: the other side has been closed
        pass
    finally:
        os.close(ours)
        process.communicate(timeout=60)
    assert process.returncode == 0
    assert b"%" in shown and b"\r" in shown
    shares = [int(part.split(b"%")[0]) for part in shown.split(b"replay: ")[1:] if b"%" in part]
    assert shares == sorted(shares) and shares[-1] <= 100
