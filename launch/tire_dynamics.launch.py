"""Start the live node with a parameter file: ``ros2 launch tire_dynamics tire_dynamics.launch.py``."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def start_node(context):
    """The node; an argument left empty leaves the parameter file's value alone."""
    use_sim_time = LaunchConfiguration("use_sim_time").perform(context)
    log_directory = LaunchConfiguration("log_directory").perform(context)
    overrides = {}
    if use_sim_time:
        overrides["use_sim_time"] = use_sim_time == "true"
    if log_directory:
        overrides["log.directory"] = log_directory
    return [
        Node(
            package="tire_dynamics",
            executable="node",
            name=LaunchConfiguration("name"),
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration("params_file"), overrides],
            output="screen",
        )
    ]


def generate_launch_description():
    """Declare the arguments (``ros2 launch -s`` lists them) and start the node."""
    vehicle = PathJoinSubstitution([FindPackageShare("tire_dynamics"), "config", "vehicle.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", default_value=vehicle, description="ROS 2 parameter file"),
            DeclareLaunchArgument("name", default_value="tire_dynamics", description="name of the node"),
            DeclareLaunchArgument("namespace", default_value="", description="namespace of node and topics"),
            DeclareLaunchArgument(
                "use_sim_time",
                default_value="",
                choices=["", "true", "false"],
                description="take time from /clock; empty: as the parameter file says",
            ),
            DeclareLaunchArgument(
                "log_directory",
                default_value="",
                description="where to write the log; empty: as the parameter file says",
            ),
            OpaqueFunction(function=start_node),
        ]
    )
