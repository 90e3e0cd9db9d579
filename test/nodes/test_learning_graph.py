"""Stages 1 and 2 through the graph: near misses in, weights out; the policies take up what the learner publishes."""

from pathlib import Path
from typing import Any

import polars as pl
import pytest
from rosbags.highlevel import AnyReader
from synthetic import synthetic_near_misses

from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.run_record import bag_run
from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.data.near_misses import write_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.graph import GraphResult, run_graph
from vpsci_ros.policy.weights import load_weights
from vpsci_ros.runs.config import Sections

pytestmark = pytest.mark.usefixtures("forked_nodes")
SMALL_STAGE_1 = {
    "stage": "pretrain",
    "episodes": 2,
    "replay.batch_size": 16,
}
SMALL_NETWORK = {"hidden": 16, "heads": 2, "key_dimension": 8}
SMALL_STAGE_2 = {
    "stage": "refine",
    "replay.batch_size": 16,
    "refresh.updates": 2,
}


def stage_one(folder: Path, near_misses: list[str]) -> GraphResult:
    """Run stage 1; its bag holds the learner's parameters and says why there is nothing to verify."""
    learner = SMALL_STAGE_1 | SMALL_NETWORK | {"near_misses": near_misses}
    first = run_graph(Sections({"graph": {"nodes": ["learner", "recorder"]}, "learner": learner}), folder, quiet=True)
    assert first.error == ""
    parameters = bag_run(Bag(first.bag)).parameters["learner"]
    assert (parameters["stage"], parameters["replay.batch_size"]) == ("pretrain", 16)
    with pytest.raises(InvalidInput, match="of stage 1, in which a learner reads a table and nothing is simulated"):
        verify_bag(first.bag)
    said = (first.folder / "log" / "recorder.log").read_text()
    assert "without the parameters" not in said
    assert "waiting for" not in said.partition("found learner")[2]
    return first


def test_stage_one_writes_weights_from_which_stage_two_learns_on_while_the_graph_runs(
    domain: int, tmp_path: Path
) -> None:
    write_near_misses(synthetic_near_misses(8).table, tmp_path / "near.parquet")
    near_misses = [str(tmp_path / "near.parquet")]
    first = stage_one(tmp_path / "stage1", near_misses)
    assert first.nodes["learner"].number("episode") == 2
    pretrained = first.folder / "learner" / "pretrained.safetensors"
    assert load_weights(pretrained).facts["stage"] == "pretrained"
    assert pl.read_csv(first.folder / "learner" / "log.csv").height == 2
    assert (first.folder / "learner" / "learning.png").exists()

    everybody = ["world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy", "learner", "recorder"]
    chosen: dict[str, dict[str, Any]] = {
        "graph": {"nodes": everybody},
        "world_simulator": {
            "scenarios": [1, 6],
            "episodes": 3,
            "batch": 2,
            "publish_transitions": True,
            "replay_window": 64,
            "pedestrian_gain": 0.5,  # as the objective of these small networks takes for granted
        },
        "vehicle_policy": {"explore": True},
        "pedestrian_policy": {"explore": True},
        "learner": SMALL_STAGE_2 | {"weights": str(pretrained), "near_misses": near_misses},
    }
    second = run_graph(Sections(chosen), tmp_path / "stage2", quiet=True)
    assert second.error == ""
    learner = {name: float(value) for name, value in second.nodes["learner"].figures.items()}
    assert learner["updates"] > 2
    assert learner["lost"] == 0
    assert load_weights(second.folder / "learner" / "refined.safetensors").facts["stage"] == "refined"
    rows = pl.read_csv(second.folder / "learner" / "refine_log.csv")
    rewards = pl.read_csv(second.folder / "learner" / "refine_episodes.csv")
    assert rows["updates"][-1] >= learner["updates"]  # it may go on after its last report
    assert rewards["episode"].to_list() == list(range(1, rows["episodes"][-1] + 1)), "a row for every episode"
    assert (second.folder / "learner" / "learning.png").exists()

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
    assert 0 < learner["transitions"] <= len(numbers), "the learner ends a little behind the world"
