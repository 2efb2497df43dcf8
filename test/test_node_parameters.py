"""The node's parameters as ROS's tools use them: list, get, describe, set, dump and load, and a start with a dump.

ros2cli is not on the package index. What its verb ``param`` does with rclpy stands here: ``dump`` lists, gets, and
writes YAML; ``load`` reads a file with rclpy's own function, and sets each parameter by itself.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from lifecycle_msgs.msg import Transition
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rclpy.parameter import Parameter, get_parameter_value, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import ReliabilityPolicy
from test_lifecycle import change
from test_node import Bench

from tire_dynamics.bag import BagReader
from tire_dynamics.bag.writer import offered_qos
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay.parameters import PARAMETERS, complete, read_config

CONFIG = Path(__file__).parents[1] / "config" / "vehicle.yaml"
LISTS = [row.name for row in PARAMETERS if row.kind in ("double[]", "double | double[]", "string | string[]")]
UNBOUNDED = {"boolean", "string", "string[]", "double[]", "double | double[]", "string | string[]"}


def client_of(one: Bench, node: str = "") -> AsyncParameterClient:
    client = AsyncParameterClient(one.peer, node or one.node.get_fully_qualified_name())
    one.until(client.services_are_ready, "the node's parameter services")
    return client


def dump(one: Bench, path: Path, node: str = "") -> Path:
    """What ``ros2 param dump`` prints, as a file; of the bench's node, or of one that runs elsewhere."""
    client, tree = client_of(one, node), {}
    names = sorted(one.result(client.list_parameters([], 0)).result.names)
    values = one.result(client.get_parameters(names)).values
    assert len(names) == len(values), "one that is not set hides all the others from rclpy's service"
    for name, value in zip(names, values, strict=True):
        branch, *parts = tree, *name.split(".")
        for part in parts[:-1]:
            branch = branch.setdefault(part, {})
        branch[parts[-1]] = parameter_value_to_python(value)
    node = node or one.node.get_fully_qualified_name()
    path.write_text(yaml.dump({node: {"ros__parameters": tree}}, default_flow_style=False))
    return path


def load(one: Bench, path: Path) -> list:
    """What ``ros2 param load`` does; the results, each with a reason where it failed."""
    return one.result(client_of(one).load_parameter_file(str(path), use_wildcard=True)).results


def values_of(one: Bench) -> dict:
    """Every parameter that is listed, as it is read."""
    client = client_of(one)
    names = sorted(one.result(client.list_parameters([], 0)).result.names)
    values = one.result(client.get_parameters(names)).values
    return dict(zip(names, map(parameter_value_to_python, values), strict=True))


def set_typed(one: Bench, name: str, text: str):
    """What ``ros2 param set`` does with a text that was typed."""
    message = ParameterMessage(name=name, value=get_parameter_value(text))
    (result,) = one.result(client_of(one).set_parameters([Parameter.from_parameter_msg(message)])).results
    return result


# -- dump and load --

NODES = {
    "as it comes": [],
    "a car": ["--params-file", str(CONFIG), "-r", "__ns:=/car"],
    "a tire that varies": ["-p", "tire.radial_nonuniformity:=[2.0, 0.05, 1.2]", "-p", "use_sim_time:=true"],
    "on the road": ["-p", "load_source:=road", "-p", "static_loads:=[4000.0]", "-p", "tire.sprung_mass:=350.0"],
    "a field map": [
        "-p", "inputs.speed.topic:=/hub/speeds", "-p", "inputs.speed.type:=std_msgs/msg/Float32MultiArray",
        "-p", "inputs.speed.field:=data[0]", "-p", "inputs.speed.sign:=-1.0",
    ],  # fmt: skip
    "QoS": ["-p", "qos_overrides./wheel/load.subscription.reliability:=reliable"],
}


