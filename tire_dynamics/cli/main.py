"""The command ``tire-dynamics``."""

from __future__ import annotations

import argparse
import math
import os
import re
import signal
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NoReturn

from ..files.errors import InputError

if TYPE_CHECKING:
    pass

__all__ = ["main", "node"]

_MAX_RPM = 1e7
_MOST_MODES = 12  # of the belt; more take minutes
_MAX_LINE = 2000  # characters of an error: a stranger's file may have a million topics to list
UNUSABLE = 2  # exit status for input that cannot be used
SHELLS = ("bash", "zsh", "fish")
_FILES = ("BAG", "CSV", "DIR", "FILE", "HTML", "IN", "OUT", "PNG", "TIR", "YAML")  # what stands for a file or a folder

EXIT_STATUS = """exit status, of every command:
  0      done
  1      a fault of this program, with a traceback: please report it
  2      input or usage that cannot be used; a line on standard error says what, and what to do.
         Of several bags: some could not be replayed, and the others were.
         Of a replay: a wheel has no output, and the others have; a line says why
  128+N  ended by signal N: 130 by Ctrl-C, 141 where the reader of a pipe has gone"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit status, as ``EXIT_STATUS`` says."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    try:
        if arguments[:1] == ["node"]:
            return _node(arguments[1:])  # everything behind it is for ROS
        options = _Commands().parse(arguments)
        status = int(options.run(options) or 0)
        sys.stdout.flush()  # here, where a reader that has gone is no error of ours
        return status
    except InputError as error:
        return _refuse(error)
    except BrokenPipeError:  # the reader of our output has gone, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except OSError as error:  # a disk that is full, a folder that may not be written
        return _refuse(InputError(f"{error.filename or _output(arguments)}: {error.strerror or error}"))
    except KeyboardInterrupt:
        return 128 + signal.SIGINT


def _output(arguments: Sequence[str]) -> str:
    """The output that the command line names, for an error that names no file."""
    for option in ("-o", "--output"):
        if option in arguments[:-1]:
            return arguments[arguments.index(option) + 1]
    return "writing"


def node() -> int:
    """Entry point of ``ros2 run tire_dynamics node``."""
    return main(["node", *sys.argv[1:]])


def _refuse(error: InputError) -> int:
    print(f"tire-dynamics: {_one_line(str(error))}", file=sys.stderr)
    return UNUSABLE


def _one_line(text: str) -> str:
    """A text as one line of what a terminal can show, not endless; names in it may be a stranger's."""
    from .answer import printable

    text = " ".join(text.split())
    return printable(text if len(text) <= _MAX_LINE else f"{text[:_MAX_LINE]} ...")


# -- usage ------------------------------------------------------------------------------------------------------------


class _Formatter(argparse.HelpFormatter):
    """Paragraphs are filled, but lines that begin with a space, and those below a line that ends with a colon."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=28)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        paragraphs = text.split("\n\n")
        return "\n\n".join(
            paragraph if "\n " in paragraph else super(_Formatter, self)._fill_text(paragraph, width, indent)
            for paragraph in paragraphs
        )


class _Parser(argparse.ArgumentParser):
    example = ""  # of a right call

    def error(self, message: str) -> NoReturn:
        """Refuse in words of our own where argparse's do not say what to do next."""
        wrong = re.fullmatch(r"argument (\S+): invalid (int|float) value: (.*)", message, re.DOTALL)
        if wrong:
            option, kind, value = wrong.groups()
            message = f"{option} is {value}; it must be a {'whole ' if kind == 'int' else ''}number"
        elif message.startswith("the following arguments are required: "):
            message = f"needs {message.partition(': ')[2]}" + (f"; such as {self.example}" if self.example else "")
        raise InputError(f"{message} (see {self.prog} --help)")

    def refuse_extra(self, extra: Sequence[str]) -> NoReturn:
        """Say which arguments nobody takes, and which was meant."""
        first = extra[0]
        if not first.startswith("-"):
            raise InputError(f"{first!r} is one argument too many (see {self.prog} --help)")
        name = first.partition("=")[0]
        known = [option for action in self._actions for option in action.option_strings]
        raise InputError(f"{name} is no option{_meant(name, known)} (see {self.prog} --help)")


def _meant(name: str, known: Sequence[str]) -> str:
    import difflib

    close = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean {close[0]}?" if close else ""


