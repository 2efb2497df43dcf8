"""The files around the code - package.xml, setup.py, the launch file, the configurations - agree with it."""

from __future__ import annotations

import ast
import re
import runpy
import sys
import xml.etree.ElementTree as ElementTree
from importlib import import_module
from pathlib import Path

import pytest
import setuptools
import yaml

import tire_dynamics
from tire_dynamics import TireWheelUnit, read_unit
from tire_dynamics.build_state import CYTHON
from tire_dynamics.replay.parameters import PARAMETERS, complete

ROOT = Path(__file__).parents[1]


def setup_arguments(*commands: str) -> dict:
    """What setup.py hands to setuptools when it is run with these commands."""
    arguments: dict = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(setuptools, "setup", arguments.update)
        patch.setattr(sys, "argv", ["setup.py", *commands])
        patch.chdir(ROOT)
        runpy.run_path("setup.py")
    return arguments


SETUP = setup_arguments("bdist_wheel")
PACKAGE_XML = ElementTree.parse(ROOT / "package.xml").getroot()

# The rosdep key that installs each distribution of the package index, where it is not python3-<name>; None where there
# is no key of a Debian package, and nothing may need it. Plotly has none at all (rosdistro's issue 53994 is open).
ROSDEP_KEYS = {
    "catkin_pkg": "python3-catkin-pkg-modules",
    "pyyaml": "python3-yaml",
    "mcap": None,
    "lz4": None,
    "zstandard": None,
    "rosbags": None,
}
# Shared libraries for what the Python packages of them would do.
LIBRARIES = {"liblz4", "libzstd-dev"}


def rosdep_keys(requirements: list[str]) -> set[str]:
    names = [re.match(r"[\w.-]+", requirement).group().lower() for requirement in requirements]
    return {key for name in names if (key := ROSDEP_KEYS.get(name, f"python3-{name}"))}


def declared(tag: str) -> set[str]:
    return {element.text for element in PACKAGE_XML.findall(tag)}


@pytest.mark.parametrize("field", ["name", "version", "maintainer"])
def test_package_xml_and_setup_py_agree(field):
    assert PACKAGE_XML.findtext(field) == SETUP[field]


def test_the_package_is_what_they_say():
    assert PACKAGE_XML.get("format") == "3"
    assert PACKAGE_XML.findtext("export/build_type") == "ament_python"
    assert tire_dynamics.__name__ == PACKAGE_XML.findtext("name")
    assert tire_dynamics.__version__ == PACKAGE_XML.findtext("version")
    assert PACKAGE_XML.find("maintainer").get("email") == SETUP["maintainer_email"]
    assert PACKAGE_XML.findtext("license") == SETUP.get("license_expression", SETUP.get("license"))
    licence = (ROOT / PACKAGE_XML.find("license").get("file")).read_text(encoding="utf-8")
    assert licence.split()[:4] == ["Apache", "License", "Version", "2.0,"]


# -- package.xml against its schema: package_format3.xsd is not on the package index --

# The schema's sequence: of each element how many there may be, and its attributes; (needed, possible).
MANY = 1000
DEPENDENCY = (set(), {"condition", *(f"version_{relation}" for relation in ("lt", "lte", "eq", "gte", "gt"))})
SEQUENCE = {
    "name": (1, 1, (set(), set())),
    "version": (1, 1, (set(), {"compatibility"})),
    "description": (1, 1, (set(), set())),
    "maintainer": (1, MANY, ({"email"}, set())),
    "license": (1, MANY, (set(), {"file"})),
    "url": (0, MANY, (set(), {"type"})),
    "author": (0, MANY, (set(), {"email"})),
    "depend": (0, MANY, DEPENDENCY),  # stands for all of DEPENDENCIES, in any order
    "export": (0, 1, (set(), set())),
}
DEPENDENCIES = {
    *("build_depend", "build_export_depend", "buildtool_depend", "buildtool_export_depend", "conflict", "depend"),
    *("doc_depend", "exec_depend", "group_depend", "member_of_group", "replace", "test_depend"),
}