@pytest.mark.parametrize("arguments", NODES.values(), ids=NODES)
def test_a_node_that_starts_with_a_dump_is_the_same_node(bench, tmp_path, arguments):
    one = bench(*arguments)
    path, before, pipeline = dump(one, tmp_path / "dump.yaml"), values_of(one), one.node._pipeline.values
    one.close()
    name = [part for part in arguments if part.startswith("__ns")]
    again = bench("--params-file", str(path), *(["-r", *name] if name else []))
    assert values_of(again) == before
    assert again.node._pipeline.values == pipeline
    assert dump(again, tmp_path / "again.yaml").read_text() == path.read_text()
    assert complete(read_config(path)) == pipeline  # `replay --config`


def test_a_dump_of_an_unconfigured_node_configures_it(bench, tmp_path):
    one = bench("-p", "autostart:=false", "-p", "wheels:=[left, right]")
    path = dump(one, tmp_path / "dump.yaml")
    assert yaml.safe_load(path.read_text())["/tire_dynamics"]["ros__parameters"]["joint_names"] == []
    one.close()
    again = bench("--params-file", str(path))
    assert change(again, Transition.TRANSITION_CONFIGURE)
    assert again.get("joint_names") == ["left", "right"]


@pytest.mark.parametrize("managed", [False, True])
def test_load_takes_a_dump_of_the_same_node_and_changes_what_may(bench, tmp_path, managed):
    one = bench("-p", f"autostart:={'false' if managed else 'true'}", "-p", "wheels:=[left, right]")
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE) if managed else ():
        assert change(one, transition)
    path, before = dump(one, tmp_path / "dump.yaml"), values_of(one)
    assert [result.reason for result in load(one, path) if not result.successful] == []
    assert values_of(one) == before

    path.write_text(path.read_text().replace("zeta_s: 0.05", "zeta_s: 0.25"))
    assert [result.reason for result in load(one, path) if not result.successful] == []
    assert values_of(one) == {**before, "tire.zeta_s": 0.25}

    path.write_text(path.read_text().replace("rate_hz: 500.0", "rate_hz: 400.0"))
    (refused,) = [result.reason for result in load(one, path) if not result.successful]
    assert "rate_hz" in refused
    assert values_of(one) == {**before, "tire.zeta_s": 0.25}


def test_load_takes_the_parameter_file_of_the_car_that_runs(bench):
    one = bench("--params-file", str(CONFIG))
    assert [result.reason for result in load(one, CONFIG) if not result.successful] == []


# -- what is empty, and null --


@pytest.mark.parametrize("text", ["[]", "null", "~"])
def test_empty_lists_and_null_are_the_default(bench, tmp_path, text):
    path = tmp_path / "given.yaml"
    names = [*LISTS, *(["log.directory", "rate_hz", "model", "wheels", "autostart"] if text != "[]" else [])]
    path.write_text("/**:\n  ros__parameters:\n" + "".join(f"    {name}: {text}\n" for name in names))
    one = bench("--params-file", str(path))
    assert one.node._pipeline.values == complete({}) == complete(read_config(path))
    found = values_of(one)
    assert all(list(found[name]) == [] for name in LISTS if name != "tf.positions")
    assert [result.reason for result in load(one, path) if not result.successful] == []
    assert set_typed(one, "tire.radial_nonuniformity", "[2.0, 0.05, 1.2]").successful
    assert set_typed(one, "tire.radial_nonuniformity", text).successful
    assert list(one.get("tire.radial_nonuniformity")) == []


@pytest.mark.parametrize("name", ["rate_hz", "model", "autostart", "wheels", "n_max"])
def test_an_empty_list_is_no_number_and_no_wheels(bench, name):
    with pytest.raises(InputError, match=rf"{name} is \[\]"):
        bench("-p", f"{name}:=[]")


# -- descriptors --