class _Commands:
    """The parser with its commands, which stand in groups in the help."""

    def __init__(self) -> None:
        self.parser = _Parser(
            prog="tire-dynamics", usage="tire-dynamics [-h] [--version] COMMAND ...", formatter_class=_Formatter
        )
        self.parser.add_argument("--version", nargs=0, action=_Version, help="say which version this is")
        # The list in the description has them by group.
        self.commands = self.parser.add_subparsers(
            dest="command", metavar="COMMAND", required=True, prog="tire-dynamics", help=argparse.SUPPRESS
        )
        self.help: dict[str, str] = {}
        self._groups: dict[str, list[str]] = {}
        _declare(self)
        lines = ["What the tires do to the axles: live, from bags, and in theory."]
        lines += ["\n".join([f"{group}:", *members]) for group, members in self._groups.items()]
        self.parser.description = "\n\n".join(lines)
        self.parser.epilog = "\n\n".join(
            [_examples(_FIRST_STEPS), EXIT_STATUS, "tire-dynamics COMMAND --help says more."]
        )

    def add(
        self, group: str, name: str, *, help: str, examples: Sequence[tuple[str, str]], description: str = ""
    ) -> _Parser:
        """Declare a command.

        Parameters
        ----------
        group : str
            The heading under which the help lists it.
        name, help : str
            As it is called, and what it does in a few words.
        examples : sequence of (str, str)
            Calls, without ``tire-dynamics``, and what each does. The first is shown to whoever leaves something out.
        description : str
            What it does, in sentences.
        """
        self._groups.setdefault(group, []).append(f"  {name:13} {help}")
        self.help[name] = help
        command: _Parser = self.commands.add_parser(
            name, help=help, description=description or None, epilog=_examples(examples), formatter_class=_Formatter
        )
        command.example = f"tire-dynamics {examples[0][0]}"
        return command

    def parse(self, arguments: Sequence[str]) -> argparse.Namespace:
        """The options; ``InputError`` if the arguments are not what a command takes."""
        known = self.commands.choices
        name = next((each for each in arguments if not each.startswith("-")), None)
        if name is None and not {"-h", "--help", "--version"} & set(arguments):
            if arguments:
                self.parser.refuse_extra(arguments)
            raise InputError("a COMMAND is missing: tire-dynamics --help lists them")
        if name is not None and name not in known:
            meant = _meant(name, list(known))
            raise InputError(f"{name[:100]!r} is no COMMAND{meant or ': tire-dynamics --help lists them'}")
        options, extra = self.parser.parse_known_args(arguments)
        if extra:
            known[options.command].refuse_extra(extra)
        return options


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *arguments: Any) -> NoReturn:
        from .. import __version__

        print(f"tire-dynamics {__version__}")
        parser.exit()


def _examples(examples: Sequence[tuple[str, str]]) -> str:
    lines = ["examples:"]
    for call, what in examples:
        lines += [f"  # {what}"] if what else []
        lines.append(f"  tire-dynamics {call}")
    return "\n".join(lines)


# -- the commands -----------------------------------------------------------------------------------------------------

_FIRST_STEPS = (
    ("info bags/sample", "what is in a bag, and whether it can be replayed"),
    ("replay bags/sample -o sample_log", "the forces on the axles of that drive"),
    ("stability --speed-rpm 2000", "is the tire of the paper stable at 2000 rpm?"),
    ("node --ros-args --params-file config/vehicle.yaml", "beside a vehicle stack"),
)
_A_BAG = "a rosbag2 folder, or a .mcap, .db3 or ROS 1 .bag file"
_BAGS, _MODEL, _OTHER = "bags", "the model", "beside these"
_NODE_EXAMPLES = (
    ("node --ros-args --params-file config/vehicle.yaml", "a car with four wheels"),
    ("node --ros-args -p rate_hz:=1000.0 -r wheel/load:=/sensors/load", "other values and topics"),
    ("node --ros-args -p log.directory:=/tmp/logs", "with a log, which replay gives again bit for bit"),
)


