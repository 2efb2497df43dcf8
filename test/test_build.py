"""The compiled core as it is built and shipped, and its source run interpreted: the same bits."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

from tire_dynamics.build_state import CORE, how_to_compile, is_compiled

ROOT = Path(__file__).parents[1]
SOURCES = [Path(*module.split(".")).with_suffix(".py") for module in CORE]
SUFFIX = sysconfig.get_config_var("EXT_SUFFIX")

# Prints whether it ran compiled, and the bits of everything that the core does.
RUN = """
import hashlib
import numpy as np
from tire_dynamics import LoadFilter, TireWheelUnit, VehicleParameters, build_state, simulate
from tire_dynamics.cdr import messages
from tire_dynamics.replay.pipeline import Pipeline

random, bits = np.random.default_rng(1), hashlib.sha256()
wrench, names = messages.WrenchEncoder("contact"), ("left", "right")
joints = messages.JointStateEncoder(names)
varying = {"tire.radial_nonuniformity": [2.0, 0.1, 0.4], "tire.imbalance_mass": 0.05}
for extra in ({}, {"tire.radial_runout": [1.0, 5e-4, 0.3], **varying}, {"tire.longitudinal_stiffness": 2e5}):
    pipeline = Pipeline({"wheels": ["left", "right"], "ring_samples": 5, "n_max": 4, **extra})
    for k in range(1, 30):
        now = k * 2_000_000
        if k % 5 == 1:
            pipeline.receive("joint_states", now, joints.encode(now, random.uniform(50.0, 90.0, 2).tolist()))
        pipeline.receive("left/load", now, wrench.encode(now - 300_000, 10.0, float(random.uniform(3e3, 5e3))))
        pipeline.receive("right/load_force", now, messages.encode_float64(float(random.uniform(3e3, 5e3))))
        for topic, data in pipeline.tick(now) + pipeline.belts():
            bits.update(topic.encode() + data)
damped = {"tire.residual_damping": 60.0, "tire.longitudinal_stiffness": 2e5}
uneven = {"tire.radial_nonuniformity": [1.0, 0.1, 0.4], "tire.tangential_nonuniformity": [2.0, 0.1, 0.0]}
for extra in ({"tire.radial_runout": [1.0, 5e-4, 0.3]}, damped, {"contact_points": 4, **uneven}):
    pipeline = Pipeline({
        "wheels": ["left", "right"], "ring_samples": 5, "n_max": 4, "load_source": "road", "static_loads": [4e3, 3e3],
        "tire.vertical_stiffness": 2e5, "tire.contact_half_angle": 0.15, "tire.sprung_mass": 350.0, **extra,
    })
    for k in range(1, 30):
        now = k * 2_000_000
        if k % 5 == 1:
            pipeline.receive("joint_states", now, joints.encode(now, random.uniform(50.0, 90.0, 2).tolist()))
        for wheel in ("left", "right"):
            height = messages.encode_float64(float(random.normal(0.0, 0.02)))
            pipeline.receive(f"{wheel}/road_height", now - 300_000, height)
        for topic, data in pipeline.tick(now) + pipeline.belts():
            bits.update(topic.encode() + data)
car = {
    "sprung_mass": 1320.0, "unsprung_masses": [42.0] * 4, "wheelbase": 2.7, "front_axle_to_cg": 1.25,
    "tracks": [1.5, 1.6], "cg_height": 0.54, "unsprung_height": 0.31, "roll_inertia": 480.0, "pitch_inertia": 2100.0,
    "roll_centre_heights": [0.06, 0.11], "spring_rates": [26e3] * 4, "damper_bump": [1500.0] * 4,
    "damper_rebound": [2600.0] * 4, "anti_roll_rates": [14e3, 7e3],
}
for given in ("imu", "wheel_speed", "imu travel", "imu travel hub wheel_speed"):
    loads = LoadFilter(VehicleParameters.from_mapping(car))
    for k in range(1, 30):
        now, few = k * 2_000_000, random.normal(0.0, 1.0, (4, 4))
        few[few > 1.5] = np.nan
        if "imu" in given:
            loads.add_imu(now - 500_000, [few[0, 0], few[0, 1], 9.8 + few[0, 2]], [0.1 * few[0, 3], 0.0, few[1, 0]])
        if "travel" in given:
            loads.add_travel(now - 3_000_000 * (k % 3), 0.02 * few[1])
        if "hub" in given:
            loads.add_hub(now, 9.8 + 5.0 * few[2])
        if "wheel_speed" in given:
            loads.add_wheel_speed(now, 50.0 + few[3])
        if loads.advance(now):
            bits.update(loads.load.tobytes() + loads.standard_deviation.tobytes())
