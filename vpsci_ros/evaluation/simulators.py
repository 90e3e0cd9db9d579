"""Simulators that continue recorded onsets: policies, constant velocity, a sampler of residuals."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.evaluation.onsets import STEPS, Onsets, borrowable
from vpsci_ros.evaluation.predictors import (
    TRACKED_STEPS,
    FadingAcceleration,
    PeoplePredictor,
    PolicyPredictor,
    Predictor,
    RepeatVelocity,
)
from vpsci_ros.evaluation.protocols import LATE, MEAN, closed_loop_trajectories, known_actions
from vpsci_ros.evaluation.roll_out import Seen
from vpsci_ros.policy.bank import SLOWEST, Bank, describe, situations_of
from vpsci_ros.policy.policy_file import Policy
from vpsci_ros.world.kinematics import SHARPEST_TURN
from vpsci_ros.world.observation import AGENTS, STEP, arrays_to_heading_frame, observe_arrays

Floats = NDArray[np.float64]
Simulator = Callable[[Onsets], Floats]
"""Onsets -> positions float64[n, K, 2, 30, 2] [m]; one that reacts to the other agent follows `Onsets.other`."""

_Pair = tuple[NDArray[Any], NDArray[Any]]  # accelerations of vehicle and pedestrian, float[n, 2] [m/s2]

ROLL_OUTS = 32  # of stochastic policies; deterministic ones have one
DONORS = 32  # onsets of other clips whose residuals are borrowed
_TURNED, _CAME = 5, 0.25  # steps over which a turn is measured, and the least way [m] for it


def rolled_out(model: Predictor, onsets: Onsets) -> Floats:
    """Return the positions of both agents under a model, float64[n, 1, 2, 30, 2] [m]."""
    return positions_of(closed_loop_trajectories(model, onsets.interactions, onsets.late, exchange(onsets)))


def exchange(onsets: Onsets) -> Callable[[Seen, _Pair], _Pair]:
    """Return a function of a roll-out's step and actions that exchanges those of the agent in `onsets.other`."""
    if onsets.other is None:
        return lambda _, actions: actions
    (agent, wanted), bend = onsets.other, curvatures(onsets)
    rows, first = np.arange(len(onsets)), onsets.interactions.first
    recorded = onsets.interactions.action[agent].astype(np.float64)

    def exchanged(seen: Seen, actions: _Pair) -> _Pair:
        if wanted is None:
            turned = seen.scene.heading.numpy() - onsets.interactions.motion[rows, first + seen.step, 2]
            own = arrays_to_heading_frame(turned, recorded[rows, first + seen.step])
        else:
            velocity = seen.observation[agent].numpy()[:, :2]
            speed = np.hypot(velocity[:, 0], velocity[:, 1])
            turned = bend * speed * STEP if agent == AGENTS[0] else np.arctan2(velocity[:, 1], velocity[:, 0])
            later = np.maximum(speed + wanted * STEP, 0.0)[:, None]
            own = (later * np.stack([np.cos(turned), np.sin(turned)], axis=1) - velocity) / STEP
        own = own.astype(np.float32)
        return (own, actions[1]) if agent == AGENTS[0] else (actions[0], own)

    return exchanged


def positions_of(motion: Floats) -> Floats:
    """Return the positions in rows of `Interactions.motion`, float64[n, 30, 9] -> float64[n, 1, 2, 30, 2] [m]."""
    return np.stack([motion[..., 0:2], motion[..., 5:7]], axis=1)[:, None]


def tracked(onsets: Onsets) -> Floats:
    """Return positions, float64[n, 1, 2, 30, 2] [m], at constant velocity, the vehicle's by its last positions."""
    return rolled_out(RepeatVelocity(TRACKED_STEPS), onsets)


def fading(onsets: Onsets) -> Floats:
    """Return positions, float64[n, 1, 2, 30, 2] [m], while the last accelerations continue and fade."""
    return rolled_out(FadingAcceleration(), onsets)


