"""Datasets made of datasets: several merged into one, or a part of one; nothing is simulated."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vpsci_ros.data.dataset import DatasetWriter
from vpsci_ros.data.dataset_description import DESCRIPTION, FORM_OF_GENERATED
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.dataset_tables import FORMATS
from vpsci_ros.data.episode_block import EpisodeBlock, concat_blocks
from vpsci_ros.data.filters import FilterConfig
from vpsci_ros.documents import given_names, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.datasheet import datasheet
from vpsci_ros.generate.verify import job_of
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.identity import require_same
from vpsci_ros.world.state import OUTCOME_NAMES

_OF_A_RUN = ("first_episode", "kept_wanted")  # facts of a dataset that has every episode from one number on
_COUNTED = ("content", "all", "filters", "unfinished", "scenarios", "columns", "files", "versions")
_UNITED = ("scenario_files", "own_scenarios")


def merge(folders: Sequence[Path], output: Path) -> dict[str, Any]:
    """Write the episodes of several datasets of one seed and configuration as one, and return its description.

    :raises InvalidInput: datasets that differ in more than scenarios and episodes, an episode in two of them, or a
        changed file.
    """
    sources = [_opened(folder) for folder in folders]
    facts = [_facts(source) for source in sources]
    for source, found in zip(sources[1:], facts[1:], strict=True):
        advice = "merge datasets of one seed and configuration"
        require_same(source.folder, _alike(found), _alike(facts[0]), "is a dataset", advice)
    numbers = sorted({number for found in facts for number in _world(found)["scenarios"]})
    united = {name: {k: v for found in facts for k, v in found.get(name, {}).items()} for name in _UNITED}
    united = {name: values for name, values in united.items() if values}
    merged = {source.folder.resolve().name: sha256(source.folder / DESCRIPTION) for source in sources}
    configuration = facts[0]["configuration"]
    configuration = configuration | {"world_simulator": configuration["world_simulator"] | {"scenarios": numbers}}
    provenance = {**facts[0], **united, "configuration": configuration, "merged": merged}
    parts: dict[str, list[tuple[Dataset, EpisodeBlock]]] = {}
    for source in sources:
        for name in source.scenarios:
            parts.setdefault(name, []).append((source, source.stored(name)))
    return _write(sources, {name: _joined(own) for name, own in parts.items()}, provenance, output)


def select(
    folder: Path,
    output: Path,
    *,
    scenarios: Sequence[int] = (),
    episodes: str = "",
    outcome: str = "",
    curvttc_below: float | None = None,
) -> dict[str, Any]:
    """Write the episodes of a dataset that meet all given conditions as a dataset, and return its description.

    :param scenarios: numbers of scenarios; empty: all.
    :param episodes: "6:12,1:3-9", numbers within scenarios; empty: all.
    :param outcome: one of `OUTCOME_NAMES`; empty: any.
    :param curvttc_below: of the least CurvTTC [s].
    :raises InvalidInput: no kept episode meets them, a condition of another form, or a changed file.
    """
    source = _opened(folder)
    if outcome and outcome not in OUTCOME_NAMES:
        raise InvalidInput(f"--outcome {outcome}: expected one of {', '.join(OUTCOME_NAMES)}")
    numbered = [_range_of(text) for text in given_names(episodes, "--episodes")]
    chosen: dict[str, EpisodeBlock] = {}
    for name in source.scenarios:
        block = source.stored(name)
        records = block.records
        meets = np.ones(len(records), np.bool_)
        if scenarios:
            meets &= np.isin(records["scenario"], scenarios)
        if numbered:
            count = records["count"]
            ranges = ((records["scenario"] == s) & (count >= first) & (count <= last) for s, first, last in numbered)
            meets &= np.any(list(ranges), axis=0)
        if outcome:
            meets &= records["outcome"] == OUTCOME_NAMES.index(outcome)
        if curvttc_below is not None:
            meets &= records["least_curvttc"] < curvttc_below
        if (block.kept & meets).any():
            chosen[name] = block.only(meets)
    if not chosen:
        raise InvalidInput(f"{folder}: no kept episode is as chosen; `vpsci dataset info` tells which it has")
    conditions = {
        "scenarios": list(scenarios),
        "episodes": episodes,
        "outcome": outcome,
        "curvttc_below": curvttc_below,
    }
    origin = {
        "from_sha256": sha256(folder / DESCRIPTION),
        **{name: value for name, value in conditions.items() if value},
    }
    return _write([source], chosen, {**_facts(source), "selected": origin}, output)


def _opened(folder: Path) -> Dataset:
    source = Dataset(folder)
    require_form(source.description, FORM_OF_GENERATED, str(folder / DESCRIPTION))
    if changed := source.changed():
        raise InvalidInput(f"{folder}: {', '.join(changed)} changed since it was written; see `vpsci dataset verify`")
    return source


def _facts(source: Dataset) -> dict[str, Any]:
    """Return how a dataset was made, without what is counted of its episodes."""
    return {name: value for name, value in source.description.items() if name not in (*_OF_A_RUN, *_COUNTED)}


def _world(facts: Mapping[str, Any]) -> dict[str, Any]:
    return dict(facts["configuration"]["world_simulator"])


def _alike(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts in which merged datasets must agree."""
    world = {name: value for name, value in _world(facts).items() if name != "scenarios"}
    left_out = (*_UNITED, "merged", "selected", "formats")
    same = {name: value for name, value in facts.items() if name not in left_out}
    return same | {"configuration": facts["configuration"] | {"world_simulator": world}}


