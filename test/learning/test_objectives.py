import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.objectives import find_objective


def test_an_objective_that_nobody_knows_is_refused():
    with pytest.raises(InvalidInput, match="unknown objective 'sac'; expected one of ddpg"):
        find_objective("sac")
