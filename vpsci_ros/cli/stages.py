"""Stages 1 and 2 as commands in one process: their inputs by the sections of a parameter file, and their runs."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.data.corpus import corpus_files, held_out_by, load_corpus
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.online import LOG, refine
from vpsci_ros.learning.pretrain import pretrain
from vpsci_ros.learning.training_config import LearnerConfig, PretrainConfig, RefineConfig, require_learnable
from vpsci_ros.parameters import settings_of
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.simulation_config import SimulationConfig, simulation_of
from vpsci_ros.policy.weights import Weights, load_weights
from vpsci_ros.report.learning import save_learning
from vpsci_ros.runs.progress import StageBar
from vpsci_ros.runs.run_config import RunConfig, Sections
from vpsci_ros.runs.run_folder import RunFolder
from vpsci_ros.runs.stop_request import stop_requested_by_signals

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
    learner, config = _learner(sections, "refine"), sections.get(RefineConfig, "learner")
    simulation = simulation_of(sections)
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


def run_pretraining(sections: Sections, folder: Path, *, quiet: bool = False) -> None:
    """Run stage 1 in `folder`; resume from a checkpoint of the same configuration.

    :raises InvalidInput: a parameter or the near misses are refused, or another run lies in `folder`.
    :raises Stopped: a signal stopped it; what is done is in `folder`.
    """
    learner, config, network, corpus, resolved = stage_1_inputs(sections)

    def learn(bar: StageBar) -> dict[str, Any]:
        def report(values: dict[str, float]) -> None:
            bar.show(values)
            stop.check()

        with stop_requested_by_signals() as stop:
            weights = pretrain(
                corpus, config, network, seed=learner.seed, out_dir=folder, report=report, beginning=stop.at_once
            )
        return dict(weights.facts.get("held_out", {}))

    if _run(folder, RunFolder(folder, resolved, corpus_files(learner.near_misses)), StageBar("stage 1", quiet), learn):
        print(f"written: {folder / 'pretrained.safetensors'}; log.csv, learning.png, run.json beside it")


def run_refinement(sections: Sections, folder: Path, *, quiet: bool = False) -> None:
    """Run stage 2 in `folder`; resume a stopped run from its last checkpoint.

    :raises InvalidInput: as `run_pretraining`, or the weights to start from are refused.
    """
    learner, config, simulation, weights, corpus, files, resolved = stage_2_inputs(sections)

    def learn(bar: StageBar) -> dict[str, Any]:
        refined = refine(
            corpus, config, weights, simulation, learner_seed=learner.seed, out_dir=folder, report=bar.show
        )
        return {name: refined.facts[name] for name in ("held_out", "learned")}

    if not _run(folder, RunFolder(folder, resolved, files), StageBar("stage 2", quiet), learn):
        return
    print(f"written: {folder / 'refined.safetensors'}; refine_log.csv, learning.png, run.json beside it")
    if not pl.read_csv((folder / LOG).read_bytes())["refreshes"][-1]:
        print(
            "note: too few episodes for a refresh of the policies (learner.refresh_every), so these acted by the "
            "weights that stage 2 began with",
            file=sys.stderr,
        )


def _run(folder: Path, run: RunFolder, bar: StageBar, learn: Callable[[StageBar], dict[str, Any]]) -> bool:
    """Learn into the folder of a run, with its record and picture; return whether anything was left to do."""
    if run.done:
        print(f"{folder} holds this run, finished; nothing to do (delete the folder to train again)")
        return False
    with run, bar:
        try:
            run.results |= learn(bar)
        finally:
            save_learning(folder)
    return True
