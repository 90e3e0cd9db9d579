"""A dataset's folder read back, a row group at a time."""

from collections.abc import Collection, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow as pa

from vpsci_ros.data.dataset_description import DESCRIPTION, FORM
from vpsci_ros.data.dataset_tables import (
    EPISODE_COLUMNS,
    FORMATS,
    INDEX,
    INDEX_COLUMNS,
    REJECTED,
    block_of_rows,
    records_of,
)
from vpsci_ros.data.episode import Episode, Listed
from vpsci_ros.data.episode_block import EpisodeBlock
from vpsci_ros.data.parquet import open_parquet, read_bounded, read_parquet
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

    def stored(self, name: str) -> EpisodeBlock:
        """Return a scenario's episodes as they were written, by its name; the kinds of pedestrians are not known.

        :raises InvalidInput: a file is missing, or holds other episodes than the index.
        """
        keep = self.holds_rejected(name)
        index = self.index().filter(pl.col("scenario") == self.scenarios[name]["number"])
        parts = [part for rejected in (False, True)[: 1 + keep] for _, part in self._parts(name, rejected=rejected)]
        rows = pl.concat([pl.DataFrame(schema=_SCHEMA), *parts]).sort("count", maintain_order=True)
        records, found = records_of(index, keep), block_of_rows(rows, self.folder / name)
        sizes = ["scenario", "count", "frames", "pedestrians"]
        if not np.array_equal(found.records[sizes], records[records["rows"] > 0][sizes]):
            raise InvalidInput(f"{self.folder / name}: other episodes than {INDEX} lists; generate the dataset again")
        return EpisodeBlock(records, found.values)

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
                    for key, values in block_of_rows(part, path).motions():
                        if (one := listed.get(key)) is not None:
                            of = str(self.folder), one, self._roads.get(one.group), self.period
                            yield Episode.from_values(*of, values, marks=marks.get(key, ()))

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


_SCHEMA = {name: column.dtype for name, column in EPISODE_COLUMNS.items()}
