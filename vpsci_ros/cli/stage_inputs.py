"""Inputs of stages 1 and 2 from the sections of a parameter file: configurations, near misses and weights."""

from pathlib import Path

import polars as pl

from vpsci_ros.data.near_misses import corpus_files, load_corpus
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.held_out import held_out_by
from vpsci_ros.learning.training_config import LearnerConfig, PretrainConfig, RefineConfig, require_learnable
from vpsci_ros.parameters import settings_of
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.simulation_config import SimulationConfig, simulation_of
from vpsci_ros.policy.weights import Weights, load_weights
from vpsci_ros.runs.run_config import RunConfig, Sections

Stage1Inputs = tuple[LearnerConfig, PretrainConfig, NetworkConfig, pl.DataFrame, Sections]
Stage2Inputs = tuple[LearnerConfig, RefineConfig, SimulationConfig, Weights, pl.DataFrame, list[str | Path], Sections]


def stage_1_inputs(sections: Sections) -> Stage1Inputs:
    """Return the inputs of stage 1: its three configurations, near misses, and the sections to store with the run.

    :raises InvalidInput: a parameter or the near misses are refused, or the section is of stage 2.
    """
    learner = _learner(sections, "pretrain")
    config, network = sections.get(PretrainConfig, "learner"), sections.get(NetworkConfig, "learner")
    resolved = Sections({"learner": _without_output(learner, config, network)})
    corpus = load_corpus(learner.near_misses)
    held_out_by(corpus, config.held_out_clips)  # refuses names before a folder is begun
    return learner, config, network, corpus, resolved


def stage_2_inputs(sections: Sections) -> Stage2Inputs:
    """Return the inputs of stage 2: configurations, weights, near misses, files of both, and the sections to store.

    :raises InvalidInput: a parameter, the weights or the near misses are refused, or the section is of stage 1.
    """
    learner, config, simulation = stage_2_parameters(sections)
    start = learner.start()
    resolved = {
        "learner": _without_output(learner, config),
        "world_simulator": settings_of(sections.get(RunConfig, "world_simulator"), simulation.world),
    } | {f"{agent}_policy": settings_of(policy) for agent, policy in simulation.policies.items()}
    files: list[str | Path] = [*corpus_files(learner.near_misses), start]
    corpus = load_corpus(learner.near_misses)
    return learner, config, simulation, load_weights(start), corpus, files, Sections(resolved)


def stage_2_parameters(sections: Sections) -> tuple[LearnerConfig, RefineConfig, SimulationConfig]:
    """Return the configurations of stage 2 alone, for a study with its own weights and near misses.

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


def _without_output(*configs: object) -> dict[str, object]:
    """Return the values of the learner's section without the output folder, no part of a run's identity."""
    return {name: value for name, value in settings_of(*configs).items() if name != "output"}
