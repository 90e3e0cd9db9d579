"""Ticks from odometry of a car and a pedestrian, recorded by any ROS 2 tool.

Each message of the car is paired with the pedestrian's message of the nearest header stamp, and left out if that is
more than `APART` away. Where an episode began and how it ended is not recorded: one is taken to begin where the stamps
have a gap or either agent jumps, and its outcome is unknown. CurvTTC is computed again, with the sizes that the safety
monitor has by default.
"""

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.reader import Bag, BagTick
from vpsci_ros.data.episode import NO_SCENARIO
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.decoder import decode
from vpsci_ros.wire.layout import TYPES, motion
from vpsci_ros.world.monitor import assess
from vpsci_ros.world.state import ENDED, EPISODE, RUNNING

ODOMETRY = ("/vehicle/odometry", "/pedestrian/odometry")
GAP = 0.5  # [s] without a message
JUMP = 2.0  # [m] further than the speed explains
APART = 0.1  # [s] between two messages that are taken together
SLOW = 0.1  # [m/s] below which a yaw rate says nothing of a path's curvature
Floats = NDArray[np.float64]


def odometry_ticks(bag: Bag) -> Iterator[BagTick]:
    """Yield the ticks of a bag with odometry of both agents; none if the odometry of either is missing.

    :raises InvalidInput: another type on these topics, or a message that cannot be read.
    """
    tracks = _tracks(bag)
    if any(len(track) == 0 for track in tracks):
        return
    vehicle, pedestrian = _paired(*tracks)
    if len(vehicle) == 0:
        return
    begins = np.flatnonzero(_breaks(vehicle) | _breaks(pedestrian)) + 1
    bounds = [0, *begins.tolist(), len(vehicle)]
    steps = np.diff(vehicle[:, 0])
    period = float(np.median(steps[steps <= GAP])) if (steps <= GAP).any() else 0.0
    tick = 0
    for number, (first, after) in enumerate(itertools.pairwise(bounds)):
        vehicle[first:after, 3] = np.unwrap(vehicle[first:after, 3])
        for row in range(first, after):
            state = _state(vehicle[row], pedestrian[row])
            state["episode"], state["frame"] = number, row - first
            state["status"] = ENDED if row == after - 1 else RUNNING
            curvttc, distance, _ = assess(state)
            time = bag.begin + int(vehicle[row, 6])
            yield BagTick(number=tick, period=period, state=state, curvttc=curvttc, distance=distance, time=time)
            tick += 1


def _tracks(bag: Bag) -> list[Floats]:
    """Return each agent's float64[n, 7]: stamp [s], x, y [m], course [rad], speed [m/s], yaw rate [rad/s], log time.

    Log times are [ns] since `Bag.begin`: float64 does not hold those since 1970 to the nanosecond.
    """
    rows: dict[str, list[tuple[float, ...]]] = {topic: [] for topic in ODOMETRY}
    for raw in bag.messages(ODOMETRY):
        if raw.type != TYPES[raw.topic]:
            raise InvalidInput(f"{bag.path}: expected {TYPES[raw.topic]} on {raw.topic}, got {raw.type}")
        message = decode(raw, bag.path)
        stamp = message.header.stamp
        moved = motion(message, raw.topic.split("/")[1])
        rows[raw.topic].append((stamp.sec + 1e-9 * stamp.nanosec, *moved, float(raw.time - bag.begin)))
    tracks = [np.array(sorted(rows[topic]), np.float64).reshape(-1, 7) for topic in ODOMETRY]
    return [track[np.isfinite(track).all(axis=1)] for track in tracks]


def _paired(vehicle: Floats, pedestrian: Floats) -> tuple[Floats, Floats]:
    """Return the vehicle's rows with a pedestrian's row within `APART`, and the nearest pedestrian's row of each."""
    after = np.clip(np.searchsorted(pedestrian[:, 0], vehicle[:, 0]), 1, max(len(pedestrian) - 1, 1))
    before, after = after - 1, np.minimum(after, len(pedestrian) - 1)
    earlier = np.abs(pedestrian[before, 0] - vehicle[:, 0]) <= np.abs(pedestrian[after, 0] - vehicle[:, 0])
    nearest = np.where(earlier, before, after)
    together = np.abs(pedestrian[nearest, 0] - vehicle[:, 0]) <= APART
    return vehicle[together], pedestrian[nearest[together]]


def _breaks(track: Floats) -> NDArray[np.bool_]:
    step = np.diff(track[:, 0])
    explained = np.maximum(track[:-1, 4], track[1:, 4]) * step
    moved: Floats = np.hypot(*np.diff(track[:, 1:3], axis=0).T)
    return (step > GAP) | (moved > explained + JUMP)


def _state(vehicle: Floats, pedestrian: Floats) -> NDArray[np.void]:
    """Return EPISODE[1] of one row of each track."""
    state = np.zeros(1, EPISODE)
    _, state["vehicle_x"], state["vehicle_y"], state["vehicle_heading"], speed, yaw_rate, _ = vehicle
    state["vehicle_speed"] = speed
    state["vehicle_curvature"] = yaw_rate / speed if speed > SLOW else 0.0
    _, state["pedestrian_x"], state["pedestrian_y"], course, walking, *_ = pedestrian
    state["pedestrian_vx"], state["pedestrian_vy"] = walking * np.cos(course), walking * np.sin(course)
    state["scenario"] = NO_SCENARIO
    return state
