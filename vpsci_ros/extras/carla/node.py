"""The world in a CARLA server: `world_simulator` with `engine: carla`, under its name and with all of its topics."""

from typing import Any

from rclpy.parameter import Parameter

from vpsci_ros.nodes.world_simulator import WorldSimulator


class CarlaWorld(WorldSimulator):
    """The world simulator, with a CARLA server in place of the package's kinematics (docs/carla.md)."""

    def __init__(self, *, parameter_overrides: list[Any] | None = None, **given: Any) -> None:
        engine = Parameter("engine", value="carla")
        super().__init__(parameter_overrides=[*(parameter_overrides or []), engine], **given)
