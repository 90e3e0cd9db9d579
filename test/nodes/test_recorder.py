"""The recorder keeps the parameters of its peers, keeps the episodes, loses nothing, and splits by size."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from composed import composed
from nodes.stage import Stage, overrides
from rclpy.context import Context

from vpsci_msgs.msg import EpisodeEvent
from vpsci_ros.bags.info import bag_info
from vpsci_ros.bags.reader import Bag, bag_files
from vpsci_ros.bags.run_record import bag_run
from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.nodes import convert, recorder
from vpsci_ros.nodes.graph import resolve
from vpsci_ros.nodes.recorder import Recorder
from vpsci_ros.nodes.safety_monitor import SafetyMonitor
from vpsci_ros.nodes.topics import LOCK_STEP
from vpsci_ros.runs.run_config import Sections

NODES = ["world_simulator", "safety_monitor", "recorder"]


def test_a_graphs_bag_holds_parameters_episodes_and_counts_over_split_files_and_verifies(
    domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder, "SPLIT_SIZE", 20_000)
    drivers = {"vehicle_driver": "autopilot", "pedestrian_driver": "social_force"}
    world = {"scenarios": [2, 7], "episodes": 3, "batch": 2, "seed": 11} | drivers
    sections = {
        "graph": {"nodes": NODES},
        "world_simulator": world,
    }
    with composed(resolve(Sections(sections), tmp_path)):
        pass
    bag = tmp_path / "bag"
    assert len(bag_files(bag)) > 2
    info = bag_info(bag)
    parameters = info["run"]["parameters"]
    assert parameters["world_simulator"]["seed"] == 11
    assert parameters["world_simulator"]["scenarios"] == [2, 7]
    assert parameters["safety_monitor"]["peers"] == NODES
    assert info["messages_seen"] == info["messages_written"] == info["messages"]
    assert sorted(e["name"] for e in info["episodes"]) == ["2:0", "2:1", "2:2", "7:0", "7:1", "7:2"]
    assert {e["first_file"] for e in info["episodes"]} != {e["file"] for e in info["episodes"]}
    counts = {topic["name"]: topic["messages"] for topic in info["topics"]}
    assert counts["/clock"] == counts["/world/state"] == counts["/safety/state"]
    verified = verify_bag(bag)
    assert (verified.difference, verified.uncompared) == ("", ())
    assert (verified.ticks, verified.episodes) == (counts["/world/state"], 6)


@pytest.fixture
def monitor(context: Context, stage: Callable[..., Stage]) -> tuple[Stage, Any]:
    """A stage with a peer on it, and a publisher of events."""
    node = SafetyMonitor(context=context)
    return stage(node), node.create_publisher(EpisodeEvent, "episode/event", LOCK_STEP)


def event(tick: int, kind: int, outcome: int = 0) -> EpisodeEvent:
    message = EpisodeEvent(tick=tick, header=convert.Header(stamp=convert.stamp(tick, 0.05), frame_id="map"))
    message.kind, message.slot, message.scenario, message.episode = [kind], [0], [4], [17]
    message.frame, message.outcome, message.least_curvttc = [tick], [outcome], [1.5]
    message.vehicle_path = message.pedestrian_path = [9.0]
    return message


def test_a_recorder_alone_learns_who_is_there_and_records_what_comes(context: Context, monitor, tmp_path: Path) -> None:
    here, events = monitor
    recorder = here.add(Recorder(context=context, parameter_overrides=overrides(bag=str(tmp_path / "bag"))))
    here.spin_until(lambda: events.get_subscription_count() > 0)
    for message in (event(3, EpisodeEvent.STARTED), event(90, EpisodeEvent.ENDED, 2)):
        events.publish(message)
    here.spin_until(lambda: recorder.figures()["episodes"] == 1 and recorder.figures()["nodes_without_parameters"] == 5)
    recorder.close()
    run = bag_run(Bag(tmp_path / "bag"))
    assert run.parameters["safety_monitor"]["peers"] == []
    assert json.loads(run.totals["written"])["/episode/event"] == 2
    (episode,) = bag_info(tmp_path / "bag")["episodes"]
    assert (episode["name"], episode["outcome"], episode["least_curvttc"]) == ("4:17", "goal", 1.5)
    assert (episode["start"], episode["end"]) == (pytest.approx(0.15), pytest.approx(4.5))
