"""Interface packages, built for the tests against the ROS that is there, as ``colcon build`` would."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = (
    ROOT / "interfaces" / "tire_dynamics_msgs",
    ROOT / "test" / "interfaces" / "tf2_msgs",
    ROOT / "test" / "interfaces" / "four_wheel_msgs",
)
PATIENCE = 1800.0  # [s] for a step of it, on a machine however slow


def _key() -> str:
    """Of all that the build is made from."""
    found = hashlib.sha256(f"{sys.version} {sys.prefix}".encode())
    files = [file for package in PACKAGES for file in package.rglob("*") if file.is_file()]
    for file in sorted([*files, ROOT / "interfaces" / "wheels.cmake"]):
        found.update(f"{file.relative_to(ROOT)}\n".encode() + file.read_bytes())
    return found.hexdigest()[:16]


def built() -> Path:
    """The folder into which the packages are installed; they are built once, whoever asks how often."""
    missing = [tool for tool in ("cmake", "c++") if shutil.which(tool) is None]
    if missing:
        pytest.skip(f"{' and '.join(missing)} not found: interface packages need CMake and a C++ compiler")
    folder = ROOT / "build" / "interfaces" / _key()
    folder.parent.mkdir(parents=True, exist_ok=True)
    with open(folder.with_suffix(".lock"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # pytest-xdist asks from several processes
        if not folder.is_dir():
            work = folder.with_suffix(".making")
            shutil.rmtree(work, ignore_errors=True)
            for package in PACKAGES:
                _build(package, work)
            work.rename(folder)
    return folder


def _build(package: Path, work: Path) -> None:
    make = ["-G", "Ninja"] if shutil.which("ninja") else []
    place = work / "build" / package.name
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "AMENT_PREFIX_PATH": os.pathsep.join(filter(None, [os.environ.get("AMENT_PREFIX_PATH", ""), sys.prefix])),
        "CMAKE_PREFIX_PATH": os.pathsep.join(filter(None, [os.environ.get("CMAKE_PREFIX_PATH", ""), sys.prefix])),
    }
    configure = [
        "cmake", "-S", package, "-B", place, *make, f"-DCMAKE_INSTALL_PREFIX={work}",
        f"-DPython3_EXECUTABLE={sys.executable}", f"-DCMAKE_PROJECT_INCLUDE={ROOT / 'interfaces' / 'wheels.cmake'}",
    ]  # fmt: skip
    for command in (configure, ["cmake", "--build", place, "--parallel"], ["cmake", "--install", place]):
        run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)
        if run.returncode:
            pytest.fail(f"{package.name}: {run.stdout[-4000:]}\n{run.stderr[-4000:]}")


def sourced(prefix: Path) -> dict[str, str]:
    """The environment of a shell that has sourced the workspace."""
    packages = sysconfig.get_path("purelib", vars={"base": str(prefix), "platbase": str(prefix)})
    added = {
        "AMENT_PREFIX_PATH": f"{prefix}{os.pathsep}{sys.prefix}",
        "LD_LIBRARY_PATH": str(prefix / "lib"),
        "PYTHONPATH": packages,
    }
    return {
        **os.environ,
        **{name: os.pathsep.join(filter(None, [value, os.environ.get(name)])) for name, value in added.items()},
    }
