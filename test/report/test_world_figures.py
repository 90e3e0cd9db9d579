"""The picture of a scenario shows what its file says, for any scenario."""

import matplotlib.image
import numpy as np
import pytest

from vpsci_ros.report.world_figures import save_scenario
from vpsci_ros.world import load_scenario

COLOURS = {"vehicle": (8, 81, 156), "pedestrian": (165, 15, 21), "goal": (44, 160, 44), "road": (213, 213, 210)}


def pixels(path, colour):
    """Return row and column of every pixel of a colour, inside the axes: the legend below them is left out."""
    image = (matplotlib.image.imread(path)[..., :3] * 255).round().astype(int)
    places = np.argwhere((image == COLOURS[colour]).all(axis=-1))
    return places[places[:, 0] < 0.9 * len(image)]


def in_metres(path, scenario):
    """Return the function that maps pixels to places [m]: the lane's box is known in both."""
    road, lane = pixels(path, "road"), scenario.vehicle.path.band(scenario.vehicle.lane_width)
    (top, left), (bottom, right) = road.min(axis=0), road.max(axis=0)
    (west, south), (east, north) = lane.min(axis=0), lane.max(axis=0)
    scale = (east - west) / (right - left)
    assert (north - south) / (bottom - top) == pytest.approx(scale, rel=0.02)  # one metre is as long either way
    return lambda places: np.stack([west + (places[:, 1] - left) * scale, north - (places[:, 0] - top) * scale], axis=1)


@pytest.mark.parametrize("number", [1, 4, 7, 8])
def test_routes_and_goals_are_drawn_where_the_scenario_has_them(tmp_path, number):
    path, scenario = tmp_path / "scenario.png", load_scenario(number)
    save_scenario(scenario, path)
    place = in_metres(path, scenario)
    for agent in ("vehicle", "pedestrian"):
        route, drawn = getattr(scenario, agent), place(pixels(path, agent))
        for s in np.linspace(2.0, route.path.length - 2.0, 30):
            assert np.hypot(*(drawn - route.path.at(s)).T).min() < 1.0, (agent, s)  # the star covers as much
        goal = place(pixels(path, "goal"))
        assert np.hypot(*(goal - route.path.at(route.goal)).T).min() < 0.5
