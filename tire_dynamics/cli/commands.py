"""The commands: their names, groups, examples and descriptions; each one's options and work stand in its module."""

from __future__ import annotations

import argparse
from functools import partial

from .node import NODE_EXAMPLES
from .options import A_BAG, add_clock, add_inputs, add_joint, add_output, add_remap, add_vehicle
from .usage import Commands

__all__ = ["all_commands"]

_FIRST_STEPS = (
    ("info bags/sample", "what is in a bag, and whether it can be replayed"),
    ("replay bags/sample -o sample_log", "the forces on the axles of that drive"),
    ("stability --speed-rpm 2000", "is the tire of the paper stable at 2000 rpm?"),
    ("node --ros-args --params-file config/vehicle.yaml", "beside a vehicle stack"),
)
_BAGS, _MODEL, _OTHER = "bags", "the model", "beside these"


def all_commands() -> Commands:
    """The parser with all commands."""
    return Commands(_declare, _FIRST_STEPS)


def _declare(commands: Commands) -> None:
    from . import (
        answer,
        campbell,
        compare,
        completion,
        csv_import,
        figures,
        identify,
        import_tir,
        loads,
        play,
        replay,
        report,
        response,
        road,
        stability,
        watch,
    )
    from . import map as map_

    command = commands.add(
        "live",
        "node",
        help="the live node; ROS arguments follow",
        examples=NODE_EXAMPLES,
    )

    command = commands.add(
        "live",
        "watch",
        help="a running node on this terminal: forces, stability, log",
        description="Shows a running node, until Ctrl-C: what its wheels carry and do to their axles, stability, "
        "ticks, the log, and what it says on /rosout. For machines without RViz.",
        examples=(
            ("watch", "the node that is there"),
            ("watch --node /red/tire_dynamics", "one of two"),
            ("watch --once", "once, for a file or a pipe"),
        ),
    )
    watch.add_arguments(command)
    command.set_defaults(run=watch.run)

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
            ("info recording --inputs map.yaml --vehicle config/car.yaml", "and with loads that are estimated?"),
        ),
    )
    command.add_argument("input", metavar="BAG", help=A_BAG)
    add_inputs(command)
    add_vehicle(command)
    add_remap(command)
    add_clock(command)
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
            ("replay drive -o out --inputs config/inputs/av21.yaml", "where messages are others"),
            ("replay drive -o out --vehicle config/car.yaml", "without loads: they are estimated"),
        ),
    )
    replay.add_arguments(command)
    answer.add_arguments(command)
    command.set_defaults(run=replay.run)

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
    add_inputs(command)
    add_remap(command)
    add_clock(command)
    answer.add_arguments(command)
    command.set_defaults(run=report.run)

    command = commands.add(
        _BAGS,
        "compare",
        help="a measured force at the hub against the model's, with confidence",
        examples=(
            ("compare drive drive_log --topic /hub/wrench -o compare.html", "a bag, and its replay"),
            ("compare hub.csv drive_log --columns time=t z=Fz -o compare.html", "a logger's file"),
            (
                "compare hub.mf4 drive_log --columns x=Fx z=Fz --wheel front_left -o compare.html",
                "MDF4, one of four wheels",
            ),
            ("compare /hub/wrench /front_left/axle_wrench --live 60 -o compare.html", "beside a running node"),
        ),
    )
    compare.add_arguments(command)
    add_joint(command)
    answer.add_arguments(command)
    command.set_defaults(run=compare.run)

    command = commands.add(
        _BAGS,
        "recover",
        help="a whole bag of what a truncated or damaged one still holds",
        description="Makes a whole bag of what a truncated or damaged one still holds, and says what was kept and "
        "what was lost. IN is never changed.",
        examples=(("recover cut_0.mcap -o whole", ""), ("recover cut -o whole --json", "for a program")),
    )
    command.add_argument("input", metavar="IN", help="a .mcap file, or a folder of some, with metadata.yaml or without")
    add_output(command, "the rosbag2 folder to write")
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
            ("play drive --ros-args -r __ns:=/car -r /car/front_left/load:=/hub", "below /car, one elsewhere"),
        ),
    )
    play.add_arguments(command)
    answer.add_arguments(command)
    command.set_defaults(run=play.run)

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
            ("import --inputs map.yaml -o drive", "columns of any quantities, as a field map says"),
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
        help="a road and a speed into an input bag, or into forces: ISO 8608, cleats, steps, profiles",
        examples=(
            ("road --class C --speed-kmh 80 -o rough", "a car on an average road, 20 s"),
            ("road --cleat 0.01:0.02@5 --speed-kmh 30 --duration 2 --wheels wheel -o cleat", "one wheel over a cleat"),
            ("road --profile lane.csv --speed drive.csv -o lane", "a measured road at a measured speed"),
            (
                "road --class C --speed-kmh 80 --config car.yaml --forces forces.csv --plot forces.png",
                "straight into forces, with the tire and the static_loads of this file",
            ),
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
    stability.add_arguments(command)
    command.set_defaults(run=stability.run)

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
        "campbell",
        help="frequencies and decay rates over the speed: the Campbell diagram",
        examples=(
            ("campbell -o campbell.png", "the tire of the paper, under a given load"),
            ("campbell --contact --config config/vehicle.yaml --to-rpm 1500 -o road.png", "this one, on the road"),
        ),
    )
    campbell.add_arguments(command)
    answer.add_arguments(command)
    command.set_defaults(run=campbell.run)

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
    add_remap(command)
    add_clock(command)
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
    completion.add_arguments(command)
    command.set_defaults(run=partial(completion.run, commands))


def _info(options: argparse.Namespace) -> int:
    from .info import run

    return run(options)


def _recover(options: argparse.Namespace) -> int:
    from .recover import run

    return run(options)
