"""bloom, which releases ROS packages, makes Debian packages of ours: what these depend on are packages that exist.

ROS's public lists are read from the excerpt in ``test/rosdistro``, so that this needs no network.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml

pytest.importorskip("bloom", reason="bloom is not installed: `make interop` installs it")

ROOT = Path(__file__).parents[2]
PATIENCE = 600.0


@pytest.fixture(scope="module")
def lists(tmp_path_factory):
    """The environment in which rosdep and bloom know the excerpt, and nothing else."""
    place = tmp_path_factory.mktemp("lists")
    copied = shutil.copytree(ROOT / "test" / "rosdistro", place / "rosdistro")
    distribution = yaml.safe_load((copied / "jazzy" / "distribution.yaml").read_text(encoding="utf-8"))
    cache = {
        "name": "jazzy", "type": "cache", "version": 2, "distribution_file": distribution,
        "release_package_xmls": {}, "source_repo_package_xmls": {},
    }  # fmt: skip
    (copied / "cache.yaml").write_text(yaml.safe_dump(cache), encoding="utf-8")
    entry = {
        "distribution": ["jazzy/distribution.yaml"], "distribution_cache": (copied / "cache.yaml").as_uri(),
        "distribution_status": "active", "distribution_type": "ros2", "python_version": 3,
    }  # fmt: skip
    index = {"distributions": {"jazzy": entry}, "type": "index", "version": 4}
    (copied / "index.yaml").write_text(yaml.safe_dump(index), encoding="utf-8")
    (place / "sources").mkdir()
    (place / "sources" / "20-excerpt.list").write_text(f"yaml {(copied / 'rosdep' / 'excerpt.yaml').as_uri()}\n")
    environment = {
        **os.environ,
        "HOME": str(place), "ROS_HOME": str(place / "ros"),
        "ROSDEP_SOURCE_PATH": str(place / "sources"), "ROSDISTRO_INDEX_URL": (copied / "index.yaml").as_uri(),
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    }  # fmt: skip
    run(["rosdep", "update", "--rosdistro", "jazzy"], place, environment)
    return environment


def run(command: list[str], folder: Path, environment: dict[str, str]) -> str:
    done = subprocess.run(
        command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("folder", [".", "interfaces/tire_dynamics_msgs"])
def test_what_the_debian_package_depends_on_exists(folder, lists, tmp_path):
    for name in ("package.xml", "CHANGELOG.rst", "LICENSE"):
        if (ROOT / folder / name).is_file():
            shutil.copy(ROOT / folder / name, tmp_path)
    generate = ["bloom-generate", "rosdebian", "--os-name", "ubuntu", "--os-version", "noble", "--ros-distro", "jazzy"]
    run(generate, tmp_path, lists)
    control = (tmp_path / "debian" / "control").read_text(encoding="utf-8")
    fields = dict(re.findall(r"^([\w-]+): (.*)$", control, re.MULTILINE))
    package = ElementTree.parse(ROOT / folder / "package.xml").getroot()
    assert fields["Package"] == f"ros-jazzy-{package.findtext('name').replace('_', '-')}"
    assert fields["Homepage"] == package.findtext("url[@type='website']")
    known = yaml.safe_load((ROOT / "test/rosdistro/rosdep/excerpt.yaml").read_text(encoding="utf-8"))
    assert "pip" not in control
    wanted = re.sub(r"\$\{[^}]*\}", "", fields["Depends"])
    names = {name for part in wanted.split(",") if (name := part.split("(")[0].strip())}
    of_ubuntu = {name for rules in known.values() for rule in rules["debian"] for name in [rule]}
    keys = {element.text for element in package if element.tag in ("exec_depend", "depend")}
    assert len(names) == len(keys)
    assert {name for name in names if not name.startswith("ros-jazzy-")} <= of_ubuntu


def test_rosdep_installs_debian_packages_alone(lists, tmp_path):
    """The README's command, on Ubuntu 24.04: what pip would install ends it there."""
    for folder in (".", "interfaces/tire_dynamics_msgs"):
        place = tmp_path / "src" / folder
        place.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / folder / "package.xml", place)
    there = ["--rosdistro", "jazzy", "--os", "ubuntu:noble", "--simulate"]
    said = run(["rosdep", "install", "--from-paths", "src", "-y", *there], tmp_path, lists)
    commands = [line.strip() for line in said.splitlines() if "install" in line]
    assert len(commands) > 20 and all(re.match(r"(sudo -H )?apt-get install -y [\w-]+$", each) for each in commands)
