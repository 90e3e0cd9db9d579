"""`vpsci realism` without its command line: its measurements, each part stored as soon as it is finished."""

import contextlib
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.corpus import table_hash
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.near_misses import clean as without_flagged
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.documents import read_json
from vpsci_ros.errors import InvalidInput, require
from vpsci_ros.evaluation.onsets import STEPS, Onsets, find_onsets
from vpsci_ros.evaluation.predictors import sources_for
from vpsci_ros.evaluation.protocols import LATE
from vpsci_ros.evaluation.simulators import Simulator, policy
from vpsci_ros.extras.paper.realism.beside_sampler import BesideSampler
from vpsci_ros.extras.paper.realism.controls import CONTROLS
from vpsci_ros.extras.paper.realism.free import free
from vpsci_ros.extras.paper.realism.same_start import SameStart
from vpsci_ros.extras.paper.realism.text import print_realism
from vpsci_ros.extras.paper.realism.two_sample import FAMILIES, REPETITIONS
from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.onset_range import beyond, onsets_in
from vpsci_ros.policy.policy_file import SHIPPED, Policy, load_policy, named_policies
from vpsci_ros.resources import near_misses_path, weights_path
from vpsci_ros.runs.files import sha256, write_json
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.runs.run_folder import RunFolder
from vpsci_ros.runs.text_table import table_console
from vpsci_ros.safety import CRITICAL_TTC

RESULT = "realism.json"
Notify = Callable[[str, int, int], None]
"""Called with what is being measured, how many are done, and of how many."""


def measure_realism(
    table: pl.DataFrame,
    simulators: Mapping[str, Simulator],
    *,
    clean: bool = False,
    seed: int = 0,
    most: int | None = None,
    episodes: int = 2000,
    repetitions: int = REPETITIONS,
    library: pl.DataFrame | None = None,
    dataset: Dataset | None = None,
    banks: Mapping[str, Bank] | None = None,
    people: str = "",
    parts: Path | None = None,
    inputs: Mapping[str, str] | None = None,
    notify: Notify = lambda *_: None,
) -> dict[str, Any]:
    """Return the measures in the layout of `vpsci realism --json`: Protocols A (`same_start`) and B (`free`).

    Protocol A has those of `SameStart` and of `BesideSampler` for each simulator.

    :param table: near misses to be scored on; library: those whose residuals the control borrows, else `table`'s own.
    :param simulators: name -> what answers onsets; the controls are added.
    :param clean: only interactions with a driving vehicle, a seen onset and paths that meet (`data.near_misses.clean`).
    :param seed: of everything that is drawn.
    :param most: onsets that are measured at most, drawn by `seed`; None: all.
    :param dataset: generated episodes, for B; `episodes` of them at most, the same number of each scenario.
    :param repetitions: of the classifier's test from the same start, with draws and folds of their own.
    :param banks: those of the simulators that are banks, to tell which onsets lie beyond their ranges.
    :param people: whose reactions act in them, see `PeoplePredictor`.
    :param parts: folder that keeps each measured part, from which a stopped run goes on.
    :param inputs: SHA-256 of what all this was read from, by name; a part of other inputs is measured again.
    :raises InvalidInput: no onset with 3 s after it, a simulator with a control's name, see also the parts.
    """
    require("sklearn")  # which is needed only after much else
    names, each = [*CONTROLS, *simulators], 1 + len(FAMILIES)  # of a model: its roll-outs, and the tests
    total = each * len(names) + (dataset is not None)
    notify("onsets", 0, total)
    if taken := sorted(set(simulators) & set(CONTROLS)):
        raise InvalidInput(f"models: {taken[0]} is the name of a control; call the model something else")
    chosen = [without_flagged(t) if clean else t for t in (table, library) if t is not None]
    onsets = drawn(find_onsets(chosen[0]), most, seed)
    borrowed = find_onsets(chosen[1]) if len(chosen) > 1 else onsets
    same_start = SameStart(onsets, borrowed, seed, repetitions)
    wanted = same_start.controls() | dict(simulators)
    kept = partial(_kept, parts, dict(inputs or {}))
    second = BesideSampler(onsets, borrowed, same_start.sampler, seed)
    models: dict[str, Any] = {}
    for number, (name, simulate) in enumerate(wanted.items()):
        tell = partial(_tell, notify, name, each * number, total)
        tell(0)
        models[name] = kept(f"same_start_{name}", partial(_measured, same_start, second, simulate, tell))
    clips, missing = len(set(onsets.clip)), same_start.missing
    part = {"interactions": len(onsets), "clips": clips, "units": same_start.units.text, "not_in_library": missing}
    part |= {"models": models, "counts": _counts(chosen[0], onsets)}
    part |= {"forecasts": kept("forecasts", second.forecasts), "recorded_answers": second.recorded_answers()}
    part["range"] = {name: _range(bank, onsets, people) for name, bank in (banks or {}).items()}
    result: dict[str, Any] = {"same_start": part}
    if dataset is not None:
        result["free"] = kept("free", lambda: free(chosen[0], dataset, episodes, seed))
    return result


def _range(bank: Bank, onsets: Onsets, people: str) -> dict[str, Any]:
    """Return whose reactions act, and at how many onsets, and the interactions whose onsets lie beyond the range.

    `unknown_accelerations` are situations of the acting sources before which an acceleration is not known, of
    `situations`: there the recorded reaction is replayed as it is.
    """
    sources, outside = beyond_range(bank, onsets, people)
    names, counts = np.unique(sources, return_counts=True)
    unknown = np.concatenate([np.isnan(bank.of(str(name)).before).any(axis=1) for name in names])
    return {
        "people": dict(zip(names.tolist(), counts.tolist(), strict=True)),
        "beyond": int(outside.sum()),
        "of": len(onsets),
        "interactions_beyond": onsets.number[outside].tolist(),
        "situations": len(unknown),
        "unknown_accelerations": int(unknown.sum()),
    }


