"""The scenarios beyond Table 6 lie on the lanes of Town10HD, are found as the paper's are, and become critical."""

import os
from pathlib import Path

import numpy as np
import pytest
import yaml

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world import World, WorldConfig, load_scenario, load_scenarios
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.opendrive import OpenDriveMap
from vpsci_ros.world.scenario import further_files, own_documents

DATA = Path(os.environ.get("VPSCI_DATA", Path(__file__).resolve().parents[3] / "shared" / "data")) / "town10hd"
NUMBERS = [101, 102, 103, 104]
LANES = {
    101: [("12", 1), ("150", 1)],
    102: [("18", -1), ("19", -1), ("296", -1), ("15", -1), ("16", -1)],
    103: [("20", -2), ("875", -2)],
    104: [("12", 1), ("150", 1)],
}


@pytest.mark.skipif(not DATA.is_dir(), reason="needs data/town10hd (set VPSCI_DATA)")
@pytest.mark.parametrize("number", NUMBERS)
def test_centrelines_are_those_of_the_map_within_five_centimetres(number):
    path = load_scenario(number).vehicle.path
    centre, width = OpenDriveMap(DATA / "Town10HD.xodr").route(LANES[number], 0.5)
    located = np.array([path.locate(*point) for point in centre])
    assert np.abs(located[:, 1]).max() < 0.05
    assert width == load_scenario(number).vehicle.lane_width


@pytest.mark.parametrize(("number", "turn"), [(101, 0.0), (102, 90.0), (103, 0.0), (104, 0.0)])
def test_the_car_drives_straight_or_turns_left_and_leaves_the_crossing_behind_its_rear_bumper(number, turn):
    vehicle, walk = load_scenario(number).vehicle, load_scenario(number).pedestrian
    turned = vehicle.path.heading(vehicle.path.length) - vehicle.path.heading(0.0)
    assert np.degrees(turned) == pytest.approx(turn, abs=1.0)
    conflict, _ = vehicle.path.locate(*walk.path.at(walk.conflict))
    half_crossing, half_vehicle = 1.5, 2.35
    assert 4.0 < vehicle.goal - conflict - half_crossing - half_vehicle < 6.0


def test_whoever_waits_on_the_refuge_stands_between_the_carriageways():
    config = WorldConfig(spawn="paper")
    state = World(config, load_scenarios([103]), [(103, e) for e in range(300)], 300, 1).state
    waiting = state["start_delay"] > 0.0
    assert 30 < waiting.sum() < 270
    assert (state["pedestrian_y"][waiting] < -18.9).all()
    assert (state["pedestrian_y"][waiting] > -22.4).all()


def test_the_share_of_people_who_wait_is_the_scenarios():
    for number, share in ((101, 0.06), (103, 0.5)):
        state = World(
            WorldConfig(spawn="human"), load_scenarios([number]), [(number, e) for e in range(2000)], 2000, 1
        ).state
        deviation = np.sqrt(share * (1.0 - share) / 2000)
        assert (state["start_delay"] > 0.0).mean() == pytest.approx(share, abs=4.0 * deviation)


@pytest.mark.parametrize("number", NUMBERS)
@pytest.mark.parametrize("spawn", ["human", "paper"])
def test_most_encounters_become_critical_and_end(number, spawn):
    config = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot", spawn=spawn)
    world = World(config, load_scenarios([number]), [(number, e) for e in range(100)], 100, 1)
    ends = np.concatenate([step.events[step.events["kind"] == 4] for step in Loop(world)])
    assert len(ends) == 100
    assert (ends["least_curvttc"] < 5.0).mean() > 0.5
    assert set(ends["outcome"]) >= {1, 2}, "some collide, some reach their goals"


def test_they_are_found_by_number_and_name_and_their_makings_go_where_they_are_used():
    assert [yaml.safe_load(path.read_text("utf-8"))["name"] for path in further_files()] == [
        path.stem for path in further_files()
    ]
    named = load_scenario("Town10HD_LeftTurn")
    assert named.number == load_scenario("102").number == 102
    assert list(own_documents(load_scenarios([1, 102]))) == ["Town10HD_LeftTurn"]


def test_a_file_of_ones_own_may_take_a_number_of_theirs(tmp_path):
    document = dict(load_scenario(101).document) | {"name": "mine"}
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(document), encoding="utf-8")
    assert [scenario.name for scenario in load_scenarios([101], [file])] == ["mine"]


def test_a_number_that_no_scenario_has_is_refused_with_those_that_there_are():
    with pytest.raises(InvalidInput, match="a number from 1 to 8 or 101 to 104"):
        load_scenario(100)
