"""The two parameter files of the paper's own algorithm give what Table 8 and section 3.2 give."""

import pytest

from vpsci_ros import config
from vpsci_ros.learning.config import NetworkConfig, PretrainConfig, RefineConfig
from vpsci_ros.resources import params_dir

TABLE_8 = {"buffer_capacity": 10000, "batch_size": 256, "discount": 0.99, "target_update_rate": 0.01}
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
    "actor_learning_rate": 1e-4,
    "critic_learning_rate": 2e-4,
    "reward_scaling": 100.0,
}
SECTION_3_2 = {
    "online_objective": "ddpg",
    "online_learning_rate": 5e-5,
    "noise_start": 0.3,
    "noise_decay": 0.001,
    "noise_floor": 0.05,
    "real_bonus": 0.2,
    "collision_reward": -200.0,
    "goal_reward": 100.0,
    "gradient_tolerance": 1e-4,
    "converged_episodes": 100,
    "reward_weights": [],
    "rehearsal_weight": 0.0,
    "head_factor": 1.0,
    "learning_rate_decay": 0.0,
    "stage_1_share": 0.0,
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
    values = config.pick(kind, config.load(params_dir() / name)["learner"], "learner")
    assert {key: getattr(values, key) for key in expected} == expected


def test_the_papers_second_stage_simulates_three_thousand_episodes():
    run = config.pick(config.RunConfig, config.load(params_dir() / "paper_stage2.yaml")["world_simulator"], "world")
    assert len(run.scenarios) * run.episodes == 3000
