"""The live node with its worker: nothing heavy is computed by the thread that ticks, and everything is answered."""

from __future__ import annotations

import json
import threading
from collections import defaultdict

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from std_srvs.srv import Trigger
from test_rotating_excitation_live import Wheel, arguments_of, diagnosis, its_log_replays

from tire_dynamics import TireWheelUnit, wheel
from tire_dynamics.science import nonuniform, rotating_excitation
from tire_dynamics.science.uniformity import OrderSums

VARYING = {"sidewall_damping": "reaction", "zeta_s": 0.3, "radial_nonuniformity": [2.0, 0.07, 0.4]}
HEAVY = {
    function.__code__: name
    for name, function in {
        "stability": nonuniform.stability,
        "tongues": nonuniform.combination_resonances.__wrapped__,
        "critical speed": wheel.critical_speed.__wrapped__,
        "rotating excitation": rotating_excitation.rotating_excitation.__wrapped__,
        "force variation": OrderSums.add,
    }.items()
}


@pytest.fixture
def where():
    """By name of what is heavy, the threads that called it; of threads that are started in the test."""
    called = defaultdict(set)

    def note(frame, event, argument):
        if event == "call" and frame.f_code in HEAVY:
            called[HEAVY[frame.f_code]].add(threading.current_thread().name)

    threading.setprofile(note)
    yield called
    threading.setprofile(None)


def test_nothing_heavy_is_done_by_the_thread_that_ticks(bench, where, tmp_path):
    """A change of the tire, the looks at its stability and force variation, the service; and the log replays."""
    one = bench(*arguments_of(VARYING), "-p", f"log.directory:={tmp_path / 'logs'}")
    heard = one.messages(DiagnosticArray, "/diagnostics")
    Wheel(one)
    one.until(lambda: "RFV over [turns]" in diagnosis(heard), "a variation")
    client = AsyncParameterClient(one.peer, "tire_dynamics")
    one.until(client.services_are_ready, "parameter services")
    changes = [("zeta_1", 0.0123), ("radial_nonuniformity", [2.0, 0.0731, 0.4]), ("imbalance_mass", 0.0123)]
    futures = [client.set_parameters([Parameter(f"tire.{name}", value=value)]) for name, value in changes]
    for future in futures:
        one.until(future.done, "the parameter")
        assert future.result().results[0].successful
    changed = TireWheelUnit.table_1(**(VARYING | dict(changes)))
    tongue = nonuniform.nearest_tongue(changed, nonuniform.Nonuniformity.of(changed), 100.0)

    def answered():
        reply = one.call(Trigger, "/wheel/floquet_stability", Trigger.Request())
        return json.loads(reply.message)["nearest_tongue_rad_s"] == tongue

    one.until(answered, "the stability of the new tire")
    one.until(lambda: diagnosis(heard)["nearest tongue [rad/s]"] == f"{tongue:.2f}", "a look at the new tire")
    one.until(lambda: heard[-1].status[0].values, "diagnostics")
    node = {item.key: item.value for item in heard[-1].status[0].values}
    assert node["parameters not yet in force"] == "none" and int(node["analyses waiting"]) <= 2
    one.close()
    # the rest is done in another process
    assert dict(where) == dict.fromkeys(("rotating excitation", "force variation"), {"worker"})

    its_log_replays(tmp_path)


def test_a_uniform_tire_is_judged_beside_the_ticks_too(bench, where):
    one = bench("-p", "tire.zeta_1:=0.0321")
    heard = one.messages(DiagnosticArray, "/diagnostics")
    Wheel(one)
    reply = one.call(Trigger, "/wheel/floquet_stability", Trigger.Request())
    assert reply.success and json.loads(reply.message)["periodicity"] == "reducible"
    one.until(lambda: diagnosis(heard).get("stability") == "asymptotically stable", "a look at it")
    one.close()
    assert where["stability"] == where["critical speed"] == {"worker"}


def test_of_many_who_ask_everyone_is_answered(bench):
    one = bench(*arguments_of(VARYING))
    heard = one.messages(DiagnosticArray, "/diagnostics")
    Wheel(one)
    one.until(lambda: diagnosis(heard).get("in motion") == "True", "a wheel in motion")
    client = one.peer.create_client(Trigger, "/wheel/floquet_stability")
    one.until(client.service_is_ready, "the service")
    futures = [client.call_async(Trigger.Request()) for _ in range(8)]  # DDS keeps ten
    one.until(lambda: all(future.done() for future in futures), "every reply")
    replies = [future.result() for future in futures]
    assert all(reply.success and json.loads(reply.message)["speed_rad_s"] == 100.0 for reply in replies)


def test_who_waits_is_answered_when_the_node_is_deactivated(bench):
    one = bench(*arguments_of(VARYING), "-p", "autostart:=false", "-p", "model:=complete")
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        request = ChangeState.Request(transition=Transition(id=transition))
        assert one.call(ChangeState, "/tire_dynamics/change_state", request).success
    client = one.peer.create_client(Trigger, "/wheel/floquet_stability")
    one.until(client.service_is_ready, "the service")
    futures = [client.call_async(Trigger.Request()) for _ in range(8)]  # DDS keeps ten
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_DEACTIVATE))
    assert one.call(ChangeState, "/tire_dynamics/change_state", request).success
    one.until(lambda: all(future.done() for future in futures), "every reply")
    for reply in (future.result() for future in futures):
        assert reply.success or reply.message == "the node is not active"
