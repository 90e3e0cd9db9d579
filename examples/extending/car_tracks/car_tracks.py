"""The car's position at each frame, a CSV file for each episode."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from vpsci_ros.data.episode import Episode
from vpsci_ros.extras.formats.exporters import Exporter, Options


def write(episodes: Iterable[Episode], folder: Path, options: Options) -> int:
    """Write NAME.csv for each episode and return their number."""
    count = 0
    for episode in episodes:
        columns = np.column_stack([episode.time, episode.x, episode.y, episode.speed])
        np.savetxt(
            folder / f"{episode.label}.csv", columns, "%.3f", delimiter=",", header="time,x,y,speed", comments=""
        )
        count += 1
    return count


CAR_TRACKS = Exporter("car_tracks")
