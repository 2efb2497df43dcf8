"""Who may talk to the node: the access-control policy, discovery, and what happens where there is no security."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from contextlib import ExitStack, contextmanager
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from std_msgs.msg import Float64

from tire_dynamics.replay.parameters import read_car
from tire_dynamics.ros import typed
from tire_dynamics.ros.node import TireDynamicsNode

REPOSITORY = Path(__file__).parents[1]
POLICY = REPOSITORY / "config" / "sros2" / "tire_dynamics.policy.xml"
COMMAND = [sys.executable, "-m", "tire_dynamics.cli.main", "node", "--ros-args"]
PATIENCE = 180.0  # [s] after which what should have happened has not
CLOCK = {"/clock"}
TF = {"/tf_static"}
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
TYPED_TOPICS = {f"/{wheel}/{typed.TOPIC}" for wheel in WHEELS}  # with tire_dynamics_msgs: test/interfaces looks at them
TYPED_SERVICES = {f"/{wheel}/{typed.SERVICE}" for wheel in WHEELS}
MANAGING = ("change_state", "get_state", "get_available_states", "get_available_transitions", "get_transition_graph")

# -- the form of the policy: the rules of SROS2's policy.xsd, version 0.2.0 --

# Of each element: the attributes that it must have, those that it may have, and its children, at least one of them.
# An element without children holds a name.
FORM = {
    "policy": ({"version"}, set(), {"enclaves"}),
    "enclaves": (set(), set(), {"enclave"}),
    "enclave": ({"path"}, set(), {"profiles"}),
    "profiles": (set(), set(), {"profile"}),
    "profile": ({"ns", "node"}, set(), {"topics", "services", "actions"}),
    "topics": (set(), {"publish", "subscribe"}, {"topic"}),
    "services": (set(), {"reply", "request"}, {"service"}),
    "actions": (set(), {"call", "execute"}, {"action"}),
    "topic": (set(), set(), set()),
    "service": (set(), set(), set()),
    "action": (set(), set(), set()),
}
ONLY_ONE = {"enclaves", "profiles"}  # of these in their parent


def faults(element: ElementTree.Element) -> list[str]:
    """What in an element and below it breaks the schema's rules."""
    if element.tag not in FORM:
        return [f"{element.tag} is unknown"]
    needed, possible, children = FORM[element.tag]
    given, found = set(element.attrib), []
    if not needed <= given <= needed | possible or (possible and not given):
        found.append(f"{element.tag} has the attributes {sorted(given)}")
    values = {name: element.get(name) for name in possible & given}
    found += [f"{name}={value!r}" for name, value in values.items() if value not in ("ALLOW", "DENY")]
    tags = [child.tag for child in element]
    found += [f"{tag} in {element.tag}" for tag in tags if tag not in children]
    found += [f"{tag} twice in {element.tag}" for tag in ONLY_ONE if tags.count(tag) > 1]
    if children and not tags:
        found.append(f"{element.tag} is empty")
    text = (element.text or "").strip() + "".join((child.tail or "").strip() for child in element)
    if children and text:
        found.append(f"text in {element.tag}: {text}")
    if not children and (not text or text != element.text):
        found.append(f"{element.tag}: {element.text!r} is not a name")
    for child in element:
        found += faults(child)
    return found


def policy() -> ElementTree.Element:
    return ElementTree.parse(POLICY).getroot()


def test_the_policy_has_the_form_that_sros2_reads():
    root = policy()
    assert (root.tag, root.get("version")) == ("policy", "0.2.0")
    assert faults(root) == []


@pytest.mark.parametrize(
    ("good", "bad"),
    [
        ("<policy version", "<policy versions"),
        ("<enclaves>", "<enclaves><enclave/>"),
        ('<enclave path="/feeder">', "<enclave>"),
        ('ns="/" node="feeder"', 'node="feeder"'),
        ('publish="ALLOW"', ""),
        ('publish="ALLOW"', 'publish="allow"'),
        ('publish="ALLOW"', 'reply="ALLOW"'),
        ("<topic>/clock</topic>", ""),
        ("<topic>/clock</topic>", "<topic/>"),
        ("<topic>/clock</topic>", "<topic> /clock</topic>"),
        ("<topic>/clock</topic>", "<service>/clock</service>"),
        ("<topic>/clock</topic>", "<topics>/clock</topics>"),
        ("<topic>/clock</topic>", "/clock"),
    ],
)
def test_a_policy_of_another_form_would_be_noticed(good, bad):
    text = POLICY.read_text(encoding="utf-8")
    assert good in text
    assert faults(ElementTree.fromstring(text.replace(good, bad, 1))) != []


