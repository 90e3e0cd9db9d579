"""Stored episodes read back: a dataset's folder, a row group at a time, and the file of a run of an exam."""

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow as pa
from numpy.typing import NDArray

from vpsci_ros.data.dataset_description import DESCRIPTION, FORM
from vpsci_ros.data.dataset_tables import (
    EPISODE_COLUMNS,
    FORMATS,
    INDEX,
    INDEX_COLUMNS,
    NEXT_PEDESTRIAN,
    NEXT_SCENARIO,
    REJECTED,
    records_of,
)
from vpsci_ros.data.episode import QUANTITIES, Episode, Key, Listed
from vpsci_ros.data.parquet import open_parquet, read_bounded, read_metadata, read_parquet
from vpsci_ros.documents import path_in_utf8, read_json, reason, require_form, require_regular
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import changed_files
from vpsci_ros.world import Scenario
from vpsci_ros.world.scenario import every_scenario, own_scenarios


class Dataset:
    """A dataset's folder, completed by `DatasetWriter`.

    :raises InvalidInput: no such folder, or no readable dataset.json in it.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.description = self._describe()
        self.scenarios: dict[str, dict[str, Any]] = self.description["scenarios"]
        self.period = float(self.description["period"])
        for name in self.description["files"]:
            require_regular(self.folder / name)  # also those that no caller reads

    def _describe(self) -> dict[str, Any]:
        path = self.folder / DESCRIPTION
        if not path.is_file():
            raise InvalidInput(
                f"{path}: no such file; expected the folder of a dataset (its run may have been stopped before the end)"
            )
        description: dict[str, Any] = read_json(path)
        require_form(description, FORM, f"{path}: not the description of a dataset")
        if not 0.0 < float(description["period"]) < 1e3:
            raise InvalidInput(f"{path}: period = {description['period']}: expected a time [s] above 0")
        return description

    @property
    def inputs(self) -> dict[str, Path]:
        """Files whose hashes identify the dataset, by name."""
        return {DESCRIPTION: self.folder / DESCRIPTION}

    def index(self) -> pl.DataFrame:
        """Return a row for each episode, kept or rejected, with the columns of `INDEX_COLUMNS`."""
        return read_parquet(self.folder / INDEX, "the index of a dataset", INDEX_COLUMNS)

    def changed(self) -> list[str]:
        """Return the names of the files that are missing or have another hash than dataset.json says."""
        return changed_files(self.folder, {name: file["sha256"] for name, file in self.description["files"].items()})

    def warning(self) -> str:
        """Return which files changed since the dataset was written, in words; "" if none did."""
        changed = ", ".join(self.changed())
        return (
            f"{self.folder}: changed since it was written, so {DESCRIPTION} differs: {changed}; "
            "`vpsci dataset select` makes a dataset of a part of the episodes"
            if changed
            else ""
        )

    def stored(self, name: str) -> tuple[NDArray[np.void], pl.DataFrame]:
        """Return a scenario's episodes as they were written, by its name: JUDGED[n], and the rows in their order."""
        keep = self.holds_rejected(name)
        index = self.index().filter(pl.col("scenario") == self.scenarios[name]["number"])
        parts = [part for rejected in (False, True)[: 1 + keep] for _, part in self._parts(name, rejected=rejected)]
        rows = pl.concat([pl.DataFrame(schema=_SCHEMA), *parts]).sort("count", maintain_order=True)
        return records_of(index, keep), rows

    @cached_property
    def own_scenarios(self) -> list[Scenario]:
        """The scenarios other than the paper's, whose documents dataset.json contains."""
        return own_scenarios(self.description.get("own_scenarios"), str(self.folder))

    @cached_property
    def _roads(self) -> dict[str, Scenario]:
        return {scenario.name: scenario for scenario in every_scenario(self.description.get("own_scenarios"))}

    def listed(self, *, rejected: bool = False) -> list[Listed]:
        """Return the kept episodes, or the rejected ones, without their motion, named SCENARIO:NUMBER."""
        groups = {int(counts["number"]): name for name, counts in self.scenarios.items()}
        index = self.index()
        rows = index.filter((pl.col("reason") == "kept") != rejected)
        return [
            Listed(f"{scenario}:{number}", groups.get(scenario, ""), scenario, number, outcome, least)
            for scenario, number, outcome, least in rows.select("scenario", "count", "outcome", "least_curvttc").rows()
        ]

    def read(
        self, wanted: Collection[str] | None = None, *, scenario: str = "", rejected: bool = False
    ) -> Iterator[Episode]:
        """Yield kept episodes, one scenario after the other.

        :param wanted: names SCENARIO:NUMBER; None: all. Files without any of them are not opened.
        :param scenario: only of this one, by its name.
        :param rejected: those that were rejected instead, where the dataset keeps them (`dataset.keep_rejected`).
        :raises InvalidInput: a file is missing or does not hold what the description promises.
        """
        listed = {one.key: one for one in self.listed(rejected=rejected) if wanted is None or one.name in wanted}
        groups = {one.group for one in listed.values()}
        beyond = self.index().filter(pl.col("range") == "beyond").select("scenario", "count").rows()
        marks = dict.fromkeys(beyond, ("beyond_range",))
        for name in (scenario,) if scenario else self.scenarios:
            if name in groups:
                for path, part in self._parts(name, rejected=rejected):
                    yield from episodes_in(part, path, listed, self._roads, self.period, str(self.folder), marks=marks)

    def holds_rejected(self, name: str) -> bool:
        """Whether the dataset holds the rejected episodes of a scenario (`dataset.keep_rejected`)."""
        return self._file(name, rejected=True) is not None

    def rows(self, name: str) -> pl.DataFrame:
        """Return all rows of a scenario's kept episodes, by the scenario's name."""
        return pl.concat([pl.DataFrame(schema=_SCHEMA), *(part for _, part in self._parts(name))])

    def _file(self, name: str, *, rejected: bool) -> Path | None:
        """Return a scenario's file of kept or of rejected episodes, Parquet or else CSV; None: neither is there."""
        if name not in self.scenarios:
            raise InvalidInput(f"{self.folder}: no scenario {name}; it has {', '.join(self.scenarios)}")
        folder = self.folder / REJECTED if rejected else self.folder
        return next((path for form in FORMATS if (path := folder / f"{name}.{form}").is_file()), None)

    def _parts(self, name: str, *, rejected: bool = False) -> Iterator[tuple[Path, pl.DataFrame]]:
        path = self._file(name, rejected=rejected)
        if path is None and not rejected:
            raise InvalidInput(
                f"{self.folder / name}.parquet: no such file, and no {name}.csv; {DESCRIPTION} promises it"
            )
        yield from ((path, rows) for rows in file_rows(path)) if path is not None else ()


