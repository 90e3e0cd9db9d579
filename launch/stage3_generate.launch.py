"""Stage 3, the policies generate interactions: ros2 launch vpsci_ros stage3_generate.launch.py output:=DIR."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from vpsci_ros.resources import params_dir

GRAPH = PythonLaunchDescriptionSource(str(Path(__file__).with_name("graph.launch.py")))


def generate_launch_description() -> LaunchDescription:
    arguments = {"params": str(params_dir() / "stage3_generate.yaml"), "output": LaunchConfiguration("output")}
    return LaunchDescription(
        [
            DeclareLaunchArgument("output", description="output folder, new or empty"),
            IncludeLaunchDescription(GRAPH, launch_arguments=arguments.items()),
        ]
    )
