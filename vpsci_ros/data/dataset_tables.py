"""The tables of a dataset: their columns, and the rows of an episode in each.

CurvTTC is infinite where no contact is predicted within the horizon ("inf" in CSV, which pandas, polars, numpy and R
read as infinity); the authors do not say how their files write this. Values that were not observed are NaN. `count` is
the number of the episode within its scenario, with which the episode can be simulated again; `veh_id` and `ped_id` are
2 count and 2 count + 1, so that no two agents of a file share an id. `ped_id` of pedestrian n of an episode, from 0, is
2^33 n larger, and the rows of pedestrian n + 1 follow the rows of pedestrian n.
"""

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl
import pyarrow as pa
from numpy.typing import NDArray

from vpsci_ros.data.episode_block import RANGES, REASONS, EpisodeBlock
from vpsci_ros.data.parquet import Column, arrow_schema
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.state import OUTCOME_NAMES

Numbers = NDArray[np.int64]
FORMATS = ("parquet", "csv")
INDEX = "episodes.parquet"
REJECTED = "rejected"  # folder of the rejected episodes, where they are stored
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


def agent_ids(count: Numbers, pedestrian: Numbers) -> tuple[Numbers, Numbers]:
    """Return `veh_id` and `ped_id` of rows, int64[n] each.

    :param count: int64[n], number of the episode; `pedestrian`: int64[n], number of the pedestrian within it.
    """
    return 2 * count, 2 * count + 1 + pedestrian * NEXT_PEDESTRIAN


def arrow_rows(block: EpisodeBlock) -> pa.Table:
    """Return the rows of the stored episodes as an Arrow table with `DATASET_COLUMNS`."""
    several = np.where(block.records["rows"] > 0, block.records["pedestrians"], 0)
    lengths = np.repeat(block.records["frames"], several)  # a pair each
    count = np.repeat(np.repeat(block.records["count"], several), lengths)
    person = np.arange(len(lengths)) - np.repeat(np.cumsum(several) - several, several)
    frame = (np.arange(len(count)) - np.repeat(np.cumsum(lengths) - lengths, lengths)).astype(np.int32)
    ids = agent_ids(count, np.repeat(person, lengths))
    columns = [count, frame, *ids, *(np.ascontiguousarray(each) for each in block.values.T)]
    return pa.table([pa.array(column) for column in columns], schema=arrow_schema(DATASET_COLUMNS, {}))


def index_table(records: NDArray[np.void]) -> pl.DataFrame:
    """Return the index of JUDGED[n], with the columns of `INDEX_COLUMNS`."""
    table = pl.DataFrame({name: np.ascontiguousarray(records[name]) for name in INDEX_COLUMNS})
    named = table.with_columns(
        pl.col("outcome").replace_strict(dict(enumerate(OUTCOME_NAMES)), return_dtype=pl.String),
        pl.col("reason").replace_strict(dict(enumerate(REASONS)), return_dtype=pl.String),
        pl.col("range").replace_strict(dict(enumerate(RANGES)), return_dtype=pl.String),
    )
    schema = {name: column.dtype for name, column in INDEX_COLUMNS.items()}
    return named.cast(schema).sort("scenario", "count")  # type: ignore[arg-type]


def pieces(rows: pl.DataFrame, path: Path) -> Iterator[tuple[int, int, int]]:
    """Yield each episode's first row, the row after its last row, and its number of pedestrians.

    :param rows: of whole episodes, of one scenario or with a column "scenario".
    :param path: the opening of the error message.
    :raises InvalidInput: frames that do not count from 0 for each pedestrian.
    """
    count, frame, walker = (rows[name].to_numpy() for name in ("count", "frame", "ped_id"))
    if not len(count):
        return
    changes = np.diff(count, prepend=count[0] - 1) | np.diff(walker, prepend=walker[0])
    if "scenario" in rows.columns:
        changes |= np.diff(rows["scenario"].to_numpy(), prepend=rows["scenario"][0])
    starts = np.flatnonzero(changes)
    expected = np.arange(len(count)) - np.repeat(starts, np.diff(np.append(starts, len(count))))
    if not np.array_equal(expected, frame):
        row = int(np.argmax(expected != frame))
        raise InvalidInput(f"{path}: frame {frame[row]} of episode {count[row]}: expected frame {expected[row]}")
    first = np.flatnonzero(walker[starts] // NEXT_PEDESTRIAN == 0)  # of the starts, those of an episode
    several = np.diff(np.append(first, len(starts)))
    begins = np.append(starts[first], len(count))
    for (begin, end), people in zip(itertools.pairwise(begins.tolist()), several.tolist(), strict=True):
        yield begin, end, people
