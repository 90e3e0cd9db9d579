"""Nodes started by hand: in any order, in namespaces, with simulated time, several in one process, by a file."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nodes.by_hand import ByHand, content
from nodes.stage import PATIENCE

from vpsci_ros.bags.reader import Bag
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
    right.start("world_simulator,safety_monitor,recorder")
    for node in NODES:  # a message that strays has arrays of another length, which its reader refuses
        left.start(node, extra=("-p", "use_sim_time:=true", "-r", "/clock:=clock"))
    ticks = []
    for each, batch in ((left, 1), (right, 4)):
        held = content(each.finish())
        assert not [node for node in each.running if re.search("refused|second publisher", each.log(node))]
        states = {at: messages for (topic, at), messages in held.items() if topic == "/world/state"}
        assert {len(messages) for messages in states.values()} == {1}
        assert "ready: answers " in each.log("safety_monitor" if each is left else "world_simulator")
        assert ("/safety/state", 0) in held
        assert (("/markers", 0) in held) == (batch == 1)
        ticks.append(len(states))
    assert ticks[0] != ticks[1]


def test_a_stages_nodes_in_one_process_started_by_hand_with_its_file_reach_its_end(
    domain: int, tmp_path: Path, closed: Callable[[Any], Any]
) -> None:
    """As `ros2 run vpsci_ros NODE --ros-args --params-file FILE` starts them; `-p NODE:NAME:=VALUE` makes it small."""
    file = params_dir() / "stage3_generate.yaml"
    graph = closed(ByHand(tmp_path, file))
    small = {"recorder:bag": tmp_path / "bag", "world_simulator:scenarios": [1]}
    small |= {"world_simulator:episodes": 2, "world_simulator:batch": 2}
    extra = tuple(word for name, value in small.items() for word in ("-p", f"{name}:={value}"))
    graph.start(",".join(read_parameter_file(file)["graph"]["nodes"]), extra=extra)
    assert "/diagnostics" in Bag(graph.finish()).topics()
