import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.objectives import Objective, find_objective


@pytest.mark.parametrize("name", ["ddpg", "single_agent_ddpg"])
def test_each_objective_is_one_object_for_both_stages(name):
    assert find_objective(name) is find_objective(name)
    assert isinstance(find_objective(name), Objective)


def test_an_objective_that_nobody_knows_is_refused():
    with pytest.raises(InvalidInput, match="unknown objective 'sac'; expected one of ddpg"):
        find_objective("sac")
