"""One streamed step of an SST actor in numba, written so that a row's bits depend on nothing but that row.

Every output of a matrix product has one accumulator, and adds its products in the order of k by fused multiply-add
(IEEE 754: one rounding). Sums along a row run in sixteen fixed lanes. The exponential is a polynomial in the same fused
operations. So the result is the same for every batch size, row position and thread, and on every processor that follows
IEEE 754.

Library matrix products do not have this property: they choose kernels, and so the order of additions, by shape.
"""

import math

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.safety.compiled import kernel

ir = cgutils.ir  # of llvmlite, which numba brings
LANES = 16  # in which sums along a row run
NORM_EPSILON = np.float32(1e-5)
NORMALISED_LIMIT = np.float32(6.0)  # as in `vpsci_ros.policy.sst`
_ONE, _CRITICAL_TTC = np.float32(1.0), np.float32(CRITICAL_TTC)
_FAR = np.float32(-80.0)
_LOG2_E, _LN2_HIGH, _LN2_LOW = np.float32(1.4426950408889634), np.float32(0.693359375), np.float32(-2.12194440e-4)


@intrinsic
def fma(typing_context, a, b, c):  # type: ignore[no-untyped-def]
    """Return a * b + c with one rounding, float32."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.fma(*arguments)

    return types.float32(types.float32, types.float32, types.float32), generate


@intrinsic
def _power_of_two(typing_context, n):  # type: ignore[no-untyped-def]
    """Return 2**n as float32, for whole n from -126 to 127."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        exponent = builder.add(builder.trunc(arguments[0], ir.IntType(32)), ir.Constant(ir.IntType(32), 127))
        return builder.bitcast(builder.shl(exponent, ir.Constant(ir.IntType(32), 23)), ir.FloatType())

    return types.float32(types.int64), generate


@kernel
def accumulate(x, w, out, rows):  # type: ignore[no-untyped-def]
    """Add x[:rows] @ w to out[:rows]: x float32[R, K], w float32[K, N], out float32[R, N]."""
    depth = w.shape[0]
    whole = depth - depth % 4
    for i in range(rows):
        row = out[i]
        for k in range(0, whole, 4):  # four products at a time, one after the other in each accumulator
            a, b, c, d = x[i, k], x[i, k + 1], x[i, k + 2], x[i, k + 3]
            for j in range(w.shape[1]):
                row[j] = fma(d, w[k + 3, j], fma(c, w[k + 2, j], fma(b, w[k + 1, j], fma(a, w[k, j], row[j]))))
        for k in range(whole, depth):
            for j in range(w.shape[1]):
                row[j] = fma(x[i, k], w[k, j], row[j])


@kernel
def _copy(row, out):  # type: ignore[no-untyped-def]
    """Copy a row; numba's own assignment takes seconds to compile, for the error text of shapes that differ."""
    for j in range(out.shape[0]):
        out[j] = row[j]


@kernel
def exponential(x):  # type: ignore[no-untyped-def]
    """Return exp(x) for x <= 0, float32, to 2 units in the last place; 0 below -80 (Cephes' expf)."""
    within = max(x, _FAR)
    n = np.floor(fma(within, _LOG2_E, np.float32(0.5)))
    r = fma(-n, _LN2_LOW, fma(-n, _LN2_HIGH, within))
    p = fma(np.float32(1.9875691500e-4), r, np.float32(1.3981999507e-3))
    p = fma(p, r, np.float32(8.3334519073e-3))
    p = fma(p, r, np.float32(4.1665795894e-2))
    p = fma(p, r, np.float32(1.6666665459e-1))
    p = fma(p, r, np.float32(5.0000001201e-1))
    scale = _power_of_two(int(n))
    return fma(fma(p, r * r, r), scale, scale) if x >= _FAR else np.float32(0.0)


@kernel
def _normalise(x, rows, gain, offset):  # type: ignore[no-untyped-def]
    """Apply LayerNorm to x[:rows], float32[R, width], in place."""
    width, lanes = np.float32(x.shape[1]), np.empty(LANES, np.float32)
    for i in range(rows):
        mean = _lane_sum(x[i], np.float32(0.0), False, lanes) / width
        inverse = _ONE / np.sqrt(_lane_sum(x[i], mean, True, lanes) / width + NORM_EPSILON)
        for j in range(x.shape[1]):
            x[i, j] = fma((x[i, j] - mean) * inverse, gain[j], offset[j])