def breaches(text: str) -> list[str]:
    """What in a package.xml breaks the rules of format 3: REP 149's reader and its warnings, and the schema's order."""
    from catkin_pkg.package import InvalidPackage, parse_package_string

    found: list[str] = []
    try:
        parse_package_string(text, warnings=found)
    except InvalidPackage as error:
        found.append(str(error))
    root = ElementTree.fromstring(text)
    if (root.tag, root.attrib) != ("package", {"format": "3"}):
        found.append(f"the root is {root.tag} {root.attrib}")
    kinds = ["depend" if child.tag in DEPENDENCIES else child.tag for child in root]
    found += [f"{kind} is unknown" for kind in kinds if kind not in SEQUENCE]
    places = [list(SEQUENCE).index(kind) for kind in kinds if kind in SEQUENCE]
    if places != sorted(places):
        found.append(f"order: {kinds}")
    for kind, (least, most, (needed, possible)) in SEQUENCE.items():
        elements = [child for child, its in zip(root, kinds, strict=True) if its == kind]
        if not least <= len(elements) <= most:
            found.append(f"{len(elements)} times {kind}")
        for element in elements:
            if not needed <= set(element.attrib) <= needed | possible:
                found.append(f"{element.tag} has the attributes {set(element.attrib)}")
            if len(element) and kind not in ("description", "export"):
                found.append(f"{element.tag} has children")
            if kind != "export" and not (element.text or "").strip():
                found.append(f"{element.tag} is empty")
    return found


PACKAGE_TEXT = (ROOT / "package.xml").read_text(encoding="utf-8")


def test_package_xml_is_valid():
    """An invalid one is no error for colcon: it builds the folder as plain Python, and ros2 finds nothing."""
    assert breaches(PACKAGE_TEXT) == []
    assert 'href="http://download.ros.org/schema/package_format3.xsd"' in PACKAGE_TEXT


@pytest.mark.parametrize(
    ("good", "bad"),
    [
        ('format="3"', 'format="2"'),
        ("<name>tire_dynamics</name>", ""),
        ("<name>tire_dynamics</name>", "<name>Tire Dynamics</name>"),
        ("<name>tire_dynamics</name>", "<name>TireDynamics</name>"),  # a warning
        ("<version>0.1.0</version>", "<version>0.1</version>"),
        ("<version>0.1.0</version>", "<version>0.1.0</version><version>0.1.0</version>"),
        (' email="maintainers@tire-dynamics.example"', ""),
        ('<license file="LICENSE">', '<license path="LICENSE">'),
        ("<license file", "<author>somebody</author><license file"),  # known, but not there
        ("<exec_depend>rclpy</exec_depend>", "<run_depend>rclpy</run_depend>"),
        ("<exec_depend>rclpy</exec_depend>", "<exec_depend>tire_dynamics</exec_depend>"),
        ("<exec_depend>rclpy</exec_depend>", '<exec_depend version="1">rclpy</exec_depend>'),
        ("<exec_depend>rclpy</exec_depend>", "<exec_depend/>"),
        ("</export>", "</export><exec_depend>rclcpp</exec_depend>"),
        ("</export>", "</export><export/>"),
    ],
)
def test_a_package_xml_of_another_form_would_be_noticed(good, bad):
    assert good in PACKAGE_TEXT
    assert breaches(PACKAGE_TEXT.replace(good, bad, 1)) != []


# -- dependencies --


def test_rosdep_installs_what_pip_installs():
    report = [requirement for requirement in SETUP["extras_require"]["report"] if "plotly" not in requirement]
    python_keys = rosdep_keys(SETUP["install_requires"] + SETUP["extras_require"]["plot"] + report)
    assert python_keys <= declared("exec_depend")
    assert declared("exec_depend") >= LIBRARIES
    ros_keys = declared("exec_depend") - python_keys - LIBRARIES
    assert [key for key in ros_keys if key.startswith("python3-")] == []
    assert declared("build_depend") == {"cython3", "python3-dev"}  # rosdistro's pull requests 27038 and 15328
    assert declared("test_depend") <= rosdep_keys(SETUP["extras_require"]["test"])
    assert "python3-pytest" in declared("test_depend")  # colcon runs pytest where the extra `test` names it


def debian_packages(key: str, system: str = "ubuntu", release: str = "noble") -> list[str]:
    """What rosdep and bloom make of a key, by the excerpt of ROS's public lists; empty if they have none."""
    lists = ROOT / "test" / "rosdistro"
    known = yaml.safe_load((lists / "rosdep" / "excerpt.yaml").read_text(encoding="utf-8"))
    distribution = yaml.safe_load((lists / "jazzy" / "distribution.yaml").read_text(encoding="utf-8"))
    released = [name for each in distribution["repositories"].values() for name in each["release"]["packages"]]
    if key in released:
        return [f"ros-jazzy-{key.replace('_', '-')}"]
    rule = known.get(key, {}).get(system, [])
    if isinstance(rule, dict):
        rule = rule.get(release, rule.get("*", []))
    return rule if isinstance(rule, list) else []  # else by pip, which no released package may ask for


