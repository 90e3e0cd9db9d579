"""Why a run is no success: one that ended without an error is complete only if every number agrees."""

from dataclasses import replace
from typing import Any

import pytest

from vpsci_ros.lockstep.counts import WorldCounts
from vpsci_ros.nodes.failures import RecordedCounts, Silence, flood, hangs, incomplete, never_came, stands_still
from vpsci_ros.nodes.node_config import GraphConfig
from vpsci_ros.nodes.status import NodeStatus

NODES = ["world_simulator", "safety_monitor", "vehicle_policy", "recorder"]
WORLD = NodeStatus(published={"/world/state": 201, "/diagnostics": 3}, counts=WorldCounts(episodes_ended=6))
STATUSES = {node: NodeStatus() for node in NODES} | {"world_simulator": WORLD}
RECORDED = RecordedCounts(
    seen={"/world/state": 203, "/diagnostics": 3},
    refused={"/world/state": 2},
    written={"/world/state": 201, "/diagnostics": 3},
    held={"/world/state": 201, "/diagnostics": 3},
)


def with_counts(**counts: int) -> dict[str, NodeStatus]:
    return STATUSES | {"world_simulator": replace(WORLD, counts=WorldCounts(**{"episodes_ended": 6} | counts))}


def holding(**messages: int) -> RecordedCounts:
    """Return the counts of a bag that holds these numbers of messages, all that its recorder saw."""
    held = dict(RECORDED.held) | {f"/{name.replace('_', '/')}": number for name, number in messages.items()}
    return RecordedCounts(held, {}, held, held)


def test_a_run_whose_numbers_agree_lacks_nothing() -> None:
    assert incomplete(6, NODES, STATUSES, RECORDED) == []
    assert incomplete(0, ["learner"], {"learner": NodeStatus()}, None) == []


def test_a_node_that_reported_nothing_is_named() -> None:
    assert incomplete(6, [*NODES, "perception"], STATUSES, RECORDED) == ["perception reported nothing"]


@pytest.mark.parametrize(
    ("counts", "missing"),
    [
        ({"episodes_ended": 2}, "2 of 6 episodes ended"),
        ({"vehicle_answers_missing": 113}, "113 answers of vehicle_policy are missing"),
        ({"safety_answers_missing": 1}, "1 answer of safety_monitor is missing"),
        ({"vehicle_answers_contradicted": 4}, "4 answers differ from the first ones of vehicle_policy to their ticks"),
        ({"safety_answers_early": 2}, "2 answers for safety_monitor came before their tick"),
    ],
)
def test_whatever_is_missing_is_said(counts: dict[str, int], missing: str) -> None:
    assert incomplete(6, NODES, with_counts(**counts), RECORDED) == [missing]


def test_messages_that_came_and_were_not_written_are_said() -> None:
    lost = replace(RECORDED, written=dict(RECORDED.written) | {"/world/state": 100})
    assert incomplete(6, NODES, STATUSES, lost) == ["the recorder wrote 100 of 201 messages on /world/state"]


@pytest.mark.parametrize(
    ("held", "said"),
    [
        ({"world_state": 200}, "the bag holds 200 of 201 messages on /world/state"),
        ({"world_state": 208}, "the bag holds 208 messages on /world/state, the graph's nodes published 201"),
        ({"diagnostics": 9}, ""),  # shared with other graphs and tools
        ({"markers": 1000}, ""),  # on which anybody may draw
    ],
)
def test_a_bag_holds_what_the_graph_published_neither_less_nor_more(held: dict[str, int], said: str) -> None:
    assert incomplete(6, NODES, STATUSES, holding(**held)) == ([said] if said else [])


def test_what_a_killed_node_published_after_its_last_report_is_nobody_elses() -> None:
    statuses = STATUSES | {"vehicle_policy": NodeStatus(published={"/vehicle/action": 97})}
    said = "the bag holds 100 messages on /vehicle/action, the graph's nodes published 97"
    assert incomplete(6, NODES, statuses, holding(vehicle_action=100)) == [said]
    assert incomplete(6, NODES, statuses, holding(vehicle_action=100), ["vehicle_policy"]) == []


@pytest.mark.parametrize(
    ("second", "excused"),
    [
        ("/stranger on /vehicle/action", False),
        ("/left/vehicle_policy on /vehicle/action", False),
        ("/rviz on /markers", True),
        ("/second_ads on /vehicle/cmd_accel", True),
    ],
)
def test_a_second_publisher_fails_the_run_and_is_named(second: str, excused: bool) -> None:
    statuses = STATUSES | {"vehicle_policy": NodeStatus(second_publishers=[second])}
    said = [] if excused else [f"a second publisher: {second}"]
    assert incomplete(6, NODES, statuses, RECORDED) == said


