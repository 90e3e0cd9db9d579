"""The world as a node: publishes tick k, waits for the answers to tick k, moves on to tick k + 1."""

import sys
import time
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.context import Context
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock
from std_msgs.msg import UInt64
from std_srvs.srv import SetBool, Trigger

from vpsci_msgs.msg import WorldState
from vpsci_msgs.srv import History as HistoryService
from vpsci_ros.config import ExternalConfig, LockStepConfig, RunConfig
from vpsci_ros.data.recorded import recorded_from_bag
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import AGENTS
from vpsci_ros.learning.transitions import TransitionBuilder
from vpsci_ros.nodes import convert
from vpsci_ros.nodes.answers import Answers
from vpsci_ros.nodes.base import GraphNode, run
from vpsci_ros.nodes.external import ExternalVehicle
from vpsci_ros.nodes.history import History
from vpsci_ros.nodes.markers import scene_markers
from vpsci_ros.world import OUTCOME_NAMES, World, WorldConfig, handover, load_scenarios
from vpsci_ros.world import state as codes

MISSING = {
    codes.VEHICLE_ACTION_MISSING: "vehicle_answers_missing",
    codes.PEDESTRIAN_ACTION_MISSING: "pedestrian_answers_missing",
    codes.SAFETY_MISSING: "safety_answers_missing",
}
STRANGER_PATIENCE = 3.0  # [s] for readers of the state that are only believed to be on their way


