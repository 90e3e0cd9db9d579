"""A graph composed in one process is the same graph: the same ticks and outcomes as the engine without nodes."""

from collections import Counter
from pathlib import Path

import numpy as np
from composed import composed

from vpsci_ros.nodes.graph import resolve
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.weights import load_weights
from vpsci_ros.resources import weights_path
from vpsci_ros.runs.config import RunConfig
from vpsci_ros.runs.sections import Sections
from vpsci_ros.world import OUTCOME_NAMES, World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.state import FINISHED


def test_a_composed_graph_runs_the_episodes_of_the_engine(domain: int, tmp_path: Path) -> None:
    policy = {"weights": "pretrained", "seed": 11}  # of what a policy draws, as in the world
    chosen = {
        "graph": {"nodes": ["world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy", "recorder"]},
        "world_simulator": {"scenarios": [2, 7], "episodes": 4, "batch": 3, "seed": 11},
        "vehicle_policy": policy,
        "pedestrian_policy": policy,
    }
    with composed(resolve(Sections(chosen), tmp_path)) as nodes:
        counts = nodes["world_simulator"].counts

    run = Sections(chosen).get(RunConfig, "world_simulator")
    world = World(WorldConfig(), load_scenarios(run.scenarios), run.queue(), run.batch, run.seed)
    outcomes: Counter[str] = Counter()
    for step in Loop(world, agents=policies(load_weights(weights_path("pretrained")), world)):
        ended = step.events[step.events["kind"] == FINISHED]
        outcomes.update(OUTCOME_NAMES[outcome] for outcome in ended["outcome"])
    assert counts is not None
    assert {name: getattr(counts, name) for name in outcomes} == outcomes
    assert np.sum(list(outcomes.values())) == 8
    assert counts.tick == world.now.number
    assert (tmp_path / "bag" / "metadata.yaml").is_file()
