"""Importer of the simulated episodes that the paper's authors publish, see `published_tables`."""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import Episode
from vpsci_ros.data.importers.tracks import Clip, Floats, Importer, Track
from vpsci_ros.extras.paper.published_tables import convert
from vpsci_ros.safety import VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world.observation import STEP

STANDS = "vehicles that never move"  # a count of `Clip.left_out`


def vpsci(folder: Path) -> Iterator[Clip]:
    """Yield a clip for each episode of the authors' dataset: those that the filters keep, then the rejected ones.

    CurvTTC is computed again from the motion, as for every import; that of the file is what `vpsci published` keeps.
    """
    with TemporaryDirectory() as place:
        convert(folder, Path(place) / "dataset")
        data = Dataset(Path(place) / "dataset")
        yield from (_clip(episode) for episode in chain(data.read(), data.read(rejected=True)))


def _clip(episode: Episode) -> Clip:
    known = ("the outcome of an episode", "headings are directions of motion")
    name, every = f"{episode.group}/{episode.number}", round(STEP / episode.period)
    if np.isnan(episode.heading).all():
        return Clip(name, [], [], {STANDS: 1}, known)
    car = {each: _closed(getattr(episode, each))[::every] for each in ("x", "y", "heading", "speed")}
    walks = [
        {each: _closed(getattr(episode, f"ped_{each}")[number])[::every] for each in ("x", "y", "vx", "vy")}
        for number in range(episode.pedestrians)
    ]
    return Clip(name, [Track(0, 0, car)], [Track(n, 0, walk) for n, walk in enumerate(walks, 1)], {}, known)


def _closed(values: Floats) -> Floats:
    """Return float64[T] with straight lines between the frames that have a value; zeros if none has."""
    seen = np.flatnonzero(~np.isnan(values))
    return np.interp(np.arange(len(values)), seen, values[seen]) if len(seen) else np.zeros(len(values))


VPSCI = Importer(vpsci, length=VEHICLE_LENGTH, width=VEHICLE_WIDTH)
