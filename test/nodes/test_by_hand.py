"""Nodes started one by one: by each stage's file, in any order, in namespaces, with simulated time."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from nodes.by_hand import ByHand, content
from nodes.stage import PATIENCE
from synthetic import synthetic_near_misses

from vpsci_ros.bags.reader import Bag
from vpsci_ros.data.near_misses import write_near_misses
from vpsci_ros.parameters import read_parameter_file
from vpsci_ros.resources import params_dir
from vpsci_ros.runs.config import Sections

NODES = ["recorder", "world_simulator", "safety_monitor"]


def test_two_graphs_in_two_namespaces_do_not_see_each_other_and_follow_the_parameter_file(
    domain: int, tmp_path: Path, closed: Callable[[Any], Any]
) -> None:
    def graph(name: str, **world: Any) -> ByHand:
        rules = {"vehicle_driver": "autopilot", "pedestrian_driver": "autopilot", "action_timeout": PATIENCE}
        sections = Sections({"graph": {"nodes": NODES}, "world_simulator": rules | world})
        return closed(ByHand(tmp_path / name, sections, f"/{name}"))

    left = graph("left", batch=1, episodes=1, scenarios=[3])
    right = graph("right", batch=4, episodes=2, scenarios=[4])
    for node in NODES:  # side by side; a message that strays has arrays of another length, which its reader refuses
        left.start(node, extra=("-p", "use_sim_time:=true", "-r", "/clock:=clock"))
        right.start(node)
    ticks = []
    for each, batch in ((left, 1), (right, 4)):
        held = content(each.finish())
        assert not [node for node in NODES if re.search("refused|second publisher", each.log(node))]
        states = {at: messages for (topic, at), messages in held.items() if topic == "/world/state"}
        assert {len(messages) for messages in states.values()} == {1}
        assert ("/safety/state", 0) in held
        assert (("/markers", 0) in held) == (batch == 1)
        ticks.append(len(states))
    assert ticks[0] != ticks[1]


STAGES = {"stage1_pretrain": "learner", "stage2_online": "world_simulator", "stage3_generate": "world_simulator"}


@pytest.mark.parametrize("stage", STAGES)
def test_nodes_started_by_hand_with_a_stages_file_reach_its_end(
    domain: int, tmp_path: Path, weights: str, closed: Callable[[Any], Any], stage: str
) -> None:
    """As `ros2 run vpsci_ros NODE --ros-args --params-file FILE` starts them; `-p NODE:NAME:=VALUE` makes it small."""
    file = params_dir() / f"{stage}.yaml"
    near_misses = tmp_path / "near.parquet"
    write_near_misses(synthetic_near_misses(8).table, near_misses)
    learner = {"near_misses": [str(near_misses)], "output": str(tmp_path / "learned"), "replay.batch_size": 16}
    learner |= {"episodes": 2} if stage == "stage1_pretrain" else {"weights": weights}
    small = {
        "recorder": {"bag": str(tmp_path / "bag")},
        "world_simulator": {"scenarios": [1], "episodes": 2, "batch": 2},
        "learner": learner,
    }
    graph = closed(ByHand(tmp_path, file))
    nodes = read_parameter_file(file)["graph"]["nodes"]
    words = [f"{node}:{name}:={value}" for node in nodes for name, value in small.get(node, {}).items()]
    extra = tuple(word for each in words for word in ("-p", each))
    graph.start(*([",".join(nodes)] if stage == "stage3_generate" else nodes), extra=extra)
    assert "/diagnostics" in Bag(graph.finish(STAGES[stage])).topics()
    learned = {path.name for path in tmp_path.glob("learned/*.safetensors")}
    wanted = {"stage1_pretrain": {"pretrained.safetensors"}, "stage2_online": {"refined.safetensors"}}
    assert learned == wanted.get(stage, set())
