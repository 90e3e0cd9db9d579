"""Which engine moves the agents: our own kinematics, or a CARLA server."""

from dataclasses import dataclass

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import parameter


@dataclass(frozen=True)
class EngineConfig:
    """What moves the agents of the world."""

    engine: str = parameter(
        "vpsci", "vpsci: our kinematics; carla: a CARLA server (docs/carla.md)", choices=("vpsci", "carla")
    )
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
