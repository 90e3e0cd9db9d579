"""How like people the policies behave, as a command: read, measure by `evaluation.realism`, write and print."""

import json
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray
from rich.console import Console

from vpsci_ros.data import reference
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.interactions import table_hash
from vpsci_ros.data.near_misses import folds_by_clip, read_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.realism.free import as_near_misses
from vpsci_ros.evaluation.realism.onsets import Onsets
from vpsci_ros.evaluation.realism.run import RealismConfig, measure_realism
from vpsci_ros.evaluation.realism.simulators import Simulator, policy
from vpsci_ros.evaluation.realism.table import print_realism
from vpsci_ros.policy.policy_file import SHIPPED, Policy, load_policy, named_policies
from vpsci_ros.policy.weights import load_weights
from vpsci_ros.report.beside import save_beside
from vpsci_ros.report.realism import save_realism
from vpsci_ros.resources import near_misses_path, weights_path
from vpsci_ros.runs.files import sha256, write_json
from vpsci_ros.runs.folder import RunFolder
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.runs.sections import Sections

RESULT, PICTURE, BESIDE = "realism.json", "realism.png", "beside.png"


@dataclass(frozen=True)
class RealismStudy:
    """What is scored, and beside what; `vpsci realism --help` says more of each."""

    data: Path  # near misses to be scored on
    library: Path | None  # near misses whose residuals the control borrows; None: other clips of the table of `data`
    weights: list[str] | None  # further weights, [NAME=]FILE
    folds: Path | None  # folder of a study of folds on `data`
    dataset: Path | None  # folder of generated episodes
    conflicts: Path | None  # datlong.csv of the right-turn study
    held_out: bool  # only clips that no weights given have learned from
    clean: bool  # without cars that stand and tracks that begin critical
    seed: int  # of all that is drawn
    episodes: int  # of the dataset that are looked at, at most


def run_realism(study: RealismStudy, json_path: Path | None, output: Path | None, *, quiet: bool = False) -> None:
    """Measure, write and print the tables; go on with what a stopped run left in `output`.

    :param json_path: file for all numbers; output: folder for numbers, picture and record of the run.
    :raises InvalidInput: a file is refused, a name is there twice, or no clip of the data was held out.
    """
    table = read_near_misses(study.data)
    given = named_policies(study.weights or [])
    files = {name: weights_path(name) for name in SHIPPED} | given
    loaded = {name: load_policy(path) for name, path in files.items()}
    if study.held_out:
        table = _kept_out(table, [loaded[name] for name in given or SHIPPED[:1]], study.data)
    simulators = {name: policy(own, study.seed) for name, own in loaded.items()}
    if study.folds is not None:
        simulators |= _of_folds(study.folds, table, study.seed)
    inputs = [*files.values(), *([] if study.conflicts is None else [study.conflicts])]
    inputs += [near_misses_path(name) for name in (study.data, study.library) if name is not None]
    inputs += [] if study.folds is None else sorted(study.folds.glob("fold_*/**/*.safetensors"))
    dataset = None if study.dataset is None else Dataset(study.dataset)
    inputs += [] if dataset is None else dataset.inputs.values()
    chosen = ("clean", "held_out", "seed", "episodes")
    resolved = {name: getattr(study, name) for name in chosen} | {
        "models": list(simulators),
        "data": str(study.data),
        "library": str(study.library or ""),
        "dataset": str(study.dataset or ""),
        "folds": str(study.folds or ""),
    }
    run = None if output is None else RunFolder(output, Sections({"realism": resolved}), inputs)
    if output is not None and run is not None and run.done:
        print_realism(json.loads((output / RESULT).read_text(encoding="utf-8")), Console())
        print(f"{output} holds this run, finished; nothing was measured again")
        return
    with run or nullcontext(), Bars(quiet=quiet) as bars:
        result = measure_realism(
            table,
            simulators,
            RealismConfig(clean=study.clean, seed=study.seed, episodes=study.episodes),
            library=read_near_misses(study.library or near_misses_path(study.data)),
            dataset=dataset,
            conflicts=study.conflicts,
            parts=output,
            inputs=None if run is None else run.inputs,
            notify=lambda name, done, total: bars.bar("realism", done, total, name),
        )
        result |= {
            "data": {"path": str(study.data), "sha256": table_hash(table)},
            "weights_sha256": {name: sha256(path) for name, path in files.items()},
            "parameters": resolved,
            "software": software_versions(),
        }
        if output is not None:
            write_json(output / RESULT, result)
            save_realism(result, output / PICTURE)
            if dataset is not None:
                made = as_near_misses(dataset, study.episodes, study.seed)
                save_beside(reference.clean(table), made, output / BESIDE, study.seed)
    if json_path is not None:
        write_json(json_path, result)
    print_realism(result, Console(width=None if sys.stdout.isatty() else 130))
    for path in (json_path, output):
        if path is not None:
            print(f"written: {path}")


def _kept_out(table: pl.DataFrame, policies: Sequence[Policy], data: Path) -> pl.DataFrame:
    clips = set.intersection(*(set(own.facts.get("data", {}).get("held_out_clips", [])) for own in policies))
    kept = table.filter(pl.concat_str("source", "clip", separator="/").is_in(sorted(clips)))
    if kept.is_empty():
        raise InvalidInput(f"{data}: none of its clips was held out of the policies, by their metadata")
    return kept


def _of_folds(study: Path, table: pl.DataFrame, seed: int) -> dict[str, Simulator]:
    """Return simulators in which each onset is answered by the fold's weights that never saw its clip."""
    folders = sorted(study.glob("fold_*"), key=lambda path: int(path.name.removeprefix("fold_")))
    try:
        of: dict[str, Any] = json.loads((folders[0] / "study.json").read_text(encoding="utf-8"))["of"]
    except (IndexError, OSError, ValueError, KeyError):
        raise InvalidInput(f"{study}: expected the folder of a `vpsci study folds`") from None
    if of["data"] != table_hash(table):
        raise InvalidInput(f"{study}: its trainings are from other near misses; give --data the same table")
    owner: dict[str, int] = {}
    for number, (_, held) in enumerate(folds_by_clip(table, of["folds"], of["seed"]), 1):
        owner |= dict.fromkeys(held.select(pl.concat_str("source", "clip", separator="/")).to_series(), number)
    found: dict[str, dict[int, Path]] = {}
    for number, folder in enumerate(folders, 1):
        for path in (folder / "pretrained.safetensors", folder / "refined" / "refined.safetensors"):
            if path.is_file():
                found.setdefault(f"{path.stem}_folds", {})[number] = path
    whole = {name: files for name, files in found.items() if len(files) == of["folds"]}
    return {name: partial(_by_fold, files, owner, seed) for name, files in whole.items()}


def _by_fold(files: dict[int, Path], owner: dict[str, int], seed: int, onsets: Onsets) -> NDArray[np.float64]:
    numbers = np.array([owner[clip] for clip in onsets.clip])
    out: NDArray[np.float64] | None = None
    for number, path in files.items():
        rows = np.flatnonzero(numbers == number)
        if rows.size:
            positions = policy(load_weights(path), seed)(onsets.take(rows))
            out = np.zeros((len(onsets), *positions.shape[1:])) if out is None else out
            out[rows] = positions
    assert out is not None
    return out
