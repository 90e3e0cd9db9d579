"""The tables of a dataset: their columns, and the writer of one file.

CurvTTC is infinite where no contact is predicted within the horizon ("inf" in CSV, which pandas, polars, numpy and R
read as infinity); the authors publish no word on it. NaN are values that nobody saw. `count` is the number of the
episode within its scenario, with which it can be simulated again; `veh_id` and `ped_id` are 2 count and 2 count + 1,
so that no two agents of a file share one. The pedestrian with number n in its episode has 2^33 n more, and its rows
come after those of the one before.
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vpsci_ros.data.episode_block import EpisodeBlock, joined
from vpsci_ros.data.parquet import Column, arrow_schema

Numbers = NDArray[np.int64]
FORMATS = ("parquet", "csv")
NEXT_PEDESTRIAN = 2**33  # from one pedestrian's `ped_id` to the next one's
DATASET_COLUMNS: dict[str, Column] = {
    "count": Column(pl.Int64, "", "interaction episode index: number of the episode within its scenario"),
    "frame": Column(pl.Int32, "", "frame number within the episode, 0 at the spawn"),
    "veh_id": Column(pl.Int64, "", "unique vehicle identifier"),
    "ped_id": Column(pl.Int64, "", "unique pedestrian identifier"),
    "position_x_av": Column(pl.Float32, "m", "vehicle position, east"),
    "position_y_av": Column(pl.Float32, "m", "vehicle position, north"),
    "velocity_x_av": Column(pl.Float32, "m/s", "vehicle velocity, east"),
    "velocity_y_av": Column(pl.Float32, "m/s", "vehicle velocity, north"),
    "position_x_ped": Column(pl.Float32, "m", "pedestrian position, east"),
    "position_y_ped": Column(pl.Float32, "m", "pedestrian position, north"),
    "velocity_x_ped": Column(pl.Float32, "m/s", "pedestrian velocity, east"),
    "velocity_y_ped": Column(pl.Float32, "m/s", "pedestrian velocity, north"),
    "distance": Column(pl.Float32, "m", "distance between the centres of vehicle and pedestrian"),
    "CurvTTC": Column(pl.Float32, "s", "curvilinear time to collision, infinity where none is predicted"),
}
INDEX_COLUMNS: dict[str, Column] = {
    "scenario": Column(pl.Int32, "", "number of the scenario; 1 to 8 are those of Table 6"),
    "count": Column(pl.Int64, "", "number of the episode within its scenario"),
    "outcome": Column(pl.String, "", "collision, goal, timeout or parked_collision"),
    "reason": Column(pl.String, "", "'kept', or the first condition of section 3.3 that it fails"),
    "frames": Column(pl.Int32, "", "frames from the spawn to the end"),
    "least_curvttc": Column(pl.Float32, "s", "least CurvTTC, infinity where there is none"),
    "vehicle_path": Column(pl.Float32, "m", "length of the vehicle's trajectory"),
    "pedestrian_path": Column(pl.Float32, "m", "length of the pedestrian's trajectory"),
}


def episode_rows(block: EpisodeBlock) -> pl.DataFrame:
    """Return the rows of the stored episodes as a file holds them."""
    return _frame(_arrow_rows(block, arrow_schema(DATASET_COLUMNS, {})))


def agent_ids(count: Numbers, pedestrian: Numbers) -> tuple[Numbers, Numbers]:
    """Return `veh_id` and `ped_id` of rows, int64[n] each.

    :param count: int64[n], number of the episode; `pedestrian`: int64[n], number of the pedestrian within it.
    """
    return 2 * count, 2 * count + 1 + pedestrian * NEXT_PEDESTRIAN


def _arrow_rows(block: EpisodeBlock, schema: pa.Schema) -> pa.Table:
    several = np.where(block.records["rows"] > 0, block.records["pedestrians"], 0)
    lengths = np.repeat(block.records["frames"], several)  # a pair each
    count = np.repeat(np.repeat(block.records["count"], several), lengths)
    person = np.arange(len(lengths)) - np.repeat(np.cumsum(several) - several, several)
    frame = (np.arange(len(count)) - np.repeat(np.cumsum(lengths) - lengths, lengths)).astype(np.int32)
    ids = agent_ids(count, np.repeat(person, lengths))
    columns = [count, frame, *ids, *(np.ascontiguousarray(each) for each in block.values.T)]
    return pa.table([pa.array(column) for column in columns], schema=schema)


def _frame(rows: pa.Table) -> pl.DataFrame:
    frame = pl.from_arrow(rows)
    assert isinstance(frame, pl.DataFrame)
    return frame


class EpisodeTable:
    """One scenario's episodes, written in row groups to a hidden part file: CSV if the path ends so, else Parquet.

    :param row_group: rows after which a row group is written; it ends with an episode.
    :param metadata: stored in the schema of a Parquet file.
    """

    def __init__(self, path: Path, row_group: int, metadata: Mapping[str, Any]) -> None:
        self._path, self._part = path, path.with_name(f".{path.name}.part")
        self._schema = arrow_schema(DATASET_COLUMNS, metadata)
        floats = [name for name, column in DATASET_COLUMNS.items() if column.dtype is pl.Float32]
        self._file: pq.ParquetWriter | io.BufferedWriter
        if path.suffix == ".csv":
            self._file = self._part.open("wb")
            self._file.write((",".join(DATASET_COLUMNS) + "\n").encode())
        else:
            self._file = pq.ParquetWriter(
                self._part,
                self._schema,
                compression="zstd",
                use_dictionary=[name for name in DATASET_COLUMNS if name not in floats],
                use_byte_stream_split=floats,
            )
        self._row_group = row_group
        self._left = joined([])
        self.rows = 0

    def add(self, block: EpisodeBlock) -> None:
        """Append episodes, which follow those added before in the order of their numbers."""
        self._left = joined([self._left, block])
        while len(self._left.values) >= self._row_group:
            now = np.cumsum(self._left.records["rows"]) - self._left.records["rows"] < self._row_group
            self._flush(self._left.only(now))
            self._left = self._left.only(~now)

    def _flush(self, block: EpisodeBlock) -> None:
        if not len(block.values):
            return
        rows = _arrow_rows(block, self._schema)
        if isinstance(self._file, pq.ParquetWriter):
            self._file.write_table(rows)
        else:
            _frame(rows).write_csv(self._file, include_header=False)
        self.rows += rows.num_rows

    def close(self) -> tuple[Path, int]:
        """Finish the file, give it its name, and return that with its number of rows."""
        self._flush(self._left)
        self._file.close()
        self._part.replace(self._path)
        return self._path, self.rows

    def discard(self) -> None:
        """Remove what was written."""
        self._file.close()
        self._part.unlink(missing_ok=True)
        self._path.unlink(missing_ok=True)