@pytest.mark.parametrize("state", ["unconfigured", "inactive", "active"])
def test_descriptors_have_useful_ranges_in_every_state_and_hold(bench, state):
    one = bench("-p", f"autostart:={'true' if state == 'active' else 'false'}")
    if state == "inactive":
        assert change(one, Transition.TRANSITION_CONFIGURE)
    client = client_of(one)
    names = [row.name for row in PARAMETERS]
    descriptors = one.result(client.describe_parameters(names)).descriptors
    before = values_of(one)
    for row, descriptor in zip(PARAMETERS, descriptors, strict=True):
        assert not descriptor.dynamic_typing and descriptor.description == row.description
        assert descriptor.read_only == (row.read_only and state == "active")
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        if row.kind in UNBOUNDED:
            assert ranges == []
            continue
        (span,) = ranges
        assert span.from_value <= row.default <= span.to_value
        # what a person can use, and no bounds of doubles
        assert abs(span.to_value) <= 1e10 and (span.from_value == 0.0 or abs(span.from_value) >= 1e-9), row.name
        for value in (span.from_value - 1, span.to_value + max(1, abs(span.to_value) // 1000)):
            assert not set_typed(one, row.name, repr(value)).successful, (row.name, value)
        kind = ParameterType.PARAMETER_STRING
        wrong = Parameter.from_parameter_msg(
            ParameterMessage(name=row.name, value=ParameterValue(type=kind, string_value="wide"))
        )
        (result,) = one.result(client.set_parameters([wrong])).results
        assert not result.successful
    assert values_of(one) == before


@pytest.mark.parametrize("autostart", ["true", "false"])
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("tire.radius", "-0.3"), ("tire.radius", ".nan"), ("tire.radius", "1"), ("tire.thickness", "0.4"),
        ("tire.zeta_1", "1.0"), ("tire.sidewall_damping", "paper"), ("tire.radial_nonuniformity", "[1.0, 2.0]"),
        ("tire.density", "1.0e-300"), ("log.compression", "zip"), ("wheels", "left"), ("no_such", "1.0"),
    ],
)  # fmt: skip
def test_unconfigured_it_refuses_what_it_refuses_later(bench, autostart, name, text):
    one = bench("-p", f"autostart:={autostart}")
    before = values_of(one)
    assert not set_typed(one, name, text).successful
    assert values_of(one) == before


# -- QoS --


def test_qos_overrides_are_applied(bench, tmp_path):
    path = tmp_path / "qos.yaml"
    path.write_text(
        yaml.dump(
            {
                "/**": {
                    "ros__parameters": {
                        "use_sim_time": False,
                        "qos_overrides": {
                            "/clock": {"subscription": {"depth": 1}},
                            "/hub/load": {"subscription": {"reliability": "reliable", "depth": 7}},
                            "/wheel/axle_wrench": {"publisher": {"reliability": "best_effort"}},
                            "/diagnostics": {"publisher": {"durability": "transient_local"}},
                        },
                    }
                }
            }
        )
    )
    one = bench("--params-file", str(path), "-r", "wheel/load:=/hub/load")
    peer = one.peer
    one.until(lambda: peer.count_subscribers("/hub/load") and peer.count_publishers("/wheel/axle_wrench"), "topics")
    one.until(lambda: peer.count_publishers("/diagnostics") and peer.count_subscribers("/joint_states"), "topics")
    (load,) = peer.get_subscriptions_info_by_topic("/hub/load")
    (joints,) = peer.get_subscriptions_info_by_topic("/joint_states")
    (wrench,) = peer.get_publishers_info_by_topic("/wheel/axle_wrench")
    (belt,) = peer.get_publishers_info_by_topic("/wheel/ring_shape")
    assert load.qos_profile.reliability == wrench_of(belt) == ReliabilityPolicy.RELIABLE
    assert joints.qos_profile.reliability == wrench_of(wrench) == ReliabilityPolicy.BEST_EFFORT
    refused = one.set("qos_overrides./hub/load.subscription.depth", 9)
    assert not refused.successful and "read-only" in refused.reason
    assert one.set("qos_overrides./hub/load.subscription.depth", 7).successful  # as it is


