"""Pedestrians with given motion in the episodes of a run: recordings, or absent pedestrians.

A recorded person is put where its path crosses the lane of the vehicle: turned (and mirrored, where it came from the
other side of the vehicle) into the walking direction of the scenario, and in time so that it is there when the
episode's own pedestrian would be. From there on it does what it did in the recording, stops included, whatever the
vehicle does: it reacted to another car. Before the recording begins it walks at the first recorded velocity, after the
end at the last one. People whose path, continued so, does not cross that of the recorded vehicle are left out: those
who stood, walked alongside, or had stopped for the car when their recording ends.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.bags.simulated import write_ticks
from vpsci_ros.data.corpus import around_critical
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety.encroachment import first_crossing
from vpsci_ros.world import RUNNING, Scenario, World, WorldConfig, handover
from vpsci_ros.world.observation import STEP
from vpsci_ros.world.state import NO_EVENTS
from vpsci_ros.world.tick import NO_ACTIONS, Step, Tick

Floats = NDArray[np.float64]
Motion = dict[tuple[int, int], Floats]
"""(scenario, episode) -> float64[T, 4]: x, y [m], vx, vy [m/s] of the pedestrian at each tick."""

AHEAD = 15.0  # [m] for which the recorded vehicle's path is carried on straight, as in `vpsci_ros.safety.yielding`
ON_TIME = 5.0  # [s] for which its pedestrian's path is
FAR = 1000.0  # [m] away, where a pedestrian does not matter
_SLOWEST = 0.3  # [m/s] while crossing


def spawns(
    config: WorldConfig, scenarios: Sequence[Scenario], episodes: Sequence[tuple[int, int]], seed: int
) -> NDArray[np.void]:
    """Return the states at the spawns of these episodes, EPISODE[n]."""
    drivers = dataclasses.replace(config, vehicle_driver="autopilot", pedestrian_driver="autopilot")
    return World(drivers, scenarios, episodes, len(episodes), seed).state.copy()


def absent_pedestrians(begins: NDArray[np.void]) -> Motion:
    """Return the motion of pedestrians a kilometre from the vehicle, for episodes with these spawns, EPISODE[n].

    One frame each: beyond its recording a replayed pedestrian keeps its velocity.
    """
    return {
        (int(b["scenario"]), int(b["episode"])): np.array([[b["vehicle_x"] + FAR, b["vehicle_y"], 0.0, 0.0]])
        for b in begins
    }


def recorded_people(
    near_misses: pl.DataFrame,
    begins: NDArray[np.void],
    scenarios: Sequence[Scenario],
    config: WorldConfig,
    seed: int,
    where: str = "near misses",
    head_starts: Mapping[tuple[int, int], tuple[float, float]] = MappingProxyType({}),
) -> Motion:
    """Return the motion of recorded pedestrians in episodes with these spawns, EPISODE[n].

    The number of an episode and its scenario's place decide who comes, so that an episode has the same person whatever
    others are driven, and consecutive episodes have each person once before any twice.

    :param near_misses: a near-miss table, see `vpsci_ros.data.near_misses`.
    :param where: what it comes from, the opening of the error message.
    :param head_starts: (scenario, episode) -> times [s] by which together its person is earlier.
    :raises InvalidInput: not one of its pedestrians crosses the path of its vehicle.
    """
    parts = around_critical(near_misses).partition_by("interaction", maintain_order=True)
    people = [p for part in parts if (p := _crossing(part))]
    if not people:
        raise InvalidInput(f"{where}: no pedestrian crosses the path of its vehicle; give other recordings")
    order = np.random.default_rng(seed).permutation(len(people))
    numbers = [scenario.number for scenario in scenarios]
    motion: Motion = {}
    for begin in begins:
        key = int(begin["scenario"]), int(begin["episode"])
        place = numbers.index(key[0])
        person = people[order[(key[1] * len(numbers) + place) % len(people)]]
        motion[key] = person.put(begin, scenarios[place], config, sum(head_starts.get(key, (0.0,))))
    return motion


class _Person:
    """A recorded pedestrian: its motion from where its path crosses the vehicle's, walking along x there.

    :param motion: float64[T, 4] x, y, vx, vy at steps of 0.1 s.
    :param crossing: step (fractional) at which it is at the origin.
    :param from_left: whether the vehicle comes from the pedestrian's left.
    """

    def __init__(self, motion: Floats, crossing: float, from_left: bool) -> None:
        self._motion, self._crossing, self._from_left = motion, crossing, from_left

    def put(self, begin: np.void, scenario: Scenario, config: WorldConfig, head_start: float) -> Floats:
        """Return its motion in an episode of `scenario`, float64[ticks, 4]; `head_start` [s]: how much earlier."""
        walk, lane = scenario.pedestrian, scenario.vehicle.path
        way = float(begin["walking_speed"])
        arrival = float(begin["start_delay"]) + (walk.conflict - float(begin["pedestrian_s"])) / way - head_start
        x, y = walk.path.beside(walk.conflict, float(begin["pedestrian_offset"]))
        heading = walk.path.heading(walk.conflict)
        turn = lane.heading(lane.locate(x, y)[0]) - heading
        mirror = 1.0 if (math.sin(turn) < 0.0) == self._from_left else -1.0
        step: Floats = (
            np.arange(config.episode_ticks + 1, dtype=np.float64) * config.tick - arrival
        ) / STEP + self._crossing
        local = self._at(step) * [1.0, mirror, 1.0, mirror]
        cos, sin = math.cos(heading), math.sin(heading)
        turned = np.array([[cos, sin], [-sin, cos]])
        return np.hstack([local[:, :2] @ turned + [x, y], local[:, 2:] @ turned])

    def _at(self, step: Floats) -> Floats:
        """Return the motion at fractional steps, carried on straight before the first and after the last."""
        last = len(self._motion) - 1
        inside = np.clip(step, 0.0, last)
        known = np.arange(last + 1)
        out = np.stack([np.interp(inside, known, column) for column in self._motion.T], axis=1)
        out[:, :2] += out[:, 2:] * ((step - inside) * STEP)[:, None]
        return out


def _crossing(part: pl.DataFrame) -> _Person | None:
    """Return the pedestrian of one interaction, or None where its path does not cross its vehicle's."""
    names = ("veh_x", "veh_y", "veh_heading", "ped_x", "ped_y", "ped_vx", "ped_vy")
    x, y, heading, px, py, vx, vy = (part[name].to_numpy() for name in names)
    if len(x) < 2:
        return None
    straight = px[-1] + vx[-1] * ON_TIME, py[-1] + vy[-1] * ON_TIME
    _, walked, cx, cy = first_crossing(x, y, AHEAD, heading[-1], np.append(px, straight[0]), np.append(py, straight[1]))
    if math.isnan(walked):
        return None
    at, last = int(walked), len(px) - 1
    if at == last:
        way_x, way_y, walked = vx[-1], vy[-1], last + (walked - last) * ON_TIME / STEP
    else:
        way_x, way_y = (px[at + 1] - px[at]) / STEP, (py[at + 1] - py[at]) / STEP
    if math.hypot(way_x, way_y) < _SLOWEST:
        return None
    way = math.atan2(way_y, way_x)
    nearest = int(np.argmin(np.hypot(x - cx, y - cy)))
    cos, sin = math.cos(way), math.sin(way)
    turned = np.array([[cos, -sin], [sin, cos]])
    motion = np.hstack([np.stack([px - cx, py - cy], axis=1) @ turned, np.stack([vx, vy], axis=1) @ turned])
    return _Person(motion, walked, math.sin(heading[nearest] - way) < 0.0)


def write_motion(
    motion: Mapping[tuple[int, int], Floats], begins: NDArray[np.void], config: WorldConfig, bag: Path
) -> None:
    """Write pedestrians' motion as a bag for the replay driver; the vehicle stands where its episode begins.

    :raises InvalidInput: `bag` is not empty.
    """
    write_ticks(_ticks(motion, begins, config), config, bag, {"made_by": "vpsci ads-test"})


def _ticks(motion: Mapping[tuple[int, int], Floats], begins: NDArray[np.void], config: WorldConfig) -> Iterator[Step]:
    number = 0
    nowhere = np.array([np.inf])
    for begin in begins:
        for frame, row in enumerate(motion[int(begin["scenario"]), int(begin["episode"])]):
            state = np.array([begin])
            state["frame"], state["status"] = frame, RUNNING
            state["vehicle_speed"] = 0.0
            for name, value in zip(
                ("pedestrian_x", "pedestrian_y", "pedestrian_vx", "pedestrian_vy"), row, strict=True
            ):
                state[name] = value
            tick = Tick(number=number, state=state, policy_frame=handover.policy_frame(state, config))
            yield Step(tick, tick.assessed(nowhere, nowhere, [False]), NO_ACTIONS, NO_EVENTS)
            number += 1
