"""What the tests of several rooms use."""

from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from vpsci_ros.world.state import EPISODE, RUNNING

SimulatedTick = tuple[NDArray[np.void], NDArray[np.float64], NDArray[np.float64]]


@pytest.fixture(scope="session")
def simulate() -> Callable[..., Iterator[SimulatedTick]]:
    """Make ticks of episodes 0, 1, ... of scenario 1 in `batch` slots: (state, curvttc, distance), all ends included.

    Every car drives at 5 m/s along its heading of 0.5 rad, every pedestrian walks at 1.5 m/s; episode k takes
    `lengths[k]` frames, and has the outcome `outcomes[k]`.
    """

    def ticks(lengths: list[int], outcomes: list[int], batch: int) -> Iterator[SimulatedTick]:
        state = np.zeros(batch, EPISODE)
        queue = list(range(len(lengths)))
        while True:
            for slot in range(batch):
                record = state[slot]
                ended = record["status"] != 0 and record["frame"] + 1 == lengths[record["episode"]]
                if ended or record["status"] == 0:
                    record["status"] = 0
                    if queue:
                        record["episode"], record["frame"], record["outcome"] = queue.pop(0), 0, 0
                        record["scenario"], record["status"] = 1, RUNNING
                else:
                    record["frame"] += 1
                if record["status"] and record["frame"] + 1 == lengths[record["episode"]]:
                    record["status"], record["outcome"] = 2, outcomes[record["episode"]]
            if not state["status"].any():
                return
            time = 0.05 * state["frame"]
            state["vehicle_heading"], state["vehicle_speed"] = 0.5, 5.0
            state["vehicle_x"], state["vehicle_y"] = 5.0 * np.cos(0.5) * time, 5.0 * np.sin(0.5) * time
            state["pedestrian_x"], state["pedestrian_vx"] = 10.0 + state["episode"], 0.0
            state["pedestrian_y"], state["pedestrian_vy"] = -4.0 + 1.5 * time, 1.5
            curvttc = np.where(time > 1.0, 4.0 + 0.01 * state["episode"], np.inf)
            distance = np.hypot(state["vehicle_x"] - state["pedestrian_x"], state["vehicle_y"] - state["pedestrian_y"])
            yield state.copy(), curvttc, distance

    return ticks


@pytest.fixture(scope="session")
def own_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of the episodes 1:0, 6:4 and 1:2, one after the other, by the rule-based pair; not to be changed."""
    from vpsci_ros.data.bag_run import node_record
    from vpsci_ros.generate.bag import write_ticks
    from vpsci_ros.learning.rollout import rollout
    from vpsci_ros.world import World, WorldConfig, load_scenarios
    from vpsci_ros.world.monitor import MonitorConfig

    config = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot")
    queue = [(1, 0), (6, 4), (1, 2)]
    world = World(config, load_scenarios([1, 6]), queue, 1, 3)
    run = {"seed": 3, "scenarios": [1, 6], "batch": 1, "queue": queue}
    nodes = [node_record("world_simulator", asdict(config) | run), node_record("safety_monitor", {})]
    bag = tmp_path_factory.mktemp("own") / "bag"
    write_ticks(rollout(world, MonitorConfig(), {}), config, bag, {}, nodes)
    return bag
