"""The command line as its own process: exit statuses, one line for what cannot be used, no ROS where none is needed."""

from __future__ import annotations

import io
import json
import math
import os
import pty
import re
import shlex
import shutil
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest

from tire_dynamics import TireWheelUnit, wheel
from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.cdr import messages
from tire_dynamics.cdr.messages import WrenchEncoder, encode_float64
from tire_dynamics.cli.commands import all_commands
from tire_dynamics.cli.completion import SHELLS
from tire_dynamics.cli.main import main

REPOSITORY = Path(__file__).parents[1]
COMMAND = [sys.executable, "-m", "tire_dynamics.cli.main"]
BEGIN = 1_700_000_000_000_000_000


def command(*arguments, **options) -> subprocess.CompletedProcess:
    """The command as its own process."""
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    return subprocess.run(
        [*COMMAND, *map(str, arguments)], env=environment, capture_output=True, text=True, timeout=300, **options
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
    # The ROS client library says a line of its own, before ours, of arguments that it cannot parse, and the node says
    # that it starts.
    lines = [line for line in done.stderr.splitlines() if "[rcl]" not in line and not line.startswith("[INFO]")]
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


@pytest.mark.slow
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
        ("radius: -1\n", ["tire.radius", "-1", "at least 0.001"]),
        ("radus: 0.3\n", ["radus", "radius"]),
        ("radius: wide\n", ["tire.radius", "wide"]),
        ("/**:\n  ros__parameters:\n    rate_hz: -5.0\n", ["rate_hz", "-5"]),
        ("/**:\n  ros__parameters:\n    rate_hertz: 5.0\n", ["rate_hertz", "rate_hz"]),
        ("/**:\n  ros__parameters:\n    wheels: [left, left]\n", ["wheels", "twice"]),
        ("/**:\n  ros__parameters:\n    tire: {radus: 0.3}\n", ["tire.radus", "tire.radius"]),
        ("[1, 2]\n", ["config.yaml"]),
        ("a: [\n", ["config.yaml", "YAML"]),
        ("", ["config.yaml"]),
        ("density: 1.0e-300\n", ["tire.density", "at least 1"]),
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
        (["--ros-args", "-p", "tire.radius:=-1.0"], ["tire.radius", "-1.0", "at least 0.001"]),
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
        (["figure"], "did you mean figures?"),
        (["--forse"], "--forse"),
        (["nothing like it"], "--help lists them"),
        (["replay", "x", "-o", "y", "--jbos", "3"], "did you mean --jobs?"),
        (["stability", "--speed-rpm", "1", "2"], "'2' is one argument too many"),
        (["replay", "x", "-o", "y", "--jobs", "many"], "--jobs is 'many'; it must be a whole number"),
        (["replay", "x", "-o", "y", "--remap", "load=/x"], "--remap is 'load=/x'; it must be INPUT:=TOPIC"),
        (["completion", "csh"], "csh"),
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


@pytest.mark.slow
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
    assert "w: stamps and times of receipt are of different clocks on its load" in line and "--clock log" in line
    assert called("replay", tmp_path / "stale", "-o", tmp_path / "out", "--clock", "log").returncode == 0


# --- stability ---


@pytest.mark.slow
def test_stability_prints_the_reply_of_the_service():
    done = command("stability", "--speed-rpm", 2000)
    assert (done.returncode, done.stderr) == (0, "")
    reply = json.loads(done.stdout, parse_constant=lambda text: pytest.fail(f"{text} is not JSON"))
    assert list(reply) == [
        "wheel", "speed_rad_s", "period_s", "verdict", "spectral_radius", "multipliers", "exponents_1_s",
        "critical_speed_rad_s", "periodicity", "nearest_tongue_rad_s", "contact", "n_max",
    ]  # fmt: skip
    assert reply["speed_rad_s"] == pytest.approx(2000.0 * math.pi / 30.0, rel=1e-15)
    assert reply["period_s"] == pytest.approx(0.03, rel=1e-15)
    assert reply["verdict"] == "asymptotically stable"
    moduli = sorted(abs(complex(*pair)) for pair in reply["multipliers"])
    # docs/model.md, section 12, six decimals
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


@pytest.mark.slow
def test_stability_lists_the_tongues(config):
    """Six at zeta_1 = zeta_s = 0.05: the threshold of the verdict beside that of the first order, docs/model.md."""
    eps = 0.05
    crosswise = f"[[2, {2 * eps}, 1.5707963267948966]]"
    varying = f"radial_nonuniformity: [[2, {2 * eps}, 0.0]]\ntangential_nonuniformity: {crosswise}\n"
    path = config(f"zeta_1: 0.05\nzeta_s: 0.05\n{varying}")
    reply = json.loads(called("stability", "--speed-rpm", 6000, "--config", path, "--tongues").stdout)
    tongues = reply["tongues"]
    assert [round(each["speed_rad_s"] * 30.0 / math.pi) for each in tongues] == [472, 2592, 3286, 4711, 5406, 6100]
    assert [each["scale"] is None for each in tongues] == [True] * 3 + [False] * 3
    found = [(eps * each["scale_first_order"], eps * each["scale"]) for each in tongues[3:]]
    np.testing.assert_allclose(found, [(0.200, 0.1675), (0.143, 0.1435), (0.103, 0.0899)], atol=5.1e-4)
    assert reply["nearest_tongue_rad_s"] == tongues[-1]["speed_rad_s"]
    assert "--contact" in refused("stability", "--speed-rpm", 6000, "--tongues", "--contact")


def test_stability_takes_either_kind_of_config(config):
    rpm = 8000.0
    # docs/model.md, section 12: at zeta_1 = 0.1 stability is lost at 7986 rpm (reaction) and 12 100 rpm (modal).
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


@pytest.mark.slow
def test_a_reader_that_goes_away_is_no_error_of_ours():
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [*COMMAND, "stability", "--speed-rpm", "100"],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        stdout=write,
        stderr=subprocess.PIPE,
        text=True,
        timeout=300,
    )
    os.close(write)
    assert "Traceback" not in done.stderr and "Exception" not in done.stderr
    assert done.returncode == 128 + signal.SIGPIPE


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
from tire_dynamics.cli.commands import all_commands
from tire_dynamics.cli.completion import SHELLS
from tire_dynamics.cli.main import main
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
        timeout=300,
    )


