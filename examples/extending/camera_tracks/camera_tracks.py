"""Tracks of a roadside camera: CSV files with frame, id, kind (car or person), x, y, heading, vx, vy at 10 frames/s."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.importers import Clip, Importer, Track
from vpsci_ros.errors import InvalidInput


def read(folder: Path) -> Iterator[Clip]:
    """Yield a clip for each CSV file of a folder."""
    files = sorted(folder.glob("*.csv"))
    if not files:
        raise InvalidInput(f"{folder}: expected CSV files of the camera, found none")
    for file in files:
        agents = pl.read_csv(file).sort("id", "frame").partition_by("id")
        cars = [vehicle(rows) for rows in agents if rows["kind"][0] == "car"]
        people = [pedestrian(rows) for rows in agents if rows["kind"][0] == "person"]
        yield Clip(file.stem, cars, people)


def vehicle(rows: pl.DataFrame) -> Track:
    """Return the track of one car; a heading must not jump by 2 pi."""
    values = {name: rows[name].to_numpy() for name in ("x", "y")}
    values["heading"] = np.unwrap(rows["heading"].to_numpy())
    values["speed"] = np.hypot(rows["vx"].to_numpy(), rows["vy"].to_numpy())
    return Track(rows["id"][0], first=rows["frame"][0], values=values)


def pedestrian(rows: pl.DataFrame) -> Track:
    """Return the track of one person."""
    values = {name: rows[name].to_numpy() for name in ("x", "y", "vx", "vy")}
    return Track(rows["id"][0], first=rows["frame"][0], values=values)


CAMERA = Importer(read, length=4.6, width=1.85)
