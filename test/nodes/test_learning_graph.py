"""Stages 1 and 2 through the graph, by their files: near misses in, weights out, and the policies take up new ones."""

from pathlib import Path
from typing import Any

import polars as pl
import pytest
from rosbags.highlevel import AnyReader
from synthetic import synthetic_near_misses

from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.run_record import bag_run
from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.data.near_misses import write_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.graph import GraphResult, run_graph
from vpsci_ros.policy.weights import load_weights

pytestmark = pytest.mark.usefixtures("forked_nodes")
TOGETHER = ["graph.composed=true", "learner.replay.batch_size=16"]  # one process, which imports torch once


def stage_one(folder: Path, near_misses: str) -> GraphResult:
    """Run stage 1; its bag holds the learner's parameters and says why there is nothing to verify."""
    small = [f"learner.{name}" for name in ("episodes=2", "hidden=16", near_misses)]
    first = run_graph(load("stage1_pretrain", [*TOGETHER, *small]), folder, quiet=True)
    assert first.error == ""
    assert first.nodes["learner"].number("episode") == 2
    parameters = bag_run(Bag(first.bag)).parameters["learner"]
    assert (parameters["stage"], parameters["replay.batch_size"]) == ("pretrain", 16)
    with pytest.raises(InvalidInput, match="of stage 1, in which a learner reads a table and nothing is simulated"):
        verify_bag(first.bag)
    assert pl.read_csv(first.folder / "log.csv").height == 2
    assert (first.folder / "learning.png").exists()
    return first


def test_stage_one_writes_weights_from_which_stage_two_learns_on_while_the_graph_runs(
    domain: int, tmp_path: Path
) -> None:
    write_near_misses(synthetic_near_misses(8).table, tmp_path / "near.parquet")
    near_misses = f"near_misses=[{tmp_path / 'near.parquet'}]"
    pretrained = stage_one(tmp_path / "stage1", near_misses).folder / "pretrained.safetensors"
    assert load_weights(pretrained).facts["stage"] == "pretrained"

    world: dict[str, Any] = {"scenarios": [1, 6], "episodes": 3, "batch": 2, "action_timeout": 60.0}
    settings = [f"world_simulator.{name}={value}" for name, value in world.items()]
    settings += [
        f"learner.{each}" for each in (near_misses, f"weights={pretrained}", "refresh_every=2", "updates_per_episode=1")
    ]
    second = run_graph(load("stage2_online", [*TOGETHER, *settings]), tmp_path / "stage2", quiet=True)
    assert second.error == ""
    learner = {name: float(value) for name, value in second.nodes["learner"].figures.items()}
    assert learner["lost"] == 0
    assert load_weights(second.folder / "refined.safetensors").facts["stage"] == "refined"
    rows = pl.read_csv(second.folder / "refine_log.csv")
    rewards = pl.read_csv(second.folder / "refine_episodes.csv")
    assert rows["updates"][-1] == learner["updates"] >= 2
    assert rewards["episode"].to_list() == list(range(1, rows["episodes"][-1] + 1)), "a row for every episode"

    versions = set()
    numbers: list[int] = []
    with AnyReader([second.bag]) as reader:
        assert reader.end_time < 1000e9, "every message is stamped with simulated time"
        for connection, _, data in reader.messages():
            if connection.topic == "/vehicle/action":
                versions.add(reader.deserialize(data, connection.msgtype).policy_version)
            elif connection.topic == "/replay":
                message = reader.deserialize(data, connection.msgtype)
                numbers += range(message.first_number, message.first_number + len(message.scenario))
    assert versions >= {1, 2}, "the policies never took up refreshed weights"
    assert numbers == list(range(len(numbers))), "transitions are numbered without gaps"
    assert learner["transitions"] == len(numbers) > 0, "the graph waits for its learner"
