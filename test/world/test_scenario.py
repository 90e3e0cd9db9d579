"""Scenarios as data: the eight of Table 6, and errors that say which file, which key, what was expected."""

import copy
import json

import numpy as np
import pytest
import yaml

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world import load_scenario, load_scenarios
from vpsci_ros.world.scenario import scenario_files, scenario_from

FILES = scenario_files()
DOCUMENT = yaml.safe_load(FILES[0].read_text(encoding="utf-8"))


def test_the_eight_scenarios_are_those_of_table_6():
    ways = ["S-N", "N-S", "E-W", "W-E"]
    assert [f.stem for f in FILES] == [f"Location{place}_PedCross_{way}" for place in "AB" for way in ways]
    scenarios = load_scenarios(range(1, 9))
    assert [s.name for s in scenarios] == [f.stem for f in FILES]
    assert [s.number for s in scenarios] == list(range(1, 9))


@pytest.mark.parametrize("number", range(1, 9))
def test_pedestrians_walk_the_way_their_scenario_is_named_after(number):
    scenario = load_scenario(number)
    path = scenario.pedestrian.path
    way = scenario.name.rsplit("_", 1)[1]
    east, north = np.subtract(path.at(scenario.pedestrian.goal), path.at(0.0))
    assert {"S-N": north, "N-S": -north, "E-W": -east, "W-E": east}[way] > 10.0


@pytest.mark.parametrize(("number", "least"), [*((n, 70.0) for n in (1, 2, 5, 6)), *((n, 40.0) for n in (3, 4, 7, 8))])
def test_vehicles_turn_right_and_reach_their_goal_with_the_crosswalk_behind_the_rear_bumper(number, least):
    scenario = load_scenario(number)
    vehicle, walk = scenario.vehicle, scenario.pedestrian
    turn = vehicle.path.heading(vehicle.spawn[0]) - vehicle.path.heading(vehicle.goal)
    assert least < np.degrees(turn) < 92.0
    conflict, _ = vehicle.path.locate(*walk.path.at(walk.conflict))
    half_crosswalk, half_vehicle = 1.3, 2.35
    assert 2.0 < vehicle.goal - conflict - half_crosswalk - half_vehicle < 9.0


@pytest.mark.parametrize("number", range(1, 9))
def test_centrelines_are_those_of_the_map_within_five_centimetres(number, town10hd):
    scenario = load_scenario(number)
    turns = json.loads((town10hd / "right_turns.json").read_text(encoding="utf-8"))["locations"]
    centreline = np.array(turns[scenario.location]["right_turn_routes"][0]["centreline"])
    located = np.array([scenario.vehicle.path.locate(*point) for point in centreline])
    within = located[:, 0] >= 0.0
    assert within.sum() > 100
    assert np.abs(located[within, 1]).max() < 0.05
    assert any(np.allclose(scenario.crosswalk, c) for c in turns[scenario.location]["crosswalks"].values())


def changed(path: str, value):
    document = copy.deepcopy(DOCUMENT)
    *parents, key = path.split(".")
    place = document
    for parent in parents:
        place = place[parent]
    if value is KeyError:
        del place[key]
    else:
        place[key] = value
    return document


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("number", 0, "number must be a whole number from 1 to 255, got 0"),
        ("vehicle", 3, "vehicle: expected a mapping"),
        ("vehicle.spwan", 1, "unknown parameter 'spwan'; did you mean spawn?"),
        ("vehicle.centreline", [[0, 0], [0, float("nan")]], "at least 2 finite points"),
        ("vehicle.centreline", [[0, 0], [0, 0], [1, 1]], "same place"),
        ("vehicle.centreline", [[0, 0], [0, 20], [2, 20], [2, 0]], "the vehicle needs"),
        ("vehicle.spawn", [9, 3], r"must be \[least, greatest\], got \[9, 3\]"),
        ("vehicle.throttle", [0.5, 1.5], "throttle must be a number from 0 to 1"),
        ("pedestrian.goal", 2.0, "after the lane"),
        ("pedestrian.route", [[0, 0], [0, 9]], "does not cross the vehicle's centreline"),
        ("pedestrian.arrival", [True, 4], "arrival must be a number"),
    ],
)
def test_a_bad_value_is_refused_with_file_key_and_reason(path, value, message):
    with pytest.raises(InvalidInput, match=message) as error:
        scenario_from(changed(path, value), "own.yaml")
    assert str(error.value).startswith("own.yaml")


def test_an_unknown_scenario_is_refused_with_the_known_ones():
    with pytest.raises(InvalidInput, match="LocationA_PedCross_S-N"):
        load_scenario("nowhere")
    with pytest.raises(InvalidInput, match="a number from 1 to 8"):
        load_scenario(9)


def test_ones_own_intersection_is_a_file_of_the_same_shape(tmp_path):
    document = {
        "number": 40,
        "name": "straight",
        "location": "mine",
        "vehicle": {"centreline": [[0, 0], [100, 0]], "spawn": [0, 20], "goal": 90},
        "pedestrian": {"route": [[50, -5], [50, 8]], "goal": 9, "arrival": [3, 8]},
    }
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(document), encoding="utf-8")
    scenario = load_scenario(file)
    assert scenario.pedestrian.conflict == pytest.approx(5.0)
    assert scenario.vehicle.throttle == (0.6, 0.9)
