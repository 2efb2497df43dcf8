"""The layouts for RViz, Foxglove and PlotJuggler name what the node has: topics, types, fields, frames, services."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from rosbags.typesys import Stores, get_typestore

from tire_dynamics.cdr import messages
from tire_dynamics.replay.parameters import read_config
from tire_dynamics.replay.pipeline import TF_STATIC, Pipeline
from tire_dynamics.ros.markers import MARKER_ARRAY, MarkerBuilder

REPOSITORY = Path(__file__).parents[1]
CONFIG = REPOSITORY / "config"

store = get_typestore(Stores.ROS2_JAZZY)
pipeline = Pipeline(read_config(CONFIG / "vehicle.yaml"))
WHEELS = pipeline.vehicle.settings.wheels
SAMPLES = pipeline.vehicle.settings.ring_samples
TYPES = {
    **{f"/{name}": kind for name, kind in {**pipeline.inputs, **pipeline.outputs}.items()},
    **{f"/{wheel}/markers": MARKER_ARRAY for wheel in WHEELS},
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    TF_STATIC: messages.TF,
}
# base_link: what the configuration says tf.parent_frame has to be
FRAMES = {"base_link", *pipeline.values["frame_ids"]}
SHOWN = {f"/{wheel}/{name}" for wheel in WHEELS for name in ("ring_shape", "markers")}

# Display classes of rviz_default_plugins, by the type that each subscribes to (its plugins_description.xml)
RVIZ_TYPES = {
    "rviz_default_plugins/PointCloud2": messages.POINT_CLOUD,
    "rviz_default_plugins/MarkerArray": MARKER_ARRAY,
    "rviz_default_plugins/Wrench": messages.WRENCH_STAMPED,
}
WITHOUT_TOPIC = {"rviz_default_plugins/Grid", "rviz_default_plugins/TF", "rviz_common/Group"}


def marker_namespaces() -> set[str]:
    array = store.deserialize_cdr(MarkerBuilder("a", 4).build(0, [[0.0] * 3] * 4, (0, 0), (0, 0), 0.0), MARKER_ARRAY)
    return {marker.ns for marker in array.markers}


def is_number(msgtype: str, fields: list[str]) -> bool:
    """Whether the fields, as ``wrench``, ``force``, ``z`` or ``data[3]``, lead to a number in a message type."""
    node = None
    for position, field in enumerate(fields):
        name, index = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", field).groups()
        node = dict(store.get_msgdef(msgtype).fields)[name]
        if node[0].name == "SEQUENCE" and index is not None:  # only the belt's deflection: radial, then tangential
            if int(index) >= 2 * SAMPLES:
                return False
            node = node[1][0]
        if node[0].name == "NAME":
            msgtype = node[1]
        elif position != len(fields) - 1:
            return False
    return node is not None and node[0].name == "BASE" and node[1][0] != "string"


def rviz_displays(displays: list[dict]) -> Iterator[dict]:
    for display in displays:
        yield display
        yield from rviz_displays(display.get("Displays", []))


@pytest.fixture(scope="module")
def rviz():
    return yaml.safe_load((CONFIG / "rviz" / "tire_dynamics.rviz").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def foxglove():
    return json.loads((CONFIG / "foxglove" / "tire_dynamics.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def plotjuggler():
    return ElementTree.parse(CONFIG / "plotjuggler" / "tire_dynamics.xml").getroot()


def test_a_wrong_path_is_seen():
    assert is_number(messages.WRENCH_STAMPED, ["wrench", "force", "z"])
    assert is_number(messages.FLOAT64_MULTI_ARRAY, [f"data[{2 * SAMPLES - 1}]"])
    assert not is_number(messages.FLOAT64_MULTI_ARRAY, [f"data[{2 * SAMPLES}]"])
    assert not is_number(messages.FLOAT64_MULTI_ARRAY, ["data"])
    assert not is_number(messages.WRENCH_STAMPED, ["wrench", "force"])
    with pytest.raises(KeyError):
        is_number(messages.WRENCH_STAMPED, ["force", "z"])


def test_rviz_shows_what_there_is(rviz):
    manager = rviz["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] in FRAMES
    assert manager["Views"]["Current"]["Target Frame"] in FRAMES
    seen = set()
    for display in rviz_displays(manager["Displays"]):
        if display["Class"] in WITHOUT_TOPIC:
            assert "Topic" not in display
            continue
        topic = display["Topic"]["Value"]
        assert TYPES[topic] == RVIZ_TYPES[display["Class"]]
        assert display["Name"] in topic.split("/")
        seen.add(topic)
    assert seen == SHOWN | {f"/{wheel}/axle_wrench" for wheel in WHEELS}


def test_rviz_colours_by_a_field_and_shows_every_marker(rviz):
    for display in rviz_displays(rviz["Visualization Manager"]["Displays"]):
        if display["Class"].endswith("/PointCloud2"):
            assert display["Channel Name"] == "radial" and "radial" in messages.RingShapeEncoder.FIELDS
        if display["Class"].endswith("/MarkerArray"):
            assert display["Namespaces"] == dict.fromkeys(marker_namespaces(), True)


def panels(node: str | dict) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    else:
        assert node["direction"] in ("row", "column") and 0 < node["splitPercentage"] < 100
        yield from panels(node["first"])
        yield from panels(node["second"])


def test_foxglove_places_every_panel_once(foxglove):
    placed = list(panels(foxglove["layout"]))
    assert sorted(placed) == sorted(foxglove["configById"])
    assert {"3D", "Plot", "DiagnosticSummary", "CallService"} == {panel.split("!")[0] for panel in placed}


def test_foxglove_plots_numbers_that_there_are(foxglove):
    plotted = set()
    for panel, config in foxglove["configById"].items():
        for path in config["paths"] if panel.startswith("Plot!") else []:
            topic, *fields = path["value"].split(".")
            assert is_number(TYPES[topic], fields), path["value"]
            first = next(iter(store.get_msgdef(TYPES[topic]).fields))
            assert path["timestampMethod"] != "headerStamp" or first[0] == "header"
            plotted.add(topic)
    assert plotted == {f"/{wheel}/{name}" for wheel in WHEELS for name in ("load", "axle_wrench", "ring_deflection")}


def test_foxglove_draws_asks_and_listens_to_what_there_is(foxglove):
    for panel, config in foxglove["configById"].items():
        if panel.startswith("3D!"):
            assert {topic for topic, shown in config["topics"].items() if shown["visible"]} == SHOWN
            assert all(TYPES[topic] in (messages.POINT_CLOUD, MARKER_ARRAY) for topic in config["topics"])
            fields = {shown["colorField"] for shown in config["topics"].values() if "colorField" in shown}
            assert fields == {"radial"} and fields <= set(messages.RingShapeEncoder.FIELDS)
            assert config["followTf"] in FRAMES
            assert all(layer.get("frameId") in FRAMES for layer in config["layers"].values())
        if panel.startswith("DiagnosticSummary!"):
            assert TYPES[config["topicToRender"]].endswith("/DiagnosticArray")
        if panel.startswith("CallService!"):  # std_srvs/Trigger: an empty request
            assert config["serviceName"] in {f"/{wheel}/floquet_stability" for wheel in WHEELS}
            assert json.loads(config["requestPayload"]) == {}


def test_plotjuggler_plots_numbers_that_there_are(plotjuggler):
    curves = [curve.get("name") for curve in plotjuggler.iter("curve")]
    joints = {f"/joint_states/{joint}/velocity" for joint in pipeline.values["joint_names"]}
    assert joints <= set(curves)
    for curve in set(curves) - joints:
        topic = max((topic for topic in TYPES if curve.startswith(f"{topic}/")), key=len)
        assert is_number(TYPES[topic], curve.removeprefix(f"{topic}/").split("/")), curve
    assert {curve.split("/")[2] for curve in set(curves) - joints} == {"load", "axle_wrench", "ring_deflection"}


def test_plotjugglers_parts_are_counted_right(plotjuggler):
    for splitter in plotjuggler.iter("DockSplitter"):
        sizes = [float(size) for size in splitter.get("sizes").split(";")]
        assert len(splitter) == int(splitter.get("count")) == len(sizes)
        assert math.isclose(sum(sizes), 1.0, abs_tol=1e-5)  # written with six digits
    for tab in plotjuggler.iter("Tab"):
        assert len(tab) == int(tab.get("containers"))
    assert all(len(list(area.iter("curve"))) for area in plotjuggler.iter("DockArea"))


@pytest.mark.parametrize("file", ["foxglove/tire_dynamics.json", "plotjuggler/tire_dynamics.xml"])
def test_the_belt_is_read_where_the_text_says(file):
    """Radial deflections at the road, 3 pi/2, and (PlotJuggler) at the top, pi/2; j counts 2 pi/P."""
    indices = set(re.findall(r"ring_deflection[./]data\[(\d+)\]", (CONFIG / file).read_text(encoding="utf-8")))
    at = [math.pi / 2, 3 * math.pi / 2] if file.endswith(".xml") else [3 * math.pi / 2]
    assert sorted(2 * math.pi * int(index) / SAMPLES for index in indices) == pytest.approx(at)


def test_the_pictures_are_there():
    page = REPOSITORY / "docs" / "see_it.md"
    pictures = re.findall(r"!\[[^\]]*\]\((\S+\.png)\)", page.read_text(encoding="utf-8"))
    assert pictures and {page.parent / picture for picture in pictures} == set((page.parent / "see_it").glob("*.png"))
