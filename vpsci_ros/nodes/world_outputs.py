"""What the world publishes: state and time, events and transitions, and views of one episode for existing tools."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header, String

from vpsci_ros.nodes import convert
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.markers import scene_markers
from vpsci_ros.resources import robot_description
from vpsci_ros.wire.header import WireHeader
from vpsci_ros.wire.layout import MAP
from vpsci_ros.wire.world_state import SerializedState, warm_up, write_world_state
from vpsci_ros.world import IDLE, Scenario, WorldConfig
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.tick import Tick


class WorldOutputs:
    """`/clock`, `/world/state`, `/episode/event`, `/replay`; of one episode at a time odometry, transforms, markers.

    `/pedestrian/odometry` is that of the first pedestrian, `/pedestrians/odometry` of each, where there may be several.

    :param config: of the world: its tick, and how many pedestrians an episode may have.
    :param pedestrian_odometry: publish pedestrians' odometry, beside the vehicle's.
    :param transitions: offer `/replay`.
    """

    def __init__(
        self,
        node: GraphNode,
        config: WorldConfig,
        batch: int,
        scenarios: Mapping[int, Scenario],
        *,
        transitions: bool,
        pedestrian_odometry: bool = True,
    ) -> None:
        self._node = node
        self._period = config.tick
        self._scenarios = scenarios
        self._time = node.output("/clock")
        self._state = node.output("/world/state")
        self._event = node.output("/episode/event")
        self._replay = [node.output("/replay")] if transitions else []
        agents = AGENTS if pedestrian_odometry else AGENTS[:1]
        self._odometry = [node.output(f"/{agent}/odometry") for agent in agents] if batch == 1 else []
        several = batch == 1 and config.pedestrians > 1 and pedestrian_odometry
        self._pedestrians = [node.output("/pedestrians/odometry")] if several else []
        self._markers = [node.output("/markers")] if batch == 1 else []
        self._transforms = [node.output("/tf")] if batch == 1 else []
        self._fixed = [node.output("/tf_static")] if batch == 1 else []
        views = [*self._odometry, *self._pedestrians, *self._markers, *self._transforms, *self._fixed]
        self.all = [self._time, self._state, self._event, *self._replay, *views]
        for agent in AGENTS if batch == 1 else ():
            node.output(f"/{agent}/robot_description").publish_now(String(data=robot_description(agent)))
        self._fixed_published = False  # with the first tick, when a recorder is there
        warm_up()

    def absent(self) -> set[str]:
        """Return the nodes that are expected to subscribe and have not."""
        return {name for output in self.all if not output.matched for name in output.missing()}

    def unread(self) -> set[str]:
        """Return other subscribers that were discovered and are not matched yet."""
        return {f"a reader of {output.full_name}" for output in self.all if not output.complete}

    def tick(self, tick: Tick) -> None:
        """Publish a tick."""
        self._node.simulated_time = convert.stamp(tick.number, self._period)
        self._time.publish(Clock(clock=self._node.simulated_time))
        header = Header(stamp=self._node.simulated_time, frame_id=MAP)
        serialized = WireHeader(header.stamp.sec, header.stamp.nanosec, MAP)
        self._state.publish(write_world_state(SerializedState(serialized, tick, self._period)))
        for output in self._fixed if not self._fixed_published else ():
            output.publish(convert.fixed_transforms(self._node.frame_prefix))
        self._fixed_published = True
        self._publish_motion(tick, header)
        for output in self._markers:
            if output.has_readers:
                output.publish(scene_markers(tick.state, self._scenarios, header))

    def repeat(self, tick: Tick) -> None:
        """Publish odometry and transforms of a tick once more, for readers that were not subscribed yet."""
        self._publish_motion(tick, Header(stamp=self._node.simulated_time, frame_id=MAP))

    def _publish_motion(self, tick: Tick, header: Header) -> None:
        """Publish odometry and the same as transforms, while there are readers."""
        record, prefix = tick.state[0], self._node.frame_prefix
        moving = (*self._odometry, *self._pedestrians, *self._transforms)
        if record["status"] == IDLE or not any(output.has_readers for output in moving):
            return
        published = list(convert.odometry_messages(record, header, prefix)[: len(self._odometry)])
        for output, odometry in zip(self._odometry, published, strict=True):
            output.publish(odometry)
        for output in self._pedestrians:
            for pedestrian in tick.state[tick.state["status"] != IDLE]:
                published.append(convert.pedestrian_odometry(pedestrian, header, prefix))
                output.publish(published[-1])
        for output in self._transforms:
            output.publish(convert.transforms(published))

    def events(self, events: NDArray[np.void], number: int) -> None:
        """Publish what happened up to the tick of this number, EVENT[n], n > 0."""
        self._event.publish(convert.event_message(events, number, self._period))

    def transitions(self, rows: NDArray[np.void], number: int) -> None:
        """Publish the transitions that the tick of this number completed, TRANSITION[n]."""
        for output in self._replay if len(rows) else []:
            output.publish(convert.transition_message(rows, number, self._period))
