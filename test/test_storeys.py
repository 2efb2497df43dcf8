"""The rooms of the package and their order: imports point down only, and only ``ros`` knows ROS."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "tire_dynamics"
STOREYS = ["science", "estimator", "files", "cdr", "bag", "replay", "figures", "report", "ros", "cli"]

ROS = re.compile(
    r"rclpy|rpyutils|rosbag2_py|ament_index_python|launch(_\w+)?|(rosidl|tf2)_\w+|\w+_(msgs|srvs|interfaces)"
)
MAY_IMPORT_ROS = {
    *("ros/deferred.py", "ros/demo.py", "ros/node.py", "ros/node_parameters.py", "ros/play.py"),
    "ros/start.py",
}

# In the two lowest rooms everything is a function of its arguments: no clock, no file, no thread, no ROS. This is
# what is allowed there; a list of what is not could never be complete.
PURE = {
    *("__future__", "abc", "array", "bisect", "cmath", "collections", "copy", "dataclasses", "enum"),
    *("functools", "heapq", "itertools", "math", "numbers", "operator", "re", "types", "typing", "warnings"),
    *("struct", "cython", "numpy", "scipy"),
}
# The parameters of a tire come from a file and go into one.
MAY_ALSO_USE = {
    "science/tir_file.py": {"os", "open"},
    "science/tir_unit.py": {"os"},
    "science/unit.py": {"os", "open"},
    "science/yaml_file.py": {"os", "yaml", "open"},
}


def used_names(file: Path, package: Path) -> set[str]:
    """What a file imports, at any depth and by its full name (``from a import b`` is a.b), and ``open``."""
    here = (package.name, *file.relative_to(package).with_suffix("").parts)
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = [*(here[: len(here) - node.level] if node.level else ()), *filter(None, [node.module])]
            names.update(".".join([*base, alias.name]) for alias in node.names)
        elif isinstance(node, ast.Call):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if called in ("import_module", "__import__") and isinstance(node.args[0], ast.Constant):
                names.add(str(node.args[0].value))
            elif called == "open":
                names.add("open")
    return names


def objection(path: str, name: str, package: str) -> str | None:
    """Why the file at ``path`` in the package may not use ``name``; None if it may."""
    storey = path.split("/")[0] if "/" in path else package
    top, *rest = name.split(".")
    if ROS.fullmatch(top):
        return None if path in MAY_IMPORT_ROS else f"only {' and '.join(sorted(MAY_IMPORT_ROS))} know ROS"
    if top == package:
        # `from tire_dynamics import simulate`: the public names are those of the two rooms that are pure.
        target = rest[0] if rest and rest[0] in STOREYS else package
        order = [*STOREYS[:2], package, *STOREYS[2:]]
        return None if order.index(target) <= order.index(storey) else f"{target} is above {storey}"
    if storey in STOREYS[:2] and top not in PURE | MAY_ALSO_USE.get(path, set()):
        return f"{storey} is pure (PURE in {Path(__file__).name} is what that allows)"
    return None


def violations(package: Path) -> list[str]:
    """One line for every forbidden use in a package."""
    found = []
    for file in sorted(package.rglob("*.py")):
        path = file.relative_to(package).as_posix()
        for name in sorted(used_names(file, package)):
            if why := objection(path, name, package.name):
                found.append(f"{path} uses {name}: {why}")
    return found


@pytest.mark.slow
def test_imports_point_down_and_ros_stays_in_its_room():
    assert violations(PACKAGE) == []


@pytest.mark.parametrize("path", [*STOREYS, *sorted(MAY_IMPORT_ROS), *MAY_ALSO_USE])
def test_what_the_rules_name_exists(path):
    assert (PACKAGE / path).exists()


def package_of_one_file(folder: Path, path: str, source: str) -> Path:
    file = folder / "tire_dynamics" / path
    file.parent.mkdir(parents=True)
    file.write_text(source, encoding="utf-8")
    return folder / "tire_dynamics"


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("science/ring.py", "from ..estimator import wheel"),
        ("science/ring.py", "from ..estimator.wheel import step as s"),
        ("science/ring.py", "from .. import cli"),
        ("science/ring.py", "from .. import simulate"),
        ("science/ring.py", "import tire_dynamics"),
        ("science/ring.py", "import tire_dynamics.bag as bag"),
        ("science/ring.py", "def f():\n    from tire_dynamics.estimator import wheel"),
        ("science/ring.py", "from importlib import import_module"),
        ("science/ring.py", "import time"),
        ("science/ring.py", "from pathlib import Path"),
        ("science/ring.py", "import yaml"),
        ("science/ring.py", "import mcap.reader"),
        ("science/ring.py", "def f():\n    return open('x')"),
        ("science/unit.py", "import time"),
        ("science/deep/ring.py", "from ...estimator import wheel"),
        ("science/__init__.py", "from ..estimator import wheel"),
        ("estimator/wheel.py", "from ..bag import reader"),
        ("estimator/wheel.py", "from tire_dynamics import simulate"),
        ("estimator/wheel.py", "from datetime import datetime"),
        ("estimator/wheel.py", "class A:\n    import rclpy.node"),
        ("estimator/wheel.py", "__import__('tire_dynamics.cli')"),
        ("bag/reader.py", "import rclpy"),
        ("bag/reader.py", "from geometry_msgs.msg import WrenchStamped"),
        ("cli/main.py", "def f():\n    from std_srvs.srv import Trigger"),
        ("cli/main.py", "import importlib\nimportlib.import_module('rclpy')"),
        ("__init__.py", "from .cli import main"),
        ("__init__.py", "import rclpy"),
    ],
)
def test_a_forbidden_use_is_found(tmp_path, path, source):
    assert len(violations(package_of_one_file(tmp_path, path, source))) == 1


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("science/ring.py", "import numpy as np\nfrom scipy import optimize\nfrom .unit import Unit"),
        ("science/unit.py", "from os import PathLike\nfrom . import harmonics"),
        ("files/yaml_file.py", "import yaml\nopen('x')"),
        ("estimator/wheel.py", "from ..science import ring\nfrom tire_dynamics.science.unit import Unit"),
        ("bag/reader.py", "import time, mcap\nfrom ..estimator import wheel\nfrom . import log\nopen('x')"),
        ("bag/reader.py", "import rosbags.typesys\nfrom tire_dynamics import simulate"),
        ("ros/node.py", "import rclpy\nfrom std_msgs.msg import Float64"),
        ("ros/play.py", "from rclpy.node import Node"),
        ("__init__.py", "from importlib import import_module\nfrom .estimator.simulate import simulate"),
    ],
)
def test_an_allowed_use_is_not_reported(tmp_path, path, source):
    assert violations(package_of_one_file(tmp_path, path, source)) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "use",
    [
        "import tire_dynamics",
        "from tire_dynamics import *",
        "import sys; sys.argv[1:] = ['--help']; from tire_dynamics.cli.main import main; main()",
    ],
    ids=["import", "every public name", "--help"],
)
def test_ros_is_loaded_only_by_its_room(use):
    script = f"""
import sys
try:
    exec({use!r})
except SystemExit as end:  # --help may end this way
    assert not end.code, end.code
print("loaded:", *sorted({{name.partition(".")[0] for name in sys.modules}}))
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    label, *loaded = run.stdout.splitlines()[-1].split()
    assert label == "loaded:" and "tire_dynamics" in loaded
    assert [name for name in loaded if ROS.fullmatch(name)] == []