# -- what the policy allows, against what the node has --

ALLOWED = ("publish", "subscribe", "reply", "request")


def allowed(node: str) -> dict[str, set[str]]:
    """Names by what a node may do with them."""
    (profile,) = policy().findall(f"enclaves/enclave[@path='/{node}']/profiles/profile")
    assert (profile.get("ns"), profile.get("node")) == ("/", node)
    found: dict[str, set[str]] = {what: set() for what in ALLOWED}
    for group in profile:
        for what, verdict in group.attrib.items():
            assert verdict == "ALLOW", "what is not allowed is denied: a second way to say so can only contradict"
            names = [name.text for name in group]
            assert all(name.startswith("/") for name in names)  # other readers complete a relative name differently
            assert len(names) == len(set(names)) and not found[what] & set(names), "a name is there twice"
            found[what].update(names)
    return found


def has(node: Node) -> dict[str, set[str]]:
    """Names by what a node does with them: what rcl says that is on the network."""
    itself = node.get_name(), node.get_namespace()
    mine = {publisher.topic_name for publisher in node.publishers}
    taken = {subscription.topic_name for subscription in node.subscriptions}
    limit = time.monotonic() + PATIENCE
    while not (
        mine <= {name for name, _ in node.get_publisher_names_and_types_by_node(*itself)}
        and taken <= {name for name, _ in node.get_subscriber_names_and_types_by_node(*itself)}
    ):
        assert time.monotonic() < limit, "the graph never had the node's own publishers and subscriptions"
        time.sleep(0.01)
    found = (
        node.get_publisher_names_and_types_by_node(*itself),
        node.get_subscriber_names_and_types_by_node(*itself),
        node.get_service_names_and_types_by_node(*itself),
        node.get_client_names_and_types_by_node(*itself),
    )
    return {what: {name for name, _ in names} for what, names in zip(ALLOWED, found, strict=True)}


@contextmanager
def context_in(domain: int):
    context = Context()
    context.init(args=[], domain_id=domain)
    try:
        yield context
    finally:
        context.try_shutdown()


# Where the loads come from, with what else has topics of its own.
LOAD_SOURCES = {
    "topic": {"load_source": "topic"},
    "road": {"load_source": "road", "static_loads": [4000.0] * 4},
    "estimate": {**read_car(REPOSITORY / "config" / "car.yaml"), "axle_wrench_covariance": True},
}


