"""The graph of nodes that a parameter file describes: ros2 launch vpsci_ros graph.launch.py params:=FILE output:=DIR.

The same nodes with the same parameters as `vpsci graph --params FILE -o DIR`, without its progress and its tidying up
after a killed process. The first process to end, as a rule the world at the end of its last episode, ends the run.
"""

from pathlib import Path

import yaml
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.nodes.config import GraphConfig
from vpsci_ros.nodes.graph import resolve
from vpsci_ros.parameters import as_ros_parameters
from vpsci_ros.runs.files import require_empty_folder

DISCOVERY = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PATIENCE = "30"  # [s] from SIGINT to SIGTERM: a learner ends its update and writes its weights


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument("params", description="parameter file; those of the package: share/vpsci_ros/params"),
            DeclareLaunchArgument("output", description="output folder, new or empty"),
            SetEnvironmentVariable(DISCOVERY, EnvironmentVariable(DISCOVERY, default_value="LOCALHOST")),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[Node]:
    """Check the parameter file, write it down with every default filled in, and start its nodes from that."""
    output = Path(LaunchConfiguration("output").perform(context)).absolute()
    sections = resolve(load(LaunchConfiguration("params").perform(context)), output)
    graph = sections.get(GraphConfig, "graph")
    for name in graph.nodes:
        sections = sections.changed(name, {"peers": list(graph.nodes)})  # no list twice: ROS 2 reads no YAML aliases
    parameters = require_empty_folder(output) / "params.yaml"
    layout = as_ros_parameters(sections.values, any_namespace=True)
    parameters.write_text(yaml.safe_dump(layout, sort_keys=False), encoding="utf-8")
    return [
        Node(
            package="vpsci_ros",
            executable=name,
            name=name,
            namespace=graph.namespace or None,
            parameters=[str(parameters)],
            output="screen",
            sigterm_timeout=PATIENCE,
            on_exit=Shutdown(reason=f"{name} has ended"),
        )
        for name in graph.nodes
    ]
