"""Nodes started one by one: in any order, in namespaces, with simulated time, killed and started again on the way."""

import os
import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from nodes.by_hand import ByHand, content, diagnostics, wait_for
from nodes.stage import PATIENCE
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from vpsci_msgs.msg import WorldState
from vpsci_ros.nodes.domain import own_domain
from vpsci_ros.nodes.graph import NodeProcesses, run_graph
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.nodes.topics import RECORDING
from vpsci_ros.nodes.watch import Watch
from vpsci_ros.runs.sections import Sections

NODES = ["recorder", "vehicle_policy", "pedestrian_policy", "world_simulator", "safety_monitor"]


WORLD = {"seed": 5, "scenarios": [1, 8], "episodes": 3, "batch": 4}
NAMESPACE = "/here"


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, weights: str) -> dict[tuple[str, int], list[bytes]]:
    """What the bag of a graph in `NAMESPACE` holds of which nobody is killed."""
    sections = graph_of(weights, namespace=NAMESPACE)
    with own_domain():
        result = run_graph(sections, tmp_path_factory.mktemp("undisturbed") / "run", quiet=True)
    assert result.error == ""
    return content(result.bag)


def graph_of(weights: str, world: dict[str, Any] | None = None, **graph: Any) -> Sections:
    policy = {"weights": weights, "explore": True}
    return Sections(
        {
            "graph": {"nodes": NODES, "progress_timeout": 240.0} | graph,
            "world_simulator": WORLD | {"action_timeout": PATIENCE} | (world or {}),
            "vehicle_policy": policy,
            "pedestrian_policy": policy,
        }
    )


@pytest.fixture
def by_hand(domain: int, tmp_path: Path, weights: str, closed: Callable[[Any], Any]) -> Callable[..., ByHand]:
    return lambda name, namespace="", **world: closed(ByHand(tmp_path / name, graph_of(weights, world), namespace))


def test_a_policy_that_is_killed_and_started_again_leaves_the_same_bag(
    by_hand: Callable[..., ByHand], context: Context, undisturbed: dict[tuple[str, int], list[bytes]]
) -> None:
    graph = by_hand("killed", NAMESPACE)
    watcher = rclpy.create_node("watcher", context=context, namespace=NAMESPACE)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(watcher)
    frames = {"vehicle_policy": 4, "pedestrian_policy": 40}  # to kill in the middle of episodes that have a history

    def on_state(message: WorldState) -> None:
        held = int(np.count_nonzero(np.frombuffer(message.controlled, np.uint8)))
        for policy, left in list(frames.items()):
            frames[policy] = left - bool(held)
            if frames[policy] == 0:
                graph.kill(policy)
                graph.start(policy)

    watcher.create_subscription(WorldState, "world/state", on_state, RECORDING)
    last, *others = NODES  # the world waits for all of them, but not for the watcher
    graph.start(*reversed(others))
    wait_for(lambda: watcher.count_publishers("world/state") > 0, "the watcher to hear of the world")
    graph.start(last)
    while graph.running["world_simulator"].poll() is None:
        executor.spin_once(timeout_sec=0.1)
    bag = graph.finish()
    executor.shutdown()
    watcher.destroy_node()
    assert max(frames.values()) <= 0, "nobody was killed"
    reported = {name.rpartition("/")[2]: values for name, values in diagnostics(bag).items()}
    for policy in frames:
        assert int(reported[policy]["frames_recalled"]) > 0
        assert reported[policy]["ticks_missed"] == "0"
    assert "vehicle_answers_missing" not in reported["world_simulator"]
    found = content(bag)
    assert sorted(found) == sorted(undisturbed)
    assert found == undisturbed


def test_a_graph_starts_a_policy_again_that_dies_and_its_bag_shows_nothing_of_it(
    domain: int,
    tmp_path: Path,
    weights: str,
    undisturbed: dict[tuple[str, int], list[bytes]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    victims: list[int] = []
    take = Watch.take

    def spy(self: Watch, statuses: dict[str, NodeStatus]) -> None:
        take(self, statuses)
        if not victims and any((status.number("answers") or 0) > 20 for status in statuses.values()):
            victims.append(started[0].running["vehicle_policy"].pid)
            os.kill(victims[0], signal.SIGKILL)

    started: list[NodeProcesses] = []
    enter = NodeProcesses.__enter__
    monkeypatch.setattr(NodeProcesses, "__enter__", lambda self: started.append(self) or enter(self))
    monkeypatch.setattr(Watch, "take", spy)
    sections = graph_of(weights, namespace=NAMESPACE, restarts=1)
    result = run_graph(sections, tmp_path / "killed", quiet=True)
    assert result.error == ""
    assert victims
    assert result.exits["vehicle_policy"] == 0
    assert content(result.bag) == undisturbed


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


def test_every_node_says_for_whom_it_waits(by_hand: Callable[..., ByHand]) -> None:
    graph = by_hand("waits")
    graph.start("world_simulator", "vehicle_policy")
    others = ("pedestrian_policy", "safety_monitor", "recorder")
    for node in others:
        said = re.compile(f"waiting for .*{node}")
        wait_for(lambda: said.search(graph.log("world_simulator")) is not None, f"the world to wait for {node}")  # noqa: B023
    graph.kill("world_simulator")
    alone = by_hand("alone", "/alone")
    alone.start(*others, extra=("-p", "peer_timeout:=8.0"))  # the recorder says so after half of it
    for node in others:
        wait_for(lambda: "world_simulator" in alone.log(node), f"{node} to say so")  # noqa: B023 - called at once