def file_table(path: Path) -> pl.DataFrame:
    """Return all rows of a dataset's file, see `file_rows`."""
    return pl.concat([pl.DataFrame(schema=_SCHEMA), *file_rows(path)])


def file_rows(path: Path) -> Iterator[pl.DataFrame]:
    """Yield the rows of a dataset's file, a row group at a time (a CSV file in one piece).

    :raises InvalidInput: damaged, or not a table with `EPISODE_COLUMNS`.
    """
    row = 0
    require_regular(path)
    try:
        if path.suffix == ".csv":
            with path_in_utf8(path) as name:
                yield pl.read_csv(name, schema=_SCHEMA)
            return
        with open_parquet(path) as file:
            for group in range(file.num_row_groups):
                part = read_bounded(file, group)
                yield part.select(list(EPISODE_COLUMNS))
                row += part.height
    except (pa.ArrowException, pl.exceptions.PolarsError, OSError, ValueError) as error:
        raise InvalidInput(
            f"{path}: expected the columns of an episode ({', '.join(EPISODE_COLUMNS)}), not readable as such from row "
            f"{row} on: {reason(error)}"
        ) from error


def episodes_in(
    rows: pl.DataFrame,
    path: Path,
    listed: Mapping[Key, Listed],
    roads: Mapping[str, Scenario],
    period: float,
    source: str = "",
    *,
    kinds: Mapping[Key, Sequence[str]] | None = None,
    marks: Mapping[Key, tuple[str, ...]] | None = None,
) -> Iterator[Episode]:
    """Yield the listed episodes of rows with `EPISODE_COLUMNS`.

    :param rows: of whole episodes; `path`: of their file, the opening of an error message.
    :param listed: metadata of the wanted episodes, `kinds` of their pedestrians, and `marks`, by their keys.
    :param roads: scenarios by name.
    :raises InvalidInput: frames that do not count from 0 for each pedestrian, or pedestrians of unequal lengths.
    """
    values = rows.select(pl.col(*QUANTITIES).cast(pl.Float64)).to_numpy()
    for key, begin, end, people in _pieces(rows, path):
        if (one := listed.get(key)) is not None:
            own = values[begin:end].reshape(people, -1, len(QUANTITIES))
            more = {"kinds": tuple((kinds or {}).get(key, ())), "marks": (marks or {}).get(key, ())}
            yield Episode.from_values(source or str(path), one, roads.get(one.group), period, own, **more)


