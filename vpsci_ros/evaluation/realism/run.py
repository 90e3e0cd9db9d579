"""`vpsci realism` without its command line: what is measured, part after part, each kept as soon as it is done."""

import contextlib
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.data import reference
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.documents import read_json
from vpsci_ros.errors import InvalidInput, require
from vpsci_ros.evaluation.realism.free import free
from vpsci_ros.evaluation.realism.onsets import find_onsets
from vpsci_ros.evaluation.realism.same_start import CONTROLS, SameStart
from vpsci_ros.evaluation.realism.simulators import Simulator
from vpsci_ros.evaluation.realism.two_sample import REPETITIONS
from vpsci_ros.runs.files import write_json

Notify = Callable[[str, int, int], None]


def measure_realism(
    table: pl.DataFrame,
    simulators: Mapping[str, Simulator],
    *,
    clean: bool = False,
    seed: int = 0,
    episodes: int = 2000,
    repetitions: int = REPETITIONS,
    library: pl.DataFrame | None = None,
    dataset: Dataset | None = None,
    parts: Path | None = None,
    inputs: Mapping[str, str] | None = None,
    notify: Notify | None = None,
) -> dict[str, Any]:
    """Return the layout of realism.json: Protocols A (`same_start`) and B (`free`).

    :param table: near misses to be scored on; library: those whose residuals the control borrows, else `table`'s own.
    :param simulators: name -> what answers onsets; the controls are added.
    :param clean: only interactions whose vehicle drives and whose onset was seen (`vpsci_ros.data.reference.clean`).
    :param seed: of everything that is drawn.
    :param dataset: generated episodes, for B; `episodes` of them at most, the same number of each scenario.
    :param repetitions: of the classifier's test from the same start, with draws and folds of their own.
    :param parts: folder that keeps each measured part, from which a stopped run goes on.
    :param inputs: SHA-256 of what all this was read from, by name; a part of other inputs is measured again.
    :param notify: called with what is being measured, how many are done, and of how many.
    :raises InvalidInput: no onset with 3 s after it, a simulator with a control's name, see also the parts.
    """
    require("sklearn")  # which is needed only after much else
    if taken := sorted(set(simulators) & set(CONTROLS)):
        raise InvalidInput(f"models: {taken[0]} is the name of a control; call the model something else")
    chosen = [reference.clean(t) if clean else t for t in (table, library) if t is not None]
    onsets = find_onsets(chosen[0])
    borrowed = find_onsets(chosen[1]) if len(chosen) > 1 else onsets
    same_start = SameStart(onsets, borrowed, seed, repetitions)
    wanted = same_start.controls() | dict(simulators)
    kept = partial(_kept, parts, dict(inputs or {}))
    models: dict[str, Any] = {}
    for done, (name, simulate) in enumerate(wanted.items()):
        if notify is not None:
            notify(name, done, len(wanted) + (dataset is not None))
        models[name] = kept(f"same_start_{name}", partial(_measured, same_start, simulate))
    clips, missing = len(set(onsets.clip)), same_start.missing
    part = {"interactions": len(onsets), "clips": clips, "not_in_library": missing, "models": models}
    result: dict[str, Any] = {"same_start": part}
    if dataset is not None:
        result["free"] = kept("free", lambda: free(chosen[0], dataset, episodes, seed))
    return result


def _measured(same_start: SameStart, simulate: Simulator) -> dict[str, Any]:
    return same_start.measure(simulate(same_start.onsets))


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
