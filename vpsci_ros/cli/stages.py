"""Stages 1 and 2 and the evaluation as commands in one process: parameters in, files and a summary out."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
from rich.console import Console

from vpsci_ros.data.importers import IMPORTERS, import_trajectories
from vpsci_ros.data.interactions import table_hash
from vpsci_ros.data.near_misses import corpus_files, load_corpus, read_near_misses, split_by_name
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.errors import evaluate, print_errors
from vpsci_ros.learning.config import LearnerConfig, PretrainConfig, RefineConfig, require_learnable
from vpsci_ros.learning.online import LOG, refine
from vpsci_ros.learning.pretrain import pretrain
from vpsci_ros.parameters import settings_of
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.policy_file import SHIPPED, load_policy, named_policies
from vpsci_ros.policy.simulation import SimulationConfig, simulation_of
from vpsci_ros.policy.weights import Weights, load_weights
from vpsci_ros.report.learning import save_learning
from vpsci_ros.resources import weights_path
from vpsci_ros.runs.config import RunConfig, Sections
from vpsci_ros.runs.files import sha256, write_json
from vpsci_ros.runs.folder import RunFolder
from vpsci_ros.runs.progress import Bars, StageBar
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.runs.stop_request import stop_requested_by_signals

Stage1Inputs = tuple[LearnerConfig, PretrainConfig, NetworkConfig, pl.DataFrame, Sections]
Stage2Inputs = tuple[LearnerConfig, RefineConfig, SimulationConfig, Weights, pl.DataFrame, list[str | Path], Sections]


def run_pretraining(sections: Sections, folder: Path, *, quiet: bool = False) -> None:
    """Stage 1; goes on from a checkpoint that the same configuration left in `folder`.

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
    """Stage 2; goes on from the last whole portion of episodes that a stopped run left in `folder`.

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
    beside = "best.safetensors, refine_log.csv, learning.png, run.json"
    print(f"written: {folder / 'refined.safetensors'}; {beside} beside it")
    if not pl.read_csv(folder / LOG)["refreshes"][-1]:
        print(
            "note: too few episodes for a refresh of the policies (learner.refresh_every), so these acted by the "
            "weights of stage 1 all along",
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


def run_evaluation(data: Path, form: str, models: list[str], json_path: Path | None, *, held_out: bool = False) -> None:
    """Measure models and controls on near misses, print the table, write the JSON.

    :param models: policies beside the shipped ones, [NAME=]FILE.
    :param data: near-miss table, or a folder of recordings in one of the importers' formats.
    :param held_out: measure only clips that were held out of `models`, or of the shipped people where there are none.
    :raises InvalidInput: unknown format, unreadable data or weights, or no clip of the data was held out.
    """
    table = _near_misses(data, form)
    given = named_policies(models)
    paths = {name: weights_path(name) for name in SHIPPED} | given
    weights = {name: load_policy(path) for name, path in paths.items()}
    chosen = [weights[name] for name in given or SHIPPED[:1]]
    clips = set.intersection(*(set(own.facts.get("data", {}).get("held_out_clips", [])) for own in chosen))
    kept_out = table.filter(pl.concat_str("source", "clip", separator="/").is_in(sorted(clips)))
    if held_out and kept_out.is_empty():
        raise InvalidInput(f"{data}: none of its clips was held out of the weights' training, by their metadata")
    learned = table["interaction"].n_unique() - kept_out["interaction"].n_unique()
    if held_out:
        table = kept_out
    elif kept_out.height and learned:
        print(f"note: {learned} near misses here are of clips that weights have learned from; see --held-out")
    with Bars(f"measuring {table['interaction'].n_unique():,} near misses"):
        result = evaluate(table, weights)
    if json_path is not None:
        made_from = {
            "data": {"path": str(data), "sha256": table_hash(table)},
            "weights_sha256": {name: sha256(path) for name, path in paths.items()},
            "software": software_versions(),
        }
        write_json(json_path, result | made_from)
    print_errors(result, Console())
    if json_path is not None:
        print(f"written: {json_path}")


def _near_misses(data: Path, form: str) -> pl.DataFrame:
    if form == "near-misses" and data.is_dir():
        raise InvalidInput(f"{data}: for a folder of recordings give --format, one of {', '.join(IMPORTERS.names())}")
    if form == "near-misses":
        return read_near_misses(data)
    return import_trajectories(data, form).table


# ---- what a command that learns takes from the sections of a parameter file


def stage_1_inputs(sections: Sections) -> Stage1Inputs:
    """Return what stage 1 learns from: parameters, near misses, and all parameters as the run's folder keeps them.

    :raises InvalidInput: a parameter or the near misses are refused, or the section is of stage 2.
    """
    learner = _learner(sections, "pretrain")
    config, network = sections.get(PretrainConfig, "learner"), sections.get(NetworkConfig, "learner")
    resolved = Sections({"learner": _without_output(learner, config, network)})
    corpus = load_corpus(learner.near_misses)
    split_by_name(corpus, config.held_out_clips)  # refuses names before a folder is begun
    return learner, config, network, corpus, resolved


def stage_2_inputs(sections: Sections) -> Stage2Inputs:
    """Return what stage 2 learns from: parameters, weights and near misses, the files of both, and all parameters.

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


def _without_output(*configs: object) -> dict[str, object]:
    """Return the values of the learner's section without the output folder, no part of a run's identity."""
    return {name: value for name, value in settings_of(*configs).items() if name != "output"}
