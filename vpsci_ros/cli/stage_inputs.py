"""What a command that learns takes from the sections of a parameter file."""

from pathlib import Path
from typing import NamedTuple

import polars as pl

from vpsci_ros.data.near_misses import corpus_files, load_corpus
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import LearnerConfig, PretrainConfig, RefineConfig, require_learnable
from vpsci_ros.parameters import settings_of
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.simulation import SimulationConfig, simulation_of
from vpsci_ros.policy.weights import Weights, load_weights
from vpsci_ros.resources import weights_path
from vpsci_ros.runs.config import RunConfig, Sections


class Stage1Inputs(NamedTuple):
    """Near misses, what learns from them, and `resolved`: all parameters, as the run's folder keeps them."""

    learner: LearnerConfig
    config: PretrainConfig
    network: NetworkConfig
    near_misses: pl.DataFrame
    resolved: Sections


class Stage2Inputs(NamedTuple):
    """Weights and near misses, what learns on from them, and `files`, which all that was read from."""

    learner: LearnerConfig
    config: RefineConfig
    simulation: SimulationConfig
    weights: Weights
    near_misses: pl.DataFrame
    files: list[str | Path]
    resolved: Sections


def stage_1_inputs(sections: Sections) -> Stage1Inputs:
    """Return what stage 1 learns from.

    :raises InvalidInput: a parameter or the near misses are refused, or the section is of stage 2.
    """
    learner = _learner(sections, "pretrain")
    config, network = sections.get(PretrainConfig, "learner"), sections.get(NetworkConfig, "learner")
    resolved = Sections({"learner": _without_output(learner, config, network)})
    return Stage1Inputs(learner, config, network, _corpus(learner), resolved)


def stage_2_inputs(sections: Sections) -> Stage2Inputs:
    """Return what stage 2 learns from.

    :raises InvalidInput: a parameter, the weights or the near misses are refused, or the section is of stage 1.
    """
    learner, config, simulation = stage_2_parameters(sections)
    start = weights_path(learner.weights)
    resolved = {
        "learner": _without_output(learner, config),
        "world_simulator": settings_of(sections.get(RunConfig, "world_simulator"), simulation.world),
    } | {f"{agent}_policy": settings_of(policy) for agent, policy in simulation.policies.items()}
    files: list[str | Path] = [*corpus_files(learner.near_misses), start]
    return Stage2Inputs(learner, config, simulation, load_weights(start), _corpus(learner), files, Sections(resolved))


def stage_2_parameters(sections: Sections) -> tuple[LearnerConfig, RefineConfig, SimulationConfig]:
    """Return the parameters of stage 2 alone, for a study that has weights and near misses of its own.

    :raises InvalidInput: a parameter is refused, or the section is of stage 1.
    """
    learner, config, simulation = (
        _learner(sections, "refine"),
        sections.get(RefineConfig, "learner"),
        simulation_of(sections),
    )
    require_learnable(simulation.world)
    return learner, config, simulation


def _learner(sections: Sections, stage: str) -> LearnerConfig:
    learner = sections.get(LearnerConfig, "learner")
    if learner.stage != stage:
        raise InvalidInput(f"learner.stage = {learner.stage}: expected {stage}; give the parameter file of that stage")
    return learner


def _corpus(learner: LearnerConfig) -> pl.DataFrame:
    return load_corpus(learner.near_misses)


def _without_output(*configs: object) -> dict[str, object]:
    """Return the values of the learner's section without the output folder, no part of a run's identity."""
    return {name: value for name, value in settings_of(*configs).items() if name != "output"}
