"""Parameters that have other names in the metadata of the shipped weights and bags: old to new."""

from collections.abc import Mapping
from typing import Any

_BOTH = {"batch_size": "replay.batch_size", "buffer_capacity": "replay.capacity"} | {
    name: f"updates.{name}" for name in ("discount", "target_update_rate", "importance_temperature", "gradient_clip")
}
_IMITATION = ("velocity_weight", "rollouts", "rollout_steps", "weight_decay", "dropout", "mirror")
POLICY = {f"noise_{part}": f"noise.{part}" for part in ("start", "decay", "floor")}
PRETRAIN = (
    _BOTH
    | {name: f"imitation.{name}" for name in _IMITATION}
    | {
        "critic_learning_rate": "updates.critic_learning_rate",
        "samples": "energy_score.samples",
        "texture_weight": "energy_score.texture_weight",
        "reward_scaling": "rewards.speed_scaling",
        "least_speed_deviation": "rewards.least_speed_deviation",
        "exploration": "rewards.exploration",
        "actor_learning_rate": "ddpg.actor_learning_rate",
        "critic_head_start": "ddpg.critic_head_start",
        "imitation_learning_rate": "imitation.learning_rate",
        "imitation_head_factor": "imitation.head_factor",
    }
)

def renamed(values: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """Return recorded parameters by the names of today."""
    return {names.get(name, name): value for name, value in values.items()}
