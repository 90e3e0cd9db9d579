"""Is a dataset what its description says? Files are hashed, episodes simulated again and compared row by row.

What dataset.json holds is enough to simulate any episode, with the weights that lie beside it. A file whose hash is
right is compared in the episodes that are drawn, all or a sample; one whose hash is wrong is compared whole, so that
the first differing row is found wherever it is.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.dataset_files import DATASET_COLUMNS, INDEX_COLUMNS, episode_rows
from vpsci_ros.data.dataset_index import DESCRIPTION, FORM_OF_GENERATED, INDEX, REJECTED, index_columns, index_table
from vpsci_ros.data.dataset_reader import Dataset, file_rows
from vpsci_ros.data.episode_block import EpisodeBlock, block_from_bytes
from vpsci_ros.documents import reason, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.compare import Difference, first_difference
from vpsci_ros.generate.job import Job, Unit, job_from
from vpsci_ros.generate.workers import Workers
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.provenance import cpu_name
from vpsci_ros.runs.sections import Sections
from vpsci_ros.world.scenario import scenario_from

BLOCK = 1024


@dataclass(frozen=True)
class Finding:
    """What is wrong with one file.

    :ivar file: name within the dataset.
    :ivar changed: its bytes are not those that dataset.json names.
    :ivar what: the first difference, in words.
    """

    file: str
    changed: bool
    what: str


@dataclass(frozen=True)
class VerifiedDataset:
    """What was compared: episodes, rows, and what was found (nothing: all is as it should be)."""

    episodes: int
    rows: int
    findings: list[Finding]
    same_cpu: bool


def verify(
    folder: Path, workers: Callable[[Job], Workers], *, sample: int | None = None, tolerance: float = 0.0, seed: int = 0
) -> VerifiedDataset:
    """Simulate episodes of a dataset again and compare them to its files.

    :param sample: so many episodes of each scenario, drawn at random by `seed`; None for all.
    :param tolerance: numbers may differ by so much [m, m/s, s]; 0: to the bit.
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
            checks: list[_FileCheck | _IndexCheck] = [_IndexCheck(folder, scenario.number, tolerance)]
            checks += [_FileCheck(folder / name, name, kept, not whole, tolerance) for name, kept in files.items()]
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
    """Return the job that a dataset was made by, from its description.

    :raises InvalidInput: it was made by something else, or its weights or this package's scenarios differ.
    """
    where, description = data.folder / DESCRIPTION, data.description
    try:
        sections = Sections(dict(description["configuration"]))
        world = dict(sections.values["world_simulator"]) | {"seed": description["seed"]}
        sections = sections.changed("world_simulator", world)
        stored = description["weights"]
        weights = {agent: data.folder / entry["file"] for agent, entry in stored.items()}
        scenario_files = description["scenario_files"]
        own = [
            replace(scenario_from(document, f"{where}, scenario {name}"), sha256=scenario_files[name])
            for name, document in description.get("own_scenarios", {}).items()
        ]
        job = job_from(sections, weights, own)
        digests = {agent: entry["sha256"] for agent, entry in stored.items()}
    except (KeyError, TypeError, AttributeError) as error:
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


class _FileCheck:
    """Compares one scenario's file, episode after episode, to what is simulated."""

    def __init__(self, path: Path, name: str, kept: bool, sampled: bool, tolerance: float) -> None:
        self.name = name
        self._kept, self._sampled, self._tolerance = kept, sampled, tolerance
        self._difference: Difference | str | None = None
        self._groups = _numbered(file_rows(path))
        self._rest = pl.DataFrame(schema={"row": pl.Int64, **{n: c.dtype for n, c in DATASET_COLUMNS.items()}})

    def compare(self, block: EpisodeBlock) -> None:
        """Compare the episodes of a block, which come in rising order."""
        if self._difference is not None or len(block) == 0:
            return
        chosen = block.take(np.flatnonzero(block.stored & (block.kept == self._kept)))
        expected = episode_rows(chosen.number.tolist(), chosen.rows(), chosen.pedestrians.tolist())
        try:
            found = self._take(int(block.number[-1]))
        except InvalidInput as error:
            self._difference = str(error)
            return
        if self._sampled:
            found = found.filter(pl.col("count").is_in(block.number.tolist()))
        self._difference = first_difference(expected, found, self._tolerance)

    def finish(self) -> str | None:
        """Return the first difference in words, None for none."""
        if self._difference is None and not self._sampled:
            try:
                rest = pl.concat([self._rest, *self._groups])
            except InvalidInput as error:
                return str(error)
            self._difference = first_difference(rest.drop("row").clear(), rest, self._tolerance)
        return None if self._difference is None else str(self._difference)

    def _take(self, last: int) -> pl.DataFrame:
        """Return the rows not taken yet of episodes up to number `last`."""
        pieces = [self._rest]
        while len(pieces[-1]) == 0 or pieces[-1]["count"][-1] <= last:
            if (group := next(self._groups, None)) is None:
                break
            pieces.append(group)
        rows = pl.concat(pieces)
        beyond = (rows["count"] > last).to_numpy()
        end = int(beyond.argmax()) if beyond.any() else len(rows)
        self._rest = rows[end:]
        return rows[:end]


class _IndexCheck:
    """Compares one scenario's rows of the index to what is simulated."""

    name = INDEX

    def __init__(self, folder: Path, scenario: int, tolerance: float) -> None:
        self._scenario, self._tolerance = scenario, tolerance
        self._difference: Difference | str | None = None
        try:
            index = Dataset(folder).index().with_row_index("row")
            self._rows = index.filter(pl.col("scenario") == scenario)
        except InvalidInput as error:
            self._difference = str(error)

    def compare(self, block: EpisodeBlock) -> None:
        """Compare the episodes of a block."""
        if self._difference is not None or len(block) == 0:
            return
        expected = index_table([index_columns(self._scenario, block)])
        found = self._rows.filter(pl.col("count").is_in(block.number.tolist()))
        self._difference = first_difference(expected, found.select("row", *INDEX_COLUMNS), self._tolerance)

    def finish(self) -> str | None:
        """Return the first difference in words, None for none."""
        return None if self._difference is None else str(self._difference)


def _simulated(pool: Workers, scenario: int, numbers: np.ndarray) -> Iterator[EpisodeBlock]:
    """Yield blocks of episodes, in rising order, with a few on their way at any time."""
    blocks = iter([Unit(scenario, numbers[k : k + BLOCK].tolist()) for k in range(0, len(numbers), BLOCK)])
    waiting: dict[int, EpisodeBlock] = {}
    order: list[int] = []
    running = 0
    while True:
        while running < pool.size + 1 and (unit := next(blocks, None)) is not None:
            pool.submit(unit)
            order.append(unit.numbers[0])
            running += 1
        if not order:
            return
        while order[0] not in waiting:
            for unit, data in pool.collect():
                waiting[unit.numbers[0]] = block_from_bytes(data, "a block just simulated")
                running -= 1
        yield waiting.pop(order.pop(0))


def _numbered(groups: Iterator[pl.DataFrame]) -> Iterator[pl.DataFrame]:
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
