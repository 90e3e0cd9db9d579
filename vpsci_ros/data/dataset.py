"""The dataset on disk: one file a scenario named as in Table 6 with the columns of Table 7, an index, dataset.json.

Episodes are written in the order of their numbers, in row groups cut by rows alone, so that the bytes of a file depend
on the episodes only: not on who simulated them, nor on the order in which they ended. A file appears when everything
is written: until `close` there are hidden part files, and `discard` removes them. `dataset.json` comes last; a folder
without it is no dataset. Memory holds the episodes that wait for an earlier one still running, a row group a file, and
60 bytes an episode for the index.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.dataset_files import FORMATS, INDEX_COLUMNS, EpisodeTable
from vpsci_ros.data.dataset_index import (
    DATASHEET,
    DESCRIPTION,
    INDEX,
    REJECTED,
    description_of,
    file_entry,
    index_table,
)
from vpsci_ros.data.episode_block import EpisodeBlock, block_of, joined
from vpsci_ros.data.episode_frames import NOT_OPEN, EpisodeBatch
from vpsci_ros.data.filters import RECORD, FilterConfig, apply_filters
from vpsci_ros.data.parquet import write_parquet
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import require_empty_folder, write_json, write_text, written_whole

ROW_GROUP = 1 << 17


class ScenarioWriter:
    """One scenario's share of a dataset: its files and the records of its episodes.

    :param tables: of the kept episodes (True) and, where they are written, of the rejected ones.
    """

    def __init__(self, number: int, tables: Mapping[bool, EpisodeTable]) -> None:
        self.tables = tables
        self._number, self._records = number, [np.zeros(0, RECORD)]
        self._waiting: dict[int, EpisodeBlock] = {}  # an episode each, by its number

    @property
    def records(self) -> NDArray[np.void]:
        """RECORD[n] of the episodes that were written."""
        return np.concatenate(self._records)

    def write(self, block: EpisodeBlock) -> None:
        """Write episodes, which follow those written before in the order of their numbers."""
        for record, kept, rows in zip(block.records, block.kept, block.rows(), strict=True):
            if len(rows) and (table := self.tables.get(bool(kept))):
                table.add(int(record["count"]), rows, int(record["pedestrians"]))
        self._records.append(block.records)

    def wait(self, block: EpisodeBlock) -> None:
        """Take episodes in any order; they are written when `release` says that none before them is to come.

        :raises InvalidInput: one of them waits already.
        """
        for i, number in enumerate(block.records["count"].tolist()):
            if number in self._waiting:
                raise InvalidInput(f"episode {number} of scenario {self._number} came twice")
            self._waiting[number] = block.take(np.array([i]))

    def release(self, below: int) -> None:
        """Write the waiting episodes with numbers below `below`."""
        if ready := [self._waiting.pop(number) for number in list(self._waiting) if number < below]:
            self.write(joined(ready))


class DatasetWriter:
    """Writes episodes as they come; a context manager that discards everything when its block fails.

    :param folder: made if need be; must be empty.
    :param names: scenario number -> file stem (Table 6); files are made for those of which an episode comes.
    :param provenance: stored in dataset.json and in every Parquet file: configuration, seed, hash of the weights, and
        `period`, the time from one frame to the next [s].
    :param formats: of `FORMATS`.
    :param keep_rejected: write rejected episodes too, to the folder `rejected` with the same file names.
    :param row_group: rows after which a row group is written.
    :param resumed: the folder need not be empty; what an earlier attempt has left there is replaced.
    :raises InvalidInput: the folder is not empty, or an unknown format.
    """

    def __init__(
        self,
        folder: str | Path,
        names: Mapping[int, str],
        provenance: Mapping[str, Any],
        *,
        filters: FilterConfig | None = None,
        formats: Sequence[str] = FORMATS,
        keep_rejected: bool = False,
        row_group: int = ROW_GROUP,
        resumed: bool = False,
    ) -> None:
        if not formats or not set(formats) <= set(FORMATS):
            raise InvalidInput(f"formats: expected some of {', '.join(FORMATS)}, got {', '.join(formats) or 'none'}")
        self.folder = Path(folder) if resumed else require_empty_folder(folder)
        self.filters = filters or FilterConfig()
        self.keep_rejected = keep_rejected
        self._names, self._provenance = dict(names), dict(provenance)
        self._formats, self._row_group = tuple(formats), row_group
        self._scenarios: dict[int, ScenarioWriter] = {}
        self._closed = False

    def __enter__(self) -> "DatasetWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None or not self._closed:
            self.discard()

    def scenario(self, number: int) -> ScenarioWriter:
        """Return the share of a scenario, begun when it is first requested; shares may be written in threads.

        :raises InvalidInput: the scenario has no name here.
        """
        if number not in self._names:
            raise InvalidInput(f"episode of scenario {number}: this dataset has {', '.join(map(str, self._names))}")
        if number not in self._scenarios:
            tables, name = {}, self._names[number]
            for kept in (True, False) if self.keep_rejected else (True,):
                place = self.folder if kept else self.folder / REJECTED
                place.mkdir(exist_ok=True)
                metadata = {"scenario": number, "name": name, "kept": kept, **self._provenance}
                tables[kept] = EpisodeTable(place, name, self._formats, self._row_group, metadata)
            self._scenarios[number] = ScenarioWriter(number, tables)
        return self._scenarios[number]

    def add(self, batch: EpisodeBatch) -> None:
        """Apply the filters to the episodes of a batch, and store them.

        :raises InvalidInput: an episode of a scenario that has no name here, or one that came before.
        """
        if len(batch) == 0:
            return
        records = apply_filters(batch, self.filters)
        for number in np.unique(batch.scenario).tolist():
            self.scenario(number).wait(block_of(batch, records, self.keep_rejected, number))
        for number, scenario in self._scenarios.items():
            scenario.release(int(batch.open_from[number]))

    @property
    def empty(self) -> bool:
        """Whether no episode came."""
        return not self._scenarios

    def close(
        self,
        *,
        unfinished: int = 0,
        beside: Mapping[str, bytes] | None = None,
        datasheet: Callable[[Mapping[str, Any]], str] | None = None,
    ) -> dict[str, Any]:
        """Write what is left, the index and dataset.json, and return the latter's content.

        :param unfinished: episodes that were started and not seen to their end; they are only counted.
        :param beside: further files of the dataset, by their names.
        :param datasheet: makes the folder's README.md of the description.
        """
        files = {}
        for scenario in self._scenarios.values():
            scenario.release(NOT_OPEN)
            for table in scenario.tables.values():
                for path, rows in table.close():
                    files[path.relative_to(self.folder).as_posix()] = file_entry(path, rows)
        records = {self._names[number]: (number, s.records) for number, s in sorted(self._scenarios.items())}
        index = index_table(np.concatenate([np.zeros(0, RECORD), *(own for _, own in records.values())]))
        write_parquet(index, self.folder / INDEX, INDEX_COLUMNS, **self._provenance)
        files[INDEX] = file_entry(self.folder / INDEX, index.height)
        for name, data in (beside or {}).items():
            with written_whole(self.folder / name) as path:
                path.write_bytes(data)
            files[name] = file_entry(self.folder / name, 0)
        description = description_of(self._provenance, self.filters, unfinished, records, files)
        if datasheet is not None:
            write_text(self.folder / DATASHEET, datasheet(description))
            description["files"][DATASHEET] = file_entry(self.folder / DATASHEET, 0)
        write_json(self.folder / DESCRIPTION, description)
        self._closed = True
        return description

    def discard(self) -> None:
        """Remove everything that was written."""
        for scenario in self._scenarios.values():
            for table in scenario.tables.values():
                table.discard()
        rejected = self.folder / REJECTED
        if rejected.is_dir() and not any(rejected.iterdir()):
            rejected.rmdir()
