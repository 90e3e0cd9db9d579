"""The dataset on disk: one file a scenario named as in Table 6 with the columns of Table 7, an index, dataset.json.

Episodes arrive as they end, in an order that depends on the batch; they are written in the order of their numbers, in
row groups cut by rows alone, so that the bytes of a file depend on the episodes only. A file appears when everything
is written: until `close` there are hidden part files, and `discard` removes them. `dataset.json` comes last; a folder
without it is no dataset. Memory holds the episodes that wait for an earlier one still running, a row group a file, and
30 bytes an episode for the index.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.dataset_files import DATASET_COLUMNS, FORMATS, INDEX_COLUMNS, EpisodeTable
from vpsci_ros.data.episode_frames import NOT_OPEN, EpisodeBatch
from vpsci_ros.data.filters import KEPT, REASONS, FilterConfig, Judgement, judge
from vpsci_ros.data.parquet import write_parquet
from vpsci_ros.errors import InvalidInput
from vpsci_ros.provenance import require_empty_folder, sha256, software_versions, written_whole
from vpsci_ros.world.state import COLLISION, OUTCOME_NAMES

DESCRIPTION = "dataset.json"
INDEX = "episodes.parquet"
REJECTED = "rejected"


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
        self._waiting: dict[int, dict[int, tuple[bool, NDArray[np.float32]]]] = {}
        self._index: list[tuple[NDArray[Any], ...]] = []
        self._closed = False
        self._tallies: dict[int, _Tally] = {}

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
            self._tallies[number].add(batch, verdict, batch.scenario == number)
        for i in range(len(batch)):
            kept = verdict.reason[i] == KEPT
            waiting = self._waiting[int(batch.scenario[i])]
            number = int(batch.episode[i])
            if number in waiting:
                raise InvalidInput(f"episode {number} of scenario {batch.scenario[i]} came twice")
            rows = batch.values[i, : batch.frames[i]] if kept or self._keep_rejected else batch.values[i, :0]
            waiting[number] = (bool(kept), rows.copy())
        columns = (batch.scenario, batch.episode, batch.outcome, verdict.reason, batch.frames)
        paths = (verdict.vehicle_path.astype(np.float32), verdict.pedestrian_path.astype(np.float32))
        self._index.append((*columns, verdict.least_curvttc, *paths))
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
        self._tallies[number] = _Tally()

    def _release(self, open_from: NDArray[np.int64]) -> None:
        for scenario, waiting in self._waiting.items():
            for number in sorted(n for n in waiting if n < open_from[scenario]):
                kept, values = waiting.pop(number)
                if kept or self._keep_rejected:
                    self._tables[scenario, kept].add(number, values)

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
                files[path.relative_to(self.folder).as_posix()] = _file_entry(path, rows)
        index = _index_table(self._index)
        write_parquet(index, self.folder / INDEX, INDEX_COLUMNS, **self._provenance)
        files[INDEX] = _file_entry(self.folder / INDEX, index.height)
        scenarios = {
            self._names[number]: {"number": number, **counts} for number, counts in sorted(self.counts.items())
        }
        description = {
            "content": "vehicle-pedestrian safety-critical interaction episodes",
            **self._provenance,
            "filters": asdict(self.filters),
            "unfinished": unfinished,
            "scenarios": scenarios,
            "columns": {n: {"unit": c.unit, "description": c.description} for n, c in DATASET_COLUMNS.items()},
            "files": files,
            "versions": software_versions(),
        }
        with written_whole(self.folder / DESCRIPTION) as path:
            path.write_text(json.dumps(description, indent=2) + "\n", encoding="utf-8")
        self._closed = True
        return description

    def discard(self) -> None:
        """Remove everything that was written."""
        for table in self._tables.values():
            table.discard()
        if (self.folder / REJECTED).is_dir():
            (self.folder / REJECTED).rmdir()


class _Tally:
    """Counts of one scenario."""

    def __init__(self) -> None:
        self._reasons: Counter[str] = Counter()
        self._failed = np.zeros(len(REASONS) - 1, np.int64)
        self._outcomes: Counter[str] = Counter()
        self._kept_outcomes: Counter[str] = Counter()
        self._lost_collisions: Counter[str] = Counter()
        self._kilometres = np.zeros(2)

    def add(self, batch: EpisodeBatch, verdict: Judgement, mine: NDArray[np.bool_]) -> None:
        reason, outcome, failed = verdict.reason[mine], batch.outcome[mine], verdict.failed[mine]
        kept = reason == KEPT
        self._reasons.update(REASONS[i] for i in reason.tolist())
        self._failed += failed.sum(axis=0)
        self._outcomes.update(OUTCOME_NAMES[i] for i in outcome.tolist())
        self._kept_outcomes.update(OUTCOME_NAMES[i] for i in outcome[kept].tolist())
        self._lost_collisions.update(REASONS[i] for i in reason[~kept & (outcome == COLLISION)].tolist())
        self._kilometres += [verdict.vehicle_path[mine][kept].sum(), verdict.pedestrian_path[mine][kept].sum()]

    def summary(self) -> dict[str, Any]:
        simulated, kept = sum(self._reasons.values()), self._reasons["kept"]
        return {
            "simulated": simulated,
            "kept": kept,
            "acceptance_rate": kept / simulated if simulated else None,
            "rejected": {name: self._reasons[name] for name in REASONS[1:]},
            "failed": dict(zip(REASONS[1:], self._failed.tolist(), strict=True)),
            "outcomes": {name: self._outcomes[name] for name in OUTCOME_NAMES[1:]},
            "kept_outcomes": {name: self._kept_outcomes[name] for name in OUTCOME_NAMES[1:]},
            "rejected_collisions": {name: self._lost_collisions[name] for name in REASONS[1:]},
            "vehicle_km": round(float(self._kilometres[0]) / 1000.0, 6),
            "pedestrian_km": round(float(self._kilometres[1]) / 1000.0, 6),
        }


def _index_table(parts: list[tuple[NDArray[Any], ...]]) -> pl.DataFrame:
    schema = {name: column.dtype for name, column in INDEX_COLUMNS.items()}
    if not parts:
        return pl.DataFrame(schema=schema)
    columns = dict(zip(INDEX_COLUMNS, (np.concatenate(column) for column in zip(*parts, strict=True)), strict=True))
    table = pl.DataFrame(columns).with_columns(
        pl.col("outcome").replace_strict(dict(enumerate(OUTCOME_NAMES)), return_dtype=pl.String),
        pl.col("reason").replace_strict(dict(enumerate(REASONS)), return_dtype=pl.String),
    )
    return table.cast(schema).sort("scenario", "count")  # type: ignore[arg-type]


def _file_entry(path: Path, rows: int) -> dict[str, Any]:
    return {"rows": rows, "bytes": path.stat().st_size, "sha256": sha256(path)}
