#!/usr/bin/env python
"""Make bags/: one small bag a scenario, recorded from the graph of nodes with the shipped policies.

    tools/make_bags.py [--output bags] [--weights refined] [--seed 1] [--look 50]

In each scenario the first LOOK episodes of the seed are simulated, and the most telling one is recorded: the policies
acted in it, both agents reached their goals, it was critical for a second, and its least CurvTTC is nearest to 1.5 s.
Where no episode ends well, the nearest of the others is taken, and what is printed says so. Every bag is then
simulated again and compared.
"""

import argparse
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import yaml

from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import VpsciError
from vpsci_ros.generate.job import job_from
from vpsci_ros.generate.simulate import Simulator
from vpsci_ros.nodes.graph import NodeProcesses, resolve
from vpsci_ros.nodes.node_config import GraphConfig
from vpsci_ros.parameters import as_ros_parameters
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.world.state import ENDED, GOAL, OUTCOME_NAMES

STAGE = "params/stage3_generate.yaml"
TELLING = 1.5  # [s] of least CurvTTC
LONG = 20  # critical ticks that make an interaction to look at
LARGEST = 500_000  # bytes; chunks of 64 KiB and /tf take a third more than large chunks without it
PATIENCE = 600.0  # [s] for one run of the graph


def telling_episode(sections: Sections, scenario: int, look: int) -> tuple[int, str, float]:
    """Return number, outcome and least CurvTTC [s] of the episode to record."""
    found, critical = {}, Counter()
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


def main() -> int:
    """Make all bags, or say what went wrong."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--output", type=Path, default=Path("bags"))
    options.add_argument("--weights", default="people", help="weights file, or shipped name")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--look", type=int, default=50, help="episodes among which one is chosen")
    given = options.parse_args()
    given.output.mkdir(exist_ok=True)
    try:
        for scenario in job_from(sections_of(given)).scenarios:
            sections = sections_of(given).changed("world_simulator", {"scenarios": [scenario.number]})
            episode, outcome, least = telling_episode(sections, scenario.number, given.look)
            bag = given.output.resolve() / scenario.name
            shutil.rmtree(bag, ignore_errors=True)
            record(sections, episode, bag)
            verified = verify_bag(bag)
            size = sum(path.stat().st_size for path in bag.iterdir())
            if verified.difference or size > LARGEST:
                raise VpsciError(f"{bag}: {verified.difference or f'{size} bytes, expected at most {LARGEST}'}")
            print(
                f"{bag.name}: episode {scenario.number}:{episode}, {outcome}, least CurvTTC {least:.2f} s, "
                f"{verified.ticks} ticks verified, {size / 1000:.0f} kB",
                flush=True,
            )
    except VpsciError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def sections_of(given: argparse.Namespace) -> Sections:
    """Return the sections of stage 3's parameter file with the seed and weights of the command line."""
    sections = load(Path(__file__).parents[1] / STAGE)
    sections = sections.changed("world_simulator", {"seed": given.seed})
    for node in ("vehicle_policy", "pedestrian_policy"):
        sections = sections.changed(node, {"weights": given.weights})
    return sections


if __name__ == "__main__":
    sys.exit(main())