def beyond_range(bank: Bank, onsets: Onsets, people: str = "") -> tuple[NDArray[np.str_], NDArray[np.bool_]]:
    """Return the bank's source for each onset, str[n], and whether the onset is beyond that source's range, bool[n]."""
    sources, start = sources_for(bank, onsets.clip, people), onsets.start
    where, out = onsets_in(start[:, :2], start[:, 3:5], start[:, 5:7], start[:, 7:9]), np.zeros(len(onsets), np.bool_)
    for name in np.unique(sources):
        own = sources == name
        out[own] = beyond(where[own], bank.of(str(name)).reach)
    return sources, out


def _counts(table: pl.DataFrame, onsets: Onsets) -> dict[str, int]:
    """Return how many recordings cannot be measured, or only in part.

    `recordings` of the table, those `never_critical` by what was known then, and those that `end_within_3s` of the
    onset, which are left out; of the onsets measured, those `without_step_before` and `without_late` (0.3 s before),
    where accelerations count as 0, and those whose order the recording leaves `open`.
    """
    critical = pl.col("curvttc_causal") < CRITICAL_TTC
    left = table.group_by("interaction", maintain_order=True).agg(
        onset=critical.any(), after=pl.len() - critical.arg_max()
    )
    never, before = int((~left["onset"]).sum()), onsets.interactions.first
    return {
        "recordings": left.height,
        "never_critical": never,
        "end_within_3s": int((left["onset"] & (left["after"] <= STEPS)).sum()),
        "without_step_before": int((before < 1).sum()),
        "without_late": int((before < 1 + LATE).sum()),
        "open": int(np.isnan(onsets.pedestrian_first).sum()),
    }


def drawn(onsets: Onsets, most: int | None, seed: int) -> Onsets:
    """Return `most` of the onsets, drawn by `seed` and in their order; None: all."""
    if most is None or most >= len(onsets):
        return onsets
    return onsets.take(np.sort(np.random.default_rng(seed).permutation(len(onsets))[:most]))


def _tell(notify: Notify, name: str, before: int, total: int, done: int) -> None:
    notify(name, before + done, total)


def _measured(
    same_start: SameStart, second: BesideSampler, simulate: Simulator, tell: Callable[[int], None]
) -> dict[str, Any]:
    onsets = same_start.onsets
    positions, late = simulate(onsets), simulate(replace(onsets, late=True))
    alike, beside = same_start.measure(positions, late, tell), second.measure(simulate, positions, late)
    return alike | beside | {"late": alike["late"] | beside["late"]}


def _kept(folder: Path | None, inputs: dict[str, str], name: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return what is in the folder under this name, made of the same inputs, or make it and leave it there."""
    if folder is None:
        return make()
    path = folder / f"{name}.part.json"
    with contextlib.suppress(InvalidInput):  # there is none, or it is damaged
        kept = read_json(path)
        if isinstance(kept, dict) and kept.get("inputs_sha256") == inputs:
            return dict(kept["found"])
    made = make()
    write_json(path, {"inputs_sha256": inputs, "found": made})
    return made


def run_realism(
    *,
    data: Path,
    library: Path | None,
    weights: list[str] | None,
    people: str | None,
    dataset: Path | None,
    held_out: bool,
    clean: bool,
    onsets: int | None,
    seed: int,
    json_path: Path | None,
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
    simulators = {name: policy(own, seed, people=people or "") for name, own in loaded.items()}
    banks = {name: own for name, own in loaded.items() if isinstance(own, Bank)}
    for bank in banks.values():
        bank.of(people or "")  # refuse an unknown one before anything is measured
    inputs = list(files.values())
    inputs += [near_misses_path(name) for name in (data, library) if name is not None]
    made = None if dataset is None else Dataset(dataset)
    inputs += [] if made is None else made.inputs.values()
    resolved = {
        "clean": clean,
        "held_out": held_out,
        "seed": seed,
        "onsets": onsets or 0,
        "models": list(simulators),
        "people": people or "",
        "data": str(data),
        "library": str(library or ""),
        "dataset": str(dataset or ""),
    }
    run = None if output is None else RunFolder(output, Sections({"realism": resolved}), inputs)
    if output is not None and run is not None and run.done:
        result = json.loads((output / RESULT).read_text(encoding="utf-8"))
        if json_path is not None:
            write_json(json_path, result)
        print_realism(result, table_console())
        print(f"{output} holds this run, finished; nothing was measured again")
        return
    with run or nullcontext(), Bars(quiet=quiet) as bars:
        result = measure_realism(
            table,
            simulators,
            clean=clean,
            seed=seed,
            most=onsets,
            library=read_near_misses(library or near_misses_path(data)),
            dataset=made,
            banks=banks,
            people=people or "",
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
    if json_path is not None:
        write_json(json_path, result)
    print_realism(result, table_console())
    for path in (json_path, output):
        if path is not None:
            print(f"written: {path}")


def _kept_out(table: pl.DataFrame, policies: Sequence[Policy], data: Path) -> pl.DataFrame:
    clips = set.intersection(*(set(own.facts.get("data", {}).get("held_out_clips", [])) for own in policies))
    kept = table.filter(pl.concat_str("source", "clip", separator="/").is_in(sorted(clips)))
    if kept.is_empty():
        raise InvalidInput(
            f"{data}: the policies list none of its clips as held out of training; leave --held-out out, if they have "
            "learned from none of them"
        )
    return kept
