"""The roads drawn around the shipped scenarios are those that their lanes lie on."""

from dataclasses import replace

from matplotlib.path import Path as Outline

from vpsci_ros.resources import params_dir
from vpsci_ros.world import load_scenarios
from vpsci_ros.world.scenario import further_files, scenario_files
from vpsci_ros.world.surroundings import surroundings_of


def test_every_shipped_lane_lies_on_the_roads_around_it_and_no_other_scenario_has_any() -> None:
    scenarios = load_scenarios([*scenario_files(), *further_files()])
    for scenario in scenarios:
        kerbs, marks = surroundings_of(scenario).values()
        lane = scenario.vehicle.path.band(scenario.vehicle.lane_width - 0.5)
        inside = sum(Outline(kerb).contains_points(lane).astype(int) for kerb in kerbs)
        assert (inside % 2 == 1).all(), scenario.name  # within the outer kerb, on no block or island
        assert len(marks) > 10
    assert not any(surroundings_of(replace(scenarios[0], name="mine")).values())


def test_the_file_of_the_roads_is_small_and_names_its_source_and_licence() -> None:
    text = (params_dir() / "scenarios" / "roads.json").read_text(encoding="utf-8")
    assert len(text) < 60_000
    assert "Town10HD.xodr of the CARLA project, MIT licence, Copyright (c) 2017-2020" in text
