"""What each section of a parameter file may hold: one entry a node, plus `graph` for the run as a whole.

The sections are the nodes' names, as ROS 2 wants them, and the commands that run in process read the same sections.
`dataset` is read by `vpsci generate` only, `ads_test` by `vpsci ads-test`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from vpsci_ros.analysis.exam.config import ExamConfig
from vpsci_ros.data.filters import FilterConfig
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import NetworkConfig, PretrainConfig, RefineConfig
from vpsci_ros.parameters import build, load_parameter_file, parameter
from vpsci_ros.world import WorldConfig
from vpsci_ros.world.monitor import MonitorConfig

NODES = ("world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy", "learner", "recorder")
EXECUTABLES = (*NODES, "replayer", "example_ads")  # of `ros2 run vpsci_ros` and `vpsci node`
T = TypeVar("T")


@dataclass(frozen=True)
class GraphConfig:
    """A run as a whole: which nodes it has."""

    nodes: list[str] = parameter([*NODES[:4], "recorder"], "nodes that make up the graph", choices=NODES)
    progress_timeout: float = parameter(
        60.0, "without progress for so long, the run is stopped with an error", unit="s", low=1.0, high=86400.0
    )
    restarts: int = parameter(
        0, "times that a policy that dies is started again, the world standing still meanwhile", low=0, high=1000
    )
    namespace: str = parameter("", "namespace of all nodes, such as /left; empty: none")

    def __post_init__(self) -> None:
        parts = self.namespace.split("/")
        if self.namespace and (parts[0] or not all(part.isidentifier() for part in parts[1:])):
            raise InvalidInput(f"namespace = {self.namespace!r}: expected names after slashes, such as /left")


@dataclass(frozen=True)
class PeerConfig:
    """What every node has: the peers it waits for before it speaks, and what runs its callbacks."""

    peers: list[str] = parameter([], "nodes of this graph; empty: only those without which this node cannot work")
    peer_timeout: float = parameter(
        60.0, "wait so long for peers to appear before giving up", unit="s", low=0.1, high=86400.0
    )
    executor: str = parameter(
        "events", "rclpy's executor: events, or the slower single-threaded one", choices=("events", "single")
    )


@dataclass(frozen=True)
class RunConfig:
    """Which episodes a run simulates, how many at once, and how fast."""

    seed: int = parameter(1, "seed of every random draw of the run", low=0, high=2**63 - 1)
    scenarios: list[int] = parameter([1, 2, 3, 4, 5, 6, 7, 8], "scenarios to run (Table 6)", low=1, high=8)
    episodes: int = parameter(8, "episodes to simulate in each scenario", low=1, high=4_000_000_000)
    first_episode: int = parameter(0, "number of the first episode of each scenario", low=0, high=4_000_000_000)
    batch: int = parameter(16, "episodes simulated in parallel, one message for all", low=1, high=65536)

    def __post_init__(self) -> None:
        if not self.scenarios or len(set(self.scenarios)) < len(self.scenarios):
            raise InvalidInput(f"scenarios must name at least one scenario, each once, got {self.scenarios}")
        if self.first_episode + self.episodes > 2**32:
            raise InvalidInput(
                f"first_episode + episodes = {self.first_episode + self.episodes} exceeds 2^32, the largest number"
            )

    def queue(self) -> Any:
        """Yield (scenario, episode number), scenarios in turn, so that every scenario grows at the same pace."""
        for episode in range(self.first_episode, self.first_episode + self.episodes):
            for scenario in self.scenarios:
                yield scenario, episode


@dataclass(frozen=True)
class LockStepConfig:
    """How the world simulator keeps step with its peers."""

    action_timeout: float = parameter(
        2.0,
        "without an answer for so long, the rule-based driver acts for the tick",
        unit="s",
        low=0.01,
        high=3600.0,
        read_only=False,
    )
    real_time_factor: float = parameter(
        0.0, "simulated over wall time; 0: as fast as possible", low=0.0, high=1000.0, read_only=False
    )
    recorded_bag: str = parameter("", "bag whose agents the replay drivers drive again: same scenarios and numbers")
    publish_transitions: bool = parameter(False, "publish /replay for a learner")
    replay_window: int = parameter(
        4096,
        "wait when the learner is so many transitions behind; 0: never wait",
        low=0,
        high=10_000_000,
        read_only=False,
    )


@dataclass(frozen=True)
class ExternalConfig:
    """How an external driving system drives the vehicle (`vehicle_driver: external`)."""

    external_mode: str = parameter(
        "lock_step",
        "lock_step: wait for a command at every tick, action_timeout at most; real_time: go on at real_time_factor "
        "(1 where that is 0), the last command holds",
        choices=("lock_step", "real_time"),
    )
    command_silence: float = parameter(
        0.5,
        "real time: without a command for so long, in simulated time, the vehicle brakes until commands come again",
        unit="s",
        low=0.05,
        high=60.0,
        read_only=False,
    )
    safe_stop_deceleration: float = parameter(
        5.0, "real time: a safe stop brakes so firmly at last", unit="m/s2", low=0.5, high=8.88, read_only=False
    )
    safe_stop_jerk: float = parameter(
        5.0, "real time: and gets there at this rate, from nothing", unit="m/s3", low=0.5, high=1000.0, read_only=False
    )


@dataclass(frozen=True)
class PolicyConfig:
    """One agent's learned policy."""

    weights: str = parameter("", "safetensors file; empty: wait for /policy/weights")
    explore: bool = parameter(False, "add the exploration noise of equation (16)", read_only=False)
    seed: int = parameter(1, "seed of the exploration noise", low=0, high=2**63 - 1)
    noise_start: float = parameter(0.3, "N_0 of (16)", unit="of the action limit", low=0.0, high=2.0, read_only=False)
    noise_decay: float = parameter(0.001, "beta of (16), per training episode", low=0.0, high=1.0, read_only=False)
    noise_floor: float = parameter(
        0.05, "N_min of (16)", unit="of the action limit", low=0.0, high=2.0, read_only=False
    )

    @property
    def noise(self) -> RefineConfig:
        """How much noise a policy adds that explores."""
        return RefineConfig(noise_start=self.noise_start, noise_decay=self.noise_decay, noise_floor=self.noise_floor)


