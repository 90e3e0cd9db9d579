"""Who became critical in an episode, and whether parked vehicles hid them, on worlds that run here."""

from pathlib import Path

import polars as pl
import pytest

from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.simulated import write_ticks
from vpsci_ros.data.episode_block import ended_episodes
from vpsci_ros.exam.exam import ExamConfig, prepare
from vpsci_ros.exam.measures import episode_table
from vpsci_ros.exam.report import make_report
from vpsci_ros.exam.result import Conduct, FirstCritical, RunResult, first_critical
from vpsci_ros.exam.run import autopilot_run, block_of_bag
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.kinds import KINDS, KindMixture
from vpsci_ros.world.loop import Loop

EPISODES = 40


def run(scenario: int = 104, **config: object):
    """Return the result of episodes of the rule-based pair."""
    chosen = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot", **config)
    scenarios = load_scenarios([scenario])
    world = World(chosen, scenarios, [(scenario, e) for e in range(EPISODES)], EPISODES, 3)
    return RunResult(list(ended_episodes(Loop(world), chosen.tick, scenarios)))


def found_in(result: RunResult) -> dict[tuple[int, int], FirstCritical]:
    """Return who became critical first, of the critical episodes."""
    critical = (each for each in result.episodes if each.known_curvttc.min() < CRITICAL_TTC)
    return {each.key: first_critical(each) for each in critical}


def test_where_vehicles_are_parked_some_are_hidden_as_it_becomes_critical() -> None:
    result = run()
    found = found_in(result)
    assert 5 < sum(each.hidden for each in found.values()) < len(found)
    assert not any(each.hidden for each in found_in(run(scenario=101)).values())


def test_kinds_and_groups_are_those_of_the_episodes_where_the_bag_holds_neither(tmp_path: Path) -> None:
    kinds = {f"kinds.{name}": 1.0 for name in KINDS}
    world = {"scenarios": [1, 104], "episodes": 6, "seed": 5, "pedestrians": 3, "crowd.sizes": [1.0, 1.0, 1.0]} | kinds
    exam = prepare(Sections({"world_simulator": world, "ads_test": {"pedestrians": ["walker"]}}), "external")
    config = exam.with_pedestrian("walker", "autopilot")
    write_ticks(Loop(World(config, exam.scenarios, exam.episodes, 1, 5)), config, tmp_path / "bag", {})
    block = block_of_bag(Bag(tmp_path / "bag"), exam)
    read = RunResult(list(block.episodes(config.tick, exam.scenarios)))
    expected = autopilot_run(exam, "walker")
    found = found_in(read)
    assert found == found_in(expected)
    assert [episode.listed for episode in read.episodes] == [episode.listed for episode in expected.episodes]
    assert {each.pedestrians for each in found.values()} == {1, 2, 3}
    assert len({each.kind for each in found.values()}) > 2


def test_results_come_by_kind_by_group_and_by_who_was_hidden_where_these_differ() -> None:
    result = run(pedestrians=2, kinds=KindMixture(adult=1.0, child=1.0))
    assert len(result.episodes) == EPISODES, "an episode is one, however many pedestrians it has"
    options = {"driver": "autopilot", "pedestrian": "walker"}
    table = episode_table(result, [], **options)
    report = make_report(table, {"walker": Conduct(EPISODES)}, ExamConfig(pedestrians=["walker"], baseline=True))
    groups = report["groups"]
    assert set(groups) == {"kind", "hidden"}, "all groups are of two"
    kinds = groups["kind"]["autopilot"]["walker"]
    assert set(kinds) == {"adult", "child"}
    critical = table.filter(pl.col("critical"))
    assert sum(scores["episodes"] for scores in kinds.values()) == critical.height
    children = critical.filter(pl.col("kind") == "child")
    assert kinds["child"]["collision_rate"]["value"] == pytest.approx(children["collision"].mean())
    assert set(critical["group_size"]) == {2}
    assert set(groups["hidden"]["autopilot"]["walker"]) == {"in sight", "hidden"}
