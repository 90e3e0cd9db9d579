"""One streamed step of an SST actor in numba, written so that a row's bits depend on nothing but that row.

Every output of a matrix product has one accumulator, and adds its products in the order of k by fused multiply-add
(IEEE 754: one rounding). Rows are worked in eights, so that a weight once loaded serves eight rows, and outputs lie
along vectors (`vpsci_ros.policy.vectors`); neither changes what is added to what. Sums along a row run in sixteen
fixed lanes. The exponential is a polynomial in the same fused operations. So the result is the same for every batch
size, row position and thread, and on every processor that follows IEEE 754.

Library matrix products do not have this property: they choose kernels, and so the order of additions, by shape.
"""

import math

import numpy as np
from numba import njit

from vpsci_ros.policy.config import LOG_SCALE
from vpsci_ros.policy.vectors import LANES, fma, fma_all, load, power_of_two, spread, store
from vpsci_ros.safety import CRITICAL_TTC

NORM_EPSILON = np.float32(1e-5)
NORMALISED_LIMIT = np.float32(6.0)  # as in `vpsci_ros.policy.sst`
_ONE, _CRITICAL_TTC = np.float32(1.0), np.float32(CRITICAL_TTC)
_FAR = np.float32(-80.0)
_LEAST, _GREATEST = (np.float32(bound) for bound in LOG_SCALE)
_GREATEST_SCALE = np.float32(math.exp(LOG_SCALE[1]))
_LOG2_E, _LN2_HIGH, _LN2_LOW = np.float32(1.4426950408889634), np.float32(0.693359375), np.float32(-2.12194440e-4)


@njit(cache=True, nogil=True, boundscheck=False)
def accumulate(x, w, out, rows):  # type: ignore[no-untyped-def]
    """Add x[:rows] @ w to out[:rows]: x float32[R, K], w float32[K, N], out float32[R, N]."""
    depth, width = w.shape
    eights, whole, fours = rows - rows % 8, width - width % LANES, width - width % (4 * LANES)
    for i in range(0, eights, 8):
        for j in range(0, whole, LANES):
            o0, o1, o2, o3 = load(out, (i, j)), load(out, (i + 1, j)), load(out, (i + 2, j)), load(out, (i + 3, j))
            o4, o5, o6, o7 = load(out, (i + 4, j)), load(out, (i + 5, j)), load(out, (i + 6, j)), load(out, (i + 7, j))
            for k in range(depth):
                u = load(w, (k, j))
                o0, o1 = fma_all(x[i, k], u, o0), fma_all(x[i + 1, k], u, o1)
                o2, o3 = fma_all(x[i + 2, k], u, o2), fma_all(x[i + 3, k], u, o3)
                o4, o5 = fma_all(x[i + 4, k], u, o4), fma_all(x[i + 5, k], u, o5)
                o6, o7 = fma_all(x[i + 6, k], u, o6), fma_all(x[i + 7, k], u, o7)
            store(out, (i, j), o0)
            store(out, (i + 1, j), o1)
            store(out, (i + 2, j), o2)
            store(out, (i + 3, j), o3)
            store(out, (i + 4, j), o4)
            store(out, (i + 5, j), o5)
            store(out, (i + 6, j), o6)
            store(out, (i + 7, j), o7)
    for i in range(eights, rows):
        for j in range(0, fours, 4 * LANES):
            m, n, p = j + LANES, j + 2 * LANES, j + 3 * LANES
            o0, o1, o2, o3 = load(out, (i, j)), load(out, (i, m)), load(out, (i, n)), load(out, (i, p))
            for k in range(depth):
                o0, o1 = fma_all(x[i, k], load(w, (k, j)), o0), fma_all(x[i, k], load(w, (k, m)), o1)
                o2, o3 = fma_all(x[i, k], load(w, (k, n)), o2), fma_all(x[i, k], load(w, (k, p)), o3)
            store(out, (i, j), o0)
            store(out, (i, m), o1)
            store(out, (i, n), o2)
            store(out, (i, p), o3)
        for j in range(fours, whole, LANES):
            o0 = load(out, (i, j))
            for k in range(depth):
                o0 = fma_all(x[i, k], load(w, (k, j)), o0)
            store(out, (i, j), o0)
    for i in range(rows if whole < width else 0):
        for j in range(whole, width):
            total = out[i, j]
            for k in range(depth):
                total = fma(x[i, k], w[k, j], total)
            out[i, j] = total