def test_a_log_says_the_qos_that_was_used(bench, tmp_path):
    """In the channels and in metadata.yaml: of inputs, what was subscribed with."""
    given = [
        "/hub/load.subscription.reliability:=reliable", "/hub/load.subscription.depth:=7",
        "/hub/load.subscription.deadline:=2500000000", "/wheel/axle_wrench.publisher.reliability:=best_effort",
        "/wheel/axle_wrench.publisher.lifespan:=500000000", "/diagnostics.publisher.durability:=transient_local",
        "/wheel/ring_shape.publisher.history:=keep_all", "/wheel/ring_shape.publisher.liveliness:=manual_by_topic",
        "/wheel/ring_shape.publisher.liveliness_lease_duration:=3000000000",
    ]  # fmt: skip
    arguments = [part for each in given for part in ("-p", f"qos_overrides.{each}")]
    one = bench(*arguments, "-r", "wheel/load:=/hub/load", "-p", f"log.directory:={tmp_path / 'logs'}")
    one.close()
    (log,) = (tmp_path / "logs").iterdir()
    forever = {"sec": 9223372036, "nsec": 854775807}
    default = {
        "history": "keep_last", "depth": 10, "reliability": "reliable", "durability": "volatile",
        "deadline": forever, "lifespan": forever, "liveliness": "automatic", "liveliness_lease_duration": forever,
        "avoid_ros_namespace_conventions": False,
    }  # fmt: skip
    sensor_data = {**default, "depth": 5, "reliability": "best_effort"}
    wanted = {
        "/joint_states": sensor_data,
        "/wheel/wheel_speed": sensor_data,
        "/wheel/load_force": sensor_data,
        "/hub/load": {**sensor_data, "depth": 7, "reliability": "reliable", "deadline": {"sec": 2, "nsec": 500000000}},
        "/wheel/axle_wrench": {**default, "reliability": "best_effort", "lifespan": {"sec": 0, "nsec": 500000000}},
        "/wheel/ring_deflection": default,
        "/wheel/ring_shape": {
            **default, "history": "keep_all", "liveliness": "manual_by_topic",
            "liveliness_lease_duration": {"sec": 3, "nsec": 0},
        },
        "/diagnostics": {**default, "durability": "transient_local"},
        "/tire_dynamics/tick": default,
        "/tire_dynamics/log_record": default,
    }  # fmt: skip
    reader = BagReader(log)
    assert {topic: offered_qos(text) for topic, text in reader.qos.items()} == {
        topic: [profile] for topic, profile in wanted.items()
    }
    information = yaml.safe_load((log / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    topics = [each["topic_metadata"] for each in information["topics_with_message_count"]]
    assert {each["name"]: each["offered_qos_profiles"] for each in topics} == {
        topic: [profile] for topic, profile in wanted.items()
    }


def wrench_of(end) -> ReliabilityPolicy:
    return end.qos_profile.reliability


@pytest.mark.parametrize(
    ("override", "named"),
    [
        ("/wheel/loads.subscription.depth:=3", "/wheel/loads.subscription.depth is not of a topic of this node"),
        ("/wheel/load.publisher.depth:=3", "/wheel/load.publisher.depth is not of a topic"),
        ("/wheel/load.subscription.deepness:=3", "deepness is not of a topic"),
        ("/wheel/load.subscription.lifespan:=3", "lifespan is not of a topic"),
        ("/wheel/load.subscription.depth:=deep", "/wheel/load.subscription"),
        ("/wheel/load.subscription.reliability:=good", "`reliability`: `good`"),
        ("/wheel/load.subscription.depth:=-3", "/wheel/load.subscription"),
    ],
)
def test_qos_overrides_that_cannot_be_applied_are_refused(bench, override, named):
    with pytest.raises(InputError) as caught:
        bench("-p", f"qos_overrides.{override}")
    assert named in str(caught.value) and "\n" not in str(caught.value)


# -- files of several nodes --


def test_a_file_of_two_cars_is_refused_by_a_replay(tmp_path):
    path = tmp_path / "two.yaml"
    section = {"ros__parameters": {"rate_hz": 100.0}}
    path.write_text(json.dumps({"/one/tire_dynamics": section, "/two/tire_dynamics": section}))
    with pytest.raises(InputError, match="/one/tire_dynamics and /two/tire_dynamics; leave those of one"):
        read_config(path)
    path.write_text(json.dumps({"/**/tire_dynamics": section, "/two/tire_dynamics": section}))
    assert read_config(path) == {"rate_hz": 100.0}
