"""A policy as a node: at each policy frame, answers WorldState and SafetyState with one agent's accelerations."""

from functools import partial
from typing import Any, TypeVar

import numpy as np

from vpsci_msgs.msg import PolicyWeights
from vpsci_ros.errors import VpsciError
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.output import Output
from vpsci_ros.nodes.topics import LATCHED
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.agent_types import make_agent
from vpsci_ros.policy.policy_config import PolicyConfig
from vpsci_ros.policy.policy_file import Policy, load_policy
from vpsci_ros.policy.weights import Weights, weights_from_bytes
from vpsci_ros.wire import layout
from vpsci_ros.wire.answers import ActionContent, SafetyContent, read_safety_state, write_action
from vpsci_ros.wire.header import WireHeader
from vpsci_ros.wire.world_state import StateContent, read_world_state, warm_up
from vpsci_ros.world.tick import Tick, finite_pairs

T = TypeVar("T")
OFFER_PERIOD = 0.1  # [s]: endpoints of two programs that know each other are matched within some milliseconds
UNPAIRED = 64  # states, and safety states, without the other one of their tick: a run ends after 20 missing answers


class AgentPolicy(GraphNode):
    """Reads `/world/state`, `/safety/state` and, if no parameter names weights, `/policy/weights`; publishes actions.

    A policy answers every tick at which some running episode is at a policy frame, with zeros for the episodes in
    which it does not act, so that the world never waits in vain. An answer is a function of all policy frames since the
    hand-over: a policy that was not there at a hand-over ends with an error, and one that was stopped for a while
    answers the ticks that it finds in its queues one by one, though too late for the world.
    """

    def __init__(self, agent: str, **given: Any) -> None:
        super().__init__(f"{agent}_policy", **given)
        config = self.config(PolicyConfig)
        warm_up()
        self._topic = f"/{agent}/action"
        self._version = 0  # of the weights
        self._actions: Output | None = None
        self._agent = make_agent(agent, config)
        self._states: dict[int, StateContent] = {}  # by tick, as long as its safety state is not there
        self._safety: dict[int, SafetyContent] = {}  # by tick, as long as its state is not there
        self._newest = -1  # tick of the latest state
        self._known = -1  # the latest tick that was worked through
        if isinstance(self._agent, PolicyAgent):
            if config.weights:
                self._take_up(self._agent, load_policy(config.weights), version=1)
            else:
                self.input("/policy/weights", self._weights, partial(self._on_weights, self._agent), LATCHED)
                self.get_logger().info(f"waiting for weights on {self.full_name('/policy/weights')}")
        self.input("/world/state", read_world_state, self._on_state, raw=True)
        self._monitored = self.input("/safety/state", read_safety_state, self._on_safety, raw=True)
        self._monitor_found = False
        if self._can_act:
            by = f"weights {config.weights}" if config.weights else f"agent {config.agent}"
            self.ready("/world/state", self._topic, by)
        self.wall_timer(OFFER_PERIOD, self._offer)

    @property
    def state(self) -> str:
        """Return "running", or "waiting" until the node has weights and the safety monitor is found."""
        return "running" if self._actions else "waiting"

    def figures(self) -> dict[str, Any]:
        """Return the version of the weights."""
        return {"policy_version": self._version}

    def _take_up(self, agent: PolicyAgent, weights: Policy, version: int) -> None:
        """Act with `weights` from now on."""
        agent.load(weights, version)
        self._version = version

    @property
    def _can_act(self) -> bool:
        """Whether the agent needs no weights, or has them."""
        return not isinstance(self._agent, PolicyAgent) or self._version > 0

    def _offer(self) -> None:
        """Create the publisher of actions, which the world waits for, once weights and safety monitor are there."""
        if self._actions is None and self._can_act and self._monitor_found:
            self._actions = self.output(self._topic)
        self._monitor_found = self._monitored.get_publisher_count() > 0

    def _on_state(self, world: StateContent) -> None:
        number = world.tick.number
        if number < self._newest:  # another world
            self._known = -1
            self._states.clear()
            self._safety = {tick: safety for tick, safety in self._safety.items() if tick == number}
        self._newest = number
        self._keep(self._states, number, world)
        self._answer(number)

    def _on_safety(self, safety: SafetyContent) -> None:
        self._keep(self._safety, safety.tick, safety)
        self._answer(safety.tick)

    def _keep(self, messages: dict[int, T], number: int, message: T) -> None:
        """Keep a message of a tick for the other one of its tick; of too many without the other, not the oldest."""
        if number > self._known:
            messages[number] = message
        if len(messages) > UNPAIRED:
            del messages[next(iter(messages))]

    def _weights(self, message: PolicyWeights) -> tuple[Weights, int]:
        """Return the weights of a message, and their version.

        :raises InvalidInput: they are no weights.
        """
        return weights_from_bytes(bytes(message.safetensors), "/policy/weights"), message.version

    def _on_weights(self, agent: PolicyAgent, given: tuple[Weights, int]) -> None:
        weights, version = given
        self._take_up(agent, weights, version)
        self.get_logger().info(f"acts with weights of version {version}")

    def _answer(self, number: int) -> None:
        """Answer a tick if both of its messages are there."""
        if self._actions is None or number not in self._states or number not in self._safety:
            return
        header, tick, _ = self._states[number]
        if self._known < 0:
            _require_no_hand_over(tick)
        self.simulated_at = header.at
        message = self._act(header, tick, self._safety[number])
        for messages in (self._states, self._safety):
            for past in [tick for tick in messages if tick <= self._known]:
                del messages[past]
        if message is not None:
            self._actions.publish(message)

    def _act(self, header: WireHeader, tick: Tick, safety: SafetyContent) -> bytes | None:
        """Process one tick; return the serialized action, or None between policy frames or if an answer is refused."""
        if not np.count_nonzero(tick.policy_frame):
            self._known = tick.number
            return None
        assessed = self.intake.read("/safety/state", layout.assessment, safety, tick)
        if assessed is None:
            return None
        self._known = tick.number
        action = self._agent.act(tick, assessed).astype(np.float64)
        finite_pairs("pedestrian", action)  # refuses another shape, and numbers that are not finite
        return write_action(ActionContent(header, tick.number, action[:, 0], action[:, 1], self._version))


VehiclePolicy = partial(AgentPolicy, "vehicle")
PedestrianPolicy = partial(AgentPolicy, "pedestrian")


def _require_no_hand_over(tick: Tick) -> None:
    """Refuse a first tick at which policies already control an episode.

    :raises VpsciError: they control one.
    """
    held = np.flatnonzero(tick.state["controlled"])
    if len(held):
        first = tick.state[held[0]]
        raise VpsciError(
            f"tick {tick.number}: episode {first['scenario']}:{first['episode']} was handed over before this policy "
            "was there, and its actions rest on every frame since; start the whole run again"
        )
