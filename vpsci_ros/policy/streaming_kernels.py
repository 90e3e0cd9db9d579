"""One streamed step of an SST actor in numba, written so that a row's bits depend on nothing but that row.

Every output of a matrix product has one accumulator, and adds its products in the order of k by fused multiply-add
(IEEE 754: one rounding). Rows are worked in fours, so that a weight once loaded serves four rows, and outputs lie
along the vector registers; neither changes what is added to what. Sums along a row run in sixteen fixed lanes.
The exponential is a polynomial in the same fused operations. So the result is the same for every batch size, row
position and thread, and on every processor that follows IEEE 754.

Library matrix products do not have this property: they choose kernels, and so the order of additions, by shape.
"""

import math

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from vpsci_ros.policy.config import LOG_SCALE
from vpsci_ros.safety import CRITICAL_TTC

LANES = 16
NORM_EPSILON = np.float32(1e-5)
NORMALISED_LIMIT = np.float32(6.0)  # as in `vpsci_ros.policy.sst`
_ONE, _CRITICAL_TTC = np.float32(1.0), np.float32(CRITICAL_TTC)
_POWERS_OF_TWO = np.exp2(np.arange(-126, 1)).astype(np.float32)
_LEAST, _GREATEST = (np.float32(bound) for bound in LOG_SCALE)
_GREATEST_SCALE = np.float32(math.exp(LOG_SCALE[1]))
_LOG2_E, _LN2_HIGH, _LN2_LOW = np.float32(1.4426950408889634), np.float32(0.693359375), np.float32(-2.12194440e-4)


@intrinsic
def fma(typing_context, a, b, c):  # type: ignore[no-untyped-def]
    """Return a * b + c with one rounding, float32."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.fma(*arguments)

    return types.float32(types.float32, types.float32, types.float32), generate


@njit(cache=True, nogil=True, boundscheck=False)
def accumulate(x, w, out, rows):  # type: ignore[no-untyped-def]
    """Add x[:rows] @ w to out[:rows]: x float32[R, K], w float32[K, N], out float32[R, N]."""
    depth, width = w.shape
    fours = depth - depth % 4
    row = 0
    while row + 4 <= rows:
        o0, o1, o2, o3 = out[row], out[row + 1], out[row + 2], out[row + 3]
        for k in range(0, fours, 4):
            w0, w1, w2, w3 = w[k], w[k + 1], w[k + 2], w[k + 3]
            a0, a1, a2, a3 = x[row, k], x[row, k + 1], x[row, k + 2], x[row, k + 3]
            b0, b1, b2, b3 = x[row + 1, k], x[row + 1, k + 1], x[row + 1, k + 2], x[row + 1, k + 3]
            c0, c1, c2, c3 = x[row + 2, k], x[row + 2, k + 1], x[row + 2, k + 2], x[row + 2, k + 3]
            d0, d1, d2, d3 = x[row + 3, k], x[row + 3, k + 1], x[row + 3, k + 2], x[row + 3, k + 3]
            for j in range(width):
                u0, u1, u2, u3 = w0[j], w1[j], w2[j], w3[j]
                o0[j] = fma(a3, u3, fma(a2, u2, fma(a1, u1, fma(a0, u0, o0[j]))))
                o1[j] = fma(b3, u3, fma(b2, u2, fma(b1, u1, fma(b0, u0, o1[j]))))
                o2[j] = fma(c3, u3, fma(c2, u2, fma(c1, u1, fma(c0, u0, o2[j]))))
                o3[j] = fma(d3, u3, fma(d2, u2, fma(d1, u1, fma(d0, u0, o3[j]))))
        for k in range(fours, depth):
            for j in range(width):
                o0[j] = fma(x[row, k], w[k, j], o0[j])
                o1[j] = fma(x[row + 1, k], w[k, j], o1[j])
                o2[j] = fma(x[row + 2, k], w[k, j], o2[j])
                o3[j] = fma(x[row + 3, k], w[k, j], o3[j])
        row += 4
    while row < rows:
        o0 = out[row]
        for k in range(0, fours, 4):
            w0, w1, w2, w3 = w[k], w[k + 1], w[k + 2], w[k + 3]
            a0, a1, a2, a3 = x[row, k], x[row, k + 1], x[row, k + 2], x[row, k + 3]
            for j in range(width):
                o0[j] = fma(a3, w3[j], fma(a2, w2[j], fma(a1, w1[j], fma(a0, w0[j], o0[j]))))
        for k in range(fours, depth):
            for j in range(width):
                o0[j] = fma(x[row, k], w[k, j], o0[j])
        row += 1


@njit(cache=True, nogil=True)
def _copy(row, out):  # type: ignore[no-untyped-def]
    """Copy a row; numba's own assignment takes seconds to compile, for the error text of shapes that differ."""
    for j in range(out.shape[0]):
        out[j] = row[j]