def _declare(commands: _Commands) -> None:
    from ..replay import jobs
    from . import answer, csv_import, figures, identify, import_tir, loads, report, response, road, uncertainty
    from . import map as map_

    command = commands.add(
        "live",
        "node",
        help="the live node; ROS arguments follow",
        examples=_NODE_EXAMPLES,
    )

    command = commands.add(
        _BAGS,
        "info",
        help="what is in a bag, whether it is whole, and whether it can be replayed",
        description="Says what is in a bag: files, times, topics, types, rates and QoS; of a log of the node also its "
        "parameters; whether it is damaged, and whether it can be replayed. A bag that is whole is not read for it, "
        "only its index. A table on a terminal, plain text in a pipe.",
        examples=(
            ("info bags/sample", ""),
            ("info recording_0.mcap --json", "for a program"),
            ("info recording --remap front_left/load:=/fl/force_torque", "would it do, with this topic as the load?"),
        ),
    )
    command.add_argument("input", metavar="BAG", help=_A_BAG)
    _add_remap(command)
    _add_clock(command)
    answer.add_arguments(command, quiet=False)
    command.set_defaults(run=_info)

    command = commands.add(
        _BAGS,
        "replay",
        help="run a bag through the same logic as the live node",
        description="Runs a bag through the same logic as the live node. With several bags, and with --jobs or "
        "--scheduler also with one, OUT is a folder with a bag of the same name for each; a bag that cannot be "
        "replayed is named, and the others go on.",
        examples=(
            ("replay bags/sample -o sample_log", "a recording, or a log with its own parameters"),
            ("replay drive -o drive_log --config config/vehicle.yaml --force", "with these tires, over the last try"),
            ("replay monday/* -o logs --jobs 4", "many bags in four processes"),
            ("replay drive -o out --remap front_left/load:=/fl/force_torque", "where topics are named otherwise"),
        ),
    )
    command.add_argument("input", metavar="IN", nargs="+", help=f"{_A_BAG}: inputs, or a log of the node")
    _add_output(command, "the rosbag2 folder to write")
    _add_config(command, "parameters of the node, or the fields of one unit")
    command.add_argument("--force", action="store_true", help="replace a bag that is to be written and exists")
    _add_remap(command)
    _add_clock(command)
    jobs.add_arguments(command, "the bags")
    answer.add_arguments(command)
    command.set_defaults(run=_replay)

    command = commands.add(
        _BAGS,
        "report",
        help="a page about a drive: forces, spectra, belt, stability, inputs",
        examples=(
            ("report sample_log -o report.html", "of a log, or of a replay's output"),
            ("report bags/sample -o report.html --config config/vehicle.yaml", "of a recording, with these tires"),
        ),
    )
    report.add_arguments(command)
    _add_remap(command)
    _add_clock(command)
    answer.add_arguments(command)
    command.set_defaults(run=report.run)

    command = commands.add(
        _BAGS,
        "recover",
        help="a whole bag of what a truncated or damaged one still holds",
        description="Makes a whole bag of what a truncated or damaged one still holds, and says what was kept and "
        "what was lost. IN is never changed.",
        examples=(("recover cut_0.mcap -o whole", ""), ("recover cut -o whole --json", "for a program")),
    )
    command.add_argument("input", metavar="IN", help="a .mcap file, or a folder of some, with metadata.yaml or without")
    _add_output(command, "the rosbag2 folder to write")
    command.add_argument("--force", action="store_true", help="replace OUT if it exists")
    answer.add_arguments(command)
    command.set_defaults(run=_recover)

    command = commands.add(
        _BAGS,
        "play",
        help="publish a bag's messages live",
        description="Publishes a bag's messages at the pace at which they were recorded, until the end or Ctrl-C.",
        examples=(
            ("play bags/sample", "once, its stamps moved to the present"),
            ("play drive --rate 2 --loop", "twice as fast, again and again"),
            ("play drive --wait 10", "begin when somebody listens to every topic, or after 10 s"),
        ),
    )
    command.add_argument("input", metavar="IN", help=_A_BAG)
    command.add_argument("--rate", metavar="R", type=float, default=1.0, help="speed of play (default 1)")
    command.add_argument("--loop", action="store_true", help="begin again at the end")
    command.add_argument("--keep-stamps", action="store_true", help="do not move header stamps to the present")
    command.add_argument(
        "--max-gap",
        metavar="S",
        type=float,
        default=3600.0,
        help="skip a gap in the recording that is longer than S seconds, and say so (default 3600)",
    )
    command.add_argument(
        "--wait", metavar="S", type=float, default=0.0, help="wait at most S seconds for a subscriber on every topic"
    )
    answer.add_arguments(command)
    command.set_defaults(run=_play)

    command = commands.add(
        _BAGS,
        "import",
        help="CSV recordings into an input bag",
        examples=(
            (
                "import --speed speed.csv --speed-columns left=wl right=wr"
                " --load load.csv --load-columns left=fl right=fr -o drive",
                "rad/s and N",
            ),
            (
                "import --speed can.csv --speed-columns wheel=v --speed-unit m/s --rolling-radius 0.31"
                " --load imu.csv --load-columns az --load-unit m/s^2 --corner-mass 380 -o drive",
                "a load estimated from an accelerometer",
            ),
            (
                'import --speed log.csv --speed-columns "left=Wheel Speed FL" --rolling-radius 0.31'
                ' --load log.csv --load-columns "left=Tyre Load FL" -o drive --forces forces --config tire.yaml',
                "a logger's export, units as it says, and on to forces",
            ),
        ),
    )
    csv_import.add_arguments(command)
    answer.add_arguments(command)
    command.set_defaults(run=csv_import.run)

    command = commands.add(
        _BAGS,
        "loads",
        help="wheel loads from an IMU, travel, hub accelerations and wheel speeds",
        examples=(
            ("loads drive -o drive_loads --vehicle config/car.yaml", "of a folder of CSV files, for this car"),
            ("loads drive -o drive_loads --json", "with drive/car.yaml; for a program"),
        ),
    )
    loads.add_arguments(command)
    answer.add_arguments(command)
    command.set_defaults(run=loads.run)

    command = commands.add(
        _BAGS,
        "road",
        help="a road and a speed into an input bag: ISO 8608, cleats, steps, profiles",
        examples=(
            ("road --class C --speed-kmh 80 -o rough", "a car on an average road, 20 s"),
            ("road --cleat 0.01:0.02@5 --speed-kmh 30 --duration 2 --wheels wheel -o cleat", "one wheel over a cleat"),
            ("road --profile lane.csv --speed drive.csv -o lane", "a measured road at a measured speed"),
        ),
    )
    road.add_arguments(command)
    answer.add_arguments(command)
    command.set_defaults(run=road.run)

    command = commands.add(
        _MODEL,
        "stability",
        help="Floquet stability at a speed, as JSON",
        description="Says whether the rotating tire is stable at a speed: multipliers, exponents, verdict and critical "
        "speed, as JSON on standard output.",
        examples=(
            ("stability --speed-rpm 2000", "the tire of the paper"),
            ("stability --speed-rpm 2000 --config config/vehicle.yaml", "this one"),
            ("stability --speed-rpm 2000 --config unit.yaml --samples 1000", "and what its errors do to that"),
        ),
    )
    command.add_argument("--speed-rpm", metavar="R", type=float, required=True, help="speed of the wheel [rpm]")
    _add_config(command, "the fields of one unit, or parameters of the node")
    command.add_argument(
        "--n-max",
        metavar="N",
        type=int,
        help="with a sidewall that is not uniform: the modes n = 0 to N, which its harmonics couple (1: n = 1 alone)",
    )
    command.add_argument(
        "--contact",
        action="store_true",
        help="on the road, without lift-off, with the belt's harmonics to --n-max (30)",
    )
    uncertainty.add_arguments(command)
    command.add_argument("--json", action="store_true", help="as it is anyway")
    command.set_defaults(run=_stability)

    command = commands.add(
        _MODEL,
        "map",
        help="stability or transmissibility over two fields of the unit or the speed",
        examples=(
            ("map --x speed_rpm=60:60000 --y zeta_1=0.01:0.2 -o map.png", "where is it stable?"),
            (
                "map --x speed_rpm=60:30000 --y tangential_stiffness=1e7:1e8 --log-y --quantity transmissibility"
                " -o transmissibility.png",
                "and how much of a constant load arrives?",
            ),
        ),
    )
    map_.add_arguments(command)
    answer.add_arguments(command)
    command.set_defaults(run=map_.run)

    command = commands.add(
        _MODEL,
        "response",
        help="how a load that varies as a sine arrives at the axle, as Bode plots",
        examples=(
            ("response --speed-rpm 0 2000 4000 -o bode.png", "the tire of the paper at three speeds"),
            ("response --speed-rpm 800 --config config/vehicle.yaml --to 150 --json", "this one, as numbers"),
        ),
    )
    response.add_arguments(command)
    answer.add_arguments(command)
    command.set_defaults(run=response.run)

    command = commands.add(
        _MODEL,
        "import-tir",
        help="the rigid ring of an MF-Tyre/MF-Swift property file as a unit",
        examples=(
            ("import-tir tire.tir -o unit.yaml --wheel-mass 12 --suspension-stiffness 3.2e4", ""),
            (
                "import-tir tire.tir -o unit.yaml --wheel-mass 12 --suspension-stiffness 3.2e4"
                " --set sidewall_damping=reaction --set zeta_s=0.3",
                "for a vehicle",
            ),
            (
                "import-tir pac2002.tir -o unit.yaml --wheel-mass 12 --suspension-stiffness 3.2e4 --estimate"
                " --key MASS=9.8",
                "a file without a rigid ring, by rules, its mass known",
            ),
        ),
    )
    import_tir.add_arguments(command)
    answer.add_arguments(command)
    command.set_defaults(run=import_tir.run)

    command = commands.add(
        _MODEL,
        "identify",
        help="a unit that fits a force measured at the axle, with its errors",
        examples=(
            ("identify drive --measured /hub/wrench --start tire.yaml -o unit.yaml --plot fit.png", ""),
            (
                "identify drive --measured /hub/wrench --start tire.tir --wheel-mass 30 --suspension-stiffness 2.5e4"
                " --fit k_1,zeta_1 -o unit.yaml",
                "of a tire file, the rest held",
            ),
        ),
    )
    identify.add_arguments(command)
    _add_remap(command)
    _add_clock(command)
    answer.add_arguments(command)
    command.set_defaults(run=identify.run)

    command = commands.add(
        _MODEL,
        "figures",
        help="redraw the paper's figures, with their numbers as CSV",
        examples=(("figures -o figures", ""),),
    )
    figures.add_arguments(command)
    answer.add_arguments(command)
    command.set_defaults(run=figures.run)

    command = commands.add(
        _OTHER,
        "completion",
        help="the script with which a shell completes these commands",
        description="Prints a script with which a shell completes commands, options and file names at Tab. The script "
        "is static: nothing of this program is started at Tab. Make it anew after an update.",
        examples=(
            ("completion bash > ~/.local/share/bash-completion/completions/tire-dynamics", "bash"),
            ("completion zsh > ~/.zfunc/_tire-dynamics", "zsh, with `fpath+=~/.zfunc` before compinit in ~/.zshrc"),
            ("completion fish > ~/.config/fish/completions/tire-dynamics.fish", "fish"),
        ),
    )
    command.add_argument("shell", metavar="SHELL", choices=SHELLS, help=", ".join(SHELLS))
    command.set_defaults(run=_completion)


