"""Stages 1 and 2 through the graph: near misses in, weights out; the policies take up what the learner publishes."""

from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader

from vpsci_ros.learning.weights import load_weights
from vpsci_ros.nodes.graph import run_graph

SMALL_STAGE_1 = {"stage": "pretrain", "episodes": 2, "rollouts": 4, "batch_size": 16, "evaluate_every": 2}
SMALL_STAGE_2 = {
    "stage": "refine",
    "batch_size": 16,
    "warm_up_steps": 8,
    "steps_per_update": 8,
    "critic_warm_up": 1,
    "updates_per_refresh": 2,
    "rollback_margin": 10.0,  # barely trained weights may get worse; what is tested is that they travel
}


def test_stage_one_writes_weights_from_which_stage_two_learns_on_while_the_graph_runs(
    domain: int, tmp_path: Path
) -> None:
    nodes = ["learner", "recorder"]
    first = run_graph({"graph": {"nodes": nodes}, "learner": SMALL_STAGE_1}, tmp_path / "stage1", quiet=True)
    assert first.error == ""
    assert first.progress["learner.episode"] == 2
    pretrained = first.folder / "learner" / "pretrained.safetensors"
    assert load_weights(pretrained).facts["stage"] == "pretrained"

    everybody = ["world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy", "learner", "recorder"]
    chosen: dict[str, dict[str, Any]] = {
        "graph": {"nodes": everybody},
        "world_simulator": {"episodes": 3, "batch": 8, "publish_transitions": True, "replay_window": 64},
        "vehicle_policy": {"explore": True},
        "pedestrian_policy": {"explore": True},
        "learner": SMALL_STAGE_2 | {"weights": str(pretrained)},
    }
    second = run_graph(chosen, tmp_path / "stage2", quiet=True)
    assert second.error == ""
    assert second.progress["learner.updates"] > 2
    assert second.progress["learner.lost"] == 0
    assert load_weights(second.folder / "learner" / "refined.safetensors").facts["stage"] == "refined"

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
    assert 0 < second.progress["learner.transitions"] <= len(numbers), "the learner ends a little behind the world"
