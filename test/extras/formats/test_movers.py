"""Road users of an episode as the formats write them: headings, what has none, and the road that its source holds."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vpsci_ros.bags.export import export_bag
from vpsci_ros.bags.reader import BagTick
from vpsci_ros.bags.simulated import write_ticks
from vpsci_ros.data.episode import Episode
from vpsci_ros.data.episode_block import ended_episodes
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.formats.exporters import export
from vpsci_ros.extras.formats.movers import movers, road_of
from vpsci_ros.view.episode_sources import read_episodes
from vpsci_ros.world import World, WorldConfig
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.scenario import load_scenario, scenario_from
from vpsci_ros.world.state import GOAL


@pytest.fixture
def episode(simulate) -> Episode:
    ticks = (BagTick(number, 0.05, *tick) for number, tick in enumerate(simulate([4], [GOAL], 1)))
    (one,) = ended_episodes(ticks, 0.05, [], source="here")
    return one


def walking(episode: Episode, vx: list[float], vy: list[float]) -> Episode:
    return replace(episode, ped_vx=np.array([vx]), ped_vy=np.array([vy]))


def test_who_stands_keeps_the_heading_it_had_or_has_the_first_one_that_comes(episode: Episode) -> None:
    _, walker = movers(walking(episode, [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 2.0]))
    assert walker.heading == pytest.approx([np.pi, np.pi, np.pi, np.pi / 2])


def test_a_road_user_without_a_heading_or_a_position_is_refused(episode: Episode) -> None:
    with pytest.raises(InvalidInput, match="here: pedestrian of scenario_1_000000: never moves, so its heading is unk"):
        movers(walking(episode, [0.0] * 4, [0.0] * 4))
    with pytest.raises(InvalidInput, match="here: vehicle of scenario_1_000000: a position or velocity is missing"):
        movers(replace(episode, x=np.array([0.0, np.nan, 0.0, 0.0])))


@pytest.mark.parametrize("number", [101])
def test_ones_own_scenario_is_exported_as_bag_and_dataset_hold_it_whatever_number_it_has(
    number: int, tmp_path: Path
) -> None:
    package = load_scenario("LocationA_PedCross_S-N")
    own = scenario_from({**package.document, "number": number, "name": "yard"}, "yard.yaml")
    config = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot", spawn="paper", episode_time=5.0)
    bag, dataset = tmp_path / "bag", tmp_path / "dataset"
    write_ticks(Loop(World(config, [own], [(number, 0)], 1, 3)), config, bag, {}, scenarios=[own])
    export_bag(bag, dataset, episodes="0", keep_rejected=True)
    for source in (bag, dataset):
        (one,) = read_episodes(source)
        assert (one.label, road_of(one).name, road_of(one).number) == ("yard_000000", "yard", number)
        assert export(source, ["scenarionet"], tmp_path / f"out_{source.name}") == {"scenarionet": 3}
