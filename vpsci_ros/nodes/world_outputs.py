"""What the world publishes: state and time, events and transitions, and views of one episode for existing tools."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import String

from vpsci_ros.nodes import convert, views
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.exchange import Outgoing
from vpsci_ros.nodes.views import Scene
from vpsci_ros.resources import robot_description
from vpsci_ros.wire import layout
from vpsci_ros.wire.header import WireHeader, write_clock
from vpsci_ros.wire.layout import MAP
from vpsci_ros.wire.world_state import SerializedState, as_read, warm_up, write_world_state
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
        self._scene = Scene(scenarios)
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
        header = WireHeader(self._node.simulated_time.sec, self._node.simulated_time.nanosec, MAP)
        self._time.publish(write_clock(header))
        world = SerializedState(header, tick, self._period)
        self._state.publish(Outgoing(as_read(world) if self._state.shared else world, write_world_state))
        for output in self._fixed if not self._fixed_published else ():
            output.publish(convert.fixed_transforms(self._node.frame_prefix))
        self._fixed_published = True
        self._publish_motion(tick)
        for output in self._markers:
            if output.has_readers:
                output.publish(self._scene.markers(tick.state, self._node.simulated_time))

    def repeat(self, tick: Tick) -> None:
        """Publish odometry and transforms of a tick once more, for readers that were not subscribed yet."""
        self._publish_motion(tick)

    def _publish_motion(self, tick: Tick) -> None:
        """Publish odometry and the same as transforms, while there are readers."""
        record, prefix, stamp = tick.state[0], self._node.frame_prefix, self._node.simulated_time
        moving = (*self._odometry, *self._pedestrians, *self._transforms)
        if record["status"] == IDLE or not any(output.has_readers for output in moving):
            return
        motions = {f"{prefix}{agent}": layout.motion_of(record, agent) for agent in AGENTS[: len(self._odometry)]}
        for output, (frame, motion) in zip(self._odometry, motions.items(), strict=True):
            output.publish(views.odometry(frame, motion, stamp))
        for output in self._pedestrians:
            for pedestrian in tick.state[tick.state["status"] != IDLE]:
                frame = f"{prefix}pedestrian_{pedestrian['pedestrian']}"
                motions[frame] = layout.motion_of(pedestrian, "pedestrian")
                output.publish(views.odometry(frame, motions[frame], stamp))
        for output in self._transforms:
            output.publish(views.transforms(motions, stamp))

    def events(self, events: NDArray[np.void], number: int) -> None:
        """Publish what happened up to the tick of this number, EVENT[n], n > 0."""
        self._event.publish(convert.event_message(events, number, self._period))

    def transitions(self, rows: NDArray[np.void], number: int) -> None:
        """Publish the transitions that the tick of this number completed, TRANSITION[n]."""
        for output in self._replay if len(rows) else []:
            output.publish(convert.transition_message(rows, number, self._period))
