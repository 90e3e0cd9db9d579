"""Stages 1 and 2 and the evaluation as commands in one process: parameters in, files and a summary out."""

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import polars as pl
from rich.console import Console

from vpsci_ros.analysis.error_table import print_errors
from vpsci_ros.analysis.errors import evaluate
from vpsci_ros.analysis.learning_figures import save_learning
from vpsci_ros.config import LearnerConfig, PolicyConfig, RunConfig, pick, require_one_noise
from vpsci_ros.data.corpus import load_corpus
from vpsci_ros.data.importers import FORMATS, import_trajectories
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import NetworkConfig, PretrainConfig, RefineConfig
from vpsci_ros.learning.interactions import table_hash
from vpsci_ros.learning.online import LOG, refine
from vpsci_ros.learning.pretrain import pretrain
from vpsci_ros.learning.weights import load_weights
from vpsci_ros.provenance import sha256, software_versions, written_whole
from vpsci_ros.resources import weights_path
from vpsci_ros.run_folder import RunFolder
from vpsci_ros.stage_bar import StageBar, stopped_between_updates
from vpsci_ros.world import WorldConfig, load_scenarios
from vpsci_ros.world.monitor import MonitorConfig

Sections = dict[str, dict[str, Any]]


def run_pretraining(sections: Sections, folder: Path, *, quiet: bool = False) -> None:
    """Stage 1; goes on from a checkpoint that the same configuration left in `folder`.

    :raises InvalidInput: a parameter or the near misses are refused, or another run lies in `folder`.
    :raises Stopped: a signal asked for it; what is done is in `folder`.
    """
    learner, config, network = learner_section(sections, LearnerConfig, PretrainConfig, NetworkConfig)
    corpus = corpus_of(learner, "pretrain")
    resolved = {"learner": as_section(learner, config, network)}
    run = RunFolder(folder, resolved, learner.near_misses)
    if run.done:
        print(f"{folder} holds this run, finished; nothing to do (delete the folder to train again)")
        return
    with run, StageBar("stage 1", quiet) as bar:

        def report(values: dict[str, float]) -> None:
            bar.show(values)
            check()

        try:
            with stopped_between_updates() as check:
                weights = pretrain(corpus, config, network, seed=learner.seed, out_dir=folder, report=report)
            run.results |= weights.facts.get("held_out", {})
        finally:
            save_learning(folder)
    print(f"written: {folder / 'pretrained.safetensors'}; log.csv, learning.png, run.json beside it")


def run_refinement(sections: Sections, folder: Path, *, quiet: bool = False) -> None:
    """Stage 2; goes on from the last whole portion of episodes that a stopped run left in `folder`.

    :raises InvalidInput: as `run_pretraining`, or the weights to start from are refused.
    """
    learner, config = learner_section(sections, LearnerConfig, RefineConfig)
    run, world, monitor = simulation_sections(sections)
    require_one_seed(sections, run)
    start = weights_path(learner.weights)
    weights, corpus = load_weights(start), corpus_of(learner, "refine")
    resolved = stage_2_record(learner, config, run, world, monitor)
    record = RunFolder(folder, resolved, [*learner.near_misses, start])
    if record.done:
        print(f"{folder} holds this run, finished; nothing to do (delete the folder to train again)")
        return
    with record, StageBar("stage 2", quiet) as bar:
        try:
            refined = refine(
                corpus,
                config,
                weights,
                scenarios=load_scenarios(run.scenarios),
                episodes=list(run.queue()),
                batch=run.batch,
                seed=run.seed,
                learner_seed=learner.seed,
                out_dir=folder,
                world=world,
                monitor=monitor,
                report=bar.show,
            )
            record.results |= {name: refined.facts[name] for name in ("held_out", "learned")}
        finally:
            save_learning(folder)
    print(f"written: {folder / 'refined.safetensors'}; refine_log.csv, learning.png, run.json beside it")
    if not pl.read_csv(folder / LOG)["refreshes"][-1]:
        print(
            "note: too few episodes for a refresh of the policies (learner.warm_up_steps, steps_per_update, "
            "updates_per_refresh), so these are the weights that it began with",
            file=sys.stderr,
        )


