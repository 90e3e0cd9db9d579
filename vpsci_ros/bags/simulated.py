"""Simulated ticks written as a bag, in the recorder's format, without ROS.

One episode after the other in one slot, so that the odometry topics, which viewers read, carry them too.
"""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.episodes import EPISODE_RECORD, EpisodeLog
from vpsci_ros.bags.run_record import NODE, SCENARIO, SOFTWARE, scenario_records, software_record
from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.wire import layout
from vpsci_ros.wire.answers import ActionContent, SafetyContent, write_action, write_safety_state
from vpsci_ros.wire.decoder import describe
from vpsci_ros.wire.header import tick_header
from vpsci_ros.wire.odometry import write_odometry
from vpsci_ros.wire.world_state import StateContent, write_world_state
from vpsci_ros.world import Scenario
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.state import ENDED, FINISHED, IDLE, STARTED, list_events
from vpsci_ros.world.tick import Step
from vpsci_ros.world.world_config import WorldConfig


def write_ticks(
    ticks: Iterable[Step],
    config: WorldConfig,
    bag: Path,
    custom_data: Mapping[str, str],
    nodes: Iterable[Mapping[str, str]] = (),
    scenarios: Iterable[Scenario] = (),
) -> int:
    """Write the ticks of one episode after another as a bag and return the number of ticks.

    :param custom_data: goes into its metadata.
    :param nodes: records of `vpsci_ros.bags.run_record.node_record`, which `vpsci bag verify` needs.
    :param scenarios: of the episodes.
    :raises InvalidInput: `bag` is not empty, or another process writes into it.
    """
    topics = [BagTopic(name, kind, *describe(kind)) for name, kind in layout.TYPES.items()]
    writer = BagWriter(bag, topics)
    writer.describe(SOFTWARE, software_record())
    for record in nodes:
        writer.describe(NODE, record)
    for record in scenario_records(scenarios):
        writer.describe(SCENARIO, record)
    log, count = EpisodeLog(), 0
    for step in ticks:
        tick = step.tick
        time = tick_header(tick.number, config.tick).at
        for topic, data in _messages(step, config):
            writer.write(topic, data, time, time)
        for ended in log.add(tick.number, time, _events(tick.state), writer.path.name):
            writer.add_metadata(EPISODE_RECORD, ended.to_record())
        count += 1
    writer.close(custom_data)
    return count


def _events(state: NDArray[np.void]) -> NDArray[np.void]:
    """Return the beginnings or the ends that the state of one episode shows, one a pedestrian, EVENT[n]."""
    begins, ends = (state["frame"] == 0) & (state["status"] != IDLE), state["status"] == ENDED
    return list_events(state, (begins * (1 << STARTED) + ends * (1 << FINISHED)).astype(np.uint16))


def _messages(step: Step, config: WorldConfig) -> Iterator[tuple[str, bytes]]:
    """Yield topic and serialized message of one tick of one episode."""
    tick, assessed = step.tick, step.assessment
    header = tick_header(tick.number, config.tick)
    yield layout.WORLD, write_world_state(StateContent(header, tick, config.tick))
    safety = assessed.curvttc, assessed.distance, assessed.critical
    yield layout.SAFETY, write_safety_state(SafetyContent(header, tick.number, *safety))
    for agent in AGENTS:
        if (action := step.actions.of(agent)) is not None:
            answer = ActionContent(header, tick.number, action[:, 0], action[:, 1], 1)
            yield f"/{agent}/action", write_action(answer)
    if tick.state[0]["status"]:
        for agent in AGENTS:
            yield f"/{agent}/odometry", write_odometry(layout.motion_of(tick.state[0], agent), agent, header)
    for record in tick.state if config.pedestrians > 1 else ():
        if record["status"]:
            motion = layout.motion_of(record, "pedestrian")
            yield "/pedestrians/odometry", write_odometry(motion, f"pedestrian_{record['pedestrian']}", header)
