"""Nodes started one by one: in any order, in namespaces, with simulated time."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from nodes.by_hand import ByHand, content
from nodes.stage import PATIENCE

from vpsci_ros.runs.sections import Sections

NODES = ["recorder", "vehicle_policy", "world_simulator", "safety_monitor"]
WORLD = {"seed": 5, "scenarios": [1, 8], "episodes": 3, "batch": 4, "pedestrian_driver": "autopilot"}


def graph_of(weights: str, world: dict[str, Any] | None = None, **graph: Any) -> Sections:
    policy = {"weights": weights, "explore": True}
    return Sections(
        {
            "graph": {"nodes": NODES, "progress_timeout": 240.0} | graph,
            "world_simulator": WORLD | {"action_timeout": PATIENCE} | (world or {}),
            "vehicle_policy": policy,
        }
    )


@pytest.fixture
def by_hand(domain: int, tmp_path: Path, weights: str, closed: Callable[[Any], Any]) -> Callable[..., ByHand]:
    return lambda name, namespace="", **world: closed(ByHand(tmp_path / name, graph_of(weights, world), namespace))


def test_two_graphs_in_two_namespaces_do_not_see_each_other_and_follow_the_parameter_file(
    by_hand: Callable[..., ByHand],
) -> None:
    left = by_hand("left", "/left", batch=1, episodes=1, scenarios=[3])
    right = by_hand("right", "/right", batch=4, episodes=2, scenarios=[4])
    for node in NODES:  # side by side; a message that strays has arrays of another length, which its reader refuses
        left.start(node, extra=("-p", "use_sim_time:=true", "-r", "/clock:=clock"))
        right.start(node)
    ticks = []
    for graph, batch in ((left, 1), (right, 4)):
        held = content(graph.finish())
        assert not [node for node in NODES if re.search("refused|second publisher", graph.log(node))]
        states = {at: messages for (topic, at), messages in held.items() if topic == "/world/state"}
        assert {len(messages) for messages in states.values()} == {1}
        assert ("/safety/state", 0) in held
        assert (("/markers", 0) in held) == (batch == 1)
        ticks.append(len(states))
    assert ticks[0] != ticks[1]
