"""A dataset folder read back: its description, its index, its rows and its episodes, a row group at a time."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow as pa
from numpy.typing import NDArray

from vpsci_ros.data.dataset_description import DESCRIPTION, FORM
from vpsci_ros.data.dataset_tables import (
    DATASET_COLUMNS,
    FORMATS,
    INDEX,
    INDEX_COLUMNS,
    REJECTED,
    pieces,
)
from vpsci_ros.data.episode import Episode, Key, Listed, filled, headings
from vpsci_ros.data.episode_block import QUANTITIES
from vpsci_ros.data.parquet import open_parquet, read_bounded, read_parquet
from vpsci_ros.documents import read_json, reason, require_form, require_regular
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import curvature_from_yaw_rate
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
        older = {"range": ""}  # what a dataset from before 26 November 2026 lacks
        return read_parquet(self.folder / INDEX, "the index of a dataset", INDEX_COLUMNS, older)

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
        for name in (scenario,) if scenario else self.scenarios:
            if name in groups:
                number = int(self.scenarios[name]["number"])
                for path, part in self._parts(name, rejected=rejected):
                    if part.height:
                        yield from self._episodes(part, path, number, listed)

    def _episodes(
        self, rows: pl.DataFrame, path: Path, scenario: int, listed: Mapping[Key, Listed]
    ) -> Iterator[Episode]:
        count, values = rows["count"].to_numpy(), rows.select(QUANTITIES).to_numpy()
        for begin, end, people in pieces(rows, path):
            if (one := listed.get((scenario, int(count[begin])))) is not None:
                columns = values[begin:end].reshape(people, -1, len(QUANTITIES)).transpose(2, 0, 1)
                yield self._episode(one, columns.astype(np.float64))

    @cached_property
    def _beyond(self) -> set[Key]:
        return set(self.index().filter(pl.col("range") == "beyond").select("scenario", "count").rows())

    def _episode(self, listed: Listed, columns: NDArray[np.float64]) -> Episode:
        """Return an episode of columns float64[10, n, T]; the vehicle moves along its heading."""
        x, y, vx, vy = columns[:4, 0]
        heading, speed = headings(filled(vx), filled(vy)), np.hypot(vx, vy)
        rate = np.gradient(filled(heading), self.period) if len(x) > 1 else np.zeros(1)
        vehicle = x, y, heading, speed, curvature_from_yaw_rate(rate, filled(speed))
        px, py, pvx, pvy, distance, curvttc = columns[4:]
        walk = px, py, pvx, pvy, curvttc, distance, np.zeros(px.shape, np.bool_)
        found = Episode(str(self.folder), listed, self._roads.get(listed.group), self.period, *vehicle, *walk)
        return replace(found, marks=("beyond_range",)) if listed.key in self._beyond else found

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

    :raises InvalidInput: damaged, or not a table with the columns of Table 7.
    """
    row = 0
    require_regular(path)
    try:
        if path.suffix == ".csv":
            yield pl.read_csv(path, schema=_SCHEMA)
            return
        with open_parquet(path) as file:
            for group in range(file.num_row_groups):
                part = read_bounded(file, group)
                yield part.select(list(DATASET_COLUMNS))
                row += part.height
    except (pa.ArrowException, pl.exceptions.PolarsError, OSError, ValueError) as error:
        raise InvalidInput(
            f"{path}: expected the columns of Table 7, not readable as such from row {row} on: {reason(error)}"
        ) from error


_SCHEMA = {name: column.dtype for name, column in DATASET_COLUMNS.items()}
