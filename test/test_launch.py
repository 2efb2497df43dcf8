"""The launch file, executed: what it asks of a node is asked of the real one.

ROS's launch is not on the package index. What the file uses of it is small, and stands here in its place: arguments
that are declared and read, and a node that is recorded instead of started. What was recorded becomes the command line
that launch_ros makes of it, and the real node gets that.
"""

from __future__ import annotations

import ast
import re
import runpy
import sys
import types
from contextlib import ExitStack, contextmanager
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
LAUNCH_FILE = ROOT / "launch" / "tire_dynamics.launch.py"
VEHICLE_YAML = ROOT / "config" / "vehicle.yaml"
WHEELS = ["front_left", "front_right", "rear_left", "rear_right"]

# -- launch and launch_ros, as far as the file needs them --


class Context(dict):
    """The arguments' values by name; remembers which were read."""

    def __init__(self) -> None:
        super().__init__()
        self.read: set[str] = set()

    def __getitem__(self, name: str) -> str:
        self.read.add(name)
        return super().__getitem__(name)


@dataclass
class LaunchConfiguration:
    name: str

    def perform(self, context: Context) -> str:
        return context[self.name]


@dataclass
class FindPackageShare:
    package: str

    def perform(self, context: Context) -> str:
        assert self.package == "tire_dynamics"
        return str(ROOT)  # config/ and launch/ are installed as they stand here


@dataclass
class PathJoinSubstitution:
    parts: list

    def perform(self, context: Context) -> str:
        return "/".join(text(part, context) for part in self.parts)


def text(value: Any, context: Context) -> str:
    return value if isinstance(value, str) else value.perform(context)


@dataclass
class DeclareLaunchArgument:
    name: str
    _: KW_ONLY
    default_value: Any = None
    description: str | None = None
    choices: list[str] | None = None


@dataclass(kw_only=True)
class OpaqueFunction:
    function: Any


@dataclass
class LaunchDescription:
    entities: list


@dataclass(kw_only=True)
class Node:
    package: str
    executable: str
    name: str
    namespace: str
    parameters: list = field(default_factory=list)
    remappings: list = field(default_factory=list)
    output: str = "log"

    def ros_arguments(self, folder: Path) -> list[str]:
        """What launch_ros appends to the command: names, parameter files, remappings; a dict becomes a file."""
        namespace = f"/{self.namespace.lstrip('/')}"
        arguments = ["--ros-args", "-r", f"__node:={self.name}", "-r", f"__ns:={namespace}"]
        for number, parameters in enumerate(self.parameters):
            if isinstance(parameters, dict):
                node = f"{namespace.rstrip('/')}/{self.name}"
                path = folder / f"launch_params_{number}"
                path.write_text(yaml.dump({node: {"ros__parameters": parameters}}), encoding="utf-8")
                parameters = str(path)
            arguments += ["--params-file", parameters]
        for old, new in self.remappings:
            arguments += ["-r", f"{old}:={new}"]
        return arguments


def modules() -> dict[str, types.ModuleType]:
    content = {
        "launch": [LaunchDescription],
        "launch.actions": [DeclareLaunchArgument, OpaqueFunction],
        "launch.substitutions": [LaunchConfiguration, PathJoinSubstitution],
        "launch_ros": [],
        "launch_ros.actions": [Node],
        "launch_ros.substitutions": [FindPackageShare],
    }
    found = {}
    for name, members in content.items():
        found[name] = types.ModuleType(name)
        vars(found[name]).update({member.__name__: member for member in members})
    return found


def description() -> LaunchDescription:
    with pytest.MonkeyPatch.context() as patch:
        for name, module in modules().items():
            patch.setitem(sys.modules, name, module)
        return runpy.run_path(str(LAUNCH_FILE))["generate_launch_description"]()


def declared() -> dict[str, DeclareLaunchArgument]:
    arguments = [entity for entity in description().entities if isinstance(entity, DeclareLaunchArgument)]
    return {argument.name: argument for argument in arguments}


def launched(**given: str) -> tuple[Node, Context]:
    """The node that the file starts with these arguments, and the context in which it did."""
    context, nodes = Context(), []
    for entity in description().entities:
        if isinstance(entity, DeclareLaunchArgument):
            assert entity.name not in context, "declared twice"
            value = given.pop(entity.name, None)
            context.setdefault(entity.name, text(entity.default_value, context) if value is None else value)
            if entity.choices is not None and dict.get(context, entity.name) not in entity.choices:
                raise ValueError(f"{entity.name} is none of {entity.choices}")
        else:
            nodes += entity.function(context)
    assert not given, f"not declared: {set(given)}"
    (node,) = nodes
    return node, context


# -- what the file says --


