#!/usr/bin/env python
"""Recorded and generated near misses beside each other, drawn at random and drawn alike: a picture for docs/realism.md.

tools/beside.py DATASET docs/beside.png [--data right_turns/dev] [--episodes 2000]
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import RECORDED, Episode, Listed
from vpsci_ros.data.near_misses import clean, read_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper.realism.free import as_near_misses
from vpsci_ros.extras.paper.trajectories import draw_episode, draw_speed_bars
from vpsci_ros.report.canvas import blank_figure, save_png
from vpsci_ros.resources import TO_MEASURE_ON
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.observation import STEP

EACH, COLUMNS = 12, 6
BEFORE, AFTER = 10, 50  # steps around the onset that are drawn: 1 s and 5 s
HALF = 14.0  # [m] half a panel's width


class View(NamedTuple):
    """How an interaction is drawn: `centre` [m] as origin, turned by `angle` [rad], so that the vehicle heads up."""

    centre: NDArray[np.float64]
    angle: float

    def place(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points of the map, float64[..., 2] [m], in the coordinates of the drawing."""
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        placed: NDArray[np.float64] = (points - self.centre) @ np.array([[cos, sin], [-sin, cos]])
        return placed


def save_beside(recorded: pl.DataFrame, generated: pl.DataFrame, path: str | Path, seed: int = 0) -> None:
    """Draw `EACH` interactions of either table, chosen at random, and write a PNG, whole or not at all.

    Each is drawn without its street from 1 s before the onset to 5 s after it, the vehicle at the onset heading up.

    :param recorded, generated: near-miss tables, with `curvttc_causal`.
    :raises InvalidInput: a table has no interaction with an onset, or the folder of `path` does not exist.
    """
    rows = -(-EACH // COLUMNS)
    figure = blank_figure(2.6 * COLUMNS, 2.8 * 2 * rows + 1.2)
    halves = np.asarray(figure.subfigures(2, 1))
    for part, (name, table) in zip(halves, (("recorded", recorded), ("generated", generated)), strict=True):
        part.suptitle(f"{name}, {EACH} at random", fontsize=12)
        axes = part.subplots(rows, COLUMNS, squeeze=False)
        episodes = [episode for episode, _ in draw_at_random(table, name, seed)]
        for axis, one in zip(axes.flat, episodes, strict=False):
            draw_episode(axis, f"least CurvTTC {one.least_curvttc:.1f} s", one)
            axis.set_xlim(-HALF, HALF)
            axis.set_ylim(-HALF, HALF)
            axis.set(xlabel="", ylabel="", xticks=[], yticks=[])
        for axis in axes.flat[len(episodes) :]:
            axis.set_axis_off()
    draw_speed_bars(part, axes[:, : COLUMNS // 2], axes[:, COLUMNS // 2 :])
    save_png(figure, path, 100)


def draw_at_random(table: pl.DataFrame, name: str, seed: int, count: int = EACH) -> list[tuple[Episode, View]]:
    """Return up to `count` interactions, drawn at random, each around its onset and in its view.

    :param name: of the table, for the error and the draw.
    :raises InvalidInput: the table has no interaction with an onset.
    """
    parts = table.filter((pl.col("curvttc_causal") < CRITICAL_TTC).any().over("interaction")).partition_by(
        "interaction", maintain_order=True
    )
    if not parts:
        raise InvalidInput(f"{name}: expected an interaction with CurvTTC below {CRITICAL_TTC:g} s, got none")
    chosen = np.random.default_rng([seed, len(name)]).permutation(len(parts))[:count]
    return [_around_onset(parts[i]) for i in chosen]


def _around_onset(whole: pl.DataFrame) -> tuple[Episode, View]:
    """Return an interaction around its onset, without its street and its distances, and the view that it is in."""
    onset = int((whole["curvttc_causal"].to_numpy() < CRITICAL_TTC).argmax())
    part = whole[max(0, onset - BEFORE) : onset + AFTER + 1]
    at = min(onset, BEFORE)
    vehicle, walk, walking = (part.select(f"{name}x", f"{name}y").to_numpy() for name in ("veh_", "ped_", "ped_v"))
    view = View(0.5 * (vehicle[at] + walk[at]), 0.5 * np.pi - float(part["veh_heading"][at]))
    x, y = view.place(vehicle).T
    turn = view._replace(centre=np.zeros(2))
    px, py, vx, vy = (column[None] for column in (*view.place(walk).T, *turn.place(walking).T))
    ttc = part["curvttc_causal"].to_numpy()[None]
    listed = Listed("", str(part["clip"][0]), 0, int(part["interaction"][0]), RECORDED, float(ttc.min()))
    driven = x, y, part["veh_heading"].to_numpy() + view.angle, part["veh_speed"].to_numpy(), np.zeros(len(x))
    walked = px, py, vx, vy, ttc, np.full_like(ttc, np.nan)
    return Episode(
        "", listed, None, STEP, *driven, *walked, np.zeros(ttc.shape, np.bool_), np.ones(ttc.shape, np.bool_)
    ), view


def main() -> None:
    """Draw the picture."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("dataset", type=Path)
    arguments.add_argument("picture", type=Path)
    arguments.add_argument("--data", default=TO_MEASURE_ON)
    arguments.add_argument("--episodes", type=int, default=2000)
    options = arguments.parse_args()
    made = as_near_misses(Dataset(options.dataset), options.episodes, 0)
    save_beside(clean(read_near_misses(options.data)), made, options.picture)


if __name__ == "__main__":
    main()