@dataclass(frozen=True)
class LearnerConfig:
    """What the learner does, from what, and where it writes."""

    stage: str = parameter("pretrain", "stage 1 or stage 2", choices=("pretrain", "refine"))
    near_misses: list[str] = parameter([], "Parquet files of real near misses; empty: the synthetic sample")
    weights: str = parameter("", "stage 2: safetensors file to start from")
    output: str = parameter("out/learner", "folder for weights, log and checkpoints")
    seed: int = parameter(1, "seed of initial weights and sampling", low=0, high=2**63 - 1)


def require_one_noise(sections: dict[str, dict[str, Any]]) -> None:
    """Refuse a stage 2 whose policies explore by another noise than its learner's section says.

    In a graph it is the policies' section that counts, in one process the learner's; with both alike, one parameter
    file means the same either way.

    :raises InvalidInput: they differ.
    """
    learner = pick(RefineConfig, sections["learner"], "learner")
    for name in ("vehicle_policy", "pedestrian_policy"):
        policy = pick(PolicyConfig, sections.get(name, {}), name)
        for part in ("noise_start", "noise_decay", "noise_floor") if policy.explore else ():
            mine, theirs = getattr(policy, part), getattr(learner, part)
            if mine != theirs:
                raise InvalidInput(
                    f"{name}.{part} = {mine:g}, but learner.{part} = {theirs:g}: (16) is one noise; give both the same"
                )


