"""A run that ended without an error is complete only if every number agrees."""

from dataclasses import replace

import pytest

from vpsci_ros.runs.completeness import RecordedCounts, what_is_missing

NODES = ["world_simulator", "safety_monitor", "vehicle_policy", "recorder"]
PROGRESS = {"episodes_ended": 6.0, "world_simulator.published /world/state": 201.0}
RECORDED = RecordedCounts(
    seen={"/world/state": 203}, refused={"/world/state": 2}, written={"/world/state": 201}, held={"/world/state": 201}
)


def test_a_run_whose_numbers_agree_lacks_nothing() -> None:
    assert what_is_missing(6, NODES, PROGRESS, RECORDED) == []
    assert what_is_missing(0, ["learner"], {}, None) == []


def test_answers_of_an_agent_that_is_no_node_of_the_graph_may_be_missing() -> None:
    progress = PROGRESS | {"world_simulator.pedestrian_answers_missing": 3.0}
    assert what_is_missing(6, NODES, progress, RECORDED) == []


@pytest.mark.parametrize(
    ("changed", "missing"),
    [
        ({"episodes_ended": 2.0}, "2 of 6 episodes ended"),
        ({"world_simulator.vehicle_answers_missing": 113.0}, "113 answers of vehicle_policy are missing"),
        ({"world_simulator.safety_answers_missing": 1.0}, "1 answers of safety_monitor are missing"),
        (
            {"world_simulator.vehicle_answers_contradicted": 4.0},
            "4 answers contradict those of vehicle_policy: somebody else answered, too",
        ),
        (
            {"world_simulator.safety_answers_early": 2.0},
            "2 answers for safety_monitor came before their tick: somebody else published, too",
        ),
        ({"world_simulator.published /clock": 7.0}, "the bag holds 0 of 7 messages on /clock"),
    ],
)
def test_whatever_is_missing_is_said(changed: dict[str, float], missing: str) -> None:
    assert what_is_missing(6, NODES, PROGRESS | changed, RECORDED) == [missing]


def test_messages_that_came_and_were_not_written_are_said() -> None:
    lost = replace(RECORDED, written={"/world/state": 100}, held={"/world/state": 201})
    assert what_is_missing(6, NODES, PROGRESS, lost) == ["the recorder wrote 100 of 201 messages on /world/state"]
