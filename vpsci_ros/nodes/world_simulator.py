"""The world as a node: publishes tick k, waits for the answers to tick k, moves on to tick k + 1.

What an answer is, when to wait and when to go on is in `lockstep.lock_step`, the loop itself in `world.loop`.
"""

import time
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.timer import Timer
from std_msgs.msg import UInt64
from std_srvs.srv import SetBool, Trigger

from vpsci_ros.bags.episodes import recorded_from_bag
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.transitions import TransitionBuilder
from vpsci_ros.lockstep.counts import MISSING_ANSWERS, WorldCounts
from vpsci_ros.lockstep.engines import ENGINES
from vpsci_ros.lockstep.external_driver import ExternalDriver
from vpsci_ros.lockstep.intervention import intervened, read_changes
from vpsci_ros.lockstep.lock_step import LockStep
from vpsci_ros.lockstep.simulator_config import SimulatorConfig
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.respondents import Respondents
from vpsci_ros.nodes.world_outputs import WorldOutputs
from vpsci_ros.runs.run_config import RunConfig
from vpsci_ros.world import OUTCOME_NAMES, World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.state import FINISHED

REPEAT_AFTER = 1.0  # [s] without an answer to the first tick
LATE = 1.0  # [s] after which an answer that is missing is reported


class WorldSimulator(GraphNode):
    """Reads `/safety/state` and the agents' actions; publishes `/clock`, `/world/state`, `/episode/event` and views.

    :param server: an external engine's server, which moves the agents; None: as the parameter `engine` says.

    Finished when every episode of its queue has ended, and a learner has learned from all. Services: `/world/pause`,
    `/world/step`.
    """

    counts: WorldCounts

    def __init__(self, *, server: Any = None, **given: Any) -> None:
        super().__init__("world_simulator", **given)
        self._run, self._config, config = self.config(RunConfig), self.config(WorldConfig), self.config(SimulatorConfig)
        _require_together(self._run, self._config, learns="learner" in self.peers)
        scenarios = load_scenarios(self._run.scenarios, self._run.scenario_files)
        compiled = World(WorldConfig(), scenarios[:1], [(scenarios[0].number, 0)], 1, 0)
        compiled.advance(compiled.now.unassessed())  # now rather than at the first tick
        self._scenarios = {scenario.number: scenario for scenario in scenarios}
        recorded = recorded_from_bag(config.recorded_bag) if config.recorded_bag else None
        name, _, address = config.engine.partition("://")
        engine = None if name == "vpsci" else ENGINES.find(name)
        self._server = server or (engine.connect(address, self._config.tick) if engine else None)
        make = partial(engine.world, self._server) if engine else World
        run, changes = self._run, config.episode_changes
        starts, interventions = read_changes(changes) if changes else ({}, {})
        if engine and interventions:
            raise InvalidInput(f"engine = {name}: interventions change the car by our kinematics; leave them out")
        world = make(self._config, scenarios, run.queue(), run.batch, run.seed, recorded=recorded, head_starts=starts)
        self._loop = Loop(world, intervene=partial(intervened, interventions) if interventions else None)
        self.counts = WorldCounts()
        external = None
        if self._config.vehicle_driver == "external":
            external = ExternalDriver(config.external_mode == "real_time", self._config.tick, self.counts)
        self._lock_step = LockStep(config, self._config, self.counts, external)
        self._builder = None
        if "learner" in self.peers:
            self._builder = TransitionBuilder(self._config, list(self._scenarios.values()))
        self._consumed = 0  # transitions, by the learner
        self._begun_at = self._tick_started = self._reported_at = time.monotonic()
        self._repeated_at = 0.0  # [s] of the first tick once more
        self._awaited: set[str] = set()
        self._reported_tick = 0
        self._outputs = WorldOutputs(self, self._config, self._builder is not None, self._run.batch, self._scenarios)
        self._respondents = Respondents(self, self._lock_step, self._go_on)
        if self._builder:
            self.input("/replay/consumed", None, self._on_consumed)
        self.serve("/world/pause", self._on_pause)
        self.serve("/world/step", self._on_step)
        self._pacer: Timer | None = None
        self._set_pace()
        self.wall_timer(min(0.05, config.action_timeout / 4), self._on_timer)

    def destroy_node(self) -> None:
        """Destroy the node and close an external engine such as CARLA, also if the node's construction failed."""
        if server := self.__dict__.get("_server"):
            server.close()
        super().destroy_node()

    @property
    def state(self) -> str:
        """Return "paused", "running", or "waiting" before the first tick."""
        begun = self._lock_step.tick is not None
        return "paused" if self._lock_step.paused else "running" if begun else "waiting"

    @property
    def awaited(self) -> list[str]:
        """What the world waits for: before the first tick missing nodes and readers, later overdue answers."""
        return sorted(self._awaited)

    def _set_pace(self) -> None:
        """Set the timer by which ticks are due in wall time; a late tick delays no later one."""
        if self._pacer:
            self.destroy_timer(self._pacer)
        factor, external = self._lock_step.config.real_time_factor, self._lock_step.external
        factor = 1.0 if factor == 0 and external and external.real_time else factor
        self._pacer = self.wall_timer(self._config.tick / factor, self._on_pace) if factor > 0 else None
        self._lock_step.pace(factor > 0)

    def _on_pace(self) -> None:
        self._lock_step.beat()
        self._go_on()

    def parameters_changed(self) -> None:
        """Apply the real-time factor and the timeout that were set on the running node."""
        self._lock_step.config = self.config(SimulatorConfig)
        self._set_pace()

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._lock_step.pause(request.data, time.monotonic())
        response.success = True
        response.message = f"{'paused' if request.data else 'running'} at tick {self._loop.world.now.number}"
        self._go_on()
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._lock_step.step(time.monotonic())
        if response.success:
            number = self._loop.world.now.number
            response.message = f"tick {number} goes on to tick {number + 1}"
            self._go_on()
        else:
            paused = self._lock_step.paused
            response.message = "the world stands still" if paused else "not paused: call /world/pause first"
        return response

    def _on_timer(self) -> None:
        lock_step, now = self._lock_step, time.monotonic()
        if lock_step.tick is None:
            self._begin_when_all_are_here()
            return
        self._awaited = set()
        if self._loop.world.done:
            self._finish()
        elif lock_step.running and lock_step.behind:
            topic = self.full_name("/replay")
            self.get_logger().info(f"waiting for the learner to catch up on {topic}", throttle_duration_sec=10.0)
        elif lock_step.running and not lock_step.paused:
            self._repeat_first_tick(now)
            self._look_for_late_answers(now - self._tick_started)
        self._go_on(now)

    def _look_for_late_answers(self, waited: float) -> None:
        if waited > min(LATE, self._lock_step.config.action_timeout):
            self._awaited = self._respondents.unanswered()
        if self._awaited:
            text = f"no answer to tick {self._loop.world.now.number} from {', '.join(self.awaited)}"
            self.get_logger().warning(f"{text} for {waited:.1f} s", throttle_duration_sec=5.0)

    def _repeat_first_tick(self, now: float) -> None:
        """Publish an unanswered first tick to a driving system again: its subscriptions may have been matched late."""
        external, tick = self._lock_step.external, self._loop.world.now
        if external is None or external.answered or tick.number > 0:
            return
        if now - max(self._repeated_at, self._tick_started) > REPEAT_AFTER:
            self._repeated_at = now
            external.repeat()
            self._outputs.repeat(tick)

    def _on_consumed(self, message: UInt64) -> None:
        self._consumed = message.data
        self._count_unread()

    def _begin_when_all_are_here(self) -> None:
        self._awaited = self._respondents.missing(self._outputs)
        if self._awaited:
            self.get_logger().info(f"waiting for {', '.join(self.awaited)}", throttle_duration_sec=5.0)
            return
        self._begun_at = self._reported_at = time.monotonic()
        run = self._run
        self.get_logger().info(f"ready: {run.total} episodes of scenarios {list(run.scenarios)}, {run.batch} at once")
        self._set_pace()
        self.report()  # with the parameters, for which perception waits
        self._publish(self._loop.world.take_started())

    def _go_on(self, now: float | None = None) -> None:
        if self._lock_step.may_advance(now):
            self._advance()

    def _advance(self) -> None:
        """Advance with the answers that have come; the rule-based drivers act for missing ones."""
        assessment, actions, notices = self._lock_step.answers()
        if len(notices):
            self.get_logger().warning("no command: the vehicle brakes until commands come", throttle_duration_sec=5.0)
        step = self._loop.advance(assessment, actions)
        if self._builder and not self._lock_step.external:
            versions = {f"{agent}_version": version for agent, version in self._lock_step.versions.items()}
            self._outputs.transitions(self._builder.observe(step, **versions)[0], step.tick.number)
            self._count_unread()
        self._publish(np.concatenate([notices, step.events]) if len(notices) else step.events)

    def _publish(self, events: NDArray[np.void]) -> None:
        """Publish the events, EVENT[n], and the present tick; after the last episode, events alone."""
        tick = self._loop.world.now
        if len(events):
            self._count(events)
            self._outputs.events(events, tick.number)
        self._tick_started = time.monotonic()
        self.counts.tick = tick.number
        self._lock_step.begin(tick, self._tick_started)
        if self._loop.world.done:
            self._lock_step.end()
            self._finish()
        else:
            self._outputs.tick(tick)

    def _finish(self) -> None:
        """Finish, once a learner has learned from every transition; until then, log that it is waited for."""
        left = self._lock_step.unread
        self.finished = left == 0
        if left:
            self._awaited = {"learner"}
            text = f"all episodes have ended; the learner has {left} transitions left to learn from"
            self.get_logger().info(text, throttle_duration_sec=10.0)

    def _count(self, events: NDArray[np.void]) -> None:
        first = events["slot"] % self._config.pedestrians == 0  # an episode counts once
        ended = events[(events["kind"] == FINISHED) & first]
        self.counts.episodes_ended += len(ended)
        for outcome in ended["outcome"].tolist():
            self.counts.add(OUTCOME_NAMES[outcome])
        for kind, sender in MISSING_ANSWERS.items():
            self.counts.add_fault(sender, "missing", int(kind in events["kind"]))  # one for all episodes

    def _count_unread(self) -> None:
        assert self._builder is not None
        self._lock_step.unread = self._builder.count - self._consumed

    def figures(self) -> dict[str, Any]:
        """Return ticks a second of wall time, and the number of transitions that the learner has not consumed."""
        tick, now = self._loop.world.now.number, time.monotonic()
        rate = (tick - self._reported_tick) / max(now - self._reported_at, 1e-9)
        mean = tick / max(self._tick_started - self._begun_at, 1e-9)
        self._reported_at, self._reported_tick = now, tick
        figures = {"ticks_per_second": round(rate), "ticks_per_second_mean": round(mean)}
        return figures | ({"transitions_not_consumed": self._lock_step.unread} if self._builder else {})

    def close(self) -> None:
        """Log the run's counts, such as episodes ended and outcomes."""
        if self._lock_step.tick is None:
            return
        totals = ", ".join(f"{name} {count}" for name, count in self.counts.nonzero().items())
        self.get_logger().info(f"ended: {totals}")


def _require_together(run: RunConfig, world: WorldConfig, *, learns: bool) -> None:
    """Refuse parameters that do not go together.

    :raises InvalidInput: an external vehicle driver with a batch above 1, or a learner with several pedestrians.
    """
    if world.vehicle_driver == "external" and run.batch > 1:
        raise InvalidInput(f"an external vehicle driver drives one episode at a time; got batch = {run.batch}")
    if learns and world.pedestrians > 1:
        raise InvalidInput(f"the learner learns from one pedestrian an episode; got pedestrians = {world.pedestrians}")
