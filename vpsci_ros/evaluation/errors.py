"""The columns of Table 9 for any models, by both error protocols, with confidence intervals."""

import contextlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.interactions import Interactions, from_table
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.onsets import find_onsets
from vpsci_ros.evaluation.predictors import TRACKED_STEPS, FadingAcceleration, Predictor, RepeatVelocity, predictor_of
from vpsci_ros.evaluation.protocols import (
    Measured,
    ProtocolErrors,
    closed_loop,
    constant_velocity_reconstruction,
    continued,
    eligible,
    measure,
)
from vpsci_ros.evaluation.roll_out_scores import energy_score
from vpsci_ros.evaluation.roll_out_scores import errors as roll_out_errors
from vpsci_ros.evaluation.simulators import policy, residual_sampler, rolled_out
from vpsci_ros.evaluation.statistics import cluster_counts, interval, units_of
from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.policy_file import Policy
from vpsci_ros.policy.weights import Weights

FADING, SAMPLER = "fading_acceleration", "residual_sampler"
CONTROLS = ("repeat_velocity", "constant_velocity", "constant_velocity_tracked", FADING)

Share = tuple[float, list[float]]  # and its interval


def evaluate(near_misses: pl.DataFrame, models: Mapping[str, Policy | Predictor], seed: int = 0) -> dict[str, Any]:
    """Return the errors of models and controls on near misses, in the layout of `vpsci evaluate --json`.

    {"interactions": N, "clips": C, "units": "118 clips", "models": {NAME: {"reconstruction": ERRORS, "closed_loop":
    ERRORS}}}, where `units` is what intervals resample, see `statistics.units_of`, and ERRORS
    holds `ade`, `fde` [m], `rmse` by quantity [m/s, m], `ade_vehicle` and `ade_pedestrian` [m], the 95% intervals
    `ade_interval` and `fde_interval` [m], and `ade_ratio` with `ade_ratio_interval`: the ADE as a share of
    `repeat_velocity`'s.

    In closed loop the first two controls are equal: both keep the last recorded velocity. In reconstruction
    `repeat_velocity` takes the recorded velocity of every step, and the others keep that of the first critical step.
    `constant_velocity_tracked` starts its closed loop as a bank does, from the vehicle's velocity by its last observed
    positions (`scene.scene_at`): published speeds may lag behind, and this control shows how much of a bank's gain is
    due to that. Networks start from the recorded velocity. `fading_acceleration` is the fair control: both agents' last
    accelerations continue and fade in closed loop, and are repeated in reconstruction.

    Each model and the whole result have `fixed_3s`, too, where tracks have 3 s after their onset: see that function.

    :param models: name -> a policy, or any `Predictor`.
    :raises InvalidInput: no interaction of a second or more, or a model has a control's name.
    """
    for name in (*CONTROLS, SAMPLER):
        if name in models:
            raise InvalidInput(f"models: {name} is the name of a control; call the model something else")
    interactions = eligible(from_table(near_misses))
    predictors: dict[str, Predictor] = {
        name: predictor_of(model, interactions.clip, seed) if isinstance(model, (Bank, Weights)) else model
        for name, model in models.items()
    }
    result = compare({name: measure(model, interactions) for name, model in predictors.items()}, interactions, seed)
    controls: dict[str, Predictor] = {
        name: RepeatVelocity(TRACKED_STEPS if name.endswith("tracked") else 0) for name in CONTROLS
    }
    of = fixed_3s(near_misses, dict(models) | controls | {FADING: FadingAcceleration()}, seed)
    for name, own in of.pop("models").items():
        result["models"].setdefault(name, {})["fixed_3s"] = own
    return result | {"fixed_3s": of}


