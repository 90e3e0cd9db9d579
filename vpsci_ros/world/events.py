"""EVENT records from the bits that the engine sets in each slot."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.state import EVENT, SAFETY_MISSING

NO_EVENTS = np.zeros(0, EVENT)
NO_EVENTS.flags.writeable = False


def list_events(state: NDArray[np.void], bits: NDArray[np.uint16]) -> NDArray[np.void]:
    """Return EVENT[n], in the order of the slots, for EPISODE[B] and uint16[B] of bits 1 << kind."""
    slots = bits.nonzero()[0]
    if not len(slots):
        return NO_EVENTS
    out = np.zeros(_count(bits, slots), EVENT)
    _fill(state, bits, slots, out)
    return out


def joined(parts: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """Return several EVENT arrays as one, EVENT[n]; joined as bytes, since numpy copies records field by field."""
    if len(parts) < 2:
        return parts[0] if parts else NO_EVENTS
    return np.concatenate([part.view(np.uint8) for part in parts]).view(EVENT)


@kernel
def _count(bits, slots):  # type: ignore[no-untyped-def]
    count = 0
    for slot in slots:
        for kind in range(1, SAFETY_MISSING + 1):
            count += (bits[slot] >> kind) & 1
    return count


@kernel
def _fill(state, bits, slots, out):  # type: ignore[no-untyped-def]
    n = 0
    for slot in slots:
        for kind in range(1, SAFETY_MISSING + 1):
            if (bits[slot] >> kind) & 1:
                event, episode = out[n], state[slot]
                event.kind, event.slot = kind, slot
                event.scenario, event.episode, event.frame = episode.scenario, episode.episode, episode.frame
                event.outcome = episode.outcome
                event.least_curvttc = episode.least_curvttc
                event.vehicle_path, event.pedestrian_path = episode.vehicle_path, episode.pedestrian_path
                n += 1
