"""What the live node computes needs no SciPy, and no collection of message definitions: they stay out of its memory."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("scipy", "rosbags", "matplotlib", "plotly", "rich")

TICK_AND_LOG = """
import sys
from tire_dynamics.cdr import messages
from tire_dynamics.bag import BagWriter
from tire_dynamics.ros.journal import DIAGNOSTICS_TYPE
from tire_dynamics.replay.pipeline import Pipeline

pipeline = Pipeline({"tire.sidewall_damping": "reaction", "tire.imbalance_mass": 0.02})
for k in range(1, 40):
    pipeline.receive("wheel/wheel_speed", 2_000_000 * k, messages.encode_float64(80.0))
    pipeline.receive("wheel/load_force", 2_000_000 * k, messages.encode_float64(3000.0))
    assert len(pipeline.tick(2_000_000 * k)) == 1
    pipeline.belts()
types = {*pipeline.inputs.values(), *pipeline.outputs.values(), DIAGNOSTICS_TYPE}
types |= {messages.CLOCK, messages.STRING, messages.TF}
with BagWriter(sys.argv[1]) as writer:
    for number, kind in enumerate(types):
        writer.write(writer.add_topic(f"/topic_{number}", kind), 1, 1, bytes(8))
"""

STABILITY = """
from tire_dynamics import TireWheelUnit
from tire_dynamics.estimator.vehicle import stability_reply

uniform = TireWheelUnit.table_1()
for unit in (uniform, uniform.replace(zeta_1=0.0, zeta_s=0.0), uniform.replace(radial_nonuniformity=[(2, 0.1, 0.4)])):
    for model in ("inextensional", "complete"):
        for speed in (0.0, 3.0, 100.0, 636.0):
            stability_reply("wheel", unit, speed, model)
"""

FORCE_VARIATION = """
import numpy as np
from tire_dynamics.ros.uniformity_monitor import variation_of

angle = np.linspace(0.0, 80.0, 2000)
assert variation_of(np.stack([np.mod(angle, 6.0), np.cos(angle)], axis=1))
"""

NODE = "import tire_dynamics.ros.node"


@pytest.mark.parametrize(
    "program", [TICK_AND_LOG, STABILITY, FORCE_VARIATION, NODE], ids=["log", "stability", "rfv", "node"]
)
def test_what_is_heavy_is_not_loaded(program, tmp_path):
    if program == NODE:
        pytest.importorskip("rclpy", reason="rclpy is not installed: the extra `ros` brings it")
    said = f"import sys\n{program}\nprint([name for name in {HEAVY!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", said, str(tmp_path / "bag")], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")
