"""Chosen episodes of a dataset, simulated again and written as a bag."""

from pathlib import Path

from vpsci_ros.bags.run_record import node_record
from vpsci_ros.bags.simulated import write_ticks
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.simulate import Simulator
from vpsci_ros.generate.verify import job_of
from vpsci_ros.parameters import values_of


def record_episodes(folder: Path, episodes: list[tuple[int, int]], bag: Path) -> int:
    """Simulate episodes of a dataset again, write them to a bag, and return the number of its ticks.

    :param episodes: (scenario number, episode number), kept or not.
    :raises InvalidInput: no dataset of `generate`, an episode that it lacks, or `bag` is not empty.
    """
    data = Dataset(folder)
    job = job_of(data)
    known = [scenario.number for scenario in job.scenarios]
    there = set(data.index().select("scenario", "count").iter_rows())
    for scenario, number in episodes:
        if scenario not in known:
            raise InvalidInput(f"{folder}: no scenario {scenario}; it has {', '.join(map(str, known))}")
        if (scenario, number) not in there:
            raise InvalidInput(f"{folder}: no episode {scenario}:{number}; episodes.parquet lists those that it has")
    run = {"seed": job.seed, "scenarios": sorted({scenario for scenario, _ in episodes}), "batch": 1}
    nodes = [node_record("world_simulator", values_of(job.world) | run | {"queue": [list(each) for each in episodes]})]
    nodes.append(node_record("safety_monitor", {}))
    for agent, policy in job.policies.items():
        nodes.append(node_record(f"{agent}_policy", values_of(policy.config), policy.digest))
    scenarios = [scenario for scenario in job.scenarios if scenario.number in {number for number, _ in episodes}]
    return write_ticks(Simulator(job, 1).loop(episodes), job.world, bag, {}, nodes, scenarios)