class WorldSimulator(GraphNode):
    """`/safety/state` and the agents' actions in; `/clock`, `/world/state`, `/episode/event` and views of it out.

    Finished when every episode of its queue has ended. Services: `/world/pause`, `/world/step`, `/world/reset`, and
    `/world/history` for policies that are started again on the way.
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
        self._recorded = recorded_from_bag(self._lock_step.recorded_bag) if self._lock_step.recorded_bag else None
        self._world = self._new_world()
        if self._config.vehicle_driver == "external" and self._run.batch > 1:
            raise InvalidInput(
                f"an external vehicle driver drives one episode at a time; got batch = {self._run.batch}"
            )
        self._builder = TransitionBuilder(scenarios) if self._lock_step.publish_transitions else None
        self._history = History(self._config, self._run.batch)
        self._counts: Counter[str] = Counter()
        self._frame = np.zeros(self._run.batch, bool)
        self._asked = self._running = False  # whether any episode is at a policy frame, is running
        self._message = WorldState()  # filled anew for every tick
        self._begun = self._paused = False
        self._steps = 0  # to take while paused
        self._due = True  # false: by the wall clock, the next tick is still to come
        self._begun_at = self._tick_started = self._told_at = time.monotonic()
        self._all_here_since: float | None = None
        self._told_tick = 0
        self._consumed = 0
        self._connect()
        self._pacer: Timer | None = None
        self._set_pace()
        self.wall_timer(min(0.05, self._lock_step.action_timeout / 4), self._on_timer)
        self.diagnose(self.status, lambda: "paused" if self._paused else "running" if self._begun else "waiting")

    def _new_world(self) -> World:
        scenarios = list(self._scenarios.values())
        return World(self._config, scenarios, self._run.queue(), self._run.batch, self._run.seed, self._recorded)

    def _connect(self) -> None:
        self._time = self.output("/clock")
        self._state = self.output("/world/state")
        self._event = self.output("/episode/event")
        self._replay = self.output("/replay") if self._builder else None
        self._odometry = [self.output(f"/{agent}/odometry") for agent in AGENTS] if self._run.batch == 1 else []
        self._markers = self.output("/markers") if self._run.batch == 1 else None
        self._outputs = [self._time, self._state, self._event, *self._odometry]
        self._outputs += [output for output in (self._replay, self._markers) if output]
        advance = self._advance_when_answered
        self._answers = Answers(self, self._config, self._run.batch, self._counts, advance)
        self._external: ExternalVehicle | None = None
        if self._config.vehicle_driver == "external":
            external = self.config(ExternalConfig)
            self._external = ExternalVehicle(self, external, self._config.tick, self._counts, advance)
        if self._builder:
            self.input("/replay/consumed", self._on_consumed)
        self.serve("/world/reset", self._on_reset)
        self.serve("/world/pause", self._on_pause)
        self.serve("/world/step", self._on_step)
        self.serve("/world/history", self._on_history)

    # ---- pace

    @property
    def _real_time_factor(self) -> float:
        factor = self._lock_step.real_time_factor
        return 1.0 if factor == 0 and self._external and self._external.real_time else factor

    def _set_pace(self) -> None:
        """Have the wall clock say when a tick is due; its beats neither drift nor crowd after a late tick."""
        if self._pacer:
            self.destroy_timer(self._pacer)
        factor = self._real_time_factor
        self._pacer = self.wall_timer(self._config.tick / factor, self._on_pace) if factor > 0 else None
        self._due = True

    def _on_pace(self) -> None:
        if self._begun and not self._paused:
            self._counts["late_ticks"] += self._due  # the last one is not over yet
            self._due = True
            self._advance_when_answered()

    def parameters_changed(self) -> None:
        """Take up the pace, the patience and the safe stop that were set on the running node."""
        self._lock_step = self.config(LockStepConfig)
        if self._external:
            self._external.config = self.config(ExternalConfig)
        self._set_pace()

    # ---- services

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Begin the queue again; ticks and simulated time go on, so that no peer and no bag sees time run backwards."""
        response.success = not self.finished
        response.message = "the run is over" if self.finished else "the first episode begins again"
        if self._begun and not self.finished:
            every = self._config.policy_ticks
            tick = (self._world.tick // every + 1) * every  # episodes begin at policy ticks
            self._world = self._new_world()
            self._world.tick = tick
            self._history.clear()
            if self._builder:
                before, self._builder = self._builder.count, TransitionBuilder(list(self._scenarios.values()))
                self._builder.count = before
            self._counts["resets"] += 1
            self._publish_events(self._world.take_started())
            self._publish_tick()
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._paused, self._steps = request.data, 0
        self._tick_started = time.monotonic()
        response.success = True
        response.message = f"{'paused' if request.data else 'running'} at tick {self._world.tick}"
        self._advance_when_answered()
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._paused and self._begun and not self.finished
        if response.success:
            response.message = f"tick {self._world.tick} goes on to tick {self._world.tick + 1}"
            self._steps, self._due, self._tick_started = 1, True, time.monotonic()
            self._advance_when_answered()
        else:
            response.message = "not paused: call /world/pause first" if not self._paused else "the world stands still"
        return response

    def _on_history(
        self, request: HistoryService.Request, response: HistoryService.Response
    ) -> HistoryService.Response:
        response.running = self._begun and not self.finished
        if not response.running:
            return response
        world, safety = self._world, self._answers.safety
        response.tick = world.tick
        response.states, response.safeties = self._history.since(request.after_tick, world.state)
        if safety is not None and request.after_tick < world.tick and self._asked:
            present = convert.world_state_message(world.state, self._frame, world.tick, self._config.tick)
            response.states = [*response.states, present]
            response.safeties = [*response.safeties, safety]
        return response

    # ---- lock-step

    def _on_timer(self) -> None:
        if not self._begun:
            self._begin_when_all_are_here()
        elif self.finished or (self._paused and not self._steps):
            return
        elif time.monotonic() - self._tick_started > self._lock_step.action_timeout and self._due:
            if not self._waits_for_learner():
                self._advance()
        else:
            self._advance_when_answered()

    def _on_consumed(self, message: UInt64) -> None:
        self._consumed = message.data

    def _begin_when_all_are_here(self) -> None:
        absent = self._answers.absent()
        if self._external and not self._external.present:
            absent.add("an external driving system")
        absent.update(name for output in self._outputs if not output.matched for name in output.expected)
        now = time.monotonic()
        if absent:
            self._all_here_since = None
        else:
            self._all_here_since = self._all_here_since or now
            if now - self._all_here_since < STRANGER_PATIENCE:
                absent = self._answers.deaf()
                absent.update(f"a reader of {out.topic}" for out in self._outputs if not out.complete)
        if absent:
            self.get_logger().info(f"waiting for {', '.join(sorted(absent))}", throttle_duration_sec=5.0)
            return
        self._begun = True
        self._begun_at = self._told_at = now
        self._set_pace()
        self._publish_events(self._world.take_started())
        self._publish_tick()

    def _publish_tick(self) -> None:
        world, period = self._world, self._config.tick
        self._answers.begin(world.tick)
        self._frame = handover.policy_frame(world.state, self._config)
        self._asked = bool(self._frame.any())
        self._running = bool((world.state["status"] == codes.RUNNING).any())
        self._tick_started = time.monotonic()
        self._due = self._pacer is None
        if self._external:
            self._external.begin(world.tick, asked=self._running)
        if world.done:
            self.finished = True
            return
        self.simulated_time = convert.stamp(world.tick, period)
        self._time.publish(Clock(clock=self.simulated_time))
        message = convert.world_state_message(world.state, self._frame, world.tick, period, self._message)
        self._state.publish(message)
        present = world.state["status"][0] != codes.IDLE
        if present and self._odometry and any(output.heard for output in self._odometry):
            pair = convert.odometry_messages(world.state[0], message.header)
            for output, odometry in zip(self._odometry, pair, strict=True):
                output.publish(odometry)
        if self._markers and self._markers.heard:
            self._markers.publish(scene_markers(world.state[0], self._scenarios, message.header))

    def _advance_when_answered(self) -> None:
        if not self._begun or self.finished or not self._due or (self._paused and not self._steps):
            return
        if self._all_drivers_answered() and not self._waits_for_learner():
            self._advance()

    def _all_drivers_answered(self) -> bool:
        if self._answers.safety is None:
            return False
        if self._external and self._running and not self._external.answered:
            return False
        return self._answers.complete(self._asked, self._running)

    def _waits_for_learner(self) -> bool:
        window = self._lock_step.replay_window
        if self._builder is None or window == 0 or self._builder.count - self._consumed < window:
            return False
        self.get_logger().info("waiting for the learner to catch up on /replay", throttle_duration_sec=10.0)
        return True

    def _advance(self) -> None:
        """Move on with whatever answers there are; the world's rule-based drivers stand in for missing ones."""
        world = self._world
        self._steps = 0
        curvttc, critical = self._answers.curvttc_and_critical()
        vehicle, pedestrian = (self._answers.action(agent) for agent in AGENTS)
        if curvttc is not None and critical is not None and self._answers.policies:
            self._history.note(world.tick, world.state, self._frame, curvttc, critical)
        if self._builder and self._replay:
            actions = self._answers.actions
            versions = {f"{agent}_version": message.policy_version for agent, message in actions.items()}
            rows = self._builder.observe(world.state, self._frame, curvttc, critical, vehicle, pedestrian, **versions)
            if len(rows):
                self._replay.publish(convert.transition_message(rows, world.tick, self._config.tick))
        if self._external:
            (vehicle, control), told = self._external.drive(world.state)
            events = world.advance(curvttc, critical, vehicle, pedestrian, vehicle_control=control)
            events = np.concatenate([told, events]) if len(told) else events
        else:
            events = world.advance(curvttc, critical, vehicle, pedestrian)
        self._publish_events(events)
        self._publish_tick()

    # ---- what goes out beside the state

    def _publish_events(self, events: NDArray[np.void]) -> None:
        if not len(events):
            return
        ended = events[events["kind"] == codes.FINISHED]
        for outcome in ended["outcome"]:
            self._counts[OUTCOME_NAMES[outcome]] += 1
        for kind, name in MISSING.items():
            self._counts[name] += int(np.count_nonzero(events["kind"] == kind))
        self._event.publish(convert.event_message(events, self._world.tick, self._config.tick))

    def status(self) -> list[tuple[str, Any]]:
        """Return what the diagnostics tell: ticks and their rate by the wall clock, and the counts of the run."""
        tick, now = self._world.tick, time.monotonic()
        rate = (tick - self._told_tick) / max(now - self._told_at, 1e-9)
        mean = tick / max(self._tick_started - self._begun_at, 1e-9)
        self._told_at, self._told_tick = now, tick
        pairs = [("tick", tick), ("ticks_per_second", round(rate)), ("ticks_per_second_mean", round(mean))]
        if self._builder:
            pairs.append(("transitions_not_consumed", self._builder.count - self._consumed))
        return pairs + sorted((+self._counts).items())

    def close(self) -> None:
        """Say how it went, and wait until every reader has everything."""
        if not self._begun:
            return
        if "recorder" in self.peers:
            # Until the middleware's next heartbeat, up to 3 s for all together; a dead reader would take for ever.
            all(output.flush(4.0) for output in [*self._outputs, *self.diagnostics])
        totals = ", ".join(f"{name} {count}" for name, count in sorted((+self._counts).items()))
        self.get_logger().info(f"{self._world.tick} ticks; {totals}")


def main(args: list[str] | None = None) -> int:
    """Run the node until its episodes have ended or it is stopped."""
    return run(WorldSimulator, args)


if __name__ == "__main__":
    sys.exit(main())
