"""The engine that moves the agents: our own kinematics, or one that a branch or another distribution adds."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import parameter
from vpsci_ros.runs.plugins import PluginGroup
from vpsci_ros.world.world import World


@dataclass(frozen=True)
class EngineConfig:
    """The engine that moves the agents."""

    engine: str = parameter("vpsci", "vpsci: our kinematics; carla: a CARLA server (docs/carla.md)")
    carla_host: str = parameter("127.0.0.1", "host of the CARLA server")
    carla_port: int = parameter(2000, "TCP port of the CARLA server", low=1, high=65_534)
    carla_map: str = parameter("", "map that the server loads, such as Town10HD_Opt; empty: the one that it has")

    def require_own(self, what: str) -> None:
        """Refuse another engine where `what` simulates in its own process.

        :raises InvalidInput: another engine is chosen.
        """
        if self.engine != "vpsci":
            raise InvalidInput(
                f"world_simulator.engine = {self.engine}: {what} in this process, by our kinematics; `vpsci graph` "
                "runs the nodes, whose world takes that engine"
            )


@dataclass(frozen=True)
class Engine:
    """Another engine.

    :ivar connect: of parameters and the period of a tick [s]: the server that moves the agents, with a method `close`.
    :ivar world: makes a `World` of that server and of the arguments of `World`.
    """

    connect: Callable[[EngineConfig, float], Any]
    world: Callable[..., World]


ENGINES = PluginGroup("vpsci_ros.engines", "engine", Engine, {})
