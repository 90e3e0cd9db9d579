"""Hand-over and hand-back: the rule-based pair acts until CurvTTC is critical, then the policies.

The policies act at policy frames only, every 0.1 s since the spawn, and their actions stay in force in
between. They take both agents at the first policy frame that is critical. Each critical tick sets `hold` to
`release_time`, each other tick counts it down, and control is given back at the first policy frame that is not
critical and has no hold left. So short changes of CurvTTC do not switch control repeatedly.

The danger is over when the two have passed each other, not when one of them has begun to yield: the rule-based pair,
which ignores the yielding, would drive and walk into the same conflict again, with less room than before. The benchmark
`benchmarks/outcomes.py --world release_time=...` shows what a shorter time costs.
"""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.state import HANDED_BACK, HANDED_OVER, RUNNING
from vpsci_ros.world.world_config import WorldConfig


def policy_frame(state: NDArray[np.void], config: WorldConfig) -> NDArray[np.bool_]:
    """Return which EPISODE[B] records run and are at a policy frame, bool[B]."""
    return (state["status"] == RUNNING) & (state["frame"] % config.policy_ticks == 0)


def acting(
    state: NDArray[np.void], on_frame: NDArray[np.bool_], critical: NDArray[np.bool_] | NDArray[np.uint8]
) -> NDArray[np.bool_]:
    """Return the rows in which the policies act now, bool[B].

    A history begins where `acting & (state["controlled"] == 0)`.

    :param state: EPISODE[B]; `status`, `controlled` and `hold` are read.
    :param on_frame: bool[B], `policy_frame` of the same tick.
    :param critical: bool[B] or uint8[B], from the safety monitor, of the same tick.
    """
    out = np.empty(len(state), np.bool_)
    _acting(state, on_frame, critical, out)
    return out


@kernel
def _acting(state, on_frame, critical, out):  # type: ignore[no-untyped-def]
    for i in range(state.size):
        slot = state[i]
        kept = slot.controlled != 0 and slot.hold > 0
        out[i] = on_frame[i] and slot.status == RUNNING and (critical[i] != 0 or kept)


@kernel
def update(episode, critical, on_frame, acts, release_ticks):  # type: ignore[no-untyped-def]
    """Apply the hand-over rules of one tick to a running EPISODE record; return the kind of event, or 0."""
    kind = 0
    if on_frame:
        if acts and episode.controlled == 0:
            kind = HANDED_OVER
        elif not acts and episode.controlled != 0:
            kind = HANDED_BACK
        episode.controlled = acts
        if not acts:
            episode.step = 0
            episode.vehicle_held = 0
            episode.pedestrian_held = 0
    if critical:
        episode.hold = release_ticks
    elif episode.hold > 0:
        episode.hold -= 1
    return kind
