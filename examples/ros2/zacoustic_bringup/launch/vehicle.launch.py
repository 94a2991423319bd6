"""The vehicle: ros2 launch zacoustic_bringup vehicle.launch.py link:=MODEM."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from zacoustic_bringup.starting import PACKAGE, RESPAWN_S, gateway, share


def generate_launch_description() -> LaunchDescription:
    """Start router and gateway, and the node that aborts the mission when contact is lost."""
    started = gateway(2)
    started.add_action(
        DeclareLaunchArgument("params", default_value=share("config", "lost_contact.yaml"))
    )
    started.add_action(DeclareLaunchArgument("namespace", default_value="auv1"))
    started.add_action(
        Node(
            package=PACKAGE,
            executable="lost_contact",
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration("params")],
            output="screen",
            respawn=True,
            respawn_delay=RESPAWN_S,
        )
    )
    return started