@pytest.mark.parametrize("file", ["package.xml", "interfaces/tire_dynamics_msgs/package.xml"])
def test_every_key_is_a_package_of_ubuntu_or_of_jazzy(file):
    elements = ElementTree.parse(ROOT / file).getroot()
    keys = [element.text for element in elements if element.tag in DEPENDENCIES - {"member_of_group"}]
    assert len(keys) > 4
    assert [key for key in keys if not debian_packages(key)] == []


def test_a_key_that_only_pip_installs_would_be_noticed():
    assert debian_packages("python3-rich", release="focal") == []  # which the excerpt has as pip's
    assert debian_packages("python3-rosbags-pip") == []


def test_ros_is_not_told_of_what_only_pip_has():
    """pip brings the four packages that have no keys, colcon and Debian's tools do not hear of them."""
    only = {name for name, key in ROSDEP_KEYS.items() if key is None}
    for commands, told in (("bdist_wheel", only), ("install", set()), ("develop", set())):
        required = setup_arguments(commands)["install_requires"]
        assert {re.match(r"\w+", each).group() for each in required} & only == told


@pytest.mark.parametrize("folder", [".", "interfaces/tire_dynamics_msgs"])
def test_a_package_has_what_a_release_needs(folder):
    element = ElementTree.parse(ROOT / folder / "package.xml").getroot()
    assert {url.get("type") for url in element.findall("url")} == {"website", "repository", "bugtracker"}
    assert element.findtext("version") == PACKAGE_XML.findtext("version")  # bloom releases them together
    title = f"Changelog for package {element.findtext('name')}"
    lines = (ROOT / folder / "CHANGELOG.rst").read_text(encoding="utf-8").splitlines()
    assert lines[:3] == ["^" * len(title), title, "^" * len(title)]
    assert lines[4:6] == ["Forthcoming", "-" * len("Forthcoming")] or lines[4].startswith(element.findtext("version"))


def test_the_packages_xml_of_the_messages_is_valid():
    assert breaches((ROOT / "interfaces/tire_dynamics_msgs/package.xml").read_text(encoding="utf-8")) == []


