"""The simulated world into files: the batch leaves no trace in them, and what is kept obeys the filters."""

from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.dataset import DatasetWriter
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode_block import EpisodeFrames
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop


def generate(folder: Path, batch: int) -> Dataset:
    """Simulate 12 episodes each of scenarios 1 and 7, rule-based, into a dataset."""
    config = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot")
    scenarios = load_scenarios([1, 7])
    world = World(config, scenarios, ((s, e) for e in range(12) for s in (1, 7)), batch, seed=3)
    frames = EpisodeFrames(batch)
    with DatasetWriter(folder, {s.number: s.name for s in scenarios}, {"seed": 3, "period": 0.05}) as writer:
        for step in Loop(world):
            writer.add(frames.add(step.tick.state, step.assessment.curvttc, step.assessment.distance))
        writer.close(unfinished=frames.unfinished)
    return Dataset(folder)


def test_every_kept_episode_obeys_the_four_conditions(tmp_path: Path) -> None:
    data = generate(tmp_path / "data", 16)
    index = data.index()
    assert index.height == 24
    assert index["reason"].n_unique() > 1
    for name, counts in data.scenarios.items():
        kept = index.filter((pl.col("scenario") == counts["number"]) & (pl.col("reason") == "kept"))
        rows = data.rows(name)
        assert rows["count"].unique(maintain_order=True).to_list() == kept["count"].to_list()
        for (_,), episode in rows.group_by(["count"], maintain_order=True):
            assert episode["frame"].to_list() == list(range(episode.height))
            assert episode.height >= 100
            assert episode["CurvTTC"].min() < 5.0
            ends = episode[[0, -1]].to_dict(as_series=False)
            for agent, least in (("av", 10.0), ("ped", 4.0)):
                assert np.hypot(*(np.diff(ends[f"position_{axis}_{agent}"])[0] for axis in "xy")) > least
