"""Perception as a node: what a driving system is told of the pedestrians, instead of where they truly are."""

import sys
import time
from typing import Any

from rclpy.context import Context
from sensor_msgs.msg import PointCloud2

from vpsci_msgs.msg import WorldState
from vpsci_ros.bags import received
from vpsci_ros.errors import VpsciError
from vpsci_ros.nodes import convert
from vpsci_ros.nodes.base import GraphNode, run
from vpsci_ros.nodes.meter import Meter
from vpsci_ros.nodes.peer_parameters import PeerParameters
from vpsci_ros.world import load_scenarios
from vpsci_ros.world.parked import Parked, parked_from
from vpsci_ros.world.perception import SEEN, Memory, PerceptionConfig, blank, perceive, warm_up

TELL_AGAIN = 1.25  # [s] of a world that stands still at the first tick; it knows by then that it waits for an answer


class Perception(GraphNode):
    """`/world/state` in, `/perception/objects` out, a list of objects a tick, with the stamp of when they were seen.

    It asks the world for its scenarios and the number of pedestrians; ticks that come before the answer wait for it.
    The first list is told again while the world waits: a driving system may have been discovered too late to hear it.
    """

    def __init__(self, *, context: Context | None = None, parameter_overrides: list[Any] | None = None) -> None:
        super().__init__("perception", context=context, parameter_overrides=parameter_overrides)
        self._config = self.config(PerceptionConfig)
        warm_up(self._config)  # before the topic is there, for which others wait
        self._meter = Meter()
        self._objects = self.output("/perception/objects")
        self._parked: Parked | None = None
        self._pedestrians = 1
        self._memory: Memory | None = None
        self._told = 0
        self._first: PointCloud2 | None = None  # list, until the second one
        self._first_at = 0.0  # [s] of the wall clock, when it was told
        self._waiting: list[WorldState] = []
        self._world = PeerParameters(self, ["world_simulator"], self._on_parameters)
        self.input("/world/state", self._on_state)
        self.wall_timer(TELL_AGAIN / 4, self._tell_again)
        self.diagnose(lambda: [*self._meter.pairs(), ("objects", self._told)])

    def _on_parameters(self, _: str, values: dict[str, Any]) -> None:
        self._parked = parked_from(load_scenarios(values["scenarios"], values["scenario_files"]))
        self._pedestrians = values.get("pedestrians", 1)
        waiting, self._waiting = self._waiting, []
        for message in waiting:
            self._look(message)

    def _on_state(self, message: WorldState) -> None:
        if self._world.missing:
            self._waiting.append(message)
        else:
            self._look(message)

    def _look(self, message: WorldState) -> None:
        arrived = time.perf_counter()
        tick = self.intake.read("/world/state", received.world_state, message)
        if tick is None:
            return
        if len(tick.state) != self._pedestrians:
            raise VpsciError(
                f"perception tells of one episode at a time: expected {self._pedestrians} rows of /world/state, got "
                f"{len(tick.state)}; set world_simulator.batch to 1"
            )
        first = self._memory is None
        self._memory = self._memory or blank(len(tick.state), self._config, message.dt)
        self._memory, objects = perceive(
            self._memory, tick.state, self._config, message.dt, self._parked, self._pedestrians
        )
        told = objects[objects["status"] == SEEN]
        seen_at = max(0, tick.number - self._config.delay(message.dt))
        listed = convert.objects_message(told, seen_at, message.dt)
        self._objects.publish(listed)
        self._first, self._first_at = listed if first else None, time.perf_counter()
        self._told += len(told)
        self.simulated_time = message.header.stamp
        self._meter.tick(message.tick)
        self._meter.answered(arrived)

    def _tell_again(self) -> None:
        if self._first is not None and time.perf_counter() - self._first_at > TELL_AGAIN:
            self._first_at = time.perf_counter()
            self._objects.publish_now(self._first)


def main(args: list[str] | None = None) -> int:
    """Run the node until it is stopped."""
    return run(Perception, args)


if __name__ == "__main__":
    sys.exit(main())