def test_what_builds_the_package_is_named_alike():
    """pip reads pyproject.toml, a build without isolation the extra."""
    cython = f"Cython>={'.'.join(map(str, CYTHON))}"
    requires = re.search(r"^requires = (\[.*\])$", (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.M)[1]
    assert cython in ast.literal_eval(requires)
    assert cython in SETUP["extras_require"]["test"] and cython in SETUP["extras_require"]["colcon"]


@pytest.mark.slow
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
    extras = {name: found for name, found in SETUP["extras_require"].items() if name not in ("ros", "plot")}
    optional = [requirement for requirements in extras.values() for requirement in requirements]
    imported -= {re.split(r"[^a-z]", requirement)[0] for requirement in optional}  # nobody needs these
    assert {"launch", "numpy", "yaml"} <= imported and "geometry_msgs" in messages, "the search is broken"
    imported.remove("tire_dynamics_msgs")  # used where it is installed
    imported.remove("cython")  # in the modules of the core, which run without
    imported -= {name for name, key in ROSDEP_KEYS.items() if key is None}  # test_without_packages runs without them
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
    folders = (ROOT / "config", ROOT / "bags" / "sample")
    config = {file.relative_to(ROOT) for folder in folders for file in folder.rglob("*") if file.is_file()}
    assert Path("bags/sample/metadata.yaml") in config
    assert {Path("config/vehicle.yaml"), Path("config/sros2/tire_dynamics.policy.xml")} <= config
    assert {
        f"share/ament_index/resource_index/packages/{name}": f"resource/{name}",
        f"share/{name}/package.xml": "package.xml",
        f"share/{name}/launch/tire_dynamics.launch.py": "launch/tire_dynamics.launch.py",
        **{f"share/{name}/{file}": str(file) for file in config},
    } == installed
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
    assert read_unit(ROOT / "config" / "table_1.yaml") == TireWheelUnit.table_1()
    assert plain_yaml("table_1.yaml") == TireWheelUnit.table_1().to_mapping()


def test_vehicle_yaml_holds_parameters_of_the_node():
    assert set(VEHICLE) <= {parameter.name for parameter in PARAMETERS}
    accepted = complete(VEHICLE)  # raises ValueError for a value of the wrong type or out of its range
    assert accepted["wheels"] == tuple(VEHICLE["wheels"])


def test_vehicle_yaml_shows_every_parameter():
    """But for the field map's, which stand in ``config/inputs``, a file for each stack, and those of a car."""
    elsewhere = ("inputs.", "vehicle.", "sensor_noise.")
    assert set(VEHICLE) == {row.name for row in PARAMETERS if not row.name.startswith(elsewhere)}
    text = (ROOT / "config" / "vehicle.yaml").read_text(encoding="utf-8")
    assert "config/inputs" in text and "config/car.yaml" in text


def test_vehicle_yaml_is_the_defaults_but_for_what_a_car_has():
    defaults = complete({})
    differs = {name for name, value in complete(VEHICLE).items() if value != defaults[name]}
    of_the_car = {"wheels", "joint_names", "frame_ids", "tf.positions", "tire.zeta_s", "tire.sidewall_damping"}
    of_the_car.add("static_loads")  # which load_source road alone looks at
    assert differs == of_the_car  # an empty list cannot be written, but harmonics of no amplitude


def test_every_parameter_of_vehicle_yaml_is_explained():
    """On its line or right above it, and with a unit wherever it is a number."""
    above, explained = "", set()
    for line in (ROOT / "config" / "vehicle.yaml").read_text(encoding="utf-8").splitlines():
        setting = re.match(r" +(\w+): *([^#]*[^# ])? *(#.*)?$", line)
        if setting is None:
            above = f"{above} {line.strip()}" if line.lstrip().startswith("#") else ""
            continue
        name, value, comment = setting.groups()
        if value is None and comment is None:  # a group
            continue
        said = f"{above} {comment or ''}"
        if re.search("[A-Za-z]{4}", said) and (not re.match(r"\[?-?[\d.]", value or "") or "[" in said):
            explained.add(name)
        above = ""
    assert [name for name in VEHICLE if name.split(".")[-1] not in explained] == []


def test_vehicle_yaml_has_four_wheels_with_a_joint_and_a_frame_each():
    wheels = VEHICLE["wheels"]
    assert wheels == ["front_left", "front_right", "rear_left", "rear_right"]
    assert len(set(VEHICLE["joint_names"])) == 4
    assert VEHICLE["frame_ids"] == [f"{wheel}_axle" for wheel in wheels]
    x, y, z = (VEHICLE["tf.positions"][first::3] for first in range(3))
    assert x[0] == x[1] > x[2] == x[3] == 0.0, "base_link is on the ground below the middle of the rear axle"
    assert y[0] == y[2] == -y[1] == -y[3] > 0.0, "left is positive"
    assert set(z) == {VEHICLE["tire.radius"]}


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


# -- the documents --

DOCUMENTS = sorted((ROOT / "docs").glob("*.md"))


def named_tests(document: Path) -> list[tuple[str, list[str]]]:
    """Test files that a document names, each with what it names of it: `test_node`: by_name, once_a_second."""
    found = re.findall(r"`(test_\w+)`(?:: ((?:\w+_\w+)(?:, \w+_\w+)*))?", document.read_text(encoding="utf-8"))
    return [(file, [part.strip() for part in parts.split(",")] if parts else []) for file, parts in found]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda document: document.stem)
def test_the_tests_that_a_document_names_exist(document):
    missing = []
    for file, parts in named_tests(document):
        texts = [path.read_text(encoding="utf-8") for path in (ROOT / "test").rglob(f"{file}.py")]
        names = re.findall(r"^def (test_\w+)", "".join(texts), re.M)
        missing += [f"{file}: {part}" for part in parts or ["test_"] if not any(part in name for name in names)]
    assert missing == []


def test_documents_do_name_tests():
    named = {document.stem: named_tests(document) for document in DOCUMENTS}
    assert all(named[name] for name in ("integration", "reliability", "validation")), "the search is broken"
    assert sum(len(parts) for _, parts in named["integration"]) > 10


def test_every_convention_has_a_test():
    """The table of docs/integration.md: a row for each, and in its last column a test by name."""
    rows = re.findall(r"^\| (.*) \|$", (ROOT / "docs" / "integration.md").read_text(encoding="utf-8"), re.M)
    table = {row.split(" | ")[0]: row.split(" | ")[-1] for row in rows}
    conventions = ["REP 103", "REP 105", "REP 107", "REP 149", "REP 2003", "rosbag2", "Foxglove", "MF-Tyre"]
    for convention in conventions:
        tests = [last for first, last in table.items() if first.startswith(convention)]
        assert tests and all(re.search(r"`test_\w+`: \w+", last) for last in tests), convention


@pytest.mark.parametrize("document", [ROOT / "README.md", *DOCUMENTS], ids=lambda document: document.stem)
def test_the_links_of_a_document_lead_somewhere(document):
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", document.read_text(encoding="utf-8"))
    assert [link for link in links if not (document.parent / link).exists()] == []
