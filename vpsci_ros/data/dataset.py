"""The dataset on disk: a file a scenario (name: Table 6, columns: Table 7), the index episodes.parquet, dataset.json.

Episodes are written in the order of their numbers, in row groups cut by rows alone, so that the bytes of a file depend
on the episodes only: not on who simulated them, nor on the order in which they ended. A file appears when everything
is written: until `close` there are hidden part files. `dataset.json` comes last; a folder
without it is no dataset.
"""

import contextlib
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vpsci_ros.data.dataset_description import DATASHEET, DESCRIPTION, description_of, file_entry
from vpsci_ros.data.dataset_tables import (
    ENCODING,
    EPISODE_COLUMNS,
    FORMATS,
    INDEX,
    INDEX_COLUMNS,
    REJECTED,
    arrow_rows,
    index_table,
)
from vpsci_ros.data.episode_block import JUDGED, EpisodeBlock, concat_blocks
from vpsci_ros.data.filters import FilterConfig, apply_filters
from vpsci_ros.data.parquet import arrow_schema, as_polars, write_parquet
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import atomic_write, require_empty_folder, write_json, write_text

ROW_GROUP = 1 << 17


class EpisodeTable:
    """One scenario's episodes, written in row groups to a hidden part file: CSV if the path ends in .csv, else Parquet.

    :param row_group: rows at which a row group is written, with all rows of its last episode.
    :param metadata: stored in the schema of a Parquet file.
    """

    def __init__(self, path: Path, row_group: int, metadata: Mapping[str, Any]) -> None:
        self._path, self._part = path, path.with_name(f".{path.name}.part")
        self._schema = arrow_schema(EPISODE_COLUMNS, metadata)
        self._file = self._part.open("wb")
        self._parquet = None if path.suffix == ".csv" else pq.ParquetWriter(self._file, self._schema, **ENCODING)
        if self._parquet is None:
            self._file.write((",".join(EPISODE_COLUMNS) + "\n").encode())
        self._row_group = row_group
        self._left = self._schema.empty_table()
        self.rows = 0

    def add(self, rows: pa.Table) -> None:
        """Append the rows of whole episodes, whose numbers are above those of the episodes added before."""
        self._left = pa.concat_tables([self._left, rows])
        while self._left.num_rows >= self._row_group:
            ends = np.append(np.flatnonzero(np.diff(self._left["count"].to_numpy())) + 1, self._left.num_rows)
            end = int(ends[np.searchsorted(ends, self._row_group)])
            self._flush(self._left.slice(0, end))
            self._left = self._left.slice(end)

    def _flush(self, rows: pa.Table) -> None:
        if not rows.num_rows:
            return
        if self._parquet is not None:
            self._parquet.write_table(rows.combine_chunks())
        else:
            as_polars(rows).write_csv(self._file, include_header=False)
        self.rows += rows.num_rows

    def close(self) -> tuple[Path, int]:
        """Finish the file, give it its final name, and return its path and its number of rows."""
        self._flush(self._left)
        self._end()
        self._part.replace(self._path)
        return self._path, self.rows

    def discard(self) -> None:
        """Remove the part file, or the finished file."""
        self._end()
        self._part.unlink(missing_ok=True)
        self._path.unlink(missing_ok=True)

    def _end(self) -> None:
        with contextlib.closing(self._file):
            if self._parquet is not None:
                self._parquet.close()