def text_of(value: object) -> str:
    """A parameter's value for the command line: YAML."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(text_of, value))}]"
    return str(value).lower()


def everything_of_the_node(domain: int, use_sim_time: bool) -> dict[str, set[str]]:
    """Of three nodes, one for each source of the loads, one after the other: all that any of them has.

    Each has a name of its own: the graph may still show one that was there before.
    """
    found: dict[str, set[str]] = {what: set() for what in ALLOWED}
    for which, source in LOAD_SOURCES.items():
        name_here = f"with_{which}_{'simulated' if use_sim_time else 'system'}_time"
        arguments = ["-r", f"__node:={name_here}", "--params-file", str(REPOSITORY / "config" / "vehicle.yaml")]
        for name, value in {**source, "use_sim_time": use_sim_time}.items():
            arguments += ["-p", f"{name}:={text_of(value)}"]
        with context_in(domain) as context:
            node = TireDynamicsNode(context=context, arguments=["--ros-args", *arguments])
            try:
                for what, names in has(node).items():
                    found[what] |= {name.replace(f"/{name_here}/", "/tire_dynamics/") for name in names}
            finally:
                node.destroy_node()
    return found


def everything_of_a_plain_node(domain: int, name: str) -> dict[str, set[str]]:
    with context_in(domain) as context:
        node = Node(f"plain_{name}", context=context)  # a name of its own: the graph may still show who had the other
        try:
            found = has(node)
        finally:
            node.destroy_node()
    return {what: {one.replace(f"/plain_{name}/", f"/{name}/") for one in names} for what, names in found.items()}


@pytest.mark.parametrize("use_sim_time", [False, True])
def test_the_node_has_what_it_is_allowed_and_no_more(ros_domain, use_sim_time):
    may = allowed("tire_dynamics")
    assert may["publish"] >= TF  # for tf.parent_frame, which config/vehicle.yaml leaves empty
    may["publish"] -= TF
    assert may["publish"] >= TYPED_TOPICS and may["reply"] >= TYPED_SERVICES
    may["publish"] -= TYPED_TOPICS
    may["reply"] -= TYPED_SERVICES
    if not use_sim_time:
        assert may["subscribe"] >= CLOCK
        may["subscribe"] -= CLOCK
    assert may == everything_of_the_node(ros_domain, use_sim_time)


def test_the_others_are_allowed_their_part_of_the_node_and_no_more(ros_domain):
    node = everything_of_the_node(ros_domain, use_sim_time=False)
    plain = everything_of_a_plain_node(ros_domain, "tire_dynamics")
    transitions = {"/tire_dynamics/transition_event"}
    managing = {f"/tire_dynamics/{name}" for name in MANAGING}
    stability = {name for name in node["reply"] if name.endswith("/floquet_stability")}
    logging = node["reply"] - stability - plain["reply"] - managing
    parameters = {name for name in plain["reply"] if "parameter" in name}
    assert stability and len(logging) == 1 and parameters, "the search is broken"
    parts = {
        "feeder": {"publish": node["subscribe"]},
        "listener": {
            "subscribe": (node["publish"] | TYPED_TOPICS) - plain["publish"] - transitions,
            "request": stability | TYPED_SERVICES,
        },
        "operator": {"subscribe": {"/diagnostics"} | transitions, "request": logging | parameters | managing},
    }
    enclaves = [enclave.get("path") for enclave in policy().iter("enclave")]
    assert enclaves == ["/tire_dynamics", *(f"/{name}" for name in parts)]
    for name, part in parts.items():
        own = everything_of_a_plain_node(ros_domain, name)
        assert allowed(name) == {what: own[what] | part.get(what, set()) for what in ALLOWED}, name


# -- security is asked for and cannot be had: the node must not run open --


def refusal(keystore: Path) -> str:
    """What the node says when it is to run in an enclave of this keystore and gives up."""
    wanted = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce", "ROS_SECURITY_KEYSTORE": str(keystore)}
    environment = {**os.environ, **wanted, "PYTHONPATH": str(REPOSITORY)}
    run = subprocess.run(
        [*COMMAND, "--enclave", "/tire_dynamics"], env=environment, capture_output=True, text=True, timeout=PATIENCE
    )
    assert run.returncode == 2 and "Traceback" not in run.stderr
    return run.stderr


def keystore_of_nothing(folder: Path) -> Path:
    """A keystore whose files are all there, with nothing of use in them."""
    enclave = folder / "enclaves" / "tire_dynamics"
    enclave.mkdir(parents=True)
    for name in ("identity_ca.cert", "permissions_ca.cert", "cert", "key"):
        (enclave / f"{name}.pem").write_text("nothing\n")
    for name in ("governance", "permissions"):
        (enclave / f"{name}.p7s").write_text("nothing\n")
    return folder


def test_without_its_enclave_the_node_does_not_run(ros_domain, tmp_path):
    (tmp_path / "enclaves").mkdir()
    said = refusal(tmp_path)
    assert "Traceback" not in said
    (line,) = [line for line in said.splitlines() if line.startswith("tire-dynamics: ")]
    assert str(tmp_path / "enclaves" / "tire_dynamics") in line


def test_where_the_middleware_cannot_secure_it_the_node_does_not_run(ros_domain, tmp_path):
    """Built with security it cannot use these files, built without it says that."""
    assert refusal(keystore_of_nothing(tmp_path))


def test_the_wheels_are_without_security(ros_domain, tmp_path):
    """When this fails the wheels have it: docs/security.md is to be corrected, and two enclaves to be tried here."""
    try:
        distribution("ros-rmw-fastrtps-cpp")
    except PackageNotFoundError:
        pytest.skip("this ROS is not from wheels")
    assert "This Fast DDS version doesn't have the security libraries" in refusal(keystore_of_nothing(tmp_path))


# -- discovery: without security, what keeps others out --


class Peer:
    """Feeds one wheel and listens to two, in a context of its own."""

    def __init__(self, domain: int, name: str) -> None:
        self.context = Context()
        self.context.init(args=[], domain_id=domain)
        self.node = Node(name, context=self.context)
        self.executor = EventsExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.speed = self.node.create_publisher(Float64, f"/{name}/wheel_speed", 10)
        self.load = self.node.create_publisher(WrenchStamped, f"/{name}/load", 10)
        self.heard: dict[str, list] = {"inside": [], "outside": []}
        for wheel, messages in self.heard.items():
            self.node.create_subscription(WrenchStamped, f"/{wheel}/axle_wrench", messages.append, 10)
        self.diagnostics: list[DiagnosticArray] = []
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self.diagnostics.append, 10)
        self.node.create_timer(0.01, self._send)

    def _send(self) -> None:
        self.speed.publish(Float64(data=100.0))
        load = WrenchStamped()
        load.header.stamp = self.node.get_clock().now().to_msg()
        load.wrench.force.z = 3000.0
        self.load.publish(load)

    def verdict(self, wheel: str) -> str:
        """The diagnostics' line for a wheel, from the newest message."""
        (status,) = [status for status in self.diagnostics[-1].status if status.name.endswith(f": {wheel}")]
        return status.message

    def close(self) -> None:
        self.node.destroy_node()
        self.executor.shutdown()
        self.context.try_shutdown()


