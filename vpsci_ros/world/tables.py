"""Scenarios as arrays for compiled code, with padded paths: one row each, and one for the opposite route.

Row s + S is scenario s of S with the walking route reversed; its goal is where pedestrians of row s wait.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.calibration import TURNING_DECELERATION, mirrored, right_turns
from vpsci_ros.world.crowd import Crowd
from vpsci_ros.world.drivers import PEDESTRIAN_DRIVERS, VEHICLE_DRIVERS
from vpsci_ros.world.lane_driving import comfortable_speeds
from vpsci_ros.world.paths import Path
from vpsci_ros.world.scenario import Scenario
from vpsci_ros.world.spawns import PAPERS_RELEASE, PAPERS_TIME, SPAWNS, TABLE
from vpsci_ros.world.world_config import WorldConfig

_QUANTITIES = (
    "lane_step",  # [m] between samples of the lane
    "vehicle_goal",  # [m] along the lane
    "full_throttle_speed",  # [m/s] that throttle 1 stands for
    "walk_step",  # [m] between samples of the walking route
    "pedestrian_goal",  # [m] along the route
    "conflict",  # [m] along the route, where it crosses the lane
    "standing_room",  # [m] at the start of the route, over which waiting pedestrians are spread
    "waiting",  # share of walkers who stand first (human spawn)
    # what a spawn is drawn from
    "lowest_s", "highest_s",  # [m] along the lane
    "lowest_throttle", "highest_throttle",  # 0 to 1
    "lowest_initial", "highest_initial",  # share of the speed that the throttle stands for
    "lowest_speed", "highest_speed",  # [m/s] of the walker
    "lowest_arrival", "highest_arrival",  # [s] until the walker is at the lane
    "lowest_offset", "highest_offset",  # [m] to the left of the route
)  # fmt: skip
_FAR = (1e9, 1e9, 0.0, 0.0, 0.0)  # a parked vehicle that nothing meets
# [m] from where the walking route crosses the lane to the vehicle's goal in the paper's scenes: its rear is 2.7 m past
# the walkers' line. Chosen with the spawns of params/scenarios so that paths are as long as in Table 10.
PAPERS_GOAL = 5.0
SCENARIO = np.dtype(
    [(name, "f8") for name in _QUANTITIES] + [("lane_count", "i8"), ("walk_count", "i8"), ("number", "u1")], align=True
)


class Tables(NamedTuple):
    """S scenarios as arrays for compiled code: R = 2 S rows, the second half with the walking routes reversed."""

    rows: NDArray[np.void]  # SCENARIO[R]
    lane: NDArray[np.float64]  # [R, N, 2] centrelines [m]
    lane_speed: NDArray[np.float64]  # [R, N] comfortable speeds along them [m/s]
    turning_speed: NDArray[np.float64]  # [R, N] speeds along them [m/s] of a driver who accepts 1 m/s2 sideways
    walk: NDArray[np.float64]  # [R, M, 2] walking routes [m]
    onsets: NDArray[np.float64]  # [2 N, 50] `calibration.right_turns`, and the same mirrored
    parked: NDArray[np.float64]  # [R, K, 5] parked vehicles, as `Scenario.parked`; padding far away


class Settings(NamedTuple):
    """`WorldConfig` for compiled code."""

    period: float  # [s] of a tick
    policy_ticks: int  # from one action of the policies to the next
    episode_ticks: int  # of the longest episode
    release_ticks: int  # without danger, after which control is given back
    papers_ticks: int  # `episode_ticks` by the rules of section 3.2, for the half of a mixed world
    papers_release_ticks: int  # `release_ticks` by these
    vehicle_driver: int  # of VEHICLE_DRIVERS
    pedestrian_driver: int  # of PEDESTRIAN_DRIVERS
    pedestrian_gain: float  # share of the pedestrian's acceleration that becomes motion, (21)-(24)
    walk_on: bool  # beyond its goal the pedestrian walks on
    proximity_distance: float  # [m] below which the autopilot brakes
    lane_following: bool  # the vehicle's lateral action is added to what keeps the lane
    spawn: int  # of SPAWNS
    pedestrians: int  # rows of an episode


class Inputs(NamedTuple):
    """The answers to a tick for compiled code; an array of length 0 stands for a missing one."""

    curvttc: NDArray[np.float64]  # [B] [s]
    critical: NDArray[np.uint8]  # [B]
    policy_frame: NDArray[np.uint8]  # [B] 1: the policies choose actions at this tick
    acts: NDArray[np.uint8]  # [B] 1: the policies act
    vehicle_action: NDArray[np.float64]  # [B, 2] (longitudinal, lateral) [m/s2]
    pedestrian_action: NDArray[np.float64]  # [B, 2] likewise
    vehicle_control: NDArray[np.float64]  # [B, 3] (steer, throttle, brake)


class Recordings(NamedTuple):
    """Recorded motion of N episodes, for the replay drivers."""

    vehicle: NDArray[np.float64]  # [N, T, 5] (x, y, heading, speed, curvature) [m, rad, m/s, 1/m]
    pedestrian: NDArray[np.float64]  # [N, T, 4] (x, y, vx, vy) [m, m/s]
    frames: NDArray[np.int64]  # [N] how many of the T frames there are


def settings_from(config: WorldConfig) -> Settings:
    """Return a `WorldConfig` as `Settings`, for compiled code."""
    return Settings(
        period=config.tick,
        policy_ticks=config.policy_ticks,
        episode_ticks=config.episode_ticks,
        release_ticks=config.release_ticks,
        papers_ticks=round(PAPERS_TIME / config.tick),
        papers_release_ticks=round(PAPERS_RELEASE / config.tick),
        vehicle_driver=VEHICLE_DRIVERS[config.vehicle_driver],
        pedestrian_driver=PEDESTRIAN_DRIVERS[config.pedestrian_driver],
        pedestrian_gain=config.pedestrian_gain,
        walk_on=config.walk_on,
        proximity_distance=config.proximity_distance,
        lane_following=config.lane_following,
        spawn=SPAWNS[config.spawn],
        pedestrians=config.pedestrians,
    )


def crowd_from(config: WorldConfig) -> Crowd:
    """Return a configuration's crowd and kinds as `Crowd`, for compiled code."""
    return Crowd(
        sizes=config.crowd.size_limits(config.pedestrians),
        roles=config.crowd.role_limits(),
        kinds=config.kinds.limits(),
    )


