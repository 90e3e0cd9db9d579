"""Parameters that only nodes have, and the configuration classes of each node."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.training_config import LearnerConfig, PretrainConfig, RefineConfig
from vpsci_ros.lockstep.simulator_config import SimulatorConfig
from vpsci_ros.parameters import build, parameter
from vpsci_ros.policy.policy_config import NetworkConfig, PolicyConfig
from vpsci_ros.runs.run_config import PatienceConfig, PeerConfig, RunConfig
from vpsci_ros.world.perception import PerceptionConfig
from vpsci_ros.world.world_config import WorldConfig

NODES = (
    "world_simulator",
    "safety_monitor",
    "vehicle_policy",
    "pedestrian_policy",
    "learner",
    "perception",
    "recorder",
)
EXECUTABLES = (*NODES, "replayer", "example_ads")  # of `vpsci node`


@dataclass(frozen=True)
class GraphConfig(PatienceConfig):
    """The nodes of a graph, and how they run together."""

    nodes: list[str] = parameter([*NODES[:4], "recorder"], "nodes to run", choices=NODES)
    namespace: str = parameter("", "namespace of all nodes, such as /left; empty: none")
    composed: bool = parameter(
        False,
        "true: all nodes run in one process, which suits few cores; if one node fails, all stop",
    )

    def __post_init__(self) -> None:
        parts = self.namespace.split("/")
        if self.namespace and (parts[0] or not all(part.isidentifier() for part in parts[1:])):
            raise InvalidInput(f"namespace = {self.namespace!r}: expected names after slashes, such as /left")


@dataclass(frozen=True)
class RecorderConfig:
    """The folder of the recorder's bag."""

    bag: str = parameter("out/bag", "folder of the bag, new or empty")


@dataclass(frozen=True)
class ReplayerConfig:
    """The bag that the replayer publishes, its first episode, and the rate."""

    bag: str = parameter("out/bag", "bag to publish: a rosbag2 folder (MCAP), or one of its files")
    rate: float = parameter(
        1.0, "ratio of recorded time to wall time; 0: as fast as subscribers read", low=0.0, high=1000.0
    )
    first_episode: str = parameter("", "episode to begin with, NUMBER or SCENARIO:NUMBER; empty: the bag's first")


SECTIONS: dict[str, tuple[type, ...]] = {
    "graph": (GraphConfig,),
    "world_simulator": (PeerConfig, RunConfig, SimulatorConfig, WorldConfig),
    "safety_monitor": (PeerConfig,),
    "vehicle_policy": (PeerConfig, PolicyConfig),
    "pedestrian_policy": (PeerConfig, PolicyConfig),
    "perception": (PeerConfig, PerceptionConfig),
    "recorder": (PeerConfig, RecorderConfig),
    "replayer": (PeerConfig, ReplayerConfig),
}
"""Section of a parameter file, the name of a node or `graph` for a run of nodes -> what it may hold."""

LEARNER: dict[str, tuple[type, ...]] = {
    "pretrain": (PeerConfig, LearnerConfig, NetworkConfig, PretrainConfig),
    "refine": (PeerConfig, LearnerConfig, RefineConfig),
}
"""Stage -> what the section `learner` may hold."""


def section_classes(section: str, values: Mapping[str, Any]) -> tuple[type, ...]:
    """Return the configuration classes of a section; those of the learner depend on its `stage`.

    :raises InvalidInput: there is no such stage.
    """
    if section != "learner":
        return SECTIONS[section]
    stage = {name: value for name, value in values.items() if name == "stage"}
    return LEARNER[build(LearnerConfig, stage, section).stage]
