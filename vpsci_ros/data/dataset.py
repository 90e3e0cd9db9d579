"""The dataset on disk: one file a scenario named as in Table 6 with the columns of Table 7, an index, dataset.json.

Episodes arrive as they end, in an order that depends on the batch; they are written in the order of their numbers, in
row groups cut by rows alone, so that the bytes of a file depend on the episodes only. A file appears when everything
is written: until `close` there are hidden part files, and `discard` removes them. `dataset.json` comes last; a folder
without it is no dataset. Memory holds the episodes that wait for an earlier one still running, a row group a file, and
30 bytes an episode for the index.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.dataset_files import FORMATS, INDEX_COLUMNS, EpisodeTable
from vpsci_ros.data.dataset_index import DESCRIPTION, INDEX, REJECTED, Tally, description_of, file_entry, index_table
from vpsci_ros.data.episode_frames import NOT_OPEN, EpisodeBatch
from vpsci_ros.data.filters import KEPT, FilterConfig, Judgement, judge
from vpsci_ros.data.parquet import write_parquet
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import require_empty_folder, write_json


class DatasetWriter:
    """Writes episodes as they come; a context manager that discards everything when its block fails.

    :param folder: made if need be; must be empty.
    :param names: scenario number -> file stem (Table 6); files are made for those of which an episode comes.
    :param provenance: stored in dataset.json and in every Parquet file: configuration, seed, hash of the weights.
    :param period: time from one frame to the next [s].
    :param formats: of `FORMATS`.
    :param keep_rejected: write rejected episodes too, to the folder `rejected` with the same file names.
    :param row_group: rows after which a row group is written.
    :raises InvalidInput: the folder is not empty, or an unknown format.
    """

    def __init__(
        self,
        folder: str | Path,
        names: Mapping[int, str],
        provenance: Mapping[str, Any],
        *,
        period: float = 0.05,
        filters: FilterConfig | None = None,
        formats: Sequence[str] = FORMATS,
        keep_rejected: bool = False,
        row_group: int = 1 << 17,
    ) -> None:
        if not formats or not set(formats) <= set(FORMATS):
            raise InvalidInput(f"formats: expected some of {', '.join(FORMATS)}, got {', '.join(formats) or 'none'}")
        self.folder = require_empty_folder(folder)
        self.filters = filters or FilterConfig()
        self._names = dict(names)
        self._provenance = {"period": period, **provenance}
        self._keep_rejected = keep_rejected
        self._formats, self._row_group = tuple(formats), row_group
        self._tables: dict[tuple[int, bool], EpisodeTable] = {}
        self._waiting: dict[int, dict[int, tuple[bool, NDArray[np.float32], int]]] = {}
        self._index: list[tuple[NDArray[Any], ...]] = []
        self._closed = False
        self._tallies: dict[int, Tally] = {}

    def __enter__(self) -> "DatasetWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None or not self._closed:
            self.discard()

    def add(self, batch: EpisodeBatch) -> Judgement:
        """Judge and store the episodes of a batch, and return the judgement.

        :raises InvalidInput: an episode of a scenario that has no name here, or one that came before.
        """
        verdict = judge(batch, self.filters)
        if len(batch) == 0:
            return verdict
        for number in np.unique(batch.scenario).tolist():
            if number not in self._tallies:
                self._open(number)
            mine = batch.scenario[batch.first] == number
            paths = verdict.vehicle_path[mine], verdict.pedestrian_path[mine]
            outcome = batch.outcome[batch.first][mine]
            self._tallies[number].add(verdict.reason[mine], outcome, verdict.failed[mine], *paths)
        for i, (first, pedestrians) in enumerate(zip(batch.first, batch.pedestrians, strict=True)):
            kept = verdict.reason[i] == KEPT
            waiting = self._waiting[int(batch.scenario[first])]
            number = int(batch.episode[first])
            if number in waiting:
                raise InvalidInput(f"episode {number} of scenario {batch.scenario[first]} came twice")
            rows = batch.rows(first, pedestrians if kept or self._keep_rejected else 0)
            waiting[number] = (bool(kept), rows.copy(), int(pedestrians))
        first = batch.first
        columns = (
            batch.scenario[first],
            batch.episode[first],
            batch.outcome[first],
            verdict.reason,
            batch.frames[first],
        )
        lengths = (verdict.vehicle_path.astype(np.float32), verdict.pedestrian_path.astype(np.float32))
        self._index.append((*columns, verdict.least_curvttc, *lengths))
        self._release(batch.open_from)
        return verdict

    def _open(self, number: int) -> None:
        """Begin the files of a scenario."""
        if number not in self._names:
            raise InvalidInput(f"episode of scenario {number}: this dataset has {', '.join(map(str, self._names))}")
        for kept in (True, False) if self._keep_rejected else (True,):
            place = self.folder if kept else self.folder / REJECTED
            place.mkdir(exist_ok=True)
            name = self._names[number]
            metadata = {"scenario": number, "name": name, "kept": kept, **self._provenance}
            self._tables[number, kept] = EpisodeTable(place, name, self._formats, self._row_group, metadata)
        self._waiting[number] = {}
        self._tallies[number] = Tally()

    def _release(self, open_from: NDArray[np.int64]) -> None:
        for scenario, waiting in self._waiting.items():
            for number in sorted(n for n in waiting if n < open_from[scenario]):
                kept, values, pedestrians = waiting.pop(number)
                if kept or self._keep_rejected:
                    self._tables[scenario, kept].add(number, values, pedestrians)

    @property
    def counts(self) -> dict[int, dict[str, Any]]:
        """By scenario: simulated, kept, acceptance rate, rejected by reason, failed by condition, collisions, km."""
        return {number: tally.summary() for number, tally in self._tallies.items()}

    def close(self, *, unfinished: int = 0) -> dict[str, Any]:
        """Write what is left, the index and dataset.json, and return the latter's content.

        :param unfinished: episodes that were started and not seen to their end; they are only counted.
        """
        self._release(np.full(256, NOT_OPEN))
        files = {}
        for table in self._tables.values():
            for path, rows in table.close():
                files[path.relative_to(self.folder).as_posix()] = file_entry(path, rows)
        index = index_table(self._index)
        write_parquet(index, self.folder / INDEX, INDEX_COLUMNS, **self._provenance)
        files[INDEX] = file_entry(self.folder / INDEX, index.height)
        scenarios = {
            self._names[number]: {"number": number, **counts} for number, counts in sorted(self.counts.items())
        }
        description = description_of(self._provenance, self.filters, unfinished, scenarios, files)
        write_json(self.folder / DESCRIPTION, description)
        self._closed = True
        return description

    def discard(self) -> None:
        """Remove everything that was written."""
        for table in self._tables.values():
            table.discard()
        if (self.folder / REJECTED).is_dir():
            (self.folder / REJECTED).rmdir()
