"""How long a start takes: of the node to its first wrench, and of ``tire-dynamics --help``.

    python benchmarks/start.py [--repeats 5] [--json FILE]

Whole processes, in turn. The node is beside the null node, with inputs already flowing; the time is from the start
of the process to the receipt of its first wrench, DDS's discovery included. A cold start is the first one of a fresh
copy of the package, without bytecode and with an empty HOME; beside it is the second start of the same copy.
``--help`` is beside ``import numpy``.
"""

from __future__ import annotations

import gc
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from harness import parser, print_machine, print_table, shown, spread, write_json
from peer import Peer, null_node, our_node, own_domain, running

import tire_dynamics

PACKAGE = Path(tire_dynamics.__file__).parent
RATE = 500.0
PATIENCE = 30.0  # [s]
HELPS = 20  # short processes are run this often in a repeat


def main() -> None:
    chosen = parser(__doc__.splitlines()[0], repeats=5).parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # as installed: modules are compiled once, not at every start
    print_machine()
    gc.disable()
    try:
        wrench = first_wrench(chosen.repeats)
        cold = cold_start(chosen.repeats)
        usage = help_and_numpy(chosen.repeats)
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    rows = [
        line("first wrench, against the null node", wrench, "<= 1.3, best"),
        line("first wrench, cold, against the second start", cold, "1"),
        line("--help, against import numpy", usage, "<= 1.5"),
    ]
    print_table((f"medians over {chosen.repeats} repeats [s]", "ours", "floor", "ratio", "target"), rows)
    write_json(chosen.json, "start", {"first_wrench": wrench, "cold": cold, "help": usage})


def line(name: str, figures: dict[str, Any], target: str) -> tuple[str, ...]:
    return name, shown(figures["ours"], ".3f"), shown(figures["floor"], ".3f"), shown(figures["ratio"]), target


def compared(ours: list[float], floor: list[float]) -> dict[str, Any]:
    ratio = [a / b for a, b in zip(ours, floor, strict=True)]
    return {"ours": spread(ours), "floor": spread(floor), "ratio": spread(ratio)}


def first_wrench(repeats: int) -> dict[str, Any]:
    """From a process's start to its first wrench [s]; the target is for the best of each."""
    times: dict[str, list[float]] = {"ours": [], "floor": []}
    for repeat in range(-1, repeats):  # the first fills caches
        for name, command in (("ours", our_node), ("floor", null_node)):
            found = until_wrench(command(RATE, None))
            if repeat >= 0:
                times[name].append(found)
    best = min(times["ours"]) / min(times["floor"])
    return {**compared(times["ours"], times["floor"]), "best_of_each": best}


def cold_start(repeats: int) -> dict[str, Any]:
    """The first start of a fresh copy [s], beside its second."""
    times: dict[str, list[float]] = {"ours": [], "floor": []}
    left_out = shutil.ignore_patterns("__pycache__")
    for _ in range(repeats):
        with tempfile.TemporaryDirectory(prefix="start_") as folder:
            copy, home = Path(folder, "copy"), Path(folder, "home")
            home.mkdir()
            shutil.copytree(PACKAGE, copy / PACKAGE.name, ignore=left_out)
            environment = {**os.environ, "HOME": str(home), "PYTHONPATH": str(copy)}
            for name in ("ours", "floor"):
                times[name].append(until_wrench(our_node(RATE, None), cwd=copy, env=environment))
    return compared(times["ours"], times["floor"])


def until_wrench(command: list[str], **options: Any) -> float:
    """From the start of a node's process to the receipt of its first wrench [s]."""
    with own_domain(), Peer(RATE) as peer:
        peer.run(1.0)
        if "env" in options:  # the domain is the peer's
            options["env"] = {**options["env"], **{k: v for k, v in os.environ.items() if k.startswith("ROS_")}}
        begin = time.time_ns()
        with running(command, **options):
            peer.run(PATIENCE, until_wrench=True)
            if not peer.wrenches[0]:
                raise SystemExit(f"no wrench within {PATIENCE:g} s: {' '.join(command)}")
            return (peer.wrenches[0][0][1] - begin) * 1e-9


def help_and_numpy(repeats: int) -> dict[str, Any]:
    """Whole processes [s]: the command's help, and the import of numpy."""
    script = Path(sys.executable).with_name("tire-dynamics")
    ours = [str(script)] if script.exists() else [sys.executable, "-m", "tire_dynamics.cli.main"]
    commands = {"ours": [*ours, "--help"], "floor": [sys.executable, "-c", "import numpy"]}
    times: dict[str, list[float]] = {name: [] for name in commands}
    for repeat in range(-1, repeats):
        found: dict[str, list[float]] = {name: [] for name in commands}
        for _ in range(HELPS):
            for name, command in commands.items():
                begin = time.perf_counter()
                subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
                found[name].append(time.perf_counter() - begin)
        if repeat >= 0:
            for name, values in found.items():
                times[name].append(spread(values)["median"])
    return compared(times["ours"], times["floor"])


if __name__ == "__main__":
    main()