def fixed_3s(near_misses: pl.DataFrame, models: Mapping[str, Policy | Predictor], seed: int) -> dict[str, Any]:
    """Return models' errors and energy scores [m] over the 3 s after each onset, including steps not critical.

    {"interactions": N, "clips": C, "units": .., "models": {NAME: {"roll_outs": K, "ade": m, "fde": m,
    "energy_score": m, "energy_score_interval": [m, m], "of_constant_velocity": share of the tracked control's energy
    score, "of_constant_velocity_interval": [.., ..], "ade_of_fading_acceleration": share of that control's ADE}}}.
    `residual_sampler` is added, with residuals of other clips about the fading acceleration, where there are other
    clips. N is 0, without models, where no track has 3 s after its onset.
    """
    try:
        onsets = find_onsets(near_misses)
    except InvalidInput:
        return {"interactions": 0, "clips": 0, "units": "", "models": {}}
    positions = {
        name: policy(model, seed)(onsets) if isinstance(model, (Bank, Weights)) else rolled_out(model, onsets)
        for name, model in models.items()
    }
    middle = positions[FADING]
    with contextlib.suppress(InvalidInput):  # of one vehicle alone
        positions[SAMPLER] = residual_sampler(onsets, onsets, middle, middle)
    scores = {name: energy_score(own, onsets.recorded) for name, own in positions.items()}
    ades = {name: roll_out_errors(own, onsets.recorded).mean(axis=1) for name, own in positions.items()}
    units, control = onsets.units, scores["constant_velocity_tracked"]
    draws = cluster_counts(units.labels, seed)
    return {
        "interactions": len(onsets),
        "clips": len(set(onsets.clip)),
        "units": units.text,
        "models": {
            name: {
                "roll_outs": positions[name].shape[1],
                "ade": float(ades[name].mean()),
                "fde": float(roll_out_errors(positions[name][..., -1:, :], onsets.recorded[..., -1:, :]).mean()),
                "energy_score": float(own.mean()),
                "energy_score_interval": list(interval(draws @ own / draws.sum(axis=1))),
                "of_constant_velocity": float(own.mean() / control.mean()),
                "of_constant_velocity_interval": list(interval((draws @ own) / (draws @ control))),
                "ade_of_fading_acceleration": float(ades[name].mean() / ades[FADING].mean()),
            }
            for name, own in scores.items()
        },
    }


def compare(errors: Mapping[str, Measured], interactions: Interactions, seed: int) -> dict[str, Any]:
    """Return measured errors with those of the controls on the same interactions, in the layout of `evaluate`."""
    errors = dict(errors) | {"repeat_velocity": measure(RepeatVelocity(), interactions)}
    held = constant_velocity_reconstruction(interactions)
    loop = errors["repeat_velocity"]["closed_loop"]
    errors["constant_velocity"] = {"reconstruction": held, "closed_loop": loop}
    loop = closed_loop(RepeatVelocity(TRACKED_STEPS), interactions)
    errors["constant_velocity_tracked"] = {"reconstruction": held, "closed_loop": loop}
    errors[FADING] = continued(interactions)
    units = units_of(interactions.clip, interactions.group)
    draws = cluster_counts(units.labels, seed)
    control = errors["repeat_velocity"]
    return {
        "interactions": len(interactions),
        "clips": len(set(interactions.clip)),
        "units": units.text,
        "models": {
            name: {protocol: _summary(result[protocol], control[protocol], draws) for protocol in result}
            for name, result in errors.items()
        },
    }


def _summary(errors: ProtocolErrors, control: ProtocolErrors, draws: NDArray[np.float64]) -> dict[str, Any]:
    ade, fde = errors.ade.mean(axis=1), errors.fde.mean(axis=1)
    size = draws.sum(axis=1)
    ratio, ratio_interval = ade_share(errors, control, draws)
    return {
        "ade": float(ade.mean()),
        "fde": float(fde.mean()),
        "rmse": errors.rmse(),
        "ade_vehicle": float(errors.ade[:, 0].mean()),
        "ade_pedestrian": float(errors.ade[:, 1].mean()),
        "ade_interval": list(interval(draws @ ade / size)),
        "fde_interval": list(interval(draws @ fde / size)),
        "ade_ratio": ratio,
        "ade_ratio_interval": ratio_interval,
    }


def ade_share(errors: ProtocolErrors, reference: ProtocolErrors, draws: NDArray[np.float64]) -> Share:
    """Return a model's ADE as a share of the reference's on the same interactions, with its 95% interval.

    :param draws: float64[R, N], see `statistics.cluster_counts`.
    """
    ade, theirs = errors.ade.mean(axis=1), reference.ade.mean(axis=1)
    return float(ade.mean() / theirs.mean()), list(interval((draws @ ade) / (draws @ theirs)))