def residual_sampler(
    onsets: Onsets, library: Onsets, middle: Floats, library_middle: Floats, count: int = DONORS
) -> Floats:
    """Return roll-outs [n, K, 2, 30, 2] [m]: `middle` plus residuals of the K most similar onsets of other clips.

    A residual is the recording less its own middle trajectory: the vehicle's forward and left of its heading, the
    pedestrian's in the same frame. K is `count`, or as many as there are, see `donors`.

    :param middle: float64[n, 1, 2, 30, 2] [m], a control's roll-outs from `onsets`, say `fading`.
    :param library_middle: float64[L, 1, 2, 30, 2] [m], that control's roll-outs from `library`.
    """
    nearest = donors(onsets, library, count)
    side, other_side = features_at(onsets)[1], features_at(library)[1]
    there_heading = library.start[:, 2, None, None]
    residual = arrays_to_heading_frame(there_heading, library.recorded - library_middle[:, 0])[nearest]
    residual[..., 1] *= (side[:, None] * other_side[nearest])[:, :, None, None]  # mirrored where the sides differ
    result: Floats = middle + arrays_to_heading_frame(-onsets.start[:, 2, None, None, None], residual)
    return result


def donors(onsets: Onsets, library: Onsets, count: int = DONORS) -> NDArray[np.int64]:
    """Return the rows of the K onsets in `library` most similar to each onset, int64[n, K], the most similar first.

    Onsets are compared by `features_at`, and only with those of `onsets.borrowable`. K is `count`, or as many as there
    are for each.
    """
    here, there = features_at(onsets)[0], features_at(library)[0]
    apart = np.linalg.norm((here[:, None] - there[None]) / (there.std(axis=0) + 1e-9), axis=2)
    apart[~borrowable(onsets, library)] = np.inf
    least = min(count, int(np.isfinite(apart).sum(axis=1).min()))
    return np.argsort(apart, axis=1, kind="stable")[:, :least]


def features_at(onsets: Onsets) -> tuple[Floats, Floats]:
    """Return a bank's features at the onsets, float64[n, 8], and the pedestrians' sides, float64[n].

    Accelerations are 0 without a step before the onset.
    """
    seen, _ = observe_arrays(*onsets.start.T)
    done, known = known_actions(onsets.interactions, onsets.interactions.first - 1, onsets.late)
    return describe(situations_of(seen, *(np.where(known[:, None], done[agent], np.nan) for agent in AGENTS)))


def policy(own: Policy, seed: int, roll_outs: int = ROLL_OUTS, people: str = "") -> Simulator:
    """Return a policy as a simulator: `roll_outs` roll-outs an onset by a bank, one by (deterministic) networks.

    :param people: source in a bank whose reactions are replayed, see `PeoplePredictor`.
    """

    def simulate(onsets: Onsets) -> Floats:
        if not isinstance(own, Bank):
            return rolled_out(PolicyPredictor(own), onsets)
        again = onsets.take(np.repeat(np.arange(len(onsets)), roll_outs))
        acting = [agent for agent in AGENTS if onsets.other is None or agent != onsets.other.agent]
        predictor = PeoplePredictor(known_late(own) if onsets.late else own, again.clip, seed, people, acting)
        return rolled_out(predictor, again).reshape(len(onsets), roll_outs, 2, STEPS, 2)

    return simulate


def known_late(bank: Bank) -> Bank:
    """Return a bank whose accelerations before its situations are those of a sensor, see `protocols.known_actions`."""
    made = {}
    for name, own in bank.reactions.items():
        ends = np.unique(own.end)
        track = np.concatenate([[0], ends])[np.searchsorted(ends, own.begin, side="right")]  # its first step
        at = own.begin[:, None] - 1 - LATE - np.arange(MEAN)
        there = at >= track[:, None]
        total = (own.steps[np.maximum(at, 0)] * there[..., None]).sum(axis=1)
        known = there.sum(axis=1)
        before = np.where(known[:, None] > 0, total / np.maximum(known, 1)[:, None], np.nan)
        features = own.features.copy()
        turn = before[:, 1] * np.maximum(features[0] * own.scale[0], SLOWEST) * own.side
        features[6:8] = np.nan_to_num([before[:, 0], turn]) / own.scale[6:8, None]
        made[name] = own._replace(features=features, before=before)
    return Bank(made, bank.facts)


def curvatures(onsets: Onsets) -> Floats:
    """Return the curvature of each vehicle's path over the 0.5 s before the onset, float64[n] [1/m]."""
    rows, now = np.arange(len(onsets)), onsets.interactions.first
    motion, before = onsets.interactions.motion, np.maximum(now - _TURNED, 0)
    turn = motion[rows, now, 2] - motion[rows, before, 2]
    way = np.hypot(*(motion[rows, now, 0:2] - motion[rows, before, 0:2]).T)
    return np.clip(np.where(way > _CAME, turn / np.maximum(way, _CAME), 0.0), -SHARPEST_TURN, SHARPEST_TURN)
