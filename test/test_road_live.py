"""One live node on the road: its answers, its diagnostics, and its log replayed."""

from __future__ import annotations

import json
import math

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64
from std_srvs.srv import Trigger
from test_road_node import ROAD, outputs_of

from tire_dynamics.replay.replay import replay


def test_a_live_log_of_a_road_is_replayed_bit_for_bit(bench, tmp_path):
    arguments = [text for name, value in ROAD.items() for text in ("-p", f"{name}:={json.dumps(value)}")]
    one = bench(*arguments, "-p", f"log.directory:={tmp_path / 'logs'}")
    loads = one.messages(WrenchStamped, "/wheel/contact_load")
    heard = one.messages(DiagnosticArray, "/diagnostics")
    speeds, heights = (one.publisher(Float64, f"/wheel/{name}") for name in ("wheel_speed", "road_height"))
    sent = []

    def send():
        sent.append(0.01 * math.sin(0.2 * len(sent)))
        speeds.publish(Float64(data=60.0))
        heights.publish(Float64(data=sent[-1] if len(sent) != 50 else sent[-1] + 1.0))

    one.peer.create_timer(0.005, send)
    one.until(lambda: len(loads) > 400 and max(each.wrench.force.z for each in loads) > 4100.0, "contact loads")
    client = one.peer.create_client(Trigger, "/wheel/floquet_stability")
    one.until(client.service_is_ready, "the service")
    asked = client.call_async(Trigger.Request())
    one.until(asked.done, "an answer")
    assert json.loads(asked.result().message)["contact"] is True

    def said():
        found = [status for array in heard for status in array.status if status.name.endswith(": wheel")]
        values = {item.key: item.value for item in found[-1].values} if found else {}
        return values if values.get("samples road jumps") == "1" else None

    values = one.until(said, "a diagnosis")
    assert values["load source"] == "road" and "road height [m]" in values
    assert values["stability is of contact"] == "True"
    one.close()
    (log,) = (tmp_path / "logs").iterdir()
    replay(log, tmp_path / "again", quiet=True)
    logged = outputs_of(log)
    assert len(logged["/wheel/contact_load"]) > 400
    assert outputs_of(tmp_path / "again") == logged
