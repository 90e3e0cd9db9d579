"""Parameters of stage 1 as the shipped weights name them: their names of today."""

from vpsci_ros.learning.config import PretrainConfig
from vpsci_ros.parameters import build
from vpsci_ros.policy.weights import Weights

_GROUPS = {
    "replay": ("batch_size",),
    "updates": ("discount", "target_update_rate", "importance_temperature", "gradient_clip", "critic_learning_rate"),
    "imitation": ("velocity_weight", "rollouts", "rollout_steps", "weight_decay", "dropout", "mirror"),
    "energy_score": ("samples", "texture_weight"),
    "rewards": ("least_speed_deviation", "exploration"),
    "ddpg": ("actor_learning_rate", "critic_head_start"),
}
_NAMES = {name: f"{group}.{name}" for group, names in _GROUPS.items() for name in names} | {
    "buffer_capacity": "replay.capacity",
    "reward_scaling": "rewards.speed_scaling",
    "imitation_learning_rate": "imitation.learning_rate",
    "imitation_head_factor": "imitation.head_factor",
}


def stage_1_of(weights: Weights) -> PretrainConfig:
    """Return the configuration of stage 1 that weights carry; the defaults where they carry none.

    :raises InvalidInput: what they carry is no such configuration.
    """
    values = weights.configuration.get("PretrainConfig", {})
    today = {_NAMES.get(name, name): value for name, value in values.items()}
    return build(PretrainConfig, today, "the weights' configuration of stage 1")
