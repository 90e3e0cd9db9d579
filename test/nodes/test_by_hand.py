"""Nodes started by hand: in any order, in namespaces, with simulated time, several in one process, by a file."""

import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from nodes.stage import PATIENCE, Stage
from rclpy.context import Context
from synthetic import synthetic_near_misses

from vpsci_ros.bags.reader import Bag
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.cli.stages import stage_2_inputs
from vpsci_ros.data.near_misses import write_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.training_config import LearnerConfig
from vpsci_ros.nodes.graph import resolve, run_graph
from vpsci_ros.nodes.learner import Learner
from vpsci_ros.parameters import as_ros_parameters
from vpsci_ros.resources import params_dir
from vpsci_ros.runs.run_config import Sections

NODES = ["recorder", "world_simulator", "safety_monitor"]


class ByHand:
    """Nodes of a graph started one by one as processes, by a parameter file."""

    def __init__(self, folder: Path, parameters: Sections, namespace: str) -> None:
        self.folder, self._namespace = folder, namespace
        folder.mkdir(parents=True, exist_ok=True)
        self._parameters = folder / "params.yaml"
        layout = as_ros_parameters(resolve(parameters, folder).values, any_namespace=True)
        self._parameters.write_text(yaml.safe_dump(layout), encoding="utf-8")
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, *nodes: str, extra: tuple[str, ...] = ()) -> None:
        """Start nodes; "world_simulator,recorder" is one process, and goes by the name of the first."""
        for names in nodes:
            node = names.partition(",")[0]
            command = [sys.executable, "-m", "vpsci_ros.nodes", names, "--ros-args"]
            command += ["--params-file", str(self._parameters)]
            command += ["-r", f"__ns:={self._namespace}"]
            with open(self.folder / f"{node}.log", "ab") as log:
                self.running[node] = subprocess.Popen([*command, *extra], stdout=log, stderr=subprocess.STDOUT)

    def log(self, node: str) -> str:
        """Return what a node has said so far."""
        return (self.folder / f"{node}.log").read_text()

    def finish(self) -> Path:
        """Wait for the end of the world, stop the others, the recorder last; return the bag."""
        assert self.running["world_simulator"].wait(PATIENCE) == 0, self.log("world_simulator")
        for node in sorted(self.running, key=lambda name: name == "recorder"):
            if self.running[node].poll() is None:
                self.running[node].send_signal(signal.SIGINT)
                assert self.running[node].wait(PATIENCE) == 0, self.log(node)
        return self.folder / "bag"

    def close(self) -> None:
        """End whatever is left."""
        for process in self.running.values():
            if process.poll() is None:
                process.kill()
            process.wait(PATIENCE)


def test_two_graphs_in_two_namespaces_do_not_see_each_other_and_follow_the_parameter_file(
    domain: int, tmp_path: Path, closed: Callable[[Any], Any]
) -> None:
    def graph(name: str, **world: Any) -> ByHand:
        rules = {"vehicle_driver": "autopilot", "pedestrian_driver": "autopilot", "action_timeout": PATIENCE}
        sections = Sections({"graph": {"nodes": NODES}, "world_simulator": rules | world})
        return closed(ByHand(tmp_path / name, sections, f"/{name}"))

    left = graph("left", batch=1, episodes=1, scenarios=[3], episode_time=2.0)
    right = graph("right", batch=4, episodes=2, scenarios=[4], episode_time=3.0)
    right.start("world_simulator,safety_monitor,recorder")
    for node in NODES:  # a message that strays has arrays of another length, which its reader refuses
        left.start(node, extra=("-p", "use_sim_time:=true", "-r", "/clock:=clock"))
    ticks: list[int] = []
    for each, batch in ((left, 1), (right, 4)):
        bag = Bag(each.finish())
        assert not [node for node in each.running if re.search("refused|second publisher", each.log(node))]
        assert "ready: answers " in each.log("safety_monitor" if each is left else "world_simulator")
        states = Counter(raw.time for raw in bag.messages(["/world/state"]))
        assert set(states.values()) == {1}, "of one graph"
        ticks.append(len(states))
        at_first = {raw.topic for raw in bag.messages(stop=0)}
        assert "/safety/state" in at_first
        assert ("/markers" in at_first) == (batch == 1)
    assert ticks[0] < ticks[1]


def test_a_learner_started_by_hand_writes_where_the_parameter_file_of_stage_two_reads(
    domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both files as they are shipped; the smallest networks, one iteration and a small table make it short."""
    monkeypatch.chdir(tmp_path)
    write_near_misses(synthetic_near_misses(8).table, tmp_path / "near.parquet")
    small = {"episodes": 1, "hidden": 8, "layers": 1, "held_out_clips": "[none]", "near_misses": "[near.parquet]"}
    words = [word for name, value in small.items() for word in ("-p", f"{name}:={value}")]
    file, context = str(params_dir() / "stage1_pretrain.yaml"), Context()
    rclpy.init(args=["--ros-args", "--params-file", file, *words], context=context)
    try:
        with closing(Stage(context, learner := Learner(context=context))) as here:
            here.spin_until(lambda: learner.finished)
    finally:
        context.try_shutdown()
    start = stage_2_inputs(load("stage2_online", ["learner.near_misses=[near.parquet]"]))[3]
    assert (start.facts["stage"], start.facts["data"]["interactions"]) == ("pretrained", 8)


def test_a_graph_and_a_command_given_the_folder_of_the_parameter_file_write_where_a_node_by_hand_does() -> None:
    for stage in ("stage1_pretrain", "stage2_online"):
        sections = load(stage, [])
        by_hand = sections.get(LearnerConfig, "learner").output
        assert f"-o {by_hand}\n" in (params_dir() / f"{stage}.yaml").read_text(), "the command that the file names"
        assert resolve(sections, Path(by_hand)).get(LearnerConfig, "learner").output == by_hand


def test_stage_two_without_the_weights_of_stage_one_names_the_command_that_makes_them(
    domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    sections = load("stage2_online", [])
    hint = "out/stage1/pretrained.safetensors: no such file; make one with 'vpsci pretrain', or name a shipped one"
    with pytest.raises(InvalidInput, match=hint):
        stage_2_inputs(sections)
    with pytest.raises(InvalidInput, match=hint):
        run_graph(sections, tmp_path / "graph", quiet=True)
