"""Start people4d with a camera of ROS 2, and RViz.

    ros2 launch people4d.launch.py source:=ros2:oak

Untested: no ROS host was at hand. The command people4d must be on the PATH.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Return the nodes to start."""
    source, transport = LaunchConfiguration("source"), LaunchConfiguration("transport")
    command = ["people4d", "up", "--source", source, "--ros2", transport]
    return LaunchDescription(
        [
            DeclareLaunchArgument("source", default_value="ros2:realsense"),
            DeclareLaunchArgument("transport", default_value="zenoh"),
            ExecuteProcess(cmd=command, output="screen", sigterm_timeout="10"),
            Node(package="rviz2", executable="rviz2"),
        ]
    )
