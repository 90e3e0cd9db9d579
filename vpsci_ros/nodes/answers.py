"""The answers to the present tick: who has to give one, what has come, and whether it can be used."""

from collections import Counter
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vpsci_msgs.msg import AgentAction, SafetyState
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import AGENTS
from vpsci_ros.nodes import convert
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.world import WorldConfig

WORLD_STATE = "/world/state"


class Answers:
    """`/safety/state` and the agents' actions of one tick; answers to other ticks are passed over.

    :param batch: episodes for which every answer has to speak.
    :param counts: where refused answers are counted.
    :param heard: called when an answer has come.
    """

    def __init__(
        self, node: GraphNode, config: WorldConfig, batch: int, counts: Counter[str], heard: Callable[[], None]
    ) -> None:
        self._node = node
        self._batch = batch
        self._counts = counts
        self._heard = heard
        self._tick = -1
        self.safety: SafetyState | None = None
        self.actions: dict[str, AgentAction] = {}
        self.policies = [agent for agent in AGENTS if getattr(config, f"{agent}_driver") == "policy"]
        self._walks_outside = config.pedestrian_driver == "external"
        self._inputs = {"safety_monitor": node.input("/safety/state", self._on_safety)}
        for agent in self.policies:
            self._inputs[f"{agent}_policy"] = node.input(f"/{agent}/action", partial(self._on_action, agent))
        if self._walks_outside:
            topic = "/pedestrian/action"
            self._inputs["an external pedestrian"] = node.input(topic, partial(self._on_action, "pedestrian"))

    def begin(self, tick: int) -> None:
        """Forget the last tick's answers and take those to `tick`."""
        self._tick = tick
        self.safety = None
        self.actions.clear()

    def complete(self, asked: bool, running: bool) -> bool:
        """Return whether everybody has answered.

        :param asked: some episode is at a policy frame.
        :param running: some episode is running.
        """
        wanted = self.policies if asked else []
        if self._walks_outside and running:
            wanted = [*wanted, "pedestrian"]
        return self.safety is not None and all(agent in self.actions for agent in wanted)

    def absent(self) -> set[str]:
        """Return whom the world cannot do without and who does not speak yet."""
        return {name for name, given in self._inputs.items() if not given.get_publisher_count()}

    def deaf(self) -> set[str]:
        """Return the nodes that answer but are not yet known to read the world's state."""
        readers = self._node.get_subscriptions_info_by_topic(self._node.resolve_topic_name("world/state"))
        known = {(reader.node_namespace, reader.node_name) for reader in readers}
        found = set()
        for given in self._inputs.values():
            for writer in self._node.get_publishers_info_by_topic(given.topic_name):
                if (writer.node_namespace, writer.node_name) not in known:
                    found.add(f"{writer.node_name} to subscribe to {WORLD_STATE}")
        return found

    def curvttc_and_critical(self) -> tuple[NDArray[np.float64] | None, NDArray[np.bool_] | None]:
        """Return the monitor's answer, float64[B] [s] and bool[B]; None where it is missing or cannot be used."""
        if self.safety is None:
            return None, None
        try:
            curvttc = convert.checked(self.safety.curvttc, self._batch, "/safety/state", "curvttc")
            critical = convert.checked(self.safety.critical, self._batch, "/safety/state", "critical").astype(bool)
            if np.isnan(curvttc).any():
                raise InvalidInput(f"/safety/state, tick {self.safety.tick}: CurvTTC is not a number")
        except InvalidInput as error:
            self._refuse("safety", error)
            return None, None
        return curvttc, critical

    def action(self, agent: str) -> NDArray[np.float64] | None:
        """Return an agent's accelerations [m/s2], float64[B, 2]; None where they are missing or cannot be used."""
        message = self.actions.get(agent)
        if message is None:
            return None
        try:
            return convert.action_array(message, self._batch, f"/{agent}/action")
        except InvalidInput as error:
            self._refuse(agent, error)
            return None

    def _refuse(self, sender: str, error: InvalidInput) -> None:
        self._counts[f"{sender}_answers_refused"] += 1
        self._node.get_logger().warning(f"refused: {error}", throttle_duration_sec=5.0)

    def _on_safety(self, message: SafetyState) -> None:
        if message.tick == self._tick:
            self.safety = message
            self._heard()

    def _on_action(self, agent: str, message: AgentAction) -> None:
        if message.tick == self._tick:
            self.actions[agent] = message
            self._heard()
