"""The recorded motion in a bag, for the world's replay drivers."""

from pathlib import Path

import numpy as np

from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.world import IDLE, Recorded

_VEHICLE = ("vehicle_x", "vehicle_y", "vehicle_heading", "vehicle_speed", "vehicle_curvature")
_PEDESTRIAN = ("pedestrian_x", "pedestrian_y", "pedestrian_vx", "pedestrian_vy")


def recorded_from_bag(bag: str | Path) -> Recorded:
    """Return the motion of both agents in every episode of a bag, for the replay drivers of a `World`.

    Of several pedestrians it is the first one. The bag must have been recorded at the tick of the world that replays
    it. An episode that was cut off at the end of the bag is replayed as far as it goes; beyond its recording an agent
    goes on straight.

    :raises InvalidInput: no bag, a damaged one, or one without an episode.
    """
    frames: dict[tuple[int, int], list[tuple[list[float], list[float]]]] = {}
    for tick in read_bag(bag):
        for record in tick.state[(tick.state["status"] != IDLE) & (tick.state["pedestrian"] == 0)]:
            motion = [float(record[name]) for name in _VEHICLE], [float(record[name]) for name in _PEDESTRIAN]
            frames.setdefault((int(record["scenario"]), int(record["episode"])), []).append(motion)
    return Recorded(
        {key: (np.array([v for v, _ in rows]), np.array([p for _, p in rows])) for key, rows in frames.items()}
    )
