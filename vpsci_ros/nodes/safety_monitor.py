"""The CurvTTC safety monitor: answers every WorldState with CurvTTC and distance of each parallel episode."""

from typing import Any

from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.wire.answers import SafetyContent, write_safety_state
from vpsci_ros.wire.world_state import StateContent, read_world_state
from vpsci_ros.wire.world_state import warm_up as warm_up_reading
from vpsci_ros.world.monitor import assess, warm_up


class SafetyMonitor(GraphNode):
    """Subscribes to `/world/state` and publishes `/safety/state`, in lock-step."""

    def __init__(self, **given: Any) -> None:
        super().__init__("safety_monitor", **given)
        warm_up_reading()
        warm_up()  # before the topic is there, for which the world waits
        self._safety = self.output("/safety/state")
        self.input("/world/state", read_world_state, self._on_state, raw=True)
        self.ready("/world/state", "/safety/state")

    def _on_state(self, world: StateContent) -> None:
        header, tick, _ = world
        curvttc, distance, critical = assess(tick.state)
        self._safety.publish(write_safety_state(SafetyContent(header, tick.number, curvttc, distance, critical)))
        self.simulated_at = header.at
