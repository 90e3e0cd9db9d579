"""The pedestrian's learned policy as a node."""

from typing import Any

from vpsci_ros.nodes.agent_policy import AgentPolicy


class PedestrianPolicy(AgentPolicy):
    """`/world/state`, `/safety/state` and `/policy/weights` in, `/pedestrian/action` out."""

    def __init__(self, **given: Any) -> None:
        super().__init__("pedestrian", **given)
