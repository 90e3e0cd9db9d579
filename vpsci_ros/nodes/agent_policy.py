"""A learned policy as a node: answers WorldState and SafetyState of a policy tick with one agent's accelerations."""

import time
from typing import Any

from rclpy.context import Context

from vpsci_msgs.msg import PolicyWeights, SafetyState, WorldState
from vpsci_ros.config import PolicyConfig
from vpsci_ros.learning.agent import PolicyAgent
from vpsci_ros.learning.weights import Weights, load_weights, weights_from_bytes
from vpsci_ros.nodes import convert
from vpsci_ros.nodes.base import GraphNode, Output
from vpsci_ros.nodes.meter import Meter
from vpsci_ros.nodes.topics import LATCHED
from vpsci_ros.resources import weights_path


class AgentPolicy(GraphNode):
    """`/world/state`, `/safety/state` and `/policy/weights` in, `/<agent>/action` out.

    A policy answers every tick at which some running episode is at a policy frame, with zeros for the episodes in
    which it does not act, so that the world never waits in doubt.
    """

    def __init__(
        self, agent: str, *, context: Context | None = None, parameter_overrides: list[Any] | None = None
    ) -> None:
        super().__init__(f"{agent}_policy", context=context, parameter_overrides=parameter_overrides)
        config = self.config(PolicyConfig)
        self._topic = f"/{agent}/action"
        self._actions: Output | None = None
        self._agent = PolicyAgent(agent, config.seed, config.explore, config.noise)
        self._state: WorldState | None = None
        self._safety: SafetyState | None = None
        self._answered = -1
        self._meter = Meter()
        if config.weights:
            self._take_up(load_weights(weights_path(config.weights)), version=1)
        self.input("/world/state", self._on_state)
        self.input("/safety/state", self._on_safety)
        self.input("/policy/weights", self._on_weights, LATCHED)
        self.diagnose(self._status)

    def _take_up(self, weights: Weights, version: int) -> None:
        """Act with `weights` from now on; only a policy that can act offers its topic, for which the world waits."""
        self._agent.load(weights, version)
        if self._actions is None:
            self._actions = self.output(self._topic)

    def _on_state(self, message: WorldState) -> None:
        self._state = message
        self._answer()

    def _on_safety(self, message: SafetyState) -> None:
        self._safety = message
        self._answer()

    def _on_weights(self, message: PolicyWeights) -> None:
        self._take_up(weights_from_bytes(bytes(message.safetensors), "/policy/weights"), message.version)
        self.get_logger().info(f"acts with weights of version {message.version}")

    def _status(self) -> list[tuple[str, Any]]:
        return [*self._meter.pairs(), ("policy_version", self._agent.version)]

    def _answer(self) -> None:
        world, safety = self._state, self._safety
        if self._actions is None or world is None or safety is None:
            return
        if world.tick != safety.tick or world.tick == self._answered:
            return
        arrived = time.perf_counter()
        self._answered = world.tick
        self.simulated_time = world.header.stamp
        self._meter.tick(world.tick)
        state, policy_frame = convert.world_state_arrays(world)
        if not policy_frame.any():
            return
        curvttc = convert.checked(safety.curvttc, len(state), "/safety/state", "curvttc")
        critical = convert.checked(safety.critical, len(state), "/safety/state", "critical").astype(bool)
        action = self._agent.act(state, policy_frame, curvttc, critical)
        self._actions.publish(convert.action_message(world.header, world.tick, action, self._agent.version))
        self._meter.answered(arrived)
