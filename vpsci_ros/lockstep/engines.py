"""The engine that moves the agents: this package's kinematics, or an engine that another Python package adds."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.plugins import PluginGroup
from vpsci_ros.world.world import World


def require_own(engine: str, what: str) -> None:
    """Refuse an engine other than this package's kinematics, for a command that needs no nodes.

    :param what: happens in this process ("episodes are simulated"), for the message.
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

    :ivar connect: returns the server that moves the agents, which has a method `close`; called with the text after
        "://" in the parameter `engine` and with the period of a tick [s].
    :ivar world: returns a `World`; called with that server, then with the arguments of `World`.
    """

    connect: Callable[[str, float], Any]
    world: Callable[..., World]


ENGINES = PluginGroup("vpsci_ros.engines", "engine", Engine, {})