@pytest.mark.slow
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


@pytest.mark.slow
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


# --- what the help says ---

COMMANDS = all_commands()
NAMES = list(COMMANDS.commands.choices)


def test_the_help_lists_every_command_once_and_the_exit_statuses():
    text = command("--help").stdout
    assert len(NAMES) >= 10
    for name in NAMES:
        assert len(re.findall(rf"^  {name} +\S", text, re.MULTILINE)) == 1
    for status in ("0", "1", "2", "128+N"):
        assert re.search(rf"^  {re.escape(status)} +\S", text, re.MULTILINE)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["", *NAMES])
def test_every_example_in_the_help_is_a_right_call(name):
    text = command(*([name] if name else []), "--help").stdout
    examples = re.findall(r"^  tire-dynamics (.*)$", text.partition("\nexamples:\n")[2], re.MULTILINE)
    assert examples
    for example in examples:
        words = shlex.split(example.partition(" > ")[0])
        assert words[0] == name if name else words[0] in NAMES
        if words[0] != "node":  # what follows is for ROS
            COMMANDS.parse(words)


def test_the_version_is_that_of_the_package():
    import xml.etree.ElementTree as tree

    done = command("--version")
    version = tree.parse(REPOSITORY / "package.xml").getroot().findtext("version")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"tire-dynamics {version}\n"


@pytest.mark.slow
def test_the_page_about_the_commands_has_each_with_right_calls():
    text = (REPOSITORY / "docs" / "command_line.md").read_text("utf-8")
    assert set(re.findall(r"^### (\S+)$", text, re.MULTILINE)) == set(NAMES) - {"completion"}  # it has a chapter
    text, _, wrong = text.partition("## Errors")
    wrong, _, behind = wrong.partition("\n## ")
    calls = re.findall(r"^    (?:\$ )?tire-dynamics (.*)$", text + behind, re.MULTILINE)
    assert len(calls) > 15
    for call in calls:
        words = shlex.split(re.split(r" [|>] ", call)[0])
        if words[0] != "node":
            COMMANDS.parse(words)
    shown = re.search(r"^    \$ tire-dynamics info bags/sample\n(.*?)\n\n\S", text, re.MULTILINE | re.DOTALL)[1]
    done = command("info", "bags/sample", cwd=REPOSITORY)
    assert [line.removeprefix("    ") for line in shown.splitlines()] == done.stdout.splitlines()
    for call, line in re.findall(r"^    \$ tire-dynamics (.*)\n    tire-dynamics: (.*)$", wrong, re.MULTILINE):
        if "--jobs many" in call or call == "stabilty":  # the others need files
            assert refused(*shlex.split(call)) == f"tire-dynamics: {line}"


# --- errors that help ---


