"""The authors' dataset as they publish it: CSV files named as in Table 6, with the columns of Table 7.

Names of columns and 20 frames a second are those of their readme (github.com/Qpu523/UISCI-Dataset, the dataset's
earlier name). What neither it nor the paper says is taken from the file, or compared with it: a row is a frame of an
episode (`count`) and one pedestrian; y points down, as in CARLA, where the right turns of a file would be left turns
with y to the north; positions, times and velocities must agree, and `distance` must be that of the positions. Frames
may count from any number; a missing one is a frame that nobody saw, as is an empty cell. Outcomes are not in the files.
"""

from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.courses import Floats, filled, headings
from vpsci_ros.data.dataset import DatasetWriter, write_blocks
from vpsci_ros.data.dataset_tables import EPISODE_COLUMNS, NEXT_PEDESTRIAN, TABLE_7
from vpsci_ros.data.episode_block import JUDGED, EpisodeBlock
from vpsci_ros.documents import reason, require_regular
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import curvature_from_yaw_rate
from vpsci_ros.world import Scenario
from vpsci_ros.world.scenario import shipped_scenarios

PERIOD = 0.05  # [s] a frame, section 3.3
RATE_TOLERANCE = 0.1  # by which way and speed may differ (median)
LEAST_TURN = 0.3  # [rad] of the median episode, below which a file does not show which way y points
ON_THE_ROAD = 5.0  # [m] off the lane of Table 6's scenario, above which the median position is on another road
_MOVING = 0.5  # [m/s] above it speeds show the frame rate and the units
_LONGEST = 100_000  # frames of an episode
_WHOLE = {"count": pl.Float64, "frame": pl.Float64, "veh_id": pl.String, "ped_id": pl.String}
_FLOATS = [name for name in TABLE_7 if name not in _WHOLE]
_SIDEWAYS = [name for name in _FLOATS if "_y_" in name]
_PAIR = ["count", "walker"]


def convert(source: Path, output: Path) -> None:
    """Write the authors' files as a dataset of this package, with kept and rejected episodes.

    Every episode goes through the filters of section 3.3 once more. If the tracks of a file lie on another road than
    its name says, its scenario gets that name with "_elsewhere", so that nothing is drawn on a wrong road.

    :param source: folder of their CSV files, or one of them.
    :param output: new or empty folder.
    :raises InvalidInput: no such file, or see `canonical`.
    """
    known = {scenario.name: scenario for scenario in shipped_scenarios()}
    others = iter(range(256 - len(known), 256))
    parts: dict[int, tuple[str, pl.DataFrame]] = {}
    for path in published_files(source):
        rows, scenario = canonical(path), known.get(path.stem)
        if scenario is not None and _off_the_lane(rows, scenario) <= ON_THE_ROAD:
            parts[scenario.number] = path.stem, rows
        else:
            parts[next(others)] = f"{path.stem}_elsewhere" if scenario else path.stem, rows
    if not parts:
        raise InvalidInput(f"{source}: expected CSV files with the columns of Table 7, found none")
    names = {number: name for number, (name, _) in parts.items()}
    with DatasetWriter(output, names, {"period": PERIOD}, keep_rejected=True) as writer:
        write_blocks(writer, (_block(rows, number) for number, (_, rows) in sorted(parts.items())))
        writer.close()


def published_files(path: Path) -> list[Path]:
    """Return the CSV files of a folder whose headers have columns of Table 7, or `path` itself if it is such a file."""
    files = sorted(path.glob("*.csv")) if path.is_dir() else [path] if path.suffix == ".csv" else []
    return [file for file in files if file.is_file() and {"count", "position_x_av"} <= set(_header(file))]


def _header(path: Path) -> list[str]:
    require_regular(path)
    with path.open("rb") as file:
        return [name.strip(" \"'\r\n") for name in file.readline(1 << 16).decode("utf-8-sig", "replace").split(",")]


