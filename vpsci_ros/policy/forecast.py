"""A forecast: what both agents do on average in the 3 s after a situation, by a small network.

The network has learned the roll-outs of stage 1's actors (`vpsci_ros.learning.forecast`). A bank's reactions are
replayed about it (`vpsci_ros.policy.choice`). Its sums, in float64, have one order, so that their bits are the same in
every process and batch.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.compiled import kernel

STEPS = 30  # of 0.1 s
ACTIONS = 4  # of a step: the vehicle's [m/s2] and curvature [1/m], the pedestrian's forward and left [m/s2]
SITUATION = 9  # numbers of a situation, see `vpsci_ros.policy.bank.situations_of`

Floats = NDArray[np.float64]


class Networks(NamedTuple):
    """N networks with two hidden layers of H rectified linear units; N = 0: no forecast.

    The first is for situations that are not recorded. Each of the others has not seen one part of the recordings.

    :ivar entry, entry_bias: float64[N, 9, H], [N, H], from a situation.
    :ivar inner, inner_bias: float64[N, H, H], [N, H].
    :ivar exit, exit_bias: float64[N, H, 120], [N, 120], to the actions of 30 steps.
    """

    entry: Floats
    entry_bias: Floats
    inner: Floats
    inner_bias: Floats
    exit: Floats
    exit_bias: Floats


class CrossFitted(NamedTuple):
    """Networks, and which of them has not seen a clip: its number by the clip's name, "source/clip"."""

    networks: Networks
    unseen_by: dict[str, int]


def no_networks() -> Networks:
    """Return the networks of a bank without a forecast: none."""
    return Networks(*(np.zeros((0, *shape)) for shape in shapes(0)))


def shapes(width: int) -> tuple[tuple[int, ...], ...]:
    """Return the shapes of one network's arrays, in the order of `Networks`, with `width` hidden units."""
    out = STEPS * ACTIONS
    return (SITUATION, width), (width,), (width, width), (width,), (width, out), (out,)


def forecasts(networks: Networks, numbers: NDArray[np.int64], situations: Floats) -> Floats:
    """Return the actions after each situation, float64[n, 9] -> float64[n, 30, 4]; float64[n, 0, 4] by no networks.

    :param numbers: int64[n], the network for each situation.
    """
    count, width = networks.entry_bias.shape
    out, hidden = np.zeros((len(situations), STEPS if count else 0, ACTIONS)), np.zeros((2, width))
    if count:
        _forecasts(networks, numbers, np.ascontiguousarray(situations), hidden, out)
    return out


@kernel
def _forecasts(networks, numbers, situations, hidden, out):  # type: ignore[no-untyped-def]
    for i in range(len(situations)):
        forecast(networks, numbers[i], situations[i], hidden, out[i])


@kernel
def forecast(networks, number, situation, hidden, out):  # type: ignore[no-untyped-def]
    """Write the actions after one situation, float64[9], to `out`, float[30, 4]; an unknown acceleration counts as 0.

    :param hidden: float64[2, H], working memory.
    """
    first, second = hidden[0], hidden[1]
    for j in range(first.size):
        first[j], second[j] = networks.entry_bias[number, j], networks.inner_bias[number, j]
    for i in range(situation.size):
        if not math.isnan(situation[i]):
            for j in range(first.size):
                first[j] += situation[i] * networks.entry[number, i, j]
    for i in range(first.size):
        if first[i] > 0.0:
            for j in range(second.size):
                second[j] += first[i] * networks.inner[number, i, j]
    for k in range(STEPS):
        for j in range(ACTIONS):
            total = networks.exit_bias[number, ACTIONS * k + j]
            for i in range(second.size):
                if second[i] > 0.0:
                    total += second[i] * networks.exit[number, i, ACTIONS * k + j]
            out[k, j] = total