time = np.arange(0.0, 0.05, 1e-3)
road = simulate(
    TireWheelUnit.table_1(zeta_s=0.3, contact_half_angle=0.15, vertical_stiffness=2e5), time, 60.0 + 100.0 * time,
    road=0.02 * np.sin(90.0 * time), static_load=4000.0, n_max=4, contact_points=5,
)
bits.update(road.axle_force.tobytes() + road.contact_force.tobytes())
axle = simulate(TireWheelUnit.table_1(zeta_s=0.3), time, 60.0 + 100.0 * time, 4000.0 + 300.0 * np.sin(40.0 * time))
bits.update(axle.axle_force.tobytes())
print(build_state.is_compiled(), bits.hexdigest())
"""

# Put before RUN: of tire_dynamics the sources are found alone, compiled or not.
SOURCE_ONLY = """
import sys
from importlib.machinery import FileFinder, SourceFileLoader

sources = FileFinder.path_hook((SourceFileLoader, [".py"]))

def hook(path):
    # the package and its own packages; a clone and what is installed in it may lie below a folder of that name
    if "tire_dynamics" not in path.replace("\\\\", "/").rstrip("/").split("/")[-2:]:
        raise ImportError
    return sources(path)

sys.path_hooks.insert(0, hook)
"""


def environment(**changes: str) -> dict[str, str]:
    """Without what would steer the compiler or the imports."""
    kept = {name: value for name, value in os.environ.items() if name not in ("CC", "CFLAGS", "PYTHONPATH")}
    return {**kept, **changes}


def output(*command: str | Path, **changes: str) -> str:
    """What a command prints on both its outputs; it has to succeed."""
    done = subprocess.run(
        [str(part) for part in command], env=environment(**changes), cwd=changes.get("PWD"), text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    assert done.returncode == 0, f"{command}\n{done.stdout}"
    return done.stdout


def run_here(before: str = "") -> list[str]:
    return output(sys.executable, "-W", "error", "-c", before + RUN, PWD=str(ROOT)).split()


def copy_of_the_source(folder: Path) -> Path:
    left_out = shutil.ignore_patterns(
        ".git", ".venv", ".*_cache", ".hypothesis", "__pycache__", "*.egg-info", "*.so", "build", "install", "log",
        "dist", "runs", "site",
    )  # fmt: skip
    return Path(shutil.copytree(ROOT, folder, ignore=left_out))


def empty_environment(folder: Path) -> Path:
    """The Python of a virtual environment that has this one's packages, but not tire_dynamics."""
    output(sys.executable, "-m", "venv", "--without-pip", folder)
    python = folder / "bin" / "python"
    packages = Path(output(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
    # The lines of a .pth are folders; the .pth files in those, of editable installations, are not read.
    (packages / "others.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    return python


def pip(*arguments: str | Path, **changes: str) -> str:
    return output(sys.executable, "-m", "pip", "--disable-pip-version-check", *arguments, **changes)


# -- the modules --


def test_what_is_written_for_cython_is_compiled():
    written = [file for file in (ROOT / "tire_dynamics").rglob("*.py") if file.read_bytes().startswith(b"# cython:")]
    assert sorted(written) == sorted(ROOT / source for source in SOURCES)


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.stem)
def test_no_compiled_file_is_older_than_its_source(source):
    """It would be imported all the same: `make .venv/ready` compiles it again."""
    compiled = (ROOT / source).with_suffix(SUFFIX)
    if is_compiled():
        assert compiled.stat().st_mtime >= (ROOT / source).stat().st_mtime
    else:
        assert not compiled.exists()


@pytest.mark.slow
def test_the_source_interpreted_has_the_bits_of_the_compiled_core():
    if not is_compiled():
        pytest.skip(how_to_compile())
    here, interpreted = run_here(), run_here(SOURCE_ONLY)
    assert (here[0], interpreted[0]) == ("True", "False")
    assert interpreted[1] == here[1]


# -- without a compiler --


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "said"),
    [({"PATH": "/nonexistent"}, "No C compiler: "), ({"CC": "/bin/false"}, "Not compiled when it was installed: ")],
    ids=["no compiler", "a compiler that fails"],
)
def test_an_installation_without_a_compiler_runs_interpreted(tmp_path, changes, said):
    """Half a minute each on a slow machine: an environment and an installation."""
    source, python = copy_of_the_source(tmp_path / "source"), empty_environment(tmp_path / "venv")
    log = pip(
        "--python", python, "install", "--no-deps", "--no-build-isolation", "--no-index", "-v", source, **changes
    )  # fmt: skip
    [line] = [line.strip() for line in log.splitlines() if "runs interpreted" in line]
    assert line.startswith(said) and "install again" in line
    assert output(python, "-c", RUN, PWD=str(tmp_path), **changes).split() == ["False", run_here()[1]]
    state = subprocess.run(
        [python, "-m", "tire_dynamics.build_state"], env=environment(**changes), cwd=tmp_path, capture_output=True
    )
    assert (state.returncode, state.stdout.decode().strip()) == (1, line), "the same line at every start"


