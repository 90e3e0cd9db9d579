"""Stages 1 and 2 and the evaluation as commands in one process: parameters in, files and a summary out."""

import json
import sys
from pathlib import Path
from typing import Any

import polars as pl
from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from vpsci_ros.analysis.errors import evaluate
from vpsci_ros.config import LearnerConfig, RunConfig, pick
from vpsci_ros.data.corpus import load_corpus
from vpsci_ros.data.importers import FORMATS, import_trajectories
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import NetworkConfig, PretrainConfig, RefineConfig
from vpsci_ros.learning.online import refine
from vpsci_ros.learning.pretrain import pretrain
from vpsci_ros.learning.weights import load_weights
from vpsci_ros.provenance import written_whole
from vpsci_ros.resources import weights_path
from vpsci_ros.world import WorldConfig, load_scenarios
from vpsci_ros.world.monitor import MonitorConfig

Sections = dict[str, dict[str, Any]]


def run_pretraining(sections: Sections, folder: Path, *, quiet: bool = False) -> None:
    """Stage 1; goes on from a checkpoint that the same configuration left in `folder`.

    :raises InvalidInput: a parameter or the near misses are refused, or another run's checkpoint lies in `folder`.
    """
    values = sections["learner"]
    learner = pick(LearnerConfig, values, "learner")
    corpus = load_corpus(learner.near_misses)
    with _Bar("stage 1", quiet) as bar:
        pretrain(
            corpus,
            pick(PretrainConfig, values, "learner"),
            pick(NetworkConfig, values, "learner"),
            seed=learner.seed,
            out_dir=folder,
            report=lambda report: bar.show(report, "episode", "episodes"),
        )
    print(f"written: {folder / 'pretrained.safetensors'}, log.csv beside it")


def run_refinement(sections: Sections, folder: Path, *, quiet: bool = False) -> None:
    """Stage 2; goes on from a checkpoint as stage 1 does.

    :raises InvalidInput: as `run_pretraining`, or the weights to start from are refused.
    """
    values = sections["learner"]
    learner, run = (
        pick(LearnerConfig, values, "learner"),
        pick(RunConfig, sections["world_simulator"], "world_simulator"),
    )
    weights = load_weights(weights_path(learner.weights))
    with _Bar("stage 2", quiet) as bar:
        refine(
            load_corpus(learner.near_misses),
            pick(RefineConfig, values, "learner"),
            weights,
            scenarios=load_scenarios(run.scenarios),
            episodes=list(run.queue()),
            batch=run.batch,
            seed=run.seed,
            out_dir=folder,
            world=pick(WorldConfig, sections["world_simulator"], "world_simulator"),
            monitor=pick(MonitorConfig, sections["safety_monitor"], "safety_monitor"),
            report=lambda report: bar.show(report, "simulated", "episodes_wanted"),
        )
    print(f"written: {folder / 'refined.safetensors'}, refine_log.csv beside it")


def run_evaluation(data: Path, form: str, models: dict[str, str], json_path: Path | None) -> None:
    """Measure models and controls on near misses, print the table, write the JSON.

    :param data: near-miss table, or a folder of recordings in one of the importers' formats.
    :raises InvalidInput: unknown format, unreadable data or weights.
    """
    table = _near_misses(data, form)
    result = evaluate(table, {name: load_weights(weights_path(path)) for name, path in models.items()})
    if json_path is not None:
        with written_whole(json_path) as part:
            part.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    title = f"{result['interactions']} interactions of {result['clips']} clips, mean error in metres"
    view = Table(box=box.SIMPLE_HEAD, title=title, padding=(0, 1, 0, 0))
    view.add_column("", no_wrap=True)
    for name in ("recon-\nstruction\nADE", "\n\nFDE", "closed\nloop\nADE", "\n\nFDE", "\nits share of\nthe control's"):
        view.add_column(name, justify="right", no_wrap=True)
    for name, errors in result["models"].items():
        reconstruction, loop = errors["reconstruction"], errors["closed_loop"]
        ratio = "{:.2f} ({:.2f}-{:.2f})".format(loop["ade_ratio"], *loop["ade_ratio_interval"])
        cells = [f"{value:.3f}" for value in (reconstruction["ade"], reconstruction["fde"], loop["ade"], loop["fde"])]
        view.add_row(name, *cells, ratio)
    Console().print(view)
    Console().print("Intervals: 95%, clips resampled." + (f" Written: {json_path}" if json_path else ""))


def _near_misses(data: Path, form: str) -> pl.DataFrame:
    if form == "near-misses":
        return read_near_misses(data)
    if form not in FORMATS:
        raise InvalidInput(f"--format {form}: expected near-misses or one of {', '.join(FORMATS)}")
    return import_trajectories(data, form).table


class _Bar:
    """A progress bar of a stage on standard error; lines now and then where there is no terminal."""

    def __init__(self, title: str, quiet: bool) -> None:
        console = Console(stderr=True)
        self._lines = not console.is_terminal and not quiet
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        last = (TimeRemainingColumn(), TextColumn("{task.fields[note]}"))
        self._bar = Progress(*columns, *last, console=console, disable=not console.is_terminal or quiet)
        self._task = self._bar.add_task(title, total=None, note="")
        self._latest: dict[str, float] = {}
        self._said = 0

    def __enter__(self) -> "_Bar":
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def show(self, report: dict[str, float], done: str, total: str) -> None:
        """Take the latest numbers in and bring the display up to date."""
        self._latest |= report
        worth = ("closed_loop_ade", "held_out_closed_loop_ade", "collision_rate", "goal_rate", "rollbacks")
        note = ", ".join(f"{name.replace('_', ' ')} {self._latest[name]:.3g}" for name in worth if name in self._latest)
        self._bar.update(self._task, completed=report[done], total=report[total], note=note)
        tenth = int(10 * report[done] / report[total])
        if self._lines and tenth > self._said:
            self._said = tenth
            print(f"  {report[done]:.0f} of {report[total]:.0f}; {note}", file=sys.stderr, flush=True)
