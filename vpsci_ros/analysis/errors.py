"""Table 9's columns for any models, under the two honest protocols of DESIGN.md, with confidence intervals."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import NetworkConfig
from vpsci_ros.learning.interactions import Interactions, from_table
from vpsci_ros.learning.predictors import PolicyPredictor, Predictor, RepeatVelocity
from vpsci_ros.learning.protocols import (
    ProtocolErrors,
    closed_loop,
    constant_velocity_reconstruction,
    eligible,
    reconstruct,
)
from vpsci_ros.learning.weights import Weights

RESAMPLES = 2000
LEVEL = 0.95
CONTROLS = ("repeat_velocity", "constant_velocity", "constant_velocity_tracked")
TRACKED_STEPS = NetworkConfig().tracked_steps


Measured = dict[str, ProtocolErrors]  # by protocol
Share = tuple[float, list[float]]  # and its interval


def evaluate(near_misses: pl.DataFrame, models: Mapping[str, Weights | Predictor], seed: int = 0) -> dict[str, Any]:
    """Measure models and controls on near misses, in the layout of `vpsci evaluate --json`.

    {"interactions": N, "clips": C, "models": {NAME: {"reconstruction": ERRORS, "closed_loop": ERRORS}}}, where ERRORS
    holds `ade`, `fde` [m], `rmse` by quantity [m/s, m], `ade_vehicle` and `ade_pedestrian` [m], the 95% intervals
    `ade_interval` and `fde_interval` [m], and `ade_ratio` with `ade_ratio_interval`: the ADE as a share of
    `repeat_velocity`'s. Intervals resample whole clips, since interactions of one clip share agents.

    In closed loop the first two controls are the same: the last recorded velocity, kept. In reconstruction
    `repeat_velocity` looks again at every step, and the others keep the velocity of the first critical step.
    `constant_velocity_tracked` starts its closed loop as the policies do, from the vehicle's velocity by its last
    observed positions (`scene.scene_at`): published speeds may lag behind, and this control tells how much of a
    policy's gain is due to that.

    :param models: name -> weights of both agents, or any `Predictor`.
    :raises InvalidInput: no interaction of a second or more, or a model has a control's name.
    """
    for name in CONTROLS:
        if name in models:
            raise InvalidInput(f"models: {name} is the name of a control; call the model something else")
    interactions = eligible(from_table(near_misses))
    predictors: dict[str, Predictor] = {
        name: PolicyPredictor(model) if isinstance(model, Weights) else model for name, model in models.items()
    }
    return compare({name: measure(model, interactions) for name, model in predictors.items()}, interactions, seed)


def measure(model: Predictor, interactions: Interactions) -> Measured:
    """Return a model's errors by protocol; `interactions` as `eligible` returns them."""
    return {"reconstruction": reconstruct(model, interactions), "closed_loop": closed_loop(model, interactions)}


def compare(errors: Mapping[str, Measured], interactions: Interactions, seed: int) -> dict[str, Any]:
    """Add the controls to measured errors of the same interactions; return the layout of `evaluate`."""
    errors = dict(errors) | {"repeat_velocity": measure(RepeatVelocity(), interactions)}
    held = constant_velocity_reconstruction(interactions)
    loop = errors["repeat_velocity"]["closed_loop"]
    errors["constant_velocity"] = {"reconstruction": held, "closed_loop": loop}
    loop = closed_loop(RepeatVelocity(TRACKED_STEPS), interactions)
    errors["constant_velocity_tracked"] = {"reconstruction": held, "closed_loop": loop}
    draws = _clip_draws(interactions.clip, seed)
    control = errors["repeat_velocity"]
    return {
        "interactions": len(interactions),
        "clips": len(set(interactions.clip)),
        "models": {
            name: {protocol: _summary(result[protocol], control[protocol], draws) for protocol in result}
            for name, result in errors.items()
        },
    }


def share_of(errors: ProtocolErrors, reference: ProtocolErrors, clips: NDArray[np.object_], seed: int) -> Share:
    """Return a model's ADE as a share of another's on the same interactions, with its 95% interval by clips.

    :param clips: object[N], the clip of each interaction.
    """
    return _share(errors, reference, _clip_draws(clips, seed))


def _clip_draws(clips: NDArray[np.object_], seed: int) -> NDArray[np.float64]:
    """Return how often each interaction occurs in each bootstrap resample of whole clips, float64[RESAMPLES, N]."""
    names, owner = np.unique(clips.astype(str), return_inverse=True)
    rng = np.random.default_rng(seed)
    counts = rng.multinomial(len(names), np.full(len(names), 1.0 / len(names)), size=RESAMPLES)
    return counts[:, owner].astype(np.float64)


def _summary(errors: ProtocolErrors, control: ProtocolErrors, draws: NDArray[np.float64]) -> dict[str, Any]:
    ade, fde = errors.ade.mean(axis=1), errors.fde.mean(axis=1)
    size = draws.sum(axis=1)
    ratio, ratio_interval = _share(errors, control, draws)
    return {
        "ade": float(ade.mean()),
        "fde": float(fde.mean()),
        "rmse": errors.rmse(),
        "ade_vehicle": float(errors.ade[:, 0].mean()),
        "ade_pedestrian": float(errors.ade[:, 1].mean()),
        "ade_interval": _interval(draws @ ade / size),
        "fde_interval": _interval(draws @ fde / size),
        "ade_ratio": ratio,
        "ade_ratio_interval": ratio_interval,
    }


def _share(errors: ProtocolErrors, reference: ProtocolErrors, draws: NDArray[np.float64]) -> Share:
    ade, theirs = errors.ade.mean(axis=1), reference.ade.mean(axis=1)
    return float(ade.mean() / theirs.mean()), _interval((draws @ ade) / (draws @ theirs))


def _interval(samples: NDArray[np.float64]) -> list[float]:
    low, high = np.quantile(samples, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
    return [float(low), float(high)]
