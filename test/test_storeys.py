"""The rooms of the package and their order, read from the code.

Imports point down only, from a room to those below it; no files import one another in a circle; no module takes a
private name of another; files, clocks and ROS stay where they belong.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "tire_dynamics"

ROOMS = ("science", "estimator", "files", "cdr", "bag", "replay", "figures", "report", "ros", "cli")
"""From the lowest to the highest."""

PUBLIC = 3  # the package's own names, which stand in no room, come from so many of them

ROS = re.compile(
    r"rclpy|rpyutils|rosbag2_py|ament_index_python|launch(_\w+)?|(rosidl|tf2)_\w+|\w+_(msgs|srvs|interfaces)"
)
KNOWS_ROS = "ros"

ARE_PURE = ("science", "estimator")
# In these rooms everything is a function of its arguments: no clock, no file, no thread, no ROS. This is
# what is allowed there; a list of what is not could never be complete.
PURE = {
    *("__future__", "abc", "array", "bisect", "cmath", "collections", "copy", "dataclasses", "enum"),
    *("functools", "heapq", "itertools", "math", "numbers", "operator", "re", "types", "typing", "warnings"),
    *("struct", "cython", "numpy", "scipy"),
}


@dataclass(frozen=True)
class Use:
    """A name of another module, by its full name, that a module imports at any depth or reads of an imported one."""

    name: str
    imported: bool = True


def module_name(file: Path, package: Path) -> str:
    parts = (package.name, *file.relative_to(package).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def uses(file: Path, package: Path) -> set[Use]:
    """What a file uses: ``from a import b`` is a.b; ``import a`` and then a._b is a and a._b; ``open`` is itself."""
    here = (package.name, *file.relative_to(package).with_suffix("").parts)
    tree = ast.parse(file.read_text(encoding="utf-8"))
    found, modules = set(), {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found.update(Use(alias.name) for alias in node.names)
            modules.update({alias.asname or alias.name: alias.name for alias in node.names})
        elif isinstance(node, ast.ImportFrom):
            base = [*(here[: len(here) - node.level] if node.level else ()), *filter(None, [node.module])]
            for alias in node.names:
                found.add(Use(".".join([*base, alias.name])))
                modules[alias.asname or alias.name] = ".".join([*base, alias.name])
        elif isinstance(node, ast.Call):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if called in ("import_module", "__import__") and isinstance(node.args[0], ast.Constant):
                found.add(Use(str(node.args[0].value)))
            elif called == "open":
                found.add(Use("open"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in modules:
            found.add(Use(f"{modules[node.value.id]}.{node.attr}", imported=False))
    return found


def place(module: str) -> float:
    """How high a module stands; what is in no room stands above those that are public, ``__main__`` above all."""
    room = module.split(".")[1] if "." in module else ""
    if room == "__main__":
        return len(ROOMS)
    return ROOMS.index(room) if room in ROOMS else PUBLIC - 0.5


def home(name: str, modules: dict[str, Path]) -> str | None:
    """The module of the package that a full name is, or belongs to."""
    while name and name not in modules:
        name = name.rpartition(".")[0]
    return name or None


def objections(package: Path) -> Iterator[str]:
    """One line for each use that the rules forbid, and for each circle."""
    modules = {module_name(file, package): file for file in sorted(package.rglob("*.py"))}
    imports: dict[str, set[str]] = {}
    for module, file in modules.items():
        room = module.split(".")[1] if "." in module else ""
        imports[module] = set()
        for use in sorted(uses(file, package), key=lambda use: use.name):
            top = use.name.partition(".")[0]
            target = home(use.name, modules) if top == package.name else None
            private = [part for part in use.name.split(".") if re.match(r"_(?!_)", part)]
            if private and target is not None and target != module:
                yield f"{module} uses {use.name}: a private name of another module"
            if not use.imported:
                continue
            if top == package.name:
                if place(use.name if "." in use.name else package.name) > place(module):
                    yield f"{module} imports {use.name}: it stands higher"
                elif target is not None and target != module:
                    imports[module].add(target)
            elif ROS.fullmatch(top):
                if room != KNOWS_ROS:
                    yield f"{module} imports {use.name}: only {KNOWS_ROS} knows ROS"
            elif room in ARE_PURE and top not in PURE:
                yield f"{module} uses {use.name}: {room} is pure (PURE in {Path(__file__).name} is what that allows)"
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as circle:
        yield f"a circle: {' imports '.join(reversed(circle.args[1]))}"


@pytest.mark.slow
def test_the_package_keeps_the_rules():
    assert list(objections(PACKAGE)) == []


LONG = 600  # lines


def test_a_file_that_is_long_says_why():
    """In its docstring, and in docs/architecture.md, which lists those files and no others."""
    sources = {file.relative_to(PACKAGE).as_posix(): file.read_text(encoding="utf-8") for file in PACKAGE.rglob("*.py")}
    long = {name for name, source in sources.items() if source.count("\n") >= LONG}
    page = (PACKAGE.parent / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = page.partition("## Files that are long\n")[2].partition("|---|")[2]
    listed = re.findall(r"`(\w+/\w+[.]py)`", table)
    assert sorted(listed) == sorted(long)
    for name in long:
        assert "The file is long because" in (ast.get_docstring(ast.parse(sources[name])) or ""), name


def test_every_folder_is_a_room():
    assert {file.parent.name for file in PACKAGE.glob("*/__init__.py")} == set(ROOMS)


def package_of(folder: Path, **sources: str) -> Path:
    """A package whose modules are named as ``science_ring``; ``root`` is its ``__init__``."""
    package = folder / "tire_dynamics"
    for name, source in {"root": "", "files_errors": "", "cdr_messages": "", **sources}.items():
        room, _, module = name.partition("_")
        file = package / room / f"{module}.py" if module else package / "__init__.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(source, encoding="utf-8")
    return package


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("science_ring", "from ..estimator import wheels"),
        ("science_ring", "from ..estimator.wheels import step as s"),
        ("science_ring", "from .. import cli"),
        ("science_ring", "from .. import simulate"),
        ("science_ring", "import tire_dynamics"),
        ("science_ring", "import tire_dynamics.bag as bag"),
        ("science_ring", "def f():\n    from tire_dynamics.estimator import wheels"),
        ("science_ring", "from importlib import import_module"),
        ("science_ring", "import time"),
        ("science_ring", "from pathlib import Path"),
        ("science_ring", "import yaml"),
        ("science_ring", "def f():\n    return open('x')"),
        ("estimator_wheels", "from ..bag import reader"),
        ("estimator_wheels", "from tire_dynamics import simulate"),
        ("estimator_wheels", "from datetime import datetime"),
        ("estimator_wheels", "__import__('tire_dynamics.cli')"),
        ("files_errors", "from ..bag import BagReader"),
        ("cdr_messages", "if TYPE_CHECKING:\n    from ..replay.pipeline import Pipeline"),
        ("bag_reader", "import rclpy"),
        ("figures_drawings", "from ..cli.response import Bode"),
        ("report_page", "from ..ros.log import Log"),
        ("replay_pipeline", "from geometry_msgs.msg import WrenchStamped"),
        ("cli_main", "def f():\n    from std_srvs.srv import Trigger"),
        ("cli_main", "import importlib\nimportlib.import_module('rclpy')"),
        ("cli_main", "from ..files import errors\nprint(errors._secret)"),
        ("ros_markers", "from ..cdr.messages import _BODY"),
        ("root", "from .cli import main"),
        ("root", "import rclpy"),
    ],
)
def test_a_forbidden_use_is_found(tmp_path, module, source):
    assert len(list(objections(package_of(tmp_path, **{module: source})))) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("science_ring", "import numpy as np\nfrom scipy import optimize\nfrom .unit import Unit"),
        ("science_ring", "import numpy as np\nnp._private = 1"),
        ("files_yaml", "import yaml, os\nopen('x')"),
        ("estimator_wheels", "from ..science import ring\nfrom tire_dynamics.science.unit import Unit"),
        ("bag_reader", "import time, mcap\nfrom ..estimator import wheels\nfrom . import chunks\nopen('x')"),
        ("replay_replay", "import rosbags.typesys\nfrom tire_dynamics import simulate\nfrom ..bag import BagReader"),
        ("ros_node", "import rclpy\nfrom std_msgs.msg import Float64"),
        ("cli_main", "from ..ros.play import play"),
        ("root", "from importlib import import_module\nfrom .estimator.simulate import simulate"),
    ],
)
def test_an_allowed_use_is_not_reported(tmp_path, module, source):
    assert list(objections(package_of(tmp_path, **{module: source}))) == []


@pytest.mark.parametrize(
    "sources",
    [
        {"science_wheel": "from . import maps", "science_maps": "def f():\n    from . import wheel"},
        {"science_a": "from .b import x", "science_b": "from .c import x", "science_c": "from .a import x"},
        {"cli_a": "if TYPE_CHECKING:\n    from .b import B", "cli_b": "from . import a"},
    ],
)
def test_a_circle_is_found(tmp_path, sources):
    [line] = objections(package_of(tmp_path, **sources))
    assert line.startswith("a circle: ")


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
