"""What the benchmarks share: repeats and their spread, a table for the terminal, JSON for the disk."""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import statistics
import sys
from collections.abc import Iterable, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from tire_dynamics.build_state import is_compiled


def parser(description: str, *, repeats: int) -> argparse.ArgumentParser:
    """A parser with the options that every benchmark has."""
    made = argparse.ArgumentParser(description=description)
    made.add_argument("--repeats", type=int, default=repeats, help=f"how often all of it is run (default {repeats})")
    made.add_argument("--json", metavar="FILE", help="write the figures there as well")
    return made


def spread(values: Iterable[float]) -> dict[str, Any]:
    """Median, lowest and highest of repeats, and the repeats themselves."""
    repeats = [float(value) for value in values]
    return {
        "median": statistics.median(repeats),
        "lowest": min(repeats),
        "highest": max(repeats),
        "repeats": repeats,
    }


def shown(figure: dict[str, Any], form: str = ".2f") -> str:
    """A :func:`spread` as ``median (lowest..highest)``."""
    if len(figure["repeats"]) == 1:
        return format(figure["median"], form)
    return f"{figure['median']:{form}} ({figure['lowest']:{form}}..{figure['highest']:{form}})"


def print_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Aligned columns: the first to the left, the others to the right."""
    lines = [[str(cell) for cell in line] for line in (header, *rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for number, (first, *rest) in enumerate(lines):
        cells = [first.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(rest, widths[1:], strict=True))]
        print("  ".join(cells).rstrip())
        if number == 0:
            print("-" * (sum(widths) + 2 * (len(widths) - 1)))
    sys.stdout.flush()


def machine() -> dict[str, Any]:
    """The kind of machine, how the core runs, and the versions that the figures depend on."""
    versions = {}
    for package in ("numpy", "scipy", "mcap", "mcap-ros2-support", "rosbags", "ros-jazzy-rclpy"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return {
        "cpu": _cpu(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "core": "compiled" if is_compiled() else "interpreted",
        "packages": versions,
    }


def print_machine() -> None:
    """:func:`machine` in two lines."""
    kind = machine()
    packages = ", ".join(f"{name} {number}" for name, number in kind["packages"].items())
    print(f"{kind['cpu']}, {kind['cores']} cores, {kind['system']}, Python {kind['python']}, {packages}")
    print(f"the core is {kind['core']}", flush=True)


def write_json(path: str | None, subject: str, figures: Any) -> None:
    """The figures of one benchmark with the machine they are from; nothing where there is no path."""
    if path:
        with open(path, "w", encoding="utf-8") as file:
            json.dump({"subject": subject, "machine": machine(), "figures": figures}, file, indent=1)
            file.write("\n")


def peak_memory() -> float:
    """The highest resident memory of this process [MiB].

    On Linux the kernel's ru_maxrss starts from that of the process which started this one; VmHWM does not.
    """
    try:
        with open("/proc/self/status", encoding="utf-8") as file:
            for line in file:
                if line.startswith("VmHWM:"):
                    return int(line.split()[1]) / 1024.0
    except OSError:
        pass
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20


def _cpu() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or "unknown CPU"
