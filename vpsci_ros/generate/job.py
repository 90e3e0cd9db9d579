"""What a dataset is made from: everything that its bytes depend on, and nothing else."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from vpsci_ros.config import DatasetConfig, PolicyConfig, RunConfig, pick
from vpsci_ros.data.filters import FilterConfig
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import AGENTS
from vpsci_ros.learning.weights import weights_from_bytes
from vpsci_ros.provenance import cpu_name, sha256
from vpsci_ros.resources import weights_path
from vpsci_ros.world import Scenario, WorldConfig, load_scenarios
from vpsci_ros.world.monitor import MonitorConfig
from vpsci_ros.world.scenario import scenario_files


class Unit(NamedTuple):
    """A piece of work: episodes of one scenario, by their numbers in rising order."""

    scenario: int
    numbers: Sequence[int]


@dataclass(frozen=True)
class Policy:
    """One agent's policy: the bytes of its weights file, and its exploration."""

    data: bytes
    name: str
    config: PolicyConfig

    @property
    def digest(self) -> str:
        """SHA-256 of the weights file."""
        return hashlib.sha256(self.data).hexdigest()

    @property
    def file(self) -> str:
        """Name of the copy that lies in the dataset's folder."""
        return f"weights-{self.digest[:12]}.safetensors"


@dataclass(frozen=True)
class Job:
    """What every episode is a pure function of, besides its scenario and number.

    :ivar policies: by agent; an agent whose driver is not a policy has none.
    :ivar keep_rejected: keep the frames of rejected episodes, too.
    """

    seed: int
    scenarios: tuple[Scenario, ...]
    world: WorldConfig
    monitor: MonitorConfig
    filters: FilterConfig
    policies: Mapping[str, Policy]
    keep_rejected: bool

    def description(self) -> dict[str, Any]:
        """Return the job as JSON values: resolved configuration, hashes of weights and scenario files, kind of CPU."""
        files = {path.stem: path for path in scenario_files()}
        return {
            "seed": self.seed,
            "period": self.world.tick,
            "configuration": {
                "world_simulator": {"scenarios": [s.number for s in self.scenarios], **asdict(self.world)},
                "safety_monitor": asdict(self.monitor),
                **{f"{agent}_policy": asdict(policy.config) for agent, policy in self.policies.items()},
                "dataset": {"keep_rejected": self.keep_rejected, **asdict(self.filters)},
            },
            "weights": {
                agent: {"name": policy.name, "sha256": policy.digest, "file": policy.file}
                for agent, policy in self.policies.items()
            },
            "scenario_files": {s.name: sha256(files[s.name]) for s in self.scenarios},
            "cpu": cpu_name(),
        }


def job_from(sections: Mapping[str, dict[str, Any]], weights: Mapping[str, Path] | None = None) -> Job:
    """Build a job from the sections of a parameter file.

    :param weights: by agent, a weights file to take instead of the one that the sections name.
    :raises InvalidInput: a parameter, a scenario or a weights file is refused, or a driver needs somebody outside.
    """
    run = pick(RunConfig, sections["world_simulator"], "world_simulator")
    world = pick(WorldConfig, sections["world_simulator"], "world_simulator")
    policies = {}
    for agent in AGENTS:
        driver = getattr(world, f"{agent}_driver")
        if driver in ("external", "replay"):
            raise InvalidInput(f"world_simulator: {agent}_driver = {driver} has nobody to answer it while generating")
        if driver == "policy":
            values = dict(sections[f"{agent}_policy"])
            values["weights"] = str((weights or {}).get(agent, values.get("weights", "")))
            policies[agent] = _policy(pick(PolicyConfig, values, f"{agent}_policy"), f"{agent}_policy")
    if len({policy.digest for policy in policies.values()}) == 1:  # one object, so that it travels once
        data = next(iter(policies.values())).data
        policies = {agent: Policy(data, policy.name, policy.config) for agent, policy in policies.items()}
    return Job(
        seed=run.seed,
        scenarios=tuple(load_scenarios(run.scenarios)),
        world=world,
        monitor=pick(MonitorConfig, sections["safety_monitor"], "safety_monitor"),
        filters=pick(FilterConfig, sections["dataset"], "dataset"),
        policies=policies,
        keep_rejected=pick(DatasetConfig, sections["dataset"], "dataset").keep_rejected,
    )


def _policy(config: PolicyConfig, where: str) -> Policy:
    if not config.weights:
        raise InvalidInput(f"{where}: weights is empty; name a safetensors file, or weights shipped with the package")
    path = weights_path(config.weights)
    data = path.read_bytes()
    weights_from_bytes(data, str(path))
    named = replace(config, weights=path.stem)  # where a file lies is nobody's business
    return Policy(data, path.stem, named)


def fingerprint(description: Mapping[str, Any]) -> str:
    """Return a hash of a description, equal for equal JSON."""
    return hashlib.sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()
