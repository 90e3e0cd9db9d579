"""Recordings before they are imported: the first pairs as a picture, and sizes, speeds and distances of all."""

import itertools
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from vpsci_ros.data.importers import Clip
from vpsci_ros.errors import InvalidInput
from vpsci_ros.report.canvas import new_figure, save_png

SHOWN = 6  # pairs
_CAR, _PERSON = "#08519c", "#a50f15"


def check_recordings(clips: Iterable[Clip], path: str | Path) -> list[str]:
    """Draw the first pairs of a vehicle and a pedestrian that are recorded at the same time, as a PNG.

    :param clips: read until there are `SHOWN` pairs.
    :returns: extent [m] of these clips, median speeds [m/s] and sizes [m], one line each.
    :raises InvalidInput: there is no pair, or see `clips`.
    """
    read, pairs = [], []
    for clip in clips:
        read.append(clip)
        both = itertools.product(clip.vehicles, clip.pedestrians)
        pairs += [(clip.name, car, one) for car, one in both if car.first <= one.last and one.first <= car.last]
        if len(pairs) >= SHOWN:
            break
    if not pairs:
        raise InvalidInput(f"{len(read)} clips without a vehicle and a pedestrian at the same time: check the classes")
    figure, axes = new_figure(12.0, 8.0, 2, SHOWN // 2)
    for axis, (name, car, one) in zip(axes.flat, pairs, strict=False):
        for track, colour in ((car, _CAR), (one, _PERSON)):
            axis.plot(track.values["x"], track.values["y"], color=colour, linewidth=1.5)
            axis.plot(track.values["x"][-1:], track.values["y"][-1:], "o", color=colour, markersize=4)
        axis.set_title(f"{name}: vehicle {car.number}, pedestrian {one.number}", fontsize=8)
        axis.set_aspect("equal", adjustable="datalim")
    save_png(figure, path)
    cars = [track for clip in read for track in clip.vehicles]
    people = [track.values for clip in read for track in clip.pedestrians]
    x, y = (np.concatenate([each[name] for each in (*(car.values for car in cars), *people)]) for name in ("x", "y"))
    speeds = [np.concatenate([car.values["speed"] for car in cars])]
    speeds.append(np.concatenate([np.hypot(one["vx"], one["vy"]) for one in people]))
    sizes = sorted({tuple(round(side, 1) for side in car.size) for car in cars if car.size})
    known = f"{' x '.join(map(str, sizes[0]))} to {' x '.join(map(str, sizes[-1]))} m" if sizes else "the format's"
    return [
        f"{len(read)} clips, {len(cars)} tracks of vehicles, {len(people)} of pedestrians",
        f"extent: {np.ptp(x):.1f} x {np.ptp(y):.1f} m",
        f"median speeds: vehicles {np.median(speeds[0]):.2f} m/s, pedestrians {np.median(speeds[1]):.2f} m/s",
        f"sizes of vehicles: {known}",
    ]
