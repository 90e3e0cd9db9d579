import pytest

from vpsci_ros.learning.config import PretrainConfig, RefineConfig
from vpsci_ros.learning.objectives import OBJECTIVES, Objective, find_objective
from vpsci_ros.parameters import table


@pytest.mark.parametrize("name", OBJECTIVES)
def test_each_objective_of_the_table_is_one_object_for_both_stages(name):
    objective = find_objective(name)
    assert objective is find_objective(name)
    assert isinstance(objective, Objective)
    assert objective.acting in ("actor", "target_actor")


@pytest.mark.parametrize(("config", "field"), [(PretrainConfig, "objective"), (RefineConfig, "objective")])
def test_parameters_offer_the_objectives_of_the_table(config, field):
    (row,) = (row for row in table(config) if row.name == field)
    assert all(f"{name}: {what}" in row.description for name, what in OBJECTIVES.items())
