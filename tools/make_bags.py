#!/usr/bin/env python
"""Make bags/: small bags, recorded from the graph of nodes with the shipped policies.

    tools/make_bags.py [--output bags] [--weights people] [--seed 1] [--look 50] [--only closed_loop]

In each scenario the first LOOK episodes of the seed are simulated, and the most telling one is recorded: the policies
acted in it, both agents reached their goals, it was critical for a second, and its least CurvTTC is nearest to 1.5 s.
Where no episode ends well, the nearest of the others is taken, and what is printed says so. `closed_loop` is such a bag
of scenario 1 by these agents, `learning` a bag of stage 2, in which a learner gives the policies new weights. Every bag
but the last is then simulated again and compared. `--only NAME` makes one of them.
"""

import argparse
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import yaml

from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import VpsciError
from vpsci_ros.generate.job import job_from
from vpsci_ros.generate.simulate import Simulator
from vpsci_ros.nodes.graph import NodeProcesses, resolve, run_graph
from vpsci_ros.nodes.node_config import GraphConfig
from vpsci_ros.parameters import as_ros_parameters
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.world.state import ENDED, GOAL, OUTCOME_NAMES

STAGE = "params/stage3_generate.yaml"
LEARNS = "stage2_online"
LEARNING = (  # so small that its bag is small, too; in one process the world does not run ahead of the learner
    "graph.composed=true", "learner.weights=closed_loop", "learner.refresh_every=1", "learner.updates_per_episode=1",
    "learner.replay.batch_size=64", "world_simulator.scenarios=[1]", "world_simulator.episodes=3",
    "world_simulator.batch=1", "world_simulator.action_timeout=30.0",
)  # fmt: skip
OTHERS, LEARNED = "closed_loop", "learning"  # names of bags; the first one also of the weights
TELLING = 1.5  # [s] of least CurvTTC
LONG = 20  # critical ticks that make an interaction to look at
LARGEST = 500_000  # bytes, twice that for `learning`; chunks of 64 KiB and /tf take a third of it
PATIENCE = 600.0  # [s] for one run of the graph


def telling_episode(sections: Sections, scenario: int, look: int) -> tuple[int, str, float]:
    """Return number, outcome and least CurvTTC [s] of the episode to record."""
    found: dict[int, tuple[int, float]] = {}
    critical = Counter[int]()
    for step in Simulator(job_from(sections), 64).loop((scenario, number) for number in range(look)):
        state = step.tick.state
        critical.update(state["episode"][step.assessment.critical != 0].tolist())
        for row in state[state["status"] == ENDED]:
            found[int(row["episode"])] = (int(row["outcome"]), float(row["least_curvttc"]))
    best = min(found, key=lambda n: (found[n][0] != GOAL, critical[n] < LONG, abs(found[n][1] - TELLING), n))
    return best, OUTCOME_NAMES[found[best][0]], found[best][1]


def record(sections: Sections, episode: int, bag: Path) -> None:
    """Run the graph over one episode and leave its bag in folder `bag`.

    :raises VpsciError: a node failed, or the run took too long.
    """
    sections = sections.changed("world_simulator", {"first_episode": episode, "episodes": 1, "batch": 1})
    with tempfile.TemporaryDirectory() as folder:
        resolved = resolve(sections, Path(folder))
        nodes = resolved.get(GraphConfig, "graph").nodes
        resolved = resolved.changed("recorder", {"bag": str(bag)})
        parameters = Path(folder) / "params.yaml"
        parameters.write_text(yaml.safe_dump(as_ros_parameters(resolved.values)), encoding="utf-8")
        with NodeProcesses(nodes, parameters, Path(folder) / "log") as processes:
            begun = time.monotonic()
            while not (ended := processes.ended()):
                if time.monotonic() - begun > PATIENCE:
                    raise VpsciError(f"{bag.name}: the graph did not end within {PATIENCE:g} s")
                processes.statuses(0.1)
            if ended.get(processes.leader) != 0:
                raise VpsciError("; ".join(processes.explain(node) for node in ended))
            processes.stop()


def record_learning(bag: Path) -> str:
    """Run stage 2 of the graph from the shipped weights over a few episodes, and leave its bag; return what it is."""
    with tempfile.TemporaryDirectory() as folder:
        result = run_graph(load(LEARNS, list(LEARNING)), Path(folder) / "run", quiet=True)
        if result.error:
            raise VpsciError(f"{bag.name}: {result.error}")
        shutil.copytree(result.bag, bag)
        updates = result.nodes["learner"].number("updates") or 0
        if updates < 2:
            raise VpsciError(f"{bag.name}: the learner made {updates:g} updates before the run ended; make it again")
        return f"{updates:g} updates"


def record_telling(bag: Path, scenario: int, given: argparse.Namespace, weights: str) -> str:
    """Record the most telling episode of a scenario by these weights, and verify it; return what it is."""
    sections = sections_of(given.seed, weights).changed("world_simulator", {"scenarios": [scenario]})
    episode, outcome, least = telling_episode(sections, scenario, given.look)
    record(sections, episode, bag)
    verified = verify_bag(bag)
    if verified.difference:
        raise VpsciError(f"{bag}: {verified.difference}")
    return f"episode {scenario}:{episode}, {outcome}, least CurvTTC {least:.2f} s, {verified.ticks} ticks verified"


def main() -> int:
    """Make all bags, or say what went wrong."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--output", type=Path, default=Path("bags"))
    options.add_argument("--weights", default="people", help="weights file, or shipped name")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--look", type=int, default=50, help="episodes among which one is chosen")
    options.add_argument("--only", help="name of one bag")
    given = options.parse_args()
    given.output.mkdir(exist_ok=True)
    made: dict[str, Callable[[Path], str]] = {
        scenario.name: partial(record_telling, scenario=scenario.number, given=given, weights=given.weights)
        for scenario in job_from(sections_of(given.seed, given.weights)).scenarios
    }
    made[OTHERS] = partial(record_telling, scenario=1, given=given, weights=OTHERS)
    made[LEARNED] = record_learning
    try:
        for name in [given.only] if given.only else made:
            bag = given.output.resolve() / name
            shutil.rmtree(bag, ignore_errors=True)
            said = made[name](bag)
            size = sum(path.stat().st_size for path in bag.iterdir())
            largest = 2 * LARGEST if name == LEARNED else LARGEST
            if size > largest:
                raise VpsciError(f"{bag}: {size} bytes, expected at most {largest}")
            print(f"{name}: {said}, {size / 1000:.0f} kB", flush=True)
    except VpsciError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def sections_of(seed: int, weights: str) -> Sections:
    """Return the sections of stage 3's parameter file with a seed and weights."""
    sections = load(Path(__file__).parents[1] / STAGE).changed("world_simulator", {"seed": seed})
    for node in ("vehicle_policy", "pedestrian_policy"):
        sections = sections.changed(node, {"weights": weights})
    return sections


if __name__ == "__main__":
    sys.exit(main())