def test_it_starts_the_executable_that_colcon_installs():
    from test_package import PACKAGE_XML, scripts

    node, _ = launched()
    assert node.package == PACKAGE_XML.findtext("name")
    assert node.executable in scripts("install")
    assert node.output == "screen"


def test_every_argument_is_described_and_used_and_none_is_used_undeclared():
    _, context = launched()  # one that is not declared would be a KeyError
    assert set(declared()) == context.read == set(context)
    assert all(argument.description for argument in declared().values())


def test_ros2_launch_reads_it_without_this_package():
    """`ros2 launch -s` lists the arguments even where a dependency of the package is broken."""
    tree = ast.parse(LAUNCH_FILE.read_text(encoding="utf-8"))
    imported = {node.module.split(".")[0] for node in tree.body if isinstance(node, ast.ImportFrom)}
    assert imported == {"launch", "launch_ros"}
    assert not any(isinstance(node, ast.Import) for node in tree.body)


def test_without_arguments_it_is_the_parameter_file_and_nothing_else():
    node, _ = launched()
    assert [Path(parameters) for parameters in node.parameters] == [VEHICLE_YAML]
    assert node.remappings == []
    assert (node.name, node.namespace) == ("tire_dynamics", "")


@pytest.mark.parametrize("argument", ["load_topic", "load_force_topic", "wheel_speed_topic"])
def test_a_topic_for_all_wheels_at_once_is_refused(argument):
    with pytest.raises(ValueError, match=f"^{argument} is '/ft/wrench'; it must hold {{wheel}}"):
        launched(**{argument: "/ft/wrench"})


@pytest.mark.parametrize("argument", ["use_sim_time", "autostart"])
def test_a_switch_is_true_or_false_or_empty(argument):
    with pytest.raises(ValueError, match=argument):
        launched(**{argument: "yes"})
    for written in ("false", "False", "true", "True"):
        node, _ = launched(**{argument: written})
        assert node.parameters[1] == {argument: written.lower() == "true"}


def test_a_parameter_file_that_is_missing_is_an_error(tmp_path):
    with pytest.raises(ValueError, match=f"^params_file is '{tmp_path}/none.yaml'; there is no such file"):
        launched(params_file=f"{tmp_path}/none.yaml")


@pytest.mark.parametrize(
    ("content", "wheels"),
    [
        ("/**: {ros__parameters: {wheels: [fl, fr]}}", ["fl", "fr"]),
        ("tire_dynamics: {ros__parameters: {wheels: [rl]}}", ["rl"]),
        ("/**: {ros__parameters: {rate_hz: 100.0}}", ["wheel"]),  # the node's own default
    ],
)
def test_the_wheels_of_a_pattern_are_those_of_the_parameter_file(tmp_path, content, wheels):
    file = tmp_path / "car.yaml"
    file.write_text(content, encoding="utf-8")
    node, _ = launched(params_file=str(file), load_topic="/{wheel}_ft/wrench", frame_ids="{wheel}_hub")
    assert node.remappings == [(f"{wheel}/load", f"/{wheel}_ft/wrench") for wheel in wheels]
    assert node.parameters[1] == {"frame_ids": [f"{wheel}_hub" for wheel in wheels]}


@pytest.mark.parametrize("written", ["fl,fr", "fl, fr", "[fl, fr]", " [ fl ,fr, ] "])
def test_a_list_may_be_written_in_several_ways(written):
    node, _ = launched(wheels=written)
    assert node.parameters[1]["wheels"] == ["fl", "fr"]


def test_what_belongs_to_a_wheel_follows_it(tmp_path):
    """Of wheels that the file knows it is the file's, in whatever order they come; of others the default."""
    overrides = launched(wheels="rear_right,front_left")[0].parameters[1]
    assert overrides == {
        "wheels": ["rear_right", "front_left"],
        "joint_names": ["rear_right", "front_left"],
        "frame_ids": ["rear_right_axle", "front_left_axle"],
        "tf.positions": [0.0, -0.775, 0.305, 2.70, 0.775, 0.305],
        "static_loads": [3500.0, 4000.0],
    }
    overrides = launched(wheels="front_right,spare", joint_names="{wheel}_joint")[0].parameters[1]
    assert overrides == {
        "wheels": ["front_right", "spare"],
        "joint_names": ["front_right_joint", "spare_joint"],
        "frame_ids": ["front_right_axle", "spare_axle"],
        "tf.positions": [2.70, -0.775, 0.305, 0.0, 0.0, 0.0],
    }


