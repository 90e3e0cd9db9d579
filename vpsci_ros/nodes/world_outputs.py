"""The world's publications: state, time, events, transitions, and views of one episode for existing tools."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import String

from vpsci_ros.nodes import convert
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.resources import robot_description
from vpsci_ros.wire.events import write_events
from vpsci_ros.wire.header import WireHeader, tick_header, write_clock
from vpsci_ros.wire.layout import EVENTS, PlanarMotion, motion_of
from vpsci_ros.wire.markers import write_markers
from vpsci_ros.wire.odometry import write_odometry, write_transforms
from vpsci_ros.wire.world_state import StateContent, warm_up, write_world_state
from vpsci_ros.world import IDLE, Scenario, WorldConfig
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.tick import Tick

PERCEPTION = "perception"  # the node


class WorldOutputs:
    """Publishes `/clock`, `/world/state`, `/episode/event`, `/replay`; with `batch` 1 also odometry and views.

    `/pedestrian/odometry` is that of the first pedestrian, `/pedestrians/odometry` of each, where there may be several.
    Where the graph has the node `perception`, pedestrians are on `/perception/objects` instead.

    :param config: of the world: its tick, and how many pedestrians an episode may have.
    :param transitions: publish `/replay`.
    """

    def __init__(
        self,
        node: GraphNode,
        config: WorldConfig,
        transitions: bool,
        batch: int,
        scenarios: Mapping[int, Scenario],
    ) -> None:
        self._node = node
        self._period = config.tick
        self._time = node.output("/clock")
        self._state = node.output("/world/state")
        self._event = node.output(EVENTS)
        self._replay = [node.output("/replay")] if transitions else []
        self._agents = AGENTS[:1] if PERCEPTION in node.peers else AGENTS
        one = batch == 1
        several = one and config.pedestrians > 1 and PERCEPTION not in node.peers
        self._odometry = [node.output(f"/{agent}/odometry") for agent in self._agents] if one else []
        self._people = [node.output("/pedestrians/odometry")] if several else []
        self._drawn = [node.output("/markers")] if one else []
        self._transforms = [node.output("/tf")] if one else []
        self._fixed = [node.output("/tf_static")] if one else []
        self._moving = [*self._odometry, *self._people, *self._transforms]
        self.all = [self._time, self._state, self._event, *self._replay, *self._moving, *self._drawn, *self._fixed]
        for agent in AGENTS if one else ():
            node.output(f"/{agent}/robot_description").publish_now(String(data=robot_description(agent)))
        self._scenarios = scenarios
        self._fixed_published = False  # with the first tick, when a recorder is there
        warm_up()

    def absent(self) -> set[str]:
        """Return the nodes that are expected to subscribe and have not subscribed yet."""
        return {name for output in self.all if not output.matched for name in output.missing()}

    def unread(self) -> set[str]:
        """Return "a reader of /TOPIC" for each topic with a discovered subscriber that is not matched yet."""
        return {f"a reader of {output.full_name}" for output in self.all if not output.complete}

    def tick(self, tick: Tick) -> None:
        """Publish a tick: time, state and, if any program subscribes to them, odometry and views."""
        header = tick_header(tick.number, self._period)
        self._node.simulated_at = header.at
        self._time.publish(write_clock(header))
        self._state.publish(write_world_state(StateContent(header, tick, self._period)))
        for output in self._fixed if not self._fixed_published else ():
            output.publish(convert.fixed_transforms(self._node.frame_prefix))
        self._fixed_published = True
        if any(output.has_readers for output in (*self._moving, *self._drawn)):
            movers = _movers(tick.state)
            self._publish_motion(tick.state, movers, header)
            for output in self._drawn:
                output.publish(write_markers(tick.state, movers, self._scenarios, header))

    def repeat(self, tick: Tick) -> None:
        """Publish odometry and transforms of a tick once more, for readers that have subscribed late."""
        self._publish_motion(tick.state, _movers(tick.state), tick_header(tick.number, self._period))

    def _publish_motion(self, state: NDArray[np.void], movers: list[PlanarMotion], header: WireHeader) -> None:
        """Publish the agents' odometry and transforms; nothing while the slot is idle."""
        if state["status"][0] == IDLE:
            return
        prefix = self._node.frame_prefix
        agents = {f"{prefix}{agent}": mover for agent, mover in zip(self._agents, movers, strict=False)}
        people = {
            f"{prefix}pedestrian_{k}": movers[1 + k]
            for k in (np.flatnonzero(state["status"] != IDLE).tolist() if self._people else ())
        }
        for output, (frame, mover) in zip(self._odometry, agents.items(), strict=True):
            output.publish(write_odometry(mover, frame, header))
        for output in self._people:
            for frame, mover in people.items():
                output.publish(write_odometry(mover, frame, header))
        for output in self._transforms:
            output.publish(write_transforms(agents | people, header))

    def events(self, events: NDArray[np.void], number: int) -> None:
        """Publish the events up to the tick of this number, EVENT[n], n > 0."""
        self._event.publish(write_events(events, tick_header(number, self._period), number))

    def transitions(self, rows: NDArray[np.void], number: int) -> None:
        """Publish the transitions that the tick of this number completed, TRANSITION[n]."""
        for output in self._replay if len(rows) else []:
            output.publish(convert.transition_message(rows, number, self._period))


def _movers(state: NDArray[np.void]) -> list[PlanarMotion]:
    """Return the motions of the vehicle and each pedestrian of EPISODE[B] records of one episode."""
    return [motion_of(state[0], "vehicle"), *(motion_of(record, "pedestrian") for record in state)]
