"""Simulated ticks as a bag, written as the recorder of the graph writes them, without ROS.

One episode after the other in one slot, so that the odometry topics, which viewers read, carry them too. Messages are
serialised from the definitions in `msg_defs/`.
"""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.episodes import RECORD, EpisodeLog, EventRow
from vpsci_ros.bags.run_record import NODE, SCENARIO, SOFTWARE, scenario_records, software_record
from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.wire import layout
from vpsci_ros.wire.decoder import describe, known_types
from vpsci_ros.world import Scenario
from vpsci_ros.world.config import WorldConfig
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.state import ENDED, FINISHED, IDLE, STARTED
from vpsci_ros.world.tick import Step


def write_ticks(
    ticks: Iterable[Step],
    config: WorldConfig,
    bag: Path,
    custom_data: Mapping[str, str],
    nodes: Iterable[Mapping[str, str]] = (),
    scenarios: Iterable[Scenario] = (),
) -> int:
    """Write the ticks of one episode after another as a bag and return their number.

    :param custom_data: goes into its metadata.
    :param nodes: records of `vpsci_ros.bags.run_record.node_record`, from which `vpsci bag verify` makes the bag again.
    :param scenarios: of the episodes.
    :raises InvalidInput: `bag` is not empty.
    """
    messages = _Messages()
    topics = [BagTopic(name, kind, *describe(kind)) for name, kind in layout.TYPES.items()]
    writer = BagWriter(bag, topics)
    writer.describe(SOFTWARE, software_record())
    for record in nodes:
        writer.describe(NODE, record)
    for record in scenario_records(scenarios):
        writer.describe(SCENARIO, record)
    log = EpisodeLog()
    count = 0
    for step in ticks:
        tick = step.tick
        time = tick.number * round(config.tick * 1e9)
        for topic, data in messages.of(step, config, time):
            writer.write(topic, data, time, time)
        for ended in log.add(tick.number, time, _events(tick.state), writer.path.name):
            writer.add_metadata(RECORD, ended.to_record())
        count += 1
    writer.close(custom_data)
    return count


def _events(state: NDArray[np.void]) -> Iterator[EventRow]:
    """Yield the beginnings or the ends that the state of one episode shows, one a pedestrian."""
    for slot, record in enumerate(state):
        for kind, here in ((STARTED, record["frame"] == 0), (FINISHED, record["status"] == ENDED)):
            if here and record["status"] != IDLE:
                scenario, episode, outcome = (int(record[name]) for name in ("scenario", "episode", "outcome"))
                yield EventRow(kind, slot, scenario, episode, outcome, float(record["least_curvttc"]))


class _Messages:
    """A tick as serialised messages."""

    def __init__(self) -> None:
        self._store = known_types()

    def of(self, step: Step, config: WorldConfig, time: int) -> Iterable[tuple[str, bytes]]:
        """Yield (topic, message) of one tick of one episode; `time` in nanoseconds."""
        tick, assessed = step.tick, step.assessment
        stamp = self._make("builtin_interfaces/msg/Time", sec=time // 10**9, nanosec=time % 10**9)
        header = {"header": self._make("std_msgs/msg/Header", stamp=stamp, frame_id=layout.MAP)}
        of_tick = header | {"tick": tick.number}
        state = layout.world_state_fields(tick.state, tick.policy_frame)
        yield self._serialise(layout.WORLD, of_tick | {"dt": config.tick} | state)
        safety = layout.safety_fields(assessed.curvttc, assessed.distance, assessed.critical)
        yield self._serialise(layout.SAFETY, of_tick | safety)
        for agent in AGENTS:
            if (action := step.actions.of(agent)) is not None:
                yield self._serialise(
                    f"/{agent}/action", of_tick | {"policy_version": 1} | layout.action_fields(action)
                )
        if tick.state[0]["status"]:
            for agent in AGENTS:
                motion = layout.motion_of(tick.state[0], agent)
                yield self._serialise(f"/{agent}/odometry", header | self._odometry(agent, motion))
        for record in tick.state if config.pedestrians > 1 else ():
            if record["status"]:
                name = f"pedestrian_{record['pedestrian']}"
                motion = layout.motion_of(record, "pedestrian")
                yield self._serialise("/pedestrians/odometry", header | self._odometry(name, motion))

    def _odometry(self, frame: str, motion: layout.PlanarMotion) -> dict[str, Any]:
        make = self._make
        z, w = motion.quaternion
        at = make("geometry_msgs/msg/Point", x=motion.x, y=motion.y, z=0.0)
        turned = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=z, w=w)
        along = make("geometry_msgs/msg/Vector3", x=motion.speed, y=0.0, z=0.0)
        turning = make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=motion.yaw_rate)
        pose = make("geometry_msgs/msg/Pose", position=at, orientation=turned)
        twist = make("geometry_msgs/msg/Twist", linear=along, angular=turning)
        unknown = np.zeros(36)
        return {
            "child_frame_id": f"{frame}/base_link",
            "pose": make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
            "twist": make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
        }

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._store.types[kind](**fields)

    def _serialise(self, topic: str, fields: Mapping[str, Any]) -> tuple[str, bytes]:
        whole = {k: np.ascontiguousarray(v) if isinstance(v, np.ndarray) else v for k, v in fields.items()}
        kind = layout.TYPES[topic]
        return topic, bytes(self._store.serialize_cdr(self._make(kind, **whole), kind))
