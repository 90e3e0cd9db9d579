"""What a dataset says of its episodes: the index, one row each, the counts by scenario, and dataset.json."""

import io
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vpsci_ros.data.episode_block import KEPT, RANGES, REASONS, RECORD, EpisodeBlock, joined
from vpsci_ros.data.filters import FilterConfig
from vpsci_ros.data.parquet import Column, arrow_schema
from vpsci_ros.documents import Form
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.world.state import COLLISION, OUTCOME_NAMES, PARKED_COLLISION

# ---- The tables of a dataset: their columns, and the writer of one file.
#
# CurvTTC is infinite where no contact is predicted within the horizon ("inf" in CSV, which pandas, polars, numpy and
# R read as infinity); the authors publish no word on it. NaN are values that nobody saw. `count` is the number of the
# episode within its scenario, with which it can be simulated again; `veh_id` and `ped_id` are 2 count and 2 count +
# 1, so that no two agents of a file share one. The pedestrian with number n in its episode has 2^33 n more, and its
# rows come after those of the one before.


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
    "range": Column(
        pl.String,
        "",
        "'beyond' the range of the recorded people's onsets when it becomes critical, or 'within'; '' where that is "
        "not known",
    ),
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


DESCRIPTION = "dataset.json"
DATASHEET = "README.md"
_TOO_SHORT = REASONS.index("too short") - 1  # of the conditions in `failed`
_LEAST = [(float, int)]
_COUNTED = {"kept": int, "collisions": int, "least_curvttc": _LEAST}
FORM: Form = {  # what is read of any dataset's description
    "period": (float, int),
    "unfinished": int,
    "scenarios": {
        "*": {
            "number": int,
            "simulated": int,
            "kept": int,
            "acceptance_rate": (float, int, NoneType),
            "rejected": dict.fromkeys(REASONS[1:], int),
            "failed": dict.fromkeys(REASONS[1:], int),
            "outcomes": dict.fromkeys(OUTCOME_NAMES[1:PARKED_COLLISION], int),
            "kept_outcomes": dict.fromkeys(OUTCOME_NAMES[1:PARKED_COLLISION], int),
            "rejected_collisions": dict.fromkeys(REASONS[1:], int),
            "vehicle_km": (float, int),
            "pedestrian_km": (float, int),
        }
    },
    "all": {"least_curvttc": _LEAST, "with_early_collisions": _COUNTED},
    "filters": {"least_frames": int},
    "files": {"*": {"sha256": str}},
    "versions": {"vpsci_ros": str},
}
FORM_OF_GENERATED: Form = {  # besides, of one that `vpsci generate` made
    "cpu": str,
    "first_episode": int,
}
INDEX = "episodes.parquet"
REJECTED = "rejected"


def counts_of(records: NDArray[np.void]) -> dict[str, Any]:
    """Return how many of RECORD[n] were simulated, kept, rejected by reason ..., the way that they made, nearness."""
    kept = records["reason"] == KEPT
    return {
        "simulated": len(records),
        "kept": int(kept.sum()),
        "acceptance_rate": int(kept.sum()) / len(records) if len(records) else None,
        "rejected": _by_reason(records),
        "failed": dict(zip(REASONS[1:], records["failed"].sum(axis=0).tolist(), strict=True)),
        "outcomes": _by_outcome(records),
        "kept_outcomes": _by_outcome(records[kept]),
        "rejected_collisions": _by_reason(records[~kept & (records["outcome"] == COLLISION)]),
        "vehicle_km": round(float(records["vehicle_path"][kept].sum()) / 1000.0, 6),
        "pedestrian_km": round(float(records["pedestrian_path"][kept].sum()) / 1000.0, 6),
        "beyond_range": _beyond(records[kept]),
        **nearness(records),
    }


def _beyond(records: NDArray[np.void]) -> dict[str, int] | None:
    """Return how many episodes begin beyond the range of the recorded people, and of how many; None: of none."""
    known = int((records["range"] > 0).sum())
    return {"episodes": int((records["range"] == RANGES.index("beyond")).sum()), "of": known} if known else None


def nearness(records: NDArray[np.void]) -> dict[str, Any]:
    """Return quartiles of the least CurvTTC of the kept episodes [s], and the same with early collisions put back.

    Early collisions are rejected for nothing but ending the episode too early. Without episodes there are no quartiles.
    """
    kept, collided = records["reason"] == KEPT, records["outcome"] == COLLISION
    others = np.delete(records["failed"], _TOO_SHORT, axis=1).any(axis=1)
    put_back = kept | (records["failed"][:, _TOO_SHORT] & ~others & collided)
    return {
        "least_curvttc": _quartiles(records["least_curvttc"][kept]),
        "with_early_collisions": {
            "kept": int(put_back.sum()),
            "collisions": int((put_back & collided).sum()),
            "least_curvttc": _quartiles(records["least_curvttc"][put_back]),
        },
    }


def _quartiles(least: NDArray[np.float32]) -> list[float]:
    values = np.quantile(least.astype(np.float64), (0.25, 0.5, 0.75)) if len(least) else np.zeros(0)
    return [round(float(value), 4) for value in values]


def _by_reason(records: NDArray[np.void]) -> dict[str, int]:
    counts = np.bincount(records["reason"], minlength=len(REASONS)).tolist()
    return dict(zip(REASONS[1:], counts[1:], strict=True))


def _by_outcome(records: NDArray[np.void]) -> dict[str, int]:
    """Return how often each outcome came; that of parked vehicles, which most worlds lack, only where it did."""
    counts = np.bincount(records["outcome"], minlength=len(OUTCOME_NAMES)).tolist()
    return {
        name: counts[code]
        for code, name in enumerate(OUTCOME_NAMES)
        if code and (counts[code] or code < PARKED_COLLISION)
    }


def index_table(records: NDArray[np.void]) -> pl.DataFrame:
    """Return the index of RECORD[n], with the columns of `INDEX_COLUMNS`."""
    table = pl.DataFrame({name: np.ascontiguousarray(records[name]) for name in INDEX_COLUMNS})
    named = table.with_columns(
        pl.col("outcome").replace_strict(dict(enumerate(OUTCOME_NAMES)), return_dtype=pl.String),
        pl.col("reason").replace_strict(dict(enumerate(REASONS)), return_dtype=pl.String),
        pl.col("range").replace_strict(dict(enumerate(RANGES)), return_dtype=pl.String),
    )
    schema = {name: column.dtype for name, column in INDEX_COLUMNS.items()}
    return named.cast(schema).sort("scenario", "count")  # type: ignore[arg-type]


def description_of(
    provenance: Mapping[str, Any],
    filters: FilterConfig,
    unfinished: int,
    records: Mapping[str, tuple[int, NDArray[np.void]]],
    files: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the content of dataset.json.

    :param records: number and RECORD[n] of each scenario, by its name.
    """
    return {
        "content": "vehicle-pedestrian safety-critical interaction episodes",
        **provenance,
        "all": nearness(np.concatenate([np.zeros(0, RECORD), *(own for _, own in records.values())])),
        "filters": asdict(filters),
        "unfinished": unfinished,
        "scenarios": {name: {"number": number, **counts_of(own)} for name, (number, own) in records.items()},
        "columns": {n: {"unit": c.unit, "description": c.description} for n, c in DATASET_COLUMNS.items()},
        "files": dict(files),
        "versions": software_versions(),
    }


def file_entry(path: Path, rows: int) -> dict[str, Any]:
    """Return what dataset.json says of a file."""
    return {"rows": rows, "bytes": path.stat().st_size, "sha256": sha256(path)}