def tables_from(scenarios: Sequence[Scenario], spawn: str = "right_turns") -> Tables:
    """Return S > 0 scenarios as tables, followed by the same ones with the walking route the other way round.

    :param spawn: `WorldConfig.spawn`; with `mixed` the vehicle's goal is that of `paper`.
    """
    near = spawn == "mixed" or TABLE[SPAWNS[spawn]].near_goal
    rows = np.zeros(len(scenarios), SCENARIO)
    for row, scenario in zip(rows, scenarios, strict=True):
        vehicle, pedestrian = scenario.vehicle, scenario.pedestrian
        row["number"] = scenario.number
        row["lane_step"], row["lane_count"] = vehicle.path.step, len(vehicle.path.points)
        row["walk_step"], row["walk_count"] = pedestrian.path.step, len(pedestrian.path.points)
        crossing, _ = vehicle.path.locate(*pedestrian.path.at(pedestrian.conflict))
        row["vehicle_goal"] = min(vehicle.goal, crossing + PAPERS_GOAL) if near else vehicle.goal
        row["full_throttle_speed"] = vehicle.full_throttle_speed
        row["pedestrian_goal"], row["conflict"] = pedestrian.goal, pedestrian.conflict
        row["standing_room"], row["waiting"] = pedestrian.standing_room, pedestrian.waiting
        for name, interval in (
            ("s", vehicle.spawn),
            ("throttle", vehicle.throttle),
            ("initial", vehicle.initial_speed),
            ("speed", pedestrian.speed),
            ("arrival", pedestrian.arrival),
            ("offset", pedestrian.offset),
        ):
            row[f"lowest_{name}"], row[f"highest_{name}"] = interval
    lanes = [scenario.vehicle.path for scenario in scenarios] * 2
    walks = [scenario.pedestrian.path for scenario in scenarios]
    return Tables(
        rows=np.concatenate([rows, _walked_back(rows)]),
        lane=_padded(lanes),
        lane_speed=_stacked([comfortable_speeds(lane) for lane in lanes]),
        turning_speed=_stacked([comfortable_speeds(lane, 1.0, TURNING_DECELERATION) for lane in lanes]),
        walk=_padded([*walks, *(replace(walk, points=walk.points[::-1]) for walk in walks)]),
        onsets=np.concatenate([right_turns(), mirrored(right_turns())]),
        parked=_parked(scenarios),
    )


def _parked(scenarios: Sequence[Scenario]) -> NDArray[np.float64]:
    most = max(len(scenario.parked) for scenario in scenarios)
    boxes = np.full((len(scenarios), most, 5), _FAR)
    for row, scenario in zip(boxes, scenarios, strict=True):
        row[: len(scenario.parked)] = scenario.parked
    return np.concatenate([boxes, boxes])


def _walked_back(rows: NDArray[np.void]) -> NDArray[np.void]:
    """Return the same scenarios walked the other way, SCENARIO[S]."""
    back = rows.copy()
    length = rows["walk_step"] * (rows["walk_count"] - 1)
    back["conflict"] = length - rows["conflict"]
    back["pedestrian_goal"] = length - rows["standing_room"]
    back["standing_room"] = np.minimum(rows["standing_room"], back["conflict"])
    return back


def _padded(paths: list[Path]) -> NDArray[np.float64]:
    return _stacked([path.points for path in paths])


def _stacked(arrays: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    out = np.zeros((len(arrays), max(map(len, arrays)), *arrays[0].shape[1:]))
    for row, array in zip(out, arrays, strict=True):
        row[: len(array)] = array
    return out
