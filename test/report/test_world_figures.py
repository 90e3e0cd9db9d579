"""The picture of a scenario shows what its file says, for any scenario."""

import matplotlib.image
import numpy as np
import pytest

from vpsci_ros.report.world_figures import save_scenario
from vpsci_ros.world import load_scenario

COLOURS = {"vehicle": (8, 81, 156), "pedestrian": (165, 15, 21), "goal": (44, 160, 44), "road": (213, 213, 210)}


def pixels(path, colour):
    image = (matplotlib.image.imread(path)[..., :3] * 255).round().astype(int)
    return np.argwhere((image == COLOURS[colour]).all(axis=-1))


@pytest.mark.parametrize("number", [1, 7])
def test_lane_routes_goals_and_spawns_are_drawn(tmp_path, number):
    path = tmp_path / "scenario.png"
    save_scenario(load_scenario(number), path)
    for colour in COLOURS:
        assert len(pixels(path, colour)) > 50, colour


def test_the_pedestrian_of_scenario_8_comes_from_the_west_and_that_of_7_from_the_east(tmp_path):
    columns = {}
    for number in (7, 8):
        path = tmp_path / f"{number}.png"
        save_scenario(load_scenario(number), path)
        columns[number] = np.median(pixels(path, "pedestrian")[:, 1])
    assert columns[8] < columns[7]
