"""Verification of a dataset: hash its files, simulate its episodes again and compare row by row.

dataset.json and the weights beside it are enough to simulate any episode. A file with the right hash is compared in all
episodes or in a sample; one with a wrong hash is compared whole, so that its first differing row is found.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.dataset_description import DESCRIPTION, FORM_OF_GENERATED
from vpsci_ros.data.dataset_reader import Dataset, file_table
from vpsci_ros.data.dataset_tables import FORMATS, INDEX, REJECTED, arrow_rows, index_table
from vpsci_ros.data.episode_block import EpisodeBlock, concat_blocks
from vpsci_ros.data.parquet import as_polars
from vpsci_ros.documents import listed, reason, require_form, shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.job import RECORDED, Job, Unit, job_from
from vpsci_ros.generate.parts import WANTED
from vpsci_ros.parameters import check_sections, with_constants
from vpsci_ros.runs.files import changed_files
from vpsci_ros.runs.provenance import cpu_name
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.runs.workers import Workers, computed
from vpsci_ros.world.scenario import scenario_from

BLOCK = 1024
_PLACES = {"": True, f"{REJECTED}/": False}  # of the files of kept and of rejected episodes


MOST_EPISODES = 2**32  # of a scenario, by the numbers that they may have


@dataclass(frozen=True)
class Finding:
    """A difference in one file.

    :ivar file: name within the dataset.
    :ivar changed: its hash differs from the one in dataset.json.
    :ivar what: the first difference, in words.
    """

    file: str
    changed: bool
    what: str


@dataclass(frozen=True)
class VerifiedDataset:
    """The result of a verification: numbers of episodes and rows, and the differences found."""

    episodes: int
    rows: int
    findings: list[Finding]
    same_cpu: bool


def verify(
    folder: Path,
    workers: Callable[[Job], Workers[Unit, EpisodeBlock]],
    *,
    sample: int | None = None,
    tolerance: float = 0.0,
    seed: int = 0,
) -> VerifiedDataset:
    """Simulate episodes of a dataset again and compare them to its files.

    :param sample: episodes of each scenario, drawn at random by `seed`; None for all.
    :param tolerance: allowed difference [m, m/s, s]; 0: to the bit.
    :raises InvalidInput: no dataset of `generate`, or its weights or this package's scenarios are not those it names.
    """
    data = Dataset(folder)
    require_form(data.description, FORM_OF_GENERATED, str(data.folder / DESCRIPTION))
    job, entries = job_of(data), data.description["files"]
    changed = set(changed_files(folder, {name: entry["sha256"] for name, entry in entries.items()}))
    findings = [Finding(name, True, "no such file") for name in sorted(changed) if not (folder / name).is_file()]
    changed -= {finding.file for finding in findings}
    episodes = rows = 0
    pool = workers(job)
    try:
        for scenario in job.scenarios:
            files = {f"{place}{scenario.name}.{form}": kept for place, kept in _PLACES.items() for form in FORMATS}
            files = {name: kept for name, kept in files.items() if name in entries and (folder / name).is_file()}
            numbers = _numbers(data, scenario.name)
            sampled = sample is not None and sample < len(numbers) and not changed & {*files, INDEX}
            if sampled:
                rng = np.random.default_rng([seed, scenario.number])
                numbers = np.sort(numbers[rng.choice(len(numbers), sample, replace=False)])
            block = _simulated(pool, scenario.number, numbers)
            episodes, rows = episodes + len(block), rows + len(block.values)
            chosen = pl.col("count").is_in(numbers.tolist()) if sampled else pl.lit(True)
            index = chosen & (pl.col("scenario") == scenario.number)
            wanted = {INDEX: (data.index, index_table(block.records), index)}
            for name, kept in files.items():
                expected = as_polars(arrow_rows(block.only(block.kept == kept)))
                wanted[name] = partial(file_table, folder / name), expected, chosen
            found = {name: _difference(*each, tolerance) for name, each in wanted.items()}
            findings += [Finding(name, name in changed, what) for name, what in found.items() if what is not None]
    finally:
        pool.close()
    for name in sorted(changed - {finding.file for finding in findings}):
        what = "its numbers are as simulated" if name.endswith((".parquet", ".csv")) else "not a table"
        findings.append(Finding(name, True, f"bytes differ from the hash in {DESCRIPTION}; {what}"))
    return VerifiedDataset(episodes, rows, findings, data.description["cpu"] == cpu_name())


def _numbers(data: Dataset, scenario: str) -> NDArray[np.int64]:
    """Return the numbers of the episodes that were simulated of a scenario.

    :raises InvalidInput: the description does not say which these are.
    """
    where, first = data.folder / DESCRIPTION, data.description.get("first_episode")
    if scenario not in data.scenarios:
        raise InvalidInput(
            f"{where}: scenarios: expected {scenario}, as configuration says; got {listed(data.scenarios)}"
        )
    count = data.scenarios[scenario]["simulated"]
    if first is None:  # of episodes that were selected or merged
        index = data.index().filter(pl.col("scenario") == data.scenarios[scenario]["number"])
        return index["count"].to_numpy()
    if min(first, count) < 0 or first + count > MOST_EPISODES:
        raise InvalidInput(
            f"{where}: {scenario}: expected first_episode and simulated from 0 to {MOST_EPISODES} together, got "
            f"{shown(first)} and {shown(count)}"
        )
    return np.arange(first, first + count)


def _simulated(pool: Workers[Unit, EpisodeBlock], scenario: int, numbers: NDArray[np.int64]) -> EpisodeBlock:
    units = (Unit(scenario, numbers[k : k + BLOCK].tolist()) for k in range(0, len(numbers), BLOCK))
    results = computed(pool, lambda: next(units, None))
    return concat_blocks([block for _, block in results])


def _difference(
    read: Callable[[], pl.DataFrame], expected: pl.DataFrame, chosen: pl.Expr, tolerance: float
) -> str | None:
    """Return the first difference of the chosen rows of a file from what they should be, or why it cannot be read."""
    try:
        found = read().with_row_index("row").filter(chosen)
    except InvalidInput as error:
        return str(error)
    return first_difference(expected, found, tolerance)


def first_difference(expected: pl.DataFrame, found: pl.DataFrame, tolerance: float) -> str | None:
    """Return the first difference of two tables in words; None without one.

    :param found: "row", the place of each row in its file, and the columns of `expected`.
    :param tolerance: allowed difference of floats; 0: the same bits, where NaN equals NaN.
    """
    height = min(expected.height, found.height)
    first, column = height, ""
    for mine in expected.head(height):
        theirs = found[mine.name].head(height)
        unequal = mine != theirs
        if tolerance > 0.0 and mine.dtype.is_float():
            unequal &= ~((mine.cast(pl.Float64) - theirs.cast(pl.Float64)).abs() <= tolerance)
        if unequal.any() and (place := unequal.arg_max() or 0) < first:
            first, column = place, mine.name
    wanted, there = (table.row(first, named=True) if first < table.height else None for table in (expected, found))
    if there is None:
        return None if wanted is None else f"missing row ({_key(wanted)})"
    if wanted is None:
        return f"row {there['row']} ({_key(there)}): should not be there"
    return f"row {there['row']} ({_key(there)}): {column} is {there[column]!r}, simulated {wanted[column]!r}"


def _key(row: dict[str, Any]) -> str:
    """Return what the row is: its `count`, and its `frame` where it has one."""
    return ", ".join(f"{name} {row[name]}" for name in ("count", "frame") if name in row)


def job_of(data: Dataset) -> Job:
    """Return the job of a dataset, from its description.

    Its policies have the names that their files had when the dataset was generated.

    :raises InvalidInput: another program made it, or its weights or this package's scenarios differ.
    """
    where, description = data.folder / DESCRIPTION, data.description
    try:
        recorded = check_sections(dict(description["configuration"]), RECORDED, where, with_constants)
        sections = Sections(recorded).changed("world_simulator", {"seed": description["seed"]})
        stored = description["weights"]
        weights = {agent: data.folder / entry["file"] for agent, entry in stored.items()}
        scenario_files = dict(description["scenario_files"])
        own = [
            replace(scenario_from(document, f"{where}, scenario {name}"), sha256=scenario_files[name])
            for name, document in description.get("own_scenarios", {}).items()
        ]
        job = job_from(sections, weights, own)
        digests = {agent: str(entry["sha256"]) for agent, entry in stored.items()}
        names = {agent: str(entry["name"]) for agent, entry in stored.items()}
        job = replace(job, policies={agent: policy.named(names[agent]) for agent, policy in job.policies.items()})
    except InvalidInput:
        raise
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise InvalidInput(
            f"{where}: expected a dataset of `vpsci generate`, got one without {reason(error)}; "
            "a bag is compared otherwise"
        ) from None
    for agent, policy in job.policies.items():
        if policy.digest != digests.get(agent):
            raise InvalidInput(
                f"{weights[agent]}: SHA-256 {policy.digest[:16]}, the dataset was made with "
                f"{digests.get(agent, 'nothing')[:16]}; put the right weights file in its place"
            )
    here = job.description()["scenario_files"]
    for name, digest in here.items():
        if digest != scenario_files.get(name):
            raise InvalidInput(
                f"{where}: scenario {name} has changed in this version of the package; verify with vpsci_ros "
                f"{description['versions']['vpsci_ros']} as it was installed then"
            )
    return job


def repeated(path: Path) -> tuple[Job, dict[int, int], int, list[str]]:
    """Return job, kept episodes wanted by scenario, first number and formats of a dataset, to generate it again.

    :param path: its dataset.json.
    :raises InvalidInput: see `job_of`, or its episodes were selected or merged.
    """
    data = Dataset(path.parent if path.name == DESCRIPTION else path)
    job, found = job_of(data), data.description
    if WANTED not in found:
        raise InvalidInput(f"{path}: episodes that were selected or merged; generate the datasets that they come from")
    require_form(found, {WANTED: {"*": int}, "formats": [str], "first_episode": int}, str(path))
    targets = {int(number): count for number, count in found[WANTED].items()}
    return job, targets, found["first_episode"], found["formats"]
