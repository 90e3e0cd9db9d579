"""Simulated episodes as one Parquet file, with the columns of a dataset in float64 and further columns.

A row is a frame of one pedestrian, as in a dataset. Metadata of each episode and your own scenarios are in the schema.
An episode is read back bit-identically.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq

from vpsci_ros.data.dataset_tables import DATASET_COLUMNS, agent_ids, pieces
from vpsci_ros.data.episode import Episode, Listed
from vpsci_ros.data.parquet import Column, arrow_schema, read_metadata, read_parquet
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import atomic_write
from vpsci_ros.world.scenario import every_scenario, own_documents

FRAMES = "frames.parquet"  # of a run of an exam
_OF_THE_VEHICLE = {"position_x_av": "x", "position_y_av": "y", "heading_av": "heading", "speed_av": "speed",
                   "curvature_av": "curvature", "velocity_x_av": "vx", "velocity_y_av": "vy"}  # fmt: skip
_OF_A_PEDESTRIAN = {"position_x_ped": "ped_x", "position_y_ped": "ped_y", "velocity_x_ped": "ped_vx",
                    "velocity_y_ped": "ped_vy", "CurvTTC": "curvttc", "distance": "distance",
                    "controlled": "controlled"}  # fmt: skip
_DERIVED = ("vx", "vy")  # of heading and speed
EPISODE_COLUMNS: dict[str, Column] = {
    "scenario": Column(pl.Int32, "", "number of the scenario"),
    **{name: column._replace(dtype=pl.Float64 if column.dtype is pl.Float32 else column.dtype)
       for name, column in DATASET_COLUMNS.items()},
    "heading_av": Column(pl.Float64, "rad", "vehicle heading, counter-clockwise from x, unwrapped"),
    "speed_av": Column(pl.Float64, "m/s", "vehicle speed along its heading"),
    "curvature_av": Column(pl.Float64, "1/m", "curvature of the vehicle's path, positive to the left"),
    "controlled": Column(pl.Boolean, "", "the policies control the vehicle and this pedestrian"),
}  # fmt: skip


def write_episodes(path: Path, episodes: Sequence[Episode], **more: Any) -> None:
    """Write simulated episodes of one frame period, whole or not at all.

    :param more: JSON values that `read_metadata` returns by these names.
    """
    own = own_documents({each.key[0]: each.scenario for each in episodes if each.scenario is not None}.values())
    facts = {"listed": [each.listed for each in episodes], "period": episodes[0].period if episodes else 0.0}
    rows, schema = _rows(episodes), arrow_schema(EPISODE_COLUMNS, {**more, **facts, "own_scenarios": own})
    floats = [field.name for field in schema if pa.types.is_floating(field.type)]
    with atomic_write(path) as part:
        pq.write_table(
            rows.select(schema.names).to_arrow().cast(schema),
            part,
            compression="zstd",
            use_byte_stream_split=floats,
            use_dictionary=[name for name in schema.names if name not in floats],
            write_page_checksum=True,
        )


def _rows(episodes: Sequence[Episode]) -> pl.DataFrame:
    pairs = [(each, person) for each in episodes for person in range(each.pedestrians)]
    of_pairs = [(each.key[0], each.number, person) for each, person in pairs]
    lengths = np.array([len(each) for each, _ in pairs], np.int64)
    scenario, count, person = np.repeat(np.array(of_pairs, np.int64).reshape(-1, 3), lengths, axis=0).T
    columns: dict[str, Any] = {"scenario": scenario, "count": count}
    columns["frame"] = np.arange(len(count)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    columns["veh_id"], columns["ped_id"] = agent_ids(count, person)
    for column, name in _OF_THE_VEHICLE.items():
        columns[column] = np.concatenate([np.zeros(0), *(getattr(each, name) for each, _ in pairs)])
    for column, name in _OF_A_PEDESTRIAN.items():
        columns[column] = np.concatenate([np.zeros(0), *(getattr(each, name)[i] for each, i in pairs)])
    return pl.DataFrame(columns).cast({name: column.dtype for name, column in EPISODE_COLUMNS.items()})


def read_episode_file(path: Path) -> list[Episode]:
    """Return the episodes of a file of `write_episodes`.

    :raises InvalidInput: it cannot be read, or holds something else.
    """
    rows, facts = read_parquet(path, "the episodes of a run", EPISODE_COLUMNS), read_metadata(path)
    try:
        roads = {scenario.number: scenario for scenario in every_scenario(facts["own_scenarios"], str(path))}
        listed, found = [Listed(*each) for each in facts["listed"]], []
        for one, (begin, end, people) in zip(listed, pieces(rows, path), strict=True):
            own = rows[begin:end]
            motion: dict[str, Any] = {
                name: own[column].to_numpy().reshape(people, -1)[0]
                for column, name in _OF_THE_VEHICLE.items()
                if name not in _DERIVED
            }
            motion |= {name: own[column].to_numpy().reshape(people, -1) for column, name in _OF_A_PEDESTRIAN.items()}
            found.append(Episode(str(path), one, roads.get(one.scenario), facts["period"], **motion))
        return found
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidInput(f"{path}: not readable as the episodes of a run ({error}); drive it again") from None
