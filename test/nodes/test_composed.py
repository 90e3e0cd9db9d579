"""A graph composed in one process is the same graph: the ticks of the engine, the bag of separate processes."""

from pathlib import Path

import pytest

from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.nodes.graph import GraphResult, run_graph
from vpsci_ros.runs.run_config import Sections

NODES = ["world_simulator", "safety_monitor", "perception", "recorder"]
RULES = {"vehicle_driver": "autopilot", "pedestrian_driver": "autopilot"}


def run(folder: Path, *, together: bool) -> GraphResult:
    sections = {
        "graph": {"nodes": NODES, "composed": together, "progress_timeout": 240.0},
        "world_simulator": {"scenarios": [3], "episodes": 1, "batch": 1, "episode_time": 2.0} | RULES,
        "perception": {"position_noise": 0.2, "missed": 0.05},
    }
    return run_graph(Sections(sections), folder, quiet=True)


@pytest.mark.usefixtures("forked_nodes")
def test_a_composed_graph_leaves_the_bag_of_separate_processes(domain: int, tmp_path: Path) -> None:
    held = []
    for together in (False, True):
        result = run(tmp_path / str(together), together=together)
        assert result.error == ""
        assert set(result.exits.values()) == {0}
        messages: dict[str, list[tuple[int, bytes]]] = {}
        for raw in Bag(result.bag).messages():
            if raw.topic != "/diagnostics":  # of the machine
                messages.setdefault(raw.topic, []).append((raw.time, bytes(raw.data)))
        held.append(messages)
    assert verify_bag(result.bag).difference == ""
    assert held[0].keys() == held[1].keys()
    assert held[0]["/markers"], "views are there, too"
    for topic, messages in held[0].items():
        assert messages == held[1][topic], topic
    assert {path.name for path in (tmp_path / "True" / "log").iterdir()} == {f"{node}.log" for node in result.nodes}