def test_a_name_that_is_nearly_right_is_named(tmp_path, bag):
    assert f"did you mean {bag}?" in refused("replay", tmp_path / "inptu", "-o", tmp_path / "out")
    assert f"did you mean {bag}?" in refused("recover", tmp_path / "inptu", "-o", tmp_path / "out")
    assert "nor does the folder" in refused("info", tmp_path / "none" / "input")


def test_what_helps_against_inputs_that_are_never_fresh_helps(tmp_path, bag, config):
    """Joints that are not named like the wheels."""
    joints = messages.JointStateEncoder(["l_wheel_joint"])
    encoder = WrenchEncoder("axle")
    with BagWriter(tmp_path / "joints") as writer:
        speed = writer.add_topic("/joint_states", messages.JOINT_STATE)
        load = writer.add_topic("/left/load", messages.WRENCH_STAMPED)
        for now in range(BEGIN, BEGIN + 10**9, 10**7):
            writer.write(speed, now, now, joints.encode(now, [50.0]))
            writer.write(load, now, now, encoder.encode(now, 0.0, 4000.0))
    line = refused("replay", tmp_path / "joints", "-o", tmp_path / "out")
    assert "joint_names" in line
    joint = re.search(r"--joint \S+", line)[0].split()
    assert called("replay", tmp_path / "joints", "-o", tmp_path / "joint", *joint).returncode == 0
    path = config("/**:\n  ros__parameters:\n    wheels: [left]\n    joint_names: [l_wheel_joint]\n")
    assert called("replay", tmp_path / "joints", "-o", tmp_path / "out", "--config", path).returncode == 0


def test_a_damaged_record_of_parameters_is_helped_by_config(tmp_path, config):
    write_bag(tmp_path / "input")
    with BagWriter(tmp_path / "log") as writer:
        record = writer.add_topic("/tire_dynamics/log_record", messages.STRING)
        speed = writer.add_topic("/left/wheel_speed", messages.FLOAT64)
        load = writer.add_topic("/left/load", messages.WRENCH_STAMPED)
        writer.write(record, BEGIN, BEGIN, messages.encode_string("{"))
        for now in range(BEGIN, BEGIN + 10**9, 10**7):
            writer.write(speed, now, now, encode_float64(50.0))
            writer.write(load, now, now, WrenchEncoder("axle").encode(now, 0.0, 4000.0))
    assert "--config" in refused("replay", tmp_path / "log", "-o", tmp_path / "out")
    path = config("/**:\n  ros__parameters:\n    wheels: [left]\n")
    assert called("replay", tmp_path / "log", "-o", tmp_path / "out", "--config", path).returncode == 0


# --- topics of other names ---


@pytest.mark.slow
def test_a_topic_of_another_name_is_taken_for_an_input(tmp_path, bag):
    """The same messages under other names give the same forces."""
    renamed = {"/left/load": "/sensors/fl", "/left/wheel_speed": "/fl/speed"}
    with BagWriter(tmp_path / "renamed") as writer:
        handles = {}
        for topic, kind, log_time, publish_time, data in BagReader(bag).messages():
            if topic.startswith("/left"):
                if topic not in handles:
                    handles[topic] = writer.add_topic(renamed[topic], kind)
                writer.write(handles[topic], log_time, publish_time, data)
    line = refused("replay", tmp_path / "renamed", "-o", tmp_path / "out")
    assert "--remap wheel/load:=/sensors/fl" in line
    remaps = ("--remap", "left/load:=/sensors/fl", "--remap", "left/wheel_speed:=/fl/speed")
    for out in (("out",), ("many", "--jobs", "1")):
        done = called("replay", tmp_path / "renamed", "-o", tmp_path / out[0], *out[1:], *remaps)
        assert done.returncode == 0, done.stderr
    assert called("replay", bag, "-o", tmp_path / "straight").returncode == 0

    def forces(path: Path) -> list[bytes]:
        return [data for *_, data in BagReader(path).messages(["/left/axle_wrench"])]

    assert len(forces(tmp_path / "out")) > 100
    assert forces(tmp_path / "out") == forces(tmp_path / "many" / "renamed") == forces(tmp_path / "straight")
    again = called("replay", tmp_path / "out", "-o", tmp_path / "again")  # the log knows the names
    assert again.returncode == 0 and forces(tmp_path / "again") == forces(tmp_path / "out")

    assert "/nowhere" in refused("replay", bag, "-o", tmp_path / "x", "--remap", "left/load:=/nowhere")
    assert "no input" in refused("replay", bag, "-o", tmp_path / "x", "--remap", "left/laod:=/left/load")


