"""Outcomes of simulated episodes under policies, usually without exploration and with a seed not trained on."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.policy_file import Policy
from vpsci_ros.policy.simulation_config import SimulationConfig
from vpsci_ros.world import COLLISION, GOAL, RUNNING, TIMEOUT, Scenario, WorldConfig
from vpsci_ros.world.loop import Agent, Loop
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.road import lane_offsets
from vpsci_ros.world.state import FINISHED, HANDED_OVER
from vpsci_ros.world.tables import tables_from
from vpsci_ros.world.tick import Assessment, Step, Tick

ON_ROAD = 1.75  # [m] from the middle of the lane to its edge


@dataclass
class Outcomes:
    """Outcomes of the episodes in which the policies had control.

    A vehicle that was more than `ON_ROAD` off the middle of its lane while a policy drove it has no goal: such an
    episode ends as a timeout here.

    `outcomes` and `least_curvttc` [s] have an entry for each ended episode with a hand-over, in order.

    :param config, scenarios: of the world.
    """

    config: WorldConfig
    scenarios: Sequence[Scenario]
    handed_over: set[tuple[int, int]] = field(default_factory=set)
    off_road: set[tuple[int, int]] = field(default_factory=set)
    outcomes: list[int] = field(default_factory=list)
    least_curvttc: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._tables = tables_from(self.scenarios, self.config.spawn)

    def note(self, step: Step) -> None:
        """Count a tick."""
        state = step.tick.state
        beside = lane_offsets(state, self._tables)
        for row in state[(np.abs(beside) > ON_ROAD) & (state["controlled"] != 0) & (state["status"] == RUNNING)]:
            self.off_road.add((int(row["scenario"]), int(row["episode"])))
        for event in step.events:
            key = int(event["scenario"]), int(event["episode"])
            if event["kind"] == HANDED_OVER:
                self.handed_over.add(key)
            elif event["kind"] == FINISHED and key in self.handed_over:
                self.handed_over.discard(key)
                lost = event["outcome"] == GOAL and key in self.off_road
                self.off_road.discard(key)
                self.outcomes.append(TIMEOUT if lost else int(event["outcome"]))
                self.least_curvttc.append(float(event["least_curvttc"]))

    def rates(self, last: int | None = None) -> dict[str, float]:
        """Return the rates of collision and goal in the `last` episodes (None: all), and the number of all episodes.

        `timeout_rate` is the share of all other outcomes, also of contacts with parked vehicles; 1 without an episode.
        """
        outcomes = np.array(self.outcomes if last is None else self.outcomes[-last:])
        count = max(1, len(outcomes))
        collision, goal = float((outcomes == COLLISION).sum()) / count, float((outcomes == GOAL).sum()) / count
        rates = {"collision_rate": collision, "goal_rate": goal, "timeout_rate": 1.0 - collision - goal}
        return rates | {"critical_episodes": float(len(self.outcomes))}


class NoAcceleration:
    """The control in simulation: agents with acceleration 0; the vehicle keeps its lane."""

    keeps_lane = True

    def act(self, tick: Tick, assessment: Assessment) -> NDArray[np.float64]:
        """Return accelerations of 0, float64[B, 2], see `Agent.act`."""
        return np.zeros((len(tick.state), 2))


def measure_outcomes(policy: Policy | None, simulation: SimulationConfig, keeping: Collection[str] = ()) -> Outcomes:
    """Simulate episodes under a policy, and return the outcomes of those with a hand-over.

    :param policy: of both agents; None: `NoAcceleration`.
    :param keeping: agents that keep their velocity instead.
    """
    world = simulation.make_world()
    agents: dict[str, Agent] = dict.fromkeys(AGENTS, NoAcceleration())
    if policy is not None:
        agents = {**policies(policy, world, simulation.policies), **dict.fromkeys(keeping, NoAcceleration())}
    outcomes = Outcomes(simulation.world, simulation.scenarios)
    for step in Loop(world, agents):
        outcomes.note(step)
    return outcomes
