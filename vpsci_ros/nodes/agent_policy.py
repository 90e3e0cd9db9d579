"""A learned policy as a node: answers WorldState and SafetyState of a policy tick with one agent's accelerations."""

import secrets
import time
from functools import partial
from typing import Any

import numpy as np
from rclpy.task import Future

from vpsci_msgs.msg import PolicyWeights, SafetyState
from vpsci_msgs.srv import History
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.exchange import Outgoing, each
from vpsci_ros.nodes.history import frames_of
from vpsci_ros.nodes.meter import Meter
from vpsci_ros.nodes.output import Output
from vpsci_ros.nodes.serialized import assessment, checked_safety_state, safety_state, shown, warm_up
from vpsci_ros.nodes.topics import LATCHED
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.agent_types import make_agent
from vpsci_ros.policy.config import PolicyConfig
from vpsci_ros.policy.weights import Weights, load_weights, weights_from_bytes
from vpsci_ros.resources import weights_path
from vpsci_ros.wire import layout, received
from vpsci_ros.wire.answers import SerializedAction, SerializedSafety, write_action
from vpsci_ros.wire.header import WireHeader
from vpsci_ros.wire.signature import is_signed
from vpsci_ros.wire.world_state import SerializedState
from vpsci_ros.world.tick import Tick, finite_pairs

SILENCE = 0.5  # [s] without a message before the missed ones are requested from the world
REPLY_PATIENCE = 1.0  # [s] for the world's reply, before the next request
FOREIGN_PATIENCE = 0.2  # [s] for the service of another program's world, which may not offer it; ours does
OWN_PATIENCE = 3.0  # [s]
_write = each(write_action)


