"""The node publishes the pedestrians as its core perceives them, a list a tick; the exam's ADS then lives by that."""

import struct
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from class_in_process import class_in_process
from geometry_msgs.msg import AccelStamped
from nodes.stage import PATIENCE, Stage, overrides, state_bytes
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from sensor_msgs.msg import PointCloud2

from vpsci_msgs.msg import WorldState
from vpsci_ros.bags.reader import Bag
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import VpsciError
from vpsci_ros.exam.exam import prepare
from vpsci_ros.exam.measures import episode_table
from vpsci_ros.exam.result import Conduct, read_result
from vpsci_ros.exam.run import run_with
from vpsci_ros.nodes.domain import own_domain
from vpsci_ros.nodes.perception import Perception
from vpsci_ros.nodes.safety_monitor import SafetyMonitor
from vpsci_ros.nodes.world_simulator import WorldSimulator
from vpsci_ros.resources import params_dir
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.wire.world_state import read_world_state
from vpsci_ros.world import EPISODE, load_scenarios
from vpsci_ros.world.parked import parked_from
from vpsci_ros.world.perception import SEEN, PerceptionConfig, blank, perceive

pytestmark = pytest.mark.usefixtures("forked_nodes")
ERRORS = {"position_noise": 0.2, "velocity_noise": 0.1, "missed": 0.1, "latency": 0.1, "least_visible": 0.25}
NODES = ["world_simulator", "safety_monitor", "perception"]
POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "vx", "vy")] + [("id", "<u4")])


def run_world(context: Context, world: dict[str, Any], errors: dict[str, Any]) -> tuple[list[Any], list[Any]]:
    """Run an episode with the nodes in this process; return the states and the lists of objects."""
    settings = {"episodes": 1, "batch": 1, "vehicle_driver": "autopilot", "pedestrian_driver": "autopilot"} | world
    simulator = WorldSimulator(context=context, parameter_overrides=overrides(**settings, peers=NODES))
    perception = Perception(context=context, parameter_overrides=overrides(**errors, peers=NODES))
    states: list[bytes] = []
    objects: list[Any] = []
    simulator.create_subscription(WorldState, "world/state", states.append, 1000, raw=True)
    simulator.create_subscription(PointCloud2, "perception/objects", objects.append, 1000)
    made = [simulator, SafetyMonitor(context=context), perception]
    with closing(Stage(context, *made, executor=EventsExecutor)) as here:
        here.spin_until(lambda: simulator.finished and len(objects) >= len(states))
    return states, objects