def test_the_file_is_read_as_ros_reads_it_for_a_node_of_that_name(tmp_path):
    file = tmp_path / "cars.yaml"
    section = "{{ros__parameters: {{wheels: [{0}1, {0}2], joint_names: [{0}_a, {0}_b]}}}}"
    file.write_text(f"/front/tires: {section.format('f')}\n/rear/tires: {section.format('r')}\n", encoding="utf-8")
    given = {"params_file": str(file), "name": "tires", "frame_ids": "{wheel}_hub"}
    for namespace, letter in (("front", "f"), ("/rear", "r"), ("/rear/", "r")):
        node, _ = launched(namespace=namespace, **given)
        assert node.parameters[1] == {"frame_ids": [f"{letter}1_hub", f"{letter}2_hub"]}
        node, _ = launched(namespace=namespace, wheels=f"{letter}2", **given)
        assert node.parameters[1]["joint_names"] == [f"{letter}_b"]


# -- what the real node makes of it --


@contextmanager
def real_node(domain: int, folder: Path, **given: str):
    """The node itself, with the command line that launch would give it."""
    from rclpy.context import Context as RosContext

    from tire_dynamics.ros.node import TireDynamicsNode

    node, _ = launched(**given)
    context = RosContext()
    context.init(args=[], domain_id=domain)
    try:
        real = TireDynamicsNode(context=context, arguments=node.ros_arguments(folder))
        try:
            yield real
        finally:
            real.destroy_node()
    finally:
        context.try_shutdown()


def subscriptions(node) -> set[str]:
    return {name for name, _ in node.get_subscriber_names_and_types_by_node(node.get_name(), node.get_namespace())}


def test_the_node_is_as_the_parameter_file_says_where_nothing_is_given(ros_domain, tmp_path):
    with real_node(ros_domain, tmp_path) as node:
        assert node.get_fully_qualified_name() == "/tire_dynamics"
        assert node.get_parameter("wheels").value == WHEELS
        assert node.get_parameter("log.directory").value == ""
        assert node.get_parameter("use_sim_time").value is False
        loads = {f"/{wheel}/load" for wheel in WHEELS}
        assert {"/joint_states", *loads} <= subscriptions(node)


def test_the_node_has_the_names_and_topics_that_were_asked_for(ros_domain, tmp_path):
    given = {
        "name": "tires",
        "namespace": "car",
        "wheels": "fl,fr,rl,rr",
        "joint_names": "{wheel}_wheel_joint",
        "frame_ids": "hub_1,hub_2,hub_3,hub_4",
        "joint_states_topic": "/joint_state_broadcaster/joint_states",
        "load_topic": "/{wheel}_ft_broadcaster/wrench",
        "load_force_topic": "loads/{wheel}",
        "wheel_speed_topic": "/can/{wheel}/speed",
        "use_sim_time": "true",
        "autostart": "true",
        "log_directory": str(tmp_path / "log"),
        "tf_parent_frame": "base_link",
    }
    assert set(given) == set(declared()) - {"params_file", "inputs_file"}, "an argument is not tried here"
    with real_node(ros_domain, tmp_path, **given) as node:
        assert node.get_fully_qualified_name() == "/car/tires"
        wheels = ["fl", "fr", "rl", "rr"]
        expected = {
            "wheels": wheels,
            "joint_names": [f"{wheel}_wheel_joint" for wheel in wheels],
            "frame_ids": ["hub_1", "hub_2", "hub_3", "hub_4"],
            "use_sim_time": True,
            "autostart": True,
            "log.directory": str(tmp_path / "log"),
            "tf.parent_frame": "base_link",
            "tire.sidewall_damping": "reaction",  # from the parameter file, which is still read
        }
        assert {name: node.get_parameter(name).value for name in expected} == expected
        asked = {
            "/joint_state_broadcaster/joint_states",
            *(f"/{wheel}_ft_broadcaster/wrench" for wheel in wheels),
            *(f"/car/loads/{wheel}" for wheel in wheels),
            *(f"/can/{wheel}/speed" for wheel in wheels),
        }
        assert subscriptions(node) - {"/clock", "/parameter_events"} == asked


def test_a_field_map_beside_the_parameter_file(ros_domain, tmp_path):
    path = tmp_path / "inputs.yaml"
    fields = {"topic": "/hub/speeds", "type": "std_msgs/msg/Float32MultiArray"}
    fields["field"] = [f"data[{index}]" for index in range(4)]
    path.write_text(yaml.dump({"/**": {"ros__parameters": {"inputs": {"speed": fields}}}}))
    with real_node(ros_domain, tmp_path, inputs_file=str(path)) as node:
        assert "/hub/speeds" in subscriptions(node)
        assert node.get_parameter("tire.sidewall_damping").value == "reaction"  # from the parameter file


def test_wheels_alone_make_a_node(ros_domain, tmp_path):
    with real_node(ros_domain, tmp_path, wheels="left,right") as node:
        assert list(node.get_parameter("joint_names").value) == ["left", "right"]
        assert list(node.get_parameter("frame_ids").value) == ["left_axle", "right_axle"]
        assert list(node.get_parameter("tf.positions").value) == [0.0] * 6
        assert {"/left/load", "/right/load"} <= subscriptions(node)


