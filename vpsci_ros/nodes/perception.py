"""Perception as a node: publishes the pedestrians with the errors of a sensor and a tracker."""

import math
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import PointCloud2

from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.nodes import convert
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.parameters import pick
from vpsci_ros.runs.run_config import RunConfig
from vpsci_ros.wire.layout import WORLD
from vpsci_ros.wire.world_state import StateContent, read_world_state
from vpsci_ros.wire.world_state import warm_up as warm_up_reading
from vpsci_ros.world import WorldConfig, load_scenarios
from vpsci_ros.world.parked import Parked, parked_from
from vpsci_ros.world.perception import SEEN, PerceptionConfig, PerceptionState, blank, perceive, warm_up

REPEAT_AFTER = 1.25  # [s] of a world that stands still at the first tick; it knows by then that it waits for an answer


class Perception(GraphNode):
    """Subscribes to `/world/state`; publishes a list `/perception/objects` a tick, stamped with the time of detection.

    Scenarios and the number of pedestrians come with the world's reports; ticks that come before the first one wait.
    The first list is published again while the world waits for an external driving system, which may have been
    discovered too late for it.
    """

    def __init__(self, **given: Any) -> None:
        super().__init__("perception", **given)
        self._config = self.config(PerceptionConfig)
        warm_up_reading()
        warm_up(self._config)  # before the topic is there, for which others wait
        self._objects = self.output("/perception/objects")
        self._parked: Parked | None = None
        self._pedestrians = 1
        self._external = False  # a driving system drives, which may miss the first list
        self._memory: PerceptionState | None = None
        self._listed = 0
        self._first: PointCloud2 | None = None  # list, until the second one
        self._first_at = 0.0  # [s] of the wall clock, when it was published
        self._waiting: list[StateContent] = []
        self._awaited = ["world_simulator"]
        self.input("/diagnostics", self._world_parameters, self._on_parameters)
        self.input(WORLD, _shown, self._on_state, raw=True)
        self.wall_timer(REPEAT_AFTER / 4, self._repeat_first)
        self.ready(WORLD, "/perception/objects")

    def figures(self) -> dict[str, Any]:
        """Return the number of objects in all lists so far."""
        return {"objects": self._listed}

    @property
    def awaited(self) -> list[str]:
        """["world_simulator"] until the world's parameters are known, then empty."""
        return self._awaited

    def _world_parameters(self, message: DiagnosticArray) -> dict[str, dict[str, Any]]:
        return convert.parameters_in(message, self._awaited, self.frame_prefix)

    def _on_parameters(self, found: dict[str, dict[str, Any]]) -> None:
        for values in found.values():  # of the world alone
            run, config = pick(RunConfig, values, "world_simulator"), pick(WorldConfig, values, "world_simulator")
            self._parked = parked_from(load_scenarios(run.scenarios, run.scenario_files))
            self._pedestrians, self._external = config.pedestrians, config.vehicle_driver == "external"
            self._awaited = []
            waiting, self._waiting = self._waiting, []
            for world in waiting:
                self._look(world)

    def _on_state(self, world: StateContent) -> None:
        if self._awaited:
            self._waiting.append(world)
        else:
            self._look(world)

    def _look(self, world: StateContent) -> None:
        header, tick, period = world
        if len(tick.state) != self._pedestrians:
            raise VpsciError(
                f"perception works on one episode at a time: expected {self._pedestrians} rows of /world/state, got "
                f"{len(tick.state)}; set world_simulator.batch to 1"
            )
        first = self._memory is None
        self._memory = self._memory or blank(len(tick.state), self._config, period)
        self._memory, objects = perceive(
            self._memory, tick.state, self._config, period, self._parked, self._pedestrians
        )
        self._first, self._first_at = None, time.perf_counter()
        if first or self._objects.has_readers:
            seen_at = convert.stamp(max(0, tick.number - self._config.delay(period)), period)
            listed = convert.objects_message(objects[objects["status"] == SEEN], seen_at)
            self._objects.publish(listed)
            self._first = listed if first and self._external else None
        self._listed += objects["status"].tobytes().count(SEEN)
        self.simulated_at = header.at

    def _repeat_first(self) -> None:
        if self._first is not None and time.perf_counter() - self._first_at > REPEAT_AFTER:
            self._first_at = time.perf_counter()
            self._objects.publish_now(self._first)


def _shown(data: bytes) -> StateContent:
    """Return the content of a serialized WorldState.

    :raises InvalidInput: as `read_world_state`, or its `dt` is not a finite number above 0.
    """
    world = read_world_state(data)
    if not 0.0 < world.period < math.inf:
        raise InvalidInput(f"{WORLD}: expected dt > 0 s, got {world.period:g}")
    return world
