"""One step of an SST layer with its derivative written out.

Roll-outs take thousands of steps of small matrices, where what counts is the number of operations: autograd records
some forty a step, and goes back through as many. Here they are one, and the gradient is the same to rounding. The
matrices that a step multiplies by are put together once a roll-out (`StepWeights`).
"""

from itertools import pairwise
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.nn import functional


class StepWeights(NamedTuple):
    """What the steps of a layer of width d with `heads` heads multiply by.

    :ivar decay: float32[d], a of (3); driving: float32[d, d], B of (3) with its factor.
    :ivar spread: float32[3 d, d], one above the other: queries over the root of a key's length, keys, and C of (3).
    :ivar attended: float32[d, d], W_o; passed: float32[d], 1 + D of (3).
    :ivar gain, bias: float32[d], of the normalisation.
    """

    decay: Tensor
    driving: Tensor
    spread: Tensor
    attended: Tensor
    passed: Tensor
    gain: Tensor
    bias: Tensor


class Stepped(NamedTuple):
    """What comes of a step, float32[B, d] each: the layer's output, its state h, and the key of h."""

    out: Tensor
    h: Tensor
    key: Tensor


def sst_step(weights: StepWeights, x: Tensor, h: Tensor, gates: Tensor, past: list[Tensor]) -> Stepped:
    """Return the step with input `x` after state `h`, float32[B, d].

    :param gates: float32[B, W, heads], added to the logits of the last W steps, this one included, oldest first.
    :param past: keys of the last W - 1 steps, then their states, float32[B, d] each.
    """
    return Stepped(*_Step.apply(x, h, gates, *weights, *past))  # type: ignore[no-untyped-call]


class _Step(torch.autograd.Function):
    """See `sst_step`."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, h_before: Tensor, gates: Tensor, *rest: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        weights, past = StepWeights(*rest[:7]), rest[7:]
        width, heads = x.shape[1], gates.shape[2]
        h = torch.addcmul(functional.linear(x, weights.driving), weights.decay, h_before)
        query, key, read = functional.linear(h, weights.spread).split(width, dim=1)
        earlier = len(past) // 2
        keys = torch.stack([*past[:earlier], key], dim=1).unflatten(2, (heads, -1))  # B, W, heads, key
        values = torch.stack([*past[earlier:], h], dim=1).unflatten(2, (heads, -1))
        query = query.unflatten(1, (1, heads, -1))
        # Products and sums rather than a batched matrix product, which is three times slower for one query.
        shares = torch.softmax((query * keys).sum(dim=3).add_(gates), dim=1)
        context = (shares[..., None] * values).sum(dim=1).flatten(1)
        mixed = torch.addcmul(read, x, weights.passed).addmm_(context, weights.attended.T)
        out, mean, scale = torch.native_layer_norm(mixed, (width,), weights.gain, weights.bias, 1e-5)
        ctx.save_for_backward(x, h_before, h, query, keys, values, shares, context, mixed, mean, scale, *weights)
        return out, h, key.contiguous()

    @staticmethod
    def backward(ctx: Any, d_out: Tensor, d_h: Tensor, d_key: Tensor) -> tuple[Tensor, ...]:
        x, h_before, h, query, keys, values, shares, context, mixed, mean, scale, *rest = ctx.saved_tensors
        weights, width = StepWeights(*rest), x.shape[1]
        d_mixed, d_gain, d_bias = torch.ops.aten.native_layer_norm_backward(
            d_out, mixed, (width,), mean, scale, weights.gain, weights.bias, [True, True, True]
        )
        d_context = (d_mixed @ weights.attended).view_as(query)
        d_shares = (d_context * values).sum(dim=3)
        d_logits = torch.ops.aten._softmax_backward_data(d_shares, shares, 1, shares.dtype)
        d_values = (shares[..., None] * d_context).flatten(2)
        d_keys = (d_logits[..., None] * query).flatten(2)
        d_query = (d_logits[..., None] * keys).sum(dim=1).flatten(1)
        d_spread = torch.cat([d_query, d_keys[:, -1] + d_key, d_mixed], dim=1)
        d_h = torch.addmm(d_h + d_values[:, -1], d_spread, weights.spread)
        d_x = torch.addmm(d_mixed * weights.passed, d_h, weights.driving)
        d_weights = StepWeights(
            decay=(d_h * h_before).sum(dim=0),
            driving=d_h.T @ x,
            spread=d_spread.T @ h,
            attended=d_mixed.T @ context,
            passed=(d_mixed * x).sum(dim=0),
            gain=d_gain,
            bias=d_bias,
        )
        past = *d_keys[:, :-1].unbind(dim=1), *d_values[:, :-1].unbind(dim=1)
        return d_x, d_h * weights.decay, d_logits, *d_weights, *past


def recurrence(driven: Tensor, decay: Tensor) -> Tensor:
    """Return h_t = a h_{t-1} + driven_t of (3) with h_{-1} = 0, for float32[B, T, d] and a, float32[d]."""
    h: Tensor = _Recurrence.apply(driven, decay)  # type: ignore[no-untyped-call]
    return h


class _Recurrence(torch.autograd.Function):
    """See `recurrence`. A step after the other in place, which for whole histories is faster than any tree of sums."""

    @staticmethod
    def forward(ctx: Any, driven: Tensor, decay: Tensor) -> Tensor:
        h = driven.clone()
        steps = h.unbind(dim=1)
        for before, now in pairwise(steps):
            now.addcmul_(before, decay)
        ctx.save_for_backward(h, decay)
        return h

    @staticmethod
    def backward(ctx: Any, d_h: Tensor) -> tuple[Tensor, Tensor]:
        h, decay = ctx.saved_tensors
        d_driven = d_h.clone()
        steps = d_driven.unbind(dim=1)
        for after, now in pairwise(steps[::-1]):
            now.addcmul_(after, decay)
        return d_driven, (d_driven[:, 1:] * h[:, :-1]).sum(dim=(0, 1))
