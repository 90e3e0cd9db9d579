"""Episodes as CSV in CARLA's coordinates: the columns and file names of the paper (Tables 6 and 7), y pointing down.

CARLA's frame is left-handed, so y and the velocities along it change their sign; everything else, `veh_id` and `ped_id`
among it, stays as in the files of `vpsci generate`, so that rows of the two can be joined. An episode with several
pedestrians is a table of rows for each of them.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.dataset_tables import EPISODE_COLUMNS, TABLE_7, agent_ids
from vpsci_ros.data.episode import Episode
from vpsci_ros.extras.formats.movers import movers
from vpsci_ros.extras.formats.run import Options


def write(episodes: Iterable[Episode], folder: Path, options: Options) -> int:
    """Append each episode to the file of its scenario, and return the number of files."""
    paths = set()
    for episode in episodes:
        path = folder / f"{episode.label.removesuffix(f'_{episode.number:06d}')}.csv"
        paths.add(path)
        with path.open("ab") as file:
            rows(episode).write_csv(file, include_header=file.tell() == 0)
    return len(paths)


def rows(episode: Episode) -> pl.DataFrame:
    """Return an episode in the columns of Table 7: a row a frame and pedestrian."""
    vehicle, *pedestrians = movers(episode)
    count = np.full(len(episode), episode.number)
    parts = []
    for number, (walker, curvttc) in enumerate(zip(pedestrians, episode.curvttc, strict=True)):
        veh_id, ped_id = agent_ids(np.full(len(episode), episode.key[0]), count, np.full(len(episode), number))
        table = {
            "count": count,
            "frame": np.arange(len(episode)),
            "veh_id": veh_id,
            "ped_id": ped_id,
            "distance": np.hypot(vehicle.x - walker.x, vehicle.y - walker.y),
            "CurvTTC": curvttc,
        }
        for end, each in (("av", vehicle), ("ped", walker)):
            table |= {f"position_x_{end}": each.x, f"position_y_{end}": -each.y}
            table |= {f"velocity_x_{end}": each.vx, f"velocity_y_{end}": -each.vy}
        parts.append(pl.DataFrame(table))
    every = pl.concat(parts)
    return every.select(pl.col(name).cast(EPISODE_COLUMNS[name].dtype) for name in TABLE_7)