def corpus_of(learner: LearnerConfig, stage: str) -> pl.DataFrame:
    """Return the near misses of a learner's section, which must be of this stage; says so if they are synthetic.

    :raises InvalidInput: the section is the other stage's, or a file is refused.
    """
    if learner.stage != stage:
        raise InvalidInput(f"learner.stage = {learner.stage}: expected {stage}; give the parameter file of that stage")
    if not learner.near_misses:
        print("no near misses given: learning from the synthetic sample, good for trials only", file=sys.stderr)
    return load_corpus(learner.near_misses)


def require_one_seed(sections: Sections, run: RunConfig) -> None:
    """Refuse policies that explore by another noise or seed than a stage 2 in one process gives them.

    :raises InvalidInput: they would; in a graph their own seeds count.
    """
    require_one_noise(sections)
    for name in ("vehicle_policy", "pedestrian_policy"):
        policy = pick(PolicyConfig, sections.get(name, {}), name)
        if policy.explore and policy.seed != run.seed:
            raise InvalidInput(
                f"{name}.seed = {policy.seed}, but world_simulator.seed = {run.seed}: in one process both explore by "
                "the world's; give them the same, or run a graph"
            )


def stage_2_record(
    learner: LearnerConfig, config: RefineConfig, run: RunConfig, world: WorldConfig, monitor: MonitorConfig
) -> Sections:
    """Return the resolved parameters of a run of stage 2, as its folder keeps them."""
    return {
        "learner": as_section(learner, config),
        "world_simulator": as_section(run, world),
        "safety_monitor": as_section(monitor),
    }


def learner_section(sections: Sections, *kinds: type) -> list[Any]:
    """Return configuration objects of these classes from the section `learner`."""
    return [pick(kind, sections["learner"], "learner") for kind in kinds]


def simulation_sections(sections: Sections) -> tuple[RunConfig, WorldConfig, MonitorConfig]:
    """Return what says which episodes are simulated, and how."""
    world = sections["world_simulator"]
    return (
        pick(RunConfig, world, "world_simulator"),
        pick(WorldConfig, world, "world_simulator"),
        pick(MonitorConfig, sections["safety_monitor"], "safety_monitor"),
    )


def as_section(*configs: Any) -> dict[str, Any]:
    """Return the values of configuration objects, without the output folder, which a run is told apart from."""
    return {name: value for config in configs for name, value in asdict(config).items() if name != "output"}


def run_evaluation(
    data: Path, form: str, models: dict[str, str], json_path: Path | None, *, held_out: bool = False
) -> None:
    """Measure models and controls on near misses, print the table, write the JSON.

    :param data: near-miss table, or a folder of recordings in one of the importers' formats.
    :param held_out: measure only clips that the weights' metadata say were held out.
    :raises InvalidInput: unknown format, unreadable data or weights, or no clip of the data was held out.
    """
    table = _near_misses(data, form)
    paths = {name: weights_path(model) for name, model in models.items()}
    weights = {name: load_weights(path) for name, path in paths.items()}
    clips = set.intersection(*(set(w.facts.get("data", {}).get("held_out_clips", [])) for w in weights.values()))
    kept_out = table.filter(pl.concat_str("source", "clip", separator="/").is_in(sorted(clips)))
    if held_out and kept_out.is_empty():
        raise InvalidInput(f"{data}: none of its clips was held out of the weights' training, by their metadata")
    learned = table["interaction"].n_unique() - kept_out["interaction"].n_unique()
    if held_out:
        table = kept_out
    elif kept_out.height and learned:
        print(f"note: {learned} near misses here are of clips that weights have learned from; see --held-out")
    result = evaluate(table, weights)
    if json_path is not None:
        made_from = {
            "data": {"path": str(data), "sha256": table_hash(table)},
            "weights_sha256": {name: sha256(path) for name, path in paths.items()},
            "software": software_versions(),
        }
        with written_whole(json_path) as part:
            part.write_text(json.dumps(result | made_from, indent=2) + "\n", encoding="utf-8")
    print_errors(result, Console())
    if json_path is not None:
        print(f"written: {json_path}")


def _near_misses(data: Path, form: str) -> pl.DataFrame:
    if form == "near-misses" and data.is_dir():
        raise InvalidInput(f"{data}: for a folder of recordings give --format, one of {', '.join(FORMATS)}")
    if form == "near-misses":
        return read_near_misses(data)
    if form not in FORMATS:
        raise InvalidInput(f"--format {form}: expected near-misses or one of {', '.join(FORMATS)}")
    return import_trajectories(data, form).table