@dataclass(frozen=True)
class RecorderConfig:
    """The bag: where it goes and what it holds."""

    bag: str = parameter("out/bag", "folder of the bag; must not exist or be empty")
    chunk_size: int = parameter(
        256, "messages are compressed and written in chunks of this size", unit="KiB", low=1, high=65536
    )
    split_size: int = parameter(
        2**30, "begin another file when one has this size; 0: one file, however large", unit="B", low=0, high=10**12
    )


@dataclass(frozen=True)
class ReplayerConfig:
    """Which bag is published, from where on, how fast, and what of it."""

    bag: str = parameter("out/bag", "bag to publish: a rosbag2 folder, MCAP or sqlite3, or one of its files")
    rate: float = parameter(
        1.0, "recorded over wall time; 0: as fast as the readers take it", low=0.0, high=1000.0, read_only=False
    )
    first_episode: str = parameter("", "begin with this one, its number or SCENARIO:NUMBER; empty: at the beginning")
    topics: list[str] = parameter([], "publish these only; empty: all that the bag holds")
    leave_out: list[str] = parameter([], "topics that are not published")
    paused: bool = parameter(False, "begin paused, to be stepped or resumed by the services")


@dataclass(frozen=True)
class DatasetConfig:
    """What a dataset holds and how it is computed; the bounds of its filters stand beside it in the same section."""

    kept: int = parameter(
        0, "kept episodes wanted in each scenario; 0: the counts of Table 10", low=0, high=1_000_000_000
    )
    formats: list[str] = parameter(["parquet"], "files to write for each scenario", choices=("parquet", "csv"))
    keep_rejected: bool = parameter(False, "write rejected episodes, too, to the folder rejected/")
    unit: int = parameter(1024, "episodes in one unit of work", low=1, high=1_000_000)
    parallel: int = parameter(512, "episodes that one worker simulates side by side", low=1, high=65536)
    give_up: float = parameter(
        100.0, "stop when so many times the kept episodes wanted were simulated and not kept", low=1.0, high=1e9
    )


SECTIONS: dict[str, tuple[type, ...]] = {
    "graph": (GraphConfig,),
    "world_simulator": (PeerConfig, RunConfig, LockStepConfig, ExternalConfig, WorldConfig),
    "safety_monitor": (PeerConfig, MonitorConfig),
    "vehicle_policy": (PeerConfig, PolicyConfig),
    "pedestrian_policy": (PeerConfig, PolicyConfig),
    "learner": (PeerConfig, LearnerConfig, NetworkConfig, PretrainConfig, RefineConfig),
    "recorder": (PeerConfig, RecorderConfig),
    "replayer": (PeerConfig, ReplayerConfig),
    "dataset": (DatasetConfig, FilterConfig),
    "ads_test": (ExamConfig,),
}


def load(path: str | Path) -> dict[str, dict[str, Any]]:
    """Read a parameter file: section name -> values that it sets.

    :raises InvalidInput: see `vpsci_ros.parameters.load_parameter_file`.
    """
    return load_parameter_file(path, SECTIONS)


def pick(config: type[T], values: dict[str, Any], where: str) -> T:
    """Build one of a section's configuration classes from the section's values."""
    names = config.__dataclass_fields__  # type: ignore[attr-defined]
    return build(config, {k: v for k, v in values.items() if k in names}, where)


def override(sections: dict[str, dict[str, Any]], assignments: list[str]) -> None:
    """Apply `node.parameter=value` assignments in place; values are YAML.

    :raises InvalidInput: not of that form, or an unknown node, parameter or value.
    """
    import yaml

    from vpsci_ros.parameters import refuse_unknown, table

    for text in assignments:
        target, found, value = text.partition("=")
        node, dot, name = target.partition(".")
        if not found or not dot:
            raise InvalidInput(f"--set {text}: expected NODE.PARAMETER=VALUE")
        refuse_unknown({node: None}, SECTIONS, f"--set {text}")
        rows = {row.name: row for config in SECTIONS[node] for row in table(config)}
        refuse_unknown({name: None}, rows, f"--set {text}")
        sections[node][name] = rows[name].check(yaml.safe_load(value), f"--set {text}")