@kernel
def _lane_sum(row, mean, squared, lanes):  # type: ignore[no-untyped-def]
    """Return the sum over a row of its differences from `mean`, or of their squares, by sixteen partial sums."""
    whole = row.size - row.size % LANES
    lanes[:] = np.float32(0.0)
    for start in range(0, whole, LANES):
        for lane in range(LANES):
            d = row[start + lane] - mean
            lanes[lane] = fma(d, d, lanes[lane]) if squared else lanes[lane] + d
    for j in range(whole, row.size):
        d = row[j] - mean
        lanes[0] = fma(d, d, lanes[0]) if squared else lanes[0] + d
    total = np.float32(0.0)
    for lane in range(LANES):
        total += lanes[lane]
    return total


@kernel
def _compare(queries, i, keys, slot, layer, risks, gain, scale, filled, logits):  # type: ignore[no-untyped-def]
    """Compare row `i` of queries, float32[R, hidden], with `filled` remembered steps, head by head; see `step_slots`.

    :param keys: float32[slot, L, hidden, window]; risks: float32[slot, window].
    :param gain: float32[L, heads]; logits: float32[R, heads, window], zeros; gets them less the greatest of the head.
    """
    heads, steps = logits.shape[1], logits.shape[2]
    depth = queries.shape[1] // heads
    for h in range(heads):
        for d in range(h * depth, (h + 1) * depth):
            for s in range(steps):
                logits[i, h, s] = fma(queries[i, d], keys[slot, layer, d, s], logits[i, h, s])
    for h in range(heads):
        top = np.float32(-np.inf)
        for s in range(filled):
            logits[i, h, s] = fma(gain[layer, h], risks[slot, s], logits[i, h, s] * scale)
            top = max(top, logits[i, h, s])
        for s in range(filled):
            logits[i, h, s] -= top


@kernel
def _recall(shares, values, i, slot, layer, filled, context):  # type: ignore[no-untyped-def]
    """Write the mean of the values of `filled` steps, weighted by the shares of row `i`, to context[i].

    :param shares: float32[R, heads, window], of any sum, get the sum 1 for each head.
    :param values: float32[slot, L, window, hidden]; context: float32[R, hidden].
    """
    heads = shares.shape[1]
    depth = context.shape[1] // heads
    for j in range(context.shape[1]):
        context[i, j] = np.float32(0.0)
    for h in range(heads):
        total = np.float32(0.0)
        for s in range(filled):
            total += shares[i, h, s]
        for s in range(filled):
            shares[i, h, s] /= total
        for s in range(filled):
            for d in range(h * depth, (h + 1) * depth):
                context[i, d] = fma(shares[i, h, s], values[slot, layer, s, d], context[i, d])


@kernel
def take_in(rows, observation, curvttc, reset, scaling, action, states, counts, inputs, risks):  # type: ignore[no-untyped-def]
    """Clear the histories of those `rows` that are reset, and write the network's inputs for a step of each row.

    :param rows: int64[n]; observation: float32[B, 6]; curvttc: float64[B] [s]; reset: bool[B]; scaling: mean and scale
        of observations, float32[6] each; action: float32[B, 2], the last one [m/s2].
    :param inputs: float32[n, I], normalised observation and action before.
    :param risks: float32[n].
    :returns: the first of `rows` with an observation or CurvTTC that is not a number, and nothing is written; else -1.
    """
    mean, scale = scaling
    size = mean.size
    for i in rows:
        known = not math.isnan(curvttc[i])
        for k in range(size):
            known &= math.isfinite(observation[i, k])
        if not known:
            return i
    for n in range(rows.size):
        i = rows[n]
        if reset[i]:
            counts[i] = 0
            for layer in range(states.shape[1]):
                for k in range(states.shape[2]):
                    states[i, layer, k] = 0.0
        for k in range(size):
            inputs[n, k] = min(max((observation[i, k] - mean[k]) / scale[k], -NORMALISED_LIMIT), NORMALISED_LIMIT)
        inputs[n, size], inputs[n, size + 1] = action[i, 0], action[i, 1]
        risk = _ONE - np.float32(curvttc[i]) / _CRITICAL_TTC
        risks[n] = min(max(risk, np.float32(0.0)), _ONE)
    return -1


