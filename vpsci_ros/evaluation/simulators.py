"""Simulators that continue recorded onsets: policies, the rule-based pair, constant velocity."""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray

from vpsci_ros.evaluation.onsets import STEPS, Onsets, borrowable
from vpsci_ros.evaluation.predictors import (
    TRACKED_STEPS,
    FadingAcceleration,
    PeoplePredictor,
    PolicyPredictor,
    Predictor,
    RepeatVelocity,
    sources_for,
)
from vpsci_ros.evaluation.protocols import closed_loop_trajectories, known_actions
from vpsci_ros.evaluation.scene import scene_at
from vpsci_ros.policy.bank import SLOWEST, Bank, describe, situations_of
from vpsci_ros.policy.onset_range import beyond, onsets_in
from vpsci_ros.policy.policy_file import Policy
from vpsci_ros.safety import PEDESTRIAN_RADIUS
from vpsci_ros.world import WorldConfig
from vpsci_ros.world.drivers.autopilot import too_near
from vpsci_ros.world.drivers.social_force import social_force
from vpsci_ros.world.kinematics import MAX_DECELERATION, SHARPEST_TURN
from vpsci_ros.world.observation import STEP, arrays_to_heading_frame, observe_arrays

Floats = NDArray[np.float64]
Simulator = Callable[[Onsets], Floats]
"""Onsets -> positions float64[n, K, 2, 30, 2] [m]."""

ROLL_OUTS = 32  # of stochastic policies; deterministic ones have one
DONORS = 32  # onsets of other clips whose residuals are borrowed
_TURNED, _CAME = 5, 0.25  # steps over which a turn is measured, and the least way [m] for it
_STRAIGHT_AHEAD = 0.25  # [m] beside the footprints in which the autopilot brakes, as in the world


def rolled_out(model: Predictor, onsets: Onsets) -> Floats:
    """Return the positions of both agents under a model, float64[n, 1, 2, 30, 2] [m]."""
    motion = closed_loop_trajectories(model, onsets.interactions, onsets.late)
    return np.stack([motion[..., 0:2], motion[..., 5:7]], axis=1)[:, None]


def tracked(onsets: Onsets) -> Floats:
    """Return positions, float64[n, 1, 2, 30, 2] [m], at constant velocity, the vehicle's by its last positions."""
    return rolled_out(RepeatVelocity(TRACKED_STEPS), onsets)


def fading(onsets: Onsets) -> Floats:
    """Return positions, float64[n, 1, 2, 30, 2] [m], while the last accelerations continue and fade."""
    return rolled_out(FadingAcceleration(), onsets)


def residual_sampler(onsets: Onsets, library: Onsets, middle: Floats, library_middle: Floats) -> Floats:
    """Return roll-outs [n, K, 2, 30, 2] [m]: `middle` plus residuals of the K most similar onsets of other clips.

    A residual is the recording less its own middle trajectory: the vehicle's forward and left of its heading, the
    pedestrian's in the same frame. Onsets are compared by the features of a bank's situations. The donors are
    `onsets.borrowable`. K is 32, or as many as there are.

    :param middle: float64[n, 1, 2, 30, 2] [m], a control's roll-outs from `onsets`, say `fading`.
    :param library_middle: float64[L, 1, 2, 30, 2] [m], that control's roll-outs from `library`.
    """
    (here, side), (there, other_side) = describe(_situations(onsets)), describe(_situations(library))
    deviation = there.std(axis=0) + 1e-9
    apart = np.linalg.norm((here[:, None] - there[None]) / deviation, axis=2)
    apart[~borrowable(onsets, library)] = np.inf
    count = min(DONORS, int(np.isfinite(apart).sum(axis=1).min()))
    nearest = np.argsort(apart, axis=1, kind="stable")[:, :count]
    there_heading = library.start[:, 2, None, None]
    residual = arrays_to_heading_frame(there_heading, library.recorded - library_middle[:, 0])[nearest]
    residual[..., 1] *= (side[:, None] * other_side[nearest])[:, :, None, None]  # mirrored where the sides differ
    result: Floats = middle + arrays_to_heading_frame(-onsets.start[:, 2, None, None, None], residual)
    return result


def _situations(onsets: Onsets) -> Floats:
    """Return the bank's situations at the onsets, float64[n, 7]; without a step before, accelerations are 0."""
    seen, _ = observe_arrays(*onsets.start.T)
    done, _ = known_actions(onsets.interactions, onsets.interactions.first - 1, onsets.late)
    forward, left = done["vehicle"].astype(np.float64).T
    return situations_of(seen, forward, left / np.maximum(seen[:, 0], SLOWEST))


