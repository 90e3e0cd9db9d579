"""A recorded vehicle drives again, bit for bit, against a live pedestrian; a bag opens with what a viewer needs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from composed import composed
from rosbags.highlevel import AnyReader

from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.domain import own_domain
from vpsci_ros.nodes.graph import resolve
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.world import RUNNING, World, WorldConfig, load_scenarios

NODES = ["world_simulator", "safety_monitor", "recorder"]


def sections(**world: Any) -> Sections:
    settings = {"scenarios": [2], "episodes": 2, "batch": 1, "seed": 9, "pedestrian_driver": "autopilot"} | world
    return Sections({"graph": {"nodes": NODES}, "world_simulator": settings})


def run(chosen: Sections, folder: Path) -> Path:
    """Run a graph in this process; return its bag."""
    with composed(resolve(chosen, folder)):
        return folder / "bag"


def motion(bag: Path, names: tuple[str, ...]) -> np.ndarray:
    """The recorded quantities of every running frame, [n, names]."""
    rows = [tick.state[tick.state["status"] == RUNNING] for tick in read_bag(bag)]
    return np.array([[row[name] for name in ("episode", "frame", *names)] for part in rows for row in part])


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bag of a graph in which the autopilot drove; not to be changed."""
    with own_domain():
        return run(sections(vehicle_driver="autopilot"), tmp_path_factory.mktemp("first"))


def counts(bag: Path) -> dict[str, int]:
    with AnyReader([bag]) as reader:
        return {connection.topic: connection.msgcount for connection in reader.connections}


def test_a_recorded_car_drives_against_the_live_pedestrian_policy(
    domain: int, tmp_path: Path, recorded: Path, weights: str
) -> None:
    again = sections(vehicle_driver="replay", pedestrian_driver="policy", recorded_bag=str(recorded))
    again = again.changed("graph", {"nodes": [*NODES, "pedestrian_policy"]})
    again = again.changed("pedestrian_policy", {"weights": weights})
    second = run(again, tmp_path)
    vehicle = ("vehicle_x", "vehicle_y", "vehicle_heading", "vehicle_speed", "vehicle_curvature")
    before, replayed = motion(recorded, vehicle), motion(second, vehicle)
    both = min((before[:, 0] == 0).sum(), (replayed[:, 0] == 0).sum())
    assert both > 50
    assert replayed[:both].tobytes() == before[:both].tobytes()
    assert counts(second)["/pedestrian/action"] > 20
    assert counts(second).get("/vehicle/action", 0) == 0
    assert any(tick.state["controlled"][0] for tick in read_bag(second))
    assert verify_bag(second).difference == ""


def test_a_replay_driver_without_a_recording_is_refused() -> None:
    with pytest.raises(InvalidInput, match="recorded_bag"):
        World(WorldConfig(vehicle_driver="replay"), load_scenarios([1]), [(1, 0)], 1, 1)
