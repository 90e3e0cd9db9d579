"""What ends the run of an exam, with the graph of nodes left out: what its nodes report is given."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from vpsci_ros.bags.reader import Bag
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.exam import run as one_run
from vpsci_ros.exam.exam import Exam, prepare
from vpsci_ros.exam.result import FRAMES, Conduct, read_result, run_folder
from vpsci_ros.exam.run import block_of_bag, unanswered_in
from vpsci_ros.lockstep.counts import WorldCounts
from vpsci_ros.nodes.graph import GraphResult
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.resources import params_dir
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.state import VEHICLE_ACTION_MISSING

BEGINS = NodeStatus(counts=WorldCounts(tick=3, vehicle_commands=3))


@pytest.fixture
def exam() -> Exam:
    """An exam on the episodes 1:0 and 1:2 and no other."""
    world = {"scenarios": [1], "only": [1, 0, 1, 2], "spawn": "paper"}
    return prepare(load(params_dir() / "ads_test.yaml").changed("world_simulator", world), "sleep 100")


@pytest.fixture
def ended(exam: Exam, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Return the function that says why a run ends in which nodes report this, after so long without progress."""

    def run(idle: float, error: str, **statuses: NodeStatus) -> str:
        found = []

        def graph(_: Any, folder: Path, *, stop_when: Callable[..., str], **__: Any) -> GraphResult:
            found.append(stop_when(statuses, idle))
            return GraphResult(folder, error=found[0] or error, nodes=statuses)

        monkeypatch.setattr("vpsci_ros.nodes.graph.run_graph", graph)
        monkeypatch.setattr(one_run, "DYING", 0.0)
        (tmp_path / "run").mkdir()
        one_run.run_in_graph(exam, "walker", tmp_path / "run", tmp_path / "log", quiet=True)
        assert (tmp_path / "run" / FRAMES).is_file(), "a failed run leaves its result, too"
        return found[0]

    return run


def test_an_exam_that_hears_another_graph_ends_at_once_and_names_it(ended: Callable[..., str]) -> None:
    heard = NodeStatus(second_publishers=["/world_simulator on /world/state", "/rviz on /markers"])
    assert ended(0.0, "", world_simulator=BEGINS, recorder=heard) == (
        "another graph, or the ADS, publishes beside its nodes: /world_simulator on /world/state"
    )


def test_an_exam_whose_nodes_miss_each_other_does_not_blame_the_ads(ended: Callable[..., str]) -> None:
    waits = NodeStatus(awaited=["recorder"], counts=WorldCounts())
    with pytest.raises(VpsciError) as caught:
        ended(61.0, "no progress", world_simulator=waits)
    assert str(caught.value) == "the run with walker, does not react: no progress"


def test_an_exam_whose_ads_leaves_ticks_unanswered_ends_and_says_for_how_many(ended: Callable[..., str]) -> None:
    counts = WorldCounts(tick=30, vehicle_commands=3, vehicle_answers_missing=27)
    assert "the ADS gave no usable command for" in ended(0.0, "", world_simulator=NodeStatus(counts=counts))


def test_a_bag_with_another_graphs_episodes_is_refused_in_words(exam: Exam, own_bag: Path) -> None:
    with pytest.raises(InvalidInput, match="episode 6:4 is another graph's, not of this exam"):
        block_of_bag(Bag(own_bag), exam)


def test_the_bag_of_a_run_is_checked_once_and_opened_anew_only_after_a_failure(
    own_bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = {"scenarios": [1, 6], "only": [1, 0, 1, 2, 6, 4], "spawn": "paper"}
    exam = prepare(load(params_dir() / "ads_test.yaml").changed("world_simulator", world), "sleep 100")
    recording, ends = Bag(own_bag), iter(["", "the ADS ended"])
    recording.topics()
    run = run_folder(tmp_path, "walker", 0)
    shutil.copytree(own_bag, run / "bag")

    def graph(_: Any, folder: Path, **__: Any) -> GraphResult:
        return GraphResult(folder, next(ends), nodes={"world_simulator": BEGINS}, recording=recording)

    def no_checksum(*_: Any) -> int:
        raise AssertionError("a bag is checked again")

    monkeypatch.setattr("vpsci_ros.nodes.graph.run_graph", graph)
    with monkeypatch.context() as patch:
        patch.setattr("vpsci_ros.bags.mcap_file._checksum", no_checksum)
        one_run.run_in_graph(exam, "walker", run, tmp_path / "log", quiet=True)
    whole = read_result(tmp_path, "walker")
    assert [episode.name for episode in whole.episodes] == ["1:0", "1:2", "6:4"]
    assert whole.conduct == Conduct(3)
    monkeypatch.setattr(recording, "files", [])  # not to be read
    one_run.run_in_graph(exam, "walker", run, tmp_path / "log", quiet=True)
    failed = read_result(tmp_path, "walker")
    assert [episode.listed for episode in failed.episodes] == [episode.listed for episode in whole.episodes]
    assert failed.conduct.failure == "walker, does not react: the ADS ended"


def test_a_tick_that_an_ads_leaves_unanswered_counts_once_however_many_pedestrians_there_are() -> None:
    config = WorldConfig(vehicle_driver="external", pedestrian_driver="autopilot", pedestrians=3)
    world = World(config, load_scenarios([1]), [(1, 7)], 1, 1)
    ticks = [world.advance(world.now.unassessed()) for _ in range(2)]
    assert all((events["kind"] == VEHICLE_ACTION_MISSING).sum() == 3 for events in ticks)
    assert [key for events in ticks for key in unanswered_in(events)] == [(1, 7)] * 2