def policy(own: Policy, seed: int, roll_outs: int = ROLL_OUTS, people: str = "") -> Simulator:
    """Return a policy as a simulator: `roll_outs` roll-outs an onset by a bank, one by (deterministic) networks.

    :param people: source in a bank whose reactions are replayed, see `PeoplePredictor`.
    """

    def simulate(onsets: Onsets) -> Floats:
        if not isinstance(own, Bank):
            return rolled_out(PolicyPredictor(own), onsets)
        again = onsets.take(np.repeat(np.arange(len(onsets)), roll_outs))
        predictor = PeoplePredictor(own, again.clip, seed, people)
        return rolled_out(predictor, again).reshape(len(onsets), roll_outs, 2, STEPS, 2)

    return simulate


def beyond_range(bank: Bank, onsets: Onsets, people: str = "") -> tuple[NDArray[np.str_], NDArray[np.bool_]]:
    """Return the bank's source for each onset, str[n], and whether the onset is beyond that source's range, bool[n]."""
    sources, start = sources_for(bank, onsets.clip, people), onsets.start
    where, out = onsets_in(start[:, :2], start[:, 3:5], start[:, 5:7], start[:, 7:9]), np.zeros(len(onsets), np.bool_)
    for name in np.unique(sources):
        own = sources == name
        out[own] = beyond(where[own], bank.of(str(name)).reach)
    return sources, out


def rule_based(onsets: Onsets, *, reacting: bool = True, turning: bool = False) -> Floats:
    """Return positions, float64[n, 1, 2, 30, 2] [m], of a social force pedestrian and the autopilot without a lane.

    The pedestrian wants the velocity of the onset. The vehicle keeps its direction and tracked speed, and brakes fully
    for a pedestrian near and straight ahead of its front.

    :param reacting: False: the pedestrian keeps its velocity, as CARLA's walkers do.
    :param turning: the vehicle goes on turning as it did over the last 0.5 s, by at most 90 degrees.
    """
    scene = scene_at(
        torch.from_numpy(onsets.interactions.motion), torch.from_numpy(onsets.interactions.first), TRACKED_STEPS
    )
    velocity = scene.vehicle_velocity.numpy()
    bend = _curvatures(onsets) if turning else np.zeros(len(onsets))
    config, out = WorldConfig(), np.zeros((len(onsets), 2, STEPS, 2))
    for i, (start, size) in enumerate(zip(onsets.start, onsets.size, strict=True)):
        x, y, px, py, vx, vy = (float(start[k]) for k in (0, 1, 5, 6, 7, 8))
        wanted, half_length, half_width = (vx, vy), 0.5 * float(size[0]), 0.5 * float(size[1])
        speed = float(np.hypot(*velocity[i]))
        heading = float(np.arctan2(velocity[i, 1], velocity[i, 0])) if speed > 0.1 else float(start[2])
        c, s = np.cos(heading), np.sin(heading)
        straight = heading
        reach = half_width + PEDESTRIAN_RADIUS + _STRAIGHT_AHEAD
        for step in range(STEPS):
            if bend[i]:
                c, s = np.cos(heading), np.sin(heading)
            forward, left = c * (px - x) + s * (py - y), c * (py - y) - s * (px - x)
            braking = too_near(forward, left, half_length, reach, config.proximity_distance)
            ax, ay = social_force(
                *wanted, vx, vy, px, py, x, y, heading, half_length, half_width, PEDESTRIAN_RADIUS
            ) if reacting else (0.0, 0.0)  # fmt: skip
            after = max(0.0, speed - MAX_DECELERATION * STEP) if braking else speed
            if bend[i]:
                turned = heading - straight + bend[i] * 0.5 * (speed + after) * STEP
                before, heading = heading, straight + float(np.clip(turned, -0.5 * np.pi, 0.5 * np.pi))
                c, s = np.cos(0.5 * (before + heading)), np.sin(0.5 * (before + heading))
            x, y = x + 0.5 * (speed + after) * STEP * c, y + 0.5 * (speed + after) * STEP * s
            px, py = px + (vx + 0.5 * ax * STEP) * STEP, py + (vy + 0.5 * ay * STEP) * STEP
            speed, vx, vy = after, vx + ax * STEP, vy + ay * STEP
            out[i, :, step] = (x, y), (px, py)
    return out[:, None]


def _curvatures(onsets: Onsets) -> Floats:
    """Return the curvature of each vehicle's path over the 0.5 s before the onset, float64[n] [1/m]."""
    rows, now = np.arange(len(onsets)), onsets.interactions.first
    motion, before = onsets.interactions.motion, np.maximum(now - _TURNED, 0)
    turn = motion[rows, now, 2] - motion[rows, before, 2]
    way = np.hypot(*(motion[rows, now, 0:2] - motion[rows, before, 0:2]).T)
    return np.clip(np.where(way > _CAME, turn / np.maximum(way, _CAME), 0.0), -SHARPEST_TURN, SHARPEST_TURN)