class AgentPolicy(GraphNode):
    """`/world/state`, `/safety/state` and, where no weights are given, `/policy/weights` in, `/<agent>/action` out.

    A policy answers every tick at which some running episode is at a policy frame, with zeros for the episodes in
    which it does not act, so that the world never waits in vain. Before its first answer, and whenever nothing comes,
    it requests the policy frames that it has not seen (`/world/history`): so it answers as if it had been there from
    the beginning when it is started again in mid-run, and misses nothing when it is matched late.
    """

    def __init__(self, agent: str, **given: Any) -> None:
        super().__init__(f"{agent}_policy", **given)
        config = self.config(PolicyConfig)
        warm_up()
        self._topic = f"/{agent}/action"
        self._version = 0  # of the weights
        self._actions: Output | None = None
        self._agent = make_agent(agent, config)
        self._world: SerializedState | None = None
        self._ticks = received.TickSequence()
        self._safety: SafetyState | SerializedSafety | None = None
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
            self.input("/policy/weights", self._weights, partial(self._on_weights, self._agent), LATCHED)
        self.input("/world/state", shown, self._on_state, raw=True)
        self.input("/safety/state", safety_state, self._on_safety, raw=True)
        self._history = self.client("/world/history")
        self.wall_timer(0.1, self._catch_up)

    @property
    def state(self) -> str:
        """Whether it answers yet."""
        return "running" if self._caught_up else "waiting"

    def figures(self) -> dict[str, Any]:
        """Return rate and lag of the answers, the version of the weights, and how many frames came by request."""
        return self._meter.figures() | {"policy_version": self._version, "frames_recalled": self._recalled}

    def parameters_changed(self) -> None:
        """Apply the exploration and the temperature that were set on the running node."""
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

    def _on_state(self, world: SerializedState) -> None:
        restarted = self.intake.read("/world/state", self._ticks.take, world.tick)
        if restarted is None:
            return
        number = world.tick.number
        if not restarted and self._world is not None and number == self._world.tick.number:
            self.intake.read("/world/state", _require_same, self._world.tick, world.tick)  # the first stands
            return
        if restarted:
            self._known = min(self._known, number - 1)  # another world, or what was known came from another program
        self._world = world
        self._meter.tick(number)
        self._answer()

    def _on_safety(self, safety: SafetyState | SerializedSafety) -> None:
        batch = len(self._world.tick.state) if self._world and safety.tick > 0 else len(safety.curvttc)
        if self.intake.read("/safety/state", checked_safety_state, safety, batch):
            self._safety = safety
            self._answer()

    def _weights(self, message: PolicyWeights) -> tuple[Weights, int]:
        """Return the weights of a message of this run's learner, and their version.

        :raises InvalidInput: another program published them, perhaps a copy of earlier ones, or they are no weights.
        """
        data = received.weights(message)
        if is_signed() and message.version <= self._version:
            raise InvalidInput(
                f"/policy/weights: expected a version above {self._version}, got {message.version} once more; does "
                "another program repeat what this run's learner has published?"
            )
        return weights_from_bytes(data, "/policy/weights"), message.version

    def _on_weights(self, agent: PolicyAgent, given: tuple[Weights, int]) -> None:
        weights, version = given
        self._take_up(agent, weights, version)
        self.get_logger().info(f"acts with weights of version {version}")

    # ---- acting

    def _answer(self) -> None:
        self._received_at = arrived = time.perf_counter()
        safety = self._safety
        if self._actions is None or self._world is None or safety is None:
            return
        header, tick, _ = self._world
        if tick.number != safety.tick or tick.number <= self._known:
            return
        if not self._caught_up:
            self._first_received_at = self._first_received_at or arrived
            self._catch_up()
            return
        self.simulated_at = header.at
        message = self._act(header, tick, safety)
        if message is not None:
            self._actions.publish(message)
            self._meter.answered(arrived)

    def _act(self, header: WireHeader, tick: Tick, safety: SafetyState | SerializedSafety) -> Outgoing | None:
        """Take one tick in; return the answer, or None where none is wanted."""
        if not np.count_nonzero(tick.policy_frame):
            if self.intake.read("/safety/state", checked_safety_state, safety, len(tick.state)):
                self._known = tick.number
            return None
        assessed = self.intake.read("/safety/state", assessment, safety, tick)
        if assessed is None:
            return None
        self._known = tick.number
        action = self._agent.act(tick, assessed).astype(np.float64)
        finite_pairs("pedestrian", action)  # refuses another shape, and numbers that are not finite
        answer = SerializedAction(header, tick.number, action[:, 0], action[:, 1], self._version)
        return Outgoing(answer, _write)

    # ---- catching up

    def _catch_up(self) -> None:
        """Request what was missed from the world: before the first answer, and when nothing has come for a while."""
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
            request = History.Request(after_tick=self._known, challenge=secrets.randbits(64))
            self._reply = self._history.call_async(request)
            self._reply.add_done_callback(partial(self._on_history, request))
        elif self._first_received_at is not None and now - self._first_received_at > self._service_patience():
            self._caught_up = True  # a world that keeps no history
            self._answer()

    def _service_patience(self) -> float:
        writers = self.get_publishers_info_by_topic(self.full_name("/world/state"))
        return OWN_PATIENCE if any(each.node_name == "world_simulator" for each in writers) else FOREIGN_PATIENCE

    def _on_history(self, request: History.Request, reply: Any) -> None:
        response = reply.result()
        if reply is not self._reply:
            return  # an earlier one, given up
        self._reply = None
        frames = self.intake.read("/world/history", frames_of, request, response)
        if frames is None:
            return  # another request follows
        if response.running and response.tick < self._known and self._received_at < self._requested_at:
            self._known = response.tick - 1  # nothing came since the request: what was known came from another program
        self._received_at = time.perf_counter()
        self._caught_up = True
        for state, safety in frames:
            world = self.intake.read("/world/history", shown, state, "/world/history")
            if world is None:
                continue
            number = world.tick.number
            if number == response.tick and (self._world is None or self._world.tick.number <= number):
                self._world, self._safety = world, safety
            elif self._known < number < response.tick:
                self._act(world.header, world.tick, safety)
                self._recalled += 1
        self._answer()


class VehiclePolicy(AgentPolicy):
    """The vehicle's."""

    def __init__(self, **given: Any) -> None:
        super().__init__("vehicle", **given)


class PedestrianPolicy(AgentPolicy):
    """The pedestrian's."""

    def __init__(self, **given: Any) -> None:
        super().__init__("pedestrian", **given)


def _require_same(first: Tick, second: Tick) -> None:
    """Refuse a second state of one tick, unless it says the same."""
    if first.state.tobytes() != second.state.tobytes():
        raise InvalidInput(f"{layout.WORLD}: expected one state of tick {first.number}, got another that differs")
