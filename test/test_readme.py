"""The quick starts of the README, command by command as they stand there, but for installing."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from simulated_car import Car, Drive, simulate_drives

from tire_dynamics import read_vehicle
from tire_dynamics.bag import BagReader
from tire_dynamics.cdr.messages import decode_wrench

pytestmark = pytest.mark.slow

REPOSITORY = Path(__file__).parents[1]
PATIENCE = 180.0  # [s] after which what should have happened has not


def blocks(page: str, heading: str) -> list[tuple[str, str]]:
    """Language and text of the fenced blocks under a heading, without the lines that install."""
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    start = re.search(rf"^(#+) {re.escape(heading)}$", text, re.MULTILINE)
    assert start, f"{page} has no heading {heading!r}"
    rest = text[start.end() :]
    end = re.search(rf"^#{{1,{len(start[1])}}} ", rest, re.MULTILINE)
    fenced = re.findall(r"^```(\w+)\n(.*?)^```$", rest[: end.start() if end else None], re.MULTILINE | re.DOTALL)
    without = [
        (language, re.sub(r"^pip install .*\n", "", content, flags=re.MULTILINE)) for language, content in fenced
    ]
    return [(language, content) for language, content in without if content.strip()]


def environment() -> dict[str, str]:
    """The commands of this interpreter, and the package as it stands here."""
    scripts = Path(sys.executable).parent
    if not (scripts / "tire-dynamics").exists():
        pytest.skip("the command tire-dynamics is not installed beside this Python")
    return {**os.environ, "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(REPOSITORY)}


def run(language: str, content: str, folder: Path) -> str:
    """What a block prints; an error if any of its commands fails."""
    command = {"sh": ["sh", "-ec", content], "python": [sys.executable, "-c", content]}[language]
    done = subprocess.run(command, cwd=folder, env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, f"{content}\n{done.stdout}{done.stderr}"
    return done.stdout


def table(file: Path) -> np.ndarray:
    return np.genfromtxt(file, delimiter=",", names=True)


def test_a_csv_file(tmp_path):
    if find_spec("plotly") is None:
        pytest.skip("plotly is not installed: the extra `report` brings it")
    parts = [*blocks("README.md", "With a CSV file"), *blocks("docs/recordings.md", "Out again")]
    assert [language for language, _ in parts] == ["python", "sh", "python", "python"]
    for language, content in parts:
        run(language, content, tmp_path)
    assert "</html>" in (tmp_path / "report.html").read_text(encoding="utf-8")[-100:]
    drive, axle, forces = (table(tmp_path / name) for name in ("drive.csv", "axle.csv", "forces.csv"))
    assert (axle["time_s"] == drive["time_s"]).all()
    # Reaction damping carries the mean load whole, but for what the momentum of some 20 kg changes in 20 s.
    assert axle["force_z_n"].mean() == pytest.approx(drive["load_n"].mean(), rel=1e-4)
    # The node holds the samples that `simulate` joins by lines, so it is half a sample, 1 ms, behind: that is all.
    assert len(forces) == pytest.approx(len(axle), abs=2)
    behind, apart = (
        np.std(forces["force_z_n"] - np.interp(forces["time_s"] - lag, axle["time_s"], axle["force_z_n"]))
        for lag in (0.0, 1e-3)
    )
    assert behind == pytest.approx(1e-3 * np.gradient(axle["force_z_n"], axle["time_s"]).std(), rel=0.1)
    assert apart < 0.2 * behind


def test_an_imu_and_wheel_speeds_alone(tmp_path):
    """The load that speeding up moves to the rear, m a h/L; roughly, for this body does not pitch as a car's does."""
    (tmp_path / "config").symlink_to(REPOSITORY / "config")
    for language, content in blocks("README.md", "With an IMU and wheel speeds alone"):
        run(language, content, tmp_path)
    found = {}
    for topic, _, _, stamp, data in BagReader(tmp_path / "car_forces").messages(
        [f"/{wheel}/load_estimate" for wheel in ("front_left", "rear_left")]
    ):
        found.setdefault(topic, []).append((stamp * 1e-9, decode_wrench(data).fz))
    front, rear = (np.array(found[f"/{wheel}/load_estimate"]) for wheel in ("front_left", "rear_left"))
    late = front[:, 0] > front[0, 0] + 5.0
    along = 2.0 * np.sin(0.5 * front[late, 0])
    moved = np.polyfit(along, front[late, 1] - rear[late, 1], 1)[0]  # both axles' change, of one side [kg]
    car = read_vehicle(REPOSITORY / "config" / "car.yaml")
    mass, unsprung = car.sprung_mass, sum(car.unsprung_masses)
    height = (mass * car.cg_height + unsprung * car.unsprung_height) / (mass + unsprung)
    assert moved == pytest.approx(-(mass + unsprung) * height / car.wheelbase, rel=0.3)