def canonical(path: Path) -> pl.DataFrame:
    """Return a file's rows in the form of `vpsci generate`: y north, frames from 0, one pedestrian after another.

    :raises InvalidInput: a column is missing, a value is no number, a frame comes twice, an episode has two vehicles,
        an episode is too long, positions, velocities, times and distances contradict each other, or nobody turns.
    """
    rows = _read(path)
    walkers = pl.col("ped_id").rank("dense").over("count").cast(pl.Int64) - 1
    rows = rows.with_columns(walker=walkers, line=pl.int_range(2, pl.len() + 2, dtype=pl.Int64))
    rows = rows.sort("count", "walker", "frame", maintain_order=True)
    if (twice := rows.filter(pl.struct(*_PAIR, "frame").is_duplicated())).height:
        raise InvalidInput(
            f"{path}: line {twice['line'][0]}: frame {twice['frame'][0]} of episode {twice['count'][0]} comes twice; "
            "expected a row a frame and pedestrian; keep one"
        )
    vehicles = rows.group_by("count", maintain_order=True).agg(pl.col("veh_id").n_unique()).filter(pl.col("veh_id") > 1)
    if vehicles.height:
        raise InvalidInput(
            f"{path}: episode {vehicles['count'][0]} has several veh_id; expected one vehicle an episode"
        )
    _check_units(rows, path)
    if _turn(rows, path) > 0.0:  # a right turn with y down
        rows = rows.with_columns(-pl.col(name) for name in _SIDEWAYS)
    rows = rows.with_columns(frame=pl.col("frame") - pl.col("frame").min().over("count"))
    every = rows.group_by("count", maintain_order=True).agg(
        last=pl.col("frame").max(), walker=pl.col("walker").unique()
    )
    if (long := every.filter(pl.col("last") >= _LONGEST)).height:
        raise InvalidInput(f"{path}: episode {long['count'][0]} has {long['last'][0]:,} frames; `count` is no episode")
    grid = every.explode("walker").with_columns(frame=pl.int_ranges(pl.col("last") + 1)).explode("frame")
    whole = grid.join(rows, on=[*_PAIR, "frame"], how="left", maintain_order="left").sort(*_PAIR, "frame")
    numbered = whole.with_columns(
        pl.col(_FLOATS).fill_null(np.nan),
        veh_id=2 * pl.col("count"),
        ped_id=2 * pl.col("count") + 1 + pl.col("walker") * NEXT_PEDESTRIAN,
    )
    return numbered.select(pl.col(name).cast(EPISODE_COLUMNS[name].dtype) for name in TABLE_7)


def _read(path: Path) -> pl.DataFrame:
    header = _header(path)
    if missing := [name for name in TABLE_7 if name not in header]:
        raise InvalidInput(
            f"{path}: expected the columns of Table 7, {', '.join(TABLE_7)}; {', '.join(missing)} is missing, "
            f"the file has {', '.join(header)}"
        )
    try:
        rows = pl.read_csv(
            path.read_bytes(),
            has_header=False,
            skip_rows=1,
            new_columns=header,
            schema_overrides=_WHOLE | dict.fromkeys(_FLOATS, pl.Float64),
            null_values=["", "None", "NA", "NaN", "nan"],
        ).select(list(TABLE_7))
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InvalidInput(f"{path}: expected the columns of Table 7 as numbers: {reason(error)}") from error
    if rows.is_empty():
        raise InvalidInput(f"{path}: expected a row a frame, got none")
    for name in ("count", "frame"):
        numbers = rows[name]
        bad = (numbers.is_null() | ~numbers.is_finite() | (numbers != numbers.round()) | (numbers < 0)).fill_null(True)
        if bad.any():
            at = int(bad.arg_max() or 0)
            raise InvalidInput(f"{path}: line {at + 2}, column {name}: expected a whole number, got {numbers[at]}")
    if (rows["CurvTTC"] < 0.0).any():
        at = int((rows["CurvTTC"] < 0.0).arg_max() or 0)
        raise InvalidInput(f"{path}: line {at + 2}, column CurvTTC: expected a time [s], got {rows['CurvTTC'][at]:g}")
    return rows.with_columns(pl.col("count", "frame").cast(pl.Int64), pl.col("veh_id", "ped_id").fill_null(""))