# --- JSON and quiet ---


def write_csv(folder: Path) -> tuple:
    (folder / "a.csv").write_text("t,v\n0,1\n0.1,2\nx,3\n")
    files = ("--speed", folder / "a.csv", "--load", folder / "a.csv")
    return ("import", *files, "--speed-columns", "w=v", "--load-columns", "v", "-o", folder / "out")


ANSWERS = {
    "replay": (lambda bag, out: ("replay", bag, "-o", out), {"input", "output", "received", "written", "damage"}),
    "several": (lambda bag, out: ("replay", bag, "-o", out, "--jobs", "1"), {"output", "bags", "replayed", "failed"}),
    "recover": (lambda bag, out: ("recover", bag, "-o", out), {"input", "output", "kept", "whole"}),
    "import": (lambda bag, out: write_csv(bag.parent), {"output", "wheels", "speed", "load", "formulas"}),
    "map": (
        lambda bag, out: ("map", "--x", "speed_rpm=0:30000:8", "--y", "zeta_1=0.02:0.2:8", "-o", f"{out}.png"),
        {"output", "numbers", "x", "y", "verdicts", "boundary"},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ANSWERS)
def test_json_is_one_object_on_standard_output_and_quiet_says_nothing(tmp_path, bag, name):
    if name == "map":
        pytest.importorskip("matplotlib", reason="the extra `plot` is not installed")
    call, keys = ANSWERS[name]
    done = called(*call(bag, tmp_path / "out"), "--json")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout, parse_constant=lambda text: pytest.fail(f"{text} is not JSON"))
    assert keys <= set(answer)
    for key in ("output", "numbers"):
        assert key not in answer or Path(answer[key]).exists()
    left_out = ["a.csv: 1 rows left out; the first is line 4: 't' is 'x'"] * 2 if name == "import" else []
    assert done.stderr.splitlines() == left_out  # what is wrong with the input is said in any case
    done = called(*call(bag, tmp_path / "out"), "--quiet", "--force")
    assert (done.returncode, done.stdout, done.stderr.splitlines()) == (0, "", left_out)


@pytest.mark.slow
def test_the_numbers_of_a_replay_are_those_of_its_bag(tmp_path, bag):
    answer = json.loads(called("replay", bag, "-o", tmp_path / "out", "--json").stdout)
    counts = {name.lstrip("/"): count for name, count in BagReader(tmp_path / "out").counts.items()}
    for part in ("received", "written"):
        assert answer[part] == {name: counts[name] for name in answer[part]}
    assert answer["received"]["left/load"] == 100 and answer["written"]["left/axle_wrench"] > 400
    several = json.loads(called("replay", bag, "-o", tmp_path / "many", "--jobs", "1", "--json").stdout)
    (only,) = several["bags"]
    assert only["received"] == sum(answer["received"].values()) and only["written"] == sum(answer["written"].values())


@pytest.mark.slow
def test_of_several_bags_some_that_cannot_be_replayed(tmp_path, bag):
    (tmp_path / "text.mcap").write_text("This is no bag.\n")
    done = called("replay", bag, tmp_path / "text.mcap", "-o", tmp_path / "out", "--json")
    answer = json.loads(done.stdout)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert (answer["replayed"], answer["failed"]) == (1, 1)
    good, bad = answer["bags"]
    assert good["error"] is None and Path(good["output"]).is_dir()
    assert "not an MCAP file" in bad["error"] and bad["output"] is None


# --- completion ---

