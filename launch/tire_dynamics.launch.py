"""Start the live node for a car: ``ros2 launch tire_dynamics tire_dynamics.launch.py``; ``-s`` lists the arguments.

An argument that is left empty leaves the parameter file's value alone. Names and topics may hold ``{wheel}``, which
stands for each wheel's name: ``load_topic:='/{wheel}_ft_broadcaster/wrench'``. With other wheels than the file has,
what belongs to a wheel follows: joint, frame, position and load of those that the file knows, and else the wheel's
name, its name with ``_axle``, the origin.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

NAMES = {
    "wheels": "wheels, comma between them: front_left,front_right,...",
    "joint_names": "joints in joint_states, in the order of the wheels; one with {wheel} is for all",
    "frame_ids": "frames of the outputs, in the order of the wheels; one with {wheel} is for all",
}
TOPICS = {
    "load_topic": ("load", "wheel loads as WrenchStamped: a topic with {wheel}"),
    "load_force_topic": ("load_force", "wheel loads as Float64: a topic with {wheel}"),
    "wheel_speed_topic": ("wheel_speed", "wheel speeds as Float64: a topic with {wheel}"),
}
SWITCHES = {
    "use_sim_time": "take time from /clock",
    "autostart": "start at once; false: wait for a lifecycle manager",
}
TEXTS = {
    "log_directory": ("log.directory", "where to write the log"),
    "tf_parent_frame": ("tf.parent_frame", "frame of which the axles' frames are children in TF, such as base_link"),
}


def start_node(context):
    """The node with the parameters and remappings that the arguments ask for."""

    def given(name):
        return LaunchConfiguration(name).perform(context).strip()

    def names(name):
        return [item.strip() for item in given(name).strip("[]").split(",") if item.strip()]

    from pathlib import Path

    params_file = given("params_file")
    if not Path(params_file).is_file():  # launch would go on without it
        raise ValueError(f"params_file is {params_file!r}; there is no such file")

    def in_file():
        from tire_dynamics.replay.parameters import read_config

        return read_config(params_file, "/".join(["", *filter(None, given("namespace").split("/")), given("name")]))

    wheels = names("wheels")
    overrides = of_wheels(wheels, in_file()) if wheels else {}
    if not wheels and "{wheel}" in "".join(map(given, [*NAMES, *TOPICS])):
        wheels = in_file().get("wheels", ["wheel"])

    for name in NAMES:
        items = names(name)
        if len(items) == 1 and "{wheel}" in items[0]:
            items = [items[0].replace("{wheel}", wheel) for wheel in wheels]
        if items:
            overrides[name] = items
    for name in SWITCHES:
        if given(name):
            overrides[name] = given(name).lower() == "true"
    for name, (parameter, _) in TEXTS.items():
        if given(name):
            overrides[parameter] = given(name)

    remappings = []
    if given("joint_states_topic"):
        remappings.append(("joint_states", given("joint_states_topic")))
    for name, (topic, _) in TOPICS.items():
        pattern = given(name)
        if pattern and "{wheel}" not in pattern:
            raise ValueError(f"{name} is {pattern!r}; it must hold {{wheel}}: each wheel has a topic of its own")
        if pattern:
            remappings += [(f"{wheel}/{topic}", pattern.replace("{wheel}", wheel)) for wheel in wheels]

    return [
        Node(
            package="tire_dynamics",
            executable="node",
            name=given("name"),
            namespace=given("namespace"),
            parameters=[each for each in (params_file, given("inputs_file"), overrides) if each],
            remappings=remappings,
            output="screen",
        )
    ]


def of_wheels(wheels, in_file):
    """What the file says of each of these wheels, and of those that it does not know the default."""
    known = {wheel: place for place, wheel in enumerate(in_file.get("wheels", ["wheel"]))}

    def entries(name, size, default):
        listed = in_file.get(name, [])
        some = []
        for wheel in wheels:
            first = size * known.get(wheel, len(listed))
            some += listed[first : first + size] or default(wheel)
        return some

    overrides = {
        "joint_names": entries("joint_names", 1, lambda wheel: [wheel]),
        "frame_ids": entries("frame_ids", 1, lambda wheel: [f"{wheel}_axle"]),
        "tf.positions": entries("tf.positions", 3, lambda wheel: [0.0, 0.0, 0.0]),
    }
    if known.keys() >= set(wheels) and in_file.get("static_loads"):  # of other wheels nobody can guess it
        overrides["static_loads"] = entries("static_loads", 1, lambda wheel: [])
    return overrides


def generate_launch_description():
    """Declare the arguments and start the node."""
    vehicle = PathJoinSubstitution([FindPackageShare("tire_dynamics"), "config", "vehicle.yaml"])
    as_in_file = "; empty: as the parameter file says"
    texts = {name: description for name, (_, description) in TEXTS.items()}
    topics = {name: description for name, (_, description) in TOPICS.items()}
    topics = {"joint_states_topic": "wheel speeds as JointState", **topics}
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", default_value=vehicle, description="ROS 2 parameter file"),
            DeclareLaunchArgument("inputs_file", default_value="", description="a field map beside it; empty: none"),
            DeclareLaunchArgument("name", default_value="tire_dynamics", description="name of the node"),
            DeclareLaunchArgument("namespace", default_value="", description="namespace of node and topics"),
            *(
                DeclareLaunchArgument(name, default_value="", description=f"{description}{as_in_file}")
                for name, description in {**NAMES, **texts}.items()
            ),
            *(
                DeclareLaunchArgument(name, default_value="", description=f"{description}; empty: the node's own name")
                for name, description in topics.items()
            ),
            *(
                DeclareLaunchArgument(
                    name,
                    default_value="",
                    choices=["", "true", "false", "True", "False"],
                    description=f"{description}{as_in_file}",
                )
                for name, description in SWITCHES.items()
            ),
            OpaqueFunction(function=start_node),
        ]
    )