def _pieces(rows: pl.DataFrame, path: Path) -> Iterator[tuple[Key, int, int, int]]:
    """Yield each episode's key, first row, the row after its last row, and its number of pedestrians."""
    scenario, count, frame, walker = (rows[name].to_numpy() for name in ("scenario", "count", "frame", "ped_id"))
    if not len(count):
        return
    changes = np.diff(count, prepend=count[0] - 1) | np.diff(walker, prepend=walker[0])
    starts = np.flatnonzero(changes)
    lengths = np.diff(starts, append=len(count))
    expected = np.arange(len(count)) - np.repeat(starts, lengths)
    if not np.array_equal(expected, frame):
        row = int(np.argmax(expected != frame))
        raise InvalidInput(f"{path}: frame {frame[row]} of episode {count[row]}: expected frame {expected[row]}")
    number = walker[starts] % NEXT_SCENARIO // NEXT_PEDESTRIAN
    first = np.flatnonzero(np.diff(scenario[starts], prepend=-1) | np.diff(count[starts], prepend=-1))
    several = np.diff(first, append=len(starts))
    wanted, place = np.repeat(lengths[first], several), np.arange(len(starts)) - np.repeat(first, several)
    for what, right, got in (("its number", place, number), ("the number of its frames", wanted, lengths)):
        if (wrong := np.flatnonzero(got != right)).size:
            piece = wrong[0]
            name = f"{scenario[starts[piece]]}:{count[starts[piece]]}"
            raise InvalidInput(
                f"{path}: episode {name}, pedestrian {number[piece]}: expected {what} to be {right[piece]}, got "
                f"{got[piece]}; rows are missing or lie apart, so make the file again"
            )
    begins = np.append(starts[first], len(count))
    keys = zip(scenario[begins[:-1]].tolist(), count[begins[:-1]].tolist(), strict=True)
    for key, (begin, end), people in zip(keys, itertools.pairwise(begins.tolist()), several.tolist(), strict=True):
        yield key, begin, end, people


class EpisodeFile:
    """Simulated episodes in one Parquet file, as `write_episodes` writes it.

    :ivar facts: what else was stored.
    :ivar listed: the episodes without their motion.
    :ivar period: time from one frame to the next [s].
    :raises InvalidInput: it cannot be read, or holds something else.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.facts = path, read_metadata(path)
        try:
            self.listed = [Listed(*each) for each in self.facts["listed"]]
            self.period = float(self.facts["period"])
            self._kinds = {one.key: kinds for one, kinds in zip(self.listed, self.facts["kinds"], strict=True)}
            self.own_scenarios = own_scenarios(self.facts["own_scenarios"], str(path))
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidInput(f"{path}: not readable as episodes of a run ({reason(error)}); drive it again") from None

    def read(self) -> Iterator[Episode]:
        """Yield the episodes.

        :raises InvalidInput: the rows cannot be read.
        """
        rows = read_parquet(self.path, "the episodes of a run", EPISODE_COLUMNS)
        roads = {scenario.name: scenario for scenario in every_scenario(self.facts["own_scenarios"])}
        listed = {one.key: one for one in self.listed}
        yield from episodes_in(rows, self.path, listed, roads, self.period, kinds=self._kinds)


_SCHEMA = {name: column.dtype for name, column in EPISODE_COLUMNS.items()}
