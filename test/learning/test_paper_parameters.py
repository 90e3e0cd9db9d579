"""The two parameter files of the paper's own algorithm give what Table 8 and section 3.2 give."""

import pytest
import torch

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import PretrainConfig, RefineConfig, StartConfig
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.pretrain import WEIGHTS
from vpsci_ros.learning.refine import Refiner
from vpsci_ros.parameters import values_of
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.resources import params_dir
from vpsci_ros.runs.config import RunConfig

TABLE_8 = {
    "replay.capacity": 10000,
    "replay.batch_size": 256,
    "updates.discount": 0.99,
    "updates.target_update_rate": 0.01,
}
NETWORK = {
    "hidden": 256,
    "layers": 2,
    "heads": 8,
    "key_dimension": 32,
    "attention_window": 10,
    "actor_hidden": [64, 64],
    "critic_state": 16,
    "critic_action": 16,
    "critic_hidden": [64, 64],
}
STAGE_1 = {
    "objective": "ddpg",
    "episodes": 3000,
    "ddpg.actor_learning_rate": 1e-4,
    "updates.critic_learning_rate": 2e-4,
    "rewards.speed_scaling": 100.0,
}
SECTION_3_2 = {
    "objective": "ddpg",
    "actors.learning_rate": 5e-5,
    "replay.real_bonus": 0.2,
    "rewards.collision": -200.0,
    "rewards.goal": 100.0,
    "convergence.gradient_tolerance": 1e-4,
    "convergence.episodes": 100,
    "rewards.weights": [],
    "rehearsal.weight": 0.0,
    "actors.head_factor": 1.0,
    "actors.learning_rate_decay": 0.0,
    "refresh.stage_1_share": 0.0,
}


@pytest.mark.parametrize(
    ("name", "kind", "expected"),
    [
        ("paper_stage1.yaml", PretrainConfig, TABLE_8 | STAGE_1),
        ("paper_stage1.yaml", NetworkConfig, NETWORK),
        ("paper_stage2.yaml", RefineConfig, TABLE_8 | SECTION_3_2),
    ],
)
def test_the_papers_files_have_the_papers_values(name, kind, expected):
    values = values_of(load(params_dir() / name).get(kind, "learner"))
    assert {key: values[key] for key in expected} == expected


def test_the_papers_second_stage_begins_with_what_the_papers_first_one_makes():
    """By the commands in the heads of both files."""
    (command,) = [line for line in (params_dir() / "paper_stage1.yaml").read_text().splitlines() if " -o " in line]
    folder = command.split(" -o ")[1].split()[0]
    start = load(params_dir() / "paper_stage2.yaml").get(StartConfig, "learner").weights
    assert start == f"{folder}/{WEIGHTS}"


def test_the_papers_algorithm_refuses_policies_that_draw(near_misses):
    torch.manual_seed(0)
    drawing = Networks(NetworkConfig(hidden=16, heads=2, key_dimension=8, latent=3)).weights({}, {})
    config = load(params_dir() / "paper_stage2.yaml").get(RefineConfig, "learner")
    with pytest.raises(InvalidInput, match="latent = 3: the objective ddpg learns deterministic policies"):
        Refiner(config, drawing, near_misses, seed=4)


def test_the_papers_second_stage_simulates_three_thousand_episodes():
    run = load(params_dir() / "paper_stage2.yaml").get(RunConfig, "world_simulator")
    assert len(run.scenarios) * run.episodes == 3000
