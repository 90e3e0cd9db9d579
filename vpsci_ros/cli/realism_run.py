"""How like people the policies behave, as a command: read, measure by `evaluation.realism`, write and print."""

import json
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

import polars as pl
from rich.console import Console

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.interactions import table_hash
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.realism.run import measure_realism
from vpsci_ros.evaluation.realism.simulators import policy
from vpsci_ros.evaluation.realism.table import print_realism
from vpsci_ros.policy.policy_file import SHIPPED, Policy, load_policy, named_policies
from vpsci_ros.resources import near_misses_path, weights_path
from vpsci_ros.runs.files import sha256, write_json
from vpsci_ros.runs.folder import RunFolder
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.runs.sections import Sections

RESULT = "realism.json"


def run_realism(
    *,
    data: Path,
    library: Path | None,
    weights: list[str] | None,
    dataset: Path | None,
    held_out: bool,
    clean: bool,
    seed: int,
    output: Path | None,
    quiet: bool,
) -> None:
    """Measure, write and print the tables; see `vpsci realism --help`.

    :raises InvalidInput: a file is refused, a name is there twice, or no clip of the data was held out.
    """
    table = read_near_misses(data)
    given = named_policies(weights or [])
    files = {name: weights_path(name) for name in SHIPPED} | given
    loaded = {name: load_policy(path) for name, path in files.items()}
    if held_out:
        table = _kept_out(table, [loaded[name] for name in given or SHIPPED[:1]], data)
    simulators = {name: policy(own, seed) for name, own in loaded.items()}
    inputs = list(files.values())
    inputs += [near_misses_path(name) for name in (data, library) if name is not None]
    made = None if dataset is None else Dataset(dataset)
    inputs += [] if made is None else made.inputs.values()
    resolved = {
        "clean": clean,
        "held_out": held_out,
        "seed": seed,
        "models": list(simulators),
        "data": str(data),
        "library": str(library or ""),
        "dataset": str(dataset or ""),
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
            clean=clean,
            seed=seed,
            library=read_near_misses(library or near_misses_path(data)),
            dataset=made,
            parts=output,
            inputs=None if run is None else run.inputs,
            notify=lambda name, done, total: bars.bar("realism", done, total, name),
        )
        result |= {
            "data": {"path": str(data), "sha256": table_hash(table)},
            "weights_sha256": {name: sha256(path) for name, path in files.items()},
            "parameters": resolved,
            "software": software_versions(),
        }
        if output is not None:
            write_json(output / RESULT, result)
    print_realism(result, Console(width=None if sys.stdout.isatty() else 130))
    if output is not None:
        print(f"written: {output}")


def _kept_out(table: pl.DataFrame, policies: Sequence[Policy], data: Path) -> pl.DataFrame:
    clips = set.intersection(*(set(own.facts.get("data", {}).get("held_out_clips", [])) for own in policies))
    kept = table.filter(pl.concat_str("source", "clip", separator="/").is_in(sorted(clips)))
    if kept.is_empty():
        raise InvalidInput(f"{data}: none of its clips was held out of the policies, by their metadata")
    return kept
