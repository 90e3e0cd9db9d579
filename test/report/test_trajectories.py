"""The picture shows every scenario once, with the speeds as colours and the outcome in the title."""

import struct
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from vpsci_ros.data.dataset import DatasetWriter
from vpsci_ros.errors import InvalidInput
from vpsci_ros.report import trajectories as figures
from vpsci_ros.report.panels import Panel, typical_panels
from vpsci_ros.report.trajectories import BLUES, save_trajectories
from vpsci_ros.world import load_scenarios


def panel(scenario: int = 1) -> Panel:
    way = np.linspace(0.0, 20.0, 50)
    speed = np.linspace(8.0, 0.0, 50)
    path = np.column_stack([way, 0.0 * way])
    return Panel("title", scenario, path, speed, 0.0 * way, path[:, ::-1], 0.2 * speed, 30)


def test_each_scenario_with_a_kept_episode_has_one_typical_panel(dataset: Path) -> None:
    first, second = typical_panels(dataset)
    assert (first.scenario, second.scenario) == (1, 2)
    assert first.title.startswith("① LocationA_PedCross_S-N\nVehicle-yield, episode 1, least CurvTTC 2.00 s")
    assert second.title.startswith("② LocationA_PedCross_N-S\nPedestrian-yield")
    assert first.vehicle_speed.min() < 0.2 < 4.9 < first.vehicle_speed.max()
    assert 1.5 < first.nearest * 0.05 < 3.0


def test_the_picture_is_a_png_of_eight_panels(tmp_path: Path) -> None:
    save_trajectories([panel(k) for k in range(1, 9)], load_scenarios(range(1, 9)), tmp_path / "figure.png")
    data = (tmp_path / "figure.png").read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", data[16:24])
    assert width > 1500
    assert height > 800
    assert [path.name for path in tmp_path.iterdir()] == ["figure.png"]


def test_colour_is_speed_from_white_at_rest_to_dark_at_eight() -> None:
    axis = Figure().subplots()
    figures.draw_panel(axis, panel(), None)
    lines = [item for item in axis.collections if isinstance(item, LineCollection)]
    assert lines[0].get_clim() == (0.0, 8.0)
    assert lines[0].get_array().data == pytest.approx(np.linspace(8.0, 0.0, 50)[:-1] - 4.0 / 49.0)
    assert BLUES(0.0) == (1.0, 1.0, 1.0, 1.0)
    assert sum(BLUES(1.0)[:3]) < 0.8
    assert axis.get_title() == "title"


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_fewer_panels_than_eight_are_drawn_too(tmp_path: Path, count: int) -> None:
    save_trajectories([panel()] * count, [], tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


def test_nothing_to_draw_is_refused_and_nothing_written(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="at least one interaction"):
        save_trajectories([], [], tmp_path / "figure.png")
    with DatasetWriter(tmp_path / "d", {1: "x"}, {"period": 0.05}) as writer:
        writer.close()
    with pytest.raises(InvalidInput, match="no episode was kept"):
        typical_panels(tmp_path / "d")
    assert not (tmp_path / "figure.png").exists()
