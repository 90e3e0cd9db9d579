"""What existing tools show of one episode, serialized: odometry, transforms, and markers for RViz and Foxglove.

The messages are those of `convert` and `markers`. Little of them changes from tick to tick, so each is serialized once,
of an example, and then only what changes is written: to make the markers of a tick as objects of Python and serialize
them takes 290 us, as long as all else that the world does at a tick.
"""

import struct
from collections.abc import Mapping, Sequence
from functools import cache
from operator import itemgetter
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

from vpsci_ros.nodes import convert
from vpsci_ros.nodes.markers import scene_markers
from vpsci_ros.wire.decoder import rewritten
from vpsci_ros.wire.header import WireHeader, whole_words
from vpsci_ros.wire.layout import MAP, PlanarMotion
from vpsci_ros.world import IDLE, RUNNING, Scenario
from vpsci_ros.world.state import EPISODE

MARK = Time(sec=0x5A17_5A17, nanosec=0x1A5C_1A5C)  # the stamp of a message that becomes a template
_HEADER = Header(stamp=MARK, frame_id=MAP)
_STAMP, _NUMBER = struct.Struct("<iI"), struct.Struct("<d")
_MOVING = ("vehicle_x", "vehicle_y", "vehicle_heading", "pedestrian_x", "pedestrian_y")


Numbers = tuple[float, ...]
"""Of a mover: x, y [m], z and w of its rotation, speed [m/s], yaw rate [rad/s]."""


def numbers_of(motion: PlanarMotion) -> Numbers:
    """Return the numbers of a motion that messages have."""
    return motion.x, motion.y, *motion.quaternion, motion.speed, motion.yaw_rate


def odometry(numbers: Numbers, frame: str, header: WireHeader) -> bytes:
    """Return the serialized Odometry of who has this frame, such as "vehicle"."""
    return _odometry(frame).filled(header, numbers)


def transforms(movers: Mapping[str, Numbers], header: WireHeader) -> bytes:
    """Return the serialized TFMessage of the poses of movers, by frame."""
    poses = [number for numbers in movers.values() for number in numbers[:4]]
    return _transforms(tuple(movers)).filled(header, poses)


class SceneMarkers:
    """The markers of one episode at a time.

    :param scenarios: by number, all that may come.
    """

    def __init__(self, scenarios: Mapping[int, Scenario]) -> None:
        self._scenarios = scenarios
        self._templates: dict[tuple[int, bytes], Template] = {}

    def written(self, state: NDArray[np.void], movers: Sequence[Numbers], header: WireHeader) -> bytes:
        """Return the serialized MarkerArray of EPISODE[B] records; `movers`: the vehicle and each pedestrian."""
        idle = state["status"] == IDLE
        key = int(state["scenario"][0]), idle.tobytes()
        if key not in self._templates:
            self._templates[key] = self._scene(key[0], idle)
        vehicle, *people = movers
        changing = [*vehicle[:4], *(number for each in people for number in each[:2])]
        return self._templates[key].filled(header, [] if idle[0] else changing)

    def _scene(self, scenario: int, idle: NDArray[np.bool_]) -> "Template":
        example = np.zeros(len(idle), EPISODE)
        example["scenario"], example["status"] = scenario, np.where(idle, IDLE, RUNNING)
        for k, name in enumerate(_MOVING):
            example[name] = 0.7182818284590452 + 0.1 * k + np.arange(len(idle)) / 3.0
        message = scene_markers(example, self._scenarios, _HEADER)
        numbers: list[float] = []
        if not idle[0]:
            first = example[0]
            x, y, yaw = (float(first[name]) for name in _MOVING[:3])
            numbers = [*numbers_of(PlanarMotion(x, y, yaw, 0.0, 0.0))[:4]]
            for record in example:
                numbers += float(record["pedestrian_x"]), float(record["pedestrian_y"])
        return Template("visualization_msgs/msg/MarkerArray", message, numbers)


class Template:
    """A serialized message to be filled with another stamp, wherever it has `MARK`, and other numbers.

    :param kind: its type, such as "nav_msgs/msg/Odometry".
    :param message: an example.
    :param numbers: float64 numbers of the example that change, such as nothing else in it has.
    """

    def __init__(self, kind: str, message: Any, numbers: Sequence[float]) -> None:
        data = whole_words(rewritten(kind, serialize_message(message), kind)[1])
        marks = [_STAMP.pack(MARK.sec, MARK.nanosec), *map(_NUMBER.pack, numbers)]
        places = sorted((at, k) for k, mark in enumerate(marks) for at in _places(data, mark))
        self._constant: list[bytes] = []
        layout, order, end = "<", [], 0
        for at, k in [*places, (len(data), -1)]:  # what stands between two places, and what at the second one
            layout += f"{at - end}s" + ("" if k < 0 else "d" if k else "iI")
            order += [2 + len(numbers) + len(self._constant), *([] if k < 0 else [1 + k] if k else [0, 1])]
            self._constant.append(data[end:at])
            end = at + 8
        self._pack, self._in_order = struct.Struct(layout).pack, itemgetter(*order)

    def filled(self, header: WireHeader, numbers: Sequence[float]) -> bytes:
        """Return the message with this stamp and these numbers in place of those of the example, in their order."""
        values = (header.seconds, header.nanoseconds, *numbers, *self._constant)
        return self._pack(*self._in_order(values))


def _places(data: bytes, mark: bytes) -> list[int]:
    """Return where a mark stands in a message, which has it at least once."""
    found = [at for at in range(len(data)) if data.startswith(mark, at)]
    assert found, "the example does not have one of its numbers"
    return found


@cache
def _odometry(frame: str) -> Template:
    motion = _example(0)
    return Template("nav_msgs/msg/Odometry", convert.odometry(motion, frame, _HEADER), numbers_of(motion))


@cache
def _transforms(frames: tuple[str, ...]) -> Template:
    examples = [_example(k) for k in range(len(frames))]
    message = convert.transforms(convert.odometry(*each, _HEADER) for each in zip(examples, frames, strict=True))
    return Template("tf2_msgs/msg/TFMessage", message, [number for each in examples for number in numbers_of(each)[:4]])


def _example(k: int) -> PlanarMotion:
    """Return a motion whose numbers are like no other's."""
    return PlanarMotion(*(0.5772156649015329 + 0.1 * field + k / 3.0 for field in range(5)))