def test_loads_of_csv_files_as_their_page_has_it(tmp_path):
    if find_spec("matplotlib") is None:
        pytest.skip("matplotlib is not installed: the extra `plot` brings it")
    (tmp_path / "config").symlink_to(REPOSITORY / "config")
    (tmp_path / "drive").mkdir()
    drive = simulate_drives(Car(), [Drive(duration=4.0, bump=0.0)], [1])[0]
    time, force, rate = drive.imu
    imu = "ax_m_s2,ay_m_s2,az_m_s2,roll_rate_rad_s,pitch_rate_rad_s,yaw_rate_rad_s"
    speeds = ",".join(f"speed_{wheel}_rad_s" for wheel in ("fl", "fr", "rl", "rr"))
    for name, names, columns in (("imu", imu, (time, force, rate)), ("wheel_speed", speeds, drive.wheel_speed)):
        rows = np.column_stack(columns)
        np.savetxt(tmp_path / "drive" / f"{name}.csv", rows, delimiter=",", header=f"time_s,{names}", comments="")
    for language, content in blocks("docs/loads.md", "A car with an IMU and wheel speeds alone"):
        run(language, content, tmp_path)
    loads = table(tmp_path / "drive_loads" / "loads.csv")
    found = BagReader(tmp_path / "forces").messages(["/rear_right/axle_wrench"])
    forces = [decode_wrench(data).fz for *_, data in found]
    # reaction damping carries the mean load whole, but for the momentum of the wheel
    assert np.mean(forces) == pytest.approx(loads["load_rr_n"].mean(), rel=0.02)


def test_the_numbers_of_the_paper(tmp_path):
    [content] = [content for language, content in blocks("README.md", "With the paper") if language == "python"]
    said = re.findall(r"^print\(.*\)  # (.*)$", content, re.MULTILINE)
    assert said and run("python", content, tmp_path).splitlines() == said


@pytest.mark.nightly  # and by .ci/run, which types it
def test_the_pictures_of_the_paper(tmp_path):
    if find_spec("matplotlib") is None:
        pytest.skip("matplotlib is not installed: the extra `plot` brings it")
    [content] = [content for language, content in blocks("README.md", "With the paper") if language == "sh"]
    run("sh", content, tmp_path)
    for picture in ("figures/fig3.png", "figures/fig7b.png", "map.png", "response.png"):
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")


@contextmanager
def started(command: str, folder: Path):
    """A command that runs until it is stopped, as Ctrl-C stops it."""
    process = subprocess.Popen(["sh", "-c", f"exec {command}"], cwd=folder, env=environment())
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(PATIENCE)
        finally:
            process.kill()
            process.wait()


def test_a_ros_2_stack(ros_domain, tmp_path):
    pytest.importorskip("rclpy")
    from geometry_msgs.msg import WrenchStamped
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

    for name in ("bags", "config"):
        (tmp_path / name).symlink_to(REPOSITORY / name)
    node, play, info = (content.strip() for _, content in blocks("README.md", "Beside a ROS 2 stack"))
    context = Context()
    context.init(args=[], domain_id=ros_domain)
    peer = Node("peer", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(peer)
    wrenches: list[WrenchStamped] = []
    peer.create_subscription(WrenchStamped, "/front_left/axle_wrench", wrenches.append, 10)
    try:
        with started(node, tmp_path) as live, started(play, tmp_path):
            limit = peer.get_clock().now().nanoseconds + int(PATIENCE * 1e9)
            while len(wrenches) < 100 and peer.get_clock().now().nanoseconds < limit:
                executor.spin_once(timeout_sec=0.1)
        assert len(wrenches) >= 100, f"no forces within {PATIENCE:g} s"
        assert live.returncode == 0
    finally:
        executor.shutdown()
        peer.destroy_node()
        context.try_shutdown()
    assert wrenches[-1].header.frame_id == "front_left_axle"
    assert wrenches[-1].wrench.force.z > 1000.0  # of a car that weighs 15 000 N
    said = run("sh", info, tmp_path)
    assert re.search(r"/front_left/axle_wrench +geometry_msgs/WrenchStamped", said)
    assert "whole       yes" in said


def test_what_is_installed_exists():
    """The extras that the pages name are those of the package."""
    known = set(
        re.findall(r'^        "(\w+)": \[', (REPOSITORY / "setup.py").read_text(encoding="utf-8"), re.MULTILINE)
    )
    pages = [REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md", *(REPOSITORY / "docs").rglob("*.md")]
    for page in pages:
        for names in re.findall(r"pip install '(?:\.|tire_dynamics)\[([\w,]+)\]'", page.read_text(encoding="utf-8")):
            assert set(names.split(",")) <= known, f"{page.name} installs {names}"


def test_the_heading_of_a_block_is_where_it_ends(tmp_path, monkeypatch):
    """Of the reader of pages itself: the next heading of the same rank ends a part, a lower one does not."""
    fences = "# A\n~sh\none\n~\n## B\n~python\npip install it\ntwo\n~\n### C\n~sh\nthree\n~\n## D\n~sh\nfour\n~\n"
    (tmp_path / "page.md").write_text(fences.replace("~", "```"))
    monkeypatch.setattr(sys.modules[__name__], "REPOSITORY", tmp_path)
    assert blocks("page.md", "B") == [("python", "two\n"), ("sh", "three\n")]
