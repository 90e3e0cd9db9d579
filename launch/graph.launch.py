"""The graph of nodes that a parameter file describes: ros2 launch vpsci_ros graph.launch.py params:=FILE output:=DIR.

The same nodes with the same parameters as `vpsci graph --params FILE -o DIR`, without its progress and its tidying up
after a killed process. The first node to end, as a rule the world at the end of its last episode, ends the run; where
it has failed, so does `ros2 launch`, with exit status 1.
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import (
    DeclareLaunchArgument,
    LogInfo,
    OpaqueFunction,
    SetEnvironmentVariable,
    Shutdown,
)
from launch.events.process import ProcessExited
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node

from vpsci_ros.cli.launch_arguments import ARGUMENTS, prepare

DISCOVERY = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PATIENCE = "30"  # [s] from SIGINT to SIGTERM: a learner ends its update and writes its weights
RVIZ = Path(__file__).parents[1] / "rviz" / "vpsci.rviz"
OPTIONAL = {
    "output": "output folder, new or empty; empty: out/NAME-DATE-TIME",
    **{argument.name: f"{argument.description}; empty: as in params" for argument in ARGUMENTS},
    "set": "more parameters, 'NODE.PARAMETER=VALUE; ...'",
    "domain": "ROS_DOMAIN_ID; empty: as in the environment",
}


def generate_launch_description() -> LaunchDescription:
    optional = [DeclareLaunchArgument(name, default_value="", description=text) for name, text in OPTIONAL.items()]
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params", default_value="stage3_generate", description="parameter file, or the name of a shipped one"
            ),
            *optional,
            DeclareLaunchArgument(
                "ads",
                default_value="none",
                description="driving system to start besides: an executable of this package",
            ),
            DeclareLaunchArgument(
                "rviz", default_value="false", choices=["true", "false"], description="open RViz with rviz/vpsci.rviz"
            ),
            SetEnvironmentVariable(DISCOVERY, EnvironmentVariable(DISCOVERY, default_value="LOCALHOST")),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Check the arguments, write the nodes' parameters down, and start them from that."""

    def given(name: str) -> str:
        return str(LaunchConfiguration(name).perform(context))

    chosen = {argument.name: given(argument.name) for argument in ARGUMENTS}
    run = prepare(given("params"), given("output"), chosen, given("set"))
    driver = [given("ads")] if given("ads") != "none" else []
    nodes = [
        Node(
            package="vpsci_ros",
            executable=name,
            name=name,
            namespace=run.namespace or None,
            parameters=[str(run.parameters)],
            output="screen",
            sigterm_timeout=PATIENCE,
            on_exit=ended,
        )
        for name in (*run.nodes, *driver)
    ]
    domain = [SetEnvironmentVariable("ROS_DOMAIN_ID", given("domain"))] if given("domain") else []
    viewer = [Node(package="rviz2", executable="rviz2", arguments=["-d", str(RVIZ)])] if given("rviz") == "true" else []
    return [LogInfo(msg=f"output: {run.folder}"), *domain, *nodes, *viewer]


def ended(event: ProcessExited, context: LaunchContext) -> Shutdown | None:
    """End the run with a node's end.

    :raises RuntimeError: it has failed, from which `ros2 launch` gets its exit status.
    """
    if event.returncode:
        raise RuntimeError(f"{event.process_name} ended with exit status {event.returncode}")
    return None if context.is_shutdown else Shutdown(reason=f"{event.process_name} has ended")
