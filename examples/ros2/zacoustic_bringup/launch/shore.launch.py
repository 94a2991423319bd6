"""The shore: ros2 launch zacoustic_bringup shore.launch.py link:=MODEM."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from zacoustic_bringup.starting import gateway, share


def generate_launch_description() -> LaunchDescription:
    """Start router and gateway, and RViz if `rviz:=true`."""
    started = gateway(1)
    started.add_action(DeclareLaunchArgument("rviz", default_value="false"))
    started.add_action(
        Node(
            package="rviz2",
            executable="rviz2",
            arguments=["-d", share("layouts", "shore.rviz")],
            condition=IfCondition(LaunchConfiguration("rviz")),
        )
    )
    return started
