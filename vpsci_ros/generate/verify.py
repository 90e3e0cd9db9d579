"""Verification of a dataset: hash its files, simulate its episodes again and compare row by row.

dataset.json and the weights beside it are enough to simulate any episode. A file with the right hash is compared in all
episodes or in a sample; one with a wrong hash is compared whole, so that its first differing row is found.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.dataset_files import DATASET_COLUMNS, episode_rows
from vpsci_ros.data.dataset_index import DESCRIPTION, FORM_OF_GENERATED, INDEX, REJECTED, index_table
from vpsci_ros.data.dataset_reader import Dataset, file_rows
from vpsci_ros.data.episode_block import EpisodeBlock, block_from_bytes
from vpsci_ros.documents import reason, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.compare import first_difference
from vpsci_ros.generate.job import RECORDED, Job, Unit, job_from
from vpsci_ros.parameters import check_sections
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.provenance import cpu_name
from vpsci_ros.runs.sections import Sections
from vpsci_ros.runs.workers import Workers, computed
from vpsci_ros.world.scenario import scenario_from

BLOCK = 1024


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
    workers: Callable[[Job], Workers[Unit, tuple[int, bytes]]],
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
    job = job_of(data)
    changed = {name for name, entry in data.description["files"].items() if _hash(folder / name) != entry["sha256"]}
    findings = [Finding(name, True, "no such file") for name in sorted(changed) if not (folder / name).is_file()]
    changed -= {finding.file for finding in findings}
    episodes = rows = 0
    pool = workers(job)
    try:
        for scenario in job.scenarios:
            counts = data.scenarios[scenario.name]
            numbers = _numbers(data, counts["simulated"])
            files = _files(data, scenario.name)
            whole = sample is None or any(name in changed for name in (*files, INDEX))
            if not whole and sample is not None and sample < len(numbers):
                drawn = np.random.default_rng([seed, scenario.number]).choice(len(numbers), sample, replace=False)
                numbers = np.sort(numbers[drawn])
            checks = [_index_check(data, scenario.number, not whole, tolerance)]
            checks += [_file_check(folder / name, name, kept, not whole, tolerance) for name, kept in files.items()]
            for block in _simulated(pool, scenario.number, numbers):
                for check in checks:
                    check.compare(block)
                episodes += len(block)
                rows += len(block.values)
            found = [(check.name, check.finish()) for check in checks]
            findings += [Finding(name, name in changed, what) for name, what in found if what is not None]
    finally:
        pool.close()
    named = {finding.file for finding in findings}
    for name in sorted(changed - named):
        what = "its numbers are as simulated" if name.endswith((".parquet", ".csv")) else "not a table"
        findings.append(Finding(name, True, f"bytes differ from the hash in {DESCRIPTION}; {what}"))
    return VerifiedDataset(episodes, rows, findings, data.description["cpu"] == cpu_name())


def job_of(data: Dataset) -> Job:
    """Return the job of a dataset, from its description.

    :raises InvalidInput: another program made it, or its weights or this package's scenarios differ.
    """
    where, description = data.folder / DESCRIPTION, data.description
    try:
        recorded = check_sections(dict(description["configuration"]), RECORDED, where)
        sections = Sections(recorded).changed("world_simulator", {"seed": description["seed"]})
        stored = description["weights"]
        weights = {agent: data.folder / entry["file"] for agent, entry in stored.items()}
        scenario_files = dict(description["scenario_files"])
        own = [
            replace(scenario_from(document, f"{where}, scenario {name}"), sha256=scenario_files[name])
            for name, document in description.get("own_scenarios", {}).items()
        ]
        job = job_from(sections, weights, own)
        digests = {agent: entry["sha256"] for agent, entry in stored.items()}
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


class _Check:
    """Compares a scenario's rows of one file, episode after episode, to what is simulated.

    :param groups: the rows in the file's order, "row" the place of each; raises `InvalidInput` where it is damaged.
    :param expected: returns what a block's rows should be.
    :param sampled: other episodes may be in the file.
    """

    def __init__(
        self,
        name: str,
        groups: Iterator[pl.DataFrame],
        expected: Callable[[EpisodeBlock], pl.DataFrame],
        sampled: bool,
        tolerance: float,
    ) -> None:
        self.name = name
        self._groups, self._expected, self._sampled, self._tolerance = groups, expected, sampled, tolerance
        self._left: list[pl.DataFrame] = []
        self._difference: str | None = None

    def compare(self, block: EpisodeBlock) -> None:
        """Compare the episodes of a block, which come in rising order."""
        self._compare(self._expected(block), block.records["count"].tolist())

    def finish(self) -> str | None:
        """Return the first difference in words, None for none."""
        if not self._sampled:
            self._compare(None, [])
        return self._difference

    def _compare(self, expected: pl.DataFrame | None, counts: list[int]) -> None:
        """Compare the rows of these episodes, or, where None are expected, all that were not compared yet."""
        if self._difference is not None:
            return
        try:
            found = self._take(counts[-1] if counts else None)
        except InvalidInput as error:
            self._difference = str(error)
            return
        if self._sampled:
            found = found.filter(pl.col("count").is_in(counts))
        wanted = found.drop("row").clear() if expected is None else expected
        self._difference = first_difference(wanted, found, self._tolerance)

    def _take(self, last: int | None) -> pl.DataFrame:
        """Return the rows not taken yet of episodes up to number `last`; None: all."""
        while last is None or not self._left or not self._left[-1].height or self._left[-1]["count"][-1] <= last:
            if (group := next(self._groups, None)) is None:
                break
            self._left.append(group)
        rows = pl.concat(self._left)
        beyond = rows["count"] > last if last is not None else pl.Series([], dtype=pl.Boolean)
        end = beyond.arg_max() or 0 if beyond.any() else rows.height
        self._left = [rows[end:]]
        return rows[:end]


def _index_check(data: Dataset, scenario: int, sampled: bool, tolerance: float) -> _Check:
    def groups() -> Iterator[pl.DataFrame]:
        index = data.index().with_row_index("row")
        yield index.filter(pl.col("scenario") == scenario)

    return _Check(INDEX, groups(), lambda block: index_table(block.records), sampled, tolerance)


def _file_check(path: Path, name: str, kept: bool, sampled: bool, tolerance: float) -> _Check:
    def expected(block: EpisodeBlock) -> pl.DataFrame:
        return episode_rows(block.only(block.kept == kept))

    return _Check(name, _numbered(file_rows(path)), expected, sampled, tolerance)


def _simulated(pool: Workers[Unit, tuple[int, bytes]], scenario: int, numbers: np.ndarray) -> Iterator[EpisodeBlock]:
    """Yield blocks of episodes, in rising order."""
    units = [Unit(scenario, numbers[k : k + BLOCK].tolist()) for k in range(0, len(numbers), BLOCK)]
    left, due, waiting = iter(units), deque(units), dict[int, bytes]()
    for unit, (_, data) in computed(pool, lambda: next(left, None)):
        waiting[unit.numbers[0]] = data
        while due and due[0].numbers[0] in waiting:
            yield block_from_bytes(waiting.pop(due.popleft().numbers[0]), "a block just simulated")


def _numbered(groups: Iterator[pl.DataFrame]) -> Iterator[pl.DataFrame]:
    yield pl.DataFrame(schema={"row": pl.Int64, **{name: column.dtype for name, column in DATASET_COLUMNS.items()}})
    row = 0
    for group in groups:
        yield group.with_row_index("row", offset=row).with_columns(pl.col("row").cast(pl.Int64))
        row += len(group)


def _numbers(data: Dataset, simulated: int) -> np.ndarray:
    """Return the numbers of a scenario's simulated episodes."""
    first = int(data.description["first_episode"])
    return np.arange(first, first + simulated)


def _files(data: Dataset, name: str) -> dict[str, bool]:
    """Return the scenario's files that are there, each with whether it holds kept episodes."""
    places = {f"{name}.{form}": True for form in ("parquet", "csv")}
    places |= {f"{REJECTED}/{name}.{form}": False for form in ("parquet", "csv")}
    return {
        place: kept
        for place, kept in places.items()
        if place in data.description["files"] and (data.folder / place).is_file()
    }


def _hash(path: Path) -> str:
    return sha256(path) if path.is_file() else ""
