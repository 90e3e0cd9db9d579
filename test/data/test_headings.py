"""Recordings without headings: a vehicle keeps its heading while it stands, and turns once it drives."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vpsci_ros.data.importers import IMPORTERS, Clip
from vpsci_ros.data.importers.tracks import NO_HEADING

STEP = 0.04  # [s] between rows
COURSE = 2.0  # [rad] of the car
LAYOUT = """columns: {id: id, frame: frame, class: class, x: x, y: y}
vehicles: [car]
pedestrians: [person]
frame_rate: 25
"""


def driven(way: np.ndarray, noise: float, turn: float = 0.0) -> np.ndarray:
    """Return positions [T, 2] [m] of a car that has come `way` [m] far, `noise` [m] off; it turns by `turn` [1/m]."""
    fine = np.linspace(0.0, max(way[-1], 1e-9), 5001)
    heading = COURSE + turn * fine
    x, y = (
        np.concatenate([[0.0], np.cumsum(each[:-1] * np.diff(fine))]) for each in (np.cos(heading), np.sin(heading))
    )
    place = np.stack([np.interp(way, fine, x), np.interp(way, fine, y)], axis=1)
    return place + np.random.default_rng(7).normal(0.0, noise, place.shape)


def stops_and_goes(waits: float = 10.0) -> np.ndarray:
    """Return the way [m] at each row of a car that brakes from 6 m/s by 2 m/s2, waits, and drives on."""
    brakes = 6.0 * (t := np.arange(0.0, 3.0, STEP)) - t**2
    goes = 9.0 + 0.75 * np.arange(0.0, 4.0, STEP) ** 2
    return np.concatenate([brakes, np.full(round(waits / STEP), 9.0), goes])


def read(folder: Path, place: np.ndarray) -> Clip:
    """Read a car at these positions, and somebody who stands."""
    frame = np.arange(len(place))
    car = pl.DataFrame({"id": "c", "frame": frame, "class": "car", "x": place[:, 0], "y": place[:, 1]})
    person = car.with_columns(id=pl.lit("p"), x=pl.lit(5.0), y=pl.lit(5.0)).with_columns(
        pl.lit("person").alias("class")
    )
    pl.concat([car, person]).write_csv(folder / "a.csv")
    (folder / "layout.yaml").write_text(LAYOUT)
    (clip,) = IMPORTERS.find("described").read(folder)
    return clip


@pytest.mark.parametrize("noise", [0.0, 0.03, 0.08])
def test_a_car_that_stops_waits_and_drives_on_keeps_its_heading(noise: float, tmp_path: Path) -> None:
    clip = read(tmp_path, driven(stops_and_goes(), noise))
    (car,) = clip.vehicles
    assert sum(clip.left_out.values()) == 0
    assert np.abs(car.values["heading"] - COURSE).max() < 0.02 + 5.0 * noise
    waiting = car.values["heading"][40:125]  # from 4 s, 1 s after it has stopped, to 12.5 s
    assert np.ptp(waiting) == 0.0
    assert np.median(car.values["speed"][40:125]) < 0.02 + 3.0 * noise


def test_a_car_that_turns_before_and_after_it_waits_has_the_headings_of_its_way(tmp_path: Path) -> None:
    way = stops_and_goes()
    (car,) = read(tmp_path, driven(way, 0.02, turn=1.0 / 8.0)).vehicles
    there = np.interp(0.1 * np.arange(len(car.values["x"])), STEP * np.arange(len(way)), way)
    assert np.abs(car.values["heading"] - COURSE - there / 8.0).max() < 0.25


def test_a_car_that_never_drives_half_a_metre_has_no_heading_and_is_counted(tmp_path: Path) -> None:
    place = driven(np.zeros(200), 0.02)
    clip = read(tmp_path, place).with_headings()
    assert (clip.vehicles, clip.left_out) == ([], {NO_HEADING: 1})
    place[-25:] += np.linspace(0.0, 1.0, 25)[:, None] * [np.cos(COURSE), np.sin(COURSE)]  # and drives off, slowly
    (car,) = read(tmp_path, place).vehicles
    assert np.abs(car.values["heading"] - COURSE).max() < 0.25
    assert np.ptp(car.values["heading"][:70]) == 0.0