def _add_output(command: argparse.ArgumentParser, help: str) -> None:
    command.add_argument("-o", "--output", metavar="OUT", required=True, help=help)


def _add_config(command: argparse.ArgumentParser, help: str) -> None:
    command.add_argument("--config", metavar="YAML", help=help)


def _add_remap(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--remap",
        metavar="INPUT:=TOPIC",
        action="append",
        default=[],
        help="take the input from this topic of the bag, as in front_left/load:=/fl/force_torque; may be repeated",
    )
    command.add_argument(
        "--joint",
        metavar="WHEEL:=NAME",
        action="append",
        default=[],
        help="take the wheel's speed from this joint of joint_states, as in front_left:=fl_joint; may be repeated",
    )


def _add_clock(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--clock",
        choices=("stamp", "log"),
        help="one clock where stamps and times of receipt have two: that of the stamps, as of simulated time, or that "
        "of the receipt",
    )


def _node(arguments: list[str]) -> int:
    if arguments in (["-h"], ["--help"]):
        print("usage: tire-dynamics node [--ros-args -p NAME:=VALUE --params-file YAML -r FROM:=TO ...]\n")
        print("The live node, until SIGINT or SIGTERM. Its parameters:\n")
        from ..replay.parameters import PARAMETERS

        for row in PARAMETERS:
            default = list(row.default) if isinstance(row.default, tuple) else row.default
            print(f"  {row.name:30} {row.kind:9} {default!s:12} {row.description}")
        print(f"\n{_examples(_NODE_EXAMPLES)}\n\n{EXIT_STATUS}")
        return 0
    _need_ros()
    # Matrices here are small: more threads would only take the core from the one that ticks. Before NumPy is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from ..ros.start import start

    start(arguments)
    return 0


