"""What existing tools show of one episode, serialized: odometry, transforms, and markers for RViz and Foxglove.

The messages are those of `convert` and `markers`, each made once for an example and then filled (`template`).
"""

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from std_msgs.msg import Header

from vpsci_ros.nodes import convert
from vpsci_ros.nodes.markers import scene_markers
from vpsci_ros.nodes.template import MARK, Template
from vpsci_ros.wire.layout import MAP, PlanarMotion
from vpsci_ros.world import IDLE, RUNNING, Scenario
from vpsci_ros.world.state import EPISODE

_MOVING = ("vehicle_x", "vehicle_y", "vehicle_heading", "pedestrian_x", "pedestrian_y")
_HEADER = Header(stamp=MARK, frame_id=MAP)


def odometry(frame: str, motion: PlanarMotion, stamp: Time) -> bytes:
    """Return a serialized Odometry of who has this frame, such as "vehicle"."""
    return _odometry(frame).filled(stamp, _numbers(motion))


def transforms(motions: Mapping[str, PlanarMotion], stamp: Time) -> bytes:
    """Return a serialized TFMessage of the poses of all who move, by frame."""
    poses = [number for motion in motions.values() for number in _numbers(motion)[:4]]
    return _transforms(tuple(motions)).filled(stamp, poses)


class Scene:
    """The markers of one episode and the ground under it.

    :param scenarios: by number, all that may come.
    """

    def __init__(self, scenarios: Mapping[int, Scenario]) -> None:
        self._scenarios = scenarios
        self._templates: dict[tuple[int, bytes], Template] = {}

    def markers(self, state: NDArray[np.void], stamp: Time) -> bytes:
        """Return a serialized MarkerArray of EPISODE[B], the pedestrians of one episode."""
        key = int(state["scenario"][0]), (state["status"] == IDLE).tobytes()
        if key not in self._templates:
            example = np.zeros(len(state), EPISODE)
            example["scenario"], example["status"] = key[0], np.where(state["status"] == IDLE, IDLE, RUNNING)
            for k, name in enumerate(_MOVING):
                example[name] = 0.7182818284590452 + 0.1 * k + np.arange(len(state)) / 3.0
            message = scene_markers(example, self._scenarios, _HEADER)
            self._templates[key] = Template("visualization_msgs/msg/MarkerArray", message, _scene_numbers(example))
        return self._templates[key].filled(stamp, _scene_numbers(state))


@cache
def _odometry(frame: str) -> Template:
    motion = _example(0)
    return Template("nav_msgs/msg/Odometry", convert.odometry(motion, frame, _HEADER), _numbers(motion))


@cache
def _transforms(frames: tuple[str, ...]) -> Template:
    motions = [_example(k) for k in range(len(frames))]
    message = convert.transforms(convert.odometry(*each, _HEADER) for each in zip(motions, frames, strict=True))
    return Template("tf2_msgs/msg/TFMessage", message, [number for each in motions for number in _numbers(each)[:4]])


def _example(k: int) -> PlanarMotion:
    """Return a motion whose numbers are like no other's."""
    return PlanarMotion(*(0.5772156649015329 + 0.1 * field + k / 3.0 for field in range(5)))


def _numbers(motion: PlanarMotion) -> tuple[float, ...]:
    return motion.x, motion.y, *motion.quaternion, motion.speed, motion.yaw_rate


def _scene_numbers(state: NDArray[np.void]) -> Sequence[float]:
    """Return what changes in the markers of EPISODE[B]: the vehicle's pose, the pedestrians' places."""
    record = state[0]
    if record["status"] == IDLE:
        return []
    turned = convert.yaw_quaternion(float(record["vehicle_heading"]))
    vehicle = [float(record["vehicle_x"]), float(record["vehicle_y"]), turned.z, turned.w]
    return vehicle + [float(row[name]) for row in state for name in _MOVING[3:]]
