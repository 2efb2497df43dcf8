"""What the pages say and the code has: parameters, topics, modules, files that are linked."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest
import yaml

from tire_dynamics import read_vehicle
from tire_dynamics.replay.input_map import QUANTITIES
from tire_dynamics.replay.parameters import PARAMETERS, Parameter

REPOSITORY = Path(__file__).parents[1]
PAGES = [REPOSITORY / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
PAGES += sorted((REPOSITORY / "docs").rglob("*.md"))


def rows(page: str) -> list[list[str]]:
    """The cells of every table row of a page, without heads and rules."""
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def name(cell: str) -> str:
    found = re.fullmatch(r"`([^`]+)`", cell)
    return found[1] if found else ""


# -- parameters -------------------------------------------------------------------------------------------------------

DESCRIBED = {name(row[0]): row for row in rows("docs/parameters.md") if name(row[0])}


def bounds(text: str) -> tuple[float | None, float | None]:
    """The interval that a range names, closed or not."""
    number = {"pi/2": math.pi / 2.0}
    found = re.fullmatch(r"\[?(-?[\d.e-]+)(?: to |, )([\w./]+)[])]?", text)
    if found:
        return float(found[1]), number.get(found[2]) or float(found[2])
    return {"": (None, None)}[text]


def described_as(row: Parameter) -> str:
    """The name that a parameter has in the page: those of the field map stand there once for all quantities."""
    return re.sub(r"^inputs\.\w+\.", "inputs.<quantity>.", row.name)


def test_every_parameter_is_described():
    assert list(DESCRIBED) == list(dict.fromkeys(map(described_as, PARAMETERS)))


def test_every_quantity_of_the_field_map_is_described():
    """Its units, the first of which is the default."""
    stated = {row[0]: row for row in rows("docs/parameters.md")}
    for quantity, known in QUANTITIES.items():
        units = re.findall(r"`([^`]+)`", stated[quantity][1])
        assert units == [*known.units, *known.linear]


@pytest.mark.parametrize("row", PARAMETERS, ids=[row.name for row in PARAMETERS])
def test_a_parameter_is_described_as_it_is(row: Parameter):
    _, kind, default, spread, description = DESCRIBED[described_as(row)]
    kind, default = kind.replace(" or ", " | "), default
    if row.name.startswith("inputs.") and row.choices:  # another for each quantity
        assert (kind, default, spread) == ("string", "", "those of the quantity")
        return
    assert kind == row.kind + ("" if row.read_only else ", live")
    stated = yaml.safe_load(name(default))
    if row.kind == "double":  # 5.8e+6 is a number to ROS and YAML; an integer would be refused by both
        assert isinstance(stated, float)
    assert (tuple(stated) if isinstance(stated, list) else stated) == row.default
    if row.choices:
        assert re.findall(r"`(\w+)`", spread) == list(row.choices)
    else:
        assert bounds(spread) == (row.low, row.high)
    assert len(description) > 5


# -- topics -----------------------------------------------------------------------------------------------------------


ANY_NODE = r"/rosout|/parameter_events|/clock|~/.*(parameter|state|transition|type_description).*"


def test_the_readme_has_the_topics_and_services_of_the_node(bench):
    """Names and types on real nodes, loads given, estimated and on the road, but for what every (managed) node has."""
    on_it = ("-p", "load_source:=road", "-p", "static_loads:=[4000.0]", "-r", "__ns:=/road")
    road = bench("-p", "wheels:=[a]", *on_it).node
    node = bench("-p", "wheels:=[a]").node
    known = read_vehicle(REPOSITORY / "config" / "car.yaml").to_mapping()
    car = {f"vehicle.{field}": value for field, value in known.items()}
    car |= {"load_source": "estimate", "axle_wrench_covariance": True, "wheels": list("abcd")}
    arguments = [text for key, value in car.items() for text in ("-p", f"{key}:={json.dumps(value)}")]
    estimate = bench(*arguments, "-r", "__ns:=/estimate").node
    stated = [row for row in rows("README.md") if row[0] in ("in", "out", "service")]
    listed = {
        "in": node.get_subscriber_names_and_types_by_node,
        "out": node.get_publisher_names_and_types_by_node,
        "service": node.get_service_names_and_types_by_node,
    }
    on_the_road = {
        "in": road.get_subscriber_names_and_types_by_node,
        "out": road.get_publisher_names_and_types_by_node,
        "service": road.get_service_names_and_types_by_node,
    }
    estimated = {
        "in": estimate.get_subscriber_names_and_types_by_node,
        "out": estimate.get_publisher_names_and_types_by_node,
        "service": estimate.get_service_names_and_types_by_node,
    }
    for way, names_and_types in listed.items():
        said = {name(row[1]): row[2] for row in stated if row[0] == way and name(row[1])}
        # Those with messages that are not installed: test/interfaces looks at them.
        said = {topic: kind for topic, kind in said.items() if not kind.startswith("tire_dynamics_msgs/")}
        if way == "out":
            del said["/tf_static"]  # only where there is tf2_msgs, and a parent frame
        real = {}
        of_all = [*names_and_types("tire_dynamics", "/"), *on_the_road[way]("tire_dynamics", "/road")]
        of_all += estimated[way]("tire_dynamics", "/estimate")
        for topic, (kind,) in of_all:
            topic = topic.removeprefix("/road").removeprefix("/estimate")
            if re.match("/[bcd]/", topic):
                continue
            topic = topic.replace("/tire_dynamics/", "~/").replace("/a/", "<wheel>/").replace("/joint", "joint")
            if not re.fullmatch(ANY_NODE, topic):
                real[topic] = re.sub("/(msg|srv)/", "/", kind)
        assert said == real
    services = {topic for topic, _ in listed["service"]("tire_dynamics", "/")}
    [managed] = [row[1] for row in stated if row[2] == "lifecycle_msgs"]
    assert {topic.replace("~", "/tire_dynamics") for topic in re.findall(r"`([^`]+)`", managed)} <= services


# -- modules ----------------------------------------------------------------------------------------------------------


def test_every_module_is_on_the_map():
    text = (REPOSITORY / "CONTRIBUTING.md").read_text(encoding="utf-8")
    package = REPOSITORY / "tire_dynamics"
    rooms = [file.parent.name for file in package.glob("*/__init__.py")]
    assert len(rooms) > 5
    for room in rooms:
        part = re.search(rf"^### {room}\n(.*?)(?=^##|\Z)", text, re.MULTILINE | re.DOTALL)
        assert part
        named = re.findall(r"`(\w+\.py)`", part[1])
        modules = [file.relative_to(package / room).as_posix() for file in (package / room).rglob("*.py")]
        assert sorted([*named, "__init__.py"]) == sorted(modules)


# -- links ------------------------------------------------------------------------------------------------------------


def anchors(page: Path) -> set[str]:
    """Of the headings, as GitHub makes them."""
    heads = re.findall(r"^#+ (.+)$", re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.replace("`", "").lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(REPOSITORY).as_posix())
def test_links_lead_somewhere(page: Path):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"https?://", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        if anchor and not anchor.startswith("tire_dynamics."):  # those of the reference are made from docstrings
            assert anchor in anchors(target), link


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(REPOSITORY).as_posix())
def test_no_table_is_torn_apart(page: Path):
    """A blank line within a table makes text of the rows behind it."""
    text = re.sub(r"```.*?```|\$\$.*?\$\$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for table in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        assert re.search(r"\n\|[-:| ]+\|\n", table), table