# -- with one --


@pytest.mark.slow
@pytest.mark.parametrize("optimised", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_a_wheel_from_the_source_archive_runs_compiled_where_no_compiler_is(tmp_path, optimised):
    """The core is compiled once more, in an environment that pip makes for it.

    By day the compiler gets an ``-O0`` behind the flags, which halves the time; the flags are asserted on the
    command as it came from setup.py, and the bits are those of the optimised core all the same.
    """
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip(how_to_compile())
    quick = tmp_path / "cc"
    quick.write_text(f'#!/bin/sh\nexec {compiler} "$@" -O0\n', encoding="utf-8")
    quick.chmod(0o755)
    source, python = copy_of_the_source(tmp_path / "source"), empty_environment(tmp_path / "venv")
    output(sys.executable, "setup.py", "--quiet", "sdist", "--dist-dir", tmp_path, PWD=str(source))
    [archive] = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as tar:
        names = {name.partition("/")[2] for name in tar.getnames()}
    carried = {
        *("Makefile", "README.md", "docs/model.md", "docs/map.png", "bags/sample/metadata.yaml", "benchmarks/step.py"),
        *("config/vehicle.yaml", "launch/tire_dynamics.launch.py", "test/conftest.py", "test/interop/read_log.cjs"),
        *(source.as_posix() for source in SOURCES),
    }
    carried |= set(re.findall(r"\]\(((?!https?:|#)[^)#]+)", (ROOT / "README.md").read_text(encoding="utf-8")))
    assert carried <= names, "what the README names is there"
    assert [name for name in names if name.endswith((".c", ".so"))] == []

    log = pip("wheel", "--no-deps", "-v", "--wheel-dir", tmp_path, archive, **({} if optimised else {"CC": str(quick)}))
    for source in SOURCES:  # the last of several flags counts
        [command] = re.findall(rf".* -c \S*/{source.stem}\.c .*", log)
        flags = command.split()
        assert [flag for flag in flags if flag.startswith("-ffp-contract")][-1] == "-ffp-contract=off"
        assert [flag for flag in flags if flag.startswith("-O")][-1] == "-O3"
        assert [flag for flag in flags if "fast-math" in flag] == ["-fno-fast-math"]
        assert [flag for flag in flags if flag.startswith(("-march", "-mcpu", "-mtune"))] == []

    [wheel] = tmp_path.glob("*.whl")
    python_tag, abi, platform = wheel.stem.split("-")[-3:]
    assert python_tag.startswith("cp") and abi != "none" and platform != "any"
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    assert {source.with_suffix(SUFFIX).as_posix() for source in SOURCES} <= names
    assert {source.as_posix() for source in SOURCES} <= names  # tracebacks show its lines
    assert [name for name in names if name.endswith(".c")] == []

    pip("--python", python, "install", "--no-deps", "--no-index", wheel)
    assert output(python, "-c", RUN, PWD=str(tmp_path), PATH="/nonexistent").split() == ["True", run_here()[1]]


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.stem)
def test_nothing_is_counted_from_its_end(source):
    """Without wraparound a compiled index of -1 reads what lies before the first element."""
    for node in ast.walk(ast.parse((ROOT / source).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Subscript) and not isinstance(node.slice, ast.Slice):
            parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
            negative = [part for part in parts if isinstance(part, ast.UnaryOp) and isinstance(part.op, ast.USub)]
            assert not negative, ast.unparse(node)