def test_a_run_in_which_nothing_happens_says_what_is_missing_of_whom() -> None:
    waiting = {"world_simulator": NodeStatus(awaited=["pedestrian_policy"]), "recorder": NodeStatus()}
    said = "no progress for 60 s; world_simulator waits for pedestrian_policy; the nodes' logs are in log"
    assert stands_still(61.0, GraphConfig(), "log", waiting) == said


def test_a_node_that_hangs_ends_the_run_that_has_failed_by_it_and_an_agent_that_is_no_node_does_not() -> None:
    said = "20 answers of vehicle_policy are missing: the run has failed (log: log/vehicle_policy.log)"
    assert hangs(NODES, with_counts(vehicle_answers_missing=20), "log") == said
    assert hangs(NODES, with_counts(vehicle_answers_missing=19), "log") == ""
    both = with_counts(safety_answers_missing=20, vehicle_answers_missing=30)
    assert hangs(NODES, both, "log") == said.replace("20", "30")
    assert hangs(NODES, with_counts(pedestrian_answers_missing=20), "log") == ""


def test_a_status_that_travels_through_the_pipe_is_the_same_and_its_odd_figures_are_no_numbers() -> None:
    figures: dict[str, Any] = {"updates": "3.5", "rate": "nan", "loss": "1e999", "name": "[/red]"}
    status = NodeStatus(figures=figures, counts=WorldCounts(goal=3))
    assert [status.number(name) for name in (*figures, "absent")] == [3.5, None, None, None, None]
    assert status.pairs() == figures | {"tick": 0, "goal": 3}


def seen(*pairs: tuple[int, int]) -> str:
    silent = Silence(20)
    return [silent(WorldCounts(tick=tick, vehicle_answers_missing=missing)) for tick, missing in pairs][-1]


def test_an_ads_that_misses_single_ticks_is_not_silent() -> None:
    assert seen((100, 2), (500, 15), (2000, 60)) == ""


def test_an_ads_that_answers_nothing_for_the_limit_is_silent_and_not_before() -> None:
    assert seen((0, 0), (19, 19)) == ""
    assert "no usable command for 20 of the last 20 ticks" in seen((0, 0), (20, 20))
    assert "no usable command for 21 of the last 26 ticks" in seen((900, 3), (912, 12), (926, 24))


def test_silence_says_whether_commands_came_and_were_refused() -> None:
    silent = Silence(20)
    counts = WorldCounts(tick=30, vehicle_answers_missing=30)
    assert silent(counts).endswith("; none came")
    assert silent(replace(counts, vehicle_commands_refused=29)).endswith(
        "; the 29 that came were refused: late, not finite or out of range"
    )
    by_the_wall_clock = replace(counts, vehicle_commands_refused=29, vehicle_commands_ahead=28)
    assert "28 of the 29 that came are stamped ahead of simulated time, as by the wall clock: set use_sim_time" in (
        silent(by_the_wall_clock)
    )


def flooding(limit: int = 100, *, late: bool = False, **counts: int) -> str:
    return flood(WorldCounts(**counts), limit, late=late)


def test_more_surplus_commands_a_tick_than_the_limit_are_a_flood() -> None:
    assert flooding(tick=124, vehicle_commands_surplus=12500) == ""
    assert flooding(tick=124, vehicle_commands_surplus=12501) == (
        "the ADS floods: 12501 commands beyond the first one of a tick in 124 ticks, more than 100 a tick"
    )
    assert flooding(tick=2, vehicle_commands_surplus=2000) == "", "too few to tell"


def test_commands_before_the_first_tick_are_a_flood_only_where_that_never_comes() -> None:
    assert flooding(tick=0, vehicle_commands_early=9000) == ""
    assert flooding(tick=5, vehicle_commands_early=9000, late=True) == ""
    assert "9000 commands before the first tick, which never came" in flooding(
        tick=0, vehicle_commands_early=9000, late=True
    )


def test_a_system_that_never_spoke_is_said_to_have_never_come() -> None:
    assert never_came(WorldCounts(), 61.0, 60.0).startswith("the ADS never published /vehicle/cmd_accel or ")
    for counts in (WorldCounts(tick=1), WorldCounts(vehicle_commands_early=1), WorldCounts(vehicle_commands_refused=1)):
        assert never_came(counts, 61.0, 60.0) == ""
    assert never_came(WorldCounts(), 59.0, 60.0) == ""
    assert never_came(WorldCounts(), 61.0, 60.0, ["safety_monitor"]) == "", "the world waits for another node"
