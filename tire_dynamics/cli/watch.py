"""``tire-dynamics watch``: a running node on a terminal."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..files.errors import InputError
from .answer import printable
from .node import need_ros

if TYPE_CHECKING:
    from ..ros.observer import Observer, Status

__all__ = ["add_arguments", "run", "view"]

_LEVELS = (("OK", "green"), ("WARN", "yellow"), ("ERROR", "bold red"), ("gone", "dim"))
_VERDICT_STYLES = {"stable": "", "unstable": "bold red"}
_LINE_STYLES = {20: "", 30: "yellow", 40: "bold red", 50: "bold red"}
_BARS = " ▁▂▃▄▅▆▇█"
_REFRESH = 0.2  # [s]
_SHOWN = 24  # forces in a row of bars


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Declare the options of ``watch``."""
    command.add_argument("--node", metavar="NAME", help="full name, where there are several: /car/tire_dynamics")
    command.add_argument("--once", action="store_true", help="print one view and end; so it does in a pipe")
    command.add_argument(
        "--wait", metavar="S", type=float, default=10.0, help="wait at most S seconds for the node (default 10)"
    )
    command.add_argument(
        "--ros-args",
        metavar="ARG",
        nargs=argparse.REMAINDER,
        default=[],
        help="arguments for ROS, to the end of the line",
    )


def run(options: argparse.Namespace) -> int:
    """Watch until Ctrl-C; exit status 0."""
    need_ros()
    try:
        from rich.console import Console
        from rich.live import Live
    except ImportError:
        raise InputError("this needs rich: pip install rich") from None
    from ..ros.observer import Observer

    if not 0.0 < options.wait < 1e6:
        raise InputError(f"--wait is {options.wait}; it must be > 0 and < 1e6 s")
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda caught, frame: stopping.append(caught))
    node = options.node if options.node is None else f"/{options.node.strip('/')}"
    with Observer(node, options.ros_args) as observer:
        _wait(observer, options.wait, stopping)
        console = Console()
        if options.once or not sys.stdout.isatty():
            for _ in range(10):  # the forces come when their topics are known
                if not stopping and not all(observer.forces(wheel) for wheel in observer.wheels):
                    observer.spin(_REFRESH)
            console.print(view(observer, console.width, 1000))
            return 0
        with Live(console=console, screen=True, auto_refresh=False) as live:
            while not stopping:
                live.update(view(observer, console.width, console.height), refresh=True)
                observer.spin(_REFRESH)
    return 0


def _wait(observer: Observer, seconds: float, stopping: Sequence[int]) -> None:
    over = time.monotonic() + seconds
    while observer.node is None and not stopping:
        if time.monotonic() > over:
            others = f"; there is {', '.join(observer.nodes)}" if observer.nodes else ""
            name = observer.name or "a node of tire_dynamics"
            raise InputError(
                f"{name} is not heard on /diagnostics within {seconds:g} s{others}: is it running, with the same "
                "ROS_DOMAIN_ID?"
            )
        observer.spin(_REFRESH)
    if not stopping:
        observer.spin(0.5)  # other nodes publish in the same second


def view(observer: Observer, width: int, height: int) -> Any:
    """What is known of the node as something that rich can draw.

    Parameters
    ----------
    observer : Observer
    width, height : int
        Of the terminal, in characters.

    Returns
    -------
    rich.console.Group
    """
    from rich import box
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    wheels = observer.wheels
    table = Table(box=box.SIMPLE_HEAD, expand=False, pad_edge=False)
    table.add_column("wheel")
    for name in ("speed\nrad/s", "load\nN", "axle x\nN", "axle z\nN"):
        table.add_column(name, justify="right")
    table.add_column("axle z, the last seconds" if width >= 100 else "axle z", no_wrap=True)
    table.add_column("stability")
    table.add_column("lost at\nrad/s", justify="right")
    for name, status in wheels.items():
        forces = observer.forces(name)
        x, z = (str(round(force)) for force in forces[-1]) if forces else ("-", "-")
        verdict = status.values.get("stability", "-").removeprefix("asymptotically ")
        table.add_row(
            Text(printable(name), style=_LEVELS[status.level][1]),
            _number(status, "speed [rad/s]", ".2f"),
            _number(status, "load [N]", ".0f"),
            x,
            z,
            bars([z for _, z in forces], _SHOWN if width >= 100 else _SHOWN // 3),
            Text(printable(verdict), style=_VERDICT_STYLES.get(verdict, "yellow")),
            _number(status, "critical speed [rad/s]", ".0f"),
        )
    parts: list[Any] = [_head(observer), table]
    for name, status in wheels.items():
        if status.level:
            level, style = _LEVELS[status.level]
            parts.append(Text.assemble((f"{level:5} ", style), f"{name}: {printable(status.message)}"))
    if len(observer.nodes) > 1:
        others = [name for name in observer.nodes if name != observer.name]
        parts.append(Text(f"also there: {', '.join(others)} (--node)", style="dim"))
    room = max(3, height - 8 - len(wheels) - len(parts))
    parts.append(Text(""))
    parts += [
        Text(printable(line)[:width], style=_LINE_STYLES.get(level, ""), no_wrap=True)
        for level, line in list(observer.lines)[-room:]
    ]
    return Group(*parts)


def _head(observer: Observer) -> Any:
    from rich.text import Text

    status = observer.node
    assert status is not None
    level, style = _LEVELS[status.level]
    values = status.values
    text = Text.assemble((f"{observer.name}", "bold"), "  ", (level, style), f"  {printable(status.message)}\n")
    if "ticks" in values:
        median, longest = values["step time, median [us]"], values["step time, longest [us]"]
        text.append(f"ticks {values['ticks']}, missed {values['ticks missed']}; ")
        text.append(f"step {median} us, longest {longest} us\n")
    log = values.get("log", "-")
    text.append(f"log {printable(log)}")
    if "log: written" in values:
        counts = [f"{values[f'log: {what}']} {what}" for what in ("written", "dropped", "files")]
        text.append(f"\n    {', '.join(counts)}")
    return text


def _number(status: Status, key: str, form: str) -> str:
    try:
        return format(float(status.values[key]), form)
    except (KeyError, ValueError):
        return "-"


def bars(values: Sequence[float], count: int) -> str:
    """The last values as bars, from the least to the greatest of them."""
    values = values[-count:]
    if not values:
        return ""
    low, high = min(values), max(values)
    if high - low < 1e-6 * max(abs(high), 1.0):
        return _BARS[4] * len(values)
    steps = len(_BARS) - 2
    return "".join(_BARS[1 + round(steps * (value - low) / (high - low))] for value in values)
