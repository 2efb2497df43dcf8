"""The files around the code - package.xml, setup.py, the launch file, the configurations - agree with it."""

from __future__ import annotations

import ast
import dataclasses
import re
import runpy
import sys
import types
import xml.etree.ElementTree as ElementTree
from importlib import import_module
from pathlib import Path

import pytest
import yaml

import tire_dynamics
from tire_dynamics import TireWheelUnit
from tire_dynamics.doors.parameters import PARAMETERS, complete

ROOT = Path(__file__).parents[1]


def setup_arguments(*commands: str) -> dict:
    """What setup.py hands to setuptools when it is run with these commands."""
    arguments: dict = {}
    setuptools = types.ModuleType("setuptools")
    setuptools.setup = arguments.update
    setuptools.find_packages = lambda include: include
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "setuptools", setuptools)
        patch.setattr(sys, "argv", ["setup.py", *commands])
        patch.chdir(ROOT)
        runpy.run_path("setup.py")
    return arguments


SETUP = setup_arguments("bdist_wheel")
PACKAGE_XML = ElementTree.parse(ROOT / "package.xml").getroot()

# The rosdep key that installs each distribution of the package index, where it is not python3-<name>.
ROSDEP_KEYS = {
    "pyyaml": "python3-yaml",
    "mcap": "mcap-ros2-support",
    "lz4": "mcap-ros2-support",
    "zstandard": "mcap-ros2-support",
    "rosbags": "python3-rosbags-pip",
}


def rosdep_keys(requirements: list[str]) -> set[str]:
    names = [re.match(r"[\w.-]+", requirement).group().lower() for requirement in requirements]
    return {ROSDEP_KEYS.get(name, f"python3-{name}") for name in names}


def declared(tag: str) -> set[str]:
    return {element.text for element in PACKAGE_XML.findall(tag)}


@pytest.mark.parametrize("field", ["name", "version", "license", "maintainer"])
def test_package_xml_and_setup_py_agree(field):
    assert PACKAGE_XML.findtext(field) == SETUP[field]


def test_the_package_is_what_they_say():
    assert PACKAGE_XML.get("format") == "3"
    assert PACKAGE_XML.findtext("export/build_type") == "ament_python"
    assert tire_dynamics.__name__ == PACKAGE_XML.findtext("name")
    assert tire_dynamics.__version__ == PACKAGE_XML.findtext("version")
    assert PACKAGE_XML.find("maintainer").get("email") == SETUP["maintainer_email"]
    licence = (ROOT / PACKAGE_XML.find("license").get("file")).read_text(encoding="utf-8")
    assert licence.split()[:4] == ["Apache", "License", "Version", "2.0,"]


def test_rosdep_installs_what_pip_installs():
    python_keys = rosdep_keys(SETUP["install_requires"] + SETUP["extras_require"]["plot"])
    assert python_keys <= declared("exec_depend")
    ros_keys = declared("exec_depend") - python_keys
    assert [key for key in ros_keys if key.startswith("python3-") or key in ROSDEP_KEYS.values()] == []
    assert declared("test_depend") <= rosdep_keys(SETUP["extras_require"]["test"])
    assert "python3-pytest" in declared("test_depend")  # colcon runs pytest where the extra `test` names it


