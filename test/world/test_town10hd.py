"""The scenarios beyond Table 6 lie on the lanes of Town10HD, are found as the paper's are, and become critical."""

import numpy as np
import pytest

from vpsci_ros.world import World, WorldConfig, load_scenario, load_scenarios
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.opendrive import OpenDriveMap

NUMBERS = [101, 102, 103, 104]
LANES = {
    101: [("12", 1), ("150", 1)],
    102: [("18", -1), ("19", -1), ("296", -1), ("15", -1), ("16", -1)],
    103: [("20", -2), ("875", -2)],
    104: [("12", 1), ("150", 1)],
}


@pytest.mark.parametrize("number", NUMBERS)
def test_centrelines_are_those_of_the_map_within_five_centimetres(number, town10hd):
    path = load_scenario(number).vehicle.path
    centre, width = OpenDriveMap(town10hd / "Town10HD.xodr").route(LANES[number], 0.5)
    located = np.array([path.locate(*point) for point in centre])
    assert np.abs(located[:, 1]).max() < 0.05
    assert width == load_scenario(number).vehicle.lane_width


def test_the_share_of_people_who_wait_is_the_scenarios():
    for number, share in ((101, 0.06), (103, 0.5)):
        state = World(
            WorldConfig(spawn="human"), load_scenarios([number]), [(number, e) for e in range(2000)], 2000, 1
        ).state
        deviation = np.sqrt(share * (1.0 - share) / 2000)
        assert (state["start_delay"] > 0.0).mean() == pytest.approx(share, abs=4.0 * deviation)


@pytest.mark.parametrize("number", NUMBERS)
def test_most_encounters_become_critical_and_end(number):
    config = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot", spawn="human")
    world = World(config, load_scenarios([number]), [(number, e) for e in range(100)], 100, 1)
    ends = np.concatenate([step.events[step.events["kind"] == 4] for step in Loop(world)])
    assert len(ends) == 100
    assert (ends["least_curvttc"] < 5.0).mean() > 0.5
    assert set(ends["outcome"]) >= {1, 2}, "some collide, some reach their goals"