def _joined(parts: Sequence[tuple[Dataset, EpisodeBlock]]) -> EpisodeBlock:
    """Return the episodes of one scenario of several datasets, in the order of their numbers."""
    whole = concat_blocks([block for _, block in parts])
    if (again := np.flatnonzero(np.diff(whole.records["count"]) == 0)).size:
        scenario, number = whole.keys[again[0]]
        folders = " and ".join(str(source.folder) for source, block in parts if (scenario, number) in block.keys)
        raise InvalidInput(f"episode {scenario}:{number} is in {folders}; `vpsci dataset select` leaves it out of one")
    return whole


def _write(
    sources: Sequence[Dataset], found: Mapping[str, EpisodeBlock], facts: dict[str, Any], output: Path
) -> dict[str, Any]:
    job, description = job_of(sources[0]), sources[0].description
    numbers = {name: int(block.records["scenario"][0]) for name, block in found.items()}
    scenarios = [scenario for source in sources for scenario in job_of(source).scenarios]
    own = {scenario.number: scenario for scenario in scenarios if scenario.number in numbers.values()}
    world = _world(facts) | {"scenarios": sorted(own)}
    facts = facts | {"configuration": facts["configuration"] | {"world_simulator": world}}
    for name in _UNITED:
        if name in facts:
            facts[name] = {key: value for key, value in facts[name].items() if key in numbers}
    with DatasetWriter(
        output,
        {number: name for name, number in numbers.items()},
        facts,
        filters=FilterConfig(**description["filters"]),
        formats=[form for form in FORMATS if form in description["formats"]],
        keep_rejected=job.keep_rejected,
    ) as writer:
        for name, number in sorted(numbers.items(), key=lambda each: each[1]):
            writer.begin(number)
            writer.write(number, found[name])
        weights = {policy.file: policy.data for policy in job.policies.values()}
        return writer.close(beside=weights, datasheet=lambda made: datasheet(made, list(own.values())))


def _range_of(text: str) -> tuple[int, int, int]:
    """Return scenario, first and last number of "6:12" or "1:3-9"."""
    if (found := re.fullmatch(r"(\d+):(\d+)(?:-(\d+))?", text)) is None:
        raise InvalidInput(f"--episodes {text}: expected SCENARIO:NUMBER or SCENARIO:FIRST-LAST, say 6:12 or 1:3-9")
    return int(found[1]), int(found[2]), int(found[3] or found[2])