def test_every_package_that_the_code_uses_is_declared():
    imported, messages = set(), set()
    for file in [*(ROOT / "tire_dynamics").rglob("*.py"), *(ROOT / "launch").glob("*.py")]:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported.update(alias.name.split(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add(node.module.split(".")[0])
            elif isinstance(node, ast.Constant) and re.fullmatch(r"\w+/(msg|srv)/\w+", str(node.value)):
                messages.add(node.value.split("/")[0])
    imported -= {"tire_dynamics", *sys.stdlib_module_names}
    optional = [*SETUP["extras_require"]["fast"], *SETUP["extras_require"].get("cluster", [])]
    imported -= {re.split(r"[^a-z]", requirement)[0] for requirement in optional}  # nobody needs these
    assert {"launch", "numpy", "yaml"} <= imported and "geometry_msgs" in messages, "the search is broken"
    keys = {name: {name, f"python3-{name}", ROSDEP_KEYS.get(name, name)} for name in imported | messages}
    assert [name for name, possible in keys.items() if not possible & declared("exec_depend")] == []


def test_every_folder_of_modules_is_a_package():
    """One without __init__.py works in a checkout, and would be missing from what pip and colcon install."""
    folders = {file.parent for file in (ROOT / "tire_dynamics").rglob("*.py")}
    assert [folder for folder in folders if not (folder / "__init__.py").is_file()] == []


def test_what_ros_looks_up_is_installed_where_it_looks():
    data_files = SETUP["data_files"]
    installed = {f"{folder}/{Path(file).name}": file for folder, files in data_files for file in files}
    name = PACKAGE_XML.findtext("name")
    assert {
        f"share/ament_index/resource_index/packages/{name}",
        f"share/{name}/package.xml",
        f"share/{name}/config/table_1.yaml",
        f"share/{name}/config/sros2/tire_dynamics.policy.xml",
        f"share/{name}/config/vehicle.yaml",
        f"share/{name}/launch/tire_dynamics.launch.py",
    } == set(installed)
    assert all((ROOT / file).is_file() for file in installed.values())


def scripts(*commands: str) -> dict[str, str]:
    """Names and targets of the scripts that setup.py makes."""
    made = setup_arguments(*commands)["entry_points"]["console_scripts"]
    return dict(script.split(" = ") for script in made)


def test_colcon_makes_the_executables_of_ros2_run_and_pip_leaves_the_name_node_to_node_js():
    assert set(scripts("install")) == set(scripts("develop")) == {"tire-dynamics", "node"}
    assert set(scripts("bdist_wheel")) == set(scripts("editable_wheel")) == {"tire-dynamics"}


@pytest.mark.parametrize("script", ["tire-dynamics", "node"])
def test_a_script_starts_a_function_that_exists(script):
    module, function = scripts("install")[script].split(":")
    assert callable(getattr(import_module(module), function))


# -- the launch file: ROS's launch is not on the package index, so that the file is read here and not run --

LAUNCH = ast.parse((ROOT / "launch" / "tire_dynamics.launch.py").read_text(encoding="utf-8"))


def launch_calls(name: str) -> list[ast.Call]:
    calls = [node for node in ast.walk(LAUNCH) if isinstance(node, ast.Call)]
    return [call for call in calls if isinstance(call.func, ast.Name) and call.func.id == name]


def test_launch_starts_the_executable_of_this_package():
    [node] = launch_calls("Node")
    given = {keyword.arg: keyword.value for keyword in node.keywords}
    assert ast.literal_eval(given["package"]) == PACKAGE_XML.findtext("name")
    assert ast.literal_eval(given["executable"]) in scripts("install")


def test_launch_uses_the_arguments_that_it_declares():
    names = {
        name: {ast.literal_eval(call.args[0]) for call in launch_calls(name)}
        for name in ("DeclareLaunchArgument", "LaunchConfiguration")
    }
    arguments = {"params_file", "name", "namespace", "use_sim_time", "log_directory"}
    assert names == {"DeclareLaunchArgument": arguments, "LaunchConfiguration": arguments}


def test_launch_finds_its_default_parameter_file():
    [path] = launch_calls("PathJoinSubstitution")
    share, *parts = path.args[0].elts
    assert ast.literal_eval(share.args[0]) == PACKAGE_XML.findtext("name")
    assert (ROOT / Path(*map(ast.literal_eval, parts))).is_file()


def test_launch_sets_parameters_that_the_node_has():
    targets = [target for node in ast.walk(LAUNCH) if isinstance(node, ast.Assign) for target in node.targets]
    names = {ast.literal_eval(target.slice) for target in targets if isinstance(target, ast.Subscript)}
    assert names == {"use_sim_time", "log.directory"}
    assert "log.directory" in {parameter.name for parameter in PARAMETERS}  # use_sim_time is rclpy's own


# -- the configurations --


def flat(tree: dict, prefix: str = "") -> dict:
    """Nested parameters under their dotted names."""
    found = {}
    for name, value in tree.items():
        found |= flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return found


def plain_yaml(name: str) -> dict:
    """As any YAML 1.1 reader takes it: a number without a dot or without a signed exponent is text."""
    return yaml.safe_load((ROOT / "config" / name).read_text(encoding="utf-8"))


VEHICLE = flat(plain_yaml("vehicle.yaml")["/**"]["ros__parameters"])


def test_table_1_yaml_holds_every_field_of_table_1():
    assert TireWheelUnit.from_yaml(ROOT / "config" / "table_1.yaml") == TireWheelUnit.table_1()
    assert plain_yaml("table_1.yaml") == dataclasses.asdict(TireWheelUnit.table_1())


def test_vehicle_yaml_holds_parameters_of_the_node():
    assert set(VEHICLE) <= {parameter.name for parameter in PARAMETERS}
    accepted = complete(VEHICLE)  # raises ValueError for a value of the wrong type or out of its range
    assert accepted["wheels"] == tuple(VEHICLE["wheels"])


def test_vehicle_yaml_is_table_1_but_for_the_damping_of_a_car():
    tire = {name.removeprefix("tire."): value for name, value in VEHICLE.items() if name.startswith("tire.")}
    assert tire == dataclasses.asdict(TireWheelUnit.table_1(zeta_s=0.3, sidewall_damping="reaction"))


def test_vehicle_yaml_has_four_wheels_with_a_joint_and_a_frame_each():
    wheels = VEHICLE["wheels"]
    assert wheels == ["front_left", "front_right", "rear_left", "rear_right"]
    assert len(set(VEHICLE["joint_names"])) == 4
    assert VEHICLE["frame_ids"] == [f"{wheel}_axle" for wheel in wheels]


def test_ros_reads_vehicle_yaml_as_it_is_meant(ros_domain):
    """rcl reads YAML in its own way; a float that it took for an integer or for text would be refused."""
    from rclpy.context import Context
    from rclpy.node import Node

    arguments = ["--ros-args", "--params-file", str(ROOT / "config" / "vehicle.yaml")]
    context = Context()
    context.init(args=arguments, domain_id=ros_domain)
    try:
        node = Node("any", context=context, automatically_declare_parameters_from_overrides=True)
        read = {name: node.get_parameter(name).value for name in VEHICLE}
        node.destroy_node()
    finally:
        context.shutdown()
    assert [(name, type(value), value) for name, value in read.items()] == [
        (name, type(value), value) for name, value in VEHICLE.items()
    ]
