"""The job of a dataset: the values that its episodes depend on."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from vpsci_ros.data.filters import FilterConfig
from vpsci_ros.errors import InvalidInput
from vpsci_ros.lockstep.engines import require_own
from vpsci_ros.lockstep.simulator_config import SimulatorConfig
from vpsci_ros.parameters import parameter, values_of
from vpsci_ros.policy.compiling import compile_kernels
from vpsci_ros.policy.policy_config import LEARNED, PolicyConfig
from vpsci_ros.policy.policy_file import policy_from_bytes, require_source
from vpsci_ros.resources import weights_path
from vpsci_ros.runs.provenance import cpu_name
from vpsci_ros.runs.run_config import RunConfig, Sections
from vpsci_ros.world import Scenario, WorldConfig, load_scenarios
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.scenario import own_documents


@dataclass(frozen=True)
class DatasetConfig:
    """The content of a dataset: its number of kept episodes, its file formats, and whether it has rejected episodes."""

    kept: int = parameter(
        0,
        "kept episodes of each scenario; 0: the paper's counts (Table 10)",
        low=0,
        high=1_000_000_000,
    )
    formats: list[str] = parameter(["parquet"], "formats of the file of each scenario", choices=("parquet", "csv"))
    keep_rejected: bool = parameter(False, "also write rejected episodes, to the folder rejected/")


RECORDED = {
    "world_simulator": (RunConfig, WorldConfig),
    "vehicle_policy": (PolicyConfig,),
    "pedestrian_policy": (PolicyConfig,),
    "dataset": (DatasetConfig, FilterConfig),
}
"""Section of the configuration that a dataset records -> the classes of its parameters."""


class Unit(NamedTuple):
    """A unit of work: episodes of one scenario, with increasing numbers."""

    scenario: int
    numbers: Sequence[int]

    def __str__(self) -> str:
        return f"scenario {self.scenario} from {self.numbers[0]}"


@dataclass(frozen=True)
class Policy:
    """One agent's policy: the bytes of its file (weights or a bank), and its exploration."""

    data: bytes
    name: str
    config: PolicyConfig

    def named(self, name: str) -> "Policy":
        """Return the policy under another name, in its configuration, too."""
        return replace(self, name=name, config=replace(self.config, weights=name))

    @property
    def digest(self) -> str:
        """SHA-256 of the policy's file."""
        return hashlib.sha256(self.data).hexdigest()

    @property
    def file(self) -> str:
        """Name of the copy of the policy's file in the dataset's folder."""
        return f"weights-{self.digest[:12]}.safetensors"


@dataclass(frozen=True)
class Job:
    """Everything that an episode depends on, besides its scenario and number.

    :ivar policies: by agent; an agent whose driver is not a policy has none.
    :ivar keep_rejected: keep the frames of rejected episodes.
    """

    seed: int
    scenarios: tuple[Scenario, ...]
    world: WorldConfig
    filters: FilterConfig
    policies: Mapping[str, Policy]
    keep_rejected: bool

    def compile_kernels(self) -> None:
        """Compile what the job's episodes need, see `vpsci_ros.policy.compiling`."""
        compile_kernels(*(policy_from_bytes(policy.data, policy.name) for policy in self.policies.values()))

    def description(self) -> dict[str, Any]:
        """Return the job as JSON values: resolved configuration, hashes of weights and scenario files, kind of CPU."""
        return {
            "seed": self.seed,
            "period": self.world.tick,
            "configuration": {
                "world_simulator": {"scenarios": [s.number for s in self.scenarios], **values_of(self.world)},
                **{f"{agent}_policy": values_of(policy.config) for agent, policy in self.policies.items()},
                "dataset": {"keep_rejected": self.keep_rejected, **asdict(self.filters)},
            },
            "weights": {
                agent: {"name": policy.name, "sha256": policy.digest, "file": policy.file}
                for agent, policy in self.policies.items()
            },
            "scenario_files": {s.name: s.sha256 for s in self.scenarios},
            "cpu": cpu_name(),
        } | ({"own_scenarios": own} if (own := own_documents(self.scenarios)) else {})


def job_from(
    sections: Sections, weights: Mapping[str, Path] | None = None, own: Sequence[Scenario] | None = None
) -> Job:
    """Build a job from the sections of a parameter file.

    :param weights: by agent, a weights file in place of the one in the sections.
    :param own: your own scenarios, in place of the files in the sections.
    :raises InvalidInput: a parameter, a scenario or a weights file is refused, or a driver waits for outside answers.
    """
    run = sections.get(RunConfig, "world_simulator")
    world = sections.get(WorldConfig, "world_simulator")
    simulator = sections.get(SimulatorConfig, "world_simulator")
    require_own(simulator.engine, "a dataset is generated")
    if simulator.episode_changes:
        raise InvalidInput("world_simulator.episode_changes: a dataset's episodes are as drawn; take it out")
    if run.only:
        raise InvalidInput("world_simulator.only: a dataset has the episodes that it keeps; take it out")
    policies = {}
    for agent in AGENTS:
        driver = getattr(world, f"{agent}_driver")
        if driver in ("external", "replay"):
            raise InvalidInput(f"world_simulator: {agent}_driver = {driver} has nobody to answer it while generating")
        if driver == "policy":
            config = sections.get(PolicyConfig, f"{agent}_policy")
            config = replace(config, weights=str((weights or {}).get(agent, config.weights)))
            policies[agent] = _policy(config, f"{agent}_policy")
    if len({policy.digest for policy in policies.values()}) == 1:  # one object, so that it travels once
        data = next(iter(policies.values())).data
        policies = {agent: Policy(data, policy.name, policy.config) for agent, policy in policies.items()}
    return Job(
        seed=run.seed,
        scenarios=tuple(load_scenarios(run.scenarios, run.scenario_files if own is None else own)),
        world=world,
        filters=sections.get(FilterConfig, "dataset"),
        policies=policies,
        keep_rejected=sections.get(DatasetConfig, "dataset").keep_rejected,
    )


def _policy(config: PolicyConfig, where: str) -> Policy:
    if config.agent != LEARNED:
        raise InvalidInput(
            f"{where}.agent = {config.agent}: a dataset is made by a bank or weights alone; run this one by "
            "`vpsci graph` and make tables of its bag by `vpsci bag export`"
        )
    if not config.weights:
        raise InvalidInput(f"{where}: weights is empty; name a safetensors file, or weights shipped with the package")
    path = weights_path(config.weights)
    data = path.read_bytes()
    require_source(policy_from_bytes(data, str(path)), config.people)
    named = replace(config, weights=path.stem)  # where a file lies is nobody's business
    return Policy(data, path.stem, named)
