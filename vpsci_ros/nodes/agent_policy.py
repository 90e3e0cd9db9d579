"""A learned policy as a node: answers WorldState and SafetyState of a policy tick with one agent's accelerations."""

import time
from typing import Any

import numpy as np
from rclpy.context import Context
from rclpy.task import Future

from vpsci_msgs.msg import PolicyWeights, SafetyState, WorldState
from vpsci_msgs.srv import History
from vpsci_ros.bags import layout, received
from vpsci_ros.nodes import convert
from vpsci_ros.nodes.base import GraphNode, Output
from vpsci_ros.nodes.meter import Meter
from vpsci_ros.nodes.topics import LATCHED
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.agent_types import make_agent
from vpsci_ros.policy.config import PolicyConfig
from vpsci_ros.policy.weights import Weights, load_weights, weights_from_bytes
from vpsci_ros.resources import weights_path
from vpsci_ros.world.tick import Actions, Tick

SILENCE = 0.5  # [s] without a message: ask the world whether one was missed
REPLY_PATIENCE = 1.0  # [s] for the world's reply, before asking again
FOREIGN_PATIENCE = 0.2  # [s] for the service of a world that may have none; ours has one
OWN_PATIENCE = 3.0  # [s]


class AgentPolicy(GraphNode):
    """`/world/state`, `/safety/state` and, where no weights are given, `/policy/weights` in, `/<agent>/action` out.

    A policy answers every tick at which some running episode is at a policy frame, with zeros for the episodes in
    which it does not act, so that the world never waits in doubt. Before its first answer, and whenever nothing comes,
    it asks the world for the policy frames that it has not seen (`/world/history`): so it answers as if it had been
    there from the beginning when it is started again on the way, and misses nothing when it is matched late.
    """

    def __init__(
        self, agent: str, *, context: Context | None = None, parameter_overrides: list[Any] | None = None
    ) -> None:
        super().__init__(f"{agent}_policy", context=context, parameter_overrides=parameter_overrides)
        config = self.config(PolicyConfig)
        self._topic = f"/{agent}/action"
        self._version = 0  # of the weights
        self._actions: Output | None = None
        self._agent = make_agent(agent, config)
        self._state: tuple[WorldState, Tick] | None = None
        self._ticks = received.TickSequence()
        self._safety: SafetyState | None = None
        self._known = -1  # tick of the latest policy frame that was worked through
        self._meter = Meter()
        self._caught_up = False
        self._recalled = 0
        self._reply: Future | None = None
        self._requested_at = self._received_at = time.perf_counter()
        self._first_received_at: float | None = None
        if not isinstance(self._agent, PolicyAgent):
            self._actions = self.output(self._topic)
        elif config.weights:
            self._take_up(self._agent, load_weights(weights_path(config.weights)), version=1)
        else:
            learned = self._agent
            self.input("/policy/weights", lambda message: self._on_weights(learned, message), LATCHED)
        self.input("/world/state", self._on_state)
        self.input("/safety/state", self._on_safety)
        self._history = self.client("/world/history")
        self.wall_timer(0.1, self._keep_up)
        self.diagnose(self._status, lambda: "running" if self._caught_up else "waiting")

    def parameters_changed(self) -> None:
        """Take up the exploration and the temperature that were set on the running node."""
        config = self.config(PolicyConfig)
        if isinstance(self._agent, PolicyAgent):
            self._agent.set_temperature(config.temperature)
            self._agent.set_exploration(config.explore, config.noise)

    def _take_up(self, agent: PolicyAgent, weights: Weights, version: int) -> None:
        """Act with `weights` from now on; only a policy that can act offers its topic, for which the world waits."""
        agent.load(weights, version)
        self._version = version
        if self._actions is None:
            self._actions = self.output(self._topic)

    def _on_state(self, message: WorldState) -> None:
        tick = self.intake.read("/world/state", received.world_state, message)
        anew = None if tick is None else self.intake.read("/world/state", self._ticks.take, tick)
        if tick is None or anew is None:
            return
        if anew:
            self._known = min(self._known, tick.number - 1)  # another world, or what was known was nobody's
        self._state = message, tick
        self._meter.tick(message.tick)
        self._answer()

    def _on_safety(self, message: SafetyState) -> None:
        batch = len(self._state[1].state) if self._state and message.tick > 0 else len(message.curvttc)
        if self.intake.read("/safety/state", received.safety_state, message, batch) is None:
            return
        self._safety = message
        self._answer()

    def _on_weights(self, agent: PolicyAgent, message: PolicyWeights) -> None:
        data = self.intake.read("/policy/weights", received.weights, message)
        weights = data and self.intake.read("/policy/weights", weights_from_bytes, data, "/policy/weights")
        if not weights:
            return
        self._take_up(agent, weights, message.version)
        self.get_logger().info(f"acts with weights of version {message.version}")

    def _status(self) -> list[tuple[str, Any]]:
        version = ("policy_version", self._version)
        return [*self._meter.pairs(), version, ("frames_recalled", self._recalled)]

    # ---- acting

    def _answer(self) -> None:
        self._received_at = arrived = time.perf_counter()
        safety = self._safety
        if self._actions is None or self._state is None or safety is None:
            return
        world, tick = self._state
        if world.tick != safety.tick or world.tick <= self._known:
            return
        if not self._caught_up:
            self._first_received_at = self._first_received_at or arrived
            self._keep_up()
            return
        self.simulated_time = world.header.stamp
        message = self._act(world, tick, safety)
        if message is not None:
            self._actions.publish(message)
            self._meter.answered(arrived)

    def _act(self, world: WorldState, tick: Tick, safety: SafetyState) -> Any:
        """Take one tick in; return the answer, or None where none is wanted."""
        assessment = self.intake.read("/safety/state", layout.assessment, safety, tick)
        if assessment is None:
            return None
        self._known = tick.number
        if not tick.policy_frame.any():
            return None
        action = self._agent.act(tick, assessment).astype(np.float64)
        Actions(pedestrian=action)  # refuses another shape, and numbers that are not finite
        return convert.action_message(world.header, world.tick, action, self._version)

    # ---- catching up

    def _keep_up(self) -> None:
        """Ask the world for what was missed: before the first answer, and when nothing has come for a while."""
        now = time.perf_counter()
        if self._actions is None:
            topic = self.full_name("/policy/weights")
            self.get_logger().info(f"waiting for weights on {topic}", throttle_duration_sec=5.0)
            return
        waits = self._reply is not None and now - self._requested_at < REPLY_PATIENCE
        if waits or (self._caught_up and now - self._received_at < SILENCE):
            return
        if self._history.service_is_ready():
            if self._reply is not None:
                self._history.remove_pending_request(self._reply)
            self._requested_at = now
            self._reply = self._history.call_async(History.Request(after_tick=self._known))
            self._reply.add_done_callback(self._on_history)
        elif self._first_received_at is not None and now - self._first_received_at > self._service_patience():
            self._caught_up = True  # a world that keeps no history
            self._answer()

    def _service_patience(self) -> float:
        writers = self.get_publishers_info_by_topic(self.full_name("/world/state"))
        return OWN_PATIENCE if any(each.node_name == "world_simulator" for each in writers) else FOREIGN_PATIENCE

    def _on_history(self, reply: Any) -> None:
        response = reply.result()
        if reply is not self._reply:
            return  # an earlier one, given up
        self._reply = None
        self._received_at = time.perf_counter()
        self._caught_up = True
        for world, safety in zip(response.states, response.safeties, strict=True):
            tick = self.intake.read("/world/history", received.world_state, world, "/world/history")
            if tick is None:
                continue
            if world.tick == response.tick and (self._state is None or self._state[0].tick <= world.tick):
                self._state, self._safety = (world, tick), safety
            elif self._known < world.tick < response.tick:
                self._act(world, tick, safety)
                self._recalled += 1
        self._answer()
