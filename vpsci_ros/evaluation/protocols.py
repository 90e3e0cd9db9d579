"""The two error protocols, reconstruction and closed loop, batched over interactions.

Both begin at the first critical step (CurvTTC < 5 s) after up to ten observed steps, and use interactions with a second
or more from the first critical step to the last.

- Reconstruction, the paper's: every next velocity is predicted from the *observed* history, up to the last critical
  step. The trajectory is integrated from predicted speeds and compared with the one integrated from recorded speeds.
- Closed loop: both agents run on their own predictions up to the last critical step, at most 3 s, and their positions
  are compared with the recorded ones. If a model's `tracked_steps` is above 0, the vehicle starts with the velocity by
  its last observed positions instead of the published velocity, see `scene.scene_at`.

ADE (30) and FDE (31) are means over both agents. RMSE (29) pools all steps, in the vehicle's heading frame: of the
recorded step in reconstruction, of the predicted step in closed loop.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.predictors import Actions, FadingAcceleration, Predictor
from vpsci_ros.evaluation.roll_out import Seen, roll_out
from vpsci_ros.evaluation.scene import scene_at
from vpsci_ros.world.observation import AGENTS, STEP, arrays_to_heading_frame

OBSERVED = 10  # steps observed before the first predicted one, at most
LONGEST = 30  # steps of closed loop, 3 s
LATE, MEAN = 2, 4  # steps by which a sensor has accelerations late, and of which it has the mean
SHORTEST = 10  # steps from the first critical one to the last, 1 s
QUANTITIES = ("v_veh_long", "v_veh_lat", "v_ped_long", "v_ped_lat", "d_vp_long", "d_vp_lat", "d_pv_long", "d_pv_lat")


@dataclass(frozen=True)
class ProtocolErrors:
    """Errors of one model under one protocol, by interaction.

    ade, fde: float64[N, 2] [m], vehicle and pedestrian; squares, steps: float64[N, 8] and int64[N], summed squared
    errors of `QUANTITIES` and the number of steps summed over.
    """

    ade: NDArray[np.float64]
    fde: NDArray[np.float64]
    squares: NDArray[np.float64]
    steps: NDArray[np.int64]

    def rmse(self) -> dict[str, float]:
        """Return the root mean square error (29) of each of `QUANTITIES` [m/s or m]."""
        values = np.sqrt(self.squares.sum(axis=0) / self.steps.sum())
        return {name: float(value) for name, value in zip(QUANTITIES, values, strict=True)}


Measured = dict[str, ProtocolErrors]
"""Errors by protocol."""


def eligible(interactions: Interactions) -> Interactions:
    """Return the interactions that the protocols use: at least 1 s from the first critical step to the last.

    :raises InvalidInput: there is no such interaction.
    """
    rows = np.flatnonzero(interactions.last - interactions.first >= SHORTEST)
    if rows.size == 0:
        raise InvalidInput(
            f"near misses: expected one that stays below 5 s of CurvTTC for {SHORTEST * STEP:g} s, "
            f"got none among {len(interactions)}"
        )
    return interactions.take(rows)


def reconstruct(model: Predictor, interactions: Interactions) -> ProtocolErrors:
    """Return a model's reconstruction errors: each step is predicted from the recorded history.

    This is our reading of the paper's protocol; the paper's text fits closed loop as well.

    :param interactions: as `eligible` returns them.
    """
    n = len(interactions)
    model.begin(n)
    start = np.maximum(interactions.first - OBSERVED, 0)
    velocity_error = np.zeros((n, interactions.motion.shape[1], 4))
    vehicle, pedestrian = interactions.observation["vehicle"], interactions.observation["pedestrian"]
    rows = np.arange(n)
    for step in range(int((interactions.last - start).max())):
        at = np.minimum(start + step, interactions.last - 1)
        active = start + step < interactions.last
        answers = model.act(vehicle[rows, at], pedestrian[rows, at], interactions.curvttc[rows, at], active)
        done = interactions.action["vehicle"][rows, at], interactions.action["pedestrian"][rows, at]
        model.executed(done, active)
        difference = np.concatenate([a - d for a, d in zip(answers, done, strict=True)], axis=1).astype(np.float64)
        velocity_error[rows[active], at[active]] = difference[active] * STEP
    return _reconstruction_errors(velocity_error, interactions)


def constant_velocity_reconstruction(interactions: Interactions) -> ProtocolErrors:
    """Return the reconstruction errors of a model that keeps the velocity of the first critical step."""
    n, steps, _ = interactions.motion.shape
    rows = np.arange(n)
    motion = interactions.motion
    error = np.zeros((n, steps, 4))
    for columns, out in (((3, 4), (0, 1)), ((7, 8), (2, 3))):
        held = motion[rows, interactions.first][:, None, columns] - np.roll(motion[..., columns], -1, axis=1)
        error[..., out] = arrays_to_heading_frame(motion[..., 2], held)
    return _reconstruction_errors(error, interactions)


def closed_loop(model: Predictor, interactions: Interactions) -> ProtocolErrors:
    """Return a model's closed-loop errors: both agents run on its predictions; `interactions`: see `eligible`."""
    predicted = closed_loop_trajectories(model, interactions)
    n, steps = predicted.shape[:2]
    rows = np.arange(n)[:, None]
    at = np.minimum(interactions.first[:, None] + 1 + np.arange(steps), interactions.length[:, None] - 1)
    truth = interactions.motion[rows, at]
    inside = np.arange(steps) < horizon(interactions)[:, None]
    gap = predicted - truth
    distance = np.stack([np.hypot(gap[..., 0], gap[..., 1]), np.hypot(gap[..., 5], gap[..., 6])], axis=2)
    heading = predicted[..., 2]
    velocity = [arrays_to_heading_frame(heading, gap[..., c : c + 2]) for c in (3, 7)]
    apart = arrays_to_heading_frame(heading, gap[..., 0:2] - gap[..., 5:7])
    return _errors(distance, np.concatenate([*velocity, apart, -apart], axis=2), inside)