def _check_units(rows: pl.DataFrame, path: Path) -> None:
    """Refuse rows whose positions contradict, in the median, their speeds at 20 frames a second, or their distances."""
    seconds = (pl.col("frame").shift(-1) - pl.col("frame")).over(_PAIR) * PERIOD
    for end in ("av", "ped"):
        way = [
            (pl.col(f"position_{axis}_{end}").shift(-1) - pl.col(f"position_{axis}_{end}")).over(_PAIR) for axis in "xy"
        ]
        now = (pl.col(f"velocity_x_{end}") ** 2 + pl.col(f"velocity_y_{end}") ** 2).sqrt()
        speed = 0.5 * (now + now.shift(-1).over(_PAIR))  # the mean of both ends, so that braking is no other unit
        came = (way[0] ** 2 + way[1] ** 2).sqrt() / seconds
        moving = rows.select(ratio=came / speed, speed=speed).filter(pl.col("speed") > _MOVING)["ratio"].drop_nulls()
        ratio = moving.drop_nans().median()
        if isinstance(ratio, float) and abs(ratio - 1.0) > RATE_TOLERANCE:
            raise InvalidInput(
                f"{path}: positions_{end} move {ratio:.3g} times as fast as velocities_{end} say (median); expected "
                f"metres, m/s and {1.0 / PERIOD:g} frames a second"
            )
    apart = [pl.col(f"position_{axis}_av") - pl.col(f"position_{axis}_ped") for axis in "xy"]
    off = (
        rows.select(off=((apart[0] ** 2 + apart[1] ** 2).sqrt() - pl.col("distance")).abs())["off"]
        .drop_nulls()
        .median()
    )
    if isinstance(off, float) and off > 0.5:
        raise InvalidInput(
            f"{path}: column distance is {off:.2f} m off the distance of the positions (median); expected that of the "
            "centres [m]"
        )


def _turn(rows: pl.DataFrame, path: Path) -> float:
    """Return by how much the vehicle of the median episode turns [rad], counter-clockwise in the file's axes.

    :raises InvalidInput: too little to say whether y points down.
    """
    moving = rows.filter((pl.col("walker") == 0) & (pl.col("velocity_x_av") ** 2 + pl.col("velocity_y_av") ** 2 > 0.25))
    heading = pl.arctan2("velocity_y_av", "velocity_x_av")
    step = (heading - heading.shift(1)).over("count")
    turns = moving.select("count", step=pl.arctan2(step.sin(), step.cos())).group_by("count").agg(pl.col("step").sum())
    turn = float(np.median(turns["step"].drop_nulls().to_numpy())) if turns.height else 0.0
    if abs(turn) < LEAST_TURN:
        raise InvalidInput(
            f"{path}: the median vehicle turns by {turn:.2f} rad; expected right turns, which say whether y "
            "points down (CARLA) or north"
        )
    return turn


def _off_the_lane(rows: pl.DataFrame, scenario: Scenario) -> float:
    """Return how far vehicles are from the scenario's lane [m]: the median of about 500 rows, evenly drawn."""
    some = rows.drop_nans("position_x_av").gather_every(max(1, rows.height // 500)).select(_FLOATS[:2]).to_numpy()
    path = scenario.vehicle.path
    return float(np.median([abs(path.locate(x, y)[1]) for x, y in some.tolist()]))


def _block(rows: pl.DataFrame, scenario: int) -> EpisodeBlock:
    """Return the episodes of `canonical` rows, with headings and curvatures by their velocities; nobody is hidden."""
    of = rows.group_by("count", maintain_order=True).agg(pl.len(), pl.col("ped_id").n_unique())
    records = np.zeros(of.height, JUDGED)
    records["scenario"], records["count"] = scenario, of["count"]
    records["rows"], records["pedestrians"] = of["len"], of["ped_id"]
    records["frames"] = of["len"] // of["ped_id"]
    values, ends = rows.select(_FLOATS).to_numpy(), np.cumsum(records["rows"])
    parts = (part.reshape(people, -1, len(_FLOATS)) for part, people in zip(
        np.split(values, ends[:-1]), records["pedestrians"].tolist(), strict=True))  # fmt: skip
    more = [np.tile(_turning(part[0]), (len(part), 1)) for part in parts]
    policies, seen = np.zeros(len(values)), ~np.isnan(values[:, 0])
    return EpisodeBlock(records, np.column_stack([values, np.concatenate(more), policies, seen]).astype(np.float32))


def _turning(rows: NDArray[np.float32]) -> Floats:
    """Return heading [rad], speed [m/s] and curvature [1/m] of a vehicle, float64[T, 3], by its velocity."""
    vx, vy = rows[:, 2:4].T.astype(np.float64)
    heading, speed = headings(filled(vx), filled(vy)), np.hypot(vx, vy)
    rate = np.gradient(filled(heading), PERIOD) if len(rows) > 1 else np.zeros(1)
    return np.column_stack([heading, speed, curvature_from_yaw_rate(rate, filled(speed))])