def test_two_cars_side_by_side(ros_domain, tmp_path):
    """Each has its own topics, parameters, diagnostics and log; nothing of one is the other's."""
    with ExitStack() as stack:
        cars = {}
        for name in ("red", "blue"):
            (tmp_path / name).mkdir()
            given = {"namespace": name, "wheels": "left,right", "log_directory": str(tmp_path / "logs")}
            given["frame_ids"] = f"{name}_{{wheel}}_axle"
            cars[name] = stack.enter_context(real_node(ros_domain, tmp_path / name, **given))
        logs = {name: Path(node._journal.log.folder) for name, node in cars.items()}
        assert logs["red"] != logs["blue"] and len(set((tmp_path / "logs").iterdir())) == 2
        for name, node in cars.items():
            assert node.get_fully_qualified_name() == f"/{name}/tire_dynamics"
            loads = {f"/{name}/{wheel}/load" for wheel in ("left", "right")}
            assert subscriptions(node) - {"/parameter_events"} == {
                f"/{name}/joint_states", *loads, *(f"/{name}/{wheel}/load_force" for wheel in ("left", "right")),
                *(f"/{name}/{wheel}/wheel_speed" for wheel in ("left", "right")),
            }  # fmt: skip
            assert node._wheel_status(0).name == f"{name}/tire_dynamics: left"
            assert list(node.get_parameter("frame_ids").value) == [f"{name}_left_axle", f"{name}_right_axle"]


def test_a_log_directory_in_the_home(ros_domain, tmp_path, monkeypatch):
    """No shell puts the home in place of ~ behind `:=`."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    with real_node(ros_domain, tmp_path, log_directory="~/logs"):
        assert len(list((tmp_path / "home" / "logs").iterdir())) == 1 and not (tmp_path / "~").exists()


def test_autostart_false_waits_for_a_lifecycle_manager(ros_domain, tmp_path):
    with real_node(ros_domain, tmp_path, autostart="false") as node:
        assert node.get_parameter("autostart").value is False
        assert not subscriptions(node) & {f"/{wheel}/load" for wheel in WHEELS}


# -- what the documents say of it --

DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
INTEGRATION = (ROOT / "docs" / "integration.md").read_text(encoding="utf-8")


def commands(document: str) -> list[dict[str, str]]:
    """The arguments of every `ros2 launch` of this package."""
    lines = re.findall(r"ros2 launch tire_dynamics tire_dynamics.launch.py(.*)", document)
    return [dict(re.findall(r"(\w+):=(\S+)", line.split("#")[0])) for line in lines]


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", INTEGRATION, re.M | re.S)


def test_every_command_of_the_documents_can_be_typed():
    found = [given for document in DOCUMENTS for given in commands(document.read_text(encoding="utf-8"))]
    assert len(found) > 5 and any("load_topic" in given for given in found), "the search is broken"
    for given in found:
        launched(**given)


def test_the_table_of_arguments_is_complete():
    rows = re.findall(r"^\| (`\w+`.*?) \|", INTEGRATION.split("## ros2_control")[0].split("## One launch")[1], re.M)
    assert set(re.findall(r"`(\w+)`", " ".join(rows))) == set(declared())


def test_the_example_of_ros2_control_fits_together():
    """Controllers, sensors, frames and topics of one example carry each other's names."""
    (controllers,) = (found for text in blocks("yaml") if "controller_manager" in (found := yaml.safe_load(text)))
    declared_there = controllers["controller_manager"]["ros__parameters"]
    broadcasters = {name for name, entry in declared_there.items() if "ForceTorque" in str(entry)}
    assert broadcasters == set(controllers) - {"controller_manager"}
    (given,) = (given for given in commands(INTEGRATION) if "_ft_broadcaster" in given.get("load_topic", ""))
    node, _ = launched(**given)
    assert {new for _, new in node.remappings} == {f"/{name}/wrench" for name in broadcasters}
    (python,) = blocks("python")
    (included,) = (ast.literal_eval(node) for node in ast.walk(ast.parse(python)) if isinstance(node, ast.Dict))
    assert given.items() <= included.items()
    launched(**included)
    frames = plain_parameters(VEHICLE_YAML)["frame_ids"]
    assert [controllers[f"{wheel}_ft_broadcaster"]["ros__parameters"]["frame_id"] for wheel in WHEELS] == frames


def test_the_example_of_nav2_names_this_node():
    (manager,) = (found for text in blocks("yaml") if "lifecycle_manager" in (found := yaml.safe_load(text)))
    node, _ = launched()
    assert manager["lifecycle_manager"]["ros__parameters"]["node_names"] == [node.name]


def plain_parameters(path: Path) -> dict:
    return yaml.safe_load(path.read_text(encoding="utf-8"))["/**"]["ros__parameters"]
