"""A simulation as one value: its episodes, its world, and the policies' exploration."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from vpsci_ros.lockstep.engines import require_own
from vpsci_ros.lockstep.simulator_config import SimulatorConfig
from vpsci_ros.parameters import values_of
from vpsci_ros.policy.policy_config import PolicyConfig
from vpsci_ros.runs.run_config import RunConfig, Sections
from vpsci_ros.world import Scenario, World, WorldConfig, load_scenarios
from vpsci_ros.world.observation import AGENTS


@dataclass(frozen=True)
class SimulationConfig:
    """The configuration of a simulation, without weights.

    :ivar episodes: (scenario number, episode number) pairs, in order.
    :ivar batch: number of parallel episodes.
    :ivar seed: of the world.
    :ivar policies: agent -> how it explores and draws, see `vpsci_ros.policy.agent.policies`.
    """

    scenarios: Sequence[Scenario]
    episodes: Sequence[tuple[int, int]]
    batch: int
    seed: int
    world: WorldConfig = field(default_factory=WorldConfig)
    policies: Mapping[str, PolicyConfig] = field(default_factory=dict)

    def make_world(self, episodes: Sequence[tuple[int, int]] | None = None) -> World:
        """Return a world with `episodes` in its queue; None: all episodes of the simulation."""
        queue = self.episodes if episodes is None else episodes
        return World(self.world, self.scenarios, queue, min(self.batch, len(queue)), self.seed)

    def identity(self) -> dict[str, Any]:
        """Return, as JSON values, everything that the episodes depend on besides weights."""
        digest = hashlib.sha256(repr([tuple(pair) for pair in self.episodes]).encode()).hexdigest()
        return {
            "scenarios": [[scenario.number, scenario.name] for scenario in self.scenarios],
            "episodes": f"{len(self.episodes)}, sha256 {digest}",
            "batch": self.batch,
            "seed": self.seed,
            "world": values_of(self.world),
            "policies": {agent: values_of(config) for agent, config in self.policies.items()},
        }


def simulation_of(sections: Sections) -> SimulationConfig:
    """Return the simulation that the sections of the world and the policies describe.

    :raises InvalidInput: a parameter or a scenario is refused, or another engine than this package's is chosen.
    """
    run = sections.get(RunConfig, "world_simulator")
    require_own(sections.get(SimulatorConfig, "world_simulator").engine, "episodes are simulated")
    return SimulationConfig(
        load_scenarios(run.scenarios, run.scenario_files),
        list(run.queue()),
        run.batch,
        run.seed,
        sections.get(WorldConfig, "world_simulator"),
        {agent: sections.get(PolicyConfig, f"{agent}_policy") for agent in AGENTS},
    )
