"""A driving system in front of the default pedestrian, without the exam: ros2 launch vpsci_ros ads.launch.py.

It starts the package's example; with `ads:=none` the world waits for yours. docs/ads.md says what it has to answer.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

GRAPH = PythonLaunchDescriptionSource(str(Path(__file__).with_name("graph.launch.py")))
WORLD = [
    "graph.nodes=[world_simulator,safety_monitor,pedestrian_policy,recorder]",
    "world_simulator.vehicle_driver=external",
    "world_simulator.batch=1",
]


def generate_launch_description() -> LaunchDescription:
    settings = [
        *(f"{text}; " for text in WORLD),
        *("world_simulator.external_mode=", LaunchConfiguration("external_mode"), "; "),
        *("world_simulator.real_time_factor=", LaunchConfiguration("real_time_factor"), "; "),
        LaunchConfiguration("set"),
    ]
    return LaunchDescription(
        [
            DeclareLaunchArgument("params", default_value="stage3_generate", description="parameter file of stage 3"),
            DeclareLaunchArgument("set", default_value="", description="more parameters, 'NODE.PARAMETER=VALUE; ...'"),
            DeclareLaunchArgument(
                "ads",
                default_value="example_ads",
                description="executable of this package, or none: you start yours",
            ),
            DeclareLaunchArgument(
                "external_mode",
                default_value="lock_step",
                choices=["lock_step", "real_time"],
                description="wait for the system at every tick, or go on by the wall clock",
            ),
            DeclareLaunchArgument(
                "real_time_factor",
                default_value="1.0",
                description="simulated time over wall time; 0.0: as fast as possible",
            ),
            IncludeLaunchDescription(GRAPH, launch_arguments=[("set", settings)]),
        ]
    )
