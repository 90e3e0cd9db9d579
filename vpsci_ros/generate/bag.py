"""Chosen episodes of a dataset as a bag: simulated again, and written as the recorder of the graph writes them.

One episode after the other in one slot, so that the odometry topics, which viewers read, carry them too. Messages are
serialised from the definitions in `msg_defs/`, without ROS.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from vpsci_ros.data.bag_episodes import RECORD, EpisodeLog, EventRow
from vpsci_ros.data.bag_run import NODE, SOFTWARE, node_record, software_record
from vpsci_ros.data.bag_writer import BagTopic, BagWriter
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.decoder import known_types
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.simulate import Simulator
from vpsci_ros.generate.verify import job_of
from vpsci_ros.learning.rollout import Tick
from vpsci_ros.world import handover
from vpsci_ros.world.config import WorldConfig
from vpsci_ros.world.state import ENDED, FINISHED, IDLE, STARTED

_TOPICS = {
    "/world/state": "vpsci_msgs/msg/WorldState",
    "/safety/state": "vpsci_msgs/msg/SafetyState",
    "/vehicle/action": "vpsci_msgs/msg/AgentAction",
    "/pedestrian/action": "vpsci_msgs/msg/AgentAction",
    "/vehicle/odometry": "nav_msgs/msg/Odometry",
    "/pedestrian/odometry": "nav_msgs/msg/Odometry",
}


def record_episodes(folder: Path, episodes: list[tuple[int, int]], bag: Path) -> int:
    """Write episodes of a dataset to a bag and return the number of ticks.

    :param episodes: (scenario number, episode number); any that the dataset's seed defines, kept or not.
    :raises InvalidInput: no dataset of `generate`, a scenario that it does not have, or `bag` is not empty.
    """
    job = job_of(Dataset(folder))
    known = [scenario.number for scenario in job.scenarios]
    for scenario, _ in episodes:
        if scenario not in known:
            raise InvalidInput(f"{folder}: no scenario {scenario}; it has {', '.join(map(str, known))}")
    run = {"seed": job.seed, "scenarios": sorted({scenario for scenario, _ in episodes}), "batch": 1}
    nodes = [node_record("world_simulator", asdict(job.world) | run | {"queue": [list(each) for each in episodes]})]
    nodes.append(node_record("safety_monitor", asdict(job.monitor)))
    for agent, policy in job.policies.items():
        nodes.append(node_record(f"{agent}_policy", asdict(policy.config), policy.digest))
    return write_ticks(Simulator(job, 1).ticks(episodes), job.world, bag, {}, nodes)


def write_ticks(
    ticks: Iterable[Tick],
    config: WorldConfig,
    bag: Path,
    custom_data: Mapping[str, str],
    nodes: Iterable[Mapping[str, str]] = (),
) -> int:
    """Write the ticks of one slot as a bag and return their number; `custom_data` goes into its metadata.

    :param nodes: records of `vpsci_ros.data.bag_run.node_record`, from which `vpsci bag verify` makes the bag again.
    :raises InvalidInput: `bag` is not empty.
    """
    messages = _Messages()
    topics = [BagTopic(name, kind, *messages.describe(kind)) for name, kind in _TOPICS.items()]
    writer = BagWriter(bag, topics)
    writer.describe(SOFTWARE, software_record())
    for record in nodes:
        writer.describe(NODE, record)
    log = EpisodeLog()
    count = 0
    for tick in ticks:
        time = tick.tick * round(config.tick * 1e9)
        for topic, data in messages.of(tick, config, time):
            writer.write(topic, data, time, time)
        for ended in log.add(tick.tick, time, _events(tick.state[0]), writer.path.name):
            writer.add_metadata(RECORD, ended.to_record())
        count += 1
    writer.close(custom_data)
    return count


def _events(record: np.void) -> Iterator[EventRow]:
    """Yield the beginning or the end of an episode that the state of a slot shows."""
    for kind, here in ((STARTED, record["frame"] == 0), (FINISHED, record["status"] == ENDED)):
        if here and record["status"] != IDLE:
            scenario, episode, outcome = (int(record[name]) for name in ("scenario", "episode", "outcome"))
            yield EventRow(kind, 0, scenario, episode, outcome, float(record["least_curvttc"]))


class _Messages:
    """A tick as serialised messages."""

    def __init__(self) -> None:
        self._store = known_types()
        fields = self._store.fielddefs["vpsci_msgs/msg/WorldState"][1]
        self._state_fields = [name for name, _ in fields if name not in ("header", "tick", "dt", "policy_frame")]

    def describe(self, kind: str) -> tuple[str, str]:
        """Return the definition of a type with all that it needs, and its RIHS01 hash."""
        return self._store.generate_msgdef(kind, ros_version=2)[0], self._store.hash_rihs01(kind)

    def of(self, tick: Tick, config: WorldConfig, time: int) -> Iterable[tuple[str, bytes]]:
        """Yield (topic, message) of one tick of one slot; `time` in nanoseconds."""
        header = self._make("std_msgs/msg/Header", stamp=self._stamp(time), frame_id="map")
        state: dict[str, Any] = {name: np.ascontiguousarray(tick.state[name]) for name in self._state_fields}
        state["policy_frame"] = handover.policy_frame(tick.state, config).astype(np.uint8)
        yield self._serialise("/world/state", header=header, tick=tick.tick, dt=config.tick, **state)
        critical = tick.critical.astype(np.uint8)
        safety = {"curvttc": tick.curvttc, "distance": tick.distance, "critical": critical}
        yield self._serialise("/safety/state", header=header, tick=tick.tick, **safety)
        for agent, action in tick.actions.items():
            if action is not None:
                columns = np.ascontiguousarray(action.T)
                values = {"longitudinal": columns[0], "lateral": columns[1], "policy_version": 1}
                yield self._serialise(f"/{agent}/action", header=header, tick=tick.tick, **values)
        record = tick.state[0]
        if record["status"]:
            speed, rate = record["vehicle_speed"], record["vehicle_speed"] * record["vehicle_curvature"]
            yield self._odometry("vehicle", header, record, float(record["vehicle_heading"]), float(speed), float(rate))
            vx, vy = float(record["pedestrian_vx"]), float(record["pedestrian_vy"])
            yield self._odometry("pedestrian", header, record, float(np.arctan2(vy, vx)), float(np.hypot(vx, vy)), 0.0)

    def _odometry(
        self, agent: str, header: Any, record: np.void, yaw: float, speed: float, yaw_rate: float
    ) -> tuple[str, bytes]:
        make = self._make
        at = make("geometry_msgs/msg/Point", x=float(record[f"{agent}_x"]), y=float(record[f"{agent}_y"]), z=0.0)
        turned = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=np.sin(yaw / 2), w=np.cos(yaw / 2))
        along = make("geometry_msgs/msg/Vector3", x=speed, y=0.0, z=0.0)
        turning = make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=yaw_rate)
        pose = make("geometry_msgs/msg/Pose", position=at, orientation=turned)
        twist = make("geometry_msgs/msg/Twist", linear=along, angular=turning)
        unknown = np.zeros(36)
        return self._serialise(
            f"/{agent}/odometry",
            header=header,
            child_frame_id=f"{agent}/base_link",
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
        )

    def _stamp(self, time: int) -> Any:
        return self._make("builtin_interfaces/msg/Time", sec=time // 10**9, nanosec=time % 10**9)

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._store.types[kind](**fields)

    def _serialise(self, topic: str, **fields: Any) -> tuple[str, bytes]:
        kind = _TOPICS[topic]
        return topic, bytes(self._store.serialize_cdr(self._make(kind, **fields), kind))
