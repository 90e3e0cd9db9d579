"""Generated episodes: the kept ones of a dataset."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.dataset_reader import Dataset, EpisodeArrays
from vpsci_ros.evaluation.yields import headings, seen
from vpsci_ros.safety import curvature_from_yaw_rate
from vpsci_ros.view.episodes import Episode, Floats, Size, Source, judged, most_critical, named, spread
from vpsci_ros.world.scenario import own_scenarios

_MOTION = ("position_x_av", "position_y_av", "velocity_x_av", "velocity_y_av")
_WALK = ("position_x_ped", "position_y_ped", "velocity_x_ped", "velocity_y_ped")


def dataset_source(folder: Path, limit: int, wanted: Sequence[str] = ()) -> Source:
    """Return kept episodes of a dataset, named SCENARIO:NUMBER.

    :raises InvalidInput: no dataset, a damaged one, or no kept episode of a wanted name.
    """
    data = Dataset(folder)
    index = data.index().filter(pl.col("reason") == "kept")
    keys = index.select("scenario", "count").rows()
    names = [f"{scenario}:{count}" for scenario, count in keys]
    rows = named(names, wanted, str(folder)) if wanted else spread(len(names), limit)
    outcomes = {keys[row]: index["outcome"][int(row)] for row in rows}
    episodes = []
    for name, counts in data.scenarios.items():
        number = int(counts["number"])
        if not any(scenario == number for scenario, _ in outcomes):
            continue
        for part in data.episodes(name):
            for pairs in np.split(np.arange(len(part.count)), part.first[1:]):
                key = number, int(part.count[pairs[0]])
                if key not in outcomes:
                    continue
                values, others = most_critical(np.array([_values(part, int(i), data.period) for i in pairs]))
                yielded, marks = judged(values, data.period, Size())
                called = f"{key[0]}:{key[1]}"
                episodes.append(Episode(called, name, number, outcomes[key], yielded, values, Size(), marks, others))
    own = own_scenarios(data.description.get("own_scenarios"), str(folder))
    title = f"{folder.resolve().name} (generated)"
    return Source(folder.resolve().name, title, data.period, episodes, len(names), own)


def _values(part: EpisodeArrays, i: int, period: float) -> Floats:
    lengths = part.lengths[i : i + 1]

    def column(name: str) -> Floats:
        values: Floats = seen(part[name][i : i + 1, : lengths[0]], lengths)[0]
        return values

    x, y, vx, vy = (column(name) for name in _MOTION)
    ttc = part["CurvTTC"][i, : lengths[0]].astype(np.float64)
    return from_velocities(x, y, vx, vy, np.column_stack([column(name) for name in _WALK]), ttc, period)


def from_velocities(
    x: Floats, y: Floats, vx: Floats, vy: Floats, walk: Floats, curvttc: Floats, period: float
) -> NDArray[np.float64]:
    """Return float64[T, 11] of `FIELDS` where a vehicle's heading is only known from its velocity.

    :param walk: float64[T, 4], the pedestrian's x, y, vx, vy [m, m/s].
    """
    heading = np.unwrap(headings(vx[None], vy[None])[0])
    speed = np.hypot(vx, vy)
    rate = np.gradient(heading, period) if len(heading) > 1 else np.zeros(1)
    curvature = curvature_from_yaw_rate(rate, speed)
    return np.column_stack([x, y, heading, speed, curvature, walk, curvttc, np.zeros(len(x))])
