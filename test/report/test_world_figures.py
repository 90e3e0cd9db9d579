"""The picture of a scenario shows what its file says, for any scenario."""

import numpy as np
import pytest

from vpsci_ros.report import world_figures
from vpsci_ros.world import load_scenario


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """Return the function that draws a scenario and returns its axes."""
    figures = []
    monkeypatch.setattr(world_figures, "save_png", lambda figure, path, resolution: figures.append(figure))

    def draw(scenario):
        world_figures.save_scenario(scenario, tmp_path / "scenario.png")
        return figures[-1].axes[0]

    return draw


@pytest.mark.parametrize("number", [1, 4, 7, 8])
def test_lane_routes_and_goals_are_drawn_where_the_scenario_has_them(drawn, number):
    scenario = load_scenario(number)
    axis = drawn(scenario)
    lane = scenario.vehicle.path.band(scenario.vehicle.lane_width)
    assert any(np.array_equal(patch.get_xy()[:-1], lane) for patch in axis.patches if hasattr(patch, "get_xy"))
    lines = [np.array(line.get_data()).T for line in axis.lines if len(line.get_xdata()) > 1]
    for route in (scenario.vehicle, scenario.pedestrian):
        assert any(np.array_equal(line, route.path.points) for line in lines)
        goal = route.path.at(route.goal)
        ends = [line for line in lines if len(line) == 2 and np.allclose(line.mean(axis=0), goal, atol=1e-6)]
        assert len(ends) == 1, "one line across the path at its goal"
        along = np.subtract(route.path.at(route.goal + 0.1), route.path.at(route.goal - 0.1))
        assert abs(np.dot(ends[0][1] - ends[0][0], along)) < 0.05 * np.hypot(*along) * np.hypot(
            *(ends[0][1] - ends[0][0])
        )


def test_the_pedestrian_of_each_of_the_first_episodes_is_drawn_once(drawn):
    """As on its way, or as waiting."""
    assert sum(len(points.get_offsets()) for points in drawn(load_scenario(1)).collections) == world_figures.SPAWNS