def _need_ros() -> None:
    from importlib.util import find_spec

    if find_spec("rclpy") is None:
        raise InputError(
            "this needs rclpy: source a ROS 2 installation, or pip install 'tire_dynamics[ros]' (Linux, x86-64)"
        )


def _play(options: argparse.Namespace) -> int:
    _need_ros()
    from ..ros.play import play
    from .answer import answer

    count = play(
        options.input,
        rate=options.rate,
        loop=options.loop,
        keep_stamps=options.keep_stamps,
        wait=options.wait,
        max_gap=options.max_gap,
    )
    answer(options, {"input": options.input, "messages": count}, f"{count} messages published")
    return 0


def _info(options: argparse.Namespace) -> int:
    from .info import run

    return run(options)


def _recover(options: argparse.Namespace) -> int:
    from .recover import run

    return run(options)


def _say_if_slow() -> None:
    """One line where the core runs interpreted, for what takes much longer then."""
    from ..build_state import how_to_compile, is_compiled

    if not is_compiled():
        print(f"tire-dynamics: {how_to_compile()}", file=sys.stderr)


def _replay(options: argparse.Namespace) -> int:
    if len(options.input) > 1 or options.jobs is not None or options.scheduler is not None:
        from . import batch

        _say_if_slow()

        return UNUSABLE if batch.run(options) else 0
    from ..replay.replay import joints_of, remaps_of, replay
    from .answer import answer

    _say_if_slow()
    [source] = options.input
    summary = replay(
        source,
        options.output,
        config=options.config,
        force=options.force,
        quiet=options.quiet,
        remaps=remaps_of(options.remap),
        joints=joints_of(options.joint),
        clock=options.clock,
    )
    if summary.damage:
        print(_one_line(f"{source} is damaged: {summary.damage}; what stands before was replayed"), file=sys.stderr)
    for wheel, reason in summary.without.items():
        print(_one_line(f"{wheel}: no output; {reason}"), file=sys.stderr)
    for doubt in summary.doubts:
        print(_one_line(f"doubtful: {doubt}"), file=sys.stderr)
    total = sum(summary.received.values())
    written = sum(summary.written.values())
    content = {"input": source, "output": options.output, **summary._asdict()}
    answer(options, content, f"{options.output}: {total} messages in, {written} out")
    return UNUSABLE if summary.without else 0


