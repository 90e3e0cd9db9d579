"""The tables of a dataset: their columns, a block of episodes as rows, and rows as a block.

CurvTTC is infinite where no contact is predicted within the horizon ("inf" in CSV, which pandas, polars, numpy and R
read as infinity); the authors do not say how their files write this. Values that were not observed are NaN. `count` is
the number of the episode within its scenario, with which the episode can be simulated again.
"""

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow as pa
from numpy.typing import DTypeLike, NDArray

from vpsci_ros.data.episode import QUANTITIES
from vpsci_ros.data.episode_block import JUDGED, KEPT, RANGES, REASONS, EpisodeBlock
from vpsci_ros.data.parquet import Column, arrow_schema
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.state import OUTCOME_NAMES

Numbers = NDArray[np.int64]
FORMATS = ("parquet", "csv")
INDEX = "episodes.parquet"
REJECTED = "rejected"  # folder of the rejected episodes, where they are stored
NEXT_PEDESTRIAN, NEXT_SCENARIO = 10**10, 10**12  # steps of `ped_id`, and of both identifiers
EPISODE_COLUMNS: dict[str, Column] = {
    "count": Column(pl.Int64, "", "interaction episode index: number of the episode within its scenario"),
    "frame": Column(pl.Int32, "", "frame number within the episode, 0 at the spawn"),
    "veh_id": Column(pl.Int64, "", "vehicle identifier, unique in the dataset"),
    "ped_id": Column(pl.Int64, "", "pedestrian identifier, unique in the dataset"),
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
    "scenario": Column(pl.Int32, "", "number of the scenario; 1 to 8 are those of Table 6"),
    "heading_av": Column(pl.Float32, "rad", "vehicle heading, counter-clockwise from x, without jumps"),
    "speed_av": Column(pl.Float32, "m/s", "vehicle speed along its heading"),
    "curvature_av": Column(pl.Float32, "1/m", "curvature of the vehicle's path, positive to the left"),
    "controlled": Column(pl.Boolean, "", "the policies control the vehicle and this pedestrian"),
    "seen": Column(pl.Boolean, "", "the vehicle sees the pedestrian, whom no parked vehicle hides"),
}
"""Columns of stored episodes, a row a frame and pedestrian: those of Table 7 as published, then further ones.

An exam stores the floats as float64. The pedestrians of an episode follow one after the other.
"""
ENCODING: dict[str, Any] = {
    "compression": "zstd",
    "use_dictionary": [name for name, column in EPISODE_COLUMNS.items() if column.dtype.is_integer()],
    "use_byte_stream_split": [name for name, column in EPISODE_COLUMNS.items() if column.dtype is pl.Float32],
}
"""How pyarrow writes these columns to a Parquet file."""
TABLE_7 = tuple(EPISODE_COLUMNS)[:14]
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
    "pedestrians": Column(pl.Int32, "", "number of pedestrians"),
    "fails": Column(pl.String, "", "all conditions of section 3.3 that it fails, with commas; '' for none"),
}


def episode_columns(floats: DTypeLike = np.float32) -> dict[str, Column]:
    """Return `EPISODE_COLUMNS` with floats of this type, float32 or float64."""
    if floats == np.float32:
        return EPISODE_COLUMNS
    return {
        name: column._replace(dtype=pl.Float64) if column.dtype is pl.Float32 else column
        for name, column in EPISODE_COLUMNS.items()
    }


def agent_ids(scenario: Numbers, count: Numbers, pedestrian: Numbers) -> tuple[Numbers, Numbers]:
    """Return `veh_id` and `ped_id` of rows, int64[n] each, unique in a dataset.

    :param scenario, count, pedestrian: int64[n], numbers of the scenario, of the episode within it, and of the
        pedestrian within the episode.
    """
    vehicle = scenario * NEXT_SCENARIO + 2 * count
    return vehicle, vehicle + 1 + pedestrian * NEXT_PEDESTRIAN