def test_it_tells_a_list_a_tick_as_the_core_does_stamped_when_it_was_seen(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vpsci_ros.nodes.perception.REPEAT_AFTER", 0.001)  # none again: nobody drives from outside
    states, objects = run_world(context, {"scenarios": [104]}, ERRORS)
    config, parked = PerceptionConfig(**ERRORS), parked_from(load_scenarios([104]))
    memory, listed = blank(1, config, 0.05), 0
    assert len(states) == len(objects) > 60
    for data, message in zip(states, objects, strict=True):
        state = read_world_state(data).tick
        memory, expected = perceive(memory, state.state, config, 0.05, parked)
        seen = expected[expected["status"] == SEEN]
        points = np.frombuffer(bytes(message.data), POINT)
        assert message.width == len(points) == len(seen)
        assert points["id"].tolist() == seen["track"].tolist()
        for name in ("x", "y", "vx", "vy"):
            assert points[name].tolist() == seen[name].astype(np.float32).tolist()
        tick = round((message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec) / 0.05)
        assert tick == max(0, state.number - 2)
        listed += len(points)
    assert message.header.frame_id == "map"
    assert [(f.name, f.offset, f.datatype) for f in message.fields] == [
        ("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("vx", 12, 7), ("vy", 16, 7), ("id", 20, 6)
    ]  # fmt: skip
    assert 10 < listed < len(objects), "hidden at times"


def test_more_than_one_episode_at_a_time_is_refused_with_what_to_do(context: Context) -> None:
    with pytest.raises(VpsciError, match="expected 1 rows of /world/state, got 2; set world_simulator.batch to 1"):
        run_world(context, {"scenarios": [1], "batch": 2, "episodes": 2}, {})


@pytest.mark.parametrize("period", [0.0, -0.05, float("nan"), float("inf")])
def test_a_state_whose_ticks_take_no_time_is_refused_and_counted(context: Context, period: float) -> None:
    node = Perception(context=context)
    state = np.zeros(1, EPISODE)
    data = state_bytes(state, [False], 3).replace(struct.pack("<d", 0.05), struct.pack("<d", period))
    node.intake.receive("/world/state", data)
    assert node.intake.refused == {"/world/state": 1}
    node.destroy_node()


def test_the_first_list_is_published_again_while_the_world_waits_for_a_driving_system(
    context: Context, monkeypatch: pytest.MonkeyPatch, closed: Callable[[Any], Any]
) -> None:
    monkeypatch.setattr("vpsci_ros.nodes.perception.REPEAT_AFTER", 0.01)
    monkeypatch.setattr("vpsci_ros.nodes.world_simulator.REPEAT_AFTER", PATIENCE)
    drivers = {"vehicle_driver": "external", "pedestrian_driver": "autopilot"}
    settings = {"scenarios": [1], "episodes": 1, "batch": 1, "action_timeout": PATIENCE, "peers": NODES} | drivers
    world = WorldSimulator(context=context, parameter_overrides=overrides(**settings))
    perception = Perception(context=context, parameter_overrides=overrides(peers=NODES))
    here = closed(Stage(context, world, SafetyMonitor(context=context), perception, executor=EventsExecutor))
    here.peer.create_publisher(AccelStamped, "vehicle/cmd_accel", 10)
    here.peer.create_subscription(WorldState, "world/state", lambda _: None, 10)
    lists: list[PointCloud2] = []
    here.peer.create_subscription(PointCloud2, "perception/objects", lists.append, 10)
    here.spin_until(lambda: len(lists) > 2)
    assert {(each.header.stamp.sec, each.header.stamp.nanosec) for each in lists} == {(0, 0)}


LISTENING = """
import sys
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2
from vpsci_ros.nodes import example_ads

class Listening(example_ads.ExampleAds):
    def __init__(self):
        super().__init__()
        self.create_subscription(Odometry, "pedestrian/odometry", lambda _: print("TRUTH", flush=True), 10)
        self.create_subscription(PointCloud2, "perception/objects", lambda _: print("objects", flush=True), 10)

example_ads.ExampleAds = Listening
sys.exit(example_ads.main())
"""


def sections() -> Sections:
    """Parameters of an exam in which nobody beyond 8 m is seen, with errors."""
    world = {"scenarios": [104], "spawn": "human", "episodes": 2, "episode_time": 8.0, "action_timeout": 30.0}
    exam = {"pedestrians": ["walker"], "perception": True, "baseline": False, "allow_standing": True}
    chosen = load(params_dir() / "ads_test.yaml").changed("world_simulator", world).changed("ads_test", exam)
    return chosen.changed("perception", {"reach": 8.0, **ERRORS})


def test_the_exams_ads_receives_objects_and_never_the_truth_and_its_class_drives_the_same(tmp_path: Path) -> None:
    """Of the example, which prints what it receives, where perception lists nobody beyond 8 m."""
    script = tmp_path / "listening.py"
    script.write_text(LISTENING)
    command = f"{sys.executable} {script} --ros-args -p objects:=true -p objects_latency:={ERRORS['latency']}"
    with own_domain():
        run_with(prepare(sections(), command), "walker", tmp_path)
    by_node = read_result(tmp_path, "walker")
    assert by_node.conduct == Conduct(wanted=2)
    assert by_node.unanswered == {}
    said = (tmp_path / "logs" / "ads_walker-1.log").read_text().splitlines()
    assert "TRUTH" not in said
    assert said.count("objects") > 50
    topics = Bag(tmp_path / "runs" / "walker" / "1" / "bag").topics()
    again = topics["/perception/objects"].messages - topics["/world/state"].messages
    assert 0 <= again < 25, "the first list may be published again, until the driving system has answered"
    assert topics["/pedestrian/odometry"].messages == 0

    exam = prepare(sections(), ads_class="vpsci_ros.nodes.example_driver:ExampleDriver")
    with class_in_process():
        run_with(exam, "walker", tmp_path / "class")
    by_class = read_result(tmp_path / "class", "walker")
    assert len(by_class.episodes) == 2
    tables = [episode_table(each, [], driver="ads", pedestrian="walker") for each in (by_node, by_class)]
    assert tables[0].equals(tables[1])
