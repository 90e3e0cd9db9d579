"""The engine that moves the agents: this package's kinematics, or an engine that another Python package adds."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.plugins import PluginGroup
from vpsci_ros.world.world import World


def require_own(engine: str, what: str) -> None:
    """Refuse an engine other than this package's kinematics, since `what` happens in this process.

    :raises InvalidInput: another engine is chosen.
    """
    if engine != "vpsci":
        raise InvalidInput(
            f"world_simulator.engine = {engine}: {what} in this process, by our kinematics; `vpsci graph` "
            "runs the nodes, whose world takes that engine"
        )


@dataclass(frozen=True)
class Engine:
    """An engine of another Python package, which moves the agents in place of this package's kinematics.

    :ivar connect: of what stands after "://" in `engine`, and of the period of a tick [s]: the server that moves the
        agents, with a method `close`.
    :ivar world: makes a `World` of that server and of the arguments of `World`.
    """

    connect: Callable[[str, float], Any]
    world: Callable[..., World]


ENGINES = PluginGroup("vpsci_ros.engines", "engine", Engine, {})
