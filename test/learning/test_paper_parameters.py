"""The two parameter files of the paper's own algorithm give what Table 8 and section 3.2 give."""

import numpy as np
import pytest
import torch

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import PretrainConfig, RefineConfig, StartConfig
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.pretrain import WEIGHTS
from vpsci_ros.learning.refine import Refiner
from vpsci_ros.parameters import values_of
from vpsci_ros.policy.config import NetworkConfig, PolicyConfig
from vpsci_ros.policy.exploration import amplitude
from vpsci_ros.resources import params_dir
from vpsci_ros.runs.config import RunConfig
from vpsci_ros.world import WorldConfig
from vpsci_ros.world.lockstep import LockStepConfig
from vpsci_ros.world.observation import AGENTS

TABLE_8 = {
    "replay.capacity": 10000,
    "replay.batch_size": 256,
    "updates.critic_learning_rate": 2e-4,
    "updates.discount": 0.99,
    "updates.target_update_rate": 0.01,
    "rewards.speed_scaling": 100.0,
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
    "risk_input": False,  # observations (6) and (7)
    "latent": 0,
    "residuals": False,
}
EQUATIONS = {  # what neither stage adds to (5), and one unit of values for both
    "objective": "ddpg",
    "updates.importance_limit": 0.0,
    "updates.value_unit": 100.0,
    "updates.importance_temperature": 1000.0,
}
STAGE_1 = {
    "episodes": 3000,
    "ddpg.actor_learning_rate": 1e-4,
    "ddpg.critic_head_start": 0,
    "rewards.least_speed_deviation": 0.001,
}
SECTION_3_2 = {
    "actors.learning_rate": 5e-5,
    "replay.real_bonus": 0.2,
    "rewards.collision": -200.0,
    "rewards.goal": 100.0,
    "convergence.gradient_tolerance": 1e-4,
    "convergence.episodes": 100,
    "rewards.weights": [],
    "updates.steps_per_update": 0,
    "ddpg.critic_warm_up": 0,
    "rehearsal.weight": 0.0,
    "actors.head_factor": 1.0,
    "actors.learning_rate_decay": 0.0,
    "refresh.stage_1_share": 0.0,
    "refresh.rollback_margin": 1e9,
}
WORLD = {
    "tick": 0.05,
    "episode_time": 10.0,
    "spawn": "paper",
    "release_time": 0.0,
    "lane_following": False,
    "pedestrian_gain": 0.5,
}


@pytest.mark.parametrize(
    ("name", "kind", "section", "expected"),
    [
        ("paper_stage1.yaml", PretrainConfig, "learner", TABLE_8 | EQUATIONS | STAGE_1),
        ("paper_stage1.yaml", NetworkConfig, "learner", NETWORK),
        ("paper_stage2.yaml", RefineConfig, "learner", TABLE_8 | EQUATIONS | SECTION_3_2),
        ("paper_stage2.yaml", WorldConfig, "world_simulator", WORLD),
        ("paper_stage2.yaml", LockStepConfig, "world_simulator", {"credit_outcome": True}),
    ],
)
def test_the_papers_files_have_the_papers_values(name, kind, section, expected):
    values = values_of(load(params_dir() / name).get(kind, section))
    assert {key: values[key] for key in expected} == expected


@pytest.mark.parametrize("agent", AGENTS)
def test_the_papers_policies_explore_by_the_numbers_of_equation_16(agent):
    """0.3 exp(-0.001 t) + 0.05 m/s2, t the training episode; number 125 in each of eight scenarios is the 1,000th."""
    config = load(params_dir() / "paper_stage2.yaml").get(PolicyConfig, f"{agent}_policy")
    limit = NetworkConfig().action_limit
    assert limit * amplitude([0, 125], config.noise) == pytest.approx([0.35, 0.3 * np.exp(-1.0) + 0.05])
    assert config.explore


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