@njit(cache=True, nogil=True)
def exponential(x):  # type: ignore[no-untyped-def]
    """Return exp(x) for x <= 0, float32, to 2 units in the last place; 0 below -80 (Cephes' expf)."""
    if x < np.float32(-80.0):
        return np.float32(0.0)
    n = np.floor(fma(x, _LOG2_E, np.float32(0.5)))
    r = fma(-n, _LN2_LOW, fma(-n, _LN2_HIGH, x))
    p = fma(np.float32(1.9875691500e-4), r, np.float32(1.3981999507e-3))
    p = fma(p, r, np.float32(8.3334519073e-3))
    p = fma(p, r, np.float32(4.1665795894e-2))
    p = fma(p, r, np.float32(1.6666665459e-1))
    p = fma(p, r, np.float32(5.0000001201e-1))
    return fma(fma(p, r * r, r), _POWERS_OF_TWO[126 + int(n)], _POWERS_OF_TWO[126 + int(n)])


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
    lanes[:] = np.float32(0.0)
    whole = row.shape[0] - row.shape[0] % LANES
    for start in range(0, whole, LANES):
        for j in range(LANES):
            d = row[start + j] - mean
            lanes[j] = fma(d, d, lanes[j]) if squared else lanes[j] + d
    for j in range(whole, row.shape[0]):
        d = row[j] - mean
        lanes[0] = fma(d, d, lanes[0]) if squared else lanes[0] + d
    total = np.float32(0.0)
    for j in range(LANES):
        total += lanes[j]
    return total


@njit(cache=True, nogil=True)
def _attend(query, keys, values, risks, gain, scale, filled, logits, context):  # type: ignore[no-untyped-def]
    """Attention of one row over `filled` remembered steps.

    query float32[key, heads]; keys float32[window, key, heads]; values float32[window, hidden]; risks float32[window];
    gain float32[heads]; logits float32[window, heads] and context float32[hidden] are written.
    """
    depth, heads = query.shape
    for s in range(filled):
        for h in range(heads):
            logits[s, h] = np.float32(0.0)
        for d in range(depth):
            for h in range(heads):
                logits[s, h] = fma(query[d, h], keys[s, d, h], logits[s, h])
        for h in range(heads):
            logits[s, h] = fma(gain[h], risks[s], logits[s, h] * scale)
    for h in range(heads):
        top = logits[0, h]
        for s in range(1, filled):
            top = max(top, logits[s, h])
        total = np.float32(0.0)
        for s in range(filled):
            logits[s, h] = exponential(logits[s, h] - top)
            total += logits[s, h]
        for s in range(filled):
            logits[s, h] /= total
        part = context[h * depth : (h + 1) * depth]
        part[:] = np.float32(0.0)
        for s in range(filled):
            value = values[s, h * depth : (h + 1) * depth]
            for d in range(depth):
                part[d] = fma(logits[s, h], value[d], part[d])


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
            for k in range(latent.shape[1]):
                latent[i, k] = drawn[0][own[i], k]
            for k in range(noise.shape[1]):
                noise[i, k] = drawn[1][own[i], k]
        step_rows(
            own, inputs[begin : begin + size], risks[begin : begin + size], (latent, noise), entry, layers, head,
            limit, states, keys, values, seen, counts, window, work, answer,
        )  # fmt: skip
        for i in range(own.size):
            for k in range(answer.shape[1]):
                out[own[i], k] = answer[i, k]


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
    :param states: float32[slot, L, hidden]; keys: float32[slot, L, window, key, heads]; values: float32[slot, L,
        window, hidden]; seen: float32[slot, window], risks; counts: int64[slot], steps taken; all move on by one step.
    :param work: float32[6, R, hidden] scratch; out: float32[n, 2] clipped actions [m/s2].
    """
    n = slots.shape[0]
    decay, skip, gain, norm_w, norm_b, w_in, w_query, w_key, w_attended, w_readout = layers
    depth, heads = keys.shape[3], keys.shape[4]
    x, h, q, k, context, mixed = work[0], work[1], work[2], work[3], work[4], work[5]
    logits, lanes = np.empty((window, heads), np.float32), np.empty(LANES, np.float32)
    scale = np.float32(1.0) / np.sqrt(np.float32(depth))
    for i in range(n):
        _copy(entry[1], x[i])
        seen[slots[i], counts[slots[i]] % window] = risks[i]
    accumulate(inputs, entry[0], x, n)
    for layer in range(decay.shape[0]):
        for i in range(n):
            state = states[slots[i], layer]
            for j in range(state.shape[0]):
                h[i, j] = decay[layer, j] * state[j]
        accumulate(x, w_in[layer], h, n)
        q[:n] = np.float32(0.0)
        k[:n] = np.float32(0.0)
        accumulate(h, w_query[layer], q, n)
        accumulate(h, w_key[layer], k, n)
        for i in range(n):
            slot = slots[i]
            place, filled = counts[slot] % window, min(counts[slot] + 1, window)
            _copy(h[i], states[slot, layer])
            _copy(h[i], values[slot, layer, place])
            for d in range(depth):
                for each in range(heads):
                    keys[slot, layer, place, d, each] = k[i, d * heads + each]
            _attend(
                q[i].reshape(depth, heads), keys[slot, layer], values[slot, layer], seen[slot], gain[layer], scale,
                filled, logits, context[i],
            )  # fmt: skip
            for j in range(x.shape[1]):
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
            if answer.shape[1] > out.shape[1]:
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
