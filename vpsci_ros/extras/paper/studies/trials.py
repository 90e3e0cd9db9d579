"""Tuning of the step sizes (learning rates) for each row of Table 9, on a part of its training clips."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl

from vpsci_ros.data.interactions import from_table
from vpsci_ros.evaluation.predictors import PolicyPredictor
from vpsci_ros.evaluation.protocols import eligible, measure
from vpsci_ros.extras.paper.studies.folds import folds_by_clip
from vpsci_ros.extras.paper.studies.networks import train
from vpsci_ros.learning.training_config import PretrainConfig
from vpsci_ros.policy.policy_config import NetworkConfig

PARTS, SHARE = 4, 3  # one of so many parts of the training clips is held back, and a trial has 1/3 of the updates


def with_steps(config: PretrainConfig, factor: float) -> PretrainConfig:
    """Return the configuration with the learning rates of actors and critics multiplied by `factor`."""
    updates = config.updates
    actors, critics = factor * updates.actor_learning_rate, factor * updates.critic_learning_rate
    return replace(config, updates=replace(updates, actor_learning_rate=actors, critic_learning_rate=critics))


def try_steps(
    name: str,
    training: pl.DataFrame,
    config: PretrainConfig,
    network: NetworkConfig,
    seed: int,
    factors: Sequence[float],
    check: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Return the best of `factors` on the step sizes, as `factor`, and the error of each, as `ade`.

    Each learns on three quarters of the clips of `training` in a third of the updates, and is measured by its ADE in
    closed loop [m] on the last quarter; the least is chosen, never a NaN.

    :param check: called after every update.
    :raises InvalidInput: fewer than four clips, or the last quarter has no interaction of a second.
    :raises ValueError: every factor's ADE is NaN.
    """
    learned, kept = folds_by_clip(training, PARTS, seed)[0]
    held_out = eligible(from_table(kept))
    config = replace(config, episodes=max(1, config.episodes // SHARE))
    interactions = from_table(learned)
    errors: list[float] = []
    for factor in factors:
        networks = train(name, interactions, with_steps(config, factor), network, seed, lambda _: check())
        weights = networks.weights({}, {})
        errors.append(float(measure(PolicyPredictor(weights), held_out)["closed_loop"].ade.mean()))
    best = int(np.nanargmin(errors))
    return {"factor": factors[best], "ade": {f"{f:g}": error for f, error in zip(factors, errors, strict=True)}}