class DatasetWriter:
    """Writes episodes; a context manager that removes all its files when its block fails or does not `close`.

    :param folder: made if need be; must be empty.
    :param names: scenario number -> file stem (Table 6); `begin` makes the files of a scenario.
    :param provenance: stored in dataset.json and in every Parquet file: configuration, seed, hash of the weights, and
        `period`, the time from one frame to the next [s].
    :param formats: of `FORMATS`; a file of each scenario in each of them.
    :param keep_rejected: write rejected episodes too, to the folder `rejected` with the same file names.
    :param row_group: see `EpisodeTable`.
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
        formats: Sequence[str] = FORMATS[:1],
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
        self._tables: dict[tuple[int, bool], list[EpisodeTable]] = {}  # of kept and of rejected episodes, by scenario
        self._records: dict[int, list[np.ndarray]] = {}  # of the episodes that were written, by scenario
        self._others: list[str] = []  # files besides the scenarios' that `close` began to write
        self._closed = False

    def __enter__(self) -> "DatasetWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None or not self._closed:
            self.discard()

    def begin(self, number: int) -> None:
        """Open the files of a scenario, once; begun scenarios may be written in parallel, each by one thread.

        :raises InvalidInput: the scenario has no name here.
        """
        if number not in self._names:
            raise InvalidInput(f"episode of scenario {number}: this dataset has {', '.join(map(str, self._names))}")
        if number in self._records:
            return
        self._records[number], name = [np.zeros(0, JUDGED)], self._names[number]
        for kept in (True, False) if self.keep_rejected else (True,):
            place = self.folder if kept else self.folder / REJECTED
            place.mkdir(exist_ok=True)
            metadata = {"scenario": number, "name": name, "kept": kept, **self._provenance}
            paths = [place / f"{name}.{form}" for form in self._formats]
            self._tables[number, kept] = [EpisodeTable(path, self._row_group, metadata) for path in paths]

    def write(self, number: int, block: EpisodeBlock) -> None:
        """Write filtered episodes of a scenario, kept and rejected ones apart, with numbers above those written before.

        :param block: whose rejected episodes have rows if `keep_rejected`, and only then.
        """
        for kept in (True, False) if self.keep_rejected else (True,):
            rows = arrow_rows(block.only(block.kept == kept) if self.keep_rejected else block)
            for table in self._tables[number, kept]:
                table.add(rows)
        self._records[number].append(block.records)

    def close(
        self,
        *,
        unfinished: int = 0,
        beside: Mapping[str, bytes] | None = None,
        datasheet: Callable[[Mapping[str, Any]], str] | None = None,
    ) -> dict[str, Any]:
        """Complete the files, write the index and dataset.json, and return the content of dataset.json.

        :param unfinished: episodes that were started and not seen to their end; they are only counted.
        :param beside: content of further files of the dataset, by name.
        :param datasheet: makes the folder's README.md of the description.
        """
        self._others = [INDEX, *(beside or {}), DATASHEET, DESCRIPTION]
        files = {}
        for table in itertools.chain(*self._tables.values()):
            path, rows = table.close()
            files[path.relative_to(self.folder).as_posix()] = file_entry(path, rows)
        records = {self._names[number]: (number, np.concatenate(own)) for number, own in sorted(self._records.items())}
        index = index_table(np.concatenate([np.zeros(0, JUDGED), *(own for _, own in records.values())]))
        write_parquet(index, self.folder / INDEX, INDEX_COLUMNS, **self._provenance)
        files[INDEX] = file_entry(self.folder / INDEX, index.height)
        for name, data in (beside or {}).items():
            with atomic_write(self.folder / name) as path:
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
        """Remove every file that this writer wrote, finished or not."""
        for table in itertools.chain(*self._tables.values()):
            table.discard()
        for name in self._others:
            (self.folder / name).unlink(missing_ok=True)
        rejected = self.folder / REJECTED
        if rejected.is_dir() and not any(rejected.iterdir()):
            rejected.rmdir()


def write_blocks(writer: DatasetWriter, blocks: Iterable[EpisodeBlock]) -> int:
    """Apply the writer's filters to episodes that come in any order, write them, and return the number of episodes.

    :raises InvalidInput: an episode comes twice, or its scenario has no name in the dataset.
    """
    found: dict[int, list[EpisodeBlock]] = {}
    for block in blocks:
        judged = apply_filters(block, writer.filters).stored(writer.keep_rejected)
        for number in np.unique(judged.records["scenario"]).tolist():
            found.setdefault(number, []).append(judged.only(judged.records["scenario"] == number))
    for number, parts in found.items():
        whole = concat_blocks(parts)
        if (again := np.diff(whole.records["count"]) == 0).any():
            twice = whole.records["count"][int(again.argmax())]
            raise InvalidInput(f"episode {twice} of scenario {number} came twice")
        writer.begin(number)
        writer.write(number, whole)
    return sum(len(block) for parts in found.values() for block in parts)
