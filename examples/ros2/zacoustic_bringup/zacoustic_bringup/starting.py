"""What both launch files start: the router of rmw_zenoh, and the gateway beside it."""

from __future__ import annotations

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

PACKAGE = "zacoustic_bringup"
RESPAWN_S = 5.0


def share(*parts: str) -> str:
    """Return the path of an installed file."""
    return str(Path(get_package_share_directory(PACKAGE), *parts))


def gateway(address: int) -> LaunchDescription:
    """Return the arguments, the router and the gateway of one side."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("link", description="the modem: evologics/serial:/dev/ttyUSB0"),
            DeclareLaunchArgument("address", default_value=str(address)),
            DeclareLaunchArgument("config", default_value=share("config", "fleet.json5")),
            DeclareLaunchArgument(
                "zacoustic",
                default_value="zacoustic",
                description="the program; its Python need not be that of ROS",
            ),
            DeclareLaunchArgument(
                "journal", default_value=str(Path.home() / ".local" / "state" / "zacoustic")
            ),
            DeclareLaunchArgument(
                "router", default_value="true", description="start rmw_zenohd here"
            ),
            Node(
                package="rmw_zenoh_cpp",
                executable="rmw_zenohd",
                output="screen",
                respawn=True,
                respawn_delay=RESPAWN_S,
                condition=IfCondition(LaunchConfiguration("router")),
            ),
            ExecuteProcess(
                cmd=[
                    LaunchConfiguration("zacoustic"),
                    "gateway",
                    LaunchConfiguration("config"),
                    "--address",
                    LaunchConfiguration("address"),
                    "--link",
                    LaunchConfiguration("link"),
                    "--journal",
                    LaunchConfiguration("journal"),
                ],
                name="gateway",
                output="screen",
                # ROS's packages are for ROS's Python.
                additional_env={"PYTHONPATH": ""},
                respawn=True,
                respawn_delay=RESPAWN_S,
            ),
        ]
    )
