"""A check of recordings before their import: near misses as a picture, and sizes, speeds and extent of all tracks."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from vpsci_ros.data.importers import Clip, ImportResult, Track, imported_clips
from vpsci_ros.documents import counted
from vpsci_ros.errors import InvalidInput
from vpsci_ros.report.canvas import new_figure, save_png
from vpsci_ros.report.world_figures import outlines
from vpsci_ros.safety import CRITICAL_TTC

COLUMNS = 3  # pictures in a row
ROWS = 2  # rows of one folder; of several folders each has one row
_CAR, _PERSON = "#08519c", "#a50f15"

Floats = NDArray[np.float64]


def check_recordings(folders: Sequence[Path], formats: Sequence[str], path: str | Path, **options: Any) -> list[str]:
    """Draw near misses of all folders as one PNG: both agents' paths, and the vehicle's outline at the onset.

    The drawn near misses are spread evenly over those of a folder. Of a folder without near misses the first pairs are
    drawn.

    :param formats: one for each folder, or one for all; options: see `imported_clips`.
    :returns: lines about each folder: tracks, extent [m], speeds [m/s], sizes [m], near misses, what is left out.
    :raises InvalidInput: a folder holds no vehicle and pedestrian at the same time, or see `imported_clips`.
    """
    read = imported_clips(folders, formats, **options)
    rows = ROWS if len(read) == 1 else len(read)
    figure, axes = new_figure(4.0 * COLUMNS, 4.0 * rows, rows, COLUMNS)
    grid, lines = list(axes.flat), []
    each = len(grid) // len(read)
    for number, (folder, (clips, result)) in enumerate(zip(folders, read, strict=True)):
        own = grid[number * each : (number + 1) * each]
        drawn = _draw_near_misses(own, result.table) or _draw_pairs(own, clips)
        if not drawn:
            raise InvalidInput(
                f"{folder}: {len(clips)} clips without a vehicle and a pedestrian at the same time: check the classes"
            )
        for axis in own:
            axis.set_visible(axis.has_data())
        before = f"{folder.name}: " if len(read) > 1 else ""
        lines += [before + line for line in (*_facts(clips), *_found(result, drawn))]
    save_png(figure, path)
    return lines


def _draw_near_misses(axes: Sequence[Axes], table: pl.DataFrame) -> int:
    """Draw interactions at even distances in a near-miss table; return how many."""
    numbers = table["interaction"].unique(maintain_order=True).to_list()
    places = np.linspace(0.0, len(numbers) - 1, min(len(axes), len(numbers)))
    for axis, number in zip(axes, (numbers[round(place)] for place in places), strict=False):
        own = table.filter(pl.col("interaction") == number)
        vehicle, walker = (own.select(f"{who}_x", f"{who}_y").to_numpy() for who in ("veh", "ped"))
        onset = int((own["curvttc"] < CRITICAL_TTC).arg_max() or 0)
        at = own.row(onset, named=True)
        _draw(axis, vehicle, walker, f"{at['clip']}: near miss {number}, {at['veh_name']} and {at['ped_name']}")
        box = [at[f"veh_{name}"] for name in ("x", "y", "heading", "length", "width")]
        axis.add_patch(Polygon(outlines(np.array([box]))[0], fill=False, edgecolor=_CAR))
        axis.plot(*walker[onset], "+", color=_PERSON)
    return len(places)


def _draw_pairs(axes: Sequence[Axes], clips: Sequence[Clip]) -> int:
    """Draw the first vehicles and pedestrians that are there at the same time; return how many pairs."""
    pairs = ((clip.name, car, one) for clip in clips for car in clip.vehicles for one in clip.pedestrians)
    count = 0
    for axis, (name, car, one) in zip(axes, (each for each in pairs if _together(*each[1:])), strict=False):
        vehicle, walker = (np.column_stack([track.values["x"], track.values["y"]]) for track in (car, one))
        _draw(axis, vehicle, walker, f"{name}: no near miss, {car.name or car.number} and {one.name or one.number}")
        count += 1
    return count


def _together(car: Track, one: Track) -> bool:
    return car.first <= one.last and one.first <= car.last


def _draw(axis: Axes, vehicle: Floats, walker: Floats, title: str) -> None:
    """Draw two ways [T, 2] [m], whose ends have a dot."""
    for way, colour in ((vehicle, _CAR), (walker, _PERSON)):
        axis.plot(way[:, 0], way[:, 1], color=colour, linewidth=1.5)
        axis.plot(*way[-1], "o", color=colour, markersize=4)
    axis.set_title(title, fontsize=8)
    axis.set_aspect("equal", adjustable="datalim")


def _facts(clips: Sequence[Clip]) -> list[str]:
    cars = [track for clip in clips for track in clip.vehicles]
    people = [track.values for clip in clips for track in clip.pedestrians]
    x, y = (np.concatenate([each[name] for each in (*(car.values for car in cars), *people)]) for name in ("x", "y"))
    speeds = [np.concatenate([car.values["speed"] for car in cars])]
    speeds.append(np.concatenate([np.hypot(one["vx"], one["vy"]) for one in people]))
    own = (car.size or clip.size for clip in clips for car in clip.vehicles)
    sizes = sorted({tuple(round(side, 1) for side in size) for size in own if size})
    known = f"{' x '.join(map(str, sizes[0]))} to {' x '.join(map(str, sizes[-1]))} m" if sizes else "the format's"
    return [
        f"{counted(len(clips), 'clip')}, {counted(len(cars), 'track')} of vehicles, {len(people)} of pedestrians",
        f"extent: {np.ptp(x):.1f} x {np.ptp(y):.1f} m",
        f"median speeds: vehicles {np.nanmedian(speeds[0]):.2f} m/s, pedestrians {np.median(speeds[1]):.2f} m/s",
        f"sizes of vehicles: {known}",
    ]


def _found(result: ImportResult, drawn: int) -> list[str]:
    (summary,) = result.summaries
    shown = f"{drawn} drawn" if summary.near_misses else f"the first {counted(drawn, 'pair')} drawn"
    return [
        f"{counted(summary.pairs, 'pair')}, {counted(summary.near_misses, 'near miss', 'near misses')}; {shown}",
        *summary.lines(),
    ]
