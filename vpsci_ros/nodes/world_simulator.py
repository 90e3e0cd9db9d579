"""The world as a node: publishes tick k, waits for the answers to tick k, moves on to tick k + 1."""

import sys
import time
from collections import Counter
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.context import Context
from rosgraph_msgs.msg import Clock
from std_msgs.msg import UInt64

from vpsci_msgs.msg import AgentAction, SafetyState
from vpsci_ros.config import LockStepConfig, RunConfig
from vpsci_ros.data.recorded import recorded_from_bag
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import AGENTS
from vpsci_ros.learning.transitions import TransitionBuilder
from vpsci_ros.nodes import convert
from vpsci_ros.nodes.base import GraphNode, run
from vpsci_ros.nodes.external import ExternalVehicle
from vpsci_ros.nodes.markers import scene_markers
from vpsci_ros.world import OUTCOME_NAMES, World, WorldConfig, handover, load_scenarios
from vpsci_ros.world import state as codes

MISSING = {
    codes.VEHICLE_ACTION_MISSING: "vehicle_answers_missing",
    codes.PEDESTRIAN_ACTION_MISSING: "pedestrian_answers_missing",
    codes.SAFETY_MISSING: "safety_answers_missing",
}


class WorldSimulator(GraphNode):
    """`/safety/state` and the agents' actions in; `/clock`, `/world/state`, `/episode/event` and views of it out.

    Finished when every episode of its queue has ended.
    """

    def __init__(self, *, context: Context | None = None, parameter_overrides: list[Any] | None = None) -> None:
        super().__init__("world_simulator", context=context, parameter_overrides=parameter_overrides)
        self._run = self.config(RunConfig)
        self._lock_step = self.config(LockStepConfig)
        self._config = self.config(WorldConfig)
        scenarios = load_scenarios(self._run.scenarios)
        compiled = World(WorldConfig(), scenarios[:1], [(scenarios[0].number, 0)], 1, 0)
        compiled.advance(None, None)  # now rather than at the first tick
        self._scenarios = {scenario.number: scenario for scenario in scenarios}
        recorded = recorded_from_bag(self._lock_step.recorded_bag) if self._lock_step.recorded_bag else None
        self._world = World(self._config, scenarios, self._run.queue(), self._run.batch, self._run.seed, recorded)
        self._policies = [agent for agent in AGENTS if getattr(self._config, f"{agent}_driver") == "policy"]
        if self._config.vehicle_driver == "external" and self._run.batch > 1:
            raise InvalidInput(
                f"an external vehicle driver drives one episode at a time; got batch = {self._run.batch}"
            )
        self._builder = TransitionBuilder() if self._lock_step.publish_transitions else None
        self._counts: Counter[str] = Counter()
        self._safety: SafetyState | None = None
        self._actions: dict[str, AgentAction] = {}
        self._frame = np.zeros(self._run.batch, bool)
        self._begun = False
        self._begun_at = self._tick_started = self._told_at = time.monotonic()
        self._told_tick = 0
        self._consumed = 0
        self._connect()
        factor = self._lock_step.real_time_factor
        pace = self._config.tick / factor / 4 if factor > 0 else 0.05
        self.diagnose(self._status)
        self.wall_timer(min(pace, self._lock_step.action_timeout / 4), self._on_timer)

    def _connect(self) -> None:
        self._time = self.output("/clock")
        self._state = self.output("/world/state")
        self._event = self.output("/episode/event")
        self._replay = self.output("/replay") if self._builder else None
        self._odometry = [self.output(f"/{agent}/odometry") for agent in AGENTS] if self._run.batch == 1 else []
        self._markers = self.output("/markers") if self._run.batch == 1 else None
        self._outputs = [self._time, self._state, self._event, *self._odometry]
        self._outputs += [output for output in (self._replay, self._markers) if output]
        self._answers = {"safety_monitor": self.input("/safety/state", self._on_safety)}
        for agent in self._policies:
            topic = f"/{agent}/action"
            self._answers[f"{agent}_policy"] = self.input(topic, partial(self._on_action, agent))
        if self._config.pedestrian_driver == "external":
            self._answers["an external pedestrian"] = self.input(
                "/pedestrian/action", partial(self._on_action, "pedestrian")
            )
        self._external: ExternalVehicle | None = None
        if self._config.vehicle_driver == "external":
            self._external = ExternalVehicle(self, self._counts, self._advance_when_answered)
        if self._builder:
            self.input("/replay/consumed", self._on_consumed)

    # ---- what comes in

    def _on_timer(self) -> None:
        if not self._begun:
            self._begin_when_all_are_here()
        elif not self.finished and time.monotonic() - self._tick_started > self._lock_step.action_timeout:
            if not self._waits_for_learner():
                self._advance()
        else:
            self._advance_when_answered()

    def _on_safety(self, message: SafetyState) -> None:
        if self._begun and message.tick == self._world.tick:
            self._safety = message
            self._advance_when_answered()

    def _on_action(self, agent: str, message: AgentAction) -> None:
        if self._begun and message.tick == self._world.tick:
            self._actions[agent] = message
            self._advance_when_answered()

    def _on_consumed(self, message: UInt64) -> None:
        self._consumed = message.data

    # ---- lock-step

    def _begin_when_all_are_here(self) -> None:
        absent = {name for name, subscription in self._answers.items() if not subscription.get_publisher_count()}
        if self._external and not any(given.get_publisher_count() for given in self._external.inputs):
            absent.add("an external driving system")
        absent.update(name for output in self._outputs if not output.matched for name in output.expected)
        if absent:
            self.get_logger().info(f"waiting for {', '.join(sorted(absent))}", throttle_duration_sec=5.0)
            return
        self._begun = True
        self._begun_at = self._told_at = time.monotonic()
        self._publish_events(self._world.take_started())
        self._publish_tick()

    def _publish_tick(self) -> None:
        world, period = self._world, self._config.tick
        self._safety = None
        self._actions.clear()
        self._frame = handover.policy_frame(world.state, self._config)
        self._tick_started = time.monotonic()
        if self._external:
            asked = bool((world.state["status"] == codes.RUNNING).any())
            self._external.begin(world.tick, world.tick * round(period * 1e9), asked=asked)
        if world.done:
            self.finished = True
            return
        self.simulated_time = convert.stamp(world.tick, period)
        self._time.publish(Clock(clock=self.simulated_time))
        message = convert.world_state_message(world.state, self._frame, world.tick, period)
        self._state.publish(message)
        present = world.state["status"][0] != codes.IDLE
        if present and self._odometry and any(output.heard for output in self._odometry):
            pair = convert.odometry_messages(world.state[0], message.header)
            for output, odometry in zip(self._odometry, pair, strict=True):
                output.publish(odometry)
        if self._markers and self._markers.heard:
            self._markers.publish(scene_markers(world.state[0], self._scenarios, message.header))

    def _advance_when_answered(self) -> None:
        if not self._begun or self.finished or self._safety is None:
            return
        if not self._all_drivers_answered():
            return
        factor = self._lock_step.real_time_factor
        if factor > 0 and time.monotonic() - self._tick_started < self._config.tick / factor:
            return
        if not self._waits_for_learner():
            self._advance()

    def _all_drivers_answered(self) -> bool:
        running = bool((self._world.state["status"] == codes.RUNNING).any())
        if self._external and running and not self._external.answered:
            return False
        asked = [agent for agent in self._policies if self._frame.any()]
        if self._config.pedestrian_driver == "external" and running:
            asked.append("pedestrian")
        return all(agent in self._actions for agent in asked)

    def _waits_for_learner(self) -> bool:
        window = self._lock_step.replay_window
        if self._builder is None or window == 0 or self._builder.count - self._consumed < window:
            return False
        self.get_logger().info("waiting for the learner to catch up on /replay", throttle_duration_sec=10.0)
        return True

    def _advance(self) -> None:
        """Move on with whatever answers there are; the world's rule-based drivers stand in for missing ones."""
        world = self._world
        curvttc, critical = self._safety_arrays()
        vehicle, pedestrian = (self._action_array(agent) for agent in AGENTS)
        if self._builder and self._replay:
            versions = {f"{agent}_version": message.policy_version for agent, message in self._actions.items()}
            rows = self._builder.observe(world.state, self._frame, curvttc, critical, vehicle, pedestrian, **versions)
            if len(rows):
                self._replay.publish(convert.transition_message(rows, world.tick, self._config.tick))
        control = None
        if self._external:
            vehicle, control = self._external.acceleration, self._external.control
        self._publish_events(world.advance(curvttc, critical, vehicle, pedestrian, vehicle_control=control))
        self._publish_tick()

    def _safety_arrays(self) -> tuple[NDArray[np.float64] | None, NDArray[np.bool_] | None]:
        if self._safety is None:
            return None, None
        batch = self._run.batch
        try:
            curvttc = convert.checked(self._safety.curvttc, batch, "/safety/state", "curvttc")
            critical = convert.checked(self._safety.critical, batch, "/safety/state", "critical").astype(bool)
            if np.isnan(curvttc).any():
                raise InvalidInput(f"/safety/state, tick {self._safety.tick}: CurvTTC is not a number")
        except InvalidInput as error:
            self._refuse("safety", error)
            return None, None
        return curvttc, critical

    def _action_array(self, agent: str) -> NDArray[np.float64] | None:
        message = self._actions.get(agent)
        if message is None:
            return None
        try:
            return convert.action_array(message, self._run.batch, f"/{agent}/action")
        except InvalidInput as error:
            self._refuse(agent, error)
            return None

    def _refuse(self, sender: str, error: InvalidInput) -> None:
        self._counts[f"{sender}_answers_refused"] += 1
        self.get_logger().warning(f"refused: {error}", throttle_duration_sec=5.0)

    # ---- what goes out beside the state

    def _publish_events(self, events: NDArray[np.void]) -> None:
        ended = events[events["kind"] == codes.FINISHED]
        for outcome in ended["outcome"]:
            self._counts[OUTCOME_NAMES[outcome]] += 1
        for kind, name in MISSING.items():
            self._counts[name] += int(np.count_nonzero(events["kind"] == kind))
        if len(events):
            self._event.publish(convert.event_message(events, self._world.tick, self._config.tick))

    def _status(self) -> list[tuple[str, Any]]:
        """Return what the diagnostics tell: ticks and their rate by the wall clock, and the counts of the run."""
        tick, now = self._world.tick, time.monotonic()
        rate = (tick - self._told_tick) / max(now - self._told_at, 1e-9)
        mean = tick / max(self._tick_started - self._begun_at, 1e-9)
        self._told_at, self._told_tick = now, tick
        pairs = [("tick", tick), ("ticks_per_second", round(rate)), ("ticks_per_second_mean", round(mean))]
        return pairs + sorted((+self._counts).items())

    def close(self) -> None:
        """Say how it went, and wait until every reader has everything."""
        if not self._begun:
            return
        if "recorder" in self.peers:
            # Until the middleware's next heartbeat, up to 3 s for all together; a dead reader would take for ever.
            all(output.flush(4.0) for output in self._outputs)
        totals = ", ".join(f"{name} {count}" for name, count in sorted((+self._counts).items()))
        self.get_logger().info(f"{self._world.tick} ticks; {totals}")


def main(args: list[str] | None = None) -> int:
    """Run the node until its episodes have ended or it is stopped."""
    return run(WorldSimulator, args)


if __name__ == "__main__":
    sys.exit(main())
