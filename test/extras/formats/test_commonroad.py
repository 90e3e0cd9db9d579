"""CommonRoad scenarios, read back with commonroad-io; their vehicle is drivable by the drivability checker."""

import numpy as np
import pytest

from vpsci_ros.extras.formats.exporters import Options, export
from vpsci_ros.extras.formats.movers import movers, road_of
from vpsci_ros.view.episode_sources import read_episodes

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
reader = pytest.importorskip(
    "commonroad.common.file_reader", reason="run apart by make test, with .venv/commonroad on the path"
)


@pytest.fixture(scope="module")
def folder(own_bag, tmp_path_factory):
    folder = tmp_path_factory.mktemp("commonroad") / "out"
    assert export(own_bag, ["commonroad"], folder, Options(vehicle="trajectory")) == {"commonroad": 3}
    return folder / "commonroad"


def test_obstacles_read_back_are_where_our_road_users_are_at_every_step(folder, own_bag):
    for episode in read_episodes(own_bag):
        scenario, _ = reader.CommonRoadFileReader(str(folder / f"{episode.label}.xml")).open()
        assert scenario.dt == episode.period
        obstacles = {each.obstacle_type.value: each for each in scenario.dynamic_obstacles}
        for kind, each in zip(("car", "pedestrian"), movers(episode), strict=True):
            states = [obstacles[kind].state_at_time(step) for step in range(len(each.x))]
            places = np.array([state.position for state in states])
            assert np.abs(places - np.column_stack([each.x, each.y])).max() < 1e-5
            assert np.cos([s.orientation for s in states]) == pytest.approx(np.cos(each.heading), abs=1e-5)
            assert [s.velocity for s in states] == pytest.approx(each.speed.tolist(), abs=1e-5)


def test_the_planning_problem_begins_as_the_vehicle_on_its_lanelet_and_ends_at_its_goal(folder, own_bag):
    for episode in read_episodes(own_bag):
        scenario, problems = reader.CommonRoadFileReader(str(folder / f"{episode.label}.xml")).open()
        lane = road_of(episode).vehicle
        (problem,) = problems.planning_problem_dict.values()
        assert problem.initial_state.position == pytest.approx([episode.x[0], episode.y[0]], abs=1e-5)
        turned = float(np.diff(episode.heading[:2])[0])
        assert problem.initial_state.yaw_rate == pytest.approx(turned / episode.period, abs=1e-5)
        network, goal = scenario.lanelet_network, lane.path.at(lane.goal)
        assert network.find_lanelet_by_position([problem.initial_state.position, np.array(goal)]) == [[100], [100]]
        (region,) = problem.goal.state_list
        assert region.position.contains_point(np.array(goal))
        assert region.time_step.end == len(episode.time) - 1
