"""What existing tools show of one episode, serialized: odometry, transforms, and markers for RViz and Foxglove.

The messages are those of `convert` and `markers`, each made once for an example and then filled (`template`), of any
number of ticks at once: a recorder in the same process has them made when it writes them.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Header

from vpsci_ros.nodes import convert
from vpsci_ros.nodes.markers import scene_markers
from vpsci_ros.nodes.template import MARK, Template
from vpsci_ros.wire.layout import MAP, PlanarMotion
from vpsci_ros.wire.world_state import SerializedState
from vpsci_ros.world import IDLE, RUNNING, Scenario
from vpsci_ros.world.state import EPISODE

_MOVING = ("vehicle_x", "vehicle_y", "vehicle_heading", "pedestrian_x", "pedestrian_y")
_HEADER = Header(stamp=MARK, frame_id=MAP)
Ticks = Sequence[SerializedState]


class Views:
    """The motion of one episode at a time, the ground under it, and its markers.

    Who moves is numbered: 0 is the vehicle, from 1 on the pedestrians.

    :param scenarios: by number, all that may come.
    """

    def __init__(self, scenarios: Mapping[int, Scenario]) -> None:
        self._scenarios = scenarios
        self._templates: dict[tuple[int, list[bool]], Template] = {}
        self._latest: tuple[SerializedState | None, list[Any]] = None, []

    def odometry(self, mover: int, frame: str, ticks: Ticks) -> list[bytes]:
        """Return the serialized Odometry of one mover, who has this frame, such as "vehicle", at each tick."""
        fill = _odometry(frame).filled
        return [fill(tick.header, numbers[mover]) for tick, numbers in zip(ticks, self._numbers(ticks), strict=True)]

    def transforms(self, frames: Mapping[str, int], several: Mapping[str, int], ticks: Ticks) -> list[bytes]:
        """Return the serialized TFMessage of the poses of movers, by frame, at each tick.

        :param several: of these, those who are there.
        """
        found = []
        for (header, tick, _), numbers in zip(ticks, self._numbers(ticks), strict=True):
            here = {frame: k for frame, k in several.items() if tick.state["status"][k - 1] != IDLE}
            movers = {**frames, **here} if several else frames
            poses = [number for mover in movers.values() for number in numbers[mover][:4]]
            found.append(_transforms(tuple(movers)).filled(header, poses))
        return found

    def markers(self, ticks: Ticks) -> list[bytes]:
        """Return the serialized MarkerArray of each tick."""
        found = []
        for (header, tick, _), numbers in zip(ticks, self._numbers(ticks), strict=True):
            idle = tick.state["status"] == IDLE
            key = int(tick.state["scenario"][0]), idle.tobytes()
            if key not in self._templates:
                self._templates[key] = self._scene(key[0], idle)
            changing = [*numbers[0][:4], *(number for each in numbers[1:] for number in each[:2])]
            found.append(self._templates[key].filled(header, [] if idle[0] else changing))
        return found

    def _scene(self, scenario: int, idle: NDArray[np.bool_]) -> Template:
        example = np.zeros(len(idle), EPISODE)
        example["scenario"], example["status"] = scenario, np.where(idle, IDLE, RUNNING)
        for k, name in enumerate(_MOVING):
            example[name] = 0.7182818284590452 + 0.1 * k + np.arange(len(idle)) / 3.0
        message = scene_markers(example, self._scenarios, _HEADER)
        vehicle, *people = motions(example[np.newaxis])[0].tolist()
        numbers = [] if idle[0] else [*vehicle[:4], *(number for each in people for number in each[:2])]
        return Template("visualization_msgs/msg/MarkerArray", message, numbers)

    def _numbers(self, ticks: Ticks) -> list[Any]:
        """Return the `motions` of each tick; of a single tick they are kept for the next view."""
        latest = self._latest
        if len(ticks) == 1 and latest[0] is ticks[0]:
            return latest[1]
        data = b"".join(tick.tick.state.tobytes() for tick in ticks)  # numpy takes 20 us to join one more record
        states = np.frombuffer(data, EPISODE).reshape(len(ticks), -1)
        found: list[Any] = motions(states).tolist()
        self._latest = ticks[-1], found[-1:]
        return found


def motions(states: NDArray[np.void]) -> NDArray[np.float64]:
    """Return what odometry has of the movers of EPISODE[n, B], the ticks of an episode, float64[n, 1 + B, 6].

    A mover's numbers are x, y [m], z and w of its rotation, speed [m/s] and yaw rate [rad/s], the same as of
    `vpsci_ros.wire.layout.motion_of`.
    """
    found = np.zeros((len(states), 1 + states.shape[1], 6))
    yaw = np.empty(found.shape[:2])
    vehicle, first, people = found[:, 0], states[:, 0], found[:, 1:]
    vehicle[:, 0], vehicle[:, 1], vehicle[:, 4] = first["vehicle_x"], first["vehicle_y"], first["vehicle_speed"]
    vehicle[:, 5] = first["vehicle_speed"] * first["vehicle_curvature"]
    people[..., 0], people[..., 1] = states["pedestrian_x"], states["pedestrian_y"]
    people[..., 4] = np.hypot(states["pedestrian_vx"], states["pedestrian_vy"])
    yaw[:, 0], yaw[:, 1:] = first["vehicle_heading"], np.arctan2(states["pedestrian_vy"], states["pedestrian_vx"])
    yaw /= 2
    found[..., 2], found[..., 3] = np.sin(yaw), np.cos(yaw)
    return found


@cache
def _odometry(frame: str) -> Template:
    motion = _example(0)
    return Template("nav_msgs/msg/Odometry", convert.odometry(motion, frame, _HEADER), _numbers(motion))


@cache
def _transforms(frames: tuple[str, ...]) -> Template:
    examples = [_example(k) for k in range(len(frames))]
    message = convert.transforms(convert.odometry(*each, _HEADER) for each in zip(examples, frames, strict=True))
    return Template("tf2_msgs/msg/TFMessage", message, [number for each in examples for number in _numbers(each)[:4]])


def _example(k: int) -> PlanarMotion:
    """Return a motion whose numbers are like no other's."""
    return PlanarMotion(*(0.5772156649015329 + 0.1 * field + k / 3.0 for field in range(5)))


def _numbers(motion: PlanarMotion) -> tuple[float, ...]:
    return motion.x, motion.y, *motion.quaternion, motion.speed, motion.yaw_rate