def _stability(options: argparse.Namespace) -> int:
    import json

    from ..estimator.vehicle import modes_on_the_road, stability_reply
    from ..replay.parameters import complete, read_config, unit_of

    if not abs(options.speed_rpm) <= _MAX_RPM:
        raise InputError(f"--speed-rpm is {options.speed_rpm}; it must be between -{_MAX_RPM:g} and {_MAX_RPM:g}")
    values = complete(read_config(options.config) if options.config else {})
    try:
        speed = options.speed_rpm * math.pi / 30.0
        unit = unit_of(values)
        most = 100 if options.contact and modes_on_the_road(unit, 100) == 100 else _MOST_MODES
        usual = modes_on_the_road(unit, 30) if options.contact else 1
        n_max = usual if options.n_max is None else options.n_max
        if not 1 <= n_max <= most:
            raise InputError(f"--n-max is {n_max}; it must be from 1 to {most}")
        if options.contact and options.samples is not None:
            raise InputError("--samples is for the tire under a given load; leave --contact out")
        reply = stability_reply("wheel", unit, speed, values["model"], n_max, options.contact)
    except (ArithmeticError, ValueError) as error:
        raise InputError(f"--speed-rpm is {options.speed_rpm}: {error}") from None
    if options.samples is not None:
        from .answer import plain
        from .uncertainty import uncertainty

        reply["uncertainty"] = plain(uncertainty(options, unit_of(values), speed, values["model"]))
    elif options.error:
        raise InputError("--error belongs to --samples, which is not given")
    print(json.dumps(reply, indent=2))
    return 0


def _completion(options: argparse.Namespace) -> int:
    try:
        import shtab
    except ImportError:
        raise InputError("completion needs shtab: pip install 'tire_dynamics[completion]'") from None
    if options.shell not in shtab.SUPPORTED_SHELLS:
        raise InputError(f"this shtab knows no {options.shell}: pip install 'shtab>=1.9'")
    commands = _Commands()
    commands.commands.help = "what to do"  # what has no help of its own is not completed
    for name, command in commands.commands.choices.items():
        command.description = commands.help[name]  # a line beside its name
        for action in command._actions:
            if action.metavar in _FILES:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(commands.parser, options.shell))
    return 0


if __name__ == "__main__":
    sys.exit(main())
