"""Importers of the data that the paper's authors publish: simulated episodes (`vpsci`) and recordings (`hdi`).

Source: github.com/Qpu523, VPSCI-Dataset (see `published_tables`) and HDI-Dataset. A file of HDI has a row a frame
and road user: Frame Num, ID, Type, the box Xmin, Ymin, Xmax, Ymax, Speed (km/h) and more. Its readme says neither
the unit of the boxes nor the frame rate; in its sample they are pixels of a picture, y down. Both are constants of
a flight, so they stand in `hdi.yaml` beside the files, and have to agree with the column of speeds.
"""

import re
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import Episode
from vpsci_ros.data.importers.layout import clip_of
from vpsci_ros.data.importers.layout_file import BOX, SPEEDS, Layout
from vpsci_ros.data.importers.tracks import Clip, Floats, Importer, Track, read_csv, require_columns
from vpsci_ros.documents import read_yaml, shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper.published_tables import convert
from vpsci_ros.safety import VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world.observation import STEP

SCALE = "hdi.yaml"
STANDS = "vehicles that never move"  # a count of `Clip.left_out`
_BOX = ("xmin", "ymin", "xmax", "ymax")
_VEHICLES, _WALKERS = frozenset({"car", "van", "bus", "truck"}), frozenset({"pedestrian", "person", "people"})


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


def hdi(folder: Path) -> Iterator[Clip]:
    """Yield a clip for each CSV file of HDI; hdi.yaml has `frame_rate` [1/s] and the `metres` of a pixel.

    :raises InvalidInput: no such files, or units that the column of speeds contradicts.
    """
    scale = _scale(folder / SCALE)
    files = sorted(folder.glob("*.csv"))
    if not files:
        raise InvalidInput(f"{folder}: expected CSV files of HDI as published, found none")
    return (_recording(path, *scale) for path in files)


def _scale(path: Path) -> tuple[float, float]:
    if not path.is_file():
        raise InvalidInput(
            f"{path}: no such file; HDI's files say neither their frame rate nor how large a pixel is: write both "
            "here, frame_rate: 30 and metres: 0.05, say"
        )
    values = read_yaml(path)
    given = [values.get(key) if isinstance(values, dict) else None for key in ("frame_rate", "metres")]
    if not all(isinstance(each, (int, float)) and not isinstance(each, bool) and each > 0 for each in given):
        raise InvalidInput(f"{path}: expected frame_rate [1/s] and metres in a pixel, above 0; got {shown(values)}")
    return float(given[0]), float(given[1])  # type: ignore[arg-type]


def _recording(path: Path, rate: float, metres: float) -> Clip:
    table = read_csv(path)
    table = table.rename(
        {name: re.sub(r"[^a-z]", "", name.lower().partition("(")[0]) or name for name in table.columns}
    )
    require_columns(table, ["framenum", "id", "type", *_BOX, "speed"], path)
    table = table.with_columns(type=pl.col("type").str.strip_chars().str.to_lowercase())
    columns = {"id": "id", "frame": "framenum", "class": "type", "speed": "speed"} | dict(zip(BOX, _BOX, strict=True))
    layout = Layout(columns, _VEHICLES, _WALKERS, frame_rate=rate, metres=metres, speed=SPEEDS["km/h"], y_down=True)
    return clip_of(path.stem, {path: (table, layout)})


VPSCI = Importer(vpsci, length=VEHICLE_LENGTH, width=VEHICLE_WIDTH)
HDI = Importer(hdi, length=4.5, width=1.8)
