"""Stage 3, the policies generate interactions: ros2 launch vpsci_ros stage3_generate.launch.py.

Its arguments are those of graph.launch.py; `--show-args` lists them.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

GRAPH = PythonLaunchDescriptionSource(str(Path(__file__).with_name("graph.launch.py")))


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params", default_value="stage3_generate", description="parameter file of this stage"
            ),
            IncludeLaunchDescription(GRAPH),
        ]
    )