def arrow_rows(block: EpisodeBlock) -> pa.Table:
    """Return the rows of the stored episodes with `EPISODE_COLUMNS`, floats of the type of the block's values."""
    several = np.where(block.records["rows"] > 0, block.records["pedestrians"], 0)
    lengths = np.repeat(block.records["frames"], several)  # a pair each
    count, scenario = (np.repeat(block.records[name], several) for name in ("count", "scenario"))
    person = np.arange(len(lengths)) - np.repeat(np.cumsum(several) - several, several)
    vehicle, walker = agent_ids(scenario.astype(np.int64), count, person)
    places = (count, vehicle, walker, scenario.astype(np.int32))
    count, vehicle, walker, scenario = (np.repeat(each, lengths) for each in places)
    frame = (np.arange(len(count)) - np.repeat(np.cumsum(lengths) - lengths, lengths)).astype(np.int32)
    columns = dict(zip(QUANTITIES, np.ascontiguousarray(block.values.T), strict=True))
    columns |= {"count": count, "frame": frame, "veh_id": vehicle, "ped_id": walker, "scenario": scenario}
    columns |= {name: columns[name] == 1.0 for name in ("controlled", "seen")}
    schema = arrow_schema(episode_columns(block.values.dtype), {})
    return pa.table([pa.array(columns[name]) for name in EPISODE_COLUMNS], schema=schema)


def block_of_rows(rows: pl.DataFrame, path: Path) -> EpisodeBlock:
    """Return the stored episodes of rows with `EPISODE_COLUMNS`; of their records only numbers and sizes are known.

    :param rows: of whole episodes; `path`: of their file, the opening of an error message.
    :raises InvalidInput: frames that do not count from 0 for each pedestrian, or pedestrians of unequal lengths.
    """
    single = all(rows[name].dtype != pl.Float64 for name in QUANTITIES)
    values = rows.select(pl.col(*QUANTITIES).cast(pl.Float32 if single else pl.Float64)).to_numpy()
    scenario, count, frame, walker = (rows[name].to_numpy() for name in ("scenario", "count", "frame", "ped_id"))
    if not len(count):
        return EpisodeBlock(np.zeros(0, JUDGED), values)
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
    records = np.zeros(len(first), JUDGED)
    records["scenario"], records["count"] = scenario[starts[first]], count[starts[first]]
    records["frames"], records["pedestrians"], records["rows"] = lengths[first], several, lengths[first] * several
    return EpisodeBlock(records, values)


def index_table(records: NDArray[np.void]) -> pl.DataFrame:
    """Return the index of JUDGED[n], with the columns of `INDEX_COLUMNS`."""
    own = [name for name in INDEX_COLUMNS if name != "fails"]
    table = pl.DataFrame({name: np.ascontiguousarray(records[name]) for name in own})
    patterns = {bits: ", ".join(_failed(bits)) for bits in range(1 << len(REASONS[1:]))}
    named = table.with_columns(
        pl.col("outcome").replace_strict(dict(enumerate(OUTCOME_NAMES)), return_dtype=pl.String),
        pl.col("reason").replace_strict(dict(enumerate(REASONS)), return_dtype=pl.String),
        pl.col("range").replace_strict(dict(enumerate(RANGES)), return_dtype=pl.String),
        pl.Series("fails", _bits(records)).replace_strict(patterns, return_dtype=pl.String),
    )
    schema = {name: column.dtype for name, column in INDEX_COLUMNS.items()}
    return named.cast(schema).sort("scenario", "count")  # type: ignore[arg-type]


def records_of(index: pl.DataFrame, keep_rejected: bool) -> NDArray[np.void]:
    """Return the records of an index, JUDGED[n], as `index_table` had them; the kinds of pedestrians are not known.

    :param keep_rejected: the rows of rejected episodes are stored, too.
    """
    records = np.zeros(index.height, JUDGED)
    codes = {"outcome": OUTCOME_NAMES, "reason": REASONS, "range": RANGES}
    for name in INDEX_COLUMNS:
        if name in codes:
            records[name] = index[name].replace_strict({text: code for code, text in enumerate(codes[name])}).to_numpy()
        elif name != "fails":
            records[name] = index[name].to_numpy()
    for number, reason in enumerate(REASONS[1:]):
        records["failed"][:, number] = index["fails"].str.split(", ").list.contains(reason).to_numpy()
    stored = (records["reason"] == KEPT) | keep_rejected
    records["rows"] = np.where(stored, records["frames"] * records["pedestrians"], 0)
    return records


def _bits(records: NDArray[np.void]) -> NDArray[np.int64]:
    """Return the failed conditions as bits, int64[n], the first condition first."""
    return records["failed"] @ (1 << np.arange(len(REASONS[1:])))


def _failed(bits: int) -> list[str]:
    return [reason for number, reason in enumerate(REASONS[1:]) if bits >> number & 1]
