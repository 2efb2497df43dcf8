"""What `tire-dynamics compare` takes for a long recording: two bags of wrenches, read, compared, the page written.

    python benchmarks/compare.py [--minutes 10] [--rate 2000] [--repeats 3] [--json FILE]

The measurement is the model's force, 2 % larger and 1 ms later, with noise; what comes out is printed beside. The floor
is the reading of both bags alone.
"""

from __future__ import annotations

import contextlib
import io
import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from harness import parser, peak_memory, print_machine, print_table, shown, spread, write_json
from scipy.interpolate import make_interp_spline

from tire_dynamics import TireWheelUnit, simulate
from tire_dynamics.bag import BagWriter
from tire_dynamics.cdr.messages import FLOAT64, WRENCH_STAMPED, WrenchEncoder, encode_float64
from tire_dynamics.cli.main import main as command
from tire_dynamics.report.wrenches import read_bag

CAR = TireWheelUnit.table_1(wheel_mass=35.0, suspension_stiffness=25e3, zeta_s=0.3, sidewall_damping="reaction")
GAIN, DELAY, NOISE = 1.02, 0.001, 20.0  # [-], [s], rms [N]
BEGIN = 1_700_000_000 * 10**9


def write(folder: Path, name: str, stamps: np.ndarray, force: np.ndarray, speed: np.ndarray) -> None:
    wrench = WrenchEncoder("hub")
    with BagWriter(folder) as bag:
        topic, wheel = bag.add_topic(name, WRENCH_STAMPED), bag.add_topic("/wheel/wheel_speed", FLOAT64)
        for k, (stamp, (x, z)) in enumerate(zip(stamps.tolist(), force.tolist(), strict=True)):
            bag.write(topic, stamp, stamp, wrench.encode(stamp, x, z))
            if k % 20 == 0:
                bag.write(wheel, stamp, stamp, encode_float64(float(speed[k])))


def main() -> None:
    options = parser(__doc__.splitlines()[0], repeats=3)
    options.add_argument("--minutes", type=float, default=10.0, help="(10)")
    options.add_argument("--rate", type=float, default=2000.0, help="of both forces [Hz] (2000)")
    chosen = options.parse_args()
    print_machine()
    random = np.random.default_rng(1)
    t = np.arange(round(60.0 * chosen.minutes * chosen.rate)) / chosen.rate
    speed = 60.0 + 5.0 * np.sin(0.1 * t)
    load = 4000.0 + 150.0 * np.convolve(random.standard_normal(t.size), np.hanning(24), "same")
    force = simulate(CAR, t, speed, load, 0.1 * (load - 4000.0)).axle_force
    late = GAIN * make_interp_spline(t, force, 5)(np.maximum(t - DELAY, 0.0))
    late += NOISE * random.standard_normal(late.shape)
    stamps = BEGIN + np.round(1e9 * t).astype(np.int64)
    whole, own, floor, said = [], [], [], {}
    with TemporaryDirectory() as folder:
        measured, model, page = (Path(folder) / name for name in ("measured", "model", "page.html"))
        write(measured, "/hub/wrench", stamps, late, speed)
        write(model, "/wheel/axle_wrench", stamps, force, speed)
        for _ in range(chosen.repeats):
            begin, used = time.perf_counter(), time.process_time()
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                arguments = ["compare", str(measured), str(model), "--topic", "/hub/wrench", "--json", "--force"]
                status = command([*arguments, "--model-topic", "/wheel/axle_wrench", "-o", str(page)])
            assert status == 0
            whole.append(time.perf_counter() - begin)
            own.append(time.process_time() - used)
            said = json.loads(out.getvalue())
            begin = time.perf_counter()
            for path, topic in ((measured, "/hub/wrench"), (model, "/wheel/axle_wrench")):
                read_bag(path, topic, "", None, {}, quiet=True)
            floor.append(time.perf_counter() - begin)
        size = page.stat().st_size / 1e6
    figures = {"seconds": spread(whole), "cpu_seconds": spread(own), "reading_seconds": spread(floor)}
    figures |= {"peak_MiB": peak_memory(), "page_MB": size}
    print_table(
        (f"{chosen.minutes:g} min at {chosen.rate:g} Hz", ""),
        [
            ("compare, page written [s]", shown(figures["seconds"])),
            ("processor's time of it [s]", shown(figures["cpu_seconds"])),
            ("of it reading both bags [s]", shown(figures["reading_seconds"])),
            ("peak of memory [MiB]", f"{figures['peak_MiB']:.0f}"),
            ("page [MB]", f"{size:.1f}"),
        ],
    )
    for name, axis in said["axes"].items():
        gain, delay = (axis["gain"], axis["gain_error"]), (axis["delay_s"], axis["delay_error_s"])
        miss = (gain[0] - GAIN) / gain[1]
        print(f"force.{name}: gain {gain[0]:.6f} +- {gain[1]:.2g}, {miss:+.1f} errors from {GAIN}")
        miss = (delay[0] - DELAY) / delay[1]
        print(f"force.{name}: delay {1e3 * delay[0]:.5f} +- {1e3 * delay[1]:.2g} ms, {miss:+.1f} errors from 1 ms")
        figures[name] = {"gain": gain, "delay": delay}
    write_json(chosen.json, "compare", figures)


if __name__ == "__main__":
    main()