IN_BASH = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()
function=$(complete -p tire-dynamics | sed 's/.*-F \\([^ ]*\\).*/\\1/')
"$function" tire-dynamics "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.mark.skipif(not shutil.which("bash"), reason="there is no bash here")
def test_completion_in_bash(tmp_path, bag):
    pytest.importorskip("shtab", reason="shtab is not installed")
    script = tmp_path / "completion.sh"
    script.write_text(command("completion", "bash").stdout)

    def completed(*words: str) -> set[str]:
        shell = ["bash", "--norc", "-c", IN_BASH, "bash", str(script), "tire-dynamics", *words]
        done = subprocess.run(shell, cwd=tmp_path, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0 and done.stderr == "", done.stderr
        return set(done.stdout.split())

    assert completed("") == set(NAMES)
    assert completed("rec") == {"recover"}
    assert completed("-") >= {"--help", "--version"}
    options = completed("replay", "--")
    assert options == {
        option
        for action in COMMANDS.commands.choices["replay"]._actions
        for option in action.option_strings
        if option.startswith("--")
    }
    for words in (("info",), ("replay",), ("replay", "input"), ("recover",), ("play",), ("replay", "x", "--config")):
        assert completed(*words, "inp") == {"input"}, words
    assert completed("import", "--speed", "comp") == {"completion.sh"}
    assert completed("map", "--quantity", "st") == {"stability"}
    assert completed("completion", "") == set(SHELLS)


@pytest.mark.parametrize("shell", SHELLS)
def test_each_shell_reads_its_script(tmp_path, shell):
    pytest.importorskip("shtab", reason="shtab is not installed")
    done = command("completion", shell)
    assert done.returncode == 0 and all(name in done.stdout for name in NAMES)
    assert str(REPOSITORY) not in done.stdout
    if shutil.which(shell) is None:
        pytest.skip(f"there is no {shell} here to read it")
    (tmp_path / "script").write_text(done.stdout)
    subprocess.run([shell, "-n", tmp_path / "script"], check=True, timeout=300)


# --- progress ---


def shown_on_a_terminal(text: str, *arguments) -> str:
    """What a piece of Python says on a terminal as its standard error."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", text, *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY), "TERM": "xterm"},
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
        out, _ = process.communicate(timeout=300)
    assert process.returncode == 0 and out == b"", shown
    return shown.decode()


# The command, with a bar however short the work is.
AT_ONCE = """
import sys
from tire_dynamics.files import progress
progress._AFTER = progress._EVERY = 0.0
from tire_dynamics.cli.commands import all_commands
from tire_dynamics.cli.completion import SHELLS
from tire_dynamics.cli.main import main
sys.exit(main())
"""
WORK = """
import sys, time
from tire_dynamics.files.progress import progress
for item in progress(range(10), 10, "work", unit="rows", quiet=sys.argv[1:] == ["quiet"]):
    time.sleep(float(sys.argv[2]) if len(sys.argv) > 2 else 0.1)
"""
WITHOUT_RICH = "import sys\nsys.modules['rich'] = None  # as if it could not be found\n"


@pytest.mark.slow
def test_progress_on_a_terminal_and_none_in_a_pipe(tmp_path, bag):
    piped = command("replay", bag, "-o", tmp_path / "piped")
    assert "%" not in piped.stderr and "\r" not in piped.stderr and "\x1b" not in piped.stderr
    assert len(piped.stderr.splitlines()) == 1

    pytest.importorskip("rich", reason="rich is not installed, and without it there is no bar")
    shown = shown_on_a_terminal(AT_ONCE, "replay", bag, "-o", tmp_path / "out")
    assert re.search(r"replay .*100%.* 400 messages, [\d.]+ ?[kM]?/s", shown)
    assert shown.endswith(piped.stderr.replace("piped", "out").replace("\n", "\r\n"))  # the summary comes last
    assert shown_on_a_terminal(AT_ONCE, "replay", bag, "-o", tmp_path / "out", "--force", "--quiet") == ""


@pytest.mark.slow
def test_the_bar_goes_on_with_the_work():
    pytest.importorskip("rich", reason="rich is not installed, and without it there is no bar")
    shown = shown_on_a_terminal(WORK)
    shares = [int(share) for share in re.findall(r"(\d+)%", shown)]
    assert len(shares) > 2 and shares == sorted(shares) and shares[-1] == 100
    assert "10 rows" in shown
    assert shown_on_a_terminal(WORK, "quiet") == ""
    assert shown_on_a_terminal(WORK, "short", "0.0") == ""  # over before it could be read


@pytest.mark.slow
def test_without_rich_there_is_no_bar_and_nothing_else_is_missing(tmp_path, bag):
    assert shown_on_a_terminal(WITHOUT_RICH + WORK) == ""
    shown = shown_on_a_terminal(WITHOUT_RICH + AT_ONCE, "replay", bag, "-o", tmp_path / "out")
    assert len(shown.splitlines()) == 1 and "400 messages in" in shown


@pytest.mark.slow
def test_in_a_pipe_rich_is_not_even_imported(tmp_path, bag):
    text = (
        "import sys\nfrom tire_dynamics.cli.main import main\n"
        f"assert main(['replay', {str(bag)!r}, '-o', {str(tmp_path / 'out')!r}]) == 0\n"
        f"assert main(['info', {str(bag)!r}]) == 0\n"
        "assert not {'rich', 'shtab', 'rclpy', 'matplotlib'} & set(sys.modules)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    subprocess.run([sys.executable, "-c", text], env=environment, check=True, capture_output=True, timeout=300)
