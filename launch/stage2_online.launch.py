"""Stage 2, the policies go on learning in simulation: ros2 launch vpsci_ros stage2_online.launch.py.

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
            DeclareLaunchArgument("params", default_value="stage2_online", description="parameter file of this stage"),
            IncludeLaunchDescription(GRAPH),
        ]
    )