@njit(cache=True, nogil=True)
def _copy(row, out):  # type: ignore[no-untyped-def]
    """Copy a row; numba's own assignment takes seconds to compile, for the error text of shapes that differ."""
    for j in range(out.shape[0]):
        out[j] = row[j]


@njit(cache=True, nogil=True)
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
    scale = power_of_two(int(n))
    return fma(fma(p, r * r, r), scale, scale) if x >= _FAR else np.float32(0.0)


@njit(cache=True, nogil=True)
def _normalise(row, gain, offset, lanes):  # type: ignore[no-untyped-def]
    """Apply LayerNorm to one row in place; sums run in fixed lanes."""
    width = row.shape[0]
    mean = _lane_sum(row, np.float32(0.0), False, lanes) / np.float32(width)
    variance = _lane_sum(row, mean, True, lanes) / np.float32(width)
    inverse = np.float32(1.0) / np.sqrt(variance + NORM_EPSILON)
    for j in range(width):
        row[j] = fma((row[j] - mean) * inverse, gain[j], offset[j])


@njit(cache=True, nogil=True)
def _lane_sum(row, mean, squared, lanes):  # type: ignore[no-untyped-def]
    """Return the sum of what a row is beyond a mean, or of its square; `lanes` float32[16] to work with."""
    whole = row.shape[0] - row.shape[0] % LANES
    sums, less = spread(np.float32(0.0)), spread(-mean)
    for start in range(0, whole, LANES):
        d = fma_all(np.float32(1.0), load(row, (start,)), less)
        sums = fma_all(d, d, sums) if squared else fma_all(np.float32(1.0), d, sums)
    store(lanes, (0,), sums)
    for j in range(whole, row.shape[0]):
        d0 = row[j] - mean
        lanes[0] = fma(d0, d0, lanes[0]) if squared else lanes[0] + d0
    total = np.float32(0.0)
    for j in range(LANES):
        total += lanes[j]
    return total


@njit(cache=True, nogil=True)
def _compare(query, keys, risks, gain, scale, filled, logits):  # type: ignore[no-untyped-def]
    """Compare one row's query, float32[hidden], with `filled` remembered steps, head by head; see `step_rows`.

    :param keys: float32[window, hidden]; risks: float32[window]; gain: float32[heads].
    :param logits: float32[window, heads], less the greatest of the head.
    """
    heads = logits.shape[1]
    depth = query.size // heads
    for s in range(filled):
        for h in range(heads):
            total = np.float32(0.0)
            for d in range(h * depth, (h + 1) * depth):
                total = fma(query[d], keys[s, d], total)
            logits[s, h] = fma(gain[h], risks[s], total * scale)
    for h in range(heads):
        top = logits[0, h]
        for s in range(1, filled):
            top = max(top, logits[s, h])
        for s in range(filled):
            logits[s, h] -= top


@njit(cache=True, nogil=True)
def _recall(shares, values, filled, context):  # type: ignore[no-untyped-def]
    """Fill in what one row recalls of `filled` steps, float32[hidden], by shares, float32[window, heads], unscaled.

    :param values: float32[window, hidden].
    """
    heads = shares.shape[1]
    depth = context.size // heads
    whole = depth - depth % LANES
    for h in range(heads):
        total = np.float32(0.0)
        for s in range(filled):
            total += shares[s, h]
        for s in range(filled):
            shares[s, h] /= total
        for d in range(h * depth, h * depth + whole, LANES):
            part = spread(np.float32(0.0))
            for s in range(filled):
                part = fma_all(shares[s, h], load(values, (s, d)), part)
            store(context, (d,), part)
        for d in range(h * depth + whole, (h + 1) * depth):
            context[d] = np.float32(0.0)
            for s in range(filled):
                context[d] = fma(shares[s, h], values[s, d], context[d])