@kernel
def step_slots(  # type: ignore[no-untyped-def]
    slots,
    inputs,
    risks,
    entry,
    layers,
    head,
    fading,
    limit,
    states,
    keys,
    values,
    seen,
    counts,
    window,
    work,
    action,
    out,
):
    """Advance `slots.size` rows by one step, in blocks of the size of `work`, so that a block stays in the cache.

    :param slots: int64[n], which histories; inputs: float32[n, I], normalised observation and action before; risks:
        float32[n].
    :param entry: (w [I, hidden], b [hidden]); layers: (decay, skip, gain, norm weight, norm bias: [L, ...], then the
        dense input, query, key, attended, readout: [L, hidden, hidden], inputs first); head: three (w, b).
    :param fading: share of the action before that is added; limit: of the sum [m/s2].
    :param states: float32[slot, L, hidden]; keys: float32[slot, L, hidden, window]; values: float32[slot, L, window,
        hidden]; seen: float32[slot, window], risks; counts: int64[slot], steps taken; all move on by one step.
    :param work: float32[6, R, hidden] scratch; action, out: float32[slot, 2], both get the clipped actions [m/s2].
    """
    size, width = work.shape[1], states.shape[2]
    decay, skip, gain, norm_w, norm_b, w_in, w_query, w_key, w_attended, w_readout = layers
    x, h, q, k, context, mixed = work[0], work[1], work[2], work[3], work[4], work[5]
    heads = gain.shape[1]
    shares = np.zeros((size, heads, keys.shape[3]), np.float32)
    scale = np.float32(1.0) / np.sqrt(np.float32(width // heads))
    w1, b1, w2, b2, w3, b3 = head
    first, second = np.empty((size, b1.size), np.float32), np.empty((size, b2.size), np.float32)
    answer = np.empty((size, b3.size), np.float32)
    for begin in range(0, slots.size, size):
        own = slots[begin : begin + size]
        n = own.size
        for i in range(n):
            _copy(entry[1], x[i])
            seen[own[i], counts[own[i]] % window] = risks[begin + i]
        accumulate(inputs[begin : begin + n], entry[0], x, n)
        for layer in range(decay.shape[0]):
            for i in range(n):
                state = states[own[i], layer]
                for j in range(width):
                    h[i, j] = decay[layer, j] * state[j]
                    q[i, j] = k[i, j] = np.float32(0.0)
            accumulate(x, w_in[layer], h, n)
            accumulate(h, w_query[layer], q, n)
            accumulate(h, w_key[layer], k, n)
            for i in range(n):
                slot = own[i]
                place = counts[slot] % window
                _copy(h[i], states[slot, layer])
                _copy(h[i], values[slot, layer, place])
                for j in range(width):
                    keys[slot, layer, j, place] = k[i, j]
            shares[:n] = np.float32(0.0)
            for i in range(n):
                slot = own[i]
                _compare(q, i, keys, slot, layer, seen, gain, scale, min(counts[slot] + 1, window), shares)
            flat = shares[:n].reshape(n * heads * keys.shape[3])
            for j in range(flat.size):
                flat[j] = exponential(flat[j])
            for i in range(n):
                slot = own[i]
                _recall(shares, values, i, slot, layer, min(counts[slot] + 1, window), context)
                for j in range(width):
                    mixed[i, j] = fma(skip[layer, j], x[i, j], x[i, j])
            accumulate(h, w_readout[layer], mixed, n)
            accumulate(context, w_attended[layer], mixed, n)
            _normalise(mixed, n, norm_w[layer], norm_b[layer])
            for i in range(n):
                _copy(mixed[i], x[i])
        for i in range(n):
            _copy(b1, first[i])
            _copy(b2, second[i])
            _copy(b3, answer[i])
            counts[own[i]] += 1
        accumulate(x, w1, first, n)
        _rectify(first[:n])
        accumulate(first, w2, second, n)
        _rectify(second[:n])
        accumulate(second, w3, answer, n)
        for i in range(n):
            slot = own[i]
            for j in range(out.shape[1]):
                action[slot, j] = out[slot, j] = min(max(fma(fading, action[slot, j], answer[i, j]), -limit), limit)


@kernel
def _rectify(x):  # type: ignore[no-untyped-def]
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            x[i, j] = max(x[i, j], np.float32(0.0))
