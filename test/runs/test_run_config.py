"""Which episodes a run has: the first ones of each scenario, or those that are named."""

import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.run_config import RunConfig


def test_scenarios_take_turns():
    run = RunConfig(scenarios=[1, 8], episodes=2, first_episode=5)
    assert list(run.queue()) == [(1, 5), (8, 5), (1, 6), (8, 6)]
    assert run.total == 4


def test_episodes_that_are_named_are_all_there_is():
    run = RunConfig(scenarios=[1, 8], episodes=2, only=[8, 3, 1, 17, 8, 40])
    assert list(run.queue()) == [(8, 3), (1, 17), (8, 40)]
    assert run.total == 3


@pytest.mark.parametrize(
    ("only", "said"),
    [
        ([1], "a scenario and a number for each episode, got 1 values"),
        ([2, 0], "only names scenario 2, but scenarios are"),
        ([1, 4, 1, 4], "got episode 4 of scenario 1 after 4"),
        ([1, 4, 8, 0, 1, 3], "got episode 3 of scenario 1 after 4"),
    ],
)
def test_names_that_are_none_or_come_twice_are_refused(only, said):
    with pytest.raises(InvalidInput, match=said):
        RunConfig(scenarios=[1, 8], only=only)
