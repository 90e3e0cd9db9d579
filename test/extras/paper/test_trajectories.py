"""The picture shows every scenario once, with the speeds as colours and the outcome in the title."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from vpsci_ros.data.dataset import DatasetWriter
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import Episode, Listed
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper import trajectories as figures
from vpsci_ros.extras.paper.section_4.typical_episodes import typical_episodes
from vpsci_ros.extras.paper.trajectories import BLUES
from vpsci_ros.world import load_scenarios


def episode(scenario: int = 1) -> Episode:
    """A vehicle along x that comes to rest from 8 m/s, and a pedestrian along y; nearest in frame 30."""
    way, speed, still = np.linspace(0.0, 20.0, 50), np.linspace(8.0, 0.0, 50), np.zeros(50)
    ttc = 1.0 + 0.1 * np.abs(np.arange(50) - 30)
    walk = (row[None] for row in (still, way, still, 0.2 * speed, ttc, way))
    (place,) = load_scenarios([scenario])
    listed = Listed(f"{scenario}:0", place.name, scenario, 0, "goal", 1.0)
    return Episode(
        "", listed, place, 0.05, way, still, still, speed, still, *walk, np.zeros((1, 50), bool), np.ones((1, 50), bool)
    )


def test_each_scenario_with_a_kept_episode_has_one_typical_episode(dataset: Path) -> None:
    (title, first), (other, second) = typical_episodes(Dataset(dataset))
    assert (first.key[0], second.key[0]) == (1, 2)
    assert title.startswith("① LocationA_PedCross_S-N\nVehicle-yield, episode 0, least CurvTTC 1.00 s")
    assert other.startswith("② LocationA_PedCross_N-S\nPedestrian-yield")
    assert first.speed.min() < 0.2 < 4.9 < first.speed.max()
    assert 1.5 < first.curvttc[0].argmin() * first.period < 3.0


def test_colour_is_speed_from_white_at_rest_to_dark_at_eight() -> None:
    axis = Figure().subplots()
    figures.draw_episode(axis, "title", episode())
    lines = [item for item in axis.collections if isinstance(item, LineCollection)]
    assert lines[0].get_clim() == (0.0, 8.0)
    assert lines[0].get_array().data == pytest.approx(np.linspace(8.0, 0.0, 50)[:-1] - 4.0 / 49.0)
    assert BLUES(0.0) == (1.0, 1.0, 1.0, 1.0)
    assert sum(BLUES(1.0)[:3]) < 0.8
    assert axis.get_title() == "title"


def test_a_dataset_without_a_kept_episode_has_nothing_to_draw(tmp_path: Path) -> None:
    with DatasetWriter(tmp_path / "d", {1: "x"}, {"period": 0.05}) as writer:
        writer.close()
    with pytest.raises(InvalidInput, match="no episode was kept"):
        typical_episodes(Dataset(tmp_path / "d"))