def measure(model: Predictor, interactions: Interactions) -> Measured:
    """Return a model's errors by protocol; `interactions` as `eligible` returns them."""
    return {"reconstruction": reconstruct(model, interactions), "closed_loop": closed_loop(model, interactions)}


def continued(interactions: Interactions) -> Measured:
    """Return the errors of `fading_acceleration`: repeated in reconstruction, fading in closed loop."""
    repeated = reconstruct(FadingAcceleration((1.0, 1.0)), interactions)
    return {"reconstruction": repeated, "closed_loop": closed_loop(FadingAcceleration(), interactions)}


def horizon(interactions: Interactions) -> NDArray[np.int64]:
    """Return the number of closed-loop steps, int64[N]: to the last critical step, at most 3 s."""
    return np.minimum(interactions.last - interactions.first, LONGEST)


def known_actions(
    interactions: Interactions, at: NDArray[np.int64], late: bool = False
) -> tuple[dict[str, NDArray[np.float32]], NDArray[np.bool_]]:
    """Return each agent's acceleration known after step `at`, float32[N, 2] [m/s2], and whether it is known, bool[N].

    Recordings are smoothed to both sides in time, so the acceleration of a step shows some tenths of a second of the
    future. `late` gives what a sensor has: the mean of the `MEAN` steps that ended `LATE` steps before.

    :param at: int64[N], steps; below 0 nothing is known.
    """
    rows, ages = np.arange(len(interactions)), range(LATE, LATE + MEAN) if late else range(1)
    count, total = np.zeros(len(interactions)), {agent: np.zeros((len(interactions), 2)) for agent in AGENTS}
    for age in ages:
        there = (at >= age)[:, None]
        count += there[:, 0]
        for agent in AGENTS:
            total[agent] += there * interactions.action[agent][rows, np.maximum(at - age, 0)]
    mean = {agent: (value / np.maximum(count, 1.0)[:, None]).astype(np.float32) for agent, value in total.items()}
    return mean, count > 0.0


@torch.no_grad()
def closed_loop_trajectories(
    model: Predictor,
    interactions: Interactions,
    late: bool = False,
    exchange: Callable[[Seen, Actions], Actions] = lambda _, actions: actions,
) -> NDArray[np.float64]:
    """Return the predicted motion after the first critical step, float64[N, H, 9], rows as in `Interactions.motion`.

    :param late: the model gets the accelerations before that step as a sensor has them, see `known_actions`.
    :param exchange: returns what is executed in place of the model's accelerations, see `simulators.exchange`.
    """
    n = len(interactions)
    model.begin(n)
    rows = np.arange(n)
    for age in range(min(OBSERVED, int(interactions.first.max())), 0, -1):
        at = np.maximum(interactions.first - age, 0)
        active = interactions.first >= age
        seen = interactions.observation["vehicle"][rows, at], interactions.observation["pedestrian"][rows, at]
        model.act(*seen, interactions.curvttc[rows, at], active)
        done, known = known_actions(interactions, interactions.first - age, late)
        model.executed((done["vehicle"], done["pedestrian"]), active & known)
    start = scene_at(torch.from_numpy(interactions.motion), torch.from_numpy(interactions.first), model.tracked_steps)
    ttc, steps = interactions.curvttc[rows, interactions.first], horizon(interactions)

    def act(seen: Seen) -> dict[str, torch.Tensor]:
        active = seen.step < steps
        views = [seen.observation[agent].numpy().astype(np.float32) for agent in AGENTS]
        answers = exchange(seen, model.act(views[0], views[1], seen.curvttc.numpy() if seen.step else ttc, active))
        model.executed(answers, active)
        done = (torch.from_numpy(np.where(active[:, None], answer, 0).astype(np.float64)) for answer in answers)
        return dict(zip(AGENTS, done, strict=True))

    return np.stack([scene.rows().numpy() for scene in roll_out(start, act, [n] * int(steps.max()))], axis=1)


def _reconstruction_errors(velocity_error: NDArray[np.float64], interactions: Interactions) -> ProtocolErrors:
    """Turn errors of v(t+1), float64[N, T, 4], frame of step t, into errors of trajectories integrated from them."""
    steps = np.arange(velocity_error.shape[1])
    inside = (steps >= interactions.first[:, None]) & (steps < interactions.last[:, None])
    velocity_error = np.where(inside[..., None], velocity_error, 0.0)
    heading = interactions.motion[..., 2]
    back = [arrays_to_heading_frame(-heading, velocity_error[..., c : c + 2]) for c in (0, 2)]
    position = [np.cumsum(vectors, axis=1) * STEP for vectors in back]
    distance = np.stack([np.hypot(p[..., 0], p[..., 1]) for p in position], axis=2)
    apart = arrays_to_heading_frame(heading, position[0] - position[1])
    return _errors(distance, np.concatenate([velocity_error, apart, -apart], axis=2), inside)


def _errors(
    distance: NDArray[np.float64], differences: NDArray[np.float64], inside: NDArray[np.bool_]
) -> ProtocolErrors:
    steps = inside.sum(axis=1)
    final = inside.shape[1] - 1 - np.argmax(inside[:, ::-1], axis=1)
    return ProtocolErrors(
        (distance * inside[..., None]).sum(axis=1) / steps[:, None],
        distance[np.arange(len(steps)), final],
        (differences**2 * inside[..., None]).sum(axis=1),
        steps,
    )