@contextmanager
def live_node(*arguments: str):
    """The node as its own process."""
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    process = subprocess.Popen([*COMMAND, *arguments], env=environment, stderr=subprocess.PIPE, text=True)
    try:
        yield
        process.terminate()
        _, said = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, said
    finally:
        if process.poll() is None:
            process.kill()
            process.communicate()


def until(condition, peers: list[Peer], what: str) -> None:
    limit = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > limit:
            pytest.fail(f"waited {PATIENCE:g} s for {what}")
        for peer in peers:
            peer.executor.spin_once(timeout_sec=0.002)


@pytest.mark.parametrize(
    ("discovery_range", "same_domain", "reached"),
    [("LOCALHOST", True, True), ("LOCALHOST", False, False), ("OFF", True, False)],
    ids=["inside after all", "another domain", "no discovery"],
)
def test_who_is_not_discovered_gets_nothing_in_or_out(ros_domain, monkeypatch, discovery_range, same_domain, reached):
    """The outsider is there first, so that it had more time than the insider, who is heard and hears.

    The first case is the control: the same outsider on the inside does get through.
    """
    domain = ros_domain if same_domain else 215 + ros_domain % 18  # 215 to 232: beyond those that `ros_domain` gives
    with ExitStack() as stack:
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", discovery_range)  # read when a context begins
        outsider = Peer(domain, "outside")
        stack.callback(outsider.close)
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        stack.enter_context(live_node("-p", "wheels:=[inside, outside]"))
        insider = Peer(ros_domain, "inside")
        stack.callback(insider.close)
        peers = [outsider, insider]
        until(lambda: len(insider.heard["inside"]) >= 100, peers, "the insider to hear its wheel")
        assert all(math.isfinite(message.wrench.force.z) for message in insider.heard["inside"])
        if reached:
            until(lambda: insider.heard["outside"] and outsider.heard["inside"], peers, "the outsider")
            return
        insider.diagnostics.clear()
        heard = lambda: insider.diagnostics and "no output" not in insider.verdict("inside")  # noqa: E731
        until(heard, peers, "diagnostics from after that")
        assert insider.verdict("outside") == "no output: no speed yet, no load yet"
        assert insider.heard["outside"] == []
        assert outsider.heard == {"inside": [], "outside": []} and outsider.diagnostics == []
        assert "tire_dynamics" not in outsider.node.get_node_names()
