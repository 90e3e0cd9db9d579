"""How far roll-outs are from people: proper scores of positions, velocities and of the texture of accelerations.

The energy score of K roll-outs is their mean distance to what happened less half their mean distance to each other. It
is proper: nothing scores better in expectation than the true distribution ('Strictly proper scoring rules, prediction,
and estimation' by Gneiting and Raftery 2007, https://doi.org/10.1198/016214506000001437). The energy distance is the
same between two sets: roll-outs of many moments on the one side, recordings of many moments on the other.

Camera noise and gait are no behaviour, and roll-outs have neither. Velocities and accelerations are therefore taken of
positions averaged over 0.9 s, and what the average takes away from recordings of other moments is added to the
roll-outs (`with_residual`), as the classifier of `vpsci realism` does.
"""

from functools import cache

import numpy as np
import torch
from torch import Tensor

from vpsci_ros.world.observation import STEP

REACH = 4  # steps on either side that are averaged
_SMALL = 1e-6  # [m2] under the root of distances, whose gradient would be infinite at zero
_STANDING = 0.2  # [m/s] below it an agent's direction is the vehicle's
_SLOW = 1e-3  # [m2/s2] under the root of speeds


@cache
def smoothing(steps: int) -> Tensor:
    """Return the matrix float32[steps + 1, steps + 1] that averages positions over nine steps.

    Beyond its ends a track goes on as its mirror image in the end point.
    """
    size = steps + 1
    matrix = np.zeros((size, size))
    for row in range(size):
        for at in range(row - REACH, row + REACH + 1):
            end = min(max(at, 0), size - 1)
            if at != end:
                matrix[row, end] += 2.0
                matrix[row, 2 * end - at] -= 1.0
            else:
                matrix[row, at] += 1.0
    return torch.from_numpy((matrix / (2 * REACH + 1)).astype(np.float32))


@cache
def _velocity(steps: int) -> Tensor:
    """Return the matrix [steps, steps + 1] from positions to velocities [m/s]."""
    eye = torch.eye(steps + 1)
    return (eye[1:] - eye[:-1]) / STEP


def velocities(track: Tensor) -> Tensor:
    """Return [..., T, 2] [m/s] of positions [..., T + 1, 2] [m]."""
    return torch.einsum("ij,...jc->...ic", _velocity(track.shape[-2] - 1), track)


def smoothed(track: Tensor) -> Tensor:
    """Return positions [..., T + 1, 2] averaged over 0.9 s."""
    return torch.einsum("ij,...jc->...ic", smoothing(track.shape[-2] - 1), track)


def with_residual(track: Tensor, direction: Tensor, other: Tensor, other_direction: Tensor) -> Tensor:
    """Return positions [M, T + 1, 2] smoothed, each with what smoothing takes away from another's.

    :param direction, other_direction: of motion at the first step, [M] [rad]; residuals turn with it.
    """
    residual = other - smoothed(other)
    turn = direction - other_direction
    c, s = torch.cos(turn)[:, None], torch.sin(turn)[:, None]
    x, y = residual.unbind(dim=-1)
    return smoothed(track) + torch.stack([c * x - s * y, s * x + c * y], dim=-1)


def direction(velocity: Tensor, heading: Tensor) -> Tensor:
    """Return the direction [M] [rad] of velocities [M, 2] [m/s], or the vehicle's heading [M] where somebody stands."""
    return torch.where(velocity.norm(dim=1) < _STANDING, heading, torch.atan2(velocity[:, 1], velocity[:, 0]))


def energy_score(sampled: Tensor, happened: Tensor) -> Tensor:
    """Return the energy score, a scalar with gradient: of each step for itself, then the mean.

    :param sampled: [M, K, T, 2], K roll-outs of each of M moments, two or more; happened: [M, T, 2].
    """
    first, second = torch.triu_indices(sampled.shape[1], sampled.shape[1], 1)
    apart = _length(sampled[:, first] - sampled[:, second]).mean()
    return _length(sampled - happened[:, None]).mean() - 0.5 * apart


def energy_distance(one: Tensor, other: Tensor) -> Tensor:
    """Return the energy distance of two sets of vectors [n, f] and [m, f], but for what the second alone decides."""
    count, unit = len(one), one.shape[1] ** 0.5
    among = torch.cdist(one, one).sum() / (count * (count - 1))
    return (2.0 * torch.cdist(one, other).mean() - among) / unit


def texture(track: Tensor) -> list[Tensor]:
    """Return what makes the motion of one agent look like a person's, blocks [M, f] of smoothed tracks [M, T + 1, 2].

    Accelerations along and across the way, in order of time and of size, and how fast they change; speeds. Sorted by
    size they show whether somebody does a little all the time or, as people, nothing and then something.
    """
    velocity = velocities(track)
    change = (velocity[:, 1:] - velocity[:, :-1]) / STEP
    speed = torch.sqrt((velocity * velocity).sum(dim=-1) + _SLOW)
    ahead = (velocity / speed[..., None])[:, 1:]
    along = (change * ahead).sum(dim=-1)
    across = (ahead[..., 0] * change[..., 1] - ahead[..., 1] * change[..., 0]).abs()
    turning = ahead[..., 0] * change[..., 1] - ahead[..., 1] * change[..., 0]
    changes = [3.0 * part.diff(dim=1).abs() for part in (along, turning)]
    by_size = [part.sort(dim=1).values for part in (along, across, *changes)]
    return [*by_size, along, across, along.abs(), (speed - speed[:, :1])[:, 3::3]]


def texture_distance(sampled: Tensor, happened: Tensor) -> Tensor:
    """Return the energy distances of two sets of smoothed tracks, [n, T + 1, 2] and [m, T + 1, 2], block by block."""
    parts = zip(texture(sampled), texture(happened), strict=True)
    return torch.stack([energy_distance(one, other) for one, other in parts]).sum()


def _length(vectors: Tensor) -> Tensor:
    return torch.sqrt((vectors * vectors).sum(dim=-1) + _SMALL)