@njit(cache=True, nogil=True, error_model="numpy")
def take_in(rows, observation, curvttc, reset, scaling, action, states, counts, inputs, risks):  # type: ignore[no-untyped-def]
    """Begin the histories of those `rows` that are reset, and fill in what the network gets for a step of each.

    :param rows: int64[n]; observation: float32[B, 6]; curvttc: float64[B] [s]; reset: bool[B]; scaling: mean and scale
        of observations, float32[6] each; action: float32[B, 2], the last one [m/s2].
    :param inputs: float32[n, I], normalised observation, action before and, where the network has it, risk.
    :param risks: float32[n].
    :returns: the first of `rows` that observes what is no number, and then nothing has been done; -1: there is none.
    """
    mean, scale = scaling
    size, width = mean.size, mean.size + action.shape[1]
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
            action[i, 0] = action[i, 1] = 0.0
            for layer in range(states.shape[1]):
                for k in range(states.shape[2]):
                    states[i, layer, k] = 0.0
        for k in range(size):
            inputs[n, k] = min(max((observation[i, k] - mean[k]) / scale[k], -NORMALISED_LIMIT), NORMALISED_LIMIT)
        inputs[n, size], inputs[n, size + 1] = action[i, 0], action[i, 1]
        risk = _ONE - np.float32(curvttc[i]) / _CRITICAL_TTC
        risks[n] = min(max(risk, np.float32(0.0)), _ONE)
        if inputs.shape[1] > width:
            inputs[n, width] = risks[n]
    return -1


@njit(cache=True, nogil=True)
def step_slots(  # type: ignore[no-untyped-def]
    slots, inputs, risks, drawn, entry, layers, head, limit, states, keys, values, seen, counts, window, work, out
):
    """`step_rows` of any number of rows, as many at once as `work` has room for, so that all of them stay in the cache.

    :param drawn: (latent numbers float32[slot, latent]; noise float32[slot, 2]).
    :param out: float32[slot, 2].
    """
    size = work.shape[1]
    answer, noise = np.empty((size, out.shape[1]), np.float32), np.empty((size, out.shape[1]), np.float32)
    latent = np.empty((size, drawn[0].shape[1]), np.float32)
    for begin in range(0, slots.size, size):
        own = slots[begin : begin + size]
        for i in range(own.size):
            _copy(drawn[0][own[i]], latent[i])
            _copy(drawn[1][own[i]], noise[i])
        step_rows(
            own, inputs[begin : begin + size], risks[begin : begin + size], (latent, noise), entry, layers, head,
            limit, states, keys, values, seen, counts, window, work, answer,
        )  # fmt: skip
        for i in range(own.size):
            _copy(answer[i], out[own[i]])


