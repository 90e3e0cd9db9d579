"""What the world publishes: state and time, events and transitions, and views of one episode for existing tools."""

from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from vpsci_ros.nodes import convert
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.exchange import Outgoing, each
from vpsci_ros.nodes.topics import TOPICS
from vpsci_ros.nodes.views import Views
from vpsci_ros.resources import robot_description
from vpsci_ros.wire.header import WireHeader, write_clock
from vpsci_ros.wire.layout import EVENTS, MAP
from vpsci_ros.wire.padding import zeroed
from vpsci_ros.wire.world_state import SerializedState, as_read, warm_up, write_world_state
from vpsci_ros.world import IDLE, Scenario, WorldConfig
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.tick import Tick

_write_clock, _write_state = each(lambda world: write_clock(world.header)), each(write_world_state)


class _Happened(NamedTuple):
    """What an EpisodeEvent says."""

    header: WireHeader
    tick: int
    events: NDArray[np.void]  # EVENT[n]

    def written(self, period: float) -> bytes:
        """Return the serialized message; a tick takes so long [s]."""
        message = convert.event_message(self.events, self.tick, period)
        return zeroed(TOPICS[EVENTS].type_name, serialize_message(message), EVENTS)


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
        self._time = node.output("/clock")
        self._state = node.output("/world/state")
        self._event = node.output(EVENTS)
        self._write_events = each(lambda happened: happened.written(config.tick))
        self._replay = [node.output("/replay")] if transitions else []
        agents = AGENTS if pedestrian_odometry else AGENTS[:1]
        one, several = batch == 1, batch == 1 and config.pedestrians > 1 and pedestrian_odometry
        odometry = [node.output(f"/{agent}/odometry") for agent in agents] if one else []
        pedestrians = [node.output("/pedestrians/odometry")] if several else []
        markers = [node.output("/markers")] if one else []
        transforms = [node.output("/tf")] if one else []
        self._fixed = [node.output("/tf_static")] if one else []
        self.all = [self._time, self._state, self._event, *self._replay]
        self.all += [*odometry, *pedestrians, *markers, *transforms, *self._fixed]
        for agent in AGENTS if one else ():
            node.output(f"/{agent}/robot_description").publish_now(String(data=robot_description(agent)))
        views, prefix = Views(scenarios), node.frame_prefix
        frames = {f"{prefix}{agent}": mover for mover, agent in enumerate(agents)}
        people = {f"{prefix}pedestrian_{k}": 1 + k for k in range(config.pedestrians if several else 0)}
        self._moving = [*odometry, *pedestrians, *transforms]
        self._motion = [
            (output, partial(views.odometry, mover, frame))
            for output, (frame, mover) in zip(odometry, frames.items(), strict=bool(odometry))
        ]
        self._people = [
            (output, mover, partial(views.odometry, mover, frame))
            for output in pedestrians
            for frame, mover in people.items()
        ]
        self._transforms = [(output, partial(views.transforms, frames, people)) for output in transforms]
        self._markers = [(output, views.markers) for output in markers]
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
        self._node.simulated_at = tick.number * round(self._period * 1e9)
        world = self._world(tick)
        self._time.publish(Outgoing(world, _write_clock))
        self._state.publish(Outgoing(world, _write_state))
        for output in self._fixed if not self._fixed_published else ():
            output.publish(convert.fixed_transforms(self._node.frame_prefix))
        self._fixed_published = True
        self._publish_motion(world)
        for output, write in self._markers:
            if output.has_readers:
                output.publish(Outgoing(world, write))

    def repeat(self, tick: Tick) -> None:
        """Publish odometry and transforms of a tick once more, for readers that were not subscribed yet."""
        self._publish_motion(self._world(tick))

    def _world(self, tick: Tick) -> SerializedState:
        """Return a tick as it is published; what nodes of this process get, they may keep."""
        world = SerializedState(self._header(tick.number), tick, self._period)
        return as_read(world) if self._state.shared else world

    def _header(self, number: int) -> WireHeader:
        return WireHeader(*divmod(number * round(self._period * 1e9), 1_000_000_000), MAP)

    def _publish_motion(self, world: SerializedState) -> None:
        """Publish odometry and the same as transforms, while there are readers."""
        status = world.tick.state["status"]
        if status[0] == IDLE or not any(output.has_readers for output in self._moving):
            return
        for output, write in self._motion:
            output.publish(Outgoing(world, write))
        for output, mover, write in self._people:
            if status[mover - 1] != IDLE:
                output.publish(Outgoing(world, write))
        for output, write in self._transforms:
            output.publish(Outgoing(world, write))

    def events(self, events: NDArray[np.void], number: int) -> None:
        """Publish what happened up to the tick of this number, EVENT[n], n > 0."""
        self._event.publish(Outgoing(_Happened(self._header(number), number, events), self._write_events))

    def transitions(self, rows: NDArray[np.void], number: int) -> None:
        """Publish the transitions that the tick of this number completed, TRANSITION[n]."""
        for output in self._replay if len(rows) else []:
            output.publish(convert.transition_message(rows, number, self._period))
