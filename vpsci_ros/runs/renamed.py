"""Parameters that had other names once: one table, old to new, for messages and for reading old records."""

from collections.abc import Mapping
from typing import Any

_BOTH = {"batch_size": "replay.batch_size", "buffer_capacity": "replay.capacity"} | {
    name: f"updates.{name}" for name in ("discount", "target_update_rate", "importance_temperature", "gradient_clip")
}
_IMITATION = ("velocity_weight", "rollouts", "rollout_steps", "weight_decay", "dropout", "mirror")
_FORESIGHT = (
    "clearance_margin",
    "clearance_ahead",
    "pace_weights",
    "braking_share",
    "insisting_shares",
)
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
REFINE = _BOTH | {name: f"foresight.{name}" for name in _FORESIGHT} | {
    "online_objective": "objective",
    "online_learning_rate": "actors.learning_rate",
    "learning_rate_decay": "actors.learning_rate_decay",
    "head_factor": "actors.head_factor",
    "online_critic_learning_rate": "updates.critic_learning_rate",
    "value_unit": "updates.value_unit",
    "steps_per_update": "updates.steps_per_update",
    "warm_up_steps": "updates.warm_up_steps",
    "priority_exponent": "replay.priority_exponent",
    "real_bonus": "replay.real_bonus",
    "real_capacity": "replay.real_share",
    "collision_reward": "rewards.collision",
    "goal_reward": "rewards.goal",
    "reward_weights": "rewards.weights",
    "weight_temperature": "rewards.weight_temperature",
    "online_reward_scaling": "rewards.speed_scaling",
    "real_exploration": "rewards.exploration",
    "foresight_rollouts": "foresight.rollouts",
    "foresight_steps": "foresight.steps",
    "foresight_scale": "foresight.scale",
    "haste_weight": "foresight.speeding_weight",
    "foresight.haste_weight": "foresight.speeding_weight",
    "critic_warm_up": "ddpg.critic_warm_up",
    "rehearsal_weight": "rehearsal.weight",
    "rehearsal_rollouts": "rehearsal.rollouts",
    "updates_per_refresh": "refresh.updates",
    "rollback_margin": "refresh.rollback_margin",
    "stage_1_share": "refresh.stage_1_share",
    "refine_held_out_fraction": "refresh.held_out_fraction",
    "gradient_tolerance": "convergence.gradient_tolerance",
    "converged_episodes": "convergence.episodes",
}  # fmt: skip


def renamed(values: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """Return recorded parameters by the names of today."""
    return {names.get(name, name): value for name, value in values.items()}