@njit(cache=True, nogil=True)
def step_rows(  # type: ignore[no-untyped-def]
    slots, inputs, risks, drawn, entry, layers, head, limit, states, keys, values, seen, counts, window, work, out
):
    """Take `slots.size` rows, at most as many as `work` holds, one step further.

    :param slots: int64[n], which histories; inputs: float32[n, I], normalised observation, action before and, where
        the network has it, risk; risks: float32[n].
    :param drawn: (latent numbers float32[n, latent]; noise float32[n, 2]); both zero for the deterministic middle. A
        network with latent numbers scales the noise, to the action of one without it is added as it is [m/s2].
    :param entry: (w [I, hidden], b [hidden]); layers: (decay, skip, gain, norm weight, norm bias: [L, ...], then the
        dense input, query, key, attended, readout: [L, hidden, hidden], inputs first); head: w, its
        rows for the latent numbers, and b of the first layer, then two (w, b).
    :param states: float32[slot, L, hidden]; keys, values: float32[slot, L, window, hidden]; seen: float32[slot,
        window], risks; counts: int64[slot], steps taken; all move on by one step.
    :param work: float32[6, R, hidden] scratch, n at most R; out: float32[n, 2] clipped actions [m/s2].
    """
    n, width = slots.shape[0], states.shape[2]
    decay, skip, gain, norm_w, norm_b, w_in, w_query, w_key, w_attended, w_readout = layers
    x, h, q, k, context, mixed = work[0], work[1], work[2], work[3], work[4], work[5]
    heads = gain.shape[1]
    shares, lanes = np.zeros((n, window, heads), np.float32), np.empty(LANES, np.float32)
    scale = np.float32(1.0) / np.sqrt(np.float32(width // heads))
    for i in range(n):
        _copy(entry[1], x[i])
        seen[slots[i], counts[slots[i]] % window] = risks[i]
    accumulate(inputs, entry[0], x, n)
    for layer in range(decay.shape[0]):
        for i in range(n):
            state = states[slots[i], layer]
            for j in range(width):
                h[i, j] = decay[layer, j] * state[j]
                q[i, j] = k[i, j] = np.float32(0.0)
        accumulate(x, w_in[layer], h, n)
        accumulate(h, w_query[layer], q, n)
        accumulate(h, w_key[layer], k, n)
        for i in range(n):
            slot = slots[i]
            place, filled = counts[slot] % window, min(counts[slot] + 1, window)
            _copy(h[i], states[slot, layer])
            _copy(h[i], values[slot, layer, place])
            _copy(k[i], keys[slot, layer, place])
            _compare(q[i], keys[slot, layer], seen[slot], gain[layer], scale, filled, shares[i])
        flat = shares.reshape(shares.size)
        for j in range(flat.size):
            flat[j] = exponential(flat[j])
        for i in range(n):
            slot = slots[i]
            _recall(shares[i], values[slot, layer], min(counts[slot] + 1, window), context[i])
            for j in range(width):
                mixed[i, j] = fma(skip[layer, j], x[i, j], x[i, j])
        accumulate(h, w_readout[layer], mixed, n)
        accumulate(context, w_attended[layer], mixed, n)
        for i in range(n):
            _normalise(mixed[i], norm_w[layer], norm_b[layer], lanes)
            _copy(mixed[i], x[i])
    latent, noise = drawn
    w1, w_latent, b1, w2, b2, w3, b3 = head
    first, second = np.empty((n, b1.size), np.float32), np.empty((n, b2.size), np.float32)
    answer = np.empty((n, b3.size), np.float32)
    for i in range(n):
        _copy(b1, first[i])
        _copy(b2, second[i])
        _copy(b3, answer[i])
        counts[slots[i]] += 1
    accumulate(x, w1, first, n)
    if latent.shape[1] > 0:
        accumulate(latent, w_latent, first, n)
    _rectify(first)
    accumulate(first, w2, second, n)
    _rectify(second)
    accumulate(second, w3, answer, n)
    for i in range(n):
        for j in range(out.shape[1]):
            action = answer[i, j]
            if latent.shape[1] > 0:
                action = fma(_scale(answer[i, out.shape[1] + j]), noise[i, j], action)
            else:
                action = action + noise[i, j]
            out[i, j] = min(max(action, -limit), limit)


@njit(cache=True, nogil=True)
def _scale(logarithm):  # type: ignore[no-untyped-def]
    """Return exp of a logarithm clipped to `LOG_SCALE`; `exponential` takes numbers up to 0."""
    return exponential(min(max(logarithm, _LEAST), _GREATEST) - _GREATEST) * _GREATEST_SCALE


@njit(cache=True, nogil=True)
def _rectify(x):  # type: ignore[no-untyped-def]
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            x[i, j] = max(x[i, j], np.float32(0.0))


@njit(cache=True, nogil=True)
def take_draws(  # type: ignore[no-untyped-def]
    rows, reset, latents, innovation, temperature, persistence, renewal, stillness, latent, noise, burst
):
    """Fill `latent`, `noise` and `burst` of `rows` from what they draw: see `vpsci_ros.policy.actor.Actor.burst`."""
    for i in rows:
        for k in range(latent.shape[1]):
            latent[i, k] = temperature * latents[i, k]
        for k in range(noise.shape[1]):
            e = innovation[i, k] if reset[i] else persistence * noise[i, k] + renewal * innovation[i, k]
            square = e * e
            noise[i, k], burst[i, k] = e, temperature * (e * square / (square + stillness[k]))
