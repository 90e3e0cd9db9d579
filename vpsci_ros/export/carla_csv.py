"""Episodes as CSV in CARLA's coordinates: the columns and file names of the paper (Tables 6 and 7), y pointing down.

CARLA's frame is left-handed, so y and the velocities along it change their sign; everything else stays as in the files
of `vpsci generate`. An episode with several pedestrians is a table of rows for each of them.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.dataset_files import DATASET_COLUMNS
from vpsci_ros.export.episode import Episode
from vpsci_ros.export.run import Options


def write(episodes: Iterable[Episode], folder: Path, options: Options) -> int:
    """Append each episode to the file of its scenario, and return the number of files."""
    files: dict[str, Path] = {}
    next_agent: dict[str, int] = {}
    for episode in episodes:
        name = episode.name.removesuffix(f"_{episode.number:06d}")
        path = files.setdefault(name, folder / f"{name}.csv")
        first = next_agent.setdefault(name, 0)
        next_agent[name] += 1 + len(episode.pedestrians)
        with path.open("ab") as file:
            for number in range(len(episode.pedestrians)):
                rows(episode, number, first).write_csv(file, include_header=file.tell() == 0)
    return len(files)


def rows(episode: Episode, pedestrian: int, first_agent: int) -> pl.DataFrame:
    """Return the rows of the vehicle with one of the pedestrians, columns of `DATASET_COLUMNS`.

    :param first_agent: `veh_id`; pedestrians have the numbers that follow it.
    """
    vehicle, walker = episode.vehicle, episode.pedestrians[pedestrian]
    frames = len(vehicle.x)
    table = {
        "count": np.full(frames, episode.number),
        "frame": np.arange(frames),
        "veh_id": np.full(frames, first_agent),
        "ped_id": np.full(frames, first_agent + 1 + pedestrian),
        "distance": np.hypot(vehicle.x - walker.x, vehicle.y - walker.y),
        "CurvTTC": episode.curvttc,
    }
    for end, each in (("av", vehicle), ("ped", walker)):
        table |= {f"position_x_{end}": each.x, f"position_y_{end}": -each.y}
        table |= {f"velocity_x_{end}": each.vx, f"velocity_y_{end}": -each.vy}
    return pl.DataFrame(table).select(pl.col(name).cast(column.dtype) for name, column in DATASET_COLUMNS.items())
